r"""Stiffness and compliance of a serial chain on recorded numbers,
for any number of joints.

The twists J_C of the joints are in the frame C of a joint. For six coordinates C is in
the middle of the chain: the axes beside it are constant, the next ones depend on one
angle each, and the outermost on half of the angles, so that many entries of J_C are zero
at every posture and are not computed. Otherwise C is the body frame M. In coordinates of
one kind, with L[a, b] = W . [J_a, J_b] for joint a after joint b, else 0, which does not
depend on the frame, and with H_L = H - S_W, S_W = -1/2 (L + L^T),

    n = 6:  J_C A = Ad(T_C_M),  W = A^T g,  K^F = A^T H A,  K^B = K^F + A^T L A - 1/2
    Omega n > 6:  J^T = Q R,  Q^T H_L Q = [[a, b], [b^T, c]],
            K^B = R^-1 (a - b c^-1 b^T) R^-T,  W = R^-1 (Q^T g)_6
    n < 6:  J = Q R with lengths scaled,  W = Q R^-T g
    any n:  C^B = J H_L^-1 J^T

which is the reduction of `cartstiff.core.stiffness.reduction` without its singular value
decomposition.

Line springs and cables between bodies of a chain: with u the direction of a line of
length l, D_a the velocity of its end b less that of its end a per rate of joint a, and t
the tension,

    dl/dq_a = u . D_a, d2l/dq_a dq_b = (D_a . D_b - (u . D_a) (u . D_b)) / l + (u x
    omega_a) . D_b, b after a.

Joints that move both ends do not change the line. A slack cable has neither tension nor
stiffness.

Mass matrix of a chain or a tree: with m, h and I the mass, first and second moment about
the origin of C of all bodies that joint b carries, b being a or after a,

    M_ab = omega_a . (I omega_b + h x v_b) + v_a . (m v_b - h x omega_b).

Gravity and dead forces: with m and m c the mass and first moment of the bodies that joint
b carries and S_b = omega_b x m c + m v_b,

    dPhi/dq_b = -g . S_b,     d2Phi/dq_a dq_b = -(g x omega_a) . S_b, b not before a.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from cartstiff.core import numerics
from cartstiff.core.arrays import Array
from cartstiff.core.matrix_names import OF_MANY
from cartstiff.core.mechanisms.limits import MAX_WIND_UP
from cartstiff.core.mechanisms.tree import KinematicTree
from cartstiff.core.numerics import BALANCE_TOLERANCE, ROUNDOFF
from cartstiff.core.potentials.spring_laws import PolynomialLaw, TabulatedLaw
from cartstiff.core.potentials.springs import SpringLaw
from cartstiff.core.stiffness.applied_load import DEAD_AT_ORIGIN, Axes, LoadKind
from cartstiff.recorded.algebra import (
    FALLBACK,
    FROM_B_TO_A,
    JACOBIAN_CONDITION,
    LARGEST_ANGLE,
    PLAIN,
    STIFFNESS_CONDITION,
    UNBALANCED,
    Judged,
    acting,
    below,
    changed_compliance,
    congruence,
    connections,
    cross,
    equilibrated_squares,
    from_lower,
    given_wrench,
    holds_soft_directions,
    is_zero,
    largest,
    limited,
    norm_squared,
    noteworthy,
    off_edge,
    positive_factor,
    positive_inverse,
    reflections,
    require_pivots,
    scaled_inverse,
    solution,
    symmetric_product,
    taut_stiffness,
    upper_inverse,
    vanishes,
    zeros,
)
from cartstiff.recorded.arguments import SYMMETRIC
from cartstiff.recorded.tape import Scalar, Tape, absolute, larger, pick, square_root
from cartstiff.recorded.twists import (
    NOTHING_VARIED,
    ForceField,
    Kinematics,
    TreeConstants,
    Varied,
    VariedNumbers,
    numbers,
)

#: Largest number of points of a recorded table: each piece is a choice of six numbers.
_MAX_TABLE_POINTS = 33
#: Number of Newton steps for a deflection, and largest relative change by the last of
#: them.
_NEWTON_STEPS, _MAX_LAST_CHANGE = 8, numerics.ROUNDOFF_OF_SUMS**0.5
#: Largest deflection, as a share of that at which a polynomial law no longer rises.
_MAX_RISING_SHARE = 0.99


def is_recorded(law: SpringLaw, is_open: bool = False) -> bool:
    """Whether a law can be recorded; `is_open` if the rest position follows from a
    torque.
    """
    kind = _LAWS.get(type(law))
    if kind is None or (is_open and not kind.has_root(law)):
        return False
    return len(kind.knots(law)) <= _MAX_TABLE_POINTS


def stretched(law: SpringLaw, x: Scalar) -> tuple[Scalar, Scalar, Scalar]:
    """Energy, torque and tangent stiffness at a deflection."""
    return _LAWS[type(law)].evaluate(law, x)


def deflection_for(law: SpringLaw, torque: Scalar) -> tuple[Scalar, Scalar]:
    """Deflection that carries a torque, and the verdict on it.

    For a polynomial it is the root of smallest size, within the part that rises through
    zero.
    """
    return _LAWS[type(law)].deflection(law, torque)


def _in_polynomial(law: PolynomialLaw, torque: Scalar) -> tuple[Scalar, Scalar]:
    c = np.array(law.coefficients, float)
    turning = np.polynomial.polynomial.Polynomial(c * np.arange(1, len(c) + 1)).roots()
    real = np.abs(
        turning[
            np.abs(turning.imag)
            <= numerics.NEGLIGIBLE_DIFFERENCE * (1.0 + np.abs(turning))
        ]
    )
    x, verdict = _found(law, torque, torque * (1.0 / c[0]) if c[0] else np.nan)
    if real.size:
        verdict = larger(
            verdict,
            limited(absolute(x), _MAX_RISING_SHARE * float(real.min())),
        )
    return x, verdict


def _away_from_corners(law: SpringLaw, x: Scalar) -> Scalar:
    """Verdict on a deflection: at a corner of a table the stiffness has two values."""
    verdict: Scalar = PLAIN
    for corner in law.corners:
        far = absolute(x - corner.deflection)
        verdict = larger(verdict, pick(far, 2.0 * law.corner_width, FALLBACK, PLAIN))
    return verdict


def _piece(law: TabulatedLaw, x: Scalar, knots: tuple[float, ...]) -> list[Scalar]:
    """Coefficients of the piece in which x lies.

    `knots` are the ascending ends of the pieces.
    """
    rows = law._rows.tolist()
    found: list[Scalar] = list(rows[-1])
    for row, knot in reversed(list(zip(rows[:-1], knots, strict=True))):
        found = [
            pick(x, knot, here, behind) for here, behind in zip(row, found, strict=True)
        ]
    return found


def _rises(law: TabulatedLaw) -> bool:
    slopes = np.append(np.diff(law.torques), law._rows[[0, -1], 3])
    return bool((slopes > 0.0).all())


def _in_table(law: TabulatedLaw, torque: Scalar) -> tuple[Scalar, Scalar]:
    y = np.array(law.torques)
    start, verdict = _piece(law, torque, law.torques), PLAIN
    # Solve the cubic of that piece, starting from the straight line through its ends.
    secants = np.diff(y) / np.diff(law.deflections)
    slopes = [law._rows[0, 3], *secants.tolist(), law._rows[-1, 3]]
    slope: Scalar = slopes[-1]
    for own, knot in reversed(list(zip(slopes[:-1], law.torques, strict=True))):
        slope = pick(torque, knot, own, slope)
    knot, _, at_knot, *rest = start
    d = (torque - at_knot) / slope
    step: Scalar = 0.0
    for _ in range(_NEWTON_STEPS):
        value = d * (rest[0] + d * (rest[1] + d * rest[2]))
        step = (torque - at_knot - value) / (
            rest[0] + d * (2.0 * rest[1] + 3.0 * d * rest[2])
        )
        d = d + step
    return knot + d, larger(verdict, _converged(step, absolute(d)))


def _on_table(law: TabulatedLaw, x: Scalar) -> tuple[Scalar, Scalar, Scalar]:
    return law.on_piece(_piece(law, x, law.deflections), x)


def _found(law: SpringLaw, torque: Scalar, x: Scalar) -> tuple[Scalar, Scalar]:
    """Deflection after Newton steps from x, and the verdict on it."""
    step: Scalar = 0.0
    for _ in range(_NEWTON_STEPS):
        _, own, stiffness = stretched(law, x)
        step = (torque - own) / stiffness
        x = x + step
    return x, _converged(step, absolute(x))


def _converged(step: Scalar, size: Scalar) -> Scalar:
    """Verdict on the last Newton step: the remaining relative error is its square."""
    return limited(absolute(step), size * _MAX_LAST_CHANGE + numerics.TINY)


class _Law(NamedTuple):
    """How a kind of law is recorded: its knots, whether there is a `deflection_for` any
    torque, `stretched`, and that.
    """

    knots: Callable[[Any], Sequence[float]]
    has_root: Callable[[Any], bool]
    evaluate: Callable[[Any, Scalar], tuple[Scalar, Scalar, Scalar]]
    deflection: Callable[[Any, Scalar], tuple[Scalar, Scalar]]


_LAWS: dict[type, _Law] = {
    TabulatedLaw: _Law(lambda law: law.deflections, _rises, _on_table, _in_table),
    PolynomialLaw: _Law(
        lambda _: (), lambda _: True, PolynomialLaw.evaluate, _in_polynomial
    ),
}


class JointSpringNumbers(Judged):
    """Linear and nonlinear springs of the coordinates, recorded.

    Attributes
    ----------
    verdict : on the deflections.
    deflections, torques : those of the coordinates asked for.
    """

    def __init__(self, tape: Tape, n: int, laws: Sequence[tuple[int, SpringLaw]]) -> None:
        self._stiffness, self._rest = tape.vector("stiffness", n), tape.vector("rest", n)
        self._laws = dict(laws)
        self.deflections: dict[int, Scalar] = {}
        self.torques: dict[int, Scalar] = {}

    def at(self, a: int, q: Scalar) -> tuple[Scalar, Scalar, Scalar]:
        """Energy, torque and stiffness of a spring with a given rest position."""
        self.deflections[a] = stretch = q - self._rest[a]
        if a in self._laws:
            self.require(_away_from_corners(self._laws[a], stretch))
            energy, torque, k = stretched(self._laws[a], stretch)
        else:
            k = self._stiffness[a]
            energy, torque = k * stretch * stretch * 0.5, k * stretch
        self.torques[a] = torque
        return energy, torque, k

    def under(self, a: int, torque: Scalar) -> tuple[Scalar, Scalar]:
        """Energy and stiffness of a spring whose rest position makes it
        exert a torque.
        """
        self.torques[a] = torque
        if a not in self._laws:
            k = self._stiffness[a]
            self.deflections[a] = x = torque / k
            return torque * x * 0.5, k
        self.deflections[a], verdict = deflection_for(self._laws[a], torque)
        doubt = _away_from_corners(self._laws[a], self.deflections[a])
        self.require(larger(verdict, doubt))
        energy, _, k = stretched(self._laws[a], self.deflections[a])
        return energy, k

    def wind_up(self, is_length: Sequence[bool]) -> Scalar:
        """Sum of the deflections of turning coordinates, as a share of `MAX_WIND_UP`."""
        turned = [absolute(x) for a, x in self.deflections.items() if not is_length[a]]
        return sum(turned[1:], turned[0]) * (1.0 / MAX_WIND_UP) if turned else 0.0

    def strained(self, efforts: Iterable[tuple[int, float, float]]) -> Scalar:
        """At least 1 where the torque of a drive on its link is beyond its limits."""
        worst: Scalar = 0.0
        for a, least, most in efforts:
            sizes = [abs(x) for x in (least, most) if math.isfinite(x)]
            if least > most:  # not known here
                return 1.0
            for limit, side in ((least, 1.0), (most, -1.0)):
                if math.isfinite(limit):
                    beyond = (self.torques[a] * side + limit * side) / (max(sizes) or 1.0)
                    worst = larger(worst, beyond + 1.0)
        return worst


@dataclass(frozen=True)
class Line:
    """Attachment of a line spring.

    Attributes
    ----------
    joints : joints that carry its ends a and b, counted from 1; 0 is F.
    points : its ends in the frames of these joints (2, 3).
    unilateral : whether it goes slack instead of pushing.
    """

    joints: tuple[int, int]
    points: tuple[tuple[float, ...], tuple[float, ...]]
    unilateral: bool


def line_terms(
    line: Line, stiffness: Scalar, rest: Scalar, kinematics: Any
) -> tuple[Scalar, Array, Array, Scalar]:
    """Energy, gradient and Hessian in the joint positions,
    and the verdict on the length.
    """
    J, outward = kinematics.J, kinematics.outward
    # Ends, length and tension.
    ends: list[Array] = []
    for joint, point in zip(line.joints, line.points, strict=True):
        R, p = kinematics.R_C_F, kinematics.p_C_F
        if joint:
            R, p = kinematics.behind(joint - 1)
        ends.append(R @ np.array(point) + p)
    along = ends[1] - ends[0]
    length = square_root(norm_squared(along))
    u = along * (1.0 / length)
    stretch = length - rest
    taut = taut_stiffness(stiffness, stretch) if line.unilateral else stiffness
    tension = taut * stretch
    per_length = tension / length

    # Velocity D_a of the far end against the near one, for joints that move one of them.
    speeds: dict[int, Array] = {}
    for a, behind in enumerate(outward):
        moves = [bool(joint) and joint - 1 in behind for joint in line.joints]
        if moves[0] != moves[1]:
            speed = cross(J[:3, a], ends[moves[1]]) + J[3:, a]
            speeds[a] = speed if moves[1] else -speed
    rates: dict[int, Any] = {a: u @ speed for a, speed in speeds.items()}
    across = {a: cross(u, J[:3, a]) * tension for a in speeds}
    gradient, hessian = zeros(len(outward)), zeros(len(outward), len(outward))
    for a, D_a in speeds.items():
        gradient[a] = rates[a] * tension
        for b in (b for b in speeds if b >= a):
            D_b = speeds[b]
            entry = (rates[a] * rates[b]) * (taut - per_length) + (D_a @ D_b) * per_length
            if b in outward[a]:
                entry = entry + across[a] @ D_b
            hessian[a, b] = hessian[b, a] = entry
    # Lines shorter than a share of the chain have no direction.
    least = numerics.SHORTEST_LINE * kinematics.size
    size = (
        larger(norm_squared(ends[0]), norm_squared(ends[1])) * numerics.SHORTEST_LINE**2
    )
    verdict = limited(larger(size, least * least), length * length)
    if line.unilateral:
        verdict = larger(verdict, off_edge(length, stretch))
    return tension * stretch * 0.5, gradient, hessian, verdict


@dataclass(frozen=True)
class Bodies:
    """Inertias of the joints' bodies as plain numbers, hashable.

    Attributes
    ----------
    masses : mass of each joint's body.
    centres : mass centres in the joints' frames (joints, 3), flat.
    moments : moments of inertia about the centres (joints, 3, 3), flat.
    armatures : inertia of each joint's rotor.
    """

    masses: tuple[float, ...]
    centres: tuple[float, ...]
    moments: tuple[float, ...]
    armatures: tuple[float, ...]

    @staticmethod
    def of(tree: KinematicTree) -> Bodies:
        """Inertias of a tree, in kg and its unit of length."""
        masses, centres = tree.masses()
        moments = np.array([body.inertia for body in list(tree.model.inertias)[1:]])
        return Bodies(
            *map(numbers, (masses, centres, moments, np.array(tree.model.armature)))
        )


def kinetic(bodies: Bodies, kinematics: Kinematics) -> Array:
    """Mass matrix (joints, joints) in the joint positions."""
    J, joints = kinematics.J, kinematics.J.shape[1]
    centres = np.reshape(bodies.centres, (joints, 3))
    moments = np.reshape(bodies.moments, (joints, 3, 3))
    masses = np.array(bodies.masses, object)
    if kinematics.varied.masses is not None:
        masses = kinematics.varied.masses
    # First and second moments about the origin of C, of each body and then of all it
    # carries.
    first, second = zeros(joints, 3), zeros(joints, 3, 3)
    for j, own in enumerate(masses):
        if not is_zero(own) or moments[j].any():
            R, p = kinematics.behind(j)
            c = R @ centres[j] + p
            first[j] = c * own
            second[j] = (
                congruence(R.T, moments[j]) + (np.eye(3) * (c @ c) - np.outer(c, c)) * own
            )
    mass, first, second = map(kinematics.carried, (masses, first, second))
    # M_ab of the module's formula, for joints of which one carries the other.
    M = zeros(joints, joints)
    for b in range(joints):
        turn, shift = J[:3, b], J[3:, b]
        if vanishes([mass[b], *second[b].flat]):
            continue
        moment = second[b] @ turn + cross(first[b], shift)
        force = shift * mass[b] - cross(first[b], turn)
        for a in (a for a, behind in enumerate(kinematics.outward) if b in behind):
            M[a, b] = M[b, a] = J[:3, a] @ moment + J[3:, a] @ force
    for a, armature in enumerate(bodies.armatures):
        M[a, a] = M[a, a] + armature
    return M


#: Coordinates that a spring couples, and its matrix, flat.
LinkSpring = tuple[tuple[int, ...], tuple[float, ...]]
#: Characteristic length, as a share of the chain's size, below which all axes meet in a
#: point and `cartstiff.analyse` must choose the length.
_LEAST_LENGTH_SHARE = numerics.NEGLIGIBLE_DISTANCE


@dataclass(frozen=True)
class ChainCase:
    """A chain, open or closed, with its springs and loads;
    the key of its recorded programs.

    Attributes
    ----------
    constants : TreeConstants
    is_loaded : bool
        Whether a wrench is given for each posture.
    springs : tuple of int
        Coordinates with a spring of their own.
    chosen : tuple of int
        Those of them whose rest position is chosen at each posture.
    is_balancing : bool
        Whether rest positions are chosen so that the springs carry all loads; else the
        given ones determine the wrench.
    fields : tuple of ForceField
    stretched : tuple of Line
        Line springs and cables with known rest lengths.
    coupled : tuple of (indices, flat matrix)
        Springs over several coordinates.
    still : tuple of (indices, flat matrix)
        Coordinates that must be zero, and the Hessian of their springs there.
    derivatives : bool
        Whether energy, gradient and Hessian of further potentials are input arrays.
    segments : tuple of tuples of int
        Coordinates of beam segments, whose derivatives are input arrays for each segment.
    settled : tuple of int
        Coordinates without springs of their own, which are first deflected to rest under
        the wrench (`cartstiff.recorded.closed_chains.settling_arrays`).
    singular : bool
        Whether the program is for postures that have lost rank and uses no inverse
        Jacobian.
    laws : tuple of (int, SpringLaw)
        Nonlinear springs of coordinates.
    efforts : tuple of (int, float, float)
        Least and largest torque of drives of coordinates on the links that they move; the
        first is the larger one where the torque is not recorded.
    bodies : Bodies, optional
        All masses, for vibrations.
    rigid : tuple of int
        Coordinates that do not move under any load.
    load : LoadKind
        Behaviour of the load while the body moves, and the point of application of the
        wrench.
    axes : {"body", "world"}
        Axes of the wrench's components: those of M or of F.
    varied : Varied
        Numbers of the geometry that are inputs.
    has_chart : bool
        Whether the coordinates, of a closed chain the independent ones, are the chart of
        K^F.
    held, independent, rows, shut, length, is_driven
        Of a closed chain: coordinates that are fixed while it is closed, besides the
        rigid ones; coordinates I, as many as there are motions, or none; of each closure,
        the rows of its twist (0 to 5) that make all closures independent, and the same
        while `held` is fixed; characteristic length at one posture, for scaling; whether
        I are the actuated coordinates.
    inputs : those of `algebra.CASE_INPUTS` that are inputs. The force on a payload of one
        unit of mass is then the last of "forces".
    """

    constants: TreeConstants
    is_loaded: bool = False
    springs: tuple[int, ...] = ()
    chosen: tuple[int, ...] = ()
    is_balancing: bool = False
    fields: tuple[ForceField, ...] = ()
    stretched: tuple[Line, ...] = ()
    coupled: tuple[LinkSpring, ...] = ()
    still: tuple[LinkSpring, ...] = ()
    derivatives: bool = False
    segments: tuple[tuple[int, ...], ...] = ()
    settled: tuple[int, ...] = ()
    singular: bool = False
    laws: tuple[tuple[int, SpringLaw], ...] = ()
    efforts: tuple[tuple[int, float, float], ...] = ()
    bodies: Bodies | None = None
    rigid: tuple[int, ...] = ()
    load: LoadKind = DEAD_AT_ORIGIN
    axes: Axes = "body"
    has_chart: bool = False
    held: tuple[int, ...] = ()
    independent: tuple[int, ...] = ()
    rows: tuple[tuple[int, ...], ...] = ()
    shut: tuple[tuple[int, ...], ...] = ()
    length: float = 1.0
    is_driven: bool = False
    varied: Varied = NOTHING_VARIED
    inputs: tuple[str, ...] = ()

    @property
    def is_closed(self) -> bool:
        """Whether it is a closed chain."""
        return bool(self.constants.ties)

    @property
    def moving(self) -> list[int]:
        """Coordinates that are not rigid."""
        return [a for a in range(len(self.constants.is_length)) if a not in self.rigid]

    @property
    def freedoms(self) -> int:
        """Number of motions, which keep the closures."""
        return len(self.moving) - sum(map(len, self.rows))

    @property
    def names(self) -> list[int]:
        """Coordinates that name the motions; none where these are orthonormal."""
        return list(self.independent) if self.is_closed else self.moving

    @property
    def dependent(self) -> list[int]:
        """Coordinates D of a closed chain."""
        return [j for j in self.moving if j not in self.independent]

    @property
    def ways(self) -> tuple[ChainCase, ...]:
        """Cases whose steps are tried one after the other to close the chain.

        Where more coordinates are held than there are motions, few postures can be
        closed: the second case holds none.
        """
        if len(self.held) <= self.freedoms:
            return (self,)
        return self, replace(self, held=(), shut=self.rows)


def _field_terms(
    force: Array, kinematics: Kinematics, beyond: tuple[Array, Array]
) -> tuple[Scalar, Array, Array]:
    """Energy, gradient and Hessian in the joint positions."""
    mass, first = beyond
    J, joints = kinematics.J, kinematics.J.shape[1]
    g = kinematics.R_C_F @ force
    energy = -sum(g @ (first[a] - kinematics.p_C_F * mass[a]) for a in kinematics.roots)
    gradient, hessian = zeros(joints), zeros(joints, joints)
    S = [cross(J[:3, b], first[b]) + J[3:, b] * mass[b] for b in range(joints)]
    for a in range(joints):
        gradient[a] = -(g @ S[a])
        across = cross(g, J[:3, a])
        for b in kinematics.outward[a]:
            hessian[a, b] = hessian[b, a] = -(across @ S[b])
    return energy, gradient, hessian


def against(twist: Array, W: Array) -> Array:
    """Vector whose product with any twist X is ``-W . [twist, X]``."""
    turn, shift = twist[:3], twist[3:]
    return np.concatenate([cross(turn, W[:3]) + cross(shift, W[3:]), cross(turn, W[3:])])


def curvature_of(J: Array, W: Array) -> Array:
    """``S[a, b] = 1/2 W . [J_a, J_b]`` for a before b, symmetric."""
    joints = J.shape[1]
    S = zeros(joints, joints)
    half = W * 0.5
    # The twist of a pair with more zeros makes the row, which then has zeros, too.
    order = sorted(range(joints), key=lambda a: sum(not is_zero(x) for x in J[:, a]))
    for i, b in enumerate(order):
        row = against(J[:, b], half)
        for a in order[i + 1 :]:
            S[a, b] = S[b, a] = J[:, a] @ (row if a < b else -row)
    return S


def joint_positions(
    tape: Tape, constants: TreeConstants
) -> tuple[Array, Array | None, Array]:
    """Coordinates, the matrix by which joints follow them if any does,
    and joint positions.
    """
    n = len(constants.is_length)
    q = tape.vector("q", n)
    if constants.mimic is None:
        return q, None, q
    mimic = np.reshape(constants.mimic, (-1, n))
    offset = np.zeros(len(mimic)) if constants.offset is None else constants.offset
    return q, mimic, mimic @ q + np.asarray(offset, object)


def recorded_tree(
    tape: Tape, case: ChainCase, position: Array, start: int = 0
) -> Kinematics:
    """The tree of a case, with the inputs of `Varied`."""
    varied = VariedNumbers.of(tape, case.varied, len(case.constants.parents))
    if "tcp" in case.inputs:
        varied = varied._replace(tool=tape.vector("tcp", 6))
    return Kinematics(case.constants, position, case.fields, start, varied)


class ChainNumbers(Judged):
    """A chain under a case, recorded: twists, energy, scales, the Lagrangian Hessian.

    Attributes
    ----------
    J_q, J : twists of M per rate of the coordinates (6, n), and of the motions.
    N : rates of the coordinates in the motions x, ``dq = N dx``.
    rates : those of the joints; None where the motions are the joints'.
    gradient, hessian : on the motions.
    deflection, strain : at least 1 where `mechanisms.limits.deflection_notes`, or
        `stiffness.forces.force_notes`, may have a note.
    """

    def __init__(self, tape: Tape, case: ChainCase, start: int = 0) -> None:
        constants = case.constants
        self.case, self.n, self.has_chart = case, case.freedoms, case.has_chart
        self.q, self.mimic, self.position = joint_positions(tape, constants)
        self.kinematics = recorded_tree(tape, case, self.position, start)
        J_M = self.kinematics.J_M
        self.J_q = J_M if self.mimic is None else J_M @ self.mimic
        self.N: Array = self._motions()
        self.rates: Array | None = self.N if self.mimic is None else self.mimic @ self.N
        if np.array_equal(self.rates, np.eye(len(self.position))):
            self.rates = None
        self.J = self.J_q @ self.N
        self.W = given_wrench(tape, case, self.kinematics.pose)
        self.acting = acting(tape, case)
        self._lagrangian: tuple[Array, Array] | None = None
        self._measure()
        self._evaluate(tape)

    def _motions(self) -> Array:
        """N; adds the verdict on it."""
        return np.eye(len(self.q))[:, self.case.moving]

    def _others(self, tape: Tape) -> tuple[Any, Array, Array]:
        """Energy, gradient and Hessian of all terms but the coordinates' springs."""
        case, n = self.case, len(self.q)
        energy: Any = 0.0
        gradient, hessian = zeros(n), zeros(n, n)
        if case.derivatives or case.segments:
            energy = tape.input("energies", 0)
        if case.derivatives:
            gradient = tape.vector("gradients", n)
            hessian = from_lower(tape.vector("hessians", n * n).reshape(n, n))
        # Segments of beams, whose derivatives are inputs.
        own = tape.vector("segment_gradients", 6 * len(case.segments)).reshape(-1, 6)
        each = tape.vector("segment_hessians", 36 * len(case.segments)).reshape(-1, 6, 6)
        for indices, g, H in zip(map(list, case.segments), own, each, strict=True):
            gradient[indices] = gradient[indices] + g
            hessian[np.ix_(indices, indices)] = hessian[
                np.ix_(indices, indices)
            ] + from_lower(H)
        # Forces and lines, from joint positions to coordinates.
        for E, g, H in self._on_bodies(tape):
            if (M := self.mimic) is not None:
                g, H = M.T @ g, congruence(M, H)
            energy, gradient, hessian = energy + E, gradient + g, hessian + H
        # Compliant links.
        for at, matrix in self._link_springs()[: len(case.coupled)]:
            force = matrix @ self.q[at]
            energy = energy + (force @ self.q[at]) * 0.5
            gradient[at] = gradient[at] + force
            hessian[np.ix_(at, at)] = hessian[np.ix_(at, at)] + matrix
        return energy, gradient, hessian

    def _link_springs(self) -> list[tuple[list[int], Array]]:
        """Coordinates and stiffness of springs of links, coupled before still ones."""
        springs = (*self.case.coupled, *self.case.still)
        found = [(list(at), np.reshape(flat, (len(at), -1))) for at, flat in springs]
        factors = self.kinematics.varied.factors
        if factors is not None and len(factors):
            each = zip(found, factors[[*self.case.varied.factors]], strict=True)
            return [(at, matrix * factor) for (at, matrix), factor in each]
        return found

    def _on_bodies(self, tape: Tape) -> Iterator[tuple[Scalar, Array, Array]]:
        """Energy, gradient and Hessian in the joint positions of each force
        and each line.
        """
        case = self.case
        all_beyond = list(self.kinematics.beyond)
        if "payload" in case.inputs:
            mass, *centre = tape.vector("payload", 4)
            all_beyond.append(self.kinematics.hung(mass, np.array(centre)))
        forces = tape.vector("forces", 3 * len(all_beyond)).reshape(-1, 3)
        for force, beyond in zip(forces, all_beyond, strict=True):
            yield _field_terms(force, self.kinematics, beyond)
        lines = tape.vector("lines", 2 * len(case.stretched)).reshape(-1, 2)
        for line, (stiffness, rest) in zip(case.stretched, lines, strict=True):
            E, g, H, doubt = line_terms(line, stiffness, rest, self.kinematics)
            self.require(doubt)
            yield E, g, H

    def _evaluate(self, tape: Tape) -> None:
        """Energy, gradient and Hessian of all terms, open rest positions
        balancing the load.
        """
        case, chosen = self.case, list(self.case.chosen)
        energy, gradient, hessian = self._others(tape)
        for at, matrix in self._link_springs()[len(case.coupled) :]:
            hessian[np.ix_(at, at)] = matrix
        springs = JointSpringNumbers(tape, len(self.q), case.laws)
        for a in (a for a in case.springs if a not in chosen):
            own, torque, stiffness = springs.at(a, self.q[a])
            gradient[a] = gradient[a] + torque
            energy, hessian[a, a] = energy + own, hessian[a, a] + stiffness
        for a, torque in zip(chosen, self._torques(chosen, gradient), strict=True):
            own, stiffness = springs.under(a, torque - gradient[a])
            energy, hessian[a, a] = energy + own, hessian[a, a] + stiffness
            gradient[a] = torque
        #: What the drives exert on the links that they move (n,).
        self.torques = zeros(len(self.q))
        for a, torque in springs.torques.items():
            self.torques[a] = -torque
        self.require(springs.verdict)
        # The deflection of a tip on slides is not bounded by that of its joints.
        is_length = case.constants.is_length
        on_slides = bool(case.springs) and any(is_length) and not case.is_closed
        self.deflection: Scalar = 1.0 if on_slides else springs.wind_up(is_length)
        self.strain = springs.strained(case.efforts)
        self.energy, self._of_coordinates = energy, (gradient, hessian)
        self.gradient = self.N.T @ gradient
        self.hessian = congruence(self.N, hessian + self._turning(-gradient))

    def _torques(self, chosen: list[int], gradient: Array) -> Array:
        """Torques (c,) of the springs that balance the load beside all other terms."""
        if not chosen:
            return zeros(0)
        others = [a for a in range(len(self.q)) if a not in chosen]
        wanted = -(self.N[others].T @ gradient[others])
        if self.W is not None:
            wanted = wanted + self.J.T @ self.W
        return self._shared(chosen, wanted)

    def _shared(self, chosen: list[int], wanted: Array) -> Array:
        """Torques (c,) from those along the motions, of which the others are in
        equilibrium.
        """
        return wanted[[self.case.names.index(a) for a in chosen]]

    def _turning(self, right: Array) -> Array:  # noqa: ARG002
        """Curvature (n, n) of closures whose forces balance forces (n,);
        zero without closures.
        """
        return zeros(len(self.q), len(self.q))

    def _measure(self) -> None:
        """Set the characteristic length and natural sizes of the motions;
        add the verdict on it.
        """
        case, way = self.case, self.case.constants.support(self.case.constants.carrier)
        J, turning = self.J_q, list[Scalar]()
        if self.mimic is None:  # axes are unit vectors
            J = J[:, way]
            turning = [1.0 if self.kinematics.links.turning[j] else 0.0 for j in way]
        else:
            turning = [norm_squared(column) for column in J[:3].T]
        total = sum(turning[1:], turning[0])
        self.length: Any = 1.0
        self.area: Scalar = 1.0
        if not is_zero(total):
            moments = [
                norm_squared(J[3:, a])
                for a, turns in enumerate(turning)
                if not is_zero(turns)
            ]
            area = sum(moments[1:], moments[0]) / total
            if not is_zero(area):  # else `cartstiff.analyse` chooses the length
                self.area, self.length = area, square_root(area)
            least = _LEAST_LENGTH_SHARE * self.kinematics.size
            self.require(limited(least**2, area))
            far = limited(norm_squared(self.position), LARGEST_ANGLE**2)
            self.require(far)
        self.columns = case.constants.sizes(self.length)[case.names]
        if not case.names:
            self.columns = np.full(self.n, 1.0, object)

    def load(self) -> Array | None:
        """Wrench that is known without the gradient; None if there is none."""
        return zeros(6) if self.W is None and self.case.is_balancing else self.W

    def resists(self, K: Array) -> Scalar:  # noqa: ARG002
        """Verdict on whether no motion of the body costs nothing."""
        return PLAIN

    def lagrangian(self, W: Array) -> Array:
        """H_L on the motions; the terms of load and closures are added
        before projection.
        """
        if vanishes(W):
            return self.hessian
        if self._lagrangian is None or self._lagrangian[0] is not W:
            H = congruence(self.N, self.coordinate_lagrangian(W))
            self._lagrangian = W, H
        return self._lagrangian[1]

    def coordinate_lagrangian(self, W: Array) -> Array:
        """H_L in all coordinates."""
        (gradient, hessian), J = self._of_coordinates, self.kinematics.J
        way, S = (
            self.case.constants.support(self.case.constants.carrier),
            zeros(*2 * J.shape[1:]),
        )
        S[np.ix_(way, way)] = curvature_of(J[:, way], self.kinematics.wrench(W))
        if self.mimic is not None:
            S = congruence(self.mimic, S)
        return hessian + self._turning(self.J_q.T @ W - gradient) - S

    def inverse(self) -> Array:
        """J^-1 of six coordinates; adds the verdict on it."""
        kinematics = self.kinematics
        # Any length near the reach makes rotations and translations comparable; 1 costs
        # nothing.
        length = 4.0 ** round(math.log(kinematics.reach or 1.0, 4.0))
        scale = np.repeat([length, 1.0], 3)[:, None]
        J = kinematics.J if self.rates is None else kinematics.J @ self.rates
        A = solution(J * scale, kinematics.adjoint() * scale)
        # A characteristic length that is small beside that makes C less accurate than M.
        limit = self.area * (JACOBIAN_CONDITION / max(length, kinematics.reach)) ** 2
        self.require_condition(A, limit)
        return A

    def require_condition(self, A: Array, limit: Scalar) -> None:
        """Set `squared_condition` from J^-1, which has to be below a limit."""
        pair = (self.J * self.columns).T, (A / self.columns[:, None]).T
        self.squared_condition = self.condition(*pair)
        self.require(limited(self.squared_condition, limit))

    def condition(self, forward: Array, backward: Array) -> Scalar:
        """Bound on the squared condition number of the scaled Jacobian.

        From its transpose and its transposed inverse, up to a rotation of the
        coordinates.
        """
        if self.rates is None and not any(self.case.constants.is_length):
            size: Scalar = 2.0 * self.n  # by the definition of the length
        else:
            size = norm_squared(forward[:, :3]) + norm_squared(forward[:, 3:]) / self.area
        return size * (
            norm_squared(backward[:3]) + norm_squared(backward[3:]) * self.area
        )

    def noteworthy(
        self, tangent: Array, own: tuple[Array, Array], outer: tuple[Array, Array]
    ) -> Array:
        """`cartstiff.recorded.algebra.noteworthy`, from H_L, K^B and their inverses."""
        margin = 2.0 if self.n == 6 else 100.0
        return noteworthy(self.squared_condition, tangent, own, outer, margin=margin)

    def kinetic(self, bodies: Bodies) -> Array:
        """Mass matrix in the coordinates."""
        M = kinetic(bodies, self.kinematics)
        return M if self.rates is None else congruence(self.rates, M)


#: Least pivot of the Hessian, as a share of its diagonal entry: four digits are lost.
_LEAST_PIVOT_SHARE = numerics.LOST_ERROR
#: Largest ratio of factors with mixed signs to the entries of their row.
_MAX_FACTOR_GROWTH = 100.0
#: Largest relative change of an inverse by one step of Newton's method, whose square
#: remains.
_MAX_NEWTON_CHANGE = numerics.ROUNDOFF_OF_SUMS**0.5
#: Least pivot of the self-motion's stiffness, and least norm of its Schur complement, as
#: shares of the largest entry.
_LEAST_SELF_MOTION_SHARE = numerics.LOST_ERROR


@lru_cache(maxsize=64)
def _middle(constants: TreeConstants) -> int:
    """Frame C, as of `Kinematics`, in which the inverse of six coordinates
    is shortest.
    """
    counts = {}
    for joint in range(2, len(constants.parents) + 2):
        tape = Tape()
        chain = ChainNumbers(tape, ChainCase(constants), joint)
        chain.inverse()
        counts[joint] = len(tape.operations)
    return min(counts, key=lambda joint: counts[joint])


def _six(chain: ChainNumbers) -> tuple[Array, Array, Array]:
    """W, K^B and K^F of a chain of six coordinates."""
    A = chain.inverse()
    W = chain.load()
    if W is None:
        W = A.T @ chain.gradient
    K_F = congruence(A, chain.hessian)
    if chain.rates is not None:
        return W, congruence(A, chain.lagrangian(W)), K_F
    return W, symmetric_product(A.T, -_curved(chain, A, W), K_F + FROM_B_TO_A @ W), K_F


def _curved(chain: ChainNumbers, A: Array, W: Array) -> Array:
    """``-L A`` with L the lower triangle of J^T Omega J, without diagonal,
    and ``A = J^-1``.

    As J^T Omega J A = J^T Omega = N, row a of L A is sum_(b < a) L[a, b] A_b as well as
    N_a - sum_(b >= a) (N J)[a, b] A_b. Joints near the body have sparse twists in M:
    their half of the rows takes the second form, and of all pairs of joints only those
    within a half are needed, in C those of the first.
    """
    half = 3
    curved = zeros(6, 6)
    J, kinematics = chain.J, chain.kinematics
    S = curvature_of(kinematics.J[:, :half], kinematics.wrench(W * 2.0))
    for a in range(half):
        for b in range(a):
            curved[a] = curved[a] + A[b] * S[a, b]
    for a in range(half, 6):
        curved[a] = minus_N = against(J[:, a], W)
        for b in range(a + 1, 6):
            curved[a] = curved[a] - A[b] * (minus_N @ J[:, b])
    return curved


def _redundant(chain: ChainNumbers) -> tuple[Array, Array]:
    """W and K^B of more than six joints, the energy being least over the self-motion."""
    n, columns = chain.n, chain.columns
    Q = reflections((chain.J * columns).T)
    inverse_R = upper_inverse(Q.R)
    chain.squared_condition = chain.condition(Q.R, inverse_R)
    regular = limited(chain.squared_condition, JACOBIAN_CONDITION**2)
    W = chain.load()
    balanced: Scalar = PLAIN
    if W is None:
        gradient = chain.gradient * columns
        turned = Q.apply_transposed(gradient)
        W = inverse_R @ turned[:6]
        roundoff = largest(chain.hessian * columns * columns[:, None]) * ROUNDOFF
        limit = largest(gradient) * BALANCE_TOLERANCE + roundoff
        torque = square_root(norm_squared(turned[6:]))
        # `cartstiff.analyse` has another basis of the self-motion: this bounds its
        # largest entry.
        balanced = pick(
            torque,
            limit * 0.5,
            PLAIN,
            pick(limit * (2.0 * n), torque, UNBALANCED, FALLBACK),
        )
    H = chain.lagrangian(W) * columns * columns[:, None]
    turned_H = Q.conjugate(H)
    L, inverses, pivots = positive_factor(turned_H[6:, 6:])
    reached = below(L, turned_H[6:, :6])
    S = turned_H[:6, :6] - congruence(reached, np.diag(inverses))
    limit = largest(H) * _LEAST_SELF_MOTION_SHARE
    stable: Scalar = PLAIN
    for pivot in pivots:
        stable = larger(stable, limited(limit, pivot))
    stable = larger(stable, limited(limit * limit, norm_squared(S)))
    # An unbalanced posture has no H_L; any other doubt leads to the verdict `FALLBACK`.
    verdict = pick(balanced, 0.5, larger(balanced, stable), balanced)
    verdict = pick(regular, 0.5, verdict, FALLBACK)
    chain.verdict = pick(chain.verdict, 0.5, verdict, FALLBACK)
    return W, congruence(inverse_R.T, S)


def _through_compliance(chain: ChainNumbers) -> tuple[Array, Array]:
    """The known W and K^B, the inverse of the compliance, of more than six motions."""
    W = chain.load()
    assert W is not None  # else it has no plan
    C, verdict = _softness(chain, chain.lagrangian(W))
    K, condition = scaled_inverse(C, 1.0 / chain.length)
    verdict = larger(verdict, limited(condition, STIFFNESS_CONDITION**2))
    chain.require(verdict)
    chain.squared_condition = condition
    return W, K


def _deficient(chain: ChainNumbers) -> Array:
    """W of least norm for fewer than six joints."""
    columns, length = chain.columns, chain.length
    scaled = chain.J * columns
    scaled[3:] = scaled[3:] / length
    Q = reflections(scaled)
    inverse_R = upper_inverse(Q.R)
    condition = norm_squared(Q.R) * norm_squared(inverse_R)
    verdict = limited(condition, JACOBIAN_CONDITION**2)
    W = chain.load()
    if W is None:
        w = zeros(6)
        w[: chain.n] = inverse_R.T @ (chain.gradient * columns)
        W = Q.apply(w)
        W[3:] = W[3:] / length
    chain.require(verdict)
    chain.squared_condition = condition
    return W


def _compliances(
    chain: ChainNumbers, W: Array, arrays: dict[str, Array], wanted: Collection[str]
) -> Scalar:
    """Add ``C^X = J (H_L + J^T D J)^-1 J^T``, D = K^X - K^B, to `arrays`;
    return the verdict.
    """
    names = [name for name in OF_MANY if f"compliance_{name}" in wanted]
    doubt: Scalar = PLAIN
    if not names:
        return doubt
    # Six coordinates have no self-motion that an indefinite Hessian could make unstable.
    signed = chain.n == 6 and not (chain.case.is_closed or chain.case.singular)
    C, verdict = _softness(chain, chain.lagrangian(W), signed)
    if "F" in names and chain.has_chart:
        arrays["compliance_F"] = C
        if not vanishes(W):
            arrays["compliance_F"], doubt = _softness(chain, chain.hessian, signed)
            verdict = larger(verdict, doubt)
    changes = connections(zeros(6, 6), W, chain.acting)
    needed = {f"compliance_{name}": changes[name] for name in names if name != "F"}
    if SYMMETRIC in wanted:
        needed[SYMMETRIC] = (changes["load"] + changes["load"].T) * 0.5
    for output, D in needed.items():
        arrays[output] = C
        if not vanishes(D):
            arrays[output], doubt = changed_compliance(
                C, D, chain.length, numerics.LARGEST_CHANGE_CONDITION
            )
            verdict = larger(verdict, doubt)
    return verdict


def _softness(
    chain: ChainNumbers, H: Array, signed: bool = False
) -> tuple[Array, Scalar]:
    """``J H^-1 J^T`` and the verdict on it; `signed` admits an indefinite H.

    For a positive H the sum over k of ``L_ak^2 d_k`` is its diagonal entry; for an
    indefinite one, the sum of absolute values bounds the loss of factors without
    pivoting. Where the loss is large, one step of Newton's method, ``X (2 - H X)``,
    squares it, as long as it is below 1. Elsewhere the step is not taken, as the factors
    resolve the softest motion better.
    """
    L, inverses, pivots = positive_factor(H)
    C = congruence(below(L, chain.J.T), np.diag(inverses))
    verdict: Scalar = PLAIN
    if not signed:
        return C, require_pivots(verdict, pivots, H.diagonal(), _LEAST_PIVOT_SHARE)
    # Growth of the factors, and pivots that vanish beside them.
    sizes = np.array([absolute(pivot) for pivot in pivots], object)
    scaled = H * chain.columns / chain.columns[:, None]
    for a in range(len(H)):
        grown = sizes[: a + 1] @ (L[a, : a + 1] * L[a, : a + 1])
        verdict = larger(verdict, limited(grown, largest(scaled[a]) * _MAX_FACTOR_GROWTH))
        verdict = larger(verdict, limited(grown * _LEAST_PIVOT_SHARE, sizes[a]))
    # One Newton step shows and removes the error of the inverse.
    X = congruence(below(L, np.eye(len(H))), np.diag(inverses))
    step = symmetric_product(X, np.eye(len(H)) - H @ X, zeros(*H.shape))
    size, inverse_size = equilibrated_squares(H, X + step)
    known = limited(size * inverse_size, numerics.WELL_CONDITIONED**2)
    change = equilibrated_squares(H, step)[1]
    known = larger(known, limited(change, inverse_size * _MAX_NEWTON_CHANGE**2))
    return C + congruence(chain.J.T, step) * verdict, pick(verdict, 0.5, PLAIN, known)


def chain_motion(tape: Tape, constants: TreeConstants) -> tuple[Array, Array]:
    """Pose (4, 4) and body Jacobian (6, n)."""
    chain = ChainNumbers(tape, ChainCase(constants), len(constants.parents) + 1)
    return chain.kinematics.pose(), chain.J


def chain_arrays(
    tape: Tape, case: ChainCase, wanted: Collection[str]
) -> dict[str, Array]:
    """Outputs that exist, among them all that are wanted,
    and the "verdict" on the posture.
    """
    at_body = len(case.constants.parents) + 1
    if case.singular:
        return _singular_arrays(ChainNumbers(tape, case, at_body), wanted)
    start = at_body
    if len(case.constants.is_length) == 6 and not case.rigid:
        # Where placements vary, derivatives at a few postures are asked: to try all
        # frames takes longer than they do.
        start = 4 if case.varied.links else _middle(case.constants)
    return arrays_of(ChainNumbers(tape, case, start), wanted)


def _singular_arrays(chain: ChainNumbers, wanted: Collection[str]) -> dict[str, Array]:
    """Outputs that exist where rank is lost, and "looked_at",
    which shows the loss of rank.

    The latter is the scaled Jacobian (6, n), the gradient (n,) and the largest entry of
    the Hessian, in natural sizes of the moving coordinates. Wrench and compliances need a
    known load.
    """
    scaled = chain.J * chain.columns
    scaled[3:] = scaled[3:] * (1.0 / chain.length)
    sizes = chain.columns * chain.columns[:, None]
    looked_at = [
        *scaled.ravel(),
        *(chain.gradient * chain.columns),
        largest(chain.hessian * sizes),
    ]
    arrays = {**_known_of(chain), "looked_at": np.array(looked_at, object)}
    W, verdict = chain.load(), chain.verdict
    if W is not None:
        arrays["wrench"], chain.has_chart = W, False
        # Rejects self-motions that cost nothing or buckle.
        verdict = larger(verdict, _softness(chain, chain.lagrangian(W))[1])
        verdict = larger(verdict, _compliances(chain, W, arrays, wanted))
    arrays["verdict"] = np.array([verdict], object)
    return arrays


def _known_of(chain: ChainNumbers) -> dict[str, Array]:
    """Outputs that every posture has."""
    return {
        "pose": chain.kinematics.pose(),
        "jacobian": chain.J_q,
        "energy": np.array([chain.energy], object),
        "torques": chain.torques,
    }


def arrays_of(chain: ChainNumbers, wanted: Collection[str]) -> dict[str, Array]:
    """`chain_arrays` of a recorded chain."""
    arrays = _known_of(chain)
    stiffness: dict[str, Array] = {}
    if chain.n < 6:
        W = _deficient(chain)
    elif chain.n == 6:
        W, K_B, K_F = _six(chain)
    elif chain.case.is_closed or chain.case.settled:
        W, K_B = _through_compliance(chain)
    else:
        W, K_B = _redundant(chain)
    if chain.n >= 6:
        stiffness = connections(K_B, W, chain.acting)
        if chain.has_chart:
            stiffness["F"] = K_F
    arrays["wrench"] = W
    arrays.update({f"stiffness_{name}": K for name, K in stiffness.items()})
    if "frames" in wanted:
        arrays["frames"] = chain.kinematics.frames()
    if "hessian" in wanted:
        arrays |= {"hessian": chain.hessian, "lagrangian": chain.lagrangian(W)}
    if "length" in wanted:
        arrays["length"] = np.array([chain.length], object)
    if "motions" in wanted and chain.case.is_closed:
        arrays["motions"] = chain.N
    if chain.case.bodies is not None:
        arrays |= {
            "kinetic": chain.kinetic(chain.case.bodies),
            "motion": chain.J,
            "lagrangian": chain.lagrangian(W),
        }
    verdict = _compliances(chain, W, arrays, wanted)
    if stiffness:
        verdict = larger(verdict, holds_soft_directions(stiffness["B"], wanted))
        verdict = larger(verdict, chain.resists(stiffness["B"]))
    # An unbalanced posture keeps that verdict, whatever its stiffness would be.
    both = larger(chain.verdict, verdict)
    arrays["verdict"] = np.array([pick(chain.verdict, 1.5, both, chain.verdict)], object)
    if "noteworthy" in wanted and stiffness and "compliance_B" in arrays:
        H = chain.lagrangian(W)
        pairs = (H, positive_inverse(H)), (stiffness["B"], arrays["compliance_B"])
        bounds = *chain.noteworthy(stiffness["load"], *pairs), chain.deflection
        arrays["noteworthy"] = np.array([*bounds, chain.strain], object)
    return arrays
