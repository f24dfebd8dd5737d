"""Ranges, a posture nearby, and links that collide: what a path keeps to, and what it says."""

from __future__ import annotations

import numpy as np
import pytest
from tests.machining import planar

import cartstiff
from cartstiff import InputError, ToolPath, UndefinedError, optimise_path
from cartstiff.errors import UnknownNameError
from cartstiff.loading.collisions import Collisions
from cartstiff.toolpaths.optimise import NEARBY

POINTS = np.column_stack([np.linspace(0.45, 0.3, 3), np.linspace(0.2, 0.35, 3)])
PATH = ToolPath(planar.poses(POINTS, 0.0), [0, 0, 0, -40.0, 25.0, 0], axes="world")
BASE, HAND = 0.2, 0.15


def collision(radius: float) -> str:
    return f"<collision><geometry><sphere radius='{radius}'/></geometry></collision>"


def urdf(first: str = collision(BASE), last: str = collision(HAND)) -> str:
    """The planar arm, with a ball around its base and one around its third joint."""
    links = [first, "", "", last, ""]
    text = "".join(f"<link name='l{i}'>{shape}</link>" for i, shape in enumerate(links))
    for i, at in enumerate([0.0, *planar.LENGTHS]):
        kind = "revolute" if i < 3 else "fixed"
        text += (
            f"<joint name='j{i + 1}' type='{kind}'><parent link='l{i}'/><child link='l{i + 1}'/>"
            f"<origin xyz='{at} 0 0'/><axis xyz='0 0 1'/>"
            "<limit lower='-3' upper='3' effort='1' velocity='1'/></joint>"
        )
    return f"<robot name='planar'>{text}</robot>"


def arm(text: str = ""):
    return cartstiff.load(text or urdf(), frame="l4", stiffness=[900.0, 700.0, 300.0])


def wrist(q: np.ndarray) -> np.ndarray:
    """Distance of the third joint from the base."""
    return np.linalg.norm(planar.positions(q)[..., 2, :], axis=-1)


def test_collisions_are_those_of_two_balls():
    q = np.random.default_rng(3).uniform(-3.0, 3.0, (300, 3))
    found = Collisions(arm())(q)
    assert found.any()
    assert np.array_equal(found, wrist(q) < BASE + HAND)


def test_links_that_touch_at_the_default_posture_are_left_out_and_named():
    robot = arm(urdf(first=collision(0.5), last=collision(0.5)))
    tested = Collisions(robot)
    assert tested.pairs == 0
    assert tested.left_out == ("l0 - l3",)
    assert "l0 - l3" in tested.message


def test_a_path_without_collisions():
    robot = arm(urdf(first=collision(0.36)))
    inside = optimise_path(robot, PATH, free="z", samples=24, max_step=3.0)
    outside = optimise_path(
        robot, PATH, free="z", samples=24, max_step=3.0, collisions=Collisions(robot)
    )
    assert (wrist(inside.q) < 0.36 + HAND).any()
    assert (wrist(outside.q) >= 0.36 + HAND).all()
    assert outside.worst >= inside.worst
    assert outside.to_dict()["collisions"]["checked"] is True
    assert inside.to_dict()["collisions"]["checked"] is False
    assert "not checked" in inside.to_dict()["collisions"]["message"]


def test_a_point_that_collides_in_every_posture():
    with pytest.raises(UndefinedError, match="links collide") as refusal:
        optimise_path(
            arm(),
            ToolPath(planar.poses(np.array([[0.35, 0.0]]), 0.0), [0, 0, 0, 1, 0, 0]),
            collisions=Collisions(arm()),
        )
    assert refusal.value.code == "path-colliding"


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_ranges_choose_the_elbow(sign):
    found = optimise_path(
        planar.arm(), PATH, free="z", samples=24, ranges={"j2": tuple(sorted((0.0, sign * 3.1)))}
    )
    assert (sign * found.q[:, 1] >= 0.0).all()
    assert found.to_dict()["configuration"]["kept"] is True


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_near_a_posture(sign):
    posture = np.array([0.2, sign * 1.8, -sign * 1.0])
    found = optimise_path(planar.arm(), PATH, free="z", samples=24, near=posture)
    assert np.abs(found.q - posture).max() <= NEARBY + 1e-12
    assert found.to_dict()["configuration"]["near"] == NEARBY
    assert "within 90 deg" in found.configuration


def test_progress_comes_to_its_end():
    steps = []
    optimise_path(
        planar.arm(), PATH, free="z", samples=12, progress=lambda *done: steps.append(done)
    )
    assert [done for done, _ in steps] == list(range(1, len(steps) + 1))
    assert steps[-1][0] == steps[-1][1]


@pytest.mark.parametrize(
    ("options", "error", "match"),
    [
        ({"ranges": {"j9": (0.0, 1.0)}}, UnknownNameError, "j9"),
        ({"ranges": {"j1": (4.0, 5.0)}}, InputError, "range of j1"),
        ({"near": {"j1": 9.0}}, InputError, "neighbourhood of j1"),
        ({"near": [0.0, 0.0]}, InputError, "posture nearby"),
    ],
)
def test_what_is_refused(options, error, match):
    with pytest.raises(error, match=match):
        optimise_path(planar.arm(), PATH, free="z", samples=12, **options)


@pytest.mark.parametrize(
    ("text", "match"),
    [
        (urdf("", ""), "no shapes"),
        (
            urdf(first="<collision><geometry><mesh filename='no.stl'/></geometry></collision>"),
            "no.stl is missing",
        ),
    ],
)
def test_robots_whose_collisions_are_not_known(text, match):
    with pytest.raises(InputError, match=match):
        Collisions(arm(text))


def test_platforms_have_neither_ranges_nor_collisions():
    platform = cartstiff.load("hexapod")
    with pytest.raises(InputError, match="collisions"):
        Collisions(platform)
    path = ToolPath(platform.mechanism.at(platform.q).pose[None], [0, 0, 0, 1, 0, 0])
    with pytest.raises(InputError, match="are for joints"):
        optimise_path(platform, path, ranges={"x": (0.0, 1.0)})
