"""``cartstiff frames`` and ``models``."""

from __future__ import annotations

from typing import Annotated, Any

import click

from cartstiff.shown.cli.declare import Overrides
from cartstiff.shown.cli.options import Printed, Setup, declared


@declared("frames")
def frames_command(
    setup: Annotated[
        Setup,
        Overrides(
            "pose pose_of lengths rest actuate load load_at world load_kind",
            because="frames are listed, and nothing moves or loads them",
        ),
    ],
    out: Printed,
) -> None:
    """Frames of MECHANISM as a tree, with joints, limits, springs and masses.

    Any of these frames can be named with --frame on the other commands.

    Parameters
    ----------
    setup
        The mechanism.
    out
        Output.

    Examples
    --------
    cartstiff frames ur5
    cartstiff frames my_arm.urdf --json
    """
    from cartstiff.shown.report.frames import describe_frames, frames_of

    elastic = setup.at_posture()
    answer = frames_of(elastic)
    sizes = elastic.units, elastic.mechanism.at(elastic.q).length
    out.show(answer, setup.mechanism, lambda: describe_frames(answer, *sizes))


@declared("models")
def models_command(out: Printed, *, quantities: bool = False) -> None:
    """List what can be named: mechanisms, example robots, and published joint springs.

    Parameters
    ----------
    out
        Output.
    quantities
        List the quantities of maps, paths and designs instead, with their units.

    Examples
    --------
    cartstiff models
    cartstiff models --quantities
    cartstiff models --json
    """
    if quantities:
        data, lines = _quantities()
        out.show(data, "quantities", lambda: "\n".join(lines))
        return
    from cartstiff.files.catalogue import bundled_files, example_robots
    from cartstiff.files.published import GRADES, published_springs
    from cartstiff.files.yaml_file import read_yaml

    bundled = {name: read_yaml(path)[0] for name, path in bundled_files().items()}
    robots = example_robots()
    names = [name for name, urdf in robots.items() if urdf is not None]
    data = {
        "bundled": {
            name: {"kind": file.get("kind"), "description": file.get("description")}
            for name, file in bundled.items()
        },
        "example_robots": names,
        "springs": published_springs(),
    }
    lines = [
        f"  {name:<16} {file.get('kind', ''):<14} {file.get('description', '')}"
        for name, file in bundled.items()
    ]
    if robots:
        listed = "\n" + click.wrap_text(
            ", ".join(names), 98, "  ", "  ", preserve_paragraphs=False
        )
    else:
        listed = " none; pip install 'cartstiff[robots]' adds them."
    text = [
        "Bundled mechanisms:",
        *lines,
        f"\nRobots of example-robot-data:{listed}\n",
        "Or a path: a mechanism file (.yaml), .urdf, .xacro, MJCF .xml.",
        "\nPublished joint springs, for --springs:",
        *(
            f"  {name:<32} {s['grade']}  {s['robot']}, joints {', '.join(s['stiffness'])}"
            + (": not to be used" if "refused" in s else "")
            for name, s in published_springs().items()
        ),
        *(f"  {grade}: {words}" for grade, words in GRADES.items()),
    ]
    out.show(data, "models", lambda: "\n".join(text))


def _quantities() -> tuple[dict[str, Any], list[str]]:
    """Return the table of quantities as plain data and as lines."""
    from cartstiff.core.units import SI
    from cartstiff.recorded.quantities import QUANTITIES

    known = [
        {
            "name": q.name,
            "unit": q.unit_in(SI),
            "description": q.description,
            "asks": q.asks,
            "better": q.better,
        }
        for q in QUANTITIES.values()
    ]
    width = max(map(len, QUANTITIES))
    lines = []
    for q in known:
        if q["asks"]:
            more = f"; --{q['asks']}".replace("deflect", "added-load or --load")
        else:
            more = ""
        lines.append(f"{q['name']:<{width}}  {q['unit']:<12} {q['description']}{more}")
    return {"schema": "cartstiff-quantities/1", "quantities": known}, lines
