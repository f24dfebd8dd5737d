"""Laws that every mechanism obeys, and the names of its special states."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from tests.doors import (
    SCHEMA,
    SI,
    Chain,
    Note,
    PolynomialLaw,
    Struts,
    Units,
    plain_tree,
    with_rest_balancing,
)
from tests.support import (
    absolute_error,
    add_frame,
    adjoint_reference,
    body_jacobian,
    cross_matrix,
    exp_reference,
    general_legs,
    legs_as_platform,
    legs_as_tree,
    loaded_arm,
    matrices_from,
    paper_platform,
    platform_mechanism,
    random_pose,
    refused,
    relative_error,
    translation,
)

from cartstiff import (
    DeadForce,
    ElasticMechanism,
    JointFunction,
    JointSprings,
    LineSprings,
    PoseFunction,
    UndefinedError,
    analyse,
)
from cartstiff.extend import Coordinate, Gravity, Platform

ROUNDING = 1e-12
# Sums and differences of matrices with condition numbers up to a thousand.
ADDED = 1e-10
# Required: with the load's own potential included all connections agree.
CONSERVATIVE = 1e-10


def _redundant() -> ElasticMechanism:
    return loaded_arm("RRRRRRR", 1).elastic


MECHANISMS = {
    "six joints": lambda: loaded_arm("RRRPRR", 2).elastic,
    "seven joints": _redundant,
    "platform": lambda: legs_as_platform(general_legs()),
    "tree with closures": lambda: legs_as_tree(general_legs(), passive=50.0, passive_torque=2.0)[1],
}
EVERY = pytest.mark.parametrize("build", MECHANISMS.values(), ids=MECHANISMS.keys())


def _dead_wrench(T0: np.ndarray, W: np.ndarray) -> list[DeadForce]:
    """Forces constant in the world on three points of the body that add up to W at T0."""
    points = 0.4 * np.array([[1.0, 0.2, 0.0], [-0.3, 1.0, 0.1], [0.0, -0.2, 1.0]])
    spread = np.hstack([np.vstack([cross_matrix(p), np.eye(3)]) for p in points])
    forces = np.linalg.lstsq(spread, W, rcond=None)[0].reshape(3, 3) @ T0[:3, :3].T
    return [DeadForce(f, p) for f, p in zip(forces, points, strict=True)]


@EVERY
def test_conservative_load_makes_all_connections_agree(build):
    elastic = build()
    alone = analyse(elastic)
    assert np.abs(alone.wrench).max() > 1.0
    dead = _dead_wrench(alone.pose, alone.wrench)
    result = analyse(replace(elastic, potentials=(*elastic.potentials, *dead)))
    assert np.abs(result.wrench).max() <= CONSERVATIVE * np.abs(alone.wrench).max() * 10
    K = result.matrices["B"]
    for name, matrix in result.matrices.items():
        if matrix is not None:
            assert relative_error(matrix, K) <= CONSERVATIVE, name
    # And it is the sum of what holds and what loads, not K^B alone: R^T f turns against the body.
    if "seven" not in elastic.name and elastic.name != "RRRRRRR":
        K_dead = np.zeros((6, 6))
        for load in dead:
            p, f = load.point, load.force @ alone.pose[:3, :3]
            K_dead[:3, :3] -= cross_matrix(p) @ cross_matrix(f)
            K_dead[3:, :3] -= cross_matrix(f)
        expected = alone.matrices["B"] + 0.5 * (K_dead + K_dead.T)
        assert relative_error(K, expected) <= ADDED


@EVERY
def test_energies_add(build):
    """Potentials of the body itself add to W and to every K of an invariant connection."""
    elastic = build()
    rng = np.random.default_rng(3)
    extra = LineSprings(
        anchors=rng.normal(size=(2, 3)) + 2,
        points=0.2 * rng.normal(size=(2, 3)),
        stiffness=rng.uniform(10, 50, 2),
        rest_length=rng.uniform(0.5, 1.5, 2),
    )
    alone = analyse(elastic)
    energy, W, K_B = extra.on_pose(alone.pose)
    both = analyse(elastic.with_potential(extra))
    assert both.energy == pytest.approx(alone.energy + energy, rel=ROUNDING)
    assert relative_error(both.wrench, alone.wrench + W) <= ADDED
    t, f = cross_matrix(W[:3]), cross_matrix(W[3:])
    K_A = K_B + 0.5 * np.block([[t, f], [f, np.zeros((3, 3))]])
    for name, K in matrices_from(K_A, W).items():
        total = alone.tensor(name).matrix + K
        assert relative_error(both.tensor(name).matrix, total) <= ADDED, name


@EVERY
def test_load_and_asymmetry(build):
    result = analyse(build())
    for name in ("A", "B", "K", "+"):
        t = result.tensor(name)
        size = np.abs(t.matrix).max()
        assert absolute_error(t.asymmetry, t.predicted_asymmetry) <= ROUNDING * size * 100
        assert np.array_equal(t.wrench, result.wrench)
        assert np.array_equal(t.pose, result.pose)
    for name in "ABK":
        assert relative_error(result.tensor(name).matrix, result.matrices[name]) <= ROUNDING
        assert absolute_error(result.compliances[name] @ result.matrices[name], np.eye(6)) <= 1e-8
    assert result.A.connection.name == "A"
    assert result.B.connection.name == "B"
    assert result.K.connection.name == "K"


@EVERY
def test_moving_everything_changes_nothing(build):
    """Left invariance: body components do not know where the inertial frame is.

    Shown by energies that depend on the joints only; the posture's gravity would differ.
    """
    elastic = build()
    result = analyse(elastic)
    if isinstance(elastic.mechanism, Platform):
        h = random_pose(np.random.default_rng(4))
        m, springs = elastic.mechanism, elastic.springs
        moved = platform_mechanism(
            m.anchors @ h[:3, :3].T + h[:3, 3],
            m.points_P,
            springs.stiffness,
            springs.rest_length,
        )
        q = moved.mechanism.coordinates_of(h @ result.pose)
        other = analyse(moved, q)
        assert relative_error(other.pose, h @ result.pose) <= ROUNDING
    else:
        other = analyse(_rebased(elastic, random_pose(np.random.default_rng(4))))
    for name in "ABK":
        assert relative_error(other.matrices[name], result.matrices[name]) <= ADDED


def _rebased(elastic: ElasticMechanism, h: np.ndarray) -> ElasticMechanism:
    """The same chain with all joints of the root moved by h."""
    chain = elastic.mechanism
    model = chain.tree.model.copy()
    for i in range(1, model.njoints):
        if int(model.parents[i]) == 0:
            model.jointPlacements[i] = pin.SE3(h) * model.jointPlacements[i]
    tree = type(chain.tree)(model, chain.coordinates, chain.tree.frames)
    moved = Chain(
        tree, chain.frame, closures=chain.closures, actuated=chain.actuated, kind=chain.kind
    )
    return replace(elastic, mechanism=moved)


@EVERY
def test_scaling_all_springs(build):
    """Twice the stiffness everywhere: twice W and K, the same shape."""
    elastic = build()
    twice = replace(
        elastic,
        springs=elastic.springs.replaced(2 * elastic.springs.stiffness, elastic.springs.rest),
    )
    a, b = analyse(elastic), analyse(twice)
    assert relative_error(b.wrench, 2 * a.wrench) <= ADDED
    for name in "ABK":
        assert relative_error(b.matrices[name], 2 * a.matrices[name]) <= ADDED


# -- giving the load ----------------------------------------------------------------------------


@pytest.mark.parametrize("kinds", ["RRRRRR", "RRRRRRR", "RPRRRRRR"])
def test_load_given(kinds):
    arm = loaded_arm(kinds, 5)
    W = np.array([1.0, 2.0, -1.0, 4.0, -3.0, 2.0])
    before = arm.elastic.springs.rest.copy()
    result = analyse(arm.elastic, wrench=W)
    assert relative_error(result.wrench, W) <= ADDED
    torque = body_jacobian(arm.model, arm.q, "tip").T @ W
    assert relative_error(result.evaluation.gradient, torque) <= ADDED
    assert np.array_equal(arm.elastic.springs.rest, before)  # the mechanism given is as it was
    again = analyse(result.elastic)
    assert relative_error(again.matrices["A"], result.matrices["A"]) <= ADDED


def test_open_rest_positions_carry_gravity():
    arm = loaded_arm("RRRRRRR", 6)
    k = arm.elastic.springs.stiffness
    g = np.array([0, 0, -9.81])
    elastic = replace(arm.elastic, springs=JointSprings(k, np.full(7, np.nan)), gravity=g)
    result = analyse(elastic)
    assert np.abs(result.wrench).max() <= 1e-10
    assert relative_error(result.matrices["A"], result.matrices["K"]) <= CONSERVATIVE
    torque = result.elastic.springs.evaluate(result.posture).gradient
    weight = Gravity(g).evaluate(result.posture).gradient
    assert np.abs(torque + weight).max() <= ROUNDING * np.abs(weight).max() * 100
    once = with_rest_balancing(elastic, elastic.q)
    assert with_rest_balancing(once, elastic.q) is not None


def test_nonlinear_springs_are_loaded_too():
    arm = loaded_arm("RRRRRR", 7)
    laws = {2: PolynomialLaw((80.0, 0.0, 900.0))}
    springs = JointSprings(arm.elastic.springs.stiffness, np.full(6, np.nan), laws)
    result = analyse(replace(arm.elastic, springs=springs), wrench=arm.wrench)
    assert relative_error(result.wrench, arm.wrench) <= ADDED
    x = arm.q[2] - result.elastic.springs.rest[2]
    assert result.evaluation.hessian[2, 2] == pytest.approx(80 + 2700 * x**2, rel=1e-9)


def test_joint_function_equals_springs():
    arm = loaded_arm("RRRRRR", 8)
    k, rest = arm.elastic.springs.stiffness, arm.elastic.springs.rest
    function = JointFunction(lambda q: 0.5 * float(k @ (q - rest) ** 2))
    free = replace(arm.elastic, springs=JointSprings(np.zeros(6), arm.q), potentials=(function,))
    a, b = analyse(arm.elastic), analyse(free)
    for name in "ABKF":
        assert relative_error(b.matrices[name], a.matrices[name]) <= 1e-8


# -- with_springs and friends -------------------------------------------------------------------


def test_with_springs():
    elastic = loaded_arm("RRR", 1).elastic
    assert elastic.with_springs() is elastic
    one = elastic.with_springs(5.0)
    assert np.array_equal(one.springs.stiffness, [5.0] * 3)
    assert np.array_equal(one.springs.rest, elastic.springs.rest)
    some = elastic.with_springs({"j2": 7.0}, rest={"j3": 0.25})
    assert some.springs.stiffness[1] == 7.0
    assert some.springs.stiffness[0] == elastic.springs.stiffness[0]
    assert some.springs.rest[2] == 0.25
    assert some.springs.rest[0] == elastic.springs.rest[0]
    listed = elastic.with_springs([1, 2, 3], rest=[0, 0, 0])
    assert np.array_equal(listed.springs.stiffness, [1.0, 2.0, 3.0])
    assert np.array_equal(elastic.with_springs(rest=0.5).springs.rest, [0.5] * 3)


def test_masses_of_legs_are_the_same_by_their_numbers():
    one, same = (Struts(*np.ones((5, 6))) for _ in range(2))
    assert one == same
    assert one != replace(one, moving=2.0 * one.moving)


def test_with_springs_replaces_laws_and_assumptions():
    law = PolynomialLaw((1.0, 0.0, 2.0))
    elastic = loaded_arm("RRR", 1).elastic
    springs = JointSprings([1.0, 1.0, 1.0], [0.0, 0.0, 0.0], {0: law, 1: law})
    assumed = Note("stiffness-assumed", "one number for all joints")
    kept = Note("frame-assumed", "the last one")
    elastic = replace(elastic, springs=springs, notes=(assumed, kept))
    changed = elastic.with_springs({"j1": 3.0})
    assert set(changed.springs.laws) == {1}
    assert changed.notes == (kept,)
    assert set(elastic.with_springs(3.0).springs.laws) == set()
    assert elastic.with_springs(rest=0.1).notes == (assumed, kept)
    assert set(elastic.with_springs(rest=0.1).springs.laws) == {0, 1}


def test_names_and_units():
    elastic = loaded_arm("RPH", 1).elastic
    assert elastic.names == ("j1", "j2", "j3")
    assert elastic.units == SI
    assert [c.type for c in elastic.mechanism.coordinates] == ["revolute", "prismatic", "helical"]
    assert Coordinate("a", "prismatic").is_length
    assert paper_platform().units == Units("cm", "N")
    note = Note("code", "words", {"x": 1})
    assert note.to_dict() == {"code": "code", "message": "words", "values": {"x": 1}}


def test_coordinates_by_name():
    elastic = loaded_arm("RRRRRR", 1).elastic
    q = elastic.q.copy()
    q[3] = 0.77
    assert np.array_equal(analyse(elastic, {"j4": 0.77}).q, q)
    assert np.array_equal(analyse(elastic).q, elastic.q)
    platform = analyse(paper_platform(), {"z": 0.5})
    assert platform.pose[2, 3] == 0.5


# -- platforms ----------------------------------------------------------------------------------


def test_platform_poses():
    rng = np.random.default_rng(9)
    T_P_M = random_pose(rng)
    platform = Platform(rng.normal(size=(6, 3)), rng.normal(size=(6, 3)), T_P_M=T_P_M)
    q = np.array([0.1, -0.2, 0.9, 0.3, -0.4, 0.5])
    T = platform.pose_of(q)
    x, y, z = (exp_reference([*(a * e), 0, 0, 0]) for a, e in zip(q[3:], np.eye(3), strict=True))
    assert absolute_error(T, translation(*q[:3]) @ z @ y @ x @ T_P_M) <= ROUNDING
    assert absolute_error(platform.coordinates_of(T), q) <= ROUNDING
    step = 0.1 * rng.normal(size=6)
    moved = platform.pose_of(platform.displaced(q, step))
    assert absolute_error(moved, T @ exp_reference(step)) <= ROUNDING
    # The points in M are the points in P seen from M.
    T_M_P = np.linalg.inv(T_P_M)
    assert (
        absolute_error(platform.points, platform.points_P @ T_M_P[:3, :3].T + T_M_P[:3, 3])
        <= ROUNDING
    )
    T_body_world, to_pose = platform.at(q).relative("body", "world")
    assert absolute_error(T_body_world @ T, np.eye(4)) <= ROUNDING
    assert np.abs(to_pose.jacobian + adjoint_reference(T)).max() <= ROUNDING * 10
    same, still = platform.at(q).relative("body", "body")
    assert np.array_equal(same, np.eye(4))
    assert not still.jacobian.any()


@pytest.mark.parametrize("seed", range(4))
def test_forward_kinematics(seed):
    """Leg lengths of a pose, and back from a start nearby."""
    rng = np.random.default_rng(seed)
    legs = general_legs()
    platform = legs_as_platform(legs).mechanism
    q = legs.q + 0.1 * rng.uniform(-1, 1, 6)
    lengths = platform.leg_lengths(q)
    T = platform.pose_of(q)
    points = legs.platform @ T[:3, :3].T + T[:3, 3]
    assert absolute_error(lengths, np.linalg.norm(points - legs.base, axis=1)) <= ROUNDING
    found = platform.forward_kinematics(lengths, legs.q)
    assert absolute_error(found, q) <= 1e-10
    assert absolute_error(platform.leg_lengths(found), lengths) <= 1e-14


def test_forward_kinematics_of_the_paper():
    platform = paper_platform().mechanism
    q = np.array([0.4, -0.3, 0.5, 0.05, -0.04, 0.06])
    found = platform.forward_kinematics(platform.leg_lengths(q), np.zeros(6))
    assert absolute_error(found, q) <= 1e-9


@pytest.mark.parametrize("count", [3, 5, 7, 8])
def test_other_numbers_of_lines(count):
    """No chart of leg lengths, and still a stiffness of the pose."""
    rng = np.random.default_rng(count)
    base, points = 2 * rng.normal(size=(count, 3)), rng.normal(size=(count, 3))
    elastic = platform_mechanism(base, points, np.full(count, 10.0), np.full(count, 1.0))
    result = analyse(elastic)
    assert result.matrices["F"] is None
    assert result.jacobian is None
    assert [n.code for n in result.notes] == ["kf-undefined"]
    assert f"there are {count} lines" in result.notes[0].message
    total = sum(
        platform_mechanism(
            base[[s]], points[[s]], np.array([10.0]), np.array([1.0])
        ).springs.on_pose(np.eye(4))[2]
        for s in range(count)
    )
    assert relative_error(result.matrices["B"], total) <= ROUNDING


def test_characteristic_lengths():
    """A pure number decides about rank, so the length must follow the machine's size."""
    a, b = paper_platform().mechanism, paper_platform(scale=0.01).mechanism
    assert b.length == pytest.approx(0.01 * a.length, rel=ROUNDING)
    assert Platform(np.zeros((1, 3)), np.zeros((1, 3))).length == 1.0
    assert Platform(np.ones((1, 3)), np.zeros((1, 3))).length == 1.0
    arm = loaded_arm("RRRRRR", 1)
    posture = arm.elastic.mechanism.at(arm.q)
    J = body_jacobian(arm.model, arm.q, "tip")
    expected = np.sqrt(np.sum(J[3:] ** 2) / 6)
    assert posture.length == pytest.approx(expected, rel=1e-9)
    sliding = loaded_arm("PPP", 1)
    assert sliding.elastic.mechanism.at(sliding.q).length == 1.0
    assert np.array_equal(sliding.elastic.mechanism.at(sliding.q).coordinate_lengths, np.ones(3))


# -- states -------------------------------------------------------------------------------------


def test_slightly_unbalanced_postures_are_seen():
    arm = loaded_arm("RRRRRRR", 10)
    z = np.linalg.svd(body_jacobian(arm.model, arm.q, "tip"))[2][-1]
    k, rest = arm.elastic.springs.stiffness, arm.elastic.springs.rest
    size = np.abs(k * (arm.q - rest)).max()
    for share, seen in ((1e-6, True), (1e-11, False)):
        springs = JointSprings(k, rest - share * size * z / k)
        result = analyse(replace(arm.elastic, springs=springs))
        assert (result.matrices["B"] is None) == seen


def test_idle_joint():
    """A free joint along the axis of another: one combination of the two moves nothing."""
    model = pin.Model()
    joint = 0
    rng = np.random.default_rng(11)
    for i in range(6):
        axis = rng.normal(size=3)
        revolute = pin.JointModelRevoluteUnaligned(axis / np.linalg.norm(axis))
        joint = model.addJoint(joint, revolute, pin.SE3(random_pose(rng, 0.4)), f"j{i}")
    joint = model.addJoint(joint, pin.JointModelRZ(), pin.SE3(random_pose(rng, 0.3)), "twist1")
    joint = model.addJoint(joint, pin.JointModelRZ(), pin.SE3(translation(0, 0, 0.2)), "twist2")
    add_frame(model, "tip", joint, translation(0.1, 0.0, 0.1))
    chain = Chain(plain_tree(model), "tip")
    q = rng.uniform(-1, 1, 8)
    k = np.array([90.0, 80, 70, 60, 50, 40, 0, 0])
    result = analyse(ElasticMechanism("idle", chain, q, JointSprings(k, q)))
    note = next(n for n in result.notes if n.code == "idle-self-motion")
    directions = np.array(note.values["directions"])
    assert np.abs(body_jacobian(model, q, "tip") @ directions.T).max() <= 1e-9
    assert np.abs(directions[:, :6]).max() <= 1e-9
    assert note.values["coupling"] <= 1e-9
    # The stiffness is that of the arm with the passive turn: five directions held, one free.
    eigenvalues = np.linalg.eigvalsh(result.matrices["B"])
    assert eigenvalues[0] == pytest.approx(0, abs=1e-9 * eigenvalues[-1])
    assert eigenvalues[1] > 1e-4


def test_no_chart():
    result = analyse(_redundant())
    for ask in (lambda: result.tensor("F"), result.flat_connection, lambda: result.F):
        caught = refused("this chain has 7", ask, kind=UndefinedError)
        assert caught.code == "kf-undefined"
    assert "F" in result.to_dict()["stiffness"]
    legs = legs_as_tree(general_legs())[1]
    chain = legs.mechanism
    unnamed = Chain(chain.tree, chain.frame, closures=chain.closures)
    reason = unnamed.at(legs.q).chart()
    assert reason == "K^F needs six actuated coordinates: the mechanism names none"


def test_analysis_closes_the_chain():
    """Coordinates that do not meet the closures are a start; actuated joints stay put."""
    _, elastic = legs_as_tree(general_legs())
    chain = elastic.mechanism
    actuated = list(chain.actuated)
    q = elastic.q.copy()
    passive = np.setdiff1d(np.arange(q.size), actuated)
    q[passive] += 0.05 * np.random.default_rng(13).uniform(-1, 1, passive.size)
    assert np.abs(chain.at(q).residual).max() > 1e-3
    result = analyse(elastic, q)
    assert np.abs(result.posture.residual).max() <= ROUNDING
    assert np.array_equal(result.q[actuated], q[actuated])
    assert absolute_error(result.q, elastic.q) <= 1e-9
    assert relative_error(result.matrices["A"], analyse(elastic).matrices["A"]) <= 1e-8


def test_given_wrench_that_the_springs_do_not_carry():
    """A deficient closed chain, its springs fixed: the wrench given may be none of theirs."""
    arm = loaded_arm("RRRR", 12)
    from tests.doors import reduce_to

    posture = arm.elastic.mechanism.at(arm.q)
    energy = arm.elastic.evaluate(posture)
    wrong = arm.wrench + 10.0
    reduction = reduce_to(
        posture.motion, energy, None, posture.length, posture.coordinate_lengths, force=wrong
    )
    assert "wrench-ignored" in [s.code for s in reduction.states]
    J = body_jacobian(arm.model, arm.q, "tip")
    assert absolute_error(J.T @ reduction.force, energy.gradient) <= 1e-9


# -- the printed object -------------------------------------------------------------------------


@EVERY
def test_as_dict(build):
    import json

    result = analyse(build())
    data = json.loads(json.dumps(result.to_dict(), allow_nan=False))
    assert data["schema"] == SCHEMA == "cartstiff/1"
    assert data["order"] == "angular-linear"
    assert set(data["stiffness"]) == set(data["compliance"]) == set("ABKF")
    assert data["mechanism"]["joints"] == list(result.elastic.names)
    assert data["units"] == {"length": "m", "force": "N", "angle": "rad"}
    assert np.array_equal(data["pose"], result.pose)
    assert np.array_equal(data["wrench"], result.wrench)
    assert np.array_equal(data["stiffness"]["A"], result.matrices["A"])
    assert data["energy"] == result.energy
    has_chart = result.matrices["F"] is not None
    assert (data["stiffness"]["F"] is not None) == has_chart
    notes = [n for n in data["notes"] if n["code"] != "implausible-deflection"]
    assert (notes == []) == has_chart


def test_as_dict_without_an_energy():
    """A load that has no potential: energy NaN becomes null."""
    follower = PoseFunction(
        energy=lambda T: np.nan, wrench=lambda T: np.ones(6), stiffness=lambda T: np.zeros((6, 6))
    )
    result = analyse(loaded_arm("RRRRRR", 1).elastic.with_potential(follower))
    assert result.to_dict()["energy"] is None
