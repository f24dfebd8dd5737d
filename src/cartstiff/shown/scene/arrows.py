"""Wrenches and deflections as arrows: force straight, moment with a ring,
displaced frame pale.
"""

from __future__ import annotations

from collections.abc import Callable
from math import sqrt
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from cartstiff.answer.analysis.deflection import displacement_of_point
from cartstiff.core import numerics
from cartstiff.core.arrays import Array, checked_pose, checked_vector
from cartstiff.core.geometry import se3
from cartstiff.shown.scene import objects, theme
from cartstiff.shown.scene.labels import Label, number
from cartstiff.shown.scene.scales import Growing
from cartstiff.shown.scene.viewer import ViewerNode

#: Length of an arrow, about, over the size of the mechanism.
LONGEST_ARROW = 0.22
#: Arrows begin to have a length where a load moves the body by this share of the
#: mechanism's size.
SMALLEST_MOTION = 1e-7
# Turn (rad) that is drawn as large as a displacement of the longest arrow.
_TURN = 0.6
# Cosine of the angle below which two arrows from one point cover each other, and the
# distance between their middles then, over the sum of their lengths: that of their heads.
_ALONG, _BESIDE = 0.98, 0.07
# Load at which arrows of `add_wrench` begin: those of 10 then have the wanted size.
_SMALLEST_LOAD = 1e-3


class Arrow:
    """A vector at a point, with its size written at the tip."""

    def __init__(
        self, node: ViewerNode, colour: int, look: theme.Theme, turning: bool = False
    ) -> None:
        self._node, self._colour, self._turning = node, colour, turning
        self._label, self._body = Label(node["label"], look, colour), node["arrow"]
        self._made = False

    def draw(
        self,
        vector: Array,
        point: Array,
        unit: str,
        scale: Callable[[float], float],
        labels: bool = True,
    ) -> float:
        """Show a vector (3,) at a point, as long as the scale says.

        Returns its drawn length.
        """
        size = sqrt(vector.dot(vector))
        length = scale(size) if size else 0.0
        if not 0.0 < length < np.inf:
            self.hide()
            return 0.0
        self.make()
        (a, b, c), start = vector.tolist(), point.tolist()
        x, y, z = (
            [length * e for e in axis] for axis in objects.axes_along(a, b, c, size)
        )
        self._body.set_columns(x, y, z, start)
        self._node.show(True)
        if labels:
            reach = 1.1 * length / size
            tip = [p + reach * v for p, v in zip(start, (a, b, c), strict=True)]
            self._label.show(number(size, unit), tip)
        else:
            self._label.hide()
        return length

    def make(self) -> None:
        """Send its parts, once."""
        if not self._made:
            self._made = True
            made = objects.turning_arrow if self._turning else objects.arrow
            made(self._body, self._colour)

    def hide(self) -> None:
        """Show nothing."""
        if self._made:
            self._node.show(False)


class WrenchPicture:
    """Force and moment at a point.

    Parameters
    ----------
    node, look
        Where, and in which colours.
    scales : tuple of Growing
        Scales of force and moment.
    """

    def __init__(
        self, node: ViewerNode, look: theme.Theme, scales: tuple[Growing, Growing]
    ) -> None:
        self._force = Arrow(node["force"], look.load, look)
        self._moment = Arrow(node["moment"], look.load, look, turning=True)
        self._scales = scales

    def make(self) -> None:
        """Send both arrows, once."""
        self._force.make()
        self._moment.make()

    def draw(
        self, wrench: Array, T: Array, force: str, moment: str, labels: bool
    ) -> dict[str, Any]:
        """Show (moment, force) in the axes of a frame with pose T, at its origin."""
        # Forces that are rounding beside the moment over the size are not shown as
        # arrows.
        R, p = T[:3, :3], T[:3, 3]
        by_force, by_moment = self._scales
        return {
            "force": self._force.draw(R @ wrench[3:], p, force, by_force.length, labels),
            "moment": self._moment.draw(
                R @ wrench[:3], p, moment, by_moment.length, labels
            ),
            "units": {"force": force, "moment": moment},
            "scale": self.legend(),
            "wrench": wrench.tolist(),
        }

    def legend(self) -> dict[str, Any]:
        """Scales of force and moment."""
        force, moment = self._scales
        return {"force": force.legend(), "moment": moment.legend()}

    def hide(self) -> None:
        """Show nothing."""
        self._force.hide()
        self._moment.hide()


class DeflectionPicture:
    """A small motion of the body, enlarged: a pale frame and an arrow to it."""

    def __init__(self, node: ViewerNode, size: float, look: theme.Theme) -> None:
        self._size = size
        self._frame = node["frame"]
        self._arrow = Arrow(node["displacement"], theme.COLOURS["deflection"], look)
        self._made = False
        self._scale = Growing(1.0, SMALLEST_MOTION / LONGEST_ARROW)

    def draw(
        self,
        twist: Array,
        T: Array,
        unit: str,
        wanted: float | None,
        labels: bool = True,
        force: tuple[Array, float] | None = None,
    ) -> dict[str, Any]:
        """Show a twist (6,) of the frame with pose T, enlarged by `wanted` or visibly.

        Beside an arrow along `force` (3,) in F, of that drawn length, if the two point
        alike.
        """
        factor = self._factor(twist) if wanted is None else wanted
        if not self._made:
            self._made = True
            objects.frame(self._frame, 0.12 * self._size, 0.45)
        self._frame.show(True)
        self._frame.set_transform(T @ se3.exp(factor * twist))
        moved = displacement_of_point(twist, np.zeros(3))
        # The arrow's length is the displacement enlarged; its label is the true one.
        along, start = T[:3, :3] @ moved, T[:3, 3]
        if force is not None and (aside := _aside(along, factor, *force)) is not None:
            start = start + aside
        self._arrow.draw(along, start, unit, lambda size: factor * size, labels)
        turn = numerics.norm(twist[:3])
        return {
            "exaggeration": factor,
            "twist": twist.tolist(),
            "displacement": numerics.norm(moved),
            "rotation": turn,
            "unit": unit,
        }

    def _factor(self, twist: Array) -> float:
        """A factor that makes the motion visible; a larger motion is drawn larger."""
        along = numerics.norm(twist[3:]) / (LONGEST_ARROW * self._size)
        turn = numerics.norm(twist[:3]) / _TURN
        largest = max(along, turn)
        return self._scale.length(largest) / largest if 0.0 < largest < np.inf else 0.0

    def hide(self) -> None:
        """Show nothing."""
        if self._made:
            self._frame.show(False)
            self._arrow.hide()


def _aside(along: Array, factor: float, force: Array, length: float) -> Array | None:
    """Shift (3,) of an arrow ``factor along`` that one of that length along a
    force covers.
    """
    size, other = numerics.norm(along), numerics.norm(force)
    if not along @ force > _ALONG * size * other:
        return None
    x, y, z = along.tolist()
    across = objects.axes_along(x, y, z, size)[1]
    return _BESIDE * (factor * size + length) * np.array(across)


# Force times the size of the picture, and moments, below this share of each other.
_ROUNDING = numerics.NEGLIGIBLE_DIFFERENCE


def add_wrench(
    visualizer: Any,
    wrench: ArrayLike,
    T: ArrayLike | None = None,
    *,
    size: float = 0.3,
    force: str = "N",
    moment: str = "N m",
    labels: bool = True,
    dark: bool = False,
) -> dict[str, Any]:
    """Draw a wrench in any meshcat scene: the force as an arrow, the moment with a ring.

    Parameters
    ----------
    visualizer : meshcat.Visualizer
        Where: ``vis["path"]``; it is drawn below, as "wrench". A later call replaces it.
    wrench : array_like, shape (6,)
        (moment, force) in the frame with pose T.
    T : array_like, shape (4, 4), optional
        Pose ``T_F_M``; the arrows start at its origin.
    size : float
        Length of an arrow of 10; it is a quarter longer for each further factor of ten.
    force, moment : str
        Units for the labels.
    labels, dark : bool
        Whether sizes are written, and on a dark background.

    Returns
    -------
    dict
        Drawn lengths of "force" and "moment", and their "scale".

    Raises
    ------
    InputError
        For a wrong shape or numbers that are not finite.
    """
    node = ViewerNode.of(visualizer)["wrench"]
    W = checked_vector(wrench, 6, "wrench")
    pose = np.eye(4) if T is None else checked_pose(T, "T")
    node.delete()
    # Rounding beside the other part is no arrow of its own.
    moments, forces = float(np.abs(W[:3]).max()), float(np.abs(W[3:]).max())
    W = W * np.repeat(
        [moments > _ROUNDING * forces * size, forces * size > _ROUNDING * moments], 3
    )
    scale = Growing(size, _SMALLEST_LOAD)
    picture = WrenchPicture(node, theme.DARK if dark else theme.LIGHT, (scale, scale))
    return picture.draw(W, pose, force, moment, labels)
