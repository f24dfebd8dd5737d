"""Measurements that a mechanism would give, with noise and gross errors: to try a plan out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from cartstiff.arrays import Array, checked_seed
from cartstiff.errors import InputError
from cartstiff.identify.loaded_model import model_of
from cartstiff.identify.measurements import MEASURED, POSITION, TURN, Measurements
from cartstiff.identify.unknowns import unknowns_of
from cartstiff.mechanisms.elastic import ElasticMechanism


def simulated(
    elastic: ElasticMechanism,
    settings: Measurements,
    deviations: Mapping[str, float],
    *,
    seed: int = 0,
    loaded: bool = False,
    outliers: Sequence[int] = (),
    outlier_size: float = 20.0,
    tell_deviations: bool = False,
) -> Measurements:
    """What a mechanism with these springs would show in given settings.

    Parameters
    ----------
    elastic : ElasticMechanism
        Its springs are the truth.
    settings : Measurements
        Postures and loads; what was measured does not count.
    deviations : mapping of str to float
        Columns that are measured, each with the standard deviation of its noise, in the
        mechanism's units.
    seed : int
        Seed of the noise.
    loaded : bool
        Move as the equilibrium under load, not linearly in it.
    outliers : sequence of int
        Places of rows with a gross error in all their numbers.
    outlier_size : float
        Size of that error, in standard deviations.
    tell_deviations : bool
        Whether the result carries the standard deviations.

    Raises
    ------
    InputError
        For a column that cannot be measured.
    """
    for name in deviations:
        if name not in MEASURED or name in TURN:
            raise InputError(
                "column cannot be simulated",
                got=repr(name),
                expected=", ".join(n for n in MEASURED if n not in TURN),
            )
    N, rng = len(settings), np.random.default_rng(checked_seed(seed))
    nothing = {name: np.zeros(N) for name in deviations}
    spread = {name: np.full(N, s) for name, s in deviations.items()}
    blank = replace(settings, values=nothing, deviations=spread, session=())
    unknowns = unknowns_of(elastic, ("all",))
    model = model_of(unknowns, blank, loaded)
    y, _ = model.at(unknowns.nominal)
    seen = model.observations
    sign = np.where(rng.random(N) < 0.5, -1.0, 1.0)
    gross = np.zeros(N)
    gross[list(outliers)] = outlier_size * sign[list(outliers)]
    values = {name: np.full(N, np.nan) for name in deviations}
    for i in range(len(seen)):
        # The target of a position, from zeros, is less the rigid one: taken away again.
        rigid = -seen.target[i] if seen.column[i] in POSITION else 0.0
        error = rng.normal() + gross[seen.row[i]]
        values[seen.column[i]][seen.row[i]] = rigid + y[i] + error * deviations[seen.column[i]]
    exact: dict[str, Array] = (
        spread if tell_deviations else {name: np.full(N, np.nan) for name in deviations}
    )
    return replace(settings, values=values, deviations=exact)
