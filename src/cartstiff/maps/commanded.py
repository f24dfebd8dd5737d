"""Maps of what comes of commands: the stiffness where the machine is at rest after its drives."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from cartstiff.checked_call import checked
from cartstiff.errors import CartstiffError, InputError, checked_kind
from cartstiff.geometry.se3 import Array
from cartstiff.maps.job import BEYOND, NO_REST, STATES, MapJob, Solved
from cartstiff.maps.quantity import MapRows, Quantity
from cartstiff.maps.sampling import Axis, Grid, Sampling
from cartstiff.mechanisms.elastic import ElasticMechanism, checked_elastic
from cartstiff.mechanisms.limits import force_notes
from cartstiff.statics.command import analyse_commanded, checked_command, drives


class CommandGrid(Sampling):
    """All combinations of what some drives are told, from one posture.

    Parameters
    ----------
    axes : mapping of str to Axis or (low, high, count)
        How far each drive is told to move on (rad, lengths), as in `cartstiff.after_command`; the
        first varies slowest. The dimensions are called ``command_NAME``.
    elastic : ElasticMechanism
        The mechanism.
    base : array_like (n,), optional
        Posture before the commands; default the mechanism's.
    """

    stores_q = True

    @checked
    def __init__(
        self,
        axes: Mapping[str, Axis | Sequence[float]],
        elastic: ElasticMechanism,
        base: ArrayLike | None = None,
    ) -> None:
        checked_kind(axes, Mapping, "axes of a grid", "names and (low, high, count)")
        checked_command(checked_elastic(elastic), dict.fromkeys(axes, 0.0))
        names = drives(elastic)
        self.base = elastic.mechanism.assembled(elastic.q if base is None else base)
        self.names = tuple(axes)
        self._grid = Grid(axes, names, np.zeros(len(names)))
        self._columns = [names.index(name) for name in axes]
        self.dims = tuple(f"command_{name}" for name in self._grid.dims)
        self.shape = self._grid.shape

    @property
    def axes(self) -> Mapping[str, Axis]:
        """Values by dimension."""
        return dict(zip(self.dims, self._grid.axes.values(), strict=True))

    def postures(
        self,
        box: tuple[slice, ...],
        elastic: ElasticMechanism | None = None,  # noqa: ARG002
    ) -> Array:
        """The posture before the commands, as often as there are cells in a box (m, n)."""
        return np.tile(self.base, (int(np.prod([s.stop - s.start for s in box])), 1))

    def commands(self, box: tuple[slice, ...]) -> list[dict[str, float]]:
        """What the drives are told in each cell of a box."""
        rows = self._grid.postures(box)[:, self._columns].tolist()
        return [dict(zip(self.names, row, strict=True)) for row in rows]

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        axes = zip(self.names, self._grid.axes.values(), strict=True)
        return {
            "kind": "command",
            "axes": {name: axis.as_list() for name, axis in axes},
            "base": self.base.tolist(),
        }


@dataclass(frozen=True)
class CommandedJob(MapJob):
    """As `MapJob`, read where the machine is at rest after a command.

    Attributes
    ----------
    told : mapping of str to float
        What drives are told at every posture; a `CommandGrid` tells its own besides.
    rows : sequence of mapping
        All that drives are told, for each of the postures in hand.
    """

    told: Mapping[str, float] | None = None
    rows: Sequence[Mapping[str, float]] = ()
    moves = True

    @property
    def stores_q(self) -> bool:
        """The postures are known by equilibria alone."""
        return True

    def compute(
        self,
        box: tuple[slice, ...],
        threads: int = 1,  # noqa: ARG002
        advance: Callable[[int], None] | None = None,
        solved: Solved | None = None,
    ) -> dict[str, Array]:
        """As `MapJob.compute`; in Python, one after the other."""
        job = self
        if isinstance(self.sampling, CommandGrid):
            told = dict(self.told or {})
            job = replace(self, rows=[told | row for row in self.sampling.commands(box)])
        return super(CommandedJob, job).compute(box, 1, advance, solved)

    def _compute_rows(self, q: Array, rows: slice, arrays: dict[str, Array]) -> Array:
        part = replace(self, rows=self.rows[rows]) if self.rows else self
        return super(CommandedJob, part)._compute_rows(q, rows, arrays)

    def _by_matrices(self, q: Array, quantities: Sequence[Quantity]) -> MapRows:
        told = self.rows or [self.told or {}] * len(q)
        answers = [self._row(x, row, quantities) for x, row in zip(q, told, strict=True)]
        return MapRows(
            np.concatenate([a.q for a in answers]),
            np.concatenate([a.state for a in answers]),
            np.concatenate([a.poses for a in answers]),
            {
                quantity.name: np.concatenate([a.values[quantity.name] for a in answers])
                for quantity in quantities
            },
        )

    def _row(self, q: Array, told: Mapping[str, float], quantities: Sequence[Quantity]) -> MapRows:
        """What is known after one command."""
        load = self.settings.load
        about_load: dict[str, Any] = {"load_kind": load.kind, "load_at": load.at}
        if self.wrench is not None:
            about_load |= {"wrench": self.wrench, "load_axes": self.load_axes}
        none = {x.name: np.full(1, np.nan) for x in quantities}
        nowhere = MapRows(q[None], _one(NO_REST), np.full((1, 4, 4), np.nan), none)
        try:
            with np.errstate(all="ignore"):
                at_rest = analyse_commanded(self.elastic, told, q, **about_load)
        except CartstiffError as error:
            # Rigid drives may not go there; other bad input was refused before.
            if isinstance(error, InputError) and error.where != "command":
                raise
            return nowhere
        if force_notes(at_rest.elastic, at_rest.posture):
            return MapRows(at_rest.q[None], _one(BEYOND), at_rest.pose[None], none)
        own = {name: getattr(self, name) for name in ("sampling", "names", "settings")}
        job = MapJob(at_rest.elastic, **own, wrench=None, path="engine")
        answer = job._by_matrices(at_rest.q[None], quantities)
        # Its arrays are memory that the next row is written to.
        values = {name: value.copy() for name, value in answer.values.items()}
        return answer._replace(poses=answer.poses.copy(), values=values)

    def _is_force_beyond(self, q: Array) -> bool:  # noqa: ARG002
        return False  # known from the equilibrium

    @property
    def _reader(self) -> None:
        return None


def _one(state: str) -> Any:
    return np.array([STATES.index(state)], np.uint8)
