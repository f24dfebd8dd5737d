"""Stiffness ellipsoids along a path of a UR5, in a meshcat scene of your own.

Give ``main`` your own ``meshcat.Visualizer()``: ellipsoids, load and path are added below the place
"stiffness", and nothing else there changes. Run as a script it draws into a window that only
records, and prints the amount of data.
"""

from pathlib import Path
from typing import Any

import numpy as np

import cartstiff
from cartstiff.analysis import stiffness_ellipsoid
from cartstiff.scene import Logarithmic, RecordingWindow, add_ellipsoid, add_path, add_wrench

STRETCHING = np.linspace(1.9, 0.5, 6)  # of the elbow, rad
PUSH = [0, 0, 0, 0, 0, -50]  # N m, N, in the tool's axes


def main(picture: Path | None = None, visualizer: Any = None) -> dict[str, float]:
    """Softest and firmest direction (N/m) along the path, and what the radii mean."""
    window = RecordingWindow()
    if visualizer is None:
        import meshcat

        visualizer = meshcat.Visualizer(window=window)
    place = visualizer["stiffness"]
    arm = cartstiff.load("ur5")
    results = [cartstiff.analyse(arm, {"elbow_joint": e}, wrench=PUSH) for e in STRETCHING]
    values = np.array(
        [stiffness_ellipsoid(r.K.matrix, "translation", "held").eigenvalues for r in results]
    )
    # One scale for all of them, so that they can be compared by eye.
    scale = Logarithmic.from_values(values, 0.2)
    for i, result in enumerate(results):
        add_ellipsoid(
            place[f"posture {i + 1}"],
            result.K.matrix,
            result.pose,
            scale=scale,
            unit="N/m",
            labels=i == 0,
        )
    add_path(place["path"], [r.pose[:3, 3] for r in results])
    add_wrench(place["load"], results[-1].wrench, results[-1].pose)
    if picture is not None:
        draw(values, picture)
    return {
        "softest direction, bent, N/m": float(values[0, 0]),
        "softest direction, stretched, N/m": float(values[-1, 0]),
        "firmest direction, stretched, N/m": float(values[-1, 2]),
        "no radius at, N/m": scale.zero,
        "radius for each factor of ten, m": scale.per_decade,
        "commands": float(len(window.snapshot())),
    }


def draw(values: np.ndarray, picture: Path) -> None:
    """Principal stiffnesses along the path."""
    import matplotlib.pyplot as plt

    figure, axis = plt.subplots(figsize=(6, 3.4), layout="constrained")
    for k, name in enumerate(("softest", "middle", "firmest")):
        axis.semilogy(np.degrees(STRETCHING), values[:, k], "o-", label=name)
    axis.set(xlabel="elbow [deg]", ylabel="principal stiffness [N/m]")
    axis.invert_xaxis()
    axis.legend()
    figure.savefig(picture, dpi=80)
