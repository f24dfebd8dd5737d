"""Classes of files of bodies on chains: legs by name or by description."""

from __future__ import annotations

import math
import re
from typing import Annotated, Any, Literal

from pydantic import Discriminator, Field, PrivateAttr, Tag, model_validator

from cartstiff.files.schema import (
    RIGID,
    Each,
    Effort,
    FileModel,
    FileWords,
    FlexibleModel,
    Joints,
    JointSpringModel,
    Limits,
    LineModel,
    NamedSprings,
    Number,
    PoseModel,
    Positive,
    Ring,
    Sliding,
    Text,
    Turning,
    Two,
    UnitsModel,
    Vector,
    Vectors,
    keyed,
    only_one,
    with_unit,
)

Stiffness = Annotated[Positive, with_unit("joint"), RIGID]
_Word = Literal["radial", "tangential", "vertical"]
Direction = _Word | Vector | Vectors
_PerLeg = Each[Positive]

#: Chains that can be drawn: struts, then rails and cranks; a rod between two balls spins
#: freely.
_KNOWN_CHAINS = re.compile(r"[URS]P[URS]?|[UR]C[UR]|[PR][URS][URS]")
_CHAIN_EXAMPLES = (
    "a strut such as UPS, RPS, SPS, UPU, UCU, UP; a rail such as PUS, PRS, PUU; a crank "
    "such as RUS, RUU, RSS, RRR"
)


class LegEndsModel(Ring):
    """Joints on a circle about z, or points one by one."""

    half_angle: Number | None = keyed(
        "rad, between a joint and the middle of its pair; three pairs, and the two "
        "legs of a pair of the base are mirror images of each other",
        None,
    )
    angles: list[Number] | None = keyed(
        "where the joints are on the circle; default [0]",
        None,
        min_length=1,
        max_length=100,
    )
    height: Number = keyed("of the circle, along z", 0.0)
    points: list[Vector] | None = keyed(
        "instead of the circle", None, min_length=1, max_length=100
    )

    def _fits(self) -> None:
        super()._fits()
        only_one(self, "radius", "points")
        circle = self.half_angle, self.angles, self.height or None
        if self.points is not None and circle != (None, None, None):
            raise ValueError(
                "half_angle, angles and height go with radius, not with points"
            )


class NamedLegs(FileModel):
    """Equal legs by the letters of their joints, from the ground to the body.

    Their joints are slide, crank, u1, u2, s1, ...; their links rod, crank, slider, lower,
    upper.
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
        "vertical, a vector in the leg's frame (x radial, z up), or one vector in F for "
        "each leg; default vertical for chains of R and P only, else tangential",
        None,
    )
    end_axis: Direction | None = keyed(
        "of hinges at the body, and of the body's axis of universal joints there, as "
        "axis but in P; default parallel to axis where the body is parallel to F",
        None,
    )
    rail: Direction | None = keyed(
        "direction of the rails of chains that begin with P, as axis; default vertical",
        None,
    )
    crank: _PerLeg | None = keyed("length, for chains that begin with R", None)
    rod: _PerLeg | None = keyed("length, for chains that begin with P or R", None)
    mode: Each[Literal["plus", "minus"]] | None = keyed(
        "working mode: the smaller (minus) or the larger (plus) of the two slides, or "
        "crank angles between -pi and pi, that reach the file's pose; default the "
        "smaller slide, and the crank that points outwards the more; where both do so "
        "alike, the larger angle",
        None,
    )
    actuated: list[Text] | None = keyed(
        "names of the driven joints; default slide, or crank; [] for none", None
    )
    stiffness: Each[Stiffness] | None = keyed(
        "of the driven joints, N/m or N m/rad; or rigid", None
    )
    limits: Each[Limits] | None = keyed("[least, most] of the slide or crank", None)
    effort: Effort | None = keyed(
        "largest torque (force) of each drive, or [least, largest]", None
    )
    diameter: _PerLeg | None = keyed(
        "of the rods, or struts, which must not touch each other", None
    )
    turns: dict[Text, Limits] = keyed(
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
                "strut is of kind stewart-gough, whose legs have no joints with names; "
                "here joints "
                "have springs: {u1: {stiffness: 33}, ...}, and links may be flexible"
            )
        return value

    def _fits(self) -> None:
        if not _KNOWN_CHAINS.fullmatch(self.chain):
            raise ValueError(f"unknown chain {self.chain!r} (expected {_CHAIN_EXAMPLES})")
        first, strut = self.chain[0], self.chain[1] in "PC"
        only_at_end = self.chain[0 if strut else 1] == "S" and first != "R"
        if self.end_axis is not None and only_at_end:
            only_one(self, "axis", "end_axis", needed=False)
        if self.turn is not None and self.platform.half_angle is None:
            raise ValueError(
                "turn is of the platform's pairs: give its half_angle, or angles"
            )
        has = {"rail": first == "P", "mode": not strut, "rod": not strut}
        has["end_axis"] = len(self.chain) > 2 and self.chain[-1] in "RU"
        has["crank"] = first == "R" and not strut
        for key, belongs in has.items():
            is_given = getattr(self, key) is not None
            if is_given and not belongs:
                raise ValueError(f"a leg {self.chain} has no {key}")
            if belongs and not is_given and key in ("rod", "crank"):
                raise ValueError(f"a leg {self.chain} needs {key}: its length")
        if self.actuated == [] and self.stiffness is not None:
            raise ValueError("stiffness is of driven joints, and actuated is empty")


_Across = Annotated[Sliding, RIGID]


class ContactStiffnessModel(FileModel):
    """Springs between a fingertip and the body, along the axes of their contact."""

    normal: _Across = keyed("along its z, N/m; default rigid", math.inf)
    tangential: _Across | Two[_Across] = keyed(
        "along its x and y, N/m: one number or two; default rigid", math.inf
    )
    spin: Turning | None = keyed("about its z, N m/rad; default 0: free", None)

    rpy: Vector = keyed(
        "the contact's axes in the chain's end frame, roll, pitch, yaw in rad; z is the "
        "normal, about which it spins",
        [0.0, 0.0, 0.0],
    )

    def by_joint(self) -> dict[str, float]:
        """Springs by the joint of the contact that they are in: contact.tx, ...,
        contact.z.
        """
        if isinstance(self.tangential, list):
            x, y = self.tangential
        else:
            x, y = [self.tangential] * 2
        each = {"contact.tx": x, "contact.ty": y, "contact.tz": self.normal}
        springs = {name: k for name, k in each.items() if k != math.inf}
        return springs if self.spin is None else {**springs, "contact.z": self.spin}


class LegModel(Joints):
    """One chain of a parallel mechanism, from the ground to the body."""

    kind: Literal["serial"] = "serial"
    base: PoseModel = keyed("the chain's root in F", PoseModel.model_construct())
    grip: PoseModel = keyed(
        "the chain's end frame in the body frame", PoseModel.model_construct()
    )
    contact: Literal["rigid", "soft-finger", "point"] = keyed(
        "joint between chain and body: none, spin about z, or a ball", "rigid"
    )
    contact_stiffness: ContactStiffnessModel | None = keyed(
        "of a soft-finger or point contact: joints contact.tx, .ty, .tz with springs, "
        "which balance the load at q as those of other joints without rest",
        None,
    )
    _drawing: Any = PrivateAttr(default=None)

    def _fits(self) -> None:
        super()._fits()
        if isinstance(self.springs, NamedSprings):
            raise ValueError(
                f"springs {self.springs.name!r}: a name is read in kind serial and "
                "closed-chain; give the springs of a leg by joint"
            )
        if self.contact_stiffness is None:
            return
        if self.contact == "rigid":
            raise ValueError("contact_stiffness is of a contact: soft-finger or point")
        for name in self.contact_stiffness.by_joint():
            if name in self.springs or name in self.passive:
                raise ValueError(
                    f"contact_stiffness has the spring of {name}: give it once"
                )

    @property
    def contact_springs(self) -> dict[str, float]:
        """Springs of the contact's joints, by name."""
        return {} if self.contact_stiffness is None else self.contact_stiffness.by_joint()

    @property
    def drawing(self) -> Any:
        """Drawing of a leg by name; None for a leg with a robot description."""
        return self._drawing

    def drawn(self, drawing: Any) -> LegModel:
        """Return the leg with its drawing, which replaces a robot description."""
        leg = self.model_copy()
        leg._drawing = drawing
        return leg


def _kind_of_leg(leg: Any) -> str:
    """Tag of the kind of leg to which errors refer; no tag is a key of the file."""
    is_named = isinstance(leg, NamedLegs) or (isinstance(leg, dict) and "chain" in leg)
    return "<by name>" if is_named else "<described>"


def _kind_of_legs(legs: Any) -> str:
    return "<by name>" if isinstance(legs, (dict, NamedLegs)) else "<list>"


_Leg = Annotated[
    Annotated[LegModel, Tag("<described>")] | Annotated[NamedLegs, Tag("<by name>")],
    Discriminator(_kind_of_leg),
]
_Legs = Annotated[
    Annotated[NamedLegs, Tag("<by name>")]
    | Annotated[list[_Leg], Field(min_length=1, max_length=100), Tag("<list>")],
    Discriminator(_kind_of_legs),
]


class ParallelFile(FileWords):
    """One body carried by several chains."""

    kind: Literal["parallel"]
    units: UnitsModel = keyed(
        "of all numbers, for legs by name: with mm a stiffness is in N/mm or N mm/rad; "
        "force is N",
        UnitsModel.model_construct(),
    )
    legs: _Legs = keyed("legs by name, or chains one by one, or a list of both")
    pose: PoseModel | None = keyed(
        "the body's own frame in F, where the legs are put together; legs by "
        "name need it",
        None,
    )
    offset: PoseModel = keyed("M in the body's own frame", PoseModel.model_construct())
    actuated: list[Text] = keyed("joints as leg1/joint_name", [])
    lines: list[LineModel] = []

    @property
    def entries(self) -> list[Any]:
        """Entries of legs, as a list."""
        return self.legs if isinstance(self.legs, list) else [self.legs]
