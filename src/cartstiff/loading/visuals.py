"""Shapes of the links of a robot, for pictures and for collisions, from its URDF or MJCF file.

Pinocchio reads the geometry of a URDF; other sources have their own. Each shape is attached to a
frame of the tree by name, so that it moves with the joints of the tree. A missing mesh file is
named and left out.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pinocchio as pin

from cartstiff.errors import CartstiffError, one_line
from cartstiff.loading.robot_description import parse_text, parse_xml
from cartstiff.mechanisms.chain import Chain, Description
from cartstiff.mechanisms.contract import SI, convert_length
from cartstiff.mechanisms.shapes import Box, Capsule, Cylinder, MeshFile, Piece, Shape, Sphere
from cartstiff.mechanisms.tree import FixedFrame
from cartstiff.potentials.contract import rescaled
from cartstiff.ros_packages import package_folders, search_path, where_packages_are

Kind = Literal["visual", "collision"]
_TYPES: dict[Kind, Any] = {
    "visual": pin.GeometryType.VISUAL,
    "collision": pin.GeometryType.COLLISION,
}


# Largest coordinate in metres, and largest scale of a mesh.
_MAX_SIZE = 1e6


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


def visuals_of(chain: Chain, kind: Kind = "visual") -> tuple[list[Visual], list[str]]:
    """Return the shapes of a chain's links, and sentences on missing ones.

    Parameters
    ----------
    chain : Chain
        With `descriptions`; without any it has no shapes.
    kind : {"visual", "collision"}
        Shapes for pictures, or for collisions.

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
            pieces, words = _pieces(description, kind)
        except (CartstiffError, OSError) as error:
            missing.append(f"no picture of {description.name}: {error}")
            continue
        missing += [w for w in words if w not in missing]
        for piece in pieces:
            at = chain.tree.frames.get(description.prefix + piece.link)
            if not _is_usable(piece):
                unusable = f"link {one_line(piece.link)}: a shape whose numbers cannot be shown"
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


def _pieces(description: Description, kind: Kind) -> tuple[Sequence[Piece], list[str]]:
    path, text = description.path, description.text
    if description.pieces is not None and kind == "collision":
        return [], [f"{description.name}: shapes for collisions are read from URDF only"]
    if description.pieces is not None or (path is None and text is None):
        return _present(description.pieces or ())
    root = parse_xml(path) if path and text is None else parse_text(str(text), description.name)
    files, missing = _resolve_urdf(root, path or Path("/-"), description.packages, kind)
    text = ET.tostring(root, encoding="unicode")
    try:
        model = pin.buildModelFromXML(text)
        geometry = pin.buildGeomFromUrdfString(model, text, _TYPES[kind])
    except Exception as error:
        what = "picture" if kind == "visual" else "shapes for collisions"
        return [], [f"no {what} of {description.name}: {one_line(str(error))}"]
    pieces, words = geometry_pieces(model, geometry, description.name, files)
    return pieces, [*missing, *words]


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
    model: Any,
    geometry: Any,
    source: str,
    files: Mapping[str, MeshFile] | None = None,
    coloured: bool = False,
) -> tuple[list[Piece], list[str]]:
    """Return the pieces of a Pinocchio geometry model, and sentences on those it cannot show.

    Parameters
    ----------
    model, geometry : pinocchio.Model, pinocchio.GeometryModel
        Frames, and the shapes on them.
    source : str
        Name of their source, for the sentences.
    files : mapping of str to MeshFile, optional
        Meshes that Pinocchio has not read, by the geometry's name.
    coloured : bool
        Whether the colours of meshes count even where they are not marked as given.
    """
    pieces, missing = [], []
    for piece in geometry.geometryObjects:
        frame = model.frames[int(piece.parentFrame)]
        T = frame.placement.inverse() * piece.placement
        shape = (files or {}).get(piece.name) or _shape(piece)
        if shape is None:
            missing.append(f"link {frame.name}: a shape of {source} that cannot be shown")
            continue
        colour = None
        if not isinstance(shape, MeshFile) or piece.overrideMaterial or coloured:
            r, g, b, a = (float(np.clip(x, 0.0, 1.0)) for x in piece.meshColor)
            colour = (r, g, b, a)
        pieces.append(Piece(frame.name, np.array(T.homogeneous), shape, colour))
    return pieces, missing


def _resolve_urdf(
    root: ET.Element, path: Path, packages: Sequence[Path], kind: Kind
) -> tuple[dict[str, MeshFile], list[str]]:
    """Reduce a URDF to links with shapes on fixed joints, without shapes whose mesh is missing.

    Only the pose of a visual in its link is needed, so that no joint has to move. Spheres replace
    meshes, which Pinocchio would read and prepare for collisions; the meshes are returned by
    Pinocchio's name of them, link and number.
    """
    files: dict[str, MeshFile] = {}
    missing = []
    for link in root.findall("link"):
        count = 0
        for child in list(link):
            if child.tag != kind:
                link.remove(child)
                continue
            geometry = child.find("geometry")
            if geometry is not None and not all(map(_is_written_well, geometry)):
                link.remove(child)
                words = f"link {one_line(link.get('name', ''))}: a shape whose numbers"
                missing.append(f"{words} cannot be shown")
                continue
            mesh = None if geometry is None else geometry.find("mesh")
            if geometry is not None and mesh is not None:
                name = mesh.get("filename", "")
                file = _mesh_file(name, path, packages)
                if file is None:
                    link.remove(child)
                    words = f"link {link.get('name')}: mesh {one_line(name)} is missing"
                    missing.append(f"{words}{_how_to_get(name, path, packages)}")
                    continue
                files[f"{link.get('name')}_{count}"] = MeshFile(file, _scale(mesh))
                geometry.remove(mesh)
                ET.SubElement(geometry, "sphere", radius="1")
            count += 1
    for element in list(root):
        if element.tag not in ("link", "joint", "material"):
            root.remove(element)
    for joint in root.findall("joint"):
        joint.set("type", "fixed")
        for child in list(joint):
            if child.tag not in ("parent", "child", "origin"):
                joint.remove(child)
    return files, missing


def _is_written_well(shape: ET.Element) -> bool:
    """Whether the sizes of a shape are finite numbers, of a robot's size."""
    texts = " ".join(shape.get(key, "") for key in ("size", "radius", "length", "scale"))
    try:
        return all(abs(float(text)) < _MAX_SIZE for text in texts.split())
    except ValueError:
        return False


def _scale(mesh: ET.Element) -> tuple[float, float, float]:
    try:
        x, y, z = (float(part) for part in mesh.get("scale", "1 1 1").split())
    except ValueError:
        return 1.0, 1.0, 1.0
    return x, y, z


def _how_to_get(name: str, path: Path, packages: Sequence[Path]) -> str:
    """Advice on a missing mesh of a package; empty for other meshes."""
    package = name.partition("://")[2].lstrip("/").partition("/")[0]
    if not name.startswith("package://"):
        return ""
    if next(package_folders(package, path, search_path(packages)), None) is not None:
        return f"; package {package} is there and lacks it"
    return f"; package {package} is not found; expected {where_packages_are(package)}"


def _mesh_file(name: str, path: Path, packages: Sequence[Path]) -> Path | None:
    """File of a mesh by its name: package://, file://, absolute, or relative to the URDF."""
    scheme, separator, rest = name.partition("://")
    places: list[Path]
    if separator and scheme in ("package", "model"):
        rest = rest.lstrip("/")
        package, _, inside = rest.partition("/")
        folders = package_folders(package, path, search_path(packages))
        file = next((f / inside for f in folders if (f / inside).is_file()), None)
        if file is not None:
            return file
        # A folder with the package's name may have no package.xml.
        places = [p / rest for p in [*packages, *path.resolve().parents]]
    elif separator and scheme == "file":
        places = [Path(rest)]
    elif separator:
        places = []
    else:
        places = [path.resolve().parent / name]
    return next((p for p in places if p.is_file()), None)


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
