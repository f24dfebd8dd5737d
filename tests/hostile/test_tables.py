"""Names of strangers in tables: a spreadsheet runs none of them, and the table is read back."""

import csv
import json
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from tests.doors import csv_rows, csv_text, unsafe_cell
from tests.inner import read_rows, safe_cell
from tests.support.commands import outcome

import cartstiff

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
