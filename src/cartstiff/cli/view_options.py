"""Options that ``cartstiff view`` and ``cartstiff export`` share: what the page is started with."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import click

from cartstiff.cli.options import load_with_options, mechanism_options, once, parse_numbers
from cartstiff.errors import InputError, MissingDependencyError

__all__ = ["page_options", "source_from_options"]

_Command = TypeVar("_Command", bound=Callable[..., Any])


def page_options(command: _Command) -> _Command:
    """MECHANISM, posture, springs, load, map and trajectory; keywords of `source_from_options`."""
    options = [
        click.option(
            "--load", "load_text", multiple=True, callback=once, metavar="MX,MY,MZ,FX,FY,FZ",
            help="Wrench on the body in its own frame; rest positions are chosen so that the "
            "springs balance it.",
        ),
        click.option(
            "--map", "map_path", type=click.Path(path_type=Path), metavar="FILE",
            help="Also draw the points of a stiffness map, coloured.",
        ),
        click.option(
            "--trajectory", "trajectory_path", type=click.Path(path_type=Path), metavar="FILE.csv",
            help="Postures for a time slider: one a line, in joint order or under a line of names; "
            "a column `time` in seconds may come first.",
        ),
    ]  # fmt: skip
    for option in reversed(options):
        command = option(command)
    return mechanism_options(command)


def source_from_options(
    mechanism: str,
    q_text: str | None,
    pose_text: str | None,
    lengths_text: str | None,
    frame: str | None,
    stiffness_text: str | None,
    rest_text: str | None,
    load_text: str | None,
    map_path: Path | None,
    trajectory_path: Path | None,
) -> Any:
    """The page's `Source`, with everything checked that a page would show.

    Raises
    ------
    InputError
        For what cannot be used; UndefinedError and ConvergenceError where there is no posture.
    """
    if load_text is not None and rest_text is not None:
        raise InputError("give --load or --rest, not both: one follows from the other")
    load = None if load_text is None else parse_numbers(load_text, "--load", 6)
    elastic, q = load_with_options(
        mechanism, frame, q_text, pose_text, stiffness_text, rest_text, lengths_text
    )
    import numpy as np

    from cartstiff.mechanisms.loading import load as load_mechanism
    from cartstiff.stiffness.compute import analyse
    from cartstiff.view.source import Source, read_cloud, read_trajectory

    with np.errstate(all="ignore"):
        first = analyse(elastic, q, wrench=load)

    def reload(name: str) -> Any:
        other = load_mechanism(mechanism, frame=name)
        if other.names != elastic.names:
            return other
        stiffness = None if elastic.springs is None else elastic.springs.stiffness
        rest = elastic.springs.rest if elastic.springs is not None and rest_text else None
        return other.with_springs(stiffness if stiffness_text else None, rest)

    names = elastic.names
    return Source(
        elastic=elastic,
        q=first.q,
        load=None if load is None else np.array(load),
        reload=reload,
        trajectory=None if trajectory_path is None else read_trajectory(trajectory_path, names),
        cloud=None if map_path is None else read_cloud(map_path),
    )


def needs_view(purpose: str) -> MissingDependencyError:
    """The refusal where tornado is missing."""
    return MissingDependencyError("tornado", purpose, "view")
