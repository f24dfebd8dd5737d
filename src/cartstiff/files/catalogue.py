"""Names of mechanisms: bundled files, and the robots of example-robot-data."""

from __future__ import annotations

import importlib.util
import sys
from functools import cache
from pathlib import Path

from cartstiff.core.errors import InputError, MissingDependencyError, check_name


@cache
def bundled_folder() -> Path:
    """Return the folder of the bundled mechanism files."""
    package = Path(__file__).parents[1] / "robots"
    # In a checkout the files are beside src/, in a wheel inside the package.
    return package if package.is_dir() else Path(__file__).parents[3] / "robots"


@cache
def bundled_files() -> dict[str, Path]:
    """Return the bundled mechanism files by their stem."""
    return {path.stem: path for path in sorted(bundled_folder().glob("*.yaml"))}


def bundled(name: str) -> Path | None:
    """Return the bundled file of a name, or None."""
    return bundled_files().get(name)


@cache
def _data_directory() -> Path | None:
    for entry in sys.path:
        # example-robot-data installs below the prefix of the cmeel packages.
        for candidate in (
            Path(entry) / "cmeel.prefix/share/example-robot-data/robots",
            Path(entry) / "../../../share/example-robot-data/robots",
        ):
            if candidate.is_dir():
                return candidate.resolve()
    return None


@cache
def example_robots() -> dict[str, Path | None]:
    """The URDF (None without one) of each robot of example-robot-data, if installed."""
    data = _data_directory()
    if data is None or importlib.util.find_spec("example_robot_data") is None:
        return {}
    from example_robot_data import robots_loader

    loaders = dict(robots_loader.ROBOTS)
    # In release 5.0.0 the name ur3 is bound to the UR5's loader.
    if hasattr(robots_loader, "UR3Loader"):
        loaders["ur3"] = robots_loader.UR3Loader
    found: dict[str, Path | None] = {}
    for name, loader in sorted(loaders.items()):
        file = loader.urdf_filename
        found[name] = data / loader.path / loader.urdf_subpath / file if file else None
    return found


def example_robot(name: str) -> Path:
    """Return the URDF of an example robot.

    Raises
    ------
    UnknownNameError
        For an unknown name; MissingDependencyError if the data is not installed.
    InputError
        For a robot that has no URDF.
    """
    robots = example_robots()
    if not robots:
        raise MissingDependencyError(
            "example-robot-data-loaders", f"the example robot {name!r}", "robots"
        )
    check_name("model", name, robots)
    path = robots[name]
    if path is None or not path.is_file():
        raise InputError(
            f"example robot {name!r} has no URDF and cannot be loaded",
            expected="a URDF robot",
        )
    return path
