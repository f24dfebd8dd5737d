r"""Interfaces: a potential, and the posture at which it is evaluated.

A posture has *maps* of its coordinates (to the end-effector's pose, between any two frames, to the
closure residual): the first derivative is a Jacobian, the second derivative is contracted with a
covector. A potential returns energy, gradient and Hessian in the same coordinates.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, is_dataclass, replace
from typing import Any, ClassVar, NamedTuple, Protocol, Self

import numpy as np

from cartstiff.errors import InputError
from cartstiff.geometry.se3 import Array
from cartstiff.notes import Note


@dataclass(frozen=True, slots=True)
class SecondOrderMap:
    """A map of the coordinates at a posture, to second order.

    Attributes
    ----------
    jacobian : ndarray, shape (m, n)
        First derivative. For a map to poses: the body Jacobian.
    curvature : callable
        ``curvature(w)`` is the (n, n) symmetric matrix sum_k w_k Hess(component k). For a map to
        poses the components are exponential coordinates at the posture, so that
        ``S[a, b] = 1/2 w . [J_a, J_b]`` for joint a before joint b.
    sizes : ndarray, shape (m,), or None
        Natural sizes of the residual of closures: 1 for an angle, the characteristic length for a
        distance, so that results do not depend on the unit of length. None: 1 each.
    """

    jacobian: Array
    curvature: Callable[[Array], Array]
    sizes: Array | None = None


def _flat(_: Array) -> Array:
    return np.zeros((6, 6))


#: The map of six coordinates to themselves.
IDENTITY = SecondOrderMap(np.eye(6), _flat)


class Evaluation(NamedTuple):
    """Energy, gradient (n,) and Hessian (n, n) in the mechanism's coordinates.

    ``hessian[a, b]`` is the derivative of gradient a along coordinate b. It is asymmetric if the
    forces have no potential (wrenches that follow the body); the energy is then NaN.
    """

    energy: float
    gradient: Array
    hessian: Array


def summed(parts: Sequence[Evaluation]) -> Evaluation:
    """Sum of one or more evaluations, in their order."""
    total = parts[0]
    for part in parts[1:]:
        total = Evaluation(
            total.energy + part.energy,
            total.gradient + part.gradient,
            total.hessian + part.hessian,
        )
    return total


def nothing(n: int) -> Evaluation:
    """Evaluation of no energy in n coordinates."""
    return Evaluation(0.0, np.zeros(n), np.zeros((n, n)))


class LineGeometry(NamedTuple):
    """Lengths (m,), unit vectors (m, 3) in frame b, and line coordinates g (m, 6)."""

    lengths: Array
    directions: Array
    lines: Array


class Posture(Protocol):
    """A mechanism at given coordinates, as potentials need it."""

    @property
    def q(self) -> Array:
        """Coordinates (n,)."""

    def relative(self, frame_a: str, frame_b: str) -> tuple[Array, SecondOrderMap]:
        """Pose ``T_a_b`` and its map, twists being those of b against a in components of b."""

    @property
    def closure(self) -> SecondOrderMap | None:
        """Map to the closure residual, or None for a mechanism without closures."""

    @property
    def coordinate_lengths(self) -> Array:
        """1 for angles, the characteristic length for distances: natural sizes (n,)."""

    def legs(self, anchors: Array, points: Array) -> LineGeometry | None:
        """Lines from the ground to the body that the posture has cached for these very arrays."""

    def gravity(self, acceleration: Array) -> Evaluation:
        """Potential energy of all masses in a uniform field, with derivatives."""


#: Powers of the unit of length in the entries of a pose.
POSE = np.outer([1, 1, 1, 0], [0, 0, 0, 1])


def rescaled(thing: Any, a: float) -> Any:
    """The same with all lengths multiplied by `a`, and unchanged forces.

    `length_powers` of the object has the power of the unit of length of each number: one, or one
    for each entry. The power is not used for parts that have `length_powers` themselves.
    """
    powers = thing.length_powers
    changed = {name: _times(getattr(thing, name), a, powers[name]) for name in powers}
    if isinstance(thing, tuple):
        return thing._replace(**changed)  # type: ignore[attr-defined]
    if is_dataclass(thing):
        return replace(thing, **changed)  # type: ignore[type-var]
    other = copy(thing)
    vars(other).update(changed)
    return other


def _times(value: Any, a: float, power: Any) -> Any:
    if value is None:
        return None
    if hasattr(value, "length_powers"):
        return rescaled(value, a)
    if isinstance(value, tuple):
        powers = power if isinstance(power, tuple) else (power,) * len(value)
        return tuple(_times(v, a, p) for v, p in zip(value, powers, strict=True))
    return value * a**power


class Potential(ABC):
    """A potential energy of a mechanism."""

    #: Whether it is a load or the weight, and not a part of the mechanism.
    is_external: ClassVar[bool] = False
    #: See `rescaled`; None: the potential cannot be converted to other units.
    length_powers: ClassVar[Mapping[str, Any] | None] = None

    def __init_subclass__(cls, **kwargs: object) -> None:
        super().__init_subclass__(**kwargs)
        if "remarks" in vars(cls):
            what = f"{cls.__name__}: a potential's notes have another name"
            raise InputError(what, expected="diagnostics", got="remarks")

    @abstractmethod
    def evaluate(self, posture: Posture) -> Evaluation:
        """Energy, gradient and Hessian at a posture."""

    def in_units(self, a: float, sizes: Array, efforts: Array) -> Self:  # noqa: ARG002
        """The same with lengths times `a`, coordinates times `sizes`, their forces times `efforts`.

        Raises
        ------
        InputError
            If it cannot be converted.
        """
        if self.length_powers is not None:
            scaled: Self = rescaled(self, a)
            return scaled
        if a == 1.0:
            return self
        raise InputError(
            "is not converted to other units", where="units", got=type(self).__name__
        )

    def member_forces(self, posture: Posture, gradient: Array) -> Array:  # noqa: ARG002
        """Sum (n,) of the absolute generalised forces of all members, by default of one.

        It includes forces that cancel in the gradient.
        """
        return np.abs(gradient)

    def diagnostics(self, posture: Posture) -> list[Note]:  # noqa: ARG002
        """Notes on limits of the result at a posture; none by default."""
        return []


@dataclass(frozen=True, kw_only=True)
class PosePotential(Potential):
    """A potential that depends on the pose of one frame relative to another.

    Attributes
    ----------
    frame_a, frame_b : str
        The potential is a function of ``T_a_b``. "world" is the inertial frame F, "body" the frame
        of interest M.
    """

    frame_a: str = "world"
    frame_b: str = "body"

    @abstractmethod
    def on_pose(self, T_a_b: Array) -> tuple[float, Array, Array]:
        """Energy, wrench W = dPhi (6,) and K^B (6, 6), in components of frame b."""

    def evaluate(self, posture: Posture) -> Evaluation:
        """Energy, gradient and Hessian at a posture."""
        T, to_pose = posture.relative(self.frame_a, self.frame_b)
        return pulled_back(*self.on_pose(T), to_pose)


def pulled_back(
    energy: float, wrench: Array, stiffness: Array, to_pose: SecondOrderMap
) -> Evaluation:
    """An energy of a pose in the coordinates: gradient J^T W, Hessian J^T K^B J + S_W."""
    if to_pose is IDENTITY:
        return Evaluation(energy, wrench, stiffness)
    J = to_pose.jacobian
    return Evaluation(
        energy, J.T @ wrench, J.T @ stiffness @ J + to_pose.curvature(wrench)
    )
