r"""Everything known about a mechanism's stiffness at one posture."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from cartstiff import numerics
from cartstiff.arrays import NamedArrays, checked_matrix, checked_pose, checked_vector, fixed
from cartstiff.errors import UndefinedError, UnknownNameError
from cartstiff.geometry.connections import NAMED, Connection
from cartstiff.geometry.se3 import Array
from cartstiff.lazily import cached_property
from cartstiff.mechanisms.contract import MechanismPosture, Units
from cartstiff.mechanisms.elastic import ElasticMechanism
from cartstiff.notebook import ShownInLines
from cartstiff.notes import Note
from cartstiff.potentials.contract import Evaluation
from cartstiff.stiffness import inverses, posture_notes
from cartstiff.stiffness.applied_load import DEAD_AT_ORIGIN, LoadKind
from cartstiff.stiffness.flat_chart import FlatChart, flat_chart, flat_connection, pose_by_chart
from cartstiff.stiffness.in_frame import StiffnessInFrame, stiffness_in_frame
from cartstiff.stiffness.named_tensor import named_tensor
from cartstiff.stiffness.reduction import Reduction
from cartstiff.stiffness.rounding import is_felt, shown_wrench
from cartstiff.stiffness.showing import SCHEMA as SCHEMA
from cartstiff.stiffness.showing import load_dict, posture_dict, posture_lines
from cartstiff.stiffness.tensor import Compliance, StiffnessTensor

#: What a load is taken for where nothing else is said.

_EYE_4 = np.eye(4)


@dataclass(frozen=True, eq=False, repr=False)
class PostureStiffness(ShownInLines):
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
    _notes: tuple[Note, ...] | None = None
    load: LoadKind = DEAD_AT_ORIGIN
    _load_is_given: bool = False
    #: The mechanism before its open rest positions were chosen; None where that is `elastic`.
    _asked: ElasticMechanism | None = None

    def _lines(self) -> list[str]:
        return posture_lines(self)

    def _repr_html_(self) -> str:
        lines = super()._repr_html_()
        return lines if self.matrices["B"] is None else lines + self.B._repr_html_()

    @property
    def frame(self) -> str:
        """Name of the body frame M."""
        return self.elastic.mechanism.frame

    @property
    def units(self) -> Units:
        """Units of every number."""
        return self.elastic.units

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
        inner, outside = self.elastic.parted_terms()
        each = (term.evaluate(self.posture).energy for term in inner)
        return float(sum(each, 0.0)) if outside else self.energy

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
            raise reduction.undefined()
        D = None if change is None else checked_matrix(change, "change")
        inverse = None if reduction.free is None else reduction.free.inverse(D)
        if inverse is None or reduction.free is None:
            raise UndefinedError("a motion costs nothing: no linear motion", code="no-shares")
        return reduction.free.motion(inverse.matrix, checked_vector(wrench, 6, "wrench"))

    @property
    def closure_forces(self) -> Array:
        """Forces lam (m,) of the closures on the mechanism, in the order of its residual."""
        return fixed(self.reduction.multipliers)

    @cached_property
    def matrices(self) -> Mapping[str, Array | None]:
        """K^A, K^B, K^K, K^F (6, 6), None where one does not exist; "load" is the `tangent`."""
        B, A, K, load, *F = [None] * 4 if self._every is None else self._every
        return NamedArrays({"A": A, "B": B, "K": K, "F": F[0] if F else None}, {"load": load})

    @cached_property
    def _every(self) -> Array | None:
        """K^B, K^A, K^K, K^load and, where it exists, K^F (4 or 5, 6, 6); None without K^B."""
        known = self._changes, self._flat.stiffness, self.posture.length
        return inverses.every_matrix(self.reduction, *known)

    @cached_property
    def _changes(self) -> Array:
        """K^X - K^B (3, 6, 6) for X = A, K, load: zero without a load."""
        return np.zeros((3, 6, 6)) if self.wrench is None else self.load.changes(self.wrench)

    @cached_property
    def compliances(self) -> Mapping[str, Array | None]:
        """Inverses of `matrices`, found without them; C^A, C^B, C^K exist at singularities too.

        ``C^X = J_N (H_N + J_N^T D J_N)^-1 J_N^T`` with D = K^X - K^B, which the load alone makes;
        for C^F the Hessian is that in the chart.
        """
        # Not by way of this object: in a circle it would stay until circles are looked for.
        under_load: Any = self._inverses.load
        if under_load is None:
            under_load = partial(inverses.compliance_under, self.reduction, self._changes[2])
        return NamedArrays(self._inverses.matrices, {"load": under_load})

    @cached_property
    def _inverses(self) -> inverses.Compliances:
        """`compliances` with their error."""
        if self._plain_inverses is not None:
            return self._plain_inverses
        chart = self._flat.hessian
        own = chart is self.evaluation.hessian and self.posture.closure is None
        return inverses.inverses(self.reduction, self._changes[:2], chart, own)

    @cached_property
    def _plain_inverses(self) -> inverses.Compliances | None:
        return inverses.plain_inverses(self.reduction, self._every, self._flat.hessian)

    @cached_property
    def is_loaded(self) -> bool:
        """Whether there is a load: one was given, or the springs exert more than rounding."""
        if self.wrench is None or self._load_is_given or not any(self.wrench.tolist()):
            return self.wrench is not None and self._load_is_given
        J, sizes = self.posture.motion.jacobian, self.posture.coordinate_lengths
        return is_felt(self.wrench, J, self.evaluation.hessian, sizes)

    @property
    def wrench_is_known(self) -> bool:
        """Whether the joints feel all of W; else the part that the structure carries is open.

        Of a given load it is the load's; else it is taken as zero in the length-scaled norm.
        """
        return self.wrench is not None and (self.reduction.rank == 6 or self._load_is_given)

    def shown_wrench(self, wrench: Array) -> Array:
        """A wrench (6,) with zeros for moment and force that are rounding, of springs or halves."""
        H = None if self._load_is_given or not any(wrench.tolist()) else self.evaluation.hessian
        return shown_wrench(wrench, H, self.posture.coordinate_lengths, self.posture.length)

    @property
    def change_by_load(self) -> Array:
        """``K^load - K^B`` (6, 6), zero without a load: exists where no stiffness does, too."""
        return fixed(self._changes[2])

    @property
    def tangent(self) -> Array | None:
        """K^load (6, 6): change of the wrench that must be added, per motion, under the load.

        The derivative of the elastic wrench less that of the load, which behaves as `load` says:
        the linear limit of `equilibrium`. None where no stiffness exists.
        """
        return None if self._every is None else self._every[3]

    @cached_property
    def tangent_compliance(self) -> Array | None:
        """Inverse of `tangent`, found as `compliances`; exists at kinematic singularities too."""
        return self.compliances["load"]

    @cached_property
    def inverse_of_symmetric_tangent(self) -> Array | None:
        """Inverse of the symmetric part of `tangent`; None if there is none."""
        C, change = self.compliances["B"], self.change_by_load
        return C if C is None else numerics.inverse_of_sum(C, 0.5 * (change + change.T))

    @property
    def compliance(self) -> Compliance:
        """Compliance under the load, C^load: motion per wrench that is added; unloaded, C^B too.

        It exists at kinematic singularities and for fewer than six joints as well.

        Raises
        ------
        UndefinedError
            Where a motion costs nothing, or nothing balances the posture.
        """
        C = self.tangent_compliance
        if C is None:
            raise UndefinedError(
                "no compliance exists here: a motion costs nothing, or nothing "
                "balances the posture",
                code="no-compliance",
            )
        return Compliance(C, self.load.connection, self.pose, self.frame, self.units)

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
        key = None if T_M_N is None else T.tobytes()
        if key not in self._frames:
            self._frames[key] = stiffness_in_frame(self, T)
        return self._frames[key]

    @cached_property
    def _frames(self) -> dict[bytes | None, StiffnessInFrame]:
        """Frames that have been asked for: numbers and picture read the same object."""
        return {}

    @cached_property
    def _flat(self) -> FlatChart:
        return flat_chart(self.posture, self.evaluation, self.reduction, self._natural)

    @cached_property
    def _natural(self) -> Array:
        """Natural sizes of the six twist components."""
        length = self.posture.length
        return np.array([1.0, 1.0, 1.0, length, length, length])

    @cached_property
    def jacobian(self) -> Array | None:
        """Body Jacobian of the joint coordinates; for a platform d(pose)/d(leg lengths)."""
        if not self.posture.coordinates_are_pose:
            return fixed(self.posture.motion.jacobian)
        J = pose_by_chart(self.posture, self._flat, self._natural)
        return None if J is None else fixed(J)

    @cached_property
    def notes(self) -> tuple[Note, ...]:
        """What was assumed, and why something does not exist."""
        reason = () if self._flat.note is None else (self._flat.note,)
        return (*self.notes_on_posture, *reason, *self.notes_on_digits(lambda: self._inverses.B))

    def notes_on_digits(self, compliance: Callable[[], numerics.Inverse | None]) -> list[Note]:
        """Those of the `notes` on lost digits, from a way to C^B with its error."""
        plain = self._plain_inverses
        parts = self.elastic, self.posture, self.evaluation, self.reduction, self.notes_on_posture
        error = posture_notes.error_of_chosen_forces(*parts, plain and plain.matrices["B"])
        if error > numerics.REPORTED_ERROR and not self.is_loaded:
            error = 0.0
        if (
            error <= numerics.REPORTED_ERROR
            and plain
            and (plain.has_load or not self._load_is_given)
        ):
            return []
        change = self.change_by_load if self._load_is_given else None
        known = compliance(), self._natural, change, error
        return posture_notes.notes_on_digits(self.reduction, *known)

    @cached_property
    def notes_on_posture(self) -> tuple[Note, ...]:
        """The `notes` without those on matrices."""
        known, find = self._notes, posture_notes.notes_on_posture
        return find(self.elastic, self.posture, self.reduction) if known is None else known

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
        known = (*NAMED, "F", "load")
        if not isinstance(connection, Connection) and connection not in known:
            raise UnknownNameError("connection", connection, known)
        K, W = self.reduction.stiffness, self.reduction.force
        if K is None or W is None:
            raise self.reduction.undefined()
        return named_tensor(self, K, W, connection)

    def flat_connection(self) -> Connection:
        """The flat connection of the chart at this posture, [ZK]_ eq. 47.

        Raises
        ------
        UndefinedError
            Where K^F does not exist, with the reason.
        """
        return flat_connection(self.posture, self.reduction, self._flat)

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
        return load_dict(self)

    def as_dict(self) -> dict[str, Any]:
        """The object printed by ``cartstiff analyse --json``."""
        return posture_dict(self)
