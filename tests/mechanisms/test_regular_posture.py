"""The posture of an arm that names none: regular, within its limits, the same every time."""

import numpy as np
import pytest
from tests.mechanisms.machines import joint, write_urdf

import cartstiff

# Rounding of two Jacobians of the same chain.
SAME = 1e-9
WRIST = [
    joint("a1", "base", "l1", axis=(0, 0, 1)),
    joint("a2", "l1", "l2", at=(0, 0, 0.4), axis=(0, 1, 0)),
    joint("a3", "l2", "l3", at=(0, 0, 0.4), axis=(0, 1, 0)),
    joint("a4", "l3", "l4", at=(0, 0, 0.2), axis=(0, 0, 1)),
    joint("a5", "l4", "l5", at=(0, 0, 0.2), axis=(0, 1, 0)),
    joint("a6", "l5", "hand", at=(0, 0, 0.1), axis=(0, 0, 1)),
]


def posture_note(arm):
    notes = [note.values for note in arm.notes if note.code == "default-posture"]
    return dict(notes[0]) if notes else None


def test_an_arm_that_is_singular_at_zero_shows_its_matrix(tmp_path):
    arm = cartstiff.load(str(write_urdf(tmp_path, *WRIST)))
    values = posture_note(arm)
    assert values is not None
    assert values["condition_at_zero"] is None
    result = cartstiff.analyse(arm)
    assert result.B is not None
    # The condition that is told is that of the Jacobian by differences of the pose.
    h, columns = 1e-6, []
    for k in range(6):
        step = h * np.eye(6)[k]
        a, b = (arm.mechanism.at(arm.q + s * step).pose for s in (1, -1))
        rate = np.linalg.inv(result.pose) @ (a - b) / (2 * h)
        columns.append([rate[2, 1], rate[0, 2], rate[1, 0], *rate[:3, 3]])
    J = np.array(columns).T
    zero = np.zeros(6)
    length = arm.mechanism.at(zero).length
    sizes = np.repeat([1.0, 1.0 / length], 3)
    assert values["condition"] == pytest.approx(np.linalg.cond(sizes[:, None] * J), rel=1e-6)
    assert values["condition"] <= 10.0
    again = cartstiff.load(str(tmp_path / "machine.urdf"))
    assert np.array_equal(arm.q, again.q)


def test_limits_hold(tmp_path):
    text = write_urdf(tmp_path, *WRIST).read_text()
    narrow = text.replace('type="continuous"', 'type="revolute"').replace(
        "</joint>", '<limit lower="-0.6" upper="0.7" effort="0" velocity="0"/></joint>'
    )
    (tmp_path / "narrow.urdf").write_text(narrow)
    arm = cartstiff.load(str(tmp_path / "narrow.urdf"))
    assert posture_note(arm) is not None
    assert ((arm.q >= -0.6) & (arm.q <= 0.7)).all()
    assert cartstiff.analyse(arm).B is not None


def test_a_posture_that_is_given_or_good_stays(tmp_path):
    write_urdf(tmp_path, *WRIST)
    file = tmp_path / "arm.yaml"
    file.write_text("kind: serial\nmodel: machine.urdf\nq: {a5: 0.0}\n")
    arm = cartstiff.load(str(file))
    assert posture_note(arm) is None
    assert not arm.q.any()
    bent = [
        line.replace('rpy="0.0 0.0 0.0"', 'rpy="0.3 0.7 0.5"') if i in (2, 4) else line
        for i, line in enumerate(WRIST)
    ]
    arm = cartstiff.load(str(write_urdf(tmp_path, *bent, name="bent")))
    assert posture_note(arm) is None
    assert not arm.q.any()


def test_five_joints_stay_at_zero(tmp_path):
    arm = cartstiff.load(str(write_urdf(tmp_path, *WRIST[:5])))
    assert posture_note(arm) is None
    assert not arm.q.any()


def test_the_same_for_a_model_in_hand(tmp_path):
    pin = pytest.importorskip("pinocchio")
    path = write_urdf(tmp_path, *WRIST)
    in_hand = cartstiff.load(pin.buildModelFromUrdf(str(path)))
    np.testing.assert_allclose(in_hand.q, cartstiff.load(str(path)).q, atol=SAME)


def test_springs_at_rest_positions_keep_zero(tmp_path):
    write_urdf(tmp_path, *WRIST)
    file = tmp_path / "arm.yaml"
    springs = ", ".join(f"a{k}: {{stiffness: 10, rest: 0}}" for k in range(1, 7))
    file.write_text(f"kind: serial\nmodel: machine.urdf\nsprings: {{{springs}}}\n")
    assert not cartstiff.load(str(file)).q.any()


def test_an_arm_of_four_joints_that_is_singular_at_zero_says_so(tmp_path):
    """A SCARA whose arm is stretched; three turns about one line lose nothing elsewhere."""
    scara = [
        joint("a1", "base", "l1", at=(0, 0, 0.5)),
        joint("a2", "l1", "l2", at=(0.6, 0, 0)),
        joint("a3", "l2", "l3", at=(0.4, 0, 0)),
        joint("a4", "l3", "tip", kind="prismatic"),
    ]
    arm = cartstiff.load(str(write_urdf(tmp_path, *scara)))
    assert not arm.q.any()
    (note,) = [note for note in arm.notes if note.code == "zero-singular"]
    # The determinant of the planar part is l1 l2 sin(a2).
    assert abs(0.6 * 0.4 * np.sin(note.values["q"][1])) > 0.05
    bent = cartstiff.analyse(arm, q=note.values["q"])
    assert np.linalg.matrix_rank(bent.jacobian, 1e-9) == 4
    assert np.linalg.matrix_rank(cartstiff.analyse(arm).jacobian, 1e-9) == 3
    line = [line.replace("0.6 0.0 0.0", "0.0 0.0 0.1") for line in scara]
    line = [line.replace("0.4 0.0 0.0", "0.0 0.0 0.1") for line in line]
    always = cartstiff.load(str(write_urdf(tmp_path, *line, name="line")))
    assert "zero-singular" not in [note.code for note in always.notes]
