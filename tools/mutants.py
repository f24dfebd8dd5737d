"""Mutants of 40 mechanism files: each is refused in one line that names the place, or is right.

    python tools/mutants.py [--each N] [--seed N] [FILE...]

Every key of a file is dropped, doubled and misspelled; every number gets a unit of another kind,
and every list is one entry shorter and longer. `--each` mutants a file and kind are drawn from all
of them. `analyse` must refuse a doubled or misspelled key, a unit that does not fit and whatever
the published JSON schema calls wrong, in one line with the file and its key. What it answers must
be right: a key that has a default answers as the default does when it is written; the stiffness of
a platform on line springs is that of differences of its energy, computed here from the file alone;
a list that may be of any length is one of `FREE`.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import random
import re
import shutil
import sys
import tempfile
from collections import Counter, defaultdict
from collections.abc import Iterator
from contextlib import suppress
from copy import deepcopy
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from tools.fuzz_common import FaultError, command  # noqa: E402

#: Keys of text: a unit behind it is text as well.
TEXT = {"name", "description", "source", "date"}
#: Lists that may be of any length, where nothing else in the file counts them.
FREE = {"closures", "lines", "legs", "actuated", "passive", "polynomial", "joints", "points"}
FREE |= {"package_path", "undetermined", "compliances", "coupled_springs", "table"}
UNITS = ("kg", "s", "lightyear", "N m s", "%")

Way = tuple[str | int, ...]


class Mutant(NamedTuple):
    """A changed file: what was done, where, its data, and the key that stands twice."""

    kind: str
    at: Way
    data: Any
    doubled: Way | None = None


def files() -> list[Path]:
    """Every bundled mechanism, examples, and published cases of other kinds: 40."""
    own = [*sorted((ROOT / "robots").glob("*.yaml")), *sorted((ROOT / "examples").glob("*.yaml"))]
    cases = sorted((ROOT / "cases").glob("*/mechanism.yaml"))
    every = len(cases) // (40 - len(own))
    return [*own, *cases[::every]][:40]


# -- making them --------------------------------------------------------------------------------


def ways(data: Any, at: Way = ()) -> Iterator[Way]:
    """The way of keys to every value."""
    if not isinstance(data, (dict, list)):
        return
    for key, value in data.items() if isinstance(data, dict) else enumerate(data):
        yield (*at, key)
        yield from ways(value, (*at, key))


def value_at(data: Any, at: Way) -> Any:
    """The value at a way of keys."""
    for key in at:
        data = data[key]
    return data


def changed(data: Any, at: Way, value: Any) -> Any:
    """A copy with another value at a way of keys."""
    data = deepcopy(data)
    value_at(data, at[:-1])[at[-1]] = value
    return data


def misspelled(word: str, dice: random.Random) -> str:
    """A word with a letter lost, doubled, changed, or two letters exchanged."""
    i = dice.randrange(len(word))
    other = dice.choice("abcdefghijklmnopqrstuvwxyz_")
    pair = word[i : i + 2]
    ways = [
        word[:i] + word[i + 1 :],
        word[:i] + word[i] + word[i:],
        word[:i] + other + word[i + 1 :],
    ]
    ways.append(word[:i] + pair[::-1] + word[i + 2 :])
    return dice.choice([w for w in ways if w and w != word] or [f"{word}x"])


def mutants(data: Any, dice: random.Random) -> Iterator[Mutant]:
    """All mutants of a file's data."""
    for at in ways(data):
        value, key = value_at(data, at), at[-1]
        if isinstance(key, str):
            without = deepcopy(data)
            del value_at(without, at[:-1])[key]
            yield Mutant("dropped", at, without)
            yield Mutant("doubled", at, data, at)
            inside = value_at(data, at[:-1])
            while (name := misspelled(key, dice)) in inside:
                pass
            other = {name if k == key else k: v for k, v in inside.items()}
            yield Mutant("misspelled", at, changed(data, at[:-1], other) if at[:-1] else other)
        if isinstance(value, (int, float)) and not isinstance(value, bool):
            yield Mutant("wrong unit", at, changed(data, at, f"{value:g} {dice.choice(UNITS)}"))
        if isinstance(value, list) and value:
            yield Mutant("wrong length", at, changed(data, at, value[:-1]))
            yield Mutant("wrong length", at, changed(data, at, [*value, value[-1]]))


def written(mutant: Mutant) -> str:
    """The mutant as YAML: JSON, in which a key may stand twice."""

    def text(value: Any, at: Way) -> str:
        if isinstance(value, dict):
            pairs = [f"{json.dumps(k)}: {text(v, (*at, k))}" for k, v in value.items()]
            pairs += [
                f"{json.dumps(k)}: {text(v, (*at, k, ''))}"
                for k, v in value.items()
                if (*at, k) == mutant.doubled
            ]
            return f"{{{', '.join(pairs)}}}"
        if isinstance(value, list):
            return f"[{', '.join(text(v, (*at, i)) for i, v in enumerate(value))}]"
        if isinstance(value, float) and not math.isfinite(value):
            return ".inf" if value > 0 else "-.inf"
        return json.dumps(value)

    return text(mutant.data, ())


# -- judging them -------------------------------------------------------------------------------


@cache
def _schema() -> Any:
    from jsonschema import Draft202012Validator

    from cartstiff.extend import file_schema

    return Draft202012Validator(file_schema())


def is_wrong_by_schema(data: Any) -> bool:
    """Whether the published JSON schema refuses the data; arithmetic stands for any number."""
    return next(_schema().iter_errors(_without_arithmetic(data)), None) is not None


def _without_arithmetic(data: Any) -> Any:
    if isinstance(data, dict):
        kept = {k: _without_arithmetic(v) for k, v in data.items() if k != "parameters"}
        return kept
    if isinstance(data, list):
        return [_without_arithmetic(v) for v in data]
    if isinstance(data, str) and (data.startswith("=") or _GIVEN.fullmatch(data)):
        return 1.0
    return data


# A stiffness with its unit, which the schema calls a number.
_GIVEN = re.compile(r"[\d.e+-]+ *[kMm]?N[ /*].*")


def _default(data: Any, at: Way) -> Any:
    """The default of a key in the published schema; None where it has none."""
    schema = _schema().schema
    kinds = schema["discriminator"]["mapping"]
    node = {"$ref": kinds[data["kind"]]} if data.get("kind") in kinds else {}
    for i, key in enumerate(at):
        node = _inner(schema, node, key)
        if node is None:
            return None
        if i == len(at) - 1:
            return node.get("default")
    return None


def _inner(schema: Any, node: Any, key: str | int) -> Any:
    """The schema of what is at a key; None where several may be meant."""
    found = [n for n in _alternatives(schema, node) if "properties" in n or "items" in n]
    if len(found) != 1:
        return None
    if isinstance(key, int):
        return found[0].get("items")
    own = found[0].get("properties", {})
    return own.get(key)


def _alternatives(schema: Any, node: Any) -> list[Any]:
    if "$ref" in node:
        node = schema["$defs"][node["$ref"].rpartition("/")[2]]
    return (
        [one for n in node["anyOf"] for one in _alternatives(schema, n)]
        if "anyOf" in node
        else [node]
    )


def answer(text: str, name: str) -> tuple[int, Any, str]:
    """Exit code, JSON and error of `analyse`."""
    Path(name).write_text(text, encoding="utf-8")
    code, out, error = command(["analyse", name, "--json", "--analysis", "none"])
    return code, json.loads(out) if out.startswith("{") else None, error


def fault(mutant: Mutant, name: str) -> str:
    """What is wrong with the answer to a mutant; empty if it is refused or right."""
    try:
        code, got, error = answer(written(mutant), name)
    except FaultError as broken:
        return str(broken)
    if code == 2:
        is_placed = name in error
        return "" if is_placed else f"the refusal does not name the file: {error.strip()}"
    is_text = any(part in TEXT for part in mutant.at)
    if mutant.kind in ("doubled", "misspelled", "wrong unit") and not (
        is_text and mutant.kind == "wrong unit"
    ):
        return "accepted"
    if is_wrong_by_schema(mutant.data):
        return "accepted, against the JSON schema"
    if mutant.kind == "wrong length":
        value = value_at(mutant.data, mutant.at)
        twice = mutant.at[-1] == "actuated" and len({*value}) != len(value)
        if twice or mutant.at[-1] not in FREE:
            return "accepted"
    default = _default(mutant.data, mutant.at) if mutant.kind == "dropped" else None
    if default is not None:
        with suppress(KeyError, IndexError, TypeError):
            explicit = changed(mutant.data, mutant.at, default)
            _, other, refused = answer(written(Mutant("", (), explicit)), name)
            if other is None:
                return f"the written default is refused: {refused.strip()}"
            if not _same(got, other):
                return "another answer than with the default written"
    return _against_energy(mutant.data, got)


def _same(a: Any, b: Any) -> bool:
    keys = ("q", "pose", "wrench", "stiffness")
    return all(_near(a.get(key), b.get(key)) for key in keys)


def _near(a: Any, b: Any) -> bool:
    if isinstance(a, dict) and isinstance(b, dict):
        return a.keys() == b.keys() and all(_near(a[k], b[k]) for k in a)
    if a is None or b is None or isinstance(a, str):
        return a == b
    a, b = np.array(a, float), np.array(b, float)
    return a.shape == b.shape and bool(
        np.allclose(a, b, rtol=0, atol=1e-11 * max(1e-300, np.abs(a).max(initial=0.0)))
    )


def _against_energy(data: Any, got: Any) -> str:
    """Compare K^B of a platform on plain line springs with differences of its energy."""
    legs = data.get("legs") if isinstance(data, dict) else None
    plain = {"stiffness", "rest_length", "preload", "limits", "force", "diameter", "damping"}
    plain |= {"mass", "driven", "base_joints", "platform_joints"}
    if (
        data.get("kind") not in ("stewart-gough", "springs")
        or not isinstance(legs, dict)
        or not {*legs} <= plain
        or {"layout", "flexible", "gravity", "payload", "parameters", "unilateral"} & {*data}
        or isinstance(legs.get("stiffness"), str)
        or got["stiffness"]["B"] is None
    ):
        return ""
    base, points = np.array(data["base"], float), np.array(data["platform"], float)
    k = np.broadcast_to(np.array(legs["stiffness"], float), len(base))
    T_F_P, T_P_M = _pose(data.get("pose", {})), _pose(data.get("frame", {}))
    T_F_M = T_F_P @ T_P_M
    points = (points @ T_P_M[:3, :3]) - T_P_M[:3, :3].T @ T_P_M[:3, 3]

    def lengths(twist: Any) -> Any:
        at = T_F_M @ _moved(twist)
        return np.linalg.norm(points @ at[:3, :3].T + at[:3, 3] - base, axis=1)

    here = lengths(np.zeros(6))
    tension = np.zeros(len(base))
    if "rest_length" in legs:
        tension = k * (here - np.array(legs["rest_length"], float))
    elif "preload" in legs:
        tension = np.broadcast_to(np.array(legs["preload"], float), len(base))
    if len(base) > 6 and tension.any():
        return ""  # tensions that balance are chosen

    def energy(twist: Any) -> float:
        change = lengths(twist) - here
        return float(np.sum(tension * change + 0.5 * k * change**2))

    h = 1e-3 * np.array([1.0] * 3 + [float(here.max())] * 3)
    hessian = np.zeros((6, 6))
    for i in range(6):
        for j in range(i + 1):
            steps = [
                np.eye(6)[i] * h[i] * a + np.eye(6)[j] * h[j] * b for a in (1, -1) for b in (1, -1)
            ]
            e = [energy(s) for s in steps]
            hessian[i, j] = hessian[j, i] = (e[0] - e[1] - e[2] + e[3]) / (4 * h[i] * h[j])
    # Along exponentials of twists, the geodesics of this connection.
    K = np.array(got["stiffness"]["B"], float)
    off = np.abs(0.5 * (K + K.T) - hessian)
    worst = 0.0
    for i, j in ((0, 0), (0, 3), (3, 3)):
        block = np.s_[i : i + 3, j : j + 3]
        # Of a block whose entries cancel the size is that of what is summed.
        size = k.sum() * float(np.abs(points).max() + here.max()) ** (2 - (i + j) // 3)
        worst = max(worst, off[block].max() / max(np.abs(hessian[block]).max(), 1e-3 * size))
    return "" if worst < 1e-3 else f"K^B differs from the energy by {worst:.1e}"


def _pose(entry: Any) -> Any:
    x, y, z = entry.get("rpy", [0, 0, 0])
    R = _turn(2, z) @ _turn(1, y) @ _turn(0, x)
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R, entry.get("xyz", [0, 0, 0])
    return T


def _turn(axis: int, angle: float) -> Any:
    i, j = (axis + 1) % 3, (axis + 2) % 3
    R = np.eye(3)
    R[[i, j], [i, j]] = math.cos(angle)
    R[j, i], R[i, j] = math.sin(angle), -math.sin(angle)
    return R


def _moved(twist: Any) -> Any:
    """The exponential of a twist of the body."""
    angle = float(np.linalg.norm(twist[:3]))
    T = np.eye(4)
    T[:3, 3] = twist[3:]
    if angle:
        x, y, z = twist[:3] / angle
        A = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        T[:3, :3] += math.sin(angle) * A + (1 - math.cos(angle)) * A @ A
        along = (1 - math.cos(angle)) * A + (angle - math.sin(angle)) * A @ A
        T[:3, 3] += along @ twist[3:] / angle
    return T


# -- running ------------------------------------------------------------------------------------


def read(path: Path) -> Any:
    """The data of a file, by another reader than the one that is tested."""
    from ruamel.yaml import YAML

    return json.loads(json.dumps(YAML(typ="safe", pure=True).load(path.read_text("utf-8"))))


def drawn(path: Path, each: int, seed: int) -> list[Mutant]:
    """So many mutants of each kind, or all of them."""
    dice = random.Random(f"{seed} {path.parent.name}/{path.name}")
    kinds: defaultdict[str, list[Mutant]] = defaultdict(list)
    for mutant in mutants(read(path), dice):
        kinds[mutant.kind].append(mutant)
    return [m for some in kinds.values() for m in dice.sample(some, min(each, len(some)))]


def judged(path: Path, each: int, seed: int) -> Iterator[tuple[Mutant, str]]:
    """Every drawn mutant of a file with its fault, in a folder of its own."""
    before = Path.cwd()
    with tempfile.TemporaryDirectory() as folder:
        for beside in path.parent.iterdir():
            if beside.suffix in (".urdf", ".xml", ".xacro", ".csv"):
                shutil.copy(beside, folder)
        os.chdir(folder)
        try:
            for mutant in drawn(path, each, seed):
                yield mutant, fault(mutant, "mutant.yaml")
        finally:
            os.chdir(before)


def main() -> None:
    """Run them, print what is neither refused nor right, and how many there were of each kind."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("files", nargs="*", type=Path)
    parser.add_argument("--each", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    counts, faults = Counter[str](), 0
    chosen = [path.resolve() for path in given.files] or files()
    for path in chosen:
        for mutant, wrong in judged(path, given.each, given.seed):
            counts[mutant.kind] += 1
            if wrong:
                faults += 1
                way = ".".join(map(str, mutant.at))
                print(f"{path.parent.name}/{path.name}: {mutant.kind} {way}: {wrong}", flush=True)
    said = ", ".join(f"{n} {kind}" for kind, n in counts.most_common())
    print(f"{len(chosen)} files, {sum(counts.values())} mutants ({said}): {faults} faults")
    sys.exit(1 if faults else 0)


if __name__ == "__main__":
    main()
