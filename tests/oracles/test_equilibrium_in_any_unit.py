"""Platforms with soft legs beside stiff ones come to rest at one place, whatever unit they are in.

Preload turns the body far along the motions that the stiff legs leave. The place is that at which
tensions balance, in sixty digits, from the points and the stiffnesses of the legs alone.
"""

import mpmath as mp
import numpy as np
import pytest
from tests.support import absolute_error, platform_mechanism

import cartstiff
from cartstiff.extend import in_units

SOFT = 1e-3
METRES = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6}
# Rounding of a few numbers of size 1, and what it does to soft motions beside stiff legs.
SAME = 1e-11


def hexagons():
    """Anchors and points of six legs between two hexagons, and the pose."""
    corners = np.repeat(2 * np.pi / 3 * np.arange(3), 2) + np.tile([-0.2, 0.2], 3)
    base, top = (
        radius * np.stack([np.cos(at), np.sin(at), np.zeros(6)], axis=1)
        for radius, at in ((0.5, corners), (0.3, corners + np.pi / 3))
    )
    return np.roll(base, -1, axis=0), top, np.array([0.0, 0.0, 0.6, 0.0, 0.0, 0.0])


def anywhere(seed):
    rng = np.random.default_rng(seed)
    base, top = rng.uniform(-0.5, 0.5, (6, 3)), rng.uniform(-0.3, 0.3, (6, 3))
    base[:, 2] *= 0.1
    top[:, 2] *= 0.1
    pose = np.array([*rng.uniform(-0.1, 0.1, 2), 0.5, *rng.uniform(-0.2, 0.2, 3)])
    return base, top, pose


def unbalanced(elastic, R0, *x):
    """Force, and moment about M, of the legs at position x[:3], turned by x[3:] from R0."""
    turn = mp.matrix([[0, -x[5], x[4]], [x[5], 0, -x[3]], [-x[4], x[3], 0]])
    R, p = mp.expm(turn) * R0, mp.matrix(x[:3])
    force, moment, springs = mp.zeros(3, 1), mp.zeros(3, 1), elastic.springs
    for anchor, point, k, rest in zip(
        springs.anchors, springs.points, springs.stiffness, springs.rest_length, strict=True
    ):
        arm = R * mp.matrix(point.tolist())
        along = p + arm - mp.matrix(anchor.tolist())
        pull = mp.mpf(float(k)) * (1 - mp.mpf(float(rest)) / mp.norm(along)) * along
        force += pull
        moment += mp.matrix(
            [
                arm[1] * pull[2] - arm[2] * pull[1],
                arm[2] * pull[0] - arm[0] * pull[2],
                arm[0] * pull[1] - arm[1] * pull[0],
            ]
        )
    return [*force, *moment]


@pytest.mark.parametrize(
    ("place", "stiffness", "preload"),
    [
        (None, [SOFT] + [1e6] * 5, 1e-5),
        (None, [SOFT] * 2 + [1e6] * 4, 1e-5),
        (None, [1e6] + [SOFT] * 5, 1e-4),
        (None, [1e6, SOFT] * 3, 1e-4),
        (None, [SOFT] * 4 + [1e6] * 2, 1e-4),
        (None, [3e5, SOFT] * 3, 1e-4),
        (None, [1e5, SOFT] * 3, 1e-4),
        (None, [9e4, SOFT] * 3, 1e-4),
        (None, [3e2] + [SOFT] * 5, 1e-4),
        (55, [1e6, SOFT, 2e5, 1e4, SOFT, 1e3], [-2e-5, 8e-5, 1e-5, -9e-5, 6e-5, 4e-5]),
    ],
)
def test_rest_is_the_same_place_in_every_unit(place, stiffness, preload):
    base, top, q = hexagons() if place is None else anywhere(place)
    k = np.array(stiffness)
    at_file = platform_mechanism(base, top, k, np.full(6, np.nan), q=q)
    lengths = at_file.springs.lengths_at(at_file.mechanism.at(q).pose)
    elastic = platform_mechanism(base, top, k, lengths - np.array(preload) / k, q=q)
    states = {unit: cartstiff.equilibrium(in_units(elastic, unit)) for unit in METRES}
    pose = states["m"].pose
    with mp.workdps(60):
        R0, p0 = mp.matrix(pose[:3, :3].tolist()), pose[:3, 3].tolist()
        x = mp.findroot(
            lambda *x: unbalanced(elastic, R0, *x),
            [*map(mp.mpf, p0), *[mp.mpf(0)] * 3],
            tol=mp.mpf(10) ** -60,
        )
        turned = mp.expm(mp.matrix([[0, -x[5], x[4]], [x[5], 0, -x[3]], [-x[4], x[3], 0]])) * R0
        exact = np.eye(4)
        exact[:3, :3] = np.array(turned.tolist(), float)
        exact[:3, 3] = [float(c) for c in x[:3]]
    moved = absolute_error(exact, states["m"].start.pose)
    assert moved > 1e-3
    for unit, state in states.items():
        found = state.pose.copy()
        found[:3, 3] *= METRES[unit]
        assert absolute_error(found, exact) < SAME, unit
        assert state.stable is True
        assert [n.code for n in state.notes] == [n.code for n in states["m"].notes], unit
