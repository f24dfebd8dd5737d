"""Any mechanism as a picture: chains, platforms, and the springs between their links."""

from __future__ import annotations

from typing import Any

import numpy as np

from cartstiff.geometry.se3 import Array
from cartstiff.mechanisms.chain import Chain, ChainPosture
from cartstiff.mechanisms.contract import MechanismPosture
from cartstiff.mechanisms.elastic import ElasticMechanism
from cartstiff.mechanisms.platform import Platform, PlatformPosture
from cartstiff.mechanisms.tree import FixedFrame
from cartstiff.potentials.line_springs import LineSprings, line_geometry
from cartstiff.scene import theme
from cartstiff.scene.canvas import Node
from cartstiff.scene.platforms import LinesPicture, PlatformPicture
from cartstiff.scene.robot import ChainPicture
from cartstiff.scene.scales import Tension
from cartstiff.stiffness.compute import PostureStiffness


def extent(elastic: ElasticMechanism, posture: MechanismPosture) -> Array:
    """Points (n, 3) in F that a picture has to hold: origins of joints, anchors, the body frame."""
    points = [posture.pose[:3, 3]]
    mechanism = elastic.mechanism
    if isinstance(mechanism, Platform):
        R, p = posture.pose[:3, :3], posture.pose[:3, 3]
        points = [*mechanism.anchors, *(mechanism.points @ R.T + p)]
    elif isinstance(mechanism, Chain) and isinstance(posture, ChainPosture):
        count = mechanism.tree.model.njoints
        points += [posture.pose_at(FixedFrame(j, np.eye(4)))[:3, 3] for j in range(count)]
    points += [end for ends in _lines(elastic, posture) for pair in ends[1:] for end in pair]
    return np.array(points)


def _lines(
    elastic: ElasticMechanism, posture: MechanismPosture
) -> list[tuple[LineSprings, Array, Array]]:
    """Line springs beside the mechanism's own, with their end points (m, 3) in F."""
    lines = []
    for term in elastic.potentials:
        if isinstance(term, LineSprings):
            ends = []
            for frame, points in ((term.frame_a, term.anchors), (term.frame_b, term.points)):
                T = _pose(elastic, posture, frame)
                ends.append(points @ T[:3, :3].T + T[:3, 3])
            lines.append((term, ends[0], ends[1]))
    return lines


def _pose(elastic: ElasticMechanism, posture: MechanismPosture, frame: str) -> Array:
    if isinstance(posture, ChainPosture) and isinstance(elastic.mechanism, Chain):
        return posture.pose_at(elastic.mechanism.placement(frame))
    return posture.relative("world", frame)[0]


class MechanismPicture:
    """Draws a mechanism once, then moves it and colours what it carries.

    Attributes
    ----------
    node : Node
        Its place.
    notes : list of str
        What cannot be shown.
    """

    def __init__(
        self,
        node: Node,
        elastic: ElasticMechanism,
        size: float,
        look: theme.Theme,
        *,
        ghost: bool = False,
    ) -> None:
        self.node = node
        self.notes: list[str] = []
        self._elastic, self._ghost = elastic, ghost
        mechanism, own = elastic.mechanism, elastic.springs
        self._platform: PlatformPicture | None = None
        self._chain: ChainPicture | None = None
        lines = tuple(term for term in elastic.potentials if isinstance(term, LineSprings))
        if isinstance(mechanism, Platform):
            cables = isinstance(own, LineSprings) and own.unilateral
            self._platform = PlatformPicture(
                node, mechanism, cables, size, look, elastic.q, ghost=ghost
            )
        elif isinstance(mechanism, Chain):
            self._chain = ChainPicture(node, mechanism, size, look, ghost=ghost, lines=lines)
            self.notes = self._chain.notes
        else:
            self.notes = [f"a {mechanism.kind} mechanism has no picture of its own"]
        self._lines = [
            LinesPicture(
                node[f"springs {i + 1}"],
                len(term.points),
                0.004 * size,
                cables=term.unilateral,
                ghost=ghost,
            )
            for i, term in enumerate(lines)
        ]
        self._scales = [Tension() for _ in range(1 + len(lines))]

    def move(self, posture: MechanismPosture) -> None:
        """Put everything where it is at a posture."""
        if self._platform is not None and isinstance(posture, PlatformPosture):
            self._platform.move(posture)
        if self._chain is not None and isinstance(posture, ChainPosture):
            self._chain.move(posture)
        for picture, (_, starts, ends) in zip(
            self._lines, _lines(self._elastic, posture), strict=True
        ):
            picture.move(starts, ends)

    def corners(self, posture: MechanismPosture) -> Array:
        """Corners (n, 3) in F of boxes around the links' meshes; none for other pictures."""
        if self._chain is None or not isinstance(posture, ChainPosture):
            return np.zeros((0, 3))
        return self._chain.corners(posture)

    def facts(self) -> dict[str, Any]:
        """What a viewer needs that moves the picture itself."""
        part = self._chain or self._platform
        return {} if part is None else part.facts()

    def draw(self, result: PostureStiffness) -> dict[str, Any] | None:
        """Move to a result's posture and colour lines by their tension; returns what colours mean.

        Returns
        -------
        dict or None
            "unit", "limits", "values" and "slack" (numbers from 1), and under "lines" the same for
            every group of springs between links. None where there are no lines.
        """
        self.move(result.posture)
        if self._platform is None and not self._lines:
            return None
        unit = self._elastic.units.force
        answer: dict[str, Any] | None = None
        springs, posture = result.elastic.springs, result.posture
        if (
            self._platform is not None
            and isinstance(springs, LineSprings)
            and isinstance(posture, PlatformPosture)
        ):
            lengths = springs.geometry(posture).lengths
            legs = self._platform.paint(springs, lengths, self._scales[0])
            answer = {"unit": unit, **legs}
        groups = []
        terms = _lines(result.elastic, posture)
        for picture, scale, (term, starts, ends) in zip(
            self._lines, self._scales[1:], terms, strict=True
        ):
            lengths = line_geometry(np.eye(4), starts, ends).lengths
            groups.append({"unit": unit, **picture.carry(term, lengths, scale)})
        if groups:
            answer = {**(answer or {}), "lines": groups}
        return answer
