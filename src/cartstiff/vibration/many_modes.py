"""Frequencies of many postures: over arrays for arms that springs alone hold, else one by one."""

from __future__ import annotations

from typing import Any

import numpy as np

from cartstiff.errors import CartstiffError
from cartstiff.geometry.se3 import Array
from cartstiff.mechanisms.chain import Chain
from cartstiff.mechanisms.elastic import ElasticMechanism
from cartstiff.potentials.springs import JointSprings
from cartstiff.vibration.modes import is_plain, modes

__all__ = ["frequencies_of_many"]

# Postures at once: their matrices stay in the cache.
_ROWS = 2048


def frequencies_of_many(
    elastic: ElasticMechanism,
    q: Array,
    count: int = 6,
    wrenches: Array | None = None,
    **load: Any,
) -> Array:
    """The lowest frequencies [Hz] of many postures.

    Parameters
    ----------
    elastic : ElasticMechanism
        The mechanism.
    q : ndarray (N, n)
        Postures; closures are met.
    count : int
        How many frequencies.
    wrenches : ndarray (6,) or (N, 6), optional
        Load, as in `cartstiff.modes`.
    **load
        `load_kind`, `load_at`, `load_axes` of it.

    Returns
    -------
    ndarray (N, count)
        NaN where a motion grows, where a posture has no modes, and beyond the last mode.
    """
    loaded = wrenches is not None and bool(np.any(wrenches))
    if not loaded and is_plain(elastic):
        return _plain(elastic, q, count)
    found = np.full((len(q), count), np.nan)
    for i, posture in enumerate(q):
        wrench = None
        if loaded and wrenches is not None:
            wrench = wrenches if wrenches.ndim == 1 else wrenches[i]
        try:
            hertz = modes(elastic, posture, wrench=wrench, **load).frequencies[:count]
        except CartstiffError:
            continue
        found[i, : hertz.size] = hertz
    return found


def _plain(elastic: ElasticMechanism, q: Array, count: int) -> Array:
    """``k phi = omega^2 M phi`` over arrays, by ``1/omega^2`` of ``k^-1/2 M k^-1/2``."""
    springs, chain = elastic.springs, elastic.mechanism
    if not (isinstance(springs, JointSprings) and isinstance(chain, Chain)):
        raise TypeError("an arm on joint springs")
    n = q.shape[1]
    per = 1.0 / np.sqrt(springs.stiffness)
    found = np.full((len(q), max(count, n)), np.nan)
    for start in range(0, len(q), _ROWS):
        part = q[start : start + _ROWS]
        mass = chain.tree.mass_matrices(part)
        inverse = np.linalg.eigvalsh(mass * np.outer(per, per), UPLO="U")[:, ::-1]
        # Motions without mass stand last, and have no frequency.
        least = np.finfo(float).eps * n * inverse[:, :1]
        with np.errstate(divide="ignore", invalid="ignore"):
            hertz = 1.0 / (2 * np.pi * np.sqrt(inverse))
        found[start : start + len(part), :n] = np.where(inverse > least, hertz, np.nan)
    return found[:, :count]
