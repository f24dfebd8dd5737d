"""Compliant links as springs: a symmetric matrix over the coordinates of a link."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations_with_replacement
from math import pi
from typing import Any, ClassVar, Self

import numpy as np

from cartstiff.core.arrays import Array
from cartstiff.core.geometry import se3
from cartstiff.core.notes import Note
from cartstiff.core.potentials.contract import (
    Evaluation,
    Number,
    Posture,
    Potential,
    key_of_pair,
)

# Least share of a link's Euler load for a note that a 6x6 spring neglects it: the
# deflection is too small by about that share.
_NOTED_COMPRESSION = 0.05


@dataclass(frozen=True, eq=False)
class CoupledSprings(Potential):
    """A spring over several coordinates, Phi = 1/2 x^T K x, as in a compliant link.

    Attributes
    ----------
    indices : ndarray of int, shape (m,)
        The coordinates x.
    matrix : ndarray, shape (m, m)
        Symmetric K.
    link : str
        Name of the compliant link: x is then (translation, rotation) of its far side.
    """

    indices: Array
    matrix: Array
    link: str = ""

    stem: ClassVar = "coupled springs "

    def __post_init__(self) -> None:
        for name, kind in (("indices", int), ("matrix", float)):
            array = np.array(getattr(self, name), kind)
            array.flags.writeable = False
            object.__setattr__(self, name, array)

    @property
    def members(self) -> tuple[int, ...]:  # type: ignore[override]
        """The coordinates."""
        return tuple(self.indices.tolist())

    @property
    def own_stiffness(self) -> Array:
        """K."""
        return self.matrix

    def in_file(self, entry: Mapping[str, Any]) -> dict[str, Any]:  # noqa: ARG002
        """The matrix, rotations before translations."""
        return {"stiffness": self.matrix[se3.SWAP][:, se3.SWAP].tolist()}

    def _places(self, names: Sequence[str]) -> dict[str, tuple[int, int]]:
        """Row and column of each of `compliances`."""
        pairs = combinations_with_replacement(range(len(names)), 2)
        return {key_of_pair(names[i], names[j]): (i, j) for i, j in pairs}

    def compliances(
        self, names: Sequence[str], slides: Sequence[bool]
    ) -> dict[str, Number]:
        """Entries of ``C = K^-1``: deflections over efforts."""
        C = np.linalg.inv(self.matrix)
        return {
            key: Number(float(C[i, j]), float(slides[i] + slides[j] - 1), -1.0, i == j)
            for key, (i, j) in self._places(names).items()
        }

    def with_compliances(
        self, values: Mapping[str, float], names: Sequence[str]
    ) -> CoupledSprings:
        """The same with other entries of C."""
        C = np.linalg.inv(self.matrix)
        changed = {
            at: values[key] for key, at in self._places(names).items() if key in values
        }
        for (i, j), value in changed.items():
            C[i, j] = C[j, i] = value
        if not changed:
            return self
        K = np.linalg.inv(C)
        return replace(self, matrix=0.5 * (K + K.T))

    def softened(
        self, key: str, names: Sequence[str]
    ) -> tuple[CoupledSprings, CoupledSprings, float]:
        """K moved along ``K S K``, with S one at the entry of C: ``dK = -K S K dC``."""
        K, (i, j) = self.matrix, self._places(names)[key]
        moved = np.outer(K[:, i], K[j])
        if i != j:
            moved = moved + moved.T
        step = float(np.abs(K).max() / np.abs(moved).max())
        return replace(self, matrix=K + step * moved), self, -1.0 / step

    def numbers(self, names: Sequence[str]) -> dict[str, Number]:
        """A factor on its stiffness."""
        return {f"stiffness.{names[0]}": Number(1.0, is_positive=True)}

    def with_numbers(
        self, values: Mapping[str, float], names: Sequence[str]
    ) -> CoupledSprings:
        """The same, stiffer by a factor."""
        factor = values.get(f"stiffness.{names[0]}", 1.0)
        return self if factor == 1.0 else replace(self, matrix=factor * self.matrix)

    def evaluate(self, posture: Posture) -> Evaluation:
        """Energy, gradient and Hessian."""
        q, at = posture.q, self.indices
        force = self.matrix @ q[at]
        gradient, hessian = np.zeros(q.size), np.zeros((q.size, q.size))
        gradient[at] = force
        hessian[np.ix_(at, at)] = self.matrix
        return Evaluation(0.5 * float(force @ q[at]), gradient, hessian)

    def in_units(self, a: float, sizes: Array, efforts: Array) -> Self:  # noqa: ARG002
        """The same spring in other units."""
        at = self.indices
        return replace(self, matrix=self.matrix * efforts[at][:, None] / sizes[at])

    def diagnostics(self, posture: Posture) -> list[Note]:
        """Note on compression that matters in a cantilever with the same compliance.

        Its length l and its axis follow from where a pure force turns the far side: the
        cross products of l/2 with the forces.
        """
        if not self.link or self.indices.size != 6:
            return []
        force = (self.matrix @ posture.q[self.indices])[:3]
        flexibility = np.linalg.pinv(self.matrix)
        turning = flexibility[3:, 3:]
        half = se3.unskew(np.linalg.pinv(turning) @ flexibility[3:, :3])
        distance = float(np.linalg.norm(half))
        if distance == 0.0:
            return []
        axis = half / distance
        bending = np.eye(3) - np.outer(axis, axis)
        softest = float(np.linalg.eigvalsh(bending @ turning @ bending)[-1])  # l / EI
        # Against pi^2 EI / 4 l^2.
        share = -float(force @ axis) * 8.0 * distance * softest / pi**2
        if not share >= _NOTED_COMPRESSION:
            return []
        message = (
            f"link {self.link!r} carries {100 * share:.0f} % of the Euler load of a "
            "cantilever with its compliance; a 6x6 spring does not feel its own axial "
            "force: give it as beam"
        )
        return [Note("link-compressed", message, {"link": self.link, "share": share})]
