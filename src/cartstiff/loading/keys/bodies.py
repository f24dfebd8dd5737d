"""Bodies and the legs that hold them, as a mechanism file describes them."""

from __future__ import annotations

import math
from typing import Annotated

from pydantic import Field, model_validator

from cartstiff.loading.keys.words import (
    RIGID,
    FileModel,
    NotNegative,
    Number,
    Pair,
    PerLeg,
    Positive,
    Vector,
    Vectors,
    only_one,
)


class PayloadModel(FileModel):
    """A point mass carried by the body."""

    mass: NotNegative = Field(description="kg, whatever the units")
    com: Vector = Field(default=[0.0, 0.0, 0.0], description="mass centre in the body frame M")


class BodyModel(FileModel):
    """The platform's own mass, for vibrations and gravity."""

    mass: NotNegative = Field(description="kg, whatever the units")
    com: Vector = Field(default=[0.0, 0.0, 0.0], description="mass centre in P")
    inertia: list[Vector] | None = Field(
        default=None,
        min_length=3,
        max_length=3,
        description="3x3 about the mass centre, axes of P; kg and the file's length squared",
    )


class LegMassModel(FileModel):
    """Two straight bars in each leg; each reaches from its joint to twice its centre's distance."""

    fixed: PerLeg = Field(default=0.0, description="kg, of the bar on the base's joint")
    moving: PerLeg = Field(default=0.0, description="kg, of the bar on the platform's joint")
    fixed_com: PerLeg = Field(
        default=0.0, description="distance of its centre from the base's joint"
    )
    moving_com: PerLeg = Field(
        default=0.0, description="distance of its centre from the platform's joint"
    )
    radius: PerLeg = Field(default=0.0, description="of both bars; 0 for slender ones")


class LegJointsModel(FileModel):
    """Universal or spherical joints at one end of the legs, and how far they turn."""

    axis: Vector | Vectors = Field(
        description="middle direction of the leg seen from the joint, or one per leg; in F "
        "at the base, in P at the platform"
    )
    angle: PerLeg = Field(description="largest angle of the leg from it, rad")


_Lengths = Annotated[list[Positive], Field(min_length=2, max_length=2)]


class FlexureModel(FileModel):
    """A flexure joint of a strut: a spring, or none, for each of its six motions."""

    axial: Annotated[Positive, RIGID] = Field(
        default=math.inf, description="along the strut, force per length; default rigid"
    )
    shear: Annotated[Positive, RIGID] = Field(
        default=math.inf, description="across the strut, force per length; default rigid"
    )
    bending: Annotated[NotNegative, RIGID] = Field(
        description="about axes across it, N m/rad whatever the units"
    )
    torsion: Annotated[NotNegative, RIGID] = Field(
        description="about its axis, N m/rad whatever the units; or rigid"
    )
    offset: NotNegative = Field(
        default=0.0, description="from the leg's point to the flexure, along the strut"
    )


class StrutModel(FileModel):
    """Legs as struts between flexure joints, straight with the platform at the file's pose."""

    axial: Positive | Annotated[list[Positive], Field(min_length=1)] = Field(
        description="stiffness along the strut without its flexures; one number or one per leg"
    )
    lower: FlexureModel = Field(description="at the base")
    upper: FlexureModel = Field(description="at the platform")
    mass: LegMassModel | None = Field(default=None, description="in place of mass in legs")

    @model_validator(mode="after")
    def _stands(self) -> StrutModel:
        if self.lower.torsion == self.upper.torsion == 0.0:
            raise ValueError("the strut would spin: one of its flexures needs torsion above 0")
        if self.lower.bending == math.inf and self.upper.bending == math.inf:
            raise ValueError("one of the flexures must bend: both are rigid")
        return self


class LinesLegs(FileModel):
    """Springs in the legs; one number for all or one per leg."""

    stiffness: Positive | Annotated[list[Positive], Field(min_length=1)] | None = Field(
        default=None, description="of legs between ideal joints, force per length"
    )
    strut: StrutModel | None = Field(
        default=None, description="in place of stiffness: legs with flexure joints"
    )
    rest_length: PerLeg | None = Field(default=None, description="length without tension")
    preload: Number | Annotated[list[Number], Field(min_length=1)] | None = Field(
        default=None, description="tension at the file's pose, instead of rest_length"
    )
    limits: _Lengths | Annotated[list[_Lengths], Field(min_length=1)] | None = Field(
        default=None, description="[shortest, longest], or one pair per leg"
    )
    base_joints: LegJointsModel | None = None
    platform_joints: LegJointsModel | None = None
    diameter: PerLeg | None = Field(
        default=None, description="of the legs, which must not touch each other"
    )
    force: Pair | Annotated[list[Pair], Field(min_length=1)] | None = Field(
        default=None,
        description="[least, largest] tension, or one pair per leg; compression below zero",
    )
    mass: LegMassModel | None = None
    damping: PerLeg = Field(
        default=0.0, description="dampers along the legs, force per velocity (seconds)"
    )

    @model_validator(mode="after")
    def _one(self) -> LinesLegs:
        if self.stiffness is None and self.strut is None:
            raise ValueError("key 'stiffness' is missing: give stiffness, or strut")
        only_one(self, "stiffness", "strut")
        only_one(self, "rest_length", "preload", needed=False)
        if self.strut is not None and None not in (self.strut.mass, self.mass):
            raise ValueError("give mass in legs or in strut, not both")
        return self
