"""A place in a scene: takes objects, transforms and properties as plain values.

meshcat's protocol is a stream of dicts; writing them directly gives materials, sprites
and packed normals that meshcat's own classes lack, for any ``meshcat.Visualizer`` alike.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any, Protocol

import numpy as np

from cartstiff.core.arrays import Array
from cartstiff.core.errors import InputError, imported

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


class ViewerNode:
    """A path in the scene tree of a viewer.

    Parameters
    ----------
    window : object
        With ``send(command)``, as meshcat's windows have.
    path : str
        Absolute, "/meshcat/robot".
    enlarged : float
        Scene units per unit of length here: labels, which have a size on the screen, are
        made smaller by it.
    """

    __slots__ = ("_children", "_send", "_visible", "enlarged", "path", "window")

    def __init__(self, window: Any, path: str, enlarged: float = 1.0) -> None:
        self.window = window
        self.path = path
        self.enlarged = enlarged
        record = getattr(window, "record", None)
        self._send = partial(_send_lowered, window) if record is None else record
        self._visible = True
        self._children: dict[str, ViewerNode] = {}

    @classmethod
    def of(cls, visualizer: Any) -> ViewerNode:
        """Return the node of a ``meshcat.Visualizer``, or a ViewerNode itself.

        Raises
        ------
        InputError
            For anything else.
        """
        if isinstance(visualizer, ViewerNode):
            return visualizer
        try:
            return cls(visualizer.window, visualizer.path.lower())
        except AttributeError:
            raise InputError(
                "nothing to draw on", expected="a meshcat.Visualizer", got=visualizer
            ) from None

    def __getitem__(self, name: str) -> ViewerNode:
        child = self._children.get(name)
        if child is None:
            child = self._children[name] = ViewerNode(
                self.window, f"{self.path}/{name}", self.enlarged
            )
        return child

    def set_object(self, data: dict[str, Any]) -> None:
        """Put an object here, made by `cartstiff.shown.scene.objects`."""
        self._send({"type": "set_object", "object": data, "path": self.path})

    def set_transform(self, T: Array) -> None:
        """Affine motion (4, 4) of this place in its parent; it may scale."""
        self._set_matrix(T.T.ravel().tolist())

    def set_columns(
        self,
        x: Sequence[float],
        y: Sequence[float],
        z: Sequence[float],
        origin: Sequence[float],
    ) -> None:
        """Affine motion from its columns, plain numbers: twice as fast where
        there are many.
        """
        self._set_matrix([*x, 0.0, *y, 0.0, *z, 0.0, *origin, 1.0])

    def move_to(self, point: Sequence[float]) -> None:
        """Pure translation to a point in the parent, plain numbers."""
        self._set_matrix([*_UNTURNED, *point, 1.0])

    def _set_matrix(self, matrix: list[float]) -> None:
        self._send({"type": "set_transform", "path": self.path, "matrix": matrix})

    def set_property(self, key: str, value: Any) -> None:
        """Property of the three.js object here."""
        self._send(
            {"type": "set_property", "path": self.path, "property": key, "value": value}
        )

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


#: Parts that the viewer makes itself: hidden or moved, but never deleted.
_OWN_PARTS = {"Cameras", "Lights", "Background", "Grid", "Axes", "Animations"}
_KINDS = ("set_object", "set_transform", "set_property", "delete")


class Command(Protocol):
    """Anything meshcat sends: lowered, a dict with "type" and "path"."""

    def lower(self) -> dict[str, Any]:
        """The command as plain values."""


@dataclass
class _Node:
    """The latest state of one path."""

    object: dict[str, Any] | None = None
    transform: dict[str, Any] | None = None
    properties: dict[str, dict[str, Any]] = field(default_factory=dict)


class RecordingWindow:
    """Keeps commands for a viewer, packed when they are taken.

    Between two calls of `take` a later transform (object, property) of a path replaces an
    earlier one: a slow viewer gets the newest picture, not a queue.

    Parameters
    ----------
    writes : bool
        Whether its viewer writes words itself: labels are then commands of a kind
        "label", as JSON.
    """

    def __init__(self, writes: bool = False) -> None:
        self.writes = writes
        self._pack = _packer()
        self._nodes: dict[str, _Node] = {}
        self._pending: dict[tuple[str, str, str], dict[str, Any]] = {}

    def send(self, command: Command) -> None:
        """Record a command.

        Raises
        ------
        InputError
            For a kind that is no part of a picture (a request for an image, say).
        """
        self.record(command.lower())

    def record(self, data: dict[str, Any]) -> None:
        """`send` of a command that is plain already.

        Raises
        ------
        InputError
            For `data` of a command that draws nothing.
        """
        kind = data["type"]
        if kind not in _KINDS:
            raise InputError(
                "this window records a picture", expected=", ".join(_KINDS), got=kind
            )
        path = data["path"]
        if kind == "delete":
            self._forget(path)
            self._pending.pop((kind, path, ""), None)  # it comes last
            self._pending[kind, path, ""] = data
            return
        node = self._nodes.get(path)
        if node is None:
            node = self._nodes[path] = _Node()
        if kind == "set_transform":  # nearly all of them
            node.transform = self._pending[kind, path, ""] = data
        elif kind == "set_property":
            name = data["property"]
            node.properties[name] = self._pending[kind, path, name] = data
        else:
            # The viewer replaces the object, and with it what was set on the object
            # alone.
            if (own := path + "/<object>") in self._nodes:
                self._forget(own, "set_property")
            node.object = self._pending[kind, path, ""] = data

    def take(self) -> list[bytes]:
        """Commands since the last call, packed; they are then forgotten."""
        taken = [self._pack(data) for data in self._pending.values()]
        self._pending.clear()
        return taken

    def by_path(self) -> dict[tuple[str, str, str], bytes]:
        """The whole picture by (kind, path, property), without deletions."""
        kept: dict[tuple[str, str, str], bytes] = {}
        for path, node in self._nodes.items():
            for data in (node.object, node.transform):
                if data is not None:
                    kept[data["type"], path, ""] = self._pack(data)
            for name, data in node.properties.items():
                kept["set_property", path, name] = self._pack(data)
        return kept

    def snapshot(self) -> list[bytes]:
        """Commands that make the whole picture in a new viewer,
        or again in an old one.
        """
        roots = {path.split("/")[1] for path, node in self._nodes.items() if node.object}
        commands: list[dict[str, Any]] = [
            {"type": "delete", "path": f"/{root}"} for root in sorted(roots - _OWN_PARTS)
        ]
        for node in self._nodes.values():
            commands += [d for d in (node.object, node.transform) if d is not None]
            commands += node.properties.values()
        return [self._pack(data) for data in commands]

    def _forget(self, path: str, kind: str | None = None) -> None:
        """Drop what is known of a path and everything below it."""
        below = path + "/"
        for known in [p for p in self._nodes if p == path or p.startswith(below)]:
            del self._nodes[known]
        for key in [k for k in self._pending if k[1] == path or k[1].startswith(below)]:
            # An earlier delete is kept: the viewer may have more than this window knows.
            if key[0] != "delete" and kind in (None, key[0]):
                del self._pending[key]


def _packer() -> Callable[[dict[str, Any]], bytes]:
    """MessagePack in machine code: meshcat's own packer takes twenty times as long."""
    msgpack = imported("msgpack", "msgpack", "a picture in a page")

    def arrays(value: Any) -> Any:
        """Meshcat's typed arrays, in the words of this packer."""
        return msgpack.ExtType(value.type, value.data)

    pack = msgpack.Packer(default=arrays).pack
    text = imported("pydantic_core", "pydantic", "labels in a page").to_json

    def packed(command: dict[str, Any]) -> bytes:
        if "object" not in command or (label := command["object"].get("label")) is None:
            return pack(command)
        return text({"type": "label", "path": command["path"], **label})

    return packed
