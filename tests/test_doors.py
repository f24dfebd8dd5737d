"""The core is used through its doors, which `doors.yaml` lists."""

from __future__ import annotations

import importlib
import inspect
import operator
import re
from pathlib import Path

import cartstiff
from tests import doors, inner, surface

#: Inner names that tests use; a lower number replaces it as public names serve instead.
MOST_INNER = 235
#: Files of tests that use them: those of the room itself, and the drivers in `support`.
MOST_FILES = 37
#: Modules beside `cartstiff` whose names everybody may use.
PUBLIC = {
    "cartstiff.core.errors",
    "cartstiff.__main__",
    *(f"cartstiff.{home}" for home in surface.HOMES),
}
_STUB = re.compile(r"^from \.([\w.]+) import (\w+)", re.MULTILINE)


def _is_used_at_home(door: str) -> bool:
    """Whether the file of a name uses it besides defining it."""
    module, _, name = door.rpartition(".")
    file = doors.PACKAGE.joinpath(*module.split(".")).with_suffix(".py")
    return file.exists() and len(re.findall(rf"\b{name}\b", file.read_text("utf-8"))) > 1


def test_no_import_passes_the_doors() -> None:
    assert not doors.strangers(), "use a door of the core, or make it one with a docstring"


def test_every_door_exists_and_says_what_it_is() -> None:
    for door in sorted(doors.doors()):
        module, _, name = f"cartstiff.{door}".rpartition(".")
        try:
            thing = getattr(importlib.import_module(module), name)
        except AttributeError:
            thing = importlib.import_module(f"{module}.{name}")
        speaks = inspect.isclass(thing) or inspect.isroutine(thing) or inspect.ismodule(thing)
        assert not speaks or (thing.__doc__ or "").strip(), f"{door} has no docstring"


def test_what_one_wing_alone_uses_stands_in_it() -> None:
    """Not what the core itself uses, too, nor what is public."""
    inside = {
        f"{module}.{name}".removeprefix("cartstiff.")
        for path in (doors.PACKAGE / "core").rglob("*.py")
        for module, name in doors.imported(path)
    }
    stubs = [path.read_text("utf-8") for path in doors.PACKAGE.glob("*.pyi")]
    public = {f"{m}.{n}" for text in stubs for m, n in _STUB.findall(text)}
    users: dict[str, set[str]] = {}
    for file, names in doors.uses().items():
        for name in names:
            users.setdefault(name, set()).add("/".join(Path(file).parts[:2]))
    alone = {
        name: rooms
        for name, rooms in users.items()
        if len(rooms) == 1 and next(iter(rooms)).startswith("wings/")
    }
    assert len(alone) > 5  # classes and constants of what the core defines for itself
    own = {name for name in alone.keys() - inside - public if _is_used_at_home(name)}
    shared = {"core.writing.create_folder"}  # it makes parts as `write_whole` does
    assert not alone.keys() - inside - public - own - shared


def test_an_import_inside_a_function_counts() -> None:
    inside = doors.PACKAGE / "files" / "postures.py"
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
        if f"{module}.{name}" not in PUBLIC
    }
    assert not found, "add the name to tests/inner.py, or use a public one"
    public = {id(operator.attrgetter(name)(cartstiff)) for name in surface.names()}
    listed = [home.partition("=")[0] for home in homes]
    assert [n for n in listed if id(getattr(inner, n)) in public] == [], "use its public name"
    used = {n for path in files for module, n in doors.imported(path) if module == "tests.inner"}
    assert set(listed) == used
    reaching = [p for p in files if any(module == "tests.inner" for module, _ in doors.imported(p))]
    assert len(reaching) <= MOST_FILES
