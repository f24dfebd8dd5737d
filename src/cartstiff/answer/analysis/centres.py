"""Centres of an elasticity: stiffness, compliance, elasticity, least coupling.

Moving the origin to p (axes unchanged) changes the coupling block as ``K_rt' = K_rt -
[p]x K_tt`` and that of the compliance as ``C_tr' = C_tr - [p]x C_rr``. At each centre a
property of the coupling vanishes. If a decoupling point exists, all centres are that
point.

Keys: [Loncaric]_, [LipkinPatterson]_, [CiblakLipkin]_.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import ArrayLike

from cartstiff.answer.analysis.ellipsoids import (
    Ellipsoid,
    compliance_ellipsoid,
    stiffness_ellipsoid,
)
from cartstiff.answer.analysis.matrices import (
    ROTATION,
    TRANSLATION,
    as_symmetric,
    invert,
    move_stiffness,
    symmetric_pair,
    symmetric_part,
)
from cartstiff.answer.analysis.screws import coupling_matrix
from cartstiff.core import numerics
from cartstiff.core.arrays import Array, Result
from cartstiff.core.errors import UndefinedError
from cartstiff.core.geometry import se3
from cartstiff.core.stiffness.posture_notes import error_of_soft_directions


def _symmetrising_point(
    shape: Ellipsoid, coupling: Array, name: str, block: str, power: int = 1
) -> Array:
    """Point p with ``B - [p]x D`` symmetric, D the power of a block with
    principal axes e_i.

    ``(tr D 1 - D) p = 2 unskew(B)`` and ``B = sum B e_i e_i^T``: along e_a it follows
    from the other two axes, ``p . e_a = sum e_a . (e_i x B e_i) / sum d_i``, so that a
    stiff axis adds no rounding to the others.

    Parameters
    ----------
    shape : Ellipsoid
        Principal values d_i and axes of the block.
    coupling : ndarray, shape (3, 3)
        ``B e_i`` of the block itself, in columns.
    """
    values = shape.eigenvalues**power
    turned = np.cross(shape.axes, coupling * shape.eigenvalues ** (power - 1), axis=0)
    others = 1.0 - np.eye(3)
    sums = others @ values
    if not np.all(np.abs(sums) > numerics.ZERO_SHARE * (others @ np.abs(values))):
        raise UndefinedError(
            f"the {name} is not a single point: two principal values of the {block} add "
            "to zero",
            code="no-" + name.replace(" ", "-"),
            values={"principal_values": values.tolist(), "sums_of_pairs": sums.tolist()},
        )
    along = (shape.axes.T @ turned * others).sum(axis=1) / sums
    return np.asarray(shape.axes @ along)


def _translation(K: Array, C: Array | None) -> tuple[Ellipsoid, Array]:
    """Principal axes e_i of K_tt, and ``K_rt e_i`` in columns."""
    shape, G = (
        stiffness_ellipsoid(K, "translation", "held", None, C),
        coupling_matrix(K, C),
    )
    if G is None:
        return shape, K[ROTATION, TRANSLATION] @ shape.axes
    return shape, G @ (shape.axes * shape.eigenvalues)


def centre_of_stiffness(
    stiffness: ArrayLike, compliance: ArrayLike | None = None
) -> Array:
    r"""Point (3,) at which the coupling block K_rt is symmetric, [Loncaric]_.

    ``p = 2 (tr(K_tt) 1 - K_tt)^-1 unskew(K_rt)``, unskew taking a 3x3 matrix to the
    vector of its antisymmetric part.

    Parameters
    ----------
    stiffness : array_like, shape (6, 6)
        Symmetric; the point is in the same frame.
    compliance : array_like, shape (6, 6), optional
        Its inverse, for values that the stiffness does not resolve.

    Raises
    ------
    UndefinedError
        Code ``"no-centre-of-stiffness"`` where two principal values of K_tt add to zero
        (rank one, or indefinite); code ``"ill-conditioned"`` where the matrices do not
        resolve it.
    """
    known = _translation(*symmetric_pair(stiffness, compliance))
    return _symmetrising_point(*known, "centre of stiffness", "translational stiffness")


def centre_of_compliance(
    compliance: ArrayLike, stiffness: ArrayLike | None = None
) -> Array:
    r"""Point (3,) at which the coupling block of the compliance is symmetric,
    [Loncaric]_.

    ``p = 2 (tr(C_rr) 1 - C_rr)^-1 unskew(C_tr)``; the stiffness as the compliance in
    `centre_of_stiffness`.

    Raises
    ------
    UndefinedError
        Code ``"no-centre-of-compliance"`` where two principal values of C_rr add to zero;
        code ``"ill-conditioned"`` where the matrices do not resolve it.
    """
    C = as_symmetric(compliance, "compliance")
    K = None if stiffness is None else as_symmetric(stiffness)
    shape, G = compliance_ellipsoid(C, "rotation", "free", None, K), coupling_matrix(K, C)
    moved = C[TRANSLATION, ROTATION] @ shape.axes
    if G is not None:
        moved = -G.T @ (shape.axes * shape.eigenvalues)
    return _symmetrising_point(
        shape, moved, "centre of compliance", "rotational compliance"
    )


def centre_of_elasticity(
    stiffness: ArrayLike, compliance: ArrayLike | None = None
) -> Array:
    r"""Point (3,) at which ``G = K_rt K_tt^-1`` is symmetric: the centre of elasticity.

    ``p = unskew(K_rt K_tt^-1)``. Half the sum of the feet of the perpendiculars to the
    three wrench-compliant axes, and of those to the three twist-compliant axes: seen from
    it both sums vanish [LipkinPatterson]_. Since ``C_tr C_rr^-1 = -G^T``, stiffness and
    compliance give the same point; the better conditioned one is taken.

    Raises
    ------
    UndefinedError
        Code ``"no-centre-of-elasticity"`` where K_tt is singular; code
        ``"ill-conditioned"`` where the matrices do not resolve it.
    """
    K, C = symmetric_pair(stiffness, compliance)
    G = coupling_matrix(K, C)
    if G is None:
        raise UndefinedError(
            "the centre of elasticity is not a single point: the translational stiffness "
            "is "
            "singular",
            code="no-centre-of-elasticity",
            values={
                "principal_values": np.linalg.eigvalsh(
                    K[TRANSLATION, TRANSLATION]
                ).tolist()
            },
        )
    return se3.unskew(G)


def point_of_least_coupling(
    stiffness: ArrayLike, compliance: ArrayLike | None = None
) -> Array:
    r"""Point (3,) at which the Frobenius norm of K_rt is smallest.

    Least squares for ``K_rt - [p]x K_tt``: ``(tr(K_tt^2) 1 - K_tt^2) p = 2 unskew(K_rt
    K_tt)``; the compliance as in `centre_of_stiffness`.

    Raises
    ------
    UndefinedError
        Code ``"no-point-of-least-coupling"`` where K_tt has rank one or zero: a whole
        line of points is equivalent; code ``"ill-conditioned"`` where the matrices do not
        resolve it.
    """
    known = _translation(*symmetric_pair(stiffness, compliance))
    name, block = "point of least coupling", "squared translational stiffness"
    return _symmetrising_point(*known, name, block, power=2)


@dataclass(frozen=True, eq=False)
class Centres(Result):
    """All centres of one elasticity; None, with the reason, for one that does not exist.

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
    """All centres of a stiffness (6, 6) at once; the compliance is inverted from it
    unless given.
    """
    K, C = symmetric_pair(stiffness, compliance)
    functions: dict[str, Callable[[], Array]] = {
        "compliance": lambda: centre_of_compliance(invert(K) if C is None else C, K),
        "stiffness": partial(centre_of_stiffness, K, C),
        "elasticity": partial(centre_of_elasticity, K, C),
        "least_coupling": partial(point_of_least_coupling, K, C),
    }
    points: dict[str, Array | None] = dict.fromkeys(functions)
    reasons: dict[str, UndefinedError] = {}
    for name, function in functions.items():
        try:
            points[name] = function()
        except UndefinedError as error:
            reasons[name] = error
    return Centres(**points, reasons=reasons)


@dataclass(frozen=True, eq=False)
class NormalForm(Result):
    """A matrix in its normal frame N.

    Attributes
    ----------
    T_m_n : ndarray, shape (4, 4)
        Frame N in the frame M of the original matrix.
    matrix : ndarray, shape (6, 6)
        Stiffness or compliance in N; its coupling blocks are diagonal.
    coupling : ndarray, shape (3,)
        Diagonal of the coupling block, smallest first; its sum does not depend on the
        frame.
    """

    T_m_n: Array
    matrix: Array
    coupling: Array


def _axes(coupling: Array, diagonal: Array) -> Array:
    """Proper rotation to eigenvectors of `coupling`.

    Among equal ones, to those of `diagonal`.
    """
    values, axes = np.linalg.eigh(symmetric_part(coupling))
    # Rounding of the coupling block is measured on the matrix it was shifted by, too.
    size = max(float(np.abs(values).max()), numerics.TINY)
    start = 0
    for end in range(1, 4):
        if (
            end == 3
            or values[end] - values[end - 1] > numerics.NEGLIGIBLE_DIFFERENCE * size
        ):
            group = axes[:, start:end]
            axes[:, start:end] = group @ np.linalg.eigh(group.T @ diagonal @ group)[1]
            start = end
    if np.linalg.det(axes) < 0:
        axes[:, 2] *= -1.0
    return axes


def _clean_coupling(coupling: Array, before: Array, lever: Array) -> Array:
    """Coupling block, zero if it is only the rounding of its subtraction."""
    rounding = numerics.ZERO_SHARE * max(
        float(np.abs(before).max()), float(np.abs(lever).max())
    )
    return np.zeros((3, 3)) if np.abs(coupling).max() <= rounding else coupling


def _checked_pair(
    stiffness: ArrayLike, compliance: ArrayLike | None
) -> tuple[Array, Array | None]:
    """Stiffness and compliance.

    UndefinedError if the entries of K do not resolve soft motions.
    """
    K, C = symmetric_pair(stiffness, compliance)
    error = 0.0 if C is None else error_of_soft_directions(K, C)
    if error > numerics.LOST_ERROR:
        raise UndefinedError(
            "the stiffness matrix does not hold its softer directions, in no frame",
            code="ill-conditioned",
            values={"matrix": "stiffness", "relative_error": error},
        )
    return K, C


def normal_form(stiffness: ArrayLike, compliance: ArrayLike | None = None) -> NormalForm:
    """Frame at the centre of stiffness with K_rt diagonal, and K there, [Loncaric]_.

    The compliance as in `centre_of_stiffness`.

    Raises
    ------
    UndefinedError
        Code ``"no-centre-of-stiffness"``; code ``"ill-conditioned"`` where no stiffness
        matrix resolves the softer directions.
    """
    K, C = _checked_pair(stiffness, compliance)
    p = centre_of_stiffness(K, C)
    D = K[TRANSLATION, TRANSLATION]
    lever = se3.skew(p) @ D
    B = _clean_coupling(K[ROTATION, TRANSLATION] - lever, K[ROTATION, TRANSLATION], lever)
    T = se3.pose(_axes(B, D), p)
    moved = symmetric_part(move_stiffness(K, T))
    return NormalForm(T, moved, np.diag(moved[ROTATION, TRANSLATION]))


@dataclass(frozen=True, eq=False)
class DecouplingFrame(Result):
    """The frame with the least coupling of rotation and translation.

    Attributes
    ----------
    T_m_n : ndarray, shape (4, 4)
        Origin at the point of least coupling, axes along the principal axes of K_tt.
    matrix : ndarray, shape (6, 6)
        The stiffness in that frame.
    coupling, coupling_before : float
        ``|K_rt| / sqrt(|K_rr| |K_tt|)`` (Frobenius norms, a pure number between 0 and 1
        for a positive definite matrix) in the new frame and in the old one.
    """

    T_m_n: Array
    matrix: Array
    coupling: float
    coupling_before: float


def _coupling_index(K: Array) -> float:
    rr, tt = (
        np.linalg.norm(K[ROTATION, ROTATION]),
        np.linalg.norm(K[TRANSLATION, TRANSLATION]),
    )
    size = float(np.sqrt(rr * tt))
    if size > 0:
        return numerics.norm(K[ROTATION, TRANSLATION]) / size
    return float("nan")


def decoupling_frame(
    stiffness: ArrayLike, compliance: ArrayLike | None = None
) -> DecouplingFrame:
    """Frame with the smallest coupling block in which K_tt is diagonal.

    Of a stiffness (6, 6) under any connection; the compliance as in
    `centre_of_stiffness`.

    Raises
    ------
    UndefinedError
        Code ``"no-point-of-least-coupling"``; code ``"ill-conditioned"`` as in
        `normal_form`.
    """
    K, C = _checked_pair(stiffness, compliance)
    p = point_of_least_coupling(K, C)
    axes = stiffness_ellipsoid(K, "translation", "held", None, C).axes
    T = se3.pose(axes, p)
    moved = symmetric_part(move_stiffness(K, T))
    return DecouplingFrame(T, moved, _coupling_index(moved), _coupling_index(K))
