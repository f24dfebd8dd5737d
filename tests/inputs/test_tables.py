"""One table for every command: what one writes the next one reads, and what is not needed."""

import csv

import numpy as np
import pytest
from tests.identify.campaigns import simulated
from tests.support.commands import answer, run
from tests.support.pages import postures_in

import cartstiff
from cartstiff.identify import read_measurements

KR = [
    ("z", "0 0 0.33", 3.2),
    ("y", "0.35 0 0.42", 2.4),
    ("y", "0 0 1.25", 3.6),
    ("x", "0.96 0 -0.054", 6.1),
    ("y", "0.54 0 0", 2.1),
    ("x", "0.193 0 0", 6.1),
]


@pytest.fixture(scope="module")
def big_arm(tmp_path_factory):
    """An arm of the size of a KR210, and a seam for it in mm and degrees."""
    folder = tmp_path_factory.mktemp("seam")
    axes = {"x": "1 0 0", "y": "0 1 0", "z": "0 0 1"}
    parts = ["<link name='l0'/>"]
    for i, (axis, at, limit) in enumerate(KR, 1):
        parts.append(
            f"<link name='l{i}'/><joint name='a{i}' type='revolute'><parent link='l{i - 1}'/>"
            f"<child link='l{i}'/><origin xyz='{at}'/><axis xyz='{axes[axis]}'/><limit "
            f"lower='-{limit}' upper='{limit}' effort='1' velocity='1'/></joint>"
        )
    parts.append(
        "<link name='tool0'/><joint name='t' type='fixed'><parent link='l6'/><child link='tool0'/>"
        "<origin xyz='0.0375 0 0' rpy='0 1.57079632679 0'/></joint>"
    )
    arm = folder / "kr.urdf"
    arm.write_text(f"<robot name='kr'>{''.join(parts)}</robot>")
    seam = ["x [mm];y [mm];z [mm];roll [deg];pitch [deg];yaw [deg]"]
    seam += [f"1600;{y},5;900;0;170;0" for y in range(-390, 400, 20)]
    (folder / "seam.csv").write_text("\n".join(seam))
    return arm


def test_a_seam_in_three_commands(big_arm):
    """What one command writes the next one reads."""
    folder = big_arm.parent
    tool = [big_arm, "--tcp", "0,0,0.2"]
    robot = [*tool, "--stiffness", "2e6,2e6,1.5e6,3e5,3e5,2e5"]
    p, c = (folder / name for name in ("p.csv", "c.csv"))
    run("path", *robot, folder / "seam.csv", f"--load 0,0,0,0,0,-300 --world -o {p}")
    more = f"--path {p} -o {c}"
    errors = answer("equilibrium", *robot, more, said="not needed here")["summary"]
    assert errors["before"]["translation_max"] > 1e-4
    assert errors["after"]["translation_max"] < 1e-9

    heads = c.read_text().splitlines()[0].split(",")
    assert {"before_rx [rad]", "before_z [m]", "after_y [m]"} <= set(heads)
    # The loads of a path are along the tool's axes: measured there, they give the springs back.
    elastic, m = cartstiff.load(big_arm, tcp=(0, 0, 0.2)), folder / "m.csv"
    rows = read_measurements(p, elastic, open_cells=True)
    columns = dict.fromkeys(("dx", "dy", "dz", "drx", "dry", "drz"), 1e-9)
    measured = simulated(elastic, rows, columns).values
    with p.open(newline="") as old, m.open("w", newline="") as new:
        head, *lines = csv.reader(old)
        beside = np.column_stack(list(measured.values())).tolist()
        rows = [line + list(map(repr, more)) for line, more in zip(lines, beside, strict=True)]
        csv.writer(new).writerows([[*head, *measured], *rows])
    found = answer("identify", *tool, m, said="along the body's axes")["parameters"]
    for entry in found:
        assert not entry["identifiable"] or abs(entry["stiffness"] / 1e4 - 1) < 1e-2, entry
    assert sum(entry["identifiable"] for entry in found) >= 3
    shown = postures_in(c, tuple(f"a{i}" for i in range(1, 7)))
    assert np.allclose(shown.q, postures_in(p, tuple(f"a{i}" for i in range(1, 7))).q, atol=1e-12)


def test_what_is_not_needed_is_said_beside_an_answer_and_never_beside_a_refusal(tmp_path):
    path = tmp_path / "poses.csv"
    path.write_text("time,x,y,z,roll,pitch,yaw\n0,0,0,0,0,0,0\n", encoding="utf-8")
    command = "equilibrium cubic --path", path
    assert "not needed here" not in run(*command, code=2)
    answer(*command, "--load 0,0,0,0,0,-1", said="not needed here: time")
