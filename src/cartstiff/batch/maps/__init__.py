"""Stiffness over many postures: where to look, computing, files, reading, pictures.

The names below are loaded when first used.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from cartstiff.lazy import lazy_names

if TYPE_CHECKING:
    from cartstiff.batch.maps.cartesian import CartesianGrid as CartesianGrid
    from cartstiff.batch.maps.pictures import draw_map as draw_map
    from cartstiff.batch.maps.reading import best as best
    from cartstiff.batch.maps.reading import slice_map as slice_map
    from cartstiff.batch.maps.reading import summary as summary
    from cartstiff.batch.maps.reading import worst as worst
    from cartstiff.batch.maps.run import compute_map as compute_map
    from cartstiff.batch.maps.sampling import Axis as Axis
    from cartstiff.batch.maps.sampling import Grid as Grid
    from cartstiff.batch.maps.sampling import RandomPostures as RandomPostures
    from cartstiff.batch.maps.sampling import Trajectory as Trajectory
    from cartstiff.batch.store import open_map as open_map

_HOMES = {
    "Axis": "cartstiff.batch.maps.sampling",
    "CartesianGrid": "cartstiff.batch.maps.cartesian",
    "Grid": "cartstiff.batch.maps.sampling",
    "RandomPostures": "cartstiff.batch.maps.sampling",
    "Trajectory": "cartstiff.batch.maps.sampling",
    "best": "cartstiff.batch.maps.reading",
    "compute_map": "cartstiff.batch.maps.run",
    "draw_map": "cartstiff.batch.maps.pictures",
    "open_map": "cartstiff.batch.store",
    "slice_map": "cartstiff.batch.maps.reading",
    "summary": "cartstiff.batch.maps.reading",
    "worst": "cartstiff.batch.maps.reading",
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
