"""Answers that no arm gives are doubted, with numbers found here by hand and by finite turns."""

import numpy as np
import pytest
from tests.support.commands import answer

import cartstiff
from cartstiff import DeadForce

POSTURE = [0.3, -1.1, 1.4, -0.7, 0.9, 0.2]
CODE = "implausible-deflection"


def doubt(result):
    return next((note for note in result.notes if note.code == CODE), None)


def place(arm, q):
    return arm.mechanism.at(q).pose[:3, 3]


def torques(arm, force):
    """J^T W by finite differences of the tip's position."""
    h = 1e-6
    steps = np.eye(6) * h
    J = [(place(arm, POSTURE + s) - place(arm, POSTURE - s)) / (2 * h) for s in steps]
    return np.array(J) @ force


def test_a_joint_that_winds_up():
    """Springs a hundred times too soft: torque over stiffness, also from the recorded program."""
    arm = cartstiff.load("ur5").with_springs(300.0)
    force = np.array([0.0, 0.0, -100.0])
    torque = torques(arm, force)
    R = arm.mechanism.at(POSTURE).pose[:3, :3]
    for _ in range(4):
        note = doubt(cartstiff.analyse(arm, POSTURE, wrench=[0, 0, 0, *(R.T @ force)]))
        turned = np.abs(torque / 300.0)
        for name, value in note.values["wind_up"].items():
            expected = turned[arm.names.index(name)]
            assert abs(value) == pytest.approx(expected, rel=1e-6)
            assert expected > np.radians(5)
        assert len(note.values["wind_up"]) == (turned > np.radians(5)).sum()
        moved = np.linalg.norm(place(arm, POSTURE) - place(arm, POSTURE - torque / 300.0))
        assert note.values["moved"] == pytest.approx(moved, rel=1e-6)
        assert "N m/arcmin" in note.message
    # The links of a UR5: 0.13585, 0.425, 0.1197, 0.39225, 0.093, 0.09465, 0.0823 m.
    links = [np.hypot(0, 0.13585), np.hypot(0.425, 0.1197), 0.39225, 0.093, 0.09465, 0.0823]
    assert note.values["reach"] == pytest.approx(sum(links), rel=1e-3)


def test_plain_answers_are_not_doubted():
    """The bundled springs under 100 N, unloaded, and where rest positions were given."""
    arm = cartstiff.load("ur5")
    for wrench in (None, [0, 0, 0, 0, 0, -100.0]):
        assert doubt(cartstiff.analyse(arm, wrench=wrench)) is None
    assert doubt(cartstiff.equilibrium(arm, DeadForce([0, 0, -100]))) is None
    # A rigid joint and a free one have no spring that winds up, wherever they are.
    held = arm.with_springs({"elbow_joint": np.inf, "wrist_3_joint": 0.0}, rest=0.0)
    assert not np.isnan(held.springs.rest).any()
    note = doubt(cartstiff.analyse(held, POSTURE))
    assert note is not None
    assert set(note.values["wind_up"]) == set(arm.names) - {"elbow_joint", "wrist_3_joint"}


def test_a_mega_newton_on_a_ur5():
    """In analyse and in equilibrium, text of the note with the joint, its torque and its angle."""
    for command in ("analyse", "equilibrium"):
        data = answer(f"{command} ur5 --load 0,0,0,0,0,-1000000")
        note = next(note for note in data["notes"] if note["code"] == CODE)
        assert "winds up by" in note["message"]
        assert "the tip moves by" in note["message"]


def test_equilibrium_says_how_far():
    """From the rest position, which is the start, to where it comes to rest."""
    arm = cartstiff.load("ur5").with_springs(1500.0)
    state = cartstiff.equilibrium(arm, POSTURE, DeadForce([0, 0, -400]))
    note = doubt(state)
    moved = state.posture.q - np.array(POSTURE)
    for name, value in note.values["wind_up"].items():
        assert value == pytest.approx(moved[arm.names.index(name)], abs=1e-9)
    moved = np.linalg.norm(state.posture.pose[:3, 3] - place(arm, POSTURE))
    assert note.values["moved"] == pytest.approx(moved, rel=1e-9)


def test_legs_that_a_load_stretches(tmp_path):
    """N/mm taken as N/m: by a solution for the tensions; also from the recorded program."""
    soft = cartstiff.load("hexapod").with_springs(2e3)
    wrench = np.array([0, 0, 0, 30.0, 0, -900.0])
    T = soft.mechanism.at(soft.q).pose
    ends = soft.mechanism.points @ T[:3, :3].T + T[:3, 3]
    lines = ends - soft.mechanism.anchors
    L = np.linalg.norm(lines, axis=1)
    u = lines / L[:, None] @ T[:3, :3]
    A = np.concatenate([np.cross(soft.mechanism.points, u), u], axis=1).T
    x = np.linalg.solve(A, wrench) / 2e3
    assert 0 < (np.abs(x) > 0.1 * L).sum() < 6
    for _ in range(4):
        note = doubt(cartstiff.analyse(soft, wrench=wrench))
        stretch = note.values["stretch"]
        assert set(stretch) == {f"leg{i + 1}" for i in np.flatnonzero(np.abs(x) > 0.1 * L)}
        for name, value in stretch.items():
            assert value == pytest.approx(x[int(name[3:]) - 1], rel=1e-9)
        assert "N/um" in note.message
    stiff = soft.with_springs(2e6)
    for _ in range(4):
        assert doubt(cartstiff.analyse(stiff, wrench=wrench)) is None
    assert doubt(cartstiff.analyse(soft)) is None
    # A given rest length is meant, as in the tables of the bundled platform.
    assert doubt(cartstiff.analyse(cartstiff.load("stewart-gough"))) is None
    found = doubt(cartstiff.equilibrium(soft.with_springs(1e4), DeadForce([0, 0, -6000.0])))
    assert found is not None
