"""Screw axes and centres: lines with their pitch, small balls with their names."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from cartstiff.analysis.centres import centres_of
from cartstiff.analysis.screws import (
    Screw,
    eigenscrews,
    twist_compliant_axes,
    wrench_compliant_axes,
)
from cartstiff.arrays import checked_pose
from cartstiff.errors import UndefinedError
from cartstiff.geometry.se3 import Array
from cartstiff.mechanisms.contract import Units
from cartstiff.scene import objects, theme
from cartstiff.scene.labels import Label, number
from cartstiff.scene.viewer import ViewerNode

# Farther than this many sizes of the mechanism is outside of the picture.
_OUTSIDE = 2.5


@dataclass(frozen=True, eq=False)
class Line:
    """A screw axis to draw, and the value written beside it."""

    screw: Screw
    name: str
    value: float
    unit: str
    colour: int


def eigenscrew_lines(K: Array, C: Array | None, units: Units) -> list[Line]:
    """Eigenscrews of a symmetric stiffness; none where they are not known."""
    try:
        screws = eigenscrews(K, C).screws
    except UndefinedError:
        return []
    return [
        Line(
            e.screw, f"eigenscrew {i + 1}", e.eigenvalue, units.blocks["tr"], theme.COLOURS["screw"]
        )
        for i, e in enumerate(screws)
    ]


def compliant_lines(K: Array, C: Array | None, units: Units) -> list[Line]:
    """Wrench- and twist-compliant axes of a symmetric stiffness, those that are known."""
    lines = []
    for kind, function, colour in (
        ("wrench", wrench_compliant_axes, theme.COLOURS["translation"]),
        ("twist", twist_compliant_axes, theme.COLOURS["rotation"]),
    ):
        with suppress(UndefinedError):
            lines += [
                Line(
                    axis.screw,
                    f"{kind} axis {i + 1}",
                    axis.stiffness,
                    units.spring(kind == "wrench"),
                    colour,
                )
                for i, axis in enumerate(function(K, C))
            ]
    return lines


class AxesPicture:
    """Lines in space, each with its pitch written at one end."""

    def __init__(self, node: ViewerNode, size: float, look: theme.Theme) -> None:
        self._node, self._size, self._theme = node, size, look
        self._lines: list[tuple[ViewerNode, Label]] = []
        self._colours: list[int | None] = []

    def draw(
        self, lines: Sequence[Line], T: Array, length: str, labels: bool
    ) -> list[dict[str, Any]]:
        """Show screw axes given in the frame with pose T; returns what each one is."""
        answer = []
        while len(self._lines) < len(lines):
            i = len(self._lines) + 1
            label = Label(self._node[f"label {i}"], self._theme)
            self._lines.append((self._node[f"axis {i}"], label))
            self._colours.append(None)
        self.hide(len(lines))
        half = 0.45 * self._size
        for i, line in enumerate(lines):
            (node, label), screw = self._lines[i], line.screw
            reason = self._why_not_visible(screw)
            answer.append(
                {
                    "name": line.name,
                    "value": line.value,
                    "unit": line.unit,
                    "pitch": screw.pitch if np.isfinite(screw.pitch) else None,
                    "shown": reason is None,
                    "reason": reason,
                }
            )
            node.show(reason is None)
            if reason is not None or not labels:
                label.hide()
            if reason is not None:
                continue
            if self._colours[i] != line.colour:
                self._colours[i] = line.colour
                node.set_object(objects.rod(0.003 * self._size, line.colour, 0.9))
            point, along = T[:3, :3] @ screw.point + T[:3, 3], T[:3, :3] @ screw.direction
            node.set_transform(objects.segment(point - half * along, point + half * along))
            if labels:
                # Ends of lines through one point lie apart; neighbours get opposite ends.
                end = half * (1.04 if i % 2 else -1.04)
                label.show(f"h = {number(screw.pitch, length)}", point + end * along)
        return answer

    def _why_not_visible(self, screw: Screw) -> str | None:
        if not np.all(np.isfinite(screw.point)):
            return "its pitch is infinite: a direction without a place"
        away = float(np.linalg.norm(screw.point))
        if away > _OUTSIDE * self._size:
            return f"it passes {number(away)} away, outside of the picture"
        return None

    def hide(self, first: int = 0) -> None:
        """Show no line from the first one on."""
        for node, label in self._lines[first:]:
            node.show(False)
            label.hide()


_NAMES = {
    "stiffness": "stiffness",
    "compliance": "compliance",
    "elasticity": "elasticity",
    "least_coupling": "least coupling",
}


class CentresPicture:
    """The centres of an elasticity; those that coincide share one label."""

    def __init__(self, node: ViewerNode, size: float, look: theme.Theme) -> None:
        self._node, self._size = node, size
        self._labels = {name: Label(node[f"{name} label"], look) for name in _NAMES}
        self._made: set[str] = set()

    def draw(self, K: Array, C: Array | None, T: Array, labels: bool) -> dict[str, Any]:
        """Show the centres of a symmetric stiffness in the frame with pose T."""
        places = centres_of(K, C)
        points = {name: getattr(places, name) for name in _NAMES}
        near = {
            name: p
            for name, p in points.items()
            if p is not None and np.linalg.norm(p) <= _OUTSIDE * self._size
        }
        shown: list[str] = []
        for name in _NAMES:
            ball = self._node[name]
            if name not in near:
                if name in self._made:
                    ball.show(False)
                self._labels[name].hide()
                continue
            if name not in self._made:
                self._made.add(name)
                ball.set_object(
                    objects.solid(objects.sphere(0.011 * self._size), theme.COLOURS["screw"])
                )
            M = np.eye(4)
            M[:3, 3] = T[:3, :3] @ near[name] + T[:3, 3]
            ball.show(True)
            ball.set_transform(M)
            same = [
                n for n, p in near.items() if np.linalg.norm(p - near[name]) < 0.05 * self._size
            ]
            if labels and same[0] == name:
                text = "centre of " + ", ".join(_NAMES[n] for n in same)
                # Above and below in turn, so that labels of neighbours lie apart.
                side = 0.035 if sum(n != name for n in shown) % 2 == 0 else -0.035
                shown.append(name)
                self._labels[name].show(text, M[:3, 3] + [0.0, 0.0, side * self._size])
            else:
                self._labels[name].hide()
        return {
            name: {
                "point": None if p is None else p.tolist(),
                "shown": name in near,
                "reason": str(places.reasons[name])
                if p is None
                else None
                if name in near
                else "outside of the picture",
            }
            for name, p in points.items()
        }

    def hide(self) -> None:
        """Show nothing."""
        for name in self._made:
            self._node[name].show(False)
            self._labels[name].hide()


def add_screw(
    visualizer: Any,
    screw: Screw,
    T: ArrayLike | None = None,
    *,
    size: float = 0.5,
    unit: str = "m",
    colour: int = theme.COLOURS["screw"],
    label: str | None = None,
    dark: bool = False,
) -> bool:
    """Draw the axis of a screw, with its pitch, in any meshcat scene.

    Parameters
    ----------
    visualizer : meshcat.Visualizer
        Where: ``vis["path"]``; it is drawn below, as "screw". A later call replaces it.
    screw : Screw
        From `cartstiff.analysis.screws`, in the frame with pose T.
    T : array_like, shape (4, 4), optional
        ``T_F_M``; default identity.
    size : float
        Length of the line.
    unit : str
        Unit of length, for the pitch.
    colour : int
        0xRRGGBB.
    label : str, optional
        Instead of the pitch; empty for none.
    dark : bool
        Whether the background is dark.

    Returns
    -------
    bool
        False for a screw of infinite pitch: it has a direction and no place.
    """
    node = ViewerNode.of(visualizer)["screw"]
    node.delete()
    if not np.all(np.isfinite(screw.point)):
        return False
    pose = np.eye(4) if T is None else checked_pose(T, "T")
    point = pose[:3, :3] @ screw.point + pose[:3, 3]
    half = 0.5 * size * (pose[:3, :3] @ screw.direction)
    node["axis"].set_object(objects.rod(0.006 * size, colour, 0.9))
    node["axis"].set_transform(objects.segment(point - half, point + half))
    text = f"h = {number(screw.pitch, unit)}" if label is None else label
    if text:
        look = theme.DARK if dark else theme.LIGHT
        Label(node["label"], look, colour).show(text, point + 1.08 * half)
    return True
