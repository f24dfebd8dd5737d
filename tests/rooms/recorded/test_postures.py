"""Postures that a page has recorded are the core's: numbers, notes, words of the load."""

import pickle

import numpy as np
import pytest
from tests.doors import DEAD_AT_ORIGIN, LoadKind
from tests.inner import RecordedPostures
from tests.support.pages import message_of, numbers_shown, source_of, state_of, tab_of

import cartstiff
import cartstiff as cs
from cartstiff import ConvergenceError

WRENCH = np.array([4.0, -3.0, 2.0, 20.0, 30.0, -40.0])
FOLLOWER = LoadKind("follower", (0.05, -0.02, 0.1))
# The same formulas in another order; the worst of these postures has a condition of some 1e3.
SAME = 1e-11


def later(*case):
    """A case of `make thorough` and of this file when it is named."""
    return pytest.param(*case, marks=pytest.mark.thorough)


def close(a, b):
    if b is None:
        assert a is None
    else:
        assert np.abs(a - b).max() <= SAME * np.abs(b).max()


@pytest.mark.parametrize(
    ("name", "wrench", "load", "axes", "spread", "quick"),
    [
        ("ur5", None, DEAD_AT_ORIGIN, "body", 0.4, 20),
        ("ur5", WRENCH, FOLLOWER, "world", 1.5, 15),
        ("stewart-gough", None, DEAD_AT_ORIGIN, "body", 0.2, 20),  # near type 2 everywhere
        ("6-ups", None, DEAD_AT_ORIGIN, "body", 0.6, 5),  # far out it cannot be closed
        later("panda", WRENCH, DEAD_AT_ORIGIN, "world", 0.4, 15),
        later("hexapod", None, DEAD_AT_ORIGIN, "body", 0.02, 20),
        later("6-ups", WRENCH, FOLLOWER, "world", 0.1, 15),
        later("delta", None, DEAD_AT_ORIGIN, "body", 0.3, 15),  # with links that give
        ("cable-robot", None, DEAD_AT_ORIGIN, "body", 0.01, 0),  # slackness is the core's
    ],
)
def test_every_answer_is_the_cores(name, wrench, load, axes, spread, quick):
    elastic, rng, found = cartstiff.load(name), np.random.default_rng(3), 0
    recorded = RecordedPostures(elastic)
    recorded.posture(elastic.q, wrench, load, axes)
    recorded.record().join()
    moved = list(
        (elastic.mechanism.closures and elastic.mechanism.actuated) or range(len(elastic.q))
    )
    given = {}
    if wrench is not None:
        given = {"wrench": wrench, "load_axes": axes, "load_kind": load.kind, "load_at": load.at}
    for _ in range(20):
        q = elastic.q.copy()
        shares = [0.1 if elastic.mechanism.coordinates[i].is_length else 1.0 for i in moved]
        q[moved] += rng.uniform(-spread, spread, len(moved)) * shares
        try:
            core = cartstiff.analyse(elastic, q, **given)
        except ConvergenceError:
            with pytest.raises(ConvergenceError):
                recorded.posture(q, wrench, load, axes)
            continue
        ours = recorded.posture(q, wrench, load, axes)
        found += "reduction" not in vars(ours)
        close(ours.q, core.q)
        assert [n.code for n in ours.notes] == [n.code for n in core.notes]
        assert [n.code for n in ours.notes_on_posture] == [n.code for n in core.notes_on_posture]
        for matrices, expected in (
            (ours.matrices, core.matrices),
            (ours.compliances, core.compliances),
        ):
            for c in (*"ABKF", "load"):
                if expected[c] is not None:
                    close(matrices[c], expected[c])
        for what in ("pose", "jacobian", "wrench", "leg_lengths", "tensions"):
            if np.any(getattr(core, what)):
                close(getattr(ours, what), getattr(core, what))
        assert ours.energy == pytest.approx(core.energy, rel=SAME, abs=1e-15)
        assert ours.stored_energy == pytest.approx(core.stored_energy, rel=SAME, abs=1e-15)
        assert ours.is_loaded == core.is_loaded
        assert ours.length == pytest.approx(core.length, rel=SAME)
        assert ours.load_as_dict().keys() == core.load_as_dict().keys()
        assert ours.to_dict().keys() == core.to_dict().keys()
    assert found >= quick


@pytest.mark.parametrize("name", ["ur5", "6-ups"])
def test_the_page_shows_the_same_numbers(name):
    elastic = cartstiff.load(name)
    recorded = RecordedPostures(elastic)
    recorded.posture(elastic.q, WRENCH, DEAD_AT_ORIGIN, "body")
    recorded.record().join()
    ours = recorded.posture(elastic.q, WRENCH, DEAD_AT_ORIGIN, "body")
    core = cartstiff.analyse(elastic, wrench=WRENCH)
    assert "reduction" not in vars(ours)
    state = state_of(q=elastic.q.tolist(), load=tuple(WRENCH), point=(0.1, 0.0, 0.2))
    same(numbers_shown(ours, state), numbers_shown(core, state))
    assert pickle.loads(pickle.dumps(ours)).tangent == pytest.approx(core.tangent)


def same(ours, core, where=""):
    """Equal words, numbers to rounding."""
    if isinstance(core, dict):
        assert ours.keys() == core.keys()
        for key in core:
            same(ours[key], core[key], f"{where}.{key}")
    elif isinstance(core, list) and core and isinstance(core[0], (float, list)):
        scale = np.abs(np.array(core, float)).max()
        np.testing.assert_allclose(ours, core, rtol=1e-7, atol=1e-9 * scale, err_msg=where)
    elif isinstance(core, list):
        assert len(ours) == len(core), where
        for a, b in zip(ours, core, strict=True):
            same(a, b, where)
    elif isinstance(core, float):
        assert ours == pytest.approx(core, rel=1e-6, abs=1e-9), where
    else:
        assert ours == core, where


def test_a_session_records_each_kind_of_load_that_it_was_asked_for():
    session = tab_of(source_of(cartstiff.load("ur5")))
    text = '{"id": 1, "do": "draw", "state": {"q": [0, -1, 1.5, %r, 1, 0]}}'
    drawn = [session.answer(message_of(text % (0.01 * k))) for k in range(3)]
    session.postures.record().join()
    assert not session.postures.waiting
    recorded = session.result(state_of(q=[0.1, -1.0, 1.5, 0.2, 1.0, 0.0]))
    assert recorded.is_plain
    again = session.answer(message_of(text % 0.0))
    same(again.data["numbers"], drawn[0].data["numbers"])
    other = session.postures
    session.answer(
        message_of('{"id": 2, "do": "draw", "state": {"payload": [2.0, 0.0, 0.0, 0.1]}}')
    )
    assert session.postures is not other  # another mechanism, with programs of its own


def test_a_recorded_posture_doubts_the_forces_that_the_core_doubts():
    """A page asks whether a limit may be passed, and for forces only then."""
    ur5 = cs.load("ur5")
    recorded = RecordedPostures(ur5)
    recorded.posture(ur5.q, np.array([0, 0, 0, 0, 0, -1.0]), DEAD_AT_ORIGIN, "world")
    recorded.record().join()
    rng, doubted = np.random.default_rng(8), []
    for size in np.linspace(-700.0, 700.0, 57):
        q, wrench = ur5.q + rng.uniform(-0.4, 0.4, 6), np.array([0, 0, 0, 0, 0, size])
        quick = recorded.posture(q, wrench, DEAD_AT_ORIGIN, "world")
        core = cs.analyse(ur5, q, wrench=wrench, load_axes="world")
        each = [[n.message for n in r.notes if n.code == "force-limits"] for r in (quick, core)]
        assert each[0] == each[1], size
        doubted.append(bool(each[0]))
    assert any(doubted)
    assert not all(doubted)
