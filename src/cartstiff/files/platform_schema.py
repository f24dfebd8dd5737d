"""Classes of files of bodies on line springs: Stewart-Gough platforms,
springs and cables.
"""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import field_validator, model_validator

from cartstiff.core import numerics
from cartstiff.core.arrays import Array
from cartstiff.core.errors import InputError, UnknownNameError
from cartstiff.files.plausible import is_inertia
from cartstiff.files.schema import (
    IN_ORDER,
    RIGID,
    Each,
    FileModel,
    FileWords,
    Flag,
    FlexibleModel,
    Limits,
    NotNegative,
    Number,
    PerLeg,
    PoseModel,
    Positive,
    Ring,
    Sliding,
    Turning,
    Two,
    UnitsModel,
    Vector,
    Vectors,
    keyed,
    only_one,
)


class RingModel(Ring):
    """The joints of base or platform, on a circle around z."""


class CubicModel(FileModel):
    """A cube with its diagonal along z; the legs lie along six of its edges."""

    edge: Positive | None = None
    size: Positive | None = keyed(
        "height between its two triangles of vertices: edge / sqrt(3)", None
    )
    centre: Vector | Number = keyed("in F; one number: on z", 0.0)

    def _fits(self) -> None:
        only_one(self, "edge", "size")


_RING_KEYS = ("radius", "half_angle", "angles")


class LayoutModel(FileModel):
    """Joints of a Stewart-Gough platform by radii and angles, or in a cube."""

    base: RingModel = keyed("joints on the ground", RingModel.model_construct())
    platform: RingModel = keyed("joints on the platform", RingModel.model_construct())
    height: Number | None = keyed(
        "of P over F; 0 for a cube if absent, else needed", None
    )
    turn: Number | None = keyed(
        "rad, of the platform's pairs against the base's; default pi/3", None
    )
    symmetry: Literal[1, 2, 3, 6] | None = keyed(
        "angles are given for one part of so many; the others follow by turning", None
    )
    cubic: CubicModel | None = None

    def _fits(self) -> None:
        rings = {"base": self.base, "platform": self.platform}
        if self.cubic is None:
            self._fits_circles(rings)
            return
        others = {f"{n}.{k}": getattr(r, k) for n, r in rings.items() for k in _RING_KEYS}
        others |= {"turn": self.turn, "symmetry": self.symmetry}
        for key, value in others.items():
            if value is not None:
                raise ValueError(f"{key} is not for a cubic layout")

    def _fits_circles(self, rings: dict[str, RingModel]) -> None:
        """Refuse what is missing, or more than the circles need."""
        if self.height is None:
            raise ValueError("key 'height' is missing: the height of P over F")
        for name, ring in rings.items():
            if ring.radius is None:
                raise ValueError(f"key 'radius' of {name} is missing")
            self._check_count(name, len(ring.angles or ()))
        if self.symmetry is not None and not (self.base.angles or self.platform.angles):
            raise ValueError("symmetry is for angles; pairs stand 120 degrees apart")
        if self.turn is not None and self.platform.angles is not None:
            raise ValueError(
                "turn is for pairs: angles of the platform say where its joints are"
            )

    def _check_count(self, name: str, count: int) -> None:
        """Refuse angles that are not one for each leg of a part."""
        each = 6 // (self.symmetry or 1)
        if count not in (0, each):
            of = f" with symmetry {self.symmetry}" if self.symmetry else ""
            raise ValueError(f"{name}.angles must be {each}{of}: there are {count}")

    def points(self) -> tuple[Array, Array, Array]:
        """Return joints of the base in F (6, 3) and the platform in P (6, 3),
        and P's origin.
        """
        if self.cubic is not None:
            return self._cube(self.cubic)
        origin = np.array([0.0, 0.0, self.height or 0.0])
        return self._ring(self.base, True), self._ring(self.platform, False), origin

    def _ring(self, ring: RingModel, is_base: bool) -> Array:
        if ring.angles is not None:
            return ring.joints(ring.angles, self.symmetry or 1)
        return ring.joints(ring.pair(self.turn, is_base), 3)

    def _cube(self, cubic: CubicModel) -> tuple[Array, Array, Array]:
        size = cubic.size or (cubic.edge or 0.0) / math.sqrt(3.0)
        centre = cubic.centre if isinstance(cubic.centre, list) else [0, 0, cubic.centre]
        ring = RingModel(radius=math.sqrt(2.0) * size)
        base, top = (
            ring.joints(ring.pair(None, is_base), 3) + centre + [0.0, 0.0, height]
            for is_base, height in ((True, -size / 2.0), (False, size / 2.0))
        )
        origin = np.array([0.0, 0.0, self.height or 0.0])
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

    @field_validator("inertia")
    @classmethod
    def _is_of_a_body(cls, rows: list[list[float]]) -> list[list[float]]:
        if numerics.asymmetry(inertia := np.array(rows, float)):
            raise InputError("inertia is not symmetric", got=rows)
        if not is_inertia(inertia):
            raise InputError(
                "no body has these moments of inertia",
                expected="each at most the sum of the other two",
                got=np.linalg.eigvalsh(inertia).tolist(),
            )
        return rows


class LegMassModel(FileModel):
    """Two straight bars in each leg.

    Each reaches from its joint to twice its centre's distance.
    """

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


class FlexureModel(FileModel):
    """A flexure joint of a strut: a spring, or none, for each of its six motions."""

    axial: Annotated[Sliding, RIGID] = keyed(
        "along the strut, force per length; default rigid", math.inf
    )
    shear: Annotated[Sliding, RIGID] = keyed(
        "across the strut, force per length; default rigid", math.inf
    )
    bending: Annotated[Turning, RIGID] = keyed(
        "about axes across it, N m/rad whatever the units"
    )
    torsion: Annotated[Turning, RIGID] = keyed(
        "about its axis, N m/rad whatever the units; or rigid"
    )
    offset: NotNegative = keyed(
        "from the leg's point to the flexure, along the strut", 0.0
    )


class StrutModel(FileModel):
    """Legs as struts between flexure joints, straight with the platform at the
    file's pose.
    """

    axial: Each[Sliding] = keyed(
        "stiffness along the strut without its flexures; one number or one per leg"
    )
    lower: FlexureModel = keyed("at the base")
    upper: FlexureModel = keyed("at the platform")
    mass: LegMassModel | PerLeg | None = keyed("in place of mass in legs", None)

    def _fits(self) -> None:
        if self.lower.torsion == self.upper.torsion == 0.0:
            raise ValueError(
                "the strut would spin: one of its flexures needs torsion above 0"
            )
        if self.lower.bending == math.inf and self.upper.bending == math.inf:
            raise ValueError("one of the flexures must bend: both are rigid")


class LinesLegs(FileModel):
    """Springs in the legs; one number for all or one per leg."""

    stiffness: Each[Sliding] | None = keyed(
        "of legs between ideal joints, force per length", None
    )
    strut: StrutModel | None = keyed(
        "in place of stiffness: legs with flexure joints", None
    )
    rest_length: PerLeg | None = keyed(
        "length without tension: a fixed number, at every pose; a driven leg changes it "
        "for a given load only",
        None,
    )
    preload: Each[Number] | None = keyed(
        "in place of rest_length. Of a driven leg: its tension at every commanded pose, "
        "to which the drive winds it; more legs than motions have the tensions nearest "
        "to it that balance weight and load. Of a passive one: its tension at the "
        "file's pose, which fixes its rest length",
        None,
    )
    driven: Each[Flag] | None = keyed(
        "a drive changes the length; default: legs of a stewart-gough, and cables, are "
        "driven, other springs are passive",
        None,
    )
    limits: Each[Annotated[Two[Positive], IN_ORDER]] | None = keyed(
        "[shortest, longest], or one pair per leg; or {length: ..., force: ...}, each as "
        "limits and force",
        None,
    )
    base_joints: LegJointsModel | None = None
    platform_joints: LegJointsModel | None = None
    diameter: PerLeg | None = keyed("of the legs, which must not touch each other", None)
    force: Each[Limits] | None = keyed(
        "[least, largest] tension, or one pair per leg; compression below zero", None
    )
    mass: LegMassModel | PerLeg | None = keyed(
        "bars of the legs; or kg of each leg, as a uniform bar of the leg's length at "
        "the file's pose, one half of it on either joint",
        None,
    )
    damping: PerLeg = keyed("dampers along the legs, force per velocity (seconds)", 0.0)

    @model_validator(mode="before")
    @classmethod
    def _bounds(cls, value: dict[str, Any]) -> dict[str, Any]:
        """Limits by name become those of lengths and of forces."""
        bounds = value.get("limits") if isinstance(value, dict) else None
        if not isinstance(bounds, dict):
            return value
        if unknown := bounds.keys() - {"length", "force"}:
            raise UnknownNameError("key of limits", unknown.pop(), ("length", "force"))
        if "force" in bounds and value.get("force") is not None:
            raise InputError("give force or limits.force, not both", where="force")
        rest = {key: x for key, x in value.items() if key != "limits"}
        own = {"limits": bounds.get("length"), "force": bounds.get("force")}
        return rest | {key: x for key, x in own.items() if x is not None}

    def _fits(self) -> None:
        if self.stiffness is None and self.strut is None:
            raise ValueError("key 'stiffness' is missing: give stiffness, or strut")
        only_one(self, "stiffness", "strut")
        only_one(self, "rest_length", "preload", needed=False)
        if self.strut is not None and None not in (self.strut.mass, self.mass):
            raise ValueError("give mass in legs or in strut, not both")


class _BodyOnLines(FileWords):
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

    @model_validator(mode="before")
    @classmethod
    def _says_once(cls, value: dict[str, Any]) -> dict[str, Any]:
        if value.get("layout") is not None:
            for key in value.keys() & {"base", "platform", "pose"}:
                raise InputError(f"give layout or {key}, not both", where=key)
        return value

    @model_validator(mode="after")
    def _has_points(self) -> PlatformFile:
        if self.layout is not None:
            base, platform, origin = (points.tolist() for points in self.layout.points())
            points = {"base": base, "platform": platform, "pose": PoseModel(xyz=origin)}
            return self.model_copy(update=points)
        for key in ("base", "platform"):
            if not getattr(self, key):
                raise ValueError(
                    f"key '{key}' is missing: give base and platform, or layout"
                )
        return self


class SpringsFile(_BodyOnLines):
    """A body held by any number of line springs or cables from the ground."""

    kind: Literal["springs"]
    base: Vectors = keyed("anchor points in F")
    platform: Vectors = keyed("points of the body in P")
    unilateral: Each[Flag] = keyed("cables: they cannot push; or one per line", False)

    def _fits(self) -> None:
        if np.any(self.unilateral) and self.legs.strut is not None:
            raise ValueError("struts can push: unilateral is for cables")
