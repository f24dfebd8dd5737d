"""``cartstiff analyse``."""

from __future__ import annotations

import json
import sys
import time
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from cartstiff.choices import AXES, AXES_WORDS, LEVELS, ORDERS
from cartstiff.cli.options import (
    DIRECTION,
    POINT,
    TOLERANCE,
    WRENCH,
    LoadRequest,
    MechanismRequest,
    Number,
    Numbers,
    OutputFile,
    UnitsCommand,
    Values,
    add_sensitivities,
    checked_tolerance,
    choice,
    command_option,
    count,
    explain_option,
    file_option,
    flag,
    gathered,
    json_option,
    load_options,
    mechanism_options,
    only_with,
    option,
    option_group,
    sensitivities_option,
)
from cartstiff.cli.output import Progress, json_text, say, wants_json
from cartstiff.errors import InputError
from cartstiff.matrix_names import LETTERS

if TYPE_CHECKING:
    from cartstiff.cli.tables import Target
    from cartstiff.stiffness.compute import PostureStiffness


_reading_options = option_group(
    choice(
        "--analysis level",
        LEVELS,
        "How much of the analysis to print; with --json: none leaves it out.",
        default="short",
    ),
    choice(
        "--connection",
        LETTERS,
        "The matrix that is analysed; default under a load: load, the tangent stiffness under "
        "it (see --load-kind, --load-at). Without a load all are the same.",
    ),
    option(
        "--report-at", POINT, "Point of the body, in its frame, for which the analysis is given."
    ),
    option(
        "--direction",
        DIRECTION,
        "Also print the stiffness along and about this direction, in the body's axes.",
    ),
    option(
        "--added-load",
        WRENCH,
        "Linear deflection under this wrench, in the body's axes, added to the load; "
        "default the load itself.",
    ),
    option(
        "--added-load-at",
        POINT,
        "Point of the body, in its frame, at which the wrench of --added-load acts; "
        "default the point of --report-at.",
    ),
    option(
        "--length",
        Number("L", power=1, above_zero=True),
        "Characteristic length that makes angles comparable with lengths.",
    ),
    option(
        "--inertia",
        Numbers("MASS,IXX,IYY,IZZ", 4, above_zero=True),
        "Rigid body with its mass centre at the point, in kg and kg m^2; adds natural "
        "frequencies and takes its radius of gyration as the characteristic length.",
    ),
    option(
        "--tolerance",
        TOLERANCE,
        "Standard deviations: relative of every spring stiffness, absolute of every length "
        "(and rotation, rad) of the geometry.",
    ),
    count(
        "--samples",
        "Propagate the tolerances by N random draws; 0, the default: to first order.",
        0,
        metavar="N",
    ),
    file_option(
        "--target",
        "Desired stiffness (6x6, symmetric, body frame; .json, .csv or .npy): the "
        "joint stiffness that produces it under the load. A .json may name its order, units and "
        "frame.",
        metavar="FILE",
    ),
    choice(
        "--target-order",
        ORDERS,
        "Order of the target's rows and columns; default what its file says, else "
        f"{ORDERS[0]} (rotation before translation).",
    ),
)


@dataclass(frozen=True)
class AnalysisRequest:
    """Values of `analysis_options`, checked."""

    level: str
    connection: str | None
    report_at: list[float] | None
    direction: list[float] | None
    added_load: list[float] | None
    added_load_at: list[float] | None
    length: float | None
    inertia: list[float] | None
    tolerance: list[float] | None
    samples: int | None
    target: Path | None
    target_order: str | None
    world: bool = False

    def __post_init__(self) -> None:
        """Refuse what does not go together, and zeros."""
        if self.added_load is None:
            only_with("added-load", added_load_at=self.added_load_at)
        if self.tolerance is None:
            only_with("tolerance", samples=self.samples)
        if self.target is None:
            only_with("target", target_order=self.target_order)
        if self.direction is not None and not any(self.direction):
            raise InputError("must not be zero", where="--direction", got=self.direction)
        checked_tolerance(self.tolerance)
        if self.samples == 1:
            raise InputError(
                "cannot be used", where="--samples", expected="0, or 2 and more", got="1"
            )

    @cached_property
    def wanted(self) -> Target | None:
        """The desired stiffness as its file has it."""
        if self.target is None:
            return None
        from cartstiff.cli.tables import read_target

        return read_target(self.target, self.target_order)

    def _in_body(self, components: list[float] | None, result: PostureStiffness) -> Any:
        """Three components, or twice three, in the body's axes."""
        if components is None or not self.world:
            return components
        import numpy as np

        return (np.reshape(components, (-1, 3)) @ result.pose[:3, :3]).ravel()

    def run(self, result: PostureStiffness, springs: bool) -> dict[str, Any]:
        """The analysis; `springs` that give the matrix are looked for where they are shown.

        A terminal shows a progress bar while tolerances are propagated.
        """
        import numpy as np

        from cartstiff.analysis.posture import analyse_posture
        from cartstiff.geometry.se3 import pose
        from cartstiff.mechanisms.contract import SI, convert_length

        mass = inertia = tolerances = None
        if self.tolerance is not None:
            from cartstiff.analysis.tolerances import Tolerances

            tolerances = Tolerances(*self.tolerance)
        if self.inertia is not None:
            a, f = convert_length(SI, result.elastic.units)
            mass, inertia = self.inertia[0] * f / a, np.diag(self.inertia[1:]) * f * a
        with np.errstate(all="ignore"), Progress("tolerances") as progress:
            try:
                answer = analyse_posture(
                    result,
                    connection=self.connection,
                    length=self.length,
                    mass=mass,
                    inertia=inertia,
                    at=None if self.report_at is None else pose(translation=self.report_at),
                    direction=self._in_body(self.direction, result),
                    wrench=self._in_body(self.added_load, result),
                    wrench_at=self.added_load_at,
                    target=None if self.wanted is None else self.wanted.in_body_frame(result),
                    tolerances=tolerances,
                    samples=self.samples or 0,
                    springs=springs,
                    progress=progress,
                )
                json.dumps(answer, allow_nan=False)
            except (np.linalg.LinAlgError, FloatingPointError, ValueError) as error:
                if isinstance(error, InputError):
                    raise
                raise InputError(
                    "the analysis leaves the range of double precision",
                    expected="numbers of moderate size, or --analysis none",
                ) from None
        if self.wanted is not None and (joints := answer["synthesis"]["target"]) is not None:
            joints |= {"order": self.wanted.order, "order_from": self.wanted.order_from}
        return answer


#: What is read from the matrix: an `AnalysisRequest`, the command's keyword ``analysis``.
analysis_options = gathered(_reading_options, "analysis", AnalysisRequest)


#: One posture by itself: machine code serves those who ask again and again.
ENGINE = "engine, one posture (with its first use)"
_EPILOG = """\b
Examples:
  cartstiff analyse stewart-gough --json
  cartstiff analyse ur5 --load 0,0,0,0,0,-100
  cartstiff analyse panda --q 0,-0.8,0,-2.4,0,1.6,0.8 --frame panda_hand
  cartstiff analyse my_arm.urdf --stiffness 20000 --frame tool
  cartstiff analyse panda --rest 0,-0.8,0.1,-2.3,0,1.6,0.8 --relax
  cartstiff analyse 6-pus --load 0,0,0,0,0,-500 --actuate leg1/slide=0.001
  cartstiff analyse ur5 --analysis full --report-at 0,0,0.1 --length 0.2
  cartstiff analyse ur5 --load 0,0,0,0,0,-100 --world --load-at 0,0,0.1 --added-load 0,0,0,10,0,0
  cartstiff analyse flexure-hexapod -o stiffness.nas
  cartstiff analyse cubic --tolerance 0.05,0.0001 --samples 500
  cartstiff analyse cubic --sensitivities --json
  cartstiff analyse ur5 --target wanted.csv --inertia 2,0.01,0.01,0.005
"""


_options = option_group(
    json_option,
    option(
        "-o --output",
        OutputFile(
            "FILE",
            ".json",
            ".npz",
            ".nas",
            ".bdf",
            ".xml",
            ".dat",
            ".csv",
            ".urdf",
        ),
        "Also write the result: .json, .npz; its stiffness, and a platform's mass, for "
        "Nastran (.nas, .bdf); the machine for MuJoCo (.xml), a platform on lines as springs of "
        "Nastran (.dat); the geometry as a table (.csv), or as a tree (.urdf) with a mechanism "
        "file beside it that closes its loops.",
    ),
    flag(
        "--relax",
        "If no wrench can balance the posture, move the joints until one can; the body stays.",
    ),
    choice(
        "--order",
        ORDERS,
        "Also print the matrices as a controller has them: linear-angular is translation first.",
    ),
    choice(
        "--axes",
        AXES,
        "Also print the matrices along these axes, about the body frame's origin: of the "
        "robot's own base, of the body frame, or of the room (world).",
    ),
    sensitivities_option,
    explain_option,
    flag("--strict", "Exit with code 3 if a quantity does not exist."),
)


@click.command(name="analyse", cls=UnitsCommand, epilog=_EPILOG)
@mechanism_options(
    load_help="Wrench on the body: moment about and force at the point --load-at, in the body's "
    "axes; rest positions are chosen so that the springs balance it."
)
@load_options("--load, --added-load and --direction")
@command_option
@analysis_options
@_options
def command(
    request: MechanismRequest,
    applied: LoadRequest,
    told: Values | None,
    output: Path | None,
    relax: bool,
    order: str | None,
    axes: str | None,
    sensitivities: bool,
    profile: bool,
    strict: bool,
    analysis: AnalysisRequest,
) -> None:
    """Stiffness matrices of MECHANISM at a posture, under every connection.

    MECHANISM is a bundled name (see `cartstiff models`), a mechanism file (.yaml), a URDF, xacro
    or MJCF file, or an example robot's name.
    """
    wrench = request.balanced_wrench
    analysis = replace(analysis, world=applied.world)
    applied.check_world(load=wrench, added_load=analysis.added_load, direction=analysis.direction)
    steps = StepTimes()
    elastic, q = request.load()
    steps.end("reading the mechanism")

    import numpy as np

    from cartstiff.stiffness.compute import analyse

    with np.errstate(all="ignore"):  # what is not finite is refused as a whole
        load = {"wrench": wrench, **applied.keywords(wrench)}
        if told is None:
            result = analyse(elastic, q, **load)
        else:
            from cartstiff.statics.command import analyse_commanded

            result = analyse_commanded(elastic, request.command(told, elastic), q, **load)
            elastic = result.elastic
            load = {key: load[key] for key in ("load_kind", "load_at") if key in load}
        if relax and any(note.code == "unbalanced" for note in result.notes):
            from cartstiff.statics.equilibrium import relaxed

            result = analyse(elastic, relaxed(elastic, result.q), **load)
        data = result.as_dict()
        steps.end(ENGINE, 1)
        if order is not None or axes is not None:
            data["as_controller"] = _as_controller(result, order or ORDERS[0], axes or "body")
        by_parameters = add_sensitivities(result, request, data)[0] if sensitivities else []
    json_text(data, request.mechanism)  # or a refusal, before anything is written
    if analysis.level != "none":
        shows_springs = wants_json() or output is not None or analysis.level == "full"
        data["analysis"] = analysis.run(result, shows_springs)
        steps.end("analysis of the matrix")
    how = steps.explain(data) if profile else []
    if output is not None:
        from cartstiff.report.output import write_result

        write_result(result, output, data)
    if wants_json():
        say(json_text(data, request.mechanism))
    else:
        from cartstiff.report.analysis import BALANCING, describe

        shown = ""
        if analysis.level != "none":
            from cartstiff.report.analysis import summary_text

            shown = summary_text(data["analysis"], elastic.units, analysis.level)
        if "as_controller" in data:
            shown = "\n".join([*_matrices_text(data["as_controller"]), shown])
        say("\n".join([describe(result, shown), *by_parameters, *how]))
        if not relax and any(note.code == "unbalanced" for note in result.notes):
            say("  --relax lets the self-motion settle, with the body held where it is")
            if wrench is None:
                say(f"  {BALANCING}")
    missing = [name for name, K in data["stiffness"].items() if K is None]
    if strict and missing:
        reasons = ", ".join(note.code for note in result.notes) or "undefined"
        names = ", ".join(f"K^{name}" for name in missing)
        say(f"cartstiff: {names} does not exist here ({reasons})", error=True)
        sys.stdout.flush()
        raise click.exceptions.Exit(3)


class StepTimes:
    """Processor time of what follows each other, for --profile."""

    def __init__(self) -> None:
        self._wall, self._begun = time.perf_counter(), time.process_time()
        self._last, self._done = self._begun, list[tuple[str, int, float]]()

    def end(self, what: str, postures: int = 0) -> None:
        """Something has been done."""
        now = time.process_time()
        self._done.append((what, postures, now - self._last))
        self._last = now

    def explain(self, data: dict[str, Any]) -> list[str]:
        """Adds them to the JSON object, and gives them as lines."""
        from cartstiff.many.work import Share, Work, describe, explained

        work = Work({what: Share(postures, spent) for what, postures, spent in self._done})
        wall = time.perf_counter() - self._wall
        data["explained"] = explained(work, wall, self._last - self._begun)
        return describe(data["explained"])


def _as_controller(result: PostureStiffness, order: Any, axes: Any) -> dict[str, Any]:
    """The matrices in another order or along other axes, about M's origin."""
    matrices = {
        name: None if K is None else result.tensor(name).as_controller(order=order, axes=axes)
        for name, K in result.matrices.items()
    }
    return {
        "order": order,
        "axes": axes,
        "stiffness": {name: None if K is None else K.tolist() for name, K in matrices.items()},
    }


def _matrices_text(shown: dict[str, Any]) -> list[str]:
    """The same as text."""
    import numpy as np

    from cartstiff.stiffness.tensor import format_matrix

    axes = AXES_WORDS[shown["axes"]]
    lines = [f"As a controller has them: order {shown['order']}, {axes}, about M's origin", ""]
    for name, K in shown["stiffness"].items():
        if K is not None:
            lines += [*format_matrix(np.array(K), [""] * 6, f"K^{name}").split("\n"), ""]
    return lines
