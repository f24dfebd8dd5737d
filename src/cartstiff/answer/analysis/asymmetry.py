r"""Asymmetry of K^A, and how much the choice of connection matters at a load.

    K^A - (K^A)^T = [[ [tau]x, [f]x ], [ [f]x, 0 ]]                        ([ZK]_ eq. 50)

follows from the wrench (tau, f) alone, and every difference between two named connections
is a part of the same matrix: the load alone decides whether the choice matters.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from cartstiff.answer.analysis.matrices import (
    block_scales,
    in_blocks,
    scale_lengths,
    symmetric_part,
    with_angles_times,
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
from cartstiff.core.errors import InputError, UndefinedError, UnknownNameError
from cartstiff.core.geometry import se3
from cartstiff.core.stiffness.posture import StiffnessInFrame

#: Relative change of stiffness below which the choice of connection does not matter.
THRESHOLD = 0.01

_BLOCKS = (("rr", 0, 0), ("rt", 0, 1), ("tr", 1, 0), ("tt", 1, 1))


def _block(matrix: Array, i: int, j: int) -> Array:
    return matrix[3 * i : 3 * i + 3, 3 * j : 3 * j + 3]


@dataclass(frozen=True, eq=False)
class Asymmetry(Result):
    """Asymmetry of a stiffness beside its prediction from the wrench.

    Attributes
    ----------
    measured, predicted : ndarray, shape (6, 6)
        K - K^T, and the matrix of the wrench.
    residual : float
        Largest difference of entries, each relative to the size of its block of K.
    size : float
        Largest entry of `measured`, relative in the same way.
    agrees : bool
        Whether the residual is below 1e-8, and thus rounding.
    """

    measured: Array
    predicted: Array
    residual: float
    size: float
    agrees: bool


def asymmetry_of(stiffness: ArrayLike, wrench: ArrayLike) -> Asymmetry:
    """Compare K^A - (K^A)^T with ``-bracket_form(wrench)``.

    Parameters
    ----------
    stiffness : array_like, shape (6, 6)
        K^A, Cartan's minus connection.
    wrench : array_like, shape (6,)
        (moment, force) that the environment applies, in the frame of K.
    """
    K = checked_matrix(stiffness)
    measured = K - K.T
    predicted = -se3.bracket_form(checked_vector(wrench, 6, "wrench"))
    residual, size = (
        float(largest_in_blocks(x, K)) for x in (measured - predicted, measured)
    )
    return Asymmetry(
        measured, predicted, residual, size, residual < numerics.UNEXPLAINED_SHARE
    )


def largest_in_blocks(entries: Array, stiffness: Array) -> Array:
    """Largest entry of matrices (..., 6, 6), each relative to the size of
    its block of K.
    """
    scales, largest = (
        block_scales(stiffness),
        np.abs(in_blocks(entries)).max(axis=(-3, -1)),
    )
    return np.asarray((largest / np.where(scales == 0.0, 1.0, scales)).max(axis=(-2, -1)))


@lru_cache(maxsize=16)
def asymmetries(
    here: StiffnessInFrame, quantity: Literal["stiffness", "compliance"] = "stiffness"
) -> Mapping[str, float | None]:
    """Largest entry of K - K^T of each connection, 0 where it is only round-off;
    None without that matrix.
    """
    matrices = here.matrices if quantity == "stiffness" else here.compliances
    existing = {name: K for name, K in matrices.items() if K is not None}
    zeros: dict[str, float | None] = dict.fromkeys(existing, 0.0)
    if here.wrench is not None and not any(here.wrench.tolist()):
        return dict.fromkeys(matrices) | zeros  # it follows from the wrench alone
    K = np.array([*existing.values()]).reshape(-1, 6, 6)
    skew = K - K.swapaxes(1, 2)
    counts = largest_in_blocks(skew, K) > numerics.SYMMETRY
    sizes = np.where(counts, skew.max(axis=(1, 2)), 0.0)
    return dict.fromkeys(matrices) | dict(zip(existing, sizes.tolist(), strict=True))


def is_roundoff(entries: Array, stiffness: Array) -> bool:
    """Whether matrices (..., 6, 6) are only the round-off of a stiffness or
    a compliance.
    """
    return bool((largest_in_blocks(entries, stiffness) <= numerics.SYMMETRY).all())


@dataclass(frozen=True, eq=False)
class ConnectionDifference:
    """How one connection's matrix differs from the reference.

    Attributes
    ----------
    name, reference : str
        The two connections.
    largest : dict of str to float, or None
        Largest absolute entry of the difference in each block "rr", "rt", "tr", "tt", in
        the block's unit. None if the matrix does not exist here.
    relative : dict of str to float, or None
        Frobenius norm of the difference over the size of the block in the reference (see
        `block_scales`): pure numbers that need no length.
    change : float or None
        Largest change of the elastic wrench over all directions, relative to the
        reference; see `ConnectionTable.measure`. None too if the reference is zero.
    matters : bool or None
        Whether `change` exceeds the threshold.
    """

    name: str
    reference: str
    largest: dict[str, float] | None
    relative: dict[str, float] | None
    change: float | None
    matters: bool | None


@dataclass(frozen=True, eq=False)
class ConnectionTable:
    """Whether the choice of connection matters for a robot at a load.

    Attributes
    ----------
    reference : str
        Connection that the others are compared with.
    rows : tuple of ConnectionDifference
        One for each other connection.
    threshold : float
        Relative change above which the choice matters.
    measure : {"energy", "length"}
        "energy": the largest singular value of ``R^T dK R`` with R R^T the compliance of
        the reference, the same for every length and body frame. "length": that of dK_l
        over that of the reference K_l, used where the reference is not positive definite.
    length : float
        Length scale of "length".
    matters : bool
        Whether the choice matters for any row.
    verdict : str
        The result in a sentence, with the threshold.
    """

    reference: str
    rows: tuple[ConnectionDifference, ...]
    threshold: float
    measure: str
    length: float
    matters: bool
    verdict: str


def compare_connections(
    stiffness: Mapping[str, ArrayLike | None],
    *,
    reference: str = "B",
    length: float = 1.0,
    threshold: float = THRESHOLD,
    compliance: ArrayLike | None = None,
) -> ConnectionTable:
    """Differences between the stiffness matrices of several connections at one
    posture and load.

    Parameters
    ----------
    stiffness : mapping of str to (6, 6) array or None
        By connection; None where it is undefined.
    reference : str
        Name of the matrix that the others are compared with.
    length : float
        Used only where the reference is not positive definite.
    threshold : float
        Relative change that matters.
    compliance : array_like, shape (6, 6), optional
        Inverse of the symmetric part of the reference, if it is known better than by
        inversion.

    Raises
    ------
    UnknownNameError
        If the reference is not among the names.
    UndefinedError
        Code ``"no-reference"`` if the reference matrix does not exist.
    InputError
        If the threshold is not positive.
    """
    # The matrix that all others are compared with.
    if reference not in stiffness:
        raise UnknownNameError("connection", reference, stiffness)
    if not checked_number(threshold, "threshold") > 0:
        raise InputError(
            "threshold cannot be used", expected="a positive number", got=threshold
        )
    base = stiffness[reference]
    if base is None:
        raise UndefinedError(
            f"stiffness of connection {reference!r} does not exist here: nothing to "
            "compare with",
            code="no-reference",
        )
    K = checked_matrix(base, f"stiffness {reference}")
    scale = checked_length(length)
    # Changes are shares of the energy in the reference; where it has no inverse, of a
    # size by the length.
    if compliance is None:
        inverse = numerics.invert(symmetric_part(K))
        C = np.full((6, 6), np.nan) if inverse is None else inverse.matrix
    else:
        C = checked_matrix(compliance, "compliance")
    scaled = scale_lengths(K, scale)[None]
    root, rows = roots_of_compliances(scaled, with_angles_times(C, scale)[None]), []
    # One row for each other connection; an undefined matrix has a row without numbers.
    for name, matrix in stiffness.items():
        if name == reference:
            continue
        if matrix is None:
            rows.append(ConnectionDifference(name, reference, None, None, None, None))
            continue
        difference = checked_matrix(matrix, f"stiffness {name}") - K
        d_scaled = scale_lengths(difference, scale)[None]
        (found,) = relative_changes(scaled, root, d_scaled)
        change = float(found) if np.isfinite(found) else None
        rows.append(
            ConnectionDifference(
                name,
                reference,
                {b: float(np.abs(_block(difference, i, j)).max()) for b, i, j in _BLOCKS},
                _relative(difference, K),
                change,
                bool(difference.any()) if change is None else change > threshold,
            )
        )
    return ConnectionTable(
        reference,
        tuple(rows),
        float(threshold),
        "energy" if root.any() else "length",
        scale,
        any(row.matters for row in rows),
        _verdict(rows, reference, threshold),
    )


def roots_of_compliances(stiffness: Array, compliance: Array) -> Array:
    """R (N, 6, 6) with ``R R^T = C``; zero where there is no C,
    or K is not positive definite.

    Both are (N, 6, 6) with lengths scaled; C is the inverse of the symmetric part of K,
    or NaN.
    """
    positive = numerics.eigenvalues(stiffness, compliance)[:, 0] > 0.0
    positive &= np.isfinite(compliance).all(axis=(1, 2))
    values, vectors = np.linalg.eigh(symmetric_part(compliance[positive]))
    roots = np.zeros_like(stiffness)
    roots[positive] = vectors * np.sqrt(np.maximum(values, 0.0))[:, None]
    return roots


def relative_changes(reference: Array, roots: Array, difference: Array) -> Array:
    """`ConnectionDifference.change` (N,) of matrices with lengths scaled;
    NaN beside zero.
    """
    positive = roots.any(axis=(1, 2))
    changes, R = np.empty(len(roots)), roots[positive]
    on_axes = R.swapaxes(1, 2) @ difference[positive] @ R
    changes[positive] = np.linalg.norm(on_axes, 2, axis=(1, 2))
    change, size = (
        np.linalg.norm(m[~positive], 2, axis=(1, 2)) for m in (difference, reference)
    )
    with numerics.silent():
        changes[~positive] = change / size
    return changes


def _relative(difference: Array, K: Array) -> dict[str, float]:
    scales = block_scales(K)
    shares = dict.fromkeys((b for b, _, _ in _BLOCKS), 0.0)
    for b, i, j in _BLOCKS:
        if scales[i, j]:
            shares[b] = float(np.linalg.norm(_block(difference, i, j)) / scales[i, j])
    return shares


def _verdict(rows: list[ConnectionDifference], reference: str, threshold: float) -> str:
    if any(row.matters and row.change is None for row in rows):
        return (
            f"yes, the choice of connection matters: K^{reference} is zero, others "
            "are not"
        )
    known = [(row.change, row.name) for row in rows if row.change is not None]
    if not known:
        return "nothing to compare: no other connection has a matrix here"
    worst, name = max(known)
    size = (
        0.0 if worst < numerics.PRINTED_AS_ZERO else 100.0 * worst
    )  # what is only rounding is 0
    largest = f"changes up to {size:.2g} % (K^{name} against K^{reference})"
    if worst > threshold:
        return (
            f"yes, the choice of connection matters: {largest}, above "
            f"{100 * threshold:g} %"
        )
    return (
        f"no, the choice of connection does not matter: {largest}, below "
        f"{100 * threshold:g} %"
    )
