r"""External loads as terms of the energy: forces constant in F,
wrenches that follow the body.

A load is the one-form alpha on motions of its frame: alpha = -(wrench on the body), as
gradient of the total energy. With T[i, j] = L_j alpha(L_i), its derivatives along
left-invariant fields, and maps of the coordinates whose curvature is S,

    gradient_a = alpha(J_a), hessian[a, b] = T(J_a, J_b) + S_alpha[a, b] + 1/2 alpha([J_a,
    J_b])

because d J_a / d q_b is the symmetric curvature plus half a bracket on every map to
SE(3). Where alpha is exact, T is K^A and the last term makes it K^B: the Hessian is
symmetric.

A moment m that is constant in the world, or in the body, has no potential in space, but
it has -m . n times the angle where all joints on the way to the body turn about one
direction n: they leave n as it is, at all coordinates. With the rotational rows J_w of
the map the angle's part is the constant m^T J_w, and the potential -m^T J_w q.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from cartstiff.core import numerics
from cartstiff.core.arrays import (
    Array,
    checked_array,
    checked_number,
    checked_reach,
    checked_vector,
    fixed,
)
from cartstiff.core.checked_call import checked
from cartstiff.core.errors import InputError
from cartstiff.core.geometry import se3
from cartstiff.core.potentials.contract import (
    DeadLoad,
    Evaluation,
    Given,
    Posture,
    Potential,
)


def _keep(load: Load, **sizes: int) -> None:
    """Check the vectors of a load, and set read-only copies."""
    for name, size in sizes.items():
        what = "point of application" if name == "point" else name
        object.__setattr__(load, name, _numbers(getattr(load, name), size, what))


def _numbers(value: ArrayLike, size: int, what: str) -> Array:
    array = checked_vector(value, size, what)
    array.flags.writeable = False
    return array


class Load(Potential):
    """A load on one frame, given by its one-form and that form's derivatives.

    Attributes
    ----------
    frame_b : str
        The frame that carries the load; "body" is the frame of interest M.
    """

    is_external = True

    frame_b: str

    @abstractmethod
    def on_pose(self, T_F_b: Array) -> tuple[float, Array, Array]:
        """Energy (NaN if there is none), alpha (6,) and T (6, 6),
        in components of frame b.
        """

    def parted(self, T_F_b: Array) -> tuple[float, Array] | None:  # noqa: ARG002
        """Energy of all but the moment, and the moment (3,) in b.

        None if that is not all.
        """
        return None

    def _on_body(
        self, kind: str, wrench: Array, point: ArrayLike, axes: str
    ) -> Given | None:
        """The load of the frame of interest."""
        at = np.asarray(point, float)
        return Given(kind, wrench, at, axes) if self.frame_b == "body" else None

    def conservative(self, posture: Posture) -> Potential:
        """The semitangential wrench that is the same at a posture."""
        T_F_b = posture.pose_of_frame(self.frame_b)
        R = T_F_b[:3, :3]
        wrench = -(self.on_pose(T_F_b)[1].reshape(2, 3) @ R.T).ravel()
        return SemitangentialWrench(wrench, R, self.frame_b)

    def wrench_on(self, frame: str, T_F_b: Array) -> Array | None:
        """The wrench, if it acts on that frame."""
        return -self.on_pose(T_F_b)[1] if frame == self.frame_b else None

    def evaluate(self, posture: Posture) -> Evaluation:
        """Energy, gradient and (for loads without a potential unsymmetric) derivative."""
        T_F_b, to_pose = posture.relative("world", self.frame_b)
        energy, alpha, rate = self.on_pose(T_F_b)
        J = to_pose.jacobian
        if np.isnan(energy) and (parts := self.parted(T_F_b)) is not None:
            energy = parts[0] + _energy_about_one_axis(parts[1], J[:3], posture.q)
        rate = rate + 0.5 * se3.bracket_form(alpha)
        # On matrices this small `dot` takes half the time of `@`.
        hessian = J.T.dot(rate).dot(J) + to_pose.curvature(alpha)
        return Evaluation(energy, alpha.dot(J), hessian)


def _energy_about_one_axis(moment: Array, turns: Array, q: Array) -> float:
    """``-m^T J_w q`` of a moment (3,), see the module.

    NaN if turns (3, n) have several axes.
    """
    sizes = np.linalg.norm(turns, axis=0)
    n = turns[:, int(np.argmax(sizes))]
    across = numerics.largest(se3.skew(n) @ turns)
    if across > numerics.ROUNDOFF * sizes.max(initial=0.0) ** 2:
        return np.nan
    return -float(moment @ turns @ q)


def _forms_of_force() -> Array:
    """Alpha and K^A of a force -f at a point c, linear in f and the entries of f
    c^T (12, 42).
    """
    forms = np.zeros((4, 3, 42))
    for i, f in enumerate(np.eye(3)):
        forms[0, i, 3:6] = f
        forms[0, i, 6:].reshape(6, 6)[3:, :3] = se3.skew(f)
        for j, c in enumerate(np.eye(3)):
            forms[1 + i, j, :3] = np.cross(c, f)
            # K[i, j] = f . (w_j x (w_i x c + v_i))
            forms[1 + i, j, 6:].reshape(6, 6)[:3, :3] = np.outer(f, c) - (f @ c) * np.eye(
                3
            )
    return forms.reshape(12, 42)


def _symmetric(form: Array) -> Array:
    matrix = form.reshape(6, 6)
    return np.asarray(0.5 * (matrix + matrix.T).ravel())


_OF_FORCE = _forms_of_force()
_OF_FORCE_B = _OF_FORCE.copy()
_OF_FORCE_B[:, 6:] = np.array([_symmetric(form) for form in _OF_FORCE[:, 6:]])


def held_force(
    force: Array, point: Array, forms: Array = _OF_FORCE_B
) -> tuple[Array, Array]:
    """Alpha and K^B of a force (3,), constant in F, given along the axes of b at
    a point of b.

    Numbers may be recorded. With `_OF_FORCE` as forms, K^A instead.
    """
    flat = np.concatenate((-force, np.multiply.outer(-force, point).ravel())).dot(forms)
    return flat[:6], flat[6:].reshape(6, 6)


def _dead_force(T_F_b: Array, force: Array, point: Array) -> tuple[float, Array, Array]:
    """Energy, alpha and K^A of a force constant in the world at a point of frame b."""
    R = T_F_b[:3, :3]
    energy = -float(force.dot(R.dot(point) + T_F_b[:3, 3]))
    return energy, *held_force(force.dot(R), point, _OF_FORCE)


@dataclass(frozen=True, eq=False)
class DeadForce(Load):
    """A force constant in the world, at a point of a frame: Phi = -f . p.

    Attributes
    ----------
    force : ndarray, shape (3,)
        Components in F, in units of force; it acts on the body.
    point : ndarray, shape (3,)
        Point of application in frame b.
    frame_b : str
        Frame that carries the point.
    mass : float
        Mass whose weight the force is; 0 for any other force.
    lifted : float
        Mass [kg] whose weight the force carries, as gravity compensation does: it follows
        the field of `ElasticMechanism.with_gravity`. 0 for any other force.

    Raises
    ------
    InputError
        For a wrong count or numbers that are not finite.
    """

    force: Array
    point: Array | Sequence[float] = (0.0, 0.0, 0.0)
    frame_b: str = "body"
    mass: float = 0.0
    lifted: float = 0.0

    length_powers: ClassVar = {"point": 1}

    def __post_init__(self) -> None:
        _keep(self, force=3, point=3)

    def on_pose(self, T_F_b: Array) -> tuple[float, Array, Array]:
        """Energy, alpha = -(c x R^T f, R^T f), and its K^A."""
        return _dead_force(T_F_b, self.force, np.asarray(self.point))

    @property
    def dead(self) -> DeadLoad:  # type: ignore[override]
        """The force."""
        return DeadLoad(self.mass, self.force, np.asarray(self.point), self.frame_b)

    @property
    def given(self) -> Given | None:  # type: ignore[override]
        """A force alone."""
        wrench = np.append(np.zeros(3), self.force)
        return self._on_body("dead", wrench, self.point, "world")

    def under_gravity(self, acceleration: Array) -> DeadForce:
        """The same force, or that which carries its mass in another field."""
        return replace(self, force=-self.lifted * acceleration) if self.lifted else self


@dataclass(frozen=True, eq=False)
class DeadWrench(Load):
    """A moment and a force constant in the world, at the origin of a frame.

    The force has a potential. A moment constant in the world has none, as its work
    depends on the path: with it the energy is NaN and the derivative asymmetric, unless
    all joints on the way to the frame turn about one direction, as those of a planar
    machine.

    Attributes
    ----------
    wrench : ndarray, shape (6,)
        (moment, force) on the body, components in F, moment about the point.
    frame_b : str
        Frame that carries it.
    point : ndarray, shape (3,)
        Point of application in frame b.

    Raises
    ------
    InputError
        For a wrong count or numbers that are not finite.
    """

    wrench: Array
    frame_b: str = "body"
    point: Array | Sequence[float] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        _keep(self, wrench=6, point=3)

    def on_pose(self, T_F_b: Array) -> tuple[float, Array, Array]:
        """Energy, alpha = -(c x R^T f + R^T m, R^T f), and T."""
        energy, alpha, rate = _dead_force(T_F_b, self.wrench[3:], np.asarray(self.point))
        if self.wrench[:3].any():
            moment = T_F_b[:3, :3].T @ self.wrench[:3]
            alpha[:3] -= moment
            rate[:3, :3] -= se3.skew(moment)
            energy = np.nan
        return energy, alpha, rate

    @property
    def given(self) -> Given | None:  # type: ignore[override]
        """Moment and force."""
        return self._on_body("dead", self.wrench, self.point, "world")

    def parted(self, T_F_b: Array) -> tuple[float, Array]:
        """Energy of the force, and the moment."""
        force, moment = self.wrench[3:], self.wrench[:3]
        return _dead_force(T_F_b, force, np.asarray(self.point))[0], T_F_b[
            :3, :3
        ].T @ moment


@dataclass(frozen=True, eq=False)
class SemitangentialWrench(Load):
    r"""A force constant in the world and a moment that turns by half, from dead forces.

    The moment m at the rotation R_0 comes from equal and opposite dead forces at the ends
    of two crossed bars of the body. With ``R_0^T R`` the rotation since then and ``n =
    R_0^T m``

        Phi = -1/2 tr([n]x^T R_0^T R) - f . p

    so that the moment turns by half to first order, and as the cosine of a turn about its
    own axis.

    Attributes
    ----------
    wrench : ndarray, shape (6,)
        (moment, force) on the body at that rotation, components in F, moment about the
        point.
    rotation : ndarray, shape (3, 3)
        R_0 of the frame that carries the load.
    frame_b : str
        That frame.
    point : ndarray, shape (3,)
        Point of application in frame b.

    Raises
    ------
    InputError
        For a wrong count or numbers that are not finite.
    """

    wrench: Array
    rotation: Array
    frame_b: str = "body"
    point: Array | Sequence[float] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        _keep(self, wrench=6, point=3)
        rotation = checked_array(self.rotation, (3, 3), "rotation")
        object.__setattr__(self, "rotation", fixed(rotation))

    def on_pose(self, T_F_b: Array) -> tuple[float, Array, Array]:
        """Energy, alpha and its K^A."""
        energy, alpha, rate = _dead_force(T_F_b, self.wrench[3:], np.asarray(self.point))
        # Phi = -tr(B R) with B fixed in F: along w it changes by -tr(B R [w]x).
        B = 0.5 * se3.skew(self.rotation.T @ self.wrench[:3]).T @ self.rotation.T
        G = B @ T_F_b[:3, :3]
        alpha[:3] += 2.0 * se3.unskew(G)
        # K[i, j] = -tr(G [w_j]x [w_i]x), and tr(G [a]x [b]x) = a.G b - tr(G) a.b
        rate[:3, :3] -= G.T - np.trace(G) * np.eye(3)
        return energy - float(np.trace(G)), alpha, rate


@dataclass(frozen=True, eq=False)
class FollowerWrench(Load):
    """A wrench constant in the moving frame: pressure, thrust,
    a tool that turns with the body.

    It has no potential, but for a moment alone on a planar machine, as `DeadWrench`. Its
    part of K^A vanishes, as its body components are constant.

    Attributes
    ----------
    wrench : ndarray, shape (6,)
        (moment, force) on the body, components in the frame that carries it.
    frame_b : str
        That frame.

    Raises
    ------
    InputError
        For a wrong count or numbers that are not finite.
    """

    wrench: Array
    frame_b: str = "body"

    def __post_init__(self) -> None:
        _keep(self, wrench=6)

    def on_pose(self, T_F_b: Array) -> tuple[float, Array, Array]:  # noqa: ARG002
        """No energy, alpha = -w, constant: T = 0."""
        return np.nan, -self.wrench, np.zeros((6, 6))

    @property
    def given(self) -> Given | None:  # type: ignore[override]
        """Moment and force along the axes of the body."""
        return self._on_body("follower", self.wrench, (0.0, 0.0, 0.0), "body")

    def parted(self, T_F_b: Array) -> tuple[float, Array] | None:  # noqa: ARG002
        """A moment alone."""
        return None if self.wrench[3:].any() else (0.0, self.wrench[:3])


@dataclass(frozen=True, eq=False)
class Scaled(Potential):
    """A multiple of another potential: a load that grows.

    Attributes
    ----------
    potential : Potential
        Term to be scaled.
    factor : float
        Factor.
    """

    potential: Potential
    factor: float

    @property
    def is_external(self) -> bool:  # type: ignore[override]
        """Whether the potential is."""
        return self.potential.is_external

    @property
    def dead(self) -> DeadLoad | None:  # type: ignore[override]
        """The multiple of the potential's, with its whole mass."""
        whole = self.potential.dead
        return None if whole is None else whole._replace(force=self.factor * whole.force)

    def evaluate(self, posture: Posture) -> Evaluation:
        """Energy, gradient and derivative, times the factor."""
        energy, gradient, hessian = self.potential.evaluate(posture)
        return Evaluation(
            self.factor * energy, self.factor * gradient, self.factor * hessian
        )


@checked
def payload(
    mass: float,
    acceleration: ArrayLike,
    point: ArrayLike = (0.0, 0.0, 0.0),
    frame_b: str = "body",
) -> DeadForce:
    """Weight of a mass at a point of a frame.

    Parameters
    ----------
    mass : float
        Not negative; in the mechanism's unit of force over that of `acceleration` (kg in
        SI).
    acceleration : array_like, shape (3,)
        Acceleration of the uniform field, in F.
    point : array_like, shape (3,)
        Mass centre in frame b.
    frame_b : str
        Name of a frame of the mechanism, or "body".

    Raises
    ------
    InputError
        For a negative mass, a wrong count or numbers that are not finite.
    """
    if not checked_number(mass, "payload mass") >= 0.0:
        raise InputError(
            "payload mass cannot be used", expected="a number from zero", got=mass
        )
    weight = mass * _numbers(acceleration, 3, "acceleration")
    centre = _numbers(point, 3, "mass centre")
    checked_reach(centre, "mass centre")
    return DeadForce(weight, centre, frame_b, float(mass))
