"""Inverse kinematics against closed forms, Pinocchio's forward kinematics, and what must hold."""

import numpy as np
import pytest
from tests.doors import JointPoses
from tests.machining import planar
from tests.support import frame_pose, loaded_arm, random_pose
from tests.support.robots import example_robots

import cartstiff
from cartstiff import InputError, inverse_kinematics
from cartstiff.geometry import se3

# Solutions are iterated until rounding is left, in rad and lengths of about one.
EXACT = 1e-9
needs_robots = pytest.mark.skipif(not example_robots(), reason="example robots are not installed")

# Link lengths and offsets of the UR5 as its maker gives them.
D1, A2, A3, D4, D5, D6 = 0.089159, 0.425, 0.39225, 0.10915, 0.09465, 0.0823


def ur5_branches(T):
    """How many postures a UR5 has at a pose of its flange, and the distance to where that changes.

    The wrist's centre lies D4 aside of the arm's plane: two planes. In each, the flange's axis
    leaves two directions for the fifth joint's axis, and the arm is a planar one of two links.
    """
    centre, axis = T[:3, 3] - D6 * T[:3, 2], T[:3, 2]
    rho = float(np.hypot(*centre[:2]))
    if rho < D4:
        return 0, D4 - rho
    count, margin = 0, rho - D4
    for side in (1.0, -1.0):
        turn = np.arctan2(centre[1], centre[0]) + side * np.arccos(D4 / rho)
        normal = np.array([np.cos(turn), np.sin(turn), 0.0])
        across = np.cross(normal, axis)
        margin = min(margin, float(np.linalg.norm(across)))
        for sign in (1.0, -1.0):
            fourth = centre + sign * D5 * across / np.linalg.norm(across)
            reach = fourth - D4 * normal - np.array([0.0, 0.0, D1])
            r = float(np.linalg.norm(reach - normal * (normal @ reach)))
            margin = min(margin, abs(r - (A2 + A3)), abs(r - (A2 - A3)))
            count += 2 * (A2 - A3 < r < A2 + A3)
    return count, margin


@needs_robots
def test_all_branches_of_a_ur5_are_found():
    arm = cartstiff.load("ur5")
    rng = np.random.default_rng(5)
    counts = []
    for _ in range(40):
        q = rng.uniform(-np.pi, np.pi, 6)
        T = arm.mechanism.at(q).pose
        expected, margin = ur5_branches(T)
        if margin < 0.01:  # branches about to meet are found by few starts
            continue
        found = inverse_kinematics(arm, T, 150)
        assert len(found) == expected
        counts.append(expected)
        at_q = np.abs(np.exp(1j * found) - np.exp(1j * q)).max(axis=1)
        assert at_q.min() < 1e-8  # the posture that the pose is from is among them
        for row in found:
            np.testing.assert_allclose(arm.mechanism.at(row).pose, T, atol=EXACT)
    assert len(counts) > 20
    assert {4, 8} <= set(counts)


@pytest.mark.parametrize("kinds", ["RRRRRR", "RPRRPR", "RRHRRPR", "PPP", "RRR"])
def test_solutions_have_the_pose(kinds):
    arm = loaded_arm(kinds, 3)
    wanted = frame_pose(arm.model, arm.q, "tip")
    found = inverse_kinematics(arm.elastic, wanted, 40)
    assert len(found)
    for row in found:
        np.testing.assert_allclose(frame_pose(arm.model, row, "tip"), wanted, atol=1e-8)


def test_planar_arm_has_its_two_postures():
    arm = planar.arm()
    for x, y, yaw in ((0.6, 0.3, 0.4), (-0.2, 0.5, 2.0), (0.3, -0.6, -1.2)):
        found = inverse_kinematics(arm, planar.poses(np.array([[x, y]]), yaw)[0], 20)
        expected = planar.inverse(x, y, yaw)
        expected = expected[np.argsort(expected[:, 0])]
        np.testing.assert_allclose(found, expected, atol=EXACT)


def test_free_rotation_leaves_the_axis_and_the_place():
    arm = planar.arm()
    T = planar.poses(np.array([[0.5, 0.4]]))[0]
    found = inverse_kinematics(arm, T, 15, free="z")
    assert len(found) > 5  # a whole self-motion: every start leads somewhere else
    np.testing.assert_allclose(planar.positions(found)[:, 3], [[0.5, 0.4]] * len(found), atol=EXACT)
    assert np.ptp(found.sum(axis=1)) > 0.5


@needs_robots
@pytest.mark.parametrize("free", ["x", "y", "z"])
def test_free_axis_in_space(free):
    arm = cartstiff.load("ur5")
    T = arm.mechanism.at(arm.q).pose
    k = "xyz".index(free)
    found = inverse_kinematics(arm, T, 12, free=free, seed=4)
    assert len(found) > 5
    for row in found:
        pose = arm.mechanism.at(row).pose
        np.testing.assert_allclose(pose[:3, [k, 3]], T[:3, [k, 3]], atol=EXACT)


def test_limits_hold():
    T = planar.poses(np.array([[0.6, 0.3]]), 0.4)[0]
    up, down = planar.inverse(0.6, 0.3, 0.4)
    assert up[1] > 0 > down[1]
    narrow = planar.arm(limits=np.array([3.0, 3.0, np.abs(down[2]) + 0.01]))
    assert np.abs(up[2]) > np.abs(down[2]) + 0.01
    np.testing.assert_allclose(inverse_kinematics(narrow, T, 30), [down], atol=EXACT)
    assert len(inverse_kinematics(narrow, T, 30, limits=False)) == 2


@needs_robots
def test_joints_at_their_limits_do_not_hold_up_the_others():
    """Nearly half of all random starts of a Panda arrive; a third without letting limits go."""
    arm = cartstiff.load("panda")
    solver = JointPoses(arm)
    q = solver.random_starts(10, np.random.default_rng(1))
    T = np.array([arm.mechanism.at(row).pose for row in q])
    starts = np.tile(solver.random_starts(40, np.random.default_rng(2)), (10, 1))
    found, good = solver.solve(np.repeat(T, 40, axis=0), starts)
    assert good.mean() > 0.4
    assert np.all((found >= solver.lower) & (found <= solver.upper))


def test_out_of_reach_gives_none():
    found = inverse_kinematics(planar.arm(), planar.poses(np.array([[2.0, 0.0]]))[0])
    assert found.shape == (0, 3)


def test_stack_is_the_single_poses():
    arm = planar.arm()
    T = planar.poses(np.array([[0.6, 0.3], [3.0, 0.0], [0.2, 0.5]]), 0.4)
    together = inverse_kinematics(arm, T, 20)
    assert [len(q) for q in together] == [2, 0, 2]
    for pose, q in zip(T, together, strict=True):
        np.testing.assert_array_equal(inverse_kinematics(arm, pose, 20), q)


def test_whole_turns_are_one_posture():
    arm = planar.arm(limits=7.0)
    T = planar.poses(np.array([[0.6, 0.3]]), 0.4)[0]
    q = planar.inverse(0.6, 0.3, 0.4)
    starts = np.vstack([q, q + np.array([2 * np.pi, 0, 0]), q - np.array([0, 0, 2 * np.pi])])
    found = inverse_kinematics(arm, T, starts)
    assert len(found) == 2
    assert np.abs(found).max() <= np.pi


def test_redundant_solution_stays_near_its_start():
    """The least steps end nearer to the start than the nearest end of any other posture by far."""
    arm = planar.arm()
    q = np.array([0.5, 0.9, -0.6])
    T = planar.poses(planar.positions(q)[None, 3])[0]
    start = q + np.array([0.02, -0.03, 0.01])
    found = inverse_kinematics(arm, T, start[None], free="z")
    away = np.linalg.norm(found - start, axis=1).min()
    yaw = np.linspace(-np.pi, np.pi, 20001)
    curve = planar.inverse(*planar.positions(q)[3], yaw).reshape(-1, 3)
    nearest = np.nanmin(np.linalg.norm(curve - start, axis=1))
    assert nearest <= away + 1e-9
    assert away == pytest.approx(nearest, rel=0.05)


def test_cost_is_smallest_along_the_self_motion():
    arm, force = planar.arm(), np.array([30.0, 50.0])
    point = np.array([0.55, 0.35])
    found = inverse_kinematics(
        arm,
        planar.poses(point[None])[0],
        12,
        free="z",
        cost=lambda q: planar.deflection(q, force),
    )
    yaw = np.linspace(-np.pi, np.pi, 4001)
    curve = planar.deflection(planar.inverse(*point, yaw), force)
    best = planar.deflection(found, force).min()
    assert best <= np.nanmin(curve) * (1 + 1e-6)
    assert best == pytest.approx(np.nanmin(curve), rel=1e-4)  # the grid's own spacing
    assert len(found) < 12  # starts that end in the same minimum are one


@pytest.mark.parametrize(("name", "free"), [("ur5", "rotation"), ("ur5", "y"), ("panda", "none")])
def test_settled_solutions_have_no_slope_left(name, free):
    """Along the self-motions of an independent decomposition, where no joint is at a limit."""
    arm = cartstiff.load(name)
    near, T = arm.q + 0.3, arm.mechanism.at(arm.q + 0.1).pose
    solver = JointPoses(arm)
    found = inverse_kinematics(
        arm, T, 20, free=free, cost=lambda q: (1.0 - np.cos(q - near)).sum(axis=1)
    )
    inside = ((found > solver.lower + 1e-6) & (found < solver.upper - 1e-6)).all(axis=1)
    assert inside.sum() >= 2
    motions = solver.self_motions(found, free, solver.redundancy(free))
    slopes = np.einsum("nij,ni->nj", motions, np.sin(found - near))
    np.testing.assert_allclose(slopes[inside], 0.0, atol=1e-4)


def test_limits_that_are_whole_turns_hold_nothing_up():
    """Starts beyond half a turn settle where those of the same postures within it do."""
    arm = cartstiff.load("ur5")
    T = se3.pose(np.eye(3), [0.4, 0.2, 0.3])
    starts = JointPoses(arm).random_starts(12, np.random.default_rng(2))
    beyond = starts - 2 * np.pi * np.sign(starts) * (np.arange(6) != 2)

    def away(q):
        return ((np.mod(q - arm.q + np.pi, 2 * np.pi) - np.pi) ** 2).sum(axis=1)

    a, b = (inverse_kinematics(arm, T, s, free="rotation", cost=away) for s in (starts, beyond))
    np.testing.assert_allclose(a, b, atol=1e-5)


def test_edge_of_a_cost_is_found():
    """Down to the bottom of a valley with an edge, which no slope announces."""
    arm = planar.arm()
    T = planar.poses(np.array([[0.55, 0.35]]))[0]
    found = inverse_kinematics(
        arm, T, 12, free="z", cost=lambda q: np.maximum(q[:, 1] - 1.2, 0.5 * (1.2 - q[:, 1]))
    )
    up = found[found[:, 1] > 0, 1]
    assert len(up)
    np.testing.assert_allclose(up, 1.2, atol=1e-4)


def test_posture_without_a_cost_moves_to_one_with():
    arm = planar.arm()
    T = planar.poses(np.array([[0.55, 0.35]]))[0]
    found = inverse_kinematics(
        arm, T, 12, free="z", cost=lambda q: np.where(np.abs(q[:, 1]) < 0.8, np.nan, q[:, 1] ** 2)
    )
    assert (np.abs(found[:, 1]) >= 0.8).all()


def test_platform_is_its_own_inverse():
    platform = cartstiff.load("hexapod")
    T = platform.mechanism.at(platform.q).pose
    found = inverse_kinematics(platform, T)
    np.testing.assert_allclose(found, [platform.q], atol=EXACT)
    far = T.copy()
    far[2, 3] += 10.0
    assert inverse_kinematics(platform, far).shape == (0, 6)
    assert len(inverse_kinematics(platform, far, limits=False)) == 1


def test_closed_chain_closes():
    arm = cartstiff.load("five-bar")
    T = arm.mechanism.closed(arm.q).pose
    T = se3.pose(translation=[0.01, 0.01, 0.0]) @ T
    found = inverse_kinematics(arm, T, arm.q[None], free="rotation")
    assert len(found)
    for row in found:
        posture = arm.mechanism.at(row)
        np.testing.assert_allclose(posture.residual, 0.0, atol=EXACT)
        np.testing.assert_allclose(posture.pose[:3, 3], T[:3, 3], atol=EXACT)


def test_same_seed_same_answer():
    arm = planar.arm()
    T = planar.poses(np.array([[0.5, 0.4]]))[0]
    a, b = (inverse_kinematics(arm, T, 9, free="z", seed=3) for _ in range(2))
    np.testing.assert_array_equal(a, b)
    assert np.all(np.diff(a[:, 0]) > -1e-4)


@pytest.mark.parametrize(
    ("change", "match"),
    [
        ({"free": "w"}, "unknown free rotation"),
        ({"T_F_M": np.eye(3)}, "array of poses has the wrong shape"),
        ({"T_F_M": 2 * np.eye(4)}, "pose 1 is not a rigid motion"),
        ({"T_F_M": [["a"]]}, "array of poses is not numeric"),
        ({"starts": np.zeros((2, 4))}, "array of starts (has the wrong shape|must be finite)"),
        ({"starts": -1}, "must not be negative"),
        ({"starts": [["a", "b", "c"]]}, "array of starts is not numeric"),
        ({"starts": [[0.0, np.nan, 0.0]]}, "array of starts (has the wrong shape|must be finite)"),
    ],
)
def test_refusals(change, match):
    arguments = {"T_F_M": random_pose(np.random.default_rng(0)), **change}
    with pytest.raises(InputError, match=match):
        inverse_kinematics(planar.arm(), **arguments)
