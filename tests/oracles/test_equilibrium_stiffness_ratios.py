"""Equilibria of springs over nine decades, against a solution with forty digits."""

import mpmath as mp
import numpy as np
import pytest
from tests.doors import with_rest_balancing
from tests.support import (
    absolute_error,
    hexagons,
    platform_mechanism,
    refused,
    robot_file,
)

import cartstiff
from cartstiff import DeadForce, equilibrium
from cartstiff.geometry import se3

# Rounding of six joint angles of size 1, and what it does to a reach of one metre.
ROUNDED = 1e-14


def placed(T, screw, q):
    """T exp(screw q) for a revolute joint whose axis passes through its frame's origin."""
    axis = [mp.mpf(float(x)) for x in screw[:3]]
    K = mp.matrix([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    R = mp.eye(3) + mp.sin(q) * K + (1 - mp.cos(q)) * K * K
    turn = mp.eye(4)
    for i in range(3):
        for j in range(3):
            turn[i, j] = R[i, j]
    return mp.matrix(T.tolist()) * turn


def exact(elastic, force):
    """Joint angles at rest: k (q - rest) = (axis x arm) . F for every joint."""
    tree, chain = elastic.mechanism.tree, elastic.mechanism
    placements, screws = tree.placements(), tree.screws()
    k = [mp.mpf(float(x)) for x in elastic.springs.stiffness]
    rest = [mp.mpf(float(x)) for x in elastic.springs.rest]
    end = mp.matrix(chain.body.T_j_f.tolist())
    F = mp.matrix(np.asarray(force).tolist())

    def deflections(*x):
        T, axes, centres = mp.eye(4), [], []
        for placement, screw, r, d in zip(placements, screws, rest, x, strict=True):
            T = T * placed(placement, screw, r + d)
            axes.append(T[:3, :3] * mp.matrix(screw[:3].tolist()))
            centres.append(T[:3, 3])
        tip = (T * end)[:3, 3]
        return axes, centres, tip

    def missed(*x):
        axes, centres, tip = deflections(*x)
        torques = []
        for a, c in zip(axes, centres, strict=True):
            r = tip - c
            lever = mp.matrix(
                [a[1] * r[2] - a[2] * r[1], a[2] * r[0] - a[0] * r[2], a[0] * r[1] - a[1] * r[0]]
            )
            torques.append((lever.T * F)[0])
        return [d - t / s for d, t, s in zip(x, torques, k, strict=True)]

    x = mp.findroot(missed, [mp.mpf(0)] * len(k), tol=mp.mpf(10) ** -50, maxsteps=60)
    tip = deflections(*x)[2]
    return np.array([float(r + d) for r, d in zip(rest, x, strict=True)]), [float(t) for t in tip]


@pytest.mark.parametrize("seed", range(8))
def test_springs_over_nine_decades_come_to_rest_where_forty_digits_say(seed):
    robot_file("ur_description/urdf/ur5_robot.urdf")
    rng = np.random.default_rng(seed)
    stiffness = 10 ** rng.uniform(2.5, 11.5, 6)
    elastic = cartstiff.load("ur5").with_springs(stiffness)
    force = rng.normal(size=3) * 30.0
    elastic = with_rest_balancing(elastic, elastic.q)
    state = equilibrium(elastic, DeadForce(force), limits=False)
    with mp.workdps(40):
        q, tip = exact(elastic, force)
    assert absolute_error(state.q, q) < ROUNDED
    assert absolute_error(state.pose[:3, 3], tip) < ROUNDED
    assert state.stable
    assert state.residual < 1e-12


@pytest.mark.parametrize("rigid", [1e9, 1e11, 4e12])
def test_a_nearly_rigid_joint_does_not_excuse_the_others(rigid):
    robot_file("ur_description/urdf/ur5_robot.urdf")
    elastic = cartstiff.load("ur5").with_springs([rigid, 3e4, 2e4, 5e3, 5e3, 4e3])
    elastic = with_rest_balancing(elastic, elastic.q)
    state = equilibrium(elastic, DeadForce([0.0, 0.0, -100.0]))
    with mp.workdps(40):
        _, tip = exact(elastic, [0.0, 0.0, -100.0])
    moved = (state.pose - state.start.pose)[2, 3]
    assert moved == pytest.approx(tip[2] - state.start.pose[2, 3], rel=1e-12)
    assert moved == pytest.approx(-2.7656e-3, rel=1e-4)
    assert state.stable
    # What the load exerts is printed, though the stiffest spring's rounding is larger.
    elastic = state.elastic_stiffness
    assert elastic.wrench is not None
    shown = state.pose[:3, :3] @ elastic.shown_wrench(elastic.wrench)[3:]
    assert shown == pytest.approx([0.0, 0.0, -100.0], abs=1e-12)


def test_the_smallest_eigenvalue_beside_the_stiffest_spring():
    robot_file("ur_description/urdf/ur5_robot.urdf")
    soft = np.array([3e4, 2e4, 5e3, 5e3, 4e3])
    plain = cartstiff.load("ur5").with_springs([1e6, *soft])
    stiff = cartstiff.load("ur5").with_springs([1e12, *soft])
    load = DeadForce([20.0, 30.0, -100.0])
    expected = equilibrium(plain, load).eigenvalues
    # What the base joint gives at 1e6 softens the others by the square of the coupling over 1e6.
    assert equilibrium(stiff, load).eigenvalues[:5] == pytest.approx(expected[:5], rel=1e-6)


def test_springs_further_apart_are_refused_with_the_cure():
    """1e14 N m/rad times the rounding of an angle is 0.02 N m: double precision ends before."""
    robot_file("ur_description/urdf/ur5_robot.urdf")
    load = DeadForce([0.0, 0.0, -100.0])
    stiff = cartstiff.load("ur5").with_springs([3e4, 1e14, 2e4, 5e3, 5e3, 4e3])
    words = r"shoulder_lift_joint with 1e\+14 N m/rad and wrist_3_joint with 4e\+03 N m/rad"
    for ask in (equilibrium, cartstiff.load_curve):
        caught = refused(words, ask, stiff, load)
        assert "rigid" in str(caught)
    rigid = cartstiff.load("ur5").with_springs({"shoulder_lift_joint": np.inf})
    assert equilibrium(rigid, load).stable
    corners = np.pi / 3 * np.arange(6)
    ring = np.stack([np.cos(corners), np.sin(corners), 0 * corners], axis=1)
    k = [1e10, 1e3, 1.0, 1e3, 1e3, 1e3]
    q = [0.0, 0.0, 0.5, 0.0, 0.0, 0.3]
    body = platform_mechanism(0.5 * ring, 0.3 * ring[::-1], k, np.full(6, np.nan), q=q)
    refused(r"leg1 with 1e\+10 N/m and leg3 with 1 N/m", equilibrium, body)


@pytest.mark.parametrize("name", ["3-rrr", "delta"])
def test_closed_chains_with_a_stiff_motor_approach_the_limit(name):
    """What a motor gives falls as 1 / stiffness: the difference to 1e9 is predicted by 1e8."""
    elastic = cartstiff.load(name)
    motors = np.flatnonzero(elastic.springs.stiffness > 0.0)
    scale = float(elastic.springs.stiffness[motors].max())
    load = DeadForce([0.3, -0.2, 0.0])

    def moved(factor):
        k = elastic.springs.stiffness.copy()
        k[motors[1]] = factor * scale
        state = equilibrium(elastic.with_springs(k), load, limits=False)
        return state.pose[:3, 3] - state.start.pose[:3, 3]

    limit = 2.0 * moved(2e6) - moved(1e6)
    size = np.abs(limit).max()
    for factor in (1e8, 1e9):
        assert absolute_error(moved(factor), limit) < 1e-6 * size


def test_a_posture_that_rounding_hides_is_named():
    """Legs of 1e6 beside 1e-3 near a singularity: 1e-12 N of a stiff leg is less than its rounding.

    The linear motion under the same load, from springs kept apart, is what is missed.
    """
    elastic = hexagons(1e-5, [1e6, 1.1e5, 1.4, 330.0, 1e-3, 105.0])
    load = np.array([2e-6, -1e-6, 3e-6, 1e-6, 0.0, 2e-6])
    C = cartstiff.analyse(elastic).compliances["B"]
    load *= 1e-8 / np.abs(C @ load).max()  # linear over a share of the distance
    state = equilibrium(elastic, wrench=load)
    expected = C @ load
    twist = se3.log(se3.inverse(state.start.pose) @ state.pose)
    missed = absolute_error(twist, expected)
    notes = {n.code: n for n in state.notes}
    told = notes["posture-unresolved"].values["largest"] if "posture-unresolved" in notes else 0.0
    assert missed < max(1e-3 * np.abs(expected).max(), 4.0 * told)
    assert told > 1e-9
    plain = elastic.with_springs([100.0, 200.0, 300.0, 150.0, 120.0, 90.0])
    assert "posture-unresolved" not in {n.code for n in equilibrium(plain, wrench=load).notes}
