"""A plainly regular posture whose numbers are known: the same result, without the core.

A program has the numbers (`cartstiff.batch.program`). What else is read of the result is
found then: kinematics, rest positions and notes from them, all other by `analyse`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, cast

import numpy as np

from cartstiff.arrays import NamedArrays, fixed
from cartstiff.geometry.se3 import Array
from cartstiff.lazily import cached_property
from cartstiff.matrix_names import OF_MANY
from cartstiff.mechanisms.contract import MechanismPosture
from cartstiff.mechanisms.elastic import ElasticMechanism
from cartstiff.mechanisms.gravity_loads import gravity_loads
from cartstiff.mechanisms.limits import deflection_notes, limit_notes
from cartstiff.mechanisms.preload import preload_notes
from cartstiff.notes import Note
from cartstiff.potentials.beams import Beam, evaluate_together
from cartstiff.potentials.contract import Evaluation, LineGeometry, Potential
from cartstiff.potentials.line_springs import LineSprings
from cartstiff.potentials.springs import CoupledSprings
from cartstiff.stiffness.applied_load import Axes, LoadKind, wrench_in_body
from cartstiff.stiffness.balance import balanced, with_rest_balancing
from cartstiff.stiffness.compute import analyse
from cartstiff.stiffness.forces import force_notes
from cartstiff.stiffness.motions import scaled_values, values_of_closed, values_on
from cartstiff.stiffness.posture import PostureStiffness
from cartstiff.stiffness.posture_notes import indefinite, near_serial, near_type_2
from cartstiff.stiffness.reduction import Reduction

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


@dataclass
class Question:
    """A question to `analyse`."""

    elastic: ElasticMechanism
    q: Array
    wrench: Array | None
    load: LoadKind
    axes: Axes

    @cached_property
    def core(self) -> PostureStiffness:
        """Its answer."""
        given: dict[str, Any] = {}
        if self.wrench is not None:
            given = {"wrench": self.wrench, "load_axes": self.axes}
        if self.wrench is not None or self.elastic.may_be_loaded:
            given |= {"load_kind": self.load.kind, "load_at": self.load.at}
        return analyse(self.elastic, self.q, **given)


@dataclass
class _Known:
    """A plainly regular posture: its numbers, and what is found when it is read."""

    asked: Question
    q: Array
    record: Mapping[str, Array]

    @property
    def result(self) -> PostureStiffness:
        """The posture; arrays are read-only views of the record."""
        asked, record, wrench = self.asked, self.record, self.asked.wrench
        known: dict[str, Any] = {
            "q": fixed(self.q),
            "energy": float(record["energy"]),
            "matrices": self._named("stiffness"),
            "compliances": self._named("compliance"),
            "load": asked.load,
            "_load_is_given": wrench is not None and any(wrench.tolist()),
            "_asked": asked.elastic,
            "_rest_is_chosen": wrench is not None,
        }
        for name in _ALIKE:
            known[name] = record.get(name)
        if self._bounds[2] < 1.0:
            known["_resists"] = True
        # The code has 1 where no joint on the way turns the body; the posture looks at
        # all joints.
        if "length" in record and (length := float(record["length"][0])) != 1.0:
            known["length"] = length
        self._result = PostureStiffness.of_numbers(
            known,
            {
                "elastic": self.elastic,
                "posture": self.posture,
                "evaluation": self.evaluation,
                "reduction": self.reduction,
                "notes": self.notes,
                "notes_on_posture": self.notes_on_posture,
                "motions_of_closed": self.motions_of_closed,
            },
        )
        return self._result

    def _named(self, kind: str) -> NamedArrays:
        arrays = {name: self.record.get(f"{kind}_{name}") for name in OF_MANY}
        return NamedArrays.of_fixed(arrays, {"load": arrays.pop("load")})

    @property
    def _is_closed(self) -> bool:
        return bool(self.asked.elastic.mechanism.closures)

    def posture(self) -> MechanismPosture:
        """Kinematics at q."""
        posture = self.asked.elastic.mechanism.at(self.q)
        if posture.coordinates_are_pose:
            lines = self.record["actuation"]
            lengths = self._result.leg_lengths
            assert lengths is not None
            cast(Any, posture).lines = LineGeometry(lengths, lines[:, 3:], lines)
        return posture

    @cached_property
    def _force(self) -> Array | None:
        """The wrench in M."""
        wrench, asked = self.asked.wrench, self.asked
        if wrench is None:
            return None
        return wrench_in_body(wrench, self._result.pose, asked.load.at, asked.axes)

    @cached_property
    def _balanced(self) -> tuple[ElasticMechanism, Evaluation]:
        if self._is_closed:  # the core deflects links
            return self.asked.core.elastic, self.asked.core.evaluation
        return balanced(self.asked.elastic, self._result.posture, self._force)

    def elastic(self) -> ElasticMechanism:
        """The mechanism with the rest positions that were used."""
        posture = self._result.posture
        if posture.coordinates_are_pose:
            return with_rest_balancing(self.asked.elastic, posture, self._force)
        return self._balanced[0]

    def evaluation(self) -> Evaluation:
        """Energy, gradient, Hessian in the coordinates."""
        own = self._result
        if own.posture.coordinates_are_pose:
            return Evaluation(
                own.energy, cast(Array, own.wrench), cast(Array, own.matrices["B"])
            )
        return self._balanced[1]

    def reduction(self) -> Reduction:
        """The reduction to the end-effector, of the core."""
        return self.asked.core.reduction

    def motions_of_closed(self) -> tuple[Array, int, Array]:
        """`Reduction.singular_values`, `freedoms` and `motions` of a closed chain."""
        posture, motions = self._result.posture, self.record.get("motions")
        if motions is None:
            return values_of_closed(posture)
        N = np.linalg.qr(motions / posture.coordinate_lengths[:, None])[0]
        return values_on(N, posture, self.record["jacobian"]), N.shape[1], N

    # -- notes
    # ---------------------------------------------------------------------------------

    @cached_property
    def _bounds(self) -> list[float]:
        """At least 1 where notes on a near singularity, on lost digits, on motions that
        lower the energy, on wide deflections and on forces are possible.
        """
        bounds: list[float] = self.record["noteworthy"].tolist()
        return bounds

    def notes(self) -> tuple[Note, ...]:
        """Assumptions, and reasons why something does not exist."""
        own = self._result
        if not self._bounds[1] < 1.0:
            return self.asked.core.notes
        chart = own.posture.chart()
        reason = [Note("kf-undefined", chart)] if isinstance(chart, str) else []
        return (*own.notes_on_posture, *self._signs(), *reason)

    def _signs(self) -> list[Note]:
        own = self._result
        if self._bounds[2] < 1.0:
            return []
        natural = np.repeat([1.0, own.length], 3)
        pair = own.tangent, own.tangent_compliance
        return indefinite(cast(Reduction, None), *pair, natural)

    def notes_on_posture(self) -> tuple[Note, ...]:
        """The `notes` without those on matrices."""
        own, asked = self._result, self.asked.elastic
        is_near, _, _, is_wound, is_strained = (not x < 1.0 for x in self._bounds)
        is_strained = is_strained and bool(asked.force_limits)
        if is_near and self._is_closed:
            return self.asked.core.notes_on_posture
        return (
            *asked.notes,
            *(self._near() if is_near else ()),
            *self._diagnostics(),
            *limit_notes(asked.mechanism, own),
            *(force_notes(own.forces, asked) if is_strained else ()),
            *(deflection_notes(own.elastic, own.q) if is_wound else ()),
            *preload_notes(asked, self.asked.wrench is not None),
            *(() if asked.gravity is None else gravity_loads(asked).notes),
        )

    def _near(self) -> list[Note]:
        posture = self._result.posture
        serial = []
        if not posture.coordinates_are_pose:
            serial = near_serial(posture, scaled_values(posture))
        return [*serial, *near_type_2(posture)]

    def _diagnostics(self) -> list[Note]:
        """Notes of deflected links, of cables, and of more than six lines."""
        asked, own = self.asked.elastic, self._result
        if self._is_closed:
            beams = [term for term in asked.terms() if isinstance(term, Beam)]
            if not beams and not any(type(t) is CoupledSprings for t in asked.terms()):
                return []
            evaluate_together(beams, own.posture)  # each beam caches its result
            return asked.diagnostics(own.posture)
        springs = asked.springs
        if springs is not None and len(asked.mechanism.points):
            is_many = len(springs.stiffness) > 6
            return own.elastic.diagnostics(own.posture) if is_many else []
        return []


def with_numbers(
    question: Question, q: Array, numbers: Mapping[str, Array]
) -> PostureStiffness:
    """The answer to a question at a plainly regular posture whose numbers are known.

    Parameters
    ----------
    question : Question
        As asked, of a mechanism whose `notes_are_known`.
    q : ndarray (n,)
        Coordinates, closed and deflected.
    numbers : mapping
        Outputs of a program by name, read-only, those that exist: with "noteworthy", and
        "tensions", "leg_lengths" and "actuation" of a platform.
    """
    return _Known(question, q, numbers).result
