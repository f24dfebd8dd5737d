"""Paths of best stiffness: against brute force on closed forms, the engine, and what must hold."""

from dataclasses import replace

import numpy as np
import pytest
from tests.doors import compliance_deflection
from tests.machining import planar
from tests.support import (
    frame_pose,
    loaded_arm,
    refused,
)
from tests.support.robots import example_robots

import cartstiff
from cartstiff import InputError, ToolPath, UndefinedError, optimise_path
from cartstiff.core.errors import UnknownNameError
from cartstiff.geometry import se3

needs_robots = pytest.mark.skipif(not example_robots(), reason="example robots are not installed")
# A fine grid of N values misses a smooth minimum by its curvature times the spacing squared.
GRID = 1e-3
FORCE = np.array([-40.0, 25.0])
POINTS = np.column_stack([np.linspace(0.75, 0.35, 7), np.linspace(-0.2, 0.45, 7)])


def path_of(points=POINTS, yaw=0.0, force=FORCE, axes="world"):
    return ToolPath(planar.poses(points, yaw), [0, 0, 0, *force, 0], axes=axes)


def usable(points, length, threshold, yaws):
    """Postures (m, k, 3) of both branches and all yaws, and their costs, by hand."""
    q = np.array([planar.inverse(x, y, yaws).reshape(-1, 3) for x, y in points])
    cost = planar.deflection(q, FORCE)
    regular = planar.ratio(np.nan_to_num(q), length) >= threshold
    return q, np.where(np.isfinite(cost) & regular, cost, np.inf)


def length_of(arm):
    return arm.mechanism.at(arm.q).length


# -- against brute force -------------------------------------------------------------------------


@pytest.mark.parametrize("objective", ["worst", "mean"])
def test_without_a_bound_each_point_is_best(objective):
    arm = planar.arm()
    result = optimise_path(
        arm, path_of(), free="z", objective=objective, max_step=100.0, singular=1e-3, smoothness=0.0
    )
    q, cost = usable(POINTS, length_of(arm), 1e-3, np.linspace(-np.pi, np.pi, 2001))
    best = cost.min(axis=1)
    # One side of the elbow all the way, as the other lies beyond a singularity.
    sides = np.where(q[:, :, 1] > 0, cost, np.inf).min(axis=1)
    assert result.worst >= best.max() * (1 - GRID)
    if objective == "worst":
        assert result.worst <= sides.max() * (1 + 1e-9)
    else:
        assert result.values.sum() <= sides.sum() * (1 + 1e-9)
    np.testing.assert_allclose(planar.deflection(result.q, FORCE), result.values, rtol=1e-9)
    np.testing.assert_allclose(planar.positions(result.q)[:, 3], POINTS, atol=1e-9)


@pytest.mark.parametrize("bound", [0.35, 0.6])
def test_not_worse_than_every_way_on_a_fine_grid(bound):
    """Three points, all pairs and triples of a fine grid, with the bound on steps."""
    arm, points = planar.arm(), POINTS[:3]
    result = optimise_path(
        arm,
        path_of(points),
        free="z",
        max_step=bound,
        samples=36,
        smoothness=0.0,
        near="anywhere",
    )
    q, cost = usable(points, length_of(arm), 0.05, np.linspace(-np.pi, np.pi, 121))

    def joined(i):
        step = q[i + 1][None, :, :] - q[i][:, None, :]
        step = np.abs((step + np.pi) % (2 * np.pi) - np.pi).max(axis=2)
        same = np.sign(q[i + 1][:, 1]) == np.sign(q[i][:, 1])[:, None]
        return (step <= bound) & same

    first, second = joined(0), joined(1)
    allowed = first[:, :, None] & second[None, :, :]
    worst = np.maximum(np.maximum(cost[0][:, None], cost[1])[:, :, None], cost[2])
    brute = np.where(allowed, worst, np.inf).min()
    assert np.isfinite(brute)
    assert result.worst <= brute * (1 + 1e-9)
    assert result.worst >= brute * (1 - 0.02)  # 3 deg and the bound together


def test_constant_choice_is_the_best_of_all_constant_ones():
    arm = planar.arm()
    result = optimise_path(arm, path_of(), free="z", singular=0.01)
    yaws = -np.pi + 2 * np.pi * np.arange(36) / 36
    worst = []
    for yaw in yaws:
        for branch in (0, 1):
            q = np.array([planar.inverse(x, y, yaw)[branch] for x, y in POINTS])
            steps = np.abs(np.diff(np.unwrap(q, axis=0), axis=0))
            good = np.isfinite(q).all() and np.all(planar.ratio(q, length_of(arm)) >= 0.01)
            if good and steps.max() <= 0.5:
                worst.append((planar.deflection(q, FORCE).max(), yaw))
    best, yaw = min(worst)
    assert result.constant is not None
    assert result.constant.values.max() == pytest.approx(best, rel=1e-9)
    assert result.constant.choice == {"angle": pytest.approx(yaw)}
    assert result.worst <= best


def test_free_angle_is_measured_from_the_path():
    result = optimise_path(planar.arm(), path_of(yaw=0.3), free="z")
    turned = result.q.sum(axis=1) - 0.3 - result.angles
    np.testing.assert_allclose(np.exp(1j * turned), 1.0, atol=1e-8)


# -- what must hold ------------------------------------------------------------------------------


@pytest.mark.parametrize("bound", [0.3, [0.4, 0.5, 0.25], {"j1": 0.3}])
def test_steps_limits_and_singularities(bound):
    arm = planar.arm(limits=np.array([2.0, 2.2, 1.6]))
    points = np.column_stack([np.linspace(0.8, 0.4, 13), np.linspace(-0.2, 0.4, 13)])
    result = optimise_path(arm, path_of(points), free="z", max_step=bound, singular=0.08)
    full = {"j1": 0.5, "j2": 0.5, "j3": 0.5} | bound if isinstance(bound, dict) else bound
    bounds = np.array(list(full.values()) if isinstance(full, dict) else full)
    assert np.all(np.abs(result.steps) <= bounds * (1 + 1e-12))
    assert np.all(np.abs(result.q) <= [2.0, 2.2, 1.6])
    ratios = planar.ratio(result.q, length_of(arm))
    assert np.all(ratios >= 0.08)
    np.testing.assert_allclose(result.ratios, ratios, rtol=1e-8)


def test_elbow_does_not_flip_through_the_stretched_posture():
    """The load changes sides where a small step would reach the other branch."""
    arm = planar.arm()
    reach = planar.LENGTHS[0] + planar.LENGTHS[1]
    radius = np.array([0.9, 0.97, 0.995, 0.9975, 0.995, 0.97, 0.9]) * reach
    points = np.column_stack([radius + planar.LENGTHS[2], np.zeros(7)])
    q = np.array([planar.inverse(x, y, 0.0) for x, y in points])
    jump = np.abs(q[3, 0] - q[3, 1]).max()
    forces = np.zeros((7, 6))
    up, down = np.array([10.0, 30.0]), np.array([10.0, -30.0])
    softer = planar.deflection(q[0, 0], up) > planar.deflection(q[0, 1], up)
    forces[:4, 3:5], forces[4:, 3:5] = (down, up) if softer else (up, down)
    path = ToolPath(planar.poses(points), forces, axes="world")
    options = {"objective": "mean", "max_step": 1.2 * jump + 0.35, "smoothness": 0.0}
    kept = optimise_path(arm, path, singular=1e-6, **options)
    assert len(set(np.sign(kept.q[:, 1]))) == 1
    anywhere = optimise_path(arm, path, singular=0.0, **options)
    assert len(set(np.sign(anywhere.q[:, 1]))) == 2  # the bound alone does not forbid it


def test_indifferent_choices_stay_where_they_are():
    """With no stiffness to gain the free angle does not wander."""
    if not example_robots():
        pytest.skip("example robots are not installed")
    arm = cartstiff.load("ur5")  # the flange's z axis is that of the last joint
    T = arm.mechanism.at(arm.q).pose
    poses = np.array([se3.pose(translation=[0, y, 0]) @ T for y in np.linspace(-0.05, 0.05, 4)])
    result = optimise_path(arm, ToolPath(poses, [0, 0, 0, 0, 0, -80]), free="z", samples=12)
    assert np.ptp(result.q[:, 5]) < 1e-3  # the last steps of the refinement are smaller


@needs_robots
@pytest.mark.parametrize(("turns", "follows"), [(1.75, True), (2.25, False)])
def test_joints_go_on_through_whole_turns_within_their_limits(turns, follows):
    """The last joint of a UR5 has two turns either way from zero: it must start far enough back."""
    arm = cartstiff.load("ur5")
    T = arm.mechanism.at(arm.q).pose
    angles = np.linspace(0, turns * 2 * np.pi, 40)
    poses = np.array([T @ se3.exp(a * se3.basis_twist(2)) for a in angles])
    path = ToolPath(poses, [0, 0, 0, 0, 0, -80])
    if not follows:
        refusal = refused(
            "wrist_3_joint would have to turn on", optimise_path, arm, path, kind=UndefinedError
        )
        assert refusal.code == "path-discontinuous"
        return
    result = optimise_path(arm, path)
    assert np.ptp(result.q[:, 5]) == pytest.approx(turns * 2 * np.pi, rel=1e-6)
    assert np.abs(result.q).max() <= 2 * np.pi
    assert np.abs(result.steps).max() < 0.5
    for q, pose in zip(result.q, poses, strict=True):
        np.testing.assert_allclose(arm.mechanism.at(q).pose, pose, atol=1e-8)


@needs_robots
def test_it_does_not_matter_which_joint_is_sampled():
    arm = cartstiff.load("panda")
    T = arm.mechanism.at(arm.q).pose
    poses = np.array([se3.pose(translation=[0, y, -0.1]) @ T for y in np.linspace(-0.1, 0.1, 4)])
    path = ToolPath(poses, [0, 0, 0, 20, 0, -50])
    worst = [
        optimise_path(arm, path, redundant=f"panda_joint{j}", samples=24).worst for j in (3, 7)
    ]
    assert worst[0] == pytest.approx(worst[1], rel=1e-4)


def test_sliding_joints_without_limits():
    """Self-motions that have no end are followed as far as starts go, and no further."""
    arm = loaded_arm("PPRRPRR", 3, load=0.0)
    T = arm.elastic.mechanism.at(arm.q).pose
    poses = np.array([se3.pose(translation=[0, y, 0]) @ T for y in np.linspace(0, 0.1, 3)])
    path = ToolPath(poses, [0, 0, 0, 1, 2, 3])
    refused(
        "left out of the file are commanded",
        optimise_path,
        arm.elastic,
        path,
        samples=4,
        kind=UndefinedError,
    )  # self-motions that nothing balances
    springs = arm.elastic.springs
    free = replace(arm.elastic, springs=springs.replaced(springs.stiffness, springs.rest * np.nan))
    result = optimise_path(free, path, samples=8, near="anywhere")
    assert result.constant is not None
    assert result.worst <= result.constant.values.max()
    for q, pose in zip(result.q, poses, strict=True):
        np.testing.assert_allclose(frame_pose(arm.model, q, "tip"), pose, atol=1e-8)


# -- the criterion -------------------------------------------------------------------------------


@needs_robots
@pytest.mark.parametrize(("connection", "loaded"), [("A", True), ("K", True), ("F", False)])
def test_values_are_those_of_the_analysis(connection, loaded):
    arm = cartstiff.load("ur5")
    T = arm.mechanism.at(arm.q).pose
    poses = np.array([se3.pose(translation=[0, y, 0]) @ T for y in (0.0, 0.05)])
    wrench = np.array([1.0, -2.0, 0.5, 30.0, -40.0, -90.0])
    path = ToolPath(poses, wrench)
    result = optimise_path(
        arm, path, free="y", connection=connection, loaded=loaded, samples=8, refine=False
    )
    for q, value, wanted in zip(result.q, result.values, poses, strict=True):
        pose = arm.mechanism.at(q).pose
        turn = pose[:3, :3].T @ wanted[:3, :3]  # from the path's axes to the body's
        own = np.concatenate([turn @ wrench[:3], turn @ wrench[3:]])
        single = cartstiff.analyse(arm, q, wrench=own if loaded else None)
        C = single.compliances[connection]
        moved = compliance_deflection(C, own).displacement
        assert value == pytest.approx(np.linalg.norm(moved), rel=1e-8)


def test_axes_of_the_load():
    """The same load in the three kinds of axes, where the path and the body have the same ones."""
    arm, yaw = planar.arm(), 0.4
    R = se3.from_roll_pitch_yaw([0, 0, 0], [0, 0, yaw])[:3, :3]
    own = R.T @ [*FORCE, 0.0]
    same = [
        optimise_path(arm, path_of(yaw=yaw, force=force, axes=axes)).values
        for axes, force in (("world", FORCE), ("path", own[:2]), ("body", own[:2]))
    ]
    np.testing.assert_allclose(same[1:], [same[0]] * 2, rtol=1e-10)


def test_larger_is_better_and_along_a_direction():
    arm = planar.arm()
    direction = np.array([1.0, 2.0, 0.0])
    path = ToolPath(planar.poses(POINTS), directions=direction, axes="world")
    result = optimise_path(arm, path, free="z", criterion="along_free", singular=0.01)
    u = direction[:2] / np.linalg.norm(direction)
    J = planar.jacobian(result.q)[:, 1:]
    C = np.einsum("nij,j,nkj->nik", J, 1 / planar.STIFFNESS, J)
    np.testing.assert_allclose(result.values, 1 / np.einsum("i,nij,j->n", u, C, u), rtol=1e-9)
    assert result.worst == result.values.min()
    assert result.worst >= result.constant.values.min()


def test_path_from_tool_axes():
    axes = np.array([[0, 0, -1.0], [0, 0.1, -1.0], [0, 1.0, 0.0], [0, 0, 2.0]])
    path = ToolPath.from_axes(np.zeros((4, 3)), axes, "x")
    unit = axes / np.linalg.norm(axes, axis=1)[:, None]
    np.testing.assert_allclose(path.poses[:, :3, 0], unit, atol=1e-12)


def test_platform_with_a_free_turn():
    platform = cartstiff.load("hexapod")
    T = platform.mechanism.at(platform.q).pose
    poses = np.array([se3.pose(translation=[x, 0, 0]) @ T for x in (-0.02, 0.0, 0.02)])
    path = ToolPath(poses, [0, 0, 0, 50, 0, -50], axes="world")
    result = optimise_path(platform, path, free="z", smoothness=0.0)
    turned = [se3.log(se3.inverse(a) @ b) for a, b in zip(poses, result.poses, strict=True)]
    np.testing.assert_allclose(np.array(turned)[:, [0, 1, 3, 4, 5]], 0.0, atol=1e-9)
    for pose, value in zip(poses, result.values, strict=True):  # nearby turns are no better
        for angle in (-1.0, -0.1, 0.0, 0.1, 1.0):
            q = platform.mechanism.coordinates_of(pose @ se3.exp(angle * se3.basis_twist(2)))
            if np.any(platform.mechanism.leg_lengths(q) > platform.mechanism.limits[:, 1]):
                continue
            if np.any(platform.mechanism.leg_lengths(q) < platform.mechanism.limits[:, 0]):
                continue
            found = cartstiff.analyse(platform, q)
            R = found.pose[:3, :3]
            C = found.compliances["B"][3:, 3:]
            assert np.linalg.norm(C @ (R.T @ [50, 0, -50])) >= value * (1 - 1e-6)


def test_singular_values_of_a_platform_are_those_of_its_legs():
    """The criterion is the ratio that keeps paths from singularities."""
    platform = cartstiff.load("hexapod")
    T = platform.mechanism.at(platform.q).pose
    path = ToolPath(np.array([se3.pose(translation=[x, 0, 0]) @ T for x in (-0.02, 0.02)]))
    result = optimise_path(platform, path, criterion="singular_value_ratio")
    np.testing.assert_allclose(result.values, result.ratios, rtol=1e-9)


# -- refusals ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("points", "options", "code", "point", "match"),
    [
        ([[0.5, 0.2], [0.6, 0.2], [1.3, 0.2]], {}, "path-unreachable", 3, "out of reach"),
        ([[500.0, 200.0]], {}, "path-unreachable", 1, "Millimetres"),
        ([[0.5, 0.2], [1.09, 0.0]], {}, "path-near-singular", 2, "near singularities"),
        ([[0.5, 0.2], [-0.5, 0.2]], {}, "path-discontinuous", 2, "times as large"),
        (
            [[0.5, 0.2], [-0.5, 0.2]],
            {"limits": np.array([0.5, 3.0, 3.0])},
            "path-beyond-limits",
            2,
            "beyond the limits: j1",
        ),
    ],
)
def test_paths_that_cannot_be_followed(points, options, code, point, match):
    arm = planar.arm(**options)
    refusal = refused(
        match,
        optimise_path,
        arm,
        path_of(np.array(points)),
        free="z",
        samples=12,
        kind=UndefinedError,
    )
    assert refusal.code == code
    assert refusal.values["point"] == point
    assert f"point {point}" in str(refusal)


@pytest.mark.parametrize(
    ("options", "match"),
    [
        ({"criterion": "nonsense"}, "unknown criterion"),
        ({"criterion": "along_free"}, "needs a direction"),
        ({"redundant": "j9"}, "unknown joint"),
        ({"redundant": "j2"}, "no joint is left over"),
        ({"samples": 2}, "too few samples"),
        ({"max_step": 0.0}, "largest step must be above zero"),
        ({"max_step": {"j7": 1.0}}, "j7"),
        ({"singular": 1.0}, "singularity threshold"),
        ({"smoothness": -1.0}, "smoothness"),
        ({"objective": "best"}, "unknown objective"),
        ({"free": "w"}, "unknown free rotation"),
        ({"connection": "Z"}, "unknown connection"),
    ],
)
def test_options_that_cannot_be_used(options, match):
    refused(match, optimise_path, planar.arm(), path_of(), **options)


def test_load_must_be_there():
    refused("needs a wrench", optimise_path, planar.arm(), ToolPath(planar.poses(POINTS)))
    path = ToolPath(planar.poses(POINTS))
    refused(
        "under load",
        optimise_path,
        planar.arm(),
        path,
        criterion="translation_free_min",
        loaded=True,
    )


def test_closed_chains_are_refused():
    refused("serial arms and platforms", optimise_path, cartstiff.load("five-bar"), path_of())


@pytest.mark.parametrize(
    ("arguments", "match"),
    [
        ((np.eye(4),), "path has the wrong shape"),
        ((np.empty((0, 4, 4)),), "path has the wrong shape"),
        (([["a"]],), "not numeric"),
        ((2 * np.eye(4)[None],), "pose 1 of the path"),
        ((np.eye(4)[None], [1.0, 2.0]), "array of wrenches (has the wrong shape|must be finite)"),
        ((np.eye(4)[None], [np.nan] * 6), "array of wrenches (has the wrong shape|must be finite)"),
        ((np.eye(4)[None], None, [0.0, 0.0, 0.0]), "direction of the path is zero"),
        ((np.eye(4)[None], None, None, "tool"), "unknown axes"),
    ],
)
def test_paths_that_are_none(arguments, match):
    refused(match, ToolPath, *arguments)


@pytest.mark.parametrize(
    ("arguments", "match"),
    [
        ((np.zeros(3), [0, 0, 1]), "array of positions has the wrong shape"),
        ((np.zeros((2, 3)), [0, 0, 0]), "a tool axis is zero"),
        ((np.zeros((2, 3)), [0, 0, 1], "w"), "unknown axis"),
    ],
)
def test_tool_axes_that_are_none(arguments, match):
    refused(match, ToolPath.from_axes, *arguments, kind=(InputError, UnknownNameError))


def test_a_path_ends_where_its_cost_is_flat_along_the_self_motion():
    """By exact slopes: steps that are halved end at 1e-5 of the deflection per radian."""
    arm = cartstiff.load("xarm7")
    poses = np.repeat(arm.mechanism.at(arm.q).pose[None], 7, axis=0)
    poses[:, 1, 3] += np.linspace(-0.1, 0.0, 7)
    W = np.array([0.0, 0.0, 0.0, 0.0, 0.0, -50.0])
    path = ToolPath(poses, wrenches=np.tile(W, (7, 1)), axes="world")
    found = optimise_path(arm, path, smoothness=0.0, near="anywhere")

    def deflection(q):
        result = cartstiff.analyse(arm, q)
        R = result.pose[:3, :3]
        return np.linalg.norm((result.compliances["B"] @ np.append(R.T @ W[:3], R.T @ W[3:]))[3:])

    for q in found.q:
        J = cartstiff.analyse(arm, q).posture.motion.jacobian
        # A pose that is off by h^2 on both sides does not change the difference.
        idle, h = np.linalg.svd(J)[2][6], 1e-4
        slope = (deflection(q + h * idle) - deflection(q - h * idle)) / (2.0 * h)
        assert abs(slope) <= 3e-7 * deflection(q)
