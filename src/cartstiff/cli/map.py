"""``cartstiff map`` and ``compare``."""

from __future__ import annotations

import json
import math
import shlex
import time
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from cartstiff.cli.options import (
    ANGLE,
    DIRECTION,
    FILE,
    PICTURE,
    POINT,
    WRENCH,
    Amount,
    Axes,
    Factors,
    LoadRequest,
    MechanismRequest,
    Number,
    Numbers,
    Pairs,
    UnitsCommand,
    choice,
    count,
    explain_option,
    file_option,
    flag,
    json_option,
    load_options,
    mechanism_options,
    only_with,
    option,
    option_group,
    progress_option,
    repeated_option,
    vibration_options,
)
from cartstiff.cli.output import say, say_unused, tell
from cartstiff.errors import InputError, UnknownNameError, check_name, one_line
from cartstiff.matrix_names import OF_MANY

if TYPE_CHECKING:
    from cartstiff.maps.sampling import Axis, Sampling
    from cartstiff.maps.store import MapFile


# A map of more postures than this would take years.
_MOST = 10**12
_LARGEST_FILE = 2**30


class _Orientation(Numbers):
    """Roll, pitch and yaw, or "keep"."""

    def parsed(self, text: str, where: str) -> Any:
        """The numbers, or the word."""
        return text if text == "keep" else super().parsed(text, where)

    def converted(self, value: Any, by: Factors, elastic: Any) -> Any:
        """The angles in their other unit."""
        return value if value == "keep" else super().converted(value, by, elastic)


#: The command takes them as keywords for `sampling_from_options`.
sampling_options = option_group(
    repeated_option(
        "--grid",
        Axes("NAME=LOW:HIGH:COUNT"),
        "Values of a coordinate; repeat it, or separate by commas, for several. The others "
        "stay where --q or the file has them.",
    ),
    count(
        "--random",
        "N random postures within the limits of the joints; compliant links start unbent.",
        1,
        _MOST,
        metavar="N",
    ),
    repeated_option(
        "--range ranges",
        Axes("NAME=LOW:HIGH"),
        "With --random: other limits of a coordinate; --range NAME=V:V holds it.",
    ),
    repeated_option(
        "--cartesian",
        Axes("x=LOW:HIGH:COUNT"),
        "Positions x, y, z of the body frame in F, by inverse kinematics.",
    ),
    repeated_option(
        "--actuate told",
        Axes("NAME=LOW:HIGH:COUNT", single=True),
        "How far a drive moves from the posture: leg1=-0.001:0.001:11 maps commands from "
        "--q, leg1/slide=0.001 holds at every posture of a map. The map is "
        "computed at the equilibrium for these positions.",
    ),
    option(
        "--trajectory",
        FILE,
        "Postures of a file: a line of coordinate names, then one posture a line.",
        metavar="FILE.csv",
    ),
    count("--seed", "Seed of random postures and starts.", 0, default=0),
    click.option(
        "--orientation",
        type=_Orientation("R,P,Y|keep", 3, powers=(ANGLE,)),
        default="keep",
        show_default=True,
        help="With --cartesian: roll, pitch, yaw about fixed axes.",
    ),
    choice(
        "--free",
        ["none", "x", "y", "z", "rotation"],
        "With --cartesian: the body may turn about this axis of its own, or in any way.",
        default="none",
    ),
    choice(
        "--redundancy",
        ["nearest", "best"],
        "With --cartesian, where many postures reach a place: nearest to the base posture, "
        "or best in the first quantity.",
        default="nearest",
    ),
    count("--branches", "With --cartesian: most postures kept at a place.", 1, 1000, default=8),
    count(
        "--starts",
        "With --cartesian: random starts of the inverse kinematics.",
        0,
        10000,
        default=24,
    ),
)


def _axes(numbers: Mapping[str, tuple[float, ...]], option: str) -> dict[str, Axis]:
    from cartstiff.maps.sampling import Axis

    axes = {}
    for name, (low, high, n) in numbers.items():
        try:
            axes[name] = Axis(low, high, int(n))
        except InputError as error:
            raise error.at(f"{option} {name}") from None
    return axes


def sampling_from_options(
    elastic: Any,
    q: Any,
    *,
    grid: Mapping[str, tuple[float, ...]],
    random: int | None,
    ranges: Mapping[str, tuple[float, ...]],
    cartesian: Mapping[str, tuple[float, ...]],
    told: Mapping[str, tuple[float, ...]],
    trajectory: Path | None,
    seed: int,
    orientation: Any,
    **search: Any,
) -> tuple[Sampling, dict[str, float]]:
    """The sampling that the options ask for, and the actuator positions at all of its postures.

    q is the base posture or None.
    """
    from cartstiff.maps.cartesian import CartesianGrid
    from cartstiff.maps.job import CommandGrid
    from cartstiff.maps.sampling import Grid, RandomPostures, Trajectory

    steps = {name: values[0] for name, values in told.items() if len(values) == 1}
    over = {name: values for name, values in told.items() if len(values) > 1}
    if sum(bool(kind) for kind in (grid, random, cartesian, trajectory, over)) != 1:
        raise InputError(
            "say where the map looks",
            expected="one of --grid, --random, --cartesian, "
            "--trajectory, --actuate NAME=LOW:HIGH:COUNT",
        )
    if ranges and random is None:
        raise InputError("--range goes with --random")
    context = click.get_current_context()
    of_places = "--cartesian", bool(cartesian)
    wanted = dict.fromkeys(("orientation", "free", "redundancy", "branches", "starts"), of_places)
    wanted["seed"] = "--random or --cartesian", bool(cartesian) or random is not None
    for name, (options, is_there) in wanted.items():
        source = context.get_parameter_source(name)
        if not is_there and source is not click.core.ParameterSource.DEFAULT:
            raise InputError(f"goes with {options}", where=f"--{name}")
    base = elastic.placed(q, "--q")[1].q
    if trajectory is not None:
        return Trajectory.from_table(_table(trajectory, elastic), elastic, base), steps
    option = "--actuate" if over else "--grid" if grid else "--range" if random else "--cartesian"
    try:
        if over:
            return CommandGrid(_axes(over, option), elastic, base), steps
        if grid:
            return Grid(_axes(grid, option), elastic.names, base), steps
        if random is not None:
            limits = {name: (low, high) for name, (low, high) in ranges.items()}
            return RandomPostures.within_limits(elastic, random, seed, limits), steps
        turn = None
        if orientation != "keep":
            from cartstiff.geometry import se3

            turn = se3.from_roll_pitch_yaw(angles=orientation)[:3, :3]
        axes = _axes(cartesian, option)
        return CartesianGrid(axes, elastic, base, turn, seed=seed, **search), steps
    except InputError as error:
        raise error if error.where and option != "--range" else error.at(option) from None


def _table(path: Path, elastic: Any) -> dict[str, Any]:
    """Columns of a CSV file by the names in its first line."""
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
    if set(elastic.names) <= set(table):  # what else a table holds is not asked for here
        more = [name for name in table if name not in (*elastic.names, "time")]
        say_unused(path, more)
        table = {name: column for name, column in table.items() if name not in more}
    return table


def check_cuts(cuts: dict[str, float], sampling: Any) -> None:
    """Refuse a slice before the map is computed."""
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
    """The value of --below or --above in the unit of the quantity."""
    from cartstiff.maps.quantities import QUANTITIES
    from cartstiff.mechanisms.contract import FORCES, LENGTHS

    if limit is None or not limit[1]:
        return None if limit is None else limit[0]
    value, unit = limit
    own = QUANTITIES[quantity].unit_in(elastic.units) if quantity in QUANTITIES else ""
    known = {**LENGTHS, "rad": 1.0, "deg": 0.017453292519943295}
    kinds = [LENGTHS, {k: known[k] for k in ("rad", "deg")}]
    kinds.append({f"{f}/{x}": a / b for f, a in FORCES.items() for x, b in LENGTHS.items()})
    for kind in kinds:
        if unit in kind and own in kind:
            return value * kind[unit] / kind[own]
    raise InputError(
        "unit does not fit",
        where=where,
        got=unit,
        expected=f"one of the kind of {own}, the unit of {quantity}" if own else "a number alone",
    )


_EPILOG = """\b
Examples:
  cartstiff map ur5 --grid shoulder_lift_joint=-2:0:41 --grid elbow_joint=-2.5:2.5:41 \\
      --quantity translation_free_min -o ur5.zarr --picture ur5.png --worst 3
  cartstiff map ur5 --random 1000000 --quantity condition -o random.zarr --picture hist.svg
  cartstiff map ur5 --cartesian x=0.2:0.8:13,y=-0.4:0.4:17 --quantity along_free \\
      --direction 0,0,1 --world -o plane.zarr --picture plane.png
  cartstiff map ur5 --cartesian x=0.2:0.8:13,y=-0.4:0.4:17 --quantity translation_free_min \\
      --load 0,0,0,0,0,-100 --world --load-at 0,0,0.1 -o loaded.zarr
  cartstiff map ur5 --cartesian x=0.2:0.8:13,z=0:0.8:17 --quantity deflection \\
      --load 0,0,0,0,0,-100 --world --below 2mm -o below.zarr --picture below.png
  cartstiff map flexure-hexapod --actuate leg1=-1e-5:1e-5:11 --quantity translation_free_min \\
      -o commands.zarr
  cartstiff map panda --trajectory path.csv --quantity deflection \\
      --added-load 0,0,0,0,0,-50 --world -o path.zarr --json

After an interruption, the same command goes on where it stopped.
"""


def _list_quantities(context: click.Context, _: click.Parameter, asked: bool) -> None:
    if not asked or context.resilient_parsing:
        return
    from cartstiff.maps.quantities import QUANTITIES
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
        context.exit()
    width = max(map(len, QUANTITIES))
    for q in known:
        more = f"; --{q['asks']}".replace("deflect", "added-load or --load") if q["asks"] else ""
        say(f"{q['name']:<{width}}  {q['unit']:<12} {q['description']}{more}")
    say("\nAny other number of the analysis by its path, such as indices.best_length.")
    context.exit()


class _Remembering(UnitsCommand):
    """Keeps the words that it was called with: the map says how it was made."""

    has_json_of_file = False

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        ctx.meta["words"] = ["cartstiff", "map", *args]
        return super().parse_args(ctx, args)


_options = option_group(
    click.option(
        "--quantity",
        "quantities",
        metavar="NAME",
        multiple=True,
        help="A quantity that the map holds; repeat it for several.",
    ),
    click.option(
        "--list-quantities",
        is_flag=True,
        is_eager=True,
        expose_value=False,
        callback=_list_quantities,
        help="Print the names and end; with --json as one object.",
    ),
    choice(
        "--connection",
        OF_MANY,
        "Matrix that the quantities are read from; default where a load can act: load, the "
        "tangent stiffness "
        "under it (see --load-kind, --load-at). Without a load all but F are the same.",
    ),
    option(
        "--direction", DIRECTION, "For stiffness along and about a direction of the body frame."
    ),
    option(
        "--added-load",
        WRENCH,
        "Wrench, added to the load, whose deflection is computed; default the load itself.",
    ),
    option(
        "--added-load-at",
        POINT,
        "Point of the body, in its frame, at which the wrench of --added-load acts; "
        "default its origin.",
    ),
    vibration_options,
    option(
        "--length",
        Number("L"),
        "Characteristic length at all postures; default the natural length at the default one.",
    ),
    file_option(
        "-o --output",
        "File of the map; if it exists, its missing parts are computed.",
        required=True,
        metavar="MAP.zarr",
    ),
    flag("--single", "Keep numbers in single precision."),
    count("--chunk", "Largest number of postures in one part of the file.", 1, metavar="N"),
    option(
        "--below",
        Amount("VALUE[UNIT]"),
        "Print the share of the reached places at which the first quantity is at most this "
        "(0.2mm), by the best branch of each place; a heat map has a line there.",
    ),
    option("--above", Amount("VALUE[UNIT]"), "The same for at least this value."),
    flag(
        "--single-branch",
        "With --cartesian: show only the best single branch, which an arm can follow "
        "without a flip, in pictures, lists and numbers.",
    ),
    option("--picture", PICTURE, "Draw the first quantity to a .png, .svg or .pdf file."),
    choice(
        "--kind",
        ["auto", "heat", "slices", "line", "histogram"],
        "Kind of the picture.",
        default="auto",
    ),
    click.option(
        "--by",
        metavar="NAME",
        help="The axis that slices cut.",
    ),
    repeated_option(
        "--slice cuts",
        Pairs("NAME=VALUE", axes=True),
        "Draw and list only the part of the map at this value of an axis.",
    ),
    count("--best", "List the N best postures.", 1, 1000, metavar="N"),
    count("--worst", "List the N worst postures.", 1, 1000, metavar="N"),
    json_option,
    progress_option,
    explain_option,
    count(
        "--threads", "Threads of this process; default one for every core.", 1, 1024, metavar="N"
    ),
    count(
        "--workers",
        "Use N processes of this machine, for mechanisms without a compiled path.",
        1,
        1024,
        metavar="N",
    ),
    click.option(
        "--scheduler",
        metavar="ADDRESS",
        help="Use the workers of a running Dask scheduler.",
    ),
)


@click.command(name="map", epilog=_EPILOG, cls=_Remembering)
@mechanism_options(
    load_help="Wrench on the body at every posture: moment about and force at the point --load-at, "
    "in the body's axes; rest positions are chosen so that the springs balance it."
)
@load_options("--load, --direction and --added-load")
@sampling_options
@_options
@click.pass_context
def command(
    context: click.Context,
    /,
    request: MechanismRequest,
    applied: LoadRequest,
    quantities: tuple[str, ...],
    connection: str | None,
    direction: list[float] | None,
    added_load: list[float] | None,
    added_load_at: list[float] | None,
    vibration: dict[str, Any],
    length: float | None,
    output: Path,
    single: bool,
    chunk: int | None,
    below: tuple[float, str] | None,
    above: tuple[float, str] | None,
    single_branch: bool,
    picture: Path | None,
    kind: str,
    by: str | None,
    cuts: dict[str, float],
    best: int | None,
    worst: int | None,
    progress: bool | None,
    threads: int | None,
    workers: int | None,
    scheduler: str | None,
    profile: bool,
    **where: Any,
) -> None:
    """Quantities of the stiffness of MECHANISM at many postures, in a file and in pictures.

    The file is a Zarr folder of labelled arrays that says what it holds; xarray opens it.
    """
    if workers is not None and scheduler is not None:
        raise InputError("give --workers or --scheduler, not both")
    if profile and (workers is not None or scheduler is not None):
        raise InputError(
            "the time of other processes is not counted",
            where="--profile",
            expected="neither --workers nor --scheduler",
        )
    if not quantities:
        raise InputError("no --quantity was given", expected="a name of --list-quantities")
    if added_load is None:
        only_with("added-load", added_load_at=added_load_at)
    applied.check_world(load=request.wrench, added_load=added_load, direction=direction)
    asked: dict[str, Any] = {
        **applied.keywords(request.wrench),
        **vibration,
        "wrench": request.balanced_wrench,
        "world": applied.world,
        "direction": direction,
        "deflect": added_load,
        "length": length,
    }
    if added_load_at is not None:
        asked["deflect_at"] = added_load_at
    elastic, q = request.load()
    sampling, asked["told"] = sampling_from_options(elastic, q, **where)
    # Dimensions have dots where names of coordinates have slashes.
    cuts = {n.replace("/", "."): value for n, value in cuts.items()}
    check_cuts(cuts, sampling)
    if picture is not None:
        _check_picture(kind, by, sampling, cuts)
    elif by is not None or kind != "auto":
        raise InputError("is for --picture", where="--by" if by is not None else "--kind")
    if best is not None or worst is not None:
        _check_ranked(quantities)
    if below is not None and above is not None:
        raise InputError("give --below or --above, not both")
    if single_branch and "branch" not in sampling.dims:
        raise InputError("is for --cartesian with several branches", where="--single-branch")
    level = level_of(below or above, "--below" if below else "--above", quantities[0], elastic)

    from cartstiff.many.work import describe, explained, watched
    from cartstiff.maps.reading import places_of, slice_map, summary, summary_of_file
    from cartstiff.maps.run import prepare_map, run_map
    from cartstiff.maps.store import open_map

    job, file = prepare_map(
        elastic,
        sampling,
        quantities,
        output,
        connection=connection,
        single=single,
        chunk=chunk,
        command=shlex.join(context.meta["words"]),
        **asked,
    )
    facts: dict[int, dict[str, Any]] = {}
    start, spent = time.perf_counter(), time.process_time()
    try:
        with watched() as work:
            computed, damaged = run_map(
                job,
                file,
                threads=threads,
                workers=workers or 0,
                scheduler=scheduler,
                progress=progress,
                facts=facts,
            )
    except KeyboardInterrupt:
        say(
            f"cartstiff: interrupted: {len(file.done())} of {len(file.boxes)} parts are in "
            f"{one_line(str(output))}; the same command goes on from there",
            error=True,
        )
        raise click.exceptions.Exit(130) from None
    seconds = time.perf_counter() - start
    told = explained(work, seconds, time.process_time() - spent) if profile else None
    if damaged:
        say(
            f"cartstiff: {one_line(str(output))}: {len(damaged)} of its files were damaged and "
            f"have been made anew: {one_line('; '.join(damaged), 300)}",
            error=True,
        )
    lists = {"best": best, "worst": worst}
    whole: Any = None  # opened where the parts' facts do not say all
    if cuts or single_branch or (best, worst, level, picture) != (None,) * 4:
        whole = slice_map(open_map(output), **cuts) if cuts else open_map(output)
    dataset = whole
    if single_branch:
        from cartstiff.maps.across import single_branch as one_branch

        dataset = one_branch(whole, quantities[0], level, above is None)
    summed = summary(dataset) if cuts or single_branch else summary_of_file(file, facts)
    answer = _answer(file, output, computed, seconds, summed)
    answer |= {"slice": places_of(whole, cuts)}
    from cartstiff.mechanisms.elastic import gravity_loads
    from cartstiff.report.maps import describe_map, ranked

    answer |= {
        which: {name: ranked(dataset, name, which, count) for name in quantities}
        for which, count in lists.items()
        if count is not None
    }
    if level is not None:
        from cartstiff.maps.reading import share_within

        counts: dict[str, Any] = share_within(dataset, quantities[0], level, below is not None)
        if "branch" in whole.dims and not single_branch:
            from cartstiff.maps.across import single_branch as one_branch

            alone = one_branch(whole, quantities[0], level, below is not None)
            single_found = share_within(alone, quantities[0], level, below is not None)
            within = single_found["within"]
            share = within / counts["reached"] if counts["reached"] else 0.0
            by_one = {"places": single_found["reached"], "within": within, "share": share}
            counts["single_branch"] = by_one
        answer["below" if below else "above"] = {"quantity": quantities[0], **counts}
    if picture is not None:
        from cartstiff.maps.pictures import draw_map
        from cartstiff.report.output import save_figure

        shown = {"by": by, "level": level, "angle": elastic.units.shown_angle}
        save_figure(draw_map(dataset, quantities[0], kind, **shown), picture)
    if told is not None:
        answer["explained"] = told

    def text() -> str:
        is_loaded = request.balanced_wrench is not None
        names, weighed = elastic.names_with_units, gravity_loads(elastic).text
        lines = [describe_map(answer, names, weighed, is_loaded)]
        return "\n".join([*lines, *(describe(told) if told else [])])

    tell(answer, request.mechanism, text)


def _check_picture(kind: str, by: str | None, sampling: Any, cuts: dict[str, float]) -> None:
    """Refuse a picture that does not fit before the map is computed."""
    lengths = dict(zip(sampling.dims, sampling.shape, strict=True))
    wide = [n for n, count in lengths.items() if count > 1 and n not in cuts and n != "branch"]
    shown = {"line": 1, "heat": 2, "slices": 3}.get(kind)
    if shown is not None and len(wide) != shown:
        raise InputError(
            f"shows {shown} dimension(s)",
            where=f"--kind {kind}",
            expected="--slice or another kind",
            got=", ".join(wide) or "none",
        )
    if by is not None and by not in wide:
        raise UnknownNameError("axis of the map", by, wide, where="--by")


def _check_ranked(quantities: tuple[str, ...]) -> None:
    """Refuse a list of the best of what has no better end before the map is computed."""
    from cartstiff.maps.quantities import QUANTITIES

    for name in quantities:
        if "." in name or (name in QUANTITIES and QUANTITIES[name].better is None):
            raise InputError(
                f"neither end of {name} is better",
                where="--best or --worst",
                expected="other quantities",
            )


def _answer(
    file: MapFile, output: Path, computed: int, seconds: float, summed: dict[str, Any]
) -> dict[str, Any]:
    about, total = file.attributes, math.prod(file.shape)
    return {
        "schema": about["schema"],
        "file": str(output),
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


_COMPARE_EXAMPLES = """\b
Examples:
  cartstiff compare wall.zarr ceiling.zarr --picture ratio.png
  cartstiff compare ur10.zarr kr210.zarr --quantity deflection --difference --json
"""


@click.command(name="compare", epilog=_COMPARE_EXAMPLES)
@click.argument("first", metavar="FIRST.zarr", type=click.Path(path_type=Path))
@click.argument("second", metavar="SECOND.zarr", type=click.Path(path_type=Path))
@click.option(
    "--quantity", metavar="NAME", help="Quantity to compare; default the first that both maps hold."
)
@flag("--difference", "The first map minus the second, instead of the first over the second.")
@repeated_option(
    "--slice cuts", Pairs("NAME=VALUE"), "Only the part of both maps at this value of an axis."
)
@option("--picture", PICTURE, "Draw it to a .png, .svg or .pdf file.")
@json_option
def compare_command(
    first: Path,
    second: Path,
    quantity: str | None,
    difference: bool,
    cuts: dict[str, float],
    picture: Path | None,
) -> None:
    """Ratio or difference of two maps of the same places: two arms, two mountings.

    FIRST and SECOND are maps of `cartstiff map`, over the same axes. At a place with several
    branches each map's best one counts.
    """
    from cartstiff.maps.across import compare_maps, compared
    from cartstiff.maps.reading import places_of, quantities_of, slice_map
    from cartstiff.maps.store import open_map

    a, b = (open_map(path) for path in (first, second))
    if quantity is None:
        both = [name for name in quantities_of(a) if name in quantities_of(b)]
        quantity = both[0] if both else quantities_of(a)[0]
    cuts = {name.replace("/", "."): value for name, value in cuts.items()}
    a, b = (slice_map(data, **cuts) if cuts else data for data in (a, b))
    result = compare_maps(a, b, quantity, "difference" if difference else "ratio")
    answer = {
        "schema": "cartstiff-compare/1",
        "quantity": quantity,
        "how": "difference" if difference else "ratio",
        "first": str(first),
        "second": str(second),
        **compared(result, quantity),
        "slice": places_of(a, cuts),
    }
    if picture is not None:
        from cartstiff.maps.pictures import draw_map
        from cartstiff.report.output import save_figure

        save_figure(draw_map(result, quantity), picture)
    from cartstiff.report.maps import describe_comparison

    words = str(result[quantity].attrs["long_name"])
    tell(answer, str(first), lambda: describe_comparison(answer, words))
