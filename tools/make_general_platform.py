"""Make `src/cartstiff/wings/reach/general_platform.npz`: 40 solutions of a general platform.

One solution is chosen first and the platform made for it; the others are found by monodromy: the
platform is led around loops in the space of complex platforms, which exchange its solutions.

    python tools/make_general_platform.py [FILE]
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from cartstiff.wings.reach import platform_assembly as study

_LOOPS = 60
_SAME = 1e-6


def _general(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    anchors, points = rng.normal(size=(2, 6, 3, 2)) @ (1.0, 1.0j) / np.sqrt(3.0)
    return anchors, points


def _different(x: np.ndarray) -> np.ndarray:
    """One of each solution, as unit vectors."""
    kept: list[np.ndarray] = []
    for row in x / np.linalg.norm(x, axis=1)[:, None]:
        if all(abs(np.vdot(row, other)) < 1.0 - _SAME for other in kept):
            kept.append(row)
    return np.array(kept)


def make(seed: int = 40) -> dict[str, np.ndarray]:
    """Anchors, points, squares of lengths, and all solutions that loops lead to."""
    rng = np.random.default_rng(seed)
    anchors, points = _general(rng)
    c, g = rng.normal(size=(2, 4, 2)) @ (1.0, 1.0j)
    g -= (c @ g) / (c @ c) * c
    x = np.concatenate([c, g])[None]
    # Each squared length appears once in its own equation, times -|c|^2.
    bare = study.quadrics(anchors, points, np.zeros(6))
    squares = np.einsum("i,nij,j->n", x[0], bare[:6], x[0]) / (c @ c)
    own = study.quadrics(anchors, points, squares)
    for loop in range(_LOOPS):
        others = [
            study.quadrics(*_general(rng), rng.normal(size=(6, 2)) @ (1.0, 1.0j)) for _ in range(2)
        ]
        moved = x
        for start, end in zip([own, *others], [*others, own], strict=True):
            ends = study.follow(start, end, moved)
            moved = ends.x[ends.at == 0.0]
        x = _different(np.vstack([x, moved]))
        print(f"loop {loop + 1}: {len(x)} solutions", file=sys.stderr)
    return {"anchors": anchors, "points": points, "squares": squares, "solutions": x}


if __name__ == "__main__":
    default = Path(study.__file__).with_name("general_platform.npz")
    np.savez(Path(sys.argv[1]) if len(sys.argv) > 1 else default, **make())
