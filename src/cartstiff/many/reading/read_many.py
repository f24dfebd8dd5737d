"""Numbers of many postures, read by the machine code that makes their matrices."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cartstiff.geometry.se3 import Array
from cartstiff.many.arguments import OUTPUTS, aligned_empty, recorded
from cartstiff.many.kernels import Backend, reading_kernel, run
from cartstiff.many.plans import BoundCase, given_as, plan
from cartstiff.many.postures import loads_in_body
from cartstiff.many.reading.kinetics import frequencies_of, with_masses
from cartstiff.many.reading.reading_arithmetic import READINGS
from cartstiff.many.reading.readings import FREQUENCIES, Readings
from cartstiff.many.reading.vibration_arithmetic import frequency_name
from cartstiff.mechanisms.elastic import ElasticMechanism


class Values(NamedTuple):
    """What was read.

    Attributes
    ----------
    values : dict of str to ndarray (N,)
        Numbers by name.
    poses : ndarray (N, 4, 4)
        ``T_F_M``.
    q : ndarray (N, n)
        Coordinates, those of links that give as the load bends them.
    is_known : ndarray of bool (N,)
        Postures of which the numbers stand; all others are for `analyse_many` and what reads its
        arrays.
    """

    values: dict[str, Array]
    poses: Array
    q: Array
    is_known: NDArray[np.bool_]


Axes = Literal["body", "world"]


def readable(
    elastic: ElasticMechanism, names: Sequence[str], wrench: Array | None, axes: Axes
) -> tuple[str, ...]:
    """Which quantities machine code can read of a mechanism under a load, if it reads at all."""
    taken, frequencies = plan(elastic, given_as(wrench, axes)), 0
    if isinstance(taken, BoundCase) and with_masses(elastic, taken.case) is not None:
        frequencies = frequencies_of(taken.case)
    left = FREQUENCIES.difference(map(frequency_name, range(frequencies)))
    return tuple(name for name in names if name in READINGS and name not in left)


class Reader:
    """Reads many postures of a mechanism under one load.

    Parameters
    ----------
    elastic : ElasticMechanism
        The mechanism.
    readings : Readings
        What to read.
    outputs : tuple of str
        Outputs of `analyse_many` whose verdicts count.
    wrench : ndarray (6,), optional
        Load on the body.
    axes : {"body", "world"}
        Axes of its components; of what kind it is, and where, the readings say.
    path : {"auto", "portable"}
        Machine code, where it can be made; or NumPy, which is slower than reading from arrays and
        serves to compare.

    Attributes
    ----------
    state : str
        State of the postures that are read.
    """

    def __init__(
        self,
        elastic: ElasticMechanism,
        readings: Readings,
        outputs: tuple[str, ...],
        wrench: Array | None = None,
        axes: Axes = "body",
        path: Backend = "auto",
    ) -> None:
        self.elastic, self.readings = elastic, readings
        self._wrench, self._axes = wrench, axes
        self._plan = plan(elastic, given_as(wrench, axes))
        wanted = recorded(outputs)
        self._outputs = tuple(name for name in OUTPUTS if name in wanted or name == "pose")
        self._kernel: Any = None
        self.state = ""
        if isinstance(self._plan, BoundCase):
            self.state, case = self._plan.regular, self._plan.case
            if not FREQUENCIES.isdisjoint(readings.names):
                case = with_masses(elastic, case) or case
            self._kernel = reading_kernel(case, self._outputs, readings, path)

    @property
    def serves(self) -> bool:
        """Whether there is machine code for these readings of this mechanism."""
        return self._kernel is not None

    def read(self, q: Array) -> Values:
        """Read postures q (N, n)."""
        if not isinstance(self._plan, BoundCase):
            raise TypeError(self._plan)
        count = len(q)
        q = q.copy() if self._plan.is_closed or self._plan.settles else q
        loads = self._wrench
        if loads is not None:
            loads = loads_in_body(
                self.elastic, q, loads, self.readings.load, self._axes, "compiled", 1
            )
        arrays = {
            "readings": aligned_empty(count, len(self._kernel.program.outputs["readings"])),
            "pose": aligned_empty(count, 4, 4),
        }
        verdicts = np.zeros(count, np.uint8)
        run(self._plan, self._kernel, q, loads, arrays, verdicts, 1, None)
        values = _finished(arrays["readings"], self.readings)
        return Values(values, arrays["pose"], q, verdicts == 0)


def _finished(values: Array, asked: Readings) -> dict[str, Array]:
    """Numbers (N,) by name from what was read (N, k), and perhaps once more."""
    readings = {}
    for name, column in zip(asked.names, values.T, strict=False):
        root = READINGS[name].root
        readings[name] = column if root == 1 else column ** (1.0 / root)
    return readings
