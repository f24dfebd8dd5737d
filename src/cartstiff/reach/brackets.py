"""Where along many ways at once something ends: brackets are divided until they are narrow."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from cartstiff.geometry.se3 import Array

# A call with few poses costs as much as one with so many: few brackets are cut into more parts.
_AT_ONCE, _MOST = 512, 4


def narrowed(
    stays: Callable[[NDArray[np.intp], Array], NDArray[np.bool_]],
    near: Array,
    far: Array,
    halvings: int,
) -> tuple[Array, Array, int]:
    """Brackets (N,) as narrow as after `halvings` bisections, around where `stays` first fails.

    Parameters
    ----------
    stays : callable
        Given the numbers (K,) of brackets and places (K,) in them: which are as at `near`.
    near, far : ndarray (N,)
        Ends of the brackets.
    halvings : int
        The brackets shrink by 2^halvings. Each call of `stays` makes up for one to four of them.

    Returns
    -------
    near, far : ndarray (N,)
        Neighbouring places: as at `near` and not.
    tried : int
        Places that `stays` was asked about.
    """
    tried = 0
    while halvings > 0 and len(near):
        at_once = min(_MOST, halvings, max(1, int(np.log2(_AT_ONCE / len(near) + 1.0))))
        shares = np.linspace(0.0, 1.0, 2**at_once + 1)
        places = near[:, None] + shares * (far - near)[:, None]
        places[:, -1] = far
        rows = np.repeat(np.arange(len(near)), len(shares) - 2)
        inner = stays(rows, places[:, 1:-1].ravel()).reshape(len(near), -1)
        k = np.where(inner.all(axis=1), inner.shape[1], np.argmin(inner, axis=1))
        near, far = np.take_along_axis(places, np.stack([k, k + 1], 1), 1).T
        halvings, tried = halvings - at_once, tried + len(rows)
    return near, far, tried
