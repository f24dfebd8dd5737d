"""``cartstiff analyse``."""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import click

from cartstiff.core.choices import AXES_WORDS, ORDERS, Axes, Level, Order
from cartstiff.core.errors import InputError
from cartstiff.shown.cli.declare import Overrides
from cartstiff.shown.cli.options import (
    BalancedSetup,
    Metres,
    Number,
    OutputFile,
    Parameters,
    Point,
    Printed,
    Reading,
    Tolerance,
    declared,
)
from cartstiff.shown.cli.output import Progress, json_text, say

if TYPE_CHECKING:
    from cartstiff.answer.data import Answer
    from cartstiff.core.arrays import Array
    from cartstiff.core.matrix_names import Letter
    from cartstiff.core.stiffness.compute import PostureStiffness
    from cartstiff.shown.cli.tables import Target


@dataclass(frozen=True)
class Analysis(Reading):
    """Reading.

    Parameters
    ----------
    level
        How much of the analysis is printed. With --json: none leaves it out.
    report_at
        Point of the body that is analysed. In its frame; default its origin.
    allowed_displacement
        Allowed displacement of the body frame, which limits the load that is held.
    target : FILE
        Desired stiffness (6x6, symmetric, body frame; .json, .csv or .npy): the joint
        stiffness that produces it under the load, as the matrix of --connection. A .json
        may name its order, units and frame; else it is angular-linear (rotation before
        translation).
    """

    API: ClassVar = ("recorded/gradients/spread.py analyse_posture tolerance=tolerances",)
    RARE: ClassVar = "tolerance target"

    level: Annotated[Level, "--analysis"] = "short"
    report_at: Point = None
    allowed_displacement: Annotated[
        float | None, Number("D", above_zero=True, kind="length")
    ] = None
    tolerance: Tolerance = None
    target: Path | None = None

    @cached_property
    def wanted(self) -> Target | None:
        """The desired stiffness as its file has it."""
        if self.target is None:
            return None
        from cartstiff.shown.cli.tables import read_target

        return read_target(self.target)

    @property
    def matrix(self) -> Letter | None:
        """The matrix that is analysed; None for the tangent under the load."""
        own: Any = None if self.wanted is None else self.wanted.connection
        if own and self.connection not in (None, own):
            raise InputError(
                "the target's file names another matrix",
                where="--connection",
                expected=own,
                got=self.connection,
            )
        return self.connection or own

    @property
    def frame(self) -> Array | None:
        """Pose in M of the frame of the analysis."""
        if self.report_at is None:
            return None
        from cartstiff.core.geometry.se3 import pose

        return pose(translation=self.report_at)

    def _in_body(
        self, components: list[float] | None, result: PostureStiffness, world: bool
    ) -> Any:
        """Three components, or twice three, in the body's axes."""
        if components is None or not world:
            return components
        import numpy as np

        return (np.reshape(components, (-1, 3)) @ result.pose[:3, :3]).ravel()

    def answer(self, result: PostureStiffness, world: bool) -> Answer:
        """The answer at a posture; without an analysis only what costs nothing."""
        import numpy as np

        from cartstiff.answer.posture import answer_at

        with np.errstate(all="ignore"):
            return answer_at(
                result,
                connection=self.matrix,
                at=self.frame,
                wrench=self._in_body(self.added_load, result, world),
                allowed=Metres.in_units(self.allowed_displacement, result.units),
            )

    def run(self, result: PostureStiffness, world: bool) -> dict[str, Any]:
        """Analyse a result; a terminal shows a progress bar while tolerances
        are propagated.
        """
        import numpy as np

        from cartstiff.recorded.gradients.spread import analyse_posture

        tolerances = None
        if self.tolerance is not None:
            from cartstiff.answer.analysis.tolerances import Tolerances

            tolerances = Tolerances(*self.tolerance)
            if tolerances.stiffness >= 1.0:
                raise InputError(
                    "tolerance of the stiffness cannot be used",
                    where="--tolerance",
                    expected="a share below 1, such as 0.05 for 5 per cent",
                    got=tolerances.stiffness,
                )
        with np.errstate(all="ignore"), Progress("tolerances") as progress:
            try:
                wanted = self.wanted
                target = None if wanted is None else wanted.in_body_frame(result)
                answer = analyse_posture(
                    result,
                    connection=self.matrix,
                    length=Metres.in_units(self.length, result.elastic.units),
                    at=self.frame,
                    direction=self._in_body(self.direction, result, world),
                    wrench=self._in_body(self.added_load, result, world),
                    target=target,
                    tolerances=tolerances,
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
        if (
            self.wanted is not None
            and (joints := answer["synthesis"]["target"]) is not None
        ):
            joints |= {"order": self.wanted.order, "order_from": self.wanted.order_from}
        return answer


@declared(
    "analyse",
    rare="lengths actuate sensitivities relax order axes strict",
)
def command(
    setup: BalancedSetup,
    reading: Analysis,
    parameters: Annotated[Parameters, Overrides("tolerance")],
    out: Printed,
    *,
    output: Annotated[Path | None, OutputFile("FILE.json", ".json")] = None,
    relax: bool = False,
    order: Order | None = None,
    axes: Axes | None = None,
    strict: bool = False,
) -> None:
    """Stiffness of MECHANISM at a posture: matrices under every connection,
    and what they say.

    With a load the answer begins with the deflection and the joint that contributes most.
    MECHANISM is a bundled name (see `cartstiff models`), a mechanism file (.yaml), a
    URDF, xacro or MJCF file, or an example robot's name.

    Parameters
    ----------
    setup
        The mechanism at its posture, with tool, weight and load.
    reading
        Reading of the matrix.
    parameters
        Derivatives by the parameters.
    out
        Output.
    output
        Also write the result to a file, as the JSON object.
    relax
        If no wrench can balance the posture, move the joints until one can; the body
        stays.
    order
        Also print the matrices in this order. linear-angular has translation first.
    axes
        Also print the matrices along these axes. They stay about the body frame's origin;
        base is the robot's own base, world the room.
    strict
        Exit with code 3 if a quantity does not exist.

    Examples
    --------
    cartstiff analyse stewart-gough --json
    cartstiff analyse ur5 --load 0,0,0,0,0,-100
    cartstiff analyse panda --q 0,-0.8,0,-2.4,0,1.6,0.8 --frame panda_hand
    cartstiff analyse my_arm.urdf --stiffness 20000 --frame tool
    cartstiff analyse panda --rest 0,-0.8,0.1,-2.3,0,1.6,0.8 --relax
    cartstiff analyse 6-pus --load 0,0,0,0,0,-500 --actuate leg1/slide=0.001
    cartstiff analyse ur5 --analysis full --report-at 0,0,0.1 --length 0.2
    cartstiff analyse ur5 --load 0,0,0,0,0,-100 --world --load-at 0,0,0.1 --added-load 0,0,0,10,0,0
    cartstiff analyse flexure-hexapod -o stiffness.json
    cartstiff analyse cubic --tolerance 0.05,0.0001
    cartstiff analyse cubic --sensitivities --json
    cartstiff analyse ur5 --target wanted.csv
    """  # noqa: E501
    import numpy as np

    with np.errstate(all="ignore"):  # what is not finite is refused as a whole
        result, is_unbalanced = _at_posture(setup, relax)
        data = result.to_dict()
        if order is not None or axes is not None:
            data["as_controller"] = _as_controller(
                result, order or ORDERS[0], axes or "body"
            )
        json_text(data, setup.mechanism)  # or a refusal, before anything is written
        by_parameters = parameters.add(result, setup, data)
    if reading.level != "none":
        data["analysis"] = reading.run(result, setup.world)
    answer = reading.answer(result, setup.world)
    data["answer"] = answer.to_dict()
    if output is not None:
        from cartstiff.shown.report.output import write_json

        write_json(data, output)

    def text() -> str:
        from cartstiff.shown.report.analysis import describe
        from cartstiff.shown.report.answer import tables_lines
        from cartstiff.shown.report.sentences import BALANCING

        whole = [*_matrices_text(data.get("as_controller")), *tables_lines(by_parameters)]
        if is_unbalanced and not relax:
            whole += [
                "",
                "  --relax lets the self-motion settle, with the body held where it is",
                *[f"  {BALANCING}"] * (setup.load is None),
            ]
        return describe(result, answer, data.get("analysis"), reading.level, whole=whole)

    out.show(data, setup.mechanism, text)
    if strict:
        _check_all_exist(result, data["stiffness"])


def _at_posture(setup: BalancedSetup, relax: bool) -> tuple[PostureStiffness, bool]:
    """The stiffness, and whether nothing balances the posture, from which joints then
    move with `relax`.
    """
    from cartstiff.core.stiffness.compute import analyse

    elastic, q = setup.read()
    manner = setup.keywords
    if setup.actuate is None:
        result = analyse(elastic, q, **manner)
    else:
        from cartstiff.answer.commanded import analyse_commanded

        result = analyse_commanded(elastic, setup.command(elastic), q, **manner)
        elastic, manner = result.elastic, setup.manner
    is_unbalanced = any(note.code == "unbalanced" for note in result.notes)
    if relax and is_unbalanced:
        from cartstiff.core.statics.equilibrium import relaxed

        result = analyse(elastic, relaxed(elastic, result.q), **manner)
    return result, is_unbalanced


def _check_all_exist(result: PostureStiffness, matrices: Mapping[str, Any]) -> None:
    """End with code 3 if one of the matrices does not exist."""
    missing = [f"K^{name}" for name, K in matrices.items() if K is None]
    if missing:
        reasons = ", ".join(note.code for note in result.notes) or "undefined"
        words = f"{', '.join(missing)} does not exist here ({reasons})"
        say(f"cartstiff: {words}", error=True)
        sys.stdout.flush()
        raise click.exceptions.Exit(3)


def _as_controller(result: PostureStiffness, order: Any, axes: Any) -> dict[str, Any]:
    """Return the matrices in another order or along other axes, about M's origin."""
    matrices = dict.fromkeys(result.matrices)
    for name in [name for name, K in result.matrices.items() if K is not None]:
        matrices[name] = result.tensor(name).as_controller(order=order, axes=axes)
    return {
        "order": order,
        "axes": axes,
        "stiffness": {
            name: None if K is None else K.tolist() for name, K in matrices.items()
        },
    }


def _matrices_text(shown: dict[str, Any] | None) -> list[str]:
    """Format the matrices of `_as_controller`, if they were asked for."""
    if shown is None:
        return []
    import numpy as np

    from cartstiff.core.stiffness.tensor import format_matrix

    axes = AXES_WORDS[shown["axes"]]
    lines = [
        "",
        f"As a controller has them: order {shown['order']}, {axes}, about M's origin",
    ]
    for name, K in shown["stiffness"].items():
        if K is not None:
            lines += ["", *format_matrix(np.array(K), [""] * 6, f"K^{name}").split("\n")]
    return lines
