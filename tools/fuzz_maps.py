"""Maps with damaged files: what is read is what was computed, or a line says what is wrong.

``python -m tools.fuzz_maps COUNT SEED`` reads as many crafted maps, whose checksums are right, in
every way.
"""

from __future__ import annotations

import json
import random
import resource
import shutil
import sys
import tempfile
from contextlib import suppress
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
    from cartstiff import CartstiffError
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


def resealed(folder: Path) -> None:
    """Write the checksums that fit what a crafted folder holds now."""
    from cartstiff.wings.maps.sealed import seal
    from cartstiff.wings.maps.store import CHECKSUM, _description_checksum

    root = json.loads((folder / "zarr.json").read_text())
    about = root["consolidated_metadata"]["metadata"]["parts"]["attributes"]
    for key in about["objects"]:
        if (folder / key).is_file():
            about["objects"][key] = seal("", key, (folder / key).read_bytes())
    salt = root["attributes"][CHECKSUM] = _description_checksum(root)
    (folder / "zarr.json").write_text(json.dumps(root))
    for mark in (folder / "parts" / "marks" / "c").glob("*/0"):
        row = np.frombuffer(mark.read_bytes(), "<f8").copy()
        for i, name in enumerate(about["arrays"]):
            inside = "/0" if name in ("position", "q") else ""
            key = f"{name}/c/{mark.parent.name}{inside}"
            if (folder / key).is_file():
                row[1 + i] = seal(salt, key, (folder / key).read_bytes())
        row[0] = 1 + seal(salt, f"parts/marks/{mark.parent.name}", row[1:].tobytes())
        mark.write_bytes(row.tobytes())


def crafted_map(rng: random.Random) -> str:
    """A map with changed descriptions, names or chunks, and right checksums, read in every way."""
    import cartstiff
    from cartstiff import CartstiffError
    from cartstiff.maps import RandomPostures, compute_map, open_map
    from cartstiff.shown.page.source import read_cloud
    from cartstiff.shown.report.maps import map_section

    original, _ = whole_map()
    file = Path(tempfile.mkdtemp(prefix="crafted-")) / "m.zarr"
    shutil.copytree(original, file)
    elastic = cartstiff.load("ur5")
    for _ in range(rng.choice([1, 1, 1, 2, 4])):
        paths = sorted(p for p in file.rglob("*") if p.is_file())
        path = rng.choice([file / "zarr.json", file / "zarr.json", rng.choice(paths)])
        data = path.read_bytes()
        if path.name == "zarr.json":
            changed = json.loads(data)
            if rng.random() < 0.4 and path.parent == file:  # inside the identity
                text = json.loads(changed["attributes"]["description"])
                changed["attributes"]["description"] = json.dumps(mutated_data(rng, text))
            elif rng.random() < 0.4 and path.parent == file:  # sizes
                nodes = changed["consolidated_metadata"]["metadata"]
                many = rng.choice([0, -1, 10**5, 10**9, 10**30, 1.5, None])
                for name in rng.choice([list(nodes), [rng.choice(list(nodes))]]):
                    with suppress(LookupError, TypeError):  # changed before
                        nodes[name]["shape"][0] = many
                        if rng.random() < 0.5:
                            nodes[name]["chunk_grid"]["configuration"]["chunk_shape"][0] = many
            else:
                changed = mutated_data(rng, changed)
            path.write_text(json.dumps(changed), errors="replace")
        elif rng.random() < 0.2:
            path.rename(path.with_name(rng.choice(["7", "x", "00", "-1", "9" * 30])))
        else:
            path.write_bytes(mutated_bytes(rng, data) if data else b"x")
    with suppress(Exception):  # what is no description any more keeps its wrong checksums
        resealed(file)
    answered = 0
    sampling = RandomPostures(12, 5, elastic.q - 0.3, elastic.q + 0.3)
    names = ["translation_free_min", "condition"]
    for read in (
        lambda: open_map(file).load(),
        lambda: read_cloud(file, elastic),
        lambda: map_section(file, None, elastic),
        lambda: compute_map(elastic, sampling, names, file, length=0.2).load(),
    ):
        try:
            read()
            answered += 1
        except CartstiffError as error:
            if "\n" in str(error):
                raise FaultError(f"several lines: {str(error)[:200]!r}") from None
    shutil.rmtree(file.parent)
    return "answered" if answered == 4 else "refused"


def main(count: int, seed: int) -> None:
    """Read crafted maps; print how many were refused, faults, and the memory that it took."""
    faults, states = 0, dict[str, int]()
    for index in range(count):
        try:
            state = crafted_map(random.Random(f"{seed} {index}"))
        except Exception as error:
            state, faults = "FAULT", faults + 1
            print(f"{index}: {type(error).__name__}: {str(error)[:300]}", flush=True)
        states[state] = states.get(state, 0) + 1
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(f"{states}, {peak:.0f} MB at most")
    sys.exit(bool(faults))


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]))
