"""The answer to every question: its text and its JSON state the same numbers, verdict and doubts.

Mechanisms and set-ups are generated. The numbers of a text are read from its lines by what they
look like, not by the code that wrote them; a number of the JSON is found there if one of them is
it in another unit: a power of ten of it, or degrees of it.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
import yaml
from tests.doors import DOUBTS
from tests.laws.test_set_ups import SetUp, later, posture
from tests.support.commands import answer, run
from tests.support.generated import Arm, numbers
from tests.support.printed import fixed_words

SEEDS = [3, *later(0, 4, 5, 6)]
_NUMBER = re.compile(r"(?<![\w.])[-+]?\d+\.?\d*(?:e[-+]?\d+)?")
#: Numbers that texts may write as 0.
_ROUNDOFF = 1e-9


def _names(n: int) -> list[str]:
    return [f"j{i}" for i in range(n)]


def _measured(one: SetUp) -> str:
    """Displacements under forces, by the compliance."""
    rng = np.random.default_rng(5)
    rows = []
    for _ in range(3 * one.arm.n):
        q = one.arm.q + rng.uniform(-1, 1, one.arm.n) * np.where(one.arm.slides, 0.02, 0.8)
        force = rng.uniform(-60, 60, 3)
        R = one.arm.pose(q)[:3, :3]
        W = np.concatenate([np.zeros(3), R.T @ force])
        rows.append([*q, *force, *(R @ (one.arm.compliance(q) @ W)[3:])])
    heads = [*_names(one.arm.n), *(f"f{c}" for c in "xyz"), *(f"d{c}" for c in "xyz")]
    return "\n".join([",".join(heads), *map(numbers, rows)])


def _questions(one: SetUp) -> dict[str, list[str]]:
    """The words of every question to a generated arm, without --json."""
    q, folder = posture(one.arm, "elsewhere"), one.folder
    postures = folder / "postures.csv"
    postures.write_text("\n".join([",".join(_names(one.arm.n)), numbers(one.arm.q), numbers(q)]))
    study = folder / "study.yaml"
    k, file = float(one.arm.k[0]), str(one.file())
    study.write_text(
        yaml.safe_dump(
            {
                "mechanism": file,
                "variables": {"k0": {"values": [k, 2.0 * k, 3.0 * k]}},
                "objectives": {"soft": {"quantity": "translation_held_min"}},
                "constraints": {"stiff": {"value": "=k0", "at_least": 1.5 * k}},
            }
        )
    )
    other = folder / "other.yaml"
    other.write_text((folder / "without-.yaml").read_text())
    at, load = ["--q", numbers(q)], one.words(q)
    spreads = [f"--sd d{c}=0.02mm" for c in "xyz"]
    return {
        "modes": ["modes", file, *at, *load],
        "map": [
            "map", file, *load, "--random 6", "--quantity translation_held_min", "--best 2",
            f"-o {folder / 'm.zarr'}",
        ],
        "curve": ["equilibrium", file, *at, *load, "--curve 0.4"],
        "compensation": ["equilibrium", file, f"--path {postures}", "--against all"],
        "plan": ["identify", file, "--plan 3", "--force 50", *spreads],
        "design": ["design", str(study)],
        "compare": ["compare", file, str(other), "--with k0=" + repr(0.7 * k), *at, *load],
    }  # fmt: skip


def _scalars(value: Any, key: str = "") -> Iterator[float]:
    """Numbers that a sentence or a cell states."""
    if isinstance(value, bool) or key in ("frame_offset", "rest"):
        return
    if key == "search":  # of whose counts a text states those that are not 0
        value = {name: x for name, x in value.items() if x and name in ("real", "total")}
    if key == "parts":  # of shares, whose sentence is about the largest
        value = value[:1]
    if isinstance(value, (int, float)):
        yield float(value)
    elif isinstance(value, dict):
        for name, part in value.items():
            yield from _scalars(part, name)
    elif isinstance(value, list):
        for part in value:
            yield from _scalars(part)


def _is_stated(x: float, line: str) -> bool:
    """Whether a line has a number to its last printed digit, in whatever unit it is."""
    for word in _NUMBER.findall(line):
        digits, _, power = word.partition("e")
        y = abs(float(word))
        last = 10.0 ** (int(power or 0) - len(digits.partition(".")[2]))
        sizes = [abs(x) * scale for scale in (1.0, 1e3, math.degrees(1.0))]
        if y == 0.0:  # of fixed decimal places, or round-off
            if min(sizes) <= (0.51 * last if "." in word else _ROUNDOFF):
                return True
            continue
        for size in sizes if x else ():
            scaled = size * 10.0 ** round(math.log10(y / size))
            if abs(scaled - y) <= 0.51 * last:
                return True
    return False


def _parts(text: str) -> dict[str, list[str]]:
    """Lines of a text under their titles, which have an empty line before them."""
    parts: dict[str, list[str]] = {"": []}
    title = ""
    lines = text.splitlines()
    for before, line in zip(["x", *lines], lines, strict=False):
        if not before and line:
            title = line
            parts.setdefault(title, [])
        elif line:
            parts[title].append(line)
    return parts


def check(text: str, data: dict[str, Any]) -> None:
    """Text and JSON of a question say the same."""
    said = data["answer"]
    parts = _parts(text)
    codes = [statement["code"] for statement in said["statements"]]
    assert said["verdict"]["code"] in codes or said["question"] == "compare"
    assert len(parts["Answer"]) == len(codes)
    for line, statement in zip(
        parts["Answer"],
        sorted(said["statements"], key=lambda s: s["code"] != said["verdict"]["code"]),
        strict=True,
    ):
        assert all(words in line for words in fixed_words(statement["code"]))
        for x in _scalars(statement["values"]):
            assert _is_stated(x, line), (x, line)
    doubts = [n for n in said["doubts"] if n["code"] not in DOUBTS]
    assert [f"  [{n['code']}] {n['message']}" for n in doubts] == parts.get("Doubts", [])
    assert [f"  [{n['code']}] {n['message']}" for n in said["notes"]] == parts.get("Notes", [])
    body = text.splitlines()
    for table in said["tables"]:
        for row in table["rows"]:
            own = [x for cell in row for x in _scalars(cell)]
            assert any(all(_is_stated(x, line) for x in own) for line in body), row


@pytest.fixture(params=["world", "body"])
def axes(request):
    return request.param


@pytest.mark.parametrize("question", ["modes", "map", "curve", "compensation", "plan", "design",
                                      "compare"])  # fmt: skip
@pytest.mark.parametrize("seed", SEEDS)
def test_text_and_json_of_an_arm(seed, question, axes, tmp_path):
    one = SetUp(Arm.generated(seed), tmp_path, axes, None)
    words = _questions(one)[question]
    data = answer(*_apart(words))
    check(run(*_apart(words)), data)
    own = _NUMBERS_OF[question](data)
    shown = [x for part in ("statements", "tables") for x in _scalars(data["answer"][part])]
    for x in (x for x in own if x is not None):
        assert any(x == pytest.approx(y, rel=1e-12) for y in shown)


def _apart(words: list[str]) -> list[Any]:
    """Words of options, and those that go together."""
    return [words[0], *([word] if "/" in word and " " not in word else word for word in words[1:])]


#: What the object for programs says beside its answer, of what the answer is about.
_NUMBERS_OF = {
    "modes": lambda data: data["frequencies"],
    "map": lambda data: [
        q[e] for q in data["quantities"].values() for e in ("smallest", "largest")
    ],
    "curve": lambda data: [point["factor"] for point in data["critical"]],
    "compensation": lambda data: [],
    "plan": lambda data: [p["stiffness"] for p in data["parameters"]],
    "design": lambda data: [data["designs"][i]["values"]["soft"] for i in data["front"]],
    "compare": lambda data: [n["ratio"] for n in data["numbers"] if n["ratio"] is not None],
}


@pytest.mark.parametrize("seed", [1, *later(2, 3)])
@pytest.mark.parametrize("question", ["assemble --all", "workspace --directions 20 --scan 8"])
def test_text_and_json_of_a_platform(seed, question):
    rng = np.random.default_rng(seed)
    sz, height = rng.uniform(0.5, 0.7), rng.uniform(-0.02, 0.02)
    name, *options = question.split(" ", 1)
    words = [name, "hexapod", f"--pose 0,0,{0.72 + height!r},0,0.05,0", *options]
    if name == "assemble":
        words[1:3] = ["inclined-hexapod", f"--set sz={sz!r} --pose 0,0,{height!r},0,0.05,0"]
        words.append("--load 0,0,0,10,0,-50")
    data = answer(" ".join(words))
    check(run(" ".join(words)), data)
    shown = [x for part in ("statements", "tables") for x in _scalars(data["answer"][part])]
    own = [data.get("volume"), *(mode["smallest_eigenvalue"] for mode in data.get("modes", []))]
    for x in (x for x in own if x is not None):
        assert any(x == pytest.approx(y, rel=1e-12) for y in shown)


@pytest.mark.parametrize("seed", SEEDS)
def test_text_and_json_of_an_identification(seed, tmp_path):
    one = SetUp(Arm.generated(seed), tmp_path, "world", None)
    table = tmp_path / "measured.csv"
    table.write_text(_measured(one))
    words = ["identify", [str(one.file()), str(table)]]
    words.append("--axes world " + " ".join(f"--sd d{c}=0.02mm" for c in "xyz"))
    data = answer(*words)
    check(run(*words), data)
    shown = [x for part in ("statements", "tables") for x in _scalars(data["answer"][part])]
    for entry in data["parameters"]:
        if entry["stiffness"] is not None:
            assert any(entry["stiffness"] == pytest.approx(y, rel=1e-12) for y in shown)


def test_a_path_says_the_same_in_text_and_json(tmp_path):
    rows = ["x,y,z,roll,pitch,yaw", "0.62,-0.1,0.3,0,0,0", "0.62,-0.03,0.31,0,0,0.1"]
    table = tmp_path / "edge.csv"
    table.write_text("\n".join(rows))
    words = ["path ur5", table, "--free-axis x --samples 6 --load 0,0,0,-80,30,40 --loaded"]
    data = answer(*words)
    check(run(*words), data)
    assert json.dumps(data["answer"]["tables"])
