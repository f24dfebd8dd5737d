r"""The posture of a machine with a given pose of its body, as for ``--pose``.

Legs that are known in closed form are solved by it, in the working mode of the default posture.
Other closed chains go there by Newton's method from the default posture. A body with fewer than six
freedoms cannot take every pose: as many of its coordinates x, y, z, roll, pitch, yaw as it has
freedoms are taken from the pose, the others follow, and a note says which.
"""

from __future__ import annotations

from functools import cached_property
from itertools import combinations
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from cartstiff import numerics
from cartstiff.arrays import checked_array, checked_pose, checked_vector
from cartstiff.checked_call import checked
from cartstiff.errors import InputError
from cartstiff.geometry import se3
from cartstiff.geometry.se3 import Array
from cartstiff.kinematics.inverse import inverse_kinematics
from cartstiff.kinematics.legs import Leg, legs_of
from cartstiff.mechanisms.chain import Chain, ChainPosture
from cartstiff.mechanisms.elastic import ElasticMechanism, checked_elastic
from cartstiff.mechanisms.leg_shapes import PlacedLeg
from cartstiff.mechanisms.platform import Platform
from cartstiff.notes import Note

#: Coordinates of a pose: the position, and angles about fixed axes.
COORDINATES = ("x", "y", "z", "roll", "pitch", "yaw")

# Newton steps, the number of them for legs in closed form, and the longest of these (rad, or
# characteristic lengths).
_MAX_STEPS, _MAX_LEG_STEPS, _LONGEST_LEG_STEP = 200, 30, 0.1
# Distance of poses about the default one that test which coordinates are independent (rad, or
# characteristic lengths).
_TEST_DISTANCE = 0.02


@checked
def at_pose(
    elastic: ElasticMechanism,
    pose: ArrayLike,
    tool: ArrayLike | None = None,
    of: Literal["body", "M"] = "body",
) -> tuple[Array, tuple[Note, ...]]:
    """Coordinates at which the body has a pose, and a note on pose coordinates that differ.

    Parameters
    ----------
    elastic : ElasticMechanism
        A platform, or a body carried by legs; its working mode is that of its default posture.
    pose : array_like, shape (6,)
        x, y, z, roll, pitch, yaw (about fixed axes) of the body in F; lengths in the mechanism's
        unit, rad.
    tool : array_like, shape (4, 4), optional
        Pose of M in the body, where M is elsewhere.
    of : {"body", "M"}
        The frame whose pose is given.

    Returns
    -------
    q : ndarray (n,)
        Coordinates.
    notes : tuple of Note
        ``pose-follows`` if the body has fewer than six freedoms and its pose differs from the
        wanted one.

    Raises
    ------
    InputError
        If the pose cannot be reached: which leg is too short, or how far away the body stays.
    """
    wanted = checked_vector(pose, 6, "pose")
    T_P_M = np.eye(4) if tool is None else checked_pose(tool, "tool")
    chain = checked_elastic(elastic).mechanism
    if of == "M":
        at_M = chain.T_P_M if isinstance(chain, Platform) else T_P_M
        T = se3.from_roll_pitch_yaw(wanted[:3], wanted[3:]) @ se3.inverse(at_M)
        wanted = np.concatenate([T[:3, 3], se3.roll_pitch_yaw(T)])
    if isinstance(chain, Platform):
        return wanted, ()
    if not isinstance(chain, Chain) or not chain.closures:
        raise InputError(
            "is for platforms and bodies carried by legs",
            where="pose",
            expected="joint positions (q) for an arm",
        )
    T = se3.from_roll_pitch_yaw(wanted[:3], wanted[3:]) @ T_P_M
    search = _Search(elastic, chain, T_P_M)
    q = search.by_legs(T)
    if q is not None:
        return q, ()
    free = search.freedoms()
    if len(free) == 6:
        q = None if chain.legs else search.by_steps(wanted, free)
        if q is None and not (short := search.short(T)):
            branches = inverse_kinematics(elastic, T, most=1)
            q = np.array(branches[0]) if len(branches) else None
        if q is None:
            raise _refusal(short or f"a place that was not found from {elastic.name}'s posture")
        return q, ()
    q = search.by_steps(wanted, free)
    if q is None:
        names = ", ".join(COORDINATES[i] for i in free)
        raise _refusal(search.short(T) or f"{names} that the body does not take together")
    reached = search.coordinates(chain.at(q))
    if chain.legs and (again := search.by_legs(search.at(q).pose)) is not None:
        q = again
    off = _difference(wanted, reached)
    if np.all(np.abs(off) <= numerics.NEGLIGIBLE_DIFFERENCE * search.sizes):
        return q, ()
    return q, (_note(elastic, wanted, reached, free),)


def at_poses(elastic: ElasticMechanism, poses: ArrayLike) -> tuple[Array, list[int]]:
    """Coordinates (N, n) at poses (N, 6), as `at_pose` finds them one by one.

    Parameters
    ----------
    elastic : ElasticMechanism
        A body carried by legs.
    poses : array_like, shape (N, 6)
        x, y, z, roll, pitch, yaw of the body in F.

    Returns
    -------
    q : ndarray (N, n)
        NaN where the body does not reach the pose.
    free : list of int
        The independent coordinates of the pose, which the body has; the others follow.
    """
    wanted = checked_array(poses, ("N", 6), "poses")
    chain = checked_elastic(elastic).mechanism
    if isinstance(chain, Platform):
        return wanted, list(range(6))
    if not isinstance(chain, Chain) or not chain.closures:
        raise InputError(
            "are for platforms and bodies carried by legs",
            where="poses",
            expected="joint positions (q) for an arm",
        )
    search = _Search(elastic, chain, np.eye(4))
    free = search.freedoms()
    if len(chain.legs) == len(chain.closures) + 1:
        return search.many_by_legs(wanted, free), free
    legs = legs_of(elastic, limits=False)
    if legs is not None and (q := search.many_by_steps(legs, wanted, free)) is not None:
        return q, free
    reached = np.full((len(wanted), len(search.q)), np.nan)
    for i, pose in enumerate(wanted):
        q = search.by_steps(pose, free)
        if q is not None:
            reached[i] = q
    return reached, free


def _refusal(got: str) -> InputError:
    return InputError(
        "the pose cannot be reached", expected="a pose that every leg reaches", got=got
    )


def _difference(a: Array, b: Array) -> Array:
    d = a - b
    d[3:] = (d[3:] + np.pi) % (2.0 * np.pi) - np.pi
    return np.asarray(d)


def _note(elastic: ElasticMechanism, wanted: Array, reached: Array, free: list[int]) -> Note:
    units = [elastic.units.length] * 3 + ["rad"] * 3
    follow = [i for i in range(6) if i not in free]
    sizes = np.repeat([np.abs(reached[:3]).max(), 1.0], 3)
    reached = np.where(np.abs(reached) < numerics.PRINTED_AS_ZERO * sizes, 0.0, reached)
    shown = [
        f"{COORDINATES[i]} = {reached[i]:.6g} {units[i]} ({wanted[i]:.6g} was given)"
        for i in follow
    ]
    taken = ", ".join(COORDINATES[i] for i in free)
    words = f"the body has {len(free)} freedoms: {taken} are those of the pose; the others follow: "
    values = {
        "free": [COORDINATES[i] for i in free],
        "follow": {COORDINATES[i]: float(reached[i]) for i in follow},
        "given": {COORDINATES[i]: float(wanted[i]) for i in follow},
    }
    return Note("pose-follows", words + ", ".join(shown), values)


class _Search:
    """Searches for postures of a chain with closures."""

    def __init__(self, elastic: ElasticMechanism, chain: Chain, T_P_M: Array) -> None:
        self.chain, self.q = chain, np.array(elastic.q, float)
        self.T_P_M = T_P_M
        self.rows = sum(c.rows.stop - c.rows.start for c in chain.closures)  # not rigid joints'
        self.movable = np.array([j not in chain.virtual for j in range(self.q.size)], float)
        start = self.at(self.q)
        self.start = start
        self.columns = start.coordinate_lengths * self.movable
        #: Natural sizes of x, y, z, roll, pitch, yaw.
        self.sizes = np.repeat([start.length, 1.0], 3)

    def at(self, q: Array) -> ChainPosture:
        """Posture at coordinates."""
        return self.chain.at(q)

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

    def by_legs(self, T: Array) -> Array | None:
        """Closed form at a pose of M; None if there is none, or it does not reach the pose."""
        chain = self.chain
        if len(chain.legs) != len(chain.closures) + 1:
            return None
        q = self._of_legs(T[None])[0]
        if not np.isfinite(q).all():
            return None
        posture = self.at(q)
        gap = np.abs(self._closing(posture)[0]).max(initial=0.0)
        away = np.abs(posture.pose - T).max()
        return (
            q
            if max(gap, away) <= numerics.CONSTRAINT_TOLERANCE * max(1.0, posture.length)
            else None
        )

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

    def many_by_legs(self, wanted: Array, free: list[int]) -> Array:
        """Closed form at poses (N, 6); dependent coordinates by Gauss and Newton's method."""
        follow = [i for i in range(6) if i not in free]
        at, steps = wanted.copy(), numerics.DIFFERENCE_STEP * self.sizes
        going = np.arange(len(wanted))

        def poses(x: Array) -> Array:
            return se3.from_roll_pitch_yaw(x[:, :3], x[:, 3:])

        def gaps(x: Array) -> Array:
            T = poses(x)
            with np.errstate(all="ignore"):
                return np.concatenate(
                    [leg.shape.gaps(T @ leg.T_M_end, m) for leg, m in self._modes], 1
                )

        for _ in range(_MAX_LEG_STEPS if follow else 0):
            x = at[going]
            left, rates = gaps(x), []
            for i in follow:
                ahead, behind = x.copy(), x.copy()
                ahead[:, i] += steps[i]
                behind[:, i] -= steps[i]
                rates.append((gaps(ahead) - gaps(behind)) / (2.0 * numerics.DIFFERENCE_STEP))
            A = np.stack(rates, axis=2)
            known = np.isfinite(A).all(axis=(1, 2)) & np.isfinite(left).all(axis=1)
            going, x, A, left = going[known], x[known], A[known], left[known]
            if not going.size:
                break
            step = -(np.linalg.pinv(A, numerics.LEAST_CLOSURE_RATE) @ left[:, :, None])[:, :, 0]
            long = np.abs(step).max(axis=1, keepdims=True)
            step *= np.minimum(1.0, _LONGEST_LEG_STEP / np.maximum(long, numerics.TINY))
            at[going[:, None], follow] += step * self.sizes[follow]
            going = going[long[:, 0] > numerics.ROUNDOFF]
        return self._of_legs(poses(at))

    def many_by_steps(self, legs: list[Leg], wanted: Array, free: list[int]) -> Array | None:
        """Each leg at poses (N, 6) by steps from the default posture, all poses at once.

        None unless the dependent coordinates stay constant while the others move.
        """
        home, follow = self.coordinates(self.start), [i for i in range(6) if i not in free]
        near = home + np.vstack([np.eye(6)[free], -np.eye(6)[free]]) * _TEST_DISTANCE * self.sizes
        if any(leg.free != "none" for leg in legs):
            return None
        at = np.vstack([near, wanted])
        at[:, follow] = home[follow]
        T = se3.from_roll_pitch_yaw(at[:, :3], at[:, 3:])
        q = np.tile(self.q, (len(at), 1))
        for leg in legs:
            own, good = leg.solver.solve(leg.target(T), q[:, leg.columns])
            q[:, leg.columns] = own
            q[~good] = np.nan
        return q[len(near) :] if np.isfinite(q[: len(near)]).all() else None

    def short(self, T: Array) -> str:
        """The leg that does not reach a pose of M, in words; empty if all do."""
        for i, leg in enumerate(self.chain.legs):
            missing = leg.shape.short_of((T @ leg.T_M_end)[:3, 3])
            if missing > 0.0:
                name = self.chain.names[leg.driven].partition("/")[0] or f"leg {i + 1}"
                return f"{name}, which is {missing:.3g} {self.chain.units.length} too short"
        return ""

    def freedoms(self) -> list[int]:
        """Independent coordinates of the pose, positions first."""
        _, C = self._closing(self.start)
        C = C * self.columns
        C = C / np.max(np.abs(C), axis=1, keepdims=True, initial=numerics.TINY)
        _, values, Vt = np.linalg.svd(C[:, self.movable > 0.0])
        motions = Vt[numerics.rank(values) :].T
        rates = (self.rates(self.start) * self.columns)[:, self.movable > 0.0] @ motions
        rates = rates / self.sizes[:, None]
        count = numerics.rank(np.linalg.svd(rates, compute_uv=False))
        every = [list(c) for c in combinations(range(6), count)]
        scores = [float(np.linalg.svd(rates[c], compute_uv=False).min(initial=1.0)) for c in every]
        return next(
            c
            for c, s in zip(every, scores, strict=True)
            if s >= numerics.NEAR_SINGULARITY * max(scores)
        )

    def by_steps(self, wanted: Array, free: list[int]) -> Array | None:
        """Newton's method from the default posture; None if it does not converge."""
        sizes = self.sizes[free]

        def equations(posture: ChainPosture) -> tuple[Array, Array]:
            gap, C = self._closing(posture)
            left = _difference(self.coordinates(posture), wanted)[free] / sizes
            rates = self.rates(posture)[free] / sizes[:, None]
            return np.concatenate([gap, left]), np.concatenate([C, rates]) * self.columns

        def retract(posture: ChainPosture, step: Array) -> ChainPosture:
            return self.at(posture.q + self.columns * step)

        posture, size, _ = numerics.least_change(
            self.start,
            equations,
            retract,
            evaluations=_MAX_STEPS,
            longest_step=2.0 * _LONGEST_LEG_STEP,
            tolerance=numerics.CONSTRAINT_TOLERANCE,
            rank=numerics.LEAST_CLOSURE_RATE,
        )
        return posture.q if size <= numerics.CONSTRAINT_TOLERANCE else None
