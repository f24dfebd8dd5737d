r"""Large loads and weight: the equilibrium itself, and its derivatives by each compliance.

In every row the joints' springs are at rest where the row says (what the motors are told). The
arm's weight, hung masses and the wrench act; the displacement of a difference is that between two
equilibria, with and without the load. The derivative by a compliance, or by the coefficient of a
nonlinear spring, is that of `cartstiff.statics.rest`, at each of the two.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cartstiff import numerics
from cartstiff.arrays import Array
from cartstiff.errors import CartstiffError, ConvergenceError
from cartstiff.geometry import se3
from cartstiff.identify.linear_model import LinearModel, Model, is_open_chain, small_loads
from cartstiff.identify.measurements import Measurements
from cartstiff.identify.observations import Observations, field_of, wrenches
from cartstiff.identify.unknowns import Unknowns
from cartstiff.mechanisms.elastic import ElasticMechanism
from cartstiff.mechanisms.elements import Elements
from cartstiff.potentials.line_springs import LineSprings
from cartstiff.potentials.loads import DeadForce, DeadWrench, Load, Scaled
from cartstiff.potentials.springs import JointSprings
from cartstiff.statics.equilibrium import in_stages
from cartstiff.statics.newton import Solution, solve
from cartstiff.statics.problem import System
from cartstiff.statics.rest import motion_by_compliance

# Changes of parameters, in their natural sizes, along which a state of rest is followed linearly.
_NEAR = 0.5
# Share of a compliance's natural size below which its spring would only be stiff, not seen: from
# there on to zero the prediction is followed along its derivative.
_STIFFEST = numerics.STIFFEST
# Of Newton's method at each stage of a load.
_STEPS = 40


class _State(NamedTuple):
    """Pose of M, and twist of M (along its axes) per parameter (6, P)."""

    pose: Array
    twists: Array


@dataclass(frozen=True, eq=False)
class LoadedModel:
    """Equilibria under the rows' loads.

    Attributes
    ----------
    unknowns : Unknowns
        What is sought.
    measured : Measurements
        The rows.
    """

    unknowns: Unknowns
    measured: Measurements
    #: Where each row came to rest last, how it moves with the parameters, and what these were.
    _last: dict[tuple[int, bytes], tuple[Array, Array, Array]] = field(default_factory=dict)

    #: Whether the prediction is linear in the parameters.
    is_linear = False

    @cached_property
    def linear(self) -> LinearModel:
        """The linear model of the same rows: their poses and observations."""
        return LinearModel(self.unknowns, self.measured)

    @property
    def observations(self) -> Observations:
        """What was measured, number by number."""
        return self.linear.observations

    @cached_property
    def _settings(self) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """First row of each posture and load, and which of them each row has (N,)."""
        groups = self.measured.settings
        _, first = np.unique(groups, return_index=True)
        return first, groups

    @cached_property
    def _loads(self) -> tuple[Array, Array]:
        """Loads along F (N, 6), and the reference's forces along F (N, 3)."""
        elastic = self.unknowns.elements.elastic
        _, _, inertial = wrenches(self.measured, elastic, self.linear.poses)
        weight0 = np.multiply.outer(self.measured.mass0, field_of(elastic))
        return inertial, weight0 / elastic.units.newtons

    def at(self, theta: Array) -> tuple[Array, Array]:
        """Predictions (m,) and derivatives (m, P).

        Raises
        ------
        ConvergenceError
            If a row has no equilibrium, with its number.
        """
        least = np.where(self.unknowns.is_bounded, _STIFFEST * self.unknowns.sizes, -np.inf)
        inside = np.maximum(theta, least)
        y, A = self._at(inside)
        return y + A @ (theta - inside), A

    def _at(self, theta: Array) -> tuple[Array, Array]:
        """The same for compliances that are not all but zero."""
        seen, p = self.observations, np.asarray(self.measured.point)
        bare = _bare(self.unknowns.mechanism(theta))
        first, groups = self._settings
        differs = np.zeros(len(self.measured), bool)
        differs[seen.row[~seen.is_absolute]] = True
        references: dict[bytes, _State] = {}
        inertial, weight0 = self._loads
        y, A = np.zeros(len(seen)), np.zeros((len(seen), len(theta)))
        for k, n in enumerate(first):
            rows = np.flatnonzero(groups == k)
            at = np.flatnonzero(np.isin(seen.row, rows))
            elastic = _told(bare, self.measured.q[n])
            loaded = self._state(elastic, int(n), inertial[n], theta)
            rigid = _State(self.linear.poses[n], np.zeros((6, len(theta))))
            before = rigid
            if differs[rows].any():
                key = self.measured.q[n].tobytes() + weight0[n].tobytes()
                if key not in references:
                    still = np.append(np.zeros(3), weight0[n])
                    references[key] = self._state(elastic, int(n), still, theta)
                before = references[key]
            for i in at:
                start = rigid if seen.is_absolute[i] else before
                y[i], A[i] = _between(start, loaded, seen.axis[i], bool(seen.is_angle[i]), p)
        return y, A

    def _state(self, elastic: ElasticMechanism, n: int, load: Array, theta: Array) -> _State:
        """Equilibrium of a row under a wrench along F; the search begins where it should be."""
        q = self.measured.q[n]
        P = len(self.unknowns.parameters)
        loads: list[Load] = []
        if load[:3].any():
            loads.append(DeadWrench(load, point=self.measured.load_at))
        elif load.any():
            loads.append(DeadForce(load[3:], self.measured.load_at))
        if not loads and elastic.gravity is None:
            return _State(elastic.mechanism.at(q).pose, np.zeros((6, P)))
        system = System(elastic, loads)
        key = (n, load.tobytes())
        start = q
        if key in self._last:
            start, rates, before = self._last[key]
            change = theta - before
            if np.all(np.abs(change) <= _NEAR * self.unknowns.sizes):
                start = start + rates @ change
        try:
            state = _solved(system, start, q, is_first=key not in self._last)
        except CartstiffError as error:
            raise ConvergenceError(
                f"row {self.measured.rows[n]}: {error}", iterations=0, residual=np.nan
            ) from None
        posture, elements = state.point.posture, Elements(elastic)
        sought = [u.pattern for u in self.unknowns.parameters]
        motion = motion_by_compliance(posture, state.balance, elements, sought)
        self._last[key] = state.point.q, motion, theta.copy()
        return _State(posture.pose, posture.motion.jacobian @ motion)


def _solved(system: System, start: Array, forces: Array, *, is_first: bool) -> Solution:
    """Equilibrium near where it should be, else near where the motors are told to be.

    In the first search of a row the load is put on step by step if nothing else helps.
    """
    try:
        return solve(system, start, settle=False)
    except CartstiffError:
        if is_first:
            staged = in_stages(system, forces, _STEPS, settle=False)
            if staged is None:
                raise
            return staged
        return solve(system, forces, settle=False)


def _bare(elastic: ElasticMechanism) -> ElasticMechanism:
    """The mechanism without loads of its own; its cables hold like bars."""
    inner = tuple(p for p in elastic.potentials if not isinstance(p, (Load, Scaled)))
    springs = elastic.springs
    if isinstance(springs, LineSprings):
        springs = replace(springs, unilateral=False)
    return replace(elastic, potentials=inner, springs=springs)


def _told(elastic: ElasticMechanism, q: Array) -> ElasticMechanism:
    """The mechanism with its springs at rest where the motors are told to be."""
    springs = elastic.springs
    if isinstance(springs, JointSprings):
        k, rest = springs.stiffness.copy(), q.copy()
        k[list(springs.rigid)], rest[list(springs.rigid)] = np.inf, np.nan
        return replace(elastic, springs=JointSprings(k, rest, springs.laws))
    if isinstance(springs, LineSprings):
        posture = elastic.mechanism.at(q)
        lengths = getattr(posture, "lines").lengths  # noqa: B009 - a platform's posture has lines
        return replace(elastic, springs=springs.replaced(springs.stiffness, lengths))
    return elastic


def needs_equilibrium(elastic: ElasticMechanism) -> bool:
    """Whether nonlinear springs stand where the load alone does not say what they carry.

    In closed chains, and beside lines: what each carries depends on how far all give.
    """
    laws = isinstance(elastic.springs, JointSprings) and bool(elastic.springs.laws)
    return laws and not is_open_chain(elastic)


def model_of(unknowns: Unknowns, measured: Measurements, loaded: bool = False) -> Model:
    """The equilibrium where that is asked for or needed, else the model of small loads."""
    if loaded or needs_equilibrium(unknowns.elements.elastic):
        return LoadedModel(unknowns, measured)
    return small_loads(unknowns, measured)


def _between(
    start: _State, end: _State, axis: Array, is_angle: bool, point: Array
) -> tuple[float, Array]:
    """Displacement of a point, or turn, along an axis of F between two states; derivatives."""
    R, R0 = end.pose[:3, :3], start.pose[:3, :3]
    if is_angle:
        turn = se3.log(se3.pose(R @ R0.T))
        rates = R @ end.twists[:3] - R @ start.twists[:3]
        return float(axis @ turn[:3]), axis @ se3.right_jacobian_inverse(-turn)[:3, :3] @ rates
    moved = end.pose[:3, 3] + R @ point - start.pose[:3, 3] - R0 @ point
    rates = R @ _of_point(end.twists, point) - R0 @ _of_point(start.twists, point)
    return float(axis @ moved), axis @ rates


def _of_point(twists: Array, point: Array) -> Array:
    """``v + omega x p`` for columns of twists (6, P)."""
    return np.asarray(twists[3:] - se3.skew(point) @ twists[:3])
