"""Rows that could be measured: random candidates, places beside chosen ones, and what they show."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import pi

import numpy as np
from numpy.typing import NDArray

from cartstiff import numerics
from cartstiff.arrays import Array, checked_seed
from cartstiff.errors import ConvergenceError, InputError, UnknownNameError
from cartstiff.identify.loaded_model import model_of
from cartstiff.identify.measurements import MEASURED, POSITION, TURN, Measurements
from cartstiff.identify.unknowns import unknowns_of
from cartstiff.mechanisms.chain import Chain
from cartstiff.mechanisms.elastic import ElasticMechanism
from cartstiff.mechanisms.platform import Platform


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
    """What a mechanism with these springs would show in given settings.

    Parameters
    ----------
    elastic : ElasticMechanism
        Its springs are the truth.
    settings : Measurements
        Postures and loads; what was measured does not count.
    deviations : mapping of str to float
        Columns that are measured, each with the standard deviation of its noise, in the
        mechanism's units.
    seed : int
        Seed of the noise.
    loaded : bool
        Move as the equilibrium under load, not linearly in it.
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
    for name in deviations:
        if name not in MEASURED or name in TURN:
            raise InputError(
                "column cannot be simulated",
                got=repr(name),
                expected=", ".join(n for n in MEASURED if n not in TURN),
            )
    N, rng = len(settings), np.random.default_rng(checked_seed(seed))
    nothing = {name: np.zeros(N) for name in deviations}
    spread = {name: np.full(N, s) for name, s in deviations.items()}
    blank = replace(settings, values=nothing, deviations=spread, session=())
    unknowns = unknowns_of(elastic, ("all",))
    model = model_of(unknowns, blank, loaded)
    y, _ = model.at(unknowns.nominal)
    seen = model.observations
    sign = np.where(rng.random(N) < 0.5, -1.0, 1.0)
    gross = np.zeros(N)
    gross[list(outliers)] = outlier_size * sign[list(outliers)]
    values = {name: np.full(N, np.nan) for name in deviations}
    for i in range(len(seen)):
        # The target of a position, from zeros, is less the rigid one: taken away again.
        rigid = -seen.target[i] if seen.column[i] in POSITION else 0.0
        error = rng.normal() + gross[seen.row[i]]
        values[seen.column[i]][seen.row[i]] = rigid + y[i] + error * deviations[seen.column[i]]
    exact: dict[str, Array] = (
        spread if tell_deviations else {name: np.full(N, np.nan) for name in deviations}
    )
    return replace(settings, values=values, deviations=exact)


# Of a joint without limits, and of a platform about its file's pose [rad; shares of its size].
_AXES = ("x", "y", "z")
_RANGE, _TILT, _SHIFT = pi, 0.3, 0.2
_TRIES = 20
# Places beside a row that are tried at once, in all; of a mechanism whose postures take time.
_BESIDE, _SLOW = 1000, 150


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
    """Random postures that can be reached and seen, each with a load.

    Parameters
    ----------
    elastic : ElasticMechanism
        Its joint limits hold.
    deviations : mapping of str to float
        What would be measured, with standard deviations, in the mechanism's units.
    count, seed : int
        Number of candidates, and the seed of the draw.
    mass : float
        Hung at `load_at`, in kg, pulling along gravity.
    force : float
        Pushed with along +-x, +-y or +-z of F, drawn for each posture, where no mass is hung.
    ranges : mapping of str to (low, high), optional
        Narrower than the joints' limits.
    within : mapping of str to (low, high), optional
        Range of the measured point's x, y, z in F: the volume that is seen, and may be entered.
    point, load_at : tuple of 3 floats
        As in `read_measurements`.

    Raises
    ------
    InputError
        If nothing acts, a column cannot be measured, or no posture is left.
    """
    if not (mass > 0.0 or force > 0.0):
        raise InputError("no load is planned", expected="a mass to hang, or a force to push with")
    for name in deviations:
        if name not in MEASURED or name in TURN:
            raise InputError(
                "column cannot be planned",
                got=repr(name),
                expected=", ".join(n for n in MEASURED if n not in TURN),
            )
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
    for _ in range(_TRIES * count):
        q = _posture(elastic, rng.uniform(low, high))
        if q is not None and _is_within(elastic, q, box, point):
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
        np.zeros(N),
        "world",
        {name: np.zeros(N) for name in deviations},
        {name: np.full(N, s) for name, s in deviations.items()},
        direction if "d" in deviations else np.full((N, 3), np.nan),
        (),
        np.full(N, np.nan),
        point,
        point if load_at is None else load_at,
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
    """Rows that could be measured near others: postures moved, forces along each axis of F.

    Parameters
    ----------
    elastic : ElasticMechanism
        As in `candidates`.
    rows : Measurements
        From `candidates`.
    share : float
        Of the ranges, by which postures are moved (standard deviation), and gauges are turned.
    rng : Generator
        Of random numbers.
    ranges, within
        As in `candidates`.

    Returns
    -------
    near : Measurements
        Each row, followed by those near it.
    owner : ndarray of int
        Which of the given rows each belongs to.
    """
    low, high = _ranges(elastic, ranges or {})
    chain = elastic.mechanism
    quick = isinstance(chain, Chain) and not chain.closures
    each = max((_BESIDE if quick else _SLOW) // len(rows), 3)
    owner, q, wrench, direction = [], [], [], []
    for i, centre in enumerate(rows.q):
        W, gauge = rows.wrench[i], rows.direction[i]
        loads = [(centre, W, gauge)]
        forces = W[None]
        if W.any():
            forces = np.hstack([np.zeros((3, 3)), np.eye(3) * np.linalg.norm(W[3:])])
        for step in share * (high - low) * rng.normal(size=(each, len(low))):
            at = _posture(elastic, np.clip(centre + step, low, high))
            if at is None or not _is_within(elastic, at, within or {}, rows.point):
                continue
            turned = gauge + 2.0 * pi * share * rng.normal(size=3)
            loads += [(at, force, turned / np.linalg.norm(turned)) for force in forces]
        owner += [i] * len(loads)
        for where, force, along in loads:
            q.append(where)
            wrench.append(force)
            direction.append(along)
    at = np.array(owner, np.intp)
    near = rows.chosen(at)
    return replace(
        near,
        q=np.array(q),
        wrench=np.array(wrench),
        direction=np.array(direction),
        rows=np.arange(1, len(at) + 1),
    ), at


def _is_within(
    elastic: ElasticMechanism,
    q: Array,
    box: Mapping[str, Sequence[float]],
    point: tuple[float, float, float],
) -> bool:
    """Whether the measured point is in the volume."""
    if not box:
        return True
    pose = elastic.mechanism.at(q).pose
    at = pose[:3, 3] + pose[:3, :3] @ np.asarray(point)
    return all(limits[0] <= at[_AXES.index(a)] <= limits[1] for a, limits in box.items())


def _ranges(
    elastic: ElasticMechanism, ranges: Mapping[str, Sequence[float]]
) -> tuple[Array, Array]:
    """Lowest and highest coordinates; those that follow others stay where they are."""
    mechanism = elastic.mechanism
    low, high = elastic.q.copy(), elastic.q.copy()
    free = np.ones(len(low), bool)
    if isinstance(mechanism, Chain):
        free[list(mechanism.virtual)] = False
        if mechanism.closures:
            free[:] = False
            free[list(mechanism.actuated or ())] = True
    for j, c in enumerate(mechanism.coordinates):
        if not free[j]:
            continue
        if isinstance(mechanism, Platform):
            width = _TILT if not c.is_length else _SHIFT * mechanism.length
            low[j], high[j] = elastic.q[j] - width, elastic.q[j] + width
            continue
        width = 0.5 * mechanism.at(elastic.q).length if c.is_length else _RANGE
        looped = isinstance(mechanism, Chain) and bool(mechanism.closures)
        width = 0.3 * width if looped else width
        centre = elastic.q[j] if looped or not np.isfinite(c.lower + c.upper) else 0.0
        low[j] = c.lower if np.isfinite(c.lower) and not looped else centre - width
        high[j] = c.upper if np.isfinite(c.upper) and not looped else centre + width
        if not looped and not c.is_length:  # further than a turn away is the same posture
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


def _posture(elastic: ElasticMechanism, q: Array) -> Array | None:
    """The posture, assembled; None where that fails."""
    if isinstance(elastic.mechanism, Chain) and elastic.mechanism.closures:
        held = elastic.mechanism.held
        try:
            closed = elastic.mechanism.closed(q).q
        except ConvergenceError:
            return None
        # Where motors or links had to give way, they do not stand there unstressed.
        return (
            closed
            if np.abs(closed[held] - q[held]).max(initial=0.0) < numerics.REPORTED_ERROR
            else None
        )
    return q
