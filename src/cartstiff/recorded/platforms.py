r"""Stiffness and compliance of a body held by lines, on recorded numbers.

The coordinates are the pose of P in F; derivatives are taken along body twists, so that
K^B is the Hessian of the energy. With anchors a, points b in M, length l, direction u,
line g = (b x u, u), tension t:

    W = sum t g,    K^B = sum k g g^T + (second derivative of sum t l),
    K^F = K^B - (second derivative of sum mu l),    sum mu g = W,

mu = t where nothing but the lines acts. Lines are those of
`cartstiff.core.potentials.line_springs`, masses of the legs those of
`cartstiff.core.mechanisms.platform`.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from cartstiff.core import numerics
from cartstiff.core.arrays import Array
from cartstiff.core.geometry import se3
from cartstiff.core.mechanisms.limits import MAX_RELATIVE_DEFLECTION
from cartstiff.core.mechanisms.platform import Struts
from cartstiff.core.potentials.line_springs import lines_of_many, second_derivative
from cartstiff.core.potentials.loads import held_force
from cartstiff.core.stiffness.applied_load import DEAD_AT_ORIGIN, Axes, LoadKind
from cartstiff.recorded.algebra import (
    JACOBIAN_CONDITION,
    LARGEST_ANGLE,
    PLAIN,
    STIFFNESS_CONDITION,
    Judged,
    acting,
    add_compliances,
    connections,
    from_lower,
    given_wrench,
    holds_soft_directions,
    largest,
    limited,
    norm_squared,
    noteworthy,
    off_edge,
    reflections,
    scaled_inverse,
    taut_stiffness,
    upper_inverse,
    zeros,
)
from cartstiff.recorded.arguments import SYMMETRIC
from cartstiff.recorded.tape import Scalar, Tape, absolute, larger, pick

#: Shortest line with the verdict `PLAIN`, as a share of the platform's size;
#: `cartstiff.analyse` reports lines of zero length.
_SHORTEST_LINE = numerics.SHORTEST_LINE
#: Largest product of the condition numbers of lines and stiffness at which a compliance
#: has enough digits, with a margin of one digit.
_MAX_CONDITION_PRODUCT = 0.1 * numerics.LOST_ERROR / numerics.EPSILON


@dataclass(frozen=True)
class PlatformCase:
    """A platform with its springs and loads as plain numbers;
    the key of its recorded programs.

    Attributes
    ----------
    anchors, points : flat (m, 3), in F and in M; empty where `lines` is not 0.
    T_P_M : flat (4, 4).
    length : characteristic length.
    rest : {"given", "kept", "open", "preload"}
        Whether the lines have rest lengths, which a given wrench replaces unless they are
        kept, or these are chosen at each posture, or there follow from the preload.
    is_loaded : as of `cartstiff.recorded.chains.ChainCase`.
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
        Number of lines where anchors, points and length are inputs, so that one program
        serves platforms of every size; else 0.
    load, axes : as of `cartstiff.recorded.chains.ChainCase`.
    is_chosen : bool
        Whether the tensions that balance a load are inputs, see `balances_among`.
    inputs : as of `cartstiff.recorded.chains.ChainCase`.
    """

    anchors: tuple[float, ...]
    points: tuple[float, ...]
    T_P_M: tuple[float, ...]
    length: float
    rest: str = "given"
    is_loaded: bool = False
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
    inputs: tuple[str, ...] = ()
    #: No steps lead to a posture, as those of a `ChainCase` may.
    is_closed: ClassVar[bool] = False
    settled: ClassVar[tuple[int, ...]] = ()

    @property
    def is_forced(self) -> bool:
        """Whether constant forces act."""
        return bool(self.points_of_forces) or "payload" in self.inputs

    @property
    def balances_among(self) -> bool:
        """Whether more than six lines balance a load, so that bounds may choose
        the tensions.

        The program finds the tensions nearest to the given ones. Where these are not
        within the bounds, others are chosen outside of it
        (`cartstiff.core.potentials.tensions`) from its outputs "nearest" and "null" with
        `is_chosen`. They are inputs of the same program: "tensions", below zero for
        cables that stay slack.
        """
        m = self.lines or len(self.points) // 3
        carries = self.derivatives or self.is_forced or self.has_weight
        is_chosen = self.is_loaded or self.rest == "preload"
        return m > 6 and (is_chosen or (self.rest == "open" and carries))


class PlatformNumbers(Judged):
    """A body on lines under a case, recorded: lines, energy of all else, tensions,
    wrench.

    Attributes
    ----------
    T, geometry : ``T_F_M`` (4, 4), and the lines in it.
    length : characteristic length.
    k, cables : stiffnesses (m,) of the lines, and which of them only pull.
    gradient, hessian : of all but the lines.
    energy : of all that acts.
    is_alone : whether nothing but the lines acts.
    decomposition, inverse_R : ``G = Q R`` of six or more lines G (m, 6), and R^-1.
    squared_condition : bound on that of the lines, 0 for fewer than six.
    tensions, taut, W : tensions and stiffnesses (m,) of the lines, zero for slack cables; wrench.
    chosen : outputs from which tensions are chosen outside of the program, if they are.
    verdict : on all of these.
    """  # noqa: E501

    def __init__(self, tape: Tape, case: PlatformCase) -> None:
        self.case = case
        self._measure(tape)
        self._others(tape)
        self._decompose()
        self._pull(tape)

    def _measure(self, tape: Tape) -> None:
        """Set the pose and the lines; begin the verdict."""
        case, q = self.case, tape.vector("q", 6)
        # Anchors and points are constants, or inputs where designs vary them.
        anchors = np.reshape(case.anchors, (-1, 3))
        points = np.reshape(case.points, (-1, 3))
        self.length: Scalar = case.length
        if case.lines:
            anchors = tape.vector("anchors", 3 * case.lines).reshape(-1, 3)
            points = tape.vector("points", 3 * case.lines).reshape(-1, 3)
            self.length = tape.input("length", 0)
        # Pose of the body, and the legs between both.
        self.points, m = points, len(points)
        self.k = tape.vector("stiffness", m)
        self.cables = np.broadcast_to(case.unilateral, m)
        T, T_P_M = zeros(4, 4), np.reshape(case.T_P_M, (4, 4))
        R_P = se3.rotation_by_angles(q[3:])
        T[:3, :3], T[3, 3] = R_P @ T_P_M[:3, :3], 1.0
        T[:3, 3] = R_P @ T_P_M[:3, 3] + q[:3]
        self.T, self.geometry = T, lines_of_many(T, anchors, points)
        # A leg without length has no direction, and large angles lose digits.
        size = _SHORTEST_LINE * larger(largest(anchors), largest(points))
        self.verdict = limited(largest(q[3:]), LARGEST_ANGLE)
        for length in self.geometry.lengths:
            self.require(limited(size, length))

    def _others(self, tape: Tape) -> None:
        """Set energy, gradient and Hessian of all but the lines."""
        case, T = self.case, self.T
        # Potentials that are found in steps come with their derivatives.
        energy: Any = 0.0
        gradient, hessian = zeros(6), zeros(6, 6)
        if case.derivatives:
            energy = tape.input("energies", 0)
            gradient = tape.vector("gradients", 6)
            hessian = from_lower(tape.vector("hessians", 36).reshape(6, 6))
        # Forces that keep their direction in the room, at points of the body.
        points = [(1.0, np.array(point)) for point in case.points_of_forces]
        if "payload" in case.inputs:
            mass, *centre = tape.vector("payload", 4)
            points.append((mass, np.array(centre)))
        forces = tape.vector("forces", 3 * len(points)).reshape(-1, 3)
        for force, (mass, at) in zip(forces, points, strict=True):
            force = force * mass
            in_body = force @ T[:3, :3]
            g, H = held_force(in_body, at)
            energy = energy - in_body @ at - force @ T[:3, 3]
            gradient, hessian = gradient + g, hessian + H
        # Legs carry their own weight along.
        if case.legs is not None and case.has_weight:
            per_kg = tape.vector("weight", 3)
            E, g, H = case.legs.gravity(self.geometry, self.points, T, per_kg)
            energy, gradient, hessian = energy + E, gradient + g, hessian + H
        self.energy, self.gradient, self.hessian = energy, gradient, hessian
        self.is_alone = not (case.derivatives or case.is_forced or case.has_weight)

    def _decompose(self) -> None:
        """Decompose six or more lines; add the verdict on their condition."""
        self.decomposition, self.inverse_R = None, zeros(6, 6)
        self.squared_condition: Scalar = 0.0
        if len(self.k) < 6:
            return
        self.decomposition = reflections(self.geometry.lines)
        R = self.decomposition.R
        inverse = self.inverse_R = upper_inverse(R)
        forward = norm_squared(R[:, :3]) + norm_squared(R[:, 3:] * self.length)
        backward = norm_squared(inverse[:3]) + norm_squared(
            inverse[3:] * (1.0 / self.length)
        )
        self.squared_condition = forward * backward
        limit = limited(self.squared_condition, JACOBIAN_CONDITION**2)
        self.require(limit)

    def _pull(self, tape: Tape) -> None:
        """Set tensions and wrench, add their energy, and the verdict on bounds of
        the tensions.
        """
        case, k, m, lines = self.case, self.k, len(self.k), self.geometry.lines
        given, stretch = zeros(m), zeros(m)
        self.taut, self.chosen = k, dict[str, Array]()
        W = given_wrench(tape, case, lambda: self.T)
        if case.rest == "preload":
            given = tape.vector("preload", m)
        elif case.rest in ("given", "kept"):
            stretch = self.geometry.lengths - tape.vector("rest", m)
            given = k * stretch
        holds = case.rest == "preload" and m <= 6  # else the lines balance one another
        balances = case.rest == "preload" and not holds
        if case.rest == "kept":
            W = None
        if W is not None or balances or (case.rest == "open" and not self.is_alone):
            self.W = zeros(6) if W is None else W
            asked = -self.gradient if W is None else W - self.gradient
            t = self._balancing(tape, asked, given)
            self.energy = self.energy + ((t * t / k).sum()) * 0.5
        elif case.rest == "open":
            t, self.W = zeros(m), zeros(6)
        else:
            t = given
            if holds:
                self.energy = self.energy + ((t * t / k).sum()) * 0.5
            else:
                self.taut = _taut(k, stretch, self.cables)
                for i in np.flatnonzero(self.cables).tolist():
                    self.require(off_edge(self.geometry.lengths[i], stretch[i]))
                t = self.taut * stretch
                self.energy = self.energy + (t @ stretch) * 0.5
            self.W = t @ lines + self.gradient
        self.tensions = t

    def _balancing(self, tape: Tape, asked: Array, given: Array) -> Array:
        """Tensions (m,) nearest to the given ones that exert a wrench, or chosen ones."""
        m, cables = len(self.k), self.cables
        assert self.decomposition is not None  # else it has no plan
        if m <= 6:
            given = zeros(m)
        elif self.case.rest == "given":
            given = _tensions(given, cables)
        missing, added = asked - self.geometry.lines.T @ given, zeros(m)
        added[:6] = self.inverse_R.T @ missing
        t = given + self.decomposition.apply(added)
        if not self.case.is_chosen:
            bounds = _bounds_hold(tape, self.case, t, cables)
            self.require(bounds)
            return t
        others = self.decomposition.apply(np.eye(m)[:, 6:])
        self.chosen = {"nearest": t, "null": others}
        chosen = tape.vector("tensions", m)
        t = _tensions(chosen, cables)
        self.taut = _taut(self.k, chosen, cables)
        return t

    def turning(self, tensions: Array) -> Array:
        """Second derivative (6, 6) of the lines' lengths times their tensions."""
        return second_derivative(self.geometry, self.points, tensions)

    def kinetic(self) -> Array:
        """Mass matrix (6, 6) of the body with its legs."""
        M = np.reshape(self.case.inertia, (6, 6)).astype(object)
        if self.case.legs is not None:
            M = M + self.case.legs.mass_matrix(self.geometry, self.points)
        return M


def platform_arrays(
    tape: Tape, case: PlatformCase, wanted: Collection[str]
) -> dict[str, Array]:
    """Outputs that exist, among them all that are wanted,
    and the "verdict" on the posture.
    """
    body = PlatformNumbers(tape, case)
    lengths, _, lines = body.geometry
    t, W = body.tensions, body.W
    arrays: dict[str, Array] = {
        "actuation": lines,
        "leg_lengths": np.array(lengths),
        **body.chosen,
    }
    pulled = (lines.T * body.taut) @ lines
    K_B = pulled + body.turning(t) + body.hessian
    stiffness = connections(K_B, W, acting(tape, case))
    if len(t) == 6 and body.decomposition is not None:
        arrays["jacobian"] = body.decomposition.apply(body.inverse_R.T).T
        stiffness["F"] = pulled
        if not body.is_alone:
            stiffness["F"] = K_B - body.turning(arrays["jacobian"].T @ W)
    energy = np.array([body.energy], object)
    arrays.update(pose=body.T, wrench=W, energy=energy, tensions=t)
    arrays.update({f"stiffness_{name}": K for name, K in stiffness.items()})
    if case.inertia:
        arrays |= {"kinetic": body.kinetic(), "lagrangian": K_B, "motion": np.eye(6)}
    condition = add_compliances(arrays, stiffness, wanted, body.length)
    if SYMMETRIC in wanted:
        middle = (stiffness["load"] + stiffness["load"].T) * 0.5
        arrays[SYMMETRIC], own = scaled_inverse(middle, body.length)
        condition = larger(condition, own)
    verdict = larger(body.verdict, limited(condition, STIFFNESS_CONDITION**2))
    # Near type 2 the forces of actuators, and their part of the stiffness, are less
    # accurate.
    product = condition * body.squared_condition
    verdict = larger(verdict, limited(product, _MAX_CONDITION_PRODUCT**2))
    verdict = larger(verdict, holds_soft_directions(K_B, wanted))
    arrays["verdict"] = np.array([verdict], object)
    is_known = body.decomposition is not None and "compliance_B" in arrays
    if "noteworthy" in wanted and is_known:
        pair = K_B, arrays["compliance_B"]
        found = noteworthy(body.squared_condition, stiffness["load"], pair)
        doubt = largest(t / body.k / lengths) * (1.0 / MAX_RELATIVE_DEFLECTION)
        arrays["noteworthy"] = np.array([*found, doubt, 1.0], object)
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
            verdict = larger(verdict, limited(t[i], most))
    for i in range(m) if m > 6 else np.flatnonzero(cables).tolist():
        verdict = larger(verdict, limited(least[i], t[i]))
    return verdict
