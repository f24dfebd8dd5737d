"""Where code asks for the kind of a mechanism, posture, potential or law, beside its own file.

python tests/kinds.py [SRC/cartstiff]     each place, and how many there are in each file
"""

from __future__ import annotations

import ast
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from tests.doors import tree

PACKAGE = Path(__file__).resolve().parents[1] / "src" / "cartstiff"
#: Each class below one of these is a kind.
FAMILIES = {"Mechanism", "MechanismPosture", "Potential", "SpringLaw"}
#: What `kind` is in mechanism files.
WORDS = {"serial", "closed-chain", "parallel", "stewart-gough", "springs"}


class Check(NamedTuple):
    """One place that asks."""

    file: str
    line: int
    form: str
    text: str


class Kinds(NamedTuple):
    """Files (one or more) of the class of each kind, and names that only kinds have."""

    homes: dict[str, set[str]]
    attributes: set[str]


def _trees(package: Path) -> dict[str, ast.Module]:
    return {str(path.relative_to(package)): tree(path) for path in sorted(package.rglob("*.py"))}


def _last_name(node: ast.expr) -> str:
    if isinstance(node, ast.Subscript):
        return _last_name(node.value)
    return node.attr if isinstance(node, ast.Attribute) else getattr(node, "id", "")


def kinds_in(trees: dict[str, ast.Module]) -> Kinds:
    """The kinds that are defined in some files."""
    classes = [
        (file, node)
        for file, parsed in trees.items()
        for node in ast.walk(parsed)
        if isinstance(node, ast.ClassDef)
    ]
    known, size = set(FAMILIES), 0
    while len(known) > size:
        size = len(known)
        known |= {c.name for _, c in classes if known & set(map(_last_name, c.bases))}
    homes: dict[str, set[str]] = {name: set() for name in known}
    attributes: set[str] = set()
    for file, node in classes:
        if node.name in known:
            homes[node.name].add(file)
            attributes |= {a.name for a in node.body if isinstance(a, ast.FunctionDef)}
            attributes |= {
                a.target.id
                for a in node.body
                if isinstance(a, ast.AnnAssign) and isinstance(a.target, ast.Name)
            }
    return Kinds(homes, attributes)


def _form(node: ast.AST, names: set[str], attributes: set[str]) -> str | None:
    """How a node asks; None if it does not. `names` are the kinds of other files."""

    def has_kind(part: ast.AST) -> bool:
        return any(
            isinstance(n, (ast.Name, ast.Attribute)) and _last_name(n) in names
            for n in ast.walk(part)
        )

    match node:
        case ast.Call(func=ast.Name(id="isinstance" | "issubclass" as call), args=[_, of]):
            return call if has_kind(of) else None
        case ast.Call(func=ast.Name(id="hasattr"), args=[_, ast.Constant(value=str(name))]):
            return "hasattr" if name in attributes else None
        case ast.Compare(left=left, comparators=others):
            sides = [left, *others]
            asked = [s.value for s in sides if isinstance(s, ast.Attribute) and s.attr == "kind"]
            if any(_last_name(of) != "self" for of in asked):
                words = {n.value for n in ast.walk(node) if isinstance(n, ast.Constant)}
                return ".kind" if words & WORDS else None
            asks = any(isinstance(s, ast.Call) and _last_name(s.func) == "type" for s in sides)
            return "type()" if asks and has_kind(node) else None
        case ast.MatchClass(cls=cls):
            return "match" if has_kind(cls) else None
        case ast.Dict(keys=keys):
            named = [key for key in keys if isinstance(key, (ast.Name, ast.Attribute))]
            return "table" if any(_last_name(key) in names for key in named) else None
        case ast.FunctionDef(decorator_list=decorators):
            words = {_last_name(d.func if isinstance(d, ast.Call) else d) for d in decorators}
            return "singledispatch" if words & {"singledispatch", "register"} else None
    return None


def checks(package: Path = PACKAGE, more: dict[str, str] | None = None) -> Iterator[Check]:
    """Every check in a package; `more` are further files, which come first, and their texts."""
    trees = {f: ast.parse(text) for f, text in (more or {}).items()} | _trees(package)
    kinds = kinds_in(trees)
    for file, parsed in trees.items():
        others = {name for name, homes in kinds.homes.items() if file not in homes}
        for node in ast.walk(parsed):
            if (form := _form(node, others, kinds.attributes)) is not None:
                yield Check(file, getattr(node, "lineno", 0), form, ast.unparse(node)[:90])


if __name__ == "__main__":
    found = list(checks(Path(sys.argv[1]) if sys.argv[1:] else PACKAGE))
    for check in sorted(found):
        print(f"{check.file}:{check.line}: {check.text}")
    for name, count in Counter(check.file for check in found).most_common():
        print(count, name)
    print(len(found), dict(Counter(check.form for check in found)))
