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
from tests.maps.machines import arm, marks, start, start_held_map, start_map

from cartstiff.errors import InputError
from cartstiff.maps import RandomPostures, compute_map, open_map
from cartstiff.maps.run import _require_folder
from cartstiff.potentials.functions import JointFunction


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
    process = start(
        "-m",
        "distributed.cli.dask_scheduler",
        "--host",
        "127.0.0.1",
        "--port",
        "0",
        "--no-dashboard",
        "--dashboard-address",
        "127.0.0.1:0",
        "--scheduler-file",
        str(about),
    )
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
        process = start(
            "-m",
            "distributed.cli.dask_worker",
            scheduler,
            "--no-nanny",
            "--nthreads",
            "1",
            "--host",
            "127.0.0.1",
            "--no-dashboard",
            "--local-directory",
            str(tmp_path),
        )
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
    process = start_held_map(file, 4, "--scheduler", scheduler)
    first.send_signal(signal.SIGKILL)
    first.wait(timeout=600)
    kept = marks(file)
    answer = _finished(process, "\n")
    assert second.poll() is None
    assert answer["parts"]["computed"] == answer["parts"]["total"]
    # What the dead worker had finished was not done again.
    assert kept.items() <= marks(file).items()
    _same(file, whole[0])


def test_processes_of_this_machine_listen_to_nobody_and_one_that_dies_costs_its_chunk(
    whole, tmp_path
):
    file = tmp_path / "m.zarr"
    process = start_held_map(file, 2, "--workers", "2")
    own = psutil.Process(process.pid)
    everyone = [own, *own.children(recursive=True)]
    listening = [
        c
        for one in everyone
        for c in one.net_connections("all")
        if c.status == "LISTEN" or (c.family.name == "AF_UNIX" and c.laddr)
    ]
    computing = [one for one in own.children() if "spawn_main" in " ".join(one.cmdline())]
    assert len(computing) == 2
    computing[0].kill()
    kept = marks(file)
    answer = _finished(process, "\n")
    assert listening == []
    assert answer["parts"]["computed"] == answer["parts"]["total"]
    assert len(kept) >= 2
    _same(file, whole[0])


def test_processes_end_with_the_one_that_started_them(tmp_path):
    process = start_held_map(tmp_path / "m.zarr", 2, "--workers", "1")
    workers = psutil.Process(process.pid).children(recursive=True)
    assert workers
    process.send_signal(signal.SIGKILL)
    process.communicate(timeout=600)
    _, alive = psutil.wait_procs(workers, timeout=600)
    assert not alive


def test_what_cannot_be_sent(tmp_path):
    elastic = arm().with_potential(JointFunction(energy=lambda q: 0.0))
    sampling = RandomPostures(8, 1, elastic.q - 0.1, elastic.q + 0.1)
    with pytest.raises(InputError, match="cannot be sent to other processes; expected functions"):
        compute_map(elastic, sampling, ["condition"], tmp_path / "m.zarr", workers=1)


def test_a_scheduler_that_does_not_answer(tmp_path):
    quickly = {"DASK_DISTRIBUTED__COMM__TIMEOUTS__CONNECT": "1s"}
    process = start_map(tmp_path / "m.zarr", "--scheduler", "tcp://127.0.0.1:1", **quickly)
    out, error = process.communicate(timeout=600)
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
