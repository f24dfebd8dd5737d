r"""What is common to arms and platforms: from K^B, the wrench and a scale to every output.

The same formulas as in `cartstiff.stiffness`, written on recording numbers. What decides about
rank there by singular values is bounded here by products of norms. A posture that is not well
inside the regular ones gets the verdict `ENGINE` and is computed by the engine itself.
"""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from cartstiff import numerics
from cartstiff.geometry.se3 import Array
from cartstiff.many.algebra import (
    below,
    congruence,
    inverse,
    is_zero,
    norm_squared,
    positive_factor,
    skew,
    zeros,
)
from cartstiff.many.tape import Scalar, absolute, larger, pick
from cartstiff.numerics import EPSILON, NEAR, REPORTED_ERROR
from cartstiff.stiffness.applied_load import DEAD_AT_ORIGIN

#: Verdicts on a posture: the numbers stand; the engine decides; no wrench balances it.
PLAIN, ENGINE, UNBALANCED = 0.0, 1.0, 2.0

#: Condition numbers up to which the numbers here are trusted: of Jacobians (the engine calls them
#: singular at 1 / `cartstiff.numerics.RANK`) and of what is inverted to find a compliance, beyond
#: which the engine equilibrates or tells what is lost.
JACOBIAN_CONDITION, STIFFNESS_CONDITION = numerics.PLAIN_JACOBIAN, numerics.PLAIN_STIFFNESS


#: How well the norm of an inverse is known where it has lost nearly all of its digits, in sizes
#: that the engine may choose a little differently.
_KNOWN_TO = 0.7
#: Share of an inverse up to which what its factors have lost for want of pivots may change it: in
#: millions of matrices of mixed signs 3 % were the most that it did.
_MISSED = 0.1
#: Squared norm beyond which other sizes than those of the diagonal are taken for a matrix.
_UNEVEN = 1e2

#: Largest angle (rad) whose sine the vector code finds to the last digit.
LARGEST_ANGLE = 1e6


def limited(value: Scalar, limit: float) -> Scalar:
    """`PLAIN` where a value is below a limit, else `ENGINE`; also where it is not a number."""
    return pick(value, limit, PLAIN, ENGINE)


def _in_length(matrix: Array, rows: Scalar, columns: Scalar) -> Array:
    """The matrix with its lower rows and right columns multiplied."""
    scaled = matrix.copy()
    scaled[3:] = scaled[3:] * rows
    scaled[:, 3:] = scaled[:, 3:] * columns
    return scaled


def scaled_inverse(K: Array, length: Scalar) -> tuple[Array, Scalar]:
    """Inverse of a stiffness, its lengths measured in `length`, and its squared condition."""
    scaled = _in_length(K, length, length)
    inverted = inverse(scaled)
    return _in_length(inverted, length, length), norm_squared(scaled) * norm_squared(inverted)


def holds_soft_directions(K: Array, wanted: Collection[str]) -> Scalar:
    r"""The verdict on K^B (6, 6) that is wanted without its inverse.

    Beside a compliance it need not hold its softer directions. The engine judges them by
    ``|K| |K^-1|`` in the sizes of the diagonal. With ``K = L d L^T`` and ``X = L^-1`` the second
    norm is that of ``X^T d^-1 X``. Where pivots of both signs have taken its digits, by the norm of
    ``L |d| L^T`` beside K, it is bounded instead by the diagonal of ``X^T |d|^-1 X``.
    """
    kinds = {name.partition("_")[0] for name in wanted}
    if "stiffness" not in kinds or "compliance" in kinds:
        return PLAIN
    sizes = _absolute(K.diagonal())
    L, inverses, pivots = positive_factor(K)
    X = below(L, np.eye(6))
    most: Scalar = _absolute(inverses) @ ((X * X) @ sizes)
    grown: Scalar = (1.0 / sizes) @ ((L * L) @ _absolute(pivots))
    known = squares_over(congruence(X, np.diag(inverses)), 1.0 / sizes)
    softest = pick(grown * grown * known, (_MISSED / EPSILON) ** 2, known, most * most)
    return limited(
        squares_over(K, sizes) * softest, (_KNOWN_TO * numerics.LOST_ERROR / EPSILON) ** 2
    )


def _absolute(values: Array) -> Array:
    return np.array([absolute(x) for x in values], object)


def squares_over(matrix: Array, sizes: Array) -> Scalar:
    """Squared norm of a matrix in sizes of its rows and columns."""
    return (matrix * matrix / np.multiply.outer(sizes, sizes)).sum()


def equilibrated_squares(matrix: Array, inverse: Array) -> tuple[Scalar, Scalar]:
    """Squared norms of a matrix and its inverse in the sizes of the diagonal."""
    sizes = _absolute(matrix.diagonal())
    return squares_over(matrix, sizes), squares_over(inverse, 1.0 / sizes)


def taut_stiffness(stiffness: Scalar, stretch: Scalar) -> Scalar:
    """That of a cable: none where it is slack."""
    return stiffness * pick(stretch, 0.0, 0.0, 1.0)


def unsymmetric_part(W: Array) -> Array:
    """``K^A - K^B``, which the wrench alone makes."""
    moment, force = skew(W[:3] * 0.5), skew(W[3:] * 0.5)
    total = zeros(6, 6)
    total[:3, :3], total[:3, 3:], total[3:, :3] = moment, force, force
    return total


def connections(K_B: Array, W: Array) -> dict[str, Array]:
    """K^A, K^B and K^K from K^B and the wrench."""
    D_A = unsymmetric_part(W)
    D_K = zeros(6, 6)
    D_K[:3, 3:], D_K[3:, :3] = D_A[:3, 3:], -D_A[3:, :3]
    return {"A": K_B + D_A, "B": K_B, "K": K_B + D_K}


def add_compliances(
    arrays: dict[str, Array], stiffness: dict[str, Array], wanted: Collection[str], length: Scalar
) -> Scalar:
    """Put the compliances that are wanted into `arrays`; the largest squared condition of them."""
    largest: Scalar = 0.0
    for name, K in stiffness.items():
        output = f"compliance_{name}"
        if output in wanted:
            arrays[output], condition = scaled_inverse(K, length)
            largest = larger(largest, condition)
    return largest


def noteworthy(
    squared_condition: Scalar, *pairs: tuple[Array, Array], margin: float = 2.0
) -> Array:
    """Two numbers: 1 and more where notes may tell of a near singularity, and of lost digits.

    Bounds on the squared condition of the scaled Jacobian, and on that of matrices which are given
    with their inverses, each divided by the sizes of the diagonal; with a margin, as the engine
    finds them in another order, or along other motions.
    """
    lost: Scalar = 0.0
    for pair in pairs:
        squares, others = equilibrated_squares(*pair)
        lost = larger(lost, squares * others * (margin * EPSILON / REPORTED_ERROR) ** 2)
        lost = larger(lost, squares / _UNEVEN)
    return np.array([squared_condition * (1.01 * NEAR) ** 2, lost], object)


def changed_compliance(
    C: Array, D: Array, length: Scalar, most: float = STIFFNESS_CONDITION
) -> tuple[Array, Scalar]:
    """``C (1 + D C)^-1``: the inverse of K + D from C = K^-1, and the verdict on it."""
    factor = _in_length(D @ C, length, 1.0 / length)
    factor[range(6), range(6)] = factor.diagonal() + 1.0
    turned = inverse(factor)
    condition = norm_squared(factor) * norm_squared(turned)
    back = _in_length(turned, 1.0 / length, length)
    return C @ back, limited(condition, most**2)


#: Of a dead load at M's origin: K^load, its inverse, that of its symmetric part, and whether both
#: hold.
UNDER_LOAD = ("dead_stiffness", "dead_compliance", "dead_symmetric", "dead_verdict")
_DEAD = np.moveaxis(DEAD_AT_ORIGIN.change(np.eye(6)), 0, -1)


def add_under_load(arrays: dict[str, Array], wanted: Collection[str], length: Scalar) -> None:
    """Put `UNDER_LOAD` into `arrays` where they are wanted, and not those without a load."""
    is_wanted = "dead_stiffness" in wanted and {"stiffness_B", "compliance_B"} <= arrays.keys()
    if not is_wanted or all(is_zero(w) for w in arrays["wrench"]):
        return
    C, D = arrays["compliance_B"], _DEAD @ arrays["wrench"]
    arrays["dead_stiffness"] = arrays["stiffness_B"] + D
    arrays["dead_compliance"], doubt = changed_compliance(C, D, length)
    arrays["dead_symmetric"], other = changed_compliance(C, (D + D.T) * 0.5, length)
    arrays["dead_verdict"] = np.array([larger(doubt, other)], object)


def shared_inputs(wrench: str) -> list[str]:
    """Inputs with one row for all postures; `wrench` is "none", "shared" or "each"."""
    own = ["stiffness", "rest", "forces", "weight", "lines", "anchors", "points", "length"]
    return own + (["wrench"] if wrench == "shared" else [])
