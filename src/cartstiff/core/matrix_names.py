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
    #: What the matrix supposes of the load, as the end of a sentence that it begins.
    load: str

    @property
    def sentence(self) -> str:
        """The meaning as a sentence."""
        return f"{self.meaning[0].upper()}{self.meaning[1:]}."

    @property
    def words(self) -> str:
        """Name and meaning in one line."""
        return f"{self.name}: {self.meaning}"


#: Names and meanings by letter; the formulas are in
#: `cartstiff.core.geometry.connections`.
MATRICES: Final[dict[str, MatrixName]] = {
    "load": MatrixName(
        "under the load",
        "the stiffness against a small added wrench",
        "takes the load as it is stated",
    ),
    "A": MatrixName(
        "Cartan minus",
        "change of the wrench along the axes of the moving body: the load turns with the "
        "body",
        "lets the load turn with the body",
    ),
    "B": MatrixName(
        "bi-invariant",
        "the symmetric part of A: second derivatives of the energy along screw motions",
        "lets the load follow half of the body's turn",
    ),
    "K": MatrixName(
        "kinematic",
        "change of the force along the room's axes: it acts at the origin, its direction "
        "stays",
        "keeps the direction of the force in the room",
    ),
    "F": MatrixName(
        "flat",
        "Hessian in the joint coordinates, transformed by the Jacobian: J^-T H J^-1",
        "leaves out how the Jacobian changes under the load",
    ),
    "+": MatrixName(
        "Cartan plus",
        "the transpose of A: derivatives along axes fixed in the room",
        "lets the load turn against the body",
    ),
}
