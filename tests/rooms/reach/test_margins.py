"""Margins of a workspace: working modes of legs, tensions, the limits of a machine."""

import numpy as np
import pytest
from scipy.optimize import linprog
from scipy.spatial.transform import Rotation
from tests.doors import Margins, lines_at
from tests.inner import LegMargins, around, wrench_margins
from tests.laws.test_same_limits import machine_of, same_limits

import cartstiff


def test_legs_of_joints_stay_in_their_working_mode():
    """A delta at 1500 places, against its cranks and both its determinants in closed form."""
    crank, rod, base, plate = 0.2, 0.45, 0.15, 0.05
    delta = cartstiff.load("delta")
    pose = cartstiff.analyse(delta).pose
    turns = [Rotation.from_euler("z", 2 * np.pi * k / 3).as_matrix() for k in range(3)]
    places = np.random.default_rng(0).uniform([-0.5, -0.5, -0.75], [0.5, 0.5, -0.05], (1500, 3))
    places[0] = pose[:3, 3]
    cranks, rods, held = [], [], []
    for R in turns:
        B = places @ R + [plate - base, 0, 0]  # in the leg's own axes; cranks turn about y
        c = ((B * B).sum(axis=1) + crank**2 - rod**2) / (2 * crank)
        with np.errstate(invalid="ignore"):
            t = np.arctan2(-B[:, 2], B[:, 0]) - np.arccos(c / np.hypot(B[:, 0], B[:, 2]))
        n = (B - crank * np.column_stack([np.cos(t), 0 * t, -np.sin(t)])) / rod
        # Two universal joints with parallel outer axes y keep the body from turning about this:
        across = np.cross([0.0, 1.0, 0.0], np.cross([0.0, 1.0, 0.0], n))
        cranks.append(t)
        rods.append(n @ R.T)
        held.append(across @ R.T)
    cranks = np.column_stack(cranks)
    reached = np.isfinite(cranks).all(axis=1)
    with np.errstate(invalid="ignore"):
        signs = np.linalg.det(np.stack(rods, axis=1)) * np.linalg.det(np.stack(held, axis=1))
    margins, poses = LegMargins(delta, pose), np.tile(pose, (1500, 1, 1))
    poses[:, :3, 3] = places
    q = margins.solved(poses)
    np.testing.assert_array_equal(np.isfinite(q).all(axis=1), reached)
    away = q[reached][:, delta.mechanism.actuated] - cranks[reached]
    assert np.abs((away + np.pi) % (2 * np.pi) - np.pi).max() < 1e-8
    np.testing.assert_array_equal(margins.inside(poses), reached & (signs * signs[0] > 0))


def test_tensions_that_carry_a_wrench_are_those_of_a_linear_programme():
    cables = cartstiff.load("cable-robot").mechanism
    rng = np.random.default_rng(2)
    places = rng.uniform(-0.5, 0.5, (40, 3)) * [1, 0.7, 0.5]
    q = np.column_stack([places, rng.normal(size=(40, 3)) / 5])
    q[:, 2] += 0.6
    poses = np.array([cables.pose_of(row) for row in q])
    lines = lines_at(cables, poses)[1]
    wrench = rng.normal(size=(40, 6)) * [3, 3, 3, 25, 25, 25]
    least, most = np.full(8, 5.0), np.full(8, 120.0)
    margins = wrench_margins(lines, wrench, least, most)
    feasible = [
        linprog(np.zeros(8), A_eq=A.T, b_eq=W, bounds=[(5.0, 120.0)] * 8).status == 0
        for A, W in zip(lines, wrench, strict=True)
    ]
    assert (margins > 0).tolist() == feasible
    assert 4 < sum(feasible) < 36


@pytest.mark.parametrize("through", [False, True])
def test_a_platform_as_a_tree_has_the_workspace_of_the_platform(through):
    """Also below its base: beyond singular poses, where universal joints have folded over."""
    tree, platform = cartstiff.load("6-ups"), cartstiff.load("hexapod")
    pose = platform.mechanism.pose_of(platform.q)
    shifts = np.random.default_rng(1).uniform(-1, 1, (400, 3)) * [1.3, 1.3, 1.1] - [0, 0, 0.5]
    poses = around(pose, np.zeros((1, 3)), shifts)
    margins = Margins(platform)
    margins.sign = 0.0 if through else float(np.sign(margins.determinants(pose[None])[0]))
    inside = margins.inside(poses)
    assert inside.sum() > 10
    assert LegMargins(tree, pose, through).inside(poses).tolist() == inside.tolist()


def test_limits_of_legs_made_of_joints(tmp_path):
    """Which margins are negative: those that the notes of `analyse` name, by as much."""
    rods = machine_of("rods", tmp_path)
    poses = np.array([rods.elastic.mechanism.at(q).pose for q in rods.q])
    margins = LegMargins(rods.elastic, poses[0], through=True)
    same_limits(margins.names, margins.at(poses), rods.said)
