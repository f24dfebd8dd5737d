"""Measured compliances of a mechanism file, compared with its springs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from cartstiff.core.errors import InputError, check_name
from cartstiff.core.mechanisms.identified import (
    CompliancePattern,
    Identified,
    size_of_compliance,
)
from cartstiff.core.notes import Note
from cartstiff.core.potentials.contract import BEAM, Number, key_of_law, key_of_pair

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
    own, beyond, where = elastic.compliances, {*elastic.beyond}, "key identified"
    # Compliances of springs that act, each compared with the file's own.
    P, kept = len(model.compliances), dict[int, CompliancePattern]()
    for i, entry in enumerate(model.compliances):
        pattern = _pattern(entry, beyond)
        if pattern is not None:
            kept[i] = pattern
            _check_found(own, pattern, entry)
    names = {*own, *(entry.name for entry in model.compliances)}
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
    if entry.polynomial is not None and entry.elements is not None:
        raise InputError(
            f"{entry.name!r} has elements and a polynomial",
            where="key identified",
            expected="one of both",
        )
    if entry.polynomial is not None:
        joint, power = entry.polynomial
        pairs = [(joint, key_of_law(joint, power), 1.0)]
    elif entry.name.endswith(BEAM):
        members = [a for a, _, _ in entry.elements or ()]
        pairs = [(min(members, default=entry.name), entry.name, 1.0)]
    else:
        each = entry.elements or [(entry.name, entry.name, 1.0)]
        pairs = [(a, key_of_pair(a, b), w) for a, b, w in each if b not in beyond]
    keys = tuple((key, weight) for a, key, weight in pairs if a not in beyond)
    return CompliancePattern(entry.name, keys) if keys else None


def _check_found(
    own: Mapping[str, Number], pattern: CompliancePattern, entry: FoundModel
) -> None:
    """Refuse a measured compliance, or coefficient, that is not that of the
    file's springs.
    """
    where, what = "key identified", "value" if entry.polynomial else "compliance"
    for key, weight in pattern.keys:
        check_name("spring", key, own, where)
        value = entry.value * weight
        error = abs(own[key].value - value)
        if not pattern.is_share and error > _COMPLIANCE_TOLERANCE * size_of_compliance(
            key, own
        ):
            raise InputError(
                f"{what} of {entry.name!r} is not that of the file's spring",
                where=where,
                expected=f"{own[key].value:.6g}, or no key 'identified' with springs "
                "that were changed",
                got=f"{value:.6g}",
            )
