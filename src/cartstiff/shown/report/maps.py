"""A map in a report."""

from __future__ import annotations

from html import escape
from pathlib import Path

from cartstiff.answer.data import said
from cartstiff.core.errors import one_line
from cartstiff.core.mechanisms.elastic import ElasticMechanism
from cartstiff.shown.report.output import figure_content
from cartstiff.shown.report.sentences import answer_sentences, statement_sentences
from cartstiff.wings.maps.answer import answer_of_map, map_data
from cartstiff.wings.maps.pictures import draw_map
from cartstiff.wings.maps.reading import map_of_mechanism, quantities_of, summary
from cartstiff.wings.maps.store import MapFile


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
    dataset, differs = map_of_mechanism(path, elastic)
    file, name = MapFile.at(path), quantity or quantities_of(dataset)[0]
    figure = draw_map(dataset, name, angle=elastic.units.shown_angle)
    drawn, facts = figure_content(figure, ".svg").decode(), summary(file)
    shown = {name: facts["quantities"][name]}
    data = map_data(file, str(path), facts | {"quantities": shown})
    answer = answer_of_map(data, elastic, is_loaded=True)
    about = list(answer.about)
    if differs:
        about.append(said("map-differs", what=list(differs)))
    if command := dataset.attrs.get("command"):
        about.append(said("made-by", command=one_line(command, 400)))
    lines = [*answer_sentences(answer), *statement_sentences(answer, about)]
    body = "".join(f"<li>{escape(line)}</li>" for line in lines)
    return "Map", f"<figure>{drawn[drawn.index('<svg') :]}</figure><ul>{body}</ul>"
