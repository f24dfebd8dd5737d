r"""A posture for an arm whose file names none: zero is singular for nearly every industrial arm.

Candidates are points of a low-discrepancy sequence (Kronecker's with the generalised golden ratio:
the same every time) around zero, in a quarter, half and all of the joints' ranges. Each is judged
by the ratio of the smallest to the largest singular value of the body Jacobian, lengths in units
of the characteristic length at zero.
"""

from __future__ import annotations

import numpy as np

from cartstiff.geometry.se3 import Array
from cartstiff.kinematics.chain_kinematics import Kinematics
from cartstiff.mechanisms.chain import Chain
from cartstiff.mechanisms.elastic import Note
from cartstiff.numerics import NEAR, is_regular

__all__ = ["regular_posture"]

# Candidates of each size, and the shares of the joints' ranges that they are spread over: a larger
# one only where the smaller have none that will do.
_COUNT, _SHARES = 32, (0.25, 0.5, 1.0)
# Of the candidates with twice the ratio that counts as near a singularity the one closest to zero
# is taken.
_ENOUGH = 2.0 * NEAR
# Candidates are rounded so that they can be typed (rad; lengths in shares of their range).
_STEP = 0.05


def regular_posture(chain: Chain, q: Array) -> tuple[Array, list[Note]]:
    """A regular posture (n,) in place of q where q is near a singularity, and a note that says so.

    For arms with six or more joints; q stays where none of the candidates is better.

    Parameters
    ----------
    chain : Chain
        A serial chain.
    q : ndarray (n,)
        Zero, or as near to it as the limits allow.
    """
    free = np.array([j not in chain.virtual for j in range(q.size)], bool)
    if free.sum() < 6:
        return q, []
    posture = chain.at(q)
    rows = np.repeat([1.0, 1.0 / posture.length], 3)[:, None]
    sizes = posture.coordinate_lengths

    kinematics = Kinematics(chain)

    def ratios(postures: Array) -> Array:
        J = kinematics.at(postures).jacobian * rows * sizes
        values = np.linalg.svd(J[:, :, free], compute_uv=False)
        found: Array = values[:, -1] / np.maximum(values[:, 0], 1e-300)
        return found

    (at_zero,) = ratios(q[None])
    if at_zero > NEAR:
        return q, []
    best, largest = q, max(NEAR, float(at_zero))
    for share in _SHARES:
        candidates = _candidates(chain, q, sizes, free, share)
        found = ratios(candidates)
        enough = np.flatnonzero(found >= _ENOUGH)
        away = np.linalg.norm((candidates - q) / sizes, axis=1)
        i = int(enough[np.argmin(away[enough])]) if enough.size else int(np.argmax(found))
        if found[i] > largest:
            best, largest = candidates[i], float(found[i])
        if enough.size:
            break
    if best is q:
        return q, []
    conditions = {
        "condition": 1.0 / largest,
        "condition_at_zero": 1.0 / float(at_zero) if is_regular([1.0, at_zero]) else None,
    }
    zero = "singular" if conditions["condition_at_zero"] is None else "near a singularity"
    words = ", ".join(
        f"{c.name} {value:.4g}" for c, value in zip(chain.coordinates, best, strict=True)
    )
    return best, [
        Note(
            "default-posture",
            f"no posture was given, and zero is {zero}: a regular one is taken, {words} "
            f"(condition of the scaled Jacobian {conditions['condition']:.3g})",
            {"q": best.tolist(), **conditions},
        )
    ]


def _candidates(chain: Chain, q: Array, sizes: Array, free: Array, share: float) -> Array:
    """Postures (k, n) within the limits; what gives stays where it is."""
    n = q.size
    lower = np.array([c.lower for c in chain.coordinates])
    upper = np.array([c.upper for c in chain.coordinates])
    reach = np.where([c.is_length for c in chain.coordinates], sizes, np.pi)
    low, high = np.maximum(lower, q - reach), np.minimum(upper, q + reach)
    # The root g > 1 of g^(n+1) = g + 1: its powers are as badly approximated as can be.
    g = 2.0
    for _ in range(60):
        g = (1.0 + g) ** (1.0 / (n + 1))
    u = 2.0 * np.mod(0.5 + np.outer(np.arange(1, _COUNT + 1), g ** -np.arange(1.0, n + 1)), 1.0) - 1
    sides = np.where(u < 0, q - low, high - q)
    steps = share * u * sides
    step = np.where([c.is_length for c in chain.coordinates], _STEP * (high - low), _STEP)
    rounded = np.round(steps / np.where(step > 0, step, 1.0)) * step
    # Twelve digits: 0.15, and not 0.15000000000000002.
    found: Array = np.clip(np.round(q + rounded, 12), low, high)
    return np.where(free, found, q)
