"""Steps that close a chain at one posture, from recorded arithmetic."""

from __future__ import annotations

from collections.abc import Mapping
from math import inf

import numpy as np

from cartstiff.core import numerics
from cartstiff.core.arrays import Array
from cartstiff.core.mechanisms.closures import LONGEST_STEP
from cartstiff.recorded.algebra import PLAIN
from cartstiff.recorded.closed_chains import STEPS, Closings, is_shut
from cartstiff.recorded.execution import CompiledPosture, OnePosture, PrintedPosture
from cartstiff.recorded.kernels import has_package
from cartstiff.recorded.plans import CLOSING, TracedModel, program_for
from cartstiff.recorded.tape import Program as Tape


def one_posture(program: Tape, shared: Mapping[str, Array]) -> OnePosture:
    """A program for one posture at a time: machine code if it can be made."""
    make = CompiledPosture if has_package("llvmlite") else PrintedPosture
    return make(program, shared)


class Assembly:
    """Closes a chain as `Chain.closed` does, its motors held.

    Attributes
    ----------
    step : OnePosture
        One step towards closure.
    """

    def __init__(self, taken: TracedModel) -> None:
        self.step, self._home = (
            one_posture(program_for(taken.case, CLOSING), {}),
            taken.home,
        )

    def __call__(self, q: Array) -> Array | None:
        """Coordinates that close the chain, as `Chain.closed` finds them;
        None if not found.
        """
        home = self._home
        if home is None or not (steps := home.steps_where_asked(q[None])).any():
            return self._near(q)

        def near(start: Array) -> Closings:
            at = self._near(start[0])
            shut = np.array([at is not None])
            return start if at is None else at[None], shut, ~shut

        at, is_closed, _ = home.continue_from(near, q[None], steps)
        return at[0] if is_closed[0] else None

    def _near(self, q: Array) -> Array | None:
        """The steps of `closed_chains.close` for one posture.

        None if these do not close it.
        """
        left, size, best, futile = self.step.at["left"], inf, inf, 0
        for _ in range(STEPS):
            record, before = self.step.record(q=q), size
            size, step, length, doubt = record[left].tolist()
            if is_shut(size, step, length, before):
                return q
            futile = 0 if size < 0.9 * best else futile + 1
            best = min(best, size)
            if (
                doubt != PLAIN
                or not step < inf
                or (futile >= numerics.MAX_FUTILE_STEPS and step < LONGEST_STEP)
            ):
                return None
            q = record[: len(q)]
        return None
