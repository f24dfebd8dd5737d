"""Options: what is refused, and that the real process keeps its promises."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[2]
Refused = Callable[..., str]
Accepted = Callable[..., dict[str, Any]]

ARM = """<robot name="arm"><link name="a"/><link name="b"/><link name="c"/>
<joint name="j1" type="revolute"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/>
<origin xyz="0 0 1"/><limit lower="-3" upper="3" effort="1" velocity="1"/></joint>
<joint name="j2" type="prismatic"><parent link="b"/><child link="c"/><axis xyz="0 1 0"/>
<origin xyz="1 0 0"/><limit lower="-3" upper="3" effort="1" velocity="1"/></joint></robot>"""
SIX = "0,0,0,0,0,0"

#: Arguments of `analyse`, and words of the answer.
BAD: dict[str, tuple[list[str], tuple[str, ...]]] = {
    "q too few": (["arm.urdf", "--q", "1"], ("--q", "2 numbers (j1, j2)", "got 1")),
    "q too many": (["arm.urdf", "--q", "1,2,3"], ("--q", "wrong count", "got 3")),
    "q empty": (["arm.urdf", "--q", ""], ("--q", "not a finite number", "''")),
    "q only commas": (["arm.urdf", "--q", ","], ("--q", "not a finite number")),
    "q trailing comma": (["arm.urdf", "--q", "1,2,"], ("--q", "not a finite number")),
    "q NaN": (["arm.urdf", "--q", "1,nan"], ("--q", "finite", "'nan'")),
    "q infinite": (["arm.urdf", "--q", "1,-inf"], ("--q", "finite", "'-inf'")),
    "q beyond numbers": (["arm.urdf", "--q", "1,1e999"], ("--q", "finite", "'1e999'")),
    "q too large": (["arm.urdf", "--q", "1,1e300"], ("--q", "too large", "1e+30", "1e300")),
    "q text": (["arm.urdf", "--q", "1,up"], ("--q", "'up'")),
    "q underscore": (["arm.urdf", "--q", "1,1_0"], ("--q", "'1_0'")),
    "q hexadecimal": (["arm.urdf", "--q", "1,0x1"], ("--q", "'0x1'")),
    "q with spaces": (["arm.urdf", "--q", "1 2"], ("--q", "'1 2'")),
    "q in brackets": (["arm.urdf", "--q", "[1,2]"], ("--q", "'[1'")),
    "q mixed": (["arm.urdf", "--q", "j1=1,2"], ("--q", "mixes", "'2'")),
    "q mixed, number first": (["arm.urdf", "--q", "1,j2=2"], ("--q", "mixes", "'1'")),
    "q unknown joint": (["arm.urdf", "--q", "j3=1"], ("--q", "unknown joint", "j1", "'j3'")),
    "q no name": (["arm.urdf", "--q", "=1"], ("--q", "unknown joint", "''")),
    "q no value": (["arm.urdf", "--q", "j1="], ("--q j1", "a number", "''")),
    "q two values": (["arm.urdf", "--q", "j1=1=2"], ("--q j1", "a number", "'1=2'")),
    "q joint twice": (["arm.urdf", "--q", "j1=1,j1=2"], ("--q", "twice", "'j1'")),
    "q twice": (["arm.urdf", "--q", "1,2", "--q", "1,2"], ("--q", "more than once")),
    "q of a platform too few": (["cubic", "--q", "1,2,3"], ("--q", "6 numbers (x, y", "got 3")),
    "q without value": (["arm.urdf", "--q"], ("--q", "requires an argument")),
    "pose of an arm": (["arm.urdf", "--pose", SIX], ("--pose", "platforms", "q for serial")),
    "pose and q": (["cubic", "--pose", SIX, "--q", SIX], ("--q or --pose",)),
    "pose of five": (["cubic", "--pose", "0,0,0,0,0"], ("--pose", "6 numbers", "got 5")),
    "pose NaN": (["cubic", "--pose", "0,0,0,0,0,nan"], ("--pose", "'nan'")),
    "pose twice": (["cubic", "--pose", SIX, "--pose", SIX], ("--pose", "more than once")),
    "load of five": (["arm.urdf", "--load", "0,0,0,0,0"], ("--load", "6 numbers", "got 5")),
    "load of seven": (["arm.urdf", "--load", SIX + ",0"], ("--load", "6 numbers", "got 7")),
    "load empty": (["arm.urdf", "--load", ""], ("--load", "''")),
    "load NaN": (["arm.urdf", "--load", "0,0,0,0,0,nan"], ("--load", "'nan'")),
    "load text": (["arm.urdf", "--load", "0,0,0,0,0,1N"], ("--load", "'1N'")),
    "load too large": (["arm.urdf", "--load", "0,0,0,0,0,1e308"], ("--load", "1e+30")),
    "load with names": (["arm.urdf", "--load", "fz=1"], ("--load", "'fz=1'")),
    "load and rest": (["arm.urdf", "--load", SIX, "--rest", "0,0"], ("--load or --rest",)),
    "load twice": (["arm.urdf", "--load", SIX, "--load", SIX], ("--load", "more than once")),
    "rest too few": (["arm.urdf", "--rest", "0"], ("--rest", "2 numbers", "got 1")),
    "rest NaN": (["arm.urdf", "--rest", "0,nan"], ("--rest", "'nan'")),
    "rest unknown joint": (["arm.urdf", "--rest", "j3=0"], ("--rest", "'j3'")),
    "rest length negative": (["cubic", "--rest", "leg2=-1"], ("--rest", "zero or more", "-1")),
    "rest of an unknown leg": (["cubic", "--rest", "leg7=1"], ("--rest", "leg6", "'leg7'")),
    "stiffness negative": (
        ["arm.urdf", "--stiffness", "-1"],
        ("--stiffness", "zero or more", "-1"),
    ),
    "one stiffness negative": (["arm.urdf", "--stiffness", "1,-1"], ("--stiffness", "got -1")),
    "stiffness NaN": (["arm.urdf", "--stiffness", "nan"], ("--stiffness", "'nan'")),
    "stiffness too large": (["arm.urdf", "--stiffness", "1e308"], ("--stiffness", "1e+30")),
    "stiffness too small": (["arm.urdf", "--stiffness", "1e-308"], ("--stiffness", "too small")),
    "stiffness too many": (["arm.urdf", "--stiffness", "1,2,3"], ("--stiffness", "got 3")),
    "stiffness unknown joint": (["arm.urdf", "--stiffness", "j3=1"], ("--stiffness", "'j3'")),
    "stiffness twice": (
        ["arm.urdf", "--stiffness", "1", "--stiffness", "2"],
        ("--stiffness", "more than once"),
    ),
    "leg stiffness zero": (["cubic", "--stiffness", "0"], ("--stiffness", "above zero", "got 0")),
    "one leg stiffness zero": (["cubic", "--stiffness", "leg3=0"], ("--stiffness", "above zero")),
    "frame unknown": (["arm.urdf", "--frame", "d"], ("unknown frame", "'d'")),
    "frame of other case": (["ur5", "--frame", "TOOL0"], ("unknown frame", "'TOOL0'")),
    "frame close": (["ur5", "--frame", "tool"], ("unknown frame", "closest: tool0", "'tool'")),
    "frame empty": (["arm.urdf", "--frame", ""], ("unknown frame", "''")),
    "frame of the base": (["arm.urdf", "--frame", "a"], ("no joint moves", "'a'")),
    "frame of a platform": (["cubic", "--frame", "tool0"], ("unknown frame", "platform")),
    "frame twice": (["arm.urdf", "--frame", "c", "--frame", "c"], ("--frame", "more than once")),
    "output to nowhere": (
        ["arm.urdf", "-o", "none/result.json"],
        ("none/result.json", "no such folder"),
    ),
    "output to a folder": (["arm.urdf", "-o", "folder.json"], ("folder.json", "directory")),
    "output below a file": (["arm.urdf", "-o", "arm.urdf/x.json"], ("arm.urdf/x.json",)),
    "output of another kind": (
        ["arm.urdf", "-o", "result.txt"],
        ("--output", ".npz", "result.txt"),
    ),
    "output without ending": (["arm.urdf", "--output", "result"], ("--output", ".json")),
    "output without name": (["arm.urdf", "-o", ""], ("--output", ".json")),
    "output too long": (["arm.urdf", "-o", "x" * 5000 + ".json"], ("File name too long",)),
    "unknown option": (["arm.urdf", "--posture", "1"], ("--posture",)),
    "unknown short option": (["arm.urdf", "-x"], ("-x",)),
    "flag with a value": (["arm.urdf", "--json=yes"], ("--json",)),
    "no mechanism": ([], ("MECHANISM",)),
    "two mechanisms": (["arm.urdf", "ur5"], ("ur5",)),
    "mechanism empty": ([""], ("no name",)),
    "mechanism blank": (["  "], ("no name",)),
    "mechanism unknown": (["stewart"], ("unknown mechanism", "stewart-gough", "'stewart'")),
    "mechanism far too long": (["x" * 100_000], ("File name too long",)),
    "mechanism a folder": (["."], ("is a directory",)),
    "mechanism at no home": (["~nosuchuser/arm.urdf"], ("home directory",)),
    "mechanism of lines": (["a\nb\x1b[31m"], ("unknown mechanism",)),
    "mechanism an option": (["--", "--json"], ("unknown mechanism", "'--json'")),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_options_are_refused(case: str, refused: Refused) -> None:
    Path("arm.urdf").write_text(ARM, encoding="utf-8")
    Path("folder.json").mkdir()
    arguments, words = BAD[case]
    refused("analyse", *arguments, words=words)


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        ([], "--help"),
        (["analyze", "ur5"], "analyze"),
        (["--json"], "--json"),
        (["ur5"], "ur5"),
        (["models", "ur5"], "ur5"),
        (["models", "--all"], "--all"),
        (["--versions"], "--versions"),
    ],
)
def test_bad_commands_are_refused(arguments: list[str], word: str, refused: Refused) -> None:
    refused(*arguments, words=(word,))


def test_output_is_not_touched_by_a_refusal(refused: Refused) -> None:
    Path("arm.urdf").write_text(ARM, encoding="utf-8")
    Path("result.json").write_text("old", encoding="utf-8")
    refused("analyse", "arm.urdf", "--q", "1", "-o", "result.json")
    assert Path("result.json").read_text(encoding="utf-8") == "old"


# -- what must not be refused ---------------------------------------------------------------------


@pytest.mark.parametrize(
    "text", ["0.5,-1", " 0.5 , -1.0 ", "5e-1,-1", "j1=0.5,j2=-1", "j2=-1, j1=+.5"]
)
def test_ways_to_write_q(text: str, accepted: Accepted) -> None:
    Path("arm.urdf").write_text(ARM, encoding="utf-8")
    assert accepted("arm.urdf", "--q", text)["q"] == [0.5, -1.0]


def test_values_that_begin_with_a_minus(accepted: Accepted) -> None:
    Path("arm.urdf").write_text(ARM, encoding="utf-8")
    data = accepted("arm.urdf", "--q", "-1,-2", "--load=-1,0,0,0,0,-2")
    assert data["q"] == [-1.0, -2.0]


def test_some_joints_by_name_leave_the_others(accepted: Accepted) -> None:
    expected = accepted("ur5")["q"]
    expected[2] = 0.25
    assert accepted("ur5", "--q", "elbow_joint=0.25")["q"] == expected


def test_one_stiffness_serves_all_joints(accepted: Accepted) -> None:
    Path("arm.urdf").write_text(ARM, encoding="utf-8")
    one = accepted("arm.urdf", "--stiffness", "50")
    each = accepted("arm.urdf", "--stiffness", "j1=50,j2=50.0")
    assert one["compliance"] == each["compliance"]
    assert "stiffness-assumed" not in [note["code"] for note in one["notes"]]


@pytest.mark.parametrize("ending", ["json", "npz"])
def test_output_holds_the_result(ending: str, accepted: Accepted, workplace: Path) -> None:
    data = accepted("cubic", "-o", f"a b.{ending}")
    assert [p.name for p in workplace.iterdir()] == [f"a b.{ending}"]
    if ending == "json":
        assert json.loads(Path("a b.json").read_text(encoding="utf-8")) == data
    else:
        with np.load("a b.npz") as arrays:
            assert arrays["K_A"].tolist() == data["stiffness"]["A"]


# -- the real process -----------------------------------------------------------------------------


def process(*arguments: str, **options: Any) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "PYTHONPATH": str(ROOT / "src"), **options.pop("env", {})}
    environment.pop("CARTSTIFF_TRACEBACK", None)
    return subprocess.run(
        [sys.executable, "-m", "cartstiff", *arguments],
        text=True,
        timeout=300,
        check=False,
        env=environment,
        **{"capture_output": True, **options},
    )


CRASHERS = {
    # Each makes one of the parsers below print, throw, or recurse when it is given to it raw.
    "no.urdf": ARM.replace('name="arm"', ""),
    "dynamics.urdf": ARM.replace('<axis xyz="0 0 1"/>', '<axis xyz="0 0"/><dynamics damping="x"/>'),
    "ring.urdf": ARM.replace('<link name="c"/>', "").replace('"c"', '"a"'),
    "joint.xml": '<mujoco><worldbody><body><joint type="x"/></body></worldbody></mujoco>',
    "deep.yaml": "a: " + "[" * 5000,
    "deep.urdf": "<robot name='r'>" + "<link>" * 20_000 + "</link>" * 20_000 + "</robot>",
}


@pytest.mark.parametrize("name", CRASHERS)
def test_process_refuses_in_one_line(name: str, workplace: Path) -> None:
    Path(name).write_text(CRASHERS[name], encoding="utf-8")
    done = process("analyse", name)
    assert done.returncode == 2
    assert done.stdout == ""
    assert done.stderr.startswith("cartstiff: ")
    assert name in done.stderr
    assert done.stderr.count("\n") == 1
    assert [p.name for p in workplace.iterdir()] == [name]


def test_process_prints_nothing_but_json(workplace: Path) -> None:
    text = ARM.replace(
        '<link name="a"/>',
        '<link name="a"><visual><geometry><mesh filename="x"/></geometry></visual></link>',
    )
    Path("arm.urdf").write_text(text, encoding="utf-8")
    done = process("analyse", "arm.urdf", "--json")
    assert (done.returncode, done.stderr) == (0, "")
    assert json.loads(done.stdout)["mechanism"]["name"] == "arm"


def test_process_with_closed_or_full_streams() -> None:
    reader, writer = os.pipe()
    os.close(reader)
    try:
        done = process(
            "analyse",
            "cubic",
            "--json",
            capture_output=False,
            stdout=writer,
            stderr=subprocess.PIPE,
        )
    finally:
        os.close(writer)
    assert (done.returncode, done.stderr) == (0, "")
    if Path("/dev/full").exists():
        with Path("/dev/full").open("w") as full:
            done = process(
                "analyse",
                "cubic",
                "--json",
                capture_output=False,
                stdout=full,
                stderr=subprocess.PIPE,
            )
        assert done.returncode == 2
        assert done.stderr == "cartstiff: No space left on device\n"


def test_process_where_text_is_ascii() -> None:
    Path("Größe.urdf").write_text(ARM, encoding="utf-8")
    done = process("analyse", "Größe.urdf", env={"PYTHONIOENCODING": "ascii"})
    assert (done.returncode, done.stderr) == (0, "")
    assert "serial, body frame" in done.stdout


def test_joints_that_are_still_assumed_are_named(accepted: Accepted) -> None:
    Path("arm.urdf").write_text(ARM, encoding="utf-8")

    def note(*options: str) -> dict[str, Any] | None:
        notes = accepted("arm.urdf", *options)["notes"]
        return next((n for n in notes if n["code"] == "stiffness-assumed"), None)

    every, one = note(), note("--stiffness", "j2=50")
    assert every is not None
    assert every["values"]["joints"] == ["j1", "j2"]
    assert one is not None
    assert one["values"]["joints"] == ["j1"]
    assert "10000 N m/rad" in one["message"]
    assert "taken for j1 and" in one["message"]
    assert note("--stiffness", "j2=50,j1=40") is None
    assert note("--stiffness", "50") is None


@pytest.mark.parametrize(
    ("command", "old", "new"),
    [
        ("analyse", "--command", "--actuate"),
        ("analyse", "--at", "--report-at"),
        ("map", "--deflect", "--added-load"),
        ("map", "--deflect-at", "--added-load-at"),
        ("analyse", "--explain", "--profile"),
    ],
)
def test_an_option_that_was_renamed_says_its_name(
    refused: Refused, command: str, old: str, new: str
) -> None:
    refused(command, "ur5", old, "1", words=(f"{old} is called {new} now",))
