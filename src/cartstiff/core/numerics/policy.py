r"""The numeric policy: when a number counts as zero, a matrix as singular,
a sum as balanced.

Every decision about rank, definiteness and invertibility is made in this package, with
these rules:

* A rank is that of a *Jacobian*, on length-scaled rows and columns, at `RANK`. As
  stiffness is proportional to the inverse square of its singular values, a regular
  posture may have a stiffness matrix of condition ``RANK^-2 = 1e20``, which never decides
  a rank.
* A matrix of stiffnesses is *equilibrated* before it is inverted or judged: rows and
  columns are divided by sizes s so that the largest entries are about 1. Units cancel,
  and springs of 1e-3 and 1e15 in one arm do not affect each other.
* A number counts as zero in comparison with the forces and stiffnesses along the same
  motion.
* Eigenvalues come from a matrix *and* its inverse: the large ones from the matrix, the
  small ones from the inverse, as these are the accurate ones.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

#: Spacing of doubles at 1.
EPSILON: Final = float(np.finfo(float).eps)
#: Rank of a Jacobian is lost below this ratio of singular values: ten of sixteen digits
#: are gone, and the rounded constants of a URDF (twelve digits) must not make a singular
#: posture regular.
RANK: Final = 1e-10
#: A singularity is near below this ratio of singular values: stiffnesses, which go with
#: its square, then differ by more than a factor of 400 between directions.
NEAR_SINGULARITY: Final = 0.05
#: An eigenvalue below this share of the largest is round-off of a product of a few
#: matrices of doubles.
ZERO_SHARE: Final = 1e-13
#: A motion costs no energy if its stiffness is below this share of the terms in its sum.
FREE_MOTION_STIFFNESS: Final = 1e-11
#: An equilibrated matrix is singular above this condition number: all but two digits are
#: gone.
LARGEST_INVERTIBLE_CONDITION: Final = 1e14
#: A motion is balanced if the force along it is below this share of the forces in its
#: sum,
BALANCE_TOLERANCE: Final = 1e-8
#: or below that of its springs for a round-off of this size (rad, or shares of the
#: characteristic length) in the coordinates.
ROUNDOFF: Final = 1e-12
#: A relative error above this is reported in a note.
REPORTED_ERROR: Final = 1e-9
#: Squares of frequencies that differ by less than this share belong to one subspace: any
#: motion in it has the same frequency to six digits, and single directions are arbitrary.
REPEATED_FREQUENCY: Final = 1e-6
#: A number with a relative error above this does not count: it needs four digits.
LOST_ERROR: Final = 1e-4
#: Up to this condition number a stiffness and its inverse together determine all
#: principal values: those in the middle lose its root, 3e5 of 4e15.
LARGEST_PAIRED_CONDITION: Final = 1e11
#: Up to this product of the norms of an equilibrated matrix and its inverse the inverse
#: has twelve digits, and needs no other method.
WELL_CONDITIONED: Final = 4e3
#: An asymmetry below this share of the block's size counts as round-off.
SYMMETRY: Final = 1e-9
#: A row whose part that is independent of others is a smaller share of it counts as
#: dependent: squares of rows, which have twice as few digits, then determine its part no
#: more.
DEPENDENT_ROW: Final = 1e-7
#: An unknown is not part of a direction that the rows leave undetermined if its entry is
#: below this: measurements have fewer digits.
NEGLIGIBLE_SHARE: Final = 1e-6

#: Divisor instead of 0 where the dividend vanishes, too.
TINY: Final = 1e-300


def norm(array: ArrayLike) -> float:
    """Euclidean length of a vector, Frobenius norm of a matrix."""
    return float(np.linalg.norm(array))


def largest(array: ArrayLike) -> float:
    """Largest absolute value of an array, the size beside which others count as zero;
    0 of an empty one.
    """
    return float(np.abs(array).max(initial=0.0))


def silent() -> np.errstate:
    """A context in which a quotient of zero is infinite or NaN without a warning."""
    return np.errstate(divide="ignore", invalid="ignore")


def rank(values: ArrayLike, rounding: float = 0.0) -> int:
    """Number of singular values of a length-scaled Jacobian (descending) that
    are not zero.

    `rounding` bounds the round-off of the Jacobian's entries.
    """
    v = np.asarray(values, float).tolist()
    least = max(RANK * max(max(v, default=0.0), TINY), rounding)
    return sum(x > least for x in v)


def ratio(values: ArrayLike) -> float:
    """Smallest over largest of some singular values.

    0 if there are none or all vanish.
    """
    v = np.asarray(values, float).tolist()
    largest = max(v, default=0.0)
    return min(v) / largest if largest > 0.0 else 0.0


def is_regular(values: ArrayLike) -> bool:
    """Whether no singular value of a length-scaled Jacobian counts as zero."""
    return ratio(values) > RANK


def still_halves(jacobian: Array) -> list[slice]:
    """Rows of a length-scaled Jacobian (6, n), angular or linear,
    that vanish beside the others.

    A body that moves on axes which are parallel to ten digits does not rotate.
    """
    halves, least = (slice(0, 3), slice(3, 6)), RANK * norm(jacobian)
    return [half for half in halves if norm(jacobian[half]) <= least]


def clear_still_halves(compliances: Array, length: float) -> None:
    """Set to zero the half of compliances (N, 6, 6) that is round-off, angular or linear.

    The criterion is that of `still_halves`, squared like the Jacobian in the compliance.
    """
    sizes = np.array([length, length, length, 1.0, 1.0, 1.0])
    squares = (compliances * sizes[:, None] * sizes) ** 2
    halves = (slice(0, 3), slice(3, 6))
    norms = [np.sqrt(squares[:, half, half].sum(axis=(1, 2))) for half in halves]
    for half, own, other in zip(halves, norms, reversed(norms), strict=True):
        still = own <= RANK**2 * other
        compliances[still, half] = 0.0
        compliances[still, :, half] = 0.0


def is_symmetric(matrix: Array) -> bool:
    """Whether a square matrix is exactly symmetric."""
    if matrix.size <= 64:  # comparing lists is faster
        return bool(matrix.tolist() == matrix.T.tolist())
    return bool((matrix == matrix.T).all())


def asymmetry(matrix: Array) -> float:
    """Largest entry of ``|M - M^T|``; 0 if it is round-off of the largest entry of M."""
    skew = largest(matrix - matrix.T)
    return skew if skew > SYMMETRY * largest(matrix) else 0.0


def is_about_symmetric(matrix: Array) -> NDArray[np.bool_]:
    """Whether the asymmetry of square matrices (..., n, n) may be round-off; (...)."""
    s = np.sqrt(np.abs(np.diagonal(matrix, 0, -2, -1)))
    skew = np.abs(matrix - matrix.swapaxes(-1, -2))
    symmetric: NDArray[np.bool_] = np.all(
        skew <= SYMMETRY * s[..., :, None] * s[..., None, :], axis=(-2, -1)
    )
    return symmetric
