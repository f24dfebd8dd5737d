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

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cartstiff import numerics
from cartstiff.batch.algebra import PLAIN, given_wrench, zeros
from cartstiff.batch.chains import ChainCase, joint_positions, recorded_tree
from cartstiff.batch.closed_chains import gaps
from cartstiff.batch.execution import PortableKernel
from cartstiff.batch.plans import Case, recorded_arrays
from cartstiff.batch.tape import (
    Input,
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
from cartstiff.geometry.se3 import Array, skew_of


def _parts(name: str, x: Sequence[Scalar], y: Number, w: Scalar) -> tuple[Scalar, ...]:
    """Adjoints of the arguments x of an operation with result y and adjoint w."""
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
    choices: list[tuple[Scalar, Scalar, Scalar]] | None = None,
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
    choices : list, optional
        Gets the two numbers that each choice compares, and the adjoint of its result:
        where they are equal and that is not zero, there may be no derivative.

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
        if (
            choices is not None
            and name in _CHOICES
            and not reached.isdisjoint(arguments[:2])
        ):
            choices.append((values[0], values[1], w))
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
        ends = dict[str, int]()
        for name, component in program.inputs:
            ends[name] = max(ends.get(name, 0), component + 1)
        by = {name: zeros(end) for name, end in ends.items()}
        slopes = pullback([(value, 1.0)], numbers)
        for (name, component), slope in zip(program.inputs, slopes, strict=True):
            by[name][component] = slope
        known |= {f"by_{name}": row for name, row in by.items()}
        return tape.program(known, [*program.shared])


@dataclass(frozen=True, eq=False)
class Slopes:
    """Objectives at one posture and their derivatives by every input of the
    recorded arithmetic.

    Attributes
    ----------
    values : ndarray (m,)
        The objectives.
    by : dict of str to ndarray
        Derivatives (m, ...) by the components of each input array.
    closing : dict of str to ndarray, optional
        Of a closed chain: derivatives (r, ...) of the closures' residuals by the same
        components.
    forces : dict of str to ndarray, optional
        Of what comes to rest again: derivatives (n, ...) of the generalised forces, those
        of the closures among them, which do not change along their directions.
    kinks : ndarray (m,) of int
        Number of choices that depend on equal numbers: principal values that coincide,
        lines that are about to go slack.
    """

    values: Array
    by: Mapping[str, Array]
    closing: Mapping[str, Array] | None
    forces: Mapping[str, Array] | None
    kinks: NDArray[np.intp]


#: Two numbers that differ by a smaller share are equal.
_TIE = numerics.NEGLIGIBLE_DIFFERENCE
#: Objectives on recorded numbers: from the arrays of `analyse_many` to numbers (m,) and a
#: verdict.
Objective = Callable[[Mapping[str, Array]], tuple[Sequence[Scalar], Scalar]]


class Differentiated:
    """Objectives with their derivatives, recorded once and run at any posture of a case.

    Each objective takes a row: its weight is 1 there, and the others' are 0.

    Parameters
    ----------
    case : ChainCase or PlatformCase
        The recorded arithmetic, with the geometry that is varied.
    needed : tuple of str
        Outputs that the objectives read.
    objective : callable
    comes_to_rest : bool
        Whether the forces, on which the motion depends, are differentiated as well.

    Attributes
    ----------
    size, whole : int
        Number of operations of the objectives, and with all derivatives.

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
            arrays = recorded_arrays(tape, case, needed)
            values, verdict = objective(arrays)
            known = {"values": np.array([*values], object)}
            known["verdict"] = np.array([larger(arrays["verdict"][0], verdict)], object)
            self.inputs, self.count = tuple(tape.inputs), len(known["values"])
            self.size = tape.program(known, []).size
            weights: Sequence[Scalar] = [1.0]
            if self.count != 1:
                weights = list(tape.vector("weights", self.count))
            choices = list[tuple[Scalar, Scalar, Scalar]]()
            numbers = [tape.input(*each) for each in self.inputs]
            parts = pullback(list(zip(values, weights, strict=True)), numbers, choices)
            known["slopes"] = np.array(parts, object)
            known["choices"] = np.array(choices, object).reshape(-1)
            program = tape.program(known, [])
        self.whole = program.size
        self._kernel = PortableKernel(program)
        is_closed = isinstance(case, ChainCase) and case.is_closed
        self._closing = _Closing(case) if is_closed else None
        self.forces = Forces(case) if comes_to_rest else None

    def at(self, given: Mapping[str, Array]) -> Slopes | None:
        """Objectives and derivatives from input arrays (1, ...) by name.

        None where the posture is not plainly regular.
        """
        rows = {name: np.tile(row, (self.count, 1)) for name, row in given.items()}
        found = self._kernel({**rows, "weights": np.eye(self.count)})
        if not self.count or found["verdict"][0, 0] != PLAIN:
            return None
        values, slopes = found["values"][0], found["slopes"]
        if not (np.isfinite(values).all() and np.isfinite(slopes).all()):
            return None
        x, y, adjoint = np.moveaxis(found["choices"].reshape(self.count, -1, 3), 2, 0)
        is_kink = np.abs(x - y) <= _TIE * np.maximum(np.abs(x), np.abs(y))
        kinks = (is_kink & (adjoint != 0.0)).sum(axis=1)
        closing = None if self._closing is None else self._closing.at(given)
        forces = None if self.forces is None else self.forces.at(given, closing)
        by = _by_array(self.inputs, slopes, given)
        return Slopes(values, by, closing, forces, kinks)


class _Closing:
    """Derivatives of the residuals of a closed chain's closures by all inputs."""

    def __init__(self, case: Case) -> None:
        if not isinstance(case, ChainCase):
            raise TypeError(case)
        with uncollected():
            tape = Tape()
            _, _, position = joint_positions(tape, case.constants)
            residuals = gaps(recorded_tree(tape, case, position))
            self.inputs, self.count = tuple(tape.inputs), len(residuals)
            weights = tape.vector("weights", self.count)
            numbers = [tape.input(*each) for each in self.inputs]
            parts = pullback(list(zip(residuals, weights, strict=True)), numbers)
            program = tape.program({"slopes": np.array(parts, object)}, [])
        self._kernel = PortableKernel(program)

    def at(self, given: Mapping[str, Array]) -> dict[str, Array]:
        """Derivatives (r, ...) by the components of each input array."""
        rows = {name: np.tile(row, (self.count, 1)) for name, row in given.items()}
        slopes = self._kernel({**rows, "weights": np.eye(self.count)})["slopes"]
        return _by_array(self.inputs, slopes, given)


class Forces:
    r"""Derivatives of the generalised forces f of a mechanism by all inputs.

    With the energy Phi, the wrench W of the load on the body and the closures c,

        f = dPhi/dq - J^T W + (dc/dq)^T lam,

    which vanishes at rest. The multipliers lam are those numbers that make it smallest;
    they are not differentiated.

    Attributes
    ----------
    size : int
        Number of operations for one component's derivatives.
    """

    def __init__(self, case: Case) -> None:
        with uncollected():
            tape = Tape()
            arrays = recorded_arrays(tape, case, ())
            T, n, residuals = arrays["pose"], 6, zeros(0)
            self._moving = list(range(n))
            if isinstance(case, ChainCase):
                n, self._moving = len(case.constants.is_length), case.moving
            if isinstance(case, ChainCase) and case.is_closed:
                _, _, position = joint_positions(tape, case.constants)
                residuals = gaps(recorded_tree(tape, case, position))
            multipliers = tape.vector("multipliers", len(residuals))
            terms: list[tuple[Scalar, Scalar]] = [(arrays["energy"][0], 1.0)]
            terms += zip(residuals, multipliers, strict=True)
            W = given_wrench(tape, case, lambda: T)
            if W is not None:
                # W . t = <G, dT> along a twist t of the body.
                G = T[:3, :3] @ np.column_stack([0.5 * skew_of(W[:3]), W[3:]])
                terms += zip(T[:3].ravel(), -G.ravel(), strict=True)
            forces = pullback(terms, list(tape.vector("q", n)))
            self._inputs = tuple(x for x in tape.inputs if x.array != "multipliers")
            weights = tape.vector("weights", n)
            numbers = [tape.input(*each) for each in self._inputs]
            parts = pullback(list(zip(forces, weights, strict=True)), numbers)
            known = {
                "forces": np.array(forces, object),
                "slopes": np.array(parts, object),
            }
            program = tape.program(known, [])
        self.size, self._count, self._closed = program.size, n, len(residuals)
        self._kernel = PortableKernel(program)

    def at(
        self, given: Mapping[str, Array], closing: Mapping[str, Array] | None
    ) -> dict[str, Array]:
        """Derivatives (n, ...) by the components of each input array."""
        n = self._count
        rows = {name: np.tile(row, (n, 1)) for name, row in given.items()}
        rows |= {"weights": np.eye(n), "multipliers": np.zeros((n, self._closed))}
        found = self._kernel(rows)
        if closing is not None:
            C, f = closing["q"][:, self._moving], found["forces"][0, self._moving]
            lam = np.linalg.lstsq(C.T, -f, rcond=numerics.RANK)[0]
            found = self._kernel({**rows, "multipliers": np.tile(lam, (n, 1))})
        return _by_array(self._inputs, found["slopes"], given)


def _by_array(
    inputs: Sequence[Input], slopes: Array, given: Mapping[str, Array]
) -> dict[str, Array]:
    """Derivatives (m, ...) by input array, from those by each input (m, inputs)."""
    by = {name: np.zeros((len(slopes), row.shape[1])) for name, row in given.items()}
    for (name, component), column in zip(inputs, slopes.T, strict=True):
        by[name][:, component] = column
    return by
