"""Stiffness of fewer than six freedoms in task axes, by independent computations."""

import numpy as np
import pytest
from scipy.optimize import brentq
from tests.support.commands import answer, run

import cartstiff

RIGID = """
kind: parallel
actuated: [leg1/motor, leg2/motor, leg3/motor]
legs:
"""
LEG = """
  - model: {folder}/delta-leg.urdf
    frame: end
    base: {{xyz: [{bx}, {by}, 0], rpy: [0, 0, {turn}]}}
    grip: {{xyz: [{gx}, {gy}, 0], rpy: [0, 0, {turn}]}}
    q: {{motor: 0.3725820647323506, elbow_swing: 1.887742888237225, wrist_swing: -2.26032495296957}}
    springs: {{motor: {{stiffness: 1500}}}}
    passive: [elbow_swing, elbow_tilt, wrist_tilt, wrist_swing]
"""
TURNS = 2 * np.pi * np.arange(3) / 3


@pytest.fixture(scope="module")
def delta(tmp_path_factory):
    """The bundled delta with rigid forearms, which can only translate."""
    from pathlib import Path

    folder = Path(cartstiff.__file__).parents[2] / "robots"
    legs = [
        LEG.format(
            folder=folder,
            turn=repr(float(t)),
            bx=0.15 * np.cos(t),
            by=0.15 * np.sin(t),
            gx=0.05 * np.cos(t),
            gy=0.05 * np.sin(t),
        )
        for t in TURNS
    ]
    file = tmp_path_factory.mktemp("delta") / "rigid-delta.yaml"
    file.write_text(RIGID + "".join(legs), encoding="utf-8")
    return file


def by_hand(place):
    """K = sum k u u^T / (u . (axis x arm))^2 over the forearms' directions u, in N/m."""
    K = np.zeros((3, 3))
    for turn in TURNS:
        c, s = np.cos(turn), np.sin(turn)
        R = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
        shoulder, wrist, axis = R @ [0.15, 0, 0], place + R @ [0.05, 0, 0], R @ [0, 1, 0]

        def arm(angle, R=R):
            return 0.2 * (R @ [np.cos(angle), 0, -np.sin(angle)])

        def miss(angle, shoulder=shoulder, wrist=wrist, arm=arm):
            return np.linalg.norm(wrist - shoulder - arm(angle)) - 0.45

        angle = brentq(miss, -0.5, 1.3)
        u = (wrist - shoulder - arm(angle)) / 0.45
        K += 1500 * np.outer(u, u) / (u @ np.cross(axis, arm(angle))) ** 2
    return K


@pytest.mark.parametrize("place", [(0, 0, -0.42), (0.05, -0.03, -0.4), (-0.1, 0.06, -0.38)])
def test_a_delta_has_kxx_kyy_kzz(delta, place):
    data = answer("analyse", delta, "--pose", ",".join(map(str, place)) + ",0,0,0")
    task = data["task_axes"]
    assert (task["names"], task["axes"], task["alone"]) == (["x", "y", "z"], "M", True)
    assert np.array(task["stiffness"]) == pytest.approx(
        by_hand(np.array(place)), rel=1e-6, abs=1e-3
    )
    assert np.array(task["motions"]) == pytest.approx(np.eye(6)[:, 3:], abs=1e-9)


def test_the_text_has_the_same_numbers(delta):
    text = run("analyse", delta, "--pose", "0.05,-0.03,-0.4,0,0,0")
    rows = text.split("Stiffness along x, y, z of M; all motions that exist\n")[1].splitlines()
    shown = [[float(x) for x in row.split()[1:4]] for row in rows[1:4]]
    expected = 1e-3 * by_hand(np.array([0.05, -0.03, -0.4]))
    assert np.array(shown) == pytest.approx(expected, rel=1e-5)
    assert rows[1].split()[4] == "N/mm"


def test_planar_machines_have_x_y_and_phi(tmp_path):
    """A planar arm of three joints: J^-T k J^-1 with the Jacobian by hand."""
    links = "".join(
        f"<link name='l{i}'/>"
        + (
            f"<joint name='j{i}' type='continuous'><parent link='l{i - 1}'/><child link='l{i}'/>"
            f"<origin xyz='{0.0 if i == 1 else 0.3} 0 0'/><axis xyz='0 0 1'/></joint>"
            if i
            else ""
        )
        for i in range(4)
    )
    arm = cartstiff.load(f"<robot name='planar'>{links}</robot>", stiffness=[100.0, 80.0, 60.0])
    q = np.array([0.3, 0.8, -0.5])
    result = cartstiff.analyse(arm, q)
    phi = np.cumsum(q)
    joints = np.cumsum([[0, 0], *(0.3 * np.column_stack([np.cos(phi), np.sin(phi)]))[:2]], axis=0)
    reach = joints[2] - joints  # from each joint to the tip, which is at the last joint
    J = np.array([[-r[1], r[0], 1.0] for r in reach]).T
    inverse = np.linalg.inv(J)
    in_room = inverse.T @ np.diag([100.0, 80.0, 60.0]) @ inverse
    c, s = np.cos(phi[-1]), np.sin(phi[-1])
    R = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    assert result.task_axes.names == ("x", "y", "phi")
    assert result.task_axes.axes == "M"
    assert result.task_axes.stiffness == pytest.approx(R.T @ in_room @ R, rel=1e-9, abs=1e-7)


@pytest.mark.parametrize("name", ["3-rps", "tricept", "3-prs", "orthoglide", "five-bar"])
def test_energy_of_a_motion_is_the_same_in_any_coordinates(name):
    """Work of the wrench that the compliance needs for a unit rate, by a pseudo-inverse."""
    result = cartstiff.analyse(cartstiff.load(name))
    task = result.task_axes
    C = result.compliances["B"]
    # The motion under the wrench that it needs: C maps wrenches to twists.
    for i, twist in enumerate(task.motions.T):
        R = result.pose[:3, :3].T if task.axes == "F" else np.eye(3)
        body = np.kron(np.eye(2), R) @ twist
        wrench = np.linalg.pinv(C, rcond=1e-9) @ body
        assert wrench @ body == pytest.approx(task.stiffness[i, i], rel=1e-6)


def test_under_a_load_the_tangent_says_how_far_a_little_more_moves_it(delta):
    """By the equilibria with and without it."""
    mechanism, W = cartstiff.load(delta), np.array([0, 0, 0, 30.0, 0, -200])
    result = cartstiff.analyse(mechanism, wrench=W)
    task, more = result.task_axes, np.array([0, 0, 0, 1e-3, 2e-3, 1e-3])
    held = result.elastic  # its springs carry W here
    moved = cartstiff.equilibrium(held, result.q, wrench=W + more).pose[:3, 3]
    moved = moved - cartstiff.equilibrium(held, result.q, wrench=W).pose[:3, 3]
    assert moved == pytest.approx(np.linalg.solve(task.tangent, more[3:]), rel=1e-4)


def test_six_freedoms_have_none():
    assert cartstiff.analyse(cartstiff.load("delta")).task_axes is None
    assert "task_axes" not in answer("analyse ur5")
