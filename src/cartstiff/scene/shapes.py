"""Small pieces that pictures are put together from: rods, dashed rods, arrows, frames, plates."""

from __future__ import annotations

from math import sqrt

import numpy as np

from cartstiff import numerics
from cartstiff.geometry.se3 import Array
from cartstiff.scene import objects, theme
from cartstiff.scene.canvas import Node

#: three.js draws cylinders along y: turned along x or z.
Y_TO_X = np.array([[0.0, 1, 0, 0], [-1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
Y_TO_Z = np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])


def rotation_to(direction: Array) -> Array:
    """A rotation (3, 3) whose x axis is a direction, which need not be a unit vector."""
    # In plain numbers: on three of them NumPy's calls cost more than the arithmetic.
    a, b, c = direction.tolist()
    return np.array(axes_along(a, b, c, sqrt(a * a + b * b + c * c))).T


def axes_along(a: float, b: float, c: float, size: float) -> tuple[list[float], ...]:
    """Columns of `rotation_to` a direction of a size, plain numbers."""
    a, b, c = a / size, b / size, c / size
    if abs(a) < 0.6:  # y is across the x axis of the parent, or across its z axis
        n = sqrt(b * b + c * c)
        return [a, b, c], [0.0, c / n, -b / n], [-n, a * b / n, a * c / n]
    n = sqrt(a * a + b * b)
    return [a, b, c], [-b / n, a / n, 0.0], [-a * c / n, -b * c / n, n]


def segment(start: Array, end: Array) -> Array:
    """Motion (4, 4) that takes a rod of unit length along x between two points; thickness stays."""
    x, y, z = segment_columns(start.tolist(), end.tolist())
    M = np.eye(4)
    M[:3] = np.array([x, y, z, start.tolist()]).T
    return M


def segment_columns(start: list[float], end: list[float]) -> tuple[list[float], ...]:
    """The first three columns of `segment`."""
    (r, s, t), (u, v, w) = start, end
    a, b, c = u - r, v - s, w - t
    length = sqrt(a * a + b * b + c * c)
    if length > 0.0:
        x, y, z = axes_along(a, b, c, length)
    else:
        x, y, z = [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]
    stretched = max(length, numerics.CLOSE)
    return [stretched * c for c in x], y, z


def rod(radius: float, colour: int, opacity: float = 1.0) -> objects.Object:
    """A rod from the origin to x = 1."""
    M = Y_TO_X.copy()
    M[0, 3] = 0.5
    return objects.solid(objects.cylinder(radius, 1.0, 14), colour, opacity, M)


def dashed_rod(radius: float, colour: int, dashes: int = 9, opacity: float = 1.0) -> objects.Object:
    """A rod from the origin to x = 1 with gaps."""
    n = 8
    angle = np.arange(n) * 2 * np.pi / n
    ring = np.stack([np.zeros(n), radius * np.cos(angle), radius * np.sin(angle)], axis=1)
    i = np.arange(n)
    j = (i + 1) % n
    walls = np.concatenate([np.stack([i, j, n + j], 1), np.stack([i, n + j, n + i], 1)])
    positions, faces = [], []
    for k in range(dashes):
        for x in (2 * k, 2 * k + 1):
            positions.append(ring + np.array([x / (2 * dashes - 1), 0, 0]))
        faces.append(walls + 2 * n * k)
    geometry = objects.mesh(np.concatenate(positions), np.concatenate(faces))
    return objects.solid(geometry, colour, opacity)


def arrow(node: Node, colour: int, thickness: float = 0.022) -> None:
    """An arrow from the origin to x = 1, for uniform scaling, in two parts below `node`."""
    head = 0.18
    shaft = Y_TO_X.copy()
    shaft[0, 3] = 0.5 * (1 - head)
    node["shaft"].set_object(
        objects.solid(objects.cylinder(thickness, 1 - head, 16), colour, matrix=shaft)
    )
    tip = Y_TO_X.copy()
    tip[0, 3] = 1 - 0.5 * head
    node["head"].set_object(
        objects.solid(objects.cone(3 * thickness, head, 20), colour, matrix=tip)
    )


def turning_arrow(node: Node, colour: int, thickness: float = 0.022) -> None:
    """An axis from the origin to x = 1 with two heads and a ring around it, for a moment.

    The ring's own head says which way it turns: right-handed about x.
    """
    arrow(node["axis"], colour, thickness)
    second = Y_TO_X.copy()
    second[0, 3] = 0.74
    node["second"].set_object(
        objects.solid(objects.cone(3 * thickness, 0.16, 20), colour, matrix=second)
    )
    arc, radius = 1.55 * np.pi, 0.22
    # The ring lies about z; its plane is turned so that its axis is x.
    ring = np.array([[0.0, 0, 1, 0.45], [1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 0, 1]])
    node["ring"].set_object(
        objects.solid(objects.torus(radius, 0.8 * thickness, arc), colour, matrix=ring)
    )
    end = np.eye(4)
    # Along the ring's direction at its end: the cone's y axis.
    c, s = np.cos(arc), np.sin(arc)
    end[:3, :3] = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    end[:3, 3] = radius * np.array([c, s, 0]) + 0.05 * np.array([-s, c, 0])
    node["turn"].set_object(
        objects.solid(objects.cone(3 * thickness, 0.14, 16), colour, matrix=ring @ end)
    )


def frame(node: Node, length: float, opacity: float = 1.0) -> None:
    """The axes of a frame: x, y, z as rods."""
    radius = 0.03 * length
    for axis, colour in enumerate(theme.AXES):
        M = np.eye(4)
        M[:3, :3] = rotation_to(np.eye(3)[axis])
        M = M @ Y_TO_X
        M[axis, 3] += 0.5 * length
        node["xyz"[axis]].set_object(
            objects.solid(objects.cylinder(radius, length, 12), colour, opacity, M)
        )


def plate(corners: Array, thickness: float, colour: int, opacity: float) -> objects.Object | None:
    """A solid through points (n, 3): a plate where they lie in a plane, else their convex hull.

    None where they span no area.
    """
    from scipy.spatial import ConvexHull, QhullError

    centre = corners.mean(axis=0)
    _, sizes, axes = np.linalg.svd(corners - centre, full_matrices=True)
    sizes = np.append(sizes, [0.0] * (3 - len(sizes)))
    if not sizes[1] > numerics.NEARBY * sizes[0]:
        return None
    if sizes[2] < 1e-3 * sizes[0]:
        normal = axes[2] * (0.5 * thickness)
        corners = np.concatenate([corners + normal, corners - normal])
    try:
        hull = ConvexHull(corners)
    except QhullError:
        return None
    triangles = corners[hull.simplices]
    outward = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    flip = np.einsum("ij,ij->i", outward, hull.equations[:, :3]) < 0
    triangles[flip] = triangles[flip][:, [0, 2, 1]]
    geometry = objects.mesh(triangles.reshape(-1, 3), np.arange(3 * len(triangles)))
    return objects.solid(geometry, colour, opacity, flatShading=True)
