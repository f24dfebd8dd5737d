"""Choice of the postures and loads to measure.

Each candidate adds ``G_i = sum a a^T / s^2`` to the information M of the compliances, in
shares of their present values, and of the zeros, tool and base that are sought: the
columns are those of the fit. C is the compliances' part of ``M^-1``, so that what else is
sought is separated from them. Three criteria:

* worst: the smallest widest interval, ``max_j C_jj``;
* all: the smallest determinant of C (D-optimal, [AtkinsonDonev]_); the widest interval
  may then be nearly as wide as that of random rows;
* posture: the smallest error of the deflection at the user's own posture under the user's
  own load, ``tr(L C L^T)`` (test-pose criterion, [KlimchikTestPose]_).

The rows are chosen greedily: each is the candidate that reduces the cost most beside
those before. The widest interval may depend on a later row alone, so that rows for the
sum of all variances are chosen, too, and the better ones of both are taken.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import pi
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from cartstiff.core import numerics
from cartstiff.core.arrays import Array, checked_seed, plain_dict
from cartstiff.core.errors import (
    ConvergenceError,
    InputError,
    UndefinedError,
    UnknownNameError,
)
from cartstiff.core.figures import new_axes
from cartstiff.core.mechanisms.elastic import ElasticMechanism
from cartstiff.core.mechanisms.identified import quantile
from cartstiff.core.results import LabelledResult
from cartstiff.wings.identify.measurements import (
    DISPLACEMENT,
    MEASURED,
    TURN,
    Measurements,
    assembled,
)
from cartstiff.wings.identify.models import model_of
from cartstiff.wings.identify.unknowns import (
    LEVEL,
    OffsetEstimate,
    Unknowns,
    size_of,
    unit_of,
)

_AXES = ("x", "y", "z")
# Half ranges: of a joint without limits, and of a platform about its file's pose [rad;
# shares of its size].
_RANGE, _TILT, _SHIFT = pi, 0.3, 0.2
# Random postures drawn per candidate wanted.
_DRAWS_PER_CANDIDATE = 20


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
        Force on the body [N], for each posture along one of the axes +-x, +-y and +-z of
        F; without a mass.
    ranges : mapping of str to (low, high), optional
        Ranges of joints, narrower than their limits.
    within : mapping of str to (low, high), optional
        Range of the measured point's x, y, z in F: the volume that can be measured and
        entered.
    point, load_at : tuple of 3 floats
        As in `read_measurements`.

    Raises
    ------
    InputError
        If there is no load, a column cannot be measured, or no posture remains.
    """
    if not (mass > 0.0 or force > 0.0):
        raise InputError(
            "no load is planned", expected="a mass to hang, or a force to push with"
        )
    for name in deviations:
        if name not in MEASURED or name in TURN:
            raise InputError(
                "column cannot be planned",
                got=repr(name),
                expected=", ".join(n for n in MEASURED if n not in TURN),
            )
    # Postures within the ranges and the volume.
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
    # Loads and directions.
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


def _allowed(
    elastic: ElasticMechanism,
    q: Array,
    box: Mapping[str, Sequence[float]],
    point: tuple[float, float, float],
) -> Array | None:
    """The assembled posture; None if that fails, or the measured point is not
    in the volume.
    """
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
        if mechanism.coordinates_are_pose:
            reach = mechanism.at(elastic.q).length
            width = _TILT if not c.is_length else _SHIFT * reach
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
# Rows that move by more than this share of the mechanism, and this many times the median,
# are near a singularity, where displacements are not small.
_LARGE_DISPLACEMENT, _TIMES_MEDIAN = 0.05, 10.0

#: Costs (k,) of informations (k, P, P).
Cost = Callable[[Array], Array]

# Natural size of zeros and offsets: rad, and shares of the mechanism.
_SMALL = 1e-3


@dataclass(frozen=True, eq=False, repr=False)
class Plan(LabelledResult):
    """Rows to be measured, and the predicted intervals.

    Attributes
    ----------
    unknowns : Unknowns
        Parameters.
    rows : Measurements
        The chosen postures and loads, in the order of their choice, without measured
        numbers.
    criterion : str
        Name of the choice.
    counts : ndarray of int (k,)
        Numbers of rows for which intervals are predicted.
    deviations : ndarray (k, P)
        Predicted standard deviations, in shares of the compliances; infinite where not
        determined.
    factors : ndarray (k,)
        Half width of an interval over the standard deviation, at each number of rows.
    lost : tuple of str
        Springs that no candidate determines by themselves.
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
    geometry: tuple[OffsetEstimate, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """For JSON."""
        rows = []
        for u, s in zip(
            self.unknowns.parameters, self.deviations[-1].tolist(), strict=True
        ):
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
            "level": LEVEL,
            "parameters": rows,
            "geometry": [
                {"name": g.name, "unit": g.unit, "sd": g.sd} for g in self.geometry
            ],
            "by_rows": [{"rows": n, "worst_relative_sd": worst} for n, worst in falls],
            "not_identifiable": self.lost,
            "notes": [note.to_dict() for note in self.unknowns.elastic.notes],
        }
        return plain_dict(data)

    def plot(self, ax: Any = None) -> Any:
        """Draw the largest standard deviation of a stiffness over the number of rows.

        Parameters
        ----------
        ax : matplotlib.axes.Axes, optional
            Whose place the picture takes; default a figure of its own.

        Returns
        -------
        matplotlib.figure.Figure

        Raises
        ------
        MissingDependencyError
            Without matplotlib.
        """
        figure, axis = new_axes(ax=ax)
        axis.plot(self.counts, 100.0 * self._worst, "o-")
        axis.set(xlabel="rows", ylabel="largest standard deviation [%]", yscale="log")
        return figure

    @property
    def factor(self) -> float:
        """Half width of an interval over the standard deviation,
        at the full number of rows.
        """
        return float(self.factors[-1])

    @property
    def worst(self) -> float:
        """Largest relative standard deviation with all rows,
        of the springs that rows determine.
        """
        return float(self._worst[-1])

    @property
    def _worst(self) -> Array:
        known = [p for p, n in enumerate(self.unknowns.names) if n not in self.lost]
        return self.deviations[:, known].max(axis=1)


def information(
    unknowns: Unknowns, measured: Measurements, geometry: Sequence[str] = ()
) -> Array:
    """G (N, T, T) of each row, of compliances in shares of their values,
    and of `geometry`.
    """
    return _per_row(unknowns, measured, geometry)[0]


def _per_row(
    unknowns: Unknowns, measured: Measurements, geometry: Sequence[str]
) -> tuple[Array, Array]:
    """G, and the largest motion of each row (N,): rad, or shares of the
    mechanism's length.
    """
    model = model_of(unknowns, measured)
    seen, elastic = model.observations, unknowns.elastic
    y, A = model.at(unknowns.nominal)
    if np.isnan(seen.deviation).any():
        raise InputError(
            "a plan needs standard deviations",
            where="--sd",
            expected="one for each column that is measured",
        )
    more = [
        _SMALL
        * size_of(elastic, name)
        * model.offsets.columns.T[model.offsets.names.index(name)]
        for name in geometry
    ]
    scaled = np.column_stack([A * unknowns.sizes, *more]) / seen.deviation[:, None]
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
        Quantity that is minimised: the widest interval (worst), the determinant of all
        compliances (all: D-optimal), or the deflection at a posture under a load
        (posture).
    test : (q, wrench), optional
        The user's posture (n,) and wrench (6,) on M along F, for "posture".

    Raises
    ------
    InputError
        For fewer rows than one, no posture to test, or candidates without information.
    """
    if criterion not in CRITERIA:
        raise UnknownNameError("criterion", criterion, CRITERIA, where="--criterion")
    if count < 1:
        raise InputError(
            "number of rows cannot be used",
            where="--plan",
            expected="1 or more",
            got=count,
        )
    P, elastic = len(unknowns.parameters), unknowns.elastic
    geometry = model_of(unknowns, offered).offsets.geometry
    # The information of each row; rows that move far are left out.
    whole, moved = _per_row(unknowns, offered, geometry)
    most = max(_LARGE_DISPLACEMENT, _TIMES_MEDIAN * float(np.median(moved)))
    offered, whole = offered.chosen(moved <= most), whole[moved <= most]
    known = np.isfinite(_deviations_of(whole.sum(axis=0)))
    fitted = int(known.sum())
    known[P:] = False
    if not known.any():
        raise InputError(
            "no candidate tells anything about a spring",
            expected="other loads, or columns to be measured",
        )

    one = float(np.median(np.trace(whole, axis1=1, axis2=2))) / len(known)
    faint = numerics.PRIOR_INFORMATION_SHARE * one * np.eye(len(known))
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
    # The rows, one after the other, and what is known after each.
    cost = _cost_of(criterion, known, effects)
    ways = (cost, _cost_of("sum", known, effects)) if criterion == "worst" else (cost,)
    orders = [_greedy(whole, faint, count, way) for way in ways]
    order = min(orders, key=lambda rows: cost((faint + whole[rows].sum(axis=0))[None])[0])
    spreads = np.array([_deviations_of(M) for M in np.cumsum(whole[order], axis=0)])
    counts = np.arange(1, count + 1)
    degrees = np.maximum(counts * len(offered.values) - fitted, 1)
    predicted = spreads[-1, P:] * [_SMALL * size_of(elastic, n) for n in geometry]
    return Plan(
        unknowns,
        offered.taken(order),
        criterion,
        counts,
        np.where(known[:P], spreads[:, :P], np.inf),
        np.array([quantile(LEVEL, d) for d in degrees]),
        tuple(
            n for n, is_known in zip(unknowns.names, known, strict=False) if not is_known
        ),
        tuple(
            OffsetEstimate(
                n, unit_of(elastic, n), None, s if np.isfinite(s) else None, None
            )
            for n, s in zip(geometry, predicted.tolist(), strict=True)
        ),
    )


def _deviations_of(M: Array) -> Array:
    """Standard deviations (T,) from an information.

    Infinite where it does not determine one.
    """
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


def _cost_of(criterion: str, known: NDArray[np.bool_], effects: Array | None) -> Cost:
    """Cost (k,) of informations (k, T, T), of the known parameters (T,)."""

    def of(M: Array) -> Array:
        inverse = np.linalg.inv(M)[:, known][:, :, known]
        if criterion == "all":
            sign, value = np.linalg.slogdet(inverse)
            return np.where(sign > 0, value, np.inf)
        if effects is not None:
            return np.einsum("ip,kpr,ir->k", effects, inverse, effects)
        variances = inverse.diagonal(0, 1, 2)
        return np.asarray(
            variances.sum(axis=1) if criterion == "sum" else variances.max(axis=1)
        )

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
    """Candidates that are not chosen, as a repeated row reduces the noise alone;
    else all.
    """
    every = np.arange(offered)
    free = np.setdiff1d(every, chosen)
    return free if free.size else every
