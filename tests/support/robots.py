"""Mechanism files of the package, robots of example-robot-data where it is installed, meshes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from cartstiff import InputError
from tests.inner import example_robot as example_robot
from tests.inner import example_robots as example_robots
from tests.inner import read_meshes
from tests.inner import visuals_of as visuals_of

#: Where the package's mechanism files are.
FOLDER = Path(__file__).resolve().parents[2] / "robots"


def bundled_files() -> dict[str, Path]:
    """The package's mechanism files by their names."""
    return {path.stem: path for path in sorted(FOLDER.glob("*.yaml"))}


def read_all_meshes(paths: list[Path]) -> dict[Path, Any]:
    """Mesh files, or the refusal of each."""
    return dict(read_meshes(paths))


def read_mesh(path: Path) -> Any:
    """A mesh file, or its refusal raised."""
    mesh = read_all_meshes([path])[path]
    if isinstance(mesh, InputError):
        raise mesh
    return mesh
