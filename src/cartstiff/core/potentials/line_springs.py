r"""Straight springs between a point of one frame and a point of another.

With anchor a (frame A), body point b (frame B), length l, unit vector u, tension t = k (l
- l0), all in components of B: g = (b x u, u), W = t g and, with D = [-[b]x, I],

    K^A[i, j] = k g_i g_j + t [ D_i . (I - u u^T) D_j / l + u . (w_j x (w_i x b + v_i)) ]

[GriffisDuffy]_; theory page, line springs.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from cartstiff.core import numerics
from cartstiff.core.arrays import Array, checked_array, read_only, real_array
from cartstiff.core.errors import InputError, UndefinedError
from cartstiff.core.geometry import se3
from cartstiff.core.notes import Note
from cartstiff.core.potentials.contract import (
    Drawn,
    Evaluation,
    LineGeometry,
    Named,
    Number,
    PosePotential,
    Posture,
    pulled_back,
)
from cartstiff.core.potentials.springs import Chosen, Springs
from cartstiff.core.potentials.tensions import (
    Bounds,
    nearest_balance,
    null_basis,
    within_bounds,
)


def _placed(turning: Array, coupling: Array, weight: Array) -> Array:
    """``[[tr(t) I - sym(t), [c]x], [-[c]x, w I]]`` of stacks t (..., 3, 3), c (..., 3),
    w (...).
    """
    total = np.zeros((*turning.shape[:-2], 6, 6), turning.dtype)
    trace = np.asarray(turning.trace(axis1=-2, axis2=-1))[..., None, None]
    total[..., :3, :3] = trace * np.eye(3) - 0.5 * (turning + turning.swapaxes(-1, -2))
    total[..., :3, 3:] = se3.skew_of(coupling)
    total[..., 3:, :3] = -total[..., :3, 3:]
    total[..., 3:, 3:] = np.asarray(weight)[..., None, None] * np.eye(3)
    return total


#: Round-off of sums of a few dozen products, in units of their terms.
_SUM_ROUNDOFF = 64.0


def line_geometry(T_a_b: Array, anchors: Array, points: Array) -> LineGeometry:
    """Lines from `anchors` (m, 3) in frame a to `points` (m, 3) in frame b,
    in components of b.

    ``lines[s]`` is the gradient of length s along body twists: (b x u, u).

    Raises
    ------
    UndefinedError
        If a line has zero length: its direction does not exist.
    """
    geometry = lines_of_many(T_a_b, anchors, points)
    size = max(float(np.abs(anchors).max()), float(np.abs(points).max()))
    s = int(np.argmin(geometry.lengths))
    if geometry.lengths[s] <= numerics.ROUNDOFF_OF_SUMS * size:
        raise UndefinedError(
            f"line {s + 1} has zero length: its direction does not exist",
            code="zero-length-line",
            values={"line": s + 1, "length": float(geometry.lengths[s])},
        )
    return geometry


def lines_of_many(T_a_b: Array, anchors: Array, points: Array) -> LineGeometry:
    """`line_geometry` of poses (..., 4, 4), or recorded ones.

    Lines of zero length have u = 0.
    """
    R, p = T_a_b[..., :3, :3], T_a_b[..., None, :3, 3]
    along = points - (anchors - p) @ R
    lengths = np.sqrt((along * along).sum(axis=-1))
    if lengths.dtype == object:  # recorded: one division a line
        u = along * (1.0 / lengths)[..., None]
    else:
        u = along / np.maximum(lengths, numerics.TINY)[..., None]
    moments = se3.cross(np.broadcast_to(points, u.shape).T, u.T).T
    return LineGeometry(lengths, u, np.concatenate([moments, u], axis=-1))


def second_derivative(geometry: LineGeometry, points: Array, weights: Array) -> Array:
    """``sum_s weights_s Hess(length_s)`` on exponential coordinates,
    a symmetric (6, 6) matrix.
    """
    lengths, u, lines = geometry
    w = weights / lengths
    # (I - u u^T) in the metric of point velocities: sum w (D^T D - g g^T), where D^T D =
    # [[(b.b) I - b b^T, [b]x], [-[b]x, I]]. With it sym of u . (w_j x (w_i x b + v_i)),
    # the rotation of the line's own direction: [[sym(b u^T) - (b.u) I, -[u]x / 2], [[u]x
    # / 2, 0]].
    turning = points.T.dot(points * w[:, None] - u * weights[:, None])
    coupling = w.dot(points) - 0.5 * weights.dot(u)
    return _placed(turning, coupling, w.sum()) - (lines.T * w).dot(lines)


@dataclass(frozen=True, kw_only=True, eq=False)
class LineSprings(PosePotential, Springs):
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
        Lengths at which the springs carry no force; NaN where they are to be chosen so
        that the lines balance the load at the posture (see `balancing`).
    unilateral : bool or tuple of bool (m,)
        Cables: a line shorter than its rest length is slack and carries nothing. A tuple
        where some lines are cables and others push as well.
    preload : ndarray (m,), optional
        Tensions of driven lines at every commanded posture, whose rest lengths follow it;
        NaN for the others. Where a rest length is given, or was chosen, that one counts.
    driven : bool or tuple of bool (m,)
        Lines whose rest length a drive changes, so that a given load replaces it; the
        others keep it, where the driven ones can balance the load.
    least, most : ndarray (m,), optional
        Limits of the forces, which tensions that are chosen keep if that is possible;
        infinite where there is none. Not for lines with a given rest length.
    balanced_at : tuple of ndarray (m,), (m,), (m,), or None
        Lengths, the tensions chosen there, which the rest length of a stiff line would
        round, and those to which they are the nearest. None if the rest lengths were
        given.

    Raises
    ------
    InputError
        For arrays of different length, no lines, or a stiffness that is not above zero.
    """

    anchors: Array
    points: Array
    stiffness: Array
    rest_length: Array
    unilateral: bool | tuple[bool, ...] = False
    preload: Array | None = None
    driven: bool | tuple[bool, ...] = False
    least: Array | None = None
    most: Array | None = None
    balanced_at: tuple[Array, Array, Array] | None = None

    stem: ClassVar = "line"
    rest_words: ClassVar = ("rest lengths", "these legs")
    least_rest = 0.0
    length_powers: ClassVar = {
        "anchors": 1,
        "points": 1,
        "stiffness": -1.0,
        "rest_length": 1,
        "preload": 0,
        "least": 0,
        "most": 0,
        "balanced_at": (1, 0, 0),
    }

    def __post_init__(self) -> None:
        given = {"anchors": (3,), "points": (3,), "stiffness": (), "rest_length": ()}
        for name, shape in given.items():
            object.__setattr__(self, name, self._numbers(name, shape))
        if not len(self.anchors):
            raise InputError("line springs: no lines", expected="at least one")
        if np.any(self.stiffness <= 0):
            least = float(self.stiffness.min())
            raise InputError("line spring stiffness must be above zero", got=least)
        for name in ("preload", "least", "most"):
            if getattr(self, name) is not None:
                tensions = self._per_line(name, real_array) + np.zeros(
                    len(self.stiffness)
                )
                object.__setattr__(self, name, read_only(tensions))
        for name in ("unilateral", "driven"):
            flags = self._per_line(name, partial(np.array, dtype=bool))
            some = flags.any() and not flags.all()
            own = tuple(flags.tolist()) if some else bool(flags.any())
            object.__setattr__(self, name, own)

    def _numbers(self, name: str, shape: tuple[int, ...]) -> Array:
        """A field as a read-only array of finite numbers, of a shape per line."""
        numbers = getattr(self, name)
        # Read-only arrays are kept: a platform recognises its own points by identity.
        flags = getattr(numbers, "flags", None)
        copy = flags is None or not flags.owndata or flags.writeable
        value = checked_array(
            numbers, None, f"line springs: {name}", finite=False, copy=copy
        )
        own = value if name == "anchors" else self.anchors
        finite = np.isfinite(value) | (np.isnan(value) & (name == "rest_length"))
        if value.shape != (*own.shape[:1], *shape) or not np.all(finite):
            raise InputError(
                f"line springs: {name} must be finite numbers",
                expected=f"shape {(len(own), *shape)}",
                got=f"shape {value.shape}",
            )
        value.flags.writeable = False
        return value

    def _per_line(self, name: str, array: Callable[[Any], Array]) -> Array:
        """A field as an array of one number, or of one per line."""
        values, own = array(getattr(self, name)), self.stiffness.shape
        if values.shape not in ((), own):
            what = f"line springs: {name}: wrong count"
            expected = f"one, or {own[0]}, one per line"
            raise InputError(what, expected=expected, got=f"shape {values.shape}")
        return values

    def labels(self, first: int) -> list[str]:
        """As "line1", "line2"."""
        return [f"line{first + i}" for i in range(1, len(self.stiffness) + 1)]

    def names_in(self, coordinates: Sequence[Named]) -> tuple[str, ...]:  # noqa: ARG002
        """As "leg1", "leg2"."""
        return tuple(f"leg{i}" for i in range(1, len(self.stiffness) + 1))

    def slides_in(self, coordinates: Sequence[Named]) -> list[bool]:  # noqa: ARG002
        """All lines deflect by a distance, whatever the `coordinates`."""
        return [True] * len(self.stiffness)

    def positions(self, posture: Posture) -> Array:
        """The lengths."""
        return self.geometry(posture).lengths

    def pull(self, posture: Posture) -> Array:
        """The tensions."""
        return self.tensions(self.positions(posture))

    def rows(self, posture: Posture) -> Array:
        """Change of the lengths per coordinate rate (m, n)."""
        _, to_pose = posture.relative(self.frame_a, self.frame_b)
        return self.geometry(posture).lines @ to_pose.jacobian

    def pull_at(self, q: Array, pose: Array) -> Array:  # noqa: ARG002
        """The tensions of lines from F to M."""
        return self.tensions(self.lengths_at(pose))

    def taut(self, posture: Posture) -> Array:
        """Lines (m,) that carry force at a posture."""
        return self.is_taut(self.positions(posture))

    @property
    def is_redundant(self) -> bool:  # type: ignore[override]
        """Whether they are more than six."""
        return len(self.stiffness) > 6

    def unloaded(self, positions: Array) -> Self:
        """The same with these rest lengths; cables are bars."""
        return replace(self.replaced(self.stiffness, positions), unilateral=False)

    def numbers(
        self, names: Sequence[str], slides: Sequence[bool] | None = None
    ) -> dict[str, Number]:
        """As `Springs.numbers`, with preloads of open lines, "preload.NAME"."""
        found, preload = super().numbers(names, slides), self.preload
        if preload is not None and names:
            held = np.flatnonzero(np.isnan(self.rest) & ~np.isnan(preload)).tolist()
            for i in held:
                value = float(preload[i])
                found[f"preload.{names[i]}"] = Number(value, force=1.0, is_positive=True)
        return found

    def with_numbers(self, values: Mapping[str, float], names: Sequence[str]) -> Self:
        """As `Springs.with_numbers`, with preloads."""
        changed, preload = super().with_numbers(values, names), self.preload
        if preload is None or not names:
            return changed
        each = zip(names, preload.tolist(), strict=True)
        own = np.array([values.get(f"preload.{name}", x) for name, x in each])
        return replace(changed, preload=own)

    def as_preloaded(self, tensions: Array) -> Self:
        """The same with open rest lengths and a preload."""
        rest = np.full(len(self.stiffness), np.nan)
        return replace(self, rest_length=rest, preload=tensions, balanced_at=None)

    def at_points(self, anchors: Array, points: Array) -> Self:
        """The same between other points; stiffnesses and rest lengths stay."""
        return replace(self, anchors=anchors, points=points)

    def tangent(self, posture: Posture) -> Array:
        """Stiffnesses, zero for slack cables."""
        return self._taut(self.positions(posture))

    def of_coordinates(self, count: int) -> Array:
        """No coordinate has a spring of its own: zeros (n,) for a `count` n."""
        return np.zeros(count)

    def attachments(self) -> list[tuple[str, Array]]:
        """Both ends."""
        return [(self.frame_a, self.anchors), (self.frame_b, self.points)]

    def drawn(self, posture: Posture) -> Drawn:
        """The lines."""
        starts, ends = (
            se3.placed(T, points)
            for frame, points in self.attachments()
            for T in (posture.pose_of_frame(frame),)
        )
        lengths = np.linalg.norm(ends - starts, axis=1)
        is_taut = self.is_taut(lengths)
        return Drawn(starts, ends, self.tensions(lengths), is_taut, self.cables)

    @property
    def farthest_anchor(self) -> float:  # type: ignore[override]
        """Of lines to F."""
        return float(np.abs(self.anchors).max()) if self.frame_a == "world" else 0.0

    def shifted(self, posture: Posture, which: Sequence[int], less: Array) -> LineSprings:
        """The same with the tensions of some lines reduced at a posture by `less` (m,),
        not their lengths.
        """
        lengths = self.geometry(posture).lengths
        tensions = self.tensions(lengths)
        tensions[which] -= less
        given = tensions if self.balanced_at is None else self.balanced_at[2]
        return replace(self, balanced_at=(lengths, tensions, given))

    def tensions(self, lengths: Array) -> Array:
        """Tension k (l - l0) of each line (m,); zero for a slack cable."""
        t = self._pull(lengths)
        return np.where(self.cables, np.maximum(t, 0.0), t)

    def _pull(self, lengths: Array) -> Array:
        """Tension of each line, below zero where a cable is slack."""
        if self.balanced_at is None:
            return np.asarray(self.stiffness * (lengths - self.rest_length))
        at, tensions, _ = self.balanced_at
        return np.asarray(tensions + self.stiffness * (lengths - at))

    def lengths_at(self, T_a_b: Array) -> Array:
        """Length of each line (m,) at a pose."""
        return line_geometry(T_a_b, self.anchors, self.points).lengths

    def is_taut(self, lengths: Array) -> Array:
        """Which lines (m,) carry force: all, or the cables beyond their rest length."""
        return (lengths >= self.rest_length) | ~self.cables

    def slack(self, posture: Posture) -> list[int]:
        """Numbers (from 1) of the slack cables at a posture."""
        if not self.unilateral:
            return []
        lengths = self.geometry(posture).lengths
        return [
            int(i) + 1 for i in np.flatnonzero(self.cables & (lengths < self.rest_length))
        ]

    def diagnostics(self, posture: Posture) -> list[Note]:
        """Notes on slack cables, cables at the edge of slackness,
        and non-unique tensions.
        """
        notes = []
        if slack := self.slack(posture):
            numbers = ", ".join(map(str, slack))
            message = f"cables {numbers} are slack and carry nothing"
            notes.append(Note("slack", message, {"slack": slack}))
        lengths, _, lines = self.geometry(posture)
        if self.unilateral and (at_edge := self._at_edge(lengths)):
            numbers = ", ".join(map(str, at_edge))
            message = (
                f"cables {numbers} are at the edge of slackness: they resist a motion "
                "that stretches them and not its opposite, so that the stiffness depends "
                "on the direction; here they count as taut"
            )
            notes.append(Note("direction-dependent", message, {"cables": at_edge}))
        if self.balanced_at is not None and len(lines) > 1:
            _, tensions, given = self.balanced_at
            tensions = np.where(self.cables, np.maximum(tensions, 0.0), tensions)
            notes += self._notes_on_choice(lines, tensions, given)
        return notes

    def _at_edge(self, lengths: Array) -> list[int]:
        """Numbers of cables that neither pull nor hang, from 1."""
        pull = np.abs(self._pull(lengths))
        edge = pull <= numerics.NEGLIGIBLE_DIFFERENCE * pull.max(initial=0.0)
        return [int(i) + 1 for i in np.flatnonzero(edge & self.cables)]

    def _notes_on_choice(self, lines: Array, tensions: Array, given: Array) -> list[Note]:
        """Note on tensions (m,) that were chosen among several sets."""
        values = numerics.singular_values(
            lines / np.repeat([np.abs(lines).max(), 1.0], 3)
        )
        largest = numerics.NEGLIGIBLE_FORCE * np.abs(tensions).max()
        is_given = given.any() and (np.abs(tensions - given) <= largest).all()
        if len(lines) <= numerics.rank(values) or is_given:
            return []
        message = (
            "several sets of tensions balance the load; this is the set nearest to the "
            "given tensions (least squares), or to zero"
        )
        if given.any() and not tensions.any():
            message = (
                "no tensions of these cables balance one another at this pose: they "
                "cannot hold the given tensions, and have none"
            )
        elif self.unilateral:
            message += ", with every cable taut where that is possible"
        if self.most is not None and np.isfinite(self.most).any():
            message += ", within the limits of the forces"
        values_of = {"tensions": tensions.tolist(), "given": given.tolist()}
        return [Note("tensions-chosen", message, values_of)]

    @property
    def rest(self) -> Array:  # type: ignore[override]
        """Rest lengths (m,)."""
        return self.rest_length

    def replaced(self, stiffness: Array, rest: Array) -> Self:
        """The same lines with other stiffnesses, `stiffness` (m,), and rest lengths,
        `rest` (m,).

        New ones replace a preload.
        """
        preload = self.preload
        if preload is not None:
            is_new = ~np.isnan(rest) & (rest != self.rest_length)
            preload = None if is_new.all() else np.where(is_new, np.nan, preload)
        return replace(
            self, stiffness=stiffness, rest_length=rest, preload=preload, balanced_at=None
        )

    def rest_is_free(self, every: bool = False) -> Array:
        """Rest lengths to be chosen (m,): those not given, or all."""
        return np.isnan(self.rest_length) | every

    def with_forces(self, posture: Posture, forces: Array) -> LineSprings:
        """The same lines with rest lengths at which they have tensions (m,)."""
        rest = self.positions(posture) - forces / self.stiffness
        return self.replaced(
            self.stiffness, np.where(np.isnan(forces), self.rest_length, rest)
        )

    def balancing(
        self,
        posture: Posture,
        gradient: Array,
        size: float,  # noqa: ARG002
        every: bool,
    ) -> Chosen:
        """The same lines with rest lengths at which they exert a gradient (6,)
        at a posture.

        Open lines with a preload have exactly that tension where they cannot balance a
        load among themselves (see `holding`) and `every` is False. All other open lines,
        or with `every` all driven ones, have the tensions nearest to the given ones that
        exert the gradient together with the others, cables taut: see
        `cartstiff.core.potentials.tensions`.

        Raises
        ------
        InputError
            If no tensions of the open lines balance it.
        """
        if every and isinstance(self.driven, tuple):
            free = np.array(self.driven) | self.rest_is_free()
            try:  # springs that nothing drives keep their rest lengths, if possible
                return Chosen(self._balancing(posture, gradient, free))
            except InputError:
                pass
        free = self.rest_is_free(every)
        return Chosen(self._balancing(posture, gradient, free, holds=not every))

    def _balancing(
        self, posture: Posture, gradient: Array, free: Array, holds: bool = False
    ) -> LineSprings:
        """`balancing` by the lines `free` (m,).

        `holds`: or with their preload.
        """
        geometry = self.geometry(posture)
        lines, scale = _scaled(geometry.lines)
        held = self.holding(lines) if holds else np.zeros(len(free), bool)
        free = free & ~held
        given = self.given_tensions(geometry.lengths)
        fixed = np.where(
            free, 0.0, np.where(held, given, self.tensions(geometry.lengths))
        )
        rest, exerted = self.rest_length.copy(), fixed.copy()
        rest[held] = geometry.lengths[held] - given[held] / self.stiffness[held]
        if free.any():
            exerted[free] = self._balanced(lines, gradient * scale, free, given, fixed)
            exerted = np.where(
                free, self._staying_slack(exerted, geometry.lengths), exerted
            )
            rest[free] = geometry.lengths[free] - exerted[free] / self.stiffness[free]
        return self._at_rest(rest, exerted, given, geometry.lengths)

    def _staying_slack(self, exerted: Array, lengths: Array) -> Array:
        """Tensions (m,), below zero for a slack cable that stays slack with its
        rest length.
        """
        pull = self._pull(lengths)
        return np.where(self.cables & (exerted == 0.0) & (pull < 0.0), pull, exerted)

    def balancing_tensions(
        self, lengths: Array, nearest: Array, null: Array
    ) -> tuple[Array, NDArray[np.bool_]]:
        """Tensions (p, m) of `balancing` where it chooses those of all lines.

        Parameters
        ----------
        lengths : ndarray (p, m)
            At the postures.
        nearest : ndarray (p, m)
            Balanced tensions nearest to the given ones, without bounds.
        null : ndarray (p, m, d)
            Orthonormal bases of the changes that need no wrench.

        Returns
        -------
        tensions : ndarray (p, m)
            One below zero is that of a slack cable that keeps its rest length.
        exist : ndarray of bool (p,)
            False where a cable would have to push.
        """
        every = np.ones(lengths.shape[1], bool)
        largest = np.abs(self.given_tensions(lengths)).max(axis=1)
        t, exist = within_bounds(null, nearest, self.bounds(nearest, every), largest)
        return self._staying_slack(t, lengths), exist

    def _balanced(
        self, lines: Array, gradient: Array, free: Array, given: Array, fixed: Array
    ) -> Array:
        """Tensions of the free lines that exert a gradient beside the fixed
        tensions (m,).
        """
        matrix, wanted = lines[:, free], gradient - lines @ fixed
        count = int(np.count_nonzero(free))
        several = count > 6 or count > numerics.rank(numerics.singular_values(matrix))
        start = given[free] if several else np.zeros(count)
        tensions = nearest_balance(matrix, wanted, start)
        missed = np.abs(matrix @ tensions - wanted)
        summed = np.abs(matrix) @ (np.abs(tensions) + np.abs(start)) + np.abs(
            lines
        ) @ np.abs(fixed)
        limit = numerics.BALANCE_TOLERANCE * numerics.largest(gradient)
        missed[missed <= limit + _SUM_ROUNDOFF * numerics.EPSILON * summed] = 0.0
        if missed.any():
            size = _length(lines[3:, 0])  # of directions in that scale
            what = "no tensions of the lines balance this load at this pose"
            if not free.all():
                what = (
                    "no tensions of the lines without a rest length balance the other "
                    "ones here"
                )
            raise InputError(
                what,
                expected="forces that the lines can carry (not a type-2 singularity)",
                got=f"an unbalanced moment of {_length(missed[:3]):.3g} and force of "
                f"{_length(missed[3:] / size):.3g}, in the file's units",
            )
        if not several and not self.cables[free].any():
            return tensions
        bounds, largest = self.bounds(tensions[None], free), np.abs([start]).max(axis=1)
        null = null_basis(matrix)[None]
        taut, exist = within_bounds(null, tensions[None], bounds, largest)
        if not exist[0]:
            raise InputError(
                "the cables cannot balance this load at this pose: one would have to "
                "push",
                expected="a load that tensions alone can carry",
            )
        return np.asarray(taut[0])

    def holding(self, lines: Array | None = None) -> Array:
        """Lines (m,) that are to have exactly their preload at a posture, whatever acts.

        These are the open ones with a preload, where the open lines are not more than the
        motions that they determine, so that no set of tensions balances itself. All
        others, as the cables of a cable robot, choose their tensions. `lines` (6, m) are
        those at the posture; without them six or fewer lines count as independent.
        """
        is_open = self.rest_is_free()
        if self.preload is None:
            return np.zeros(len(is_open), bool)
        own, count = is_open & ~np.isnan(self.preload), int(np.count_nonzero(is_open))
        if lines is not None and own.any() and count <= 6 and self.cables[is_open].all():
            values = numerics.singular_values(lines[:, is_open])
            return own & (count <= numerics.rank(values))
        return own & (count <= 6)

    def given_tensions(self, lengths: Array) -> Array:
        """Given tensions (m,): those of the rest length, or the preload, or zero."""
        given = self._pull(lengths)
        given = np.where(self.cables, np.maximum(given, 0.0), given)
        if self.preload is not None:
            given = np.where(np.isnan(given), self.preload, given)
        return np.nan_to_num(given)

    def bounds(self, tensions: Array, which: Array) -> Bounds:
        """Bounds (p, ...) of lines `which` (m,), for their tensions (p, ...)
        without a bound.

        Cables keep their least force, else a share of the mean preload, or without one of
        those tensions, if that is possible. Neither that nor limits of drives are for
        lines with a rest length.
        """
        is_open, cables = self.rest_is_free()[which], self.cables[which]
        preload = 0.0
        if self.preload is not None and is_open.any():
            preload = float(np.nan_to_num(self.preload[which][is_open]).mean())
        mean = np.full((len(tensions), 1), max(preload, 0.0))
        if not preload > 0.0 and cables.any():
            mean = np.abs(tensions[:, cables]).mean(axis=1, keepdims=True)
        kept = np.where(is_open, numerics.TAUT_SHARE * mean, 0.0)
        least = np.full(len(cables), -np.inf) if self.least is None else self.least[which]
        most = np.full(len(cables), np.inf) if self.most is None else self.most[which]
        least = np.where(is_open & (least > 0.0) | ~cables, least, kept)
        return Bounds(
            np.where(is_open | cables, least, -np.inf),
            np.broadcast_to(np.where(is_open, most, np.inf), least.shape),
            cables,
        )

    def _at_rest(
        self, rest: Array, tensions: Array, given: Array, lengths: Array
    ) -> LineSprings:
        """The same lines with rest lengths at which they exert tensions,
        nearest to given ones.
        """
        for numbers in (tensions, given):
            numbers.flags.writeable = False
        return replace(self, rest_length=rest, balanced_at=(lengths, tensions, given))

    def geometry(self, posture: Posture) -> LineGeometry:
        """The lines at a posture, which caches those of a platform's own legs."""
        if (self.frame_a, self.frame_b) == ("world", "body"):
            known = posture.legs(self.anchors, self.points)
            if known is not None:
                return known
        T, _ = posture.relative(self.frame_a, self.frame_b)
        return line_geometry(T, self.anchors, self.points)

    def evaluate(self, posture: Posture) -> Evaluation:
        """Energy, gradient and Hessian at a posture."""
        _, to_pose = posture.relative(self.frame_a, self.frame_b)
        return pulled_back(*self._stretched(self.geometry(posture)), to_pose)

    def exerted(self, posture: Posture) -> Array:
        """The pulls of the lines on frame b."""
        geometry = self.geometry(posture)
        return -self.tensions(geometry.lengths)[:, None] * geometry.lines

    def member_forces(self, posture: Posture, gradient: Array) -> Array:  # noqa: ARG002
        """Sum (n,) of the absolute generalised forces of the lines."""
        geometry = self.geometry(posture)
        _, to_pose = posture.relative(self.frame_a, self.frame_b)
        t = np.abs(self.tensions(geometry.lengths))
        return np.asarray(t @ np.abs(geometry.lines @ to_pose.jacobian))

    def on_pose(self, T_a_b: Array) -> tuple[float, Array, Array]:
        """Energy, wrench and K^B in components of frame b."""
        return self._stretched(line_geometry(T_a_b, self.anchors, self.points))

    def _stretched(self, geometry: LineGeometry) -> tuple[float, Array, Array]:
        t, k = self.tensions(geometry.lengths), self._taut(geometry.lengths)
        stretch = geometry.lengths - self.rest_length
        K = (geometry.lines.T * k).dot(geometry.lines)
        if any(t.tolist()):
            K += second_derivative(geometry, self.points, t)
        return 0.5 * float(t.dot(stretch)), t.dot(geometry.lines), K

    def lines_and_rest(self, posture: Posture) -> tuple[Array, Array, Array] | None:
        """Lines g (m, 6) from F to M, stiffnesses k (m,), and the rest of K^B:
        the tensions'.
        """
        if (self.frame_a, self.frame_b) != ("world", "body"):
            return None
        geometry = self.geometry(posture)
        rest = second_derivative(geometry, self.points, self.tensions(geometry.lengths))
        return geometry.lines, self._taut(geometry.lengths), rest

    def _taut(self, lengths: Array) -> Array:
        """Stiffnesses, zero for slack cables."""
        if not self.unilateral:
            return self.stiffness
        return np.where(self.is_taut(lengths), self.stiffness, 0.0)


def _length(vector: Array) -> float:
    return numerics.norm(vector)


def _scaled(lines: Array) -> tuple[Array, Array]:
    """Lines (6, m) from (m, 6), moments and forces of one size, and the factors (6,)."""
    scale = np.repeat([1.0, float(np.abs(lines).max())], 3)
    return lines.T * scale[:, None], scale
