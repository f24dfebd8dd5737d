"""Imports point one way, heavy packages stay where they belong, importing costs nothing."""

from __future__ import annotations

import ast
import io
import json
import re
import subprocess
import sys
import tokenize
from bisect import bisect, bisect_left
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

import cartstiff
from tests.doors import tree
from tests.surface import HOMES

PACKAGE = Path(cartstiff.__file__).parent

#: Rooms from the ground up; a file may import from its own room and from those below.
ROOMS = ("core", "kinematics", "files", "answer", "recorded", "wings", "shown")
#: What is between the rooms: public names and the start of the program.
DOORS = {"__main__", "extend", "version", *HOMES}
#: Parts of rooms, from the bottom up; files that stand between the parts are named one by one.
PARTS = {
    "core": [
        {"choices", "errors", "lazily", "matrix_names", "numerics"},
        {"arrays", "figures", "notebook"},
        {"checked_call", "described", "notes", "units", "writing"},
        {"results"},
        {"geometry"},
        {"potentials"},
        {"mechanisms"},
        {"stiffness"},
        {"statics"},
    ],
    "shown": [{"report", "scene"}, {"page"}, {"cli"}],
    # None uses another.
    "wings": [{"maps", "toolpaths", "reach", "identify"}],
}

#: Who alone may import what.
OWNERS = {
    "pinocchio": {("core", "mechanisms"), "files"},
    "meshcat": {("shown", "scene"), ("shown", "page")},
}
#: Most tokens of the core.
MOST_OF_CORE = 135_000
#: Packages that neither `import cartstiff` nor `--help` may load.
HEAVY = ("numpy", "pinocchio", "scipy", "matplotlib", "tornado", "meshcat")


def _modules() -> Iterator[tuple[tuple[str, ...], Path]]:
    """Place in the package, as ("core", "geometry", "se3"), and file, for each module."""
    for path in sorted(PACKAGE.rglob("*.py")):
        place = path.relative_to(PACKAGE).with_suffix("").parts
        yield place[:-1] if place[-1] == "__init__" else place, path


@cache
def _imports(path: Path) -> list[tuple[int, str]]:
    return list(_walk_imports(path))


def _walk_imports(path: Path) -> Iterator[tuple[int, str]]:
    """Every imported module with its line, wherever in the file it stands."""
    inside = ["cartstiff", *path.relative_to(PACKAGE).with_suffix("").parts]
    for node in ast.walk(tree(path)):
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield node.lineno, alias.name
        elif isinstance(node, ast.ImportFrom):
            base = inside[: len(inside) - node.level] if node.level else []
            module = ".".join([*base, *([node.module] if node.module else [])])
            yield node.lineno, module
            for alias in node.names:
                yield node.lineno, f"{module}.{alias.name}"


MODULES = list(_modules())


def _levels(place: tuple[str, ...]) -> tuple[int, int, str]:
    """Floor of the room, floor of the part in it, and the part."""
    room = ROOMS.index(place[0])
    part = place[1] if len(place) > 1 else ""
    floors = PARTS.get(place[0], [])
    level = next((i for i, parts in enumerate(floors) if part in parts), -1)
    return room, level, part if floors else ""


def _inner() -> Iterator[tuple[str, tuple[str, ...], tuple[str, ...]]]:
    """Each import of a module of ours by another: line, who, what."""
    for place, path in MODULES:
        if not place or place[0] in DOORS:
            continue
        for line, module in _imports(path):
            other = tuple(module.split(".")[1:])
            if module.partition(".")[0] == "cartstiff" and other:
                yield f"{path.relative_to(PACKAGE)}:{line}", place, other


def test_every_file_has_its_room():
    rooms = {place[0] for place, _ in MODULES if place} - DOORS
    assert rooms == set(ROOMS)
    for room, floors in PARTS.items():
        parts = {place[1] for place, _ in MODULES if place[:1] == (room,) and len(place) > 1}
        assert parts == set().union(*floors), room


def test_imports_point_one_way():
    """From room to room, and from part to part within a room; public names are for users."""
    wrong, seen = [], 0
    for where, place, other in _inner():
        if other[0] == "version":
            continue
        seen += 1
        if other[0] in DOORS:
            wrong.append(f"{where}: {other[0]} is for users")
            continue
        room, level, part = _levels(place)
        other_room, other_level, other_part = _levels(other)
        if other_room > room or (
            other_room == room and part != other_part and other_part and other_level >= level
        ):
            wrong.append(f"{where}: must not import {'.'.join(other)}")
    assert seen > 2000
    assert not wrong, "\n".join(wrong)


def test_the_core_imports_nothing_of_ours_outside_itself():
    """Not even in functions: what it says is true without the rest."""
    outside = [
        f"{where}: {other}" for where, place, other in _inner() if place[0] == "core" != other[0]
    ]
    assert not outside


def test_no_wing_uses_another():
    others = [
        f"{where}: {'.'.join(other)}"
        for where, place, other in _inner()
        if place[:1] == ("wings",) == other[:1] and len(place) > 1 and place[1:2] != other[1:2]
    ]
    assert not others


def test_the_core_is_read_in_an_afternoon():
    sizes = [_size(path) for place, path in MODULES if place[:1] == ("core",)]
    assert sum(sizes) <= MOST_OF_CORE, sum(sizes)


def _circles(needs: dict[str, set[str]]) -> list[set[str]]:
    """Modules that need each other, by what each needs."""
    reached = {name: set(others) for name, others in needs.items()}
    changed = True
    while changed:
        changed = False
        for found in reached.values():
            more = set().union(*(reached[name] for name in found)) - found
            found |= more
            changed = changed or bool(more)
    circles = {
        frozenset(other for other in found if name in reached[other])
        for name, found in reached.items()
        if name in found
    }
    return sorted(map(set, circles), key=sorted)


#: The package's modules by name.
FILES = {
    ".".join(("cartstiff", *path.relative_to(PACKAGE).with_suffix("").parts)).removesuffix(
        ".__init__"
    ): path
    for _, path in MODULES
}


@cache
def _needs() -> dict[str, set[str]]:
    """Modules that each module imports, within functions and for the type checker as well."""
    return {
        name: {module for _, module in _imports(path)} & set(FILES) - {name}
        for name, path in FILES.items()
    }


def test_no_file_needs_itself():
    files = {name for name, path in FILES.items() if path.name != "__init__.py"}
    needs = {name: found & files for name, found in _needs().items() if name in files}
    assert needs["cartstiff.core.geometry.charts"] >= {"cartstiff.core.geometry.se3"}
    assert _circles({"a": {"b"}, "b": {"c"}, "c": {"b"}}) == [{"b", "c"}]
    assert not _circles(needs)


#: The page that says what is where.
ARCHITECTURE = PACKAGE.parents[1] / "docs" / "architecture.md"


def _named_in(path):
    """Names that a file defines: of the module, and of its classes as ``Class.name``."""
    found = set()
    for node in tree(path).body:
        inner = node.body if isinstance(node, ast.ClassDef) else ()
        name = getattr(node, "name", "")
        found |= {name} | {f"{name}.{one.name}" for one in inner if hasattr(one, "name")}
        targets = [*getattr(node, "targets", ()), getattr(node, "target", None)]
        found |= {target.id for target in targets if isinstance(target, ast.Name)}
    return found


def test_each_question_leads_to_a_name():
    """A reader finds the place in two hops: the page, the file."""
    page = ARCHITECTURE.read_text(encoding="utf-8")
    table = page.partition("## Where is it?")[2].partition("\n## ")[0]
    rows = re.findall(r"^\| .*\? \| `([\w/]+\.py)` \| `([\w.]+)` \|$", table, re.MULTILINE)
    assert len(rows) >= 25
    assert len(rows) == table.count("\n| ") - 1  # all but the head
    assert not [(file, name) for file, name in rows if name not in _named_in(PACKAGE / file)]


def test_files_named_on_the_page_exist():
    page = ARCHITECTURE.read_text(encoding="utf-8")
    named = re.findall(r"`((?:\w+/)*\w+\.py)`", page)
    roots = (PACKAGE, PACKAGE.parents[1])
    assert len(named) > 40
    assert not [name for name in named if not any((root / name).exists() for root in roots)]
    steps = page.partition("in this order")[2].partition("## Where")[0]
    assert len(re.findall(r"^\d+\. `[\w/]+\.py`: \S", steps, re.MULTILINE)) == 24


def test_heavy_packages_have_owners():
    wrong = []
    for place, path in MODULES:
        for line, module in _imports(path):
            owners = OWNERS.get(module.partition(".")[0])
            if owners is not None and owners.isdisjoint({place[:1][0] if place else "", place[:2]}):
                wrong.append(f"{path.relative_to(PACKAGE)}:{line}: imports {module}")
    assert not wrong, "\n".join(wrong)


def test_the_reader_of_imports_sees_them():
    """The walker finds imports inside functions and relative ones."""
    found = {m for _, m in _imports(PACKAGE / "core" / "potentials" / "spring_laws.py")}
    assert "cartstiff.core.errors" in found
    found = {m for p, f in MODULES if p[:2] == ("core", "potentials") for _, m in _imports(f)}
    assert "scipy.interpolate" in found  # imported inside a function
    names = {m for p, f in MODULES if p[:2] == ("core", "mechanisms") for _, m in _imports(f)}
    assert "pinocchio" in names


def test_import_is_light():
    """In a fresh interpreter: nothing heavy comes along with the package or a command's --help."""
    code = (
        "import sys, json; from importlib import import_module; before = set(sys.modules); "
        "from cartstiff.shown.cli.main import _COMMANDS; "
        "[import_module(module) for module, _ in _COMMANDS.values()]; "
        "print(json.dumps(sorted(set(sys.modules) - before)))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        check=True,
        env={"PYTHONPATH": str(PACKAGE.parent)},
    )
    loaded = {name.split(".")[0] for name in json.loads(done.stdout)}
    assert "cartstiff" in loaded
    assert loaded.isdisjoint(HEAVY), sorted(loaded & set(HEAVY))


def modules_and_models(name):
    """Modules that a first answer imports, and models of files that it builds."""
    code = (
        "import sys, json; from cartstiff.shown.cli.main import main\n"
        f"try: main(['analyse', {str(name)!r}, '--json'])\n"
        "except SystemExit: pass\n"
        "modules = sorted(sys.modules)\n"
        "from cartstiff.files import schema\n"
        "models = [m.__name__ for m in schema._models(schema.FileModel)\n"
        "          if m.__pydantic_complete__]\n"
        "print(json.dumps([modules, models]))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return json.loads(done.stdout.splitlines()[-1])


def test_a_posture_without_a_load_starts_with_little(tmp_path):
    """Neither page nor searches nor words are loaded, no models where the file needs none, and
    else those that the file has."""
    pytest.importorskip("example_robot_data")
    modules, models = modules_and_models("ur5")
    assert models == []
    assert "pydantic" not in modules
    file = tmp_path / "arm.yaml"
    file.write_text("kind: serial\nmodel: ur5\npassive: []\nlocked: {elbow_joint: 1.0}\n")
    assert {"SerialFile"} == set(modules_and_models(file)[1])
    needless = ("cartstiff.shown.page", "cartstiff.shown.scene", "cartstiff.shown.report.analysis")
    needless += (
        "cartstiff.core.statics",
        "cartstiff.recorded.tape",
        "cartstiff.recorded.recording",
    )
    needless += ("scipy", "ruamel", "tornado", "pydantic.type_adapter", "subprocess")
    needless += ("cartstiff.answer.analysis.congruence", "cartstiff.answer.analysis.deflection")
    needless += ("cartstiff.core.potentials.loads", "cartstiff.core.potentials.line_springs")
    needless += ("cartstiff.core.mechanisms.identified", "cartstiff.core.mechanisms.shapes")
    needless += ("cartstiff.kinematics.leg_shapes", "cartstiff.files.findings")
    assert [m for m in modules if m.startswith(needless)] == []


def test_names_of_the_package_load_when_used():
    for name in cartstiff.__all__:
        assert getattr(cartstiff, name) is not None
    assert set(cartstiff.__all__) <= set(dir(cartstiff))
    with pytest.raises(AttributeError, match="nonsense"):
        _ = cartstiff.nonsense


def test_a_module_that_a_public_module_names_loads_first_of_all():
    code = "from cartstiff.geometry import se3; print(se3.__name__)"
    subprocess.run([sys.executable, "-c", code], capture_output=True, check=True)


def test_slow_tests_that_are_left_out_exist():
    folder = Path(__file__).parent
    lines = (folder / "thorough.txt").read_text("utf-8").splitlines()
    for test in {line.partition("[")[0] for line in lines if line and not line.startswith("#")}:
        file, _, name = test.partition("::")
        text = (folder.parent / file).read_text("utf-8")
        assert re.search(rf"^ *(?:def|class) {name.rpartition('::')[2]}\b", text, re.M) or (
            name.endswith("::runTest") and f"{name.partition('::')[0]} =" in text
        ), test


def test_a_posture_passes_the_packages_of_the_page():
    """The trip on the page is the one that the command takes."""
    pytest.importorskip("example_robot_data")
    page = (PACKAGE.parents[1] / "docs" / "architecture.md").read_text(encoding="utf-8")
    table = page.partition("## The trip of a posture")[2].partition("\n## ")[0]
    command = re.search(r"`cartstiff (analyse [^`]*)`", table)
    code = (
        "import inspect, sys, json; from pathlib import Path; import cartstiff\n"
        "from cartstiff.shown.cli.main import main\n"
        "base, seen = Path(cartstiff.__file__).parent, set()\n"
        "def see(frame, event, _):\n"
        "    file, flags = frame.f_code.co_filename, frame.f_code.co_flags\n"
        "    if flags & inspect.CO_OPTIMIZED and file.startswith(str(base)):\n"
        "        seen.add('/'.join(Path(file).relative_to(base).parts[:-1]))\n"
        "sys.setprofile(see)\n"
        f"try: main({command[1].split()!r})\n"
        "except SystemExit: sys.setprofile(None)\n"
        "print(json.dumps(sorted(seen - {'', 'core'})))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    visited = json.loads(done.stdout.splitlines()[-1])
    assert visited == sorted(re.findall(r"^\| `([\w/]+)` \|", table, re.MULTILINE))


def test_texts_and_pages_hardly_decide():
    """What a posture is said to be is decided in the answer; renderers have tables of words."""
    trees = (
        tree(path)
        for part in ("report", "page")
        for path in (PACKAGE / "shown" / part).rglob("*.py")
    )
    assert sum(isinstance(node, ast.IfExp) for parsed in trees for node in ast.walk(parsed)) <= 200


def test_conditional_expressions_fit_a_line():
    """Both sides are short; what is longer is a statement, a table or a small function."""
    long = [
        f"{path.relative_to(PACKAGE)}:{node.lineno}"
        for path in PACKAGE.rglob("*.py")
        for node in ast.walk(tree(path))
        if isinstance(node, ast.IfExp) and node.end_lineno != node.lineno
    ]
    assert not long


#: No word to be read, or a word to a tool.
_NOT_READ = {
    *(tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT),
    *(tokenize.ENCODING, tokenize.ENDMARKER),
}
_TO_TOOLS = re.compile(r"#\s*(noqa|type:|fmt:)")


def _lines_of_tokens(text: str) -> tuple[list[int], list[int]]:
    """Lines of the tokens that are read, and those of comments, both rising."""
    read, comments = list[int](), list[int]()
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type == tokenize.COMMENT:
            if not _TO_TOOLS.match(token.string):
                comments.append(token.start[0])
        elif token.type not in _NOT_READ:
            read.append(token.start[0])
    return read, comments


#: Most tokens of the files that the core's `analyse` needs.
MOST_OF_ANALYSE = 70_000


def _size(path: Path) -> int:
    """Tokens of a file without comments and docstrings."""
    read, _ = _lines_of_tokens(path.read_text("utf-8"))
    said = {
        line
        for node in ast.walk(tree(path))
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef)
        and ast.get_docstring(node) is not None
        for line in range(node.body[0].lineno, node.body[0].end_lineno + 1)
    }
    return sum(line not in said for line in read)


def test_one_posture_is_understood_from_few_files():
    """All that `analyse` needs by imports, wherever they stand, its own file among them."""
    (start,) = (name for name in FILES if name.endswith(".stiffness.compute"))
    needed, left = set(), {start}
    while left:
        needed |= left
        left = set().union(*map(_needs().get, left)) - needed
    sizes = {name: _size(FILES[name]) for name in needed}
    listed = "\n".join(f"{sizes[name]:6} {name}" for name in sorted(sizes, key=sizes.get))
    assert sum(sizes.values()) <= MOST_OF_ANALYSE, f"{sum(sizes.values())} tokens\n{listed}"
    unneeded = ("beams", "line_springs", "joint_springs", "spring_laws", "coupled_joints", "tree")
    assert not [name for name in needed if name.endswith(unneeded)], "a kind answers by methods"


def test_long_functions_say_what_their_parts_do():
    """One comment at least in every function above 300 tokens, two above 600, and so on."""
    silent = []
    for path in PACKAGE.rglob("*.py"):
        read, comments = _lines_of_tokens(path.read_text("utf-8"))
        for node in ast.walk(tree(path)):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                size = bisect(read, node.end_lineno) - bisect_left(read, node.lineno)
                if ast.get_docstring(node) is not None:
                    size -= 1  # its docstring is one token
                said = bisect(comments, node.end_lineno) - bisect_left(
                    comments, node.body[0].lineno
                )
                if said < (size - 1) // 300:
                    silent.append(f"{path.relative_to(PACKAGE)}:{node.name} {size}")
    assert not silent
