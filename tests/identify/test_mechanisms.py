"""Platforms and closed chains, weights, dial gauges, sessions, large loads: the truth comes back.

The oracle for displacements is `equilibrium` (another solver) or differences of poses.
"""

from dataclasses import replace

import numpy as np
import pytest
from tests.doors import candidates, unknowns_of
from tests.identify.campaigns import (
    SPRINGS,
    arm,
    jacobian,
    load,
    measurements,
    model_of,
    random_campaign,
    table_of,
    write_table,
)
from tests.support.robots import bundled_files

import cartstiff
from cartstiff import DeadForce, equilibrium
from cartstiff.geometry import se3
from cartstiff.identify import identify, read_measurements


def _softer(elastic, factors):
    return elastic.with_springs(dict(zip(elastic.spring_names, factors, strict=True)))


def _postures(elastic, rows, seed):
    rng = np.random.default_rng(seed)
    mechanism = elastic.mechanism
    if mechanism.kind == "stewart-gough":
        return elastic.q + rng.uniform(-0.1, 0.1, (rows, 6)) * mechanism.length
    step = np.zeros((rows, len(elastic.names)))
    driven = list(mechanism.actuated)
    step[:, driven] = rng.uniform(-0.25, 0.25, (rows, len(driven)))
    return np.array([mechanism.closed(elastic.q + s).q for s in step])


@pytest.mark.parametrize(("name", "rows", "axes"), [("cubic", 8, 3), ("five-bar", 6, 2)])
def test_legs_and_motors_of_loops_come_back(name, rows, axes):
    """Displacements by `equilibrium` under loads so small that it is linear."""
    elastic = cartstiff.load(name)
    k = elastic.springs.stiffness
    sprung = k > 0
    truth = k * np.linspace(0.6, 1.8, len(k))
    true = replace(elastic, springs=elastic.springs.replaced(truth, elastic.springs.rest))
    rng = np.random.default_rng(3)
    q = _postures(elastic, rows, 4)
    W = np.zeros((rows, 6))
    W[:, 3 : 3 + axes] = (
        rng.normal(size=(rows, axes))
        * 1e-3
        * k.max()
        * elastic.mechanism.at(q[0]).length ** (-1 if name == "five-bar" else 1)
        * 1e-3
    )
    moved = []
    for one, w in zip(q, W, strict=True):
        springs = true.springs
        if name == "five-bar":
            rest = np.where(sprung, one, 0.0)
            springs = springs.replaced(truth, rest)
        else:
            springs = springs.replaced(truth, elastic.mechanism.at(one).lines.lengths)
        state = equilibrium(replace(true, springs=springs), one, DeadForce(w[3:]), limits=False)
        moved.append(state.pose[:3, 3] - elastic.mechanism.at(one).pose[:3, 3])
    values = dict(zip(("dx", "dy", "dz"), np.array(moved).T, strict=True))
    if axes == 2:
        del values["dz"]
    result = identify(elastic, measurements(q, W, values, sd=1e-3 * np.abs(moved).max()))
    found = [e.stiffness for e in result.estimates]
    assert found == pytest.approx(truth[sprung], rel=2e-4)


def test_the_derivative_is_that_of_the_equilibrium():
    """Closed chain with beams, under load and weight: differences of equilibria."""
    elastic = cartstiff.load("delta")
    q = _postures(elastic, 2, 1)
    W = np.zeros((2, 6))
    W[:, 3:] = [[10.0, -20.0, 15.0], [5.0, 5.0, -30.0]]
    W[1, :3] = [0.3, -0.2, 0.1]
    nothing = {name: np.zeros(2) for name in ("dx", "dy", "dz", "drz")}
    measured = measurements(q, W, nothing, mass=np.array([0.0, 1.0]))
    unknowns = unknowns_of(elastic, ("joints", "links"))
    linear = model_of(unknowns, measured)
    model = model_of(unknowns, measured, loaded=True)
    theta = unknowns.nominal
    y, A = model.at(theta)
    for p in range(len(theta)):
        step = np.zeros(len(theta))
        step[p] = 1e-3 * theta[p]
        rate = (model.at(theta + step)[0] - model.at(theta - step)[0]) / (2 * step[p])
        assert A[:, p] == pytest.approx(rate, rel=1e-5, abs=1e-6 * np.abs(y).max() / theta[p])
    small = measurements(q, 1e-3 * W, nothing)
    straight, B = model_of(unknowns, small).at(theta)
    y, _ = model_of(unknowns, small, loaded=True).at(theta)
    assert y == pytest.approx(straight, rel=1e-3, abs=1e-3 * np.abs(y).max())
    linear = model_of(unknowns, small)
    for p in range(len(theta)):  # theorem of the unit load
        step = np.zeros(len(theta))
        step[p] = 1e-4 * theta[p]
        rate = (linear.at(theta + step)[0] - linear.at(theta - step)[0]) / (2 * step[p])
        assert B[:, p] == pytest.approx(rate, rel=1e-5, abs=1e-7 * np.abs(y).max() / theta[p])


def test_large_loads_need_the_equilibrium(tmp_path):
    """Springs so soft that the linear fit is off by more than its intervals; --loaded is not."""
    soft = tuple(k / 40 for k in SPRINGS["elbow"])
    elastic = load(arm("elbow", tmp_path, springs=tuple(k / 30 for k in SPRINGS["elbow"])))
    true = _softer(elastic, soft)
    rng = np.random.default_rng(1)
    q, mass = rng.uniform(-1.3, 1.3, (12, 6)), rng.uniform(5.0, 15.0, 12)
    moved = []
    for one, m in zip(q, mass, strict=True):
        told = true.with_springs(rest=one)
        weight = DeadForce([0, 0, -9.81 * m])
        state = equilibrium(told, one, weight, limits=False)
        moved.append(state.pose[:3, 3] - elastic.mechanism.at(one).pose[:3, 3])
    moved = np.array(moved) + rng.normal(size=(12, 3)) * 2e-5
    values = dict(zip(("dx", "dy", "dz"), moved.T, strict=True))
    measured = measurements(q, np.zeros((12, 6)), values, mass=mass, sd=2e-5)
    linear = identify(elastic, measured)
    assert "linear-differs" in [n.code for n in linear.notes]
    result = identify(elastic, measured, loaded=True)
    assert result.estimates[0].verdict == "not-identifiable"  # it stands along the weight
    for e, k in list(zip(result.estimates, soft, strict=True))[1:]:
        low, high = e.stiffness_interval
        assert low * 0.99 < k < high * 1.01
    assert result.inflation == 1.0
    far = [e.compliance * k for e, k in zip(linear.estimates, soft, strict=True) if e.compliance]
    assert max(abs(x - 1) for x in far) > 0.01


@pytest.mark.parametrize("lifted", [0.0, 2.0])
def test_own_weight_seen_by_a_tracker_in_two_unknown_frames(tmp_path, lifted):
    """Positions only, no load: the sag of the arm, two frames of the tracker turned at will.

    Gravity compensation carries a part of the weight, at the tip.
    """
    path = arm("elbow", tmp_path, extra="gravity: [0, 0, -9.81]\n")
    elastic = load(path)
    elastic = elastic.with_potential(DeadForce(np.zeros(3), lifted=lifted))
    elastic = elastic.with_gravity(elastic.gravity)
    true = _softer(elastic, SPRINGS["elbow"])
    rng = np.random.default_rng(7)
    q = rng.uniform(-1.4, 1.4, (40, 6))
    session = tuple("am" if i % 2 else "pm" for i in range(40))
    frames = {"am": (0.4, -0.2, 1.0, 0.5, 2.0, -1.0), "pm": (-0.1, 0.3, -2.0, 1.0, 0.2, 0.4)}
    seen = []
    for one, name in zip(q, session, strict=True):
        torque = elastic.mechanism.at(one).gravity(elastic.gravity).gradient
        torque = torque - 9.81 * lifted * jacobian(true, one)[5]
        sag = jacobian(true, one) @ (-torque / np.array(SPRINGS["elbow"]))
        x = elastic.mechanism.at(one).pose[:3, 3] + sag[3:] + rng.normal(size=3) * 5e-6
        T = se3.exp(frames[name])
        seen.append(T[:3, :3] @ x + T[:3, 3])
    measured = measurements(
        q,
        np.zeros((40, 6)),
        dict(zip("xyz", np.array(seen).T, strict=True)),
        sd=5e-6,
        session=session,
    )
    result = identify(elastic, measured)
    verdicts = {e.name: e.verdict for e in result.estimates}
    assert verdicts["j1"] == "not-identifiable"  # its axis is the weight's direction
    assert verdicts["j2"] == verdicts["j3"] == "determined"
    for e, k in zip(result.estimates, SPRINGS["elbow"], strict=True):
        if e.verdict == "determined":
            s = e.deviation
            assert abs(e.compliance - 1 / k) < 4 * s


def test_a_dial_gauge_and_a_spring_scale(tmp_path):
    """One direction a row, wrench columns along body axes, points of load and gauge apart."""
    elastic = load(arm("elbow", tmp_path))
    rng = np.random.default_rng(5)
    q, W, _ = random_campaign(elastic, SPRINGS["elbow"], 40, 5)
    n = rng.normal(size=(40, 3))
    n /= np.linalg.norm(n, axis=1)[:, None]
    gauge, hook = np.array([0.02, 0.01, 0.1]), np.array([0.0, -0.05, 0.04])
    d = []
    for one, w, u in zip(q, W, n, strict=True):
        R, J = elastic.mechanism.at(one).pose[:3, :3], jacobian(elastic, one)
        force = R @ w[3:]  # the table's components are the body's
        at = R @ hook
        torque = J[:3].T @ np.cross(at, force) + J[3:].T @ force
        motion = J @ (torque / np.array(SPRINGS["elbow"]))
        d.append(u @ (motion[3:] + np.cross(motion[:3], R @ gauge)) + rng.normal() * 1e-6)
    columns = (
        {f"j{j + 1}": q[:, j] for j in range(6)}
        | dict(zip(("fx", "fy", "fz"), W[:, 3:].T, strict=True))
        | {"d": np.array(d)}
        | dict(zip(("nx", "ny", "nz"), 3.0 * n.T, strict=True))
    )
    table = write_table(tmp_path / "d.csv", columns)
    measured = read_measurements(
        table, elastic, load_axes="body", point=tuple(gauge), load_at=tuple(hook)
    )
    result = identify(elastic, measured)
    for e, k in zip(result.estimates, SPRINGS["elbow"], strict=True):
        assert e.stiffness == pytest.approx(k, rel=0.02)


def test_the_difference_of_two_payloads_and_tilts(tmp_path):
    elastic = load(arm("elbow", tmp_path))
    rng = np.random.default_rng(2)
    q = rng.uniform(-1.4, 1.4, (25, 6))
    rows = []
    for one in q:
        J = jacobian(elastic, one)
        motion = J @ ((J[5] * -9.81 * (12.0 - 4.0)) / np.array(SPRINGS["elbow"]))
        rows.append(motion + rng.normal(size=6) * 1e-7)
    every = dict(zip(("drx", "dry", "drz", "dx", "dy", "dz"), np.array(rows).T, strict=True))
    columns = {f"j{j + 1}": q[:, j] for j in range(6)}
    columns |= {"mass": np.full(25, 12.0), "mass0": np.full(25, 4.0)}
    columns |= {name: every[name] for name in ("drx", "dry", "dz")}
    result = identify(elastic, read_measurements(write_table(tmp_path / "t.csv", columns), elastic))
    assert "gravity-assumed" in [n.code for n in result.notes]
    assert result.estimates[0].verdict == "not-identifiable"
    for e, k in zip(result.estimates[1:], SPRINGS["elbow"][1:], strict=True):
        assert e.stiffness == pytest.approx(k, rel=0.01)
    assert set(result.noise()) == {"length", "angle"}


def test_gross_errors_are_named_and_do_not_bend_the_robust_fit(tmp_path):
    elastic = load(arm("elbow", tmp_path))
    q, W, d = random_campaign(elastic, SPRINGS["elbow"], 40, 9)
    clean = identify(elastic, read_measurements(table_of(tmp_path / "c.csv", q, W, d), elastic))
    bad = d.copy()
    bad[[6, 30], 3:] += 20 * 2e-5 * np.array([[1, -1, 1], [-1, -1, 1]])
    measured = read_measurements(table_of(tmp_path / "b.csv", q, W, bad), elastic)
    result = identify(elastic, measured)
    assert result.suspects == [7, 31]
    assert len(result.measured) == 40  # nothing is dropped silently
    for e, theta in zip(clean.estimates, result.robust.fit.theta, strict=True):
        assert e.interval[0] <= theta <= e.interval[1]
    dropped = identify(elastic, measured.chosen(~np.isin(np.arange(40), [6, 30])))
    for e, other in zip(result.estimates, dropped.estimates, strict=True):
        assert abs(e.compliance - other.compliance) < 0.5 * other.deviation
        assert e.deviation == pytest.approx(other.deviation, rel=0.15)
    assert clean.suspects == []


def test_leave_one_posture_out_is_what_leaving_out_gives(tmp_path):
    elastic = load(arm("elbow", tmp_path))
    q, W, d = random_campaign(elastic, SPRINGS["elbow"], 9, 12)
    q[1] = q[0]  # two loads in one posture are left out together
    for i in (0, 1):
        J = jacobian(elastic, q[i])
        d[i] = J @ ((J.T @ W[i]) / np.array(SPRINGS["elbow"]))
    measured = read_measurements(table_of(tmp_path / "m.csv", q, W, d, sd=2e-5), elastic)
    result = identify(elastic, measured)
    keep = np.arange(9) > 1
    others = identify(elastic, measured.chosen(keep))
    y, _ = result.model.at(others.chosen.theta)
    mine = result.model.observations.row < 2
    expected = (result.model.observations.target - y)[mine]
    assert result.left_out[mine] == pytest.approx(expected, rel=1e-6, abs=1e-12)


def test_the_springs_of_a_loop_without_named_motors_are_its_motors(tmp_path):
    """The five-bar with and without `actuated`: one posture of a table, and plans that move."""
    path = bundled_files()["five-bar"]
    lines = [x for x in path.read_text("utf-8").splitlines() if not x.startswith("actuated")]
    text = "\n".join(lines).replace("five-bar.urdf", str(path.with_name("five-bar.urdf")))
    (tmp_path / "open.yaml").write_text(text, "utf-8")
    named, unnamed = cartstiff.load("five-bar"), cartstiff.load(str(tmp_path / "open.yaml"))
    motors = [named.names.index(n) for n in ("left_motor", "right_motor")]
    home = named.q[motors]
    columns = {"left_motor": home[0] + np.array([0.0, -0.2]), "fy": np.array([50.0, 50.0])}
    columns |= {"right_motor": home[1] + np.array([0.25, 0.0]), "dy": np.array([1e-3, 1e-3])}
    table = write_table(tmp_path / "t.csv", columns)
    seen, other = (read_measurements(table, elastic).q for elastic in (named, unnamed))
    assert other == pytest.approx(seen, abs=1e-9)
    assert (
        pytest.approx(np.array([columns["left_motor"], columns["right_motor"]]), abs=1e-9)
        == other[:, motors].T
    )
    offered = candidates(unnamed, {"dx": 1e-5}, count=20, force=50.0)
    assert np.ptp(offered.q[:, motors], axis=0).min() > 0.5
    for q in offered.q:
        assert named.mechanism.closed(q).q == pytest.approx(q, abs=1e-6)


def test_forces_of_the_picture_are_newtons(tmp_path):
    """A platform in kN: its rows of 0.1 kN are at 100 N, beside weights in N."""
    file = tmp_path / "platform.yaml"
    layout = "base: {radius: 0.3, half_angle: 0.2}, platform: {radius: 0.2, half_angle: 0.2}"
    file.write_text(
        f"kind: stewart-gough\nunits: {{length: m, force: kN}}\nlayout: {{{layout}, height: 0.4}}\n"
        "legs: {stiffness: 1.0e4}\n"
    )
    elastic = load(file)
    rng = np.random.default_rng(1)
    q = elastic.q + rng.uniform(-0.05, 0.05, (12, 6))
    W = np.zeros((12, 6))
    W[:, 3:] = 0.1 * np.eye(3)[np.arange(12) % 3]
    rows = measurements(
        q, W, dict(zip(("dx", "dy", "dz"), rng.normal(size=(3, 12)) * 1e-6, strict=True))
    )
    first = identify(elastic, rows).plot().axes[0]
    assert first.get_xlabel() == "force [N]"
    np.testing.assert_allclose(first.lines[0].get_xdata(), 100.0)


def test_a_row_in_which_a_motion_costs_nothing_is_named():
    """A five-bar of which one motor has no spring."""
    elastic = cartstiff.load("five-bar")
    k = elastic.springs.stiffness.copy()
    k[elastic.names.index("right_motor")] = 0.0
    one = replace(elastic, springs=elastic.springs.replaced(k, elastic.springs.rest))
    W = np.array([[0.0, 0.0, 0.0, 1.0, 0.0, 0.0]])
    measured = measurements(elastic.q[None], W, {"dx": np.zeros(1), "dy": np.zeros(1)})
    model = model_of(unknowns_of(one, ("left_motor",)), measured)
    with pytest.raises(cartstiff.InputError, match=r"row 1: .*hold the mechanism"):
        model.at(model.unknowns.nominal)
