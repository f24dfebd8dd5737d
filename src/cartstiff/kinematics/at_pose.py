r"""The posture of a machine with a given pose of its body, as for ``--pose``.

Legs that are known in closed form are solved by it, in the working mode of the default
posture. Other closed chains go there by Newton's method from the default posture. A body
with fewer than six freedoms cannot take every pose: as many of its coordinates x, y, z,
roll, pitch, yaw as it has freedoms are taken from the pose, first those that differ from
the default posture's; the others follow, and a note says which.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from itertools import combinations
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cartstiff.core import numerics
from cartstiff.core.arrays import Array, checked_array, checked_pose, checked_vector
from cartstiff.core.checked_call import checked
from cartstiff.core.errors import InputError
from cartstiff.core.geometry import se3
from cartstiff.core.mechanisms.chain import Chain, ChainPosture
from cartstiff.core.mechanisms.elastic import ElasticMechanism, checked_elastic
from cartstiff.core.notes import Note
from cartstiff.core.numerics.searches import least_change
from cartstiff.kinematics.inverse import inverse_kinematics
from cartstiff.kinematics.leg_shapes import PlacedLeg
from cartstiff.kinematics.legs import Leg, legs_of
from cartstiff.kinematics.rods import rod_of

#: Coordinates of a pose: the position, and angles about fixed axes.
COORDINATES = ("x", "y", "z", "roll", "pitch", "yaw")

# Newton steps, the number of them for legs in closed form, and the longest of these (rad,
# or characteristic lengths).
_MAX_STEPS, _MAX_LEG_STEPS, _LONGEST_LEG_STEP = 200, 30, 0.1
# Distance of poses about the default one that test which coordinates are independent
# (rad, or characteristic lengths).
_TEST_DISTANCE = 0.02
# Starts for legs whose steps end in another working mode.
_ATTEMPTS = 6


@checked
def at_pose(
    elastic: ElasticMechanism,
    pose: ArrayLike,
    tool: ArrayLike | None = None,
    of: Literal["body", "M"] = "body",
) -> tuple[Array, tuple[Note, ...]]:
    """Coordinates at which the body has a pose, and a note on pose coordinates
    that differ.

    Parameters
    ----------
    elastic : ElasticMechanism
        A platform, or a body carried by legs; its working mode is that of its default
        posture.
    pose : array_like, shape (6,)
        x, y, z, roll, pitch, yaw (about fixed axes) of the body in F; lengths in the
        mechanism's unit, rad.
    tool : array_like, shape (4, 4), optional
        Pose of M in the body, where M is elsewhere.
    of : {"body", "M"}
        The frame whose pose is given.

    Returns
    -------
    q : ndarray (n,)
        Coordinates.
    notes : tuple of Note
        ``pose-follows`` if the body has fewer than six freedoms and its pose differs from
        the wanted one.

    Raises
    ------
    InputError
        If the pose cannot be reached: which leg is too short, or how far away the body
        stays.
    """
    wanted = checked_vector(pose, 6, "pose")
    T_P_M = np.eye(4) if tool is None or of == "M" else checked_pose(tool, "tool")
    chain = checked_elastic(elastic).mechanism
    # A body's coordinates are its pose.
    if chain.coordinates_are_pose:
        if of == "M":
            wanted = chain.coordinates_of(se3.from_roll_pitch_yaw(wanted[:3], wanted[3:]))
        return wanted, ()
    # The reached pose, from the file's posture; arms have further branches.
    search = _Search(elastic, T_P_M, "pose")
    moved = np.abs(_difference(wanted, search.coordinates(search.start))) / search.sizes
    search.given = np.flatnonzero(moved > numerics.NEGLIGIBLE_DIFFERENCE).tolist()
    q = search.solution(elastic, wanted)
    # Bodies with fewer freedoms keep what they cannot choose, and a note says so.
    reached = search.coordinates(search.chain.at(q))
    off = np.abs(_difference(wanted, reached))
    if len(search.free) == 6 or np.all(
        off <= numerics.NEGLIGIBLE_DIFFERENCE * search.sizes
    ):
        return q, ()
    return q, (_note(elastic, wanted, reached, search.free),)


def at_poses(
    elastic: ElasticMechanism,
    poses: ArrayLike,
    given: Sequence[int] = (),
    legs: list[Leg] | None = None,
) -> tuple[Array, list[int]]:
    """Coordinates (N, n) at poses (N, 6), as `at_pose` finds them one by one.

    Parameters
    ----------
    elastic : ElasticMechanism
        A body carried by legs.
    poses : array_like, shape (N, 6)
        x, y, z, roll, pitch, yaw of the body in F.
    given : sequence of int
        Coordinates of the pose that a body with fewer than six freedoms takes first.
    legs : list of Leg, optional
        Its legs without limits, from `legs_of`, kept for many calls.

    Returns
    -------
    q : ndarray (N, n)
        NaN where the body does not reach the pose.
    free : list of int
        The independent coordinates of the pose, which the body has; the others follow.
    """
    wanted = checked_array(poses, ("N", 6), "poses")
    if checked_elastic(elastic).mechanism.coordinates_are_pose:
        return wanted, list(range(6))
    search = _Search(elastic, np.eye(4), "poses")
    search.given = given
    q = None
    if not search.is_known:
        q = search.by_own_steps(legs or legs_of(elastic, limits=False), wanted)
    return (search.one_by_one(wanted) if q is None else q), search.free


def _difference(a: Array, b: Array) -> Array:
    d = a - b
    d[3:] = (d[3:] + np.pi) % (2.0 * np.pi) - np.pi
    return np.asarray(d)


def _note(
    elastic: ElasticMechanism, wanted: Array, reached: Array, free: list[int]
) -> Note:
    units = [elastic.units.length] * 3 + ["rad"] * 3
    follow = [i for i in range(6) if i not in free]
    sizes = np.repeat([np.abs(reached[:3]).max(), 1.0], 3)
    reached = np.where(np.abs(reached) < numerics.PRINTED_AS_ZERO * sizes, 0.0, reached)
    shown = [
        f"{COORDINATES[i]} = {reached[i]:.6g} {units[i]} ({wanted[i]:.6g} was given)"
        for i in follow
    ]
    taken = ", ".join(COORDINATES[i] for i in free)
    words = (
        f"the body has {len(free)} freedoms: {taken} are those of the pose; the "
        "others follow: "
    )
    values = {
        "free": [COORDINATES[i] for i in free],
        "follow": {COORDINATES[i]: float(reached[i]) for i in follow},
        "given": {COORDINATES[i]: float(wanted[i]) for i in follow},
    }
    return Note("pose-follows", words + ", ".join(shown), values)


def _stepped(leg: Leg, starts: Array, target: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Coordinates of a leg by steps, within its limits where possible,
    and which are reached.
    """
    own, good = leg.solver.solve(target, starts, leg.free)
    # Beyond a limit, as where a strut passes through its base, there may be one within.
    within = leg.solver.narrowed(leg.chain.bounds)
    beyond = np.flatnonzero((own != np.clip(own, within.lower, within.upper)).any(axis=1))
    again, found = within.solve(target[beyond], starts[beyond], leg.free)
    own[beyond[found]] = again[found]
    good[beyond[found]] = True
    return own, good


class _Search:
    """Searches for postures of a chain with closures."""

    def __init__(self, elastic: ElasticMechanism, T_P_M: Array, where: str) -> None:
        chain = elastic.mechanism
        if not isinstance(chain, Chain) or not chain.closures:
            raise InputError(
                f"{'is' if where == 'pose' else 'are'} for platforms and bodies carried "
                "by legs",
                where=where,
                expected="joint positions (q) for an arm",
            )
        self.chain, self.q = chain, np.array(elastic.q, float)
        self.T_P_M = T_P_M
        #: Coordinates of the pose that are independent before others.
        self.given: Sequence[int] = ()
        self.rows = sum(
            c.rows.stop - c.rows.start for c in chain.closures
        )  # not rigid joints'
        self.movable = np.array(
            [j not in chain.virtual for j in range(self.q.size)], float
        )
        self.start = chain.at(self.q)
        self.columns = self.start.coordinate_lengths * self.movable
        #: Natural sizes of x, y, z, roll, pitch, yaw.
        self.sizes = np.repeat([self.start.length, 1.0], 3)
        #: Whether all legs are known in closed form, and compliant links are straight.
        self.is_known = len(chain.legs) == len(chain.closures) + 1
        self.is_known &= not self.q[sorted(chain.virtual)].any()

    def poses(self, x: Array) -> Array:
        """Poses (..., 4, 4) of M from those (..., 6) of the body."""
        return se3.from_roll_pitch_yaw(x[..., :3], x[..., 3:]) @ self.T_P_M

    def one_by_one(self, wanted: Array) -> Array:
        """Coordinates (N, n) at poses (N, 6) in closed form, else by steps;
        NaN beyond reach.
        """
        if self.is_known:
            return self._by_legs(wanted)
        return np.array([self._by_steps(x) for x in wanted]).reshape(-1, len(self.q))

    def solution(self, elastic: ElasticMechanism, wanted: Array) -> Array:
        """Coordinates (n,) at a pose (6,), also on other branches of a body with six
        freedoms.

        Raises
        ------
        InputError
            If none are found: with the leg that is too short, if there is one.
        """
        q, T = self.one_by_one(wanted[None])[0], self.poses(wanted)
        if np.isfinite(q).all():
            return np.asarray(q)
        missed, has_six = self.short(T), len(self.free) == 6
        if has_six and not missed:
            for branch in inverse_kinematics(elastic, T, most=1):
                return np.array(branch)
            missed = f"a place that was not found from {elastic.name}'s posture"
        names = ", ".join(COORDINATES[i] for i in self.free)
        raise InputError(
            "the pose cannot be reached",
            expected="a pose that every leg reaches",
            got=missed or f"{names} that the body does not take together",
        )

    def coordinates(self, posture: ChainPosture) -> Array:
        """x, y, z, roll, pitch, yaw of the body."""
        T = posture.pose @ se3.inverse(self.T_P_M)
        return np.concatenate([T[:3, 3], se3.roll_pitch_yaw(T)])

    def rates(self, posture: ChainPosture) -> Array:
        """Their derivatives (6, n) by the coordinates."""
        T = posture.pose @ se3.inverse(self.T_P_M)
        twists = se3.adjoint(self.T_P_M) @ posture.motion.jacobian
        roll, pitch, _ = se3.roll_pitch_yaw(T)
        sr, cr, sp, cp = np.sin(roll), np.cos(roll), np.sin(pitch), np.cos(pitch)
        E = np.array([[1.0, 0.0, -sp], [0.0, cr, sr * cp], [0.0, -sr, cr * cp]])
        turning = np.linalg.pinv(E, rcond=numerics.RANK) @ twists[:3]
        return np.concatenate([T[:3, :3] @ twists[3:], turning])

    def _closing(self, posture: ChainPosture) -> tuple[Array, Array]:
        residual, closure = posture.residual, posture.closure
        if residual is None or closure is None:
            return np.zeros(0), np.zeros((0, self.q.size))
        return residual[: self.rows], closure.jacobian[: self.rows]

    def _of_legs(self, T: Array) -> Array:
        """Coordinates (N, n) at poses (N, 4, 4) of M in closed form; NaN beyond reach."""
        q, errors = np.tile(self.q, (len(T), 1)), np.zeros(len(T))
        for leg, mode in self._modes:
            with np.errstate(all="ignore"):
                q[:, leg.columns], error = leg.shape.inverse(T @ leg.T_M_end, mode)
            errors = np.maximum(errors, error)  # NaN stays
        q[~(errors <= numerics.CONSTRAINT_TOLERANCE)] = np.nan
        return q

    @cached_property
    def _modes(self) -> list[tuple[PlacedLeg, int]]:
        """Legs with the working modes of the default posture."""
        return [(leg, leg.mode(self.q, self.start.pose)) for leg in self.chain.legs]

    def _by_legs(self, wanted: Array) -> Array:
        """Closed form at poses (N, 6).

        Dependent coordinates by Gauss and Newton's method.
        """
        follow = [i for i in range(6) if i not in self.free]
        at, steps = wanted.copy(), numerics.DIFFERENCE_STEP * self.sizes
        going = np.arange(len(wanted))

        def gaps(x: Array) -> Array:
            T = self.poses(x)
            with np.errstate(all="ignore"):
                return np.concatenate(
                    [leg.shape.gaps(T @ leg.T_M_end, m) for leg, m in self._modes], 1
                )

        # Steps of the dependent coordinates that close the gaps of all legs.
        for _ in range(_MAX_LEG_STEPS if follow else 0):
            x = at[going]
            left, rates = gaps(x), []
            for i in follow:
                ahead, behind = x.copy(), x.copy()
                ahead[:, i] += steps[i]
                behind[:, i] -= steps[i]
                rates.append(
                    (gaps(ahead) - gaps(behind)) / (2.0 * numerics.DIFFERENCE_STEP)
                )
            A = np.stack(rates, axis=2)
            known = np.isfinite(A).all(axis=(1, 2)) & np.isfinite(left).all(axis=1)
            going, x, A, left = going[known], x[known], A[known], left[known]
            if not going.size:
                break
            step = -(np.linalg.pinv(A, numerics.LEAST_CLOSURE_RATE) @ left[:, :, None])[
                :, :, 0
            ]
            long = np.abs(step).max(axis=1, keepdims=True)
            step *= np.minimum(1.0, _LONGEST_LEG_STEP / np.maximum(long, numerics.TINY))
            at[going[:, None], follow] += step * self.sizes[follow]
            going = going[long[:, 0] > numerics.ROUNDOFF]
        return self._of_legs(self.poses(at))

    def by_own_steps(self, legs: list[Leg] | None, wanted: Array) -> Array | None:
        """Each leg at poses (N, 6) by steps from the default posture, all poses at once.

        None without legs, for legs with self-motions, and unless the dependent
        coordinates stay constant while the others move.
        """
        if legs is None or any(
            leg.free != "none" and leg.solver.redundancy(leg.free) for leg in legs
        ):
            return None
        home, follow = (
            self.coordinates(self.start),
            [i for i in range(6) if i not in self.free],
        )
        around = np.vstack([np.eye(6)[self.free], -np.eye(6)[self.free]])
        # Each leg goes to poses around home as well, which test it.
        near = home + around * _TEST_DISTANCE * self.sizes
        at = np.vstack([near, wanted])
        at[:, follow] = home[follow]
        T = self.poses(at)
        q = np.tile(self.q, (len(at), 1))
        for leg in legs:
            rows = np.flatnonzero(np.isfinite(q).all(axis=1))
            starts, target = q[np.ix_(rows, leg.columns)], leg.target(T[rows])
            own, good = self._of_leg(leg, starts, target)
            q[np.ix_(rows, leg.columns)] = own
            q[rows[~good]] = np.nan
        return q[len(near) :] if np.isfinite(q[: len(near)]).all() else None

    def _of_leg(
        self, leg: Leg, starts: Array, target: Array
    ) -> tuple[Array, NDArray[np.bool_]]:
        """Coordinates of a leg at poses of its end, and which are reached in its
        working mode.
        """
        rod = rod_of(leg, self.q[leg.columns], frozenset(self.chain.actuated or ()))
        if rod is None:
            return _stepped(leg, starts, target)
        wanted = rod.coordinate(target)
        own, good = starts.copy(), np.zeros(len(starts), bool)
        left = np.flatnonzero(np.isfinite(wanted))
        rng = np.random.default_rng(3)
        for attempt in range(_ATTEMPTS):
            if not left.size:
                break
            begin = starts[left].copy()
            if (
                attempt and good.any()
            ):  # the passive joints of the nearest pose in this mode
                from scipy.spatial import KDTree

                known, flat = np.flatnonzero(good), target[:, :3].reshape(-1, 12)
                _, nearest = KDTree(flat[known]).query(
                    flat[left], [min(attempt, len(known))]
                )
                begin = own[known[nearest[:, 0]]]
            elif attempt:
                begin += rng.uniform(-1.0, 1.0, begin.shape) * self.movable[leg.columns]
            begin[:, rod.driven] = wanted[left]
            found, reached = _stepped(leg, begin, target[left])
            reached &= rod.keeps(found, wanted[left])
            own[left[reached]], good[left[reached]] = found[reached], True
            left = left[~reached]
        return own, good

    def short(self, T: Array) -> str:
        """The leg that does not reach a pose of M, in words; empty if all do."""
        for i, leg in enumerate(self.chain.legs):
            missing = leg.shape.short_of((T @ leg.T_M_end)[:3, 3])
            if missing > 0.0:
                name = self.chain.names[leg.driven].partition("/")[0] or f"leg {i + 1}"
                return (
                    f"{name}, which is {missing:.3g} {self.chain.units.length} too short"
                )
        return ""

    @cached_property
    def free(self) -> list[int]:
        """Independent coordinates of the pose: the given ones,
        and the most independent others.

        Positions come first where none is given, or more than the body has freedoms.
        """
        _, C = self._closing(self.start)
        C = C * self.columns
        C = C / np.max(np.abs(C), axis=1, keepdims=True, initial=numerics.TINY)
        # Rates of the pose's coordinates along the free motions.
        _, values, Vt = np.linalg.svd(C[:, self.movable > 0.0])
        motions = Vt[numerics.rank(values) :].T
        rates = (self.rates(self.start) * self.columns)[:, self.movable > 0.0] @ motions
        rates = rates / self.sizes[:, None]
        count = numerics.rank(np.linalg.svd(rates, compute_uv=False))
        # The most independent set of them.
        every = [list(c) for c in combinations(range(6), count)]
        scores = [
            float(np.linalg.svd(rates[c], compute_uv=False).min(initial=1.0))
            for c in every
        ]
        least = numerics.NEAR_SINGULARITY * max(scores)
        by_score = 0 < len(self.given) < count

        def rank(found: tuple[list[int], float]) -> tuple[int, float]:
            return len({*found[0]} & {*self.given}), found[1] if by_score else 0.0

        pairs = zip(every, scores, strict=True)
        return max((pair for pair in pairs if pair[1] >= least), key=rank)[0]

    def _by_steps(self, wanted: Array) -> Array:
        """Newton's method from the default posture; NaN if it does not converge."""
        free, sizes = self.free, self.sizes[self.free]

        def equations(posture: ChainPosture) -> tuple[Array, Array]:
            gap, C = self._closing(posture)
            left = _difference(self.coordinates(posture), wanted)[free] / sizes
            rates = self.rates(posture)[free] / sizes[:, None]
            return np.concatenate([gap, left]), np.concatenate([C, rates]) * self.columns

        def retract(posture: ChainPosture, step: Array) -> ChainPosture:
            return self.chain.at(posture.q + self.columns * step)

        posture, size, _ = least_change(
            self.start,
            equations,
            retract,
            evaluations=_MAX_STEPS,
            longest_step=2.0 * _LONGEST_LEG_STEP,
            tolerance=numerics.CONSTRAINT_TOLERANCE,
            rank=numerics.LEAST_CLOSURE_RATE,
        )
        if size <= numerics.CONSTRAINT_TOLERANCE:
            return posture.q
        return np.full_like(self.q, np.nan)
