"""Choice of the kernel for a stack of postures, and its run in chunks."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache, partial
from importlib.util import find_spec
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from cartstiff.core.arrays import Array
from cartstiff.core.mechanisms.elastic import ElasticMechanism
from cartstiff.core.numerics.threads import process_lock
from cartstiff.recorded.algebra import FALLBACK, PLAIN
from cartstiff.recorded.arguments import aligned_empty
from cartstiff.recorded.chains import ChainCase
from cartstiff.recorded.closed_chains import Closings, close, settle
from cartstiff.recorded.execution import (
    CHUNK,
    CompiledKernel,
    Kernel,
    PortableKernel,
)
from cartstiff.recorded.plans import (
    CLOSING,
    SETTLING,
    Case,
    TracedModel,
    plan,
    program_for,
)
from cartstiff.recorded.tape import Arrays, Program

Backend = Literal["auto", "compiled", "portable", "engine"]
BACKENDS = ("auto", "compiled", "portable", "engine")

#: Least number of postures for which a mechanism is compiled, for a map with its
#: quantities. Compiling an operation takes as long as computing it over NumPy arrays some
#: 25,000 times: 8,000 (a delta, whose steps to closure repeat it) to 80,000.
WORTH_COMPILING = 25_000
#: Number of operations beyond which compiling takes more than a few seconds.
LARGEST_PROGRAM = 60_000
#: Chunk of postures for machine code, a multiple of every block.
COMPILED_CHUNK = 1 << 17
#: Least number of postures for each thread.
LEAST_PER_THREAD = 2048
#: Least number of postures of lost rank that are recorded.
WORTH_RECORDING = 100
#: Postures a coordinate from which closed chains are recorded, and those whose links a
#: load bends: recording takes about as long as `cartstiff.analyse` for so many.
WORTH_CLOSING, WORTH_BENDING = 2, 3
#: Chunk of postures of closed chains: each step reads their coordinates again.
CLOSED_CHUNK = 4096
#: Chunk of postures with terms outside the program: these have n^2 numbers for each
#: posture.
EVALUATED_CHUNK = 1024


_made: dict[tuple[Program, bool], Kernel] = {}
_lock = process_lock()


def is_compiled(program: Program) -> bool:
    """Whether the machine code of a program is cached."""
    return (program, True) in _made


def kernel_of(program: Program, compiled: bool) -> Kernel:
    """Machine code of a program, or NumPy; the last 96 are cached."""
    with _lock:
        make = CompiledKernel if compiled else PortableKernel
        kernel = _made.pop((program, compiled), None) or make(program)
        _made[program, compiled] = kernel
        if len(_made) > 96:
            del _made[next(iter(_made))]
    return kernel


@lru_cache(maxsize=8)
def has_package(package: str) -> bool:
    """Whether a package is installed."""
    return find_spec(package) is not None


#: Reason for a path that the caller has chosen.
ASKED = "asked for"


def _workers(threads: int, rows: int) -> int:
    """Number of threads for a number of postures."""
    return max(1, min(threads, rows // LEAST_PER_THREAD))


def few_of_closed(elastic: ElasticMechanism, is_loaded: bool, count: int) -> str:
    """Reason why `cartstiff.analyse` is faster than recording a closed chain;
    empty if not.
    """
    mechanism = elastic.mechanism
    bends = is_loaded and mechanism.virtual
    least = (WORTH_BENDING if bends else WORTH_CLOSING) * len(mechanism.coordinates)
    few = count < least and bool(mechanism.closures)
    return f"such a closed chain is recorded from {least} postures on" if few else ""


def lasting_path(elastic: ElasticMechanism, is_loaded: bool, count: int) -> Backend:
    """The path for `count` postures, independent of kernels that this
    process has cached.
    """
    answer = few_of_closed(elastic, is_loaded, count) or plan(elastic, is_loaded)
    if isinstance(answer, str):
        return "engine"
    is_compiled = count >= WORTH_COMPILING and has_package("llvmlite")
    return "compiled" if is_compiled else "portable"


class _PostureSolver:
    """Solves for the coordinates of a posture: closes chains,
    deflects links under the load.
    """

    def __init__(
        self,
        taken: TracedModel,
        compiled: bool,
        threads: int = 1,
        made: Mapping[tuple[str, ...], Kernel] | None = None,
    ) -> None:
        case, self._home = taken.case, taken.home

        def make(way: Case, outputs: tuple[str, ...]) -> Kernel:
            if made and way is case:
                return made[outputs]
            return kernel_of(program_for(way, outputs), compiled and not made)

        ways = case.ways if isinstance(case, ChainCase) and case.is_closed else ()
        self._closing = [
            lambda way=way: partial(make(way, CLOSING), threads=threads) for way in ways
        ]
        self._settling: Any = None
        self._evaluate = partial(taken.untraced.derivatives, compiled=compiled)
        if taken.settles:
            self._settling = partial(make(case, SETTLING), threads=threads)

    def __bool__(self) -> bool:
        return bool(self._closing) or self._settling is not None

    def closed(self, q: Array, first: int | None = None) -> Closings:
        """Result of `close` for coordinates (N, n), by the `first` few ways, or all."""
        return close(self._closing[:first], q)

    def _assembled(self, q: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Close as `Chain.closed` does, from the reference posture if only held
        ones differ.
        """
        if self._home is None:
            return self.closed(q)[:2]
        near, steps = partial(self.closed, first=1), self._home.steps_where_asked(q)
        at, is_closed, is_vain = self._home.continue_from(near, q, steps)
        others = is_vain | (steps == 0)
        at[others], is_closed[others], _ = self.closed(q[others])
        return at, is_closed

    def solve(self, q: Array, inputs: Arrays) -> tuple[Array, NDArray[np.bool_]]:
        """Coordinates, and where they were found; elsewhere they are as given."""
        given, is_found = q, np.ones(len(q), bool)
        if self._closing:
            q, is_found = self._assembled(q)
        if self._settling is not None:
            moved, which = q.copy(), np.flatnonzero(is_found)
            which = settle(self._settling, self._evaluate, inputs, moved, which)
            is_found, q = np.isin(np.arange(len(q)), which), moved
        return np.where(is_found[:, None], q, given), is_found


class Closer:
    """Closes postures of a chain by recorded steps that keep the held coordinates.

    Parameters
    ----------
    elastic : ElasticMechanism
        The mechanism.
    compiled : bool
        Whether by machine code.
    """

    def __init__(self, elastic: ElasticMechanism, compiled: bool) -> None:
        taken = plan(elastic)
        self._solver: _PostureSolver | None = None
        if not isinstance(taken, str) and taken.is_closed:
            self._solver = _PostureSolver(taken, compiled)

    def __call__(self, q: Array) -> Closings:
        """Coordinates from q (N, n), where they close the chain, and where no steps can.

        Coordinates that do not close the chain are as given.
        """
        if self._solver is None or not len(q):
            return q, np.zeros(len(q), bool), np.zeros(len(q), bool)
        # The first way only: the next releases the held coordinates.
        parts = (
            self._solver.closed(q[i : i + CLOSED_CHUNK], 1)
            for i in range(0, len(q), CLOSED_CHUNK)
        )
        at, is_closed, is_vain = (
            np.concatenate(each) for each in zip(*parts, strict=True)
        )
        return at, is_closed, is_vain


def run(
    taken: TracedModel,
    kernel: Any,
    q: Array,
    loads: Array | None,
    arrays: Arrays,
    verdicts: NDArray[np.uint8],
    threads: int,
    size: int | None,
    more: Arrays | None = None,
    made: Mapping[tuple[str, ...], Kernel] | None = None,
) -> None:
    """Fill the arrays by a kernel in chunks; outputs that do not exist become NaN.

    `more` are further inputs (N, ...) by name; `made` the code of the steps to the
    posture, if there is some.

    Coordinates of closed chains are replaced by those that close them, those of compliant
    links by those at which they carry the load; if none are found, the verdict is
    `FALLBACK`.
    """
    if not len(q):
        return
    count = len(q)
    # What the program does not have is not a number.
    exists = {n: len(s) for n, s in kernel.program.outputs.items() if n != "verdict"}
    for name, array in arrays.items():
        if name not in exists:
            array[...] = np.nan
    is_compiled = not isinstance(kernel, PortableKernel)
    # How many postures at once: as many as the caches hold.
    length = size or (COMPILED_CHUNK if is_compiled else CHUNK)
    if taken.untraced:
        length = min(length, EVALUATED_CHUNK)
    if taken.is_closed:
        length = min(length, CLOSED_CHUNK)
    length = min(length, count)
    workers = _workers(threads, length)
    solver = _PostureSolver(taken, is_compiled, workers, made)
    # What is the same at all postures is given once.
    shared = {name: np.ascontiguousarray(array) for name, array in taken.shared.items()}
    if loads is not None:
        loads = np.broadcast_to(loads, (count, 6))
    verdict = aligned_empty(
        length, 1
    )  # aligned, or no output could be written past the cache
    # Chunk by chunk: find the postures, the terms of steps, then everything else.
    for start in range(0, count, length):
        stop = min(start + length, count)
        rows = stop - start
        inputs = {**shared, "q": np.ascontiguousarray(q[start:stop])}
        for name, array in (more or {}).items():
            inputs[name] = np.ascontiguousarray(array[start:stop])
        if loads is not None:
            inputs["wrench"] = np.ascontiguousarray(loads[start:stop])
        is_found = None
        if solver:
            q[start:stop], is_found = solver.solve(inputs["q"], inputs)
            inputs["q"] = np.ascontiguousarray(q[start:stop])
        doubts = None
        if taken.untraced:
            terms, doubts = taken.untraced.derivatives(
                inputs["q"], is_compiled, inputs.get("wrench")
            )
            inputs.update(terms)
        # Outputs are written where they belong, or copied there if those rows have gaps.
        chunk, copies = {"verdict": verdict[:rows]}, []
        for name, width in exists.items():
            part = arrays[name][start:stop]
            if part.flags.c_contiguous:
                chunk[name] = part.reshape(rows, width)
            else:
                chunk[name] = np.empty((rows, width))
                copies.append((part, chunk[name]))
        kernel.run(inputs, chunk, rows, workers)
        for part, values in copies:
            part[...] = values.reshape(part.shape)
        verdicts[start:stop] = verdict[:rows, 0]
        # What was not found, or found with doubts, is no plain posture.
        if doubts is not None:
            doubted = doubts != PLAIN
            verdicts[start:stop][doubted] = doubts[doubted]
        if is_found is not None:
            verdicts[start:stop][~is_found] = FALLBACK
