r"""Ellipsoids and directional stiffness: three dimensions of a six-dimensional
matrix at a time.

Two different blocks have the same name in the literature; here they are distinguished:

* *held*: the other freedoms are locked. Translational stiffness K_tt, compliance K_tt^-1.
* *free*: the other freedoms move without load. Translational compliance C_tt, stiffness
  C_tt^-1 = K_tt - K_tr K_rr^-1 K_rt.

Free is never stiffer than held when K is positive definite. Held translational and free
rotational stiffness are the same at every point of the body; the other two depend on the
point.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from cartstiff import numerics
from cartstiff.analysis.matrices import (
    ROTATION,
    TRANSLATION,
    Definiteness,
    definiteness,
    eliminate,
    frame_along,
    loss_of_elimination,
    lost_digits,
    move_compliance,
    move_stiffness,
    stiffnesses_of_motions,
    symmetric_part,
)
from cartstiff.arrays import Array, checked_matrix, checked_unit, read_only
from cartstiff.errors import UndefinedError, UnknownNameError

Freedom = Literal["translation", "rotation"]
Others = Literal["free", "held"]

_BLOCKS = {"rotation": ROTATION, "translation": TRANSLATION}


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
    return _principal(checked_matrix(matrix, "matrix", 3))


def _principal(
    m: Array, inverse: Array | None = None, losses: tuple[float, float] = (1.0, 1.0)
) -> Ellipsoid:
    """`ellipsoid`; a known inverse (3, 3) resolves small values,
    losses as in `eigenpairs`.
    """
    other = None if inverse is None else symmetric_part(inverse)
    values, vectors = numerics.eigenpairs(symmetric_part(m), other, losses)
    if np.isnan(values).any():
        raise lost_digits(values, "this block")
    shape = shape_of(values, vectors, definiteness(values, zero=0.0))
    return replace(shape, asymmetry=float(np.abs(m - m.T).max()) / 2.0)


def shape_of(values: Array, vectors: Array, sign: Definiteness) -> Ellipsoid:
    """`ellipsoid` from eigenvalues (3,), smallest first,
    and their vectors in columns (3, 3).
    """
    # Plain numbers and one array: small arrays are slower.
    first, second, _ = vectors.T.tolist()
    (a, b, c), (d, e, f) = upright(first), upright(second)
    sizes = values.tolist()
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
    return Ellipsoid(rows[:9].reshape(3, 3), rows[12:], rows[9:12], sign)


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

    The inverse, the compliance (6, 6), resolves values that the stiffness does not.

    Raises
    ------
    UndefinedError
        As `stiffness_block`; code ``"ill-conditioned"`` where neither resolves a
        principal value.
    """
    return _of_pair(True, stiffness, inverse, freedom, others, T_m_n)


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
    return _of_pair(False, compliance, inverse, freedom, others, T_m_n)


def _of_pair(
    is_stiffness: bool,
    matrix: ArrayLike,
    inverse: ArrayLike | None,
    freedom: Freedom,
    others: Others,
    T_m_n: ArrayLike | None,
) -> Ellipsoid:
    """Ellipsoid of a block of a matrix.

    The same block of the inverse matrix is its inverse.
    """
    keep, held = _choice(freedom, others)
    # One of the two blocks is eliminated: for a stiffness that of C if held, that of K if
    # free.
    is_eliminated = held != is_stiffness
    own = _in_frame(matrix, T_m_n, is_stiffness)
    size = float(np.abs(own[keep, keep]).max())
    if inverse is None:
        # Rounding of a singular matrix is no stiffness: `eliminate` by indices decides
        # its rank.
        block = eliminate(own, [*range(6)[keep]]) if is_eliminated else own[keep, keep]
        return _without_rounding(ellipsoid(block), size)
    if not is_eliminated:
        alone = ellipsoid(own[keep, keep])
        if numerics.hold_all_digits(alone.eigenvalues):
            return alone
    other = _in_frame(inverse, T_m_n, not is_stiffness)
    blocks: list[Array | None] = []
    failures = []
    for whole, eliminated in ((own, is_eliminated), (other, not is_eliminated)):
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
        return _without_rounding(ellipsoid(m), size)
    loss = loss_of_elimination(own if is_eliminated else other, keep)
    losses = (loss, 1.0) if is_eliminated else (1.0, loss)
    return _principal(m, c, losses)


def _without_rounding(shape: Ellipsoid, size: float) -> Ellipsoid:
    """Principal values that are only the rounding of a block of this size are zero."""
    values = numerics.without_roundoff(shape.eigenvalues, size)
    sign = definiteness(values, zero=0.0)
    return replace(
        shape,
        eigenvalues=read_only(values),
        radii=read_only(np.abs(values)),
        definiteness=sign,
    )


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

    Raises
    ------
    InputError
        If the direction is zero.
    UndefinedError
        Code ``"singular"``, see `stiffness_block`.
    """
    return _on_axis(stiffness, direction, point, 2, others)


_FUNCTIONS = {"translation": stiffness_along, "rotation": stiffness_about}
