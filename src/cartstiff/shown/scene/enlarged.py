"""How much a deflection is enlarged where it is drawn, and the posture that far away."""

from __future__ import annotations

from math import inf

from cartstiff.core import numerics
from cartstiff.core.arrays import Array
from cartstiff.core.errors import CartstiffError
from cartstiff.core.mechanisms.contract import Mechanism, MechanismPosture
from cartstiff.shown.scene.scales import round_number

#: Share of a mechanism's size by which a point is drawn away from where it rests: about a
#: tenth, as the factor is rounded down.
SHOWN = 0.14
#: Largest turn (rad) of a joint, or of a body, that is drawn.
TURN = 0.5
#: Both, at most, of a factor that was chosen.
MOST_SHOWN, MOST_TURN = 0.5, 1.2


def factor_for(
    moved: float, turned: float, size: float, wanted: float | None = None
) -> float | None:
    """The factor by which a motion is drawn; None where nothing moves.

    Parameters
    ----------
    moved : float
        How far a point moves.
    turned : float
        The largest turn of a joint or body (rad).
    size : float
        Size of the mechanism.
    wanted : float, optional
        A chosen factor, which is taken as far as the motion then can be drawn; default a
        round one that makes the motion about a tenth of the size.
    """
    far, round_ = (SHOWN, TURN) if wanted is None else (MOST_SHOWN, MOST_TURN)
    if not (moved > numerics.ROUNDOFF * size or turned > numerics.ROUNDOFF):
        return None
    limits = (far * size, moved), (round_, turned)
    most = min(limit / x if x > 0.0 else inf for limit, x in limits)
    return round_number(most) if wanted is None else min(wanted, most)


def turned_by(mechanism: Mechanism, step: Array, lengths: Array) -> float:
    """The largest turn in a step of the coordinates of the derivatives; lengths count
    over `lengths`.
    """
    if mechanism.coordinates_are_pose:
        return numerics.norm(step[:3])
    return numerics.largest(step / lengths)


def posture_after(mechanism: Mechanism, q: Array, step: Array) -> MechanismPosture | None:
    """The posture a step away, assembled; None where it cannot be."""
    there = mechanism.displaced(q, step)
    if not mechanism.closures:
        return mechanism.at(there)
    try:
        return mechanism.closed(there)
    except CartstiffError:
        return None
