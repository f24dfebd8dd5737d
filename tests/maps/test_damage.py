"""Damaged maps: every damage is named or mended, and no other number is read."""

import contextlib
import json
import os
import random
import re
import shutil
import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule
from tests.maps.machines import arm, drawn, grid_of
from tests.support.maps import BegunMap

from cartstiff import CartstiffError, InputError
from cartstiff.maps import Trajectory, compute_map, open_map

QUANTITIES = ["translation_free_min", "condition"]
#: Damages of each kind that are tried; "170,34,17" for each sampling takes some minutes.
FLIPS, DELETIONS, KILLS = (int(n) for n in os.environ.get("MAP_DAMAGES", "6,4,3").split(","))
#: Damages of zarr.json files that are tried for each sampling.
DESCRIPTIONS = int(os.environ.get("MAP_DESCRIPTIONS", "20"))


@pytest.fixture(scope="module")
def elastic():
    return arm()


def _trajectory(elastic):
    q = elastic.q + np.linspace(-0.2, 0.3, 18)[:, None]
    return Trajectory(q, np.linspace(0.0, 1.0, 18))


def _computed(elastic, sampling, file):
    return compute_map(elastic, sampling, QUANTITIES, file, chunk=4, length=0.2)


def _files(folder):
    return sorted(p for p in folder.rglob("*") if p.is_file())


def _require_true(dataset, expected):
    """Every number that is read is the right one, or says that it has not been computed."""
    dataset = dataset.load()
    missing = dataset["state"].values == 255
    assert dict(dataset.attrs) | {"chunks_done": 0} == dict(expected.attrs) | {"chunks_done": 0}
    for name in expected.variables:
        found, true = dataset[name], expected[name]
        assert found.dims == true.dims
        assert found.attrs == true.attrs
        there = np.ones(true.shape, bool)
        if name in expected.data_vars or name == "time":
            there = np.broadcast_to(
                missing.reshape(missing.shape + (1,) * (true.ndim - missing.ndim)), true.shape
            )
            if name == "q":  # may be known where nothing has been computed
                there = there & np.isnan(found.values)
            elif true.dtype.kind == "f":
                assert np.isnan(found.values[there]).all()
            there = ~there
        np.testing.assert_array_equal(found.values[there], true.values[there])


@pytest.fixture(
    scope="module", params=[grid_of, _trajectory, drawn], ids=["grid", "path", "random"]
)
def whole(request, elastic, tmp_path_factory):
    """A sampling, its map on disk, and its numbers."""
    sampling = request.param(elastic)
    file = tmp_path_factory.mktemp("whole") / "m.zarr"
    return sampling, file, _computed(elastic, sampling, file).load()


def _damaged_and_mended(elastic, whole, copy, damage):
    sampling, original, expected = whole
    shutil.copytree(original, copy)
    damage(copy)
    try:
        _require_true(open_map(copy), expected)
    except InputError as error:
        message = str(error)
        assert "damaged" in message or "is not a map" in message or "another version" in message
        assert "same command" in message or "schema" in message or "folder made by" in message
    mended = _mended(elastic, sampling, copy)
    assert mended.attrs["chunks_done"] == mended.attrs["chunks"]
    _require_true(mended, expected)
    shutil.rmtree(copy)


def _mended(elastic, sampling, file):
    """The map after the damaged files that messages name have been deleted, one after the other."""
    for _ in range(len(_files(file)) + 2):
        try:
            return _computed(elastic, sampling, file).load()
        except InputError as error:
            named = re.search(r"damaged: (\S+) is (missing, or )?not what", str(error))
            if named is None:  # the folder does not even say what map it is
                if not any(w in str(error) for w in ("zarr.json", "version", "is not a map")):
                    raise
                shutil.rmtree(file)
            else:
                (file / named[1]).unlink(missing_ok=True)
    raise AssertionError("the map stays damaged")


def test_flipped_bits(elastic, whole, tmp_path):
    rng = np.random.default_rng(7)

    def flip(folder):
        files = _files(folder)
        path = files[rng.integers(len(files))]
        data = bytearray(path.read_bytes())
        data[rng.integers(len(data))] ^= 1 << int(rng.integers(8))
        path.write_bytes(bytes(data))

    for _ in range(FLIPS):
        _damaged_and_mended(elastic, whole, tmp_path / "m.zarr", flip)


def test_deleted_and_cut_files(elastic, whole, tmp_path):
    rng = np.random.default_rng(8)

    def cut(folder):
        files = _files(folder)
        path = files[rng.integers(len(files))]
        if rng.integers(2):
            path.unlink()
        else:
            path.write_bytes(path.read_bytes()[: -int(rng.integers(1, 5))])

    for _ in range(DELETIONS):
        _damaged_and_mended(elastic, whole, tmp_path / "m.zarr", cut)


def _exchange(a, b):
    kept = a.read_bytes()
    a.write_bytes(b.read_bytes())
    b.write_bytes(kept)


@pytest.mark.parametrize(
    "what", ["chunks", "arrays", "marks", "strangers", "parts", "axes", "maps"]
)
def test_exchanged_files(elastic, whole, tmp_path, what):
    """Each has a right checksum, and stands where another one belongs."""
    sampling, _, _ = whole

    def damage(folder):
        def chunks(name):
            return [p for p in _files(folder / name) if p.name != "zarr.json"]

        first, *_, last = chunks("condition")
        if what == "chunks":
            _exchange(first, last)
        elif what == "arrays":
            _exchange(first, chunks(QUANTITIES[0])[0])
        elif what == "marks":
            _exchange(*sorted(chunks("parts"))[:2])
        elif what == "strangers":  # files of no mark's length
            for mark, name in zip(chunks("parts"), ("state", "position"), strict=False):
                mark.write_bytes(chunks(name)[0].read_bytes())
        elif what == "parts":  # of one shape, with all their files and marks
            for name in ("condition", QUANTITIES[0], "state", "position", "parts", "q"):
                if (folder / name).exists():
                    found = chunks(name)
                    _exchange(found[0], found[1])
        elif what == "axes":
            for name in sampling.axes:
                (path,) = chunks(name)
                path.write_bytes(first.read_bytes())
        else:
            other = folder.parent / "other.zarr"
            options = {"chunk": 4, "length": 0.2, "command": "another"}
            compute_map(elastic.with_springs(7.0), sampling, QUANTITIES, other, **options)
            for name in ("condition", QUANTITIES[0], "state", "position", "parts"):
                path = chunks(name)[0]
                path.write_bytes((other / path.relative_to(folder)).read_bytes())
            shutil.rmtree(other)
        if what != "axes" or sampling.axes:
            with pytest.raises(
                InputError, match=r"damaged: \S+ is (missing, or )?not what was written"
            ):
                open_map(folder).load()

    _damaged_and_mended(elastic, whole, tmp_path / "m.zarr", damage)


def test_a_trajectory_at_other_times_is_another_map(elastic, tmp_path):
    sampling = _trajectory(elastic)
    _computed(elastic, sampling, tmp_path / "m.zarr")
    with pytest.raises(InputError, match="another map: sha256 differs"):
        _computed(elastic, Trajectory(sampling.q, sampling.time + 1.0), tmp_path / "m.zarr")


class _Killed(BaseException):
    pass


def _killed_after(monkeypatch, files):
    """The process ends when it has written so many files."""
    from zarr.storage import LocalStore

    put, left = LocalStore.set, [files]

    async def end(self, key, value):
        if not left[0]:
            raise _Killed
        left[0] -= 1
        await put(self, key, value)

    monkeypatch.setattr(LocalStore, "set", end)


def test_killed_anywhere(elastic, whole, tmp_path, monkeypatch):
    sampling, _, expected = whole
    rng = np.random.default_rng(9)
    for _ in range(KILLS):
        file = tmp_path / "m.zarr"
        with monkeypatch.context() as patch:
            _killed_after(patch, int(rng.integers(2, 60)))
            with contextlib.suppress(_Killed):  # else it was whole before
                _computed(elastic, sampling, file)
        if file.exists():
            _require_true(open_map(file), expected)
        _require_true(_computed(elastic, sampling, file), expected)
        shutil.rmtree(file)
        for path in tmp_path.iterdir():
            shutil.rmtree(path)


def test_each_damage_has_its_line(elastic, whole, tmp_path):
    _, original, _ = whole
    file = tmp_path / "m.zarr"
    shutil.copytree(original, file)
    part = next(p for p in _files(file / "condition" / "c") if p.name == "1")
    part.unlink()
    with pytest.raises(InputError, match=r"part 2 of \d+ is damaged: condition/c/0?/?1 is missing"):
        open_map(file)["condition"].load()
    text = (file / "zarr.json").read_text()
    (file / "zarr.json").write_text(text.replace("regular", "perfect", 1))
    with pytest.raises(InputError, match=r"its zarr.json does not agree.*same command"):
        open_map(file)
    (file / "zarr.json").write_text("[" * 5000)
    with pytest.raises(InputError, match=r"is not a map, or its zarr.json is damaged"):
        open_map(file)


def _descriptions(folder):
    return [p for p in _files(folder) if p.name == "zarr.json"]


def test_any_damage_of_a_description_is_named(whole, tmp_path):
    """Bytes, values and lines of every zarr.json: an InputError, or the numbers as they were.

    The folder's describes all; those of the arrays are copies for other readers.
    """
    from tools.fuzz_common import mutated_bytes, mutated_data

    _, original, expected = whole
    rng = random.Random(15)
    file = tmp_path / "m.zarr"
    shutil.copytree(original, file)
    paths, refused = _descriptions(file), 0
    for _ in range(DESCRIPTIONS):
        path = rng.choice([file / "zarr.json", rng.choice(paths)])
        data = path.read_bytes()
        if rng.random() < 0.6:
            changed = json.dumps(mutated_data(rng, json.loads(data))).encode()
        else:
            changed = mutated_bytes(rng, data)
        path.write_bytes(changed)
        try:
            _require_true(open_map(file), expected)
        except InputError as error:
            refused += "\n" not in str(error)
        path.write_bytes(data)
    assert refused > DESCRIPTIONS / 4
    _require_true(open_map(file), expected)


def test_links_and_devices(whole, tmp_path):
    _, original, _ = whole
    for target in ("/dev/zero", str(original / "state")):
        file = tmp_path / "m.zarr"
        shutil.copytree(original, file)
        inside = next(p for p in _files(file / "position") if p.name != "zarr.json")
        inside.unlink()
        inside.symlink_to(target)
        with pytest.raises(InputError, match="is a link; expected files and folders only"):
            open_map(file)
        shutil.rmtree(file)
    shutil.copytree(original, file)
    os.mkfifo(file / "state" / "pipe")
    with pytest.raises(InputError, match="is no file; expected files and folders only"):
        open_map(file)


def test_only_missing_parts_are_computed(elastic, whole, tmp_path):
    """A lost object is computed, a wrong one is left and refused by who reads it."""
    sampling, original, expected = whole
    file = tmp_path / "m.zarr"
    shutil.copytree(original, file)
    lost, *_, wrong = _files(file / "state" / "c")
    lost.unlink()
    wrong.write_bytes(b"")
    begun = BegunMap(elastic, sampling, QUANTITIES, file, chunk=4, length=0.2)
    assert begun.go_on() == 1
    assert begun.go_on(anew=True) == 0
    name = wrong.relative_to(file).as_posix()
    with pytest.raises(InputError, match=f"{name} is missing, or not what .* without it, the same"):
        open_map(file).load()
    wrong.unlink()
    assert begun.go_on(anew=True) == 1
    _require_true(open_map(file), expected)


class Life(RuleBasedStateMachine):
    """Write, kill, flip, delete, exchange, resume and read, in any order."""

    expected = None

    def __init__(self):
        super().__init__()
        self.folder = Path(tempfile.mkdtemp())
        self.file = self.folder / "m.zarr"
        self.elastic = arm()
        self.sampling = drawn(self.elastic)
        if Life.expected is None:
            whole = self.folder / "whole.zarr"
            Life.expected = _computed(self.elastic, self.sampling, whole).load()

    def teardown(self):
        shutil.rmtree(self.folder)

    def _compute(self):
        return _mended(self.elastic, self.sampling, self.file)

    @initialize()
    def write(self):
        self._compute()

    @rule(files=st.integers(0, 50))
    def kill(self, files):
        with pytest.MonkeyPatch.context() as patch:
            _killed_after(patch, files)
            with contextlib.suppress(_Killed):
                self._compute()

    @rule(which=st.integers(0, 10**6), place=st.integers(0, 10**6), bit=st.integers(0, 7))
    def flip(self, which, place, bit):
        files = [p for p in _files(self.folder) if p.stat().st_size]
        if files:
            path = files[which % len(files)]
            data = bytearray(path.read_bytes())
            data[place % len(data)] ^= 1 << bit
            path.write_bytes(bytes(data))

    @rule(which=st.integers(0, 10**6))
    def delete(self, which):
        if files := _files(self.file):
            files[which % len(files)].unlink()

    @rule(which=st.integers(0, 10**6), other=st.integers(0, 10**6))
    def exchange(self, which, other):
        if files := _files(self.file):
            _exchange(files[which % len(files)], files[other % len(files)])

    @rule()
    def resume(self):
        found = self._compute()
        assert found.attrs["chunks_done"] == found.attrs["chunks"]
        _require_true(found, Life.expected)

    @invariant()
    def read(self):
        if not self.file.exists():
            return
        with contextlib.suppress(CartstiffError):
            _require_true(open_map(self.file), Life.expected)


TestLife = Life.TestCase
TestLife.settings = settings(
    max_examples=5,
    stateful_step_count=8,
    deadline=None,
    suppress_health_check=list(HealthCheck),
    derandomize=True,
)
