"""Names that command a terminal or turn the direction of text are shown as their escapes."""

import ast
import json
import re
import unicodedata
from pathlib import Path

import numpy as np
import pytest
from tests.doors import printable
from tests.support import serial_model
from tests.support.commands import answer, outcome
from tests.support.pages import source_of, tab_of

import cartstiff
from cartstiff import DeadForce

TITLE, TURN, CSI = "\x1b]0;owned\x07", "\u202e", "\x9b31m"
NAME = f"arm{TITLE}{TURN}{CSI}$\\frac$\u2028"
JOINT = f"j{TURN}1{CSI}"
URDF = f"""<robot name="r"><link name="a"/><link name="b"/><link name="c"/>
<joint name="{JOINT}" type="revolute"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
<joint name="j2" type="revolute"><parent link="b"/><child link="c"/><axis xyz="1 0 0"/>
<origin xyz="0.3 0 0.2"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>"""


@pytest.fixture
def arm(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("arm.urdf").write_text(URDF, encoding="utf-8")
    keys = {
        "kind": "serial",
        "model": "arm.urdf",
        "name": NAME,
        "gravity": [0, 0, -9.81],
        "springs": {JOINT: {"stiffness": 3e4}, "j2": {"stiffness": 2e4}},
    }
    Path("arm.yaml").write_text(json.dumps(keys))
    half = {"radius": "=r", "half_angle": 0.3}
    platform = {
        "kind": "stewart-gough",
        "name": NAME,
        "parameters": {"r": 0.4},
        "layout": {"base": half, "platform": {"radius": 0.3, "half_angle": 0.4}, "height": 0.5},
        "legs": {"stiffness": 1e6, "limits": [0.3, 0.8]},
    }
    Path("platform.yaml").write_text(json.dumps(platform))
    study = {
        "mechanism": "platform.yaml",
        "variables": {"r": [0.4, 0.5]},
        "poses": {"grid": {"z": [-0.1, 0.1, 2]}, "about_home": True},
        "objectives": {NAME: {"quantity": "condition"}},
    }
    Path("study.yaml").write_text(json.dumps(study))
    Path("odd.yaml").write_text(json.dumps(study | {"variables": {NAME: [0.4, 0.5]}}))
    return "arm.yaml"


def harmless(text):
    """Nothing that a terminal obeys, nothing that turns the direction of text."""
    return not [c for c in text if c not in "\n\t" and unicodedata.category(c) in ("Cc", "Cf")]


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("shoulder_pan é 关节 🦾\n\tx", "shoulder_pan é 关节 🦾\n\tx"),
        ("\x1b]0;x\x07", r"\x1b]0;x\x07"),
        ("a\u202eb\u2066c\x9b", r"a\u202eb\u2066c\x9b"),
        ("\x7f\r\udcff", r"\x7f\r\udcff"),
    ],
)
def test_escapes(text, shown):
    assert printable(text) == shown


@pytest.mark.parametrize(
    "words",
    [
        "analyse arm.yaml",
        "analyse arm.yaml --full",
        "analyse arm.yaml --q 1,2,3",
        ["analyse", "arm.yaml", "--frame", f"x{TITLE}"],
        ["analyse", f"x{TITLE}"],
        "analyse arm.yaml --json",
        "equilibrium arm.yaml --load 0,0,0,0,0,1",
        "equilibrium arm.yaml --load 0,0,0,0,0,1 --curve",
        "map arm.yaml --random 3",
        "modes arm.yaml",
        "modes arm.yaml -o out.csv",
        "frames arm.yaml",
        "identify arm.yaml --plan 3 --force 50 --sd d=0.005mm",
        "assemble platform.yaml --all",
        "workspace platform.yaml --directions 20 --scan 4",
        ["analyse", "platform.yaml", "--set", f"r{TURN}=1"],
        "design study.yaml -o out.csv",
        "design odd.yaml",
        "models",
    ],
)
def test_no_command_reaches_a_terminal(arm, words):
    code, out, line = outcome(words)
    assert code in (0, 2), line
    assert harmless(out + line)
    assert out + line


def test_json_holds_the_names_themselves(arm):
    Path("arm.urdf").write_text(URDF.replace(JOINT, "j\x7f1"))
    Path("arm.yaml").write_text("kind: serial\nmodel: arm.urdf\n")
    assert answer("analyse", arm)["mechanism"]["joints"][0] == "j\x7f1"


def test_tables_and_pictures(arm):
    from cartstiff import load_curve

    elastic = cartstiff.load(arm)
    curve = load_curve(elastic, DeadForce([0, 0, -1.0]))
    assert harmless(curve.to_csv())
    assert r"j\u202e1\x9b31m" in curve.to_csv().splitlines()[0]
    for ending in ("svg", "png", "pdf"):  # a name is no formula either
        code, _, line = outcome(
            f"equilibrium {arm} --load 0,0,0,0,0,-1 --curve 1 -o curve.{ending}"
        )
        assert code == 0, line
    assert harmless(Path("curve.svg").read_text(encoding="utf-8"))


def test_the_page_is_told_escapes():
    names = [JOINT, "\x7f", "\\u202e", "\\", "🦾", '"', "é\n", "\\\u202e"]
    model = serial_model(len(names) * "R", np.random.default_rng(0))
    for i, name in enumerate(names, 1):
        model.names[i] = name
    packed = tab_of(source_of(cartstiff.load(model, frame="tip"))).hello(1).pack()
    text = json.loads(packed[4 : 4 + int.from_bytes(packed[:4], "big")])
    told = [one["name"] for one in text["mechanism"]["coordinates"]]
    assert told == [printable(JOINT), r"\x7f", "\\u202e", "\\", "🦾", '"', "é\n", "\\\\u202e"]


def test_an_exported_page_has_a_harmless_title(arm):
    code, _, error = outcome("export", arm, "-o page.html")
    assert code == 0, error
    text = Path("page.html").read_text(encoding="utf-8")
    (title,) = re.findall("<title>(.*?)</title>", text)
    assert harmless(title)
    assert "owned" in title


def test_a_file_whose_name_is_no_text(arm):
    """A name of a file is bytes, of which some are no UTF-8."""
    name = b"\xff\x1b[1m.urdf".decode("utf-8", "surrogateescape")
    Path(name).write_text(URDF, encoding="utf-8")
    for words in (["analyse", name], ["export", name, "-o", "page.html"]):
        code, out, line = outcome(words)
        assert code == 0, line
        assert harmless(out)


def test_every_command_writes_through_one_place():
    folder = Path(cartstiff.__file__).parent / "cli"
    for path in folder.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call) and path.name != "output.py":
                called = ast.unparse(node.func)
                assert called not in ("print", "click.echo", "click.secho"), f"{path}: {called}"


BROKEN = "a\nNotes\n  [forged] x\ty\x1b"


@pytest.mark.parametrize(
    "words",
    [
        "analyse arm.yaml",
        "analyse arm.yaml --analysis full",
        "equilibrium arm.yaml --load 0,0,0,0,0,1",
        "equilibrium arm.yaml --load 0,0,0,0,0,1 --curve 1",
        "equilibrium arm.yaml --path path.csv --load 0,0,0,0,0,1",
        "map arm.yaml --random 3 --best 1 --quantity condition -o m.zarr",
    ],
)
def test_a_name_ends_no_line(arm, words):
    """A name of several lines could put a line of its own, a note say, into a report."""
    joint = "j1\nNotes\t"
    text = URDF.replace(JOINT, joint.replace("\n", "&#10;").replace("\t", "&#9;"))
    Path("arm.urdf").write_text(text)
    springs = {joint: {"stiffness": 1e4}, "j2": {"stiffness": 1e4}}
    keys = json.loads(Path(arm).read_text()) | {"name": BROKEN, "springs": springs}
    Path(arm).write_text(json.dumps(keys))
    Path("path.csv").write_text("1,0.2\n1.1,0.3\n")
    code, out, line = outcome(words)
    assert code == 0, line
    lines = (out + line).splitlines()
    assert not [x for x in lines if x.startswith(("  [forged]", "Notes\t")) or "\t" in x]
    assert r"a\nNotes\n  [forged] x\ty\x1b" in out or r"j1\nNotes\t" in out


def test_a_name_ends_no_line_of_a_short_form(arm):
    elastic = cartstiff.load(arm)
    object.__setattr__(elastic, "name", BROKEN)
    result = cartstiff.analyse(elastic)
    for shown in (elastic, result, cartstiff.equilibrium(elastic, DeadForce([0, 0, -1.0]))):
        assert r"a\nNotes\n  [forged] x\ty\x1b" in repr(shown)
        assert repr(shown).count("\n") < 6
