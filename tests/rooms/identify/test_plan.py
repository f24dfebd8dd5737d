"""What to measure: predictions against campaigns, plans against chance, and the way through."""

import csv
from dataclasses import replace

import numpy as np
import pytest
from tests.doors import candidates, unknowns_of
from tests.identify.campaigns import SPRINGS, arm, load, model_of, plan, simulated
from tests.inner import information, linear_fit, table_text
from tests.support.commands import answer, run

import cartstiff
from cartstiff.identify import identify, read_measurements


@pytest.fixture(scope="module")
def offered(tmp_path_factory):
    elastic = load(arm("elbow", tmp_path_factory.mktemp("plan")))
    found = candidates(elastic, {"d": 1e-5}, count=600, force=100.0, within={"z": (0.1, 2.0)})
    return elastic, unknowns_of(elastic), found


def test_candidates_keep_their_ranges_and_volume(offered):
    elastic, _, found = offered
    assert len(found) == 600
    assert np.abs(found.q).max() <= 2.9
    heights = [elastic.mechanism.at(q).pose[2, 3] for q in found.q[:50]]
    assert min(heights) >= 0.1
    narrow = candidates(elastic, {"d": 1e-5}, count=20, mass=5.0, ranges={"j2": (0.1, 0.2)})
    assert narrow.q[:, 1].min() >= 0.1
    assert narrow.q[:, 1].max() <= 0.2
    with pytest.raises(cartstiff.InputError, match="no posture is left"):
        candidates(elastic, {"d": 1e-5}, count=2, mass=5.0, within={"z": (9.0, 10.0)})


def test_rows_of_the_command_keep_their_volume(tmp_path):
    """The places of the planned postures, by the mechanism."""
    file, elastic = tmp_path / "to_do.csv", cartstiff.load("ur5")
    command = "identify ur5 --plan 4 --force 80 --sd dx=0.02mm --within z=0.2:0.7,x=-0.6:0.3"
    run(command, "-o", file)
    rows = list(csv.DictReader(file.read_text("utf-8").splitlines()))
    assert len(rows) == 4
    for row in rows:
        x, _, z = elastic.mechanism.at(
            [float(row[f"{name} [rad]"]) for name in elastic.names]
        ).pose[:3, 3]
        assert -0.6 <= x <= 0.3
        assert 0.2 <= z <= 0.7


def test_a_plan_beats_chance(offered):
    """12 of 600 against 1000 random choices of 12."""
    _, unknowns, found = offered
    best = plan(unknowns, found, 12, criterion="all")
    G = information(unknowns, found)
    rng = np.random.default_rng(0)
    chance = np.median(
        [
            np.sqrt(np.linalg.inv(G[rng.choice(600, 12, replace=False)].sum(0)).diagonal().max())
            for _ in range(1000)
        ]
    )
    widest = plan(unknowns, found, 12)
    assert chance > 3.0 * widest.deviations[-1].max()
    assert widest.deviations[-1].max() <= best.deviations[-1].max()
    assert best.counts.tolist() == list(range(1, 13))
    assert (np.diff([d.max() for d in best.deviations[6:]]) <= 1e-9).all()


def test_no_row_stands_near_a_singularity():
    """A five-bar stretched out moves by metres: the nearer, the more a linear row would tell."""
    elastic = cartstiff.load("five-bar")
    found = candidates(elastic, {"dx": 2e-5, "dy": 2e-5}, count=40, force=80.0)
    chosen = plan(unknowns_of(elastic), found, 6)

    def moved(rows):
        return np.abs(model_of(chosen.unknowns, rows).at(chosen.unknowns.nominal)[0])

    assert moved(chosen.rows).max() < 10.0 * np.median(moved(found).reshape(-1, 2).max(axis=1))


def test_a_plan_finds_the_row_that_a_parameter_needs(tmp_path):
    """A SCARA's third joint is seen by upward forces alone, all of which are worth the same."""
    elastic = load(arm("scara", tmp_path))
    found = candidates(elastic, dict.fromkeys(("dx", "dy", "dz"), 1e-5), count=3000, force=100.0)
    chosen = plan(unknowns_of(elastic), found, 12)
    assert chosen.rows.wrench[:, 5].any()
    assert np.isfinite(chosen.worst)


@pytest.mark.parametrize(
    ("name", "rows", "columns", "force"),
    [
        ("ur5", 16, ("dx", "dy", "dz"), 80.0),
        ("ur5", 16, ("d",), 80.0),
        ("cubic", 12, ("dx", "dy", "dz"), 100.0),
    ],
)
def test_realised_intervals_are_as_wide_as_predicted(name, rows, columns, force):
    """200 campaigns each: an arm by a tracker, by a dial gauge, and a platform."""
    elastic = cartstiff.load(name)
    unknowns = unknowns_of(elastic)
    size = 0.05 * force / elastic.springs.stiffness.max()
    found = candidates(elastic, dict.fromkeys(columns, size), count=400, force=force)
    chosen = plan(unknowns, found, rows)
    model = model_of(unknowns, chosen.rows)
    y, A = model.at(unknowns.nominal)
    seen = replace(model.observations, deviation=np.full(len(y), np.nan))
    rng, widths = np.random.default_rng(1), []
    for _ in range(200):
        fit = linear_fit(A, y + rng.normal(size=len(y)) * size, seen, unknowns)
        widths.append(np.sqrt(np.diag(fit.covariance)) / unknowns.nominal)
    known = np.isfinite(chosen.deviations[-1])
    realised = np.mean(widths, axis=0)[known]
    assert realised == pytest.approx(chosen.deviations[-1][known], rel=0.1)


def test_the_posture_criterion_serves_that_posture(offered):
    elastic, unknowns, found = offered
    q, W = np.array([0.3, 0.6, 0.8, 0.1, -0.7, 0.2]), np.array([0, 0, 0, 0, 0, -100.0])
    own = plan(unknowns, found, 8, criterion="posture", test=(q, W))
    every = plan(unknowns, found, 8, criterion="all")

    def error(p):
        J = cartstiff.analyse(elastic, q).jacobian
        R = elastic.mechanism.at(q).pose[:3, :3]
        body = np.r_[np.zeros(3), R.T @ W[3:]]
        L = (J * (J.T @ body) / np.array(SPRINGS["elbow"]))[3:]
        M = information(unknowns, p.rows).sum(axis=0)
        return np.trace(L @ np.linalg.inv(M) @ L.T)

    assert error(own) < error(every)


def test_most_intervals_hold_the_truth(offered):
    """A small version of benchmarks/identify_coverage.py."""
    elastic, unknowns, found = offered
    hits = count = 0
    for seed in range(24):
        rng = np.random.default_rng(seed)
        rows = found.taken(rng.choice(600, int(rng.integers(14, 40)), replace=False))
        told = bool(seed % 2)
        result = identify(
            elastic,
            simulated(elastic, rows, {"dx": 2e-5, "dz": 2e-5}, seed=seed, tell_deviations=told),
        )
        for e, c in zip(result.estimates, unknowns.nominal, strict=True):
            if e.verdict == "determined":
                count += 1
                hits += e.interval[0] <= c <= e.interval[1]
    assert count > 100
    assert 0.90 < hits / count <= 0.995


def test_from_a_plan_to_a_file_by_the_command_line(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    arm("elbow", tmp_path)
    command, sd = "identify elbow.yaml", "--sd dx=0.02mm --sd dy=0.02mm --sd dz=0.02mm"
    shown = answer(command, "--plan 9 --force 90 -o to_do.csv", sd)
    assert shown["rows"] == 9
    assert [entry["rows"] for entry in shown["by_rows"]] == list(range(1, 10))
    text = run(command, "--plan 2 --mass 5", sd)
    assert "rows chosen for the widest interval" in text
    head = (tmp_path / "to_do.csv").read_text().splitlines()[0]
    assert head.endswith("dx [m],dy [m],dz [m]")
    assert "nothing was measured" in run(command, "to_do.csv", code=2)
    elastic = load(tmp_path / "elbow.yaml")
    rows = read_measurements(tmp_path / "to_do.csv", elastic, open_cells=True)
    spread = dict.fromkeys(("dx", "dy", "dz"), 2e-5)
    done = simulated(elastic, rows, spread, seed=3)
    done.values["dx"][4] += 4e-4
    (tmp_path / "done.csv").write_text(table_text(done, elastic), "utf-8")
    found = answer(command, "done.csv -o known.yaml -o r.png", sd)
    assert found["suspects"] == [5]
    for entry, k in zip(found["parameters"], SPRINGS["elbow"], strict=True):
        assert entry["stiffness"] == pytest.approx(k, rel=0.3)
    assert (tmp_path / "r.png").read_bytes().startswith(b"\x89PNG")
    more = "--plan 3 --force 90 --criterion posture --load 0,0,0,0,0,-50"
    assert "the deflection at the test posture" in run(command, more, sd)
