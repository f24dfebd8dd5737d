"""``cartstiff equilibrium``."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import click

from cartstiff.cli.options import (
    FILE,
    PICTURE,
    LoadRequest,
    MechanismRequest,
    Number,
    OutputFile,
    Pairs,
    UnitsCommand,
    Values,
    add_accuracy,
    add_sensitivities,
    checked_tolerance,
    column_factors,
    command_option,
    flag,
    json_option,
    load_options,
    mechanism_options,
    option,
    option_group,
    sensitivities_option,
    tolerance_option,
)
from cartstiff.cli.output import say_unused, tell
from cartstiff.cli.tables import WRENCH
from cartstiff.errors import InputError

_COMPONENTS = ("rx", "ry", "rz", "x", "y", "z")

_EPILOG = """\b
Examples:
  cartstiff equilibrium ur5 --load 0,0,0,0,0,-100
  cartstiff equilibrium stewart-gough --load 0,0,0,0,0,-50 --world --json
  cartstiff equilibrium ur5 --load 0,0,0,0,0,-100 --world --load-at 0,0,0.1
  cartstiff equilibrium ur5 --load 0,0,5,0,0,-100 --load-kind follower
  cartstiff equilibrium panda --payload 3,0,0,0.1
  cartstiff equilibrium stewart-gough --load 0,0,0,0,0,-50 --tolerance 0.05,0.01
  cartstiff equilibrium ur5 --hold z=-0.002
  cartstiff equilibrium 6-pus --load 0,0,0,0,0,-500 --actuate leg1/slide=0.001
  cartstiff equilibrium five-bar --load 0,0,0,0,-2000,0 --curve 3 --plot curve.png
  cartstiff equilibrium ur5 --load 0,0,0,0,0,-80 --path postures.csv --csv commands.csv
"""


_options = option_group(
    flag("--follower", "The same as --load-kind follower."),
    option(
        "--hold",
        Pairs("NAME=VALUE,...", _COMPONENTS, frame=True),
        "Displacement of the body prescribed in rx, ry, rz, x, y, z (rad, length), along the "
        "axes of the unloaded body, or with --world the inertial axes.",
    ),
    flag("--no-limits", "Ignore joint and leg limits."),
    option(
        "--curve",
        Number("FACTOR"),
        "Load-deflection curve up to this multiple of the load, with critical loads.",
    ),
    option(
        "--path",
        FILE,
        "Compensate along a path: one posture a line, or posture and wrench (as for --load, "
        "in the axes of the body at that posture), under a line of names if wanted; gives the "
        "commands that put the loaded body there.",
        metavar="FILE.csv",
    ),
    sensitivities_option,
    tolerance_option(
        "the deviations of pose, stiffness and frequencies that follow, and what "
        "contributes most. Rest lengths and angles deviate, too"
    ),
    option("--csv", OutputFile("FILE.csv", ".csv"), "Write the curve or path."),
    option("--plot", PICTURE, "Draw the curve or path."),
    json_option,
)


@click.command(name="equilibrium", cls=UnitsCommand, epilog=_EPILOG)
@mechanism_options(
    load_help="Wrench on the body: moment about and force at the point --load-at, in the axes of "
    "the unloaded body frame; see --load-kind."
)
@load_options("--load and --hold")
@command_option
@_options
def command(
    request: MechanismRequest,
    applied: LoadRequest,
    told: Values | None,
    follower: bool,
    hold: dict[str, float] | None,
    no_limits: bool,
    curve: float | None,
    path: Path | None,
    sensitivities: bool,
    tolerance: list[float] | None,
    csv: Path | None,
    plot: Path | None,
) -> None:
    """Where MECHANISM comes to rest under load, how stable it is, and how stiff there.

    Without the load the mechanism rests at the posture: springs without a rest position carry its
    weight there. A dead load keeps its direction in the room while the body moves. A dead moment
    has no energy; whether the rest is stable then depends on the masses.
    """
    if follower:
        source = click.get_current_context().get_parameter_source("load_kind")
        if source is click.core.ParameterSource.COMMANDLINE:
            raise InputError("give --follower or --load-kind, not both")
        applied = replace(applied, load_kind="follower")
    if curve is not None and path is not None:
        raise InputError("give --curve or --path, not both")
    several = curve is not None or path is not None
    if (csv is not None or plot is not None) and not several:
        raise InputError("--csv and --plot go with --curve or --path")
    checked_tolerance(tolerance)
    if several and (sensitivities or tolerance is not None):
        raise InputError("--sensitivities and --tolerance do not go with --curve or --path")
    if no_limits and several:
        raise InputError("--no-limits does not go with --curve or --path")
    for name, value in (
        ("--hold", hold),
        ("--q", request.q),
        ("--pose", request.pose),
        ("--actuate", told),
    ):
        if path is not None and value is not None:
            raise InputError(f"give {name} or --path, not both")
    applied.check_world(load=request.wrench, hold=hold, path=path)
    applied.check_load(request.wrench is not None or path is not None)
    if curve == 0.0:
        raise InputError("not a usable factor", where="--curve", expected="a number not 0", got="0")
    # A payload is a load here: it deflects the mechanism, which is at rest without it.
    bare, hung = replace(request, payload=None), request.payload
    elastic, q = bare.load()

    from cartstiff.mechanisms.elastic import with_default_gravity
    from cartstiff.statics.held import Held
    from cartstiff.stiffness.applied_load import LoadKind

    def weighing(elastic: Any) -> Any:
        """The mechanism in the field in which its payload weighs."""
        weighs = hung and (request.gravity is None or any(request.gravity))
        return with_default_gravity(elastic, hung[0]) if hung and weighs else elastic

    elastic = weighing(elastic)

    elastic, posture = elastic.placed(q, "--q")
    q = posture.q
    weight = _weight(elastic, hung)
    kind = LoadKind(applied.load_kind, applied.acts_at)  # type: ignore[arg-type]

    def loads_at(q: Any, wrench: Any) -> tuple[Any, ...]:
        """What acts on a body that is to be at q."""
        if wrench is None:
            return weight
        return (kind.acting(wrench, elastic.mechanism.at(q).pose, applied.axes), *weight)

    from cartstiff.statics.command import commanded

    if told is not None:
        elastic, q = commanded(elastic, request.command(told, elastic), q)

    held = None if hold is None else Held(hold, axes=applied.axes)
    if path is not None:
        _compensate(elastic, path, request.wrench, applied, loads_at, csv, plot)
        return
    loads = loads_at(q, request.wrench)
    if curve is None:
        from cartstiff.report.statics import describe_equilibrium
        from cartstiff.statics.equilibrium import equilibrium

        state = equilibrium(elastic, *loads, q0=q, held=held, limits=not no_limits)
        data, known = state.as_dict(), None
        more: list[str] = []
        if sensitivities:
            more, known = add_sensitivities(
                state,
                bare,
                data,
                lambda e: (
                    weighing(e)
                    if told is None
                    else commanded(weighing(e), request.command(told, e), q)[0]
                ),
            )
        if tolerance is not None:
            more += add_accuracy(state, tolerance, data, known)
        tell(data, elastic.name, lambda: "\n".join([describe_equilibrium(state), *more]))
        return
    if not loads:
        raise InputError("a curve needs a load", expected="--load or --payload")

    from cartstiff.report.output import write_files
    from cartstiff.report.statics import describe_curve, draw_load_curve
    from cartstiff.statics.continuation import load_curve

    result = load_curve(elastic, *loads, to=curve, q0=q, held=held)
    write_files((csv, result.as_csv), (plot, lambda: draw_load_curve(result)))
    tell(result.as_dict(), elastic.name, lambda: describe_curve(result))


def _weight(elastic: Any, numbers: list[float] | None) -> tuple[Any, ...]:
    """Load of --payload."""
    from cartstiff.potentials.loads import payload

    if numbers is None:
        return ()
    gravity = (0.0, 0.0, 0.0) if elastic.gravity is None else elastic.gravity
    mass = numbers[0] / elastic.units.newtons  # weights are in the unit of force
    return (payload(mass, gravity, numbers[1:] or (0.0, 0.0, 0.0)),)


def _compensate(
    elastic: Any,
    path: Path,
    wrench: list[float] | None,
    applied: LoadRequest,
    loads_at: Callable[[Any, Any], tuple[Any, ...]],
    csv: Path | None,
    plot: Path | None,
) -> None:
    from cartstiff.loading.tables import read_rows
    from cartstiff.report.output import write_files
    from cartstiff.report.statics import describe_path, draw_error_along_path
    from cartstiff.statics.toolpath import compensate

    n = len(elastic.names)
    rows = read_rows(
        path, "postures", units=elastic.units, factors=column_factors(elastic), joints=elastic.names
    )
    _, table, unused = rows.arranged(elastic.names, (*elastic.names, *WRENCH))
    say_unused(path, unused)
    postures, wrenches = table[:, :n], [wrench] * len(table)
    if table.shape[1] > n:
        if wrench is not None:
            raise InputError("give wrenches by --load or in the path file, not both")
        wrenches = list(table[:, n:])
    applied.check_load(wrenches[0] is not None)
    loads = [list(loads_at(q, w)) for q, w in zip(postures, wrenches, strict=True)]
    if not loads[0]:
        raise InputError(
            "a path needs a load",
            where="--path",
            expected="--load, --payload, or six more columns in the file",
        )
    result = compensate(elastic, postures, loads)
    write_files((csv, result.as_csv), (plot, lambda: draw_error_along_path(result)))
    tell(
        result.as_dict(),
        elastic.name,
        lambda: describe_path(result, is_written=csv is not None),
    )
