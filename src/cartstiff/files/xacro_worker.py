"""Expands one xacro file; run as a script in a process of its own
(`cartstiff.files.ros`).

A xacro file is a program from an unknown source. The package xacro expands macros,
properties and conditions; the text in ``${...}`` is evaluated after its syntax tree has
been checked: numbers, texts, lists, dictionaries, arithmetic, comparisons, and the
functions listed below. Functions are not values, attributes are keys of dictionaries, and
no attribute is left in the code. Files are read below the folders that the parent names.
``$(eval)`` is evaluated like ``${...}``, with the file's arguments by name; ``$(env)`` is
refused, and ``$(optenv)`` is its default.
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

from cartstiff.files.child_process import read_regular, serve
from cartstiff.files.ros_packages import package_folders, where_packages_are

# Largest sizes in bytes of the expanded text and of each file; characters or entries of
# one value.
_MAX_BYTES = 16 * 1024 * 1024
_MAX_VALUE_SIZE = 1_000_000
_MAX_EXPRESSION_LENGTH = 10_000
_MAX_BITS = 10_000
_MEGABYTES, _SECONDS = 512, 6

# Methods that may be called, by type: they only read.
_METHODS: dict[type, str] = {
    str: "capitalize count endswith find index isalpha isdigit isnumeric join lower "
    "lstrip replace "
    "rsplit rstrip split splitlines startswith strip title upper",
    list: "count index",
    tuple: "count index",
    dict: "get items keys values",
}
_CONSTANTS: dict[str, Any] = {
    n: getattr(math, n) for n in ("pi", "e", "tau", "inf", "nan")
}
_MATH = """
acos acosh asin asinh atan atan2 atanh ceil copysign cos cosh degrees exp fabs floor
fmod hypot isclose isfinite isinf isnan log log10 log2 pow radians sin sinh sqrt tan tanh
trunc
"""
_PLAIN = """
abs all any bool dict divmod float int isinstance len list max min ord repr set sorted
str sum tuple
"""
_NODES = """
Expression Name Attribute Subscript Slice UnaryOp BinOp BoolOp Compare IfExp List Tuple
Call keyword operator unaryop boolop cmpop expr_context
"""
_KNOWN = tuple(getattr(ast, kind) for kind in _NODES.split())


class RefusedError(Exception):
    """A forbidden operation or a fault of a xacro file."""


class _Guard(ast.NodeTransformer):
    """Rewrites an expression so that only the listed nodes are left, and no attribute.

    Functions get names that no expression can contain (``len()``), so that they are no
    values.
    """

    def __init__(self, functions: Container[str]) -> None:
        self.functions = functions

    def visit(self, node: ast.AST) -> Any:
        """Return the node, if its kind is allowed."""
        plain = isinstance(node, ast.Constant) and isinstance(
            node.value, (int, float, str, NoneType)
        )
        if not plain and not isinstance(node, _KNOWN):
            raise RefusedError(f"{type(node).__name__} is not read")
        return super().visit(node)

    def visit_Name(self, node: ast.Name) -> ast.AST:
        """Return a property, an argument of a macro, or a constant."""
        if node.id.startswith("__"):
            raise RefusedError(f"name {node.id!r} is not defined")
        return node

    def visit_Attribute(self, node: ast.Attribute) -> ast.AST:
        """Return a key of a dictionary, or a constant."""
        if ast.unparse(node.value) == "math" and node.attr in _CONSTANTS:
            return ast.Name(f"{node.attr}()", ast.Load())
        return _call("key", self.visit(node.value), ast.Constant(node.attr))

    def visit_BinOp(self, node: ast.BinOp) -> ast.AST:
        """Return an operation whose result has a bounded size."""
        inner: Any = self.generic_visit(node)
        power = isinstance(node.op, ast.Pow)
        return _call("power", inner.left, inner.right) if power else _call("short", inner)

    def visit_Call(self, node: ast.Call) -> ast.AST:
        """Return a call of a function by its name, or of a method."""
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
    """Value, unless it is larger than any robot needs."""
    if isinstance(value, int) and value.bit_length() > _MAX_BITS:
        raise RefusedError("a value is too large")
    if isinstance(value, (complex, bytes)):
        raise RefusedError("not a real number nor a text")
    _remaining(value, _MAX_VALUE_SIZE)
    return value


def _remaining(value: Any, most: int) -> int:
    """Remaining number of characters and entries, of which repeated ones
    count repeatedly.
    """
    most -= len(value) if isinstance(value, (str, range)) else 1
    if most < 0:
        raise RefusedError("a value is too large")
    if isinstance(value, dict):
        value = tuple(dict.items(value))
    if isinstance(value, (list, tuple)):
        for inner in (
            tuple.__iter__(value) if isinstance(value, tuple) else list.__iter__(value)
        ):
            most = _remaining(inner, most)
    return most


def _power(a: Any, b: Any) -> Any:
    """Power with a bounded size: Python computes whole numbers to the last digit."""
    if (
        isinstance(a, int)
        and isinstance(b, int)
        and b > 1
        and a.bit_length() * b > _MAX_BITS
    ):
        raise RefusedError("a value is too large")
    return _short(a**b)


def _method(value: Any, name: str, *arguments: Any, **keys: Any) -> Any:
    """Result of a method of a text, list or dictionary."""
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
    """Guarded replacements of the functions with which xacro evaluates and reads.

    Parameters
    ----------
    path : str
        The file.
    folders : list of str
        Folders below which files are read.
    searched : list of str
        Folders in or under which packages are searched.
    """

    def __init__(self, path: str, folders: list[str], searched: list[str]) -> None:
        self.path, self.searched = Path(path), searched
        self.folders = [Path(folder).resolve() for folder in folders]
        self.missing: list[str] = []
        self.packages: dict[str, str] = {}
        self.twice: dict[str, list[str]] = {}

    def evaluate(self, text: str, symbols: Any, _: Any = None) -> Any:
        """Replace xacro.safe_eval."""
        text = text.strip()
        try:
            if len(text) > _MAX_EXPRESSION_LENGTH:
                raise RefusedError("it is too long")
            tree = _Guard(self.functions).visit(ast.parse(text, mode="eval"))
            code = compile(ast.fix_missing_locations(tree), "expression", "eval")
            return _short(eval(code, self.names, symbols))
        except (MemoryError, RecursionError):
            raise
        except SyntaxError:
            raise RefusedError(f"not an expression: ${{{_shown(text)}}}") from None
        except Exception as error:
            if isinstance(
                _cause(error), (LookupError, MemoryError, RecursionError)
            ) or hasattr(error, "exc"):  # of an expression or a file within
                raise
            raise RefusedError(f"{_innermost(error)} in ${{{_shown(text)}}}") from None

    def extension(self, text: str) -> str:
        """Replace xacro.eval_extension: ``$(arg x)``, ``$(find p)``,
        ``$(optenv X y)``.
        """
        match = re.fullmatch(r"\$\(\s*(\w+)\s*(.*?)\s*\)", text, re.DOTALL)
        command, rest = match.groups() if match else ("", "")
        if command == "arg":
            value = self.argument(rest)
            return re.sub(
                r"\$\(\s*find\s+([^)\s]+)\s*\)", lambda m: self.folder(m[1]), value
            )
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
        """Return the value of an argument."""
        arguments = xacro.substitution_args_context["arg"]
        if name not in arguments:
            self.missing.append(name)
            raise RefusedError(f"argument {name!r} has no value")
        return str(arguments[name])

    def folder(self, name: str) -> str:
        """Return the folder of a package, below which files may be read from now on."""
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
        """Replace open: return the text of a regular file below the folders."""
        data = read_regular(self.allowed(name), _MAX_BYTES)
        try:
            text = data.decode("utf-8-sig")
        except UnicodeDecodeError:
            raise RefusedError(f"{name} is not UTF-8 text") from None
        if "<!DOCTYPE" in text or "<!ENTITY" in text:
            raise RefusedError(
                f"XML document types and entities are not supported, in {name}"
            )
        return io.StringIO(text)

    def allowed(self, name: Any) -> str:
        """Return the real path of a file that may be read."""
        real = Path(name).resolve()
        if not any(real.is_relative_to(folder) for folder in self.folders):
            raise RefusedError(
                f"{_shown(str(name))} is outside of the file's package and folders"
            )
        return str(real)

    def listed(self, pattern: str) -> list[str]:
        """Replace glob.glob."""
        fixed = re.split(r"[*?\[]", pattern, maxsplit=1)[0]
        self.allowed(Path(fixed).parent)
        return glob.glob(pattern)  # noqa: PTH207

    def take_over(self) -> None:
        """Replace the functions with which xacro evaluates and reads."""

        def fatal(*words: Any) -> None:
            raise RefusedError(" ".join(map(str, words)))

        plain: dict[str, Callable[..., Any]] = {
            **{name: getattr(builtins, name) for name in _PLAIN.split()},
            "enumerate": lambda *a: list(enumerate(*a)),
            "map": lambda *a: list(map(*a)),
            "range": lambda *a: list(_short(range(*a))),
            # Python computes ten to the power of the digits.
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
                part
                for part in re.split(f"[{re.escape(sep)}]", text)
                if part or not skip_empty
            ],
            **dict.fromkeys(
                ("message", "warning", "error", "print_location"), lambda *_, **__: ""
            ),
        }
        spaces = {"": {**plain, **of_math, **direct}, "math.": of_math, "python.": plain}
        spaces["xacro."] = own
        self.functions = {
            p + n: f for p, space in spaces.items() for n, f in space.items()
        }
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
    """Guard of xacro.eval_text that refuses texts that grow without bounds."""

    def bounded(text: str, symbols: Any) -> Any:
        return _short(evaluate(text, symbols))

    return bounded


def expanded(
    path: str, values: dict[str, str], folders: list[str], searched: list[str]
) -> dict[str, Any]:
    """Expand a xacro file to XML, or return its fault."""
    reader = _Reader(path, folders, searched)
    reader.take_over()
    arguments, asked = _Read(values), _arguments(path)
    try:
        document = xacro.process_file(path, mappings=arguments, verbosity=0)
        text = document.toxml()
        answer: dict[str, Any] = {"xml": text}
        if len(text) > _MAX_BYTES:
            answer = {"error": f"it expands to more than {_MAX_BYTES} bytes"}
    except (MemoryError, RecursionError):
        answer = {"error": "it needs too much memory"}
    except Exception as error:
        empty = [name for name in asked if arguments.get(name) == ""]
        files = [path, *filter(None, getattr(xacro, "filestack", None) or [])]
        words, expected = _fault(error, reader.missing, empty)
        answer = {"error": words, "expected": expected, "file": str(files[-1])}
    unread = [name for name in values if name not in arguments.read]
    return {**answer, "asked": asked, "unread": unread, "twice": reader.twice}


def _fault(
    error: Exception, missing: list[str], empty: list[str]
) -> tuple[str, str | None]:
    """Words of a fault, and what is expected instead."""
    inner, words, expected = _cause(error), _innermost(error), None
    if isinstance(inner, (MemoryError, RecursionError)):
        words = "it needs too much memory"
    if lost := re.search(r"package '([^']*)' is not found", words):
        expected = where_packages_are(lost[1])
    elif "is outside of the file's package" in words:
        expected = (
            "--package-path FOLDER, ROS_PACKAGE_PATH or AMENT_PREFIX_PATH with the folder"
        )
    elif missing:
        expected = f"--xacro-arg {missing[0]}:=VALUE"
    elif empty and isinstance(inner, FileNotFoundError):
        expected = "--xacro-arg NAME:=VALUE for what is empty in the file: "
        expected += ", ".join(empty)
    return words, expected


def _cause(error: Any) -> Any:
    """Exception that xacro has wrapped."""
    while getattr(error, "exc", None) is not None:
        error = error.exc
    return error


def _innermost(error: Exception) -> str:
    inner = _cause(error)
    if isinstance(inner, KeyError) and inner.args:
        return f"no key {inner.args[0]!r}"
    return str(inner) or type(inner).__name__


class _Values(dict[str, Any]):
    """Values of arguments for ``$(eval)``, with numbers and truth values converted."""

    def __init__(self, argument: Callable[[str], str]) -> None:
        super().__init__()
        self.argument = argument

    def __missing__(self, name: str) -> Any:
        if name not in xacro.substitution_args_context["arg"]:
            raise KeyError(name)
        return convert_value(self.argument(name), "auto")


class _Read(dict[str, str]):
    """Values of arguments, and the names that were read."""

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
