"""Docstrings say what is there: sections of public functions and classes match the code."""

from __future__ import annotations

import ast
import builtins
import doctest
import importlib
import re
from dataclasses import dataclass
from pathlib import Path

import pytest
from tests.docs.blocks import ROOT

import cartstiff.core.errors

SOURCES = ROOT / "src" / "cartstiff"
# In the order of numpydoc.
SECTIONS = [
    "Parameters",
    "Attributes",
    "Returns",
    "Yields",
    "Raises",
    "Warns",
    "See Also",
    "Notes",
    "References",
    "Examples",
]
ERRORS = {"DamageError"} | {  # that of cartstiff.wings.maps.store
    name
    for module in (builtins, cartstiff.core.errors)
    for name, value in vars(module).items()
    if isinstance(value, type) and issubclass(value, BaseException)
}

Function = ast.FunctionDef | ast.AsyncFunctionDef


@dataclass(frozen=True)
class Documented:
    """A public function or class, and its docstring's sections."""

    name: str
    node: Function | ast.ClassDef
    sections: dict[str, list[str]]


def sections_of(docstring):
    """Lines of each section, by title."""
    lines = docstring.splitlines()
    underlined = [i for i, line in enumerate(lines) if re.fullmatch(r"-{3,}", line)]
    starts = [i - 1 for i in underlined if i and lines[i - 1].strip()]
    ends = [*starts, len(lines)][1:]
    return {lines[a].strip(): lines[a + 2 : b] for a, b in zip(starts, ends, strict=True)}


def entries(lines):
    """Names that a section describes: unindented lines, up to their colon."""
    heads = [line.partition(" : ")[0] for line in lines if line.strip() and line[0] != " "]
    return [name.strip().lstrip("*") for head in heads for name in head.split(",")]


def public(tree, prefix):
    """Functions, classes and methods whose names have no underscore in front."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)):
            if node.name.startswith("_"):
                continue
            name = f"{prefix}.{node.name}"
            yield name, node
            if isinstance(node, ast.ClassDef):
                yield from public(node, name)


def documented():
    """Everything public in the package."""
    found = []
    for path in sorted(SOURCES.rglob("*.py")):
        if any(part.startswith("_") and part != "__init__.py" for part in path.parts[-2:]):
            continue
        module = ".".join(path.relative_to(SOURCES).with_suffix("").parts)
        for name, node in public(ast.parse(path.read_text(encoding="utf-8")), module):
            docstring = ast.get_docstring(node) or ""
            found.append(Documented(name, node, sections_of(docstring)))
    return found


EVERYTHING = documented()


def parameters(node):
    """Names of a function's parameters, without self and cls."""
    a = node.args
    several = [[p] if p else [] for p in (a.vararg, a.kwarg)]
    names = [p.arg for p in (*a.posonlyargs, *a.args, *several[0], *a.kwonlyargs, *several[1])]
    return [name for name in names if name not in ("self", "cls")]


def fields(node):
    """Names of what a class or its instances hold, as far as its own body shows it."""
    names = {
        t.target.id
        for t in node.body
        if isinstance(t, ast.AnnAssign) and isinstance(t.target, ast.Name)
    }
    names |= {n.name for n in node.body if isinstance(n, ast.FunctionDef)}
    names |= {
        t.id
        for n in node.body
        if isinstance(n, ast.Assign)
        for t in n.targets
        if isinstance(t, ast.Name)
    }
    for inner in ast.walk(node):
        if isinstance(inner, ast.Attribute) and getattr(inner.value, "id", "") == "self":
            names.add(inner.attr)
    return names


def initialiser(node):
    """Parameters of a class's own __init__, or None."""
    found = [n for n in node.body if isinstance(n, ast.FunctionDef) and n.name == "__init__"]
    return parameters(found[0]) if found else None


def names_api(node):
    """Whether a command takes words from functions of the API."""
    calls = [d for d in node.decorator_list if isinstance(d, ast.Call)]
    return any(k.arg == "api" for call in calls for k in call.keywords)


def test_something_is_read():
    assert len(EVERYTHING) > 400
    with_parameters = [d for d in EVERYTHING if "Parameters" in d.sections]
    assert len(with_parameters) > 60


def test_sections_have_known_names_in_the_usual_order():
    wrong = []
    for d in EVERYTHING:
        names = list(d.sections)
        if not set(names) <= set(SECTIONS) or names != sorted(names, key=SECTIONS.index):
            wrong.append(f"{d.name}: {names}")
    assert not wrong, wrong


def test_parameters_are_those_of_the_signature():
    """Where parameters are described at all, all that exist are, and no others."""
    wrong = []
    for d in EVERYTHING:
        if "Parameters" not in d.sections:
            continue
        told = entries(d.sections["Parameters"])
        there = initialiser(d.node) if isinstance(d.node, ast.ClassDef) else parameters(d.node)
        if there is None:  # a dataclass
            there = [n for n in told if n in fields(d.node)]
        if names_api(d.node):  # the API describes the others
            there = [n for n in there if n in told]
        if sorted(told) != sorted(there):
            wrong.append(f"{d.name}: describes {told}, takes {there}")
    assert not wrong, "\n".join(wrong)


def test_attributes_exist():
    wrong = []
    for d in EVERYTHING:
        if "Attributes" in d.sections and isinstance(d.node, ast.ClassDef):
            missing = set(entries(d.sections["Attributes"])) - fields(d.node)
            if missing and not d.node.bases:
                wrong.append(f"{d.name}: {sorted(missing)}")
    assert not wrong, "\n".join(wrong)


def test_raised_errors_exist():
    wrong = []
    for d in EVERYTHING:
        for name in entries(d.sections.get("Raises", [])):
            if name not in ERRORS:
                wrong.append(f"{d.name}: {name}")
    assert not wrong, "\n".join(wrong)


def test_functions_that_return_several_things_say_which():
    """Where a Returns section exists it names something."""
    empty = [
        d.name for d in EVERYTHING if "Returns" in d.sections and not entries(d.sections["Returns"])
    ]
    assert not empty, empty


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("One line.", {}),
        (
            "One.\n\nParameters\n----------\na, b : float\n    Two.\n*rest\n    More.\n",
            ["a", "b", "rest"],
        ),
    ],
)
def test_the_reader_of_sections(text, expected):
    found = sections_of(text)
    assert (entries(found["Parameters"]) if found else {}) == expected


def test_every_public_name_has_a_docstring():
    """What ruff's D rules ask of each file, asked of the package: none is exempt by name."""
    bare = [d.name for d in EVERYTHING if not ast.get_docstring(d.node)]
    overloads = [
        d.name
        for d in EVERYTHING
        if isinstance(d.node, ast.FunctionDef)
        and any("overload" in ast.dump(x) for x in d.node.decorator_list)
    ]
    assert set(bare) <= set(overloads), set(bare) - set(overloads)


def test_no_file_is_exempt_from_the_rules_for_docstrings():
    import tomllib

    lint = tomllib.loads(Path(ROOT / "pyproject.toml").read_text("utf-8"))["tool"]["ruff"]["lint"]
    assert "D" in lint["select"]
    assert lint["pydocstyle"]["convention"] == "numpy"
    exempt = lint["per-file-ignores"].items()
    assert not [p for p, rules in exempt if p.startswith("src") and any(r[0] == "D" for r in rules)]
    noqa = [
        p.name for p in SOURCES.rglob("*.py") if re.search(r"noqa:.*\bD\d", p.read_text("utf-8"))
    ]
    assert not noqa


@pytest.mark.parametrize(
    "path",
    [p for p in sorted(SOURCES.rglob("*.py")) if ">>> " in p.read_text(encoding="utf-8")],
    ids=lambda p: str(p.relative_to(SOURCES)),
)
def test_examples_in_docstrings_run(path):
    name = ".".join(("cartstiff", *path.relative_to(SOURCES).with_suffix("").parts))
    result = doctest.testmod(importlib.import_module(name), optionflags=doctest.ELLIPSIS)
    assert result.attempted > 0
    assert result.failed == 0
