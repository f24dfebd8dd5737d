"""A public data set with measured loads: estimates and intervals against the textbook's formula."""

import runpy
from pathlib import Path

import numpy as np
import pytest
import scipy.linalg
import scipy.stats
from cases.case import read_case
from tests.support import absolute_error

import cartstiff
from cartstiff.identify import identify, read_measurements

CASE = Path(__file__).parents[2] / "cases" / "fanuc-measured-compliance"
# Two ways to the same least squares, of condition 90.
ROUNDING = 1e-10


@pytest.fixture(scope="module")
def robot():
    return cartstiff.load("fanuc-r2000ic")


@pytest.mark.parametrize("left_out", [[], [1, 2, 11, 12, 13]])
def test_estimates_and_intervals_are_scipys(robot, left_out):
    inputs = read_case(CASE).inputs
    regressor = runpy.run_path(str(CASE / "derivation.py"))["_regressor"]
    table = np.loadtxt(CASE / "measurements.csv", delimiter=",", skiprows=1)
    kept = ~np.isin(np.arange(1, len(table) + 1), left_out)
    A = np.concatenate([regressor(inputs, row[:6], row[6:9]) for row in table[kept]])
    y = table[kept, 9:].ravel()
    c, squares, _, _ = scipy.linalg.lstsq(A, y)
    variance = squares / (len(y) - 6) * np.diag(np.linalg.inv(A.T @ A))
    half = scipy.stats.t.ppf(0.975, len(y) - 6) * np.sqrt(variance)

    rows = read_measurements(CASE / "measurements.csv", robot).chosen(kept)
    found = identify(robot, rows, fit="plain").estimates
    assert absolute_error([e.compliance for e in found] / c, 1) <= ROUNDING
    assert absolute_error([e.deviation for e in found] / np.sqrt(variance), 1) <= ROUNDING
    ends = np.array([e.interval for e in found])
    assert absolute_error(ends[:, 1] / (c + half), 1) <= ROUNDING
    # What reaches below zero is no compliance: the last joint may be rigid.
    assert absolute_error(ends[:, 0], np.maximum(c - half, 0)) <= ROUNDING * c.max()
    assert found[5].verdict == ("at-least" if left_out else "determined")


def test_the_bundled_file_holds_what_the_data_say(robot):
    inputs = read_case(CASE).inputs
    rows = read_measurements(CASE / "measurements.csv", robot)
    kept = ~np.isin(rows.rows, inputs["rejected_rows"])
    found = identify(robot, rows.chosen(kept), fit="plain")
    known = robot.identified
    assert absolute_error(robot.springs.stiffness * known.values, 1) <= ROUNDING
    assert absolute_error([e.compliance for e in found.estimates] / known.values, 1) <= ROUNDING
    size = np.sqrt(np.outer(*2 * [np.diag(known.covariance)]))
    assert np.abs((found.covariance - known.covariance) / size).max() <= ROUNDING
    assert known.rows == 38
    assert set(known.at_least) == {"j6"}
