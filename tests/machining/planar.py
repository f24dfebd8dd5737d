"""A planar arm of three revolute joints, with its kinematics and compliance written out by hand."""

import numpy as np
import pinocchio as pin
from tests.doors import Chain, plain_tree
from tests.support import translation

from cartstiff import ElasticMechanism, JointSprings
from cartstiff.geometry import se3

LENGTHS = np.array([0.5, 0.4, 0.2])
STIFFNESS = np.array([900.0, 700.0, 300.0])


def arm(limits=np.pi, lengths=LENGTHS):
    """The arm in the plane z = 0; limits are +- these."""
    model = pin.Model()
    model.name = "planar"
    bound = np.broadcast_to(limits, (3,))
    parent, at = 0, 0.0
    for i, length in enumerate(lengths):
        placement = pin.SE3(translation(at, 0.0, 0.0))
        parent = model.addJoint(
            parent,
            pin.JointModelRZ(),
            placement,
            f"j{i + 1}",
            np.array([1e3]),
            np.array([1e3]),
            np.array([-bound[i]]),
            np.array([bound[i]]),
        )
        model.appendBodyToJoint(parent, pin.Inertia.Random(), pin.SE3.Identity())
        at = length
    tip = pin.SE3(translation(lengths[-1], 0.0, 0.0))
    model.addFrame(pin.Frame("tip", parent, 0, tip, pin.FrameType.OP_FRAME))
    chain = Chain(plain_tree(model), "tip")
    springs = JointSprings(STIFFNESS, np.full(3, np.nan))
    return ElasticMechanism("planar", chain, np.array([0.3, 0.8, -0.4]), springs)


def positions(q):
    """Places (..., 4, 2) of the joints and of the tip."""
    heading = np.cumsum(q, axis=-1)
    links = LENGTHS[:, None] * np.stack([np.cos(heading), np.sin(heading)], axis=-1)
    zero = np.zeros((*q.shape[:-1], 1, 2))
    return np.concatenate([zero, np.cumsum(links, axis=-2)], axis=-2)


def inverse(x, y, yaw):
    """Both postures (..., 2, 3) at a pose, NaN where out of reach; angles in [-pi, pi]."""
    yaw = np.asarray(yaw, float)
    a, b, c = LENGTHS
    wx, wy = x - c * np.cos(yaw), y - c * np.sin(yaw)
    cosine = (wx**2 + wy**2 - a**2 - b**2) / (2 * a * b)
    with np.errstate(invalid="ignore"):
        elbow = np.arccos(np.where(np.abs(cosine) <= 1, cosine, np.nan))
    found = []
    for q2 in (elbow, -elbow):
        q1 = np.arctan2(wy, wx) - np.arctan2(b * np.sin(q2), a + b * np.cos(q2))
        found.append(np.stack([q1, q2, yaw - q1 - q2], axis=-1))
    q = np.stack(found, axis=-2)
    return q - 2 * np.pi * np.round(q / (2 * np.pi))


def jacobian(q):
    """Rows yaw, x, y in the axes of F: (..., 3, 3)."""
    p = positions(q)
    arm_of = p[..., 3:, :] - p[..., :3, :]
    return np.stack([np.ones(q.shape), -arm_of[..., 1], arm_of[..., 0]], axis=-2)


def deflection(q, force):
    """Displacement of the tip (...,) under a small force (2,) in the plane, in F."""
    J = jacobian(q)[..., 1:, :]
    moved = np.einsum("...ij,j,...kj,...k->...i", J, 1 / STIFFNESS, J, np.asarray(force, float))
    return np.linalg.norm(moved, axis=-1)


def ratio(q, length):
    """Smallest over largest singular value, lengths in units of `length`."""
    values = np.linalg.svd(jacobian(q) / np.array([1.0, length, length])[:, None], compute_uv=False)
    return values[..., 2] / values[..., 0]


def poses(points, yaw=0.0):
    """Poses (m, 4, 4) at points (m, 2) of the plane."""
    xyz = np.column_stack([points, np.zeros(len(points))])
    angles = np.zeros((len(points), 3))
    angles[:, 2] = yaw
    return se3.from_roll_pitch_yaw(xyz, angles)
