r"""Exact derivatives of recorded numbers: reverse mode on the tape.

With w_i = dy/dx_i for the number x_i of each step, from the output y backwards,

    w_j = sum of w_i dx_i/dx_j over the steps i that read j,

which takes two to three times the operations of y for all inputs together (Griewank and
Walther, Evaluating Derivatives, SIAM 2008, section 3.2 and eq. 4.21). The sums are
recorded on the same tape, so that a gradient runs wherever a program runs, and may be
differentiated again.

A `pick` and a `larger` are differentiated on the side that is taken; the other side
counts zero.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cartstiff.core import numerics
from cartstiff.core.arrays import Array
from cartstiff.core.geometry.se3 import skew_of
from cartstiff.recorded.algebra import PLAIN, given_wrench, zeros
from cartstiff.recorded.chains import ChainCase
from cartstiff.recorded.plans import Case, recorded_arrays
from cartstiff.recorded.tape import (
    FOLDED,
    Arrays,
    Number,
    Program,
    Scalar,
    Tape,
    copysign,
    cosine,
    larger,
    pick,
    sine,
    uncollected,
)


def _parts(name: str, x: Sequence[Any], y: Any, w: Any) -> tuple[Any, ...]:
    """Adjoints of the arguments x of an operation with result y and adjoint w,
    on recorded numbers or on floats with a row of adjoints.
    """
    match name:
        case "add":
            return w, w
        case "sub":
            return w, -w
        case "mul":
            return w * x[1], w * x[0]
        case "div":
            return w / x[1], -(w * y / x[1])
        case "neg":
            return (-w,)
        case "sqrt":
            return (w * 0.5 / y,)
        case "sin":
            return (w * cosine(x[0]),)
        case "cos":
            return (-(w * sine(x[0])),)
        case "abs":
            return (w * copysign(1.0, x[0]),)
        case "copysign":  # the second number does not move the result
            return w * copysign(1.0, x[0]) * copysign(1.0, x[1]), 0.0
        case "max":
            return pick(x[0], x[1], 0.0, w), pick(x[0], x[1], w, 0.0)
        case "pick":
            return 0.0, 0.0, pick(x[0], x[1], w, 0.0), pick(x[0], x[1], 0.0, w)
    raise ValueError(name)


#: First argument of an operation whose value passes on; those before it only choose.
_FIRST_VALUE = {"pick": 2}


def active(tape: Tape, inputs: Iterable[Number], last: int) -> set[int]:
    """Steps up to `last` that move with one of the inputs."""
    found = {x.step for x in inputs}
    for step, (name, arguments, _) in enumerate(tape.operations[: last + 1]):
        moving = arguments[_FIRST_VALUE.get(name, 0) :]
        if name != "input" and not found.isdisjoint(moving):
            found.add(step)
    return found


#: Operations that are not differentiable where their first two arguments are equal.
_CHOICES = ("max", "pick")


def pullback(
    outputs: Sequence[tuple[Scalar, Scalar]],
    inputs: Sequence[Number],
) -> list[Scalar]:
    r"""Derivatives of ``sum of weight * output`` by each input,
    recorded on the outputs' tape.

    Parameters
    ----------
    outputs : sequence of (output, weight)
        Recorded numbers of one tape, and the derivative of the objective by each; plain
        numbers among the outputs do not depend on anything.
    inputs : sequence of Number
        Inputs of that tape.

    Returns
    -------
    list of Number or float
        One for each input, 0.0 where nothing depends on it. The unit is that of the
        objective per unit of the input.
    """
    recorded = [(y, w) for y, w in outputs if isinstance(y, Number)]
    if not recorded:
        return [0.0] * len(inputs)
    tape, last = recorded[0][0].tape, max(y.step for y, _ in recorded)
    reached = active(tape, inputs, last)
    adjoint: dict[int, Scalar] = {}
    for y, weight in recorded:
        adjoint[y.step] = adjoint.get(y.step, 0.0) + weight
    for step in sorted(reached, reverse=True):
        name, arguments, _ = tape.operations[step]
        w = adjoint.get(step, 0.0)
        if name == "input" or (not isinstance(w, Number) and w == 0.0):
            continue
        # The sums use up the adjoint of a step; those of the inputs stay for the answer.
        del adjoint[step]
        values = [_value(tape, argument) for argument in arguments]
        parts = _parts(name, values, Number(tape, step), w)
        for argument, part in zip(arguments, parts, strict=True):
            if argument in reached:
                adjoint[argument] = adjoint.get(argument, 0.0) + part
    return [adjoint.get(x.step, 0.0) for x in inputs]


def _value(tape: Tape, step: int) -> Scalar:
    """A step as a number; constants as floats, so that the arithmetic folds them."""
    name, _, value = tape.operations[step]
    return value if name == "constant" else Number(tape, step)


def gradient_program(program: Program, output: str) -> Program:
    """Program of one output, of its derivatives by all inputs, "by_ARRAY", and of the
    verdict.
    """
    with uncollected():
        tape = Tape.of(program)
        (step,), (verdict,) = program.outputs[output], program.outputs["verdict"]
        value = Number(tape, step)
        numbers = [tape.input(*each) for each in program.inputs]
        known = {output: np.array([value]), "verdict": np.array([Number(tape, verdict)])}
        by = {name: zeros(width) for name, width in program.widths.items()}
        slopes = pullback([(value, 1.0)], numbers)
        for (name, component), slope in zip(program.inputs, slopes, strict=True):
            by[name][component] = slope
        known |= {f"by_{name}": row for name, row in by.items()}
        return tape.program(known, [*program.shared])


#: Operations on floats: with a larger of two that is not a number where one is not.
_ON_FLOATS: dict[str, Callable[..., float]] = {
    **FOLDED,
    "add": operator.add,
    "sub": operator.sub,
    "mul": operator.mul,
    "div": operator.truediv,
    "neg": operator.neg,
    "max": lambda x, y: x if x > y or x != x else y,
}


def _at(at: Mapping[int, float], x: Scalar) -> float:
    return at[x.step] if isinstance(x, Number) else x


#: Two numbers that differ by a smaller share are equal.
_TIE = numerics.NEGLIGIBLE_DIFFERENCE
#: Objectives on recorded numbers: from the arrays of `analyse_many` to a number, or
#: numbers (m,), and a verdict.
Objective = Callable[[Arrays], tuple[Scalar | Sequence[Scalar], Scalar]]


class Swept(NamedTuple):
    """Numbers at one posture and their derivatives by every input.

    Attributes
    ----------
    values : ndarray (m,)
    by : dict of str to ndarray
        Derivatives (m, ...) by the components of each input array.
    kinks : ndarray (m,) of int
        Number of choices that depend on equal numbers: principal values that coincide,
        lines that are about to go slack.
    verdict : float
    """

    values: Array
    by: dict[str, Array]
    kinks: NDArray[np.intp]
    verdict: float


class Sweep:
    """Recorded numbers with their derivatives at one posture, without a program.

    The operations are walked through once forwards, for the values of all steps, and once
    backwards, with a row of adjoints (m,) for all numbers together. That takes less time
    than to write and to compile a program for the few postures of one question.

    Parameters
    ----------
    numbers : sequence of Number or float
        The numbers (m,) that are differentiated.
    verdict : Number or float
        A number that is only computed.
    """

    def __init__(self, numbers: Sequence[Scalar], verdict: Scalar = PLAIN) -> None:
        self._numbers, self._verdict = [*numbers], verdict
        recorded = [x for x in (*numbers, verdict) if isinstance(x, Number)]
        self._tape = recorded[0].tape if recorded else Tape()
        needed = self._tape.needed(x.step for x in recorded)
        self._steps = sorted(needed)

    @cached_property
    def _active(self) -> set[int]:
        inputs = [self._tape.input(*each) for each in self._tape.inputs]
        return active(self._tape, inputs, self._steps[-1])

    def __len__(self) -> int:
        return len(self._numbers)

    def values(self, given: Arrays) -> Array:
        """The numbers, from input arrays (1, ...) by name."""
        at = self._forwards(given)
        return np.array([_at(at, x) for x in self._numbers], float)

    @np.errstate(all="ignore")
    def at(self, given: Arrays) -> Swept:
        """The numbers and their derivatives, from input arrays (1, ...) by name."""
        at, operations = self._forwards(given), self._tape.operations
        # Each number that differs has the weight one in its own row; constants share the
        # last row, which stays zero.
        steps = [x.step if isinstance(x, Number) else -1 for x in self._numbers]
        distinct = dict.fromkeys(step for step in steps if step >= 0)
        places = {step: i for i, step in enumerate(distinct)}
        m = len(places)
        by = {name: np.zeros((m + 1, row.shape[1])) for name, row in given.items()}
        kinks, rows = np.zeros(m + 1, np.intp), np.eye(m) if m > 1 else np.ones(m)
        adjoint: dict[int, Any] = dict(zip(places, rows, strict=True))
        # Backwards: a step hands its weight on to its arguments, by its derivatives.
        for step in reversed(self._steps):
            if (w := adjoint.pop(step, None)) is None:
                continue
            name, arguments, _ = operations[step]
            if name == "constant":
                continue
            if name == "input":
                array, component = self._tape.inputs[arguments[0]]
                by[array][:m, component] = w
                continue
            x = [at[argument] for argument in arguments]
            # A choice hands it to what was taken; where both are equal there is a kink.
            if name in _CHOICES:
                is_tie = abs(x[0] - x[1]) <= _TIE * max(abs(x[0]), abs(x[1]))
                if is_tie and not self._active.isdisjoint(arguments[:2]):
                    kinks[:m] += np.not_equal(w, 0.0)
                is_less = x[0] < x[1]
                arguments = (arguments[3 - is_less if name == "pick" else is_less],)
                parts: tuple[Any, ...] = (w,)
            else:
                parts = _parts(name, x, at[step], w)
            for argument, part in zip(arguments, parts, strict=True):
                own = adjoint.get(argument)
                adjoint[argument] = part if own is None else own + part
        values = np.array([_at(at, x) for x in self._numbers], float)
        index = [places.get(step, m) for step in steps]
        by = {name: rows[index] for name, rows in by.items()}
        return Swept(values, by, kinks[index], _at(at, self._verdict))

    def _forwards(self, given: Arrays) -> dict[int, float]:
        """Value of each step; what is not defined is not a number."""
        operations, inputs = self._tape.operations, self._tape.inputs
        at = dict[int, float]()
        rows = {name: row[0].tolist() for name, row in given.items()}
        for step in self._steps:
            name, arguments, value = operations[step]
            if name == "input":
                array, component = inputs[arguments[0]]
                value = rows[array][component]
            elif name != "constant":
                try:
                    value = _ON_FLOATS[name](*[at[argument] for argument in arguments])
                except (ArithmeticError, ValueError):
                    value = np.nan
            at[step] = value
        return at


class Slopes(NamedTuple):
    """Objectives at one posture and their derivatives by every input of the
    recorded arithmetic.

    Attributes
    ----------
    values, by, kinks
        As of `Swept`.
    closing : dict of str to ndarray, optional
        Of a closed chain: derivatives (r, ...) of the closures' residuals by the same
        components.
    forces : dict of str to ndarray, optional
        Of what comes to rest again: derivatives (n, ...) of the generalised forces, those
        of the closures among them, which do not change along their directions.
    """

    values: Array
    by: Arrays
    kinks: NDArray[np.intp]
    closing: Arrays | None
    forces: Arrays | None


class Differentiated:
    """Objectives with their derivatives, recorded once and computed at any posture of a
    case.

    Parameters
    ----------
    case : ChainCase or PlatformCase
        The recorded arithmetic, with the geometry that is varied.
    needed : tuple of str
        Outputs that the objectives read.
    objective : callable
    comes_to_rest : bool
        Whether the forces, on which the motion depends, are differentiated as well.

    Raises
    ------
    KeyError
        If an output does not exist.
    """

    def __init__(
        self,
        case: Case,
        needed: tuple[str, ...],
        objective: Objective,
        comes_to_rest: bool = False,
    ) -> None:
        with uncollected():
            tape = Tape()
            arrays = recorded_arrays(tape, case, (*needed, "gaps"))
            found, verdict = objective(arrays)
            values = np.ravel(np.asarray(found, object))
            closures = arrays.get("gaps", zeros(0))
            self._count, self._is_closed = len(values), bool(len(closures))
            verdict = larger(arrays["verdict"][0], verdict)
            self._numbers = Sweep([*values, *closures], verdict)
            self._forces = Forces(case) if comes_to_rest else None

    def at(self, given: Arrays) -> Slopes | None:
        """Objectives and derivatives from input arrays (1, ...) by name.

        None where the posture is not plainly regular.
        """
        found, m = self._numbers.at(given), self._count
        every = (found.values, *found.by.values())
        is_finite = all(np.isfinite(x).all() for x in every)
        if not is_finite or not m or found.verdict != PLAIN:
            return None
        by = {name: rows[:m] for name, rows in found.by.items()}
        closing = {name: rows[m:] for name, rows in found.by.items()}
        forces = None if self._forces is None else self._forces.at(given, closing)
        closing_if_any = closing if self._is_closed else None
        return Slopes(found.values[:m], by, found.kinks[:m], closing_if_any, forces)


class Forces:
    r"""Derivatives of the generalised forces f of a mechanism by all inputs.

    With the energy Phi, the wrench W of the load on the body and the closures c,

        f = dPhi/dq - J^T W + (dc/dq)^T lam,

    which vanishes at rest. The multipliers lam are those numbers that make it smallest;
    they are not differentiated.
    """

    def __init__(self, case: Case) -> None:
        with uncollected():
            tape = Tape()
            arrays = recorded_arrays(tape, case, ("gaps",))
            T, n, residuals = arrays["pose"], 6, arrays.get("gaps", zeros(0))
            self._moving = list(range(n))
            if isinstance(case, ChainCase):
                n, self._moving = len(case.constants.is_length), case.moving
            multipliers = tape.vector("multipliers", len(residuals))
            terms: list[tuple[Scalar, Scalar]] = [(arrays["energy"][0], 1.0)]
            terms += zip(residuals, multipliers, strict=True)
            W = given_wrench(tape, case, lambda: T)
            if W is not None:
                # W . t = <G, dT> along a twist t of the body.
                G = T[:3, :3] @ np.column_stack([0.5 * skew_of(W[:3]), W[3:]])
                terms += zip(T[:3].ravel(), -G.ravel(), strict=True)
            forces = pullback(terms, list(tape.vector("q", n)))
            self._forces = Sweep(forces)
        self._closed = len(residuals)

    def at(self, given: Arrays, closing: Arrays) -> dict[str, Array]:
        """Derivatives (n, ...) by the components of each input array."""
        given = {**given, "multipliers": np.zeros((1, self._closed))}
        if self._closed:
            C, f = closing["q"][:, self._moving], self._forces.values(given)
            lam = np.linalg.lstsq(C.T, -f[self._moving], rcond=numerics.RANK)[0]
            given["multipliers"] = lam[None]
        return self._forces.at(given).by
