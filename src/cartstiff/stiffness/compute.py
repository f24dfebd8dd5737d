r"""From an elastic mechanism at a posture to the stiffness matrices under every connection."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from cartstiff import numerics
from cartstiff.arrays import NamedArrays, checked_matrix, checked_pose, checked_vector, fixed
from cartstiff.errors import InputError, UndefinedError, UnknownNameError
from cartstiff.geometry import se3
from cartstiff.geometry.connections import (
    BI_INVARIANT,
    CARTAN_MINUS,
    KINEMATIC,
    NAMED,
    Connection,
)
from cartstiff.geometry.se3 import Array
from cartstiff.mechanisms.chain import OWN_COORDINATES
from cartstiff.mechanisms.contract import MechanismPosture, named_values
from cartstiff.mechanisms.elastic import ElasticMechanism, Note
from cartstiff.mechanisms.limits import limit_notes
from cartstiff.mechanisms.weighed import weighed
from cartstiff.potentials.contract import Evaluation, Map, Potential
from cartstiff.potentials.gravity import Gravity
from cartstiff.potentials.loads import Load, Scaled
from cartstiff.stiffness.applied_load import LoadKind, wrench_in_body
from cartstiff.stiffness.in_frame import StiffnessInFrame, stiffness_in_frame
from cartstiff.stiffness.reduction import Reduction, reduce_to
from cartstiff.stiffness.settled_links import settled
from cartstiff.stiffness.showing import posture_html, posture_text
from cartstiff.stiffness.tensor import StiffnessTensor

__all__ = ["SCHEMA", "PostureStiffness", "analyse"]

SCHEMA = "cartstiff/1"

_EYE, _EYE_4 = np.eye(6), np.eye(4)
# K^X = K^B - (W @ _FROM_B)[X] for X = A, B, K at once: K^A = K^B - 1/2 M with the M of
# `se3.bracket_form`, and K^X = K^A less the wrench term of the connection.
_FROM_B = np.concatenate(
    [
        c._symbols_by_wrench + 0.5 * se3.bracket_form(_EYE).reshape(6, 36)
        for c in (CARTAN_MINUS, BI_INVARIANT, KINEMATIC)
    ],
    axis=1,
)

_DEAD_AT_ORIGIN = LoadKind()


def analyse(
    elastic: ElasticMechanism,
    q: ArrayLike | Mapping[str, float] | None = None,
    *,
    wrench: ArrayLike | None = None,
    load_kind: Literal["dead", "follower", "conservative"] = "dead",
    load_at: ArrayLike = _DEAD_AT_ORIGIN.at,
    load_axes: Literal["body", "world"] = "body",
    strict: bool = False,
) -> PostureStiffness:
    r"""Stiffness of a mechanism at a posture, under every connection.

    Parameters
    ----------
    elastic : ElasticMechanism
        Mechanism and potentials, from `cartstiff.load`.
    q : array_like (n,) or mapping, optional
        Coordinates in rad and length units, in joint order or by name; default the file's posture.
        For a platform: x, y, z, roll, pitch, yaw. A closed chain is assembled from there.
    wrench : array_like (6,), optional
        (moment, force) that the environment applies to the body at `load_at`; there it is W. All
        rest positions are then chosen so that the springs balance it at q, and links that give
        are deflected by it: their virtual joints start at q. Without it, springs
        with a rest position exert what they exert, and those without carry gravity.
    load_kind : {"dead", "follower", "conservative"}
        What the load does while the body moves, on which the `tangent` depends: keeps its direction
        in the room, turns with the body, or keeps its force's direction while its moment turns by
        half. See `cartstiff.stiffness.applied_load`.
    load_at : array_like (3,)
        The point of the body at which the load acts, in the frame M.
    load_axes : {"body", "world"}
        Axes of the wrench's components: those of M or of F.
    strict : bool
        Raise where a stiffness matrix does not exist, instead of returning None with a note.

    Returns
    -------
    PostureStiffness
        Pose, Jacobian, wrench, energy, K^A, K^B, K^K, K^F, the tangent under the load,
        compliances, notes.

    Raises
    ------
    InputError
        For a wrong count, an unknown name, or numbers that are not finite.
    UnknownNameError
        For an unknown kind or axes of the load.
    ConvergenceError
        If a closed chain cannot be assembled near q.
    UndefinedError
        With `strict`, for a singular, unbalanced or buckled state.
    """
    if q is None:
        values = elastic.q
    elif isinstance(q, Mapping):
        values = named_values(q, elastic.names, elastic.q, "q")
    else:
        values = elastic.mechanism.checked(q)
    notes = list(elastic.notes)
    kind = _DEAD_AT_ORIGIN
    if load_kind != "dead" or load_at is not kind.at:
        kind = LoadKind(load_kind, load_at)  # type: ignore[arg-type]
    given = None
    if wrench is not None:
        given = checked_vector(wrench, 6, "wrench")
        if elastic.springs is None:
            raise InputError(
                "the load of this mechanism follows from its potentials and cannot be given",
                expected="no wrench here",
            )
    posture = elastic.mechanism.closed(values)
    if given is not None:
        if load_axes in ("body", "world"):
            posture = settled(elastic, posture, given, kind.at, load_axes)
        given = wrench_in_body(given, posture.pose, kind.at, load_axes)
    elastic, energy = elastic._balanced_with_evaluation(posture, given)
    reduction = reduce_to(
        posture.motion,
        energy,
        posture.closure,
        posture.length,
        posture.coordinate_lengths,
        force=given,
    )
    notes += [Note(*state) for state in reduction.states]
    notes += _near_singular(posture, reduction)
    notes += elastic.remarks(posture)
    notes += limit_notes(elastic.mechanism, posture)
    notes += weighed(elastic).notes
    result = PostureStiffness(
        elastic, fixed(posture.q), posture, energy, reduction, tuple(notes), kind,
        given is not None and bool(given.any()),
    )  # fmt: skip
    if strict and reduction.stiffness is None:
        state = reduction.states[-1]
        raise UndefinedError(state.message, code=state.code, values=state.values)
    return result


def _near_singular(posture: MechanismPosture, reduction: Reduction) -> list[Note]:
    """Warnings where a Jacobian has lost rank or is about to."""
    notes = []
    values = reduction.singular_values
    if reduction.rank == 6 and values[5] < numerics.NEAR * values[0]:
        notes.append(
            Note(
                "near-serial-singularity",
                f"the end-effector hardly moves in one direction: smallest over largest singular "
                f"value {values[5] / values[0]:.2g}",
                {"singular_values": values.tolist(), "characteristic_length": posture.length},
            )
        )
    if posture.actuation is not None:
        rates = posture.actuation * posture.coordinate_lengths
        if reduction.motions is not None:
            rates = rates @ reduction.motions
        values = np.linalg.svd(rates, compute_uv=False)
        if len(values) == rates.shape[1] and values[-1] < numerics.NEAR * values[0]:
            motions = np.linalg.svd(rates)[2]
            if reduction.motions is not None:
                motions = motions @ reduction.motions.T
            lost = int(np.sum(values <= numerics.RANK * values[0]))
            weak = lost or int(np.sum(values < numerics.NEAR * values[0]))
            notes.append(
                Note(
                    "type-2-singularity" if lost else "near-type-2-singularity",
                    f"the actuators {'do not' if lost else 'hardly'} hold the mechanism in {weak} "
                    f"direction(s): smallest over largest singular value "
                    f"{values[-1] / values[0]:.2g}",
                    {
                        "singular_values": values.tolist(),
                        "characteristic_length": posture.length,
                        "directions": (motions[-weak:] * posture.coordinate_lengths).tolist(),
                    },
                )
            )
    return notes


def _is_outside(term: Potential) -> bool:
    """Whether a potential is gravity's or a load's: energy that nothing in the mechanism holds."""
    while isinstance(term, Scaled):
        term = term.potential
    return isinstance(term, Gravity | Load)


@dataclass(frozen=True, eq=False)
class PostureStiffness:
    """Everything known about a mechanism's stiffness at one posture.

    Attributes
    ----------
    elastic : ElasticMechanism
        The mechanism with the rest positions that were used.
    q : ndarray (n,)
        Coordinates.
    posture : MechanismPosture
        Kinematics at q.
    evaluation : Evaluation
        Energy, gradient, Hessian in the coordinates.
    reduction : Reduction
        The reduction to the end-effector.
    load : LoadKind
        What the load does while the body moves, and where it acts.
    """

    elastic: ElasticMechanism
    q: Array
    posture: MechanismPosture
    evaluation: Evaluation
    reduction: Reduction
    _notes: tuple[Note, ...]
    load: LoadKind = _DEAD_AT_ORIGIN
    _load_is_given: bool = False

    def __repr__(self) -> str:
        return posture_text(self)

    def _repr_html_(self) -> str:
        return posture_html(self, self.matrices)

    @property
    def pose(self) -> Array:
        """``T_F_M`` (4, 4)."""
        return fixed(self.posture.pose)

    @property
    def wrench(self) -> Array | None:
        """W = dPhi in the body frame; None in an unbalanced posture."""
        return None if self.reduction.force is None else fixed(self.reduction.force)

    @property
    def energy(self) -> float:
        """Potential energy of all that acts: springs, gravity, and loads added as potentials."""
        return self.evaluation.energy

    @cached_property
    def stored_energy(self) -> float:
        """Energy of springs and other potentials, without that of gravity and of loads."""
        terms = self.elastic.terms()
        outside = [t for t in terms if _is_outside(t)]
        if not outside:
            return self.energy
        stored = (t.evaluate(self.posture).energy for t in terms if t not in outside)
        return float(sum(stored, 0.0))

    def motion_under(self, wrench: ArrayLike, change: ArrayLike | None = None) -> Array:
        """Linear motion of all coordinates (n,) under an added wrench (6,) in the body frame.

        ``dq = N (H_N + J_N^T D J_N)^-1 J_N^T dW`` with D = K^X - K^B for another connection X than
        B: J dq is then ``(K^X)^-1 dW``.

        Parameters
        ----------
        wrench : array_like, shape (6,)
            dW, body frame.
        change : array_like, shape (6, 6), optional
            D; zero by default.

        Raises
        ------
        UndefinedError
            In an unbalanced posture, or where a motion costs nothing.
        """
        reduction = self.reduction
        if self.wrench is None:
            state = reduction.states[-1]
            raise UndefinedError(state.message, code=state.code, values=state.values)
        D = None if change is None else checked_matrix(change, "change")
        found = None if reduction.free is None else reduction.free.inverse(D)
        if found is None or reduction.free is None:
            raise UndefinedError("a motion costs nothing: no linear motion", code="no-shares")
        return reduction.free.motion(found.matrix, checked_vector(wrench, 6, "wrench"))

    @property
    def closure_forces(self) -> Array:
        """Forces lam (m,) of the closures on the mechanism, in the order of its residual."""
        return self.reduction.multipliers

    @cached_property
    def matrices(self) -> Mapping[str, Array | None]:
        """K^A, K^B, K^K, K^F as arrays (6, 6), None where one does not exist."""
        K, W = self.reduction.stiffness, self.reduction.force
        if K is None or W is None:
            return NamedArrays(dict.fromkeys("ABKF"))
        A, B, K_K = K - (W @ _FROM_B).reshape(3, 6, 6)
        return NamedArrays({"A": A, "B": B, "K": K_K, "F": self._flat[0]})

    @cached_property
    def compliances(self) -> Mapping[str, Array | None]:
        """Inverses of `matrices`, found without them; C^A, C^B, C^K exist at singularities too.

        ``C^X = J_N (H_N + J_N^T D J_N)^-1 J_N^T`` with D = K^X - K^B, which the load alone makes;
        for C^F the Hessian is that in the chart.
        """
        free, W = self.reduction.free, self.wrench
        if free is None or W is None:
            return NamedArrays(dict.fromkeys("ABKF"))
        found: dict[str, numerics.Inverse | None] = dict.fromkeys(
            "ABKF", self.reduction.compliance_with_error
        )
        if W.any():
            changes = -(W @ _FROM_B).reshape(3, 6, 6)
            found |= {"A": free.compliance(changes[0]), "K": free.compliance(changes[2])}
        _, H, _, _ = self._flat
        if H is not self.evaluation.hessian or W.any() or self.posture.closure is not None:
            found["F"] = None if H is None else free.with_hessian(H).compliance()
        return NamedArrays({n: None if C is None else C.matrix for n, C in found.items()})

    @cached_property
    def is_loaded(self) -> bool:
        """Whether there is a load: one was given, or the springs exert more than rounding."""
        if self.wrench is None or self._load_is_given:
            return self.wrench is not None
        sizes = self.posture.coordinate_lengths
        torque = np.abs(self.posture.motion.jacobian.T @ self.wrench) * sizes
        stiffness = np.abs(self.evaluation.hessian * np.outer(sizes, sizes)).max(
            axis=0, initial=0.0
        )
        stiffness[stiffness == 0.0] = stiffness.max(initial=0.0)  # passive: the others' rounding
        return bool(np.any(torque > numerics.ROUNDING * stiffness))

    @property
    def wrench_is_known(self) -> bool:
        """Whether the joints feel all of W; else the part that the structure carries is open.

        Where the user gave the load, that part is the load's; otherwise it is taken as zero in the
        length-scaled norm.
        """
        return self.wrench is not None and (self.reduction.rank == 6 or self._load_is_given)

    def shown_wrench(self, wrench: Array) -> Array:
        """A wrench (6,) with moment and force set to 0 where they are rounding.

        Rounding is what the springs exert over a turn of `numerics.ROUNDING`, and what is below
        that share of the other half, a force taken over the characteristic length.
        """
        sizes, length = self.posture.coordinate_lengths, self.posture.length
        stiffest = np.abs(self.evaluation.hessian * np.outer(sizes, sizes)).max(initial=0.0)
        scaled = np.abs(wrench) * np.repeat([1.0, length], 3)
        if self._load_is_given:
            stiffest = 0.0
        noise = numerics.ROUNDING * max(float(stiffest), float(scaled.max()))
        return np.where(scaled > noise, wrench, 0.0)

    @cached_property
    def change_by_load(self) -> Array:
        """``K^load - K^B`` (6, 6), zero without a load: exists where no stiffness does, too."""
        W = self.wrench
        if W is None:
            return np.zeros((6, 6))
        return self.load.change(W) - 0.5 * se3.bracket_form(W)

    @cached_property
    def tangent(self) -> Array | None:
        """K^load (6, 6): change of the wrench that must be added, per motion, under the load.

        The derivative of the elastic wrench less that of the load, which behaves as `load` says;
        what `equilibrium` gives as the linear limit of an added load. None where no stiffness
        exists.
        """
        K = self.reduction.stiffness
        return None if K is None or self.wrench is None else K + self.change_by_load

    @cached_property
    def tangent_compliance(self) -> Array | None:
        """Inverse of `tangent`, found as `compliances`; exists at kinematic singularities too."""
        if self.wrench is None or self.reduction.free is None:
            return None
        found = self.reduction.free.compliance(self.change_by_load)
        return None if found is None else found.matrix

    def at(self, T_M_N: ArrayLike | None = None) -> StiffnessInFrame:
        """Matrices, compliances, wrench and tangent in a frame N of the body.

        Parameters
        ----------
        T_M_N : array_like (4, 4), optional
            N in the frame M; default M itself.

        Raises
        ------
        InputError
            If it is not a rigid motion.
        """
        T = _EYE_4 if T_M_N is None else checked_pose(T_M_N, "frame of the body")
        key = T.tobytes()
        if key not in self._frames:
            self._frames[key] = stiffness_in_frame(self, T)
        return self._frames[key]

    @cached_property
    def _frames(self) -> dict[bytes, StiffnessInFrame]:
        """Frames that have been asked for: numbers and picture read the same object."""
        return {}

    @cached_property
    def _flat(self) -> tuple[Array | None, Array | None, Array | None, Note | None]:
        """K^F, its Hessian (n, n), d(chart)/d(twist), and the reason if there is none."""
        rates = self.reduction.rates
        if self.reduction.stiffness is None:
            return None, None, None, None  # the reason for the others is this one's too
        chart = self.posture.chart()
        if isinstance(chart, str):
            return None, None, None, Note("no-chart", chart)
        if rates is None:
            message = f"K^F needs six free motions: there are {self.reduction.freedoms}"
            return None, None, None, Note("no-chart", message)
        if chart is OWN_COORDINATES:  # nonsingular, as `rates` exists
            H = self.evaluation.hessian
            return rates.T @ H @ rates, H, rates, None
        to_chart = chart.jacobian @ rates
        values = np.linalg.svd(to_chart * self._natural, compute_uv=False)
        if not numerics.is_regular(values):
            note = Note(
                "type-2-singularity",
                "the actuated coordinates do not determine the pose here",
                {"singular_values": values.tolist()},
            )
            return None, None, None, note
        H = self._hessian_in(chart, to_chart, self.evaluation)
        return rates.T @ H @ rates, H, to_chart, None

    @cached_property
    def _natural(self) -> Array:
        """Natural sizes of the six twist components."""
        length = self.posture.length
        return np.array([1.0, 1.0, 1.0, length, length, length])

    def _hessian_in(self, chart: Map, to_chart: Array, energy: Evaluation) -> Array:
        """Hessian (n, n) in the chart's coordinates y, carried to those of the mechanism.

        The reduction with y as the output, mu its force: K^F = M^T (H + lam c'' - mu y'') M with
        M the coordinate rates per twist.
        """
        rates, closure = self.reduction.rates, self.posture.closure
        if rates is None:  # `_flat` gave the reason
            raise UndefinedError("the coordinates are no chart here", code="no-chart")
        mu = np.linalg.solve(to_chart.T, rates.T @ energy.gradient)
        H = energy.hessian - chart.curvature(mu)
        if closure is not None:
            balance = chart.jacobian.T @ mu - energy.gradient
            lam = np.linalg.lstsq(closure.jacobian.T, balance, rcond=numerics.RANK)[0]
            H = H + closure.curvature(lam)
        return H

    @cached_property
    def jacobian(self) -> Array | None:
        """Body Jacobian of the joint coordinates; for a platform d(pose)/d(leg lengths)."""
        if not self.posture.coordinates_are_pose:
            return fixed(self.posture.motion.jacobian)
        chart = self.posture.chart()
        if isinstance(chart, str):
            return None
        if self._flat[2] is None:  # else it has been seen to be regular
            values = np.linalg.svd(chart.jacobian * self._natural, compute_uv=False)
            if not values[-1] > numerics.RANK * values[0]:
                return None
        return fixed(np.linalg.inv(chart.jacobian))

    @cached_property
    def notes(self) -> tuple[Note, ...]:
        """What was assumed, and why something does not exist."""
        reasons = [] if self._flat[3] is None else [self._flat[3]]
        K, C = self.reduction.stiffness, self.reduction.compliance_with_error
        if C is not None and C.error > numerics.TELLING:
            reasons.append(
                Note(
                    "lost-digits",
                    "springs and load nearly cancel along a motion: the compliance is known to a "
                    f"relative error of about {C.error:.1g}",
                    {"matrix": "compliance", "relative_error": C.error},
                )
            )
        if K is not None and C is not None:
            error = self._error_of_soft_directions(K, C.matrix)
            if error > numerics.TELLING:
                is_near = numerics.ratio(self.reduction.singular_values) < numerics.NEAR
                words = "so near to a singularity" if is_near else "with springs so far apart"
                known = "not at all"
                if error < 1:
                    known = f"to a relative error of about {error:.1g} only"
                reasons.append(
                    Note(
                        "lost-digits",
                        f"{words} the stiffness matrix holds the softer directions {known}; the "
                        "compliance, and what is free, hold them",
                        {"matrix": "stiffness", "relative_error": error},
                    )
                )
        if K is not None and C is None:
            values = numerics.eigenvalues(K * self._natural * self._natural[:, None])
            reasons.append(
                Note(
                    "singular-stiffness",
                    "the stiffness matrix is singular: a motion costs nothing, or nothing that can "
                    "be told from the rounding of the stiffest springs, and there is no compliance "
                    "matrix",
                    {"eigenvalues": values.tolist(), "characteristic_length": self.posture.length},
                )
            )
        return (*self._notes, *reasons)

    def _error_of_soft_directions(self, K: Array, C: Array) -> float:
        """Relative error of what the digits of K say about its softest direction."""
        found = numerics.invert(K)
        if found is not None:
            return found.error
        scale = self._natural * self._natural[:, None]
        values = numerics.eigenvalues(K * scale, C / scale)
        return numerics.EPSILON * float(numerics.condition(values))

    def tensor(self, connection: str | Connection = "B") -> StiffnessTensor:
        """Stiffness tensor under a named connection ("A", "B", "K", "+", "F") or any other.

        "load" is the tangent under the load.

        Raises
        ------
        UnknownNameError
            For another name.
        UndefinedError
            If it does not exist at this posture, with the state's code and numbers.
        """
        if isinstance(connection, str) and connection not in (known := (*NAMED, "F", "load")):
            raise UnknownNameError("connection", connection, known)
        K, W = self.reduction.stiffness, self.reduction.force
        if K is None or W is None:
            state = self.reduction.states[-1]
            raise UndefinedError(state.message, code=state.code, values=state.values)
        frame, units = self.elastic.mechanism.frame, self.elastic.units
        named = connection if isinstance(connection, str) else connection.name
        C = self.compliances.get(named)
        if connection == "+" and self.compliances["A"] is not None:
            C = self.compliances["A"].T
        base = StiffnessTensor(
            K, BI_INVARIANT, W, self.pose, frame, units, inverse=self.compliances["B"]
        )
        if connection == "B":
            return base
        if connection == "F":
            F, _, _, note = self._flat
            if F is None:
                message = note.message if note else "K^F does not exist here"
                raise UndefinedError(message, code=note.code if note else "no-chart")
            return StiffnessTensor(F, self.flat_connection(), W, self.pose, frame, units, inverse=C)
        moved = base.to_connection(self.load.connection if connection == "load" else connection)
        return moved if C is None or not isinstance(connection, str) else replace(moved, inverse=C)

    def flat_connection(self) -> Connection:
        """The flat connection of the chart at this posture, [ZK]_ eq. 47, from six probe wrenches.

        ``Gamma[i, j, k] W_k = K^A - K^F`` is linear in W and holds for any potential: each basis
        wrench gives one slice.
        """
        _, _, to_chart, note = self._flat
        chart, rates = self.posture.chart(), self.reduction.rates
        if to_chart is None or rates is None or isinstance(chart, str):
            message = note.message if note else str(chart)
            raise UndefinedError(message, code=note.code if note else "no-chart")
        symbols = np.empty((6, 6, 6))
        motion = self.posture.motion
        for k, w in enumerate(_EYE):
            # The linear energy w . log(pose) has gradient J^T w, K^B = 0 and the curvature of J.
            probe = Evaluation(0.0, motion.jacobian.T @ w, motion.curvature(w))
            K_F = rates.T @ self._hessian_in(chart, to_chart, probe) @ rates
            symbols[:, :, k] = -0.5 * se3.bracket_form(w) - K_F
        return Connection(
            "F", symbols, "Hessian in the joint coordinates", left_invariant=False, _flat=True
        )

    @property
    def A(self) -> StiffnessTensor:  # noqa: N802
        """K^A: wrench components in the moving frame (Cartan's minus connection)."""
        return self.tensor("A")

    @property
    def B(self) -> StiffnessTensor:  # noqa: N802
        """K^B: bi-invariant connection; the symmetric part of K^A."""
        return self.tensor("B")

    @property
    def K(self) -> StiffnessTensor:  # noqa: N802
        """K^K: kinematic connection; force components in inertial directions."""
        return self.tensor("K")

    @property
    def F(self) -> StiffnessTensor:  # noqa: N802
        """K^F: flat connection of the joint coordinates, J^-T (Hess Phi) J^-1."""
        return self.tensor("F")

    def load_as_dict(self) -> dict[str, Any]:
        """What the load does, where it acts, and the tangent that follows, as plain data."""
        K, C = self.tangent, self.tangent_compliance
        return {
            "kind": self.load.kind,
            "at": list(self.load.at),
            "meaning": self.load.words,
            "stiffness": None if K is None else K.tolist(),
            "compliance": None if C is None else C.tolist(),
        }

    def as_dict(self) -> dict[str, Any]:
        """The object printed by ``cartstiff analyse --json``."""

        def plain(array: Array | None) -> list[Any] | None:
            return None if array is None else array.tolist()

        return {
            "schema": SCHEMA,
            "mechanism": {
                "name": self.elastic.name,
                "kind": self.elastic.mechanism.kind,
                "joints": list(self.elastic.names),
            },
            "frame": self.elastic.mechanism.frame,
            "order": se3.ANGULAR_LINEAR,
            "units": self.elastic.units.as_dict(),
            "q": self.q.tolist(),
            "pose": self.pose.tolist(),
            "jacobian": plain(self.jacobian),
            "wrench": plain(self.wrench),
            "load": self.load_as_dict(),
            **weighed(self.elastic).as_dict(),
            "energy": None if np.isnan(self.energy) else self.energy,
            "stored_energy": None if np.isnan(self.stored_energy) else self.stored_energy,
            "stiffness": {name: plain(K) for name, K in self.matrices.items()},
            "compliance": {name: plain(C) for name, C in self.compliances.items()},
            "notes": [note.as_dict() for note in self.notes],
        }
