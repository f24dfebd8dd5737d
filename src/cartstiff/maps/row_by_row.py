r"""Stacks (N, 6, 6) of stiffness or compliance matrices, read all at once.

Each function equals, row by row, the function of `cartstiff.analysis` that it names. Rows with a
NaN give NaN.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from cartstiff import numerics
from cartstiff.analysis.matrices import eliminate_each
from cartstiff.errors import UndefinedError
from cartstiff.geometry.se3 import Array


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
    return numerics.eigenvalues(blocks)


def eigenvalues(K: Array, C: Array, length: float | Array) -> Array:
    """Of stiffness matrices with lengths scaled (N, 6), as `cartstiff.analysis.indices`."""
    scaled = scale_lengths(K, length)
    values = numerics.eigenvalues(scaled)
    plain = np.asarray(numerics.condition(values) < numerics.PLAIN_BLOCK)
    rows = np.logical_not(plain) & np.isfinite(C).all(axis=(1, 2))
    if rows.any():
        inverse = scale_lengths(C, 1.0 / np.asarray(length))
        values[rows] = numerics.eigenvalues(scaled[rows], inverse[rows])
    values[~np.isfinite(K).all(axis=(1, 2))] = np.nan
    return values


def block_values(
    stack: Array,
    inverse: Array,
    keep: slice,
    is_held: bool,
    one: Callable[[Array, Array], Array],
) -> Array:
    """Principal values (N, 3) of a stack of matrices, the other freedoms held or free.

    Held they are those of the matrix's block, free the inverses of those of the inverse's block;
    where that block has lost digits, what one posture says; where there is no inverse, those of
    the matrix alone.

    Parameters
    ----------
    stack, inverse : ndarray, shape (N, 6, 6)
        Stiffness and compliance, or the other way round; NaN where there is none.
    keep : slice
        `ROTATION` or `TRANSLATION` of `cartstiff.analysis.matrices`.
    is_held : bool
        Whether the block is that of `stack`.
    one : callable
        Values (3,) of one matrix, and its inverse.
    """
    values = principal((stack if is_held else inverse)[:, keep, keep])
    plain = np.asarray(numerics.condition(values) < numerics.PLAIN_BLOCK)
    if not is_held:
        with np.errstate(divide="ignore", invalid="ignore"):
            values = np.sort(1.0 / values, axis=1)
    exists = np.isfinite(stack).all(axis=(1, 2))
    values[~exists] = np.nan
    known = np.atleast_1d(np.isfinite(inverse).all(axis=(1, 2)))
    for i in np.flatnonzero(exists & known & np.logical_not(plain)):
        try:
            values[i] = one(stack[i], inverse[i])
        except UndefinedError:
            values[i] = np.nan
    if (alone := exists & ~known).any():
        own = stack[alone]
        blocks = own[:, keep, keep]
        size = np.abs(blocks).max(axis=(1, 2))[:, None]
        values[alone] = principal(blocks if is_held else eliminate_each(own, keep))
        values[alone] = np.where(np.abs(values[alone]) <= numerics.ZERO * size, 0.0, values[alone])
    return values


def determinant(eigenvalues: Array, length: float) -> Array:
    """Determinants (N,) from the eigenvalues with lengths scaled."""
    product: Array = np.prod(eigenvalues, axis=-1) * length**6
    return product


def signs(eigenvalues: Array) -> tuple[Array, Array, Array]:
    """How many eigenvalues count as negative, zero and positive, by the rule of `definiteness`."""
    below, above = (eigenvalues < 0.0).sum(axis=-1), (eigenvalues > 0.0).sum(axis=-1)
    return below, eigenvalues.shape[-1] - below - above, above


def condition(eigenvalues: Array) -> Array:
    """Largest over smallest absolute eigenvalue; infinite for a singular matrix."""
    size = np.abs(eigenvalues)
    high, low = size.max(axis=-1), size.min(axis=-1)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.where(low > 0.0, high / low, np.inf)
    return np.where(np.isfinite(high), ratio, np.nan)


def isotropy(eigenvalues: Array) -> Array:
    """As `cartstiff.analysis.indices.isotropy`, from the eigenvalues."""
    below, null, above = signs(eigenvalues)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.exp(np.log(eigenvalues).mean(axis=-1)) / eigenvalues.mean(axis=-1)
    ratio = np.where((below == 0) & (null > 0) & (above > 0), 0.0, ratio)
    return np.where((below > 0) | (above == 0), np.nan, ratio)
