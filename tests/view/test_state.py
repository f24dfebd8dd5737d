"""Messages from a page: what is taken, and that everything else is refused in one line.

And that the numbers of a state are those of the command, whatever state, frame and set-up.
"""

from __future__ import annotations

import contextlib
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.support.commands import answer
from tests.support.pages import message_of, source_of, state_of, tab_of
from tools import page_messages

import cartstiff
from cartstiff import InputError


def test_a_message_is_read():
    text = (
        '{"id": 3, "do": "draw", "state": {"q": [0, 1.5], "connection": "+", "point": [0, 0, 1]}}'
    )
    message = message_of(text)
    assert message.do == "draw"
    assert message.id == 3
    assert message.state.q == [0.0, 1.5]
    assert message.state.connection == "+"
    assert message.state.point == (0.0, 0.0, 1.0)


def test_what_the_page_sends_back_is_what_it_got():
    state = state_of(q=[1.0, 2.0], load=(1, 2, 3, 4, 5, 6), ghost=[0.0, 0.0], theme="dark")
    sent = {"id": 1, "do": "draw", "state": state.model_dump()}
    assert message_of(json.dumps(sent)).state == state


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "Invalid JSON"),
        ("{", "Invalid JSON"),
        ("[]", "object"),
        ("nan", "Invalid JSON"),
        ('{"id": 1}', "tag"),
        ('{"id": 1, "do": "rm -rf"}', "expected tags"),
        ('{"do": "draw"}', "id"),
        ('{"id": -1, "do": "draw"}', "id"),
        ('{"id": true, "do": "draw"}', "valid integer"),
        ('{"id": 1, "do": "draw", "path": "/etc/passwd"}', "not permitted"),
        ('{"id": 1, "do": "draw", "state": {"file": "x"}}', "state.file"),
        ('{"id": 1, "do": "draw", "state": {"q": [NaN]}}', "finite"),
        ('{"id": 1, "do": "draw", "state": {"q": [Infinity]}}', "finite"),
        ('{"id": 1, "do": "draw", "state": {"q": [1e400]}}', "finite"),
        ('{"id": 1, "do": "draw", "state": {"q": [1e300]}}', "less than or equal"),
        ('{"id": 1, "do": "draw", "state": {"q": ["1"]}}', "valid number"),
        ('{"id": 1, "do": "draw", "state": {"q": [true]}}', "valid number"),
        ('{"id": 1, "do": "draw", "state": {"q": []}}', "at least 1"),
        ('{"id": 1, "do": "draw", "state": {"q": 1}}', "valid array"),
        ('{"id": 1, "do": "draw", "state": {"point": [1, 2]}}', "point"),
        ('{"id": 1, "do": "draw", "state": {"load": [1, 2, 3]}}', "load"),
        ('{"id": 1, "do": "draw", "state": {"connection": "C"}}', "'A', 'B', 'K', 'F'"),
        ('{"id": 1, "do": "draw", "state": {"stiffness": [-1]}}', "greater than or equal"),
        ('{"id": 1, "do": "draw", "state": {"moved": 1e9}}', "moved"),
        ('{"id": 1, "do": "sweep", "coordinate": 0, "steps": 100000}', "steps"),
        ('{"id": 1, "do": "export", "frames": 100000}', "frames"),
        ('{"id": 1, "do": "frame", "name": ""}', "name"),
        ('{"id": 1, "do": "bounds", "preset": "inside"}', "preset"),
        ("[" * 30_000, "recursion"),
    ],
    ids=lambda text: text[-40:],
)
def test_refusals(text, words):
    with pytest.raises(InputError, match="message refused") as refused:
        message_of(text)
    assert words in str(refused.value)
    assert "\n" not in str(refused.value)
    assert len(str(refused.value)) <= 600


def test_long_messages_are_refused():
    long = json.dumps({"id": 1, "do": "draw", "state": {"q": [0.123456789] * 6000}})
    assert len(long) > 65536
    with pytest.raises(InputError, match="too long; expected at most 65536"):
        message_of(long)
    with pytest.raises(InputError, match="at most 500"):
        message_of(json.dumps({"id": 1, "do": "draw", "state": {"q": [0.5] * 501}}))


_JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=20),
    lambda inner: st.lists(inner, max_size=5) | st.dictionaries(st.text(max_size=12), inner),
    max_leaves=12,
)


@given(_JSON)
def test_any_json_is_a_message_or_refused(data):
    with contextlib.suppress(InputError):
        message_of(json.dumps(data))


@given(st.binary(max_size=300))
def test_any_bytes_are_refused(data):
    with pytest.raises(InputError):
        message_of(data)


def test_the_types_of_messages_are_those_of_the_models():
    """Written anew by ``python tools/page_messages.py``."""
    assert page_messages.TARGET.read_text(encoding="utf-8") == page_messages.typescript()


SCRIPTS = Path(cartstiff.__file__).parent / "shown/page/static"
# A question as the scripts write it: its "do" first, then fields, each by name or with a value.
_QUESTION = re.compile(r'\{ do: "(\w+)"((?:, [^{}]*(?:\{[^{}]*\}[^{}]*)*)?) \}')
_FIELD = re.compile(r",\s*(\w+)\b(?=\s*[:,]|\s*$)")


def test_every_question_of_the_scripts_has_fields_that_the_server_reads():
    kinds = re.findall(r'  do: "(\w+)";(.*?)\n\}', page_messages.typescript(), re.DOTALL)
    known = {do: ["id", "state", *re.findall(r"(\w+)\??:", rest)] for do, rest in kinds}
    found = dict.fromkeys(known, 0)
    for path in sorted(SCRIPTS.glob("*.js")):
        for do, rest in _QUESTION.findall(path.read_text(encoding="utf-8")):
            fields = _FIELD.findall(re.sub(r"\{[^{}]*\}|\([^()]*\)|\.\.\.", "", rest))
            assert set(fields) <= set(known[do]), f"{path.name}: {do} {fields}"
            found[do] += 1
    assert min(found.values()) > 0, found


# -- the numbers of a state ------------------------------------------------------------------

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
    session = tab_of(source_of(elastic))
    for quantity in ("stiffness", "compliance"):
        for others in ("free", "held"):
            wish = state_of(**state, quantity=quantity, others=others)
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
