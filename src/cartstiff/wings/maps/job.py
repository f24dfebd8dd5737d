"""Computation of one part of a map, with all the data that a worker in another
process needs.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property
from math import prod
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from cartstiff.core import numerics
from cartstiff.core.arrays import Array
from cartstiff.core.mechanisms.elastic import ElasticMechanism
from cartstiff.core.mechanisms.limits import Limits
from cartstiff.recorded.arguments import TENSIONS
from cartstiff.recorded.following import Assembler, Closed
from cartstiff.recorded.kernels import Backend
from cartstiff.recorded.own_outputs import OwnOutputs
from cartstiff.recorded.postures import NOT_ASSEMBLED, REGULAR, Postures
from cartstiff.recorded.quantities import Quantity, Settings, choose_quantities
from cartstiff.recorded.recording import Recording
from cartstiff.wings.maps.cartesian import PLACES_AT_ONCE, CartesianGrid
from cartstiff.wings.maps.sampling import Grid, Sampling, usual_chunk

#: State of a place that no posture reaches.
UNREACHABLE = "unreachable"
#: State of a posture beyond the limits of joints or legs.
BEYOND = "beyond-limits"
#: State of a command after which no equilibrium was found.
NO_REST = "no-equilibrium"
#: Names of the states; ``state`` holds their index.
STATES = (
    REGULAR,
    "fewer-than-six-freedoms",
    "serial-singularity",
    "type-2-singularity",
    "singular-stiffness",
    "unbalanced",
    "buckled",
    "idle-self-motion",
    "constraint-singularity",
    "non-regular-redundancy",
    "wrench-ignored",
    NOT_ASSEMBLED,
    UNREACHABLE,
    "other",
    BEYOND,
    "ill-conditioned",
    NO_REST,
    "strut-buckled",
    "strut-not-found",
)

# Least usual number of postures of a part whose postures are computed in stacks.
_LEAST_CHUNK = 8192
# Number of postures of a part that one thread computes.
_PIECE_ROWS = 2**15
#: Applies a function to each of several arguments, as the built-in `map`.
Mapped = Callable[[Callable[[Any], Any], Iterable[Any]], Iterable[Any]]


@dataclass(frozen=True)
class MapJob:
    """Mechanism, sampling and quantities of a map.

    Attributes
    ----------
    elastic : ElasticMechanism
        The mechanism with its springs.
    sampling : Sampling
        The postures.
    names : tuple of str
        Names of the quantities.
    settings : Settings
        Matrix, length, direction and load that the quantities refer to.
    wrench : tuple of float, optional
        Load (moment, force), as in `cartstiff.analyse`; `settings` holds its kind and
        point.
    load_axes : {"body", "world"}
        Axes of its components.
    path : {"compiled", "portable", "engine"}
        Backend that computes every posture of the map, as in `analyse_many`. A resumed
        map keeps its backend, so that the numbers do not depend on where it was
        interrupted.
    one_by_one : int, optional
        Largest number of postures that are analysed singly where the fast backends cannot
        decide the state; the state of further ones is "other". Default: all.
    own : tuple of Quantity
        Those of the quantities that a user has defined, which other processes do not
        know.
    """

    elastic: ElasticMechanism
    sampling: Sampling
    names: tuple[str, ...]
    settings: Settings
    wrench: tuple[float, ...] | None
    load_axes: Literal["body", "world"] = "body"
    path: Backend = "auto"
    one_by_one: int | None = None
    own: tuple[Quantity, ...] = ()

    @cached_property
    def quantities(self) -> tuple[Quantity, ...]:
        """The quantities by their names."""
        return choose_quantities(self.names, self.settings, self.elastic, self.own)

    @property
    def in_stacks(self) -> bool:
        """Whether postures are computed in stacks, not one after the other in Python."""
        return not (self.path == "engine" and bool(self._closures))

    @property
    def usual_chunk(self) -> int:
        """Usual number of postures of a part: many enough to outweigh the work
        for each part.
        """
        least = None
        if isinstance(self.sampling, CartesianGrid):
            least = PLACES_AT_ONCE * self.sampling.branches
        elif self.in_stacks and self.path != "engine":
            least = _LEAST_CHUNK
        return usual_chunk(self.sampling.size, least)

    @property
    def stores_q(self) -> bool:
        """Whether the postures are stored: those of a closed chain are found
        by assembly.
        """
        return self.sampling.stores_q or bool(self._closures)

    @property
    def times(self) -> Array | None:
        """Times of the postures of a trajectory."""
        return getattr(self.sampling, "time", None)

    @property
    def _closures(self) -> tuple[Any, ...]:
        return self.elastic.mechanism.closures

    def compute(self, box: tuple[slice, ...], mapped: Mapped = map) -> dict[str, Array]:
        """Arrays of a box by name: quantities, ``state``, ``position``,
        and ``q`` if stored.

        The box is computed in pieces along its first axis, by `mapped`, which may use
        threads.
        """
        sizes = tuple(s.stop - s.start for s in box)
        count, inner = prod(sizes), prod(sizes[1:])
        arrays = {name: np.full(count, np.nan) for name in self.names}
        arrays["state"] = np.full(count, _code(UNREACHABLE), np.uint8)
        arrays["position"] = np.full((count, 3), np.nan)
        if self.stores_q:
            arrays["q"] = np.empty((count, len(self.elastic.names)))
        if isinstance(self.sampling, CartesianGrid):
            arrays["branches"] = np.empty(count, np.uint32)
        # Pieces of the box.
        step = max(1, _PIECE_ROWS // inner)

        def fill(first: int) -> None:
            last = min(first + step, sizes[0])
            along = slice(box[0].start + first, box[0].start + last)
            rows = slice(first * inner, last * inner)
            self._fill_piece(
                (along, *box[1:]), {name: a[rows] for name, a in arrays.items()}
            )

        list(mapped(fill, range(0, sizes[0], step)))
        arrays = {name: a.reshape(*sizes, *a.shape[1:]) for name, a in arrays.items()}
        if "branches" in arrays:
            arrays["branches"] = arrays["branches"][..., 0]
        if self.times is not None:
            arrays["time"] = self.times[box[0]]
        return arrays

    def _sampled(self, box: tuple[slice, ...], arrays: dict[str, Array]) -> Array:
        """Return the assembled postures (N, n) of a box, NaN where there is none."""
        if isinstance(self.sampling, CartesianGrid):
            q, counts = self.sampling.solve(box, self.elastic, self._cost)
            arrays["branches"][:] = np.repeat(counts, self.sampling.branches)
        else:
            q = self.sampling.postures(box, self.elastic)
        if self._closures and not self.sampling.is_closed:
            there: NDArray[np.bool_] = np.array(np.isfinite(q).all(axis=1))
            q[there], is_closed = self._assembled(q[there], box)
            there[there] = ~is_closed
            q[there], arrays["state"][there] = np.nan, _code(NOT_ASSEMBLED)
        return q

    def _fill_piece(self, box: tuple[slice, ...], arrays: dict[str, Array]) -> None:
        """Compute the rows of a box that is small enough to be computed at once."""
        q = self._sampled(box, arrays)
        at = np.flatnonzero(np.isfinite(q).all(axis=1))
        if at.size:
            found = self._computed(self._recording, q[at])
            beyond = self._beyond(found)
            for name in self.names:
                arrays[name][at] = np.where(beyond, np.nan, found.arrays[name])
            own = np.array([_code(code) for code in found.codes], np.uint8)
            arrays["state"][at] = np.where(beyond, _code(BEYOND), own[found.state])
            arrays["position"][at] = found.arrays["pose"][:, :3, 3]
        if "q" in arrays:
            arrays["q"][:] = q

    @cached_property
    def _recording(self) -> Recording:
        return self._recorded(self.names)

    def _recorded(self, names: tuple[str, ...]) -> Recording:
        """Poses, tensions that have limits, and some of the quantities."""
        return Recording(
            self.elastic,
            ("pose",) if self._tensions is None else ("pose", TENSIONS),
            OwnOutputs(quantities=names, settings=self.settings, defined=self.own),
            self.wrench is not None,
            self.settings.load,
            self.load_axes,
            backend=self.path,
        )

    def _computed(self, recording: Recording, q: Array) -> Postures:
        wrench = None if self.wrench is None else np.array(self.wrench, float)
        return recording.postures(q, wrench, one_by_one=self.one_by_one)

    @cached_property
    def _tensions(self) -> Array | None:
        """Limits of the legs' forces, which depend on the load as well."""
        legs = getattr(self.elastic.mechanism, "leg_limits", None)
        return None if legs is None else legs.forces

    def _beyond(self, found: Postures) -> Array:
        """Which postures (N,) are beyond limits."""
        values = self._limits.values(found.q, found.arrays["pose"])
        beyond = self._limits.exceeded(values)
        if self._tensions is not None:
            # Postures at which no tensions balance the load have a state of their own.
            beyond |= _beyond(self._tensions, found.arrays[TENSIONS]).any(axis=1)
        return beyond

    def _cost(self, q: Array) -> Array:
        """The first quantity, with its sign chosen so that smaller is better."""
        quantity = self.quantities[0]
        one = self._recorded((quantity.name,))
        value = self._computed(one, q).arrays[quantity.name]
        return value if quantity.better == "smaller" else -value

    @cached_property
    def _limits(self) -> Limits:
        return Limits(self.elastic.mechanism)

    def _assembled(self, q: Array, box: tuple[slice, ...]) -> Closed:
        """Assemble the postures (N, n) of a box, with the sampled coordinates held."""
        where, is_recorded = self.sampling, self.path != "engine"
        if not isinstance(where, Grid):
            every = Assembler(self.elastic, self.elastic.q, [], is_recorded)
            return every.together(q)
        own = where.columns
        cells = Assembler(self.elastic, where.base, own, is_recorded)
        return cells.grid(where.values, own, box)


def _code(name: str) -> int:
    return STATES.index(name if name in STATES else "other")


def _beyond(bounds: Array, tensions: Array) -> NDArray[np.bool_]:
    """Which tensions (..., m) are beyond their bounds (m, 2),
    to rounding of the largest.
    """
    largest = np.abs(tensions).max(axis=-1, initial=0.0, keepdims=True)
    roundoff = numerics.LIMIT_SLACK * largest
    below, above = tensions < bounds[:, 0] - roundoff, tensions > bounds[:, 1] + roundoff
    return np.asarray(below | above)
