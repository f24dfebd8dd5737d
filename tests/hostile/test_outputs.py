"""Files are written whole or not at all, where they are, as they are, and leave nothing behind."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from tests.doors import create_folder, write_whole

from cartstiff import InputError, StiffnessTensor
from cartstiff.geometry import CARTAN_MINUS


def listed(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_a_link_is_followed(tmp_path: Path) -> None:
    real = tmp_path / "elsewhere" / "real.json"
    real.parent.mkdir()
    link = tmp_path / "link.json"
    link.symlink_to("elsewhere/real.json")
    for data in (b"new", b"old file, new data"):  # where it leads to nothing, and to a file
        write_whole(link, data)
        assert link.is_symlink()
        assert real.read_bytes() == data
    round_ = tmp_path / "round"
    round_.symlink_to("round")
    with pytest.raises(InputError, match="cannot be written"):
        write_whole(round_, b"x")


def test_permissions_stay_and_protect(tmp_path: Path) -> None:
    file = tmp_path / "mine.json"
    file.write_bytes(b"old")
    for mode in (0o600, 0o664):
        file.chmod(mode)
        write_whole(file, b"new")
        assert file.stat().st_mode & 0o777 == mode
    file.chmod(0o444)
    with pytest.raises(
        InputError, match=r"mine\.json: file cannot be written, got the file is rea"
    ):
        write_whole(file, b"newer")
    assert file.read_bytes() == b"new"
    assert listed(tmp_path) == ["mine.json"]


def test_a_pipe_and_a_device_stay_what_they_are(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe.json"
    os.mkfifo(pipe)
    read = list[bytes]()
    reader = threading.Thread(target=lambda: read.append(pipe.read_bytes()))
    reader.start()
    write_whole(pipe, b"through")
    reader.join()
    assert read == [b"through"]
    assert pipe.is_fifo()
    write_whole(Path("/dev/null"), b"away")
    assert Path("/dev/null").is_char_device()
    with pytest.raises(InputError, match="No space left"):
        write_whole(Path("/dev/full"), b"x" * 100_000)


@pytest.mark.parametrize(
    "begun",
    [
        "os.write(w._new_part(pathlib.Path('.'), w._new_file)[1], b'half'); held()",
        "w.create_folder(pathlib.Path('m'), lambda n: [(n / 'half').write_text('x'), held()])",
    ],
)
def test_what_a_killed_process_left_is_removed_by_the_next_one(tmp_path: Path, begun: str) -> None:
    code = (
        "import cartstiff.core.writing as w, os, signal, pathlib\n"
        "def held():\n"
        "    print('there', flush=True)\n"
        "    signal.pause()\n" + begun
    )
    with subprocess.Popen(
        [sys.executable, "-c", code], cwd=tmp_path, stdout=subprocess.PIPE, text=True
    ) as writer:
        assert writer.stdout is not None
        assert writer.stdout.readline() == "there\n"
        write_whole(tmp_path / "a.json", b"1")
        assert len(listed(tmp_path)) == 2  # the other one is still writing
        writer.kill()
    strangers = [".cartstiff-notes.txt", ".cartstiff-notes"]
    (tmp_path / strangers[0]).touch()
    (tmp_path / strangers[1]).mkdir()
    write_whole(tmp_path / "a.json", b"2")
    assert listed(tmp_path) == [*sorted(strangers), "a.json"]


def test_a_folder_of_somebody_else_stays(tmp_path: Path) -> None:
    place = tmp_path / "m.zarr"

    def fill(new: Path) -> None:
        (new / "mine").touch()
        place.mkdir()
        (place / "theirs").touch()

    create_folder(place, fill)
    assert listed(tmp_path) == ["m.zarr"]
    assert listed(place) == ["theirs"]


def test_many_writers_of_one_file(tmp_path: Path) -> None:
    file = tmp_path / "a.json"
    contents = [bytes([65 + i]) * 50_000 for i in range(8)]

    def write(data: bytes) -> None:
        for _ in range(20):
            write_whole(file, data)

    threads = [threading.Thread(target=write, args=(data,)) for data in contents]
    for thread in threads:
        thread.start()
    while any(thread.is_alive() for thread in threads):
        assert not file.exists() or file.read_bytes() in contents
    assert listed(tmp_path) == ["a.json"]


@pytest.mark.parametrize("ending", [".json", ".csv", ".npz"])
def test_a_tensor_is_saved_whole(tmp_path: Path, ending: str) -> None:
    tensor = StiffnessTensor(np.diag(np.arange(1.0, 7.0)), CARTAN_MINUS, np.zeros(6), np.eye(4))
    file = tmp_path / f"K{ending}"
    tensor.save(file)
    before = file.read_bytes()
    assert len(before) > 100
    file.chmod(0o400)
    with pytest.raises(InputError, match="file cannot be written"):
        tensor.save(file)
    assert file.read_bytes() == before


_WRITERS = [
    "report ur5 --load 0,0,0,0,0,-100 -o out.html",
    "export ur5 -o out.html",
    "analyse ur5 -o out.json",
]


@pytest.mark.thorough
@pytest.mark.parametrize("words", _WRITERS)
def test_a_killed_command_leaves_the_old_file_or_the_new_one(tmp_path: Path, words: str) -> None:
    name = words.split()[-1]
    command = [sys.executable, "-m", "cartstiff", *words.split()]
    start = time.monotonic()
    subprocess.run(command, cwd=tmp_path, check=True, capture_output=True)
    whole = (tmp_path / name).read_bytes()
    took = time.monotonic() - start
    for share in np.linspace(0.5, 1.05, 12):
        (tmp_path / name).write_bytes(b"old")
        running = subprocess.Popen(
            command, cwd=tmp_path, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        try:
            running.wait(share * took)
        except subprocess.TimeoutExpired:
            running.send_signal(signal.SIGKILL)
            running.wait()
        there = (tmp_path / name).read_bytes()
        assert there == b"old" or len(there) > 0.9 * len(whole)
    subprocess.run(command, cwd=tmp_path, check=True, capture_output=True)
    assert listed(tmp_path) == [name]


def test_an_interrupt_while_it_starts_is_silent() -> None:
    """The imports of the command line are where an early Ctrl-C arrives."""
    code = (
        "import os, runpy, signal, sys\n"
        "class Interrupt:\n"
        "    def find_spec(self, name, path=None, target=None):\n"
        "        if name == 'cartstiff.shown.cli.output':\n"
        "            os.kill(os.getpid(), signal.SIGINT)\n"
        "sys.meta_path.insert(0, Interrupt())\n"
        "runpy.run_module('cartstiff', run_name='__main__')\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (-signal.SIGINT, "", "")
