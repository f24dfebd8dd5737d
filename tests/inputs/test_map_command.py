"""``cartstiff map``: what it computes and prints, and what it refuses in one line."""

import importlib.util
import json
from pathlib import Path

import numpy as np
import pytest
from tests.support.commands import answer, run

import cartstiff

for _package in ("dask", "matplotlib", "tqdm", "xarray", "zarr"):
    if importlib.util.find_spec(_package) is None:
        pytest.skip(f"{_package} is not installed", allow_module_level=True)

CUBIC = "map cubic --quantity translation_held_min"
GRID = "--grid x=-0.02:0.02:3 --grid yaw=0:0.2:4"


def test_grid_to_file_table_and_picture():
    out = run(CUBIC, GRID, "-o m.zarr -o m.png --best 2")
    assert "12 postures" in out
    assert "translation_held_min   N/m" in out
    assert "Best of translation_held_min [N/m]" in out
    assert Path("m.png").read_bytes()[:4] == b"\x89PNG"

    told = answer(CUBIC, GRID, "-o m.zarr --best 2")
    assert told["schema"] == "cartstiff-map/6"
    assert told["postures"] == 12
    assert told["parts"] == {"total": 1, "computed": 0, "found": 1}
    assert told["states"] == {"regular": 12}
    best = told["best"]["translation_held_min"]
    assert len(best) == 2
    assert best[0]["value"] == told["quantities"]["translation_held_min"]["largest"]
    assert best[0]["value"] >= best[1]["value"]
    K = cartstiff.analyse(cartstiff.load("cubic"), best[0]["q"]).matrices["B"]
    assert K is not None
    assert best[0]["value"] == pytest.approx(np.linalg.eigvalsh(K[3:, 3:])[0], rel=1e-9)


def test_the_command_is_in_the_file():
    from cartstiff.maps import open_map

    run(CUBIC, GRID, "-o m.zarr --world --load 0,0,0,1,0,0 --no-progress")
    command = open_map("m.zarr").attrs["command"]
    assert command.startswith("cartstiff map cubic ")
    for words in (
        "--grid x=-0.02:0.02:3 --grid yaw=0:0.2:4 ",
        "--world",
        "--load 0,0,0,1,0,0",
        "--no-progress",
        "-o m.zarr|--output m.zarr",
    ):
        assert any(word in command for word in words.split("|"))
    # As it stands there it is the same map.
    told = answer(command.removeprefix("cartstiff "))
    assert told["parts"]["computed"] == 0


def test_slices_cut_what_is_listed():
    whole = answer(CUBIC, GRID, "-o m.zarr")
    cut = "--slice yaw=0.2 --best 9"
    part = answer(CUBIC, GRID, "-o m.zarr", cut)
    assert sum(whole["states"].values()) == 12
    assert sum(part["states"].values()) == 3
    rows = part["best"]["translation_held_min"]
    assert len(rows) == 3
    assert {row["q"]["yaw"] for row in rows} == {0.2}


def test_random_postures():
    ranges = [f"--range={n}=-0.01:0.01" for n in ("x", "y", "z")]
    ranges += [f"--range={n}=-0.1:0.1" for n in ("roll", "pitch", "yaw")]
    first = answer(CUBIC, "--random 50", *ranges, "-o a.zarr")
    again = answer(CUBIC, "--random 50", *ranges, "-o b.zarr")
    assert first["quantities"] == again["quantities"]


def test_trajectory_from_csv():
    Path("p.csv").write_text("# a path\ntime, x, yaw\n0, 0.0, 0.0\n0.5, 0.01, 0.1\n")
    told = answer(
        CUBIC,
        "--trajectory p.csv -o t.zarr --best 5 -o p.svg",
    )
    assert told["postures"] == 2
    yaws = sorted(row["q"]["yaw"] for row in told["best"]["translation_held_min"])
    assert yaws == [0.0, 0.1]
    assert Path("p.svg").read_text().startswith("<?xml")


def test_cartesian_grid_in_one_option():
    told = answer(
        "map five-bar --cartesian",
        ["x=0.1:0.2:2 y=0.3:0.35:2"],
        "--free rotation --branches 2 --quantity compliance_translation_free_max -o c.zarr",
    )
    assert told["postures"] == 8
    # The tip's position leaves each arm two elbows.
    assert told["branches"] == {"starts": 25, "legs": 2, "found": 4, "kept": 2}
    assert set(told["states"]) <= {"fewer-than-six-freedoms", "unreachable", "not-assembled"}


def test_quantities_are_listed():
    from cartstiff.extend import QUANTITIES

    out = run("models --quantities")
    for name in QUANTITIES:
        assert f"\n{name} " in f"\n{out}"
    data = json.loads(run("models --quantities --json"))
    assert data["schema"] == "cartstiff-quantities/1"
    assert [quantity["name"] for quantity in data["quantities"]] == list(QUANTITIES)
    assert set(data["quantities"][0]) == {"name", "unit", "description", "asks", "better"}


def test_another_map_s_file_is_left_alone(refused):
    run(CUBIC, GRID, "-o m.zarr")
    line = refused(
        f"map cubic --quantity condition {GRID} -o m.zarr",
        words=("m.zarr", "another map", "quantities differs"),
    )
    assert "translation_held_min" in line
    refused(
        CUBIC,
        "--grid x=-0.02:0.02:4 --grid yaw=0:0.2:4 -o m.zarr",
        words=("x differs",),
    )
    refused(CUBIC, GRID, "--stiffness 5 -o m.zarr", words=("another mechanism",))


def test_the_load_means_what_it_means_to_analyse(refused, tmp_path):
    """Kind, point and axes of the load; another kind is another map."""
    load = "--load 1,2,3,30,0,-100 --world --load-at 0,0,0.1"
    words = f"map ur5 --grid elbow_joint=1.2:1.2:1 --quantity deflection {load} --no-progress -o"
    file = tmp_path / "m.zarr"
    data = answer(words, file, "--load-kind follower")
    assert data["connection"] == "load"
    assert data["load"] == {
        "kind": "follower",
        "at": [0.0, 0.0, 0.1],
        "meaning": "it turns with the body",
    }
    arm = cartstiff.load("ur5")
    q = [1.2 if name == "elbow_joint" else v for name, v in zip(arm.names, arm.q, strict=True)]
    result = cartstiff.analyse(
        arm,
        q,
        wrench=[1, 2, 3, 30, 0, -100],
        load_kind="follower",
        load_at=[0, 0, 0.1],
        load_axes="world",
    )
    moved = np.linalg.solve(result.matrices["A"], result.wrench)
    expected = float(np.linalg.norm(moved[3:]))
    assert data["quantities"]["deflection"]["mean"] == pytest.approx(expected, rel=1e-9)
    assert "load_kind differs" in refused(words, file, "--json")
