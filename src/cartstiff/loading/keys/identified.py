"""How well stiffnesses are known, as a mechanism file tells it."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from cartstiff.loading.keys.words import FileModel, Number, Positive, Text


class FoundModel(FileModel):
    """A compliance that was measured: of one spring, of springs that are equal, or of a link."""

    name: Text
    value: Number = Field(description="compliance; of a beam a share of the file's own")
    elements: list[tuple[Text, Text, Number]] | None = Field(
        default=None, description="pairs of springs and factors, where it is not one spring's own"
    )
    polynomial: tuple[Text, Annotated[int, Field(strict=True, ge=1, le=100)]] | None = Field(
        default=None,
        description="joint and power of a polynomial spring: of the first power the "
        "value is a compliance, of others the coefficient",
    )


class IdentifiedModel(FileModel):
    """How well the stiffnesses are known; written by `cartstiff identify -o`."""

    compliances: list[FoundModel] = Field(max_length=1000)
    covariance: list[list[Number]] = Field(description="of the compliances, in the file's units")
    degrees: Positive | None = Field(
        default=None, description="of freedom of Student's t; normal if absent"
    )
    level: float = Field(default=0.95, gt=0.0, lt=1.0, description="of intervals that are told")
    rows: int = Field(default=0, strict=True, ge=0, description="measurements, for readers")
    date: Text | None = Field(default=None, description="of the measurement, for readers")
    source: Text | None = Field(default=None, description="what was measured, for readers")
    undetermined: list[Text] = Field(
        default=[], description="springs of which the measurements say nothing"
    )
    at_least: dict[str, Positive] = Field(
        default={}, description="springs without an upper end, and the lower one"
    )
