"""A plainly regular posture whose numbers are known: the same result, without the core.

A program has the numbers (`cartstiff.recorded.program`). What else is read of the result
is found then: kinematics, rest positions and notes from them, all other by `analyse`.
"""

from __future__ import annotations

from collections.abc import Container, Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any, ClassVar, cast

import numpy as np
from numpy.typing import ArrayLike

from cartstiff.core.arrays import Array, NamedArrays, checked_array, checked_input
from cartstiff.core.errors import InputError
from cartstiff.core.geometry import se3
from cartstiff.core.lazily import cached_property
from cartstiff.core.matrix_names import OF_MANY
from cartstiff.core.mechanisms.chain import Chain
from cartstiff.core.mechanisms.contract import MechanismPosture
from cartstiff.core.mechanisms.elastic import ElasticMechanism
from cartstiff.core.mechanisms.gravity_loads import gravity_loads
from cartstiff.core.mechanisms.limits import deflection_notes, limit_notes
from cartstiff.core.mechanisms.preload import preload_notes
from cartstiff.core.notes import Note
from cartstiff.core.potentials.beams import Beam
from cartstiff.core.potentials.contract import (
    Evaluation,
    LineGeometry,
    Potential,
    evaluate_together,
)
from cartstiff.core.potentials.line_springs import LineSprings
from cartstiff.core.potentials.link_springs import CoupledSprings
from cartstiff.core.potentials.springs import Springs
from cartstiff.core.stiffness.applied_load import Axes, LoadKind, wrench_in_body
from cartstiff.core.stiffness.balance import balanced, with_rest_balancing
from cartstiff.core.stiffness.compute import PostureStiffness, analyse
from cartstiff.core.stiffness.forces import force_notes
from cartstiff.core.stiffness.motions import scaled_values, values_of_closed, values_on
from cartstiff.core.stiffness.posture_notes import indefinite, near_serial, near_type_2
from cartstiff.core.stiffness.reduction import Reduction
from cartstiff.recorded.tape import Arrays

# Attributes of a posture that a program has by their names.
_ALIKE = (
    "pose",
    "wrench",
    "jacobian",
    "leg_lengths",
    "tensions",
    "inverse_of_symmetric_tangent",
)


def notes_are_known(elastic: ElasticMechanism, is_loaded: bool) -> bool:
    """Whether the mechanism cannot change, and its notes are known beside a program."""
    # Diagnostics of these are computed: lines of open chains, or links of closed ones.
    known = (Beam, CoupledSprings) if elastic.mechanism.closures else (LineSprings,)
    if elastic.gravity is not None and elastic.gravity.flags.writeable:
        return False
    if elastic.mechanism.rigid or (is_loaded and elastic.springs is None):
        return False
    return all(
        type(term).diagnostics is Potential.diagnostics
        or (isinstance(term, known) and not getattr(term, "unilateral", False))
        for term in elastic.terms()
    )


def changed(
    elastic: ElasticMechanism, load: LoadKind, numbers: Mapping[str, ArrayLike]
) -> tuple[ElasticMechanism, LoadKind]:
    """A mechanism, and a kind of load, with other numbers of a program's inputs."""
    # Each replaces what the mechanism has; a payload hangs on the tool.
    if "tcp" in numbers:
        x = checked_input(numbers["tcp"], (6,), "tcp")
        chain = cast(Chain, elastic.mechanism)
        moved = chain.with_tool(se3.from_roll_pitch_yaw(x[:3], x[3:]))
        elastic = replace(elastic, mechanism=moved)
    if "load_at" in numbers:
        load = LoadKind(load.kind, numbers["load_at"])  # type: ignore[arg-type]
    if "payload" in numbers:
        mass, *centre = checked_input(numbers["payload"], (4,), "payload").tolist()
        elastic = elastic.with_payload(mass, centre) if mass else elastic
    if numbers.keys() & {"stiffness", "rest"}:
        springs = springs_of(elastic)
        each = {"stiffness": springs.stiffness, "rest": springs.rest, **numbers}
        count = len(springs.stiffness)
        new = (
            checked_array(each[n], (count,), n, finite=False)
            for n in ("stiffness", "rest")
        )
        elastic = replace(elastic, springs=springs.replaced(*new))
    return elastic, load


def springs_of(elastic: ElasticMechanism) -> Springs:
    """The springs of joints or lines; InputError if there are none."""
    if elastic.springs is None:
        raise InputError(
            f"{elastic.name} has no springs of joints or lines", where="inputs"
        )
    return elastic.springs


def keywords(
    elastic: ElasticMechanism, wrench: Array | None, load: LoadKind, axes: Axes
) -> dict[str, Any]:
    """A load as keywords of `analyse`; none where nothing can act."""
    given: dict[str, Any] = {}
    if wrench is not None:
        given = {"wrench": wrench, "load_axes": axes}
    if wrench is not None or elastic.may_be_loaded:
        given |= {"load_kind": load.kind, "load_at": load.at}
    return given


@dataclass
class Question:
    """A question to `analyse`, which has what a posture reads beside its numbers.

    `numbers` replace those of the mechanism and of the load.
    """

    elastic: ElasticMechanism
    q: Array
    wrench: Array | None
    load: LoadKind
    axes: Axes
    numbers: Mapping[str, ArrayLike] = field(default_factory=dict)
    names: ClassVar[Container[str]] = {one.name for one in fields(PostureStiffness)}

    def find(self, name: str, posture: PostureStiffness) -> Any:  # noqa: ARG002
        """An attribute of the posture, by its name."""
        return getattr(self.core, name)

    @cached_property
    def core(self) -> PostureStiffness:
        """Its answer."""
        elastic, load = changed(self.elastic, self.load, self.numbers)
        given = keywords(elastic, self.wrench, load, self.axes)
        return analyse(elastic, self.q, **given)


@dataclass
class _Known:
    """What is found of a plainly regular posture when it is read, beside its numbers.

    It does not hold the posture: a circle would wait for the garbage collector.

    Attributes
    ----------
    asked : Question
        The question.
    record : mapping
        The numbers.
    bounds : list of float
        At least 1 where notes on a near singularity, on lost digits, on motions that
        lower the energy, on wide deflections and on forces are possible.
    """

    asked: Question
    record: Arrays
    bounds: list[float]
    #: Rest positions of an arm and what its springs do there, once found.
    _balanced: tuple[ElasticMechanism, Evaluation] | None = None

    names: ClassVar[Container[str]] = {
        "elastic",
        "posture",
        "evaluation",
        "reduction",
        "notes",
        "notes_on_posture",
        "motions_of_closed",
    }

    def find(self, name: str, own: PostureStiffness) -> Any:
        """An attribute of the posture, by its name."""
        return getattr(self, name)(own)

    @property
    def _is_closed(self) -> bool:
        return bool(self.asked.elastic.mechanism.closures)

    def posture(self, own: PostureStiffness) -> MechanismPosture:
        """Kinematics at q."""
        posture = self.asked.elastic.mechanism.at(own.q)
        if posture.coordinates_are_pose:
            lines = self.record["actuation"]
            lengths = own.leg_lengths
            assert lengths is not None
            found = LineGeometry(lengths, lines[:, 3:], lines)
            vars(posture).update(pose=own.pose, lines=found)
        return posture

    def _force(self, own: PostureStiffness) -> Array | None:
        """The wrench in M."""
        asked = self.asked
        if asked.wrench is None:
            return None
        return wrench_in_body(asked.wrench, own.pose, asked.load.at, asked.axes)

    def _at_rest(self, own: PostureStiffness) -> tuple[ElasticMechanism, Evaluation]:
        if self._is_closed:  # the core deflects links
            return self.asked.core.elastic, self.asked.core.evaluation
        if self._balanced is None:
            elastic, force = self.asked.elastic, self._force(own)
            self._balanced = balanced(elastic, own.posture, force)
        return self._balanced

    def elastic(self, own: PostureStiffness) -> ElasticMechanism:
        """The mechanism with the rest positions that were used."""
        posture = own.posture
        if posture.coordinates_are_pose:
            return with_rest_balancing(self.asked.elastic, posture, self._force(own))
        return self._at_rest(own)[0]

    def evaluation(self, own: PostureStiffness) -> Evaluation:
        """Energy, gradient, Hessian in the coordinates."""
        if own.posture.coordinates_are_pose:
            return Evaluation(
                own.energy, cast(Array, own.wrench), cast(Array, own.matrices["B"])
            )
        return self._at_rest(own)[1]

    def reduction(self, _: PostureStiffness) -> Reduction:
        """The reduction to the end-effector, of the core."""
        return self.asked.core.reduction

    def motions_of_closed(self, own: PostureStiffness) -> tuple[Array, int, Array]:
        """`Reduction.singular_values`, `freedoms` and `motions` of a closed chain."""
        posture, motions = own.posture, self.record.get("motions")
        if motions is None:
            return values_of_closed(posture)
        N = np.linalg.qr(motions / posture.coordinate_lengths[:, None])[0]
        return values_on(N, posture, self.record["jacobian"]), N.shape[1], N

    # -- notes
    # ---------------------------------------------------------------------------------

    def notes(self, own: PostureStiffness) -> tuple[Note, ...]:
        """Assumptions, and reasons why something does not exist."""
        if not self.bounds[1] < 1.0:
            return self.asked.core.notes
        chart = own.posture.chart()
        reason = [Note("kf-undefined", chart)] if isinstance(chart, str) else []
        return (*own.notes_on_posture, *self._signs(own), *reason)

    def _signs(self, own: PostureStiffness) -> list[Note]:
        if self.bounds[2] < 1.0:
            return []
        pair = own.tangent, own.tangent_compliance
        return indefinite(cast(Reduction, None), *pair, own._natural)

    def notes_on_posture(self, own: PostureStiffness) -> tuple[Note, ...]:
        """The `notes` without those on matrices."""
        asked = self.asked.elastic
        is_near, _, _, is_wound, is_strained = (not x < 1.0 for x in self.bounds)
        is_strained = is_strained and bool(asked.force_limits)
        if is_near and self._is_closed:
            return self.asked.core.notes_on_posture
        return (
            *asked.notes,
            *(self._near(own) if is_near else ()),
            *self._diagnostics(own),
            *limit_notes(asked.mechanism, own),
            *(force_notes(own.forces, asked) if is_strained else ()),
            *(deflection_notes(own.elastic, own.q) if is_wound else ()),
            *preload_notes(asked, self.asked.wrench is not None),
            *(() if asked.gravity is None else gravity_loads(asked).notes),
        )

    def _near(self, own: PostureStiffness) -> list[Note]:
        posture = own.posture
        if posture.coordinates_are_pose:
            return near_type_2(posture)
        return near_serial(posture, scaled_values(posture)) + near_type_2(posture)

    def _diagnostics(self, own: PostureStiffness) -> list[Note]:
        """Notes of deflected links, of cables, and of more than six lines."""
        asked = self.asked.elastic
        if self._is_closed:
            beams = [term for term in asked.terms() if isinstance(term, Beam)]
            if not beams and not any(type(t) is CoupledSprings for t in asked.terms()):
                return []
            evaluate_together(beams, own.posture)  # each beam caches its result
            return asked.diagnostics(own.posture)
        if asked.springs is None or not len(asked.mechanism.points):
            return []
        is_many = len(asked.springs.stiffness) > 6
        return own.elastic.diagnostics(own.posture) if is_many else []


def with_numbers(question: Question, numbers: Arrays) -> PostureStiffness:
    """The answer to a question at a plainly regular posture whose numbers are known.

    Parameters
    ----------
    question : Question
        As asked, of a mechanism whose `notes_are_known`, at coordinates that are closed
        and deflected.
    numbers : mapping
        Outputs of a program by name, read-only, those that exist: with "noteworthy", and
        "tensions", "leg_lengths" and "actuation" of a platform.
    """
    wrench, bounds = question.wrench, numbers["noteworthy"].tolist()
    known: dict[str, Any] = {
        "q": question.q,
        "energy": float(numbers["energy"]),
        "matrices": _named(numbers, "stiffness"),
        "compliances": _named(numbers, "compliance"),
        "load": question.load,
        "_load_is_given": wrench is not None and any(wrench.tolist()),
        "_asked": question.elastic,
        "_rest_is_chosen": wrench is not None,
        "_notes": None,
        "_before_load": None,
        "state": "regular",
        "is_plain": True,
        "_outputs": numbers,
    }
    for name in _ALIKE:
        known[name] = numbers.get(name)
    if bounds[2] < 1.0:
        known["_resists"] = True
    # The code has 1 where no joint on the way turns the body; the posture looks at all
    # joints.
    if "length" in numbers and (length := float(numbers["length"][0])) != 1.0:
        known["length"] = length
    return PostureStiffness.of_numbers(known, _Known(question, numbers, bounds))


def _named(numbers: Arrays, kind: str) -> NamedArrays:
    arrays = {name: numbers.get(f"{kind}_{name}") for name in OF_MANY}
    return NamedArrays.of_fixed(arrays, {"load": arrays.pop("load")})
