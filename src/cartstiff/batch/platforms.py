r"""Stiffness and compliance of a body held by lines, on recorded numbers.

The coordinates are the pose of P in F; derivatives are taken along body twists, so that K^B is the
Hessian of the energy. With anchors a, points b in M, length l, direction u, line g = (b x u, u),
tension t:

    W = sum t g,    K^B = sum k g g^T + (second derivative of sum t l),
    K^F = K^B - (second derivative of sum mu l),    sum mu g = W,

mu = t where nothing but the lines acts. Lines are those of `cartstiff.potentials.line_springs`,
masses of the legs those of `cartstiff.mechanisms.platform`.
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
    add_compliances,
    connections,
    from_lower,
    given_wrench,
    holds_soft_directions,
    largest,
    limited,
    norm_squared,
    reflections,
    taut_stiffness,
    upper_inverse,
    zeros,
)
from cartstiff.batch.tape import Scalar, Tape, absolute, larger, pick
from cartstiff.geometry import se3
from cartstiff.geometry.se3 import Array
from cartstiff.mechanisms.platform import Struts
from cartstiff.potentials.line_springs import lines_of_many, second_derivative
from cartstiff.potentials.loads import held_force
from cartstiff.stiffness.applied_load import DEAD_AT_ORIGIN, Axes, LoadKind

#: Shortest line with the verdict `PLAIN`, as a share of the platform's size; `cartstiff.analyse`
#: reports lines of zero length.
_SHORTEST_LINE = numerics.SHORTEST_LINE
#: Largest product of the condition numbers of lines and stiffness at which a compliance has enough
#: digits, with a margin of one digit.
_MAX_CONDITION_PRODUCT = 0.1 * numerics.LOST_ERROR / numerics.EPSILON


@dataclass(frozen=True)
class PlatformCase:
    """A platform with its springs and loads as plain numbers; the key of its recorded programs.

    Attributes
    ----------
    anchors, points : flat (m, 3), in F and in M; empty where `lines` is not 0.
    T_P_M : flat (4, 4).
    length : characteristic length.
    rest : {"given", "open", "preload"}
        Whether the lines have rest lengths, or these are chosen at each posture, or there follow
        from the preload.
    wrench : {"none", "shared", "each"}
    unilateral : bool or tuple of bool (m,)
    points_of_forces : points of the body in M at which constant forces act.
    derivatives : bool
        Whether energy, gradient and Hessian of further potentials are input arrays.
    legs : Struts, optional
        Masses of the legs, for gravity and vibrations.
    has_weight : bool
        Whether gravity acts on the legs.
    inertia : inertia matrix of the body (6, 6), flat, for vibrations.
    lines : int
        Number of lines where anchors, points and length are inputs, so that one program serves
        platforms of every size; else 0.
    load, axes : as of `cartstiff.batch.chains.ChainCase`.
    is_chosen : bool
        Whether the tensions that balance a load are inputs, see `balances_among`.
    """

    anchors: tuple[float, ...]
    points: tuple[float, ...]
    T_P_M: tuple[float, ...]
    length: float
    rest: str = "given"
    wrench: str = "none"
    unilateral: bool | tuple[bool, ...] = False
    points_of_forces: tuple[tuple[float, ...], ...] = ()
    derivatives: bool = False
    legs: Struts | None = None
    has_weight: bool = False
    inertia: tuple[float, ...] = ()
    lines: int = 0
    load: LoadKind = DEAD_AT_ORIGIN
    axes: Axes = "body"
    is_chosen: bool = False

    @property
    def balances_among(self) -> bool:
        """Whether more than six lines balance a load, so that bounds may choose the tensions.

        The program finds the tensions nearest to the given ones. Where these are not within the
        bounds, others are chosen outside of it (`cartstiff.potentials.tensions`) from its outputs
        "nearest" and "null" with `is_chosen`. They are inputs of the same program: "tensions",
        below zero for cables that stay slack.
        """
        m = self.lines or len(self.points) // 3
        carries = self.derivatives or bool(self.points_of_forces) or self.has_weight
        is_chosen = self.wrench != "none" or self.rest == "preload"
        return m > 6 and (is_chosen or (self.rest == "open" and carries))


def platform_arrays(
    tape: Tape, case: PlatformCase, wanted: Collection[str]
) -> dict[str, Array]:
    """Outputs that exist, among them all that are wanted, and the "verdict" on the posture."""
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
    cables = np.broadcast_to(case.unilateral, m)
    T, T_P_M = zeros(4, 4), np.reshape(case.T_P_M, (4, 4))
    R_P = se3.rotation_by_angles(q[3:])
    T[:3, :3], T[:3, 3], T[3, 3] = R_P @ T_P_M[:3, :3], R_P @ T_P_M[:3, 3] + q[:3], 1.0
    geometry = lines_of_many(T, anchors, points)
    lengths, _, lines = geometry
    size = _SHORTEST_LINE * larger(largest(anchors), largest(points))
    verdict: Scalar = limited(largest(q[3:]), LARGEST_ANGLE)
    for length in lengths:
        verdict = larger(verdict, pick(size, length, PLAIN, FALLBACK))

    energy: Any = 0.0
    gradient, hessian = zeros(6), zeros(6, 6)
    if case.derivatives:
        energy = tape.input("energies", 0)
        gradient = tape.vector("gradients", 6)
        hessian = from_lower(tape.vector("hessians", 36).reshape(6, 6))
    forces = tape.vector("forces", 3 * len(case.points_of_forces)).reshape(-1, 3)
    for force, point in zip(forces, case.points_of_forces, strict=True):
        in_body, at = force @ T[:3, :3], np.array(point)
        g, H = held_force(in_body, at)
        energy = energy - in_body @ at - force @ T[:3, 3]
        gradient, hessian = gradient + g, hessian + H
    if case.legs is not None and case.has_weight:
        per_kg = tape.vector("weight", 3)
        E, g, H = case.legs.gravity(geometry, points, T, per_kg)
        energy, gradient, hessian = energy + E, gradient + g, hessian + H
    alone = not (case.derivatives or case.points_of_forces or case.has_weight)

    arrays: dict[str, Array] = {"actuation": lines, "leg_lengths": np.array(lengths)}
    decomposition, inverse_R = None, zeros(6, 6)
    squared_condition: Scalar = 0.0
    if m >= 6:
        decomposition = reflections(lines)
        inverse_R = upper_inverse(decomposition.R)
        R_norm = norm_squared(decomposition.R[:, :3]) + norm_squared(
            decomposition.R[:, 3:] * natural
        )
        inverse_norm = norm_squared(inverse_R[:3]) + norm_squared(
            inverse_R[3:] * (1.0 / natural)
        )
        squared_condition = R_norm * inverse_norm
        verdict = larger(verdict, limited(squared_condition, JACOBIAN_CONDITION**2))
    # Tensions and stretches of the lines, and the wrench.
    taut = k
    W = given_wrench(tape, case, lambda: T)
    given, stretch = zeros(m), zeros(m)
    if case.rest == "preload":
        given = tape.vector("preload", m)
    elif case.rest == "given":
        stretch = lengths - tape.vector("rest", m)
        given = k * stretch
    holds = case.rest == "preload" and m <= 6  # else the lines balance one another
    balances = case.rest == "preload" and not holds
    if W is not None or balances or (case.rest == "open" and not alone):
        if decomposition is None:
            raise ValueError("fewer than six lines carry no chosen wrench")
        asked = -gradient if W is None else W - gradient
        if m <= 6:
            given = zeros(m)
        elif case.rest == "given":
            given = _tensions(given, cables)
        # The tensions nearest to the given ones that add the missing wrench.
        missing, added = asked - lines.T @ given, zeros(m)
        added[:6] = inverse_R.T @ missing
        t = given + decomposition.apply(added)
        if case.is_chosen:
            arrays["nearest"], arrays["null"] = t, decomposition.apply(np.eye(m)[:, 6:])
            chosen = tape.vector("tensions", m)
            t, taut = _tensions(chosen, cables), _taut(k, chosen, cables)
        else:
            verdict = larger(verdict, _bounds_hold(tape, case, t, cables))
        energy = energy + ((t * t / k).sum()) * 0.5
        if W is None:
            W = zeros(6)
    elif case.rest == "open":
        t, W = zeros(m), zeros(6)
    elif holds:
        t = given
        energy = energy + ((t * t / k).sum()) * 0.5
        W = t @ lines + gradient
    else:
        taut = _taut(k, stretch, cables)
        t = taut * stretch
        energy = energy + (t @ stretch) * 0.5
        W = t @ lines + gradient

    pulled = (lines.T * taut) @ lines
    K_B = pulled + second_derivative(geometry, points, t) + hessian
    stiffness = connections(K_B, W, case.load)
    if m == 6 and decomposition is not None:
        arrays["jacobian"] = decomposition.apply(inverse_R.T).T
        if alone:
            stiffness["F"] = pulled
        else:
            mu = arrays["jacobian"].T @ W
            stiffness["F"] = K_B - second_derivative(geometry, points, mu)
    arrays.update(pose=T, wrench=W, energy=np.array([energy], object), tensions=t)
    arrays.update({f"stiffness_{name}": K for name, K in stiffness.items()})
    if case.inertia:
        M = np.reshape(case.inertia, (6, 6)).astype(object)
        M = M if case.legs is None else M + case.legs.mass_matrix(geometry, points)
        arrays |= {"kinetic": M, "lagrangian": K_B, "motion": np.eye(6)}
    condition = add_compliances(arrays, stiffness, wanted, natural)
    verdict = larger(verdict, limited(condition, STIFFNESS_CONDITION**2))
    # Near type 2 the forces of actuators, and their part of the stiffness, are less accurate.
    verdict = larger(
        verdict, limited(condition * squared_condition, _MAX_CONDITION_PRODUCT**2)
    )
    verdict = larger(verdict, holds_soft_directions(K_B, wanted))
    arrays["verdict"] = np.array([verdict], object)
    return arrays


def _tensions(pull: Array, cables: Array) -> Array:
    """Tensions (m,) of lines that pull by so much; zero for a slack cable."""
    each = zip(pull, cables, strict=True)
    return np.array([larger(0.0, t) if is_cable else t for t, is_cable in each], object)


def _taut(stiffness: Array, stretch: Array, cables: Array) -> Array:
    """Stiffnesses (m,), zero for slack cables; stretches or their tensions decide."""
    each = zip(stiffness, stretch, cables, strict=True)
    return np.array(
        [taut_stiffness(k, x) if is_cable else k for k, x, is_cable in each],
        object,
    )


def _bounds_hold(tape: Tape, case: PlatformCase, t: Array, cables: Array) -> Scalar:
    """Verdict on tensions t (m,); `cartstiff.analyse` takes others beyond bounds."""
    m = len(t)
    verdict: Scalar = PLAIN
    least: list[Scalar] = [-numerics.TINY] * m
    if m > 6:
        least = [*tape.vector("least", m)]
        share = numerics.NEGLIGIBLE_FORCE if case.rest == "given" else numerics.TAUT_SHARE
        if case.unilateral:
            mean = sum(absolute(x) for x in t[cables]) * (share / cables.sum())
        for i, most in enumerate(tape.vector("most", m)):
            if cables[i]:
                least[i] = pick(0.0, least[i], least[i], mean)
            verdict = larger(verdict, pick(t[i], most, PLAIN, FALLBACK))
    for i in range(m) if m > 6 else np.flatnonzero(cables).tolist():
        verdict = larger(verdict, pick(least[i], t[i], PLAIN, FALLBACK))
    return verdict
