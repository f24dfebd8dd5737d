"""Intervals where the linear one misleads: their ends are those of the profile likelihood."""

from __future__ import annotations

import numpy as np
import pytest
from tests.identify.campaigns import arm, load

from cartstiff.identify import fitting, profile
from cartstiff.identify.campaign import identify
from cartstiff.identify.candidates import candidates
from cartstiff.identify.intervals import quantile
from cartstiff.identify.synthetic import simulated

SPREAD = {"dx": 0.02, "dy": 0.02, "dz": 0.02}


@pytest.fixture(scope="module")
def soft(tmp_path_factory):
    """A soft arm that a load bends far, seen badly and seldom."""
    path = arm("scara", tmp_path_factory.mktemp("soft"), springs=(3000.0, 1200.0, 8e4, 200.0))
    elastic = load(path)
    rows = candidates(elastic, SPREAD, count=5, force=300.0, seed=3)
    return elastic, simulated(elastic, rows, SPREAD, loaded=True, tell_deviations=True, seed=1)


def test_a_profile_ends_where_another_fit_says(soft):
    elastic, measured = soft
    known = {"j4": 200.0}
    found = identify(elastic, measured, loaded=True, known=known)
    bent = [e for e in found.estimates if e.method == "profile"]
    assert bent
    for e in bent:
        held = identify(elastic, measured, loaded=True, known=known | {e.name: 1.0 / e.interval[1]})
        grown = held.checks.chi_squared - found.checks.chi_squared
        assert grown == pytest.approx(quantile(0.95, float("inf")) ** 2, rel=0.03)


def test_what_was_not_looked_at_is_called_so(soft, monkeypatch):
    elastic, measured = soft
    monkeypatch.setattr(profile, "_BUDGET", 0)
    found = identify(elastic, measured, loaded=True, known={"j4": 200.0})
    assert "profile-not-taken" in {note.code for note in found.notes}
    assert "linear, not looked at" in {e.method for e in found.estimates}


def test_what_the_rows_hardly_show_does_not_creep():
    found = fitting._damped(
        lambda z: np.array([z[0] - 1.0, z[0] + 1.0, 1e-3 * z[1] - 0.5]),
        lambda z: np.array([[1.0, 0.0], [1.0, 0.0], [0.0, 1e-3]]),
        np.array([0.4, 2.0]),
        np.array([0.0, 0.0]),
    )
    assert found == pytest.approx([0.0, 2.0], abs=1e-4)
