"""Stability of milling: closed forms, and two theories against each other."""

import numpy as np
import pinocchio as pin
import pytest
from tests.support.commands import refuses

from cartstiff import ElasticMechanism, InputError, JointSprings, load, modes
from cartstiff.mechanisms.chain import Chain
from cartstiff.mechanisms.tree_building import plain_tree
from cartstiff.vibration.chatter import (
    MeasuredReceptance,
    Milling,
    limiting_depth,
    limiting_depths,
    lobes,
)

MASS, ZETA, KT = 0.5, 0.03, 6e8
SLOT = Milling(KT, 0.3, 4, 0.0, np.pi)


def spindle(hertz):
    """A mass on two springs across each other."""
    model, parent = pin.Model(), 0
    for joint, name in ((pin.JointModelPX(), "x"), (pin.JointModelPY(), "y")):
        parent = model.addJoint(parent, joint, pin.SE3.Identity(), name)
    body = pin.Inertia(MASS, np.zeros(3), 1e-4 * np.eye(3))
    model.appendBodyToJoint(parent, body, pin.SE3.Identity())
    model.addFrame(pin.Frame("tip", parent, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
    k = MASS * (2 * np.pi * np.asarray(hertz)) ** 2
    chain = Chain(plain_tree(model), "tip")
    return ElasticMechanism("spindle", chain, np.zeros(2), JointSprings(k, np.zeros(2)))


def test_least_depth_of_one_freedom():
    """``a = 8 pi k zeta (1 + zeta) / (N K_t |alpha_xx|)``: its least real part."""
    found = modes(spindle([500.0, 5e6]))
    k = MASS * (2 * np.pi * 500.0) ** 2
    alpha = abs(SLOT.mean[0, 0])
    wanted = 2 * np.pi * 4 * k * ZETA * (1 + ZETA) / (SLOT.teeth * KT * alpha)
    assert SLOT.mean[0, 0] == pytest.approx(-0.3 * np.pi)
    assert limiting_depth(found, SLOT, ZETA) == pytest.approx(wanted, rel=1e-4)
    # Without a radial force across the mean slot, nothing regenerates in the feed alone.
    assert limiting_depth(found, Milling(KT, 0.0, 4, 0.0, np.pi), ZETA) > 1e3 * wanted


def test_mean_of_the_directional_coefficients():
    milling = Milling(KT, 0.3, 3, 0.3, 1.9)
    mean, angles = np.zeros((2, 2)), np.linspace(0.3, 1.9, 20001)
    for s, c in zip(np.sin(angles), np.cos(angles), strict=True):
        # Along feed and normal: -(tangential along (c, -s)) - (radial along (s, c)), chip (s, c).
        mean += -np.outer([c + 0.3 * s, -s + 0.3 * c], [s, c])
    mean *= (1.9 - 0.3) / angles.size * 3 / (2 * np.pi)
    assert 2 * mean == pytest.approx(3 / (2 * np.pi) * milling.mean, abs=2e-4)


def growth_in_time(hertz, cut, speed, depth, zeta, steps=100, periods=30):
    """Factor per tooth's period by which the tool's motion grows; Runge-Kutta, tooth by tooth."""
    w, pitch = 2 * np.pi * np.asarray(hertz), 2 * np.pi / cut.teeth
    h = 60.0 / (speed * cut.teeth * steps)

    def rate(state, turn, before):
        force, chip = np.zeros(2), state[:2] - before
        for phi in (turn + pitch * np.arange(cut.teeth)) % (2 * np.pi):
            if cut.entry <= phi < cut.exit:
                s, c = np.sin(phi), np.cos(phi)
                tangential = cut.tangential * depth * (chip[0] * s + chip[1] * c)
                radial = cut.radial * tangential
                force -= [tangential * c + radial * s, radial * c - tangential * s]
        return np.r_[state[2:], force / MASS - 2 * zeta * w * state[2:] - w * w * state[:2]]

    before, state, sizes = np.zeros((steps + 1, 2)), np.array([1.0, 1.0, 0.0, 0.0]), []
    for _ in range(periods):
        path = [state[:2]]
        for i in range(steps):
            a, b = before[i], before[i + 1]
            start, middle, end = (pitch * (i + x) / steps for x in (0.0, 0.5, 1.0))
            k1 = rate(state, start, a)
            k2 = rate(state + h / 2 * k1, middle, 0.5 * (a + b))
            k3 = rate(state + h / 2 * k2, middle, 0.5 * (a + b))
            state = state + h / 6 * (k1 + 2 * (k2 + k3) + rate(state + h * k3, end, b))
            path.append(state[:2])
        size = np.linalg.norm(path)
        before, state, sizes = np.array(path) / size, state / size, [*sizes, size]
    return np.exp(np.mean(np.log(sizes[periods // 2 :])))


@pytest.mark.parametrize("speed", [4000.0, 5300.0, 8800.0])
def test_lobes_against_a_simulation_in_time(speed):
    """Four teeth in a slot: two cut at right angles to each other, so nothing pulsates."""
    hertz = (500.0, 640.0)
    depth = lobes(modes(spindle(hertz)), SLOT, [speed], ZETA).depths[0]
    assert growth_in_time(hertz, SLOT, speed, 0.97 * depth, ZETA) < 1.0
    assert growth_in_time(hertz, SLOT, speed, 1.03 * depth, ZETA) > 1.0


def test_measured_receptance():
    """Two oscillators written by hand, in place of a mechanism."""
    found, f = modes(spindle([500.0, 640.0])), np.geomspace(250.0, 1200.0, 6000)
    w, own = 2 * np.pi * f[:, None], 2 * np.pi * np.array([500.0, 640.0])
    G = np.zeros((f.size, 2, 2), complex)
    G[:, [0, 1], [0, 1]] = 1 / (MASS * (own**2 - w**2 + 2j * ZETA * own * w))
    measured = MeasuredReceptance(f, G)
    speeds = [4000.0, 5300.0, 8800.0]
    got = lobes(measured, SLOT, speeds)
    assert got.depths == pytest.approx(lobes(found, SLOT, speeds, ZETA).depths, rel=1e-3)
    assert limiting_depth(measured, SLOT) == pytest.approx(got.least)
    refuses("has its own frequencies", lobes, measured, SLOT, speeds, ZETA)
    refuses("ascending", MeasuredReceptance, f[::-1], G)
    refuses("measured receptance", MeasuredReceptance, f, G[:3])


def test_equal_eigenvalues_keep_their_places():
    """A response that is the same along feed and normal, with and without round-off.

    The depth of a speed is the least a > 0 at which 1 = a KT N/(4 pi) (1 - exp(-i w tau)) mu, for
    both eigenvalues mu = (own of the coefficients) G of the product.
    """
    f, half = np.arange(300.0, 1200.0, 0.05), Milling(KT, 0.3, 3, 0.0, np.pi / 2)
    g = sum(1 / (k * (1 - (f / n) ** 2 + 0.05j * f / n)) for n, k in ((500, 2e7), (900, 4e7)))
    speeds, least = np.array([8e3, 9e3, 1e4, 1.1e4, 1.2e4]), []
    for speed in speeds:
        delayed = 1 - np.exp(-2j * np.pi * f * 60 / (3 * speed))
        a = 4 * np.pi / (3 * KT * np.linalg.eigvals(half.mean)[:, None] * g * delayed)
        is_root = np.diff(np.sign(a.imag)).astype(bool) & (a.real[:, 1:] > 0)
        is_root &= np.abs(np.diff(a)) < 0.1 * np.abs(a[:, 1:])
        least.append(a.real[:, 1:][is_root].min())
    rng = np.random.default_rng(1)
    for size in (0.0, 1e-15, 1e-13):
        G = np.eye(2) * (g * (1 + size * rng.normal(size=f.size)))[:, None, None]
        depths = lobes(MeasuredReceptance(f, G), half, speeds).depths
        assert depths == pytest.approx(np.array(least), rel=5e-3)


def test_depth_along_a_path():
    elastic = load("stewart-simscape")
    milling = Milling(KT, 0.3, 3, 0.0, np.pi / 2, at=(0.0, 0.0, 0.05))
    poses = [elastic.q, elastic.q + 0.01 * np.eye(6)[0]]
    depths = limiting_depths(elastic, poses, milling, 0.02)
    assert depths[0] == pytest.approx(limiting_depth(modes(elastic), milling, 0.02))
    assert np.isfinite(depths).all()
    assert depths[0] != depths[1]


def test_a_slot_may_be_typed_with_four_decimals():
    assert Milling(KT, 0.3, 4, 0.0, 3.1416) == Milling(KT, 0.3, 4, 0.0, np.pi)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"tangential": 0.0}, "cutting coefficient"),
        ({"teeth": 0}, "number of teeth"),
        ({"entry": 2.0, "exit": 1.0}, "immersion"),
        ({"exit": 3.142}, "immersion"),
        ({"normal": (1.0, 0.0, 0.0)}, "right angles"),
    ],
)
def test_what_is_refused(change, words):
    entries = {"tangential": KT, "radial": 0.3, "teeth": 4, "entry": 0.0, "exit": 1.0}
    with pytest.raises(InputError, match=words):
        Milling(**{**entries, **change})
    with pytest.raises(InputError, match="speeds"):
        lobes(modes(spindle([500.0, 600.0])), SLOT, [0.0], ZETA)
