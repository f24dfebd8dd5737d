"""A chain of links: the meshes of its files, or a stick figure; one motion per joint moves all."""

from __future__ import annotations

from typing import Any

import numpy as np

from cartstiff.errors import InputError
from cartstiff.geometry.se3 import Array
from cartstiff.loading.meshes import Mesh, read_meshes
from cartstiff.loading.visuals import Visual, visuals_of
from cartstiff.mechanisms.chain import Chain, ChainPosture
from cartstiff.mechanisms.shapes import Box, Capsule, Cylinder, MeshFile, Shape
from cartstiff.mechanisms.tree import FixedFrame
from cartstiff.potentials.line_springs import LineSprings
from cartstiff.scene import objects, shapes, theme
from cartstiff.scene.canvas import Node, scaled
from cartstiff.scene.shapes import Y_TO_Z
from cartstiff.scene.skeleton import Skeleton, skeleton

_UNPAINTED = 0xC8CCD0


class ChainPicture:
    """Draws a chain once, then moves it.

    Parameters
    ----------
    node : Node
        Where it is drawn, in the mechanism's own unit of length.
    chain : Chain
        The mechanism.
    size : float
        Its size, in its unit: how thick sticks are.
    look : Theme
        Colours of sticks.
    ghost : bool
        Translucent and in one colour.
    lines : tuple of LineSprings
        Springs between links, for the stick figure.

    Attributes
    ----------
    notes : list of str
        What cannot be shown, and what stands for it.
    """

    def __init__(
        self,
        node: Node,
        chain: Chain,
        size: float,
        look: theme.Theme,
        *,
        ghost: bool = False,
        lines: tuple[LineSprings, ...] = (),
    ) -> None:
        self._chain, self._size, self._theme, self._ghost = chain, size, look, ghost
        self._node = node
        self._boxes: list[tuple[FixedFrame, Array]] = []
        pieces, self._missing = visuals_of(chain)
        self._joints: dict[int, tuple[Node, FixedFrame]] = {}
        self._meshes = read_meshes(p.shape.path for p in pieces if isinstance(p.shape, MeshFile))
        # Lengths of a robot description are metres, as are those of its mechanism.
        shown = [self._piece(i, visual) for i, visual in enumerate(pieces)]
        self.notes: list[str] = []
        if self._missing:
            others = f" (and {n} more like it)" if (n := len(self._missing) - 1) else ""
            self.notes.append(self._missing[0] + others)
        self._sliders: list[tuple[Node, FixedFrame, Array, FixedFrame]] = []
        if self.notes or not any(shown):
            self._sticks(skeleton(chain, lines))
            if self.notes:
                self.notes.append("sticks between the joints stand for what is missing")
        self._moving = [self._joints[j] for j in sorted(self._joints) if j > 0]

    def move(self, posture: ChainPosture) -> None:
        """Put every link where it is at a posture."""
        at = posture.pose_at
        for node, placement in self._moving:
            node.set_transform(at(placement))
        for node, parent, start, joint in self._sliders:
            T = at(parent)
            node.set_transform(shapes.segment(T[:3, :3] @ start + T[:3, 3], at(joint)[:3, 3]))

    def facts(self) -> dict[str, Any]:
        """What moves with which joint, for a viewer that moves the picture itself."""
        return {
            "joints": sorted(j for j in self._joints if j > 0),
            "sliders": [
                [node.path.rpartition("/")[2], parent.joint, start.tolist(), joint.joint]
                for node, parent, start, joint in self._sliders
            ],
            "boxes": [[at.joint, box.tolist()] for at, box in self._boxes],
        }

    def corners(self, posture: ChainPosture) -> Array:
        """Corners (n, 3) in F of boxes around the meshes at a posture."""
        corners = [np.zeros((0, 3))]
        for placement, box in self._boxes:
            T = posture.pose_at(placement)
            corners.append(box @ T[:3, :3].T + T[:3, 3])
        return np.concatenate(corners)

    def _on(self, joint: int) -> Node:
        if joint not in self._joints:
            self._joints[joint] = (self._node[f"joint {joint}"], FixedFrame(joint, np.eye(4)))
        return self._joints[joint][0]

    def _piece(self, i: int, visual: Visual) -> bool:
        node = self._on(visual.at.joint)[f"{i} {visual.link.replace('/', ' ')}"]
        mesh = self._meshes[visual.shape.path] if isinstance(visual.shape, MeshFile) else None
        if isinstance(mesh, InputError):
            self._missing.append(f"link {visual.link}: {mesh}")
            return False
        if mesh is not None and not len(mesh.faces):
            return False
        M = visual.at.T_j_f
        if isinstance(visual.shape, MeshFile):
            M = scaled(M, np.array(visual.shape.scale))
        if mesh is not None:
            ends = np.array([mesh.positions.min(axis=0), mesh.positions.max(axis=0)], float)
            box = np.array([[x, y, z] for x in ends[:, 0] for y in ends[:, 1] for z in ends[:, 2]])
            box = box @ M[:3, :3].T + M[:3, 3]
            self._boxes.append((FixedFrame(visual.at.joint, np.eye(4)), box))
        colour, opacity = self._paint(visual, mesh)
        for k, (geometry, own) in enumerate(_geometries(visual.shape, mesh, not self._ghost)):
            part = node if k == 0 else node[f"part {k}"]
            if "color" in geometry.get("data", {}).get("attributes", {}):
                colour = 0xFFFFFF
            part.set_object(objects.solid(geometry, colour, opacity, own))
        node.set_transform(M)
        return True

    def _paint(self, visual: Visual, mesh: Mesh | None) -> tuple[int, float]:
        if self._ghost:
            return theme.GHOST, theme.GHOST_OPACITY
        if visual.colour is not None:
            return theme.hex_of(255 * np.array(visual.colour)), max(visual.colour[3], 0.05)
        if mesh is not None and mesh.colour is not None:
            return theme.hex_of(mesh.colour), 1.0
        return _UNPAINTED, 1.0

    def _sticks(self, figure: Skeleton) -> None:
        size, look = self._size, self._theme
        opacity = theme.GHOST_OPACITY if self._ghost else 1.0
        link = theme.GHOST if self._ghost else look.link
        knuckle = theme.GHOST if self._ghost else look.joint
        radius = 0.012 * size
        for i, bone in enumerate(figure.bones):
            node = self._on(bone.joint)[f"bone {i}"]
            node.set_object(shapes.rod(radius, link, opacity))
            node.set_transform(shapes.segment(bone.start, bone.end))
        for i, flat in enumerate(figure.plates):
            # The ground plate of a planar mechanism must not hide its links.
            solid = 0.35 if flat.joint == 0 else 0.85
            made = shapes.plate(flat.corners, 0.02 * size, link, min(opacity, solid))
            if made is not None:
                self._on(flat.joint)[f"plate {i}"].set_object(made)
        for part in figure.knuckles:
            node = self._on(part.joint)["knuckle"]
            if part.axis is None:
                node.set_object(objects.solid(objects.sphere(1.8 * radius), knuckle, opacity))
                continue
            if part.prismatic:
                sides = (5 * radius, 3 * radius, 3 * radius)
                node.set_object(objects.solid(objects.box(sides), knuckle, opacity))
            else:
                geometry = objects.cylinder(1.8 * radius, 4.2 * radius)
                node.set_object(objects.solid(geometry, knuckle, opacity, shapes.Y_TO_X))
            T = np.eye(4)
            T[:3, :3] = shapes.rotation_to(part.axis)
            node.set_transform(T)
        for slider in figure.sliders:
            node = self._node[f"slider {slider.joint}"]
            node.set_object(shapes.rod(0.7 * radius, link, opacity))
            parent, joint = (FixedFrame(j, np.eye(4)) for j in (slider.parent, slider.joint))
            self._sliders.append((node, parent, slider.start, joint))


def _geometries(
    shape: Shape, mesh: Mesh | None, coloured: bool
) -> list[tuple[objects.Object, Array | None]]:
    """three.js geometries of a shape, each with its motion in the shape's frame."""
    if mesh is not None:
        colours = mesh.colours if coloured else None
        return [(objects.mesh(mesh.positions, mesh.faces, mesh.normals, colours), None)]
    if isinstance(shape, Box):
        return [(objects.box(shape.sides), None)]
    if isinstance(shape, Cylinder):
        return [(objects.cylinder(shape.radius, shape.length, 32), Y_TO_Z)]
    if isinstance(shape, Capsule):
        ends = []
        for side in (-0.5, 0.5):
            T = np.eye(4)
            T[2, 3] = side * shape.length
            ends.append((objects.sphere(shape.radius), T))
        return [(objects.cylinder(shape.radius, shape.length, 32), Y_TO_Z), *ends]
    if isinstance(shape, MeshFile):
        return []
    return [(objects.sphere(), np.diag([*shape.radii, 1.0]))]
