"""Springs with other numbers: what is given by the user, and what a posture asks of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from cartstiff import numerics
from cartstiff.errors import InputError
from cartstiff.geometry.se3 import Array
from cartstiff.mechanisms.contract import MechanismPosture, named_values
from cartstiff.potentials.line_springs import LineSprings
from cartstiff.potentials.springs import JointSprings


def with_values(
    springs: JointSprings | LineSprings,
    names: tuple[str, ...],
    stiffness: float | Mapping[str, float] | ArrayLike | None,
    rest: float | Mapping[str, float] | ArrayLike | None,
) -> JointSprings | LineSprings:
    """The springs with other stiffness and rest positions, see `ElasticMechanism.with_springs`."""
    k = springs.stiffness
    were_rigid = springs.rigid if isinstance(springs, JointSprings) else frozenset()
    if stiffness is not None:
        if isinstance(springs, JointSprings):
            k = k.copy()
            k[list(springs.rigid)] = np.inf
            springs = replace(springs, rigid=frozenset())
        k = named_values(stiffness, names, k, "stiffness", infinite=True)
        if np.any(k < 0):
            raise InputError("stiffness must not be negative", got=k.tolist())
    rests = springs.rest
    if rest is not None:
        rests = named_values(rest, names, rests, "rest")
        for j in springs.rigid if isinstance(springs, JointSprings) else ():
            if not isinstance(rest, Mapping) or names[j] in rest:
                raise InputError(
                    f"joint {names[j]!r} is rigid and has no rest position",
                    expected="rest positions by name, of the others",
                )
    # What was at rest anywhere, or rigid, has no rest position yet.
    rests = np.where(np.isinf(k), np.nan, rests)
    if stiffness is not None and rest is None:
        rests[[j for j in were_rigid if np.isfinite(k[j])]] = np.nan
    # A number given for every joint replaces nonlinear laws as well.
    if isinstance(springs, JointSprings) and stiffness is not None:
        named = set(stiffness) if isinstance(stiffness, Mapping) else set(names)
        laws = {j: law for j, law in springs.laws.items() if names[j] not in named}
        springs = replace(springs, laws=laws)
    return springs.replaced(k, rests)


def borne_by_springs(
    springs: JointSprings,
    names: tuple[str, ...],
    posture: MechanismPosture,
    gradient: Array,
    every: bool,
    size: float,
) -> Array:
    """The gradient that springs must give, less what closure forces can carry.

    Joints whose torque is settled (passive, or with a rest position) leave the rest to the
    closures; what neither carries is refused where a wrench was asked for, of generalised
    forces up to `size`, and left unbalanced otherwise.
    """
    chosen = springs.is_open(every)
    if chosen.all():
        return gradient
    settled = ~chosen
    missing = np.where(settled, gradient - springs.torque(posture.q), 0.0)
    if not missing.any():
        return gradient
    if posture.closure is not None:
        sizes = posture.coordinate_lengths
        _, values, Vt = np.linalg.svd(posture.closure.jacobian * sizes)
        V, N = np.split(Vt.T, [numerics.rank(values)], axis=1)
        # Closures carry what joints leave as far as the others' motions are the mechanism's: the
        # small singular values of both are the same, and one decision is taken on the latter.
        most = [numerics.singular_values(m).max(initial=0.0) for m in (N[chosen], V[settled])]
        least = numerics.RANK * float(most[0] / max(most[1], numerics.TINY))
        forces = np.linalg.lstsq(V[settled], (missing * sizes)[settled], rcond=least)[0]
        borne = V @ forces / sizes
        gradient = gradient - borne
        missing = np.where(settled, missing - borne, 0.0)
    largest = int(np.argmax(np.abs(missing)))
    size = max(size, float(np.abs(gradient).max()))
    if every and abs(missing[largest]) > numerics.BALANCE * size + numerics.ROUNDING:
        raise InputError(
            f"the springs cannot balance this wrench: joint {names[largest]!r} has no "
            "spring and would have to carry a torque",
            expected="a stiffness above zero there, or a wrench that it does not feel",
            got=f"torque {missing[largest]:.6g}",
        )
    return gradient
