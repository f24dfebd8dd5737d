"""Trajectory and map files."""

from __future__ import annotations

import sys
import types

import numpy as np
import pytest
from tests.support.commands import run
from tests.support.pages import clouds_in, points_of_workspace, postures_in

from cartstiff import InputError
from cartstiff.extend import in_units

NAMES = ("a", "b")


@pytest.fixture
def csv(tmp_path):
    def write(text: str):
        path = tmp_path / "path.csv"
        path.write_text(text, encoding="utf-8")
        return path

    return write


@pytest.mark.parametrize(
    ("text", "q", "time", "timed"),
    [
        ("1,2\n3,4\n", [[1, 2], [3, 4]], [0, 1], False),
        ("# a comment\n\n 1 , 2 \n", [[1, 2]], [0], False),
        ("b,a\n1,2\n", [[2, 1]], [0], False),
        ("time,a,b\n0,1,2\n0.5,3,4\n", [[1, 2], [3, 4]], [0, 0.5], True),
        ("T,b,a\n0,1,2\n", [[2, 1]], [0], True),
        ("0,1,2\n2,3,4\n", [[1, 2], [3, 4]], [0, 2], True),
    ],
)
def test_trajectories(csv, text, q, time, timed):
    found = postures_in(csv(text), NAMES)
    assert found.q.tolist() == q
    assert found.time.tolist() == time
    assert found.timed is timed


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "file is empty"),
        ("# nothing\n", "no postures"),
        ("a,c\n1,2\n", "line 1: columns do not fit; expected a, b"),
        ("a,a\n1,2\n", "line 1: column named twice"),
        ("1,2\n3\n", "line 2: wrong count; expected 2"),
        ("1\n", r"wrong count; expected 2 numbers \(a, b\), or 3 numbers \(time, a, b\), got 1"),
        ("1,2\n3,x\n", "line 2: not a finite number"),
        ("1,nan\n", "finite"),
        ("1,2\n3,1e31\n", "number is too large"),
        ("1,0,0\n0,0,0\n", "times must not decrease"),
    ],
)
def test_refused_trajectories(csv, text, words):
    with pytest.raises(InputError, match=words):
        postures_in(csv(text), NAMES)


def test_missing_files(tmp_path):
    with pytest.raises(InputError, match=r"nothing\.csv"):
        postures_in(tmp_path / "nothing.csv", NAMES)


class _Variable:
    def __init__(self, values, units=None):
        self.values = np.asarray(values)
        self.shape, self.dtype = self.values.shape, self.values.dtype
        self.attrs = {} if units is None else {"units": units}


class _Data(dict):
    @property
    def data_vars(self):
        return self


@pytest.fixture
def opened(monkeypatch):
    """A map file without one: what its reader returns."""
    data = _Data()
    reading = types.ModuleType("cartstiff.wings.maps.reading")
    reading.map_of_mechanism = lambda path, elastic: (data, [])  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "cartstiff.wings.maps.reading", reading)
    return data


@pytest.fixture(scope="module")
def ur5():
    import cartstiff

    return cartstiff.load("ur5")


def test_a_map(opened, ur5, tmp_path):
    opened["position"] = _Variable(np.arange(24.0).reshape(2, 4, 3), "m")
    opened["softest"] = _Variable(np.arange(8.0).reshape(2, 4), "N/m")
    opened["reachable"] = _Variable(np.ones((2, 4), bool))
    opened["matrix"] = _Variable(np.zeros((2, 4, 6, 6)))
    found = clouds_in(tmp_path / "map", ur5)
    assert found.positions.shape == (8, 3)
    assert list(found.values) == ["softest", "reachable"]
    assert found.units == {"softest": "N/m", "reachable": ""}
    assert found.thinned == 1


def test_a_map_without_positions_is_refused(opened, ur5, tmp_path):
    with pytest.raises(InputError, match="holds no positions"):
        clouds_in(tmp_path / "map", ur5)
    opened["position"] = _Variable(np.zeros((4, 3)), "m")
    with pytest.raises(InputError, match="map cannot be shown"):
        clouds_in(tmp_path / "map", ur5)


def test_a_real_map_with_places_out_of_reach(tmp_path):
    """Five places along a line of which the last two are beyond the arm."""
    import cartstiff
    from cartstiff.maps import Axis, CartesianGrid, compute_map, open_map

    arm = cartstiff.load("five-bar")
    posture = arm.mechanism.closed(arm.q)
    x = float(posture.pose[0, 3])
    grid = CartesianGrid({"x": Axis(x, x + 40.0, 3)}, arm, posture.q, starts=0, branches=1)
    compute_map(arm, grid, ["force"], tmp_path / "m.zarr")
    whole = open_map(tmp_path / "m.zarr")
    cloud = clouds_in(tmp_path / "m.zarr", arm)
    finite = np.isfinite(whole["position"].values.reshape(-1, 3)).all(axis=1)
    assert 0 < len(cloud.positions) == finite.sum() < finite.size
    assert list(cloud.values) == ["force"]
    assert np.array_equal(cloud.positions, whole["position"].values.reshape(-1, 3)[finite])
    assert cloud.q is not None
    for q, place in zip(cloud.q, cloud.positions, strict=True):
        assert np.allclose(arm.mechanism.at(q).pose[:3, 3], place, atol=1e-9)
    with pytest.raises(InputError, match="--map: is the map of another mechanism; expected ur5"):
        clouds_in(tmp_path / "m.zarr", cartstiff.load("ur5"))
    heavier = clouds_in(tmp_path / "m.zarr", arm.with_springs(3.0))
    assert list(heavier.values) == ["force, map of other springs"]


def test_points_of_a_map_bring_their_postures(tmp_path):
    import cartstiff
    from cartstiff.maps import Grid, compute_map

    arm = cartstiff.load("ur5")
    grid = Grid({"shoulder_pan_joint": (-1, 1, 3), "elbow_joint": (0.5, 1.5, 3)}, arm.names, arm.q)
    compute_map(arm, grid, ["minimum"], tmp_path / "m.zarr")
    known = clouds_in(tmp_path / "m.zarr", arm)
    assert known.q is not None
    assert len(known.q) == 9
    for q, place in zip(known.q, known.positions, strict=True):
        assert np.allclose(arm.mechanism.at(q).pose[:3, 3], place, atol=1e-9)
    compute_map(in_units(arm, "mm"), grid, ["minimum"], tmp_path / "mm.zarr")
    found = clouds_in(f"file://{tmp_path}/mm.zarr", arm)
    np.testing.assert_allclose(found.positions, known.positions, atol=1e-12)


def test_a_boundary_of_a_workspace(tmp_path):
    """What `workspace -o` writes, in the units of the file or in others."""
    import cartstiff
    from cartstiff import workspace

    hexapod = cartstiff.load("hexapod")
    reached = workspace(hexapod, directions=20, scan=6, fits=False)
    path = tmp_path / "boundary.csv"
    run("workspace hexapod --directions 20 --scan 6 -o", path)
    cloud = clouds_in(path, hexapod)
    assert cloud.positions == pytest.approx(reached.boundary, abs=1e-12)
    words = cloud.values["limit that cuts"].tolist()
    cuts = reached.positions.limit.tolist()
    # In kinds, whichever leg it is.
    low, high = hexapod.mechanism.bounds["leg1"]
    kinds = {"most": f"legs at most {high:.4g} m", "least": f"legs at least {low:.4g} m"}
    assert words == [kinds[cut.rpartition(" ")[2]] for cut in cuts]
    path.write_text("x [mm],y [mm],z [mm],limit\n1,2,3,reach\n", encoding="utf-8")
    assert clouds_in(path, hexapod).positions.tolist() == [[0.001, 0.002, 0.003]]
    path.write_text("z [m],roll [rad],pitch [rad],limit\n1,2,3,reach\n", encoding="utf-8")
    with pytest.raises(InputError, match="boundary cannot be shown"):
        clouds_in(path, hexapod)
    path.write_text("x [m],y [m],z [m],limit\n1,2,three,reach\n", encoding="utf-8")
    with pytest.raises(InputError, match=r"line 2.*not a finite number"):
        clouds_in(path, hexapod)


@pytest.mark.parametrize("name", ["hexapod", "delta"])
def test_a_workspace_is_coloured_by_stiffness_first(name):
    """Of a platform, turned, and of a body on legs that are made of joints."""
    import cartstiff

    machine = cartstiff.load(name)
    turn = [0, 0, 0, 0.1, -0.05, 0.2] if name == "hexapod" else [0.0] * len(machine.q)
    q = machine.q + np.array(turn)
    reached = cartstiff.workspace(machine, q, directions=60, scan=12, fits=False)
    cloud = points_of_workspace(reached)
    assert list(cloud.values) == ["softest stiffness", "limit that cuts"]
    assert len(set(cloud.values["limit that cuts"].tolist())) <= 5
    assert cloud.better == {"softest stiffness": "larger"}
    assert np.isnan(cloud.values["softest stiffness"][len(reached.boundary) :]).all()
    known = cloud.values["softest stiffness"]
    assert np.isnan(known[cloud.values["limit that cuts"] == "singularity"]).all()
    assert np.nanmin(known) > 1e-6 * np.nanmax(known)
    known_at = np.flatnonzero(np.isfinite(known))
    assert len(known_at) > 0.7 * len(reached.boundary)
    for i in known_at[::9]:
        found = cartstiff.analyse(machine, cloud.q[i])
        assert found.pose[:3, 3] == pytest.approx(cloud.positions[i], abs=1e-9)
        assert found.pose[:3, :3] == pytest.approx(reached.pose[:3, :3], abs=1e-9)
        C = found.tangent_compliance[3:, 3:]
        least = 1.0 / np.linalg.eigvalsh(0.5 * (C + C.T))[-1]
        assert known[i] == pytest.approx(least, rel=1e-6)


def test_limits_are_few_kinds(ur5, tmp_path):
    words = [f"leg{i}_slide, {side}" for i in range(1, 7) for side in ("least", "most")]
    words += ["reach", "singularity", "half turn", "force of leg3, most", "joint 7, least"]
    rows = "\n".join(f'1,2,3,"{word}"' for word in words)
    (tmp_path / "b.csv").write_text(f"x [m],y [m],z [m],limit\n{rows}\n", encoding="utf-8")
    cloud = clouds_in(tmp_path / "b.csv", ur5)
    kinds = set(cloud.values["limit that cuts"].tolist())
    assert len(kinds) == 5
    assert {"legs slide at least", "legs slide at most", "other limits"} <= kinds


def test_a_workspace_of_tilts_is_no_cloud_of_positions():
    import cartstiff

    legs = {
        "chain": "RPS",
        "stiffness": 1e7,
        "limits": [0.5, 0.75],
        "base": {"radius": 0.3},
        "platform": {"radius": 0.2},
    }
    machine = cartstiff.parallel(legs, [0, 0, 0.6, 0, 0, 0])
    reached = cartstiff.workspace(machine, directions=8, scan=6, fits=False)
    with pytest.raises(InputError, match="takes all positions, got z, roll, pitch"):
        points_of_workspace(reached)
