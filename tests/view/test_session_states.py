"""The page's session over any order of messages: each answer is that of its state alone."""

from __future__ import annotations

import json
from functools import cache
from typing import Any

import pytest
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule
from tests.support.pages import message_of, source_of, tab_of
from tests.view.conftest import NoPicture

import cartstiff
from cartstiff import CartstiffError, InputError

_NUMBERS = st.floats(-2.0, 2.0)


@cache
def _elastic(name: str) -> Any:
    return cartstiff.load(name)


class Tabs(RuleBasedStateMachine):
    """Two tabs of one page; what one does never shows in the other, nor what was refused."""

    @initialize(name=st.sampled_from(["cubic", "ur5"]))
    def begin(self, name: str) -> None:
        self.name = name
        self.source = source_of(_elastic(name))
        self.tabs = [tab_of(self.source, NoPicture) for _ in range(2)]
        self.frames = [_elastic(name).mechanism.frame] * 2
        self.state: dict[str, Any] = {}

    def _asked(self, tab: int, **words: Any) -> Any:
        message = message_of(json.dumps({"id": 7, "state": self.state, **words}))
        answer = self.tabs[tab].answer(message)
        answer.pack()
        assert answer.data["id"] == 7
        return answer.data

    @rule(
        q=st.lists(_NUMBERS, min_size=6, max_size=6),
        connection=st.sampled_from("ABKF+"),
        quantity=st.sampled_from(["stiffness", "compliance"]),
        load=st.none() | st.lists(_NUMBERS, min_size=6, max_size=6),
    )
    def wish(
        self, q: list[float], connection: str, quantity: str, load: list[float] | None
    ) -> None:
        self.state = {
            "q": [0.1 * x if self.name == "cubic" else x for x in q],
            "connection": connection,
            "quantity": quantity,
            "load": load,
        }

    @rule(tab=st.integers(0, 1), do=st.sampled_from(["draw", "numbers"]))
    def numbers(self, tab: int, do: str) -> None:
        """The same as a tab that has just been opened gives, to the last digit."""
        fresh = tab_of(self.source, NoPicture)
        frame = self.frames[tab]
        if frame != fresh.elastic.mechanism.frame:
            fresh.answer(message_of(json.dumps({"id": 1, "do": "frame", "name": frame})))
        expected: Any
        try:
            text = json.dumps({"id": 7, "do": "numbers", "state": self.state})
            expected = fresh.answer(message_of(text)).data["numbers"]
        except CartstiffError as error:
            with pytest.raises(type(error)):
                self._asked(tab, do=do)
            return
        assert json.dumps(self._asked(tab, do=do)["numbers"]) == json.dumps(expected)

    @rule(tab=st.integers(0, 1), stiffness=st.none() | st.floats(1e2, 1e5))
    def springs(self, tab: int, stiffness: float | None) -> None:
        if stiffness is None:
            self.state.pop("stiffness", None)
        else:
            self.state = {**self.state, "stiffness": [stiffness] * 6}

    @rule(tab=st.integers(0, 1), which=st.integers(0, 3))
    def other_frame(self, tab: int, which: int) -> None:
        known = self.tabs[tab].hello().data["mechanism"]["frames"]
        if known:
            name = known[which % len(known)]
            try:
                self._asked(tab, do="frame", name=name)
            except CartstiffError:
                return
            self.frames[tab] = name

    @rule(tab=st.integers(0, 1))
    def nonsense(self, tab: int) -> None:
        for words in ({"q": [1.0]}, {"q": [1e29] * 6, "stiffness": [1.0]}, {"moved": 77}):
            message = json.dumps({"id": 7, "do": "draw", "state": {**self.state, **words}})
            read = message_of(message)
            with pytest.raises(InputError):
                self.tabs[tab].answer(read)

    @invariant()
    def frames_are_those_chosen(self) -> None:
        for session, frame in zip(
            getattr(self, "tabs", []), getattr(self, "frames", []), strict=True
        ):
            assert session.elastic.mechanism.frame == frame


Tabs.TestCase.settings = settings(
    max_examples=25,
    stateful_step_count=12,
    deadline=None,
    suppress_health_check=list(HealthCheck),
)
TestTabs = Tabs.TestCase
