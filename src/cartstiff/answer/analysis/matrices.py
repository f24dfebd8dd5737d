r"""Six-by-six stiffness and compliance matrices: checks, blocks, change of frame,
scaling.

A stiffness K takes a twist (omega, v) to a wrench (moment, force); its 3x3 blocks are

    K = [[ K_rr, K_rt ],        in      [[ N m/rad,  N   ],
         [ K_tr, K_tt ]]                 [ N/rad,    N/m ]]

and a compliance C takes wrenches to twists, in the same block order.
"""

from __future__ import annotations

from math import sqrt
from typing import Final, Literal, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cartstiff.core import numerics
from cartstiff.core.arrays import (
    Array,
    checked_length,
    checked_matrix,
    checked_pose,
    checked_unit,
    checked_vector,
    real_array,
)
from cartstiff.core.errors import InputError, UndefinedError
from cartstiff.core.geometry import se3
from cartstiff.core.units import Units

#: Units with the names of the units of length and force left open.
UNITS = Units("{length}", "{force}")
#: Units of a pure number, and of the entries of a stiffness and of a compliance.
PURE, BY_BLOCK, BY_SOFT_BLOCK = "1", "of its block", "of its block, compliance"

Definiteness = Literal[
    "positive",
    "positive semidefinite",
    "indefinite",
    "negative semidefinite",
    "negative",
    "zero",
]

# Whether a component turns the body.
_TURNS = np.arange(6) < 3
ROTATION: Final = slice(0, 3)
TRANSLATION: Final = slice(3, 6)


def symmetric_part(matrix: ArrayLike) -> Array:
    """Half the sum of matrices (..., n, n) and their transposes.

    For any K^A this is K^B.
    """
    m = real_array(matrix)
    return np.asarray(0.5 * (m + m.swapaxes(-1, -2)))


def block_scales(matrix: ArrayLike) -> Array:
    """Sizes (..., 2, 2) against which 3x3 blocks are judged,
    each in its block's own unit.

    Diagonal: Frobenius norms of the rotation and translation blocks; off the diagonal
    their geometric mean, which has the unit of the coupling block: no length has to be
    chosen. For a positive semidefinite matrix the coupling block never exceeds it.
    """
    sizes = np.sqrt((in_blocks(real_array(matrix)) ** 2).sum(axis=(-3, -1)))
    coupling = np.sqrt(sizes[..., 0, 0] * sizes[..., 1, 1])
    coupling = np.where(coupling == 0.0, sizes[..., 0, 1], coupling)
    sizes[..., 0, 1] = sizes[..., 1, 0] = coupling
    return np.asarray(sizes)


def in_blocks(matrices: Array) -> Array:
    """Matrices (..., 6, 6) by blocks: (..., 2, 3, 2, 3)."""
    return matrices.reshape(*matrices.shape[:-2], 2, 3, 2, 3)


def as_symmetric(value: ArrayLike, what: str = "stiffness") -> Array:
    """Return the matrix, checked to be 6x6, finite and symmetric up to rounding.

    Raises
    ------
    InputError
        If it is not symmetric: take K^B, or `symmetric_part`.
    """
    m = checked_matrix(value, what)
    if numerics.is_symmetric(m):
        return m.copy()
    skew = np.abs(m - m.T)
    limits = block_scales(m).repeat(3, axis=0).repeat(3, axis=1)
    if np.any(skew > numerics.SYMMETRY * limits):
        raise InputError(
            f"{what} is not symmetric",
            expected="a symmetric matrix (K^B, or the symmetric part)",
            got=f"asymmetry {float(skew.max()):.3g}",
        )
    return symmetric_part(m)


def symmetric_pair(
    stiffness: ArrayLike, compliance: ArrayLike | None
) -> tuple[Array, Array | None]:
    """Stiffness and, where it is known, its inverse, checked as by `as_symmetric`."""
    known = None if compliance is None else as_symmetric(compliance, "compliance")
    return as_symmetric(stiffness), known


def definiteness(
    eigenvalues: ArrayLike, zero: float = numerics.ZERO_SHARE
) -> Definiteness:
    """Name the signs of eigenvalues; a share `zero` of the largest counts as zero."""
    # Called for every posture of a page: on a few floats NumPy takes ten times as long.
    values = eigenvalues
    if not isinstance(values, list):
        values = real_array(values).tolist()
    values = cast(list[float], values)
    low, high = min(values, default=0.0), max(values, default=0.0)
    if low > max(0.0, zero * high):
        return "positive"
    least = zero * max(abs(low), abs(high))
    below, above = low < -least, high > least
    if below and above:
        return "indefinite"
    null = any(abs(v) <= least for v in values)
    if above:
        return "positive semidefinite" if null else "positive"
    if below:
        return "negative semidefinite" if null else "negative"
    return "zero"


def move_stiffness(stiffness: ArrayLike, T_m_n: ArrayLike) -> Array:
    """Stiffness in body frame N: ``Ad^T K Ad`` with Ad = Ad(T_m_n).

    Holds for K^A, K^B and K^+ (tensors); the kinematic connection of another origin is
    another connection.
    """
    K, Ad = checked_matrix(stiffness), se3.adjoint(checked_pose(T_m_n, "frame"))
    moved: Array = Ad.T @ K @ Ad
    return moved


def move_compliance(compliance: ArrayLike, T_m_n: ArrayLike) -> Array:
    """Compliance in body frame N: ``Ad^-1 C Ad^-T`` with Ad = Ad(T_m_n)."""
    C, back = (
        checked_matrix(compliance, "compliance"),
        se3.adjoint(se3.inverse(checked_pose(T_m_n, "frame"))),
    )
    return back @ C @ back.T


def frame_along(direction: ArrayLike, point: ArrayLike = (0.0, 0.0, 0.0)) -> Array:
    """Pose ``T_m_n`` with origin at `point` and z axis along `direction`, both in M."""
    z = checked_unit(direction)
    x = np.cross(np.eye(3)[int(np.argmin(np.abs(z)))], z)
    x /= np.linalg.norm(x)
    rotation = np.column_stack([x, np.cross(z, x), z])
    return se3.pose(rotation, checked_vector(point, 3, "point"))


def scale_lengths(stiffness: ArrayLike, length: float) -> Array:
    """Stiffness on twists (length * omega, v): every entry is a force per length.

    ``D K D`` with D = diag(1/length, 1/length, 1/length, 1, 1, 1).
    """
    return with_angles_times(checked_matrix(stiffness), 1.0 / checked_length(length))


def with_angles_times(matrix: Array, factor: float | Array) -> Array:
    """Matrices (..., 6, 6) with their first three rows and columns multiplied."""
    d = np.where(_TURNS, np.asarray(factor)[..., None], 1.0)
    return np.asarray(matrix * d[..., :, None] * d[..., None, :])


def balancing_length(matrix: ArrayLike) -> float:
    """Length that makes both diagonal blocks equally large.

    For rounding only, not a result.
    """
    m = real_array(matrix)
    # Twice as fast as `np.linalg.norm` on nine numbers.
    rr, tt = (sqrt(x.dot(x)) for x in (m[s, s].ravel() for s in (ROTATION, TRANSLATION)))
    return sqrt(rr / tt) if rr > 0 and tt > 0 else 1.0


def invert(matrix: ArrayLike, what: str = "stiffness") -> Array:
    """Inverse of a stiffness or compliance, see `cartstiff.core.numerics.invert`.

    Raises
    ------
    UndefinedError
        Code ``"singular"``, with the singular values on balanced units and the length
        used.
    """
    m = checked_matrix(matrix, what)
    inverse = numerics.invert(m)
    if inverse is not None:
        return inverse.matrix
    length = balancing_length(m)
    values = np.linalg.svd(scale_lengths(m, length), compute_uv=False)
    raise UndefinedError(
        f"{what} is singular: it has no inverse",
        code="singular",
        values={"singular_values": values.tolist(), "length": length},
    )


def eliminate(matrix: ArrayLike, keep: slice | list[int]) -> Array:
    """Matrix on the kept directions when the others are free:
    ``M_kk - M_ko M_oo^-1 M_ok``.

    A singular ``M_oo`` is harmless where the kept directions do not load its null space.

    Raises
    ------
    UndefinedError
        Code ``"singular"`` if they do: the others then have no equilibrium.
    """
    m = real_array(matrix)
    if isinstance(keep, slice) and keep in (ROTATION, TRANSLATION):
        block, _, is_plain = _plainly_eliminated(m, keep)
        if is_plain:
            return block
    every = np.arange(len(m))
    free, left, values, length = _on_kept(m[None], every[keep], np.delete(every, keep))
    if np.isnan(free).any():
        raise UndefinedError(
            "the other freedoms are loaded where they have no stiffness: no balance "
            "exists",
            code="singular",
            values={
                "singular_values": values[0].tolist(),
                "unbalanced": float(left[0]),
                "length": float(length[0]),
            },
        )
    return free[0]


def _plainly_eliminated(m: Array, keep: slice) -> tuple[Array, float, bool]:
    """Block by the inverse of ``M_oo``, loss, and whether it is well conditioned."""
    rest = TRANSLATION if keep == ROTATION else ROTATION
    inner = numerics.invert(m[rest, rest])
    if inner is None:
        return np.zeros((3, 3)), float("inf"), False
    free = m[keep, keep] - m[keep, rest] @ inner.matrix @ m[rest, keep]
    size, left = float(np.abs(m[keep, keep]).max()), float(np.abs(free).max())
    growth = inner.error / numerics.EPSILON
    loss = max(1.0, growth * size / left) if left > 0.0 else float("inf")
    is_plain = growth <= numerics.WELL_CONDITIONED and left > numerics.ZERO_SHARE * size
    return free, loss, is_plain


def eliminate_each(stack: Array, keep: slice) -> Array:
    """`eliminate` of matrices (N, 6, 6) for a block (N, 3, 3).

    NaN where no balance exists.
    """
    every = np.arange(6)
    return _on_kept(stack, every[keep], np.delete(every, every[keep]))[0]


def _on_kept(m: Array, kept: Array, others: Array) -> tuple[Array, Array, Array, Array]:
    """`eliminate` of matrices (N, 6, 6), NaN where no balance exists, and the reasons.

    These are the unbalanced load (N,), the singular values of ``M_oo`` (N, k), and the
    lengths (N,), the former two in units of length that make both diagonal blocks equally
    large.
    """
    length = np.array([balancing_length(matrix) for matrix in m])
    d = np.ones((len(m), 6))
    d[:, :3] /= length[:, None]
    scaled = m * d[:, :, None] * d[:, None, :]
    inner, edge = scaled[:, others[:, None], others], scaled[:, others[:, None], kept]
    u, values, vt = np.linalg.svd(inner)
    largest = np.abs(scaled).max(axis=(1, 2))
    is_held = values > numerics.ZERO_SHARE * largest[:, None]
    gains = np.where(is_held, 1.0 / np.where(is_held, values, 1.0), 0.0)
    moves = vt.swapaxes(1, 2) @ (gains[:, :, None] * (u.swapaxes(1, 2) @ edge))
    left = np.abs(inner @ moves - edge).max(axis=(1, 2))
    block = scaled[:, kept[:, None], kept]
    free = block - scaled[:, kept[:, None], others] @ moves
    is_all = np.abs(free).max(axis=(1, 2)) <= numerics.ZERO_SHARE * np.abs(block).max(
        axis=(1, 2)
    )
    free[is_all] = 0.0  # rounding of the subtraction
    # An entry that couples to a zero stiffness is itself bounded by the root of it in a
    # positive semidefinite matrix.
    free[left > np.sqrt(numerics.ZERO_SHARE) * largest] = np.nan
    return free / d[:, kept, None] / d[:, None, kept], left, values, length


def lost_digits(values: Array, what: str) -> UndefinedError:
    """The error for principal values that neither a matrix nor its inverse resolves."""
    return UndefinedError(
        f"{what} has principal values so far apart that neither it nor its inverse knows "
        "those "
        "between",
        code="ill-conditioned",
        values={"known": numerics.LOST_ERROR, "unknown": int(np.isnan(values).sum())},
    )


def stiffnesses_of_motions(
    twists: Array, stiffness: Array, is_singular: NDArray[np.bool_] | np.bool_
) -> Array:
    """``t^T K t`` (N,) of motions t, the other freedoms held;
    NaN where its digits are lost.

    Parameters
    ----------
    twists : ndarray, shape (N, 6)
        t.
    stiffness : ndarray, shape (N, 6, 6)
        K, symmetric.
    is_singular : ndarray of bool (N,)
        K has no inverse: what may be rounding of its terms is zero.
    """
    values, terms = (
        np.einsum("ni,nij,nj->n", t, K, t)
        for t, K in ((twists, stiffness), (np.abs(twists), np.abs(stiffness)))
    )
    rounding, size = numerics.EPSILON * terms, np.abs(values)
    doubtful = rounding > numerics.REPORTED_ERROR * size
    is_zero = doubtful & is_singular & (size <= numerics.ZERO_SHARE * terms)
    values[doubtful & (rounding > numerics.LOST_ERROR * size)] = np.nan
    values[is_zero] = 0.0
    return values


def loss_of_elimination(matrix: ArrayLike, keep: slice) -> float:
    """Relative error of `eliminate` over that of its matrix, by cancellation;
    may be infinite.
    """
    return _plainly_eliminated(real_array(matrix), keep)[1]


def scale_jacobian(J: Array, length: float) -> Array:
    """Jacobian of the twist (length * omega, v)."""
    scaled: Array = J * np.repeat([length, 1.0], 3)[:, None]
    return scaled


def reach(J: Array) -> float:
    """Length that balances the rotation and translation rows of J, for rank decisions."""
    rotation, translation = np.linalg.norm(J[:3]), np.linalg.norm(J[3:])
    return float(translation / rotation) if rotation > 0 and translation > 0 else 1.0


def require_full_rank(J: Array) -> None:
    """Raise UndefinedError ("fewer-than-six-freedoms" or "singular") unless J
    has rank six.
    """
    length = reach(J)
    values = np.linalg.svd(scale_jacobian(J, length), compute_uv=False)
    if J.shape[1] < 6 or not values[5] > numerics.RANK * values[0]:
        deficient = J.shape[1] < 6
        raise UndefinedError(
            "the joints do not move the end-effector in all six directions: no joint "
            "stiffness "
            "gives a Cartesian stiffness here",
            code="fewer-than-six-freedoms" if deficient else "singular",
            values={
                "singular_values": values.tolist(),
                "length": length,
                "joints": J.shape[1],
            },
        )
