"""Pictures in a browser: the scene, and the page around it.

The names below draw in any ``meshcat.Visualizer``; they are loaded when first used.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from cartstiff.lazy import lazy_names

if TYPE_CHECKING:
    from cartstiff.view.arrows import add_wrench as add_wrench
    from cartstiff.view.ellipsoids import add_ellipsoid as add_ellipsoid
    from cartstiff.view.look import Look as Look
    from cartstiff.view.points import add_path as add_path
    from cartstiff.view.points import add_points as add_points
    from cartstiff.view.scales import Linear as Linear
    from cartstiff.view.scales import Logarithmic as Logarithmic
    from cartstiff.view.scene import Scene as Scene
    from cartstiff.view.screws import add_screw as add_screw
    from cartstiff.view.window import RecordingWindow as RecordingWindow

_HOMES = {
    "Linear": "cartstiff.view.scales",
    "Logarithmic": "cartstiff.view.scales",
    "Look": "cartstiff.view.look",
    "RecordingWindow": "cartstiff.view.window",
    "Scene": "cartstiff.view.scene",
    "add_ellipsoid": "cartstiff.view.ellipsoids",
    "add_path": "cartstiff.view.points",
    "add_points": "cartstiff.view.points",
    "add_screw": "cartstiff.view.screws",
    "add_wrench": "cartstiff.view.arrows",
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
