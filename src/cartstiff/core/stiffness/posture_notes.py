r"""Notes on one posture: assumptions, near singularities, lost digits."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from cartstiff.core import numerics
from cartstiff.core.arrays import Array
from cartstiff.core.mechanisms.contract import MechanismPosture
from cartstiff.core.mechanisms.elastic import ElasticMechanism
from cartstiff.core.mechanisms.gravity_loads import gravity_loads
from cartstiff.core.mechanisms.limits import deflection_notes, limit_notes
from cartstiff.core.notes import Note
from cartstiff.core.potentials.contract import Evaluation
from cartstiff.core.stiffness.forces import (
    DriveForce,
    force_notes,
    forces_of,
    may_be_beyond,
    rigid_torques,
)
from cartstiff.core.stiffness.leg_length_basis import line_springs_and_rest
from cartstiff.core.stiffness.reduction import Reduction
from cartstiff.core.stiffness.rounding import norm, without_cancelled


def notes_on_posture(
    elastic: ElasticMechanism,
    posture: MechanismPosture,
    reduction: Reduction,
    on_rest: Iterable[Note] = (),
) -> tuple[Note, ...]:
    """Notes of loading, states of the reduction, near singularities and limits
    at a posture.

    `on_rest` are those on preload and rest positions.
    """
    rank, full = reduction.rank, reduction.usual_rank
    forces: tuple[DriveForce, ...] = ()
    if may_be_beyond(elastic, posture):
        torques = rigid_torques(elastic, posture, reduction.multipliers)
        forces = forces_of(elastic, posture, torques)
    return (
        *elastic.notes,
        *reduction.states,
        *(near_serial(posture, reduction.singular_values, rank) if rank == full else ()),
        *near_type_2(posture, reduction.motions),
        *near_constraint(reduction),
        *nearly_still(posture, reduction),
        *elastic.diagnostics(posture),
        *limit_notes(elastic.mechanism, posture),
        *force_notes(forces, elastic),
        *deflection_notes(elastic, posture.q),
        *on_rest,
        *(() if elastic.gravity is None else gravity_loads(elastic).notes),
    )


def notes_on_digits(
    reduction: Reduction,
    compliance: numerics.Inverse | None,
    natural: Array,
    change: Array | None = None,
    loaded: numerics.Inverse | None = None,
    error_of_forces: float = 0.0,
) -> list[Note]:
    """Notes on lost digits of stiffness and compliance, and on a singular stiffness.

    Parameters
    ----------
    reduction : Reduction
        To the end-effector.
    compliance : Inverse or None
        C^B with its error.
    natural : ndarray, shape (6,)
        Natural sizes of the twist's components.
    change : ndarray, shape (6, 6), optional
        K^load - K^B of a given load, whose compliance is judged, too.
    loaded : Inverse, optional
        That compliance, C^load, with its error.
    error_of_forces : float
        See `error_of_chosen_forces`.
    """
    notes = []
    K, is_loaded = reduction.stiffness, change is not None
    known = (compliance, loaded if is_loaded else None)
    errors = [inverse.error for inverse in known if inverse is not None]
    # Digits of the compliance, then those of the soft directions in K.
    if errors:
        words = (
            "springs and load nearly cancel along a motion, legs are nearly dependent, "
            "or springs hardly move along it: the compliance is known {}"
        )
        notes += _lost("compliance", max(*errors, error_of_forces), words)
    if K is None:
        return notes
    if compliance is None:
        return [*notes, *_singular(K, None, natural)]
    is_near = numerics.ratio(reduction.singular_values) < numerics.NEAR_SINGULARITY
    words = "so near to a singularity" if is_near else "with springs so far apart"
    words += (
        " the stiffness matrix holds the softer directions {}; the compliance, and "
        "what is free, hold them"
    )
    notes += _lost("stiffness", error_of_soft_directions(K, compliance.matrix), words)
    if is_loaded and loaded is None:
        notes += _singular(K, change, natural)
    return notes


def _singular(K: Array, change: Array | None, natural: Array) -> list[Note]:
    """Note on a stiffness, changed by a load if any, that exists and has no inverse."""
    under_load = change is not None
    if change is not None:
        K = without_cancelled((K + change)[None], K, change[None], 1 / natural)[0]
    values = numerics.eigenvalues(K * natural * natural[:, None])
    return [
        Note(
            "singular-stiffness",
            f"the stiffness matrix {'under the load ' * under_load}is singular: a "
            "motion costs nothing, or nothing that can be told from the rounding of the "
            "stiffest springs, and there is no compliance matrix",
            {
                "eigenvalues": values.tolist(),
                "characteristic_length": float(natural[-1]),
            },
        )
    ]


def indefinite(
    reduction: Reduction, tangent: Array | None, compliance: Array | None, natural: Array
) -> list[Note]:
    """Note on a posture that its springs and load do not keep:
    a motion lowers the energy.

    Parameters
    ----------
    reduction : Reduction
        To the end-effector.
    tangent, compliance : ndarray (6, 6) or None
        K^load and C^load. Under loads without a potential they are asymmetric, and their
        signs decide nothing.
    natural : ndarray, shape (6,)
        Natural sizes of the twist's components.
    """
    sizes = natural[:, None] * natural
    K = reduction.reachable_stiffness if tangent is None else tangent * sizes
    C = None if compliance is None else compliance / sizes
    pair = [M for M in (K, C) if M is not None]
    if any(numerics.asymmetry(M) for M in pair) or all(map(numerics.is_positive, pair)):
        return []
    spectra = [numerics.eigenvalues(M) for M in pair]
    negative = max(
        (int((x < -numerics.ZERO_SHARE * numerics.largest(x)).sum()) for x in spectra),
        default=0,
    )
    if not negative:
        return []
    return [
        Note(
            "indefinite",
            f"the stiffness is negative along {negative} motion(s) of the body, under "
            "the load and the tensions here: the posture is not stable, and without "
            "something else that holds it the mechanism moves away",
            {
                "eigenvalues": spectra[0].tolist(),
                "characteristic_length": float(natural[-1]),
            },
        )
    ]


def _lost(matrix: str, error: float, words: str) -> list[Note]:
    """Note on a matrix with lost digits; `words` have a place for how many are left."""
    if not error > numerics.REPORTED_ERROR:
        return []
    known = "not at all"
    if error < 1.0:
        known = f"to a relative error of about {error:.1g} only"
    numbers = {"matrix": matrix, "relative_error": error}
    return [Note("ill-conditioned", words.format(known), numbers)]


def error_of_soft_directions(K: Array, C: Array) -> float:
    """Relative error of the softest direction of K, from the digits of K."""
    # With the known inverse C: the inverse of the rounded K may be too small.
    s = numerics.equilibration(K)
    sizes = s[:, None] * s
    return numerics.EPSILON * float(np.linalg.norm(K / sizes) * np.linalg.norm(C * sizes))


def error_of_motions(
    posture: MechanismPosture, energy: Evaluation, reduction: Reduction
) -> float:
    """Relative error of the compliance due to the round-off of the motions that keep
    the closures.

    Motions have an error of ``EPSILON / c``, where c is the smallest relative singular
    value of the closures. Near a type-2 singularity springs hardly move along a motion,
    or all else moves far beside them, so that a small error of the motion is a large one
    of its stiffness.
    """
    free, values = reduction.free, reduction.closures
    inverse = None if free is None else free.inverse()
    if values is None or not values.size or free is None or inverse is None:
        return 0.0
    sizes = posture.coordinate_lengths
    motions = np.abs(free.basis / sizes[:, None])
    forces = (np.abs(energy.hessian * sizes[:, None] * sizes) @ motions).sum(axis=0)
    shares = motions.max(axis=0, initial=0.0) * (
        1.0 + np.abs(inverse.matrix.diagonal()) * forces
    )
    held = values[values > numerics.RANK * values.max()]
    return numerics.EPSILON * float(shares.max(initial=0.0)) / numerics.ratio(held)


def error_of_chosen_forces(
    elastic: ElasticMechanism,
    posture: MechanismPosture,
    energy: Evaluation,
    reduction: Reduction,
    notes: Iterable[Note],
) -> float:
    """Relative error of the compliance due to internal forces near a type-2 singularity.

    There, forces of actuators under a load grow with the inverse of the least singular
    value, and with them the round-off of their lines and of their part of the stiffness.
    """
    near = [note for note in notes if note.code == "near-type-2-singularity"]
    free = reduction.free
    if not near or free is None:
        return 0.0
    inverse = free.inverse()
    ratio = numerics.ratio(np.asarray(near[0].values["singular_values"]))
    if inverse is None or not ratio > 0.0:
        return 0.0
    parts = line_springs_and_rest(elastic, posture)
    B = free.basis
    added = (
        free.hessian - B.T @ energy.hessian @ B if parts is None else B.T @ parts[2] @ B
    )
    sizes = np.sqrt(np.abs(free.hessian.diagonal()))
    sizes[sizes == 0.0] = 1.0
    share = inverse.matrix.dot(added) * sizes[:, None] / sizes
    error = numerics.EPSILON / ratio * norm(share)
    if error > numerics.REPORTED_ERROR:  # this bound is fast; compute the error itself
        error = numerics.EPSILON / ratio * float(np.linalg.norm(share, 2))
    return error


def near_serial(posture: MechanismPosture, values: Array, rank: int = 6) -> list[Note]:
    """Note on a near serial singularity, from singular values of the scaled
    Jacobian of a rank.
    """
    if rank == 0 or not values[rank - 1] < numerics.NEAR_SINGULARITY * values[0]:
        return []
    return [
        Note(
            "near-serial-singularity",
            "the end-effector hardly moves in one direction: smallest over largest "
            f"singular value {values[rank - 1] / values[0]:.2g}",
            {"singular_values": values.tolist(), "characteristic_length": posture.length},
        )
    ]


def near_constraint(reduction: Reduction) -> list[Note]:
    """Note on singular values of closures that are neither zero nor clearly
    different from zero.

    The cause is axes that are not quite parallel, or a near bifurcation. A chain counts
    as closed within `ROUNDOFF`, which leaves motions of that divided by such a value.
    """
    values = np.zeros(0) if reduction.closures is None else reduction.closures
    shares = values / max(float(values.max(initial=0.0)), numerics.TINY)
    doubtful = shares[
        (shares > numerics.ROUNDOFF_OF_SUMS) & (shares < numerics.LOST_ERROR)
    ]
    if not doubtful.size:
        return []
    held, least = int((doubtful > numerics.RANK).sum()), float(doubtful.min())
    return [
        Note(
            "near-constraint-singularity",
            f"the closures nearly repeat each other: {doubtful.size} motion(s) break "
            f"them by shares of {least:.2g} to {doubtful.max():.2g} only, of which "
            f"{held} count(s) as held; axes that should be parallel and are not quite, "
            "or a branching near: what moves, and how stiffly, hangs on these digits of "
            "the geometry",
            {
                "singular_values": values.tolist(),
                "held": held,
                "free": doubtful.size - held,
                "unresolved": numerics.ROUNDOFF / least,
            },
        )
    ]


def nearly_still(posture: MechanismPosture, reduction: Reduction) -> list[Note]:
    """Note on a body with fewer than six freedoms whose rotation, or translation,
    nearly vanishes.

    Both are compared in the characteristic length. Below `RANK` they count as none
    (`cartstiff.core.numerics.still_halves`).
    """
    if not 0 < reduction.rank < 6:
        return []
    sizes = np.repeat([1.0, 1.0 / posture.length], 3)
    J = posture.motion.jacobian * sizes[:, None] * posture.coordinate_lengths
    J = J if reduction.motions is None else J @ reduction.motions
    halves = {
        "rotation": numerics.norm(J[:3]),
        "translation": numerics.norm(J[3:]),
    }
    (half, less), (other, more) = sorted(halves.items(), key=lambda part: part[1])
    share = less / max(more, numerics.TINY)
    if not numerics.RANK < share < numerics.LOST_ERROR:
        return []
    return [
        Note(
            "nearly-still",
            f"the body hardly has a {half}: {share:.2g} of its {other}, in "
            "characteristic lengths; axes that should be parallel, or meet, and do not "
            f"quite in the file's digits? If so, its {half} is none, and compliances of "
            f"{half}, and of {other} with {half} held, say nothing about the machine",
            {"half": half, "share": share, "characteristic_length": posture.length},
        )
    ]


def near_type_2(posture: MechanismPosture, free: Array | None = None) -> list[Note]:
    """Note on a type-2 singularity, or a near one: actuators that do not fix the
    motions (n, f).
    """
    if posture.actuation is None:
        return []
    rates = posture.actuation * posture.coordinate_lengths
    if free is not None:
        rates = rates @ free
    if not rates.size or len(rates) < rates.shape[1]:
        return []
    _, values, motions = np.linalg.svd(rates)
    each, largest = values.tolist(), float(values[0])
    if not each[-1] < numerics.NEAR_SINGULARITY * largest:
        return []
    if free is not None:
        motions = motions @ free.T
    is_lost = each[-1] <= numerics.RANK * largest
    limit = numerics.RANK if is_lost else numerics.NEAR_SINGULARITY
    weak = max(1, int((values <= limit * largest).sum()))
    return [
        Note(
            "type-2-singularity" if is_lost else "near-type-2-singularity",
            f"the actuators {'do not' if is_lost else 'hardly'} hold the mechanism in "
            f"{weak} direction(s): smallest over largest singular value "
            f"{each[-1] / each[0]:.2g}",
            {
                "singular_values": each,
                "characteristic_length": posture.length,
                "directions": (motions[-weak:] * posture.coordinate_lengths).tolist(),
            },
        )
    ]
