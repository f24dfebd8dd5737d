"""The tests of maps need the packages that keep and read them."""

from __future__ import annotations

import importlib.util
import json
from typing import Any

import pytest

_NEEDED = ("dask", "distributed", "matplotlib", "psutil", "tqdm", "xarray", "zarr")

collect_ignore_glob = [] if all(map(importlib.util.find_spec, _NEEDED)) else ["test_*.py"]


@pytest.fixture(scope="session")
def whole(tmp_path_factory: pytest.TempPathFactory) -> tuple[Any, dict[str, Any]]:
    """The map of `machines.COMMAND` computed without a break, and what the command printed."""
    from tests.maps.machines import start_map

    from cartstiff.maps import open_map

    file = tmp_path_factory.mktemp("whole") / "m.zarr"
    process = start_map(file)
    out, error = process.communicate(timeout=600)
    assert process.returncode == 0, error
    return open_map(file).load(), json.loads(out)
