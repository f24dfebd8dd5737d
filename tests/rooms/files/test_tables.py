"""Tables: heads give units, and names of strangers are run by no spreadsheet and read back."""

import csv
import json
import math
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from tests.doors import Units, csv_rows, csv_text, unsafe_cell
from tests.inner import head_of, read_rows, safe_cell
from tests.support.commands import outcome

import cartstiff
from cartstiff import InputError

FORMULAS = [
    "=1+1",
    "=cmd|' /C calc'!A0",
    "+cmd|' /C calc'!A0",
    "-cmd|' /C calc'!A0",
    "-2+3+cmd|' /C calc'!A0",
    "@SUM(1+1)*cmd|' /C calc'!A0",
    "\t=1+1",
    "\r=1+1",
    "\n=1+1",
    "x\n=1+1",
    "x,=1+1",
    "x;=1+1",
    'x";=1+1',
    '",=1+1,"',
    " =1+1",
    "x,\t@y",
    '=HYPERLINK("http://localhost","x")',
]


def cells(text):
    """Every cell that a spreadsheet may see: by commas, semicolons or tabs, quoted or not."""
    found = []
    for separator in ",;\t":
        for row in csv.reader(text.splitlines(), delimiter=separator):
            found += row
        for line in text.splitlines():
            found += [cell.strip('"') for cell in line.split(separator)]
    return found


def runs(cell):
    """Whether a spreadsheet would take a cell for a formula."""
    if not cell.strip(" ").startswith(("=", "+", "-", "@", "\t", "\r")):
        return False
    return bool(re.search(r"[A-Za-df-z]|1\+1", cell))


@pytest.mark.parametrize("name", FORMULAS)
def test_no_cell_is_a_formula(name):
    numbers = csv_text(np.array([[-1.0, 2.0]]), [name, "b"])
    for text in (numbers, csv_rows([name], [[name], [-1.5]])):
        assert not any(map(runs, cells(text))), text


@pytest.mark.parametrize("word", ["x [mm]", "-1.5", "+2e-3", "(0, -0.1, 2)", "a-b", "a=b", "-"])
def test_numbers_and_plain_words_stay(word):
    assert safe_cell(word) == word


def test_a_table_is_read_back(tmp_path):
    names = ("=a", "-b", "+c [mm]", "@d")
    file = tmp_path / "t.csv"
    file.write_text(csv_text(np.array([[1.0, -2.0, 3.0, 4.0]]), names))
    rows = read_rows(file, "postures")
    assert rows.names is not None
    assert [name.split(" ")[0] for name in rows.names] == ["=a", "-b", "+c", "@d"]
    assert unsafe_cell(safe_cell("x;=y")) == "x;=y"


URDF = (
    "<robot name='r'><link name='l0'/><link name='l1'/><link name='l2'/>"
    "<joint name=\"=cmd|'x'!A0\" type='revolute'><parent link='l0'/><child link='l1'/>"
    "<axis xyz='0 1 0'/><origin xyz='0 0 .3'/><limit lower='-3' upper='3' effort='1' velocity='1'/>"
    "</joint><joint name='@b' type='prismatic'><parent link='l1'/><child link='l2'/>"
    "<axis xyz='0 0 1'/><limit lower='0' upper='1' effort='1' velocity='1'/></joint></robot>"
)


@pytest.mark.parametrize(
    "command",
    [
        "equilibrium r.urdf --load 0,0,0,1,0,0 --curve 1 -o out.csv",
        "equilibrium r.urdf --load 0,0,0,1,0,0 --path q.csv -o out.csv",
        "modes r.urdf --response 1:50 -o out.csv",
        "identify r.urdf --plan 2 --mass 5 --sd d=1mm -o out.csv",
    ],
)
def test_files_of_commands(tmp_path, monkeypatch, command):
    monkeypatch.chdir(tmp_path)
    inertia = "<inertia ixx='1' iyy='1' izz='1' ixy='0' ixz='0' iyz='0'/>"
    heavy = f"<inertial><mass value='1'/>{inertia}</inertial></link>"
    text = URDF
    for name in ("l1", "l2"):
        text = text.replace(f"<link name='{name}'/>", f"<link name='{name}'>{heavy}")
    Path("r.urdf").write_text(text)
    Path("q.csv").write_text("0.1,0.2\n0.2,0.3\n")
    code, _, error = outcome(command)
    assert code == 0, error
    text = Path("out.csv").read_text()
    assert not any(map(runs, cells(text))), text


def test_the_page_writes_the_same():
    """Its function against ours, on the same names."""
    node = shutil.which("node")
    if node is None:
        pytest.skip("needs node")
    source = (Path(cartstiff.__file__).parent / "shown/page/static/plotfiles.js").read_text()
    (made,) = re.findall(r"^export (const safeCell = .*?;)$", source, re.MULTILINE | re.DOTALL)
    words = [name for name in FORMULAS if not set(name) & set("\t\r\n")]
    words += ["-1.5", "(0, -0.1, 2)", "-"]
    shown = f"console.log(JSON.stringify({json.dumps(words)}.map(safeCell)))"
    script = f"{made} {shown}"
    done = subprocess.run([node, "-e", script], capture_output=True, text=True, check=True)
    assert json.loads(done.stdout) == [safe_cell(" ".join(word.split(" "))) for word in words]


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


def test_heads_of_tables():
    for unit, factor in (("N m/arcmin", 10800 / math.pi), ("Nm/deg", 180 / math.pi)):
        for head in (f"k [{unit}]", f"k ({unit})"):
            assert head_of(head, "here") == ("k", "torsional stiffness", pytest.approx(factor))
    assert head_of("k [N/um]", "here") == ("k", "stiffness", pytest.approx(1e6))
