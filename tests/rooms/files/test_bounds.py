"""Bounds of what is read: those of the reference, and a process that means harm reaches nothing."""

import shutil
import socket
import subprocess
import sys
from pathlib import Path

import pytest
from tests.inner import (
    answer_of,
    chain,
    described,
    mesh_worker,
    meshes,
    messages,
    readers,
    sampling,
    tree,
    urdf,
    xacro_worker,
    yaml_file,
)
from tests.inner import loading_tables as tables
from tests.inner import map as map_request
from tests.inner import problem as effort
from tests.inner import reading as mjcf_data
from tests.inner import tables as target_file
from tests.inner import worker as mjcf_worker

HOSTILE = """
import os, socket, subprocess, sys
import numpy
from cartstiff.files.child_process import serve

def tried(act):
    try:
        act()
    except OSError as error:
        return type(error).__name__
    return "done"

def answer(port, marker):
    here, datagrams = ("127.0.0.1", port), socket.socket(type=socket.SOCK_DGRAM)
    return {
        "threads": len(os.listdir("/proc/self/task")),
        "udp": tried(lambda: datagrams.sendto(b"x", here)),
        "tcp": tried(lambda: socket.create_connection(here, 2)),
        "write": tried(lambda: open(marker, "w")),
        "program": tried(lambda: subprocess.run([sys.executable, "-c", f"open({marker!r}, 'w')"])),
    }

serve(answer, 500, 10)
"""

# What the machine offers, asked of a program that nobody here wrote.
UNSHARE = shutil.which("unshare")
HAS_NETWORKS = (
    bool(UNSHARE) and not subprocess.run([UNSHARE, "-rn", "true"], check=False).returncode
)


@pytest.mark.skipif(sys.platform != "linux", reason="limits are those of Linux")
@pytest.mark.skipif(not HAS_NETWORKS, reason="no network namespaces for this user")
def test_a_reader_reaches_no_network(tmp_path):
    worker, marker = tmp_path / "hostile.py", tmp_path / "marker"
    worker.write_text(HOSTILE, encoding="utf-8")
    with socket.socket(type=socket.SOCK_DGRAM) as heard, socket.socket() as listening:
        heard.bind(("127.0.0.1", 0))
        heard.settimeout(1)
        port = heard.getsockname()[1]
        listening.bind(("127.0.0.1", port))
        listening.listen()
        listening.settimeout(1)
        done = answer_of(str(worker), [port, str(marker)], "hostile.urdf", "the reader")
        with pytest.raises(TimeoutError):
            heard.recv(1)
        with pytest.raises(TimeoutError):
            listening.accept()
    assert done["threads"] == 1  # a user without rights gets a network only so
    assert "done" not in (done["udp"], done["tcp"])
    assert not marker.exists() or marker.stat().st_size == 0


def test_the_limits_are_those_of_the_reference():
    table = (Path(__file__).parents[3] / "docs/reference/limits.md").read_text(encoding="utf-8")
    assert yaml_file.LARGEST == tables.LARGEST == target_file._LARGEST == 1024**2
    assert mjcf_worker._MEGABYTES == 2048
    shown = {
        "1 GiB": map_request._LARGEST_FILE / 1024**3,
        "64 MiB": meshes._LARGEST / 1024**2,
        "64 MiB |": readers._MAX_BYTES / 1024**2,
        "40 000": yaml_file.MOST_VALUES,
        "| 200 |": tree.MOST_COORDINATES,
        "of which 200 move": urdf.MOST_MOVING,
        "2000, of": urdf._MAX_JOINTS,
        "| 100 |": chain._MOST_CLOSURES,
        "| 5000;": mjcf_data.LARGEST["nbody"],
        "5000; 20 000": mjcf_data.LARGEST["nsite"],
        "20 000;": mjcf_data.LARGEST["ngeom"],
        "1000 |": mjcf_data.LARGEST["nkey"],
        "8 s": mjcf_worker._SECONDS,
        "6 s": xacro_worker._SECONDS,
        "150 000": effort._MAX_SEARCH_COST,
        "at least 300 |": effort._MIN_POSTURES,
        "2 000 000": mesh_worker.MOST_CORNERS / 3,
        "10 000 000": sampling._MAX_AXIS_VALUES,
        "100 000": described.MAX_PARTS,
        "64 KiB": messages.LARGEST_MESSAGE / 1024,
    }
    for words, value in shown.items():
        assert words in table
        digits = "".join(c for c in words if c.isdigit())
        assert str(int(value)) in digits or digits.startswith(str(int(value))), words
