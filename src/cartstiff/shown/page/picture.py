"""A mechanism's picture for one tab or one file: the scene on a window of its own."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import fields
from typing import Any

import numpy as np

from cartstiff.answer.analysis.screws import Screw
from cartstiff.answer.vibration.modes import modes
from cartstiff.core.arrays import Array
from cartstiff.core.errors import UndefinedError
from cartstiff.core.mechanisms.elastic import ElasticMechanism
from cartstiff.core.stiffness.compute import PostureStiffness
from cartstiff.shown.page.messages import ViewState
from cartstiff.shown.page.source import Cloud
from cartstiff.shown.scene.appearance import Appearance
from cartstiff.shown.scene.enlarged import factor_for, posture_after, turned_by
from cartstiff.shown.scene.scene import Scene
from cartstiff.shown.scene.swing import swing_of
from cartstiff.shown.scene.viewer import RecordingWindow, ViewerNode

# Fields that a state and an appearance share.
_ALIKE = {f.name for f in fields(Appearance)} & set(ViewState.model_fields)
_ALIKE -= {"axes", "ghost", "measures", "deflection"}


class PageScene:
    """Draws postures; hands over what has changed, or everything."""

    def __init__(self, elastic: ElasticMechanism) -> None:
        self._window = RecordingWindow(writes=True)
        self._scene = Scene(ViewerNode(self._window, "/meshcat"), elastic)

    def draw(
        self,
        result: PostureStiffness,
        state: ViewState,
        moved: Mapping[str, Any] | None = None,
    ) -> dict[str, Any]:
        """Move everything to a posture; return the legend, see `Scene.draw`.

        Where a load has `moved` the body (see
        `cartstiff.shown.page.shown.shown_numbers`), the legend says under "rest" how much
        that is enlarged. Of a mode that is one end of its swing.
        """
        nodal, factor, rest = None, None, None
        if state.mode is not None:
            with suppress(UndefinedError):
                swings = modes(result)
                if state.mode <= len(swings.frequencies):
                    nodal = (
                        state.mode,
                        float(swings.frequencies[state.mode - 1]),
                        swings.nodal_axes[state.mode - 1],
                    )
                    step, far = swing_of(swings, state.mode)
                    factor, rest = self._away(result, step, far, 1.0, None)
        if moved is not None and not moved["resisted"]:
            moved = None
        if rest is None and state.deflection and moved is not None:
            factor, rest = self._rest(result, state, moved)
        quantity = state.drawn or (state.quantity if moved is None else "compliance")
        look = _appearance(
            state, nodal, rest=rest, quantity=quantity, said=state.quantity
        )
        mode = None if nodal is None else nodal[0]
        away = factor and {"enlarged": factor, "mode": mode}
        return {**self._scene.draw(result, look), "rest": away}

    def _rest(
        self, result: PostureStiffness, state: ViewState, moved: Mapping[str, Any]
    ) -> tuple[float | None, tuple[float, ...] | None]:
        """How much a deflection is enlarged, and the coordinates without the load."""
        mechanism, motion = result.mechanism, moved["motion"]
        if motion is None:
            return None, None
        step, lengths = np.array(motion), result.posture.coordinate_lengths
        far = max(np.hypot.reduce(moved[key]) for key in ("displacement", "of_frame"))
        turned = turned_by(mechanism, step, lengths)
        return self._away(result, step, far, turned, state.enlarged)

    def _away(
        self,
        result: PostureStiffness,
        step: Array,
        moved: float,
        turned: float,
        wanted: float | None,
    ) -> tuple[float | None, tuple[float, ...] | None]:
        """How much a step of the coordinates is enlarged, and those before it."""
        factor = factor_for(moved, turned, self._scene.size, wanted)
        if factor is None:
            return None, None
        posture = posture_after(result.mechanism, result.q, -factor * step)
        return (None, None) if posture is None else (factor, tuple(posture.q.tolist()))

    def assets(self, result: PostureStiffness, state: ViewState) -> dict[str, Any]:
        """Every part that another state needs is sent.

        What places them, see `Scene.assets`.
        """
        return self._scene.assets(result, _appearance(state))

    def cloud(
        self, cloud: Cloud, quantity: str, allowed: tuple[float, str] | None = None
    ) -> dict[str, Any]:
        """Draw a map's points, coloured by a quantity, of which a value may be `allowed`.

        Returns the facts of the colour bar.
        """
        values, words = cloud.values[quantity], None
        carried = {"value": values}
        if cloud.q is not None:
            carried["q"] = cloud.q
        if values.dtype.kind == "U":  # a point carries the number of its word
            words, carried["value"] = np.unique(values, return_inverse=True)
        facts = self._scene.points(
            cloud.positions,
            values,
            quantity,
            cloud.units[quantity],
            carried=carried,
            better=cloud.better.get(quantity),
            allowed=allowed,
        )
        if words is None:
            return facts
        return facts | {"words": words.tolist()}

    def keep_in_view(self, positions: Array) -> None:
        """Have positions (N, 3) on the way of a trajectory seen."""
        self._scene.keep_in_view("way", positions)

    def bounds(self, result: PostureStiffness) -> list[list[float]]:
        """Two corners, in the viewer's units, of what has to be in the picture
        at a posture.
        """
        return self._scene.bounds(result).tolist()

    def changes(self) -> list[bytes]:
        """Commands since the last call."""
        return self._window.take()

    def by_path(self) -> dict[tuple[str, str, str], bytes]:
        """Commands that make the whole picture, by (kind, path, property)."""
        return self._window.by_path()

    def whole(self) -> list[bytes]:
        """Commands that make the whole picture; nothing is left to hand over."""
        self._window.take()
        return self._window.snapshot()


def _appearance(
    state: ViewState, nodal: tuple[int, float, Screw] | None = None, **others: Any
) -> Appearance:
    """Return the appearance of the picture of a state, some of its fields given."""
    measures = state.measures
    if measures is None:
        kept = None
    else:
        kept = {str(f): one.model_dump() for f, one in measures.items()}
    alike = {name: getattr(state, name) for name in _ALIKE}
    return Appearance(
        **(alike | others),
        axes=state.labels,
        ghost=None if state.ghost is None else tuple(state.ghost),
        nodal=nodal,
        measures=kept,
    )
