"""Exact gradients of random mechanisms, by all numbers, are those of differences of the core."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from tests.inner import (
    QUANTITIES,
    LoadKind,
    OfFunction,
    OfQuantity,
    Settings,
    derivative_with_error,
)
from tests.inner import gradient_Question as _Question
from tests.support.builders import general_legs, legs_as_platform, legs_as_tree, loaded_arm

import cartstiff

#: A difference of eighth order has lost so much of the change per natural size.
LIMIT = 1e-7
#: Cases of the quick run; 300 with the thorough one.
SEEDS = [
    *range(10),
    *(pytest.param(seed, marks=pytest.mark.thorough) for seed in range(10, 300)),
]


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


@pytest.mark.parametrize("seed", SEEDS)
def test_by_all_numbers(seed: int) -> None:
    rng = np.random.default_rng(seed)
    elastic, q = FAMILIES[seed % 5](seed, rng)
    comes_to_rest, is_loaded = bool(seed // 5 % 2), rng.random() < 0.7
    kind = LoadKind("follower" if rng.random() < 0.3 else "dead", rng.uniform(-0.05, 0.05, 3))
    wrench = rng.uniform(-1.0, 1.0, 6) * [2.0, 2.0, 2.0, 20.0, 20.0, 20.0]
    axes = "body" if kind.kind == "follower" else "world"
    load = {
        "wrench": wrench if is_loaded else None,
        "load_kind": kind.kind if is_loaded else "dead",
        "load_at": kind.at if is_loaded else (0.0, 0.0, 0.0),
        "load_axes": axes if is_loaded else "body",
    }
    kind = kind if is_loaded else LoadKind()
    solve = cartstiff.equilibrium if comes_to_rest else cartstiff.analyse
    subject = solve(elastic, q, **load)
    settings = Settings("load" if is_loaded else "B", 0.3, None, None, load=kind)
    few = FAMILIES[seed % 5] is plane or len(q) < 6
    asked: Any = OfFunction(placed if few else mixed, settings)
    if not few and rng.random() < 0.5:
        asked = OfQuantity(QUANTITIES["translation_free_min"], settings, elastic)
    question = _Question(subject, asked, load, kind)
    exact, why = question._exact()
    assert exact, why
    names = sorted(exact)
    # Each is 8 to 24 answers of the core: of many numbers some are compared.
    some = rng.permutation(names)[:5] if len(names) > 5 else names
    here = [np.array([question.value])]
    parameters = question.parameters
    for name in [x for x in some if x in question.nominal]:
        found = parameters.quotient(name, lambda r: [np.array([question._seen(r)])], here)
        size = parameters.size(name)
        got, wanted = exact[name] * size, float(found.slopes[0][0]) * size
        least = LIMIT * max(abs(wanted), abs(question.value) * 1e-1)
        assert abs(got - wanted) <= max(least, 3.0 * found.error * abs(question.value)), name
    # All of them at once: one derivative along a random change of every number.
    every = [name for name in names if name in question.nominal]
    change = {name: rng.uniform(-1.0, 1.0) * parameters.size(name) for name in every}

    def along(h: float) -> np.ndarray:
        there = parameters.at({n: question.nominal[n] + h * x for n, x in change.items()})
        return np.array([question._seen(there)])

    wanted, error = (float(x[0]) for x in derivative_with_error(along, 5e-4))
    got = sum(exact[name] * x for name, x in change.items())
    scale = max(abs(wanted), sum(abs(exact[name] * x) for name, x in change.items()))
    assert abs(got - wanted) <= max(LIMIT * scale, 3.0 * error)
