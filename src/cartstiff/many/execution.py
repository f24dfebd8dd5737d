"""A program as machine code for one posture at a time.

Running a program without machine code: over NumPy arrays, and in a browser.

Over arrays there is one call per operation on a chunk that stays in cache. As JavaScript or Python
it is one straight-line function: the order of every operation is kept, so that sums, products,
quotients and roots are the same to the last bit. Sines and cosines are those of the language.

Running a program as machine code made by llvmlite.

A program that is run again and again, on stacks of any length.
"""

from __future__ import annotations

import ctypes
import json
import math
import os
from collections import defaultdict
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import cache, lru_cache
from itertools import chain
from typing import Any, NamedTuple

import numpy as np

from cartstiff.geometry.se3 import Array
from cartstiff.many.arguments import address_of, aligned_empty
from cartstiff.many.tape import Program
from cartstiff.many.vector_code import LONGEST, input_arrays, scratch_size, vector_code

#: Postures per chunk: long enough to hide the cost of a call, short enough for the cache.
CHUNK = 768


def _larger(x: Array, y: Array, out: Array) -> None:
    np.maximum(x, y, out=out)


_CALLS: dict[str, Callable[..., Any]] = {
    "add": np.add,
    "sub": np.subtract,
    "mul": np.multiply,
    "div": np.divide,
    "neg": np.negative,
    "sqrt": np.sqrt,
    "abs": np.absolute,
    "max": _larger,
    "copysign": np.copysign,
    "sin": np.sin,
    "cos": np.cos,
}


class PortableKernel:
    """A program as a list of NumPy calls on reused buffers."""

    def __init__(self, program: Program) -> None:
        self.program = program
        self._slots, self._count = _assigned(program)

    def workspace(self, length: int, threads: int = 1) -> PortableBuffers:  # noqa: ARG002
        """Buffers and calls for chunks of `length` postures; threads would wait for Python."""
        return PortableBuffers(self.program, self._slots, self._count, length)


def _assigned(program: Program) -> tuple[list[int], int]:
    """Buffer of every operation, reused when nothing later reads it; and how many there are."""
    last = [-1] * len(program.operations)
    for step, operation in enumerate(program.operations):
        if operation.name != "input":
            for argument in operation.arguments:
                last[argument] = step
    slots, free, count = [-1] * len(program.operations), list[int](), 0
    for step, operation in enumerate(program.operations):
        if operation.name in ("input", "constant"):
            continue
        ending = [slots[a] for a in set(operation.arguments) if last[a] == step and slots[a] >= 0]
        # `pick` writes its result before it has read all of its arguments.
        if operation.name != "pick":
            free += ending
        if free:
            slots[step] = free.pop()
        else:
            slots[step], count = count, count + 1
        if operation.name == "pick":
            free += ending
        if last[step] < 0:
            free.append(slots[step])
    return slots, count


class PortableBuffers:
    """The program bound to buffers of one length."""

    def __init__(self, program: Program, slots: list[int], count: int, length: int) -> None:
        self.length = length
        buffers = np.empty((count, length))
        mask = np.empty(length, bool)
        used = {o.arguments[0] for o in program.operations if o.name == "input"}
        self._inputs: dict[str, list[tuple[int, Array]]] = {}
        constants: dict[int, Array] = {}
        for i in used:
            array, index = program.inputs[i]
            constants[i] = np.empty(() if array in program.shared else length)
            self._inputs.setdefault(array, []).append((index, constants[i]))
        self.staged = {name: np.empty((length, len(s))) for name, s in program.outputs.items()}
        columns: dict[int, list[Array]] = {}
        for name, steps in program.outputs.items():
            for c, step in enumerate(steps):
                columns.setdefault(step, []).append(self.staged[name][:, c])

        calls: list[tuple[Callable[..., Any], tuple[Any, ...]]] = []
        values: list[Array] = []
        for step, (name, arguments, value) in enumerate(program.operations):
            if name == "constant":
                values.append(np.array(value))  # NumPy is quickest with arrays of no dimension
            elif name == "input":
                values.append(constants[arguments[0]])
            else:
                read = [values[a] for a in arguments]
                out = buffers[slots[step]]
                values.append(out)
                if name == "pick":
                    calls.append((np.less, (read[0], read[1], mask)))
                    calls.append((_choose, (out, read[2], read[3], mask)))
                else:
                    calls.append((_CALLS[name], (*read, out)))
            for column in columns.get(step, ()):
                calls.append((np.copyto, (column, values[step])))
        self._calls = calls

    def run(self, inputs: Mapping[str, Array], outputs: Mapping[str, Array], count: int) -> None:
        """Compute `count` rows, not more than `length`: rows of inputs to rows of outputs.

        Every array has two dimensions; shared inputs have one row.
        """
        for name, targets in self._inputs.items():
            rows = inputs[name]
            for index, target in targets:
                if target.ndim == 0:
                    target[()] = rows[0, index]
                else:
                    target[:count] = rows[:, index]
                    target[count:] = rows[-1, index]
        with np.errstate(all="ignore"):
            for call, arguments in self._calls:
                call(*arguments)
        for name, staged in self.staged.items():
            np.copyto(outputs[name][:count], staged[:count])


def _choose(out: Array, yes: Array, no: Array, mask: Array) -> None:
    np.copyto(out, no)
    np.copyto(out, yes, where=mask)


# -- as source ---------------------------------------------------------------------------------

#: What JavaScript needs beside `Math`: the size of the first with the sign of the second.
HELPERS = "const withSign=(x,y)=>y<0||Object.is(y,-0)?-Math.abs(x):Math.abs(x);"

# Characters of an expression from which on it gets a name, so that none is nested too deeply.
_LONGEST = 160


class _Language(NamedTuple):
    """How a language writes operations, numbers and a value that gets a name."""

    words: Mapping[str, str]
    number: Callable[[float], str]
    named: str


_ARITHMETIC = {
    "add": "({}+{})",
    "sub": "({}-{})",
    "mul": "({}*{})",
    "div": "({}/{})",
    "neg": "(-{})",
}


def _javascript_number(value: float) -> str:
    if math.isnan(value):
        return "NaN"
    if math.isinf(value):
        return "Infinity" if value > 0 else "(-Infinity)"
    text = repr(value).removesuffix(".0")
    return f"({text})" if text.startswith("-") else text


_JAVASCRIPT = _Language(
    {
        **_ARITHMETIC,
        "sqrt": "Math.sqrt({})",
        "abs": "Math.abs({})",
        "max": "Math.max({},{})",
        "copysign": "withSign({},{})",
        "sin": "Math.sin({})",
        "cos": "Math.cos({})",
        "pick": "({}<{}?{}:{})",
    },
    _javascript_number,
    "const {}={};",
)
_PYTHON = _Language(
    {
        **_ARITHMETIC,
        **{name: f"{name}({{}})" for name in ("sqrt", "abs", "sin", "cos")},
        "max": "max({},{})",
        "copysign": "copysign({},{})",
        "pick": "({2} if {0}<{1} else {3})",
    },
    lambda value: f"({value!r})" if math.isfinite(value) else f"float({str(value)!r})",
    " {}={}",
)


class _Source(NamedTuple):
    """Lines that name values, outputs one after the other, where each stands, and the arrays."""

    lines: list[str]
    outputs: list[str]
    places: dict[str, tuple[int, int]]
    arrays: dict[str, str]


def _written(program: Program, language: _Language) -> _Source:
    """A program as source; `arrays` gives the name of each input array in it.

    Values that are read once stand where they are read, and the order of every operation is kept.
    """
    places: dict[str, tuple[int, int]] = {}
    ends: list[int] = []
    for name, steps in program.outputs.items():
        places[name] = len(ends), len(ends) + len(steps)
        ends += steps
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
        # A constant has no place of its own unless it is long and read often.
        is_operation = kind not in ("constant", "input")
        often = reads[step] > (2 if kind == "input" else 1)
        if (often and (is_operation or len(text) > 6)) or (is_operation and len(text) > _LONGEST):
            source.lines.append(language.named.format(f"v{step}", text))
            text = f"v{step}"
        texts.append(text)
    source.outputs.extend(texts[step] for step in ends)
    return source


def javascript(program: Program) -> tuple[str, dict[str, tuple[int, int]]]:
    """Source of a function of (inputs, out), and where in `out` each output stands.

    Parameters
    ----------
    program : Program
        What it computes.

    Returns
    -------
    source : str
        ``(i,o)=>{...}``: `i` holds an array for each input by name, `o` is a Float64Array.
    places : dict of str to (int, int)
        Start and end of each output.
    """
    lines, outputs, places, arrays = _written(program, _JAVASCRIPT)
    head = "".join(f"const {short}=i[{json.dumps(name)}];" for name, short in arrays.items())
    ends = "".join(f"o[{place}]={text};" for place, text in enumerate(outputs))
    return f"(i,o)=>{{{head}{''.join(lines)}{ends}}}", places


def _python(program: Program) -> tuple[Callable[..., list[float]], list[str], dict[str, slice]]:
    """A function of lists in Python, the names of these, and where in its list outputs stand."""
    lines, outputs, places, arrays = _written(program, _PYTHON)
    head = f"def record({','.join(arrays.values())}):"
    source = "\n".join([head, *lines, f" return [{','.join(outputs)}]"])
    known = {name: getattr(math, name) for name in ("sqrt", "copysign", "sin", "cos")}
    exec(compile(source, "<recorded posture>", "exec"), known)
    return known["record"], list(arrays), {name: slice(*ends) for name, ends in places.items()}


#: Bytes of output beyond which writing past the cache pays.
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


class CompiledKernel:
    """A program as machine code; keeps the engines that own it."""

    def __init__(self, program: Program, width: int | None = None, longest: int = LONGEST) -> None:
        self.program = program
        self.block = width or lanes()
        self.arrays = input_arrays(program)
        self.scratch = scratch_size(program, self.block, longest)
        self._longest = longest
        self._made: dict[bool, tuple[Any, Any]] = {}

    def entry(self, stream: bool) -> Any:
        """The function that writes through the cache or, with `stream`, past it."""
        if stream not in self._made:  # of two threads that compile it at once one is kept
            self._made.setdefault(stream, self._compile(stream))
        return self._made[stream][1]

    def _compile(self, stream: bool) -> tuple[Any, Any]:
        llvm = _binding()
        machine = llvm.Target.from_default_triple().create_target_machine(
            cpu=llvm.get_host_cpu_name(),
            features=llvm.get_host_cpu_features().flatten(),
            opt=2,
        )
        module = llvm.parse_assembly(vector_code(self.program, self.block, stream, self._longest))
        module.triple = llvm.get_process_triple()
        engine = llvm.create_mcjit_compiler(module, machine)
        engine.finalize_object()
        return engine, _SIGNATURE(engine.get_function_address("kernel"))

    def workspace(self, length: int, threads: int = 1) -> Buffers:  # noqa: ARG002
        """Scratch memory for some threads."""
        return Buffers(self, threads)


@lru_cache(maxsize=4)
def _pool(threads: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(threads, thread_name_prefix="cartstiff-many")


if hasattr(os, "register_at_fork"):
    # A forked process has none of its parent's threads.
    os.register_at_fork(after_in_child=_pool.cache_clear)


class Buffers:
    """A kernel with scratch memory for each thread."""

    def __init__(self, kernel: CompiledKernel, threads: int) -> None:
        self._kernel = kernel
        self._scratch = [aligned_empty(kernel.scratch) for _ in range(threads)]
        for scratch in self._scratch:
            # The first round works on what is here: no surprises for the processor.
            scratch[:] = 0.0

    def run(
        self,
        inputs: Mapping[str, Array],
        outputs: Mapping[str, Array],
        count: int,
        stream: bool = False,
    ) -> None:
        """Compute `count` rows: rows of inputs to rows of outputs, all of them contiguous."""
        block, program = self._kernel.block, self._kernel.program
        whole = count - count % block
        if whole:
            self._run(inputs, outputs, whole // block, stream)
        if whole < count:
            # The last rows, in buffers of a whole block.
            padded = {}
            for name in self._kernel.arrays:
                rows = inputs[name]
                if name not in program.shared:
                    rows = rows[whole:count]
                    rows = np.concatenate([rows, np.repeat(rows[-1:], block - len(rows), axis=0)])
                padded[name] = np.ascontiguousarray(rows)
            arrays = {name: aligned_empty(block, len(s)) for name, s in program.outputs.items()}
            self._run(padded, arrays, 1, stream)
            for name, rows in arrays.items():
                outputs[name][whole:count] = rows[: count - whole]

    def _run(
        self, inputs: Mapping[str, Array], outputs: Mapping[str, Array], blocks: int, stream: bool
    ) -> None:
        read = [address_of(inputs[name]) for name in self._kernel.arrays]
        written = [address_of(outputs[name]) for name in self._kernel.program.outputs]
        entry = self._kernel.entry(stream and not any(address % 64 for address in written))
        pointers = (ctypes.c_void_p * len(read))(*read), (ctypes.c_void_p * len(written))(*written)
        progress = (ctypes.c_int64 * 2)()

        def share(scratch: Array, held: object = (inputs, outputs)) -> None:  # noqa: ARG001
            # An interrupt may end this thread's call: what the others write to is held until then.
            entry(blocks, *pointers, address_of(scratch), progress)

        own, *others = self._scratch[:blocks]
        shares = [_pool(len(others)).submit(share, scratch) for scratch in others]
        share(own)
        for other in shares:
            if progress[1] < blocks:
                other.result()
            other.cancel()  # one that has not begun would find nothing left


#: Least rows that buffers of NumPy's calls are made for.
_LEAST = 64


_ROWS, _COLUMNS = np.tril_indices(6)


def lower_triangle(matrix: Array) -> Array:
    """Of a symmetric matrix (6, 6), row by row."""
    return np.asarray(matrix[_ROWS, _COLUMNS])


def from_triangles(rows: Array) -> Array:
    """Symmetric matrices (N, 6, 6) from rows that begin with `lower_triangle`."""
    matrices = np.empty((len(rows), 6, 6))
    matrices[:, _ROWS, _COLUMNS] = matrices[:, _COLUMNS, _ROWS] = rows[:, : len(_ROWS)]
    return matrices


class StackedProgram:
    """A program as machine code, or over NumPy's arrays, with the memory that it works in.

    Memory is taken and given back, so that threads do not share any while they work.
    """

    def __init__(self, program: Program, compiled: bool) -> None:
        self._compiled = compiled
        self._widths = {name: len(own) for name, own in program.outputs.items()}
        self._free: dict[int, list[Any]] = defaultdict(list)
        if compiled:
            self._kernel: Any = CompiledKernel(program)
        else:
            self._kernel = PortableKernel(program)

    def __call__(self, inputs: Mapping[str, Array]) -> dict[str, Array]:
        """Outputs (N, ...) of rows of inputs (N, ...)."""
        count = len(next(iter(inputs.values())))
        outputs = {name: aligned_empty(count, width) for name, width in self._widths.items()}
        size = count
        if not self._compiled:  # buffers are made in few sizes: that takes longer than one run
            size = min(CHUNK, max(_LEAST, 1 << (count - 1).bit_length()))
        kept = self._free[0 if self._compiled else size]
        try:
            workspace = kept.pop()
        except IndexError:
            workspace = self._kernel.workspace(size)
        for start in range(0, count, max(size, 1)):
            part = slice(start, min(start + size, count))
            workspace.run(
                {name: np.ascontiguousarray(array[part]) for name, array in inputs.items()},
                {name: array[part] for name, array in outputs.items()},
                part.stop - start,
            )
        kept.append(workspace)
        return outputs


class OnePosture:
    """All outputs of a program, one after the other.

    Attributes
    ----------
    at : dict of str to slice
        Where in a record each output stands.
    """

    at: dict[str, slice]

    def record(self, **given: Array) -> Array:
        """What the program finds from inputs (n,), or (1, n), by name; those it does not read."""
        raise NotImplementedError

    def run(self, inputs: Mapping[str, Array], outputs: Mapping[str, Array], count: int) -> None:
        """`record` as rows (1, ...) of outputs, as what computes many postures gives them."""
        if count != 1:
            raise ValueError("one posture at a time")
        record = self.record(**inputs)
        for name, row in outputs.items():
            row[0, : self.at[name].stop - self.at[name].start] = record[self.at[name]]


class PrintedPosture(OnePosture):
    """One posture by straight-line Python, where no machine code can be made."""

    def __init__(self, program: Program, shared: Mapping[str, Array]) -> None:
        self._function, self._names, self.at = _python(program)
        self._shared = {name: rows.ravel().tolist() for name, rows in shared.items()}
        self._nothing = np.full(max(place.stop for place in self.at.values()), np.nan)

    def record(self, **given: Array) -> Array:
        """As `OnePosture.record`; all NaN where a number is not finite, or has no root."""
        known = self._shared
        lists = [known[n] if n in known else given[n].ravel().tolist() for n in self._names]
        try:
            record = np.array(self._function(*lists))
        except (ZeroDivisionError, ValueError, OverflowError):
            return self._nothing.copy()
        # Python's `max` does not hand on a NaN.
        return record if math.isfinite(record.sum()) else self._nothing.copy()


class CompiledPosture(OnePosture):
    """One posture by machine code."""

    def __init__(self, program: Program, shared: Mapping[str, Array]) -> None:
        steps, self.at = list[int](), dict[str, slice]()
        for name, own in program.outputs.items():
            self.at[name] = slice(len(steps), len(steps) + len(own))
            steps += own
        steps += steps[-1:] * (len(steps) % 2)  # records are written by pairs
        self._kernel = CompiledKernel(replace(program, outputs={"record": tuple(steps)}), width=2)
        self._entry, self._shared = self._kernel.entry(False), shared
        self._free: list[_Memory] = []

    def record(self, **given: Array) -> Array:
        """As `OnePosture.record`."""
        try:
            memory = self._free.pop()
        except IndexError:
            memory = _Memory(self._kernel, self._shared)
        for name, place in memory.inputs.items():
            place[:] = given[name]
        memory.progress[:] = [0, 0]
        self._entry(*memory.arguments)
        record = memory.record.copy()
        self._free.append(memory)
        return record


class _Memory:
    """What one call reads and writes; as many are made as are used at the same time."""

    def __init__(self, kernel: Any, shared: Mapping[str, Array]) -> None:
        program = kernel.program
        widths = dict.fromkeys(kernel.arrays, 0)
        for array, component in program.inputs:
            widths[array] = max(widths.get(array, 0), component + 1)
        self.inputs = {
            name: np.empty((1 if name in program.shared else kernel.block, widths[name]))
            for name in kernel.arrays
            if name not in shared
        }
        written = aligned_empty(kernel.block, len(program.outputs["record"]))
        scratch = aligned_empty(kernel.scratch)
        scratch[:] = 0.0
        self.record = written[0]
        self.progress = (ctypes.c_int64 * 2)()
        inputs = {**shared, **self.inputs}
        read = [address_of(inputs[name]) for name in kernel.arrays]
        self.arguments = (
            1,
            (ctypes.c_void_p * len(read))(*read),
            (ctypes.c_void_p * 1)(address_of(written)),
            address_of(scratch),
            self.progress,
        )
        self._held = inputs, written, scratch
