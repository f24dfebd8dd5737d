"""Postures of a mechanism that is asked often: `analyse` with the numbers of a `Program`.

A program is recorded once for each kind of load, in a thread of its own, while the core
answers. The results are those of `cartstiff.analyse`: numbers of a plainly regular
posture come from the program, and whatever else is read of it is computed then. All other
postures are the core's.
"""

from __future__ import annotations

from dataclasses import dataclass
from threading import Thread

from cartstiff.core.geometry.se3 import Array
from cartstiff.core.mechanisms.elastic import ElasticMechanism
from cartstiff.core.stiffness.applied_load import Axes, LoadKind
from cartstiff.core.stiffness.posture import PostureStiffness
from cartstiff.recorded.arguments import (
    DETAILS,
    MOTIONS,
    NOTEWORTHY,
    OUTPUTS,
    TENSIONS,
)
from cartstiff.recorded.assembly import Assembly
from cartstiff.recorded.kernels import LARGEST_PROGRAM
from cartstiff.recorded.known_numbers import Question, notes_are_known, with_numbers
from cartstiff.recorded.plans import plan, program_for
from cartstiff.recorded.postures import REGULAR
from cartstiff.recorded.program import Program
from cartstiff.recorded.recording import NOTHING

#: Postures of one kind of load after which a program is worth recording, which takes a
#: second, and one of more than `LARGEST_PROGRAM` operations, which takes up to fifteen:
#: the core answers about as many in that time.
_OFTEN, _VERY_OFTEN = 20, 3000

#: Whether there is a wrench, its behaviour and point, and its axes.
_Kind = tuple[bool, LoadKind, Axes]


class RecordedPostures:
    """`analyse` for one mechanism, soon by programs; one for each kind of load."""

    def __init__(self, elastic: ElasticMechanism) -> None:
        self.elastic = elastic
        self._recordings: dict[_Kind, _Recording] = {}

    def posture(
        self, q: Array, wrench: Array | None, load: LoadKind, axes: Axes
    ) -> PostureStiffness:
        """The posture, as of `cartstiff.analyse`."""
        kind = wrench is not None, load, axes
        recording = self._recordings.get(kind)
        if recording is None:
            recording = self._recordings[kind] = _Recording(self.elastic, *kind)
        found = recording.posture(q, wrench)
        if found is None:
            return Question(self.elastic, recording.closed(q), wrench, load, axes).core
        return found

    def record(self) -> None:
        """Wait until the kinds of load that were asked for are recorded."""
        for recording in self._recordings.values():
            recording.start().join()


@dataclass
class _Recording:
    """The program for one kind of load, once it is recorded."""

    elastic: ElasticMechanism
    is_loaded: bool
    load: LoadKind
    axes: Axes
    count: int = 0
    thread: Thread | None = None
    program: Program | None = None
    #: Steps that close the chain before the core is asked.
    assembly: Assembly | None = None
    #: Whether its program is worth more postures than these.
    is_large: bool = False

    def posture(self, q: Array, wrench: Array | None) -> PostureStiffness | None:
        """A plainly regular posture; None if only the core has it."""
        if self.program is None:
            self.count += 1
            if self.count == _OFTEN or (self.count == _VERY_OFTEN and self.is_large):
                self.start()
            return None
        record = self.program.plain(q, wrench)
        if record is None:
            return None
        question = Question(self.elastic, q, wrench, self.load, self.axes)
        return with_numbers(question, record.q, record.existing())

    def closed(self, q: Array) -> Array:
        """Coordinates that close the chain, if its recorded steps find them; else q."""
        closed = None if self.assembly is None else self.assembly(q)
        return q if closed is None else closed

    def start(self) -> Thread:
        """Record, in a thread of its own."""
        if self.thread is None or self.is_large:
            self.thread = Thread(target=self._record)
            self.thread.start()
        return self.thread

    def _record(self) -> None:
        taken = plan(self.elastic, "each" if self.is_loaded else "none")
        if isinstance(taken, str):
            return
        # Which coordinates were meant, where none is a motor's, only the core can say.
        if taken.is_closed and self.elastic.mechanism.actuated is not None:
            self.assembly = Assembly(taken)
        if not notes_are_known(self.elastic, self.is_loaded):
            return
        outside = bool(taken.untraced) or taken.settles
        is_plain = taken.regular == REGULAR and not taken.untraced.is_dense
        if not is_plain or (outside and not taken.is_closed):
            return
        legs = (TENSIONS,) if len(self.elastic.mechanism.points) else ()
        outputs = (*OUTPUTS, *legs, *DETAILS, MOTIONS)
        tape = program_for(taken.under(self.load, self.axes).case, outputs)
        if NOTEWORTHY not in tape.outputs:
            return
        self.is_large = tape.size > LARGEST_PROGRAM and not self.is_large
        if not self.is_large:
            self.program = Program(
                self.elastic, outputs, NOTHING, self.is_loaded, self.load, self.axes
            )
