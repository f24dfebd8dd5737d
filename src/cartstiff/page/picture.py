"""A mechanism's picture for one tab or one file: the scene on a window of its own."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import fields
from typing import Any

import numpy as np

from cartstiff.analysis.screws import Screw
from cartstiff.errors import UndefinedError
from cartstiff.mechanisms.contract import MechanismPosture
from cartstiff.mechanisms.elastic import ElasticMechanism
from cartstiff.page.messages import ViewState
from cartstiff.page.source import Cloud
from cartstiff.scene.appearance import Appearance
from cartstiff.scene.labels import number
from cartstiff.scene.scene import Scene
from cartstiff.scene.viewer import RecordingWindow, ViewerNode
from cartstiff.stiffness.compute import PostureStiffness
from cartstiff.vibration.modes import modes

# Fields that a state and an appearance share.
_ALIKE = {f.name for f in fields(Appearance)} & set(ViewState.model_fields)
_ALIKE -= {"axes", "ghost", "measures"}


class PageScene:
    """Draws postures; hands over what has changed, or everything."""

    def __init__(self, elastic: ElasticMechanism) -> None:
        self._window = RecordingWindow(writes=True)
        self._scene = Scene(ViewerNode(self._window, "/meshcat"), elastic)

    def draw(self, result: PostureStiffness, state: ViewState) -> dict[str, Any]:
        """Move everything to a posture; return the legend."""
        nodal = None
        if state.mode is not None:
            with suppress(UndefinedError):
                swings = modes(result)
                if state.mode <= len(swings.frequencies):
                    nodal = (
                        state.mode,
                        float(swings.frequencies[state.mode - 1]),
                        swings.nodal_axes[state.mode - 1],
                    )
        legend: dict[str, Any] = self._scene.draw(result, _appearance(state, nodal))
        measures = {
            freedom: facts["scale"]
            for freedom, facts in legend["ellipsoids"].items()
            if facts is not None and facts["shown"]
        }
        return {
            "lines": _legend_lines(legend),
            "notes": legend["notes"],
            "bar": _bar(legend["length"]),
            "measures": measures,
            "per_length": legend["length"]["scene_units_per_unit"],
            "screws": legend["screws"],
        }

    def assets(self, result: PostureStiffness, state: ViewState) -> dict[str, Any]:
        """Every part that another state needs is sent; what places them, see `Scene.assets`."""
        return self._scene.assets(result, _appearance(state))

    def along(self, postures: Sequence[MechanismPosture]) -> list[list[bytes]]:
        """Commands that bring the mechanism from each posture to the next; no numbers change."""
        pictures = []
        for posture in postures:
            self._scene.move(posture)
            pictures.append(self._window.take())
        return pictures

    def cloud(self, cloud: Cloud, quantity: str) -> dict[str, Any]:
        """Draw a map's points, coloured by a quantity; returns the facts of the colour bar."""
        values, words = cloud.values[quantity], None
        carried = {"value": values} | ({} if cloud.q is None else {"q": cloud.q})
        if values.dtype.kind == "U":  # a point carries the number of its word
            words, carried["value"] = np.unique(values, return_inverse=True)
        facts = self._scene.points(
            cloud.positions, values, quantity, cloud.units[quantity], carried=carried
        )
        return facts if words is None else facts | {"words": words.tolist()}

    def bounds(self, result: PostureStiffness) -> list[list[float]]:
        """Two corners, in the viewer's units, of what has to be in the picture at a posture."""
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


def _appearance(state: ViewState, nodal: tuple[int, float, Screw] | None = None) -> Appearance:
    """Return the appearance of the picture of a state."""
    measures = state.measures
    kept = None if measures is None else {str(f): one.model_dump() for f, one in measures.items()}
    return Appearance(
        **{name: getattr(state, name) for name in _ALIKE},
        axes=state.labels,
        ghost=None if state.ghost is None else tuple(state.ghost),
        nodal=nodal,
        measures=kept,
    )


# -- the legend in words ----------------------------------------------------------------------


def _legend_lines(legend: Mapping[str, Any]) -> list[dict[str, str]]:
    """Lines with a mark ("translation", "rotation", "force", ...) and a text.

    Parameters
    ----------
    legend : mapping
        From `Scene.draw`.
    """
    length = legend["length"]["unit"]
    lines = []
    for freedom, facts in legend["ellipsoids"].items():
        if facts is None:
            continue
        other = "rotation" if freedom == "translation" else "translation"
        text = f"{freedom} ({other} {legend['others']})"
        if not facts["shown"]:
            text += f" is not drawn: {facts['reason']}"
        else:
            text += f": {_radius(facts, length, legend['length']['bar'])}"
            text += f"; {facts['reason']}" if facts["reason"] else ""
        lines.append({"mark": freedom, "text": text})
    wrench = legend["wrench"]
    if wrench is not None:
        for kind in ("force", "moment"):
            if not wrench[kind]:
                continue
            scale, unit = wrench["scale"][kind], wrench["units"][kind]
            size = float(
                np.linalg.norm(wrench["wrench"][3:] if kind == "force" else wrench["wrench"][:3])
            )
            longer = _length(scale["length_per_decade"], length)
            text = (
                f"{kind}: {number(size, unit)} is {_length(wrench[kind], length)} long; "
                f"ten times the {kind} is {longer} longer"
            )
            law = f"length = {longer} log10(1 + {kind} / {number(scale['zero_at'], unit)})"
            lines.append({"mark": kind, "text": text, "title": law})
    moved = legend["deflection"]
    if moved is not None:
        if moved["shown"]:
            at = ", ".join(_few(x) for x in moved["acts_at"])
            place = f"at ({at}) {length} of M" if any(moved["acts_at"]) else "at the origin of M"
            text = (
                f"deflection enlarged {_few(moved['exaggeration'])} times, under the load {place}"
            )
        else:
            text = f"deflection: {moved['reason']}"
        lines.append({"mark": "deflection", "text": text})
    tension = legend["tension"]
    if tension is not None and tension.get("limits", [0, 0])[1]:
        low, high = tension["limits"]
        ends = f"pink {_few(low)} (compression) to green {_few(high)} {tension['unit']} (tension)"
        lines.append({"mark": "tension", "text": f"legs: {ends}"})
    for name, words in (("screws", "eigenscrews"), ("centres", "centres")):
        facts = legend[name]
        if isinstance(facts, Mapping) and facts.get("shown") is False:
            lines.append({"mark": name, "text": f"{words} not drawn: {facts['reason']}"})
    if (nodal := legend.get("nodal")) is not None:
        text = f"{nodal['name']}, {_few(nodal['value'])} Hz"
        if nodal["shown"]:
            text += f", pitch {number(nodal['pitch'], length)}"
        else:
            text += f" not drawn: {nodal['reason']}"
        lines.append({"mark": "nodal", "text": text})
    lines += [{"mark": "note", "text": str(note)} for note in legend["notes"]]
    return lines


def _radius(facts: Mapping[str, Any], length: str, bar: float) -> str:
    """Return the meaning of a radius, by the example of the scale bar."""
    scale, unit = facts["scale"], facts["unit"]
    if scale["kind"] == "log":
        return (
            f"radius 0 at {number(scale['zero_at'], unit)}, and "
            f"{_length(scale['length_per_decade'], length)} for each factor of 10 (rings)"
        )
    is_root = scale["kind"] == "root"
    value = scale["value_per_length"] * bar ** (2 if is_root else 1)
    words = f"{_length(bar, length)} = {number(value, unit)}"
    words += " (square-root scale)" if is_root else ""
    if facts["cut"]:
        words += f"; cut at {_length(scale['cut_at'], length)}: the stiffest axis is longer"
    return words


def _bar(length: Mapping[str, Any]) -> dict[str, Any]:
    """A round length of the machine's size: its words, and how long it is in the viewer."""
    bar = length["bar"]
    return {
        "text": _length(bar, length["unit"]),
        "length": bar * length["scene_units_per_unit"],
    }


def _length(x: float, unit: str) -> str:
    """A length of the picture: "10 cm"."""
    return f"{_few(100.0 * x)} cm" if unit == "m" and abs(x) < 1.0 else f"{_few(x)} {unit}"


def _few(x: float | None) -> str:
    text = "–" if x is None else f"{float(f'{x:.3g}'):.6g}"
    return text.replace("e+0", "e").replace("e-0", "e-").replace("e+", "e")
