"""Rigid joints on the tape: the motions are those of the others, as the engine has them."""

from __future__ import annotations

import numpy as np
import pytest
from tests.laws.test_many_engine import assert_same
from tests.support import refused

import cartstiff
from cartstiff import analyse_many
from cartstiff.maps import RandomPostures, compute_map, open_map

pytest.importorskip("llvmlite")

LOAD = (1.0, 2.0, -3.0, 20.0, -10.0, 40.0)
COUNT = 40


def held(name: str, *joints: int, gravity: bool = False) -> cartstiff.ElasticMechanism:
    """A mechanism some joints of which are rigid; springs of the others differ."""
    elastic = cartstiff.load(name)
    stiffness = np.array(elastic.springs.stiffness) * np.linspace(0.7, 1.3, elastic.q.size)
    stiffness[list(joints)] = np.inf
    elastic = elastic.with_springs(stiffness=stiffness)
    return elastic.with_gravity().with_payload(2.0, (0.05, 0.0, 0.1)) if gravity else elastic


def about(elastic: cartstiff.ElasticMechanism, away: float) -> np.ndarray:
    """Random postures about the mechanism's own, its motors moved."""
    rng, n = np.random.default_rng(4), elastic.q.size
    moved = [
        j for j in getattr(elastic.mechanism, "held", ()) if j not in elastic.mechanism.virtual
    ] or list(range(n))
    q = np.tile(elastic.q, (COUNT, 1))
    q[:, moved] += away * rng.uniform(-1.0, 1.0, (COUNT, len(moved)))
    return q


def assert_the_engines(elastic, q, *paths, **load):
    """Numbers and states are the engine's, and none came from there; the answers."""
    answers = assert_same(elastic, q, *paths, **load)
    assert [found.fallback for found in answers] == [0] * len(answers)
    return answers


#: Every load with and without weight on an arm that keeps six freedoms, each once on the others.
LOADS = ({}, {"wrench": LOAD}, {"wrench": LOAD, "load_axes": "world"})
ARMS = [("panda", (2,), "regular", gravity, load) for gravity in (False, True) for load in LOADS]
ARMS += [
    (name, joints, "fewer-than-six-freedoms", load in LOADS[1:], load)
    for name, joints in (("ur5", (2,)), ("ur5", (0, 4)), ("xarm7", (1, 5)))
    for load in LOADS
]


@pytest.mark.parametrize(("name", "joints", "state", "gravity", "load"), ARMS)
def test_arms_give_the_engines_answers(name, joints, state, gravity, load):
    elastic = held(name, *joints, gravity=gravity)
    for found in assert_the_engines(elastic, about(elastic, 0.8), **load):
        assert found.counts() == {state: COUNT}


@pytest.mark.parametrize(
    ("name", "joints", "load"),
    [
        ("6-ups", (2,), {"wrench": LOAD}),
        ("6-ups", (2, 11, 17), {}),
        ("3-rps", (1,), {}),
        ("3-rps", (1,), {"wrench": LOAD}),
        ("five-bar", (0,), {}),
        ("five-bar", (0,), {"wrench": LOAD}),
        ("delta", (0, 11), {}),
        # The forearms carry little.
        ("delta", (0, 11, 22), {"wrench": 0.02 * np.array(LOAD)}),
    ],
)
def test_motors_of_closed_chains_give_the_engines_answers(name, joints, load):
    elastic = held(name, *joints)
    assert set(joints) <= set(elastic.mechanism.held)
    assert_the_engines(elastic, about(elastic, 0.05), **load)


def test_rest_positions_of_the_others_are_kept():
    elastic = held("panda", 2)
    names = [n for n in elastic.spring_names if n != elastic.names[2]]
    rest = {name: elastic.q[elastic.names.index(name)] + 0.05 for name in names}
    elastic = elastic.with_springs(rest=rest)
    assert_the_engines(elastic, about(elastic, 0.1), "compiled")


def test_where_rank_is_lost_they_are_not_counted():
    """An elbow that is stretched and rigid leaves five motions, four where a wrist is, too."""
    elastic = held("ur5", 2)
    q = about(elastic, 0.8)
    q[:20, 4] = 0.0
    assert_the_engines(elastic, q, "compiled", wrench=LOAD)


def test_a_passive_joint_of_a_closed_chain_is_left_to_the_engine():
    elastic = held("6-ups", 0)
    refused(
        "no motor moves while a closed chain is assembled",
        analyse_many,
        elastic,
        [elastic.q],
        path="compiled",
    )
    assert analyse_many(elastic, [elastic.q]).fallback == 1


def test_nothing_is_left_where_all_joints_are_rigid():
    elastic = held("ur5", *range(6))
    refused("no joint gives", analyse_many, elastic, [elastic.q], path="portable")


def test_frequencies_of_a_map_are_those_of_one_posture(tmp_path):
    elastic = held("xarm7", 3, gravity=True)
    sampling = RandomPostures.within_limits(elastic, 300, seed=2)
    quantities = ["frequency_1", "translation_held_min", "deflection"]
    compute_map(elastic, sampling, quantities, tmp_path / "m.zarr", wrench=LOAD)
    data = open_map(tmp_path / "m.zarr")
    q = data["q"].values
    for i in (3, 77, 200):
        wanted = cartstiff.modes(elastic, q[i], wrench=LOAD).frequencies[0]
        assert float(data["frequency_1"][i]) == pytest.approx(wanted, rel=1e-9)
