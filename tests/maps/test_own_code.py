"""What a user's own code names belongs to the identity of a map."""

import importlib
import shutil
import sys
import threading

import pytest
from tests.doors import fingerprint
from tests.support.maps import BegunMap
from tests.support.robots import FOLDER

import cartstiff
from cartstiff import InputError
from cartstiff.extend import QUANTITIES, Quantity

MODULE = """
import functools, math
import numpy as np
import {other} as other
from {other} import helper
from cartstiff import DeadForce

FACTOR = 40
TABLE = {{"a": [1.0, 2.0]}}

def scaled(x):
    return x * 3.0

class Base:
    size = 5.0

class Caller(Base):
    gain = 6.0
    def __call__(self, x):
        return self.gain * x
    @property
    def more(self):
        return 7.0

class Own(DeadForce):
    def energy(self, posture):
        return 8.0

caller = Caller()

def constant(s): return FACTOR
def table(s): return TABLE["a"][0]
def by_helper(s): return scaled(s)
def imported(s): return helper(s)
def by_module(s): return other.deep(s)
def callable_object(s): return caller(s)
def local(s): return (lambda t: FACTOR)(s)
def closing(n):
    def inner(s): return n * scaled(s)
    return inner
closure = closing(2)
partial = functools.partial(scaled, 1.0)
method = caller.__call__
own = Own([0, 0, 1.0], [0, 0, 0])
def round_and_round(s): return back(s) if s else FACTOR
def back(s): return round_and_round(0)
"""
OTHER = "DEEP = 9.0\ndef deep(x): return DEEP * x\ndef helper(x): return deep(x) + 1\n"


def _loaded(folder, name, text, other=OTHER):
    (folder / f"{name}_other.py").write_text(other)
    (folder / f"{name}.py").write_text(text.format(other=f"{name}_other"))
    for known in (name, f"{name}_other"):
        sys.modules.pop(known, None)
    importlib.invalidate_caches()
    # Bytecode of an edit of the same length within a second would be that of before.
    kept, sys.dont_write_bytecode = sys.dont_write_bytecode, True
    try:
        return importlib.import_module(name)
    finally:
        sys.dont_write_bytecode = kept


@pytest.mark.parametrize(
    ("what", "old", "new"),
    [
        ("constant", "FACTOR = 40", "FACTOR = 400"),
        ("table", "[1.0, 2.0]", "[1.0, 2.5]"),
        ("by_helper", "x * 3.0", "x * 3.5"),
        ("imported", "deep(x) + 1", "deep(x) + 2"),
        ("by_module", "DEEP = 9.0", "DEEP = 90.0"),
        ("imported", "DEEP = 9.0", "DEEP = 90.0"),
        ("callable_object", "gain = 6.0", "gain = 60.0"),
        ("callable_object", "size = 5.0", "size = 50.0"),
        ("callable_object", "return 7.0", "return 70.0"),
        ("local", "FACTOR = 40", "FACTOR = 400"),
        ("closure", "x * 3.0", "x * 3.5"),
        ("closure", "closing(2)", "closing(3)"),
        ("partial", "x * 3.0", "x * 3.5"),
        ("method", "gain = 6.0", "gain = 60.0"),
        ("own", "return 8.0", "return 80.0"),
        ("round_and_round", "FACTOR = 40", "FACTOR = 400"),
    ],
)
def test_every_edit_is_seen(tmp_path, monkeypatch, what, old, new):
    monkeypatch.syspath_prepend(tmp_path)
    before = fingerprint(getattr(_loaded(tmp_path, "mine", MODULE), what))
    assert fingerprint(getattr(_loaded(tmp_path, "mine", MODULE), what)) == before
    edited, other = MODULE.replace(old, new), OTHER.replace(old, new)
    assert (edited, other) != (MODULE, OTHER)
    assert fingerprint(getattr(_loaded(tmp_path, "mine", edited, other), what)) != before
    spaced = "# a comment\n" + MODULE.replace("FACTOR = 40", "FACTOR  =  40")
    assert fingerprint(getattr(_loaded(tmp_path, "mine", spaced), what)) == before


GAIN = 40.0


def _scaled(source):
    return GAIN * source.ends()[0]


def test_a_map_of_another_constant_is_not_continued(tmp_path, monkeypatch):
    elastic = cartstiff.load("ur5")
    grid = cartstiff.maps.Grid({"elbow_joint": (0.1, 0.4, 4)}, elastic.names, elastic.q)
    monkeypatch.setitem(QUANTITIES, "mine", Quantity("mine", "mine", "1", _scaled, ("inverse",)))
    BegunMap(elastic, grid, ["mine"], tmp_path / "m.zarr")
    BegunMap(elastic, grid, ["mine"], tmp_path / "m.zarr")
    monkeypatch.setattr(f"{__name__}.GAIN", 400.0)
    with pytest.raises(InputError, match="another map: own quantities differs"):
        BegunMap(elastic, grid, ["mine"], tmp_path / "m.zarr")


LOCK = threading.Lock()


def _locked(source):
    with LOCK:
        return source


def test_what_cannot_be_covered_wants_a_version(monkeypatch):
    with pytest.raises(InputError, match=r"cannot be compared .* version=\"1\""):
        fingerprint(_locked)
    monkeypatch.setattr(_locked, "version", "1", raising=False)
    first = fingerprint(_locked)
    assert fingerprint(_locked) == first
    monkeypatch.setattr(_locked, "version", "2")
    assert fingerprint(_locked) != first


def test_comments_order_and_line_ends_are_no_changes(tmp_path):
    for name in ("five-bar.yaml", "five-bar.urdf"):
        shutil.copy(FOLDER / name, tmp_path)
    file, model = tmp_path / "five-bar.yaml", tmp_path / "five-bar.urdf"
    before = cartstiff.load(file).files
    text, xml = file.read_text(), model.read_text()
    import yaml

    blocks = yaml.safe_load(text)
    file.write_text("# more\r\n" + yaml.safe_dump(dict(reversed(blocks.items()))), newline="\r\n")
    model.write_text(xml.replace("<link", "<!-- a link -->\n  <link", 1), newline="\r\n")
    assert cartstiff.load(file).files == before
    model.write_text(xml.replace('<mass value="', '<mass value="9', 1))
    assert cartstiff.load(file).files != before
