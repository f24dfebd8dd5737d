"""Maps, paths and the page carry what measurements left open of the springs, without an option."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest
from tests.identify.campaigns import SPRINGS, arm, jacobian, load, random_campaign, table_of

import cartstiff
from cartstiff.analysis.posture import analyse_posture
from cartstiff.cli.main import main
from cartstiff.identify.campaign import identify
from cartstiff.identify.candidates import candidates
from cartstiff.identify.synthetic import simulated
from cartstiff.identify.writing import with_result
from cartstiff.maps.sampling import Trajectory
from cartstiff.mechanisms.identified import neighbours
from cartstiff.mechanisms.other_units import in_units
from cartstiff.page.shown import shown_numbers
from cartstiff.page.state import ViewState
from cartstiff.potentials.loads import DeadWrench
from cartstiff.statics.equilibrium import equilibrium
from cartstiff.statics.held import displacement_between
from cartstiff.statics.toolpath import compensate

FORCE = np.array([0, 0, 0, 30.0, -20.0, -60.0])
PLACES = [[0.3, 0.5, 0.9, 0.2, 0.7, -0.3], [-0.4, 0.8, 0.5, -0.6, 0.9, 0.1]]


@pytest.fixture(scope="module")
def known(tmp_path_factory):
    """A mechanism file with measured springs, of which tool forces say much the same."""
    folder = tmp_path_factory.mktemp("known")
    path = arm("elbow", folder)
    q, W, d = random_campaign(load(path), SPRINGS["elbow"], 9, 4, sd=8e-5)
    table = table_of(folder / "m.csv", q, W, d)
    with pytest.raises(SystemExit) as exit_:
        main(["identify", str(path), str(table), "-o", str(folder / "known.yaml")])
    assert exit_.value.code == 0
    return folder / "known.yaml"


def _by_hand(elastic, q):
    """Displacement (F axes) under FORCE along F, its size, and their half widths."""
    found = elastic.identified
    J = jacobian(elastic, q)
    felt = J.T @ FORCE
    moved = J[3:] @ (found.values * felt)
    rates = J[3:] * felt
    half = found.factor * np.sqrt(np.einsum("ip,pr,ir->i", rates, found.covariance, rates))
    u = moved / np.linalg.norm(moved) @ rates
    return moved, half, found.factor * np.sqrt(u @ found.covariance @ u)


def test_a_map_holds_half_widths_beside_its_quantities(known, tmp_path):
    pytest.importorskip("zarr")
    elastic = load(known)
    correlation = elastic.identified.covariance[2, 4]
    assert correlation != 0.0  # the whole covariance is there to be carried
    found = cartstiff.compute_map(
        elastic,
        Trajectory(np.array(PLACES)),
        ["deflection", "minimum", "force"],
        tmp_path / "m.zarr",
        deflect=FORCE,
        world=True,
    )
    assert "force_half_width" not in found
    for i, q in enumerate(PLACES):
        moved, _, half = _by_hand(elastic, q)
        assert found["deflection"].values[i] == pytest.approx(np.linalg.norm(moved), rel=1e-7)
        assert found["deflection_half_width"].values[i] == pytest.approx(half, rel=1e-5)
        # The other way: the tolerances of one posture.
        one = analyse_posture(
            cartstiff.analyse(elastic, q),
            connection="B",
            length=found.attrs["characteristic_length"],
        )
        name, numbers = "indices.minimum_stiffness", one["uncertainty"]["numbers"]
        deviation = next(n["deviation"] for key, n in _entries(numbers) if key == name)
        assert found["minimum_half_width"].values[i] == pytest.approx(
            elastic.identified.factor * deviation, rel=5e-2
        )
    assert "95 % intervals" in found.attrs["intervals"]
    # Another file for other knowledge of the same springs.
    text = known.read_text()
    changed = known.with_name("other.yaml")
    changed.write_text(text.replace("level: 0.95", "level: 0.9"))
    with pytest.raises(cartstiff.InputError, match="another map"):
        cartstiff.compute_map(
            load(changed),
            Trajectory(np.array(PLACES)),
            ["deflection", "minimum", "force"],
            tmp_path / "m.zarr",
            deflect=FORCE,
            world=True,
        )


def _entries(numbers):
    return numbers.items() if isinstance(numbers, dict) else [(n["name"], n) for n in numbers]


def test_a_path_writes_half_widths(known, tmp_path, capfd):
    elastic = load(known)
    lines = ["x,y,z,roll,pitch,yaw"]
    for q in PLACES[:1]:
        pose = elastic.mechanism.at(q).pose
        angles = cartstiff.geometry.se3.roll_pitch_yaw(pose)
        lines.append(",".join(repr(float(x)) for x in (*pose[:3, 3], *angles)))
    lines.append(lines[-1])
    (tmp_path / "path.csv").write_text("\n".join(lines) + "\n")
    with pytest.raises(SystemExit) as exit_:
        main(
            [
                "path",
                str(known),
                str(tmp_path / "path.csv"),
                "--world",
                "--json",
                "--load",
                ",".join(map(str, FORCE)),
                "--csv",
                str(tmp_path / "out.csv"),
            ]
        )
    out, err = capfd.readouterr()
    assert exit_.value.code == 0, err
    shown = json.loads(out)
    for q, half in zip(shown["q"], shown["half_widths"], strict=True):
        assert half == pytest.approx(_by_hand(elastic, q)[2], rel=1e-5)
    head = (tmp_path / "out.csv").read_text().splitlines()[0]
    assert head.endswith("deflection_half_width [m]")


def test_the_page_tells_the_interval_under_the_load(known):
    elastic = load(known)
    q = np.array(PLACES[1])
    R = elastic.mechanism.at(q).pose[:3, :3]
    body = np.kron(np.eye(2), R.T) @ FORCE
    result = cartstiff.analyse(elastic, q, wrench=body)
    shown = shown_numbers(result, ViewState(q=q.tolist()))["moved"]["half_width"]
    # Under the load itself: as the tolerances of one posture say.
    one = analyse_posture(result)["uncertainty"]["numbers"]
    names = {key: n["deviation"] for key, n in _entries(one) if key.startswith("deflection.disp")}
    by_tolerances = [elastic.identified.factor * s for s in names.values()]
    assert shown["displacement"] == pytest.approx(by_tolerances, rel=0.05)
    # And nearly as without geometric stiffness.
    _, half, size = _by_hand(elastic, q)
    assert shown["in_room"] == pytest.approx(half, rel=0.02)
    assert shown["length"] == pytest.approx(size, rel=0.02)
    assert shown_numbers(cartstiff.analyse(elastic, q), ViewState(q=q.tolist()))["moved"] is None
    bare = cartstiff.analyse(cartstiff.load("ur5"), wrench=body)
    assert shown_numbers(bare, ViewState(q=bare.q.tolist()))["moved"]["half_width"] is None


def test_a_path_without_intervals_says_why(tmp_path, capfd):
    text = (Path(cartstiff.__file__).parents[2] / "robots/cable-robot.yaml").read_text("utf-8")
    found = "identified: {compliances: [{name: leg1, value: 2.0e-5}], covariance: [[1.0e-12]]}"
    (tmp_path / "cables.yaml").write_text(f"{text}{found}\n", "utf-8")
    (tmp_path / "path.csv").write_text("x,y,z,roll,pitch,yaw\n0,0,0.6,0,0,0\n0.05,0,0.6,0,0,0\n")
    arguments = [
        "path",
        tmp_path / "cables.yaml",
        tmp_path / "path.csv",
        "--criterion",
        "translation_held_min",
        "--singular",
        "0.001",
    ]
    for more in ([], ["--json"]):
        with pytest.raises(SystemExit) as exit_:
            main([*map(str, arguments), *more])
        out, err = capfd.readouterr()
        assert exit_.value.code == 0, err
        assert "no intervals here: the file gives rest positions" in out
    shown = json.loads(out)
    assert shown["half_widths"] is None
    # Eight cables have no square Jacobian: how near a singularity is shows in their lines.
    cables = load(tmp_path / "cables.yaml").mechanism
    for q, ratio in zip(shown["q"], shown["ratios"], strict=True):
        lines = cables.at(q).lines.lines / ([cables.length] * 3 + [1, 1, 1])
        values = np.linalg.svd(lines, compute_uv=False)
        assert ratio == pytest.approx(values[-1] / values[0], rel=1e-9)


def test_commands_along_a_path_leave_what_the_springs_leave(known):
    elastic = load(known)
    path = compensate(elastic, np.array(PLACES[:2]), FORCE)
    # After compensation the tool is where it belongs, as well as the springs are known: other
    # springs under the same commands, by differences of equilibria.
    for q, deviation, rest in zip(PLACES, path.deviation, path.commands, strict=False):
        springs = elastic.springs.replaced(elastic.springs.stiffness, rest)
        commanded = dataclasses.replace(elastic, springs=springs)
        variance = 0.0
        for more, less, per in neighbours(commanded):
            ends = [
                cartstiff.equilibrium(m, DeadWrench(FORCE), q0=q, limits=False).pose
                for m in (more, less)
            ]
            variance += (per * displacement_between(ends[1], ends[0])) ** 2
        assert deviation == pytest.approx(np.sqrt(variance), rel=1e-4)
    assert "after_sd_" in path.as_csv().splitlines()[0]
    assert np.array(path.as_dict()["error_after_sd"]).shape == (2, 6)


def test_another_unit_of_length_changes_no_interval(known):
    elastic = load(known)
    small = in_units(elastic, "mm")
    q = PLACES[0]
    here = equilibrium(elastic, wrench=FORCE, load_axes="world", q0=q)
    there = equilibrium(small, wrench=FORCE, load_axes="world", q0=q)
    sizes = np.array([1, 1, 1, 1e3, 1e3, 1e3])
    np.testing.assert_allclose(
        there.displacement_deviation, here.displacement_deviation * sizes, rtol=1e-6
    )
    assert np.all(here.displacement_deviation[3:] > 0)
    data = small.identified.as_dict()["compliances"]
    # rad/(N mm)
    assert data["j2"] == pytest.approx(1e-3 * elastic.identified.as_dict()["compliances"]["j2"])


def test_ties_keep_their_lower_end_in_other_units(tmp_path):
    """Springs found in mm are written in m, and read again in mm: a tie has a name of its own."""
    elastic = load(arm("elbow", tmp_path))
    rows = candidates(elastic, {"d": 1.0}, count=30, seed=1, force=100.0)
    result = identify(elastic, simulated(elastic, rows, {"d": 3e-5}, seed=1), ties=[("j4", "j5")])
    found = with_result(result)
    known = dataclasses.replace(found.identified, at_least={"j4 = j5": 2000.0, "j1": 10.0})
    found = dataclasses.replace(found, identified=known)
    there = in_units(found, "mm")
    assert there.identified.at_least == pytest.approx({"j4 = j5": 2e6, "j1": 1e4})
    assert in_units(there, "m").identified.at_least == pytest.approx(known.at_least)


def test_a_lower_end_is_of_a_spring(tmp_path):
    path = arm(
        "elbow",
        tmp_path,
        extra="identified: {compliances: [], covariance: [], at_least: {j9: 3.0}}\n",
    )
    with pytest.raises(cartstiff.InputError, match=r"identified.at_least: .*'j9'"):
        load(path)
