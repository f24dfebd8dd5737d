r"""Characteristic lengths and metrics, which make radians and metres comparable;
their modes.

A number that mixes rotation and translation (a condition number, an eigenvalue of K)
depends on the length by which angles are multiplied. It is one of three, and the result
names it: given by the user, the natural length of the elasticity, or the radius of
gyration of a body.

More generally, with a metric M on twists (6x6, positive definite) ``K v = lambda M v`` is
the same in every frame, provided the metric moves along.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from math import prod
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from cartstiff.answer.analysis.ellipsoids import Freedom, MatrixPair, Others
from cartstiff.answer.analysis.matrices import (
    Definiteness,
    as_symmetric,
    definiteness,
    lost_digits,
    symmetric_pair,
)
from cartstiff.core import numerics
from cartstiff.core.arrays import (
    Array,
    Result,
    checked_length,
    checked_matrix,
    checked_number,
    checked_vector,
)
from cartstiff.core.choices import LARGEST_INPUT
from cartstiff.core.errors import InputError, UndefinedError
from cartstiff.core.geometry import se3

_BLOCKS: tuple[tuple[str, Freedom, Others], ...] = (
    ("translational", "translation", "held"),
    ("free_rotational", "rotation", "free"),
)
#: Reason for a natural length.
NATURAL = "natural: there rotation and translation are equally stiff on average"


@dataclass(frozen=True)
class CharacteristicLength:
    """A length and its origin.

    Attributes
    ----------
    value : float
        In the units of the matrix.
    origin : str
        "given", "natural", "inertia", or "unit": one unit of length, when nothing was
        given and the elasticity has no natural length.
    reason : str
        One line for people.
    """

    value: float
    origin: Literal["given", "natural", "inertia", "unit"]
    reason: str


def natural_length(stiffness: ArrayLike, compliance: ArrayLike | None = None) -> float:
    r"""Length at which rotation and translation are equally stiff,
    from the stiffness alone.

    ``(det S / det K_tt)^(1/6)`` with ``S = K_rr - K_rt K_tt^-1 K_tr`` the rotational
    stiffness with free translations. Both determinants are the same at every point and in
    any axes, so the length does not depend on the frame. It is the ratio of the geometric
    means of the rotational and translational principal stiffnesses of
    [PattersonLipkin]_'s decomposition, under a square root.

    Parameters
    ----------
    stiffness : array_like, shape (6, 6)
        Symmetric.
    compliance : array_like, shape (6, 6), optional
        Its inverse, if it is known better than by inversion.

    Raises
    ------
    UndefinedError
        Code ``"no-natural-length"`` unless both blocks are positive definite.
    """
    return _natural_length(MatrixPair(*symmetric_pair(stiffness, compliance)))


def _natural_length(pair: MatrixPair) -> float:
    """`natural_length` of matrices known to be symmetric."""
    found: dict[str, list[float]] = {}
    with suppress(UndefinedError):
        for name, freedom, others in _BLOCKS:
            read = pair.principal(freedom, others)
            if read is None:
                break
            found[name] = read[0]
            if not found[name][0] > 0.0:
                break
    values = list(found.values())
    if len(values) < 2 or not values[1][0] > 0.0:
        raise UndefinedError(
            "the elasticity has no natural length: its translational and free rotational "
            "stiffness are not both positive definite",
            code="no-natural-length",
            values={name: found.get(name) for name, *_ in _BLOCKS},
        )
    moving, turning = values
    return prod(b / a for a, b in zip(moving, turning, strict=True)) ** (1.0 / 6.0)


def _body(mass: float, inertia: ArrayLike) -> tuple[float, Array]:
    """Mass and inertia about the mass centre.

    InputError unless both are positive definite.
    """
    m = checked_number(mass, "mass")
    if not 0 < m <= LARGEST_INPUT:
        raise InputError("mass cannot be used", expected="a positive number", got=m)
    I_c = checked_matrix(inertia, "inertia", 3)
    if numerics.asymmetry(I_c):
        raise InputError("inertia is not symmetric", got=I_c.tolist())
    if np.linalg.eigvalsh(I_c)[0] <= 0:
        raise InputError("inertia is not positive definite", got=I_c.tolist())
    return m, I_c


def length_from_inertia(mass: float, inertia: ArrayLike) -> float:
    r"""Radius of gyration ``sqrt(tr I / (3 m))`` of a body, I about its mass centre.

    Raises
    ------
    InputError
        If the mass is not positive or the inertia is not symmetric positive definite.
    """
    m, I_c = _body(mass, inertia)
    return float(np.sqrt(np.trace(I_c) / (3.0 * m)))


def characteristic_length(
    stiffness: ArrayLike | None = None,
    compliance: ArrayLike | None = None,
    *,
    given: float | None = None,
    mass: float | None = None,
    inertia: ArrayLike | None = None,
) -> CharacteristicLength:
    """Length to use: the given one, else from the inertia, else natural, else one unit,
    and why.
    """
    if given is not None:
        return CharacteristicLength(checked_length(given), "given", "given by the user")
    if (mass is None) != (inertia is None):
        raise InputError("mass and inertia go together", got="only one of them")
    if mass is not None and inertia is not None:
        value = length_from_inertia(mass, inertia)
        return CharacteristicLength(value, "inertia", "radius of gyration of the body")
    if stiffness is None:
        return length_of_pair(MatrixPair(None, None))
    return length_of_pair(MatrixPair(*symmetric_pair(stiffness, compliance)))


def length_of_pair(pair: MatrixPair) -> CharacteristicLength:
    """The natural length of a `StiffnessInFrame.pair`, else one unit, and why."""
    if pair.K is None:
        return CharacteristicLength(
            1.0, "unit", "one unit of length: there is no stiffness matrix"
        )
    try:
        value = _natural_length(pair)
    except UndefinedError:
        return NOT_NATURAL
    return CharacteristicLength(value, "natural", NATURAL)


#: The length if the stiffness is not positive definite.
NOT_NATURAL = CharacteristicLength(
    1.0,
    "unit",
    "one unit of length: none is natural, as the stiffness is not positive definite",
)


@dataclass(frozen=True, eq=False)
class MetricModes(Result):
    """Solutions of ``K v = lambda M v``.

    Attributes
    ----------
    metric : str
        Name of the metric.
    eigenvalues : ndarray, shape (6,)
        Smallest first: force per length for `length_metric`, squared angular frequencies
        (1/s^2) for `inertia_metric`.
    frequencies : ndarray, shape (6,), or None
        In Hz for `inertia_metric`, NaN where the eigenvalue is negative: that motion is
        unstable.
    twists : ndarray, shape (6, 6)
        Columns v with ``v_i^T M v_j = 1`` if i = j and 0 otherwise; largest component
        positive.
    definiteness : str
        Definiteness of K; the same for every metric.
    """

    metric: str
    eigenvalues: Array
    frequencies: Array | None
    twists: Array
    definiteness: Definiteness


def length_metric(length: float) -> Array:
    """Metric ``length^2 |omega|^2 + |v|^2`` at the frame's origin, (6, 6)."""
    return np.diag(np.repeat([checked_length(length) ** 2, 1.0], 3))


def inertia_metric(
    mass: float, inertia: ArrayLike, centre: ArrayLike = (0.0, 0.0, 0.0)
) -> Array:
    r"""Kinetic-energy metric of a rigid body, (6, 6).

    ``[[ I_c - m [c]x^2, m [c]x ], [ -m [c]x, m 1 ]]``, c the mass centre and I_c the
    inertia about it, both in the frame of the stiffness.

    Raises
    ------
    InputError
        If the mass is not positive or the inertia not symmetric positive definite.
    """
    m, I_c = _body(mass, inertia)
    c = se3.skew(checked_vector(centre, 3, "mass centre"))
    return np.block([[I_c - m * c @ c, m * c], [-m * c, m * np.eye(3)]])


def modes(
    stiffness: ArrayLike,
    metric: ArrayLike,
    name: str = "user",
    compliance: ArrayLike | None = None,
) -> MetricModes:
    r"""Eigenvalues and twists of K with respect to a metric, by Cholesky reduction.

    Parameters
    ----------
    stiffness, metric : array_like, shape (6, 6)
        Symmetric, in the same frame; the metric positive definite.
    name : str
        Name in the result; with "inertia" the result has frequencies.
    compliance : array_like, shape (6, 6), optional
        The inverse, for values that the stiffness does not resolve.

    Raises
    ------
    InputError
        If the metric is not positive definite.
    UndefinedError
        Code ``"ill-conditioned"`` where neither stiffness nor compliance resolves a
        value.
    """
    K, M = as_symmetric(stiffness), as_symmetric(metric, "metric")
    try:
        L = np.linalg.cholesky(M)
    except np.linalg.LinAlgError:
        raise InputError(
            "metric is not positive definite",
            got=f"smallest eigenvalue {np.linalg.eigvalsh(M)[0]:.3g}",
        ) from None
    half = np.linalg.solve(L, K)
    reduced = np.linalg.solve(L, half.T)
    inverse = (
        None if compliance is None else L.T @ as_symmetric(compliance, "compliance") @ L
    )
    values, y = numerics.eigenpairs(reduced, inverse)
    if np.isnan(values).any():
        raise lost_digits(values, "the stiffness matrix")
    twists = np.linalg.solve(L.T, y)
    largest = np.argmax(np.abs(twists), axis=0)
    twists *= np.sign(twists[largest, np.arange(6)])
    frequencies = None
    if name == "inertia":
        with np.errstate(invalid="ignore"):
            frequencies = np.sqrt(values) / (2.0 * np.pi)
    return MetricModes(name, values, frequencies, twists, definiteness(values, zero=0.0))
