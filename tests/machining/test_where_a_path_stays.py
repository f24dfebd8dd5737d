"""Ranges and a posture nearby: what a path keeps to, and what it says."""

from __future__ import annotations

import numpy as np
import pytest
from tests.machining import planar

import cartstiff
from cartstiff import InputError, ToolPath, optimise_path
from cartstiff.errors import UnknownNameError
from cartstiff.toolpaths.optimise import NEARBY

POINTS = np.column_stack([np.linspace(0.45, 0.3, 3), np.linspace(0.2, 0.35, 3)])
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


def test_platforms_have_no_ranges():
    platform = cartstiff.load("hexapod")
    path = ToolPath(platform.mechanism.at(platform.q).pose[None], [0, 0, 0, 1, 0, 0])
    with pytest.raises(InputError, match="are for joints"):
        optimise_path(platform, path, ranges={"x": (0.0, 1.0)})
