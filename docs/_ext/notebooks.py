"""Pages made from the notebooks of ``examples/notebooks``.

``docs/notebooks/NAME.md`` is an empty page; when it is read, the notebook's text, code and stored
output take its place, written as MyST.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from sphinx.application import Sphinx

FOLDER = Path(__file__).resolve().parents[2] / "examples" / "notebooks"
_PREFIX = "notebooks/"


def cells(path: Path) -> list[dict[str, Any]]:
    """Cells of a notebook file."""
    found: list[dict[str, Any]] = json.loads(path.read_text(encoding="utf-8"))["cells"]
    return found


def heading(path: Path) -> tuple[str, str]:
    """Title and first paragraph: the notebook's first cell."""
    text = "".join(cells(path)[0]["source"])
    title, _, rest = text.partition("\n")
    return title.lstrip("# ").strip(), rest.strip().split("\n\n")[0]


def as_myst(path: Path) -> str:
    """Text, code and printed output as MyST."""
    parts = []
    for cell in cells(path):
        source = "".join(cell["source"])
        if cell["cell_type"] == "markdown":
            parts.append(source)
            continue
        parts.append(f"```python\n{source}\n```")
        text = "".join("".join(output.get("text", "")) for output in cell["outputs"])
        if text.strip():
            parts.append(f"```text\n{text.rstrip()}\n```")
    picture = f"![{heading(path)[0]}](../images/{path.stem}.png)"
    source = f"{{download}}`The notebook <../../examples/notebooks/{path.name}>`"
    return "\n\n".join([*parts, picture, source]) + "\n"


def fill(app: Sphinx, docname: str, source: list[str]) -> None:
    """Put the notebook in place of its empty page."""
    if docname.startswith(_PREFIX):
        path = FOLDER / f"{docname.removeprefix(_PREFIX)}.ipynb"
        app.env.note_dependency(str(path))
        source[0] = as_myst(path)


def setup(app: Sphinx) -> dict[str, Any]:
    """Register."""
    app.connect("source-read", fill)
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}
