"""What inverse kinematics gives: postures, and how they were searched for."""

from __future__ import annotations

from dataclasses import dataclass
from math import prod

import numpy as np

from cartstiff.geometry.se3 import Array


@dataclass(frozen=True)
class Search:
    """How the postures at a pose were searched for, and how many there are.

    Attributes
    ----------
    starts : int
        Starts of the search, of each leg where legs were searched one by one; 0 where all of them
        were known in closed form.
    legs : tuple of int
        Solutions found of each leg; empty where the mechanism was searched as a whole.
    found : int
        Different postures: of legs all combinations, whether they are listed or not.
    listed : int
        How many of them are in the result, the nearest to the default posture first in line.
    """

    starts: int
    legs: tuple[int, ...]
    found: int
    listed: int

    def __str__(self) -> str:
        legs = " x ".join(map(str, self.legs))
        how = f"{self.starts} starts a leg" if self.starts else "in closed form"
        whole = f"{self.found} found, {self.starts} starts"
        if legs:
            equal = prod(self.legs) == self.found
            combined = f"{legs} solutions of the legs" + ("" if equal else ", by pose of the body")
            whole = f"{self.found} found: {combined}, {how}"
        return whole + (
            f"; the nearest {self.listed} are listed" if self.listed < self.found else ""
        )


class Branches(np.ndarray):
    """Postures (k, n) as an array, with the `Search` that found them.

    Attributes
    ----------
    search : Search or None
        None for parts of the array and what is computed from it.
    """

    search: Search | None

    def __new__(cls, q: Array, search: Search | None = None) -> Branches:
        """Array of postures."""
        branches = np.array(q, float).view(cls)
        branches.search = search
        return branches

    def __array_finalize__(self, other: object) -> None:
        """Parts have been searched for by nobody."""
        self.search = None
