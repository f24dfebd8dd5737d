"""What the process that reads a stranger's file is refused, tried by a reader that means harm."""

import shutil
import socket
import subprocess
import sys

import pytest
from tests.inner import answer_of

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
