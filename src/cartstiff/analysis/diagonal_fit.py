r"""Independent joint springs, none negative, that come closest to a desired Cartesian stiffness."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from cartstiff import numerics
from cartstiff.analysis.matrices import (
    as_symmetric,
    balancing_length,
    invert,
    require_full_rank,
    scale_jacobian,
)
from cartstiff.arrays import (
    Result,
    checked_array,
    checked_length,
    checked_matrix,
    checked_vector,
)
from cartstiff.errors import UndefinedError
from cartstiff.geometry import se3
from cartstiff.geometry.se3 import Array

# Joint compliances below this share of the largest are called zero: the joint is best locked.
_LOCKED = numerics.ROUNDING


@dataclass(frozen=True, eq=False)
class DiagonalFit(Result):
    """Independent non-negative joint springs that come closest to a desired stiffness.

    Attributes
    ----------
    stiffness : ndarray, shape (n,)
        One spring per joint, none negative; for more than six joints infinite where a joint is
        best locked.
    cartesian : ndarray, shape (6, 6) or None
        The K^B they give; None if it is infinite in some direction.
    residual : float
        For six joints ``|K_l - desired K_l| / |desired K_l|``, for more that of the compliances
        (Frobenius norms, angles times the length l). For six joints the least possible one; for
        more, under load, a local minimum.
    length : float
        The length l of the residual.
    """

    stiffness: Array
    cartesian: Array | None
    residual: float
    length: float


def fit_diagonal(
    desired: ArrayLike,
    jacobian: ArrayLike,
    wrench: ArrayLike | None = None,
    *,
    load_term: ArrayLike | None = None,
    length: float | None = None,
) -> DiagonalFit:
    r"""Independent joint springs, none negative, closest to a desired K^B under load.

    For six joints K^B is linear in the springs, and the fit is a non-negative least-squares problem
    with one answer. For more, the compliance ``J (diag(k) - S_W)^-1 J^T`` is fitted: linear in 1/k
    without load, iterated from there with load.

    Raises
    ------
    UndefinedError
        As `joint_stiffness`; code ``"singular"`` also if the desired matrix must be inverted
        (n > 6) and cannot.
    """
    K, J = (
        as_symmetric(desired, "desired stiffness"),
        checked_array(jacobian, (6, "n"), "Jacobian", copy=False),
    )
    W = np.zeros(6) if wrench is None else checked_vector(wrench, 6, "wrench")
    scale = balancing_length(K) if length is None else checked_length(length)
    require_full_rank(J)
    n = J.shape[1]
    S = (
        se3.chain_curvature(J, W)
        if load_term is None
        else checked_matrix(load_term, "load term", n)
    )
    d = np.repeat([scale, 1.0], 3)
    K_l, J_l = K / d[:, None] / d, scale_jacobian(J, scale)
    fit = _fit_stiffness if J.shape[1] == 6 else _fit_compliance
    springs, reached, residual = fit(K_l, J_l, S)
    cartesian = None if reached is None else reached * d[:, None] * d
    return DiagonalFit(springs, cartesian, residual, scale)


def _nnls(columns: list[Array], target: Array) -> Array:
    """Weights >= 0 for which the weighted sum of matrices is nearest to the target."""
    from scipy.optimize import nnls

    A = np.column_stack([c.ravel() for c in columns])
    sizes = np.linalg.norm(A, axis=0)
    # nnls stops at an absolute tolerance: everything is brought to size one first.
    size = _size(target)
    weights = nnls(A / sizes, target.ravel() / size)[0]
    return np.asarray(weights * size / sizes, float)


def _size(matrix: Array) -> float:
    return float(np.linalg.norm(matrix)) or 1.0


def _fit_stiffness(K: Array, J: Array, S: Array) -> tuple[Array, Array, float]:
    """Springs k >= 0 with ``J^-T (diag k - S) J^-1`` nearest to K; six joints."""
    A = np.linalg.inv(J)
    load = A.T @ S @ A
    springs = _nnls([np.outer(row, row) for row in A], K + load)
    reached = (A.T * springs) @ A - load
    return springs, reached, float(np.linalg.norm(reached - K)) / _size(K)


def _fit_compliance(K: Array, J: Array, S: Array) -> tuple[Array, Array | None, float]:
    """Springs k > 0 with ``J (diag k - S)^-1 J^T`` nearest to K^-1; more than six joints.

    In the joint compliances x = 1/k, which may be zero: ``(1 - X S)^-1 X`` with X = diag x.
    """
    C = invert(K, "desired stiffness")
    size = float(np.linalg.norm(C))
    x = _nnls([np.outer(column, column) for column in J.T], C)
    if np.any(S):
        x = _iterate(C / size, J, S, x, size)
    x = np.where(x > _LOCKED * x.max(), x, 0.0)
    reached = J @ np.linalg.solve(np.eye(len(x)) - x[:, None] * S, x[:, None] * J.T)
    with np.errstate(divide="ignore"):
        springs = 1.0 / x
    cartesian: Array | None
    try:
        cartesian = invert(reached, "fitted compliance")
    except UndefinedError:
        cartesian = None
    return springs, cartesian, float(np.linalg.norm(reached - C)) / size


def _iterate(C: Array, J: Array, S: Array, x: Array, size: float) -> Array:
    """Least squares in x >= 0, from a start at which the posture is stable under the load."""
    from scipy.optimize import least_squares

    n = len(x)
    root = np.sqrt(x)
    worst = float(np.linalg.eigvalsh(root[:, None] * S * root)[-1])
    unit = float(x.max())
    start = x / unit * (0.5 / worst if worst > 0.5 else 1.0)

    def moved(z: Array) -> Array:
        return np.asarray(J @ np.linalg.inv(np.eye(n) - unit * z[:, None] * S))

    def error(z: Array) -> Array:
        return np.asarray(((moved(z) * (unit * z / size)) @ J.T - C).ravel())

    def slope(z: Array) -> Array:
        # d C / d x_a = m_a m_a^T with m_a column a of J (1 - X S)^-1.
        columns = [np.outer(m, m).ravel() for m in moved(z).T]
        return np.asarray(np.stack(columns, axis=1) * (unit / size))

    minimum = least_squares(
        error,
        start,
        jac=slope,
        bounds=(0.0, np.inf),
        xtol=numerics.ATTAINABLE_PRECISION,
        ftol=numerics.ATTAINABLE_PRECISION,
        gtol=numerics.ATTAINABLE_PRECISION,
    )
    return np.asarray(unit * minimum.x, float)
