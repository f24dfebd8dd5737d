"""Loads, beams, coupled springs, flexible links, trees put together."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation
from tests.doors import (
    Chain,
    CoupledSprings,
    Give,
    KinematicTree,
    Scaled,
    extended,
    merged,
    plain_tree,
)
from tests.support import (
    absolute_error,
    body_jacobian,
    cross_matrix,
    exp_reference,
    frame_pose,
    general_legs,
    gradient_of,
    hessian_of,
    legs_as_platform,
    loaded_arm,
    random_pose,
    relative_error,
    translation,
)

from cartstiff import (
    DeadForce,
    DeadWrench,
    ElasticMechanism,
    FollowerWrench,
    JointSprings,
    analyse,
    payload,
)
from cartstiff.extend import Platform

ROUNDING = 1e-12
# Eighth-order differences at step 0.01: first and second.
GRADIENT = 1e-10
HESSIAN = 1e-9

FORCE = np.array([3.0, -2.0, 1.0])
MOMENT = np.array([0.5, 1.0, -0.7])
POINT = np.array([0.2, -0.1, 0.3])


def _arm():
    arm = loaded_arm("RRPR", 5)
    return arm.model, arm.elastic.mechanism, arm.q


def test_dead_force():
    model, chain, q = _arm()

    def energy(d):
        T = frame_pose(model, q + d, "tip")
        return -float(FORCE @ (T[:3, :3] @ POINT + T[:3, 3]))

    for load in (DeadForce(FORCE, POINT), DeadForce(FORCE, POINT, "tip")):
        got = load.evaluate(chain.at(q))
        assert got.energy == pytest.approx(energy(np.zeros(4)), rel=ROUNDING)
        assert relative_error(got.gradient, gradient_of(energy, np.ones(4))) <= GRADIENT
        assert relative_error(got.hessian, hessian_of(energy, np.ones(4))) <= HESSIAN


def test_dead_force_on_a_platform():
    legs = general_legs()
    platform = Platform(legs.base, legs.platform)
    T = platform.pose_of(legs.q)

    def energy(x):
        M = T @ exp_reference(x)
        return -float(FORCE @ (M[:3, :3] @ POINT + M[:3, 3]))

    got = DeadForce(FORCE, POINT).evaluate(platform.at(legs.q))
    assert relative_error(got.gradient, gradient_of(energy, np.ones(6))) <= GRADIENT
    assert relative_error(got.hessian, hessian_of(energy, np.ones(6))) <= HESSIAN


def test_payload_is_a_weight():
    g = np.array([0, 0, -9.81])
    _, chain, q = _arm()
    a = payload(2.5, g, POINT).evaluate(chain.at(q))
    b = DeadForce(2.5 * g, POINT).evaluate(chain.at(q))
    for x, y in zip(a, b, strict=True):
        assert np.array_equal(x, y)
    legs = general_legs()
    heavy = Platform(legs.base, legs.platform, mass=2.5, mass_centre=POINT)
    from cartstiff.extend import Gravity

    a = payload(2.5, g, POINT).evaluate(heavy.at(legs.q))
    b = Gravity(g).evaluate(heavy.at(legs.q))
    for x, y in zip(a, b, strict=True):
        assert absolute_error(np.asarray(x), y) <= ROUNDING * 100


@pytest.mark.parametrize("moment", [np.zeros(3), MOMENT], ids=["force", "force and moment"])
def test_dead_wrench(moment):
    """The generalised force field and its derivative; with a moment there is no energy."""
    model, chain, q = _arm()

    def gradient(d):
        R = frame_pose(model, q + d, "tip")[:3, :3]
        w = np.concatenate([R.T @ moment, R.T @ FORCE])
        return -body_jacobian(model, q + d, "tip").T @ w

    got = DeadWrench(np.concatenate([moment, FORCE])).evaluate(chain.at(q))
    assert relative_error(got.gradient, gradient(np.zeros(4))) <= ROUNDING
    assert relative_error(got.hessian, gradient_of(gradient, np.ones(4))) <= GRADIENT
    assert np.isnan(got.energy) == bool(moment.any())
    if not moment.any():
        assert absolute_error(got.hessian, got.hessian.T) <= ROUNDING
        same = DeadForce(FORCE).evaluate(chain.at(q))
        assert got.energy == same.energy


def test_follower_wrench():
    model, chain, q = _arm()
    w = np.concatenate([MOMENT, FORCE])

    def gradient(d):
        return -body_jacobian(model, q + d, "tip").T @ w

    got = FollowerWrench(w).evaluate(chain.at(q))
    assert np.isnan(got.energy)
    assert relative_error(got.gradient, gradient(np.zeros(4))) <= ROUNDING
    assert relative_error(got.hessian, gradient_of(gradient, np.ones(4))) <= GRADIENT
    assert absolute_error(got.hessian, got.hessian.T) > 0.01


def test_scaled():
    _, chain, q = _arm()
    load = DeadForce(FORCE, POINT)
    a, b = load.evaluate(chain.at(q)), Scaled(load, -2.5).evaluate(chain.at(q))
    for x, y in zip(a, b, strict=True):
        assert np.array_equal(-2.5 * np.asarray(x), y)


def test_coupled_springs():
    rng = np.random.default_rng(6)
    _, chain, q = _arm()
    M = rng.normal(size=(2, 2))
    K = M @ M.T
    springs = CoupledSprings(np.array([3, 1]), K)

    def energy(d):
        x = (q + d)[[3, 1]]
        return 0.5 * float(x @ K @ x)

    got = springs.evaluate(chain.at(q))
    assert got.energy == pytest.approx(energy(np.zeros(4)), rel=ROUNDING)
    assert absolute_error(got.gradient, gradient_of(energy, np.ones(4))) <= GRADIENT
    assert absolute_error(got.hessian, hessian_of(energy, np.ones(4))) <= HESSIAN


def test_flexible_link_at_rest_is_rigid():
    """Virtual joints at zero move no frame; the link's own frame stays when they move."""
    rng = np.random.default_rng(7)
    arm = loaded_arm("RRR", 7)
    model = arm.model
    for i in (1, 2, 3):
        model.addBodyFrame(f"link{i}", i, pin.SE3(random_pose(rng, 0.2)), 0)
    T_s = random_pose(rng, 0.2)
    tree = plain_tree(model, flexible={"link2": Give(T_s)})
    names = [c.name for c in tree.coordinates]
    assert names == [
        "j1",
        "j2",
        *(f"link2.{s}" for s in ("px", "py", "pz", "rx", "ry", "rz")),
        "j3",
    ]
    q = np.zeros(9)
    q[[0, 1, 8]] = arm.q
    state = tree.at(q)
    for name in ("link1", "link2", "link3", "tip"):
        got = state.pose(tree.placement(name))
        assert absolute_error(got, frame_pose(model, arm.q, name)) <= ROUNDING
    bent = q.copy()
    bent[2:8] = rng.uniform(-0.1, 0.1, 6)
    moved = tree.at(bent)
    for name in ("link1", "link2"):
        assert (
            absolute_error(moved.pose(tree.placement(name)), frame_pose(model, arm.q, name))
            <= ROUNDING
        )
    # Beyond the spring everything moves by the six virtual joints, at the spring's place.
    S = frame_pose(model, arm.q, "link2") @ T_s
    give = translation(*bent[2:5])
    for axis, angle in zip(np.eye(3), bent[5:8], strict=True):
        give = give @ exp_reference([*(angle * axis), 0, 0, 0])
    expected = S @ give @ np.linalg.inv(S) @ frame_pose(model, arm.q, "tip")
    assert absolute_error(moved.pose(tree.placement("tip")), expected) <= ROUNDING


def test_flexible_link_adds_its_compliance():
    """Springs in series: C = J Kq^-1 J^T + Ad C_link Ad^T, unloaded."""
    arm = loaded_arm("RRRRRR", 8, load=0.0)
    model = arm.model
    model.addBodyFrame("link", 6, pin.SE3.Identity(), 0)
    C_link = np.diag([1e-3, 2e-3, 3e-3, 1e-5, 2e-5, 3e-5])
    tree = plain_tree(model, flexible={"link": Give(np.eye(4))})
    # The frame "tip" is on the same joint: beyond the spring.
    chain = Chain(tree, "tip")
    names = [c.name for c in tree.coordinates]
    virtual = np.array([names.index(f"link.{s}") for s in ("rx", "ry", "rz", "px", "py", "pz")])
    q, k = np.zeros(12), np.zeros(12)
    hinges = [names.index(f"j{i}") for i in range(1, 7)]
    q[hinges], k[hinges] = arm.q, 100.0
    elastic = ElasticMechanism(
        "flexible",
        chain,
        q,
        JointSprings(k, q),
        potentials=(CoupledSprings(virtual, np.linalg.inv(C_link)),),
    )
    T = model.frames[model.getFrameId("tip")].placement.homogeneous
    R, p = T[:3, :3].T, -T[:3, :3].T @ T[:3, 3]
    to_tip = np.block([[R, np.zeros((3, 3))], [cross_matrix(p) @ R, R]])
    J = body_jacobian(model, arm.q, "tip")
    expected = J @ J.T / 100.0 + to_tip @ C_link @ to_tip.T
    assert relative_error(analyse(elastic).compliances["B"], expected) <= 1e-10


def test_the_mass_beyond_a_flexible_link_is_carried():
    """That of a link fixed to its end: all of it, where it is while nothing bends."""
    tool = "<link name='tool'><inertial><mass value='2'/><origin xyz='.1 .2 .3'/>"
    own = "<link name='link'><inertial><mass value='3'/><origin xyz='.2 0 0'/>"
    solid = "<inertia ixx='.1' iyy='.2' izz='.25' ixy='0' ixz='0' iyz='0'/></inertial></link>"
    joints = """<joint name='j' type='revolute'><parent link='base'/><child link='link'/>
      <axis xyz='0 1 0'/><limit lower='-2' upper='2' effort='1' velocity='1'/></joint>
      <joint name='f' type='fixed'><parent link='link'/><child link='tool'/>
      <origin xyz='.5 0 0'/></joint>"""
    text = f"<robot name='r'><link name='base'/>{own}{solid}{tool}{solid}{joints}</robot>"
    model = pin.buildModelFromXML(text)
    end = np.eye(4)
    end[0, 3] = 0.5
    tree = plain_tree(model, flexible={"link": Give(end)})
    assert sum(body.mass for body in tree.model.inertias) == pytest.approx(5.0)
    g = np.array([0.3, -0.2, -9.81])
    q = np.zeros(tree.n)
    names = [c.name for c in tree.coordinates]
    q[names.index("j")] = 0.4
    R = Rotation.from_euler("y", 0.4).as_matrix()
    arms = R @ (3.0 * np.array([0.2, 0.0, 0.0]) + 2.0 * np.array([0.6, 0.2, 0.3]))
    found = tree.at(q).gravity(g).gradient[names.index("j")]
    assert found == pytest.approx(-np.cross(arms, g)[1], rel=1e-12)


def _mimic(tree: KinematicTree) -> KinematicTree:
    M = np.eye(tree.n)[:, :-1]
    M[-1, 0] = 0.5
    return KinematicTree(tree.model, tree.coordinates[:-1], tree.frames, M, np.full(tree.n, 0.1))


@pytest.mark.parametrize("mimic", [(False, False), (True, False), (False, True), (True, True)])
def test_merged_trees(mimic):
    arms = [loaded_arm("RRR", 9), loaded_arm("RPR", 10)]
    roots = [random_pose(np.random.default_rng(i)) for i in (1, 2)]
    trees = [plain_tree(a.model) for a in arms]
    trees = [_mimic(t) if m else t for t, m in zip(trees, mimic, strict=True)]
    both = merged([("left.", trees[0], roots[0]), ("right.", trees[1], roots[1])])
    assert [c.name for c in both.coordinates] == [
        p + c.name for p, t in zip(("left.", "right."), trees, strict=True) for c in t.coordinates
    ]
    rng = np.random.default_rng(3)
    qs = [rng.uniform(-1, 1, t.n) for t in trees]
    state = both.at(np.concatenate(qs))
    for prefix, arm, tree, root, q in zip(("left.", "right."), arms, trees, roots, qs, strict=True):
        full = q if tree.mimic is None else tree.mimic @ q + tree.offset
        expected = root @ frame_pose(arm.model, full, "tip")
        assert absolute_error(state.pose(both.placement(prefix + "tip")), expected) <= ROUNDING
    g = np.array([0.3, -1.0, -9.81])
    total = 0.0
    for arm, tree, root, q in zip(arms, trees, roots, qs, strict=True):
        total += tree.at(q).gravity(root[:3, :3].T @ g).energy
        total -= pin.computeTotalMass(arm.model) * float(g @ root[:3, 3])
    assert state.gravity(g).energy == pytest.approx(total, rel=1e-11)


@pytest.mark.parametrize("mimic", [False, True])
def test_extended_trees(mimic):
    arm = loaded_arm("RRR", 11)
    tree = _mimic(plain_tree(arm.model)) if mimic else plain_tree(arm.model)
    longer = extended(tree, "tip", [("slide", "PZ"), ("turn", "RX")], "end")
    assert [c.name for c in longer.coordinates[-2:]] == ["slide", "turn"]
    assert [c.type for c in longer.coordinates[-2:]] == ["prismatic", "revolute"]
    q = np.random.default_rng(4).uniform(-1, 1, tree.n)
    full = q if tree.mimic is None else tree.mimic @ q + tree.offset
    got = longer.at(np.concatenate([q, [0.3, 0.4]])).pose(longer.placement("end"))
    tip = frame_pose(arm.model, full, "tip")
    expected = tip @ translation(0, 0, 0.3) @ exp_reference([0.4, 0, 0, 0, 0, 0])
    assert absolute_error(got, expected) <= ROUNDING
    assert tree.n == longer.n - 2  # the tree given is as it was


def test_lines_balanced():
    """Leg rest lengths chosen so that a load is carried; what is given stays."""
    legs = general_legs()
    elastic = legs_as_platform(legs)
    W = np.array([1.0, -2.0, 3.0, 10.0, -5.0, 20.0])
    result = analyse(elastic, wrench=W)
    assert relative_error(result.wrench, W) <= 1e-10
    assert relative_error(result.matrices["F"], analyse(elastic).matrices["F"]) <= 1e-10
    rest = legs.rest.copy()
    rest[:] = np.nan
    from dataclasses import replace

    unloaded = analyse(replace(elastic, springs=replace(elastic.springs, rest_length=rest)))
    assert np.abs(unloaded.wrench).max() <= 1e-9
    assert relative_error(unloaded.elastic.springs.rest, legs.lengths) <= 1e-12


def test_leg_springs_by_name():
    elastic = legs_as_platform(general_legs())
    assert elastic.spring_names == tuple(f"leg{i}" for i in range(1, 7))
    changed = elastic.with_springs({"leg3": 9.0}, rest={"leg1": 0.5})
    assert changed.springs.stiffness[2] == 9.0
    assert changed.springs.rest[0] == 0.5
    assert changed.springs.stiffness[0] == elastic.springs.stiffness[0]


def test_slack_cables_are_named():
    from dataclasses import replace

    legs = general_legs()
    elastic = legs_as_platform(legs)
    rest = legs.lengths - 0.05
    rest[[1, 4]] += 0.1
    cables = replace(elastic, springs=replace(elastic.springs, rest_length=rest, unilateral=True))
    note = next(n for n in analyse(cables).notes if n.code == "slack")
    assert note.values["slack"] == [2, 5]
    assert "cables 2, 5 are slack" in note.message


def test_cables_pull_where_they_can():
    """Two opposed cables and a load along them: tensions chosen with none below zero."""
    from dataclasses import replace

    from tests.support import platform_mechanism

    anchors = np.array([[1.0, 0, 0], [-1.0, 0, 0], [0, 1, 0], [0, -1, 0]])
    elastic = platform_mechanism(anchors, np.zeros((4, 3)), np.full(4, 50.0), np.full(4, 0.9))
    cables = replace(elastic, springs=replace(elastic.springs, unilateral=True))
    result = analyse(cables, wrench=[0, 0, 0, 3.0, 0, 0])
    assert result.wrench == pytest.approx([0, 0, 0, 3.0, 0, 0], abs=1e-12)
    tensions = result.elastic.springs.tensions(np.ones(4))
    assert tensions.min() >= -1e-12
