"""Linear springs of arms: textbook least squares, what is not determined, files that carry it."""

import numpy as np
import pytest
from scipy.linalg import lstsq
from scipy.stats import t as student
from tests.identify.campaigns import SPRINGS, arm, jacobian, load, random_campaign, table_of
from tests.support.commands import answer, run

import cartstiff
from cartstiff import analyse_posture
from cartstiff.extend import json_schema
from cartstiff.identify import identify, read_measurements

jsonschema = pytest.importorskip("jsonschema")


def _campaign(tmp_path, name="elbow", rows=20, seed=1, **settings):
    path = arm(name, tmp_path)
    elastic = load(path)
    q, W, d = random_campaign(elastic, SPRINGS[name], rows, seed)
    table = table_of(tmp_path / "m.csv", q, W, d, **settings)
    return path, elastic, read_measurements(table, elastic), (q, W, d)


def test_estimates_are_those_of_the_textbook(tmp_path):
    """Explicit regressor from differences of poses, SciPy's lstsq, sigma^2 (A^T A)^-1, Student."""
    _, elastic, measured, (q, W, d) = _campaign(tmp_path, rows=20)
    result = identify(elastic, measured)
    rows, right = [], []
    for one, load_, motion in zip(q, W, d, strict=True):
        J = jacobian(elastic, one)
        rows.append(J[3:] * (J.T @ load_))
        right.append(motion[3:])
    A, y = np.vstack(rows), np.concatenate(right)
    c, *_ = lstsq(A, y)
    free = len(y) - 6
    sigma = np.sqrt(np.sum((y - A @ c) ** 2) / free)
    spread = sigma * np.sqrt(np.diag(np.linalg.inv(A.T @ A)))
    found = np.array([e.compliance for e in result.estimates])
    assert found == pytest.approx(c, rel=1e-9)  # differences of poses have ten digits
    assert [e.deviation for e in result.estimates] == pytest.approx(spread, rel=1e-8)
    high = c + student.ppf(0.975, free) * spread
    assert [e.interval[1] for e in result.estimates] == pytest.approx(high, rel=1e-8)
    assert [e.stiffness_interval[0] for e in result.estimates] == pytest.approx(1 / high, rel=1e-8)
    # And on the very regressor that was used, to rounding.
    A, y = result.chosen.regressor, result.chosen.target
    c, *_ = lstsq(A, y)
    assert found == pytest.approx(c, rel=1e-10)


def test_a_joint_that_no_row_turns_is_named_and_gets_no_number(tmp_path):
    """Forces at the tool's origin in the plane of the scara: nothing pushes along or turns j4."""
    path = arm("scara", tmp_path)
    elastic = load(path)
    q, W, d = random_campaign(elastic, SPRINGS["scara"], 15, 2)
    W[:, 5] = 0.0
    d = (
        np.array(
            [
                (J := jacobian(elastic, one)) @ ((J.T @ w) / np.array(SPRINGS["scara"]))
                for one, w in zip(q, W, strict=True)
            ]
        )
        + np.random.default_rng(0).normal(size=(15, 6)) * 1e-5
    )
    result = identify(elastic, read_measurements(table_of(tmp_path / "m.csv", q, W, d), elastic))
    verdicts = {e.name: e.verdict for e in result.estimates}
    assert verdicts == {
        "j1": "determined",
        "j2": "determined",
        "j3": "not-identifiable",
        "j4": "determined",
    }
    told = result.to_dict()
    lost = told["parameters"][2]
    assert lost["stiffness"] is None
    assert lost["compliance"] is None
    assert told["covariance"][2] == [None] * 4
    assert [u["springs"] for u in told["unseen"]] == [{"j3": pytest.approx(1.0, abs=1e-9)}]
    assert "not identifiable from these rows: j3" in [n.message for n in result.notes]


def test_two_springs_of_which_only_the_sum_is_seen(tmp_path):
    """Two joints on one line: neither is identifiable, their sum stands under unseen."""
    text = (
        '<robot name="r"><link name="a"/><link name="b"/><link name="c"/><link name="t"/>'
        '<joint name="j1" type="revolute"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/>'
        '<limit lower="-3" upper="3" effort="1" velocity="1"/></joint>'
        '<joint name="j2" type="revolute"><parent link="b"/><child link="c"/><axis xyz="0 0 1"/>'
        '<limit lower="-3" upper="3" effort="1" velocity="1"/></joint>'
        '<joint name="f" type="fixed"><parent link="c"/><child link="t"/><origin xyz="1 0 0"/>'
        "</joint></robot>"
    )
    (tmp_path / "r.urdf").write_text(text, "utf-8")
    elastic = cartstiff.load(str(tmp_path / "r.urdf"))
    q, W, d = random_campaign(elastic, (1e4, 2e4), 8, 3)
    table = table_of(tmp_path / "m.csv", q, W, d)
    measured = read_measurements(table, elastic)
    result = identify(elastic, measured)
    assert [e.verdict for e in result.estimates] == ["not-identifiable"] * 2
    shares = result.to_dict()["unseen"][0]["springs"]
    assert shares["j1"] == pytest.approx(-shares["j2"], rel=1e-6)
    tied = identify(elastic, measured, ties=[["j1", "j2"]])
    assert tied.estimates[0].name == "j1 = j2"
    assert tied.estimates[0].stiffness == pytest.approx(2 / (1 / 1e4 + 1 / 2e4), rel=0.05)


def test_a_nearly_rigid_joint_is_at_least(tmp_path):
    path = arm("elbow", tmp_path)
    elastic = load(path)
    truth = (1e9, *SPRINGS["elbow"][1:])
    q, W, d = random_campaign(elastic, truth, 20, 4)
    result = identify(elastic, read_measurements(table_of(tmp_path / "m.csv", q, W, d), elastic))
    first = result.estimates[0]
    assert first.verdict == "at-least"
    low, high = first.stiffness_interval
    assert high is None
    assert 1e5 < low < 1e9
    assert result.to_dict()["parameters"][0]["interval"] == [pytest.approx(low), None]


def test_json_has_the_form_and_units_are_read(tmp_path):
    path, elastic, measured, (q, W, d) = _campaign(tmp_path, rows=16, sd=2e-5)
    columns = table_of(tmp_path / "si.csv", q, W, d).read_text().splitlines()
    shown = answer("identify", path, tmp_path / "si.csv")
    jsonschema.validate(shown, json_schema("identify"))
    heads = [
        f"{n} [deg]" if n.startswith("j") else f"{n} [mm]" if n[0] == "d" else n
        for n in columns[0].split(",")
    ]
    scaled = [",".join(heads)]
    for line in columns[1:]:
        cells = [float(x) for x in line.split(",")]
        cells[:6] = np.degrees(cells[:6])
        cells[-3:] = [1e3 * x for x in cells[-3:]]
        scaled.append(",".join(map(repr, map(float, cells))))
    (tmp_path / "mm.csv").write_text("\n".join(scaled), "utf-8")
    again = answer("identify", path, tmp_path / "mm.csv")
    stiffness = [p["stiffness"] for p in shown["parameters"]]
    assert [p["stiffness"] for p in again["parameters"]] == pytest.approx(stiffness, rel=1e-9)
    text = run("identify", path, tmp_path / "mm.csv")
    assert "Stiffness, 95 % intervals" in text
    result = identify(elastic, measured)  # deviations given: the normal distribution
    assert result.to_dict()["degrees"] is None
    assert result.checks.probability > 0.001


def test_the_file_written_carries_the_covariance_into_analyse(tmp_path):
    path, _, _, _ = _campaign(tmp_path, rows=16)
    (tmp_path / "sub").mkdir()
    out = tmp_path / "sub" / "known.yaml"
    shown = answer("identify", path, tmp_path / "m.csv", "-o", out)
    known = cartstiff.load(str(out))
    found = [p["stiffness"] for p in shown["parameters"]]
    assert known.springs.stiffness == pytest.approx(found, rel=1e-12)
    assert known.identified.covariance == pytest.approx(np.array(shown["covariance"]), rel=1e-12)
    assert known.identified.rows == 16
    # C W = sum c_j J_j J_j^T W: the variance of the deflection is that of a linear function.
    W = np.array([0, 0, 0, 10.0, -20.0, 30.0])
    result = cartstiff.analyse(known)
    J = result.jacobian
    effects = (J * (J.T @ W))[3:]
    spread = np.sqrt(np.diag(effects @ known.identified.covariance @ effects.T))
    told = analyse_posture(result, wrench=W)["uncertainty"]
    for i in range(3):
        entry = told["numbers"][f"deflection.displacement[{i}]"]
        assert entry["deviation"] == pytest.approx(spread[i], rel=1e-5)
        half = student.ppf(0.975, known.identified.degrees) * spread[i]
        assert entry["upper"] - entry["nominal"] == pytest.approx(half, rel=1e-5)
    # Springs given anew are not the measured ones.
    assert known.with_springs(1e4).identified is None


def test_a_changed_spring_contradicts_the_covariance(tmp_path):
    path, _, _, _ = _campaign(tmp_path, rows=16)
    out = tmp_path / "known.yaml"
    run("identify", path, tmp_path / "m.csv", "-o", out)
    text = out.read_text()
    k = cartstiff.load(str(out)).springs.stiffness[0]
    out.write_text(text.replace(repr(float(k)), "12345.0"), "utf-8")
    with pytest.raises(cartstiff.InputError, match="compliance of 'j1' is not that of the file's"):
        cartstiff.load(str(out))
