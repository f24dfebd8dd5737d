"""The drawing of a report: the robot, its load, and its pose under the load, exaggerated.

Links are drawn as the outlines of their shapes, or as sticks where a file has none. It is
plain SVG, so that it prints.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from html import escape
from typing import NamedTuple

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from cartstiff.answer.data import Answer
from cartstiff.answer.posture import rests
from cartstiff.core import numerics
from cartstiff.core.arrays import Array
from cartstiff.core.errors import CartstiffError
from cartstiff.core.geometry import se3
from cartstiff.core.mechanisms.chain import Chain, ChainPosture
from cartstiff.core.mechanisms.contract import Mechanism, MechanismPosture
from cartstiff.core.mechanisms.elastic import ElasticMechanism
from cartstiff.core.mechanisms.shapes import Box, Capsule, Cylinder, MeshFile, Shape
from cartstiff.core.mechanisms.tree import FixedFrame
from cartstiff.core.stiffness.applied_load import LoadKind
from cartstiff.core.stiffness.compute import PostureStiffness
from cartstiff.core.units import Units, engineering
from cartstiff.files.meshes import read_meshes
from cartstiff.files.visuals import visuals_of
from cartstiff.shown.scene.enlarged import factor_for
from cartstiff.shown.scene.held_forces import HeldForcesShown
from cartstiff.shown.scene.scales import round_number

# Pixels of a panel, and around it.
_WIDTH, _HEIGHT, _ROOM = 320.0, 300.0, 26.0
# Shares of the size: of arrows, of a part along the view that is not drawn, and of the
# longest of the forces that drives hold.
_ARROW, _HIDDEN, _HELD = 0.2, 0.02, 0.35
_LINK, _EDGE, _GHOST, _LOAD, _TIP = "#d5dae1", "#5d6673", "#1f9d55", "#c22f1e", "#c04020"
_ROUND = 16


class View(NamedTuple):
    """A direction of sight: rows to the right, up, and towards the reader."""

    title: str
    axes: Array


def _view(title: str, azimuth: float, elevation: float) -> View:
    """Parallel projection; seen from that azimuth about z and elevation, in degrees."""
    a, e = np.radians([azimuth, elevation])
    right = [-np.sin(a), np.cos(a), 0.0]
    near = [np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)]
    return View(title, np.array([right, np.cross(near, right), near]))


class Outline(NamedTuple):
    """Points (n, 3) of a convex piece of a link in the frame of its joint."""

    at: FixedFrame
    points: Array


def outlines(mechanism: Mechanism) -> list[Outline]:
    """The shapes of a chain's links; empty where one is missing."""
    if not isinstance(mechanism, Chain):
        return []
    pieces, missing = visuals_of(mechanism)
    if missing:
        return []
    meshes = read_meshes(p.shape.path for p in pieces if isinstance(p.shape, MeshFile))
    found = []
    for piece in pieces:
        points = _points(piece.shape)
        if isinstance(piece.shape, MeshFile):
            mesh = meshes[piece.shape.path]
            if isinstance(mesh, Exception):
                return []
            points = np.asarray(mesh.positions, float) * piece.shape.scale
        corners = points[_hull(points)]
        T = piece.at.T_j_f
        joint = FixedFrame(piece.at.joint, np.eye(4))
        found.append(Outline(joint, se3.placed(T, corners)))
    return found


def _points(shape: Shape) -> Array:
    """Points of a simple body's surface; none of a mesh."""
    turns = np.linspace(0.0, 2.0 * np.pi, _ROUND, endpoint=False)
    ring = np.column_stack([np.cos(turns), np.sin(turns), np.zeros(_ROUND)])
    ball = [
        np.array([c, c, 1.0]) * ring + [0.0, 0.0, s]
        for c, s in zip(np.cos(turns), np.sin(turns), strict=True)
    ]
    match shape:
        case Box(sides):
            signs = np.stack(np.meshgrid(*[(-0.5, 0.5)] * 3), -1).reshape(-1, 3)
            return signs * sides
        case Cylinder(radius, length):
            ends = [radius * ring + [0, 0, side * length] for side in (-0.5, 0.5)]
        case Capsule(radius, length):
            ends = [radius * b + [0, 0, s * length] for b in ball for s in (-0.5, 0.5)]
        case MeshFile():
            return np.zeros((0, 3))
        case _:
            ends = [np.array(shape.radii) * b for b in ball]
    return np.concatenate(ends)


def _hull(points: Array) -> list[int]:
    """Indices of the corners of the convex hull, in order where points are (n, 2)."""
    try:
        return ConvexHull(points).vertices.tolist()
    except (QhullError, ValueError):  # flat, or too few
        return list(range(len(points)))


class Drawn(NamedTuple):
    """What is drawn at one posture, in F: outlines of links, else lines."""

    outlines: list[Array]
    lines: list[Array]

    @property
    def points(self) -> Array:
        """All of them (n, 3)."""
        return np.concatenate([*self.outlines, *self.lines, np.zeros((0, 3))])


def drawn(posture: MechanismPosture, shapes: Sequence[Outline]) -> Drawn:
    """The mechanism at a posture."""
    placed = []
    if isinstance(posture, ChainPosture):
        for piece in shapes:
            T = posture.pose_at(piece.at)
            placed.append(se3.placed(T, piece.points))
    if placed:
        return Drawn(placed, [])
    return Drawn([], posture.drawn().paths)


def exaggerated(
    elastic: ElasticMechanism, start: Array, end: Array, size: float
) -> tuple[float, MechanismPosture] | None:
    """The factor by which a deflection is drawn, and the posture that far from the start.

    None where nothing moves.
    """
    mechanism = elastic.mechanism
    before, after = mechanism.at(start), mechanism.at(end)
    step = end - start
    moved = numerics.norm((after.pose - before.pose)[:3, 3])
    if not moved > numerics.ROUNDOFF * size:
        return None
    turned = numerics.largest(step / before.coordinate_lengths)
    if (factor := factor_for(moved, turned, size)) is None:
        return None
    there = start + factor * step
    try:
        if mechanism.closures:
            return factor, mechanism.closed(there)
        return factor, mechanism.at(there)
    except CartstiffError:  # closures do not go so far
        return None


class Arrow(NamedTuple):
    """An arrow at a point in F, with its words."""

    at: Array
    along: Array
    words: str


def drawing(
    result: PostureStiffness,
    answer: Answer,
    added: Array | None = None,
    acting: LoadKind | None = None,
) -> str:
    """The mechanism at a posture with its load, and under it, as a figure with its words.

    Parameters
    ----------
    result : PostureStiffness
        The posture.
    answer : Answer
        What is said of it.
    added : ndarray (6,), optional
        The wrench in the axes of M whose displacement is said; default the load.
    acting : LoadKind, optional
        Behaviour of that wrench, and its point.
    """
    elastic, kind = result.elastic_as_given, acting or result.load
    start, end, far = result.q, None, answer.far
    if far:
        with suppress(CartstiffError):
            before, state = rests(result, added, kind)
            start, end = (before or result.posture).q, state.posture.q
    mechanism, units = elastic.mechanism, elastic.units
    shapes = outlines(mechanism)
    before = mechanism.at(start)
    robot = drawn(before, shapes)
    size = float(np.ptp(robot.points, axis=0).max()) or before.length
    ghost, words = None, ["The robot at the posture"]
    if end is not None and (shown := exaggerated(elastic, start, end, size)):
        factor, there = shown
        ghost = drawn(there, shapes)
        words.append(
            f"in green under its load, the deflection drawn {factor:g} times as large "
            f"(the tip moves {engineering(far, units.length)})"
        )
    force, held, body = _arrow(result, answer, added, kind), None, None
    if force is not None:
        words.append(f"the red arrow is {force.words}")
        held = HeldForcesShown.of(result)
        large = numerics.norm(force.along)
        force = force._replace(along=_ARROW * size * force.along / large)
        # Forces that drives hold have the arrow's scale, where it is seen then.
        if held.corners is not None:
            most = engineering(float(held.sizes.max()), units.force)
            words.append(f"dashed are the forces on M that the drives hold, up to {most}")
            longest = max(float(held.sizes.max()), large)
            body = before.pose[:3, 3] + _HELD * size / longest * held.corners
            if large > 2.0 * _HIDDEN * longest:
                words[-1] += ", to the arrow's scale"
                force = force._replace(
                    along=force.along * (_HELD * large / (_ARROW * longest))
                )
    # From the link that carries the tool to the tool's tip.
    flange = before.pose @ se3.inverse(mechanism.frame_offset)
    tool = flange[:3, 3], before.pose[:3, 3]
    spread = np.ptp(robot.points, axis=0)
    side = _view("from the side", -90.0 * bool(spread[0] >= spread[1]), 0.0)
    panels = []
    for number, view in enumerate((_view("from the front, above", -50.0, 20.0), side)):
        left = number * (_WIDTH + _ROOM)
        panels.append(
            f'<g transform="translate({left:.0f} 0)">'
            f"{''.join(_panel(view, robot, ghost, tool, force, body, units))}</g>"
        )
    width = 2 * _WIDTH + _ROOM
    return (
        f'<figure><svg viewBox="0 0 {width:.0f} {_HEIGHT + 40:.0f}" width="{width:.0f}" '
        f'height="{_HEIGHT + 40:.0f}" font-size="11" font-family="sans-serif" role="img">'
        '<defs><marker id="head" viewBox="0 0 8 8" refX="6" refY="4" markerWidth="14" '
        'markerHeight="14" markerUnits="userSpaceOnUse" orient="auto">'
        f'<path d="M0 0L8 4L0 8z" fill="{_LOAD}"/></marker></defs>{"".join(panels)}</svg>'
        f"<figcaption>{escape('; '.join(words))}.</figcaption></figure>"
    )


def _arrow(
    result: PostureStiffness, answer: Answer, added: Array | None, kind: LoadKind
) -> Arrow | None:
    """The given force, at its point."""
    T, load = result.pose, answer.load
    force = np.zeros(3)
    if added is not None:
        force = T[:3, :3] @ added[3:]
    elif load is not None and load.given:
        force = np.array(load.force)
    if not force.any():
        return None
    much = engineering(numerics.norm(force), result.units.force)
    return Arrow(se3.placed(T, kind.at), force, f"the force of {much}")


def _panel(
    view: View,
    robot: Drawn,
    ghost: Drawn | None,
    tool: tuple[Array, Array],
    force: Arrow | None,
    body: Array | None,
    units: Units,
) -> Iterator[str]:
    """One view, with a scale bar and the axes of F that it shows."""
    flange, tip = tool
    every = [robot.points, tip[None]]
    if ghost is not None:
        every.append(ghost.points)
    if force is not None:
        every.append(force.at + force.along[None])
    if body is not None:
        every.append(body)
    flat = np.concatenate(every) @ view.axes.T
    low, high = flat.min(axis=0)[:2], flat.max(axis=0)[:2]
    inner = np.array([_WIDTH, _HEIGHT]) - 2 * _ROOM
    scale = float((inner / np.maximum(high - low, numerics.ROUNDOFF)).min())
    middle = 0.5 * (low + high)

    def at(points: Array) -> Array:
        """Pixels (n, 2) of points in F."""
        plane = (points @ view.axes[:2].T - middle) * scale
        return plane * [1.0, -1.0] + [_WIDTH / 2, _HEIGHT / 2]

    yield from _figure(robot, view, at, (_LINK, _EDGE, 3.5))
    if ghost is not None:
        yield from _figure(ghost, view, at, ("none", _GHOST, 1.8))
    if body is not None:
        flat = at(body)
        corners = " ".join(f"{x:.1f},{y:.1f}" for x, y in flat[_hull(flat)])
        yield (
            f'<polygon points="{corners}" fill="{_LOAD}" fill-opacity="0.06" '
            f'stroke="{_LOAD}" stroke-width="0.8" stroke-dasharray="4 3"/>'
        )
    (x, y), (u, v) = at(flange), at(tip)
    yield f'<path d="M{x:.1f} {y:.1f}L{u:.1f} {v:.1f}" stroke="{_EDGE}" stroke-width="3"/>'  # noqa: E501
    x, y = at(tip)
    yield f'<circle cx="{x:.1f}" cy="{y:.1f}" r="4" fill="{_TIP}"/>'
    if force is not None:
        (x, y), (u, v) = at(force.at), at(force.at + force.along)
        if np.hypot(u - x, v - y) > _HIDDEN * _WIDTH:  # else towards the reader
            yield (
                f'<line x1="{x:.1f}" y1="{y:.1f}" x2="{u:.1f}" y2="{v:.1f}" '
                f'stroke="{_LOAD}" stroke-width="3" marker-end="url(#head)"/>'
            )
    bar = round_number(0.3 * _WIDTH / scale)
    long = bar * scale
    yield (
        f'<path d="M{_ROOM} {_HEIGHT + 12}v6h{long:.1f}v-6" fill="none" stroke="#222"/>'
        f'<text x="{_ROOM + long + 8:.1f}" y="{_HEIGHT + 19}">'
        f"{engineering(bar, units.length)}</text>"
        f'<text x="{_ROOM}" y="{_HEIGHT + 36}">{view.title}</text>'
    )
    # The axes of F, at the right below.
    for name, axis in zip("xyz", np.eye(3), strict=True):
        u, v = 24.0 * (view.axes[:2] @ axis) * [1.0, -1.0]
        if np.hypot(u, v) > 4.0:
            yield (
                f'<path d="M{_WIDTH - 50} {_HEIGHT + 10}l{u:.1f} {v:.1f}" stroke="#888"/>'
                f'<text x="{_WIDTH - 50 + 1.3 * u:.1f}" y="{_HEIGHT + 14 + 1.3 * v:.1f}" '
                f'text-anchor="middle" fill="#666">{name}</text>'
            )


def _figure(
    shown: Drawn, view: View, at: object, paint: tuple[str, str, float]
) -> Iterator[str]:
    """Outlines from the back to the front, or lines with their joints."""
    assert callable(at)
    fill, stroke, width = paint
    depths = [float((points @ view.axes[2]).mean()) for points in shown.outlines]
    for i in np.argsort(depths):
        flat = at(shown.outlines[i])
        corners = " ".join(f"{x:.1f},{y:.1f}" for x, y in flat[_hull(flat)])
        yield (
            f'<polygon points="{corners}" fill="{fill}" stroke="{stroke}" '
            f'stroke-width="0.8" stroke-linejoin="round"/>'
        )
    for line in shown.lines:
        flat = at(line)
        corners = " ".join(f"{x:.1f},{y:.1f}" for x, y in flat)
        yield (
            f'<polyline points="{corners}" fill="none" stroke="{stroke}" '
            f'stroke-width="{width}" '
            f'stroke-linejoin="round" stroke-linecap="round"/>'
        )
        for x, y in flat:
            r = f"{0.85 * width:.1f}"
            yield f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{r}" fill="{stroke}"/>'
