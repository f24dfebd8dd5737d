"""How well stiffnesses are known, in a mechanism file and in the mechanism."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated

import numpy as np
from pydantic import Field

from cartstiff.errors import InputError, UnknownNameError
from cartstiff.loading.key_types import FileModel, Number, Positive, Text
from cartstiff.mechanisms.elastic import ElasticMechanism
from cartstiff.mechanisms.elements import CompliancePattern, Elements, coefficient, law_of
from cartstiff.mechanisms.identified import Identified
from cartstiff.notes import Note

# Values of the file and its springs agree to this share; a person may round them.
_AGREE = 1e-3


class FoundModel(FileModel):
    """A compliance that was measured: of one spring, of springs that are equal, or of a link."""

    name: Text
    value: Number = Field(description="compliance; of a beam a share of the file's own")
    elements: list[tuple[Text, Text, Number]] | None = Field(
        default=None, description="pairs of springs and factors, where it is not one spring's own"
    )
    polynomial: tuple[Text, Annotated[int, Field(strict=True, ge=1, le=100)]] | None = Field(
        default=None,
        description="joint and power of a polynomial spring: of the first power the "
        "value is a compliance, of others the coefficient",
    )


class IdentifiedModel(FileModel):
    """How well the stiffnesses are known; written by `cartstiff identify -o`."""

    compliances: list[FoundModel] = Field(max_length=1000)
    covariance: list[list[Number]] = Field(description="of the compliances, in the file's units")
    degrees: Positive | None = Field(
        default=None, description="of freedom of Student's t; normal if absent"
    )
    level: float = Field(default=0.95, gt=0.0, lt=1.0, description="of the intervals")
    rows: int = Field(default=0, strict=True, ge=0, description="measurements, for readers")
    date: Text | None = Field(default=None, description="of the measurement, for readers")
    source: Text | None = Field(default=None, description="what was measured, for readers")
    undetermined: list[Text] = Field(
        default=[], description="springs of which the measurements say nothing"
    )
    at_least: dict[str, Positive] = Field(
        default={}, description="springs without an upper end, and the lower one"
    )


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
