r"""Intervals that measured springs leave of the numbers of many postures.

Posture and load stay, rest positions follow, as in `cartstiff.analysis.tolerances`; the whole
covariance counts, to first order (`cartstiff.mechanisms.identified.neighbours`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from cartstiff.geometry.se3 import Array
from cartstiff.maps.quantity import Quantity
from cartstiff.mechanisms.elastic import ElasticMechanism
from cartstiff.mechanisms.identified import neighbours
from cartstiff.notes import Note


def half_width_name(name: str) -> str:
    """Name of the array that holds the half width of a quantity's interval."""
    return f"{name}_half_width"


def intervals_of(elastic: ElasticMechanism, quantities: Sequence[Quantity]) -> tuple[Quantity, ...]:
    """The quantities with an interval: those that springs decide, where these were measured."""
    if elastic.identified is None:
        return ()
    return tuple(q for q in quantities if q.is_elastic and "." not in q.name)


def why_none(elastic: ElasticMechanism, is_loaded: bool) -> Note | None:
    """Why there are no intervals though springs were measured; None where there are.

    Springs whose rest positions the file gives carry other forces when they are softer; only where
    a load is given, and they follow it, do the forces stay.
    """
    if elastic.identified is None or is_loaded or elastic.springs is None:
        return None
    has_spring = elastic.springs.stiffness > 0.0
    if not np.any(
        ~np.isnan(elastic.springs.rest) & has_spring & np.isfinite(elastic.springs.stiffness)
    ):
        return None
    words = (
        "no intervals here: the file gives rest positions, so that forces would change with the "
        "springs; with a load, or without 'rest', there are"
    )
    return Note("no-intervals", words)


def half_widths(
    elastic: ElasticMechanism,
    evaluate: Callable[[ElasticMechanism], Mapping[str, Array]],
    names: Sequence[str],
) -> dict[str, Array]:
    """Half widths (N,) of intervals by name.

    Parameters
    ----------
    elastic : ElasticMechanism
        With measured springs.
    evaluate : callable
        Numbers (N,) by name of a mechanism with other springs, at the same postures and loads.
    names : sequence of str
        Those wanted. What is not a number on both sides is NaN.
    """
    known = elastic.identified
    if known is None:
        return {}
    variance: dict[str, Array | float] = dict.fromkeys(names, 0.0)
    for more, less, per in neighbours(elastic):
        upper, lower = evaluate(more), evaluate(less)
        for name in names:
            variance[name] = variance[name] + (per * (upper[name] - lower[name])) ** 2
    return {name: known.factor * np.sqrt(v) for name, v in variance.items()}
