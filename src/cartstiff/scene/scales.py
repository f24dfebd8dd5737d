"""How large a value is drawn, and what the legend says about it.

A scale follows from the value alone, and from values that it is told to refer to: the same matrix
is drawn alike, whatever was drawn before. The legend says what the scale is.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from math import ceil, floor, isfinite, log, log1p, log10
from typing import Any, Literal, Self

import numpy as np
from numpy.typing import ArrayLike

from cartstiff import numerics
from cartstiff.geometry.se3 import Array


def round_number(x: float) -> float:
    """The largest of 1, 2, 5 times a power of ten that does not exceed x > 0."""
    power = floor(log10(x))
    lead = x / 10.0**power
    step = (
        5.0
        if lead >= 5 * (1 - numerics.ROUNDING)
        else 2.0
        if lead >= 2 * (1 - numerics.ROUNDING)
        else 1.0
    )
    return float(f"{step}e{power}")


class _Scale(ABC):
    """A scale for the values that are drawn next.

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

    def refer(self, values: Array) -> None:
        """Keep to the scale that fits these values (any shape) as long as a size is of use."""
        if (sizes := _sizes(values)) is not None:
            self._refer(*sizes)

    def fit(self, values: Array) -> None:
        """Choose the scale for values (any shape) that are drawn next."""
        if not self._settled and (sizes := _sizes(values)) is not None:
            self._choose(*sizes)

    def copy(self) -> Self:
        """A scale of its own."""
        other = object.__new__(type(self))
        vars(other).update(vars(self))
        return other

    def kept(self, facts: Mapping[str, Any]) -> Self:
        """The scale that a legend says."""
        self._keep(facts)
        self._settled = True
        return self

    @abstractmethod
    def _keep(self, facts: Mapping[str, Any]) -> None: ...

    @abstractmethod
    def _refer(self, sizes: list[float], largest: float) -> None: ...

    @abstractmethod
    def _choose(self, sizes: list[float], largest: float) -> None: ...

    @abstractmethod
    def length(self, values: Array) -> Array:
        """Lengths of the absolute values."""

    @abstractmethod
    def legend(self) -> dict[str, Any]:
        """What a length means."""


def _sizes(values: Array) -> tuple[list[float], float] | None:
    """Absolute values and their largest; None where there is none above zero."""
    sizes = [abs(v) for v in values.ravel().tolist() if isfinite(v)]
    largest = max(sizes, default=0.0)
    return (sizes, largest) if largest > 0.0 else None


class Linear(_Scale):
    """Length = value / `per_length`, a round number of value units per unit of length.

    `target` is the length the largest value is drawn with, about.
    """

    kind: Literal["linear"] = "linear"
    per_length = 0.0
    _reference = 0.0

    def _keep(self, facts: Mapping[str, Any]) -> None:
        self.per_length = facts["value_per_length"] or 0.0

    def _refer(self, sizes: list[float], largest: float) -> None:
        self._reference = self._round(sizes, largest)

    def _choose(self, sizes: list[float], largest: float) -> None:
        self.per_length = self._reference
        if not self._reference:
            self.per_length = self._round(sizes, largest)
        elif not 0.05 < (size := largest / self._reference / self._target) <= 2.5:
            # Whole powers of ten: the length then lies between a quarter and 2.5 times the target.
            self.per_length *= 10.0 ** ceil(log10(size / 2.5))

    def _round(self, sizes: list[float], largest: float) -> float:  # noqa: ARG002
        # Rounded down, so that a value is drawn up to 2.5 times the target length at most.
        return round_number(1.6 * largest / self._target)

    def length(self, values: Array) -> Array:
        """Lengths of the absolute values."""
        if not self.per_length:
            return np.zeros_like(values)
        return np.abs(values) / self.per_length

    def legend(self) -> dict[str, Any]:
        """What a length means."""
        return {"kind": self.kind, "value_per_length": self.per_length or None}


class Root(Linear):
    """Length = sqrt(value / `per_length`): soft and stiff are both seen, and nothing is cut off.

    `per_length` is a round number, the value that one unit of length stands for; `target` is the
    length the largest value is drawn with, about.
    """

    kind: Literal["root"] = "root"  # type: ignore[assignment]

    def _choose(self, sizes: list[float], largest: float) -> None:
        self.per_length = self._reference or self._round(sizes, largest)
        size = largest / self.per_length / self._target**2
        if not 0.02 < size <= 2.5:
            self.per_length *= 10.0 ** ceil(log10(size / 2.5))

    def _round(self, sizes: list[float], largest: float) -> float:  # noqa: ARG002
        return round_number(1.6 * largest / self._target**2)

    def length(self, values: Array) -> Array:
        """Lengths of the absolute values."""
        return np.sqrt(super().length(values))


class Logarithmic(_Scale):
    """Length = `per_decade` log10(value / `zero`); a value of `zero` or less has no length.

    `target` is the length the largest value is drawn with, about.
    """

    kind: Literal["log"] = "log"
    zero = 0.0
    per_decade = 0.0
    _reference: tuple[float, float] | None = None  # log10 of `zero`, and `per_decade`

    def _keep(self, facts: Mapping[str, Any]) -> None:
        self.zero = facts["zero_at"] or 0.0
        self.per_decade = facts["length_per_decade"] or 0.0

    def _refer(self, sizes: list[float], largest: float) -> None:
        self._reference = self._round(sizes, largest)

    def _choose(self, sizes: list[float], largest: float) -> None:
        zero, per_decade = self._round(sizes, largest)
        if self._reference is not None:
            first, step = self._reference
            reach = (log10(largest) - first) * step / self._target
            if 0.3 <= log10(_smallest(sizes, largest)) - first <= 3.5 and 0.6 <= reach <= 1.3:
                zero, per_decade = self._reference
        self.zero, self.per_decade = float(f"1e{zero:.0f}"), per_decade

    def _round(self, sizes: list[float], largest: float) -> tuple[float, float]:
        zero = floor(log10(_smallest(sizes, largest)) - 0.7)
        return zero, self._target / ceil(log10(largest) - zero)

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


def _smallest(sizes: list[float], largest: float) -> float:
    """What is rounding beside the largest counts as zero and has no length."""
    return min(v for v in sizes if v > numerics.ZERO * largest)


Scale = Linear | Root | Logarithmic
#: By name; the first is that of pictures where nothing else is said.
SCALES: dict[str, type[Scale]] = {"root": Root, "linear": Linear, "log": Logarithmic}


class Growing:
    """Lengths of arrows: a larger value never has a shorter one, whatever was drawn before.

    Length = `per_decade` log10(1 + value / `zero`): a quarter of `target` for each factor of ten
    above `zero`, and a proportional length far below it.

    Parameters
    ----------
    target : float
        Length of 10^4 times `zero`.
    zero : float
        Where lengths begin.
    """

    def __init__(self, target: float, zero: float) -> None:
        self.per_decade, self.zero = target / 4.0, zero

    def length(self, value: float) -> float:
        """Length of an absolute value."""
        return self.per_decade * log1p(abs(value) / self.zero) / log(10.0)

    def legend(self) -> dict[str, Any]:
        """What a length means."""
        return {"kind": "log", "zero_at": self.zero, "length_per_decade": self.per_decade}


class Tension:
    """Colours of tensions between round limits of either sign."""

    def __init__(self) -> None:
        self.limit = 0.0

    def fit(self, tensions: Array) -> None:
        """Choose the limit for the tensions that are drawn next."""
        largest = float(np.abs(tensions).max(initial=0.0))
        if 0.0 < largest < np.inf:
            self.limit = 2.0 * round_number(largest)
            if self.limit < largest:
                self.limit = 5.0 * round_number(largest)

    def share(self, tensions: Array) -> Array:
        """Tensions over the limit, within [-1, 1]."""
        if not self.limit:
            return np.zeros_like(tensions)
        return np.minimum(np.maximum(tensions / self.limit, -1.0), 1.0)

    def legend(self) -> dict[str, Any]:
        """The limits of the colour bar: compression below zero."""
        return {"limits": [-self.limit, self.limit]}
