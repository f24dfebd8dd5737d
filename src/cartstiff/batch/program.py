r"""A mechanism's recorded arithmetic in hand: arrays of one posture, and of many.

`record` makes a `Program`: every number that is asked for, as straight-line machine code
(or Python, where llvmlite is not installed) of the coordinates and the load. A call
computes one posture, and says whether it is plainly regular: well inside the postures at
which all that was asked for exists with its digits. Elsewhere `cartstiff.analyse`
computes it, and the answer says so. All that takes time, recording and compiling, happens
in `record`.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from math import inf
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cartstiff import numerics
from cartstiff.arrays import checked_array, checked_input
from cartstiff.batch.algebra import PLAIN
from cartstiff.batch.arguments import (
    DETAILS,
    EVERY_OUTPUT,
    TENSIONS,
    checked_names,
    full_name,
    shape_of,
)
from cartstiff.batch.closed_chains import STEPS, is_shut, settle
from cartstiff.batch.execution import CompiledPosture, OnePosture, PrintedPosture
from cartstiff.batch.kernels import has_package
from cartstiff.batch.own_outputs import Function, OwnOutputs
from cartstiff.batch.plans import CLOSING, SETTLING, TracedModel, plan, program_for
from cartstiff.batch.postures import REGULAR, Postures, analyse_many, fill
from cartstiff.batch.sources import (
    LANGUAGES,
    Facts,
    c_source,
    javascript_source,
    python_source,
)
from cartstiff.batch.tape import Program as Tape
from cartstiff.batch.untraced import UntracedTerms
from cartstiff.checked_call import checked
from cartstiff.errors import InputError, UnknownNameError, check_name
from cartstiff.geometry.connections import Connection
from cartstiff.geometry.se3 import Array
from cartstiff.mechanisms.closures import LONGEST_STEP
from cartstiff.mechanisms.elastic import ElasticMechanism, checked_elastic
from cartstiff.potentials.springs import Springs
from cartstiff.stiffness.applied_load import DEAD_AT_ORIGIN, Axes, LoadKind, checked_load

#: Number of operations beyond which compiling takes more than a quarter of a minute.
_LARGEST = 150_000
#: Place of an output in the record, if it exists, and its shape.
_Place = tuple[slice | None, tuple[int, ...]]


class RecordedPosture(Mapping[str, Array]):
    """Arrays of one posture by name, from a `Program`; also as attributes: ``answer.B``.

    Attributes
    ----------
    q : ndarray (n,)
        Coordinates; those of a closed chain as assembled, of compliant links as
        deflected.
    state : str
        State of the posture: "regular", or a code as of `cartstiff.Postures`.
    is_plain : bool
        Whether the program computed it, as it is well inside the regular postures.
        Otherwise `cartstiff.analyse` has computed it, and arrays that do not exist there
        are NaN.
    """

    __slots__ = ("_places", "_record", "is_plain", "q", "state")

    def __init__(
        self,
        places: Mapping[str, _Place],
        record: Array,
        q: Array,
        state: str,
        is_plain: bool,
    ) -> None:
        self._places, self._record, self.q = places, record, q
        self.state, self.is_plain = state, is_plain

    def __getitem__(self, name: str) -> Array:
        """Array of an output; "B" is short for "stiffness_B"."""
        place = self._places.get(name) or self._places.get(full_name(name))
        if place is None:
            raise UnknownNameError("output", name, self._places)
        if place[0] is None:
            return np.full(place[1], np.nan)
        return self._record[place[0]].reshape(place[1])

    def __getattr__(self, name: str) -> Array:
        if name.startswith("_"):  # of a copy that has nothing yet
            raise AttributeError(name)
        if name in self._places or full_name(name) in self._places:
            return self[name]
        raise AttributeError(f"no output {name!r}; there are {', '.join(self._places)}")

    def __iter__(self) -> Iterator[str]:
        return iter(self._places)

    def __len__(self) -> int:
        return len(self._places)

    def __repr__(self) -> str:
        by = "" if self.is_plain else ", by analyse"
        return f"RecordedPosture({self.state}{by}: {', '.join(self._places)})"


class Program:
    """The recorded arithmetic of a mechanism for given outputs, from `record`.

    ``program(q)``, with a wrench if it is recorded under a load, has the arrays of one
    posture, ``program.many(Q)`` those of many. It can be pickled; a copy is recorded
    again.

    Attributes
    ----------
    elastic : ElasticMechanism
        The mechanism.
    names : tuple of str
        Names of the outputs.
    is_loaded : bool
        Whether a call takes a wrench, which the springs balance at the posture.
    load : LoadKind
        Behaviour of that load while the body moves, and its point.
    load_axes : {"body", "world"}
        Axes of the wrench's components.
    inputs : tuple of str
        Numbers of the springs that a call may replace: "stiffness", "rest".
    path : {"compiled", "python", "engine"}
        Machine code, or Python, for plainly regular postures; or `cartstiff.analyse` for
        all.
    reason : str
        Why no faster one; empty if there is none.
    """

    def __init__(
        self,
        elastic: ElasticMechanism,
        names: tuple[str, ...],
        own: OwnOutputs,
        is_loaded: bool,
        load: LoadKind = DEAD_AT_ORIGIN,
        load_axes: Axes = "body",
        inputs: tuple[str, ...] = (),
    ) -> None:
        self.elastic, self.is_loaded, self.inputs = elastic, is_loaded, inputs
        self.load, self.load_axes = load, load_axes
        self._given, self._own = names, own
        self._count = len(elastic.mechanism.coordinates)
        # What `analyse` computes, and what follows from that.
        self._base = tuple(dict.fromkeys((*names, *own.needs)))
        self.names = (*names, *own.names)
        self._shapes = {**_shapes(elastic), **own.shapes}
        self.path, self.reason = "engine", ""
        self._taken: TracedModel | None = None
        self._untraced: UntracedTerms | None = None
        self._tape: Tape | None = None
        self._answer: OnePosture | None = None
        self._closing: OnePosture | None = None
        self._settling: OnePosture | None = None
        self._places: dict[str, _Place] = {}
        self._usual: dict[str, Array] = {}
        self._verdict, self._state = 0, REGULAR
        taken = plan(elastic, "shared" if is_loaded else "none")
        if isinstance(taken, str):
            self.reason = taken
        else:
            self._compile(taken.under(load, load_axes))

    def _compile(self, taken: TracedModel) -> None:
        """Record, and make code of, the outputs and the steps towards the posture."""
        compiled = has_package("llvmlite")
        case, one_posture = taken.case, CompiledPosture if compiled else PrintedPosture
        program = program_for(case, self._base, own=self._own)
        if program.size > _LARGEST:
            self.reason = f"{program.size} operations would take too long to compile"
            return
        # What exists at no posture of the mechanism is missing.
        exist = [name for name in self.names if name in program.outputs]
        outputs = {name: program.outputs[name] for name in (*exist, "verdict")}
        rows = {name: np.ascontiguousarray(row) for name, row in taken.shared.items()}
        shared = {name: row for name, row in rows.items() if name not in self.inputs}
        self._usual = {name: rows[name][0] for name in self.inputs}
        self._answer = one_posture(program.with_outputs(outputs), shared)
        at = self._answer.at
        self._places = {name: (at.get(name), self._shapes[name]) for name in self.names}
        self._verdict, self._state = at["verdict"].start, taken.regular
        if taken.is_closed:
            self._closing = one_posture(program_for(case, CLOSING), {})
        if taken.settles:
            self._settling = one_posture(program_for(case, SETTLING), shared)
        self._taken, self._tape = taken, program
        self._untraced = taken.untraced if taken.untraced else None
        self.path = "compiled" if compiled else "python"
        if not compiled:
            self.reason = "llvmlite is not installed"

    def __reduce__(self) -> Any:
        more = self.is_loaded, self.load, self.load_axes, self.inputs
        return Program, (self.elastic, self._given, self._own, *more)

    def __repr__(self) -> str:
        load = ", loaded" if self.is_loaded else ""
        return f"Program({self.elastic.name}{load}, {self.path}: {', '.join(self.names)})"

    def __call__(
        self, q: ArrayLike, wrench: ArrayLike | None = None, **numbers: ArrayLike
    ) -> RecordedPosture:
        """Arrays of one posture.

        Parameters
        ----------
        q : array_like (n,)
            Coordinates in rad and length units. A closed chain is assembled from there.
        wrench : array_like (6,), optional
            (moment, force) on the body, for a program under a load.
        numbers
            Those of `inputs`, one for each spring, in place of the mechanism's own.

        Raises
        ------
        InputError
            For other shapes, numbers that are not finite, a missing load, or one too
            many.
        UnknownNameError
            For numbers that are not among the inputs.
        """
        at, given = _as_vector(q, self._count, "q"), self._usual.copy()
        for name, values in numbers.items():
            check_name("input", name, self.inputs)
            given[name] = _as_vector(values, len(_springs(self.elastic).stiffness), name)
        if (wrench is None) is self.is_loaded:
            self._refuse(wrench)
        if wrench is not None:
            given["wrench"] = _as_vector(wrench, 6, "wrench")
        plain = self._plain(at, given)
        return self._by_analyse(at, given) if plain is None else plain

    def plain(self, q: Array, wrench: Array | None = None) -> RecordedPosture | None:
        """As a call, but None where `cartstiff.analyse` would be asked."""
        given = self._usual if wrench is None else {**self._usual, "wrench": wrench}
        return self._plain(q, given)

    def _plain(self, at: Array, given: Mapping[str, Array]) -> RecordedPosture | None:
        """Arrays of a plainly regular posture, else None."""
        if self._answer is None:
            return None
        if self._closing is not None or self._settling is not None:
            placed = self._placed(at, given)
            if placed is None:
                return None
            at = placed
        record = self._answer.record(q=at, **given, **self._derivatives(at, given))
        if record[self._verdict] != PLAIN:
            return None
        return RecordedPosture(self._places, record, at, self._state, True)

    def _refuse(self, wrench: ArrayLike | None) -> None:
        if wrench is None:
            raise InputError(
                "the program is recorded under a load", expected="a wrench (6,)"
            )
        raise InputError(
            "the program is recorded without a load", expected="loaded=True in record"
        )

    def _by_analyse(self, q: Array, given: Mapping[str, Array]) -> RecordedPosture:
        """One posture by `cartstiff.analyse`."""
        at = checked_input(q, (self._count,), "q")
        wrench, elastic = given.get("wrench"), self._with(given)
        wrench = None if wrench is None else checked_input(wrench, (6,), "wrench")
        rows = {name: np.full((1, *self._shapes[name]), np.nan) for name in self._base}
        with numerics.one_thread():
            state, at = fill(elastic, at, wrench, rows, self.load, self.load_axes)
        rows |= self._own.values(rows)
        places, parts, stop = dict[str, _Place](), list[Array](), 0
        for name in self.names:
            part = np.ravel(rows[name])
            places[name] = slice(stop, stop + part.size), self._shapes[name]
            parts.append(part)
            stop += part.size
        return RecordedPosture(places, np.concatenate(parts), at, state, False)

    def _with(self, numbers: Mapping[str, ArrayLike]) -> ElasticMechanism:
        """The mechanism with other numbers of its springs."""
        own = {name: numbers[name] for name in self.inputs if name in numbers}
        if not own:
            return self.elastic
        springs = _springs(self.elastic)
        each = {"stiffness": springs.stiffness, "rest": springs.rest, **own}
        count = len(springs.stiffness)
        new = (
            checked_array(each[n], (count,), n, finite=False)
            for n in ("stiffness", "rest")
        )
        return replace(self.elastic, springs=springs.replaced(*new))

    def _derivatives(self, q: Array, given: Mapping[str, Array]) -> dict[str, Array]:
        """Derivatives of the terms outside the programs; NaN where they are in doubt."""
        if self._untraced is None:
            return {}
        wrench = given.get("wrench")
        inputs, doubts = self._untraced.derivatives(
            q[None],
            self.path == "compiled",
            None if wrench is None else wrench[None],
        )
        if doubts[0] != PLAIN:
            inputs = {name: np.full_like(rows, np.nan) for name, rows in inputs.items()}
        return inputs

    # -- closed chains and compliant links
    # -----------------------------------------------------

    def _placed(self, q: Array, given: Mapping[str, Array]) -> Array | None:
        """Coordinates that close the chain, and at which links carry the load;
        None if unknown.
        """
        at: Array | None = q
        if self._closing is not None:
            at = self._assembled(self._closing, q)
        if self._settling is None or at is None or self._taken is None:
            return at
        evaluate = partial(
            self._taken.untraced.derivatives, compiled=self.path == "compiled"
        )
        moved = at[None].copy()
        load = {name: values[None] for name, values in given.items()}
        found = settle(self._settling, evaluate, load, moved, np.arange(1))
        return moved[0] if len(found) else None

    def _assembled(self, closing: OnePosture, q: Array) -> Array | None:
        """Coordinates that close the chain, as `Chain.closed` finds them;
        None if not found.
        """
        home = None if self._taken is None else self._taken.home
        if home is None or not (steps := home.steps_where_asked(q[None])).any():
            return self._closed(closing, q)

        def near(start: Array) -> tuple[Array, NDArray[np.bool_], NDArray[np.bool_]]:
            at = self._closed(closing, start[0])
            shut = np.array([at is not None])
            return start if at is None else at[None], shut, ~shut

        at, is_closed, _ = home.continue_from(near, q[None], steps)
        return at[0] if is_closed[0] else None

    @staticmethod
    def _closed(closing: OnePosture, q: Array) -> Array | None:
        """The steps of `closed_chains.close` for one posture.

        None if these do not close it.
        """
        left, size, best, futile = closing.at["left"], inf, inf, 0
        for _ in range(STEPS):
            record, before = closing.record(q=q), size
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

    # -- sources
    # -------------------------------------------------------------------------------

    def source(
        self, language: Literal["c", "python", "javascript"], name: str = ""
    ) -> str:
        """Source text of a function that computes the outputs at a posture.

        Parameters
        ----------
        language : {"c", "python", "javascript"}
            "c" is one C99 function without allocation for a controller.
        name : str
            Of the function; default that of the mechanism.

        Raises
        ------
        UnknownNameError
            For another language.
        InputError
            If some of the arithmetic is not recorded, or takes steps.
        """
        check_name("language", language, LANGUAGES)
        taken, tape = self._taken, self._tape
        if taken is None or tape is None or taken.untraced or taken.settles:
            reason = (
                self.reason or "its flexible links or own potentials are found in steps"
            )
            raise InputError(f"no source: {reason}")
        if taken.is_closed and language != "c":
            raise InputError("no source: the chain is closed in steps", expected="c")
        name = name or re.sub(r"\W", "_", f"stiffness_of_{self.elastic.name}")
        exist = [n for n in self.names if n in tape.outputs]
        steps = tuple(step for n in exist for step in tape.outputs[n])
        tape = tape.with_outputs({"record": steps, "verdict": tape.outputs["verdict"]})
        shared = {n: row for n, row in taken.shared.items() if n not in self.inputs}
        if language == "c":
            closing = program_for(taken.case, CLOSING) if taken.is_closed else None
            return c_source(tape, shared, self._facts(exist), name, closing)
        write = python_source if language == "python" else javascript_source
        return write(tape, shared, self._facts(exist), name)

    def _facts(self, exist: Sequence[str]) -> Facts:
        """Names, shapes and units of what goes in and comes out."""
        units, lines, at = self.elastic.units, list[str](), 0
        for name in exist:
            size = math.prod(self._shapes[name])
            shape = " x ".join(map(str, self._shapes[name])) or "1"
            lines.append(f"{at} to {at + size - 1}: {name} ({shape}, row by row)")
            at += size
        wrench = []
        if self.is_loaded:
            point = ", ".join(f"{x:g}" for x in self.load.at)
            axes = {"body": "the body frame M", "world": "the frame F"}[self.load_axes]
            wrench = [
                f"  0 to 2: moment [{units.moment}], 3 to 5: force [{units.force}], "
                "along the axes "
                f"of {axes};",
                f"  it acts at ({point}) {units.length} of M, and is {self.load.kind}",
            ]
        lines.append(
            f"in {units.length}, {units.force} and rad; twists and wrenches: rotation "
            "first"
        )
        title = f"{', '.join(exist)} of {self.elastic.name} at a posture"
        inputs = {name: len(usual) for name, usual in self._usual.items()}
        return Facts(title, self.elastic.names_with_units, wrench, inputs, lines)

    # -- many postures
    # -------------------------------------------------------------------------

    def many(
        self, q: ArrayLike, wrench: ArrayLike | None = None, **numbers: ArrayLike
    ) -> Postures:
        """Arrays of postures q (N, n) under one wrench (6,), or one for each (N, 6).

        As of `cartstiff.analyse_many`: with the state of every posture, and labels by
        ``.to_xarray()``. `numbers` as in a call.
        """
        for name in numbers:
            check_name("input", name, self.inputs)
        elastic = self._with(numbers)
        if (wrench is None) is self.is_loaded:
            self._refuse(wrench)
        load: dict[str, Any] = {}
        if wrench is not None:
            load = {
                "load_kind": self.load.kind,
                "load_at": self.load.at,
                "load_axes": self.load_axes,
            }
        found = analyse_many(elastic, q, wrench=wrench, outputs=self._base, **load)
        if self._own:
            found.arrays.update(self._own.values(found.arrays))
            for name in set(found.arrays).difference(self.names):
                del found.arrays[name]
        return found


@checked
def record(
    elastic: ElasticMechanism,
    outputs: str
    | Connection
    | Sequence[str | Connection | Function]
    | Mapping[str, str | Connection | Function] = ("stiffness_B",),
    *,
    loaded: bool = False,
    load_kind: Literal["dead", "follower", "conservative"] = "dead",
    load_at: ArrayLike = DEAD_AT_ORIGIN.at,
    load_axes: Literal["body", "world"] = "body",
    inputs: Sequence[Literal["stiffness", "rest"]] = (),
) -> Program:
    """Record the arithmetic of a mechanism: a program that answers in microseconds.

    Parameters
    ----------
    elastic : ElasticMechanism
        Mechanism and potentials, from `cartstiff.load`.
    outputs : sequence or mapping
        Outputs of `cartstiff.analyse_many` by name ("B" is short for "stiffness_B");
        connections of your own, for "stiffness_NAME" and "compliance_NAME" under each;
        and functions of a mapping of arrays by name, made of + - * / and products of
        arrays, whose results have their key in a mapping, or else the function's own
        name.
    loaded : bool
        Whether a call takes a wrench on the body, which the springs balance at the
        posture.
    load_kind, load_at, load_axes
        Behaviour of that load while the body moves, its point of application and its
        axes, as in `cartstiff.analyse`.
    inputs : sequence of {"stiffness", "rest"}
        Numbers of the springs that a call may replace. Rest positions must all be given,
        and without a load, which would replace them.

    Returns
    -------
    Program
        ``program(q)`` or ``program(q, wrench)``, and ``program.many(Q)``.

    Raises
    ------
    UnknownNameError
        For an unknown output or input.
    InputError
        For a load, or inputs, that this mechanism cannot be given.
    """
    kind = checked_load(
        load_kind, load_at, load_axes, loaded, checked_elastic(elastic).may_be_loaded
    )
    if loaded and elastic.springs is None:
        raise InputError(
            "the load of this mechanism follows from its potentials and cannot be given",
            expected="loaded=False",
        )
    if isinstance(outputs, (str, Connection)):
        outputs = [outputs]
    if not isinstance(outputs, Mapping):
        outputs = {_name_of(output): output for output in outputs}
    names = checked_names([o for o in outputs.values() if isinstance(o, str)])
    own = OwnOutputs.of(outputs, _shapes(elastic))
    for name in inputs:
        check_name("input", name, ("stiffness", "rest"))
    if inputs and "rest" in inputs and (loaded or not _springs(elastic).is_complete):
        raise InputError(
            "rest positions that are found at each posture are no inputs",
            where="inputs",
            expected="rest positions of all springs, and no load",
        )
    return Program(elastic, names, own, loaded, kind, load_axes, tuple(inputs))


def _springs(elastic: ElasticMechanism) -> Springs:
    if elastic.springs is None:
        raise InputError(
            f"{elastic.name} has no springs of joints or lines", where="inputs"
        )
    return elastic.springs


def _shapes(elastic: ElasticMechanism) -> dict[str, tuple[int, ...]]:
    """Shape of each output at one posture."""
    count = len(elastic.mechanism.coordinates)
    legs = len(getattr(elastic.mechanism, "anchors", ()))
    names = (name for name in EVERY_OUTPUT if legs or name != TENSIONS)
    own = {name: shape_of(name, 1, count, legs)[1:] for name in names}
    return {**own, **{name: shape_of(name, 1, count, legs)[1:] for name in DETAILS}}


def _as_vector(values: ArrayLike, size: int, what: str) -> Array:
    """An array of `size` doubles; whether they are finite is seen in the result."""
    try:
        array = np.asarray(values, float)
    except (TypeError, ValueError):
        return checked_input(values, (size,), what)
    return array if array.shape == (size,) else checked_input(values, (size,), what)


def _name_of(output: Any) -> str:
    if isinstance(output, str):
        return full_name(output)
    name = getattr(output, "name", getattr(output, "__name__", None))
    if not isinstance(name, str):
        raise InputError(
            "output cannot be used",
            expected="a name, a connection, or a function",
            got=output,
        )
    return name
