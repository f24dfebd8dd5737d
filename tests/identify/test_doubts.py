"""Tables in other units than they say, and results that no arm could stand on."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from tests.identify.campaigns import SPRINGS, arm, load, random_campaign, table_of
from tests.identify.test_zeros import _urdf, campaign

import cartstiff
from cartstiff.errors import InputError
from cartstiff.identify.fitting import linear_fit, robust_fit
from cartstiff.identify.identification import identify
from cartstiff.identify.measurements import Observations, read_measurements
from cartstiff.report.identification import describe_identification

GRAVITY = "gravity: [0, 0, -9.81]\n"


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
    with pytest.raises(InputError, match=r"'fx' declares no unit.*in N.*fx \[kN\]"):
        read_measurements(_table(tmp_path, elastic, force=1e-3), elastic)
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
    with pytest.raises(InputError, match=r"km"):
        read_measurements(path, elastic)
    path = _table(tmp_path, elastic, moved=1e6, heads={"dx": "dx [m]", "dz": "dz [m]"})
    with pytest.raises(InputError, match=r"no mechanism of .* m moves so far"):
        read_measurements(path, elastic)


@pytest.mark.parametrize(("moved", "gravity"), [(1e3, GRAVITY), (3e7, "")])
def test_springs_that_hold_nothing_are_doubted_with_numbers(tmp_path, moved, gravity):
    """Springs a thousand times too soft sink under the arm's weight, by hand's reckoning."""
    elastic = load(arm("elbow", tmp_path, extra=gravity))
    q, W, d = random_campaign(elastic, SPRINGS["elbow"], 40, 4, force=150.0)
    path = table_of(tmp_path / "t.csv", q, W / moved, d, measured=("dx", "dy", "dz"))
    text = path.read_text("utf-8").replace("fx,", "fx [N],", 1)
    path.write_text(text, "utf-8")
    result = identify(elastic, read_measurements(path, elastic))
    note = next(n for n in result.notes if n.code == "doubtful-springs")
    assert note.values["j2"] == pytest.approx(SPRINGS["elbow"][1] / moved, rel=0.1)
    assert "deg" in note.message
    if gravity:  # 3.2 kg m of weight on 25 N m/rad
        torque = max(
            abs(elastic.mechanism.at(row).gravity(elastic.gravity).gradient[1]) for row in q
        )
        turned = np.degrees(torque / note.values["j2"])
        assert f"moves it by {turned:.3g} deg" in note.message
    assert "Other units" in describe_identification(result)
    sound = identify(elastic, read_measurements(_table(tmp_path, elastic), elastic))
    assert "doubtful-springs" not in {n.code for n in sound.notes}


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
        return result, describe_identification(result).split("\n\nStiffness")[0], rows

    result, first, rows = found(tool=(0.01, 0.0, 0.0))
    assert "residuals look like errors of tool.x 0.00999 m" in first
    assert "--unknown joints,tool estimates them" in first
    places = np.array([ten.mechanism.at(q).pose[:3, 3] for q in rows.q])
    moved = np.stack([rows.values[n] for n in "xyz"], axis=1) - places
    left = result.chosen.residual
    share = np.linalg.norm(left) / np.linalg.norm(moved)
    assert result.checks.unexplained == pytest.approx(share, rel=1e-9)
    assert share > 0.9
    assert f"explain {100 * (1 - share**2):.2g} % of what was measured" in first
    assert ("scatter-larger" in first) == is_known
    codes = [n.code for n in result.notes]
    assert codes[0] == "hardly-explained"
    result, first, _ = found(sd=0.01)
    assert ("hardly-explained" in first) != is_known, "mere noise of the size that was given"
    result, first, _ = found()
    assert "DOUBTFUL" not in first
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
    assert note.message.endswith("; and 2 more")
    line = next(x for x in describe_identification(result).splitlines() if x.startswith("Suspect"))
    assert line.endswith(" and 2 more")
    assert line.count(",") == 9


def test_the_residual_of_a_row_that_was_left_out_is_that_of_a_prediction():
    """Against the externally studentised residual, computed from the fit to all rows."""
    x = np.append(np.linspace(0.0, 1.0, 15), 4.0)
    rng = np.random.default_rng(3)
    y = 1.0 + 2.0 * x + 1e-3 * rng.normal(size=x.size)
    y[-1] += 0.5
    A, m = np.stack([np.ones_like(x), x], axis=1), x.size
    nothing, is_angle = np.zeros((m, 3)), np.zeros(m, bool)
    open_, zero = np.full(m, np.nan), np.zeros((m, 6))
    seen = Observations(
        np.arange(m), ("d",) * m, is_angle, is_angle, zero, y, open_, nothing, nothing
    )
    unknowns = SimpleNamespace(
        sizes=np.ones(2), is_bounded=np.zeros(2, bool), priors=(np.zeros((0, 2)), np.zeros(0))
    )
    offsets = SimpleNamespace(columns=np.zeros((m, 0)))
    model = SimpleNamespace(observations=seen, unknowns=unknowns, offsets=offsets)
    robust = robust_fit(model, linear_fit(A, y, seen, unknowns))
    assert robust.suspects.tolist() == [m - 1]
    e = y - A @ np.linalg.solve(A.T @ A, A.T @ y)
    h = A[-1] @ np.linalg.solve(A.T @ A, A[-1])
    others = (np.sum(e**2) - e[-1] ** 2 / (1.0 - h)) / (m - 3)
    expected = e[-1] / np.sqrt(others * (1.0 - h))
    assert robust.standardised[-1] == pytest.approx(expected, rel=1e-9)
