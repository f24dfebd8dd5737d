"""Expands one xacro file; run as a script in a process of its own (`cartstiff.loading.ros`).

A xacro file is a program of a stranger. The package xacro expands macros, properties and
conditions; what is in ``${...}`` is evaluated after its syntax tree has been checked: numbers,
texts, lists, dictionaries, arithmetic, comparisons, and the functions listed below. Functions are
not values, attributes are keys of dictionaries, and no attribute is left in the code. Files are
read below the folders that the parent names. ``$(eval)`` is evaluated like ``${...}``, with the
file's arguments by name; ``$(env)`` is refused, and ``$(optenv)`` is its default.
"""

from __future__ import annotations

import ast
import builtins
import glob
import io
import math
import re
from collections.abc import Callable, Container
from pathlib import Path
from types import NoneType, SimpleNamespace
from typing import Any

import xacro
from xacro.substitution_args import convert_value

from cartstiff.child_process import read_regular, serve
from cartstiff.ros_packages import package_folders

# Bytes of the expanded text and of each file that is read; characters or entries of one value.
_LARGEST = 16 * 1024 * 1024
_LARGEST_VALUE = 1_000_000
_LONGEST_EXPRESSION = 10_000
_MOST_BITS = 10_000
_MEGABYTES, _SECONDS = 512, 6

# Methods that may be called, by whose they are: they only read.
_METHODS: dict[type, str] = {
    str: "capitalize count endswith find index isalpha isdigit isnumeric join lower lstrip replace "
    "rsplit rstrip split splitlines startswith strip title upper",
    list: "count index",
    tuple: "count index",
    dict: "get items keys values",
}
_CONSTANTS: dict[str, Any] = {n: getattr(math, n) for n in ("pi", "e", "tau", "inf", "nan")}
_MATH = """
acos acosh asin asinh atan atan2 atanh ceil copysign cos cosh degrees exp fabs floor fmod hypot
isclose isfinite isinf isnan log log10 log2 pow radians sin sinh sqrt tan tanh trunc
"""
_PLAIN = """
abs all any bool dict divmod float int isinstance len list max min ord repr set sorted str sum tuple
"""
_KNOWN = (
    ast.Expression,
    ast.Name,
    ast.Attribute,
    ast.Subscript,
    ast.Slice,
    ast.UnaryOp,
    ast.BinOp,
    ast.BoolOp,
    ast.Compare,
    ast.IfExp,
    ast.List,
    ast.Tuple,
    ast.Call,
    ast.keyword,
    ast.operator,
    ast.unaryop,
    ast.boolop,
    ast.cmpop,
    ast.expr_context,
)


class RefusedError(Exception):
    """What a xacro file must not do, or what is wrong with it."""


class _Guard(ast.NodeTransformer):
    """An expression in which only what is listed is left, and no attribute at all.

    Functions get names that no text has (``len()``), so that they are no values.
    """

    def __init__(self, functions: Container[str]) -> None:
        self.functions = functions

    def visit(self, node: ast.AST) -> Any:
        """The node, if it is of a kind that is read."""
        plain = isinstance(node, ast.Constant) and isinstance(
            node.value, (int, float, str, NoneType)
        )
        if not plain and not isinstance(node, _KNOWN):
            raise RefusedError(f"{type(node).__name__} is not read")
        return super().visit(node)

    def visit_Name(self, node: ast.Name) -> ast.AST:
        """A property, an argument of a macro, or a constant."""
        if node.id.startswith("__"):
            raise RefusedError(f"name {node.id!r} is not defined")
        return node

    def visit_Attribute(self, node: ast.Attribute) -> ast.AST:
        """A key of a dictionary, or a constant."""
        if ast.unparse(node.value) == "math" and node.attr in _CONSTANTS:
            return ast.Name(f"{node.attr}()", ast.Load())
        return _call("key", self.visit(node.value), ast.Constant(node.attr))

    def visit_BinOp(self, node: ast.BinOp) -> ast.AST:
        """A value whose size is bounded."""
        inner: Any = self.generic_visit(node)
        power = isinstance(node.op, ast.Pow)
        return _call("power", inner.left, inner.right) if power else _call("short", inner)

    def visit_Call(self, node: ast.Call) -> ast.AST:
        """A function by its name, or a method."""
        name, arguments = ast.unparse(node.func), list(node.args)
        if name in self.functions:
            own: list[Any] = [self._function(node.func)]
            at = {"map": 0, "isinstance": 1}.get(name.removeprefix("python."))
            if at is not None and at < len(arguments):
                arguments[at] = self._function(arguments[at])
        elif isinstance(node.func, ast.Attribute):
            method = ast.Constant(node.func.attr)
            own = [ast.Name("method()", ast.Load()), self.visit(node.func.value), method]
        else:
            raise RefusedError(f"function {name!r} is not called")
        if None in (key.arg for key in node.keywords):
            raise RefusedError("** is not read")
        call = _call("called", *own, *map(self.visit, arguments))
        call.keywords = list(map(self.visit, node.keywords))
        return call

    def _function(self, node: ast.AST) -> Any:
        if isinstance(node, ast.Tuple):
            return ast.Tuple(list(map(self._function, node.elts)), ast.Load())
        if (name := ast.unparse(node)) not in self.functions:
            raise RefusedError(f"function {name!r} is not called")
        return ast.Name(f"{name}()", ast.Load())


def _call(name: str, *arguments: Any) -> ast.Call:
    return ast.Call(ast.Name(f"{name}()", ast.Load()), list(arguments), [])


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
        value = tuple(dict.items(value))
    if isinstance(value, (list, tuple)):
        for inner in tuple.__iter__(value) if isinstance(value, tuple) else list.__iter__(value):
            most = _left(inner, most)
    return most


def _power(a: Any, b: Any) -> Any:
    """Python would compute whole numbers to the last digit."""
    if isinstance(a, int) and isinstance(b, int) and b > 1 and a.bit_length() * b > _MOST_BITS:
        raise RefusedError("a value is too large")
    return _short(a**b)


def _method(value: Any, name: str, *arguments: Any, **keys: Any) -> Any:
    """What a method of a text, list or dictionary answers."""
    for kind, names in _METHODS.items():
        if isinstance(value, kind) and name in names.split():
            answer = getattr(kind, name)(value, *arguments, **keys)
            return list(answer) if name in ("items", "keys", "values") else answer
    raise RefusedError(f"method {name!r} is not called")


def _key(value: Any, name: str) -> Any:
    if name.startswith("_") or not isinstance(value, dict):
        raise RefusedError(f"attribute {name!r} is not read")
    return value[name]


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
            tree = _Guard(self.functions).visit(ast.parse(text, mode="eval"))
            code = compile(ast.fix_missing_locations(tree), "expression", "eval")
            return _short(eval(code, self.names, symbols))
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
        if command == "eval":
            return str(self.evaluate(rest, _Values(self.argument)))
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

        plain: dict[str, Callable[..., Any]] = {
            **{name: getattr(builtins, name) for name in _PLAIN.split()},
            "enumerate": lambda *a: list(enumerate(*a)),
            "map": lambda *a: list(map(*a)),
            "range": lambda *a: list(_short(range(*a))),
            # Python would compute ten to the power of so many digits.
            "round": lambda x, n=None: round(x, n and max(-400, min(400, n))),
            "reversed": lambda a: list(reversed(a)),
            "zip": lambda *a: list(zip(*a, strict=False)),
        }
        of_math = {name: getattr(math, name) for name in _MATH.split()}
        direct = {
            "abs_filename": xacro.abs_filename_spec,
            "dotify": dict,
            "load_yaml": xacro.load_yaml,
        }
        own = {
            **direct,
            "arg": self.argument,
            "fatal": fatal,
            "tokenize": lambda text, sep=",; ", skip_empty=True: [
                part for part in re.split(f"[{re.escape(sep)}]", text) if part or not skip_empty
            ],
            **dict.fromkeys(("message", "warning", "error", "print_location"), lambda *_, **__: ""),
        }
        spaces = {"": {**plain, **of_math, **direct}, "math.": of_math, "python.": plain}
        spaces["xacro."] = own
        self.functions = {p + n: f for p, space in spaces.items() for n, f in space.items()}
        guards = {"short": _short, "power": _power, "method": _method, "key": _key}
        guards |= {"called": lambda f, *a, **k: _short(f(*a, **k)), **_CONSTANTS}
        named = {f"{name}()": each for name, each in (self.functions | guards).items()}
        self.names = {**_CONSTANTS, **named, "__builtins__": {}}
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
            "lost_file": isinstance(inner, FileNotFoundError),
            "file": place[-1] if place else path,
        }
        if isinstance(inner, (MemoryError, RecursionError)):
            answer["error"] = "it needs too much memory"
    unread = [name for name in values if name not in arguments.read]
    asked = _arguments(path)
    empty = [name for name in asked if arguments.get(name) == ""]
    return {**answer, "asked": asked, "empty": empty, "unread": unread, "twice": reader.twice}


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


class _Values(dict[str, Any]):
    """Values of arguments as ``$(eval)`` has them: numbers and truths where they are such."""

    def __init__(self, argument: Callable[[str], str]) -> None:
        super().__init__()
        self.argument = argument

    def __missing__(self, name: str) -> Any:
        if name not in xacro.substitution_args_context["arg"]:
            raise KeyError(name)
        return convert_value(self.argument(name), "auto")


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
