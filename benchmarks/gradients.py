"""A million gradients of the softest stiffness of a UR5 beside a million stiffnesses.

    python benchmarks/gradients.py [COUNT]

By coordinates, springs and load, in one run; times are those of the process, the smallest of
three. With JAX installed, reverse mode of a lean function written by hand is beside them: the
compliance of six springs, ``J k^-1 J^T``, without a load.
"""

from __future__ import annotations

import importlib.util
import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np

import cartstiff

OF = "translation_free_min"
LOAD = np.array([0.0, 0.0, 0.0, 0.0, 0.0, -80.0])


def seconds(call: Callable[[], Any]) -> float:
    """Least time of the process in three calls."""
    found = []
    for _ in range(3):
        start = time.process_time()
        call()
        found.append(time.process_time() - start)
    return min(found)


def by_jax(arm: Any, Q: np.ndarray) -> float:
    """Time of JAX for the gradients of all postures by coordinates and springs."""
    import jax
    import jax.numpy as jnp

    jax.config.update("jax_enable_x64", True)
    tree = arm.mechanism.tree
    places = [jnp.array(T) for T in tree.placements()]
    tip, k = jnp.array(arm.mechanism.body.T_j_f), jnp.array(arm.springs.stiffness)

    def softest(q: Any, k: Any) -> Any:
        T, axes = jnp.eye(4), []
        for place, x in zip(places, q, strict=True):
            T = T @ place
            axes.append((T[:3, 2], T[:3, 3]))
            c, s = jnp.cos(x), jnp.sin(x)
            turn = jnp.array([[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1.0]])
            T = T @ turn
        p = (T @ tip)[:3, 3]
        J = jnp.stack([jnp.cross(z, p - o) for z, o in axes], axis=1)
        return 1.0 / jnp.linalg.eigvalsh((J / k) @ J.T)[-1]

    many = jax.jit(jax.vmap(jax.grad(softest, argnums=(0, 1)), in_axes=(0, None)))
    rows = jnp.array(Q)
    jax.block_until_ready(many(rows, k))
    return seconds(lambda: jax.block_until_ready(many(rows, k)))


def main(count: int) -> None:
    """Print times in microseconds for each posture."""
    arm = cartstiff.load("ur5")
    program = cartstiff.record(arm, [OF], loaded=True, load_axes="world")
    Q = arm.q + np.random.default_rng(0).uniform(-0.5, 0.5, (count, 6))
    program.gradient(OF, Q[:2], LOAD)
    value = seconds(lambda: program.many(Q, LOAD))
    slope = seconds(lambda: program.gradient(OF, Q, LOAD))
    print(f"{count} postures, microseconds of the process for each")
    print(f"  softest stiffness            {1e6 * value / count:.3f}")
    print(f"  the same with 24 derivatives {1e6 * slope / count:.3f}  ({slope / value:.2f} times)")
    if importlib.util.find_spec("jax"):
        print(f"  JAX, 12 derivatives, no load {1e6 * by_jax(arm, Q) / count:.3f}")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 1_000_000)
