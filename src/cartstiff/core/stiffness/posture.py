r"""Stiffness, compliance and load at one posture, in M and in any frame N of the body.

With Ad = Ad(T_M_N), all of them transform as tensors:

    K' = Ad^T K Ad,     C' = Ad^-1 C Ad^-T,     W' = Ad^T W

The connections are those in M: K^K belongs to M's origin, and the tangent under a load to
the point at which the load acts. K^K *recomputed* for N's origin would belong to no load;
`StiffnessTensor.to_frame` computes it for comparison.
"""

from __future__ import annotations

from collections.abc import Callable, Container, Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache, partial
from itertools import zip_longest
from typing import TYPE_CHECKING, Any, ClassVar, Literal, Protocol, cast

import numpy as np
from numpy.typing import ArrayLike

from cartstiff.core import numerics
from cartstiff.core.arrays import (
    Array,
    NamedArrays,
    checked_matrix,
    checked_pose,
    checked_vector,
    fixed,
    read_only,
)
from cartstiff.core.errors import UndefinedError, UnknownNameError
from cartstiff.core.figures import new_figure
from cartstiff.core.geometry import se3
from cartstiff.core.geometry.connections import BI_INVARIANT, NAMED, Connection
from cartstiff.core.lazily import cached_property
from cartstiff.core.matrix_names import OF_MANY
from cartstiff.core.mechanisms.contract import Mechanism, MechanismPosture
from cartstiff.core.mechanisms.elastic import ElasticMechanism
from cartstiff.core.mechanisms.gravity_loads import GravityLoads, gravity_loads
from cartstiff.core.mechanisms.limits import tensions_of
from cartstiff.core.mechanisms.preload import preload_notes
from cartstiff.core.notes import Note
from cartstiff.core.potentials.contract import Evaluation
from cartstiff.core.results import LabelledResult
from cartstiff.core.stiffness import posture_notes
from cartstiff.core.stiffness.applied_load import DEAD_AT_ORIGIN, LoadKind
from cartstiff.core.stiffness.drives import Drive, drives_of
from cartstiff.core.stiffness.flat_chart import (
    FlatChart,
    flat_chart,
    flat_connection,
)
from cartstiff.core.stiffness.forces import DriveForce, forces_of, rigid_torques
from cartstiff.core.stiffness.reduction import Reduction
from cartstiff.core.stiffness.rounding import (
    exceeds_roundoff,
    shown_wrench,
    without_cancelled,
)
from cartstiff.core.stiffness.tensor import (
    BlockUnits,
    Compliance,
    StiffnessTensor,
    codes_of,
    format_matrix,
    matrix_html,
    numbers_text,
)
from cartstiff.core.stiffness.wrenches import CarriedWrench, wrenches_at
from cartstiff.core.units import Units

if TYPE_CHECKING:
    from cartstiff.core.stiffness.task_axes import TaskAxes

SCHEMA = "cartstiff/1"
#: Outputs that are arrays besides the matrices.
_ARRAYS = ("pose", "jacobian", "wrench", "energy", "tensions", "torques")


#: Makes the usual value of a field.
_none: Callable[[], None] = type(None)


@dataclass(frozen=True, eq=False)
class StiffnessInFrame:
    """Stiffness, compliance and load in a frame N of the body; arrays are read-only.

    Attributes
    ----------
    T_M_N : ndarray (4, 4)
        The frame N in the frame M.
    pose : ndarray (4, 4)
        ``T_F_N``.
    wrench : ndarray (6,) or None
        W about N's origin in N's axes; None in an unbalanced posture.
    load : LoadKind
        Behaviour of the load and its point of application, in N.
    matrices, compliances : mapping of str to ndarray (6, 6) or None
        By name: "A", "B", "K", "F", "+", and "load", the tangent under the load.
    """

    T_M_N: Array
    pose: Array
    wrench: Array | None
    load: LoadKind
    matrices: Mapping[str, Array | None]
    compliances: Mapping[str, Array | None]
    _of_symmetric_tangent: Callable[[], Array | None]

    def pair(self, name: str, others: str) -> tuple[Array | None, Array | None]:
        """Symmetric matrices K and C, inverse to each other,
        from which principal values follow.

        With the other freedoms "held" K is the symmetric part of the stiffness: ``u^T K
        u`` is the force along u per motion along u. With them "free" C is the symmetric
        part of the compliance: ``u^T C u`` is the motion along u per force along u. Where
        the stiffness is asymmetric, as the tangent under a dead moment, these are not
        each other's inverse, and each reading has its own pair.

        Parameters
        ----------
        name : str
            A name of `matrices`.
        others : {"held", "free"}
            State of the other freedoms.

        Returns
        -------
        K, C : ndarray (6, 6) or None
            None if there is none.
        """
        K, C = self.matrices[name], self.compliances[name]
        if others == "held":
            C = self.inverse_of_symmetric_part(name)
            K, C = (None if M is None else 0.5 * (M + M.T) for M in (K, C))
            return K, C
        return inverse_pair(K, C)

    def inverse_of_symmetric_part(self, name: str) -> Array | None:
        """Inverse (6, 6) of the symmetric part of a stiffness matrix;
        None if there is none.
        """
        if name == "load":
            return self._inverse_of_symmetric_tangent
        return self.compliances["B" if name in ("A", "+") else name]

    @cached_property
    def _inverse_of_symmetric_tangent(self) -> Array | None:
        C = self._of_symmetric_tangent()
        if C is None or self.T_M_N.tobytes() == _HERE:
            return C
        back = se3.adjoint_of_inverse(self.T_M_N)
        return np.asarray(back @ C @ back.T)


def inverse_pair(K: Array | None, C: Array | None) -> tuple[Array | None, Array | None]:
    """Symmetric part of a compliance C, and its inverse:
    that of K unless they are asymmetric.
    """
    if C is None:
        return (None if K is None else 0.5 * (K + K.T)), None
    flexible = 0.5 * (C + C.T)
    if K is None:
        return None, flexible
    if numerics.is_about_symmetric(K) and numerics.is_about_symmetric(C):
        return 0.5 * (K + K.T), flexible
    inverse = numerics.invert(flexible)
    return (None if inverse is None else inverse.matrix), flexible


def _turned(matrices: Mapping[str, Array | None], motion: Array | None) -> NamedArrays:
    """``A^T M A`` of each matrix that exists (A = I if None).

    Adds the transpose of "A" as "+".
    """
    turned = dict(matrices)
    if motion is not None:
        known = {n: M for n, M in matrices.items() if M is not None}
        stack = fixed(motion.T @ np.array([*known.values()]).reshape(-1, 6, 6) @ motion)
        turned.update(zip(known, stack, strict=True))
    minus = turned["A"]
    return NamedArrays.of_fixed({**turned, "+": None if minus is None else minus.T}, {})


def stiffness_in_frame(result: PostureStiffness, T_M_N: Array) -> StiffnessInFrame:
    """The stiffness of a posture in the frame N; see `PostureStiffness.at`."""
    pose, W, load = result.pose, result.wrench, result.load
    forth, back = None, None
    if T_M_N.tobytes() != _HERE:
        forth, back = se3.adjoint(T_M_N), se3.adjoint_of_inverse(T_M_N)
        pose, W = pose @ T_M_N, None if W is None else forth.T @ W
        load = LoadKind(load.kind, tuple(T_M_N[:3, :3].T @ (load.at - T_M_N[:3, 3])))
    return StiffnessInFrame(
        read_only(T_M_N),
        fixed(pose),
        None if W is None else fixed(W),
        load,
        _turned({**result.matrices, "load": result.tangent}, forth),
        _turned(
            {**result.compliances, "load": result.tangent_compliance},
            None if back is None else back.T,
        ),
        partial(getattr, result, "inverse_of_symmetric_tangent"),
    )


@lru_cache(maxsize=8)
def _seen_from(result: PostureStiffness, T_M_N: bytes) -> StiffnessInFrame:
    """Cache of `PostureStiffness.at`: numbers and picture read the same object.

    It is not kept in the posture: a circle would wait for the garbage collector.
    """
    return stiffness_in_frame(result, np.frombuffer(T_M_N).reshape(4, 4))


# The bytes of the frame M in itself.
_HERE = np.eye(4).tobytes()


class Later(Protocol):
    """What finds attributes of a posture whose numbers are known, when they are read.

    It has `notes`, `notes_on_posture` and `motions_of_closed` at least.
    """

    @property
    def names(self) -> Container[str]:
        """The attributes that are found later."""

    def find(self, name: str, posture: PostureStiffness) -> Any:
        """The attribute of these `names`."""


@dataclass(frozen=True, eq=False, repr=False)
class PostureStiffness(LabelledResult):
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
        Behaviour of the load while the body moves, and its point of application.
    state : str
        "regular", or the code of the posture's last state; of a program's posture as of
        `cartstiff.Postures`.
    is_plain : bool
        Whether a `cartstiff.Program` computed its outputs, as the posture is well inside
        the regular ones.
    """

    command: ClassVar = "analyse"

    elastic: ElasticMechanism
    q: Array
    posture: MechanismPosture
    evaluation: Evaluation
    reduction: Reduction
    # The class has no values itself, so that `of_numbers` may leave each of them out.
    _notes: tuple[Note, ...] | None = field(default_factory=_none)
    load: LoadKind = field(default_factory=lambda: DEAD_AT_ORIGIN)
    _load_is_given: bool = field(default_factory=bool)
    #: The mechanism before its open rest positions were chosen; None if that is
    #: `elastic`.
    _asked: ElasticMechanism | None = field(default_factory=_none)
    #: State before the load, if that of `elastic_as_given` is another.
    _before_load: Literal["balanced", "given", "partly"] | None = field(
        default_factory=_none
    )
    #: Whether a given wrench determined the rest positions.
    _rest_is_chosen: bool = field(default_factory=bool)

    is_plain: ClassVar[bool] = False
    #: What finds the attributes that `of_numbers` leaves until they are read.
    _later: ClassVar[Later | None] = None
    #: Outputs of a program by name.
    _outputs: ClassVar[Mapping[str, Array]] = {}

    def __post_init__(self) -> None:
        object.__setattr__(self, "q", fixed(self.q))

    @classmethod
    def of_numbers(
        cls, known: Mapping[str, Any], later: Later | None = None
    ) -> PostureStiffness:
        """A regular posture some of whose attributes are `known`.

        `later` finds others when they are first read.
        """
        own = cls.__new__(cls)
        vars(own).update(known, _later=later)
        return own

    if not TYPE_CHECKING:

        def __getattr__(self, name):
            """A field that is found when it is first read; an output of a program."""
            if name[0] != "_" and name in self._outputs:
                return self._outputs[name]
            later = vars(self).get("_later")
            if later is None or name not in later.names:
                raise AttributeError(f"{type(self).__name__} has no attribute {name!r}")
            value = vars(self)[name] = later.find(name, self)
            return value

    def __getitem__(self, name: str) -> Array:
        """An output of `cartstiff.analyse_many`, or of the program, by its name.

        "K" is short for "stiffness_K". NaN where it does not exist.
        """
        if name in OF_MANY:
            name = f"stiffness_{name}"
        if name in self._outputs:
            return self._outputs[name]
        kind, _, letter = name.partition("_")
        if name in _ARRAYS:
            found = getattr(self, name)
        elif letter in OF_MANY and kind in ("stiffness", "compliance"):
            found = (self.matrices if kind == "stiffness" else self.compliances)[letter]
        else:
            raise UnknownNameError("output", name, (*_ARRAYS, *OF_MANY))
        if found is None:
            return np.full(() if name in _ARRAYS else (6, 6), np.nan)
        return np.asarray(found)

    @cached_property
    def state(self) -> str:
        """Code of the posture's last state, or "regular"."""
        states = self.reduction.states
        return states[-1].code if states else "regular"

    def _lines(self) -> list[str]:
        elastic, W = self.elastic, self.wrench
        exists = [name for name, K in self.matrices.items() if K is not None]
        load = "none that balances"
        if W is not None:
            load = f"{numbers_text(W)} (moment, force; body axes)"
        return [
            f"Stiffness of {elastic.name} ({elastic.mechanism.kind}) at "
            f"{elastic.mechanism.frame}",
            f"  q        {numbers_text(self.q)}",
            f"  load     {load}",
            "  matrices "
            + (", ".join(f"K^{name}" for name in exists) or "none exists here")
            + f" in {elastic.units.force} and {elastic.units.length}: .A .B .K .F, "
            ".matrices",
            f"  notes    {codes_of(self.notes)}",
            *self._tangent_text().splitlines(),
        ]

    def _tangent_text(self) -> str:
        """The tangent where a load changes the stiffness, as `StiffnessTensor`
        prints matrices.
        """
        if self.tangent is None or not self.is_loaded:
            return ""
        (a, b), (c, d) = self._tangent_units
        units = [f"[{a} | {b}]"] * 3 + [f"[{c} | {d}]"] * 3
        title = f"K under the load (.tangent) in {self.frame}, order {se3.ANGULAR_LINEAR}"
        return format_matrix(self.tangent, units, title)

    @property
    def _tangent_units(self) -> BlockUnits:
        names = self.units.blocks
        return (names["rr"], names["rt"]), (names["tr"], names["tt"])

    def plot(self, ax: Any = None) -> Any:
        """Draw how far M moves under a unit force of any direction, in the planes of its
        axes.

        The curves are the outlines of the ellipsoid of all C f, f a unit force and C the
        translational block of `compliance`; all other freedoms are free.

        Parameters
        ----------
        ax : matplotlib.axes.Axes, optional
            Whose place the picture takes; default a figure of its own.

        Returns
        -------
        matplotlib.figure.Figure

        Raises
        ------
        UndefinedError
            Where this compliance does not exist.
        MissingDependencyError
            Without matplotlib.
        """
        block = self.compliance.matrix[3:, 3:]
        squares = block @ block.T
        angle = np.linspace(0.0, 2.0 * np.pi, 181)
        figure = new_figure(10.0, 3.8, self.elastic.springs_in_doubt, ax=ax)
        for axis, plane in zip(
            figure.subplots(1, 3), ([0, 1], [0, 2], [1, 2]), strict=True
        ):
            values, vectors = np.linalg.eigh(squares[np.ix_(plane, plane)])
            outline = vectors * np.sqrt(values.clip(0.0))
            axis.plot(*(outline @ [np.cos(angle), np.sin(angle)]))
            axis.set_aspect("equal", adjustable="datalim")
            unit = f"{self.units.length}/{self.units.force}"
            labels = (f"{'xyz'[i]} of M [{unit}]" for i in plane)
            axis.set(**dict(zip(("xlabel", "ylabel"), labels, strict=True)))
            axis.ticklabel_format(scilimits=(-3, 3))
        title = f"{self.elastic.name}: displacement of M under a unit force"
        if not numerics.is_never_negative(block):
            title += " (indefinite: M moves against some forces)"
        figure.suptitle(title)
        return figure

    def _tables(self) -> str:
        if self.tangent is None:
            return ""
        if not self.is_loaded:
            return self.B._repr_html_()
        title = "K under the load"
        return matrix_html(self.tangent, self._tangent_units, title, se3.ANGULAR_LINEAR)

    @property
    def frame(self) -> str:
        """Name of the body frame M."""
        return self.mechanism.frame

    @property
    def units(self) -> Units:
        """Units of every number."""
        return self.elastic_as_given.units

    @cached_property
    def pose(self) -> Array:
        """Pose ``T_F_M`` (4, 4)."""
        return fixed(self.posture.pose)

    @cached_property
    def wrench(self) -> Array | None:
        """Wrench W = dPhi (6,) in the body frame; None in an unbalanced posture."""
        return None if self.reduction.force is None else fixed(self.reduction.force)

    @cached_property
    def energy(self) -> float:
        """Potential energy of all that acts: springs, gravity,
        and loads added as potentials.
        """
        return self.evaluation.energy

    @cached_property
    def stored_energy(self) -> float:
        """Energy of springs and other potentials, without that of gravity
        and of loads.
        """
        inner, outside = self.elastic.parted_terms()
        each = (term.evaluate(self.posture).energy for term in inner)
        return float(sum(each, 0.0)) if outside else self.energy

    def motion_under(self, wrench: ArrayLike, change: ArrayLike | None = None) -> Array:
        """Linear motion of all coordinates (n,) under an added wrench (6,) in the body
        frame.

        By (5) of `cartstiff.core.stiffness.reduction`, ``dq = N (H_N + J_N^T D J_N)^-1
        J_N^T dW`` with D = K^X - K^B for another connection X than B: J dq is then
        ``(K^X)^-1 dW``.

        Parameters
        ----------
        wrench : array_like, shape (6,)
            dW, body frame.
        change : array_like, shape (6, 6), optional
            Difference D of two stiffnesses; zero by default.

        Raises
        ------
        UndefinedError
            In an unbalanced posture, or if a motion costs no energy.
        InputError
            For another shape.
        """
        reduction = self.reduction
        if self.wrench is None:
            raise reduction.undefined()
        D = None if change is None else checked_matrix(change, "change")
        inverse = None if reduction.free is None else reduction.free.inverse(D)
        if inverse is None or reduction.free is None:
            raise UndefinedError(
                "a motion costs nothing: no linear motion", code="no-shares"
            )
        return reduction.free.motion(inverse.matrix, checked_vector(wrench, 6, "wrench"))

    @property
    def closure_forces(self) -> Array:
        """Forces lam (m,) of the closures on the mechanism,
        in the order of its residual.
        """
        return fixed(self.reduction.multipliers)

    @cached_property
    def matrices(self) -> Mapping[str, Array | None]:
        """K^A, K^B, K^K, K^F (6, 6), None if one does not exist.

        "load" is the `tangent`.
        """
        B, A, K, load, *F = [None] * 4 if self._every is None else self._every
        return NamedArrays(
            {"A": A, "B": B, "K": K, "F": F[0] if F else None}, {"load": load}
        )

    @cached_property
    def _every(self) -> Array | None:
        """K^B, K^A, K^K, K^load and, if it exists, K^F (4 or 5, 6, 6);
        None without K^B.
        """
        K, K_F = self.reduction.stiffness, self._flat.stiffness
        if K is None or self.wrench is None:
            return None
        every = np.array([K] * 4 if K_F is None else [*[K] * 4, K_F])
        if self._changes.any():
            every[1:4] = without_cancelled(
                K + self._changes, K, self._changes, 1 / self._natural
            )
        every.flags.writeable = False
        return every

    @cached_property
    def _changes(self) -> Array:
        """K^X - K^B (3, 6, 6) for X = A, K, load: zero without a load."""
        return (
            np.zeros((3, 6, 6)) if self.wrench is None else self.load.changes(self.wrench)
        )

    @cached_property
    def compliances(self) -> Mapping[str, Array | None]:
        """Compliances (6, 6), inverses of `matrices` that are computed without them; C^A,
        C^B, C^K exist at singularities, too.

        By (5) of `cartstiff.core.stiffness.reduction`, ``C^X = J_N (H_N + J_N^T D J_N)^-1
        J_N^T`` with D = K^X - K^B, which depends on the load only; for C^F the Hessian is
        that in the chart.
        """
        C = {name: None if C is None else C.matrix for name, C in self._inverses.items()}
        return NamedArrays(C, {"load": C.pop("load")})

    @cached_property
    def _inverses(self) -> dict[str, numerics.Inverse | None]:
        """`compliances` with their errors."""
        free, added = self.reduction.free, self._flat.added
        flat = None if added is None else (self.evaluation.hessian, added)
        is_known = self.wrench is not None
        found = free.compliances(self._changes, flat) if free and is_known else ()
        each = dict(zip_longest(("B", "A", "K", "load", "F"), found))
        return {name: each[name] for name in ("A", "B", "K", "F", "load")}

    @property
    def motions_of_closed(self) -> tuple[Array, int, Array | None]:
        """Of a closed chain: `Reduction.singular_values`, `usual_rank`, and `motions`,
        shape (n, f), all dimensionless.
        """
        if (later := self._later) is not None:
            return cast(tuple[Array, int, Array], later.find("motions_of_closed", self))
        found = self.reduction
        return found.singular_values, found.usual_rank, found.motions

    @cached_property
    def is_loaded(self) -> bool:
        """Whether there is a load: one was given, or the springs' wrench
        exceeds round-off.
        """
        if self.wrench is None or self._load_is_given or not any(self.wrench.tolist()):
            return self.wrench is not None and self._load_is_given
        J, sizes = self.posture.motion.jacobian, self.posture.coordinate_lengths
        return exceeds_roundoff(self.wrench, J, self.evaluation.hessian, sizes)

    @property
    def wrench_is_known(self) -> bool:
        """Whether W is known in full: the load was given, or the joints determine
        all components.

        Otherwise the part that the structure carries is taken as zero in the
        length-scaled norm.
        """
        return self.wrench is not None and (
            self.reduction.rank == 6 or self._load_is_given
        )

    def shown_wrench(self, wrench: Array) -> Array:
        """A wrench (6,) with round-off set to 0 (`cartstiff.core.stiffness.rounding`)."""
        if not any(wrench.tolist()):
            return wrench
        H = None if self._load_is_given else self.evaluation.hessian
        return shown_wrench(wrench, H, self.posture.coordinate_lengths, self.length)

    @property
    def change_by_load(self) -> Array:
        """Change of the stiffness by the load, ``K^load - K^B`` (6, 6), zero without a
        load.

        Exists at singular postures, too.
        """
        return fixed(self._changes[2])

    @property
    def elastic_as_given(self) -> ElasticMechanism:
        """The mechanism before its open rest positions were chosen."""
        return self._asked or self.elastic

    @property
    def weighed(self) -> GravityLoads:
        """Gravity, the masses on which it acts, and the state before the load."""
        before = self._before_load or self.elastic_as_given.before_load
        return replace(gravity_loads(self.elastic), before=before)

    @property
    def mechanism(self) -> Mechanism:
        """The mechanism without its springs."""
        return self.elastic_as_given.mechanism

    @cached_property
    def leg_lengths(self) -> Array | None:
        """Lengths (m,) of a platform's legs; None for other mechanisms."""
        lines = self.posture.lines
        return None if lines is None else lines.lengths

    @cached_property
    def tensions(self) -> Array | None:
        """Tensions (m,) of a platform's legs, see
        `cartstiff.core.mechanisms.limits.tensions_of`.
        """
        return tensions_of(self.elastic, self.posture)

    @cached_property
    def drives(self) -> tuple[Drive, ...]:
        """The legs of a platform, or the drives of a closed chain,
        with limits and forces.
        """
        return drives_of(self.elastic, self.posture, self.leg_lengths, self.forces)

    @cached_property
    def forces(self) -> tuple[DriveForce, ...]:
        """What each joint, leg and line carries, and its limits, the most loaded first;
        see `cartstiff.core.stiffness.forces`.
        """
        torques = {}
        if self.elastic.mechanism.rigid:
            parts = self.elastic, self.posture, self.reduction.multipliers
            torques = rigid_torques(*parts)
        return forces_of(self.elastic, self.posture, torques)

    @property
    def torques(self) -> Array:
        """Torques or forces (n,) of the joints' drives on the links that they move, zero
        without a spring; NaN of a platform, which has no joints.
        """
        known = {one.name: one.force for one in self.forces}
        other = np.nan if self.posture.coordinates_are_pose else 0.0
        return np.array([known.get(name, other) for name in self.elastic.names])

    @cached_property
    def wrenches(self) -> tuple[CarriedWrench, ...]:
        """Wrenches in joints, closures, compliant links and lines; none in an unbalanced
        posture. See `cartstiff.core.stiffness.wrenches`.
        """
        if self.wrench is None:
            return ()
        lam = self.reduction.multipliers
        return wrenches_at(self.elastic, self.posture, self.wrench, lam)

    @cached_property
    def task_axes(self) -> TaskAxes | None:
        """The stiffness along the motions of a body that has fewer than six;
        None if it has six.
        """
        found = self.reduction
        if found.stiffness is not None or found.reachable_stiffness is None:
            return None
        assert found.reachable is not None
        from cartstiff.core.stiffness.task_axes import task_axes

        return task_axes(
            found.reachable,
            found.reachable_stiffness,
            self.change_by_load,
            self.pose[:3, :3],
            self.length,
        )

    @cached_property
    def length(self) -> float:
        """Characteristic length of the posture, see `MechanismPosture.length`."""
        return self.posture.length

    @property
    def tangent(self) -> Array | None:
        """K^load (6, 6): change of the applied wrench per motion, under the load.

        The derivative of the elastic wrench less that of the load, which behaves as
        `load` says: the linear limit of `equilibrium`. None where no stiffness exists.
        """
        return self.matrices["load"]

    @property
    def tangent_compliance(self) -> Array | None:
        """Compliance (6, 6), the inverse of `tangent`, computed as `compliances`.

        Exists at singular postures, too.
        """
        return self.compliances["load"]

    @cached_property
    def _resists(self) -> bool:
        """Whether no load moves the body on and on, as a negative compliance lets it."""
        C = self.tangent_compliance
        return C is None or numerics.is_never_negative(C)

    @cached_property
    def inverse_of_symmetric_tangent(self) -> Array | None:
        """Compliance (6, 6), the inverse of the symmetric part of `tangent`; None if
        there is none.
        """
        C, change = self.compliances["B"], self.change_by_load
        if C is None or not change.any():
            return C
        if numerics.is_symmetric(change):
            return self.tangent_compliance
        return numerics.inverse_of_sum(C, 0.5 * (change + change.T))

    @property
    def compliance(self) -> Compliance:
        """Compliance under the load, C^load: motion per added wrench; C^B without a load.

        It exists at kinematic singularities and for fewer than six joints as well.

        Raises
        ------
        UndefinedError
            If a motion costs no energy, or nothing balances the posture.
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
        if T_M_N is None:
            return _seen_from(self, _HERE)
        return _seen_from(self, checked_pose(T_M_N, "frame of the body").tobytes())

    @cached_property
    def _flat(self) -> FlatChart:
        return flat_chart(self.posture, self.evaluation, self.reduction, self._natural)

    @cached_property
    def _natural(self) -> Array:
        """Natural sizes of the six twist components."""
        return np.array([1.0] * 3 + [self.length] * 3)

    @cached_property
    def jacobian(self) -> Array | None:
        """Body Jacobian of the joint coordinates.

        For a platform d(pose)/d(leg lengths).
        """
        if not self.posture.coordinates_are_pose:
            return fixed(self.posture.motion.jacobian)
        to_chart = self._flat.to_chart
        return None if to_chart is None else fixed(np.linalg.inv(to_chart))

    @cached_property
    def notes(self) -> tuple[Note, ...]:
        """Assumptions, and reasons why something does not exist."""
        if (later := self._later) is not None:
            return cast(tuple[Note, ...], later.find("notes", self))
        reason = () if self._flat.note is None else (self._flat.note,)
        signs = posture_notes.indefinite(
            self.reduction, self.tangent, self.tangent_compliance, self._natural
        )
        return (*self.notes_on_posture, *signs, *reason, *self.notes_on_digits)

    @cached_property
    def notes_on_digits(self) -> list[Note]:
        """Notes on lost digits."""
        parts = (
            self.elastic,
            self.posture,
            self.evaluation,
            self.reduction,
            self.notes_on_posture,
        )
        error = posture_notes.error_of_motions(*parts[1:4])
        known = self._inverses
        if self.is_loaded:
            error = max(error, posture_notes.error_of_chosen_forces(*parts))
        change = self.change_by_load if self._load_is_given else None
        return posture_notes.notes_on_digits(
            self.reduction, known["B"], self._natural, change, known["load"], error
        )

    @cached_property
    def notes_on_posture(self) -> tuple[Note, ...]:
        """The `notes` without those on matrices."""
        if (later := self._later) is not None:
            return cast(tuple[Note, ...], later.find("notes_on_posture", self))
        known, find = self._notes, posture_notes.notes_on_posture
        if known is not None:
            return known
        asked = self.elastic if self._asked is None else self._asked
        on_rest = preload_notes(asked, self._rest_is_chosen)
        return find(self.elastic, self.posture, self.reduction, on_rest)

    def tensor(self, connection: str | Connection = "B") -> StiffnessTensor:
        """Stiffness tensor under a named connection ("A", "B", "K", "+", "F")
        or any other.

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
            If K^F does not exist, with the reason.
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
        """Kind of the load, its point, and the tangent, as plain data."""
        K, C = self.tangent, self.tangent_compliance
        return {
            "kind": self.load.kind,
            "at": list(self.load.at),
            "meaning": self.load.words,
            "stiffness": None if K is None else K.tolist(),
            "compliance": None if C is None else C.tolist(),
        }

    def coupled_springs_as_dict(self) -> dict[str, Any]:
        """Rest positions and forces of springs that couple joints, if there are any."""
        springs = [
            {"name": name, "sum": x, "rest": rest, "force": force}
            for sums in self.elastic.sums
            for name, x, rest, force in zip(
                sums.names,
                (sums.factors @ self.q).tolist(),
                sums.rest.tolist(),
                sums.forces(self.q).tolist(),
                strict=True,
            )
        ]
        return {"coupled_springs": springs} if springs else {}

    def _legs_as_dict(self) -> dict[str, Any]:
        drives = [drive.to_dict() for drive in self.drives]
        return {"legs": drives} if drives else {}

    def to_dict(self) -> dict[str, Any]:
        """The object printed by ``cartstiff analyse --json``."""

        def plain(array: Array | None) -> list[Any] | None:
            return None if array is None else array.tolist()

        return {
            "schema": SCHEMA,
            **self.elastic.about(),
            **self._legs_as_dict(),
            "forces": [one.to_dict() for one in self.forces],
            "order": se3.ANGULAR_LINEAR,
            "q": self.q.tolist(),
            "pose": self.pose.tolist(),
            "jacobian": plain(self.jacobian),
            "wrench": plain(self.wrench),
            "load": self.load_as_dict(),
            **self.weighed.to_dict(),
            "energy": None if np.isnan(self.energy) else self.energy,
            "stored_energy": None if np.isnan(self.stored_energy) else self.stored_energy,
            **self.coupled_springs_as_dict(),
            **({} if self.task_axes is None else {"task_axes": self.task_axes.to_dict()}),
            "stiffness": {name: plain(K) for name, K in self.matrices.items()},
            "compliance": {name: plain(C) for name, C in self.compliances.items()},
            "notes": [note.to_dict() for note in self.notes],
        }


def named_tensor(
    result: PostureStiffness, K: Array, W: Array, connection: str | Connection
) -> StiffnessTensor:
    """The tensor under a connection, from K^B (6, 6) and the wrench W (6,),
    with its own inverse.

    Raises
    ------
    UndefinedError
        For K^F if it does not exist.
    """
    pose, frame, units = result.pose, result.frame, result.units
    compliances, T_F_B = result.compliances, result.elastic.mechanism.base_pose

    def known(C: Array | None) -> dict[str, Any]:
        return {"inverse": C, "is_singular": C is None}

    bi_invariant = StiffnessTensor(
        K, BI_INVARIANT, W, pose, frame, units, base=T_F_B, **known(compliances["B"])
    )
    if isinstance(connection, Connection):
        if NAMED.get(connection.name) is not connection:
            return bi_invariant.to_connection(connection)
        connection = connection.name
    if connection == "B":
        return bi_invariant
    C = compliances["A" if connection == "+" else connection]
    if connection == "F":
        flat, F = result.flat_connection(), result.matrices["F"]
        assert F is not None  # else there is no flat connection
        return StiffnessTensor(F, flat, W, pose, frame, units, base=T_F_B, **known(C))
    if connection == "+" and C is not None:
        C = C.T
    other = result.load.connection if connection == "load" else connection
    return replace(bi_invariant.to_connection(other), **known(C))
