"""Types of the numbers and texts in a mechanism file, and the base of its data classes."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, PlainValidator, WithJsonSchema, WrapValidator
from pydantic_core import PydanticCustomError

from cartstiff.geometry import se3
from cartstiff.geometry.se3 import Array
from cartstiff.loading.yaml_file import LARGEST_NUMBER

_MOST = LARGEST_NUMBER
Number = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=-_MOST, le=_MOST)]
Positive = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=1 / _MOST, le=_MOST)]
NotNegative = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=0, le=_MOST)]
Text = Annotated[str, Field(strict=True, min_length=1, max_length=4000)]
Vector = Annotated[list[Number], Field(min_length=3, max_length=3)]


#: A number, or the word for an infinite one.
RIGID = WrapValidator(
    lambda value, check: math.inf if value in ("rigid", math.inf) else check(value)
)


class FileModel(BaseModel):
    """A mapping in a mechanism file: no other keys, and immutable."""

    # Built when it is first used: a file uses few of them.
    model_config = ConfigDict(extra="forbid", frozen=True, defer_build=True)


def _file_name(name: Any) -> str:
    # Not pydantic's own text: names of files may be long, and hold bytes that are no text.
    if not isinstance(name, str) or not name:
        raise PydanticCustomError("string_type", "text")
    try:
        Path(name).expanduser()
    except RuntimeError:
        raise PydanticCustomError("value_error", "the home directory is not known") from None
    return name


FileName = Annotated[str, PlainValidator(_file_name), WithJsonSchema({"type": "string"})]


def _argument(value: Any) -> str:
    # YAML reads true as a truth value, and numbers as numbers; xacro takes text.
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, (str, int, float)) and len(str(value)) <= 4000:
        return str(value)
    raise PydanticCustomError("string_type", "text")


Argument = Annotated[
    str,
    PlainValidator(_argument),
    WithJsonSchema({"type": ["string", "number", "boolean"]}),
]

Flag = Annotated[bool, Field(strict=True)]

Pair = Annotated[list[Number], Field(min_length=2, max_length=2)]
PerLeg = NotNegative | Annotated[list[NotNegative], Field(min_length=1)]
Vectors = Annotated[list[Vector], Field(min_length=1, max_length=100_000)]


class PoseModel(FileModel):
    """A pose by translation and roll, pitch, yaw about fixed axes (radians)."""

    xyz: Vector = [0.0, 0.0, 0.0]
    rpy: Vector = [0.0, 0.0, 0.0]


def pose_of(entry: PoseModel) -> Array:
    """4x4 pose of an entry."""
    if not any(entry.xyz) and not any(entry.rpy):
        return np.eye(4)
    return se3.from_roll_pitch_yaw(entry.xyz, entry.rpy)


class UnitsModel(FileModel):
    """Units of lengths and forces; angles are rad, masses kg, gravity m/s^2 in every file."""

    length: Literal["m", "dm", "cm", "mm", "um", "in", "ft"] = "m"
    force: Literal["N", "kN", "mN", "daN", "lbf", "kgf"] = "N"


def only_one(model: BaseModel, *keys: str, needed: bool = True) -> None:
    """Refuse a model that gives more than one of the keys, or none where one is needed."""
    count = sum(getattr(model, key) is not None for key in keys)
    if needed and count != 1:
        raise ValueError(f"give exactly one of {', '.join(keys)}")
    if count > 1:
        raise ValueError(f"give {' or '.join(keys)}, not both")
