"""``cartstiff map`` and ``compare``."""

from __future__ import annotations

import json
import math
import shlex
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

import click

from cartstiff.cli.declare import Factors, Overrides, ending
from cartstiff.cli.options import (
    ANGLE,
    MAX_COUNT,
    Amount,
    Axis,
    BalancedLoad,
    Count,
    Grid,
    Numbers,
    Pairs,
    Picture,
    Printed,
    Processes,
    Reading,
    Robot,
    Seed,
    Several,
    Vibration,
    declared,
)
from cartstiff.cli.output import say, say_unused
from cartstiff.errors import InputError, check_name, one_line

if TYPE_CHECKING:
    from cartstiff.maps.sampling import Sampling
    from cartstiff.maps.store import MapFile


_LARGEST_FILE = 2**30


class _Orientation(Numbers):
    """Roll, pitch and yaw, or "keep"."""

    def parsed(self, text: str, where: str) -> Any:
        """The numbers, or the word."""
        return text if text == "keep" else super().parsed(text, where)

    def converted(self, value: Any, by: Factors, elastic: Any) -> Any:
        """The angles in their other unit."""
        return value if value == "keep" else super().converted(value, by, elastic)


@dataclass(frozen=True)
class Where:
    """Postures of the map.

    Parameters
    ----------
    grid
        Values of a coordinate; repeat it, or separate by commas, for several. The others stay where
        --q or the file has them.
    random : N
        N random postures within the joints' limits; compliant links start straight.
    cartesian
        Positions x, y, z of the body frame in F, by inverse kinematics.
    actuate
        How far a drive moves from the posture: leg1=-0.001:0.001:11 maps commands from --q,
        leg1/slide=0.001 holds at every posture of a map. The map is computed at the equilibrium for
        these positions.
    trajectory : FILE.csv
        Postures of a file: a line of coordinate names, then one posture a line.
    seed
        Seed of random postures and starts.
    """

    API: ClassVar = (
        "maps/sampling.py RandomPostures.within_limits",
        "maps/cartesian.py CartesianGrid",
    )
    NEEDS: ClassVar = {
        "ranges": "random",
        "orientation free redundancy branches starts": "cartesian",
        "seed": "random cartesian",
    }
    RARE: ClassVar = "seed orientation free redundancy branches starts"

    grid: Grid = None
    random: Annotated[int | None, click.IntRange(1, MAX_COUNT)] = None
    ranges: Annotated[Axis, "--range"] = None
    cartesian: Annotated[Grid, Pairs("x=LOW:HIGH:COUNT", frame=True)] = None
    actuate: Annotated[Grid, Pairs("NAME=LOW:HIGH:COUNT", axes=True, single=True)] = None
    trajectory: Path | None = None
    seed: Seed = 0
    orientation: Annotated[Any, _Orientation("R,P,Y|keep", 3, powers=(ANGLE,))] = "keep"
    free: Literal["none", "x", "y", "z", "rotation"] = "none"
    redundancy: Literal["nearest", "best"] = "nearest"
    branches: Annotated[int, click.IntRange(1, 1000)] = 8
    starts: Annotated[int, click.IntRange(0, 10000)] = 24

    def sampling(self, elastic: Any, q: Any) -> tuple[Sampling, dict[str, float]]:
        """Return the sampling, and the commands to drives at all of its postures.

        q is the base posture or None.
        """
        from cartstiff.maps.cartesian import CartesianGrid
        from cartstiff.maps.job import CommandGrid
        from cartstiff.maps.sampling import Axis, Grid, RandomPostures, Trajectory

        told = self.actuate or {}
        steps = {name: values[0] for name, values in told.items() if len(values) == 1}
        over = {name: values for name, values in told.items() if len(values) > 1}
        ways = (self.grid, self.random, self.cartesian, self.trajectory, over)
        if (count := sum(bool(kind) for kind in ways)) != 1:
            raise InputError(
                "say where the map looks",
                expected="exactly one of --grid, --random, --cartesian, "
                "--trajectory, --actuate NAME=LOW:HIGH:COUNT",
                got=count or "none of them",
            )
        base = elastic.placed(q, "--q")[1].q
        if self.trajectory is not None:
            table = _table(self.trajectory, elastic)
            try:
                return Trajectory.from_table(table, elastic, base), steps
            except InputError as error:
                raise error.at(f"--trajectory {one_line(str(self.trajectory))}") from None
        given = over or self.grid or self.cartesian or {}
        option = "--actuate" if over else "--grid" if self.grid else "--cartesian"
        axes: dict[str, Axis] = {}
        for name, (low, high, n) in given.items():
            try:
                axes[name] = Axis(low, high, int(n))
            except InputError as error:
                raise error.at(f"{option} {name}") from None
        try:
            if over:
                return CommandGrid(axes, elastic, base), steps
            if self.grid:
                return Grid(axes, elastic.names, base), steps
            if self.random is not None:
                option = "--range"
                limits = {name: (low, high) for name, (low, high) in (self.ranges or {}).items()}
                return RandomPostures.within_limits(elastic, self.random, self.seed, limits), steps
            turn = None
            if self.orientation != "keep":
                from cartstiff.geometry import se3

                turn = se3.from_roll_pitch_yaw(angles=self.orientation)[:3, :3]
            search = {n: getattr(self, n) for n in ("free", "redundancy", "branches", "starts")}
            return CartesianGrid(axes, elastic, base, turn, seed=self.seed, **search), steps
        except InputError as error:
            raise error if error.where and option != "--range" else error.at(option) from None


def _table(path: Path, elastic: Any) -> dict[str, Any]:
    """Read the columns of a CSV file by the names in its first line."""
    from cartstiff.loading.tables import read_rows
    from cartstiff.mechanisms.other_units import shown_factors

    rows = read_rows(
        path, "postures", _LARGEST_FILE, elastic.units, shown_factors(elastic), elastic.names
    )
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


def level_of(
    limit: tuple[float, str] | None, where: str, quantity: str, elastic: Any
) -> float | None:
    """Return the value of --below or --above in the unit of the quantity."""
    from cartstiff.maps.quantities import quantity_named
    from cartstiff.mechanisms.contract import ANGLES, LENGTHS, LINEAR

    if limit is None or not limit[1]:
        return None if limit is None else limit[0]
    value, unit = limit
    own = quantity_named(quantity).unit_in(elastic.units)
    for kind in (LENGTHS, ANGLES, LINEAR):
        if unit in kind and own in kind:
            return value * kind[unit] / kind[own]
    raise InputError(
        "unit does not fit",
        where=where,
        got=unit,
        expected=f"{own}, the unit of {quantity}, or one of its kind"
        if own not in ("", "1")
        else "no unit",
    )


def _list_quantities(context: click.Context) -> None:
    """Print the table of quantities."""
    from cartstiff.batch.quantities import QUANTITIES
    from cartstiff.mechanisms.contract import SI

    known = [
        {
            "name": q.name,
            "unit": q.unit_in(SI),
            "description": q.description,
            "asks": q.asks,
            "better": q.better,
        }
        for q in QUANTITIES.values()
    ]
    if "--json" in context.meta["words"]:
        say(json.dumps({"schema": "cartstiff-quantities/1", "quantities": known}))
        return
    width = max(map(len, QUANTITIES))
    for q in known:
        more = f"; --{q['asks']}".replace("deflect", "added-load or --load") if q["asks"] else ""
        say(f"{q['name']:<{width}}  {q['unit']:<12} {q['description']}{more}")
    say("\nAny other number of the analysis by its path, such as indices.best_length.")


@dataclass(frozen=True)
class Held(Reading):
    """Quantities of the map.

    Parameters
    ----------
    quantities : NAME
        A quantity that the map holds.
    connection : LETTER
    """

    API: ClassVar = ("maps/run.py map_job added_load=deflect added_load_at=deflect_at",)

    connection: Annotated[Literal["load", "A", "B", "K", "F"] | None, "--connection"] = None
    quantities: Annotated[tuple[str, ...], "--quantity"] = ()

    @property
    def keywords(self) -> dict[str, Any]:
        """Arguments of a map."""
        at = {} if self.added_load_at is None else {"deflect_at": self.added_load_at}
        return {
            "connection": self.connection,
            "direction": self.direction,
            "deflect": self.added_load,
            "length": self.length,
            **at,
        }


_Level = Annotated[tuple[float, str] | None, Amount("VALUE[UNIT]")]


@dataclass(frozen=True)
class Shown:
    """Results of the map.

    Parameters
    ----------
    below
        Print the share of the places below a value: of those that are reached, where the first
        quantity is at most this (0.2mm), by the best branch of each; the picture has a line there.
    above
        The same for at least this value.
    single_branch
        With --cartesian: show only the best single branch, which an arm can follow without a flip,
        in pictures, lists and numbers.
    picture
        Draw the first quantity to a .png, .svg or .pdf file.
    kind
        Kind of the picture.
    by : NAME
        The axis that slices cut.
    cuts
        Draw and list only the part of the map at this value of an axis.
    best : N
        List the N best postures.
    worst : N
        List the N worst postures.
    """

    NEEDS: ClassVar = {"kind by": "picture"}
    EXCLUSIVE: ClassVar = ("below above",)
    RARE: ClassVar = "single_branch kind by cuts"

    below: _Level = None
    above: _Level = None
    single_branch: bool = False
    picture: Picture = None
    kind: Literal["auto", "heat", "slices", "line", "histogram"] = "auto"
    by: str | None = None
    cuts: Annotated[dict[str, float] | None, Pairs("NAME=VALUE", axes=True), "--slice"] = None
    best: Several = None
    worst: Several = None

    def check(self, sampling: Any, quantities: tuple[str, ...]) -> dict[str, float]:
        """Refuse unfit options before the map is computed; return the cuts by dimension."""
        # Dimensions have dots where names of coordinates have slashes.
        cuts = {n.replace("/", "."): value for n, value in (self.cuts or {}).items()}
        check_cuts(cuts, sampling)
        if self.picture is not None:
            from cartstiff.maps.pictures import kind_for

            lengths = dict(zip(sampling.dims, sampling.shape, strict=True))
            sizes = {dim: 1 if dim in cuts else n for dim, n in lengths.items()}
            try:
                kind_for(sizes, self.kind, self.by)
            except InputError as error:
                raise error.moved_to(f"--{error.where}") from None
        if self.best is not None or self.worst is not None:
            _check_ranked(quantities)
        if self.single_branch and "branch" not in sampling.dims:
            raise InputError("is for --cartesian with several branches", where="--single-branch")
        return cuts


@declared(
    "map",
    json_of_file=False,
    rare="lengths pose rest load_at load_kind ranges direction added_load actuate above connection "
    "damping milling single verify chunk progress profile threads dask",
    more=(
        ending(
            "--list-quantities",
            _list_quantities,
            "Print the names and end; with --json as one object.",
        ),
    ),
)
def command(
    robot: Annotated[Robot, Overrides("actuate")],
    load: Annotated[
        BalancedLoad,
        Overrides(
            load="Wrench on the body at every posture: moment about and force at the point "
            "--load-at, in the body's axes; rest positions are chosen so that the springs balance "
            "it."
        ),
    ],
    where: Where,
    reading: Held,
    vibration: Vibration,
    shown: Shown,
    out: Printed,
    *,
    output: str,
    single: bool = False,
    verify: bool = False,
    chunk: Count = None,
    progress: bool | None = None,
    profile: bool = False,
    threads: Processes = None,
    dask: str | None = None,
) -> None:
    r"""Quantities of the stiffness of MECHANISM at many postures, in a file and in pictures.

    The file is a Zarr folder of labelled arrays that says what it holds; xarray opens it. After an
    interruption, the same command goes on where it stopped.

    Parameters
    ----------
    robot
        The mechanism.
    load
        The load at every posture.
    where
        The postures.
    reading
        Quantities of the map.
    vibration
        Damping and milling.
    shown
        Results of the map.
    out
        Output.
    output : MAP.zarr
        File of the map, or an address such as s3://bucket/map.zarr; if it exists, its missing parts
        are computed.
    single
        Keep numbers in single precision.
    verify
        Read the parts that are there, and compute those anew that are damaged.
    chunk : N
        Largest number of postures in one part of the file.
    progress
        Bar on standard error; default on a terminal.
    profile
        Also say what computed the answer, how long each part took, and what limits it on this
        machine.
    threads : N
        Threads of this process; default one for every core.
    dask : ADDRESS
        Use the workers of a running Dask scheduler.

    Examples
    --------
    cartstiff map ur5 --grid shoulder_lift_joint=-2:0:41 --grid elbow_joint=-2.5:2.5:41 \
        --quantity translation_free_min -o ur5.zarr --picture ur5.png --worst 3
    cartstiff map ur5 --random 1000000 --quantity condition -o random.zarr --picture hist.svg
    cartstiff map ur5 --cartesian x=0.2:0.8:13,y=-0.4:0.4:17 --quantity along_free \
        --direction 0,0,1 --world -o plane.zarr --picture plane.png
    cartstiff map ur5 --cartesian x=0.2:0.8:13,y=-0.4:0.4:17 --quantity translation_free_min \
        --load 0,0,0,0,0,-100 --world --load-at 0,0,0.1 -o loaded.zarr
    cartstiff map ur5 --cartesian x=0.2:0.8:13,z=0:0.8:17 --quantity deflection \
        --load 0,0,0,0,0,-100 --world --below 2mm -o below.zarr --picture below.png
    cartstiff map flexure-hexapod --actuate leg1=-1e-5:1e-5:11 --quantity translation_free_min \
        -o commands.zarr
    cartstiff map panda --trajectory path.csv --quantity deflection \
        --added-load 0,0,0,0,0,-50 --world -o path.zarr --json
    """
    if profile and dask is not None:
        raise InputError(
            "the time of other processes is not counted",
            where="--profile",
            expected="no --dask",
        )
    quantities = reading.quantities
    if not quantities:
        raise InputError("no --quantity was given", expected="a name of --list-quantities")
    elastic, q = robot.load()
    sampling, told = where.sampling(elastic, q)
    cuts = shown.check(sampling, quantities)
    side = "above" if shown.above else "below"
    level = level_of(shown.below or shown.above, f"--{side}", quantities[0], elastic)

    from cartstiff.batch.work import describe, explained, watched
    from cartstiff.maps.reading import places_of, slice_map, summary
    from cartstiff.maps.run import prepare_map, run_map
    from cartstiff.maps.store import open_map

    job, file = prepare_map(
        elastic,
        sampling,
        quantities,
        output,
        single=single,
        chunk=chunk,
        command=shlex.join(click.get_current_context().meta["words"]),
        **load.keywords,
        **reading.keywords,
        world=load.world and (reading.direction or reading.added_load) is not None,
        damping=vibration.damped,
        milling=vibration.cutter,
        told=told,
    )
    start, spent = time.perf_counter(), time.process_time()
    try:
        with watched() as work:
            computed, damaged = run_map(
                job, file, threads=threads, dask=dask, progress=progress, verify=verify
            )
    except KeyboardInterrupt:
        say(
            f"cartstiff: interrupted: {len(file.done())} of {len(file.boxes)} parts are in "
            f"{one_line(output)}; the same command goes on from there",
            error=True,
        )
        raise click.exceptions.Exit(130) from None
    seconds = time.perf_counter() - start
    profiled = explained(work, seconds, time.process_time() - spent) if profile else None
    if damaged:
        say(
            f"cartstiff: {one_line(output)}: {len(damaged)} of its parts were damaged and "
            f"have been made anew: {one_line('; '.join(damaged), 300)}",
            error=True,
        )
    from cartstiff.maps.across import single_branch as one_branch
    from cartstiff.maps.reading import share_within
    from cartstiff.mechanisms.elastic import gravity_loads
    from cartstiff.report.maps import describe_map, ranked

    is_part = bool(cuts or shown.single_branch)
    whole: Any = None  # opened only if the statistics of the parts do not suffice
    if is_part or (shown.best, shown.worst, level, shown.picture) != (None,) * 4:
        whole = slice_map(open_map(output), **cuts) if cuts else open_map(output)
    dataset = whole
    if shown.single_branch:
        dataset = one_branch(whole, quantities[0], level, side == "below")
    summed = summary(dataset if is_part else file)
    answer = _answer(file, output, computed, seconds, summed)
    answer |= {"slice": places_of(whole, cuts), "notes": [n.to_dict() for n in elastic.notes]}
    for which, count in (("best", shown.best), ("worst", shown.worst)):
        if count is not None:
            answer[which] = {name: ranked(dataset, name, which, count) for name in quantities}
    if level is not None:
        counts: dict[str, Any] = share_within(dataset, quantities[0], level, side == "below")
        if "branch" in whole.dims and not shown.single_branch:
            alone = one_branch(whole, quantities[0], level, side == "below")
            single_found = share_within(alone, quantities[0], level, side == "below")
            within = single_found["within"]
            share = within / counts["reached"] if counts["reached"] else 0.0
            by_one = {"places": single_found["reached"], "within": within, "share": share}
            counts["single_branch"] = by_one
        answer[side] = {"quantity": quantities[0], **counts}
    if shown.picture is not None:
        from cartstiff.maps.pictures import draw_map
        from cartstiff.report.output import save_figure

        look = {"by": shown.by, "level": level, "angle": elastic.units.shown_angle}
        save_figure(draw_map(dataset, quantities[0], shown.kind, **look), shown.picture)
    if profiled is not None:
        answer["explained"] = profiled

    def text() -> str:
        names, weighed = elastic.names_with_units, gravity_loads(elastic).text
        lines = [describe_map(answer, names, weighed, load.load is not None)]
        return "\n".join([*lines, *(describe(profiled) if profiled else [])])

    out.show(answer, robot.mechanism, text)


def _check_ranked(quantities: tuple[str, ...]) -> None:
    """Refuse a list of best postures of a quantity without a better end."""
    from cartstiff.batch.quantities import QUANTITIES

    for name in quantities:
        if "." in name or (name in QUANTITIES and QUANTITIES[name].better is None):
            raise InputError(
                f"neither end of {name} is better",
                where="--best or --worst",
                expected="other quantities",
            )


def _answer(
    file: MapFile, output: str, computed: int, seconds: float, summed: dict[str, Any]
) -> dict[str, Any]:
    about, total = file.attributes, math.prod(file.parts.shape)
    return {
        "schema": about["schema"],
        "file": output,
        "mechanism": about["mechanism"],
        "frame": about["frame"],
        **{
            key: [about[key][i : i + 4] for i in range(0, 16, 4)]
            for key in ("frame_offset", "base_pose")
        },
        "connection": about["connection"],
        "load": {key: about[f"load_{key}"] for key in ("kind", "at", "meaning")},
        "characteristic_length": about["characteristic_length"],
        "units": {k: about[f"{k}_unit"] for k in ("length", "force", "angle")},
        "postures": total,
        "parts": {
            "total": len(file.boxes),
            "computed": computed,
            "found": len(file.boxes) - computed,
        },
        "seconds": round(seconds, 3),
        "told": about.get("told"),
        **summed,
    }


@declared("compare")
def compare_command(
    first: str,
    second: str,
    out: Printed,
    *,
    quantity: str | None = None,
    difference: bool = False,
    cuts: Annotated[dict[str, float] | None, Pairs("NAME=VALUE"), "--slice"] = None,
    picture: Picture = None,
) -> None:
    """Ratio or difference of two maps of the same places: two arms, two mountings.

    FIRST and SECOND are maps of `cartstiff map`, over the same axes. At a place with several
    branches each map's best one counts.

    Parameters
    ----------
    first : FIRST.zarr
        A map.
    second : SECOND.zarr
        Another.
    out
        Output.
    quantity : NAME
        Quantity to compare; default the first that both maps hold.
    difference
        The first map minus the second, instead of the first over the second.
    cuts
        Only the part of both maps at this value of an axis.
    picture
        Draw it to a .png, .svg or .pdf file.

    Examples
    --------
    cartstiff compare wall.zarr ceiling.zarr --picture ratio.png
    cartstiff compare ur10.zarr kr210.zarr --quantity deflection --difference --json
    """
    from cartstiff.maps.across import compare_maps, compared
    from cartstiff.maps.reading import places_of, quantities_of, slice_map
    from cartstiff.maps.store import open_map

    a, b = (open_map(path) for path in (first, second))
    if quantity is None:
        both = [name for name in quantities_of(a) if name in quantities_of(b)]
        quantity = both[0] if both else quantities_of(a)[0]
    cuts = {name.replace("/", "."): value for name, value in (cuts or {}).items()}
    a, b = (slice_map(data, **cuts) if cuts else data for data in (a, b))
    result = compare_maps(a, b, quantity, "difference" if difference else "ratio")
    answer = {
        "schema": "cartstiff-compare/1",
        "quantity": quantity,
        "how": "difference" if difference else "ratio",
        "first": first,
        "second": second,
        **compared(result, quantity),
        "slice": places_of(a, cuts),
    }
    if picture is not None:
        from cartstiff.maps.pictures import draw_map
        from cartstiff.report.output import save_figure

        save_figure(draw_map(result, quantity), picture)
    from cartstiff.report.maps import describe_comparison

    words = str(result[quantity].attrs["long_name"])
    out.show(answer, first, lambda: describe_comparison(answer, words))
