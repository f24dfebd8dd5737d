"""Writing of results to files, completely or not at all."""

from __future__ import annotations

import io
import json
from collections.abc import Callable, Mapping
from operator import methodcaller
from pathlib import Path
from typing import Any

from cartstiff.core.errors import InputError, printable
from cartstiff.core.writing import write_whole


def write_json(data: Mapping[str, Any], path: Path) -> None:
    """Write a result's plain data as JSON."""
    plain = methodcaller("to_dict")
    text = json.dumps(data, default=plain, allow_nan=False, indent=1)
    write_whole(path, text.encode() + b"\n")


def write_files(*files: tuple[Path | None, Callable[[], Any]]) -> None:
    """Write texts, bytes and figures to their files; all are made before the
    first is written.

    A path that is None was not asked for.
    """
    made = []
    for path, make in files:
        if path is not None:
            content = make()
            if isinstance(content, str):
                content = content.encode()
            elif not isinstance(content, bytes):
                content = figure_content(content, path.suffix)
            made.append((path, content))
    for path, data in made:
        write_whole(path, data)


def save_figure(figure: Any, file: str | Path) -> None:
    """Write a figure as .png, .svg or .pdf, whole or not at all.

    Raises
    ------
    InputError
        For another ending, or a place that cannot be written.
    """
    path = Path(file)
    write_whole(path, figure_content(figure, path.suffix))


def figure_content(figure: Any, ending: str) -> bytes:
    """Return the content of a .png, .svg or .pdf file of a figure.

    Raises
    ------
    InputError
        For another ending.
    """
    ending = ending.lower()
    if ending not in (".png", ".svg", ".pdf"):
        raise InputError("unknown file ending", expected=".png, .svg or .pdf", got=ending)
    from matplotlib.text import Text

    buffer = io.BytesIO()
    _without_formulas(figure)
    for text in figure.findobj(Text):  # names are not formulas, nor control characters
        text.set_text(printable(text.get_text()))
        text.set_parse_math(False)
    figure.savefig(buffer, format=ending[1:])
    return buffer.getvalue()


def _without_formulas(figure: Any) -> None:
    """Label logarithmic axes with 1e-03 instead of formulas, which are not rendered."""
    from matplotlib.ticker import LogFormatter

    for axis in (axis for axes in figure.axes for axis in (axes.xaxis, axes.yaxis)):
        if axis.get_scale() == "log":
            axis.set_major_formatter(LogFormatter(labelOnlyBase=True))
            axis.set_minor_formatter(LogFormatter(minor_thresholds=(1.0, 0.4)))
