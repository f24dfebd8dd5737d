"""Compliance of platforms near type-2 singularities, springs over fifteen decades, in 80 digits."""

import pickle
from dataclasses import replace

import mpmath as mp
import numpy as np
import pytest
from tests.support import hexagons, platform_mechanism, relative_error, spread_springs
from tests.support.digits import skew
from tests.support.read import asked, of_many

import cartstiff
from cartstiff import DeadForce, analyse_posture, equilibrium

CORNERS = np.repeat(2 * np.pi / 3 * np.arange(3), 2)


def exact(elastic, tensions, stiffness=None):
    """K^B of the legs with given tensions."""
    stiffness = elastic.springs.stiffness if stiffness is None else stiffness
    roll, pitch, yaw = (mp.mpf(float(x)) for x in elastic.q[3:])
    c, s = mp.cos, mp.sin
    R = (
        mp.matrix([[c(yaw), -s(yaw), 0], [s(yaw), c(yaw), 0], [0, 0, 1]])
        * mp.matrix([[c(pitch), 0, s(pitch)], [0, 1, 0], [-s(pitch), 0, c(pitch)]])
        * mp.matrix([[1, 0, 0], [0, c(roll), -s(roll)], [0, s(roll), c(roll)]])
    )
    p, K, m = mp.matrix(elastic.q[:3].tolist()), mp.zeros(6, 6), elastic.mechanism
    legs = zip(m.anchors, m.points, stiffness, tensions, strict=True)
    for anchor, point, k, t in legs:
        b = mp.matrix(point.tolist())
        along = b - R.T * (mp.matrix(anchor.tolist()) - p)
        length = mp.norm(along)
        u = along / length
        D, g, turning = mp.zeros(3, 6), mp.zeros(6, 1), mp.zeros(6, 6)
        D[:, :3], D[:, 3:] = -skew(b), mp.eye(3)
        g[:3, 0], g[3:, 0] = skew(b) * u, u
        bu = b * u.T
        turning[:3, :3] = (bu + bu.T) / 2 - (b.T * u)[0] * mp.eye(3)
        turning[:3, 3:], turning[3:, :3] = -skew(u) / 2, skew(u) / 2
        across = D.T * (mp.eye(3) - u * u.T) * D / length
        K += mp.mpf(float(k)) * g * g.T + mp.mpf(float(t)) * (across + turning)
    return K


def promised(result):
    notes = [n.values for n in result.notes if n.code == "ill-conditioned"]
    return max((v["relative_error"] for v in notes if v["matrix"] == "compliance"), default=0.0)


@pytest.mark.parametrize("distance", [1e-1, 1e-3, 1e-5, 1e-7, 1e-9])
@pytest.mark.parametrize(("decades", "loaded"), [(2, False), (9, False), (9, True)])
def test_compliance_near_a_type_2_singularity(distance, decades, loaded):
    rng = np.random.default_rng([decades, round(-np.log10(distance))])
    elastic = hexagons(distance, spread_springs(rng, 6, decades))
    # What the softest leg bears, so near to where the legs hold nothing.
    W = 1e-4 * distance**2 * rng.normal(size=6) if loaded else None
    result = cartstiff.analyse(elastic, wrench=W)
    tensions = result.elastic.springs.tensions(result.posture.lines.lengths)
    with mp.workdps(80):
        K = exact(elastic, tensions)
        C = np.array(mp.inverse(K).tolist(), float)
        softest = min(1 / float(x) for x in mp.eigsy(mp.inverse(K)[3:, 3:], eigvals_only=True))
        held = min(float(x) for x in mp.eigsy(K[3:, 3:], eigvals_only=True))
    found = result.compliances["B"]
    known = max(1e-9, promised(result))
    assert relative_error(found, C) <= known
    assert promised(result) <= 1e-14 / distance or loaded
    if not loaded:
        flat = result.compliances["F"]
        assert relative_error(flat, C) <= max(1e-9, 1e-14 / distance)
    answer = analyse_posture(result, connection="B")["ellipsoids"]["stiffness"]["translation"]
    if answer["free"] is None:  # nine decades of springs beside nine of the posture
        assert decades == 9
        assert distance == 1e-9
        return
    assert answer["free"]["eigenvalues"][0] == pytest.approx(softest, rel=known)
    assert answer["held"]["eigenvalues"][0] == pytest.approx(held, rel=max(1e-8, 100 * known))
    names = ("translation_free_min", "translation_held_min")
    values, _ = of_many(elastic, elastic.q[None], names, asked("B", 0.3), W)
    assert values["translation_free_min"][0] == pytest.approx(softest, rel=known)
    assert values["translation_held_min"][0] == pytest.approx(held, rel=max(1e-8, 100 * known))
    again = pickle.loads(pickle.dumps(result))
    assert np.array_equal(again.compliances["B"], found)


def test_tensions_behind_stiff_legs_are_those_that_were_chosen():
    """1e12 N/m times the rounding of a length is 1e-4 N: a wrench of 1e-6 N is met all the same."""
    elastic = hexagons(0.5, spread_springs(np.random.default_rng(1), 6, 15))
    W = 1e-6 * np.array([0.1, -0.2, 0.3, 1.0, 2.0, -1.5])
    result = cartstiff.analyse(elastic, wrench=W)
    springs, posture = result.elastic.springs, result.posture
    tensions = springs.tensions(posture.lines.lengths)
    assert posture.lines.lines.T @ tensions == pytest.approx(W, rel=1e-11, abs=1e-17)
    assert result.evaluation.gradient == pytest.approx(W, rel=1e-11, abs=1e-17)
    # Given rest lengths are what counts again.
    given = result.elastic.with_springs(
        rest=dict(zip(elastic.spring_names, springs.rest, strict=True))
    )
    expected = springs.stiffness * (posture.lines.lengths - springs.rest)
    assert np.array_equal(given.springs.tensions(posture.lines.lengths), expected)


def test_weight_beside_stiff_legs():
    """What is neither a leg nor a tension stands beside the legs' stiffness, not in it."""
    elastic = hexagons(1e-4, spread_springs(np.random.default_rng(2), 6, 15))
    loads = (DeadForce([0.0, 0.0, -1e-9], [0.0, 0.0, 0.05]),)
    result = cartstiff.analyse(elastic.with_potential(*loads))
    tensions = result.elastic.springs.tensions(result.posture.lines.lengths)
    with mp.workdps(80):
        K = exact(elastic, tensions) + mp.matrix(loads[0].evaluate(result.posture).hessian.tolist())
        C = np.array(mp.inverse(K).tolist(), float)
    # The legs bear the weight and no wrench is left: all connections agree.
    for found in (result.compliances["B"], result.compliances["F"]):
        assert relative_error(found, C) <= max(1e-9, promised(result))


def test_stiffness_where_stiff_legs_come_to_rest():
    """Their tensions are those that balance the load, not what their rounded lengths say."""
    for seed in range(3):
        elastic = hexagons(0.5, spread_springs(np.random.default_rng(seed), 6, 9))
        load = DeadForce([1e-6, 5e-7, -2e-6], [0.01, 0.0, 0.05])
        state = equilibrium(elastic, load, limits=False, settle=False)
        pushed = load.evaluate(state.posture)
        tensions = np.linalg.solve(state.posture.lines.lines.T, -pushed.gradient)
        with mp.workdps(80):
            moved = replace(state.elastic, q=state.q)
            K = exact(moved, tensions) + mp.matrix(pushed.hessian.tolist())
            C = np.array(mp.inverse(K).tolist(), float)
        found = state.stiffness.compliances["B"]
        assert relative_error(found, C) <= 1e-10
        assert state.elastic_stiffness.wrench == pytest.approx(
            -pushed.gradient, rel=1e-9, abs=1e-18
        )


@pytest.mark.parametrize("radius", [1e-6, 1e-9])
@pytest.mark.parametrize("seed", range(4))
def test_tensions_that_balance_a_load_are_known_as_far_as_the_lines_are(seed, radius):
    """All legs nearly meet in a point beside M: tensions are 1e7 times the load, and more."""
    rng = np.random.default_rng(seed)
    base, top = (
        np.array([[r * np.cos(a), r * np.sin(a), z] for a in CORNERS + np.tile([-h, h], 3)])
        for r, h, z in ((0.115, 0.2, 0.0), (radius, 0.8, -0.01))
    )
    q = [0, 0, 0.1, 0, 0, 0] + 0.1 * rng.uniform(-1, 1, 6) * [0.3, 0.3, 0.3, 1, 1, 1]
    elastic = platform_mechanism(base, top, np.full(6, 2e7), np.full(6, np.nan), q=q)
    W = rng.uniform(-5, 5, 6)
    result = cartstiff.analyse(elastic, wrench=W)
    with mp.workdps(50):
        lines = mp.zeros(6, 6)
        for i in range(6):  # a leg's stiffness g g^T gives its line g, which points up
            K = exact(elastic, np.zeros(6), np.eye(6)[i])
            lines[:, i] = K[:, 5] / mp.sqrt(K[5, 5])
        K = exact(elastic, mp.lu_solve(lines, mp.matrix(W.tolist())))
        C = np.array(mp.inverse(K).tolist(), float)
    K = np.array(K.tolist(), float)
    assert relative_error(result.matrices["B"], K) <= 5e-18 / radius
    assert relative_error(result.compliances["B"], C) <= max(1e-10, promised(result))
