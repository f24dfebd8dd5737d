"""What a mechanism file says about where its stiffnesses come from."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cartstiff.errors import InputError
from cartstiff.loading.keys.identified import IdentifiedModel
from cartstiff.mechanisms.elastic import ElasticMechanism, Note
from cartstiff.mechanisms.elements import CompliancePattern, Elements
from cartstiff.mechanisms.identified import Identified

__all__ = ["with_findings"]

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
        pairs = entry.elements or [(entry.name, entry.name, 1.0)]
        pattern = CompliancePattern(entry.name, tuple(pairs))
        for a, b, weight in pairs:
            i, j = elements.index(a, "identified"), elements.index(b, "identified")
            own, size = entry.value * weight, np.sqrt(
                elements.compliance[i, i] * elements.compliance[j, j]
            )  # fmt: skip
            if not pattern.is_share and abs(elements.compliance[i, j] - own) > _AGREE * size:
                raise InputError(
                    f"compliance of {entry.name!r} is not that of the file's spring",
                    where="identified", expected=f"{elements.compliance[i, j]:.6g}, or no key "
                    "'identified' with springs that were changed", got=f"{own:.6g}",
                )  # fmt: skip
        patterns.append(pattern)
        values.append(entry.value)
    P = len(patterns)
    if [len(row) for row in model.covariance] != [P] * P:
        raise InputError("covariance has the wrong shape", where="identified",
                         expected=f"{P} rows of {P} numbers")  # fmt: skip
    identified = Identified(
        tuple(patterns), np.array(values), np.array(model.covariance).reshape(P, P), model.degrees,
        model.level, model.rows, model.date or "", model.source or "", tuple(model.undetermined),
        dict(model.at_least),
    )  # fmt: skip
    notes = list(elastic.notes)
    if model.undetermined:
        words = (
            "the measurements say nothing about these springs, whose stiffness in the file is an "
            f"assumption: {', '.join(model.undetermined)}"
        )
        notes.append(Note("stiffness-not-identified", words, {"joints": model.undetermined}))
    return replace(elastic, notes=tuple(notes), identified=identified)
