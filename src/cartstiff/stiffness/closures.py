r"""Closures at one posture: their rank, and what its loss means.

Where rank is lost they are repeated, branching, or blocked to second order.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cartstiff import numerics
from cartstiff.geometry.se3 import Array
from cartstiff.notes import Note
from cartstiff.potentials.contract import SecondOrderMap

#: Forms below this share of the largest vanish: they are sums of products of closures that are met
#: to about 1e-14, and of motions found from these.
_VANISHING = numerics.VANISHING


class Closures(NamedTuple):
    """Singular value decomposition of the scaled closure Jacobian, split at its rank."""

    values: Array
    rank: int
    #: Covectors (m, r) and (m, m - r) of what is closed and what is not; motions (n, r) that break
    #: the closures, and (n, f) that do not.
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
    """Decompose the Jacobian of closures, over their sizes and in natural sizes of coordinates."""
    matrix = closure.jacobian * columns
    return decompose(matrix if closure.sizes is None else matrix / closure.sizes[:, None])


def decompose(matrix: Array) -> Closures:
    """Decompose the scaled Jacobian (m, n) of closures."""
    U, values, Vt = np.linalg.svd(matrix)
    r = numerics.rank(values)
    return Closures(values, r, U[:, :r], U[:, r:], Vt[:r].T, Vt[r:].T)


def irregular(
    closure: SecondOrderMap, values: Array, rank: int, lost: Array, N: Array, columns: Array
) -> Note | None:
    """Name closures whose lost rank matters; None for redundant ones that are harmless.

    Along each covector nu with nu C = 0 the residual grows like the form x nu c'' x of the free
    motions x. Where all forms vanish the closures are merely repeated. Where they share a real
    root, branches of motion leave along it; where they share none, what is free to first order is
    blocked to second.

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
    forms = [N.T @ (curvature * columns[:, None] * columns) @ N for curvature in curvatures]
    size = max(float(np.abs(form).max(initial=0.0)) for form in forms)
    if size <= _VANISHING * max(1.0, float(values.max(initial=0.0))):
        return None
    forms = [form for form in forms if np.abs(form).max() > _VANISHING * size]
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
                    np.sqrt(eigenvalues[-1]) * low + sign * np.sqrt(-eigenvalues[0]) * high
                )
    for x in starts:
        x = x / np.linalg.norm(x)
        for _ in range(30):
            images = forms @ x
            residual = images @ x
            if np.abs(residual).max() < numerics.CLOSE:
                return x
            x = x - np.linalg.lstsq(2 * images, residual, rcond=numerics.ROUNDING)[0]
            x = x / max(float(np.linalg.norm(x)), numerics.TINY)
    return None
