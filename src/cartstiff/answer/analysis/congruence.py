"""Joint stiffness and Cartesian stiffness of a serial chain under load, both ways,
[ChenKao]_.

With the body Jacobian J (6, n) and a load W,

    H_W = Kq - S_W,     S_W[a, b] = 1/2 W . [J_a, J_b] for a before b, symmetric

and K^B = J^-T H_W J^-1 for six joints, (J H_W^-1 J^T)^-1 for more: the conservative
congruence transformation. Its inverse gives the joint stiffness for a desired Cartesian
one, for compliance control:

    Kq = J^T K^B J + S_W + Z Kz Z^T

with Z a null-space basis of J and Kz the stiffness of the self-motion, free to choose. Kq
couples the joints in general; `fit_diagonal` shows whether independent joint springs
suffice.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from cartstiff.answer.analysis.matrices import (
    Definiteness,
    as_symmetric,
    balancing_length,
    definiteness,
    invert,
    reach,
    require_full_rank,
    scale_jacobian,
)
from cartstiff.core import numerics
from cartstiff.core.arrays import (
    Array,
    Result,
    checked_array,
    checked_length,
    checked_matrix,
    checked_vector,
)
from cartstiff.core.errors import UndefinedError
from cartstiff.core.geometry import se3
from cartstiff.core.potentials.contract import Evaluation, SecondOrderMap
from cartstiff.core.stiffness.reduction import reduce_to


@dataclass(frozen=True, eq=False)
class DiagonalFit(Result):
    """Independent non-negative joint springs that come closest to a desired stiffness.

    Attributes
    ----------
    stiffness : ndarray, shape (n,)
        One spring per joint, none negative; for more than six joints infinite if locking
        the joint is best.
    cartesian : ndarray, shape (6, 6) or None
        Their K^B; None if it is infinite in some direction.
    residual : float
        For six joints ``|K_l - desired K_l| / |desired K_l|``, for more that of the
        compliances (Frobenius norms, angles times the length l). For six joints the least
        possible one; for more, under load, a local minimum.
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
    *,
    load_term: ArrayLike | None,
    length: float | None,
) -> DiagonalFit:
    r"""Independent joint springs, none negative, closest to a desired K^B under load.

    For six joints K^B is linear in the springs, and the fit is a non-negative
    least-squares problem with one answer. For more, the compliance ``J (diag(k) - S_W)^-1
    J^T`` is fitted: linear in 1/k without load, iterated from there with load.

    Raises
    ------
    UndefinedError
        As `joint_stiffness`; code ``"singular"`` also if the desired matrix must be
        inverted (n > 6) and cannot.
    """
    K, J, _, S = _checked(desired, jacobian, None, load_term)
    scale = balancing_length(K) if length is None else checked_length(length)
    d = np.repeat([scale, 1.0], 3)
    K_l, J_l = K / d[:, None] / d, scale_jacobian(J, scale)
    fit = _fit_stiffness if J.shape[1] == 6 else _fit_compliance
    springs, reached, residual = fit(K_l, J_l, S)
    cartesian = None if reached is None else reached * d[:, None] * d
    return DiagonalFit(springs, cartesian, residual, scale)


def _checked(
    desired: ArrayLike,
    jacobian: ArrayLike,
    wrench: ArrayLike | None,
    load_term: ArrayLike | None,
) -> tuple[Array, Array, Array, Array]:
    """K (6, 6), J (6, n) of full rank, W (6,) and S (n, n)."""
    K = as_symmetric(desired, "desired stiffness")
    J = checked_array(jacobian, (6, "n"), "Jacobian", copy=False)
    W = np.zeros(6) if wrench is None else checked_vector(wrench, 6, "wrench")
    require_full_rank(J)
    if load_term is None:
        return K, J, W, se3.chain_curvature(J, W)
    return K, J, W, checked_matrix(load_term, "load term", J.shape[1])


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
    return numerics.norm(matrix) or 1.0


def _fit_stiffness(K: Array, J: Array, S: Array) -> tuple[Array, Array, float]:
    """Springs k >= 0 with ``J^-T (diag k - S) J^-1`` nearest to K; six joints."""
    A = np.linalg.inv(J)
    load = A.T @ S @ A
    springs = _nnls([np.outer(row, row) for row in A], K + load)
    reached = (A.T * springs) @ A - load
    return springs, reached, numerics.norm(reached - K) / _size(K)


def _fit_compliance(K: Array, J: Array, S: Array) -> tuple[Array, Array | None, float]:
    """Springs k > 0 with ``J (diag k - S)^-1 J^T`` nearest to K^-1; more than six joints.

    In the joint compliances x = 1/k, which may be zero: ``(1 - X S)^-1 X`` with X = diag
    x.
    """
    C = invert(K, "desired stiffness")
    size = numerics.norm(C)
    x = _nnls([np.outer(column, column) for column in J.T], C)
    if np.any(S):
        x = _iterate(C / size, J, S, x, size)
    x = np.where(x > numerics.ROUNDOFF * x.max(), x, 0.0)  # zero: a locked joint
    reached = J @ np.linalg.solve(np.eye(len(x)) - x[:, None] * S, x[:, None] * J.T)
    with np.errstate(divide="ignore"):
        springs = 1.0 / x
    cartesian: Array | None
    try:
        cartesian = invert(reached, "fitted compliance")
    except UndefinedError:
        cartesian = None
    return springs, cartesian, numerics.norm(reached - C) / size


def _iterate(C: Array, J: Array, S: Array, x: Array, size: float) -> Array:
    """Least squares in x >= 0, from a start at which the posture is stable
    under the load.
    """
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


def cartesian_stiffness(
    jacobian: ArrayLike, joint_matrix: ArrayLike, wrench: ArrayLike
) -> Array:
    """Stiffness K^B (6, 6) of a serial chain: ``(J (Kq - S_W)^-1 J^T)^-1``.

    Parameters
    ----------
    jacobian : array_like, shape (6, n)
        Body Jacobian J: twist per unit of each coordinate, columns in chain order.
    joint_matrix : array_like, shape (n, n) or (n,)
        Joint stiffness Kq, or its diagonal [N m/rad, N/m].
    wrench : array_like, shape (6,), optional
        Load W that the environment applies; default none.

    Raises
    ------
    InputError
        If a shape is wrong.
    UndefinedError
        Code ``"fewer-than-six-freedoms"`` or ``"singular"`` if the Jacobian has not rank
        six, or if Kq - S_W has no inverse.
    """
    J = checked_array(jacobian, (6, "n"), "Jacobian", copy=False)
    Kq = _joint_matrix(joint_matrix, J.shape[1])
    W = checked_vector(wrench, 6, "wrench")
    require_full_rank(J)
    output = SecondOrderMap(J, lambda w: se3.chain_curvature(J, w))
    energy = Evaluation(0.0, J.T @ W, Kq)
    reduction = reduce_to(output, energy, None, reach(J), np.ones(J.shape[1]))
    K = reduction.stiffness
    if K is None:
        raise reduction.undefined()
    return K


def _joint_matrix(value: ArrayLike, n: int) -> Array:
    Kq = checked_array(value, [(n, n), (n,)], "joint stiffness")
    return np.diag(Kq) if Kq.ndim == 1 else Kq


@dataclass(frozen=True, eq=False)
class JointStiffness(Result):
    """Joint stiffness matrix for a desired Cartesian stiffness, with its feasibility.

    Attributes
    ----------
    matrix : ndarray, shape (n, n)
        Kq, the Hessian of the joint energy; symmetric.
    load_term : ndarray, shape (n, n)
        The part S of it due to the load.
    torque : ndarray, shape (n,)
        ``J^T W``, the joint torques that the springs must exert at this posture.
    definiteness : str
        Definiteness of Kq: passive springs between joints realise a positive one; others
        need active control.
    eigenvalues : ndarray, shape (n,)
        Eigenvalues of Kq, scaled to unit diagonal if possible.
    off_diagonal : float
        Largest ``|Kq_ab| / sqrt(|Kq_aa Kq_bb|)``; 0 for independent joints.
    is_diagonal : bool
        Whether that is below 1e-9.
    is_feasible : bool or None
        Whether independent, non-negative joint springs realise the desired stiffness
        exactly. None without a fit.
    stable : bool
        Whether Kq - S_W is positive definite: the posture is stable under the load.
    diagonal_fit : DiagonalFit or None
        The best independent springs. None for more than six joints if the desired
        matrix is singular: its compliance cannot be fitted.
    """

    matrix: Array
    load_term: Array
    torque: Array
    definiteness: Definiteness
    eigenvalues: Array
    off_diagonal: float
    is_diagonal: bool
    is_feasible: bool | None
    stable: bool
    diagonal_fit: DiagonalFit | None


def joint_stiffness(
    desired: ArrayLike,
    jacobian: ArrayLike,
    wrench: ArrayLike | None = None,
    *,
    load_term: ArrayLike | None = None,
    null_space_stiffness: ArrayLike | None = None,
    length: float | None = None,
) -> JointStiffness:
    r"""Joint stiffness of a serial arm for a desired K^B at a posture under load.

    Parameters
    ----------
    desired : array_like, shape (6, 6)
        Stiffness K^B in the body frame, symmetric.
    jacobian : array_like, shape (6, n)
        Body Jacobian: twist per unit of each coordinate, columns in chain order; n >= 6
        and rank six.
    wrench : array_like, shape (6,), optional
        Load (moment, force) that the environment applies; default none.
    load_term : array_like, shape (n, n), optional
        S with K^B = J^-T (Kq - S) J^-1; default S_W of a serial chain. It differs where
        other potentials act (less their Hessian) or the coordinates are those of a
        platform's legs.
    null_space_stiffness : float or array_like, shape (n - 6, n - 6), optional
        Stiffness Kz on an orthonormal basis of the self-motion; default the mean of the
        six other eigenvalues of J^T K J. Without any, the self-motion would be free.
    length : float, optional
        Length of the fit's residual; default balances the desired matrix.

    Raises
    ------
    UndefinedError
        Code ``"fewer-than-six-freedoms"`` (n < 6) or ``"singular"`` (rank below six).
    InputError
        If a shape is wrong or the desired matrix is not symmetric.
    """
    K, J, W, S = _checked(desired, jacobian, wrench, load_term)
    core, n = J.T @ K @ J, J.shape[1]
    # What the springs must resist: the desired stiffness, and beyond six joints a
    # stiffness of the self-motion, which the desired matrix does not see.
    H = core.copy()
    if n > 6:
        Z = np.linalg.svd(scale_jacobian(J, reach(J)))[2][6:].T
        if null_space_stiffness is None:
            null_space_stiffness = float(np.trace(core)) / 6.0
        Kz = checked_array(
            null_space_stiffness, [(n - 6, n - 6), ()], "null-space stiffness"
        )
        Kz = Kz * np.eye(n - 6) if Kz.ndim == 0 else Kz
        H = core + Z @ (0.5 * (Kz + Kz.T)) @ Z.T
    # The joints' own matrix carries the load's part on top. It is judged in a scale in
    # which its diagonal is one.
    Kq = 0.5 * (H + H.T) + S
    diagonal = np.diag(Kq)
    scale = np.sqrt(np.abs(diagonal))
    unit = Kq / np.outer(scale, scale) if np.all(scale > 0) else Kq
    values = np.linalg.eigvalsh(unit)
    off = float(np.abs(unit - np.diag(np.diag(unit))).max())
    # Springs of single joints that come nearest, since few controllers couple joints.
    fit: DiagonalFit | None
    try:
        fit = fit_diagonal(K, J, load_term=S, length=length)
    except UndefinedError:
        fit = None
    # Stable is what resists every motion, whatever the signs in Kq are.
    root = np.sqrt(np.abs(np.diag(H)))
    if root.all():
        stable = definiteness(np.linalg.eigvalsh(H / np.outer(root, root)))
    else:
        stable = "zero"
    return JointStiffness(
        Kq,
        S,
        J.T @ W,
        definiteness(values),
        values,
        off,
        off < numerics.NEGLIGIBLE_DIFFERENCE,
        None if fit is None else fit.residual < numerics.UNEXPLAINED_SHARE,
        stable == "positive",
        fit,
    )
