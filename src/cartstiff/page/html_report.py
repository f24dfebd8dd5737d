"""The report of one posture as one HTML file: the answer first,
then picture and numbers.
"""

from __future__ import annotations

import datetime
import platform
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from importlib.metadata import version
from itertools import product
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cartstiff import numerics
from cartstiff.analysis.posture import analyse_posture
from cartstiff.answer.data import Answer
from cartstiff.answer.posture import answer_at
from cartstiff.arrays import checked_vector
from cartstiff.batch.postures import analyse_many
from cartstiff.errors import CartstiffError, UndefinedError, printable
from cartstiff.geometry.se3 import Array
from cartstiff.mechanisms.elastic import ElasticMechanism
from cartstiff.mechanisms.gravity_loads import gravity_loads
from cartstiff.mechanisms.limits import beyond_limits, limits_of
from cartstiff.page.export import export_page
from cartstiff.page.report_drawing import Arrow, drawing
from cartstiff.page.shown import distance_to_singularity
from cartstiff.page.source import Source
from cartstiff.potentials.loads import Load
from cartstiff.report.analysis import (
    links_of_coordinates,
    resisted_deflection,
    shares_of_parts,
)
from cartstiff.report.better import NONE_FOUND, better_sentences
from cartstiff.report.layout import placed
from cartstiff.report.sentences import VERDICTS, direction_words, share_words, where
from cartstiff.scene.scales import round_number
from cartstiff.statics.equilibrium import equilibrium
from cartstiff.statics.held import displacement_between
from cartstiff.stiffness.applied_load import LoadKind
from cartstiff.stiffness.compute import analyse
from cartstiff.stiffness.posture import PostureStiffness
from cartstiff.toolpaths.better import better_posture
from cartstiff.units import SI, Units, convert_length, engineering, sized
from cartstiff.version import __version__

# Values along the sweep of a coordinate, and how far it goes: rad, or characteristic
# lengths.
_COUNT, _REACH = 21, 0.5
# Curves that have their names beside them.
_NAMED_CURVES = 14
_COLOURS = (
    "#2060c0",
    "#c04020",
    "#208040",
    "#8040a0",
    "#b08000",
    "#008090",
    "#c0307a",
    "#606060",
)
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
    load_kind: Literal["dead", "follower", "conservative"] = "dead",
    load_at: Sequence[float] = (0.0, 0.0, 0.0),
    load_axes: Literal["body", "world"] = "body",
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
        placed_here, posture = elastic.placed(
            point.q if points or q is not None else None
        )
        acting = (wrench, load_axes)
        if point.wrench is not None:
            acting = (point.wrench, "world")
        load = _Load.of(placed_here, posture.q, acting[0], kind, acting[1])
        with np.errstate(all="ignore"):
            pages.append(_page(placed_here, posture.q, load, point.name))
    pages.sort(key=lambda page: -page.severity)
    title = f"{elastic.name}: stiffness at {elastic.mechanism.frame}"
    where = placed(elastic.mechanism.frame_offset, elastic.units)
    sits = f" M is {where} in {elastic.mechanism.frame}." if where else ""
    notes = dict.fromkeys(note for page in pages for note in page.notes)
    source = [f"The file says of its numbers: {elastic.source}"] * bool(elastic.source)
    about = [
        datetime.date.today().isoformat(),
        f"cartstiff {__version__}",
        f"Pinocchio {version('pin')}",
        f"NumPy {np.__version__}",
        f"Python {platform.python_version()}",
    ]
    parts = [
        f"<h1>{_text(title)}</h1>",
        f'<p class="quiet">M is the tool\'s frame, F the room.{_text(sits)}</p>',
        _doubt(elastic),
        _summary(pages, elastic.units) if points else "",
        *(f"<article>{page.html}</article>" for page in pages),
        *(f"<section><h2>{_text(head)}</h2>{body}</section>" for head, body in sections),
        "<section><h2>What is assumed</h2><ul>"
        f"{_items([*source, *_unsaid(elastic, [*notes])] or ['nothing'])}</ul></section>",
        f'<section><h2>Made by</h2><p class="quiet"><code>{_text(command)}</code><br>'
        f"{', '.join(about)}</p></section>",
    ]
    # One picture in three dimensions, of the worst posture: it is the largest part of the
    # file.
    worst = pages[0]
    parts.insert(5, worst.picture())
    return (
        '<!doctype html><html lang="en"><meta charset="utf-8"><meta name="viewport" '
        f'content="width=device-width"><title>{_text(title)}</title><style>\n{_STYLE.read_text("utf-8")}</style>\n'
        + "\n".join(parts)
        + "</html>\n"
    )


@dataclass(frozen=True, eq=False)
class _Page:
    """What a report says of one posture."""

    elastic: ElasticMechanism
    name: str
    result: PostureStiffness
    load: _Load
    answer: Answer
    said: _Said
    html: str

    @property
    def notes(self) -> list[str]:
        """What was assumed."""
        return self.said.notes

    @property
    def severity(self) -> float:
        """How far the tip moves; infinite where it has no stable rest under the load."""
        return self.said.far if self.said.is_stable else np.inf

    def picture(self) -> str:
        """The mechanism in three dimensions, for screens."""
        load = self.load
        before = "" if load.held is None or load.added is None else ", before the load"
        at = f" at {self.name}" * bool(self.name)
        picture = _picture(self.elastic, self.result, load)
        head = f"<h2>In three dimensions{_text(at)}{before}</h2>"
        return f'<section class="screen">{head}{picture}</section>'


def _page(elastic: ElasticMechanism, start: Array, load: _Load, name: str) -> _Page:
    """The answer, the drawing and the numbers of one posture."""
    result = load.result(elastic, start)
    analysis = load.analysis(result)
    swept = _swept(elastic, start, load)
    answer = load.answer(result)
    said = _answer(elastic, start, load, result, analysis, answer)
    shown = drawing(elastic, *said.ends, _arrow(load, elastic.units), elastic.units)
    parts = [
        f"<h2>{_text(name)}</h2>" * bool(name),
        f'<div class="answer"><ul>{_items(said.lines)}</ul></div>',
        shown,
    ]
    if legs := _legs(result):
        parts.append(f"<section><h2>Legs</h2>{legs}</section>")
    parts += [
        f"<section><h2>Posture</h2>{_joints(result, start, analysis)}{_near(result)}</section>",  # noqa: E501
        "<section><h2>Load and "
        f"weight</h2><ul>{_items(_acting(elastic, load))}</ul></section>",
        f"<section><h2>Stiffness</h2>{_matrix(result, load)}</section>",
    ]
    if swept:
        parts.append(
            "<section><h2>One joint at a time</h2><p>Displacement of the tip under the "
            "same load "
            "in the room, while one coordinate moves from "
            f"here.</p><figure>{_plot(swept, elastic)}"
            "</figure></section>"
        )
    return _Page(elastic, name, result, load, answer, said, "\n".join(parts))


def _summary(pages: Sequence[_Page], units: Units) -> str:
    """The points in one table, the worst first."""
    rows = []
    for page in pages:
        soft = page.answer.extreme("softest")
        least = None if soft is None else soft.stiffness
        rows.append(
            [
                page.name,
                _quantity(page.said.far, units.length),
                _quantity(least, units.stiffness["translation"]),
                {True: "stable", False: "NOT stable", None: "not decided"}[
                    page.said.stable
                ],
            ]
        )
    heads = ("point", "the tip moves", "softest direction", "equilibrium")
    return f"<section><h2>The points, worst first</h2>{_table(rows, heads)}</section>"


def _arrow(load: _Load, units: Units) -> Arrow | None:
    """The force of the load, at its point."""
    force = load.in_room[3:]
    if not force.any():
        return None
    at = load.pose[:3, :3] @ load.kind.at + load.pose[:3, 3]
    much = engineering(float(np.linalg.norm(force)), units.force)
    return Arrow(at, force, f"the force of {much}")


@dataclass(frozen=True, eq=False)
class _Load:
    """The load on the body, and the wrench that holds the posture without it.

    Attributes
    ----------
    added : ndarray (6,) or None
        The load of the report, as it was given.
    held : ndarray (6,) or None
        The wrench that holds the mechanism at the posture before the load, at the same
        point and along the same axes; None if its springs hold it there.
    kind : LoadKind
        Their behaviour while the body moves, and the point at which they act.
    axes : {"body", "world"}
        Axes of both.
    pose : ndarray (4, 4)
        ``T_F_M`` without the load.
    """

    added: Array | None
    held: Array | None
    kind: LoadKind
    axes: Literal["body", "world"]
    pose: Array

    @classmethod
    def of(
        cls,
        elastic: ElasticMechanism,
        q: Array,
        wrench: ArrayLike | None,
        kind: LoadKind,
        axes: Literal["body", "world"],
    ) -> _Load:
        """The load at a posture, with what holds the mechanism there by the
        springs' rest.
        """
        added = None if wrench is None else checked_vector(wrench, 6, "wrench")
        alone = analyse(elastic, q)
        held = None if alone.wrench is None else alone.shown_wrench(alone.wrench)
        if held is None or not held.any():
            return cls(added, None, kind, axes, alone.pose)
        moment, force = np.split(held, 2)
        held = np.concatenate([moment - np.cross(kind.at, force), force])
        if axes == "world":
            held = _turned(alone.pose[:3, :3], held)
        return cls(added, held, kind, axes, alone.pose)

    @property
    def whole(self) -> Array | None:
        """Load and holding wrench together; None if nothing acts."""
        if self.added is None:
            return self.held
        return self.added if self.held is None else self.added + self.held

    @property
    def in_room(self) -> Array:
        """The load (6,) along the axes of F."""
        added = np.zeros(6) if self.added is None else self.added
        return added if self.axes == "world" else _turned(self.pose[:3, :3], added)

    def result(self, elastic: ElasticMechanism, q: Array) -> PostureStiffness:
        """The posture as `analyse` answers it: with the load where its springs can
        take it over.

        Rest positions that the file gives are kept: then it is the posture before the
        load.
        """
        return analyse(
            elastic,
            q,
            wrench=None if self.held is not None else self.added,
            load_kind=self.kind.kind,
            load_at=self.kind.at,
            load_axes="body" if self.held is not None else self.axes,
        )

    def terms(self, wrench: Array | None) -> list[Load]:
        """A wrench as a load of `equilibrium`."""
        return [] if wrench is None else [self.kind.acting(wrench, self.pose, self.axes)]

    def answer(self, result: PostureStiffness) -> Answer:
        """What is said of a posture; its displacement is that of the load alone."""
        if self.held is None or self.added is None:
            return answer_at(result, quickly=True)
        added = self.added
        if self.axes == "world":
            added = _turned(self.pose[:3, :3].T, added)
        return answer_at(
            result, wrench=added, load_at=np.array(self.kind.at), quickly=True
        )

    def analysis(self, result: PostureStiffness) -> dict[str, Any]:
        """Analysis of a posture under all that acts.

        Its deflection is that of the load alone.
        """
        if self.held is None:
            return analyse_posture(result)
        if self.added is None:
            return analyse_posture(result) | {"deflection": None}
        added = self.added
        if self.axes == "world":
            added = _turned(self.pose[:3, :3].T, added)
        return analyse_posture(result, wrench=added, load_at=self.kind.at)


def _turned(rotation: Array, wrench: Array) -> Array:
    """Moment and force (6,) along other axes."""
    return np.asarray(wrench.reshape(2, 3) @ rotation.T).ravel()


@dataclass(frozen=True, eq=False)
class _Said:
    """The sentences of the answer, and what they come from.

    Attributes
    ----------
    lines, notes : list of str
        The answer; everything that was assumed.
    ends : tuple of ndarray (n,)
        Coordinates at rest before the load, and under it; None where that is not known.
    far : float
        Displacement of the tip; NaN if it is not known.
    stable : bool or None
        Of the equilibrium under the load; None if it is not decided.
    """

    lines: list[str]
    notes: list[str]
    ends: tuple[Array, Array | None]
    far: float
    stable: bool | None

    @property
    def is_stable(self) -> bool:
        """Whether the displacement is that to a stable rest."""
        return self.stable is not False and not np.isnan(self.far)


_STABLE = {
    True: "is stable",
    False: "is NOT stable: the load pushes the body away",
    None: "is not decided to be stable",
}


def _answer(
    elastic: ElasticMechanism,
    start: Array,
    load: _Load,
    result: PostureStiffness,
    analysis: dict[str, Any],
    answer: Answer,
) -> _Said:
    """The answer: displacement, what contributes, stability, softest direction,
    what is better.
    """
    lines = [_under(elastic, load, result)]
    notes = {str(note): None for note in result.notes}
    ends: tuple[Array, Array | None] = (start, None)
    far, stable = (np.nan if load.added is not None else 0.0), None
    try:
        # The posture before the load, which is not left even where it is unstable.
        state = before = equilibrium(elastic, start, *load.terms(load.held), settle=False)
        if load.added is not None:
            settle = before.stable is not False
            state = equilibrium(elastic, start, *load.terms(load.whole), settle=settle)
    except CartstiffError as error:
        lines.append(f"No equilibrium was found: {error}")
    else:
        told = {note.code for note in result.notes}
        notes |= {str(note): None for note in state.notes if note.code not in told}
        lines += beyond_limits(state.notes)
        stable = state.stable
        if load.added is not None and stable is not False:
            ends = before.posture.q, state.posture.q
            way = displacement_between(before.pose, state.pose)
            far = float(np.linalg.norm(way[3:]))
            lines[0] = _moved(way, state.posture.length, load, elastic)
            lines += [
                *_linear(analysis, far, elastic.units),
                *(f"{share_words(shares)}." for shares in (answer.shares,) if shares),
            ]
            lines.append(_held(elastic, load, result))
        # Where nothing balances the posture, the equilibrium is at another one.
        where = " at which it comes to rest" * _is_unbalanced(result)
        lines.append(f"The equilibrium{where} {_STABLE[stable]}.")
    if answer.verdict.level != "good":
        lines.append(f"{VERDICTS[answer.verdict.code]}.")
    lines += [*_softest(answer), *_better(elastic, start, load)]
    return _Said(lines, list(notes), ends, far, stable)


def _moved(way: Array, length: float, load: _Load, elastic: ElasticMechanism) -> str:
    """How far the tip moves (6,) and turns, along the axes of F."""
    units = elastic.units
    turned, moved = np.split(way, 2)
    far, angle = (float(np.linalg.norm(part)) for part in (moved, turned))
    least = numerics.REPORTED_ERROR * np.abs(moved).max()
    # A turn that is rounding beside the way is none.
    angle *= angle * length > numerics.NEGLIGIBLE_DIFFERENCE * far
    size, unit = sized(far, units.length)
    along = [
        f"{x / size:+.4g}" if is_felt else "0"
        for x, is_felt in zip(moved, np.abs(moved) > least, strict=True)
    ]
    which = f", {_towards(moved, elastic)}" if far else ""
    return (
        f"The tip moves {engineering(far, units.length)} ({', '.join(along)} {unit} "
        "along x, y, z "
        f"of the room){which}, under {_acting_words(load, elastic)}, and turns "
        f"{engineering(angle, 'rad')}: from the equilibrium without the load to that "
        "with it."
    )


def _towards(vector: Array, elastic: ElasticMechanism) -> str:
    """A direction of the room in words; z is vertical unless gravity says otherwise."""
    gravity = elastic.gravity
    is_upright = gravity is None or not np.any(gravity[:2])
    x, y, z = (float(v) for v in vector)
    return direction_words((x, y, z), is_line=False, is_upright=is_upright)


def _acting_words(load: _Load, elastic: ElasticMechanism) -> str:
    """Force and moment of the load in words."""
    moment, force = np.split(load.in_room, 2)
    units = elastic.units
    parts = [
        f"a {kind} of {engineering(float(np.linalg.norm(size)), unit)}, "
        f"{_towards(size, elastic)}"
        for kind, size, unit in (
            ("force", force, units.force),
            ("moment", moment, units.moment),
        )
        if size.any()
    ]
    return " and ".join(parts) or "no load"


def _linear(analysis: dict[str, Any], far: float, units: Units) -> list[str]:
    """The displacement by the stiffness, where its four digits are not those of the
    equilibrium.
    """
    linear = resisted_deflection(analysis)
    if not linear:
        return []
    by_stiffness = float(np.linalg.norm(linear["displacement"]))
    shown = engineering(by_stiffness, units.length)
    if shown == engineering(far, units.length):
        return []
    return [
        f"Linear, by K^{linear['connection']} at the stated posture (the answer of "
        f"analyse), it is {shown}."
    ]


# Codes of notes that a report says at its head, and nowhere else.
_AT_THE_HEAD = ("stiffness-assumed", "held-by-lines", "open-loops")


def _doubt(elastic: ElasticMechanism) -> str:
    """Lines in amber: springs that are assumed, or illustrative by their file,
    and open loops.
    """
    lines = [
        f"{note.message[0].upper()}{note.message[1:]}."
        for note in elastic.notes
        if note.code in _AT_THE_HEAD[1:]
    ]
    assumed = [n.message for n in elastic.notes if n.code == _AT_THE_HEAD[0]]
    if assumed:
        lines.append(f"The springs are assumed: {assumed[0]}.")
    elif elastic.is_illustrative:
        lines.append("The springs are illustrative, not measured (see What is assumed).")
    return "".join(f'<p class="doubt">{_text(line)}</p>' for line in lines)


def _unsaid(elastic: ElasticMechanism, notes: Sequence[str]) -> list[str]:
    """Notes that are not said at the head."""
    said = {str(note) for note in elastic.notes if note.code in _AT_THE_HEAD}
    return [note for note in notes if note not in said]


def _is_unbalanced(result: PostureStiffness) -> bool:
    return any(note.code == "unbalanced" for note in result.notes)


def _under(elastic: ElasticMechanism, load: _Load, result: PostureStiffness) -> str:
    """The sentence that names the load, where the tip's displacement is not said."""
    acting = _acting_words(load, elastic)
    return f"The mechanism carries {acting}. {_held(elastic, load, result)}"


def _held(elastic: ElasticMechanism, load: _Load, result: PostureStiffness) -> str:
    """What holds the mechanism at the posture, and whether its weight acts."""
    springs = "legs" if len(elastic.mechanism.points) else "joints"
    held = f"It is held by the springs of its {springs}"
    if load.held is not None:
        held = "It is held by the wrench named below"
    if _is_unbalanced(result):
        held = "It is not held at this posture"
    return f"{held}{'; its weight acts' * (elastic.gravity is not None)}."


def _softest(answer: Answer) -> list[str]:
    """Direction of the least stiffness against a force.

    Nothing where a force is not resisted.
    """
    found = answer.extreme("softest")
    if found is None or found.stiffness is None:
        return []
    size = engineering(found.stiffness, answer.units.stiffness["translation"])
    return [f"Softest (free to turn): {size} {where(found, answer)}."]


def _better(elastic: ElasticMechanism, start: Array, load: _Load) -> list[str]:
    """A better posture with the tip where it is, or that there is none."""
    if load.added is None:
        return []
    try:
        found = better_posture(
            elastic,
            start,
            wrench=load.added,
            load_kind=load.kind.kind,
            load_at=load.kind.at,
            load_axes=load.axes,
        )
    except UndefinedError:
        return []
    return [" ".join(better_sentences(found, elastic)) if found else NONE_FOUND]


def _displacements(elastic: ElasticMechanism, Q: Array, load: _Load) -> Array:
    """Displacement of the tip (N,) at postures under the load, fixed in the room.

    NaN where the body does not resist it.
    """
    arrays = analyse_many(
        elastic,
        Q,
        wrench=load.in_room,
        load_kind=load.kind.kind,
        load_at=load.kind.at,
        load_axes="world",
        outputs=("wrench", "compliance_load"),
    ).arrays
    C = arrays["compliance_load"]
    moved = np.linalg.norm(np.einsum("nij,nj->ni", C, arrays["wrench"])[:, 3:], axis=1)
    known: NDArray[np.bool_] = np.asarray(np.isfinite(C).all(axis=(1, 2)))
    C = np.where(known[:, None, None], C, 0.0)
    values = np.linalg.eigvalsh((C + C.swapaxes(1, 2)) / 2)
    return np.where(
        known & (values[:, 0] >= -numerics.ROUNDOFF * values[:, -1]), moved, np.nan
    )


def _swept(
    elastic: ElasticMechanism, start: Array, load: _Load
) -> dict[str, tuple[Array, Array]]:
    """Displacement of the tip under the load, fixed in the room, over each coordinate."""
    mechanism = elastic.mechanism
    sweeps: dict[str, tuple[Array, Array]] = {}
    if mechanism.closures or load.added is None or load.held is not None:
        return sweeps
    posture, virtual = mechanism.at(start), links_of_coordinates(elastic)
    limits, length = limits_of(mechanism), posture.length
    limits = limits.leaving_out(
        limits.side(limits.values(posture.q, posture.pose), length)
    )
    for j, c in enumerate(mechanism.coordinates[:40]):
        if c.name in virtual:
            continue
        reach = _REACH * (length if c.is_length else 1.0)
        x = start[j] + reach * np.linspace(-1, 1, _COUNT)
        Q = np.tile(start, (_COUNT, 1))
        Q[:, j] = x
        moved = _displacements(elastic, Q, load)
        moved[(x < min(c.lower, start[j])) | (x > max(c.upper, start[j]))] = np.nan
        if limits.legs is not None:  # coordinates are within theirs, legs need not be
            poses = np.array([mechanism.at(q).pose for q in Q])
            moved[limits.exceeded(limits.values(Q, poses))] = np.nan
        sweeps[c.name] = x, moved
    return sweeps


def _picture(elastic: ElasticMechanism, result: PostureStiffness, load: _Load) -> str:
    given = load.added if load.held is None else None  # as `_Load.result`
    source = Source(
        elastic,
        result.q,
        load=None if given is None else np.array(given, float),
        load_kind=load.kind.kind,
        load_at=load.kind.at if any(load.kind.at) else None,
        load_axes=load.axes,
    )
    try:
        page = export_page(source)
    except CartstiffError as error:
        return f"<p>{_text(f'No picture: {error}')}</p>"
    return f'<iframe title="the mechanism" srcdoc="{escape(page, quote=True)}"></iframe>'


def _legs(result: PostureStiffness) -> str:
    """Lengths of legs, or positions of drives, beside their limits, and their forces."""
    units = result.units
    rows = []
    for leg in result.drives:
        unit = "deg" if not leg.is_length else units.length
        per = 1.0 if leg.is_length else float(np.degrees(1.0))
        lengths = (leg.position, leg.lower, leg.upper, leg.margin)
        force = _quantity(leg.force, units.effort(leg.is_length))
        rows.append([leg.name, *(_quantity(per * x, unit) for x in lengths), force])
    heads = ("leg", "length", "shortest", "longest", "to the limit")
    if result.leg_lengths is None:
        heads = ("drive", "position", "lower limit", "upper limit", "to the limit")
    return _table(rows, (*heads, "force (tension above zero)")) if rows else ""


def _near(result: PostureStiffness) -> str:
    """How far the posture is from each kind of singularity."""
    return "".join(
        f"<p>Distance to a singularity ({entry['kind']}): {entry['ratio']:.3g}, the "
        "smallest over "
        "the largest singular value, lengths in "
        f"{engineering(entry['length'], result.units.length)}.</p>"
        for entry in distance_to_singularity(result)
    )


def _quantity(value: float | None, unit: str) -> str:
    """A quantity with its unit; nothing for one that is unknown or infinite."""
    return engineering(value, unit) if value is not None and np.isfinite(value) else ""


def _joints(result: PostureStiffness, q: Array, analysis: dict[str, Any]) -> str:
    """Each coordinate and spring: position before the load, stiffness,
    share of the deflection.
    """
    elastic, units = result.elastic, result.elastic.units
    deflection = resisted_deflection(analysis)
    shares, links = shares_of_parts(deflection, elastic), links_of_coordinates(elastic)
    springs = dict(zip(elastic.spring_names, elastic.stiffnesses, strict=False))
    if elastic.springs is not None and elastic.springs.laws:
        hessian = elastic.springs.evaluate(result.posture).hessian
        springs |= {elastic.names[j]: hessian[j, j] for j in elastic.springs.laws}

    def spring(name: str, is_length: bool) -> str:
        k = springs.get(name)
        if k is None:
            return ""
        return (
            "rigid"
            if np.isinf(k)
            else engineering(k, units.spring(is_length))
            if k
            else "none"
        )

    rows, passive = [], 0
    for c, value in zip(elastic.mechanism.coordinates, q.tolist(), strict=True):
        if c.name in links:
            continue  # the link has one row
        place = (
            engineering(value, units.length)
            if c.is_length
            else f"{np.degrees(value):.2f} deg"
        )
        row = (c.name, place, spring(c.name, c.is_length), _percent(shares.get(c.name)))
        is_passive = result.posture.closure is not None and row[2:] in _PASSIVE
        passive += is_passive
        size, unit = (1.0, units.length) if c.is_length else (180 / np.pi, "deg")
        ends = [size * c.lower, size * c.upper]
        low, high = (engineering(end, unit) for end in ends)
        limits = f"{low} to {high}" if np.isfinite(ends).any() else ""
        rows += [] if is_passive else [(*row, limits)]
    bars = [n for n in dict.fromkeys([*springs, *shares]) if n not in elastic.names]
    rows += [
        (name, "", spring(name, True), _percent(shares.get(name)), "") for name in bars
    ]
    of = "energy" if deflection.get("kind") == "springs" else "displacement"
    left_out = f"<p>{passive} passive joints without a spring are not listed.</p>" * bool(
        passive
    )
    head = ("coordinate", "position", "stiffness", f"share of the {of}", "limits")
    shown = 5 if any(row[4] for row in rows) else 4
    return _table([row[:shown] for row in rows], head[:shown]) + left_out


# Stiffness and share in the row of a joint without a spring that does not contribute.
_PASSIVE = [(spring, share) for spring in ("", "none") for share in ("", "0 %")]


def _table(rows: Sequence[Sequence[str]], head: Sequence[str] = ()) -> str:
    """A table without columns that are empty."""
    kept = [j for j in range(len(rows[0])) if any(row[j] for row in rows)] if rows else []
    cells = "".join(f"<th>{_text(head[j])}</th>" for j in kept if head)
    lines = ["".join(f"<td>{_text(row[j])}</td>" for j in kept) for row in rows]
    return f"<table>{''.join(f'<tr>{line}</tr>' for line in (cells, *lines) if line)}</table>"  # noqa: E501


def _acting(elastic: ElasticMechanism, load: _Load) -> list[str]:
    """The lines about the load and the weight."""
    units, at = elastic.units, load.kind.at
    of = {"world": "F", "body": "M"}[load.axes]
    point = "the origin of M"
    if any(at):
        size, unit = sized(float(np.abs(at).max()), units.length)
        point = f"({_row(np.array(at) / size)}) {unit} in M"

    def said(wrench: Array) -> str:
        m, f = (
            _vector(x, u)
            for x, u in zip(np.split(wrench, 2), (units.moment, units.force), strict=True)
        )
        return (
            f"moment {m}, force {f} along the axes of {of}, at {point}; {load.kind.words}"
        )

    lines = ["Load: none" if load.added is None else f"Load: {said(load.added)}"]
    if load.held is not None:
        lines.append(
            f"At this posture, before any load, the springs are held by {said(load.held)}"
        )
        if load.added is not None:
            lines.append(
                "Stiffness and shares are those at this posture, before the load"
            )
    return [*lines, gravity_loads(elastic).text]


def _row(values: Array) -> str:
    return ", ".join(f"{x + 0.0:.{_DIGITS}g}" for x in values)


def _vector(values: Array, unit: str) -> str:
    """Components with four digits, in the unit in which people read the largest."""
    size, unit = sized(float(np.abs(values).max()), unit)
    least = numerics.PRINTED_AS_ZERO * np.abs(values).max()
    return f"({_row(np.where(np.abs(values) < least, 0.0, values) / size)}) {unit}"


def _matrix(result: PostureStiffness, load: _Load) -> str:
    """The stiffness, in task axes where the body has fewer than six freedoms;
    or the compliance.
    """
    units = result.units
    K = result.tangent if result.is_loaded else result.matrices["B"]
    name = "K, the tangent stiffness under the load" if result.is_loaded else "K"
    if load.held is not None:
        name = "K, the tangent stiffness under the wrench that holds this posture"
    if K is not None:
        return f"<p>{name}, along the axes of M.</p>{_block_table(K, _SIX, units.blocks)}"
    parts = []
    if (task := result.task_axes) is not None:
        name = f"{name}, along the motions that the body has, in axes of {task.axes}"
        parts.append(
            f"<p>{name}.</p>{_block_table(task.tangent, task.names, units.blocks)}"
        )
    C = result.tangent_compliance if result.is_loaded else result.compliances["B"]
    if C is not None:
        name = "The stiffness does not exist here; the compliance C, along the axes of M"
        parts.append(f"<p>{name}.</p>{_block_table(C, _SIX, units.blocks_of_compliance)}")
    return "".join(parts) or (
        "<p>Neither stiffness nor compliance exists here; see what is assumed.</p>"
    )


# Components of motions, and of the wrenches beside them.
_SIX = ("rx", "ry", "rz", "x", "y", "z")
# Digits of matrices.
_DIGITS = 4


def _block_table(matrix: Array, names: Sequence[str], blocks: Mapping[str, str]) -> str:
    """A matrix with four digits, each block in the unit in which people read its
    largest entry.
    """
    kinds = np.array(["t" if name in ("x", "y", "z") else "r" for name in names])
    small = numerics.PRINTED_AS_ZERO * np.abs(matrix).max()
    shown, units = np.where(np.abs(matrix) < small, 0.0, matrix), {}
    for row, column in product("rt", repeat=2):
        block = np.ix_(kinds == row, kinds == column)
        if matrix[block].size:
            size, units[row, column] = sized(
                float(np.abs(shown[block]).max()), blocks[row + column]
            )
            shown[block] /= size
    rows = [
        [
            name,
            *(f"{x + 0.0:.{_DIGITS}g}" for x in line),
            " | ".join(units[kind, c].removeprefix("1") or "1" for c in sorted({*kinds})),
        ]
        for name, kind, line in zip(names, kinds, shown, strict=True)
    ]
    of = " | ".join({"r": "turns", "t": "translations"}[c] for c in sorted({*kinds}))
    return _table(rows, ["", *names, f"units: columns of {of}"])


def _ticks(low: float, high: float, count: int = 5) -> Array:
    """Round numbers from low to high, about so many."""
    step = round_number((high - low) / count)
    steps = [k * step for k in (1.0, 2.0, 2.5, 5.0)]
    step = next((s for s in steps if (high - low) / s <= count), steps[-1])
    rounding = numerics.NEGLIGIBLE_DIFFERENCE
    ends = np.ceil(low / step - rounding), np.floor(high / step + rounding)
    return step * np.arange(ends[0], ends[1] + 1.0) + 0.0


def _plot(swept: dict[str, tuple[Array, Array]], elastic: ElasticMechanism) -> str:
    """The sweeps as curves over the change of the coordinate,
    angles and lengths apart.
    """
    mm = convert_length(elastic.units, Units("mm", SI.force))[0]
    lengths = {c.name: c.is_length for c in elastic.mechanism.coordinates}
    finite = np.concatenate([y[np.isfinite(y)] for _, y in swept.values()])
    largest = (mm * float(np.quantile(finite, 0.98)) if finite.size else 0.0) or 1.0
    rises = _ticks(0.0, 1.25 * largest, 4)
    top = float(rises[-1])
    plots = []
    for is_length in sorted({lengths[name] for name in swept}):
        own = {n: xy for n, xy in swept.items() if lengths[n] is is_length}
        per, unit = (mm, "mm") if is_length else (float(np.degrees(1.0)), "deg")
        reach = per * max(float(np.ptp(x)) for x, _ in own.values()) / 2.0
        plots.append(_curves(own, per, unit, reach, mm, rises, top))
    return "".join(plots)


def _curves(
    swept: dict[str, tuple[Array, Array]],
    per: float,
    unit: str,
    reach: float,
    mm: float,
    rises: Array,
    top: float,
) -> str:
    """Curves (mm) over the change of coordinates,
    which is at most `reach` in its unit.
    """
    lines = [
        f'<path d="M50 {220 - 200 * x / top:.1f}h380" stroke="#ddd"/>'
        f'<text x="45" y="{224 - 200 * x / top:.1f}" text-anchor="end">{x:.4g}</text>'
        for x in rises
    ]
    lines += [
        f'<path d="M{240 + 190 * x / reach:.1f} 220v4" stroke="#888"/>'
        f'<text x="{240 + 190 * x / reach:.1f}" y="236" '
        f'text-anchor="middle">{x + 0.0:.4g}</text>'
        for x in _ticks(-reach, reach)
    ]
    for i, (name, (x, y)) in enumerate(swept.items()):
        known, middle = np.isfinite(y), 0.5 * (x[0] + x[-1])
        drawn = "".join(
            f"{'L' if k and known[k - 1] else 'M'}{240 + 190 * per * (x[k] - middle) / reach:.1f},"  # noqa: E501
            f"{max(220 - 200 * mm * y[k] / top, 10):.1f}"
            for k in np.flatnonzero(known)
        )
        colour = _COLOURS[i % len(_COLOURS)]
        lines.append(
            f'<path d="{drawn}" fill="none" stroke="{colour}" stroke-width="2"/>'
        )
        if i < _NAMED_CURVES:
            lines.append(
                f'<text x="440" y="{20 + 15 * i}" fill="{colour}">{_text(name)}</text>'
            )
    lines.append(
        f'<text x="240" y="252" text-anchor="middle">change of the coordinate [{unit}], '
        "within "
        'the limits</text><text x="50" y="8">displacement of the tip [mm]</text>'
    )
    return (
        '<svg viewBox="0 0 620 258" width="620" height="258" font-size="11" '
        f'font-family="sans-serif" role="img">{"".join(lines)}</svg>'
    )


def _percent(share: float | None) -> str:
    return "" if share is None else f"{round(100 * share) + 0} %"


def _items(lines: Sequence[str]) -> str:
    return "".join(f"<li>{_text(line)}</li>" for line in lines)


def _text(text: str) -> str:
    return escape(printable(text))
