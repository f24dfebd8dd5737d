"""Every number that the page says is what the command says: states, frames, set-ups at random.

The command is asked in its own words, and the page by the state of a tab. A file that computes is
held to the tab by tests/view/test_browser_program.py.
"""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest
from tests.inner import Session, Source, ViewState
from tests.support.commands import answer

import cartstiff

#: Frames besides that of the file.
FRAMES = {"ur5": ("wrist_3_link", "ee_link"), "panda": ("panda_link7",)}
NAMES = ("ur5", "panda", "hexapod", "cubic", "five-bar", "delta", "cable-robot", "stewart-gough")
CASES = 2
#: Of numbers that were added up in another order.
SAME = 1e-9


def drawn(name: str, seed: int) -> tuple[list[str], cartstiff.ElasticMechanism, dict[str, Any]]:
    """Words of a command, the mechanism that it names, and the state of a page that asks it."""
    rng = np.random.default_rng([seed, *map(ord, name)])
    base = cartstiff.load(name)
    words, elastic = [name], base
    if name in FRAMES and rng.random() < 0.7:
        frame = str(rng.choice(FRAMES[name]))
        words += ["--frame", frame]
        elastic = base.with_frame(frame)
    size = elastic.mechanism.at(elastic.q).length
    free = list(elastic.mechanism.actuated or range(len(elastic.q)))
    steps = [0.02 * (size if elastic.mechanism.coordinates[j].is_length else 1.0) for j in free]
    q = elastic.q.copy()
    q[free] += rng.uniform(-1, 1, len(free)) * steps
    state: dict[str, Any] = {"q": elastic.mechanism.closed(q).q.tolist()}
    words += ["--q", _list(state["q"])]
    if rng.random() < 0.8:
        force = {"delta": 0.1, "cable-robot": 5.0}.get(name, 50.0)
        state["load"] = tuple(
            (force * rng.normal(size=6) * np.repeat([0.1 * size, 1.0], 3)).tolist()
        )
        state["load_axes"] = str(rng.choice(["body", "world"]))
        state["load_kind"] = str(rng.choice(["dead", "follower", "conservative"]))
        state["load_at"] = tuple((0.1 * size * rng.normal(size=3)).tolist())
        words += ["--load", _list(state["load"]), "--load-at", _list(state["load_at"])]
        words += ["--load-kind", state["load_kind"]]
        words += ["--world"] * (state["load_axes"] == "world")
    if rng.random() < 0.6:
        state["point"] = tuple((0.2 * size * rng.normal(size=3)).tolist())
        words += ["--report-at", _list(state["point"])]
    stiffness = elastic.springs.stiffness
    if rng.random() < 0.4 and np.isfinite(stiffness).all() and (stiffness > 0.0).all():
        state["stiffness"] = (stiffness * rng.uniform(0.5, 2.0, len(stiffness))).tolist()
        words += ["--stiffness", _list(state["stiffness"])]
    if rng.random() < 0.3:
        state["gravity"] = (0.0, 0.0, -9.81)
        words += ["--gravity", "0,0,-9.81"]
    return words, elastic, state


def _list(values: Any) -> str:
    return ",".join(map(repr, np.asarray(values, float).tolist()))


def same(found: Any, expected: Any, what: str) -> None:
    """Numbers alike beside the largest of them, and words alike."""
    if isinstance(expected, (list, tuple)) and len(np.ravel(np.array(expected, object))):
        a, b = (np.array(one, float) for one in (found, expected))
        assert a.shape == b.shape, what
        assert np.abs(a - b).max() <= SAME * max(np.abs(b).max(), 1e-300), (what, a, b)
    elif isinstance(expected, float):
        assert found == pytest.approx(expected, rel=SAME), what
    else:
        assert found == expected, what


@pytest.mark.parametrize("seed", range(CASES))
@pytest.mark.parametrize("name", NAMES)
def test_numbers_of_the_page_are_those_of_the_command(name, seed):
    words, elastic, state = drawn(name, seed)
    told = answer("analyse", *words)
    session = Session(Source(elastic))
    for quantity in ("stiffness", "compliance"):
        for others in ("free", "held"):
            wish = ViewState(**state, quantity=quantity, others=others)
            result = session.result(wish)
            with np.errstate(all="ignore"):
                numbers = json.loads(json.dumps(session.numbers(result, wish)))
            ellipsoids = (told["analysis"] or {}).get("ellipsoids", {}).get(quantity, {})
            for freedom, shape in (numbers["principal"] or {}).items():
                expected = ellipsoids[freedom][others]
                same(shape["values"], expected["eigenvalues"], f"{quantity} {freedom} {others}")
                assert shape["definiteness"] == expected["definiteness"]
    whole = json.loads(json.dumps(result.to_dict()))
    for key in ("q", "pose", "wrench", "energy", "forces", "stiffness", "compliance", "load"):
        for part in told[key] if isinstance(told[key], dict) else [None]:
            one, other = (x if part is None else x[part] for x in (whole[key], told[key]))
            _each(one, other, f"{key} {part or ''}")
    if numbers["indices"] is not None:
        for key in ("condition_number", "translational_condition", "rotational_condition"):
            same(numbers["indices"][key], told["analysis"]["indices"][key], key)
    said, moved = told["answer"], numbers["moved"]
    if said["displacement"] is not None and moved is not None and moved["resisted"]:
        first = said["displacement"]["first_order"]
        same(moved["in_room"], first["translation"], "displacement")
        size = np.hypot.reduce(first["rotation"])
        assert np.hypot.reduce(moved["rotation"]) == pytest.approx(size, rel=SAME, abs=1e-15)
        shares = {one["name"]: one["share"] for one in said["shares"]["parts"]}
        for one in moved["shares"]["parts"]:
            assert one["share"] == pytest.approx(shares[one["name"]], abs=SAME)
        assert moved["shares"]["rest"] == pytest.approx(said["shares"]["rest"], abs=SAME)


def _each(found: Any, expected: Any, what: str) -> None:
    """The same, of tables row by row."""
    rows = isinstance(expected, list) and expected and isinstance(expected[0], dict)
    if not rows:
        return same(found, expected, what)
    for one, other in zip(found, expected, strict=True):
        assert one.keys() == other.keys()
        for key, value in other.items():
            same(one[key], value, f"{what} {key}")
    return None
