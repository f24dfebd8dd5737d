r"""Roots of a compliance, which hold what neither stiffness nor compliance has digits for.

With springs 1e15 apart, or close to a singularity, principal values of a stiffness differ by 1e20
and more: the large ones stand in K, the small ones in C = K^-1, and those between in neither. They
stand in a root G of the compliance,

    C = J H^-1 J^T = G G^T,     G^T = Q L^-1 J^T,     H = L L^T,     Q^T Q = 1,

whose singular values differ by the square root only. Where H is graded like its diagonal, so are
the rows of G^T; the one-sided Jacobi method keeps such gradings, so that the singular values of G
lose no more digits than its rows, each scaled to length 1, would. With the smallest singular value
sigma of a Jacobian (of the largest) these are known to about `numerics.EPSILON` / sigma: no better
than its entries, which are numbers of sixteen digits.

References: [DemmelEtAl]_ for what Jacobi's method keeps, [CoxHigham]_ for the order of rows.
"""

from __future__ import annotations

import numpy as np

from cartstiff import numerics
from cartstiff.numerics import Array

# Of LAPACK's DGEJSV: rows and columns may both be graded; nothing is cut off as rounding.
_GRADED, _VECTORS, _NO_VECTORS, _WHOLE_RANGE, _NOTHING_SMALL = 2, 0, 3, 0, 0


def root_of_compliance(jacobian: Array, hessian: Array) -> Array | None:
    """G (6, 6) with ``J H^-1 J^T = G G^T``; None unless H is positive definite and C has rank 6.

    Of an unsymmetric H, with symmetric part L L^T, the symmetric part of C has the root
    ``J L^-T (1 + N)^-1`` with the skew ``N = L^-1 (H - H^T) L^-T / 2``.

    Parameters
    ----------
    jacobian : ndarray, shape (6, f)
        J.
    hessian : ndarray, shape (f, f)
        H.
    """
    from scipy.linalg import solve_triangular

    if jacobian.shape[1] < len(jacobian):
        return None
    sizes = numerics.equilibration(hessian)
    scaled = hessian / np.multiply.outer(sizes, sizes)
    try:
        L = np.linalg.cholesky(0.5 * (scaled + scaled.T))
    except np.linalg.LinAlgError:
        return None
    rows = solve_triangular(L, (jacobian / sizes).T, lower=True)
    if not numerics.is_symmetric(scaled):
        half = solve_triangular(L, 0.5 * (scaled - scaled.T), lower=True)
        N = solve_triangular(L, half.T, lower=True).T
        rows = np.linalg.solve((np.eye(len(N)) + N).T, rows)
    if len(rows) > rows.shape[1]:
        rows = _triangle(rows)
    root: Array = rows.T
    return root if np.isfinite(root).all() and root.any(axis=1).all() else None


def eigenvalues(root: Array) -> Array:
    """Of ``(G G^T)^-1`` for a root G (m, n), n >= m: (m,), the smallest first."""
    values, _ = _singular(root, vectors=False)
    return np.asarray(values**-2.0)


def eigenpairs(root: Array) -> tuple[Array, Array]:
    """`eigenvalues` with their eigenvectors in columns (m, m)."""
    values, vectors = _singular(root, vectors=True)
    with np.errstate(divide="ignore"):
        return values**-2.0, vectors


def extremes(root: Array, lengths: Array) -> Array:
    """Least and largest of the `eigenvalues` (k, 2), angles multiplied by each of k lengths.

    Both are norms, of G and of its inverse, and need no care.
    """
    scale = np.repeat(np.column_stack([lengths, np.ones(len(lengths))]), 3, axis=1)
    largest = np.linalg.norm(root * scale[:, :, None], 2, axis=(1, 2))
    inverse = np.linalg.norm(np.linalg.inv(root) / scale[:, None, :], 2, axis=(1, 2))
    return np.column_stack([largest**-2.0, inverse**2.0])


def held(root: Array, keep: slice) -> Array:
    """Root of the inverse of a block of the stiffness: three freedoms, the others held.

    With ``G^T = [A, B]`` and ``A = Q R`` for the others, K_bb^-1 is what of B^T B is left at right
    angles to A.
    """
    from scipy.linalg.lapack import dgeqp3, dormqr

    rows = _sorted(root.T)
    others = np.delete(np.arange(len(root)), np.arange(len(root))[keep])
    m = len(others)
    factors, _, tau, _, _ = dgeqp3(np.asfortranarray(rows[:, others]))
    turned, _, _ = dormqr("L", "T", factors, tau, np.asfortranarray(rows[:, keep]), 64 * m)
    left: Array = turned[m:].T
    return left


def _singular(root: Array, vectors: bool) -> tuple[Array, Array]:
    """Singular values of a root, the largest first, and its left singular vectors in columns."""
    from scipy.linalg.lapack import dgejsv

    values, _, v, work, _, _ = dgejsv(
        _sorted(root.T),
        joba=_GRADED,
        jobu=_NO_VECTORS,
        jobv=_VECTORS if vectors else _NO_VECTORS,
        jobr=_WHOLE_RANGE,
        jobp=_NOTHING_SMALL,
    )
    with np.errstate(divide="ignore"):
        return values * (work[0] / work[1]), v


def _sorted(rows: Array) -> Array:
    """The rows, the largest first: what is reflected then mixes no small row into a large one."""
    return np.asarray(rows[np.argsort(-np.abs(rows).max(axis=1), kind="stable")])


def _triangle(rows: Array) -> Array:
    """R (n, n) of ``Q R = rows`` (m, n), its rows graded as those are."""
    from scipy.linalg import qr

    r, order = qr(_sorted(rows), mode="r", pivoting=True)
    triangle = np.empty((rows.shape[1], rows.shape[1]))
    triangle[:, order] = r[: rows.shape[1]]
    return triangle
