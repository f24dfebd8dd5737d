"""A mechanism follows a hand: it arrives where it can, and says what stops it where it cannot."""

import numpy as np
import pytest
from tests.doors import numerics
from tests.inner import Follower, browser_program
from tests.laws.test_many_rigid import held

import cartstiff
from cartstiff.geometry import se3

#: A hand moves so far between two pictures.
STEP = np.array([0.03, -0.02, 0.04, 0.02, 0.01, -0.015])


@pytest.mark.parametrize("name", ["ur5", "panda", "cubic", "hexapod"])
def test_it_arrives_and_stays_near(name):
    elastic = cartstiff.load(name)
    T = elastic.mechanism.at(elastic.q).pose @ se3.exp(STEP * 0.5)
    found = Follower(elastic).follow(elastic.q, T)
    assert found.reached
    assert found.stopped == ()
    assert np.allclose(
        elastic.mechanism.at(found.q).pose, T, atol=10 * numerics.CONSTRAINT_TOLERANCE
    )
    assert np.abs(found.q - elastic.q).max() < 0.5


def test_a_joint_s_limit_stops_it_and_is_named():
    elastic = cartstiff.load("panda")
    follower, q = Follower(elastic), elastic.q
    T = elastic.mechanism.at(q).pose.copy()
    for _ in range(12):  # away from the base, further than the arm is long
        T[0, 3] += 0.12
        found = follower.follow(q, T)
        q = found.q
    assert not found.reached
    assert found.distance > 0.1
    coordinates = {c.name: c for c in elastic.mechanism.coordinates}
    for name, x in zip(elastic.names, q, strict=True):
        c = coordinates[name]
        assert c.lower <= x <= c.upper
        assert (name in found.stopped) == (min(x - c.lower, c.upper - x) < 1e-6)


def test_a_leg_s_limit_stops_a_platform_on_the_straight_way():
    elastic = cartstiff.load("hexapod")
    platform = elastic.mechanism
    T = platform.at(elastic.q).pose.copy()
    T[2, 3] += 5.0
    found = Follower(elastic).follow(elastic.q, T)
    lengths = platform.leg_lengths(found.q)
    assert not found.reached
    assert lengths.max() <= platform.limits[:, 1].max()
    assert lengths.max() == pytest.approx(platform.limits[:, 1].max(), rel=2e-3)
    assert found.stopped
    assert all(name.startswith("leg") for name in found.stopped)
    assert found.q[:2] == pytest.approx(elastic.q[:2], abs=1e-9)


def test_a_closed_chain_of_two_freedoms_follows_in_its_plane():
    elastic = cartstiff.load("five-bar")
    T = elastic.mechanism.at(elastic.q).pose.copy()
    T[:2, 3] += [0.01, -0.02]
    found = Follower(elastic).follow(elastic.q, T, turning=False)
    pose = elastic.mechanism.closed(found.q).pose
    assert np.allclose(pose[:3, 3], T[:3, 3], atol=1e-6)


def test_a_page_without_a_server_says_why_it_does_not_compute():
    elastic = held("panda", 2)
    assert "a rigid joint" in browser_program(elastic, cartstiff.analyse(elastic))
