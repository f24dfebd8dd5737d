r"""Displacement of a frame prescribed partly or wholly: components held,
with their reactions.

From a reference pose (R_0, p_0) the displacement of a frame is the rotation vector
log(R_0^T R) and the translation p - p_0, both along the axes of the reference pose or of
the world. Held components are constraints d(q) = value; their multipliers are the
reactions.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from math import factorial
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from cartstiff.core.arrays import Array, checked_number, is_pose, real_array
from cartstiff.core.errors import InputError, check_name, checked_kind
from cartstiff.core.geometry import se3
from cartstiff.core.mechanisms.contract import MechanismPosture
from cartstiff.core.potentials.contract import SecondOrderMap
from cartstiff.core.units import Units

#: Names of the components, rotations first.
COMPONENTS = ("rx", "ry", "rz", "x", "y", "z")

# (1 - (t/2) cot(t/2)) / t^2 = sum_k |B_2k| t^(2k-2) / (2k)!, up to an angle of 1: the
# first neglected term is then below 1e-16 of the sum.
_BERNOULLI = (
    1 / 6,
    1 / 30,
    1 / 42,
    1 / 30,
    5 / 66,
    691 / 2730,
    7 / 6,
    3617 / 510,
    43867 / 798,
)
_SERIES = [
    b / factorial(2 * k) for k, b in enumerate((*_BERNOULLI, 174611 / 330), start=1)
]


def displacement_heads(units: Units, before: str) -> list[str]:
    """Heads of the columns (6) of displacements of the body, rotations first."""
    of_each = np.repeat([units.angle, units.length], 3)
    return [f"{before}{c} [{u}]" for c, u in zip(COMPONENTS, of_each, strict=True)]


@dataclass(frozen=True, eq=False)
class Held:
    """Components of a frame's displacement that are held at given values.

    Attributes
    ----------
    values : mapping of str to float
        Held components ("rx", "ry", "rz" in rad; "x", "y", "z" in length units) with the
        wanted displacement; the others are free.
    reference : ndarray (4, 4) or None
        Pose in F from which the displacement is measured; None: the pose at the start.
    axes : {"body", "world"}
        Axes of the components: those of the reference pose, or of F.
    frame : str
        The frame held; "body" is the frame of interest M.

    Raises
    ------
    UnknownNameError
        For a component that does not exist.
    InputError
        For values that are not finite, rotations of half a turn or more, a reference that
        is no rigid motion, or unknown axes.
    """

    values: Mapping[str, float]
    reference: Array | None = None
    axes: Literal["body", "world"] = "body"
    frame: str = "body"

    def __post_init__(self) -> None:
        checked_kind(self.values, Mapping, "held displacement", "components and values")
        for name, value in self.values.items():
            check_name("displacement component", name, COMPONENTS)
            checked_number(value, f"held displacement {name}")
        if not self.values:
            raise InputError(
                "nothing is held", expected="one or more of " + ", ".join(COMPONENTS)
            )
        turned = float(np.linalg.norm([self.values.get(c, 0.0) for c in COMPONENTS[:3]]))
        if turned >= 3.1:
            raise InputError(
                "held rotation is too large", expected="below 3.1 rad", got=turned
            )
        if self.axes not in ("body", "world"):
            raise InputError("unknown axes", expected="body or world", got=self.axes)
        if self.reference is not None and not is_pose(self.reference):
            raise InputError("reference pose is not a rigid motion", got=self.reference)

    @classmethod
    def from_pose(cls, T_F_f: ArrayLike, frame: str = "body") -> Held:
        """All six components held at a pose ``T_F_f`` (4, 4).

        Raises
        ------
        InputError
            For a pose that has no numbers.
        """
        return cls(dict.fromkeys(COMPONENTS, 0.0), real_array(T_F_f), frame=frame)

    @property
    def rows(self) -> list[int]:
        """Indices of the held components."""
        return [i for i, name in enumerate(COMPONENTS) if name in self.values]

    @property
    def names(self) -> list[str]:
        """Held components in order."""
        return [COMPONENTS[i] for i in self.rows]

    def at_start(self, posture: MechanismPosture) -> Held:
        """The same with its reference: the pose at the start unless one was given."""
        if self.reference is not None:
            return self
        return replace(self, reference=posture.relative("world", self.frame)[0])

    def scaled(self, factor: float) -> Held:
        """The same with all displacements multiplied by a `factor`."""
        return replace(self, values={n: factor * v for n, v in self.values.items()})

    def constraint(
        self, posture: MechanismPosture
    ) -> tuple[Array, SecondOrderMap, Array]:
        """Residual (k,), its map of the coordinates, and its Jacobian (k, 6) on
        body twists.
        """
        T, to_pose = posture.relative("world", self.frame)
        reference = T if self.reference is None else self.reference
        displacement, D, second = _components(reference, T, self.axes)
        rows = self.rows
        wanted = np.array([self.values[name] for name in self.names])
        J = to_pose.jacobian
        select = D[rows]

        def curvature(multipliers: Array) -> Array:
            mu = np.zeros(6)
            mu[rows] = multipliers
            return J.T @ second(mu) @ J + to_pose.curvature(D.T @ mu)

        return displacement[rows] - wanted, SecondOrderMap(select @ J, curvature), select


def displacement_between(T_F_a: ArrayLike, T_F_b: ArrayLike) -> Array:
    """Displacement (6,) from pose a to pose b: rotation vector and translation,
    in axes of F.
    """
    return _components(real_array(T_F_a), real_array(T_F_b), "world")[0]


def _components(
    T_0: Array, T: Array, axes: str
) -> tuple[Array, Array, Callable[[Array], Array]]:
    """Displacement (6,), its Jacobian (6, 6) on body twists, and its second derivative.

    The latter is ``second(mu)``: Hessian (6, 6) of ``mu . displacement`` in exponential
    coordinates.
    """
    R_0, R = T_0[:3, :3], T[:3, :3]
    r = se3.log(se3.pose(R_0.T @ R))[:3]
    d, slope = _series(float(r @ r))
    r_cross = se3.skew(r)
    inverse_jacobian = np.eye(3) + 0.5 * r_cross + d * (r_cross @ r_cross)
    turn, shift = (np.eye(3), R_0.T) if axes == "body" else (R_0, np.eye(3))
    D = np.zeros((6, 6))
    D[:3, :3] = turn @ inverse_jacobian
    D[3:, 3:] = shift @ R
    displacement = np.concatenate([turn @ r, shift @ (T[:3, 3] - T_0[:3, 3])])

    def second(mu: Array) -> Array:
        Q = np.zeros((6, 6))
        # Translation: R (w x v) / 2 along the exponential.
        Q[:3, 3:] = -0.5 * se3.skew(D[3:, 3:].T @ mu[3:])
        Q[3:, :3] = Q[:3, 3:].T
        m = turn.T @ mu[:3]
        # Rotation: derivative along u of m . inverse_jacobian w, from
        # a x (b x c) = b (a.c) - c (a.b).
        mixed = np.outer(m, r) + (m @ r) * np.eye(3) - 2 * np.outer(r, m)
        X = -0.5 * se3.skew(m) + d * mixed + slope * np.outer(r, r_cross @ r_cross @ m)
        half = inverse_jacobian.T @ X
        Q[:3, :3] = 0.5 * (half + half.T)
        return Q

    return displacement, D, second


def _series(t2: float) -> tuple[float, float]:
    """``d = (1 - (t/2) cot(t/2)) / t^2`` and ``d' / t`` for t^2 given."""
    if t2 < 1.0:
        d = sum(c * t2**k for k, c in enumerate(_SERIES))
        return d, sum(2 * k * c * t2 ** (k - 1) for k, c in enumerate(_SERIES) if k)
    h = 0.5 * np.sqrt(t2)
    cot = h / np.tan(h)
    return float((1 - cot) / t2), float((cot + (h / np.sin(h)) ** 2 - 2) / (16 * h**4))
