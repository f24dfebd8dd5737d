r"""Postures of joints at wanted poses, many poses and many starts at once.

The error of a pose T against a wanted one T_d is taken in the body frame,

    e = (log(R^T R_d), R^T (p_d - p) / l),        l the characteristic length

and a free rotation about an axis a of the body leaves only the turn that brings a to its
wanted direction. The gradient of |e|^2 / 2 is exactly -J^T e, so that Levenberg's steps

    dq = J^T (J J^T + mu |e|^2 I)^-1 e

go down until they stop, and converge quadratically where e = 0 can be reached; where
there are more joints than conditions they are the least ones.

A chain of joints with constant axes is a product of exponentials of the joints' screws at
q = 0,

    T_F_M(q) = exp(S_1 q_1) ... exp(S_n q_n) T_F_M(0),    S_i = Ad(T_F_M(0)) J_i(0)

in the coordinates' order, because a joint comes after those it is carried by, and one
that does not carry the body has S = 0 [MLS]_. With the matrix A of a screw that turns (or
else slides) by 1 the exponential is ``1 + A sin q + A^2 (1 - cos q) + (A + A^3) (q - sin
q)`` (or ``1 + A q``), as A then satisfies ``A^4 = -A^2`` (or ``A^2 = 0``). Mechanisms of
any other kind are computed posture by posture. A platform has the pose as coordinate.
"""

from __future__ import annotations

from collections.abc import Mapping
from copy import copy
from typing import Literal, NamedTuple

import numpy as np

from cartstiff.core import numerics
from cartstiff.core.arrays import Array
from cartstiff.core.errors import InputError, check_name
from cartstiff.core.geometry import se3
from cartstiff.core.mechanisms.contract import Mechanism
from cartstiff.core.mechanisms.elastic import ElasticMechanism
from cartstiff.core.mechanisms.limits import Limits


class ManyPoses(NamedTuple):
    """Kinematics of N postures: pose (N, 4, 4), body Jacobian (N, 6, n),
    closures (N, m) and rates.

    Without closures m = 0.
    """

    pose: Array
    jacobian: Array
    residual: Array
    closure: Array


class Kinematics:
    """Kinematics of one mechanism, prepared for many postures.

    Parameters
    ----------
    mechanism : Mechanism
        Any kind whose coordinates are those of joints.

    Attributes
    ----------
    n : int
        Number of coordinates.
    is_product : bool
        Whether the formula above holds; else postures are evaluated one by one.
    """

    def __init__(self, mechanism: Mechanism) -> None:
        self.mechanism = mechanism
        self.n = len(mechanism.coordinates)
        self.is_product = mechanism.is_open_tree
        if self.is_product:
            at_zero = mechanism.at(np.zeros(self.n))
            self._at_zero = at_zero.pose
            self._screws = (se3.adjoint(at_zero.pose) @ at_zero.motion.jacobian).T
            powers = [_powers(se3.hat(screw)).reshape(4, 16).T for screw in self._screws]
            self._powers = np.array(powers).reshape(self.n, 16, 4)

    def at(self, q: Array) -> ManyPoses:
        """Kinematics at coordinates (N, n)."""
        return self._product(q) if self.is_product else self._one_by_one(q)

    def _one_by_one(self, q: Array) -> ManyPoses:
        postures = [self.mechanism.at(row) for row in q]
        pose = np.array([p.pose for p in postures]).reshape(-1, 4, 4)
        jacobian = np.array([p.motion.jacobian for p in postures]).reshape(
            len(q), 6, self.n
        )
        closures = self.mechanism.closures
        if not postures or not closures:
            return ManyPoses(
                pose,
                jacobian,
                np.empty((len(q), 0)),
                np.empty((len(q), 0, jacobian.shape[2])),
            )
        # The rows of rigid joints come last; these joints move as commanded.
        m = sum(c.rows.stop - c.rows.start for c in closures)
        residual = np.array([p.residual[:m] for p in postures if p.residual is not None])
        closure = np.array(
            [p.closure.jacobian[:m] for p in postures if p.closure is not None]
        )
        return ManyPoses(pose, jacobian, residual, closure)

    def _product(self, q: Array) -> ManyPoses:
        # Postures are the last axis, so that each step is one array operation.
        (count, n), q = q.shape, np.ascontiguousarray(q.T)
        shares = np.stack(
            [np.ones_like(q), np.sin(q), 1.0 - np.cos(q), q - np.sin(q)], axis=1
        )
        carriers = np.empty((n + 1, 4, 4, count))  # of each joint, and of the body
        carriers[0] = np.eye(4)[..., None]
        # Not by @, whose rounding depends on the number of postures.
        motions = np.einsum("jab,jbn->jan", self._powers, shares).reshape(n, 4, 4, count)
        for j, motion in enumerate(motions):
            np.einsum("ikn,kjn->ijn", carriers[j], motion, out=carriers[j + 1])
        T = np.tensordot(self._at_zero.T, carriers[n], (1, 1)).transpose(2, 1, 0)
        R, p = carriers[:n, :3, :3], T[:, :3, 3].T - carriers[:n, :3, 3]
        omega, v = (
            np.einsum("jikn,jk->ijn", R, screw) for screw in np.split(self._screws, 2, 1)
        )
        v = v + np.cross(omega, p.swapaxes(0, 1), axis=0)  # at M's origin
        jacobian = np.empty((count, 6, n))
        np.einsum("nki,kjn->nij", T[:, :3, :3], omega, out=jacobian[:, :3])
        np.einsum("nki,kjn->nij", T[:, :3, :3], v, out=jacobian[:, 3:])
        return ManyPoses(T, jacobian, np.empty((count, 0)), np.empty((count, 0, n)))


def _powers(A: Array) -> Array:
    """Coefficients (4, 4, 4) of 1, sin q, 1 - cos q and q - sin q in ``exp(A q)``."""
    if not A[:3, :3].any():  # sin q + (q - sin q) = q
        return np.array([np.eye(4), A, np.zeros((4, 4)), A])
    return np.array([np.eye(4), A, A @ A, A + A @ A @ A])


#: Free part of the body's rotation: none, the turn about one of its axes, or all of it.
Free = Literal["none", "x", "y", "z", "rotation"]


class PlatformPoses:
    """A solver for a platform, with the methods of `JointPoses`.

    Parameters
    ----------
    elastic : ElasticMechanism
        A platform; its coordinates are x, y, z, roll, pitch, yaw.
    limits : bool
        Whether the legs' limits hold.
    """

    def __init__(self, elastic: ElasticMechanism, limits: bool = True) -> None:
        if not elastic.mechanism.coordinates_are_pose:
            raise InputError("not a platform", got=elastic.mechanism.kind)
        self.platform = elastic.mechanism
        self.kinematics = Kinematics(self.platform)
        self.length = self.platform.at(elastic.q).length
        self.sizes = np.array([self.length] * 3 + [1.0] * 3)
        self.start = np.array(elastic.q, float)
        self.lower, self.upper = np.full(6, -np.inf), np.full(6, np.inf)
        self.movable = np.ones(
            len(self.platform.points), bool
        )  # columns of its Jacobian: legs
        self.periodic = np.array([False] * 3 + [True] * 3)
        self.limits = Limits(self.platform, ignore=not limits)

    def region(self) -> tuple[Array, Array]:
        """No bounds."""
        return self.lower, self.upper

    def random_starts(self, count: int, rng: np.random.Generator) -> Array:  # noqa: ARG002
        """None: a pose has one posture, for any start."""
        return np.empty((0, 6))

    def within(self, q: Array) -> Array:
        """Coordinates as they are."""
        return q

    def solve(
        self,
        T_wanted: Array,
        starts: Array,
        free: Free = "none",
        tolerance: float = 0.0,  # noqa: ARG002
        held: Array | None = None,  # noqa: ARG002
    ) -> tuple[Array, Array]:
        """Coordinates (N, 6) at poses (N, 4, 4), and which of them the legs'
        limits allow.

        A free turn is the one nearest to the start's.
        """
        poses = np.array(T_wanted)
        if free != "none":
            axis = "xyz".index(free)
            R = (
                poses[:, :3, :3].swapaxes(1, 2)
                @ self.kinematics.at(starts).pose[:, :3, :3]
            )
            j, k = (axis + 1) % 3, (axis + 2) % 3
            angles = np.arctan2(R[:, k, j] - R[:, j, k], R[:, j, j] + R[:, k, k])
            poses = poses @ se3.exp(angles[:, None] * se3.basis_twist(axis))
        q = self.platform.coordinates_of(poses)
        return q, ~self.limits.exceeded(self.limits.values(q, poses))

    def beyond_limits(self, poses: Array, free: Free) -> tuple[str, float] | None:
        """The leg that is beyond its limits most, at the pose where that is least."""
        q, _ = self.solve(poses, np.tile(self.start, (len(poses), 1)), free)
        beyond = self.limits.excess(self.limits.values(q, self.kinematics.at(q).pose))
        worst = beyond[int(beyond.max(axis=1).argmin())]
        return self.limits.names[int(worst.argmax())], float(worst.max())

    def self_motions(self, q: Array, free: Free, dimension: int) -> Array:
        """Changes of the coordinates (N, 6, d) with the free turn, to first order."""
        motions = np.zeros((len(q), 6, dimension))
        if dimension:
            step = numerics.WIDE_DIFFERENCE_STEP * se3.basis_twist("xyz".index(free))
            for i, row in enumerate(q):
                change = self.platform.displaced(row, step) - row
                motions[i, :, 0] = change - 2 * np.pi * np.round(change / (2 * np.pi))
        return motions / numerics.WIDE_DIFFERENCE_STEP

    def rank(self, free: Free) -> int:
        """Number of conditions that the legs fulfil independently."""
        return 6 - self.redundancy(free)

    def redundancy(self, free: Free) -> int:
        """Dimension of the motions that are left free."""
        if free == "rotation":
            raise InputError(
                "a platform's rotation cannot all be free", expected="x, y or z"
            )
        return 0 if free == "none" else 1


_ITERATIONS = 40
#: Largest motion of a joint in one step (rad, or characteristic lengths).
LONGEST_STEP = 0.7
# A start ends at a minimum that is no solution: after so many steps in a row that reduced
# |e|^2 by less than this share.
_SLOW_STEPS, _SLOW = 6, 0.03
#: Postures nearer than this in every coordinate (rad, or characteristic lengths) are one.
SAME = numerics.NEGLIGIBLE_DISTANCE


def pose_errors(T: Array, T_wanted: Array, free: Free, length: float) -> Array:
    """Errors e (N, 6) of poses (N, 4, 4): the remaining motion, in body components.

    Rotation in rad, translation in units of `length`; zero in the components that are
    free.
    """
    Rt = T[:, :3, :3].swapaxes(1, 2)
    relative = Rt @ T_wanted[:, :3, :3]
    e = np.zeros((len(T), 6))
    e[:, 3:] = (Rt @ (T_wanted[:, :3, 3] - T[:, :3, 3])[..., None])[..., 0] / length
    if free == "none":
        e[:, :3] = se3.log(se3.pose(relative))[:, :3]
    elif free != "rotation":
        axis = np.eye(3)["xyz".index(free)]
        wanted = relative @ axis
        across = np.cross(axis, wanted)
        sine, cosine = np.linalg.norm(across, axis=1), wanted @ axis
        # Opposite directions: any axis across is possible; it is always the same one.
        opposite = (sine < numerics.NEGLIGIBLE_DIFFERENCE) & (cosine < 0)
        across[opposite] = np.roll(axis, 1)
        angle = np.arctan2(sine, cosine)
        e[:, :3] = (
            across
            * np.where(opposite, angle, angle / np.maximum(sine, numerics.TINY))[:, None]
        )
    return e


class JointPoses:
    """A solver for one mechanism made of joints, kept for many calls.

    Parameters
    ----------
    elastic : ElasticMechanism
        Serial chain, or a chain with closures (slower, posture by posture). Virtual
        joints of compliant links stay where its default posture has them.
    limits : bool
        Whether joint limits hold.

    Attributes
    ----------
    length : float
        Characteristic length at the default posture.
    sizes : ndarray (n,)
        Natural sizes of the coordinates: 1, or `length` for distances.
    periodic : ndarray of bool (n,)
        Coordinates whose whole turns lead to the same pose within their limits.
    """

    #: Rows of one block: their arrays stay within the cache of a processor.
    rows_at_once = 1000

    def __init__(self, elastic: ElasticMechanism, limits: bool = True) -> None:
        mechanism = elastic.mechanism
        if mechanism.coordinates_are_pose:
            raise InputError(
                "inverse kinematics is for mechanisms made of joints", got=mechanism.kind
            )
        self.kinematics = Kinematics(mechanism)
        posture = mechanism.at(elastic.q)
        self.length, self.sizes = posture.length, np.array(posture.coordinate_lengths)
        self.start = np.array(elastic.q, float)
        n = len(mechanism.coordinates)
        self.lower, self.upper = np.full(n, -np.inf), np.full(n, np.inf)
        if limits:
            self.lower = np.array([c.lower for c in mechanism.coordinates])
            self.upper = np.array([c.upper for c in mechanism.coordinates])
        self.movable = np.ones(n, bool)
        self.movable[sorted(set(mechanism.held) - set(mechanism.actuated or ()))] = False
        self.periodic = self._periodic()

    def _periodic(self) -> Array:
        mechanism = self.kinematics.mechanism
        turns = np.array([c.type == "revolute" for c in mechanism.coordinates])
        if (mimic := mechanism.mimic) is not None:
            # A mimic joint need not return with its leader.
            turns &= np.abs(mimic).sum(axis=0) == 1.0
        periodic: Array = turns & (
            self.upper - self.lower >= 2 * np.pi - numerics.NEGLIGIBLE_DIFFERENCE
        )
        return periodic

    def narrowed(
        self, ranges: Mapping[str, tuple[float, float]], what: str = "range"
    ) -> JointPoses:
        """The same, with some coordinates kept within ranges of their own (low, high).

        Raises
        ------
        UnknownNameError
            For a name that is no coordinate.
        InputError
            If nothing of a range lies within the limits.
        """
        other = copy(self)
        other.lower, other.upper = self.lower.copy(), self.upper.copy()
        names = self.kinematics.mechanism.names
        for name, (low, high) in ranges.items():
            check_name("joint", name, names)
            j = names.index(name)
            lower, upper = max(low, self.lower[j]), min(high, self.upper[j])
            if not lower <= upper:
                raise InputError(
                    f"nothing of the {what} of {name} lies within its limits",
                    expected=f"{self.lower[j]:.6g} to {self.upper[j]:.6g}",
                    got=f"{low:.6g} to {high:.6g}",
                )
            other.lower[j], other.upper[j] = lower, upper
        other.periodic = other._periodic()
        return other

    def unwound(self) -> JointPoses:
        """The same, but without limits of joints that can turn a whole turn.

        `within` of this one returns postures to the limits.
        """
        other = copy(self)
        other.lower = np.where(self.periodic, -np.inf, self.lower)
        other.upper = np.where(self.periodic, np.inf, self.upper)
        return other

    def region(self) -> tuple[Array, Array]:
        """Region of the search: the limits; one turn, or about as far, without them."""
        low = np.where(np.isfinite(self.lower), self.lower, -np.pi * self.sizes)
        high = np.where(np.isfinite(self.upper), self.upper, np.pi * self.sizes)
        low, high = np.minimum(low, high), np.maximum(low, high)
        low[self.periodic], high[self.periodic] = -np.pi, np.pi
        return low, high

    def random_starts(self, count: int, rng: np.random.Generator) -> Array:
        """Postures (count, n) evenly spread over `region`."""
        low, high = self.region()
        starts = rng.uniform(low, high, (count, len(low)))
        starts[:, ~self.movable] = self.start[~self.movable]
        return self.within(starts)

    def within(self, q: Array) -> Array:
        """Coordinates within the limits: shifted by whole turns where possible,
        else clipped.
        """
        q = np.array(q, float)
        for j in np.flatnonzero(self.periodic):
            # (-pi, pi], as far as the limits allow, so that equal postures have equal
            # numbers.
            turned = (
                np.pi
                - np.mod(np.pi - q[:, j] + numerics.NEGLIGIBLE_DIFFERENCE, 2 * np.pi)
                + numerics.NEGLIGIBLE_DIFFERENCE
            )
            low, high = self.lower[j], self.upper[j]
            turned = np.where(turned > high, turned - 2 * np.pi, turned)
            q[:, j] = np.where(turned < low, turned + 2 * np.pi, turned)
        return np.clip(q, self.lower, self.upper)

    def task(
        self, q: Array, T_wanted: Array, free: Free
    ) -> tuple[Array, Array, ManyPoses]:
        """Errors e (N, r) and their rates (N, r, n) per natural size of the
        coordinates.
        """
        many = self.kinematics.at(q)
        e = np.concatenate(
            [pose_errors(many.pose, T_wanted, free, self.length), -many.residual], 1
        )
        J = np.concatenate([self._free_rows(many.jacobian, free), many.closure], axis=1)
        return e, J * (self.sizes * self.movable), many

    def _errors(self, q: Array, T_wanted: Array, free: Free) -> tuple[Array, Array]:
        """The first two of `task`."""
        return self.task(q, T_wanted, free)[:2]

    def _free_rows(self, jacobian: Array, free: Free) -> Array:
        J = jacobian * np.repeat([1.0, 1.0 / self.length], 3)[:, None]
        if free == "rotation":
            J[:, :3] = 0.0
        elif free != "none":
            J[:, "xyz".index(free)] = 0.0
        return J

    def solve(
        self,
        T_wanted: Array,
        starts: Array,
        free: Free = "none",
        tolerance: float = numerics.CONSTRAINT_TOLERANCE,
        held: Array | None = None,
    ) -> tuple[Array, Array]:
        """Postures (N, n) from starts (N, n) for poses (N, 4, 4),
        and which of them are solutions.

        `held` (n,): coordinates that keep their start values.
        """
        q = np.array(starts, float)
        good = np.zeros(len(q), bool)
        for first in range(0, len(q), self.rows_at_once):
            part = slice(first, first + self.rows_at_once)
            q[part], good[part] = self._solve(
                T_wanted[part], q[part], free, tolerance, held
            )
        return q, good

    def _solve(
        self, T_wanted: Array, q: Array, free: Free, tolerance: float, held: Array | None
    ) -> tuple[Array, Array]:
        result, good = q.copy(), np.zeros(len(q), bool)
        rows = np.arange(len(q))
        mu, count, slow = (
            np.full(len(q), 0.1),
            np.zeros(len(q), int),
            np.zeros(len(q), int),
        )
        e, J = self._errors(q, T_wanted, free)
        for _ in range(_ITERATIONS):
            if not rows.size:
                break
            step = self._step(
                q, e, J if held is None else J * np.where(held, 0.0, 1.0), mu
            )
            trial = np.clip(q + step, self.lower, self.upper)
            e_new, J_new = self._errors(trial, T_wanted, free)
            before, after = (e * e).sum(axis=1), (e_new * e_new).sum(axis=1)
            better = after < before
            worse = np.flatnonzero(~better)
            for new, old in ((trial, q), (e_new, e), (J_new, J)):
                new[worse] = old[worse]
            q, e, J = trial, e_new, J_new
            # Far away a tenth of the damping is enough; near the end |e|^2 makes it
            # small.
            mu = np.where(better, np.maximum(0.3 * mu, numerics.LEAST_DAMPING), 8.0 * mu)
            size = np.abs(e).max(axis=1, initial=0.0)
            # One more step within the tolerance brings the solution to rounding.
            count += size <= tolerance
            done = (count >= 2) | ((size <= tolerance) & ~better)
            slow = np.where(after > (1.0 - _SLOW) * before, slow + 1, 0)
            result[rows], good[rows] = q, size <= tolerance
            keep = ~done & (slow < _SLOW_STEPS)
            if keep.all():
                continue
            rows, q, e, J, mu = rows[keep], q[keep], e[keep], J[keep], mu[keep]
            count, slow, T_wanted = count[keep], slow[keep], T_wanted[keep]
        return result, good

    def _step(self, q: Array, e: Array, J: Array, mu: Array) -> Array:
        """Damped least steps; joints at a limit do not move beyond it."""
        damping = mu * (e * e).sum(axis=1)
        step = _damped(J, e, damping) * self.sizes
        for _ in range(2):
            beyond = ((q <= self.lower) & (step < 0)) | ((q >= self.upper) & (step > 0))
            again = beyond.any(axis=1)
            if not again.any():
                break
            J = np.where(beyond[:, None, :], 0.0, J)
            step[again] = _damped(J[again], e[again], damping[again]) * self.sizes
        largest = np.abs(step / self.sizes).max(axis=1, initial=0.0)
        return (
            step
            * np.minimum(1.0, LONGEST_STEP / np.maximum(largest, numerics.TINY))[:, None]
        )

    def along_self_motions(
        self, q: Array, J: Array, slope: Array, inverse: Array | None = None
    ) -> Array:
        """Slopes (N, n) of a function along the self-motions; J as of `task`.

        With inverse Hessians (N, n, n) steps uphill, without motions beyond joint limits.
        """
        moving = np.broadcast_to(self.movable, q.shape)
        for _ in range(3):
            P = _projections(J, moving)
            along = np.einsum("nij,nj->ni", P, slope)
            if inverse is None:
                break
            along = np.einsum("nij,njk,nk->ni", P, inverse, along)
            beyond = ((q <= self.lower) & (along > 0)) | ((q >= self.upper) & (along < 0))
            if not (beyond & moving).any():
                break
            moving = moving & ~beyond
        return along

    def self_motions(self, q: Array, free: Free, dimension: int) -> Array:
        """Motions (N, n, d) that leave the task fulfilled to first order.

        Orthonormal in the coordinates' natural sizes: the right singular vectors of the
        smallest singular values.
        """
        many = self.kinematics.at(q)
        J = self._free_rows(many.jacobian, free) * self.sizes
        J = np.concatenate([J, many.closure * self.sizes], axis=1)
        J = J[:, :, self.movable]
        motions = np.zeros((len(q), q.shape[1], dimension))
        if dimension:
            motions[:, self.movable] = np.linalg.svd(J)[2][:, -dimension:].swapaxes(1, 2)
        return motions * self.sizes[:, None]

    def beyond_limits(self, poses: Array, free: Free) -> tuple[str, float] | None:
        """Joint with the largest excess over its limits, in the posture where
        that is least.

        Postures are sought at poses (N, 4, 4), each of which is acceptable; None without
        any.
        """
        other = copy(self)
        other.lower, other.upper = self.lower - np.inf, self.upper + np.inf
        starts = other.random_starts(max(200, len(poses)), np.random.default_rng(0))
        rows = np.arange(len(starts)) % len(poses)
        q, good = other.solve(poses[rows], starts, free)
        if not good.any():
            return None
        turns = [c.type == "revolute" for c in self.kinematics.mechanism.coordinates]
        middle = np.where(
            np.isfinite(self.upper - self.lower), (self.lower + self.upper) / 2, 0.0
        )
        q = q[good] - middle
        q = np.where(turns, q - 2 * np.pi * np.round(q / (2 * np.pi)), q) + middle
        beyond = np.maximum(np.maximum(self.lower - q, q - self.upper), 0.0)
        least = int(np.argmin(beyond.max(axis=1)))
        joint = int(np.argmax(beyond[least]))
        return self.kinematics.mechanism.names[joint], float(beyond[least, joint])

    def rank(self, free: Free) -> int:
        """Number of conditions that the joints can fulfil independently,
        at most postures.
        """
        q = self.random_starts(20, np.random.default_rng(0))
        J = self.task(q, np.broadcast_to(np.eye(4), (20, 4, 4)), free)[1]
        values = np.linalg.svd(J, compute_uv=False)
        return int((values > numerics.USUAL_RANK_RATIO * values[:, :1]).sum(axis=1).max())

    def redundancy(self, free: Free) -> int:
        """Dimension of the self-motions at most postures."""
        return int(self.movable.sum()) - self.rank(free)


def _damped(J: Array, e: Array, damping: Array) -> Array:
    """``J^T (J J^T + damping I)^-1 e``.

    A little damping excludes directions without motion.
    """
    step: Array = (
        J.swapaxes(1, 2) @ np.linalg.solve(_squared(J, damping), e[..., None])
    )[..., 0]
    return step


def _squared(J: Array, damping: Array | float = 0.0) -> Array:
    """``J J^T + damping I``, and what keeps it regular."""
    M: Array = J @ J.swapaxes(1, 2)
    diagonal = np.einsum("nii->ni", M)
    trace = diagonal.sum(axis=1)
    diagonal += (damping + numerics.ROUNDOFF_OF_SUMS * trace + numerics.TINY)[:, None]
    return M


def _projections(J: Array, moving: Array) -> Array:
    """Projections (N, n, n) on the motions of the moving coordinates (N, n) without
    effect in J.
    """
    J = J * moving[:, None, :]
    P: Array = np.eye(J.shape[2]) * moving[:, None, :]
    P -= J.swapaxes(1, 2) @ np.linalg.solve(_squared(J), J)
    return P


def distinct(q: Array, periodic: Array, sizes: Array, tolerance: float = SAME) -> Array:
    """Indices of postures (k, n) that differ, in a fixed order.

    Whole turns make no difference.
    """
    if len(q) < 2:
        return np.arange(len(q))
    scaled = q / sizes
    order = np.lexsort(np.round(scaled / (10 * tolerance)).T[::-1])
    difference = scaled[order, None, :] - scaled[None, order, :]
    turns = np.where(periodic, np.round(difference / (2 * np.pi)), 0.0)
    near = np.abs(difference - 2 * np.pi * turns).max(axis=2) < tolerance
    first = ~np.any(np.tril(near, -1), axis=1)
    kept: Array = order[first]
    return kept
