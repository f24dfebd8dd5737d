"""Loads and displacements along other axes than those declared are noticed, and never else."""

from __future__ import annotations

import numpy as np
import pytest
from tests.identify.campaigns import SPRINGS, arm, load, measurements, random_campaign

from cartstiff.errors import InputError
from cartstiff.identify.identification import identify

COLUMNS = ("drx", "dry", "drz", "dx", "dy", "dz")


def measured(q, W, d, names=COLUMNS[3:], axes="base"):
    values = {name: d[:, COLUMNS.index(name)] for name in names}
    return measurements(q, W, values, axes=axes, sd=np.nan)


def doubts(elastic, table):
    with np.errstate(all="ignore"):
        return [n for n in identify(elastic, table).notes if n.code == "other-axes"]


def turned(elastic, q, vectors):
    """Two vectors a row, from the base's axes into the body's."""
    R = np.array([elastic.mechanism.at(one).pose[:3, :3] for one in q])
    return np.einsum("nji,nkj->nki", R, vectors.reshape(-1, 2, 3)).reshape(-1, 6)


@pytest.fixture(scope="module")
def campaign(tmp_path_factory):
    elastic = load(arm("elbow", tmp_path_factory.mktemp("axes")))
    return elastic, *random_campaign(elastic, SPRINGS["elbow"], 16, 1, moment=5.0)


def test_loads_along_the_body(campaign):
    elastic, q, W, d = campaign
    [note] = doubts(elastic, measured(q, turned(elastic, q, W), d))
    assert "with loads along the body's axes (--axes body): residuals of" in note.message
    # The right axes leave the noise of 20 um.
    assert note.values["other_rms"] == pytest.approx(2e-5, rel=0.3)
    assert note.values["residual_rms"] > 3 * note.values["other_rms"]
    assert not doubts(elastic, measured(q, turned(elastic, q, W), d, axes="body"))


def test_displacements_along_the_body(campaign):
    elastic, q, W, d = campaign
    [note] = doubts(elastic, measured(q, W, turned(elastic, q, d), COLUMNS))
    assert "with displacements along the body's axes, not the base's" in note.message
    [note] = doubts(elastic, measured(q, turned(elastic, q, W), turned(elastic, q, d)))
    assert "with loads along the body's axes (--axes body) and displacements along the" in (
        note.message
    )


@pytest.mark.parametrize(
    ("names", "change", "words"),
    [
        (COLUMNS[3:], [0, 1, 2, 3, 5, 4], "with dy as dz, dz as dy:"),
        (("dx", "dz"), [0, 1, 2, 4, 3, 5], "with dx as dy:"),
    ],
)
def test_axes_exchanged(campaign, names, change, words):
    elastic, q, W, d = campaign
    [note] = doubts(elastic, measured(q, W, d[:, change], names))
    assert words in note.message


def test_unloaded_minus_loaded(campaign):
    elastic, q, W, d = campaign
    [note] = doubts(elastic, measured(q, W, -d))
    assert "with dx as -dx, dy as -dy, dz as -dz:" in note.message


def test_no_false_alarm(tmp_path):
    """Campaigns, from little noise to nothing but noise, few rows and many."""
    arms = {name: load(arm(name, tmp_path)) for name in ("elbow", "scara")}
    rng = np.random.default_rng(5)
    made = {
        name: random_campaign(elastic, SPRINGS[name], 40, 3, sd=0.0)
        for name, elastic in arms.items()
    }
    for n in range(24):
        name = ("elbow", "scara")[n % 2]
        rows = rng.choice(40, rng.integers(8, 30), replace=False)
        q, W, d = (part[rows] for part in made[name])
        noise = rng.normal(size=d.shape) * 10.0 ** rng.uniform(-6, -2)
        names = COLUMNS if n % 3 else COLUMNS[3:]
        table = measured(q, W, d + noise, names)
        assert not doubts(arms[name], table), n


def test_repeats_far_further_apart_than_others(campaign):
    """Without deviations the other repeats say what is far; outliers of 20 sigma are none."""
    elastic, q, W, d = campaign
    rng = np.random.default_rng(2)
    twice = np.repeat(d, 2, axis=0) + rng.normal(size=(32, 6)) * 1e-6
    again = [np.repeat(part, 2, axis=0) for part in (q, W)]
    twice[9, 4] += 4e-5
    with np.errstate(all="ignore"):
        identify(elastic, measured(*again, twice))
    twice[9, 4] += 4e-4
    with pytest.raises(InputError, match="rows 9 and 10 contradict each other in 'dy'"):
        identify(elastic, measured(*again, twice))
