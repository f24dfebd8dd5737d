"""Modes of a tab: numbers of the library, pictures along a swing, curves over frequency."""

from __future__ import annotations

import numpy as np
import pytest
from tests.inner import Draw, Numbers, Response, Session, Source, Swing, ViewState, extent, swing_of

from cartstiff import InputError, UndefinedError, load, modes


@pytest.mark.parametrize("name", ["ur5", "stewart-simscape", "five-bar"])
def test_swing_has_the_size_that_was_asked_for(name):
    elastic = load(name)
    found = modes(elastic)
    swung = swing_of(found, 1, share=0.01, count=5)
    corners = [extent(elastic, posture) for posture in swung.postures]
    size = np.ptp(corners[2], axis=0).max()
    assert swung.postures[2].q == pytest.approx(found.q, abs=1e-9)
    for end in (corners[0], corners[-1]):
        assert np.linalg.norm(end - corners[2], axis=1).max() == pytest.approx(
            0.01 * size, rel=0.05
        )
    # It goes along the mode: the ends differ by twice the rates.
    way = swung.postures[-1].pose[:3, 3] - swung.postures[0].pose[:3, 3]
    twist = found.posture.pose[:3, :3] @ found.twists[3:, 0]
    assert abs(way @ twist) == pytest.approx(np.linalg.norm(way) * np.linalg.norm(twist), rel=1e-3)
    with pytest.raises(InputError, match="no such mode"):
        swing_of(found, 99)
    with pytest.raises(InputError, match="share"):
        swing_of(found, 1, share=0.0)


def test_a_tab_is_told_modes_pictures_and_curves():
    elastic = load("ur5")
    session = Session(Source(elastic))
    state = ViewState(q=elastic.q.tolist(), mode=2, load=(0, 0, 0, 0, 0, -200.0), labels=False)
    first = session.answer(Draw(id=1, do="draw", state=state))
    told = first.data["numbers"]["modes"]
    whole = modes(elastic, wrench=[0, 0, 0, 0, 0, -200.0])
    assert told["frequencies"] == pytest.approx(whole.frequencies.tolist())
    assert first.data["legend"]["nodal"]["name"] == "nodal axis of mode 2"
    answer = session.answer(Swing(id=2, do="swing", state=state, share=0.1))
    assert sum(answer.data["counts"]) == len(answer.commands)
    assert len(answer.data["counts"]) == 18
    assert answer.data["displacement"] > 0.01
    # What is drawn next starts from the rest.
    assert (
        session.answer(Swing(id=3, do="swing", state=state)).commands[-7:] == answer.commands[-7:]
    )
    curves = session.answer(Response(id=4, do="response", state=state, ratio=0.02)).data
    peak = curves["frequencies"][int(np.argmax(curves["curves"]["x"]))]
    assert min(abs(peak / f - 1) for f in whole.frequencies) < 0.02
    silent = session.answer(
        Numbers(id=5, do="numbers", state=state.model_copy(update={"mode": None}))
    )
    assert silent.data["numbers"]["modes"] is None


def test_without_masses_there_are_words():
    session = Session(Source(load("cubic")))
    state = ViewState(mode=1)
    told = session.answer(Numbers(id=1, do="numbers", state=state)).data["numbers"]["modes"]
    assert "has a mass" in told["missing"]
    with pytest.raises(UndefinedError, match="has a mass"):
        session.answer(Response(id=2, do="response", state=state))
