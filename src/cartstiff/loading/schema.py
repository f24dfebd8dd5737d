"""The mechanism file as data classes; every key, its type and its meaning stand here once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Annotated, Any, Literal, Self

from pydantic import (
    ConfigDict,
    Discriminator,
    Field,
    PrivateAttr,
    Tag,
    TypeAdapter,
    model_validator,
)

from cartstiff.loading.keys.bodies import BodyModel, LinesLegs, PayloadModel
from cartstiff.loading.keys.identified import IdentifiedModel
from cartstiff.loading.keys.springs import FlexibleModel, JointSpringModel, LineModel
from cartstiff.loading.keys.words import (
    Argument,
    FileModel,
    FileName,
    Flag,
    Number,
    PoseModel,
    Text,
    UnitsModel,
    Vector,
    Vectors,
)
from cartstiff.loading.legs.model import NamedLegsModel
from cartstiff.loading.shorthand.layout import LayoutModel


class _File(FileModel):
    name: Text | None = Field(default=None, description="name shown to people")
    description: Text | None = Field(default=None, description="what the mechanism is, for readers")
    source: Text | None = Field(
        default=None, description="where its numbers come from, for readers"
    )
    gravity: Vector | None = Field(
        default=None, description="acceleration in F, m/s^2 whatever the units; none if absent"
    )
    payload: PayloadModel | None = None
    parameters: dict[Text, Number | Text] = Field(
        default={},
        description="names for numbers; wherever a number stands in the file, a text such as "
        "'=2*r*cos(pi/6)' may stand for it",
    )
    identified: IdentifiedModel | None = None


class _Robot(FileModel):
    model: FileName = Field(description="name of a robot, or path of URDF, xacro or MJCF")
    xacro: dict[str, Argument] = Field(default={}, description="arguments of a xacro file by name")
    package_path: list[FileName] = Field(
        default=[], description="folders in which ROS packages are looked for first"
    )
    _named: tuple[str, ...] = PrivateAttr(default=())

    @property
    def named_folders(self) -> tuple[str, ...]:
        """Folders of `package_path` that the user has named, and not the file."""
        return self._named

    def with_ros(self, arguments: Mapping[str, str], folders: Sequence[str]) -> Self:
        """The same with arguments of xacro and folders of packages that the user has named."""
        robot = self.model_copy(
            update={
                "xacro": {**self.xacro, **arguments},
                "package_path": [*folders, *self.package_path],
            }
        )
        robot._named = tuple(folders)
        return robot


class SerialFile(_Robot, _File):
    """A serial arm."""

    kind: Literal["serial"]
    frame: Text | None = Field(default=None, description="link or site that is the body frame M")
    base: PoseModel = Field(
        default=PoseModel(), description="the robot's own base frame B (its root) in F, the room"
    )
    offset: PoseModel = Field(default=PoseModel(), description="M in that frame")
    locked: dict[str, Number] = Field(default={}, description="joints held fixed")
    q: dict[str, Number] = Field(default={}, description="default posture")
    springs: dict[str, JointSpringModel] = {}
    passive: list[Text] = Field(default=[], description="joints without springs")
    flexible: dict[str, FlexibleModel] = Field(default={}, description="by link name")
    lines: list[LineModel] = []


class PlatformFile(_File):
    """A Stewart-Gough platform: six line springs between a base and a platform."""

    kind: Literal["stewart-gough"]
    units: UnitsModel = UnitsModel()
    layout: LayoutModel | None = Field(
        default=None, description="in place of base, platform and pose"
    )
    base: list[Vector] = Field(default=[], min_length=6, max_length=6, description="points in F")
    platform: list[Vector] = Field(
        default=[], min_length=6, max_length=6, description="points in P"
    )
    pose: PoseModel = Field(default=PoseModel(), description="P in F")
    frame: PoseModel = Field(default=PoseModel(), description="M in P")
    body: BodyModel | None = None
    legs: LinesLegs
    flexible: dict[Literal["base", "platform"], FlexibleModel] = Field(
        default={},
        description="what gives between the ground and the feet of the legs (place of the spring "
        "in F), and between their heads and the body (in P)",
    )

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
    base: Vectors = Field(description="anchor points in F")
    platform: Vectors = Field(description="points of the body in P")
    pose: PoseModel = Field(default=PoseModel(), description="P in F")
    frame: PoseModel = Field(default=PoseModel(), description="M in P")
    body: BodyModel | None = None
    legs: LinesLegs
    flexible: dict[Literal["base", "platform"], FlexibleModel] = Field(
        default={}, description="as of kind stewart-gough"
    )
    unilateral: Flag = Field(default=False, description="cables: they cannot push")

    @model_validator(mode="after")
    def _pull(self) -> SpringsFile:
        if self.unilateral and self.legs.strut is not None:
            raise ValueError("struts can push: unilateral is for cables")
        return self


class LegModel(_Robot):
    """One chain of a parallel mechanism, from the ground to the body."""

    kind: Literal["serial"] = "serial"
    frame: Text | None = None
    base: PoseModel = Field(default=PoseModel(), description="the chain's root in F")
    grip: PoseModel = Field(
        default=PoseModel(), description="the chain's end frame in the body frame"
    )
    contact: Literal["rigid", "soft-finger", "point"] = Field(
        default="rigid", description="joint between chain and body: none, spin about z, or a ball"
    )
    passive: list[Text] = Field(default=[], description="joints without springs")
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


def _is_meant(leg: Any) -> str:
    """Which kind of leg is meant: errors are told for that one alone. No tag is a key."""
    is_named = isinstance(leg, NamedLegs) or (isinstance(leg, dict) and "chain" in leg)
    return "<by name>" if is_named else "<described>"


def _are_meant(legs: Any) -> str:
    return "<by name>" if isinstance(legs, (dict, NamedLegs)) else "<list>"


_Leg = Annotated[
    Annotated[LegModel, Tag("<described>")] | Annotated[NamedLegs, Tag("<by name>")],
    Discriminator(_is_meant),
]
_Legs = Annotated[
    Annotated[NamedLegs, Tag("<by name>")]
    | Annotated[list[_Leg], Field(min_length=1, max_length=100), Tag("<list>")],
    Discriminator(_are_meant),
]


class ParallelFile(_File):
    """One body carried by several chains."""

    kind: Literal["parallel"]
    legs: _Legs = Field(description="legs by name, or chains one by one, or a list of both")
    pose: PoseModel | None = Field(
        default=None,
        description="the body's own frame in F, where the legs are put together; legs by name need "
        "it",
    )
    offset: PoseModel = Field(default=PoseModel(), description="M in the body's own frame")
    actuated: list[Text] = Field(default=[], description="joints as leg1/joint_name")
    lines: list[LineModel] = []


class ClosureModel(FileModel):
    """Two frames of the tree that coincide (weld) or share a point (point)."""

    frames: list[Text] = Field(min_length=2, max_length=2)
    type: Literal["point", "weld"]
    points: list[Vector] | None = Field(
        default=None,
        min_length=2,
        max_length=2,
        description="points in the frames; default origins",
    )


class ClosedChainFile(_Robot, _File):
    """A tree from URDF or MJCF whose frames are tied by closures."""

    kind: Literal["closed-chain"]
    frame: Text | None = None
    offset: PoseModel = PoseModel()
    closures: list[ClosureModel] = []
    floating: Flag = Field(
        default=False, description="the tree's root is free in F, as a walking machine's body"
    )
    actuated: list[Text] = []
    locked: dict[str, Number] = {}
    q: dict[str, Number] = Field(default={}, description="posture from which assembly starts")
    springs: dict[str, JointSpringModel] = {}
    passive: list[Text] = Field(default=[], description="joints without springs")
    flexible: dict[str, FlexibleModel] = {}
    lines: list[LineModel] = []


MechanismFile = Annotated[
    SerialFile | PlatformFile | SpringsFile | ParallelFile | ClosedChainFile,
    Field(discriminator="kind"),
]

MODELS: dict[str, type[FileModel]] = {
    "serial": SerialFile,
    "stewart-gough": PlatformFile,
    "springs": SpringsFile,
    "parallel": ParallelFile,
    "closed-chain": ClosedChainFile,
}

KINDS = ", ".join(MODELS)

ADAPTER: TypeAdapter[Any] = TypeAdapter(MechanismFile, config=ConfigDict(defer_build=True))


def json_schema() -> dict[str, Any]:
    """JSON schema of the mechanism file."""
    return ADAPTER.json_schema()
