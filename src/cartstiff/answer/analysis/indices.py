r"""Indices of a stiffness: one number each, with the length scale it depends on.

Angles are multiplied by a length l, so that ``K_l = D K D``, D = diag(1/l, 1/l, 1/l, 1,
1, 1), is in force per length throughout. An index that depends on l has an exponent,
which says how.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from cartstiff.answer.analysis.ellipsoids import MatrixPair
from cartstiff.answer.analysis.matrices import (
    Definiteness,
    as_symmetric,
    balancing_length,
    definiteness,
    lost_digits,
    scale_lengths,
    symmetric_pair,
    with_angles_times,
)
from cartstiff.core import numerics
from cartstiff.core.arrays import (
    Array,
    Result,
    checked_array,
    checked_length,
    real_array,
)
from cartstiff.core.errors import UndefinedError


@dataclass(frozen=True, eq=False)
class Indices(Result):
    """Indices of a symmetric stiffness at one length scale.

    Attributes
    ----------
    length : float
        The length l.
    eigenvalues : ndarray, shape (6,)
        Eigenvalues of K_l (force per length), smallest first, with their signs.
    definiteness : str
        Definiteness of K; does not depend on l.
    condition_number : float
        Largest over smallest absolute eigenvalue of K_l; infinite if K is singular.
    condition_exponent : float
        d ln(condition number) / d ln(l) at this length: 1 means that a length 1 % longer
        makes it 1 % larger. NaN if K is singular.
    isotropy : float
        Geometric over arithmetic mean of the eigenvalues: 1 for a multiple of the
        identity, 0 if singular, NaN if not positive semidefinite.
    minimum_stiffness : float
        Smallest eigenvalue of K_l, negative if there is one (force per length).
    minimum_twist : ndarray, shape (6,)
        Its twist (omega, v), of unit size ``sqrt(l^2 |omega|^2 + |v|^2)``.
    determinant : float
        det K in the original units, force^6 per angle^3. Depends neither on l nor on the
        frame.
    translational_condition, rotational_condition : float
        Condition numbers of the two diagonal blocks of K (the other held); depend on no
        length.
    """

    length: float
    eigenvalues: Array
    definiteness: Definiteness
    condition_number: float
    condition_exponent: float
    isotropy: float
    minimum_stiffness: float
    minimum_twist: Array
    determinant: float
    translational_condition: float
    rotational_condition: float


def isotropy(matrix: ArrayLike, inverse: ArrayLike | None = None) -> float:
    """Geometric over arithmetic mean of the eigenvalues of a symmetric matrix.

    Between 0 (singular) and 1 (all equal); NaN if an eigenvalue is negative, or all are
    zero. The inverse, where it is known, gives the small ones.
    """
    return float(isotropies(numerics.eigenvalues(real_array(matrix), inverse)))


def isotropies(values: Array) -> Array:
    """`isotropy` (...) from eigenvalues (..., n), smallest first."""
    least, largest = values[..., 0], values[..., -1]
    with numerics.silent():
        ratio = np.exp(np.log(values).mean(axis=-1)) / values.mean(axis=-1)
    ratio = np.where((least == 0.0) & (largest > 0.0), 0.0, ratio)
    return np.where((least >= 0.0) & (largest > 0.0), ratio, np.nan)


def indices_of(
    stiffness: ArrayLike,
    length: float,
    compliance: ArrayLike | None = None,
) -> Indices:
    r"""All indices at a length scale.

    The exponent, an own formula, follows from the eigenvectors x of K_l: an eigenvalue
    changes as ``d ln|lambda| / d ln l = -2 |x_rot|^2 / |x|^2``.

    Parameters
    ----------
    stiffness : array_like, shape (6, 6)
        Symmetric.
    length : float
        Positive; see `cartstiff.answer.analysis.metrics`.
    compliance : array_like, shape (6, 6), optional
        The inverse, if it is known better than by inversion: near a singularity the small
        eigenvalues come from there.

    Raises
    ------
    UndefinedError
        Code ``"ill-conditioned"`` where neither stiffness nor compliance resolves an
        eigenvalue.
    """
    K, C = symmetric_pair(stiffness, compliance)
    values, x, kind = spectrum(K, length, C)
    pair = MatrixPair(K, C)
    low, high = int(np.argmin(np.abs(values))), int(np.argmax(np.abs(values)))
    ratio = numerics.condition_of(values)
    shares = np.sum(x[:3] ** 2, axis=0)
    exponent = (
        2.0 * float(shares[low] - shares[high]) if np.isfinite(ratio) else float("nan")
    )
    twist = x[:, 0] * np.repeat([1.0 / length, 1.0], 3)
    twist = twist * np.sign(twist[np.argmax(np.abs(x[:, 0]))])
    return Indices(
        float(length),
        values,
        kind,
        ratio,
        exponent,
        float(isotropies(values)),
        float(values[0]),
        twist,
        float(np.prod(values) * length**6),
        pair.condition("translation"),
        pair.condition("rotation"),
    )


def spectrum(
    K: Array, length: float, C: Array | None = None
) -> tuple[Array, Array, Definiteness]:
    """Eigenvalues (6,) and eigenvectors (6, 6) of K_l, and the definiteness,
    as in `indices_of`.

    Parameters and errors are those of `indices_of`; K and C are symmetric.
    """
    scaled = with_angles_times(K, 1.0 / checked_length(length))
    inverse = None if C is None else with_angles_times(C, length)
    values, x = numerics.eigenpairs(scaled, inverse)
    if any(v != v for v in values.tolist()):
        raise lost_digits(values, "the stiffness matrix")
    return (
        values,
        x,
        _definiteness(K) if inverse is None else definiteness(values, zero=0.0),
    )


def _definiteness(K: Array) -> Definiteness:
    """Definiteness of a stiffness without inverse, whose zeros depend on the length.

    With an inverse every value has a sign, which is the same at every length.
    """
    values = numerics.eigenvalues(scale_lengths(K, balancing_length(K)))
    return definiteness(values, zero=0.0)


def condition_numbers(stiffness: ArrayLike, lengths: ArrayLike) -> Array:
    """Condition number (m,) of the stiffness K (6, 6), its angles times l, at lengths l
    (m,).

    Raises
    ------
    InputError
        If a shape is wrong or K is not symmetric.
    """
    K = as_symmetric(stiffness)
    scales = checked_array(lengths, ("m",), "list of lengths", copy=False)
    return numerics.condition(numerics.eigenvalues(with_angles_times(K, 1.0 / scales)))


class BestLength(NamedTuple):
    """Length of the least condition number, and that number."""

    best_length: float
    condition_at_best_length: float


def best_conditioned_length(
    stiffness: ArrayLike, compliance: ArrayLike | None = None
) -> BestLength:
    r"""Length at which the condition number of a stiffness (6, 6) is smallest, and that
    number.

    For positive definite K both ln(largest) and -ln(smallest eigenvalue of K_l) are
    convex in ln l: the minimum lies between the neighbours of the best in a row of
    lengths, and the next row is placed there. It depends on the origin of the frame.

    Raises
    ------
    UndefinedError
        Code ``"not-positive"`` if K is not positive definite.
    """
    K, C = symmetric_pair(stiffness, compliance)
    start = balancing_length(K)

    def at(lengths: Array) -> Array:
        inverse = None if C is None else with_angles_times(C, lengths)
        return numerics.eigenvalues(with_angles_times(K, 1.0 / lengths), inverse)

    values = at(np.array([start]))[0]
    if np.isnan(values).any():
        raise lost_digits(values, "the stiffness matrix")
    if definiteness(values, zero=0.0) != "positive":
        raise UndefinedError(
            "no best length: the stiffness is not positive definite",
            code="not-positive",
            values={"eigenvalues": values.tolist(), "length": start},
        )
    # At a distance t from the balancing length one block is exp(2|t|) times the other, so
    # that the condition number is at least exp(2|t|) / sqrt(3): beyond `reach` it exceeds
    # that at t = 0.
    reach = 0.5 * float(np.log(values[-1] / values[0])) + 1.0
    low, high = -reach, reach
    while True:
        t = np.linspace(low, high, 33)
        smallest = at(start * np.exp(t))
        # Rounding of an ill-conditioned matrix can make its smallest eigenvalue negative.
        cost = np.where(smallest[:, 0] > 0.0, numerics.condition(smallest), np.inf)
        least = int(np.argmin(cost))
        if high - low <= numerics.NEGLIGIBLE_STEP:
            return BestLength(float(start * np.exp(t[least])), float(cost[least]))
        low, high = float(t[max(least - 1, 0)]), float(t[min(least + 1, 32)])
