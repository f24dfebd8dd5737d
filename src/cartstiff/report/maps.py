"""Maps as text: size, states, ranges of quantities, tables of postures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

from cartstiff.errors import joined, one_line
from cartstiff.figures import figure_content
from cartstiff.maps.pictures import draw_map
from cartstiff.maps.reading import map_of_mechanism, quantities_of, quantity_of, summary
from cartstiff.maps.store import MapFile
from cartstiff.mechanisms.elastic import ElasticMechanism
from cartstiff.report.analysis import BALANCING
from cartstiff.report.layout import body_frame, length_of, number, table
from cartstiff.units import Units, engineering


def describe_map(
    answer: Mapping[str, Any], coordinates: Sequence[str], weighed: str, is_loaded: bool
) -> str:
    """Describe the answer of ``cartstiff map``; `weighed` describes the acting masses.

    With `is_loaded` a load was given, so that rest positions were chosen.
    """
    parts, own = answer["parts"], Units.from_dict(answer["units"])
    lines = [
        f"{answer['mechanism']}: {answer['postures']} postures, "
        f"{body_frame(answer, own)}, K^{answer['connection']}, characteristic length "
        f"{length_of(answer['characteristic_length'], own, 6)}",
        f"{answer['file']}: {parts['total']} part(s), {parts['found']} found there, "
        f"{parts['computed']} computed",
        *_slice(answer),
        *_searched(answer.get("branches")),
        *_load(answer),
        *([weighed] if weighed else []),
        "",
        "States",
        *table(("state", "postures"), [(k, str(n)) for k, n in answer["states"].items()]),
        *(
            [f"unbalanced: {BALANCING}"]
            * ("unbalanced" in answer["states"] and not is_loaded)
        ),
        "",
        "Quantities",
        *table(
            ("quantity", "unit", "smallest", "mean", "largest", "undefined"),
            [
                (
                    name,
                    q["unit"],
                    *(number(q[k]) for k in ("smallest", "mean", "largest")),
                    str(q["undefined"]),
                )
                for name, q in answer["quantities"].items()
            ],
        ),
    ]
    for name, rows in answer.get("best", {}).items():
        unit = answer["quantities"][name]["unit"]
        lines += ["", f"Best of {name} [{unit}]"]
        lines += _postures(rows, own, coordinates)
    return joined(lines)


def ranked(dataset: Any, name: str, count: int) -> list[dict[str, Any]]:
    """Return the best postures as rows of a table, for JSON."""
    from cartstiff.arrays import plain
    from cartstiff.maps.reading import best, state_names

    rows = best(dataset, name, count)
    names = state_names(dataset)
    joints = [str(j) for j in dataset["joint"].values]
    return [
        {
            "value": plain(rows[name].values[i]),
            "q": dict(zip(joints, plain(rows["q"].values[i]), strict=True)),
            "position": plain(rows["position"].values[i]),
            "state": names[int(rows["state"].values[i])],
        }
        for i in range(rows.sizes["rank"])
    ]


def _searched(branches: Mapping[str, int] | None) -> list[str]:
    """Describe the number of branches at a place, and their search."""
    if branches is None:
        return []
    legs = branches["legs"]
    how = f"each of {legs} legs" if legs else "the mechanism as a whole"
    return [
        f"at most {branches['found']} branches found at a place, up to "
        f"{branches['kept']} kept; "
        f"searched from {branches['starts']} starts: {how}"
    ]


def _load(answer: Mapping[str, Any]) -> list[str]:
    """State the assumed behaviour of the load for K^load."""
    if answer["connection"] != "load":
        return []
    load = answer["load"]
    at = ", ".join(number(x) for x in load["at"])
    return [
        f"K^load: the tangent under the load, {load['kind']} at ({at}): {load['meaning']}"
    ]


def _postures(
    rows: list[dict[str, Any]], units: Units, coordinates: Sequence[str]
) -> list[str]:
    if not rows:
        return ["  none"]
    mm = units.shown_per_length
    sizes = [
        units.shown_per_radian if head.endswith("[deg]") else mm for head in coordinates
    ]
    titles = ["value", *coordinates]
    titles += [f"{c} [{units.shown_length}]" for c in "xyz"]
    return table(
        titles,
        [
            [
                number(row["value"]),
                *(number(q * s) for q, s in zip(row["q"].values(), sizes, strict=True)),
                *(number(mm * x) for x in row["position"]),
            ]
            for row in rows
        ],
    )


def _slice(answer: Mapping[str, Any]) -> list[str]:
    at = [
        f"{name} {p['value']:g} {p['unit']}"
        for name, p in answer.get("slice", {}).items()
    ]
    return [f"  only the nearest places to the slice: {', '.join(at)}"] if at else []


def map_section(
    path: Path | str, quantity: str | None, elastic: ElasticMechanism
) -> tuple[str, str]:
    """Return title and HTML of a map's quantity: picture, range, command.

    Parameters
    ----------
    path : path or address
        Also show a map that `cartstiff map` computed.
    quantity : str or None
        Quantity of the map; default its first.
    elastic : ElasticMechanism
        The mechanism that it has to be of.

    Raises
    ------
    InputError
        For a map of another mechanism, or one that cannot be read.
    UnknownNameError
        If it has no such quantity.
    """
    dataset, differs = map_of_mechanism(path, elastic, "--map")
    about = dataset.attrs
    name = quantity or quantities_of(dataset)[0]
    words = quantity_of(dataset, name).attrs
    figure = draw_map(dataset, name, angle=elastic.units.shown_angle)
    drawn, facts = figure_content(figure, ".svg").decode(), summary(MapFile.at(path))
    ends = ", ".join(
        f"{end} {engineering(facts['quantities'][name][end], words['units'])}"
        for end in ("smallest", "largest")
    )
    states = ", ".join(f"{count} {state}" for state, count in facts["states"].items())
    text = f"{words['long_name']}: {ends}; postures: {states}."
    text += f" The map is of {', '.join(differs)} than this report." if differs else ""
    if about.get("command"):
        text += f" Made by {one_line(about['command'], 400)}"
    return "Map", f"<figure>{drawn[drawn.index('<svg') :]}</figure><p>{escape(text)}</p>"
