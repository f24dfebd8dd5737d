"""The same refusals in Python: one family of errors, with the numbers that are wrong."""

from pathlib import Path

import numpy as np
import pytest

import cartstiff
from cartstiff.errors import CartstiffError, InputError, UnknownNameError
from cartstiff.loading.yaml_file import read_yaml

GOOD = [0.1, -1.0, 1.2, 0.3, 0.9, 0.2]

SOURCES = {
    "empty": ("", "no name"),
    "blank": ("  ", "no name"),
    "zero byte": ("a\0b", "no name"),
    "unknown": ("ur55", "unknown mechanism.*ur5"),
    "missing": ("none.yaml", "none.yaml: file cannot be read"),
    "missing path": (Path("none.urdf"), "none.urdf: file cannot be read"),
    "folder": (Path(), "is a directory"),
    "other kind": ("file.txt", "unknown kind of file"),
}


@pytest.mark.parametrize("case", SOURCES)
def test_load_refuses(case):
    Path("file.txt").write_text("x", encoding="utf-8")
    source, message = SOURCES[case]
    with pytest.raises(InputError, match=message):
        cartstiff.load(source)


def test_load_refuses_a_frame():
    with pytest.raises(UnknownNameError, match="unknown frame") as error:
        cartstiff.load("ur5", frame="tool")
    assert error.value.name == "tool"
    assert "tool0" in error.value.valid


@pytest.mark.parametrize(
    ("q", "message"),
    [
        ([], "wrong count.*6.*got 0"),
        (GOOD[:5], "wrong count.*6.*got 5"),
        ([*GOOD, 0.0], "wrong count.*6.*got 7"),
        ([GOOD], "wrong count.*shape"),
        (3.0, "wrong count"),
        ([*GOOD[:5], float("nan")], "finite"),
        ([*GOOD[:5], float("inf")], "finite"),
        ([*GOOD[:5], None], "finite|numeric"),
        ([*GOOD[:5], "up"], "not numeric"),
        ([*GOOD[:5], [1]], "not numeric"),
        ([*GOOD[:5], 1j], "not numeric"),
        ("here", "not numeric"),
        ({"elbow": 1.0}, "unknown joint.*elbow_joint"),
        ({"elbow_joint": float("nan")}, "q of elbow_joint must be finite"),
        ({"elbow_joint": "up"}, "not numeric"),
    ],
)
def test_analyse_refuses_coordinates(q, message):
    with pytest.raises(InputError, match=message):
        cartstiff.analyse(cartstiff.load("ur5"), q)


@pytest.mark.parametrize(
    ("wrench", "message"),
    [
        ([0, 0, 0, 0, 0], "wrench has the wrong count.*got 5"),
        ([[0] * 6], "wrong count"),
        ([0, 0, 0, 0, 0, np.nan], "wrench must be finite"),
        ("heavy", "not numeric"),
        ({"fz": 1}, "not numeric"),
    ],
)
def test_analyse_refuses_a_wrench(wrench, message):
    with pytest.raises(InputError, match=message):
        cartstiff.analyse(cartstiff.load("ur5"), wrench=wrench)


@pytest.mark.parametrize(
    ("stiffness", "rest", "message"),
    [
        (-1.0, None, "negative"),
        (np.nan, None, "finite"),
        ([1, 2, 3], None, "wrong count"),
        ([1, 2, 3, 4, 5, -6], None, "negative"),
        ({"elbow": 1.0}, None, "unknown joint"),
        ("hard", None, "not numeric"),
        (None, [0.0], "wrong count"),
        (None, {"elbow": 0.0}, "unknown joint"),
        (None, np.inf, "finite"),
    ],
)
def test_springs_refuse(stiffness, rest, message):
    with pytest.raises(InputError, match=message):
        cartstiff.load("ur5").with_springs(stiffness, rest)


def test_integers_are_numbers():
    ur5 = cartstiff.load("ur5").with_springs(1000)
    got = cartstiff.analyse(ur5, [0, -1, 1, 0, 1, 0], wrench=[0, 0, 0, 0, 0, 1])
    expected = cartstiff.analyse(ur5, [0.0, -1.0, 1.0, 0.0, 1.0, 0.0], wrench=np.eye(6)[5])
    assert got.to_dict() == expected.to_dict()


def test_every_refusal_is_of_one_family():
    assert issubclass(InputError, CartstiffError)
    assert issubclass(InputError, ValueError)
    assert issubclass(UnknownNameError, InputError)


def test_lines_of_a_file():
    text = "# c\nkind: stewart-gough\nbase:\n  - [0, 0, 0]\n  -\n    - 1\n    - 2\n"
    text += "legs: {stiffness: 1}\n"
    Path("f.yaml").write_text(text, encoding="utf-8")
    data, lines = read_yaml(Path("f.yaml"))
    assert data == {
        "kind": "stewart-gough",
        "base": [[0, 0, 0], [1, 2]],
        "legs": {"stiffness": 1},
    }
    assert lines[("kind",)] == 2
    assert lines[("base", 0, 2)] == 4
    assert lines[("base", 1, 1)] == 7
    assert lines[("legs", "stiffness")] == 8


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1", 1),
        ("-3", -3),
        ("3e5", 3e5),
        ("3.0e5", 3e5),
        ("1.", 1.0),
        (".5", 0.5),
        ("010", 10),
        ("0o10", 8),
        ("0x1F", 31),
        ("1:30", "1:30"),
        ("1_0", "1_0"),
        ("yes", "yes"),
        ("on", "on"),
        ("true", True),
        ("False", False),
        ("null", None),
        ("~", None),
        ('"1"', "1"),
        ("'~'", "~"),
        ("2001-01-01", "2001-01-01"),
        ("!!str 1", "1"),
        ("!!float 1", 1.0),
        (".inf", float("inf")),
        ("-.INF", float("-inf")),
        ("1e400", float("inf")),
        ("=", "="),
        ("a: b", {"a": "b"}),
    ],
)
def test_plain_values_of_yaml(text, value):
    Path("f.yaml").write_text(
        f"key: {text}\n" if ": " not in text else f"key: {{{text}}}\n", encoding="utf-8"
    )
    got = read_yaml(Path("f.yaml"))[0]["key"]
    assert got == value
    assert isinstance(got, bool) == isinstance(value, bool)


def test_error_carries_its_parts():
    Path("f.yaml").write_text("kind: serial\nmodel: ur5\nq: {elbow_joint: up}\n", encoding="utf-8")
    with pytest.raises(InputError) as error:
        cartstiff.load("f.yaml")
    assert error.value.where == "f.yaml, line 3, key q.elbow_joint"
    assert error.value.expected == "a number"
    assert error.value.got == "'up'"


@pytest.mark.parametrize("frame", [1.0, [], {}, True, b"tool0"])
def test_a_frame_is_a_name(frame):
    with pytest.raises(cartstiff.errors.InputError, match="frame is not a name; expected text"):
        cartstiff.load("cubic", frame=frame)


UNLOADED = {
    "analyse": cartstiff.analyse,
    "analyse_many": lambda arm, **load: cartstiff.analyse_many(arm, [GOOD], **load),
    "modes": cartstiff.modes,
    "equilibrium": cartstiff.equilibrium,
}


@pytest.mark.parametrize("name", UNLOADED)
@pytest.mark.parametrize(
    ("key", "value"),
    [("load_kind", "follower"), ("load_at", [0.0, 0.0, 0.1]), ("load_axes", "world")],
)
def test_words_about_a_load_need_one(name, key, value):
    with pytest.raises(InputError, match=f"{key}.*none is given"):
        UNLOADED[name](cartstiff.load("ur5"), **{key: value})


def test_a_load_that_springs_exert_acts_somewhere_too():
    """Rest positions that are given leave a load to be held: its kind changes the tangent."""
    arm = cartstiff.load("ur5", rest=GOOD)
    q = np.array(GOOD) + 0.01
    dead, turning = (cartstiff.analyse(arm, q, load_kind=k) for k in ("dead", "follower"))
    W = dead.wrench
    cross = np.cross(np.eye(3), W[3:])
    assert turning.tangent[3:, :3] - dead.tangent[3:, :3] == pytest.approx(cross, rel=1e-9)
    with pytest.raises(InputError, match="load_axes"):
        cartstiff.analyse(arm, q, load_axes="world")


def test_the_tangent_is_found_by_its_name():
    found = cartstiff.analyse(cartstiff.load("ur5"), wrench=[0.0, 1.0, 0.0, 0.0, 0.0, -50.0])
    K, C = found.matrices["load"], found.compliances["load"]
    assert np.array_equal(K, found.at().matrices["load"])
    assert pytest.approx(np.eye(6), abs=1e-9) == K @ C
    assert list(found.matrices) == list(found.compliances) == ["A", "B", "K", "F"]
