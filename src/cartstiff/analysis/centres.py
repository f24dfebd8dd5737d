r"""Centres of an elasticity: stiffness, compliance, elasticity, least coupling.

Moving the origin to p (axes unchanged) changes the coupling block as ``K_rt' = K_rt - [p]x K_tt``
and that of the compliance as ``C_tr' = C_tr - [p]x C_rr``. Each centre is the point where something
about the coupling vanishes. Where a decoupling point exists, all of them are that point.

Keys: [Loncaric]_, [LipkinPatterson]_, [CiblakLipkin]_.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from cartstiff import numerics
from cartstiff.analysis.matrices import (
    ROTATION,
    TRANSLATION,
    as_symmetric,
    invert,
)
from cartstiff.arrays import Result
from cartstiff.errors import UndefinedError
from cartstiff.geometry import se3
from cartstiff.geometry.se3 import Array


def _symmetrising_point(coupling: Array, diagonal: Array, name: str, block: str) -> Array:
    """Point p with ``coupling - [p]x diagonal`` symmetric: (tr D 1 - D) p = 2 unskew(B)."""
    values = np.linalg.eigvalsh(diagonal)
    sums = np.array([values[1] + values[2], values[0] + values[2], values[0] + values[1]])
    if not np.abs(sums).min() > numerics.ZERO * np.abs(values).max():
        raise UndefinedError(
            f"the {name} is not a single point: two principal values of the {block} add to zero",
            code="no-" + name.replace(" ", "-"),
            values={"principal_values": values.tolist(), "sums_of_pairs": sums.tolist()},
        )
    M = np.trace(diagonal) * np.eye(3) - diagonal
    return np.linalg.solve(M, 2.0 * se3.unskew(coupling))


def centre_of_stiffness(stiffness: ArrayLike) -> Array:
    r"""Point (3,) at which the coupling block K_rt is symmetric, [Loncaric]_.

    ``p = 2 (tr(K_tt) 1 - K_tt)^-1 unskew(K_rt)``, unskew taking a 3x3 matrix to the vector of its
    antisymmetric part.

    Parameters
    ----------
    stiffness : array_like, shape (6, 6)
        Symmetric; the point is in the same frame.

    Raises
    ------
    UndefinedError
        Code ``"no-centre-of-stiffness"`` where two principal values of K_tt add to zero (rank one,
        or indefinite).
    """
    K = as_symmetric(stiffness)
    return _symmetrising_point(
        K[ROTATION, TRANSLATION],
        K[TRANSLATION, TRANSLATION],
        "centre of stiffness",
        "translational stiffness",
    )


def centre_of_compliance(compliance: ArrayLike) -> Array:
    r"""Point (3,) at which the coupling block of the compliance is symmetric, [Loncaric]_.

    ``p = 2 (tr(C_rr) 1 - C_rr)^-1 unskew(C_tr)``.

    Raises
    ------
    UndefinedError
        Code ``"no-centre-of-compliance"`` where two principal values of C_rr add to zero.
    """
    C = as_symmetric(compliance, "compliance")
    return _symmetrising_point(
        C[TRANSLATION, ROTATION],
        C[ROTATION, ROTATION],
        "centre of compliance",
        "rotational compliance",
    )


def centre_of_elasticity(stiffness: ArrayLike, compliance: ArrayLike | None = None) -> Array:
    r"""Point (3,) at which ``G = K_rt K_tt^-1`` is symmetric: the centre of elasticity.

    ``p = unskew(K_rt K_tt^-1)``. Half the sum of the feet of the perpendiculars to the three
    wrench-compliant axes, and of those to the three twist-compliant axes: seen from it both sums
    vanish [LipkinPatterson]_. Since ``C_tr C_rr^-1 = -G^T``, stiffness and compliance give the
    same point.

    Raises
    ------
    UndefinedError
        Code ``"no-centre-of-elasticity"`` where K_tt is singular.
    """
    K = as_symmetric(stiffness)
    D = K[TRANSLATION, TRANSLATION]
    values = np.linalg.eigvalsh(D)
    if compliance is not None:
        C = as_symmetric(compliance, "compliance")
        turns = np.linalg.eigvalsh(C[ROTATION, ROTATION])
        if numerics.condition(turns) < numerics.condition(values):
            return -se3.unskew(np.linalg.solve(C[ROTATION, ROTATION], C[ROTATION, TRANSLATION]))
    if not np.abs(values).min() > numerics.ZERO * np.abs(values).max():
        raise UndefinedError(
            "the centre of elasticity is not a single point: the translational stiffness is "
            "singular",
            code="no-centre-of-elasticity",
            values={"principal_values": values.tolist()},
        )
    return se3.unskew(np.linalg.solve(D, K[TRANSLATION, ROTATION]).T)


def point_of_least_coupling(stiffness: ArrayLike) -> Array:
    r"""Point (3,) at which the Frobenius norm of K_rt is smallest.

    Least squares for ``K_rt - [p]x K_tt``: ``(tr(K_tt^2) 1 - K_tt^2) p = 2 unskew(K_rt K_tt)``.

    Raises
    ------
    UndefinedError
        Code ``"no-point-of-least-coupling"`` where K_tt has rank one or zero: a whole line
        of points serves equally.
    """
    K = as_symmetric(stiffness)
    D = K[TRANSLATION, TRANSLATION]
    return _symmetrising_point(
        K[ROTATION, TRANSLATION] @ D,
        D @ D,
        "point of least coupling",
        "squared translational stiffness",
    )


@dataclass(frozen=True, eq=False)
class Centres(Result):
    """All centres of one elasticity; what does not exist is None, with the reason.

    Attributes
    ----------
    stiffness, compliance, elasticity, least_coupling : ndarray, shape (3,), or None
        Points in the frame of the matrix.
    reasons : dict
        For each missing centre, the `UndefinedError` that says why, with its numbers.
    """

    stiffness: Array | None
    compliance: Array | None
    elasticity: Array | None
    least_coupling: Array | None
    reasons: dict[str, UndefinedError]


def centres_of(stiffness: ArrayLike, compliance: ArrayLike | None = None) -> Centres:
    """All centres at once; the compliance is inverted from the stiffness unless given."""
    points: dict[str, Array] = {}
    reasons: dict[str, UndefinedError] = {}
    K = as_symmetric(stiffness)
    C = None if compliance is None else as_symmetric(compliance, "compliance")
    try:
        C = invert(K) if C is None else C
        points["compliance"] = centre_of_compliance(C)
    except UndefinedError as error:
        reasons["compliance"] = error
    for name, function in (
        ("stiffness", centre_of_stiffness),
        ("elasticity", lambda K: centre_of_elasticity(K, C)),
        ("least_coupling", point_of_least_coupling),
    ):
        try:
            points[name] = function(K)
        except UndefinedError as error:
            reasons[name] = error
    return Centres(
        points.get("stiffness"),
        points.get("compliance"),
        points.get("elasticity"),
        points.get("least_coupling"),
        reasons,
    )
