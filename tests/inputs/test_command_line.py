"""Options: what is refused, and that the real process keeps its promises."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]

ARM = """<robot name="arm"><link name="a"/><link name="b"/><link name="c"/>
<joint name="j1" type="revolute"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/>
<origin xyz="0 0 1"/><limit lower="-3" upper="3" effort="1" velocity="1"/></joint>
<joint name="j2" type="prismatic"><parent link="b"/><child link="c"/><axis xyz="0 1 0"/>
<origin xyz="1 0 0"/><limit lower="-3" upper="3" effort="1" velocity="1"/></joint></robot>"""

#: Arguments of `analyse`, and words of the answer.
BAD = {
    "output too long": (["arm.urdf", "-o", "x" * 5000 + ".json"], ("File name too long",)),
    "mechanism far too long": (["x" * 100_000], ("File name too long",)),
    "mechanism of lines": (["a\nb\x1b[31m"], ("unknown mechanism",)),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_options_are_refused(case, refused):
    Path("arm.urdf").write_text(ARM, encoding="utf-8")
    Path("folder.json").mkdir()
    arguments, words = BAD[case]
    refused("analyse", arguments, words=words)


def test_output_is_not_touched_by_a_refusal(refused):
    Path("arm.urdf").write_text(ARM, encoding="utf-8")
    Path("result.json").write_text("old", encoding="utf-8")
    refused("analyse", "arm.urdf", "--q", "1", "-o", "result.json")
    assert Path("result.json").read_text(encoding="utf-8") == "old"


# -- what must not be refused ---------------------------------------------------------------------


@pytest.mark.parametrize(
    "text", ["0.5,-1", " 0.5 , -1.0 ", "5e-1,-1", "j1=0.5,j2=-1", "j2=-1, j1=+.5"]
)
def test_ways_to_write_q(text, accepted):
    Path("arm.urdf").write_text(ARM, encoding="utf-8")
    assert accepted("arm.urdf", "--q", text)["q"] == [0.5, -1.0]


def test_values_that_begin_with_a_minus(accepted):
    Path("arm.urdf").write_text(ARM, encoding="utf-8")
    data = accepted("arm.urdf", "--q", "-1,-2", "--load=-1,0,0,0,0,-2")
    assert data["q"] == [-1.0, -2.0]


def test_some_joints_by_name_leave_the_others(accepted):
    expected = accepted("ur5")["q"]
    expected[2] = 0.25
    assert accepted("ur5", "--q", "elbow_joint=0.25")["q"] == expected


def test_one_stiffness_serves_all_joints(accepted):
    Path("arm.urdf").write_text(ARM, encoding="utf-8")
    one = accepted("arm.urdf", "--stiffness", "50")
    each = accepted("arm.urdf", "--stiffness", "j1=50,j2=50.0")
    assert one["compliance"] == each["compliance"]
    assert "stiffness-assumed" not in [note["code"] for note in one["notes"]]


def test_output_holds_the_result(accepted, workplace):
    data = accepted("cubic", "-o", "a b.json")
    assert [p.name for p in workplace.iterdir()] == ["a b.json"]
    assert json.loads(Path("a b.json").read_text(encoding="utf-8")) == data


# -- the real process -----------------------------------------------------------------------------


def process(*arguments, program=("-m", "cartstiff"), **options):
    environment = {**os.environ, "PYTHONPATH": str(ROOT / "src"), **options.pop("env", {})}
    environment.pop("CARTSTIFF_TRACEBACK", None)
    return subprocess.run(
        [sys.executable, *program, *arguments],
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


#: One command after the other; the sum of their exit codes.
EACH = """
import sys
from cartstiff.shown.cli.main import main
total = 0
for name in sys.argv[1:]:
    try:
        main(["analyse", name])
    except SystemExit as end:
        total += end.code
sys.exit(total)
"""


def test_process_refuses_in_one_line(workplace):
    for name, text in CRASHERS.items():
        Path(name).write_text(text, encoding="utf-8")
    done = process(*CRASHERS, program=("-c", EACH))
    assert done.returncode == 2 * len(CRASHERS)
    assert done.stdout == ""
    lines = done.stderr.splitlines()
    for name, line in zip(CRASHERS, lines, strict=True):
        assert line.startswith("cartstiff: ")
        assert name in line
    assert {p.name for p in workplace.iterdir()} == set(CRASHERS)


def test_process_prints_nothing_but_json(workplace):
    text = ARM.replace(
        '<link name="a"/>',
        '<link name="a"><visual><geometry><mesh filename="x"/></geometry></visual></link>',
    )
    Path("arm.urdf").write_text(text, encoding="utf-8")
    done = process("analyse", "arm.urdf", "--json")
    assert (done.returncode, done.stderr) == (0, "")
    assert json.loads(done.stdout)["mechanism"]["name"] == "arm"


def test_process_with_closed_or_full_streams():
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


def test_process_where_text_is_ascii():
    Path("Größe.urdf").write_text(ARM, encoding="utf-8")
    done = process("analyse", "Größe.urdf", env={"PYTHONIOENCODING": "ascii"})
    assert (done.returncode, done.stderr) == (0, "")
    assert "serial, body frame" in done.stdout


def test_joints_that_are_still_assumed_are_named(accepted):
    Path("arm.urdf").write_text(ARM, encoding="utf-8")

    def note(*options):
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
    ("command", "option", "near"),
    [("analyse", "--reportat", "--report-at"), ("modes", "--responses", "--response")],
)
def test_an_unknown_option_is_refused_with_the_nearest(refused, command, option, near):
    refused(command, "ur5", option, "1", words=("No such option", option, near))
