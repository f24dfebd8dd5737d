"""One posture after the other by the engine: for every mechanism, and for doubtful postures."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Literal

import numpy as np

from cartstiff import numerics
from cartstiff.errors import ConvergenceError, InputError, UndefinedError
from cartstiff.geometry.se3 import Array
from cartstiff.mechanisms.elastic import ElasticMechanism
from cartstiff.stiffness.applied_load import LoadKind
from cartstiff.stiffness.compute import PostureStiffness, analyse

REGULAR, NOT_ASSEMBLED = "regular", "not-assembled"


def state_of(result: PostureStiffness, outputs: Collection[str] = ()) -> str:
    """The code that stands for a posture's state.

    The last state of the reduction, as in `analyse` with ``strict``; else a type-2 singularity;
    else, if matrices are among the outputs, a stiffness matrix (the tangent under the load, where
    its inverse is asked for) that has no inverse, or what a note of `analyse` says of lost digits:
    of the compliance, or, where none is asked for, of the stiffness, too.
    """
    if result.reduction.states:
        return result.reduction.states[-1].code
    kinds = {name.partition("_")[0] for name in outputs}
    notes = result.notes_on_posture
    if "compliance" in kinds:
        notes = result.notes
    elif "stiffness" in kinds:  # other inverses need not be found
        notes = *notes, *result.notes_on_digits
    codes = {note.code for note in notes}
    for code in ("type-2-singularity", "singular-stiffness"):
        if code in codes:
            return code
    if "compliance_load" in outputs and result.tangent_compliance is None:
        return "singular-stiffness"
    for note in notes:
        if (
            note.code == "ill-conditioned"
            and np.asarray(note.values["relative_error"]) > numerics.LOST_ERROR
            # Beside a compliance a stiffness need not hold its softer directions.
            and (note.values["matrix"] == "compliance" or "compliance" not in kinds)
        ):
            return note.code
    return REGULAR


def fill(
    elastic: ElasticMechanism,
    q: Array,
    wrench: Array | None,
    rows: Mapping[str, Array],
    load: LoadKind,
    axes: Literal["body", "world"],
) -> tuple[str, Array]:
    """Write one posture's arrays into `rows`; its state, and its coordinates.

    Those of a chain that can be closed are the closed ones, whatever its state.
    """
    for row in rows.values():
        row[...] = np.nan
    try:
        result = analyse(
            elastic, q, wrench=wrench, load_kind=load.kind, load_at=load.at, load_axes=axes
        )
    except ConvergenceError:
        return NOT_ASSEMBLED, q
    except UndefinedError as error:
        return error.code, _closed(elastic, q)
    except InputError:
        # Everything given has been checked: the springs cannot carry this load here.
        at = elastic.mechanism.closed(elastic.mechanism.checked(q))
        if "pose" in rows:
            rows["pose"][...] = at.pose
        return "unbalanced", np.asarray(at.q)
    for name, row in rows.items():
        value = _output(result, name)
        if value is not None:
            row[...] = value
    return state_of(result, rows), result.q


def _closed(elastic: ElasticMechanism, q: Array) -> Array:
    return np.asarray(elastic.mechanism.closed(elastic.mechanism.checked(q)).q)


def _output(result: PostureStiffness, name: str) -> Array | float | None:
    kind, _, connection = name.partition("_")
    if connection == "load":
        return result.tangent if kind == "stiffness" else result.tangent_compliance
    if kind == "stiffness":
        return result.matrices[connection]
    if kind == "compliance":
        return result.compliances[connection]
    value: Array | float | None = getattr(result, name)
    return value
