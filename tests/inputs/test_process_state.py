"""What belongs to the process, and not to a call: its streams, its umask."""

import os
import subprocess
import sys
from threading import Thread

import pytest
from tests.doors import write_whole

import cartstiff


def test_children_beside_a_load_keep_their_streams():
    """Forked and spawned while another thread reads a URDF: all write, none hangs."""
    code = """
import os, subprocess, sys, threading, cartstiff
cartstiff.load("five-bar")  # a module that is half imported stays so in a forked child
done = threading.Event()
def load():
    while not done.is_set():
        cartstiff.load("five-bar")
loading = threading.Thread(target=load)
loading.start()
for _ in range(10):
    if (child := os.fork()) == 0:
        cartstiff.load("five-bar")
        os.write(1, b"forked\\n")
        os._exit(0)
    os.waitpid(child, 0)
    subprocess.run(["echo", "spawned"], check=True)
done.set()
loading.join()
"""
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", code],
        capture_output=True,
        text=True,
        check=True,
        timeout=300,
    )
    assert sorted(done.stdout.split()) == ["forked"] * 10 + ["spawned"] * 10
    assert done.stderr == ""


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


@pytest.mark.parametrize(
    ("command", "package"), [("", "numpy.ma"), ("analyse ur5 --json", "scipy.spatial")]
)
def test_an_arm_brings_in_nothing_that_it_does_not_use(command, package):
    code = (
        "import sys, cartstiff; cartstiff.load('ur5')\n"
        f"sys.argv = ['cartstiff', *{command.split()}]\n"
        "from cartstiff.shown.cli.main import main\n"
        "try:\n    main()\nexcept SystemExit:\n    pass\n"
        f"sys.exit(str([m for m in ('{package}', 'matplotlib', 'trimesh', 'llvmlite', "
        "'tornado', 'pandas') if m in sys.modules]))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.stderr.splitlines()[-1] == "[]"
