"""Ellipsoids of stiffness and compliance, with their principal axes and values.

Values and axes are those of `cartstiff.answer.analysis.ellipsoids`; the legend states the
scale of the radii. If principal values are zero, a disc or a rod of a fixed thickness is
drawn. A matrix with negative principal values has no ellipsoid: only its axes are drawn,
negative ones red and dashed. An axis that is far too long, near a singularity, is cut and
ends in two discs; the softest axis is never too short to be seen.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from cartstiff.answer.analysis.ellipsoids import Ellipsoid, Freedom, ellipsoid
from cartstiff.core.arrays import Array, checked_pose, real_array
from cartstiff.core.errors import InputError
from cartstiff.shown.scene import objects, theme
from cartstiff.shown.scene.labels import Label, number
from cartstiff.shown.scene.scales import SCALES, Logarithmic, Scale
from cartstiff.shown.scene.viewer import ViewerNode

# Largest number of decades with a ring.
MOST_RINGS = 6
# Half the thickness of a disc or a rod, over the size of the mechanism.
FLAT = 0.006
# Half the least thickness of an ellipsoid, over the size of the mechanism.
THIN = 1e-4
#: Least half length of an axis whose value is not zero, over the size of the mechanism.
SHORTEST = 0.015
FLAT_WORDS = {
    1: "one principal value is zero: drawn as a disc",
    2: "two principal values are zero: drawn as a rod",
}
# Words behind the value of an axis that is cut.
CUT = " (cut)"
_BLOCKS = {"rotation": slice(0, 3), "translation": slice(3, 6)}


@dataclass(frozen=True)
class Said:
    """The words at the axes of an ellipsoid: a value in `unit`, all three in one size.

    Attributes
    ----------
    unit : str
        Unit of the values that are said.
    inverted : bool
        Whether they are the reciprocals of the drawn ones.
    ends : tuple of str
        Words before the smallest and the largest drawn value, if all are above zero.
    """

    unit: str
    inverted: bool = False
    ends: tuple[str, str] = ("", "")

    def of(self, values: Sequence[float]) -> list[str]:
        """The words of three values, smallest first."""
        numbers = [1.0 / v if v else inf for v in values] if self.inverted else values
        size = min((abs(v) for v in numbers if v and abs(v) < inf), default=0.0)
        first, last = self.ends if values[0] > 0.0 else ("", "")
        each = zip((first, "", last), numbers, strict=True)
        return [f"{word} {number(v, self.unit, size)}".lstrip() for word, v in each]


class EllipsoidPicture:
    """One ellipsoid at a place; drawn once, then moved and stretched.

    Parameters
    ----------
    node : ViewerNode
        Where it is drawn.
    colour : int
        0xRRGGBB.
    size : float
        Size of the mechanism: how thick its axes are.
    look : Theme
        Colours of the labels.
    freedom : {"translation", "rotation"}
        Two ellipsoids at one place have their labels at different ends of the axes, and
        one is seen through the other.
    """

    def __init__(
        self,
        node: ViewerNode,
        colour: int,
        size: float,
        look: theme.Theme,
        freedom: Freedom = "translation",
    ) -> None:
        self.node = node
        self._colour, self._size = colour, size
        self._side = 1.0 if freedom == "translation" else -1.0
        self._opacity = theme.ELLIPSOID_OPACITY[freedom]
        self._body = node["body"]
        self._axes = [node[f"axis {i + 1}"] for i in range(3)]
        self._labels = [Label(node[f"value {i + 1}"], look, colour) for i in range(3)]
        self._signs = [(axis["plus"], axis["minus"], axis["cut"]) for axis in self._axes]
        self._signs_shown = [(True, False, False)] * 3
        self._rings = [node[f"ring {i + 1}"] for i in range(MOST_RINGS)]
        self._has_rings = False
        self._made = False

    def draw(
        self,
        shape: Ellipsoid,
        T: Array,
        scale: Scale,
        unit: str,
        axes: bool = True,
        labels: bool = True,
        said: Said | None = None,
    ) -> dict[str, Any]:
        """Show an ellipsoid whose matrix is in the frame with pose T; returns its legend.

        The scale leads from values to lengths. What is `said` at the axes is by default
        their values.
        """
        flat = shape.definiteness == "positive semidefinite"
        solid = flat or shape.definiteness == "positive"
        self.make()
        # In plain numbers from here: arrays of three take longer.
        columns = T[:3, :3].dot(shape.axes).T.tolist()
        centre, principal = T[:3, 3].tolist(), shape.eigenvalues.tolist()
        radii = [*map(scale.length, principal)]
        words = (said or Said(unit)).of(principal) if labels else []
        self.node.show(True)
        self._body.show(solid)
        if solid:
            # A flat side is still a visible surface.
            thickness = (FLAT if flat else THIN) * self._size
            x, y, z = (
                _along(column, max(radius, thickness))
                for column, radius in zip(columns, radii, strict=True)
            )
            self._body.set_columns(x, y, z, centre)
        for i, (radius, value) in enumerate(zip(radii, principal, strict=True)):
            shown, is_cut = axes and radius > 0.0, radius >= scale.most
            self._axes[i].show(shown)
            if not (shown and labels):
                self._labels[i].hide()
            if not shown:
                continue
            half, negative = max(radius, SHORTEST * self._size), value < 0.0
            signs = not negative, negative, is_cut
            if signs != self._signs_shown[i]:
                self._signs_shown[i] = signs
                for part, is_on in zip(self._signs[i], signs, strict=True):
                    part.show(is_on)
            start = _along(columns[i], -half, centre)
            ends = _along(columns[i], 2.0 * half), columns[i - 2], columns[i - 1]
            self._axes[i].set_columns(*ends, start)
            if labels:
                end = _along(columns[i], self._side * 1.08 * half, centre)
                self._labels[i].show(words[i] + CUT * is_cut, end)
        step = scale.per_decade if isinstance(scale, Logarithmic) else 0.0
        self._draw_rings(columns, centre, step, max(radii) if solid else 0.0)
        return {
            "shown": solid,
            "reason": None if solid and not flat else _reason(shape, unit),
            "definiteness": shape.definiteness,
            "eigenvalues": principal,
            "axes": shape.axes.tolist(),
            "unit": unit,
            "radii": radii,
            "scale": scale.legend(),
            "cut": max(radii) >= scale.most,
            "asymmetry": shape.asymmetry,
        }

    def make(self) -> None:
        """Send every part that any matrix needs, once."""
        if self._made:
            return
        self._made = True
        # Drawn from both sides, so that it is seen from within a link as well.
        ball = objects.sphere(fine=True)
        glow = theme.hex_of(80 * np.array(theme.fractions(self._colour)))
        self._body.set_object(
            objects.solid(ball, self._colour, self._opacity, shininess=60, emissive=glow)
        )
        turn = np.linspace(0.0, 2.0 * np.pi, 97)
        circle = np.stack([np.cos(turn), np.sin(turn), 0.0 * turn], axis=1)
        pairs = np.repeat(circle, 2, axis=0)[1:-1]
        hoops = np.concatenate([np.roll(pairs, k, axis=1) for k in range(3)])
        self._body["hoops"].set_object(objects.lines(hoops, _darker(self._colour), 0.9))
        radius = 0.0035 * self._size
        for plus, minus, cut in self._signs:  # from one end of the axis to the other
            plus.set_object(objects.rod(radius, _darker(self._colour)))
            minus.set_object(objects.dashed_rod(1.3 * radius, theme.COLOURS["negative"]))
            cut.set_object(objects.ends(5.0 * radius, _darker(self._colour)))
            minus.show(False)
            cut.show(False)
        for ring in self._rings:
            ring.set_object(
                objects.lines(circle, _darker(self._colour), 0.7, joined=True)
            )
            ring.show(False)

    def _draw_rings(
        self, columns: list[list[float]], centre: list[float], step: float, largest: float
    ) -> None:
        """Draw a ring for each factor of ten of a logarithmic scale,
        across the softest axis.
        """
        if not step and not self._has_rings:
            return
        self._has_rings = step > 0.0
        for i, ring in enumerate(self._rings):
            radius = (i + 1) * step
            ring.show(0.0 < radius < largest)
            if 0.0 < radius < largest:
                x, y, z = (_along(columns[k], radius) for k in (1, 2, 0))
                ring.set_columns(x, y, z, centre)

    def hide(self) -> None:
        """Show nothing."""
        if self._made:
            self.node.show(False)


def _along(
    direction: Sequence[float], length: float, start: Sequence[float] = (0.0, 0.0, 0.0)
) -> list[float]:
    """``start + length direction``."""
    (a, b, c), (x, y, z) = direction, start
    return [x + length * a, y + length * b, z + length * c]


def _reason(shape: Ellipsoid, unit: str) -> str:
    kind = shape.definiteness
    size = min((abs(v) for v in shape.eigenvalues.tolist() if v), default=0.0)
    low = number(float(shape.eigenvalues[0]), unit, size)
    if kind == "positive semidefinite":
        return FLAT_WORDS[int(np.sum(shape.eigenvalues == 0.0))]
    if kind == "zero":
        return "it is zero"
    return f"{kind}, softest {low}"


def _darker(colour: int) -> int:
    return theme.hex_of(170 * np.array(theme.fractions(colour)))


def add_ellipsoid(
    visualizer: Any,
    matrix: ArrayLike,
    T: ArrayLike | None = None,
    *,
    freedom: Freedom = "translation",
    size: float = 0.3,
    scale: Literal["root", "linear", "log"] | Scale = "linear",
    unit: str = "",
    colour: int | None = None,
    labels: bool = True,
    dark: bool = False,
) -> dict[str, Any]:
    """Draw the ellipsoid of a stiffness or compliance in any meshcat scene.

    Parameters
    ----------
    visualizer : meshcat.Visualizer
        Where: ``vis["path"]``; it is drawn below, as "ellipsoid". A later call replaces
        it.
    matrix : array_like, shape (3, 3) or (6, 6)
        Its symmetric part is drawn; of a 6x6 matrix, in order (rotation, translation),
        that of the block of `freedom`.
    T : array_like, shape (4, 4), optional
        Pose of the frame of the matrix in `visualizer`, ``T_F_M``; default identity.
    freedom : {"translation", "rotation"}
        Block of a 6x6 matrix, and the default colour.
    size : float
        Length that the largest principal value is drawn with, about, in units of the
        scene.
    scale : "linear", "root", "log", or a scale
        From values to lengths. One made by `from_values` of `Linear`, `Root` or
        `Logarithmic` serves several ellipsoids, which can then be compared; `size` then
        plays no part but for the thickness of the axes.
    unit : str
        Unit of the values, for the labels.
    colour : int, optional
        0xRRGGBB.
    labels : bool
        Write the principal values at the ends of the axes.
    dark : bool
        Whether the background is dark.

    Returns
    -------
    dict
        "shown", "reason" (why not), "definiteness", "eigenvalues" (smallest first),
        "axes" (the columns, in the frame of the matrix), "unit", "radii" (drawn lengths),
        "scale", "asymmetry".

    Raises
    ------
    InputError
        For a wrong shape, numbers that are not finite, or an unknown freedom.
    """
    node = ViewerNode.of(visualizer)
    M = real_array(matrix, "matrix")
    if freedom not in _BLOCKS:
        raise InputError("unknown freedom", expected=", ".join(_BLOCKS), got=freedom)
    if M.shape == (6, 6):
        M = M[_BLOCKS[freedom], _BLOCKS[freedom]]
    pose = np.eye(4) if T is None else checked_pose(T, "T")
    if not 0.0 < size < np.inf:
        raise InputError("size cannot be used", expected="a positive length", got=size)
    # Its shape and scale, then the picture.
    shape = ellipsoid(M)
    if isinstance(scale, str):
        if scale not in SCALES:
            raise InputError("unknown scale", expected=", ".join(SCALES), got=scale)
        scale = SCALES[scale].from_values(shape.eigenvalues, size)
    look = theme.DARK if dark else theme.LIGHT
    node = node["ellipsoid"]
    node.delete()
    picture = EllipsoidPicture(
        node, theme.COLOURS[freedom] if colour is None else colour, 3.0 * size, look
    )
    return picture.draw(shape, pose, scale, unit, labels=labels)
