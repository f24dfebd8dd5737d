"""What belongs to the process, and not to a call: its streams, its umask."""

from __future__ import annotations

import os
import subprocess
import sys
from threading import Barrier, Thread

import pytest

import cartstiff
from cartstiff.loading.robot_description import quiet
from cartstiff.report.output import write_whole


def test_threads_leave_the_streams_as_they_were(capfd):
    barrier = Barrier(3)
    before = [os.fstat(1).st_ino, os.fstat(2).st_ino]

    def work(last):
        # Enter in one order and leave in another, as threads do.
        barrier.wait()
        with quiet():
            barrier.wait()
            os.write(1, b"lost")
            if last:
                barrier.wait()
        if not last:
            barrier.wait()

    threads = [Thread(target=work, args=(i == 2,)) for i in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert [os.fstat(1).st_ino, os.fstat(2).st_ino] == before
    os.write(1, b"seen\n")
    os.write(2, b"seen too\n")
    assert capfd.readouterr() == ("seen\n", "seen too\n")


def test_many_loads_at_once(capfd):
    errors = []

    def load():
        try:
            for _ in range(3):
                cartstiff.load("ur5")
        except BaseException as error:
            errors.append(error)

    threads = [Thread(target=load) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert errors == []
    os.write(1, b"seen\n")
    assert capfd.readouterr().out == "seen\n"


@pytest.mark.parametrize(("mask", "mode"), [(0o077, 0o600), (0o027, 0o640), (0o002, 0o664)])
def test_files_have_the_user_s_permissions(tmp_path, mask, mode):
    folder = tmp_path / "own"
    folder.mkdir()
    before = os.umask(mask)
    try:
        write_whole(folder / "new.json", b"{}")
    finally:
        os.umask(before)
    assert (folder / "new.json").stat().st_mode & 0o777 == mode
    assert [p.name for p in folder.iterdir()] == ["new.json"]


def test_loading_an_arm_brings_in_nothing_that_it_does_not_use():
    code = (
        "import sys, cartstiff; cartstiff.load('ur5'); sys.exit(str([m for m in ('numpy.ma', "
        "'matplotlib', 'trimesh', 'llvmlite', 'tornado', 'pandas') if m in sys.modules]))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.stderr.strip() == "[]"
