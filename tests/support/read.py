"""Quantities of many postures, by recorded arithmetic and by their matrices."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from cartstiff import ElasticMechanism, Postures, analyse_many
from cartstiff.extend import Platform
from tests.doors import LoadKind
from tests.inner import (
    PLAIN,
    ManyModes,
    OwnOutputs,
    Recording,
    Settings,
    choose_quantities,
    evaluate,
    frequency_name,
)

#: What quantities refer to: connection, length, direction, added wrench, ...
asked = Settings


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
    backend: Any = "auto",
) -> Recording:
    """Poses and quantities over NumPy arrays."""
    own = OwnOutputs(quantities=names, settings=settings)
    acting = wrench is not None, settings.load, axes
    return Recording(elastic, ("pose",), own, *acting, backend=backend)


def read(
    elastic: ElasticMechanism,
    names: tuple[str, ...],
    q: np.ndarray,
    settings: Settings | None = None,
    wrench: Any = None,
    axes: Any = "body",
    backend: Any = "auto",
) -> Read:
    """Quantities; all of them have to be recorded."""
    asked = recording(elastic, names, settings or Settings(), wrench, axes, backend)
    assert not asked.from_matrices
    known: list[np.ndarray] = []
    asked._fill_others = lambda *given: (known.append(given[0].state == PLAIN), ([""], 0, ""))[1]
    found = asked.postures(q, None if wrench is None else np.array(wrench))
    return Read(found.arrays, found.q, known[0])


def of_many(
    elastic: ElasticMechanism,
    q: np.ndarray,
    names: Any,
    settings: Settings,
    wrench: Any = None,
    outputs: Any = (),
    axes: Any = "body",
) -> tuple[dict[str, np.ndarray], Postures]:
    """Quantities of a map from the matrices of its postures, and those postures."""
    chosen = choose_quantities(names, settings, elastic)
    needed = {*outputs, "pose", *(o for quantity in chosen for o in quantity.outputs(settings))}
    acting = {"load_kind": settings.load.kind, "load_at": settings.load.at, "load_axes": axes}
    many = analyse_many(elastic, q, wrench=wrench, outputs=sorted(needed), **acting)
    kinds = elastic.mechanism.coordinates
    lengths = np.array([c.is_length or isinstance(elastic.mechanism, Platform) for c in kinds])
    given = None if wrench is None else np.array(wrench)
    swing = ManyModes(elastic, many.q, given, settings.load, axes)
    return evaluate(chosen, many.arrays, settings, lengths, swing), many


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
    asked = Recording(elastic, (), own, *how, backend="portable")
    found = asked.postures(np.array(q), wrench, one_by_one=one_by_one)
    return np.stack([found.arrays[name] for name in names], axis=1)
