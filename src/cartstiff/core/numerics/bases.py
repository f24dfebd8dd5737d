"""Bases of motions in which the stiffness of soft springs is not lost
beside stiff ones.
"""

from __future__ import annotations

from math import sqrt

import numpy as np
from numpy.typing import NDArray

from cartstiff.core.numerics.policy import RANK, Array


def stiffness_scaled_basis(
    motions: Array, stiffness: Array, across: Array | None = None
) -> tuple[Array, NDArray[np.intp]]:
    r"""Basis of given motions in which soft springs are not lost beside stiff ones.

    The stiffest coordinates that determine the motions are *leading*: each motion moves
    one of them by 1 and the others not at all; softer coordinates follow. A stiff spring
    is then in its own row and column of the stiffness matrix only. A coordinate that is
    stiffer than the leading one and moves by less than `RANK` is set to zero.

    Parameters
    ----------
    motions : ndarray, shape (n, f)
        Independent columns.
    stiffness : ndarray, shape (n,)
        Stiffness of each coordinate, not negative.
    across : ndarray, shape (n, n - f), optional
        Independent columns orthogonal to the motions; with them the cost depends on the
        lesser of f and n - f.

    Returns
    -------
    basis : ndarray, shape (n, f)
    leading : ndarray of int, shape (f,)
        The leading coordinates; ``basis[leading]`` is the identity.
    """
    n, f = motions.shape
    if f == 0:
        return motions, np.empty(0, np.intp)
    # Coordinates without a spring are the last choice.
    known = stiffness.tolist()
    softest = min((k for k in known if k > 0.0), default=1e300)
    weights = np.sqrt([k if k > 0.0 else 1e-4 * softest for k in known])
    if across is None or f <= n - f:
        leading = first_independent(motions.T * weights)
    else:
        leading = np.delete(np.arange(n), first_independent(across.T / weights))
    basis = motions @ np.linalg.inv(motions[leading])
    size = np.abs(basis)
    basis[
        (size <= RANK * size.max(axis=0)) & (stiffness[:, None] > stiffness[leading])
    ] = 0.0
    basis[leading] = np.eye(f)
    return basis, leading


def first_independent(columns: Array) -> NDArray[np.intp]:
    """Indices (m,) of independent columns of a matrix (m, n) of rank m,
    the largest first.
    """
    m = len(columns)
    chosen = np.empty(m, np.intp)
    size = np.einsum("ij,ij->j", columns, columns)
    least = RANK**2 * size
    for i in range(m):
        chosen[i] = at = int(size.argmax())
        direction = columns[:, at]
        direction = direction / sqrt(direction.dot(direction))
        columns = columns - direction[:, None] * direction.dot(columns)
        size = np.einsum("ij,ij->j", columns, columns)
        size[size <= least] = 0.0
        size[chosen[: i + 1]] = -1.0
    return chosen
