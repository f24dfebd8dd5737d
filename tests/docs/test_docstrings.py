"""Docstrings say what is there: sections of public functions and classes match the code."""

from __future__ import annotations

import ast
import builtins
import dataclasses
import doctest
import importlib
import inspect
import re
import sys
import textwrap
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from operator import attrgetter
from pathlib import Path
from typing import Any, NamedTuple

import pytest
from tests import surface
from tests.docs.blocks import ROOT

import cartstiff
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


# -- what public names say -------------------------------------------------------------------

CONVENTIONS = re.split(r"^## ", (ROOT / "docs/conventions.md").read_text("utf-8"), flags=re.M)


def rows_of(title):
    """Cells of a table of the conventions, without its head."""
    text = next(part for part in CONVENTIONS if part.startswith(title))
    return re.findall(r"^\| (.*?) \| (.*?) \|$", text, re.M)[1:]


#: Names of parameters that mean the same everywhere.
KNOWN = {
    name: meaning
    for names, meaning in rows_of("Names of parameters")
    for name in re.findall(r"`(\w+)`", names)
}
#: A shape such as (..., 6, n), or that of a tuple.
SHAPE = re.compile(r"\((?:(?:\.\.\.|\w+( [-+*] \w+)?)(?:,\s*|(?=\))))+\)|tuple of|floats")
#: A unit, a quantity whose unit is in the conventions, or a word for what has none.
PURE = """factor share ratio cosine vector index indices multiple probability condition curvature
whether which count dimensionless relative seconds SI colour rad Hz kg unit"""
QUANTITIES = [word for words, _ in rows_of("Units of quantities") for word in words.split(", ")]
WORDS = "|".join([*PURE.split(), "number of", *QUANTITIES])
UNIT = re.compile(rf"\[[^\]]+\]|\b(?:{WORDS})(?:s|es)?\b", re.I)
#: Types of what needs a shape, and of what needs a unit.
ARRAY = re.compile(r"Array|Sequence\[float")
NUMBER = re.compile(r"(?<!ND)Array|\bfloat\b")
#: A formula, and what says where it comes from.
FORMULA = re.compile(r"\n\n {4,}\S.*=|``[^`]* = [^`]*``")
SOURCE = re.compile(
    r"\[\w+\]_|\(\d+\) of|theory page|\bown (?:definition|formula)|textbook|\beq\.|equation"
)


class Public(NamedTuple):
    """A function, class, method or property by its public name, and the class that has it."""

    name: str
    thing: Any
    owner: type | None = None

    @property
    def docs(self):
        """Its docstring, and those of the same name in the bases of the class."""
        last, bases = self.name.rpartition(".")[2], self.owner.__mro__ if self.owner else ()
        things = [self.thing, *(vars(base)[last] for base in bases if last in vars(base))]
        return [inspect.getdoc(thing) or "" for thing in things]


def members(name, cls):
    """Public methods and properties of a class, also those of its bases."""
    for word in dict.fromkeys(word for base in cls.__mro__ for word in vars(base)):
        home = next(base for base in cls.__mro__ if word in vars(base))
        value = vars(home)[word]
        for inner in ("func", "fget", "__func__"):
            value = getattr(value, inner, None) or value
        is_own = home.__module__.startswith("cartstiff") and not word.startswith("_")
        if is_own and inspect.isfunction(value):
            yield Public(f"{name}.{word}", inspect.unwrap(value), cls)


@cache
def everything_public():
    """Each once, by its first name."""
    found = {}
    for name in surface.names():
        thing, own = attrgetter(name)(cartstiff), []
        if inspect.isclass(thing):
            own = [Public(name, thing), *members(name, thing)]
        elif inspect.isfunction(thing):
            own = [Public(name, inspect.unwrap(thing))]
        elif name not in surface.HOMES and inspect.ismodule(thing):
            functions = (f for f in vars(thing).values() if inspect.isfunction(f))
            own = [
                Public(f"{name}.{f.__name__}", f)
                for f in functions
                if f.__module__ == thing.__name__ and f.__name__[0] != "_"
            ]
        for one in own:
            found.setdefault(id(one.thing), one)
    return list(found.values())


def described(one, name):
    """What is said of a parameter or field; None if nothing is."""
    usual = KNOWN.get(name, KNOWN["T_a_b"] if name.startswith("T_") else "")
    blocks = [
        block
        for doc in one.docs
        for section in ("Parameters", "Attributes")
        for block in re.split(r"\n(?=\S)", "\n".join(sections_of(doc).get(section, [])))
    ]
    for text in [b for b in blocks if name in entries(b.splitlines())] + one.docs:
        is_here = re.search(rf"\b{name}\b", text)
        other = re.search(r"[Aa]s in `(?:[\w.]+\.)?(\w+)`", text)
        if other and (is_here or "Arguments" in text):
            there = [p for p in everything_public() if p.name.rpartition(".")[2] == other[1]]
            text += " ".join(described(p, name) or "" for p in there if p != one)
        if is_here or (other and "Arguments" in text):
            return f"{text} {usual}"
    return usual or None


def numbers_of(one):
    """Name, type and description of each parameter or field, and of what is returned."""
    thing, kinds = one.thing, {}
    if not inspect.isclass(thing):
        kinds = {**thing.__annotations__}
        introductions = [re.split(r"\n\w[\w ]*\n---", doc)[0] for doc in one.docs]
        sections = [line for doc in one.docs for line in sections_of(doc).get("Returns", [])]
        yield "what is returned", str(kinds.pop("return", "")), "\n".join(introductions + sections)
    elif dataclasses.is_dataclass(thing):
        kinds = {field.name: field.type for field in dataclasses.fields(thing)}
    elif hasattr(thing, "_fields"):
        kinds = thing.__annotations__
    for name, kind in kinds.items():
        if name[0] != "_":
            yield name, str(kind), described(one, name)


def unsaid(one) -> Iterator[str]:
    """What a docstring leaves open of its numbers, as lines."""
    for name, kind, words in numbers_of(one):
        if words is None:
            yield f"{one.name}: {name} is not described"
        elif ARRAY.search(kind) and not SHAPE.search(words):
            yield f"{one.name}: {name} has no shape"
        elif NUMBER.search(kind) and not UNIT.search(words):
            yield f"{one.name}: {name} has no unit"


def errors_of(function):
    """Errors that a function raises itself, or by a check of its input."""
    if not inspect.isfunction(function) or function.__code__.co_filename == "<string>":
        return set()
    tree, names = ast.parse(textwrap.dedent(inspect.getsource(function))), set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Raise) and isinstance(node.exc, ast.Call):
            names.add(getattr(node.exc.func, "id", ""))
        called = getattr(getattr(node, "func", None), "id", "")
        if re.match(r"check(ed)?_|real_array", called):
            names.add("InputError")
    return kinds_of_errors(names)


def kinds_of_errors(names):
    """Those of the names that are errors; an unknown name is a kind of wrong input."""
    found = {name for name in names if name.endswith("Error")}
    return {"InputError" if name == "UnknownNameError" else name for name in found}


def errors_not_named(one) -> Iterator[str]:
    """Errors that a docstring does not name, as lines."""
    body = one.thing
    if inspect.isclass(body):
        body = vars(body).get("__post_init__") or vars(body).get("__init__")
        body = inspect.unwrap(body) if body else body
    said = kinds_of_errors(re.findall(r"\w+Error", " ".join(one.docs)))
    yield from (f"{one.name} raises {name}" for name in sorted(errors_of(body) - said))


def test_public_names_say_shapes_and_units():
    assert len(everything_public()) > 600
    assert [line for one in everything_public() for line in unsaid(one)] == []


def test_public_names_say_which_errors_they_raise():
    assert [line for one in everything_public() for line in errors_not_named(one)] == []


def test_formulas_of_public_names_have_a_source():
    """In the docstring, or in that of the class or module."""
    bare = []
    for one in everything_public():
        around = [one.owner.__doc__ if one.owner else "", sys.modules[one.thing.__module__].__doc__]
        if FORMULA.search(one.docs[0]):
            bare += [one.name] * (not any(SOURCE.search(doc or "") for doc in one.docs + around))
    assert bare == []


def test_the_reader_of_public_names_sees_what_is_missing():
    def bare(force: Array, q: Array) -> float:  # noqa: F821
        """Of a force."""
        raise InputError(f"{force} {q}")  # noqa: F821

    def complete(force: Array, q: Array) -> float:  # noqa: F821
        """Energy at q under a force (3,).

        Raises
        ------
        InputError
            Always.
        """
        raise InputError(f"{force} {q}")  # noqa: F821

    assert [*unsaid(Public("bare", bare))] == ["bare: force has no shape"]
    assert [*unsaid(Public("complete", complete))] == []
    assert [*errors_not_named(Public("complete", complete))] == []
    complete.__doc__ = "Energy."
    assert [*errors_not_named(Public("c", complete))] == ["c raises InputError"]
