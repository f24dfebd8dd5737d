"""Files that were checked before: the values of their models alone, without pydantic.

Reading a file takes longer than all that follows for an arm. The bundled files are therefore kept
checked in ``robots/checked.json``, which ``tools/checked_files.py`` writes; a file that differs
from what was checked is read as any other.
"""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from typing import Any
from zlib import crc32

import numpy as np

from cartstiff.geometry import se3
from cartstiff.geometry.se3 import Array
from cartstiff.loading.catalogue import bundled_folder

#: Name of that file in the folder of the bundled mechanisms.
CHECKED = "checked.json"
_FORM, _GIVEN = "=", "?"


class Checked:
    """What a model of the schema holds, by its keys.

    Parameters
    ----------
    form : str
        Name of the model.
    given : collection of str
        Keys that the file has.
    **values
        All keys.
    """

    __slots__ = ("__dict__", "form", "model_fields_set")

    def __init__(self, form: str, given: Any = (), /, **values: Any) -> None:
        self.form, self.model_fields_set = form, frozenset(given)
        vars(self).update(values)

    def model_copy(self, *, update: dict[str, Any]) -> Checked:
        """The same with other values, as of pydantic's models."""
        return Checked(self.form, self.model_fields_set | set(update), **(vars(self) | update))


def form_of(value: Any) -> str:
    """Name of the model that a value is of, checked now or before; of other values their type."""
    return str(value.form) if isinstance(value, Checked) else type(value).__name__


def pose_of(entry: Any) -> Array:
    """4x4 pose of a {xyz, rpy} entry."""
    if not any(entry.xyz) and not any(entry.rpy):
        return np.eye(4)
    return se3.from_roll_pitch_yaw(entry.xyz, entry.rpy)


def packed(value: Any) -> Any:
    """A model as JSON has it, for `Checked`."""
    if hasattr(value, "model_fields_set"):
        inner = {key: packed(entry) for key, entry in vars(value).items()}
        return {_FORM: form_of(value), _GIVEN: sorted(value.model_fields_set), **inner}
    if isinstance(value, dict):
        return {key: packed(entry) for key, entry in value.items()}
    return [packed(entry) for entry in value] if isinstance(value, (list, tuple)) else value


def _unpacked(value: Any) -> Any:
    """What was packed, a new object each time."""
    if isinstance(value, list):
        return [_unpacked(entry) for entry in value]
    if not isinstance(value, dict):
        return value
    inner = {key: _unpacked(entry) for key, entry in value.items()}
    form = inner.pop(_FORM, None)
    return inner if form is None else Checked(form, inner.pop(_GIVEN), **inner)


@cache
def _kept() -> dict[str, Any]:
    try:
        text = (bundled_folder() / CHECKED).read_text(encoding="utf-8")
        kept: dict[str, Any] = json.loads(text)
    except (OSError, ValueError):
        return {}
    return kept


def checked_before(path: Path) -> tuple[Any, dict[str, float]] | None:
    """A bundled file as it was checked, with its parameters; None if it is not kept, or changed."""
    kept = _kept().get(path.stem) if path.parent == bundled_folder() else None
    if kept is None or kept["crc"] != crc32(path.read_bytes()):
        return None
    return _unpacked(kept["file"]), dict(kept["parameters"])


def robot_alone(model: str) -> Any:
    """What a serial file says that names nothing but its robot; None without the kept file."""
    kept = _kept().get("")
    return None if kept is None else _unpacked(kept["file"]).model_copy(update={"model": model})
