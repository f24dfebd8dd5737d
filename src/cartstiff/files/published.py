"""Joint springs by name or from a table: bundled published ones, and a user's own."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from cartstiff.core.errors import InputError, check_name
from cartstiff.core.mechanisms.elastic import ElasticMechanism
from cartstiff.core.notes import Note
from cartstiff.core.units import GivenStiffness
from cartstiff.files.tables import head_of, in_brackets, read_cells
from cartstiff.files.yaml_file import read_yaml

#: Meanings of the grades of sets.
GRADES = {
    "A": "seen in the authors' own data",
    "B": "second hand, quoted elsewhere",
    "C": "not a measurement of these joints",
}


def published_springs() -> Mapping[str, Any]:
    """Read the bundled sets: robot, grade, method, source and stiffness
    (N m/rad) by joint.
    """
    return read_yaml(Path(__file__).with_name("published_springs.yaml"))[0]


def with_named_springs(
    elastic: ElasticMechanism,
    name: str,
    where: str = "--springs",
    folder: Path | None = None,
) -> ElasticMechanism:
    """Return the mechanism with the joint springs of a bundled set, or of a table (.csv).

    A table's path is relative to `folder`; `where` is the place of the name, for
    messages. Joints without a value in it keep their springs, and a note names them.
    Values of joints beyond the frame are left out, and the note names these joints as
    well.

    Raises
    ------
    InputError
        For a set that must not be used, or of an arm with other joints; UnknownNameError.
    """
    if elastic.spring_names != elastic.names:
        raise InputError(
            "is for mechanisms with joints", where=where, expected="--stiffness"
        )
    known, beyond = elastic.mechanism.joint_names, elastic.beyond
    joints = [c for c in elastic.mechanism.coordinates if c.name in known]
    # Joints may be named by their numbers, also those beyond the frame.
    names = {str(i): c.name for i, c in enumerate(joints, start=1)}
    last = len(names) + len(beyond)
    outside = {*beyond, *map(str, range(len(names) + 1, last + 1))}
    if Path(name).suffix.lower() == ".csv":
        about: dict[str, Any] = {
            "robot": elastic.name,
            "method": "a table",
            "source": name,
        }
        stiffness, grade = _table((folder or Path()) / Path(name).expanduser(), names), ""
    else:
        about = _published(name, where)
        fits = len(names) <= about["joints"] <= last
        if not fits or any(c.is_length for c in joints):
            raise InputError(
                f"{name!r} is of an arm with {about['joints']} turning joints",
                where=where,
                got=", ".join(names.values()),
            )
        stiffness = {
            names.get(joint, joint): GivenStiffness.read(f"{k} N m/rad")
            for joint, k in about["stiffness"].items()
        }
        grade = f"grade {about['grade']} ({GRADES[about['grade']]}), "
    # What cannot act is left out; a note says so, and what has no value.
    left_out = [joint for joint in stiffness if joint in outside]
    stiffness = {joint: k for joint, k in stiffness.items() if joint not in outside}
    try:
        elastic = elastic.with_springs(stiffness)
    except InputError as error:
        place = where if where.startswith("key") else f"{where} {name}"
        raise error.moved_to(place) from None
    missing = [c for c in names.values() if c not in stiffness]
    words = f"springs {name} ({about['robot']}): {grade}method: {about['method']}; "
    words += "; ".join(about[key] for key in ("source", "warning") if key in about)
    if missing:
        words += f". It has no value for {', '.join(missing)}: what was there is kept"
    if left_out:
        words += f". Joints beyond frame {elastic.mechanism.frame!r} need none: "
        words += ", ".join(left_out)
    values = {"name": name, **about, "stiffness": stiffness, "without_value": missing}
    return elastic.with_notes(Note("published-springs", words, values))


def _published(name: str, where: str) -> dict[str, Any]:
    """Return a bundled set that may be used."""
    every = published_springs()
    check_name("springs", name, every, where)
    if "refused" in every[name]:
        raise InputError(
            f"{name!r} is not to be used: {every[name]['refused']}", where=where
        )
    return dict(every[name])


def _table(path: Path, numbered: Mapping[str, str]) -> dict[str, float]:
    """Read stiffnesses by joint from columns `joint` and `stiffness [unit]`.

    Without a unit in the head, a cell has its own, or N m/rad. A joint may be given by
    its number instead of its name.
    """
    cells = read_cells(path, "springs")
    heads = [head_of(head, cells.place)[0] for head in cells.names]
    if sorted(heads) != ["joint", "stiffness"]:
        expected = "joint, stiffness [N m/arcmin]"
        raise InputError(
            "columns do not fit",
            where=cells.place,
            expected=expected,
            got=", ".join(heads),
        )
    at = heads.index("stiffness")
    unit = in_brackets(cells.names[at]).partition("[")[2].rstrip("] ")
    given: dict[str, float] = {}
    for row, place in zip(cells.rows, cells.places, strict=True):
        joint, text = numbered.get(row[1 - at], row[1 - at]), row[at]
        if joint in given:
            raise InputError("joint named twice", where=place, got=repr(joint))
        if not unit and text[-1:] in "0123456789.":
            text += " N m/rad"
        is_rigid = text == "rigid"
        given[joint] = (
            math.inf if is_rigid else GivenStiffness.read(f"{text} {unit}", place)
        )
    return given
