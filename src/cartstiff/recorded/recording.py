"""The recorded arithmetic of a mechanism over many postures: coordinates in, arrays out.

Recorded formulas compute chains, open and closed, with lines between their bodies
(`cartstiff.recorded.chains`, `closed_chains`), and platforms on line springs
(`platforms`), as machine code for the mechanism (path "compiled") or over NumPy arrays
(path "portable"). `cartstiff.analyse` itself (path "engine") computes every other
mechanism.

A `Recording` holds it for given outputs: matrices, quantities of the table, and functions
of a user's own. `analyse_many` makes one for matrices, a map for quantities, and
`cartstiff.record` (`cartstiff.recorded.program`) one that also answers single postures.
"""

from __future__ import annotations

import math
import os
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from cartstiff.core.arrays import Array
from cartstiff.core.checked_call import checked
from cartstiff.core.errors import InputError, MissingDependencyError, UnknownNameError
from cartstiff.core.mechanisms.elastic import ElasticMechanism, checked_elastic
from cartstiff.core.stiffness.applied_load import (
    DEAD_AT_ORIGIN,
    Axes,
    Behaviour,
    LoadKind,
    checked_load,
)
from cartstiff.recorded.algebra import FALLBACK, PLAIN
from cartstiff.recorded.arguments import (
    EVERY_OUTPUT,
    MOTIONS,
    OF_VIBRATIONS,
    TENSIONS,
    TORQUES,
    aligned_empty,
    arrays_for,
    checked_count,
    checked_names,
    checked_q,
    checked_wrench,
    shapes_of,
)
from cartstiff.recorded.execution import Kernel
from cartstiff.recorded.gradient import gradient_program
from cartstiff.recorded.kernels import (
    ASKED,
    BACKENDS,
    LARGEST_PROGRAM,
    WORTH_COMPILING,
    Backend,
    few_of_closed,
    has_package,
    is_compiled,
    kernel_of,
    run,
)
from cartstiff.recorded.known_numbers import changed
from cartstiff.recorded.own_outputs import OwnOutputs
from cartstiff.recorded.plans import (
    Case,
    TracedModel,
    plan_with,
    program_for,
)
from cartstiff.recorded.postures import (
    REGULAR,
    Postures,
    Stack,
    clear_still_halves,
    described,
    is_moved,
    units_of,
)
from cartstiff.recorded.quantities import FREQUENCIES, Quantity, choose_quantities
from cartstiff.recorded.readings import Readings, recordable, with_masses
from cartstiff.recorded.stacks import needed_outputs, quantities_of
from cartstiff.recorded.tape import Arrays
from cartstiff.recorded.tape import Program as Tape

#: No outputs but those with a name.
NOTHING = OwnOutputs()
#: Postures at a time whose matrices are read, so that these stay in the cache.
_BLOCK = 2048


class Recording:
    """The recorded arithmetic of a mechanism for given outputs, over many postures.

    Parameters
    ----------
    elastic, is_loaded, load, load_axes, inputs
        As the attributes of `cartstiff.Program`.
    names : tuple of str
        Outputs of `analyse_many`.
    own : OwnOutputs
        Quantities, and outputs of a user's own.
    backend : {"auto", "compiled", "portable", "engine"}
        As `path` of `analyse_many`. But for "portable", quantities are recorded as far as
        they can be, so that no matrices are stored.

    Attributes
    ----------
    taken : TracedModel, optional
        The recorded arithmetic with its inputs, if there is some.
    tape : Program, optional
        Its program of the outputs.
    reason : str
        Why there is none.
    """

    #: Number of operations beyond which quantities are read from matrices.
    largest = LARGEST_PROGRAM

    def __init__(
        self,
        elastic: ElasticMechanism,
        names: tuple[str, ...],
        own: OwnOutputs = NOTHING,
        is_loaded: bool = False,
        load: LoadKind = DEAD_AT_ORIGIN,
        load_axes: Axes = "body",
        inputs: tuple[str, ...] = (),
        backend: Backend = "auto",
    ) -> None:
        self.elastic, self.is_loaded, self.inputs = elastic, is_loaded, inputs
        self.load, self.load_axes = load, load_axes
        self._given, self._own, self._backend = names, own, backend
        self._quantities: tuple[Quantity, ...] = ()
        if own.settings is not None:
            more = own.settings, elastic, own.defined
            self._quantities = choose_quantities(own.quantities, *more)
        # What `analyse` computes, and what follows from that.
        base = (*names, *own.needs, *self._needed(own.quantities))
        self._base = tuple(dict.fromkeys(base))
        self.names = (*names, *own.names, *own.quantities)
        self._shapes = shapes_of(elastic) | own.shapes | dict.fromkeys(own.quantities, ())
        self._count = len(elastic.mechanism.coordinates)
        self._shapes[MOTIONS] = self._count, -1
        self._shapes |= dict.fromkeys(OF_VIBRATIONS, (0, 0))
        self.reason = ASKED
        self.from_matrices: tuple[str, ...] = own.quantities
        self.taken: TracedModel | None = None
        self.tape: Tape | None = None
        self._usual: dict[str, Array] = {}
        self._derived = dict[str, Tape]()
        if backend == "engine":
            return
        taken = plan_with(elastic, is_loaded, inputs)
        if isinstance(taken, str):
            self.reason = taken
            if backend != "auto":
                raise InputError(
                    f"path {backend!r} does not serve this mechanism: {taken}",
                    expected="path 'engine'",
                )
            return
        unknown = {TORQUES} if elastic.mechanism.rigid else set[str]()
        if taken.untraced.has_drives:
            unknown = {TENSIONS, TORQUES}
        if not unknown.isdisjoint(self._base):
            self.reason = "the forces of these drives are found posture by posture"
            return
        self.reason, self.taken = "", taken.under(load, load_axes)
        self.tape = self._recorded(self.taken.case)
        for name in inputs:
            self._usual[name] = np.ascontiguousarray(self.taken.shared[name])[0]
        self._use(self.taken, self.tape)

    def _use(self, taken: TracedModel, program: Tape) -> None:
        """Make what is needed of the recorded arithmetic."""

    def _needed(self, quantities: Collection[str]) -> tuple[str, ...]:
        """Outputs that quantities are read from."""
        settings = self._own.settings
        if settings is None or not quantities:
            return ()
        some = [quantity for quantity in self._quantities if quantity.name in quantities]
        return needed_outputs(some, settings)

    def _recorded(self, case: Case) -> Tape:
        """The program of all outputs that can be recorded, and of what the others
        are read from.
        """
        own, settings, elastic = self._own, self._own.settings, self.elastic
        names: tuple[str, ...] = ()
        if self._backend != "portable" and own.quantities:
            names = recordable(elastic, case, own.quantities)
        # Vibrations need masses, which are constants.
        massive: Case | None = None
        if "payload" not in self.inputs and "kinetic" in self._base:
            massive = with_masses(elastic, case)
        if massive is None:
            names = tuple(name for name in names if name not in FREQUENCIES)
        few = tuple(name for name in names if name not in FREQUENCIES)
        tape: Tape | None = None
        for some in dict.fromkeys((names, few, ())):
            self.from_matrices = tuple(n for n in own.quantities if n not in some)
            stored = (*self._given, *self._needed(self.from_matrices))
            more: dict[str, Any] = {}
            if own:
                more["own"] = replace(own, quantities=(), settings=None, defined=())
            if some and settings is not None:
                more["readings"] = Readings.of(elastic, some, settings)
            if {*stored} != {*self._base}:
                more["stored"] = tuple(dict.fromkeys(stored))
            swings = "kinetic" in stored or not FREQUENCIES.isdisjoint(some)
            own_case = (swings and massive) or case
            tape = program_for(own_case, self._base, **more)
            if not some or (some[0] in tape.outputs and tape.size <= self.largest):
                break
        assert tape is not None
        n = math.isqrt(len(tape.outputs.get("kinetic", ())))
        self._shapes |= {"kinetic": (n, n), "lagrangian": (n, n), "motion": (6, n)}
        return tape

    def postures(
        self,
        q: Array,
        loads: Array | None,
        arrays: Arrays | None = None,
        numbers: Arrays | None = None,
        threads: int = 1,
        size: int | None = None,
        one_by_one: int | None = None,
    ) -> Postures:
        """Arrays of postures q (N, n), whose closed chains are near their closure.

        Parameters
        ----------
        q, loads
            Coordinates, and the wrench (6,) or (N, 6), if there is one.
        arrays : mapping of str to ndarray, optional
            Those to fill, of the shapes and units of the outputs, shape (N, ...).
        numbers : mapping of str to ndarray, optional
            Those of the inputs, in the shapes and units of `Program`, shape (...).
        threads, size, one_by_one
            As `threads`, `chunk` and `one_by_one` of `analyse_many`.
        """
        count, (elastic, load) = len(q), self.with_numbers(numbers or {})
        if arrays is None:
            shapes = {name: (count, *self._shapes[name]) for name in self.names}
            arrays = {name: aligned_empty(*shape) for name, shape in shapes.items()}
        at = q.copy() if is_moved(elastic, self.is_loaded) else q
        # One pass over all postures; mostly that is all.
        kernel, path, reason = self._code(count)
        state, taken = np.full(count, FALLBACK, np.uint8), self._with(numbers)
        stack = Stack(
            elastic,
            taken,
            at,
            loads,
            load,
            self.load_axes,
            arrays,
            state,
            path == "compiled",
            threads,
            size,
        )
        if kernel is not None:
            self._fill(kernel, stack)
        # What is left is read from matrices, or decided where these are computed.
        if self._own or self._own.quantities or (taken is not None and kernel is None):
            codes, fallback, other = self._fill_others(stack, q, one_by_one)
            path = other if kernel is None else path
        else:
            fallback, codes = stack.decide(one_by_one), stack.codes
        units = units_of(elastic.units)
        units |= {one.name: one.words(elastic.units) for one in self._quantities}
        return Postures(
            at,
            dict(arrays),
            state,
            tuple(codes),
            path,
            reason,
            elastic.names,
            fallback,
            described(elastic, load if self.is_loaded else None, self.load_axes),
            units,
            loads,
        )

    @property
    def has_slopes(self) -> bool:
        """Whether outputs have derivatives: nothing follows from steps, or from outside
        of the recorded arithmetic.
        """
        taken = self.taken
        if taken is None or self.tape is None:
            return False
        return not (taken.is_closed or taken.settles or taken.untraced)

    def slopes(
        self, of: str, q: Array, loads: Array | None, threads: int = 1
    ) -> dict[str, Array]:
        """An output `of` the program that is one number (N, 1), and "by_NAME" its
        derivatives (N, ...), in its unit per unit of the input.

        At coordinates (N, n) under `loads` (N, 6), if there are any, by so many
        `threads`. NaN at postures that are not plainly regular.
        """
        taken, tape = self.taken, self.tape
        assert taken is not None
        assert tape is not None
        if of not in self._derived:  # recorded once for each output
            self._derived[of] = gradient_program(tape, of)
        tape = self._derived[of]
        kernel, verdicts = self._kernel(tape, len(q)), np.zeros(len(q), np.uint8)
        outputs = {name: len(s) for name, s in tape.outputs.items() if name != "verdict"}
        found = {name: np.empty((len(q), size)) for name, size in outputs.items()}
        run(taken, kernel, q, loads, found, verdicts, threads, None)
        for rows in found.values():
            rows[verdicts != PLAIN] = np.nan
        return found

    def _kernel(self, tape: Tape, count: int) -> Kernel:  # noqa: ARG002
        """The code of a program for many postures."""
        return kernel_of(tape, False)

    def _code(self, count: int) -> tuple[Kernel | None, str, str]:
        """The code for many postures, its path, and the reason why there is no faster
        one.
        """
        tape = self.tape
        if tape is None:
            return None, "engine", self.reason
        reason = ""
        if self._backend == "portable":
            reason = ASKED
        elif not has_package("llvmlite"):
            error = MissingDependencyError("llvmlite", "the compiled path", "maps")
            if self._backend == "compiled":
                raise error
            reason = str(error)
        elif (
            self._backend == "auto" and count < WORTH_COMPILING and not is_compiled(tape)
        ):
            reason = f"compiling pays from {WORTH_COMPILING} postures on"
        path = "portable" if reason else "compiled"
        return kernel_of(tape, not reason), path, reason

    def _fill(self, kernel: Kernel, stack: Stack) -> None:
        """Fill arrays of plainly regular postures, and verdicts."""
        assert stack.taken is not None
        q, arrays, threads = stack.q, stack.arrays, stack.threads
        made = [name for name in kernel.program.outputs if name != "verdict"]
        more = [name for name in made if name not in arrays]
        direct = {
            name: rows
            for name, rows in arrays.items()
            if name in made or name not in self.from_matrices
        }
        # Of matrices that are only read, those of some postures at a time.
        for part in _blocks(len(q), _BLOCK * threads if more else len(q)):
            own, verdicts = stack.loads_of(part), stack.state[part]
            rows = {name: array[part] for name, array in direct.items()}
            count = len(q[part])
            rows |= {name: np.empty((count, *self._shapes[name])) for name in more}
            how = threads, stack.size
            run(
                stack.taken,
                kernel,
                q[part],
                own,
                rows,
                verdicts,
                *how,
                made=self._steps(),
            )
            if self.from_matrices:
                known = np.flatnonzero(verdicts == PLAIN)
                found = self._read(
                    self.from_matrices,
                    {name: array[known] for name, array in rows.items()},
                    q[part][known],
                    own if own is None or own.ndim == 1 else own[known],
                    stack.elastic,
                    stack.load,
                )
                for name, values in found.items():
                    arrays[name][part][known] = values

    def _steps(self) -> Mapping[tuple[str, ...], Kernel]:
        """The code of the steps to a posture, if there is some."""
        return {}

    def _fill_others(
        self, stack: Stack, q: Array, one_by_one: int | None
    ) -> tuple[list[str], int, str]:
        """Fill the postures that are not plain from their matrices.

        Returns
        -------
        codes : list of str
            Codes of the states.
        fallback : int
            Number of postures that `cartstiff.analyse` has computed.
        path : str
            Path of the matrices.
        """
        usual = REGULAR if self.taken is None else self.taken.regular
        codes, fallback, path = list(dict.fromkeys((REGULAR, usual))), 0, "engine"
        state, load = stack.state, stack.load
        which = np.flatnonzero(state != PLAIN)
        state[:] = codes.index(usual)
        given = stack.elastic, self._base, NOTHING, self.is_loaded, load, self.load_axes
        base = Recording(*given, backend=self._backend)
        # Matrices of some postures at a time, and what follows from them.
        for part in _blocks(len(which), _BLOCK):
            rows = which[part]
            own, threads = stack.loads_of(rows), stack.threads
            found = base.postures(q[rows], own, threads=threads, one_by_one=one_by_one)
            stack.q[rows], path = found.q, found.path
            made = found.arrays
            made |= self._own.values(made)
            names = self._own.quantities
            made |= self._read(names, made, found.q, own, stack.elastic, load)
            for name, array in stack.arrays.items():
                array[rows] = made[name]
            codes = list(dict.fromkeys((*codes, *found.codes)))
            index = np.array([codes.index(code) for code in found.codes], np.uint8)
            state[rows] = index[found.state]
            fallback += found.fallback
        return codes, fallback, path

    def _read(
        self,
        names: Collection[str],
        arrays: Arrays,
        q: Array,
        wrench: Array | None,
        elastic: ElasticMechanism,
        load: LoadKind,
    ) -> dict[str, Array]:
        """Quantities (N,) from matrices, whose round-off is cleared."""
        settings = self._own.settings
        if settings is None or not names:
            return {}
        if self.taken is not None and self.taken.regular != REGULAR:
            clear_still_halves(elastic, arrays)
        some = [quantity for quantity in self._quantities if quantity.name in names]
        known = {n: np.full((len(q), *self._shapes[n]), np.nan) for n in self._base}
        return quantities_of(
            elastic,
            some,
            replace(settings, load=load),
            {**known, **arrays},
            q,
            wrench,
            self.load_axes,
        )

    def _with(self, numbers: Arrays | None) -> TracedModel | None:
        """The recorded arithmetic with other numbers."""
        if self.taken is None or not self.inputs:
            return self.taken
        own = {**self._usual, **(numbers or {})}
        given = {name: np.atleast_2d(values) for name, values in own.items()}
        return replace(self.taken, shared={**self.taken.shared, **given})

    def with_numbers(
        self, numbers: Mapping[str, ArrayLike]
    ) -> tuple[ElasticMechanism, LoadKind]:
        """The mechanism, and the kind of load, with other `numbers` of the inputs, in the
        shapes and units of a call (...).
        """
        own = {name: numbers[name] for name in self.inputs if name in numbers}
        return changed(self.elastic, self.load, own)


def _blocks(count: int, length: int) -> Iterator[slice]:
    """Parts of `count` rows."""
    return (slice(i, i + length) for i in range(0, count, max(length, 1)))


@checked
def analyse_many(
    elastic: ElasticMechanism,
    q: ArrayLike,
    *,
    wrench: ArrayLike | None = None,
    load_kind: Behaviour = "dead",
    load_at: ArrayLike = DEAD_AT_ORIGIN.at,
    load_axes: Axes = "body",
    outputs: Sequence[str] = ("stiffness_B",),
    out: Arrays | None = None,
    threads: int | None = None,
    path: Backend = "auto",
    chunk: int | None = None,
    one_by_one: int | None = None,
) -> Postures:
    r"""Stiffness of a mechanism at many postures: `cartstiff.analyse` for stacks.

    Parameters
    ----------
    elastic : ElasticMechanism
        Mechanism and potentials, from `cartstiff.load`.
    q : array_like (N, n)
        Coordinates in rad and length units, one posture a row.
    wrench : array_like (6,) or (N, 6), optional
        (moment, force) on the body at `load_at`, for all postures or for each; as in
        `analyse`, the rest positions are then chosen at every posture.
    load_kind, load_at, load_axes
        Behaviour of the load while the body moves, its point of application and its axes,
        as in `analyse`.
    outputs : sequence of str
        Any of "pose" (N, 4, 4), "jacobian" (N, 6, n), "wrench" (N, 6), "energy" (N,),
        "stiffness_X" and "compliance_X" (N, 6, 6) for X one of A, B, K, F and load, the
        tangent under the load; "X" alone is short for "stiffness_X"; "tensions" (N, m) of
        a platform's legs. Only what they need is computed.
    out : mapping of str to ndarray, optional
        Arrays of doubles, of the shapes of the outputs, shape (N, ...), to write them
        into. Reusing memory saves its allocation, which takes longer than the
        computation.
    threads : int, optional
        Threads of the compiled path; default: as many as there are processors. The others
        use one. The result does not depend on it.
    path : {"auto", "compiled", "portable", "engine"}
        Machine code made by llvmlite; NumPy; one `analyse` after the other. "auto" takes
        the first that is possible.
    chunk : int, optional
        Postures computed at a time. The result does not depend on it.
    one_by_one : int, optional
        Largest number of postures, spread evenly over those that the fast paths cannot
        decide, that `analyse` computes; the others have NaN and the state "undecided".
        Default: all.

    Returns
    -------
    Postures
        Arrays, the state of every posture, and the path that computed them.

    Raises
    ------
    InputError
        For wrong shapes, numbers that are not finite, unknown outputs, or a path that
        does not serve this mechanism. A posture in which something does not exist is no
        error: it has its state, and NaN.
    MissingDependencyError
        If `path` is "compiled" and llvmlite is not installed.
    """
    # Everything is checked, and room is made, before anything is computed.
    coordinates = checked_q(checked_elastic(elastic), q)
    coordinates = elastic.mechanism.closed_as_given(coordinates)
    loads = checked_wrench(elastic, wrench, len(coordinates))
    names = checked_names(outputs)
    count = checked_count("threads", threads) or os.cpu_count() or 1
    if path not in BACKENDS:
        raise UnknownNameError("path", str(path), BACKENDS)
    size = checked_count("chunk", chunk)
    most = checked_count("one_by_one", one_by_one, 0)
    given = {"q": (q, coordinates), "wrench": (wrench, loads)}
    read = {n: x if isinstance(x, np.ndarray) else own for n, (x, own) in given.items()}
    arrays = arrays_for(elastic, names, out, len(coordinates), read)
    kind = checked_load(
        load_kind, load_at, load_axes, loads is not None, elastic.may_be_loaded
    )
    return arrays_of_many(
        elastic,
        # In a fixed order, so that equal sets share a kernel.
        tuple(name for name in EVERY_OUTPUT if name in names),
        coordinates,
        loads,
        kind,
        load_axes,
        path,
        arrays=arrays,
        threads=count,
        size=size,
        one_by_one=most,
    )


def arrays_of_many(
    elastic: ElasticMechanism,
    names: tuple[str, ...],
    q: Array,
    loads: Array | None,
    load: LoadKind,
    axes: Axes,
    path: Backend = "auto",
    **how: Any,
) -> Postures:
    """As `analyse_many`, of checked arguments; `names` may be those of programs alone.

    `how` as further arguments of `Recording.postures`.
    """
    acting = loads is not None, load, axes
    reason = few_of_closed(elastic, acting[0], len(q)) if path == "auto" else ""
    backend: Backend = "engine" if reason else path
    recording = Recording(elastic, names, NOTHING, *acting, backend=backend)
    recording.reason = reason or recording.reason
    return recording.postures(q, loads, **how)
