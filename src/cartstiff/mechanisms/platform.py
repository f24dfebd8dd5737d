r"""A rigid body held by lines from the ground: Stewart-Gough platforms, line springs, cable robots.

The coordinates are the body's pose; derivatives are taken in exponential coordinates at the pose,
so the body Jacobian is the identity and the Hessian of any potential is its K^B.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from cartstiff import numerics
from cartstiff.arrays import (
    checked_array,
    checked_pose,
    checked_vector,
    read_only,
    real_array,
)
from cartstiff.errors import ConvergenceError, InputError, UndefinedError, UnknownNameError
from cartstiff.geometry import se3
from cartstiff.geometry.se3 import Array
from cartstiff.lazily import cached_property
from cartstiff.mechanisms.contract import SI, Coordinate, Mechanism, MechanismPosture, Units
from cartstiff.mechanisms.leg_limits import LegLimits
from cartstiff.mechanisms.struts import Struts
from cartstiff.potentials.contract import IDENTITY, Evaluation, Map
from cartstiff.potentials.line_springs import LineGeometry, line_geometry, second_derivative
from cartstiff.potentials.loads import DeadForce

_POSE = ("x", "y", "z", "roll", "pitch", "yaw")


def _spatial(mass: float, centre: Array, inertia: Array) -> Array:
    """Inertia (6, 6) of a body on its twists, from that about its mass centre."""
    c = se3.skew(centre)
    return read_only(np.block([[inertia - mass * c @ c, mass * c], [-mass * c, mass * np.eye(3)]]))


class PlatformPosture(MechanismPosture):
    """A platform at a pose."""

    motion = IDENTITY
    coordinates_are_pose = True

    def __init__(self, platform: Platform, q: Array) -> None:
        self.q = q
        self._platform = platform
        self.pose = platform.pose_of(q)
        self.length = platform.length
        self.coordinate_lengths = np.array([1.0] * 3 + [self.length] * 3)

    def relative(self, frame_a: str, frame_b: str) -> tuple[Array, Map]:
        """Pose ``T_a_b`` of "world" and "body" and its map."""
        frames = {"world", "body"}
        for name in (frame_a, frame_b):
            if name not in frames:
                raise UnknownNameError("frame", name, sorted(frames))
        if (frame_a, frame_b) == ("world", "body"):
            return self.pose, self.motion
        if frame_a == frame_b:
            return np.eye(4), Map(np.zeros((6, 6)), IDENTITY.curvature)
        return se3.inverse(self.pose), Map(-se3.adjoint(self.pose), IDENTITY.curvature)

    def gravity(self, acceleration: Array) -> Evaluation:
        """Potential energy of the masses of platform and legs in a uniform field."""
        platform = self._platform
        held = DeadForce(platform.weight(acceleration), platform.mass_centre).evaluate(self)
        if platform.struts is None:
            return held
        per_kg = acceleration / platform.units.newtons
        legs = platform.struts.gravity(self, platform.points, per_kg)
        return Evaluation(
            held.energy + legs.energy, held.gradient + legs.gradient, held.hessian + legs.hessian
        )

    def mass_matrix(self) -> Array:
        """Masses' matrix (6, 6) of body and legs, on body twists."""
        platform = self._platform
        if platform.struts is None:
            return platform.body_inertia
        return platform.body_inertia + platform.struts.mass_matrix(self.lines, platform.points)

    def momentum(self) -> tuple[Array, float, Array]:
        """Momentum per body twist, total mass, and its centre, in F."""
        platform, mass = self._platform, self._platform.mass
        carried = se3.adjoint_of_inverse(self.pose).T @ platform.body_inertia
        first = mass * (self.pose[:3, :3] @ platform.mass_centre + self.pose[:3, 3])
        if platform.struts is not None:
            carried = carried + platform.struts.momentum(self.lines, platform.points, self.pose)
            more, of_legs = platform.struts.centre(self.lines, platform.points, self.pose)
            mass, first = mass + more, first + of_legs
        return carried, mass, first / mass if mass > 0.0 else np.zeros(3)

    @cached_property
    def lines(self) -> LineGeometry:
        """Lengths, directions and line coordinates of the legs, in the body frame."""
        return line_geometry(self.pose, self._platform.anchors, self._platform.points)

    def legs(self, anchors: Array, points: Array) -> LineGeometry | None:
        """The platform's own `lines`, where these are its anchors and points."""
        own = self._platform
        return self.lines if anchors is own.anchors and points is own.points else None

    @property
    def actuation(self) -> Array:  # type: ignore[override]
        """Line coordinates of the legs."""
        return self.lines.lines

    def chart(self) -> Map | str:
        """The leg lengths, if they are six."""
        m = len(self._platform.points)
        if m != 6:
            return f"K^F needs six leg lengths as a chart of SE(3): there are {m} lines"
        return Map(
            self.lines.lines,
            lambda mu: second_derivative(self.lines, self._platform.points, mu),
        )


class Platform(Mechanism):
    """A body joined to the ground by lines.

    Parameters
    ----------
    base : array_like, shape (m, 3)
        Anchor points in F.
    platform : array_like, shape (m, 3)
        Points of the body in its own frame P.
    T_P_M : array_like, optional
        The frame of interest in P; default P itself.
    units : Units
        Units of all lengths and forces.
    kind : str
        As in mechanism files.
    limits : sequence of (min, max), optional
        Leg length limits.
    mass : float
        Mass of the body, for gravity, in kg whatever the units.
    mass_centre : array_like, shape (3,)
        Its mass centre in P.
    inertia : array_like, shape (3, 3)
        About its mass centre, along the axes of P; kg and the unit of length squared.
    struts : Struts, optional
        Masses of the legs; none by default.
    leg_limits : LegLimits, optional
        Limits besides the lengths; its platform axes in the frame of interest.
    """

    def __init__(
        self,
        base: ArrayLike,
        platform: ArrayLike,
        *,
        T_P_M: ArrayLike | None = None,
        units: Units = SI,
        kind: str = "stewart-gough",
        limits: Sequence[tuple[float, float]] | None = None,
        mass: float = 0.0,
        mass_centre: ArrayLike = (0.0, 0.0, 0.0),
        inertia: ArrayLike | None = None,
        struts: Struts | None = None,
        leg_limits: LegLimits | None = None,
    ) -> None:
        self.kind = kind
        self.frame = "platform"
        self.units = units
        self.anchors = checked_array(base, None, "base points")
        self.T_P_M = np.eye(4) if T_P_M is None else checked_pose(T_P_M, "T_P_M")
        self.frame_offset = self.T_P_M
        points_P = checked_array(platform, None, "platform points")
        if points_P.shape != self.anchors.shape or points_P.ndim != 2 or points_P.shape[1] != 3:
            raise InputError(
                "base and platform points differ in number or are not three-dimensional",
                expected=f"two arrays of shape {self.anchors.shape}",
                got=f"{points_P.shape}",
            )
        T_M_P = se3.inverse(self.T_P_M)
        self.points_P = points_P
        self.points = points_P @ T_M_P[:3, :3].T + T_M_P[:3, 3]
        self.limits = (
            None if limits is None else checked_array(limits, None, "limits", finite=False)
        )
        self.mass = float(mass)
        centre = checked_vector(mass_centre, 3, "mass centre")
        self.mass_centre = T_M_P[:3, :3] @ centre + T_M_P[:3, 3]
        about = checked_array(np.zeros((3, 3)) if inertia is None else inertia, (3, 3), "inertia")
        self.body_inertia = _spatial(
            self.mass, self.mass_centre, T_M_P[:3, :3] @ about @ T_M_P[:3, :3].T
        )
        self.struts = struts
        self.leg_limits = leg_limits
        #: Whether others differ from it in size only: one program is made for all of them.
        self.is_one_of_many = False
        self.coordinates = tuple(
            Coordinate(name, "prismatic" if i < 3 else "revolute") for i, name in enumerate(_POSE)
        )
        radius = float(np.sqrt(np.mean(np.sum(self.points**2, axis=1))))
        spread = float(np.ptp(np.vstack([self.points, self.anchors]), axis=0).max())
        #: Root mean square distance of the body's points from the frame's origin.
        self.length = radius or spread or 1.0
        self._close()

    def _close(self) -> None:
        """What is kept of a platform elsewhere stays true: its arrays cannot be written to."""
        for name in ("anchors", "points", "points_P", "T_P_M", "mass_centre", "body_inertia"):
            getattr(self, name).flags.writeable = False

    def weight(self, acceleration: Array) -> Array:
        """Weight (3,) of the body in F, in the unit of force, under a field in m/s^2."""
        return self.mass / self.units.newtons * acceleration

    def as_one_of_many(self) -> Platform:
        """The same, for computing many platforms that differ in their points."""
        other = copy(self)
        other.is_one_of_many = True
        other._close()
        return other

    def with_points(self, base: ArrayLike, platform: ArrayLike) -> Platform:
        """The same body with other anchors in F and other points of its own, in P."""
        other = copy(self)
        T_M_P = se3.inverse(self.T_P_M)
        other.anchors = checked_array(base, None, "base points")
        other.points_P = checked_array(platform, None, "platform points")
        other.points = other.points_P @ T_M_P[:3, :3].T + T_M_P[:3, 3]
        other._close()
        return other

    def at(self, q: ArrayLike) -> PlatformPosture:
        """Posture at a pose of P in F: x, y, z, roll, pitch, yaw (fixed axes)."""
        return PlatformPosture(self, self.checked(q, "pose"))

    def pose_of(self, q: Array) -> Array:
        """Pose ``T_F_M`` from the pose of P in F."""
        return se3.from_roll_pitch_yaw(q[:3], q[3:]) @ self.T_P_M

    def coordinates_of(self, T_F_M: ArrayLike) -> Array:
        """Coordinates x, y, z, roll, pitch, yaw (..., 6) of P from poses (..., 4, 4) of M."""
        T_F_P = real_array(T_F_M) @ se3.inverse(self.T_P_M)
        return np.concatenate([T_F_P[..., :3, 3], se3.roll_pitch_yaw(T_F_P)], axis=-1)

    def moved(self, q: Array, step: Array) -> Array:
        """Coordinates after a small body twist `step`."""
        return self.coordinates_of(self.pose_of(q) @ se3.exp(step))

    @property
    def bounds(self) -> dict[str, tuple[float, float]]:
        """Shortest and longest length of each leg; the pose itself has no limits."""
        limits = [] if self.limits is None else self.limits.tolist()
        return {f"leg{i + 1}": (low, high) for i, (low, high) in enumerate(limits)}

    def masses(self) -> dict[str, float]:
        """Mass [kg] of the platform with its payload, and of the legs where they have one."""
        masses = {self.frame: self.mass}
        return masses if self.struts is None else masses | {"legs": self.struts.mass}

    def with_mass(self, mass: float, centre: Array) -> Platform:
        """The same platform with a point mass [kg] added at a point of M."""
        other = copy(self)
        other.mass = self.mass + mass
        first = self.mass * self.mass_centre + mass * np.asarray(centre, float)
        other.mass_centre = first / other.mass if other.mass > 0.0 else self.mass_centre
        other.body_inertia = self.body_inertia + _spatial(mass, centre, np.zeros((3, 3)))
        other._close()
        return other

    def with_masses(self, masses: Mapping[str, float]) -> Platform:
        """The same platform with other masses [kg]: its own by its frame's name, of all "legs"."""
        own = masses.get(self.frame, self.mass) - self.mass
        other = self.with_mass(own, self.mass_centre)
        other.mass_centre = self.mass_centre
        if "legs" in masses and self.struts is not None:
            share = masses["legs"] / self.struts.mass
            other.struts = replace(
                self.struts, fixed=share * self.struts.fixed, moving=share * self.struts.moving
            )
        return other

    def leg_lengths(self, q: ArrayLike) -> Array:
        """Lengths of the legs at a pose."""
        return self.at(q).lines.lengths

    def forward_kinematics(self, lengths: ArrayLike, start: ArrayLike) -> Array:
        """Pose coordinates at which the six legs have given lengths, near `start`.

        Newton's method on SE(3) with the line coordinates as its matrix, steps bounded to keep
        the assembly mode.

        Raises
        ------
        UndefinedError
            If the legs' lines become dependent on the way (type-2 singularity).
        ConvergenceError
            If 60 steps do not reach the lengths.
        """
        m = len(self.points)
        wanted = checked_vector(lengths, m, "list of leg lengths")
        if np.any(wanted <= 0):
            raise InputError(
                "leg lengths must be positive numbers", expected=f"{m}", got=wanted.tolist()
            )
        if m != 6:
            raise InputError("forward kinematics needs six legs", got=str(m))
        T = self.at(start).pose
        scale = np.array([1.0] * 3 + [self.length] * 3)
        error = np.inf
        previous = np.inf
        for _ in range(60):
            geometry = line_geometry(T, self.anchors, self.points)
            residual = wanted - geometry.lengths
            error = float(np.abs(residual).max())
            # Stop at rounding level: once below 1e-9 the next step no longer helps.
            if error <= numerics.TWO_UNITS * float(wanted.max()) or (
                error < numerics.SHARP * float(wanted.max()) and error >= previous
            ):
                return self.coordinates_of(T)
            previous = error
            scaled = geometry.lines * scale
            values = np.linalg.svd(scaled, compute_uv=False)
            if not numerics.is_regular(values):
                raise UndefinedError(
                    "the legs' lines are dependent (type-2 singularity): the pose does not follow "
                    "from the leg lengths",
                    code="type-2-singularity",
                    values={"singular_values": values.tolist()},
                )
            step = np.linalg.solve(scaled, residual)
            T = T @ se3.exp(
                scale * step * min(1.0, 0.3 / max(float(np.abs(step).max()), numerics.TINY))
            )
        if error < numerics.CONVERGED * float(wanted.max()):
            return self.coordinates_of(T)
        raise ConvergenceError(
            "no pose with these leg lengths found from the start", iterations=60, residual=error
        )
