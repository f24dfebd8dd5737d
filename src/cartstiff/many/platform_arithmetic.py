r"""The arithmetic of a body held by lines, on recording numbers.

The coordinates are the pose of P in F; derivatives are taken along body twists, so that K^B is the
Hessian of the energy. With anchors a, points b in M, length l, direction u, line g = (b x u, u),
tension t:

    W = sum t g,    K^B = sum k g g^T + (second derivative of sum t l),
    K^F = K^B - (second derivative of sum mu l),    sum mu g = W,

mu = t where nothing but the lines acts. `cartstiff.potentials.line_springs` has the same in NumPy.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import Any

import numpy as np

from cartstiff import numerics
from cartstiff.geometry.se3 import Array
from cartstiff.many.algebra import (
    Reflections,
    cross,
    largest,
    norm_squared,
    reflections,
    skew,
    upper_inverse,
    zeros,
)
from cartstiff.many.arithmetic import (
    ENGINE,
    JACOBIAN_CONDITION,
    LARGEST_ANGLE,
    PLAIN,
    STIFFNESS_CONDITION,
    add_compliances,
    add_under_load,
    connections,
    holds_soft_directions,
    limited,
    noteworthy,
    taut_stiffness,
)
from cartstiff.many.leg_masses import LegMasses, dead_force
from cartstiff.many.tape import Scalar, Tape, cosine, larger, pick, sine, square_root

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
        verdict = larger(verdict, pick(size, length, PLAIN, ENGINE))

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
    W: Array | None = None
    if case.rest == "given":
        stretch = lengths - tape.vector("rest", m)
        t = k * stretch
    else:
        t = zeros(m)
    if case.wrench != "none":
        W = tape.vector("wrench", 6)
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
                verdict = larger(verdict, pick(least, tension, PLAIN, ENGINE))
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
    stiffness = connections(K_B, W)
    if m == 6 and decomposition is not None:
        arrays["jacobian"] = decomposition.apply(inverse_R.T).T
        if alone:
            stiffness["F"] = pulled
        else:
            mu = arrays["jacobian"].T @ W
            stiffness["F"] = K_B - _turning(points, lengths, u, lines, mu)
    T = zeros(4, 4)
    T[:3, :3], T[:3, 3], T[3, 3] = R, p, 1.0
    arrays.update(pose=T, wrench=W, energy=np.array([energy], object), tensions=t)
    arrays.update({f"stiffness_{name}": K for name, K in stiffness.items()})
    if case.inertia:
        M = np.reshape(case.inertia, (6, 6)).astype(object)
        M = M if case.legs is None else M + case.legs.kinetic(points, lines, lengths)
        arrays |= {"kinetic": M, "lagrangian": K_B, "motion": np.eye(6)}
    condition = add_compliances(arrays, stiffness, wanted, natural)
    add_under_load(arrays, wanted, natural)
    verdict = larger(verdict, limited(condition, STIFFNESS_CONDITION**2))
    # Near type 2 forces of actuators, and what they add to the stiffness, are known to less.
    verdict = larger(verdict, limited(condition * squared_condition, _KNOWN**2))
    verdict = larger(verdict, holds_soft_directions(K_B, wanted))
    arrays["verdict"] = np.array([verdict], object)
    if "noteworthy" in wanted and decomposition is not None and "compliance_B" in arrays:
        arrays["noteworthy"] = noteworthy(squared_condition, (K_B, arrays["compliance_B"]))
    return arrays
