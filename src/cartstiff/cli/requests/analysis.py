"""Options of ``cartstiff analyse`` that say what is read from the stiffness matrix."""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from cartstiff.choices import LEVELS, ORDERS
from cartstiff.cli.output import Progress
from cartstiff.cli.types import (
    DIRECTION,
    POINT,
    TOLERANCE,
    WRENCH,
    Number,
    Numbers,
    gathered,
    only_with,
    option,
    option_group,
)
from cartstiff.errors import InputError
from cartstiff.matrix_names import LETTERS

if TYPE_CHECKING:
    from cartstiff.cli.requests.target_file import Target
    from cartstiff.stiffness.compute import PostureStiffness


_options = option_group(
    click.option(
        "--analysis",
        "level",
        type=click.Choice(LEVELS),
        default="short",
        show_default=True,
        help="How much of the analysis to print; with --json: none leaves it out.",
    ),
    click.option(
        "--connection",
        type=click.Choice(LETTERS),
        help="The matrix that is analysed; default under a load: load, the tangent stiffness under "
        "it (see --load-kind, --load-at). Without a load all are the same.",
    ),
    option(
        "--report-at",
        type=POINT,
        help="Point of the body, in its frame, for which the analysis is given.",
    ),
    option(
        "--direction",
        type=DIRECTION,
        help="Also print the stiffness along and about this direction, in the body's axes.",
    ),
    option(
        "--added-load",
        type=WRENCH,
        help="Linear deflection under this wrench, in the body's axes, added to the load; "
        "default the load itself.",
    ),
    option(
        "--added-load-at",
        type=POINT,
        help="Point of the body, in its frame, at which the wrench of --added-load acts; "
        "default the point of --report-at.",
    ),
    option(
        "--length",
        type=Number("L", power=1, above_zero=True),
        help="Characteristic length that makes angles comparable with lengths.",
    ),
    option(
        "--inertia",
        type=Numbers("MASS,IXX,IYY,IZZ", 4, above_zero=True),
        help="Rigid body with its mass centre at the point, in kg and kg m^2: gives natural "
        "frequencies, and its radius of gyration as the characteristic length.",
    ),
    option(
        "--tolerance",
        type=TOLERANCE,
        help="Standard deviations: relative of every spring stiffness, absolute of every length "
        "(and rotation, rad) of the geometry.",
    ),
    click.option(
        "--samples",
        type=click.IntRange(min=0),
        metavar="N",
        help="Propagate the tolerances by N random draws; 0, the default: to first order.",
    ),
    click.option(
        "--target",
        type=click.Path(path_type=Path),
        metavar="FILE",
        help="Desired stiffness (6x6, symmetric, body frame; .json, .csv or .npy): the joint "
        "stiffness that gives it under the load. A .json may name its order, units and frame.",
    ),
    click.option(
        "--target-order",
        type=click.Choice(ORDERS),
        help="Order of the target's rows and columns; default what its file says, else "
        f"{ORDERS[0]} (rotation before translation).",
    ),
)


@dataclass(frozen=True)
class AnalysisRequest:
    """What `analysis_options` say, checked."""

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
        if self.tolerance is not None and not (min(self.tolerance) >= 0 and any(self.tolerance)):
            raise InputError(
                "cannot be used",
                where="--tolerance",
                got=self.tolerance,
                expected="zero or more, not all zero",
            )
        if self.samples == 1:
            raise InputError(
                "cannot be used", where="--samples", expected="0, or 2 and more", got="1"
            )

    @cached_property
    def wanted(self) -> Target | None:
        """The desired stiffness as its file has it."""
        if self.target is None:
            return None
        from cartstiff.cli.requests.target_file import read_target

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
analysis_options = gathered(_options, "analysis", AnalysisRequest)
