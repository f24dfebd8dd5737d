"""Options of ``cartstiff analyse`` that say what is read from the stiffness matrix."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from cartstiff.cli.options import once
from cartstiff.cli.target_file import ORDERS, Target, read_target
from cartstiff.errors import InputError
from cartstiff.parsing import parse_numbers

if TYPE_CHECKING:
    from cartstiff.stiffness.compute import PostureStiffness

__all__ = ["AnalysisRequest", "analysis_options"]

LEVELS = ("full", "short", "none")
CONNECTIONS = ("A", "B", "K", "F", "+", "load")
_Command = TypeVar("_Command", bound=Callable[..., Any])


def analysis_options(command: _Command) -> _Command:
    """Add the options; the command takes them as keywords for `AnalysisRequest.parse`."""
    options = [
        click.option(
            "--analysis", type=click.Choice(LEVELS), default="short", show_default=True,
            help="How much of the analysis to print; with --json: none leaves it out.",
        ),
        click.option(
            "--connection", type=click.Choice(CONNECTIONS),
            help="The matrix that is analysed; default under a load: load, the tangent stiffness "
            "under it (see --load-kind, --load-at). Without a load all are the same.",
        ),
        click.option(
            "--at", metavar="X,Y,Z", multiple=True, callback=once,
            help="Point of the body, in its frame, for which the analysis is given.",
        ),
        click.option(
            "--direction", metavar="X,Y,Z", multiple=True, callback=once,
            help="Also the stiffness along and about this direction of the body frame.",
        ),
        click.option(
            "--deflect", metavar="MX,MY,MZ,FX,FY,FZ", multiple=True, callback=once,
            help="Linear deflection under this wrench, along the body's axes, added to the load; "
            "default the load itself.",
        ),
        click.option(
            "--deflect-at", metavar="X,Y,Z", multiple=True, callback=once,
            help="Point of the body, in its frame, at which the wrench of --deflect acts; default "
            "the point of --at.",
        ),
        click.option(
            "--length", metavar="L", multiple=True, callback=once,
            help="Characteristic length that makes angles comparable with lengths.",
        ),
        click.option(
            "--inertia", metavar="MASS,IXX,IYY,IZZ", multiple=True, callback=once,
            help="Rigid body with its mass centre at the point, in kg and kg m^2: natural "
            "frequencies, and its radius of gyration as the length.",
        ),
        click.option(
            "--tolerance", metavar="REL[,LENGTH[,ANGLE]]", multiple=True, callback=once,
            help="Standard deviations: relative of every spring stiffness, absolute of every "
            "length (and rotation, rad) of the geometry.",
        ),
        click.option(
            "--samples", type=click.IntRange(min=0), metavar="N",
            help="Propagate the tolerances by N random draws; 0, the default: to first order.",
        ),
        click.option(
            "--target", type=click.Path(path_type=Path), metavar="FILE",
            help="Desired stiffness (6x6, symmetric, body frame; .json, .csv or .npy): the joint "
            "stiffness that gives it under the load. A .json may name its order, units and frame.",
        ),
        click.option(
            "--target-order", type=click.Choice(ORDERS),
            help="Order of the target's rows and columns; default what its file says, else "
            f"{ORDERS[0]} (rotation before translation).",
        ),
    ]  # fmt: skip
    for option in reversed(options):
        command = option(command)
    return command


@dataclass(frozen=True)
class AnalysisRequest:
    """What the options asked for, checked."""

    level: str
    keywords: dict[str, Any]
    inertia: list[float] | None
    target: Target | None = None

    @classmethod
    def parse(
        cls,
        analysis: str,
        connection: str | None,
        at: str | None,
        direction: str | None,
        deflect: str | None,
        deflect_at: str | None,
        length: str | None,
        inertia: str | None,
        tolerance: str | None,
        samples: int | None,
        target: Path | None,
        target_order: str | None,
    ) -> AnalysisRequest:
        """Numbers from the options' text; InputError naming the option."""
        keywords: dict[str, Any] = {"connection": connection, "samples": samples or 0}
        if at is not None:
            keywords["at"] = parse_numbers(at, "--at", 3)
        if direction is not None:
            keywords["direction"] = parse_numbers(direction, "--direction", 3)
            if not any(keywords["direction"]):
                raise InputError("must not be zero", where="--direction", got=direction)
        if deflect is not None:
            keywords["wrench"] = parse_numbers(deflect, "--deflect", 6)
        if deflect_at is not None:
            if deflect is None:
                raise InputError("is for --deflect", where="--deflect-at")
            keywords["wrench_at"] = parse_numbers(deflect_at, "--deflect-at", 3)
        if length is not None:
            keywords["length"] = parse_numbers(length, "--length", 1)[0]
            _positive([keywords["length"]], "--length")
        body = None
        if inertia is not None:
            body = parse_numbers(inertia, "--inertia", 4)
            _positive(body, "--inertia")
        if tolerance is not None:
            numbers = parse_numbers(tolerance, "--tolerance")
            if len(numbers) > 3:
                raise InputError(
                    "wrong count", where="--tolerance", expected="one to three numbers",
                    got=str(len(numbers)),
                )  # fmt: skip
            if min(numbers) < 0 or not any(numbers):
                raise InputError("cannot be used", where="--tolerance",
                                 expected="zero or more, not all zero", got=tolerance)  # fmt: skip
            keywords["tolerances"] = numbers
        elif samples is not None:
            raise InputError("is for --tolerance", where="--samples")
        if samples == 1:
            raise InputError("cannot be used", where="--samples", expected="0, or 2 and more",
                             got="1")  # fmt: skip
        if target is None and target_order is not None:
            raise InputError("is for --target", where="--target-order")
        wanted = None if target is None else read_target(target, target_order)
        return cls(analysis, keywords, body, wanted)

    def run(self, result: PostureStiffness) -> dict[str, Any]:
        """The analysis; with a progress bar on a terminal while tolerances are propagated."""
        import numpy as np

        from cartstiff.analysis.posture import analyse_posture
        from cartstiff.analysis.tolerances import Tolerances
        from cartstiff.geometry.se3 import pose
        from cartstiff.mechanisms.contract import SI, convert_length

        keywords = dict(self.keywords)
        if self.target is not None:
            keywords["target"] = self.target.in_body_frame(result)
        if "at" in keywords:
            keywords["at"] = pose(translation=keywords["at"])
        if "tolerances" in keywords:
            keywords["tolerances"] = Tolerances(*keywords["tolerances"])
        if self.inertia is not None:
            a, f = convert_length(SI, result.elastic.units)
            keywords["mass"] = self.inertia[0] * f / a
            keywords["inertia"] = np.diag(self.inertia[1:]) * f * a
        with np.errstate(all="ignore"), _Progress() as progress:
            try:
                answer = analyse_posture(result, **keywords, progress=progress)
                json.dumps(answer, allow_nan=False)
            except (np.linalg.LinAlgError, FloatingPointError, ValueError) as error:
                if isinstance(error, InputError):
                    raise
                raise InputError(
                    "the analysis leaves the range of double precision",
                    expected="numbers of moderate size, or --analysis none",
                ) from None
        if self.target is not None and (found := answer["synthesis"]["target"]) is not None:
            found |= {"order": self.target.order, "order_from": self.target.order_from}
        return answer


class _Progress:
    """A progress bar on standard error, if that is a terminal."""

    def __init__(self) -> None:
        self._bar: Any = None

    def __enter__(self) -> _Progress:
        return self

    def __exit__(self, *_: object) -> None:
        if self._bar is not None:
            self._bar.render_finish()

    def __call__(self, done: int, total: int) -> None:  # noqa: ARG002
        if not sys.stderr.isatty():
            return
        if self._bar is None:
            self._bar = click.progressbar(length=total, label="tolerances", file=sys.stderr)
        self._bar.update(1)


def _positive(numbers: list[float], option: str) -> None:
    if min(numbers) <= 0:
        raise InputError("cannot be used", where=option, expected="above zero", got=min(numbers))
