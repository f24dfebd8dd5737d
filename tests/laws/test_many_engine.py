"""Many postures at once are the postures one by one: every way to compute them, every mechanism."""

from __future__ import annotations

from copy import copy
from dataclasses import replace

import numpy as np
import pinocchio
import pytest
from tests.doors import (
    OF_MANY,
    Array,
    Chain,
    CoupledSprings,
    KinematicTree,
    PolynomialLaw,
    Struts,
    TabulatedLaw,
    plain_tree,
    tensions_of,
)
from tests.support import absolute_error, add_frame, random_pose, serial_model

import cartstiff
from cartstiff import (
    DeadForce,
    ElasticMechanism,
    FollowerWrench,
    JointFunction,
    JointSprings,
    Postures,
    analyse_many,
    payload,
)
from cartstiff.extend import Coordinate

#: Two computations in double precision: relative to the largest entry,
AGREEMENT = 1e-12
#: or where a matrix is inverted, some rounding errors times its condition number.
PER_CONDITION = 3e-15

OPTIMISED = True
OUTPUTS = (
    *("pose", "jacobian", "wrench", "energy"),
    *(f"{kind}_{c}" for kind in ("stiffness", "compliance") for c in OF_MANY),
)
PATHS = ("portable", "compiled")
COUNT = 13  # not a multiple of any vector's length


def _condition(matrices: Array) -> Array:
    """Condition number of each of a stack; 1 where a matrix does not exist, or has lost rank."""
    exists = np.isfinite(matrices).all(axis=(1, 2))
    found = np.ones(len(matrices))
    found[exists] = np.linalg.cond(matrices[exists])
    return np.where(np.isfinite(found), found, 1.0)


def _noise(elastic: ElasticMechanism, q: Array) -> float:
    """Force that the springs exert over a rounding error of their deflection."""
    if elastic.springs is None:
        return 0.0
    reach = 1.0 + np.abs(q).max() if isinstance(elastic.springs, JointSprings) else 50.0
    return 1e-15 * float(elastic.springs.stiffness.max()) * reach


def assert_same(elastic: ElasticMechanism, q: Array, *paths: str, **options) -> list[Postures]:
    """Each path, all of them by default, has the engine's numbers and states; the answers."""
    outputs = options.pop("outputs", OUTPUTS)
    wanted = (*outputs, "jacobian")
    reference = analyse_many(elastic, q, outputs=wanted, path="engine", **options)
    answers = []
    for path in paths or PATHS:
        answers.append(analyse_many(elastic, q, outputs=outputs, path=path, **options))
        assert answers[-1].path == path
        _compare(elastic, q, outputs, answers[-1], reference)
    return answers


def _compare(elastic, q, outputs, found: Postures, reference: Postures) -> None:
    states = [reference.codes[i] for i in reference.state]
    assert [found.codes[i] for i in found.state] == states
    jacobian = _condition(reference["jacobian"])
    noise = _noise(elastic, q) * np.maximum(1.0, jacobian)
    for name in outputs:
        expected, got = reference[name], found[name]
        np.testing.assert_array_equal(np.isnan(got), np.isnan(expected), err_msg=name)
        condition = jacobian
        if name.startswith("compliance"):
            condition = _condition(reference[name]) * jacobian
        difference = np.abs(got - expected).reshape(len(q), -1)
        size = np.abs(expected).reshape(len(q), -1).max(axis=1, initial=0.0)
        allowed = size * np.maximum(AGREEMENT, PER_CONDITION * condition)
        if name in ("wrench", "energy"):
            allowed = allowed + noise
        worst = np.nanmax(difference, axis=1, initial=0.0)
        bad = ~(worst <= allowed) & ~np.isnan(size)
        assert not bad.any(), (name, worst[bad], allowed[bad], condition[bad])


def arm(kinds: str, seed: int = 0, rest: bool = False, gravity: bool = False) -> ElasticMechanism:
    rng = np.random.default_rng(seed)
    n = len(kinds)
    model = serial_model(kinds, rng)
    add_frame(model, "middle", min(n, 3), random_pose(rng, 0.2))
    chain = Chain(plain_tree(model), "tip")
    springs = JointSprings(
        rng.uniform(400.0, 1200.0, n), rng.uniform(-0.5, 0.5, n) if rest else np.full(n, np.nan)
    )
    field = np.array([0.3, -1.0, -9.81]) if gravity else None
    return ElasticMechanism(kinds, chain, np.zeros(n), springs, gravity=field)


def postures(elastic: ElasticMechanism, seed: int = 1, count: int = COUNT) -> Array:
    rng = np.random.default_rng(seed)
    if elastic.mechanism.kind in ("stewart-gough", "springs"):
        platform = elastic.mechanism
        size = np.array([0.1 * platform.length] * 3 + [0.15] * 3)
        return elastic.q + size * rng.uniform(-1, 1, (count, 6))
    return rng.uniform(-1.6, 1.6, (count, len(elastic.q)))


ARMS = ["PR", "RRPR", "RRRRRR", "RRPRRH", "HRRRRRP", "RRRRPRRRRRRR"]
# What is compiled is what runs over arrays: of these, every kind of joint once and redundancy.
COMPILED = ["PR", "RRPRRH", "RRRRRR", "HRRRRRP"]


@pytest.mark.parametrize("kinds", ARMS)
class TestArms:
    def test_unloaded(self, kinds):
        check_arm(kinds, arm(kinds))

    def test_rest_positions_and_gravity(self, kinds):
        check_arm(kinds, arm(kinds, rest=True, gravity=True))

    def test_a_wrench_for_each_and_gravity(self, kinds):
        wrench = np.random.default_rng(3).normal(size=(COUNT, 6)) * 4
        check_arm(kinds, arm(kinds, gravity=True), wrench=wrench)


def check_arm(kinds, elastic, **load):
    paths = PATHS if kinds in COMPILED else ("portable",)
    assert_same(elastic, postures(elastic), *paths, **load)


@pytest.mark.parametrize("name", ["ur5", "panda"])
def test_robots(name):
    elastic = cartstiff.load(name)
    q = postures(elastic)
    q[3] = 0.0  # the UR5 is singular there
    assert_same(elastic, q)
    assert_same(elastic, q, wrench=[3.0, -2.0, 1.0, 40.0, -25.0, 60.0])


PLATFORMS = ["stewart-gough", "cubic", "hexapod", "cable-robot"]


@pytest.mark.parametrize("name", PLATFORMS)
def test_platforms(name):
    elastic = cartstiff.load(name)
    q = postures(elastic)
    assert_same(elastic, q)
    load = 0.5 * np.arange(1.0, 7.0)
    assert_same(elastic, q, wrench=load, outputs=("wrench", "energy", "stiffness_F"))


def test_platform_with_a_weight():
    """K^F is then not the sum over the legs alone; rest lengths given, and found."""
    given = cartstiff.load("stewart-gough").with_potential(
        payload(3.0, (0.2, 0.0, -9.81), (0.5, 1.0, 2.0))
    )
    found = cartstiff.load("hexapod").with_potential(payload(20.0, (0.0, 0.0, -9.81), (0, 0, 0.1)))
    for elastic in (given, found):
        assert_same(elastic, postures(elastic))


@pytest.mark.parametrize("lengths", ["found", "given"])
def test_legs_that_weigh(lengths):
    """Gravity pulls at the legs as at the platform: unlike bars, at tilted poses."""
    rng = np.random.default_rng(8)
    platform = cartstiff.load("stewart-simscape")
    length = platform.mechanism.at(platform.q).length
    own = [rng.uniform(5.0, 40.0, 6) for _ in range(2)]
    centres = [rng.uniform(0.2, 0.6, 6) * length for _ in range(3)]
    heavy = copy(platform.mechanism)
    heavy.struts = Struts(*own, *centres)
    elastic = replace(platform, mechanism=heavy).with_gravity([3.0, -2.0, -9.0])
    if lengths == "given":
        made = elastic.mechanism.at(elastic.q).lines.lengths * rng.uniform(0.99, 1.01, 6)
        elastic = replace(elastic, springs=replace(elastic.springs, rest_length=made))
    q = postures(elastic)
    assert_same(elastic, q)
    assert_same(elastic, q, wrench=[3.0, -2.0, 1.0, 40.0, -25.0, 60.0])


@pytest.mark.parametrize(
    "name", ["hexapod", "stewart-gough", "cable-robot", "seven lines", "flexure-hexapod"]
)
@pytest.mark.parametrize("axes", ["none", "body", "world"])
def test_tensions_are_the_engines(name, axes):
    """What limits of forces ask for; an odd number of lines is found over arrays."""
    elastic = cartstiff.load("cable-robot" if name == "seven lines" else name)
    if name == "seven lines":
        rest, own = elastic.springs, elastic.mechanism
        fewer = own.with_points(own.anchors[:7], own.points[:7])
        of_each = ("anchors", "points", "stiffness", "rest_length", "preload")
        lines = {name: getattr(rest, name)[:7] for name in of_each}
        elastic = replace(elastic, mechanism=fewer, springs=replace(rest, **lines))
    q = postures(elastic) if name != "flexure-hexapod" else elastic.q + 1e-4 * np.eye(6)
    acting = {}
    if axes != "none":
        acting = {"wrench": [0.1, 0.2, -0.1, 3.0, -2.0, 5.0], "load_axes": axes}
        acting["load_at"] = (0.1, 0.0, -0.2)
    tensions = analyse_many(elastic, q, outputs=["tensions"], **acting).tensions
    known = np.isfinite(tensions).all(axis=1)
    assert known.any()
    for posture, found in zip(q[known], tensions[known], strict=True):
        one = cartstiff.analyse(elastic, posture, **acting)
        expected = tensions_of(one.elastic, one.posture)
        noise = _noise(one.elastic, posture) + 1e-12 * np.abs(expected).max(initial=0.0)
        assert absolute_error(found, expected) <= noise


def test_torques_of_springs_outside_of_the_program_are_the_engine_s():
    """A table of many points is no part of it: its torque is not zero, and maps know it."""
    turned = np.linspace(-1.5, 1.5, 41)
    law = TabulatedLaw(tuple(turned), tuple(2e4 * turned + 3e3 * turned**3))
    arm = cartstiff.load("ur5")
    springs = replace(arm.springs, laws={1: law}, rest=arm.q - 0.01)
    elastic = replace(arm, springs=springs)
    q = arm.q + np.random.default_rng(2).uniform(-0.005, 0.005, (3, 6))
    found = analyse_many(elastic, q, outputs=["torques"])
    for posture, torques in zip(q, found.torques, strict=True):
        np.testing.assert_allclose(torques, cartstiff.analyse(elastic, posture).torques, rtol=1e-9)
        assert abs(torques[1]) > 50.0


def test_tensions_of_many_postures_add_up_to_the_wrench():
    elastic = cartstiff.load("hexapod")
    load = np.array([0.1, 0.2, -0.1, 3.0, -2.0, 5.0])
    found = analyse_many(elastic, postures(elastic), wrench=load, outputs=("tensions", "pose"))
    platform = elastic.mechanism
    for T, t in zip(found.pose, found.tensions, strict=True):
        along = platform.points - (platform.anchors - T[:3, 3]) @ T[:3, :3]
        u = along / np.linalg.norm(along, axis=1)[:, None]
        assert absolute_error(t @ u, load[3:]) <= 1e-9
        assert absolute_error(t @ np.cross(platform.points, u), load[:3]) <= 1e-9
    assert found.to_xarray()["tensions"].dims == ("posture", "leg")


def test_slack_ropes():
    """Far from the middle some ropes of fixed length are slack, and no cables of drives are."""
    robot = cartstiff.load("cable-robot")
    q = robot.q + 0.3 * np.random.default_rng(5).uniform(-1, 1, (COUNT, 6))
    assert "slack" not in [note.code for x in q for note in cartstiff.analyse(robot, x).notes]
    assert_same(robot, q)

    home, k = robot.mechanism.leg_lengths(robot.q), robot.springs.stiffness
    rest = home - robot.springs.preload / k
    fixed = replace(robot.springs, rest_length=rest, preload=None, driven=False)
    ropes, seen = replace(robot, springs=fixed), 0
    for x in q:
        notes = {note.code: note.values for note in cartstiff.analyse(ropes, x).notes}
        short = np.flatnonzero(robot.mechanism.leg_lengths(x) < rest) + 1
        assert notes.get("slack", {"slack": []})["slack"] == short.tolist()
        seen += 0 < len(short) < 8
    assert seen > 5
    assert_same(ropes, q)


@pytest.mark.parametrize("lengths", ["found", "preload", "given"])
@pytest.mark.parametrize("load", ["none", "shared", "each"])
def test_bounds_choose_tensions_without_the_engine(lengths, load):
    """At most of these postures some cable would push in the set nearest to the given tensions."""
    robot = cartstiff.load("cable-robot").with_payload(3.0, [0.05, 0.02, -0.1])
    preload = robot.springs.preload if lengths == "preload" else None
    springs = replace(robot.springs, preload=preload)
    if lengths == "given":
        rest = springs.lengths_at(robot.mechanism.at(robot.q).pose) - 1e-3
        springs = replace(springs, rest_length=rest)
    robot = replace(robot, springs=springs)
    rng = np.random.default_rng(8)
    q = robot.q + rng.uniform(-1, 1, (40, 6)) * np.repeat([0.6, 0.3], 3)
    each = rng.normal(size=(40, 6)) * np.repeat([1.0, 20.0], 3)
    wrench = {"none": None, "shared": each[0], "each": each}[load]
    # Pulls at given lengths are a thousand times the tensions: compliances magnify their round-off.
    outputs = [name for name in OUTPUTS if lengths != "given" or "compliance" not in name]
    for found in assert_same(robot, q, wrench=wrench, outputs=outputs):
        assert found.fallback == 0
        assert found.is_regular.sum() > 3


def test_bounds_choose_tensions_beside_a_potential_evaluated_in_chunks():
    robot = cartstiff.load("cable-robot")
    pushed = robot.with_potential(JointFunction(lambda q: 3.0 * float(q[2])))
    q = robot.q + np.random.default_rng(8).uniform(-0.6, 0.6, (12, 6)) * np.repeat([1.0, 0.5], 3)
    how = {"wrench": [0, 0, 0, 0, 0, -3.0], "outputs": ["tensions"], "path": "portable"}
    at_once, parts = analyse_many(pushed, q, **how), analyse_many(pushed, q, chunk=5, **how)
    assert parts.fallback == 0
    assert parts.is_regular.sum() > 3
    np.testing.assert_array_equal(parts["tensions"], at_once["tensions"])


def test_other_potentials():
    """In the arithmetic (dead forces, coupled springs), and evaluated posture by posture."""
    elastic = arm("RRRRRR", rest=True)
    K = np.array([[30.0, 7.0], [7.0, 20.0]])
    more = elastic.with_potential(
        DeadForce([3.0, -2.0, 5.0], [0.1, 0.2, -0.1]),
        DeadForce([1.0, 2.0, 0.0], [0.0, 0.2, 0.3], "middle"),
        CoupledSprings(np.array([1, 4]), K),
    )
    assert_same(more, postures(more))
    evaluated = elastic.with_potential(JointFunction(lambda q: float(np.sin(q).sum() ** 2)))
    assert_same(evaluated, postures(evaluated), outputs=("energy", "wrench", "stiffness_B"))
    laws = {1: PolynomialLaw((300.0, 10.0, 40.0)), 4: TabulatedLaw((-1, 0, 2), (-90, 0, 260))}
    curved = replace(elastic, springs=replace(elastic.springs, laws=laws))
    assert_same(curved, postures(curved), outputs=("energy", "wrench", "stiffness_F"))


TABLE = TabulatedLaw((-0.5, -0.1, 0.0, 0.05, 0.3), (-150.0, -20.0, 0.0, 20.0, 90.0), "smooth")
STRAIGHT = replace(TABLE, pieces="linear")
FALLING = PolynomialLaw((300.0, -500.0, 0.0, 2000.0))  # between 0.3 and more


@pytest.mark.parametrize(
    "law",
    [
        PolynomialLaw((300.0, 40.0, 4000.0)),
        PolynomialLaw((300.0,)),
        PolynomialLaw((0.0, 0.0, 4000.0)),  # the engine's: at rest it has no stiffness
        FALLING,
        TABLE,
        STRAIGHT,
        replace(TABLE, torques=tuple(-t for t in TABLE.torques)),  # the engine's: it falls
    ],
)
def test_rest_positions_of_nonlinear_springs_are_chosen(law):
    """Deflections that carry a wrench and a weight: the root of smallest size, or the engine's."""
    elastic = arm("RRRRRR", gravity=True)
    springs = replace(elastic.springs, laws={1: law, 3: law}, rest=np.full(6, np.nan))
    curved = replace(elastic, springs=springs)
    q = postures(curved)
    paths = PATHS if law in (TABLE, STRAIGHT, FALLING) else ("portable",)
    if isinstance(law, TabulatedLaw) and law.torques[0] > 0.0:  # no root is recorded
        paths = ("engine",)
    outputs = ("energy", "wrench", "stiffness_B", "compliance_K")
    assert_same(curved, q, *paths, outputs=outputs)
    load = [1.0, 2.0, -1.0, 10.0, 20.0, -15.0]
    assert_same(curved, q, *paths, wrench=load, outputs=outputs[:3])


def test_closed_chains_have_nonlinear_springs():
    elastic = cartstiff.load("6-ups")
    springs, motors = elastic.springs, list(elastic.mechanism.actuated)
    k = float(springs.stiffness[motors[0]])
    laws = {motors[0]: PolynomialLaw((k, 0.0, 50.0 * k)), motors[2]: PolynomialLaw((k, 3.0 * k))}
    curved = replace(elastic, springs=replace(springs, laws=laws))
    q = np.tile(elastic.q, (120, 1))
    q[:, motors] += 0.01 * np.random.default_rng(3).uniform(-1, 1, (120, 6))
    for load in (None, [1.0, 2.0, -1.0, 100.0, 200.0, -150.0]):
        many = analyse_many(curved, q, wrench=load, outputs=("energy", "stiffness_A"))
        assert many.fallback == 0
        for i in range(0, 120, 30):
            one = cartstiff.analyse(curved, q[i], wrench=load)
            np.testing.assert_allclose(many["energy"][i], one.energy, rtol=1e-9, atol=1e-9)
            size = np.abs(one.matrices["A"]).max()
            assert absolute_error(many["A"][i], one.matrices["A"]) <= 1e-12 * size


def test_forces_without_a_potential_go_to_the_engine():
    elastic = arm("RRRRRR", rest=True).with_potential(FollowerWrench([1.0, 2, 3, 4, 5, 6]))
    assert_same(elastic, postures(elastic, count=4))


def test_joints_that_follow_others():
    """Seven joints, six coordinates: the last two move together."""
    elastic = arm("RRRRRPR", gravity=True)
    tree = elastic.mechanism.tree
    mimic = np.eye(7, 6)
    mimic[6, 5] = -0.7
    coordinates = (*tree.coordinates[:5], Coordinate("both", "prismatic"))
    offset = np.array([0, 0, 0, 0, 0, 0, 0.2])
    other = KinematicTree(tree.model, coordinates, tree.frames, mimic, offset)
    k = elastic.springs.stiffness[:6]
    for rest in (np.full(6, np.nan), np.linspace(-0.2, 0.3, 6)):
        followed = replace(
            elastic, mechanism=Chain(other, "tip"), q=np.zeros(6), springs=JointSprings(k, rest)
        )
        assert_same(followed, postures(followed))


@pytest.mark.parametrize("scale", [1e-2, 1.0, 30.0])
@pytest.mark.parametrize("parallel", [0, 2, 5])
def test_arms_with_parallel_axes(parallel, scale):
    """Much of their Jacobian is zero in every posture; with all axes parallel they are singular."""
    model = pinocchio.Model()
    rng = np.random.default_rng(6)
    for j in range(6):
        turn = np.eye(3) if 0 < j <= parallel else pinocchio.rpy.rpyToMatrix(np.pi / 2, 0.0, 0.0)
        placement = pinocchio.SE3(turn, scale * rng.uniform(0.1, 0.5, 3))
        model.addJoint(j, pinocchio.JointModelRZ(), placement, f"joint{j}")
    add_frame(model, "tip", 6, random_pose(rng, 0.2 * scale))
    springs = JointSprings(rng.uniform(400.0, 1200.0, 6), rng.uniform(-0.5, 0.5, 6))
    elastic = ElasticMechanism("arm", Chain(plain_tree(model), "tip"), np.zeros(6), springs)
    compiled = [(2, 1e-2), (2, 30.0), (5, 1.0)]
    paths = PATHS if (parallel, scale) in compiled else ("portable",)
    assert_same(elastic, postures(elastic), *paths)


@pytest.mark.parametrize("place", ["base", "middle"])
def test_axes_that_nearly_meet(place):
    """The characteristic length is small beside the way to the base, or beside the arm itself."""
    model = pinocchio.Model()
    rng = np.random.default_rng(7)
    for j in range(6):
        placement = random_pose(rng, 1e-3)
        if (place, j) in (("base", 0), ("middle", 3)):
            placement[:3, 3] += [0.0, 0.0, 0.7]
        model.addJoint(j, pinocchio.JointModelRZ(), pinocchio.SE3(placement), f"joint{j}")
    add_frame(model, "tip", 6, random_pose(rng, 1e-3))
    springs = JointSprings(rng.uniform(400.0, 1200.0, 6), rng.uniform(-0.5, 0.5, 6))
    elastic = ElasticMechanism("arm", Chain(plain_tree(model), "tip"), np.zeros(6), springs)
    assert_same(elastic, postures(elastic))


def test_prestressed_self_motions_buckle():
    """Enough load, and the self-motion of a redundant arm is unstable."""
    elastic = arm("RRRRRRR")
    wrench = np.outer(np.linspace(0, 40000, COUNT), [0, 0, 0, 0, 0, -1.0])
    q = postures(elastic)
    for found in assert_same(elastic, q, wrench=wrench, outputs=("stiffness_B", "stiffness_A")):
        assert {"buckled", "regular"} <= set(found.counts())


def test_balanced_by_chance():
    """A redundant arm with rest positions is at rest only where it stands at them."""
    elastic = arm("RRRRRRR", rest=True)
    q = postures(elastic)
    q[4] = elastic.springs.rest
    for found in assert_same(elastic, q):
        assert found.counts() == {"regular": 1, "unbalanced": COUNT - 1}
        assert np.isfinite(found["stiffness_B"][4]).all()


@pytest.mark.parametrize("path", PATHS)
def test_singular_postures_do_not_touch_their_neighbours(path):
    elastic = cartstiff.load("ur5")
    q = postures(elastic)
    alone = analyse_many(elastic, q, outputs=("stiffness_K", "compliance_B"), path=path)
    q[[0, 7]] = 0.0
    among = analyse_many(elastic, q, outputs=("stiffness_K", "compliance_B"), path=path)
    assert among.codes[among.state[7]] == "serial-singularity"
    assert np.isnan(among["stiffness_K"][[0, 7]]).all()
    assert np.isfinite(among["compliance_B"][7]).all()  # it exists where K does not
    others = np.setdiff1d(np.arange(COUNT), [0, 7])
    np.testing.assert_array_equal(among["stiffness_K"][others], alone["stiffness_K"][others])
    assert among.is_regular[others].all()


def test_dependent_legs_are_named():
    """The classical singularity of an octahedral platform: turned by a quarter about its axis."""
    elastic = cartstiff.load("cubic")
    q = postures(elastic)
    q[2] = [0, 0, 0, 0, 0, np.pi / 2]
    for found in assert_same(elastic, q):
        assert found.codes[found.state[2]] == "type-2-singularity"


def test_angles_of_any_size():
    """Turns beyond what the vector code reduces exactly are left to the engine."""
    elastic = cartstiff.load("ur5")
    q = postures(elastic)
    q[1, 2] += 2 * np.pi * 1e5
    q[2, 4] = 12345678.9
    q[3, 1] = np.pi / 2 + 6e-17
    assert_same(elastic, q, outputs=("pose", "jacobian", "stiffness_A"))


def test_few_closed_chains_are_assembled_one_by_one():
    elastic = cartstiff.load("five-bar")
    q = np.array([elastic.q, elastic.q])
    q[1] += 0.01
    found = analyse_many(elastic, q, outputs=("stiffness_B", "pose"))
    assert found.path == "engine"
    assert "closed chain" in found.reason
    for i in range(2):
        one = cartstiff.analyse(elastic, q[i])
        np.testing.assert_array_equal(found["pose"][i], one.pose)
        np.testing.assert_array_equal(found.q[i], one.q)
    np.testing.assert_array_equal(q[0], elastic.q)  # what was given is not written to


def test_closures_that_cannot_be_met_are_named(monkeypatch):
    from cartstiff import ConvergenceError

    elastic = cartstiff.load("five-bar")

    def refuse(*_, **__):
        raise ConvergenceError("no", iterations=1, residual=1.0)

    monkeypatch.setattr(Chain, "closed", refuse)
    found = analyse_many(elastic, elastic.q[None], outputs=("energy",))
    assert found.counts() == {"not-assembled": 1}
    assert np.isnan(found["energy"]).all()


def test_one_joint_about_an_axis_through_the_end_effector(tmp_path):
    """No length can be seen from there: the engine's is taken."""
    (tmp_path / "one.urdf").write_text(
        '<robot name="r"><link name="a"/><link name="b"/><joint name="j" type="continuous">'
        '<parent link="a"/><child link="b"/><axis xyz="1 2 3"/></joint></robot>'
    )
    elastic = cartstiff.load(tmp_path / "one.urdf").with_springs([5.0])
    assert_same(elastic, np.array([[0.1], [0.4]]))


def test_a_body_that_turns_about_its_own_origin_alone():
    """No axis passes M's origin at a distance: no length can be read from the Jacobian."""
    text = (
        '<robot name="r"><link name="a"/><link name="b"/><joint name="j" type="floating">'
        '<parent link="a"/><child link="b"/></joint></robot>'
    )
    elastic = cartstiff.load(text)
    Q = np.array([[0.1, 0.2, 0.3, 0.1, 0.2, 0.3], [0.0, 0.2, -0.3, 0.4, -0.2, 0.3]])
    found = cartstiff.analyse_many(elastic, Q)
    for i, q in enumerate(Q):
        one = cartstiff.analyse(elastic, q)
        np.testing.assert_allclose(found.stiffness_B[i], one.matrices["B"], rtol=1e-12)
