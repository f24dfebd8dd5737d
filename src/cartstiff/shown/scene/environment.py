"""Everything around a mechanism: unit of length, ground, background, camera."""

from __future__ import annotations

from math import floor, log10
from typing import Any

import numpy as np

from cartstiff.core import numerics
from cartstiff.core.arrays import Array
from cartstiff.core.errors import UnknownNameError
from cartstiff.shown.scene import objects, theme
from cartstiff.shown.scene.labels import HEIGHT, Label
from cartstiff.shown.scene.scales import round_number
from cartstiff.shown.scene.viewer import ViewerNode

#: Directions from the mechanism to the camera.
PRESETS = {
    "iso": (1.0, -1.05, 0.75),
    "front": (1.0, 0.0, 0.12),
    "side": (0.0, -1.0, 0.12),
    "top": (0.0, -1e-3, 1.0),
}
_METRES = {
    "m": 1.0,
    "cm": 1e-2,
    "mm": 1e-3,
    "um": 1e-6,
    "µm": 1e-6,
    "in": 0.0254,
    "ft": 0.3048,
    "km": 1e3,
}
# Sizes in scene units that the viewer shows well: its camera sees from 0.01 to 100 units.
_SMALLEST, _LARGEST = 0.4, 8.0
_FIELD_OF_VIEW = 38.0
# Intensities of the viewer's lights: where all reach it a white surface is not burnt out.
_LIGHTS = {
    "AmbientLight": 0.42,
    "PointLightNegativeX": 0.3,
    "PointLightPositiveX": 0.3,
    "FillLight": 0.2,
}


def scene_units(size: float, unit: str) -> float:
    """Scene units per unit of length: metres, or a power of ten of them.

    One unit of the scene is a metre where the mechanism is between 0.4 m and 8 m large;
    else as many powers of ten more or less as bring it into that range. A unit that is
    not known counts as one metre.
    """
    metres = _METRES.get(unit, 1.0)
    actual = size * metres
    if not 0.0 < actual < np.inf or _SMALLEST <= actual <= _LARGEST:
        return metres
    return metres * 10.0 ** -floor(log10(actual / _SMALLEST))


class Environment:
    """Ground, background and camera of a mechanism.

    Parameters
    ----------
    node : ViewerNode
        Place of the mechanism, in its own unit of length.
    points : ndarray (n, 3)
        Points that have to be in the picture.
    unit : str
        Unit of length.
    """

    def __init__(self, node: ViewerNode, points: Array, unit: str) -> None:
        self.size = numerics.norm(np.ptp(points, axis=0)) or 1.0
        self.scale = scene_units(self.size, unit)
        self._points = points
        self._unit = unit
        self.node = node
        #: Distance of the lines on the ground.
        self.spacing = round_number(0.14 * self.size)
        node.enlarged = self.scale
        self.frame(points)
        self._root = ViewerNode(node.window, "")
        for name in ("Grid", "Axes"):
            self._root[name].show(False)
        self._theme: theme.Theme | None = None

    def frame(self, points: Array) -> None:
        """Put the middle of some points (n, 3) where the viewer's camera turns about."""
        self._low, self._high = points.min(axis=0), points.max(axis=0)
        self._middle = 0.5 * (self._low + self._high)
        place = np.diag([self.scale] * 3 + [1.0])
        place[:3, 3] = -self.scale * self._middle
        self.node.set_transform(place)

    def frame_also(self, corners: Array) -> None:
        """The same with what else has to be in the picture."""
        self.frame(np.concatenate([self._points, corners]))

    def seen(self, points: Array) -> Array:
        """Points (n, 3) of F in the units of the viewer, from where its camera
        turns about.
        """
        return self.scale * (points - self._middle)

    def facts(self) -> dict[str, Any]:
        """Scale and origin of the viewer's units, and the height of a label."""
        return {
            "scale": self.scale,
            "middle": self._middle.tolist(),
            "label": HEIGHT / self.scale,
            "bar": self.legend()["bar"],
        }

    def dress(self, look: theme.Theme) -> None:
        """Background and ground in the colours of a theme."""
        if look is self._theme:
            return
        self._theme = look
        for name, intensity in _LIGHTS.items():
            self._root["Lights"][name]["<object>"].set_property("intensity", intensity)
        background = self._root["Background"]
        background.set_property("top_color", theme.fractions(look.top))
        background.set_property("bottom_color", theme.fractions(look.bottom))
        if self._low[2] > -0.05 * self.size:
            level = min(0.0, float(self._low[2]))
        else:
            level = self._low[2]
        self.node["ground"].set_object(self._ground(look, level - 1e-3 * self.size))
        near = self._points[self._points[:, 2] < level + 0.1 * self.size, :2]
        # It stands on its base: it neither hangs nor lies in a plane.
        if level > -0.05 * self.size and 0 < len(near) < len(self._points):
            spot = np.append(near.mean(axis=0), level - 2e-3 * self.size)
            reach = float(np.linalg.norm(near - spot[:2], axis=1).max())
            radii = np.linspace(0.7 * reach, reach + 0.2 * self.size, 16)
            self.node["ground"]["shadow"].set_object(objects.shadow(spot, radii))

    def _ground(self, look: theme.Theme, level: float) -> objects.Object:
        step = self.spacing
        centre = np.round(0.5 * (self._low + self._high)[:2] / step) * step
        half = np.ceil(0.85 * self.size / step) * step
        across = np.arange(-half, half + 0.5 * step, step)
        ends = []
        for x in across:
            ends += [[x, -half, 0], [x, half, 0], [-half, x, 0], [half, x, 0]]
        lines = np.array(ends) + np.array([centre[0], centre[1], level])
        return objects.lines(lines, look.grid, 0.8)

    def camera(self, preset: str = "iso") -> None:
        """View from "iso", "front", "side" or "top"; "fit" is the first of them.

        Raises
        ------
        UnknownNameError
            For another name.
        """
        name = "iso" if preset in ("fit", "home") else preset
        if name not in PRESETS:
            raise UnknownNameError("view", preset, ("fit", "home", *PRESETS))
        direction = np.array(PRESETS[name])
        direction /= np.linalg.norm(direction)
        across = numerics.norm(self._high - self._low) or self.size
        distance = (0.1 + 0.48 / np.tan(np.radians(_FIELD_OF_VIEW) / 2.0)) * across
        eye = self.scale * distance * direction
        # The viewer's camera lives in a frame with y up.
        place = self._root["Cameras"]["default"]["rotated"]["<object>"]
        place.set_property("fov", _FIELD_OF_VIEW)
        place.set_property("position", [float(eye[0]), float(eye[2]), float(-eye[1])])

    def frames(self, look: theme.Theme) -> ViewerNode:
        """Draw the axes of F and M; returns the place of M."""
        length = 0.11 * self.size
        for name in ("F", "M"):
            node = self.node[name]
            objects.frame(node, length)
            Label(node["name"], look).show(name, [-0.3 * length] * 3)
        return self.node["M"]

    def legend(self) -> dict[str, Any]:
        """Lengths: the unit, the distance of the lines on the ground,
        a round one for examples.
        """
        return {
            "unit": self._unit,
            "scene_units_per_unit": self.scale,
            "grid": self.spacing,
            "size": self.size,
            "bar": round_number(0.12 * self.size),
        }
