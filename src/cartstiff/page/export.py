"""The page as one file that opens anywhere without a network.

The file of an arm or of a body on line legs computes: it holds their arithmetic as JavaScript
(`cartstiff.page.living`). That of any other mechanism holds frames: the posture shown and a sweep
of every coordinate through it, or the postures of a trajectory; for each the numbers under every
connection, as the library gives them, and the commands that bring the picture there. Nothing in
either depends on when or where it was made.
"""

from __future__ import annotations

import json
from collections.abc import Generator
from dataclasses import replace
from typing import Any

import numpy as np

from cartstiff.analysis.posture import analyse_posture
from cartstiff.errors import CartstiffError, InputError
from cartstiff.geometry import se3
from cartstiff.geometry.se3 import Array
from cartstiff.matrix_names import LETTERS
from cartstiff.mechanisms.elastic import ElasticMechanism
from cartstiff.page.answer import Answer
from cartstiff.page.compact import compacted
from cartstiff.page.description import slider_coordinates, slider_ranges
from cartstiff.page.files import page_document
from cartstiff.page.living import computing, tapes
from cartstiff.page.picture import Picture
from cartstiff.page.recording import Key, Pictures, common_part, complete, in_order
from cartstiff.page.session import PictureMaker, Session
from cartstiff.page.shown import modes_part, shown_numbers
from cartstiff.page.source import Source
from cartstiff.page.state import ViewState
from cartstiff.report.analysis import summary_text
from cartstiff.stiffness.compute import PostureStiffness
from cartstiff.version import __version__

#: Parts that an exported page can hide and show.
_PARTS = ("translation", "rotation", "labels", "wrench")
# Parts that a file which computes does not draw.
_NOT_COMPUTED = ("deflection", "screws", "centres")
# K+ is the transpose of K^A: all that is shown of it besides the matrix is that of K^A.
_VARIANTS = [
    (quantity, name) for quantity in ("stiffness", "compliance") for name in LETTERS if name != "+"
]
# Numbers that are the same for every connection and quantity.
_COMMON = ("result", "has_compliance", "position", "angles", "singularity", "legs", "moved")
_MATRICES = ("stiffness", "compliance")
_MOST_FRAMES = 2_000
_FRAMES = 25


def export_page(
    source: Source,
    *,
    frames: int | None = None,
    state: ViewState | None = None,
    picture: PictureMaker = Picture,
) -> str:
    """The page as HTML text.

    Parameters
    ----------
    source : Source
        What is shown; with a trajectory, its postures are the frames.
    frames : int, optional
        Postures along the sweep of each coordinate; the file then holds these. Default: a file that
        computes where it can, else 25.
    state : ViewState, optional
        What is shown at first.
    picture : callable
        Makes the picture of a mechanism.

    Raises
    ------
    InputError
        For more frames than a page holds; CartstiffError where the first posture has no picture.
    """
    steps = export_steps(source, source.elastic, state, frames, picture=picture)
    while True:
        try:
            next(steps)
        except StopIteration as done:
            text: str = done.value.data["text"]
            return text


def export_steps(
    source: Source,
    elastic: ElasticMechanism,
    state: ViewState | None,
    frames: int | None,
    *,
    picture: PictureMaker = Picture,
    number: int = 0,
    address: str | None = None,
) -> Generator[None, None, Answer]:
    """As `export_page`, yielding between postures; returns an answer with "name" and "text".

    `elastic` is the mechanism with the frame of interest that a tab has chosen; `address` is the
    end of the tab's: camera, units, what is compared.
    """
    here = replace(source, elastic=elastic, reload=None, cloud=source.cloud)
    session = Session(here, picture)
    first = session.start if state is None else state
    weighs = {"gravity": None, "payload": None}
    if first.command is not None and any(first.command):
        # The file is of the machine as it was told: its springs have their new rest positions.
        result = session.result(first)
        here = replace(source, q=result.q, load=None, command=None)
        state = first.model_copy(
            update={
                "command": None,
                "load": None,
                "stiffness": None,
                "q": result.q.tolist(),
                "load_at": first.acts_at,
                **weighs,
            }
        )
        steps = export_steps(
            here, result.elastic, state, frames, picture=picture, number=number, address=address
        )
        return (yield from steps)
    if first.gravity is not None or first.payload is not None:
        # The file is of the machine as it weighs.
        heavy = session.changed(first.model_copy(update={"stiffness": None}))
        state = first.model_copy(update=weighs)
        steps = export_steps(
            source, heavy, state, frames, picture=picture, number=number, address=address
        )
        return (yield from steps)
    hello = session.hello().data
    base = session.result(first)
    shown = first.model_copy(update={"moved": None, "q": base.q.tolist()})
    # What is hidden at first can be shown.
    first = shown.model_copy(update=dict.fromkeys(_PARTS, True))
    made: dict[str, Any] = {
        "by": f"cartstiff {__version__}",
        "state": shown.model_dump(exclude_defaults=True),
    }
    at = ", ".join(f"{x:.6g}" for x in base.q)
    analysis = analyse_posture(
        base, connection=first.connection, at=se3.pose(np.eye(3), first.point)
    )
    title = f"Analysis of K^{first.connection} in the posture of the file, q = {at}"
    text = summary_text(analysis, elastic.units, "full")
    script = ""
    recorded = tapes(elastic, base) if frames is None else "it was made of frames"
    if isinstance(recorded, str):
        data, lists, pictures = yield from _framed(session, first, base, frames or _FRAMES)
        data["why"] = recorded
        made["frames"] = len(data["frames"])
    else:
        shown = shown.model_copy(update=dict.fromkeys(_NOT_COMPUTED, False) | {"mode": None})
        data, lists, pictures = computing(session, shown, base)
        data["living"], script = recorded.data, recorded.script
    data["hello"] = hello | {
        "state": shown.model_dump(),
        "address": address,
        "bounds": session.picture.bounds(base),
        "only_trajectory": source.trajectory is not None and not script,
    }
    data |= {"analysis": {"title": title, "text": text}, "made": made}
    yield
    data["commands"], binary = compacted(pictures.commands, lists)
    packed = Answer(data, binary).pack()
    whole = page_document(packed, f"{elastic.name} · cartstiff", script)
    return Answer({"id": number, "do": "export", "name": f"{elastic.name}.html", "text": whole})


_Parts = tuple[dict[str, Any], list[list[int]], Pictures]


def _framed(
    session: Session, first: ViewState, base: PostureStiffness, frames: int
) -> Generator[None, None, _Parts]:
    """Frames and how to reach them; every list of commands, and the commands."""
    frames_of = _sweep_frames if session.source.trajectory is None else _trajectory_frames
    results, sweeps, path = yield from frames_of(session, first, base, frames)
    if first.ghost is not None and (other := _reached(session, first, np.array(first.ghost), None)):
        results.append(other)  # the numbers of posture A
    recorder = _Recorder(session, first)
    records: list[dict[str, Any]] = []
    for result in results:
        records.append(recorder.record(result))
        yield
    data = recorder.data(records) | {"sweeps": sweeps, "path": path}
    lists = [data["start"], *data["themes"].values()]
    lists += [numbers for frame in records for numbers in frame["pictures"].values()]
    return data, lists, recorder.pictures


# -- postures ---------------------------------------------------------------------------------

_Frames = Generator[
    None, None, tuple[list[PostureStiffness], dict[int, list[int]], list[int | None]]
]


def _sweep_frames(
    session: Session, state: ViewState, base: PostureStiffness, count: int
) -> _Frames:
    """The posture, and for every slider `count` postures through it."""
    elastic = session.elastic
    sliders = slider_coordinates(elastic)
    if len(sliders) * count > _MOST_FRAMES:
        raise InputError(
            "too many frames for one page",
            where="--frames",
            expected=f"at most {_MOST_FRAMES // len(sliders)}",
            got=count,
        )
    ranges = slider_ranges(elastic, base.q)
    results = [base]
    sweeps: dict[int, list[int]] = {}
    for i in sliders:
        values = np.linspace(*ranges[i], count)
        steps: list[tuple[float, int]] = [(float(base.q[i]), 0)]
        for side in (values[values > base.q[i]], values[values < base.q[i]][::-1]):
            q = base.q
            for value in side:  # outwards, so that a closed chain keeps its branch
                yield
                q = q.copy()
                q[i] = value
                result = _reached(session, state, q, i)
                if result is None:
                    break
                q = result.q
                steps.append((float(result.q[i]), len(results)))
                results.append(result)
        sweeps[i] = [index for _, index in sorted(steps)]
    return results, sweeps, []


def _trajectory_frames(
    session: Session,
    state: ViewState,
    base: PostureStiffness,
    count: int,  # noqa: ARG001
) -> _Frames:
    """The posture, and those of the trajectory."""
    results, path = [base], list[int | None]()
    trajectory = session.source.trajectory
    postures = np.empty((0, 0)) if trajectory is None else trajectory.q
    if len(postures) > _MOST_FRAMES:
        raise InputError(
            "too many postures for one page",
            where="--trajectory",
            expected=f"at most {_MOST_FRAMES}",
            got=len(postures),
        )
    for q in postures:
        yield
        result = _reached(session, state, q, None)
        path.append(None if result is None else len(results))
        if result is not None:
            results.append(result)
    return results, {}, path


def _reached(
    session: Session, state: ViewState, q: Array, moved: int | None
) -> PostureStiffness | None:
    try:
        with np.errstate(all="ignore"):
            return session.result(state.model_copy(update={"q": q.tolist(), "moved": moved}))
    except CartstiffError:
        return None


# -- pictures and numbers ---------------------------------------------------------------------


class _Recorder:
    """Numbers and pictures of every frame, what is equal kept once."""

    def __init__(self, session: Session, state: ViewState) -> None:
        self._picture, self._finished = session.picture, session.with_colour_bar
        self._state = state
        self.pictures = Pictures()
        self._variants: dict[str, int] = {}
        self._states: list[dict[Key, int]] = []
        self._first: PostureStiffness | None = None
        self.pictures.merge(self._picture.everything_by_path())

    def _looks(self) -> list[tuple[str, ViewState]]:
        return [
            (
                f"{quantity}/{name}",
                self._state.model_copy(update={"quantity": quantity, "connection": name}),
            )
            for quantity, name in _VARIANTS
        ]

    def _draw(self, result: PostureStiffness, state: ViewState) -> dict[str, Any]:
        at = state.model_copy(update={"q": result.q.tolist()})
        legend: dict[str, Any] = self._picture.draw(result, at)
        self.pictures.merge(self._picture.changes_by_path())
        return self._finished(legend)

    def record(self, result: PostureStiffness) -> dict[str, Any]:
        """One frame."""
        self._first = self._first or result
        frame: dict[str, Any] = {"variants": {}, "pictures": {}}
        frame["bounds"] = self._picture.bounds(result)
        frame["modes"] = modes_part(result)
        with np.errstate(all="ignore"):
            for key, look in self._looks():
                numbers = shown_numbers(result, look, whole=True)
                legend = self._draw(result, look)
                # The matrices of a reference point: the same for every connection.
                frame |= {n: numbers[n] for n in (*_COMMON, look.quantity, "frame")}
                rest = {n: x for n, x in numbers.items() if n not in (*frame, *_MATRICES)}
                _shorten_axes(rest["principal"])
                text = json.dumps({"numbers": rest, "legend": legend}, allow_nan=False)
                frame["variants"][key] = self._variants.setdefault(text, len(self._variants))
                frame["pictures"][key] = len(self._states)
                self._states.append(self.pictures.state())
        for quantity in _MATRICES:
            for table in (frame["variants"], frame["pictures"]):
                table[f"{quantity}/+"] = table[f"{quantity}/A"]
        return frame

    def data(self, records: list[dict[str, Any]]) -> dict[str, Any]:
        """Everything recorded, with the parts and themes of the page."""
        first = self._first
        if first is None:
            raise InputError("nothing to export")
        parts = {part: self._hidden_by(first, part) for part in _PARTS}
        other = "light" if self._state.theme == "dark" else "dark"
        themes = {name: self._theme(first, name) for name in (self._state.theme, other)}
        own = {
            key
            for paths in parts.values()
            for path in paths
            for key in [("set_property", path, "visible")]
        }
        complete(self._states, self.pictures)
        same = common_part(self._states)
        changing = {key for state in self._states for key in state} - (same - own)
        for frame in records:
            frame["pictures"] = {
                key: in_order(self._states[i], changing) for key, i in frame["pictures"].items()
            }
        differing = {k for k in themes["light"] if themes["light"][k] != themes["dark"].get(k)}
        return {
            "frames": records,
            "variants": [json.loads(text) for text in self._variants],
            "start": in_order(self._states[0], set(self._states[0])),
            "themes": {name: in_order(state, differing & same) for name, state in themes.items()},
            "parts": parts,
        }

    def _hidden_by(self, result: PostureStiffness, part: str) -> list[str]:
        """Paths that are visible with a part and not without."""
        self._draw(result, self._state)
        before = self.pictures.state()
        self._draw(result, self._state.model_copy(update={part: False}))
        after = self.pictures.state()
        self._draw(result, self._state)
        return [
            path
            for kind, path, what in after
            if kind == "set_property"
            and what == "visible"
            and after[kind, path, what] != before.get((kind, path, what))
        ]

    def _theme(self, result: PostureStiffness, name: str) -> dict[Key, int]:
        """The viewer's state in a theme, every variant drawn."""
        for _, look in self._looks():
            self._draw(result, look.model_copy(update={"theme": name}))
        self._draw(result, self._state.model_copy(update={"theme": name}))
        return self.pictures.state()


def _shorten_axes(principal: dict[str, Any] | None) -> None:
    """Directions to six digits: they are shown to three."""
    for entry in (principal or {}).values():
        entry["axes"] = [[round(x, 6) for x in axis] for axis in entry["axes"]]
