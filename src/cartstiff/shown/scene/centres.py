"""Nodal axis of a mode, a line with its pitch.

Centres of an elasticity, balls with their names.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from cartstiff.answer.analysis.centres import centres_of
from cartstiff.answer.analysis.screws import Screw
from cartstiff.core.arrays import Array
from cartstiff.core.geometry import se3
from cartstiff.shown.scene import objects, theme
from cartstiff.shown.scene.labels import Label, number
from cartstiff.shown.scene.viewer import ViewerNode

# Farther than this many sizes of the mechanism is outside of the picture.
_OUTSIDE = 2.5


class NodalAxis:
    """The axis about which the body turns in a mode,
    with its pitch written at one end.
    """

    def __init__(self, node: ViewerNode, size: float, look: theme.Theme) -> None:
        self._node, self._size = node["axis 1"], size
        self._label, self._is_made = Label(node["label 1"], look), False

    def draw(
        self, name: str, hertz: float, screw: Screw, T: Array, length: str, labels: bool
    ) -> dict[str, Any]:
        """Show the axis, given in the frame with pose T; returns what it is."""
        reason = self._why_not_visible(screw)
        if reason is None:
            if not self._is_made:
                self._is_made = True
                self._node.set_object(
                    objects.rod(0.003 * self._size, theme.COLOURS["screw"], 0.9)
                )
            half = 0.45 * self._size
            point, along = se3.placed(T, screw.point), T[:3, :3] @ screw.direction
            self._node.set_transform(
                objects.segment(point - half * along, point + half * along)
            )
            self._node.show(True)
            if labels:
                end = (point - 1.04 * half * along).tolist()
                self._label.show(f"h = {number(screw.pitch, length)}", end)
            else:
                self._label.hide()
        else:
            self.hide()
        return {
            "name": name,
            "value": hertz,
            "unit": "Hz",
            "pitch": screw.pitch if np.isfinite(screw.pitch) else None,
            "shown": reason is None,
            "reason": reason,
        }

    def _why_not_visible(self, screw: Screw) -> str | None:
        if not np.all(np.isfinite(screw.point)):
            return "its pitch is infinite: a direction without a place"
        away = float(np.linalg.norm(screw.point))
        if away > _OUTSIDE * self._size:
            return f"it passes {number(away)} away, outside of the picture"
        return None

    def hide(self) -> None:
        """Show nothing."""
        if self._is_made:
            self._node.show(False)
        self._label.hide()


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
                    objects.solid(
                        objects.sphere(0.011 * self._size), theme.COLOURS["screw"]
                    )
                )
            M = np.eye(4)
            M[:3, 3] = se3.placed(T, near[name])
            ball.show(True)
            ball.set_transform(M)
            same = [
                n
                for n, p in near.items()
                if np.linalg.norm(p - near[name]) < 0.05 * self._size
            ]
            if labels and same[0] == name:
                text = "centre of " + ", ".join(_NAMES[n] for n in same)
                # Above and below in turn, so that labels of neighbours lie apart.
                side = 0.035 if sum(n != name for n in shown) % 2 == 0 else -0.035
                shown.append(name)
                x, y, z = M[:3, 3].tolist()
                self._labels[name].show(text, [x, y, z + side * self._size])
            else:
                self._labels[name].hide()
        told = {}
        for name, p in points.items():
            reason = None
            if p is None:
                reason = str(places.reasons[name])
            elif name not in near:
                reason = "outside of the picture"
            told[name] = {
                "point": None if p is None else p.tolist(),
                "shown": name in near,
                "reason": reason,
            }
        return told

    def hide(self) -> None:
        """Show nothing."""
        for name in self._made:
            self._node[name].show(False)
            self._labels[name].hide()
