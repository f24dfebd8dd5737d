"""Writing of results to files, completely or not at all."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from cartstiff.core.figures import figure_content
from cartstiff.core.writing import write_whole


def write_json(data: Mapping[str, Any], path: Path) -> None:
    """Write a result's plain data as JSON."""
    text = json.dumps(data, allow_nan=False, indent=1)
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
