"""The asymmetry of K^A grows with the load; K^B and K^K stay symmetric.

Equation 50 of Zefran & Kumar: K^A - (K^A)^T is made of the load alone, whatever the mechanism. The
forces go far beyond what a UR5 may carry, to make the effect easy to see.
"""

from pathlib import Path

import numpy as np

import cartstiff

DIRECTION = np.array([0.0, 0.0, 0.0, 0.0, 0.6, -0.8])  # a unit force in the tool's axes
FORCES = np.linspace(0.0, 500.0, 11)  # N


def main(picture: Path | None = None) -> dict[str, float]:
    """Asymmetry at the largest force, predicted and found, and the effect on the stiffness."""
    arm = cartstiff.load("ur5")
    found, predicted, lowest = [], [], []
    for force in FORCES:
        result = cartstiff.analyse(arm, wrench=force * DIRECTION)
        found.append(np.abs(result.A.asymmetry).max())
        predicted.append(np.abs(result.A.predicted_asymmetry).max())
        lowest.append(np.linalg.eigvalsh(result.B.matrix[3:, 3:])[0])
    if picture is not None:
        draw(found, predicted, lowest, picture)
    return {
        "asymmetry per force": float(found[-1] / FORCES[-1]),
        "largest error of the prediction, N": float(np.abs(np.subtract(found, predicted)).max()),
        "asymmetry of B at 500 N, N": float(np.abs(result.B.asymmetry).max()),
        "lowest translational stiffness unloaded, N/m": float(lowest[0]),
        "the same at 500 N, N/m": float(lowest[-1]),
    }


def draw(found: list[float], predicted: list[float], lowest: list[float], picture: Path) -> None:
    """Asymmetry against force, and the lowest translational stiffness."""
    import matplotlib.pyplot as plt

    figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3.2), layout="constrained")
    left.plot(FORCES, predicted, label="equation 50")
    left.plot(FORCES, found, "o", label="$K^A$ of the arm")
    left.set(xlabel="force [N]", ylabel="largest entry of $|K - K^T|$ [N]")
    left.legend()
    right.plot(FORCES, np.array(lowest) / 1e3, "o-")
    right.set(xlabel="force [N]", ylabel="lowest translational stiffness [N/mm]")
    figure.savefig(picture, dpi=80)
