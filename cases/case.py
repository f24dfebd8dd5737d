"""A case: what a source prints, from which inputs, and what becomes of it."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from cartstiff.core import numerics
from cartstiff.core.errors import InputError, one_line
from cartstiff.core.geometry.se3 import Array
from cartstiff.files.schema import Number, Positive, Text, only_one
from cartstiff.files.yaml_file import read_yaml

#: How close to a stored value its own tool must come, relative to the largest entry.
SAME = numerics.NEGLIGIBLE_DIFFERENCE

Values = Number | list[Number] | list[list[Number]] | list[list[list[Number]]]


class _Entry(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class Source(_Entry):
    """Where the printed numbers stand."""

    work: Text = Field(description="author, title, place and year of publication")
    place: Text = Field(description="table, equation, page, or file")
    link: Text | None = None
    looked_up: Text = Field(
        description="how the numbers were seen: in the work, or where it is quoted"
    )
    licence: Text = Field(description="of the source; here stand numbers only")


class Asked(_Entry):
    """One printed value, with its printed precision, and ours.

    An entry is met if it differs by no more than `tolerance`, or, without one, by half a unit of
    the last printed digit: of `last_digit`, or of `digits` significant digits.
    """

    name: Text
    what: Text = Field(description="the quantity in words, with frame, axes and order")
    unit: Text
    quantity: Literal["stiffness", "compliance", "manipulability"] | None = Field(
        default=None,
        description="for tools that work from `inputs` alone, at `inputs.at`, base axes",
    )
    order: Literal["angular-linear", "linear-angular"] | None = None
    printed: Values
    last_digit: Positive | None = Field(default=None, description="unit of the last digit")
    digits: int | None = Field(default=None, ge=1, le=17, description="significant digits")
    zero: Positive | None = Field(
        default=None, description="what the source prints as rounding noise is below"
    )
    tolerance: Positive | None = None
    ours: Values = Field(description="computed, with all digits that are sure")
    agrees: bool = Field(default=True, description="whether ours meets the printed value")
    because: Text | None = Field(
        default=None, description="why it does not, or why the tolerance is a wider one"
    )

    @model_validator(mode="after")
    def _whole(self) -> Asked:
        only_one(self, "last_digit", "digits")
        if np.shape(self.printed) != np.shape(self.ours):
            raise ValueError("printed and ours have different shapes")
        if (not self.agrees or self.tolerance is not None) and self.because is None:
            raise ValueError("say under `because` why")
        return self

    def tolerances(self) -> Array:
        """How far each entry may be from the printed one."""
        printed = np.array(self.printed, float)
        if self.tolerance is not None:
            return np.full(printed.shape, self.tolerance)
        if self.last_digit is not None:
            allowed = np.full(printed.shape, self.last_digit / 2)
        else:
            size = np.where(printed == 0, 1.0, np.abs(printed))
            allowed = 0.5 * 10.0 ** (np.floor(np.log10(size)) + 1 - (self.digits or 1))
        if self.zero is not None:
            allowed = np.where(printed == 0, self.zero, allowed)
        # A value half-way between two printed ones may be rounded to either.
        return allowed * (1 + SAME)

    def meets(self, value: Any) -> bool:
        """Whether a value is the printed one, to the printed digit."""
        computed = np.asarray(value, float)
        printed = np.array(self.printed, float)
        # Not `> allowed`: what is not a number meets nothing.
        return computed.shape == printed.shape and bool(
            np.all(np.abs(computed - printed) <= self.tolerances())
        )

    def is_ours(self, value: Any) -> bool:
        """Whether a value is the stored one, but for rounding."""
        computed, ours = np.asarray(value, float), np.array(self.ours, float)
        return computed.shape == ours.shape and bool(
            np.all(np.abs(computed - ours) <= SAME * np.max(np.abs(ours), initial=self._least()))
        )

    def _least(self) -> float:
        return self.zero or 0.0


class Case(_Entry):
    """The contents of ``case.yaml``."""

    title: Text
    about: Text = Field(description="what is computed and why it is worth checking")
    source: Source
    inputs: dict[str, Any] = Field(
        description="all numbers that go in, with their units in words",
        json_schema_extra={"additionalProperties": True},  # which older releases leave out
    )
    asked: list[Asked] = Field(max_length=200)
    verdict: Literal[
        "reproduced", "reproduced after a correction", "contradicts itself", "inputs incomplete"
    ]
    reason: Text | None = Field(default=None, description="needed where it is not reproduced")
    answered_as: str | None = Field(
        default=None,
        pattern=r"^[\w-]+$",
        max_length=200,
        description="the case beside this one whose answer.py and derivation.py serve here too",
    )

    @property
    def to_the_digit(self) -> bool:
        """Whether every printed value is met to its last digit, without a wider tolerance."""
        return bool(self.asked) and all(a.agrees and a.tolerance is None for a in self.asked)

    @model_validator(mode="after")
    def _fits(self) -> Case:
        if not self.asked and self.verdict != "inputs incomplete":
            raise ValueError("nothing is asked")
        if not self.asked and not isinstance(self.inputs.get("missing"), str):
            raise ValueError("say under `inputs: missing:` what would be needed")
        differing = [a.name for a in self.asked if not a.agrees]
        if self.verdict == "reproduced" and differing:
            raise ValueError(f"is called reproduced, but not {', '.join(differing)}")
        if self.verdict == "contradicts itself" and not differing:
            raise ValueError("is said to contradict itself, but everything agrees")
        if self.verdict != "reproduced" and self.reason is None:
            raise ValueError("say under `reason` what keeps it from being reproduced")
        names = [a.name for a in self.asked]
        if len(set(names)) != len(names):
            raise ValueError("two asked values have the same name")
        return self


def read_case(folder: Path) -> Case:
    """The case in a folder.

    Raises
    ------
    InputError
        With the file, its line and the key.
    """
    path = folder / "case.yaml"
    data, lines = read_yaml(path)
    try:
        return Case.model_validate(data)
    except ValidationError as error:
        # A key that does not exist explains one that is missing.
        errors = sorted(error.errors(), key=lambda e: e["type"] != "extra_forbidden")
        keys = tuple(k for k in errors[0]["loc"] if not isinstance(k, str) or "[" not in k)
        known = keys
        while known and known not in lines:
            known = known[:-1]
        line = f", line {lines[known]}" if known else ""
        raise InputError(
            "case cannot be used",
            where=f"{one_line(str(path))}{line}",
            expected=errors[0]["msg"],
            got=".".join(map(str, keys)) or None,
        ) from None


def read_cases(folder: Path) -> Iterator[tuple[Path, Case]]:
    """All cases below a folder, by name; a case's own folder is one."""
    if (folder / "case.yaml").is_file():
        yield folder, read_case(folder)
        return
    paths = sorted(folder.glob("*/case.yaml"))
    if not paths:
        raise InputError("no cases", where=one_line(str(folder)), expected="folders with case.yaml")
    for path in paths:
        yield path.parent, read_case(path.parent)


def json_schema() -> str:
    """JSON schema of case.yaml, as text."""
    return json.dumps(Case.model_json_schema(), indent=1, ensure_ascii=False) + "\n"
