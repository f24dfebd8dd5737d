"""The input of a page: mechanism, posture, load, trajectory and map."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from math import prod
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from cartstiff.core import numerics
from cartstiff.core.arrays import Array, named_values
from cartstiff.core.errors import InputError, one_line
from cartstiff.core.geometry import se3
from cartstiff.core.geometry.connections import Connection
from cartstiff.core.matrix_names import LETTERS
from cartstiff.core.mechanisms.elastic import ElasticMechanism
from cartstiff.core.mechanisms.limits import Limits
from cartstiff.core.units import LENGTHS, SI, Units
from cartstiff.files.identity import fingerprint
from cartstiff.files.parsing import parse_numbers
from cartstiff.files.tables import named_unit, read_cells, read_rows
from cartstiff.kinematics.at_pose import at_poses
from cartstiff.recorded.recording import analyse_many

if TYPE_CHECKING:
    from cartstiff.wings.reach.workspace import Workspace

# A page draws and sends every point: more are thinned.
_MOST_POINTS = 20_000
# Each carries its posture: 1.6 MB of these at most.
_MOST_COORDINATES = 200_000
# Largest number of postures of a map whose points are shown: all are read.
_MOST_READ = 10**7
# Postures of a map that are read at a time.
_AT_ONCE = 1_000_000
_MOST_POSTURES = 5_000
# Parts of a mechanism on which its numbers depend, besides the posture.
_MODEL = ("mechanism", "springs", "potentials", "gravity", "damping")
# Names of the quantity that colours the boundary of a workspace, and of singular points.
_CUTS = "limit that cuts"
_SINGULAR = "singular surface"
_SOFTEST = "softest stiffness"
# Kinds of limits that a picture tells apart.
_MOST_KINDS = 5
# Postures at which no program knows the stiffness: so many are analysed one by one.
_ONE_BY_ONE = 300


@dataclass(frozen=True, eq=False)
class Playback:
    """Postures in order, with their times.

    Attributes
    ----------
    q : ndarray (N, n)
        Coordinates.
    time : ndarray (N,)
        Seconds, or the postures' numbers where no times are known.
    timed : bool
        Whether `time` is in seconds.
    unused : tuple of str
        Other columns of the file.
    """

    q: Array
    time: Array
    timed: bool = False
    unused: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Cloud:
    """Points of a map, or of a workspace's boundary, with what may colour them.

    Attributes
    ----------
    positions : ndarray (N, 3)
        In F.
    values : mapping of str to ndarray (N,)
        By quantity; NaN where one does not exist. Or words: of a boundary the limit that
        cuts.
    units : mapping of str to str
        By quantity.
    thinned : int
        How far apart in the file the points are that are kept: 1 keeps all, 2 every
        second.
    q : ndarray (N, n) or None
        Coordinates of each point; None where the points are no postures of the mechanism.
    better : mapping of str to {"larger", "smaller"}
        By quantity, which values are good, if any are.
    """

    positions: Array
    values: Mapping[str, NDArray[Any]]
    units: Mapping[str, str]
    thinned: int = 1
    q: Array | None = None
    better: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Source:
    """The input of a page; no tab changes it.

    Attributes
    ----------
    elastic : ElasticMechanism
        The mechanism.
    q : ndarray (n,) or None
        Posture shown at first; default the mechanism's.
    load : ndarray (6,) or None
        Wrench shown at first.
    load_kind, load_at, load_axes
        Its behaviour, point and axes, as in `cartstiff.shown.page.messages.ViewState`.
    command : list of float or None
        Commands of the drives at first, one number a spring.
    connections : tuple of Connection
        The user's own, beside the named ones.
    trajectory : Playback or None
        Postures for the time slider.
    cloud : Cloud or None
        Points of a map.
    """

    elastic: ElasticMechanism
    q: Array | None = None
    load: Array | None = None
    trajectory: Playback | None = None
    cloud: Cloud | None = None
    load_kind: Literal["dead", "follower", "conservative"] = "dead"
    load_at: tuple[float, float, float] | None = None
    load_axes: Literal["body", "world"] = "body"
    command: list[float] | None = None
    connections: tuple[Connection, ...] = ()

    def __post_init__(self) -> None:
        names = [*LETTERS, *(own.name for own in self.connections)]
        for own in self.connections:
            if names.count(own.name) > 1:
                raise InputError(
                    "two connections have this name", where="connections", got=own.name
                )
            if not own.left_invariant:
                raise InputError(
                    "the connection is known at one posture only",
                    where=f"connections, {own.name}",
                    expected="the same symbols at every pose",
                )

    @cached_property
    def fingerprint(self) -> str | None:
        """Of the model and of the load at first, by which a link knows its page again.

        None where own code cannot be told apart.
        """
        elastic = self.elastic
        model = {name: getattr(elastic, name) for name in _MODEL}
        load = self.load, self.load_kind, self.load_at, self.load_axes, self.command
        with suppress(InputError):
            return fingerprint([model, load])[:12]
        return None


def changed(
    elastic: ElasticMechanism,
    stiffness: Sequence[float | None] | None,
    payload: Sequence[float] | None,
    gravity: Sequence[float] | None,
) -> ElasticMechanism:
    """The mechanism with other springs, a payload and another gravity,
    as a state names them.

    Springs whose number is that of `elastic.stiffnesses` stay as they are, with their
    laws.
    """
    if stiffness is not None:
        given: Any = [np.inf if k is None else k for k in stiffness]
        if elastic.springs is not None:
            present, names = elastic.stiffnesses, elastic.spring_names
            given = named_values(
                given, names, present, "stiffness", infinite=True
            ).tolist()
            known = zip(names, given, present, strict=True)
            given = {name: k for name, k, now in known if k != now} or None
        elastic = elastic.with_springs(given)
    if payload is not None and payload[0]:
        elastic = elastic.with_payload(payload[0], payload[1:])
        if gravity is None and elastic.gravity is None:
            elastic = elastic.with_gravity()  # it weighs
    if gravity is not None:
        elastic = elastic.with_gravity(gravity)
    return elastic


def read_trajectory(
    path: Path,
    names: tuple[str, ...],
    units: Units = SI,
    joints: tuple[str, ...] = (),
) -> Playback:
    """A trajectory from CSV: one posture a line, in joint order or under a line of names.

    The postures have columns `names` (all coordinates), or `joints` if only those are
    given.

    A column named ``t`` or ``time``, or a first one more than there are coordinates, is
    the time in seconds. Lines that start with # are comments.

    Raises
    ------
    InputError
        With file and line.
    """
    rows = read_rows(path, "postures", units=units, joints=names)
    if rows.names is not None:
        named = tuple("time" if x.lower() in ("t", "time") else x for x in rows.names)
        rows = rows._replace(names=named)
    layouts = dict.fromkeys((names, joints or names))
    columns, table, unused = rows.arranged(*layouts, *(("time", *own) for own in layouts))
    where = one_line(str(path))
    if len(table) > _MOST_POSTURES:
        raise InputError(
            "too many postures",
            where=where,
            expected=f"at most {_MOST_POSTURES}",
            got=len(table),
        )
    timed = columns not in layouts
    time = table[:, 0] if timed else np.arange(float(len(table)))
    if np.any(np.diff(time) < 0):
        raise InputError("times must not decrease", where=where)
    return Playback(table[:, int(timed) :], time, timed, unused)


def read_cloud(path: Path | str, elastic: ElasticMechanism) -> Cloud:
    """Points of a map file, or of a table that `cartstiff workspace -o` wrote.

    They are thinned to what a page can show.

    Parameters
    ----------
    path : path or address
        A map, or a table whose name ends in ``.csv``.
    elastic : ElasticMechanism
        Positions of a table are in its units, limits with its bounds; a map of it brings
        the coordinates of each point.

    Raises
    ------
    InputError
        If the file holds no positions or nothing over them.
    """
    if str(path).lower().endswith(".csv"):
        return _read_boundary(Path(path), elastic)
    from cartstiff.wings.maps.reading import map_of_mechanism

    data, differs = map_of_mechanism(path, elastic)
    where = one_line(str(path))
    if "position" not in data:
        raise InputError(
            "map holds no positions", where=where, expected="a variable `position`"
        )
    if prod(data["position"].shape) > 3 * _MOST_READ:
        raise InputError(
            "map is too large to be shown",
            where=where,
            expected=f"at most {_MOST_READ} postures",
            got=prod(data["position"].shape) // 3,
        )
    size = LENGTHS[data["position"].attrs["units"]] / LENGTHS[elastic.units.length]
    position = size * np.asarray(data["position"].values, float)
    shape = position.shape[:-1]
    flat = position.reshape(-1, position.shape[-1])
    values: dict[str, Array] = {}
    units: dict[str, str] = {}
    better: dict[str, str] = {}
    for name, variable in data.data_vars.items():
        if variable.shape == shape and variable.dtype.kind in "fiub" and name != "state":
            shown = f"{name}" + f", map of {', '.join(differs)}" * bool(differs)
            values[shown] = np.asarray(variable.values, float).reshape(-1)
            units[shown] = str(variable.attrs.get("units", ""))
            if "better" in variable.attrs:
                better[shown] = str(variable.attrs["better"])
    if position.shape[-1] != 3 or not values:
        raise InputError(
            "map cannot be shown",
            where=where,
            expected="positions (..., 3) and a quantity over the same postures",
        )
    reached = np.isfinite(flat).all(
        axis=1
    )  # places of a Cartesian grid that no posture reaches
    if not reached.any():
        raise InputError(
            "map holds no posture", where=where, expected="a finite position"
        )
    cloud = _thinned(
        Cloud(
            flat[reached],
            {n: v[reached] for n, v in values.items()},
            units,
            better=better,
        ),
        len(elastic.names),
    )
    joints = data["joint"].values.tolist() if "q" in data else []
    if joints != list(elastic.names):
        return cloud
    q = _rows(data["q"], shape, np.flatnonzero(reached)[:: cloud.thinned])
    return replace(
        cloud, q=q * [size if c.is_length else 1.0 for c in elastic.mechanism.coordinates]
    )


def _rows(table: Any, shape: tuple[int, ...], wanted: Array) -> Array:
    """Rows (N, n) of labelled arrays (*shape, n) by their numbers in order,
    read part by part.
    """
    inner = prod(shape[1:])
    parts = []
    for first in range(0, shape[0], step := max(1, _AT_ONCE // inner)):
        low, high = np.searchsorted(wanted, [first * inner, (first + step) * inner])
        if low < high:
            part = np.asarray(table[first : first + step].values, float)
            parts.append(
                part.reshape(-1, part.shape[-1])[wanted[low:high] - first * inner]
            )
    return np.concatenate(parts)


def _thinned(cloud: Cloud, coordinates: int) -> Cloud:
    """At most as many of its points, with their coordinates, as a page can show."""
    most = min(_MOST_POINTS, max(1, _MOST_COORDINATES // max(1, coordinates)))
    step = max(1, -(-len(cloud.positions) // most))
    values = {name: v[::step] for name, v in cloud.values.items()}
    q = None if cloud.q is None else cloud.q[::step]
    positions = cloud.positions[::step]
    return replace(cloud, positions=positions, values=values, thinned=step, q=q)


def _read_boundary(path: Path, elastic: ElasticMechanism) -> Cloud:
    """Positions on a workspace's boundary, and the limit that cuts at each."""
    cells = read_cells(path, "boundary")
    heads = [named_unit(name, elastic.units, cells.place) for name in cells.names]
    if [name for name, _ in heads] != ["x", "y", "z", "limit"]:
        raise InputError(
            "boundary cannot be shown",
            where=cells.place,
            got=", ".join(cells.names),
            expected="columns x, y, z and limit, as `workspace -o` writes them of "
            "a body that takes all positions",
        )
    numbers = [
        parse_numbers(",".join(row[:3]), place, 3)
        for row, place in zip(cells.rows, cells.places, strict=True)
    ]
    factors = [1.0 if factor is None else factor for _, factor in heads[:3]]
    return _cut(np.array(numbers) * factors, [row[3] for row in cells.rows], elastic)


def cloud_of_workspace(reached: Workspace) -> Cloud:
    """Positions on a workspace's boundary, the limit that cuts at each,
    and singular positions.

    Raises
    ------
    InputError
        For workspaces along other coordinates than x, y, z, and those without a boundary.
    """
    if reached.axes != ("x", "y", "z"):
        raise InputError(
            "the workspace cannot be shown among the mechanism's positions",
            where="workspace",
            expected="a body that takes all positions",
            got=", ".join(reached.axes),
        )
    if reached.positions is None or not reached.positions.limit.size:
        why = "; ".join(note.message for note in reached.notes[-1:])
        raise InputError(
            "the workspace has no boundary", where="workspace", got=why or "none"
        )
    surface = np.empty((0, 3))
    if reached.singular is not None:
        surface = reached.singular.surface
    names = reached.positions.limit.tolist() + [_SINGULAR] * len(surface)
    positions = np.concatenate([reached.boundary, surface])
    return _cut(positions, names, reached.elastic, reached.pose)


def _cut(
    positions: Array,
    names: Sequence[str],
    elastic: ElasticMechanism,
    pose: Array | None = None,
) -> Cloud:
    """A boundary's positions (N, 3): how stiff the body is there, turned as in `pose`,
    and which kind of limit cuts.
    """
    limits = np.array(_kinds_of_limits(names, elastic))
    values, units, q = {_CUTS: limits}, {_CUTS: ""}, None
    better = dict[str, str]()
    if pose is not None:
        q = _coordinates_at(elastic, pose, positions)
        # The first quantity is the one that is shown.
        softest, reached = np.full(len(q), np.nan), np.isfinite(q).all(axis=1)
        softest[reached] = softest_stiffness(elastic, q[reached])
        softest[[name in (_SINGULAR, "singularity") for name in names]] = np.nan
        values = {_SOFTEST: softest, **values}
        units = {_SOFTEST: elastic.units.stiffness["translation"], **units}
        better[_SOFTEST] = "larger"
    coordinates = 0 if q is None else q.shape[1]
    return _thinned(Cloud(positions, values, units, q=q, better=better), coordinates)


def _coordinates_at(elastic: ElasticMechanism, pose: Array, positions: Array) -> Array:
    """Coordinates (N, n) of a body on legs with M at positions, turned as in `pose`; NaN
    where legs do not reach.
    """
    body = pose @ se3.inverse(elastic.mechanism.frame_offset)
    angles = np.tile(se3.roll_pitch_yaw(body), (len(positions), 1))
    places = positions - pose[:3, 3] + body[:3, 3]
    return at_poses(elastic, np.hstack([places, angles]))[0]


def softest_stiffness(elastic: ElasticMechanism, q: Array) -> Array:
    """Least stiffness (N,) against a force, the body free to turn, at postures (N, n);
    NaN where a force is not resisted along every direction.
    """
    found = analyse_many(elastic, q, outputs=["compliance_load"], one_by_one=_ONE_BY_ONE)
    C = found["compliance_load"][:, 3:, 3:]
    softest = np.full(len(q), np.nan)
    known = np.isfinite(C).all(axis=(1, 2))
    values = np.linalg.eigvalsh(0.5 * (C + C.swapaxes(1, 2))[known])
    held = values[:, 0] > 0.0
    softest[np.flatnonzero(known)[held]] = 1.0 / values[held, -1]
    # Of singular postures rounding is left.
    most = np.nanmax(softest, initial=0.0)
    return np.where(softest > numerics.NEGLIGIBLE_DIFFERENCE * most, softest, np.nan)


def _kinds_of_limits(names: Sequence[str], elastic: ElasticMechanism) -> list[str]:
    """Limits in few kinds, whichever leg or joint is at it: "legs at most 1.2 m"."""
    bounds = _bounds_in_words(elastic)
    kinds = {}
    for name in dict.fromkeys(names):
        what, comma, side = name.partition(", ")
        what = re.sub(r"(?<=[a-z])\d+", "s", what, count=1).replace("_", " ")
        kinds[name] = f"{what} at {side}" if comma else what
    # The bound is said where all of a kind share it.
    said = {
        kind: {bounds.get(name, ("",)) for name in kinds if kinds[name] == kind}
        for kind in kinds.values()
    }
    full = {
        k: " ".join([k, *b.pop()]).strip() if len(b) == 1 else k for k, b in said.items()
    }
    found = [full[kinds[name]] for name in names]
    commonest = [kind for kind, _ in Counter(found).most_common()]
    if len(commonest) > _MOST_KINDS:
        few = set(commonest[: _MOST_KINDS - 1])
        found = [kind if kind in few else "other limits" for kind in found]
    return found


def _bounds_in_words(elastic: ElasticMechanism) -> dict[str, tuple[str]]:
    """Numbers and units of the limits that a workspace names, as in "leg1, most"."""
    mechanism, limits = elastic.mechanism, Limits(elastic.mechanism)
    types = {c.name: c.type for c in mechanism.coordinates}
    words: dict[str, tuple[str]] = {}
    for name, low, high, angle in zip(
        limits.names, limits.lower, limits.upper, limits.are_angles, strict=True
    ):
        unit = elastic.units.coordinate(not (angle or types.get(name) == "revolute"))
        words |= {
            f"{name}, least": (f"{low:.4g} {unit}",),
            f"{name}, most": (f"{high:.4g} {unit}",),
        }
    forces = mechanism.tension_limits
    for i, pair in enumerate(() if forces is None else forces.tolist(), start=1):
        for side, bound in zip(("least", "most"), pair, strict=True):
            words[f"force of leg{i}, {side}"] = (f"{bound:.4g} {elastic.units.force}",)
    return words
