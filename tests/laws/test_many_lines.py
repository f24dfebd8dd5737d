"""Line springs and cables between bodies of chains: the fast paths give the engine's answers."""

from dataclasses import replace

import numpy as np
import pytest
from tests.laws.test_many_rigid import assert_the_engines

import cartstiff
from cartstiff import LineSprings, analyse_many

pytest.importorskip("llvmlite")

LOAD = (1.0, 2.0, -3.0, 20.0, -10.0, 40.0)
COUNT = 30


def line(frames, ends, stiffness, rest, unilateral=False):
    """A line spring, or a cable, between points of two frames."""
    return LineSprings(
        frame_a=frames[0],
        frame_b=frames[1],
        anchors=np.array([ends[0]], float),
        points=np.array([ends[1]], float),
        stiffness=np.array([stiffness]),
        rest_length=np.array([rest]),
        unilateral=unilateral,
    )


#: Lines from F, between links, to the body itself, and cables of which some postures slacken one.
LINES = {
    "ur5": (
        line(("world", "forearm_link"), ([0, 0, 2], [0, 0, 0]), 5e3, 1.6, unilateral=True),
        line(("shoulder_link", "wrist_1_link"), ([0.1, 0, 0.2], [0, 0.05, 0]), 3e3, 0.4),
        line(("upper_arm_link", "body"), ([0.1, 0.1, 0], [0, 0, 0.1]), 2e3, 0.5),
    ),
    "panda": (
        line(("world", "panda_link4"), ([0, 0, 1], [0, 0, 0]), 2e3, 0.4, unilateral=True),
        line(("panda_link2", "panda_link6"), ([0, 0, 0.1], [0, 0.1, 0]), 1e3, 0.3),
    ),
    "3-rps": (
        line(("leg1/lower", "leg2/upper"), ([0, 0, 0.1], [0, 0, 0.05]), 2e4, 0.2),
        line(("world", "body"), ([0, 0, 2], [0, 0, 0]), 1e4, 0.9, unilateral=True),
    ),
    "6-ups": (
        line(("world", "platform"), ([0, 0, 0], [0, 0.05, 0]), 2e4, 0.2),
        line(("cylinder1", "rod4"), ([0, 0, 0.1], [0, 0, 0.1]), 1e4, 0.9, unilateral=True),
    ),
}


def with_lines(name):
    """A mechanism, its lines, and postures near its own."""
    elastic, rng = cartstiff.load(name), np.random.default_rng(2)
    elastic = replace(elastic, potentials=LINES[name])
    moved = list(getattr(elastic.mechanism, "held", ())) or list(range(elastic.q.size))
    size = 0.05 if elastic.mechanism.closures else 0.9
    q = np.tile(elastic.q, (COUNT, 1))
    q[:, moved] += size * rng.uniform(-1.0, 1.0, (COUNT, len(moved)))
    return elastic, q


@pytest.mark.parametrize(
    ("name", "load"),
    # What lines pull along the self-motion of the panda is balanced under a load alone.
    [("ur5", None), ("ur5", LOAD), ("panda", LOAD), ("6-ups", LOAD), ("3-rps", None)],
)
def test_lines_on_chains_are_on_the_tape(name, load):
    elastic, q = with_lines(name)
    assert not cartstiff.record(elastic, "pose", loaded=load is not None).taken.untraced
    assert_the_engines(elastic, q, "portable", "compiled", wrench=load)


def test_a_cable_is_slack_in_some_of_the_postures_and_taut_in_others():
    """Else the tests above would not see what decides it."""
    elastic, q = with_lines("ur5")
    cable = elastic.potentials[0]
    lengths = [cable.geometry(elastic.mechanism.at(row)).lengths[0] for row in q]
    assert 5 < np.count_nonzero(np.array(lengths) < cable.rest_length) < COUNT - 5
    assert_the_engines(replace(elastic, potentials=elastic.potentials[1:]), q, "portable")


def test_springs_with_rest_positions_and_lines_make_a_wrench():
    elastic, q = with_lines("ur5")
    assert_the_engines(elastic.with_springs(rest=q[0]), q, "portable")


def test_a_line_between_points_that_meet_is_left_to_the_engine():
    """Its direction does not exist, and the engine says so."""
    elastic, q = with_lines("ur5")
    T = elastic.mechanism.at(q[0]).pose
    meeting = line(("world", "body"), (T[:3, 3], [0, 0, 0]), 1e3, 0.1)
    elastic = replace(elastic, potentials=(meeting,))
    fast, engine = (analyse_many(elastic, q, path=path) for path in ("portable", "engine"))
    assert fast.fallback == 1
    assert fast.counts() == engine.counts() == {"regular": COUNT - 1, "zero-length-line": 1}


def test_a_program_has_them_too():
    elastic, q = with_lines("ur5")
    program = cartstiff.record(elastic, ["A", "B", "K", "energy"], loaded=True)
    answer, engine = program(q[3], LOAD), cartstiff.analyse(elastic, q[3], wrench=LOAD)
    assert answer.is_plain
    for letter in "ABK":
        K = engine.matrices[letter]
        np.testing.assert_allclose(answer[letter], K, rtol=0, atol=1e-12 * np.abs(K).max())
    assert answer.energy == pytest.approx(engine.energy, rel=1e-13)
