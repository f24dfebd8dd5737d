"""Springs in joints, links and lines, as a mechanism file describes them."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, PrivateAttr, ValidationInfo, model_validator

from cartstiff.errors import InputError, one_line
from cartstiff.geometry import se3
from cartstiff.geometry.se3 import Array
from cartstiff.loading.keys.words import (
    RIGID,
    FileModel,
    FileName,
    Flag,
    NotNegative,
    Number,
    Pair,
    PoseModel,
    Positive,
    Text,
    Vector,
    Vectors,
    only_one,
    pose_of,
)
from cartstiff.loading.yaml_file import read_text
from cartstiff.mechanisms.superelement import (
    SuperelementMass,
    superelement_mass,
    superelement_spring,
)

#: Bytes of a superelement's text: two hundred nodes with all digits.
_LARGEST_MATRIX = 64 * 1024 * 1024


class JointSpringModel(FileModel):
    """A spring in a joint: one of stiffness, polynomial, table."""

    stiffness: Annotated[
        NotNegative | None,
        RIGID,
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


class SuperelementModel(FileModel):
    """A link's stiffness matrix from a finite-element program, reduced to a few nodes."""

    K: FileName = Field(
        description="text file, relative to this one: 6 N rows of 6 N numbers, forces per "
        "displacement of the free body"
    )
    M: FileName | None = Field(
        default=None,
        description="text file: mass matrix in the same rows, kg; Guyan's reduction to base and "
        "tip makes it one body that follows a share of the deflection. The link's inertia in the "
        "robot's file stays at the near end besides",
    )
    nodes: Vectors = Field(description="the N nodes, in the link's frame (moved by `offset`)")
    base: int = Field(
        default=0,
        strict=True,
        description="index, from 0, of the node that is fixed to the link's near side",
    )
    tip: int = Field(
        default=-1,
        strict=True,
        description="index of the node that carries what is beyond; -1 is the last",
    )
    order: Literal["linear-angular", "angular-linear"] = Field(
        default="linear-angular", description="of each node's six rows"
    )

    def in_place(self, folder: Path) -> tuple[Array, SuperelementMass | None, list[float]]:
        """The 6x6 spring at the tip, the other nodes left free, its mass, and where it stands."""
        ends = {"nodes": self.nodes, "base": self.base, "tip": self.tip, "order": self.order}
        K = _matrix(folder / Path(self.K).expanduser())
        mass = None
        if self.M is not None:
            mass = superelement_mass(_matrix(folder / Path(self.M).expanduser()), K, **ends)  # type: ignore[arg-type]
        return superelement_spring(K, **ends), mass, self.nodes[self.tip]  # type: ignore[arg-type]


def _matrix(path: Path) -> Array:
    """Rows of numbers of a text file."""
    text = read_text(path, _LARGEST_MATRIX)
    try:
        return np.loadtxt(text.replace(",", " ").replace(";", " ").splitlines(), ndmin=2)
    except ValueError:
        raise InputError(
            "is no matrix of numbers",
            where=one_line(str(path)),
            expected="rows of numbers between blanks or commas",
        ) from None


class FlexibleModel(FileModel):
    """A link that gives: a 6x6 spring (order angular-linear), a beam, or a superelement."""

    stiffness: list[Annotated[list[Number], Field(min_length=6, max_length=6)]] | None = Field(
        default=None, min_length=6, max_length=6, description="6x6, in the file's units"
    )
    beam: BeamModel | None = None
    superelement: SuperelementModel | None = None
    offset: PoseModel = Field(
        default=PoseModel(), description="place of the spring in the link's frame"
    )
    _mass: SuperelementMass | None = PrivateAttr(default=None)

    @model_validator(mode="after")
    def _one(self, info: ValidationInfo) -> FlexibleModel:
        only_one(self, "stiffness", "beam", "superelement")
        return self.as_spring((info.context or {}).get("folder", Path()))

    def as_spring(self, folder: Path) -> FlexibleModel:
        """The same with the 6x6 spring of its superelement, if it has one."""
        if self.superelement is None:
            return self
        K, mass, tip = self.superelement.in_place(folder)
        at = pose_of(self.offset) @ se3.pose(translation=tip)
        offset = PoseModel(xyz=at[:3, 3].tolist(), rpy=self.offset.rpy)
        spring = self.model_copy(
            update={"stiffness": K.tolist(), "superelement": None, "offset": offset}
        )
        spring._mass = mass
        return spring

    @property
    def mass(self) -> SuperelementMass | None:
        """Of a superelement with a mass matrix."""
        return self._mass


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
