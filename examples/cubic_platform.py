"""A cubic platform is isotropic at its centre, and less so above it.

At the centre K is diagonal: 2 k for every translation, k H^2 (3/2, 3/2, 6) for the rotations, with
k the stiffness of a leg and H the height between the two rings of joints.
"""

from pathlib import Path

import numpy as np

import cartstiff

HEIGHTS = np.linspace(-0.10, 0.10, 21)  # m


def main(picture: Path | None = None) -> dict[str, float]:
    """Deviation from the closed form at the centre, and the spread of stiffness off it."""
    platform = cartstiff.load("cubic")
    k, H = 1e6, 0.5 / np.sqrt(3)
    closed = k * np.diag([1.5 * H**2, 1.5 * H**2, 6 * H**2, 2, 2, 2])
    at_centre = cartstiff.analyse(platform).B.matrix
    values = []
    for z in HEIGHTS:
        K = cartstiff.analyse(platform, [0, 0, z, 0, 0, 0]).B.matrix
        values.append(np.linalg.eigvalsh(K[3:, 3:]))
    values = np.array(values)
    ratio = values[:, 2] / values[:, 0]
    if picture is not None:
        draw(values, picture)
    return {
        "deviation from the closed form": float(np.abs(at_centre - closed).max() / closed.max()),
        "ratio of stiffnesses at the centre": float(ratio[10]),
        "ratio 0.1 m below": float(ratio[0]),
        "ratio 0.1 m above": float(ratio[-1]),
    }


def draw(values: np.ndarray, picture: Path) -> None:
    """Principal translational stiffnesses against height."""
    import matplotlib.pyplot as plt

    figure, axis = plt.subplots(figsize=(6, 3.4), layout="constrained")
    axis.plot(1e3 * HEIGHTS, values / 1e6)
    axis.set(
        xlabel="height above the centre [mm]", ylabel="principal stiffness, translation [kN/mm]"
    )
    figure.savefig(picture, dpi=80)
