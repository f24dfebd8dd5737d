"""A chain as a stick figure: links between joint origins, knuckles at the joints.

For robots whose files have no shapes, and in place of missing meshes. Everything is fixed
to a joint of the tree.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from cartstiff.core import numerics
from cartstiff.core.arrays import Array
from cartstiff.core.geometry import se3
from cartstiff.core.mechanisms.chain import Chain
from cartstiff.core.potentials.contract import Potential

# Parts of a free joint: they are no links.
_FREE = (".x", ".y", ".z", ".rx", ".ry", ".rz")


def links_of(chain: Chain, lines: Sequence[Potential]) -> Iterator[tuple[int, Array]]:
    """Yield the joint that each link is fixed to, and the link's points (n, 3)
    in its frame.

    Two points are the ends of a straight link, more are the corners of a plate. `lines`
    are springs whose end points belong to links, too.
    """
    model, is_parallel = chain.tree.model, chain.kind == "parallel"
    origins, free, body = _origins(chain), _free(chain), chain.body.T_j_f
    least = numerics.NEGLIGIBLE_DISTANCE * _size(origins)
    tied = {} if is_parallel else _tied(chain)
    for joint in range(model.njoints):
        ends = [
            origins[j]
            for j in range(1, model.njoints)
            if model.parents[j] == joint and j not in free
        ]
        # The body, and what closures tie to the link.
        if joint == chain.body.joint:
            grips = _grips(chain) if is_parallel else []
            if len(grips) > 1:
                yield joint, se3.placed(body, grips)
            else:
                ends.append(body[:3, 3])
        closing = tied.get(joint, [])
        ends += closing
        if len(closing) > 2 or (joint == 0 and len(ends) > 2):
            yield joint, np.array(ends)
            ends = []
        # Ends of springs.
        for line in lines:
            for frame, anchors in line.attachments():
                placed = chain.placement(frame)
                if placed.joint == joint and frame != "world":
                    ends += list(se3.placed(placed.T_j_f, anchors))
        for end in ends:
            if np.linalg.norm(end) > least:
                yield joint, np.array([np.zeros(3), end])


def knuckles_of(chain: Chain) -> Iterator[tuple[int, Array, bool]]:
    """Yield each joint with its constant twist (6,) in its own frame.

    Last is whether it has a neighbour at the same place: the two turn about a point.
    """
    model, screws, origins = chain.tree.model, chain.tree.screws(), _origins(chain)
    least = numerics.NEGLIGIBLE_DIFFERENCE * _size(origins)
    shown = {j for j in range(1, model.njoints) if j - 1 not in chain.virtual} - _free(
        chain
    )
    for joint in sorted(shown):
        near = [
            j for j in shown if model.parents[j] == joint or j == model.parents[joint]
        ]
        is_shared = any(
            screws[j - 1, :3].any() and np.linalg.norm(origins[max(j, joint)]) <= least
            for j in near
        )
        yield joint, screws[joint - 1], is_shared


def _origins(chain: Chain) -> list[Array]:
    """The origin (3,) of each joint, in the frame of the joint before it."""
    return [np.array(T.translation) for T in chain.tree.model.jointPlacements]


def _size(origins: list[Array]) -> float:
    return max(numerics.NEGLIGIBLE_DIFFERENCE, *(numerics.norm(p) for p in origins))


def _free(chain: Chain) -> set[int]:
    """Joints that are parts of free joints."""
    names, screws = chain.tree.model.names, chain.tree.screws()
    return {
        joint
        for joint, screw in enumerate(screws, start=1)
        if names[joint].endswith(_FREE[3:] if screw[:3].any() else _FREE)
    }


def _tied(chain: Chain) -> dict[int, list[Array]]:
    """Points of closures by the joint whose link they are on."""
    places: dict[int, list[Array]] = {}
    for closure in chain.closures:
        for name in (closure.frame_a, closure.frame_b):
            place = chain.placement(name)
            if place.joint > 0:
                places.setdefault(place.joint, []).append(place.T_j_f[:3, 3])
    return places


def _grips(chain: Chain) -> list[Array]:
    """Origins of the last joints of the legs, which hold the body, in the body frame."""
    frames = {name for c in chain.closures for name in (c.frame_a, c.frame_b)}
    return [se3.inverse(chain.placement(name).T_j_f)[:3, 3] for name in sorted(frames)]
