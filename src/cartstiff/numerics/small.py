"""Inverses, singular values and eigenvalues of small matrices, by NumPy's inner routines.

`numpy.linalg` looks at types and shapes for longer than LAPACK works on six rows. The digits are
the same; where NumPy keeps its routines elsewhere its public functions are taken.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from cartstiff.numerics.policy import TINY, Array


def _routine(name: str) -> Any:
    return getattr(getattr(np.linalg, "_umath_linalg", None), name, None)


_INVERT, _SINGULAR_VALUES, _SOLVE = _routine("inv"), _routine("svd"), _routine("solve1")
_DECOMPOSE, _EIGENVALUES, _EIGENVECTORS = map(_routine, ("svd_f", "eigvalsh_lo", "eigh_lo"))
_REFLECT, _COLUMNS = _routine("qr_r_raw"), _routine("qr_reduced")


def inverted(matrices: Array, regular: bool = False) -> Array:
    """Inverses of square matrices (..., n, n) of doubles; NaN for one with a pivot of zero.

    With `regular` it is known that there is none, and nobody need watch for it.
    """
    if _INVERT is None:
        return _inverted(matrices)
    if regular:
        return np.asarray(_INVERT(matrices))
    with np.errstate(all="ignore"):
        return np.asarray(_INVERT(matrices))


def singular_directions(matrix: Array) -> tuple[Array, Array]:
    """`singular_values` and the rows V^T (n, n) of the decomposition of a matrix (m, n)."""
    _, values, directions = (np.linalg.svd if _DECOMPOSE is None else _DECOMPOSE)(matrix)
    return values, directions


def solved(matrix: Array, right: Array) -> Array:
    """The x (n,) with ``matrix @ x == right``, of doubles, for a matrix known to be regular."""
    return np.asarray((np.linalg.solve if _SOLVE is None else _SOLVE)(matrix, right))


def singular_values(matrix: Array) -> Array:
    """Singular values of a matrix (m, n) of doubles, the largest first."""
    if _SINGULAR_VALUES is None or not matrix.size:
        return np.asarray(np.linalg.svd(matrix, compute_uv=False), float)
    return np.asarray(_SINGULAR_VALUES(matrix))


def ratios(matrices: Array) -> Array:
    """Smallest over largest singular value of each matrix of a stack; 0 where all vanish."""
    values = np.linalg.svd(matrices, compute_uv=False)
    return np.asarray(values[..., -1] / np.maximum(values[..., 0], TINY))


def determinants(matrices: Array) -> Array:
    """Of matrices (..., n, n); NumPy warns of those that are singular to the last digit."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.linalg.det(matrices))


def symmetric_values(matrix: Array) -> Array:
    """Eigenvalues of a symmetric matrix (n, n) of finite doubles, the smallest first."""
    return np.asarray((np.linalg.eigvalsh if _EIGENVALUES is None else _EIGENVALUES)(matrix))


def symmetric_vectors(matrix: Array) -> tuple[Array, Array]:
    """`symmetric_values` and the eigenvectors in columns (n, n)."""
    values, vectors = (np.linalg.eigh if _EIGENVECTORS is None else _EIGENVECTORS)(matrix)
    return values, vectors


def right_angled(columns: Array) -> Array:
    """Columns (n, n) at right angles and of length one, each next to the one that it is made of.

    The first keeps its direction, the others give way to those before them.
    """
    if _REFLECT is None or _COLUMNS is None:
        q, r = np.linalg.qr(columns)
    else:
        r = columns.copy()
        q = _COLUMNS(r, _REFLECT(r))
    return np.asarray(np.where(r.diagonal() < 0.0, -q, q))


def _inverted(matrices: Array) -> Array:
    """`inverted` by what NumPy shows, for which one singular matrix of a stack is an error."""
    inverses = np.full(matrices.shape, np.nan)
    for at in np.ndindex(matrices.shape[:-2]):
        try:
            inverses[at] = np.linalg.inv(matrices[at])
        except np.linalg.LinAlgError:
            continue
    return inverses
