"""Crafted maps with right checksums: every reader answers or refuses, in one line."""

import json
import random
import shutil

import pytest
from tests.support.maps import small_pieces, summary_of_file
from tests.support.pages import clouds_in
from tools.fuzz_maps import crafted_map, resealed, whole_map

import cartstiff
from cartstiff import InputError
from cartstiff.maps import Axis, Grid, RandomPostures, compute_map, draw_map, open_map


@pytest.mark.parametrize("seed", range(12))
def test_mutants(seed, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert crafted_map(random.Random(seed)) in ("answered", "refused")


@pytest.mark.parametrize(
    ("shape", "chunk", "words"),
    [
        (10**9, 4, "too many parts"),
        (10**9, 10**9, "too many postures in a part"),
        (0, 0, "shape of state"),
        (12.0, 4, "shape of state"),
        (12, 13, "shape of a part"),
    ],
)
def test_shapes_that_no_map_has(tmp_path, monkeypatch, shape, chunk, words):
    """A folder of 21 kB that claimed a thousand million postures filled 4 GB."""
    monkeypatch.chdir(tmp_path)
    file = tmp_path / "m.zarr"
    shutil.copytree(whole_map()[0], file)
    root = json.loads((file / "zarr.json").read_text())
    for node in root["consolidated_metadata"]["metadata"].values():
        if node.get("dimension_names", [""])[0] == "posture":
            node["shape"][0] = shape
            node["chunk_grid"]["configuration"]["chunk_shape"][0] = chunk
    (file / "zarr.json").write_text(json.dumps(root))
    resealed(file)
    with pytest.raises(InputError, match=f"description of the map cannot be used; .*{words}"):
        open_map(file)


def test_a_map_that_claims_many_postures_is_not_read_whole(tmp_path, monkeypatch):
    """5e10 postures in 1e5 parts are within the limits of a file; no reader holds them at once."""
    monkeypatch.chdir(tmp_path)
    file = tmp_path / "m.zarr"
    shutil.copytree(whole_map()[0], file)
    root = json.loads((file / "zarr.json").read_text())
    nodes = root["consolidated_metadata"]["metadata"]
    for node in nodes.values():
        if node.get("dimension_names", [""])[0] == "posture":
            node["shape"][0] = 5 * 10**10
            node["chunk_grid"]["configuration"]["chunk_shape"][0] = 5 * 10**5
    nodes["parts/marks"]["shape"][0] = 10**5
    (file / "zarr.json").write_text(json.dumps(root))
    resealed(file)
    assert open_map(file).attrs["chunks"] == 10**5
    with pytest.raises(InputError, match="too large to be shown"):
        clouds_in(file, cartstiff.load("ur5"))
    with pytest.raises(InputError, match="too large for a picture of the distribution"):
        draw_map(open_map(file), "condition")
    assert summary_of_file(file)["states"]["not-computed"] > 4 * 10**10


@pytest.mark.parametrize(
    ("key", "inner"),
    [("condition/c/0", 9), ("condition/c/1", 2), ("shoulder_pan_joint/c/0", 9)],
)
def test_an_object_that_expands_to_gigabytes_is_refused(tmp_path, monkeypatch, key, inner):
    """The size stands in its header, and a reader allocates it before it looks further."""
    small_pieces(monkeypatch, inner)  # postures of a piece: two pieces in a part
    elastic = cartstiff.load("ur5")
    name = elastic.names[0]
    grid = Grid({name: Axis(-0.2, 0.2, 12)}, elastic.names, elastic.q)
    file = tmp_path / "m.zarr"
    compute_map(elastic, grid, ["condition"], file, chunk=4)
    data = bytearray((file / key).read_bytes())
    start = len(data) - 36  # of two places, lengths and a checksum
    at = int.from_bytes(data[start + 16 : start + 24], "little") if inner == 2 else 0
    data[at + 4 : at + 8] = (2**31 - 1).to_bytes(4, "little")
    (file / key).write_bytes(data)
    resealed(file)
    with pytest.raises(InputError, match="is larger than its array; expected at most"):
        open_map(file).load()


def test_a_whole_number_too_large_for_a_float_is_refused(tmp_path):
    file = tmp_path / "m.zarr"
    shutil.copytree(whole_map()[0], file)
    root = json.loads((file / "zarr.json").read_text())
    about = json.loads(root["attributes"]["description"])
    about["sampling"]["lower"] = [10**400] * 6
    root["attributes"]["description"] = json.dumps(about)
    (file / "zarr.json").write_text(json.dumps(root))
    resealed(file)
    with pytest.raises(InputError, match=r"description of the map cannot be used; .*a number"):
        open_map(file)


@pytest.mark.parametrize("name", ["0x10", "springs"])
def test_a_map_of_a_mechanism_with_other_parts_is_not_continued(tmp_path, monkeypatch, name):
    """The identity may name parts of a mechanism that none has."""
    monkeypatch.chdir(tmp_path)
    file = tmp_path / "m.zarr"
    shutil.copytree(whole_map()[0], file)
    root = json.loads((file / "zarr.json").read_text())
    about = json.loads(root["attributes"]["description"])
    about["mechanism"][name] = "other"
    root["attributes"]["description"] = json.dumps(about)
    (file / "zarr.json").write_text(json.dumps(root))
    resealed(file)
    arm = cartstiff.load("ur5")
    places = RandomPostures(12, 5, arm.q - 0.3, arm.q + 0.3)
    with pytest.raises(InputError, match=f"map of another mechanism, with other {name}"):
        compute_map(arm, places, ["translation_free_min", "condition"], file, length=0.2)
