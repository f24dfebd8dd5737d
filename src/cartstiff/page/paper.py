"""The report of one posture as one HTML file to send on: the answer first, picture, numbers."""

from __future__ import annotations

import platform
from collections.abc import Sequence
from html import escape
from importlib.metadata import version
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from cartstiff import numerics
from cartstiff.analysis.posture import analyse_posture
from cartstiff.errors import CartstiffError, printable
from cartstiff.geometry.se3 import Array
from cartstiff.many.postures import analyse_many
from cartstiff.mechanisms.chain import Chain
from cartstiff.mechanisms.contract import SI, Units, convert_length, named_values
from cartstiff.mechanisms.elastic import ElasticMechanism, gravity_loads
from cartstiff.mechanisms.platform import Platform
from cartstiff.mechanisms.tree import FixedFrame
from cartstiff.page.export import export_page
from cartstiff.page.source import Source
from cartstiff.report.layout import placed
from cartstiff.statics.equilibrium import equilibrium
from cartstiff.stiffness.applied_load import LoadKind
from cartstiff.stiffness.compute import analyse
from cartstiff.stiffness.posture import PostureStiffness
from cartstiff.version import __version__

# Values along the sweep of a coordinate, and how far it goes: rad, or characteristic lengths.
_COUNT, _REACH = 21, 0.5
_COLOURS = ("#2060c0", "#c04020", "#208040", "#8040a0", "#b08000", "#008090", "#c0307a", "#606060")
_STYLE = Path(__file__).parent / "static" / "paper.css"


def report_page(
    elastic: ElasticMechanism,
    q: ArrayLike | None = None,
    *,
    wrench: ArrayLike | None = None,
    load_kind: Literal["dead", "follower", "conservative"] = "dead",
    load_at: Sequence[float] = (0.0, 0.0, 0.0),
    load_axes: Literal["body", "world"] = "body",
    command: str = "",
    frames: int | None = None,
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
    frames : int, optional
        Postures along each slider of the picture in 3D; default: one that computes where it can.
    sections : sequence of (title, HTML)
        What else it shows, after the sweep.

    Raises
    ------
    CartstiffError
        As `cartstiff.analyse`.
    """
    kind = LoadKind(load_kind, tuple(load_at))  # type: ignore[arg-type]
    start = elastic.mechanism.assembled(
        elastic.q if q is None else named_values(q, elastic.names, elastic.q, "q")
    )
    load: dict[str, Any] = {
        "wrench": wrench,
        "load_kind": load_kind,
        "load_at": load_at,
        "load_axes": load_axes,
    }
    with np.errstate(all="ignore"):
        result = analyse(elastic, start, **load)
        analysis = analyse_posture(result)
        swept = _swept(elastic, start, load) if wrench is not None else {}
        lines, notes = _answer(elastic, start, wrench, kind, load_axes, result, analysis, swept)
        picture = _picture(elastic, result, wrench, load_kind, load_at, load_axes, frames)
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
        f"{_joints(elastic, start, analysis)}</section>",
        f"<section><h2>Load and weight</h2><ul>{_items(_acting(elastic, wrench, kind, load_axes))}"
        "</ul></section>",
        f"<section><h2>Stiffness</h2>{_matrix(result)}</section>",
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


def _answer(
    elastic: ElasticMechanism,
    start: Array,
    wrench: ArrayLike | None,
    kind: LoadKind,
    axes: Any,
    result: PostureStiffness,
    analysis: dict[str, Any],
    swept: dict[str, tuple[Array, Array]],
) -> tuple[list[str], list[str]]:
    """The sentences of the answer, and everything that was assumed."""
    lines: list[str] = []
    notes = {str(note): None for note in result.notes}
    mm = convert_length(elastic.units, Units("mm", SI.force))[0]
    loads = [] if wrench is None else [kind.acting(wrench, result.pose, axes)]
    try:
        state = equilibrium(elastic, *loads, q0=start)
    except CartstiffError as error:
        lines.append(f"No equilibrium was found: {error}")
        state = None
    if state is not None:
        notes |= {str(note): None for note in state.notes}
        if loads:
            turned, moved = np.split(state.displacement, 2)
            along = ", ".join(f"{mm * x:+.3g}" for x in moved)
            lines.append(
                f"The tip moves {mm * np.linalg.norm(moved):.3g} mm ({along} mm along the axes of "
                f"F) and turns {np.degrees(np.linalg.norm(turned)):.3g} deg."
            )
        shares = (analysis.get("deflection") or {}).get("shares") or []
        if shares:
            most = max(shares, key=lambda part: abs(part["share"] or 0.0))
            lines.append(f"{most['name']} gives {100 * (most['share'] or 0.0):.0f} % of it.")
    C = result.tangent_compliance if result.is_loaded else result.compliances["B"]
    if C is not None:
        values, vectors = np.linalg.eigh((C[3:, 3:] + C[3:, 3:].T) / 2)
        direction = result.pose[:3, :3] @ vectors[:, -1]
        direction *= np.sign(direction[np.argmax(np.abs(direction))])
        along = ", ".join(f"{x:.2f}" for x in direction + 0.0)
        if values[-1] > 0:
            soft = elastic.units.newtons / mm / values[-1]
            lines.append(f"Softest direction: ({along}) in F, {soft:.4g} N/mm.")
    if state is not None:
        lines.append(
            {
                True: "The equilibrium is stable.",
                False: "The equilibrium is NOT stable.",
                None: "Whether the equilibrium is stable is not decided.",
            }[state.stable]
        )
    better = [
        (float(y[i]), name, float(x[i]))
        for name, (x, y) in swept.items()
        for i in np.flatnonzero(np.isfinite(y))
    ]
    if better:
        least, name, at = min(better)
        here = float(next(iter(swept.values()))[1][_COUNT // 2])
        if least < 0.99 * here:
            where = elastic.mechanism.coordinates[elastic.names.index(name)]
            length = f"{at:.4g} {elastic.units.length}"
            place = length if where.is_length else f"{np.degrees(at):.1f} deg"
            lines.append(
                f"Better, of one coordinate at a time: {name} at {place} instead, "
                f"{100 * (1 - least / here):.0f} % less displacement (the tip is elsewhere then)."
            )
        else:
            lines.append("No single coordinate, moved from here, makes it better by 1 %.")
    return lines, list(notes)


def _swept(
    elastic: ElasticMechanism, start: Array, load: dict[str, Any]
) -> dict[str, tuple[Array, Array]]:
    """Displacement of the tip under the load, fixed in the room, over each coordinate."""
    mechanism = elastic.mechanism
    held = mechanism.at(start)
    kind = LoadKind(load["load_kind"], tuple(load["load_at"]))
    R = held.pose[:3, :3]
    W = np.asarray(load["wrench"], float)
    if load["load_axes"] == "body":
        W = np.concatenate([R @ W[:3], R @ W[3:]])
    sweeps: dict[str, tuple[Array, Array]] = {}
    if getattr(mechanism, "closures", None):
        return sweeps
    sizes = np.array(held.coordinate_lengths)
    for j, c in enumerate(mechanism.coordinates[:40]):
        x = start[j] + _REACH * sizes[j] * np.linspace(-1, 1, _COUNT)
        x = np.clip(x, min(c.lower, start[j]), max(c.upper, start[j]))
        x[_COUNT // 2] = start[j]
        Q = np.tile(start, (_COUNT, 1))
        Q[:, j] = x
        many = analyse_many(
            elastic,
            Q,
            wrench=W,
            load_kind=kind.kind,
            load_at=kind.at,
            load_axes="world",
            outputs=("wrench", "compliance_load"),
        )
        motion = np.einsum("nij,nj->ni", many.arrays["compliance_load"], many.arrays["wrench"])
        sweeps[c.name] = x, np.linalg.norm(motion[:, 3:], axis=1)
    return sweeps


def _picture(
    elastic: ElasticMechanism,
    result: PostureStiffness,
    wrench: ArrayLike | None,
    load_kind: Any,
    load_at: Sequence[float],
    load_axes: str,
    frames: int | None,
) -> str:
    source = Source(
        elastic,
        result.q,
        load=None if wrench is None else np.array(wrench, float),
        load_kind=load_kind,
        load_at=None if not any(load_at) else tuple(load_at),  # type: ignore[arg-type]
        load_axes="inertial" if load_axes == "world" else "body",
    )
    try:
        page = export_page(source, frames=frames)
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
        ends = {mechanism.body.joint} | {
            tree.placement(f).joint for c in mechanism.closures for f in (c.frame_a, c.frame_b)
        }
        for end in ends:
            way = [int(j) for j in tree.model.supports[end]]
            places = [
                state.pose(FixedFrame(j, np.eye(4)))[:3, 3] if j else np.zeros(3) for j in way
            ]
            lines.append(
                np.array([*places, *([posture.pose[:3, 3]] * (end == mechanism.body.joint))])
            )
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


def _joints(elastic: ElasticMechanism, q: Array, analysis: dict[str, Any]) -> str:
    shares = {
        part["name"]: part["share"]
        for part in (analysis.get("deflection") or {}).get("shares") or []
    }
    stiffness = [] if elastic.springs is None else np.asarray(elastic.springs.stiffness).tolist()
    springs = dict(zip(elastic.spring_names, stiffness, strict=False))
    units = elastic.units
    rows = []
    for c, value in zip(elastic.mechanism.coordinates, q.tolist(), strict=True):
        place = f"{value:.5g} {units.length}" if c.is_length else f"{np.degrees(value):.2f} deg"
        k = springs.get(c.name)
        unit = units.spring(c.is_length)
        k_text = "" if k is None else "rigid" if np.isinf(k) else f"{k:.6g} {unit}"
        share = shares.get(c.name)
        share_text = _percent(share)
        rows.append((c.name, place, k_text, share_text))
    for name, share in shares.items():
        if name not in elastic.names:
            k = springs.get(name)
            text = "" if k is None else f"{k:.6g} {units.spring(True)}"
            rows.append((name, "", text, _percent(share)))
    head = ("coordinate", "position", "stiffness", "share of the displacement")
    cells = ["<tr>" + "".join(f"<th>{t}</th>" for t in head) + "</tr>"]
    cells += ["<tr>" + "".join(f"<td>{_text(t)}</td>" for t in row) + "</tr>" for row in rows]
    return f"<table>{''.join(cells)}</table>"


def _acting(
    elastic: ElasticMechanism, wrench: ArrayLike | None, kind: LoadKind, axes: str
) -> list[str]:
    units = elastic.units
    if wrench is None:
        lines = ["Load: none"]
    else:
        m, f = np.split(np.asarray(wrench, float), 2)
        of = "F" if axes == "world" else "M"
        lines = [
            f"Load: moment ({', '.join(f'{x:g}' for x in m)}) {units.moment}, force "
            f"({', '.join(f'{x:g}' for x in f)}) {units.force} along the axes of {of}, at "
            f"({', '.join(f'{x:g}' for x in kind.at)}) {units.length} in M; {kind.words}"
        ]
    return [*lines, gravity_loads(elastic).text]


def _matrix(result: PostureStiffness) -> str:
    units = result.units
    K = result.tangent if result.is_loaded else result.matrices["B"]
    name = "K, the tangent stiffness under the load" if result.is_loaded else "K"
    f, x, m = units.force, units.length, units.moment
    pair = (f"{m}/rad | {f}", f"{f}/rad | {f}/{x}")
    if K is None:
        K = result.tangent_compliance if result.is_loaded else result.compliances["B"]
        name = "The stiffness does not exist here; the compliance C"
        pair = (f"rad/({m}) | rad/{f}", f"1/{f} | {x}/{f}")
    if K is None:
        return "<p>Neither stiffness nor compliance exists here; see what is assumed.</p>"
    small = numerics.BLANK * np.abs(K).max()
    rows = [
        "<tr>"
        + "".join(f"<td>{0.0 if abs(x) < small else x:.6g}</td>" for x in row)
        + f"<td>{pair[i // 3]}</td></tr>"
        for i, row in enumerate(K)
    ]
    order = "rows are moments, then forces, columns rotations, then translations."
    return f"<p>{name}, in M; {order}</p><table>{''.join(rows)}</table>"


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
