"""Shapes of the links of a robot, for pictures, from its URDF or MJCF file.

Each shape is attached to a frame of the tree by name, so that it moves with the joints of
the tree. A missing mesh file is named and left out, and so is a shape of a URDF that
cannot be read.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from cartstiff.core.errors import CartstiffError, InputError, one_line
from cartstiff.core.geometry import se3
from cartstiff.core.mechanisms.chain import Chain, Description
from cartstiff.core.mechanisms.shapes import (
    Box,
    Capsule,
    Cylinder,
    MeshFile,
    Piece,
    Shape,
    Sphere,
)
from cartstiff.core.mechanisms.tree import FixedFrame
from cartstiff.core.potentials.contract import rescaled
from cartstiff.core.units import SI, convert_length
from cartstiff.files.readers import parse_text, parse_xml
from cartstiff.files.ros_packages import (
    package_folders,
    search_path,
    where_packages_are,
)
from cartstiff.files.urdf import numbers_in

# Largest coordinate in metres, and largest scale of a mesh.
_MAX_SIZE = 1e6
# Colour of a shape for which a URDF has none.
_UNPAINTED = (0.9, 0.9, 0.9, 1.0)


@dataclass(frozen=True, eq=False)
class Visual:
    """One piece of a link's picture.

    Attributes
    ----------
    link : str
        The link's name in its file.
    at : FixedFrame
        Joint of the plain tree that carries it, and its pose there.
    shape : MeshFile, Box, Cylinder, Capsule or Sphere
        In the length unit of the chain.
    colour : tuple of 4 floats, or None
        Red, green, blue, opacity in [0, 1]; None where the file leaves it to the mesh.
    """

    link: str
    at: FixedFrame
    shape: Shape
    colour: tuple[float, float, float, float] | None


def visuals_of(chain: Chain) -> tuple[list[Visual], list[str]]:
    """Return the shapes of a chain's links, and sentences on missing ones.

    Parameters
    ----------
    chain : Chain
        With `descriptions`; without any it has no shapes.

    Returns
    -------
    list of Visual
        Every piece whose geometry exists.
    list of str
        One sentence for each thing that cannot be shown.
    """
    shown: list[Visual] = []
    missing: list[str] = []
    metre, _ = convert_length(SI, chain.units)
    for description in chain.descriptions:
        try:
            pieces, words = _pieces(description)
        except (CartstiffError, OSError) as error:
            missing.append(f"no picture of {description.name}: {error}")
            continue
        missing += [w for w in words if w not in missing]
        for piece in pieces:
            at = chain.tree.frames.get(description.prefix + piece.link)
            if not _is_usable(piece):
                unusable = (
                    f"link {one_line(piece.link)}: a shape whose numbers cannot be shown"
                )
                missing += [unusable] if unusable not in missing else []
            elif at is not None:
                piece = rescaled(piece, metre)
                placement = FixedFrame(at.joint, at.T_j_f @ piece.T_l_v)
                link = description.prefix + piece.link
                shown.append(Visual(link, placement, piece.shape, piece.colour))
    return shown, missing


def _is_usable(piece: Piece) -> bool:
    """Whether the numbers of a piece are finite and of a robot's size."""
    shape = [value for value in vars(piece.shape).values() if not isinstance(value, Path)]
    numbers = np.hstack([np.ravel(piece.T_l_v), *map(np.ravel, shape)])
    return bool((np.abs(numbers) < _MAX_SIZE).all())


def _pieces(description: Description) -> tuple[Sequence[Piece], list[str]]:
    path, text = description.path, description.text
    if description.pieces is not None or (path is None and text is None):
        return _present(description.pieces or ())
    if path and text is None:
        root = parse_xml(path)
    else:
        root = parse_text(str(text), description.name)
    # Colours by the names of materials, which the robot declares once.
    painted: dict[str | None, ET.Element] = {}
    for material in root.iter("material"):
        if (colour := material.find("color")) is not None:
            painted.setdefault(material.get("name"), colour)
    # A shape that cannot be shown is named, and the others are shown.
    pieces, missing = [], []
    for link in root.findall("link"):
        name = link.get("name", "")
        for element in link.findall("visual"):
            try:
                shape = _urdf_shape(element, path or Path("/-"), description.packages)
                origin = element.find("origin")
                place = (_numbers(origin, key, 3, "0 0 0") for key in ("xyz", "rpy"))
                T = se3.from_roll_pitch_yaw(*place)
                rgba = None if isinstance(shape, MeshFile) else _UNPAINTED
                if (used := element.find("material")) is not None:
                    inline = used.find("color")
                    own = painted.get(used.get("name")) if inline is None else inline
                    rgba = rgba if own is None else _clipped(_numbers(own, "rgba", 4))
            except InputError as error:
                missing.append(f"link {one_line(name)}: {error}")
            else:
                pieces.append(Piece(name, T, shape, rgba))
    return pieces, missing


def _present(pieces: Sequence[Piece]) -> tuple[list[Piece], list[str]]:
    """Pieces whose mesh files exist, and sentences on the others."""
    present, missing = [], []
    for piece in pieces:
        if isinstance(piece.shape, MeshFile) and not piece.shape.path.is_file():
            mesh = one_line(piece.shape.path.name)
            missing.append(f"body {piece.link}: mesh {mesh} is missing")
        else:
            present.append(piece)
    return present, missing


def geometry_pieces(
    model: Any, geometry: Any, source: str
) -> tuple[list[Piece], list[str]]:
    """The pieces of a Pinocchio geometry model, and sentences on those it cannot show.

    Parameters
    ----------
    model, geometry : pinocchio.Model, pinocchio.GeometryModel
        Frames, and the shapes on them.
    source : str
        Name of their source, for the sentences.
    """
    pieces, missing = [], []
    for piece in geometry.geometryObjects:
        frame = model.frames[int(piece.parentFrame)]
        T = frame.placement.inverse() * piece.placement
        if (shape := _shape(piece)) is None:
            missing.append(f"link {frame.name}: a shape of {source} that cannot be shown")
            continue
        pieces.append(
            Piece(frame.name, np.array(T.homogeneous), shape, _clipped(piece.meshColor))
        )
    return pieces, missing


def _clipped(colour: ArrayLike) -> tuple[float, float, float, float]:
    r, g, b, a = np.clip(colour, 0.0, 1.0).tolist()
    return r, g, b, a


def _numbers(
    element: ET.Element | None, key: str, count: int, otherwise: str = ""
) -> list[float]:
    """Numbers of an attribute."""
    text = otherwise if element is None else element.get(key, otherwise)
    return numbers_in(text, count, key, _MAX_SIZE)


def _urdf_shape(element: ET.Element, path: Path, packages: Sequence[Path]) -> Shape:
    """Shape in a `visual`; InputError where it cannot be shown."""
    geometry = element.find("geometry")
    shape = next(iter(() if geometry is None else geometry), element)
    if shape.tag == "mesh":
        x, y, z = _numbers(shape, "scale", 3, "1 1 1")
        return MeshFile(_mesh_file(shape.get("filename", ""), path, packages), (x, y, z))
    if shape.tag == "box":
        x, y, z = _numbers(shape, "size", 3)
        return Box((x, y, z))
    if shape.tag not in ("cylinder", "capsule", "sphere"):
        raise InputError("a shape that cannot be shown", got=f"<{one_line(shape.tag)}>")
    (radius,) = _numbers(shape, "radius", 1)
    if shape.tag == "sphere":
        return Sphere((radius,) * 3)
    (length,) = _numbers(shape, "length", 1)
    return (
        Cylinder(radius, length) if shape.tag == "cylinder" else Capsule(radius, length)
    )


def _mesh_file(name: str, path: Path, packages: Sequence[Path]) -> Path:
    """File of a mesh by its name: package://, file://, absolute,
    or relative to the URDF.
    """
    scheme, separator, rest = name.rpartition("://")
    advice, places = "", list[Path]()
    if scheme in ("package", "model"):
        package, _, inside = rest.lstrip("/").partition("/")
        folders = list(package_folders(package, path, search_path(packages)))
        # A folder with the package's name may have no package.xml.
        named = [p / package for p in (*packages, *path.resolve().parents)]
        places = [folder / inside for folder in (*folders, *named)]
        advice = f"; package {package} is there and lacks it"
        if not folders:
            advice = (
                f"; package {package} is not found; expected "
                f"{where_packages_are(package)}"
            )
    elif scheme == "file" or not separator:
        places = [path.resolve().parent / rest]
    file = next((place for place in places if place.is_file()), None)
    if file is None:
        raise InputError(f"mesh {one_line(name)} is missing{advice}")
    return file


_SHAPES: dict[str, Callable[[Any], Shape]] = {
    "Box": lambda g: Box(tuple(2.0 * float(x) for x in g.halfSide)),  # type: ignore[arg-type]
    "Cylinder": lambda g: Cylinder(float(g.radius), 2.0 * float(g.halfLength)),
    "Capsule": lambda g: Capsule(float(g.radius), 2.0 * float(g.halfLength)),
    "Sphere": lambda g: Sphere((float(g.radius),) * 3),
    "Ellipsoid": lambda g: Sphere(tuple(float(x) for x in g.radii)),  # type: ignore[arg-type]
}


def _shape(piece: Any) -> Shape | None:
    if piece.meshPath and Path(piece.meshPath).is_file():
        x, y, z = (float(s) for s in piece.meshScale)
        return MeshFile(Path(piece.meshPath), (x, y, z))
    make = _SHAPES.get(type(piece.geometry).__name__)
    return None if make is None else make(piece.geometry)
