"""A dead moment on a planar machine has the potential -m * angle: its stability is decided."""

import numpy as np
import pytest

from cartstiff import DeadForce, DeadWrench, FollowerWrench, equilibrium, load, load_curve

COLUMN = """<robot name="column">
  <link name="ground"/> <link name="lower"/> <link name="upper"/> <link name="top"/>
  <joint name="foot" type="revolute">
    <parent link="ground"/> <child link="lower"/> <axis xyz="{axis}"/>
    <limit lower="-7" upper="7" effort="0" velocity="0"/>
  </joint>
  <joint name="knee" type="revolute">
    <parent link="lower"/> <child link="upper"/> <origin xyz="1 0 0"/> <axis xyz="0 0 1"/>
    <limit lower="-7" upper="7" effort="0" velocity="0"/>
  </joint>
  <joint name="end" type="fixed">
    <parent link="upper"/> <child link="top"/> <origin xyz="1 0 0" rpy="0.3 0.4 0.5"/>
  </joint>
</robot>
"""
K = np.array([100.0, 60.0])


def column(tmp_path, axis="0 0 1"):
    path = tmp_path / "column.urdf"
    path.write_text(COLUMN.format(axis=axis))
    return load(path).with_springs(K.tolist(), [0.0, 0.0])


def energy(q, moment, force):
    a, b = q[0], q[0] + q[1]
    end = np.array([np.cos(a) + np.cos(b), np.sin(a) + np.sin(b)])
    return 0.5 * float(K @ np.square(q)) - moment * b - float(force @ end)


def derivatives(q, moment, force, h=1e-4):
    e = h * np.eye(2)
    g = [(energy(q + d, moment, force) - energy(q - d, moment, force)) / (2 * h) for d in e]
    H = [
        [
            energy(q + a + b, moment, force)
            - energy(q + a - b, moment, force)
            - energy(q - a + b, moment, force)
            + energy(q - a - b, moment, force)
            for b in e
        ]
        for a in e
    ]
    return np.array(g), np.array(H) / (4 * h * h)


@pytest.mark.parametrize("force", [(0.0, 0.0), (-20.0, 15.0), (-90.0, 1.0), (-300.0, 20.0)])
def test_stability_is_that_of_the_energy_with_the_angle(tmp_path, force):
    """Also about axes beside the normal, which turn nothing; stable and unstable equilibria."""
    arm, force, verdicts = column(tmp_path), np.array(force), set()
    for moment in (5.0, -30.0):
        wrench = [3.0, -4.0, moment, *force, 7.0]
        for settle in (True, False):
            state = equilibrium(arm, [0.2, -0.1], DeadWrench(wrench), settle=settle)
            g, H = derivatives(state.q, moment, force)
            assert np.abs(g).max() < 1e-5
            assert state.stable is bool(np.linalg.eigvalsh(H)[0] > 0.0)
            verdicts.add(state.stable)
            assert state.is_conservative
            assert "non-conservative" not in [note.code for note in state.notes]
    assert verdicts == ({True, False} if force[0] < -50.0 else {True})


def test_the_energy_is_that_of_the_angle_over_several_turns(tmp_path):
    arm, q = column(tmp_path), np.array([0.4, 0.3])
    for load_ in (DeadWrench([1.0, 2.0, 5.0, 0, 0, 0]), FollowerWrench([0, 0, 5.0, 0, 0, 0])):
        postures = [arm.mechanism.at(q + np.array([0.0, turn])) for turn in (0.0, 6.0)]
        before, after = (load_.evaluate(posture).energy for posture in postures)
        turned = -5.0 * 6.0
        if isinstance(load_, FollowerWrench):  # about an axis of the body, which is inclined
            turned *= float(postures[0].pose[2, 2])
        assert after - before == pytest.approx(turned, rel=1e-12)


def test_other_loads_and_machines_have_none(tmp_path):
    planar, spatial = column(tmp_path), column(tmp_path, "0 1 0")
    assert equilibrium(planar, FollowerWrench([0, 0, 5.0, -20.0, 0, 0])).stable is None
    assert equilibrium(spatial, DeadWrench([4.0, 3.0, 5.0, 0, 0, 0])).stable is None
    assert equilibrium(spatial, DeadForce([0, 5.0, 0])).stable is True


def test_machines_with_loops_and_their_curves():
    for name in ("five-bar", "4-rrr"):
        state = equilibrium(load(name), wrench=[0, 10.0, 20.0, 10.0, 5.0, 0])
        assert state.stable is True
    curve = load_curve(load("five-bar"), wrench=[0, 0, 40.0, 0, 0, 0], to=1.0)
    assert set(curve.stable) == {True}
    assert np.isfinite(curve.eigenvalue).all()
