"""The report of one posture as one HTML file: the answer first, then picture and numbers."""

from __future__ import annotations

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
from cartstiff.arrays import checked_vector
from cartstiff.batch.postures import analyse_many
from cartstiff.errors import CartstiffError, printable
from cartstiff.geometry.se3 import Array
from cartstiff.mechanisms.chain import Chain
from cartstiff.mechanisms.contract import SI, Units, convert_length
from cartstiff.mechanisms.elastic import ElasticMechanism, gravity_loads
from cartstiff.mechanisms.limits import beyond_limits, limits_of
from cartstiff.mechanisms.platform import Platform
from cartstiff.mechanisms.tree import FixedFrame
from cartstiff.page.export import export_page
from cartstiff.page.shown import verdict
from cartstiff.page.source import Source
from cartstiff.potentials.beams import Beam
from cartstiff.potentials.loads import Load
from cartstiff.potentials.springs import CoupledSprings
from cartstiff.report.layout import placed
from cartstiff.statics.equilibrium import equilibrium
from cartstiff.statics.held import displacement_between
from cartstiff.stiffness.applied_load import LoadKind
from cartstiff.stiffness.compute import analyse
from cartstiff.stiffness.posture import PostureStiffness
from cartstiff.version import __version__

# Values along the sweep of a coordinate, and how far it goes: rad, or characteristic lengths.
_COUNT, _REACH = 21, 0.5
_COLOURS = ("#2060c0", "#c04020", "#208040", "#8040a0", "#b08000", "#008090", "#c0307a", "#606060")
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
        What the report names as the command that made it.
    sections : sequence of (title, HTML)
        What else it shows, after the sweep.

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
        lines, notes = _answer(elastic, start, load, result, analysis, swept)
        picture = _picture(elastic, result, load)
    title = f"{elastic.name}: stiffness at {elastic.mechanism.frame}"
    where = placed(elastic.mechanism.frame_offset, elastic.units.length)
    sits = f" M is {where} in {elastic.mechanism.frame}." if where else ""
    parts = [
        f"<h1>{_text(title)}</h1>",
        f'<p class="quiet">Lengths in {elastic.units.length}, forces in {elastic.units.force} '
        f"unless said otherwise; M is the tool's frame, F the room.{_text(sits)}</p>",
        f'<div class="answer"><ul>{_items(lines)}</ul></div>',
        f'<section class="screen"><h2>In three dimensions</h2>{picture}</section>',
        f"<section><h2>Posture</h2><figure>{_skeleton(elastic, start)}</figure>"
        f"{_joints(result, start, analysis)}</section>",
        f"<section><h2>Load and weight</h2><ul>{_items(_acting(elastic, load))}</ul></section>",
        f"<section><h2>Stiffness</h2>{_matrix(result, load)}</section>",
    ]
    if swept:
        parts.append(
            "<section><h2>One joint at a time</h2><p>Displacement of the tip under the same load "
            f"in the room, while one coordinate moves from here.</p><figure>{_plot(swept, elastic)}"
            "</figure></section>"
        )
    parts += [f"<section><h2>{_text(head)}</h2>{body}</section>" for head, body in sections]
    if elastic.source:
        notes.insert(0, f"The file says of its numbers: {elastic.source}")
    about = [
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
    """What acts on the body: a load, and the wrench that holds the posture without it.

    Attributes
    ----------
    added : ndarray (6,) or None
        The load of the report, as it was given.
    held : ndarray (6,) or None
        What holds the mechanism at the posture before the load, at the same point and along the
        same axes; None where its springs hold it there.
    kind : LoadKind
        What both do while the body moves, and where they act.
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
            held = np.kron(np.eye(2), alone.pose[:3, :3]) @ held
        return cls(added, held, kind, axes, alone.pose)

    @property
    def whole(self) -> Array | None:
        """Load and holding wrench together; None if nothing acts."""
        if self.added is None:
            return self.held
        return self.added if self.held is None else self.added + self.held

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
            added = np.kron(np.eye(2), self.pose[:3, :3].T) @ added
        return analyse_posture(result, wrench=added, wrench_at=self.kind.at)


def _answer(
    elastic: ElasticMechanism,
    start: Array,
    load: _Load,
    result: PostureStiffness,
    analysis: dict[str, Any],
    swept: dict[str, tuple[Array, Array]],
) -> tuple[list[str], list[str]]:
    """The sentences of the answer, and everything that was assumed."""
    lines: list[str] = []
    notes = {str(note): None for note in result.notes}
    mm = convert_length(elastic.units, Units("mm", SI.force))[0]
    try:
        # The posture before the load, which is not left even where it is unstable.
        state = before = equilibrium(elastic, *load.terms(load.held), q0=start, settle=False)
        if load.added is not None:
            settle = before.stable is not False
            state = equilibrium(elastic, *load.terms(load.whole), q0=start, settle=settle)
    except CartstiffError as error:
        lines.append(f"No equilibrium was found: {error}")
    else:
        notes |= {str(note): None for note in state.notes}
        lines += beyond_limits(state.notes)
        if load.added is not None and state.stable is not False:
            turned, moved = np.split(displacement_between(before.pose, state.pose), 2)
            along = ", ".join(f"{mm * x:+.3g}" for x in moved)
            lines.append(
                f"The tip moves {mm * np.linalg.norm(moved):.3g} mm ({along} mm along the axes of "
                f"F) and turns {np.degrees(np.linalg.norm(turned)):.3g} deg under the load."
            )
            lines += _largest_share(elastic, analysis)
        lines.append(
            {
                True: "The equilibrium is stable.",
                False: "The equilibrium is NOT stable: the load pushes the body away.",
                None: "Whether the equilibrium is stable is not decided.",
            }[state.stable]
        )
    K = result.tangent if result.is_loaded else result.matrices["B"]
    state_of = verdict(result, "load", K, analysis["definiteness"])
    if state_of["level"] != "good":
        lines.append(f"{state_of['title']}.")
    lines += _softest(result, analysis)
    return [*lines, *_better(elastic, swept)], list(notes)


def _links(elastic: ElasticMechanism) -> dict[str, str]:
    """Compliant link of each virtual joint, by its name."""
    return {
        elastic.names[j]: potential.link
        for potential in elastic.potentials
        if isinstance(potential, (Beam, CoupledSprings)) and potential.link
        for j in np.ravel(potential.indices)
    }


def _deflection(analysis: dict[str, Any]) -> dict[str, Any]:
    """The deflection under the load, if the body resists it; else nothing."""
    found: dict[str, Any] = analysis.get("deflection") or {}
    return found if found and found["energy"] > 0.0 else {}


def _largest_share(elastic: ElasticMechanism, analysis: dict[str, Any]) -> list[str]:
    """Which joint, link or leg contributes most to the deflection under the load."""
    deflection, of_links = _deflection(analysis), _links(elastic)
    summed: dict[str, float] = {}
    for part in deflection.get("shares") or []:
        name = f"the link {of_links[own]}" if (own := part["name"]) in of_links else own
        summed[name] = summed.get(name, 0.0) + (part["share"] or 0.0)
    if not summed:
        return []
    name = max(summed, key=lambda name: abs(summed[name]))
    of = "this" if deflection["kind"] == "joints" else "the energy that this takes"
    return [f"{100 * summed[name]:.0f} % of {of} comes from {name}."]


def _softest(result: PostureStiffness, analysis: dict[str, Any]) -> list[str]:
    """Direction of the least stiffness against a force; nothing where a force is not resisted."""
    free = analysis["ellipsoids"]["compliance"]["translation"]["free"]
    if free is None or free["definiteness"] not in ("positive", "positive semidefinite"):
        return []
    direction = result.pose[:3, :3] @ np.array(free["axes"], float)[:, 2]
    direction *= np.sign(direction[np.argmax(np.abs(direction))])
    along = ", ".join(f"{x:.2f}" for x in direction + 0.0)
    units, softest = result.elastic.units, free["eigenvalues"][2]
    if not softest > 0.0:
        return []
    soft = units.newtons / convert_length(units, Units("mm", SI.force))[0] / softest
    return [f"Softest direction: ({along}) in F, {soft:.4g} N/mm with the body free to turn."]


def _better(elastic: ElasticMechanism, swept: dict[str, tuple[Array, Array]]) -> list[str]:
    """The best posture among those that differ in one coordinate."""
    better = [
        (float(y[i]), name, float(x[i]))
        for name, (x, y) in swept.items()
        for i in np.flatnonzero(np.isfinite(y))
    ]
    if not better:
        return []
    least, name, at = min(better)
    here = float(next(iter(swept.values()))[1][_COUNT // 2])
    if not least < 0.99 * here:
        return ["No single coordinate, moved from here, makes it better by 1 %."]
    where = elastic.mechanism.coordinates[elastic.names.index(name)]
    length = f"{at:.4g} {elastic.units.length}"
    place = length if where.is_length else f"{np.degrees(at):.1f} deg"
    kind = "joint" if isinstance(elastic.mechanism, Chain) else "coordinate"
    return [
        f"Better posture (one {kind} changed): {name} at {place} instead, "
        f"{100 * (1 - least / here):.0f} % less displacement (the tip is then at another place)."
    ]


def _swept(elastic: ElasticMechanism, start: Array, load: _Load) -> dict[str, tuple[Array, Array]]:
    """Displacement of the tip under the load, fixed in the room, over each coordinate."""
    mechanism, R = elastic.mechanism, np.kron(np.eye(2), load.pose[:3, :3])
    sweeps: dict[str, tuple[Array, Array]] = {}
    if getattr(mechanism, "closures", None) or load.added is None or load.held is not None:
        return sweeps
    added = load.added if load.axes == "world" else R @ load.added
    posture, virtual = mechanism.at(start), _links(elastic)
    limits, length = limits_of(mechanism), posture.length
    limits = limits.leaving_out(limits.side(limits.values(posture.q, posture.pose), length))
    for j, c in enumerate(mechanism.coordinates[:40]):
        if c.name in virtual:
            continue
        reach = _REACH * (length if c.is_length else 1.0)
        x = start[j] + reach * np.linspace(-1, 1, _COUNT)
        x = np.clip(x, min(c.lower, start[j]), max(c.upper, start[j]))
        x[_COUNT // 2] = start[j]
        Q = np.tile(start, (_COUNT, 1))
        Q[:, j] = x
        arrays = analyse_many(
            elastic,
            Q,
            wrench=added,
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
        held = known & (values[:, 0] >= -numerics.ROUNDING * values[:, -1])
        if limits.legs is not None:  # coordinates are within theirs, legs need not be
            poses = np.array([mechanism.at(q).pose for q in Q])
            held &= ~limits.exceeded(limits.values(Q, poses))
        sweeps[c.name] = x, np.where(held, moved, np.nan)
    return sweeps


def _picture(elastic: ElasticMechanism, result: PostureStiffness, load: _Load) -> str:
    given = load.added if load.held is None else None  # as `_Load.result`
    source = Source(
        elastic,
        result.q,
        load=None if given is None else np.array(given, float),
        load_kind=load.kind.kind,
        load_at=load.kind.at if any(load.kind.at) else None,
        load_axes="inertial" if load.axes == "world" else "body",
    )
    try:
        page = export_page(source)
    except CartstiffError as error:
        return f"<p>{_text(f'No picture: {error}')}</p>"
    return f'<iframe title="the mechanism" srcdoc="{escape(page, quote=True)}"></iframe>'


def _skeleton(elastic: ElasticMechanism, q: Array) -> str:
    """Lines from joint to joint to the tip, or along the legs, from the side and from above."""
    mechanism = elastic.mechanism
    posture = mechanism.at(q)
    lines: list[Array] = []
    if isinstance(mechanism, Chain):
        state, tree = mechanism.tree.at(q), mechanism.tree
        ends = [mechanism.body]
        ends += [tree.placement(f) for c in mechanism.closures for f in (c.frame_a, c.frame_b)]
        for end in ends:
            way = [FixedFrame(int(j), np.eye(4)) for j in tree.model.supports[end.joint]]
            places = [state.pose(frame)[:3, 3] if frame.joint else np.zeros(3) for frame in way]
            lines.append(np.array([*places, state.pose(end)[:3, 3]]))
    elif isinstance(mechanism, Platform):
        points = mechanism.points @ posture.pose[:3, :3].T + posture.pose[:3, 3]
        lines = [np.array([a, b]) for a, b in zip(mechanism.anchors, points, strict=True)]
        lines.append(np.vstack([points, points[:1]]))
    if not lines:
        return ""
    every = np.vstack(lines)
    low, size = every.min(axis=0), max(float(np.ptp(every, axis=0).max()), numerics.ROUNDING)
    drawn = []
    for number, (title, across, up) in enumerate((("from the side", 0, 2), ("from above", 0, 1))):
        left = 20 + 320 * number
        for line in lines:
            flat = (line - low) / size * 210
            pairs = " ".join(f"{left + p[across]:.1f},{235 - p[up]:.1f}" for p in flat)
            drawn.append(
                f'<polyline points="{pairs}" fill="none" stroke="#666" stroke-width="4" '
                'stroke-linejoin="round"/>'
            )
            drawn += [
                f'<circle cx="{left + p[across]:.1f}" cy="{235 - p[up]:.1f}" r="4" fill="#2060c0"/>'
                for p in flat
            ]
        tip = (posture.pose[:3, 3] - low) / size * 210
        drawn.append(
            f'<circle cx="{left + tip[across]:.1f}" cy="{235 - tip[up]:.1f}" r="6" '
            f'fill="#c04020"/><text x="{left}" y="255">{title}: {"xyz"[across]} to the '
            f"right, {'xyz'[up]} up; M in red</text>"
        )
    return (
        '<svg viewBox="0 0 640 260" width="640" height="260" font-size="11" '
        f'font-family="sans-serif" role="img">{"".join(drawn)}</svg>'
    )


def _joints(result: PostureStiffness, q: Array, analysis: dict[str, Any]) -> str:
    """Each coordinate and spring: position before the load, stiffness, share of the deflection."""
    elastic, units = result.elastic, result.elastic.units
    deflection = _deflection(analysis)
    shares = {part["name"]: part["share"] for part in deflection.get("shares") or []}
    stiffness = [] if elastic.springs is None else np.asarray(elastic.springs.stiffness).tolist()
    springs = dict(zip(elastic.spring_names, stiffness, strict=False))
    for potential in elastic.potentials:  # a virtual joint of a link, the others held
        if isinstance(potential, (Beam, CoupledSprings)):
            hessian = potential.evaluate(result.posture).hessian
            for j in np.ravel(potential.indices):
                springs[elastic.names[j]] = springs.get(elastic.names[j], 0.0) + hessian[j, j]

    def spring(name: str, is_length: bool) -> str:
        k = springs.get(name)
        if k is None:
            return ""
        return "rigid" if np.isinf(k) else f"{k:.6g} {units.spring(is_length)}" if k else "none"

    rows = []
    for c, value in zip(elastic.mechanism.coordinates, q.tolist(), strict=True):
        place = f"{value:.5g} {units.length}" if c.is_length else f"{np.degrees(value):.2f} deg"
        rows.append((c.name, place, spring(c.name, c.is_length), _percent(shares.get(c.name))))
    legs = [n for n in dict.fromkeys([*springs, *shares]) if n not in elastic.names]
    rows += [(name, "", spring(name, True), _percent(shares.get(name))) for name in legs]
    of = "energy" if deflection.get("kind") == "springs" else "displacement"
    return _table(rows, ("coordinate", "position", "stiffness", f"share of the {of}"))


def _table(rows: Sequence[Sequence[str]], head: Sequence[str] = ()) -> str:
    cells = ["<tr>" + "".join(f"<th>{t}</th>" for t in head) + "</tr>"] if head else []
    cells += ["<tr>" + "".join(f"<td>{_text(t)}</td>" for t in row) + "</tr>" for row in rows]
    return f"<table>{''.join(cells)}</table>"


def _acting(elastic: ElasticMechanism, load: _Load) -> list[str]:
    """What acts on the body, and on its parts by gravity."""
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
        lines.append(f"At this posture, before any load, the springs are held by {said(load.held)}")
        if load.added is not None:
            lines.append("Stiffness and shares are those at this posture, before the load")
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
    small = numerics.BLANK * np.abs(K).max()
    rows = [
        [*(f"{0.0 if abs(x) < small else x:.6g}" for x in row), pair[i // 3]]
        for i, row in enumerate(K)
    ]
    return f"<p>{name}, in M; {order}</p>{_table(rows)}"


def _plot(swept: dict[str, tuple[Array, Array]], elastic: ElasticMechanism) -> str:
    """The sweeps as curves over the change of the coordinate."""
    mm = convert_length(elastic.units, Units("mm", SI.force))[0]
    finite = np.concatenate([y[np.isfinite(y)] for _, y in swept.values()])
    top = 1.05 * mm * float(np.quantile(finite, 0.98)) if finite.size else 1.0
    lines = []
    for tick in range(5):
        at = 220 - 50 * tick
        lines.append(
            f'<line x1="50" x2="430" y1="{at}" y2="{at}" stroke="#ddd"/><text x="45" y="{at + 4}" '
            f'text-anchor="end">{top * tick / 4:.3g}</text>'
        )
    for i, (name, (_, y)) in enumerate(swept.items()):
        places = np.linspace(50, 430, _COUNT)
        drawn = " ".join(
            f"{a:.1f},{max(220 - 200 * mm * b / top, 10):.1f}"
            for a, b in zip(places, y, strict=True)
            if np.isfinite(b)
        )
        colour = _COLOURS[i % len(_COLOURS)]
        lines.append(f'<polyline points="{drawn}" fill="none" stroke="{colour}" stroke-width="2"/>')
        if i < 14:
            lines.append(f'<text x="440" y="{20 + 15 * i}" fill="{colour}">{_text(name)}</text>')
    lengths = {c.is_length for c in elastic.mechanism.coordinates}
    reaches = {False: f"±{np.degrees(_REACH):.0f} deg", True: f"±{_REACH:g} characteristic lengths"}
    shown = " or ".join(reaches[is_length] for is_length in sorted(lengths))
    lines.append(f'<text x="240" y="240" text-anchor="middle">{shown}, within the limits</text>')
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
