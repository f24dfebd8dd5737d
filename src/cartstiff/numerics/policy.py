r"""The numeric policy: when a number counts as zero, a matrix as singular, a sum as balanced.

Every decision about rank, definiteness and invertibility is made in this package, with these rules:

* A rank is that of a *Jacobian*, on length-scaled rows and columns, at `RANK`. A stiffness goes
  with the inverse square of its singular values: a regular posture may have a stiffness matrix of
  condition ``RANK^-2 = 1e20``, and no rank is ever decided on it.
* A matrix of stiffnesses is *equilibrated* before it is inverted or judged: rows and columns are
  divided by sizes s so that the largest entries are about 1. Units cancel, and springs of 1e-3 and
  1e15 in one arm do not disturb each other.
* What counts as zero is judged against the forces and stiffnesses that act on that motion.
* Eigenvalues come from a matrix *and* its inverse: the large ones from the matrix, the small ones
  from the inverse, each where it has its digits.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

#: Spacing of doubles at 1.
EPSILON: Final = float(np.finfo(float).eps)
#: Rank of a Jacobian is lost below this ratio of singular values: ten of sixteen digits are gone,
#: and the rounded constants of a URDF (twelve digits) must not make a singular posture regular.
RANK: Final = 1e-10
#: A singularity is called near below this ratio of singular values: stiffness, which goes with the
#: square, then differs by more than 400 between directions.
NEAR: Final = 0.05
#: An eigenvalue below this share of the largest cannot be told from the rounding of a matrix that
#: is the product of a few matrices of doubles.
ZERO: Final = 1e-13
#: A motion costs nothing if its stiffness is below this share of the terms whose sum it is.
IDLE: Final = 1e-11
#: An equilibrated matrix is singular above this condition number: all but two digits are gone.
INVERTIBLE: Final = 1e14
#: A motion is balanced if the force along it is below this share of the forces whose sum it is,
BALANCE: Final = 1e-8
#: or is what the springs that it moves exert over a rounding error of this size (rad, or shares of
#: the characteristic length) in the coordinates.
ROUNDING: Final = 1e-12
#: A relative error above this is told to the reader: it is more than a few digits.
REPORTED_ERROR: Final = 1e-9
#: Squares of frequencies nearer to each other than this share are those of one subspace: within it
#: any motion has the same frequency to six digits, and single directions are chance.
REPEATED: Final = 1e-6
#: A number with a relative error above this is none: four digits are the fewest that tell.
LOST_ERROR: Final = 1e-4
#: Up to this condition number a stiffness and its inverse together hold all principal values: the
#: worst stand in the middle and lose its root, 3e5 of 4e15.
LARGEST_PAIRED_CONDITION: Final = 1e11
#: Up to this product of the norms of an equilibrated matrix and its inverse nothing is to be gained
#: from another way to the inverse: it is known to twelve digits.
WELL_CONDITIONED: Final = 4e3
#: An asymmetry below this share of the block's size is taken for rounding.
SYMMETRY: Final = 1e-9
#: An unknown has no part in a direction that rows do not determine if its entry there is below
#: this: measurements have fewer digits.
NEGLIGIBLE_SHARE: Final = 1e-6

#: Divisor that stands for 0 where what is divided vanishes too.
TINY: Final = 1e-300


def rank(values: ArrayLike, rounding: float = 0.0) -> int:
    """How many of the singular values of a length-scaled Jacobian (descending) are not zero.

    `rounding` is what the Jacobian's own sums may leave where it is zero.
    """
    v = np.asarray(values, float).tolist()
    least = max(RANK * max(max(v, default=0.0), TINY), rounding)
    return sum(x > least for x in v)


def ratio(values: ArrayLike) -> float:
    """Smallest over largest of some singular values; 0 if there are none or all vanish."""
    v = np.asarray(values, float).tolist()
    largest = max(v, default=0.0)
    return min(v) / largest if largest > 0.0 else 0.0


def is_regular(values: ArrayLike) -> bool:
    """Whether none of the singular values of a length-scaled Jacobian counts as zero."""
    return ratio(values) > RANK


def still_halves(jacobian: Array) -> list[slice]:
    """Rows of a length-scaled Jacobian (6, n), turning or moving, that are none beside the others.

    A body that translates on axes which are parallel to ten digits does not turn.
    """
    halves, least = (slice(0, 3), slice(3, 6)), RANK * float(np.linalg.norm(jacobian))
    return [half for half in halves if float(np.linalg.norm(jacobian[half])) <= least]


def clear_still_halves(compliances: Array, length: float) -> None:
    """Zeros in compliances (N, 6, 6) of bodies that turn, or move, no more than by rounding.

    The compliance goes with the square of the Jacobian that `still_halves` looks at.
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
    """Whether a square matrix is its own transpose, to the last digit."""
    if matrix.size <= 64:  # lists are compared sooner, and to the first that differs
        return bool(matrix.tolist() == matrix.T.tolist())
    return bool((matrix == matrix.T).all())


def is_about_symmetric(matrix: Array) -> NDArray[np.bool_]:
    """Whether all of the asymmetry of square matrices (..., n, n) may be rounding; (...)."""
    s = np.sqrt(np.abs(np.diagonal(matrix, 0, -2, -1)))
    skew = np.abs(matrix - matrix.swapaxes(-1, -2))
    symmetric: NDArray[np.bool_] = np.all(
        skew <= SYMMETRY * s[..., :, None] * s[..., None, :], axis=(-2, -1)
    )
    return symmetric
