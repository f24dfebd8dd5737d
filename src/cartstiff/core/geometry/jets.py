"""Numbers with first and second derivatives, for energies in a few variables."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from cartstiff.core.arrays import Array

# Series of the arc tangent of recorded numbers, exact to round-off up to 0.2.
_ARC_TANGENT = [(-1.0) ** k / (2 * k + 1) for k in range(12)]


def _each(name: str, x: Array) -> Array:
    """Apply a function to every number; recorded numbers have it as a method."""
    if x.dtype != object:
        return np.asarray(getattr(np, name)(x))
    own = [
        getattr(v, name)() if hasattr(v, name) else getattr(math, name)(v) for v in x.flat
    ]
    values = np.empty(x.size, object)
    values[:] = own
    return values.reshape(x.shape)


def sines_of(x: Array) -> Array:
    """Sines of numbers, which may be recorded."""
    return _each("sin", x)


def cosines_of(x: Array) -> Array:
    """Cosines of numbers, which may be recorded."""
    return _each("cos", x)


def _arc_tangents(x: Array) -> Array:
    if x.dtype != object:
        return np.asarray(np.arctan(x))
    squares, total = x * x, np.zeros(x.shape, object)
    for c in reversed(_ARC_TANGENT):
        total = total * squares + c
    return total * x


class Jet:
    """Values (...,) of a function of n variables, with gradients (..., n),
    Hessians (..., n, n).

    Sums, products and functions of jets are jets: the derivatives are exact.
    """

    __slots__ = ("gradient", "hessian", "value")
    __array_ufunc__ = None  # arrays leave the arithmetic to the jet

    def __init__(self, value: Array, gradient: Array, hessian: Array) -> None:
        self.value = value
        self.gradient = gradient
        self.hessian = hessian

    def apply(self, value: Array, slope: Array, curvature: Array) -> Jet:
        """Function of this jet with the given value and derivatives there."""
        g = self.gradient
        H = slope[..., None, None] * self.hessian
        H = H + curvature[..., None, None] * (g[..., :, None] * g[..., None, :])
        return Jet(value, slope[..., None] * g, H)

    def __add__(self, other: Jet | Array | float) -> Jet:
        if isinstance(other, Jet):
            return Jet(
                self.value + other.value,
                self.gradient + other.gradient,
                self.hessian + other.hessian,
            )
        return Jet(self.value + other, self.gradient, self.hessian)

    __radd__ = __add__

    def __neg__(self) -> Jet:
        return Jet(-self.value, -self.gradient, -self.hessian)

    def __sub__(self, other: Jet | Array | float) -> Jet:
        return self + (-other)

    def __rsub__(self, other: Array | float) -> Jet:
        return -self + other

    def __mul__(self, other: Jet | Array | float) -> Jet:
        if isinstance(other, Jet):
            a, b = self.value, other.value
            cross = self.gradient[..., :, None] * other.gradient[..., None, :]
            H = a[..., None, None] * other.hessian + b[..., None, None] * self.hessian
            H += cross
            H += cross.swapaxes(-1, -2)
            return Jet(
                a * b, a[..., None] * other.gradient + b[..., None] * self.gradient, H
            )
        k = np.asarray(other, float)
        return Jet(
            k * self.value,
            k[..., None] * self.gradient,
            k[..., None, None] * self.hessian,
        )

    __rmul__ = __mul__

    def __getitem__(self, index: Any) -> Jet:
        """Some of the values, by an index of their axes."""
        return Jet(self.value[index], self.gradient[index], self.hessian[index])

    def combined(self, matrix: Array) -> Jet:
        """Sums (..., k) of the values on the last axis (..., j),
        with coefficients (k, j).
        """
        return Jet(
            self.value @ matrix.T,
            matrix @ self.gradient,
            np.einsum("kj,...jab->...kab", matrix, self.hessian),
        )

    def among(self, selection: Array) -> Jet:
        """The same in m variables, `selection` (..., n, m) being rates of the n
        present ones.
        """
        turned = selection.swapaxes(-1, -2)
        gradient = (self.gradient[..., None, :] @ selection)[..., 0, :]
        return Jet(self.value, gradient, turned @ self.hessian @ selection)

    def sin(self) -> Jet:
        """Sine."""
        s, c = sines_of(self.value), cosines_of(self.value)
        return self.apply(s, c, -s)

    def cos(self) -> Jet:
        """Cosine."""
        s, c = sines_of(self.value), cosines_of(self.value)
        return self.apply(c, -s, -c)

    def tan(self) -> Jet:
        """Tangent."""
        t = sines_of(self.value) / cosines_of(self.value)
        return self.apply(t, 1 + t * t, 2 * t * (1 + t * t))

    def atan(self) -> Jet:
        """Arc tangent."""
        slope = 1 / (1 + self.value * self.value)
        return self.apply(
            _arc_tangents(self.value), slope, -2 * self.value * (slope * slope)
        )


def variables(values: Array) -> list[Jet]:
    """The n variables themselves as jets, from their values (..., n)."""
    n = values.shape[-1]
    zero = np.zeros((*values.shape[:-1], n, n))
    eye = np.broadcast_to(np.eye(n), zero.shape)
    return [Jet(values[..., i], eye[..., i, :], zero) for i in range(n)]


def stacked(jets: Sequence[Jet]) -> Jet:
    """Stack k jets (...) to one (..., k)."""
    return Jet(
        np.stack([jet.value for jet in jets], axis=-1),
        np.stack([jet.gradient for jet in jets], axis=-2),
        np.stack([jet.hessian for jet in jets], axis=-3),
    )
