"""``cartstiff modes``."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from cartstiff.choices import AXES, ORDERS, RESPONSES
from cartstiff.cli.options import (
    DIRECTION,
    FILE,
    PICTURE,
    POINT,
    LoadRequest,
    LobesRequest,
    MechanismRequest,
    Numbers,
    OutputFile,
    UnitsCommand,
    add_accuracy,
    add_intervals,
    add_sensitivities,
    checked_tolerance,
    choice,
    cutting_options,
    damping_of,
    flag,
    json_option,
    load_options,
    mechanism_options,
    only_with,
    option,
    option_group,
    sensitivities_option,
    tolerance_option,
)
from cartstiff.cli.output import tell
from cartstiff.cli.tables import read_target
from cartstiff.errors import InputError, UndefinedError, UnknownNameError
from cartstiff.parsing import parse_numbers

if TYPE_CHECKING:
    from cartstiff.vibration.modes import Modes
    from cartstiff.vibration.response import Damping


@dataclass(frozen=True)
class ControllerRequest:
    """The options about the controller, checked."""

    impedance: Path | None
    order: str | None
    axes: str
    ratio: list[float] | None
    output: Path | None

    def __post_init__(self) -> None:
        if self.impedance is None:
            axes = None if self.axes == "body" else self.axes
            only_with(
                "impedance", order=self.order, axes=axes, ratio=self.ratio, output=self.output
            )
        elif self.ratio is not None and min(self.ratio) < 0.0:
            raise InputError(
                "cannot be used", where="--ratio", expected="zero or more", got=self.ratio
            )

    def run(self, modes: Modes, data: dict[str, Any]) -> list[str]:
        """Computes, adds to the JSON object, writes the file; lines for people."""
        if self.impedance is None:
            return []
        from cartstiff.report.modes import describe_impedance
        from cartstiff.stiffness.tensor import StiffnessTensor
        from cartstiff.vibration.controllers import impedance

        target = read_target(self.impedance, self.order)
        wanted = StiffnessTensor.from_controller(
            target.in_units_of(modes.elastic.mechanism),
            order=target.order,  # type: ignore[arg-type]
            axes=self.axes,  # type: ignore[arg-type]
            pose=modes.posture.pose,
            base=modes.elastic.mechanism.base_pose,
            frame=modes.elastic.mechanism.frame,
            units=modes.elastic.units,
        )
        answer = impedance(modes, wanted, self.ratio or 0.7)
        gains = {
            "given": {"order": target.order, "axes": self.axes, "ratios": self.ratio or [0.7]},
            "q": dict(zip(modes.elastic.names, modes.q.tolist(), strict=True)),
            "units": modes.elastic.units.as_dict(),
            "for_controller": answer.for_controller(target.order, self.axes),  # type: ignore[arg-type]
            **answer.as_dict(),
        }
        data["impedance"] = gains
        if self.output is not None:
            from cartstiff.report.output import write_whole

            write_whole(self.output, _text(gains, self.output.suffix).encode())
        shown = gains["for_controller"]
        return describe_impedance(answer, shown, modes.elastic.units)


def _text(gains: dict[str, Any], ending: str) -> str:
    """JSON, or the same as YAML: one key a line, rows of matrices in brackets."""
    if ending == ".json":
        return json.dumps(gains, allow_nan=False, indent=1) + "\n"
    lines = []
    for key, value in gains.items():
        if isinstance(value, dict):
            lines.append(f"{key}:")
            lines += [f"  {json.dumps(k)}: {json.dumps(v)}" for k, v in value.items()]
        elif value and isinstance(value, list) and isinstance(value[0], list):
            lines += [f"{key}:", *(f"  - {json.dumps(row)}" for row in value)]
        else:
            lines.append(f"{key}: {json.dumps(value)}")
    return "\n".join(lines) + "\n"


#: Responses that can be asked for: to a force, and to a motion of the base.
KINDS = (*RESPONSES, "transmissibility")

_COUNT, _MOST = 400, 1_000_000


@dataclass(frozen=True)
class ResponseRequest:
    """The options about the response, checked."""

    response: str | None
    kind: str
    point: list[float] | None
    direction: list[float] | None
    damping: list[float] | None
    rayleigh: list[float] | None
    csv: Path | None = None
    plot: Path | None = None
    lobes: bool = False

    def __post_init__(self) -> None:
        if self.response is None:
            for name in ("point", "direction", "damping", "rayleigh", "csv", "plot"):
                if getattr(self, name) is not None and not (
                    self.lobes and name in ("damping", "rayleigh")
                ):
                    raise InputError("is for --response", where=f"--{name}")
            if self.kind != KINDS[0]:
                raise InputError("is for --response", where="--kind")
            return
        self._range()
        if self.direction is not None and not any(self.direction):
            raise InputError("must not be zero", where="--direction", got=self.direction)

    @property
    def damped(self) -> Damping:
        """What damps."""
        return damping_of(self.damping, self.rayleigh)

    def _range(self) -> tuple[float, float, int]:
        parts = (self.response or "").split(":")
        if len(parts) not in (2, 3):
            raise InputError(
                "cannot be used", where="--response", expected="LOW:HIGH[:COUNT]", got=self.response
            )
        numbers = [parse_numbers(part, "--response", 1)[0] for part in parts]
        low, high = numbers[:2]
        count = numbers[2] if len(numbers) == 3 else _COUNT
        if not 0.0 <= low < high:
            raise InputError(
                "frequencies cannot be used",
                where="--response",
                expected="0 <= LOW < HIGH, in Hz",
                got=self.response,
            )
        if not (count == int(count) and 2 <= count <= _MOST):
            raise InputError(
                "count cannot be used",
                where="--response",
                expected=f"a whole number from 2 to {_MOST}",
                got=count,
            )
        return low, high, int(count)

    def run(self, modes: Modes, data: dict[str, Any]) -> list[str]:
        """Computes, adds to the JSON object, writes the files; lines for people."""
        if self.response is None:
            return []
        import numpy as np

        from cartstiff.report.modes import describe_response
        from cartstiff.vibration.response import frequency_response, transmissibility

        low, high, count = self._range()
        hertz = np.geomspace(low, high, count) if low > 0.0 else np.linspace(low, high, count)
        damping = self.damped
        at = self.point or (0.0, 0.0, 0.0)
        answer: Any = (
            transmissibility(modes, hertz, damping, at=at)
            if self.kind == "transmissibility"
            else frequency_response(modes, hertz, damping, kind=self.kind, at=at)  # type: ignore[arg-type]
        )
        data["response"] = answer.as_dict(self.direction)
        from cartstiff.report.modes import draw_response
        from cartstiff.report.output import write_files

        write_files(
            (self.csv, lambda: answer.as_csv(self.direction)),
            (self.plot, lambda: draw_response(answer, self.direction, modes)),
        )
        return describe_response(answer, self.direction)


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
        None,
        "Also print the frequencies computed from a 6x6 stiffness and a mass at the tip: "
        "some of A,B,K,F,load,energy.",
        metavar="NAMES",
    ),
    sensitivities_option,
    tolerance_option(
        "an interval for each frequency (measured springs have one without this "
        "option) and what contributes most to it"
    ),
    option(
        "--response",
        None,
        "Response of the body to a force on it at COUNT frequencies [Hz], 400 by default: in "
        "equal ratios, or in equal steps if LOW is 0.",
        metavar="LOW:HIGH[:COUNT]",
    ),
    choice(
        "--kind",
        KINDS,
        "Displacement, velocity or acceleration per force; or motion of the body per motion "
        "of the ground.",
        default="receptance",
    ),
    option("--point", POINT, "Point of the body, in its frame, for --response."),
    option(
        "--direction",
        DIRECTION,
        "Direction for --response, along the body's axes (the room's for a "
        "transmissibility); default x, y and z.",
    ),
    option(
        "--damping",
        Numbers("RATIO[,RATIO...]"),
        "Damping ratio of every mode, or one for each, for --response and --lobes.",
    ),
    option(
        "--rayleigh",
        Numbers("ALPHA,BETA", 2),
        "Damping alpha M + beta K [1/s, s], for --response and --lobes. Dampers of the "
        "mechanism's file always act.",
    ),
    option(
        "--lobes",
        None,
        "Stability lobes of --milling between two spindle speeds [rev/min]: limiting depth by "
        "the zeroth-order theory.",
        metavar="LOW:HIGH[:COUNT]",
    ),
    cutting_options,
    option("--csv", OutputFile("FILE.csv", ".csv"), "Write the response, or the lobes."),
    option("--plot", PICTURE, "Draw the response as a Bode diagram, or the lobes."),
    option(
        "--impedance",
        FILE,
        "Stiffness that a controller shall produce at the body frame (6x6; .json, .csv or "
        ".npy). The answer holds the damping by double diagonalisation with the masses at the "
        "posture, in the order and along the axes of the file, and joint-space gains.",
        metavar="FILE",
    ),
    choice(
        "--order",
        ORDERS,
        f"Order of the rows of --impedance; default what its file says, else {ORDERS[0]}.",
    ),
    choice(
        "--axes",
        AXES,
        "Axes of --impedance, about the body frame's origin: of the robot's own base, of the "
        "body frame, or of the room (world).",
        default="body",
    ),
    option(
        "--ratio",
        Numbers("RATIO[,RATIO...]", 1, 6),
        "Damping ratios of the six oscillators of --impedance, softest first; default 0.7.",
    ),
    option(
        "-o --output", OutputFile("FILE", ".json", ".yaml"), "Write the controller of --impedance."
    ),
    json_option,
    flag("--strict", "Exit with code 3 where there are no modes."),
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

    from cartstiff.vibration.modes import MODES_SCHEMA, modes

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
        tell(data, request.mechanism, lambda: words)
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
    tell(data, request.mechanism, lambda: describe_modes(swinging, bare, extra))


def _more(
    modes: Modes,
    request: MechanismRequest,
    data: dict[str, Any],
    compare: str | None,
    wanted: bool,
    tolerance: list[float] | None,
) -> list[str]:
    """Adds the requested parts to the JSON object, and returns them as lines."""
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
