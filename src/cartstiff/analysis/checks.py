"""Checks of what the user gives to the analysis: shapes, finite numbers, positive lengths."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from cartstiff.errors import InputError
from cartstiff.geometry.se3 import Array

__all__ = ["as_jacobian", "as_length", "as_matrix", "as_unit", "as_vector", "frozen"]


def frozen(values: ArrayLike) -> Array:
    """Read-only copy, for the fields of results."""
    array = np.array(values, float)
    array.flags.writeable = False
    return array


def as_matrix(value: ArrayLike, what: str = "stiffness", size: int = 6) -> Array:
    """Return a finite square matrix of the given size.

    Raises
    ------
    InputError
        If the shape is another one or a number is not finite.
    """
    matrix = np.asarray(value, float)
    if matrix.shape != (size, size):
        raise InputError(
            f"{what} has the wrong shape", expected=f"({size}, {size})", got=matrix.shape
        )
    if not np.isfinite(matrix).all():
        raise InputError(f"{what} must hold finite numbers", got="NaN or infinity")
    return matrix


def as_vector(value: ArrayLike, what: str, size: int) -> Array:
    """Return a finite vector of the given size; InputError otherwise."""
    vector = np.asarray(value, float)
    if vector.shape != (size,):
        raise InputError(f"{what} has the wrong shape", expected=f"({size},)", got=vector.shape)
    if not np.all(np.isfinite(vector)):
        raise InputError(f"{what} must hold finite numbers", got=vector.tolist())
    return vector


def as_unit(value: ArrayLike, what: str = "direction") -> Array:
    """Return a 3-vector scaled to length one; InputError if it is zero."""
    vector = as_vector(value, what, 3)
    norm = float(np.linalg.norm(vector))
    if norm == 0.0:
        raise InputError(f"{what} must not be zero", got=vector.tolist())
    return vector / norm


def as_length(value: float, what: str = "length") -> float:
    """Return a positive finite length; InputError otherwise."""
    number = float(value)
    if not (np.isfinite(number) and number > 0):
        raise InputError(f"{what} cannot be used", expected="a positive length", got=number)
    return number


def as_jacobian(value: ArrayLike) -> Array:
    """Check a (6, n) body Jacobian; InputError otherwise."""
    J = np.asarray(value, float)
    if J.ndim != 2 or J.shape[0] != 6 or J.shape[1] == 0:
        raise InputError("Jacobian has the wrong shape", expected="(6, n)", got=J.shape)
    if not np.all(np.isfinite(J)):
        raise InputError("Jacobian must hold finite numbers", got="NaN or infinity")
    return J
