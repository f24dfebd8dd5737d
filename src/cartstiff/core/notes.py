"""Notes on results; among them those on assumed stiffnesses."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from cartstiff.core.errors import UndefinedError

#: Codes of notes that come before an answer, which may say nothing about the real
#: machine.
DOUBTS = ("stiffness-assumed", "held-by-lines", "open-loops")


@dataclass(frozen=True)
class Note:
    """A note on a result: a code, a message, and the numbers that show it."""

    code: str
    message: str
    values: Mapping[str, object] = field(default_factory=dict)

    @classmethod
    def of(cls, error: UndefinedError, what: str = "") -> Note:
        """Note with the reason why a quantity does not exist."""
        return cls(
            error.code, f"{what}: {error}" if what else str(error), dict(error.values)
        )

    def __str__(self) -> str:
        return f"[{self.code}] {self.message}"

    def to_dict(self) -> dict[str, object]:
        """For JSON."""
        from cartstiff.core.arrays import (
            plain,
        )  # the command line reads notes' codes without NumPy

        return {"code": self.code, "message": self.message, "values": plain(self.values)}


def assumed_stiffness(value: float, joints: Sequence[str], of: Sequence[str]) -> Note:
    """Note on joints, among all in `of`, with an assumed stiffness."""
    every = len(joints) == len(of)
    who = "every joint" if every else ", ".join(joints)
    return Note(
        "stiffness-assumed",
        f"no {'joint ' if every else ''}stiffness was given"
        f"{'' if every else ' for some joints'}: {value:g} N m/rad (N/m for prismatic "
        "joints) is "
        f"taken for {who} and says nothing about the real robot; give --springs (see "
        "`cartstiff "
        "models`) or --stiffness, or measure it (`cartstiff identify`)",
        {"stiffness": value, "joints": list(joints), "all_joints": list(of)},
    )


def held_by_lines(joints: Sequence[str]) -> Note:
    """Note on joints that line springs alone hold, as no other spring was given."""
    several = len(joints) > 1
    return Note(
        "held-by-lines",
        f"line springs alone hold {', '.join(joints)}: "
        f"{'these joints have' if several else ''}"
        f"{'' if several else 'the joint has'} no spring of "
        f"{'their' if several else 'its'} own "
        "in the file, and none is assumed; if drives hold "
        f"{'them' if several else 'it'}, give --stiffness joint=value, or 'springs' in a "
        "mechanism "
        "file ('passive' there says that there are none)",
        {"joints": list(joints)},
    )


def table_as_read(joints: Sequence[str], pieces: str) -> Note:
    """Note on what is between the points of the tables of joint springs."""
    who = f"the table{'s' * (len(joints) > 1)} of {', '.join(joints)}"
    words = {
        "linear": f"{who}: straight lines between the points (pieces: linear), with a "
        "corner at "
        "each; 'pieces: smooth' in the file makes a curve without corners",
        "smooth": f"{who}: a smooth curve through the points (pieces: smooth); 'pieces: "
        "linear' in "
        "the file makes straight lines, as catalogues mean",
    }
    return Note("spring-table", words[pieces], {"joints": list(joints), "pieces": pieces})


def still_assumed(notes: tuple[Note, ...], stiffness: object) -> tuple[Note, ...]:
    """Notes that remain after stiffnesses were given to all joints,
    or to those in a mapping.
    """
    made: dict[str, Callable[[list[str], Mapping[str, Any]], Note]] = {
        "stiffness-assumed": lambda names, of: assumed_stiffness(
            of["stiffness"], names, of["all_joints"]
        ),
        "held-by-lines": lambda names, _: held_by_lines(names),
        "spring-table": lambda names, of: table_as_read(names, of["pieces"]),
    }
    kept = []
    for note in notes:
        if note.code == "springs-missing":
            continue
        if note.code == "published-springs" and not isinstance(stiffness, Mapping):
            continue
        if note.code not in made:
            kept.append(note)
        elif isinstance(stiffness, Mapping):
            values: Any = note.values
            left = [name for name in values.get("joints", ()) if name not in stiffness]
            kept += [made[note.code](left, values)] if left else []
    return tuple(kept)
