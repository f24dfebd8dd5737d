"""Execution of a recorded program: over rows of arrays, for one posture, or in a browser.

As Python or JavaScript, a program is one straight-line function in the order of the
operations, so that sums, products, quotients and roots are equal to the last bit. The
same Python runs on numbers, or over NumPy arrays in chunks that fit into the cache. Sines
and cosines are those of the language. llvmlite makes machine code.
"""

from __future__ import annotations

import ctypes
import json
import math
import os
import re
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache, lru_cache
from itertools import chain
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from cartstiff.core.arrays import Array
from cartstiff.recorded.arguments import address_of, aligned_empty
from cartstiff.recorded.tape import Arrays, Program
from cartstiff.recorded.vector_code import (
    input_arrays,
    scratch_size,
    vector_code,
)

if TYPE_CHECKING:
    from concurrent.futures import ThreadPoolExecutor

#: Postures per chunk: many enough to hide the cost of a call, few enough for the cache.
CHUNK = 768

# -- as source
# ---------------------------------------------------------------------------------

#: JavaScript's `Math` has no copysign: the size of the first number with the sign of the
#: second.
HELPERS = "const withSign=(x,y)=>y<0||Object.is(y,-0)?-Math.abs(x):Math.abs(x);"

# Length of an expression from which on its value gets a name, which limits the nesting.
_LONGEST_EXPRESSION = 160


class Language(NamedTuple):
    """Templates of a language for operations and for naming a value, and its words for
    numbers that are not finite.
    """

    words: Mapping[str, str]
    nan: str
    infinity: str
    named: str

    def number(self, value: float) -> str:
        """A number; a negative one in parentheses."""
        if math.isnan(value):
            return self.nan
        text = self.infinity if math.isinf(value) else repr(abs(value))
        return f"(-{text})" if math.copysign(1.0, value) < 0.0 else text


_ARITHMETIC = {
    "add": "({}+{})",
    "sub": "({}-{})",
    "mul": "({}*{})",
    "div": "({}/{})",
    "neg": "(-{})",
    **{name: f"{name}({{}})" for name in ("sqrt", "abs", "sin", "cos")},
    "max": "max({},{})",
    "copysign": "copysign({},{})",
    "pick": "({}<{}?{}:{})",
}
#: A language that writes choices as C does.
C_LIKE = Language(_ARITHMETIC, "NaN", "Infinity", "const {}={};")
_IN_MATH = {n: w if w[0] == "(" else f"Math.{w}" for n, w in _ARITHMETIC.items()}
JAVASCRIPT = C_LIKE._replace(words={**_IN_MATH, "copysign": "withSign({},{})"})
PYTHON = Language(
    {**_ARITHMETIC, "pick": "({2} if {0}<{1} else {3})"},
    "float('nan')",
    "float('inf')",
    "{}={}",
)
_NUMPY = PYTHON._replace(words={**PYTHON.words, "pick": "where({}<{},{},{})"})
#: Functions that the two call, besides those of Python.
_ON_NUMBERS = {name: getattr(math, name) for name in ("sqrt", "copysign", "sin", "cos")}
_ON_ARRAYS = {
    **{name: getattr(np, name) for name in (*_ON_NUMBERS, "abs", "where")},
    "max": np.maximum,
}


class _Source(NamedTuple):
    """Lines that name values, the outputs' expressions, each output's place,
    and input arrays.
    """

    lines: list[str]
    outputs: list[str]
    places: dict[str, tuple[int, int]]
    arrays: dict[str, str]


def _placed(program: Program) -> tuple[dict[str, tuple[int, int]], list[int]]:
    """Place of each output in a record, shared by equal outputs,
    and the record's steps.
    """
    places: dict[tuple[int, ...], tuple[int, int]] = {}
    ends: list[int] = []
    for steps in program.outputs.values():
        if steps not in places:
            places[steps] = len(ends), len(ends) + len(steps)
            ends += steps
    return {name: places[steps] for name, steps in program.outputs.items()}, ends


def written(program: Program, language: Language) -> _Source:
    """A program as source; `arrays` has the name of each input array in it.

    Values that are read once are written where they are read; operations keep their
    order.
    """
    places, ends = _placed(program)
    reads = [0] * len(program.operations)
    read = (o.arguments for o in program.operations if o.name != "input")
    for step in chain(ends, *read):
        reads[step] += 1
    source = _Source([], [], places, {})
    texts: list[str] = []
    for step, (kind, arguments, value) in enumerate(program.operations):
        if kind == "constant":
            text = language.number(value)
        elif kind == "input":
            array, index = program.inputs[arguments[0]]
            text = f"{source.arrays.setdefault(array, f'a{len(source.arrays)}')}[{index}]"
        else:
            text = language.words[kind].format(*(texts[a] for a in arguments))
        # A constant gets a name only if it is long and read often.
        is_operation = kind not in ("constant", "input")
        often = reads[step] > (2 if kind == "input" else 1)
        if (often and (is_operation or len(text) > 6)) or (
            is_operation and len(text) > _LONGEST_EXPRESSION
        ):
            source.lines.append(language.named.format(f"v{step}", text))
            text = f"v{step}"
        texts.append(text)
    source.outputs.extend(texts[step] for step in ends)
    return source


def javascript(program: Program) -> tuple[str, dict[str, tuple[int, int]]]:
    """Source of a function of (inputs, out), and the place of each output in `out`.

    Parameters
    ----------
    program : Program
        The program.

    Returns
    -------
    source : str
        ``(i,o)=>{...}``: `i` holds an array for each input by name, `o` is a
        Float64Array.
    places : dict of str to (int, int)
        Start and end of each output.
    """
    lines, outputs, places, arrays = written(program, JAVASCRIPT)
    head = "".join(
        f"const {short}=i[{json.dumps(name)}];" for name, short in arrays.items()
    )
    ends = "".join(f"o[{place}]={text};" for place, text in enumerate(outputs))
    return f"(i,o)=>{{{head}{''.join(lines)}{ends}}}", places


def _python(
    program: Program, language: Language, functions: Mapping[str, Any]
) -> tuple[Callable[..., list[Any]], list[str], dict[str, slice]]:
    """A Python function of lists, the names of these, and the outputs' places
    in its result.
    """
    lines, outputs, places, arrays = written(program, language)
    if language is _NUMPY:  # free the memory of arrays after their last use
        last = {
            name: i
            for i, line in enumerate(lines)
            for name in re.findall(r"\bv\d+", line)
        }
        for name in last.keys() - set(re.findall(r"\bv\d+", " ".join(outputs))):
            lines[last[name]] += f";del {name}"
    body = [*lines, f"return [{','.join(outputs)}]"]
    known = dict(functions)
    source = "\n ".join([f"def record({','.join(arrays.values())}):", *body])
    exec(compile(source, "<recorded posture>", "exec"), known)
    return (
        known["record"],
        list(arrays),
        {name: slice(*ends) for name, ends in places.items()},
    )


class Kernel:
    """A program that computes rows of arrays.

    Attributes
    ----------
    program : Program
    """

    program: Program

    def run(
        self,
        inputs: Arrays,
        outputs: Arrays,
        count: int,
        threads: int = 1,
    ) -> None:
        """Compute `count` rows of outputs from rows of inputs, all of them contiguous.

        Every array has two dimensions; shared inputs have one row.
        """
        raise NotImplementedError

    def __call__(self, inputs: Arrays, threads: int = 1) -> dict[str, Array]:
        """Outputs (N, ...) by name, from inputs (N, ...), or (1, ...) for shared ones,
        by name.
        """
        rows = {name: np.ascontiguousarray(array) for name, array in inputs.items()}
        count = len(
            next(a for name, a in rows.items() if name not in self.program.shared)
        )
        outputs = {
            name: aligned_empty(count, len(own))
            for name, own in self.program.outputs.items()
        }
        self.run(rows, outputs, count, threads)
        return outputs


class PortableKernel(Kernel):
    """A program over NumPy arrays, on one thread: several would wait for Python."""

    def __init__(self, program: Program) -> None:
        self.program = program
        self._function, self._arrays, self._places = _python(program, _NUMPY, _ON_ARRAYS)

    def run(
        self,
        inputs: Arrays,
        outputs: Arrays,
        count: int,
        threads: int = 1,  # noqa: ARG002
    ) -> None:
        """As `Kernel.run`."""
        shared = self.program.shared
        for start in range(0, count, CHUNK):
            part = slice(start, min(start + CHUNK, count))
            columns = []
            for name in self._arrays:
                rows = inputs[name]
                same = name in shared
                columns.append(rows[0] if same else np.ascontiguousarray(rows[part].T))
            with np.errstate(all="ignore"):
                values = self._function(*columns)
            for name, place in self._places.items():
                rows = outputs[name][part]
                for column, value in enumerate(values[place]):
                    rows[:, column] = value


#: Optimisation level of LLVM, 0 to 3; 3 makes no faster code.
OPTIMISATION = 2
#: Bytes of output beyond which writing past the cache is faster.
STREAMED = 1 << 23

_SIGNATURE = ctypes.CFUNCTYPE(None, ctypes.c_int64, *[ctypes.c_void_p] * 4)


@cache
def _binding() -> Any:
    import llvmlite.binding as llvm

    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    return llvm


@cache
def lanes() -> int:
    """Doubles per vector of this processor."""
    features = _binding().get_host_cpu_features()
    if features.get("avx512f"):
        return 8
    return 4 if features.get("avx") else 2


@lru_cache(maxsize=4)
def _pool(threads: int) -> ThreadPoolExecutor:
    from concurrent.futures import ThreadPoolExecutor  # only sweeps need it

    return ThreadPoolExecutor(threads, thread_name_prefix="cartstiff-many")


if hasattr(os, "register_at_fork"):
    # A forked process does not have its parent's threads.
    os.register_at_fork(after_in_child=_pool.cache_clear)


class CompiledKernel(Kernel):
    """A program as machine code; keeps LLVM's engines that own it, and scratch memory."""

    #: Whether many outputs are written past the cache, by code of its own.
    streams = True

    def __init__(self, program: Program, width: int | None = None) -> None:
        self.program = program
        self.block = width or lanes()
        self.arrays = input_arrays(program)
        self.scratch = scratch_size(program, self.block)
        self._made: dict[bool, tuple[Any, Any]] = {}
        self._free: list[Array] = []

    def entry(self, stream: bool) -> Any:
        """The function that writes through the cache or, with `stream`, past it."""
        if (
            stream not in self._made
        ):  # if two threads compile it at once, one result is kept
            self._made.setdefault(stream, self._compile(stream))
        return self._made[stream][1]

    def _compile(self, stream: bool) -> tuple[Any, Any]:
        llvm = _binding()
        machine = llvm.Target.from_default_triple().create_target_machine(
            cpu=llvm.get_host_cpu_name(),
            features=llvm.get_host_cpu_features().flatten(),
            opt=OPTIMISATION,
        )
        module = llvm.parse_assembly(vector_code(self.program, self.block, stream))
        module.triple = llvm.get_process_triple()
        engine = llvm.create_mcjit_compiler(module, machine)
        engine.finalize_object()
        return engine, _SIGNATURE(engine.get_function_address("kernel"))

    def memory(self) -> Array:
        """Scratch memory for one thread, which `run` returns to the free list."""
        try:
            return self._free.pop()
        except IndexError:
            scratch = aligned_empty(self.scratch)
            # The first round computes with this content: zeros are as fast as any number.
            scratch[:] = 0.0
            return scratch

    def run(
        self,
        inputs: Arrays,
        outputs: Arrays,
        count: int,
        threads: int = 1,
    ) -> None:
        """As `Kernel.run`."""
        block, shared = self.block, self.program.shared
        size = sum(rows.nbytes for rows in outputs.values())
        stream = self.streams and size > STREAMED
        whole = count - count % block
        if whole:
            self._run(inputs, outputs, whole // block, threads, stream)
        if whole < count:
            # The last rows, padded to a whole block.
            padded = {}
            for name in self.arrays:
                rows = inputs[name]
                if name not in shared:
                    rows = rows[whole:count]
                    rows = np.concatenate(
                        [rows, np.repeat(rows[-1:], block - len(rows), axis=0)]
                    )
                padded[name] = np.ascontiguousarray(rows)
            arrays = {
                n: aligned_empty(block, len(s)) for n, s in self.program.outputs.items()
            }
            self._run(padded, arrays, 1, 1, stream)
            for name, rows in arrays.items():
                outputs[name][whole:count] = rows[: count - whole]

    def _run(
        self,
        inputs: Arrays,
        outputs: Arrays,
        blocks: int,
        threads: int,
        stream: bool,
    ) -> None:
        read = [address_of(inputs[name]) for name in self.arrays]
        written = [address_of(outputs[name]) for name in self.program.outputs]
        entry = self.entry(stream and not any(address % 64 for address in written))
        pointers = pointers_to(read), pointers_to(written)
        progress = (ctypes.c_int64 * 2)()

        def share(scratch: Array, held: object = (inputs, outputs)) -> None:  # noqa: ARG001
            # An interrupt may end this thread's call: keep the arrays that other threads
            # write to.
            entry(blocks, *pointers, address_of(scratch), progress)
            self._free.append(scratch)

        own, *others = [self.memory() for _ in range(min(threads, blocks))]
        shares = [_pool(len(others)).submit(share, scratch) for scratch in others]
        share(own)
        for other in shares:
            if progress[1] < blocks:
                other.result()
            other.cancel()  # one that has not begun would find no block left


def pointers_to(addresses: list[int]) -> Any:
    """C array of pointers."""
    return (ctypes.c_void_p * len(addresses))(*addresses)


_ROWS, _COLUMNS = np.tril_indices(6)


def lower_triangle(matrix: Array) -> Array:
    """Lower triangle of a symmetric matrix (6, 6), row by row."""
    return np.asarray(matrix[_ROWS, _COLUMNS])


def from_triangles(rows: Array) -> Array:
    """Symmetric matrices (N, 6, 6) from rows that begin with `lower_triangle`."""
    matrices = np.empty((len(rows), 6, 6))
    matrices[:, _ROWS, _COLUMNS] = matrices[:, _COLUMNS, _ROWS] = rows[:, : len(_ROWS)]
    return matrices


class OnePosture(Kernel):
    """A program for one posture at a time, by machine code or by Python on numbers.

    Attributes
    ----------
    at : dict of str to slice
        Place of each output in a record.
    """

    at: dict[str, slice]

    def record(self, **given: Array) -> Array:
        """All outputs in one array, from inputs (n,) or (1, n) by name.

        Inputs that the program does not read are ignored.
        """
        raise NotImplementedError

    def run(
        self,
        inputs: Arrays,
        outputs: Arrays,
        count: int,
        threads: int = 1,  # noqa: ARG002
    ) -> None:
        """As `Kernel.run`, for one row."""
        if count != 1:
            raise ValueError("one posture at a time")
        record = self.record(**inputs)
        for name, row in outputs.items():
            row[0] = record[self.at[name]]


class PrintedPosture(OnePosture):
    """One posture at a time by straight-line Python, where llvmlite is not installed."""

    def __init__(self, program: Program, shared: Arrays) -> None:
        self.program = program
        self._function, self._names, self.at = _python(program, PYTHON, _ON_NUMBERS)
        self._shared = {name: rows.ravel().tolist() for name, rows in shared.items()}
        self._nothing = np.full(max(place.stop for place in self.at.values()), np.nan)

    def record(self, **given: Array) -> Array:
        """As `OnePosture.record`; all NaN if a number is not finite or has no root."""
        known = self._shared
        lists = [
            known[n] if n in known else given[n].ravel().tolist() for n in self._names
        ]
        try:
            record = np.array(self._function(*lists))
        except (ZeroDivisionError, ValueError, OverflowError):
            return self._nothing.copy()
        # Python's `max` does not propagate NaN.
        return record if math.isfinite(record.sum()) else self._nothing.copy()


class CompiledPosture(OnePosture):
    """One posture at a time by machine code."""

    def __init__(self, program: Program, shared: Arrays) -> None:
        self.program = program
        places, steps = _placed(program)
        self.at = {name: slice(*ends) for name, ends in places.items()}
        self._kernel = CompiledKernel(
            replace(program, outputs={"record": tuple(steps)}), width=2
        )
        self._kernel.streams = False
        self._entry, self._shared = self._kernel.entry(False), shared
        self._free: list[tuple[Any, ...]] = []

    def run(
        self,
        inputs: Arrays,
        outputs: Arrays,
        count: int,
        threads: int = 1,
    ) -> None:
        """As `Kernel.run`, for any number of rows."""
        if count == 1:
            super().run(inputs, outputs, 1)
            return
        records = aligned_empty(count, len(self._kernel.program.outputs["record"]))
        inputs = {**self._shared, **inputs}
        self._kernel.run(inputs, {"record": records}, count, threads)
        for name, rows in outputs.items():
            rows[...] = records[:, self.at[name]]

    def record(self, **given: Array) -> Array:
        """As `OnePosture.record`."""
        try:
            memory = self._free.pop()  # one for each thread that calls at the same time
        except IndexError:
            memory = self._memory()
        inputs, written, progress, arguments, _ = memory
        for name, place in inputs.items():
            place[:] = given[name]
        progress[:] = [0, 0]
        self._entry(*arguments)
        record: Array = written[0].copy()
        self._free.append(memory)
        return record

    def _memory(self) -> tuple[Any, ...]:
        """Arrays that one call reads, writes and counts in, its arguments,
        and their memory.
        """
        kernel, program = self._kernel, self._kernel.program
        block, widths = kernel.block, program.widths
        own = {
            name: np.empty((1 if name in program.shared else block, widths[name]))
            for name in kernel.arrays
            if name not in self._shared
        }
        inputs, scratch = {**self._shared, **own}, kernel.memory()
        written = aligned_empty(kernel.block, len(program.outputs["record"]))
        read = pointers_to([address_of(inputs[name]) for name in kernel.arrays])
        progress = (ctypes.c_int64 * 2)()
        arguments = (
            1,
            read,
            pointers_to([address_of(written)]),
            address_of(scratch),
            progress,
        )
        return own, written, progress, arguments, (inputs, scratch)
