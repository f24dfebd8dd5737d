"""Lines, and links that give, are parameters beside the springs: closed forms of one link."""

import numpy as np
import pytest
from tests.mechanisms.machines import joint, write_file, write_urdf
from tests.support.commands import answer

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
    found = cartstiff.accuracy(cartstiff.analyse(bar), cartstiff.analysis.Tolerances(stiffness=0.1))
    assert {"stiffness.line1", "stiffness.bar (link)"} <= set(found.names)


def test_a_body_that_rests_anywhere_has_none():
    """Beside a motion that costs nothing the place of rest hangs on rounding, not on parameters."""
    rest = cartstiff.equilibrium(cartstiff.load("grasp"))
    assert rest.has_free_motion
    with pytest.raises(cartstiff.UndefinedError, match="a motion of the body costs nothing"):
        cartstiff.sensitivities(rest)
    with pytest.raises(cartstiff.UndefinedError, match="not decided"):
        cartstiff.accuracy(rest, cartstiff.analysis.Tolerances(0.01))


@pytest.mark.parametrize("name", ["parameter.k", "stiffness.elbow"])
def test_a_rigid_drive_moves_once_where_derivatives_are_asked_for_beside(tmp_path, name):
    """A lever on a spring k, on an arm of length a that a rigid drive turns by `turn`.

    k t = F length cos(turn + t), of which t is found by bisection, and dt/dk by its derivative.
    """
    k, F, a, length, turn = 800.0, 300.0, 0.5, 0.8, 0.4
    write_urdf(
        tmp_path,
        joint("shoulder", "base", "upper", axis=(0, 1, 0)),
        joint("elbow", "upper", "fore", at=(a, 0, 0), axis=(0, 1, 0)),
        joint("end", "fore", "tool", at=(length, 0, 0), kind="fixed"),
        name="lever",
    )
    path = write_file(
        tmp_path,
        "lever",
        kind="serial",
        model="lever.urdf",
        frame="tool",
        parameters={"k": k},
        springs={"shoulder": {"stiffness": "rigid"}, "elbow": {"stiffness": "=k", "rest": 0.0}},
    )
    low, high = 0.0, 1.0
    for _ in range(60):
        t = (low + high) / 2
        low, high = (t, high) if k * t < F * length * np.cos(turn + t) else (low, t)
    x = turn + t
    slope = -t / (k + F * length * np.sin(x))
    load = f"--load 0,0,0,0,0,{-F} --world"
    found = answer(f"equilibrium {path} --actuate shoulder={turn} --sensitivities", load)
    assert found["q"] == pytest.approx([turn, t], rel=CLOSE)
    (row,) = (p for p in found["sensitivities"]["parameters"] if p["name"] == name)
    pose = [0, slope, 0, -length * np.sin(x) * slope, 0, -length * np.cos(x) * slope]
    assert row["pose"] == pytest.approx(pose, rel=1e-7, abs=1e-14)


def test_a_rigid_drive_of_a_loop_moves_once_beside_derivatives():
    """Where the tip rests with another spring, by differences of equilibria."""
    text = "equilibrium five-bar --actuate left_motor=0.1 --load 0,0,0,300,-500,0 --world"
    k, h = 800.0, 8.0

    def found(stiffness, *more):
        return answer(text, f"--stiffness left_motor=rigid,right_motor={stiffness}", *more)

    here = found(k, "--sensitivities")
    places = [np.array(found(k + i * h)["pose"])[:3, 3] for i in (-2, -1, 1, 2)]
    slope = np.array([1, -8, 8, -1]) @ places / (12 * h)
    (row,) = (
        p for p in here["sensitivities"]["parameters"] if p["name"] == "stiffness.right_motor"
    )
    assert np.linalg.norm(slope) > 1e-6
    assert row["pose"][3:] == pytest.approx(slope, rel=1e-6, abs=1e-13)
