"""Stiffness of a Panda's hand along its self-motion: the elbow moves, the hand does not.

Seven joints leave one free motion that keeps the hand where it is. The stiffness of the hand
changes along it.
"""

from pathlib import Path

import numpy as np

import cartstiff

STEP = 0.05  # rad, length of a step in joint space


def walk(arm: cartstiff.ElasticMechanism, steps: int, sign: float) -> list[np.ndarray]:
    """Postures along the self-motion from the default one; the hand's pose is kept."""
    postures, goal = [arm.q], arm.mechanism.at(arm.q).pose
    direction = sign * np.eye(7)[0]
    for _ in range(steps):
        motion = np.linalg.svd(arm.mechanism.at(postures[-1]).motion.jacobian)[2][-1]
        direction = motion if motion @ direction > 0 else -motion
        postures.append(
            cartstiff.inverse_kinematics(arm, goal, [postures[-1] + STEP * direction])[0]
        )
    return postures


def main(picture: Path | None = None) -> dict[str, float]:
    """Lowest and vertical translational stiffness (N/m) along the self-motion."""
    arm = cartstiff.load("panda")
    postures = walk(arm, 15, -1.0)[:0:-1] + walk(arm, 15, 1.0)
    elbow = STEP * (np.arange(len(postures)) - 15)
    lowest, vertical = [], []
    for q in postures:
        result = cartstiff.analyse(arm, q)
        # Stiffness felt by a force alone: the inverse of the translational block of the compliance.
        C = np.asarray(result.B.compliance())[3:, 3:]
        lowest.append(1 / np.linalg.eigvalsh(C)[-1])
        up = result.pose[:3, :3].T @ [0.0, 0.0, 1.0]
        vertical.append(1 / (up @ C @ up))
    if picture is not None:
        draw(elbow, lowest, vertical, picture)
    return {
        "lowest, default posture": float(lowest[15]),
        "lowest, least on the way": float(min(lowest)),
        "lowest, greatest on the way": float(max(lowest)),
        "vertical, default posture": float(vertical[15]),
        "vertical, least on the way": float(min(vertical)),
        "vertical, greatest on the way": float(max(vertical)),
    }


def draw(elbow: np.ndarray, lowest: list[float], vertical: list[float], picture: Path) -> None:
    """Stiffness against the way along the self-motion."""
    import matplotlib.pyplot as plt

    figure, axis = plt.subplots(figsize=(6, 3.4), layout="constrained")
    axis.plot(elbow, np.array(vertical) / 1e3, label="vertical")
    axis.plot(elbow, np.array(lowest) / 1e3, label="in the softest direction")
    axis.set(xlabel="way along the self-motion [rad]", ylabel="stiffness to a force [N/mm]")
    axis.set_ylim(0, 10)
    axis.legend()
    figure.savefig(picture, dpi=80)
