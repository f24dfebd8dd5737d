"""Maps in any store of Zarr, lazy maps, and what readers without this library find in them."""

import errno
import os
import threading
import warnings
import zipfile

import fsspec
import numpy as np
import pytest
import xarray
import zarr
import zarr.core.buffer.cpu
from tests.maps.machines import arm, drawn, grid_of, start
from tests.maps.test_damage import _Killed, _killed_after
from tests.support.maps import BegunMap, layout_of, small_pieces
from zarr.storage import LocalStore

from cartstiff import InputError
from cartstiff.maps import compute_map, map_of, open_map

QUANTITIES = ["translation_free_min", "condition"]


@pytest.fixture(scope="module")
def elastic():
    return arm()


@pytest.fixture(scope="module")
def expected(elastic, tmp_path_factory):
    file = tmp_path_factory.mktemp("expected") / "m.zarr"
    return compute_map(elastic, drawn(elastic), QUANTITIES, file, chunk=6, length=0.2).load()


def _plain(address):
    """As somebody reads it who has no cartstiff."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return xarray.open_zarr(address).load()


def _same(found, expected):
    for name in expected.data_vars:
        np.testing.assert_array_equal(found[name], expected[name])
        assert found[name].attrs == expected[name].attrs


@pytest.mark.parametrize("address", ["memory://maps/m.zarr", "file://{}/m.zarr", "store"])
def test_stores(elastic, expected, tmp_path, address):
    where = zarr.storage.MemoryStore() if address == "store" else address.format(tmp_path)
    asked = {"chunk": 6, "length": 0.2}
    begun = BegunMap(elastic, drawn(elastic), QUANTITIES, where, **asked)
    assert begun.go_on() == 4
    assert begun.go_on(anew=True) == 0
    for found in (_plain(where), open_map(where)):
        _same(found, expected)
    with pytest.raises(InputError, match="length differs"):
        compute_map(elastic, drawn(elastic), QUANTITIES, where, chunk=6, length=0.3)


def test_an_object_store(elastic, expected, monkeypatch):
    moto = pytest.importorskip("moto.server")
    s3fs = pytest.importorskip("s3fs")
    server = moto.ThreadedMotoServer(ip_address="127.0.0.1", port=0)
    server.start()
    host, port = server.get_host_and_port()
    for name, value in {
        "AWS_ENDPOINT_URL": f"http://{host}:{port}",
        "AWS_ACCESS_KEY_ID": "test",
        "AWS_SECRET_ACCESS_KEY": "test",
        "AWS_DEFAULT_REGION": "us-east-1",
    }.items():
        monkeypatch.setenv(name, value)
    try:
        files = s3fs.S3FileSystem()
        files.mkdir("maps")
        asked = elastic, drawn(elastic), QUANTITIES, "s3://maps/m.zarr"
        compute_map(*asked, chunk=6, length=0.2)
        _same(_plain("s3://maps/m.zarr"), expected)
        files.rm("maps/m.zarr/condition/c/1")
        begun = BegunMap(*asked, chunk=6, length=0.2)
        assert begun.go_on() == 1
        _same(open_map("s3://maps/m.zarr"), expected)
        with pytest.raises(InputError, match=r"no-such.*store cannot be used"):
            compute_map(*asked[:3], "s3://no-such/m.zarr")
    finally:
        server.stop()


def test_an_address_that_nobody_knows(elastic):
    with pytest.raises(InputError, match=r"nobody://m\.zarr: store cannot be used.*nobody"):
        compute_map(elastic, drawn(elastic), QUANTITIES, "nobody://m.zarr")


def test_a_copy_in_another_store(elastic, expected, tmp_path):
    """It needs nothing of the place where it was computed; units and flags are found."""
    file = tmp_path / "m.zarr"
    compute_map(elastic, drawn(elastic), QUANTITIES, file, chunk=6, length=0.2)
    in_memory, zipped = {}, tmp_path / "m.zip"
    fsspec.filesystem("memory").put(str(file), "/copies/m.zarr", recursive=True)
    with zipfile.ZipFile(zipped, "w") as archive:
        for path in (p for p in file.rglob("*") if p.is_file()):
            key, value = path.relative_to(file).as_posix(), path.read_bytes()
            in_memory[key] = zarr.core.buffer.cpu.Buffer.from_bytes(value)
            archive.writestr(key, value)
    copies = [
        "memory://copies/m.zarr",
        zarr.storage.MemoryStore(in_memory),
        zarr.storage.ZipStore(zipped, read_only=True),
    ]
    for copy in copies:
        for found in (_plain(copy), open_map(copy)):
            _same(found, expected)
            assert found["translation_free_min"].attrs["units"] == "N/m"
            state = found["state"].attrs
            assert len(state["flag_values"]) == len(state["flag_meanings"].split())
    (file / "parts" / "marks" / "c" / "1" / "0").unlink()
    read_only = LocalStore(file, read_only=True)
    with pytest.raises(InputError, match=r"written; .* same command .* read-only"):
        compute_map(elastic, drawn(elastic), QUANTITIES, read_only, chunk=6, length=0.2)


def test_a_full_disk_is_named_and_the_map_goes_on(elastic, expected, tmp_path, monkeypatch):
    asked = elastic, drawn(elastic), QUANTITIES, tmp_path / "m.zarr"
    begun = BegunMap(*asked, chunk=6, length=0.2)
    put, left = LocalStore.set, iter(range(8))

    async def limited(self, key, value):
        if next(left, None) is None:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        await put(self, key, value)

    with monkeypatch.context() as patch:
        patch.setattr("cartstiff.wings.maps.run.cpu_count", lambda: 1)
        patch.setattr(LocalStore, "set", limited)
        with pytest.raises(InputError, match=r"written; .* same command .* No space left"):
            begun.go_on()
    assert len(begun.file.done()) == 1
    _same(compute_map(*asked, chunk=6, length=0.2), expected)


def test_large_parts_are_computed_one_at_a_time_in_pieces(elastic, expected, tmp_path, monkeypatch):
    """All threads compute the pieces of a part, so that more threads need little more memory."""
    monkeypatch.setattr("cartstiff.wings.maps.job._PIECE_ROWS", 2)
    monkeypatch.setattr("cartstiff.wings.maps.run.MAX_CHUNK", 11)
    monkeypatch.setattr("cartstiff.wings.maps.run.cpu_count", lambda: 4)
    small = BegunMap(elastic, drawn(elastic), QUANTITIES, tmp_path / "n.zarr")
    job = type(small.job)
    at_once, most, compute = [], [], job.compute

    def counted(self, box, mapped):
        at_once.append(box)
        most.append(len(at_once))
        arrays = compute(self, box, mapped)
        at_once.remove(box)
        return arrays

    monkeypatch.setattr(job, "compute", counted)
    asked = elastic, drawn(elastic), QUANTITIES, tmp_path / "m.zarr"
    _same(compute_map(*asked, chunk=6, length=0.2), expected)
    assert most == [1, 1, 1, 1]
    compute_map(elastic, grid_of(elastic), QUANTITIES, tmp_path / "g.zarr", length=0.2)
    monkeypatch.undo()
    whole = compute_map(elastic, grid_of(elastic), QUANTITIES, tmp_path / "w.zarr", length=0.2)
    _same(open_map(tmp_path / "g.zarr"), whole)


_MANY_THREADS = """
import sys
import cartstiff
from cartstiff.wings.maps import run

run.cpu_count = lambda: 16
arm = cartstiff.load("ur5")
names = ["condition", "translation_free_min", "manipulability"]
postures = cartstiff.maps.RandomPostures.within_limits(arm, 4_000_000)
cartstiff.maps.compute_map(arm, postures, names, sys.argv[1])
# The peak of this program alone: ru_maxrss would hold what the tests' own process had.
status = open("/proc/self/status").read()
print(int(status.split("VmHWM:")[1].split()[0]) // 1024)
"""


def test_many_threads_need_little_memory(tmp_path):
    process = start("-c", _MANY_THREADS, str(tmp_path / "m.zarr"))
    out, error = process.communicate(timeout=600)
    assert process.returncode == 0, error
    assert int(out) < 500


def test_two_writers_at_once(elastic, expected):
    """A store has no locks: both write the same objects."""
    asked = elastic, drawn(elastic), QUANTITIES, "memory://two/m.zarr"
    options = {"chunk": 6, "length": 0.2}
    BegunMap(*asked, **options)
    writers = [threading.Thread(target=compute_map, args=asked, kwargs=options) for _ in range(2)]
    for writer in writers:
        writer.start()
    for writer in writers:
        writer.join()
    found = open_map("memory://two/m.zarr")
    assert found.attrs["chunks_done"] == 4
    _same(found, expected)


def test_a_map_that_another_process_creates_in_the_meantime(elastic, tmp_path, monkeypatch):
    asked = elastic, drawn(elastic), QUANTITIES, tmp_path / "m.zarr"
    options = {"chunk": 6, "length": 0.2}
    begun = BegunMap(*asked, **options)
    monkeypatch.setattr("cartstiff.wings.maps.run.is_there", lambda address: False)
    with (
        begun.file.locked(),
        pytest.raises(InputError, match="another process or thread is computing this map"),
    ):
        compute_map(*asked, **options)
    assert [path.name for path in tmp_path.iterdir()] == ["m.zarr"]


def test_a_map_that_is_computed_when_it_is_used(elastic, expected, tmp_path):
    lazy = map_of(elastic, drawn(elastic), QUANTITIES, chunk=6, length=0.2)
    assert lazy["condition"].chunks == ((6, 6, 6, 2),)
    _same(lazy.compute(), expected)
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Consolidated metadata")
        lazy.to_zarr(tmp_path / "plain.zarr")
    _same(_plain(tmp_path / "plain.zarr"), expected)
    grid = map_of(elastic, grid_of(elastic), QUANTITIES, length=0.2)
    a, b = elastic.names[1], elastic.names[3]
    line = grid["condition"].sel({a: 0.3}, method="nearest")
    assert line.dims == (b,)
    there = compute_map(elastic, grid_of(elastic), QUANTITIES, tmp_path / "g.zarr", length=0.2)
    np.testing.assert_array_equal(line, there["condition"].sel({a: 0.3}, method="nearest"))
    np.testing.assert_array_equal(grid["q"], there["q"])


def test_a_map_says_its_postures_to_every_reader(elastic, expected, tmp_path):
    np.testing.assert_array_equal(expected["q"], drawn(elastic).postures((slice(0, 20),), elastic))
    assert expected["q"].attrs["joints"].split() == list(elastic.names)
    compute_map(elastic, grid_of(elastic), QUANTITIES, tmp_path / "g.zarr", length=0.2)
    plain = _plain(tmp_path / "g.zarr")
    assert plain.attrs["Conventions"].startswith("CF-")
    assert plain.attrs["joints"].split() == list(elastic.names)
    assert plain.attrs["joint_units"].split() == ["rad"] * len(elastic.names)
    for i, name in enumerate(elastic.names):
        if name in plain.coords:
            assert plain[name].attrs["units"] == "rad"
        else:
            assert plain.attrs[f"fixed_{name}"] == elastic.q[i]
    assert "done" not in plain.variables


def test_what_a_killed_process_leaves_is_not_computed_to_every_reader(
    elastic, expected, tmp_path, monkeypatch
):
    """The states of a part are written last: no number that is not there has a state."""
    for files in (2, 3, 4, 5, 8):
        file = tmp_path / f"{files}.zarr"
        asked = elastic, drawn(elastic), QUANTITIES, file
        begun = BegunMap(*asked, chunk=6, length=0.2)
        with monkeypatch.context() as patch:
            patch.setattr("cartstiff.wings.maps.run.cpu_count", lambda: 1)
            _killed_after(patch, files)
            with pytest.raises(_Killed):
                begun.go_on()
        plain = _plain(file)
        done = plain["state"].values != 255
        for name in ("q", "position", *QUANTITIES):
            np.testing.assert_array_equal(plain[name].values[done], expected[name].values[done])
        assert done.sum() == 6 * (files >= 5)


@pytest.mark.parametrize("files", [6, 9, 14])
def test_killed_again_and_again(elastic, expected, tmp_path, monkeypatch, files):
    """Each life writes a few objects; nothing is lost, and the map is that of one life."""
    asked = elastic, drawn(elastic), QUANTITIES, tmp_path / "m.zarr"
    kills, done = 0, 0
    begun = BegunMap(*asked, chunk=2, length=0.2)
    while len(begun.file.done()) < 10:
        with monkeypatch.context() as patch:
            patch.setattr("cartstiff.wings.maps.run.cpu_count", lambda: 1)
            _killed_after(patch, files)
            try:
                begun.go_on()
            except _Killed:
                kills += 1
        now = int((_plain(asked[3])["state"].values != 255).sum())
        assert now >= done
        done = now
    assert kills >= 20 // files
    found = compute_map(*asked, chunk=2, length=0.2)
    assert found.attrs["chunks_done"] == 10
    _same(found, expected)


def test_resuming_reads_no_number(elastic, tmp_path, monkeypatch):
    asked = elastic, drawn(elastic), QUANTITIES, tmp_path / "m.zarr"
    compute_map(*asked, chunk=6, length=0.2)
    (tmp_path / "m.zarr" / "parts" / "marks" / "c" / "1" / "0").unlink()
    read, get = [], LocalStore.get

    async def counted(self, key, *arguments, **options):
        read.append(key)
        return await get(self, key, *arguments, **options)

    monkeypatch.setattr(LocalStore, "get", counted)
    begun = BegunMap(*asked, chunk=6, length=0.2)
    assert begun.go_on() == 1
    assert not [key for key in read if "/c/" in key and not key.startswith("parts/")]


def test_parts_are_few_large_objects_in_pieces(elastic, expected, tmp_path, monkeypatch):
    layout = layout_of(elastic, drawn(elastic, 2 * 10**8), ["condition", "force", "isotropy"])
    objects = len(layout.parts) * (1 + len(layout.arrays))
    assert objects < 2000
    assert layout.encoding(layout.arrays["q"])["chunks"] == (45056, 6)
    small_pieces(monkeypatch, 3)
    asked = elastic, drawn(elastic), QUANTITIES, tmp_path / "m.zarr"
    found = compute_map(*asked, chunk=6, length=0.2)
    array = zarr.open_group(tmp_path / "m.zarr")["condition"]
    assert (array.shards, array.chunks) == ((6,), (3,))
    _same(found, expected)
    np.testing.assert_array_equal(found["q"][4:5], expected["q"][4:5])
    _same(_plain(tmp_path / "m.zarr"), expected)
