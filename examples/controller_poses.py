"""A compensated program as robot controllers show it: poses in millimetres and their own angles.

A UR5 presses along its tool at the points of an arc; the commands cancel its deflection. A
controller computes a pose in the robot's own base frame from the commanded joints,
without deflection. KUKA has R = Rz(A) Ry(B) Rx(C); FANUC W, P, R with R = Rz(R) Ry(P) Rx(W); ABB a
quaternion with the real part first; UR the rotation vector. The picture shows by how much the poses
of the program change.
"""

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

import cartstiff
from cartstiff import FollowerWrench, compensate
from cartstiff.geometry import se3

PRESS = FollowerWrench([0.0, 0.0, 0.0, 0.0, 0.0, -60.0])  # N m, N, along the tool's axis


def orientation(controller: str, R: np.ndarray) -> np.ndarray:
    """Numbers of a controller for rotations (m, 3, 3): degrees, a quaternion, or rad."""
    turns = Rotation.from_matrix(R)
    if controller == "abb":
        return turns.as_quat(canonical=True, scalar_first=True)
    if controller == "ur":
        return turns.as_rotvec()
    angles = turns.as_euler("ZYX", degrees=True)  # about axes that turn along: A, B, C
    return angles if controller == "kuka" else angles[:, ::-1]


def program(arm: cartstiff.ElasticMechanism, q: np.ndarray, controller: str) -> np.ndarray:
    """Rows of X, Y, Z [mm] and the orientation, in the robot's base frame."""
    base = se3.inverse(arm.mechanism.base_pose)
    poses = np.array([base @ cartstiff.analyse(arm, row).pose for row in q])
    return np.column_stack([1e3 * poses[:, :3, 3], orientation(controller, poses[:, :3, :3])])


def main(picture: Path | None = None) -> dict[str, object]:
    """The first pose for each controller, and the largest changes of the program for KUKA."""
    arm = cartstiff.load("ur5")
    start = arm.mechanism.at(arm.q).pose
    arc = [
        start @ se3.pose(Rotation.from_euler("x", 0.1 * i).as_matrix(), [0.0, 0.02 * i, 0.0])
        for i in range(6)
    ]
    result = compensate(arm, np.array(arc), PRESS)
    taught, commanded = (program(arm, q, "kuka") for q in (result.naive, result.commands))
    if picture is not None:
        draw(commanded - taught, picture)
    first = {c: program(arm, result.commands[:1], c)[0] for c in ("kuka", "fanuc", "abb", "ur")}
    return {
        "X, mm": float(first["kuka"][0]),
        "KUKA A, deg": float(first["kuka"][3]),
        "FANUC W, deg": float(first["fanuc"][3]),
        "ABB q1": float(first["abb"][3]),
        "UR RX, rad": float(first["ur"][3]),
        "largest change of a position, mm": float(np.abs((commanded - taught)[:, :3]).max()),
        "largest change of an angle, deg": float(np.abs((commanded - taught)[:, 3:]).max()),
    }


def draw(change: np.ndarray, picture: Path) -> None:
    """Change of the program by point."""
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, 2, figsize=(7, 3.2), layout="constrained")
    points = np.arange(1, len(change) + 1)
    for axis, columns, names, unit in zip(
        axes, (slice(0, 3), slice(3, 6)), ("XYZ", "ABC"), ("mm", "deg"), strict=True
    ):
        for values, name in zip(change[:, columns].T, names, strict=True):
            axis.plot(points, values, "o-", label=name)
        axis.set(xlabel="point", ylabel=f"change [{unit}]")
        axis.legend()
    figure.savefig(picture, dpi=80)
