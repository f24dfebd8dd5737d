"""A chain as a stick figure: bones between joint origins, knuckles at the joints, plates.

For robots whose files have no shapes, and in place of missing meshes. Everything is fixed to a
joint of the tree, except the sliders of prismatic joints.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from cartstiff import numerics
from cartstiff.geometry import se3
from cartstiff.geometry.se3 import Array
from cartstiff.mechanisms.chain import Chain
from cartstiff.potentials.line_springs import LineSprings

# Parts of a free joint: they are no links.
_FREE = (".x", ".y", ".z", ".rx", ".ry", ".rz")


@dataclass(frozen=True, eq=False)
class Bone:
    """A straight link between two points (3,) of the frame of a joint."""

    joint: int
    start: Array
    end: Array


@dataclass(frozen=True, eq=False)
class Plate:
    """A flat link through points (n, 3) of the frame of a joint."""

    joint: int
    corners: Array


@dataclass(frozen=True, eq=False)
class Knuckle:
    """A joint: its axis (3,) in its own frame, or None for one that turns about a point."""

    joint: int
    axis: Array | None
    prismatic: bool


@dataclass(frozen=True, eq=False)
class Slider:
    """The rod of a prismatic joint, from a point (3,) of its parent to the joint's origin."""

    joint: int
    parent: int
    start: Array


@dataclass
class Skeleton:
    """A stick figure.

    Attributes
    ----------
    bones, plates, knuckles, sliders : list
        Its parts.
    """

    bones: list[Bone] = field(default_factory=list)
    plates: list[Plate] = field(default_factory=list)
    knuckles: list[Knuckle] = field(default_factory=list)
    sliders: list[Slider] = field(default_factory=list)


def skeleton(chain: Chain, lines: tuple[LineSprings, ...] = ()) -> Skeleton:
    """Stick figure of a chain; `lines` are the springs whose end points belong to links too."""
    model = chain.tree.model
    count = model.njoints
    parents = [int(p) for p in model.parents]
    at = [np.array(T.homogeneous) for T in model.jointPlacements]
    scale = max([float(np.linalg.norm(T[:3, 3])) for T in at] + [numerics.NEGLIGIBLE_DIFFERENCE])
    names = [str(model.names[j]) for j in range(count)]
    virtual = {j for j in range(1, count) if j - 1 in chain.virtual}
    prismatic = [
        j > 0 and model.joints[j].shortname().startswith("JointModelP") for j in range(count)
    ]
    free = {j for j in range(1, count) if names[j].endswith(_FREE) and prismatic[j]}
    free |= {j for j in range(1, count) if names[j].endswith(_FREE[3:])}
    result = Skeleton()
    tied = _tied(chain)
    for joint in range(count):
        ends = [at[j][:3, 3] for j in range(1, count) if parents[j] == joint and j not in free]
        closing = tied.get(joint, [])
        last = joint == chain.body.joint
        grips = _grips(chain) if chain.kind == "parallel" and last else []
        if len(grips) > 2:
            corners = np.array(grips) @ chain.body.T_j_f[:3, :3].T + chain.body.T_j_f[:3, 3]
            result.plates.append(Plate(joint, corners))
        elif len(grips) == 2:
            a, b = (chain.body.T_j_f[:3, :3] @ g + chain.body.T_j_f[:3, 3] for g in grips)
            result.bones.append(Bone(joint, a, b))
        elif last:
            ends.append(chain.body.T_j_f[:3, 3])
        if chain.kind != "parallel":
            ends += closing
        if (len(closing) > 2 and chain.kind != "parallel") or (joint == 0 and len(ends) > 2):
            result.plates.append(Plate(joint, np.array(ends)))
            ends = []
        for line in lines:
            for frame, anchors in ((line.frame_a, line.anchors), (line.frame_b, line.points)):
                placed = chain.placement(frame)
                if placed.joint == joint and frame != "world":
                    ends += list(anchors @ placed.T_j_f[:3, :3].T + placed.T_j_f[:3, 3])
        for end in ends:
            if np.linalg.norm(end) > numerics.NEGLIGIBLE_DISTANCE * scale:
                result.bones.append(Bone(joint, np.zeros(3), end))
    for joint in range(1, count):
        if joint in virtual or joint in free:
            continue
        near = [j for j in range(1, count) if parents[j] == joint or j == parents[joint]]
        shared = any(
            j not in virtual | free
            and not prismatic[j]
            and np.linalg.norm(at[max(j, joint)][:3, 3]) <= numerics.NEGLIGIBLE_DIFFERENCE * scale
            for j in near
        )
        axis = _axis(model.joints[joint])
        result.knuckles.append(Knuckle(joint, None if shared else axis, prismatic[joint]))
        if prismatic[joint]:
            result.sliders.append(Slider(joint, parents[joint], at[joint][:3, 3]))
    return result


def _axis(joint: object) -> Array:
    """Unit axis of a one-coordinate joint in its own frame."""
    data = joint.createData()  # type: ignore[attr-defined]
    joint.calc(data, np.zeros(1))  # type: ignore[attr-defined]
    # Own frame and own coordinates: the motion's axis does not depend on where the joint stands.
    motion = np.asarray(data.S).reshape(6)
    part = motion[3:] if np.linalg.norm(motion[3:]) > 0 else motion[:3]
    return np.array(part / np.linalg.norm(part))


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
