r"""What is common to arms and platforms: from K^B, the wrench and a scale to every output.

The same formulas as in `cartstiff.stiffness`, written on recording numbers. What decides about
rank there by singular values is bounded here by products of norms. A posture that is not well
inside the regular ones gets the verdict `ENGINE` and is computed by the engine itself.
"""

from __future__ import annotations

from collections.abc import Collection

from cartstiff.geometry.se3 import Array
from cartstiff.many.algebra import inverse, norm_squared, skew, zeros
from cartstiff.many.tape import Scalar, larger, pick

__all__ = ["ENGINE", "PLAIN", "UNBALANCED", "connections", "limited", "scaled_inverse",
           "unsymmetric_part"]  # fmt: skip

#: Verdicts on a posture: the numbers stand; the engine decides; no wrench balances it.
PLAIN, ENGINE, UNBALANCED = 0.0, 1.0, 2.0

#: Condition numbers up to which the numbers here are trusted: of Jacobians (the engine calls them
#: singular at 1e10) and of stiffness matrices (not invertible at 1e14).
JACOBIAN_CONDITION, STIFFNESS_CONDITION = 1e8, 1e12


#: Largest angle (rad) whose sine the vector code finds to the last digit.
LARGEST_ANGLE = 1e6


def limited(value: Scalar, limit: float) -> Scalar:
    """`PLAIN` where a value is below a limit, else `ENGINE`; also where it is not a number."""
    return pick(value, limit, PLAIN, ENGINE)


def scaled_inverse(K: Array, length: Scalar) -> Array:
    """Inverse of a stiffness matrix, its lengths measured in `length`."""
    scaled = K.copy()
    scaled[3:] = scaled[3:] * length
    scaled[:, 3:] = scaled[:, 3:] * length
    found = inverse(scaled)
    found[3:] = found[3:] * length
    found[:, 3:] = found[:, 3:] * length
    return found


def unsymmetric_part(W: Array) -> Array:
    """``K^A - K^B``, which the wrench alone makes."""
    moment, force = skew(W[:3] * 0.5), skew(W[3:] * 0.5)
    found = zeros(6, 6)
    found[:3, :3], found[:3, 3:], found[3:, :3] = moment, force, force
    return found


def connections(K_B: Array, W: Array) -> dict[str, Array]:
    """K^A, K^B and K^K from K^B and the wrench."""
    D_A = unsymmetric_part(W)
    D_K = zeros(6, 6)
    D_K[:3, 3:], D_K[3:, :3] = D_A[:3, 3:], -D_A[3:, :3]
    return {"A": K_B + D_A, "B": K_B, "K": K_B + D_K}


def add_compliances(
    found: dict[str, Array], stiffness: dict[str, Array], wanted: Collection[str], length: Scalar
) -> Scalar:
    """Put the compliances that are wanted into `found`; the verdict on them."""
    verdict: Scalar = PLAIN
    for name, K in stiffness.items():
        output = f"compliance_{name}"
        if output in wanted:
            C = scaled_inverse(K, length)
            found[output] = C
            condition = norm_squared(K) * norm_squared(C)
            verdict = larger(verdict, limited(condition, STIFFNESS_CONDITION**2))
    return verdict
