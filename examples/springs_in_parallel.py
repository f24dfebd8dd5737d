"""Springs in parallel that have a UR5's stiffness: five along lines, and one with a pitch.

A sum of springs k w w^T has the coupling block's trace, the sum of k times pitch. Where the trace
is zero, springs along lines suffice. Any factor K = F F^T may be turned: a rotation of two columns
makes the pitch of one what is wanted, and the trace stays. All but the last get none here; the last
has what is left. The picture shows the lines through the arm's room.
"""

from pathlib import Path

import numpy as np

import cartstiff

SWAP = np.eye(6)[[3, 4, 5, 0, 1, 2]]  # w^T SWAP w is twice the force times its part of the moment


def springs_of(K: np.ndarray) -> np.ndarray:
    """Wrenches (6, 6) as columns whose sum w w^T is K; all but the last without a pitch."""
    length = np.sqrt(np.trace(K[:3, :3]) / np.trace(K[3:, 3:]))
    sizes = np.repeat([length, 1.0], 3)
    values, vectors = np.linalg.eigh(K / np.outer(sizes, sizes))
    F = vectors * np.sqrt(values)
    for i in range(5):
        d = np.einsum("ai,ab,bi->i", F, SWAP, F)
        others = [j for j in range(i, 6) if d[i] * d[j] < 0]
        if not others:
            continue  # it has none
        j = max(others, key=lambda j: abs(d[j]))
        n = F[:, i] @ SWAP @ F[:, j]
        root = np.sqrt(n * n - d[i] * d[j])
        t = -d[i] / (n + np.copysign(root, n))  # d_i + 2 n t + d_j t^2 = 0
        c = 1 / np.hypot(1, t)
        F[:, [i, j]] = F[:, [i, j]] @ np.array([[c, -t * c], [t * c, c]])
    return F * sizes[:, None]


def main(picture: Path | None = None) -> dict[str, object]:
    """Stiffnesses (kN/m) and pitches of the springs, and how well they give the matrix."""
    K = cartstiff.analyse(cartstiff.load("ur5")).B.matrix
    W = springs_of(K)
    moments, forces = W[:3], W[3:]
    k = (forces**2).sum(axis=0)
    pitch = (forces * moments).sum(axis=0) / k
    if picture is not None:
        draw(W, picture)
    return {
        "springs with a pitch": int((np.abs(pitch) > 1e-9).sum()),
        "pitch of the last, mm/rad": 1e3 * float(pitch[-1]),
        "trace of the coupling block, kN": 1e-3 * float(np.trace(K[:3, 3:])),
        "stiffness times pitch of all, kN": 1e-3 * float(k @ pitch),
        "softest spring, kN/m": 1e-3 * float(k.min()),
        "largest difference from the matrix, relative": float(np.abs(W @ W.T - K).max() / K.max()),
    }


def draw(W: np.ndarray, picture: Path) -> None:
    """Lines of the springs in the flange's frame, as long as a metre."""
    import matplotlib.pyplot as plt

    figure = plt.figure(figsize=(5, 4.4), layout="constrained")
    axes = figure.add_subplot(projection="3d")
    for i, (moment, force) in enumerate(zip(W[:3].T, W[3:].T, strict=True)):
        k = force @ force
        point, along = np.cross(force, moment) / k, force / np.sqrt(k)
        ends = np.array([point - 0.5 * along, point + 0.5 * along])
        axes.plot(*ends.T, label=f"{1e-3 * k:.3g} kN/m" + (", with a pitch" if i == 5 else ""))
    axes.set(xlabel="x [m]", ylabel="y [m]", zlabel="z [m]")
    axes.legend(fontsize="small")
    figure.savefig(picture, dpi=80)
