"""Compliant links: their virtual joints, and the frames and masses on either
side of them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pinocchio as pin

from cartstiff.core import numerics
from cartstiff.core.arrays import Array
from cartstiff.core.errors import check_name
from cartstiff.core.geometry import se3
from cartstiff.files.plain_joints import primitive

#: Virtual joints of a link with a 6x6 spring, in order: name suffix and kind.
VIRTUAL = (
    ("px", "PX"),
    ("py", "PY"),
    ("pz", "PZ"),
    ("rx", "RX"),
    ("ry", "RY"),
    ("rz", "RZ"),
)
#: Virtual joints of a beam's segment: section to chord, along and about it, chord to
#: section.
SEGMENT = (
    ("near_ry", "RY"),
    ("near_rz", "RZ"),
    ("px", "PX"),
    ("rx", "RX"),
    ("far_rz", "RZ"),
    ("far_ry", "RY"),
)


#: A joint, and the pose of another frame in its frame.
Place = tuple[int, Array]
#: Frame index of a joint without a frame, as in models that were made by hand: links
#: carry it.
UNFRAMED = -1


@dataclass(frozen=True, eq=False)
class Give:
    """Virtual joints of a compliant link: those of a spring, or of a beam along x.

    Attributes
    ----------
    start : ndarray, shape (4, 4)
        Pose of the spring, or of the beam's near end, in the link's frame.
    length : float
        Length of the beam; 0 for a spring.
    segments : int
        Equal parts of the beam.
    own : tuple of float, optional
        The beam's own mass per length, and its moments of inertia per length about the y
        and z axes of the section.
    mass : ndarray, shape (6, 6), optional
        Mass of a spring's deflection, order angular-linear.
    """

    start: Array
    length: float = 0.0
    segments: int = 0
    own: tuple[float, float, float] | None = None
    mass: Array | None = None

    def half(self, sign: float) -> Any:
        """Inertia of half a segment as a rigid bar along x that begins or ends
        in the origin.

        Every node of the beam carries the halves of the segments beside it: a lumped
        mass, with the mass, the centre and the moments of inertia of the straight beam.
        """
        if self.own is None or not self.segments:
            return None
        h = 0.5 * self.length / self.segments
        mass, about_y, about_z = (h * x for x in self.own)
        bar = mass * h * h / 12
        return pin.Inertia(
            mass,
            np.array([sign * 0.5 * h, 0.0, 0.0]),
            np.diag([about_y + about_z, about_y + bar, about_z + bar]),
        )

    @property
    def joints(self) -> list[tuple[str, str, float]]:
        """Name suffix, kind, and distance along x from the joint before."""
        if not self.segments:
            return [(suffix, kind, 0.0) for suffix, kind in VIRTUAL]
        step = self.length / self.segments
        return [
            (
                suffix if self.segments == 1 else f"{suffix}_{i}",
                kind,
                step if suffix == "px" else 0.0,
            )
            for i in range(1, self.segments + 1)
            for suffix, kind in SEGMENT
        ]

    @property
    def end(self) -> Array:
        """Pose of the far side in the link's frame, at rest."""
        return self.start @ se3.pose(translation=(self.length, 0.0, 0.0))


@dataclass(frozen=True)
class LinkSpring:
    """Virtual joints of a link, placed in the joint's frame,
    and the frames that they carry.
    """

    link: str
    frame: int
    give: Give
    carried: frozenset[int]


@dataclass(frozen=True, eq=False)
class DeflectionMass:
    """Mass of a compliant link's deflection: the near end of its spring,
    and its first coordinate.

    With the spring's rates u the kinetic energy is ``1/2 |R u|^2``, ``R^T R`` the mass:
    six rotors of unit inertia turn by R u.
    """

    link: str
    joint: int
    T_j_spring: Array
    first: int
    mass: Array

    def added(self, plain: pin.Model, n: int) -> Array:
        """Add the rotors; return their rows (6, n) of mimics."""
        sizes = numerics.equilibration(self.mass)
        values, vectors = np.linalg.eigh(self.mass / np.outer(sizes, sizes))
        root = np.sqrt(np.maximum(values, 0.0))[:, None] * (vectors.T * sizes)
        rows = np.zeros((6, n))
        rows[:, self.first : self.first + 6] = root[:, se3.SWAP]
        for i in range(6):
            rotor = plain.addJoint(
                self.joint,
                primitive("RX"),
                pin.SE3(self.T_j_spring),
                f"{self.link}.rotor.{i}",
            )
            plain.armature[plain.idx_vs[rotor]] = 1.0
        return rows


def springs_by_joint(
    model: pin.Model, flexible: Mapping[str, Give] | None
) -> dict[int, list[LinkSpring]]:
    """Return the virtual joints of compliant links by the joint that carries their links.

    Links that carry others precede them.
    """
    springs: dict[int, list[LinkSpring]] = {}
    if not flexible:
        return springs
    bodies = {
        f.name: k for k, f in enumerate(model.frames) if f.type == pin.FrameType.BODY
    }
    for name in flexible:
        check_name("link", name, bodies)
    # Parents come before their children in Pinocchio's list of frames.
    for name in sorted(flexible, key=lambda name: bodies[name]):
        k, give = bodies[name], flexible[name]
        link = model.frames[k]
        give = replace(give, start=link.placement.homogeneous @ give.start)
        spring = LinkSpring(name, k, give, _carried(model, k))
        springs.setdefault(int(link.parentJoint), []).append(spring)
    return springs


def _carried(model: pin.Model, link: int) -> frozenset[int]:
    """Indices of the frames that a link carries, directly or through others;
    and `UNFRAMED`.
    """
    frames = list(model.frames)
    places = [(int(f.parentJoint), int(f.parentFrame)) for f in frames]
    bodies = [k for k, f in enumerate(frames) if f.type == pin.FrameType.BODY]
    alone = [k for k in bodies if places[k] == places[link]]
    _, base = places[link]
    moved = frames[base].type == pin.FrameType.JOINT or base == 0
    if moved and alone == [link]:  # the only link on the joint carries all other frames
        return frozenset(range(UNFRAMED, len(frames))) - {link, base}
    carried = {link}
    for k, (_, parent) in enumerate(places):  # parents come before their children
        if parent in carried:
            carried.add(k)
    return frozenset(carried - {link} | {UNFRAMED})
