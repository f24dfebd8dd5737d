"""The same refusals in Python: one family of errors, with the numbers that are wrong."""

from copy import copy
from pathlib import Path

import numpy as np
import pytest
from tests.doors import LabelledResult, read_yaml

import cartstiff
from cartstiff import InputError
from cartstiff.core.errors import UnknownNameError
from cartstiff.extend import Mechanism, Potential

GOOD = [0.1, -1.0, 1.2, 0.3, 0.9, 0.2]


def test_load_refuses_a_frame():
    with pytest.raises(UnknownNameError, match="unknown frame") as error:
        cartstiff.load("ur5", frame="tool")
    assert error.value.name == "tool"
    assert "tool0" in error.value.valid


def test_a_zero_byte_names_nothing():
    with pytest.raises(InputError, match="no name"):
        cartstiff.load("a\0b")


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
        ("1e400", "1e400"),
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
    with pytest.raises(
        cartstiff.core.errors.InputError, match="frame is not a name; expected text"
    ):
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


def test_equal_means_the_same_object_of_mechanisms_energies_and_results():
    """So `==` answers whatever arrays they hold, and each can be a key of a dict."""
    arm = cartstiff.load("ur5")
    for thing in (
        arm,
        arm.mechanism,
        arm.springs,
        cartstiff.load("cubic").springs,
        *(kind(np.ones(n)) for kind, n in ((cartstiff.DeadForce, 3), (cartstiff.DeadWrench, 6))),
        cartstiff.FollowerWrench(np.ones(6)),
        cartstiff.Held({"x": 0.1}, np.eye(4)),
        cartstiff.analyse(arm),
        cartstiff.analyse(arm).B,
        cartstiff.modes(arm),
        cartstiff.equilibrium(arm),
        cartstiff.analyse_many(arm, [arm.q]),
        cartstiff.extend.Gravity(np.ones(3)),
        cartstiff.geometry.levi_civita(np.eye(6)),
        cartstiff.maps.Grid({"elbow_joint": (0, 1, 3)}, arm.names, arm.q),
    ):
        twin = copy(thing)
        assert thing == thing
        assert (thing == twin) is False
        assert len({thing, twin}) == 2


def test_every_energy_mechanism_and_result_is_equal_to_itself_alone():
    """Also those that no line above makes."""

    def below(kind):
        for one in kind.__subclasses__():
            yield one
            yield from below(one)

    kinds = {one for kind in (Potential, Mechanism, LabelledResult) for one in below(kind)}
    own = [kind for kind in kinds if kind.__module__.startswith("cartstiff.")]
    assert len(own) > 20
    assert [kind.__name__ for kind in own if kind.__eq__ is not object.__eq__] == []
