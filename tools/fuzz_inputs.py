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
from tools.fuzz_commands import matrix, measured, option, table, xacro
from tools.fuzz_common import (
    ODD_NUMBERS,
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
from tools.fuzz_numbers import frequencies, postures, rest
from tools.fuzz_platforms import platform
from tools.fuzz_robots import mjcf, urdf

# -- mechanism files, tables, options ---------------------------------------------------------


@cache
def bundled() -> dict[str, tuple[str, Any]]:
    """Text and data of every bundled mechanism's file, by name."""
    from ruamel.yaml import YAML

    files = sorted((ROOT / "robots").glob("*.yaml"))
    texts = {path.stem: path.read_text(encoding="utf-8") for path in files}
    return {name: (text, YAML(typ="safe", pure=True).load(text)) for name, text in texts.items()}


def copy_models() -> None:
    """What bundled mechanisms are made of, beside them."""
    for model in (ROOT / "robots").glob("*.urdf"):
        Path(model.name).write_bytes(model.read_bytes())


_ASKED = [
    ["analyse"],
    ["analyse", "--load", "0,0,0,0,0,-20"],
    ["modes"],
    ["frames"],
    ["equilibrium", "--load", "0,0,0,0,0,-20", "--world"],
    ["equilibrium"],
    ["map", "--random", "3"],
    ["analyse", "--tolerance", "0.05"],
]


def mechanism_file(rng: random.Random) -> str:
    """A bundled mechanism's file, damaged as data or as text."""
    name = rng.choice(sorted(bundled()))
    text, data = bundled()[name]
    chance = rng.random()
    if chance < 0.55:
        content = json.dumps(nudged_data(rng, data)).encode()
    elif chance < 0.85:
        content = json.dumps(mutated_data(rng, data)).encode("utf-8", "replace")
    else:
        content = mutated_bytes(rng, text.encode())
    copy_models()
    Path("m.yaml").write_bytes(content)
    words = rng.choices(_ASKED, [8] + [1] * (len(_ASKED) - 1))[0]
    return outcome(command([words[0], "m.yaml", *words[1:], "--json"])[0])


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
    from cartstiff import CartstiffError, DeadForce
    from cartstiff.geometry import KINEMATIC

    elastic = _loaded(rng.choice(["cubic", "ur5", "five-bar", "stewart-gough", "grasp"]))
    n = len(elastic.names)
    calls: list[Callable[[], Any]] = [
        lambda: cartstiff.analyse(elastic, _array(rng, n)).to_dict(),
        lambda: cartstiff.analyse(elastic, wrench=_array(rng, 6)).to_dict(),
        lambda: cartstiff.analyse(elastic, _array(rng, n), wrench=_array(rng, 6)).to_dict(),
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
    from cartstiff.shown.page.session import Session
    from cartstiff.shown.page.source import Source

    return Session(Source(_loaded(name)))


def message(rng: random.Random) -> str:
    """A message to the page's session, whole or damaged."""
    from cartstiff import CartstiffError
    from cartstiff.shown.page.messages import Export, Series, Sweep, read_message

    session = _session(rng.choice(["cubic", "ur5", "five-bar"]))
    n = len(session.elastic.names)
    state: dict[str, Any] = {"q": [rng.uniform(-0.5, 0.5) for _ in range(n)]}
    if rng.random() < 0.5:
        state |= {"load": [rng.uniform(-9, 9) for _ in range(6)], "point": [0.0, 0.1, 0.2]}
    state["connection"] = rng.choice("ABKF+")
    state["quantity"] = rng.choice(["stiffness", "compliance"])
    for key in rng.sample(["deflection", "centres", "labels"], 2):
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
    "option": option,
    "call": call,
    "message": message,
    "map": map_file,
    "table": table,
    "measured": measured,
    "matrix": matrix,
    "xacro": xacro,
    "postures": postures,
    "frequencies": frequencies,
    "rest": rest,
    "platform": platform,
}


def _large(_: random.Random) -> str:
    np.ones(5 * 2**25)  # 1.25 GiB
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
