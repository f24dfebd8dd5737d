"""A place in a scene: takes objects, transforms and properties as plain values.

meshcat's protocol is a stream of dicts; writing them directly gives materials, sprites and packed
normals that meshcat's own classes lack, for any ``meshcat.Visualizer`` alike.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import partial
from typing import Any

import numpy as np

from cartstiff.errors import InputError
from cartstiff.geometry.se3 import Array

#: The first three columns of a translation.
_UNTURNED = (1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0)


class _Lowered:
    """A command that is plain already."""

    __slots__ = ("data",)

    def __init__(self, data: dict[str, Any]) -> None:
        self.data = data

    def lower(self) -> dict[str, Any]:
        return self.data


def _send_lowered(window: Any, data: dict[str, Any]) -> None:
    window.send(_Lowered(data))


class Node:
    """A path in the scene tree of a viewer.

    Parameters
    ----------
    window : object
        With ``send(command)``, as meshcat's windows have.
    path : str
        Absolute, "/meshcat/robot".
    enlarged : float
        Scene units per unit of length here: labels, which have a size on the screen, are made
        smaller by it.
    """

    __slots__ = ("_children", "_send", "_visible", "enlarged", "path", "window")

    def __init__(self, window: Any, path: str, enlarged: float = 1.0) -> None:
        self.window = window
        self.path = path
        self.enlarged = enlarged
        record = getattr(window, "record", None)
        self._send = partial(_send_lowered, window) if record is None else record
        self._visible = True
        self._children: dict[str, Node] = {}

    @classmethod
    def of(cls, visualizer: Any) -> Node:
        """The place that a ``meshcat.Visualizer`` (or a Node) stands for.

        Raises
        ------
        InputError
            For anything else.
        """
        if isinstance(visualizer, Node):
            return visualizer
        try:
            return cls(visualizer.window, visualizer.path.lower())
        except AttributeError:
            raise InputError(
                "nothing to draw on", expected="a meshcat.Visualizer", got=visualizer
            ) from None

    def __getitem__(self, name: str) -> Node:
        child = self._children.get(name)
        if child is None:
            child = self._children[name] = Node(self.window, f"{self.path}/{name}", self.enlarged)
        return child

    def set_object(self, data: dict[str, Any]) -> None:
        """Put an object here, made by `cartstiff.scene.objects`."""
        self._send({"type": "set_object", "object": data, "path": self.path})

    def set_transform(self, T: Array) -> None:
        """Affine motion (4, 4) of this place in its parent; it may scale."""
        self._set_matrix(T.T.ravel().tolist())

    def set_columns(
        self, x: Sequence[float], y: Sequence[float], z: Sequence[float], origin: Sequence[float]
    ) -> None:
        """Affine motion from its columns, plain numbers: twice as fast where there are many."""
        self._set_matrix([*x, 0.0, *y, 0.0, *z, 0.0, *origin, 1.0])

    def move_to(self, point: Iterable[float]) -> None:
        """Pure translation to a point in the parent."""
        self._set_matrix([*_UNTURNED, *map(float, point), 1.0])

    def _set_matrix(self, matrix: list[float]) -> None:
        self._send({"type": "set_transform", "path": self.path, "matrix": matrix})

    def set_property(self, key: str, value: Any) -> None:
        """Property of the three.js object here."""
        self._send({"type": "set_property", "path": self.path, "property": key, "value": value})

    def show(self, visible: bool) -> None:
        """Show or hide this place and everything below; sent only where it changes."""
        if visible != self._visible:
            self._visible = visible
            self.set_property("visible", visible)

    def delete(self) -> None:
        """Remove this place and everything below."""
        self._children.clear()
        self._visible = True
        self._send({"type": "delete", "path": self.path})


def scaled(T: Array, scale: Array | float) -> Array:
    """T with its axes stretched: ``T diag(scale, 1)``."""
    M = np.array(T)
    M[:3, :3] = M[:3, :3] * scale
    return M
