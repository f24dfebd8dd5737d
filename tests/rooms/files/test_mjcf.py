"""MuJoCo's compiler in a process of its own."""

import random
import warnings

from tests.inner import reading as mjcf
from tests.inputs.mjcf_tool import compile_here, mutant, verdict
from tests.mechanisms.test_mjcf_meaning import FINGER, arm
from tests.support import refused

from cartstiff import load
from cartstiff.core.errors import MissingDependencyError


def test_without_mujoco_one_line_says_what_to_install(tmp_path, monkeypatch):
    path = arm(tmp_path)
    monkeypatch.setattr(mjcf.importlib.util, "find_spec", lambda name: None)
    refused(r"pip install 'cartstiff\[mjcf\]'", load, path, kind=MissingDependencyError)


def test_a_compiler_that_breaks_down_is_an_answer(tmp_path, monkeypatch):
    path = arm(tmp_path)
    worker = tmp_path / "worker.py"
    monkeypatch.setattr(mjcf.worker, "__file__", str(worker))
    for body, words in (
        ("import os; os.abort()", "signal SIGABRT"),
        ("import os, signal; os.kill(os.getpid(), signal.SIGXCPU)", "took too long"),
        ("raise SystemError('lost')", "lost"),
        ("print('{')", "broke down"),
    ):
        worker.write_text(body)
        refused(words, load, path)


def test_the_process_of_its_own_answers_as_this_one(tmp_path):
    path = arm(tmp_path, more=FINGER)
    apart = mjcf.compile_mjcf(path, "arm.xml")
    assert apart == compile_here(path, "arm.xml")


def test_changed_files_are_read_as_mujoco_reads_them_or_refused(tmp_path, monkeypatch):
    """A part of what tools/mjcf_against_mujoco.py does with thousands."""
    monkeypatch.setattr(mjcf, "compile_mjcf", compile_here)
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "mutant.xml"
    seen = set()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # MuJoCo's, on odd inertias
        for i in range(150):
            path.write_text(mutant(random.Random(f"test-{i}")), encoding="utf-8")
            kind, words = verdict(path, i)
            assert kind not in ("wrong", "broken"), f"{words}\n{path.read_text()}"
            seen.add(kind)
    assert {"same", "refused by both"} <= seen
