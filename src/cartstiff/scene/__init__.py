"""Stiffness drawn in any meshcat viewer.

The names below draw in any ``meshcat.Visualizer``; they are loaded when first used.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from cartstiff.lazy import lazy_names

if TYPE_CHECKING:
    from cartstiff.scene.arrows import add_wrench as add_wrench
    from cartstiff.scene.ellipsoids import add_ellipsoid as add_ellipsoid
    from cartstiff.scene.look import Look as Look
    from cartstiff.scene.points import add_path as add_path
    from cartstiff.scene.points import add_points as add_points
    from cartstiff.scene.scales import Linear as Linear
    from cartstiff.scene.scales import Logarithmic as Logarithmic
    from cartstiff.scene.scene import Scene as Scene
    from cartstiff.scene.screws import add_screw as add_screw
    from cartstiff.scene.window import RecordingWindow as RecordingWindow

_HOMES = {
    "Linear": "cartstiff.scene.scales",
    "Logarithmic": "cartstiff.scene.scales",
    "Look": "cartstiff.scene.look",
    "RecordingWindow": "cartstiff.scene.window",
    "Scene": "cartstiff.scene.scene",
    "add_ellipsoid": "cartstiff.scene.ellipsoids",
    "add_path": "cartstiff.scene.points",
    "add_points": "cartstiff.scene.points",
    "add_screw": "cartstiff.scene.screws",
    "add_wrench": "cartstiff.scene.arrows",
}

__all__ = [
    "Linear",
    "Logarithmic",
    "Look",
    "RecordingWindow",
    "Scene",
    "add_ellipsoid",
    "add_path",
    "add_points",
    "add_screw",
    "add_wrench",
]

__getattr__, __dir__ = lazy_names(__name__, _HOMES, __all__)
