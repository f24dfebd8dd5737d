"""One posture at a time by recorded formulas, for a mechanism that is analysed many times.

The call number `COMPILED_AT` for a mechanism makes its code, in the calling thread, so that every
run of a script uses the same arithmetic in the same calls: machine code if llvmlite is installed,
else Python. The code computes postures that are well inside the regular ones;
`cartstiff.stiffness.compute.analyse`, here called the engine, computes all others, and on demand
the properties that the code does not have. The results agree to round-off.
"""

from __future__ import annotations

import weakref
from collections.abc import Callable, Mapping
from copy import copy
from functools import partial, wraps
from itertools import count
from math import inf
from typing import TYPE_CHECKING, Any, TypeVar, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cartstiff import numerics
from cartstiff.arrays import NamedArrays, checked_input
from cartstiff.batch.algebra import PLAIN
from cartstiff.geometry.se3 import Array
from cartstiff.lazily import cached_property
from cartstiff.matrix_names import OF_MANY
from cartstiff.mechanisms.contract import Mechanism, MechanismPosture
from cartstiff.mechanisms.elastic import ElasticMechanism
from cartstiff.mechanisms.gravity_loads import gravity_loads
from cartstiff.mechanisms.limits import deflection_notes, force_notes, limit_notes
from cartstiff.mechanisms.preload import preload_notes
from cartstiff.notes import Note
from cartstiff.potentials.beams import Beam, evaluate_together
from cartstiff.potentials.contract import Evaluation, LineGeometry, Potential
from cartstiff.potentials.line_springs import LineSprings
from cartstiff.potentials.springs import CoupledSprings
from cartstiff.stiffness import compute
from cartstiff.stiffness.applied_load import DEAD_AT_ORIGIN
from cartstiff.stiffness.balance import balanced, with_rest_balancing
from cartstiff.stiffness.motions import scaled_values
from cartstiff.stiffness.posture import PostureStiffness
from cartstiff.stiffness.posture_notes import near_serial, near_type_2
from cartstiff.stiffness.reduction import Reduction

if TYPE_CHECKING:
    from cartstiff.batch.execution import OnePosture
    from cartstiff.batch.plans import TracedModel

#: Outputs of the code for one posture.
RECORDED = (
    "pose",
    "jacobian",
    "wrench",
    "energy",
    *(f"{kind}_{c}" for kind in ("stiffness", "compliance") for c in OF_MANY),
    "actuation",
    "leg_lengths",
    "tensions",
    "length",
    "verdict",
    "noteworthy",
)


class QuickPosture(PostureStiffness):
    """A posture with the numbers of a `PostureCode`; the engine computes all else on demand."""

    def __init__(
        self,
        code: PostureCode,
        asked: ElasticMechanism,
        q: Array,
        wrench: Array | None,
        record: Array,
    ) -> None:
        record.flags.writeable = False
        vars(self).update(
            q=q,
            load=DEAD_AT_ORIGIN,
            _load_is_given=wrench is not None and any(wrench.tolist()),
            _code=code,
            _asked=asked,
            _given=wrench,
            _rest_is_chosen=wrench is not None,
            _record=record,
        )

    _code: PostureCode
    _asked: ElasticMechanism
    _given: Array | None
    _record: Array

    def __reduce__(self) -> Any:
        """Pickle the engine's result."""
        return copy, (self._engine,)

    @cached_property
    def _engine(self) -> PostureStiffness:
        return compute.analyse(self._asked, self.q, wrench=self._given)

    @cached_property
    def _balanced(self) -> tuple[ElasticMechanism, Evaluation]:
        """`elastic` and `evaluation`; for closed chains from the engine, which deflects links."""
        if self._code.is_closed:
            return self._engine.elastic, self._engine.evaluation
        return balanced(self._asked, self.posture, self._given)

    @cached_property
    def elastic(self) -> ElasticMechanism:
        """The mechanism with the rest positions that were used."""
        if self.posture.coordinates_are_pose:
            return with_rest_balancing(self._asked, self.posture, self._given)
        return self._balanced[0]

    @cached_property
    def posture(self) -> MechanismPosture:
        """Kinematics at q."""
        posture = self._asked.mechanism.at(self.q)
        lengths, lines = self.leg_lengths, self._recorded("actuation")
        if posture.coordinates_are_pose and lengths is not None and lines is not None:
            lines = lines.reshape(-1, 6)
            posture.lines = LineGeometry(lengths, lines[:, 3:], lines)
        return posture

    @property
    def evaluation(self) -> Evaluation:
        """Energy, gradient, Hessian in the coordinates."""
        if self.posture.coordinates_are_pose:
            return Evaluation(self.energy, self.wrench, cast(Array, self.matrices["B"]))
        return self._balanced[1]

    @cached_property
    def reduction(self) -> Reduction:
        """The reduction to the end-effector."""
        return self._engine.reduction

    @property
    def pose(self) -> Array:
        """``T_F_M`` (4, 4)."""
        return self._record[self._code.at["pose"]].reshape(4, 4)

    @property
    def wrench(self) -> Array:
        """W = dPhi in the body frame."""
        return self._record[self._code.at["wrench"]]

    @property
    def energy(self) -> float:
        """Potential energy of all that acts: springs, gravity, and loads added as potentials."""
        return float(self._record[self._code.energy])

    @property
    def stored_energy(self) -> float:
        """Energy of springs and other potentials, without that of gravity and of loads."""
        return self.energy if self._code.is_inner else self._engine.stored_energy

    @property
    def jacobian(self) -> Array | None:
        """Body Jacobian of the joint coordinates; for a platform d(pose)/d(leg lengths)."""
        J = self._recorded("jacobian")
        return None if J is None else J.reshape(6, -1)

    @property
    def mechanism(self) -> Mechanism:
        """The mechanism without its springs."""
        return self._asked.mechanism

    @property
    def leg_lengths(self) -> Array | None:
        """Lengths (m,) of a platform's legs; None for other mechanisms."""
        return self._recorded("leg_lengths")

    @property
    def tensions(self) -> Array | None:
        """Tensions (m,) of a platform's legs; None for other mechanisms."""
        return self._recorded("tensions")

    @property
    def length(self) -> float:
        """Characteristic length of the posture."""
        own = self._recorded("length")
        # The code has 1 where no joint on the way turns the body; the posture looks at all joints.
        return self.posture.length if own is None or own[0] == 1.0 else float(own[0])

    def _recorded(self, name: str) -> Array | None:
        place = self._code.at.get(name)
        return None if place is None else self._record[place]

    @cached_property
    def matrices(self) -> Mapping[str, Array | None]:
        """K^A, K^B, K^K, K^F as arrays (6, 6), None where one does not exist."""
        return self._named("stiffness")

    @cached_property
    def compliances(self) -> Mapping[str, Array | None]:
        """Inverses of `matrices`, found without them."""
        return self._named("compliance")

    def _named(self, kind: str) -> NamedArrays:
        arrays: dict[str, Array | None] = {
            name: None if place is None else self._record[place].reshape(6, 6)
            for name, place in self._code.matrices[kind].items()
        }
        return NamedArrays.of_fixed(arrays, {"load": arrays.pop("load")})

    @cached_property
    def notes(self) -> tuple[Note, ...]:
        """Assumptions, and reasons why something does not exist."""
        if not self._record[self._code.digits] < 1.0:
            return self._engine.notes
        return (*self.notes_on_posture, *self._code.notes_on_chart)

    @cached_property
    def notes_on_posture(self) -> tuple[Note, ...]:
        """The `notes` without those on matrices."""
        mechanism = self._asked.mechanism
        near: list[Note] = []
        if not self._record[self._code.near] < 1.0:
            if self._code.is_closed:
                return self._engine.notes_on_posture
            near = self._code.near_notes(self)
        return (
            *self._asked.notes,
            *near,
            *self._diagnostics,
            *limit_notes(mechanism, self),
            *self._forces,
            *self._deflections,
            *preload_notes(self._asked, self._given is not None),
            *self._code.notes_on_weight,
        )

    @property
    def _diagnostics(self) -> list[Note]:
        """Notes of deflected links, of cables, and of more than six lines."""
        springs = self._asked.springs
        if springs is not None and (springs.unilateral or springs.is_redundant):
            return self.elastic.diagnostics(self.posture)
        if not self._code.bends:
            return []
        bent = [term for term in self._asked.potentials if term.members]
        evaluate_together(bent, self.posture)  # each beam caches its result
        return self._asked.diagnostics(self.posture)

    @property
    def _deflections(self) -> list[Note]:
        """Notes on deflections of joints and lines that are large for the mechanism."""
        if self._record[self._code.deflection] < 1.0:
            return []
        springs = self._asked.springs
        is_given = self._given is None and springs is not None and springs.is_complete
        return deflection_notes(self._asked if is_given else self.elastic, self.q)

    @property
    def _forces(self) -> list[Note]:
        """Notes on forces of legs, from the engine, if these have limits."""
        legs = getattr(self._asked.mechanism, "leg_limits", None)
        return (
            [] if legs is None or legs.forces is None else force_notes(self.elastic, self)
        )


class PostureCode:
    """Code for a mechanism with or without a wrench: machine code, or printed Python."""

    def __init__(
        self, elastic: ElasticMechanism, taken: TracedModel, compiled: bool
    ) -> None:
        from cartstiff.batch.execution import CompiledPosture, PrintedPosture
        from cartstiff.batch.plans import CLOSING, SETTLING, program_for

        case, self._is_compiled = taken.case, compiled
        one_posture = CompiledPosture if compiled else PrintedPosture
        shared = {name: np.ascontiguousarray(rows) for name, rows in taken.shared.items()}
        self._answer = one_posture(program_for(case, RECORDED), shared)
        self._closing = (
            one_posture(program_for(case, CLOSING), {}) if taken.is_closed else None
        )
        self._settling = None
        if taken.settles:
            self._settling = one_posture(program_for(case, SETTLING), shared)
        self._untraced, self.bends = taken.untraced, bool(taken.untraced) or taken.settles
        self.at = at = self._answer.at
        self.matrices = {
            kind: {name: at.get(f"{kind}_{name}") for name in OF_MANY}
            for kind in ("stiffness", "compliance")
        }
        self.energy, self._verdict = at["energy"].start, at["verdict"].start
        self.near = at["noteworthy"].start
        self.digits, self.deflection = self.near + 1, self.near + 2
        self.is_closed, self._home = taken.is_closed, taken.home
        self.is_inner = not elastic.parted_terms()[1]
        chart = elastic.mechanism.at(elastic.q).chart()
        self.notes_on_chart = (
            (Note("kf-undefined", chart),) if isinstance(chart, str) else ()
        )
        self.notes_on_weight = tuple(gravity_loads(elastic).notes)

    def record(self, q: Array, wrench: Array | None) -> tuple[Array, Array] | None:
        """Coordinates and all numbers of a posture; None unless it is plainly regular."""
        at: Array | None = q
        given = {} if wrench is None else {"wrench": wrench}
        if self._closing is not None:
            at = self._assembled(self._closing, q)
        if self._settling is not None and at is not None:
            at = self._bent(self._settling, at, given)
        if at is None:
            return None
        record = self._answer.record(q=at, **given, **self._derivatives(at))
        return (at, record) if record[self._verdict] == 0.0 else None

    def _derivatives(self, q: Array) -> dict[str, Array]:
        """Derivatives of the terms outside the programs."""
        if not self._untraced:
            return {}
        return self._untraced.derivatives(q[None], self._is_compiled)[0]

    def _bent(
        self, settling: OnePosture, q: Array, given: dict[str, Array]
    ) -> Array | None:
        """Coordinates at which links carry the load; None if a few steps do not find them."""
        from cartstiff.batch.closed_chains import settle

        evaluate = partial(self._untraced.derivatives, compiled=self._is_compiled)
        at = q[None].copy()
        load = {"wrench": given["wrench"][None]}
        found = settle(settling, evaluate, load, at, np.arange(1))
        return at[0] if len(found) else None

    def near_notes(self, quick: QuickPosture) -> list[Note]:
        """Notes on near singularities."""
        posture = quick.posture
        if posture.coordinates_are_pose:
            return near_type_2(posture)
        return [*near_type_2(posture), *near_serial(posture, scaled_values(posture))]

    def _assembled(self, closing: OnePosture, q: Array) -> Array | None:
        """Coordinates that close the chain, as `Chain.closed` finds them; None if not found."""
        if (
            self._home is None
            or not (steps := self._home.steps_where_asked(q[None])).any()
        ):
            return self._closed(closing, q)

        def near(start: Array) -> tuple[Array, NDArray[np.bool_], NDArray[np.bool_]]:
            at = self._closed(closing, start[0])
            shut = np.array([at is not None])
            return start if at is None else at[None], shut, ~shut

        at, is_closed, _ = self._home.continue_from(near, q[None], steps)
        return at[0] if is_closed[0] else None

    @staticmethod
    def _closed(closing: OnePosture, q: Array) -> Array | None:
        """The steps of `closed_chains.close` for one posture; None if these do not close it."""
        from cartstiff.batch.closed_chains import STEPS, is_shut
        from cartstiff.mechanisms.closures import LONGEST_STEP

        left, size, best, futile = closing.at["left"], inf, inf, 0
        for _ in range(STEPS):
            record, before = closing.record(q=q), size
            size, step, length, doubt = record[left].tolist()
            if is_shut(size, step, length, before):
                return q
            futile = 0 if size < 0.9 * best else futile + 1
            best = min(best, size)
            if (
                doubt != PLAIN
                or not step < inf
                or (futile >= numerics.MAX_FUTILE_STEPS and step < LONGEST_STEP)
            ):
                return None
            q = record[: len(q)]
        return None


Ask = TypeVar("Ask", bound=Callable[..., PostureStiffness])

#: Number of the call of `analyse` in which a mechanism is compiled. The total time is shorter than
#: without code after 28 to 282 calls as Python, 149 to 795 as machine code (UR5, Panda, platforms,
#: delta, with and without a load).
COMPILED_AT = 200
#: Number of the call, which takes up to 15 s, in which mechanisms whose links a load deflects are
#: compiled, and largest number of operations of their programs.
BENT_COMPILED_AT, _LARGEST_BENT = 1000, 150_000


class _Calls:
    """Number of calls for a mechanism, and its code once it is made."""

    def __init__(self, elastic: ElasticMechanism, key: tuple[int, bool]) -> None:
        self.elastic = weakref.ref(elastic, lambda _: _known.pop(key, None))
        self.number = count(1)  # each number goes to one thread, without a lock
        self.code: PostureCode | None = None


def _compiled(elastic: ElasticMechanism, loaded: bool, bent: bool) -> PostureCode | None:
    """Code for a mechanism, by llvmlite if installed; None if only the engine can compute it."""
    from cartstiff.batch.kernels import LARGEST_PROGRAM, has_package
    from cartstiff.batch.plans import plan, program_for

    chosen = plan(elastic, "shared" if loaded else "none")
    if (
        isinstance(chosen, str)
        or chosen.settles is not bent
        or chosen.regular != "regular"
        or chosen.untraced.is_dense
        or elastic.mechanism.rigid
        or ((chosen.untraced or chosen.settles) and not chosen.is_closed)
        or not _is_plain(elastic, loaded, chosen)
    ):
        return None
    program = program_for(chosen.case, RECORDED)
    is_small = program.size <= (_LARGEST_BENT if bent else LARGEST_PROGRAM)
    if "noteworthy" not in program.outputs or not is_small:
        return None
    return PostureCode(elastic, chosen, has_package("llvmlite"))


def _is_plain(elastic: ElasticMechanism, loaded: bool, taken: TracedModel) -> bool:
    """Whether the mechanism cannot change, and no potential has diagnostics that code lacks."""
    # `QuickPosture` has diagnostics of these: lines of open chains, or links of closed ones.
    silent = (LineSprings,) if not taken.is_closed else (Beam, CoupledSprings)
    if elastic.gravity is not None and elastic.gravity.flags.writeable:
        return False
    return (elastic.springs is not None or not loaded) and all(
        type(term).diagnostics is Potential.diagnostics
        or (isinstance(term, silent) and not getattr(term, "unilateral", False))
        for term in elastic.terms()
    )


_known: dict[tuple[int, bool], _Calls] = {}


def _with_recorded_code(engine: Ask) -> Ask:
    """`analyse` with the same signature and docstring that also uses recorded code."""

    @wraps(engine)
    def analyse(
        elastic: ElasticMechanism,
        q: ArrayLike | Mapping[str, float] | None = None,
        *,
        wrench: ArrayLike | None = None,
        **load: Any,
    ) -> PostureStiffness:
        if load or isinstance(q, Mapping) or not isinstance(elastic, ElasticMechanism):
            return engine(elastic, q, wrench=wrench, **load)
        key = id(elastic), wrench is not None
        calls = _known.get(key)
        if calls is None:
            calls = _known.setdefault(key, _Calls(elastic, key))
        if (code := calls.code) is None:
            number = next(calls.number)
            if number in (COMPILED_AT, BENT_COMPILED_AT):
                calls.code = _compiled(
                    elastic, wrench is not None, number == BENT_COMPILED_AT
                )
            return engine(elastic, q, wrench=wrench)
        values = elastic.mechanism.checked(elastic.q if q is None else q)
        force = None if wrench is None else checked_input(wrench, (6,), "wrench")
        record = code.record(values, force)
        if record is None:
            return engine(elastic, values, wrench=force)
        return QuickPosture(code, elastic, record[0], force, record[1])

    analyse.__module__ = __name__  # so that it can be pickled
    return cast(Ask, analyse)


analyse = _with_recorded_code(compute.analyse)
