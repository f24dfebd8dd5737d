"""Tables in other units than they say, gross errors, and what springs do not explain."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize
from tests.identify.campaigns import SPRINGS, arm, load, measurements, random_campaign, table_of
from tests.identify.test_zeros import _urdf, campaign
from tests.support import refused
from tests.support.commands import answer, run
from tests.support.printed import text_of

import cartstiff
from cartstiff.identify import identify, read_measurements


def _table(folder, elastic, *, force=1.0, moved=1.0, heads=None, rows=40):
    q, W, d = random_campaign(elastic, SPRINGS["elbow"], rows, 4, force=150.0)
    path = table_of(folder / "t.csv", q, W * force, d[:, :] * moved)
    text = path.read_text("utf-8")
    for name, head in (heads or {}).items():
        text = text.replace(name, head, 1)
    path.write_text(text, "utf-8")
    return path


def test_forces_in_kilonewtons_need_their_unit(tmp_path):
    """150 N are 0.15 in kN: refused without a unit, right with it."""
    elastic = load(arm("elbow", tmp_path))
    refused(
        r"'fx' declares no unit.*in N.*fx \[kN\]",
        read_measurements,
        _table(tmp_path, elastic, force=1e-3),
        elastic,
    )
    heads = {name: f"{name} [kN]" for name in ("fx", "fy", "fz")}
    heads |= {name: f"{name} [N m]" for name in ("mx", "my", "mz")}
    path = _table(tmp_path, elastic, force=1e-3, heads=heads)
    result = identify(elastic, read_measurements(path, elastic))
    for e, k in zip(result.estimates, SPRINGS["elbow"], strict=True):
        if e.verdict == "determined":
            assert e.stiffness == pytest.approx(k, rel=0.2)
    said = _table(tmp_path, elastic, force=1e-3, heads={"fx": "fx [N]"})
    assert len(read_measurements(said, elastic)) == 40
    assert len(read_measurements(_table(tmp_path, elastic), elastic)) == 40


def test_kilometres_are_refused_in_any_unit(tmp_path):
    """An arm of one metre does not move by two."""
    elastic = load(arm("elbow", tmp_path))
    path = _table(tmp_path, elastic, heads={"dz": "dz [km]"})
    refused(r"km", read_measurements, path, elastic)
    path = _table(tmp_path, elastic, moved=1e6, heads={"dx": "dx [m]", "dz": "dz [m]"})
    refused(r"no mechanism of .* m moves so far", read_measurements, path, elastic)


@pytest.mark.parametrize("is_known", [True, False])
def test_an_answer_that_springs_do_not_explain_doubts_itself_first(tmp_path, is_known):
    """A tool 1 cm off, or readings that scatter by 1 cm: numbers before the table of springs.

    The share is recomputed from the simulated positions: the springs move the tip by millimetres.
    """
    ten = cartstiff.load(str(_urdf(tmp_path / "ten.yaml")))

    def found(**how):
        path = campaign(tmp_path / "a.csv", zeros=np.zeros(6), **how)
        rows = read_measurements(path, ten)
        if not is_known:
            unknown = {n: np.full(len(rows), np.nan) for n in rows.deviations}
            rows = replace(rows, deviations=unknown)
        result = identify(ten, rows)
        return result, text_of(result).split("\n\nStiffness")[0], rows

    result, first, rows = found(tool=(0.01, 0.0, 0.0))
    places = np.array([ten.mechanism.at(q).pose[:3, 3] for q in rows.q])
    moved = np.stack([rows.values[n] for n in "xyz"], axis=1) - places
    left = result.chosen.residual
    share = np.linalg.norm(left) / np.linalg.norm(moved)
    assert result.checks.unexplained == pytest.approx(share, rel=1e-9)
    assert share > 0.9
    assert f"explain {100 * (1 - share**2):.3g} % of what was measured" in first
    assert ("times what the deviations given explain" in first) == is_known
    assert (result.inflation > 5.0) == is_known
    codes = [n.code for n in result.notes]
    assert "hardly-explained" in codes[:2]
    result, first, _ = found(sd=0.01)
    assert ("hardly-explained" in first) != is_known, "mere noise of the size that was given"
    result, first, _ = found()
    assert "Doubts" not in first
    assert result.checks.unexplained < 0.1


def test_suspects_are_ten_lines_in_text_and_all_in_json(tmp_path):
    """Twelve gross errors in eighty rows."""
    elastic = load(arm("elbow", tmp_path))
    q, W, d = random_campaign(elastic, SPRINGS["elbow"], 80, 9)
    bad = list(range(5, 77, 6))
    d[bad] += 5e-3
    result = identify(elastic, read_measurements(table_of(tmp_path / "t.csv", q, W, d), elastic))
    assert result.to_dict()["suspects"] == [n + 1 for n in bad]
    note = next(n for n in result.notes if n.code == "suspects")
    assert len(note.values["reasons"]) == 12
    assert note.message.count("row ") == 10
    assert "; and 2 more" in note.message


def _displacements(q, W, d, sd=np.nan):
    return measurements(q, W, dict(zip(("dx", "dy", "dz"), d[:, 3:].T, strict=True)), sd=sd)


def test_repeats_far_further_apart_than_others(tmp_path):
    """Without deviations the other repeats say what is far; outliers of 20 sigma are none."""
    elastic = load(arm("elbow", tmp_path))
    q, W, d = random_campaign(elastic, SPRINGS["elbow"], 16, 1, moment=5.0)
    rng = np.random.default_rng(2)
    twice = np.repeat(d, 2, axis=0) + rng.normal(size=(32, 6)) * 1e-6
    again = [np.repeat(part, 2, axis=0) for part in (q, W)]
    twice[9, 4] += 4e-5
    identify(elastic, _displacements(*again, twice))
    twice[9, 4] += 4e-4
    refused(
        "rows 9 and 10 contradict each other in 'dy'",
        identify,
        elastic,
        _displacements(*again, twice),
    )


def test_loads_along_other_axes_and_signs_are_doubted(tmp_path):
    """Forces turned into the body's axes, displacements exchanged: springs explain little."""
    elastic = load(arm("elbow", tmp_path))
    q, W, d = random_campaign(elastic, SPRINGS["elbow"], 16, 1)
    R = np.array([elastic.mechanism.at(one).pose[:3, :3] for one in q])
    turned = np.einsum("nji,nkj->nki", R, W.reshape(-1, 2, 3)).reshape(-1, 6)
    for loads, moved in ((turned, d), (W, d[:, [0, 1, 2, 3, 5, 4]]), (W, -d)):
        result = identify(elastic, _displacements(q, loads, moved))
        assert "hardly-explained" in {n.code for n in result.notes}
    assert "hardly-explained" not in {
        n.code for n in identify(elastic, _displacements(q, W, d)).notes
    }


@pytest.mark.parametrize("is_known", [True, False])
def test_the_recommended_fit_contains_the_truth_beside_gross_errors(tmp_path, is_known):
    """Two wrong rows of 16: the file written has the robust fit; the plain one misses springs.

    The share of intervals that contain the truth over 20 campaigns is that of 95 % intervals.
    """
    path = arm("elbow", tmp_path)
    elastic, held, missed, rows = load(path), 0, 0, []
    for seed in range(1, 21):
        q, W, d = random_campaign(elastic, SPRINGS["elbow"], 16, seed)
        bad = np.random.default_rng(seed).choice(16, 2, replace=False)
        d[bad, 3] += 4e-4
        table = table_of(tmp_path / "m.csv", q, W, d, sd=2e-5 if is_known else None)
        result = identify(elastic, table)
        rows.append(set(result.suspects) == {int(n) + 1 for n in bad})
        assert (result.fit, result.recommended) == ("robust", "robust")
        plain = identify(elastic, table, fit="plain")
        assert plain.recommended == "robust"
        for e, p, k in zip(result.estimates, plain.estimates, SPRINGS["elbow"], strict=True):
            held += e.interval[0] <= 1 / k <= e.interval[1]
            missed += not p.interval[0] <= e.compliance <= p.interval[1]
    assert 0.90 <= held / 120 <= 0.99
    assert np.mean(rows) > 0.9
    out = tmp_path / "known.yaml"
    shown = answer("identify", path, tmp_path / "m.csv", "-o", out)
    assert shown["fit"] == shown["recommended"] == "robust"
    known = load(out)
    assert known.identified.source == "m.csv, robust fit"
    assert known.springs.stiffness == pytest.approx([p["stiffness"] for p in shown["parameters"]])
    assert known.identified.values == pytest.approx([p["robust"] for p in shown["parameters"]])
    half = known.identified.factor * np.sqrt(np.diag(known.identified.covariance))
    inside = np.abs(known.identified.values - 1 / np.array(SPRINGS["elbow"])) <= half
    assert inside.all()
    text = run("identify", path, tmp_path / "m.csv")
    assert "robust fit (recommended) of" in text
    assert "[suspects] suspect rows: row" in text
    plain = run("identify", path, tmp_path / "m.csv", "--fit plain")
    assert "plain fit (the robust one is recommended) of" in plain
    assert "the answer is the plain one" in plain


def test_the_robust_fit_is_the_least_cauchy_loss_of_scipy(tmp_path):
    """No other parameters have a smaller loss, by a search without derivatives."""
    elastic = load(arm("elbow", tmp_path))
    q, W, d = random_campaign(elastic, SPRINGS["elbow"], 16, 5)
    d[[3, 9], 3] += 4e-4
    result = identify(elastic, _displacements(q, W, d))
    fit = result.robust.fit
    r = fit.residual
    s = 1.4826 * np.median(np.sort(np.abs(r))[6:])  # a residual a parameter may be zero

    def loss(shares):
        left = fit.target - fit.regressor @ (fit.theta * (1.0 + shares))
        return np.sum(np.log1p((left / (2.385 * s)) ** 2))

    found = minimize(
        loss,
        np.zeros(6),
        method="Nelder-Mead",
        options={"xatol": 1e-7, "fatol": 1e-12, "maxiter": 5000, "maxfev": 5000},
    )
    assert np.abs(found.x).max() < 1e-4


def test_clean_tables_have_few_suspects(tmp_path):
    """40 tables of noise alone: at most three of them, where one in a hundred is expected."""
    elastic = load(arm("elbow", tmp_path))
    q, W, still = random_campaign(elastic, SPRINGS["elbow"], 16, 1, sd=0.0)
    rng = np.random.default_rng(0)
    named = 0
    for _ in range(40):
        d = still + 2e-5 * rng.normal(size=still.shape)
        named += identify(elastic, _displacements(q, W, d)).recommended == "robust"
    assert named <= 3
