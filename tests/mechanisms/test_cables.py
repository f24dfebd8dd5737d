"""Cables: a closed form, slack ones, loads that would need pushing, tensions found."""

from __future__ import annotations

import numpy as np
import pytest
from tests.mechanisms.machines import codes, note, write_file
from tests.mechanisms.oracle import bundled_lines
from tests.support import relative_error

from cartstiff import analyse, load
from cartstiff.errors import InputError
from cartstiff.potentials.loads import DeadForce
from cartstiff.statics.equilibrium import equilibrium

# A closed form against a sum over four cables.
CLOSED_FORM = 1e-13
# Tensions by least squares or by active sets.
TENSIONS = 1e-9

CORNERS = np.array([[1, 1, 0], [-1, 1, 0], [-1, -1, 0], [1, -1, 0]]) / np.sqrt(2)


def _cross(folder, k=7000.0, t=150.0, length=0.8, **legs):
    legs = legs or {"stiffness": k, "preload": t}
    return load(
        write_file(
            folder,
            kind="springs",
            unilateral=True,
            base=length * CORNERS,
            platform=np.zeros((4, 3)),
            legs=legs,
        )
    )


@pytest.mark.parametrize(
    ("k", "t", "length"), [(7000.0, 150.0, 0.8), (50.0, 0.0, 2.0), (1e5, 3e3, 0.1)]
)
def test_four_diagonal_cables(tmp_path, k, t, length):
    """Meeting in a point: (2 k + 2 t / l) I in their plane, 4 t / l across it."""
    result = analyse(_cross(tmp_path, k, t, length))
    plane, across = 2 * k + 2 * t / length, 4 * t / length
    expected = np.zeros((6, 6))
    expected[3:, 3:] = np.diag([plane, plane, across])
    for name in "ABK":
        assert relative_error(result.matrices[name], expected) <= CLOSED_FORM
    assert np.abs(result.wrench).max() <= CLOSED_FORM * (k + t)


def test_slack_cables_are_named(tmp_path):
    rest = np.array([0.79, 0.81, 0.795, 0.83])
    k, length = 7000.0, 0.8
    result = analyse(_cross(tmp_path, stiffness=k, rest_length=rest.tolist()))
    found = note(result, "slack")
    assert found.values["slack"] == [2, 4]
    assert "2, 4" in found.message
    # Cables 1 and 3 are opposite each other: all the stiffness is along them and tension's across.
    t = k * (length - rest[[0, 2]])
    u = CORNERS[0]
    across = np.eye(3) - np.outer(u, u)
    expected = 2 * k * np.outer(u, u) + t.sum() / length * across
    assert relative_error(result.matrices["B"][3:, 3:], expected) <= CLOSED_FORM
    # W holds the body: against the pull of the two.
    assert relative_error(result.wrench[3:], (t[1] - t[0]) * u) <= CLOSED_FORM


def test_taut_cables_are_not_named(tmp_path):
    assert "slack" not in codes(analyse(_cross(tmp_path)))


def test_a_load_that_needs_pushing_is_refused(tmp_path):
    """W holds the body against its cables: those from above can be balanced by pulling down."""
    elastic = _crane(tmp_path)
    result = analyse(elastic, wrench=[0, 0, 0, 0, 0, -60.0])
    tensions = result.elastic.springs.tensions(result.posture.lines.lengths)
    assert relative_error(tensions, np.full(6, tensions[0])) <= TENSIONS
    assert tensions[0] > 60.0 / 6
    with pytest.raises(InputError, match="push"):
        analyse(elastic, wrench=[0, 0, 0, 0, 0, 60.0])


def _crane(folder):
    """A body hung on six cables in pairs, as an inverted hexapod."""
    top = np.deg2rad([10, 110, 130, 230, 250, 350])
    low = np.deg2rad([50, 70, 170, 190, 290, 310])
    ring = lambda a: np.stack([np.cos(a), np.sin(a), np.zeros(6)], axis=1)  # noqa: E731
    return load(
        write_file(
            folder,
            kind="springs",
            unilateral=True,
            base=ring(top) + np.array([0, 0, 1.5]),
            platform=0.4 * ring(low),
            legs={"stiffness": 1e4},
        )
    )


def test_redundant_cables_share_a_load():
    """Eight cables, six equations: no tension is negative, and together they hold the load."""
    elastic = load("cable-robot")
    rng = np.random.default_rng(11)
    for _ in range(20):
        wrench = rng.uniform(-1, 1, 6) * [2.0, 2.0, 2.0, 40.0, 40.0, 40.0]
        result = analyse(elastic, wrench=wrench)
        springs = result.elastic.springs
        lines = bundled_lines("cable-robot", springs.rest)
        ends = lines.points + lines.pose0[:3, 3]
        lengths = np.linalg.norm(ends - lines.base, axis=1)
        tensions = springs.stiffness * (lengths - springs.rest)
        assert tensions.min() >= -TENSIONS * tensions.max()
        u = (ends - lines.base) / lengths[:, None]
        held = np.concatenate([np.cross(lines.points, u).T @ tensions, u.T @ tensions])
        assert relative_error(held, wrench) <= TENSIONS
        assert relative_error(result.wrench, wrench) <= TENSIONS


def test_a_load_no_line_feels_is_refused(tmp_path):
    """Four cables through a point feel no moment."""
    with pytest.raises(InputError, match="no tensions"):
        analyse(_cross(tmp_path), wrench=[0, 0, 5.0, 0, 0, 0])


def test_an_equilibrium_names_its_slack_cables(tmp_path):
    """Pushed along a diagonal by more than the preload, the cable on that side hangs loose."""
    k, t, length = 7000.0, 150.0, 0.8
    state = equilibrium(_cross(tmp_path, k, t, length), DeadForce(400.0 * CORNERS[0]))
    assert [n.values["slack"] for n in state.notes if n.code == "slack"] == [[1]]
    moved = state.displacement[3:] @ CORNERS[0]
    assert moved > t / k
    # Cable 3 alone pulls back along the diagonal; the two across it help by their tension.
    across = np.hypot(length, moved)
    sideways = 2 * (k * (across - length) + t) * moved / across
    assert np.isclose(t + k * moved + sideways, 400.0, rtol=TENSIONS)
