"""Modes of a tab: numbers of the library, one end of the swing, curves over frequency."""

import numpy as np
import pytest
from tests.support.pages import asking, source_of, state_of, tab_of

from cartstiff import UndefinedError, load, modes


def test_a_tab_is_told_modes_and_curves():
    elastic = load("ur5")
    session = tab_of(source_of(elastic))
    state = state_of(q=elastic.q.tolist(), mode=2, load=(0, 0, 0, 0, 0, -200.0), labels=False)
    first = session.answer(asking("draw", state))
    told = first.data["numbers"]["modes"]
    whole = modes(elastic, wrench=[0, 0, 0, 0, 0, -200.0])
    assert told["frequencies"] == pytest.approx(whole.frequencies.tolist())
    assert first.data["legend"]["nodal"]["name"] == "nodal axis of mode 2"
    curves = session.answer(asking("response", state, ratio=0.02)).data
    peak = curves["frequencies"][int(np.argmax(curves["curves"]["x"]))]
    assert min(abs(peak / f - 1) for f in whole.frequencies) < 0.02
    silent = session.answer(asking("numbers", state.model_copy(update={"mode": None})))
    assert silent.data["numbers"]["modes"] is None


def test_without_masses_there_are_words():
    session = tab_of(source_of(load("cubic")))
    state = state_of(mode=1)
    told = session.answer(asking("numbers", state)).data["numbers"]["modes"]
    assert "has a mass" in told["missing"]
    with pytest.raises(UndefinedError, match="has a mass"):
        session.answer(asking("response", state))
