"""Choice of the postures and loads to measure.

Each candidate adds ``G_i = sum a a^T / s^2`` to the information M of the compliances, in shares of
their present values, and of the zeros, tool and base that are sought: the columns are those of the
fit. C is the compliances' part of ``M^-1``, so that what else is sought is separated from them.
Three criteria:

* worst: the smallest widest interval, ``max_j C_jj``;
* all: the smallest determinant of C (D-optimal, [AtkinsonDonev]_); the widest interval may then be
  nearly as wide as that of random rows;
* posture: the smallest error of the deflection at the user's own posture under the user's own load,
  ``tr(L C L^T)`` (test-pose criterion, [KlimchikTestPose]_).

The rows are chosen greedily, then each is exchanged for any candidate as long as that reduces the
cost. Most exchanges do not change the widest interval: norms of all intervals, with increasing
weight on the wide ones, are reduced before it. At last every row is moved to better places nearby.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import pi
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from cartstiff import numerics
from cartstiff.arrays import Array, checked_seed, plain_dict
from cartstiff.errors import (
    CartstiffError,
    ConvergenceError,
    InputError,
    UndefinedError,
    UnknownNameError,
)
from cartstiff.figures import new_axes
from cartstiff.identify.measurements import (
    DISPLACEMENT,
    MEASURED,
    TURN,
    Measurements,
    assembled,
)
from cartstiff.identify.models import Model, model_of
from cartstiff.identify.unknowns import (
    OffsetEstimate,
    Unknowns,
    offsets_of,
    size_of,
    unit_of,
    unknowns_of,
)
from cartstiff.mechanisms.chain import Chain
from cartstiff.mechanisms.elastic import ElasticMechanism
from cartstiff.mechanisms.identified import quantile
from cartstiff.mechanisms.platform import Platform
from cartstiff.results import LabelledResult


def _check_columns(names: Iterable[str], what_for: str) -> None:
    for name in names:
        if name not in MEASURED or name in TURN:
            raise InputError(
                f"column cannot be {what_for}",
                got=repr(name),
                expected=", ".join(n for n in MEASURED if n not in TURN),
            )


def simulated(
    elastic: ElasticMechanism,
    settings: Measurements,
    deviations: Mapping[str, float],
    *,
    seed: int = 0,
    loaded: bool = False,
    outliers: Sequence[int] = (),
    outlier_size: float = 20.0,
    tell_deviations: bool = False,
) -> Measurements:
    """Simulated measurements of a mechanism with these springs in given settings.

    Parameters
    ----------
    elastic : ElasticMechanism
        Its springs are the true ones.
    settings : Measurements
        Postures and loads; measured numbers are ignored.
    deviations : mapping of str to float
        Measured columns, each with the standard deviation of its noise, in the mechanism's units.
    seed : int
        Seed of the noise.
    loaded : bool
        Simulate the equilibrium under load, not displacements linear in it.
    outliers : sequence of int
        Places of rows with a gross error in all their numbers.
    outlier_size : float
        Size of that error, in standard deviations.
    tell_deviations : bool
        Whether the result carries the standard deviations.

    Raises
    ------
    InputError
        For a column that cannot be measured.
    """
    _check_columns(deviations, "simulated")
    N, rng = len(settings), np.random.default_rng(checked_seed(seed))
    nothing = {name: np.zeros(N) for name in deviations}
    spread = {name: np.full(N, s) for name, s in deviations.items()}
    blank = replace(settings, values=nothing, deviations=spread, session=())
    unknowns = unknowns_of(elastic, ("all",))
    model = model_of(unknowns, blank, loaded)
    y, _ = model.at(unknowns.nominal)
    seen = model.observations
    gross = np.zeros(N)
    sign = np.where(rng.random(N) < 0.5, -1.0, 1.0)
    gross[list(outliers)] = outlier_size * sign[list(outliers)]
    errors = (rng.normal(size=len(seen)) + gross[seen.row]) * seen.deviation
    # The target of a zero position is minus the rigid one, which is added again.
    numbers = y + errors - np.where(seen.is_absolute, seen.target, 0.0)
    column = np.array(seen.column)
    values = {name: np.full(N, np.nan) for name in deviations}
    for name, filled in values.items():
        filled[seen.row[column == name]] = numbers[column == name]
    unknown = {name: np.full(N, np.nan) for name in deviations}
    return replace(settings, values=values, deviations=spread if tell_deviations else unknown)


_AXES = ("x", "y", "z")
# Half ranges: of a joint without limits, and of a platform about its file's pose [rad; shares of
# its size].
_RANGE, _TILT, _SHIFT = pi, 0.3, 0.2
# Random postures drawn per candidate wanted.
_DRAWS_PER_CANDIDATE = 20
# Neighbours of all rows that are tried at once; the same if postures are slow to compute.
_NEIGHBOURS, _SLOW_NEIGHBOURS = 1000, 150


def candidates(
    elastic: ElasticMechanism,
    deviations: Mapping[str, float],
    *,
    count: int = 1000,
    seed: int = 0,
    mass: float = 0.0,
    force: float = 0.0,
    ranges: Mapping[str, Sequence[float]] | None = None,
    within: Mapping[str, Sequence[float]] | None = None,
    point: tuple[float, float, float] = (0.0, 0.0, 0.0),
    load_at: tuple[float, float, float] | None = None,
) -> Measurements:
    """Random reachable postures within the measuring volume, each with a load.

    Parameters
    ----------
    elastic : ElasticMechanism
        Its joint limits hold.
    deviations : mapping of str to float
        Columns to be measured, with standard deviations, in the mechanism's units.
    count, seed : int
        Number of candidates, and the seed of the draw.
    mass : float
        Mass [kg] that hangs on the body.
    force : float
        Force on the body [N], for each posture along one of the axes +-x, +-y and +-z of F;
        without a mass.
    ranges : mapping of str to (low, high), optional
        Ranges of joints, narrower than their limits.
    within : mapping of str to (low, high), optional
        Range of the measured point's x, y, z in F: the volume that can be measured and entered.
    point, load_at : tuple of 3 floats
        As in `read_measurements`.

    Raises
    ------
    InputError
        If there is no load, a column cannot be measured, or no posture remains.
    """
    if not (mass > 0.0 or force > 0.0):
        raise InputError("no load is planned", expected="a mass to hang, or a force to push with")
    _check_columns(deviations, "planned")
    rng = np.random.default_rng(checked_seed(seed))
    low, high = _ranges(elastic, ranges or {})
    box = dict(within or {})
    for axis in box:
        if axis not in _AXES:
            raise InputError(
                "axis of the volume cannot be used",
                where="--within",
                expected=", ".join(_AXES),
                got=repr(axis),
            )
    kept: list[Array] = []
    for _ in range(_DRAWS_PER_CANDIDATE * count):
        q = _allowed(elastic, rng.uniform(low, high), box, point)
        if q is not None:
            kept.append(q)
            if len(kept) == count:
                break
    if not kept:
        raise InputError(
            "no posture is left in the volume and the ranges",
            where="--within",
            expected="a volume that the mechanism reaches",
        )
    N = len(kept)
    wrench = np.zeros((N, 6))
    if not mass > 0.0:
        along, sign = rng.integers(0, 3, N), np.where(rng.random(N) < 0.5, -1.0, 1.0)
        wrench[np.arange(N), 3 + along] = sign * force
    direction = rng.normal(size=(N, 3))
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    return Measurements(
        np.array(kept),
        wrench,
        np.full(N, mass),
        values={name: np.zeros(N) for name in deviations},
        deviations={name: np.full(N, s) for name, s in deviations.items()},
        direction=direction if "d" in deviations else np.full((N, 3), np.nan),
        point=point,
        load_at=point if load_at is None else load_at,
    )


def beside(
    elastic: ElasticMechanism,
    rows: Measurements,
    share: float,
    rng: np.random.Generator,
    *,
    ranges: Mapping[str, Sequence[float]] | None = None,
    within: Mapping[str, Sequence[float]] | None = None,
) -> tuple[Measurements, NDArray[np.intp]]:
    """Neighbours of rows: postures moved, forces along each axis of F.

    Parameters
    ----------
    elastic : ElasticMechanism
        As in `candidates`.
    rows : Measurements
        From `candidates`.
    share : float
        Share of the ranges by which postures are moved (standard deviation) and gauges turned.
    rng : Generator
        Random numbers.
    ranges, within
        As in `candidates`.

    Returns
    -------
    near : Measurements
        Each row, followed by its neighbours.
    owner : ndarray of int
        Place of the given row that each belongs to.
    """
    low, high = _ranges(elastic, ranges or {})
    chain = elastic.mechanism
    quick = isinstance(chain, Chain) and not chain.closures
    each = max((_NEIGHBOURS if quick else _SLOW_NEIGHBOURS) // len(rows), 3)
    owner, taken = [], []
    for i, centre in enumerate(rows.q):
        W, gauge = rows.wrench[i], rows.direction[i]
        loads = [(centre, W, gauge)]
        forces = W[None]
        if W.any():
            forces = np.hstack([np.zeros((3, 3)), np.eye(3) * np.linalg.norm(W[3:])])
        for step in share * (high - low) * rng.normal(size=(each, len(low))):
            at = _allowed(elastic, np.clip(centre + step, low, high), within or {}, rows.point)
            if at is None:
                continue
            turned = gauge + 2.0 * pi * share * rng.normal(size=3)
            loads += [(at, force, turned / np.linalg.norm(turned)) for force in forces]
        owner += [i] * len(loads)
        taken += loads
    q, wrench, direction = map(np.array, zip(*taken, strict=True))
    return replace(rows.taken(owner), q=q, wrench=wrench, direction=direction), np.array(owner)


def _allowed(
    elastic: ElasticMechanism,
    q: Array,
    box: Mapping[str, Sequence[float]],
    point: tuple[float, float, float],
) -> Array | None:
    """The assembled posture; None if that fails, or the measured point is not in the volume."""
    try:
        q, moved = assembled(elastic, q)
    except (ConvergenceError, UndefinedError):
        return None
    if moved >= numerics.REPORTED_ERROR:
        return None
    if box:
        pose = elastic.mechanism.at(q).pose
        at = pose[:3, 3] + pose[:3, :3] @ np.asarray(point)
        if not all(low <= at[_AXES.index(a)] <= high for a, (low, high) in box.items()):
            return None
    return q


def _ranges(
    elastic: ElasticMechanism, ranges: Mapping[str, Sequence[float]]
) -> tuple[Array, Array]:
    """Lowest and highest coordinates; dependent ones keep their values."""
    mechanism = elastic.mechanism
    low, high = elastic.q.copy(), elastic.q.copy()
    looped = bool(mechanism.closures)
    for j in elastic.commanded:
        c = mechanism.coordinates[j]
        if isinstance(mechanism, Platform):
            width = _TILT if not c.is_length else _SHIFT * mechanism.length
            low[j], high[j] = elastic.q[j] - width, elastic.q[j] + width
            continue
        width = 0.5 * mechanism.at(elastic.q).length if c.is_length else _RANGE
        width = 0.3 * width if looped else width
        centre = elastic.q[j] if looped or not np.isfinite(c.lower + c.upper) else 0.0
        low[j] = c.lower if np.isfinite(c.lower) and not looped else centre - width
        high[j] = c.upper if np.isfinite(c.upper) and not looped else centre + width
        if not looped and not c.is_length:  # angles repeat after a turn
            low[j], high[j] = max(low[j], -_RANGE), min(high[j], _RANGE)
    for name, (a, b) in ranges.items():
        if name not in elastic.names:
            raise UnknownNameError("joint", name, elastic.names, where="--range")
        if not a <= b:
            raise InputError(
                f"range of {name!r} is the wrong way round",
                where="--range",
                expected="LOW:HIGH",
                got=f"{a:g}:{b:g}",
            )
        low[elastic.names.index(name)], high[elastic.names.index(name)] = a, b
    return low, high


CRITERIA = ("worst", "all", "posture")
#: Norms of the variances on the way to the largest.
_NORMS = (2, 8, 32)
# Rows that move by more than this share of the mechanism, and this many times the median, are near
# a singularity, where displacements are not small.
_LARGE_DISPLACEMENT, _TIMES_MEDIAN = 0.05, 10.0

#: Costs (k,) of informations (k, P, P).
Cost = Callable[[Array], Array]
#: Neighbours of rows within a share of the ranges, and the row that each belongs to.
Beside = Callable[[Measurements, float, np.random.Generator], tuple[Measurements, NDArray[np.intp]]]

# Natural size of zeros and offsets: rad, and shares of the mechanism.
_SMALL = 1e-3
_MAX_PASSES = 20
# Shares of the ranges by which rows are moved, one after the other; and the least distance of two
# rows with one load, as a repeated row reduces the noise alone, not errors of the model.
_SHARES = tuple(0.1 * 0.6**k for k in range(8))
_LEAST_DISTANCE = 0.02


@dataclass(frozen=True, eq=False, repr=False)
class Plan(LabelledResult):
    """Rows to be measured, and the predicted intervals.

    Attributes
    ----------
    unknowns : Unknowns
        Parameters.
    rows : Measurements
        The chosen postures and loads, in the order of their choice, without measured numbers.
    criterion : str
        Name of the choice.
    counts : ndarray of int (k,)
        Numbers of rows for which intervals are predicted.
    deviations : ndarray (k, P)
        Predicted standard deviations, in shares of the compliances; infinite where not determined.
    factors : ndarray (k,)
        Half width of an interval over the standard deviation, at each number of rows.
    lost : tuple of str
        Springs that no candidate determines by themselves.
    level : float
        Probability of the intervals.
    geometry : tuple of OffsetEstimate
        Predicted standard deviations of zeros, tool and base, if they are sought.
    """

    unknowns: Unknowns
    rows: Measurements
    criterion: str
    counts: NDArray[np.intp]
    deviations: Array
    factors: Array
    lost: tuple[str, ...]
    level: float
    geometry: tuple[OffsetEstimate, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """For JSON."""
        rows = []
        for u, s in zip(self.unknowns.parameters, self.deviations[-1].tolist(), strict=True):
            k = 1.0 / u.nominal if u.has_stiffness and not u.is_scale else np.nan
            half = self.factor * s
            interval = [k / (1.0 + half), k / (1.0 - half) if half < 1.0 else None]
            rows.append(
                {
                    "name": u.name,
                    "stiffness": k,
                    "unit": u.unit,
                    "relative_sd": s,
                    "interval": interval if np.isfinite(s) else [None, None],
                }
            )
        falls = zip(self.counts, self._worst, strict=True)
        data = {
            "schema": "cartstiff-identify-plan/1",
            "criterion": self.criterion,
            "rows": len(self.rows),
            "level": self.level,
            "parameters": rows,
            "geometry": [{"name": g.name, "unit": g.unit, "sd": g.sd} for g in self.geometry],
            "by_rows": [{"rows": n, "worst_relative_sd": worst} for n, worst in falls],
            "not_identifiable": self.lost,
            "notes": [note.to_dict() for note in self.unknowns.elements.elastic.notes],
        }
        return plain_dict(data)

    def plot(self) -> Any:
        """Draw the largest standard deviation of a stiffness over the number of rows.

        Returns
        -------
        matplotlib.figure.Figure

        Raises
        ------
        MissingDependencyError
            Without matplotlib.
        """
        figure, axis = new_axes()
        axis.plot(self.counts, 100.0 * self._worst, "o-")
        axis.set(xlabel="rows", ylabel="largest standard deviation [%]", yscale="log")
        return figure

    @property
    def factor(self) -> float:
        """Half width of an interval over the standard deviation, at the full number of rows."""
        return float(self.factors[-1])

    @property
    def worst(self) -> float:
        """Largest relative standard deviation with all rows, of the springs that rows determine."""
        return float(self._worst[-1])

    @property
    def _worst(self) -> Array:
        known = [p for p, n in enumerate(self.unknowns.names) if n not in self.lost]
        return self.deviations[:, known].max(axis=1)


def information(unknowns: Unknowns, measured: Measurements, geometry: Sequence[str] = ()) -> Array:
    """G (N, T, T) of each row, of compliances in shares of their values, and of `geometry`."""
    return _per_row(unknowns, measured, geometry)[0]


def _regressor(
    unknowns: Unknowns, measured: Measurements, geometry: Sequence[str]
) -> tuple[Model, Array, Array, Array]:
    """Model, displacements (m,), and columns over deviations (m, T): the fit's, and of sessions."""
    model = model_of(unknowns, measured)
    seen, elastic = model.observations, unknowns.elements.elastic
    y, A = model.at(unknowns.nominal)
    if np.isnan(seen.deviation).any():
        raise InputError(
            "a plan needs standard deviations",
            where="--sd",
            expected="one for each column that is measured",
        )
    sought = unknowns if seen.is_absolute.any() else replace(unknowns, geometry=())
    offsets = offsets_of(sought, seen, measured)
    first = len(offsets.names) - len(offsets.geometry)
    place = {name: i for i, name in enumerate(offsets.geometry, start=first)}
    columns = offsets.columns / seen.deviation[:, None]
    more = np.zeros((len(seen), len(geometry)))
    for i, name in enumerate(geometry):
        if name in place:
            more[:, i] = columns[:, place[name]] * _SMALL * size_of(elastic, name)
    own = np.hstack([A * (unknowns.sizes / seen.deviation[:, None]), more])
    others = [i for i in range(len(offsets.names)) if i < first or offsets.names[i] not in geometry]
    return model, y, own, columns[:, others]


def _per_row(
    unknowns: Unknowns, measured: Measurements, geometry: Sequence[str]
) -> tuple[Array, Array]:
    """G, and the largest motion of each row (N,): rad, or shares of the mechanism's length."""
    model, y, scaled, _ = _regressor(unknowns, measured, geometry)
    seen, elastic = model.observations, unknowns.elements.elastic
    G = np.zeros((len(measured), scaled.shape[1], scaled.shape[1]))
    np.add.at(G, seen.row, scaled[:, :, None] * scaled[:, None, :])
    size = np.where(seen.is_angle, 1.0, elastic.mechanism.at(elastic.q).length)
    moved = np.zeros(len(measured))
    np.maximum.at(moved, seen.row, np.abs(y) / size)
    return G, moved


def plan(
    unknowns: Unknowns,
    offered: Measurements,
    count: int,
    *,
    criterion: Literal["worst", "all", "posture"] = "worst",
    test: tuple[Array, Array] | None = None,
    have: Measurements | None = None,
    beside: Beside | None = None,
    level: float = 0.95,
) -> Plan:
    """Choose rows from candidates.

    Parameters
    ----------
    unknowns : Unknowns
        Parameters; zeros, tool and base that are sought are separated from them.
    offered : Measurements
        From `candidates`, with standard deviations.
    count : int
        Rows to choose; a candidate is taken again only where all are taken.
    criterion : {"worst", "all", "posture"}
        Quantity that is minimised: the widest interval (worst), the determinant of all compliances
        (all: D-optimal), or the deflection at a posture under a load (posture).
    test : (q, wrench), optional
        The user's posture (n,) and wrench (6,) on M along F, for "posture".
    have : Measurements, optional
        Rows that are measured already, with standard deviations; the plan adds to them.
    beside : callable, optional
        Neighbours of rows, see `cartstiff.identify.plan.beside`: the chosen rows are moved to the
        best of these.
    level : float
        Probability of the predicted intervals.

    Raises
    ------
    InputError
        For fewer rows than one, no posture to test, or candidates without information.
    """
    if criterion not in CRITERIA:
        raise UnknownNameError("criterion", criterion, CRITERIA, where="--criterion")
    if count < 1:
        raise InputError(
            "number of rows cannot be used", where="--plan", expected="1 or more", got=count
        )
    P, elastic = len(unknowns.parameters), unknowns.elements.elastic
    geometry = model_of(unknowns, offered).offsets.geometry
    whole, moved = _per_row(unknowns, offered, geometry)
    most = max(_LARGE_DISPLACEMENT, _TIMES_MEDIAN * float(np.median(moved)))
    offered, whole = offered.chosen(moved <= most), whole[moved <= most]
    priors = unknowns.priors[0] * unknowns.sizes
    start, others = np.zeros(whole.shape[1:]), len(priors)
    start[:P, :P] = priors.T @ priors
    if have is not None:
        _, _, own, sessions = _regressor(unknowns, have, geometry)
        own = own - sessions @ np.linalg.lstsq(sessions, own, rcond=None)[0]
        start += own.T @ own
        others += len(own) - sessions.shape[1]
    known = np.isfinite(_deviations_of(whole.sum(axis=0) + start))
    others -= int(known.sum())
    known[P:] = False
    if not known.any():
        raise InputError(
            "no candidate tells anything about a spring",
            expected="other loads, or columns to be measured",
        )

    def of_rows(rows: Measurements) -> Array:
        information, moved = _per_row(unknowns, rows, geometry)
        return np.where((moved <= most)[:, None, None], information, 0.0)

    one = float(np.median(np.trace(whole, axis1=1, axis2=2))) / len(start)
    faint = numerics.PRIOR_INFORMATION_SHARE * one * np.eye(len(start))
    effects = None
    if criterion == "posture":
        if test is None:
            raise InputError(
                "the criterion needs a posture and a load",
                where="--criterion",
                expected="--q and --load",
            )
        effects = _effects(unknowns, *test)[:, known[:P]]
        if not effects.any():
            raise InputError("the load of the test posture moves nothing", where="--load")
    cost = _cost_of(criterion, known, effects)
    ways = [cost]
    if criterion == "worst":
        ways = [*(_cost_of(criterion, known, None, norm) for norm in _NORMS), cost]
    order = _greedy(whole, start + faint, count, cost)
    chosen = order
    for way in ways:
        chosen, _ = _exchanged(
            whole, start + faint, chosen, way, lambda _, others: _free(len(whole), others)
        )
    rows = offered.taken(chosen)
    if beside is not None:
        rows = _refined(rows, of_rows, beside, start + faint, ways)
    final = start + of_rows(rows).sum(axis=0)
    sums = [start + whole[order[:n]].sum(axis=0) for n in range(1, count)]
    spreads = np.array([_deviations_of(M) for M in (*sums, final)])
    counts = np.arange(1, count + 1)
    degrees = np.maximum(counts * len(offered.values) + others, 1)
    predicted = spreads[-1, P:] * [_SMALL * size_of(elastic, n) for n in geometry]
    return Plan(
        unknowns,
        rows,
        criterion,
        counts,
        np.where(known[:P], spreads[:, :P], np.inf),
        np.array([quantile(level, d) for d in degrees]),
        tuple(n for n, is_known in zip(unknowns.names, known, strict=False) if not is_known),
        level,
        tuple(
            OffsetEstimate(n, unit_of(elastic, n), None, s if np.isfinite(s) else None, None)
            for n, s in zip(geometry, predicted.tolist(), strict=True)
        ),
    )


def _deviations_of(M: Array) -> Array:
    """Standard deviations (T,) from an information; infinite where it does not determine one."""
    size = np.sqrt(np.diag(M))
    there = size > numerics.RANK * size.max(initial=0.0)
    scale = np.where(there, 1.0 / np.where(there, size, 1.0), 0.0)
    values, vectors = np.linalg.eigh(M * scale[:, None] * scale)
    good = values > numerics.ROUNDOFF * values.max()
    seen = there & (np.linalg.norm(vectors[:, ~good], axis=1) <= numerics.ROUNDOFF**0.25)
    spread = scale * np.linalg.norm(vectors[:, good] / np.sqrt(values[good]), axis=1)
    return np.where(seen, spread, np.inf)


def _effects(unknowns: Unknowns, q: Array, wrench: Array) -> Array:
    """Displacement (3, P) of M at a posture per share of each compliance."""
    one = Measurements(
        q[None],
        wrench[None],
        values={n: np.zeros(1) for n in DISPLACEMENT},
        deviations={n: np.ones(1) for n in DISPLACEMENT},
    )
    return model_of(unknowns, one).at(unknowns.nominal)[1] * unknowns.sizes


def _cost_of(
    criterion: str, known: NDArray[np.bool_], effects: Array | None, norm: float = np.inf
) -> Cost:
    """Cost (k,) of informations (k, T, T), of the known parameters (T,)."""

    def of(M: Array) -> Array:
        inverse = np.linalg.inv(M)[:, known][:, :, known]
        if criterion == "all":
            sign, value = np.linalg.slogdet(inverse)
            return np.where(sign > 0, value, np.inf)
        if effects is not None:
            return np.einsum("ip,kpr,ir->k", effects, inverse, effects)
        return np.asarray(np.linalg.norm(inverse.diagonal(0, 1, 2), norm, axis=1))

    return of


def _greedy(G: Array, start: Array, count: int, cost: Cost) -> list[int]:
    """Candidates, each the one that reduces the cost most after those before it."""
    M, chosen = start.copy(), list[int]()
    for _ in range(count):
        free = _free(len(G), chosen)
        chosen.append(int(free[np.argmin(cost(M + G[free]))]))
        M = M + G[chosen[-1]]
    return chosen


def _free(offered: int, chosen: list[int]) -> NDArray[np.intp]:
    """Candidates that are not chosen, as a repeated row reduces the noise alone; else all."""
    every = np.arange(offered)
    free = np.setdiff1d(every, chosen)
    return free if free.size else every


def _exchanged(
    G: Array,
    start: Array,
    chosen: list[int],
    cost: Cost,
    allowed: Callable[[int, list[int]], NDArray[np.intp]],
    passes: int = _MAX_PASSES,
) -> tuple[list[int], float]:
    """Rows, each exchanged for the one allowed beside the others that reduces the cost most."""
    chosen = list(chosen)
    M = start + G[chosen].sum(axis=0)
    now = float(cost(M[None])[0])
    for _ in range(passes):
        before = now
        for i, old in enumerate(chosen):
            mine = allowed(i, [*chosen[:i], *chosen[i + 1 :]])
            costs = cost(M - G[old] + G[mine])
            if mine.size and costs.min() < now - numerics.REPORTED_ERROR * abs(now):
                chosen[i], now = int(mine[np.argmin(costs)]), float(costs.min())
                M = M - G[old] + G[chosen[i]]
        if not now < before:
            break
    return chosen, now


def _refined(
    rows: Measurements,
    information: Callable[[Measurements], Array],
    beside: Beside,
    start: Array,
    ways: list[Cost],
) -> Measurements:
    """Rows moved, each to the best of many neighbours, at decreasing distances.

    Parameters
    ----------
    rows : Measurements
        Chosen.
    information : callable
        Informations (N, P, P) of rows.
    beside : callable
        Neighbours of rows; the first of each is the row itself.
    start : ndarray (P, P)
        Further information.
    ways : list of callable
        Costs; the last one decides.

    Returns
    -------
    Measurements
        No worse than those given.
    """
    rng, best = np.random.default_rng(0), rows
    least = float(ways[-1]((start + information(rows).sum(axis=0))[None])[0])
    for share in _SHARES:
        near, owner = beside(rows, share, rng)
        try:
            G = information(near)
        except CartstiffError:  # a posture without a stiffness
            continue
        at = np.unique(owner, return_index=True)[1].tolist()

        def different(i: int, others: list[int], near: Any = near, owner: Any = owner) -> Any:
            mine = np.flatnonzero(owner == i)
            return mine[_are_different(near, mine, np.array(others, np.intp))]

        for way in ways[-2:]:
            at, reached = _exchanged(G, start, at, way, different, passes=1)
        rows = near.taken(at)
        if reached < least:
            best, least = rows, reached
    return best


def _are_different(
    near: Measurements, mine: NDArray[np.intp], others: NDArray[np.intp]
) -> NDArray[np.bool_]:
    """Rows `mine` unlike all others: other postures, or loads along other lines."""
    spans = np.ptp(near.q, axis=0)
    spans[spans == 0.0] = np.inf
    far = np.abs(near.q[mine, None] - near.q[others]) / spans
    loads = near.wrench / np.maximum(np.linalg.norm(near.wrench, axis=1), numerics.TINY)[:, None]
    crossed = np.abs(loads[mine] @ loads[others].T) < 0.5
    crossed &= loads[others].any(axis=1)
    return np.asarray((crossed | (far.max(axis=2) > _LEAST_DISTANCE)).all(axis=1))
