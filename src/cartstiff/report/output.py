"""Writing of results to files, completely or not at all."""

from __future__ import annotations

import io
import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from cartstiff.errors import InputError
from cartstiff.figures import figure_content
from cartstiff.stiffness.compute import PostureStiffness
from cartstiff.writing import write_whole


def write_result(
    result: PostureStiffness, path: Path, data: Mapping[str, Any] | None = None
) -> None:
    """Write a result as JSON (.json), NumPy arrays (.npz, with the JSON inside), or by `EXCHANGE`.

    Nastran (.nas, .bdf; legs as springs: .dat), MuJoCo (.xml, platforms on lines), the geometry
    as a table (.csv) or a tree (.urdf, with a mechanism file of the same name that closes its
    loops): `cartstiff.report.exchange`. `data` is the JSON object, if it holds more than
    ``result.to_dict()``.
    """
    from cartstiff.report.exchange import EXCHANGE, exchanged, urdf_with_closures

    if path.suffix.lower() in EXCHANGE:
        write_whole(path, exchanged(result, path.suffix.lower()))
        return
    if path.suffix.lower() == ".urdf":
        tree, closures = urdf_with_closures(result, path.name)
        write_whole(path, tree)
        write_whole(path.with_suffix(".yaml"), closures)
        return
    text = json.dumps(result.to_dict() if data is None else data, allow_nan=False, indent=1)
    if path.suffix.lower() == ".json":
        write_whole(path, text.encode() + b"\n")
        return
    if path.suffix.lower() != ".npz":
        raise InputError(
            "unknown file ending",
            got=path.name,
            expected=" or ".join([".json", ".npz", ".urdf", *EXCHANGE]),
        )
    arrays = {"q": result.q, "pose": result.pose, "description": np.array(text)}
    arrays |= {f"K_{name}": K for name, K in result.matrices.items() if K is not None}
    arrays |= {f"C_{name}": C for name, C in result.compliances.items() if C is not None}
    if result.wrench is not None:
        arrays["wrench"] = result.wrench
    if result.jacobian is not None:
        arrays["jacobian"] = result.jacobian
    buffer = io.BytesIO()
    np.savez(buffer, **arrays)  # type: ignore[arg-type]
    write_whole(path, buffer.getvalue())


def write_files(*files: tuple[Path | None, Callable[[], Any]]) -> None:
    """Write texts and figures to their files; all are made before the first is written.

    A path that is None was not asked for.
    """
    made = []
    for path, make in files:
        if path is not None:
            content = make()
            data = (
                content.encode()
                if isinstance(content, str)
                else figure_content(content, path.suffix)
            )
            made.append((path, data))
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
