"""Joints of Pinocchio's kinds: as joints with one coordinate each, their limits and poses."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin

from cartstiff.errors import InputError
from cartstiff.geometry import se3
from cartstiff.geometry.se3 import Array

#: Of a tree. Pinocchio's workspace grows with their cube: 200 take 0.3 GB, 600 take 7 GB.
MOST_COORDINATES = 200


def check_coordinates(model: pin.Model) -> None:
    """Refuse a model with more than `MOST_COORDINATES`, before memory is taken for it.

    Raises
    ------
    InputError
        With their number.
    """
    if model.nv > MOST_COORDINATES:
        raise InputError(
            "too many coordinates", expected=f"at most {MOST_COORDINATES}", got=model.nv
        )


# How joints with several coordinates are written as successive one-coordinate joints; the order
# is that of Pinocchio's own configuration, translations before rotations.
_EXPANSIONS: dict[str, tuple[tuple[str, str], ...]] = {
    "JointModelSpherical": (("x", "RX"), ("y", "RY"), ("z", "RZ")),
    "JointModelSphericalZYX": (("z", "RZ"), ("y", "RY"), ("x", "RX")),
    "JointModelTranslation": (("x", "PX"), ("y", "PY"), ("z", "PZ")),
    "JointModelPlanar": (("x", "PX"), ("y", "PY"), ("angle", "RZ")),
    "JointModelFreeFlyer": (
        ("x", "PX"),
        ("y", "PY"),
        ("z", "PZ"),
        ("rx", "RX"),
        ("ry", "RY"),
        ("rz", "RZ"),
    ),
}
PLAIN = {
    "JointModelRX": "revolute",
    "JointModelRY": "revolute",
    "JointModelRZ": "revolute",
    "JointModelRevoluteUnaligned": "revolute",
    "JointModelPX": "prismatic",
    "JointModelPY": "prismatic",
    "JointModelPZ": "prismatic",
    "JointModelPrismaticUnaligned": "prismatic",
    "JointModelHX": "helical",
    "JointModelHY": "helical",
    "JointModelHZ": "helical",
    "JointModelHelicalUnaligned": "helical",
}
_UNBOUNDED = {"JointModelRUBX": "RX", "JointModelRUBY": "RY", "JointModelRUBZ": "RZ"}


def _axis(joint: Any) -> Array:
    """Axis of an unbounded revolute joint, which has no attribute for it: turn it by 90 deg."""
    model = pin.Model()
    model.addJoint(0, joint, pin.SE3.Identity(), "joint")
    data = pin.Data(model)
    pin.forwardKinematics(model, data, np.array([0.0, 1.0]))
    axis: Array = se3.unskew(data.oMi[1].rotation)
    return axis / np.linalg.norm(axis)


def primitive(kind: str) -> Any:
    """Pinocchio's joint about or along an axis: "RX" ... "PZ"."""
    return getattr(pin, f"JointModel{kind}")()


def expansion(joint: Any, name: str) -> list[tuple[str, str, Any, Array]]:
    """One-coordinate joints (name, type, model, placement) that together make `joint`.

    Raises
    ------
    InputError
        For a joint type that cannot be expanded.
    """
    short = joint.shortname()
    if short in PLAIN:
        return [(name, PLAIN[short], joint, np.eye(4))]
    if short in _UNBOUNDED:
        return [(name, "revolute", primitive(_UNBOUNDED[short]), np.eye(4))]
    if short == "JointModelRevoluteUnboundedUnaligned":
        return [(name, "revolute", pin.JointModelRevoluteUnaligned(_axis(joint)), np.eye(4))]
    if short in _EXPANSIONS:
        return [
            (
                f"{name}.{suffix}",
                "revolute" if kind.startswith("R") else "prismatic",
                primitive(kind),
                np.eye(4),
            )
            for suffix, kind in _EXPANSIONS[short]
        ]
    if short == "JointModelUniversal":
        concrete = joint.extract()
        return [
            (f"{name}.{i}", "revolute", pin.JointModelRevoluteUnaligned(np.array(axis)), np.eye(4))
            for i, axis in enumerate((concrete.axis1, concrete.axis2), start=1)
        ]
    if short == "JointModelComposite":
        concrete = joint.extract()
        parts: list[tuple[str, str, Any, Array]] = []
        for i, (part, at) in enumerate(zip(concrete.joints, concrete.jointPlacements, strict=True)):
            for j, (sub_name, kind, sub, T) in enumerate(expansion(part, f"{name}.{i + 1}")):
                parts.append((sub_name, kind, sub, at.homogeneous @ T if j == 0 else T))
        return parts
    raise InputError(
        f"joint {name!r} has a type that is not supported",
        expected="revolute, continuous, prismatic, helical, universal, spherical, planar, "
        "translation, free or a composite of these",
        got=short,
    )


def standing(model: pin.Model, i: int, q: Array) -> Any:
    """Pose ``T_parent_i`` of a joint at a configuration, as Pinocchio's SE3."""
    joint = model.joints[i]
    data = joint.createData()
    joint.calc(data, q)
    return model.jointPlacements[i] * data.M


def planar(name: str, axis: Array) -> list[tuple[str, str, Any, Array]]:
    """A planar joint across an axis: its x and y are those of the least turn of z to the axis."""
    z = np.array([0.0, 0.0, 1.0])
    R = pin.Quaternion.FromTwoVectors(z, axis).toRotationMatrix()
    slides = [pin.JointModelPrismaticUnaligned(R[:, i]) for i in range(2)]
    return [
        (f"{name}.x", "prismatic", slides[0], np.eye(4)),
        (f"{name}.y", "prismatic", slides[1], np.eye(4)),
        (f"{name}.angle", "revolute", pin.JointModelRevoluteUnaligned(R[:, 2]), np.eye(4)),
    ]


def set_position(model: pin.Model, index: int, value: float, q: Array) -> None:
    """Put a joint with one coordinate at a position (rad, m) in a configuration."""
    joint = model.joints[index]
    if joint.nv != 1:
        raise InputError(
            f"joint {model.names[index]!r} cannot be locked at one number",
            expected="a joint with one coordinate",
            got=joint.shortname(),
        )
    if joint.nq == 2:
        q[joint.idx_q : joint.idx_q + 2] = np.cos(value), np.sin(value)
    else:
        q[joint.idx_q] = value


def limits_of_joint(model: pin.Model, index: int) -> tuple[float, float]:
    """Limits of a joint; infinite where it has none or more than one number."""
    joint = model.joints[index]
    if joint.nq != 1:
        return -np.inf, np.inf
    lower = float(model.lowerPositionLimit[joint.idx_q])
    upper = float(model.upperPositionLimit[joint.idx_q])
    # Pinocchio writes the largest float where there is no limit.
    return (
        lower if lower > -1e300 else -np.inf,
        upper if upper < 1e300 else np.inf,
    )
