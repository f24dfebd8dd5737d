"""The promise is frozen: what users hold on to stands in a committed table, within bounds.

`python tests/surface.py --write` writes the table again; what is new shows in its diff.
"""

from __future__ import annotations

import ast
import inspect
import re
from collections.abc import Iterator

import pytest
import yaml

import cartstiff
from tests import surface
from tests.docs.blocks import ROOT, blocks_of, pages

#: Bounds on options, of which a command takes only what serves it: each pair may cross. `compare`
#: has the set-up, --output and --with: 21 occurrences and 210 pairs above 330 and 4400; --at-points
#: is an option of `report`.
MOST = {"different": 92, "occurrences": 353, "pairs": 4670, "pairs outside the set-up": 720}
COMMANDS = 15
#: Bound on the names of `cartstiff` itself.
NAMES = 64


@pytest.mark.parametrize("kind", surface.SURFACE)
def test_the_surface_is_that_of_the_table(kind: str) -> None:
    table = yaml.load(surface.TABLE.read_text(encoding="utf-8"), yaml.CSafeLoader)[kind]
    found = surface.SURFACE[kind]()
    if isinstance(found, dict):
        table = {f"{name} {one}" for name, some in table.items() for one in some}
        found = {f"{name} {one}" for name, some in found.items() for one in some}
    assert sorted(set(found) - set(table)) == [], "new: write the table again if it is meant"
    assert sorted(set(table) - set(found)) == [], "gone: write the table again if it is meant"


def test_options_stay_few() -> None:
    found = surface.options()
    counted = surface.counted(found)
    assert {what: n for what, n in counted.items() if n > MOST[what]} == {}
    assert len(found) <= COMMANDS


def test_pairs_are_counted() -> None:
    by_command = {"one": ["--json", "--load", "--x", "--y"], "two": ["--x"]}
    assert surface.counted(by_command) == {
        "different": 4,
        "occurrences": 5,
        "pairs": 6,
        "pairs outside the set-up": 1,
    }


def test_a_public_name_has_one_home() -> None:
    """Of all homes each object is in one; no name says two things, but for a home and its door."""
    found = surface.names()
    things = [
        getattr(getattr(cartstiff, home) if home else cartstiff, name)
        for home, _, name in (one.rpartition(".") for one in found)
    ]
    assert len({id(thing) for thing in things}) == len(found)
    last = [one.rpartition(".")[2] for one in found]
    assert sorted({name for name in last if last.count(name) > 1}) == ["identify"]
    assert len(cartstiff.__all__) <= NAMES


def test_every_plot_takes_axes() -> None:
    """Those of public classes, so that a user puts several pictures into one figure."""
    homes = [cartstiff, *(getattr(cartstiff, home) for home in surface.HOMES)]
    things = [getattr(home, name) for home in homes for name in home.__all__]
    plots = [thing.plot for thing in things if isinstance(thing, type) and hasattr(thing, "plot")]
    assert len(plots) > 8
    assert [p.__qualname__ for p in plots if "ax" not in inspect.signature(p).parameters] == []


def test_every_name_of_the_package_stands_in_the_reference() -> None:
    page = (ROOT / "docs" / "api" / "index.rst").read_text("utf-8")
    assert [n for n in surface.names() if "." not in n and not re.search(rf"\b{n}\b", page)] == []
    listed = re.search(r"public-names:: (.*)", page)
    assert listed is not None
    assert tuple(listed[1].split()) == surface.HOMES


def _codes() -> Iterator[tuple[str, str]]:
    """Place and text of the code in pages, examples and answers of cases."""
    for page in pages():
        for block in blocks_of(page.read_text("utf-8")):
            if block.language == "python":
                yield f"{page.name}, line {block.line}", block.text
    for pattern in ("examples/*.py", "cases/*/answer.py"):
        for path in ROOT.glob(pattern):
            yield str(path.relative_to(ROOT)), path.read_text("utf-8")


def _used(text: str) -> Iterator[str]:
    """Imports of the package in a text, and what is taken from it by a dot, without its name."""
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.ImportFrom):
            module, _, home = (node.module or "").partition(".")
            if module == "cartstiff":
                yield from (f"{home}.{alias.name}".lstrip(".") for alias in node.names)
        elif isinstance(node, ast.Import):
            inner = (alias.name.partition(".") for alias in node.names)
            yield from (home for module, _, home in inner if module == "cartstiff" and home)
        elif isinstance(node, ast.Attribute) and ast.unparse(node.value) == "cartstiff":
            yield node.attr


def test_docs_and_examples_use_public_homes_only() -> None:
    public, codes = set(surface.names()), list(_codes())
    found = [(place, name) for place, text in codes for name in _used(text)]
    assert [pair for pair in found if pair[1] not in public] == []
    assert len(found) > 300
    assert list(_used("from cartstiff.a.b import C\nimport cartstiff\ncartstiff.d.e")) == [
        "a.b.C",
        "d",
    ]
