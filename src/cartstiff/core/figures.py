"""Figures without a window."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from numpy.typing import ArrayLike

from cartstiff.core.errors import InputError, imported, printable

# Width in inches of the margin for doubts, and their colour.
_MARGIN, _AMBER = 0.2, "#8a5a00"


def new_figure(
    width: float = 6.4, height: float = 4.2, doubt: str = "", ax: Any = None
) -> Any:
    """Return a matplotlib figure, or the part of one whose place an axes leaves to it.

    Parameters
    ----------
    width, height : float
        In inches.
    doubt : str
        Which springs nobody measured, written along the right edge.
    ax : matplotlib.axes.Axes, optional
        Axes, from ``subplots``, in whose place the picture is drawn.

    Raises
    ------
    InputError
        For axes that stand in no grid.
    MissingDependencyError
        Without matplotlib.
    """
    place = {"rotation": 270.0, "ha": "right", "va": "center", "fontsize": 7.0}
    if ax is not None:
        if (cell := ax.get_subplotspec()) is None:
            raise InputError("axes of no grid", expected="axes from subplots()")
        part = ax.figure.add_subfigure(cell)
        ax.remove()
        part.text(1.0, 0.5, doubt, color=_AMBER, **place)
        return part
    Figure = imported(
        "matplotlib.figure", "matplotlib", "drawing a figure", "plots"
    ).Figure
    figure = Figure(figsize=(width, height), layout="constrained")
    if doubt:
        # Titles and legends are above and below.
        figure.get_layout_engine().set(rect=(0.0, 0.0, 1.0 - _MARGIN / width, 1.0))
        figure.text(1.0 - 0.3 * _MARGIN / width, 0.5, doubt, color=_AMBER, **place)
    return figure


def new_axes(
    doubt: str = "", width: float = 6.4, height: float = 4.2, ax: Any = None
) -> tuple[Any, Any]:
    """Return a figure with one diagram, and its axes: those given; as `new_figure`."""
    if ax is not None:
        return ax.figure, ax
    figure = new_figure(width, height, doubt)
    return figure, figure.subplots()


def draw_bars(axis: Any, names: Sequence[str], values: ArrayLike, label: str) -> Any:
    """Draw named numbers as bars, the first at the top as in a table; return the bars."""
    bars = axis.barh([printable(name) for name in names], values)
    axis.invert_yaxis()
    axis.set_xlabel(label)
    return bars
