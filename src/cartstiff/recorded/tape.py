r"""Recorded arithmetic: numbers that record operations on them,
and the resulting program.

A formula evaluated on `Number` instead of floats records a list of operations on scalars.
Constants are folded, equal operations are shared, and `Tape.program` keeps what the
outputs depend on. The same program runs over NumPy arrays, as vector code, as Python and
as JavaScript (`cartstiff.recorded.execution`).

Folding assumes finite numbers: 0 x is 0. Where x is not finite, the verdict on the
posture, which is computed from the same numbers, rejects the posture.
"""

from __future__ import annotations

import gc
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import chain
from typing import Any, NamedTuple, final

import numpy as np

from cartstiff.core.arrays import Array
from cartstiff.core.lazily import cached_property

#: Arrays by name: inputs of a program, or its outputs.
Arrays = Mapping[str, Array]


@contextmanager
def uncollected() -> Iterator[None]:
    """Switch Python's garbage collector off: it would take half of the time of
    a recording.

    A recording makes many small objects and frees none of them.
    """
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_enabled:
            gc.enable()


class Operation(NamedTuple):
    """An operation and the steps that it reads; `value` is that of a "constant"."""

    name: str
    arguments: tuple[int, ...]
    value: float = 0.0


class Input(NamedTuple):
    """A component of a named input array.

    A *shared* array has one row for all postures, any other array one row per posture.
    """

    array: str
    component: int


#: Operations on plain numbers beside + - * /.
FOLDED: dict[str, Callable[..., Any]] = {
    "sqrt": math.sqrt,
    "abs": abs,
    "copysign": math.copysign,
    "max": max,
    "sin": math.sin,
    "cos": math.cos,
    "pick": lambda x, y, a, b: a if x < y else b,
}
_OVER_ARRAYS: dict[str, Callable[..., Any]] = {
    "sqrt": np.sqrt,
    "abs": np.abs,
    "copysign": np.copysign,
    "max": np.maximum,
    "pick": lambda x, y, a, b: np.where(np.less(x, y), a, b),
}


_COMMUTATIVE = {"add", "mul", "max"}
_LEAVES = {"input", "constant"}


class Tape:
    """Operations in the order in which they were recorded."""

    def __init__(self) -> None:
        # Plain tuples while recording, which takes two thirds of the time with names.
        self.operations: list[tuple[str, tuple[int, ...], float]] = []
        self.inputs: list[Input] = []
        self._known: dict[tuple[object, ...], Number] = {}

    @classmethod
    def of(cls, program: Program) -> Tape:
        """The operations of a program again, with the same steps, for more of them."""
        tape = cls()
        tape.inputs = [*program.inputs]
        for step, operation in enumerate(program.operations):
            name, arguments, value = operation
            number = tape._known[name, arguments, value] = Number(tape, step)
            tape.operations.append((name, arguments, value))
            if name == "input":
                tape._known[tape.inputs[arguments[0]]] = number
        return tape

    def input(self, array: str, index: int) -> Number:
        """Return component `index` of an input array."""
        key = Input(array, index)
        if key not in self._known:
            self.inputs.append(key)
            self._known[key] = self._step("input", (len(self.inputs) - 1,))
        return self._known[key]

    def vector(self, array: str, size: int) -> Array:
        """Return all `size` components of an input array."""
        numbers = np.empty(size, object)
        numbers[:] = [self.input(array, i) for i in range(size)]
        return numbers

    def record(self, name: str, *arguments: Number | float) -> Number:
        """Record an operation on numbers, at least one of which is recorded."""
        steps = tuple(
            [a.step if type(a) is Number else self._constant(a) for a in arguments]
        )
        if name in _COMMUTATIVE and steps[0] > steps[1]:
            steps = steps[::-1]
        return self._step(name, steps)

    def combine(self, name: str, left: Number | float, right: Number | float) -> Number:
        """Record + - * or /, which are most operations of a tape:
        faster than `record`.
        """
        a = left.step if type(left) is Number else self._constant(left)
        b = right.step if type(right) is Number else self._constant(right)
        return self._step(name, (b, a) if a > b and name in _COMMUTATIVE else (a, b))

    def _constant(self, value: float) -> int:
        return self._step("constant", (), float(value)).step

    def _step(self, name: str, arguments: tuple[int, ...], value: float = 0.0) -> Number:
        key = name, arguments, value
        known = self._known.get(key)
        if known is None:
            known = self._known[key] = Number(self, len(self.operations))
            self.operations.append(key)
        return known

    def needed(self, wanted: Iterable[int]) -> set[int]:
        """Steps that some depend on, and these."""
        found, waiting = set[int](), [*wanted]
        while waiting:
            step = waiting.pop()
            if step not in found:
                found.add(step)
                name, arguments, _ = self.operations[step]
                waiting += () if name == "input" else arguments
        return found

    def program(self, outputs: Mapping[str, Any], shared: Sequence[str] = ()) -> Program:
        """Program of the operations that the outputs depend on, renumbered.

        Inputs in `shared` have one row for all postures.
        """
        wanted = {
            name: [
                x.step if isinstance(x, Number) else self._constant(x)
                for x in np.ravel(values)
            ]
            for name, values in outputs.items()
        }
        operations = self.operations
        needed = self.needed(step for steps in wanted.values() for step in steps)
        own = (operations[step] for step in needed)
        read = set(chain.from_iterable(a for name, a, _ in own if name != "input"))

        # In the order of recording, but a step that only completes an output directly
        # follows the last step that it reads.
        def after(step: int) -> tuple[int, int]:
            name, arguments, _ = operations[step]
            stays = step in read or name in _LEAVES
            return step if stays else max(arguments), step

        order = sorted(map(after, needed))
        place: dict[int, int] = {}
        kept: list[Operation] = []
        for _, step in order:
            name, arguments, value = operations[step]
            if name != "input":
                arguments = tuple([place[a] for a in arguments])
            place[step] = len(kept)
            kept.append(Operation(name, arguments, value))
        return Program(
            tuple(kept),
            tuple(self.inputs),
            {name: tuple(place[s] for s in steps) for name, steps in wanted.items()},
            frozenset(shared),
        )


@dataclass(frozen=True, eq=False)
class Program:
    """Operations without branches, with named outputs.

    Attributes
    ----------
    operations : tuple of Operation
        Each reads only earlier ones.
    inputs : tuple of Input
        Components that "input" operations read, by index.
    outputs : dict of str to tuple of int
        Steps of each output, in C order of its array.
    shared : frozenset of str
        Input arrays with one row for all postures.
    """

    operations: tuple[Operation, ...]
    inputs: tuple[Input, ...]
    outputs: dict[str, tuple[int, ...]]
    shared: frozenset[str]

    def with_outputs(self, outputs: dict[str, tuple[int, ...]]) -> Program:
        """The same operations with other outputs."""
        return replace(self, outputs=outputs)

    @cached_property
    def widths(self) -> dict[str, int]:
        """Number of components of each input array."""
        ends = dict[str, int]()
        for array, component in self.inputs:
            ends[array] = max(ends.get(array, 0), component + 1)
        return ends

    @property
    def size(self) -> int:
        """Number of arithmetic operations."""
        return sum(o.name not in ("input", "constant") for o in self.operations)


@final
class Number:
    """A recorded scalar; acts like a float under + - * / and the functions of
    this module.
    """

    __slots__ = ("negated", "step", "tape")

    def __init__(self, tape: Tape, step: int) -> None:
        self.tape = tape
        self.step = step
        #: The number whose negative this one is.
        self.negated: Number | None = None

    def __neg__(self) -> Number:
        if self.negated is not None:
            return self.negated
        negative = self.tape.record("neg", self)
        negative.negated = self
        return negative

    def __add__(self, other: Number | float) -> Number | float:
        if isinstance(other, Number):
            if other.negated is not None:
                return self - other.negated
            if self.negated is not None:
                return other - self.negated
        elif other == 0:
            return self
        return self.tape.combine("add", self, other)

    __radd__ = __add__

    def __sub__(self, other: Number | float) -> Number | float:
        if isinstance(other, Number):
            if other.step == self.step:
                return 0.0
            if other.negated is not None:
                return self + other.negated
        elif other == 0:
            return self
        return self.tape.combine("sub", self, other)

    def __rsub__(self, other: float) -> Number | float:
        return -self if other == 0 else self.tape.combine("sub", other, self)

    def __mul__(self, other: Number | float) -> Number | float:
        if isinstance(other, Number):
            if self.negated is not None:
                return -(self.negated * other)
            if other.negated is not None:
                return -(self * other.negated)
        elif other == 0:
            return 0.0
        elif other == 1:
            return self
        elif other == -1:
            return -self
        elif other < 0:
            return -(self * -other)
        return self.tape.combine("mul", self, other)

    __rmul__ = __mul__

    def __truediv__(self, other: Number | float) -> Number | float:
        if not isinstance(other, Number):
            return self * (1.0 / other)
        return self.tape.combine("div", self, other)

    def sin(self) -> Number | float:
        """Sine; NumPy calls this method for arrays of objects."""
        return self.tape.record("sin", self)

    def cos(self) -> Number | float:
        """Cosine, likewise."""
        return self.tape.record("cos", self)

    def sqrt(self) -> Number | float:
        """Square root, likewise."""
        return self.tape.record("sqrt", self)

    def __rtruediv__(self, other: float) -> Number | float:
        return 0.0 if other == 0 else self.tape.combine("div", other, self)


Scalar = Number | float


def _record(name: str, *arguments: Scalar) -> Scalar:
    for argument in arguments:
        if isinstance(argument, Number):
            return argument.tape.record(name, *arguments)
    is_stack = any(isinstance(argument, np.ndarray) for argument in arguments)
    return (_OVER_ARRAYS if is_stack else FOLDED)[name](*arguments)


def square_root(x: Scalar) -> Scalar:
    """Square root."""
    return _record("sqrt", x)


def absolute(x: Scalar) -> Scalar:
    """Absolute value."""
    return _record("abs", x)


def copysign(x: Scalar, sign: Scalar) -> Scalar:
    """``|x|`` with the sign of the second."""
    return _record("copysign", x, sign)


def larger(x: Scalar, y: Scalar) -> Scalar:
    """Maximum of two numbers."""
    return _record("max", x, y)


def sine(x: Scalar) -> Scalar:
    """Sine."""
    return _record("sin", x)


def cosine(x: Scalar) -> Scalar:
    """Cosine."""
    return _record("cos", x)


def pick(x: Scalar, y: Scalar, yes: Scalar, no: Scalar) -> Scalar:
    """`yes` where x < y, else `no`; `no` where either is not a number."""
    return _record("pick", x, y, yes, no)
