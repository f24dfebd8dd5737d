"""An answer as plain data: numbers with units and frames, codes, and no words.

Every question has the same parts: a verdict; statements, each the code of a sentence with
the numbers in it; the displacement, shares and extremes of a posture, which have
sentences of their own; doubts; tables, whose columns say in which unit and with how many
digits people read them; the other notes. The words are in
`cartstiff.shown.report.sentences`; text, JSON, report and page render the same object.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from math import hypot
from typing import Any, Literal

from cartstiff.answer.analysis.ellipsoids import Freedom, Others
from cartstiff.answer.doubts import doubts_of
from cartstiff.answer.verdict import LEVELS, Verdict
from cartstiff.core import numerics
from cartstiff.core.arrays import plain
from cartstiff.core.mechanisms.elastic import ElasticMechanism
from cartstiff.core.mechanisms.gravity_loads import GravityLoads, gravity_loads
from cartstiff.core.notes import Note
from cartstiff.core.units import Units

Vector = tuple[float, float, float]
#: Size for the round-off of components of unit vectors, so that those below 1e-9 are 0.
COSINES = numerics.REPORTED_ERROR / numerics.PRINTED_AS_ZERO
Cause = Literal["load", "preload", "added load"]


@dataclass(frozen=True)
class Load:
    """The wrench on the body, its behaviour while the body moves,
    and what acted before it.

    Attributes
    ----------
    given : bool
        Whether it was given; else it is what the springs need to keep this posture.
    kind : {"dead", "follower", "conservative"}
        Its behaviour while the body moves.
    at : tuple of float
        The point of the body, in M, at which it acts.
    force, moment : tuple of float
        Along the axes of F; the moment about that point.
    gravity : tuple of float or None
        Acceleration [m/s^2] in F.
    mass : float
        Mass [kg] on which gravity acts.
    before : {"balanced", "given", "partly"} or None
        How the springs carry weight and payload before the load; see `ElasticMechanism`.
    """

    given: bool
    kind: str
    at: Vector
    force: Vector
    moment: Vector
    gravity: Vector | None
    mass: float
    before: str | None


@dataclass(frozen=True)
class Motion:
    """Translation of a point and rotation [rad] of the body, along the axes of F."""

    translation: Vector
    rotation: Vector


@dataclass(frozen=True)
class Displacement:
    """How far a point of the body moves.

    Attributes
    ----------
    by : {"load", "preload", "added load"}
        What moves it; "preload": what is taken away.
    connection : str
        The matrix of the first order.
    point : tuple of float
        The point in M.
    first_order : Motion or None
        By the compliance, if that was computed.
    equilibrium : Motion or None
        Between the equilibria without and with the load, if that was computed.
    difference : float or None
        Of the two translations, as a share of the latter.
    """

    by: Cause
    connection: str
    point: Vector
    first_order: Motion | None
    equilibrium: Motion | None = None
    difference: float | None = None

    @property
    def is_first_order(self) -> bool:
        """Whether the first order is said: it is all that is known,
        or differs by 2 % at most.
        """
        if self.first_order is None:
            return False
        return self.difference is None or self.difference <= LARGEST_UNSAID_DIFFERENCE

    @property
    def said(self) -> Motion:
        """The displacement that is said first."""
        both = self.first_order, self.equilibrium
        return next(m for m in both[:: 1 if self.is_first_order else -1] if m is not None)


#: Difference of first order and equilibrium above which the latter is said.
LARGEST_UNSAID_DIFFERENCE = 0.02


@dataclass(frozen=True)
class Share:
    """The part of a joint, compliant link or leg."""

    name: str
    share: float


@dataclass(frozen=True)
class Shares:
    """Shares of the first-order displacement, or of its energy.

    Attributes
    ----------
    of : {"displacement", "energy"}
        What the shares add up to, together with the rest.
    parts : tuple of Share
        Each joint, compliant link or leg, the largest first.
    rest : float
        The share that none of them contributes: that of the load and of other potentials.
    """

    of: Literal["displacement", "energy"]
    parts: tuple[Share, ...]
    rest: float


@dataclass(frozen=True)
class Extreme:
    """The least or the greatest stiffness against a force, or against a moment.

    Attributes
    ----------
    end : {"softest", "stiffest"}
        Which.
    freedom : {"translation", "rotation"}
        Force per displacement, or moment per rotation.
    others : {"free", "held"}
        State of the other three freedoms.
    stiffness : float or None
        None: the structure holds it.
    direction : tuple of float or None
        Unit vector along the axes of F; None if more than one direction has this
        stiffness.
    """

    end: Literal["softest", "stiffest"]
    freedom: Freedom
    others: Others
    stiffness: float | None
    direction: Vector | None


@dataclass(frozen=True)
class Quantity:
    """A number, or numbers of one kind, with its unit; "1" for a share."""

    value: float | tuple[float | None, ...] | None
    unit: str


@dataclass(frozen=True)
class Frame:
    """A body frame M by its pose in a frame that has a name; lengths in a unit."""

    frame: str
    frame_offset: Sequence[Sequence[float]]
    length: str


def rounded(values: Iterable[float], size: float) -> tuple[float, ...]:
    """Numbers without the round-off of a size, which is zero."""
    least = numerics.PRINTED_AS_ZERO * size
    return tuple(float(x) * (abs(x) >= least) for x in values)


def wrench_parts(
    force: Sequence[float], moment: Sequence[float], units: Units
) -> dict[str, Quantity]:
    """Force and moment by their names; what is zero, or round-off, is not named, unless
    both are.
    """
    push, twist = (max(map(abs, part)) for part in (force, moment))
    named = dict[str, Quantity]()
    if push or not twist:
        named["force"] = Quantity(tuple(force), units.force)
    if twist > numerics.PRINTED_AS_ZERO * push:
        named["moment"] = Quantity(tuple(moment), units.moment)
    return named


@dataclass(frozen=True)
class Statement:
    """A statement by its code, which is that of its sentence, and what is in it.

    Attributes
    ----------
    code : str
        Key of `cartstiff.shown.report.sentences.SENTENCES`.
    values : mapping
        Names, numbers, and lists of these, by the name that the sentence uses.
    """

    code: str
    values: Mapping[str, Any] = field(default_factory=dict)


def said(code: str, /, **values: Any) -> Statement:
    """A statement with its values by name."""
    return Statement(code, values)


@dataclass(frozen=True)
class Column:
    """A column of a table.

    Attributes
    ----------
    head : str
        Name of what its cells are.
    unit : str
        Unit of its numbers; "" where they have none, or each has its own.
    form : str
        How people read a number: digits, then what is written; see
        `cartstiff.shown.report.sentences.value_words`. It ends with "?" where nothing is
        written for None, and with "<" where cells are left-aligned.
    """

    head: str
    unit: str = ""
    form: str = ""


@dataclass(frozen=True)
class Table:
    """Rows of cells under their columns.

    Attributes
    ----------
    name : str
        Key of `cartstiff.shown.report.sentences.TITLES`, or its title.
    columns : sequence of Column
        The columns; those without a cell are not written.
    rows : sequence of sequence
        Cells: names, numbers in the unit of their column, quantities with their own,
        statements, several of these, or None.
    values : mapping
        What is in the title, by name.
    below : sequence of Statement
        What the table needs to be understood.
    """

    name: str
    columns: Sequence[Column]
    rows: Sequence[Sequence[Any]]
    values: Mapping[str, Any] = field(default_factory=dict)
    below: Sequence[Statement] = ()


# A head, unit, key and form: "from [Hz] = interval.0 : 6".
_HEAD = re.compile(r"([^=\[:]*)(?:\[(.*)\])?(?:\s*= ([\w.]+))?(?:\s*: (\S+))?")


def table(
    name: str,
    heads: str | Sequence[Column],
    rows: Iterable[Sequence[Any] | Mapping[str, Any]],
    /,
    *below: Statement,
    **values: Any,
) -> Table:
    """A table with its columns in one line.

    Parameters
    ----------
    name : str
        Name of the table.
    heads : str or sequence of Column
        The columns, or their heads with "|" between them, each with its unit, key and
        form, if wanted: "from [Hz] = interval.0 : 6".
    rows : iterable
        Cells of each row, or mappings that have them under the keys of the columns; the
        key of a column is its head, if no other is named.
    *below : Statement
        What the table needs to be understood.
    **values
        What is in its title.
    """
    keys = list[str]()
    if isinstance(heads, str):
        columns = list[Column]()
        for part in heads.split("|"):
            head, unit, key, form = (x or "" for x in _HEAD.findall(part)[0])
            columns.append(Column(head.strip(), unit, form))
            keys.append(key or head.strip())
        heads = columns
    cells = [
        [_entry(row, key) for key in keys] if isinstance(row, Mapping) else row
        for row in rows
    ]
    return Table(name, heads, cells, values, below)


def _entry(data: Any, path: str) -> Any:
    """What is at a dotted path of keys and places; None where there is nothing."""
    for key in path.split("."):
        if data is None:
            break
        data = data[int(key)] if key.isdigit() else data[key]
    return data


@dataclass(frozen=True)
class Answer:
    """The answer to a question.

    Attributes
    ----------
    question : str
        The command's name.
    subject, kind, frame : str
        Name and kind of the mechanism, and the frame of its body.
    frame_offset : sequence of sequence of float
        ``T_frame_M``, the pose of the body frame M in that frame.
    units : Units
        Units of every number.
    verdict : Verdict
        On the posture, or on what was asked; said by the statement of its code, if there
        is one.
    about : sequence of Statement
        What was asked, the first with the mechanism.
    load : Load or None
        None in an unbalanced posture, and where no posture is asked about.
    weight : GravityLoads or None
        The masses on which gravity acts.
    displacement : Displacement or None
        Of the analysed point; None without a load, and where the body does not resist it.
    shares : Shares or None
        Of that displacement.
    extremes : sequence of Extreme
        Softest and stiffest directions that exist.
    statements : sequence of Statement
        What else is found.
    doubts : tuple of Note
        The reasons to doubt the answer, the weightiest first.
    tables : sequence of Table
        What the answer is read from: joints, legs, points, modes.
    notes : sequence of Note
        The other notes.
    """

    question: str
    subject: str
    kind: str
    frame: str
    frame_offset: Sequence[Sequence[float]]
    units: Units
    verdict: Verdict
    about: Sequence[Statement] = ()
    load: Load | None = None
    weight: GravityLoads | None = None
    displacement: Displacement | None = None
    shares: Shares | None = None
    extremes: Sequence[Extreme] = ()
    statements: Sequence[Statement] = ()
    doubts: tuple[Note, ...] = ()
    tables: Sequence[Table] = ()
    notes: Sequence[Note] = ()

    @classmethod
    def about_mechanism(
        cls,
        question: str,
        elastic: ElasticMechanism,
        notes: Iterable[Note],
        *statements: Statement,
        verdict: Verdict | None = None,
        **parts: Any,
    ) -> Answer:
        """An answer about a mechanism, its notes parted into doubts and others.

        Without a verdict the first statement is it.
        """
        mechanism = elastic.mechanism
        every = list({(note.code, note.message): note for note in notes}.values())
        if verdict is None:
            verdict = Verdict(LEVELS.get(statements[0].code, "good"), statements[0].code)
        doubts = doubts_of(elastic, every, verdict)
        if "weight" not in parts:
            parts["weight"] = gravity_loads(elastic)
        return cls(
            question=question,
            subject=elastic.name,
            kind=mechanism.kind,
            frame=mechanism.frame,
            frame_offset=mechanism.frame_offset.tolist(),
            units=elastic.units,
            verdict=verdict,
            doubts=doubts,
            notes=[note for note in every if note not in doubts],
            statements=(*statements, *parts.pop("statements", ())),
            **parts,
        )

    @property
    def far(self) -> float | None:
        """How far the load moves the point; None without a stable rest under a load."""
        moved = self.displacement
        is_unstable = any(note.code == "unstable" for note in self.doubts)
        if moved is None or moved.by == "preload" or is_unstable:
            return None
        return hypot(*moved.said.translation)

    def extreme(
        self, end: str, freedom: Freedom = "translation", others: Others = "free"
    ) -> Extreme | None:
        """The extreme of a kind; None if it does not exist."""
        wanted = (end, freedom, others)
        return next(
            (e for e in self.extremes if (e.end, e.freedom, e.others) == wanted), None
        )

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        data: dict[str, Any] = plain(self)
        return data | {"units": self.units.to_dict()}
