"""Assembly modes: how many there are, that they are poses, what is said without any."""

import csv
import json
import re

import jsonschema
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.docs.blocks import ROOT
from tests.support.commands import answer, outcome

import cartstiff
from cartstiff import ElasticMechanism, InputError, LineSprings
from cartstiff.extend import Platform, json_schema
from cartstiff.geometry import se3

DIETMAIER = ROOT / "cases" / "dietmaier-forty-postures" / "mechanism.yaml"
LENGTHS = [1, 0.645275, 1.086284, 1.503439, 1.281933, 0.771071]
FICHTER = ROOT / "cases" / "fichter-singular-pose" / "mechanism.yaml"
MA_ANGELES = ROOT / "cases" / "ma-angeles-architecture" / "mechanism.yaml"


def _elastic(platform, q):
    m = len(platform.points)
    springs = LineSprings(
        anchors=platform.anchors,
        points=platform.points,
        stiffness=np.ones(m),
        rest_length=np.full(m, np.nan),
    )
    return ElasticMechanism("test", platform, q, springs)


def _random_platform(seed):
    """Some general, some with a flat base, some with both flat; and a pose."""
    rng = np.random.default_rng(seed)
    base, points = rng.normal(size=(2, 6, 3))
    base[:, 2] *= seed % 3 == 0
    points[:, 2] *= seed % 3 < 2
    return Platform(base, 0.7 * points + [0.1, 5.0, 0.0]), rng.normal(size=6)


def test_dietmaiers_platform_has_its_forty_real_postures():
    elastic = cartstiff.load(DIETMAIER)
    found = cartstiff.assemble(elastic, LENGTHS)
    assert len(found) == found.search.real == 40
    assert found.is_complete
    for mode in found:
        lengths = np.linalg.norm(
            elastic.mechanism.points @ mode.pose[:3, :3].T
            + mode.pose[:3, 3]
            - elastic.mechanism.anchors,
            axis=1,
        )
        assert np.allclose(lengths, LENGTHS, rtol=0, atol=1e-14)
        assert np.allclose(se3.inverse(mode.pose) @ mode.pose, np.eye(4), atol=1e-14)
        assert mode.stable
    apart = np.abs(found.poses[:, None] - found.poses[None]).max(axis=(2, 3)) + np.eye(40)
    assert apart.min() > 1e-3


def test_a_flat_platform_is_assembled_below_its_base_as_above():
    rng = np.random.default_rng(3)
    base, points = rng.normal(size=(2, 6, 3)) * [1.0, 1.0, 0.0]
    platform = Platform(base, points)
    found = cartstiff.assemble(_elastic(platform, np.array([0.1, 0.2, 1.0, 0.1, 0.2, 0.3])))
    heights = np.sort(found.poses[:, 2, 3])
    assert len(found) >= 2
    assert np.allclose(heights, -heights[::-1], atol=1e-9)
    assert np.isclose(sum(mode.determinant for mode in found), 0.0, atol=1e-9)


def test_solutions_that_meet_are_named():
    found = cartstiff.assemble(cartstiff.load(FICHTER))
    assert [mode.multiplicity for mode in found] == [2, 2]
    assert found[0].stable is None
    assert found.search.multiple == 4
    assert found.search.is_complete
    assert "multiple-solutions" in {note.code for note in found.notes}


def test_a_platform_that_moves_with_its_legs_held_is_named():
    elastic = cartstiff.load("cubic")
    found = cartstiff.assemble(elastic)
    note = next(note for note in found.notes if note.code == "self-motion")
    pose = np.array(note.values["pose"])
    lengths = elastic.mechanism.leg_lengths(elastic.mechanism.coordinates_of(pose))
    assert np.allclose(lengths, 0.5, atol=1e-9)
    lines = elastic.mechanism.at(elastic.mechanism.coordinates_of(pose)).lines.lines
    assert np.linalg.svd(lines, compute_uv=False)[-1] < 1e-6


TRIANGLE = np.array([[np.cos(a), np.sin(a), 0.0] for a in np.deg2rad([90, 210, 330])])
HEXAGON = np.vstack([TRIANGLE, -TRIANGLE])
SIDES = (TRIANGLE + np.roll(TRIANGLE, -1, axis=0)) / 2
ONE_POINT = np.array([[0.3, 0.1, 0.0]] * 4 + [[1.0, 0, 0], [0, 1.0, 0.2]])


@pytest.mark.parametrize(
    ("base", "points", "name"),
    [
        (
            np.vstack([TRIANGLE, SIDES]),
            0.6 * np.vstack([SIDES, np.roll(TRIANGLE, -1, axis=0)]),
            "Griffis and Duffy",
        ),
        (HEXAGON, 0.6 * HEXAGON, "Ma and Angeles"),
        (np.random.default_rng(1).normal(size=(6, 3)), ONE_POINT, "four legs meet"),
        (
            np.random.default_rng(1).normal(size=(6, 3)),
            np.outer(np.arange(6.0), [1.0, 2.0, 0.5]),
            "on a line",
        ),
    ],
)
def test_singular_architectures_are_named(base, points, name):
    platform = Platform(base, points)
    found = cartstiff.assemble(_elastic(platform, np.array([0.1, 0.2, 1.0, 0.1, 0.2, 0.3])))
    assert len(found) == 0
    assert found.search is None
    assert found.notes[-1].code == "architecture-singularity"
    assert name in found.notes[-1].message


@given(st.integers(0, 10_000))
@settings(max_examples=6)
def test_det_times_leg_lengths_is_a_cubic_of_the_position(seed):
    """After Mayer St-Onge and Gosselin: at one orientation, 20 coefficients are all."""
    rng = np.random.default_rng(seed)
    platform, _ = _random_platform(seed)
    turn = rng.normal(size=3)

    def times_lengths(p):
        lines = platform.at(np.append(p, turn)).lines
        return float(np.linalg.det(lines.lines) * np.prod(lines.lengths))

    def monomials(p):
        x, y, z = p
        return [
            x**i * y**j * z**k for i in range(4) for j in range(4 - i) for k in range(4 - i - j)
        ]

    centre = -(platform.points @ platform.at(np.append(np.zeros(3), turn)).pose[:3, :3].T).mean(0)
    places = rng.normal(size=(60, 3))
    values = np.array([times_lengths(centre + p) for p in places])
    rows = np.array([monomials(p) for p in places])
    known, others = slice(0, 40), slice(40, 60)
    coefficients = np.linalg.lstsq(rows[known], values[known], rcond=None)[0]
    missed = rows[others] @ coefficients - values[others]
    assert np.abs(missed).max() < 1e-12 * np.abs(rows).max() * np.abs(coefficients).sum()


def test_assembly_modes_of_a_closed_chain():
    five_bar = cartstiff.load("five-bar")
    found = cartstiff.assemble(five_bar, starts=6)
    assert len(found) == 2
    assert not found.is_complete
    assert found.search.starts == 7
    tips = found.poses[:, :2, 3]
    motors = [five_bar.names.index(name) for name in found.given]
    assert np.allclose(found.q[:, motors], five_bar.q[motors], atol=1e-12)
    assert np.abs(tips[0] - tips[1]).max() > 0.3
    assert all(mode.stable for mode in found)


def test_lengths_that_are_too_short_and_one_mode_alone():
    hexapod = cartstiff.load("hexapod")
    assert len(cartstiff.assemble(hexapod, np.full(6, 0.05))) == 0
    one = cartstiff.assemble(hexapod, every=False)
    assert (one.found, len(one)) == (8, 1)  # as many as its 8 real paths
    assert len(one) == 1
    assert np.allclose(one[0].q, hexapod.q, atol=1e-12)


@pytest.mark.parametrize(
    ("name", "keywords", "match"),
    [
        ("cable-robot", {}, "cables"),
        ("hexapod", {"lengths": [1.0] * 5}, "leg lengths"),
        ("hexapod", {"lengths": [1.0] * 5 + [0.0]}, "positive"),
        ("grasp", {}, "actuated"),
        ("five-bar", {"lengths": [1.0] * 6}, "platforms"),
        ("five-bar", {"starts": -1}, "starts"),
        ("hexapod", {"starts": 5}, "neither starts nor seed"),
        ("hexapod", {"seed": 0}, "neither starts nor seed"),
    ],
)
def test_what_has_no_assembly_modes_is_refused(name, keywords, match):
    with pytest.raises(InputError, match=match):
        cartstiff.assemble(cartstiff.load(name), **keywords)


def test_the_command(tmp_path):
    table = tmp_path / "modes.csv"
    code, out, _ = outcome(f"assemble stewart-simscape --all --json -o {table}")
    assert code == 0
    data = json.loads(out)
    jsonschema.validate(data, json_schema("assemble"))
    assert data["search"]["real"] == len(data["modes"]) == 8
    assert np.isclose(data["modes"][0]["frequencies"][0], 780.60178773)
    rows = list(csv.DictReader(table.read_text("utf-8").splitlines()))
    assert [float(row["residual [m]"]) < 1e-15 for row in rows] == [True] * 8
    code, out, _ = outcome("assemble hexapod")
    assert (code, "40 paths: 8 real, 32 complex" in out) == (0, True)
    code, out, err = outcome(f"assemble {MA_ANGELES} --all --strict")
    assert (code, "similar" in err, "Ma and Angeles" in out) == (3, True, True)
    code, _, err = outcome("assemble five-bar --lengths 1,1,1,1,1,1")
    assert (code, "--lengths" in err) == (2, True)


def test_one_listed_mode_is_not_called_the_only_one():
    """The paper's platform has four poses with these lengths (random Newton starts find four)."""
    code, text, _ = outcome("assemble stewart-gough")
    assert code == 0
    assert "Assembly modes: 4; searched:" in text
    assert "The nearest one is listed (--all: every one)" in text
    assert answer("assemble stewart-gough")["found"] == 4
    assert "listed" not in outcome("assemble stewart-gough --all")[1]


@pytest.mark.parametrize("name", ["hexapod", "five-bar"])
def test_degrees_stand_under_heads_that_say_degrees(name, tmp_path):
    file = tmp_path / "modes.csv"
    code, text, _ = outcome(f"assemble {name} --all -o {file}")
    assert code == 0
    rows = list(csv.DictReader(file.read_text("utf-8").splitlines()))
    angles = [key for key in rows[0] if key.endswith(" [rad]")]
    assert len(angles) >= 3
    assert max(abs(float(row[key])) for row in rows for key in angles) < 7.0
    assert "roll [deg]" in text


def test_reasons_in_modes_are_plain_in_json(tmp_path):
    # With rods of hardly any length the state of a mode is deficient, and its numbers are told.
    text = (ROOT / "robots" / "orthoglide.yaml").read_text(encoding="utf-8")
    path = tmp_path / "m.yaml"
    path.write_text(re.sub(r"rod: \S+", "rod: 3.1e-7", text), encoding="utf-8")
    modes = cartstiff.assemble(cartstiff.load(path), starts=5)
    found = json.loads(json.dumps(modes.to_dict(), allow_nan=False))
    assert found["modes"][0]["notes"][0]["values"]["rank"] == 3
