"""The geometry of a mechanism as numbers, and which of them have derivatives."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from cartstiff import numerics
from cartstiff.arrays import Array
from cartstiff.mechanisms.contract import Mechanism, MechanismPosture

#: Begin the names of placements.
PLACED = ("placement", "frame", "closure")
_RXYZ = ("rx", "ry", "rz")


@dataclass(frozen=True, eq=False)
class Placements:
    """Placements, or points, of a mechanism near a posture.

    Attributes
    ----------
    mechanism : Mechanism
        Never modified.
    posture : MechanismPosture
        Its posture.
    is_on_base : bool
        Whether the place of the base matters.
    """

    mechanism: Mechanism
    posture: MechanismPosture
    is_on_base: bool

    @cached_property
    def numbers(self) -> dict[str, float]:
        """Names and values, without `misfits`, see `Mechanism.numbers`."""
        return {name: x for name, x in self._all.items() if name not in self.misfits}

    @staticmethod
    def is_angle(name: str) -> bool:
        """Whether a number is an angle."""
        return name.partition(".")[0] in PLACED and name.rpartition(".")[2] in _RXYZ

    @cached_property
    def misfits(self) -> tuple[str, ...]:
        """Numbers without derivatives: if one is changed, no nearby posture closes.

        To first order: coordinates cannot undo its change of the closures' residual.
        Empty unless the closures are redundant.
        """
        closure, length = self.posture.closure, self.posture.length
        if closure is None:
            return ()
        U, values, _ = np.linalg.svd(closure.jacobian * self.posture.coordinate_lengths)
        held = U[:, int((values > numerics.RANK * values[0]).sum()) :].T
        if not len(held):
            return ()
        names = []
        for name, x in self._all.items():
            step = numerics.DIFFERENCE_STEP * (1.0 if self.is_angle(name) else length)
            more, less = (held @ self._residual({name: x + s}) for s in (step, -step))
            gap = np.abs(more - less).max() / (2.0 * numerics.DIFFERENCE_STEP)
            if gap > numerics.NEGLIGIBLE_STEP * max(1.0, length):
                names.append(name)
        return tuple(names)

    def _residual(self, values: dict[str, float]) -> Array:
        residual = self.mechanism.with_numbers(values).at(self.posture.q).residual
        assert residual is not None  # it has closures
        return residual

    @property
    def words(self) -> str | None:
        """Message on `misfits`; None without any."""
        if not self.misfits:
            return None
        return (
            f"{len(self.misfits)} of {len(self._all)} numbers of the geometry have no "
            "derivative: "
            "the closures hold more than they need, and with such a number changed no "
            "posture "
            f"closes. They are {', '.join(self.misfits)}"
        )

    @cached_property
    def _all(self) -> dict[str, float]:
        """All numbers but masses, and the place of the base where it does not matter."""
        root = "" if self.is_on_base else self.mechanism.root
        left_out = ("mass.", f"placement.{root}.") if root else ("mass.",)
        own = self.mechanism.numbers().items()
        return {name: x.value for name, x in own if not name.startswith(left_out)}
