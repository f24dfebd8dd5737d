"""The four stiffness matrices of one loaded UR5, and their differences.

The environment pushes the flange with 400 N, and the joint springs balance it. This is far more
than a UR5 may carry, so that the differences are easy to see.
"""

from pathlib import Path

import numpy as np

import cartstiff

WRENCH = np.array([0.0, 0.0, 0.0, 150.0, 0.0, -370.0])  # N m, N; in the tool's axes


def main(picture: Path | None = None) -> dict[str, float]:
    """Largest difference of each matrix from K^B, per block, and the asymmetry of K^A."""
    result = cartstiff.analyse(cartstiff.load("ur5"), wrench=WRENCH)
    K = result.matrices
    numbers = {}
    for name in "AKF":
        change = np.abs(K[name] - K["B"])
        numbers[f"{name} rotation, N m/rad"] = float(change[:3, :3].max())
        numbers[f"{name} coupling, N"] = float(change[:3, 3:].max())
        numbers[f"{name} translation, N/m"] = float(change[3:, 3:].max())
    numbers["asymmetry of A, N"] = float(np.abs(K["A"] - K["A"].T).max())
    if picture is not None:
        draw(K, picture)
    return numbers


def draw(K: dict[str, np.ndarray], picture: Path) -> None:
    """K^B, and what the others add to it."""
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, 3, figsize=(9, 3.2), layout="constrained")
    labels = [f"{v}{i}" for v in ("ω", "v") for i in "xyz"]
    rows = [f"{v}{i}" for v in ("m", "f") for i in "xyz"]
    for axis, name in zip(axes, "AKF", strict=True):
        change = K[name] - K["B"]
        size = np.abs(change).max()
        axis.imshow(np.cbrt(change / size), cmap="RdBu", vmin=-1.6, vmax=1.6)
        for (i, j), x in np.ndenumerate(change):
            if abs(x) > 0.5:
                axis.text(j, i, f"{x:.0f}", ha="center", va="center", fontsize=7)
        axis.set_title(f"$K^{name} - K^B$")
        axis.set_xticks(range(6), labels)
        axis.set_yticks(range(6), rows)
    figure.savefig(picture, dpi=80)
