r"""Exact derivatives of recorded numbers: reverse mode on the tape.

With w_i = dy/dx_i for the number x_i of each step, from the output y backwards,

    w_j = sum of w_i dx_i/dx_j over the steps i that read j,

which takes two to three times the operations of y for all inputs together (Griewank and Walther,
Evaluating Derivatives, SIAM 2008, section 3.2 and eq. 4.21). The sums are recorded on the same
tape, so that a gradient runs wherever a program runs, and may be differentiated again.

A `pick` and a `larger` are differentiated on the side that is taken; the other side counts zero.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from cartstiff import numerics
from cartstiff.batch.algebra import PLAIN
from cartstiff.batch.chains import ChainCase, joint_positions, recorded_tree
from cartstiff.batch.closed_chains import gaps
from cartstiff.batch.execution import PortableKernel
from cartstiff.batch.plans import TracedModel, recorded_arrays
from cartstiff.batch.tape import (
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
from cartstiff.geometry.se3 import Array


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
    r"""Derivatives of ``sum of weight * output`` by each input, recorded on the outputs' tape.

    Parameters
    ----------
    outputs : sequence of (output, weight)
        Recorded numbers of one tape, and the derivative of the objective by each; plain numbers
        among the outputs do not depend on anything.
    inputs : sequence of Number
        Inputs of that tape.
    choices : list, optional
        Gets the two numbers that each choice compares, and the adjoint of its result: where they
        are equal and that is not zero, there may be no derivative.

    Returns
    -------
    list of Number or float
        One for each input, 0.0 where nothing depends on it. The unit is that of the objective per
        unit of the input.
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


@dataclass(frozen=True, eq=False)
class Slopes:
    """An objective at one posture and its derivatives by every input of the recorded arithmetic.

    Attributes
    ----------
    value : float
        The objective.
    by : dict of str to ndarray
        Derivatives by the components of each input array.
    closing : dict of str to ndarray, optional
        Of a closed chain: derivatives (r, ...) of the closures' residuals by the same components.
    kinks : int
        Number of choices that depend on equal numbers: principal values that coincide, lines that
        are about to go slack.
    size, whole : int
        Number of operations of the objective, and with all derivatives.
    """

    value: float
    by: Mapping[str, Array]
    closing: Mapping[str, Array] | None
    kinks: int
    size: int
    whole: int


#: Two numbers that differ by a smaller share are equal.
_TIE = numerics.NEGLIGIBLE_DIFFERENCE
#: An objective on recorded numbers: from the arrays of `analyse_many` to a number and its verdict.
Objective = Callable[[Mapping[str, Array]], tuple[Scalar, Scalar]]


def slopes(
    taken: TracedModel,
    needed: tuple[str, ...],
    objective: Objective,
    q: Array,
    wrench: Array | None,
) -> Slopes | None:
    """Record an objective with its derivatives and run it at one posture.

    Parameters
    ----------
    taken : TracedModel
        The recorded arithmetic of the mechanism.
    needed : tuple of str
        Outputs that the objective reads.
    objective : callable
    q : ndarray (n,)
        Coordinates, which close a chain.
    wrench : ndarray (6,), optional
        As the case of `taken` takes it.

    Returns
    -------
    Slopes or None
        None if an output does not exist, or where the posture is not plainly regular.
    """
    given = {name: np.atleast_2d(row) for name, row in taken.shared.items()}
    given["q"] = q[None]
    if wrench is not None:
        given["wrench"] = wrench[None]
    with uncollected():
        tape = Tape()
        try:
            arrays = recorded_arrays(tape, taken.case, needed)
            value, verdict = objective(arrays)
        except KeyError:
            return None
        inputs = [tape.input(*each) for each in tuple(tape.inputs)]
        known = {name: np.array([x], object) for name, x in (("value", value),)}
        known["verdict"] = np.array([larger(arrays["verdict"][0], verdict)], object)
        size = tape.program(known, []).size
        choices = list[tuple[Scalar, Scalar, Scalar]]()
        known["slopes"] = np.array(pullback([(value, 1.0)], inputs, choices), object)
        known["choices"] = np.array(choices, object).reshape(-1)
        program = tape.program(known, [])
    found = _run(program, given)
    numbers = np.concatenate([found["value"], found["slopes"]])
    if found["verdict"][0] != PLAIN or not np.isfinite(numbers).all():
        return None
    by = {name: np.zeros(given[name].shape[1]) for name in given}
    for (name, component), slope in zip(tape.inputs, found["slopes"], strict=True):
        by[name][component] = slope
    closing = _closing(taken, given) if taken.is_closed else None
    x, y, adjoint = found["choices"].reshape(-1, 3).T
    is_kink = np.abs(x - y) <= _TIE * np.maximum(np.abs(x), np.abs(y))
    kinks = int((is_kink & (adjoint != 0.0)).sum())
    return Slopes(float(found["value"][0]), by, closing, kinks, size, program.size)


def _closing(taken: TracedModel, given: Mapping[str, Array]) -> dict[str, Array]:
    """Derivatives of the closures' residuals by all inputs, one run with a row for each."""
    case = taken.case
    if not isinstance(case, ChainCase):
        raise TypeError(case)
    with uncollected():
        tape = Tape()
        _, _, position = joint_positions(tape, case.constants)
        residuals = gaps(recorded_tree(tape, case, position))
        weights = tape.vector("weights", len(residuals))
        inputs = [tape.input(*each) for each in tuple(tape.inputs)]
        parts = pullback(list(zip(residuals, weights, strict=True)), inputs)
        program = tape.program({"slopes": np.array(parts, object)}, [])
    rows = len(residuals)
    many = {name: np.tile(row, (rows, 1)) for name, row in given.items()}
    found = PortableKernel(program)({**many, "weights": np.eye(rows)})["slopes"]
    by = {name: np.zeros((rows, row.shape[1])) for name, row in given.items()}
    for (name, component), column in zip(tape.inputs, found.T, strict=True):
        if name in by:
            by[name][:, component] = column
    return by


def _run(program: Program, given: Mapping[str, Array]) -> dict[str, Array]:
    """Outputs of a program at one posture."""
    found = PortableKernel(program)(given)
    return {name: rows[0] for name, rows in found.items()}
