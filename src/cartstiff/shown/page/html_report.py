"""The report of one posture as one HTML file: the answer first,
then picture and numbers.

It renders the answer of `cartstiff.answer.posture.answer_at`, with the sentences and the
tables of the commands.
"""

from __future__ import annotations

import datetime
import platform
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from html import escape
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from cartstiff.answer.data import Answer, Quantity, Statement, said
from cartstiff.answer.full_analysis import wrench_tables
from cartstiff.answer.posture import answer_at, room_load
from cartstiff.core.arrays import Array, checked_vector
from cartstiff.core.errors import CartstiffError, UndefinedError
from cartstiff.core.mechanisms.elastic import ElasticMechanism
from cartstiff.core.notes import DOUBTS
from cartstiff.core.stiffness.applied_load import Axes, Behaviour, LoadKind
from cartstiff.core.stiffness.compute import PostureStiffness, analyse
from cartstiff.core.units import Units, engineering
from cartstiff.shown.page.export import export_page
from cartstiff.shown.page.report_curves import plot, sweeps_of
from cartstiff.shown.page.report_drawing import drawing
from cartstiff.shown.page.report_parts import (
    items,
    matrix,
    section,
    table,
    tables,
    text,
)
from cartstiff.shown.page.shown import distance_to_singularity
from cartstiff.shown.page.source import Source
from cartstiff.shown.report.answer import in_short
from cartstiff.shown.report.layout import placed
from cartstiff.shown.report.sentences import (
    SENTENCES,
    answer_sentences,
    direction_words,
    is_upright,
    sentence,
    statement_sentences,
    title,
    words_of,
)
from cartstiff.version import __version__
from cartstiff.wings.toolpaths.better import better_posture
from cartstiff.wings.toolpaths.better_answer import better_statements

_STYLE = Path(__file__).parent / "static" / "report.css"


@dataclass(frozen=True, eq=False)
class ReportPoint:
    """A posture of which a report has a page.

    Attributes
    ----------
    name : str
        Its name in the report.
    q : ndarray (n,)
        Coordinates without the load.
    wrench : ndarray (6,) or None
        Load at this point along the axes of F; None for that of the report.
    """

    name: str
    q: Array
    wrench: Array | None = None


def report_page(
    elastic: ElasticMechanism,
    q: ArrayLike | None = None,
    *,
    wrench: ArrayLike | None = None,
    load_kind: Behaviour = "dead",
    load_at: Sequence[float] = (0.0, 0.0, 0.0),
    load_axes: Axes = "body",
    command: str = "",
    sections: Sequence[tuple[str, str]] = (),
    points: Sequence[ReportPoint] = (),
) -> str:
    """The report as HTML text that needs nothing else.

    Parameters
    ----------
    elastic : ElasticMechanism
        The mechanism, with its springs; what carries gravity at the posture is chosen as
        in `cartstiff.analyse`.
    q : array_like (n,) or mapping, optional
        The posture without the load; default the mechanism's.
    wrench, load_kind, load_at, load_axes
        The load, as in `cartstiff.analyse`.
    command : str
        The command that made the report, which it quotes.
    sections : sequence of (title, HTML)
        Further sections, after the sweep.
    points : sequence of ReportPoint, optional
        Several postures instead of `q`: each has a page of its own, the worst first.

    Raises
    ------
    CartstiffError
        As `cartstiff.analyse`.
    """
    kind = LoadKind(load_kind, tuple(load_at))  # type: ignore[arg-type]
    asked = points or [ReportPoint("", np.asarray(elastic.placed(q)[1].q), None)]
    pages = []
    for point in asked:
        here, posture = elastic.placed(point.q if points or q is not None else None)
        acting: tuple[ArrayLike | None, Axes] = (wrench, load_axes)
        if point.wrench is not None:
            acting = (point.wrench, "world")
        with np.errstate(all="ignore"):
            load = _Load.of(here, posture.q, acting[0], kind, acting[1])
            pages.append(_Page.of(here, posture.q, load, point.name))
    pages.sort(key=lambda page: -page.far)
    # One picture in three dimensions, of the worst posture: it is the largest part of the
    # file.
    worst = pages[0]
    head = f"{elastic.name}: stiffness at {elastic.mechanism.frame}"
    at = placed(elastic.mechanism.frame_offset, elastic.units)
    sits = f" M is {at} in {elastic.mechanism.frame}." * bool(at)
    about = [
        datetime.date.today().isoformat(),
        f"cartstiff {__version__}",
        f"Pinocchio {version('pin')}",
        f"NumPy {np.__version__}",
        f"Python {platform.python_version()}",
    ]
    parts = [
        f"<h1>{text(head)}</h1>",
        f'<p class="quiet">M is the tool\'s frame, F the room.{text(sits)}</p>',
        *(f'<p class="doubt">{text(line)}</p>' for line in _at_the_head(worst.answer)),
        _summary(pages, elastic.units) * bool(points),
        *(f"<article>{page.html()}</article>" for page in pages),
        worst.picture(),
        *(section(name, body) for name, body in sections),
        section("What is assumed", f"<ul>{items(_assumed(elastic, pages))}</ul>"),
        section(
            "Made by",
            f'<p class="quiet"><code>{text(command)}</code><br>{", ".join(about)}</p>',
        ),
    ]
    return (
        '<!doctype html><html lang="en"><meta charset="utf-8"><meta name="viewport" '
        f'content="width=device-width"><title>{text(head)}</title><style>\n'
        f"{_STYLE.read_text('utf-8')}</style>\n" + "\n".join(parts) + "</html>\n"
    )


# Codes of doubts that a report says at its head, and nowhere else.
_HEAD = (*DOUBTS, "springs-illustrative")


def _at_the_head(answer: Answer) -> list[str]:
    """Springs that are assumed, or illustrative by their file, and open loops."""
    leads = {"stiffness-assumed": "The springs are assumed: "}
    said = [leads.get(n.code, "") + n.message for n in answer.doubts if n.code in _HEAD]
    return [f"{line[0].upper()}{line[1:]}." for line in said]


def _assumed(elastic: ElasticMechanism, pages: Sequence[_Page]) -> list[str]:
    """What the file says of its numbers, and every note that is not among the doubts."""
    source = [f"The file says of its numbers: {elastic.source}"] * bool(elastic.source)
    told = {str(note) for page in pages for note in page.answer.doubts}
    notes = dict.fromkeys(str(note) for page in pages for note in page.result.notes)
    return [*source, *(note for note in notes if note not in told)] or ["nothing"]


def _summary(pages: Sequence[_Page], units: Units) -> str:
    """The points in one table, the worst first."""
    rows = []
    for page in pages:
        soft = page.answer.extreme("softest")
        least = (
            soft
            and soft.stiffness
            and engineering(soft.stiffness, units.stiffness["translation"])
        )
        far = engineering(page.far, units.length) * bool(np.isfinite(page.far))
        rows.append([page.name, far, least or "", title(page.answer.verdict)])
    heads = ("point", "the tip moves", "softest direction", "the posture")
    return section("The points, worst first", table(rows, heads))


@dataclass(frozen=True, eq=False)
class _Load:
    """The load on the body, and whether a wrench holds the posture without it.

    Attributes
    ----------
    added : ndarray (6,) or None
        The load of the report, as it was given.
    is_held : bool
        Rest positions that the file gives are kept: a wrench holds the mechanism at the
        posture before the load.
    kind : LoadKind
        Behaviour of the load while the body moves, and the point at which it acts.
    axes : {"body", "world"}
        Its axes.
    pose : ndarray (4, 4)
        ``T_F_M`` without the load.
    """

    added: Array | None
    is_held: bool
    kind: LoadKind
    axes: Axes
    pose: Array

    @classmethod
    def of(
        cls,
        elastic: ElasticMechanism,
        q: Array,
        wrench: ArrayLike | None,
        kind: LoadKind,
        axes: Axes,
    ) -> _Load:
        """The load at a posture."""
        added = None
        if wrench is not None:
            added = checked_vector(wrench, 6, "wrench")
        alone = analyse(elastic, q)
        W = alone.wrench
        is_held = W is not None and bool(alone.shown_wrench(W).any())
        return cls(added, is_held, kind, axes, alone.pose)

    @property
    def taken(self) -> Array | None:
        """The load that the springs take over; None if it is added to what holds them."""
        return (self.added, None)[self.is_held]

    @property
    def more(self) -> Array | None:
        """The load that is added to what holds the posture, in the axes of M."""
        if not self.is_held or self.added is None:
            return None
        if self.axes == "body":
            return self.added
        return _turned(self.pose[:3, :3].T, self.added)

    @property
    def in_room(self) -> Array:
        """The load (6,) along the axes of F."""
        if self.added is None:
            return np.zeros(6)
        if self.axes == "world":
            return self.added
        return _turned(self.pose[:3, :3], self.added)

    def result(self, elastic: ElasticMechanism, q: Array) -> PostureStiffness:
        """The posture as `analyse` answers it."""
        if self.taken is None:
            return analyse(elastic, q)
        return analyse(
            elastic,
            q,
            wrench=self.taken,
            load_kind=self.kind.kind,
            load_at=self.kind.at,
            load_axes=self.axes,
        )

    def source(self, elastic: ElasticMechanism, q: Array) -> Source:
        """The page that shows the posture as `analyse` answers it."""
        source = Source(elastic, q, load_kind=self.kind.kind, load_axes=self.axes)
        if any(self.kind.at):
            source = replace(source, load_at=self.kind.at)
        return replace(source, load=self.taken)


def _turned(rotation: Array, wrench: Array) -> Array:
    """Moment and force (6,) along other axes."""
    return np.asarray(wrench.reshape(2, 3) @ rotation.T).ravel()


@dataclass(frozen=True, eq=False)
class _Page:
    """What a report says of one posture.

    Attributes
    ----------
    elastic : ElasticMechanism
        The mechanism.
    start : ndarray (n,)
        Its coordinates at the posture.
    load : _Load
        The load there.
    name : str
        Name of the point.
    result : PostureStiffness
        As `analyse` answers it.
    answer : Answer
        What is said of it; the displacement is that of the load alone.
    """

    elastic: ElasticMechanism
    start: Array
    load: _Load
    name: str
    result: PostureStiffness
    answer: Answer

    @classmethod
    def of(cls, elastic: ElasticMechanism, q: Array, load: _Load, name: str) -> _Page:
        """The answer at a posture."""
        result = load.result(elastic, q)
        answer = answer_at(
            result,
            wrench=load.more,
            load_at=np.array(load.kind.at),
            load_kind=load.kind.kind,
        )
        return cls(elastic, q, load, name, result, answer)

    @property
    def far(self) -> float:
        """How far the tip moves; infinite where it has no stable rest under the load."""
        if self.load.added is None:
            return 0.0
        far = self.answer.far
        if far is None:
            return float("inf")
        return far

    def html(self) -> str:
        """The answer, the drawing and the numbers."""
        load = self.load
        sentences = [self._carries(), *answer_sentences(self.answer), *self._better()]
        doubts = [str(n) for n in self.answer.doubts if n.code not in _HEAD]
        parts = [
            f"<h2>{text(self.name)}</h2>" * bool(self.name),
            f'<div class="answer"><ul>{items(sentences)}</ul></div>',
            f'<ul class="doubts">{items(doubts)}</ul>' * bool(doubts),
            drawing(self.result, self.answer, load.more, load.kind),
            tables(in_short(self.answer.tables)),
            section("Distance to a singularity", self._near()),
            section("Load and weight", f"<ul>{items(self._acting())}</ul>"),
            self._wrenches(),
            section("Stiffness", matrix(self.result)),
            section("One joint at a time", self._curves()),
        ]
        return "\n".join(part for part in parts if part)

    def _wrenches(self) -> str:
        """What each carries, about the origin and along the axes of a frame."""
        wrenches = [one.to_dict() for one in self.result.wrenches]
        return tables(wrench_tables({"wrenches": wrenches}, self.elastic.units))

    def _curves(self) -> str:
        """The displacement while one coordinate moves, where springs take the load."""
        load = self.load
        if load.taken is None:
            return ""
        swept = sweeps_of(self.elastic, self.start, load.in_room, load.kind)
        if not swept:
            return ""
        return (
            "<p>Displacement of the tip under the same load in the room, while one "
            "coordinate moves from here.</p>"
            f"<figure>{plot(swept, self.elastic)}</figure>"
        )

    def picture(self) -> str:
        """The mechanism in three dimensions, for screens."""
        before = ", before the load" * (self.load.more is not None)
        at = f" at {self.name}" * bool(self.name)
        try:
            page = export_page(self.load.source(self.elastic, self.result.q))
        except CartstiffError as error:
            shown = f"<p>{text(f'No picture: {error}')}</p>"
        else:
            source = escape(page, quote=True)
            shown = f'<iframe title="the mechanism" srcdoc="{source}"></iframe>'
        head = f"<h2>In three dimensions{text(at)}{before}</h2>"
        return f'<section class="screen">{head}{shown}</section>'

    def _carries(self) -> str:
        """The sentence that names the load, and what holds the mechanism there."""
        how = ("held-by-joints", "held-by-legs")[len(self.elastic.mechanism.points) > 0]
        if self.load.is_held:
            how = "held-by-wrench"
        if self.answer.load is None:
            how = "not-held"
        return self._said("carries", what=list(self._parts()), how=said(how))

    def _parts(self) -> Iterator[Statement]:
        """Force, moment and weight that act."""
        units, kinds = self.elastic.units, ("moment", "force")
        for kind, part in zip(kinds, np.split(self.load.in_room, 2), strict=True):
            if part.any():
                size = Quantity(float(np.linalg.norm(part)), getattr(units, kind))
                where = direction_words(tuple(part), False, is_upright(self.answer))
                yield said(f"a-{kind}", size=size, where=where)
        if self.elastic.gravity is not None:
            yield said("its-weight")
        elif not self.load.in_room.any():
            yield said("nothing")

    def _said(self, code: str, **values: Any) -> str:
        return sentence(SENTENCES[code], values)

    def _better(self) -> list[str]:
        """A better posture with the tip where it is, or that there is none."""
        load = self.load
        if load.added is None:
            return []
        try:
            found = better_posture(
                self.elastic,
                self.start,
                wrench=load.added,
                load_kind=load.kind.kind,
                load_at=load.kind.at,
                load_axes=load.axes,
            )
        except UndefinedError:
            return []
        return [" ".join(words_of(better_statements(found, self.elastic)))]

    def _near(self) -> str:
        """How far the posture is from each kind of singularity."""
        lines = (
            self._said("near-singular", kind=x["kind"], ratio=x["ratio"], length=length)
            for x in distance_to_singularity(self.result)
            for length in [Quantity(x["length"], self.result.units.length)]
        )
        return "".join(f"<p>{text(line)}</p>" for line in lines)

    def _acting(self) -> list[str]:
        """The lines about the load and the weight."""
        load, statements = self.load, [said("nothing-acts")]
        answer = self.answer
        if load.added is not None:
            kind, axes = load.kind, np.eye(3)
            own = room_load(self.elastic, kind.kind, kind.at, load.in_room, axes)
            answer, statements = replace(answer, load=own), [said("load")]
        lines = statement_sentences(answer, statements)
        if load.is_held and self.answer.load is not None:
            lines += statement_sentences(self.answer, [said("held-before")])
        return [*lines, self.result.weighed.text]
