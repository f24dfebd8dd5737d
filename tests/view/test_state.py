"""Messages from a page: what is taken, and that everything else is refused in one line."""

from __future__ import annotations

import contextlib
import json
import re
from pathlib import Path
from typing import get_args

import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.inner import LARGEST_MESSAGE, Draw, Message, ViewState, read_message
from tools import page_messages

import cartstiff
from cartstiff import InputError


def test_a_message_is_read():
    text = (
        '{"id": 3, "do": "draw", "state": {"q": [0, 1.5], "connection": "+", "point": [0, 0, 1]}}'
    )
    message = read_message(text)
    assert isinstance(message, Draw)
    assert message.id == 3
    assert message.state.q == [0.0, 1.5]
    assert message.state.connection == "+"
    assert message.state.point == (0.0, 0.0, 1.0)


def test_what_the_page_sends_back_is_what_it_got():
    state = ViewState(q=[1.0, 2.0], load=(1, 2, 3, 4, 5, 6), ghost=[0.0, 0.0], theme="dark")
    assert ViewState.model_validate_json(json.dumps(state.model_dump())) == state


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
        read_message(text)
    assert words in str(refused.value)
    assert "\n" not in str(refused.value)
    assert len(str(refused.value)) <= 600


def test_long_messages_are_refused():
    long = json.dumps({"id": 1, "do": "draw", "state": {"q": [0.123456789] * 6000}})
    assert len(long) > LARGEST_MESSAGE
    with pytest.raises(InputError, match=f"too long; expected at most {LARGEST_MESSAGE}"):
        read_message(long)
    with pytest.raises(InputError, match="at most 500"):
        read_message(json.dumps({"id": 1, "do": "draw", "state": {"q": [0.5] * 501}}))


_JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=20),
    lambda inner: st.lists(inner, max_size=5) | st.dictionaries(st.text(max_size=12), inner),
    max_leaves=12,
)


@given(_JSON)
def test_any_json_is_a_message_or_refused(data):
    with contextlib.suppress(InputError):
        read_message(json.dumps(data))


@given(st.binary(max_size=300))
def test_any_bytes_are_refused(data):
    with pytest.raises(InputError):
        read_message(data)


def test_the_types_of_messages_are_those_of_the_models():
    """Written anew by ``python tools/page_messages.py``."""
    assert page_messages.TARGET.read_text(encoding="utf-8") == page_messages.typescript()


SCRIPTS = Path(cartstiff.__file__).parent / "page/static"
# A question as the scripts write it: its "do" first, then fields, each by name or with a value.
_QUESTION = re.compile(r'\{ do: "(\w+)"((?:, [^{}]*(?:\{[^{}]*\}[^{}]*)*)?) \}')
_FIELD = re.compile(r",\s*(\w+)\b(?=\s*[:,]|\s*$)")


def test_every_question_of_the_scripts_has_fields_that_the_server_reads():
    known = {
        get_args(kind.model_fields["do"].annotation)[0]: kind.model_fields
        for kind in get_args(Message)
    }
    found = dict.fromkeys(known, 0)
    for path in sorted(SCRIPTS.glob("*.js")):
        for do, rest in _QUESTION.findall(path.read_text(encoding="utf-8")):
            fields = _FIELD.findall(re.sub(r"\{[^{}]*\}|\([^()]*\)|\.\.\.", "", rest))
            assert set(fields) <= set(known[do]), f"{path.name}: {do} {fields}"
            found[do] += 1
    assert min(found.values()) > 0, found
