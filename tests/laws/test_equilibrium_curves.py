"""Load-deflection curves, limit points, branches; compensation along a path; figures."""

from __future__ import annotations

import json
import sys
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from scipy.optimize import brentq
from tests.doors import Chain, PolynomialLaw, figure_content, plain_tree, with_rest_balancing
from tests.support import (
    absolute_error,
    links,
    refused,
    robot_file,
)

import cartstiff
from cartstiff import (
    CartstiffError,
    ConvergenceError,
    DeadForce,
    DeadWrench,
    ElasticMechanism,
    FollowerWrench,
    InputError,
    JointSprings,
    LineSprings,
    UndefinedError,
    compensate,
    equilibrium,
    load_curve,
)
from cartstiff.core.errors import MissingDependencyError
from cartstiff.extend import Platform
from cartstiff.geometry import se3

HALF, HEIGHT, STIFFNESS = 1.0, 0.3, 50.0
REST = float(np.hypot(HALF, HEIGHT))


def truss(held: int = 0) -> ElasticMechanism:
    """Two springs from the ground to a slider between them: snaps through under its load.

    Below it are sliders that springs hold.
    """
    model, joint = pin.Model(), 0
    for i in range(held + 1):
        joint = model.addJoint(joint, pin.JointModelPZ(), pin.SE3.Identity(), f"slider{i}")
    model.addFrame(pin.Frame("top", joint, 0, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
    lines = LineSprings(
        anchors=np.array([[-HALF, 0.0, 0.0], [HALF, 0.0, 0.0]]),
        points=np.zeros((2, 3)),
        stiffness=np.full(2, STIFFNESS),
        rest_length=np.full(2, REST),
    )
    springs = [JointSprings(np.append(np.full(held, 100.0), 0.0), np.zeros(1 + held))]
    q, terms = np.append(np.zeros(held), HEIGHT), (lines, *springs[:held])
    return ElasticMechanism("truss", Chain(plain_tree(model), "top"), q, potentials=terms)


def column(n: int, imperfection: float = 0.0) -> ElasticMechanism:
    return links(np.ones(n), rest=imperfection)


def truss_load(z):
    length = np.hypot(HALF, z)
    return -2 * STIFFNESS * (length - REST) * z / length


def test_the_curve_passes_the_limit_points_of_a_truss():
    curve = load_curve(truss(), DeadForce([0.0, 0.0, -1.0]), to=2.0)
    assert curve.reason == "factor-reached"
    z = curve.q[:, 0]
    assert z.min() < -HEIGHT
    assert np.allclose(curve.factors, truss_load(z), rtol=0, atol=1e-9)
    at_limit = np.sqrt((REST * HALF**2) ** (2 / 3) - HALF**2)
    assert [c.kind for c in curve.critical] == ["limit", "limit"]
    assert np.allclose([c.q[0] for c in curve.critical], [at_limit, -at_limit], atol=1e-8)
    expected = truss_load(at_limit)
    assert np.allclose([c.factor for c in curve.critical], [expected, -expected], atol=1e-10)
    unstable = np.abs(z) < at_limit
    assert [s is False for s in curve.stable] == unstable.tolist()
    assert curve.factors[-1] == pytest.approx(2.0, abs=1e-13)


def test_limit_points_are_passed_with_steps_as_long_as_the_others():
    """A second slider that a spring holds stays at zero: the curve's points are the truss's."""
    load = DeadForce([0.0, 0.0, -1.0])
    one, two = load_curve(truss(), load, to=2.0), load_curve(truss(held=1), load, to=2.0)
    assert two.q[:, 0] == pytest.approx(0.0, abs=1e-12)
    assert two.q[:, 1] == pytest.approx(one.q[:, 0], abs=1e-9)
    assert two.factors == pytest.approx(one.factors, abs=1e-9)


def test_snapping_through_under_more_than_the_limit_load():
    state = equilibrium(truss(), DeadForce([0.0, 0.0, -1.2 * 2.0]))
    assert state.stable
    assert state.q[0] < -HEIGHT
    assert truss_load(state.q[0]) == pytest.approx(2.4, rel=1e-10)


@pytest.mark.parametrize(("to", "resolution"), [(2.0, 0.05), (1.5, 3.0)])
def test_the_branch_of_one_link_is_the_exact_one(to, resolution):
    """From a first step of 3 rad Newton's method does not return to the branch, from half of it."""
    curve = load_curve(column(1), DeadForce([-1.0, 0.0, 0.0]), to=to, resolution=resolution)
    assert [c.factor for c in curve.critical] == pytest.approx([1.0], abs=1e-8)
    for direction in (1, -1):
        bent = curve.branch(0, direction)
        angle = bent.q[1:, 0]
        assert np.allclose(bent.factors[1:], angle / np.sin(angle), rtol=1e-9)
        assert all(bent.stable[1:])
        assert bent.reason == "factor-reached"
    assert curve.branch(0, 1).q[-1, 0] == pytest.approx(-curve.branch(0, -1).q[-1, 0])


@pytest.mark.parametrize("n", [2, 3])
def test_branches_hold_balanced_states(n):
    elastic = column(n)
    curve = load_curve(elastic, DeadForce([-1.0, 0.0, 0.0]), to=1.5)
    bent = curve.branch()
    for factor, q in zip(bent.factors, bent.q, strict=True):
        forces = elastic.with_potential(DeadForce([-factor, 0.0, 0.0]))
        assert np.abs(forces.evaluate(elastic.mechanism.at(q)).gradient).max() < 1e-9


def test_an_imperfect_column_bends_without_a_critical_load():
    curve = load_curve(column(2, 0.01), DeadForce([-1.0, 0.0, 0.0]), to=0.6, resolution=0.02)
    assert curve.critical == ()
    assert all(curve.stable)
    # The tip's deflection is magnified by about 1 / (1 - p / p_critical).
    assert curve.linear_up_to(0.05) == pytest.approx(0.05 * 0.382, rel=0.1)
    # Between the last two points, on the straight line through their deviations; or never.
    before, last = curve.deviation[-2:, 1]
    middle = curve.linear_up_to(0.5 * (before + last))
    assert middle == pytest.approx(curve.factors[-2:].mean())
    assert curve.linear_up_to(1.01 * curve.deviation[:, 1].max()) == curve.factors[-1]


def test_the_linear_prediction_is_tangent_to_the_curve():
    robot_file("ur_description/urdf/ur5_robot.urdf")
    load = DeadForce([100.0, 50.0, -200.0])
    curve = load_curve(cartstiff.load("ur5"), load, resolution=0.1)
    assert np.array_equal(curve.deviation[0], [0.0, 0.0])
    ratio = curve.deviation[1:] / curve.factors[1:, None]
    assert np.all(np.ptp(ratio, axis=0) < 0.1 * ratio.mean(axis=0))  # it goes as the load
    # No length enters: each half is judged by itself.
    for part, column in ((slice(0, 3), 0), (slice(3, 6), 1)):
        off = np.linalg.norm((curve.linear - curve.displacement)[-1, part])
        assert curve.deviation[-1, column] == off / np.linalg.norm(curve.displacement[-1, part])
    end = equilibrium(cartstiff.load("ur5"), load)
    assert absolute_error(curve.q[-1], end.q) < 1e-11


@pytest.mark.parametrize("name", ["stewart-gough", "five-bar"])
def test_curves_end_where_the_equilibrium_is(name):
    elastic = cartstiff.load(name)
    elastic = with_rest_balancing(elastic, elastic.q, np.zeros(6))
    load = DeadForce([1.0, -2.0, 0.0 if name == "five-bar" else 3.0])
    curve = load_curve(elastic, load, resolution=0.2)
    state = equilibrium(elastic, load)
    assert curve.reason == "factor-reached"
    assert absolute_error(curve.q[-1], state.q) < 1e-9


def test_a_follower_force_never_buckles_a_column_statically():
    push = FollowerWrench([0.0, 0.0, 0.0, -1.0, 0.0, 0.0])
    curve = load_curve(column(2), push, to=6.0)
    assert curve.critical == ()
    assert curve.stable == (None,) * len(curve.factors)
    # H_N keeps the determinant of the springs.
    state = equilibrium(column(2), push)
    tangent = state.elastic.with_potential(push).evaluate(state.posture).hessian
    assert np.linalg.det(tangent) == pytest.approx(1.0, rel=1e-12)


def test_a_curve_ends_at_a_joint_limit():
    elastic = column(1, 0.01)
    coordinates = elastic.mechanism.coordinates
    elastic.mechanism.coordinates = (replace(coordinates[0], upper=0.5),)
    curve = load_curve(elastic, DeadForce([-1.0, 0.0, 0.0]), to=2.0)
    assert curve.reason == "limit-contact"
    assert 0.4 < curve.q.max() <= 0.5


def test_a_load_that_falls_too_far_ends_the_curve():
    elastic = cartstiff.load("stewart-gough")
    curve = load_curve(elastic, DeadForce([1.0, -2.0, 3.0]), resolution=0.2)
    assert curve.critical[0].kind == "limit"
    assert curve.reason == "factor-left"
    assert curve.factors[-1] < -1.0


def test_curves_as_text():
    curve = load_curve(column(2), DeadForce([-1.0, 0.0, 0.0]), to=0.5)
    data = json.loads(json.dumps(curve.to_dict(), allow_nan=False))
    assert len(data["factor"]) == len(data["displacement"]) == len(curve.factors)
    assert data["critical"][0]["kind"] == "bifurcation"
    lines = curve.to_csv().splitlines()
    assert lines[0].startswith("factor,joint1 [rad],joint2 [rad],rx [rad]")
    assert np.allclose(np.loadtxt(lines[1:], delimiter=",")[:, 0], curve.factors, rtol=0, atol=0)


@pytest.mark.parametrize(
    ("call", "error", "match"),
    [
        (lambda: load_curve(column(1)), InputError, "needs a load"),
        (lambda: load_curve(column(1), None, [1, 0, 0]), InputError, "a load is not a potential"),
        (lambda: load_curve(column(1), DeadForce([1, 0, 0]), to=0.0), InputError, "load factor"),
        (
            lambda: load_curve(column(1), DeadForce([1, 0, 0]), resolution=-1.0),
            InputError,
            "resolution cannot be used",
        ),
        (
            lambda: load_curve(column(1), DeadForce([1.0, 0, 0])).branch(0),
            InputError,
            "no such critical point",
        ),
        (
            lambda: load_curve(truss(), DeadForce([0, 0, -1.0]), to=2.0).branch(0),
            UndefinedError,
            "no branch starts at a limit point",
        ),
    ],
)
def test_bad_curves_are_refused(call, error, match):
    refused(match, call, kind=error)


# -- compensation --------------------------------------------------------------------------------


def paths():
    q = np.array([0.3, -1.1, 1.4, -0.7, 0.9, 0.2])
    return q + 0.1 * np.linspace(0.0, 1.0, 6)[:, None] * np.array([1, -1, 0.5, 2, 1, -1])


def wrenches(m):
    t = np.linspace(0.0, 3.0, m)[:, None]
    return np.concatenate([5 * np.sin(t), 0 * t, t, 80 * np.cos(t), 60 * np.sin(t), -90 + 0 * t], 1)


@pytest.mark.parametrize("axes", ["world", "body"])
@pytest.mark.parametrize("gravity", [None, np.array([0.0, 0.0, -9.81])])
def test_compensation_puts_the_loaded_tool_on_the_path(axes, gravity):
    robot_file("ur_description/urdf/ur5_robot.urdf")
    elastic = replace(cartstiff.load("ur5"), gravity=gravity)
    path = compensate(elastic, paths(), wrenches(6), load_axes=axes)
    assert np.abs(path.after).max() < 1e-11
    assert np.linalg.norm(path.before[:, 3:], axis=1).min() > 1e-4
    report = path.summary()
    assert report["before"]["translation_max"] > 1e6 * report["after"]["translation_max"]
    assert np.abs(path.offsets).max() < 0.1
    # The poses alone give the same commands.
    by_pose = compensate(elastic, path.poses, wrenches(6), load_axes=axes, q=paths()[0])
    assert absolute_error(by_pose.commands, path.commands) < 1e-10


@pytest.mark.parametrize("name", ["stewart-gough", "five-bar"])
def test_compensation_of_parallel_mechanisms(name):
    elastic = cartstiff.load(name)
    load = np.array([0.0, 0.0, 0.0, 0.1, -0.2, 0.0])
    path = compensate(elastic, elastic.q[None], load)
    length = elastic.mechanism.at(elastic.q).length
    assert path.stable == (True,)
    assert np.abs(path.after[:, 3:]).max() < 1e-10 * length
    assert np.abs(path.before[:, 3:]).max() > 1e-5 * length


@pytest.mark.parametrize("name", ["stewart-gough", "five-bar"])
def test_the_mirror_state_of_every_kind_of_mechanism_can_be_sought(name):
    """As past a bifurcation: from coordinates opposite to the state, none of them held."""
    elastic = cartstiff.load(name)
    state = equilibrium(elastic, DeadForce([0.01, 0.0, 0.0]))
    assert state._mirrored(elastic.q) is None, "the only state has no mirror image"


def test_a_command_under_which_the_posture_is_unstable_is_named():
    elastic = cartstiff.load("stewart-gough")
    path = compensate(elastic, elastic.q[None], [0.0, 0.0, 0.0, 1.0, -2.0, 0.0])
    assert path.stable == (False,)
    assert "unstable-command" in [n.code for n in path.notes]
    assert np.abs(path.after).max() > 1.0


def test_compensated_paths_as_text():
    robot_file("ur_description/urdf/ur5_robot.urdf")
    path = compensate(cartstiff.load("ur5"), paths(), [DeadForce([50.0, 0, 0])] * 6)
    data = json.loads(json.dumps(path.to_dict(), allow_nan=False))
    assert len(data["commands"]) == 6
    assert data["summary"]["after"]["points"] == 6
    assert path.to_csv().splitlines()[0].startswith("command_shoulder_pan_joint")
    assert len(path.to_csv().splitlines()) == 7


def unsprung():
    elastic = column(2)
    return ElasticMechanism(
        "loose", elastic.mechanism, np.array([0.3, 0.4]), JointSprings([1.0, 0.0], [0.0, 0.0])
    )


@pytest.mark.parametrize(
    ("call", "error", "match"),
    [
        (
            lambda: compensate(truss(), [[0.2]], np.zeros(6)),
            InputError,
            "no springs whose rest positions",
        ),
        (
            lambda: compensate(unsprung(), [[0.3, 0.4]], [0, 0, 0, 1.0, 1.0, 0]),
            UndefinedError,
            "no command balances the load at point 1",
        ),
        (
            lambda: compensate(column(2), [[0.3, 0.4, 0.5]], np.zeros(6)),
            InputError,
            "path has the wrong shape",
        ),
        (
            lambda: compensate(column(2), np.ones((1, 4, 4)), np.zeros(6)),
            InputError,
            "pose 1 is not a rigid motion",
        ),
        (
            lambda: compensate(column(2), se3.pose(None, [9.0, 0, 0])[None], np.zeros(6)),
            ConvergenceError,
            "pose 1 of the path cannot be reached",
        ),
        (
            lambda: compensate(column(2), [[0.3, 0.4]], np.zeros(5)),
            InputError,
            "wrenches has the wrong shape",
        ),
        (
            lambda: compensate(column(2), [[0.3, 0.4]], [DeadForce([1, 0, 0])] * 2),
            InputError,
            "loads and path differ in number",
        ),
        (
            lambda: compensate(column(2), [[0.3, 0.4]] * 2, [DeadForce([1, 0, 0]), 3.0]),
            InputError,
            "array of wrenches is not numeric",
        ),
        (
            lambda: compensate(column(2), [[0.3, 0.4]], np.zeros(6), load_axes="tool"),
            InputError,
            "unknown axes",
        ),
    ],
)
def test_bad_paths_are_refused(call, error, match):
    refused(match, call, kind=error)


# -- figures -------------------------------------------------------------------------------------


def test_figures():
    pytest.importorskip("matplotlib")
    curve = load_curve(truss(), DeadForce([0.0, 0.0, -1.0]), to=2.0)
    assert len(figure_content(curve.plot(), ".png")) > 1000
    path = compensate(column(2), [[0.3, 0.4], [0.2, 0.5]], [0, 0, 0, 0.1, 0.2, 0])
    assert b"<svg" in figure_content(path.plot(), ".svg")
    refused("unknown file ending", figure_content, curve.plot(), ".txt")


def test_figures_without_matplotlib(monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    curve = load_curve(column(1), DeadForce([-1.0, 0.0, 0.0]), to=0.5)
    caught = refused(r"cartstiff\[plots\]", curve.plot, kind=MissingDependencyError)
    assert isinstance(caught, CartstiffError)


CRITICAL = (3.0 - np.sqrt(5.0)) / 2.0  # two equal links and springs, P l / k


def _on_the_way(state):
    return {n.code: n.values["factor"] for n in state.notes if "factor" in n.values}


def test_an_equilibrium_says_what_its_load_passes_on_the_way():
    """A limit point of the truss in closed form, a pitchfork at the known load, or nothing."""
    at_limit = truss_load(np.sqrt((REST * HALF**2) ** (2 / 3) - HALF**2))
    snapped = equilibrium(truss(), DeadForce([0.0, 0.0, -2.4]))
    assert _on_the_way(snapped) == {"limit-point": pytest.approx(at_limit / 2.4, rel=1e-9)}
    for share in (0.1, 0.9, 0.99):
        held = equilibrium(truss(), DeadForce([0.0, 0.0, -share * at_limit]))
        assert held.stable
        assert _on_the_way(held) == {}
    for times in (1.05, 1.5):
        buckled = equilibrium(column(2), DeadForce([-times * CRITICAL, 0.0, 0.0]))
        assert buckled.stable
        assert np.abs(buckled.q).max() > 0.1
        assert _on_the_way(buckled) == {"bifurcation": pytest.approx(1 / times, rel=1e-6)}
        (note,) = [n for n in buckled.notes if n.code == "bifurcation"]
        assert note.values["mirror"] == pytest.approx(-buckled.q, abs=1e-9)
    straight = equilibrium(column(2), DeadForce([-0.9 * CRITICAL, 0.0, 0.0]))
    assert straight.stable
    assert _on_the_way(straight) == {}
    mirrored = equilibrium(column(2), -buckled.q, DeadForce([-1.5 * CRITICAL, 0.0, 0.0]))
    assert mirrored.stable
    assert mirrored.q == pytest.approx(-buckled.q, abs=1e-9)


def test_a_start_that_springs_do_not_hold_says_so():
    """An upright pendulum falls where its weight is more than its spring: x / sin x = m g l / k."""
    for weight, falls in ((0.9, False), (1.5, True)):
        upright = replace(links(np.ones(1), masses=[1.0]), gravity=np.array([-weight, 0.0, 0.0]))
        state = equilibrium(upright)
        assert state.stable
        if falls:
            x = abs(state.q[0])
            assert x / np.sin(x) == pytest.approx(weight, rel=1e-9)
        assert ("unstable-start" in [n.code for n in state.notes]) is falls
        pushed = equilibrium(upright, DeadForce([0.0, 0.01, 0.0]))
        assert ("unstable-start" in [n.code for n in pushed.notes]) is falls


def test_a_buckled_state_without_a_mirror_image_is_not_given_one():
    """A column with a spring that is stiffer on one side: its two states differ."""
    even = column(2)
    law = PolynomialLaw((1.0, 0.1, 0.05))
    uneven = replace(even, springs=replace(even.springs, laws={0: law}))
    for machine, is_even in ((even, True), (uneven, False)):
        state = equilibrium(machine, DeadForce([-1.2 * CRITICAL, 0.0, 0.0]))
        (note,) = [n for n in state.notes if n.code == "bifurcation"]
        assert ("a mirror state exists" in note.message) is is_even
        assert ("mirror" in note.values) is is_even


@pytest.mark.parametrize("imperfection", [1e-2, 1e-6])
def test_a_coarse_curve_stays_on_its_branch_beside_a_pitchfork(imperfection):
    """One link that leans from the start never snaps through: P = (x - x_0) / sin x, x_0 < x < pi.

    The limit point beyond the critical load is that of the other branch, which the load never sees.
    """
    leaning = column(1, imperfection)
    curve = load_curve(leaning, DeadForce([-1.0, 0.0, 0.0]), to=100.0)
    x = curve.q[:, 0]
    assert curve.critical == ()
    assert all(curve.stable)
    assert curve.factors == pytest.approx((x - imperfection) / np.sin(x), rel=1e-6)
    assert (np.diff(x) > 0.0).all()
    state = equilibrium(leaning, DeadForce([-100.0, 0.0, 0.0]))
    assert state.q == pytest.approx(x[-1:], abs=1e-9)
    assert _on_the_way(state) == {}


def test_only_the_first_critical_load_is_passed():
    """Between its limit points a truss is on no way that a growing load takes."""
    curve = load_curve(truss(), DeadForce([0.0, 0.0, -1.0]), to=2.4)
    state = equilibrium(truss(), DeadForce([0.0, 0.0, -2.4]))
    named = [n.values["factor"] * 2.4 for n in state.notes if "factor" in n.values]
    assert len(curve.critical) == 2
    assert named == pytest.approx([curve.critical[0].factor], rel=1e-9)


@pytest.mark.parametrize("n", [1, 2, 3])
def test_a_negative_determinant_diverges_whatever_the_masses(n):
    """A column past its first critical load, and a force without potential; drawn masses."""
    first = {1: 1.0, 2: CRITICAL, 3: 0.198062}[n]
    turned = FollowerWrench([0.0, 0.0, 1e-3, 1e-9, 0.0, 0.0])
    load = DeadForce([-1.2 * first, 0.0, 0.0])
    state = equilibrium(column(n), load, turned)
    K = state.elastic.with_potential(load, turned).evaluate(state.posture).hessian
    assert np.linalg.det(K) < 0.0
    rng = np.random.default_rng(n)
    for _ in range(50):
        A = rng.normal(size=(n, n))
        assert np.linalg.eigvals(np.linalg.solve(A @ A.T, K)).real.min() < 0.0
    assert state.stable is False
    notes = {note.code: note for note in state.notes}
    assert "masses-missing" not in notes
    mode = np.array(notes["divergence"].values["mode"])
    assert mode @ K @ mode < 0.0
    held = equilibrium(column(n), DeadForce([-0.8 * first, 0.0, 0.0]), turned)
    assert held.stable is None
    assert "masses-missing" in {note.code for note in held.notes}


def _unstable_share(K, ratio, rng, count=200):
    """Share of random masses, their eigenvalues spread up to a ratio, that leave K unstable."""
    n, unstable = len(K), 0
    for _ in range(count):
        Q = np.linalg.qr(rng.normal(size=(n, n)))[0]
        own = ratio ** rng.uniform(0.0, 1.0, n)
        squares = np.linalg.eigvals(np.linalg.solve(Q @ np.diag(own) @ Q.T, K))
        size = np.abs(squares)
        unstable += bool((np.abs(squares.imag) > 1e-12 * size).any() or squares.real.min() < 0.0)
    return unstable / count


@pytest.mark.parametrize(("n", "push", "moment"), [(2, 1.0, 1e-9), (2, 4.0, 0.1), (3, 0.5, 1e-3)])
def test_a_saddle_under_a_moment_is_unstable_up_to_a_ratio_of_inertias(n, push, moment):
    """A column past two critical loads: the determinant is positive, two motions are unstable."""
    turn = np.array([moment, moment, 0.0, -push, 0.0, 0.0])
    elastic = spatial_column(n)
    state = equilibrium(elastic, DeadWrench(turn), settle=False)
    K = state.elastic.with_potential(DeadWrench(turn)).evaluate(state.posture).hessian
    S, A = 0.5 * (K + K.T), 0.5 * (K - K.T)
    assert (np.linalg.eigvalsh(S) < 0.0).any()
    assert np.linalg.det(K) > 0.0
    note = next(n for n in state.notes if "inertia_ratio" in n.values)
    bound = 1e9
    if np.linalg.eigvalsh(S)[-1] < 0.0:  # unstable with any masses
        assert note.values["inertia_ratio"] is None
    else:
        bound = -np.linalg.eigvalsh(S)[0] / np.linalg.norm(A)
        assert note.values["inertia_ratio"] == pytest.approx(bound, rel=1e-5)
    assert _unstable_share(K, bound, np.random.default_rng(n)) == 1.0
    assert state.stable is (False if bound >= 1e6 else None)


def spatial_column(n):
    """Links with two joints each, so that a moment makes the tangent unsymmetric."""
    return links(np.ones(2 * n), axes="ZY")


@pytest.mark.parametrize("load", [DeadWrench, FollowerWrench])
def test_a_small_moment_leaves_no_saddle_behind(load):
    """Under a pure dead force the column buckles; with a small moment it does as well."""
    turn = np.array([1e-3, 1e-3, 0.0, 0.0, 0.0, 0.0])
    push = DeadForce([-0.7, 0.0, 0.0])
    elastic = spatial_column(2)
    aside = DeadForce([0.0, 1e-2, 2e-2])
    plain = equilibrium(elastic, push, aside)
    state = equilibrium(elastic, push, aside, load(turn))
    acting = (push, aside, load(turn))
    at = state.elastic.with_potential(*acting).evaluate(state.posture)
    assert np.abs(at.gradient).max() < 1e-9
    assert np.linalg.eigvalsh(0.5 * (at.hessian + at.hessian.T))[0] > 0.0
    assert np.linalg.norm(state.q) > 1.0
    assert np.linalg.norm(plain.q) > 1.0
    assert _on_the_way(plain) == {}  # the force aside has opened the bifurcation


def test_a_curve_under_a_moment_is_unstable_between_its_limit_points():
    """One link that has buckled, turned back by a moment: its torque is k x - P sin x."""
    push, turn = DeadForce([-1.5, 0.0, 0.0]), DeadWrench([0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
    curve = load_curve(column(1), turn, fixed=[push], to=-1.0, resolution=0.02)
    slope = 1.0 - 1.5 * np.cos(curve.q[:, 0])
    assert (slope < 0.0).sum() > 10
    assert [s is False for s in curve.stable] == (slope < 0.0).tolist()


@pytest.mark.parametrize("seed", range(12))
def test_six_lines_carry_a_symmetric_body_down_their_axis(seed):
    """Half of such bodies were refused: the forces across the axis cancel. One equation holds.

    Six alike lines of length L at a distance d across: 6 k (L - L0) h / L is weight and load.
    """
    rng = np.random.default_rng(seed)
    R = 10 ** rng.uniform(1, 3)
    r, h, k = R * rng.uniform(0.01, 0.1), R * rng.uniform(0.3, 1.5), 10 ** rng.uniform(1, 6)
    turns = np.arange(6) * np.pi / 3
    anchors = np.column_stack([R * np.cos(turns), R * np.sin(turns), np.full(6, h)])
    pairs = np.pi / 6 + np.repeat([0, 2, 4], 2) * np.pi / 3
    points = np.column_stack([r * np.cos(pairs), r * np.sin(pairs), np.zeros(6)])
    body = Platform(anchors, points, mass=1e-3 * k * h / 9.81, mass_centre=[0, 0, -0.2 * r])
    lines = LineSprings(
        anchors=anchors, points=points, stiffness=np.full(6, k), rest_length=np.full(6, np.nan)
    )
    elastic = ElasticMechanism("body", body, np.zeros(6), lines).with_gravity()
    d = np.linalg.norm((anchors - points)[0, :2])
    weight = body.mass * 9.81
    L = np.hypot(d, h)
    rest = L - weight * L / (6 * k * h)
    for share in (1e-4, -1e-3, 0.02, -0.1):
        load = share * weight
        state = equilibrium(elastic, wrench=[0, 0, 0, 0, 0, load])

        def left(z, load=load):
            L = np.hypot(d, h - z)
            return 6 * k * (L - rest) * (h - z) / L - weight + load

        z = brentq(left, -0.1 * h, 0.1 * h, xtol=1e-15 * h)
        assert state.stable
        assert state.pose[:2, 3] == pytest.approx([0.0, 0.0], abs=1e-12 * R)
        assert state.pose[2, 3] == pytest.approx(z, rel=1e-7, abs=1e-14 * h)
