"""Measured compliances of a mechanism file, compared with its springs."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from cartstiff.core.errors import InputError, check_name
from cartstiff.core.mechanisms.elements import Elements, coefficient, law_of
from cartstiff.core.mechanisms.identified import CompliancePattern, Identified
from cartstiff.core.notes import Note

if TYPE_CHECKING:
    from cartstiff.core.mechanisms.elastic import ElasticMechanism
    from cartstiff.files.schema import FoundModel, IdentifiedModel

# Largest relative difference between a measured compliance and that of the file's spring:
# people round numbers.
_COMPLIANCE_TOLERANCE = 1e-3


def with_findings(elastic: ElasticMechanism, model: IdentifiedModel) -> ElasticMechanism:
    """Add the covariance of measured compliances to a mechanism.

    Springs of joints beyond the frame are left out.

    Raises
    ------
    InputError
        If they do not fit each other, or the springs of the file.
    """
    elements, beyond, where = Elements(elastic), {*elastic.beyond}, "key identified"
    # Compliances of springs that act, each compared with the file's own.
    P, kept = len(model.compliances), dict[int, CompliancePattern]()
    for i, entry in enumerate(model.compliances):
        pattern = _pattern(entry, beyond)
        if pattern is not None:
            kept[i] = pattern
            _check_found(elastic, elements, pattern, entry)
    names = {*elements.names, *(entry.name for entry in model.compliances)}
    at_least = {name: k for name, k in model.at_least.items() if name not in beyond}
    for name in at_least:
        check_name("spring", name, names, f"{where}.at_least")
    if [len(row) for row in model.covariance] != [P] * P:
        raise InputError(
            "covariance has the wrong shape",
            where=where,
            expected=f"{P} rows of {P} numbers",
        )
    # The covariance is that of the compliances that are kept.
    undetermined = [name for name in model.undetermined if name not in beyond]
    identified = Identified(
        tuple(kept.values()),
        np.array([model.compliances[i].value for i in kept]),
        np.array(model.covariance).reshape(P, P)[np.ix_([*kept], [*kept])],
        model.degrees,
        model.level,
        model.rows,
        model.date or "",
        model.source or "",
        tuple(undetermined),
        at_least,
    )
    elastic = replace(elastic, identified=identified)
    if not undetermined:
        return elastic
    words = (
        "the measurements say nothing about these springs, whose stiffness in the file "
        f"is an assumption: {', '.join(undetermined)}"
    )
    note = Note("stiffness-not-identified", words, {"joints": undetermined})
    return elastic.with_notes(note)


def _pattern(entry: FoundModel, beyond: set[str]) -> CompliancePattern | None:
    """Springs of a compliance, but those beyond the frame; None without any."""
    law = entry.polynomial
    own = [] if law else [(entry.name, entry.name, 1.0)]
    pairs = [pair for pair in entry.elements or own if beyond.isdisjoint(pair[:2])]
    if not pairs and (law is None or law[0] in beyond):
        return None
    return CompliancePattern(entry.name, tuple(pairs), law)


def _check_found(
    elastic: ElasticMechanism,
    elements: Elements,
    pattern: CompliancePattern,
    entry: FoundModel,
) -> None:
    """Refuse a measured compliance, or coefficient, that is not that of the
    file's springs.
    """

    def check(what: str, own: float, value: float, size: float) -> None:
        if abs(own - value) > _COMPLIANCE_TOLERANCE * size:
            raise InputError(
                f"{what} of {entry.name!r} is not that of the file's spring",
                where=where,
                expected=f"{own:.6g}, or no key 'identified' with springs that were "
                "changed",
                got=f"{value:.6g}",
            )

    where, law = "key identified", entry.polynomial
    if law is not None and entry.elements is not None:
        raise InputError(
            f"{entry.name!r} has elements and a polynomial",
            where=where,
            expected="one of both",
        )
    for a, b, weight in pattern.entries:
        row, column = (elements.index(name, where) for name in (a, b))
        C = elements.compliance
        if not pattern.is_share:
            size = float(np.sqrt(C[row, row] * C[column, column]))
            check("compliance", C[row, column], entry.value * weight, size)
    if law is None:
        return
    power, c = law[1], law_of(elastic, law[0], where).powers
    if power > len(c) or (power == 1 and not c[0] > 0.0):
        raise InputError(
            f"{entry.name!r} is no coefficient of the spring",
            where=where,
            expected=f"powers 1 to {len(c)}",
            got=power,
        )
    own = coefficient(elastic, law)
    check("value", own, entry.value, abs(own))
