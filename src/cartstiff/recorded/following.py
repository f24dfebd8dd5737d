"""Closing many postures of a chain in one assembly mode.

Newton steps from far away converge to another assembly mode, or not at all. The held
coordinates therefore move in steps from the mechanism's reference posture; where that
fails, cells of a grid start from a neighbouring cell. The result does not depend on what
else is computed.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import cast

import numpy as np
from numpy.typing import NDArray

from cartstiff.core import numerics
from cartstiff.core.arrays import Array
from cartstiff.core.errors import ConvergenceError
from cartstiff.core.mechanisms.chain import Chain
from cartstiff.core.mechanisms.closures import ReferencePosture
from cartstiff.core.mechanisms.elastic import ElasticMechanism
from cartstiff.recorded.closed_chains import Closings
from cartstiff.recorded.kernels import Closer, has_package

# Largest change of a held coordinate by the closures.
_MAX_HELD_CHANGE = numerics.NEGLIGIBLE_DIFFERENCE

Closed = tuple[Array, NDArray[np.bool_]]


class Assembler:
    """Closes postures of a chain while some coordinates keep their values.

    Parameters
    ----------
    elastic : ElasticMechanism
        A mechanism whose `mechanism` is a `Chain`.
    base : ndarray (n,)
        Reference posture from which the others are reached; closed first if possible.
    own : sequence of int
        Coordinates whose values are given. If they are not all held by actuators, the
        actuators follow them.
    is_recorded : bool
        Whether recorded steps close it, by machine code if possible; else `Chain.closed`.
    """

    def __init__(
        self,
        elastic: ElasticMechanism,
        base: Array,
        own: Sequence[int],
        is_recorded: bool = True,
    ) -> None:
        self._chain = cast(Chain, elastic.mechanism)
        held = self._chain.held
        self._hold = sorted({*own, *held})
        if not set(own) <= set(held):
            self._hold = sorted(({*held} - {*(self._chain.actuated or ())}) | {*own})
        # The recorded steps hold the mechanism's own held coordinates. Compiling takes
        # less time than a hundred steps over NumPy arrays.
        self._steps: Callable[[Array], Closings] = _no_steps
        if is_recorded and self._hold == sorted(held):
            self._steps = Closer(elastic, has_package("llvmlite"))
        self._base = self.near(base[None])[0][0]
        lengths = self._chain.at(self._base).coordinate_lengths
        self._home = ReferencePosture(self._base, self._hold, lengths)

    def near(self, q: Array) -> Closed:
        """Coordinates (N, n) that close the chain from q, and where they do;
        else as given.
        """
        at, is_closed, _ = self._near(q)
        return at, is_closed

    def _near(self, q: Array) -> Closings:
        at, is_closed, is_vain = self._steps(q)
        at = at.copy()
        for i in np.flatnonzero(~is_closed & ~is_vain):
            try:
                closed = self._chain.closed(q[i], hold=self._hold).q
            except ConvergenceError:
                continue
            if (
                not self._hold
                or np.abs(closed - q[i])[self._hold].max() <= _MAX_HELD_CHANGE
            ):
                at[i], is_closed[i] = closed, True
        return at, is_closed, ~is_closed

    def led(self, q: Array) -> Closed:
        """As `near`, the held coordinates moving straight from the base to their
        values in q.
        """
        at, is_closed, _ = self._home.continue_from(self._near, q, self._home.steps(q))
        return at, is_closed

    def together(self, q: Array) -> Closed:
        """As `near`, for unrelated postures: reached from the base, or else near q.

        All coordinates of q are used if more than the held ones are given.
        """
        q = self._chain.closed_as_given(q)
        at, is_closed, _ = self._home.continue_from(
            self._near, q, self._home.steps_where_asked(q)
        )
        for way in (self.near, self.led):
            at, is_closed = _with(way, at, is_closed)
        return at, is_closed

    def grid(
        self, values: Sequence[Array], columns: Sequence[int], box: Sequence[slice]
    ) -> Closed:
        """Coordinates (N, n) of the cells of a box of a grid, in C order,
        and where they close.

        The held coordinates move straight to each cell, as in `Chain.closed`, so that a
        cell is the same as for its values alone. Cells that are not reached start from
        their neighbour: from the cell nearest the base along the first axis, from each of
        these along the next axis. The remaining cells start from the base.

        Parameters
        ----------
        values : sequence of ndarray
            Values along each axis.
        columns : sequence of int
            Coordinate of each axis.
        box : sequence of slice
            Required cells, which do not depend on the box.
        """
        axes = list(zip(values, columns, box, strict=True))
        seeds = [int(np.abs(v - self._base[c]).argmin()) for v, c, _ in axes]
        start = self._base[None].copy()
        start[0, list(columns)] = [v[s] for v, s in zip(values, seeds, strict=True)]
        q, is_closed = self.together(start)
        for (value, column, cells), seed in zip(axes, seeds, strict=True):
            q, is_closed = self._along(q, is_closed, column, value, seed, cells)
        return _with(self._from_base, q, is_closed)

    def _along(
        self,
        q: Array,
        is_closed: NDArray[np.bool_],
        column: int,
        value: Array,
        seed: int,
        cells: slice,
    ) -> Closed:
        """Extend N cells at a seed along an axis: (N cells, n).

        Those at the seed are unchanged.
        """
        # Every value of the row is led at once, as the mechanism's own closing finds it.
        first, last = min(cells.start, seed), max(cells.stop, seed + 1)
        every = np.repeat(q[:, None], last - first, axis=1)
        every[:, :, column] = value[first:last]
        at, shut = self.led(every.reshape(-1, q.shape[1]))
        every, shut = at.reshape(every.shape), shut.reshape(every.shape[:2])
        every[:, seed - first], shut[:, seed - first] = q, is_closed
        # What did not close begins at its neighbour that did, away from the seed.
        up, down = range(seed - first + 1, last - first), range(seed - first - 1, -1, -1)
        for k, before in [*((k, k - 1) for k in up), *((k, k + 1) for k in down)]:
            if (left := np.flatnonzero(~shut[:, k] & shut[:, before])).size:
                start = every[left, before]
                start[:, column] = value[first + k]
                every[left, k], shut[left, k] = self.near(start)
        asked = slice(cells.start - first, cells.stop - first)
        return every[:, asked].reshape(-1, q.shape[1]), shut[:, asked].ravel()

    def _from_base(self, q: Array) -> Closed:
        start = np.tile(self._base, (len(q), 1))
        start[:, self._hold] = q[:, self._hold]
        return self.near(start)


def _no_steps(q: Array) -> Closings:
    return q, np.zeros(len(q), bool), np.zeros(len(q), bool)


def _with(
    way: Callable[[Array], Closed], q: Array, is_closed: NDArray[np.bool_]
) -> Closed:
    """Close the postures that are not closed, by another method."""
    if (left := np.flatnonzero(~is_closed)).size:
        q[left], is_closed[left] = way(q[left])
    return q, is_closed
