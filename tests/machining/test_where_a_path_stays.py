"""Ranges and a posture nearby: what a path keeps to, and what it says."""

from dataclasses import replace

import numpy as np
import pytest
from tests.machining import planar
from tests.support import (
    absolute_error,
    refused,
)
from tests.support.printed import text_of
from tests.view.test_report import HEAVY

import cartstiff
from cartstiff import InputError, ToolPath, optimise_path
from cartstiff.core.errors import UndefinedError, UnknownNameError

POINTS = np.column_stack([np.linspace(0.45, 0.3, 3), np.linspace(0.2, 0.35, 3)])
#: How far from a posture its neighbours may turn.
QUARTER = 0.5 * np.pi
PATH = ToolPath(planar.poses(POINTS, 0.0), [0, 0, 0, -40.0, 25.0, 0], axes="world")


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
    assert absolute_error(found.q, posture) <= QUARTER + 1e-12
    assert found.to_dict()["configuration"]["near"] == QUARTER
    assert "within 90 deg" in found.configuration


def heavy_arm():
    """An arm of the size of a KR210, whose joints turn by 183 deg, at a usual posture."""
    wide = HEAVY.replace("lower='-2' upper='2'", "lower='-3.2' upper='3.2'")
    arm = cartstiff.load(f"{wide}</robot>", stiffness=1e6)
    return replace(arm, q=np.array([0.0, -0.4, 0.5, 0.0, 0.6, 0.0]))


@pytest.mark.parametrize("free", ["none", "x"])
def test_a_path_begins_near_the_posture(free):
    """The stiffest way is backwards over the head, which nobody wants who did not ask for it."""
    arm = heavy_arm()
    poses = np.repeat(arm.mechanism.at(arm.q).pose[None], 5, axis=0)
    poses[:, 1, 3] += np.linspace(-0.2, 0.2, 5)
    path = ToolPath(poses, [0, 0, 0, 0, 0, -1000.0], axes="world")
    best = optimise_path(arm, path, free=free, samples=12, near="anywhere")
    found = optimise_path(arm, path, free=free, samples=12)
    assert best.worst < found.worst
    assert absolute_error(best.q[0], arm.q) > 1.9
    assert absolute_error(found.q[0], arm.q) <= QUARTER + 1e-9
    said = f"it begins within {np.degrees(absolute_error(found.q[0], arm.q)):.3g} deg"
    assert said in found.configuration
    # The nearest limit, by the joints' own limits.
    away = np.minimum(found.q + 3.2, 3.2 - found.q)
    point, joint = np.unravel_index(np.argmin(away), away.shape)
    limit = found.summary()["nearest_limit"]
    assert (limit["name"], limit["point"]) == (arm.names[joint], point + 1)
    assert limit["distance"] == pytest.approx(away.min())
    text = text_of(found)
    assert f"nearest to a limit: {limit['name']} at point {point + 1}, " in text
    assert f"{np.degrees(away.min()):.4g} deg from it" in text


def test_a_path_that_is_far_begins_at_the_nearest():
    """No posture of the first point is near the arm's: the path is followed all the same."""
    arm = replace(planar.arm(), q=np.array([3.0, 2.5, 2.5]))
    found = optimise_path(arm, PATH, free="z", samples=12)
    assert np.isfinite(found.values).all()


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
    refused(match, optimise_path, planar.arm(), PATH, free="z", samples=12, **options, kind=error)


def test_a_path_keeps_a_margin_and_says_where_it_is_least():
    """Torques by lever arms: -(r x f) about each joint."""
    arm = replace(planar.arm(), efforts={"j1": (-60.0, 50.0), "j2": (-20.0, 20.0), "j3": (-4, 5)})
    keys = {"free": "z", "samples": 24, "near": "anywhere"}
    free = optimise_path(arm, PATH, **keys)
    asked = float(free.margins.min()) + 0.03
    kept = optimise_path(arm, PATH, **keys, ranges={"effort_margin": (asked, 1.0)})
    for found in (free, kept):
        shares = np.zeros(found.q.shape)
        for row, q, pose in zip(shares, found.q, found.poses, strict=True):
            axes = arm.mechanism.at(q).joint_poses([1, 2, 3])[:, :2, 3]
            r, f = pose[:2, 3] - axes, np.array([-40.0, 25.0])
            torque = -(r[:, 0] * f[1] - r[:, 1] * f[0])
            ends = np.array([arm.efforts[name] for name in arm.names])
            row[:] = np.maximum(torque / ends[:, 0], torque / ends[:, 1])
        assert found.margins == pytest.approx(1.0 - shares.max(axis=1), rel=1e-9)
        point, joint = np.unravel_index(np.argmax(shares), shares.shape)
        least = {"name": arm.names[joint], "margin": 1.0 - shares.max(), "point": point + 1}
        assert found.summary()["least_margin"] == pytest.approx(least)
        assert found.to_dict()["margins"] == found.margins.tolist()
        said = f"drives: {least['name']} leaves least of its limit at point {point + 1}"
        assert said in text_of(found)
        assert "effort_margin" in found.to_csv().splitlines()[0]
    assert kept.margins.min() >= asked > free.margins.min()
    assert kept.values.mean() > free.values.mean()
    refused(
        r"only with effort_margin outside 0\.9 to 1",
        optimise_path,
        arm,
        PATH,
        **keys,
        ranges={"effort_margin": (0.9, 1.0)},
        kind=UndefinedError,
    )
    refused(
        "needs the limit of a drive's force",
        optimise_path,
        planar.arm(),
        PATH,
        **keys,
        ranges={"effort_margin": (0.2, 1.0)},
    )


def test_platforms_have_no_ranges():
    platform = cartstiff.load("hexapod")
    path = ToolPath(platform.mechanism.at(platform.q).pose[None], [0, 0, 0, 1, 0, 0])
    refused("are for joints", optimise_path, platform, path, ranges={"x": (0.0, 1.0)})
