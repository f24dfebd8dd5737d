"""The page as one file that opens anywhere without a network.

The file of an arm, a closed chain or a body on straight legs computes: it has their
formulas as JavaScript (`cartstiff.shown.page.browser_program`). The browser cannot
compute other mechanisms: their file has one posture, its numbers and its picture, and
says so. The same input makes the same file. A live page gets the same data, so that it
continues without its server.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from cartstiff.core.geometry.connections import BI_INVARIANT
from cartstiff.core.mechanisms.elastic import ElasticMechanism
from cartstiff.core.stiffness.compute import PostureStiffness
from cartstiff.shown.page.browser_program import BrowserProgram, browser_program
from cartstiff.shown.page.files import page_document
from cartstiff.shown.page.filters import filtered
from cartstiff.shown.page.messages import Answer, ViewState
from cartstiff.shown.page.picture import PageScene
from cartstiff.shown.page.session import PictureMaker, Session, said
from cartstiff.shown.page.shown import moved_part
from cartstiff.shown.page.source import Source
from cartstiff.version import __version__

#: Kind of a command, path, property.
Key = tuple[str, str, str]

_ORDER = {"delete": 0, "set_object": 1, "set_transform": 2, "set_property": 3}


def numbered(*states: Mapping[Key, bytes]) -> tuple[list[bytes], list[list[int]]]:
    """All commands, each once, and those of each state as their numbers.

    The numbers are in an order in which a viewer can take the commands.
    """
    numbers = dict[bytes, int]()
    lists = [
        [
            numbers.setdefault(state[key], len(numbers))
            for key in sorted(state, key=lambda key: _ORDER[key[0]])
        ]
        for state in states
    ]
    return list(numbers), lists


# Parts of the picture that JavaScript cannot draw.
_NOT_COMPUTED = ("centres", "held_forces")
# Parts of a state that are in the mechanism of a file.
_APPLIED = {"gravity": None, "payload": None, "command": None}


def export_page(
    source: Source,
    *,
    elastic: ElasticMechanism | None = None,
    state: ViewState | None = None,
    picture: PictureMaker = PageScene,
    address: str | None = None,
) -> str:
    """The page as HTML text.

    Parameters
    ----------
    source : Source
        The input of the page.
    elastic : ElasticMechanism, optional
        The mechanism with the frame of interest that a tab has chosen; default the
        source's.
    state : ViewState, optional
        The state in which the file opens.
    picture : callable
        Makes the picture of a mechanism.
    address : str, optional
        The end of a tab's address: camera, units, what is compared.

    Raises
    ------
    CartstiffError
        If the posture has no picture.
    """
    elastic = source.elastic if elastic is None else elastic
    with np.errstate(all="ignore"):
        session, shown = _session(source, elastic, state, picture)
        base = session.result(shown)
        shown = shown.model_copy(
            update={"moved": None, "q": session.before_load(base, shown).tolist()}
        )
        program = browser_program(session.elastic, base)
        data, commands = client_data(session, shown, base, program)
        data["hello"]["address"] = address
        analysis, at = (
            session.analysis(base, shown),
            ", ".join(f"{x:.6g}" for x in base.q),
        )
        analysis["title"] += f" in the posture of the file, q = {at}"
        data["analysis"] = analysis
        data["said"] = said(base, shown)
    script = "" if isinstance(program, str) else program.script
    commands, data["filters"] = filtered(commands)
    return page_document(
        Answer(data, commands).pack(), f"{elastic.name} · cartstiff", script
    )


def client_data(
    session: Session,
    shown: ViewState,
    base: PostureStiffness,
    program: BrowserProgram | str,
) -> tuple[dict[str, Any], list[bytes]]:
    """Return the data of a page without a server, and the picture's commands.

    With a `program` the page computes; with a reason instead it has the numbers of one
    posture.
    """
    hello = session.hello().data
    if isinstance(program, str):
        numbers = session.numbers(base, shown.model_copy(update={"mode": 1}))
        own = {"posture": {"numbers": numbers, "result": base.to_dict(), "why": program}}
    else:
        shown = shown.model_copy(
            update=dict.fromkeys(_NOT_COMPUTED, False) | {"mode": None}
        )
        # K^X - K^B of a wrench at M's origin, (36, 6), as those of the kinds of load.
        changes = {
            own.name: (BI_INVARIANT.symbols - own.symbols).reshape(36, 6).tolist()
            for own in session.source.connections
        }
        own = {"program": program.data | {"own": changes}}
    picture, commands = _picture_of(session, shown, base, is_whole="program" in own)
    facts = {"state": shown.model_dump(), "bounds": session.picture.bounds(base)}
    made = {
        "by": f"cartstiff {__version__}",
        "state": shown.model_dump(exclude_defaults=True),
    }
    return picture | own | {"hello": hello | facts, "made": made}, commands


def _session(
    source: Source,
    elastic: ElasticMechanism,
    state: ViewState | None,
    picture: PictureMaker,
) -> tuple[Session, ViewState]:
    """Return a session whose mechanism has commands, payload and gravity of a state;
    the state.
    """
    here = replace(source, elastic=elastic)
    session = Session(here, picture)
    first = state or session.start
    if first.command is not None and any(first.command):
        # The springs have their new rest positions.
        result = session.result(first)
        update = {
            "load": None,
            "stiffness": None,
            "load_at": first.acts_at,
            "q": result.q.tolist(),
        }
        here = replace(here, elastic=result.elastic, q=result.q, load=None, command=None)
    elif first.gravity is not None or first.payload is not None:
        update = {}
        heavy = session.changed(first.model_copy(update={"stiffness": None}))
        here = replace(here, elastic=heavy)
    else:
        return session, first
    return Session(here, picture), first.model_copy(update=_APPLIED | update)


def _picture_of(
    session: Session, shown: ViewState, base: PostureStiffness, *, is_whole: bool
) -> tuple[dict[str, Any], list[bytes]]:
    """One picture in both themes; a whole one has every part that another state needs."""
    picture, assets = session.picture, None
    states = dict[str, dict[Key, bytes]]()
    moved = moved_part(base, shown)
    other = {"dark": "light"}.get(shown.theme, "dark")
    for theme in (shown.theme, other):
        look = shown.model_copy(update={"theme": theme})
        if is_whole:  # the file copies the links of a ghost
            assets = picture.assets(base, look.model_copy(update={"ghost": None}))
        else:
            picture.draw(base, look, moved)
        states[theme] = picture.by_path()
    here, there = states.values()
    differing = {
        key
        for key, packed in there.items()
        if packed != here.get(key)
        and (key[0] == "set_object" or key[2] not in ("", "visible"))
    }
    changes = [
        {k: x for k, x in state.items() if k in differing} for state in states.values()
    ]
    commands, (start, *lists) = numbered(here, *changes)
    legend = session.with_colour_bar(picture.draw(base, shown, moved))
    units, playback = session.elastic.units, session.source.trajectory
    trajectory = None
    if playback is not None:
        trajectory = playback.q.tolist()
    return {
        "start": start,
        "themes": dict(zip(states, lists, strict=True)),
        "assets": assets,
        "legend": legend,
        "scene": {
            "units": {
                "length": units.length,
                "force": units.force,
                "moment": units.moment,
            },
            "notes": legend["notes"],
        },
        "trajectory": trajectory,
    }, commands


def client_program(session: Session, number: int) -> tuple[Answer, str]:
    """Return the program of a live page, which computes while the server is busy or gone.

    Returns
    -------
    Answer
        The data of a file that computes, or "why" there are none.
    str
        The script that it needs.
    """
    message: dict[str, Any] = {"id": number, "do": "program"}
    if getattr(session.elastic.mechanism, "closures", ()):
        # To record it takes seconds, in which the server would answer nothing else.
        return Answer(message | {"why": "the server answers for closed chains"}), ""
    fresh = Session(
        replace(session.source, elastic=session.elastic), session.make_picture
    )
    base = fresh.result(fresh.start)
    program = browser_program(session.elastic, base)
    if isinstance(program, str):
        return Answer(message | {"why": program}), ""
    data, commands = client_data(fresh, fresh.start, base, program)
    return Answer(data | message, commands), program.script
