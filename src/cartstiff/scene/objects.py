"""three.js objects as plain values: meshes, lines, points, labels.

Every message is a scene of its own to the viewer, so identifiers need to be unique within one
object only; equal objects are then equal messages.
"""

from __future__ import annotations

import base64
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cartstiff.errors import imported
from cartstiff.geometry.se3 import Array

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
    """Triangles: positions (n, 3), faces (m, 3); normals int8 and colours uint8, (n, 3) each."""
    attributes = {"position": arrays(positions)}
    if normals is not None:
        attributes["normal"] = arrays(normals, normalized=True)
    if colours is not None:
        attributes["color"] = arrays(colours, normalized=True)
    small = len(positions) < 65536
    index = np.asarray(faces, np.uint16 if small else np.uint32).reshape(-1)
    data = {"attributes": attributes, "index": arrays(index)}
    return {"uuid": "geometry", "type": "BufferGeometry", "data": data}


def sphere(radius: float = 1.0, fine: bool = False) -> Object:
    """A sphere about the origin; a fine one for what is looked at closely."""
    n = 48 if fine else 20
    return {
        "uuid": "geometry",
        "type": "SphereGeometry",
        "radius": radius,
        "widthSegments": n,
        "heightSegments": n // 2 if not fine else 32,
    }


def box(sides: tuple[float, float, float]) -> Object:
    """A box about the origin."""
    return {
        "uuid": "geometry",
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
        "uuid": "geometry",
        "type": "CylinderGeometry",
        "radiusTop": top,
        "radiusBottom": radius,
        "height": length,
        "radialSegments": segments,
    }


def torus(radius: float, tube: float, arc: float) -> Object:
    """Part of a ring about z, from the x axis on by an angle."""
    return {
        "uuid": "geometry",
        "type": "TorusGeometry",
        "radius": radius,
        "tube": tube,
        "radialSegments": 10,
        "tubularSegments": 40,
        "arc": arc,
    }


def solid(
    geometry: Object, colour: int, opacity: float = 1.0, matrix: Array | None = None, **more: Any
) -> Object:
    """A lit surface in one colour; a transparent one does not hide what is behind it."""
    vertex_colours = "color" in geometry.get("data", {}).get("attributes", {})
    material = {
        "uuid": "material",
        "type": "MeshPhongMaterial",
        "color": colour,
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


def surface(geometry: Object, material: Object, kind: str, matrix: Array | None = None) -> Object:
    """A geometry and a material as an object of a kind ("Mesh", "LineSegments", "Points")."""
    M = np.eye(4) if matrix is None else matrix
    return {
        "metadata": {"version": 4.5, "type": "Object"},
        "geometries": [geometry],
        "materials": [material],
        "object": {
            "uuid": "object",
            "type": kind,
            "geometry": geometry["uuid"],
            "material": material["uuid"],
            "matrix": M.T.ravel().tolist(),
        },
    }


def lines(ends: Array, colour: int | Array, opacity: float = 1.0, joined: bool = False) -> Object:
    """Thin lines between pairs of points (2 n, 3), or through all of them in order.

    `colour` is one for all, or (2 n, 3) in [0, 255].
    """
    attributes = {"position": arrays(np.asarray(ends, np.float32))}
    plain = isinstance(colour, int)
    if not plain:
        attributes["color"] = arrays(np.asarray(colour, np.uint8), normalized=True)
    geometry = {"uuid": "geometry", "type": "BufferGeometry", "data": {"attributes": attributes}}
    material = {
        "uuid": "material",
        "type": "LineBasicMaterial",
        "color": colour if plain else 0xFFFFFF,
        "opacity": opacity,
        "transparent": opacity < 1.0,
        "vertexColors": not plain,
    }
    return surface(geometry, material, "Line" if joined else "LineSegments")


def points(
    positions: Array,
    colours: NDArray[Any],
    size: float,
    carried: Mapping[str, Array] = MappingProxyType({}),
) -> Object:
    """Square points of a size in the scene, with colours (n, 3) in [0, 255].

    `carried` are numbers (n, k) that travel with the points and are not drawn: each as its nearest
    float32 and, as "NAME rest", what that leaves, together good to 2**-48 of a number.
    """
    attributes = {
        "position": arrays(np.asarray(positions, np.float32)),
        "color": arrays(np.asarray(colours, np.uint8), normalized=True),
    }
    for name, values in carried.items():
        nearest = np.asarray(values, np.float32)
        attributes |= {name: arrays(nearest), f"{name} rest": arrays(values - nearest)}
    geometry = {"uuid": "geometry", "type": "BufferGeometry", "data": {"attributes": attributes}}
    material = {
        "uuid": "material",
        "type": "PointsMaterial",
        "color": 0xFFFFFF,
        "size": size,
        "vertexColors": True,
        "sizeAttenuation": True,
    }
    return surface(geometry, material, "Points")


def sprite(png: bytes, width: float, height: float) -> Object:
    """A picture that faces the viewer, of a size on the screen: 1 is the distance to it.

    It is drawn over everything else, so that it can be read wherever it stands.
    """
    url = "data:image/png;base64," + base64.b64encode(png).decode("ascii")
    # As few words as the viewer needs: labels are sent more often than anything else that is long.
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
