"""Stiffness over many postures: where to look, computing, files, reading, pictures.

The names below are loaded when first used.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from cartstiff.lazy import lazy_names

if TYPE_CHECKING:
    from cartstiff.maps.cartesian import CartesianGrid as CartesianGrid
    from cartstiff.maps.opening import open_map as open_map
    from cartstiff.maps.pictures import draw_map as draw_map
    from cartstiff.maps.reading import best as best
    from cartstiff.maps.reading import slice_map as slice_map
    from cartstiff.maps.reading import summary as summary
    from cartstiff.maps.reading import worst as worst
    from cartstiff.maps.run import compute_map as compute_map
    from cartstiff.maps.sampling import Axis as Axis
    from cartstiff.maps.sampling import Grid as Grid
    from cartstiff.maps.sampling import RandomPostures as RandomPostures
    from cartstiff.maps.sampling import Trajectory as Trajectory

_HOMES = {
    "Axis": "cartstiff.maps.sampling",
    "CartesianGrid": "cartstiff.maps.cartesian",
    "Grid": "cartstiff.maps.sampling",
    "RandomPostures": "cartstiff.maps.sampling",
    "Trajectory": "cartstiff.maps.sampling",
    "best": "cartstiff.maps.reading",
    "compute_map": "cartstiff.maps.run",
    "draw_map": "cartstiff.maps.pictures",
    "open_map": "cartstiff.maps.opening",
    "slice_map": "cartstiff.maps.reading",
    "summary": "cartstiff.maps.reading",
    "worst": "cartstiff.maps.reading",
}

__all__ = [
    "Axis",
    "CartesianGrid",
    "Grid",
    "RandomPostures",
    "Trajectory",
    "best",
    "compute_map",
    "draw_map",
    "open_map",
    "slice_map",
    "summary",
    "worst",
]

__getattr__, __dir__ = lazy_names(__name__, _HOMES, __all__)
