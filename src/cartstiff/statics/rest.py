"""The state a mechanism comes to rest in: coordinates, stability, reactions, stiffness."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any

import numpy as np

from cartstiff import numerics
from cartstiff.arrays import Result, fixed, read_only
from cartstiff.errors import ConvergenceError, UndefinedError
from cartstiff.geometry.se3 import Array
from cartstiff.mechanisms.contract import MechanismPosture
from cartstiff.mechanisms.elastic import ElasticMechanism
from cartstiff.mechanisms.elements import Elements
from cartstiff.notebook import ShownInLines
from cartstiff.notes import Note
from cartstiff.potentials.contract import Potential
from cartstiff.potentials.loads import Load
from cartstiff.statics.balance import spectrum
from cartstiff.statics.continuation import load_curve
from cartstiff.statics.effort import bounded
from cartstiff.statics.held import displacement_between
from cartstiff.statics.newton import Solution
from cartstiff.statics.problem import System
from cartstiff.statics.sensitivity import Chosen, motion_by_compliance
from cartstiff.stiffness.compute import PostureStiffness
from cartstiff.stiffness.posture_notes import near_constraint
from cartstiff.stiffness.reduction import reduce_to
from cartstiff.stiffness.showing import codes_of, numbers_text
from cartstiff.stiffness.springs_apart import springs_apart
from cartstiff.stiffness.tensor import StiffnessTensor

# Points of the curve on which critical loads are looked for.
_POINTS = 200
# Codes and words of the critical loads on it, by kind.
_PASSED = {
    "limit": (
        "limit-point",
        "a limit point, where the mechanism snaps through: it comes to rest elsewhere than a small "
        "load leads to",
    ),
    "bifurcation": (
        "bifurcation",
        "a bifurcation, where the mechanism buckles: another state, in a symmetric mechanism the "
        "mirror image of this one, is as good",
    ),
}


@dataclass(frozen=True, eq=False)
class Reactions:
    """Forces of what holds the mechanism.

    Attributes
    ----------
    held : mapping of str to float
        Force or moment that the environment applies in each held component of the displacement.
    wrench : ndarray (6,) or None
        The same as a wrench (moment, force) on the held frame, in its components; None where
        nothing is held.
    limits : mapping of str to float
        Force of each touched stop on its joint or leg: positive at a lower limit, negative at an
        upper one.
    closures : ndarray
        Forces of the closures, frame b on frame a per component of the residual.
    rigid : mapping of str to float
        Torque (force) of each rigid joint on what it moves.
    """

    held: Mapping[str, float]
    wrench: Array | None
    limits: Mapping[str, float]
    closures: Array
    rigid: Mapping[str, float]


@dataclass(frozen=True, eq=False, repr=False)
class Equilibrium(Result, ShownInLines):
    """A state in which all forces balance.

    Attributes
    ----------
    elastic : ElasticMechanism
        The mechanism with the rest positions that were used.
    loads : tuple of Potential
        What acted on it.
    q : ndarray (n,)
        Coordinates.
    posture, start : MechanismPosture
        Kinematics there, and where the search started.
    energy : float
        Springs, gravity, and loads; NaN where a load has no potential.
    residual : float
        Largest unbalanced generalised force over the forces that act on the same motion; 0 where
        all that is left is the rounding of coordinates and forces.
    iterations : int
        Newton steps.
    history : tuple of float
        Residual before each of them.
    stable : bool or None
        Whether H_N is positive definite. None where that decides nothing: at a zero eigenvalue
        ("neutral"), and without an energy unless vibrations grow; see `cartstiff.statics.flutter`.
    eigenvalues : ndarray
        Of H_N in natural units (angles in rad, distances in the characteristic length): energies.
        Without an energy omega^2 of the vibrations (rad^2/s^2), which may be complex; none where
        masses are missing.
    reactions : Reactions
        Forces of held components, limits and closures.
    """

    elastic: ElasticMechanism
    loads: tuple[Potential, ...]
    q: Array
    posture: MechanismPosture
    start: MechanismPosture
    energy: float
    residual: float
    iterations: int
    history: tuple[float, ...]
    stable: bool | None
    reactions: Reactions
    _own_notes: tuple[Note, ...]
    _system: System
    _solution: Solution
    #: omega^2 of the vibrations where there is no energy.
    _squares: Array | None = None
    #: Forces (E,) of the elements at the start whose rest positions were chosen there; or None.
    _chosen: Chosen | None = None

    @cached_property
    def notes(self) -> tuple[Note, ...]:
        """What was found and assumed, and what the loads pass on the way from zero.

        The latter is looked for when this is first read, if the loads have a potential and the
        equilibrium is far from where the first step of the search led.
        """
        if not (self.loads and self.stable and self._solution.is_far):
            return self._own_notes
        return (*self._own_notes, *self._notes_on_way())

    def _notes_on_way(self) -> list[Note]:
        """What loads that grow gradually meet."""
        system = self._system
        try:
            with bounded(self.elastic):
                curve = load_curve(
                    self.elastic, *self.loads, held=system.held, q0=self.start.q, points=_POINTS
                )
        except (ConvergenceError, UndefinedError):
            return []
        passed: dict[str, float] = {}
        for point in curve.critical:
            if point.kind in _PASSED:
                passed.setdefault(point.kind, float(point.factor))
        if not passed and curve.reason == "factor-reached":
            end = system.at(curve.q[-1])
            away = np.abs(system.displacement(end, self._solution.point)).max(initial=0.0)
            if away > numerics.NEARBY:
                words = "the loads, put on gradually, lead to another equilibrium than this one"
                return [Note("other-equilibrium", words, {"q": end.q.tolist()})]
        words = "the way from the unloaded state passes, at {:.4g} of the load, {}"
        return [
            Note(_PASSED[kind][0], words.format(factor, _PASSED[kind][1]), {"factor": factor})
            for kind, factor in passed.items()
        ]

    def _lines(self) -> list[str]:
        stable = {True: "stable", False: "unstable", None: "stability not decided"}[self.stable]
        moved = self.pose[:3, 3] - self.start.pose[:3, 3]
        return [
            f"Equilibrium of {self.elastic.name} at {self.elastic.mechanism.frame}: {stable}",
            f"  q      {numbers_text(self.q)}",
            f"  moved  {numbers_text(moved)} {self.elastic.units.length} since the start, in F",
            f"  notes  {codes_of(self.notes)}",
        ]

    @property
    def pose(self) -> Array:
        """``T_F_M`` (4, 4)."""
        return fixed(self.posture.pose)

    @property
    def K(self) -> StiffnessTensor:  # noqa: N802
        """K^K there with the loads' part included; `stiffness` has everything else."""
        return self.stiffness.K

    @property
    def is_conservative(self) -> bool:
        """Whether everything that acts has a potential."""
        return not np.isnan(self.energy)

    @cached_property
    def eigenvalues(self) -> Array:
        """Of H_N; without an energy omega^2 of the vibrations."""
        if self._squares is not None:
            return fixed(self._squares)
        return read_only(spectrum(self._solution.balance, conservative=True))

    @cached_property
    def displacement(self) -> Array:
        """From the start: rotation vector and translation (6,) of the body frame, axes of F."""
        return displacement_between(self.start.pose, self.pose)

    @property
    def is_adrift(self) -> bool:
        """Whether a motion of the body costs nothing, so that where it rests is not decided."""
        balance = self._solution.balance
        if self.stable is not None or not self.is_conservative or not balance.stiffness.size:
            return False
        values, modes = balance.modes
        idle = balance.motion(modes[:, np.abs(values) <= max(numerics.IDLE, balance.unsure)])
        lengths = self.posture.coordinate_lengths[:, None]
        body = self.posture.motion.jacobian @ (lengths * idle)
        body[3:] /= self.posture.length
        return bool(np.abs(body).max(initial=0.0) > numerics.CLOSE * np.abs(idle).max(initial=0.0))

    @cached_property
    def displacement_deviation(self) -> Array | None:
        """Standard deviation (6,) of `displacement` that measured springs leave; None without."""
        known = self.elastic.identified
        if known is None:
            return None
        motion = motion_by_compliance(
            self.posture,
            self._solution.balance,
            Elements(self.elastic),
            known.patterns,
            self._chosen,
        )
        turned = np.kron(np.eye(2), self.pose[:3, :3]) @ self.posture.motion.jacobian @ motion
        variance = np.einsum("ip,pr,ir->i", turned, known.covariance, turned)
        return read_only(np.sqrt(np.maximum(variance, 0.0)))

    @cached_property
    def stiffness(self) -> PostureStiffness:
        """Stiffness with the loads' part included: what decides stability.

        Where all loads have a potential and nothing is held, W = 0 and all connections agree.
        Touched limits are rigid.
        """
        return self._stiffness(self._at_rest.with_potential(*self.loads))

    @cached_property
    def elastic_stiffness(self) -> PostureStiffness:
        """Stiffness of the mechanism without the added loads, which show as its wrench W."""
        return self._stiffness(self._at_rest, self._load_on_body)

    @cached_property
    def _at_rest(self) -> ElasticMechanism:
        if self._solution.contacts:
            return self.elastic
        return self._system.at_rest(self._solution.point)

    @property
    def meaning_of_elastic_wrench(self) -> str:
        """What W of `elastic_stiffness` is, for people."""
        if self.elastic_stiffness.reduction.rank == 6:
            return "wrench that the springs balance, in the body frame"
        if self._load_on_body is not None:
            return "load on the body, in its frame; springs and structure carry it together"
        return (
            "part of the load that the springs balance, in the body frame; what the structure "
            "carries is not known"
        )

    @cached_property
    def _load_on_body(self) -> Array | None:
        """The loads' wrench on the body frame M; None where others act on the mechanism besides.

        Where joints do not feel a part of the wrench, their torques leave it open.
        """
        if self._solution.contacts or self.reactions.held:
            return None
        W = np.zeros(6)
        for load in self.loads:
            if not isinstance(load, Load) or load.frame_b != "body":
                return None
            W -= load.on_pose(self.pose)[1]
        return W

    @cached_property
    def full_stiffness(self) -> tuple[Array, Array | None]:
        """K (n, n) on all coordinates with all that acts, and the constraints' Jacobian (m, n)."""
        point, H = self._solution.point, self._solution.point.evaluation.hessian
        constraints = self._system.constraints(point.posture, self._solution.contacts)
        if constraints is None:
            return H, None
        to_constraints = constraints[1]
        H = H + to_constraints.curvature(self._solution.balance.multipliers)
        return H, to_constraints.jacobian

    def _stiffness(self, elastic: ElasticMechanism, force: Array | None = None) -> PostureStiffness:
        posture = self.posture
        evaluation = elastic.evaluate(posture)
        without = System(self.elastic, (), None, self._system.limits)
        constraints = without.constraints(posture, self._solution.contacts)
        reduction = reduce_to(
            posture.motion,
            evaluation,
            None if constraints is None else constraints[1],
            posture.length,
            posture.coordinate_lengths,
            force=force,
            apart=partial(springs_apart, elastic, posture)
            if posture.coordinates_are_pose
            else None,
        )
        notes = (*self.notes, *reduction.states, *near_constraint(reduction))
        # What loads exert is no rounding, however stiff the springs are that carry it.
        W = reduction.force
        is_given = W is not None and force is not None and force.any() and np.allclose(W, force)
        return PostureStiffness(
            elastic, self.q, posture, evaluation, reduction, notes, _load_is_given=bool(is_given)
        )

    def _uncertainty(self) -> dict[str, Any] | None:
        """Deviation and interval of the displacement, where springs were measured."""
        known, s = self.elastic.identified, self.displacement_deviation
        if known is None or s is None:
            return None
        half = known.factor * s
        return {
            "sd": s.tolist(),
            "lower": (self.displacement - half).tolist(),
            "upper": (self.displacement + half).tolist(),
            "level": known.level,
        }

    def as_dict(self) -> dict[str, Any]:
        """The object printed by ``cartstiff equilibrium --json``: the stiffness's, and more."""
        values: list[Any] = self.eigenvalues.tolist()
        if np.iscomplexobj(self.eigenvalues):
            values = [[float(v.real), float(v.imag)] for v in self.eigenvalues]
        wrench = self.reactions.wrench
        return self.stiffness.as_dict() | {
            "residual": self.residual,
            "stable": self.stable,
            "iterations": self.iterations,
            "history": list(self.history),
            "eigenvalues": values,
            "displacement": self.displacement.tolist(),
            "displacement_uncertainty": self._uncertainty(),
            "elastic_wrench": _plain(self.elastic_stiffness.wrench),
            "reactions": {
                "held": dict(self.reactions.held),
                "wrench": _plain(wrench),
                "limits": dict(self.reactions.limits),
                "closures": self.reactions.closures.tolist(),
                "rigid": dict(self.reactions.rigid),
            },
        }


def _plain(array: Array | None) -> list[float] | None:
    return None if array is None else array.tolist()
