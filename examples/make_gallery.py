"""Run examples and notebooks: print their numbers, write their pictures to docs/images or a folder.

Usage: ``python examples/make_gallery.py [FOLDER] [NAME ...]``, all of them without a name.
"""

import contextlib
import importlib
import io
import json
import os
import runpy
import sys
import time
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
SCRIPTS = {path.stem: path for path in HERE.glob("*.py") if path.stem != "make_gallery"}
NOTEBOOKS = {path.stem: path for path in (HERE / "notebooks").glob("*.ipynb")}
NAMES = sorted(SCRIPTS | NOTEBOOKS)


def run_notebook(path: Path) -> dict[str, Any]:
    """Names that the code cells of a notebook define, run as one program and in silence."""
    cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
    names: dict[str, Any] = {"__name__": path.stem}
    with contextlib.redirect_stdout(io.StringIO()):
        for cell in cells:
            if cell["cell_type"] == "code":
                exec(compile("".join(cell["source"]), str(path), "exec"), names)
    return names


def load(name: str) -> dict[str, Any]:
    """Names that an example defines; its ``main`` among them."""
    if name in NOTEBOOKS:
        return run_notebook(NOTEBOOKS[name])
    return runpy.run_path(str(SCRIPTS[name]))


def main(folder: Path, names: list[str]) -> dict[str, Path]:
    """Pictures by example name."""
    os.environ.setdefault("MPLBACKEND", "Agg")  # no window
    folder.mkdir(parents=True, exist_ok=True)
    pictures = {}
    for name in names:
        start = time.perf_counter()
        pictures[name] = folder / f"{name}.png"
        numbers = load(name)["main"](pictures[name])
        importlib.import_module("matplotlib.pyplot").close("all")
        print(f"{name}: {pictures[name]}, {time.perf_counter() - start:.1f} s")
        for key, value in numbers.items():
            print(f"    {key:<50} {f'{value:.6g}' if isinstance(value, float) else value}")
    return pictures


if __name__ == "__main__":
    target = Path(sys.argv[1]) if sys.argv[1:] else HERE.parent / "docs" / "images"
    main(target, sys.argv[2:] or NAMES)
