"""Modes of a tab: numbers of the library, one end of the swing, curves over frequency."""

from __future__ import annotations

import numpy as np
import pytest
from tests.inner import Draw, Numbers, Response, extent, swing_of
from tests.support.pages import source_of, state_of, tab_of

from cartstiff import UndefinedError, load, modes


@pytest.mark.parametrize("name", ["ur5", "stewart-simscape", "five-bar"])
def test_a_step_goes_along_the_mode_as_far_as_it_says(name):
    elastic = load(name)
    found = modes(elastic)
    step, far = swing_of(found, 1)
    mechanism = elastic.mechanism
    ends = [mechanism.at(mechanism.displaced(found.q, x * step)) for x in (-1e-5, 1e-5)]
    corners = [extent(elastic, end) for end in ends]
    moved = np.linalg.norm(corners[1] - corners[0], axis=1).max()
    assert moved == pytest.approx(2e-5 * far, rel=1e-3)
    way = ends[1].pose[:3, 3] - ends[0].pose[:3, 3]
    twist = found.posture.pose[:3, :3] @ found.twists[3:, 0]
    assert abs(way @ twist) == pytest.approx(np.linalg.norm(way) * np.linalg.norm(twist), rel=1e-3)


@pytest.mark.parametrize("name", ["ur5", "five-bar"])
def test_the_ghost_of_a_mode_is_one_end_of_its_swing(name):
    """A tenth of the size away for what moves most, along the mode."""
    elastic = load(name)
    session = tab_of(source_of(elastic))
    state = state_of(q=elastic.q.tolist(), mode=1)
    away = session.answer(Draw(id=1, do="draw", state=state)).data["legend"]["rest"]
    assert away["mode"] == 1
    found = modes(elastic)
    _, far = swing_of(found, 1)
    size = session.picture._scene.size
    assert away["enlarged"] * far <= 0.14 * size * (1 + 1e-9)
    assert 0.05 * size < away["enlarged"] * far or away["enlarged"] > 0.2
    without = state.model_copy(update={"mode": None})
    assert session.answer(Draw(id=2, do="draw", state=without)).data["legend"]["rest"] is None


def test_a_tab_is_told_modes_and_curves():
    elastic = load("ur5")
    session = tab_of(source_of(elastic))
    state = state_of(q=elastic.q.tolist(), mode=2, load=(0, 0, 0, 0, 0, -200.0), labels=False)
    first = session.answer(Draw(id=1, do="draw", state=state))
    told = first.data["numbers"]["modes"]
    whole = modes(elastic, wrench=[0, 0, 0, 0, 0, -200.0])
    assert told["frequencies"] == pytest.approx(whole.frequencies.tolist())
    assert first.data["legend"]["nodal"]["name"] == "nodal axis of mode 2"
    curves = session.answer(Response(id=4, do="response", state=state, ratio=0.02)).data
    peak = curves["frequencies"][int(np.argmax(curves["curves"]["x"]))]
    assert min(abs(peak / f - 1) for f in whole.frequencies) < 0.02
    silent = session.answer(
        Numbers(id=5, do="numbers", state=state.model_copy(update={"mode": None}))
    )
    assert silent.data["numbers"]["modes"] is None


def test_without_masses_there_are_words():
    session = tab_of(source_of(load("cubic")))
    state = state_of(mode=1)
    told = session.answer(Numbers(id=1, do="numbers", state=state)).data["numbers"]["modes"]
    assert "has a mass" in told["missing"]
    with pytest.raises(UndefinedError, match="has a mass"):
        session.answer(Response(id=2, do="response", state=state))
