r"""From an elastic mechanism at a posture to the stiffness matrices under
every connection.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from cartstiff.core.arrays import Array, checked_flag, checked_input
from cartstiff.core.checked_call import checked
from cartstiff.core.errors import InputError, NoEnergyError
from cartstiff.core.mechanisms.contract import MechanismPosture
from cartstiff.core.mechanisms.elastic import ElasticMechanism, checked_elastic
from cartstiff.core.notes import Note
from cartstiff.core.potentials.contract import Evaluation
from cartstiff.core.stiffness.applied_load import (
    DEAD_AT_ORIGIN,
    Axes,
    Behaviour,
    LoadKind,
    checked_load,
    wrench_in_body,
)
from cartstiff.core.stiffness.balance import balanced
from cartstiff.core.stiffness.motions import scaled_values
from cartstiff.core.stiffness.posture import SCHEMA as SCHEMA
from cartstiff.core.stiffness.posture import PostureStiffness as PostureStiffness
from cartstiff.core.stiffness.reduction import Reduction, reduced_at
from cartstiff.core.stiffness.settled_links import settled


@checked
def analyse(
    elastic: ElasticMechanism,
    q: ArrayLike | Mapping[str, float] | None = None,
    *,
    wrench: ArrayLike | None = None,
    load_kind: Behaviour = "dead",
    load_at: ArrayLike = DEAD_AT_ORIGIN.at,
    load_axes: Axes = "body",
    strict: bool = False,
) -> PostureStiffness:
    r"""Stiffness of a mechanism at a posture, under every connection.

    Parameters
    ----------
    elastic : ElasticMechanism
        Mechanism and potentials, from `cartstiff.load`.
    q : array_like (n,) or mapping, optional
        Coordinates in rad and length units, in joint order or by name; default the file's
        posture. For a platform: x, y, z, roll, pitch, yaw. A closed chain is assembled
        from there.
    wrench : array_like (6,), optional
        Wrench on the body. Moment about and force at the point `load_at`; all rest
        positions are then chosen so that the springs balance it at the posture, and it
        deflects compliant links, whose virtual joints start there. Without it, springs
        with a rest position keep that, and those without carry gravity.
    load_kind : {"dead", "follower", "conservative"}
        How the load acts while the body moves. dead: moment and force keep their
        direction in the room; follower: they turn with the body; conservative: the force
        keeps its direction, and the moment turns by half of the body's rotation. The
        tangent stiffness depends on it.
    load_at : array_like (3,)
        Point of the body, in its frame M, at which the load acts; default its origin.
    load_axes : {"body", "world"}
        Axes of the wrench's components: those of M or of F.
    strict : bool
        Raise where a stiffness matrix does not exist, instead of returning None with a
        note.

    Returns
    -------
    PostureStiffness
        Pose, Jacobian, wrench, energy, K^A, K^B, K^K, K^F, the tangent under the load,
        compliances, notes.

    Raises
    ------
    InputError
        For a wrong count, an unknown name, or numbers that are not finite; for
        `load_kind`, `load_at` or `load_axes` without a load.
    UnknownNameError
        For an unknown kind or axes of the load.
    ConvergenceError
        If a closed chain cannot be assembled near q.
    UndefinedError
        With `strict`, for a singular, unbalanced or buckled state.
    """
    checked_elastic(elastic)
    kind = checked_load(
        load_kind, load_at, load_axes, wrench is not None, elastic.may_be_loaded
    )
    strict = checked_flag(strict, "strict")
    force = None
    if wrench is not None:
        force = checked_input(wrench, (6,), "wrench")
        if elastic.springs is None:
            raise InputError(
                "the load of this mechanism follows from its potentials and cannot be "
                "given",
                expected="no wrench here",
            )
    elastic, posture = elastic.placed(q)
    if force is not None:
        if elastic.mechanism.virtual:
            # Components refer to the deflected posture, so that they are constant in
            # their axes.
            carried = LoadKind("dead" if load_axes == "world" else "follower", kind.at)
            posture = settled(
                elastic, posture, (carried.acting(force, posture.pose, load_axes),)
            )
        force = wrench_in_body(force, posture.pose, kind.at, load_axes)
    try:
        result = analyse_at(elastic, posture, force, kind)
    except NoEnergyError as error:
        if strict:
            raise
        values, n = scaled_values(posture), posture.motion.jacobian.shape[1]
        nothing = Evaluation(np.nan, np.full(n, np.nan), np.full((n, n), np.nan))
        reduction = Reduction.of_state(Note.of(error), values, n, rank=len(values))
        return PostureStiffness(
            elastic, posture.q, posture, nothing, reduction, load=kind
        )
    if strict and result.reduction.stiffness is None:
        raise result.reduction.undefined()
    return result


def analyse_at(
    elastic: ElasticMechanism,
    posture: MechanismPosture,
    force: Array | None = None,
    kind: LoadKind = DEAD_AT_ORIGIN,
) -> PostureStiffness:
    """`analyse` at a closed posture; `force` (6,) is the wrench in M, if any."""
    asked = elastic
    elastic, energy = balanced(asked, posture, force)
    reduction = reduced_at(elastic, posture, energy, posture.closure, force)
    return PostureStiffness(
        elastic,
        posture.q,
        posture,
        energy,
        reduction,
        load=kind,
        _load_is_given=force is not None and any(force.tolist()),
        _asked=asked,
        _rest_is_chosen=force is not None,
    )
