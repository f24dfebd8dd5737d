"""Odd files, counts and streams end in one line, not in a hang or an internal error."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import cartstiff

UR5 = ("analyse", "ur5", "--target")


def _run(*words, before="", **options):
    source = str(Path(cartstiff.__file__).parents[1])
    code = (
        f"import os, sys; {before}\nfrom cartstiff.shown.cli.main import main\nmain(sys.argv[1:])"
    )
    return subprocess.run(
        [sys.executable, "-c", code, *words],
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
        env={**os.environ, "PYTHONPATH": source, "OMP_NUM_THREADS": "1"},
        **options,
    )


def _refused(done, words):
    assert done.returncode == 2, done.stderr
    assert done.stderr.count("\n") == 1
    assert words in done.stderr


def _files(folder):
    (folder / "zip.npy").write_bytes(b"PK\x03\x04 no archive")
    header = (
        "{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000000,), }".ljust(117) + "\n"
    )
    (folder / "huge.npy").write_bytes(b"\x93NUMPY\x01\x00" + b"\x76\x00" + header.encode() + b"12")
    # A header without an end: NumPy hands it to Python's tokenizer.
    (folder / "open.npy").write_bytes(b"\x93NUMPY\x01\x00\x13\x00{'descr': ('<f8', (")
    np.savez(folder / "archive", matrix=np.eye(6))
    (folder / "archive.npz").rename(folder / "archive.npy")
    (folder / "integers.json").write_text(json.dumps([[10**400] * 6] * 6))
    (folder / "truth.json").write_text(json.dumps([[True] * 6] * 6))
    (folder / "text.json").write_text(json.dumps([["1"] * 6] * 6))
    (folder / "deep.json").write_text("[" * 100_000)
    (folder / "bytes.csv").write_bytes(b"\xff\xfe" * 40)
    return sorted(p for p in folder.iterdir() if p.suffix in (".npy", ".json", ".csv"))


def test_targets_that_are_none(tmp_path, refused):
    folder = tmp_path / "own"
    folder.mkdir()
    for path in _files(folder):
        refused(*UR5, path, words=("does not hold a matrix; expected a 6x6 matrix of numbers",))
    os.mkfifo(folder / "pipe.json")
    _refused(_run(*UR5, str(folder / "pipe.json")), "is not a regular file")
    refused(*UR5, folder / "none.json", words=("file cannot be read",))


@pytest.mark.parametrize("closed", ["1", "2", "1, 2"])
def test_closed_streams(closed, tmp_path):
    """Nobody listens: the work is done, and its file holds nothing that was meant for a stream."""
    file = tmp_path / "r.json"
    before = f"[os.close(n) for n in ({closed},)]"
    before += f"; sys.stdout = sys.stdout if 1 not in ({closed},) else None"
    before += f"; sys.stderr = sys.stderr if 2 not in ({closed},) else None"
    done = _run("analyse", "cubic", "-o", str(file), before=before)
    assert done.returncode == 0
    assert json.loads(file.read_text())["mechanism"]["name"] == "cubic"
