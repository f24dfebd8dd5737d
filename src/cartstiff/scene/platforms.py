"""Bodies held by lines: plates, legs as telescopes or cables, tension in colour."""

from __future__ import annotations

from math import sqrt
from typing import Any

import numpy as np

from cartstiff import numerics
from cartstiff.geometry.se3 import Array
from cartstiff.mechanisms.platform import Platform, PlatformPosture
from cartstiff.potentials.line_springs import LineSprings
from cartstiff.scene import objects, shapes, theme
from cartstiff.scene.canvas import Node
from cartstiff.scene.scales import Tension


class LinesPicture:
    """Straight springs between points: one rod each, coloured by tension.

    Parameters
    ----------
    node : Node
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

    Attributes
    ----------
    telescope : float or None
        As given.
    """

    def __init__(
        self,
        node: Node,
        count: int,
        radius: float,
        *,
        cables: bool = False,
        telescope: float | None = None,
        tube: int = theme.LIGHT.joint,
        ghost: bool = False,
    ) -> None:
        self.telescope = telescope
        self._radius = radius
        self._cables = cables
        colour = theme.GHOST if ghost else 0xFFFFFF
        opacity = theme.GHOST_OPACITY if ghost else 1.0
        lines = [node[f"line {i + 1}"] for i in range(count)]
        self._rods = [line["rod"] for line in lines]
        self._tubes = [line["tube"] for line in lines] if telescope is not None else []
        self._shades: list[int | None] = [None] * count
        outer = theme.GHOST if ghost else tube
        for line in self._rods:
            line.set_object(shapes.rod(radius, colour, opacity))
        for line in self._tubes:
            line.set_object(shapes.rod(1.9 * radius, outer, opacity))
        self._dashed = [False] * count

    def move(self, starts: Array, ends: Array) -> None:
        """Draw each line from `starts` to `ends` (m, 3)."""
        for i, (start, end) in enumerate(zip(starts.tolist(), ends.tolist(), strict=True)):
            x, y, z = shapes.segment_columns(start, end)
            self._rods[i].set_columns(x, y, z, start)
            if self.telescope is not None:
                a, b, c = x
                share = min(1.0, self.telescope / sqrt(a * a + b * b + c * c))
                self._tubes[i].set_columns([share * a, share * b, share * c], y, z, start)

    def carry(self, springs: LineSprings, lengths: Array, scale: Tension) -> dict[str, Any]:
        """Colour each line by what it carries at a length; returns the legend.

        Tensions that are not known yet (no rest length) count as zero.
        """
        tensions = springs.tensions(lengths)
        tensions = np.where(np.isnan(tensions), 0.0, tensions)
        taut = springs.is_taut(lengths)
        scale.fit(tensions)
        self._paint(tensions, taut, scale)
        slack = [int(i) + 1 for i in np.flatnonzero(~taut)] if self._cables else []
        return {**scale.legend(), "values": tensions.tolist(), "slack": slack}

    def _paint(self, tensions: Array, taut: Array, scale: Tension) -> None:
        """Slack cables grey and dashed."""
        shades = [theme.shade(share) for share in scale.share(tensions).tolist()]
        for i, line in enumerate(self._rods):
            slack = self._cables and not taut[i]
            shade = theme.SLACK if slack else shades[i]
            if slack != self._dashed[i]:
                self._dashed[i] = slack
                rod = shapes.dashed_rod if slack else shapes.rod
                line.set_object(rod(self._radius, 0xFFFFFF))
                self._shades[i] = None
            if shade != self._shades[i]:
                self._shades[i] = shade
                line.set_property("color", [*theme.fractions(shade), 1.0])


class PlatformPicture:
    """Draws a Stewart-Gough platform, a body on springs, or a cable robot; then moves it."""

    def __init__(
        self,
        node: Node,
        platform: Platform,
        cables: bool,
        size: float,
        look: theme.Theme,
        reference: Array,
        *,
        ghost: bool = False,
    ) -> None:
        self._platform = platform
        self.notes: list[str] = []
        radius = 0.011 * size
        opacity = theme.GHOST_OPACITY if ghost else 1.0
        colour = theme.GHOST if ghost else look.plate
        ball = theme.GHOST if ghost else look.joint
        self._body = node["body"]
        solid_body = 0.45 if cables else 0.8
        flat = shapes.plate(platform.points, 0.025 * size, colour, min(opacity, solid_body))
        if flat is not None:
            self._body["plate"].set_object(flat)
        else:
            for i, point in enumerate(platform.points):
                if np.linalg.norm(point) > numerics.NEARBY * size:
                    rod = self._body[f"rod {i + 1}"]
                    rod.set_object(shapes.rod(radius, colour, opacity))
                    rod.set_transform(shapes.segment(np.zeros(3), point))
        self._balls(self._body, platform.points, 1.7 * radius, ball, opacity)
        if not ghost:
            self._ground(node["base"], size, look, ball)
        legs = platform.kind == "stewart-gough"
        lengths = platform.leg_lengths(reference)
        shortest = lengths.min() if platform.limits is None else platform.limits[:, 0].min()
        self._lines = LinesPicture(
            node["legs"],
            len(platform.points),
            (0.8 if legs else 0.35) * radius,
            cables=cables,
            telescope=0.55 * float(max(shortest, 0.2 * lengths.min())) if legs else None,
            tube=look.joint,
            ghost=ghost,
        )

    def _ground(self, node: Node, size: float, look: theme.Theme, ball: int) -> None:
        anchors = self._platform.anchors
        spread = np.linalg.svd(anchors - anchors.mean(axis=0), compute_uv=False)
        if spread[-1] < 0.2 * spread[0]:
            made = shapes.plate(anchors, 0.025 * size, look.plate, 0.9)
        else:
            made = _edges(anchors, look.link)
        if made is not None:
            node["plate"].set_object(made)
        self._balls(node, anchors, 0.017 * size, ball, 1.0)

    @staticmethod
    def _balls(node: Node, points: Array, radius: float, colour: int, opacity: float) -> None:
        for i, point in enumerate(np.unique(np.round(points, 12), axis=0)):
            T = np.eye(4)
            T[:3, 3] = point
            node[f"joint {i + 1}"].set_object(
                objects.solid(objects.sphere(radius), colour, opacity)
            )
            node[f"joint {i + 1}"].set_transform(T)

    def move(self, posture: PlatformPosture) -> None:
        """Put body and legs where they are at a pose."""
        T, platform = posture.pose, self._platform
        self._body.set_transform(T)
        self._lines.move(platform.anchors, platform.points @ T[:3, :3].T + T[:3, 3])

    def facts(self) -> dict[str, Any]:
        """What the legs are, for a viewer that moves the picture itself."""
        return {"telescope": self._lines.telescope, "colours": theme.DIVERGING.tolist()}

    def paint(self, springs: LineSprings, lengths: Array, scale: Tension) -> dict[str, Any]:
        """Colour the legs by what they carry; returns the legend."""
        return self._lines.carry(springs, lengths, scale)


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
            bent = hull.equations[face, :3] @ hull.equations[other, :3] < 1 - numerics.CLOSE
            if other > face and bent:
                ends += [hull.points[v] for k, v in enumerate(hull.simplices[face]) if k != corner]
    return objects.lines(np.array(ends), colour) if ends else None
