"""three.js objects as plain values: meshes, lines, points, labels.

Every message is a scene of its own to the viewer, so identifiers need to be unique within
one object only; equal objects are then equal messages.
"""

from __future__ import annotations

import base64
from collections.abc import Mapping
from math import sqrt
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cartstiff.core import numerics
from cartstiff.core.arrays import Array
from cartstiff.core.errors import imported
from cartstiff.shown.scene import theme
from cartstiff.shown.scene.viewer import ViewerNode

Object = dict[str, Any]
#: Typed arrays of the browser: name and MessagePack extension code.
_TYPES = {
    np.dtype(np.int8): ("Int8Array", 0x11),
    np.dtype(np.uint8): ("Uint8Array", 0x12),
    np.dtype(np.uint16): ("Uint16Array", 0x14),
    np.dtype(np.uint32): ("Uint32Array", 0x16),
    np.dtype(np.float32): ("Float32Array", 0x17),
}
# three.js counts triangles from both sides with 2.
_BOTH_SIDES = 2
_LINEAR_FILTER = 1006


def arrays(values: NDArray[Any], normalized: bool = False) -> Object:
    """A typed array for a buffer; float64 becomes float32."""
    umsgpack = imported("umsgpack", "u-msgpack-python", "a picture in a page")
    values = np.ascontiguousarray(values)
    if values.dtype == np.float64:
        values = values.astype(np.float32)
    name, code = _TYPES[values.dtype]
    return {
        "itemSize": 1 if values.ndim == 1 else values.shape[1],
        "type": name,
        "array": umsgpack.Ext(code, values.tobytes()),
        "normalized": normalized,
    }


def mesh(
    positions: Array,
    faces: NDArray[Any],
    normals: NDArray[Any] | None = None,
    colours: NDArray[Any] | None = None,
) -> Object:
    """Triangles: positions (n, 3), faces (m, 3).

    Normals int8 and colours uint8, (n, 3) each.
    """
    attributes = {"position": arrays(positions)}
    if normals is not None:
        attributes["normal"] = arrays(normals, normalized=True)
    if colours is not None:
        attributes["color"] = arrays(colours, normalized=True)
    small = len(positions) < 65536
    index = np.asarray(faces, np.uint16 if small else np.uint32).reshape(-1)
    return _buffered({"attributes": attributes, "index": arrays(index)})


def _buffered(data: Object) -> Object:
    """A geometry of typed arrays: attributes of its corners, with their order or
    without.
    """
    return {"type": "BufferGeometry", "data": data}


# Halvings of a mesh's size that make its grid.
_GRID = 12


def on_grid(positions: NDArray[np.float32]) -> NDArray[np.float32]:
    """Corners (n, 3) of a mesh, rounded to 1/4096 of its size,
    so that they compress well.
    """
    if not len(positions):
        return positions
    size = float(np.ptp(positions, axis=0).max()) or 1.0
    grid = np.float32(2.0 ** (np.floor(np.log2(size)) - _GRID))
    return np.round(positions / grid) * grid


def sphere(radius: float = 1.0, fine: bool = False) -> Object:
    """A sphere about the origin; a fine one for what is looked at closely."""
    n = 48 if fine else 20
    return {
        "type": "SphereGeometry",
        "radius": radius,
        "widthSegments": n,
        "heightSegments": n // 2 if not fine else 32,
    }


def box(sides: tuple[float, float, float]) -> Object:
    """A box about the origin."""
    return {
        "type": "BoxGeometry",
        "width": sides[0],
        "height": sides[1],
        "depth": sides[2],
    }


def cylinder(radius: float, length: float, segments: int = 20) -> Object:
    """A cylinder along y, as three.js has it; see `along`."""
    return cone(radius, length, segments, top=radius)


def cone(radius: float, length: float, segments: int = 20, top: float = 0.0) -> Object:
    """A cone along y, its tip at +y."""
    return {
        "type": "CylinderGeometry",
        "radiusTop": top,
        "radiusBottom": radius,
        "height": length,
        "radialSegments": segments,
    }


def torus(radius: float, tube: float, arc: float) -> Object:
    """Part of a ring about z, from the x axis on by an angle."""
    return {
        "type": "TorusGeometry",
        "radius": radius,
        "tube": tube,
        "radialSegments": 10,
        "tubularSegments": 40,
        "arc": arc,
    }


def solid(
    geometry: Object,
    colour: int,
    opacity: float = 1.0,
    matrix: Array | None = None,
    **more: Any,
) -> Object:
    """A lit surface in one colour, or in those of its corners; a transparent one does not
    hide what is behind it.
    """
    vertex_colours = "color" in geometry.get("data", {}).get("attributes", {})
    material = {
        "type": "MeshPhongMaterial",
        "color": 0xFFFFFF if vertex_colours else colour,
        "specular": 0x202020,
        "shininess": 30,
        "side": _BOTH_SIDES,
        "opacity": opacity,
        "transparent": opacity < 1.0,
        "depthWrite": opacity >= 1.0,
        "vertexColors": vertex_colours,
        **more,
    }
    return surface(geometry, material, "Mesh", matrix)


def surface(
    geometry: Object, material: Object, kind: str, matrix: Array | None = None
) -> Object:
    """A geometry and a material as an object of a kind
    ("Mesh", "LineSegments", "Points").
    """
    M = np.eye(4) if matrix is None else matrix
    return {
        "metadata": {"version": 4.5, "type": "Object"},
        "geometries": [{"uuid": "geometry", **geometry}],
        "materials": [{"uuid": "material", **material}],
        "object": {
            "uuid": "object",
            "type": kind,
            "geometry": "geometry",
            "material": "material",
            "matrix": M.T.ravel().tolist(),
        },
    }


def lines(
    ends: Array, colour: int | Array, opacity: float = 1.0, joined: bool = False
) -> Object:
    """Thin lines between pairs of points (2 n, 3), or through all of them in order.

    `colour` is one for all, or (2 n, 3) in [0, 255].
    """
    attributes = {"position": arrays(np.asarray(ends, np.float32))}
    plain = isinstance(colour, int)
    if not plain:
        attributes["color"] = arrays(np.asarray(colour, np.uint8), normalized=True)
    material = {
        "type": "LineBasicMaterial",
        "color": colour if plain else 0xFFFFFF,
        "opacity": opacity,
        "transparent": opacity < 1.0,
        "vertexColors": not plain,
    }
    kind = "Line" if joined else "LineSegments"
    return surface(_buffered({"attributes": attributes}), material, kind)


def points(
    positions: Array,
    colours: NDArray[Any],
    size: float,
    carried: Mapping[str, Array] = MappingProxyType({}),
) -> Object:
    """Square points of a size in the scene, with colours (n, 3) in [0, 255].

    `carried` are numbers (n, k) that travel with the points and are not drawn: each as
    its nearest float32 and, as "NAME rest", what that leaves, together good to 2**-48 of
    a number.
    """
    attributes = {
        "position": arrays(np.asarray(positions, np.float32)),
        "color": arrays(np.asarray(colours, np.uint8), normalized=True),
    }
    for name, values in carried.items():
        nearest = np.asarray(values, np.float32)
        attributes |= {name: arrays(nearest), f"{name} rest": arrays(values - nearest)}
    material = {
        "type": "PointsMaterial",
        "color": 0xFFFFFF,
        "size": size,
        # Those of a hull lie before the mechanism, which is seen through them.
        "opacity": 0.55,
        "transparent": True,
        "depthWrite": False,
        "vertexColors": True,
        "sizeAttenuation": True,
    }
    return surface(_buffered({"attributes": attributes}), material, "Points")


def sprite(png: bytes, width: float, height: float) -> Object:
    """A picture that faces the viewer, of a size on the screen: 1 is the distance to it.

    It is drawn over everything else, so that it can be read wherever it stands.
    """
    url = "data:image/png;base64," + base64.b64encode(png).decode("ascii")
    # As few words as the viewer needs: labels are sent more often than anything else that
    # is long.
    return {
        "images": [{"uuid": "i", "url": url}],
        "textures": [{"uuid": "t", "image": "i", "minFilter": _LINEAR_FILTER}],
        "materials": [
            {
                "uuid": "m",
                "type": "SpriteMaterial",
                "map": "t",
                "transparent": True,
                "depthTest": False,
                "sizeAttenuation": False,
            }
        ],
        "object": {
            "uuid": "o",
            "type": "Sprite",
            "material": "m",
            "renderOrder": 10,
            "scale": [width, height, 1.0],
        },
    }


#: three.js draws cylinders along y: turned along x or z.
Y_TO_X = np.array([[0.0, 1, 0, 0], [-1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
Y_TO_Z = np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])


def _along_x(place: float) -> Array:
    """`Y_TO_X`, the middle of the cylinder at a place on the x axis."""
    M = Y_TO_X.copy()
    M[0, 3] = place
    return M


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
    """Motion (4, 4) that takes a rod of unit length along x between two points;
    thickness stays.
    """
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
    stretched = max(length, numerics.NEGLIGIBLE_DIFFERENCE)
    return [stretched * c for c in x], y, z


def rod(radius: float, colour: int, opacity: float = 1.0) -> Object:
    """A rod from the origin to x = 1."""
    return solid(cylinder(radius, 1.0, 14), colour, opacity, _along_x(0.5))


def dashed_rod(radius: float, colour: int) -> Object:
    """A rod from the origin to x = 1 with gaps."""
    n, dashes = 8, 9
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
    geometry = mesh(np.concatenate(positions), np.concatenate(faces))
    return solid(geometry, colour)


def ends(radius: float, colour: int) -> Object:
    """Two discs across x, at x = 0 and at x = 1."""
    turn = np.linspace(0.0, 2.0 * np.pi, 16, endpoint=False)
    rim = radius * np.stack([0.0 * turn, np.cos(turn), np.sin(turn)], axis=1)
    disc = np.concatenate([np.zeros((1, 3)), rim])
    fan = np.array([[0, 1 + k, 1 + (k + 1) % 16] for k in range(16)])
    positions = np.concatenate([disc, disc + np.array([1.0, 0.0, 0.0])])
    return solid(
        mesh(positions, np.concatenate([fan, fan + 17])), colour, flatShading=True
    )


def arrow(node: ViewerNode, colour: int, thickness: float = 0.022) -> None:
    """An arrow from the origin to x = 1, for uniform scaling,
    in two parts below `node`.
    """
    head = 0.18
    shaft = cylinder(thickness, 1 - head, 16), _along_x(0.5 * (1 - head))
    tip = cone(3 * thickness, head, 20), _along_x(1 - 0.5 * head)
    for part, (geometry, place) in {"shaft": shaft, "head": tip}.items():
        node[part].set_object(solid(geometry, colour, matrix=place))


def turning_arrow(node: ViewerNode, colour: int, thickness: float = 0.022) -> None:
    """An axis from the origin to x = 1 with two heads and a ring around it, for a moment.

    The ring's own head says which way it turns: right-handed about x.
    """
    arrow(node["axis"], colour, thickness)
    second = cone(3 * thickness, 0.16, 20)
    node["second"].set_object(solid(second, colour, matrix=_along_x(0.74)))
    arc, radius = 1.55 * np.pi, 0.22
    # The ring lies about z; its plane is turned so that its axis is x.
    ring = np.array([[0.0, 0, 1, 0.45], [1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 0, 1]])
    node["ring"].set_object(
        solid(torus(radius, 0.8 * thickness, arc), colour, matrix=ring)
    )
    end = np.eye(4)
    # Along the ring's direction at its end: the cone's y axis.
    c, s = np.cos(arc), np.sin(arc)
    end[:3, :3] = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    end[:3, 3] = radius * np.array([c, s, 0]) + 0.05 * np.array([-s, c, 0])
    node["turn"].set_object(
        solid(cone(3 * thickness, 0.14, 16), colour, matrix=ring @ end)
    )


def frame(node: ViewerNode, length: float, opacity: float = 1.0) -> None:
    """The axes of a frame: x, y, z as rods."""
    radius = 0.03 * length
    for axis, colour in enumerate(theme.AXES):
        M = np.eye(4)
        M[:3, :3] = rotation_to(np.eye(3)[axis])
        M = M @ Y_TO_X
        M[axis, 3] += 0.5 * length
        node["xyz"[axis]].set_object(
            solid(cylinder(radius, length, 12), colour, opacity, M)
        )


def shadow(centre: Array, radii: Array) -> Object:
    """A soft dark spot on the ground: transparent discs about a point,
    one on the other.
    """
    turn = np.linspace(0.0, 2.0 * np.pi, 49)
    circle = np.stack([np.cos(turn), np.sin(turn), 0.0 * turn], axis=1)
    circle[0] = 0.0  # the middle of the fan
    fan = np.array([[0, 1 + k, 1 + (k + 1) % 48] for k in range(48)])
    geometry = mesh(
        np.concatenate([centre + r * circle for r in radii]),
        np.concatenate([fan + 49 * k for k in range(len(radii))]),
    )
    material = {
        "type": "MeshBasicMaterial",
        "color": 0,
        "opacity": 0.009,
        "transparent": True,
        "depthWrite": False,
        "side": _BOTH_SIDES,
    }
    return surface(geometry, material, "Mesh")


def plate(corners: Array, thickness: float, colour: int, opacity: float) -> Object | None:
    """A solid through points (n, 3): a plate where they lie in a plane,
    else their convex hull.

    None where they span no area.
    """
    from scipy.spatial import ConvexHull, QhullError

    centre = corners.mean(axis=0)
    _, sizes, axes = np.linalg.svd(corners - centre, full_matrices=True)
    sizes = np.append(sizes, [0.0] * (3 - len(sizes)))
    if not sizes[1] > numerics.NEGLIGIBLE_DISTANCE * sizes[0]:
        return None
    if sizes[2] < 1e-3 * sizes[0]:
        normal = axes[2] * (0.5 * thickness)
        corners = np.concatenate([corners + normal, corners - normal])
    try:
        hull = ConvexHull(corners)
    except QhullError:
        return None
    triangles = corners[hull.simplices]
    outward = np.cross(
        triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    )
    flip = np.einsum("ij,ij->i", outward, hull.equations[:, :3]) < 0
    triangles[flip] = triangles[flip][:, [0, 2, 1]]
    geometry = mesh(triangles.reshape(-1, 3), np.arange(3 * len(triangles)))
    return solid(geometry, colour, opacity, flatShading=True)
