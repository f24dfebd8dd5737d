r"""The arithmetic of a body held by lines, on recording numbers.

The coordinates are the pose of P in F; derivatives are taken along body twists, so that K^B is the
Hessian of the energy. With anchors a, points b in M, length l, direction u, line g = (b x u, u),
tension t:

    W = sum t g,    K^B = sum k g g^T + (second derivative of sum t l),
    K^F = K^B - (second derivative of sum mu l),    sum mu g = W,

mu = t where nothing but the lines acts. `cartstiff.potentials.line_springs` has the same in NumPy.

Masses of a platform's legs on recording numbers: the formulas of `mechanisms.struts`.

Of a leg with line g = (b x u, u), length L, weights per kg w in M, ``P = 1 - u u^T`` and
D = [-[b]x, 1], which turns a body twist into the velocity of b.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import Any

import numpy as np

from cartstiff import numerics
from cartstiff.batch.algebra import (
    FALLBACK,
    JACOBIAN_CONDITION,
    LARGEST_ANGLE,
    PLAIN,
    STIFFNESS_CONDITION,
    Reflections,
    add_compliances,
    congruence,
    connections,
    cross,
    given_wrench,
    holds_soft_directions,
    largest,
    limited,
    norm_squared,
    noteworthy,
    reflections,
    skew,
    taut_stiffness,
    upper_inverse,
    zeros,
)
from cartstiff.batch.tape import Scalar, Tape, cosine, larger, pick, sine, square_root
from cartstiff.batch.twists import numbers
from cartstiff.geometry.se3 import Array
from cartstiff.mechanisms.platform import Struts
from cartstiff.stiffness.applied_load import DEAD_AT_ORIGIN, Axes, LoadKind


@dataclass(frozen=True)
class LegMasses:
    """Masses of m legs as plain numbers; a key.

    Attributes
    ----------
    fixed, moving, fixed_com, moving_com : as of `Struts`.
    turning : moments of inertia of both bars of a leg about their own centres, across the line.
    """

    fixed: tuple[float, ...]
    moving: tuple[float, ...]
    fixed_com: tuple[float, ...]
    moving_com: tuple[float, ...]
    turning: tuple[float, ...]

    @staticmethod
    def of(struts: Struts) -> LegMasses:
        """Those of a platform's legs."""
        turning = sum(struts.turning_moments)
        return LegMasses(
            *map(
                numbers,
                (
                    struts.fixed,
                    struts.moving,
                    struts.fixed_com,
                    struts.moving_com,
                    np.asarray(turning),
                ),
            )
        )

    def weighed(
        self, points: Array, u: Array, lengths: Array, weight: Array
    ) -> tuple[Scalar, Array, Array]:
        """Energy but for what the pose of M adds, gradient and Hessian along body twists.

        Points (m, 3), directions (m, 3) and the weight (3,) per kg are in M; the energy is that in
        a frame F whose origin is M's.
        """
        energy: Scalar = 0.0
        gradient, hessian = zeros(6), zeros(6, 6)
        for k, (b, d) in enumerate(zip(points, u, strict=True)):
            fixed, moving = self.fixed[k], self.moving[k]
            share = fixed * self.fixed_com[k] - moving * self.moving_com[k]
            along = d @ weight
            across = weight - d * along
            per = 1.0 / lengths[k]
            energy = energy - (b @ weight) * (fixed + moving)
            energy = energy - along * (share - lengths[k] * fixed)
            _, alpha, H = dead_force(weight * moving + across * (share * per), b)
            gradient, hessian = gradient + alpha, hessian + H
            P = np.eye(3) - np.outer(d, d)
            second = (np.outer(d, across) + np.outer(across, d) + P * along) * (share * per * per)
            hessian = hessian + congruence(_velocity(b), second)
        return energy, gradient, hessian

    def kinetic(self, points: Array, lines: Array, lengths: Array) -> Array:
        """Masses' matrix (6, 6) on body twists."""
        total = zeros(6, 6)
        for k, (b, line, L) in enumerate(zip(points, lines, lengths, strict=True)):
            per = 1.0 / L
            beyond = 1.0 - per * self.moving_com[k]
            across = beyond * beyond * self.moving[k]
            own = self.fixed[k] * self.fixed_com[k] ** 2 + self.turning[k]
            across = across + per * per * own
            D = _velocity(b)
            total = total + np.outer(line, line) * (self.moving[k] - across)
            total = total + (D.T @ D) * across
        return total


def dead_force(force: Array, point: Array) -> tuple[Scalar, Array, Array]:
    """Energy, alpha and Hessian of a force constant in F, now along M's axes, at a point of M.

    The energy is that in a frame F whose origin is M's.
    """
    f = -force
    alpha = np.concatenate([skew(point) @ f, f])
    H = zeros(6, 6)
    H[:3, :3] = (np.outer(f, point) + np.outer(point, f)) * 0.5
    for i in range(3):
        H[i, i] = H[i, i] - f @ point
    H[3:, :3] = skew(f) * 0.5
    H[:3, 3:] = skew(f) * -0.5
    energy: Scalar = (f * point).sum()
    return energy, alpha, H


def _velocity(point: Array) -> Array:
    """Velocity of a point per body twist, (3, 6)."""
    velocity = zeros(3, 6)
    velocity[:, :3], velocity[:, 3:] = -skew(point), np.eye(3)
    return velocity


#: Shortest line that is trusted, as a share of the platform's size; the engine names none shorter.
_SHORT = numerics.SHORTEST
#: Product of the condition numbers of lines and stiffness up to which a compliance has its digits,
#: one to spare.
_KNOWN = 0.1 * numerics.LOST_ERROR / numerics.EPSILON


@dataclass(frozen=True)
class PlatformCase:
    """A platform and what acts on it, as plain numbers; a key.

    Attributes
    ----------
    anchors, points : flat (m, 3), in F and in M; empty where `lines` is not 0.
    T_P_M : flat (4, 4).
    length : characteristic length.
    rest : {"given", "open"}
        Whether the lines have rest lengths, or these are chosen posture by posture.
    wrench : {"none", "shared", "each"}
    unilateral : bool
    points_of_forces : points of the body in M that carry constant forces.
    derivatives : bool
        Whether energy, gradient and Hessian of further potentials are given as arrays.
    legs : LegMasses, optional
        Masses of the legs, where these count.
    has_weight : bool
        Whether the legs weigh.
    inertia : flat (6, 6) of the body on its twists, where vibrations count.
    lines : int
        How many lines, where anchors, points and length are given at run time: one program then
        serves platforms of every size.
    load, axes : as of `cartstiff.batch.chains.ChainCase`.
    """

    anchors: tuple[float, ...]
    points: tuple[float, ...]
    T_P_M: tuple[float, ...]
    length: float
    rest: str = "given"
    wrench: str = "none"
    unilateral: bool = False
    points_of_forces: tuple[tuple[float, ...], ...] = ()
    derivatives: bool = False
    legs: LegMasses | None = None
    has_weight: bool = False
    inertia: tuple[float, ...] = ()
    lines: int = 0
    load: LoadKind = DEAD_AT_ORIGIN
    axes: Axes = "body"


def _pose(q: Array, T_P_M: Array) -> tuple[Array, Array]:
    """R and p of ``T_F_M``."""
    (sr, sp, sy), (cr, cp, cy) = [sine(x) for x in q[3:]], [cosine(x) for x in q[3:]]
    across, along = sp * sr, sp * cr
    R = np.array(
        [
            [cy * cp, cy * across - sy * cr, cy * along + sy * sr],
            [sy * cp, sy * across + cy * cr, sy * along - cy * sr],
            [-sp, cp * sr, cp * cr],
        ],
        object,
    )
    return R @ T_P_M[:3, :3], R @ T_P_M[:3, 3] + q[:3]


def _turning(points: Array, lengths: Array, u: Array, lines: Array, t: Array) -> Array:
    """Second derivative of ``sum t l`` along body twists."""
    w = t / lengths
    total = -((lines.T * w) @ lines)
    inner = points.T @ (points * w[:, None] - u * t[:, None])
    mean = (inner + inner.T) * 0.5
    total[:3, :3] = total[:3, :3] - mean
    trace = inner[0, 0] + inner[1, 1] + inner[2, 2]
    coupling = skew(w @ points - (t @ u) * 0.5)
    total[:3, 3:] = total[:3, 3:] + coupling
    total[3:, :3] = total[3:, :3] - coupling
    weight = sum(w[1:], w[0])
    for i in range(3):
        total[i, i] = total[i, i] + trace
        total[3 + i, 3 + i] = total[3 + i, 3 + i] + weight
    return total


def _chosen_tensions(
    reflections: Reflections, inverse_R: Array, missing: Array, present: Array
) -> Array:
    """Tensions nearest to the present ones whose lines, Q R, sum to what is missing."""
    short = zeros(len(present))
    short[:6] = inverse_R.T @ missing
    return present + reflections.apply(short)


def platform_arrays(tape: Tape, case: PlatformCase, wanted: Collection[str]) -> dict[str, Array]:
    """What of the outputs exists, among it all that is wanted, and "verdict" on the posture."""
    q = tape.vector("q", 6)
    anchors = np.reshape(case.anchors, (-1, 3))
    points = np.reshape(case.points, (-1, 3))
    natural: Scalar = case.length
    if case.lines:
        anchors = tape.vector("anchors", 3 * case.lines).reshape(-1, 3)
        points = tape.vector("points", 3 * case.lines).reshape(-1, 3)
        natural = tape.input("length", 0)
    m = len(points)
    k = tape.vector("stiffness", m)
    R, p = _pose(q, np.reshape(case.T_P_M, (4, 4)))
    along = points - (anchors - p) @ R
    lengths = np.array([square_root(norm_squared(a)) for a in along], object)
    u = along * (1.0 / lengths)[:, None]
    lines = np.array([[*cross(b, d), *d] for b, d in zip(points, u, strict=True)], object)
    size = _SHORT * larger(largest(anchors), largest(points))
    verdict: Scalar = limited(largest(q[3:]), LARGEST_ANGLE)
    for length in lengths:
        verdict = larger(verdict, pick(size, length, PLAIN, FALLBACK))

    energy: Any = 0.0
    gradient, hessian = zeros(6), zeros(6, 6)
    if case.derivatives:
        energy = tape.input("energies", 0)
        gradient = tape.vector("gradients", 6)
        hessian = tape.vector("hessians", 36).reshape(6, 6)
        hessian = np.where(np.tri(6, dtype=bool), hessian, hessian.T)
    forces = tape.vector("forces", 3 * len(case.points_of_forces)).reshape(-1, 3)
    for force, point in zip(forces, case.points_of_forces, strict=True):
        E, g, H = dead_force(R.T @ force, np.array(point))
        energy, gradient, hessian = energy + E - force @ p, gradient + g, hessian + H
    if case.legs is not None and case.has_weight:
        per_kg = tape.vector("weight", 3)
        E, g, H = case.legs.weighed(points, u, lengths, R.T @ per_kg)
        whole = sum(case.legs.fixed) + sum(case.legs.moving)
        energy, gradient, hessian = energy + E - (per_kg @ p) * whole, gradient + g, hessian + H
    alone = not (case.derivatives or case.points_of_forces or case.has_weight)

    arrays: dict[str, Array] = {"actuation": lines}
    decomposition, inverse_R = None, zeros(6, 6)
    squared_condition: Scalar = 0.0
    if m >= 6:
        decomposition = reflections(lines)
        inverse_R = upper_inverse(decomposition.R)
        R_norm = norm_squared(decomposition.R[:, :3]) + norm_squared(
            decomposition.R[:, 3:] * natural
        )
        inverse_norm = norm_squared(inverse_R[:3]) + norm_squared(inverse_R[3:] * (1.0 / natural))
        squared_condition = R_norm * inverse_norm
        verdict = larger(verdict, limited(squared_condition, JACOBIAN_CONDITION**2))
    # Tensions and stretches of the lines, and the wrench.
    taut = k
    T = zeros(4, 4)
    T[:3, :3], T[:3, 3], T[3, 3] = R, p, 1.0
    W = given_wrench(tape, case, lambda: T)
    if case.rest == "given":
        stretch = lengths - tape.vector("rest", m)
        t = k * stretch
    else:
        t = zeros(m)
    if W is not None or (case.rest == "open" and not alone):
        if decomposition is None:
            raise ValueError("fewer than six lines carry no chosen wrench")
        missing = -gradient if W is None else W - gradient
        present = t if m > 6 else zeros(m)
        missing = missing - lines.T @ present
        t = _chosen_tensions(decomposition, inverse_R, missing, present)
        if case.unilateral:
            # Of more than six cables the engine keeps each taut, if it can.
            least = largest(t) * numerics.NEGLIGIBLE_FORCE if m > 6 else -numerics.TINY
            for tension in t:
                verdict = larger(verdict, pick(least, tension, PLAIN, FALLBACK))
        energy = energy + ((t * t / k).sum()) * 0.5
        if W is None:
            W = zeros(6)
    elif case.rest == "open":
        W = zeros(6)
    else:
        if case.unilateral:
            taut = np.array(
                [taut_stiffness(*each) for each in zip(k, stretch, strict=True)], object
            )
            t = taut * stretch
        energy = energy + (t @ stretch) * 0.5
        W = t @ lines + gradient

    pulled = (lines.T * taut) @ lines
    K_B = pulled + _turning(points, lengths, u, lines, t) + hessian
    stiffness = connections(K_B, W, case.load)
    if m == 6 and decomposition is not None:
        arrays["jacobian"] = decomposition.apply(inverse_R.T).T
        if alone:
            stiffness["F"] = pulled
        else:
            mu = arrays["jacobian"].T @ W
            stiffness["F"] = K_B - _turning(points, lengths, u, lines, mu)
    arrays.update(pose=T, wrench=W, energy=np.array([energy], object), tensions=t)
    arrays.update({f"stiffness_{name}": K for name, K in stiffness.items()})
    if case.inertia:
        M = np.reshape(case.inertia, (6, 6)).astype(object)
        M = M if case.legs is None else M + case.legs.kinetic(points, lines, lengths)
        arrays |= {"kinetic": M, "lagrangian": K_B, "motion": np.eye(6)}
    condition = add_compliances(arrays, stiffness, wanted, natural)
    verdict = larger(verdict, limited(condition, STIFFNESS_CONDITION**2))
    # Near type 2 forces of actuators, and what they add to the stiffness, are known to less.
    verdict = larger(verdict, limited(condition * squared_condition, _KNOWN**2))
    verdict = larger(verdict, holds_soft_directions(K_B, wanted))
    arrays["verdict"] = np.array([verdict], object)
    if "noteworthy" in wanted and decomposition is not None and "compliance_B" in arrays:
        arrays["noteworthy"] = noteworthy(squared_condition, (K_B, arrays["compliance_B"]))
    return arrays
