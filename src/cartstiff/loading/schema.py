"""The mechanism file as data classes; every key, its type and its meaning stand here once."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import (
    BaseModel,
    ConfigDict,
    Discriminator,
    Field,
    PlainValidator,
    PrivateAttr,
    Tag,
    TypeAdapter,
    ValidationInfo,
    WithJsonSchema,
    WrapValidator,
    model_validator,
)
from pydantic_core import PydanticCustomError

from cartstiff.arrays import Array
from cartstiff.errors import InputError, check_name, one_line
from cartstiff.geometry import se3
from cartstiff.loading.yaml_file import LARGEST_NUMBER, read_text
from cartstiff.mechanisms.contract import GivenStiffness
from cartstiff.mechanisms.elastic import ElasticMechanism
from cartstiff.mechanisms.elements import Elements, coefficient, law_of
from cartstiff.mechanisms.identified import CompliancePattern, Identified
from cartstiff.mechanisms.superelement import (
    SuperelementMass,
    superelement_mass,
    superelement_spring,
)
from cartstiff.notes import Note

_MOST = LARGEST_NUMBER
Number = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=-_MOST, le=_MOST)]
Positive = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=1 / _MOST, le=_MOST)]
NotNegative = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=0, le=_MOST)]
Text = Annotated[str, Field(strict=True, min_length=1, max_length=4000)]
Vector = Annotated[list[Number], Field(min_length=3, max_length=3)]


def _stiff(value: Any, check: Any) -> Any:
    number = math.inf if value in ("rigid", math.inf) else check(value)
    # Its unit says later whether it is of a joint that slides or turns.
    return value if isinstance(value, GivenStiffness) else number


#: A number, which may have come with a unit, or the word for an infinite one.
RIGID = WrapValidator(_stiff)


def keyed(words: str, default: Any = ..., **rules: Any) -> Any:
    """A key of a file by its meaning; it is needed unless it has a default."""
    return Field(default=default, description=words, **rules)


class FileModel(BaseModel):
    """A mapping in a mechanism file: no other keys, and immutable."""

    # Built when it is first used: a file uses few of them.
    model_config = ConfigDict(extra="forbid", frozen=True, defer_build=True)


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
    # YAML reads true as a truth value, and numbers as numbers; xacro takes text.
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

Pair = Annotated[list[Number], Field(min_length=2, max_length=2)]
PerLeg = NotNegative | Annotated[list[NotNegative], Field(min_length=1)]
Vectors = Annotated[list[Vector], Field(min_length=1, max_length=100_000)]


class PoseModel(FileModel):
    """A pose by translation and roll, pitch, yaw about fixed axes (radians)."""

    xyz: Vector = [0.0, 0.0, 0.0]
    rpy: Vector = [0.0, 0.0, 0.0]


def pose_of(entry: PoseModel) -> Array:
    """4x4 pose of an entry."""
    if not any(entry.xyz) and not any(entry.rpy):
        return np.eye(4)
    return se3.from_roll_pitch_yaw(entry.xyz, entry.rpy)


class UnitsModel(FileModel):
    """Units of lengths and forces; angles are rad, masses kg, gravity m/s^2 in every file."""

    length: Literal["m", "dm", "cm", "mm", "um", "in", "ft"] = "m"
    force: Literal["N", "kN", "mN", "daN", "lbf", "kgf"] = "N"


def only_one(model: BaseModel, *keys: str, needed: bool = True) -> None:
    """Refuse a model that gives more than one of the keys, or none where one is needed."""
    count = sum(getattr(model, key) is not None for key in keys)
    if needed and count != 1:
        raise ValueError(f"give exactly one of {', '.join(keys)}")
    if count > 1:
        raise ValueError(f"give {' or '.join(keys)}, not both")


_THIRD = 2.0 * math.pi / 3.0


class RingModel(FileModel):
    """The joints of base or platform, on a circle around z."""

    radius: Positive | None = keyed("of the circle; not for a cube", None)
    half_angle: NotNegative | None = keyed(
        "rad, between a joint and the middle of its pair; default 0, one point", None
    )
    angles: list[Number] | None = keyed(
        "rad, of each leg's joint, in place of that", None, min_length=1, max_length=6
    )
    height: Number | None = keyed(
        "of the circle, along z of F for the base, of P for the platform; default "
        "0, for a cube that of its vertices",
        None,
    )

    @model_validator(mode="after")
    def _one(self) -> RingModel:
        only_one(self, "half_angle", "angles", needed=False)
        return self


class CubicModel(FileModel):
    """A cube with its diagonal along z; the legs lie along six of its edges."""

    edge: Positive | None = None
    size: Positive | None = keyed(
        "height between its two triangles of vertices: edge / sqrt(3)", None
    )
    centre: Vector | Number = keyed("in F; one number: on z", 0.0)

    @model_validator(mode="after")
    def _one(self) -> CubicModel:
        only_one(self, "edge", "size")
        return self


_OF_RINGS = ("radius", "half_angle", "angles")


class LayoutModel(FileModel):
    """Where the joints of a Stewart-Gough platform stand, by radii and angles, or in a cube."""

    base: RingModel = keyed("joints on the ground", RingModel.model_construct())
    platform: RingModel = keyed("joints on the platform", RingModel.model_construct())
    height: Number | None = keyed("of P over F; 0 for a cube if absent, else needed", None)
    turn: Number | None = keyed(
        "rad, of the platform's pairs against the base's; default pi/3", None
    )
    symmetry: Literal[1, 2, 3, 6] | None = keyed(
        "angles are given for one part of so many; the others follow by turning", None
    )
    cubic: CubicModel | None = None

    @model_validator(mode="after")
    def _fits(self) -> LayoutModel:
        rings = {"base": self.base, "platform": self.platform}
        if self.cubic is not None:
            owners = {f"{n}.{k}": getattr(r, k) for n, r in rings.items() for k in _OF_RINGS}
            owners |= {"turn": self.turn, "symmetry": self.symmetry}
            for key, value in owners.items():
                if value is not None:
                    raise ValueError(f"{key} is not for a cubic layout")
            return self
        if self.height is None:
            raise ValueError("key 'height' is missing: of P over F")
        each = 6 // (self.symmetry or 1)
        for name, ring in rings.items():
            if ring.radius is None:
                raise ValueError(f"key 'radius' of {name} is missing")
            if ring.angles is not None and len(ring.angles) != each:
                of = f" with symmetry {self.symmetry}" if self.symmetry else ""
                raise ValueError(f"{name}.angles must be {each}{of}: there are {len(ring.angles)}")
        if self.symmetry is not None and all(r.angles is None for r in rings.values()):
            raise ValueError("symmetry is for angles; pairs stand 120 degrees apart")
        if self.turn is not None and self.platform.angles is not None:
            raise ValueError("turn is for pairs: angles of the platform say where its joints are")
        return self

    def points(self) -> tuple[Array, Array, Array]:
        """Joints of the base in F (6, 3), of the platform in P (6, 3), and the origin of P in F."""
        if self.cubic is not None:
            return self._cube(self.cubic)
        alpha, beta = self.base.half_angle or 0.0, self.platform.half_angle or 0.0
        turn = math.pi / 3.0 if self.turn is None else self.turn
        lower = [i * _THIRD + side for i in range(3) for side in (-alpha, alpha)]
        upper = [i * _THIRD + turn + side for i in range(3) for side in (beta - _THIRD, -beta)]
        origin = np.array([0.0, 0.0, self.height or 0.0])
        return self._ring(self.base, lower), self._ring(self.platform, upper), origin

    def _ring(self, ring: RingModel, angles: list[float]) -> Array:
        if ring.angles is not None:
            parts = self.symmetry or 1
            turns = [2.0 * math.pi * i / parts for i in range(parts)]
            angles = [turn + angle for turn in turns for angle in ring.angles]
        radius = ring.radius or 0.0  # a layout without is refused
        height = ring.height or 0.0
        return np.array([[radius * math.cos(a), radius * math.sin(a), height] for a in angles])

    def _cube(self, cubic: CubicModel) -> tuple[Array, Array, Array]:
        size = cubic.size if cubic.size is not None else (cubic.edge or 0.0) / math.sqrt(3.0)
        centre = np.array(cubic.centre if isinstance(cubic.centre, list) else [0, 0, cubic.centre])
        radius = math.sqrt(2.0) * size
        lower = RingModel(radius=radius, height=-size / 2.0)
        upper = RingModel(radius=radius, height=size / 2.0)
        base, top, _ = LayoutModel(base=lower, platform=upper, height=0.0).points()
        base, top, origin = base + centre, top + centre, np.array([0.0, 0.0, self.height or 0.0])
        along = (top - base) / size  # rises by one

        def cut(height: float) -> Array:
            points: Array = base + along * (height - base[:, 2:])
            points[:, 2] = height
            return points

        if self.platform.height is not None:
            top = cut(origin[2] + self.platform.height)
        if self.base.height is not None:
            base = cut(self.base.height)
        return base, top - origin, origin


def laid_out(layout: LayoutModel) -> dict[str, Any]:
    """Keys of the mechanism file that say the same as a layout."""
    base, platform, origin = layout.points()
    return {
        "base": base.tolist(),
        "platform": platform.tolist(),
        "pose": {"xyz": origin.tolist()},
    }


# Values of the file and its springs agree to this share; a person may round them.
_AGREE = 1e-3


class FoundModel(FileModel):
    """A compliance that was measured: of one spring, of springs that are equal, or of a link."""

    name: Text
    value: Number = keyed("compliance; of a beam a share of the file's own")
    elements: list[tuple[Text, Text, Number]] | None = keyed(
        "pairs of springs and factors, where it is not one spring's own", None
    )
    polynomial: tuple[Text, Annotated[int, Field(strict=True, ge=1, le=100)]] | None = keyed(
        "joint and power of a polynomial spring: of the first power the "
        "value is a compliance, of others the coefficient",
        None,
    )


class IdentifiedModel(FileModel):
    """How well the stiffnesses are known; written by `cartstiff identify -o`."""

    compliances: list[FoundModel] = Field(max_length=1000)
    covariance: list[list[Number]] = keyed("of the compliances, in the file's units")
    degrees: Positive | None = keyed("of freedom of Student's t; normal if absent", None)
    level: float = keyed("of the intervals", 0.95, gt=0.0, lt=1.0)
    rows: int = keyed("measurements, for readers", 0, strict=True, ge=0)
    date: Text | None = keyed("of the measurement, for readers", None)
    source: Text | None = keyed("what was measured, for readers", None)
    undetermined: list[Text] = keyed("springs of which the measurements say nothing", [])
    at_least: dict[str, Positive] = keyed("springs without an upper end, and the lower one", {})


def with_findings(elastic: ElasticMechanism, model: IdentifiedModel) -> ElasticMechanism:
    """The mechanism with the covariance of its measured compliances.

    Raises
    ------
    InputError
        If they do not fit each other, or the springs of the file.
    """
    elements = Elements(elastic)
    patterns, values = [], []
    for entry in model.compliances:
        law = entry.polynomial
        pairs = entry.elements or ([] if law else [(entry.name, entry.name, 1.0)])
        pattern = CompliancePattern(entry.name, tuple(pairs), law)
        if law is not None:
            _check_coefficient(elastic, law, entry)
        for a, b, weight in pairs:
            i, j = elements.index(a, "identified"), elements.index(b, "identified")
            own, size = (
                entry.value * weight,
                np.sqrt(elements.compliance[i, i] * elements.compliance[j, j]),
            )
            if not pattern.is_share and abs(elements.compliance[i, j] - own) > _AGREE * size:
                raise InputError(
                    f"compliance of {entry.name!r} is not that of the file's spring",
                    where="identified",
                    expected=f"{elements.compliance[i, j]:.6g}, or no key "
                    "'identified' with springs that were changed",
                    got=f"{own:.6g}",
                )
        patterns.append(pattern)
        values.append(entry.value)
    names = {*elements.names, *(pattern.name for pattern in patterns)}
    for name in model.at_least:
        check_name("spring", name, names, "identified.at_least")
    P = len(patterns)
    if [len(row) for row in model.covariance] != [P] * P:
        raise InputError(
            "covariance has the wrong shape",
            where="identified",
            expected=f"{P} rows of {P} numbers",
        )
    identified = Identified(
        tuple(patterns),
        np.array(values),
        np.array(model.covariance).reshape(P, P),
        model.degrees,
        model.level,
        model.rows,
        model.date or "",
        model.source or "",
        tuple(model.undetermined),
        dict(model.at_least),
    )
    notes = list(elastic.notes)
    if model.undetermined:
        words = (
            "the measurements say nothing about these springs, whose stiffness in the file is an "
            f"assumption: {', '.join(model.undetermined)}"
        )
        notes.append(Note("stiffness-not-identified", words, {"joints": model.undetermined}))
    return replace(elastic, notes=tuple(notes), identified=identified)


def _check_coefficient(elastic: ElasticMechanism, law: tuple[str, int], entry: FoundModel) -> None:
    """Refuse a polynomial's coefficient that is not that of the file."""
    (name, power), where = law, "identified"
    if entry.elements is not None:
        raise InputError(
            f"{entry.name!r} has elements and a polynomial", where=where, expected="one of both"
        )
    c = law_of(elastic, name, where).coefficients
    if power > len(c) or (power == 1 and not c[0] > 0.0):
        raise InputError(
            f"{entry.name!r} is no coefficient of the spring",
            where=where,
            expected=f"powers 1 to {len(c)}",
            got=power,
        )
    own = coefficient(elastic, law)
    if abs(own - entry.value) > _AGREE * abs(own):
        raise InputError(
            f"value of {entry.name!r} is not that of the file's spring",
            where=where,
            expected=f"{own:.6g}, or no key 'identified' with springs that were changed",
            got=f"{entry.value:.6g}",
        )


class PayloadModel(FileModel):
    """A point mass carried by the body."""

    mass: NotNegative = keyed("kg, whatever the units")
    com: Vector = keyed("mass centre in the body frame M", [0.0, 0.0, 0.0])


class BodyModel(FileModel):
    """The platform's own mass, for vibrations and gravity."""

    mass: NotNegative = keyed("kg, whatever the units")
    com: Vector = keyed("mass centre in P", [0.0, 0.0, 0.0])
    inertia: list[Vector] | None = keyed(
        "3x3 about the mass centre, axes of P; kg and the file's length squared",
        None,
        min_length=3,
        max_length=3,
    )


class LegMassModel(FileModel):
    """Two straight bars in each leg; each reaches from its joint to twice its centre's distance."""

    fixed: PerLeg = keyed("kg, of the bar on the base's joint", 0.0)
    moving: PerLeg = keyed("kg, of the bar on the platform's joint", 0.0)
    fixed_com: PerLeg = keyed("distance of its centre from the base's joint", 0.0)
    moving_com: PerLeg = keyed("distance of its centre from the platform's joint", 0.0)
    radius: PerLeg = keyed("of both bars; 0 for slender ones", 0.0)


class LegJointsModel(FileModel):
    """Universal or spherical joints at one end of the legs, and how far they turn."""

    axis: Vector | Vectors = keyed(
        "middle direction of the leg seen from the joint, or one per leg; in F "
        "at the base, in P at the platform"
    )
    angle: PerLeg = keyed("largest angle of the leg from it, rad")


_Lengths = Annotated[list[Positive], Field(min_length=2, max_length=2)]


class FlexureModel(FileModel):
    """A flexure joint of a strut: a spring, or none, for each of its six motions."""

    axial: Annotated[Positive, RIGID] = keyed(
        "along the strut, force per length; default rigid", math.inf
    )
    shear: Annotated[Positive, RIGID] = keyed(
        "across the strut, force per length; default rigid", math.inf
    )
    bending: Annotated[NotNegative, RIGID] = keyed(
        "about axes across it, N m/rad whatever the units"
    )
    torsion: Annotated[NotNegative, RIGID] = keyed(
        "about its axis, N m/rad whatever the units; or rigid"
    )
    offset: NotNegative = keyed("from the leg's point to the flexure, along the strut", 0.0)


class StrutModel(FileModel):
    """Legs as struts between flexure joints, straight with the platform at the file's pose."""

    axial: Positive | Annotated[list[Positive], Field(min_length=1)] = keyed(
        "stiffness along the strut without its flexures; one number or one per leg"
    )
    lower: FlexureModel = keyed("at the base")
    upper: FlexureModel = keyed("at the platform")
    mass: LegMassModel | None = keyed("in place of mass in legs", None)

    @model_validator(mode="after")
    def _stands(self) -> StrutModel:
        if self.lower.torsion == self.upper.torsion == 0.0:
            raise ValueError("the strut would spin: one of its flexures needs torsion above 0")
        if self.lower.bending == math.inf and self.upper.bending == math.inf:
            raise ValueError("one of the flexures must bend: both are rigid")
        return self


class LinesLegs(FileModel):
    """Springs in the legs; one number for all or one per leg."""

    stiffness: Positive | Annotated[list[Positive], Field(min_length=1)] | None = keyed(
        "of legs between ideal joints, force per length", None
    )
    strut: StrutModel | None = keyed("in place of stiffness: legs with flexure joints", None)
    rest_length: PerLeg | None = keyed("length without tension", None)
    preload: Number | Annotated[list[Number], Field(min_length=1)] | None = keyed(
        "tension at the file's pose, instead of rest_length", None
    )
    limits: _Lengths | Annotated[list[_Lengths], Field(min_length=1)] | None = keyed(
        "[shortest, longest], or one pair per leg", None
    )
    base_joints: LegJointsModel | None = None
    platform_joints: LegJointsModel | None = None
    diameter: PerLeg | None = keyed("of the legs, which must not touch each other", None)
    force: Pair | Annotated[list[Pair], Field(min_length=1)] | None = keyed(
        "[least, largest] tension, or one pair per leg; compression below zero", None
    )
    mass: LegMassModel | None = None
    damping: PerLeg = keyed("dampers along the legs, force per velocity (seconds)", 0.0)

    @model_validator(mode="after")
    def _one(self) -> LinesLegs:
        if self.stiffness is None and self.strut is None:
            raise ValueError("key 'stiffness' is missing: give stiffness, or strut")
        only_one(self, "stiffness", "strut")
        only_one(self, "rest_length", "preload", needed=False)
        if self.strut is not None and None not in (self.strut.mass, self.mass):
            raise ValueError("give mass in legs or in strut, not both")
        return self


#: Bytes of a superelement's text: two hundred nodes with all digits.
_LARGEST_MATRIX = 64 * 1024 * 1024


class JointSpringModel(FileModel):
    """A spring in a joint: one of stiffness, polynomial, table."""

    stiffness: Annotated[
        NotNegative | None,
        RIGID,
    ] = keyed(
        "N m/rad, N/m for a prismatic joint, or a text with another unit such as 392 N m/arcmin; "
        "or rigid",
        None,
    )
    polynomial: list[Number] | None = keyed(
        "torque c1 x + c2 x^2 + ...", None, min_length=1, max_length=20
    )
    table: list[Pair] | None = keyed(
        "pairs [deflection, torque], deflections increasing", None, min_length=2
    )
    rest: Number | None = keyed("rest position; without it the spring balances the load at q", None)
    damping: NotNegative | None = keyed(
        "damper beside the spring, N m s/rad or N s/m; default what the robot's file has", None
    )

    @model_validator(mode="after")
    def _one_law(self) -> JointSpringModel:
        only_one(self, "stiffness", "polynomial", "table")
        if self.stiffness == math.inf and self.rest is not None:
            raise ValueError("a rigid joint has no rest position: it stays where it is")
        return self


class BeamModel(FileModel):
    """A straight beam along the link's x axis, from clamp to clamp; it feels its axial force."""

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
    shear_area_y: Positive | None = keyed("area times shear factor, along y; rigid if absent", None)
    shear_area_z: Positive | None = keyed("the same along z", None)
    density: NotNegative = keyed(
        "kg per volume: the beam's own mass, lumped as rigid half segments at its "
        "nodes; the link's inertia in the robot's file stays at the near end besides",
        0.0,
    )


class SuperelementModel(FileModel):
    """A link's stiffness matrix from a finite-element program, reduced to a few nodes."""

    K: FileName = keyed(
        "text file, relative to this one: 6 N rows of 6 N numbers, forces per "
        "displacement of the free body"
    )
    M: FileName | None = keyed(
        "text file: mass matrix in the same rows, kg; Guyan's reduction to base and "
        "tip makes it one body that follows a share of the deflection. The link's inertia in the "
        "robot's file stays at the near end besides",
        None,
    )
    nodes: Vectors = keyed("the N nodes, in the link's frame (moved by `offset`)")
    base: int = keyed(
        "index, from 0, of the node that is fixed to the link's near side", 0, strict=True
    )
    tip: int = keyed(
        "index of the node that carries what is beyond; -1 is the last", -1, strict=True
    )
    order: Literal["linear-angular", "angular-linear"] = keyed(
        "of each node's six rows", "linear-angular"
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

    stiffness: list[Annotated[list[Number], Field(min_length=6, max_length=6)]] | None = keyed(
        "6x6, in the file's units", None, min_length=6, max_length=6
    )
    beam: BeamModel | None = None
    superelement: SuperelementModel | None = None
    offset: PoseModel = keyed(
        "place of the spring in the link's frame", PoseModel.model_construct()
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
    preload: Number | None = keyed("tension at q", None)
    unilateral: Flag = False

    @model_validator(mode="after")
    def _one(self) -> LineModel:
        only_one(self, "rest_length", "preload", needed=False)
        return self


Stiffness = Annotated[Positive, RIGID]
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
    half_angle: Number | None = keyed(
        "rad, between a joint and the middle of its pair; three pairs, and the two "
        "legs of a pair of the base are mirror images of each other",
        None,
    )
    angles: list[Number] | None = keyed(
        "where the joints are on the circle; default [0]", None, min_length=1, max_length=100
    )
    height: Number = keyed("of the circle, along z", 0.0)
    points: list[Vector] | None = keyed("instead of the circle", None, min_length=1, max_length=100)

    @model_validator(mode="after")
    def _one(self) -> LegEndsModel:
        only_one(self, "radius", "points")
        on_circle = self.half_angle is not None or self.angles is not None or self.height != 0.0
        if self.points is not None and on_circle:
            raise ValueError("half_angle, angles and height go with radius, not with points")
        only_one(self, "half_angle", "angles", needed=False)
        return self


class NamedLegs(FileModel):
    """Equal legs by the letters of their joints, from the ground to the body.

    Their joints are slide, crank, u1, u2, s1, ...; their links rod, crank, slider, lower, upper.
    """

    chain: Text = keyed(
        "joints from the ground to the body: R revolute, P prismatic, U universal, "
        "S spherical, C cylindrical; such as UPS, PUS, RUS, RPS, PRS, UPU, RUU, RRR"
    )
    base: LegEndsModel = keyed("first joints, in F")
    platform: LegEndsModel = keyed("last joints, in the body's frame P")
    symmetry: int | None = keyed(
        "how often what base and platform give is repeated about z; default 3, and "
        "1 where points or angles are given",
        None,
        strict=True,
        ge=1,
        le=100,
    )
    turn: Number | None = keyed(
        "rad, of the platform's pairs against the base's; default pi/3", None
    )
    axis: Direction | None = keyed(
        "of cranks, hinges and first axes of universal joints: radial, tangential, "
        "vertical, a vector in the leg's frame (x radial, z up), or one vector in F for each "
        "leg; default vertical for chains of R and P only, else tangential",
        None,
    )
    rail: Direction | None = keyed(
        "direction of the rails of chains that begin with P, as axis; default vertical", None
    )
    crank: _PerLeg | None = keyed("length, for chains that begin with R", None)
    rod: _PerLeg | None = keyed("length, for chains that begin with P or R", None)
    mode: _Mode | list[_Mode] | None = keyed(
        "working mode: the smaller (minus) or the larger (plus) of the two slides, or "
        "crank angles between -pi and pi, that reach the file's pose; default the smaller slide, "
        "and the crank that points outwards the more",
        None,
    )
    actuated: list[Text] | None = keyed(
        "names of the driven joints; default slide, or crank; [] for none", None
    )
    stiffness: Stiffness | list[Stiffness] | None = keyed(
        "of the driven joints, N/m or N m/rad; or rigid", None
    )
    limits: Pair | list[Pair] | None = keyed("[least, most] of the slide or crank", None)
    diameter: _PerLeg | None = keyed(
        "of the rods, or struts, which must not touch each other", None
    )
    turns: dict[Text, Pair] = keyed(
        "[least, most] rad of other joints by name (u1, s2, ...), zero at home; "
        "a ball is limited about each of its three axes",
        {},
    )
    springs: dict[str, JointSpringModel] = {}
    flexible: dict[str, FlexibleModel] = {}

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
    def _fits(self) -> NamedLegs:
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


class _File(FileModel):
    name: Text | None = keyed("name shown to people", None)
    description: Text | None = keyed("what the mechanism is, for readers", None)
    source: Text | None = keyed("where its numbers come from, for readers", None)
    gravity: Vector | None = keyed(
        "acceleration in F, m/s^2 whatever the units; none if absent", None
    )
    payload: PayloadModel | None = None
    parameters: dict[Text, Number | Text] = keyed(
        "names for numbers; wherever a number stands in the file, a text such as "
        "'=2*r*cos(pi/6)' may stand for it",
        {},
    )
    identified: IdentifiedModel | None = None


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
    limits: Pair | None = keyed("[least, most] of q", None)

    @model_validator(mode="after")
    def _one(self) -> DHJoint:
        if self.limits is not None and (self.type == "fixed" or self.limits[0] > self.limits[1]):
            raise ValueError("limits are [least, most] of a joint that moves")
        return self


class DHModel(FileModel):
    """An arm by Denavit-Hartenberg parameters; M is in the frame of the last row, link6 of six."""

    convention: Literal["standard", "modified"] = keyed(
        "standard: a row is Rz(theta) Tz(d) Tx(a) Rx(alpha), joint i turns about z of frame i-1; "
        "modified (Craig): Rx(alpha) Tx(a) Rz(theta) Tz(d), joint i turns about z of frame i"
    )
    joints: list[DHJoint] | None = keyed("row by row", None, min_length=1, max_length=100)
    table: FileName | None = keyed(
        "CSV in place of joints: columns joint, type, a, alpha, d, theta, lower, upper, with the "
        "units in the heads, as a [mm]",
        None,
    )
    units: DHUnits = keyed("of the numbers under joints", DHUnits.model_construct())

    @model_validator(mode="after")
    def _one(self) -> DHModel:
        only_one(self, "joints", "table")
        if self.table is not None and self.units != DHUnits():
            raise ValueError("units of a table are in its heads")
        return self


class _Robot(FileModel):
    model: FileName | None = keyed("name of a robot, or path of URDF, xacro or MJCF", None)
    dh: DHModel | None = keyed("in place of model: a Denavit-Hartenberg table", None)
    xacro: dict[str, Argument] = keyed("arguments of a xacro file by name", {})
    package_path: list[FileName] = keyed("folders in which ROS packages are looked for first", [])
    _named: tuple[str, ...] = PrivateAttr(default=())

    @model_validator(mode="after")
    def _is_described(self) -> Self:
        if self.model is None and self.dh is None:
            raise ValueError("key 'model' is missing: give model, or dh")
        only_one(self, "model", "dh")
        if self.dh is not None and (self.xacro or self.package_path):
            raise ValueError("xacro and package_path belong to model, not to dh")
        return self

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


class _Joints(_Robot):
    frame: Text | None = keyed("link or site that is the body frame M", None)
    locked: dict[str, Number] = keyed("joints held fixed", {})
    q: dict[str, Number] = keyed("default posture; a closed chain is assembled from there", {})
    springs: dict[str, JointSpringModel] = {}
    passive: list[Text] = keyed("joints without springs", [])
    flexible: dict[str, FlexibleModel] = keyed("by link name", {})


class SerialFile(_Joints, _File):
    """A serial arm."""

    kind: Literal["serial"]
    base: PoseModel = keyed(
        "the robot's own base frame B (its root) in F, the room", PoseModel.model_construct()
    )
    offset: PoseModel = keyed("M in the named frame", PoseModel.model_construct())
    lines: list[LineModel] = []


class _BodyOnLines(_File):
    units: UnitsModel = UnitsModel.model_construct()
    pose: PoseModel = keyed("P in F", PoseModel.model_construct())
    frame: PoseModel = keyed("M in P", PoseModel.model_construct())
    body: BodyModel | None = None
    legs: LinesLegs
    flexible: dict[Literal["base", "platform"], FlexibleModel] = keyed(
        "what gives between the ground and the feet of the legs (place of the spring "
        "in F), and between their heads and the body (in P)",
        {},
    )


class PlatformFile(_BodyOnLines):
    """A Stewart-Gough platform: six line springs between a base and a platform."""

    kind: Literal["stewart-gough"]
    layout: LayoutModel | None = keyed("in place of base, platform and pose", None)
    base: list[Vector] = keyed("points in F", [], min_length=6, max_length=6)
    platform: list[Vector] = keyed("points in P", [], min_length=6, max_length=6)

    @model_validator(mode="after")
    def _has_points(self) -> PlatformFile:
        for key in ("base", "platform"):
            if not getattr(self, key):
                raise ValueError(f"key '{key}' is missing: give base and platform, or layout")
        return self


class SpringsFile(_BodyOnLines):
    """A body held by any number of line springs or cables from the ground."""

    kind: Literal["springs"]
    base: Vectors = keyed("anchor points in F")
    platform: Vectors = keyed("points of the body in P")
    unilateral: Flag = keyed("cables: they cannot push", False)

    @model_validator(mode="after")
    def _pull(self) -> SpringsFile:
        if self.unilateral and self.legs.strut is not None:
            raise ValueError("struts can push: unilateral is for cables")
        return self


class LegModel(_Joints):
    """One chain of a parallel mechanism, from the ground to the body."""

    kind: Literal["serial"] = "serial"
    base: PoseModel = keyed("the chain's root in F", PoseModel.model_construct())
    grip: PoseModel = keyed("the chain's end frame in the body frame", PoseModel.model_construct())
    contact: Literal["rigid", "soft-finger", "point"] = keyed(
        "joint between chain and body: none, spin about z, or a ball", "rigid"
    )
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
    legs: _Legs = keyed("legs by name, or chains one by one, or a list of both")
    pose: PoseModel | None = keyed(
        "the body's own frame in F, where the legs are put together; legs by name need it", None
    )
    offset: PoseModel = keyed("M in the body's own frame", PoseModel.model_construct())
    actuated: list[Text] = keyed("joints as leg1/joint_name", [])
    lines: list[LineModel] = []


class ClosureModel(FileModel):
    """Two frames of the tree that coincide (weld) or share a point (point)."""

    frames: list[Text] = Field(min_length=2, max_length=2)
    type: Literal["point", "weld"]
    points: list[Vector] | None = keyed(
        "points in the frames; default origins", None, min_length=2, max_length=2
    )


class ClosedChainFile(_Joints, _File):
    """A tree from URDF or MJCF whose frames are tied by closures."""

    kind: Literal["closed-chain"]
    offset: PoseModel = PoseModel.model_construct()
    closures: list[ClosureModel] = []
    floating: Flag = keyed("the tree's root is free in F, as a walking machine's body", False)
    actuated: list[Text] = []
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
