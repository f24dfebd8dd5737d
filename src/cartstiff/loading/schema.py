"""The mechanism file as data classes; every key, its type and its meaning stand here once."""

from __future__ import annotations

import math
import re
from difflib import get_close_matches
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    PlainValidator,
    TypeAdapter,
    ValidationError,
    WithJsonSchema,
    WrapValidator,
    model_validator,
)
from pydantic_core import PydanticCustomError

from cartstiff.errors import InputError, one_line
from cartstiff.loading.yaml_file import LARGEST_NUMBER, Lines, read_yaml

__all__ = [
    "BeamModel",
    "BodyModel",
    "ClosedChainFile",
    "ClosureModel",
    "FlexibleModel",
    "FoundModel",
    "IdentifiedModel",
    "JointSpringModel",
    "LegMassModel",
    "LegModel",
    "LineModel",
    "MechanismFile",
    "ParallelFile",
    "PayloadModel",
    "PlatformFile",
    "PoseModel",
    "SerialFile",
    "SpringsFile",
    "UnitsModel",
    "json_schema",
    "read_mechanism_file",
]

_MOST = LARGEST_NUMBER
Number = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=-_MOST, le=_MOST)]
Positive = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=1 / _MOST, le=_MOST)]
NotNegative = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=0, le=_MOST)]
Text = Annotated[str, Field(strict=True, min_length=1, max_length=4000)]


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
Vector = Annotated[list[Number], Field(min_length=3, max_length=3)]
Vectors = Annotated[list[Vector], Field(min_length=1, max_length=100_000)]


class _Model(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class PoseModel(_Model):
    """A pose by translation and roll, pitch, yaw about fixed axes (radians)."""

    xyz: Vector = [0.0, 0.0, 0.0]
    rpy: Vector = [0.0, 0.0, 0.0]


class UnitsModel(_Model):
    """Units of lengths and forces; angles are rad, masses kg, gravity m/s^2 in every file."""

    length: Literal["m", "dm", "cm", "mm", "um", "in", "ft"] = "m"
    force: Literal["N", "kN", "mN", "daN", "lbf", "kgf"] = "N"


class PayloadModel(_Model):
    """A point mass carried by the body."""

    mass: Annotated[NotNegative, Field(description="kg, whatever the units")]
    com: Annotated[Vector, Field(description="mass centre in the body frame M")] = [0.0, 0.0, 0.0]


class BodyModel(_Model):
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


class LegMassModel(_Model):
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


class JointSpringModel(_Model):
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
        NotNegative, Field(description="damper beside the spring, N m s/rad or N s/m")
    ] = 0.0

    @model_validator(mode="after")
    def _one_law(self) -> JointSpringModel:
        given = [n for n in ("stiffness", "polynomial", "table") if getattr(self, n) is not None]
        if len(given) != 1:
            raise ValueError("give exactly one of stiffness, polynomial, table")
        if self.stiffness == math.inf and self.rest is not None:
            raise ValueError("a rigid joint has no rest position: it stays where it is")
        return self


class BeamModel(_Model):
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


class FlexibleModel(_Model):
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


class LinesLegs(_Model):
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
    mass: LegMassModel | None = None
    damping: Annotated[
        _PerLeg, Field(description="dampers along the legs, force per velocity (seconds)")
    ] = 0.0

    @model_validator(mode="after")
    def _one(self) -> LinesLegs:
        if self.rest_length is not None and self.preload is not None:
            raise ValueError("give rest_length or preload, not both")
        return self


class LineModel(_Model):
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


class FoundModel(_Model):
    """A compliance that was measured: of one spring, of springs that are equal, or of a link."""

    name: Text
    value: Annotated[Number, Field(description="compliance; of a beam a share of the file's own")]
    elements: Annotated[
        list[tuple[Text, Text, Number]] | None,
        Field(description="pairs of springs and factors, where it is not one spring's own"),
    ] = None


class IdentifiedModel(_Model):
    """How well the stiffnesses are known; written by `cartstiff identify -o`."""

    compliances: Annotated[list[FoundModel], Field(max_length=1000)]
    covariance: Annotated[
        list[list[Number]], Field(description="of the compliances, in the file's units")
    ]
    degrees: Annotated[
        Positive | None, Field(description="of freedom of Student's t; normal if absent")
    ] = None
    level: Annotated[float, Field(gt=0.0, lt=1.0, description="of intervals that are told")] = 0.95
    rows: Annotated[int, Field(strict=True, ge=0, description="measurements")] = 0
    date: Text | None = None
    source: Text | None = None
    undetermined: Annotated[
        list[Text], Field(description="springs of which the measurements say nothing")
    ] = []
    at_least: Annotated[
        dict[str, Positive], Field(description="springs without an upper end, and the lower one")
    ] = {}


class _File(_Model):
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
    identified: IdentifiedModel | None = None


class _Robot(_Model):
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
    base: Annotated[Vectors, Field(min_length=6, max_length=6, description="points in F")]
    platform: Annotated[Vectors, Field(min_length=6, max_length=6, description="points in P")]
    pose: Annotated[PoseModel, Field(description="P in F")] = PoseModel()
    frame: Annotated[PoseModel, Field(description="M in P")] = PoseModel()
    body: BodyModel | None = None
    legs: LinesLegs


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


class ParallelFile(_File):
    """One body carried by several chains."""

    kind: Literal["parallel"]
    legs: Annotated[list[LegModel], Field(min_length=1, max_length=100)]
    pose: Annotated[
        PoseModel | None,
        Field(description="body frame in F: the legs are put together there, starting from q"),
    ] = None
    actuated: Annotated[list[Text], Field(description="joints as leg1/joint_name")] = []
    lines: list[LineModel] = []


class ClosureModel(_Model):
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
_ADAPTER: TypeAdapter[Any] = TypeAdapter(MechanismFile)
_KINDS = "serial, stewart-gough, springs, parallel, closed-chain"


def json_schema() -> dict[str, Any]:
    """JSON schema of the mechanism file."""
    return _ADAPTER.json_schema()


def read_mechanism_file(path: Path) -> tuple[Any, Lines]:
    """Read and check a mechanism file; returns its model and the line of each value.

    Raises
    ------
    InputError
        The first thing that is wrong, with file, line and key.
    """
    data, lines = read_yaml(path)
    try:
        file = _ADAPTER.validate_python(data)
    except ValidationError as error:
        raise _first_error(error, data, lines, path) from None
    except RecursionError:
        raise InputError("file is nested too deeply", where=one_line(str(path))) from None
    if isinstance(file, (PlatformFile, SpringsFile)):
        _check_legs(file, lines, path)
    return file, lines


def _check_legs(file: PlatformFile | SpringsFile, lines: Lines, path: Path) -> None:
    """Every list has one entry per leg, and limits are the right way round."""
    m = len(file.base)
    found = {("platform",): file.platform} | {
        ("legs", key): getattr(file.legs, key)
        for key in ("stiffness", "rest_length", "preload", "limits")
    }
    for at, values in found.items():
        if isinstance(values, list) and len(values) != m:
            raise InputError("wrong count", where=place_of(path, lines, at),
                             expected=f"{m}, one per leg", got=str(len(values)))  # fmt: skip
    for i, (shortest, longest) in enumerate(file.legs.limits or []):
        if shortest > longest:
            raise InputError(
                "limits are the wrong way round",
                where=place_of(path, lines, ("legs", "limits", i)),
                expected="[shortest, longest]",
                got=[shortest, longest],
            )


def place_of(path: Path, lines: Lines, at: tuple[str | int, ...]) -> str:
    """File, line and key of a value, for messages."""
    known = at
    while known and known not in lines:
        known = known[:-1]
    line = lines.get(known, 1)
    key = ".".join(str(part + 1) if isinstance(part, int) else part for part in at)
    return one_line(f"{path}, line {line}" + (f", key {key}" if key else ""))


def located(error: InputError, path: Path, lines: Lines) -> InputError:
    """The same error with the line of the key that its place names, or at least the file."""
    where = one_line(str(path))
    place = error.where or where
    found = re.fullmatch(r"(?:, leg (\d+))?(?:, key ([\w.]+))?", place.removeprefix(where))
    if not place.startswith(where) or found is None:
        if error.where and where in error.where:
            return error
        return error.at(where)
    leg, key = found.groups()
    at: tuple[str | int, ...] = () if leg is None else ("legs", int(leg) - 1)
    if key is not None:
        at = (*at, *key.split("."))
    located_at = place_of(path, lines, at) if at else place
    return error.moved_to(located_at)


def _first_error(
    error: ValidationError, data: dict[str, Any], lines: Lines, path: Path
) -> InputError:
    # Of a union's alternatives the one that went deepest is the one the user meant; an unknown
    # key says most of all, as it often explains a missing one.
    problems = error.errors(include_url=False)
    chosen = max(problems, key=lambda p: (p["type"] == "extra_forbidden", len(p["loc"])))
    kind = chosen["type"]
    at = _keys(chosen["loc"], data, kind)
    got = chosen["input"]
    got = "nothing" if got is None or got == "" else repr(got) if isinstance(got, str) else got
    if kind == "extra_forbidden":
        close = get_close_matches(str(at[-1]), _known_keys() - {at[-1]}, n=3)
        what, got = "unknown key", repr(at[-1])
        expected = f"keys of the file format (closest: {', '.join(close)})" if close else None
    elif kind == "missing":
        what, expected, got = f"key {at[-1]!r} is missing", None, None
    elif kind in ("union_tag_invalid", "union_tag_not_found"):
        what, expected, at = "unknown kind", _KINDS, ("kind",)
        got = repr(data["kind"]) if "kind" in data else "no key 'kind'"
    elif kind == "value_error":
        what, expected, got = chosen["msg"].removeprefix("Value error, "), None, None
    else:
        what, expected = "cannot be used", _expectation(chosen)
        if kind in ("too_short", "too_long"):
            what, got = "wrong count", str(len(got))
    return InputError(what, where=place_of(path, lines, at), expected=expected, got=got)


def _keys(location: tuple[str | int, ...], data: Any, kind: str) -> tuple[str | int, ...]:
    """Keys of the file in pydantic's location, which also names the branches of unions."""
    at: list[str | int] = []
    for i, part in enumerate(location[1:], start=2):
        here = isinstance(data, dict) and isinstance(part, str) and part in data
        if here or (isinstance(data, list) and isinstance(part, int)):
            at.append(part)
            data = data[part]
        elif kind == "missing" and i == len(location):
            at.append(part)
    return tuple(at)


def _known_keys() -> set[str]:
    models: list[type[BaseModel]] = [_Model]
    keys: set[str] = set()
    while models:
        model = models.pop()
        keys.update(model.model_fields)
        models.extend(model.__subclasses__())
    return keys


_TYPES = {
    "float_type": "a number",
    "finite_number": "a finite number",
    "string_type": "text",
    "string_unicode": "text",
    "string_too_short": "text",
    "bool_type": "true or false",
    "list_type": "a list",
    "dict_type": "a mapping of keys",
    "model_type": "a mapping of keys",
}


def _expectation(problem: Any) -> str:
    """What pydantic would have accepted, in the words of the file."""
    kind, context = problem["type"], problem.get("ctx", {})
    if kind in _TYPES:
        return _TYPES[kind]
    if kind == "too_short":
        return f"at least {context['min_length']}"
    if kind == "too_long":
        return f"at most {context['max_length']}"
    if kind == "string_too_long":
        return f"at most {context['max_length']} characters"
    if kind == "less_than_equal":
        return f"at most {context['le']:g}"
    if kind == "greater_than_equal":
        least = context["ge"]
        if least > 0:
            return f"above zero (at least {least:g})"
        return "zero or more" if least == 0 else f"at least {least:g}"
    message = problem["msg"].removeprefix("Input should be ")
    return str(message[0].lower() + message[1:])
