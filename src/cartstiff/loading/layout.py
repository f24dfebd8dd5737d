r"""Six legs by radii and angles in place of twelve points.

The joints of a ring stand in pairs 120 degrees apart, or wherever their angles say. Legs 2i+1 and
2i+2 stand on pair i of the base, at :math:`120° i \mp \alpha`; they go to the two neighbouring
pairs of the platform, whose middles are turned by `turn`: to :math:`120° (i-1) + \tau + \beta`
and to :math:`120° i + \tau - \beta`. A half angle of zero brings two joints together: with both
zero it is a 3-3 platform, with that of the platform a 6-3, with none a 6-6.

A cubic platform has its legs along the six edges of a cube that join two opposite triangles of its
vertices, its diagonal along z [GengHaynes1994]_. It is the 3-3 ring layout of radius edge times
:math:`\sqrt{2/3}`; joints elsewhere on the edges' lines leave the lines as they are.
"""

from __future__ import annotations

import math
from typing import Any, Literal

import numpy as np
from pydantic import Field, model_validator

from cartstiff.geometry.se3 import Array
from cartstiff.loading.key_types import FileModel, NotNegative, Number, Positive, Vector, only_one

_THIRD = 2.0 * math.pi / 3.0


class RingModel(FileModel):
    """The joints of base or platform, on a circle around z."""

    radius: Positive | None = Field(default=None, description="of the circle; not for a cube")
    half_angle: NotNegative | None = Field(
        default=None,
        description="rad, between a joint and the middle of its pair; default 0, one point",
    )
    angles: list[Number] | None = Field(
        default=None,
        min_length=1,
        max_length=6,
        description="rad, of each leg's joint, in place of that",
    )
    height: Number | None = Field(
        default=None,
        description="of the circle, along z of F for the base, of P for the platform; default "
        "0, for a cube that of its vertices",
    )

    @model_validator(mode="after")
    def _one(self) -> RingModel:
        only_one(self, "half_angle", "angles", needed=False)
        return self


class CubicModel(FileModel):
    """A cube with its diagonal along z; the legs lie along six of its edges."""

    edge: Positive | None = None
    size: Positive | None = Field(
        default=None, description="height between its two triangles of vertices: edge / sqrt(3)"
    )
    centre: Vector | Number = Field(default=0.0, description="in F; one number: on z")

    @model_validator(mode="after")
    def _one(self) -> CubicModel:
        only_one(self, "edge", "size")
        return self


class LayoutModel(FileModel):
    """Where the joints of a Stewart-Gough platform stand, by radii and angles, or in a cube."""

    base: RingModel = Field(default=RingModel(), description="joints on the ground")
    platform: RingModel = Field(default=RingModel(), description="joints on the platform")
    height: Number | None = Field(
        default=None, description="of P over F; 0 for a cube if absent, else needed"
    )
    turn: Number | None = Field(
        default=None, description="rad, of the platform's pairs against the base's; default pi/3"
    )
    symmetry: Literal[1, 2, 3, 6] | None = Field(
        default=None,
        description="angles are given for one part of so many; the others follow by turning",
    )
    cubic: CubicModel | None = None

    @model_validator(mode="after")
    def _fits(self) -> LayoutModel:
        rings = {"base": self.base, "platform": self.platform}
        if self.cubic is not None:
            for name, ring in rings.items():
                for key in ("radius", "half_angle", "angles"):
                    if getattr(ring, key) is not None:
                        raise ValueError(f"{name}.{key} is not for a cubic layout")
            for key in ("turn", "symmetry"):
                if getattr(self, key) is not None:
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
