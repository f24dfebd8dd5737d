"""Meaning of a stiffness matrix: directions, centres and screws of a UR5 under 100 N.

Softest direction, centres, screws, an index with its length, and whether the choice of the
connection matters. The picture shows two traps: a condition number is a function of the length that
is chosen, and the connections differ more as the load grows.
"""

from pathlib import Path

import numpy as np

import cartstiff
from cartstiff.analysis import (
    best_conditioned_length,
    centres_of,
    compare_connections,
    condition_numbers,
    eigenscrews,
    indices_of,
    natural_length,
    stiffness_ellipsoid,
)

LENGTHS = np.geomspace(0.02, 2.0, 41)  # m
FORCES = np.array([100.0, 300.0, 1000.0, 3000.0])  # N


def main(picture: Path | None = None) -> dict[str, object]:
    """The readings, with units in their names."""
    arm = cartstiff.load("ur5")
    K = cartstiff.analyse(arm, wrench=[0, 0, 0, 0, 0, -100]).B.matrix
    points, screws = centres_of(K), eigenscrews(K)
    changes = []
    for force in FORCES:
        loaded = cartstiff.analyse(arm, wrench=[0, 0, 0, 0, 0, -force])
        table = compare_connections(loaded.matrices, reference="B")
        changes.append({row.name: 100 * row.change for row in table.rows})
    if picture is not None:
        draw(K, changes, picture)
    length = natural_length(K)
    held, free = (stiffness_ellipsoid(K, "translation", o).eigenvalues for o in ("held", "free"))
    return {
        "softest, rotation held, N/m": float(held[0]),
        "softest, rotation free, N/m": float(free[0]),
        "from flange to centre of compliance, m": float(np.linalg.norm(points.compliance)),
        "smallest pitch, m/rad": min(abs(e.screw.pitch) for e in screws.screws),
        "natural length, m": length,
        "condition number there": indices_of(K, length).condition_number,
        "condition number in metres": indices_of(K, 1.0).condition_number,
        "best condition number": best_conditioned_length(K)[1],
        "largest change by the connection at 100 N, %": max(changes[0].values()),
        "largest change by the connection at 3 kN, %": max(changes[-1].values()),
    }


def draw(K: np.ndarray, changes: list[dict[str, float]], picture: Path) -> None:
    """Condition number against length, change by the connection against load."""
    import matplotlib.pyplot as plt

    figure, (left, right) = plt.subplots(1, 2, figsize=(8, 3.4), layout="constrained")
    left.loglog(LENGTHS, condition_numbers(K, LENGTHS))
    left.axvline(natural_length(K), linestyle=":", color="0.4", label="natural length")
    left.set(xlabel="characteristic length [m]", ylabel="condition number")
    left.legend()
    for name in changes[0]:
        right.loglog(FORCES, [change[name] for change in changes], "o-", label=f"K^{name}")
    right.axhline(1.0, linestyle=":", color="0.4")
    right.set(xlabel="force [N]", ylabel="change against K^B [%]")
    right.legend()
    figure.savefig(picture, dpi=80)
