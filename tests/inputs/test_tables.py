"""One table for every command: units in the head, semicolons, what is not needed, controllers."""

import numpy as np
import pytest
from tests.doors import Units, csv_rows, csv_text
from tests.identify.campaigns import simulated
from tests.inner import DISPLACEMENT, read_rows, table_text
from tests.inner import measurements_ROTATION as ROTATION
from tests.support.commands import answer, run
from tests.support.pages import postures_in

import cartstiff
from cartstiff import InputError
from cartstiff.identify import read_measurements


def table(tmp_path, text, **keys):
    path = tmp_path / "table.csv"
    path.write_text(text, encoding="utf-8")
    return read_rows(path, "rows", **keys)


@pytest.mark.parametrize(
    "text",
    [
        "a [deg],x [mm],fx [kN],m [N mm]\n90,1500,0.2,3000\n",
        "a [deg];x [mm];fx [kN];m [N mm]\n90,0;1500;0,2;3000\n",
        "a [rad]\tx [m]\tfx\tm [Nm]\n1,5707963267948966\t1,5\t200\t3\n",
        "a (deg),x (\u00b5m),fx (kN),m (N m)\n90,1.5e6,0.2,3\n",
        "# by hand\na [°] , x[cm], fx [N], m [kN*mm]\n 90,150,200, 3\n",
    ],
)
def test_heads_give_units_and_semicolons_decimal_commas(tmp_path, text):
    rows = table(tmp_path, text)
    assert rows.names == ("a", "x", "fx", "m")
    assert np.allclose(rows.values, [[np.pi / 2, 1.5, 200, 3]], rtol=1e-12)


def test_other_round_brackets_belong_to_the_name(tmp_path):
    assert table(tmp_path, "motor (left),x(2) (mm)\n1,2\n").names == ("motor (left)", "x(2)")


def test_tables_have_no_negative_zero():
    text = csv_text(np.array([[-0.0, -1.0]]), ("a", "b"))
    assert text == csv_rows(("a", "b"), [(-0.0, -1)]).replace("0.0", "0")


def test_joints_may_be_called_by_number_and_spreadsheets_say_their_separator(tmp_path):
    text = "sep=;\nq2 [deg];q1 [deg];x\n90;180;3\n"
    assert table(tmp_path, text, joints=("lift", "pan")).names == ("pan", "lift", "x")
    for joints in ((), ("q2", "q1"), ("a", "b", "c")):  # not all of them, or named so themselves
        assert table(tmp_path, text, joints=joints).names == ("q2", "q1", "x")


def test_lengths_come_in_the_mechanism_s_units(tmp_path):
    rows = table(tmp_path, "x [mm],f [N],m [N m]\n1500,2000,3\n", units=Units("cm", "kN"))
    assert np.allclose(rows.values, [[150, 2, 0.3]])


def test_without_names_semicolons_serve_as_well(tmp_path):
    assert table(tmp_path, "1,5;2\n3;4,5\n").values.tolist() == [[1.5, 2], [3, 4.5]]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("a [grad],b\n1,2\n", "line 1: column 'a' has an unknown unit; expected m, dm.*got 'grad'"),
        ("a [deg],a [rad]\n1,2\n", "column named twice"),
        ("a;b\n1,5;2.5\n", "line 2: decimal commas and points in one line"),
        ("a,b\n1,5,2,5\n", "line 2: commas between numbers and in them, it seems; expected semi"),
        ("a;b\n1;2;3\n", "line 2: wrong count; expected 2"),
        ("a;b\n1;x\n", "line 2: not a finite number"),
        ("a [deg]\n", "no rows"),
    ],
)
def test_tables_that_cannot_be_meant(tmp_path, text, words):
    with pytest.raises(InputError, match=words) as caught:
        table(tmp_path, text)
    assert "\n" not in str(caught.value)


def test_what_is_not_needed_is_named_and_slips_are_refused(tmp_path):
    rows = table(tmp_path, "b,free_angle,a\n1,2,3\n")
    layout, values, unused = rows.arranged(("a", "b"), ("time", "a", "b"))
    assert (layout, values.tolist(), unused) == (("a", "b"), [[3, 1]], ("free_angle",))
    for text in ("a,b,tiem\n1,2,3\n", "a,b,fx\n1,2,3\n"):
        with pytest.raises(InputError, match="columns do not fit"):
            table(tmp_path, text).arranged(("a", "b"), ("time", "a", "b", "fx", "fy"))


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
    columns = dict.fromkeys((*DISPLACEMENT, *ROTATION), 1e-9)
    m.write_text(table_text(simulated(elastic, rows, columns), elastic), "utf-8")
    found = answer("identify", *tool, m)["parameters"]
    for entry in found:
        assert not entry["identifiable"] or abs(entry["stiffness"] / 1e4 - 1) < 1e-2, entry
    assert sum(entry["identifiable"] for entry in found) >= 3
    shown = postures_in(c, tuple(f"a{i}" for i in range(1, 7)))
    assert np.allclose(shown.q, read_rows(p, "rows").values[:, :6], atol=1e-12)


def test_what_is_not_needed_is_said_beside_an_answer_and_never_beside_a_refusal(tmp_path):
    path = tmp_path / "poses.csv"
    path.write_text("time,x,y,z,roll,pitch,yaw\n0,0,0,0,0,0,0\n", encoding="utf-8")
    command = "equilibrium cubic --path", path
    assert "not needed here" not in run(*command, code=2)
    answer(*command, "--load 0,0,0,0,0,-1", said="not needed here: time")
