"""What numbers and texts of a mechanism file may be, and what all its data classes share."""

from __future__ import annotations

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

from cartstiff.loading.yaml_file import LARGEST_NUMBER

__all__ = ["FileModel", "NotNegative", "Number", "Positive", "Text", "Vector"]

_MOST = LARGEST_NUMBER
Number = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=-_MOST, le=_MOST)]
Positive = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=1 / _MOST, le=_MOST)]
NotNegative = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=0, le=_MOST)]
Text = Annotated[str, Field(strict=True, min_length=1, max_length=4000)]
Vector = Annotated[list[Number], Field(min_length=3, max_length=3)]


class FileModel(BaseModel):
    """What stands in a mechanism file: no other keys, and nothing changes it."""

    # Built when it is first used: a file uses few of them.
    model_config = ConfigDict(extra="forbid", frozen=True, defer_build=True)
