"""Objectives: one number of a posture, on an analysis and on recorded numbers."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from cartstiff.core.arrays import Array
from cartstiff.core.errors import InputError
from cartstiff.core.mechanisms.elastic import ElasticMechanism
from cartstiff.core.stiffness.compute import PostureStiffness
from cartstiff.recorded.arguments import shapes_of
from cartstiff.recorded.quantities import Quantity, Settings
from cartstiff.recorded.readings import READINGS, Readings, RecordedSource
from cartstiff.recorded.stacks import distances, evaluate

#: A function of the stiffness (6, 6) of the connection, the wrench (6,) and the pose (4,
#: 4).
OwnObjective = Callable[[Any, Any, Any], Any]


class Asked:
    """An objective on the numbers of an analysis, and on recorded ones."""

    name: str
    unit: str
    #: Outputs that it reads.
    needed: tuple[str, ...]
    #: What its recorded numbers depend on beside a mechanism.
    key: tuple[Any, ...]

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Asked) and self.key == other.key

    def __hash__(self) -> int:
        return hash(self.key)

    def seen(self, result: PostureStiffness) -> float:
        """Its value at an analysed posture; NaN where it does not exist."""
        raise NotImplementedError

    def recorded(self, arrays: Mapping[str, Array]) -> tuple[Any, Any]:
        """Its value on recorded numbers and the verdict on it.

        KeyError without an output.
        """
        raise NotImplementedError


class OfQuantity(Asked):
    """A quantity of the table."""

    def __init__(
        self, quantity: Quantity, settings: Settings, elastic: ElasticMechanism
    ) -> None:
        self._quantity, self._settings = quantity, settings
        self.name, self.unit = quantity.name, quantity.unit_in(elastic.units)
        self.key = quantity.name, settings
        self._readings = Readings((quantity.name,), settings)
        self.needed = self._readings.needs

    def seen(self, result: PostureStiffness) -> float:
        """Its value at an analysed posture."""
        quantity, settings = self._quantity, self._settings
        arrays = {
            name: _output(result, name)[None] for name in quantity.outputs(settings)
        }
        arrays |= {name: _output(result, name)[None] for name in ("pose", "wrench")}
        lengths = distances(result.elastic.mechanism)
        return float(evaluate([quantity], arrays, settings, lengths)[quantity.name][0])

    def recorded(self, arrays: Mapping[str, Array]) -> tuple[Any, Any]:
        """Its value on recorded numbers, and the verdict on it."""
        reading = READINGS[self.name]
        source = RecordedSource(arrays, self._readings)
        return reading.function(source), source.verdict


class OfFunction(Asked):
    """A function of stiffness, wrench and pose."""

    def __init__(self, function: OwnObjective, settings: Settings) -> None:
        self._function, self._connection = function, settings.connection
        self.key = function, settings.connection, settings.load
        self._load = settings.load
        self.name, self.unit = getattr(function, "__name__", "objective"), ""
        own = "B" if self._connection == "load" else self._connection
        self.needed = (f"stiffness_{own}", "wrench", "pose")

    def seen(self, result: PostureStiffness) -> float:
        """Its value at an analysed posture; InputError unless that is one number."""
        K = _output(result, f"stiffness_{self._connection}")
        W, pose = _output(result, "wrench"), _output(result, "pose")
        value = np.asarray(self._function(K, W, pose))
        if value.shape != () or value.dtype.kind not in "fiu":
            raise InputError(
                "the objective is not one number",
                expected="shape ()",
                got=f"{value.dtype}, shape {value.shape}",
            )
        return float(value)

    def recorded(self, arrays: Mapping[str, Array]) -> tuple[Any, Any]:
        """Its value on recorded numbers, and the verdict on it."""
        W, K = arrays["wrench"], arrays.get(self.needed[0], np.full((6, 6), np.nan))
        if self._connection == "load":
            K = K + self._load.change(W)
        return self._function(K, W, arrays["pose"]), 0.0


def _output(result: PostureStiffness, name: str) -> Array:
    """An output of `analyse_many` at one posture; NaN where it does not exist."""
    return np.broadcast_to(result[name], shapes_of(result.elastic)[name])
