"""Exact gradients of random mechanisms, by all numbers, are those of differences of the core."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from tests.doors import LoadKind, derivative_with_error
from tests.inner import OfFunction, OfQuantity, Settings, largest
from tests.inner import gradient_Question as _Question
from tests.inner import gradients_matrices as matrices
from tests.laws.test_gradients import WRENCH
from tests.support.builders import general_legs, legs_as_platform, legs_as_tree, loaded_arm

import cartstiff
from cartstiff.extend import QUANTITIES

#: A difference of eighth order has lost so much of the change per natural size.
LIMIT = 1e-7


def _cases(count: int, is_quick: Callable[[int], bool]) -> list[Any]:
    """Seeds; those that are not quick run with the thorough tests."""
    later = pytest.mark.thorough
    return [s if is_quick(s) else pytest.param(s, marks=later) for s in range(count)]


def mixed(K: Any, W: Any, T: Any) -> Any:
    """A function of everything that may enter an objective."""
    return K[3, 3] + 0.3 * K[0, 4] - 0.2 * K[5, 1] + 0.1 * (W[2] * W[5]) + T[0, 3] * K[4, 4]


def placed(K: Any, W: Any, T: Any) -> Any:
    """One of load and place, for fewer than six freedoms, which have no stiffness."""
    return T[0, 3] + 0.5 * T[1, 3] * T[0, 1] + 0.01 * (W[0] + W[5]) * T[1, 3]


def arm(seed: int, rng: np.random.Generator) -> tuple[Any, Any]:
    """An arm of 1 to 9 joints, some of them slides or screws, under its weight or not."""
    count = 1 + seed // 5 % 9
    kinds = "".join(rng.choice([*"RRRPH"], count))
    built = loaded_arm(kinds, seed=seed)
    elastic = built.elastic
    stiff = rng.uniform(1.0, 3.0, count) * 2e4
    elastic = replace(elastic, springs=elastic.springs.replaced(stiff, np.full(count, np.nan)))
    elastic = elastic.with_gravity([0.3, -1.0, -9.0]) if rng.random() < 0.5 else elastic
    return elastic, built.q


def platform(_: int, rng: np.random.Generator) -> tuple[Any, Any]:
    """Six legs between random points."""
    legs = general_legs(int(rng.integers(1000)))
    return legs_as_platform(legs), legs.q


def loop(_: int, rng: np.random.Generator) -> tuple[Any, Any]:
    """The same as a tree with closures."""
    _, tree = legs_as_tree(general_legs(int(rng.integers(1000))))
    return tree, tree.q


def plane(_: int, rng: np.random.Generator) -> tuple[Any, Any]:
    """A planar loop of fewer than six freedoms, of random springs."""
    elastic = cartstiff.load("five-bar")
    k = rng.uniform(0.5, 2.0, 2) * 800.0
    names = ("left_motor", "right_motor")
    return elastic.with_springs(dict(zip(names, k.tolist(), strict=True))), elastic.q


def cables(_: int, rng: np.random.Generator) -> tuple[Any, Any]:
    """Eight cables, away from the middle."""
    elastic = cartstiff.load("cable-robot")
    away = rng.uniform(-0.05, 0.05, 6) * [1, 1, 1, 0.5, 0.5, 0.5]
    return elastic, np.asarray(elastic.q) + away


FAMILIES: tuple[Callable[[int, np.random.Generator], tuple[Any, Any]], ...] = (
    arm,
    platform,
    loop,
    plane,
    cables,
)


class Case:
    """A random mechanism, question, load and objective, with its exact gradient."""

    def __init__(self, seed: int) -> None:
        self.rng = rng = np.random.default_rng(seed)
        elastic, q = FAMILIES[seed % 5](seed, rng)
        comes_to_rest, is_loaded = bool(seed // 5 % 2), rng.random() < 0.7
        kind = LoadKind("follower" if rng.random() < 0.3 else "dead", rng.uniform(-0.05, 0.05, 3))
        wrench = rng.uniform(-1.0, 1.0, 6) * [2.0, 2.0, 2.0, 20.0, 20.0, 20.0]
        kind = kind if is_loaded else LoadKind()
        load = {
            "wrench": wrench if is_loaded else None,
            "load_kind": kind.kind,
            "load_at": kind.at,
            "load_axes": "world" if is_loaded and kind.kind == "dead" else "body",
        }
        solve = cartstiff.equilibrium if comes_to_rest else cartstiff.analyse
        subject = solve(elastic, q, **load)
        settings = Settings("load" if is_loaded else "B", 0.3, None, None, load=kind)
        few = FAMILIES[seed % 5] is plane or len(q) < 6
        asked: Any = OfFunction(placed if few else mixed, settings)
        if not few and rng.random() < 0.5:
            asked = OfQuantity(QUANTITIES["translation_free_min"], settings, elastic)
        self.question = _Question(subject, asked, load, kind)
        self.parameters, self.nominal = self.question.parameters, self.question.nominal
        self.exact, why = self.question._exact()
        assert self.exact, why
        # Nothing that the answer names is left to difference quotients.
        assert self.exact.keys() >= self.nominal.keys()

    def seen(self, subject: Any) -> np.ndarray:
        """The objective of another answer of the core."""
        return np.array([self.question._seen(subject)])

    def along(self, change: dict[str, float]) -> None:
        """Compare the derivative along a change of numbers with a difference of the core."""

        def there(h: float) -> np.ndarray:
            values = {name: self.nominal[name] + h * x for name, x in change.items()}
            return self.seen(self.parameters.at(values))

        wanted, error = (float(x[0]) for x in derivative_with_error(there, 5e-4))
        parts = [self.exact[name] * x for name, x in change.items()]
        scale = max(abs(wanted), float(np.abs(parts).sum()))
        assert abs(sum(parts) - wanted) <= max(LIMIT * scale, 3.0 * error), change


# Loops of six legs take the longest to record: a few of them are enough for a quick run.
@pytest.mark.parametrize("seed", _cases(300, lambda seed: seed % 5 != 2 or seed < 25))
def test_along_a_change_of_all_numbers(seed: int) -> None:
    case = Case(seed)
    sizes = {name: case.parameters.size(name) for name in case.nominal}
    case.along({name: case.rng.uniform(-1.0, 1.0) * size for name, size in sizes.items()})


@pytest.mark.parametrize("seed", _cases(300, lambda seed: seed in (0, 31, 93)))
def test_along_each_number_alone(seed: int) -> None:
    case = Case(seed)
    here = [np.array([case.question.value])]
    for name in case.nominal:
        found = case.parameters.quotient(name, lambda r: [case.seen(r)], here)
        size, value = case.parameters.size(name), abs(case.question.value)
        got, wanted = case.exact[name] * size, float(found.slopes[0][0]) * size
        least = LIMIT * max(abs(wanted), 0.1 * value)
        assert abs(got - wanted) <= max(least, 3.0 * found.error * value), name


@pytest.mark.parametrize("seed", range(20))
def test_by_complex_steps(seed: int) -> None:
    """Every input of the recorded arithmetic alone, without a difference and its limit."""
    case = Case(seed)
    recorded, program = case.question._arithmetic
    found = program.at(recorded.given)
    _same(found.by, found.values, _complex_steps(program._objectives, recorded.given))
    if program._closing is not None:
        rows = _complex_steps(program._closing, recorded.given)
        _same(found.closing, np.ones(1), rows)


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


@pytest.mark.parametrize("name", ["ur5", "panda", "hexapod", "6-ups", "five-bar"])
def test_what_comes_to_rest_again_is_exact_and_that_of_the_core(name):
    """The same of equilibria, whose pose moves too."""
    load = cartstiff.DeadForce([10.0, -20.0, 0.0])
    check_matrices(cartstiff.equilibrium(cartstiff.load(name), load))


def check_matrices(subject: Any) -> None:
    """Compare exact derivatives with the quotients of other answers."""
    question = matrices._Question(subject, matrices.modes_of(subject))
    parameters = question.parameters
    names = list(parameters.nominal)
    exact = question._exact(names)
    assert len(exact) == len(names)
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
