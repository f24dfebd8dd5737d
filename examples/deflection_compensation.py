"""Milling a circle with a UR5: the commands that keep the loaded tool on the path.

The cutting force turns with the cut, 60 N along the path and 30 N towards the centre, and the tool
weighs 2 kg. The compensated joint angles put the tool on the circle exactly, if the arm is as stiff
as the model; the picture shows the error that remains if the arm is a tenth softer. The joint
stiffnesses are those of the bundled file: illustrative.
"""

from pathlib import Path

import numpy as np

import cartstiff
from cartstiff import CompensatedPath, DeadForce, compensate, equilibrium, payload
from cartstiff.geometry import se3

RADIUS, POINTS = 0.05, 24  # m
TOOL = payload(2.0, [0.0, 0.0, -9.81], [0.0, 0.0, 0.06])  # kg, m/s^2, m in the flange's axes


def main(picture: Path | None = None) -> dict[str, object]:
    """Errors before and after, in mm and degrees, and the largest change of a command."""
    arm = cartstiff.load("ur5")
    start = arm.mechanism.at(arm.q).pose
    poses, loads = [], []
    for angle in np.linspace(0.0, 2 * np.pi, POINTS):
        out = np.array([np.cos(angle), np.sin(angle), 0.0])
        ahead = np.array([-np.sin(angle), np.cos(angle), 0.0])
        centre = start[:3, 3] - [RADIUS, 0.0, 0.0]
        poses.append(se3.pose(start[:3, :3], centre + RADIUS * out))
        loads.append([DeadForce(-60.0 * ahead - 30.0 * out), TOOL])
    result = compensate(arm, np.array(poses), loads)
    errors = result.summary()
    real = []  # the same commands, given to an arm that is a tenth softer
    for q, rest, acting, pose in zip(result.q, result.commands, loads, poses, strict=True):
        softer = arm.with_springs(0.9 * arm.springs.stiffness, rest)
        real.append(equilibrium(softer, q, *acting).pose[:3, 3] - pose[:3, 3])
    left = 1e3 * np.linalg.norm(real, axis=1)
    if picture is not None:
        draw(result, left, picture)
    return {
        "before, largest, mm": 1e3 * errors["before"]["translation_max"],
        "before, rms, mm": 1e3 * errors["before"]["translation_rms"],
        "before, largest, deg": float(np.degrees(errors["before"]["rotation_max"])),
        "after, largest, mm": 1e3 * errors["after"]["translation_max"],
        "after, on an arm a tenth softer, largest, mm": float(left.max()),
        "largest change of a command, mrad": float(1e3 * np.abs(result.offsets).max()),
        "all points are stable": all(result.stable),
    }


def draw(result: CompensatedPath, left: np.ndarray, picture: Path) -> None:
    """Distance from the circle along it."""
    import matplotlib.pyplot as plt

    figure, axis = plt.subplots(figsize=(6, 3.4), layout="constrained")
    angles = np.linspace(0.0, 360.0, POINTS)
    before, after = (1e3 * np.linalg.norm(e[:, 3:], axis=1) for e in (result.before, result.after))
    axis.plot(angles, before, "o-", label="not compensated")
    axis.plot(angles, left, "s-", label="compensated, the arm a tenth softer than assumed")
    axis.plot(angles, after, label="compensated, the arm as assumed")
    axis.set(xlabel="place on the circle [deg]", ylabel="distance from the circle [mm]")
    axis.legend()
    figure.savefig(picture, dpi=80)
