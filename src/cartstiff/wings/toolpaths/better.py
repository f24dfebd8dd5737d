r"""A posture at which a load moves the tip less while the tip stays where it is.

*Candidates* are postures with the same pose of the tip: those along the self-motion of a
redundant arm, other branches of the inverse kinematics, and, where the load allows it,
those with the tool turned about its z axis. First come those near the posture, with every
joint that turns within `NEARBY` of it; then, for a larger gain, other configurations.

*Offered* is the candidate of least displacement, if the two equilibria confirm the gain,
and if nothing else becomes worse by more than the factor `WORST`. What becomes worse is
returned with it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from cartstiff.answer.analysis.ellipsoids import softest
from cartstiff.answer.analysis.posture import Reading, sections
from cartstiff.core import numerics
from cartstiff.core.arrays import Array, checked_vector
from cartstiff.core.checked_call import checked
from cartstiff.core.errors import CartstiffError, InputError, UndefinedError
from cartstiff.core.geometry import se3
from cartstiff.core.mechanisms.elastic import ElasticMechanism, checked_elastic
from cartstiff.core.mechanisms.limits import Limits
from cartstiff.core.statics.equilibrium import equilibrium
from cartstiff.core.stiffness.applied_load import Axes, Behaviour, LoadKind
from cartstiff.core.stiffness.compute import analyse
from cartstiff.kinematics.inverse import inverse_kinematics
from cartstiff.kinematics.joint_poses import Free, JointPoses
from cartstiff.recorded.arguments import shapes_of
from cartstiff.recorded.own_outputs import OwnOutputs
from cartstiff.recorded.recording import Recording, analyse_many
from cartstiff.wings.toolpaths.optimise import NEARBY

#: Least share of the displacement that a posture must save to be offered; and in another
#: configuration, to which the arm must be led on purpose.
USEFUL_GAIN, USEFUL_GAIN_ELSEWHERE = 0.1, 0.2
#: Factor by which no measure may become worse, and that from which one is named.
WORST, NAMED = 2.0, 1.05
# Share by which a motion of all joints by `NEARBY` must reduce the displacement to be
# worth it.
_FAR = 0.25
# Random starts of the inverse kinematics; turns of a platform's tool that are tried.
_STARTS = 16
_TURNS = np.linspace(-NEARBY, NEARBY, 37)
# Share of its range from which a joint, or a leg, is near its limit.
_NEAR_LIMIT = 0.05


class Change(NamedTuple):
    """A measure of a posture that becomes worse.

    Attributes
    ----------
    measure : {"stiffness", "condition", "rotation", "margin"}
        Least stiffness against a force (the body free to turn), condition number at the
        characteristic length, rotation of the body under the load, distance to the
        nearest limit.
    here, there : float
        At the posture and at the better one.
    of : str
        The limit that a margin belongs to; else empty.
    is_angle : bool
        Whether that margin is an angle.
    """

    measure: Literal["stiffness", "condition", "rotation", "margin"]
    here: float
    there: float
    of: str = ""
    is_angle: bool = False


@dataclass(frozen=True, eq=False)
class BetterPosture:
    """A better posture at the same place of the tip.

    Attributes
    ----------
    start, q : ndarray (n,)
        Coordinates of the posture, and of this one.
    displacement : tuple of float
        Of the point under the load, from equilibrium to equilibrium: at the posture, at
        this one.
    turn : float
        Angle by which the tool is turned about its z axis.
    is_near : bool
        Whether every joint that turns stays within `NEARBY`.
    moves_most : int or None
        The joint that moves most from the posture, relative to 1 rad or the
        characteristic length; None for a platform.
    worse : tuple of Change
        What becomes worse, by the factor `NAMED` at least.
    reason : str
        Why the search followed difference quotients; empty where the derivatives are
        exact, or none are needed.
    """

    start: Array
    q: Array
    displacement: tuple[float, float]
    turn: float
    is_near: bool
    moves_most: int | None
    worse: tuple[Change, ...]
    reason: str = ""

    @property
    def gain(self) -> float:
        """Share of the displacement that it saves."""
        return 1.0 - self.displacement[1] / self.displacement[0]


@dataclass(frozen=True, eq=False)
class Measures:
    """Measures (N,) of postures under the load; NaN where the body does not resist it."""

    displacement: Array
    rotation: Array
    compliance: Array
    condition: Array


@dataclass(frozen=True, eq=False)
class LoadedPostures:
    """The mechanism at its posture, the load in the room, and the point that it moves."""

    elastic: ElasticMechanism
    pose: Array
    length: float
    wrench: Array
    kind: LoadKind
    point: Array

    @classmethod
    def of(
        cls,
        elastic: ElasticMechanism,
        q: Array,
        wrench: Array,
        kind: LoadKind,
        point: ArrayLike = (0.0, 0.0, 0.0),
    ) -> LoadedPostures:
        """A wrench (6,) along the axes of the room, and a point in M."""
        posture = elastic.mechanism.at(q)
        here = checked_vector(point, 3, "point")
        placed = replace(elastic, q=q)
        return cls(placed, posture.pose, posture.length, wrench, kind, here)

    def measures(self, Q: Array) -> Measures:
        """Measures of postures (N, n), by the tangent compliance C: the twist is C W."""
        arrays = analyse_many(
            self.elastic,
            Q,
            wrench=self.wrench,
            load_kind=self.kind.kind,
            load_at=self.kind.at,
            load_axes="world",
            outputs=("wrench", "compliance_load"),
        ).arrays
        C, wrench = arrays["compliance_load"], arrays["wrench"]
        known = np.asarray(np.isfinite(C).all(axis=(1, 2)))
        C = np.where(known[:, None, None], 0.5 * (C + C.swapaxes(1, 2)), 0.0)
        scaled = np.repeat([self.length, 1.0], 3)
        values = np.linalg.eigvalsh(C * scaled * scaled[:, None])
        # A load that is not resisted moves the body on and on.
        known &= values[:, 0] >= -numerics.ROUNDOFF * values[:, -1]
        twists = np.where(known[:, None], np.einsum("nij,nj->ni", C, wrench), np.nan)
        moved = twists[:, 3:] + np.cross(twists[:, :3], self.point)
        with numerics.silent():
            condition = numerics.condition(values)
        return Measures(
            np.linalg.norm(moved, axis=1),
            np.linalg.norm(twists[:, :3], axis=1),
            np.where(known, np.linalg.eigvalsh(C[:, 3:, 3:])[:, -1], np.nan),
            np.where(np.isfinite(condition), condition, np.inf),
        )

    @cached_property
    def here(self) -> Measures:
        """Measures of the posture."""
        return self.measures(self.elastic.q[None])

    def __call__(self, Q: Array) -> Array:
        """The cost (N,): displacements, larger for postures that are far away.

        NaN where another measure is worse than here by more than `WORST`.
        """
        there, here, (factor, _) = self.measures(Q), self.here, self._distance(Q)
        cost = there.displacement * factor
        is_kept = (there.compliance <= WORST * here.compliance) & (
            there.condition <= WORST * here.condition
        )
        return np.where(is_kept, cost, np.nan)

    def slopes(self, Q: Array) -> Array:
        """Derivatives (N, n) of the cost by the coordinates; NaN where none is recorded.

        Those of the displacement are exact.
        """
        if not self.recorded.has_slopes:
            return np.full_like(Q, np.nan)
        found, (factor, rates) = (
            self.recorded.slopes("moved", Q, self.wrench),
            self._distance(Q),
        )
        return found["by_q"] * factor[:, None] + found["moved"] * rates

    def _distance(self, Q: Array) -> tuple[Array, Array]:
        """Factor (N,) of the cost by the distance from the posture, and its rates."""
        sizes = NEARBY * np.array(
            self.elastic.mechanism.at(self.elastic.q).coordinate_lengths
        )
        far = (next_to(self.elastic, Q) - self.elastic.q) / sizes
        return 1.0 + _FAR * (far * far).mean(axis=1), 2.0 * _FAR * far / (
            sizes * len(sizes)
        )

    @cached_property
    def recorded(self) -> Recording:
        """The displacement "moved" as recorded arithmetic, if there is some."""

        def moved(at: Mapping[str, Array]) -> Any:
            C = at["compliance_load"]
            twist = 0.5 * (C + C.T) @ at["wrench"]
            step = twist[3:] + se3.skew_of(twist[:3]) @ self.point
            return np.sqrt(step @ step)

        own = OwnOutputs.of({"moved": moved}, shapes_of(self.elastic))
        return Recording(self.elastic, (), own, True, self.kind, "world")

    @property
    def why_quotients(self) -> str:
        """Why derivatives are difference quotients; empty where they are exact."""
        if self.recorded.has_slopes:
            return ""
        return self.recorded.reason or "some coordinates follow the load"

    def settled(self, q: Array) -> float | None:
        """Displacement by the load from equilibrium to equilibrium.

        None where it is not stable.
        """
        load = self.kind.acting(self.wrench, self.elastic.mechanism.at(q).pose, "world")
        try:
            state = equilibrium(self.elastic, q, load)
        except CartstiffError:
            return None
        before, after = (
            se3.placed(T, self.point)
            for T in (self.elastic.mechanism.at(q).pose, state.pose)
        )
        return None if state.stable is False else numerics.norm(after - before)

    def read(self, q: Array) -> dict[str, float | None]:
        """The condition number and the least stiffness against a force,
        as `analyse` says them.
        """
        result = analyse(
            self.elastic,
            q,
            wrench=self.wrench,
            load_kind=self.kind.kind,
            load_at=self.kind.at,
            load_axes="world",
        )
        read, _ = sections(result, Reading())
        free = read["ellipsoids"]["compliance"]["translation"]["free"]
        found = None if free is None else softest(free["eigenvalues"], free["axes"])
        return {
            "stiffness": None if found is None else found[0],
            "condition": (read["indices"] or {}).get("condition_number"),
        }


def next_to(elastic: ElasticMechanism, Q: Array) -> Array:
    """The same postures (N, n), turned whole turns next to the mechanism's
    within the limits.
    """
    coordinates = elastic.mechanism.coordinates
    turning = np.array([c.type == "revolute" for c in coordinates])
    turns = np.round((elastic.q - Q) / (2.0 * np.pi))
    near = Q + np.where(turning, 2.0 * np.pi * turns, 0.0)
    low, high = np.array([(c.lower, c.upper) for c in coordinates]).T
    return np.where((near >= low) & (near <= high), near, Q)


@checked
def better_posture(
    elastic: ElasticMechanism,
    q: ArrayLike | None = None,
    *,
    wrench: ArrayLike,
    load_kind: Behaviour = "dead",
    load_at: ArrayLike = (0.0, 0.0, 0.0),
    load_axes: Axes = "body",
    point: ArrayLike = (0.0, 0.0, 0.0),
) -> BetterPosture | None:
    """A posture near this one at which the load moves the tip less,
    with the tip where it is.

    Collisions and the floor are not checked.

    Parameters
    ----------
    elastic : ElasticMechanism
        An arm or a platform with free rest positions, which carry the load at every
        posture.
    q : array_like (n,), optional
        The posture; default the mechanism's.
    wrench, load_kind, load_at, load_axes
        The load at the posture, as in `cartstiff.analyse`; it is then fixed in the room.
    point : array_like (3,)
        The point of the body, in M, whose displacement counts.

    Returns
    -------
    BetterPosture or None
        None where no candidate saves enough.

    Raises
    ------
    UndefinedError
        Code ``"better-not-sought"``: the body does not resist the load or is not moved by
        it, rest positions are given, or the mechanism is closed by loops.
    """
    placed, posture = checked_elastic(elastic).placed(q)
    mechanism, start = placed.mechanism, posture.q
    given = checked_vector(wrench, 6, "wrench")
    if load_axes == "body":
        given = np.ravel(given.reshape(2, 3) @ posture.pose[:3, :3].T)
    at = tuple(checked_vector(load_at, 3, "point of the load").tolist())
    kind = LoadKind(load_kind, at)
    question = LoadedPostures.of(placed, start, given, kind, point)
    with np.errstate(all="ignore"):
        alone = analyse(placed, start).wrench
        is_held = alone is None or bool(np.any(alone))
        if is_held:
            raise _not_sought("the wrench that holds the posture would change as well")
        if mechanism.closures:
            raise _not_sought("its loops have one posture for each pose")
        before = question.settled(start)
        if before is None or not question.here.displacement[0] > 0.0:
            raise _not_sought("the load is not resisted, or does not move the tip")
        return _searched(question, before, load_axes)


def _searched(
    question: LoadedPostures, before: float, load_axes: Axes
) -> BetterPosture | None:
    """The best of the candidates, those nearby first; None if none saves enough."""
    best, least = None, before
    for Q, is_near in _candidates(question, load_axes):
        if best is not None and not is_near:
            break
        wanted = USEFUL_GAIN if is_near else USEFUL_GAIN_ELSEWHERE
        if (found := _best(question, Q, (1.0 - wanted) * least)) is not None:
            best, least = (*found, is_near), found[1]
    return None if best is None else _described(question, before, *best)


def _not_sought(reason: str) -> UndefinedError:
    return UndefinedError(
        f"a better posture is not sought: {reason}", code="better-not-sought"
    )


def _candidates(
    question: LoadedPostures, load_axes: Axes
) -> Iterator[tuple[Array, bool]]:
    """Postures (k, n) at the tip's pose, and whether they are near.

    In the order of preference.
    """
    elastic, at = question.elastic, question.kind.at
    in_body = question.pose[:3, :3].T @ question.wrench[3:]
    # A load along axes of the body turns with the tool, unless it lies on the axis.
    is_kept = load_axes == "world" or np.allclose(in_body[:2], 0.0)
    may_turn = is_kept and not any(at[:2]) and not question.wrench[:3].any()
    if elastic.mechanism.coordinates_are_pose:
        if may_turn:
            turns = se3.exp(np.outer(_TURNS, np.eye(6)[2]))
            turned = inverse_kinematics(elastic, list(question.pose @ turns))
            yield np.vstack(turned), True
        return

    def found(solver: JointPoses, free: Free) -> Array:
        branches = inverse_kinematics(
            elastic,
            question.pose,
            _STARTS,
            free=free,
            cost=question,
            solver=solver,
        )
        return next_to(elastic, np.asarray(branches))

    kept, near = _ranges(elastic)
    try:
        wide = JointPoses(elastic).narrowed(kept)
        around = wide.narrowed(near)
    except InputError:  # the posture is beyond its limits
        return
    yield found(around, "none"), True
    if may_turn:
        yield found(around, "z"), True
    yield found(wide, "none"), False


def _best(question: LoadedPostures, Q: Array, least: float) -> tuple[Array, float] | None:
    """The candidate of least cost that the equilibrium confirms to be below `least`."""
    if not len(Q):
        return None
    cost, here = question(Q), question.here.displacement[0]
    # Mirrored postures differ by rounding; the first of them is taken.
    for i in np.argsort(np.round(cost / here, 6), kind="stable")[:3]:
        if not cost[i] < here:
            break
        settled = question.settled(Q[i])
        if settled is not None and settled < least:
            return Q[i], settled
    return None


def _described(
    question: LoadedPostures,
    before: float,
    q: Array,
    settled: float,
    is_near: bool,
) -> BetterPosture:
    """The posture with what changes from the one before.

    The displacements by the equilibria.
    """
    elastic, start = question.elastic, question.elastic.q
    old, new = question.read(start), question.read(q)
    old["rotation"], new["rotation"] = (
        float(m.rotation[0]) for m in (question.here, question.measures(q[None]))
    )
    worse = []
    for measure, was in old.items():
        is_ = new[measure]
        if was and is_ and (was / is_ if measure == "stiffness" else is_ / was) > NAMED:
            worse.append(Change(measure, was, is_))  # type: ignore[arg-type]
    relative = se3.inverse(question.pose) @ elastic.mechanism.at(q).pose
    sizes = elastic.mechanism.at(start).coordinate_lengths
    moved = np.abs(q - start) / sizes
    is_chain = not elastic.mechanism.coordinates_are_pose
    return BetterPosture(
        start,
        q,
        (before, settled),
        float(se3.log(relative)[2]),
        is_near,
        int(np.argmax(moved)) if is_chain else None,
        (*worse, *_margins(elastic, q)),
        question.why_quotients if is_chain else "",
    )


def _margins(elastic: ElasticMechanism, q: Array) -> list[Change]:
    """The quantity nearest to its limit at a posture, if it is near it and nearer
    than before.
    """
    mechanism = elastic.mechanism
    limits = Limits(mechanism)
    bounded = np.isfinite(limits.upper - limits.lower)
    if not bounded.any():
        return []

    def distances(q: Array) -> Array:
        values = limits.values(q, mechanism.at(q).pose)
        return np.minimum(values - limits.lower, limits.upper - values)

    here, there = distances(elastic.q), distances(q)
    shares = np.where(bounded, there / (limits.upper - limits.lower), np.inf)
    i = int(np.argmin(shares))
    if not (shares[i] < 2.0 * _NEAR_LIMIT and there[i] < here[i]):
        return []
    return [
        Change(
            "margin",
            float(here[i]),
            float(there[i]),
            limits.names[i],
            bool(limits.are_angles[i]),
        )
    ]


_Ranges = dict[str, tuple[float, float]]


def _ranges(elastic: ElasticMechanism) -> tuple[_Ranges, _Ranges]:
    """Ranges of joints away from their limits, and of angles near the posture."""
    kept, near = _Ranges(), _Ranges()
    for c, x in zip(elastic.mechanism.coordinates, elastic.q.tolist(), strict=True):
        margin = _NEAR_LIMIT * (c.upper - c.lower)
        low, high = c.lower, c.upper
        if np.isfinite(margin):
            low, high = min(x, low + margin), max(x, high - margin)
        kept[c.name] = low, high
        if not c.is_length:
            near[c.name] = max(low, x - NEARBY), min(high, x + NEARBY)
    return kept, near
