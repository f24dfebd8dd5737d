"""The verdict on a posture, decided once: a table of rules,
of which the first that fits decides.

A rule needs *facts*: codes of notes, and what `facts_of` says about the matrix. The
page's script gets the same table and takes its first rule as well, so that no second
decision exists.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
from typing import Literal

Level = Literal["good", "warning", "bad"]

#: Facts about the matrix that is read; its definiteness is another.
MISSING, NOT_TANGENT, ASYMMETRIC, FLAT = "no matrix", "not tangent", "asymmetric", "F"
#: Definiteness of a matrix whose digits do not decide it.
UNRESOLVED = "unresolved"


#: Levels of the verdicts that statements are, where they are not good.
LEVELS: dict[str, Level] = {
    "no-feasible-design": "bad",
    "no-assembly": "bad",
    "modes-may-be-missing": "warning",
    "no-workspace": "bad",
    "springs-undetermined": "warning",
    "not-loaded": "warning",
    "unstable-modes": "bad",
    "unstable-from": "bad",
    "critical-load": "warning",
    "free-modes": "warning",
}


@dataclass(frozen=True)
class Verdict:
    """The code of a state, and whether it is good.

    Attributes
    ----------
    level : {"good", "warning", "bad"}
        bad: the posture is not stable, or no matrix exists.
    code : str
        A definiteness, the code of a note, or that of a statement.
    connection : str
        The matrix that was read; "" if it is not one that decides.
    symmetrised : bool
        Whether its symmetric part was.
    """

    level: Level
    code: str
    connection: str = ""
    symmetrised: bool = False


@dataclass(frozen=True)
class Rule:
    """A verdict, and the facts that it needs."""

    needs: frozenset[str]
    level: Level
    code: str


# States that leave no matrix, the most specific first.
_WITHOUT_MATRIX: tuple[tuple[str, Level], ...] = (
    ("constraint-singularity", "bad"),
    ("non-regular-redundancy", "bad"),
    ("unbalanced", "bad"),
    ("buckled", "bad"),
    ("strut-buckled", "bad"),
    ("strut-not-found", "bad"),
    ("serial-singularity", "bad"),
    ("idle-self-motion", "bad"),
    ("indefinite", "bad"),
    ("actuators-adjusted", "warning"),
    ("fewer-than-six-freedoms", "warning"),
)
# States that a matrix may have beside it.
_WITH_MATRIX: tuple[tuple[str, Level], ...] = (
    ("type-2-singularity", "bad"),
    ("actuators-adjusted", "warning"),
    ("near-constraint-singularity", "warning"),
    ("singular-stiffness", "warning"),
    ("near-serial-singularity", "warning"),
    ("near-type-2-singularity", "warning"),
    ("slack", "warning"),
)
# Signs of a tangent with which the posture is not stable.
_UNSTABLE = ("indefinite", "negative semidefinite", "negative", "zero")

# Facts beside which these signs decide no stability.
_UNDECIDED: tuple[tuple[str, Level], ...] = (
    (NOT_TANGENT, "warning"),
    (ASYMMETRIC, "bad"),
)


def sign(definiteness: str) -> str:
    """The fact that the matrix that is read has a definiteness.

    A note has a code without "K".
    """
    return f"K {definiteness}"


def _rule(level: Level, code: str, *needs: str) -> Rule:
    return Rule(frozenset(needs), level, code)


#: All rules in their order.
RULES: tuple[Rule, ...] = (
    *(_rule(level, code, MISSING, code) for code, level in _WITHOUT_MATRIX),
    _rule("warning", "kf-undefined", MISSING, FLAT, "kf-undefined"),
    *(_rule(level, code, MISSING, code) for code, level in _WITH_MATRIX),
    _rule("bad", "no-stiffness", MISSING),
    _rule("bad", "indefinite", "indefinite"),  # by its note: the tangent is
    *(
        _rule(level, f"{fact} {kind}", fact, sign(kind))
        for fact, level in _UNDECIDED
        for kind in _UNSTABLE
    ),
    *(_rule("bad", kind, sign(kind)) for kind in _UNSTABLE),
    _rule("warning", UNRESOLVED, sign(UNRESOLVED)),
    *(_rule(level, code, code) for code, level in _WITH_MATRIX),
    _rule("warning", "positive semidefinite", sign("positive semidefinite")),
    _rule("good", "positive", sign("positive")),
)


def facts_of(
    codes: Iterable[str],
    definiteness: str | None,
    connection: str,
    *,
    is_tangent: bool,
    is_symmetric: bool,
) -> frozenset[str]:
    """The facts that rules need.

    Parameters
    ----------
    codes : iterable of str
        Codes of the posture's notes.
    definiteness : str or None
        Of the symmetric part of the matrix that is read; None where there is no matrix.
    connection : str
        Its name.
    is_tangent : bool
        Whether it is the tangent under the load, which alone decides stability.
    is_symmetric : bool
        Whether it is symmetric.
    """
    known = {
        MISSING if definiteness is None else sign(definiteness): True,
        NOT_TANGENT: not is_tangent,
        ASYMMETRIC: not is_symmetric,
        FLAT: connection == FLAT,
    }
    return frozenset([*codes, *(fact for fact, holds in known.items() if holds)])


@cache
def decide(facts: frozenset[str]) -> Rule:
    """The first rule whose facts all hold."""
    return next(rule for rule in RULES if rule.needs <= facts)
