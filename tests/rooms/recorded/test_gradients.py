"""Recorded gradients by complex steps of their arithmetic, and beside difference quotients."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from tests.doors import LoadKind
from tests.inner import (
    OfFunction,
    OfQuantity,
    Settings,
    Tape,
    absolute,
    copysign,
    gradient_program,
    larger,
    largest,
    pick,
    square_root,
)
from tests.inner import gradient_Question as _Question
from tests.inner import gradients_matrices as matrices
from tests.laws.test_gradients import WRENCH, Case, central, mixed

import cartstiff
from cartstiff.extend import QUANTITIES


@pytest.mark.parametrize("seed", range(20))
def test_by_complex_steps(seed: int) -> None:
    """Every input of the recorded arithmetic alone, without a difference and its limit."""
    case = Case(seed)
    load = {"wrench": None, "load_kind": "dead", "load_at": np.zeros(3), **case.load}
    kind = LoadKind(load["load_kind"], load["load_at"])
    settings = Settings("load" if case.load else "B", 0.3, load=kind)
    asked: Any = OfFunction(case.of, settings)
    if isinstance(case.of, str):
        settings = replace(settings, connection="B")
        asked = OfQuantity(QUANTITIES[case.of], settings, case.elastic)
    solve = cartstiff.equilibrium if case.comes_to_rest else cartstiff.analyse
    subject = solve(case.elastic, case.q, **case.load)
    recorded, program = _Question(subject, asked, load, kind)._arithmetic
    found = program.at(recorded.given)
    rows, m = _complex_steps(program._numbers, recorded.given), len(found.values)
    _same(found.by, found.values, {name: row[:m] for name, row in rows.items()})
    if found.closing is not None:
        _same(found.closing, np.ones(1), {name: row[m:] for name, row in rows.items()})


def _same(found: Any, values: np.ndarray, wanted: dict[str, np.ndarray]) -> None:
    for name, rows in wanted.items():
        scale = max(np.abs(values).max(), np.abs(rows).max())
        np.testing.assert_allclose(found[name], rows, rtol=1e-9, atol=1e-12 * scale)


def _complex_steps(sweep: Any, given: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """``Im f(x + i h e) / h`` (m, ...) of recorded numbers f by the components of each input."""
    h, sizes = 1e-40, {name: row.shape[1] for name, row in given.items()}
    columns = np.split(np.eye(sum(sizes.values())), np.cumsum([*sizes.values()])[:-1])
    unit = dict(zip(sizes, columns, strict=True))
    at: dict[int, Any] = {}
    rules: dict[str, Callable[..., Any]] = {
        "add": lambda x, y: x + y,
        "sub": lambda x, y: x - y,
        "mul": lambda x, y: x * y,
        "div": lambda x, y: x / y,
        "neg": lambda x: -x,
        "sqrt": lambda x: np.sqrt(x + 0j),
        "sin": np.sin,
        "cos": np.cos,
        "abs": lambda x: x * np.copysign(1.0, np.real(x)),
        "copysign": lambda x, y: x * np.copysign(1.0, np.real(x)) * np.copysign(1.0, np.real(y)),
        "max": lambda x, y: np.where(np.real(x) < np.real(y), y, x),
        "pick": lambda a, b, x, y: np.where(np.real(a) < np.real(b), x, y),
    }
    for step in sweep._steps:
        name, arguments, value = sweep._tape.operations[step]
        if name == "input":
            array, component = sweep._tape.inputs[arguments[0]]
            value = given[array][0, component] + 1j * h * unit[array][component]
        elif name != "constant":
            value = rules[name](*[at[x] for x in arguments])
        at[step] = value
    ends = [np.imag(at[x.step]) / h if hasattr(x, "step") else 0.0 for x in sweep._numbers]
    rows = np.array([np.broadcast_to(end, sum(sizes.values())) for end in ends])
    return dict(zip(sizes, np.split(rows, np.cumsum([*sizes.values()])[:-1], axis=1), strict=True))


@pytest.mark.parametrize("name", ["ur5", "panda", "hexapod", "6-ups"])
@pytest.mark.parametrize("wrench", [None, WRENCH])
def test_sensitivities_are_exact_and_those_of_the_core(name, wrench):
    """All matrices, the pose and the frequencies, against difference quotients."""
    check_matrices(cartstiff.analyse(cartstiff.load(name), wrench=wrench))


@pytest.mark.parametrize("name", ["orthoglide", "delta"])
def test_a_frame_of_two_closures_and_links_that_bend(name):
    """The first leg's frame closes both loops; a link's stiffness has a factor."""
    starts = ("closure.body of leg 1.", "stiffness.")
    check_matrices(cartstiff.analyse(cartstiff.load(name)), starts)


@pytest.mark.parametrize("name", ["ur5", "panda", "hexapod", "6-ups", "five-bar"])
def test_what_comes_to_rest_again_is_exact_and_that_of_the_core(name):
    """The same of equilibria, whose pose moves too."""
    load = cartstiff.DeadForce([10.0, -20.0, 0.0])
    check_matrices(cartstiff.equilibrium(cartstiff.load(name), load))


def check_matrices(subject: Any, starts: tuple[str, ...] = ("",)) -> None:
    """Compare exact derivatives by some numbers with the quotients of other answers."""
    question = matrices._Question(subject, matrices.modes_of(subject))
    parameters = question.parameters
    names = list(parameters.nominal)
    exact = question._exact(names)
    assert len(exact) == len(names)
    names = [name for name in names if name.startswith(starts)]
    for name in names[:: max(1, len(names) // 6)]:
        quotient = parameters.quotient(name, question.seen, question.here)
        size = parameters.size(name)
        result = question.result
        scales = largest(question.here[0]), result.posture.length, 0.0
        seen, known = (
            question._told([name], [row.slopes], np.array([row.error]))
            for row in (exact[name], quotient)
        )
        for got, wanted, scale in zip(seen, known, scales, strict=True):
            least = 1e-7 * (scale or np.abs(got).max(initial=1.0) * size)
            np.testing.assert_allclose(got * size, wanted * size, rtol=1e-6, atol=least)


def recorded_mixed(at: Any) -> Any:
    """The same of a program."""
    return mixed(at["stiffness_B"], at["wrench"], at["pose"])


def test_the_gradient_costs_at_most_four_times_its_objective():
    soft = "translation_free_min"
    for name, quantity in (
        ("ur5", soft),
        ("panda", recorded_mixed),
        ("hexapod", soft),
        ("6-ups", soft),
    ):
        program = cartstiff.record(cartstiff.load(name), (quantity,), loaded=True)
        objective = program.tape
        (of,) = (name for name in objective.outputs if name != "verdict")
        whole = gradient_program(objective, of)
        assert whole.size <= 4.0 * objective.size, (name, whole.size, objective.size)


def test_every_operation_against_differences():
    """The adjoint of each recorded operation, on smooth functions and beside every kink."""

    def f(x: Any, y: Any) -> Any:
        a = square_root(x * x + y * y + 1.0) - x / (y + 3.0)
        b = larger(a, x) * absolute(y - x) + copysign(x, y)
        return pick(a, b, a * b - 2.0 / y, -b) + np.sin(x) * np.cos(y)

    def recorded(x: float, y: float) -> list[float]:
        tape = Tape()
        numbers = [tape.input("x", 0), tape.input("x", 1)]
        a = square_root(numbers[0] * numbers[0] + numbers[1] * numbers[1] + 1.0)
        a = a - numbers[0] / (numbers[1] + 3.0)
        b = larger(a, numbers[0]) * absolute(numbers[1] - numbers[0])
        b = b + copysign(numbers[0], numbers[1])
        value = pick(a, b, a * b - 2.0 / numbers[1], -b)
        value = value + numbers[0].sin() * numbers[1].cos()
        from tests.inner import PortableKernel

        known = {"value": np.array([value], object), "verdict": np.zeros(1)}
        program = gradient_program(tape.program(known, []), "value")
        return PortableKernel(program)({"x": np.array([[x, y]])})["by_x"][0].tolist()

    for x, y in ((0.3, 0.7), (-1.2, 0.4), (1.5, -0.6), (2.0, 2.5)):
        reference = [
            central(lambda h, x=x, y=y: float(f(x + h, y)), 1e-3),
            central(lambda h, x=x, y=y: float(f(x, y + h)), 1e-3),
        ]
        np.testing.assert_allclose(recorded(x, y), reference, rtol=1e-9, atol=1e-10)
