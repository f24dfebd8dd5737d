"""The page as tests drive it: live and exported, a tab of it, its state and its messages."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from cartstiff import ElasticMechanism
from tests.inner import (
    COLOURS,
    Background,
    Cloud,
    Playback,
    Session,
    Setup,
    Shown,
    Source,
    Values,
    ViewState,
    cloud_of_workspace,
    export_page,
    moved_part,
    page_script,
    read_cloud,
    read_message,
    read_trajectory,
    series_row,
    shown_numbers,
)

#: The page's colours by what they mean.
colour = COLOURS.__getitem__

#: Postures that the page plays, points of a map, and what reads them from files.
playback_of, cloud_of, clouds_in, postures_in = Playback, Cloud, read_cloud, read_trajectory
points_of_workspace = cloud_of_workspace
#: What the page shows of a result in a state: all numbers, a row of a plot, what moves.
numbers_shown, row_shown, motion_shown = shown_numbers, series_row, moved_part


def source_of(elastic: ElasticMechanism, *more: Any, **options: Any) -> Any:
    """What a page shows."""
    return Source(elastic, *more, **options)


def stated(mechanism: str, shown: dict[str, Any] | None = None, **setup: Any) -> Any:
    """What a page shows that a command names: a mechanism with its options, and what beside it."""
    if "stiffness" in setup:
        setup["stiffness"] = Values("--stiffness", setup["stiffness"])
    return Shown(**(shown or {})).source(Setup(mechanism, **setup))


def served(source: Any, **options: Any) -> Any:
    """A page that is served by a thread of this process."""
    return Background(source, **options)


def page_text(source: Any, **options: Any) -> str:
    """A page as the text of one file."""
    return str(export_page(source, **options))


def tab_of(source: Any, *picture: Any) -> Any:
    """A tab of a page, without a browser."""
    return Session(source, *picture)


@contextmanager
def short_curves(is_short: Callable[[Any], bool], steps: int = 7) -> Iterator[None]:
    """Curves over the whole range, of sources of which that holds, have few postures."""
    sweep = Session._sweep

    def swept(self: Any, message: Any) -> Any:
        if message.steps == 61 and is_short(self.source):
            message = message.model_copy(update={"steps": steps})
        return sweep(self, message)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Session, "_sweep", swept)
        yield


def state_of(**words: Any) -> Any:
    """The state of a tab."""
    return ViewState(**words)


def asking(do: str, state: Any = None, **more: Any) -> Any:
    """A question of the page about a state."""
    more |= {} if state is None else {"state": state.model_dump()}
    return read_message(json.dumps({"id": 1, "do": do, **more}))


def scripts(*first: str) -> str:
    """A script of the page with all that it imports, as one."""
    return str(page_script(*first))


def message_of(text: str) -> Any:
    """A message to the page, as it is read."""
    return read_message(text)


def page_answer(source: Any, do: str, state: dict[str, Any]) -> Any:
    """What a new tab answers in a state, as it is sent."""
    message = message_of(json.dumps({"id": 1, "do": do, "state": state}))
    return json.loads(json.dumps(tab_of(source).answer(message).data, allow_nan=False))
