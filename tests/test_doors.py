"""The core is used through its doors: `doors.yaml` lists them, and the other imports of today."""

from __future__ import annotations

import importlib
import inspect
import operator
from pathlib import Path

import cartstiff
from tests import doors, inner, surface

#: Imports past the doors when the list was made; a lower number replaces it as they go.
MOST_STRANGERS = 129
#: Inner names that tests use; a lower number replaces it as public names serve instead.
MOST_INNER = 418
#: Files of tests that use them: those of the room itself, and the drivers in `support`.
MOST_FILES = 185
#: Modules beside `cartstiff` whose names everybody may use.
PUBLIC = {"cartstiff.core.errors", *(f"cartstiff.{home}" for home in surface.HOMES)}


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


def test_tests_import_public_names_or_what_inner_py_lists() -> None:
    """So a wall is moved with one line of `inner.py`, and no test with it."""
    homes = {home for names in inner.HOMES.values() for home in names.split()}
    assert len(homes) <= MOST_INNER
    folder = Path(inner.__file__).parent
    own = {folder / name for name in ("inner.py", "conftest.py", "surface.py")}
    files = sorted(set(folder.rglob("*.py")) - own)
    found = {
        f"{path.relative_to(folder)}: {module}.{name}"
        for path in files
        for module, name in doors.imported(path)
        if module.startswith("cartstiff.") and module not in PUBLIC
    }
    assert not found, "add the name to tests/inner.py, or use a public one"
    public = {id(operator.attrgetter(name)(cartstiff)) for name in surface.names()}
    listed = [home.partition("=")[0] for home in homes]
    assert [n for n in listed if id(getattr(inner, n)) in public] == [], "use its public name"
    used = {n for path in files for module, n in doors.imported(path) if module == "tests.inner"}
    assert set(listed) == used
    reaching = [p for p in files if any(module == "tests.inner" for module, _ in doors.imported(p))]
    assert len(reaching) <= MOST_FILES
