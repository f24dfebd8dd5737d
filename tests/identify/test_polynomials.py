"""Polynomial springs as unknowns, against deflections by NumPy's roots and numerical Jacobians."""

import json

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
    plan,
    simulated,
    table_of,
)
from tests.support.commands import answer, run

import cartstiff
from cartstiff import ConvergenceError, DeadForce, InputError
from cartstiff.identify import identify, read_measurements

TRUE = (2.5e4, 3.0e5, 4.0e8)
# Jacobians by differences of poses; differences of predictions by the parameters.
NUMERIC = 1e-7


def _deflection(torque):
    """Real root of the truth's polynomial that is nearest to zero."""
    roots = np.roots([*TRUE[::-1], -torque])
    real = roots.real[np.abs(roots.imag) < 1e-9]
    return real[np.argmin(np.abs(real))]


def _campaign(folder, seed, sd, rows=30, weight=None):
    """An elbow arm whose second joint stiffens: its file with another law, and its table."""
    path = arm("elbow", folder)
    text = path.read_text("utf-8")
    elastic = load(path)
    rng = np.random.default_rng(seed)
    q = rng.uniform(-1.2, 1.2, (rows, 6))
    W = np.hstack([np.zeros((rows, 3)), rng.normal(size=(rows, 3)) * 150.0])
    d = np.zeros((rows, 6))
    for i in range(rows):
        J = jacobian(elastic, q[i])
        x = J.T @ W[i] / np.array(SPRINGS["elbow"])
        x[1] = _deflection((J.T @ W[i])[1])
        if weight is not None:  # what the arm's own weight does is there before the load
            t = weight(elastic, q[i])[1]
            x[1] = _deflection((J.T @ W[i])[1] + t) - _deflection(t)
        d[i] = J @ x
    text = text.replace("j2: {stiffness: 25000.0}", "j2: {polynomial: [2.0e4, 1.0e5, 2.0e8]}")
    path.write_text(text, "utf-8")
    return path, table_of(folder / "m.csv", q, W, d + sd * rng.normal(size=d.shape))


def _weight(elastic, q):
    """Torques of the arm's own weight by differences of its energy."""
    heavy = elastic.with_gravity([0, 0, -9.81])

    def energy(at):
        return heavy.mechanism.at(at).gravity(heavy.gravity).energy

    steps = 1e-5 * np.eye(6)
    return -np.array([(energy(q + s) - energy(q - s)) / 2e-5 for s in steps])


@pytest.mark.parametrize("own_weight", [False, True])
def test_coefficients_come_back(own_weight, tmp_path):
    path, table = _campaign(tmp_path, 3, 0.0, weight=_weight if own_weight else None)
    if own_weight:
        path.write_text(path.read_text("utf-8") + "gravity: [0, 0, -9.81]\n", "utf-8")
    elastic = load(path)
    result = identify(elastic, read_measurements(table, elastic), sought=("joints", "j2"))
    found = {e.name: e for e in result.estimates}
    assert [*found] == ["j1", "j3", "j4", "j5", "j6", "j2", "j2 x^2", "j2 x^3"]
    assert found["j2"].stiffness == pytest.approx(TRUE[0], rel=1e-5)
    assert found["j2 x^2"].compliance == pytest.approx(TRUE[1], rel=1e-4)
    assert found["j2 x^3"].compliance == pytest.approx(TRUE[2], rel=1e-5)
    assert found["j2 x^3"].unknown.unit == "N m/rad^3"
    assert found["j4"].stiffness == pytest.approx(SPRINGS["elbow"][3], rel=1e-5)


def _derivatives_are_right(model, share, tolerance):
    """Those of the model against differences over a share of each unknown's size."""
    theta = model.unknowns.nominal
    _, A = model.at(theta)
    for p, size in enumerate(share * model.unknowns.sizes):
        step = size * np.eye(len(theta))[p]
        by_hand = (model.at(theta + step)[0] - model.at(theta - step)[0]) / (2 * size)
        assert np.abs(A[:, p] - by_hand).max() <= tolerance * np.abs(by_hand).max()


def test_derivatives_are_those_of_the_prediction(tmp_path):
    path, table = _campaign(tmp_path, 3, 0.0)
    elastic = load(path)
    unknowns = unknowns_of(elastic, ("joints", "j2"))
    model = model_of(unknowns, read_measurements(table, elastic))
    _derivatives_are_right(model, 1e-5, NUMERIC)


def test_most_intervals_hold_the_truth(tmp_path):
    held = []
    for seed in range(8):
        path, table = _campaign(tmp_path, seed, 2e-5)
        elastic = load(path)
        result = identify(elastic, read_measurements(table, elastic), sought=("joints", "j2"))
        for e in result.estimates[-3:]:
            truth = dict(zip(("j2", "j2 x^2", "j2 x^3"), (1 / TRUE[0], *TRUE[1:]), strict=True))
            held.append(e.interval[0] <= truth[e.name] <= e.interval[1])
    assert np.mean(held) >= 0.83  # of 24


def test_the_file_written_has_the_polynomial(tmp_path):
    path, table = _campaign(tmp_path, 1, 1e-6)
    command = "identify", path, table, "--unknown joints --unknown j2 -o", tmp_path / "found.yaml"
    rows = [line.split() for line in run(*command).splitlines()]
    # A coefficient stands with its interval, in its unit.
    [row] = [row for row in rows if row[:2] == ["j2", "x^3"]]
    assert float(row[3]) < float(row[2]) < float(row[4])
    assert (row[5:7], row[-1]) == (["N", "m/rad^3"], "coefficient")
    shown = {e["name"]: e for e in answer(*command)["parameters"]}
    assert shown["j2 x^3"]["stiffness"] is None
    assert shown["j2 x^3"]["compliance"] == pytest.approx(TRUE[2], rel=0.02)
    known = load(tmp_path / "found.yaml")
    assert known.springs.laws[1].coefficients == pytest.approx(TRUE, rel=0.1)
    assert known.identified.names == tuple(shown)
    assert known.identified.undetermined == ()


def test_refusals(tmp_path):
    path, _ = _campaign(tmp_path, 1, 1e-6)
    text = path.read_text("utf-8").replace("[2.0e4, 1.0e5", "[0, 1.0e5")
    (tmp_path / "flat.yaml").write_text(text, "utf-8")
    with pytest.raises(InputError, match="needs a first coefficient"):
        unknowns_of(load(tmp_path / "flat.yaml"), ("j2",))


def _five_bar(folder, name, law, k):
    """The bundled five-bar, one motor with a polynomial."""
    loop = cartstiff.load("five-bar")
    (folder / name).write_text(
        json.dumps(
            {
                "kind": "closed-chain",
                "frame": "tip",
                "actuated": ["left_motor", "right_motor"],
                "model": str(cartstiff.files.catalogue.bundled("five-bar").with_suffix(".urdf")),
                "closures": [{"frames": ["tip", "right_tip"], "type": "point"}],
                "q": dict(zip(loop.names, loop.q.tolist(), strict=True)),
                "springs": {"left_motor": {"polynomial": law}, "right_motor": {"stiffness": k}},
            }
        )
    )
    return load(folder / name)


def _pulled(elastic, rows, seed, force):
    """Displacements of the loaded tip by `equilibrium`; the motors hold where they are told to."""
    rng = np.random.default_rng(seed)
    motors = list(elastic.mechanism.actuated)
    q, moved, W = [], [], np.zeros((rows, 6))
    W[:, 3:5] = rng.normal(size=(rows, 2)) * force
    for w in W:
        step = np.zeros(len(elastic.names))
        step[motors] = rng.uniform(-0.25, 0.25, 2)
        q.append(elastic.mechanism.closed(elastic.q + step).q)
        told = elastic.with_springs(rest={elastic.names[j]: q[-1][j] for j in motors})
        state = cartstiff.equilibrium(told, q[-1], DeadForce(w[3:]), limits=False)
        moved.append((state.pose - elastic.mechanism.at(q[-1]).pose)[:2, 3])
    values = dict(zip(("dx", "dy"), np.array(moved).T, strict=True))
    return measurements(q, W, values, axes="world")


def test_a_motor_of_a_loop_that_stiffens(tmp_path):
    """What it carries depends on how far both give, so the equilibrium is fitted unasked."""
    true = _five_bar(tmp_path, "true.yaml", [900.0, 0.0, 2.0e4], 700.0)
    guess = _five_bar(tmp_path, "guess.yaml", [700.0, 0.0, 1.0e4], 800.0)
    measured = _pulled(true, 12, 5, 150.0)
    result = identify(guess, measured, sought=("joints", "left_motor"))
    found = {e.name: e.compliance for e in result.estimates}
    assert found["right_motor"] == pytest.approx(1 / 700.0, rel=1e-5)
    assert found["left_motor"] == pytest.approx(1 / 900.0, rel=1e-5)
    assert found["left_motor x^3"] == pytest.approx(2.0e4, rel=1e-4)
    assert result.to_dict()["model"] == "loaded equilibrium"
    assert "equilibrium-needed" in {note.code for note in result.notes}
    model = model_of(result.unknowns, measured, loaded=True)
    _derivatives_are_right(model, 1e-4, 1e-5)


def test_a_plan_and_a_simulation_know_that_it_stiffens(tmp_path):
    """One row of large force tells the powers apart; what is simulated is found again."""
    bent = _five_bar(tmp_path, "bent.yaml", [900.0, 0.0, 2.0e4], 700.0)
    sd = {"dx": 1e-5, "dy": 1e-5}
    offered = candidates(bent, sd, count=30, force=200.0)
    unknowns = unknowns_of(bent, ("joints", "left_motor"))
    chosen = plan(unknowns, offered, 6)
    assert chosen.lost == ()
    result = identify(
        bent,
        simulated(bent, chosen.rows, sd, tell_deviations=True),
        sought=("joints", "left_motor"),
    )
    for e, c, share in zip(result.estimates, unknowns.nominal, chosen.deviations[-1], strict=True):
        assert e.deviation == pytest.approx(abs(c) * share, rel=0.2)
        assert abs(e.compliance - c) < 4 * e.deviation


def test_a_guess_that_is_too_soft_for_the_loads_is_begun_stiffer(tmp_path, monkeypatch):
    true = _five_bar(tmp_path, "true.yaml", [900.0, 0.0, 2.0e4], 700.0)
    soft = _five_bar(tmp_path, "soft.yaml", [500.0, 0.0, 1.5e4], 400.0)
    measured, tried = _pulled(true, 10, 5, 150.0), []
    kind = type(model_of(unknowns_of(soft), measured, True))
    at = kind.at

    def carries(model, theta):
        tried.append(theta[0])
        if theta[0] > 1 / 500:
            raise ConvergenceError("row 1: no equilibrium found", iterations=0, residual=np.nan)
        return at(model, theta)

    monkeypatch.setattr(kind, "at", carries)
    result = identify(soft, measured, sought=("joints", "left_motor"))
    assert tried[0] == pytest.approx(1 / 400)
    found = {e.name: e.compliance for e in result.estimates}
    assert found["left_motor"] == pytest.approx(1 / 900.0, rel=1e-5)


def test_an_arm_s_polynomial_under_large_loads(tmp_path):
    """Forces that bend an arm far: the equilibrium under them, against `equilibrium`."""
    path, _ = _campaign(tmp_path, 3, 0.0)
    start = load(path)
    text = path.read_text("utf-8").replace("[2.0e4, 1.0e5, 2.0e8]", str(list(TRUE)))
    (tmp_path / "true.yaml").write_text(text, "utf-8")
    true = load(tmp_path / "true.yaml")
    rng = np.random.default_rng(2)
    q = rng.uniform(-1.2, 1.2, (14, 6))
    W = np.hstack([np.zeros((14, 3)), rng.normal(size=(14, 3)) * 600.0])
    moved = []
    for one, w in zip(q, W, strict=True):
        state = cartstiff.equilibrium(
            true.with_springs(rest=one), one, DeadForce(w[3:]), limits=False
        )
        moved.append((state.pose - true.mechanism.at(one).pose)[:3, 3])
    values = dict(zip(("dx", "dy", "dz"), np.array(moved).T, strict=True))
    measured = measurements(q, W, values, axes="world")
    result = identify(start, measured, sought=("joints", "j2"), loaded=True)
    found = {e.name: e.compliance for e in result.estimates}
    truth = dict(zip(("j2", "j2 x^2", "j2 x^3"), (1 / TRUE[0], *TRUE[1:]), strict=True))
    for name, value in truth.items():
        assert found[name] == pytest.approx(value, rel=1e-4)
    small = identify(start, measured, sought=("joints", "j2"))
    worst = {note.code: note.values for note in small.notes}["linear-differs"]
    assert abs(worst["loaded"] - worst["linear"]) > 1e-6
