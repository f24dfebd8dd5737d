"""The page as one file that opens anywhere without a network.

The file of an arm or of a body on line legs computes: it holds their arithmetic as JavaScript
(`cartstiff.page.browser_program`). The browser cannot compute other mechanisms: their file holds
one posture, its numbers and its picture, and says so. Nothing in either depends on when or where it
was made.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from cartstiff.analysis.posture import analyse_posture
from cartstiff.geometry import se3
from cartstiff.mechanisms.elastic import ElasticMechanism
from cartstiff.page.answer import Answer
from cartstiff.page.browser_program import browser_program
from cartstiff.page.commands import Key, Pictures, compacted, in_order
from cartstiff.page.files import page_document
from cartstiff.page.picture import Picture
from cartstiff.page.session import PictureMaker, Session
from cartstiff.page.source import Source
from cartstiff.page.state import ViewState
from cartstiff.report.analysis import summary_text
from cartstiff.stiffness.compute import PostureStiffness
from cartstiff.version import __version__

# Parts that a file which computes does not draw.
_NOT_COMPUTED = ("deflection", "screws", "centres")
# What a file holds as it was: the mechanism is that of the state.
_PLAIN = {"gravity": None, "payload": None, "command": None}


def export_page(
    source: Source,
    *,
    elastic: ElasticMechanism | None = None,
    state: ViewState | None = None,
    picture: PictureMaker = Picture,
    address: str | None = None,
) -> str:
    """The page as HTML text.

    Parameters
    ----------
    source : Source
        What is shown.
    elastic : ElasticMechanism, optional
        The mechanism with the frame of interest that a tab has chosen; default the source's.
    state : ViewState, optional
        What is shown at first.
    picture : callable
        Makes the picture of a mechanism.
    address : str, optional
        The end of a tab's address: camera, units, what is compared.

    Raises
    ------
    CartstiffError
        Where the posture has no picture.
    """
    elastic = source.elastic if elastic is None else elastic
    with np.errstate(all="ignore"):
        session, shown = _session(source, elastic, state, picture)
        hello = session.hello().data
        base = session.result(shown)
        shown = shown.model_copy(update={"moved": None, "q": base.q.tolist()})
        program = browser_program(session.elastic, base)
        if isinstance(program, str):
            data, lists, pictures = _picture_of(session, shown, base, is_whole=False)
            at_modes = shown.model_copy(update={"mode": 1})
            data["posture"] = {
                "numbers": session.numbers(base, at_modes),
                "result": base.as_dict(),
                "why": program,
            }
        else:
            shown = shown.model_copy(update=dict.fromkeys(_NOT_COMPUTED, False) | {"mode": None})
            data, lists, pictures = _picture_of(session, shown, base)
            data["program"] = program.data
        data["hello"] = hello | {
            "state": shown.model_dump(),
            "address": address,
            "bounds": session.picture.bounds(base),
        }
        data["analysis"] = _analysis(base, shown, elastic)
    data["made"] = {
        "by": f"cartstiff {__version__}",
        "state": shown.model_dump(exclude_defaults=True),
    }
    data["commands"], binary = compacted(pictures.commands, lists)
    script = "" if isinstance(program, str) else program.script
    return page_document(Answer(data, binary).pack(), f"{elastic.name} · cartstiff", script)


def _session(
    source: Source, elastic: ElasticMechanism, state: ViewState | None, picture: PictureMaker
) -> tuple[Session, ViewState]:
    """A session of the machine as it was told and as it weighs, and what is shown of it."""
    here = replace(source, elastic=elastic, reload=None)
    session = Session(here, picture)
    first = session.start if state is None else state
    if first.command is not None and any(first.command):
        # The springs have their new rest positions.
        result = session.result(first)
        update = {"load": None, "stiffness": None, "load_at": first.acts_at, "q": result.q.tolist()}
        here = replace(here, elastic=result.elastic, q=result.q, load=None, command=None)
    elif first.gravity is not None or first.payload is not None:
        update = {}
        heavy = session.changed(first.model_copy(update={"stiffness": None}))
        here = replace(here, elastic=heavy)
    else:
        return session, first
    return Session(here, picture), first.model_copy(update=_PLAIN | update)


def _analysis(
    base: PostureStiffness, shown: ViewState, elastic: ElasticMechanism
) -> dict[str, str]:
    at = ", ".join(f"{x:.6g}" for x in base.q)
    answer = analyse_posture(base, connection=shown.connection, at=se3.pose(np.eye(3), shown.point))
    title = f"Analysis of K^{shown.connection} in the posture of the file, q = {at}"
    return {"title": title, "text": summary_text(answer, elastic.units, "full")}


def _picture_of(
    session: Session, shown: ViewState, base: PostureStiffness, *, is_whole: bool = True
) -> tuple[dict[str, Any], list[list[int]], Pictures]:
    """One picture in both themes; a whole one has every part that another state needs."""
    pictures, picture = Pictures(), session.picture
    states: dict[str, dict[Key, int]] = {}
    other = "light" if shown.theme == "dark" else "dark"
    kit = None
    for theme in (shown.theme, other):
        look = shown.model_copy(update={"theme": theme})
        if is_whole:  # the file copies the links of a ghost
            kit = picture.kit(base, look.model_copy(update={"ghost": None}))
        else:
            picture.draw(base, look)
        pictures.merge(picture.changes_by_path() if states else picture.everything_by_path())
        states[theme] = pictures.state()
    here, there = states[shown.theme], states[other]
    differing = {
        key
        for key, number in there.items()
        if number != here.get(key) and (key[0] == "set_object" or key[2] not in ("", "visible"))
    }
    start = in_order(here, set(here))
    themes = {theme: in_order(state, differing) for theme, state in states.items()}
    legend = session.with_colour_bar(picture.draw(base, shown))
    units, trajectory = session.elastic.units, session.source.trajectory
    data = {
        "start": start,
        "themes": themes,
        "kit": kit,
        "legend": legend,
        "scene": {
            "units": {"length": units.length, "force": units.force, "moment": units.moment},
            "lines": [line for line in legend["lines"] if line["mark"] == "note"],
            "notes": legend["notes"],
        },
        "trajectory": None if trajectory is None else trajectory.q.tolist(),
    }
    return data, [start, *themes.values()], pictures


def client_program(session: Session, number: int) -> tuple[Answer, str]:
    """What a live page computes by itself between two answers, and while there are none.

    Returns
    -------
    Answer
        The data of a file that computes, or "why" there are none.
    str
        The script that it needs.
    """
    source = replace(session.source, elastic=session.elastic, reload=None)
    fresh = type(session)(source, session.make_picture)
    state = fresh.start
    base = fresh.result(state)
    program = browser_program(session.elastic, base)
    message: dict[str, Any] = {"id": number, "do": "program"}
    if isinstance(program, str):
        return Answer(message | {"why": program}), ""
    hello = fresh.hello().data
    data, lists, pictures = _picture_of(fresh, state.model_copy(update={"mode": None}), base)
    data["commands"], binary = compacted(pictures.commands, lists)
    data |= message | {"program": program.data, "hello": hello}
    return Answer(data, binary), program.script
