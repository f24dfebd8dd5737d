"""Reasons to doubt an answer, by their weight."""

from __future__ import annotations

from collections.abc import Iterable

from cartstiff.answer.verdict import Verdict
from cartstiff.core.mechanisms.elastic import ElasticMechanism
from cartstiff.core.notes import DOUBTS, Note

#: Codes of notes that cast doubt on an answer, the weightiest first: the model says
#: nothing about the machine; posture or load cannot be meant; numbers are uncertain;
#: something was chosen.
WEIGHTS: tuple[str, ...] = (
    *DOUBTS,
    "springs-illustrative",
    "springs-missing",
    "stiffness-not-identified",
    "suspects",
    "hardly-explained",
    "linear-differs",
    "no-equilibrium",
    "unstable",
    "flutter",
    "divergence",
    "bifurcation",
    "limit-point",
    "unstable-start",
    "other-equilibrium",
    "implausible-deflection",
    "doubtful-units",
    "beyond-limits",
    "force-limits",
    "limit-contact",
    "indefinite",
    "negative-stiffness",
    "singular-stiffness",
    "type-2-singularity",
    "near-type-2-singularity",
    "near-serial-singularity",
    "near-constraint-singularity",
    "nearly-still",
    "ill-conditioned",
    "slack",
    "direction-dependent",
    "link-compressed",
    "implausible-mass",
    "impossible-inertia",
    "weightless",
    "massless",
    "masses-unknown",
    "many-turns",
    "rest-of-turns",
    "limits-of-turns",
    "wrench-ignored",
    "idle-springs",
    "idle-link",
    "tensions-chosen",
    "load-replaces-rest",
    "actuators-adjusted",
    "pose-follows",
)
_WEIGHT = {code: weight for weight, code in enumerate(WEIGHTS)}
_ILLUSTRATIVE = Note("springs-illustrative", "the springs are illustrative, not measured")


def doubts_of(
    elastic: ElasticMechanism, notes: Iterable[Note], verdict: Verdict | None = None
) -> tuple[Note, ...]:
    """The notes that cast doubt on an answer, the weightiest first, each once.

    What the verdict says is no doubt beside it.
    """
    said = None if verdict is None else verdict.code
    every = [*notes, *([_ILLUSTRATIVE] if elastic.is_illustrative else [])]
    found = {
        (note.code, note.message): note
        for note in every
        if note.code in _WEIGHT and note.code != said
    }
    return tuple(sorted(found.values(), key=lambda note: _WEIGHT[note.code]))
