"""Measurements as a table (CSV) in SI, to be filled in or read again."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cartstiff.arrays import Array
from cartstiff.identify.columns import LOAD, MEASURED
from cartstiff.identify.measurements import Measurements
from cartstiff.mechanisms.chain import Chain
from cartstiff.mechanisms.contract import SI, convert_length
from cartstiff.mechanisms.elastic import ElasticMechanism

__all__ = ["table_text"]


def table_text(
    measured: Measurements, elastic: ElasticMechanism, columns: Sequence[str] = ()
) -> str:
    """Rows under a line of names: postures, loads, and what was measured.

    Parameters
    ----------
    measured : Measurements
        The rows.
    elastic : ElasticMechanism
        Whose joints name the columns.
    columns : sequence of str
        Columns that stand empty, to be filled in.
    """
    length, force = convert_length(SI, elastic.units)
    mechanism = elastic.mechanism
    table: dict[str, Array] = {}
    hidden = mechanism.virtual if isinstance(mechanism, Chain) else frozenset()
    for j, c in enumerate(mechanism.coordinates):
        if j not in hidden:
            unit = "m" if c.is_length else "rad"
            name = f"q_{c.name}" if c.name in MEASURED else c.name
            table[f"{name} [{unit}]"] = measured.q[:, j] / (length if c.is_length else 1.0)
    loads = measured.wrench / np.repeat([force * length, force], 3)
    units = ("N m", "N")
    for i, name in enumerate(LOAD):
        if loads[:, i].any():
            table[f"{name} [{units[i // 3]}]"] = loads[:, i]
    if measured.mass.any():
        table["mass [kg]"] = measured.mass
    if measured.mass0.any():
        table["mass0 [kg]"] = measured.mass0
    empty = np.full(len(measured), np.nan)
    for name in MEASURED:
        values = empty if name in columns else measured.values.get(name)
        if values is None:
            continue
        is_length = MEASURED[name] == "length"
        unit, factor = ("m", length) if is_length else ("rad", 1.0)
        table[f"{name} [{unit}]"] = values / factor
        if name == "d":
            table |= dict(zip(("nx", "ny", "nz"), measured.direction.T, strict=True))
        spread = measured.deviations.get(name)
        if spread is not None and not np.isnan(spread).all() and name not in columns:
            table[f"sd_{name} [{unit}]"] = spread / factor
    lines = [",".join(table)]
    lines += [
        ",".join("" if np.isnan(x) else f"{x:.10g}" for x in row)
        for row in zip(*table.values(), strict=True)
    ]
    return "\n".join(lines) + "\n"
