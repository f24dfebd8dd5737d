"""The entry of a mechanism file that describes legs by name."""

from __future__ import annotations

import math
import re
from typing import Annotated, Literal

from pydantic import Field, WrapValidator, model_validator

from cartstiff.loading.keys.words import FileModel, Number, Pair, Positive, Text, Vector, only_one

Stiffness = Annotated[
    Positive, WrapValidator(lambda value, check: math.inf if value == "rigid" else check(value))
]
_Word = Literal["radial", "tangential", "vertical"]
Direction = _Word | Vector | Annotated[list[Vector], Field(min_length=1, max_length=100)]
_PerLeg = Positive | Annotated[list[Positive], Field(min_length=1, max_length=100)]
_Mode = Literal["plus", "minus"]

#: What can be drawn: struts, then rails and cranks; a rod between two balls spins in vain.
_KNOWN = re.compile(r"[URS]P[URS]?|[UR]C[UR]|[PR][URS][URS]")
KNOWN = (
    "a strut such as UPS, RPS, SPS, UPU, UCU, UP; a rail such as PUS, PRS, PUU; a crank such "
    "as RUS, RUU, RSS, RRR"
)


class LegEndsModel(FileModel):
    """Joints on a circle about z, or points one by one."""

    radius: Positive | None = None
    half_angle: Number | None = Field(
        default=None,
        description="rad, between a joint and the middle of its pair; three pairs, and the two "
        "legs of a pair of the base are mirror images of each other",
    )
    angles: list[Number] | None = Field(
        default=None,
        min_length=1,
        max_length=100,
        description="where the joints are on the circle; default [0]",
    )
    height: Number = Field(default=0.0, description="of the circle, along z")
    points: list[Vector] | None = Field(
        default=None, min_length=1, max_length=100, description="instead of the circle"
    )

    @model_validator(mode="after")
    def _one(self) -> LegEndsModel:
        only_one(self, "radius", "points")
        on_circle = self.half_angle is not None or self.angles is not None or self.height != 0.0
        if self.points is not None and on_circle:
            raise ValueError("half_angle, angles and height go with radius, not with points")
        only_one(self, "half_angle", "angles", needed=False)
        return self


class NamedLegsModel(FileModel):
    """Equal legs from the ground to the body, by the letters of their joints."""

    chain: Text = Field(
        description="joints from the ground to the body: R revolute, P prismatic, U universal, "
        "S spherical, C cylindrical; such as UPS, PUS, RUS, RPS, PRS, UPU, RUU, RRR"
    )
    base: LegEndsModel = Field(description="first joints, in F")
    platform: LegEndsModel = Field(description="last joints, in the body's frame P")
    symmetry: int | None = Field(
        default=None,
        strict=True,
        ge=1,
        le=100,
        description="how often what base and platform give is repeated about z; default 3, and "
        "1 where points or angles are given",
    )
    turn: Number | None = Field(
        default=None, description="rad, of the platform's pairs against the base's; default pi/3"
    )
    axis: Direction | None = Field(
        default=None,
        description="of cranks, hinges and first axes of universal joints: radial, tangential, "
        "vertical, a vector in the leg's frame (x radial, z up), or one vector in F for each "
        "leg; default vertical for chains of R and P only, else tangential",
    )
    rail: Direction | None = Field(
        default=None,
        description="direction of the rails of chains that begin with P, as axis; default vertical",
    )
    crank: _PerLeg | None = Field(default=None, description="length, for chains that begin with R")
    rod: _PerLeg | None = Field(
        default=None, description="length, for chains that begin with P or R"
    )
    mode: _Mode | list[_Mode] | None = Field(
        default=None,
        description="working mode: the smaller (minus) or the larger (plus) of the two slides, or "
        "crank angles between -pi and pi, that reach the file's pose; default the smaller slide, "
        "and the crank that points outwards the more",
    )
    actuated: list[Text] | None = Field(
        default=None, description="names of the driven joints; default slide, or crank; [] for none"
    )
    stiffness: Stiffness | list[Stiffness] | None = Field(
        default=None, description="of the driven joints, N/m or N m/rad; or rigid"
    )
    limits: Pair | list[Pair] | None = Field(
        default=None, description="[least, most] of the slide or crank"
    )
    diameter: _PerLeg | None = Field(
        default=None, description="of the rods, or struts, which must not touch each other"
    )
    turns: dict[Text, Pair] = Field(
        default={},
        description="[least, most] rad of other joints by name (u1, s2, ...), zero at home; "
        "a ball is limited about each of its three axes",
    )

    @model_validator(mode="before")
    @classmethod
    def _no_strut(cls, value: object) -> object:
        if isinstance(value, dict) and "strut" in value:
            raise ValueError(
                "strut is of kind stewart-gough, whose legs have no joints with names; here joints "
                "have springs: {u1: {stiffness: 33}, ...}, and links may be flexible"
            )
        return value

    @model_validator(mode="after")
    def _fits(self) -> NamedLegsModel:
        if not _KNOWN.fullmatch(self.chain):
            raise ValueError(f"unknown chain {self.chain!r} (expected {KNOWN})")
        strut = self.chain[1] in "PC"
        if self.turn is not None and self.platform.half_angle is None:
            raise ValueError("turn is of the platform's pairs: give its half_angle, or angles")
        for key, wanted in (
            ("rail", self.chain[0] == "P"),
            ("rod", not strut),
            ("crank", self.chain[0] == "R" and not strut),
            ("mode", not strut),
        ):
            if not wanted and getattr(self, key) is not None:
                raise ValueError(f"a leg {self.chain} has no {key}")
        for key in ("rod", "crank"):
            wanted = not strut and (key == "rod" or self.chain[0] == "R")
            if wanted and getattr(self, key) is None:
                raise ValueError(f"a leg {self.chain} needs {key}: its length")
        if self.actuated == [] and self.stiffness is not None:
            raise ValueError("stiffness is of driven joints, and actuated is empty")
        return self
