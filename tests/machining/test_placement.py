"""Where to put the workpiece: against brute force over the grid, and what is said of the rest."""

import importlib.util

import numpy as np
import pytest
from tests.machining import planar

from cartstiff import InputError, ToolPath, UndefinedError, best_placement
from cartstiff.toolpaths.placement import workpiece_pose

FORCE = np.array([-40.0, 25.0])
# A short seam in the workpiece's frame.
SEAM = np.column_stack([np.zeros(4), np.linspace(-0.06, 0.06, 4)])
XS, YS = np.linspace(0.3, 1.2, 4), np.linspace(-0.2, 0.2, 3)
LOOSE = {"free": "z", "max_step": 100.0, "singular": 1e-3, "smoothness": 0.0, "samples": 12}


def seam(axes="world"):
    return ToolPath(planar.poses(SEAM), [0, 0, 0, *FORCE, 0], axes=axes)


def by_hand(place):
    """Worst deflection over the seam, one side of the elbow, on the grid of the free angle."""
    yaws = -np.pi + 2 * np.pi * np.arange(12) / 12
    points = SEAM + np.array(place)
    q = np.array([planar.inverse(x, y, yaws).reshape(-1, 3) for x, y in points])
    length = planar.arm().mechanism.at(planar.arm().q).length
    cost = planar.deflection(q, FORCE)
    cost = np.where(planar.ratio(np.nan_to_num(q), length) >= 1e-3, cost, np.inf)
    cost = np.where(np.isfinite(cost), cost, np.inf)
    sides = [np.where(np.sign(q[..., 1]) == s, cost, np.inf).min(axis=1).max() for s in (1, -1)]
    return min(sides)


@pytest.fixture(scope="module")
def found():
    return best_placement(planar.arm(), seam(), {"y": YS, "x": XS}, halvings=3, **LOOSE)


def test_every_place_of_the_grid(found):
    assert list(found.axes) == ["x", "y"]
    expected = np.array([[by_hand((x, y)) for y in YS] for x in XS])
    reachable = np.isfinite(expected)
    assert 0 < reachable.sum() < reachable.size
    np.testing.assert_array_equal(np.isfinite(found.worst), reachable)
    np.testing.assert_allclose(found.worst[reachable], expected[reachable], rtol=1e-9)


def test_places_that_cannot_be_used_are_named(found):
    unusable = np.isnan(found.worst)
    assert set(found.codes[unusable]) == {"path-unreachable"}
    assert set(found.codes[~unusable]) == {""}
    assert np.all((found.points > 0) == unusable)
    assert found.counts() == {"path-unreachable": int(unusable.sum())}


def test_search_around_the_best(found):
    assert found.path.worst <= np.nanmin(found.worst)
    assert all(found.axes[n][0] <= v <= found.axes[n][-1] for n, v in found.place.items())
    moved = SEAM + np.array([found.place["x"], found.place["y"]])
    np.testing.assert_allclose(found.path.poses[:, :2, 3], moved, atol=1e-9)


def test_dataset(found):
    pytest.importorskip("xarray")
    data = found.to_dataset()
    assert data["worst"].dims == ("x", "y")
    assert data["worst"].attrs["units"] == "m"
    best = float(data["worst"].min())
    assert best == pytest.approx(float(np.nanmin(found.worst)))
    assert str(data["code"].sel(x=XS[-1], y=YS[0], method="nearest").item()) == "path-unreachable"


def test_plain_data(found):
    data = found.to_dict()
    assert data["schema"] == "cartstiff/1"
    shape = tuple(len(values) for values in data["axes"].values())
    worst = np.array([np.nan if v is None else v for v in data["worst"]]).reshape(shape)
    np.testing.assert_array_equal(worst, found.worst)
    assert len(data["codes"]) == len(data["points"]) == worst.size


@pytest.mark.skipif(importlib.util.find_spec("matplotlib") is None, reason="needs matplotlib")
def test_pictures(found):

    figure = found.plot()
    (mesh,) = figure.axes[0].collections
    assert np.ma.count(mesh.get_array()) == np.isfinite(found.worst).sum()
    figure = found.path.plot()
    assert len(figure.axes) == 2


def test_loads_of_the_workpiece_turn_with_it():
    """A turned workpiece whose load turns with it, against one whose load does not."""
    arm, yaw = planar.arm(), 0.6
    place = {"x": [0.5], "y": [0.1], "yaw": [yaw]}
    turning = best_placement(arm, seam("path"), place, **LOOSE)
    T = workpiece_pose({"x": 0.5, "y": 0.1, "yaw": yaw})
    points = (T @ planar.poses(SEAM))[:, :2, 3]
    np.testing.assert_allclose(turning.path.poses[:, :2, 3], points, atol=1e-9)
    force = T[:2, :2] @ FORCE
    expected = planar.deflection(turning.path.q, force)
    np.testing.assert_allclose(turning.path.values, expected, rtol=1e-9)
    still = best_placement(arm, seam("world"), place, **LOOSE)
    expected = planar.deflection(still.path.q, FORCE)
    np.testing.assert_allclose(still.path.values, expected, rtol=1e-9)


def test_no_place_at_all():
    match = r"none of the 2 places.*2 path-unreachable"
    with pytest.raises(UndefinedError, match=match) as refusal:
        best_placement(planar.arm(), seam(), {"x": [2.0, 3.0]}, **LOOSE)
    assert refusal.value.code == "no-placement"


@pytest.mark.parametrize(
    ("region", "match"),
    [
        ({}, "region needs a coordinate"),
        ({"roll": [0.0]}, "unknown coordinate"),
        ({"x": [1.0, 0.0]}, "must rise"),
        ({"x": []}, "wrong count; expected one or more"),
        ({"x": [np.nan]}, "must be finite"),
        ({"x": ["a"]}, "not numeric"),
    ],
)
def test_regions_that_are_none(region, match):
    with pytest.raises(InputError, match=match):
        best_placement(planar.arm(), seam(), region)


def test_progress_is_told():
    told = []
    best_placement(
        planar.arm(),
        seam(),
        {"x": [0.5, 0.6]},
        halvings=0,
        refine=False,
        progress=lambda done, total: told.append((done, total)),
        **LOOSE,
    )
    assert told == [(1, 2), (2, 2)]
