"""Identity of stored results: files that were read, options,
and versions of the programs.

Loading records the files (`recorded`, `was_read`); maps and design studies store
`identity_of` beside their results, and `require_same` compares it before they resume.
"""

from __future__ import annotations

import inspect
import json
import platform
import re
import sys
import sysconfig
import types
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from functools import cache, cached_property
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Any
from xml.etree.ElementTree import ParseError, canonicalize

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from cartstiff import version as own
from cartstiff.core.errors import InputError, one_line
from cartstiff.core.mechanisms.chain import Description
from cartstiff.core.mechanisms.contract import Mechanism
from cartstiff.core.numerics import ROUNDOFF_OF_SUMS, UNCOUPLED
from cartstiff.core.units import Units

if TYPE_CHECKING:
    from cartstiff.core.mechanisms.elastic import ElasticMechanism

#: Names and SHA-256 of what was read, in order.
Files = tuple[tuple[str, str], ...]

# Packages that compute the numbers, besides this one.
_PACKAGES = ("numpy", "scipy", "pin", "llvmlite")
# Relative difference of numbers from two processors. Files are compared byte by byte;
# this is for numbers that were computed from them, or made in Python.
_TOLERANCE = UNCOUPLED
# Fields of a mechanism that hold numbers, in words.
_PARTS = {
    "mechanism": "geometry, limits or masses",
    "q": "default posture",
    "springs": "springs",
    "potentials": "potentials",
    "gravity": "gravity",
    "damping": "dampers",
    "efforts": "limits of drives' forces",
    "identified": "measured compliances",
    "parameters": "parameters",
}
_READ: ContextVar[dict[tuple[str, str], None] | None] = ContextVar("read", default=None)


@contextmanager
def recorded() -> Iterator[dict[tuple[str, str], None]]:
    """Collect what `was_read` records within; the keys are names and digests."""
    files: dict[tuple[str, str], None] = {}
    token = _READ.set(files)
    try:
        yield files
    finally:
        _READ.reset(token)
        if (outer := _READ.get()) is not None:
            outer.update(files)


def was_read(name: str, content: bytes) -> None:
    """Record a file, or another program's output from it."""
    if (files := _READ.get()) is not None:
        files[name, sha256(_meaning(content)).hexdigest()] = None


def _meaning(content: bytes) -> bytes:
    """Content of a file without line ends, and of XML without comments and order
    of attributes.
    """
    is_plain_xml = content.lstrip().startswith(b"<") and not re.search(
        rb"<!(?!--)", content
    )
    if is_plain_xml:  # nothing is declared, so that no entity can expand
        try:
            return canonicalize(content.decode("utf-8-sig"), strip_text=True).encode()
        except (ParseError, ValueError):
            pass
    return content if b"\0" in content else content.replace(b"\r\n", b"\n")


def identity_of(elastic: ElasticMechanism, options: Mapping[str, Any]) -> dict[str, Any]:
    """The identity of a result for JSON; a result can be resumed with the same identity.

    Parameters
    ----------
    elastic : ElasticMechanism
        Its files and its numbers count, so that changes in Python are found as those of
        files are.
    options : mapping
        Everything else on which the numbers depend.
    """
    parts = {name: fingerprint(getattr(elastic, name)) for name in _PARTS}
    whole = {
        "files": [list(entry) for entry in elastic.files],
        "mechanism": parts,
        **options,
        "versions": versions(),
    }
    return dict(json.loads(json.dumps(whole)))


def versions() -> dict[str, str]:
    """Return the versions of this package and of those that compute the numbers."""
    from importlib.metadata import PackageNotFoundError, version  # slow to import

    known = {"cartstiff": own.__version__}
    for package in _PACKAGES:
        try:
            known[package] = version(package)
        except PackageNotFoundError:
            continue
    return known


def require_versions(wanted: Mapping[str, str]) -> None:
    """Refuse work on a worker whose versions differ from those of the sender."""
    for package, number in wanted.items():
        if (here := versions().get(package)) != number:
            raise InputError(
                f"a worker has another version of {package}",
                where=platform.node(),
                expected=f"{number}, as where the command was given",
                got=here or "none",
            )


def require_same(there: Mapping[str, Any], here: Mapping[str, Any], path: Path) -> None:
    """Refuse to resume a stored map of another identity,
    in one line with the difference.

    Parameters
    ----------
    there, here : mapping
        From `identity_of`: stored in the file, and wanted now.
    path : Path
        The file.
    """
    where, anew = one_line(str(path)), "or another output file for a new one"
    files = _changed(there.get("files", []), here["files"])
    if files is not None:
        raise InputError(
            f"the file holds the map of another mechanism: {files}",
            where=where,
            expected=f"the files that it was made from, {anew}",
        )
    kept = there.get("versions", {})
    for package, number in here["versions"].items():
        if kept.get(package) != number:
            raise InputError(
                f"the file holds the map of another version of {package}",
                where=where,
                expected=f"{kept.get(package)} as in the file, {anew}",
                got=number,
            )
    # The load is compared before the numbers that depend on it.
    for key in sorted(
        here, key=lambda name: (name == "mechanism", not name.startswith("load"))
    ):
        if key in ("files", "versions"):
            continue
        difference = _difference(there.get(key), here[key], key)
        if difference is None:
            continue
        part, a, b = difference
        if key == "mechanism":
            words = _PARTS.get(part, one_line(part))  # the file may name any part
            raise InputError(
                f"the file holds the map of another mechanism, with other {words}",
                where=where,
                expected=f"the same mechanism, {anew}",
            )
        raise InputError(
            f"the file holds another map: {part} differs",
            where=where,
            expected=f"{one_line(json.dumps(a))} as in the file, {anew}",
            got=json.dumps(b),
        )


def differing_parts(one: Mapping[str, Any], other: Mapping[str, Any]) -> list[str]:
    """Return, in words, what differs between the mechanisms of two identities."""
    a, b = one.get("mechanism", {}), other.get("mechanism", {})
    parts = _PARTS.items()
    return [
        f"other {words}"
        for part, words in parts
        if part != "q" and a.get(part) != b.get(part)
    ]


def _changed(there: list[list[str]], here: list[list[str]]) -> str | None:
    """Description of the first file that differs; None where all are the same."""
    digests = [digest for _, digest in there]
    if digests == [digest for _, digest in here]:
        return None
    for name, digest in here:
        if digest not in digests:
            known = name in [other for other, _ in there]
            return one_line(name) + (" was changed" if known else " was not read for it")
    for name, digest in there:
        if [name, digest] not in here:
            return f"{one_line(name)} is not read"
    return "files were read in another order"


def _difference(a: Any, b: Any, name: str) -> tuple[str, Any, Any] | None:
    """Name and values of the first part that differs; numbers may differ by rounding."""
    if isinstance(a, dict) and isinstance(b, dict):
        each = (_difference(a.get(key), b.get(key), key) for key in {**a, **b})
        return next(filter(None, each), None)
    if isinstance(a, list) and isinstance(b, list):
        differs = _lists_differ(a, b)
    else:
        differs = type(a) is not type(b) or a != b
    return (name, a, b) if differs else None


def _lists_differ(a: list[Any], b: list[Any]) -> bool:
    """Whether two lists differ; numbers may differ by the rounding of the largest."""
    if len(a) != len(b):
        return True
    if not (_numeric(a) and _numeric(b)):
        return any(_difference(x, y, "") for x, y in zip(a, b, strict=True))
    x, y = np.array(a, float), np.array(b, float)
    sizes = np.maximum(np.abs(x), np.abs(y))
    tolerance = _TOLERANCE * sizes + ROUNDOFF_OF_SUMS * sizes.max(initial=0.0)
    return bool(np.any(np.abs(x - y) > tolerance))


def _numeric(value: list[Any]) -> bool:
    return all(isinstance(v, (int, float)) and not isinstance(v, bool) for v in value)


def fingerprint(value: Any) -> str:
    """The SHA-256 of an object's contents, numbers to ten digits, without its shapes."""
    return _Fingerprints().of(value)


class _Fingerprints:
    """Fingerprints of objects that may share others, each computed once."""

    def __init__(self) -> None:
        # The objects are stored, too, so that no other can get their id.
        self._known: dict[int, tuple[Any, str]] = {}

    def of(self, value: Any) -> str:
        """Return that of one object, the same for equal objects in any process."""
        if isinstance(value, (float, np.floating)):
            return _digits(float(value), 0.0)
        if value is None or isinstance(
            value, (str, bytes, bool, int, complex, np.generic)
        ):
            return repr(value)
        if id(value) not in self._known:
            self._known[id(value)] = value, "itself"
            digest = sha256()
            for part in self._parts(value):
                digest.update(part.encode() + b"\0")
            self._known[id(value)] = value, digest.hexdigest()
        return self._known[id(value)][1]

    def _parts(self, value: Any) -> Iterator[str]:
        if isinstance(value, Description):
            return
        kind = type(value)
        is_code = isinstance(value, (type, types.FunctionType))
        own = value if is_code else kind
        version = getattr(value, "version", None)
        if isinstance(version, (str, int)) and not _is_installed(own.__module__):
            # In place of its code.
            yield f"{own.__module__}.{own.__qualname__} {version!r}"
            if not is_code:
                yield self.of(_state(value))
            return
        for kinds, parts_of in _KINDS:
            if isinstance(value, kinds):
                yield from parts_of(self, value)
                return
        yield f"{kind.__module__}.{kind.__qualname__}"
        if not _is_installed(kind.__module__):
            yield self.of(kind)
        yield self.of(_state(value))

    def _of_units(self, units: Units) -> Iterator[str]:
        """Not the unit of angles in tables for people."""
        yield f"{units.length} {units.force}"

    def _of_mapping(self, mapping: Mapping[Any, Any]) -> Iterator[str]:
        yield "mapping"
        for key, entry in sorted((repr(key), entry) for key, entry in mapping.items()):
            yield from (key, self.of(entry))

    def _of_array(self, value: NDArray[Any]) -> Iterator[str]:
        if value.dtype.kind != "f":
            yield from self._of_sequence(value)
            return
        largest = float(np.abs(value[np.isfinite(value)]).max(initial=0.0))
        yield f"{value.shape}"
        yield from (
            _digits(x, ROUNDOFF_OF_SUMS * largest) for x in value.ravel().tolist()
        )

    def _of_sequence(self, values: Any) -> Iterator[str]:
        yield f"{type(values).__name__} {len(values)}"
        yield from map(self.of, values)

    def _of_set(self, values: Collection[Any]) -> Iterator[str]:
        yield from sorted(map(self.of, values))

    def _of_model(self, model: pin.Model) -> Iterator[str]:
        yield from map(_token, model.saveToString().split())

    def _of_function(self, value: types.FunctionType) -> Iterator[str]:
        inside = [_content(cell) for cell in value.__closure__ or ()]
        yield value.__qualname__
        defaults = value.__defaults__, value.__kwdefaults__
        yield from map(self.of, [value.__code__, *defaults, inside, vars(value)])
        if not _is_installed(value.__module__):
            yield from map(self.of, _named_by(value))

    def _of_code(self, code: types.CodeType) -> Iterator[str]:
        yield from (code.co_code.hex(), repr(code.co_names), self.of(code.co_consts))

    def _of_named(self, value: Any) -> Iterator[str]:
        yield f"{getattr(value, '__module__', '')} {value.__name__}"
        if isinstance(value, type) and not _is_installed(value.__module__):
            yield self.of(value.__bases__)
            yield self.of({n: x for n, x in vars(value).items() if n not in _OF_CLASS})

    def _of_descriptor(self, value: Any) -> Iterator[str]:
        names = ("fget", "fset", "__func__", "func")
        yield type(value).__name__
        yield self.of([getattr(value, name, None) for name in names])


#: What the contents of an object are, by its kind: the first that it is.
_KINDS: tuple[tuple[Any, Callable[[_Fingerprints, Any], Iterator[str]]], ...] = (
    (Units, _Fingerprints._of_units),
    (Mapping, _Fingerprints._of_mapping),
    (np.ndarray, _Fingerprints._of_array),
    ((list, tuple), _Fingerprints._of_sequence),
    ((set, frozenset), _Fingerprints._of_set),
    (pin.Model, _Fingerprints._of_model),
    (types.FunctionType, _Fingerprints._of_function),
    (types.CodeType, _Fingerprints._of_code),
    (
        (type, types.BuiltinFunctionType, np.ufunc, types.ModuleType),
        _Fingerprints._of_named,
    ),
    (
        (property, classmethod, staticmethod, cached_property),
        _Fingerprints._of_descriptor,
    ),
)
# Attributes of a class that do not say what it does.
_OF_CLASS = {
    *(
        "__dict__",
        "__weakref__",
        "__module__",
        "__qualname__",
        "__doc__",
        "__annotations__",
    ),
    *("__firstlineno__", "__static_attributes__", "__abstractmethods__", "_abc_impl"),
    *("__slots__", "__parameters__", "__orig_bases__"),
}


@cache
def _is_installed(module: str | None) -> bool:
    """Whether a module is of an installed package or of Python,
    whose versions are compared.
    """
    if module in (None, "__main__"):
        return False
    file = getattr(sys.modules.get(module), "__file__", None)
    if file is None or module.partition(".")[0] == "cartstiff":
        return True
    paths = sysconfig.get_paths()
    folders = [
        Path(paths[key]).resolve()
        for key in ("stdlib", "platstdlib", "purelib", "platlib")
    ]
    return any(Path(file).resolve().is_relative_to(folder) for folder in folders)


def _content(cell: Any) -> Any:
    """Content of a closure's cell; None of one that is still empty."""
    try:
        return cell.cell_contents
    except ValueError:
        return None


def _named_by(function: types.FunctionType) -> list[tuple[str, Any]]:
    """Names and values of what the code of a function names in its module,
    and in modules there.
    """
    names, codes = set[str](), [function.__code__]
    for code in codes:
        names.update(code.co_names)
        codes += [const for const in code.co_consts if isinstance(const, types.CodeType)]
    found, known = list[tuple[str, Any]](), function.__globals__
    for name in sorted(names & known.keys()):
        found.append((name, known[name]))
        if inspect.ismodule(known[name]) and not _is_installed(known[name].__name__):
            inside = vars(known[name])
            found += [
                (f"{name}.{own}", inside[own]) for own in sorted(names & inside.keys())
            ]
    return found


def _state(value: Any) -> Any:
    """State of an object without its cached properties."""
    state, kind = _reduced(value), type(value)
    if not isinstance(state, dict):
        return state
    cached = {
        name
        for base in kind.__mro__
        for name, entry in vars(base).items()
        if isinstance(entry, cached_property)
    }
    if isinstance(
        value, Mechanism
    ):  # has units and base of its own, or those of its class
        for name in {"units", "base_pose"} & state.keys():
            if fingerprint(state[name]) == fingerprint(getattr(kind, name)):
                cached.add(name)
    return {name: entry for name, entry in state.items() if name not in cached}


def _reduced(value: Any) -> Any:
    """State of an object as pickling takes it."""
    try:
        state: Any = value.__reduce_ex__(4)
        if isinstance(state, str):
            return state
        is_plain = getattr(type(value), "__reduce__", None) is object.__reduce__
        return state[2] if is_plain else state[1:3]
    except Exception:  # an object that cannot be pickled
        raise InputError(
            "own code names an object whose contents cannot be compared with those of a "
            "file",
            where=one_line(f"{type(value).__module__}.{type(value).__qualname__}"),
            expected='an attribute version="1" of the function or class that names it',
        ) from None


def _token(word: str) -> str:
    """Word of Pinocchio's own text, numbers to ten digits."""
    try:
        return (
            word if word.lstrip("-").isdigit() else _digits(float(word), ROUNDOFF_OF_SUMS)
        )
    except ValueError:
        return word


def _digits(x: float, least: float) -> str:
    return "0" if abs(x) <= least else f"{x:.10g}"
