"""Two mechanisms under one question, side by side, with the ratios of their numbers.

Both are read by `answer_at`, each at its posture. Directions are those of the room, in
which both are placed by their own bases; the axes of two tools have nothing in common. No
number depends on a length by which angles are multiplied: the condition number is that at
the length where it is least, each mechanism's own.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import numpy as np

from cartstiff.answer.analysis.ellipsoids import Freedom
from cartstiff.answer.analysis.indices import best_conditioned_length
from cartstiff.answer.analysis.principal import matrix_pair
from cartstiff.answer.data import Answer, Displacement, Shares
from cartstiff.answer.posture import answer_at
from cartstiff.core import numerics
from cartstiff.core.arrays import Array, plain
from cartstiff.core.checked_call import checked
from cartstiff.core.described import described
from cartstiff.core.errors import InputError, UndefinedError, checked_kind
from cartstiff.core.figures import new_figure
from cartstiff.core.lazily import cached_property
from cartstiff.core.notes import Note
from cartstiff.core.results import LabelledResult
from cartstiff.core.stiffness.compute import PostureStiffness
from cartstiff.core.units import Units, shown_unit

#: Quantities that the answer is about.
DISPLACEMENT, SOFTEST = "displacement under the load", "softest translation"
#: Why two numbers have no ratio: where there is none, or one of them is not above zero.
NoRatio = Literal["first", "second", "both", "sign"]
_MISSING: dict[tuple[bool, bool], NoRatio] = {
    (True, False): "first",
    (False, True): "second",
    (True, True): "both",
}

# Angle [rad] between the directions of a load in the room above which they are different
# loads.
_SAME_DIRECTION = 1e-3
_FREEDOMS: tuple[tuple[Freedom, str], ...] = (
    ("translation", "along"),
    ("rotation", "about"),
)
_ENDS = ("softest", "stiffest")


@dataclass(frozen=True)
class ComparedNumber:
    """A number of both mechanisms.

    Attributes
    ----------
    quantity : str
        What it is.
    unit : str
        Unit of both.
    first, second : float or None
        None where it does not exist.
    ratio : float or None
        The second over the first; None where one is missing or not above zero.
    because : str or None
        Why there is no ratio; None where there is one.
    """

    quantity: str
    unit: str
    first: float | None
    second: float | None
    ratio: float | None = None
    because: NoRatio | None = None

    @classmethod
    def of(
        cls, quantity: str, unit: str, first: float | None, second: float | None
    ) -> ComparedNumber:
        """The numbers with their ratio, or why there is none."""
        if first is None or second is None:
            because = _MISSING[first is None, second is None]
            return cls(quantity, unit, first, second, None, because)
        if min(first, second) <= 0.0:
            return cls(quantity, unit, first, second, None, "sign")
        return cls(quantity, unit, first, second, second / first)


@dataclass(frozen=True, eq=False)
class Compared:
    """One of the two mechanisms, with its answer.

    Attributes
    ----------
    label : str
        Its name for people, another one than that of the other mechanism.
    result : PostureStiffness
        From `cartstiff.analyse`.
    answer : Answer
        What is said about it.
    """

    label: str
    result: PostureStiffness
    answer: Answer

    @property
    def freedoms(self) -> int:
        """Number of independent motions of the body."""
        return self.result.reduction.rank

    @cached_property
    def load(self) -> Array | None:
        """Given moment about M's origin, and force, along the axes of F;
        None without them.
        """
        load = self.answer.load
        if load is None or not load.given or not any((*load.moment, *load.force)):
            return None
        arm = self.result.pose[:3, :3] @ load.at
        return np.array([*(load.moment + np.cross(arm, load.force)), *load.force])

    @property
    def displacement(self) -> Displacement | None:
        """Displacement under the given load; None where it is not resisted."""
        return None if self.load is None else self.answer.displacement

    @property
    def shares(self) -> Shares | None:
        """What contributes to that displacement."""
        return None if self.displacement is None else self.answer.shares

    def sizes(self, at_rest: bool) -> tuple[float | None, float | None]:
        """Displacement and rotation, between the equilibria or to first order;
        round-off of the other is 0.
        """
        moved = self.displacement
        if moved is None:
            return None, None
        motion = (moved.first_order, moved.equilibrium)[at_rest]
        if motion is None:
            return None, None
        far, turn = math.hypot(*motion.translation), math.hypot(*motion.rotation)
        least, length = numerics.PRINTED_AS_ZERO, self.result.length
        is_far, is_turned = far >= least * turn * length, turn * length >= least * far
        return far * is_far, turn * is_turned

    def in_room(self, freedom: Freedom) -> list[float | None]:
        """Stiffness along, or about, x, y and z of F, all other freedoms without load."""
        pair = matrix_pair(self.result.at(), self.answer.verdict.connection, "free")
        # Row i: axis i of F along those of the body.
        found: list[float | None] = plain(
            pair.on_axes(self.result.pose[:3, :3], freedom, "free")
        )
        return found

    @property
    def condition(self) -> float | None:
        """Least condition number over all characteristic lengths."""
        pair = matrix_pair(self.result.at(), self.answer.verdict.connection)
        if pair.K is None:
            return None
        with suppress(UndefinedError):
            best = best_conditioned_length(pair.K, pair.C)
            return float(best.condition_at_best_length)
        return None

    def to_dict(self) -> dict[str, Any]:
        """For JSON."""
        about = self.result.elastic.about()
        verdict, soft = self.answer.verdict, self.answer.extreme("softest")
        return {
            "label": self.label,
            **{key: value for key, value in about.items() if key != "units"},
            "q": self.result.q,
            "pose": self.result.pose,
            "load": self.load,
            "freedoms": self.freedoms,
            "verdict": {"level": verdict.level, "code": verdict.code},
            "softest_direction": None if soft is None else soft.direction,
            "springs_in_doubt": self.result.elastic.springs_in_doubt,
        }


@dataclass(frozen=True, eq=False, repr=False)
class Comparison(LabelledResult):
    """Two mechanisms side by side.

    Attributes
    ----------
    first, second : Compared
        The mechanisms.
    """

    command: ClassVar = "compare"

    first: Compared
    second: Compared

    @property
    def units(self) -> Units:
        """Units of every number."""
        return self.first.result.units

    @property
    def distance(self) -> float:
        """Distance between the origins of the body frames."""
        places = (x.result.pose[:3, 3] for x in (self.first, self.second))
        return numerics.norm(np.subtract(*places))

    @property
    def softest_angle(self) -> float | None:
        """Angle [rad] between the softest directions; None if one of them is not one."""
        a, b = (x.answer.extreme("softest") for x in (self.first, self.second))
        if a is None or b is None or a.direction is None or b.direction is None:
            return None
        angle = _angle(np.array(a.direction), np.array(b.direction))
        return min(angle, math.pi - angle)  # a direction is a line

    @cached_property
    def displacement_by(self) -> Literal["first order", "equilibrium"] | None:
        """How both displacements were computed; None unless both exist.

        By the equilibria where one of them is far from first order, and both are known.
        """
        a, b = self.first.displacement, self.second.displacement
        if a is None or b is None:
            return None
        is_far = not (a.is_first_order and b.is_first_order)
        are_known = a.equilibrium is not None and b.equilibrium is not None
        return "equilibrium" if is_far and are_known else "first order"

    @cached_property
    def numbers(self) -> tuple[ComparedNumber, ...]:
        """Every number that both may have."""
        return tuple(self._numbers())

    def _numbers(self) -> Iterator[ComparedNumber]:
        units, both = self.units, (self.first, self.second)
        if any(x.load is not None for x in both):
            at_rest = self.displacement_by == "equilibrium"
            moved, turned = zip(*(x.sizes(at_rest) for x in both), strict=True)
            yield ComparedNumber.of(DISPLACEMENT, units.length, *moved)
            yield ComparedNumber.of("rotation under the load", units.angle, *turned)
        for freedom, along in _FREEDOMS:
            unit = units.stiffness[freedom]
            a, b = (x.in_room(freedom) for x in both)
            for axis, first, second in zip("xyz", a, b, strict=True):
                name = f"stiffness {along} {axis} of the room"
                yield ComparedNumber.of(name, unit, first, second)
            for end in _ENDS:
                found = (x.answer.extreme(end, freedom) for x in both)
                values = (None if e is None else e.stiffness for e in found)
                yield ComparedNumber.of(f"{end} {freedom}", unit, *values)
        yield ComparedNumber.of(
            "least condition number", "1", *(x.condition for x in both)
        )

    @cached_property
    def shares(self) -> dict[str, Any] | None:
        """What joints or legs share ("displacement", "energy"), and their shares by name.

        None without a load, and where the mechanisms share different things.
        """
        a, b = self.first.shares, self.second.shares
        if a is None or b is None or a.of != b.of:
            return None
        first, second = ({part.name: part.share for part in x.parts} for x in (a, b))
        parts = [
            {"name": name, "first": first.get(name), "second": second.get(name)}
            for name in {**first, **second}
        ]
        return {"of": a.of, "parts": parts}

    @cached_property
    def doubts(self) -> tuple[Note, ...]:
        """Reasons to doubt one of the answers, which begin with its label, or both."""
        return self._of_both(self.first.answer.doubts, self.second.answer.doubts)

    def _of_both(self, a: tuple[Note, ...], b: tuple[Note, ...]) -> tuple[Note, ...]:
        """Notes of both mechanisms: what is the same once."""
        first, second = ([note.to_dict() for note in notes] for notes in (a, b))
        labels = (self.first.label, self.second.label)
        named = [("both" if n.to_dict() in second else labels[0], n) for n in a]
        named += [(labels[1], n) for n in b if n.to_dict() not in first]
        return tuple(Note(n.code, f"{who}: {n.message}", n.values) for who, n in named)

    @cached_property
    def notes(self) -> tuple[Note, ...]:
        """What is not the same in both, the doubts, and the other notes of each."""
        a, b = self.first, self.second
        own = list[Note]()
        if a.freedoms != b.freedoms:
            words = (
                f"the body has {a.freedoms} free motions with {a.label} and {b.freedoms} "
                f"with {b.label}: what only one of them can do has no ratio"
            )
            values = {"first": a.freedoms, "second": b.freedoms}
            own.append(Note("different-freedoms", words, values))
        if (turn := self._turn_of_load) > _SAME_DIRECTION:
            words = (
                "the load has the axes of each body, which differ: in the room it acts "
                f"{math.degrees(turn):.4g} deg apart; --world gives both the same"
            )
            own.append(Note("different-loads", words, {"angle": turn}))
        others = self._of_both(a.result.notes, b.result.notes)
        told = {(note.code, note.message) for note in self.doubts}
        rest = (note for note in others if (note.code, note.message) not in told)
        return (*own, *self.doubts, *rest)

    @property
    def _turn_of_load(self) -> float:
        """Angle [rad] between the forces, or moments, of the load in the room."""
        a, b = self.first.load, self.second.load
        if a is None or b is None:
            return 0.0
        return max(_angle(a[:3], b[:3]), _angle(a[3:], b[3:]))

    def to_dict(self) -> dict[str, Any]:
        """For JSON: the object printed by ``cartstiff compare --json``."""
        both = {"first": self.first.to_dict(), "second": self.second.to_dict()}
        return described("compare", both | {"units": self.units.to_dict()}, self)

    def _lines(self) -> Iterator[str]:
        pair = f"{self.second.label} compared with {self.first.label}"
        yield f"{pair}: second, first, ratio"
        for n in self.numbers:
            shown = ("-" if x is None else f"{x:.4g}" for x in (n.second, n.first))
            ratio = f"  x {n.ratio:.4g}" if n.ratio is not None else ""
            yield f"  {n.quantity} [{n.unit}]  {'  '.join(shown)}{ratio}"

    def plot(self, ax: Any = None) -> Any:
        """Draw the numbers of both as bars, each pair with its ratio.

        Parameters
        ----------
        ax : matplotlib.axes.Axes, optional
            Whose place the picture takes; default a figure of its own.

        Returns
        -------
        matplotlib.figure.Figure

        Raises
        ------
        InputError
            If there is nothing that both have.
        MissingDependencyError
            Without matplotlib.
        """
        units, panels = self.units, []
        for title, unit in (
            ("Displacement", units.length),
            ("Stiffness: force over displacement", units.stiffness["translation"]),
            ("Stiffness: moment over rotation", units.stiffness["rotation"]),
        ):
            rows = [n for n in self.numbers if n.unit == unit and n.ratio is not None]
            panels += [(title, *shown_unit(unit), rows)] * bool(rows)
        if not panels:
            raise InputError("no number of both to draw", got="none that has a ratio")
        doubts = dict.fromkeys(
            f"{x.label}: {doubt}"
            for x in (self.first, self.second)
            if (doubt := x.result.elastic.springs_in_doubt)
        )
        heights = [0.9 + 0.45 * len(rows) for *_, rows in panels]
        figure = new_figure(7.6, 0.9 + sum(heights), "; ".join(doubts), ax=ax)
        axes = figure.subplots(len(panels), 1, height_ratios=heights, squeeze=False)[:, 0]
        for axis, (title, unit, per, rows) in zip(axes, panels, strict=True):
            _draw_pairs(axis, rows, per, (self.first.label, self.second.label))
            axis.set_xlabel(f"{title} [{unit}]")
        figure.legend(
            *axes[0].get_legend_handles_labels(), loc="outside upper center", ncols=2
        )
        return figure


def _draw_pairs(
    axis: Any, rows: list[ComparedNumber], per: float, labels: tuple[str, str]
) -> None:
    """Draw pairs of bars, the first row at the top, with the ratios behind them."""
    places = np.arange(len(rows))
    pairs = np.array([(n.first, n.second) for n in rows], float) * per
    for i, (label, colour) in enumerate(
        zip(labels, ("tab:blue", "tab:orange"), strict=True)
    ):
        axis.barh(places + 0.4 * i, pairs[:, i], 0.38, color=colour, label=label)
    for place, n, pair in zip(places, rows, pairs, strict=True):
        axis.annotate(
            f" × {n.ratio:.3g}", (pair.max(), place + 0.2), va="center", fontsize="small"
        )
    axis.set_yticks(places + 0.2, [n.quantity for n in rows])
    axis.invert_yaxis()
    axis.margins(x=0.12)
    for side in ("top", "right"):
        axis.spines[side].set_visible(False)


def _angle(a: Array, b: Array) -> float:
    """Angle [rad] between two vectors; 0 if one of them is zero."""
    return math.atan2(numerics.norm(np.cross(a, b)), float(np.dot(a, b)))


@checked
def compare(
    first: PostureStiffness,
    second: PostureStiffness,
    *,
    labels: tuple[str, str] | None = None,
) -> Comparison:
    """Compare two mechanisms, or one at two postures or with two sets of springs.

    Parameters
    ----------
    first, second : PostureStiffness
        From `cartstiff.analyse`, under the loads that are to be compared. Ratios are the
        second over the first.
    labels : (str, str), optional
        Names for people; default those of the mechanisms, or "first" and "second" if they
        have the same name.

    Returns
    -------
    Comparison
        Displacement and rotation under the load, stiffness along and about the axes of
        the room, principal stiffnesses, condition number, and the shares of joints or
        legs.

    Raises
    ------
    InputError
        If they have different units.

    Examples
    --------
    >>> import cartstiff
    >>> load = {"wrench": [0, 0, 0, 0, 0, -100]}
    >>> files = [{"sz": z} for z in (0.5, 0.6)]
    >>> a, b = (cartstiff.load("inclined-hexapod", parameters=given) for given in files)
    >>> results = [cartstiff.analyse(each, **load) for each in (a, b)]
    >>> found = cartstiff.compare(*results)
    >>> found.numbers[0].quantity, round(found.numbers[0].ratio, 3)
    ('displacement under the load', 0.694)
    """
    for which, result in (("first", first), ("second", second)):
        checked_kind(result, PostureStiffness, which, "what cartstiff.analyse answers")
    if first.units != second.units:
        raise InputError(
            "the mechanisms have different units",
            expected=f"{first.units.length} and {first.units.force} in both",
            got=f"{second.units.length} and {second.units.force}",
        )
    names = labels or (first.elastic.name, second.elastic.name)
    if labels is None and names[0] == names[1]:
        names = ("first", "second")
    return Comparison(
        Compared(names[0], first, answer_at(first)),
        Compared(names[1], second, answer_at(second)),
    )
