"""`equilibrium` under a wrench of each kind, against loads built one by one and the tangent."""

from __future__ import annotations

import numpy as np
import pytest
from tests.doors import SemitangentialWrench
from tests.support import (
    absolute_error,
    crossed_bars,
    refused,
    slope,
)

import cartstiff
from cartstiff import (
    DeadForce,
    DeadWrench,
    FollowerWrench,
    compensate,
    equilibrium,
    load_curve,
)
from cartstiff.core.errors import UnknownNameError
from cartstiff.geometry import se3

KINDS = ("dead", "follower", "conservative")
AT = np.array([0.02, -0.03, 0.06])
WRENCH = np.array([2.0, -1.0, 3.0, 120.0, -80.0, -150.0])


def _one_by_one(kind: str, R: np.ndarray, axes: str) -> list:
    """The load from dead forces at points of the body, which need no theory of moments."""
    to_body = R.T if axes == "world" else np.eye(3)
    moment, force = to_body @ WRENCH[:3], to_body @ WRENCH[3:]
    if kind == "follower":
        return [FollowerWrench([*(moment + np.cross(AT, force)), *force])]
    loads: list = [DeadForce(R @ force, AT)]
    if kind == "dead":
        return [*loads, DeadWrench([*(R @ moment), 0, 0, 0])]
    return loads + [DeadForce(R @ f, AT + end) for end, f in crossed_bars(moment, 0.05)]


@pytest.mark.parametrize("axes", ["body", "world"])
@pytest.mark.parametrize("kind", KINDS)
def test_a_wrench_is_the_load_built_one_by_one(kind, axes):
    arm = cartstiff.load("hexapod")
    R = arm.mechanism.at(arm.q).pose[:3, :3]
    loads = _one_by_one(kind, R, axes)
    load = {"wrench": WRENCH, "load_kind": kind, "load_at": AT, "load_axes": axes}
    expected, found = equilibrium(arm, *loads), equilibrium(arm, **load)
    moved = absolute_error(expected.q, arm.q)
    assert moved > 1e-5
    assert absolute_error(found.q, expected.q) < 1e-9 * moved
    curve = load_curve(arm, **load, to=1.0)
    by_loads = load_curve(arm, *loads, to=1.0)
    assert absolute_error(curve.q[-1], by_loads.q[-1]) < 1e-7 * moved


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", ["hexapod", "cubic", "6-ups"])
def test_the_tangent_there_is_that_of_analyse(name, kind):
    """Balanced by the springs, the load moves nothing: both stand at the same posture."""
    load = {"wrench": 0.2 * WRENCH, "load_kind": kind, "load_at": AT, "load_axes": "world"}
    here = cartstiff.analyse(cartstiff.load(name), **load)
    state = equilibrium(here.elastic, **load, q=here.q, limits=False, settle=False)
    assert absolute_error(state.q, here.q) < 1e-9
    size = np.repeat([here.posture.length, 1.0], 3)

    def motion(t, unit):
        more = cartstiff.core.potentials.loads.FollowerWrench(t * unit)
        there = equilibrium(here.elastic, here.q, more, **load, limits=False, settle=False)
        return se3.log(se3.inverse(state.pose) @ there.pose)

    C = np.column_stack([slope(lambda t, u=unit: motion(t, u), 0.5) for unit in np.diag(size)])
    missed = (here.tangent_compliance * size - C) * size[:, None]
    assert np.abs(missed).max() < 1e-6 * np.abs(C * size[:, None]).max()


def test_a_semitangential_wrench_is_dead_forces_on_crossed_bars():
    """Anywhere, not only where it begins; and its derivatives are those of its energy."""
    rng = np.random.default_rng(4)
    start = se3.exp(rng.normal(size=6))
    w, R = rng.normal(size=6), start[:3, :3]
    load = SemitangentialWrench([*(R @ w[:3]), *(R @ w[3:])], R, point=AT)
    forces = [DeadForce(R @ w[3:], AT)]
    forces += [DeadForce(R @ f, AT + end) for end, f in crossed_bars(w[:3], 0.3)]
    for _ in range(5):
        T = se3.exp(rng.normal(size=6))
        parts = [f.on_pose(T) for f in forces]
        for found, expected in zip(
            load.on_pose(T), map(sum, zip(*parts, strict=True)), strict=True
        ):
            assert found == pytest.approx(expected, rel=1e-12, abs=1e-12)


@pytest.mark.parametrize("kind", KINDS)
def test_compensation_under_each_kind(kind):
    arm = cartstiff.load("hexapod")
    path = compensate(arm, arm.q[None], WRENCH, load_axes="body", load_kind=kind, load_at=AT)
    loads = _one_by_one(kind, arm.mechanism.at(arm.q).pose[:3, :3], "body")
    by_loads = compensate(arm, arm.q[None], [loads])
    assert absolute_error(path.commands, by_loads.commands) < 1e-12
    moved = np.abs(by_loads.before).max()
    assert absolute_error(path.before, by_loads.before) < 1e-9 * moved
    assert np.abs(path.after).max() < 1e-7 * moved


def test_refusals():
    arm = cartstiff.load("hexapod")
    refused(
        "kind of load", equilibrium, arm, wrench=WRENCH, load_kind="live", kind=UnknownNameError
    )
    refused("axes", equilibrium, arm, wrench=WRENCH, load_axes="path", kind=UnknownNameError)
    refused("point of the load", equilibrium, arm, wrench=WRENCH, load_at=[1.0, 2.0])
    refused("needs a load", load_curve, arm)
