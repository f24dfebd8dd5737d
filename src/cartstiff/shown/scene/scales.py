"""How large a value is drawn, and what the legend says about it.

A scale follows from the values alone, and from usual ones of the mechanism: the same
matrix is drawn alike, whatever was drawn before. The legend says what the scale is.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import ceil, floor, inf, isfinite, log, log1p, log10
from typing import Any, ClassVar, Literal, Self

import numpy as np
from numpy.typing import ArrayLike

from cartstiff.core import numerics


def round_number(x: float) -> float:
    """The largest of 1, 2, 5 times a power of ten that does not exceed x > 0."""
    power = floor(log10(x))
    lead = x / 10.0**power
    if lead >= 5 * (1 - numerics.ROUNDOFF):
        step = 5.0
    elif lead >= 2 * (1 - numerics.ROUNDOFF):
        step = 2.0
    else:
        step = 1.0
    return float(f"{step}e{power}")


# A largest value beyond this many times the next one, near a singularity, does not set
# the scale.
_LARGEST_RATIO = 30.0


@dataclass(frozen=True)
class Linear:
    """Length = value / `per_length`, a round number of value units per unit of length.

    Longer than `most` nothing is drawn: the stiff axis near a singularity is cut there.
    """

    per_length: float = 0.0
    most: float = inf
    kind: ClassVar[Literal["linear", "root"]] = "linear"
    _power: ClassVar[int] = 1
    _least: ClassVar[float] = 0.05

    @classmethod
    def from_values(
        cls, values: ArrayLike, target: float, usual: ArrayLike = (), *, cut: bool = False
    ) -> Self:
        """A scale for values (...), of any shape and unit, that are drawn together, the
        largest about `target` long.

        The scale of `usual` values (...) is kept as long as a length is of use; else it
        is whole powers of ten away. With `cut` a largest value that lies far apart is
        cut, and the others are seen.
        """
        largest = _bounded_largest if cut else max
        sizes, area = _sizes(values), target**cls._power
        if not sizes:
            return cls()
        # Rounded down, so that a value is drawn up to 2.5 times the target length at
        # most.
        per = round_number(1.6 * largest(_sizes(usual) or sizes) / area)
        if not cls._least < (size := largest(sizes) / per / area) <= 2.5:
            per *= 10.0 ** ceil(log10(size / 2.5))
        return cls(per, target * 2.5 ** (1.0 / cls._power) if cut else inf)

    @classmethod
    def from_legend(cls, facts: Mapping[str, Any]) -> Self:
        """The scale that a legend says: `facts` as `legend` returns them."""
        return cls(facts["value_per_length"] or 0.0, facts["cut_at"] or inf)

    def length(self, value: float) -> float:
        """Length of an absolute value."""
        if not self.per_length:
            return 0.0
        return min((abs(value) / self.per_length) ** (1.0 / self._power), self.most)

    def legend(self) -> dict[str, Any]:
        """Return the meaning of a length."""
        cut_at = self.most if self.most < inf else None
        return {
            "kind": self.kind,
            "value_per_length": self.per_length or None,
            "cut_at": cut_at,
        }


@dataclass(frozen=True)
class Root(Linear):
    """Length = sqrt(value / `per_length`): soft and stiff are both seen.

    `per_length` is a round number, the value that one unit of length stands for; no
    length is above `most`.
    """

    kind = "root"
    _power = 2
    _least = 0.02


@dataclass(frozen=True)
class Logarithmic:
    """Length = `per_decade` log10(value / `zero`).

    A value of `zero` or less has no length.
    """

    zero: float = 0.0
    per_decade: float = 0.0
    most: ClassVar[float] = inf
    kind: ClassVar[Literal["log"]] = "log"

    @classmethod
    def from_values(
        cls,
        values: ArrayLike,
        target: float,
        usual: ArrayLike = (),
        *,
        cut: bool = False,  # noqa: ARG003
    ) -> Self:
        """A scale for values (...), of any shape and unit, that are drawn together, the
        largest about `target` long.

        The scale of `usual` values (...) is kept as long as a length is of use. Nothing
        has to be `cut`.
        """
        if not (sizes := _sizes(values)):
            return cls()
        zero, per_decade = cls._round(sizes, target)
        if known := _sizes(usual):
            first, step = cls._round(known, target)
            reach = (log10(max(sizes)) - first) * step / target
            if 0.3 <= log10(_smallest(sizes)) - first <= 3.5 and 0.6 <= reach <= 1.3:
                zero, per_decade = first, step
        return cls(float(f"1e{zero}"), per_decade)

    @classmethod
    def from_legend(cls, facts: Mapping[str, Any]) -> Self:
        """The scale that a legend says: `facts` as `legend` returns them."""
        return cls(facts["zero_at"] or 0.0, facts["length_per_decade"] or 0.0)

    @staticmethod
    def _round(sizes: list[float], target: float) -> tuple[int, float]:
        """log10 of `zero`, and `per_decade`."""
        zero = floor(log10(_smallest(sizes)) - 0.7)
        return zero, target / ceil(log10(max(sizes)) - zero)

    def length(self, value: float) -> float:
        """Length of an absolute value."""
        if self.zero:
            return log10(max(abs(value) / self.zero, 1.0)) * self.per_decade
        return 0.0

    def legend(self) -> dict[str, Any]:
        """Return the meaning of a length."""
        return {
            "kind": self.kind,
            "zero_at": self.zero or None,
            "length_per_decade": self.per_decade or None,
        }


def _sizes(values: ArrayLike) -> list[float]:
    """Absolute values that are finite, if there is one above zero."""
    sizes = [abs(v) for v in np.asarray(values, float).ravel().tolist() if isfinite(v)]
    return sizes if any(sizes) else []


def _bounded_largest(sizes: list[float]) -> float:
    """The largest value, but at most `_LARGEST_RATIO` times the next."""
    *_, following, largest = (0.0, *sorted(sizes))
    return min(largest, _LARGEST_RATIO * following) if following else largest


def _smallest(sizes: list[float]) -> float:
    """The smallest value; round-off beside the largest counts as zero and
    has no length.
    """
    return min(v for v in sizes if v > numerics.ZERO_SHARE * max(sizes))


Scale = Linear | Root | Logarithmic
#: By name; the first is that of pictures where nothing else is chosen.
SCALES: dict[str, type[Linear | Logarithmic]] = {
    "root": Root,
    "linear": Linear,
    "log": Logarithmic,
}


class Growing:
    """Lengths of arrows: a larger value never has a shorter one,
    whatever was drawn before.

    Length = `per_decade` log10(1 + value / `zero`): a quarter of `target` for each factor
    of ten above `zero`, and a proportional length far below it.

    Parameters
    ----------
    target : float
        Length of 10^4 times `zero`.
    zero : float
        Value at which lengths begin.
    """

    def __init__(self, target: float, zero: float) -> None:
        self.per_decade, self.zero = target / 4.0, zero

    def length(self, value: float) -> float:
        """Length of an absolute value."""
        return self.per_decade * log1p(abs(value) / self.zero) / log(10.0)

    def legend(self) -> dict[str, Any]:
        """Return the meaning of a length."""
        return {"kind": "log", "zero_at": self.zero, "length_per_decade": self.per_decade}


@dataclass(frozen=True)
class Tension:
    """Colours of tensions between round limits of either sign; in plain numbers, as
    NumPy is slower on six.
    """

    limit: float = 0.0

    @classmethod
    def from_values(cls, tensions: Sequence[float]) -> Self:
        """The limits for tensions that are drawn together."""
        largest = max(map(abs, tensions), default=0.0)
        if not 0.0 < largest < np.inf:
            return cls()
        limit = 2.0 * round_number(largest)
        return cls(limit if limit >= largest else 5.0 * round_number(largest))

    def share(self, tension: float) -> float:
        """A tension over the limit, within [-1, 1]."""
        return min(max(tension / self.limit, -1.0), 1.0) if self.limit else 0.0

    def legend(self) -> dict[str, Any]:
        """The limits of the colour bar: compression below zero."""
        return {"limits": [-self.limit, self.limit]}
