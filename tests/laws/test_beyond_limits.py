"""Limits without bounds are none, and a posture beyond a limit is computed without it."""

from __future__ import annotations

import numpy as np
import pytest
from tests.support.printed import text_of

import cartstiff

A, B, K = 0.5, 0.4, 1e4
FORCE = np.array([0.0, 0.0, -50.0])


def arm(limit: str) -> cartstiff.ElasticMechanism:
    """Two links in the plane xz, turning about y."""
    text = (
        '<robot name="arm"><link name="base"/><link name="a"/><link name="b"/><link name="tool0"/>'
        '<joint name="j1" type="revolute"><parent link="base"/><child link="a"/>'
        f'<axis xyz="0 1 0"/>{limit}</joint>'
        f'<joint name="j2" type="revolute"><parent link="a"/><child link="b"/>'
        f'<origin xyz="{A} 0 0"/><axis xyz="0 1 0"/>{limit}</joint>'
        '<joint name="f" type="fixed"><parent link="b"/><child link="tool0"/>'
        f'<origin xyz="{B} 0 0"/></joint></robot>'
    )
    return cartstiff.load(text, stiffness=K)


def tip(q: np.ndarray) -> np.ndarray:
    s = q[0] + q[1]
    return np.array([A * np.cos(q[0]) + B * np.cos(s), 0.0, -A * np.sin(q[0]) - B * np.sin(s)])


def by_hand(q: np.ndarray, force: np.ndarray) -> np.ndarray:
    """Displacement of the tip: fixed-point iteration of K x = J(q + x)^T f, J by differences."""
    x, h = np.zeros(2), 1e-6
    for _ in range(60):
        J = np.array([(tip(q + x + d) - tip(q + x - d)) / (2 * h) for d in h * np.eye(2)])
        x = J @ force / K
    return tip(q + x) - tip(q)


LIMITED = '<limit lower="{}" upper="{}" effort="1" velocity="1"/>'


@pytest.mark.parametrize(
    ("limit", "q"),
    [
        ('<limit effort="1" velocity="20"/>', (0.2, 0.3)),
        (LIMITED.format(-1, 1), (0.2, 0.3)),
        (LIMITED.format(-1, 0.19), (0.2, 0.1)),
        (LIMITED.format(-1, 0.1), (0.2, 0.3)),
        (LIMITED.format(0.5, 1), (0.2, 0.3)),
        (LIMITED.format(0, 0), (0.2, 0.3)),
    ],
)
@pytest.mark.parametrize("size", [1.0, 1e-9])
def test_the_way_back_to_a_limit_is_no_deflection(
    limit: str, q: tuple[float, float], size: float
) -> None:
    elastic, start = arm(limit), np.array(q)
    expected = by_hand(start, size * FORCE)
    wrench = [0, 0, 0, *(size * FORCE)]
    state = cartstiff.equilibrium(elastic, wrench=wrench, load_axes="world", q=q)
    np.testing.assert_allclose(state.displacement[3:], expected, rtol=1e-6, atol=1e-15)
    # The same where the rest positions are given, and the arm rests there beyond its limits.
    given = elastic.with_springs(rest=list(q))
    state = cartstiff.equilibrium(given, wrench=wrench, load_axes="world", q=q)
    np.testing.assert_allclose(state.displacement[3:], expected, rtol=1e-6, atol=1e-15)
    curve = cartstiff.load_curve(elastic, wrench=wrench, load_axes="world", q=q)
    np.testing.assert_allclose(curve.displacement[-1, 3:], expected, rtol=1e-6, atol=1e-15)


def test_it_is_said_first() -> None:

    elastic = arm(LIMITED.format(-1, 0.1))
    state = cartstiff.equilibrium(elastic, wrench=[0, 0, 0, *FORCE], q=[0.2, 0.3])
    doubts = text_of(state).partition("Doubts\n")[2].splitlines()
    assert doubts[0].startswith("  [beyond-limits] at the start: beyond limits: j1 is at 0.2 rad")
    assert "without" in doubts[0]
    result = cartstiff.analyse(elastic, [0.2, 0.3])
    doubts = text_of(result).partition("Doubts\n")[2]
    assert doubts.startswith("  [beyond-limits] beyond limits: j1")


def test_other_bounds_go_on_holding() -> None:
    """Beyond the upper bound of j1; j2 comes to rest on its own lower one."""
    elastic = arm(LIMITED.format(-0.001, 0.1))
    state = cartstiff.equilibrium(
        elastic, wrench=[0, 0, 0, 0, 0, 500], load_axes="world", q=[0.2, 0.0]
    )
    assert state.q[1] == pytest.approx(-0.001)
    assert set(state.reactions.limits) == {"j2"}
    assert state.q[0] == pytest.approx(0.2 - 500 * (A + B) * 0.98 / K, abs=1e-3)
