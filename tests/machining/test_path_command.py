"""``cartstiff path``: what it accepts and what it writes."""

import csv
import importlib.util
import json

import numpy as np
import pytest
from tests.support.commands import answer, run

import cartstiff

needs_plots = pytest.mark.skipif(
    importlib.util.find_spec("matplotlib") is None, reason="matplotlib is not installed"
)
LOAD = ("--load", "0,0,0,50,0,-50")
QUICK = ("--samples", "12")


@pytest.fixture
def seam(tmp_path):
    """Three poses of the hexapod, which needs no example robots."""
    T = cartstiff.load("hexapod")
    x, y, z = T.mechanism.at(T.q).pose[:3, 3]
    file = tmp_path / "seam.csv"
    rows = [f"{x + d},{y},{z},0,0,0" for d in (-0.02, 0.0, 0.02)]
    file.write_text("# a seam\n" + "\n".join(rows) + "\n", encoding="utf-8")
    return file


def test_report(seam):
    text = run("path hexapod", seam, *LOAD, "--free-axis z", *QUICK)
    assert "3 points" in text
    assert "displacement of the frame's origin under the given wrench, smaller" in text
    assert "rotation about the body's z axis" in text
    assert "best constant" in text
    assert "K^B unloaded" in text
    assert "angles count by the characteristic length 349.98 mm" in text
    assert "-0.00000" not in text


def test_json_and_csv_agree(seam, tmp_path):
    file = tmp_path / "postures.csv"
    data = json.loads(
        run("path hexapod", seam, *LOAD, "--free-axis z", *QUICK, f"--json -o {file}")
    )
    assert data["schema"] == "cartstiff/1"
    with file.open(encoding="utf-8") as handle:
        rows = [
            {name.partition(" [")[0]: value for name, value in row.items()}
            for row in csv.DictReader(handle)
        ]
    assert len(rows) == len(data["q"]) == 3
    q = [[float(row[name]) for name in data["joints"]] for row in rows]
    np.testing.assert_array_equal(q, data["q"])
    assert [float(row["deflection"]) for row in rows] == data["values"]
    assert [float(row["free_angle"]) for row in rows] == data["angles"]
    assert data["summary"]["worst"] == max(data["values"])
    assert data["summary"]["constant"]["worst"] >= data["summary"]["worst"]


def test_columns_by_name(seam, tmp_path):
    """The same path with the load in the file, in another order, and by the tool's axis alone."""
    base = answer("path hexapod", seam, *LOAD, "--free-axis z", *QUICK)
    rows = [line.split(",") for line in seam.read_text(encoding="utf-8").splitlines()[1:]]
    named = tmp_path / "named.csv"
    lines = ["fx,fy,fz,mx,my,mz,x,y,z,roll,pitch,yaw"]
    lines += [",".join(["50", "0", "-50", "0", "0", "0", *row]) for row in rows]
    named.write_text("\n".join(lines), encoding="utf-8")
    again = answer(f"path hexapod {named} --free-axis z", *QUICK)
    assert again["values"] == base["values"]
    axes = tmp_path / "axes.csv"
    lines = ["x,y,z,ax,ay,az", *(",".join([*row[:3], "0", "0", "2"]) for row in rows)]
    axes.write_text("\n".join(lines), encoding="utf-8")
    again = answer("path hexapod", axes, *LOAD, "--world --free-axis z", *QUICK)
    assert again["values"] == pytest.approx(base["values"], rel=1e-9)
    assert (base["load_axes"], again["load_axes"]) == ("path", "world")
    lines = ["x,y,z,ax,ay,az,fx_world,fy_world,fz_world"]
    lines += [",".join([*row[:3], "0", "0", "2", "50", "0", "-50"]) for row in rows]
    axes.write_text("\n".join(lines), encoding="utf-8")
    assert answer("path hexapod", axes, "--free-axis z", *QUICK)["values"] == again["values"]
    text = run("path hexapod", axes, "--free-axis z", *QUICK)
    assert "Loads along the axes of the room" in text
    twelve = tmp_path / "twelve.csv"
    lines = [",".join([*row, "0", "0", "0", "50", "0", "-50"]) for row in rows]
    twelve.write_text("\n".join(lines), encoding="utf-8")
    again = answer(f"path hexapod {twelve} --free-axis z", *QUICK)
    assert again["values"] == base["values"]


def test_stiffness_along_a_direction(seam):
    data = answer(
        f"path hexapod {seam} --criterion along_free --direction 0,0,1 --axes world "
        "--stiffness 1e6",
    )
    assert data["criterion"]["unit"] == "N/m"
    platform = cartstiff.load("hexapod").with_springs(1e6)
    C = cartstiff.analyse(platform, data["q"][1]).compliances["B"]
    assert data["values"][1] == pytest.approx(1 / C[5, 5], rel=1e-6)


def test_the_worst_point_or_the_mean(seam):
    """Each objective's path is the better one by its own measure; both keep the same candidates."""
    asked = ["path hexapod", seam, *LOAD, "--free-axis z", *QUICK, "--objective"]
    worst, mean = (answer(*asked, name) for name in ("worst", "mean"))
    assert worst["summary"]["worst"] == max(worst["values"]) <= max(mean["values"]) * (1 + 1e-9)
    assert sum(mean["values"]) <= sum(worst["values"]) * (1 + 1e-9)


@needs_plots
def test_pictures(seam, tmp_path):
    picture = tmp_path / "k.png"
    run("path hexapod", seam, *LOAD, "--free-axis z", *QUICK, f"-o {picture}")
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_path_that_cannot_be_followed(tmp_path):
    file = tmp_path / "path.csv"
    file.write_text("0,0,50,0,0,0\n", encoding="utf-8")
    error = run("path hexapod", file, *LOAD, code=3)
    assert "path-beyond-limits: point 1 of the path is reached only beyond the limits: leg" in error


def test_eight_cables_have_a_ratio_of_singular_values(tmp_path):
    """Eight cables have no square Jacobian: how near a singularity is shows in their lines."""
    (tmp_path / "path.csv").write_text("x,y,z,roll,pitch,yaw\n0,0,0.6,0,0,0\n0.05,0,0.6,0,0,0\n")
    out = run(
        "path cable-robot",
        tmp_path / "path.csv",
        "--criterion translation_held_min --json",
    )
    shown = json.loads(out)
    cables = cartstiff.load("cable-robot").mechanism
    for q, ratio in zip(shown["q"], shown["ratios"], strict=True):
        lines = cables.at(q).lines.lines / ([cables.length] * 3 + [1, 1, 1])
        values = np.linalg.svd(lines, compute_uv=False)
        assert ratio == pytest.approx(values[-1] / values[0], rel=1e-9)


def test_a_load_acts_at_its_point_without_load_stiffening(seam):
    """Its moment about M counts in the deflection by the unloaded stiffness as well."""
    wrench, at = np.array([0.0, 0, 0, 50, 0, -50]), np.array([0.0, 0.1, 0.2])
    data = answer(
        "path hexapod", seam, *LOAD, "--load-at 0,0.1,0.2 --axes body --free-axis z", *QUICK
    )
    wrench[:3] = np.cross(at, wrench[3:])
    platform = cartstiff.load("hexapod")
    for q, value in zip(data["q"], data["values"], strict=True):
        C = cartstiff.analyse(platform, q).compliances["B"]
        assert value == pytest.approx(np.linalg.norm((C @ wrench)[3:]))
