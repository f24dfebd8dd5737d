"""Files of paths: along which axes their loads act."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tests.inner import read_path_file
from tests.support import refused

import cartstiff
from cartstiff import ToolPath, optimise_path
from cartstiff.geometry import se3


def test_loads_are_along_axes_that_the_user_knows(tmp_path):
    """Full poses have their own axes; by the tool's axis alone the user names them.

    One deflection, J K^-1 J^T W. The path turns, so that a force along its axes turns with it.
    """
    turns = np.array([0.0, 0.25])
    p = np.array([[0.62, -0.1, 0.3], [0.62, 0.0, 0.3]])
    angles = np.column_stack([0 * turns, 0 * turns, turns])
    load = np.array([0.0, 0.0, 0.0, -80.0, 30.0, 40.0])
    arm = cartstiff.load("ur5").with_springs(2e4)
    along = np.column_stack([np.cos(turns), np.sin(turns), 0 * turns])
    forces, moments = np.tile(load[3:], (2, 1)), np.zeros((2, 3))
    for name, heads, columns in (
        ("angles", "x,y,z,roll,pitch,yaw", (angles,)),
        ("axes", "x,y,z,ax,ay,az", (along,)),
        ("named", "x,y,z,ax,ay,az,fx_world,fy_world,fz_world", (along, forces)),
        ("unnamed", "x,y,z,ax,ay,az,fx,fy,fz", (along, forces)),
        ("mixed", "x,y,z,ax,ay,az,fx_world,fy,fz_world", (along, forces)),
        ("moments", "x,y,z,ax,ay,az,mx_base,my_base,mz_base", (along, moments)),
    ):
        table = np.hstack([p, *columns])
        np.savetxt(tmp_path / f"{name}.csv", table, "%.17g", ",", header=heads, comments="")
    asked = {"free": "x", "direction": None, "units": arm.units}

    def read(name, wrench=None, axes=None):
        return read_path_file(tmp_path / f"{name}.csv", wrench=wrench, axes=axes, **asked)

    own = ToolPath(se3.from_roll_pitch_yaw(p, angles), load)
    room = ToolPath.from_axes(p, along, "x", wrenches=load, axes="world")
    paths = [own, read("angles", load), room, read("axes", load, "world"), read("named")]
    assert [path.axes for path in paths] == ["path", "path", "world", "world", "world"]
    for path in paths:
        turned = np.tile(load, (2, 1))
        if path.axes == "path":
            turned[1, 3:] = Rotation.from_euler("z", turns[1]).apply(load[3:])
        assert path.wrench(1) == pytest.approx(turned[1])
        result = optimise_path(arm, path, samples=4)
        assert result.to_dict()["load_axes"] == path.axes
        for W, q, value in zip(turned, result.q, result.values, strict=True):
            R = np.kron(np.eye(2), arm.mechanism.at(q).pose[:3, :3])
            J = R @ arm.mechanism.at(q).motion.jacobian
            assert value == pytest.approx(np.linalg.norm((J @ J.T @ W)[3:] / 2e4), rel=1e-9)
    refused("axes of the wrenches are not known", ToolPath.from_axes, p, along, "x", wrenches=load)
    refused(
        "axes of the directions are not known",
        ToolPath.from_axes,
        p,
        along,
        "x",
        directions=[0, 0, 1],
    )
    refused(r"not known.*--world.*fx_world", read, "axes", load)
    refused("not known", read, "unnamed")
    refused(r"different axes.*fx_world, fy, fz_world", read, "mixed")
    refused("name other axes; expected body, got world", read, "named", axes="body")
    assert read("moments").wrenches is not None
    drill = [0.0, 0.0, 0.0, -80.0, 0.0, 0.0]  # along the tool's axis, which is known
    assert read("axes", drill).wrench(1)[3:] == pytest.approx(-80.0 * along[1])


def test_loads_along_the_axes_of_the_robots_base(tmp_path):
    """A base that is turned by 90 degrees about z of the room: its x axis is the room's y axis."""
    file = tmp_path / "points.csv"
    file.write_text("x,y,z,roll,pitch,yaw\n0.4,0.1,0.3,0,0.2,0.5\n0.5,0.1,0.3,0,0.2,0.5\n")
    base = se3.pose([[0, -1, 0], [1, 0, 0], [0, 0, 1]], [1.0, 2.0, 3.0])
    given = {"wrench": [1, 2, 3, 4, 5, 6], "direction": [1, 0, 0]}
    path = read_path_file(file, axes="base", base=base, **given)
    for point in range(2):
        assert path.wrench(point) == pytest.approx([-2, 1, 3, -5, 4, 6], abs=1e-15)
        assert path.direction(point) == pytest.approx([0, 1, 0], abs=1e-15)
    rows = ",mx,my,mz,fx,fy,fz\n", ",0,0,0,1,0,0\n", ",0,0,0,0,0,2\n"
    lines = file.read_text().splitlines()
    file.write_text("".join(line + more for line, more in zip(lines, rows, strict=True)))
    path = read_path_file(file, axes="base", base=base)
    assert path.wrench(0) == pytest.approx([0, 0, 0, 0, 1, 0], abs=1e-15)
    assert path.wrench(1) == pytest.approx([0, 0, 0, 0, 0, 2], abs=1e-15)
