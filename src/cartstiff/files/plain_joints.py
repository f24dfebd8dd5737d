"""Joints with one coordinate in place of Pinocchio's others."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin

from cartstiff.core.arrays import Array
from cartstiff.core.errors import InputError
from cartstiff.core.geometry import se3
from cartstiff.core.mechanisms.contract import Coordinate

# Successive one-coordinate joints that replace joints with several coordinates, in the
# order of Pinocchio's own configuration, translations before rotations.
_EXPANSIONS: dict[str, tuple[tuple[str, str], ...]] = {
    "JointModelRUBX": (("", "RX"),),
    "JointModelRUBY": (("", "RY"),),
    "JointModelRUBZ": (("", "RZ"),),
    "JointModelSpherical": ((".x", "RX"), (".y", "RY"), (".z", "RZ")),
    "JointModelSphericalZYX": ((".z", "RZ"), (".y", "RY"), (".x", "RX")),
    "JointModelTranslation": ((".x", "PX"), (".y", "PY"), (".z", "PZ")),
    "JointModelPlanar": ((".x", "PX"), (".y", "PY"), (".angle", "RZ")),
    "JointModelFreeFlyer": (
        (".x", "PX"),
        (".y", "PY"),
        (".z", "PZ"),
        (".rx", "RX"),
        (".ry", "RY"),
        (".rz", "RZ"),
    ),
}
PLAIN = {
    f"JointModel{name}": kind
    for kind, names in (
        ("revolute", "RX RY RZ RevoluteUnaligned"),
        ("prismatic", "PX PY PZ PrismaticUnaligned"),
        ("helical", "HX HY HZ HelicalUnaligned"),
    )
    for name in names.split()
}


def _axis(joint: Any) -> Array:
    """Axis of an unbounded revolute joint, which has no attribute for it,
    by a turn of 90 deg.
    """
    model = pin.Model()
    model.addJoint(0, joint, pin.SE3.Identity(), "joint")
    data = pin.Data(model)
    pin.forwardKinematics(model, data, np.array([0.0, 1.0]))
    axis: Array = se3.unskew(data.oMi[1].rotation)
    return axis / np.linalg.norm(axis)


def primitive(kind: str) -> Any:
    """Return Pinocchio's joint about or along an axis: "RX" ... "PZ"."""
    return getattr(pin, f"JointModel{kind}")()


def axis_coordinate(name: str, kind: str) -> Coordinate:
    """Return the coordinate of the joint `primitive` of a kind."""
    return Coordinate(name, PLAIN[f"JointModel{kind}"])  # type: ignore[arg-type]


def expansion(
    joint: Any, name: str, normal: Array | None = None
) -> list[tuple[str, str, Any, Array]]:
    """The one-coordinate joints (name, type, model, placement) that replace `joint`.

    A planar joint may have a `normal` (3,) other than z.

    Raises
    ------
    InputError
        For a joint type that cannot be expanded.
    """
    if normal is not None:
        return _planar(name, normal)
    short = joint.shortname()
    # Joints with one coordinate, and chains of them in place of the others.
    if short in PLAIN:
        parts = [("", PLAIN[short], joint)]
    elif short in _EXPANSIONS:
        each = _EXPANSIONS[short]
        parts = [(s, PLAIN[f"JointModel{kind}"], primitive(kind)) for s, kind in each]
    elif short == "JointModelRevoluteUnboundedUnaligned":
        parts = [_turn("", _axis(joint))]
    elif short == "JointModelUniversal":
        concrete = joint.extract()
        parts = [_turn(".1", concrete.axis1), _turn(".2", concrete.axis2)]
    elif short == "JointModelComposite":  # is expanded part by part
        concrete, every = joint.extract(), []
        pairs = zip(concrete.joints, concrete.jointPlacements, strict=True)
        for i, (part, at) in enumerate(pairs, start=1):
            first, *others = expansion(part, f"{name}.{i}")
            every += [(*first[:3], at.homogeneous @ first[3]), *others]
        return every
    else:
        raise InputError(
            f"joint {name!r} has a type that is not supported",
            expected="revolute, continuous, prismatic, helical, universal, spherical, "
            "planar, translation, free or a composite of these",
            got=short,
        )
    return [(name + suffix, kind, part, np.eye(4)) for suffix, kind, part in parts]


def _turn(suffix: str, axis: Array) -> tuple[str, str, Any]:
    """Suffix of the name, type and model of a joint that turns about an axis."""
    return suffix, "revolute", pin.JointModelRevoluteUnaligned(np.array(axis))


def standing(model: pin.Model, i: int, q: Array) -> Any:
    """The pose ``T_parent_i`` of a joint at a configuration, as Pinocchio's SE3."""
    joint = model.joints[i]
    data = joint.createData()
    joint.calc(data, q)
    return model.jointPlacements[i] * data.M


def _planar(name: str, axis: Array) -> list[tuple[str, str, Any, Array]]:
    """Return a planar joint across an axis.

    The least turn of z to the axis gives its x and y.
    """
    z = np.array([0.0, 0.0, 1.0])
    R = pin.Quaternion.FromTwoVectors(z, axis).toRotationMatrix()
    slides = [pin.JointModelPrismaticUnaligned(R[:, i]) for i in range(2)]
    return [
        (f"{name}.x", "prismatic", slides[0], np.eye(4)),
        (f"{name}.y", "prismatic", slides[1], np.eye(4)),
        (*_turn(f"{name}.angle", R[:, 2]), np.eye(4)),
    ]


def set_position(model: pin.Model, index: int, value: float, q: Array) -> None:
    """Set the position (rad, m) of a joint with one coordinate in a configuration."""
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
    """Return the limits of a joint; infinite without limits and with several numbers."""
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
