"""Mechanism files of the package, and robots of example-robot-data where it is installed."""

from __future__ import annotations

from pathlib import Path

from tests.inner import example_robot as example_robot
from tests.inner import example_robots as example_robots
from tests.inner import visuals_of as visuals_of

#: Where the package's mechanism files are.
FOLDER = Path(__file__).resolve().parents[2] / "robots"


def bundled_files() -> dict[str, Path]:
    """The package's mechanism files by their names."""
    return {path.stem: path for path in sorted(FOLDER.glob("*.yaml"))}
