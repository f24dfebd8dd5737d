"""The stiffness matrices of a posture: letters, names, and meanings."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal, get_args

#: "load" is the tangent under the load; the others are connections, by their letters.
Letter = Literal["load", "A", "B", "K", "F", "+"]
LETTERS: Final[tuple[str, ...]] = get_args(Letter)
#: The computed ones; "+" is the transpose of "A".
OF_MANY: Final[tuple[str, ...]] = ("A", "B", "K", "F", "load")


@dataclass(frozen=True)
class MatrixName:
    """Name and meaning of a stiffness matrix, in words."""

    name: str
    meaning: str

    @property
    def sentence(self) -> str:
        """The meaning as a sentence."""
        return f"{self.meaning[0].upper()}{self.meaning[1:]}."

    @property
    def words(self) -> str:
        """Name and meaning in one line."""
        return f"{self.name}: {self.meaning}"


#: Names and meanings by letter; the formulas are in `cartstiff.geometry.connections`.
MATRICES: Final[dict[str, MatrixName]] = {
    "load": MatrixName(
        "under the load",
        "the stiffness against a small added wrench while the load acts as stated",
    ),
    "A": MatrixName(
        "Cartan minus",
        "change of the wrench along the axes of the moving body: the load turns with the "
        "body",
    ),
    "B": MatrixName(
        "bi-invariant",
        "the symmetric part of A: second derivatives of the energy along screw motions",
    ),
    "K": MatrixName(
        "kinematic",
        "change of the force along the room's axes: it acts at the origin, its direction "
        "stays",
    ),
    "F": MatrixName(
        "flat",
        "Hessian in the joint coordinates, transformed by the Jacobian: J^-T H J^-1",
    ),
    "+": MatrixName(
        "Cartan plus", "the transpose of A: derivatives along axes fixed in the room"
    ),
}
