"""Inputs for `tools/fuzz.py`, by kind: made from a random source alone, tried, and judged."""

from __future__ import annotations

import json
import os
import random
import time
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from tools.fuzz_common import (
    ODD_NUMBERS,
    ODD_TEXTS,
    ROOT,
    FaultError,
    command,
    mutated_bytes,
    mutated_data,
    nudged_data,
    odd,
    outcome,
)
from tools.fuzz_maps import map_file
from tools.fuzz_robots import mjcf, urdf

# -- mechanism files, tables, options ---------------------------------------------------------


@cache
def _bundled() -> dict[str, tuple[str, Any]]:
    from ruamel.yaml import YAML

    files = sorted((ROOT / "robots").glob("*.yaml"))
    texts = {path.stem: path.read_text(encoding="utf-8") for path in files}
    return {name: (text, YAML(typ="safe", pure=True).load(text)) for name, text in texts.items()}


def mechanism_file(rng: random.Random) -> str:
    """A bundled mechanism's file, damaged as data or as text."""
    name = rng.choice(sorted(_bundled()))
    text, data = _bundled()[name]
    chance = rng.random()
    if chance < 0.55:
        content = json.dumps(nudged_data(rng, data)).encode()
    elif chance < 0.85:
        content = json.dumps(mutated_data(rng, data)).encode("utf-8", "replace")
    else:
        content = mutated_bytes(rng, text.encode())
    for model in (ROOT / "robots").glob("*.urdf"):
        Path(model.name).write_bytes(model.read_bytes())
    Path("m.yaml").write_bytes(content)
    return outcome(command(["analyse", "m.yaml", "--json"])[0])


_TABLES = [
    "q1,q2\n0,1\n",
    "x,y,z\n0,0,0\n0.1,0,0\n",
    "time,x,y,z,roll,pitch,yaw\n0,0,0,0,0,0,0\n",
    "1,2,3,4,5,6\n1,2,3,4,5,7\n",
    "# only words\n",
    "mass,dx\n1,2\n",
]


def table(rng: random.Random) -> str:
    """A CSV file where postures, points or loads are read."""
    data = rng.choice(_TABLES).encode()
    for _ in range(rng.randint(0, 3)):
        data = mutated_bytes(rng, data)
    Path("t.csv").write_bytes(data)
    words = rng.choice(
        [
            ["map", "cubic", "--trajectory", "t.csv", "--json"],
            ["path", "ur5", "t.csv", "--json"],
            ["equilibrium", "cubic", "--path", "t.csv", "--json"],
            ["export", "cubic", "--trajectory", "t.csv", "-o", "p.html", "--frames", "2"],
        ]
    )
    return outcome(command(words)[0])


_QUICK = ["cubic", "stewart-gough", "five-bar", "ur5", "grasp", "cable-robot", "nothing", ""]
_NEVER = {"view", "gui"}


def option(rng: random.Random) -> str:
    """A command with some of its options, and values that fit or do not."""
    import click

    from cartstiff.cli.main import command as group

    context = click.Context(group)
    names = [name for name in group.list_commands(context) if name not in _NEVER]
    name = rng.choice(names)
    chosen = group.get_command(context, name)
    assert chosen is not None
    words = [name]
    for parameter in chosen.params:
        if isinstance(parameter, click.Argument):
            words.append(rng.choice(_QUICK) if rng.random() < 0.9 else _value(rng, parameter))
    options = [
        p
        for p in chosen.params
        if isinstance(p, click.Option) and p.name not in ("workers", "scheduler", "cluster")
    ]
    for parameter in rng.sample(options, min(len(options), rng.randint(0, 3))):
        words.append(max(parameter.opts, key=len))
        if not (parameter.is_flag or parameter.count):
            words += [_value(rng, parameter) for _ in range(max(parameter.nargs, 1))]
    return outcome(command(words)[0])


def _value(rng: random.Random, parameter: Any) -> str:
    """A text for a parameter: of its kind, near it, or of none."""
    kind = type(parameter.type).__name__
    chance = rng.random()
    if kind == "Choice" and chance < 0.8:
        return str(rng.choice(list(parameter.type.choices)))
    if kind in ("IntRange", "IntParamType") and chance < 0.8:
        return str(rng.choice([0, 1, 2, 3, 7, -1, 10**6, 10**20]))
    if chance < 0.6:
        numbers = [
            str(rng.choice([0, 1, -1, 0.1, 1e-3, 100, rng.choice(ODD_NUMBERS)]))
            for _ in range(rng.choice([1, 1, 2, 3, 6, 6, 7]))
        ]
        return ",".join(numbers)
    if chance < 0.75:
        return rng.choice(
            [
                "z=0:0.1:3",
                "x=-1:1:2,y=0:1:2",
                "elbow_joint=1",
                "tool0",
                "K",
                "A",
                "B",
                "stiffness",
                "z=0:0:1",
                "z=1:0:3",
                "x=0:1:1000000000",
            ]
        )
    return rng.choice(ODD_TEXTS).replace("\ud800", "\udcff") or "x"  # bytes that are no text


# -- Python, page -----------------------------------------------------------------------------


def _array(rng: random.Random, n: int) -> Any:
    kind = rng.random()
    if kind < 0.65:
        return [rng.uniform(-1, 1) for _ in range(n)]
    if kind < 0.8:
        return np.full(
            rng.choice([(n,), (n, n), (1, n), (0,), (n + 1,), ()]),
            rng.choice([x for x in ODD_NUMBERS if abs(x) < 1e308 or x != x]),
        )
    if kind < 0.85:
        return np.array([rng.uniform(-1, 1)] * n, rng.choice([complex, np.float32, object, "U8"]))
    return odd(rng)


@cache
def _loaded(name: str) -> Any:
    import cartstiff

    return cartstiff.load(name)


def call(rng: random.Random) -> str:
    """A call from Python: a result, or an error of the library's own."""
    import cartstiff
    from cartstiff.errors import CartstiffError
    from cartstiff.geometry.connections import KINEMATIC
    from cartstiff.potentials.loads import DeadForce

    elastic = _loaded(rng.choice(["cubic", "ur5", "five-bar", "stewart-gough", "grasp"]))
    n = len(elastic.names)
    calls: list[Callable[[], Any]] = [
        lambda: cartstiff.analyse(elastic, _array(rng, n)).as_dict(),
        lambda: cartstiff.analyse(elastic, wrench=_array(rng, 6)).as_dict(),
        lambda: cartstiff.analyse(elastic, _array(rng, n), wrench=_array(rng, 6)).as_dict(),
        lambda: cartstiff.analyse_many(elastic, _array(rng, n)),
        lambda: cartstiff.analyse_many(elastic, [_array(rng, n)], wrench=_array(rng, 6)),
        lambda: elastic.with_springs(_array(rng, n)),
        lambda: cartstiff.equilibrium(elastic, DeadForce(_array(rng, 3))),
        lambda: cartstiff.equilibrium(elastic, DeadForce([0.0, 0.0, -1.0], _array(rng, 3))),
        lambda: cartstiff.StiffnessTensor(_array(rng, 36), KINEMATIC, _array(rng, 6)),
        lambda: cartstiff.StiffnessTensor(np.eye(6), KINEMATIC, _array(rng, 6), _array(rng, 4)),
        lambda: cartstiff.load(odd(rng)),
        lambda: cartstiff.load("cubic", frame=odd(rng)),
        lambda: elastic.mechanism.at(elastic.mechanism.checked(_array(rng, n))).pose,
    ]
    chosen = rng.randrange(len(calls))
    try:
        with np.errstate(all="ignore"):
            calls[chosen]()
    except CartstiffError as error:
        if "\n" in str(error):
            raise FaultError(f"call {chosen}: several lines: {str(error)[:200]!r}") from None
        return "refused"
    except Exception as error:
        raise FaultError(f"call {chosen}: {type(error).__name__}: {str(error)[:200]}") from error
    return "answered"


@cache
def _session(name: str) -> Any:
    from cartstiff.page.session import Session
    from cartstiff.page.source import Source

    return Session(Source(_loaded(name)))


def message(rng: random.Random) -> str:
    """A message to the page's session, whole or damaged."""
    from cartstiff.errors import CartstiffError
    from cartstiff.page.state import Export, Series, Sweep, read_message

    session = _session(rng.choice(["cubic", "ur5", "five-bar"]))
    n = len(session.elastic.names)
    state: dict[str, Any] = {"q": [rng.uniform(-0.5, 0.5) for _ in range(n)]}
    if rng.random() < 0.5:
        state |= {"load": [rng.uniform(-9, 9) for _ in range(6)], "point": [0.0, 0.1, 0.2]}
    state["connection"] = rng.choice("ABKF+")
    state["quantity"] = rng.choice(["stiffness", "compliance"])
    for key in rng.sample(["deflection", "screws", "centres", "labels"], 2):
        state[key] = rng.random() < 0.5
    asked: dict[str, Any] = {
        "id": 1,
        "state": state,
        "do": rng.choice(
            ["draw", "numbers", "result", "analysis", "sweep", "camera", "frame", "series"]
        ),
    }
    asked |= {
        "sweep": {"coordinate": rng.randrange(n + 1), "steps": 3},
        "camera": {"preset": "top"},
        "frame": {"name": "tool0"},
    }.get(asked["do"], {})
    text = json.dumps(mutated_data(rng, asked) if rng.random() < 0.6 else asked)
    if rng.random() < 0.1:
        text = mutated_bytes(rng, text.encode()).decode("utf-8", "replace")
    try:
        read = read_message(text)
        if isinstance(read, Export):
            return "answered"
        if isinstance(read, (Sweep, Series)):
            for _ in (steps := session.work(read)):
                pass
            del steps
        else:
            session.answer(read).pack()
    except CartstiffError:
        return "refused"
    except Exception as error:
        raise FaultError(f"{text[:300]}: {type(error).__name__}: {str(error)[:200]}") from error
    return "answered"


FAMILIES: dict[str, Callable[[random.Random], str]] = {
    "urdf": urdf,
    "mjcf": mjcf,
    "mechanism": mechanism_file,
    "table": table,
    "option": option,
    "call": call,
    "message": message,
    "map": map_file,
}


def _large(_: random.Random) -> str:
    np.ones(3 * 2**27)
    return "answered"


def _endless(_: random.Random) -> str:
    while True:
        time.sleep(1)


def _busy(_: random.Random) -> str:
    begun = time.process_time()
    while time.process_time() < begun + 1.2:
        pass
    return "answered"


def _wrong(_: random.Random) -> str:
    raise FaultError("planted")


#: Faults on purpose, run only by name: what the watch must see.
PLANTED: dict[str, Callable[[random.Random], str]] = {
    "abort": lambda _: os.abort(),
    "busy": _busy,
    "endless": _endless,
    "large": _large,
    "wrong": _wrong,
}
