"""The mechanism of a checked file, with what the file says of where its stiffnesses come from."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from cartstiff.errors import InputError, UnknownNameError, one_line
from cartstiff.mechanisms.elastic import ElasticMechanism
from cartstiff.mechanisms.elements import CompliancePattern, Elements, coefficient, law_of
from cartstiff.mechanisms.identified import Identified
from cartstiff.notes import Note

if TYPE_CHECKING:
    from cartstiff.loading.keys.identified import FoundModel, IdentifiedModel
    from cartstiff.loading.shorthand.parameters import Parameters

# Values of the file and its springs agree to this share; a person may round them.
_AGREE = 1e-3


def with_findings(elastic: ElasticMechanism, model: IdentifiedModel) -> ElasticMechanism:
    """The mechanism with the covariance of its measured compliances.

    Raises
    ------
    InputError
        If they do not fit each other, or the springs of the file.
    """
    elements = Elements(elastic)
    patterns, values = [], []
    for entry in model.compliances:
        law = entry.polynomial
        pairs = entry.elements or ([] if law else [(entry.name, entry.name, 1.0)])
        pattern = CompliancePattern(entry.name, tuple(pairs), law)
        if law is not None:
            _check_coefficient(elastic, law, entry)
        for a, b, weight in pairs:
            i, j = elements.index(a, "identified"), elements.index(b, "identified")
            own, size = (
                entry.value * weight,
                np.sqrt(elements.compliance[i, i] * elements.compliance[j, j]),
            )
            if not pattern.is_share and abs(elements.compliance[i, j] - own) > _AGREE * size:
                raise InputError(
                    f"compliance of {entry.name!r} is not that of the file's spring",
                    where="identified",
                    expected=f"{elements.compliance[i, j]:.6g}, or no key "
                    "'identified' with springs that were changed",
                    got=f"{own:.6g}",
                )
        patterns.append(pattern)
        values.append(entry.value)
    names = {*elements.names, *(pattern.name for pattern in patterns)}
    for name in model.at_least:
        if name not in names:
            raise UnknownNameError("spring", name, names, where="identified.at_least")
    P = len(patterns)
    if [len(row) for row in model.covariance] != [P] * P:
        raise InputError(
            "covariance has the wrong shape",
            where="identified",
            expected=f"{P} rows of {P} numbers",
        )
    identified = Identified(
        tuple(patterns),
        np.array(values),
        np.array(model.covariance).reshape(P, P),
        model.degrees,
        model.level,
        model.rows,
        model.date or "",
        model.source or "",
        tuple(model.undetermined),
        dict(model.at_least),
    )
    notes = list(elastic.notes)
    if model.undetermined:
        words = (
            "the measurements say nothing about these springs, whose stiffness in the file is an "
            f"assumption: {', '.join(model.undetermined)}"
        )
        notes.append(Note("stiffness-not-identified", words, {"joints": model.undetermined}))
    return replace(elastic, notes=tuple(notes), identified=identified)


def _check_coefficient(elastic: ElasticMechanism, law: tuple[str, int], entry: FoundModel) -> None:
    """Refuse a polynomial's coefficient that is not that of the file."""
    (name, power), where = law, "identified"
    if entry.elements is not None:
        raise InputError(
            f"{entry.name!r} has elements and a polynomial", where=where, expected="one of both"
        )
    c = law_of(elastic, name, where).coefficients
    if power > len(c) or (power == 1 and not c[0] > 0.0):
        raise InputError(
            f"{entry.name!r} is no coefficient of the spring",
            where=where,
            expected=f"powers 1 to {len(c)}",
            got=power,
        )
    own = coefficient(elastic, law)
    if abs(own - entry.value) > _AGREE * abs(own):
        raise InputError(
            f"value of {entry.name!r} is not that of the file's spring",
            where=where,
            expected=f"{own:.6g}, or no key 'identified' with springs that were changed",
            got=f"{entry.value:.6g}",
        )


def mechanism_of(
    file: Any, parameters: Parameters, path: Path, overrides: dict[str, Any]
) -> ElasticMechanism:
    """The mechanism of a file that has been checked."""
    from cartstiff.loading import build
    from cartstiff.loading.plausible import file_notes

    where, name = one_line(str(path)), file.name or path.stem
    if file.kind == "parallel":
        from cartstiff.loading.legs.tree import with_drawn_legs

        file = with_drawn_legs(file, where)
    file = build.with_overrides(file, overrides, where)
    if file.kind == "serial":
        elastic = build.build_serial(file, path.parent, where, name)
    elif file.kind in ("stewart-gough", "springs"):
        elastic = build.build_platform(file, where, name)
    else:
        from cartstiff.loading import build_closed

        parallel = file.kind == "parallel"
        make = build_closed.build_parallel if parallel else build_closed.build_closed_chain
        elastic = make(file, path.parent, where, name)
    notes = (*elastic.notes, *file_notes(file), *parameters.notes())
    source = " ".join((file.source or "").split())
    elastic = replace(elastic, notes=notes, source=source, parameters=parameters.values)
    if file.identified is None:
        return elastic
    return with_findings(elastic, file.identified)
