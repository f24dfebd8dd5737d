r"""Legs of parallel machines whose kinematics are known in closed form: struts, rails,
cranks.

Every such leg ends at a point B of the body and has a straight *rod* from a point C to B,

    strut   C is fixed to the ground, the rod changes its length    UPS, RPS, SPR, UCU, UP
    rail    C slides along a straight line, C = A + s d, rigid rod  PUS, PRS, PUU, PSS
    crank   C moves on a circle, C = A + r e(t), rigid rod          RUS, RUU, RSS, RRR

so that with B known from the body's pose the driven coordinate follows from :math:`|B -
C| = l`: a length, the root of a quadratic, or of :math:`a \cos t + b \sin t = c` [MER]_.
The joints at C and B follow from the rotations of the rod and the body. Passive
coordinates are zero where the leg was drawn (its *home*); the driven coordinate is a
distance or an angle.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import numpy as np

from cartstiff.core import numerics
from cartstiff.core.arrays import Array
from cartstiff.core.errors import InputError
from cartstiff.core.lazily import cached_property
from cartstiff.core.potentials.contract import POSE

Family = Literal["strut", "rail", "crank"]


def turns(axis: Array, angle: Array) -> Array:
    """Return rotations (..., 3, 3) about a unit axis (3,) by angles (...)."""
    x, y, z = axis
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    angle = np.asarray(angle)[..., None, None]
    R: Array = np.eye(3) + np.sin(angle) * K + (1.0 - np.cos(angle)) * (K @ K)
    return R


def frame_along(first: Array, second: Array) -> Array:
    """Return rotations (..., 3, 3): x along the first vectors,
    y across them towards the second.

    NaN where the second lies along the first.
    """
    x = first / np.linalg.norm(first, axis=-1, keepdims=True)
    y = second - (second * x).sum(axis=-1, keepdims=True) * x
    size = np.linalg.norm(y, axis=-1, keepdims=True)
    with np.errstate(invalid="ignore"):
        least = numerics.NEGLIGIBLE_DIFFERENCE * np.linalg.norm(second)
        y = np.where(size > least, y / size, np.nan)
    return np.stack([x, y, np.cross(x, y)], axis=-1)


@dataclass(frozen=True, eq=False)
class LegShape:
    """A leg from the ground to a point of the body.

    Attributes
    ----------
    family : {"strut", "rail", "crank"}
        Motion of C by the driven joint.
    middle : {"U", "R", "S"}
        The joint at C.
    spins : bool
        Whether a strut turns about its own line (a cylindrical joint).
    end : {"S", "U", "R", ""}
        The joint at B; none: the rod is fixed to the body.
    anchor : ndarray (3,)
        A in F: the start of a strut, the zero of a rail's coordinate, the crank's centre.
    along : ndarray (3,)
        Unit vector along a rail, or along a crank at angle zero.
    axis : ndarray (3,)
        Unit axis in F of the crank, and at home of the hinge or first axis of the
        universal joint at C.
    end_axis : ndarray (3,)
        Unit axis at home of the hinge at B, or of the body's axis of the universal joint
        there.
    crank, rod : float
        Lengths; 0 without a crank, and for a rod whose length changes.
    home : float
        Driven coordinate at home.
    end_home : ndarray (4, 4)
        Pose of the leg's end at home, in F: its origin is B.
    """

    family: Family
    middle: str
    spins: bool
    end: str
    anchor: Array
    along: Array
    axis: Array
    end_axis: Array
    crank: float
    rod: float
    home: float
    end_home: Array

    @property
    def modes(self) -> tuple[int, ...]:
        """Signs of the root that the driven coordinate may take: its working modes."""
        return (1,) if self.family == "strut" else (-1, 1)

    @property
    def length_powers(self) -> dict[str, Any]:
        """See `cartstiff.core.potentials.contract.rescaled`."""
        home = int(self.family != "crank")
        return {"anchor": 1, "crank": 1, "rod": 1, "home": home, "end_home": POSE}

    def driven(self, B: Array, mode: int) -> tuple[Array, Array]:
        """The driven coordinate (N,) and C (N, 3) with the leg's end at points B (N, 3).

        NaN where the leg does not reach B; `mode` is the sign of the root.
        """
        d = B - self.anchor
        if self.family == "strut":
            return np.linalg.norm(d, axis=1), np.broadcast_to(self.anchor, d.shape)
        with np.errstate(invalid="ignore"):
            if self.family == "rail":
                along = d @ self.along
                across = (d * d).sum(axis=1) - along * along
                s = along + mode * np.sqrt(self.rod**2 - across)
                return s, self.centre_at(s)
            a, b = d @ self.along, d @ self.side
            c = ((d * d).sum(axis=1) + self.crank**2 - self.rod**2) / (2.0 * self.crank)
            t = np.arctan2(b, a) + mode * np.arccos(c / np.hypot(a, b))
        t = np.pi - np.mod(np.pi - t, 2.0 * np.pi)
        return t, self.centre_at(t)

    def short_of(self, B: Array) -> float:
        """Return the distance by which the leg fails to reach a point B (3,); or 0."""
        d = B - self.anchor
        if self.family == "strut":
            return 0.0
        if self.family == "rail":
            away = numerics.norm(d - (d @ self.along) * self.along)
            return max(0.0, away - self.rod)
        height = float(d @ self.axis)
        radius = numerics.norm(d - height * self.axis)
        near = float(np.hypot(radius - self.crank, height))
        far = float(np.hypot(radius + self.crank, height))
        return max(0.0, near - self.rod, self.rod - far)

    def inverse(self, T: Array, mode: int) -> tuple[Array, Array]:
        """Return coordinates (N, k), in the joints' order,
        with the leg's end at poses T (N, 4, 4).

        Also the rotation errors (N,) in rad: a leg with fewer than six freedoms reaches
        some poses only. NaN where it does not reach B.
        """
        return self._solved(T, mode)[:2]

    def gaps(self, T: Array, mode: int) -> Array:
        """Return smooth residuals (N, 6) at poses T (N, 4, 4),
        zero where the leg reaches the pose.

        The difference of the rod's direction from the wanted one, and the axis of the
        remaining turn at B times its sine.
        """
        return self._solved(T, mode)[2]

    def _solved(self, T: Array, mode: int) -> tuple[Array, Array, Array]:
        """Coordinates, rotation errors and residuals."""
        B = T[:, :3, 3]
        body = T[:, :3, :3] @ self.end_home[:3, :3].T  # turned since home, in F
        driven, C = self.driven(B, mode)
        n = B - C
        n = n / np.linalg.norm(n, axis=1, keepdims=True)
        carrier = np.broadcast_to(np.eye(3), body.shape)
        if self.family == "crank":
            carrier = turns(self.axis, driven - self.home)
        angles, rod = self._middle(n, carrier, body)
        spin: list[Array] = []
        if self.spins and self.end == "S":
            spin = [np.zeros(len(T))]
        elif self.spins:
            aim = self._by_end(n, body) if self.end else body
            turned = self.rod_frame.T @ rod.swapaxes(1, 2) @ aim @ self.rod_frame
            spin = [np.arctan2(turned[:, 2, 1], turned[:, 1, 1])]
            rod = rod @ turns(self.line, spin[0])
        # What is left to turn at B, and what its joint cannot make.
        left = rod.swapaxes(1, 2) @ body
        gap = np.zeros((len(T), 6))
        gap[:, :3] = (rod @ self.line) - n
        missed = np.linalg.norm(gap[:, :3], axis=1)
        if self.end == "S":
            end = _about_three_axes(self.end_home[:3, :3], left)
        else:
            end, made = self._end(left)
            apart = made.swapaxes(1, 2) @ left
            error = np.linalg.norm(apart - np.eye(3), axis=(1, 2))
            missed = missed + error / np.sqrt(2.0)
            gap[:, 3:] = 0.5 * (apart - apart.swapaxes(1, 2))[:, (2, 0, 1), (1, 2, 0)]
        strut = self.family == "strut"
        near = [*angles, driven, *spin] if strut else [driven, *angles]
        return np.stack([*near, *end], axis=1), missed, gap

    def _middle(self, n: Array, carrier: Array, body: Array) -> tuple[list[Array], Array]:
        """Angles at C and the rotation of the rod, with its line along n (N, 3) and what
        carries it turned by `carrier`.
        """
        back = carrier.swapaxes(1, 2)
        if self.middle == "S":
            rod = self._by_end(n, body) if self.end in ("R", "U") else body
            return _about_three_axes(self.rod_frame, back @ rod), rod
        own, n0 = (back @ n[..., None])[..., 0], self.line
        if self.middle == "U":
            m, b = self.universal
            u = np.arctan2(own @ b, own @ m)
            tilt = np.arctan2(-own @ self.axis, np.hypot(own @ m, own @ b))
            w = tilt - np.arctan2(-n0 @ self.axis, n0 @ m)
            return [u, w], carrier @ turns(self.axis, u) @ turns(b, w)
        along = own @ n0 - (own @ self.axis) * (n0 @ self.axis)
        u = np.arctan2(own @ self.across, along)
        return [u], carrier @ turns(self.axis, u)

    @cached_property
    def line(self) -> Array:
        """Unit vector of the rod at home."""
        d = self.end_home[:3, 3] - self.centre
        return np.asarray(d / np.linalg.norm(d))

    @cached_property
    def centre(self) -> Array:
        """C at home."""
        return self.centre_at(np.asarray(self.home))

    def centre_at(self, driven: Array) -> Array:
        """Return C (..., 3) at driven coordinates (...)."""
        if self.family == "strut":
            return self.anchor
        if self.family == "rail":
            return np.asarray(self.anchor + driven[..., None] * self.along)
        arm = (
            np.cos(driven)[..., None] * self.along + np.sin(driven)[..., None] * self.side
        )
        return np.asarray(self.anchor + self.crank * arm)

    @cached_property
    def side(self) -> Array:
        """Direction across a crank's axis and its direction at zero."""
        return np.cross(self.axis, self.along)

    @cached_property
    def across(self) -> Array:
        """Direction across a leg's first axis and the rod at home."""
        return np.cross(self.axis, self.line)

    @cached_property
    def universal(self) -> tuple[Array, Array]:
        """Axes across the first axis of a universal joint at C: near the rod,
        and its second axis.

        Raises
        ------
        InputError
            If the rod lies along the first axis.
        """
        return _across(self.axis, self.line)

    @cached_property
    def end_inner(self) -> Array:
        """The rod's axis of a universal joint at B, at home; errors as `universal`."""
        return _across(self.end_axis, self.line)[1]

    @cached_property
    def rod_frame(self) -> Array:
        """Rotation of the rod's frame at home: x along it, y along its last axis at C."""
        if self.middle == "U":
            return frame_along(self.line, self.universal[1])
        if self.middle == "R":
            return frame_along(self.line, self.axis)
        helper = np.eye(3)[int(np.argmin(np.abs(self.line)))]
        return frame_along(self.line, helper)

    def _by_end(self, n: Array, body: Array) -> Array:
        """Rotation of the rod from a hinge or universal joint at B."""
        now = np.broadcast_to((body @ self.end_axis), n.shape)
        R: Array = frame_along(n, now) @ frame_along(self.line, self.end_axis).T
        return R

    def _end(self, left: Array) -> tuple[list[Array], Array]:
        """Angles of the hinge or universal joint at B,
        and the rotation that they make.
        """
        if not self.end:
            return [], np.broadcast_to(np.eye(3), left.shape)
        if self.end == "R":
            G = frame_along(
                self.end_axis, np.eye(3)[int(np.argmin(np.abs(self.end_axis)))]
            )
            M = G.T @ left @ G
            angle = np.arctan2(M[:, 2, 1] - M[:, 1, 2], M[:, 1, 1] + M[:, 2, 2])
            return [angle], turns(self.end_axis, angle)
        G = frame_along(self.end_inner, self.end_axis)
        M = G.T @ left @ G
        first, second = (
            np.arctan2(M[:, 2, 1], M[:, 1, 1]),
            np.arctan2(M[:, 0, 2], M[:, 0, 0]),
        )
        return [first, second], turns(self.end_inner, first) @ turns(
            self.end_axis, second
        )


def _across(axis: Array, line: Array) -> tuple[Array, Array]:
    """Two unit vectors across an axis: the nearest to a line, and the one across both."""
    m = line - (line @ axis) * axis
    size = numerics.norm(m)
    if size < numerics.NEGLIGIBLE_DISTANCE:
        raise InputError(
            "the rod lies along an axis of its universal joint",
            expected="another axis or pose",
        )
    m = m / size
    return m, np.cross(axis, m)


def _about_three_axes(frame: Array, R: Array) -> list[Array]:
    """Angles (N,) of successive turns about x, y, z of a frame that make
    rotations (N, 3, 3).
    """
    M = frame.T @ R @ frame
    return [
        np.arctan2(-M[:, 1, 2], M[:, 2, 2]),
        np.arctan2(M[:, 0, 2], np.hypot(M[:, 0, 0], M[:, 0, 1])),
        np.arctan2(-M[:, 0, 1], M[:, 0, 0]),
    ]


@dataclass(frozen=True, eq=False)
class PlacedLeg:
    """A leg of a chain with kinematics in closed form.

    Attributes
    ----------
    shape : LegShape
        Its dimensions.
    columns : tuple of int
        Its coordinates in the chain, in the joints' order.
    driven : int
        The driven coordinate in the chain.
    T_M_end : ndarray (4, 4)
        Pose of its end in the body frame.
    diameter : float, optional
        Diameter of the rod.
    """

    shape: LegShape
    columns: tuple[int, ...]
    driven: int
    T_M_end: Array
    diameter: float | None = None

    length_powers: ClassVar = {"shape": 0, "T_M_end": POSE, "diameter": 1}

    def rod(self, q: Array, pose: Array) -> tuple[Array, Array]:
        """Return the ends (..., 3) of the rod at coordinates q (..., n) and poses
        (..., 4, 4).
        """
        B = pose[..., :3, :3] @ self.T_M_end[:3, 3] + pose[..., :3, 3]
        return np.broadcast_to(self.shape.centre_at(q[..., self.driven]), B.shape), B

    def mode(self, q: Array, T_F_M: Array) -> int:
        """The working mode of coordinates q (n,) of the chain at the body's pose."""
        B = (T_F_M @ self.T_M_end)[None, :3, 3]
        value, is_angle = float(q[self.driven]), self.shape.family == "crank"

        def distance(mode: int) -> float:
            d = float(self.shape.driven(B, mode)[0][0]) - value
            d = (d + np.pi) % (2.0 * np.pi) - np.pi if is_angle else d
            return abs(d) if np.isfinite(d) else np.inf

        return min(self.shape.modes, key=distance)
