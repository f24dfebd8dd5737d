r"""What an equilibrium is made of: forces, constraints, and the motions that are left.

Everything that acts has gradient g and derivative H in the n coordinates. Closures, held
components of a displacement and touched limits are constraints with Jacobian A. On the motions
that keep them, N = null A,

    g_N = N^T g,    g + A^T lam = 0 at equilibrium,    H_N = N^T (H + sum lam_k A_k') N

H_N is the exact second derivative of the energy along motions that are pulled back onto the
constraints at right angles to N. Coordinates are measured in their natural units, angles in
radians and distances in the characteristic length, so that g_N and H_N are energies.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from cartstiff.errors import ConvergenceError, InputError
from cartstiff.geometry.se3 import Array
from cartstiff.mechanisms.contract import MechanismPosture
from cartstiff.mechanisms.elastic import ElasticMechanism
from cartstiff.potentials.contract import Evaluation, Map, Potential
from cartstiff.statics.held import Held
from cartstiff.statics.limits import Contact, Limits

__all__ = ["DEFINITE", "Balance", "Point", "System", "spectrum"]

#: Singular values below this share of the largest count as zero.
RANK = 1e-10
#: Eigenvalues below this share of the largest count as zero.
DEFINITE = 1e-11
#: A deflection of this size, in natural units, sets the least force that residuals refer to.
SLIGHT = 1e-4
#: Largest move of one step onto the constraints, in natural units, and how many are tried.
_PULL, _PULLS = 0.2, 100


@dataclass(slots=True, eq=False)
class Point:
    """The mechanism at coordinates q, with all forces that act there.

    Attributes
    ----------
    energies, forces : float
        Sum of the terms' absolute energies; largest generalised force of any one term.
    """

    q: Array
    posture: MechanismPosture
    evaluation: Evaluation
    energies: float
    forces: float
    limited: Array


@dataclass(slots=True, eq=False)
class Balance:
    """Forces and stiffness on the motions that the constraints leave, in natural units.

    Attributes
    ----------
    free : ndarray (n, f) or None
        N; None stands for the identity.
    multipliers : ndarray (m,)
        Constraint forces lam, per unit of each constraint.
    force : ndarray (f,)
        g_N.
    stiffness : ndarray (f, f)
        H_N, symmetric where the loads have a potential.
    residual : float
        Largest g_N over the largest force of any one term (or what a slight deflection takes).
    """

    free: Array | None
    multipliers: Array
    force: Array
    stiffness: Array
    residual: float

    def motion(self, y: Array) -> Array:
        """Natural coordinates (n,) of a free motion (f,)."""
        return y if self.free is None else np.asarray(self.free @ y)


class System:
    """An elastic mechanism with loads, held components and limits.

    Parameters
    ----------
    elastic : ElasticMechanism
        With all rest positions chosen.
    loads : sequence of Potential
        What acts besides.
    held : Held, optional
        With its reference pose.
    limits : Limits
        Of joints or legs.

    Raises
    ------
    InputError
        If a load is no potential.
    """

    def __init__(
        self,
        elastic: ElasticMechanism,
        loads: Sequence[Potential] = (),
        held: Held | None = None,
        limits: Limits | None = None,
    ) -> None:
        for load in loads:
            if not isinstance(load, Potential):
                raise InputError(
                    "a load is no potential",
                    expected="DeadForce, DeadWrench, FollowerWrench or another Potential",
                    got=load,
                )
        self.elastic = elastic
        self.loads = tuple(loads)
        self.held = held
        self.limits = Limits(elastic.mechanism, ignore=True) if limits is None else limits
        self._terms = (*elastic.terms(), *self.loads)

    def at(self, q: ArrayLike) -> Point:
        """Everything that acts at coordinates q."""
        posture = self.elastic.mechanism.at(q)
        columns = posture.coordinate_lengths
        n = columns.size
        energy, gradient, hessian = 0.0, np.zeros(n), np.zeros((n, n))
        energies = forces = 0.0
        for term in self._terms:
            e, g, h = term.evaluate(posture)
            energy, gradient, hessian = energy + e, gradient + g, hessian + h
            energies += abs(e)
            forces = max(forces, float(np.abs(g * columns).max(initial=0.0)))
        limited = self.limits.values(posture) if len(self.limits) else np.empty(0)
        total = Evaluation(energy, gradient, hessian)
        return Point(posture.q, posture, total, energies, forces, limited)

    def constraints(
        self, posture: MechanismPosture, contacts: Sequence[Contact]
    ) -> tuple[Array, Map, Array] | None:
        """Residual (m,), map, and natural size (m,) of closures, held components, contacts."""
        parts: list[tuple[Array, Map]] = []
        sizes: list[Array] = []
        if posture.closure is not None and posture.residual is not None:
            parts.append((posture.residual, posture.closure))
            sizes.append(np.full(len(posture.residual), max(1.0, posture.length)))
        if self.held is not None:
            residual, to_held, _ = self.held.constraint(posture)
            parts.append((residual, to_held))
            sizes.append(np.array([1.0 if i < 3 else posture.length for i in self.held.rows]))
        if contacts:
            parts.append(self.limits.constraint(posture, contacts))
            sizes.append(self.limits.sizes(posture)[[c.quantity for c in contacts]])
        if not parts:
            return None
        if len(parts) == 1:
            return (*parts[0], sizes[0])
        counts = np.cumsum([len(residual) for residual, _ in parts])[:-1]

        def curvature(multipliers: Array) -> Array:
            shares = np.split(multipliers, counts)
            total: Array = sum(
                (m.curvature(s) for (_, m), s in zip(parts, shares, strict=True)),
                start=np.zeros(1),
            )
            return total

        jacobian = np.concatenate([m.jacobian for _, m in parts])
        residuals = np.concatenate([residual for residual, _ in parts])
        return residuals, Map(jacobian, curvature), np.concatenate(sizes)

    def balance(self, point: Point, contacts: Sequence[Contact] = ()) -> Balance:
        """Forces and stiffness on the motions that keep the constraints."""
        columns = point.posture.coordinate_lengths
        g = point.evaluation.gradient * columns
        H = point.evaluation.hessian * columns[:, None] * columns
        found = self.constraints(point.posture, contacts)
        scale = max(point.forces, SLIGHT * float(np.abs(H).max(initial=0.0)), 1e-300)
        if found is None:
            residual = float(np.abs(g).max(initial=0.0)) / scale
            return Balance(None, np.empty(0), g, H, residual)
        _, to_constraints, sizes = found
        A = to_constraints.jacobian * columns / sizes[:, None]
        U, values, Vt = np.linalg.svd(A)
        rank = int(np.sum(values > RANK * max(values.max(initial=0.0), 1e-300)))
        N = Vt[rank:].T
        lam = -(U[:, :rank] / values[:rank]) @ (Vt[:rank] @ g) / sizes
        H = H + to_constraints.curvature(lam) * columns[:, None] * columns
        g_N = N.T @ g
        residual = float(np.abs(g_N).max(initial=0.0)) / scale
        return Balance(N, lam, g_N, N.T @ H @ N, residual)

    def turning(self, posture: MechanismPosture, step: Array) -> float:
        """Largest angle of a step in natural units."""
        if posture.coordinates_are_pose:
            return float(np.abs(step[:3]).max())
        angles = [not c.is_length for c in self.elastic.mechanism.coordinates]
        return float(np.abs(step[angles]).max(initial=0.0))

    def moved(self, point: Point, step: Array) -> Array:
        """Coordinates after a step in natural units, before the constraints are restored."""
        return self.elastic.mechanism.moved(point.q, step * point.posture.coordinate_lengths)

    def retracted(self, q: Array, contacts: Sequence[Contact] = ()) -> Array:
        """Coordinates near q that satisfy all constraints, by Newton's method with least change.

        Raises
        ------
        ConvergenceError
            If they cannot be met from there.
        """
        mechanism = self.elastic.mechanism
        best = size = np.inf
        for _ in range(_PULLS):
            posture = mechanism.at(q)
            found = self.constraints(posture, contacts)
            if found is None:
                return q
            residual, to_constraints, sizes = found
            missed = residual / sizes
            size = float(np.abs(missed).max(initial=0.0))
            if size <= 1e-15 or (size <= 1e-12 and size >= 0.5 * best):
                return q
            best = min(best, size)
            columns = posture.coordinate_lengths
            A = to_constraints.jacobian * columns / sizes[:, None]
            step = -np.linalg.lstsq(A, missed, rcond=RANK)[0]
            largest = float(np.abs(step).max(initial=0.0))
            if not np.isfinite(largest) or largest < 1e-16:
                break
            q = mechanism.moved(q, columns * step * min(1.0, _PULL / largest))
        if size <= 1e-10:
            return q
        kinds = ("closures", posture.closure), ("held displacement", self.held)
        what = [name for name, there in kinds if there is not None]
        what += ["limits"] if contacts else []
        raise ConvergenceError(
            f"the {' and '.join(what)} cannot be met from this posture",
            iterations=_PULLS,
            residual=size,
        )


def spectrum(stiffness: Array, conservative: bool) -> Array:
    """Eigenvalues of H_N by increasing real part; without a potential they may be complex."""
    if conservative:
        return np.linalg.eigvalsh(0.5 * (stiffness + stiffness.T))
    values = np.linalg.eigvals(stiffness)
    values = values[np.argsort(values.real)]
    return values.real if np.isrealobj(values) or not values.imag.any() else values
