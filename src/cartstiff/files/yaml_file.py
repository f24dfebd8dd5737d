"""Read YAML 1.2 safely into plain data, with the line of every key."""

from __future__ import annotations

import math
import os
import re
import stat
from contextlib import suppress
from copy import deepcopy
from functools import cache, lru_cache
from importlib import import_module
from pathlib import Path
from typing import Any

from cartstiff.core.errors import InputError, one_line
from cartstiff.files.identity import was_read

#: Keys and indices on the way to a value, and the line of each value.
Way = tuple[str | int, ...]
Lines = dict[Way, int]

#: Largest size of a mechanism file in bytes: such a file is a page of text.
LARGEST = 1024 * 1024
#: Largest number of keys, values and list entries, repeated by aliases; 40 000 take two
#: seconds.
MOST_VALUES = 40_000
_MAX_DEPTH = 30
# More brackets in a row than any mechanism file has: they cost the parser seconds.
_BRACKETS = re.compile(r"(?:[\[{]\s*){60}")
_COMMENTS = re.compile(r"^\s*(?:#.*)?$", re.MULTILINE)
_MERGE = "tag:yaml.org,2002:merge"
_WORDS: dict[str, dict[str, Any]] = {
    "null": dict.fromkeys(("", "~", "null")),
    "bool": {"true": True, "false": False},
}


def checked_status(path: Path, largest: int, where: str) -> os.stat_result:
    """The status of a regular file; refuse other files, and one that is too large."""
    try:
        status = path.stat()
    except (OSError, ValueError) as error:  # ValueError: a zero byte in the name
        raise _unreadable(error, where) from None
    if stat.S_ISDIR(status.st_mode):
        raise InputError("is a directory", where=where, expected="a file")
    if not stat.S_ISREG(status.st_mode):  # reading a pipe or a device may never end
        raise InputError("is not a regular file", where=where, expected="a file")
    if (size := status.st_size) > largest:
        expected = f"at most {largest} bytes"
        raise InputError(
            "file is too large", where=where, expected=expected, got=str(size)
        )
    return status


def _unreadable(error: Exception, where: str) -> InputError:
    problem = getattr(error, "strerror", None) or str(error)
    return InputError("file cannot be read", where=where, got=problem)


def read_bytes(path: Path, largest: int = LARGEST, *, recorded: bool = True) -> bytes:
    """Read a file; refuse one that is too large, is empty or cannot be read.

    With `recorded` its content belongs to the identity of what is made from it.
    """
    where = one_line(str(path))
    checked_status(path, largest, where)
    try:
        with path.open("rb") as file:
            data = file.read(largest + 1)
    except OSError as error:
        raise _unreadable(error, where) from None
    if len(data) > largest:  # the file grew since its size was taken
        raise InputError(
            "file is too large", where=where, expected=f"at most {largest} bytes"
        )
    if not data.strip():
        raise InputError("file is empty", where=where)
    if recorded:
        was_read(path.name, data)
    return data


def read_text(path: Path, largest: int = LARGEST, *, recorded: bool = True) -> str:
    """Read a UTF-8 text file, `path`, of at most `largest` bytes.

    What is `recorded` is among the files that a mechanism names.

    Raises
    ------
    InputError
        For a file that cannot be read, is too large, or holds no text.
    """
    try:
        text = read_bytes(path, largest, recorded=recorded).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(
            "file is not UTF-8 text", where=one_line(str(path)), got=f"byte {error.start}"
        ) from None
    if "\0" in text:
        raise InputError("file is not text", where=one_line(str(path)), got="a zero byte")
    return text


def read_yaml(path: Path) -> tuple[dict[str, Any], Lines]:
    """Read the mapping in a YAML file, and the line of each of its values.

    Only mappings, sequences and plain scalars are accepted: no tags, no key twice, no
    second document. An alias is a copy of its anchor's value; ``<<`` adds the keys of one
    or several mappings, of which the first has precedence, and keys beside it have
    precedence over all. Numbers follow YAML 1.2 (``3e5`` is a number, ``1:30`` is text).

    Raises
    ------
    InputError
        With file and line.
    """
    data, lines = _parsed(read_text(path, recorded=False), one_line(str(path)))
    # Comments and the order of keys say nothing.
    was_read(path.name, repr(_in_order(data)).encode())
    return deepcopy(data), lines.copy()


def _in_order(value: Any) -> Any:
    """The values of a file, mappings as sorted pairs."""
    if isinstance(value, dict):
        return "mapping", sorted(
            (repr(key), _in_order(entry)) for key, entry in value.items()
        )
    return [_in_order(entry) for entry in value] if isinstance(value, list) else value


@lru_cache(maxsize=32)  # a design study reads the same file for each of its machines
def _parsed(text: str, where: str) -> tuple[dict[str, Any], Lines]:
    from yaml import YAMLError

    _check_directives(text, where)
    if _BRACKETS.search(text):
        raise InputError("YAML is nested too deeply", where=where)
    # Every value but the first follows one of these characters, so that their number is a
    # bound.
    _check_count(sum(map(text.count, ",:\n")) - len(_COMMENTS.findall(text)), where)
    lines: Lines = {}
    try:
        documents = _documents(text)
        if len(documents) != 1 or documents[0] is None:
            raise InputError(
                "file must hold one YAML document",
                where=where,
                got="several" if len(documents) > 1 else "none",
            )
        data = _Reader(lines, where).plain(documents[0], ())
    except YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        line = f", line {mark.line + 1}" if mark is not None else ""
        problem = getattr(error, "problem", None) or str(error)
        raise InputError(
            "not valid YAML", where=where + line, got=one_line(problem)
        ) from None
    except RecursionError:
        raise InputError("YAML is nested too deeply", where=where) from None
    if not isinstance(data, dict):
        raise InputError(
            "file must hold a mapping of keys",
            where=where,
            expected="'kind: ...' and so on",
            got=type(data).__name__,
        )
    return data, lines


#: Plain scalars of YAML 1.2 that are no text, and the characters that they begin with.
_SCALARS = {
    "null": (r"~|null|Null|NULL|", ["~", "n", "N", ""]),
    "bool": (r"true|True|TRUE|false|False|FALSE", list("tTfF")),
    "int": (r"[-+]?(?:[0-9]+|0o[0-7]+|0x[0-9a-fA-F]+)", list("-+0123456789")),
    "float": (
        r"[-+]?(?:[0-9]+\.?|[0-9]*\.[0-9]+)(?:[eE][-+]?[0-9]+)?"
        r"|[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN)",
        list("-+.0123456789"),
    ),
    "merge": (r"<<", ["<"]),
}


def with_scalars(resolver: Any) -> Any:
    """A class of PyYAML's that reads or writes, made to know the scalars of YAML 1.2."""
    for kind, (pattern, first) in _SCALARS.items():
        tag = f"tag:yaml.org,2002:{kind}"
        resolver.add_implicit_resolver(tag, re.compile(f"(?:{pattern})$"), first)
    return resolver


@cache
def _loader(pure: bool) -> Any:
    """A class that composes nodes in Python, which limits their depth.

    Libyaml or Python parses.
    """
    from yaml.composer import Composer
    from yaml.parser import Parser
    from yaml.reader import Reader
    from yaml.resolver import BaseResolver
    from yaml.scanner import Scanner

    class Python(Reader, Scanner, Parser):  # type: ignore[misc]
        def __init__(self, text: str) -> None:
            Reader.__init__(self, text)
            Scanner.__init__(self)
            Parser.__init__(self)

    events: Any = Python
    if not pure:
        with suppress(ImportError):  # a build of PyYAML without libyaml
            events = import_module("yaml.cyaml").CParser

    class Loader(Composer, events, BaseResolver):  # type: ignore[misc]
        def __init__(self, text: str) -> None:
            events.__init__(self, text)
            Composer.__init__(self)
            BaseResolver.__init__(self)

    return with_scalars(Loader)


def _documents(text: str, pure: bool = False) -> list[Any]:
    """Root nodes of a text's first two documents."""
    from yaml import YAMLError

    loader = _loader(pure)(text)
    try:
        return [loader.get_node() for _ in range(2) if loader.check_node()]
    except YAMLError:
        if pure:
            raise
    return _documents(text, pure=True)  # whose errors say which character is wrong


def _check_directives(text: str, where: str) -> None:
    """Refuse all but %YAML 1.2: under 1.1 "yes", "no", "on",
    010 and 1:30 mean other things.
    """
    for number, line in enumerate(text.splitlines(), start=1):
        if line.startswith("%"):
            if not re.fullmatch(r"%YAML\s+1\.2\s*(#.*)?", line):
                raise InputError(
                    "YAML directives are not supported",
                    where=f"{where}, line {number}",
                    got=line,
                )
        elif line.strip() and not line.lstrip().startswith("#"):
            return


class _Reader:
    """Converts composed nodes to plain Python data; refuses everything else."""

    def __init__(self, lines: Lines, where: str) -> None:
        self._lines, self._where = lines, where
        self._seen = 0

    def plain(self, node: Any, at: Way) -> Any:
        """Return the data of the node at some keys."""
        line = node.start_mark.line + 1
        place = f"{self._where}, line {line}"
        self._lines[at] = line
        # The number of lines would be too small: merged mappings share the lines of
        # common keys.
        self._seen += 1
        _check_count(self._seen, place)
        if len(at) > _MAX_DEPTH:  # an alias may be inside its own anchor
            raise InputError("YAML is nested too deeply", where=place)
        tag = str(node.tag or "")
        if node.id == "mapping":
            return self._mapping(node, at, place, tag)
        if node.id == "sequence":
            if tag != "tag:yaml.org,2002:seq":
                raise InputError("YAML tags are not supported", where=place, got=tag)
            return [self.plain(value, (*at, i)) for i, value in enumerate(node.value)]
        return _scalar(node, tag, place)

    def _mapping(self, node: Any, at: Way, place: str, tag: str) -> dict[str, Any]:
        if tag != "tag:yaml.org,2002:map":
            raise InputError("YAML tags are not supported", where=place, got=tag)
        pairs, merged = [], list[Any]()
        for key_node, value in node.value:
            key, line = str(key_node.tag), key_node.start_mark.line + 1
            key_place = f"{self._where}, line {line}"
            if key_node.id != "scalar":
                raise InputError("keys must be plain text", where=key_place)
            if key == _MERGE:
                if merged:
                    raise InputError("key stands twice", where=key_place, got="'<<'")
                merged = value.value if value.id == "sequence" else [value]
                if any(part.id != "mapping" for part in merged):
                    raise InputError(
                        "cannot be merged",
                        where=key_place,
                        expected="a mapping, or a list of mappings",
                    )
            elif not key.startswith("tag:yaml.org,2002:") or "/" in key:
                raise InputError(
                    "YAML tags are not supported", where=key_place, got=key_node.tag
                )
            else:
                pairs.append((_text(key_node, key_place), line, value))
        data: dict[str, Any] = {}
        for part in reversed(merged):  # the first has precedence
            data |= self.plain(part, at)
        own: set[str] = set()
        for key, line, value in pairs:
            if key in own:
                raise InputError(
                    "key stands twice", where=f"{self._where}, line {line}", got=repr(key)
                )
            own.add(key)
            data[key] = self.plain(value, (*at, key))
            self._lines[(*at, key)] = line
        return data


def _check_count(count: int, where: str) -> None:
    if count > MOST_VALUES:
        raise InputError(
            "too many values", where=where, expected=f"at most {MOST_VALUES}", got=count
        )


def _text(node: Any, place: str) -> str:
    text = str(node.value)
    if re.search("[\ud800-\udfff]", text):  # which no encoding of text can write
        raise InputError("half a character in the text", where=place, got=repr(text))
    return text


def _scalar(node: Any, tag: str, place: str) -> Any:
    kind = tag.removeprefix("tag:yaml.org,2002:")
    text = _text(node, place)
    # An explicit tag (!!bool abc) may precede any text: it is used only where the text
    # fits.
    words = _WORDS.get(kind, {})
    if text.lower() in words:
        return words[text.lower()]
    if kind in ("int", "float") and "_" not in text:  # 1_000 is text in YAML 1.2
        number = re.sub(r"^([-+]?)\.(inf|nan)$", r"\1\2", text.lower())
        for convert in (lambda x: int(x, 0), float):
            with suppress(ValueError):
                value = convert(number)
                # A number beyond all floats is kept as text, which whoever needs a number
                # refuses.
                return text if abs(value) == math.inf and "inf" not in number else value
    if kind in ("", "str", "timestamp", "value", "null", "bool", "int", "float"):
        return text
    raise InputError("YAML tags are not supported", where=place, got=tag)
