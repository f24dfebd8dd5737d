r"""Forces in the elastic elements under a wrench on the body,
and influence of their compliances.

With M = dq/dW of the motion under a wrench, B the elements' deflections per coordinate
rate and Gamma their compliances, the forces in them are ``F W``, ``F = Gamma^-1 B M``.
The compliance of the body changes with a parameter theta, ``Gamma = ... + theta S``, by
the forces of two loads:

    dC / dtheta = F^T S F

which is the theorem of the unit load, and holds under load and in closed chains.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cartstiff.core.arrays import Array
from cartstiff.core.errors import UndefinedError
from cartstiff.core.mechanisms.elements import Elements
from cartstiff.core.stiffness.posture import PostureStiffness


class Influence(NamedTuple):
    """Linear response of a mechanism at a posture.

    Attributes
    ----------
    forces : ndarray (E, 6)
        Force in each element per unit wrench (moment, force) on the body frame M, in its
        axes.
    compliance : ndarray (6, 6)
        Twist of M per unit wrench.
    weight_forces : ndarray (E,)
        Forces in the elements under a given generalised force; zero without one.
    weight_twist : ndarray (6,)
        Twist of M under it.
    """

    forces: Array
    compliance: Array
    weight_forces: Array
    weight_twist: Array


def influence_of(
    result: PostureStiffness, elements: Elements, generalised: Array | None = None
) -> Influence:
    """Forces in all elements per unit wrench at a posture, from its reduction.

    Parameters
    ----------
    result : PostureStiffness
        From `cartstiff.analyse`; under a load the tangent is used.
    elements : Elements
        Elements of the same mechanism.
    generalised : ndarray (n,), optional
        Force on the coordinates, such as weights, for `weight_forces` and `weight_twist`.

    Raises
    ------
    UndefinedError
        In an unbalanced posture, or where a motion costs nothing.
    """
    free = result.reduction.free
    inverse_of_H = None if free is None else free.inverse(result.change_by_load)
    if inverse_of_H is None or free is None:
        states = result.reduction.states
        code = states[-1].code if states else "no-shares"
        raise UndefinedError(
            states[-1].message if states else "a motion costs nothing: no linear motion",
            code=code,
        )
    J, inverse = free.jacobian, inverse_of_H.matrix
    basis = np.eye(J.shape[1]) if free.basis is None else free.basis
    to_forces = elements.stiffness @ elements.rows(result.posture) @ basis
    per_wrench = inverse @ J.T
    count = len(elements.names)
    weight_forces, weight_twist = np.zeros(count), np.zeros(6)
    if generalised is not None:
        motion = inverse @ (basis.T @ generalised)
        weight_forces, weight_twist = to_forces @ motion, J @ motion
    return Influence(to_forces @ per_wrench, J @ per_wrench, weight_forces, weight_twist)
