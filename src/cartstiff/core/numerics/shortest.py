"""Shortest vectors above bounds, for stacks of systems."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from cartstiff.core.numerics.criteria import ROUNDOFF_OF_SUMS
from cartstiff.core.numerics.policy import BALANCE_TOLERANCE, DEPENDENT_ROW, Array, silent

#: Steps for each row and unknown after which a search ends: a few are enough.
_STEPS = 10


def shortest_above(G: Array, g: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Shortest y with ``G y >= g``, and whether there is one, for stacks of p systems.

    By the dual active set method ([GoldfarbIdnani]_): from y = 0 the row that is missed
    most enters the active ones, which are met exactly, and rows whose multipliers reach
    zero leave.

    Parameters
    ----------
    G : ndarray (p, r, d)
        Rows.
    g : ndarray (p, r)
        What they must reach.

    Returns
    -------
    y : ndarray (p, d)
        Zero where there is none.
    exists : ndarray of bool (p,)
        Whether y misses no row by more than `BALANCE_TOLERANCE`, and is not longer than
        the inverse root of that.
    """
    p, r, d = G.shape
    y, exists = np.zeros((p, d)), np.zeros(p, bool)
    if not r or not d:
        return y, np.asarray(g.max(axis=1, initial=0.0) <= BALANCE_TOLERANCE)
    sets = _ActiveSets.empty(G, g)
    for _ in range(_STEPS * (r + d)):
        if not len(sets.which):
            break
        missing = sets.missing()
        is_met = sets.choose(missing)
        if is_met.any():
            done = sets.of(is_met)
            exact = done.exact()
            left = done.missing(exact).max(axis=1)
            is_short = (exact * exact).sum(axis=1) < 1.0 / BALANCE_TOLERANCE
            found = is_short & (left <= BALANCE_TOLERANCE)
            y[done.which] = np.where(found[:, None], exact, 0.0)
            exists[done.which] = found
            sets, missing = sets.of(~is_met), missing[~is_met]
        if len(sets.which):
            sets = sets.of(sets.step(missing))
    return y, exists


@dataclass
class _ActiveSets:
    """State of the searches for the systems `which` of the stack.

    Attributes
    ----------
    which : ndarray of int (p,)
    G, g : ndarray (p, r + 1, d), (p, r + 1)
        The rows, and one of zeros, number r, that fills free places of `active` and
        `enters`.
    sizes, tolerance : ndarray (p, r + 1), (p, 1)
        Norms of the rows, and what may be missed by round-off.
    y : ndarray (p, d)
    active, multipliers : ndarray (p, d)
        Numbers of the rows that are met exactly.
    enters, weight : ndarray (p,)
        The row that enters, and its multiplier.
    """

    which: NDArray[np.intp]
    G: Array
    g: Array
    sizes: Array
    tolerance: Array
    y: Array
    active: NDArray[np.intp]
    multipliers: Array
    enters: NDArray[np.intp]
    weight: Array

    @classmethod
    def empty(cls, G: Array, g: Array) -> _ActiveSets:
        """Start without active rows."""
        p, r, d = G.shape
        sizes = np.linalg.norm(G, axis=2)
        # A row without entries, which nothing meets, comes first.
        sizes = np.maximum(sizes, DEPENDENT_ROW * sizes.max(axis=1, keepdims=True))
        tolerance = ROUNDOFF_OF_SUMS * (1.0 + np.abs(g).max(axis=1, keepdims=True))
        return cls(
            np.arange(p),
            np.concatenate([G, np.zeros((p, 1, d))], axis=1),
            np.concatenate([g, np.zeros((p, 1))], axis=1),
            np.concatenate([np.where(sizes > 0.0, sizes, 1.0), np.ones((p, 1))], axis=1),
            tolerance,
            np.zeros((p, d)),
            np.full((p, d), r),
            np.zeros((p, d)),
            np.full(p, r),
            np.zeros(p),
        )

    @property
    def none(self) -> int:
        """Number of the row of zeros."""
        return self.G.shape[1] - 1

    def of(self, some: NDArray[np.bool_]) -> _ActiveSets:
        """The searches for some of the systems."""
        if some.all():
            return self
        return _ActiveSets(*(getattr(self, field.name)[some] for field in fields(self)))

    def missing(self, y: Array | None = None) -> Array:
        """By how much y misses the rows (p, r + 1), without those that are active."""
        at = self.y if y is None else y
        missing = self.g - (self.G @ at[:, :, None])[:, :, 0]
        np.put_along_axis(missing, self.active, 0.0, axis=1)
        return np.asarray(missing)

    def choose(self, missing: Array) -> NDArray[np.bool_]:
        """Let the row enter that is missed most where none does.

        Whether none is missed.
        """
        is_free = self.enters == self.none
        relative = np.where(missing > self.tolerance, missing / self.sizes, 0.0)
        self.enters = np.where(is_free, relative.argmax(axis=1), self.enters)
        is_met = is_free & (relative.max(axis=1) <= 0.0)
        self.enters[is_met] = self.none
        return np.asarray(is_met)

    def _rows(self) -> tuple[Array, Array]:
        """Active rows A (p, d, d), and ``A A^T``, with ones where there is none."""
        A = np.take_along_axis(self.G, self.active[:, :, None], axis=1)
        gram = A @ A.swapaxes(1, 2)
        places = np.arange(gram.shape[1])
        gram[:, places, places] += self.active == self.none
        return A, gram

    def step(self, missing: Array) -> NDArray[np.bool_]:
        """One step of all searches, until the row has entered or another has left.

        Returns the searches that go on: in others no y meets the row.
        """
        each = np.arange(len(self.which))
        A, gram = self._rows()
        n, left = self.G[each, self.enters], missing[each, self.enters]
        # z: what y gains along n while the active rows stay met; s: what their
        # multipliers lose.
        s = np.linalg.solve(gram, (A @ n[:, :, None]))[:, :, 0]
        z = n - (s[:, None, :] @ A)[:, 0]
        gain = (z * n).sum(axis=1)
        is_free = (self.active == self.none).any(axis=1)
        size = DEPENDENT_ROW**2 * (n * n).sum(axis=1)
        moves = is_free & (gain > size) & ((z * z).sum(axis=1) > size)
        with silent():
            whole = np.where(moves, left / gain, np.inf)
            falls = (s > 0.0) & (self.active != self.none)
            until = np.where(falls, self.multipliers / s, np.inf)
        leaves = until.argmin(axis=1)
        partial = until[each, leaves]
        goes_on = np.isfinite(np.minimum(whole, partial))
        length = np.where(goes_on, np.minimum(whole, partial), 0.0)
        self.y = self.y + np.where(moves, length, 0.0)[:, None] * z
        self.multipliers = np.maximum(self.multipliers - length[:, None] * s, 0.0)
        self.weight = self.weight + length
        has_entered = goes_on & moves & (whole <= partial)
        some = np.flatnonzero(has_entered)
        place = (self.active[some] == self.none).argmax(axis=1)
        self.active[some, place] = self.enters[some]
        self.multipliers[some, place] = self.weight[some]
        self.enters[some], self.weight[some] = self.none, 0.0
        some = np.flatnonzero(goes_on & ~has_entered)
        self.active[some, leaves[some]] = self.none
        self.multipliers[some, leaves[some]] = 0.0
        return np.asarray(goes_on)

    def exact(self) -> Array:
        """Shortest y (p, d) that meets the active rows, without the round-off
        of the steps.
        """
        A, gram = self._rows()
        wanted, y = np.take_along_axis(self.g, self.active, axis=1), np.zeros_like(self.y)
        for _ in range(3):  # the last two correct the round-off of the squared rows
            left = wanted - (A @ y[:, :, None])[:, :, 0]
            y = y + (np.linalg.solve(gram, left[:, :, None]).swapaxes(1, 2) @ A)[:, 0]
        return y
