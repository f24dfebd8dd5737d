"""Options of ``cartstiff map`` that say where it looks, and how their text becomes a sampling."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from cartstiff.cli.output import say_unused
from cartstiff.cli.types import ANGLE, Axes, Factors, Numbers, option, option_group, repeated_option
from cartstiff.errors import InputError, UnknownNameError

if TYPE_CHECKING:
    from cartstiff.maps.sampling import Axis, Sampling

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
        type=Axes("NAME=LOW:HIGH:COUNT"),
        help="Values of a coordinate; repeat it, or separate by commas, for several. The others "
        "stay where --q or the file has them.",
    ),
    click.option(
        "--random",
        type=click.IntRange(1, _MOST),
        metavar="N",
        help="N random postures within the limits of the joints; links that give start unbent.",
    ),
    repeated_option(
        "--range",
        "ranges",
        type=Axes("NAME=LOW:HIGH"),
        help="With --random: other limits of a coordinate; --range NAME=V:V holds it.",
    ),
    repeated_option(
        "--cartesian",
        type=Axes("x=LOW:HIGH:COUNT"),
        help="Positions x, y, z of the body frame in F, by inverse kinematics.",
    ),
    repeated_option(
        "--actuate",
        "told",
        type=Axes("NAME=LOW:HIGH:COUNT", single=True),
        help="How far a drive moves from the posture: leg1=-0.001:0.001:11 maps commands from "
        "--q, leg1/slide=0.001 holds at every posture of a map. The map holds what is true "
        "where the machine comes to rest.",
    ),
    option(
        "--trajectory",
        type=click.Path(path_type=Path),
        metavar="FILE.csv",
        help="Postures of a file: a line of coordinate names, then one posture a line.",
    ),
    click.option(
        "--seed",
        type=click.IntRange(min=0),
        default=0,
        show_default=True,
        help="Seed of random postures and starts.",
    ),
    click.option(
        "--orientation",
        type=_Orientation("R,P,Y|keep", 3, powers=(ANGLE,)),
        default="keep",
        show_default=True,
        help="With --cartesian: roll, pitch, yaw about fixed axes.",
    ),
    click.option(
        "--free",
        type=click.Choice(["none", "x", "y", "z", "rotation"]),
        default="none",
        show_default=True,
        help="With --cartesian: the body may turn about this axis of its own, or in any way.",
    ),
    click.option(
        "--redundancy",
        type=click.Choice(["nearest", "best"]),
        default="nearest",
        show_default=True,
        help="With --cartesian, where many postures reach a place: nearest to the base posture, "
        "or best in the first quantity.",
    ),
    click.option(
        "--branches",
        type=click.IntRange(1, 1000),
        default=8,
        show_default=True,
        help="With --cartesian: most postures kept at a place.",
    ),
    click.option(
        "--starts",
        type=click.IntRange(0, 10000),
        default=24,
        show_default=True,
        help="With --cartesian: random starts of the inverse kinematics.",
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
    """The sampling that the options ask for, and what drives are told at all of its postures.

    q is the base posture or None.
    """
    from cartstiff.maps.cartesian import CartesianGrid
    from cartstiff.maps.commanded import CommandGrid
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
        if name not in sampling.axes:
            raise UnknownNameError("axis of the map", name, sampling.axes, where="--slice")
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
