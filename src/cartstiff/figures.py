"""Figures that need no window: how they are made, and their content as a file."""

from __future__ import annotations

import io
from typing import Any

from cartstiff.errors import InputError, imported, printable


def new_figure(width: float = 6.4, height: float = 4.2) -> Any:
    """A matplotlib figure of a size in inches.

    Raises
    ------
    MissingDependencyError
        Without matplotlib.
    """
    Figure = imported("matplotlib.figure", "matplotlib", "drawing a figure", "plots").Figure
    return Figure(figsize=(width, height), layout="constrained")


def figure_content(figure: Any, ending: str) -> bytes:
    """A figure as the content of a .png, .svg or .pdf file.

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
    for text in figure.findobj(Text):  # names are no formulas, and no commands
        text.set_text(printable(text.get_text()))
        text.set_parse_math(False)
    figure.savefig(buffer, format=ending[1:])
    return buffer.getvalue()


def _without_formulas(figure: Any) -> None:
    """Powers of ten beside logarithmic axes as 1e-03: texts are not read as formulas."""
    from matplotlib.ticker import LogFormatter

    for axis in (axis for axes in figure.axes for axis in (axes.xaxis, axes.yaxis)):
        if axis.get_scale() == "log":
            axis.set_major_formatter(LogFormatter(labelOnlyBase=True))
            axis.set_minor_formatter(LogFormatter(minor_thresholds=(1.0, 0.4)))
