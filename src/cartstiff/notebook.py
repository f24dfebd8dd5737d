"""Display of results: a few lines in Python, the lines and a table in a notebook."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from cartstiff.errors import joined, printable


class ShownInLines:
    """Base of classes displayed as the lines of `_lines`; dataclasses need `repr=False`."""

    def _lines(self) -> Iterable[str]:
        raise NotImplementedError

    def __repr__(self) -> str:
        return joined(self._lines())

    def _repr_html_(self) -> str:
        from html import escape

        return f"<pre>{escape(repr(self))}</pre>"


def html_table(
    heads: Iterable[tuple[str, int]], rows: Iterable[Sequence[str]], caption: str = ""
) -> str:
    """HTML table of texts: heads with their numbers of columns, rows that begin with a name."""
    from html import escape

    def shown(text: str) -> str:
        return escape(printable(text))

    head = "".join(f"<th colspan={span}>{shown(text)}</th>" for text, span in heads)
    lines = [f"<tr>{head}</tr>"]
    for name, *cells in rows:
        numbers = "".join(f"<td style='text-align:right'>{shown(cell)}</td>" for cell in cells)
        lines.append(f"<tr><th>{shown(name)}</th>{numbers}</tr>")
    about = f"<caption style='text-align:left'>{shown(caption)}</caption>" if caption else ""
    return f"<table>{about}{''.join(lines)}</table>"
