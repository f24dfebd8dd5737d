"""Vectors and rotations in as many digits as mpmath works with."""

from __future__ import annotations

from typing import Any

import mpmath as mp
import numpy as np


def matrix(values: Any) -> Any:
    """Numbers in double precision as they are: a column, or a matrix."""
    return mp.matrix(np.asarray(values, float).tolist())


def skew(a: Any) -> Any:
    """Matrix of the cross product."""
    return mp.matrix([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])


def turned(w: Any) -> Any:
    """Rotation by a vector, by Rodrigues' formula."""
    angle = mp.sqrt(sum(x * x for x in w))
    if angle == 0:
        return mp.eye(3)
    W = skew(w) / angle
    return mp.eye(3) + mp.sin(angle) * W + (1 - mp.cos(angle)) * W * W
