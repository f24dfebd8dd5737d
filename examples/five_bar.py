"""A planar five-bar linkage: two motors, two stiffnesses, over its workspace.

The tip moves in two directions; in the other four the rigid links hold it, and no 6x6 stiffness
matrix exists. The compliance does, and its x, y block is the motion under a force in the plane.
"""

from pathlib import Path

import numpy as np

import cartstiff
from cartstiff import ConvergenceError


def main(picture: Path | None = None) -> dict[str, float]:
    """Principal stiffnesses (N/m) of the tip at the default posture and over the workspace."""
    linkage = cartstiff.load("five-bar")
    points = []
    for left in np.linspace(1.7, 2.7, 11):
        for right in np.linspace(0.45, 1.45, 11):
            try:
                result = cartstiff.analyse(linkage, {"left_motor": left, "right_motor": right})
            except ConvergenceError:
                continue  # the two arms do not meet there
            points.append((result.pose[:2, 3], *principal(result)))
    here = cartstiff.analyse(linkage)
    low, high = principal(here)
    if picture is not None:
        draw(points, picture)
    return {
        "rank": here.reduction.rank,
        "softest direction, N/m": low,
        "stiffest direction, N/m": high,
        "postures": len(points),
        "softest over the workspace, N/m": min(p[1] for p in points),
        "stiffest over the workspace, N/m": max(p[2] for p in points),
    }


def principal(result: cartstiff.PostureStiffness) -> tuple[float, float]:
    """Lowest and highest stiffness to a force in the plane."""
    C = result.compliances["B"][3:5, 3:5]
    values = np.linalg.eigvalsh(C)
    return float(1 / values[1]), float(1 / values[0])


def draw(points: list[tuple[np.ndarray, float, float]], picture: Path) -> None:
    """Lowest stiffness at every place of the tip."""
    import matplotlib.pyplot as plt

    figure, axis = plt.subplots(figsize=(5.4, 3.8), layout="constrained")
    x, y = np.array([p[0] for p in points]).T
    shown = axis.scatter(1e3 * x, 1e3 * y, c=[p[1] / 1e3 for p in points], s=60, cmap="viridis")
    figure.colorbar(shown, label="softest direction [N/mm]")
    axis.set(xlabel="x of the tip [mm]", ylabel="y of the tip [mm]", aspect="equal")
    figure.savefig(picture, dpi=80)
