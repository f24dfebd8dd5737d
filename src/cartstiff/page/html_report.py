"""The report of one posture as one HTML file: the answer first, then picture and numbers."""

from __future__ import annotations

import datetime
import platform
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from importlib.metadata import version
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cartstiff import numerics
from cartstiff.analysis.posture import analyse_posture
from cartstiff.answer.posture import verdict_at
from cartstiff.arrays import checked_vector
from cartstiff.batch.postures import analyse_many
from cartstiff.errors import CartstiffError, UndefinedError, printable
from cartstiff.geometry.se3 import Array
from cartstiff.mechanisms.elastic import ElasticMechanism
from cartstiff.mechanisms.gravity_loads import gravity_loads
from cartstiff.mechanisms.limits import beyond_limits, limits_of
from cartstiff.page.export import export_page
from cartstiff.page.shown import distance_to_singularity, legs, softest_in_room
from cartstiff.page.source import Source
from cartstiff.potentials.loads import Load
from cartstiff.report.analysis import (
    largest_share,
    links_of_coordinates,
    resisted_deflection,
    shares_of_parts,
    softest_words,
)
from cartstiff.report.better import NONE_FOUND, better_sentences
from cartstiff.report.layout import placed
from cartstiff.report.sentences import VERDICTS
from cartstiff.scene.scales import round_number
from cartstiff.statics.equilibrium import equilibrium
from cartstiff.statics.held import displacement_between
from cartstiff.stiffness.applied_load import LoadKind
from cartstiff.stiffness.compute import analyse
from cartstiff.stiffness.posture import PostureStiffness
from cartstiff.toolpaths.better import better_posture
from cartstiff.units import SI, Units, convert_length, engineering, sized
from cartstiff.version import __version__

# Values along the sweep of a coordinate, and how far it goes: rad, or characteristic lengths.
_COUNT, _REACH = 21, 0.5
# Shortest arrow of the drawing, in its units.
_SHORTEST_ARROW = 8.0
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
) -> str:
    """The report as HTML text that needs nothing else.

    Parameters
    ----------
    elastic : ElasticMechanism
        The mechanism, with its springs; what carries gravity at the posture is chosen as in
        `cartstiff.analyse`.
    q : array_like (n,) or mapping, optional
        The posture without the load; default the mechanism's.
    wrench, load_kind, load_at, load_axes
        The load, as in `cartstiff.analyse`.
    command : str
        The command that made the report, which it quotes.
    sections : sequence of (title, HTML)
        Further sections, after the sweep.

    Raises
    ------
    CartstiffError
        As `cartstiff.analyse`.
    """
    kind = LoadKind(load_kind, tuple(load_at))  # type: ignore[arg-type]
    elastic, posture = elastic.placed(q)
    start = posture.q
    with np.errstate(all="ignore"):
        load = _Load.of(elastic, start, wrench, kind, load_axes)
        result = load.result(elastic, start)
        analysis = load.analysis(result)
        swept = _swept(elastic, start, load)
        lines, notes, moved = _answer(elastic, start, load, result, analysis)
        picture = _picture(elastic, result, load)
        legs_shown = _legs(result)
    title = f"{elastic.name}: stiffness at {elastic.mechanism.frame}"
    before = "" if load.held is None or load.added is None else ", before the load"
    where = placed(elastic.mechanism.frame_offset, elastic.units)
    sits = f" M is {where} in {elastic.mechanism.frame}." if where else ""
    parts = [
        f"<h1>{_text(title)}</h1>",
        f'<p class="quiet">Lengths in {elastic.units.length}, forces in {elastic.units.force} '
        f"unless said otherwise; M is the tool's frame, F the room.{_text(sits)}</p>",
        f'<div class="answer">{_doubt(elastic)}<ul>{_items(lines)}</ul></div>',
        f'<section class="screen"><h2>In three dimensions{before}</h2>{picture}</section>',
        f"<section><h2>Posture</h2><figure>{_skeleton(elastic, start, load, moved)}</figure>"
        f"{_joints(result, start, analysis)}{_near(result)}</section>",
        *([f"<section><h2>Legs</h2>{legs_shown}</section>"] if legs_shown else []),
        f"<section><h2>Load and weight</h2><ul>{_items(_acting(elastic, load))}</ul></section>",
        f"<section><h2>Stiffness</h2>{_matrix(result, load)}</section>",
    ]
    if swept:
        parts.append(
            "<section><h2>One joint at a time</h2><p>Displacement of the tip under the same load "
            f"in the room, while one coordinate moves from here.</p><figure>{_plot(swept, elastic)}"
            "</figure></section>"
        )
    parts += [
        f"<section><h2>{_text(head)}</h2>{body}</section>" for head, body in sections
    ]
    if elastic.source:
        notes.insert(0, f"The file says of its numbers: {elastic.source}")
    about = [
        datetime.date.today().isoformat(),
        f"cartstiff {__version__}",
        f"Pinocchio {version('pin')}",
        f"NumPy {np.__version__}",
        f"Python {platform.python_version()}",
    ]
    parts += [
        f"<section><h2>What is assumed</h2><ul>{_items(notes or ['nothing'])}</ul></section>",
        f'<section><h2>Made by</h2><p class="quiet"><code>{_text(command)}</code><br>'
        f"{', '.join(about)}</p></section>",
    ]
    return (
        '<!doctype html><html lang="en"><meta charset="utf-8"><meta name="viewport" '
        f'content="width=device-width"><title>{_text(title)}</title><style>\n{_STYLE.read_text("utf-8")}</style>\n'
        + "\n".join(parts)
        + "</html>\n"
    )


@dataclass(frozen=True, eq=False)
class _Load:
    """The load on the body, and the wrench that holds the posture without it.

    Attributes
    ----------
    added : ndarray (6,) or None
        The load of the report, as it was given.
    held : ndarray (6,) or None
        The wrench that holds the mechanism at the posture before the load, at the same point and
        along the same axes; None if its springs hold it there.
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
        """The load at a posture, with what holds the mechanism there by the springs' rest."""
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
        """The posture as `analyse` answers it: with the load where its springs can take it over.

        Rest positions that the file gives are kept: then it is the posture before the load.
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

    def analysis(self, result: PostureStiffness) -> dict[str, Any]:
        """Analysis of a posture under all that acts; its deflection is that of the load alone."""
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


def _answer(
    elastic: ElasticMechanism,
    start: Array,
    load: _Load,
    result: PostureStiffness,
    analysis: dict[str, Any],
) -> tuple[list[str], list[str], Array | None]:
    """The sentences of the answer, everything that was assumed, and how the tip moves in F."""
    lines, shift = [_under(elastic, load, result)], None
    notes = {str(note): None for note in result.notes}
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
        if load.added is not None and state.stable is not False:
            turned, moved = np.split(displacement_between(before.pose, state.pose), 2)
            shift = moved
            far, angle = (float(np.linalg.norm(way)) for way in (moved, turned))
            least = numerics.REPORTED_ERROR * np.abs(moved).max()
            # A turn that is rounding beside the way is none.
            if angle * state.posture.length <= numerics.NEGLIGIBLE_DIFFERENCE * far:
                angle = 0.0
            size, unit = sized(far, elastic.units.length)
            along = ", ".join(
                f"{x / size:+.4g}" if abs(x) > least else "0" for x in moved
            )
            lines.append(
                f"The tip moves {engineering(far, elastic.units.length)} ({along} {unit} along the "
                f"axes of F) and turns {engineering(angle, 'rad')} from the equilibrium without "
                "the load to that with it."
            )
            linear = resisted_deflection(analysis)
            by_stiffness = np.linalg.norm(linear.get("displacement", moved))
            shown = engineering(float(by_stiffness), elastic.units.length)
            if shown != engineering(far, elastic.units.length):
                lines.append(
                    f"Linear, by K^{linear['connection']} at the stated posture (the answer of "
                    f"analyse), it is {shown}."
                )
            lines += _largest_share(elastic, analysis)
        # Where nothing balances the posture, the equilibrium is at another one.
        where = " at which it comes to rest" if _is_unbalanced(result) else ""
        lines.append(
            {
                True: f"The equilibrium{where} is stable.",
                False: f"The equilibrium{where} is NOT stable: the load pushes the body away.",
                None: f"Whether the equilibrium{where} is stable is not decided.",
            }[state.stable]
        )
    state_of = verdict_at(result, "load", analysis["definiteness"])
    if state_of.level != "good":
        lines.append(f"{VERDICTS[state_of.code]}.")
    lines += _softest(result)
    return [*lines, *_better(elastic, start, load)], list(notes), shift


def _doubt(elastic: ElasticMechanism) -> str:
    """Lines in amber: springs that are assumed, or illustrative by their file, and open loops."""
    assumed = [note.message for note in elastic.notes if note.code == "stiffness-assumed"]
    others = [
        n.message for n in elastic.notes if n.code in ("held-by-lines", "open-loops")
    ]
    lines = [f"{message[0].upper()}{message[1:]}." for message in others]
    if assumed:
        lines.append(f"The springs are assumed: {assumed[0]}.")
    elif elastic.is_illustrative:
        lines.append("The springs are illustrative, not measured (see What is assumed).")
    return "".join(f'<p class="doubt">{_text(line)}</p>' for line in lines)


def _is_unbalanced(result: PostureStiffness) -> bool:
    return any(note.code == "unbalanced" for note in result.notes)


def _under(elastic: ElasticMechanism, load: _Load, result: PostureStiffness) -> str:
    """The sentence that names load, weight, and the springs that carry them, if any can."""
    units, of = elastic.units, "F" if load.axes == "world" else "M"
    parts = []
    for size, unit, kind in zip(
        () if load.added is None else (load.added[3:], load.added[:3]),
        (units.force, units.moment),
        ("force", "moment"),
        strict=False,
    ):
        if size.any():
            along = ", ".join(f"{x:.3g}" for x in size / np.linalg.norm(size) + 0.0)
            much = engineering(float(np.linalg.norm(size)), unit)
            parts.append(f"a {kind} of {much} along ({along}) of {of}")
    acting = " and ".join(parts) or "no load"
    springs = "legs" if len(elastic.mechanism.points) else "joints"
    holds = (
        f"the springs of its {springs}" if load.held is None else "the wrench named below"
    )
    weight = "" if elastic.gravity is None else " and the weight"
    held = (
        "It is not held at this posture"
        if _is_unbalanced(result)
        else f"It is held by {holds}"
    )
    return f"The mechanism carries {acting}{weight}. {held}."


def _largest_share(elastic: ElasticMechanism, analysis: dict[str, Any]) -> list[str]:
    """Which joint, link or leg contributes most to the deflection under the load."""
    return [
        f"{words}." for words in largest_share(resisted_deflection(analysis), elastic)
    ]


def _softest(result: PostureStiffness) -> list[str]:
    """Direction of the least stiffness against a force; nothing where a force is not resisted."""
    if (found := softest_in_room(result.at())) is None:
        return []
    known = found["stiffness"], found["direction"]
    return [f"Softest {softest_words(*known, 'translation', result.units, 'the room')}."]


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


def _skeleton(
    elastic: ElasticMechanism, q: Array, load: _Load, moved: Array | None
) -> str:
    """Lines from joint to joint to the tip, or along the legs, from the side and from above.

    With the force on the tip, the tip's displacement, enlarged, and a scale bar.
    """
    posture = elastic.mechanism.at(q)
    lines = posture.drawn().paths
    every = np.vstack(lines)
    low, size = (
        every.min(axis=0),
        max(float(np.ptp(every, axis=0).max()), numerics.ROUNDOFF),
    )
    drawn, tip = [], posture.pose[:3, 3]
    arrows = _arrows(load, moved, size)
    flat = [(line - low) / size * 210 for line in lines]
    at = (tip - low) / size * 210
    for number, (title, across, up) in enumerate(
        (("from the side", 0, 2), ("from above", 0, 1))
    ):
        left = 20 + 320 * number
        drawn.append(f'<g transform="translate({left} 235) scale(1 -1)">')
        for line in flat:
            pairs = " ".join(f"{p[across]:.1f},{p[up]:.1f}" for p in line)
            drawn.append(
                f'<polyline points="{pairs}" fill="none" stroke="#666" stroke-width="4" '
                'stroke-linejoin="round"/>'
            )
            drawn += [
                f'<circle cx="{p[across]:.1f}" cy="{p[up]:.1f}" r="4" fill="#2060c0"/>'
                for p in line
            ]
        for vector, colour, width, _ in arrows:
            end = at + vector / size * 210
            if np.linalg.norm((end - at)[[across, up]]) < _SHORTEST_ARROW:
                continue  # towards the reader
            drawn.append(
                f'<line x1="{at[across]:.1f}" y1="{at[up]:.1f}" x2="{end[across]:.1f}" '
                f'y2="{end[up]:.1f}" stroke="{colour}" stroke-width="{width}" '
                'marker-end="url(#head)"/>'
            )
        drawn.append(
            f'<circle cx="{at[across]:.1f}" cy="{at[up]:.1f}" r="6" fill="#c04020"/></g>'
            f'<text x="{left}" y="295">{title}: {"xyz"[across]} to the right, {"xyz"[up]} up; '
            "M in red</text>"
        )
    bar = round_number(size / 3.0)
    width, words = 210 * bar / size, [f"{bar:g} {elastic.units.length}"]
    drawn.append(f'<path d="M20 304v6h{width:.1f}v-6" fill="none" stroke="#222"/>')
    words += [said for *_, said in arrows]
    drawn.append(f'<text x="{30 + width:.1f}" y="312">{_text("; ".join(words))}</text>')
    return (
        '<svg viewBox="-20 -20 680 340" width="680" height="340" font-size="11" '
        'font-family="sans-serif" role="img"><defs><marker id="head" viewBox="0 0 8 8" refX="6" '
        'refY="4" markerWidth="16" markerHeight="16" markerUnits="userSpaceOnUse" orient="auto">'
        '<path d="M0 0L8 4L0 8z" '
        f'fill="context-stroke"/></marker></defs>{"".join(drawn)}</svg>'
    )


def _arrows(
    load: _Load, moved: Array | None, size: float
) -> list[tuple[Array, str, float, str]]:
    """Force on the tip and its displacement as drawn in F, with colour, width and words.

    Where they are parallel the second is seen inside the first.
    """
    arrows = []
    force = load.in_room[3:]
    if force.any():
        along = 0.15 * size * force / np.linalg.norm(force)
        arrows.append((along, "#222", 7.0, "force in black, thick"))
    if moved is not None and moved.any():
        factor = round_number(0.2 * size / float(np.linalg.norm(moved)))
        words = f"displacement of the tip in green, thin, drawn {factor:g} times as long"
        arrows.append((factor * moved, "#1f9d55", 2.5, words))
    return arrows


def _legs(result: PostureStiffness) -> str:
    """Lengths and forces of a platform's legs beside their limits."""
    shown, units = legs(result), result.units
    if shown is None:
        return ""
    keys = {"length": units.length, "lower": units.length, "upper": units.length}
    known = {
        key: unit
        for key, unit in (keys | {"tension": units.force}).items()
        if any(leg[key] is not None for leg in shown)
    }
    rows = [
        [f"leg{i}", *(_quantity(leg[key], unit) for key, unit in known.items())]
        for i, leg in enumerate(shown, 1)
    ]
    heads = {
        "lower": "shortest",
        "upper": "longest",
        "tension": "force (tension above zero)",
    }
    return _table(rows, ["leg", *(heads.get(key, key) for key in known)])


def _near(result: PostureStiffness) -> str:
    """How far the posture is from each kind of singularity."""
    return "".join(
        f"<p>Distance to a singularity ({entry['kind']}): {entry['ratio']:.3g}, the smallest over "
        "the largest singular value, lengths in "
        f"{engineering(entry['length'], result.units.length)}.</p>"
        for entry in distance_to_singularity(result)
    )


def _quantity(value: float | None, unit: str) -> str:
    return "" if value is None else engineering(value, unit)


def _joints(result: PostureStiffness, q: Array, analysis: dict[str, Any]) -> str:
    """Each coordinate and spring: position before the load, stiffness, share of the deflection."""
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
    cells = ["<tr>" + "".join(f"<th>{t}</th>" for t in head) + "</tr>"] if head else []
    cells += [
        "<tr>" + "".join(f"<td>{_text(t)}</td>" for t in row) + "</tr>" for row in rows
    ]
    return f"<table>{''.join(cells)}</table>"


def _acting(elastic: ElasticMechanism, load: _Load) -> list[str]:
    """The lines about the load and the weight."""
    units, at = elastic.units, ", ".join(f"{x:g}" for x in load.kind.at)
    of = "F" if load.axes == "world" else "M"

    def said(wrench: Array) -> str:
        m, f = (", ".join(f"{x:.6g}" for x in part) for part in np.split(wrench + 0.0, 2))
        return (
            f"moment ({m}) {units.moment}, force ({f}) {units.force} along the axes of {of}, at "
            f"({at}) {units.length} in M; {load.kind.words}"
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


def _matrix(result: PostureStiffness, load: _Load) -> str:
    units = result.units
    f, x, m = units.force, units.length, units.moment
    K = result.tangent if result.is_loaded else result.matrices["B"]
    name = "K, the tangent stiffness under the load" if result.is_loaded else "K"
    if load.held is not None:
        name = "K, the tangent stiffness under the wrench that holds this posture"
    order = "rows are moments, then forces, columns rotations, then translations."
    pair = (f"{m}/rad | {f}", f"{f}/rad | {f}/{x}")
    if K is None:
        K = result.tangent_compliance if result.is_loaded else result.compliances["B"]
        name = "The stiffness does not exist here; the compliance C"
        order = "rows are rotations, then translations, columns moments, then forces."
        pair = (f"rad/({m}) | rad/{f}", f"1/{f} | {x}/{f}")
    if K is None:
        return "<p>Neither stiffness nor compliance exists here; see what is assumed.</p>"
    small = numerics.PRINTED_AS_ZERO * np.abs(K).max()
    rows = [
        [*(f"{0.0 if abs(x) < small else x:.6g}" for x in row), pair[i // 3]]
        for i, row in enumerate(K)
    ]
    return f"<p>{name}, in M; {order}</p>{_table(rows)}"


def _plot(swept: dict[str, tuple[Array, Array]], elastic: ElasticMechanism) -> str:
    """The sweeps as curves over the change of the coordinate."""
    mm = convert_length(elastic.units, Units("mm", SI.force))[0]
    finite = np.concatenate([y[np.isfinite(y)] for _, y in swept.values()])
    largest = (mm * float(np.quantile(finite, 0.98)) if finite.size else 0.0) or 1.0
    # Four round steps reach above the curves.
    first = round_number(largest / 4.0)
    top = 4.0 * next(
        first * x for x in (1.0, 2.0, 2.5, 5.0) if 4.0 * first * x >= largest
    )
    lines = []
    for tick in range(5):
        at = 220 - 50 * tick
        lines.append(
            f'<line x1="50" x2="430" y1="{at}" y2="{at}" stroke="#ddd"/><text x="45" y="{at + 4}" '
            f'text-anchor="end">{top * tick / 4:.3g}</text>'
        )
    for i, (name, (_, y)) in enumerate(swept.items()):
        known = np.isfinite(y)
        drawn = "".join(
            f"{'L' if k and known[k - 1] else 'M'}{50 + 380 * k / (_COUNT - 1):.1f},"
            f"{max(220 - 200 * mm * y[k] / top, 10):.1f}"
            for k in np.flatnonzero(known)
        )
        colour = _COLOURS[i % len(_COLOURS)]
        lines.append(
            f'<path d="{drawn}" fill="none" stroke="{colour}" stroke-width="2"/>'
        )
        if i < 14:
            lines.append(
                f'<text x="440" y="{20 + 15 * i}" fill="{colour}">{_text(name)}</text>'
            )
    lengths = {c.is_length for c in elastic.mechanism.coordinates if c.name in swept}
    reaches = {
        False: f"±{np.degrees(_REACH):.0f} deg",
        True: f"±{_REACH:g} characteristic lengths",
    }
    shown = " or ".join(reaches[is_length] for is_length in sorted(lengths))
    lines.append(
        f'<text x="240" y="240" text-anchor="middle">{shown}, within the limits</text>'
    )
    lines.append('<text x="50" y="8">mm</text>')
    return (
        '<svg viewBox="0 0 620 250" width="620" height="250" font-size="11" '
        f'font-family="sans-serif" role="img">{"".join(lines)}</svg>'
    )


def _percent(share: float | None) -> str:
    return "" if share is None else f"{round(100 * share) + 0} %"


def _items(lines: Sequence[str]) -> str:
    return "".join(f"<li>{_text(line)}</li>" for line in lines)


def _text(text: str) -> str:
    return escape(printable(text))
