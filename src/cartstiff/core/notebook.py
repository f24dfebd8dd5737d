"""Display of results: a few lines in Python, the lines and a table in a notebook."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from importlib import import_module

from cartstiff.core.errors import CartstiffError, joined, printable

#: Modules whose function `displayed` has the HTML of a result in a notebook, by its
#: class. They are above this one, and loaded when something is shown.
DISPLAYS = {"PostureStiffness": "cartstiff.shown.page.displayed"}


class ShownInLines:
    """Base of classes displayed as the lines of `_lines`; dataclasses need `repr=False`.

    Results compute what is shown when it is asked for. What does not exist there is a
    line of the display: a console, a debugger and a notebook show every object.
    """

    def _lines(self) -> Iterable[str]:
        raise NotImplementedError

    def _tables(self) -> str:
        """HTML below the lines in a notebook."""
        return ""

    def __repr__(self) -> str:
        lines = list[str]()
        try:
            lines.extend(self._lines())
        except CartstiffError as error:
            lines.append(f"{type(self).__name__}: {error}")
        return joined(lines)

    def _repr_html_(self) -> str:
        from html import escape

        lines = f"<pre>{escape(repr(self))}</pre>"
        try:
            names = (kind.__name__ for kind in type(self).__mro__)
            if (room := next(filter(None, map(DISPLAYS.get, names)), None)) is not None:
                lines = import_module(room).displayed(self)
            return lines + self._tables()
        except CartstiffError as error:
            return f"{lines}<p>{escape(printable(str(error)))}</p>"


def html_table(
    heads: Iterable[tuple[str, int]], rows: Iterable[Sequence[str]], caption: str = ""
) -> str:
    """HTML table of texts: heads with their numbers of columns,
    rows that begin with a name.
    """
    from html import escape

    def shown(text: str) -> str:
        return escape(printable(text))

    head = "".join(f"<th colspan={span}>{shown(text)}</th>" for text, span in heads)
    lines = [f"<tr>{head}</tr>"]
    for name, *cells in rows:
        numbers = "".join(
            f"<td style='text-align:right'>{shown(cell)}</td>" for cell in cells
        )
        lines.append(f"<tr><th>{shown(name)}</th>{numbers}</tr>")
    about = (
        f"<caption style='text-align:left'>{shown(caption)}</caption>" if caption else ""
    )
    return f"<table>{about}{''.join(lines)}</table>"
