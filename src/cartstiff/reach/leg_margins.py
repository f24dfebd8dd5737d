r"""How far poses of a body on legs are from each of its limits, many poses at once.

The joints follow from the pose leg by leg. With the drives held, the passive joints' twists J_i of
the legs meet in the body,

    J_1 dq_1 = J_2 dq_2 = ... = J_m dq_m,

as many equations as passive joints where nothing is redundant: where their determinant vanishes the
body moves though all drives are held. Beyond it the determinant has the other sign.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from cartstiff import numerics
from cartstiff.arrays import checked_length
from cartstiff.errors import InputError
from cartstiff.geometry import se3
from cartstiff.geometry.se3 import Array
from cartstiff.kinematics.at_pose import COORDINATES, at_poses
from cartstiff.kinematics.legs import Leg, legs_of
from cartstiff.mechanisms.chain import Chain
from cartstiff.mechanisms.elastic import ElasticMechanism
from cartstiff.mechanisms.limits import Limits


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
