r"""Compliant axes: where a force moves the body along itself, a moment turns it about itself.

* *wrench-compliant axes*: a pure translation answered by a force parallel to it (and a moment);
* *twist-compliant axes*: a pure moment answered by a rotation parallel to it (and a translation).

There are three of each [PattersonLipkin]_; their stiffnesses and pitches are the same in every
frame, and together they are a congruence decomposition of K. Where principal values are equal, axes
are arbitrary within their eigenspace.

The stiffnesses are the principal values of the two ellipsoids of stiffness (translation with held
rotations, rotation with free translations), and are read from K and C = K^-1 together as those are.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from cartstiff import numerics
from cartstiff.analysis.ellipsoids import stiffness_ellipsoid
from cartstiff.analysis.matrices import (
    ROTATION,
    TRANSLATION,
    as_symmetric,
    balancing_length,
)
from cartstiff.analysis.screws import Screw, screw_of_twist, screw_of_wrench
from cartstiff.arrays import Result
from cartstiff.errors import UndefinedError
from cartstiff.geometry.se3 import Array


@dataclass(frozen=True, eq=False)
class CompliantAxis(Result):
    """A wrench-compliant or twist-compliant axis.

    Attributes
    ----------
    kind : {"wrench", "twist"}
        Which of the two.
    stiffness : float
        Force per translation along the axis (held rotations), or moment per rotation about it
        (free translations).
    screw : Screw
        Screw of the wrench that answers a unit translation, or of the twist that a moment causes.
    components : ndarray, shape (6,)
        That wrench per unit of force, or that twist per unit of rotation.
    """

    kind: Literal["wrench", "twist"]
    stiffness: float
    screw: Screw
    components: Array


def coupling_matrix(stiffness: Array | None, compliance: Array | None) -> Array | None:
    r"""``G = K_rt K_tt^-1 = -C_rr^-1 C_rt`` (3, 3), by the block that is better conditioned.

    A body that translates by v is answered by a force f and the moment ``G f``; a moment that turns
    it by w moves it by ``-G^T w``. None where neither K_tt nor C_rr has an inverse.

    Parameters
    ----------
    stiffness, compliance : ndarray, shape (6, 6), or None
        Symmetric, each the other's inverse; one of them is enough.

    Raises
    ------
    UndefinedError
        Code ``"ill-conditioned"`` where rounding leaves fewer than four digits.
    """
    found: list[tuple[float, Array]] = []
    for matrix, own, other in (
        (stiffness, TRANSLATION, ROTATION),
        (compliance, ROTATION, TRANSLATION),
    ):
        inverse = None if matrix is None else numerics.invert(matrix[own, own])
        if matrix is not None and inverse is not None:
            product = matrix[other, own] @ inverse.matrix
            found.append((inverse.error, product if own is TRANSLATION else -product.T))
    if not found:
        return None
    error, G = min(found, key=lambda each: each[0])
    if error > numerics.LOST_ERROR:
        raise UndefinedError(
            "how turning and moving are coupled is lost in the rounding of the stiffest directions",
            code="ill-conditioned",
            values={"relative_error": error},
        )
    return G


def _given_pair(K: ArrayLike, C: ArrayLike | None) -> tuple[Array, Array | None]:
    return as_symmetric(K), None if C is None else as_symmetric(C, "compliance")


def wrench_compliant_axes(
    stiffness: ArrayLike, compliance: ArrayLike | None = None
) -> tuple[CompliantAxis, ...]:
    r"""Three wrenches that answer pure translations by a parallel force, [PattersonLipkin]_.

    ``K_tt e = k e`` and w = (K_rt e / k, e). Where k is zero no force answers: the axis has
    stiffness zero and, unless a moment answers, neither point nor pitch (NaN). The compliance,
    the inverse where it is known, gives what the stiffness has no digits for.

    Raises
    ------
    UndefinedError
        Code ``"ill-conditioned"`` where neither knows a stiffness or an axis.
    """
    K, C = _given_pair(stiffness, compliance)
    length = balancing_length(K)
    shape = stiffness_ellipsoid(K, "translation", "held", None, C)
    G = coupling_matrix(K, C)
    result = []
    for k, e in zip(shape.eigenvalues.tolist(), shape.axes.T, strict=True):
        e = e if e[np.argmax(np.abs(e))] > 0 else -e
        w = np.concatenate([np.full(3, np.nan), e])
        screw = Screw(e, np.full(3, np.nan), float("nan"))
        if k != 0.0:
            w[:3] = K[ROTATION, TRANSLATION] @ e / k if G is None else G @ e
            screw = screw_of_wrench(w, length)
        result.append(CompliantAxis("wrench", k, screw, w))
    return tuple(result)


def twist_compliant_axes(
    stiffness: ArrayLike, compliance: ArrayLike | None = None
) -> tuple[CompliantAxis, ...]:
    r"""Three twists with a rotation parallel to the pure moment that causes them.

    ``S g = k g`` with S = K_rr - K_rt K_tt^-1 K_tr, and t = (g, -K_tt^-1 K_tr g), the twist that
    needs no force [PattersonLipkin]_. With the compliance C: ``C_rr g = g / k``,
    ``t = k C (g, 0)``.

    Raises
    ------
    UndefinedError
        Code ``"singular"`` where K_tt is singular: the translation is then not determined; code
        ``"ill-conditioned"`` where neither stiffness nor compliance knows a value or an axis.
    """
    K, C = _given_pair(stiffness, compliance)
    G = coupling_matrix(K, C)
    if G is None:
        raise UndefinedError(
            "twist-compliant axes do not exist: the translational stiffness is singular",
            code="singular",
            values={"principal_values": np.linalg.eigvalsh(K[TRANSLATION, TRANSLATION]).tolist()},
        )
    length = balancing_length(K)
    shape = stiffness_ellipsoid(K, "rotation", "free", None, C)
    result = []
    for k, g in zip(shape.eigenvalues.tolist(), shape.axes.T, strict=True):
        g = g if g[np.argmax(np.abs(g))] > 0 else -g
        t = np.concatenate([g, -G.T @ g])
        result.append(CompliantAxis("twist", k, screw_of_twist(t, length), t))
    return tuple(result)
