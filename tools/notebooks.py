"""Run the notebooks of examples/notebooks and store what their cells print, and nothing else.

    python tools/notebooks.py [NAME ...]

Pictures are not stored: `examples/make_gallery.py` makes them from the notebooks' `main()`.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

FOLDER = Path(__file__).resolve().parents[1] / "examples" / "notebooks"
_TIMEOUT = 300  # seconds for one cell


def run(path: Path) -> dict[str, Any]:
    """The notebook as run in a fresh kernel, with printed text as its only output."""
    import nbformat
    from nbclient import NotebookClient

    notebook = nbformat.read(path, as_version=4)
    NotebookClient(notebook, timeout=_TIMEOUT, kernel_name="python3").execute(cwd=str(path.parent))
    for cell in notebook.cells:
        cell["metadata"] = {}
        if cell.cell_type == "code":
            cell["execution_count"] = None
            text = "".join(o["text"] for o in cell.outputs if o.get("name") == "stdout")
            stream = {"name": "stdout", "output_type": "stream", "text": text}
            cell["outputs"] = [nbformat.from_dict(stream)] if text else []
    notebook["metadata"] = {
        "kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"},
        "language_info": {"name": "python"},
    }
    done: dict[str, Any] = json.loads(nbformat.writes(notebook))
    return done


def printed(notebook: dict[str, Any]) -> list[str]:
    """What each code cell prints."""
    cells = (c for c in notebook["cells"] if c["cell_type"] == "code")
    return ["".join("".join(o["text"]) for o in cell["outputs"]) for cell in cells]


if __name__ == "__main__":
    for file in sorted(FOLDER.glob("*.ipynb")):
        if sys.argv[1:] and file.stem not in sys.argv[1:]:
            continue
        text = json.dumps(run(file), indent=1, ensure_ascii=False)
        file.write_text(text + "\n", encoding="utf-8")
        print(f"{file.name}: {len(text)} bytes")
