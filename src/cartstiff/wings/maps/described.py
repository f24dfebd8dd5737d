"""Check of what a map's ``zarr.json`` claims, before anything in it is believed
or allocated.

The file may come from anybody. What is checked here bounds the memory of every reader:
numbers of postures, parts and arrays, shapes, number types and codecs.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from math import ceil, isfinite, prod
from typing import Any

from cartstiff.core.units import LENGTHS
from cartstiff.wings.maps.sampling import MAX_CHUNK

#: Largest number of parts of a map: each has several objects, which are all listed.
MAX_PARTS = 10**5
#: Largest number of bytes of ``zarr.json``.
MAX_DESCRIPTION = 2**22
# Largest number of arrays, of dimensions, and of coordinates of a mechanism.
_MAX_ARRAYS, _MAX_DIMENSIONS, _MAX_JOINTS = 300, 32, 1000
# Largest number of values along an axis, which are one object; and of bytes of a part of
# an array.
_MAX_AXIS, _MAX_PART_BYTES = 10**7, 2**28
_BYTES = {"float64": 8, "uint32": 4, "uint8": 1}
_CODECS = (["bytes", "blosc", "crc32c"], ["sharding_indexed"])


def _is_text(value: Any) -> bool:
    return isinstance(value, str)


def _is_number(value: Any) -> bool:
    return (
        isinstance(value, (int, float))
        and not isinstance(value, bool)
        and isfinite(value)
    )


def _numbers(count: int) -> Callable[[Any], bool]:
    return lambda value: _list_of(value, _is_number) and len(value) == count


def _list_of(value: Any, kind: Callable[[Any], bool]) -> bool:
    return isinstance(value, list) and all(map(kind, value))


# Attributes of the group that readers use.
_ATTRIBUTES: Mapping[str, Callable[[Any], bool]] = {
    **dict.fromkeys(
        ("mechanism", "connection", "load_kind", "load_meaning", "command"), _is_text
    ),
    **dict.fromkeys(
        ("force_unit", "angle_unit", "springs_in_doubt", "identity", "description"),
        _is_text,
    ),
    "length_unit": lambda value: _is_text(value) and value in LENGTHS,
    "frame": lambda value: value is None or _is_text(value),
    "characteristic_length": _is_number,
    "frame_offset": _numbers(16),
    "base_pose": _numbers(16),
    "load_at": _numbers(3),
}


def require(is_so: bool, what: str) -> None:
    """Raise ValueError with a reason unless something holds."""
    if not is_so:
        raise ValueError(what)


def loaded(text: str | bytes) -> Any:
    """Read JSON of a map.

    Raises
    ------
    ValueError
        If it is none, or a whole number in it is no floating-point number.
    """
    return json.loads(text, parse_int=_whole)


def _whole(digits: str) -> int:
    require(isfinite(float(digits)), "a number")
    return int(digits)


def check_described(root: Mapping[str, Any]) -> None:
    """Refuse the content of a ``zarr.json`` that no map has.

    Raises
    ------
    ValueError, KeyError, TypeError, AttributeError
        With the reason.
    """
    attributes, nodes = root["attributes"], root["consolidated_metadata"]["metadata"]
    for key, fits in _ATTRIBUTES.items():
        require(fits(attributes[key]), f"attribute {key}")
    joints = _check_identity(loaded(attributes["description"]))
    # What it holds, and the seals of its objects.
    about = nodes["parts"]["attributes"]
    names, objects = about["arrays"], about["objects"]
    require(
        _list_of(names, _is_text) and len(names) <= _MAX_ARRAYS >= len(nodes),
        "its arrays",
    )
    require(len(set(names)) == len(names), "an array twice")
    require(set(names) <= nodes.keys(), "an array that is not described")
    require({"state", "position"} <= set(names), "no state or position")
    require(
        all(type(seal) is int and 0 <= seal < 2**32 for seal in objects.values()),
        "its checksums",
    )
    # Dimensions and sizes of its arrays.
    dims, shape, chunk = _check_state(nodes["state"])
    others = {"xyz": 3, "joint": joints}
    lengths = {**dict(zip(dims, zip(shape, chunk, strict=True), strict=True))}
    lengths |= {name: (n, n) for name, n in others.items()}
    for name, node in nodes.items():
        if name in ("parts", "parts/marks"):
            continue
        own = node["dimension_names"]
        require(_list_of(own, _is_text), f"dimensions of {name}")
        is_part = name in names
        require(is_part or own == [name], f"dimensions of {name}")
        along = [lengths[dim] for dim in own]
        require(is_part or node["shape"][0] <= _MAX_AXIS, f"length of {name}")
        require(node["shape"] == [n for n, _ in along], f"shape of {name}")
        _check_array(name, node, [c if is_part else n for n, c in along])
        if is_part:
            require(own[: len(dims)] == dims[: len(own)], f"dimensions of {name}")
            require(len(own) >= len(dims) - 1, f"dimensions of {name}")
    _check_marks(nodes["parts/marks"], names, prod(map(ceil_of, shape, chunk)))


def ceil_of(whole: int, part: int) -> int:
    """Number of parts of a length."""
    return ceil(whole / part)


def _check_identity(about: Any) -> int:
    """Check the description of the map; return the number of coordinates."""
    require(isinstance(about, dict), "description")
    require(_list_of(about["joints"], _is_text), "joints")
    require(1 <= len(about["joints"]) <= _MAX_JOINTS, "joints")
    require(
        all(isinstance(about[key], dict) for key in ("mechanism", "versions")),
        "description",
    )
    require(isinstance(about["sampling"], dict), "sampling")
    pair = lambda entry: _list_of(entry, _is_text) and len(entry) == 2  # noqa: E731
    require(_list_of(about["files"], pair), "files")
    sampling = about["sampling"]
    for key in ("starts", "branches", "legs"):
        require(type(sampling.get(key, 0)) is int, f"{key} of the sampling")
    return len(about["joints"])


def _check_state(node: Mapping[str, Any]) -> tuple[list[str], list[int], list[int]]:
    """Return dimensions, shape and shape of a part, all within the limits."""
    dims, shape = node["dimension_names"], node["shape"]
    chunk = node["chunk_grid"]["configuration"]["chunk_shape"]
    require(_list_of(dims, _is_text) and len(set(dims)) == len(dims), "dimensions")
    require(1 <= len(dims) <= _MAX_DIMENSIONS, "dimensions")
    for sizes in (shape, chunk):
        require(_list_of(sizes, lambda n: type(n) is int and n > 0), "shape of state")
        require(len(sizes) == len(dims), "shape of state")
    require(all(c <= n for c, n in zip(chunk, shape, strict=True)), "shape of a part")
    require(prod(map(ceil_of, shape, chunk)) <= MAX_PARTS, "too many parts")
    require(prod(chunk) <= MAX_CHUNK, "too many postures in a part")
    flags = node["attributes"]
    values, words = flags["flag_values"], flags["flag_meanings"]
    require(node["data_type"] == "uint8" and _is_text(words), "states")
    require(_list_of(values, lambda n: type(n) is int and 0 <= n < 256), "states")
    require(len(values) == len(words.split()), "states")
    return dims, shape, chunk


def _check_array(name: str, node: Mapping[str, Any], part: list[int]) -> None:
    require(
        node["node_type"] == "array" and node["data_type"] in _BYTES, f"numbers of {name}"
    )
    require(node["chunk_grid"]["name"] == "regular", f"parts of {name}")
    require(
        node["chunk_grid"]["configuration"]["chunk_shape"] == part, f"parts of {name}"
    )
    require(
        prod(part) * _BYTES[node["data_type"]] <= _MAX_PART_BYTES,
        f"size of a part of {name}",
    )
    require(not node.get("storage_transformers"), f"storage of {name}")
    keys = {"name": "default", "configuration": {"separator": "/"}}
    require(node["chunk_key_encoding"] == keys, f"keys of {name}")
    # Codecs, alone or within shards.
    codecs = [codec["name"] for codec in node["codecs"]]
    require(codecs in _CODECS, f"codecs of {name}")
    if codecs == _CODECS[1]:
        inner = node["codecs"][0]["configuration"]
        require(
            [codec["name"] for codec in inner["codecs"]] == _CODECS[0],
            f"codecs of {name}",
        )
        index = [codec["name"] for codec in inner["index_codecs"]]
        require(index == ["bytes", "crc32c"], f"codecs of {name}")
        require(inner.get("index_location", "end") == "end", f"codecs of {name}")
        pieces = inner["chunk_shape"]
        require(_list_of(pieces, lambda n: type(n) is int and n > 0), f"pieces of {name}")
        whole = all(n % p == 0 for n, p in zip(part, pieces, strict=True))
        require(whole and pieces[1:] == part[1:], f"pieces of {name}")
    about = node["attributes"]
    for key in ("units", "long_name", "better"):
        require(_is_text(about.get(key, "")), f"{key} of {name}")


def _check_marks(node: Mapping[str, Any], names: list[str], parts: int) -> None:
    sizes = {"position": 0, "q": 0, "time": 0, "state": 256, "branches": 1}
    columns = 1 + len(names) + sum(sizes.get(name, 4) for name in names)
    require(node["shape"] == [parts, columns], "shape of the marks")
