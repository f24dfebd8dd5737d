r"""Straight springs between a point of one frame and a point of another.

With anchor a (frame A), body point b (frame B), length l, unit vector u, tension t = k (l - l0),
all in components of B: g = (b x u, u), W = t g and, with D = [-[b]x, I],

    K^A[i, j] = k g_i g_j + t [ D_i . (I - u u^T) D_j / l + u . (w_j x (w_i x b + v_i)) ]

[GriffisDuffy]_; theory page, line springs.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from cartstiff import numerics
from cartstiff.arrays import checked_array
from cartstiff.errors import InputError, UndefinedError
from cartstiff.geometry import se3
from cartstiff.geometry.se3 import Array
from cartstiff.potentials.contract import PosePotential, Posture, Remark

__all__ = ["LineGeometry", "LineSprings", "line_geometry", "lines_of_many"]


_EYE = np.eye(3)
#: Sums of a few dozen products are exact to so many roundings of their terms.
_ADDED = 64.0


class LineGeometry(NamedTuple):
    """Lengths (m,), unit vectors (m, 3) in frame b, and line coordinates g (m, 6)."""

    lengths: Array
    directions: Array
    lines: Array


def line_geometry(T_a_b: Array, anchors: Array, points: Array) -> LineGeometry:
    """Lines from `anchors` (m, 3) in frame a to `points` (m, 3) in frame b, seen in frame b.

    ``lines[s]`` is the gradient of length s along body twists: (b x u, u).

    Raises
    ------
    UndefinedError
        If a line has zero length: its direction does not exist.
    """
    R, p = T_a_b[:3, :3], T_a_b[:3, 3]
    along = points - (anchors - p) @ R
    lengths = np.sqrt(np.einsum("ij,ij->i", along, along))
    size = max(float(np.abs(anchors).max()), float(np.abs(points).max()))
    if lengths.min() <= numerics.LAST_DIGITS * size:
        s = int(np.argmin(lengths))
        raise UndefinedError(
            f"line {s + 1} has zero length: its direction does not exist",
            code="zero-length-line",
            values={"line": s + 1, "length": float(lengths[s])},
        )
    u = along / lengths[:, None]
    lines = np.empty((len(u), 6))
    lines[:, 3:] = u
    (bx, by, bz), (ux, uy, uz) = points.T, u.T
    lines[:, 0] = by * uz - bz * uy
    lines[:, 1] = bz * ux - bx * uz
    lines[:, 2] = bx * uy - by * ux
    return LineGeometry(lengths, u, lines)


def lines_of_many(T_a_b: Array, anchors: Array, points: Array) -> LineGeometry:
    """`line_geometry` of poses (N, 4, 4); a line of zero length has the direction zero."""
    R, p = T_a_b[:, :3, :3], T_a_b[:, :3, 3]
    along = points - (anchors - p[:, None]) @ R
    lengths = np.linalg.norm(along, axis=-1)
    u = along / np.maximum(lengths, numerics.TINY)[..., None]
    moments = np.cross(np.broadcast_to(points, u.shape), u)
    return LineGeometry(lengths, u, np.concatenate([moments, u], axis=-1))


def second_derivative(geometry: LineGeometry, points: Array, weights: Array) -> Array:
    """``sum_s weights_s Hess(length_s)`` on exponential coordinates, a symmetric (6, 6) matrix."""
    lengths, u, lines = geometry
    w = weights / lengths
    # (I - u u^T) in the metric of point velocities: sum w (D^T D - g g^T), where
    # D^T D = [[(b.b) I - b b^T, [b]x], [-[b]x, I]].
    total = -(lines.T * w) @ lines
    # With it sym of u . (w_j x (w_i x b + v_i)), the rotation of the line's own direction:
    # [[sym(b u^T) - (b.u) I, -[u]x / 2], [[u]x / 2, 0]].
    turning = points.T @ (points * w[:, None] - u * weights[:, None])
    total[:3, :3] += turning.trace() * _EYE - 0.5 * (turning + turning.T)
    coupling = se3.skew(w @ points - 0.5 * (weights @ u))
    total[:3, 3:] += coupling
    total[3:, :3] -= coupling
    total[3:, 3:] += w.sum() * _EYE
    return total


@dataclass(frozen=True, kw_only=True)
class LineSprings(PosePotential):
    """Line springs between frames a and b.

    Attributes
    ----------
    anchors : ndarray, shape (m, 3)
        Points in frame a.
    points : ndarray, shape (m, 3)
        Points in frame b.
    stiffness : ndarray, shape (m,)
        Force per length, above zero.
    rest_length : ndarray, shape (m,)
        Lengths at which the springs carry no force; NaN where they are to be chosen so that the
        lines balance the load at the posture (see `balanced`).
    unilateral : bool
        Cables: a line shorter than its rest length is slack and carries nothing.
    balanced_at : tuple of ndarray (m,), (m,), or None
        Lengths, and the tensions that were chosen there: through the rest length of a stiff line
        they would come back rounded. None where the rest lengths were given.
    """

    anchors: Array
    points: Array
    stiffness: Array
    rest_length: Array
    unilateral: bool = False
    balanced_at: tuple[Array, Array] | None = None

    def __post_init__(self) -> None:
        for name, width in (("anchors", 3), ("points", 3), ("stiffness", 0), ("rest_length", 0)):
            value = checked_array(getattr(self, name), None, f"line springs: {name}", finite=False)
            shape = (len(self.anchors), width) if width else (len(self.anchors),)
            finite = np.isfinite(value) | (np.isnan(value) & (name == "rest_length"))
            if value.shape != shape or not np.all(finite):
                raise InputError(
                    f"line springs: {name} must be finite numbers",
                    expected=f"shape {shape}",
                    got=f"shape {value.shape}",
                )
            value.flags.writeable = False
            object.__setattr__(self, name, value)
        if np.any(self.stiffness <= 0):
            raise InputError("line spring stiffness must be above zero", got=self.stiffness.min())

    def tensions(self, lengths: Array) -> Array:
        """Tension k (l - l0) of each line; zero for a slack cable."""
        if self.balanced_at is None:
            t = self.stiffness * (lengths - self.rest_length)
        else:
            t = self.balanced_at[1] + self.stiffness * (lengths - self.balanced_at[0])
        return np.maximum(t, 0.0) if self.unilateral else t

    def is_taut(self, lengths: Array) -> Array:
        """Which lines carry force: all of them, or the cables longer than their rest length."""
        return (lengths >= self.rest_length) | (not self.unilateral)

    def slack(self, posture: Posture) -> list[int]:
        """Numbers (from 1) of the cables that carry nothing at a posture."""
        if not self.unilateral:
            return []
        T, _ = posture.relative(self.frame_a, self.frame_b)
        lengths = line_geometry(T, self.anchors, self.points).lengths
        return [int(i) + 1 for i in np.flatnonzero(lengths < self.rest_length)]

    def remarks(self, posture: Posture) -> list[Remark]:
        """The cables that carry nothing, by their numbers from 1."""
        slack = self.slack(posture)
        numbers = ", ".join(str(i) for i in slack)
        message = f"cables {numbers} are slack and carry nothing"
        return [Remark("slack", message, {"slack": slack})] if slack else []

    @property
    def rest(self) -> Array:
        """Rest lengths (m,)."""
        return self.rest_length

    def replaced(self, stiffness: Array, rest: Array) -> LineSprings:
        """The same lines with other stiffnesses and rest lengths."""
        return replace(self, stiffness=stiffness, rest_length=rest, balanced_at=None)

    def scaled(self, a: float) -> LineSprings:
        """The same lines with all lengths times `a`."""
        at = self.balanced_at
        return replace(
            self, anchors=self.anchors * a, points=self.points * a, stiffness=self.stiffness / a,
            rest_length=self.rest_length * a,
            balanced_at=None if at is None else (at[0] * a, at[1]),
        )  # fmt: skip

    @property
    def is_complete(self) -> bool:
        """Whether every line has a rest length."""
        return not np.any(np.isnan(self.rest_length))

    def balanced(self, posture: Posture, gradient: Array, every: bool = False) -> LineSprings:
        """The same lines with rest lengths at which they exert a gradient (6,) at a posture.

        Tensions t solve ``lines^T t = gradient`` (of least norm where there are more than six).

        Raises
        ------
        InputError
            If no tensions of the open lines balance it.
        """
        T, _ = posture.relative(self.frame_a, self.frame_b)
        geometry = line_geometry(T, self.anchors, self.points)
        free = np.isnan(self.rest_length) | every
        fixed = np.where(free, 0.0, self.stiffness * (geometry.lengths - self.rest_length))
        wanted = gradient - geometry.lines.T @ fixed
        size = float(np.abs(geometry.lines).max())
        scale = np.array([1.0] * 3 + [size] * 3)
        matrix = geometry.lines[free].T * scale[:, None]
        # Of many distributions the one nearest to the present tensions: preload is kept.
        present = self.stiffness * np.nan_to_num(geometry.lengths - self.rest_length)
        tensions = present[free] if np.count_nonzero(free) > 6 else np.zeros(matrix.shape[1])
        missing = wanted * scale - matrix @ tensions
        tensions = tensions + np.linalg.lstsq(matrix, missing, rcond=numerics.RANK)[0]
        missed = np.abs(matrix @ tensions - wanted * scale)
        summed = np.abs(matrix) @ np.abs(tensions) + np.abs(geometry.lines.T * scale[:, None]) @ (
            np.abs(present)
        )
        limit = numerics.BALANCE * np.abs(gradient * scale).max(initial=0.0)
        if np.any(missed > limit + _ADDED * numerics.EPSILON * summed):
            raise InputError(
                "no tensions of the lines balance this load at this pose",
                expected="a load that the lines can carry (not a type-2 singularity)",
                got=f"unbalanced part {missed.max():.3g}",
            )
        if self.unilateral and tensions.min(initial=0.0) < 0:
            tensions = self._pulling(matrix, wanted * scale, present[free])
        if self.unilateral and tensions.min(initial=0.0) < 0:
            raise InputError(
                "the cables cannot balance this load at this pose: one would have to push",
                expected="a load that tensions alone can carry",
            )
        rest = self.rest_length.copy()
        rest[free] = geometry.lengths[free] - tensions / self.stiffness[free]
        exerted = self.tensions(geometry.lengths)
        exerted[free] = tensions
        balanced = geometry.lengths, exerted
        return replace(self, rest_length=rest, balanced_at=balanced)

    @staticmethod
    def _pulling(matrix: Array, wanted: Array, present: Array) -> Array:
        """Tensions that balance and are nowhere negative; all -1 if there are none.

        A tenth of the present mean tension is kept in every cable if that is possible, so that
        none stands on the point of going slack.
        """
        from scipy.optimize import nnls

        size = float(np.abs(wanted).max(initial=0.0))
        for floor in (0.1 * float(np.maximum(present, 0.0).mean()), 0.0):
            least = np.full(matrix.shape[1], floor)
            more, missed = nnls(matrix, wanted - matrix @ least)
            if missed <= numerics.BALANCE * size:
                return np.asarray(least + more)
        return -np.ones(matrix.shape[1])

    def on_pose(self, T_a_b: Array) -> tuple[float, Array, Array]:
        """Energy, wrench and K^B in components of frame b."""
        geometry = line_geometry(T_a_b, self.anchors, self.points)
        t, k = self.tensions(geometry.lengths), self._taut(geometry.lengths)
        stretch = geometry.lengths - self.rest_length
        K = (geometry.lines.T * k) @ geometry.lines
        K += second_derivative(geometry, self.points, t)
        return 0.5 * float(t @ stretch), t @ geometry.lines, K

    def apart(self, T_a_b: Array, more: Array | float = 0.0) -> tuple[Array, Array, Array]:
        """Lines g (m, 6), stiffnesses k (m,), and what the tensions make: K^B less sum k g g^T.

        The tensions are larger by `more` (m,) than the lengths say: those of stiff lines are known
        to the rounding of their lengths only.
        """
        geometry = line_geometry(T_a_b, self.anchors, self.points)
        rest = second_derivative(geometry, self.points, self.tensions(geometry.lengths) + more)
        return geometry.lines, self._taut(geometry.lengths), rest

    def _taut(self, lengths: Array) -> Array:
        """Stiffnesses, zero for slack cables."""
        if not self.unilateral:
            return self.stiffness
        return np.where(self.is_taut(lengths), self.stiffness, 0.0)
