"""Joints on circles around z: of hexapods by their layout, and of legs by name."""

from __future__ import annotations

from typing import Self

import numpy as np
from pydantic import model_validator

from cartstiff.arrays import Array
from cartstiff.loading.schema import (
    FileModel,
    NotNegative,
    Number,
    Positive,
    keyed,
    only_one,
)


class Ring(FileModel):
    """Joints on a circle around z."""

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

    @model_validator(mode="after")
    def _one(self) -> Self:
        only_one(self, "half_angle", "angles", needed=False)
        return self

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
