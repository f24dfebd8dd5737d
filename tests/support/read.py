"""Quantities of many postures by recorded arithmetic, without their matrices."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from cartstiff import ElasticMechanism
from tests.inner import PLAIN, OwnOutputs, Recording, Settings, plan, recordable


class Read(NamedTuple):
    """Numbers by name, coordinates, and which postures were plainly regular."""

    values: dict[str, np.ndarray]
    q: np.ndarray
    is_known: np.ndarray


def readable(elastic: ElasticMechanism, names: Any, wrench: Any = None) -> tuple[str, ...]:
    """Names of the quantities that can be recorded."""
    taken = plan(elastic, "none" if wrench is None else "each")
    return () if isinstance(taken, str) else recordable(elastic, taken.case, names)


def read(
    elastic: ElasticMechanism,
    names: tuple[str, ...],
    q: np.ndarray,
    settings: Settings | None = None,
    wrench: Any = None,
    axes: Any = "body",
) -> Read:
    """Quantities over NumPy arrays; all of them have to be recorded."""
    settings = settings or Settings()
    recording = Recording(
        elastic,
        ("pose",),
        OwnOutputs(quantities=names, settings=settings),
        wrench is not None,
        settings.load,
        axes,
        backend="portable",
    )
    assert not recording.from_matrices
    known: list[np.ndarray] = []
    recording._fill_others = lambda *given: (known.append(given[6] == PLAIN), ([""], 0, ""))[1]
    found = recording.postures(q, None if wrench is None else np.array(wrench))
    return Read(found.arrays, found.q, known[0])
