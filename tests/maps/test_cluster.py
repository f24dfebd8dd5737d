"""The same map on a Dask scheduler: workers that die, workers that see nothing, none at all."""

import contextlib
import json
import signal
import threading
import time

import numpy as np
import pytest
from tests.maps.machines import arm, drawn, marks, start, start_held_map, start_map
from tests.support.maps import BegunMap

import cartstiff
from cartstiff import InputError, JointFunction
from cartstiff.maps import Axis, Grid, RandomPostures, compute_map, open_map


def _end(process):
    with contextlib.suppress(ProcessLookupError):
        process.send_signal(signal.SIGKILL)
    process.communicate(timeout=600)


def _finished(process, answer=None):
    out, error = process.communicate(answer, timeout=600)
    assert process.returncode == 0, error
    return json.loads(out)


@pytest.fixture(scope="module")
def scheduler(tmp_path_factory):
    """A scheduler on this machine, and its address."""
    folder = tmp_path_factory.mktemp("scheduler")
    about = folder / "scheduler.json"
    local = "--host 127.0.0.1 --port 0 --no-dashboard --dashboard-address 127.0.0.1:0"
    words = f"-m distributed.cli.dask_scheduler {local} --scheduler-file".split()
    process = start(*words, str(about))
    try:
        for _ in range(3000):
            with contextlib.suppress(OSError, ValueError):
                yield json.loads(about.read_text())["address"]
                return
            assert process.poll() is None, process.communicate()[1]
            time.sleep(0.02)
        raise AssertionError("the scheduler does not answer")
    finally:
        _end(process)


@pytest.fixture
def worker(scheduler, tmp_path):
    """Starts a worker without a nanny: nobody starts it again."""
    started = []

    def one_more():
        local = "--no-nanny --nthreads 1 --host 127.0.0.1 --no-dashboard --local-directory"
        words = f"-m distributed.cli.dask_worker {scheduler} {local}".split()
        process = start(*words, str(tmp_path))
        started.append(process)
        return process

    yield one_more
    for process in started:
        _end(process)


def _few(elastic):
    return RandomPostures(8, 1, elastic.q - 0.1, elastic.q + 0.1)


def _same(file, expected):
    found = open_map(file).load()
    assert found.attrs["chunks_done"] == found.attrs["chunks"]
    for variable in expected.data_vars:
        np.testing.assert_array_equal(found[variable], expected[variable])


def test_a_killed_worker_costs_its_chunks_only(whole, scheduler, worker, tmp_path):
    first, second = worker(), worker()
    file = tmp_path / "m.zarr"
    process = start_held_map(file, 4, "--dask", scheduler)
    first.send_signal(signal.SIGKILL)
    first.wait(timeout=600)
    kept = marks(file)
    answer = _finished(process, "\n")
    assert second.poll() is None
    assert answer["parts"]["computed"] == answer["parts"]["total"]
    # What the dead worker had finished was not done again.
    assert kept.items() <= marks(file).items()
    _same(file, whole[0])


def test_a_client_of_ones_own(whole, scheduler, worker, tmp_path):
    """Two workers give the bytes of one process; the client stays open."""
    from distributed import Client

    worker(), worker()
    elastic = cartstiff.load("delta")
    grid = Grid({elastic.names[0]: Axis(0.3, 0.5, 6)}, elastic.names, elastic.q)
    asked = elastic, grid, ["compliance_translation_free_max"]
    with Client(scheduler, set_as_default=False) as client:
        client.wait_for_workers(2)
        there = compute_map(*asked, tmp_path / "m.zarr", dask=client, chunk=1)
        assert client.status == "running"
    here = compute_map(*asked, tmp_path / "n.zarr", chunk=1)
    for name in ("state", *asked[2]):
        for path in (tmp_path / "n.zarr" / name).rglob("c/*"):
            if path.is_file():
                other = tmp_path / "m.zarr" / path.relative_to(tmp_path / "n.zarr")
                assert path.read_bytes() == other.read_bytes()
    np.testing.assert_array_equal(here["q"], there["q"])


def test_workers_of_another_version_write_nothing(scheduler, worker, tmp_path):
    from distributed import Client

    worker(), worker()
    elastic = arm()
    asked = elastic, drawn(elastic, 90), ["condition"]
    with Client(scheduler, set_as_default=False) as client:
        client.wait_for_workers(2)
        compute_map(*asked, tmp_path / "first.zarr", dask=client, chunk=1)
        one = list(client.scheduler_info()["workers"])[:1]
        older = "from cartstiff import version; version.__version__ = '0.0.1'"
        client.run(exec, older, workers=one)
        with pytest.raises(InputError, match=r"another version of cartstiff; .* got 0\.0\.1"):
            compute_map(*asked, tmp_path / "m.zarr", dask=client, chunk=1)
    assert marks(tmp_path / "m.zarr") == {}


def test_what_cannot_be_sent(tmp_path):
    lock = threading.Lock()

    def energy(q):
        return 0.0 * bool(lock)

    energy.version = "1"  # what a lock holds cannot be compared
    elastic = arm().with_potential(JointFunction(energy=energy))
    begun = BegunMap(elastic, _few(elastic), ["condition"], tmp_path / "m.zarr")
    with pytest.raises(
        InputError, match="cannot be sent to other processes; expected functions without"
    ):
        begun.sent()


def test_processes_are_those_of_a_scheduler(tmp_path):
    elastic = arm()
    with pytest.raises(InputError, match="an address, or a client of Dask"):
        compute_map(elastic, _few(elastic), ["condition"], tmp_path / "n.zarr", dask=2)


def test_a_scheduler_that_does_not_answer(tmp_path):
    quickly = {"DASK_DISTRIBUTED__COMM__TIMEOUTS__CONNECT": "1s"}
    process = start_map(tmp_path / "m.zarr", "--dask", "tcp://127.0.0.1:1", **quickly)
    out, error = process.communicate(timeout=600)
    assert process.returncode == 2
    assert out == ""
    assert error.startswith("cartstiff: tcp://127.0.0.1:1: no scheduler answers")
    assert error.count("\n") == 1


def test_a_worker_that_does_not_see_the_folder(tmp_path):
    elastic = arm()
    file = tmp_path / "m.zarr"
    begun = BegunMap(elastic, _few(elastic), ["condition"], file)
    for path, identity in ((tmp_path / "none.zarr", ""), (file, "of another map")):
        with pytest.raises(InputError, match=r"does not see the map's folder"):
            begun.in_worker(at=path, identity=identity)
    assert begun.in_worker() == 0
    before = marks(file)
    assert list(before) == ["0"]
    # A worker that died has done it before it could say so.
    assert begun.in_worker() == 0
    assert marks(file) == before
