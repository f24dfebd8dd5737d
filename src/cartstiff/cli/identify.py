"""``cartstiff identify``."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import click

from cartstiff.cli.identify_options import (
    deviations_of,
    reject_of,
    stiffnesses_of,
    ties_of,
    units_of,
)
from cartstiff.cli.options import once
from cartstiff.cli.output import output_file, print_json, say
from cartstiff.errors import one_line
from cartstiff.parsing import parse_numbers

__all__ = ["command"]

_EPILOG = """\b
Examples:
  cartstiff identify ur5 measured.csv
  cartstiff identify arm.yaml measured.csv --sd d=0.005mm -o known.yaml
  cartstiff identify arm.yaml measured.csv --units mm,deg --reject suspects --plot residuals.png
  cartstiff identify ur5 measured.csv --tie wrist_1_joint=wrist_2_joint --known wrist_3_joint=8000
"""
_Command = TypeVar("_Command", bound=Callable[..., Any])


def _single(*names: str, **settings: Any) -> Callable[[_Command], _Command]:
    """An option that must not be given twice."""
    return click.option(*names, multiple=True, callback=once, **settings)


@click.command(name="identify", epilog=_EPILOG)
@click.argument("mechanism")
@click.argument("table", metavar="DATA.csv")
@_single("--frame", metavar="NAME", help="Body frame M: a link or site.")
@_single(
    "--point",
    "point_text",
    metavar="X,Y,Z",
    help="Point of the body, in its frame, that was measured; default its origin.",
)
@_single(
    "--load-at",
    "load_at_text",
    metavar="X,Y,Z",
    help="Point of the body, in its frame, at which loads act; default the measured one.",
)
@click.option(
    "--axes",
    type=click.Choice(["base", "body", "world"]),
    default="base",
    show_default=True,
    help="Axes of the columns mx,my,mz,fx,fy,fz.",
)
@_single(
    "--gravity",
    "gravity_text",
    metavar="X,Y,Z",
    help="Acceleration in F, m/s^2, instead of the file's; the arm's own weight then acts.",
)
@_single(
    "--units",
    "units_text",
    metavar="UNITS",
    help="Units of columns without one in their head, such as mm,deg; SI otherwise.",
)
@click.option(
    "--sd",
    "sd_texts",
    metavar="COLUMN=VALUE[UNIT]",
    multiple=True,
    help="Standard deviation of a column, such as dx=0.02mm; else estimated.",
)
@click.option(
    "--unknown",
    "unknown_texts",
    metavar="NAME",
    multiple=True,
    help="What is to be found: a spring, leg or line by name; joints (the default), lines, links; "
    "a link that gives, LINK (its 6x6) or LINK:diagonal or LINK:rx,ry.",
)
@click.option("--tie", "tie_texts", metavar="A=B", multiple=True, help="Springs that are equal.")
@click.option(
    "--known", "known_texts", metavar="NAME=K", multiple=True, help="A stiffness that is held."
)
@click.option(
    "--prior",
    "prior_texts",
    metavar="NAME=K,SD",
    multiple=True,
    help="A stiffness that is known up to a standard deviation.",
)
@click.option(
    "--offsets",
    type=click.Choice(["rigid", "translation", "none"]),
    default="rigid",
    show_default=True,
    help="What is unknown of the measuring frame in each session.",
)
@click.option(
    "--loaded", is_flag=True, help="Fit the equilibrium under load, not displacements linear in it."
)
@click.option(
    "--fit",
    type=click.Choice(["plain", "robust"]),
    default="plain",
    show_default=True,
    help="Whose estimates are told first.",
)
@_single(
    "--reject",
    "reject_text",
    metavar="RULE",
    help="Leave rows out: suspects of the robust fit, or those beyond so many standard "
    "deviations from it.",
)
@click.option(
    "--level", type=float, default=0.95, show_default=True, help="Probability of the intervals."
)
@_single(
    "-o",
    "--output",
    "output_text",
    metavar="FILE.yaml",
    help="Write a mechanism file with the stiffnesses and their covariance.",
)
@_single(
    "--plot",
    "plot_text",
    metavar="FILE.png",
    help="Draw the residuals against load, posture and time.",
)
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object.")
def command(
    mechanism: str, table: str, frame: str | None, as_json: bool, output_text: str | None,
    plot_text: str | None, **texts: Any,
) -> None:  # fmt: skip
    """Joint stiffness of MECHANISM from the loads and deflections in DATA.csv.

    One row a measurement under a line of names: joints (rad, or "name [deg]"); the load fx,fy,fz,
    mx,my,mz, or mass; what was measured, any of dx,dy,dz, drx,dry,drz, d along nx,ny,nz, x,y,z,
    roll,pitch,yaw; standard deviations sd_NAME; session; time. The page "Which joint stiffness do
    I enter?" says how to measure.
    """
    out = None if output_text is None else output_file(output_text, (".yaml", ".yml"), "--output")
    plot = None if plot_text is None else output_file(plot_text, (".png", ".svg", ".pdf"), "--plot")
    elastic, settings, keywords = _settings(mechanism, frame, **texts)

    import numpy as np

    from cartstiff.identify.campaign import identify
    from cartstiff.identify.table import read_measurements

    measured = read_measurements(Path(table), elastic, **settings)
    with np.errstate(all="ignore"):
        result = identify(elastic, measured, **keywords, progress=_progress)
    files: list[tuple[Path, bytes]] = []
    if out is not None:
        from cartstiff.identify.writing import mechanism_file

        where = one_line(Path(table).name)
        files.append((out, mechanism_file(result, mechanism, frame, out, where)))
    if plot is not None:
        from cartstiff.report.figures_identification import draw_residuals
        from cartstiff.report.figures_statics import picture

        files.append((plot, picture(draw_residuals(result), plot.suffix)))
    from cartstiff.report.output import write_whole

    for path, data in files:
        write_whole(path, data)
    if as_json:
        print_json(result.as_dict(), mechanism)
    else:
        from cartstiff.report.identification import describe_identification

        say(describe_identification(result))


def _settings(
    mechanism: str, frame: str | None, *, point_text: str | None, load_at_text: str | None,
    axes: str, gravity_text: str | None, units_text: str | None, sd_texts: tuple[str, ...],
    unknown_texts: tuple[str, ...], tie_texts: tuple[str, ...], known_texts: tuple[str, ...],
    prior_texts: tuple[str, ...], offsets: str, loaded: bool, fit: str, reject_text: str | None,
    level: float,
) -> tuple[Any, dict[str, Any], dict[str, Any]]:  # fmt: skip
    """The mechanism, keywords for reading the table, and for the campaign."""
    units = units_of(units_text)
    settings: dict[str, Any] = {
        "axes": axes, "units": units, "deviations": deviations_of(sd_texts, units),
        "point": _point(point_text, "--point"),
        "load_at": None if load_at_text is None else _point(load_at_text, "--load-at"),
    }  # fmt: skip
    keywords: dict[str, Any] = {
        "sought": [part for text in unknown_texts for part in _words(text)],
        "ties": ties_of(tie_texts),
        "known": {n: v[0] for n, v in stiffnesses_of(known_texts, "--known", 1).items()},
        "priors": {n: (v[0], v[1]) for n, v in stiffnesses_of(prior_texts, "--prior", 2).items()},
        "offsets": offsets, "loaded": loaded, "fit": fit, "reject": reject_of(reject_text),
        "level": level,
    }  # fmt: skip
    gravity = None if gravity_text is None else parse_numbers(gravity_text, "--gravity", 3)

    from dataclasses import replace

    from cartstiff.loading import load
    from cartstiff.loading.parts import gravity_of

    elastic = load(mechanism, frame=frame)
    if gravity is not None:
        elastic = replace(elastic, gravity=gravity_of(gravity, "--gravity", elastic.units))
    return elastic, settings, keywords


def _words(text: str) -> list[str]:
    """Names separated by commas; the axes of a link stay with it."""
    if ":" in text:
        return [text.strip()]
    return [part.strip() for part in text.split(",")]


def _point(text: str | None, option: str) -> tuple[float, float, float]:
    if text is None:
        return (0.0, 0.0, 0.0)
    x, y, z = parse_numbers(text, option, 3)
    return (x, y, z)


def _progress(step: int, change: float) -> None:
    """A line on a terminal for each step of a long fit."""
    if sys.stderr.isatty():
        click.echo(f"step {step}: largest relative change {change:.3g}", err=True)
