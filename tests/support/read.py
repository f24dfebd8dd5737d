"""Quantities of many postures by recorded arithmetic, without their matrices."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from cartstiff import ElasticMechanism
from tests.doors import LoadKind
from tests.inner import PLAIN, OwnOutputs, Recording, Settings, frequency_name


class Read(NamedTuple):
    """Numbers by name, coordinates, and which postures were plainly regular."""

    values: dict[str, np.ndarray]
    q: np.ndarray
    is_known: np.ndarray


def readable(elastic: ElasticMechanism, names: Any, wrench: Any = None) -> tuple[str, ...]:
    """Names of the quantities that can be recorded."""
    settings = Settings(direction=(0.0, 0.0, 1.0), deflect=(0.0, 0.0, 0.0, 0.0, 0.0, 1.0))
    left = recording(elastic, names, settings, wrench).from_matrices
    return tuple(name for name in names if name not in left)


def recording(
    elastic: ElasticMechanism,
    names: tuple[str, ...],
    settings: Settings,
    wrench: Any,
    axes: Any = "body",
) -> Recording:
    """Poses and quantities over NumPy arrays."""
    own = OwnOutputs(quantities=names, settings=settings)
    acting = wrench is not None, settings.load, axes
    return Recording(elastic, ("pose",), own, *acting, backend="auto")


def read(
    elastic: ElasticMechanism,
    names: tuple[str, ...],
    q: np.ndarray,
    settings: Settings | None = None,
    wrench: Any = None,
    axes: Any = "body",
) -> Read:
    """Quantities; all of them have to be recorded."""
    asked = recording(elastic, names, settings or Settings(), wrench, axes)
    assert not asked.from_matrices
    known: list[np.ndarray] = []
    asked._fill_others = lambda *given: (known.append(given[6] == PLAIN), ([""], 0, ""))[1]
    found = asked.postures(q, None if wrench is None else np.array(wrench))
    return Read(found.arrays, found.q, known[0])


def frequencies(
    elastic: ElasticMechanism,
    q: np.ndarray,
    wrench: Any = None,
    acting: Any = None,
    count: int = 6,
    one_by_one: int | None = None,
) -> np.ndarray:
    """Lowest frequencies (N, count), read from recorded matrices where there are some."""
    given = {"load_kind": "dead", "load_at": (0.0, 0.0, 0.0), "load_axes": "body", **(acting or {})}
    kind = LoadKind(given["load_kind"], given["load_at"])
    names = tuple(map(frequency_name, range(count)))
    own = OwnOutputs(quantities=names, settings=Settings(load=kind, is_loaded=wrench is not None))
    how = wrench is not None, kind, given["load_axes"]
    asked = Recording(elastic, (), own, *how, reads=False)
    found = asked.postures(np.array(q), wrench, one_by_one=one_by_one)
    return np.stack([found.arrays[name] for name in names], axis=1)
