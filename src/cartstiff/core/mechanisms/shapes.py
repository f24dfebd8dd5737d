"""Shapes of links: meshes in files, and simple bodies; sizes change by `rescaled`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from cartstiff.core.arrays import Array
from cartstiff.core.potentials.contract import POSE


@dataclass(frozen=True)
class MeshFile:
    """A mesh in a file, scaled along its axes."""

    path: Path
    scale: tuple[float, float, float] = (1.0, 1.0, 1.0)

    length_powers: ClassVar = {"scale": 1}


@dataclass(frozen=True)
class Box:
    """A box with full side lengths along x, y, z."""

    sides: tuple[float, float, float]

    length_powers: ClassVar = {"sides": 1}


@dataclass(frozen=True)
class Cylinder:
    """A cylinder along z, centred."""

    radius: float
    length: float

    length_powers: ClassVar = {"radius": 1, "length": 1}


@dataclass(frozen=True)
class Capsule:
    """A cylinder along z with hemispheres on both ends, centred."""

    radius: float
    length: float

    length_powers: ClassVar = {"radius": 1, "length": 1}


@dataclass(frozen=True)
class Sphere:
    """A sphere (an ellipsoid, if its three radii differ)."""

    radii: tuple[float, float, float]

    length_powers: ClassVar = {"radii": 1}


Shape = MeshFile | Box | Cylinder | Capsule | Sphere


@dataclass(frozen=True, eq=False)
class Piece:
    """One piece of a link's picture, in its robot description.

    Attributes
    ----------
    link : str
        Name of the link, or of another frame of the description.
    T_l_v : ndarray, shape (4, 4)
        Pose of the shape in the link.
    shape : MeshFile, Box, Cylinder, Capsule or Sphere
        In the length unit of the file.
    colour : tuple of 4 floats, or None
        Red, green, blue, opacity in [0, 1]; None where the file leaves it to the mesh.
    """

    link: str
    T_l_v: Array
    shape: Shape
    colour: tuple[float, float, float, float] | None

    length_powers: ClassVar = {"T_l_v": POSE, "shape": 0}
