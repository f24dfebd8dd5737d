"""A viewer without a screen: takes packed commands and knows where everything is.

Written from meshcat's own viewer (paths, objects below "<object>", transforms of places), not from
the code under test.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import umsgpack

with warnings.catch_warnings():
    warnings.simplefilter("ignore")  # meshcat imports a part of zmq that is going away
    import meshcat
    import meshcat.geometry

__all__ = ["Viewer", "meshcat", "visualizer"]


def visualizer(window: Any) -> meshcat.Visualizer:
    """Meshcat's own view into a window."""
    return meshcat.Visualizer(window=window)


@dataclass
class Place:
    object: dict[str, Any] | None = None
    matrix: np.ndarray | None = None
    properties: dict[str, Any] = field(default_factory=dict)
    #: Properties of the object alone; a new object has none.
    own: dict[str, Any] = field(default_factory=dict)


class Viewer:
    """The state a browser would be in."""

    def __init__(self, commands: Iterable[bytes] = ()) -> None:
        self.places: dict[str, Place] = {}
        self.kinds: list[str] = []
        self.feed(commands)

    def feed(self, commands: Iterable[bytes]) -> Viewer:
        for packed in commands:
            self._take(umsgpack.unpackb(packed))
        return self

    def _take(self, command: dict[str, Any]) -> None:
        kind, path = command["type"], command["path"]
        self.kinds.append(kind)
        if kind == "delete":
            for known in [p for p in self.places if p == path or p.startswith(path + "/")]:
                del self.places[known]
            return
        on_object = path.endswith("/<object>")
        place = self.places.setdefault(path.removesuffix("/<object>"), Place())
        if kind == "set_object":
            place.object, place.own = command["object"], {}
        elif kind == "set_transform":
            assert len(command["matrix"]) == 16
            place.matrix = np.array(command["matrix"]).reshape(4, 4).T
        elif kind == "set_property":
            (place.own if on_object else place.properties)[command["property"]] = command["value"]
        else:
            raise AssertionError(kind)

    def state(self) -> dict[str, tuple[Any, ...]]:
        """Everything, for comparison."""
        return {
            path: (p.object, None if p.matrix is None else p.matrix.tolist(), p.properties, p.own)
            for path, p in self.places.items()
        }

    def world(self, path: str, root: str = "/meshcat/cartstiff") -> np.ndarray:
        """Motion of a place in its root: by default F, in the mechanism's unit."""
        M = np.eye(4)
        while path != root:
            place = self.places.get(path)
            if place is not None and place.matrix is not None:
                M = place.matrix @ M
            path = path.rsplit("/", 1)[0]
        return M

    def drawn(self, path: str) -> np.ndarray:
        """The same of the object at a place, with the object's own matrix."""
        place = self.places[path]
        assert place.object is not None, path
        own = place.object["object"].get("matrix", np.eye(4).ravel())
        return self.world(path) @ np.array(own).reshape(4, 4).T

    def visible(self, path: str) -> bool:
        """Whether an object is there and neither it nor anything above is hidden."""
        if path not in self.places or self.places[path].object is None:
            return False
        while path:
            place = self.places.get(path)
            if place is not None and place.properties.get("visible") is False:
                return False
            path = path.rsplit("/", 1)[0]
        return True

    def below(self, path: str) -> list[str]:
        """Visible objects at a place and below."""
        return [
            p for p in self.places if (p == path or p.startswith(path + "/")) and self.visible(p)
        ]

    def text(self, path: str) -> str:
        """What a visible label says."""
        assert self.visible(path), path
        place = self.places[path]
        assert place.object is not None
        assert place.object["object"]["type"] == "Sprite"
        return place.object["object"]["userData"]["text"]
