r"""Frames in which a stiffness matrix is simplest: Loncaric's normal forms, least coupling.

A symmetric stiffness has 21 numbers, and a frame has six: fifteen are left. At the centre of
stiffness, in the right axes, the coupling block is diagonal: 6 + 6 + 3 numbers.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from cartstiff import numerics
from cartstiff.analysis.centres import (
    centre_of_stiffness,
    point_of_least_coupling,
)
from cartstiff.analysis.ellipsoids import stiffness_ellipsoid
from cartstiff.analysis.matrices import (
    ROTATION,
    TRANSLATION,
    as_symmetric,
    move_stiffness,
    symmetric_part,
)
from cartstiff.arrays import Result
from cartstiff.errors import UndefinedError
from cartstiff.geometry import se3
from cartstiff.geometry.se3 import Array
from cartstiff.stiffness.posture_notes import error_of_soft_directions


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
        Diagonal of the coupling block, smallest first; its sum does not depend on the frame.
    """

    T_m_n: Array
    matrix: Array
    coupling: Array


def _axes(coupling: Array, diagonal: Array) -> Array:
    """Proper rotation to eigenvectors of `coupling`; among equal ones, to those of `diagonal`."""
    values, axes = np.linalg.eigh(symmetric_part(coupling))
    # Rounding of the coupling block is measured on the matrix it was shifted by, too.
    size = max(float(np.abs(values).max()), numerics.TINY)
    start = 0
    for end in range(1, 4):
        if end == 3 or values[end] - values[end - 1] > numerics.CLOSE * size:
            group = axes[:, start:end]
            axes[:, start:end] = group @ np.linalg.eigh(group.T @ diagonal @ group)[1]
            start = end
    if np.linalg.det(axes) < 0:
        axes[:, 2] *= -1.0
    return axes


def _clean_coupling(coupling: Array, before: Array, lever: Array) -> Array:
    """Coupling block with what is only the rounding of its subtraction set to zero."""
    rounding = numerics.ZERO * max(float(np.abs(before).max()), float(np.abs(lever).max()))
    return np.zeros((3, 3)) if np.abs(coupling).max() <= rounding else coupling


def _checked_pair(stiffness: ArrayLike, compliance: ArrayLike | None) -> tuple[Array, Array | None]:
    """Stiffness and compliance; UndefinedError where the entries of K do not hold soft motions."""
    K = as_symmetric(stiffness)
    C = None if compliance is None else as_symmetric(compliance, "compliance")
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
        Code ``"no-centre-of-stiffness"``; code ``"ill-conditioned"`` where no matrix of stiffnesses
        holds the softer directions.
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
    """The frame in which rotation and translation are coupled least.

    Attributes
    ----------
    T_m_n : ndarray, shape (4, 4)
        Origin at the point of least coupling, axes along the principal axes of K_tt.
    matrix : ndarray, shape (6, 6)
        The stiffness in that frame.
    coupling, coupling_before : float
        ``|K_rt| / sqrt(|K_rr| |K_tt|)`` (Frobenius norms, a pure number between 0 and 1 for a
        positive definite matrix) in the new frame and in the old one.
    """

    T_m_n: Array
    matrix: Array
    coupling: float
    coupling_before: float


def _coupling_index(K: Array) -> float:
    rr, tt = np.linalg.norm(K[ROTATION, ROTATION]), np.linalg.norm(K[TRANSLATION, TRANSLATION])
    size = float(np.sqrt(rr * tt))
    return float(np.linalg.norm(K[ROTATION, TRANSLATION])) / size if size > 0 else float("nan")


def decoupling_frame(stiffness: ArrayLike, compliance: ArrayLike | None = None) -> DecouplingFrame:
    """Frame with the smallest coupling block in which K_tt is diagonal.

    The compliance as in `centre_of_stiffness`.

    Raises
    ------
    UndefinedError
        Code ``"no-point-of-least-coupling"``; code ``"ill-conditioned"`` as in `normal_form`.
    """
    K, C = _checked_pair(stiffness, compliance)
    p = point_of_least_coupling(K, C)
    axes = stiffness_ellipsoid(K, "translation", "held", None, C).axes
    T = se3.pose(axes, p)
    moved = symmetric_part(move_stiffness(K, T))
    return DecouplingFrame(T, moved, _coupling_index(moved), _coupling_index(K))
