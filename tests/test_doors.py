"""The core is used through its doors: `doors.yaml` lists them, and the other imports of today."""

from __future__ import annotations

import importlib
import inspect

from tests import doors

#: Imports past the doors when the list was made; a lower number replaces it as they go.
MOST_STRANGERS = 149


def test_no_new_import_passes_the_doors() -> None:
    known = doors.table()
    allowed = {(file, name) for file, names in known["allowed"].items() for name in names}
    found = {(file, name) for file, names in doors.strangers(known).items() for name in names}
    assert not found - allowed, "use a door of the core, or make it one with a docstring"
    gone = "these imports have gone: python tests/doors.py --write takes them off the list"
    assert not allowed - found, gone
    assert len(found) <= MOST_STRANGERS


def test_every_door_exists_and_says_what_it_is() -> None:
    for door in sorted(doors.doors(doors.table())):
        module, _, name = f"cartstiff.{door}".rpartition(".")
        try:
            thing = getattr(importlib.import_module(module), name)
        except AttributeError:
            thing = importlib.import_module(f"{module}.{name}")
        speaks = inspect.isclass(thing) or inspect.isroutine(thing) or inspect.ismodule(thing)
        assert not speaks or (thing.__doc__ or "").strip(), f"{door} has no docstring"


def test_an_import_inside_a_function_counts() -> None:
    inside = doors.PACKAGE / "loading" / "postures.py"
    assert any(module == "cartstiff.kinematics.joint_poses" for module, _ in doors.imported(inside))
