"""The same map on a Dask scheduler: workers that die, workers that see nothing, none at all."""

from __future__ import annotations

import contextlib
import json
import signal
import time
from pathlib import Path

import numpy as np
import psutil
import pytest
from tests.maps.machines import marks, start, start_map

from cartstiff.errors import InputError
from cartstiff.maps import open_map
from cartstiff.maps.cluster import _require_folder


def _end(process):
    with contextlib.suppress(ProcessLookupError):
        process.send_signal(signal.SIGKILL)
    process.communicate(timeout=60)


def _finished(process):
    out, error = process.communicate(timeout=180)
    assert process.returncode == 0, error
    return json.loads(out)


@pytest.fixture(scope="module")
def scheduler(tmp_path_factory):
    """A scheduler on this machine, and its address."""
    folder = tmp_path_factory.mktemp("scheduler")
    about = folder / "scheduler.json"
    process = start("-m", "distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", "0",
                     "--no-dashboard", "--dashboard-address", "127.0.0.1:0",
                     "--scheduler-file", str(about))  # fmt: skip
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
        process = start("-m", "distributed.cli.dask_worker", scheduler, "--no-nanny",
                         "--nthreads", "1", "--host", "127.0.0.1", "--no-dashboard",
                         "--local-directory", str(tmp_path))  # fmt: skip
        started.append(process)
        return process

    yield one_more
    for process in started:
        _end(process)


def _same(file, expected):
    found = open_map(file).load()
    assert found.attrs["chunks_done"] == found.attrs["chunks"]
    for variable in expected.data_vars:
        np.testing.assert_array_equal(found[variable], expected[variable])


def test_a_killed_worker_costs_its_chunks_only(whole, scheduler, worker, tmp_path):
    first, second = worker(), worker()
    file = tmp_path / "m.zarr"
    process = start_map(file, "--scheduler", scheduler)
    while len(marks(file)) < 4:
        assert process.poll() is None, process.communicate()[1]
        time.sleep(0.02)
    first.send_signal(signal.SIGKILL)
    first.wait(timeout=30)
    kept = marks(file)
    answer = _finished(process)
    assert second.poll() is None
    assert answer["parts"]["computed"] == answer["parts"]["total"]
    # What the dead worker had finished was not done again.
    assert kept.items() <= marks(file).items()
    _same(file, whole[0])


def test_processes_of_this_machine_listen_to_it_alone(whole, tmp_path):
    file = tmp_path / "m.zarr"
    process = start_map(file, "--workers", "1")
    addresses = set()
    own = psutil.Process(process.pid)
    while process.poll() is None and len(marks(file)) < whole[0].attrs["chunks"]:
        with contextlib.suppress(psutil.Error):
            for one in [own, *own.children(recursive=True)]:
                with contextlib.suppress(psutil.Error):
                    addresses |= {
                        c.laddr.ip for c in one.net_connections("inet") if c.status == "LISTEN"
                    }
        time.sleep(0.2)
    _finished(process)
    assert addresses == {"127.0.0.1"}
    _same(file, whole[0])


def test_a_scheduler_that_does_not_answer(tmp_path):
    quickly = {"DASK_DISTRIBUTED__COMM__TIMEOUTS__CONNECT": "1s"}
    process = start_map(tmp_path / "m.zarr", "--scheduler", "tcp://127.0.0.1:1", **quickly)
    out, error = process.communicate(timeout=120)
    assert process.returncode == 2
    assert out == ""
    assert error.startswith("cartstiff: tcp://127.0.0.1:1: no scheduler answers")
    assert error.count("\n") == 1


def test_a_worker_that_does_not_see_the_folder():
    class Blind:
        def run(self, function, *arguments):
            return {"tcp://10.0.0.7:1": function(*arguments), "tcp://10.0.0.8:1": True}

    with pytest.raises(InputError, match=r"does not see the map's folder.*10\.0\.0\.7"):
        _require_folder(Blind(), Path("/nowhere/at/all"))
