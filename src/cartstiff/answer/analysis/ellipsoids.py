r"""Ellipsoids and directional stiffness: three dimensions of a six-dimensional
matrix at a time.

Two different blocks have the same name in the literature; own definitions distinguish
them here:

* *held*: the other freedoms are locked. Translational stiffness K_tt, compliance K_tt^-1.
* *free*: the other freedoms move without load. Translational compliance C_tt, stiffness
  C_tt^-1 = K_tt - K_tr K_rr^-1 K_rt.

Free is never stiffer than held when K is positive definite. Held translational and free
rotational stiffness are the same at every point of the body; the other two depend on the
point.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from cartstiff.answer.analysis.matrices import (
    ROTATION,
    TRANSLATION,
    Definiteness,
    definiteness,
    eliminate,
    eliminate_each,
    frame_along,
    loss_of_elimination,
    lost_digits,
    move_compliance,
    move_stiffness,
    stiffnesses_of_motions,
    symmetric_part,
)
from cartstiff.core import numerics
from cartstiff.core.arrays import Array, checked_matrix, checked_unit, read_only
from cartstiff.core.errors import UndefinedError, UnknownNameError
from cartstiff.core.lazily import cached_property

Freedom = Literal["translation", "rotation"]
Others = Literal["free", "held"]
Quantity = Literal["stiffness", "compliance"]

_BLOCKS = {"rotation": ROTATION, "translation": TRANSLATION}
# Blocks of a freedom, the others held or free, in the order of a decomposition.
_OF_C: list[tuple[Freedom, Others]] = [("rotation", "free"), ("translation", "free")]
_OF_K: list[tuple[Freedom, Others]] = [("rotation", "held"), ("translation", "held")]
#: Principal values, smallest first, and their axes.
_Principal = tuple[list[float], list[list[float]]]


@dataclass(frozen=True, eq=False)
class Ellipsoid:
    """Image of the unit sphere under a symmetric 3x3 matrix: {M x : |x| = 1}.

    Attributes
    ----------
    axes : ndarray, shape (3, 3)
        Proper rotation; column i is the i-th principal axis in the frame of the matrix.
    radii : ndarray, shape (3,)
        Semi-axes, the absolute values of `eigenvalues`.
    eigenvalues : ndarray, shape (3,)
        Principal values with their signs, smallest first.
    definiteness : str
        "positive", "positive semidefinite", "indefinite", "negative semidefinite",
        "negative" or "zero". Only a positive one is the ellipsoid of a stable elasticity.
    asymmetry : float
        Largest entry of the antisymmetric part, which the ellipsoid does not include.
    """

    axes: Array
    radii: Array
    eigenvalues: Array
    definiteness: Definiteness
    asymmetry: float = 0.0

    @property
    def matrix(self) -> Array:
        """The symmetric matrix itself: axes diag(eigenvalues) axes^T."""
        return (self.axes * self.eigenvalues) @ self.axes.T


def ellipsoid(matrix: ArrayLike) -> Ellipsoid:
    """Ellipsoid of the symmetric part of any 3x3 matrix.

    The largest component of the first two axes is positive; the third completes a
    right-handed frame. Axes of equal eigenvalues are arbitrary within their plane.

    Raises
    ------
    InputError
        If the matrix is not 3x3 and finite.
    """
    m = checked_matrix(matrix, "matrix", 3)
    values, vectors = numerics.eigenpairs(m)
    shape = shape_of(values.tolist(), vectors.T.tolist())
    return replace(shape, asymmetry=float(np.abs(m - m.T).max()) / 2.0)


def shape_of(sizes: list[float], axes: list[list[float]]) -> Ellipsoid:
    """`ellipsoid` from eigenvalues, smallest first, and their vectors."""
    # Plain numbers and one array: small arrays are slower.
    (a, b, c), (d, e, f) = upright(axes[0]), upright(axes[1])
    rows = read_only(
        [
            a,
            d,
            b * f - c * e,
            b,
            e,
            c * d - a * f,
            c,
            f,
            a * e - b * d,
            *sizes,
            *map(abs, sizes),
        ]
    )
    values = rows[9:12]
    sign = definiteness(sizes, zero=0.0)
    return Ellipsoid(rows[:9].reshape(3, 3), rows[12:], values, sign)


def upright(vector: list[float]) -> list[float]:
    """The vector or its opposite, the largest component positive."""
    return [-x for x in vector] if max(vector, key=abs) < 0.0 else vector


def softest(
    compliances: ArrayLike, axes: ArrayLike
) -> tuple[float, list[float] | None] | None:
    """Least stiffness, and its direction in the frame of the axes if it is one.

    Parameters
    ----------
    compliances : array_like (3,)
        Principal compliances of a block with the other freedoms free, smallest first.
    axes : array_like (3, 3)
        Principal axes as columns.

    Returns
    -------
    (float, list of float or None) or None
        None if a load is not resisted along every direction, or moves nothing; no
        direction if two or three of the largest are equal.
    """
    least, middle, most = np.asarray(compliances, float).tolist()
    if not (least >= 0.0 and most > 0.0):
        return None
    is_one = most - middle > numerics.NEGLIGIBLE_DIFFERENCE * most
    return 1.0 / most, upright(np.asarray(axes, float)[:, 2].tolist()) if is_one else None


def stiffest(
    compliances: ArrayLike, axes: ArrayLike
) -> tuple[float | None, list[float] | None] | None:
    """Greatest stiffness, and its direction if it is one, as `softest`.

    The stiffness is None where the structure holds the body along that direction.
    """
    least, middle, most = np.asarray(compliances, float).tolist()
    if not (least >= 0.0 and most > 0.0):
        return None
    is_one = middle - least > numerics.NEGLIGIBLE_DIFFERENCE * middle
    direction = upright(np.asarray(axes, float)[:, 0].tolist()) if is_one else None
    return (1.0 / least if least > 0.0 else None), direction


def _choice(freedom: str, others: str) -> tuple[slice, bool]:
    if freedom not in _BLOCKS:
        raise UnknownNameError("freedom", freedom, _BLOCKS)
    if others not in ("free", "held"):
        raise UnknownNameError(
            "condition of the other freedoms", others, ("free", "held")
        )
    return _BLOCKS[freedom], others == "held"


def _in_frame(matrix: ArrayLike, T: ArrayLike | None, is_stiffness: bool) -> Array:
    """A stiffness or a compliance, checked, in frame N."""
    if T is None:
        return checked_matrix(matrix, "stiffness" if is_stiffness else "compliance")
    return (move_stiffness if is_stiffness else move_compliance)(matrix, T)


def _block(m: Array, keep: slice, is_eliminated: bool) -> Array:
    return eliminate(m, keep) if is_eliminated else m[keep, keep].copy()


def stiffness_block(
    stiffness: ArrayLike,
    freedom: Freedom,
    others: Others,
    T_m_n: ArrayLike | None = None,
) -> Array:
    r"""3x3 stiffness of translation or rotation, the other freedoms held or free.

    held: the block of K. free: ``K_aa - K_ab K_bb^-1 K_ba``, the inverse of the block of
    K^-1; it needs only K_bb, and exists at postures where K itself is singular.

    Parameters
    ----------
    stiffness : array_like, shape (6, 6)
        K in frame M.
    freedom : {"translation", "rotation"}
        Unit of the result: force per length, or moment per angle.
    others : {"free", "held"}
        State of the other three freedoms.
    T_m_n : array_like, shape (4, 4), optional
        Frame N with the origin and the axes of the block; default M.

    Raises
    ------
    UndefinedError
        Code ``"singular"`` for free, if the other freedoms have no equilibrium.
    """
    keep, held = _choice(freedom, others)
    return _block(_in_frame(stiffness, T_m_n, True), keep, not held)


def compliance_block(
    compliance: ArrayLike,
    freedom: Freedom,
    others: Others,
    T_m_n: ArrayLike | None = None,
) -> Array:
    r"""3x3 compliance of translation or rotation, the other freedoms held or free.

    free: the block of C (no load on the others). held: ``C_aa - C_ab C_bb^-1 C_ba``, the
    inverse of the block of K. Arguments as in `stiffness_block`, with C in place of K.

    Raises
    ------
    UndefinedError
        Code ``"singular"`` for held, if no reaction can hold the other freedoms.
    """
    keep, held = _choice(freedom, others)
    return _block(_in_frame(compliance, T_m_n, False), keep, held)


def stiffness_ellipsoid(
    stiffness: ArrayLike,
    freedom: Freedom,
    others: Others,
    T_m_n: ArrayLike | None = None,
    inverse: ArrayLike | None = None,
) -> Ellipsoid:
    """Ellipsoid of `stiffness_block`; its eigenvalues are the principal stiffnesses.

    Of the translations or the rotations of frame N, ``T_m_n`` in that of the stiffness
    (6, 6), by the word `freedom`; `others` says whether the other three are "held" or
    "free". The inverse, the compliance (6, 6), resolves values that the stiffness does
    not.

    Raises
    ------
    UndefinedError
        As `stiffness_block`; code ``"ill-conditioned"`` where neither resolves a
        principal value.
    """
    return _of_pair("stiffness", stiffness, inverse, freedom, others, T_m_n)


def compliance_ellipsoid(
    compliance: ArrayLike,
    freedom: Freedom,
    others: Others,
    T_m_n: ArrayLike | None = None,
    inverse: ArrayLike | None = None,
) -> Ellipsoid:
    """Ellipsoid of `compliance_block`; its eigenvalues are the principal compliances.

    The inverse, the stiffness (6, 6), resolves values that the compliance does not. The
    errors are those of `stiffness_ellipsoid`.
    """
    return _of_pair("compliance", compliance, inverse, freedom, others, T_m_n)


def _of_pair(
    quantity: Quantity,
    matrix: ArrayLike,
    inverse: ArrayLike | None,
    freedom: Freedom,
    others: Others,
    T_m_n: ArrayLike | None,
) -> Ellipsoid:
    """Ellipsoid of a block of a matrix, of which the inverse may be known."""
    keep, held = _choice(freedom, others)
    is_stiffness = quantity == "stiffness"
    own = _in_frame(matrix, T_m_n, is_stiffness)
    other = None if inverse is None else _in_frame(inverse, T_m_n, not is_stiffness)
    is_eliminated = held != is_stiffness
    shape = shape_of(*_principal_pair(own, other, keep, is_eliminated))
    if not (own != own.T).any():
        return shape
    block = _block(own, keep, is_eliminated)
    return replace(shape, asymmetry=float(np.abs(block - block.T).max()) / 2.0)


def is_direct(quantity: str, others: str) -> bool:
    """Whether principal values are those of a block of this matrix;
    else those of a block of the inverse matrix have the same axes, and inverse values.
    """
    return (quantity == "stiffness") == (others == "held")


def principal_pairs(
    matrices: Array, inverses: Array, keep: slice, is_eliminated: bool
) -> tuple[Array, Array]:
    """Principal values (N, 3), smallest first, and axes in columns (N, 3, 3) of blocks.

    A block is that of the matrix, or with `is_eliminated` what is left of it while the
    other freedoms follow (`eliminate`): the inverse of the block of the inverse matrix.
    One that is ill-conditioned is read from both matrices; without an inverse the matrix
    alone is used, and what is only its rounding is zero.

    Parameters
    ----------
    matrices, inverses : ndarray, shape (N, 6, 6)
        Stiffness and compliance, or the other way round; NaN where there is none.
    keep : slice
        `ROTATION` or `TRANSLATION` of `cartstiff.answer.analysis.matrices`.
    is_eliminated : bool
        See `is_direct`.

    Returns
    -------
    values, axes : ndarray
        NaN values where neither matrix resolves them.
    """
    exists, known = (np.isfinite(m).all(axis=(1, 2)) for m in (matrices, inverses))
    read_from = inverses if is_eliminated else matrices
    values, axes = numerics.decomposed(read_from[:, keep, keep])
    is_whole = numerics.condition(values) < numerics.LARGEST_BLOCK_CONDITION
    if is_eliminated:
        values, axes = _inverted(values, axes)
    values[~exists] = np.nan
    for i in np.flatnonzero(exists & known & ~is_whole):
        try:
            values[i], axes[i] = _of_both(matrices[i], inverses[i], keep, is_eliminated)
        except UndefinedError:
            values[i] = np.nan
    if (alone := exists & ~known).any():
        own = matrices[alone]
        blocks = own[:, keep, keep]
        # Rounding of a singular matrix is no stiffness: the rank is decided.
        found, axes[alone] = numerics.decomposed(
            eliminate_each(own, keep) if is_eliminated else blocks
        )
        size = np.abs(blocks).max(axis=(1, 2))[:, None]
        values[alone] = numerics.without_roundoff(found, size)
    return values, axes


def _inverted(values: Array, axes: Array) -> tuple[Array, Array]:
    """Principal values and axes of the inverses of blocks."""
    if (values[:, 0] * values[:, 2] > 0.0).all():
        return 1.0 / values[:, ::-1], axes[:, :, ::-1]
    with np.errstate(divide="ignore"):
        values = 1.0 / values
    order, rows = np.argsort(values, axis=1), np.arange(len(values))[:, None]
    return values[rows, order], axes.swapaxes(1, 2)[rows, order].swapaxes(1, 2)


def _of_both(
    matrix: Array, inverse: Array, keep: slice, is_eliminated: bool
) -> tuple[Array, Array]:
    """`principal_pairs` of one block, each value from the matrix that resolves it.

    UndefinedError where none does.
    """
    blocks: list[Array | None] = []
    failures = []
    for whole, eliminated in ((matrix, is_eliminated), (inverse, not is_eliminated)):
        try:
            blocks.append(_block(whole, keep, eliminated))
        except UndefinedError as error:
            blocks.append(None)
            failures.append(error)
    m, c = blocks
    if m is None and c is not None:
        back = numerics.invert(symmetric_part(c))
        m = None if back is None else back.matrix
    if m is None:
        raise failures[0]
    if c is None:
        values, axes = numerics.eigenpairs(m)
        size = float(np.abs(matrix[keep, keep]).max())
        return numerics.without_roundoff(values, size), axes
    loss = loss_of_elimination(matrix if is_eliminated else inverse, keep)
    losses = (loss, 1.0) if is_eliminated else (1.0, loss)
    values, axes = numerics.eigenpairs(m, c, losses)
    if np.isnan(values).any():
        raise lost_digits(values, "this block")
    return values, axes


def _principal_pair(
    matrix: Array, inverse: Array | None, keep: slice, is_eliminated: bool
) -> _Principal:
    """`principal_pairs` of one matrix (6, 6), with the reason why there are none."""
    other = np.full((6, 6), np.nan) if inverse is None else inverse
    (values,), (axes,) = principal_pairs(matrix[None], other[None], keep, is_eliminated)
    if np.isnan(values).any():
        if inverse is None:
            eliminate(matrix, [*range(6)[keep]])
        else:
            values, axes = _of_both(matrix, inverse, keep, is_eliminated)
    return values.tolist(), axes.T.tolist()


class MatrixPair:
    """Symmetric stiffness and compliance of one posture, inverse to each other.

    One decomposition of their blocks serves everything that is read from the pair.

    Parameters
    ----------
    K, C : ndarray, shape (6, 6), or None
        As from `cartstiff.core.stiffness.posture.StiffnessInFrame.pair`; a function of K
        is called where C does not say all.
    """

    def __init__(
        self, K: Array | Callable[[], Array | None] | None, C: Array | None
    ) -> None:
        self._given, self.C = K, C
        self._shapes: dict[tuple[Freedom, Others, Quantity], Ellipsoid | None] = {}

    @cached_property
    def K(self) -> Array | None:  # noqa: N802
        """The stiffness."""
        return self._given() if callable(self._given) else self._given

    @cached_property
    def _whole(self) -> dict[tuple[Freedom, Others], _Principal]:
        """Of the blocks of K and C, those that alone have all digits, as nearly always.

        In plain numbers: small arrays are slower.
        """
        K, C = self._given, self.C
        if K is None or C is None:
            return {}
        r, t = (ROTATION, ROTATION), (TRANSLATION, TRANSLATION)
        places, blocks = _OF_C, [C[r], C[t]]
        if not callable(K):
            places, blocks = _OF_C + _OF_K, [*blocks, K[r], K[t]]
        values, axes = np.linalg.eigh(np.array(blocks))
        each = zip(values.tolist(), axes.swapaxes(1, 2).tolist(), strict=True)
        found = zip(places, each, strict=True)
        return {at: own for at, own in found if numerics.hold_all_digits(own[0])}

    def principal(
        self, freedom: Freedom, others: Others, quantity: Quantity = "stiffness"
    ) -> _Principal | None:
        """Principal values, smallest first, and their axes; None without that matrix.

        Raises
        ------
        UndefinedError
            See `stiffness_ellipsoid`.
        """
        direct = is_direct(quantity, others)
        if (own := self._whole.get((freedom, others))) is not None:
            if direct:
                return own
            # Smallest first again: values of one sign change their order.
            values, axes = [1.0 / x for x in own[0][::-1]], own[1][::-1]
            if values == sorted(values):
                return values, axes
            pairs = sorted(zip(values, axes, strict=True), key=lambda pair: pair[0])
            return [x for x, _ in pairs], [axis for _, axis in pairs]
        pair = (self.K, self.C) if quantity == "stiffness" else (self.C, self.K)
        if pair[0] is None:
            return None
        return _principal_pair(pair[0], pair[1], _BLOCKS[freedom], not direct)

    def ellipsoid(
        self, freedom: Freedom, others: Others, quantity: Quantity = "stiffness"
    ) -> Ellipsoid | None:
        """The ellipsoid of `principal`."""
        key = freedom, others, quantity
        if key not in self._shapes:
            found = self.principal(*key)
            self._shapes[key] = None if found is None else shape_of(*found)
        return self._shapes[key]

    def on_axes(self, axes: Array, freedom: Freedom, others: Others) -> Array:
        """`stiffnesses_on_axes` of unit vectors (N, 3)."""
        shape = (len(axes), 6, 6)
        nothing = np.full((6, 6), np.nan)
        K, C = (nothing if M is None else M for M in (self.K, self.C))
        stacks = np.broadcast_to(K, shape), np.broadcast_to(C, shape)
        return stiffnesses_on_axes(*stacks, axes, freedom, others)

    def condition(self, freedom: Freedom) -> float:
        """Condition number of a diagonal block of K; NaN where it is not resolved."""
        with suppress(UndefinedError):
            if (found := self.principal(freedom, "held")) is not None:
                return numerics.condition_of(found[0])
        return float("nan")


def stiffnesses_on_axes(
    K: Array, C: Array, directions: Array, freedom: Freedom, others: Others
) -> Array:
    """Stiffness (N,) along, or about, lines through the origin;
    NaN where it does not exist.

    Parameters
    ----------
    K, C : ndarray, shape (N, 6, 6)
        The pair of the other freedoms held, or free; NaN where there is none.
    directions : ndarray, shape (N, 3)
        Unit vectors.
    freedom : {"translation", "rotation"}
        `stiffness_along` or `stiffness_about`.
    others : {"free", "held"}
        State of all other freedoms.
    """
    block, function = _BLOCKS[freedom], _FUNCTIONS[freedom]
    has_K, has_C = (np.isfinite(matrices).all(axis=(1, 2)) for matrices in (K, C))
    if others == "held":
        twists = np.zeros((len(directions), 6))
        twists[:, block] = directions
        return stiffnesses_of_motions(twists, K, ~has_C)
    own = C[:, block, block]
    compliance = np.einsum("ni,nij,nj->n", directions, own, directions)
    # Without a K, a direction without compliance is held by the structure: its stiffness
    # is unknown.
    rigid = np.abs(compliance) <= numerics.ZERO_SHARE * np.abs(own).max(axis=(1, 2))
    with np.errstate(divide="ignore"):
        stiffness: Array = np.where(rigid & ~has_K, np.nan, 1.0 / compliance)
    for i in np.flatnonzero(has_K & ~has_C):
        with suppress(UndefinedError):
            stiffness[i] = function(K[i], directions[i], others="free")
    return stiffness


def _on_axis(
    K: ArrayLike, direction: ArrayLike, point: ArrayLike, index: int, others: str
) -> float:
    _, held = _choice("translation", others)
    moved = move_stiffness(K, frame_along(checked_unit(direction), point))
    if held:
        return float(moved[index, index])
    try:
        return float(eliminate(moved, [index])[0, 0])
    except UndefinedError as error:
        raise UndefinedError(
            "stiffness with the other freedoms free does not exist here: " + str(error),
            code=error.code,
            values=error.values,
        ) from error


def stiffness_along(
    stiffness: ArrayLike,
    direction: ArrayLike,
    point: ArrayLike = (0.0, 0.0, 0.0),
    others: Others = "free",
) -> float:
    r"""Force per displacement of a body point along a direction (force per length).

    free: a force through the point moves it, without load on the other freedoms: ``1 /
    (w^T C w)`` with w = (p x u, u). held: the body is guided to translate along u only:
    ``u^T K_tt u``, the same for every point.

    Parameters
    ----------
    stiffness : array_like, shape (6, 6)
        Stiffness under any connection.
    direction : array_like, shape (3,)
        Vector u of any length, in the axes of M.
    point : array_like, shape (3,)
        Point p of the body, in M.
    others : {"held", "free"}
        State of the other five freedoms.

    Raises
    ------
    InputError
        If the direction is zero.
    UndefinedError
        Code ``"singular"``, see `stiffness_block`.
    """
    return _on_axis(stiffness, direction, point, 5, others)


def stiffness_about(
    stiffness: ArrayLike,
    direction: ArrayLike,
    point: ArrayLike = (0.0, 0.0, 0.0),
    others: Others = "held",
) -> float:
    r"""Moment per rotation about an axis (moment per angle).

    held: the body is hinged on the axis through the point: ``s^T K s`` with s = (u, p x
    u). free: a pure moment along u, without load on the other freedoms: ``1 / (u^T C_rr
    u)``, the same for every parallel axis.

    Parameters
    ----------
    stiffness : array_like, shape (6, 6)
        Stiffness under any connection.
    direction : array_like, shape (3,)
        Vector u of any length, in the axes of M.
    point : array_like, shape (3,)
        Point p of the body, in M.
    others : {"held", "free"}
        State of the other five freedoms.

    Raises
    ------
    InputError
        If the direction is zero.
    UndefinedError
        Code ``"singular"``, see `stiffness_block`.
    """
    return _on_axis(stiffness, direction, point, 2, others)


_FUNCTIONS = {"translation": stiffness_along, "rotation": stiffness_about}
