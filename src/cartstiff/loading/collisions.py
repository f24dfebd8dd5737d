"""Find postures of an arm at which its links collide: Pinocchio's pairs, tested by coal.

All pairs of links are tested, except those on one joint or on neighbouring joints, and those that
touch at the mechanism's default posture. The arm's surroundings and a workpiece are not tested.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import compress
from pathlib import Path
from typing import Any

import coal
import numpy as np
import pinocchio as pin

from cartstiff.arrays import Array
from cartstiff.errors import InputError, one_line
from cartstiff.loading.meshes import Mesh, read_meshes
from cartstiff.loading.visuals import visuals_of
from cartstiff.mechanisms.chain import Chain
from cartstiff.mechanisms.elastic import ElasticMechanism
from cartstiff.mechanisms.shapes import Box, Capsule, Cylinder, MeshFile, Shape, Sphere

#: Message where collisions are not tested.
NOT_CHECKED = "collisions are not checked: neither of links with each other nor with anything else"


class Collisions:
    """Collision test of one arm's links at many postures.

    Parameters
    ----------
    elastic : ElasticMechanism
        A chain of joints whose URDF has shapes for collisions.

    Attributes
    ----------
    pairs : int
        Number of pairs of shapes that are tested.
    left_out : tuple of str
        Pairs "a - b" of links on other than neighbouring joints that touch at the default posture.

    Raises
    ------
    InputError
        If there are no such shapes, or a mesh is missing.
    """

    def __init__(self, elastic: ElasticMechanism) -> None:
        chain = elastic.mechanism
        if not isinstance(chain, Chain):
            raise InputError("collisions are tested between links of arms", got=chain.kind)
        shapes, missing = visuals_of(chain, "collision")
        if missing:
            raise InputError("collisions cannot be tested", got=one_line(missing[0]))
        if not shapes:
            raise InputError(
                "collisions cannot be tested: the robot has no shapes for them",
                expected="a URDF with <collision> elements",
            )
        self._tree = chain.tree
        self._geometry = pin.GeometryModel()
        meshes = read_meshes(s.shape.path for s in shapes if isinstance(s.shape, MeshFile))
        links = []
        for i, piece in enumerate(shapes):
            self._geometry.addGeometryObject(
                pin.GeometryObject(
                    f"{piece.link}_{i}",
                    piece.at.joint,
                    pin.SE3(piece.at.T_j_f),
                    _solid(piece.shape, meshes),
                )
            )
            links.append(piece.link)
        joints, parents = [piece.at.joint for piece in shapes], list(self._tree.model.parents)
        pairs = [
            (a, b)
            for b in range(len(shapes))
            for a in range(b)
            if joints[a] != joints[b]
            and parents[joints[a]] != joints[b]
            and parents[joints[b]] != joints[a]
        ]
        self._use(pairs)
        self._collide(elastic.q, first=False)
        touching = [result.isCollision() for result in self._data.collisionResults]
        touching_pairs = list(compress(pairs, touching))
        self._use([pair for pair in pairs if pair not in touching_pairs])
        self.pairs = len(self._geometry.collisionPairs)
        names = [f"{links[a]} - {links[b]}" for a, b in touching_pairs]
        self.left_out = tuple(dict.fromkeys(names))

    def _use(self, pairs: Sequence[tuple[int, int]]) -> None:
        self._geometry.removeAllCollisionPairs()
        for a, b in pairs:
            self._geometry.addCollisionPair(pin.CollisionPair(a, b))
        self._data = pin.GeometryData(self._geometry)

    def _collide(self, q: Array, first: bool) -> bool:
        tree = self._tree
        at = np.asarray(q, float) if tree.mimic is None else tree.mimic @ q + tree.offset
        with tree.workspace() as data:
            return bool(
                pin.computeCollisions(tree.model, data, self._geometry, self._data, at, first)
            )

    def __call__(self, q: Array) -> Array:
        """Whether links collide at N postures (N, n): bool (N,)."""
        return np.array([self._collide(row, first=True) for row in q], bool)

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        return {
            "checked": True,
            "pairs": self.pairs,
            "left_out": list(self.left_out),
            "message": self.message,
        }

    @property
    def message(self) -> str:
        """Description of the tested pairs."""
        words = (
            f"collisions of links with each other are excluded ({self.pairs} pairs of shapes); "
            "with anything else they are not checked"
        )
        if self.left_out:
            words += "; left out, as they touch at the default posture: " + ", ".join(self.left_out)
        return words


def _solid(shape: Shape, meshes: Mapping[Path, Mesh | InputError]) -> Any:
    """Shape of coal."""
    if isinstance(shape, MeshFile):
        mesh = meshes[shape.path]
        if isinstance(mesh, InputError):
            raise mesh
        solid = coal.BVHModelOBBRSS()
        solid.beginModel(len(mesh.faces), len(mesh.positions))
        solid.addVertices(mesh.positions.astype(float) * np.array(shape.scale))
        solid.addTriangles(mesh.faces.astype(np.int64))
        solid.endModel()
        solid.computeLocalAABB()
        return solid
    if isinstance(shape, Box):
        return coal.Box(*shape.sides)
    if isinstance(shape, Cylinder):
        return coal.Cylinder(shape.radius, shape.length)
    if isinstance(shape, Capsule):
        return coal.Capsule(shape.radius, shape.length)
    if isinstance(shape, Sphere):
        return coal.Ellipsoid(*shape.radii)
    raise InputError("shape cannot collide", got=type(shape).__name__)
