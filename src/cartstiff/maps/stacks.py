r"""Stacks (N, 6, 6) of stiffness or compliance matrices, read all at once.

Each function equals, row by row, the function of `cartstiff.analysis` that it names. Rows with a
NaN give NaN.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from cartstiff import numerics
from cartstiff.analysis import matrices
from cartstiff.errors import UndefinedError
from cartstiff.geometry.se3 import Array

__all__ = [
    "block_norms",
    "condition",
    "determinant",
    "free_values",
    "isotropy",
    "on_finite",
    "principal",
    "scale_lengths",
    "signs",
    "symmetric_part",
]


def on_finite(function: Callable[..., Array], *stacks: Array, shape: tuple[int, ...] = ()) -> Array:
    """Apply a function of stacks to the rows in which all are finite; NaN (N, *shape) elsewhere."""
    finite = np.ones(len(stacks[0]), bool)
    for stack in stacks:
        finite &= np.isfinite(stack).all(axis=tuple(range(1, stack.ndim)))
    if finite.all():
        return function(*stacks)
    result = np.full((len(finite), *shape), np.nan)
    if finite.any():
        result[finite] = function(*(stack[finite] for stack in stacks))
    return result


def symmetric_part(stack: Array) -> Array:
    """Half the sum of each matrix and its transpose."""
    half: Array = 0.5 * (stack + stack.swapaxes(-1, -2))
    return half


def scale_lengths(stack: Array, length: float | Array) -> Array:
    """As `cartstiff.analysis.matrices.scale_lengths`; one length, or one a row."""
    scale = np.ones((*np.shape(length), 6))
    scale[..., :3] = 1.0 / np.asarray(length, float)[..., None]
    scaled: Array = stack * scale[..., :, None] * scale[..., None, :]
    return scaled


def block_norms(stack: Array) -> tuple[Array, Array]:
    """Frobenius norms of the rotation and translation blocks."""
    rr = np.sqrt(np.einsum("nij,nij->n", stack[:, :3, :3], stack[:, :3, :3]))
    tt = np.sqrt(np.einsum("nij,nij->n", stack[:, 3:, 3:], stack[:, 3:, 3:]))
    return rr, tt


def principal(blocks: Array) -> Array:
    """Eigenvalues (N, 3) of the symmetric parts of 3x3 blocks, smallest first, with their signs."""
    return on_finite(lambda m: np.linalg.eigvalsh(symmetric_part(m)), blocks, shape=(3,))


def free_values(stack: Array, inverse: Array, keep: slice) -> Array:
    """Eigenvalues (N, 3) of `cartstiff.analysis.matrices.eliminate`: the other freedoms are free.

    Where the inverse of the matrix exists they are the inverses of its block's eigenvalues, which
    keeps digits that the elimination loses near singular postures.

    Parameters
    ----------
    stack : ndarray, shape (N, 6, 6)
        Stiffness (or compliance).
    inverse : ndarray, shape (N, 6, 6)
        Its inverses, NaN where there is none.
    keep : slice
        `ROTATION` or `TRANSLATION` of `cartstiff.analysis.matrices`.
    """
    block = inverse[:, keep, keep]
    with np.errstate(divide="ignore", invalid="ignore"):
        found = np.sort(1.0 / principal(block), axis=1)
    exists = np.isfinite(stack).all(axis=(1, 2))
    found[~exists] = np.nan
    indices = list(range(keep.start, keep.stop))
    for i in np.flatnonzero(exists & ~np.isfinite(found).all(axis=1)):
        try:
            free = matrices.eliminate(stack[i], indices)
        except (UndefinedError, np.linalg.LinAlgError):
            continue
        found[i] = np.linalg.eigvalsh(0.5 * (free + free.T))
    return found


def determinant(stack: Array) -> Array:
    """Determinants (N,)."""
    return on_finite(np.linalg.det, stack)


def signs(eigenvalues: Array) -> tuple[Array, Array, Array]:
    """How many eigenvalues count as negative, zero and positive, by the rule of `definiteness`."""
    zero = numerics.ZERO * np.abs(eigenvalues).max(axis=-1, keepdims=True)
    below, above = (eigenvalues < -zero).sum(axis=-1), (eigenvalues > zero).sum(axis=-1)
    return below, eigenvalues.shape[-1] - below - above, above


def condition(eigenvalues: Array) -> Array:
    """Largest over smallest absolute eigenvalue; infinite for a singular matrix."""
    size = np.abs(eigenvalues)
    high, low = size.max(axis=-1), size.min(axis=-1)
    with np.errstate(divide="ignore", invalid="ignore"):
        found = np.where(low > numerics.ZERO * high, high / low, np.inf)
    return np.where(np.isfinite(high), found, np.nan)


def isotropy(eigenvalues: Array) -> Array:
    """As `cartstiff.analysis.indices.isotropy`, from the eigenvalues."""
    below, null, above = signs(eigenvalues)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.exp(np.log(eigenvalues).mean(axis=-1)) / eigenvalues.mean(axis=-1)
    ratio = np.where((below == 0) & (null > 0) & (above > 0), 0.0, ratio)
    return np.where((below > 0) | (above == 0), np.nan, ratio)
