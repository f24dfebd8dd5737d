"""The mechanism file as data classes; every key, its type and its meaning stand here once."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import (
    ConfigDict,
    Field,
    PlainValidator,
    PrivateAttr,
    TypeAdapter,
    WithJsonSchema,
    WrapValidator,
    model_validator,
)
from pydantic_core import PydanticCustomError

from cartstiff.geometry import se3
from cartstiff.geometry.se3 import Array
from cartstiff.loading.legs.model import NamedLegsModel
from cartstiff.loading.shorthand.layout import LayoutModel
from cartstiff.loading.shorthand.words import (
    FileModel,
    NotNegative,
    Number,
    Positive,
    Text,
    Vector,
)

__all__ = [
    "BeamModel",
    "BodyModel",
    "ClosedChainFile",
    "ClosureModel",
    "FlexibleModel",
    "FoundModel",
    "IdentifiedModel",
    "JointSpringModel",
    "LegJointsModel",
    "LegMassModel",
    "LegModel",
    "LineModel",
    "MechanismFile",
    "NamedLegs",
    "ParallelFile",
    "PayloadModel",
    "PlatformFile",
    "PoseModel",
    "SerialFile",
    "SpringsFile",
    "UnitsModel",
    "json_schema",
    "pose_of",
]


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
    # What xacro calls true stands in YAML as a truth value, and numbers as numbers.
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
Vectors = Annotated[list[Vector], Field(min_length=1, max_length=100_000)]


class PoseModel(FileModel):
    """A pose by translation and roll, pitch, yaw about fixed axes (radians)."""

    xyz: Vector = [0.0, 0.0, 0.0]
    rpy: Vector = [0.0, 0.0, 0.0]


class UnitsModel(FileModel):
    """Units of lengths and forces; angles are rad, masses kg, gravity m/s^2 in every file."""

    length: Literal["m", "dm", "cm", "mm", "um", "in", "ft"] = "m"
    force: Literal["N", "kN", "mN", "daN", "lbf", "kgf"] = "N"


class PayloadModel(FileModel):
    """A point mass carried by the body."""

    mass: Annotated[NotNegative, Field(description="kg, whatever the units")]
    com: Annotated[Vector, Field(description="mass centre in the body frame M")] = [0.0, 0.0, 0.0]


class BodyModel(FileModel):
    """The platform's own mass, for vibrations and gravity."""

    mass: Annotated[NotNegative, Field(description="kg, whatever the units")]
    com: Annotated[Vector, Field(description="mass centre in P")] = [0.0, 0.0, 0.0]
    inertia: Annotated[
        list[Vector] | None,
        Field(
            min_length=3, max_length=3,
            description="3x3 about the mass centre, axes of P; kg and the file's length squared",
        ),
    ] = None  # fmt: skip


_PerLeg = NotNegative | Annotated[list[NotNegative], Field(min_length=1)]


class LegMassModel(FileModel):
    """Two straight bars in each leg; each reaches from its joint to twice its centre's distance."""

    fixed: Annotated[_PerLeg, Field(description="kg, of the bar on the base's joint")] = 0.0
    moving: Annotated[_PerLeg, Field(description="kg, of the bar on the platform's joint")] = 0.0
    fixed_com: Annotated[
        _PerLeg, Field(description="distance of its centre from the base's joint")
    ] = 0.0
    moving_com: Annotated[
        _PerLeg, Field(description="distance of its centre from the platform's joint")
    ] = 0.0
    radius: Annotated[_PerLeg, Field(description="of both bars; 0 for slender ones")] = 0.0


_RIGID = ("rigid", math.inf)


class JointSpringModel(FileModel):
    """A spring in a joint: one of stiffness, polynomial, table."""

    stiffness: Annotated[
        NotNegative | None,
        WrapValidator(lambda value, check: math.inf if value in _RIGID else check(value)),
        Field(description="N m/rad, N/m for a prismatic joint; or rigid"),
    ] = None
    polynomial: Annotated[
        list[Number] | None,
        Field(min_length=1, max_length=20, description="torque c1 x + c2 x^2 + ..."),
    ] = None
    table: Annotated[
        list[Annotated[list[Number], Field(min_length=2, max_length=2)]] | None,
        Field(min_length=2, description="pairs [deflection, torque], deflections increasing"),
    ] = None
    rest: Annotated[
        Number | None,
        Field(description="rest position; without it the spring balances the load at q"),
    ] = None
    damping: Annotated[
        NotNegative | None,
        Field(
            description="damper beside the spring, N m s/rad or N s/m; default what the robot's "
            "file has"
        ),
    ] = None

    @model_validator(mode="after")
    def _one_law(self) -> JointSpringModel:
        given = [n for n in ("stiffness", "polynomial", "table") if getattr(self, n) is not None]
        if len(given) != 1:
            raise ValueError("give exactly one of stiffness, polynomial, table")
        if self.stiffness == math.inf and self.rest is not None:
            raise ValueError("a rigid joint has no rest position: it stays where it is")
        return self


class BeamModel(FileModel):
    """A straight beam along the link's x axis, from clamp to clamp; it feels its axial force."""

    E: Annotated[Positive, Field(description="Young's modulus")]
    G: Annotated[Positive, Field(description="shear modulus")]
    length: Positive
    area: Annotated[Positive, Field(description="cross-section area")]
    Iy: Annotated[Positive, Field(description="second moment of area about y")]
    Iz: Annotated[Positive, Field(description="second moment of area about z")]
    J: Annotated[Positive, Field(description="torsion constant")]
    segments: Annotated[
        int,
        Field(
            strict=True, ge=1, le=1000,
            description="equal parts with six coordinates each: more for large deflections",
        ),
    ] = 1  # fmt: skip
    shear_area_y: Annotated[
        Positive | None, Field(description="area times shear factor, along y; rigid if absent")
    ] = None
    shear_area_z: Annotated[Positive | None, Field(description="the same along z")] = None
    density: Annotated[
        NotNegative,
        Field(
            description="kg per volume: the beam's own mass, lumped as rigid half segments at its "
            "nodes; the link's inertia in the robot's file stays at the near end besides"
        ),
    ] = 0.0


class FlexibleModel(FileModel):
    """A link that gives: a 6x6 spring (order angular-linear) or a beam, at the link's frame."""

    stiffness: Annotated[
        list[Annotated[list[Number], Field(min_length=6, max_length=6)]] | None,
        Field(min_length=6, max_length=6),
    ] = None
    beam: BeamModel | None = None
    offset: Annotated[PoseModel, Field(description="place of the spring in the link's frame")] = (
        PoseModel()
    )

    @model_validator(mode="after")
    def _one(self) -> FlexibleModel:
        if (self.stiffness is None) == (self.beam is None):
            raise ValueError("give exactly one of stiffness, beam")
        return self


_Pair = Annotated[list[Number], Field(min_length=2, max_length=2)]


class LegJointsModel(FileModel):
    """Universal or spherical joints at one end of the legs, and how far they turn."""

    axis: Annotated[
        Vector | Vectors,
        Field(description="middle direction of the leg seen from the joint, or one per leg; in F "
              "at the base, in P at the platform"),
    ]  # fmt: skip
    angle: Annotated[_PerLeg, Field(description="largest angle of the leg from it, rad")]


class LinesLegs(FileModel):
    """Springs in the legs; one number for all or one per leg."""

    stiffness: Positive | Annotated[list[Positive], Field(min_length=1)]
    rest_length: Annotated[
        NotNegative | Annotated[list[NotNegative], Field(min_length=1)] | None,
        Field(description="length without tension"),
    ] = None
    preload: Annotated[
        Number | Annotated[list[Number], Field(min_length=1)] | None,
        Field(description="tension at the file's pose, instead of rest_length"),
    ] = None
    limits: Annotated[
        list[Annotated[list[Positive], Field(min_length=2, max_length=2)]] | None,
        Field(description="[shortest, longest] of each leg"),
    ] = None
    base_joints: LegJointsModel | None = None
    platform_joints: LegJointsModel | None = None
    diameter: Annotated[
        _PerLeg | None, Field(description="of the legs, which must not touch each other")
    ] = None
    force: Annotated[
        _Pair | list[_Pair] | None,
        Field(description="[least, largest] tension, or one pair per leg; compression below zero"),
    ] = None
    mass: LegMassModel | None = None
    damping: Annotated[
        _PerLeg, Field(description="dampers along the legs, force per velocity (seconds)")
    ] = 0.0

    @model_validator(mode="after")
    def _one(self) -> LinesLegs:
        if self.rest_length is not None and self.preload is not None:
            raise ValueError("give rest_length or preload, not both")
        return self


class LineModel(FileModel):
    """A line spring or cable between points of two frames ("world" is F)."""

    frames: Annotated[list[Text], Field(min_length=2, max_length=2)]
    points: Annotated[list[Vector], Field(min_length=2, max_length=2)]
    stiffness: Positive
    rest_length: NotNegative | None = None
    preload: Annotated[Number | None, Field(description="tension at q")] = None
    unilateral: Flag = False

    @model_validator(mode="after")
    def _one(self) -> LineModel:
        if self.rest_length is not None and self.preload is not None:
            raise ValueError("give rest_length or preload, not both")
        return self


class FoundModel(FileModel):
    """A compliance that was measured: of one spring, of springs that are equal, or of a link."""

    name: Text
    value: Annotated[Number, Field(description="compliance; of a beam a share of the file's own")]
    elements: Annotated[
        list[tuple[Text, Text, Number]] | None,
        Field(description="pairs of springs and factors, where it is not one spring's own"),
    ] = None


class IdentifiedModel(FileModel):
    """How well the stiffnesses are known; written by `cartstiff identify -o`."""

    compliances: Annotated[list[FoundModel], Field(max_length=1000)]
    covariance: Annotated[
        list[list[Number]], Field(description="of the compliances, in the file's units")
    ]
    degrees: Annotated[
        Positive | None, Field(description="of freedom of Student's t; normal if absent")
    ] = None
    level: Annotated[float, Field(gt=0.0, lt=1.0, description="of intervals that are told")] = 0.95
    rows: Annotated[int, Field(strict=True, ge=0, description="measurements, for readers")] = 0
    date: Annotated[Text | None, Field(description="of the measurement, for readers")] = None
    source: Annotated[Text | None, Field(description="what was measured, for readers")] = None
    undetermined: Annotated[
        list[Text], Field(description="springs of which the measurements say nothing")
    ] = []
    at_least: Annotated[
        dict[str, Positive], Field(description="springs without an upper end, and the lower one")
    ] = {}


class _File(FileModel):
    name: Annotated[Text | None, Field(description="name shown to people")] = None
    description: Annotated[Text | None, Field(description="what the mechanism is, for readers")] = (
        None
    )
    source: Annotated[
        Text | None, Field(description="where its numbers come from, for readers")
    ] = None
    gravity: Annotated[
        Vector | None,
        Field(description="acceleration in F, m/s^2 whatever the units; none if absent"),
    ] = None
    payload: PayloadModel | None = None
    parameters: Annotated[
        dict[Text, Number | Text],
        Field(
            description="names for numbers; wherever a number stands in the file, a text such as "
            "'=2*r*cos(pi/6)' may stand for it"
        ),
    ] = {}
    identified: IdentifiedModel | None = None


class _Robot(FileModel):
    model: Annotated[FileName, Field(description="name of a robot, or path of URDF, xacro or MJCF")]
    xacro: Annotated[
        dict[str, Argument], Field(description="arguments of a xacro file by name")
    ] = {}
    package_path: Annotated[
        list[FileName], Field(description="folders in which ROS packages are looked for first")
    ] = []


class SerialFile(_Robot, _File):
    """A serial arm."""

    kind: Literal["serial"]
    frame: Annotated[Text | None, Field(description="link or site that is the body frame M")] = None
    base: Annotated[PoseModel, Field(description="the robot's root in F")] = PoseModel()
    offset: Annotated[PoseModel, Field(description="M in that frame")] = PoseModel()
    locked: Annotated[dict[str, Number], Field(description="joints held fixed")] = {}
    q: Annotated[dict[str, Number], Field(description="default posture")] = {}
    springs: dict[str, JointSpringModel] = {}
    passive: Annotated[list[Text], Field(description="joints without springs")] = []
    flexible: Annotated[dict[str, FlexibleModel], Field(description="by link name")] = {}
    lines: list[LineModel] = []


class PlatformFile(_File):
    """A Stewart-Gough platform: six line springs between a base and a platform."""

    kind: Literal["stewart-gough"]
    units: UnitsModel = UnitsModel()
    layout: Annotated[
        LayoutModel | None, Field(description="in place of base, platform and pose")
    ] = None
    base: Annotated[Vectors, Field(min_length=6, max_length=6, description="points in F")] = []
    platform: Annotated[Vectors, Field(min_length=6, max_length=6, description="points in P")] = []
    pose: Annotated[PoseModel, Field(description="P in F")] = PoseModel()
    frame: Annotated[PoseModel, Field(description="M in P")] = PoseModel()
    body: BodyModel | None = None
    legs: LinesLegs

    @model_validator(mode="after")
    def _has_points(self) -> PlatformFile:
        for key in ("base", "platform"):
            if not getattr(self, key):
                raise ValueError(f"key '{key}' is missing: give base and platform, or layout")
        return self


class SpringsFile(_File):
    """A body held by any number of line springs or cables from the ground."""

    kind: Literal["springs"]
    units: UnitsModel = UnitsModel()
    base: Annotated[Vectors, Field(description="anchor points in F")]
    platform: Annotated[Vectors, Field(description="points of the body in P")]
    pose: Annotated[PoseModel, Field(description="P in F")] = PoseModel()
    frame: Annotated[PoseModel, Field(description="M in P")] = PoseModel()
    body: BodyModel | None = None
    legs: LinesLegs
    unilateral: Annotated[Flag, Field(description="cables: they cannot push")] = False


class LegModel(_Robot):
    """One chain of a parallel mechanism, from the ground to the body."""

    kind: Literal["serial"] = "serial"
    frame: Text | None = None
    base: Annotated[PoseModel, Field(description="the chain's root in F")] = PoseModel()
    grip: Annotated[PoseModel, Field(description="the chain's end frame in the body frame")] = (
        PoseModel()
    )
    contact: Annotated[
        Literal["rigid", "soft-finger", "point"],
        Field(description="joint between chain and body: none, spin about z, or a ball"),
    ] = "rigid"
    passive: Annotated[list[Text], Field(description="joints without springs")] = []
    locked: dict[str, Number] = {}
    q: dict[str, Number] = {}
    springs: dict[str, JointSpringModel] = {}
    flexible: dict[str, FlexibleModel] = {}
    _drawing: Any = PrivateAttr(default=None)

    @property
    def drawing(self) -> Any:
        """What a leg by name has been drawn as; None for a leg that is described."""
        return self._drawing

    def drawn(self, drawing: Any) -> LegModel:
        """The same leg with its drawing, which stands for a description."""
        leg = self.model_copy()
        leg._drawing = drawing
        return leg


class NamedLegs(NamedLegsModel):
    """Equal legs by the letters of their joints, from the ground to the body.

    Their joints are slide, crank, u1, u2, s1, ...; their links rod, crank, slider, lower, upper.
    """

    springs: dict[str, JointSpringModel] = {}
    flexible: dict[str, FlexibleModel] = {}


class ParallelFile(_File):
    """One body carried by several chains."""

    kind: Literal["parallel"]
    legs: Annotated[
        NamedLegs | Annotated[list[LegModel | NamedLegs], Field(min_length=1, max_length=100)],
        Field(description="legs by name, or chains one by one, or a list of both"),
    ]
    pose: Annotated[
        PoseModel | None,
        Field(description="body frame in F, where the legs are put together; legs by name need it"),
    ] = None
    actuated: Annotated[list[Text], Field(description="joints as leg1/joint_name")] = []
    lines: list[LineModel] = []


class ClosureModel(FileModel):
    """Two frames of the tree that coincide (weld) or share a point (point)."""

    frames: Annotated[list[Text], Field(min_length=2, max_length=2)]
    type: Literal["point", "weld"]
    points: Annotated[
        list[Vector] | None,
        Field(min_length=2, max_length=2, description="points in the frames; default origins"),
    ] = None


class ClosedChainFile(_Robot, _File):
    """A tree from URDF or MJCF whose frames are tied by closures."""

    kind: Literal["closed-chain"]
    frame: Text | None = None
    offset: PoseModel = PoseModel()
    closures: list[ClosureModel] = []
    floating: Annotated[
        Flag, Field(description="the tree's root is free in F, as a walking machine's body")
    ] = False
    actuated: list[Text] = []
    locked: dict[str, Number] = {}
    q: Annotated[dict[str, Number], Field(description="posture from which assembly starts")] = {}
    springs: dict[str, JointSpringModel] = {}
    passive: Annotated[list[Text], Field(description="joints without springs")] = []
    flexible: dict[str, FlexibleModel] = {}
    lines: list[LineModel] = []


MechanismFile = Annotated[
    SerialFile | PlatformFile | SpringsFile | ParallelFile | ClosedChainFile,
    Field(discriminator="kind"),
]
MODELS: dict[str, type[FileModel]] = {
    "serial": SerialFile, "stewart-gough": PlatformFile, "springs": SpringsFile,
    "parallel": ParallelFile, "closed-chain": ClosedChainFile,
}  # fmt: skip
KINDS = ", ".join(MODELS)
ADAPTER: TypeAdapter[Any] = TypeAdapter(MechanismFile, config=ConfigDict(defer_build=True))


def json_schema() -> dict[str, Any]:
    """JSON schema of the mechanism file."""
    return ADAPTER.json_schema()


def pose_of(model: PoseModel) -> Array:
    """4x4 pose of a {xyz, rpy} entry."""
    return se3.from_roll_pitch_yaw(model.xyz, model.rpy)
