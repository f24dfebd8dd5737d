r"""A rigid body held by lines from the ground: Stewart-Gough platforms, line springs,
cable robots.

The coordinates are the body's pose; derivatives are taken in exponential coordinates at
the pose, so the body Jacobian is the identity and the Hessian of any potential is its
K^B.

A leg's mass consists of a bar on the base's joint and a bar on the platform's joint. The
line from the base point a to the platform point b has length L and direction u; the
platform point moves with v, so that the line turns with ``u' = P v / L``, ``P = 1 - u
u^T``. The bar on the base has its centre at ``a + c_f u``, the one on the platform at ``b
- c_m u``. Both are straight cylinders from their joint to twice that distance, with the
moment of inertia ``J = m (c^2 / 3 + r^2 / 4)`` about each centre across the line; a spin
about the line is left out, since it does not follow from the platform's motion. Their
kinetic energy is ``1/2 v^T A v`` with

    A = m_m u u^T + ( m_m (1 - c_m/L)^2 + (m_f c_f^2 + J_f + J_m) / L^2 ) P
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass, fields, replace
from functools import partial
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike

from cartstiff.core import numerics
from cartstiff.core.arrays import (
    Array,
    checked_array,
    checked_pose,
    checked_vector,
    read_only,
    real_array,
)
from cartstiff.core.errors import (
    ConvergenceError,
    InputError,
    UndefinedError,
    UnknownNameError,
)
from cartstiff.core.geometry import se3
from cartstiff.core.lazily import cached_property
from cartstiff.core.mechanisms.clearances import clearances, tilts
from cartstiff.core.mechanisms.contract import (
    Coordinate,
    Mechanism,
    MechanismPosture,
    Quantities,
    Skeleton,
)
from cartstiff.core.numerics.searches import least_change
from cartstiff.core.potentials.contract import (
    IDENTITY,
    POSE,
    Evaluation,
    LineGeometry,
    Number,
    SecondOrderMap,
    rescaled,
)
from cartstiff.core.potentials.line_springs import line_geometry, second_derivative
from cartstiff.core.potentials.loads import DeadForce, held_force
from cartstiff.core.units import SI, Units


@dataclass(frozen=True, eq=False)
class Struts:
    """Masses of m legs.

    Attributes
    ----------
    fixed, moving : ndarray (m,)
        Masses [kg] on the base's joint and on the platform's joint.
    fixed_com, moving_com : ndarray (m,)
        Distances of their centres from their own joints.
    radius : ndarray (m,)
        Radius of both; 0 for slender bars.

    Raises
    ------
    InputError
        For negative numbers or lengths that differ.
    """

    fixed: Array
    moving: Array
    fixed_com: Array
    moving_com: Array
    radius: Array

    length_powers: ClassVar = {"fixed_com": 1, "moving_com": 1, "radius": 1}

    @cached_property
    def _key(self) -> bytes:
        return np.array([getattr(self, field.name) for field in fields(self)]).tobytes()

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Struts) and self._key == other._key

    def __hash__(self) -> int:
        return hash(self._key)

    def __post_init__(self) -> None:
        for field in fields(self):
            value = checked_array(
                getattr(self, field.name), ("m",), f"legs' {field.name}"
            )
            if value.shape != np.shape(self.fixed) or (value < 0.0).any():
                raise InputError(
                    f"legs' {field.name} cannot be used",
                    got=value.tolist(),
                    expected="one number from zero per leg",
                )
            value.flags.writeable = False
            object.__setattr__(self, field.name, value)

    @property
    def mass(self) -> float:
        """Mass [kg] of all legs."""
        return float(self.fixed.sum() + self.moving.sum())

    def mass_matrix(self, lines: LineGeometry, points: Array) -> Array:
        """Return their part (..., 6, 6) of the platform's mass matrix, on body twists."""
        per = 1.0 / lines.lengths
        beyond = 1.0 - self.moving_com * per
        across = self.moving * (beyond * beyond)
        # Moments of inertia of both bars, each about its own centre.
        turning = sum(
            mass * (com * com / 3 + self.radius**2 / 4)
            for mass, com in (
                (self.fixed, self.fixed_com),
                (self.moving, self.moving_com),
            )
        )
        across = across + (self.fixed * self.fixed_com**2 + turning) * (per * per)
        D = np.array([_velocity(point) for point in points])
        along = (lines.lines * (self.moving - across)[..., None]).swapaxes(
            -1, -2
        ) @ lines.lines
        total: Array = along + np.tensordot(across, D.swapaxes(-1, -2) @ D, 1)
        return total

    def momentum(self, lines: LineGeometry, points: Array, pose: Array) -> Array:
        """Linear momentum (3, 6) in F per body twist."""
        R = pose[:3, :3]
        # Centres beside a joint move along with the direction of the line only.
        beside = self.fixed * self.fixed_com - self.moving * self.moving_com
        total = np.zeros((3, 6))
        for k, point in enumerate(points):
            u, velocity = lines.directions[k], _velocity(point)
            turn = (velocity - np.outer(u, u @ velocity)) / lines.lengths[k]
            total += R @ (self.moving[k] * velocity + beside[k] * turn)
        return total

    def gravity(
        self, lines: LineGeometry, points: Array, pose: Array, weight: Array
    ) -> tuple[Any, Array, Array]:
        """The energy of their weights, `weight` (3,) per kg in F, with its derivatives.

        The derivatives are on body twists; lines and pose may be recorded.
        """
        in_body = weight @ pose[:3, :3]
        energy = (weight @ pose[:3, 3]) * -self.mass
        gradient, hessian = np.zeros(6), np.zeros((6, 6))
        own = (
            self.fixed,
            self.moving,
            self.fixed * self.fixed_com,
            self.moving * self.moving_com,
        )
        for k, (fixed, moving, near, far) in enumerate(np.transpose(own).tolist()):
            b, u, L, share = points[k], lines.directions[k], lines.lengths[k], near - far
            along, per = u @ in_body, 1.0 / L
            across = in_body - u * along
            energy = (
                energy - (b @ in_body) * (fixed + moving) - along * (share - L * fixed)
            )
            alpha, K = held_force(in_body * moving + across * (per * share), b)
            # The direction u, along which a part of the weight acts, changes with b as
            # well.
            P = np.eye(3) - np.outer(u, u)
            second = np.outer(u, across) + np.outer(across, u) + P * along
            D = _velocity(b)
            gradient, hessian = gradient + alpha, hessian + K
            hessian = hessian + D.T @ (second * (per * per * share)) @ D
        return energy, gradient, hessian


def _velocity(point: Array) -> Array:
    """Velocity of a point per body twist, (3, 6)."""
    return np.concatenate([-se3.skew_of(point), np.eye(3)], axis=1)


@dataclass(frozen=True, eq=False)
class LegLimits:
    """Limits of m legs other than their lengths; None where there is none.

    Attributes
    ----------
    base_axes, platform_axes : ndarray (m, 3) or None
        Unit vectors in F, and in M: middle directions of the joints, from the joint along
        the leg.
    base_angles, platform_angles : ndarray (m,) or None
        Largest angle of each leg from the axis of its joint, in rad.
    diameters : ndarray (m,) or None
        Diameters of the legs: the distance of two legs is at least the mean of theirs.
    forces : ndarray (m, 2) or None
        Least and largest tension of each leg; compression is negative.
    """

    base_axes: Array | None = None
    base_angles: Array | None = None
    platform_axes: Array | None = None
    platform_angles: Array | None = None
    diameters: Array | None = None
    forces: Array | None = None

    length_powers: ClassVar = {"diameters": 1}


_POSE = ("x", "y", "z", "roll", "pitch", "yaw")


def _spatial(mass: float, centre: Array, inertia: Array) -> Array:
    """Inertia (6, 6) of a body on its twists, from that about its mass centre."""
    c = se3.skew(centre)
    return read_only(
        np.block([[inertia - mass * c @ c, mass * c], [-mass * c, mass * np.eye(3)]])
    )


class PlatformPosture(MechanismPosture):
    """A platform at a pose."""

    motion = IDENTITY
    coordinates_are_pose = True

    def __init__(self, platform: Platform, q: Array) -> None:
        self.q = q
        self._platform = platform
        self.length = platform.length
        self.coordinate_lengths = np.array([1.0] * 3 + [self.length] * 3)

    @cached_property
    def pose(self) -> Array:  # type: ignore[override]
        """``T_F_M``."""
        return self._platform.pose_of(self.q)

    def relative(self, frame_a: str, frame_b: str) -> tuple[Array, SecondOrderMap]:
        """Return the pose ``T_a_b`` of "world" and "body" and its map."""
        frames = {"world", "body"}
        for name in (frame_a, frame_b):
            if name not in frames:
                raise UnknownNameError("frame", name, sorted(frames))
        if (frame_a, frame_b) == ("world", "body"):
            return self.pose, self.motion
        if frame_a == frame_b:
            return np.eye(4), SecondOrderMap(np.zeros((6, 6)), IDENTITY.curvature)
        return se3.inverse(self.pose), SecondOrderMap(
            -se3.adjoint(self.pose), IDENTITY.curvature
        )

    def gravity(self, acceleration: Array) -> Evaluation:
        """Potential energy of the masses of platform and legs in a uniform field."""
        platform = self._platform
        held = DeadForce(platform.weight(acceleration), platform.mass_centre).evaluate(
            self
        )
        if platform.struts is None:
            return held
        per_kg = acceleration / platform.units.newtons
        energy, gradient, hessian = platform.struts.gravity(
            self.lines, platform.points, self.pose, per_kg
        )
        return Evaluation(
            held.energy + float(energy), held.gradient + gradient, held.hessian + hessian
        )

    def weights_of_lines(self, acceleration: Array) -> Array | None:
        """The part of each leg's weight that its platform joint carries."""
        own, lines = self._platform, self.lines
        if (struts := own.struts) is None:
            return None
        forces, per_kg = [], acceleration / own.units.newtons
        for k in range(len(own.points)):
            one = slice(k, k + 1)
            leg = Struts(*(getattr(struts, field.name)[one] for field in fields(struts)))
            line = LineGeometry(*(part[one] for part in lines))
            forces.append(-leg.gravity(line, own.points[one], self.pose, per_kg)[1][3:])
        return np.array(forces)

    def mass_matrix(self) -> Array:
        """Mass matrix (6, 6) of body and legs, on body twists."""
        platform = self._platform
        if platform.struts is None:
            return platform.body_inertia
        return platform.body_inertia + platform.struts.mass_matrix(
            self.lines, platform.points
        )

    def momentum(self) -> tuple[Array, float]:
        """Linear momentum (3, 6) in F per body twist, and the mass of body and legs."""
        platform, mass = self._platform, self._platform.mass
        carried = self.pose[:3, :3] @ platform.body_inertia[3:]
        if platform.struts is None:
            return carried, mass
        of_legs = platform.struts.momentum(self.lines, platform.points, self.pose)
        return carried + of_legs, mass + platform.struts.mass

    @cached_property
    def lines(self) -> LineGeometry:  # type: ignore[override]
        """Lengths, directions and line coordinates of the legs, in the body frame."""
        return line_geometry(self.pose, self._platform.anchors, self._platform.points)

    def legs(self, anchors: Array, points: Array) -> LineGeometry | None:
        """Return the platform's own `lines` for its own anchors and points."""
        own = self._platform
        return self.lines if anchors is own.anchors and points is own.points else None

    def map_of_bounded(self, which: Sequence[int]) -> SecondOrderMap:
        """The map to the lengths of some legs."""
        lines, points = self.lines, self._platform.points

        def curvature(multipliers: Array) -> Array:
            weights = np.zeros(len(points))
            np.add.at(weights, which, multipliers)
            return second_derivative(lines, points, weights)

        return SecondOrderMap(lines.lines[which], curvature)

    def drawn(self) -> Skeleton:
        """The legs, and the way round the body's points."""
        starts, ends = self._platform.ends_of_lines(self.q, self.pose)
        legs = [np.array(pair) for pair in zip(starts, ends, strict=True)]
        return Skeleton([*legs, np.vstack([ends, ends[:1]])], np.vstack([starts, ends]))

    @property
    def actuation(self) -> Array:  # type: ignore[override]
        """Line coordinates of the legs."""
        return self.lines.lines

    def chart(self) -> SecondOrderMap | str:
        """The leg lengths, if they are six."""
        m = len(self._platform.points)
        if m != 6:
            return f"K^F needs exactly six legs or cables; there are {m} lines"
        return SecondOrderMap(
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
        Inertia about its mass centre, axes of P; kg and the unit of length squared.
    struts : Struts, optional
        Masses of the legs; none by default.
    leg_limits : LegLimits, optional
        Limits other than the lengths; its platform axes in the frame of interest.

    Raises
    ------
    InputError
        For wrong shapes, or numbers that are no pose, mass, inertia or limit.
    """

    coordinates_are_pose = True
    length_powers: ClassVar = {
        **dict.fromkeys(
            ("anchors", "points", "points_P", "mass_centre", "limits", "length"), 1
        ),
        **dict.fromkeys(("T_P_M", "frame_offset", "base_pose"), POSE),
        "body_inertia": np.add.outer(*[np.repeat([1, 0], 3)] * 2),
        **dict.fromkeys(("leg_limits", "struts"), 0),
    }

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
        self.frame_offset, T_M_P = self.T_P_M, se3.inverse(self.T_P_M)
        points_P = checked_array(platform, None, "platform points")
        if points_P.shape != self.anchors.shape or points_P.shape[1:] != (3,):
            raise InputError(
                "base and platform points differ in number or are not three-dimensional",
                expected=f"two arrays of shape {self.anchors.shape}",
                got=f"{points_P.shape}",
            )
        self.points_P = points_P
        self.points = se3.placed(T_M_P, points_P)
        if limits is None:
            self.limits = None
        else:
            self.limits = checked_array(limits, None, "limits", finite=False)
        self.mass = float(mass)
        centre = checked_vector(mass_centre, 3, "mass centre")
        self.mass_centre = se3.placed(T_M_P, centre)
        about = checked_array(
            np.zeros((3, 3)) if inertia is None else inertia, (3, 3), "inertia"
        )
        self.body_inertia = _spatial(
            self.mass, self.mass_centre, T_M_P[:3, :3] @ about @ T_M_P[:3, :3].T
        )
        self.struts = struts
        self.leg_limits = leg_limits
        self.coordinates = tuple(
            Coordinate(name, "prismatic" if i < 3 else "revolute")
            for i, name in enumerate(_POSE)
        )
        radius = float(np.sqrt(np.mean(np.sum(self.points**2, axis=1))))
        spread = float(np.ptp(np.vstack([self.points, self.anchors]), axis=0).max())
        #: Root mean square distance of the body's points from the frame's origin.
        self.length = radius or spread or 1.0
        self.close()

    def close(self) -> None:
        """Make its arrays read-only, so that results that are cached for
        it stay valid.
        """
        for name in (
            "anchors",
            "points",
            "points_P",
            "T_P_M",
            "mass_centre",
            "body_inertia",
        ):
            getattr(self, name).flags.writeable = False

    def weight(self, acceleration: Array) -> Array:
        """Weight (3,) of the body in F, in the unit of force, under a field in m/s^2."""
        return self.mass / self.units.newtons * acceleration

    def as_one_of_many(self) -> Self:
        """Return a copy for computing many platforms that differ in their points."""
        other = copy(self)
        other.is_one_of_many = True
        other.close()
        return other

    def with_points(self, base: ArrayLike, platform: ArrayLike) -> Self:
        """The platform with other anchors (m, 3) in F, `base`, and other points (m, 3) of
        the body in P, `platform`.

        Raises
        ------
        InputError
            For wrong shapes.
        """
        other, T_M_P = copy(self), se3.inverse(self.T_P_M)
        other.anchors = checked_array(base, None, "base points")
        other.points_P = checked_array(platform, None, "platform points")
        other.points = se3.placed(T_M_P, other.points_P)
        other.close()
        return other

    def at(self, q: ArrayLike) -> PlatformPosture:
        """The posture at a pose of P in F: x, y, z, roll, pitch, yaw (fixed axes)."""
        return PlatformPosture(self, self.checked(q, "pose"))

    def pose_of(self, q: Array) -> Array:
        """Return the pose ``T_F_M`` (..., 4, 4) from the pose of P in F."""
        return se3.from_roll_pitch_yaw(q[:3], q[3:]) @ self.T_P_M

    def coordinates_of(self, T_F_M: ArrayLike) -> Array:
        """Return coordinates (..., 6) of P: x, y, z, roll, pitch, yaw,
        from poses of M.
        """
        T_F_P = real_array(T_F_M) @ se3.inverse(self.T_P_M)
        return np.concatenate([T_F_P[..., :3, 3], se3.roll_pitch_yaw(T_F_P)], axis=-1)

    def displaced(self, q: Array, step: Array) -> Array:
        """Return coordinates (6,) after a small body twist `step` (6,)."""
        return self.coordinates_of(self.pose_of(q) @ se3.exp(step))

    @property
    def bounds(self) -> dict[str, tuple[float, float]]:
        """Shortest and longest length of each leg; the pose itself has no limits."""
        limits = [] if self.limits is None else self.limits.tolist()
        return {f"leg{i + 1}": (low, high) for i, (low, high) in enumerate(limits)}

    def masses(self) -> dict[str, float]:
        """Masses [kg] of the platform with its payload, and of the legs where
        they have one.
        """
        masses = {self.frame: self.mass}
        return masses if self.struts is None else masses | {"legs": self.struts.mass}

    def with_mass(self, mass: float, centre: Array) -> Self:
        """Return the platform with a point mass [kg] added at a point of M, `centre`
        (3,).
        """
        other = copy(self)
        other.mass = self.mass + mass
        first = self.mass * self.mass_centre + mass * np.asarray(centre, float)
        other.mass_centre = first / other.mass if other.mass > 0.0 else self.mass_centre
        other.body_inertia = self.body_inertia + _spatial(mass, centre, np.zeros((3, 3)))
        other.close()
        return other

    def with_masses(self, masses: Mapping[str, float]) -> Self:
        """Return the platform with other masses [kg], by its frame's name and "legs"."""
        own = masses.get(self.frame, self.mass) - self.mass
        other = self.with_mass(own, self.mass_centre)
        other.mass_centre = self.mass_centre
        if "legs" in masses and self.struts is not None:
            share = masses["legs"] / self.struts.mass
            other.struts = replace(
                self.struts,
                fixed=share * self.struts.fixed,
                moving=share * self.struts.moving,
            )
        return other

    @property
    def has_legs(self) -> bool:  # type: ignore[override]
        """Whether the lines are legs of a robot."""
        return self.kind == "stewart-gough"

    @property
    def tension_limits(self) -> Array | None:  # type: ignore[override]
        """Least and largest tension (m, 2) of each leg."""
        return None if self.leg_limits is None else self.leg_limits.forces

    def ends_of_lines(self, q: Array, pose: Array) -> tuple[Array, Array]:  # noqa: ARG002
        """Return the ends (..., m, 3) in F of the legs at poses (..., 4, 4) of M."""
        turn, at = pose[..., :3, :3].swapaxes(-1, -2), pose[..., None, :3, 3]
        ends = self.points @ turn + at
        return np.broadcast_to(self.anchors, ends.shape), ends

    def bounded(self, q: Array, pose: Array) -> Array:
        """Return the lengths (..., m) of the legs."""
        starts, ends = self.ends_of_lines(q, pose)
        return np.asarray(np.linalg.norm(ends - starts, axis=-1))

    def quantities(self) -> list[Quantities]:
        """Return the angles of the legs' joints, and distances of legs."""
        limits, found = self.leg_limits, list[Quantities]()
        if limits is None:
            return found
        for where, axes, angles in (
            ("base", limits.base_axes, limits.base_angles),
            ("platform", limits.platform_axes, limits.platform_angles),
        ):
            if axes is not None and angles is not None:
                rows = [
                    (f"angle of leg{i} at the {where}", 0.0, float(angle), True)
                    for i, angle in enumerate(angles, start=1)
                ]
                values = partial(tilts, self.ends_of_lines, axes, where)
                found.append(Quantities(rows, values))
        if limits.diameters is not None:
            places, fixed = (self.anchors, self.points), np.ones(len(self.points), bool)
            diameters, ends = limits.diameters.tolist(), self.ends_of_lines
            found.append(clearances(diameters, *places, fixed, ends))
        return found

    def numbers(self) -> dict[str, Number]:
        """Return "base.LEG.x" and "platform.LEG.x", points in F and in P, and masses."""
        points = {
            f"{body}.leg{i}.{axis}": Number(x, 1.0)
            for body, own in (("base", self.anchors), ("platform", self.points_P))
            for i, point in enumerate(own.tolist(), start=1)
            for axis, x in zip("xyz", point, strict=True)
        }
        masses = {n: m for n, m in self.masses().items() if m > 0.0}
        return points | {
            f"mass.{n}": Number(m, is_positive=True) for n, m in masses.items()
        }

    def with_numbers(self, values: Mapping[str, float]) -> Self:
        """Return the platform with some of `numbers` changed."""
        own = {n: x.value for n, x in self.numbers().items() if not n.startswith("mass.")}
        other = self
        if not values.keys().isdisjoint(own):
            moved = [values.get(name, x) for name, x in own.items()]
            other = other.with_points(*np.array(moved).reshape(2, -1, 3))
        masses = {
            n.removeprefix("mass."): x for n, x in values.items() if n.startswith("mass.")
        }
        return other.with_masses(masses) if masses else other

    def in_units(self, a: float, units: Units) -> Self:
        """Return the platform with lengths times `a`."""
        other: Self = rescaled(self, a)
        other.units = units
        other.close()
        return other

    def leg_lengths(self, q: ArrayLike) -> Array:
        """Return the lengths (m,) of the legs at a pose."""
        return self.at(q).lines.lengths

    def forward_kinematics(self, lengths: ArrayLike, start: ArrayLike) -> Array:
        """The pose coordinates near `start` at which the six legs have given lengths.

        Newton's method on SE(3) with the line coordinates as its matrix, steps bounded to
        keep the assembly mode.

        Raises
        ------
        UndefinedError
            If the legs' lines become dependent on the way (type-2 singularity).
        ConvergenceError
            If at most 60 steps do not reach the lengths.
        """
        m = len(self.points)
        wanted = checked_vector(lengths, m, "list of leg lengths")
        if np.any(wanted <= 0):
            raise InputError(
                "leg lengths must be positive numbers",
                expected=f"{m}",
                got=wanted.tolist(),
            )
        if m != 6:
            raise InputError("forward kinematics needs six legs", got=str(m))
        T = self.at(start).pose
        scale = np.array([1.0] * 3 + [self.length] * 3)
        longest = float(wanted.max())

        def equations(T: Array) -> tuple[Array, Array]:
            geometry = line_geometry(T, self.anchors, self.points)
            return (geometry.lengths - wanted) / longest, geometry.lines * scale / longest

        def retract(T: Array, step: Array) -> Array:
            values = numerics.singular_values(equations(T)[1])
            if not numerics.is_regular(values):
                raise UndefinedError(
                    "the legs' lines are dependent (type-2 singularity): the pose does "
                    "not follow from the leg lengths",
                    code="type-2-singularity",
                    values={"singular_values": values.tolist()},
                )
            return T @ se3.exp(scale * step)

        T, error, iterations = least_change(
            T, equations, retract, evaluations=60, longest_step=0.3
        )
        if error < numerics.STALLED_RESIDUAL:
            return self.coordinates_of(T)
        raise ConvergenceError(
            "no pose with these leg lengths found from the start",
            iterations=iterations,
            residual=error,
        )
