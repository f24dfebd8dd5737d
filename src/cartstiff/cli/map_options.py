"""Options of ``cartstiff map`` that say where it looks, and how their text becomes a sampling."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar, get_args

import click

from cartstiff.cli.options import once
from cartstiff.errors import InputError
from cartstiff.parsing import parse_numbers

if TYPE_CHECKING:
    from cartstiff.maps.sampling import Axis, Sampling

__all__ = [
    "check_cuts",
    "parse_axes",
    "parse_cuts",
    "sampling_from_options",
    "sampling_options",
]

_Command = TypeVar("_Command", bound=Callable[..., Any])
# A map of more postures than this would take years.
_MOST = 10**12
_LARGEST_FILE = 2**30


def sampling_options(command: _Command) -> _Command:
    """Add the options; the command takes them as keywords for `sampling_from_options`."""
    axis = "NAME=LOW:HIGH:COUNT"
    options = [
        click.option(
            "--grid", "grid_texts", metavar=axis, multiple=True,
            help="Values of a coordinate; repeat it, or separate by commas, for several. The "
            "others stay where --q or the file has them.",
        ),
        click.option(
            "--random", "random_count", type=click.IntRange(1, _MOST), metavar="N",
            help="N random postures within the limits of the joints.",
        ),
        click.option(
            "--range", "range_texts", metavar="NAME=LOW:HIGH", multiple=True,
            help="With --random: other limits of a coordinate; --range NAME=V:V holds it.",
        ),
        click.option(
            "--cartesian", "cartesian_texts", metavar="x=LOW:HIGH:COUNT", multiple=True,
            help="Positions x, y, z of the body frame in F, by inverse kinematics.",
        ),
        click.option(
            "--trajectory", "trajectory_text", metavar="FILE.csv", multiple=True, callback=once,
            help="Postures of a file: a line of coordinate names, then one posture a line.",
        ),
        click.option(
            "--seed", type=click.IntRange(min=0), default=0, show_default=True,
            help="Of random postures and starts.",
        ),
        click.option(
            "--orientation", metavar="R,P,Y|keep", default="keep", show_default=True,
            help="With --cartesian: roll, pitch, yaw about fixed axes.",
        ),
        click.option(
            "--free", type=click.Choice(["none", "x", "y", "z", "rotation"]), default="none",
            show_default=True,
            help="With --cartesian: the body may turn about this axis of its own, or as it likes.",
        ),
        click.option(
            "--redundancy", type=click.Choice(["nearest", "best"]), default="nearest",
            show_default=True,
            help="With --cartesian, where many postures reach a place: nearest to the base "
            "posture, or best in the first quantity.",
        ),
        click.option(
            "--branches", type=click.IntRange(1, 1000), default=8, show_default=True,
            help="With --cartesian: most postures kept at a place.",
        ),
        click.option(
            "--starts", type=click.IntRange(0, 10000), default=24, show_default=True,
            help="With --cartesian: random starts of the inverse kinematics.",
        ),
    ]  # fmt: skip
    for option in reversed(options):
        command = option(command)
    return command


def parse_axes(
    texts: Sequence[str], option: str, count: bool = True
) -> dict[str, tuple[float, ...]]:
    """``NAME=LOW:HIGH:COUNT`` (or ``NAME=LOW:HIGH``) items, each name once."""
    shape = "NAME=LOW:HIGH:COUNT" if count else "NAME=LOW:HIGH"
    found: dict[str, tuple[float, ...]] = {}
    for item in (part for text in texts for part in re.split(r"[,\s]+", text.strip())):
        name, equals, numbers = item.partition("=")
        parts = numbers.split(":")
        if not equals or not name or len(parts) != (3 if count else 2):
            raise InputError("cannot be used", where=option, expected=shape, got=repr(item))
        if name in found:
            raise InputError("given twice", where=option, got=repr(name))
        found[name] = tuple(parse_numbers(p, f"{option} {name}", 1)[0] for p in parts)
        if count and not (found[name][2] == int(found[name][2]) and 1 <= found[name][2] <= _MOST):
            raise InputError(
                "count cannot be used", where=f"{option} {name}",
                expected="a whole number of 1 or more", got=parts[2],
            )  # fmt: skip
    return found


def _axes(texts: Sequence[str], option: str) -> dict[str, Axis]:
    from cartstiff.maps.sampling import Axis

    axes = {}
    for name, (low, high, n) in parse_axes(texts, option).items():
        try:
            axes[name] = Axis(low, high, int(n))
        except InputError as error:
            raise error.at(f"{option} {name}") from None
    return axes


def sampling_from_options(
    elastic: Any,
    q: Any,
    *,
    grid_texts: Sequence[str],
    random_count: int | None,
    range_texts: Sequence[str],
    cartesian_texts: Sequence[str],
    trajectory_text: str | None,
    seed: int,
    orientation: str,
    free: str,
    redundancy: str,
    branches: int,
    starts: int,
) -> Sampling:
    """The sampling that the options ask for; q is the base posture or None."""
    import numpy as np

    from cartstiff.maps.cartesian import CartesianGrid, Redundancy
    from cartstiff.maps.sampling import Grid, RandomPostures, Trajectory
    from cartstiff.mechanisms.contract import named_values

    kinds = [grid_texts, random_count, cartesian_texts, trajectory_text]
    if sum(bool(kind) for kind in kinds) != 1:
        raise InputError(
            "say where the map looks", expected="one of --grid, --random, --cartesian, --trajectory"
        )
    if range_texts and random_count is None:
        raise InputError("--range goes with --random")
    base = elastic.q if q is None else np.asarray(
        named_values(q, elastic.names, elastic.q, "--q"), float
    )  # fmt: skip
    if grid_texts:
        try:
            return Grid(_axes(grid_texts, "--grid"), elastic.names, base)
        except InputError as error:
            raise error if error.where else error.at("--grid") from None
    if random_count is not None:
        ranges = {n: (v[0], v[1]) for n, v in parse_axes(range_texts, "--range", False).items()}
        try:
            return RandomPostures.within_limits(elastic, random_count, seed, ranges)
        except InputError as error:
            raise error.at("--range") from None
    if trajectory_text is not None:
        return Trajectory.from_table(_table(Path(trajectory_text)), elastic, base)
    turn = None
    if orientation != "keep":
        from cartstiff.geometry import se3

        angles = parse_numbers(orientation, "--orientation", 3)
        turn = se3.from_roll_pitch_yaw(angles=angles)[:3, :3]
    if redundancy not in get_args(Redundancy):
        raise InputError("unknown", where="--redundancy", got=redundancy)
    try:
        return CartesianGrid(
            _axes(cartesian_texts, "--cartesian"), elastic, base, turn, branches=branches,
            starts=starts, seed=seed, free=free, redundancy=redundancy,  # type: ignore[arg-type]
        )  # fmt: skip
    except InputError as error:
        raise error if error.where else error.at("--cartesian") from None


def _table(path: Path) -> dict[str, Any]:
    """Columns of a CSV file by the names in its first line."""
    from cartstiff.loading.csv_file import read_rows

    rows = read_rows(path, "postures", _LARGEST_FILE)
    if rows.names is None:
        raise InputError("columns have no names", where=rows.place,
                         expected="a line of names, then one posture a line")  # fmt: skip
    return dict(zip(rows.names, rows.values.T, strict=True))


def parse_cuts(texts: tuple[str, ...]) -> dict[str, float]:
    """Values of --slice by dimension."""
    found: dict[str, float] = {}
    for item in (part for text in texts for part in text.split(",")):
        name, equals, number = item.partition("=")
        if not equals or name.strip() in found:
            raise InputError("cannot be used", where="--slice", expected="NAME=VALUE, each once",
                             got=repr(item))  # fmt: skip
        value = parse_numbers(number, f"--slice {name.strip()}", 1)[0]
        # Dimensions have dots where names of coordinates have slashes.
        found[name.strip().replace("/", ".")] = value
    return found


def check_cuts(cuts: dict[str, float], sampling: Any) -> None:
    """Refuse a slice before the map is computed."""
    from cartstiff.errors import UnknownNameError

    for name, value in cuts.items():
        if name not in sampling.axes:
            raise UnknownNameError("axis of the map", name, sampling.axes, where="--slice")
        axis = sampling.axes[name]
        if not axis.low <= value <= axis.high:
            raise InputError(
                "outside the map", where=f"--slice {name}",
                expected=f"{axis.low:g} to {axis.high:g}", got=f"{value:g}",
            )  # fmt: skip
