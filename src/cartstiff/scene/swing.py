"""Postures along the swing of a mode, for playback, with a chosen amplitude."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cartstiff import numerics
from cartstiff.errors import CartstiffError, InputError
from cartstiff.geometry import se3
from cartstiff.mechanisms.contract import MechanismPosture
from cartstiff.scene.mechanism import extent
from cartstiff.vibration.modes import Modes

# Largest turn (rad) of a joint that is drawn, and the step (natural units) of the first
# guess.
_TURN, _STEP = 0.5, numerics.WIDE_DIFFERENCE_STEP


@dataclass(frozen=True, eq=False)
class Swing:
    """Postures of one mode from one end of its swing to the other.

    Attributes
    ----------
    postures : tuple of MechanismPosture
        At equal steps of the mode's coordinate, the rest in the middle.
    displacement : float
        How far the origin of M goes to either side, in the mechanism's unit of length.
    turn : float
        How far the body turns to either side, in rad.
    """

    postures: tuple[MechanismPosture, ...]
    displacement: float
    turn: float


def swing_of(modes: Modes, number: int, share: float = 0.05, count: int = 17) -> Swing:
    """Postures along the swing of a mode.

    Parameters
    ----------
    modes : Modes
        The modes.
    number : int
        Number of the mode, from 1.
    share : float
        Amplitude of the point that moves most, over the mechanism's size (a mode has no
        amplitude of its own); no joint turns by more than half a radian.
    count : int
        How many postures; made odd.

    Raises
    ------
    InputError
        For a mode that does not exist, or a share that is not above zero.
    """
    total = modes.shapes.shape[1]
    if not 1 <= number <= total:
        raise InputError("no such mode", expected=f"1 to {total}", got=number)
    if not share > 0.0:
        raise InputError("share cannot be used", expected="above zero", got=share)
    shape = modes.shapes[:, number - 1].real / modes._sizes
    shape = modes._sizes * shape / max(float(np.abs(shape).max()), numerics.EPSILON)
    mechanism, q, elastic = modes.elastic.mechanism, modes.q, modes.elastic
    rest = extent(elastic, modes.posture)
    size = float(np.ptp(rest, axis=0).max()) or modes.posture.length
    a_little = extent(elastic, mechanism.at(mechanism.displaced(q, _STEP * shape)))
    most = float(np.linalg.norm(a_little - rest, axis=1).max()) / _STEP
    reach = _TURN if most == 0.0 else min(_TURN, share * size / most)
    postures: list[MechanismPosture] = []
    for phase in np.linspace(-1.0, 1.0, count + 1 - count % 2):
        there = mechanism.displaced(q, phase * reach * shape)
        if mechanism.closures:
            try:  # closures bend the motion
                postures.append(mechanism.closed(there))
                continue
            except CartstiffError:
                pass
        postures.append(mechanism.at(there))
    between = se3.inverse(modes.posture.pose) @ postures[-1].pose
    twist = se3.log(between)
    return Swing(
        tuple(postures),
        float(np.linalg.norm(between[:3, 3])),
        float(np.linalg.norm(twist[:3])),
    )
