r"""How far poses of a platform, or of a body on legs, are from each limit, many poses at once.

A margin is zero at the limit and negative beyond it. Cables, or more than six legs, with limits of
their tensions carry a wrench W if ``sum t_i g_i = W`` has a solution within them: W then lies in a
zonotope, whose facets are normal to n with n . g = 0 for five of the lines each
([BouchardGosselin]_),

    n . W <= sum_i max(n . g_i t_i),    t_i between its limits,

and the least of these differences, over \|n\|, is the margin: the wrench (moments over the body's
length) that may be added in any direction.

One distribution of tensions is known in closed form, the nearest to the middle t_m of the limits:

    t = t_m + A^+ (W - A t_m),    A = (g_1, ..., g_m).

It leaves the limits somewhat before the last distribution does.

The joints of legs follow from the body's pose leg by leg. With the drives held, the passive joints'
twists J_i of the legs meet in the body,

    J_1 dq_1 = J_2 dq_2 = ... = J_m dq_m,

as many equations as passive joints where nothing is redundant: where their determinant vanishes the
body moves though all drives are held. Beyond it the determinant has the other sign.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from cartstiff import numerics
from cartstiff.arrays import checked_length
from cartstiff.choices import TENSIONS, Distribution
from cartstiff.errors import InputError
from cartstiff.geometry import se3
from cartstiff.geometry.se3 import Array
from cartstiff.kinematics.at_pose import COORDINATES, at_poses
from cartstiff.kinematics.legs import Leg, legs_of
from cartstiff.many.postures import tensions_of_many
from cartstiff.mechanisms.chain import Chain
from cartstiff.mechanisms.elastic import ElasticMechanism
from cartstiff.mechanisms.limits import Limits
from cartstiff.mechanisms.platform import Platform
from cartstiff.potentials.flexure_struts import FlexureStruts, ideal_joints_only
from cartstiff.potentials.line_springs import LineSprings, lines_of_many
from cartstiff.stiffness.applied_load import DEAD_AT_ORIGIN, LoadKind


class LegMargins:
    """Margins of the limits of a body on legs.

    Parameters
    ----------
    elastic : ElasticMechanism
        A closed chain that falls apart into legs where its body is held.
    pose : ndarray (4, 4)
        Of M: the centre, whose side of singular poses counts.
    through : bool
        Whether poses beyond singular ones count, too.

    Attributes
    ----------
    names : tuple of str
        What is limited, and at which side; what a leg reaches.
    free : list of int
        Coordinates of the pose that the body takes; the others follow.
    length : float
        Characteristic length.
    """

    def __init__(self, elastic: ElasticMechanism, pose: Array, through: bool = False) -> None:
        chain, legs = elastic.mechanism, legs_of(elastic, limits=False)
        if not isinstance(chain, Chain) or legs is None:
            raise InputError(
                "workspaces are found for platforms, and for bodies on legs or cables",
                got=chain.kind,
            )
        self.elastic, self.chain, self.legs = elastic, chain, legs
        self.limits = Limits(chain)
        finite = [np.isfinite(bound) for bound in (self.limits.lower, self.limits.upper)]
        self._lower, self._upper = (np.flatnonzero(which) for which in finite)
        names = [f"{self.limits.names[i]}, least" for i in self._lower]
        names += [f"{self.limits.names[i]}, most" for i in self._upper]
        self.length = float(chain.at(elastic.q).length)
        q, self.free = at_poses(elastic, self.coordinates(pose[None]))
        names += [f"reach of leg{i + 1}" for i in range(len(chain.legs))] + ["reach"]
        self.sign = 0.0
        rates = None if through else self.rates(q)
        if rates is not None:
            self.sign = float(np.sign(numerics.determinants(rates)[0]))
        if self.sign:
            names.append("singularity")
        self.names = tuple(names)

    is_slow = True

    def coordinates(self, poses: Array) -> Array:
        """x, y, z, roll, pitch, yaw (N, 6) of poses (N, 4, 4)."""
        return np.hstack([poses[:, :3, 3], se3.roll_pitch_yaw(poses)])

    def axes(self) -> list[int]:
        """Three coordinates of the pose that are followed: the position, if the body takes it."""
        if len(self.free) < 3:
            taken = ", ".join(COORDINATES[i] for i in self.free)
            raise InputError("a workspace needs a body with three freedoms", got=taken or "none")
        return self.free[:3]

    def at(self, poses: Array) -> Array:
        """Margins (N, k) at poses (N, 4, 4) of M."""
        q, _ = at_poses(self.elastic, self.coordinates(poses))
        known = np.isfinite(q).all(axis=1)
        margins = np.full((len(q), len(self.names)), np.inf)
        values = self.limits.values(q, poses)
        n = len(self._lower) + len(self._upper)
        margins[:, :n] = np.hstack(
            [
                values[:, self._lower] - self.limits.lower[self._lower],
                self.limits.upper[self._upper] - values[:, self._upper],
            ]
        )
        for i, leg in enumerate(self.chain.legs):
            short = [leg.shape.short_of(T[:3, 3]) for T in poses[~known] @ leg.T_M_end]
            margins[~known, n + i] = np.where(np.array(short) > 0.0, -np.array(short), np.inf)
        blamed = (margins[~known, n : n + len(self.chain.legs)] < 0.0).any(axis=1)
        margins[~known, n + len(self.chain.legs)] = np.where(blamed, np.inf, -1.0)
        if self.sign and known.any() and (rates := self.rates(q[known])) is not None:
            margins[known, -1] = self.sign * numerics.determinants(rates)
        return np.where(np.isnan(margins), np.inf, margins)

    def inside(self, poses: Array) -> NDArray[np.bool_]:
        """Which poses (N,) are within all limits."""
        q, _ = at_poses(self.elastic, self.coordinates(poses))
        values = self.limits.values(q, poses)
        with np.errstate(invalid="ignore"):
            inside = np.isfinite(q).all(axis=1)
            inside &= (values >= self.limits.lower).all(axis=1)
            inside &= (values <= self.limits.upper).all(axis=1)
        rows = np.flatnonzero(inside)
        if self.sign and rows.size and (rates := self.rates(q[rows])) is not None:
            inside[rows] = self.sign * numerics.determinants(rates) >= 0.0
        return np.asarray(inside)

    def distribution(self, pose: Array) -> dict[str, Any]:  # noqa: ARG002
        """Nothing: legs made of joints have no limits of forces."""
        return {}

    def reach(self, radius: float | None) -> float:
        """How far the body can be: as all links of a leg in a row, its slides at their ends."""
        if radius is not None:
            return checked_length(radius, "radius")
        chain, lengths = self.chain, []
        bounds = np.array([[c.lower, c.upper] for c in chain.coordinates])
        for leg in self.legs:
            links = [np.linalg.norm(T[:3, 3]) for T in leg.chain.tree.placements()]
            slides = [j for j in leg.columns if chain.is_length[j] and j not in chain.virtual]
            lengths.append(sum(links) + np.abs(bounds[slides].T - self.elastic.q[slides]).sum())
        if not np.isfinite(min(lengths)):
            raise InputError(
                "the slides have no limits, so that the workspace has no bound",
                expected="legs.limits, or a radius",
            )
        return 2.0 * float(min(lengths))

    def determinants(self, poses: Array) -> Array:
        """Of `rates` (N,); NaN where the legs do not reach."""
        q, _ = at_poses(self.elastic, self.coordinates(poses))
        determinants, known = np.full(len(q), np.nan), np.isfinite(q).all(axis=1)
        if known.any() and (rates := self.rates(q[known])) is not None:
            determinants[known] = numerics.determinants(rates)
        return determinants

    def ratios(self, poses: Array) -> Array | None:
        """Smallest over largest singular value of `rates` (N,); None where these do not exist."""
        q, _ = at_poses(self.elastic, self.coordinates(poses))
        ratios = np.full(len(q), np.inf)
        known = np.isfinite(q).all(axis=1)
        rates = self.rates(q[known])
        if rates is None:
            return None
        ratios[known] = numerics.ratios(rates)
        return ratios

    def rates(self, q: Array) -> Array | None:
        """The equations (N, p, p) above, lengths over `length`; None if they are not square."""
        parts = [self._passive(leg, q) for leg in self.legs]
        m = len(parts)
        total = sum(part.shape[2] for part in parts)
        if total != 6 * (m - 1) or any(leg.hangs or leg.free != "none" for leg in self.legs):
            return None
        matrix, at = np.zeros((len(q), total, total)), 0
        for i, part in enumerate(parts):
            own = slice(at, at + part.shape[2])
            at = own.stop
            if i == 0:
                for k in range(m - 1):
                    matrix[:, 6 * k : 6 * k + 6, own] = part
            else:
                matrix[:, 6 * i - 6 : 6 * i, own] = -part
        return matrix

    def _passive(self, leg: Leg, q: Array) -> Array:
        """Twists in M (N, 6, p) of a leg's passive joints, in natural sizes."""
        driven = set(self.chain.actuated or ()) | set(self.chain.virtual)
        kept = [i for i, c in enumerate(leg.columns.tolist()) if c not in driven]
        J = leg.solver.kinematics.at(q[:, leg.columns]).jacobian[:, :, kept]
        sizes = leg.solver.sizes[kept]
        scale = np.repeat([1.0, 1.0 / self.length], 3)[:, None]
        return np.asarray(se3.adjoint(leg.after) @ J * scale * sizes)


#: How a load acts, (moment, force) (6,) about its point, and the axes along which these are the
#: same at all poses.
CarriedLoad = tuple[LoadKind, Array, Literal["body", "world"]]


def limits_forces(elastic: ElasticMechanism) -> bool:
    """Whether a load bears on which poses are within the limits: cables, or legs with `force`."""
    platform, springs = elastic.mechanism, elastic.springs
    if not isinstance(platform, Platform) or not isinstance(springs, LineSprings):
        return False
    limits = platform.leg_limits
    return springs.unilateral or (limits is not None and limits.forces is not None)


def lines_at(platform: Platform, poses: Array) -> tuple[Array, Array]:
    """Lengths (N, m) and line coordinates (N, m, 6) of the legs, moments over the body's length."""
    lines = lines_of_many(poses, platform.anchors, platform.points)
    return lines.lengths, lines.lines / np.repeat([platform.length, 1.0], 3)


def wrench_margins(lines: Array, wrench: Array, least: Array, most: Array) -> Array:
    """Margins (N,) of wrenches (N, 6) that lines (N, m, 6) carry with tensions within limits (m,).

    Where tensions have no upper limit, infinity means that every wrench can be carried (closure).
    """
    m = lines.shape[1]
    margins, spanned = np.full(len(lines), np.inf), np.zeros(len(lines), bool)
    rows = np.arange(6)
    for five in combinations(range(m), 5):
        held = lines[:, five]  # (N, 5, 6)
        n = np.stack(
            [(-1.0) ** j * numerics.determinants(held[:, :, rows != j]) for j in range(6)], axis=-1
        )
        size = np.linalg.norm(n, axis=-1)
        n = n / np.maximum(size, numerics.TINY)[:, None]
        along = np.einsum("nmi,ni->nm", lines, n)
        along[:, five] = 0.0
        along[np.abs(along) < numerics.RANK] = 0.0
        regular = size > numerics.RANK
        spanned |= regular
        asked = (n * wrench).sum(axis=-1)
        for sign in (1.0, -1.0):
            pulled = sign * along
            with np.errstate(invalid="ignore"):
                reach = np.where(
                    pulled > 0.0, pulled * most, np.where(pulled < 0.0, pulled * least, 0.0)
                ).sum(axis=-1)
            margin = reach - sign * asked
            margins = np.where(regular, np.minimum(margins, margin), margins)
    # Without five independent lines nothing is spanned.
    return np.where(spanned, margins, -np.inf)


class Margins:
    """Margins of a platform's limits.

    Parameters
    ----------
    elastic : ElasticMechanism
        A platform, or a body on cables.
    load : CarriedLoad, optional
        What the legs carry where their forces are limited, besides the weights that gravity acts
        on. Their forces are those of `cartstiff.analyse`.
    sign : float
        Of the determinant of six legs' lines; poses of the other sign count as beyond the limit
        "singularity". 0: it does not count.
    tensions : {"any", "closed-form"}
        Whether any tensions within their limits may carry the load, or those nearest to the middle
        of the limits must.

    Attributes
    ----------
    names : tuple of str
        What is limited, and at which side.
    """

    def __init__(
        self,
        elastic: ElasticMechanism,
        load: CarriedLoad | None = None,
        sign: float = 0.0,
        tensions: Distribution = "any",
    ) -> None:
        platform, springs = elastic.mechanism, elastic.springs
        if not isinstance(platform, Platform) or not isinstance(springs, LineSprings):
            raise InputError(
                "workspaces are found for platforms and bodies on cables",
                got=elastic.mechanism.kind,
            )
        self.platform, self.springs, self.sign = platform, springs, sign
        self.limits, self.length = Limits(platform), platform.length
        self.load, self.elastic = load, elastic
        m = len(platform.points)
        self.forces = None if platform.leg_limits is None else platform.leg_limits.forces
        self.is_spread = springs.unilateral or m > 6
        if self.forces is None and springs.unilateral:
            self.forces = np.tile([0.0, np.inf], (m, 1))
        if self.forces is not None:
            ideal_joints_only(springs, "limits of forces")
        if self.forces is not None and self.is_spread:
            # Which tensions, of many that balance, is decided by their limits, not by rest lengths.
            rest = np.full(m, np.nan)
            free = replace(springs, rest_length=rest, unilateral=False, balanced_at=None)
            self.elastic = replace(elastic, springs=free)
        if m < 6 and self.forces is not None:
            raise InputError("the forces in fewer than six legs do not follow from a load", got=m)
        finite = [np.isfinite(bound) for bound in (self.limits.lower, self.limits.upper)]
        self._lower, self._upper = (np.flatnonzero(which) for which in finite)
        zero = self.limits.lower[self._lower] == 0.0
        self._lower = self._lower[~zero]  # lengths and angles are not below zero
        names = [f"{self.limits.names[i]}, least" for i in self._lower]
        names += [f"{self.limits.names[i]}, most" for i in self._upper]
        self.tensions = tensions
        if tensions not in TENSIONS:
            raise InputError(
                "unknown distribution of tensions", expected=" or ".join(TENSIONS), got=tensions
            )
        if tensions != "any" and (
            self.forces is None or not self.is_spread or not np.isfinite(self.forces).all()
        ):
            raise InputError(
                "the middle of the limits exists for cables, or more than six legs, with least and "
                "largest tensions",
                where="tensions",
                expected="legs.force",
                got=tensions,
            )
        if self.forces is not None and self.is_spread and tensions == "any":
            names.append("tensions")
        elif self.forces is not None:
            names += [f"force of leg{i + 1}, least" for i in range(m)]
            names += [f"force of leg{i + 1}, most" for i in range(m)]
        if sign and m == 6:
            names.append("singularity")
        if isinstance(springs, FlexureStruts):
            names.append("flexures")
        self.names = tuple(names)

    def at(self, poses: Array) -> Array:
        """Margins (N, k) at poses (N, 4, 4) of M."""
        values = self.limits.values(np.empty((len(poses), 6)), poses)
        parts = [
            values[:, self._lower] - self.limits.lower[self._lower],
            self.limits.upper[self._upper] - values[:, self._upper],
        ]
        _, lines = lines_at(self.platform, poses)
        if self.forces is not None:
            t = self._tensions(poses)
            least, most = self.forces.T
            if self.is_spread and self.tensions == "any":
                margins = wrench_margins(lines, _sums(lines, t), least, most)
                # On the edge itself nothing more can be carried, as by cables without tension.
                parts.append(np.where(margins > 0.0, margins, np.fmin(margins, -1.0))[:, None])
            else:
                if self.is_spread:
                    t = self.middle_tensions(lines, _sums(lines, t))
                t = np.where(np.isfinite(t), t, np.inf)
                parts += [t - least, most - t]
        if self.sign and lines.shape[1] == 6:
            parts.append(self.sign * numerics.determinants(lines)[:, None])
        if isinstance(self.springs, FlexureStruts):
            parts.append(self._standing(poses, np.concatenate(parts, axis=1), self.springs))
        return np.concatenate(parts, axis=1)

    @staticmethod
    def _standing(poses: Array, others: Array, struts: FlexureStruts) -> Array:
        """1 where all struts are stable, -1 where one has buckled or finds no balance (N, 1).

        Asked only where all `others` are kept; infinity elsewhere.
        """
        standing = np.full((len(poses), 1), np.inf)
        for rows in np.array_split(
            np.flatnonzero((others >= 0.0).all(axis=1)), len(poses) // 500 + 1
        ):
            at = struts.many(poses[rows], np.zeros((len(poses[rows]), 6)))
            stable = (at.is_found & at.is_stable).all(axis=1)
            standing[rows, 0] = np.where(stable, 1.0, -1.0)
        return standing

    def middle_tensions(self, lines: Array, asked: Array) -> Array:
        """The tensions (N, m) nearest to the middle of the limits that carry wrenches (N, 6)."""
        middle = np.mean(self.forces, axis=1)  # type: ignore[arg-type]
        A = lines.swapaxes(1, 2)
        missing = asked - A @ middle
        change = (np.linalg.pinv(A, rcond=numerics.RANK) @ missing[..., None])[..., 0]
        left = np.abs((A @ change[..., None])[..., 0] - missing).max(axis=1)
        size = np.abs(missing).max(axis=1) + np.abs(A @ middle).max(axis=1)
        carried = left <= numerics.BALANCE * size
        return np.where(carried[:, None], middle + change, np.inf)

    def distribution(self, pose: Array) -> dict[str, Any]:
        """Name of the distribution, and the nearest to the middle of the limits at a pose."""
        if self.forces is None or not self.is_spread:
            return {}
        answer: dict[str, Any] = {"distribution": self.tensions, "at_centre": None}
        if np.isfinite(self.forces).all():
            lines = lines_at(self.platform, pose[None])[1]
            t = self.middle_tensions(lines, _sums(lines, self._tensions(pose[None])))
            answer["at_centre"] = t[0].tolist() if np.isfinite(t).all() else None
        return answer

    def determinants(self, poses: Array) -> Array:
        """Of six legs' lines (N,), moments over the body's length."""
        return numerics.determinants(lines_at(self.platform, poses)[1])

    def ratios(self, poses: Array) -> Array | None:
        """Smallest over largest singular value of six legs' lines (N,)."""
        lines = lines_at(self.platform, poses)[1]
        return numerics.ratios(lines) if lines.shape[1] == 6 else None

    @property
    def is_slow(self) -> bool:
        """Whether a pose costs more than a few products."""
        spread = self.forces is not None and self.is_spread
        return spread or isinstance(self.springs, FlexureStruts)

    def inside(self, poses: Array) -> NDArray[np.bool_]:
        """Which poses (N,) are within all limits."""
        return np.asarray((self.at(poses) >= 0.0).all(axis=1))

    def _tensions(self, poses: Array) -> Array:
        """Tensions (N, m) that balance weights and load, as of `cartstiff.analyse`; or NaN."""
        kind, wrench, axes = self.load or (DEAD_AT_ORIGIN, None, "body")
        q = self.platform.coordinates_of(poses)
        return tensions_of_many(self.elastic, q, wrench, kind, axes)


def _sums(lines: Array, tensions: Array) -> Array:
    """The wrenches (N, 6) that lines (N, m, 6) with tensions (N, m) carry."""
    return np.asarray((tensions[:, None] @ lines)[:, 0])
