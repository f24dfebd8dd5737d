r"""How far poses of a platform are from each of its limits, many poses at once.

A margin is zero at the limit and negative beyond it. Cables, or more than six legs, with limits of
their tensions carry a wrench W if ``sum t_i g_i = W`` has a solution within them: W then lies in a
zonotope, whose facets are normal to n with n . g = 0 for five of the lines each
([BouchardGosselin]_),

    n . W <= sum_i max(n . g_i t_i),    t_i between its limits,

and the least of these differences, over \|n\|, is the margin: the wrench (moments over the body's
length) that may be added in any direction.

Of all distributions of tensions one is told in closed form, the nearest to the middle t_m of the
limits:

    t = t_m + A^+ (W - A t_m),    A = (g_1, ..., g_m).

It leaves the limits somewhat before the last distribution does.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from cartstiff import numerics
from cartstiff.choices import TENSIONS, Distribution
from cartstiff.errors import InputError
from cartstiff.geometry.se3 import Array
from cartstiff.many.leg_forces import tensions_of_many
from cartstiff.mechanisms.elastic import ElasticMechanism
from cartstiff.mechanisms.limits import Limits
from cartstiff.mechanisms.platform import Platform
from cartstiff.potentials.flexure_struts import FlexureStruts, ideal_joints_only
from cartstiff.potentials.line_springs import LineSprings, lines_of_many
from cartstiff.stiffness.applied_load import DEAD_AT_ORIGIN, LoadKind

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
        """1 where all struts stand, -1 where one has buckled or finds no balance (N, 1).

        Asked only where all `others` are kept; infinity elsewhere.
        """
        standing = np.full((len(poses), 1), np.inf)
        for rows in np.array_split(
            np.flatnonzero((others >= 0.0).all(axis=1)), len(poses) // 500 + 1
        ):
            at = struts.many(poses[rows], np.zeros((len(poses[rows]), 6)))
            stands = (at.is_found & at.is_stable).all(axis=1)
            standing[rows, 0] = np.where(stands, 1.0, -1.0)
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
