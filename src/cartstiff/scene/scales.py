"""How large a value is drawn, and what the legend says about it.

A scale stays as it is while the picture remains of a useful size, so that postures can be compared;
it then moves on to the next round number, and the legend says so.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from math import ceil, floor, isfinite, log10
from typing import Any, Literal, Self

import numpy as np
from numpy.typing import ArrayLike

from cartstiff import numerics
from cartstiff.geometry.se3 import Array

__all__ = ["Linear", "Logarithmic", "Scale", "Tension", "round_number"]


def round_number(x: float) -> float:
    """The largest of 1, 2, 5 times a power of ten that does not exceed x > 0."""
    power = floor(log10(x))
    lead = x / 10.0**power
    step = 5.0 if lead >= 5 * (1 - 1e-12) else 2.0 if lead >= 2 * (1 - 1e-12) else 1.0
    return float(f"{step}e{power}")


class _Scale(ABC):
    """A scale that follows the values, or is settled by those that are drawn together.

    Parameters
    ----------
    target : float
        Length the largest value is drawn with, about.
    """

    def __init__(self, target: float) -> None:
        self._target = target
        self._settled = False

    @classmethod
    def from_values(cls, values: ArrayLike, target: float) -> Self:
        """A scale for values (any shape) that are drawn together; it does not change any more."""
        scale = cls(target)
        scale.fit(np.asarray(values, float))
        scale._settled = True
        return scale

    def fit(self, values: Array) -> None:
        """Choose the scale anew if values (any shape) would come out too small or too large."""
        if self._settled:
            return
        sizes = [abs(v) for v in values.ravel().tolist() if isfinite(v)]
        largest = max(sizes, default=0.0)
        if largest > 0.0:
            self._choose(sizes, largest)

    @abstractmethod
    def _choose(self, sizes: list[float], largest: float) -> None: ...

    @abstractmethod
    def length(self, values: Array) -> Array:
        """Lengths of the absolute values."""

    @abstractmethod
    def legend(self) -> dict[str, Any]:
        """What a length means."""


class Linear(_Scale):
    """Length = value / `per_length`, a round number of value units per unit of length.

    `target` is the length the largest value is drawn with, about.
    """

    kind: Literal["linear"] = "linear"
    per_length = 0.0

    def _choose(self, sizes: list[float], largest: float) -> None:  # noqa: ARG002
        if self.per_length and 0.3 < largest / self.per_length / self._target < 1.6:
            return
        # Rounded down, so that a value is drawn up to 2.5 times the target length at most.
        self.per_length = round_number(1.6 * largest / self._target)

    def length(self, values: Array) -> Array:
        """Lengths of the absolute values."""
        if not self.per_length:
            return np.zeros_like(values)
        return np.abs(values) / self.per_length

    def legend(self) -> dict[str, Any]:
        """What a length means."""
        return {"kind": self.kind, "value_per_length": self.per_length or None}


class Logarithmic(_Scale):
    """Length = `per_decade` log10(value / `zero`); a value of `zero` or less has no length.

    `target` is the length the largest value is drawn with, about.
    """

    kind: Literal["log"] = "log"
    zero = 0.0
    per_decade = 0.0

    def _choose(self, sizes: list[float], largest: float) -> None:
        # What is rounding beside the largest counts as zero and has no length.
        small, large = log10(min(v for v in sizes if v > numerics.ZERO * largest)), log10(largest)
        if self.zero:
            zero = log10(self.zero)
            reach = (large - zero) * self.per_decade / self._target
            if 0.3 <= small - zero <= 3.5 and 0.6 <= reach <= 1.3:
                return
        zero = floor(small - 0.7)
        self.zero = float(f"1e{zero}")
        self.per_decade = self._target / ceil(large - zero)

    def length(self, values: Array) -> Array:
        """Lengths of the absolute values."""
        if not self.zero:
            return np.zeros_like(values)
        sizes = np.maximum(np.abs(values), self.zero)
        return np.log10(sizes / self.zero) * self.per_decade

    def legend(self) -> dict[str, Any]:
        """What a length means."""
        return {
            "kind": self.kind,
            "zero_at": self.zero or None,
            "length_per_decade": self.per_decade or None,
        }


Scale = Linear | Logarithmic


class Tension:
    """Colours of tensions between round limits of either sign."""

    def __init__(self) -> None:
        self.limit = 0.0

    def fit(self, tensions: Array) -> None:
        """Choose the limit anew if it is exceeded, or far above what there is."""
        largest = float(np.abs(tensions).max(initial=0.0))
        if 0.0 < largest < np.inf and not 0.15 * self.limit < largest <= self.limit:
            self.limit = 2.0 * round_number(largest)
            if self.limit < largest:
                self.limit = 5.0 * round_number(largest)

    def share(self, tensions: Array) -> Array:
        """Tensions over the limit, within [-1, 1]."""
        return np.clip(tensions / self.limit, -1.0, 1.0) if self.limit else np.zeros_like(tensions)

    def legend(self) -> dict[str, Any]:
        """The limits of the colour bar: compression below zero."""
        return {"limits": [-self.limit, self.limit]}
