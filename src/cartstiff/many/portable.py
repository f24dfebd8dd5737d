"""Running a program without machine code: over NumPy arrays, and in a browser.

Over arrays there is one call per operation on a chunk that stays in cache. As JavaScript it is one
straight-line function: values that are read once stand where they are read, the order of every
operation is kept, so that sums, products, quotients and roots are the same to the last bit. Sines
and cosines are those of the browser.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from cartstiff.geometry.se3 import Array
from cartstiff.many.tape import Program

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

    def workspace(self, length: int, threads: int = 1) -> Buffers:  # noqa: ARG002
        """Buffers and calls for chunks of `length` postures; threads would wait for Python."""
        return Buffers(self.program, self._slots, self._count, length)


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


class Buffers:
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


# -- as JavaScript -----------------------------------------------------------------------------

#: What the functions need beside `Math`: the size of the first with the sign of the second.
HELPERS = "const withSign=(x,y)=>y<0||Object.is(y,-0)?-Math.abs(x):Math.abs(x);"

_WORDS = {
    "add": "({}+{})",
    "sub": "({}-{})",
    "mul": "{}*{}",
    "div": "{}/{}",
    "neg": "(-{})",
    "sqrt": "Math.sqrt({})",
    "abs": "Math.abs({})",
    "max": "Math.max({},{})",
    "copysign": "withSign({},{})",
    "sin": "Math.sin({})",
    "cos": "Math.cos({})",
    "pick": "({}<{}?{}:{})",
}
# Characters of an expression from which on it gets a name, so that none is nested too deeply.
_LONGEST = 160


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
    reads = [0] * len(program.operations)
    for operation in program.operations:
        if operation.name != "input":
            for argument in operation.arguments:
                reads[argument] += 1
    places: dict[str, tuple[int, int]] = {}
    written: dict[int, list[int]] = {}
    end = 0
    for name, steps in program.outputs.items():
        places[name] = end, end + len(steps)
        for step in steps:
            written.setdefault(step, []).append(end)
            reads[step] += 1
            end += 1
    lines: list[str] = []
    texts: list[str] = []
    arrays: dict[str, str] = {}
    for step, (kind, arguments, value) in enumerate(program.operations):
        if kind == "constant":
            text = _number(value)
        elif kind == "input":
            array, index = program.inputs[arguments[0]]
            text = f"{arrays.setdefault(array, f'a{len(arrays)}')}[{index}]"
        else:
            text = _WORDS[kind].format(*(texts[a] for a in arguments))
            if kind in ("mul", "div"):
                text = f"({text})"
        if kind not in ("constant", "input") or len(text) > 6:
            # A constant has no place of its own unless it is long and read often.
            named = reads[step] > 1 if kind != "input" else reads[step] > 2
            if named or len(text) > _LONGEST:
                lines.append(f"const v{step}={text};")
                text = f"v{step}"
        texts.append(text)
        lines += [f"o[{place}]={text};" for place in written.get(step, ())]
    head = "".join(f"const {short}=i[{json.dumps(name)}];" for name, short in arrays.items())
    return f"(i,o)=>{{{head}{''.join(lines)}}}", places


def _number(value: float) -> str:
    if math.isnan(value):
        return "NaN"
    if math.isinf(value):
        return "Infinity" if value > 0 else "(-Infinity)"
    text = repr(value).removesuffix(".0")
    return f"({text})" if text.startswith("-") else text
