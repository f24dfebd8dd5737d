r"""Loop closures at one posture: their rank, and the state where it is lost.

The closures are then redundant, or motions bifurcate, or are blocked to second order.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cartstiff import numerics
from cartstiff.geometry.se3 import Array
from cartstiff.notes import Note
from cartstiff.potentials.contract import SecondOrderMap


class Closures(NamedTuple):
    """Singular value decomposition of the scaled closure Jacobian, split at its rank."""

    values: Array
    rank: int
    #: Covectors (m, r) of the range and (m, m - r) of its complement; motions (n, r) that violate
    #: the closures, and (n, f) that keep them.
    U: Array
    lost: Array
    V: Array
    N: Array

    def forces(self, right: Array, where: list[int]) -> Array:
        """Multipliers of least norm with ``C^T lam = right`` in the chosen coordinates."""
        if not any(right.tolist()):
            return np.zeros(len(self.U))
        share = (self.V * self.values[: self.rank])[where]
        lam: Array = self.U @ np.linalg.lstsq(share, right[where], rcond=numerics.RANK)[0]
        return lam


def decomposed(closure: SecondOrderMap, columns: Array) -> Closures:
    """Decompose the Jacobian of closures, in natural sizes of closures and coordinates."""
    matrix = closure.jacobian * columns
    return decompose(matrix if closure.sizes is None else matrix / closure.sizes[:, None])


def decompose(matrix: Array) -> Closures:
    """Decompose the scaled Jacobian (m, n) of closures."""
    U, values, Vt = np.linalg.svd(matrix)
    r = numerics.rank(values)
    return Closures(values, r, U[:, :r], U[:, r:], Vt[:r].T, Vt[r:].T)


def irregular(
    closure: SecondOrderMap,
    values: Array,
    rank: int,
    lost: Array,
    N: Array,
    columns: Array,
) -> Note | None:
    """State of closures that have lost rank; None if they are merely redundant.

    Along each covector nu with nu C = 0 the residual grows like the form x nu c'' x of the free
    motions x. If all forms vanish, the closures are redundant. If they have a common real root,
    motions bifurcate along it; if they have none, motions that are free to first order are blocked
    to second order.

    Parameters
    ----------
    closure : SecondOrderMap
        Jacobian (m, n) with curvature.
    values : ndarray
        Singular values of the scaled Jacobian.
    rank : int
        How many of them are not zero.
    lost : ndarray, shape (m, m - rank)
        Covectors nu.
    N : ndarray, shape (n, f)
        Free motions in scaled coordinates.
    columns : ndarray, shape (n,)
        Scales of the coordinates.
    """
    curvatures = (closure.curvature(nu) for nu in lost.T)
    forms = [
        N.T @ (curvature * columns[:, None] * columns) @ N for curvature in curvatures
    ]
    size = max(float(np.abs(form).max(initial=0.0)) for form in forms)
    if size <= numerics.VANISHING_FORM * max(1.0, float(values.max(initial=0.0))):
        return None
    forms = [
        form for form in forms if np.abs(form).max() > numerics.VANISHING_FORM * size
    ]
    root = _common_root(np.array(forms) / size)
    numbers: dict[str, object] = {
        "rank": rank,
        "singular_values": values.tolist(),
        "second_order": [np.linalg.eigvalsh(form).tolist() for form in forms],
        "motions": (columns[:, None] * N).T.tolist(),
    }
    if root is not None:
        return Note(
            "constraint-singularity",
            "the closures lose rank here and branches of motion meet: the energy has no second "
            "derivative along them",
            {**numbers, "branch": (columns * (N @ root)).tolist()},
        )
    return Note(
        "non-regular-redundancy",
        "the closures lose rank here and block to second order what is free to first order: the "
        "mechanism is shaky, and its closure forces are not determined",
        numbers,
    )


def _common_root(forms: Array) -> Array | None:
    """Unit vector on which all quadratic forms (k, f, f) vanish, or None if none is found.

    Gauss-Newton on the sphere from the forms' own roots and a fixed set of directions.
    """
    n = forms.shape[1]
    starts = [*np.eye(n), *np.random.default_rng(0).normal(size=(20 * n, n))]
    for form in forms:
        eigenvalues, vectors = np.linalg.eigh(form)
        low, high = vectors[:, 0], vectors[:, -1]
        if eigenvalues[0] < 0 < eigenvalues[-1]:
            for sign in (1.0, -1.0):
                starts.append(
                    np.sqrt(eigenvalues[-1]) * low
                    + sign * np.sqrt(-eigenvalues[0]) * high
                )
    for x in starts:
        x = x / np.linalg.norm(x)
        for _ in range(30):
            images = forms @ x
            residual = images @ x
            if np.abs(residual).max() < numerics.NEGLIGIBLE_DIFFERENCE:
                return x
            x = x - np.linalg.lstsq(2 * images, residual, rcond=numerics.ROUNDOFF)[0]
            x = x / max(float(np.linalg.norm(x)), numerics.TINY)
    return None
