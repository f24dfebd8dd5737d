"""How a map is cut into parts, which are computed and stored one by one."""

from __future__ import annotations

from math import ceil

import numpy as np

from cartstiff.maps.sampling import Sampling

# Smallest and largest number of postures in a chunk, and how many chunks are aimed at; fewer where
# a posture takes less than what is done once for each chunk.
_LEAST, _MOST, _CHUNKS, _FEW_CHUNKS = 64, 2**18, 128, 32


def usual_chunk(count: int, least: int | None = None) -> int:
    """Postures of a chunk of so many: from 64 for small maps to 262144 for large ones.

    Where postures are quickly computed it is from `least` on.
    """
    if least is None:
        return min(max(count // _CHUNKS, _LEAST), _MOST)
    return min(max(count // _FEW_CHUNKS, least), _MOST)


def chunk_shape(sampling: Sampling, postures: int | None = None) -> tuple[int, ...]:
    """Shape of a chunk: near a cube, so that a slice in any direction touches few of them.

    `postures` is the most of a chunk; default `usual_chunk`.
    """
    postures = usual_chunk(sampling.size) if postures is None else postures
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
