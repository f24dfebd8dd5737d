"""Springs in joints, links and lines, as a mechanism file describes them."""

from __future__ import annotations

import math
from typing import Annotated

from pydantic import Field, WrapValidator, model_validator

from cartstiff.loading.keys.words import (
    FileModel,
    Flag,
    NotNegative,
    Number,
    Pair,
    PoseModel,
    Positive,
    Text,
    Vector,
    only_one,
)

__all__ = ["BeamModel", "FlexibleModel", "JointSpringModel", "LineModel"]

_RIGID = ("rigid", math.inf)


class JointSpringModel(FileModel):
    """A spring in a joint: one of stiffness, polynomial, table."""

    stiffness: Annotated[
        NotNegative | None,
        WrapValidator(lambda value, check: math.inf if value in _RIGID else check(value)),
    ] = Field(default=None, description="N m/rad, N/m for a prismatic joint; or rigid")
    polynomial: list[Number] | None = Field(
        default=None, min_length=1, max_length=20, description="torque c1 x + c2 x^2 + ..."
    )
    table: list[Pair] | None = Field(
        default=None, min_length=2, description="pairs [deflection, torque], deflections increasing"
    )
    rest: Number | None = Field(
        default=None, description="rest position; without it the spring balances the load at q"
    )
    damping: NotNegative | None = Field(
        default=None,
        description="damper beside the spring, N m s/rad or N s/m; default what the robot's "
        "file has",
    )

    @model_validator(mode="after")
    def _one_law(self) -> JointSpringModel:
        only_one(self, "stiffness", "polynomial", "table")
        if self.stiffness == math.inf and self.rest is not None:
            raise ValueError("a rigid joint has no rest position: it stays where it is")
        return self


class BeamModel(FileModel):
    """A straight beam along the link's x axis, from clamp to clamp; it feels its axial force."""

    E: Positive = Field(description="Young's modulus")
    G: Positive = Field(description="shear modulus")
    length: Positive
    area: Positive = Field(description="cross-section area")
    Iy: Positive = Field(description="second moment of area about y")
    Iz: Positive = Field(description="second moment of area about z")
    J: Positive = Field(description="torsion constant")
    segments: int = Field(
        default=1,
        strict=True,
        ge=1,
        le=1000,
        description="equal parts with six coordinates each: more for large deflections",
    )
    shear_area_y: Positive | None = Field(
        default=None, description="area times shear factor, along y; rigid if absent"
    )
    shear_area_z: Positive | None = Field(default=None, description="the same along z")
    density: NotNegative = Field(
        default=0.0,
        description="kg per volume: the beam's own mass, lumped as rigid half segments at its "
        "nodes; the link's inertia in the robot's file stays at the near end besides",
    )


class FlexibleModel(FileModel):
    """A link that gives: a 6x6 spring (order angular-linear) or a beam, at the link's frame."""

    stiffness: list[Annotated[list[Number], Field(min_length=6, max_length=6)]] | None = Field(
        default=None, min_length=6, max_length=6
    )
    beam: BeamModel | None = None
    offset: PoseModel = Field(
        default=PoseModel(), description="place of the spring in the link's frame"
    )

    @model_validator(mode="after")
    def _one(self) -> FlexibleModel:
        only_one(self, "stiffness", "beam")
        return self


class LineModel(FileModel):
    """A line spring or cable between points of two frames ("world" is F)."""

    frames: list[Text] = Field(min_length=2, max_length=2)
    points: list[Vector] = Field(min_length=2, max_length=2)
    stiffness: Positive
    rest_length: NotNegative | None = None
    preload: Number | None = Field(default=None, description="tension at q")
    unilateral: Flag = False

    @model_validator(mode="after")
    def _one(self) -> LineModel:
        only_one(self, "rest_length", "preload", needed=False)
        return self
