"""Finds files of robots of robot_descriptions.

Run as a script in a process of its own.
"""

from __future__ import annotations

import os
import sys
import types
from importlib import import_module
from pathlib import Path
from typing import Any

from cartstiff.files.child_process import serve

_MEGABYTES, _SECONDS = 1024, 6


def described(name: str) -> dict[str, Any]:
    """The files that a module of robot_descriptions names, if they are in the cache."""
    import robot_descriptions
    from robot_descriptions._repositories import REPOSITORIES

    cache = os.environ.get("ROBOT_DESCRIPTIONS_CACHE", "~/.cache/robot_descriptions")
    missing: list[str] = []

    def cached(repository: str, commit: str | None = None) -> str:
        inside = REPOSITORIES[repository].cache_path
        inside = inside if commit is None else f"{inside}-{commit}/{inside}"
        folder = Path(cache).expanduser() / inside
        if not folder.is_dir():
            missing.append(str(folder))
        return str(folder)

    # Its own function downloads what is not there.
    stand_in = types.ModuleType("robot_descriptions._cache")
    vars(stand_in)["clone_to_cache"] = cached
    vars(stand_in)["get_head_sha"] = lambda _: None
    sys.modules[stand_in.__name__] = stand_in
    try:
        module: Any = import_module(f"{robot_descriptions.__name__}.{name}")
    except ModuleNotFoundError as error:
        if error.name == f"robot_descriptions.{name}":
            return {
                "unknown": sorted(
                    p.stem
                    for p in Path(robot_descriptions.__path__[0]).glob("*_description.py")
                )
            }
        raise
    if missing:
        return {"not_cached": missing[0]}
    for kind in ("URDF", "XACRO", "MJCF"):
        if path := getattr(module, f"{kind}_PATH", None):
            break
    else:
        return {"error": "it has neither a URDF nor a xacro nor an MJCF file"}
    more = vars(module) if kind == "XACRO" else {}
    return {
        "path": path,
        "arguments": {k: str(v) for k, v in more.get("XACRO_ARGS", {}).items()},
        "packages": [*map(str, more.get("XACRO_PACKAGE_PATHS", {}).values())],
    }


if __name__ == "__main__":
    serve(described, _MEGABYTES, _SECONDS)
