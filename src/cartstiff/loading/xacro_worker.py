"""Expands one xacro file; run as a script in a process of its own (`cartstiff.loading.ros`).

A xacro file is a program of a stranger. The package xacro expands macros, properties and
conditions; what is in ``${...}`` is evaluated here, by walking its syntax tree: numbers, texts,
lists, dictionaries, arithmetic, comparisons, and the functions listed below. Functions are not
values, attributes are keys of dictionaries, and no part is given to Python's ``eval``. Files are
read below the folders that the parent names; ``$(env)`` and ``$(eval)`` are refused, and
``$(optenv)`` is its default.
"""

from __future__ import annotations

import ast
import glob
import io
import math
import operator
import re
from collections.abc import Callable, Mapping
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import xacro

from cartstiff.child_process import read_regular, serve
from cartstiff.ros_packages import package_folders

# Bytes of the expanded text and of each file that is read; characters or entries of one value.
_LARGEST = 16 * 1024 * 1024
_LARGEST_VALUE = 1_000_000
_LONGEST_EXPRESSION = 10_000
_MOST_BITS = 10_000
_MEGABYTES, _SECONDS = 512, 6

# Names of what may be called, by whose it is.
_OF_MATH = """
acos acosh asin asinh atan atan2 atanh ceil copysign cos cosh degrees exp fabs floor fmod hypot
isclose isfinite isinf isnan log log10 log2 pow radians sin sinh sqrt tan tanh trunc
"""
_OF_TEXTS = """
capitalize count endswith find index isalpha isdigit isnumeric join lower lstrip replace rsplit
rstrip split splitlines startswith strip title upper
"""
_OF_LISTS = "count index"
_OF_MAPPINGS = "get items keys values"
_CONSTANTS: dict[str, Any] = {n: getattr(math, n) for n in ("pi", "e", "tau", "inf", "nan")}
_MATH: dict[str, Callable[..., Any]] = {name: getattr(math, name) for name in _OF_MATH.split()}
_TYPES = {kind.__name__: kind for kind in (bool, dict, float, int, list, set, str, tuple)}
_PYTHON: dict[str, Callable[..., Any]] = {
    **_TYPES,
    **{
        f.__name__: f for f in (abs, all, any, divmod, len, max, min, ord, repr, round, sorted, sum)
    },
    "enumerate": lambda *a: list(enumerate(*a)),
    "range": lambda *a: list(_short(range(*a))),
    # Python would compute ten to the power of so many digits.
    "round": lambda x, n=None: round(x, n and max(-400, min(400, n))),
    "reversed": lambda a: list(reversed(a)),
    "zip": lambda *a: list(zip(*a, strict=False)),
}
_OPERATORS: dict[type[ast.AST], Callable[..., Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.FloorDiv: operator.floordiv,
    ast.Mod: operator.mod,
    ast.Pow: operator.pow,
    ast.BitAnd: operator.and_,
    ast.BitOr: operator.or_,
    ast.UAdd: operator.pos,
    ast.USub: operator.neg,
    ast.Not: operator.not_,
    ast.Eq: operator.eq,
    ast.NotEq: operator.ne,
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
    ast.Is: operator.is_,
    ast.IsNot: operator.is_not,
    ast.In: lambda a, b: a in b,
    ast.NotIn: lambda a, b: a not in b,
}


class RefusedError(Exception):
    """What a xacro file must not do, or what is wrong with it."""


class _Expression:
    """One expression, evaluated over the symbols of xacro."""

    def __init__(self, symbols: Mapping[str, Any]) -> None:
        self.symbols = symbols

    def value(self, node: ast.AST) -> Any:
        """The value of a node: number, text, truth, list, mapping, or nothing."""
        return _short(self._value(node))

    def _value(self, node: ast.AST) -> Any:
        match node:
            case ast.Constant(value=bool() | int() | float() | str() | None):
                return node.value
            case ast.Name(id=name):
                if name in self.symbols:
                    return self.symbols[name]
                if name in _CONSTANTS:
                    return _CONSTANTS[name]
                raise RefusedError(f"name {name!r} is not defined")
            case ast.Attribute(value=ast.Name(id="math"), attr=name) if name in _CONSTANTS:
                return _CONSTANTS[name]
            case ast.Attribute(value=inner, attr=name):
                mapping = self.value(inner)
                if name.startswith("_") or not isinstance(mapping, dict):
                    raise RefusedError(f"attribute {name!r} is not read")
                return mapping[name]
            case ast.Subscript(value=inner, slice=ast.Slice(lower=low, upper=high, step=step)):
                return self._list(inner)[slice(*(n and self.value(n) for n in (low, high, step)))]
            case ast.Subscript(value=inner, slice=index):
                return self._list(inner)[self.value(index)]
            case ast.UnaryOp(op=op, operand=operand) if type(op) in _OPERATORS:
                return _OPERATORS[type(op)](self.value(operand))
            case ast.BinOp(left=left, op=op, right=right) if type(op) in _OPERATORS:
                return _combined(op, self.value(left), self.value(right))
            case ast.BoolOp(op=op, values=values):
                for value in map(self.value, values):
                    if bool(value) is isinstance(op, ast.Or):
                        return value
                return value
            case ast.Compare(left=left, ops=ops, comparators=others):
                one = self.value(left)
                for kind, other in zip(map(type, ops), map(self.value, others), strict=True):
                    if not _OPERATORS[kind](one, other):
                        return False
                    one = other
                return True
            case ast.IfExp(test=test, body=body, orelse=otherwise):
                return self.value(body if self.value(test) else otherwise)
            case ast.List(elts=parts):
                return [self.value(part) for part in parts]
            case ast.Tuple(elts=parts):
                return tuple(self.value(part) for part in parts)
            case ast.Call(func=function, args=arguments, keywords=keywords):
                return self._called(function, arguments, keywords)
        raise RefusedError(f"{_WORDS.get(type(node).__name__, type(node).__name__)} is not read")

    def _list(self, node: ast.AST) -> Any:
        value = self.value(node)
        if not isinstance(value, (str, list, tuple, dict)):
            raise RefusedError("only texts, lists and dictionaries have indices")
        return value

    def _called(self, function: ast.AST, nodes: list[ast.expr], named: list[ast.keyword]) -> Any:
        if any(key.arg is None for key in named):
            raise RefusedError("** is not read")
        keys = {str(key.arg): self.value(key.value) for key in named}
        match function:
            case ast.Name(id="map") | ast.Attribute(value=ast.Name(id="python"), attr="map"):
                each, *lists = nodes
                return list(map(self._function(each), *map(self.value, lists), **keys))
            case (
                ast.Name(id="isinstance")
                | ast.Attribute(value=ast.Name(id="python"), attr="isinstance")
            ):
                value, kind = nodes
                return isinstance(self.value(value), tuple(self._kinds(kind)))
            case ast.Attribute(value=inner, attr=name) if not (
                isinstance(inner, ast.Name) and inner.id in _SPACES
            ):
                return _method(self.value(inner), name)(*map(self.value, nodes), **keys)
        return self._function(function)(*map(self.value, nodes), **keys)

    def _function(self, node: ast.AST) -> Callable[..., Any]:
        """A function by its name: the only way to one."""
        match node:
            case ast.Name(id=name) if name in _SPACES[""]:
                return _SPACES[""][name]
            case ast.Attribute(value=ast.Name(id=space), attr=name) if name in _SPACES.get(
                space, ()
            ):
                return _SPACES[space][name]
        raise RefusedError(f"function {ast.unparse(node)!r} is not called")

    def _kinds(self, node: ast.AST) -> list[type]:
        kinds = [self._function(n) for n in (node.elts if isinstance(node, ast.Tuple) else [node])]
        return [kind for kind in kinds if isinstance(kind, type)]


_WORDS = {
    "Lambda": "lambda",
    "JoinedStr": "an f-string",
    "ListComp": "a comprehension",
    "SetComp": "a comprehension",
    "DictComp": "a comprehension",
    "GeneratorExp": "a comprehension",
    "NamedExpr": "':='",
    "Starred": "'*'",
}


def _short(value: Any) -> Any:
    """The value, unless it is larger than any robot needs."""
    if isinstance(value, int) and value.bit_length() > _MOST_BITS:
        raise RefusedError("a value is too large")
    if isinstance(value, (complex, bytes)):
        raise RefusedError("not a real number nor a text")
    _left(value, _LARGEST_VALUE)
    return value


def _left(value: Any, most: int) -> int:
    """What is left of so many characters and entries, counted as often as they are repeated."""
    most -= len(value) if isinstance(value, (str, range)) else 1
    if most < 0:
        raise RefusedError("a value is too large")
    if isinstance(value, dict):
        for inner in dict.items(value):
            most = _left(inner, most)
    elif isinstance(value, (list, tuple)):
        for inner in tuple.__iter__(value) if isinstance(value, tuple) else list.__iter__(value):
            most = _left(inner, most)
    return most


def _combined(op: ast.AST, a: Any, b: Any) -> Any:
    """Two values under an operator, refused where the result would be huge."""
    if isinstance(op, ast.Pow) and isinstance(a, int) and isinstance(b, int):
        large = b > 1 and a.bit_length() * b > _MOST_BITS
    elif isinstance(op, ast.Mult) and (hasattr(a, "__len__") or hasattr(b, "__len__")):
        count, size = (a, len(b)) if isinstance(a, int) else (b, len(a))
        large = isinstance(count, int) and count * size > _LARGEST_VALUE
    else:
        large = isinstance(op, ast.Mod) and isinstance(a, str) and bool(_WIDE.search(a))
    if large:
        raise RefusedError("a value is too large")
    return _OPERATORS[type(op)](a, b)


_WIDE = re.compile(r"%[^a-zA-Z%]*(?:\d{4}|\*)")


def _method(value: Any, name: str) -> Callable[..., Any]:
    """A method of a text, list or dictionary that only reads it."""
    if isinstance(value, str):
        if name in _OF_TEXTS.split():
            return getattr(str, name).__get__(value)
    elif isinstance(value, dict) and name in _OF_MAPPINGS.split():
        method = getattr(dict, name).__get__(value)
        return method if name == "get" else lambda: list(method())
    elif isinstance(value, (list, tuple)) and name in _OF_LISTS.split():
        return getattr(value, name)
    raise RefusedError(f"method {name!r} is not called")


class _Reader:
    """What xacro may read, in place of what it uses by itself.

    Parameters
    ----------
    path : str
        The file.
    folders : list of str
        Folders below which files are read.
    searched : list of str
        Folders in or under which packages are looked for.
    """

    def __init__(self, path: str, folders: list[str], searched: list[str]) -> None:
        self.path, self.searched = Path(path), searched
        self.folders = [Path(folder).resolve() for folder in folders]
        self.missing: list[str] = []
        self.packages: dict[str, str] = {}
        self.twice: dict[str, list[str]] = {}

    def evaluate(self, text: str, symbols: Any, _: Any = None) -> Any:
        """In place of xacro.safe_eval."""
        text = text.strip()
        try:
            if len(text) > _LONGEST_EXPRESSION:
                raise RefusedError("it is too long")
            return _Expression(symbols).value(ast.parse(text, mode="eval").body)
        except (MemoryError, RecursionError):
            raise
        except SyntaxError:
            raise RefusedError(f"not an expression: ${{{_shown(text)}}}") from None
        except Exception as error:
            if isinstance(_cause(error), (LookupError, MemoryError, RecursionError)) or hasattr(
                error, "exc"
            ):  # of an expression or a file within
                raise
            raise RefusedError(f"{_innermost(error)} in ${{{_shown(text)}}}") from None

    def extension(self, text: str) -> str:
        """In place of xacro.eval_extension: ``$(arg x)``, ``$(find p)``, ``$(optenv X y)``."""
        match = re.fullmatch(r"\$\(\s*(\w+)\s*(.*?)\s*\)", text, re.DOTALL)
        command, rest = match.groups() if match else ("", "")
        if command == "arg":
            value = self.argument(rest)
            return re.sub(r"\$\(\s*find\s+([^)\s]+)\s*\)", lambda m: self.folder(m[1]), value)
        if command == "find":
            return self.folder(rest)
        if command == "optenv":
            return " ".join(rest.split()[1:])
        if command == "dirname":
            return str(Path(xacro.filestack[-1]).parent)
        raise RefusedError(f"{_shown(text)} is refused")

    def argument(self, name: str) -> str:
        """The value of an argument."""
        arguments = xacro.substitution_args_context["arg"]
        if name not in arguments:
            self.missing.append(name)
            raise RefusedError(f"argument {name!r} has no value")
        return str(arguments[name])

    def folder(self, name: str) -> str:
        """The folder of a package, below which files may be read from now on."""
        if name in self.packages:
            return self.packages[name]
        found = list(package_folders(name, self.path, self.searched))
        if not found:
            raise LookupError(f"package {_shown(name)!r} is not found")
        if len(found) > 1:
            self.twice[name] = [str(f) for f in found]
        self.folders.append(found[0].resolve())
        self.packages[name] = str(found[0])
        return self.packages[name]

    def open(self, name: Any, *_: Any, **__: Any) -> io.StringIO:
        """In place of open: the text of a regular file below the folders."""
        data = read_regular(self.allowed(name), _LARGEST)
        try:
            text = data.decode("utf-8-sig")
        except UnicodeDecodeError:
            raise RefusedError(f"{name} is not UTF-8 text") from None
        if "<!DOCTYPE" in text or "<!ENTITY" in text:
            raise RefusedError(f"XML document types and entities are not supported, in {name}")
        return io.StringIO(text)

    def allowed(self, name: Any) -> str:
        """The real path of a file that may be read."""
        real = Path(name).resolve()
        if not any(real.is_relative_to(folder) for folder in self.folders):
            raise RefusedError(f"{_shown(str(name))} is outside of the file's package and folders")
        return str(real)

    def listed(self, pattern: str) -> list[str]:
        """In place of glob.glob."""
        fixed = re.split(r"[*?\[]", pattern, maxsplit=1)[0]
        self.allowed(Path(fixed).parent)
        return glob.glob(pattern)  # noqa: PTH207

    def take_over(self) -> None:
        """Replace what xacro evaluates and reads by itself."""

        def fatal(*words: Any) -> None:
            raise RefusedError(" ".join(map(str, words)))

        own: dict[str, Callable[..., Any]] = {
            "abs_filename": xacro.abs_filename_spec,
            "arg": self.argument,
            "dotify": dict,
            "fatal": fatal,
            "load_yaml": xacro.load_yaml,
            "tokenize": lambda text, sep=",; ", skip_empty=True: [
                part for part in re.split(f"[{re.escape(sep)}]", text) if part or not skip_empty
            ],
            **dict.fromkeys(("message", "warning", "error", "print_location"), lambda *_, **__: ""),
        }
        direct = {name: own[name] for name in ("abs_filename", "dotify", "load_yaml")}
        _SPACES[""] = {**_PYTHON, **_MATH, **direct}
        _SPACES.update(math=_MATH, python=_PYTHON, xacro=own)
        vars(xacro).update(
            safe_eval=self.evaluate,
            eval_extension=self.extension,
            eval_text=_bounded(xacro.eval_text),
            open=self.open,
            glob=SimpleNamespace(glob=self.listed),
            _global_symbols={},
        )


def _shown(text: str) -> str:
    text = " ".join(text.split())
    return text if len(text) <= 80 else text[:77] + "..."


_SPACES: dict[str, dict[str, Callable[..., Any]]] = {}


def _bounded(evaluate: Callable[..., Any]) -> Callable[..., Any]:
    """xacro.eval_text, refused where texts grow out of bounds."""

    def bounded(text: str, symbols: Any) -> Any:
        return _short(evaluate(text, symbols))

    return bounded


def expanded(
    path: str, values: dict[str, str], folders: list[str], searched: list[str]
) -> dict[str, Any]:
    """The XML that a xacro file means, or what is wrong with it."""
    reader = _Reader(path, folders, searched)
    reader.take_over()
    arguments = _Read(values)
    try:
        document = xacro.process_file(path, mappings=arguments, verbosity=0)
        text = document.toxml()
        answer: dict[str, Any] = {"xml": text}
        if len(text) > _LARGEST:
            answer = {"error": f"it expands to more than {_LARGEST} bytes"}
    except (MemoryError, RecursionError):
        answer = {"error": "it needs too much memory"}
    except Exception as error:
        inner = _cause(error)
        place = [str(name) for name in getattr(xacro, "filestack", None) or [] if name]
        answer = {
            "error": _innermost(error),
            "package": isinstance(inner, LookupError) and "is not found" in str(inner),
            "outside": "is outside of the file's package" in _innermost(error),
            "missing_arguments": reader.missing,
            "file": place[-1] if place else path,
        }
        if isinstance(inner, (MemoryError, RecursionError)):
            answer["error"] = "it needs too much memory"
    unread = [name for name in values if name not in arguments.read]
    return {**answer, "asked": _arguments(path), "unread": unread, "twice": reader.twice}


def _cause(error: Any) -> Any:
    """The exception that xacro has wrapped."""
    while getattr(error, "exc", None) is not None:
        error = error.exc
    return error


def _innermost(error: Exception) -> str:
    inner = _cause(error)
    if isinstance(inner, KeyError) and inner.args:
        return f"no key {inner.args[0]!r}"
    return str(inner) or type(inner).__name__


class _Read(dict[str, str]):
    """Values of arguments, and the names that were asked for."""

    def __init__(self, values: dict[str, str]) -> None:
        super().__init__(values)
        self.read: set[object] = set()

    def __contains__(self, name: object) -> bool:
        self.read.add(name)
        return super().__contains__(name)

    def __getitem__(self, name: str) -> str:
        self.read.add(name)
        return super().__getitem__(name)


def _arguments(path: str) -> list[str]:
    """Names of the arguments that the file itself declares."""
    from xml.dom import minidom

    try:
        tags = minidom.parse(path).getElementsByTagName("xacro:arg")
    except Exception:
        return []
    return [tag.getAttribute("name") for tag in tags]


if __name__ == "__main__":
    serve(expanded, _MEGABYTES, _SECONDS)
