r"""Compliant axes: where a force moves the body along itself, a moment turns it about itself.

* *wrench-compliant axes*: a pure translation answered by a force parallel to it (and a moment);
* *twist-compliant axes*: a pure moment answered by a rotation parallel to it (and a translation).

There are three of each [PattersonLipkin]_; their stiffnesses and pitches are the same in every
frame, and together they are a congruence decomposition of K. Where principal values are equal, axes
are arbitrary within their eigenspace.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from cartstiff import numerics
from cartstiff.analysis.matrices import (
    ROTATION,
    TRANSLATION,
    as_symmetric,
    balancing_length,
    eliminate,
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


def wrench_compliant_axes(stiffness: ArrayLike) -> tuple[CompliantAxis, ...]:
    r"""Three wrenches that answer pure translations by a parallel force, [PattersonLipkin]_.

    ``K_tt e = k e`` and w = (K_rt e / k, e). Where k is zero no force answers: the axis has
    stiffness zero and, unless a moment answers, neither point nor pitch (NaN).
    """
    K = as_symmetric(stiffness)
    length = balancing_length(K)
    values, axes = np.linalg.eigh(K[TRANSLATION, TRANSLATION])
    largest = float(np.abs(values).max())
    result = []
    for k, e in zip(values, axes.T, strict=True):
        e = e if e[np.argmax(np.abs(e))] > 0 else -e
        moment = K[ROTATION, TRANSLATION] @ e
        if abs(k) > numerics.ZERO * largest:
            w = np.concatenate([moment / k, e])
            result.append(CompliantAxis("wrench", float(k), screw_of_wrench(w, length), w))
        else:
            nowhere = Screw(e, np.full(3, np.nan), float("nan"))
            w = np.concatenate([np.full(3, np.nan), e])
            result.append(CompliantAxis("wrench", float(k), nowhere, w))
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
        Code ``"singular"`` where K_tt is singular: the translation is then not determined.
    """
    K = as_symmetric(stiffness)
    if compliance is not None:
        return _from_compliance(as_symmetric(compliance, "compliance"), balancing_length(K))
    D = K[TRANSLATION, TRANSLATION]
    translations = np.linalg.eigvalsh(D)
    if not np.abs(translations).min() > numerics.ZERO * np.abs(translations).max():
        raise UndefinedError(
            "twist-compliant axes do not exist: the translational stiffness is singular",
            code="singular",
            values={"principal_values": translations.tolist()},
        )
    length = balancing_length(K)
    free = eliminate(K, [0, 1, 2])
    values, axes = np.linalg.eigh(0.5 * (free + free.T))
    result = []
    for k, g in zip(values, axes.T, strict=True):
        g = g if g[np.argmax(np.abs(g))] > 0 else -g
        t = np.concatenate([g, -np.linalg.solve(D, K[TRANSLATION, ROTATION] @ g)])
        result.append(CompliantAxis("twist", float(k), screw_of_twist(t, length), t))
    return tuple(result)


def _from_compliance(C: Array, length: float) -> tuple[CompliantAxis, ...]:
    values, axes = np.linalg.eigh(C[ROTATION, ROTATION])
    with np.errstate(divide="ignore"):
        pairs = sorted(zip(1.0 / values, axes.T, strict=True), key=lambda pair: pair[0])
    result = []
    for k, g in pairs:
        g = g if g[np.argmax(np.abs(g))] > 0 else -g
        t = k * (C[:, ROTATION] @ g)
        t[ROTATION] = g
        result.append(CompliantAxis("twist", float(k), screw_of_twist(t, length), t))
    return tuple(result)
