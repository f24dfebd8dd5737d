"""Predictions of displacements under load, and their derivatives by each compliance.

Small loads: theory.md, eq. identifiedgradient, with the exact derivatives of
`Potential.softened`. If the forces follow from the load alone (open chains, six legs) the
displacement is linear in the compliances.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cartstiff.core import numerics
from cartstiff.core.arrays import Array
from cartstiff.core.errors import (
    CartstiffError,
    ConvergenceError,
    InputError,
    UndefinedError,
)
from cartstiff.core.geometry import se3
from cartstiff.core.mechanisms.contract import MechanismPosture
from cartstiff.core.mechanisms.elastic import ElasticMechanism
from cartstiff.core.potentials.gravity import Gravity
from cartstiff.core.potentials.loads import DeadForce, DeadWrench, Load
from cartstiff.core.potentials.springs import SpringLaw
from cartstiff.core.statics.equilibrium import in_stages
from cartstiff.core.statics.newton import Solution, solve
from cartstiff.core.statics.problem import System
from cartstiff.core.statics.rest import motion_by_compliance
from cartstiff.core.stiffness.applied_load import wrench_in_body
from cartstiff.core.stiffness.compute import PostureStiffness, analyse
from cartstiff.kinematics.joint_poses import Kinematics, ManyPoses
from cartstiff.wings.identify.measurements import (
    Measurements,
    Observations,
    observe,
    wrenches,
)
from cartstiff.wings.identify.unknowns import Offsets, Unknowns, offsets_of


def unloaded(elastic: ElasticMechanism, q: Array | None = None) -> ElasticMechanism:
    """The mechanism with no loads but gravity compensation; its cables are taken as bars.

    Its springs are at rest at the commanded positions q (n,); without it their rest
    positions are open.
    """
    inner = tuple(
        p.with_open_rest() for p in elastic.potentials if p.lifted or not p.is_external
    )
    springs = elastic.springs
    if springs is None:
        return replace(elastic, potentials=inner)
    rest = np.full(len(springs.stiffness), np.nan)
    if q is not None:
        rest = springs.positions(elastic.mechanism.at(q))
    return replace(elastic, springs=springs.unloaded(rest), potentials=inner)


def at_rest(elastic: ElasticMechanism) -> ElasticMechanism:
    """The mechanism with all rest positions open, without gravity and loads."""
    return unloaded(elastic).with_gravity(None)


class Response(NamedTuple):
    """Motion of a mechanism at a posture under unit wrenches on the body, and under its
    weight.

    Attributes
    ----------
    right, motion : ndarray (n, 7)
        Forces on the motions of the posture, and these motions.
    rates : ndarray (P, n, n)
        Derivatives of the stiffness on them.
    basis : ndarray
        Coordinates per motion.
    """

    right: Array
    motion: Array
    rates: Array
    basis: Array = np.eye(1)


@dataclass(frozen=True, eq=False)
class Model:
    """Displacements of small loads.

    They are linear in the load but for nonlinear springs in joints of an open chain:
    their torques t follow from the load alone, and with them their deflections x(t). A
    coefficient c_m of ``t = c_1 x + c_2 x^2 + ...`` has ``dx/dc_m = -x^m / (dt/dx)``.

    Attributes
    ----------
    unknowns : Unknowns
        Parameters; their mechanism is the measured one.
    measured : Measurements
        The rows.
    """

    unknowns: Unknowns
    measured: Measurements

    @cached_property
    def _rest(self) -> ElasticMechanism:
        return self._linear(self.unknowns.elastic)

    def _linear(self, elastic: ElasticMechanism) -> ElasticMechanism:
        """A mechanism without loads; an open chain with linear springs only."""
        elastic = at_rest(elastic)
        springs = elastic.springs
        if springs is not None and springs.laws and is_open_chain(elastic):
            k = springs.stiffness.copy()
            k[list(springs.laws)] = 1.0  # any value: their deflections are added
            springs = springs.linear(springs.laws).replaced(k, np.full(len(k), np.nan))
            elastic = replace(elastic, springs=springs)
        return elastic

    @cached_property
    def _is_open(self) -> bool:
        """Whether the forces are the Jacobian's rows: an open chain of springs."""
        return self._rest.springs is not None and is_open_chain(self._rest)

    @property
    def is_linear(self) -> bool:
        """Whether the prediction is linear in the parameters."""
        mechanism = self._rest.mechanism
        legs = mechanism.coordinates_are_pose and len(self._rest.compliances) == 6
        return legs or (
            self._is_open and not any(u.law for u in self.unknowns.parameters)
        )

    @cached_property
    def _distinct(self) -> tuple[Array, NDArray[np.intp]]:
        """Postures that differ (k, n), and which of them each row has (N,)."""
        groups = self.measured.postures
        _, first = np.unique(groups, return_index=True)
        return self.measured.q[first], groups

    @cached_property
    def poses(self) -> Array:
        """``T_F_M`` (N, 4, 4) of the rigid mechanism."""
        return self._kinematics.pose[self._distinct[1]]

    @cached_property
    def _kinematics(self) -> ManyPoses:
        """Poses and Jacobians of the distinct postures."""
        return Kinematics(self._rest.mechanism).at(self._distinct[0])

    @cached_property
    def observations(self) -> Observations:
        """The measured numbers."""
        return observe(self.measured, self.unknowns.elastic, self.poses)

    @cached_property
    def offsets(self) -> Offsets:
        """Columns of the offsets of sessions, and of the geometry that is sought."""
        return offsets_of(self.unknowns, self.observations, self.measured)

    @cached_property
    def _inertial(self) -> tuple[Array, Array]:
        """Loads along F (N, 6), and those of the reference."""
        return wrenches(self.measured, self.unknowns.elastic, self.poses)

    @cached_property
    def _loads(self) -> tuple[Array, Array, Array]:
        """Wrench (m, 6) of each number, whether the own weight adds to it (m,);
        all that acts.
        """
        loaded, reference = (
            wrench_in_body(W, self.poses, self.measured.load_at, "world")
            for W in self._inertial
        )
        seen = self.observations
        W = loaded[seen.row] - np.where(
            seen.is_absolute[:, None], 0.0, reference[seen.row]
        )
        return W, seen.is_absolute, loaded[seen.row]

    @cached_property
    def _weights(self) -> Array:
        """Generalised forces (k, n) of the mechanism's own weight in the
        distinct postures.
        """
        elastic, (q, _) = self.unknowns.elastic, self._distinct
        if elastic.gravity is None:
            return np.zeros((len(q), elastic.mechanism.at(q[0]).motion.jacobian.shape[1]))
        lifts = [p for p in elastic.potentials if p.lifted]
        acting = [Gravity(elastic.gravity), *lifts]
        postures = [elastic.mechanism.at(x) for x in q]
        return np.array(
            [-sum(term.evaluate(at).gradient for term in acting) for at in postures]
        )

    def _responses(self, theta: Array) -> Iterator[Response]:
        """How the mechanism responds in each distinct posture."""
        mechanism = self._linear(self.unknowns.mechanism(theta))
        each = [u.pattern.keys for u in self.unknowns.parameters]
        per = self.unknowns.per_share(theta)

        def rates(
            elastic: ElasticMechanism,
            posture: MechanismPosture,
            forces: Array | None = None,
        ) -> Array:
            """Derivatives (P, n, n) of the Hessian by the parameters."""
            dH = np.zeros((len(each), *2 * (posture.motion.jacobian.shape[1],)))
            for p, keys in enumerate(each):
                for key, weight in keys:
                    if key in elastic.compliances:
                        *both, factor = elastic.softened(key, posture, forces)
                        two = [term.evaluate(posture).hessian for term in both]
                        dH[p] += per[p] * weight * factor * np.subtract(*two)
            return dH

        q, _ = self._distinct
        if self._is_open:
            # One stiffness at all postures, of the joints that are linear springs.
            posture = mechanism.mechanism.at(q[0])
            each_H = [term.evaluate(posture).hessian for term in mechanism.terms()]
            H = np.sum(each_H, axis=0)
            bent = [*self.unknowns.elastic.springs.laws]  # type: ignore[union-attr]
            own = np.setdiff1d(np.flatnonzero(np.any(H, axis=0)), bent)
            inverse = np.zeros_like(H)
            inverse[np.ix_(own, own)] = np.linalg.inv(H[np.ix_(own, own)])
            dH = rates(mechanism, posture)
            for J, weight in zip(self._kinematics.jacobian, self._weights, strict=True):
                right = np.column_stack([J.T, weight])
                yield Response(right, inverse @ right, dH)
            return
        for row, weight in zip(q, self._weights, strict=True):
            try:
                result = analyse(mechanism, row)
                N, J, inverse = _held(result)
            except UndefinedError as error:
                place = np.flatnonzero((self.measured.q == row).all(axis=1))[0]
                raise InputError(
                    f"row {self.measured.rows[place]}: {error}",
                    expected="a posture in which the springs hold the mechanism",
                ) from None
            right = np.column_stack([J.T, N.T @ weight])
            forces = mechanism.chosen_forces(result.elastic, result.posture)
            dH = rates(result.elastic, result.posture, forces)
            yield Response(right, inverse @ right, N.T @ dH @ N, N)

    def _moved(self, theta: Array) -> Iterator[tuple[Response, NDArray[np.intp], Array]]:
        """In each distinct posture the response, places of its numbers, and the motions
        (n, k) under their loads.
        """
        W, weighs, _ = self._loads
        acting = np.column_stack([W, weighs])
        place = self._distinct[1][self.observations.row]
        for k, response in enumerate(self._responses(theta)):
            rows = np.flatnonzero(place == k)
            yield response, rows, response.motion @ acting[rows].T

    def at(self, theta: Array) -> tuple[Array, Array]:
        """Predictions (m,) and derivatives (m, P).

        Raises
        ------
        InputError
            If the springs do not hold a row's posture, or a law does not reach its
            torque.
        """
        y, A = self._at(theta)
        for p in self.by_differences:
            step = np.zeros(len(theta))
            step[p] = numerics.WIDE_DIFFERENCE_STEP * self.unknowns.sizes[p]
            A[:, p] = (self._at(theta + step)[0] - self._at(theta - step)[0]) / (
                2.0 * step[p]
            )
        return y, A

    @cached_property
    def by_differences(self) -> list[int]:
        """Parameters of lines with given rest lengths in closed chains and platforms,
        whose other forces follow the tension: derivatives are central differences.
        """
        mechanism = self._rest.mechanism
        if not (mechanism.closures or mechanism.coordinates_are_pose):
            return []
        lines = {n for n in self._rest.compliances if n.startswith("line")}
        lines -= set(self._rest.names)
        return [
            p
            for p, u in enumerate(self.unknowns.parameters)
            if any(key in lines for key, _ in u.pattern.keys)
        ]

    def _at(self, theta: Array) -> tuple[Array, Array]:
        """The same with forces in the springs that do not depend on their stiffness."""
        a = self.observations.functional
        y, A = np.zeros(len(a)), np.zeros((len(a), len(theta)))
        for response, rows, moved in self._moved(theta):
            back = response.motion[:, :6] @ a[rows].T
            y[rows] = np.einsum("nm,nm->m", response.right[:, :6] @ a[rows].T, moved)
            A[rows] -= np.einsum("nm,pnr,rm->mp", back, response.rates, moved)
        laws = self._laws(theta) if self._is_open else {}
        for name, law in laws.items():
            self._add_bent(y, A, theta, name, law)
        return y, A

    def _laws(self, theta: Array) -> dict[str, SpringLaw]:
        """Nonlinear springs by joint, with the sought coefficients."""
        elastic = self.unknowns.mechanism(theta)
        laws = {} if elastic.springs is None else elastic.springs.laws
        return {elastic.names[j]: law for j, law in laws.items()}

    def _add_bent(
        self, y: Array, A: Array, theta: Array, name: str, law: SpringLaw
    ) -> None:
        """Add the deflection of a nonlinear spring in an open chain,
        and its derivatives.
        """
        seen, j = self.observations, self._rest.names.index(name)
        place = self._distinct[1][seen.row]
        J, own = self._kinematics.jacobian[place, :, j], self._weights[place, j]
        moved, (W, weighs, loaded) = (
            np.einsum("mi,mi->m", J, seen.functional),
            self._loads,
        )
        torque = np.einsum("mi,mi->m", J, loaded) + own
        # A position differs from that of the rigid arm, a displacement from the state
        # before.
        before = np.where(weighs, 0.0, torque - np.einsum("mi,mi->m", J, W))
        for t, sign in ((torque, 1.0), (before, -1.0)):
            each, back = np.unique(t, return_inverse=True)  # one for a row's numbers
            roots = [law.deflection_for(float(value)) for value in each]
            x, k = (
                np.array(roots)[back],
                np.array([law.evaluate(v)[2] for v in roots])[back],
            )
            y += sign * moved * x
            for p, unknown in enumerate(self.unknowns.parameters):
                joint, power = unknown.law or ("", 0)
                if joint == name:
                    by = theta[p] ** -2 if power == 1 else -1.0
                    A[:, p] += sign * moved * by * x**power / k

    def forces_in_lines(self, theta: Array) -> dict[str, Array]:
        """Force (m,) in each line under each number's load."""
        elastic, count = (
            self._linear(self.unknowns.mechanism(theta)),
            len(self.observations),
        )
        found = dict[str, Array]()
        for response, rows, moved in self._moved(theta):
            q = self.measured.q[self.observations.row[rows[0]]]
            for parts in elastic.parts(elastic.mechanism.at(q)):
                forces = parts.stiffness @ parts.rows @ response.basis @ moved
                for name, force in zip(parts.names, forces, strict=True):
                    found.setdefault(name, np.zeros(count))[rows] = force
        return found


def _held(result: PostureStiffness) -> tuple[Array, Array, Array]:
    """The free motions (n, f) of a posture, those of the body (6, f), and the inverse of
    the stiffness on them.

    Raises
    ------
    UndefinedError
        In an unbalanced posture, or where a motion costs nothing.
    """
    free = result.reduction.free
    inverse = None if free is None else free.inverse(result.change_by_load)
    if free is None or inverse is None:
        if result.reduction.states:
            raise result.reduction.undefined()
        words = "a motion costs nothing: no linear motion"
        raise UndefinedError(words, code="no-shares")
    return free.basis, free.jacobian, inverse.matrix


def is_open_chain(elastic: ElasticMechanism) -> bool:
    """Whether the torque of each joint follows from the load alone: no loops,
    no other springs.
    """
    mechanism = elastic.mechanism
    others = any(not (p.is_external or p.members) for p in elastic.potentials)
    return not (mechanism.coordinates_are_pose or mechanism.closures or others)


# Largest changes of parameters, in natural sizes, over which an equilibrium is
# extrapolated linearly.
_NEAR = 0.5
# Bound on Newton's steps at each stage of a load.
_MAX_STAGE_STEPS = 40


class _State(NamedTuple):
    """Pose of M, and twist of M (along its axes) per parameter (6, P)."""

    pose: Array
    twists: Array


@dataclass(frozen=True, eq=False)
class LoadedModel(Model):
    """Equilibria under the rows' loads."""

    #: Last equilibrium of each row, its derivative by the parameters, and these.
    _last: dict[tuple[int, bytes], tuple[Array, Array, Array]] = field(
        default_factory=dict
    )

    #: Whether the prediction is linear in the parameters.
    is_linear = False

    @cached_property
    def _settings(self) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """First row of each posture and load, and which of them each row has (N,)."""
        groups = self.measured.settings
        _, first = np.unique(groups, return_index=True)
        return first, groups

    def at(self, theta: Array) -> tuple[Array, Array]:
        """Predictions (m,) and derivatives (m, P).

        Raises
        ------
        ConvergenceError
            If a row has no equilibrium, with its number.
        """
        # Below this share of its natural size a compliance has no visible effect: from
        # there on to zero the prediction follows its derivative.
        smallest = numerics.LEAST_COMPLIANCE_SHARE * self.unknowns.sizes
        least = np.where(self.unknowns.is_bounded, smallest, -np.inf)
        inside = np.maximum(theta, least)
        y, A = self._at(inside)
        return y + A @ (theta - inside), A

    def _at(self, theta: Array) -> tuple[Array, Array]:
        """The same for compliances above the smallest."""
        seen, p = self.observations, np.asarray(self.measured.point)
        mechanism = self.unknowns.mechanism(theta)
        first, groups = self._settings
        differs = np.zeros(len(self.measured), bool)
        differs[seen.row[~seen.is_absolute]] = True
        references: dict[bytes, _State] = {}
        inertial, reference = self._inertial
        y, A = np.zeros(len(seen)), np.zeros((len(seen), len(theta)))
        # One equilibrium for rows with the same posture and load.
        for k, n in enumerate(first):
            rows = np.flatnonzero(groups == k)
            at = np.flatnonzero(np.isin(seen.row, rows))
            elastic = unloaded(mechanism, self.measured.q[n])
            loaded = self._state(elastic, int(n), inertial[n], theta)
            rigid = _State(self.poses[n], np.zeros((6, len(theta))))
            before = rigid
            if differs[rows].any():
                key = self.measured.q[n].tobytes() + reference[n].tobytes()
                if key not in references:
                    references[key] = self._state(elastic, int(n), reference[n], theta)
                before = references[key]
            for i in at:
                start = rigid if seen.is_absolute[i] else before
                y[i], A[i] = _between(
                    start, loaded, seen.axis[i], bool(seen.is_angle[i]), p
                )
        return y, A

    def _state(
        self, elastic: ElasticMechanism, n: int, load: Array, theta: Array
    ) -> _State:
        """Equilibrium of a row under a wrench along F,
        sought from an extrapolated one.
        """
        q = self.measured.q[n]
        P = len(self.unknowns.parameters)
        # What acts in the row.
        loads: list[Load] = []
        if load[:3].any():
            loads.append(DeadWrench(load, point=self.measured.load_at))
        elif load.any():
            loads.append(DeadForce(load[3:], self.measured.load_at))
        if not loads and elastic.gravity is None:
            return _State(elastic.mechanism.at(q).pose, np.zeros((6, P)))
        # The search starts at the equilibrium found last.
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
        posture, sought = state.point.posture, self.unknowns.parameters
        patterns = [u.pattern for u in sought]
        motion = motion_by_compliance(elastic, posture, state.balance, patterns)
        motion = motion * self.unknowns.per_share(theta)
        self._last[key] = state.point.q, motion, theta.copy()
        return _State(posture.pose, posture.motion.jacobian @ motion)


def _solved(system: System, start: Array, forces: Array, *, is_first: bool) -> Solution:
    """Equilibrium near an expected one, else near the commanded positions.

    In the first search of a row the load is increased in stages if that fails.
    """
    try:
        return solve(system, start, settle=False)
    except CartstiffError:
        if is_first:
            staged = in_stages(system, forces, _MAX_STAGE_STEPS, settle=False)
            if staged is None:
                raise
            return staged
        return solve(system, forces, settle=False)


def needs_equilibrium(elastic: ElasticMechanism) -> bool:
    """Whether the torques of nonlinear springs do not follow from the load alone.

    In closed chains, and beside lines, they depend on the deflections of all springs.
    """
    bent = elastic.springs is not None and bool(elastic.springs.laws)
    return bent and not is_open_chain(elastic)


def model_of(unknowns: Unknowns, measured: Measurements, loaded: bool = False) -> Model:
    """The model of equilibria if `loaded` or needed, else that of small loads."""
    if loaded or needs_equilibrium(unknowns.elastic):
        return LoadedModel(unknowns, measured)
    return Model(unknowns, measured)


def _between(
    start: _State, end: _State, axis: Array, is_angle: bool, point: Array
) -> tuple[float, Array]:
    """Displacement of a point, or turn, along an axis of F between two states;
    derivatives.
    """
    R, R0 = end.pose[:3, :3], start.pose[:3, :3]
    if is_angle:
        turn = se3.log(se3.pose(R @ R0.T))
        rates = R @ end.twists[:3] - R @ start.twists[:3]
        return float(axis @ turn[:3]), axis @ se3.right_jacobian_inverse(-turn)[
            :3, :3
        ] @ rates
    moved = end.pose[:3, 3] + R @ point - start.pose[:3, 3] - R0 @ point
    rates = R @ _of_point(end.twists, point) - R0 @ _of_point(start.twists, point)
    return float(axis @ moved), axis @ rates


def _of_point(twists: Array, point: Array) -> Array:
    """``v + omega x p`` for columns of twists (6, P)."""
    return np.asarray(twists[3:] - se3.skew(point) @ twists[:3])
