r"""Working modes of legs of joints that end in a rigid rod:
the driven joint in closed form.

A leg whose first joint is driven, and whose other joints meet in a point C behind it and
in a point B of the body, is a crank or a rail with a rod of constant length (`LegShape`),
whatever its joints are called and however their axes are turned. B follows from the
body's pose, so that :math:`|B - C| = l` has one solution in each working mode: iterations
that end elsewhere have gone over to another elbow.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cartstiff.core import numerics
from cartstiff.core.arrays import Array
from cartstiff.core.geometry import se3
from cartstiff.kinematics.leg_shapes import LegShape
from cartstiff.kinematics.legs import Leg


class Rod(NamedTuple):
    """The driven joint of a leg, and its rod.

    Attributes
    ----------
    shape : LegShape
        Lengths and places of the crank or rail; its coordinate is zero at home.
    driven : int
        The driven coordinate among those of the leg.
    home : float
        Its value at home.
    mode : int
        Working mode at home.
    point : ndarray (3,)
        B in the frame of the leg's end.
    joints : tuple of list of int
        Coordinates of the joints that meet in C, and in B.
    """

    shape: LegShape
    driven: int
    home: float
    mode: int
    point: Array
    joints: tuple[list[int], list[int]]

    def coordinate(self, target: Array) -> Array:
        """The driven coordinate (N,) at poses (N, 4, 4) of the end; NaN beyond reach."""
        B = target[:, :3, :3] @ self.point + target[:, :3, 3]
        with np.errstate(invalid="ignore"):
            return np.asarray(self.home + self.shape.driven(B, self.mode)[0])

    def orientation(self, own: Array, pose: Array, jacobian: Array) -> Array:
        """The signs (N,) that the joints at C and B add to determinants of their twists.

        A universal joint, or a ball, may be turned over without any effect on rod and
        body.

        Parameters
        ----------
        own : ndarray (N, k)
            Coordinates of the leg.
        pose, jacobian : ndarray (N, 4, 4), (N, 6, k)
            Of its end: in the root's frame, and in its own.
        """
        C = self.shape.centre_at(own[:, self.driven] - self.home)
        n = pose[:, :3, :3] @ self.point + pose[:, :3, 3] - C
        n = (pose[:, :3, :3].swapaxes(1, 2) @ n[:, :, None])[:, :, 0]
        signs = np.ones(len(own))
        for joints in self.joints:
            axes = jacobian[:, :3, joints]
            if len(joints) in (2, 3):
                third = n if len(joints) == 2 else axes[:, :, 2]
                signs *= np.sign(
                    (np.cross(axes[:, :, 0], axes[:, :, 1]) * third).sum(axis=1)
                )
        return signs

    def keeps(self, own: Array, wanted: Array) -> NDArray[np.bool_]:
        """Whether coordinates (N, k) of the leg have the driven one where it is
        wanted (N,).
        """
        away = own[:, self.driven] - wanted
        if self.shape.family == "crank":
            away = (away + np.pi) % (2.0 * np.pi) - np.pi
        size = 1.0 if self.shape.family == "crank" else self.shape.rod
        return np.asarray(np.abs(away) <= _ALIKE * size)


# Two elbows nearer than this (rad, or shares of the rod) are at a singular posture of the
# leg, where iterations know the joint to the root of their tolerance only: its digits are
# lost.
_ALIKE = numerics.LOST_ERROR


def rod_of(leg: Leg, home: Array, actuated: frozenset[int]) -> Rod | None:
    """The rod of a leg at coordinates (k,) of its own; None for a leg of another shape.

    Parameters
    ----------
    leg : Leg
        From `legs_of`.
    home : ndarray (k,)
        Coordinates in the working mode that counts.
    actuated : frozenset of int
        Driven coordinates of the mechanism.
    """
    moving = _driven_and_passive(leg, len(home), actuated)
    if moving is None:
        return None
    driven, passive = moving
    is_passive = np.isin(np.arange(len(home)), passive)
    turned = np.random.default_rng(5).uniform(-0.5, 0.5, (2, len(home))) * is_passive
    postures = (home, *(home + turned))
    least = numerics.NEGLIGIBLE_DIFFERENCE * leg.solver.length
    for split in range(2, len(passive) + 1):
        joints = passive[:split], passive[split:]
        ends = [pair for q in postures if (pair := _ends(leg, q, *joints)) is not None]
        if len(ends) == len(postures) and _is_rod(ends, least):
            return _rod(leg, home, driven, joints, *ends[0])
    return None


def _driven_and_passive(
    leg: Leg, n: int, actuated: frozenset[int]
) -> tuple[int, list[int]] | None:
    """The driven joint and the others of a leg of n coordinates that may have a rod: the
    first one is driven, the others turn.
    """
    moving = [j for j in range(n) if j not in leg.chain.virtual]
    driven = [j for j in moving if int(leg.columns[j]) in actuated]
    if leg.hangs or leg.free not in ("none", "rotation") or driven != moving[:1]:
        return None
    passive = moving[1:]
    return None if leg.chain.is_length[passive].any() else (driven[0], passive)


def _is_rod(ends: list[tuple[Array, Array, Array]], least: float) -> bool:
    """Whether two points keep their distance, and the second one its place on the end."""
    lengths = [numerics.norm(B - C) for C, B, _ in ends]
    places = np.array([point for _, _, point in ends])
    moved = max(np.ptp(lengths), np.ptp(places, axis=0).max())
    return bool(moved <= least < lengths[0])


def _axes(leg: Leg, q: Array) -> tuple[Array, Array]:
    """Twists (6, k) of the leg's joints in the frame of its root,
    and the pose of its end.
    """
    at = leg.chain.at(q)
    return se3.adjoint(at.pose) @ at.motion.jacobian, at.pose


def _ends(
    leg: Leg, q: Array, first: list[int], last: list[int]
) -> tuple[Array, Array, Array] | None:
    """C and B (3,), and B in the frame of the leg's end, at coordinates of the leg."""
    twists, T = _axes(leg, q)
    C = _meeting(twists[:, first], leg.solver.length)
    B = T[:3, 3]
    if leg.free == "none":
        found = _meeting(twists[:, last], leg.solver.length)
        if found is None:
            return None
        B = found
    elif last:
        return None
    return None if C is None else (C, B, T[:3, :3].T @ (B - T[:3, 3]))


def _meeting(twists: Array, length: float) -> Array | None:
    """The point (3,) in which two axes or more meet, from their twists (6, k)."""
    if twists.shape[1] < 2:
        return None
    projections, places = [], []
    for w, v in zip(twists[:3].T, twists[3:].T, strict=True):
        n = w / np.linalg.norm(w)
        projections.append(np.eye(3) - np.outer(n, n))
        places.append(np.cross(n, v / np.linalg.norm(w)))
    A, b = (
        np.vstack(projections),
        np.concatenate([P @ c for P, c in zip(projections, places, strict=True)]),
    )
    point, _, rank, _ = np.linalg.lstsq(A, b, rcond=numerics.USUAL_RANK_RATIO)
    missed = float(np.abs(A @ point - b).max())
    return (
        point if rank == 3 and missed <= numerics.NEGLIGIBLE_DIFFERENCE * length else None
    )


def _rod(
    leg: Leg,
    home: Array,
    driven: int,
    joints: tuple[list[int], list[int]],
    C: Array,
    B: Array,
    point: Array,
) -> Rod | None:
    """The rod between C and B (3,); None if the driven joint does not move C."""
    # The driven joint slides C along its axis, or turns it about a centre.
    twist = _axes(leg, home)[0][:, driven]
    is_length = bool(leg.chain.is_length[driven])
    axis = twist[3:] if is_length else twist[:3]
    axis = axis / np.linalg.norm(axis)
    anchor, along, crank = C, axis, 0.0
    if not is_length:
        place = np.cross(axis, twist[3:])
        anchor = place + ((C - place) @ axis) * axis
        crank = numerics.norm(C - anchor)
        if crank <= numerics.NEGLIGIBLE_DISTANCE * leg.solver.length:
            return None
        along = (C - anchor) / crank
    shape = LegShape(
        "rail" if is_length else "crank",
        "S",
        False,
        "S",
        anchor,
        along,
        axis,
        axis,
        crank,
        numerics.norm(B - C),
        0.0,
        np.eye(4),
    )
    with np.errstate(invalid="ignore"):
        away = {m: abs(float(shape.driven(B[None], m)[0][0])) for m in shape.modes}
    mode = min(away, key=away.__getitem__)
    return Rod(shape, driven, float(home[driven]), mode, point, joints)
