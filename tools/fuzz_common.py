"""Odd values, damaged files, and the command line judged by its contract."""

from __future__ import annotations

import io
import json
import math
import random
import re
import xml.etree.ElementTree as ET
from contextlib import redirect_stderr, redirect_stdout
from copy import deepcopy
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
ODD_NUMBERS = [
    0.0,
    -0.0,
    1.0,
    -1.0,
    1e-300,
    5e-324,
    1e30,
    1.1e30,
    1e300,
    -1e308,
    math.nan,
    math.inf,
    -math.inf,
    3.141592653589793,
    1e-12,
    2**53 + 1,
    10**400,
    -7,
    True,
]
ODD_TEXTS = [
    "",
    " ",
    "nan",
    "inf",
    "1e400",
    "-1",
    "0x10",
    "1_000",
    "x",
    "../..",
    "/dev/zero",
    "\x1b[1m",
    "\u202e",
    "é" * 50,
    "a" * 5000,
    "world",
    "universe",
    "~",
    "=2*r",
    "null",
    "[]",
    "1,2,3",
    "\ud800",
    "$\\frac$",
    "%s",
    "{}",
    "<b>",
]


class FaultError(Exception):
    """What a contract forbids."""


def odd(rng: random.Random, depth: int = 0) -> Any:
    """A value of any kind."""
    kind = rng.random()
    if kind < 0.45:
        return rng.choice(ODD_NUMBERS)
    if kind < 0.7:
        return rng.choice(ODD_TEXTS)
    if kind < 0.8 or depth > 2:
        return None
    if kind < 0.95:
        return [odd(rng, depth + 1) for _ in range(rng.choice([0, 1, 2, 3, 6, 7]))]
    return {rng.choice(ODD_TEXTS): odd(rng, depth + 1) for _ in range(2)}


def mutated_bytes(rng: random.Random, data: bytes) -> bytes:
    """A few bytes, words or lines changed, lost or doubled."""
    kind = rng.randrange(4)
    if kind == 0 and data:
        changed = bytearray(data)
        signs = bytes(range(256)) if rng.random() < 0.3 else b'0123456789.,;:- e\n"<>{}[]xa'
        for _ in range(rng.randint(1, 4)):
            changed[rng.randrange(len(changed))] = rng.choice(signs)
        return bytes(changed)
    if kind == 1:
        words = re.split(rb"([\w.+-]+)", data)
        if len(words) > 1:
            at = 2 * rng.randrange(len(words) // 2) + 1
            words[at] = str(odd(rng)).encode("utf-8", "replace")
        return b"".join(words)
    lines = data.splitlines(keepends=True) or [b""]
    i, j = rng.randrange(len(lines)), rng.randrange(len(lines))
    if kind == 2:
        lines[i], lines[j] = lines[j], lines[i]
    elif rng.random() < 0.5:
        lines.insert(j, lines[i])
    else:
        del lines[i:]
    return b"".join(lines)


def mutated_data(rng: random.Random, data: Any) -> Any:
    """A tree of lists and mappings with one value replaced, lost or doubled."""
    data = json.loads(json.dumps(data))
    places: list[tuple[Any, Any]] = []

    def walk(node: Any) -> None:
        for key in list(node) if isinstance(node, dict) else range(len(node)):
            places.append((node, key))
            if isinstance(node[key], (dict, list)):
                walk(node[key])

    walk(data)
    for _ in range(rng.randint(1, 2)):
        node, key = rng.choice(places)
        try:
            action = rng.random()
            if action < 0.6:
                node[key] = odd(rng)
            elif action < 0.8:
                del node[key]
            elif isinstance(node, list):
                node.insert(key, node[key])
            else:
                node[rng.choice(ODD_TEXTS)] = node.pop(key)
        except (KeyError, IndexError):
            continue
    return data


def nudged(rng: random.Random, number: float) -> float:
    """A number that may stand where another one does: the file stays one of its kind."""
    return rng.choice(
        [
            0.0,
            1.0,
            -number,
            2.0 * number,
            1e-6 * number,
            1e4 * number,
            math.pi / 2,
            number + 1e-9,
            number * rng.uniform(0.5, 2.0),
            rng.uniform(-1, 1),
            round(number),
        ]
    )


def nudged_data(rng: random.Random, data: Any) -> Any:
    """A tree of lists and mappings with some of its numbers nudged."""
    data = json.loads(json.dumps(data))
    places: list[tuple[Any, Any]] = []

    def walk(node: Any) -> None:
        for key in list(node) if isinstance(node, dict) else range(len(node)):
            if isinstance(node[key], (dict, list)):
                walk(node[key])
            elif isinstance(node[key], (int, float)) and not isinstance(node[key], bool):
                places.append((node, key))

    walk(data)
    for node, key in rng.sample(places, min(len(places), rng.randint(1, 4))):
        node[key] = nudged(rng, node[key])
    return data


def nudged_xml(rng: random.Random, text: str) -> bytes:
    """Some of the numbers in a text of tags nudged."""
    words = re.split(r"(?<=[\s\"])(-?\d+\.?\d*(?:e-?\d+)?)(?=[\s\"])", text)
    odd_places = range(1, len(words), 2)
    for at in rng.sample(odd_places, min(len(odd_places), rng.randint(1, 4))):
        words[at] = f"{nudged(rng, float(words[at])):.9g}"
    return "".join(words).encode()


def mutated_xml(rng: random.Random, text: str) -> bytes:
    """Attributes and elements changed, lost, doubled or moved."""
    root = ET.fromstring(text)
    everything = list(root.iter())
    for _ in range(rng.randint(1, 3)):
        element, other = rng.choice(everything), rng.choice(everything)
        action = rng.randrange(6)
        if action < 3 and element.attrib:
            key = rng.choice(list(element.attrib))
            words = element.attrib[key].split() or [""]
            words[rng.randrange(len(words))] = str(odd(rng))
            element.attrib[key] = " ".join(words)
        elif action == 3 and element.attrib:
            del element.attrib[rng.choice(list(element.attrib))]
        elif action == 4 and len(other):
            other.remove(other[rng.randrange(len(other))])
        elif len(other) < 40:
            other.append(deepcopy(element))
    return ET.tostring(root, encoding="unicode").encode("utf-8", "replace")


def command(words: list[str]) -> tuple[int, str, str]:
    """Exit code and output of the command line, judged by its contract."""
    from cartstiff.shown.cli.main import main

    out, errors = io.StringIO(), io.StringIO()
    words = [word.replace("\0", "") for word in words]
    with redirect_stdout(out), redirect_stderr(errors):
        try:
            main(words)
            code = 0
        except SystemExit as end:
            code = int(end.code or 0)
    said, line = out.getvalue(), errors.getvalue()
    if code not in (0, 2, 3):
        raise FaultError(f"{words}: exit {code}: {line[:300]}")
    if code == 2 and not (line.startswith("cartstiff: ") and line.count("\n") == 1):
        raise FaultError(f"{words}: refused in {line.count(chr(10))} lines: {line[:300]!r}")
    if code == 2 and said and "--json" in words:
        raise FaultError(f"{words}: refused, and yet an answer")
    if code == 0 and "--json" in words and not {"--help", "--help-all"} & set(words) and said:
        json.loads(said, parse_constant=lambda name: _not_json(words, name))
    return code, said, line


def _not_json(words: list[str], name: str) -> None:
    raise FaultError(f"{words}: {name} in JSON")


def outcome(code: int) -> str:
    """An exit code in words."""
    return {0: "answered", 2: "refused", 3: "undefined"}[code]
