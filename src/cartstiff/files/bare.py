"""Robots without a mechanism file, and with one of few keys; what replaces a file's keys.

The models of files (`schema`) need Pydantic, whose import and classes take as long as all
the rest of a short command. What is here serves every robot, and needs neither.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np

from cartstiff.core.arrays import Array
from cartstiff.core.choices import LARGEST_INPUT
from cartstiff.core.errors import InputError, check_name, one_line
from cartstiff.core.geometry import se3
from cartstiff.files.yaml_file import Lines, Way


class Placement(NamedTuple):
    """A pose by translation and roll, pitch, yaw, as an entry of a file has it."""

    xyz: list[float]
    rpy: list[float]


_NOWHERE = Placement([0.0] * 3, [0.0] * 3)
# Keys of a serial arm's file by their defaults.
_DEFAULTS: dict[str, Any] = {
    "actuator_springs": False,
    **dict.fromkeys(("base", "offset"), _NOWHERE),
    **dict.fromkeys(("coupled_springs", "lines", "package_path", "passive"), ()),
    **{key: {} for key in ("effort", "flexible", "locked", "parameters")},
    **{key: {} for key in ("q", "springs", "xacro", "zeros")},
    **dict.fromkeys(("description", "dh", "frame", "gravity"), None),
    **dict.fromkeys(("identified", "model", "name", "payload", "source"), None),
}


class Bare(SimpleNamespace):
    """The mechanism file of a serial arm that gives nothing but these keys.

    It is read as `schema.SerialFile` is, whose defaults it has; nothing is checked.
    """

    kind = "serial"
    model_fields = _DEFAULTS
    named_folders: tuple[str, ...] = ()

    def __init__(self, **given: Any) -> None:
        super().__init__(**_DEFAULTS | given)
        self.model_fields_set = {*given}

    def model_copy(self, *, update: Mapping[str, Any]) -> Bare:
        """Give more keys."""
        own = {key: getattr(self, key) for key in self.model_fields_set}
        copy = Bare(**own | dict(update))
        copy.named_folders = self.named_folders
        return copy

    def with_ros(self, arguments: Mapping[str, str], folders: Sequence[str]) -> Bare:
        """Add xacro arguments and package folders that come from the user."""
        keys = {"xacro": dict(arguments), "package_path": [*folders]}
        robot = self.model_copy(update=keys)
        robot.named_folders = tuple(folders)
        return robot


class _NeedsModelError(Exception):
    """Only a model of the schema reads this value, or refuses it."""


def _text(value: Any) -> str:
    is_text = isinstance(value, str) and 0 < len(value) <= 4000
    if not is_text or value.startswith("~"):
        raise _NeedsModelError
    return str(value)


def _number(value: Any) -> float:
    if type(value) not in (int, float) or not abs(value) <= LARGEST_INPUT:
        raise _NeedsModelError
    return float(value)


def _vector(value: Any) -> list[float]:
    if type(value) is not list or len(value) != 3:
        raise _NeedsModelError
    return [_number(x) for x in value]


def _by_name(value: Any, read: Callable[[Any], Any]) -> dict[str, Any]:
    if type(value) is not dict or not all(isinstance(name, str) for name in value):
        raise _NeedsModelError
    return {name: read(x) for name, x in value.items()}


def _spring(value: Any) -> SimpleNamespace:
    entry = _by_name(value, _number)
    is_linear = {"stiffness"} <= entry.keys() <= {"stiffness", "rest"}
    if not is_linear or entry["stiffness"] < 0.0:
        raise _NeedsModelError
    others = dict.fromkeys(("damping", "points", "polynomial", "rest", "table"))
    return SimpleNamespace(**others | entry)


# Keys of a file that needs no model, and what reads them.
_SHORT: dict[str, Callable[[Any], Any]] = {
    **dict.fromkeys(("description", "frame", "kind", "model", "name", "source"), _text),
    "gravity": _vector,
    "q": lambda value: _by_name(value, _number),
    "springs": lambda value: _by_name(value, _spring),
}


def short_file(data: Mapping[str, Any]) -> Bare | None:
    """A serial arm's file of texts, numbers and linear springs; None for any other, and
    where a value cannot be used.

    `schema.SerialFile` accepts all that is accepted here, and reads it alike.
    """
    if data.get("kind") != "serial" or not {"model"} <= data.keys() <= _SHORT.keys():
        return None
    try:
        return Bare(**{key: _SHORT[key](value) for key, value in data.items()})
    except _NeedsModelError:
        return None


def pose_of(entry: Any) -> Array:
    """Return the 4x4 pose of an entry with its translation and angles."""
    if not any(entry.xyz) and not any(entry.rpy):
        return np.eye(4)
    return se3.from_roll_pitch_yaw(entry.xyz, entry.rpy)


def both_ways(effort: float | list[float]) -> tuple[float, float]:
    """Least and largest torque of an entry."""
    low, high = effort if isinstance(effort, list) else (-effort, effort)
    return low, high


def place_of(path: Path | str, lines: Lines, at: Way) -> str:
    """File, line and key of a value, for messages."""
    known = at
    while known and known not in lines:
        known = known[:-1]
    line = (
        f", line {lines.get(known, 1)}" if lines else ""
    )  # data from Python have no lines
    key = ".".join(str(part + 1) if isinstance(part, int) else part for part in at)
    return f"{one_line(str(path))}{line}" + (f", key {one_line(key)}" if key else "")


def way_of(key: str | None) -> Way:
    """Keys and indices of a dotted key, which counts from 1."""
    parts = (key or "").split(".")
    return tuple(int(part) - 1 if part.isdigit() else part for part in parts if part)


@contextmanager
def places_in(where: str, place: Callable[[Way], str] | None = None) -> Iterator[None]:
    """Add the file, and the key's line, to errors within that name a key, or nothing."""
    try:
        yield
    except InputError as error:
        own = error.where or ""
        is_key = own.startswith("key ")
        if where in own and own:
            raise
        if own and not is_key:
            raise error.at(where) from None
        if is_key and place:
            raise error.moved_to(place(way_of(own.removeprefix("key ")))) from None
        raise error.moved_to(f"{where}, {own}" if own else where) from None


def with_overrides(file: Any, overrides: Mapping[str, Any]) -> Any:
    """Return the file with overrides, which replace its own values.

    Parameters
    ----------
    file : a model of the schema
        The mechanism file.
    overrides : mapping
        Any of "frame", "locked", "tcp" (pose of M in that frame), "gravity",
        "actuator_springs", "xacro", "package_path". The file's payload stays where it is.

    Raises
    ------
    InputError
        For what the file's kind does not have.
    """
    get: Callable[[str], Any] = overrides.get
    keys: dict[str, Any] = {}
    if get("frame") is not None:
        file = _with_frame(file, get("frame"))
    if locked := get("locked"):
        if file.kind not in ("serial", "closed-chain"):
            raise InputError(
                f"kind {file.kind} has no joints to lock",
                expected="kind serial or closed-chain",
            )
        keys["locked"] = {**file.locked, **locked}
    if any(map(get, ("xacro", "package_path"))):
        file = _with_ros(file, overrides)
    if get("actuator_springs"):
        if not hasattr(file, "actuator_springs"):
            raise InputError(f"kind {file.kind} has no actuators", where="--springs")
        keys["actuator_springs"] = True
    if get("gravity") is not None:
        keys["gravity"] = list(get("gravity"))
    if get("tcp") is not None:
        keys |= _moved(file, get("tcp"))
    return file.model_copy(update=keys) if keys else file


def _moved(file: Any, T: Array) -> dict[str, Any]:
    """Keys of a file whose M is moved by T; its payload stays where it is."""
    key, payload = "offset", file.payload
    if file.kind in ("stewart-gough", "springs"):
        key = "frame"
    keys = {key: _model_of(pose_of(getattr(file, key)) @ T)}
    if payload is not None and payload.carrier is None:
        centre = (se3.inverse(T) @ [*payload.com, 1.0])[:3].tolist()
        keys["payload"] = payload.model_copy(update={"com": centre})
    return keys


def _model_of(T: Array) -> Placement:
    xyz, rpy = T[:3, 3].tolist(), se3.roll_pitch_yaw(T).tolist()
    return Placement(xyz, rpy)


def _with_ros(file: Any, overrides: Mapping[str, Any]) -> Any:
    """Return the file with more xacro arguments and package folders for its robots."""
    if hasattr(file, "model"):
        return file.with_ros(
            overrides.get("xacro", {}), overrides.get("package_path", ())
        )
    if isinstance(file.legs, list) and any(leg.drawing is None for leg in file.legs):
        legs = [
            _with_ros(leg, overrides) if leg.drawing is None else leg for leg in file.legs
        ]
        return file.model_copy(update={"legs": legs})
    raise InputError(
        f"kind {file.kind} has no robot description",
        expected="no xacro arguments and no package path",
    )


def _with_frame(file: Any, frame: str) -> Any:
    """Return the file with another frame of interest."""
    only = {"stewart-gough": "platform", "springs": "platform", "parallel": "body"}.get(
        file.kind
    )
    if only is not None:
        check_name("frame", frame, [only])
        return file
    payload = file.payload and file.payload.carried_by(file.frame, file.offset)
    other = {"frame": frame, "offset": _model_of(np.eye(4)), "payload": payload}
    return file.model_copy(update=other)
