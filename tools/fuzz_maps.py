"""Maps with damaged files: what is read is what was computed, or a line says what is wrong."""

from __future__ import annotations

import json
import random
import shutil
import tempfile
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from tools.fuzz_common import FaultError, mutated_bytes, mutated_data


@cache
def whole_map() -> tuple[Path, Any]:
    """A small map on disk, and what was computed for it."""
    import cartstiff
    from cartstiff.maps import RandomPostures, compute_map, open_map

    elastic = cartstiff.load("ur5")
    sampling = RandomPostures(12, 5, elastic.q - 0.3, elastic.q + 0.3)
    file = Path(tempfile.mkdtemp(prefix="cartstiff-fuzz-map-", dir="..")).resolve() / "m.zarr"
    compute_map(elastic, sampling, ["translation_free_min", "condition"], file, chunk=4, length=0.2)
    return file, open_map(file).load()


def map_file(rng: random.Random) -> str:
    """A finished map with one or two files damaged, cut, exchanged or lost."""
    from cartstiff.errors import CartstiffError
    from cartstiff.maps import open_map

    original, expected = whole_map()
    file = Path("m.zarr")
    shutil.copytree(original, file)
    files = sorted(p for p in file.rglob("*") if p.is_file())
    for path in rng.sample(files, rng.choice([1, 1, 2])):
        if not path.exists():
            continue
        data, action = path.read_bytes(), rng.random()
        if action < 0.25:
            other = rng.choice([file for file in files if file.exists()])
            data, kept = other.read_bytes(), data
            other.write_bytes(kept)
        elif action < 0.6 and path.name == "zarr.json" and data.startswith(b"{"):
            data = json.dumps(mutated_data(rng, json.loads(data))).encode("utf-8", "replace")
        elif action < 0.7:
            data = data[: rng.randrange(len(data) + 1)]
        elif action < 0.8:
            data = rng.randbytes(len(data))
        elif data:
            data = mutated_bytes(rng, data)
        path.write_bytes(data)
        if action > 0.95:
            path.unlink()
    try:
        found = open_map(file).load()
    except CartstiffError as error:
        if "\n" in str(error):
            raise FaultError(f"several lines: {str(error)[:200]!r}") from None
        return "refused"
    missing = found["state"].values == 255
    for name in expected.variables:
        true, read = expected[name].values, found[name].values
        if true.shape != read.shape:
            raise FaultError(f"{name} has shape {read.shape}, computed {true.shape}")
        if name in expected.data_vars:
            true, read = true[~missing], read[~missing]
        if not np.array_equal(true, read, equal_nan=true.dtype.kind == "f"):
            raise FaultError(f"{name} is read as other numbers")
    return "answered"
