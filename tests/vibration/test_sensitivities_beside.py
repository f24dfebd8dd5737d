"""Lines, and links that give, are parameters beside the springs: closed forms of one link."""

from __future__ import annotations

import numpy as np
import pytest
from tests.mechanisms.machines import joint, write_file, write_urdf

import cartstiff

K6 = np.diag([30.0, 40.0, 50.0, 2e4, 3e4, 4e4])  # rotation, translation
LINE, MASS = 5e3, 2.0
BODY = (
    f'<link name="tool"><inertial><mass value="{MASS}"/>'
    '<inertia ixx="0.01" iyy="0.02" izz="0.03" ixy="0" ixz="0" iyz="0"/></inertial></link>'
)
CLOSE = 1e-8


@pytest.fixture
def bar(tmp_path):
    """A link that gives on the wall, with a weight, and a line along x that pulls at it."""
    path = write_urdf(
        tmp_path,
        joint("wall", "base", "bar", kind="fixed"),
        joint("end", "bar", "tool", kind="fixed"),
        name="bar",
    )
    text = path.read_text(encoding="utf-8")
    path.write_text(text.replace('<link name="tool"/>', BODY))
    line = {
        "frames": ["world", "tool"],
        "points": [[-1, 0, 0], [0, 0, 0]],
        "stiffness": LINE,
        "rest_length": 1.0,
    }
    return cartstiff.load(
        write_file(
            tmp_path,
            "bar",
            kind="serial",
            model="bar.urdf",
            frame="tool",
            flexible={"bar": {"stiffness": K6.tolist()}},
            lines=[line],
        )
    )


def test_stiffness_grows_by_the_line_and_with_the_link(bar):
    known = cartstiff.sensitivities(cartstiff.analyse(bar))
    along_x = np.zeros((6, 6))
    along_x[3, 3] = 1.0
    assert known.stiffness["K"][known.index("stiffness.line1")] == pytest.approx(along_x, abs=CLOSE)
    by_link = known.stiffness["K"][known.index("stiffness.bar (link)")]
    assert np.abs(by_link - K6).max() <= CLOSE * K6.max()


def test_frequencies_follow_both(bar):
    found = cartstiff.modes(bar)
    known = cartstiff.sensitivities(found)
    k = K6[3, 3] + LINE
    f = np.sqrt(k / MASS) / (2 * np.pi)
    mode = int(np.argmin(np.abs(found.frequencies - f)))
    assert found.frequencies[mode] == pytest.approx(f, rel=CLOSE)
    assert known.of("stiffness.line1")[mode] == pytest.approx(f / (2 * k), rel=CLOSE)
    share = K6[3, 3] / k
    assert known.of("stiffness.bar (link)")[mode] == pytest.approx(0.5 * f * share, rel=CLOSE)


def test_tolerances_of_stiffness_include_them(bar):
    found = cartstiff.accuracy(cartstiff.analyse(bar), cartstiff.Tolerances(stiffness=0.1))
    assert {"stiffness.line1", "stiffness.bar (link)"} <= set(found.names)


def test_a_body_that_rests_anywhere_has_none():
    """Beside a motion that costs nothing the place of rest hangs on rounding, not on parameters."""
    rest = cartstiff.equilibrium(cartstiff.load("grasp"))
    assert rest.has_free_motion
    with pytest.raises(cartstiff.UndefinedError, match="a motion of the body costs nothing"):
        cartstiff.sensitivities(rest)
    with pytest.raises(cartstiff.UndefinedError, match="not decided"):
        cartstiff.accuracy(rest, cartstiff.Tolerances(0.01))
