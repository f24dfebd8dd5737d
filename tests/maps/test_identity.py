"""A map goes on only with what it was begun with: files, options, versions."""

import json
import pickle
import runpy
import shutil
from collections import Counter
from dataclasses import fields
from pathlib import Path
from uuid import uuid4

import numpy as np
import pytest
from tests.support.maps import BegunMap, older_version
from tests.support.robots import FOLDER

import cartstiff
from cartstiff import InputError

TOOL = Path(__file__).parents[2] / "tools" / "fuzz_edits.py"
#: A twentieth of what the tool does by itself.
EDITS = 20


def prepared(elastic, folder, **options):
    grid = cartstiff.maps.Grid({elastic.names[0]: (0.1, 0.4, 4)}, elastic.names, elastic.q)
    return BegunMap(elastic, grid, ["condition"], folder / "m.zarr", **options)


def test_one_number_edits_are_never_mixed():
    outcome = runpy.run_path(str(TOOL))["outcome"]
    found = [outcome(index, seed=7) for index in range(EDITS)]
    assert [what for state, what in found if state == "MIXED"] == []
    assert Counter(state for state, _ in found)["refused"] > EDITS // 2


def test_masses_of_an_included_file_are_seen(tmp_path):
    """The case that statics at two postures did not see: frequencies changed, stiffness did not."""
    for name in ("five-bar.yaml", "five-bar.urdf"):
        shutil.copy(FOLDER / name, tmp_path)
    model = tmp_path / "five-bar.urdf"
    prepared(cartstiff.load(tmp_path / "five-bar.yaml"), tmp_path)
    text = model.read_text()
    assert "<mass value=" in text
    model.write_text(text.replace('<mass value="', '<mass value="9', 1))
    with pytest.raises(InputError, match=r"another mechanism: five-bar.urdf was changed; expected"):
        prepared(cartstiff.load(tmp_path / "five-bar.yaml"), tmp_path)
    model.write_text(text)
    prepared(cartstiff.load(tmp_path / "five-bar.yaml"), tmp_path)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda e: e.with_springs(stiffness=2e4), "with other springs"),
        (lambda e: e.with_payload(0.001), "with other geometry"),
        (lambda e: e.with_gravity([0, 0, -9.0]), "with other gravity"),
        (
            lambda e: e.with_potential(cartstiff.DeadForce([0, 0, 1.0], [0, 0, 0])),
            "with other potentials",
        ),
    ],
)
def test_changes_in_python_are_seen(tmp_path, change, words):
    elastic = cartstiff.load("ur5")
    prepared(elastic, tmp_path, length=0.3, connection="B")
    with pytest.raises(InputError, match=words):
        prepared(change(elastic), tmp_path, length=0.3, connection="B")


def test_numbers_of_another_processor_are_the_same_and_typed_ones_are_not(tmp_path):
    """Other rounding moves the last digits; nine digits are more than people write."""
    elastic = cartstiff.load("ur5")
    stiffness = np.array(elastic.springs.stiffness)
    prepared(elastic, tmp_path)
    prepared(elastic.with_springs(stiffness=stiffness * (1.0 + 1e-12)), tmp_path)
    with pytest.raises(InputError, match="with other springs"):
        prepared(elastic.with_springs(stiffness=stiffness * (1.0 + 1e-9)), tmp_path)


def test_another_version_is_refused(tmp_path, monkeypatch):
    elastic = cartstiff.load("stewart-gough")
    prepared(elastic, tmp_path)
    older_version(monkeypatch)
    with pytest.raises(InputError, match="map of another version of cartstiff"):
        prepared(elastic, tmp_path)


def test_a_worker_with_another_pinocchio_is_named(tmp_path):
    begun = prepared(cartstiff.load("stewart-gough"), tmp_path)
    with pytest.raises(InputError, match=r"another version of pin; expected 3\.0\.0"):
        begun.in_worker(versions=(("pin", "3.0.0"),))


def identity_of(elastic):
    """What a map holds of the mechanism that it is of."""
    grid = cartstiff.maps.Trajectory(elastic.q[None])
    begun = BegunMap(elastic, grid, ["condition"], f"memory://{uuid4()}/m.zarr", length=1.0)
    return json.loads(begun.file.attributes["description"])["mechanism"]


def test_every_field_with_numbers_is_compared():
    words = {"name", "notes", "source", "files", "given", "beyond"}
    known = identity_of(cartstiff.load("stewart-gough"))
    assert {f.name for f in fields(cartstiff.ElasticMechanism)} - words == set(known)


@pytest.mark.parametrize("name", ["ur5", "delta", "6-pus", "flexure-hexapod", "stewart-gough"])
def test_use_does_not_change_an_identity(name):
    elastic = cartstiff.load(name)
    before = identity_of(elastic)
    cartstiff.analyse(elastic)
    cartstiff.analyse_many(elastic, np.repeat(elastic.q[None], 3, axis=0))
    assert identity_of(elastic) == before
    assert identity_of(pickle.loads(pickle.dumps(elastic))) == before
    assert identity_of(cartstiff.load(name)) == before


def test_a_file_that_changes_while_a_study_runs_ends_it(tmp_path):
    for name in ("five-bar.yaml", "five-bar.urdf"):
        shutil.copy(FOLDER / name, tmp_path)
    file, model = tmp_path / "five-bar.yaml", tmp_path / "five-bar.urdf"
    text = file.read_text()
    assert "stiffness: 800" in text
    file.write_text(
        text.replace("stiffness: 800", 'stiffness: "=k"', 1) + "\nparameters: {k: 800}\n"
    )
    study = {
        "mechanism": str(file),
        "variables": {"k": {"values": [700, 800, 900]}},
        "objectives": {"a": {"quantity": "compliance_translation_free_max", "goal": "smallest"}},
    }

    def progress(done, _):
        if done == 1:
            model.write_text(model.read_text().replace('<mass value="', '<mass value="9', 1))

    with pytest.raises(InputError, match="was changed while the study ran"):
        cartstiff.design(study, progress=progress)
