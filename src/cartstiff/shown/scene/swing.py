"""The swing of a mode as a step of the coordinates, of which a picture draws a share."""

from __future__ import annotations

import numpy as np

from cartstiff.answer.vibration.modes import Modes
from cartstiff.core import numerics
from cartstiff.core.arrays import Array
from cartstiff.shown.scene.mechanism import extent

# Step (natural units) by which points move a little.
_STEP = numerics.WIDE_DIFFERENCE_STEP


def swing_of(modes: Modes, number: int) -> tuple[Array, float]:
    """A step along a mode, and how far the point that moves most goes in it.

    A mode has no size of its own: in the step the coordinate that moves most, in natural
    units (a radian, or the characteristic length), moves by one.

    Parameters
    ----------
    modes : Modes
        The modes.
    number : int
        Number of the mode, from 1.
    """
    shape = modes.shapes[:, number - 1].real / modes._sizes
    step = modes._sizes * shape / max(float(np.abs(shape).max()), numerics.EPSILON)
    mechanism, elastic = modes.elastic.mechanism, modes.elastic
    rest = extent(elastic, modes.posture)
    a_little = extent(elastic, mechanism.at(mechanism.displaced(modes.q, _STEP * step)))
    return step, float(np.linalg.norm(a_little - rest, axis=1).max()) / _STEP
