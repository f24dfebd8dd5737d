"""Measurements as columns in memory: mappings and data frames, read as the table in a file is."""

import csv

import numpy as np
import pytest
from tests.identify.campaigns import SPRINGS, arm, load, random_campaign, table_of

from cartstiff import InputError
from cartstiff.identify import identify, read_measurements


class Frame:
    """What of a data frame is used: names of the columns, and rows of objects."""

    def __init__(self, columns):
        self.columns = [*columns]
        self._rows = np.array([*zip(*columns.values(), strict=True)], object)

    def to_numpy(self):
        return self._rows


@pytest.fixture(scope="module")
def campaign(tmp_path_factory):
    place = tmp_path_factory.mktemp("columns")
    elastic = load(arm("elbow", place))
    q, W, d = random_campaign(elastic, SPRINGS["elbow"], 8, 1)
    path = place / "good.csv"
    table_of(path, q, W, d)
    head, *rows = csv.reader(path.read_text().splitlines())
    columns = dict(zip(head, np.array(rows, float).T, strict=True))
    return elastic, path, columns


def test_columns_in_memory_are_the_table_in_a_file(campaign):
    elastic, path, columns = campaign
    of_file = identify(elastic, read_measurements(path, elastic))
    lists = {name: values.tolist() for name, values in columns.items()}
    named = np.genfromtxt(path, delimiter=",", names=True, deletechars="")
    for table in (path, str(path), columns, lists, Frame(columns), named):
        found = identify(elastic, table)
        stiffness = [e.stiffness for e in found.estimates]
        np.testing.assert_allclose(stiffness, [e.stiffness for e in of_file.estimates], rtol=1e-12)


def test_a_data_frame_of_pandas(campaign):
    pandas = pytest.importorskip("pandas")
    elastic, path, columns = campaign
    found = identify(elastic, pandas.DataFrame(columns))
    expected = identify(elastic, path).estimates
    assert [e.stiffness for e in found.estimates] == [e.stiffness for e in expected]


def test_units_in_heads_and_empty_cells(campaign):
    elastic, path, columns = campaign
    shown = {("dx [mm]" if n.startswith("dx") else n): v for n, v in columns.items()}
    shown["dx [mm]"] = 1e3 * shown["dx [mm]"]
    shown["dx [mm]"][0] = np.nan
    got = read_measurements(Frame(shown), elastic, open_cells=True)
    plain = read_measurements(path, elastic)
    np.testing.assert_allclose(got.values["dx"][1:], plain.values["dx"][1:], rtol=1e-12)
    assert np.isnan(got.values["dx"][0])


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda columns: [*columns.values()], "no named columns; expected Measurements"),
        (lambda columns: np.array([*columns.values()]), "no named columns"),
        (lambda columns: {**columns, "fx": [1.0]}, "columns do not fit.*of one length"),
        (lambda columns: {**columns, 7: columns["fx"]}, "a column has no name"),
        (lambda columns: {name: [] for name in columns}, "no measurements.*at least one row"),
        (lambda columns: {**columns, "fq": columns["fx"]}, "column.*'fq'"),
        (lambda columns: {**columns, "fx": ["?"] * 8}, "row 1: column 'fx': not a finite"),
    ],
)
def test_what_is_no_table_is_refused(campaign, change, words):
    elastic, _, columns = campaign
    with pytest.raises(InputError, match=words):
        identify(elastic, change(columns))
