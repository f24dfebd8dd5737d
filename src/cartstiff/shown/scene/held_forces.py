"""The forces on M's origin that the drives hold: a body whose points are forces.

A force reaches from M's origin as far as the scale says; the corners are the vertices of
`cartstiff.answer.held_forces.HeldForces.polytope`.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cartstiff.answer.held_forces import held_forces
from cartstiff.core import numerics
from cartstiff.core.arrays import Array
from cartstiff.core.stiffness.compute import PostureStiffness
from cartstiff.shown.scene import objects, theme
from cartstiff.shown.scene.scales import round_number
from cartstiff.shown.scene.viewer import ViewerNode

#: Most length of the longest force, and size of the ball at the load's end, over the
#: mechanism's size; opacity of the body.
_LONGEST, _BALL, _OPACITY = 0.3, 0.011, 0.14


class HeldForcesShown(NamedTuple):
    """The polytope of forces at a posture.

    Attributes
    ----------
    corners : ndarray (k, 3) or None
        Forces along the axes of F; None where there are none to show.
    reason : str or None
        Why there are none.
    load : ndarray (3,) or None
        The force that was given, along the axes of F.
    """

    corners: Array | None
    reason: str | None
    load: Array | None

    @classmethod
    def of(cls, result: PostureStiffness) -> HeldForcesShown:
        """That of a posture."""
        R, held = result.pose[:3, :3], held_forces(result)
        if held is None:
            return cls(None, "no wrench balances the posture", None)
        if not held.is_limited:
            return cls(None, "no limit of a drive's force is known", None)
        corners = held.polytope(R)
        if corners is None:
            words = "some have no bound, or the drives do not hold the weight"
            return cls(None, words, None)
        load = R @ held.wrench[3:] if result._load_is_given else None
        return cls(corners, None, load)

    @property
    def sizes(self) -> Array:
        """Sizes (k,) of the forces at the corners."""
        return np.linalg.norm(
            np.zeros((0, 3)) if self.corners is None else self.corners, axis=1
        )


def faces(points: Array) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Triangles (m, 3) and edges (k, 2) of the convex hull of points (n, 3), by number.

    Points of a plane have one face, those of a line an edge alone.
    """
    # SciPy takes long to import.
    from scipy.spatial import ConvexHull

    apart = points - points.mean(axis=0)
    _, values, Vt = np.linalg.svd(apart, full_matrices=False)
    rank = numerics.rank(values)
    if rank < 2:
        along = apart @ Vt[0]
        return np.zeros((0, 3), int), np.array([[along.argmin(), along.argmax()]])
    hull = ConvexHull(apart @ Vt[:rank].T)
    if rank == 2:
        ring = hull.vertices
        fan = [[ring[0], a, b] for a, b in pairwise(ring[1:])]
        return np.array(fan), np.column_stack([ring, np.roll(ring, -1)])
    # An edge is where two triangles of different planes meet.
    planes, corners = hull.equations, hull.simplices.tolist()
    edges = [
        sorted({*corners[i]} & {*corners[j]})
        for i, neighbours in enumerate(hull.neighbors.tolist())
        for j in neighbours
        if i < j and np.abs(planes[i] - planes[j]).max() > numerics.NEGLIGIBLE_SHARE
    ]
    return hull.simplices, np.array(edges)


class HeldForcesPicture:
    """Body, edges, and a ball at the end of the load, about M's origin along F's axes."""

    def __init__(self, node: ViewerNode, size: float, look: theme.Theme) -> None:
        self._node, self._size, self._colour = node, size, look.load
        self._made = False

    def draw(self, result: PostureStiffness, unit: str) -> dict[str, Any]:
        """Show what a posture holds; returns the scale, or why there is nothing."""
        found = HeldForcesShown.of(result)
        if found.corners is None:
            self.hide()
            return {"shown": False, "reason": found.reason}
        # A round number, so that the body grows while the drives hold more.
        per = 1.0 / round_number(_LONGEST * self._size / float(found.sizes.max()))
        points = found.corners / per
        triangles, edges = faces(points)
        place, self._made = self._node, True
        if len(triangles):
            body = objects.mesh(points, triangles)
            solid = objects.solid(body, self._colour, _OPACITY, flatShading=True)
            place["body"].set_object(solid)
        place["body"].show(bool(len(triangles)))
        place["edges"].set_object(objects.lines(points[edges.ravel()], self._colour))
        place["load"].show(found.load is not None)
        if found.load is not None:
            ball = objects.sphere(_BALL * self._size)
            place["load"].set_object(objects.solid(ball, self._colour))
            place["load"].move_to((found.load / per).tolist())
        place.move_to(result.pose[:3, 3].tolist())
        place.show(True)
        return {"shown": True, "reason": None, "per_length": per, "unit": unit}

    def hide(self) -> None:
        """Show nothing."""
        if self._made:
            self._node.show(False)
