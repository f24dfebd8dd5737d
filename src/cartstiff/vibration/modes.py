r"""Natural frequencies and modes of small undamped motions about a rest state, under its load.

On the motions that keep the closures

    K_q phi = omega^2 M phi,    phi^T M phi = 1

K_q is the second derivative of all energies with the load's part, the matrix that decides the
stability of `cartstiff.equilibrium`, and M the masses' matrix. A load moves the frequencies as it
moves the stiffness: modes belong to one load, which every result names.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from cartstiff import numerics
from cartstiff.arrays import checked_input
from cartstiff.errors import InputError, UndefinedError, checked_kind
from cartstiff.geometry.se3 import Array
from cartstiff.mechanisms.chain import Chain
from cartstiff.mechanisms.contract import MechanismPosture, Units
from cartstiff.mechanisms.elastic import ElasticMechanism
from cartstiff.notes import Note
from cartstiff.potentials.contract import Potential
from cartstiff.potentials.springs import JointSprings
from cartstiff.statics.rest import Equilibrium
from cartstiff.statics.small_motions import kinetic_matrix, spectrum_of
from cartstiff.stiffness.applied_load import LoadKind, checked_load, wrench_in_body
from cartstiff.stiffness.compute import PostureStiffness, analyse
from cartstiff.vibration.mode_set import Modes


def modes(
    subject: ElasticMechanism | PostureStiffness | Equilibrium,
    q: ArrayLike | Mapping[str, float] | None = None,
    *,
    wrench: ArrayLike | None = None,
    load_kind: Literal["dead", "follower", "conservative"] = "dead",
    load_at: ArrayLike = (0.0, 0.0, 0.0),
    load_axes: Literal["body", "world"] = "body",
) -> Modes:
    r"""Natural frequencies and modes of small motions about a rest state, under its load.

    ``K_q phi = omega^2 M phi`` on the motions that keep the closures.

    Parameters
    ----------
    subject : ElasticMechanism, PostureStiffness or Equilibrium
        A mechanism from `cartstiff.load`, which is held at q by rest positions as in
        `cartstiff.analyse`; or the result of `analyse`, or of `equilibrium`, where it came to rest.
    q, wrench, load_kind, load_at, load_axes
        As in `cartstiff.analyse`; for a mechanism only.

    Returns
    -------
    Modes
        Frequencies, shapes, twists, effective masses, nodal axes, notes.

    Raises
    ------
    InputError
        For q or a load beside a result, or what `analyse` refuses.
    UndefinedError
        If the posture is no rest state, no mass moves, or a motion without mass and stiffness takes
        part in the forces of others.

    Examples
    --------
    >>> import cartstiff
    >>> modes = cartstiff.modes(cartstiff.load("stewart-simscape"))
    >>> [round(float(f), 1) for f in modes.frequencies]
    [780.6, 780.6, 903.9, 1061.4, 1061.4, 1269.7]
    """
    if isinstance(subject, ElasticMechanism):
        is_loaded = wrench is not None
        own = not is_loaded and subject.may_be_loaded
        kind = checked_load(load_kind, load_at, load_axes, is_loaded, own)
        if wrench is not None or load_kind != "dead" or np.any(load_at) or load_axes != "body":
            load: dict[str, Any] = {
                "wrench": wrench,
                "load_kind": load_kind,
                "load_axes": load_axes,
                "load_at": load_at if np.any(load_at) else (0.0, 0.0, 0.0),
            }
        else:
            load = {}
        if is_plain(subject):
            return _plain(subject, q, load, kind)
        subject = analyse(subject, q, **load)
    else:
        expected = "a mechanism, or what analyse or equilibrium answers"
        checked_kind(subject, (PostureStiffness, Equilibrium), "posture", expected)
        if q is not None or wrench is not None:
            raise InputError(
                "a result has its posture and its load",
                expected="no q and no wrench",
                got="q" if q is not None else "wrench",
            )
        checked_load(load_kind, load_at, load_axes, given=False)
    if isinstance(subject, Equilibrium):
        return _at_rest(subject)
    return _held_at(subject)


def _at_rest(state: Equilibrium) -> Modes:
    """Modes where a mechanism came to rest, with its contacts as they are."""
    balance, posture = state._solution.balance, state.posture
    terms, units = state._system.terms, state.elastic.units
    columns = posture.coordinate_lengths
    basis = np.diag(columns) if balance.free is None else columns[:, None] * balance.free
    sizes = np.abs(balance.stiffness) + np.diag(balance.stiffness_scale)
    notes = tuple(n for n in state.notes if n.code not in ("unstable", "flutter", "divergence"))
    load = {
        "kind": "potentials",
        "at": None,
        "wrench": None,
        "given": bool(state.loads),
        "meaning": "the loads of the equilibrium, each as it is",
        "words": "at rest under its loads" if state.loads else "at rest, no load",
    }
    elastic = state.elastic.with_potential(*state.loads)
    solved = _solved(
        elastic, posture, basis, balance.stiffness, sizes, terms, units, rest=(load, notes)
    )
    return replace(solved, state=state)


def _held_at(result: PostureStiffness) -> Modes:
    """Modes of a posture that springs hold under a load."""
    reduction, posture, W = result.reduction, result.posture, result.wrench
    if W is None:
        raise reduction.undefined()
    columns = posture.coordinate_lengths
    H, terms = stiffness_under_load(result)
    D, basis = result.change_by_load, np.diag(columns)
    if posture.closure is not None and reduction.motions is not None:
        stiff = np.abs(H * np.outer(columns, columns)).max(axis=0, initial=0.0)
        basis = columns[:, None] * numerics.graded_basis(reduction.motions, stiff)[0]
    terms = terms + _rounded(result) / np.outer(columns, columns)
    K, size = basis.T @ H @ basis, np.abs(basis).T @ terms @ np.abs(basis)
    if not (result.energy != result.energy or not _is_symmetric(D)):
        K = 0.5 * (K + K.T)
    elastic = result.elastic
    return _solved(elastic, posture, basis, K, size, elastic.terms(), elastic.units, held=result)


def is_plain(elastic: ElasticMechanism) -> bool:
    """Whether linear springs in the joints of an open chain hold it, and nothing else acts.

    Then they carry any load, and no stiffness at the body is needed for the modes.
    """
    springs, chain = elastic.springs, elastic.mechanism
    return (
        isinstance(springs, JointSprings)
        and isinstance(chain, Chain)
        and not (chain.closures or chain.rigid or chain.tree.mimic is not None)
        and not (springs.laws or elastic.potentials)
        and elastic.gravity is None
        and bool(np.isnan(springs.rest).all())
        and bool((springs.stiffness > 0.0).all())
    )


def _plain(
    elastic: ElasticMechanism,
    q: ArrayLike | Mapping[str, float] | None,
    load: dict[str, Any],
    kind: LoadKind,
) -> Modes:
    """`_held_at` where `is_plain`: ``K_q = diag(k) - S_W + J^T D J``, D the load's part."""
    elastic, posture = elastic.placed(q)
    columns, springs = posture.coordinate_lengths, elastic.springs
    k = springs.stiffness if isinstance(springs, JointSprings) else columns * np.nan
    later = partial(analyse, elastic, posture.q, **load)
    natural = k * columns * columns
    K = terms = np.diag(natural)
    rested = None
    if load.get("wrench") is not None:
        W = checked_input(load["wrench"], (6,), "wrench")
        W = wrench_in_body(W, posture.pose, kind.at, load["load_axes"])
        if W.any():
            J, D = posture.motion.jacobian * columns, kind.change(W)
            bent, force = posture.motion.curvature(W) * np.outer(columns, columns), np.abs(J.T @ W)
            K = K - bent + J.T @ D @ J
            K = 0.5 * (K + K.T) if _is_symmetric(D) else K
            noise = _noise(force, natural, W, posture)
            terms = terms + np.abs(bent) + np.abs(J.T) @ np.abs(D) @ np.abs(J) + noise
            rested = elastic.balanced(posture, W)
    rested = rested or elastic.at_rest(posture.q.copy())
    return _solved(
        rested, posture, np.diag(columns), K, terms, elastic.terms(), elastic.units, held=later
    )


def stiffness_under_load(result: PostureStiffness) -> tuple[Array, Array]:
    """K_q (n, n) on all coordinates with the parts of load and closures; sizes of its terms.

    ``Hess Phi - S_W + J^T (K^load - K^B) J + sum lam_k c_k''``.
    """
    posture, W, D = result.posture, result.wrench, result.change_by_load
    H, terms = result.evaluation.hessian, np.abs(result.evaluation.hessian)
    if W is not None and np.any(W):
        J, curvature = posture.motion.jacobian, posture.motion.curvature(W)
        H = H - curvature + J.T @ D @ J
        terms = terms + np.abs(curvature) + np.abs(J.T) @ np.abs(D) @ np.abs(J)
    if posture.closure is not None and result.reduction.multipliers.any():
        curvature = posture.closure.curvature(result.reduction.multipliers)
        H, terms = H + curvature, terms + np.abs(curvature)
    return H, terms


def _rounded(result: PostureStiffness) -> float:
    """Stiffness, in natural units, that the rounding of forces may feign, over `IDLE`.

    Of the closures' forces and of the load, and of what springs exert over a rounding error.
    """
    columns, reduction = result.posture.coordinate_lengths, result.reduction
    g = np.abs(result.evaluation.gradient * columns)
    stiff = np.abs(result.evaluation.hessian * np.outer(columns, columns)).max(axis=0, initial=0.0)
    forces = reduction.multipliers
    if reduction.force is not None:
        forces = np.append(forces, reduction.force)
    return _noise(g, stiff, forces, result.posture)


def _noise(exerted: Array, stiff: Array, forces: Array, posture: MechanismPosture) -> float:
    least = float(np.minimum(exerted, numerics.ROUNDING * stiff).sum())
    carried = numerics.EPSILON * float(np.abs(forces).sum()) * max(1.0, posture.length)
    return (least + carried) / numerics.IDLE


def _is_symmetric(D: Array) -> bool:
    return bool(np.abs(D - D.T).max() <= numerics.ROUNDING * np.abs(D).max(initial=0.0))


def _solved(
    elastic: ElasticMechanism,
    posture: MechanismPosture,
    basis: Array,
    stiffness: Array,
    terms: Array,
    potentials: Sequence[Potential],
    units: Units,
    held: PostureStiffness | partial[PostureStiffness] | None = None,
    rest: tuple[Mapping[str, Any], tuple[Note, ...]] | None = None,
) -> Modes:
    full = kinetic_matrix(posture, potentials, units)
    mass = None if full is None else basis.T @ full @ basis
    if mass is None or full is None or not np.diag(mass).any():
        raise UndefinedError(
            f"nothing that moves in {elastic.name} has a mass: it has no frequencies "
            "(give inertias in the robot's file, body and legs.mass, or a payload)",
            code="no-mass",
            values={"links": list(elastic.mechanism.masses())},
        )
    size = np.abs(basis).T @ np.abs(full) @ np.abs(basis)
    spectrum = spectrum_of(stiffness, 0.5 * (mass + mass.T), terms, size)
    if spectrum.coupled:
        raise UndefinedError(
            "a motion with neither mass nor stiffness takes part in the forces of the others: "
            "there are no modes",
            code="massless-free-motion",
            values={"shapes": (basis @ spectrum.loose).T.tolist()},
        )
    return Modes(elastic, posture, basis, stiffness, mass, spectrum, held, rest)
