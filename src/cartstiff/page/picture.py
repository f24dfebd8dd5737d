"""A mechanism's picture for one tab or one file: the scene on a window of its own."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from typing import Any

from cartstiff.errors import UndefinedError
from cartstiff.mechanisms.contract import MechanismPosture
from cartstiff.mechanisms.elastic import ElasticMechanism
from cartstiff.page.legend import legend_lines
from cartstiff.page.source import Cloud
from cartstiff.page.state import State
from cartstiff.scene.canvas import Node
from cartstiff.scene.scene import Look, Scene
from cartstiff.scene.window import RecordingWindow
from cartstiff.stiffness.compute import PostureStiffness
from cartstiff.vibration.modes import modes

__all__ = ["Picture"]


class Picture:
    """Draws postures; hands over what has changed, or everything."""

    def __init__(self, elastic: ElasticMechanism) -> None:
        self._window = RecordingWindow()
        self._scene = Scene(Node(self._window, "/meshcat"), elastic)

    def draw(self, result: PostureStiffness, state: State) -> dict[str, Any]:
        """Move everything to a posture; returns what the picture's sizes mean."""
        nodal = None
        if state.mode is not None:
            with suppress(UndefinedError):
                found = modes(result)
                if state.mode <= len(found.frequencies):
                    nodal = (
                        state.mode,
                        float(found.frequencies[state.mode - 1]),
                        found.nodal_axes[state.mode - 1],
                    )
        look = Look(
            connection=state.connection, quantity=state.quantity, translation=state.translation,
            rotation=state.rotation, scale=state.scale, axes=state.labels,
            labels=state.labels, wrench=state.wrench,
            deflection=state.deflection, screws=state.screws, centres=state.centres,
            ghost=None if state.ghost is None else tuple(state.ghost), point=state.point,
            theme=state.theme, nodal=nodal,
        )  # fmt: skip
        legend: dict[str, Any] = self._scene.draw(result, look)
        return {"lines": legend_lines(legend), "notes": legend["notes"]}

    def along(self, postures: Sequence[MechanismPosture]) -> list[list[bytes]]:
        """Commands that bring the mechanism from each posture to the next; no numbers change."""
        found = []
        for posture in postures:
            self._scene.move(posture)
            found.append(self._window.take())
        return found

    def cloud(self, cloud: Cloud, quantity: str) -> dict[str, Any]:
        """Draw a map's points, coloured by a quantity; returns the facts of the colour bar."""
        return self._scene.points(
            cloud.positions, cloud.values[quantity], quantity, cloud.units[quantity]
        )

    def bounds(self, result: PostureStiffness) -> list[list[float]]:
        """Two corners, in the viewer's units, of what has to be in the picture at a posture."""
        return self._scene.bounds(result).tolist()

    def changes(self) -> list[bytes]:
        """Commands since the last call."""
        return self._window.take()

    def changes_by_path(self) -> dict[tuple[str, str, str], bytes]:
        """As `changes`, by (kind, path, property)."""
        return self._window.take_by_path()

    def everything_by_path(self) -> dict[tuple[str, str, str], bytes]:
        """The whole picture by (kind, path, property); nothing is left to hand over."""
        self._window.take()
        return self._window.by_path()

    def whole(self) -> list[bytes]:
        """Commands that make the whole picture; nothing is left to hand over."""
        self._window.take()
        return self._window.snapshot()
