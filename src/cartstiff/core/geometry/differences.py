"""Numerical differentiation, for functions without given derivatives."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from cartstiff.core.arrays import Array

# Eighth-order central differences: with a step of 2e-2 of the argument's natural unit the
# truncation (step^8 times a ninth derivative over 630) and the rounding are both near
# 1e-14.
STEP = 2e-2
_FIRST = ((1, 4 / 5), (2, -1 / 5), (3, 4 / 105), (4, -1 / 280))
# Sixth order, from the three nearest pairs; the difference from eighth order estimates
# the error.
_FIRST_OF_THREE = (3 / 4, -3 / 20, 1 / 60, 0.0)
_SECOND = ((1, 8 / 5), (2, -1 / 5), (3, 8 / 315), (4, -1 / 560))
_SECOND_AT_ZERO = -205 / 72


def derivative(f: Callable[[float], ArrayLike], step: float = STEP) -> Array:
    """Derivative of ``f`` at 0, f from a number to an array."""
    total: Array | float = 0.0
    for m, weight in _FIRST:
        total = total + weight * (np.asarray(f(m * step)) - np.asarray(f(-m * step)))
    return np.asarray(total / step, float)


def derivative_with_error(
    f: Callable[[float], ArrayLike], step: float
) -> tuple[Array, Array]:
    """`derivative`, and its change from sixth to eighth order,
    which exceeds its error.
    """
    pairs = np.array(
        [np.asarray(f(m * step)) - np.asarray(f(-m * step)) for m, _ in _FIRST]
    )
    slope = np.tensordot([weight for _, weight in _FIRST], pairs, 1) / step
    return slope, np.abs(slope - np.tensordot(_FIRST_OF_THREE, pairs, 1) / step)


def jacobian(f: Callable[[Array], ArrayLike], scale: ArrayLike) -> Array:
    """Jacobian (..., n) of ``f`` at 0, f from (n,) to an array (...); the new axis comes
    last. Its unit is that of f per unit of the argument.

    Parameters
    ----------
    f : callable
        Function of an array (n,), in any units.
    scale : array_like, shape (n,)
        Natural size of each argument, in its unit; steps are `STEP` times it.
    """
    scale = np.asarray(scale, float)
    columns = []
    for e, s in zip(np.eye(scale.size), scale, strict=True):
        columns.append(derivative(lambda t, e=e: f(t * e), STEP * s))  # type: ignore[misc]
    return np.stack(columns, axis=-1)


def gradient_and_hessian(
    f: Callable[[Array], float], scale: ArrayLike, step: float = STEP
) -> tuple[Array, Array]:
    """Gradient (n,) and Hessian (n, n) of a scalar function at 0, by eighth-order central
    differences.

    The mixed second derivatives come from second differences along e_i + e_j and e_i -
    e_j.

    Parameters
    ----------
    f : callable
        Function of an array (n,), in any units, that returns a number.
    scale : array_like, shape (n,)
        Natural size of each argument, in its unit.
    step : float
        Steps as a share of it.
    """
    scale = np.asarray(scale, float)
    n = scale.size
    at_zero = f(np.zeros(n))

    def second(direction: Array) -> float:
        total = _SECOND_AT_ZERO * at_zero
        for m, weight in _SECOND:
            total += weight * (f(m * step * direction) + f(-m * step * direction))
        return float(total / step**2)

    basis = np.diag(scale)
    gradient = np.array([derivative(lambda t, e=e: f(t * e), step) for e in basis])  # type: ignore[misc]
    hessian = np.empty((n, n))
    for i in range(n):
        hessian[i, i] = second(basis[i])
        for j in range(i):
            mixed = second(basis[i] + basis[j]) - second(basis[i] - basis[j])
            hessian[i, j] = hessian[j, i] = 0.25 * mixed
    return gradient / scale, hessian / np.outer(scale, scale)
