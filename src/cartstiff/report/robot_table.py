"""Postures and poses in the conventions of robot controllers: millimetres and degrees."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from cartstiff.arrays import Array, checked_array, csv_line
from cartstiff.errors import check_name
from cartstiff.geometry import se3
from cartstiff.mechanisms.contract import SI, Units, convert_length
from cartstiff.mechanisms.elastic import ElasticMechanism

#: Columns of a pose by controller; the first three are millimetres along the base's axes.
CONTROLLERS = {
    "kuka": ("X [mm]", "Y [mm]", "Z [mm]", "A [deg]", "B [deg]", "C [deg]"),
    "fanuc": ("X [mm]", "Y [mm]", "Z [mm]", "W [deg]", "P [deg]", "R [deg]"),
    "abb": ("X [mm]", "Y [mm]", "Z [mm]", "q1", "q2", "q3", "q4"),
    "ur": ("X [mm]", "Y [mm]", "Z [mm]", "RX [rad]", "RY [rad]", "RZ [rad]"),
}


def orientation_of(R: ArrayLike, controller: str) -> Array:
    """Convert orientations (m, 3, 3) to a controller's numbers (m, 3 or 4).

    "kuka": A, B, C with ``R = Rz(A) Ry(B) Rx(C)``; "fanuc": W, P, R with
    ``R = Rz(R) Ry(P) Rx(W)``; both in degrees. "abb": the unit quaternion q1 (real part), q2, q3,
    q4 with q1 not negative. "ur": the rotation vector in rad.

    Raises
    ------
    UnknownNameError
        For another controller.
    """
    from scipy.spatial.transform import Rotation

    check_name("controller", controller, CONTROLLERS)
    turns = Rotation.from_matrix(checked_array(R, [("N", 3, 3)], "rotations"))
    if controller == "abb":
        return np.asarray(turns.as_quat(canonical=True, scalar_first=True))
    if controller == "ur":
        return np.asarray(turns.as_rotvec())
    angles = np.asarray(turns.as_euler("ZYX", degrees=True, suppress_warnings=True))
    return angles if controller == "kuka" else angles[:, ::-1]


def robot_table(elastic: ElasticMechanism, q: ArrayLike, controller: str) -> str:
    """Return a CSV of joints (deg, mm) and poses of M in the robot's base for a controller.

    Parameters
    ----------
    elastic : ElasticMechanism
        The mechanism, with M at the tool.
    q : array_like (m, n)
        Coordinates that are commanded.
    controller : str
        Controller that shows them. kuka: X,Y,Z,A,B,C. fanuc: X,Y,Z,W,P,R. abb: quaternion
        q1..q4. ur: rotation vector.

    Raises
    ------
    UnknownNameError
        For another controller.
    """
    Q = checked_array(q, [("N", len(elastic.names))], "postures")
    T_B_F = se3.inverse(elastic.mechanism.base_pose)
    poses = np.array([T_B_F @ elastic.mechanism.at(row).pose for row in Q])
    to_mm = convert_length(elastic.units, Units("mm", SI.force))[0]
    lengths = np.array([c.is_length for c in elastic.mechanism.coordinates])
    names = [f"{c.name} [{'mm' if c.is_length else 'deg'}]" for c in elastic.mechanism.coordinates]
    columns = np.column_stack(
        [
            np.where(lengths, Q * to_mm, np.degrees(Q)),
            poses[:, :3, 3] * to_mm,
            orientation_of(poses[:, :3, :3], controller),
        ]
    )
    lines = [",".join(f"{x + 0.0:.6f}" for x in row) for row in columns]
    return csv_line([*names, *CONTROLLERS[controller]]) + "\n".join(lines) + "\n"
