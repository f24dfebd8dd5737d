"""The choice of parts and scales of a picture, and the matrices that it shows."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

from cartstiff.answer.analysis.screws import Screw
from cartstiff.core.errors import InputError, UnknownNameError
from cartstiff.core.geometry import se3
from cartstiff.core.matrix_names import LETTERS
from cartstiff.core.stiffness.compute import PostureStiffness
from cartstiff.core.stiffness.posture import StiffnessInFrame
from cartstiff.shown.scene.scales import SCALES
from cartstiff.shown.scene.theme import THEMES

_KNOWN = {
    "connection": LETTERS,
    "quantity": ("stiffness", "compliance"),
    "condition of the other freedoms": ("block", "held", "free"),
    "scale": tuple(SCALES),
    "theme": tuple(THEMES),
}


@dataclass(frozen=True)
class Appearance:
    """The parts and scales of a picture.

    Attributes
    ----------
    connection : {"A", "B", "K", "F", "+", "load"}
        Which stiffness, "load" the tangent under the load; of an unsymmetric one the
        symmetric part is drawn.
    quantity : {"stiffness", "compliance"}
        Quantity of the ellipsoids.
    said : {"stiffness", "compliance"}, optional
        Quantity of the values at their axes; default the same.
    translation, rotation : bool
        Which ellipsoids.
    others : {"block", "held", "free"}
        State of the other three freedoms, see `cartstiff.answer.analysis.ellipsoids`. The
        block of the matrix itself is "held" for a stiffness and "free" for a compliance.
    scale : {"root", "linear", "log"}
        From principal values to lengths: their square roots, themselves, or their
        logarithms; the legend states it.
    axes, labels : bool
        Principal axes, and their values.
    wrench : bool
        The load, as arrows.
    deflection : bool
        Where `added` moves the body, enlarged by `exaggeration` (None: a round factor,
        stated).
    added : tuple of 6 floats, optional
        Wrench (moment, force) along the axes of M whose deflection is drawn; default the
        load itself.
    added_at : tuple of 3 floats, optional
        Point in M at which `added` acts; default the reference point.
    centres : bool
        Centres of stiffness, compliance, elasticity, and of least coupling.
    held_forces : bool
        Forces on M's origin, without a moment, that the drives hold beside the weight: a
        polytope, its scale stated.
    ghost : tuple of floats, optional
        Coordinates of a second posture, drawn pale.
    rest : tuple of floats, optional
        Coordinates at which the mechanism is drawn a second time, in grey, by a viewer
        that copies it (a page): those without the load.
    nodal : tuple of int, float and Screw, optional
        Number of a mode, its frequency [Hz], and the axis in M about which the body turns
        in it.
    point : tuple of 3 floats
        Reference point in the frame M.
    measures : mapping, optional
        How large ellipsoids are drawn, by freedom, as a legend says it; default: so that
        they fit.
    theme : {"light", "dark"}
        Background.
    grid, frames : bool
        The ground; the axes of F and M.

    Raises
    ------
    InputError
        For other words than these, or an exaggeration that is not above zero.
    """

    connection: str = "load"
    quantity: Literal["stiffness", "compliance"] = "stiffness"
    said: Literal["stiffness", "compliance"] | None = None
    translation: bool = True
    rotation: bool = True
    others: Literal["block", "held", "free"] = "block"
    scale: Literal["root", "linear", "log"] = "root"
    axes: bool = True
    labels: bool = True
    wrench: bool = True
    deflection: bool = False
    added: tuple[float, ...] | None = None
    added_at: tuple[float, float, float] | None = None
    exaggeration: float | None = None
    centres: bool = False
    held_forces: bool = False
    ghost: tuple[float, ...] | None = None
    rest: tuple[float, ...] | None = None
    nodal: tuple[int, float, Screw] | None = None
    point: tuple[float, float, float] = (0.0, 0.0, 0.0)
    measures: Mapping[str, Mapping[str, Any]] | None = None
    theme: Literal["light", "dark"] = "light"
    grid: bool = True
    frames: bool = True

    def __post_init__(self) -> None:
        chosen = self.connection, self.quantity, self.others, self.scale, self.theme
        for value, (name, known) in zip(chosen, _KNOWN.items(), strict=True):
            if value not in known:
                raise UnknownNameError(name, str(value), known)
        if self.exaggeration is not None and not 0.0 < self.exaggeration < 1e30:
            raise InputError(
                "exaggeration cannot be used",
                expected="a number above zero",
                got=self.exaggeration,
            )


def reference(result: PostureStiffness, look: Appearance) -> StiffnessInFrame:
    """The stiffness at the reference point, along the axes of M."""
    return result.at(se3.pose(translation=look.point) if any(look.point) else None)


def why_missing(result: PostureStiffness, look: Appearance) -> str | None:
    """Why there is no stiffness of the shown connection; None where there is one."""
    if result.at().matrices[look.connection] is not None:
        return None
    states = [note.message for note in result.notes if note.code in _STATES]
    return states[-1] if states else f"K^{look.connection} does not exist here"


#: Notes that say why a stiffness does not exist.
_STATES = {
    "fewer-than-six-freedoms",
    "serial-singularity",
    "type-2-singularity",
    "constraint-singularity",
    "non-regular-redundancy",
    "unbalanced",
    "buckled",
    "strut-buckled",
    "strut-not-found",
    "kf-undefined",
}
