"""Measured compliances of a mechanism file, compared with its springs."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from cartstiff.errors import InputError, check_name
from cartstiff.mechanisms.elements import Elements, coefficient, law_of
from cartstiff.mechanisms.identified import CompliancePattern, Identified
from cartstiff.notes import Note

if TYPE_CHECKING:
    from cartstiff.loading.schema import FoundModel, IdentifiedModel
    from cartstiff.mechanisms.elastic import ElasticMechanism

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
    P, kept = len(model.compliances), dict[int, CompliancePattern]()
    for i, entry in enumerate(model.compliances):
        law = entry.polynomial
        pairs = entry.elements or ([] if law else [(entry.name, entry.name, 1.0)])
        pairs = [pair for pair in pairs if beyond.isdisjoint(pair[:2])]
        if pairs or (law is not None and law[0] not in beyond):
            kept[i] = pattern = CompliancePattern(entry.name, tuple(pairs), law)
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
        "is an "
        f"assumption: {', '.join(undetermined)}"
    )
    note = Note("stiffness-not-identified", words, {"joints": undetermined})
    return elastic.with_notes(note)


def _check_found(
    elastic: ElasticMechanism,
    elements: Elements,
    pattern: CompliancePattern,
    entry: FoundModel,
) -> None:
    """Refuse a measured compliance, or coefficient, that is not that of the
    file's springs.
    """
    where, changed = (
        "key identified",
        "or no key 'identified' with springs that were changed",
    )
    law = entry.polynomial
    if law is not None and entry.elements is not None:
        what = f"{entry.name!r} has elements and a polynomial"
        raise InputError(what, where=where, expected="one of both")
    for a, b, weight in pattern.entries:
        row, column = (elements.index(name, where) for name in (a, b))
        C, own = elements.compliance, entry.value * weight
        tolerance = _COMPLIANCE_TOLERANCE * np.sqrt(C[row, row] * C[column, column])
        if not pattern.is_share and abs(C[row, column] - own) > tolerance:
            raise InputError(
                f"compliance of {entry.name!r} is not that of the file's spring",
                where=where,
                expected=f"{C[row, column]:.6g}, {changed}",
                got=f"{own:.6g}",
            )
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
    if abs(own - entry.value) > _COMPLIANCE_TOLERANCE * abs(own):
        raise InputError(
            f"value of {entry.name!r} is not that of the file's spring",
            where=where,
            expected=f"{own:.6g}, {changed}",
            got=f"{entry.value:.6g}",
        )
