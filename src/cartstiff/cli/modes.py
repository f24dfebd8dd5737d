"""``cartstiff modes``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from cartstiff.choices import AXES, ORDERS
from cartstiff.cli.controller import ControllerRequest
from cartstiff.cli.milling import LobesRequest, cutting_options
from cartstiff.cli.options import LoadRequest, MechanismRequest, load_options, mechanism_options
from cartstiff.cli.output import tell
from cartstiff.cli.requests.parameters import (
    add_accuracy,
    add_intervals,
    add_sensitivities,
    checked_tolerance,
    sensitivities_option,
    tolerance_option,
)
from cartstiff.cli.requests.units import UnitsCommand
from cartstiff.cli.response import KINDS, ResponseRequest
from cartstiff.cli.types import (
    DIRECTION,
    PICTURE,
    POINT,
    Numbers,
    OutputFile,
    json_option,
    option,
    option_group,
)
from cartstiff.errors import InputError, UndefinedError, UnknownNameError

if TYPE_CHECKING:
    from cartstiff.vibration.mode_set import Modes

_EPILOG = """\b
Examples:
  cartstiff modes stewart-simscape
  cartstiff modes ur5 --load 0,0,0,0,0,-500 --world
  cartstiff modes panda --payload 2,0,0,0.1 --json
  cartstiff modes ur5 --load 0,0,0,0,0,-500 --compare A,B,K,F,energy
  cartstiff modes ur5 --response 5:100 --damping 0.02 --direction 0,0,1 --plot bode.png
  cartstiff modes stewart-simscape --damping 0.02 --milling 6e8,0.3,3,0,1.5708 \\
    --lobes 9000:20000 --plot lobes.png
  cartstiff modes panda --impedance wanted.json --ratio 0.7 -o controller.yaml
  cartstiff modes stewart-simscape --sensitivities --tolerance 0.05,0.0001
"""

_options = option_group(
    option(
        "--compare",
        metavar="NAMES",
        help="Also print the frequencies that a 6x6 stiffness and a mass at the tip would give: "
        "some of A,B,K,F,load,energy.",
    ),
    sensitivities_option,
    tolerance_option(
        "an interval for each frequency (measured springs give one without this "
        "option) and what contributes most to it"
    ),
    option(
        "--response",
        metavar="LOW:HIGH[:COUNT]",
        help="Response of the body to a force on it at COUNT frequencies [Hz], 400 by default: in "
        "equal ratios, or in equal steps if LOW is 0.",
    ),
    click.option(
        "--kind",
        type=click.Choice(KINDS),
        default="receptance",
        show_default=True,
        help="Displacement, velocity or acceleration per force; or motion of the body per motion "
        "of the ground.",
    ),
    option("--point", type=POINT, help="Point of the body, in its frame, for --response."),
    option(
        "--direction",
        type=DIRECTION,
        help="Direction for --response, along the body's axes (the room's for a "
        "transmissibility); default x, y and z.",
    ),
    option(
        "--damping",
        type=Numbers("RATIO[,RATIO...]"),
        help="Damping ratio of every mode, or one for each, for --response and --lobes.",
    ),
    option(
        "--rayleigh",
        type=Numbers("ALPHA,BETA", 2),
        help="Damping alpha M + beta K [1/s, s], for --response and --lobes. Dampers of the "
        "mechanism's file always act.",
    ),
    option(
        "--lobes",
        metavar="LOW:HIGH[:COUNT]",
        help="Stability lobes of --milling between two spindle speeds [rev/min]: limiting depth by "
        "the zeroth-order theory.",
    ),
    cutting_options,
    option("--csv", type=OutputFile("FILE.csv", ".csv"), help="Write the response, or the lobes."),
    option("--plot", type=PICTURE, help="Draw the response as a Bode diagram, or the lobes."),
    option(
        "--impedance",
        type=click.Path(path_type=Path),
        metavar="FILE",
        help="Stiffness that a controller shall give at the body frame (6x6; .json, .csv or "
        ".npy). The answer has the damping by double diagonalisation with the masses at the "
        "posture, in the order and along the axes of the file, and joint-space gains.",
    ),
    click.option(
        "--order",
        type=click.Choice(ORDERS),
        help=f"Order of the rows of --impedance; default what its file says, else {ORDERS[0]}.",
    ),
    click.option(
        "--axes",
        type=click.Choice(AXES),
        default="body",
        show_default=True,
        help="Axes of --impedance, about the body frame's origin: of the robot's own base, of the "
        "body frame, or of the room (world).",
    ),
    option(
        "--ratio",
        type=Numbers("RATIO[,RATIO...]", 1, 6),
        help="Damping ratios of the six oscillators of --impedance, softest first; default 0.7.",
    ),
    option(
        "-o",
        "--output",
        type=OutputFile("FILE", ".json", ".yaml"),
        help="Write the controller of --impedance.",
    ),
    json_option,
    click.option("--strict", is_flag=True, help="Exit with code 3 where there are no modes."),
)


@click.command(name="modes", cls=UnitsCommand, epilog=_EPILOG)
@mechanism_options(
    load_help="Wrench on the body: moment about and force at the point --load-at, in the body's "
    "axes; rest positions are chosen so that the springs balance it. The modes without "
    "the load are printed beside them."
)
@load_options("--load")
@_options
def command(
    request: MechanismRequest,
    applied: LoadRequest,
    compare: str | None,
    sensitivities: bool,
    tolerance: list[float] | None,
    impedance: Path | None,
    order: str | None,
    axes: str,
    ratio: list[float] | None,
    output: Path | None,
    lobes: str | None,
    milling: list[float] | None,
    feed: list[float] | None,
    normal: list[float] | None,
    tip: list[float] | None,
    as_json: bool,
    strict: bool,
    **response_options: Any,
) -> None:
    """Natural frequencies and modes of MECHANISM at a posture, under its load.

    Small undamped motions about the rest state: K phi = omega^2 M phi with the second derivative K
    of all energies and the masses' matrix M, on the motions that keep the closures. A load moves
    the frequencies; every table says which load it belongs to.
    """
    wrench = request.balanced_wrench
    applied.check_world(load=wrench)
    checked_tolerance(tolerance)
    files = {} if lobes is None else {n: response_options.pop(n) for n in ("csv", "plot")}
    if response_options["response"] is not None and any(files.values()):
        raise InputError(
            "serve one at a time", where="--csv and --plot", expected="--response or --lobes"
        )
    response = ResponseRequest(**response_options, lobes=lobes is not None)
    cut = LobesRequest(lobes, milling, feed, normal, tip, **files)
    controller = ControllerRequest(impedance, order, axes, ratio, output)
    elastic, q = request.load()

    import numpy as np

    from cartstiff.vibration.mode_set import MODES_SCHEMA
    from cartstiff.vibration.modes import modes

    try:
        with np.errstate(all="ignore"):
            swinging = modes(elastic, q, wrench=wrench, **applied.keywords(wrench))
            bare = None if wrench is None or not any(wrench) else modes(elastic, q)
    except UndefinedError as error:
        if strict:
            raise
        note = {"code": error.code, "message": str(error), "values": dict(error.values)}
        data: dict[str, Any] = {"schema": MODES_SCHEMA, "frequencies": [], "notes": [note]}
        words = f"{elastic.name}: no modes\n  [{error.code}] {error}"
        tell(as_json, data, request.mechanism, lambda: words)
        return
    data = swinging.as_dict()
    if bare is not None:
        unloaded = bare.as_dict()
        data["unloaded"] = {key: unloaded[key] for key in ("frequencies", "eigenvalues", "load")}
    from cartstiff.report.modes import describe_modes

    extra = _more(swinging, request, data, compare, sensitivities, tolerance)
    extra += response.run(swinging, data)
    extra += cut.run(swinging, response.damped, data)
    extra += controller.run(swinging, data)
    tell(as_json, data, request.mechanism, lambda: describe_modes(swinging, bare, extra))


def _more(
    modes: Modes,
    request: MechanismRequest,
    data: dict[str, Any],
    compare: str | None,
    wanted: bool,
    tolerance: list[float] | None,
) -> list[str]:
    """Adds what was asked for to the JSON object, and gives it as lines."""
    from cartstiff.report.modes import describe_comparison

    lines: list[str] = []
    if compare is not None:
        from cartstiff.vibration.comparison import compare as compared

        names = [name.strip() for name in compare.split(",")]
        try:
            shortcuts = compared(modes, names)
        except UnknownNameError as error:
            raise error.at("--compare") from None
        data["compare"] = [shortcut.as_dict() for shortcut in shortcuts]
        lines += describe_comparison(shortcuts)
    known = None
    if wanted:
        more, known = add_sensitivities(modes, request, data)
        lines += more
    if tolerance is not None or modes.elastic.identified is not None:
        more, known = add_intervals(modes, tolerance, data, known)
        lines += more
    if tolerance is not None:
        lines += add_accuracy(modes, tolerance, data, known)
    return lines
