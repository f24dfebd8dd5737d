"""A map in a report."""

from __future__ import annotations

from html import escape
from pathlib import Path

from cartstiff.errors import one_line
from cartstiff.figures import figure_content
from cartstiff.maps.pictures import draw_map
from cartstiff.maps.reading import map_of_mechanism, quantities_of, quantity_of, summary
from cartstiff.maps.store import MapFile
from cartstiff.mechanisms.elastic import ElasticMechanism
from cartstiff.units import engineering


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
    if differs:
        text += f" The map is of {', '.join(differs)} than this report."
    if about.get("command"):
        text += f" Made by {one_line(about['command'], 400)}"
    return "Map", f"<figure>{drawn[drawn.index('<svg') :]}</figure><p>{escape(text)}</p>"
