r"""Linear deflection under an added wrench: of the body, of any of its points,
joint by joint.

    dq = H_W^-1 J^T dW,     twist = J dq = C dW,     C = J H_W^-1 J^T

The joints' shares ``J_a dq_a`` add up to the twist exactly. The deflection is that of
small loads: K, J and H_W are those of the posture.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from cartstiff.core import numerics
from cartstiff.core.arrays import (
    Array,
    Result,
    checked_array,
    checked_matrix,
    checked_vector,
)
from cartstiff.core.errors import UndefinedError
from cartstiff.core.geometry import se3


def displacement_of_point(twist: ArrayLike, point: ArrayLike) -> Array:
    """Small displacement (3,) of a body point: ``v + omega x p``."""
    t, p = checked_vector(twist, 6, "twist"), checked_vector(point, 3, "point")
    return np.asarray(t[3:] + se3.cross(t[:3], p))


@dataclass(frozen=True, eq=False)
class Deflection(Result):
    """Deflection of a body under an added wrench.

    Attributes
    ----------
    wrench : ndarray, shape (6,)
        The added wrench dW.
    twist : ndarray, shape (6,)
        Small motion (rotation, translation) of the body frame, body components.
    point : ndarray, shape (3,)
        A point of the body.
    displacement : ndarray, shape (3,)
        Displacement of that point, in the axes of the body frame.
    energy : float
        Work of the growing load, ``1/2 dW . twist``.
    """

    wrench: Array
    twist: Array
    point: Array
    displacement: Array
    energy: float


def compliance_deflection(
    compliance: ArrayLike, wrench: ArrayLike, point: ArrayLike = (0.0, 0.0, 0.0)
) -> Deflection:
    """Deflection ``C dW``; exists at singular postures and for fewer than
    six joints too.
    """
    C = checked_matrix(compliance, "compliance")
    W, p = checked_vector(wrench, 6, "wrench"), checked_vector(point, 3, "point")
    for own in (W, p):  # new arrays need no copy
        own.flags.writeable = False
    return deflection_of(C, W, p)


def deflection_of(C: Array, W: Array, p: Array) -> Deflection:
    """`compliance_deflection` of checked arrays."""
    twist = C.dot(W)
    moved = twist[3:] + se3.cross(twist[:3].tolist(), p.tolist())
    for own in (twist, moved):  # new arrays need no copy
        own.flags.writeable = False
    return Deflection(W, twist, p, moved, 0.5 * float(W.dot(twist)))


@dataclass(frozen=True, eq=False)
class JointShares(Result):
    """Each joint's part in a deflection.

    Attributes
    ----------
    deflection : Deflection
        Deflection of the whole.
    motion : ndarray, shape (n,)
        Joint deflections dq (radians, or lengths for prismatic joints).
    twists : ndarray, shape (6, n)
        Columns J_a dq_a; their sum is the deflection's twist.
    displacements : ndarray, shape (3, n)
        Displacements of the point, due to each joint.
    share : ndarray, shape (n,)
        Each displacement's component along the total one, over its length; they add up to
        1 and may be negative. NaN if the point does not move.
    energy : ndarray, shape (n,)
        ``1/2 dq_a (J^T dW)_a``; adds up to the deflection's energy.
    """

    deflection: Deflection
    motion: Array
    twists: Array
    displacements: Array
    share: Array
    energy: Array


def joint_shares(
    jacobian: ArrayLike,
    hessian: ArrayLike,
    wrench: ArrayLike,
    point: ArrayLike = (0.0, 0.0, 0.0),
) -> JointShares:
    r"""Deflection joint by joint.

    Parameters
    ----------
    jacobian : array_like, shape (6, n)
        Body Jacobian.
    hessian : array_like, shape (n, n)
        H_W: joint stiffness less the load term, see
        `cartstiff.answer.analysis.congruence`; without a load the joint stiffness itself.
    wrench : array_like, shape (6,)
        Added wrench dW, body frame.
    point : array_like, shape (3,)
        Body point.

    Raises
    ------
    UndefinedError
        Code ``"singular"`` if H_W has no inverse: a motion of the joints has no
        stiffness.
    """
    J = checked_array(jacobian, (6, "n"), "Jacobian", copy=False)
    n = J.shape[1]
    H = checked_matrix(hessian, "joint stiffness less load term", n)
    W, p = checked_vector(wrench, 6, "wrench"), checked_vector(point, 3, "point")
    # Joints may mix radians and lengths: rank is judged on a unit diagonal.
    scale = np.sqrt(np.abs(np.diag(H)))
    scale[scale == 0.0] = 1.0
    values = np.linalg.svd(H / np.outer(scale, scale), compute_uv=False)
    if not values[-1] > numerics.ZERO_SHARE * values[0]:
        raise UndefinedError(
            "joint stiffness less its load term is singular: a motion of the joints is "
            "free",
            code="singular",
            values={"singular_values": values.tolist()},
        )
    torque = J.T @ W
    motion = np.linalg.solve(H / np.outer(scale, scale), torque / scale) / scale
    twists = J * motion
    twist = twists.sum(axis=1)
    displacements = twists[3:] + np.cross(twists[:3].T, p).T
    total = displacements.sum(axis=1)
    size = float(total @ total)
    share = total @ displacements / size if size > 0 else np.full(n, np.nan)
    deflection = Deflection(W, twist, p, total, 0.5 * float(W @ twist))
    return JointShares(
        deflection, motion, twists, displacements, share, 0.5 * motion * torque
    )
