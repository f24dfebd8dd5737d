"""Pictures of mechanisms: chains by meshes or sticks, platforms by plates,
lines by tension.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import sqrt
from typing import Any, cast

import numpy as np

from cartstiff.core import numerics
from cartstiff.core.arrays import Array
from cartstiff.core.errors import InputError
from cartstiff.core.geometry import se3
from cartstiff.core.mechanisms.chain import Chain, ChainPosture
from cartstiff.core.mechanisms.contract import MechanismPosture
from cartstiff.core.mechanisms.elastic import ElasticMechanism
from cartstiff.core.mechanisms.platform import Platform, PlatformPosture
from cartstiff.core.mechanisms.shapes import Box, Capsule, Cylinder, MeshFile, Shape
from cartstiff.core.mechanisms.tree import FixedFrame
from cartstiff.core.potentials.contract import Drawn, Potential
from cartstiff.core.stiffness.compute import PostureStiffness
from cartstiff.files.meshes import Mesh, read_meshes
from cartstiff.files.visuals import Visual, visuals_of
from cartstiff.shown.scene import objects, theme
from cartstiff.shown.scene.objects import Y_TO_Z
from cartstiff.shown.scene.scales import Tension
from cartstiff.shown.scene.skeleton import knuckles_of, links_of
from cartstiff.shown.scene.viewer import ViewerNode, scaled


class LinesPicture:
    """Straight springs between points: one rod each, coloured by tension.

    Parameters
    ----------
    node : ViewerNode
        Where they are drawn.
    count : int
        How many.
    radius : float
        Radius of the rods.
    cables : bool
        A slack line is drawn dashed and grey.
    telescope : float or None
        Length of the outer tube of a leg; None draws one rod.
    tube : int
        Its colour.
    ghost : bool
        Translucent and in one colour.
    coloured : bool
        Whether lines that are not slack get a colour; else the viewer colours them.

    Attributes
    ----------
    telescope : float or None
        As given.
    """

    def __init__(
        self,
        node: ViewerNode,
        count: int,
        radius: float,
        *,
        cables: bool = False,
        telescope: float | None = None,
        tube: int = theme.LIGHT.joint,
        ghost: bool = False,
        coloured: bool = True,
    ) -> None:
        self.telescope, self._coloured = telescope, coloured
        self._radius = radius
        self._cables = cables
        lines = [node[f"line {i + 1}"] for i in range(count)]
        self._rods = [line["rod"] for line in lines]
        self._tubes = [line["tube"] for line in lines] if telescope is not None else []
        self._shades: list[int | None] = [None] * count
        for line in self._rods:
            line.set_object(objects.rod(radius, *theme.shade(0xFFFFFF, ghost)))
        for line in self._tubes:
            line.set_object(objects.rod(1.9 * radius, *theme.shade(tube, ghost)))
        self._dashed = [False] * count

    def move(self, starts: Array, ends: Array, root: ViewerNode | None = None) -> None:
        """Draw each line from `starts` to `ends` (m, 3).

        With another `root` only places below it are set, as a viewer needs that copies
        the lines there.
        """
        rods, tubes = self._rods, self._tubes
        if root is not None:
            lines = [root[f"line {i + 1}"] for i in range(len(rods))]
            rods, tubes = (
                [line["rod"] for line in lines],
                [line["tube"] for line in lines],
            )
        for i, (start, end) in enumerate(
            zip(starts.tolist(), ends.tolist(), strict=True)
        ):
            x, y, z = objects.segment_columns(start, end)
            rods[i].set_columns(x, y, z, start)
            if self.telescope is not None:
                a, b, c = x
                share = min(1.0, self.telescope / sqrt(a * a + b * b + c * c))
                tubes[i].set_columns([share * a, share * b, share * c], y, z, start)

    def carry(self, tensions: Array, taut: Array | None = None) -> dict[str, Any]:
        """Colour each line by its tension (m,), slack cables grey and dashed;
        return the legend.

        Tensions that are not known yet (no rest length) count as zero.
        """
        known = [0.0 if x != x else x for x in tensions.tolist()]
        scale = Tension.from_values(known)
        are_slack = [False] * len(known)
        if self._cables and taut is not None:
            are_slack = (~taut).tolist()
        if self._coloured or any(are_slack) or any(self._dashed):
            self._paint([*map(scale.share, known)], are_slack)
        slack = [i + 1 for i, is_slack in enumerate(are_slack) if is_slack]
        told = {"values": known, "slack": slack, "cables": self._cables}
        return {**scale.legend(), **told}

    def _paint(self, shares: list[float], are_slack: list[bool]) -> None:
        for i, (line, share, slack) in enumerate(
            zip(self._rods, shares, are_slack, strict=True)
        ):
            shade = theme.SLACK if slack else theme.force_colour(share)
            if slack != self._dashed[i]:
                self._dashed[i] = slack
                rod = objects.dashed_rod if slack else objects.rod
                line.set_object(rod(self._radius, 0xFFFFFF))
                self._shades[i] = None
            if shade != self._shades[i]:
                self._shades[i] = shade
                line.set_property("color", [*theme.fractions(shade), 1.0])


@dataclass(eq=False)
class _Picture:
    """Draws a mechanism once, then moves it.

    Attributes
    ----------
    node : ViewerNode
        Where it is drawn, in the mechanism's own unit of length.
    elastic : ElasticMechanism
        The mechanism.
    size : float
        Its size, in its unit: how thick sticks are.
    look : Theme
        Colours of sticks.
    ghost : bool
        Translucent and in one colour.
    notes : list of str
        Parts that cannot be shown, and what is drawn instead.
    """

    node: ViewerNode
    elastic: ElasticMechanism
    size: float
    look: theme.Theme
    ghost: bool = False
    notes: list[str] = field(default_factory=list, init=False)

    def __post_init__(self) -> None:
        raise NotImplementedError

    def corners(self, _: Any) -> Array:
        """Corners (n, 3) in F of boxes at a posture, around what `extent` leaves out."""
        return np.zeros((0, 3))

    def facts(self) -> dict[str, Any]:
        """Facts for a viewer that moves the picture itself."""
        return {}


class PlatformPicture(_Picture):
    """Draws a Stewart-Gough platform, a body on springs, or a cable robot;
    then moves it.
    """

    def __post_init__(self) -> None:
        node, elastic, size, look, ghost = (
            self.node,
            self.elastic,
            self.size,
            self.look,
            self.ghost,
        )
        self._platform = platform = cast(Platform, elastic.mechanism)
        cables = elastic.springs is not None and bool(elastic.springs.unilateral)
        radius, thick = 0.011 * size, 0.025 * size
        self._body = node["body"]
        # The body: a plate, or rods to its points.
        flat = objects.plate(
            platform.points,
            thick,
            *theme.shade(look.plate, ghost, 0.45 if cables else 0.8),
        )
        if flat is not None:
            self._body["plate"].set_object(flat)
        else:
            for i, point in enumerate(platform.points):
                if np.linalg.norm(point) > numerics.NEGLIGIBLE_DISTANCE * size:
                    rod = self._body[f"rod {i + 1}"]
                    rod.set_object(objects.rod(radius, *theme.shade(look.plate, ghost)))
                    rod.set_transform(objects.segment(np.zeros(3), point))
        self._balls(
            self._body, platform.points, 1.7 * radius, *theme.shade(look.joint, ghost)
        )
        if not ghost:
            anchors = platform.anchors
            spread = np.linalg.svd(anchors - anchors.mean(axis=0), compute_uv=False)
            is_flat = spread[-1] < 0.2 * spread[0]
            if is_flat:
                made = objects.plate(anchors, thick, look.plate, 0.9)
            else:
                made = _edges(anchors, look.link)
            if made is not None:
                node["base"]["plate"].set_object(made)
            self._balls(node["base"], anchors, 0.017 * size, look.joint)
        # Legs or cables.
        legs = platform.has_legs
        lengths = platform.leg_lengths(elastic.q)
        shortest = (
            lengths.min() if platform.limits is None else platform.limits[:, 0].min()
        )
        self._lines = LinesPicture(
            node["legs"],
            len(platform.points),
            (0.8 if legs else 0.35) * radius,
            cables=cables,
            telescope=0.55 * float(max(shortest, 0.2 * lengths.min())) if legs else None,
            tube=look.joint,
            ghost=ghost,
            # A page has numbers and legend, and colours legs by forces or shares itself.
            coloured=not getattr(node.window, "writes", False),
        )

    @staticmethod
    def _balls(
        node: ViewerNode, points: Array, radius: float, colour: int, opacity: float = 1.0
    ) -> None:
        made = objects.solid(objects.sphere(radius), colour, opacity)
        for i, point in enumerate(np.unique(np.round(points, 12), axis=0).tolist()):
            node[f"joint {i + 1}"].set_object(made)
            node[f"joint {i + 1}"].move_to(point)

    def move(self, posture: PlatformPosture, root: ViewerNode | None = None) -> None:
        """Put body and legs where they are at a pose; below another `root` places
        alone.
        """
        T, platform = posture.pose, self._platform
        body, legs = (self._body, None) if root is None else (root["body"], root["legs"])
        body.set_transform(T)
        points = se3.placed(T, platform.points)
        self._lines.move(platform.anchors, points, legs)

    def facts(self) -> dict[str, Any]:
        """Facts about the legs, for a viewer that moves the picture itself."""
        return {"telescope": self._lines.telescope}

    def paint(self, tensions: Array, taut: Array | None) -> dict[str, Any]:
        """Colour the legs by their tensions; return the legend."""
        return self._lines.carry(tensions, taut)


def _edges(corners: Array, colour: int) -> objects.Object | None:
    """Edges of a convex hull: the frame that cables hang from."""
    from scipy.spatial import ConvexHull, QhullError

    try:
        hull = ConvexHull(corners)
    except QhullError:
        return None
    ends = []
    for face, neighbours in enumerate(hull.neighbors):
        for corner, other in enumerate(neighbours):
            bent = (
                hull.equations[face, :3] @ hull.equations[other, :3]
                < 1 - numerics.NEGLIGIBLE_DIFFERENCE
            )
            if other > face and bent:
                ends += [
                    hull.points[v]
                    for k, v in enumerate(hull.simplices[face])
                    if k != corner
                ]
    return objects.lines(np.array(ends), colour) if ends else None


_UNPAINTED = 0xC8CCD0


class ChainPicture(_Picture):
    """Draws a chain once, then moves it; springs between its links are shown by the stick
    figure.
    """

    def __post_init__(self) -> None:
        self._chain = chain = cast(Chain, self.elastic.mechanism)
        self._boxes: list[tuple[FixedFrame, Array]] = []
        pieces, self._missing = visuals_of(chain)
        self._joints: dict[int, ViewerNode] = {}
        self._meshes = read_meshes(
            p.shape.path for p in pieces if isinstance(p.shape, MeshFile)
        )
        # Lengths of a robot description are metres, as are those of its mechanism.
        shown = [self._piece(i, visual) for i, visual in enumerate(pieces)]
        if self._missing:
            others = f" (and {n} more like it)" if (n := len(self._missing) - 1) else ""
            self.notes.append(self._missing[0] + others)
        self._sliders: list[tuple[ViewerNode, FixedFrame, Array, FixedFrame]] = []
        if self.notes or not any(shown):
            self._sticks(self.elastic.potentials)
            if self.notes:
                self.notes.append("sticks between the joints are drawn instead")
        self._moving = sorted(j for j in self._joints if j > 0)

    def move(self, posture: ChainPosture, root: ViewerNode | None = None) -> None:
        """Put every link where it is at a posture; below another `root` places alone."""
        at, joints = posture.pose_at, self._joints
        if root is not None:
            joints = {j: root[f"joint {j}"] for j in self._moving}
        for moving, T_F_j in zip(
            self._moving, posture.joint_poses(self._moving), strict=True
        ):
            joints[moving].set_transform(T_F_j)
        for node, parent, start, joint in self._sliders:
            T = at(parent)
            rod = node if root is None else root[_name_of(node)]
            rod.set_transform(objects.segment(se3.placed(T, start), at(joint)[:3, 3]))

    def facts(self) -> dict[str, Any]:
        """Nodes by the joints that move them, for a viewer that moves the
        picture itself.
        """
        return {
            "joints": self._moving,
            "sliders": [
                [_name_of(node), parent.joint, start.tolist(), joint.joint]
                for node, parent, start, joint in self._sliders
            ],
            "boxes": [[at.joint, box.tolist()] for at, box in self._boxes],
        }

    def corners(self, posture: ChainPosture) -> Array:
        """Corners (n, 3) in F of boxes around the meshes at a posture."""
        corners = [np.zeros((0, 3))]
        for placement, box in self._boxes:
            T = posture.pose_at(placement)
            corners.append(se3.placed(T, box))
        return np.concatenate(corners)

    def _on(self, joint: int) -> ViewerNode:
        if joint not in self._joints:
            self._joints[joint] = self.node[f"joint {joint}"]
        return self._joints[joint]

    def _piece(self, i: int, visual: Visual) -> bool:
        node = self._on(visual.at.joint)[f"{i} {visual.link.replace('/', ' ')}"]
        if isinstance(visual.shape, MeshFile):
            mesh = self._meshes[visual.shape.path]
        else:
            mesh = None
        if isinstance(mesh, InputError):
            self._missing.append(f"link {visual.link}: {mesh}")
            return False
        if mesh is not None and not len(mesh.faces):
            return False
        # Its place, and a box around a mesh.
        M = visual.at.T_j_f
        if isinstance(visual.shape, MeshFile):
            M = scaled(M, np.array(visual.shape.scale))
        if mesh is not None:
            ends = np.array(
                [mesh.positions.min(axis=0), mesh.positions.max(axis=0)], float
            )
            box = np.array(
                [[x, y, z] for x in ends[:, 0] for y in ends[:, 1] for z in ends[:, 2]]
            )
            box = se3.placed(M, box)
            self._boxes.append((FixedFrame(visual.at.joint, np.eye(4)), box))
        colour, opacity = self._paint(visual, mesh)
        for k, (geometry, own) in enumerate(
            _geometries(visual.shape, mesh, not self.ghost)
        ):
            part = node if k == 0 else node[f"part {k}"]
            part.set_object(objects.solid(geometry, colour, opacity, own))
        node.set_transform(M)
        return True

    def _paint(self, visual: Visual, mesh: Mesh | None) -> tuple[int, float]:
        colour, opacity = _UNPAINTED, 1.0
        if visual.colour is not None:
            colour = theme.hex_of(255 * np.array(visual.colour))
            opacity = max(visual.colour[3], 0.05)
        elif mesh is not None and mesh.colour is not None:
            colour = theme.hex_of(mesh.colour)
        return theme.shade(colour, self.ghost, opacity)

    def _sticks(self, lines: Sequence[Potential]) -> None:
        size, look, ghost, chain = self.size, self.look, self.ghost, self._chain
        link, knuckle = theme.shade(look.link, ghost), theme.shade(look.joint, ghost)
        radius = 0.012 * size
        for i, (joint, points) in enumerate(links_of(chain, lines)):
            if len(points) == 2:
                node = self._on(joint)[f"bone {i}"]
                node.set_object(objects.rod(radius, *link))
                node.set_transform(objects.segment(*points))
                continue
            # The ground plate of a planar mechanism must not hide its links.
            shade = theme.shade(look.link, ghost, 0.35 if joint == 0 else 0.85)
            if (made := objects.plate(points, 0.02 * size, *shade)) is not None:
                self._on(joint)[f"plate {i}"].set_object(made)
        for joint, screw, is_shared in knuckles_of(chain):
            node, slides = self._on(joint)["knuckle"], not screw[:3].any()
            if is_shared:
                made = objects.solid(objects.sphere(1.8 * radius), *knuckle)
            elif slides:
                sides = (5 * radius, 3 * radius, 3 * radius)
                made = objects.solid(objects.box(sides), *knuckle)
            else:
                geometry = objects.cylinder(1.8 * radius, 4.2 * radius)
                made = objects.solid(geometry, *knuckle, objects.Y_TO_X)
            node.set_object(made)
            if not is_shared:
                T = np.eye(4)
                T[:3, :3] = objects.rotation_to(screw[3:] if slides else screw[:3])
                node.set_transform(T)
            if slides:
                rod = self.node[f"slider {joint}"]
                rod.set_object(objects.rod(0.7 * radius, *link))
                model = chain.tree.model
                start = np.array(model.jointPlacements[joint].translation)
                parent, own = (
                    FixedFrame(j, np.eye(4)) for j in (model.parents[joint], joint)
                )
                self._sliders.append((rod, parent, start, own))


def _name_of(node: ViewerNode) -> str:
    return node.path.rpartition("/")[2]


def _geometries(
    shape: Shape, mesh: Mesh | None, coloured: bool
) -> list[tuple[objects.Object, Array | None]]:
    """three.js geometries of a shape, each with its motion in the shape's frame."""
    if mesh is not None:
        colours = mesh.colours if coloured else None
        positions = objects.on_grid(mesh.positions)
        return [(objects.mesh(positions, mesh.faces, mesh.normals, colours), None)]
    if isinstance(shape, Box):
        return [(objects.box(shape.sides), None)]
    if isinstance(shape, Cylinder):
        return [_cylinder(shape)]
    if isinstance(shape, Capsule):
        ends = []
        for side in (-0.5, 0.5):
            T = np.eye(4)
            T[2, 3] = side * shape.length
            ends.append((objects.sphere(shape.radius), T))
        return [_cylinder(shape), *ends]
    if isinstance(shape, MeshFile):
        return []
    return [(objects.sphere(), np.diag([*shape.radii, 1.0]))]


def _cylinder(shape: Cylinder | Capsule) -> tuple[objects.Object, Array]:
    return objects.cylinder(shape.radius, shape.length, 32), Y_TO_Z


def extent(elastic: ElasticMechanism, posture: MechanismPosture) -> Array:
    """Points (n, 3) in F that a picture has to hold: origins of joints, anchors,
    the body frame.
    """
    lines = _lines(elastic, posture)
    ends = [points for own in lines for points in (own.starts, own.ends)]
    return np.vstack([posture.drawn().points, *ends])


def _lines(elastic: ElasticMechanism, posture: MechanismPosture) -> list[Drawn]:
    """Lines beside the mechanism's own."""
    each = (term.drawn(posture) for term in elastic.potentials)
    return [own for own in each if own is not None]


class PathsPicture(_Picture):
    """Draws the lines of `MechanismPosture.drawn`, for a kind of mechanism of
    the user's own.
    """

    def __post_init__(self) -> None:
        starts, _ = self._ends(self.elastic.mechanism.at(self.elastic.q))
        self._lines = LinesPicture(
            self.node["paths"], len(starts), 0.012 * self.size, ghost=self.ghost
        )

    @staticmethod
    def _ends(posture: MechanismPosture) -> tuple[Array, Array]:
        """Ends (n, 3) of each piece of a path."""
        paths = posture.drawn().paths
        return np.vstack([p[:-1] for p in paths]), np.vstack([p[1:] for p in paths])

    def move(self, posture: MechanismPosture, root: ViewerNode | None = None) -> None:
        """Draw the paths at a posture; below another `root` places alone."""
        self._lines.move(*self._ends(posture), root and root["paths"])


# Pictures that show more than paths.
_PICTURES: dict[type, Any] = {Platform: PlatformPicture, Chain: ChainPicture}


class MechanismPicture(_Picture):
    """Draws a mechanism of any kind once, then moves it and colours what it carries."""

    def __post_init__(self) -> None:
        node, elastic, size, ghost = self.node, self.elastic, self.size, self.ghost
        kind = next((k for k in type(elastic.mechanism).__mro__ if k in _PICTURES), None)
        picture = PathsPicture if kind is None else _PICTURES[kind]
        self._own: Any = picture(node, elastic, size, self.look, ghost)
        self.notes = self._own.notes
        self._lines = [
            LinesPicture(
                node[f"springs {i + 1}"],
                len(own.starts),
                0.004 * size,
                cables=bool(own.are_cables.any()),
                ghost=ghost,
            )
            for i, own in enumerate(_lines(elastic, elastic.mechanism.at(elastic.q)))
        ]

    def move(self, posture: MechanismPosture, root: ViewerNode | None = None) -> None:
        """Put everything where it is at a posture.

        With another `root` only places below it are set: a viewer that copies what is
        drawn there shows the mechanism twice.
        """
        self._own.move(posture, root)
        lines = _lines(self.elastic, posture)
        for i, (picture, own) in enumerate(zip(self._lines, lines, strict=True)):
            picture.move(own.starts, own.ends, root and root[f"springs {i + 1}"])

    def corners(self, posture: MechanismPosture) -> Array:
        """Corners (n, 3) in F of boxes around the links' meshes.

        None for other pictures.
        """
        corners: Array = self._own.corners(posture)
        return corners

    def facts(self) -> dict[str, Any]:
        """Facts for a viewer that moves the picture itself."""
        facts: dict[str, Any] = self._own.facts()
        return facts

    def draw(self, result: PostureStiffness) -> dict[str, Any] | None:
        """Move to a result's posture and colour lines by their tension;
        returns what colours mean.

        Returns
        -------
        dict or None
            "unit", "limits", "values", "cables" and "slack" (numbers from 1), and under
            "lines" the same for every group of springs between links. None where there
            are no lines.
        """
        posture = result.posture
        self.move(posture)
        unit, answer = self.elastic.units.force, dict[str, Any]()
        tensions, lengths = result.tensions, result.leg_lengths
        if tensions is not None and lengths is not None:
            own, taut = self.elastic.springs, None
            if own is not None and own.unilateral:  # else every line is taut
                own = result.elastic.springs  # with its rest lengths
                taut = None if own is None else own.taut(posture)
            answer = {"unit": unit, **self._own.paint(tensions, taut)}
        if self._lines:
            answer["lines"] = []
            lines = _lines(result.elastic, posture)
            for picture, drawn in zip(self._lines, lines, strict=True):
                carried = picture.carry(drawn.tensions, drawn.is_taut)
                answer["lines"].append({"unit": unit, **carried})
        return answer or None
