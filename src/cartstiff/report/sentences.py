"""The words of an answer: one table of sentences, for text, HTML,
the page and its script.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from string import Formatter
from typing import Any

from cartstiff import numerics
from cartstiff.answer.data import (
    Answer,
    Displacement,
    Extreme,
    Quantity,
    Shares,
    Statement,
    Vector,
)
from cartstiff.answer.verdict import ASYMMETRIC, NOT_TANGENT, Verdict
from cartstiff.errors import listed
from cartstiff.report import layout
from cartstiff.units import Units, engineering, shown_unit

#: What a verdict's code says.
VERDICTS: dict[str, str] = {
    "positive": "Positive definite: every small motion is resisted",
    "positive semidefinite": "Positive semidefinite: some motion costs nothing",
    "indefinite": "Not stable: along some motion the body is pushed further away",
    "negative semidefinite": "Not stable: no motion is resisted",
    "negative": "Not stable: every motion is pushed further away",
    "zero": "Zero stiffness: no motion is resisted",
    "unresolved": "Digits are lost: whether every motion is resisted is not known",
    "no-stiffness": "The matrix does not exist here",
    "kf-undefined": "No K^F: six coordinates are no chart here",
    "constraint-singularity": "Constraint singularity: branches of motion cross here",
    "non-regular-redundancy": "The closures lose rank and block the motion",
    "unbalanced": "Unbalanced: the arm would move by itself, no wrench holds it",
    "buckled": "Buckled: the energy has no minimum along the self-motion",
    "strut-buckled": "A strut has buckled between its flexures",
    "strut-not-found": "The flexures are bent too far: no balance of a strut was found",
    "serial-singularity": "Singular posture: a motion of the end-effector is impossible",
    "idle-self-motion": "A self-motion costs no energy, yet moves the end-effector",
    "actuators-adjusted": "The loops do not close there: drives have moved",
    "fewer-than-six-freedoms": "Fewer than six free motions: only the compliance exists",
    "type-2-singularity": "Singular posture: the actuators do not hold the body",
    "near-constraint-singularity": "The closures nearly repeat each other",
    "singular-stiffness": "Singular stiffness: one motion costs nothing",
    "near-serial-singularity": "Near a singularity: one motion is almost impossible",
    "near-type-2-singularity": "Near a singularity: one direction is hardly held",
    "slack": "Slack cables carry nothing",
    "stable": "The equilibrium is stable",
    "unstable": "The equilibrium is NOT stable: the load pushes the body away",
    "undecided": "Whether the equilibrium is stable is not decided by definiteness: see "
    "the notes",
}
_NO_STABILITY = {
    NOT_TANGENT: "it is not the tangent under this load and decides no stability",
    ASYMMETRIC: "along some motion the load pushes further away; as it has no potential, "
    "this "
    "decides no stability",
}
VERDICTS |= {
    f"{fact} {kind}": f"{kind.capitalize()}: {why}"
    for fact, why in _NO_STABILITY.items()
    for kind in ("indefinite", "negative semidefinite", "negative", "zero")
}

#: Sentences of statements by their code; "{length:4}" is a value with four digits, see
#: `value_words`. Those that begin with a line's place belong below a table.
SENTENCES: dict[str, str] = {
    "gravity": "{weight.text}",
    # design
    "study": "{subject}, {body_frame}: {designs} designs by {method}, {poses} pose(s) "
    "each",
    "case": "Load{of}: {load}",
    "feasible": "{feasible} feasible, {infeasible} infeasible, {failed} failed",
    "no-feasible-design": "No design is feasible: {infeasible} infeasible, {failed} "
    "failed",
    "more-designs": "  ... {count} more; -o FILE.csv and --json have all",
    "more-reasons": "  ... {count} other reasons",
}

#: Titles of tables, where these are not their names.
TITLES: dict[str, str] = {
    "measures": "Objectives and constraints",
    "best design": "Best design",
    "front": "Pareto front: {count} designs, of which none is better in everything",
    "infeasible": "Why designs are infeasible",
    "failed": "Why designs fail",
}

_BY = {
    "load": "under the load",
    "added load": "under the added load",
    "preload": "when the wrench that holds it is taken away",
}
_OTHER = {"translation": "turn", "rotation": "move"}
_WITH_HELD = {"translation": "with turning blocked", "rotation": "with moving blocked"}
_TOWARDS = {"translation": "along", "rotation": "about"}
#: Angles [deg] from a line up to which a direction is along it, and up to which it is
#: almost so.
ALONG, ALMOST = 1.0, 20.0


def title(verdict: Verdict) -> str:
    """The sentence of a verdict, with the matrix that was read, if one was."""
    if not verdict.connection:
        return VERDICTS[verdict.code]
    part = "the symmetric part of " if verdict.symmetrised else ""
    return f"{VERDICTS[verdict.code]} ({part}K^{verdict.connection})"


def direction_words(
    direction: Vector, is_line: bool = True, is_upright: bool = True
) -> str:
    """A direction of the room in words: "almost vertical, 4 deg off z", "horizontal,
    along y".

    Parameters
    ----------
    direction : tuple of float
        A vector along the axes of F.
    is_line : bool
        Whether its sign means nothing.
    is_upright : bool
        Whether z is vertical.
    """
    size = math.hypot(*direction)
    x, y, z = (value / size for value in direction)
    off = math.degrees(math.atan2(math.hypot(x, y), abs(z)))
    up = "" if is_line else " upwards" if z > 0.0 else " downwards"
    vertical, horizontal = f"vertical{up}", "horizontal"
    if not is_upright:
        vertical, horizontal = f"along {_sign(z, is_line)}z", "in the xy plane"
    if off <= ALONG:
        return vertical
    axis = f"{off:.0f} deg off {_sign(z, is_line)}z"
    if off <= ALMOST:
        return f"almost {vertical}, {axis}"
    (near, name), (far, _) = sorted(((x, "x"), (y, "y")), key=lambda part: -abs(part[0]))
    beside = math.degrees(math.atan2(abs(far), abs(near)))
    name = f"{_sign(near, is_line)}{name}"
    across = f"along {name}" if beside <= ALONG else f"{beside:.0f} deg off {name}"
    if off >= 90.0 - ALONG:
        return f"{horizontal}, {across}"
    if off >= 90.0 - ALMOST:
        return f"almost {horizontal}, {90.0 - off:.0f} deg off the xy plane, {across}"
    return f"{axis} towards {name}"


def _sign(value: float, is_line: bool) -> str:
    return "-" if value < 0.0 and not is_line else ""


def vector_words(values: Sequence[float], digits: int = 2) -> str:
    """A unit vector in brackets."""
    return f"({', '.join(f'{round(x, digits) + 0.0:g}' for x in values)})"


def displacement_words(answer: Answer) -> Iterator[str]:
    """How far the point moves, which way, and by which part."""
    moved, units = answer.displacement, answer.units
    if moved is None:
        return
    if not any((*moved.said.translation, *moved.said.rotation)):
        yield "The load moves nothing: the structure carries it"
        return
    what = "This point" if any(moved.point) else "The body frame"
    if moved.by == "preload":
        yield "No load is given: the springs need the wrench below to hold the body here"
    yield f"{what} {_moves(moved, answer)}{_beside(moved, units)}"
    if answer.shares is not None:
        yield share_words(answer.shares)


def is_upright(answer: Answer) -> bool:
    """Whether z is vertical: gravity, if any is known, is along it."""
    gravity = None if answer.load is None else answer.load.gravity
    return gravity is None or not any(gravity[:2])


def _moves(moved: Displacement, answer: Answer) -> str:
    """Size, cause and direction of a displacement.

    Of the rotation where the point stays.
    """
    said, by = moved.said, _BY[moved.by]
    size = math.hypot(*said.translation)
    if size == 0.0:
        return f"stays and turns {math.degrees(math.hypot(*said.rotation)):.4g} deg {by}"
    which = direction_words(said.translation, False, is_upright(answer))
    return f"moves {engineering(size, answer.units.length)} {by}, {which}"


def _beside(moved: Displacement, units: Units) -> str:
    """What the displacement was computed from, and the other value where they differ."""
    linear = f"to first order, K^{moved.connection}"
    if moved.first_order is None:
        return " (by the equilibrium)"
    if moved.is_first_order:
        return f" ({linear})"
    far = engineering(math.hypot(*moved.first_order.translation), units.length)
    return f" (by the equilibrium; {far} {linear})"


def share_words(shares: Shares) -> str:
    """The joint, link or leg that contributes most; parts with equal shares together."""
    largest = abs(shares.parts[0].share)
    margin = numerics.NEGLIGIBLE_SHARE * largest
    alike = [p.name for p in shares.parts if abs(abs(p.share) - largest) <= margin]
    each = "each of " if len(alike) > 1 else ""
    of = {"displacement": "the first-order displacement", "energy": "its energy"}[
        shares.of
    ]
    words = (
        f"{percent(shares.parts[0].share)} of {of} comes from "
        f"{each}{listed(alike, most=6)}"
    )
    if abs(shares.rest) >= SMALLEST_SAID_REST:
        rest = percent(shares.rest)
        words += f"; the load and other potentials, no joint, contribute {rest}"
    return words


#: Rest of the shares from which on it is said.
SMALLEST_SAID_REST = 0.005


def percent(share: float) -> str:
    """A share in whole per cent."""
    return f"{round(100.0 * share) + 0} %"


def extreme_words(answer: Answer) -> Iterator[str]:
    """Softest and stiffest directions against forces and against moments."""
    for freedom in ("translation", "rotation"):
        soft, held, stiff = (
            answer.extreme(end, freedom, others)  # type: ignore[arg-type]
            for end, others in (
                ("softest", "free"),
                ("softest", "held"),
                ("stiffest", "free"),
            )
        )
        if soft is None:
            continue
        unit = answer.units.stiffness[freedom]
        guided = ""
        if held is not None and held.stiffness is not None:
            guided = f"; {engineering(held.stiffness, unit)} {_WITH_HELD[freedom]}"
        yield (
            f"Softest (free to {_OTHER[freedom]}): {engineering(soft.stiffness, unit)} "
            f"{where(soft, answer)}{guided}"
        )
        if stiff is not None:
            size = engineering(stiff.stiffness, unit)
            if stiff.stiffness is None:
                size = "held by the structure"
            yield f"Stiffest (free to {_OTHER[freedom]}): {size} {where(stiff, answer)}"


def where(extreme: Extreme, answer: Answer) -> str:
    """The direction of an extreme in words, with its vector in the room."""
    towards = _TOWARDS[extreme.freedom]
    if extreme.direction is None:
        return f"{towards} more than one direction alike"
    words = direction_words(extreme.direction, is_upright=is_upright(answer))
    return f"{towards} {vector_words(extreme.direction)} of the room, {words}"


def answer_sentences(answer: Answer) -> list[str]:
    """The sentences of an answer, without its doubts.

    The verdict comes first: it has a title, or is said by the statement of its code.
    """
    code = answer.verdict.code
    titles = [title(answer.verdict)] if code in VERDICTS else []
    statements = sorted(answer.statements, key=lambda one: one.code != code)
    return [
        *titles,
        *displacement_words(answer),
        *extreme_words(answer),
        *statement_sentences(answer, statements),
    ]


def statement_sentences(answer: Answer, statements: Iterable[Statement]) -> list[str]:
    """The sentences of statements, which may name the mechanism and its frame."""
    frames = {"frame": answer.frame, "frame_offset": answer.frame_offset}
    about = {
        "subject": answer.subject,
        "kind": answer.kind,
        "body_frame": layout.body_frame(frames, answer.units),
    }
    return [sentence(SENTENCES[s.code], about | dict(s.values)) for s in statements]


def sentence(template: str, values: Mapping[str, Any]) -> str:
    """A sentence with its values."""
    return _Words().vformat(template, (), values)


class _Words(Formatter):
    """Templates whose fields are written by `value_words`."""

    def format_field(self, value: Any, spec: str) -> str:
        """A value as people read it."""
        return value_words(value, spec)


def value_words(value: Any, spec: str = "") -> str:
    """A value as people read it; None as "-", lists with commas.

    Parameters
    ----------
    value : str, int, float, Quantity, list or None
        A quantity is written in the unit of texts, and with its unit.
    spec : str
        Digits, default 5, and a letter: f: so many decimal places; n: without the unit;
        e: in the unit of its size, such as kN; p: angles in both units; %: a share in per
        cent, with two digits.
    """
    letter = spec.lstrip("0123456789")
    digits = int(spec.removesuffix(letter) or 5)
    if isinstance(value, (list, tuple)):
        return ", ".join(value_words(x, spec) for x in value)
    if isinstance(value, Quantity):
        return _quantity_words(value, digits, letter)
    if letter == "f":
        return f"{round(value, digits) + 0.0:.{digits}f}"
    if letter == "%":
        return layout.percent(value)
    if isinstance(value, float):
        return layout.number(value, digits)
    return "-" if value is None else WORDS.get(str(value), str(value))


def _quantity_words(quantity: Quantity, digits: int, letter: str) -> str:
    """A number, or numbers in brackets, with the unit."""
    x, (unit, per) = quantity.value, shown_unit(quantity.unit)
    if isinstance(x, tuple):
        return f"{layout.vector([per * value for value in x], digits)} {unit}"
    if letter == "n":
        return layout.number(x and per * x, digits)
    if letter not in ("e", "p") or x is None:
        return f"{layout.number(x and per * x, digits)} {unit}"
    if unit == "1":
        return percent(x)
    if quantity.unit == Units.angle:
        both = f"{x:.{digits}g} rad " * (letter == "p")
        return f"{both}{per * x:.4g} {unit}"
    return engineering(x, quantity.unit, digits)


#: Words of codes, and of flags.
WORDS = {"True": "yes", "False": "NO"}


def doubt_sentences(answer: Answer) -> list[str]:
    """The doubts as sentences, the weightiest first."""
    return [f"{n.message[:1].upper()}{n.message[1:]}" for n in answer.doubts]
