"""``cartstiff equilibrium``."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import click

from cartstiff.cli.options import (
    LoadRequest,
    MechanismRequest,
    load_options,
    mechanism_options,
    once,
)
from cartstiff.cli.output import output_file, print_json, say
from cartstiff.cli.path_file import WRENCH
from cartstiff.errors import InputError, one_line
from cartstiff.parsing import parse_numbers

__all__ = ["command"]

_COMPONENTS = ("rx", "ry", "rz", "x", "y", "z")

_EPILOG = """\b
Examples:
  cartstiff equilibrium ur5 --load 0,0,0,0,0,-100
  cartstiff equilibrium stewart-gough --load 0,0,0,0,0,-50 --world --json
  cartstiff equilibrium ur5 --load 0,0,0,0,0,-100 --world --load-at 0,0,0.1
  cartstiff equilibrium ur5 --load 0,0,5,0,0,-100 --load-kind follower
  cartstiff equilibrium panda --payload 3,0,0,0.1
  cartstiff equilibrium ur5 --hold z=-0.002
  cartstiff equilibrium five-bar --load 0,0,0,0,-2000,0 --curve 3 --plot curve.png
  cartstiff equilibrium ur5 --load 0,0,0,0,0,-80 --path postures.csv --csv commands.csv
"""


@click.command(name="equilibrium", epilog=_EPILOG)
@mechanism_options(
    load_help="Wrench on the body: moment about and force at the point --load-at, in the axes of "
    "the unloaded body frame; see --load-kind."
)
@load_options(kinds=True, world="--load and --hold")
@click.option("--follower", is_flag=True, help="The same as --load-kind follower.")
@click.option(
    "--payload",
    "payload_text",
    multiple=True,
    callback=once,
    metavar="MASS[,X,Y,Z]",
    help="Weight of a mass (kg, whatever the units of lengths and forces) at a point of the body "
    "frame, under the file's gravity or 9.81 m/s^2.",
)
@click.option(
    "--hold",
    "hold_text",
    multiple=True,
    callback=once,
    metavar="NAME=VALUE,...",
    help="Displacement of the body prescribed in rx, ry, rz, x, y, z (rad, length), along the axes "
    "of the unloaded body; with --world along the inertial axes.",
)
@click.option("--no-limits", is_flag=True, help="Ignore joint and leg limits.")
@click.option(
    "--curve",
    "curve_text",
    metavar="FACTOR",
    multiple=True,
    callback=once,
    help="Load-deflection curve up to this multiple of the load, with critical loads.",
)
@click.option(
    "--path",
    "path_text",
    metavar="FILE.csv",
    multiple=True,
    callback=once,
    help="Compensate along a path: one posture a line, or posture and wrench (as for --load, in "
    "the axes of the body at that posture), under a line of names if wanted; gives the commands "
    "that put the loaded body there.",
)
@click.option(
    "--csv",
    "csv_text",
    metavar="FILE.csv",
    multiple=True,
    callback=once,
    help="Write the curve or path.",
)
@click.option(
    "--plot",
    "plot_text",
    metavar="FILE.png",
    multiple=True,
    callback=once,
    help="Draw the curve or path.",
)
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object.")
def command(
    request: MechanismRequest,
    applied: LoadRequest,
    follower: bool,
    payload_text: str | None,
    hold_text: str | None,
    no_limits: bool,
    curve_text: str | None,
    path_text: str | None,
    csv_text: str | None,
    plot_text: str | None,
    as_json: bool,
) -> None:
    """Where MECHANISM comes to rest under load, how stable it is, and how stiff there.

    Springs without a rest position carry gravity at the posture, where the mechanism is at rest
    without the load. Loads of constant direction and moments that do not turn with the body are
    dead loads; a moment has no potential.
    """
    if follower:
        source = click.get_current_context().get_parameter_source("load_kind")
        if source is click.core.ParameterSource.COMMANDLINE:
            raise InputError("give --follower or --load-kind, not both")
        applied = replace(applied, kind="follower")
    if curve_text is not None and path_text is not None:
        raise InputError("give --curve or --path, not both")
    several = curve_text is not None or path_text is not None
    if (csv_text is not None or plot_text is not None) and not several:
        raise InputError("--csv and --plot go with --curve or --path")
    if no_limits and several:
        raise InputError("--no-limits does not go with --curve or --path")
    if path_text is not None:
        for option, text in (
            ("--hold", hold_text),
            ("--q", request.q_text),
            ("--pose", request.pose_text),
        ):
            if text is not None:
                raise InputError(f"give {option} or --path, not both")
    csv = None if csv_text is None else output_file(csv_text, (".csv",), "--csv")
    plot = None if plot_text is None else output_file(plot_text, (".png", ".svg", ".pdf"), "--plot")
    held = None if hold_text is None else _held(hold_text)
    wrench = request.wrench
    curve_to = None if curve_text is None else parse_numbers(curve_text, "--curve", 1)[0]
    if curve_to == 0.0:
        raise InputError("not a usable factor", where="--curve", expected="a number not 0",
                         got=curve_text)  # fmt: skip
    elastic, q = request.load()

    from cartstiff.mechanisms.contract import named_values
    from cartstiff.statics.held import Held
    from cartstiff.stiffness.applied_load import LoadKind

    if isinstance(q, dict):
        q = named_values(q, elastic.names, elastic.q, "--q")
    q = elastic.mechanism.assembled(elastic.q if q is None else q)
    weight = _payload(elastic, payload_text)
    kind = LoadKind(applied.kind, applied.at)  # type: ignore[arg-type]
    axes: Any = applied.axes

    def loads_at(q: Any, wrench: Any) -> tuple[Any, ...]:
        """What acts on a body that is to be at q."""
        if wrench is None:
            return weight
        return (kind.acting(wrench, elastic.mechanism.at(q).pose, axes), *weight)

    hold = None if held is None else Held(held, axes=axes)
    loads = loads_at(q, wrench)
    if path_text is not None:
        _compensate(elastic, Path(path_text), wrench, loads_at, csv, plot, as_json)
    elif curve_to is not None:
        if not loads:
            raise InputError("a curve needs a load", expected="--load or --payload")
        _curve(elastic, loads, curve_to, q, hold, csv, plot, as_json)
    else:
        _rest(elastic, loads, q, hold, not no_limits, as_json)


def _held(text: str) -> dict[str, float]:
    values: dict[str, float] = {}
    for part in text.split(","):
        name, equals, number = part.partition("=")
        if not equals or name.strip() not in _COMPONENTS or name.strip() in values:
            raise InputError(
                "cannot be used", where="--hold", got=repr(part),
                expected=f"NAME=VALUE pairs of {', '.join(_COMPONENTS)}, each once",
            )  # fmt: skip
        values[name.strip()] = parse_numbers(number, "--hold", 1)[0]
    return values


def _payload(elastic: Any, text: str | None) -> tuple[Any, ...]:
    from cartstiff.potentials.loads import payload

    if text is None:
        return ()
    numbers = parse_numbers(text, "--payload")
    if len(numbers) not in (1, 4):
        raise InputError("wrong count", where="--payload", expected="MASS or MASS,X,Y,Z",
                         got=str(len(numbers)))  # fmt: skip
    gravity = (0.0, 0.0, -9.81) if elastic.gravity is None else elastic.gravity
    mass = numbers[0] / elastic.units.newtons  # weights are in the unit of force
    return (payload(mass, gravity, numbers[1:] or (0.0, 0.0, 0.0)),)


def _rest(
    elastic: Any, loads: tuple[Any, ...], q: Any, held: Any, limits: bool, as_json: bool
) -> None:
    from cartstiff.report.statics import describe_equilibrium
    from cartstiff.statics.equilibrium import equilibrium

    state = equilibrium(elastic, *loads, q0=q, held=held, limits=limits)
    if as_json:
        print_json(state.as_dict(), elastic.name)
    else:
        say(describe_equilibrium(state))


def _save(result: Any, csv: Path | None, plot: Path | None, draw: Any) -> None:
    from cartstiff.report.figures_statics import picture
    from cartstiff.report.output import write_whole

    # Everything is made before anything is written.
    files = []
    if csv is not None:
        files.append((csv, result.as_csv().encode()))
    if plot is not None:
        files.append((plot, picture(draw(result), plot.suffix)))
    for path, _ in files:
        if not path.parent.is_dir():
            raise InputError("file cannot be written", where=one_line(str(path)),
                             got="no such folder")  # fmt: skip
    for path, data in files:
        write_whole(path, data)


def _curve(
    elastic: Any, loads: tuple[Any, ...], to: float, q: Any, held: Any, csv: Path | None,
    plot: Path | None, as_json: bool,
) -> None:  # fmt: skip
    from cartstiff.report.figures_statics import draw_load_curve
    from cartstiff.report.statics import describe_curve
    from cartstiff.statics.continuation import load_curve

    curve = load_curve(elastic, *loads, to=to, q0=q, held=held)
    _save(curve, csv, plot, draw_load_curve)
    if as_json:
        print_json(curve.as_dict(), elastic.name)
    else:
        say(describe_curve(curve))


def _compensate(
    elastic: Any, path: Path, wrench: list[float] | None,
    loads_at: Callable[[Any, Any], tuple[Any, ...]], csv: Path | None, plot: Path | None,
    as_json: bool,
) -> None:  # fmt: skip
    from cartstiff.loading.csv_file import read_rows
    from cartstiff.report.figures_statics import draw_error_along_path
    from cartstiff.report.statics import describe_path
    from cartstiff.statics.toolpath import compensate

    n = len(elastic.names)
    layouts = elastic.names, (*elastic.names, *WRENCH)
    _, table = read_rows(path, "postures").arranged(*layouts)
    postures, wrenches = table[:, :n], [wrench] * len(table)
    if table.shape[1] > n:
        if wrench is not None:
            raise InputError("give wrenches by --load or in the path file, not both")
        wrenches = list(table[:, n:])
    loads = [list(loads_at(q, w)) for q, w in zip(postures, wrenches, strict=True)]
    if not loads[0]:
        raise InputError("a path needs a load", where="--path",
                         expected="--load, --payload, or six more columns in the file")  # fmt: skip
    result = compensate(elastic, postures, loads)
    _save(result, csv, plot, draw_error_along_path)
    if as_json:
        print_json(result.as_dict(), elastic.name)
    else:
        say(describe_path(result))
