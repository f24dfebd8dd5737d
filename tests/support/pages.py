"""The page as tests drive it: live and exported, a tab of it, its state and its messages."""

from __future__ import annotations

import json
from typing import Any

from cartstiff import ElasticMechanism
from tests.inner import (
    COLOURS,
    Background,
    Cloud,
    Playback,
    Session,
    Source,
    ViewState,
    cloud_of_workspace,
    export_page,
    moved_part,
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


def served(source: Any, **options: Any) -> Any:
    """A page that is served by a thread of this process."""
    return Background(source, **options)


def page_text(source: Any, **options: Any) -> str:
    """A page as the text of one file."""
    return str(export_page(source, **options))


def tab_of(source: Any, *picture: Any) -> Any:
    """A tab of a page, without a browser."""
    return Session(source, *picture)


def state_of(**words: Any) -> Any:
    """The state of a tab."""
    return ViewState(**words)


def message_of(text: str) -> Any:
    """A message to the page, as it is read."""
    return read_message(text)


def page_answer(source: Any, do: str, state: dict[str, Any]) -> Any:
    """What a new tab answers in a state, as it is sent."""
    message = message_of(json.dumps({"id": 1, "do": do, "state": state}))
    return json.loads(json.dumps(tab_of(source).answer(message).data, allow_nan=False))
