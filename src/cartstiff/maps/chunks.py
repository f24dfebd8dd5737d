"""How a map is cut into chunks."""

from __future__ import annotations

from math import ceil

import numpy as np

from cartstiff.maps.sampling import Sampling

__all__ = ["chunk_shape"]

# Smallest and largest number of postures in a chunk, and how many chunks are aimed at.
_LEAST, _MOST, _CHUNKS = 64, 2**18, 128


def chunk_shape(sampling: Sampling, postures: int | None = None) -> tuple[int, ...]:
    """Shape of a chunk: near a cube, so that a slice in any direction touches few of them.

    Parameters
    ----------
    sampling : Sampling
        Its shape is cut.
    postures : int, optional
        Most postures of a chunk; default from 64 for small maps to 262144 for large ones.
    """
    if postures is None:
        postures = min(max(sampling.size // _CHUNKS, _LEAST), _MOST)
    shape = list(sampling.shape)
    if len(shape) == 1:
        return (min(shape[0], postures),)
    may_split = [i for i, name in enumerate(sampling.dims) if name not in sampling.whole]
    while int(np.prod(shape, dtype=object)) > postures:
        i = max(may_split, key=lambda i: shape[i])
        if shape[i] == 1:
            break
        shape[i] = ceil(shape[i] / 2)
    return tuple(shape)
