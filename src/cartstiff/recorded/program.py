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
import os
import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, Literal, TypedDict, Unpack, cast

import numpy as np
from numpy.typing import ArrayLike

from cartstiff.core.arrays import Array, checked_flag, checked_input, fixed
from cartstiff.core.checked_call import checked
from cartstiff.core.errors import InputError, UndefinedError, check_name
from cartstiff.core.geometry.connections import Connection
from cartstiff.core.mechanisms.chain import Chain
from cartstiff.core.mechanisms.elastic import ElasticMechanism, checked_elastic
from cartstiff.core.stiffness.applied_load import (
    DEAD_AT_ORIGIN,
    Axes,
    Behaviour,
    LoadKind,
    checked_load,
)
from cartstiff.core.stiffness.compute import PostureStiffness
from cartstiff.recorded.algebra import CASE_INPUTS, PLAIN
from cartstiff.recorded.arguments import (
    EVERY_OUTPUT,
    NOTEWORTHY,
    checked_names,
    checked_q,
    checked_wrench,
    full_name,
    shapes_of,
)
from cartstiff.recorded.assembly import Assembly, one_posture
from cartstiff.recorded.closed_chains import settle
from cartstiff.recorded.execution import Kernel, OnePosture
from cartstiff.recorded.kernels import has_package, kernel_of
from cartstiff.recorded.known_numbers import Question, springs_of, with_numbers
from cartstiff.recorded.own_outputs import Function, OwnOutputs
from cartstiff.recorded.plans import CLOSING, SETTLING, TracedModel, program_for
from cartstiff.recorded.postures import REGULAR, Postures
from cartstiff.recorded.quantities import (
    QUANTITIES,
    Settings,
    check_masses,
    check_used,
    choose_quantities,
)
from cartstiff.recorded.recording import Recording
from cartstiff.recorded.source_steps import Before
from cartstiff.recorded.sources import WRITERS, Facts, Routine
from cartstiff.recorded.tape import Arrays
from cartstiff.recorded.tape import Program as Tape
from cartstiff.recorded.untraced import UntracedTerms

#: Number of operations beyond which compiling takes more than a quarter of a minute.
_LARGEST = 150_000
#: Number of postures from which vectors of full width, which are compiled apart, pay.
WORTH_WIDENING = 1_000_000
#: Outputs that are attributes of a posture of the same name.
_ALIKE = "pose", "wrench", "jacobian", "tensions"
#: Place of an output in the record, if it exists, and its shape.
_Place = tuple[slice | None, tuple[int, ...]]


class Inputs(TypedDict, total=False):
    """Numbers that may be inputs of a program, each in place of the mechanism's own."""

    stiffness: ArrayLike
    rest: ArrayLike
    load_at: ArrayLike
    payload: ArrayLike
    tcp: ArrayLike


class _Outputs(Arrays):
    """Arrays of one posture by name, views of one record; NaN where there is none."""

    __slots__ = ("_places", "_record")

    def __init__(self, places: Mapping[str, _Place], record: Array) -> None:
        self._places, self._record = places, record

    def __getitem__(self, name: str) -> Array:
        place, shape = self._places[name]
        if place is None:
            return np.full(shape, np.nan)
        return self._record[place].reshape(shape)

    def __contains__(self, name: object) -> bool:
        return name in self._places

    def existing(self) -> dict[str, Array]:
        """Arrays of the outputs that exist, by name."""
        return {
            name: self._record[place].reshape(shape)
            for name, (place, shape) in self._places.items()
            if place is not None
        }

    def __iter__(self) -> Iterator[str]:
        return iter(self._places)

    def __len__(self) -> int:
        return len(self._places)


class Program(Recording):
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
        Numbers that a call may replace: "stiffness" and "rest" of the springs, the load's
        point "load_at" (3,) in M, "payload" (4,): mass and centre in M, "tcp" (6,): pose
        of the tool in M.
    path : {"compiled", "python", "engine"}
        Machine code, or Python, for plainly regular postures; or `cartstiff.analyse` for
        all.
    reason : str
        Why no faster one; empty if there is none.
    from_matrices : tuple of str
        Quantities that are not recorded: maps' functions read them from the program's
        matrices.
    """

    largest = _LARGEST
    path = "engine"
    _untraced: UntracedTerms | None = None
    _answer: OnePosture | None = None
    _closing: Assembly | None = None
    _settling: OnePosture | None = None
    _verdict, _state = 0, REGULAR

    def _use(self, taken: TracedModel, program: Tape) -> None:
        """Make code of the outputs and of the steps towards the posture."""
        if program.size > _LARGEST:
            self.reason = f"{program.size} operations would take too long to compile"
            self.tape = None
            return
        self._made = dict[Tape, OnePosture]()
        self._answer = self._one(program)
        # What exists at no posture of the mechanism is missing.
        at = self._answer.at
        self._places: dict[str, _Place] = {
            name: (at.get(name), self._shapes[name]) for name in self.names
        }
        stop = max(place.stop for place in at.values())
        for i, name in enumerate(self.from_matrices):
            self._places[name] = slice(stop + i, stop + i + 1), ()
        self._verdict, self._state = at["verdict"].start, taken.regular
        self._alike = tuple(n for n in _ALIKE if n in self.names and n in at)
        if taken.is_closed:
            self._closing = Assembly(taken)
        if taken.settles:
            self._settling = self._one(program_for(taken.case, SETTLING))
        self._untraced = taken.untraced if taken.untraced else None
        self.path = "compiled" if has_package("llvmlite") else "python"
        if self.path == "python":
            self.reason = "llvmlite is not installed"
        if taken.untraced:  # their code is made here, not in the first call
            wrench = np.zeros((1, 6)) if self.is_loaded else None
            is_compiled = self.path == "compiled"
            taken.untraced.derivatives(self.elastic.q[None], is_compiled, wrench)

    def __reduce__(self) -> Any:
        more = self.is_loaded, self.load, self.load_axes, self.inputs
        return Program, (self.elastic, self._given, self._own, *more)

    def __repr__(self) -> str:
        load = ", loaded" if self.is_loaded else ""
        return f"Program({self.elastic.name}{load}, {self.path}: {', '.join(self.names)})"

    def __call__(
        self, q: ArrayLike, wrench: ArrayLike | None = None, **numbers: Unpack[Inputs]
    ) -> PostureStiffness:
        """One posture: outputs by their names in brackets, and all else by `analyse`.

        Parameters
        ----------
        q : array_like (n,)
            Coordinates in rad and length units. A closed chain is assembled from there.
        wrench : array_like (6,), optional
            (moment, force) on the body, for a program under a load.
        **numbers
            Those of `inputs`, one for each spring, in place of the mechanism's own.

        Raises
        ------
        InputError
            For other shapes, numbers that are not finite, a missing load, or one too
            many.
        UnknownNameError
            For numbers that are not among the inputs.
        """
        at = _as_vector(q, self._count, "q")
        given = self._usual | self._replaced(numbers, wrench)
        if wrench is not None:
            given["wrench"] = _as_vector(wrench, 6, "wrench")
        plain = self._plain(at, given)
        return self._by_analyse(at, given) if plain is None else plain

    def _replaced(
        self, numbers: Mapping[str, Any], wrench: ArrayLike | None
    ) -> dict[str, Array]:
        """Inputs in place of the mechanism's; a load is refused or required."""
        given = dict[str, Array]()
        for name, values in numbers.items():
            check_name("input", name, self.inputs)
            given[name] = self._checked(name, values)
        if (wrench is None) is self.is_loaded:
            how, expected = "without a load", "loaded=True in record"
            if wrench is None:
                how, expected = "under a load", "a wrench (6,)"
            raise InputError(f"the program is recorded {how}", expected=expected)
        return given

    def plain(self, q: Array, wrench: Array | None = None) -> PostureStiffness | None:
        """As a call, but None where `cartstiff.analyse` would be asked."""
        given = self._usual if wrench is None else {**self._usual, "wrench": wrench}
        return self._plain(q, given)

    def closed(self, q: Array, numbers: Arrays | None = None) -> Array | None:
        """Coordinates (n,) that close the chain; None where the recorded steps do not.

        Where none are driven, the core holds those that were given; `numbers` of inputs
        count then.
        """
        if self._closing is None:
            return q
        if cast(Chain, self.elastic.mechanism).actuated is None:
            elastic, _ = self.with_numbers(numbers or {})
            q = elastic.mechanism.closed_as_given(q[None])[0]
        return self._closing(q)

    def _plain(self, at: Array, given: Arrays) -> PostureStiffness | None:
        """A plainly regular posture, else None."""
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
        if self.from_matrices:
            arrays = {
                name: record[place].reshape(1, *self._shapes[name])
                for name, place in self._answer.at.items()
                if name in self._shapes
            }
            elastic, load = self.with_numbers(given)
            found = self._read(
                self.from_matrices, arrays, at[None], given.get("wrench"), elastic, load
            )
            record = np.concatenate([record, *(found[n] for n in self.from_matrices)])
        # A posture whose outputs are known; the rest is found when it is read.
        record.flags.writeable, q = False, fixed(at)
        outputs, question = _Outputs(self._places, record), self._question(q, given)
        if NOTEWORTHY in outputs:  # then there are all numbers
            return with_numbers(question, outputs.existing())
        known: dict[str, Any] = {"q": q, "is_plain": True, "_outputs": outputs}
        known["state"] = self._state
        for name in self._alike:
            known[name] = outputs[name]
        if "energy" in outputs:
            known["energy"] = float(outputs["energy"])
        return PostureStiffness.of_numbers(known, question)

    def _question(self, q: Array, given: Arrays) -> Question:
        acting = given.get("wrench"), self.load, self.load_axes
        return Question(self.elastic, q, *acting, given)

    def _by_analyse(self, q: Array, given: Arrays) -> PostureStiffness:
        """One posture by `cartstiff.analyse`."""
        at = checked_input(q, (self._count,), "q")[None]
        wrench, (elastic, load) = given.get("wrench"), self.with_numbers(given)
        wrench = None if wrench is None else checked_input(wrench, (6,), "wrench")
        acting = self._own, self.is_loaded, load, self.load_axes
        core = Recording(elastic, self._given, *acting, backend="engine")
        found = core.postures(at, wrench)
        outputs = {name: fixed(found.arrays[name][0]) for name in self.names}
        state, q = found.codes[found.state[0]], fixed(found.q[0])
        known = {"q": q, "state": state, "is_plain": False, "_outputs": outputs}
        return PostureStiffness.of_numbers(known, self._question(q, given))

    def _checked(self, name: str, values: ArrayLike) -> Array:
        """Numbers of an input; springs stay springs, as what is none was recorded."""
        if name in CASE_INPUTS:
            found = _as_vector(values, CASE_INPUTS[name], name)
        else:
            springs = springs_of(self.elastic)
            found = _as_vector(values, len(springs.stiffness), name)
            if (
                name == "stiffness"
                and (((found > 0.0) != (springs.stiffness > 0.0)) | np.isinf(found)).any()
            ):
                raise InputError(
                    "stiffness cannot be used",
                    expected="a positive number for each linear spring, else zero",
                    got=found.tolist(),
                )
        if name == "payload" and found[0] < 0.0:
            raise InputError(
                "payload mass cannot be used",
                expected="a number from zero",
                got=float(found[0]),
            )
        return found

    def _derivatives(self, q: Array, given: Arrays) -> dict[str, Array]:
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

    def _placed(self, q: Array, given: Arrays) -> Array | None:
        """Coordinates that close the chain, and at which links carry the load;
        None if unknown.
        """
        at = self.closed(q, given)
        if self._settling is None or at is None or self.taken is None:
            return at
        evaluate = partial(
            self.taken.untraced.derivatives, compiled=self.path == "compiled"
        )
        moved = at[None].copy()
        load = {name: values[None] for name, values in given.items()}
        found = settle(self._settling, evaluate, load, moved, np.arange(1))
        return moved[0] if len(found) else None

    # -- sources
    # -------------------------------------------------------------------------------

    def source(
        self, language: Literal["c", "jax", "python", "javascript"], name: str = ""
    ) -> str:
        """Source text of a function that computes the outputs at a posture.

        Parameters
        ----------
        language : {"c", "jax", "python", "javascript"}
            "c" is one C99 function without allocation for a controller; "jax" is a
            function that JAX compiles, maps and differentiates. All close chains and
            deflect links as a call does.
        name : str
            Of the function; default that of the mechanism.

        Raises
        ------
        UnknownNameError
            For another language.
        InputError
            If some of the arithmetic is not recorded.
        """
        check_name("language", language, WRITERS)
        # What no source can do is refused with its reason.
        taken, tape = self.taken, self.tape
        if taken is None or tape is None:
            raise InputError(f"no source: {self.reason}")
        if taken.untraced.is_dense:
            raise InputError(
                "no source: some of its potentials are evaluated posture by posture",
                expected="a call of the program",
            )
        if self.from_matrices:
            names = ", ".join(self.from_matrices)
            raise InputError(f"no source: {names} cannot be recorded")
        name = name or re.sub(r"\W", "_", f"stiffness_of_{self.elastic.name}", flags=re.A)
        if not re.fullmatch(r"[A-Za-z_]\w*", name, re.ASCII):
            raise InputError(
                "name cannot be used", expected="letters, digits and _", got=name
            )
        # All outputs as one row, and what is no input as constants.
        exist = [n for n in self.names if n in tape.outputs]
        if not exist:
            raise InputError("no source: the outputs exist at no posture")
        steps = tuple(step for n in exist for step in tape.outputs[n])
        tape = tape.with_outputs({"record": steps, "verdict": tape.outputs["verdict"]})
        before, constants = Before.of(taken, self._count), self._constants(taken)
        own = Routine(name, tape, constants, before, self._facts(exist))
        return WRITERS[language](own)

    def _constants(self, taken: TracedModel) -> dict[str, Array]:
        """Numbers that all postures share and a call cannot replace."""
        shared = {n: row for n, row in taken.shared.items() if n not in self.inputs}
        return {name: np.ascontiguousarray(row) for name, row in shared.items()}

    def _facts(self, exist: Sequence[str]) -> Facts:
        """Names, shapes and units of what goes in and comes out."""
        units, lines, at = self.elastic.units, list[str](), 0
        of_quantities = {q.name: q.unit_in(units) for q in self._quantities}
        for name in exist:
            size = math.prod(self._shapes[name])
            shape = " x ".join(map(str, self._shapes[name])) or "1"
            words = f" to {at + size - 1}: {name} ({shape}, row by row)"
            if name in of_quantities:
                words = f": {name} [{of_quantities[name]}]"
            lines.append(f"{at}{words}")
            at += size
        wrench = []
        if self.is_loaded:
            point = f"({', '.join(f'{x:g}' for x in self.load.at)})"
            axes = {"body": "the body frame M", "world": "the frame F"}[self.load_axes]
            if "load_at" in self.inputs:
                point = "load_at"
            wrench = [
                f"  0 to 2: moment [{units.moment}], 3 to 5: force [{units.force}], "
                "along the axes "
                f"of {axes};",
                f"  it acts at {point} {units.length} of M, and is {self.load.kind}",
            ]
        lines.append(
            f"in {units.length}, {units.force} and rad; twists and wrenches: rotation "
            "first"
        )
        title = f"{', '.join(exist)} of {self.elastic.name} at a posture"
        inputs = {name: len(usual) for name, usual in self._usual.items()}
        shapes = {n: self._shapes[n] for n in exist}
        return Facts(title, self.elastic.names_with_units, wrench, inputs, lines, shapes)

    # -- many postures
    # -------------------------------------------------------------------------

    def many(
        self, q: ArrayLike, wrench: ArrayLike | None = None, **numbers: Unpack[Inputs]
    ) -> Postures:
        """Arrays of postures q (N, n) under one wrench (6,), or one for each (N, 6).

        As of `cartstiff.analyse_many`: with the state of every posture, and labels by
        ``.to_xarray()``. `numbers` as in a call, the same for all postures.

        Raises
        ------
        InputError
            For wrong shapes, or numbers of inputs that the program does not have.
        """
        given = self._replaced(numbers, wrench)
        elastic, _ = self.with_numbers(given)
        coordinates = elastic.mechanism.closed_as_given(checked_q(elastic, q))
        loads = checked_wrench(elastic, wrench, len(coordinates))
        threads = os.cpu_count() or 1
        return self.postures(coordinates, loads, numbers=given, threads=threads)

    def gradient(
        self, of: str, q: ArrayLike, wrench: ArrayLike | None = None
    ) -> dict[str, Array]:
        """An output and its derivatives at one posture (n,), or at many (N, n).

        The question is that of a call: the derivative by an input is that while all
        others stay, and rest positions follow where the program chooses them. They are
        exact, for three times the operations of the output; the first call records and
        compiles them.

        Parameters
        ----------
        of : str
            An output that is one number: a quantity or a function, by name.
        q, wrench
            As in a call, or as of `many`.

        Returns
        -------
        dict of str to ndarray
            The output by its name, and its derivatives by "q", "stiffness", "wrench" and
            the other numbers that the program reads; NaN at postures that are not plainly
            regular, where `cartstiff.gradient` answers.

        Raises
        ------
        UnknownNameError
            For another output.
        UndefinedError
            For closed chains, and where derivatives come from outside of the program.
        InputError
            As a call.
        """
        # Only a single number of a posture that does not follow from steps has slopes
        # here.
        outputs = {} if self.tape is None else self.tape.outputs
        numbers = [name for name, steps in outputs.items() if len(steps) == 1]
        check_name("output", of, [name for name in numbers if name in self.names])
        if not self.has_slopes:
            raise UndefinedError(
                "coordinates follow others here: cartstiff.gradient has the derivatives",
                code="no-objective",
            )
        self._replaced({}, wrench)
        several: Any = [q] if np.ndim(q) == 1 else q
        Q = checked_q(self.elastic, several)
        loads = checked_wrench(self.elastic, wrench, len(Q))
        found = self.slopes(of, Q, loads, os.cpu_count() or 1)
        answer = {name.removeprefix("by_"): rows for name, rows in found.items()}
        answer[of] = answer[of][:, 0]
        return answer if np.ndim(q) > 1 else {n: rows[0] for n, rows in answer.items()}

    def _code(self, count: int) -> tuple[Kernel | None, str, str]:
        """As of `Recording`; that of single postures for all but very many."""
        if self.tape is None:
            return None, "engine", self.reason
        path = "portable" if self.path == "python" else self.path
        return self._kernel(self.tape, count), path, self.reason

    def _one(self, tape: Tape) -> OnePosture:
        """The code of single postures."""
        if tape not in self._made:
            assert self.taken is not None
            self._made[tape] = one_posture(tape, self._constants(self.taken))
        return self._made[tape]

    def _kernel(self, tape: Tape, count: int) -> Kernel:
        is_compiled = self.path == "compiled"
        if is_compiled and count < WORTH_WIDENING:
            return self._one(tape)
        return kernel_of(tape, is_compiled)

    def _steps(self) -> Mapping[tuple[str, ...], Kernel]:
        """The code of the steps that a call takes."""
        made = dict[tuple[str, ...], Kernel]()
        if self.path == "compiled" and self._closing is not None:
            made[CLOSING] = self._closing.step
        if self.path == "compiled" and self._settling is not None:
            made[SETTLING] = self._settling
        return made


@checked
def record(
    elastic: ElasticMechanism,
    outputs: str
    | Connection
    | Sequence[str | Connection | Function]
    | Mapping[str, str | Connection | Function] = ("stiffness_B",),
    *,
    loaded: bool = False,
    load_kind: Behaviour = "dead",
    load_at: ArrayLike = DEAD_AT_ORIGIN.at,
    load_axes: Axes = "body",
    inputs: Sequence[Literal["stiffness", "rest", "load_at", "payload", "tcp"]] = (),
    connection: str | None = None,
    length: float | None = None,
    direction: ArrayLike | None = None,
    deflect: ArrayLike | None = None,
) -> Program:
    """Record the arithmetic of a mechanism: a program that answers in microseconds.

    Parameters
    ----------
    elastic : ElasticMechanism
        Mechanism and potentials, from `cartstiff.load`.
    outputs : sequence or mapping
        Outputs of `cartstiff.analyse_many` by name ("B" is short for "stiffness_B");
        quantities by name (`cartstiff models --quantities`); connections of your own, for
        "stiffness_NAME" and "compliance_NAME" under each; and functions of a mapping of
        arrays by name, made of + - * / and products of arrays, whose results have their
        key in a mapping, or else the function's own name.
    loaded : bool
        Whether a call takes a wrench on the body, which the springs balance at the
        posture.
    load_kind, load_at, load_axes
        Behaviour of that load while the body moves, its point of application and its
        axes, as in `cartstiff.analyse`.
    inputs : sequence of {"stiffness", "rest", "load_at", "payload", "tcp"}
        Numbers that a call may replace: those of the springs, the load's point (3,) in M,
        (4,) mass [kg] and centre in M of a payload, which hangs besides the mechanism's
        own, and (6,) x, y, z and roll, pitch, yaw [rad] of the tool of a chain in the
        present M, to which then all that is in M refers. Rest positions must all be
        given, and without a load, which would replace them; a payload needs gravity.
    connection, length, direction, deflect
        Settings of the quantities, as in `cartstiff.maps.map_of`: `direction` is a vector
        (3,), `deflect` a wrench (6,). The default connection of a program under a load is
        "load", and the default length the natural one at the default posture without it.

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
    # The load.
    loaded, inputs = checked_flag(loaded, "loaded"), tuple(dict.fromkeys(inputs))
    kind = checked_load(
        load_kind, load_at, load_axes, loaded, checked_elastic(elastic).may_be_loaded
    )
    if loaded and elastic.springs is None:
        raise InputError(
            "the load of this mechanism follows from its potentials and cannot be given",
            expected="loaded=False",
        )
    # Outputs: matrices and arrays, quantities of tables, the caller's functions.
    if isinstance(outputs, (str, Connection)):
        outputs = [outputs]
    if not isinstance(outputs, Mapping):
        outputs = _by_name(outputs)
    for key, output in outputs.items():
        if isinstance(output, str) and full_name(key) != full_name(output):
            raise InputError(
                "output keeps its name", where=f"outputs, {key}", expected=output
            )
    named = [full_name(o) for o in outputs.values() if isinstance(o, str)]
    for name in named:
        check_name("output", name, (*EVERY_OUTPUT, *QUANTITIES))
    quantities = [o for o in named if o not in EVERY_OUTPUT]
    names = checked_names([o for o in named if o not in quantities])
    own = _with_quantities(
        OwnOutputs.of(outputs, shapes_of(elastic)),
        quantities,
        elastic,
        kind,
        loaded,
        connection=connection,
        length=length,
        direction=direction,
        deflect=deflect,
    )
    # Inputs besides the coordinates.
    for name in inputs:
        check_name("input", name, Inputs.__annotations__)
    _check_inputs(elastic, inputs, loaded)
    if "payload" not in inputs:
        check_masses([QUANTITIES[name] for name in quantities], elastic)
    if inputs and "rest" in inputs and (loaded or not springs_of(elastic).is_complete):
        raise InputError(
            "rest positions that are found at each posture are no inputs",
            where="inputs",
            expected="rest positions of all springs, and no load",
        )
    return Program(elastic, names, own, loaded, kind, load_axes, inputs)


def _check_inputs(
    elastic: ElasticMechanism, inputs: Collection[str], loaded: bool
) -> None:
    """Refuse numbers that cannot be inputs."""
    refused = "", ""
    if "load_at" in inputs and not loaded:
        refused = "the point is that of a load", "loaded=True"
    if "payload" in inputs and elastic.gravity is None:
        refused = "a payload weighs nothing here", "a mechanism with gravity"
    if "tcp" in inputs and elastic.acts_on_body:
        refused = "something is fixed to M itself", "other inputs"
    if "tcp" in inputs and elastic.mechanism.coordinates_are_pose:
        refused = "lines hold this body where it is", "the tool of a chain"
    if refused[0]:
        raise InputError(refused[0], where="inputs", expected=refused[1])


def _with_quantities(
    own: OwnOutputs,
    names: Sequence[str],
    elastic: ElasticMechanism,
    load: LoadKind,
    loaded: bool,
    **asked: Any,
) -> OwnOutputs:
    """The outputs with quantities and their settings; InputError for settings of none."""
    given = [name for name, value in asked.items() if value is not None]
    if given and not names:
        raise InputError(
            "is given, and no quantity is among the outputs",
            where=given[0],
            expected="a name of cartstiff models --quantities",
        )
    if not names:
        return own
    if loaded and asked["connection"] is None:
        asked["connection"] = "load"
    # The default length is that without the load, which is not known here.
    acting = DEAD_AT_ORIGIN if loaded else load
    settings = Settings.of(elastic, acting, None, "body", **asked)
    settings = replace(settings, load=load, is_loaded=loaded)
    chosen = choose_quantities(names, settings, elastic)
    check_used(settings, chosen)
    K, B = (replace(settings, connection=name) for name in "KB")
    for name, acts in (
        ("connection", any(q.outputs(K) != q.outputs(B) for q in chosen)),
        ("length", any(q.asks == "length" for q in chosen)),
    ):
        if name in given and not acts:
            raise InputError("is given, and no quantity needs it", where=name)
    return replace(own, quantities=tuple(names), settings=settings)


def _as_vector(values: ArrayLike, size: int, what: str) -> Array:
    """A copy as `size` doubles; whether they are finite is seen in the result."""
    try:
        array = np.array(values)
    except (TypeError, ValueError):
        return checked_input(values, (size,), what)
    is_usual = array.dtype == float and array.shape == (size,)
    return array if is_usual else checked_input(values, (size,), what)


def _by_name(outputs: Sequence[str | Connection | Function]) -> dict[str, Any]:
    """Outputs by their names, of which no two have the same."""
    found = dict[str, Any]()
    for output in outputs:
        own = full_name(output) if isinstance(output, str) else output
        name = own if isinstance(own, str) else _name_of(own)
        other = found.setdefault(name, own)
        if other is not own and not (isinstance(own, str) and other == own):
            raise InputError(
                "two outputs have the same name",
                where="outputs",
                expected="a mapping with a name for each",
                got=name,
            )
    return found


def _name_of(output: Any) -> str:
    name = getattr(output, "name", getattr(output, "__name__", None))
    if not isinstance(name, str):
        raise InputError(
            "output cannot be used",
            expected="a name, a connection, or a function",
            got=output,
        )
    return name
