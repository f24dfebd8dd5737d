"""Notes on preload and rest positions: which hold at a posture,
and which a load replaces.

The drives of a platform wind its legs: at every commanded posture these have their
preload. A rest length or rest position is a fixed number. A load that has to be balanced
at a posture decides on the forces of all springs instead, except where more lines than
motions leave a choice.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import compress

import numpy as np

from cartstiff.core.arrays import Array
from cartstiff.core.mechanisms.elastic import ElasticMechanism
from cartstiff.core.notes import Note
from cartstiff.core.potentials.springs import Springs
from cartstiff.core.units import engineering


def preload_notes(elastic: ElasticMechanism, is_loaded: bool) -> list[Note]:
    """Note on the preload that drives hold, or on what a load replaces.

    Parameters
    ----------
    elastic : ElasticMechanism
        The mechanism as given, before rest positions are chosen.
    is_loaded : bool
        Whether rest positions are chosen so that the springs balance a given wrench.
    """
    springs = elastic.springs
    if springs is None:
        return []
    held = springs.holding()
    if is_loaded:
        return _replacements(elastic.spring_names, springs, held)
    if not held.any() or springs.preload is None:
        return []
    names = list(compress(elastic.spring_names, held))
    tensions = springs.preload[held].tolist()
    if not any(tensions):
        return []
    unit, low, high = elastic.units.force, min(tensions), max(tensions)
    sizes = engineering(low, unit) if low == high else f"{low:g} to {high:g} {unit}"
    words = (
        "the drives hold the preload of the file at every commanded pose "
        f"({_listed(names)}: {sizes}); the legs cannot balance it among themselves, so "
        "that the environment holds it with the wrench that is stated"
    )
    return [
        Note("preload-held", words, {"preload": dict(zip(names, tensions, strict=True))})
    ]


def _replacements(names: Sequence[str], springs: Springs, held: Array) -> list[Note]:
    """Note on the forces or rest positions that a given load replaces."""
    is_fixed = springs.rest_is_free(every=True) & ~springs.rest_is_free()
    if isinstance(springs.driven, tuple):  # springs that nothing drives keep theirs
        is_fixed &= np.array(springs.driven)
    rest, whose = springs.rest_words
    for what, own in (("preload", held), (rest, is_fixed)):
        replaced = list(compress(names, own))
        if replaced and springs.is_redundant:
            return [_shifted(replaced)]
        if replaced:
            return [_replaced(what, replaced, whose)]
    return []


def _replaced(what: str, names: list[str], whose: str) -> Note:
    words = (
        f"the load alone determines the forces of {whose}, and replaces the {what} of "
        f"{_listed(names)}; `equilibrium` keeps them and moves the body"
    )
    return Note("load-replaces-rest", words, {"replaced": what, "springs": names})


def _shifted(names: list[str]) -> Note:
    words = (
        f"the drives change the rest lengths of {_listed(names)} as little as balances "
        "the load: of all sets of forces these are the nearest to those of the given "
        "lengths; `equilibrium` keeps the lengths and moves the body"
    )
    return Note(
        "load-replaces-rest", words, {"replaced": "rest lengths", "springs": names}
    )


def _listed(names: list[str]) -> str:
    return ", ".join(names) if len(names) < 4 else f"{names[0]} to {names[-1]}"
