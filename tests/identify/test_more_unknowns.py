"""Links that give, beams, counterbalance lines, platforms: found, and written into files."""

from dataclasses import replace

import numpy as np
import pytest
from tests.doors import candidates, unknowns_of
from tests.identify.campaigns import arm, load, simulated, written
from tests.support import refused

import cartstiff
from cartstiff.identify import identify

LINK = """
flexible:
  {name}:
    stiffness:
      - [5.0e+4, 0, 0, 0, 0, 0]
      - [0, 4.0e+4, 0, 0, 0, 3.0e+4]
      - [0, 0, 6.0e+4, 0, 0, 0]
      - [0, 0, 0, 2.0e+7, 0, 0]
      - [0, 0, 0, 0, 3.0e+7, 0]
      - [0, 3.0e+4, 0, 0, 0, 4.0e+7]
"""


def _measured(elastic, rows, sd, columns=("dx", "dy", "dz", "drx", "dry", "drz"), **load_):
    spreads = dict.fromkeys(columns, sd)
    offered = candidates(elastic, spreads, count=rows, seed=3, **(load_ or {"force": 200.0}))
    return simulated(elastic, offered, spreads, seed=1, tell_deviations=True)


def test_legs_by_name_are_written_with_a_stiffness_each(tmp_path):
    """The file written is the machine that was measured."""
    elastic = cartstiff.load("6-pus")
    k = elastic.springs.stiffness
    truth = k * np.linspace(0.6, 1.8, len(k))
    true = replace(elastic, springs=elastic.springs.replaced(truth, elastic.springs.rest))
    result = identify(elastic, _measured(true, 12, 1e-9))
    again = written(result, "6-pus", tmp_path)
    assert again.springs.stiffness == pytest.approx(truth, rel=1e-2)
    found = [estimate.stiffness for estimate in result.estimates]
    assert again.springs.stiffness[k > 0.0] == pytest.approx(found)


@pytest.mark.parametrize("name", ["ur5", "stewart-simscape"])
def test_rounding_of_exact_rows_makes_none_of_them_suspect(name):
    elastic = cartstiff.load(name)
    rows = simulated(elastic, _measured(elastic, 12, 1e-6), dict.fromkeys(("dx", "dz"), 1e-30))
    rng = np.random.default_rng(0)
    rounded = {n: x * (1.0 + 2e-15 * (rng.random(12) < 0.2)) for n, x in rows.values.items()}
    result = identify(elastic, replace(rows, values=rounded))
    assert not result.suspects
    assert result.recommended == "plain"


def test_a_payload_is_not_written_under_another_frame(tmp_path):
    """Its centre is in the M of the file: the same numbers would put it elsewhere."""
    path = arm("elbow", tmp_path, extra="payload: {mass: 2, com: [0, 0, 0.1]}\n")
    elastic = load(path)
    result = identify(elastic, _measured(elastic, 12, 1e-6))
    refused(
        "-o: the payload of a file is at its own frame",
        written,
        result,
        path,
        tmp_path,
        "elsewhere",
    )


def test_a_base_with_a_6x6_is_found_and_written(tmp_path):
    path = arm("elbow", tmp_path, extra=LINK.format(name="base"))
    elastic = load(path)
    measured = _measured(elastic, 60, 1e-8)
    result = identify(elastic, measured, sought=("joints", "base"))
    assert len(result.estimates) == 6 + 21
    for e, c in zip(result.estimates, result.unknowns.nominal, strict=True):
        if e.verdict != "not-identifiable":
            assert abs(e.compliance - c) < 5 * e.deviation
    lost = [e.name for e in result.estimates if e.verdict == "not-identifiable"]
    assert "j1" in lost  # its axis turns as the base does about z
    some = identify(elastic, measured, sought=("joints", "base:rx,ry"))
    assert [e.name for e in some.estimates][6:] == ["base.rx", "base.ry"]
    assert all(e.verdict == "determined" for e in some.estimates)
    known = written(some, path, tmp_path)
    assert known.identified.names[6:] == ("base.rx", "base.ry")
    diagonal = identify(elastic, measured, sought=("base:diagonal",))
    assert len(diagonal.estimates) == 6


BEAM = (
    "flexible:\n  l2: {beam: {E: 7.0e+10, G: 2.6e+10, length: 0.45, area: 1.0e-3, "
    "Iy: 2.0e-7, Iz: 2.0e-7, J: 4.0e-7}}\n"
)


def test_ties_act_within_links_or_are_refused(tmp_path):
    """Ties need springs that are sought; nothing is sought twice."""
    link = load(arm("elbow", tmp_path, extra=LINK.format(name="base")))
    tied = unknowns_of(link, ("base:rx,ry,rz",), ties=[("base.rx", "base.ry")])
    assert tied.names == ("base.rx = base.ry", "base.rz")
    found = tied.mechanism(np.array([2.0, 3.0])).compliances
    assert [found[n].value for n in ("base.rx", "base.ry")] == pytest.approx([2.0, 2.0])
    beam = load(arm("elbow", tmp_path, extra=BEAM))
    for elastic, sought, more, words in (
        (link, ("j2", "j3"), {"ties": [("j1", "j2")]}, "'j1' cannot be tied"),
        (link, (), {"ties": [("j1", "j1")]}, "'j1' cannot be tied"),
        (link, ("base", "base:diagonal"), {}, "'base.px' is sought twice"),
        (beam, ("l2.rx",), {}, "one axis of a beam"),
        (beam, ("l2:diagonal",), {}, "one axis of a beam"),
    ):
        refused(words, unknowns_of, elastic, sought, **more)


def test_a_beam_is_found_as_a_share_of_the_file(tmp_path):
    path = arm("elbow", tmp_path, extra=BEAM)
    elastic = load(path)
    measured = _measured(elastic, 40, 1e-7)
    text = path.read_text("utf-8").replace("E: 7.0e+10, G: 2.6e+10", "E: 1.4e+11, G: 5.2e+10")
    (tmp_path / "stiff.yaml").write_text(text, "utf-8")
    stiff = cartstiff.load(str(tmp_path / "stiff.yaml"))
    result = identify(stiff, measured, sought=("all",))
    share = result.estimates[-1]
    assert share.name == "l2 (beam)"
    assert share.compliance == pytest.approx(2.0, rel=0.02)
    known = written(result, tmp_path / "stiff.yaml", tmp_path)
    q = measured.q[0]
    wanted = cartstiff.analyse(elastic, q).compliances["B"]
    assert cartstiff.analyse(known, q).compliances["B"] == pytest.approx(
        wanted, rel=0.02, abs=0.02 * np.abs(wanted).max()
    )
    assert known.identified.values[-1] == pytest.approx(1.0)


def test_a_counterbalance_line_beside_a_joint(tmp_path):
    """A spring from base to upper arm: in parallel with j2, nonlinear in the compliances."""
    line = "lines:\n  - {frames: [base, l2], points: [[0.3, 0, 0.2], [0.2, 0, 0.3]], "
    path = arm("elbow", tmp_path, extra=line + "stiffness: 3.0e+4, preload: 500}\n")
    elastic = load(path)
    measured = _measured(elastic, 40, 1e-7)
    text = path.read_text("utf-8").replace("3.0e+4", "2.0e+4").replace("25000.0", "3.0e+4")
    (tmp_path / "other.yaml").write_text(text, "utf-8")
    other = cartstiff.load(str(tmp_path / "other.yaml"))
    result = identify(other, measured, sought=("joints", "lines"))
    assert result.model.by_differences == []
    x = result.model.unknowns.nominal
    slopes = result.model.at(x)[1]
    step = 1e-4 * x * (np.arange(len(x)) == len(x) - 1)
    change = (result.model.at(x + step)[0] - result.model.at(x - step)[0]) / (2.0 * step[-1])
    np.testing.assert_allclose(slopes[:, -1], change, atol=1e-6 * np.abs(change).max())
    found = {e.name: e.stiffness for e in result.estimates}
    assert found["line1"] == pytest.approx(3.0e4, rel=0.05)
    assert found["j2"] == pytest.approx(2.5e4, rel=0.05)
    known = written(result, tmp_path / "other.yaml", tmp_path)
    assert known.potentials[0].stiffness[0] == pytest.approx(found["line1"])


@pytest.mark.parametrize("name", ["stewart-gough", "delta", "five-bar"])
def test_files_of_platforms_and_loops_are_written(name, tmp_path):
    elastic = cartstiff.load(name)
    columns = ("dx", "dy") if name == "five-bar" else ("dx", "dy", "dz", "drx", "dry", "drz")
    k = float(elastic.springs.stiffness.max())
    measured = _measured(elastic, 20, 1e-7, columns, force=1e-4 * k)
    result = identify(elastic, measured, sought=("joints",))
    known = written(result, name, tmp_path)
    found = [e.stiffness for e in result.estimates]
    sprung = known.springs.stiffness[known.springs.stiffness > 0]
    assert sprung == pytest.approx(found)
    assert known.identified.rows == 20
    assert unknowns_of(known).names == result.unknowns.names


def test_cables_that_only_preload_keeps_taut_are_named():
    elastic = cartstiff.load("cable-robot")
    spread = {"dx": 1e-6, "dy": 1e-6, "dz": 1e-6}
    rows = candidates(elastic, spread, count=12, force=100.0)
    result = identify(elastic, simulated(elastic, rows, spread))
    note = next(n for n in result.notes if n.code == "cables-taken-as-taut")
    # Statics by hand: tensions of least energy that carry the load alone.
    for name, found in note.values["against_load"].items():
        leg = int(name.removeprefix("leg")) - 1
        for row, (q, wrench) in enumerate(zip(rows.q, rows.wrench, strict=True), start=1):
            posture = elastic.mechanism.at(q)
            R = posture.pose[:3, :3]
            body = np.kron(np.eye(2), R.T) @ wrench
            L = posture.lines.lines
            t = L @ np.linalg.solve(L.T @ L, body)  # springs are equal, nearly
            if abs(t[leg]) > 5.0:
                assert (row in found) == (t[leg] < 0.0)


@pytest.mark.parametrize("kind", ["link", "beam", "polynomial", "six legs", "cables"])
def test_derivatives_by_compliances_are_differences_of_the_energy_s(kind, tmp_path):
    """Forces and stiffness of every compliance, where the springs are deflected."""
    if kind in ("six legs", "cables"):
        elastic = cartstiff.load({"six legs": "cubic", "cables": "cable-robot"}[kind])
        elastic = cartstiff.analyse(elastic).elastic
        step = np.full(6, 1e-3)
    else:
        extra = {"link": LINK.format(name="base"), "beam": BEAM, "polynomial": ""}[kind]
        path = arm("elbow", tmp_path, extra=extra)
        if kind == "polynomial":
            text = path.read_text("utf-8").replace(
                "j2: {stiffness: 25000.0}", "j2: {polynomial: [2.5e+4, 0.0, 3.0e+6]}"
            )
            path.write_text(text, "utf-8")
        elastic = load(path).with_springs(
            rest=dict.fromkeys(("j1", "j2", "j3", "j4", "j5", "j6"), 0.0)
        )
        step = np.linspace(1e-3, 3e-3, len(elastic.q))
    posture = elastic.mechanism.at(elastic.q + step)
    for key, number in elastic.compliances.items():
        *both, factor = elastic.softened(key)
        more, less = (term.evaluate(posture) for term in both)
        own = elastic.compliances[key.partition("*")[0]].value
        size = number.value or 1e-3 * own or 1e3  # an entry, or a coefficient, of zero
        for part in ("gradient", "hessian"):

            def there(h, key=key, part=part, size=size, own=number.value):
                changed = elastic.with_compliances({key: own + h * size})
                terms = (changed.springs, *changed.potentials)
                return sum(getattr(t.evaluate(posture), part) for t in terms)

            wanted = (8 * (there(1e-3) - there(-1e-3)) - there(2e-3) + there(-2e-3)) / (
                12e-3 * size
            )
            got = factor * (getattr(more, part) - getattr(less, part))
            assert got == pytest.approx(wanted, rel=1e-6, abs=1e-6 * np.abs(wanted).max()), key
