"""Equilibria and compensation carry what measurements left open of the springs."""

import dataclasses

import numpy as np
import pytest
from tests.doors import candidates, displacement_between
from tests.identify.campaigns import SPRINGS, arm, load, random_campaign, simulated, table_of
from tests.identify.neighbours import neighbours
from tests.support.commands import run

import cartstiff
from cartstiff import DeadWrench, compensate, equilibrium
from cartstiff.extend import in_units
from cartstiff.identify import identify

FORCE = np.array([0, 0, 0, 30.0, -20.0, -60.0])
PLACES = [[0.3, 0.5, 0.9, 0.2, 0.7, -0.3], [-0.4, 0.8, 0.5, -0.6, 0.9, 0.1]]


@pytest.fixture(scope="module")
def known(tmp_path_factory):
    """A mechanism file with measured springs, of which tool forces say much the same."""
    folder = tmp_path_factory.mktemp("known")
    path = arm("elbow", folder)
    q, W, d = random_campaign(load(path), SPRINGS["elbow"], 9, 4, sd=8e-5)
    table = table_of(folder / "m.csv", q, W, d)
    run("identify", path, table, "-o", folder / "known.yaml")
    return folder / "known.yaml"


def test_commands_along_a_path_leave_what_the_springs_leave(known):
    elastic = load(known)
    path = compensate(elastic, np.array(PLACES[:2]), FORCE, load_axes="world")
    # After compensation the tool is where it belongs, as well as the springs are known: other
    # springs under the same commands, by differences of equilibria.
    for q, deviation, rest in zip(PLACES, path.deviation, path.commands, strict=False):
        springs = elastic.springs.replaced(elastic.springs.stiffness, rest)
        commanded = dataclasses.replace(elastic, springs=springs)
        variance = 0.0
        for more, less, per in neighbours(commanded):
            ends = [
                cartstiff.equilibrium(m, q, DeadWrench(FORCE), limits=False).pose
                for m in (more, less)
            ]
            variance += (per * displacement_between(ends[1], ends[0])) ** 2
        assert deviation == pytest.approx(np.sqrt(variance), rel=1e-4)
    assert "after_sd_" in path.to_csv().splitlines()[0]
    assert np.array(path.to_dict()["error_after_sd"]).shape == (2, 6)


def test_another_unit_of_length_changes_no_interval(known):
    elastic = load(known)
    small = in_units(elastic, "mm")
    q = PLACES[0]
    here = equilibrium(elastic, wrench=FORCE, load_axes="world", q=q)
    there = equilibrium(small, wrench=FORCE, load_axes="world", q=q)
    sizes = np.array([1, 1, 1, 1e3, 1e3, 1e3])
    np.testing.assert_allclose(
        there.displacement_deviation, here.displacement_deviation * sizes, rtol=1e-6
    )
    assert np.all(here.displacement_deviation[3:] > 0)
    data = small.identified.to_dict()["compliances"]
    # rad/(N mm)
    assert data["j2"] == pytest.approx(1e-3 * elastic.identified.to_dict()["compliances"]["j2"])


def test_ties_keep_their_lower_end_in_other_units(tmp_path):
    """Springs found in mm are written in m, and read again in mm: a tie has a name of its own."""
    elastic = load(arm("elbow", tmp_path))
    rows = candidates(elastic, {"d": 1.0}, count=30, seed=1, force=100.0)
    result = identify(elastic, simulated(elastic, rows, {"d": 3e-5}, seed=1), ties=[("j4", "j5")])
    found = result.mechanism
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


def test_springs_that_were_measured_are_not_called_illustrative(known):
    """The source of the file's first springs stays in it; those that are not measured still are."""
    text = "source: the springs are illustrative\n" + known.read_text("utf-8")
    path = known.with_name("named.yaml")
    path.write_text(text, "utf-8")
    elastic = load(path)
    assert not elastic.is_illustrative
    found = elastic.identified
    some = dataclasses.replace(
        found, patterns=found.patterns[1:], values=found.values[1:], covariance=np.eye(5)
    )
    assert dataclasses.replace(elastic, identified=some).is_illustrative
    assert dataclasses.replace(elastic, identified=None).is_illustrative
