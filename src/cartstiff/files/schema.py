"""The mechanism file as data classes: the one definition of every key,
its type and its meaning.

This module has the classes of serial arms, closed chains, and those that several kinds
share. Bodies on line springs and bodies on chains have modules of their own, so that a
file imports the classes of its own kind only.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from difflib import get_close_matches
from importlib import import_module
from pathlib import Path
from typing import (
    TYPE_CHECKING,
    Annotated,
    Any,
    Literal,
    Self,
    TypeAlias,
    TypeVar,
)

import numpy as np
from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    PlainValidator,
    PrivateAttr,
    ValidationError,
    ValidationInfo,
    WithJsonSchema,
    WrapValidator,
    field_validator,
    model_validator,
)
from pydantic_core import PydanticCustomError, core_schema

from cartstiff.core import numerics
from cartstiff.core.arrays import Array
from cartstiff.core.choices import LARGEST_INPUT
from cartstiff.core.errors import InputError
from cartstiff.core.units import SI, GivenStiffness, Units
from cartstiff.files.bare import place_of, way_of
from cartstiff.files.yaml_file import Lines, Way

#: Module and model of each kind of file: a file imports the classes of its own kind only.
FILE_KINDS = {
    "serial": ("schema", "SerialFile"),
    "stewart-gough": ("platform_schema", "PlatformFile"),
    "springs": ("platform_schema", "SpringsFile"),
    "parallel": ("leg_schema", "ParallelFile"),
    "closed-chain": ("schema", "ClosedChainFile"),
}

_MAX = LARGEST_INPUT
Number = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=-_MAX, le=_MAX)]
Positive = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=1 / _MAX, le=_MAX)]
NotNegative = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=0, le=_MAX)]
Text = Annotated[str, Field(strict=True, min_length=1, max_length=4000)]
Vector = Annotated[list[Number], Field(min_length=3, max_length=3)]


Flag = Annotated[bool, Field(strict=True)]

_One = TypeVar("_One")
#: One for all legs, or one for each; and two entries.
Each: TypeAlias = _One | Annotated[list[_One], Field(min_length=1)]
Two = Annotated[list[_One], Field(min_length=2, max_length=2)]
Pair = Two[Number]
PerLeg = Each[NotNegative]
Vectors = Annotated[list[Vector], Field(min_length=1, max_length=100_000)]


def _in_order(pair: list[float]) -> list[float]:
    if pair[0] > pair[1]:
        words = "limits are the wrong way round"
        raise InputError(words, expected="[least, most]", got=pair)
    return pair


IN_ORDER = AfterValidator(_in_order)
Limits = Annotated[Pair, IN_ORDER]
#: Largest torque (force) of a drive either way, or the least and the largest.
Effort = Positive | Limits


def with_unit(spring: Literal["slides", "turns", "joint"]) -> WrapValidator:
    """Return the check of a stiffness that may have a unit.

    What slides is in the file's units then, what turns in N m/rad. The unit of a joint's
    is kept: whether the joint slides or turns is known later.
    """

    def checked(value: Any, check: Any, info: ValidationInfo) -> Any:
        if isinstance(value, str) and value != "rigid":
            value = GivenStiffness.read(value)
        if not isinstance(value, GivenStiffness):
            return check(value)
        if spring == "joint":
            check(value)
            return value
        slides = spring == "slides"
        return check(value.in_units(units_of(info) if slides else SI, slides))

    return WrapValidator(checked)


def units_of(info: ValidationInfo) -> Units:
    """Units of the file that is checked."""
    return (info.context or {}).get("units", SI)


def _no_unit(place: str, text: str) -> InputError:
    expected = "a number: of its own unit none is read here"
    return InputError("no stiffness", where=place, expected=expected, got=repr(text))


#: The same for a stiffness of infinity, and its word.
RIGID = WrapValidator(lambda x, check: math.inf if x in ("rigid", math.inf) else check(x))
JointStiffness = Annotated[NotNegative, with_unit("joint"), RIGID]
Sliding = Annotated[Positive, with_unit("slides")]
Turning = Annotated[NotNegative, with_unit("turns")]


def keyed(words: str, default: Any = ..., **rules: Any) -> Any:
    """Declare a key of a file with its meaning.

    It is required unless it has a default.
    """
    return Field(default=default, description=words, **rules)


class FileModel(BaseModel):
    """A mapping in a file: no other keys, and immutable."""

    # Validators are built when first used: a file uses few of the classes.
    model_config = ConfigDict(extra="forbid", frozen=True, defer_build=True)

    @model_validator(mode="before")
    @classmethod
    def _knows_its_keys(cls, value: Any) -> Any:
        """Refuse another key with those that there are, which pydantic does not name."""
        known = cls.model_fields
        for key in value if isinstance(value, dict) else ():
            if key not in known:
                says: Any = {"key": key, "known": [*known]}
                raise PydanticCustomError("extra_forbidden", "unknown key", says)
        return value

    @model_validator(mode="after")
    def _agrees(self) -> Self:
        self._fits()
        return self

    def _fits(self) -> None:
        """Refuse keys that do not go together, by a ValueError."""


if TYPE_CHECKING:
    _Section = TypeVar("_Section")
    #: A section whose model is built when a file has it: most files have few of them.
    Section = Annotated[_Section, ...]
else:

    class Section:
        """A section whose model is built when a file has it:
        most files have few of them.
        """

        def __class_getitem__(cls, model):
            """The model, so marked."""
            return Annotated[model, cls(model)]

        def __init__(self, model):
            self.model = model

        def __get_pydantic_core_schema__(self, source, handler):
            """Check by the model's own validator."""

            def checked(value, info):
                return self.model.model_validate(value, context=info.context)

            return core_schema.with_info_plain_validator_function(
                checked, metadata={"section": self.model}
            )


def _file_name(name: Any) -> str:
    # Pydantic's own text type has a largest length, and refuses bytes that are no
    # Unicode.
    if not isinstance(name, str) or not name:
        raise PydanticCustomError("string_type", "text")
    try:
        Path(name).expanduser()
    except RuntimeError:
        raise PydanticCustomError(
            "value_error", "the home directory is not known"
        ) from None
    return name


FileName = Annotated[str, PlainValidator(_file_name), WithJsonSchema({"type": "string"})]


def _argument(value: Any) -> str:
    # YAML has truth values and numbers where xacro takes text.
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


class PoseModel(FileModel):
    """A pose by translation and roll, pitch, yaw about fixed axes (radians)."""

    xyz: Vector = [0.0, 0.0, 0.0]
    rpy: Vector = [0.0, 0.0, 0.0]


class UnitsModel(FileModel):
    """Units of lengths and forces.

    Angles are rad, masses kg, gravity m/s^2 in every file.
    """

    length: Literal["m", "dm", "cm", "mm", "um", "in", "ft"] = "m"
    force: Literal["N", "kN", "mN", "daN", "lbf", "kgf"] = "N"


def only_one(model: BaseModel, *keys: str, needed: bool = True) -> None:
    """Refuse a model that gives more than one of the keys,
    or none where one is needed.
    """
    count = sum(getattr(model, key) is not None for key in keys)
    if needed and count != 1:
        raise ValueError(f"give exactly one of {', '.join(keys)}")
    if count > 1:
        raise ValueError(f"give {' or '.join(keys)}, not both")


def one_each(value: Any, m: int, where: str, row: bool = False) -> list[Any]:
    """One value for each of m legs; with `row` a value is itself a list of numbers."""
    if not isinstance(value, list) or (row and value and not isinstance(value[0], list)):
        return [value] * m
    if len(value) != m:
        expected = f"one, or {m}, one per leg"
        raise InputError("wrong count", where=where, expected=expected, got=len(value))
    return value


class Ring(FileModel):
    """Joints on a circle around z: of hexapods by their layout, and of legs by name."""

    radius: Positive | None = keyed("of the circle; not for a cube", None)
    half_angle: NotNegative | None = keyed(
        "rad, between a joint and the middle of its pair; default 0, one point", None
    )
    angles: list[Number] | None = keyed(
        "rad, of each leg's joint, in place of that", None, min_length=1, max_length=100
    )
    height: Number | None = keyed(
        "of the circle, along z of F for the base, of P for the platform; default "
        "0, for a cube that of its vertices",
        None,
    )

    def _fits(self) -> None:
        only_one(self, "half_angle", "angles", needed=False)

    def pair(self, turn: float | None, is_base: bool) -> list[float]:
        """Angles of the joints of the first two legs.

        They are a pair of the base, and of neighbouring pairs of the platform, which is
        turned against the base by `turn`, pi/3 if None.
        """
        half = self.half_angle or 0.0
        if is_base:
            return [-half, half]
        turn = np.pi / 3.0 if turn is None else turn
        return [turn - 2.0 * np.pi / 3.0 + half, turn - half]

    def joints(self, angles: list[float], parts: int) -> Array:
        """Joints (n, 3) at some angles, repeated about z."""
        turns = 2.0 * np.pi * np.arange(parts) / parts
        a, radius = np.add.outer(turns, angles).ravel(), self.radius or 0.0
        height = np.full(a.size, self.height or 0.0)
        return np.stack([radius * np.cos(a), radius * np.sin(a), height], axis=1)


class FoundModel(FileModel):
    """A measured compliance: of one spring, of equal springs, or of a link."""

    name: Text
    value: Number = keyed("compliance; of a beam a share of the file's own")
    elements: list[tuple[Text, Text, Number]] | None = keyed(
        "pairs of springs and factors, where it is not one spring's own", None
    )
    polynomial: tuple[Text, Annotated[int, Field(strict=True, ge=1, le=100)]] | None = (
        keyed(
            "joint and power of a polynomial spring: of the first power the "
            "value is a compliance, of others the coefficient",
            None,
        )
    )


class IdentifiedModel(FileModel):
    """Uncertainty of the stiffnesses; written by `cartstiff identify -o`."""

    compliances: list[FoundModel] = Field(max_length=1000)
    covariance: list[list[Number]] = keyed("of the compliances, in the file's units")
    degrees: Positive | None = keyed("of freedom of Student's t; normal if absent", None)
    level: float = keyed("of the intervals", 0.95, gt=0.0, lt=1.0)
    rows: int = keyed("measurements, for readers", 0, strict=True, ge=0)
    date: Text | None = keyed("of the measurement, for readers", None)
    source: Text | None = keyed("what was measured, for readers", None)
    undetermined: list[Text] = keyed("springs of which the measurements say nothing", [])
    at_least: dict[str, Positive] = keyed(
        "springs without an upper end, and the lower one", {}
    )


class PayloadModel(FileModel):
    """A point mass carried by the body."""

    mass: NotNegative = keyed("kg, whatever the units")
    com: Vector = keyed("mass centre in the body frame M", [0.0, 0.0, 0.0])
    _carrier: tuple[str | None, PoseModel] | None = PrivateAttr(default=None)

    @property
    def carrier(self) -> tuple[str | None, PoseModel] | None:
        """The file's own frame (None: the default one) and offset,
        where M is elsewhere.
        """
        return self._carrier

    def carried_by(self, frame: str | None, offset: PoseModel) -> PayloadModel:
        """Return the payload that stays in a frame while M moves to another one."""
        payload = self.model_copy()
        payload._carrier = payload._carrier or (frame, offset)
        return payload


TablePoints = Annotated[list[Pair], Field(min_length=2)]


class SpringTableModel(FileModel):
    """Points of a spring's torque, and what is between them."""

    points: TablePoints = keyed("pairs [deflection, torque], deflections increasing")
    pieces: Literal["linear", "smooth"] = keyed(
        "linear: straight lines between the points, as in catalogues; at a corner the "
        "stiffness has two values, and a note names both; smooth: a curve that rises "
        "and falls as the points do, without corners",
        "linear",
    )


class JointSpringModel(FileModel):
    """A spring in a joint: one of stiffness, polynomial, table."""

    stiffness: JointStiffness | None = keyed(
        "N m/rad, N/m for a prismatic joint, or a text with another unit such as 392 N "
        "m/arcmin; or rigid",
        None,
    )
    polynomial: list[Annotated[Number, with_unit("joint")]] | None = keyed(
        "torque c1 x + c2 x^2 + ...; c1 may be a text with its unit",
        None,
        min_length=1,
        max_length=20,
    )
    table: TablePoints | Section[SpringTableModel] | None = keyed(
        "pairs [deflection, torque], deflections increasing: straight pieces between "
        "them; or points and pieces",
        None,
    )
    rest: Number | None = keyed(
        "rest position; without it the spring balances the load at q", None
    )
    damping: NotNegative | None = keyed(
        "damper beside the spring, N m s/rad or N s/m; default what the robot's file has",
        None,
    )

    def _fits(self) -> None:
        only_one(self, "stiffness", "polynomial", "table")
        for i, c in enumerate(self.polynomial or (), start=1):
            if i > 1 and isinstance(c, GivenStiffness):
                raise _no_unit(f"polynomial.{i}", c.text)
        if self.stiffness == math.inf and self.rest is not None:
            raise ValueError("a rigid joint has no rest position: it stays where it is")

    @property
    def points(self) -> SpringTableModel | None:
        """The table with the kind of its pieces; None without one."""
        if isinstance(self.table, list):
            return SpringTableModel(points=self.table)
        return self.table


class NamedSprings(dict[str, JointSpringModel]):
    """Joint springs of a published set, or of a table: nothing by joint in the
    file itself.

    Attributes
    ----------
    name : str
        Name of the set, or path of the table relative to the file.
    """

    name: str


def _by_joint_or_name(value: Any, check: Any) -> Any:
    if not isinstance(value, str):
        return check(value)
    springs = NamedSprings()
    springs.name = value
    return springs


def _or_text(schema: dict[str, Any]) -> None:
    own = {
        key: schema.pop(key) for key in ("type", "additionalProperties") if key in schema
    }
    schema["anyOf"] = [own, {"type": "string", "minLength": 1}]


SpringsByJoint = Annotated[
    dict[str, Section[JointSpringModel]],
    WrapValidator(_by_joint_or_name),
    Field(json_schema_extra=_or_text),
]


class CoupledSpringModel(FileModel):
    """A spring that couples joints: on a sum of their positions,
    each times its factor.
    """

    name: Text | None = keyed("for people; default coupled1, coupled2, ...", None)
    joints: dict[Text, Number] = keyed(
        "factor of each joint's position in the sum", min_length=1
    )
    stiffness: Annotated[Positive, with_unit("joint")] = keyed(
        "force per change of the sum: the energy is half of it times the square of that "
        "change; N m/rad for a sum of angles, N/m for one of lengths"
    )
    rest: Number | None = keyed(
        "the sum at rest; without it the spring balances the load at q", None
    )

    @field_validator("joints")
    @classmethod
    def _acts(cls, joints: dict[str, float]) -> dict[str, float]:
        if not all(joints.values()):
            raise ValueError("a factor of a coupled spring is not zero")
        return joints


class BeamModel(FileModel):
    """A straight beam along the link's x axis, clamped at both ends,
    with axial force effects.
    """

    E: Positive = keyed("Young's modulus")
    G: Positive = keyed("shear modulus")
    length: Positive
    area: Positive = keyed("cross-section area")
    Iy: Positive = keyed("second moment of area about y")
    Iz: Positive = keyed("second moment of area about z")
    J: Positive = keyed("torsion constant")
    segments: int = keyed(
        "equal parts with six coordinates each: more for large deflections",
        1,
        strict=True,
        ge=1,
        le=1000,
    )
    shear_area_y: Positive | None = keyed(
        "area times shear factor, along y; rigid if absent", None
    )
    shear_area_z: Positive | None = keyed("the same along z", None)
    outline: Two[Positive] | None = keyed(
        "distances along y and z from the axis to the outermost fibres, for stresses",
        None,
    )
    density: NotNegative = keyed(
        "kg per volume: the beam's own mass, lumped as rigid half segments at its "
        "nodes; the link's inertia in the robot's file stays at the near end besides",
        0.0,
    )


_Six = list[Annotated[list[Number], Field(min_length=6, max_length=6)]]


def _entry(value: Any, row: int, column: int, info: ValidationInfo) -> Any:
    """Entry of a stiffness without the unit that it may have on one of both blocks."""
    if not isinstance(value, str):
        return value
    given = GivenStiffness.read(value, place := f"{row + 1}.{column + 1}")
    if (row < 3) != (column < 3):
        raise _no_unit(place, value)
    return given.in_units(units_of(info), row >= 3, place)


def is_symmetric(rows: Sequence[Sequence[float]]) -> bool:
    """Whether a matrix is symmetric to rounding."""
    return bool(numerics.is_about_symmetric(np.array(rows, float)))


class FlexibleModel(FileModel):
    """A compliant link: a 6x6 spring (order angular-linear) with a 6x6
    mass, or a beam.
    """

    stiffness: _Six | None = keyed(
        "6x6, in the file's units; of what turns or slides a text with its unit as well",
        None,
        min_length=6,
        max_length=6,
    )
    mass: _Six | None = keyed(
        "6x6, of the spring's deflection: kg, in the file's unit of length, as a "
        "finite-element model has it at the spring with the link's near side clamped "
        "(Guyan). The link's inertia in the robot's file stays at the near side "
        "besides; what the two exchange is left out",
        None,
        min_length=6,
        max_length=6,
    )
    beam: Section[BeamModel] | None = None
    offset: Section[PoseModel] = keyed(
        "place of the spring in the link's frame", PoseModel.model_construct()
    )

    def _fits(self) -> None:
        only_one(self, "stiffness", "beam")
        for key in ("stiffness", "mass"):
            if not is_symmetric(getattr(self, key) or [[0.0]]):
                raise ValueError(f"{key} must be symmetric")
        if self.mass is None:
            return
        if self.beam is not None:
            raise ValueError("mass is that of a stiffness; a beam has density")
        M = np.array(self.mass)
        sizes = numerics.equilibration(M)
        if np.linalg.eigvalsh(M / np.outer(sizes, sizes))[0] < -numerics.ZERO_SHARE:
            raise ValueError("mass must have no negative eigenvalue")

    @field_validator("stiffness", mode="before")
    @classmethod
    def _with_units(cls, rows: Any, info: ValidationInfo) -> Any:
        """Convert texts with units, which only what turns or slides alone can have."""
        if not isinstance(rows, list):
            return rows
        read = list(rows)
        for i, row in enumerate(rows):
            if isinstance(row, list):
                read[i] = [_entry(x, i, j, info) for j, x in enumerate(row)]
        return read


class LineModel(FileModel):
    """A line spring or cable between points of two frames ("world" is F)."""

    frames: Two[Text]
    points: Two[Vector]
    stiffness: Sliding
    rest_length: NotNegative | None = None
    preload: Number | None = keyed("tension at q", None)
    unilateral: Flag = False

    def _fits(self) -> None:
        only_one(self, "rest_length", "preload", needed=False)


class FileWords(FileModel):
    """Keys that every file may have."""

    name: Text | None = keyed("name shown to people", None)
    description: Text | None = keyed("what the mechanism is, for readers", None)
    source: Text | None = keyed("where its numbers come from, for readers", None)
    gravity: Vector | None = keyed(
        "acceleration in F, m/s^2 whatever the units; none if absent", None
    )
    payload: Section[PayloadModel] | None = None
    parameters: dict[Text, Number | Text] = keyed(
        "names for numbers, or for stiffnesses with their units; wherever a number "
        "stands in the file, a text such as '=2*r*cos(pi/6)' may stand for it",
        {},
    )
    identified: Section[IdentifiedModel] | None = None


class DHUnits(FileModel):
    """Units of the numbers in a DH table of a mechanism file."""

    length: Literal["m", "cm", "mm", "in"] = "m"
    angle: Literal["rad", "deg"] = "rad"


class DHJoint(FileModel):
    """A row of a DH table; its numbers are in the table's units."""

    name: Text | None = keyed(
        "of the joint; default j1, j2, ...; of a fixed row that of its link", None
    )
    type: Literal["revolute", "prismatic", "fixed"] = "revolute"
    a: Number = keyed("distance along x", 0.0)
    alpha: Number = keyed("angle about x", 0.0)
    d: Number = keyed("distance along z; of a prismatic joint where q is 0", 0.0)
    theta: Number = keyed("angle about z; of a revolute joint where q is 0", 0.0)
    limits: Limits | None = keyed("[least, most] of q", None)

    def _fits(self) -> None:
        if self.limits is not None and self.type == "fixed":
            raise ValueError("limits are of a joint that moves")


class DHModel(FileModel):
    """An arm by Denavit-Hartenberg parameters.

    M is in the frame of the last row, link6 of six.
    """

    convention: Literal["standard", "modified"] = keyed(
        "standard: a row is Rz(theta) Tz(d) Tx(a) Rx(alpha), joint i turns about z of "
        "frame i-1; modified (Craig): Rx(alpha) Tx(a) Rz(theta) Tz(d), joint i turns "
        "about z of frame i"
    )
    joints: list[DHJoint] | None = keyed("row by row", None, min_length=1, max_length=100)
    table: FileName | None = keyed(
        "CSV in place of joints: columns joint, type, a, alpha, d, theta, lower, upper, "
        "with the units in the heads, as a [mm]",
        None,
    )
    units: DHUnits = keyed("of the numbers under joints", DHUnits.model_construct())

    def _fits(self) -> None:
        only_one(self, "joints", "table")
        if self.table is not None and self.units != DHUnits():
            raise ValueError("units of a table are in its heads")


class _Robot(FileModel):
    dh: Section[DHModel] | None = keyed(
        "in place of model: a Denavit-Hartenberg table", None
    )
    model: FileName | None = keyed(
        "name of a robot, or path of URDF, xacro or MJCF", None, validate_default=True
    )
    xacro: dict[str, Argument] = keyed("arguments of a xacro file by name", {})
    package_path: list[FileName] = keyed(
        "folders in which ROS packages are looked for first", []
    )
    _named: tuple[str, ...] = PrivateAttr(default=())

    @field_validator("model")
    @classmethod
    def _is_given(cls, model: str | None, info: ValidationInfo) -> str | None:
        if model is None and info.data.get("dh", True) is None:
            raise PydanticCustomError("missing", "key 'model' is missing, or 'dh'")
        return model

    def _fits(self) -> None:
        only_one(self, "model", "dh")

    @property
    def named_folders(self) -> tuple[str, ...]:
        """Folders of `package_path` that come from the user, not from the file."""
        return self._named

    def with_ros(self, arguments: Mapping[str, str], folders: Sequence[str]) -> Self:
        """Add xacro arguments and package folders that come from the user."""
        robot = self.model_copy(
            update={
                "xacro": {**self.xacro, **arguments},
                "package_path": [*folders, *self.package_path],
            }
        )
        robot._named = tuple(folders)
        return robot


class Joints(_Robot):
    """Keys of a tree of joints."""

    frame: Text | None = keyed("link or site that is the body frame M", None)
    locked: dict[str, Number] = keyed("joints held fixed", {})
    q: dict[str, Number] = keyed(
        "default posture; a closed chain is assembled from there", {}
    )
    springs: SpringsByJoint = keyed(
        "by joint; or the name of a published set (see `cartstiff models`), or of a "
        "table beside this file (.csv: joint, stiffness [N m/arcmin])",
        {},
    )
    coupled_springs: list[Section[CoupledSpringModel]] = keyed(
        "springs on sums of joint positions, as of a differential or a tendon over "
        "several joints",
        [],
    )
    actuator_springs: Flag = keyed(
        "the kp of an MJCF file's position actuators, times their gears squared, are "
        "springs",
        False,
    )
    passive: list[Text] = keyed("joints without springs", [])
    effort: dict[str, Effort] = keyed(
        "largest torque (force) of each joint's drive, or [least, largest] on the link "
        "that it moves; default what the robot's file has",
        {},
    )
    flexible: dict[str, Section[FlexibleModel]] = keyed("by link name", {})


class SerialFile(Joints, FileWords):
    """A serial arm."""

    kind: Literal["serial"]
    base: Section[PoseModel] = keyed(
        "the robot's own base frame B (its root) in F, the room",
        PoseModel.model_construct(),
    )
    offset: Section[PoseModel] = keyed(
        "M in the named frame", PoseModel.model_construct()
    )
    zeros: dict[str, Number] = keyed(
        "true positions of joints that are commanded to 0", {}
    )
    lines: list[Section[LineModel]] = keyed(
        "springs and cables between links; where they are and no joint is named under "
        "springs or "
        "passive, none but the joints with actuators of their own get an assumed spring",
        [],
    )


class ClosureModel(FileModel):
    """Two frames of the tree that are joined: a loop is cut there.

    A hinge and a universal joint have coordinates of their own, closure1.x and closure1.y
    for the first closure, which may have springs.
    """

    frames: Two[Text]
    type: Literal["point", "ball", "weld", "rigid", "hinge", "universal"] = keyed(
        "point or ball: a common point; weld or rigid: the same pose; hinge: a common "
        "axis and point; universal: a common point, and two axes that stay square"
    )
    points: Two[Vector] | None = keyed(
        "points in the frames; default origins, and for the world where the other frame "
        "is at q",
        None,
    )
    axes: Two[Vector] | None = keyed(
        "of a hinge in either frame, default z; of a universal joint the first in the "
        "first frame, default x, the second in the second, default y",
        None,
    )

    def _fits(self) -> None:
        if self.axes is not None and self.type not in ("hinge", "universal"):
            raise ValueError("axes are of a hinge or a universal joint")


class ClosedChainFile(Joints, FileWords):
    """A tree from URDF or MJCF whose frames are tied by closures."""

    kind: Literal["closed-chain"]
    offset: PoseModel = PoseModel.model_construct()
    closures: list[ClosureModel] = []
    joint_types: dict[
        str,
        Literal[
            "fixed",
            "spherical",
            "ujoint_xy",
            "ujoint_xz",
            "ujoint_yx",
            "ujoint_yz",
            "ujoint_zx",
            "ujoint_zy",
        ],
    ] = keyed(
        "what joints of a URDF are taken as: spherical (turns ankle.x, ankle.y, ankle.z "
        "of joint ankle), ujoint_xy (about x, then y), or fixed",
        {},
    )
    floating: Flag = keyed(
        "the tree's root is free in F, as a walking machine's body", False
    )
    actuated: list[Text] = []
    lines: list[LineModel] = []


def file_model(kind: str) -> Any:
    """Return the model of a kind of file."""
    module, name = FILE_KINDS[kind]
    return getattr(import_module(f"cartstiff.files.{module}"), name)


def first_error(
    error: ValidationError,
    data: dict[str, Any],
    lines: Lines,
    path: Path | str,
) -> InputError:
    """Return the most helpful of pydantic's errors in the words of this program."""
    # The deepest error belongs to the alternative of a union that the user meant. More
    # helpful is what a check of this program says, and still more an unknown key, which
    # often explains a missing one.
    chosen = max(
        error.errors(include_url=False),
        key=lambda p: (
            p["type"] == "extra_forbidden",
            _refusal(p) is not None,
            len(p["loc"]),
        ),
    )
    kind = chosen["type"]
    at = _keys(chosen["loc"], data, kind)
    if kind == "extra_forbidden":
        at = (*at, str(chosen["ctx"]["key"]))
    if (own := _refusal(chosen)) is not None:
        return own.moved_to(place_of(path, lines, (*at, *way_of(own.where))))
    what, expected, got = _words(chosen, at)
    return InputError(what, where=place_of(path, lines, at), expected=expected, got=got)


def _refusal(problem: Any) -> InputError | None:
    """Refusal of a check of this program in one of pydantic's errors."""
    cause = problem.get("ctx", {}).get("error")
    return cause if isinstance(cause, InputError) else None


def _words(problem: Any, at: Way) -> tuple[str, str | None, Any]:
    """What is wrong, what was expected, and what was found."""
    kind, got, key = problem["type"], problem["input"], str((at or ("",))[-1])
    if kind == "extra_forbidden":
        return "unknown key", _expected_key(key, problem["ctx"]["known"]), repr(key)
    if kind == "missing":
        return f"key {key!r} is missing", _meaning(key), None
    if kind == "value_error":
        return problem["msg"].removeprefix("Value error, "), None, None
    if kind in ("too_short", "too_long"):
        return "wrong count", _expectation(problem), len(got)
    if got in (None, ""):
        got = "nothing"
    elif isinstance(got, str):
        got = repr(got)
    return "cannot be used", _expectation(problem), got


def _expected_key(got: str, own: Sequence[str]) -> str:
    """Words on the keys of a section."""
    close = ", ".join(get_close_matches(got, own, n=3))
    return f"one of {', '.join(own)}" + f" (closest: {close})" * bool(close)


def _keys(location: Way, data: Any, kind: str) -> Way:
    """Keys of the file in pydantic's location, which also contains the
    branches of unions.
    """
    at: list[str | int] = []
    for i, part in enumerate(location, start=1):
        here = isinstance(data, dict) and isinstance(part, str) and part in data
        if here or (isinstance(data, list) and isinstance(part, int)):
            at.append(part)
            data = data[part]
        elif kind == "missing" and i == len(location):
            at.append(part)
    return tuple(at)


def _models(base: type[BaseModel]) -> list[type[BaseModel]]:
    """A model and all that derive from it."""
    return [base, *(model for own in base.__subclasses__() for model in _models(own))]


def _meaning(key: str) -> str | None:
    """Words of a key that means the same in all models of mechanism files."""
    # A study's sections have the same base class, once that module is imported.
    own = (m for m in _models(FileModel) if m.__module__.startswith("cartstiff.files."))
    fields = (model.model_fields.get(key) for model in own)
    words = {field.description for field in fields if field is not None}
    return words.pop() if len(words) == 1 else None


# A number with a unit behind it.
_WITH_UNIT = re.compile(r"\s*[-+]?[\d.]+(?:[eE][-+]?\d+)?\s*[^\W\d_].*")
#: Values that pydantic accepts, in the words of the file, by its kinds of errors.
_EXPECTED = {
    "float_type": "a number",
    "finite_number": "a finite number",
    "string_type": "text",
    "string_unicode": "text",
    "string_too_short": "text",
    "string_too_long": "at most {max_length} characters",
    "bool_type": "true or false",
    "list_type": "a list",
    "dict_type": "a mapping of keys",
    "model_type": "a mapping of keys",
    "too_short": "at least {min_length}",
    "too_long": "at most {max_length}",
    "less_than_equal": "at most {le:g}",
    "greater_than_equal": "at least {ge:g}",
}


def _expectation(problem: Any) -> str:
    """Values that pydantic accepts, in the words of the file."""
    kind, context, got = problem["type"], problem.get("ctx", {}), problem["input"]
    if kind == "float_type" and isinstance(got, str) and _WITH_UNIT.fullmatch(got):
        return (
            "a number in the unit of the file, or arithmetic such as '=2*r'; only "
            "stiffnesses are read with a unit, such as '20 N/mm'"
        )
    if kind not in _EXPECTED:
        message = problem["msg"].removeprefix("Input should be ")
        return str(message[0].lower() + message[1:])
    words = _EXPECTED[kind].format(**context)
    least = context.get("ge", -1.0)
    if least == 0:
        return "zero or more"
    return f"above zero ({words})" if least > 0 else words
