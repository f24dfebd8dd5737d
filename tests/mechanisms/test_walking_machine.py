"""A four-legged robot on its feet: the body is free, the feet are points of the ground."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from tests.mechanisms.machines import codes, write_file
from tests.mechanisms.oracle import GRAVITY, Held, displaced, missed
from tests.support import absolute_error, body_jacobian, frame_pose, relative_error, robot_file

from cartstiff import ConvergenceError, InputError, analyse, load

# Differences of the reduced energy and of the load, step 0.005.
DIFFERENCES = 1e-9
# Two exact assemblies of the same springs.
SAME = 1e-10
# Closures met, and a branch found again.
ASSEMBLED = 1e-11

LEGS = ("FL", "FR", "HL", "HR")
JOINTS = ("HAA", "HFE", "KFE")
STIFFNESS = {"HAA": 30.0, "HFE": 40.0, "KFE": 25.0}
STANCE = {leg: {"HAA": 0.1 if leg[1] == "L" else -0.1, "HFE": 0.8, "KFE": -1.5} for leg in LEGS}


@pytest.fixture
def solo(tmp_path):
    model = robot_file("solo_description/robots/solo12.urdf")
    return load(
        write_file(
            tmp_path,
            "solo",
            kind="closed-chain",
            model=model,
            frame="base_link",
            floating=True,
            closures=[{"frames": ["world", f"{leg}_FOOT"], "type": "point"} for leg in LEGS],
            q={f"{leg}_{j}": STANCE[leg][j] for leg in LEGS for j in JOINTS},
            springs={f"{leg}_{j}": {"stiffness": STIFFNESS[j]} for leg in LEGS for j in JOINTS},
        )
    )


def _root(elastic):
    return [i for i, n in enumerate(elastic.names) if n.startswith("root")]


def test_stance(solo):
    """Eighteen coordinates, twelve closures, six freedoms; unloaded, the legs' sums."""
    result = analyse(solo)
    assert (result.q.size, result.reduction.freedoms) == (18, 6)
    assert codes(result) == []
    # Leg by leg, with Pinocchio's Jacobian of the robot with its body held: the foot is a ball.
    model = pin.buildModelFromUrdf(robot_file("solo_description/robots/solo12.urdf"))
    q = np.array([STANCE[n[:2]][n[3:]] for n in list(model.names)[1:]])
    k = np.array([STIFFNESS[n[3:]] for n in list(model.names)[1:]])
    total = np.zeros((6, 6))
    for leg in LEGS:
        J = body_jacobian(model, q, f"{leg}_FOOT")[3:]
        T = frame_pose(model, q, f"{leg}_FOOT")
        C = T[:3, :3] @ (J / k @ J.T) @ T[:3, :3].T
        x, y, z = T[:3, 3]
        # Motion of the foot's place if the body moves: v + w x p.
        A = np.hstack([np.array([[0, z, -y], [-z, 0, x], [y, -x, 0]]), np.eye(3)])
        total += A.T @ np.linalg.inv(C) @ A
    for name in "ABK":
        assert relative_error(result.matrices[name], total) <= SAME


@pytest.mark.parametrize("case", ["held away from rest", "standing", "squeezing the ground"])
def test_against_energy_differences(solo, case):
    if case == "standing":
        result = analyse(replace(solo, gravity=GRAVITY))
        assert np.abs(result.closure_forces).max() > 1.0
    elif case == "squeezing the ground":
        result = analyse(*displaced(solo, None, 0.15, seed=3))
        assert np.abs(result.closure_forces).max() > 5.0
        assert np.abs(result.wrench).max() <= SAME * np.abs(result.closure_forces).max()
    else:
        by = np.array([0.03, -0.04, 0.05, 0.004, -0.006, -0.01])
        result = analyse(*displaced(solo, by, 0.1, seed=4))
        assert np.abs(result.wrench).max() > 5.0
    assert max(missed(result, Held(result.elastic, result.q), 0.005)[:2]) <= DIFFERENCES


def test_the_branch_is_kept_there_and_back(solo):
    """The body is led in small steps; the knees follow and stay bent the way they were."""
    chain, root = solo.mechanism, _root(solo)
    away = np.array([0.03, -0.02, -0.05, 0.1, -0.15, 0.2])
    q = solo.q
    trail = [q]
    for _ in range(20):
        guess = q.copy()
        guess[root] += away / 20
        q = chain.closed(guess, hold=root).q
        assert absolute_error(q[root], guess[root]) == 0.0
        trail.append(q)
    assert absolute_error(q, solo.q) > 0.2
    knees = [i for i, n in enumerate(solo.names) if n.endswith("KFE")]
    assert all((step[knees] < -0.3).all() for step in trail)
    for before in trail[-2::-1]:
        guess = q.copy()
        guess[root] -= away / 20
        q = chain.closed(guess, hold=root).q
        assert absolute_error(q, before) <= ASSEMBLED
    assert absolute_error(q, solo.q) <= ASSEMBLED


@pytest.mark.parametrize(("spread", "least"), [(0.1, 200), (1.0, 0)])
def test_guesses_converge_or_are_refused(solo, spread, least):
    """Never an open loop passed as a closed one, never another kind of failure."""
    rng = np.random.default_rng(20)
    chain, closed, left = solo.mechanism, 0, []
    for _ in range(200):
        guess = solo.q + spread * rng.uniform(-1, 1, solo.q.size)
        try:
            posture = chain.closed(guess)
        except ConvergenceError as refused:
            left.append(refused.residual)
            continue
        closed += 1
        assert np.isfinite(posture.q).all()
        assert np.abs(posture.residual).max() <= ASSEMBLED
    assert closed >= least
    assert min(left, default=1.0) > ASSEMBLED


@pytest.mark.parametrize("name", ["six legs", "3-rrr", "delta"])
def test_guesses_around_other_mechanisms(name):
    elastic = load("6-ups" if name == "six legs" else name)
    rng = np.random.default_rng(21)
    for _ in range(20):
        guess = elastic.q + 0.05 * rng.uniform(-1, 1, elastic.q.size)
        posture = elastic.mechanism.closed(guess)
        assert np.abs(posture.residual).max() <= ASSEMBLED


def test_feet_too_far_apart_are_refused(tmp_path):
    """Two footholds five metres apart: the loops cannot be closed, and loading says so."""
    model = robot_file("solo_description/robots/solo12.urdf")
    path = write_file(
        tmp_path,
        "split",
        kind="closed-chain",
        model=model,
        frame="base_link",
        floating=True,
        closures=[
            {"frames": ["world", f], "type": "point", "points": [[0, y, 0], [0, 0, 0]]}
            for f, y in (("FL_FOOT", 0.0), ("HR_FOOT", 5.0))
        ],
    )
    with pytest.raises(InputError, match="cannot be assembled"):
        load(path)


def test_length_of_a_free_body(solo):
    """Axes of the free base meet in its origin: the legs' axes give the length, not rounding."""
    lengths = [analyse(solo).posture.length]
    rng = np.random.default_rng(22)
    for _ in range(5):
        lengths.append(solo.mechanism.at(solo.q + 0.2 * rng.uniform(-1, 1, 18)).length)
    assert 0.1 < min(lengths) <= max(lengths) < 1.0
