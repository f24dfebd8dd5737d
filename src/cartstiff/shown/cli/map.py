"""``cartstiff map``."""

from __future__ import annotations

import shlex
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

import click

from cartstiff.core.errors import InputError, check_name, one_line
from cartstiff.shown.cli.declare import Overrides
from cartstiff.shown.cli.options import (
    MAX_COUNT,
    ONE_POSTURE,
    PICTURES,
    Axis,
    BalancedSetup,
    Count,
    Grid,
    MapFiles,
    Metres,
    Numbers,
    Pairs,
    Printed,
    Reading,
    Several,
    Vibration,
    declared,
)
from cartstiff.shown.cli.output import say, say_unused

if TYPE_CHECKING:
    from cartstiff.wings.maps.sampling import Sampling


_LARGEST_FILE = 2**30


class _Orientation(Numbers):
    """Roll, pitch and yaw, or "keep"."""

    def parsed(self, text: str, where: str) -> Any:
        """The numbers, or the word."""
        return text if text == "keep" else super().parsed(text, where)


@dataclass(frozen=True)
class Where:
    """Postures of the map.

    Parameters
    ----------
    grid
        Values of a coordinate; repeat it, or separate by commas, for several. The others
        stay where --q or the file has them.
    random : N
        N random postures within the joints' limits; compliant links start straight.
    cartesian
        Positions x, y, z of the body frame in F, by inverse kinematics.
    trajectory : FILE.csv
        Postures of a file: a line of coordinate names, then one posture a line.
    """

    API: ClassVar = (
        "wings/maps/sampling.py RandomPostures.within_limits",
        "wings/maps/cartesian.py CartesianGrid redundant=redundancy",
    )
    NEEDS: ClassVar = {
        "ranges": "random",
        "orientation free redundant branches": "cartesian",
    }
    RARE: ClassVar = "orientation free redundant branches"

    grid: Grid = None
    random: Annotated[int | None, click.IntRange(1, MAX_COUNT)] = None
    ranges: Annotated[Axis, "--range"] = None
    cartesian: Annotated[Grid, Pairs("x=LOW:HIGH:COUNT")] = None
    trajectory: Path | None = None
    orientation: Annotated[Any, _Orientation("R,P,Y|keep", 3)] = "keep"
    free: Literal["none", "x", "y", "z", "rotation"] = "none"
    redundant: Literal["nearest", "best"] = "nearest"
    branches: Annotated[int, click.IntRange(1, 1000)] = 8

    def sampling(self, elastic: Any, q: Any) -> Sampling:
        """Return the sampling; q is the base posture or None."""
        from cartstiff.wings.maps.cartesian import CartesianGrid
        from cartstiff.wings.maps.sampling import Grid, RandomPostures, Trajectory

        ways = (self.grid, self.random, self.cartesian, self.trajectory)
        if (count := sum(map(bool, ways))) != 1:
            raise InputError(
                "say where the map looks",
                expected="exactly one of --grid, --random, --cartesian, --trajectory",
                got=count or "none of them",
            )
        # A trajectory, a grid, random postures, or a Cartesian grid.
        base = elastic.placed(q, "--q")[1].q
        if self.trajectory is not None:
            table = _table(self.trajectory, elastic)
            with _named(f"--trajectory {one_line(str(self.trajectory))}"):
                return Trajectory.from_table(table, elastic, base)
        if self.grid:
            with _named("--grid", keep=True):
                return Grid(_axes("--grid", self.grid), elastic.names, base)
        if self.random is not None:
            limits = {
                name: (low, high) for name, (low, high) in (self.ranges or {}).items()
            }
            with _named("--range"):
                return RandomPostures.within_limits(elastic, self.random, 0, limits)
        axes, turn = _axes("--cartesian", self.cartesian or {}), None
        with _named("--cartesian", keep=True):
            if self.orientation != "keep":
                from cartstiff.core.geometry import se3

                turn = se3.from_roll_pitch_yaw(angles=self.orientation)[:3, :3]
            return CartesianGrid(
                axes,
                elastic,
                base,
                turn,
                redundancy=self.redundant,
                free=self.free,
                branches=self.branches,
            )


@contextmanager
def _named(option: str, keep: bool = False) -> Iterator[None]:
    """Say in refusals which option they are about; with `keep` if they do not yet."""
    try:
        yield
    except InputError as error:
        raise (error if keep and error.where else error.at(option)) from None


def _axes(option: str, given: Mapping[str, tuple[float, ...]]) -> dict[str, Any]:
    """Axes of a grid, by name."""
    from cartstiff.wings.maps.sampling import Axis

    axes = {}
    for name, (low, high, n) in given.items():
        with _named(f"{option} {name}"):
            axes[name] = Axis(low, high, int(n))
    return axes


def _table(path: Path, elastic: Any) -> dict[str, Any]:
    """Read the columns of a CSV file by the names in its first line."""
    from cartstiff.files.tables import read_rows

    rows = read_rows(path, "postures", _LARGEST_FILE, elastic.units, joints=elastic.names)
    if rows.names is None:
        raise InputError(
            "columns have no names",
            where=rows.place,
            expected="a line of names, then one posture a line",
        )
    table = dict(zip(rows.names, rows.values.T, strict=True))
    if set(elastic.names) <= set(table):  # further columns are not needed
        more = [name for name in table if name not in (*elastic.names, "time")]
        say_unused(path, more)
        table = {name: column for name, column in table.items() if name not in more}
    return table


def check_cuts(cuts: dict[str, float], sampling: Any) -> None:
    """Refuse a slice outside the map before it is computed."""
    for name, value in cuts.items():
        check_name("axis of the map", name, sampling.axes, "--slice")
        axis = sampling.axes[name]
        if not axis.low <= value <= axis.high:
            raise InputError(
                "outside the map",
                where=f"--slice {name}",
                expected=f"{axis.low:g} to {axis.high:g}",
                got=f"{value:g}",
            )


@dataclass(frozen=True)
class Held(Reading):
    """Quantities of the map.

    Parameters
    ----------
    quantities : NAME
        A quantity that the map holds.
    connection : LETTER
    """

    API: ClassVar = ("wings/maps/run.py map_job added_load=deflect",)

    connection: Annotated[Literal["load", "A", "B", "K", "F"] | None, "--connection"] = (
        None
    )
    quantities: Annotated[tuple[str, ...], "--quantity"] = ()

    @property
    def keywords(self) -> dict[str, Any]:
        """Arguments of a map."""
        return {
            "connection": self.connection,
            "direction": self.direction,
            "deflect": self.added_load,
        }


@dataclass(frozen=True)
class Shown:
    """Results of the map.

    Parameters
    ----------
    cuts
        Draw and list only the part of the map at this value of an axis.
    best : N
        List the N best postures.
    """

    RARE: ClassVar = "cuts"

    cuts: Annotated[dict[str, float] | None, Pairs("NAME=VALUE"), "--slice"] = None
    best: Several = None

    def check(self, sampling: Any, quantities: tuple[str, ...]) -> dict[str, float]:
        """Refuse unfit options before the map is computed.

        Return the cuts by dimension.
        """
        # Dimensions have dots where names of coordinates have slashes.
        cuts = {n.replace("/", "."): value for n, value in (self.cuts or {}).items()}
        check_cuts(cuts, sampling)
        if self.best is not None:
            _check_ranked(quantities)
        return cuts


@declared(
    "map",
    rare="lengths pose rest load_at load_kind ranges direction added_load connection "
    "damping chunk progress dask",
)
def command(
    setup: Annotated[
        BalancedSetup,
        Overrides(
            "actuate",
            because=ONE_POSTURE,
            load="Wrench on the body at every posture: moment about and force at the "
            "point --load-at, in the body's axes; rest positions are chosen so that the "
            "springs balance it.",
        ),
    ],
    where: Where,
    reading: Held,
    vibration: Vibration,
    shown: Shown,
    out: Printed,
    *,
    output: Annotated[dict[str, Any], MapFiles()],
    chunk: Count = None,
    progress: bool | None = None,
    dask: str | None = None,
) -> None:
    r"""Quantities of the stiffness of MECHANISM at many postures,
    in a file and in pictures.

    The file is a Zarr folder of labelled arrays that says what it holds; xarray opens it.
    After an interruption, the same command goes on where it stopped.

    Parameters
    ----------
    setup
        The mechanism, with tool, weight, and the load at every posture.
    where
        The postures.
    reading
        Quantities of the map.
    vibration
        Damping.
    shown
        Results of the map.
    out
        Output.
    output : MAP.zarr
        The map, at a path or an address such as s3://bucket/map.zarr; if it exists, its
        missing parts are computed. Beside it, a picture of the first quantity (.png,
        .svg, .pdf) or the answer (.json).
    chunk : N
        Largest number of postures in one part of the file.
    progress
        Bar on standard error; default on a terminal.
    dask : ADDRESS
        Use the workers of a running Dask scheduler.

    Examples
    --------
    cartstiff map ur5 --grid shoulder_lift_joint=-2:0:41 --grid elbow_joint=-2.5:2.5:41 \
        --quantity translation_free_min -o ur5.zarr -o ur5.png --best 3
    cartstiff map ur5 --random 1000000 --quantity condition -o random.zarr -o hist.svg
    cartstiff map ur5 --cartesian x=0.2:0.8:13,y=-0.4:0.4:17 --quantity along_free \
        --direction 0,0,1 --world -o plane.zarr -o plane.png
    cartstiff map ur5 --cartesian x=0.2:0.8:13,y=-0.4:0.4:17 --quantity translation_free_min \
        --load 0,0,0,0,0,-100 --world --load-at 0,0,0.1 -o loaded.zarr
    cartstiff map ur5 --cartesian x=0.2:0.8:13,z=0:0.8:17 --quantity deflection \
        --load 0,0,0,0,0,-100 --world -o sag.zarr -o sag.png
    cartstiff map panda --trajectory path.csv --quantity deflection \
        --added-load 0,0,0,0,0,-50 --world -o path.zarr --json
    """  # noqa: E501
    quantities = reading.quantities
    if not quantities:
        raise InputError(
            "no --quantity was given", expected="a name of cartstiff models --quantities"
        )
    if ".zarr" not in output:
        raise InputError(
            "the map needs a place", where="-o", expected="-o MAP.zarr as well"
        )
    place, drawn = str(output[".zarr"]), bool(output.keys() & {*PICTURES})
    elastic, q = setup.read()
    sampling = where.sampling(elastic, q)
    cuts = shown.check(sampling, quantities)

    from cartstiff.wings.maps.reading import places_of, slice_map, summary
    from cartstiff.wings.maps.run import prepare_map, run_map
    from cartstiff.wings.maps.store import open_map

    job, file = prepare_map(
        elastic,
        sampling,
        quantities,
        place,
        chunk=chunk,
        command=shlex.join(click.get_current_context().meta["words"]),
        **setup.keywords,
        **reading.keywords,
        length=Metres.in_units(reading.length, elastic.units),
        world=setup.world and (reading.direction or reading.added_load) is not None,
        damping=vibration.damped,
    )
    start = time.perf_counter()
    try:
        computed = run_map(job, file, dask=dask, progress=progress)
    except KeyboardInterrupt:
        say(
            f"cartstiff: interrupted: {len(file.done())} of {len(file.parts)} parts are "
            f"in {one_line(place)}; the same command goes on from there",
            error=True,
        )
        raise click.exceptions.Exit(130) from None
    seconds = time.perf_counter() - start
    from cartstiff.wings.maps.answer import answer_of_map, map_data, ranked

    dataset: Any = None  # opened only if the statistics of the parts do not suffice
    if cuts or shown.best is not None or drawn:
        dataset = slice_map(open_map(place), **cuts)
    answer = map_data(file, place, summary(dataset if cuts else file), computed)
    answer |= {
        "seconds": round(seconds, 3),
        "slice": places_of(dataset, cuts),
        "notes": [n.to_dict() for n in elastic.notes],
    }
    if shown.best is not None:
        answer["best"] = {name: ranked(dataset, name, shown.best) for name in quantities}

    def picture() -> Any:
        from cartstiff.wings.maps.pictures import draw_map

        return draw_map(dataset, quantities[0], angle=elastic.units.shown_angle)

    files = {ending: path for ending, path in output.items() if ending != ".zarr"}
    found = answer_of_map(answer, elastic, is_loaded=setup.load is not None)
    out.answer(answer, found, files, picture=picture)


def _check_ranked(quantities: tuple[str, ...]) -> None:
    """Refuse a list of best postures of a quantity without a better end."""
    from cartstiff.recorded.quantities import QUANTITIES

    for name in quantities:
        if name in QUANTITIES and QUANTITIES[name].better is None:
            raise InputError(
                f"neither end of {name} is better",
                where="--best",
                expected="other quantities",
            )
