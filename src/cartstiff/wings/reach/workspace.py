r"""The workspace of a platform: volume, limiting constraints, inscribed bodies,
singular poses.

*Workspace.* Rays start at a centre, in the directions of a product rule on the sphere
(Gauss in height, equal steps around). The poses along each ray are scanned and every
boundary is bisected, which shows the limit that is reached there. The volume is that of
columns along z over a grid of the bounding box, scanned and bisected in the same way, so
that holes and disconnected parts count. Orientations are scanned along rays in the ball
of rotation vectors, where turns by up to theta about an axis are the share ``(theta - sin
theta) / pi`` of all rotations in that direction.

*Margins* are the distances of poses from each limit, zero at the limit and negative
beyond it. Cables, or more than six legs, with limits of their tensions carry a wrench W
if ``sum t_i g_i = W`` has a solution within the limits. W then lies in a zonotope, whose
facets are normal to n with n . g = 0 for five of the lines each ([BouchardGosselin]_),

    n . W <= sum_i max(n . g_i t_i),    t_i between its limits,

and the least of these differences, over \|n\|, is the margin: the wrench (moments over
the body's length) that may be added in any direction. The distribution of tensions
nearest to the middle t_m of the limits has a closed form,

    t = t_m + A^+ (W - A t_m),    A = (g_1, ..., g_m),

but exceeds the limits at some poses at which other distributions do not.

*Legs made of joints.* The joints of each leg follow from the body's pose. With the drives
held, the twists of the legs' passive joints J_i are equal at the body,

    J_1 dq_1 = J_2 dq_2 = ... = J_m dq_m.

Without redundancy these are as many equations as passive joints. Where their determinant
vanishes the body moves with all drives held; beyond that pose the determinant has the
other sign.

*Singular poses* are those where a determinant changes its sign. Poses around (R, p) are
``(R exp(x_1..3 / L), p + x_4..6)`` with L the body's length: \|x\| is then the distance
in the metric ``d^2 = |dp|^2 + (L angle)^2``. The nearest x with det(x) = 0 is the limit
of

    x <- g (g . x - det) / |g|^2,    g = grad det,

the shortest root of the linearised determinant, started at the nearest changes of sign on
rays.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import combinations, product
from typing import Any, ClassVar, Literal, NamedTuple, cast, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cartstiff.core import numerics
from cartstiff.core.arrays import (
    Array,
    checked_flag,
    checked_input,
    checked_length,
    plain,
)
from cartstiff.core.checked_call import checked
from cartstiff.core.choices import Distribution
from cartstiff.core.described import described
from cartstiff.core.errors import InputError
from cartstiff.core.figures import new_figure
from cartstiff.core.geometry import se3
from cartstiff.core.mechanisms.chain import Chain
from cartstiff.core.mechanisms.elastic import ElasticMechanism, checked_elastic
from cartstiff.core.mechanisms.gravity_loads import gravity_loads
from cartstiff.core.mechanisms.limits import Limits
from cartstiff.core.mechanisms.platform import Platform
from cartstiff.core.notes import Note
from cartstiff.core.potentials.line_springs import LineSprings, lines_of_many
from cartstiff.core.results import LabelledResult
from cartstiff.core.stiffness.applied_load import (
    DEAD_AT_ORIGIN,
    Axes,
    LoadKind,
    checked_load,
)
from cartstiff.files.struts.flexure_struts import FlexureStruts
from cartstiff.kinematics.at_pose import COORDINATES, at_poses
from cartstiff.kinematics.legs import Leg, legs_of
from cartstiff.kinematics.rods import rod_of
from cartstiff.recorded.arguments import TENSIONS
from cartstiff.recorded.quick_poses import QuickPoses
from cartstiff.recorded.recording import arrays_of_many
from cartstiff.wings.reach.architecture import architecture_of, orientation_rank


class PoseMargins:
    """Margins of the limits of a body's poses: first those of `Limits`, then others.

    Parameters
    ----------
    elastic : ElasticMechanism
        The mechanism.
    length : float
        Characteristic length.

    Attributes
    ----------
    limits : Limits
        Limits of the mechanism.
    sign : float
        Sign of the determinant at the centre; poses of the other sign do not count. 0:
        all count.
    free : sequence of int
        Independent coordinates of the pose; the others follow.
    is_slow : bool
        Whether a pose takes more than a few matrix products.
    is_quick : bool
        Whether a pose needs no iterations.
    """

    is_slow = is_quick = True
    free: Sequence[int] = range(6)
    legs: list[Leg] | None = None

    def __init__(self, elastic: ElasticMechanism, length: float) -> None:
        self.elastic, self.length, self.sign = elastic, length, 0.0
        self.limits = limits = Limits(elastic.mechanism)
        # Lengths and angles of a platform's legs are never negative.
        needless = (limits.lower == 0.0) & (limits.legs is not None)
        self._lower = np.flatnonzero(np.isfinite(limits.lower) & ~needless)
        self._upper = np.flatnonzero(np.isfinite(limits.upper))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the limits, with the side of each."""
        sides = (self._lower, "least"), (self._upper, "most")
        own = (f"{self.limits.names[i]}, {side}" for which, side in sides for i in which)
        home = self.elastic.mechanism.at(self.elastic.q).pose[None]
        q = self.solved(home)
        return (*own, *self.others(q, home, self._limit_margins(q, home)))

    def solved(self, poses: Array) -> Array:
        """Coordinates (N, n) at poses (N, 4, 4) of M,
        NaN at poses that are not reached.
        """
        return at_poses(self.elastic, _coordinates(poses), legs=self.legs)[0]

    def others(self, q: Array, poses: Array, limited: Array) -> dict[str, Array]:
        """Further margins (N,) by name, besides those of the limits (N, l)."""
        raise NotImplementedError

    def rates(self, q: Array, poses: Array) -> Array | None:
        """Matrices (N, p, p) that are singular at singular poses.

        None if they are not square.
        """
        raise NotImplementedError

    def distribution(self, pose: Array) -> dict[str, Any]:  # noqa: ARG002
        """Name of the distribution of tensions, and those at a pose;
        empty without limits.
        """
        return {}

    def reach(self, pose: Array) -> float:
        """Upper bound of the distance of the body from a pose."""
        raise NotImplementedError

    def _limit_margins(self, q: Array, poses: Array) -> Array:
        values = self.limits.values(q, poses)
        lower, upper = self._lower, self._upper
        return np.hstack(
            [
                values[:, lower] - self.limits.lower[lower],
                self.limits.upper[upper] - values[:, upper],
            ]
        )

    def at(self, poses: Array) -> Array:
        """Margins (N, k) at poses (N, 4, 4) of M.

        Infinity where a limit does not apply.
        """
        q = self.solved(poses)
        limited = self._limit_margins(q, poses)
        limited[~np.isfinite(q).all(axis=1)] = np.inf
        return np.column_stack([limited, *self.others(q, poses, limited).values()])

    def inside(self, poses: Array) -> NDArray[np.bool_]:
        """Return which poses (N,) are within all limits."""
        q = self.solved(poses)
        limited = self._limit_margins(q, poses)
        inside = np.asarray((limited >= 0.0).all(axis=1) & np.isfinite(q).all(axis=1))
        if (rows := np.flatnonzero(inside)).size:
            others = self.others(q[rows], poses[rows], limited[rows])
            inside[rows] = np.all([margin >= 0.0 for margin in others.values()], axis=0)
        return inside

    def determinants(self, poses: Array) -> Array:
        """Determinants (N,) of `rates`, NaN where these do not exist."""
        return self._read(numerics.determinants, poses, np.nan)

    def ratios(self, poses: Array) -> Array:
        """Smallest over largest singular value (N,) of `rates`,
        infinite where none exist.
        """
        return self._read(numerics.ratios, poses, np.inf)

    def _read(
        self, read: Callable[[Array], Array], poses: Array, otherwise: float
    ) -> Array:
        q = self.solved(poses)
        values, known = np.full(len(q), otherwise), np.isfinite(q).all(axis=1)
        if known.any() and (rates := self.rates(q[known], poses[known])) is not None:
            values[known] = read(rates)
        return values


class LegMargins(PoseMargins):
    """Margins of the limits of a body on legs.

    Parameters
    ----------
    elastic : ElasticMechanism
        A closed chain whose legs are independent when its body is held.
    pose : ndarray (4, 4)
        Pose of M at the centre, whose side of the singular poses counts.
    through : bool
        Whether poses beyond singular ones count as well.
    """

    legs: list[Leg]

    def __init__(
        self, elastic: ElasticMechanism, pose: Array, through: bool = False
    ) -> None:
        chain, legs = elastic.mechanism, legs_of(elastic, limits=False, poses=QuickPoses)
        if legs is None:
            raise InputError(
                "workspaces are found for platforms, and for bodies on legs or cables",
                expected="for an arm, a map of random postures "
                "(`cartstiff map --random`)",
                got=chain.kind,
            )
        super().__init__(elastic, float(chain.at(elastic.q).length))
        chain = cast(Chain, chain)  # others have no such legs
        self.chain, self.legs, self.is_quick = chain, legs, bool(chain.legs)
        actuated = frozenset(chain.actuated or ())
        self.rods = {
            id(leg): rod_of(leg, elastic.q[leg.columns], actuated) for leg in legs
        }
        q, self.free = at_poses(elastic, _coordinates(pose[None]), legs=legs)
        if not through and (rates := self.rates(q, pose[None])) is not None:
            self.sign = float(np.sign(numerics.determinants(rates)[0]))

    @property
    def keeps_modes(self) -> bool:
        """Whether the driven joint of every leg is known in closed form,
        in one working mode.
        """
        return self.is_quick or all(rod is not None for rod in self.rods.values())

    def others(self, q: Array, poses: Array, limited: Array) -> dict[str, Array]:  # noqa: ARG002
        """Missing length of each leg at poses that are not reached,
        and the determinant.
        """
        known, margins = np.isfinite(q).all(axis=1), dict[str, Array]()
        reached = np.where(known, np.inf, -1.0)
        for i, leg in enumerate(self.chain.legs):
            by = np.array(
                [leg.shape.short_of(T[:3, 3]) for T in poses[~known] @ leg.T_M_end]
            )
            short = margins[f"reach of leg{i + 1}"] = np.full(len(q), np.inf)
            short[~known] = np.where(by > 0.0, -by, np.inf)
            reached[short < 0.0] = np.inf
        margins["reach"] = reached
        if self.sign:
            margins["singularity"] = np.full(len(q), np.inf)
            if known.any() and (rates := self.rates(q[known], poses)) is not None:
                determinants = self.sign * numerics.determinants(rates)
                margins["singularity"][known] = np.nan_to_num(determinants, nan=np.inf)
        return margins

    def reach(self, pose: Array) -> float:  # noqa: ARG002
        """Twice the length of the shortest stretched leg,
        with its slides at their ends.
        """
        chain, lengths = self.chain, []
        bounds = np.array([[c.lower, c.upper] for c in chain.coordinates])
        for leg in self.legs:
            links = [np.linalg.norm(T[:3, 3]) for T in leg.chain.tree.placements()]
            slides = [
                j for j in leg.columns if chain.is_length[j] and j not in chain.virtual
            ]
            lengths.append(
                sum(links) + np.abs(bounds[slides].T - self.elastic.q[slides]).sum()
            )
        return 2.0 * _finite_least(lengths, "the slides have no limits")

    def rates(self, q: Array, poses: Array) -> Array | None:  # noqa: ARG002
        """Matrices (N, p, p) of the equations of the module, lengths over `length`;
        or None.
        """
        first = self.legs[0]
        body = first.solver.kinematics.at(q[:, first.columns]).pose @ se3.inverse(
            first.after
        )
        parts = [self._passive(leg, q, np.linalg.inv(body)) for leg in self.legs]
        total = sum(part.shape[2] for part in parts)
        if total != 6 * (len(parts) - 1) or any(leg.hangs for leg in self.legs):
            return None
        one, *others = parts
        return np.block(
            [
                [one, *(-part if i == j else 0.0 * part for j, part in enumerate(others))]
                for i in range(len(others))
            ]
        )

    def _passive(self, leg: Leg, q: Array, T_M_F: Array) -> Array:
        """Twists in M (N, 6, p) of a leg's passive joints, and of a ball at its end.

        Where universal joints or balls pass a pose at which their axes depend on each
        other, the determinants of these twists and of all twists change their signs
        together, though the body stays held: the sign of the latter is taken out.
        """
        there = leg.solver.kinematics.at(q[:, leg.columns])
        lengths = np.repeat([1.0, self.length], 3)
        ball = np.tile(np.eye(6)[:, : 3 * (leg.free == "rotation")], (len(q), 1, 1))
        J = np.concatenate([there.jacobian * leg.solver.sizes, ball], axis=2)
        J = se3.adjoint(T_M_F @ there.pose) @ J / lengths[:, None]
        # Without virtual joints; then without the driven ones.
        columns = np.append(leg.columns, np.full(ball.shape[2], -1))
        J, columns = (
            x[..., ~np.isin(columns, sorted(self.chain.virtual))] for x in (J, columns)
        )
        passive = J[..., ~np.isin(columns, self.chain.actuated or ())]
        if J.shape[2] == 6:
            passive[..., -1] *= np.sign(numerics.determinants(J))[:, None]
        elif (rod := self.rods[id(leg)]) is not None:
            own = q[:, leg.columns]
            passive[..., -1] *= rod.orientation(own, there.pose, there.jacobian)[:, None]
        return np.asarray(passive)


def _coordinates(poses: Array) -> Array:
    """x, y, z, roll, pitch, yaw (N, 6) of poses (N, 4, 4)."""
    return np.hstack([poses[:, :3, 3], se3.roll_pitch_yaw(poses)])


def _finite_least(lengths: Iterable[float], without: str) -> float:
    """Return the least length, which must be finite."""
    least = float(min(lengths))
    if not np.isfinite(least):
        raise InputError(
            f"{without}, so that the workspace has no bound",
            expected="legs.limits, or a radius",
        )
    return least


#: Kind of a load, its (moment, force) (6,) about its point, and the axes along which
#: these are constant.
CarriedLoad = tuple[LoadKind, Array, Axes]


def limits_forces(elastic: ElasticMechanism) -> bool:
    """Whether a load affects the limits: for cables, and for legs with `force`."""
    platform, springs = elastic.mechanism, elastic.springs
    if springs is None or not len(platform.points):
        return False
    return bool(springs.unilateral) or platform.tension_limits is not None


def lines_at(platform: Platform, poses: Array) -> tuple[Array, Array]:
    """Lengths (N, m) and line coordinates (N, m, 6) of the legs,
    moments over the body's length.
    """
    lines = lines_of_many(poses, platform.anchors, platform.points)
    return lines.lengths, lines.lines / np.repeat([platform.length, 1.0], 3)


def wrench_margins(lines: Array, wrench: Array, least: Array, most: Array) -> Array:
    """Margins (N,) of wrenches (N, 6) that lines (N, m, 6) carry with tensions within
    limits (m,).

    For tensions without upper limits, infinity means that every wrench can be carried
    (closure).
    """
    if len(lines) > _MARGINS_BLOCK:
        blocks = np.array_split(np.arange(len(lines)), len(lines) // _MARGINS_BLOCK + 1)
        return np.concatenate(
            [wrench_margins(lines[b], wrench[b], least, most) for b in blocks]
        )
    fives = np.array(list(combinations(range(lines.shape[1]), 5)))
    n = _normals(lines[:, fives])
    size = np.linalg.norm(n, axis=-1)
    n = n / np.maximum(size, numerics.TINY)[..., None]
    along = n @ lines.swapaxes(1, 2)  # (N, k, m)
    along[:, np.arange(len(fives))[:, None], fives] = 0.0
    along[np.abs(along) < numerics.RANK] = 0.0
    asked, margins = (n @ wrench[..., None])[..., 0], np.full(size.shape, np.inf)
    with np.errstate(invalid="ignore"):
        ends = along * least, along * most
    for sign, farthest in ((1.0, np.fmax), (-1.0, np.fmin)):
        reach = np.where(along, farthest(*ends), 0.0).sum(axis=-1)
        margins = np.minimum(margins, sign * (reach - asked))
    regular = size > numerics.RANK
    # Without five independent lines nothing is spanned.
    margins = np.where(regular, margins, np.inf).min(axis=1)
    return np.where(regular.any(axis=1), margins, -np.inf)


# Poses whose margins are computed at once.
_MARGINS_BLOCK = 100


def _normals(lines: Array) -> Array:
    """Vectors (..., 6) normal to five lines (..., 5, 6) each,
    as long as the lines' volume.

    Minors of the first rows follow from those of one row less by Laplace's expansion.
    """
    # Contiguous components: these products take most of the time of a workspace of
    # cables.
    rows = np.ascontiguousarray(np.moveaxis(lines, (-2, -1), (0, 1)))
    minors: dict[tuple[int, ...], Array] = {(k,): x for k, x in enumerate(rows[0])}
    product = np.empty(rows.shape[2:])
    for row, line in enumerate(rows[1:], 1):
        larger = {}
        for c in combinations(range(6), row + 1):
            total = larger[c] = line[c[row]] * minors[c[:row]]
            for i in range(row):
                np.multiply(line[c[i]], minors[c[:i] + c[i + 1 :]], out=product)
                (np.subtract if (row - i) % 2 else np.add)(total, product, out=total)
        minors = larger
    return np.stack(
        [(-1) ** k * n for k, n in enumerate(reversed(minors.values()))], axis=-1
    )


def _limits_of_forces(platform: Platform, springs: LineSprings) -> Array | None:
    """Least and largest forces (m, 2) in the legs; those of cables where none are given.

    None without limits.
    """
    m, forces = len(platform.points), platform.tension_limits
    if forces is None and springs.unilateral:
        slack = np.where(springs.cables, 0.0, -np.inf)
        forces = np.column_stack([slack, np.full(m, np.inf)])
    if forces is not None:
        springs.require_ideal_joints("limits of forces")
        if m < 6:
            raise InputError(
                "the forces in fewer than six legs do not follow from a load", got=m
            )
    return forces


def _check_distribution(tensions: str, forces: Array | None) -> None:
    """Refuse a distribution of tensions that does not exist within limits (m, 2)."""
    if tensions not in get_args(Distribution):
        raise InputError(
            "unknown distribution of tensions",
            expected=" or ".join(get_args(Distribution)),
            got=tensions,
        )
    if tensions != "any" and (forces is None or not np.isfinite(forces).all()):
        raise InputError(
            "the middle of the limits exists for cables, or more than six legs, with "
            "least and largest tensions",
            where="tensions",
            expected="legs.force",
            got=tensions,
        )


class Margins(PoseMargins):
    """Margins of a platform's limits.

    Parameters
    ----------
    elastic : ElasticMechanism
        A platform, or a body on cables.
    load : CarriedLoad, optional
        Load that legs with limited forces carry besides the weights. Their forces are
        those of `cartstiff.analyse`.
    sign : float
        Sign of the determinant of six legs' lines; poses of the other sign count as
        beyond the limit "singularity". 0: no such limit.
    tensions : {"any", "closed-form"}
        Tensions that may carry the load: any within their limits, or only those nearest
        to the middle of the limits.

    Attributes
    ----------
    names : tuple of str
        Names of the limits, with the side of each.
    """

    def __init__(
        self,
        elastic: ElasticMechanism,
        load: CarriedLoad | None = None,
        sign: float = 0.0,
        tensions: Distribution = "any",
    ) -> None:
        if elastic.springs is None or not len(elastic.mechanism.points):
            raise InputError(
                "workspaces are found for platforms and bodies on cables",
                got=elastic.mechanism.kind,
            )
        platform = cast(Platform, elastic.mechanism)
        springs = cast(LineSprings, elastic.springs)
        super().__init__(elastic, platform.length)
        self.platform, self.springs, self.sign = platform, springs, sign
        self.load, self.tensions = load, tensions
        m = len(platform.points)
        self.forces = _limits_of_forces(platform, springs)
        # A load determines the forces of six drives; springs that nothing drives keep
        # the rest lengths that they have.
        drives = np.broadcast_to(springs.driven, m)
        chosen = int(drives.sum()) if drives.any() else m
        is_redundant = bool(springs.unilateral) or chosen > 6
        self.is_spread = self.forces is not None and is_redundant
        if self.is_spread:
            # The limits choose among the balancing tensions, not the rest lengths. Here
            # any balancing tensions will do: those without a bound need no search.
            rest = np.full(m, np.nan)
            free = replace(
                springs,
                rest_length=rest,
                unilateral=False,
                preload=None,
                least=None,
                most=None,
                balanced_at=None,
            )
            self.elastic = replace(elastic, springs=free)
        _check_distribution(tensions, self.forces if self.is_spread else None)
        self.is_slow = self.is_spread or springs.gives_aside

    def solved(self, poses: Array) -> Array:
        """Return placeholders: a platform's limits follow from its poses alone."""
        return np.zeros((len(poses), 6))

    def others(self, q: Array, poses: Array, limited: Array) -> dict[str, Array]:  # noqa: ARG002
        """Margins of tensions or forces, the determinant, and the stability of struts."""
        _, lines = lines_at(self.platform, poses)
        margins = dict[str, Array]()
        if self.forces is not None:
            t = self._tensions(poses)
            least, most = self.forces.T
            if self.is_spread and self.tensions == "any":
                room = wrench_margins(lines, _wrenches_of(lines, t), least, most)
                # At the edge itself, as for cables without tension, no more can be
                # carried.
                margins["tensions"] = np.where(room > 0.0, room, np.fmin(room, -1.0))
            else:
                if self.is_spread:
                    t = self.middle_tensions(lines, _wrenches_of(lines, t))
                t = np.where(np.isfinite(t), t, np.inf)
                for side, left in (("least", t - least), ("most", most - t)):
                    margins |= {
                        f"force of leg{i + 1}, {side}": x for i, x in enumerate(left.T)
                    }
        if self.sign and lines.shape[1] == 6:
            margins["singularity"] = self.sign * numerics.determinants(lines)
        if self.springs.gives_aside:
            every = np.column_stack([limited, *margins.values()])
            struts = cast(FlexureStruts, self.springs)
            margins["flexures"] = self._strut_margins(poses, every, struts)
        return margins

    @staticmethod
    def _strut_margins(poses: Array, others: Array, struts: FlexureStruts) -> Array:
        """Return 1 where all struts are stable, -1 where one buckles or has no
        equilibrium (N,).

        Computed only at poses within all `others`; infinity elsewhere.
        """
        standing = np.full(len(poses), np.inf)
        for rows in np.array_split(
            np.flatnonzero((others >= 0.0).all(axis=1)), len(poses) // 500 + 1
        ):
            at = struts.many(poses[rows], np.zeros((len(poses[rows]), 6)))
            stable = (at.is_found & at.is_stable).all(axis=1)
            standing[rows] = np.where(stable, 1.0, -1.0)
        return standing

    def middle_tensions(self, lines: Array, asked: Array) -> Array:
        """The tensions (N, m) nearest to the middle of the limits that carry
        wrenches (N, 6).
        """
        middle = np.mean(self.forces, axis=1)  # type: ignore[arg-type]
        A = lines.swapaxes(1, 2)
        missing = asked - A @ middle
        change = (np.linalg.pinv(A, rcond=numerics.RANK) @ missing[..., None])[..., 0]
        left = np.abs((A @ change[..., None])[..., 0] - missing).max(axis=1)
        size = np.abs(missing).max(axis=1) + np.abs(A @ middle).max(axis=1)
        carried = left <= numerics.BALANCE_TOLERANCE * size
        return np.where(carried[:, None], middle + change, np.inf)

    def distribution(self, pose: Array) -> dict[str, Any]:
        """Name of the distribution, and the tensions nearest to the middle
        of the limits.
        """
        if self.forces is None or not self.is_spread:
            return {}
        answer: dict[str, Any] = {"distribution": self.tensions, "at_centre": None}
        if np.isfinite(self.forces).all():
            lines = lines_at(self.platform, pose[None])[1]
            t = self.middle_tensions(
                lines, _wrenches_of(lines, self._tensions(pose[None]))
            )
            answer["at_centre"] = t[0].tolist() if np.isfinite(t).all() else None
        return answer

    def reach(self, pose: Array) -> float:
        """Distance that the legs' longest lengths allow."""
        platform = self.platform
        longest = np.inf if platform.limits is None else platform.limits[:, 1]
        ends = se3.placed(pose, platform.points) - platform.anchors
        lengths = np.linalg.norm(ends, axis=1) + longest
        return _finite_least(lengths, "the lengths of the legs have no upper limit")

    def rates(self, q: Array, poses: Array) -> Array | None:  # noqa: ARG002
        """Six legs' lines (N, 6, 6), moments over the body's length."""
        lines = lines_at(self.platform, poses)[1]
        return lines if lines.shape[1] == 6 else None

    def _tensions(self, poses: Array) -> Array:
        """Tensions (N, m) that balance weights and load, as in `cartstiff.analyse`;
        or NaN.
        """
        kind, wrench, axes = self.load or (DEAD_AT_ORIGIN, None, "body")
        q = self.platform.coordinates_of(poses)
        found = arrays_of_many(self.elastic, (TENSIONS,), q, wrench, kind, axes)
        return found.arrays[TENSIONS]


def _wrenches_of(lines: Array, tensions: Array) -> Array:
    """Return the wrenches (N, 6) that lines (N, m, 6) with tensions (N, m) carry."""
    return np.asarray((tensions[:, None] @ lines)[:, 0])


@dataclass(frozen=True, eq=False)
class Lines:
    """Straight lines along which changes of the sign of a state are located.

    Attributes
    ----------
    state : callable
        Numbers (K,) at points (K, d).
    starts, ways : ndarray (N, d)
        Points and directions of the lines.
    places : ndarray (N, n)
        Places along each line at which it is scanned.
    """

    state: Callable[[Array], Array]
    starts: Array
    ways: Array
    places: Array

    def signs(self, progress: Progress | None = None) -> Array:
        """Return the signs (N, n) of the state at the places; `progress` counts lines."""
        count, n = self.places.shape
        signs, block = np.empty((count, n)), max(1, _SCAN_BLOCK // n)
        for i in range(0, count, block):
            rows = np.arange(i, min(i + block, count))
            found = self._sign(np.repeat(rows, n), self.places[rows].ravel())
            signs[rows] = found.reshape(-1, n)
            if progress is not None:
                progress(min(i + block, count), count)
        return signs

    def _sign(self, rows: NDArray[np.intp], places: Array) -> Array:
        return np.sign(self.state(self.starts[rows] + places[:, None] * self.ways[rows]))

    def changes(self, signs: Array, halvings: int) -> Changes:
        """Locate the changes of signs (N, n) by bisection."""
        line, step = np.nonzero(signs[:, 1:] * signs[:, :-1] < 0.0)
        before, start, far = (
            signs[line, step],
            self.places[line, step],
            self.places[line, step + 1],
        )
        near = start
        for _ in range(halvings if len(line) else 0):
            middle = 0.5 * (near + far)
            is_near = self._sign(line, middle) == before
            near, far = np.where(is_near, middle, near), np.where(is_near, far, middle)
        return Changes(line, start, near, far, before < 0.0, halvings * len(line))


class Changes(NamedTuple):
    """Changes of a state along lines.

    Attributes
    ----------
    line : ndarray of int (k,)
        Number of the line.
    start, near, far : ndarray (k,)
        Last place of the scan, and bracketing places, before and after the change.
    enters : ndarray of bool (k,)
        Whether the state is negative before the change.
    tried : int
        Number of evaluations of the state.
    """

    line: NDArray[np.intp]
    start: Array
    near: Array
    far: Array
    enters: NDArray[np.bool_]
    tried: int


# Bisections of each boundary, which leave 1e-6 of a scan's step.
_HALVINGS = 20
# Largest number of poses evaluated at once in a scan.
_SCAN_BLOCK = 20_000
# Largest number of times that the box of the columns is widened.
_WIDENINGS = 5
# Search for inscribed bodies: directions of the search and of the result, poses along
# each direction, and places tried.
_DIRECTIONS, _CHECKED, _SCAN, _PLACES = 50, 800, 10, 40
Progress = Callable[[int, int], None]
#: Poses (N, 4, 4) of offsets (N, 3) from the centre.
Moved = Callable[[Array], Array]


@dataclass(frozen=True, eq=False)
class Rays:
    """Rays from a centre to the boundaries.

    Attributes
    ----------
    directions : ndarray (d, 3)
        Unit vectors.
    weights : ndarray (d,)
        Weights of the rule, of sum 1.
    first : ndarray (d,)
        Distance (or angle) to the first boundary; 0 if the centre is outside.
    ray, distance, enters, limit : ndarray (k,)
        Every boundary, in order along each ray: number of its ray, distance, whether the
        ray enters there, and name of the limit that is reached, or "radius" or "half
        turn" at a ray's end.
    reach : float
        Length of the rays.
    poses : int
        Number of poses evaluated.
    """

    directions: Array
    weights: Array
    first: Array
    ray: NDArray[np.intp]
    distance: Array
    enters: NDArray[np.bool_]
    limit: NDArray[np.str_]
    reach: float
    poses: int

    @property
    def is_cut_short(self) -> bool:
        """Whether the end of a ray is inside."""
        return bool((self.distance >= (1.0 - 0.5**_HALVINGS) * self.reach).any())

    @property
    def offsets(self) -> Array:
        """Offsets (k, 3) of the boundaries from the centre."""
        return self.distance[:, None] * self.directions[self.ray]

    def total(self, measure: Callable[[Array], Array]) -> float:
        """Weighted sum over the rays of a measure of their parts inside."""
        signs = np.where(self.enters, -1.0, 1.0)
        return float((self.weights[self.ray] * signs * measure(self.distance)).sum())

    def shares(self) -> dict[str, float]:
        """Share of each limit in the outermost boundary,
        by solid angle from the centre.
        """
        leaves = np.flatnonzero(~self.enters)
        rays, last = np.unique(self.ray[leaves][::-1], return_index=True)
        names, where = np.unique(self.limit[leaves][::-1][last], return_inverse=True)
        shares = np.bincount(where, self.weights[rays])
        shares = shares / shares.sum()
        order = np.argsort(-shares, kind="stable")
        return dict(zip(names[order].tolist(), shares[order].tolist(), strict=True))


def sphere_rule(count: int) -> tuple[Array, Array]:
    """Return about `count` directions (d, 3) and weights (d,): Gauss in height,
    equal turns.
    """
    rows = max(2, round(np.sqrt(count / 2.0)))
    height, weight = np.polynomial.legendre.leggauss(rows)
    turns = (np.arange(2 * rows) + 0.5) * np.pi / rows
    z, angle = (part.ravel() for part in np.meshgrid(height, turns, indexing="ij"))
    radius = np.sqrt(1.0 - z * z)
    directions = np.stack([radius * np.cos(angle), radius * np.sin(angle), z], axis=1)
    return directions, np.repeat(weight, 2 * rows) / (4.0 * rows)


def rays_to_boundaries(
    margins: PoseMargins,
    pose_at: Moved,
    reach: float,
    count: int,
    scan: int,
    progress: Progress | None = None,
    end: str = "radius",
) -> Rays:
    """Find boundaries along rays.

    `pose_at` maps offsets (N, 3) from the centre to poses.
    """
    directions, weights = sphere_rule(count)
    d = len(directions)
    steps = np.tile(np.linspace(0.0, reach, scan + 1), (d, 1))
    lines = Lines(_side(margins, pose_at), np.zeros((d, 3)), directions, steps)
    signs = lines.signs(progress)
    signs[:, -1] = -1.0
    ray, _, near, far, enters, tried = lines.changes(signs, _HALVINGS)
    outside = np.where(enters, near, far)
    left = margins.at(pose_at(outside[:, None] * directions[ray]))
    names = np.array([*margins.names, end])
    # No limit is reached where all margins are left.
    names = names[np.where((left >= 0.0).all(axis=1), -1, left.argmin(axis=1))]
    edge = np.where(enters, far, near)  # the bracketing pose within the limits
    first = np.zeros(d)
    rays, where = np.unique(ray, return_index=True)
    first[rays] = np.where(enters[where], 0.0, edge[where])
    return Rays(
        directions, weights, first, ray, edge, enters, names, reach, signs.size + tried
    )


def _side(margins: PoseMargins, pose_at: Moved) -> Callable[[Array], Array]:
    """Return the function that is 1 at offsets (N, 3) within all limits, -1 at others."""
    return lambda offsets: np.where(margins.inside(pose_at(offsets)), 1.0, -1.0)


class Columns(NamedTuple):
    """Columns of positions inside the workspace, along z.

    Attributes
    ----------
    volume : float
        Volume of all columns.
    ends : ndarray (k, 2)
        Lower and upper end of each part inside, in F.
    area : float
        Cross-section of a column.
    poses : int
        Number of poses evaluated.
    error : float
        Three standard errors of the volume, from the scatter of four grids of every
        second column.
    """

    volume: float
    ends: Array
    area: float
    poses: int
    error: float = 0.0

    def slices(self, count: int) -> list[tuple[float, float]]:
        """Height and area of `count` slices normal to z, at equal distances."""
        if not len(self.ends):
            return []
        low, high = float(self.ends[:, 0].min()), float(self.ends[:, 1].max())
        heights = low + (np.arange(count) + 0.5) * (high - low) / count
        within = (self.ends[:, :1] <= heights) & (heights <= self.ends[:, 1:])
        areas = self.area * within.sum(axis=0)
        return list(zip(heights.tolist(), areas.tolist(), strict=True))


def columns_inside(
    margins: PoseMargins,
    pose_at: Moved,
    centre: Array,
    boundary: Array,
    count: int,
    scan: int,
    reach: float,
) -> Columns:
    """Scan columns over the box around boundary positions (k, 3),
    widened until it holds all.

    Positions further than `reach` from the centre do not count.
    """

    def side(places: Array) -> Array:
        offsets = places - centre
        near = np.linalg.norm(offsets, axis=1) <= reach
        sides = np.full(len(places), -1.0)
        sides[near] = _side(margins, pose_at)(offsets[near])
        return sides

    if not len(boundary):
        return Columns(0.0, np.empty((0, 2)), 0.0, 0)
    # A box with a margin; it is widened until no boundary of it is inside.
    low, high = boundary.min(axis=0), boundary.max(axis=0)
    wide = np.maximum(high - low, numerics.NEGLIGIBLE_DISTANCE * reach)
    low, high = low - 0.03 * wide, high + 0.03 * wide
    poses, n = 0, count * count
    for _ in range(_WIDENINGS):
        middles = low + (np.arange(count) + 0.5)[:, None] * (high - low) / count
        xy = np.stack(np.meshgrid(*middles.T[:2], indexing="ij"), axis=-1).reshape(-1, 2)
        z = np.tile(np.linspace(low[2], high[2], scan + 1), (n, 1))
        up = np.tile([0.0, 0.0, 1.0], (n, 1))
        lines = Lines(side, np.column_stack([xy, np.zeros(n)]), up, z)
        signs = lines.signs()
        poses += signs.size
        inside = (signs > 0.0).reshape(count, count, -1)
        if not any(np.take(inside, [0, -1], axis).any() for axis in range(3)):
            break
        middle, wide = 0.5 * (low + high), 1.3 * (high - low)
        low, high = middle - 0.5 * wide, middle + 0.5 * wide
    # Where the columns enter and leave, by halving; the volume is that of their lengths.
    signs[:, [0, -1]] = -1.0
    row, _, near, far, enters, tried = lines.changes(signs, _HALVINGS)
    edge = 0.5 * (near + far)
    area = float(np.prod((high - low)[:2]) / n)
    ends = np.column_stack([edge[enters], edge[~enters]])
    heights = np.bincount(row[enters], ends[:, 1] - ends[:, 0], n)
    grid = heights.reshape(count, count)
    # Four grids of every second column: their spread is the error.
    coarse = [grid[i::2, j::2].mean() * n * area for i in (0, 1) for j in (0, 1)]
    error = 1.5 * float(np.std(coarse, ddof=1))
    return Columns(area * float(heights.sum()), ends, area, poses + tried, error)


def inscribed(
    margins: PoseMargins, pose_at: Moved, centre: Array, positions: Rays
) -> tuple[tuple[Array, float], tuple[Array, float]]:
    """Find the largest sphere and cube inside by a direct search that starts
    at the centre.
    """
    from scipy.optimize import minimize

    reach, scan = positions.reach, _SCAN
    corners = np.array([c for c in product((-1.0, 0.0, 1.0), repeat=3) if any(c)])
    corners /= np.linalg.norm(corners, axis=1)[:, None]
    few, many = (np.vstack([corners, sphere_rule(n)[0]]) for n in (_DIRECTIONS, _CHECKED))
    steps = np.linspace(0.0, reach, scan + 1)

    def room(place: Array, directions: Array, size: Array) -> float | None:
        """The least of sizes (d,) times distances to the boundary; None outside."""
        d = len(directions)
        starts, places = np.tile(place, (d, 1)), np.tile(steps, (d, 1))
        lines = Lines(_side(margins, pose_at), starts, directions, places)
        signs = lines.signs()
        if signs[0, 0] < 0.0:
            return None
        signs[:, -1] = -1.0
        k = np.argmin(signs, axis=1)
        signs[np.arange(scan + 1) > k[:, None]] = -1.0  # the first boundary counts
        # Directions whose boundary is farther than another bracket are not refined.
        signs[steps[k - 1] * size > (steps[k] * size).min()] = 0.0
        ends = lines.changes(signs, _HALVINGS // 2)
        return float((ends.near * size[ends.line]).min())

    def largest(size: Callable[[Array], Array]) -> tuple[Array, float]:
        sizes = size(few)

        def less(place: Array) -> float:
            margin = room(place, few, sizes)
            return numerics.norm(place) if margin is None else -margin

        inner = positions.first.min() or 0.1 * reach
        simplex = np.vstack([np.zeros(3), np.eye(3) * max(inner, 0.02 * reach)])
        options = {
            "initial_simplex": simplex,
            "maxfev": _PLACES,
            "xatol": 0.0,
            "fatol": 0.0,
        }
        best = minimize(less, np.zeros(3), method="Nelder-Mead", options=options)
        return centre + best.x, room(best.x, many, size(many)) or 0.0

    sphere = largest(lambda directions: np.ones(len(directions)))
    cube = largest(lambda directions: np.abs(directions).max(axis=1))
    return sphere, (cube[0], 2.0 * cube[1])


#: Determinants (N,) at poses (N, 4, 4), NaN where there is none.
Determinant = Callable[[Array], Array]
# Search for the nearest singular pose: bisections on rays, Newton steps and starts.
_BISECTIONS, _STEPS, _STARTS = 40, 60, 48
# Step of the difference quotients of the determinant, as a share of the characteristic
# length.
_STEP = numerics.DIFFERENCE_STEP


@dataclass(frozen=True, eq=False)
class Singular:
    """The singular poses around a pose.

    Attributes
    ----------
    surface : ndarray (k, 3)
        Values of the workspace's axes at which the determinant changes its sign on the
        rays, regardless of limits.
    distance : float or None
        Distance of the nearest singular pose found, in the metric of the module, a
        length; None if none was found.
    pose : ndarray (4, 4) or None
        That pose of M.
    shift : float or None
        Distance of the nearest singular position found with the same orientation.
    length : float
        L of the metric.
    """

    surface: Array
    distance: float | None = None
    pose: Array | None = None
    shift: float | None = None
    length: float = 1.0

    def to_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {"metric": "sqrt(distance^2 + (length angle)^2)", **plain(self)}


def singular_around(
    margins: PoseMargins, pose: Array, moved: Moved, rays: Rays, scan: int
) -> Singular | None:
    """Find singular poses around a pose, the surface on rays; None without a determinant.

    The surface is returned as offsets from the pose.
    """
    if not margins.sign:
        return None
    signed = margins.determinants
    length = margins.length
    surface = crossings(signed, moved, rays.directions, rays.reach, scan)
    if len(margins.free) < 6:
        return Singular(surface, length=length)
    few = 10 if margins.is_slow else 200
    x = nearest_singular(signed, pose, length, np.pi * length, range(6), few)
    shift = nearest_singular(signed, pose, length, np.pi * length, range(3, 6), few)
    return Singular(
        surface,
        None if x is None else numerics.norm(x),
        None if x is None else around(pose, x[None, :3] / length, x[None, 3:])[0],
        None if shift is None else numerics.norm(shift),
        length,
    )


def least_ratio(
    margins: PoseMargins, moved: Moved, rays: Rays
) -> tuple[float, Array] | None:
    """Return the least ratio of singular values found inside the limits, and its offset.

    The search starts at the best of the poses on the rays, and goes from each in steps in
    random directions, within the limits, that are halved where none of them is better.
    """
    shares = np.linspace(0.0, 1.0, 9)
    offsets = (shares[:, None, None] * rays.first[:, None] * rays.directions).reshape(
        -1, 3
    )
    offsets = np.concatenate([offsets, rays.offsets])
    ratio = margins.ratios(moved(offsets))
    if np.isinf(ratio).all():
        return None
    few, tries = (8, 8) if margins.is_slow or not margins.is_quick else (40, 16)
    first = np.argsort(ratio, kind="stable")[
        : 5 * few : 5
    ]  # neighbours lead to the same place
    x, least = offsets[first], ratio[first]
    step = np.full(len(x), 2.0 * rays.reach / np.sqrt(len(rays.directions)))
    rng = np.random.default_rng(17)
    for _ in range(_STEPS):
        ways = rng.normal(size=(len(x), tries, 3))
        ways *= step[:, None, None] / np.linalg.norm(ways, axis=2, keepdims=True)
        tried = (x[:, None] + ways).reshape(-1, 3)
        found, inside = np.full(len(tried), np.inf), margins.inside(moved(tried))
        if inside.any():
            found[inside] = margins.ratios(moved(tried[inside]))
        best = found.reshape(len(x), tries).argmin(axis=1) + tries * np.arange(len(x))
        is_better = found[best] < least
        x, least = (
            np.where(is_better[:, None], tried[best], x),
            np.where(is_better, found[best], least),
        )
        step = np.where(is_better, step, 0.5 * step)
        if step.max() < numerics.NEGLIGIBLE_CHANGE * rays.reach:
            break
    k = int(least.argmin())
    # The limit may be the singular poses themselves.
    return (float(least[k]) if least[k] > numerics.RANK else 0.0), x[k]


def crossings(
    signed: Determinant, moved: Moved, directions: Array, reach: float | Array, scan: int
) -> Array:
    """Return offsets (k, d) along rays of length `reach` where a determinant
    changes its sign.
    """
    steps = np.linspace(np.zeros(len(directions)), reach, scan + 1, axis=-1)

    def state(offsets: Array) -> Array:
        return signed(moved(offsets))

    lines = Lines(state, np.zeros_like(directions), directions, steps)
    ray, start, near, far, *_ = lines.changes(lines.signs(), _BISECTIONS)
    points: Array = near[:, None] * directions[ray]
    # A jump of the determinant is no root: a leg folds over or changes its branch.
    if len(points):
        low, high, there = (
            np.abs(state(x[:, None] * directions[ray])) for x in (near, far, start)
        )
        points = points[np.maximum(low, high) <= numerics.LOST_ERROR * there]
    return points


def nearest_singular(
    signed: Determinant,
    pose: Array,
    length: float,
    reach: float,
    axes: Sequence[int],
    rays: int,
) -> Array | None:
    """The shortest x (6,) found, in the module's metric, at which a determinant vanishes.

    Only the components `axes` of x vary. The search starts on `rays` rays per component
    of length `reach`; None if the determinant changes its sign on none of them.
    """
    rng = np.random.default_rng(6)
    n = len(axes)

    def at(x: Array) -> Array:
        full = np.zeros((len(x), 6))
        full[:, list(axes)] = x
        return around(pose, full[:, :3] / length, full[:, 3:])

    directions = rng.normal(size=(rays * n, n))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    starts = crossings(signed, at, directions, reach, 32)
    if not len(starts):
        return None
    x = starts[np.argsort(np.linalg.norm(starts, axis=1))[:_STARTS]]
    best, h = x.copy(), _STEP * length
    for _ in range(_STEPS):
        tried = x[:, None] + h * np.vstack([np.zeros((1, n)), np.eye(n), -np.eye(n)])
        values = signed(at(tried.reshape(-1, n))).reshape(len(x), -1)
        value, g = values[:, 0], (values[:, 1 : n + 1] - values[:, n + 1 :]) / (2.0 * h)
        with np.errstate(all="ignore"):
            new = (
                g * ((g * x).sum(axis=1) - value)[:, None] / (g * g).sum(axis=1)[:, None]
            )
        known = np.isfinite(new).all(axis=1)
        step = np.where(known[:, None], new - x, 0.0)
        # Limit steps to the range in which the determinant is about linear.
        size = np.linalg.norm(step, axis=1)
        x = x + step * np.minimum(1.0, 0.2 * length / np.maximum(size, h))[:, None]
        best = np.where((size <= h)[:, None], x, best)
        if (size <= numerics.REPORTED_ERROR * length).all():
            break
    size = np.linalg.norm(best, axis=1)
    ends = crossings(signed, at, best / size[:, None], 1.05 * size, 64)
    if not len(ends):
        return None
    nearest = np.zeros(6)
    nearest[list(axes)] = min(ends, key=np.linalg.norm)
    return nearest


def around(pose: Array, turns: Array, shifts: Array) -> Array:
    """Turn a pose by rotation vectors (N or 1, 3) in M and shift it by vectors in F:
    (N, 4, 4).
    """
    count = np.broadcast_shapes(turns.shape, shifts.shape)[0]
    poses = np.tile(pose, (count, 1, 1))
    poses[:, :3, :3] = pose[:3, :3] @ se3.exp(np.hstack([turns, 0.0 * turns]))[:, :3, :3]
    poses[:, :3, 3] += shifts
    return poses


def carried(kind: LoadKind, wrench: Array, axes: Axes, start: Array) -> CarriedLoad:
    """Convert a load to the axes along which it is constant at all poses."""
    if kind.kind == "conservative":
        raise InputError(
            "a moment that turns by half depends on where the body comes from",
            where="load_kind",
            expected="dead or follower",
            got=kind.kind,
        )
    parts, R = wrench.reshape(2, 3), start[:3, :3]
    if kind.kind == "follower":
        return kind, (parts @ R if axes == "world" else parts).reshape(6), "body"
    return kind, (parts @ R.T if axes == "body" else parts).reshape(6), "world"


def singular_note(margins: Margins, pose: Array) -> Note | None:
    """The note on an architecture or orientation that is singular everywhere, or None."""
    platform, m = margins.platform, len(margins.platform.points)
    note = None if m < 6 else architecture_of(platform).note()
    if note is not None or m != 6 or margins.springs.unilateral:
        return note
    rank = orientation_rank(platform, pose[:3, :3])
    if rank == 6:
        return None
    message = (
        f"with this orientation the legs' lines have rank {rank} at every position, "
        "though the "
        "architecture is regular (as Fichter's platform turned by a right angle)"
    )
    return Note("orientation-singularity", message, {"rank": rank})


@dataclass(frozen=True, eq=False, repr=False)
class Workspace(LabelledResult):
    """Workspace of a platform or a body on legs: positions at one orientation, and
    rotations.

    Attributes
    ----------
    elastic : ElasticMechanism
        The mechanism.
    pose : ndarray (4, 4)
        Pose of M at the centre of the rays.
    positions, turns : Rays or None
        Rays of positions with the orientation of `pose`, and of rotations at its
        position.
    columns : Columns or None
        The positions inside, as columns along z.
    sphere, cube : tuple of (centre (3,), size) or None
        Largest sphere (radius) and cube along the axes of F (edge) found inside.
    singularity : tuple of (ratio, position) or None
        Least ratio of singular values of six legs' lines, moments over the body's length,
        that a search from the rays found on the poses inside, and where it is.
    singular : Singular or None
        Poses where the determinant of six legs changes its sign, and distance of the
        nearest one.
    margin : float
        Least margin at the centre, in the unit of its limit; negative if it is outside.
    distribution : dict
        Name of the "distribution" of tensions and those "at_centre" (m,); empty if no
        tensions are limited.
    axes : tuple of str
        Coordinates of the pose that vary: x, y, z, or those of a body with fewer
        freedoms. Rays and columns use angles as lengths, with a quarter of a turn equal
        to the reach.
    scales : ndarray (3,)
        Factors from offsets on rays to these coordinates.
    load : mapping, optional
        The wrench that is carried, its kind, point and axes.
    notes : tuple of Note
        Assumptions, and results that do not exist.
    """

    command: ClassVar = "workspace"

    elastic: ElasticMechanism
    pose: Array
    positions: Rays | None = None
    turns: Rays | None = None
    columns: Columns | None = None
    sphere: tuple[Array, float] | None = None
    cube: tuple[Array, float] | None = None
    singularity: tuple[float, Array] | None = None
    singular: Singular | None = None
    margin: float | None = None
    distribution: dict[str, Any] = field(default_factory=dict)
    axes: tuple[str, ...] = ("x", "y", "z")
    scales: Array = field(default_factory=lambda: np.ones(3))
    load: Mapping[str, Any] | None = None
    notes: tuple[Note, ...] = ()

    @property
    def volume(self) -> float | None:
        """Volume of the positions at this orientation, in the units of the axes."""
        if self.columns is None:
            return None
        return self.columns.volume * float(self.scales.prod())

    @property
    def volume_error(self) -> float | None:
        """Estimate of the volume's error.

        The larger of three standard errors of the columns' sum, `Columns.error`, and the
        difference from the volume that the rays enclose, ``4 pi/3`` of the mean of their
        lengths cubed.
        """
        if self.columns is None or self.positions is None:
            return None
        by_rays = self.positions.total(lambda r: 4.0 / 3.0 * np.pi * r**3)
        error = max(self.columns.error, abs(by_rays - self.columns.volume))
        return error * float(self.scales.prod())

    @property
    def share_of_rotations(self) -> float | None:
        """Share of all rotations that is allowed at this position."""
        if self.turns is None:
            return None
        return self.turns.total(lambda angle: (angle - np.sin(angle)) / np.pi)

    @property
    def least_turn(self) -> float | None:
        """Largest angle in rad by which the body can turn about every axis,
        from the centre.
        """
        return None if self.turns is None else float(self.turns.first.min())

    @property
    def axes_with_units(self) -> list[str]:
        """Heads of tables and figures: "x [m]"."""
        unit = self.elastic.units.length
        return [f"{name} [{unit if name in 'xyz' else 'rad'}]" for name in self.axes]

    @property
    def boundary(self) -> Array:
        """Values (k, 3) of the axes, in their units, on the boundary, just within the
        limits.
        """
        if self.positions is None:
            return np.empty((0, 3))
        return self.positions.offsets * self.scales + self.centre

    @property
    def centre(self) -> Array:
        """Values (3,) of the axes, in their units, where the rays start."""
        every = np.append(self.pose[:3, 3], se3.roll_pitch_yaw(self.pose))
        return np.asarray(every[[COORDINATES.index(name) for name in self.axes]])

    @property
    def slices(self) -> list[tuple[float, float]]:
        """Values of the last axis at equal distances, and cross-sections normal to it."""
        (a, b, c), z = self.scales, self.centre[2]
        areas = [] if self.columns is None else self.columns.slices(9)
        return [(z + c * (x - z), a * b * area) for x, area in areas]

    def _lines(self) -> list[str]:
        return [
            f"Workspace of {self.elastic.name}: volume {self.volume}",
            f"  turns in every direction {self.least_turn} rad",
        ]

    def to_dict(self) -> dict[str, Any]:
        """For JSON: numbers, lists, texts, None."""
        sphere, cube, near = self.sphere, self.cube, self.singularity
        parts = (self.positions, self.turns, self.columns)
        own = {
            "cut_by": {} if self.positions is None else self.positions.shares(),
            "slices": [{"z": z, "area": area} for z, area in self.slices],
            "poses": sum(0 if part is None else part.poses for part in parts),
            "sphere": sphere and {"centre": sphere[0], "radius": sphere[1]},
            "cube": cube and {"centre": cube[0], "edge": cube[1]},
            "rotations": self._rotations(),
            "singularity": near and {"least_ratio": near[0], "position": near[1]},
            "singular": self.singular and self.singular.to_dict(),
            "tensions": self.distribution or None,
            "limits": [] if self.positions is None else self.positions.limit,
        }
        elastic = self.elastic
        return described(
            "workspace", own, elastic.about(), gravity_loads(elastic).to_dict(), self
        )

    def _rotations(self) -> dict[str, Any] | None:
        """Rotations at the centre, for JSON."""
        if self.turns is None:
            return None
        return {
            "share": self.share_of_rotations,
            "every_axis": self.least_turn,
            "cut_by": self.turns.shares(),
        }

    def plot(self, ax: Any = None) -> Any:
        """Draw the boundary in space and along three axes,
        by the limit that is reached there.

        Parameters
        ----------
        ax : matplotlib.axes.Axes, optional
            Whose place the picture takes; default a figure of its own.
        """
        figure = new_figure(11.0, 8.0, self.elastic.springs_in_doubt, ax=ax)
        from matplotlib import colormaps

        # One colour for each limit that cuts the boundary.
        labels, places, singular = self.axes_with_units, self.boundary, self.singular
        names = np.array([]) if self.positions is None else self.positions.limit
        colours = colormaps["tab20"].colors  # type: ignore[attr-defined]
        is_place = self.axes == ("x", "y", "z")
        # From one corner, and from three sides.
        panels: tuple[tuple[tuple[int, ...], str | None, str], ...] = (
            ((0, 1, 2), "3d", "box"),
            ((0, 1), None, "datalim"),
            ((0, 2), None, "datalim"),
            ((1, 2), None, "datalim"),
        )
        for position, (plane, projection, adjusted) in enumerate(panels, start=1):
            axis = figure.add_subplot(2, 2, position, projection=projection)
            for k, kind in enumerate(np.unique(names)):
                axis.scatter(
                    *places[names == kind][:, plane].T,
                    s=4,
                    color=colours[k % 20],
                    label=kind,
                )
            # Singular places in space only: flat, they would hide the boundary.
            if projection and singular is not None and len(singular.surface):
                axis.scatter(
                    *singular.surface.T, s=1, color="0.6", label="singular surface"
                )
            for i, name in zip(plane, "xyz", strict=False):
                getattr(axis, f"set_{name}label")(labels[i])
            if is_place:
                axis.set_aspect("equal", adjustable=adjusted)
        if names.size:
            figure.legend(
                *axis.get_legend_handles_labels(),
                loc="outside lower center",
                ncols=4,
                fontsize=7,
                markerscale=3,
            )
        words = "boundary with one orientation" if is_place else "boundary"
        figure.suptitle(f"{self.elastic.name}: {words}, and the limit that cuts")
        return figure


@checked
def workspace(
    elastic: ElasticMechanism,
    q: ArrayLike | None = None,
    *,
    wrench: ArrayLike | None = None,
    load_kind: Literal["dead", "follower"] = "dead",
    load_at: ArrayLike = (0.0, 0.0, 0.0),
    load_axes: Axes = "body",
    directions: int | None = None,
    scan: int = 48,
    radius: float | None = None,
    through_singularities: bool = False,
    tensions: Distribution = "any",
    fits: bool = True,
    progress: Progress | None = None,
) -> Workspace:
    """Workspace of a platform, or of a body on cables or legs,
    within all limits of its file.

    Parameters
    ----------
    elastic : ElasticMechanism
        A mechanism with limits of its legs: lengths, angles of joints, diameters, forces
        or tensions; or a body on legs made of joints, with the limits of these. For a
        body with fewer than six freedoms its first three independent coordinates vary.
    q : array_like (6,), optional
        Pose at the centre: its orientation is kept for positions, and its position for
        rotations. Default the file's pose.
    wrench : array_like (6,), optional
        Load W (moment, force) that the environment applies to the body at `load_at`. It
        is taken into account for limits of forces or tensions, as the body's weight under
        gravity is.
    load_kind : {"dead", "follower"}
        dead: it keeps its direction in the room while the body turns; follower: it turns
        with it.
    load_at : array_like (3,)
        The point of the body, in M, about which its moment is and at which its force
        acts.
    load_axes : {"body", "world"}
        Axes of its components: those of M at the centre, or F's.
    directions : int, optional
        Approximate number of rays, and of columns; 1000, or 200 for cables, for more than
        six legs with limited forces, for struts with flexures, and for legs made of
        joints.
    scan : int
        Number of poses along each ray. Between two of them a boundary is found by
        bisection; gaps and parts thinner than ``reach / scan`` may be missed.
    radius : float, optional
        Largest distance of positions; default the one that the longest lengths allow.
    through_singularities : bool
        Count poses beyond singular ones, where the determinant of six legs has the other
        sign.
    tensions : {"any", "closed-form"}
        Which tensions of cables, or forces of more than six legs with limits, may carry
        the load at a pose that counts: any within the limits, or those in closed form
        that are nearest to the middle of the limits.
    fits : bool
        Find the largest sphere and cube inside.
    progress : callable, optional
        Called with (done, total).

    Returns
    -------
    Workspace
        Volumes, boundaries with the limit of each, sphere and cube, singularities.

    Raises
    ------
    InputError
        For mechanisms without legs, without limits, or an unbounded workspace.
    """
    checked_elastic(elastic)
    through = checked_flag(through_singularities, "through_singularities")
    elastic, posture = elastic.placed(q)
    kind = checked_load(load_kind, load_at, load_axes, wrench is not None)
    if scan < 2 or (directions is not None and directions < 8):
        raise InputError("too few poses", expected="scan from 2, directions from 8")
    pose, about_load, load = posture.pose, None, None
    if wrench is not None:
        given = checked_input(wrench, (6,), "wrench")
        load = carried(kind, given, load_axes, pose)
        about_load = {
            "wrench": given,
            "kind": kind.kind,
            "at": kind.at,
            "axes": load_axes,
        }
    margins = _margins(elastic, pose, load, tensions, through)
    if isinstance(margins, Note):
        return Workspace(elastic, pose, notes=(*elastic.notes, margins))
    count = directions or (200 if margins.is_slow else 1000)
    most = margins.reach(pose) if radius is None else checked_length(radius, "radius")
    axes, scales, moved = _axes_of_rays(margins, pose, most)
    here = Workspace(elastic, pose, axes=axes, scales=scales, load=about_load)
    # Rays to the boundaries of positions, columns over their box, rays of rotations.
    is_open = radius is None
    positions = _rays_within(margins, moved, most, is_open, count, scan, progress)
    boundary = positions.offsets + here.centre
    side = 2 * max(4, round(0.5 * np.sqrt(count)))  # halves of the grid are alike
    columns = columns_inside(margins, moved, here.centre, boundary, side, scan, most)
    turned = partial(around, pose, shifts=np.zeros((1, 3)))
    turns = None
    if len(margins.free) == 6:
        turns = rays_to_boundaries(margins, turned, np.pi, count, scan, end="half turn")
    at_centre = margins.at(pose[None])[0]
    notes = _notes_on_rays(margins, at_centre)
    sphere = cube = None
    may_fit = fits and at_centre.min() >= 0.0 and axes == ("x", "y", "z")
    if may_fit and margins.is_quick:
        sphere, cube = inscribed(margins, moved, here.centre, positions)
    elif may_fit:
        message = (
            "the largest sphere and cube are not looked for: these legs' joints "
            "follow from a pose by iterations, which take too long for it"
        )
        notes.append(Note("no-fits", message, {}))
    return replace(
        _with_singular_poses(here, margins, moved, positions, scan),
        positions=positions,
        turns=turns,
        columns=columns,
        sphere=sphere,
        cube=cube,
        margin=float(at_centre.min()),
        notes=(*elastic.notes, *notes),
        distribution=margins.distribution(pose),
    )


def _margins(
    elastic: ElasticMechanism,
    pose: Array,
    load: CarriedLoad | None,
    tensions: Distribution,
    through: bool,
) -> PoseMargins | Note:
    """Margins of the limits, on the side of singular poses where the centre is.

    A note on what is singular everywhere in their place.
    """
    if not elastic.mechanism.coordinates_are_pose:
        if load is not None or tensions != "any":
            raise InputError(
                "is for limits of forces, which legs made of joints do not have",
                where="wrench or tensions",
                expected="neither",
            )
        return LegMargins(elastic, pose, through)
    margins = Margins(elastic, load, tensions=tensions)
    if load is not None and margins.forces is None:
        raise InputError(
            "nothing limits forces, so that a load does not change the workspace",
            where="wrench",
            expected="limits of the legs' forces (legs.force in the file), or cables",
        )
    if (everywhere := singular_note(margins, pose)) is not None:
        return everywhere
    if not margins.names:
        raise InputError(
            "no limits: every pose is within them",
            expected="limits, base_joints, diameter or force in legs",
        )
    has_six = len(margins.platform.points) == 6 and not margins.springs.unilateral
    if has_six and not through:
        margins.sign = float(np.sign(margins.determinants(pose[None])[0]))
    return margins


def _rays_within(
    margins: PoseMargins,
    moved: Moved,
    most: float,
    is_open: bool,
    count: int,
    scan: int,
    progress: Progress | None,
) -> Rays:
    """Rays of positions to their boundaries, as far as `most`.

    Where the reach is open, it is chosen by a few rays first: the longest lengths reach
    beyond most workspaces.
    """
    reach = most
    first = rays_to_boundaries(margins, moved, reach, max(8, count // 8), scan)
    if first.distance.size and is_open:
        reach = min(reach, 1.3 * float(first.distance.max()))
    positions = rays_to_boundaries(margins, moved, reach, count, scan, progress)
    while reach < most and positions.is_cut_short and is_open:
        reach = min(2.0 * reach, most)
        positions = rays_to_boundaries(margins, moved, reach, count, scan, progress)
    return positions


def _with_singular_poses(
    here: Workspace, margins: PoseMargins, moved: Moved, positions: Rays, scan: int
) -> Workspace:
    """The workspace with the least ratio of singular values, and singular poses."""
    near = least_ratio(margins, moved, positions)
    near = near and (near[0], here.centre + here.scales * near[1])
    singular = singular_around(margins, here.pose, moved, positions, scan)
    if singular is not None:
        surface = singular.surface * here.scales + here.centre
        singular = replace(singular, surface=surface)
    return replace(here, singularity=near, singular=singular)


def _notes_on_rays(margins: PoseMargins, at_centre: Array) -> list[Note]:
    """Notes on working modes that are not known, and on a centre beyond a limit."""
    notes = []
    if isinstance(margins, LegMargins) and not margins.keeps_modes:
        message = (
            "joints of legs follow from a pose by iterations alone, which may end in "
            "another working mode: single poses may be taken as inside, or outside, "
            "that are not"
        )
        notes.append(Note("working-mode-unchecked", message, {}))
    if at_centre.min() < 0.0:
        worst = margins.names[int(at_centre.argmin())]
        message = f"the pose that the rays start from is itself beyond a limit: {worst}"
        notes.append(Note("centre-outside", message, {"limit": worst}))
    return notes


def _axes_of_rays(
    margins: PoseMargins, pose: Array, most: float
) -> tuple[tuple[str, ...], Array, Moved]:
    """The coordinates that vary, factors from offsets to them, and the poses of offsets.

    These are the first three independent coordinates of the pose. Angles vary up to a
    quarter of a turn where lengths vary up to `most`.
    """
    axes = list(margins.free[:3])
    if len(axes) < 3:
        taken = ", ".join(COORDINATES[i] for i in axes)
        raise InputError(
            "a workspace needs a body with three freedoms", got=taken or "none"
        )
    scales = np.where(np.array(axes) < 3, 1.0, 0.5 * np.pi / most)
    if axes == [0, 1, 2]:
        return ("x", "y", "z"), scales, partial(around, pose, np.zeros((1, 3)))
    home = _coordinates(pose[None])[0]

    def moved(offsets: Array) -> Array:
        at = np.tile(home, (len(offsets), 1))
        at[:, axes] += offsets * scales
        return np.asarray(se3.from_roll_pitch_yaw(at[:, :3], at[:, 3:]))

    return tuple(COORDINATES[i] for i in axes), scales, moved
