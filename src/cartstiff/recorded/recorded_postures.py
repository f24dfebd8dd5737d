"""Postures of a page: `analyse` with the numbers of programs, once these are recorded.

A program is recorded once for each kind of load, in a thread of its own, when the page
says so; until then the core answers. The results are those of `cartstiff.analyse`:
numbers of a plainly regular posture come from the program, and whatever else is read of
it is computed then. All other postures are the core's.
"""

from __future__ import annotations

from threading import Thread

from cartstiff.core.arrays import Array
from cartstiff.core.mechanisms.elastic import ElasticMechanism
from cartstiff.core.stiffness.applied_load import Axes, LoadKind
from cartstiff.core.stiffness.compute import PostureStiffness
from cartstiff.recorded.arguments import (
    DETAILS,
    MOTIONS,
    NOTEWORTHY,
    OUTPUTS,
    TENSIONS,
)
from cartstiff.recorded.assembly import Assembly
from cartstiff.recorded.kernels import LARGEST_PROGRAM
from cartstiff.recorded.known_numbers import Question, notes_are_known
from cartstiff.recorded.plans import plan, program_for
from cartstiff.recorded.postures import REGULAR
from cartstiff.recorded.program import Program
from cartstiff.recorded.recording import NOTHING

#: Whether there is a wrench, its behaviour and point, and its axes.
_Kind = tuple[bool, LoadKind, Axes]


class RecordedPostures:
    """`analyse` for one mechanism, by programs once they are recorded.

    Attributes
    ----------
    elastic : ElasticMechanism
        The mechanism.
    waiting : set
        Kinds of load that were asked for and are not being recorded.
    """

    def __init__(self, elastic: ElasticMechanism) -> None:
        self.elastic = elastic
        self.waiting = set[_Kind]()
        self._known: dict[_Kind, Program | Assembly | None] = {}

    def posture(
        self, q: Array, wrench: Array | None, load: LoadKind, axes: Axes
    ) -> PostureStiffness:
        """The posture, as of `cartstiff.analyse`."""
        kind = wrench is not None, load, axes
        if kind not in self._known:
            self._known[kind] = None
            self.waiting.add(kind)
        # A closed chain is closed by the recorded steps, whoever computes it.
        known, closed = self._known[kind], None
        if isinstance(known, Program):
            if (found := known.plain(q, wrench)) is not None:
                return found
            closed = known.closed(q)
        elif known is not None:
            closed = known(q)
        at = q if closed is None else closed
        return Question(self.elastic, at, wrench, load, axes).core

    def record(self) -> Thread:
        """Record the kinds of load that were asked for, in a thread of its own."""
        kinds, self.waiting = self.waiting, set()

        def work() -> None:
            self._known |= {kind: recorded(self.elastic, *kind) for kind in kinds}

        thread = Thread(target=work)
        thread.start()
        return thread


def recorded(
    elastic: ElasticMechanism, is_loaded: bool, load: LoadKind, axes: Axes
) -> Program | Assembly | None:
    """Program of all numbers of a posture, or of the steps that close it, if there is
    one whose results are those of the core.
    """
    taken = plan(elastic, is_loaded)
    if isinstance(taken, str):
        return None
    # Which coordinates were meant, where none is a motor's, only the core can say.
    has_motors = elastic.mechanism.actuated is not None
    steps = Assembly(taken) if taken.is_closed and has_motors else None
    outside = bool(taken.untraced) or taken.settles
    is_plain = taken.regular == REGULAR and not taken.untraced.is_dense
    if (
        not notes_are_known(elastic, is_loaded)
        or not is_plain
        or (outside and not taken.is_closed)
    ):
        return steps
    legs = (TENSIONS,) if len(elastic.mechanism.points) else ()
    outputs = (*OUTPUTS, *legs, *DETAILS, MOTIONS)
    tape = program_for(taken.under(load, axes).case, outputs)
    if NOTEWORTHY not in tape.outputs or tape.size > LARGEST_PROGRAM:
        return steps
    return Program(elastic, outputs, NOTHING, is_loaded, load, axes)
