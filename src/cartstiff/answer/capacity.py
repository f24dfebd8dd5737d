"""How much of a load a mechanism holds until the first limit, and which forces at all.

Drives are held to their forces (`cartstiff.answer.held_forces`), cables to their least
tension, joints and legs to their travel, the body to an allowed displacement, and
everything to stability. To first order forces, motions and stiffness are linear in the
load at the posture; by the equilibrium the mechanism moves along its load curve
(`cartstiff.core.statics.continuation`), on which the first limit is sought.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from cartstiff.answer.held_forces import HeldForces, drive_rows, held_forces
from cartstiff.core import numerics
from cartstiff.core.arrays import Array, Result, checked_length, plain
from cartstiff.core.checked_call import checked
from cartstiff.core.errors import CartstiffError, InputError, UndefinedError
from cartstiff.core.figures import draw_bars, new_figure
from cartstiff.core.geometry import se3
from cartstiff.core.lazily import cached_property
from cartstiff.core.mechanisms.contract import MechanismPosture
from cartstiff.core.mechanisms.elastic import ElasticMechanism
from cartstiff.core.mechanisms.limits import Limits, limits_of
from cartstiff.core.potentials.loads import Scaled
from cartstiff.core.results import LabelledResult
from cartstiff.core.statics.continuation import CurvePoint, LoadPath, where_it_falls
from cartstiff.core.statics.held import displacement_between
from cartstiff.core.statics.problem import System, refuse_springs_far_apart
from cartstiff.core.stiffness.applied_load import DEAD_AT_ORIGIN, Axes, Behaviour
from cartstiff.core.stiffness.balance import with_rest_balancing
from cartstiff.core.stiffness.compute import PostureStiffness, analyse, analyse_at
from cartstiff.core.stiffness.forces import (
    drive_limits,
    forces_of,
    rigid_torques,
    used_shares,
)
from cartstiff.core.stiffness.settled_links import settled

if TYPE_CHECKING:
    from cartstiff.core.statics.rest import Equilibrium

Kind = Literal["force", "slack", "travel", "buckling", "displacement"]
#: Multiple of the first estimate and of the load up to which a limit is looked for.
_MOST = 100.0


class FirstLimit(NamedTuple):
    """The first limit on the way of a growing load.

    Attributes
    ----------
    factor : float
        Multiple of the load at it; infinite if none is met. By the equilibrium none is
        looked for beyond 100 times the load and 100 times the factor to first order.
    kind : {"force", "slack", "travel", "buckling", "displacement"} or None
        Force of a drive, slack cable, end of a joint or leg, loss of stability, allowed
        displacement.
    names : tuple of str
        Drives, joints or legs that are at it.
    """

    factor: float = np.inf
    kind: Kind | None = None
    names: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False, repr=False)
class Capacity(Result, LabelledResult):
    """What a mechanism holds at a posture, from `capacity`.

    Attributes
    ----------
    linear : FirstLimit
        Of the load, to first order at the posture.
    by_equilibrium : FirstLimit or None
        The same by the equilibrium, to which the mechanism moves; None if not sought.
    payload : float or None
        Greatest mass [kg] at M's origin that the drives hold under gravity, to first
        order; None without gravity, infinite without limits.
    """

    command: ClassVar = ""

    elastic: ElasticMechanism
    linear: FirstLimit
    by_equilibrium: FirstLimit | None
    payload: float | None
    _held: HeldForces
    _pose: Array

    @cached_property
    def polytope(self) -> Array | None:
        """Vertices (k, 3) of the forces on M's origin, along the axes of F, that the
        drives can hold beside the weight; None if these have no limits.
        """
        if not self._held.is_limited:
            return None
        return self._held.polytope(self._pose[:3, :3])

    @property
    def factor(self) -> float:
        """Multiple of the load that is held: by the equilibrium, if that was sought."""
        return (self.by_equilibrium or self.linear).factor

    def _lines(self) -> list[str]:
        lines = [f"Capacity of {self.elastic.name}"]
        for what, one in (("linear", self.linear), ("equilibrium", self.by_equilibrium)):
            if one is not None:
                names = ", ".join(one.names)
                lines.append(
                    f"  {what:12}{one.factor:.6g} ({one.kind or 'none'} {names})"
                )
        return [*lines, f"  payload     {self.payload} kg"]

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        own = {n: getattr(self, n) for n in ("linear", "by_equilibrium")}
        each = {n: None if x is None else x._asdict() for n, x in own.items()}
        data: dict[str, Any] = plain(
            each | {"payload": self.payload, "polytope": self.polytope}
        )
        return data

    def plot(self, ax: Any = None) -> Any:
        """Draw the polytope of forces along two axes of F; the factors, if there is none.

        Parameters
        ----------
        ax : matplotlib.axes.Axes, optional
            Whose place the picture takes; default a figure of its own.

        Returns
        -------
        matplotlib.figure.Figure
            Forces in the planes x-z and x-y; or a bar for each factor that is finite.

        Raises
        ------
        MissingDependencyError
            Without matplotlib.
        """
        figure = new_figure(8.0, 4.2, self.elastic.springs_in_doubt, ax=ax)
        corners = self.polytope
        if corners is None:
            found = {
                "to first order": self.linear,
                "by the equilibrium": self.by_equilibrium,
            }
            each = {name: one.factor for name, one in found.items() if one is not None}
            names = [n if x < np.inf else f"{n}: no limit" for n, x in each.items()]
            widths = [x if x < np.inf else 0.0 for x in each.values()]
            axes = figure.subplots()
            draw_bars(axes, names, widths, "multiple of the load that is held")
            axes.set_title(self.elastic.name)
            return figure
        unit = self.elastic.mechanism.units.force
        for axes, plane in zip(figure.subplots(1, 2), ((0, 2), (0, 1)), strict=True):
            outline = _outline(corners[:, plane])
            axes.fill(*outline.T, alpha=0.3)
            axes.plot(*outline[[*range(len(outline)), 0]].T, marker="o")
            axes.plot(0.0, 0.0, "k+")
            axes.set(
                **{
                    f"{at}label": f"force along {'xyz'[i]} of F [{unit}]"
                    for at, i in zip("xy", plane, strict=True)
                }
            )
        figure.suptitle(f"{self.elastic.name}: forces that the drives hold")
        return figure


def _outline(points: Array) -> Array:
    """Corners of the convex hull of points (k, 2), in order; the ends of a line."""
    # SciPy takes long to import.
    from scipy.spatial import ConvexHull, QhullError

    try:
        return np.asarray(points[ConvexHull(points).vertices])
    except (QhullError, ValueError):
        apart = points - points.mean(axis=0)
        along = apart @ np.linalg.svd(apart, full_matrices=False)[2][0]
        return np.asarray(points[[int(along.argmin()), int(along.argmax())]])


@checked
def capacity(
    elastic: ElasticMechanism,
    q: ArrayLike | Mapping[str, float] | None = None,
    *,
    wrench: ArrayLike,
    load_kind: Behaviour = "dead",
    load_at: ArrayLike = DEAD_AT_ORIGIN.at,
    load_axes: Axes = "body",
    displacement: float | None = None,
) -> Capacity:
    """How many times a load is held until the first limit, and which forces at all.

    Parameters
    ----------
    elastic, q, wrench, load_kind, load_at, load_axes
        As in `cartstiff.analyse`.
    displacement : float, optional
        Allowed displacement of M's origin by the load.

    Returns
    -------
    Capacity
        Factors to first order and by the equilibrium, payload, and polytope of forces.

    Raises
    ------
    InputError
        As `cartstiff.analyse`; for a load of zero.
    UndefinedError
        Where no wrench balances the posture.
    """
    result = analyse(
        elastic,
        q,
        wrench=wrench,
        load_kind=load_kind,
        load_at=load_at,
        load_axes=load_axes,
    )
    return capacity_at(result, displacement)


def capacity_at(
    result: PostureStiffness,
    displacement: float | None,
    tolerance: float = numerics.NEGLIGIBLE_DIFFERENCE,
) -> Capacity:
    """`capacity` at an analysed posture under its load.

    The factor by the equilibrium is found to `tolerance`; it is not sought for 1.
    """
    if displacement is not None:
        displacement = checked_length(displacement, "allowed displacement")
    held = held_forces(result)
    if held is None or result.wrench is None:
        raise result.reduction.undefined()
    if not result._load_is_given:
        raise InputError("no load is given", expected="a wrench other than zero")
    growing = _Growing(result, held, displacement)
    linear = min(growing.linear(), key=lambda one: one.factor, default=FirstLimit())
    found = None
    if tolerance < 1.0:
        found = growing.by_equilibrium(linear.factor, tolerance)
    own = result.elastic_as_given
    return Capacity(own, linear, found, payload_at(result, held), held, result.pose)


def payload_at(result: PostureStiffness, held: HeldForces) -> float | None:
    """`Capacity.payload` at an analysed posture."""
    gravity = result.elastic.gravity
    if gravity is None:
        return None
    weight = result.pose[:3, :3].T @ gravity / result.units.newtons
    return held.factor(np.append(np.zeros(3), weight))[0]


def capacity_of_rest(state: Equilibrium, tolerance: float) -> FirstLimit | None:
    """How many times all loads of an equilibrium are held, put on together from the rest
    before them.

    None without loads or a limit of a drive's force; beside a prescribed displacement or
    energies of another kind than loads; and where no stable rest before the load is found
    that touches no limit, or no curve that leads on from it.
    """
    loads, elastic = state.loads, state.elastic
    is_plain = state._system.held is None and all(load.is_external for load in loads)
    before = state.before if loads and is_plain else None
    if before is None or before.stable is False or before.reactions.limits:
        return None
    then, now = (
        {
            one.name: one.force
            for one in forces_of(there._at_rest, there.posture, there.reactions.rigid)
        }
        for there in (state, before)
    )
    low, high = drive_limits(elastic, list(now))
    if not np.isfinite([low, high]).any():
        return None
    # Where the forces between both states lead is a unit of the way.
    x, rate = np.array([[now[name], then[name] - now[name]] for name in now]).T
    unit, _ = _first(x, rate, low, high)
    if not 0.0 < unit < np.inf:
        unit = 1.0
    room = _Room(before.posture, now, low, high, state._system.limits)
    none = limits_of(elastic.mechanism, ignore=True)
    try:
        refuse_springs_far_apart(elastic)
        path = LoadPath(elastic, before.q, loads, (), None, none, unit, 1.0, 1.0, False)
        return room.first_on(path, tolerance)
    except CartstiffError:
        return None


#: Share of a way to a limit that is left, its kind, and what is at it.
_Margin = tuple[float, Kind, tuple[str, ...]]
_NONE: _Margin = 1.0, "force", ()


class _Room(NamedTuple):
    """What limits a growing load, as seen from the posture before it.

    Attributes
    ----------
    posture : MechanismPosture
        Before the load.
    now : mapping of str to float
        Forces of the drives there.
    low, high : ndarray (m,)
        Their limits.
    limits : Limits
        Of joints and legs.
    displacement : float or None
        That is allowed.
    """

    posture: MechanismPosture
    now: Mapping[str, float]
    low: Array
    high: Array
    limits: Limits
    displacement: float | None = None

    def first_on(self, path: LoadPath, precision: float) -> FirstLimit:
        """The first limit on a curve of equilibria, whose unit is an estimate of it."""

        def least(state: CurvePoint) -> _Margin:
            return min(self._margins(path, state), key=lambda one: one[0], default=_NONE)

        most = _MOST * max(path.span, 1.0)
        found = where_it_falls(path, lambda x: least(x)[0], most, precision)
        if found is None:
            return FirstLimit()
        state, is_held = found
        lost: _Margin = 0.0, "buckling", ()
        _, kind, names = least(state) if is_held else lost
        return FirstLimit(float(state.factor), kind, names)

    def _margins(self, path: LoadPath, state: CurvePoint) -> Iterator[_Margin]:
        """Shares of the way to each limit that are left at an equilibrium."""
        point = state.point
        yield from self._of_forces(path, state)
        yield from self._of_travel(point.posture)
        if self.displacement is not None:
            before = path.origin.point.posture.pose
            moved = displacement_between(before, point.posture.pose)[3:]
            far = numerics.norm(moved) / self.displacement
            yield 1.0 - far, "displacement", ()

    def _of_forces(self, path: LoadPath, state: CurvePoint) -> Iterator[_Margin]:
        """Margins of the drives' forces, and of the cables' tensions."""
        posture = state.point.posture
        loads = [Scaled(load, state.factor) for load in path.loads]
        elastic = System(path.system.elastic, loads).at_rest(state.point)
        rigid = rigid_torques(elastic, posture, state.balance.multipliers)
        forces = {one.name: one.force for one in forces_of(elastic, posture, rigid)}
        for name, low, high in zip(self.now, self.low, self.high, strict=True):
            used = float(used_shares(forces[name], low, high))
            if used == used:
                yield 1.0 - used, "force", (name,)
            if low == 0.0 and self.now[name] > 0.0:
                yield forces[name] / self.now[name], "slack", (name,)

    def _of_travel(self, there: MechanismPosture) -> Iterator[_Margin]:
        """Margins of joints and legs, as shares of those without a load."""
        limits = self.limits
        if not len(limits):
            return
        x, now = (limits.values(p.q, p.pose) for p in (self.posture, there))
        for i, name in enumerate(limits.names):
            for end in (limits.lower[i], limits.upper[i]):
                if np.isfinite(end) and end != x[i]:
                    yield float((end - now[i]) / (end - x[i])), "travel", (name,)


class _Growing:
    """A load that grows from zero, at a posture."""

    def __init__(
        self, result: PostureStiffness, held: HeldForces, displacement: float | None
    ) -> None:
        self.result, self.held = result, held
        self.asked, self.posture = result.elastic_as_given, result.posture
        self.W, self.straight = np.asarray(result.wrench), result.posture
        if virtual := sorted(self.asked.mechanism.virtual):
            # Before the load compliant links carry the weight alone.
            start = np.array(result.q)
            start[virtual] = 0.0
            self.straight = self.asked.placed(start)[1]
            self.posture = settled(self.asked, self.straight, ())
            if result.load.kind != "follower":
                turned = self.posture.pose[:3, :3].T @ result.pose[:3, :3]
                self.W = np.ravel(self.W.reshape(2, 3) @ turned.T)
        at = self.asked, self.posture, np.zeros(6)
        self.unloaded = analyse_at(*at, result.load)
        # The drives are the first of `HeldForces.names`.
        each = {one.name: one.force for one in self.unloaded.forces}
        now = {name: each[name] for name in held.names if name in each}
        low, high = drive_limits(self.asked, list(now))
        limits = limits_of(self.asked.mechanism, contacts=True)
        self.room = _Room(self.posture, now, low, high, limits, displacement)

    def linear(self) -> Iterator[FirstLimit]:
        """The first limit of each kind, to first order."""
        try:
            motion = self.unloaded.motion_under(self.W)
        except UndefinedError:
            motion = None
        s, at = self._of_drives(motion)
        if at or s != s:
            names = tuple(self.held.names[i] for i in at)
            kind: Kind = "slack" if all(self._is_slack(i) for i in at) else "force"
            yield FirstLimit(0.0 if s != s else max(s, 0.0), kind, names)
        if motion is None:
            return
        yield from self._travel(motion)
        far = np.linalg.norm((self.posture.motion.jacobian @ motion)[3:])
        allowed = self.room.displacement
        if allowed is not None and far > 0.0:
            yield FirstLimit(float(allowed / far), "displacement")
        yield from self._buckling()

    def _is_slack(self, i: int) -> bool:
        """Whether the least force of a drive is that of a cable without tension."""
        return i < len(self.room.low) and bool(self.room.low[i] == 0.0)

    def _of_drives(self, motion: Array | None) -> tuple[float, list[int]]:
        """Multiple at which drives are at a limit, and these.

        More drives than freedoms share the load by their stiffnesses; others have no
        choice.
        """
        held, elastic = self.held, self.unloaded.elastic
        springs, (r, m) = elastic.springs, held.A.shape
        is_shared = m > r and not elastic.mechanism.rigid
        if motion is None or springs is None or not is_shared:
            return held.factor(held.wrench)
        names, rows = drive_rows(elastic, self.posture)
        stiffness = springs.tangent(self.posture)[~springs.is_passive]
        if len(stiffness) != len(names):
            return held.factor(held.wrench)
        forces = np.array([self.room.now[name] for name in names])
        s, i = _first(forces, stiffness * (rows @ motion), self.room.low, self.room.high)
        return s, [i] * (s < np.inf)

    def _travel(self, motion: Array) -> Iterator[FirstLimit]:
        """The first end that a joint or leg reaches."""
        limits = self.room.limits
        if not len(limits):
            return
        x = limits.values(self.posture.q, self.posture.pose)
        rate = self.posture.map_of_bounded(limits.columns.tolist()).jacobian @ motion
        s, i = _first(x, rate, limits.lower, limits.upper)
        if s < np.inf:
            yield FirstLimit(max(s, 0.0), "travel", (limits.names[i],))

    def _buckling(self) -> Iterator[FirstLimit]:
        """Where ``K_0 + s (K_1 - K_0)`` is singular, from both compliances.

        Not sought where links bend: K changes with their deflection, too.
        """
        if self.asked.mechanism.virtual:
            return
        C_0, C_1 = self.unloaded.compliances["B"], self.result.compliances["load"]
        if C_0 is None or C_1 is None:
            return
        sizes = np.repeat([1.0, self.result.length], 3)
        C_0, C_1 = (C / np.outer(sizes, sizes) for C in (C_0, C_1))
        change = C_0 @ np.linalg.pinv(C_1, rcond=numerics.RANK)
        values = np.linalg.eigvals(change)
        real = values.real[np.abs(values.imag) <= numerics.ZERO_SHARE * np.abs(values)]
        # Outside of the range the product is zero, not one.
        real = real[(np.abs(real) > numerics.RANK) & (real < 1.0 - numerics.ZERO_SHARE)]
        if real.size:
            yield FirstLimit(float(1.0 / (1.0 - real.min())), "buckling")

    def by_equilibrium(self, estimate: float, precision: float) -> FirstLimit:
        """The first limit on the curve of equilibria under the growing load."""
        unit = estimate if 0.0 < estimate < np.inf else 1.0
        try:
            path = self._path(unit)
        except CartstiffError:
            return FirstLimit(0.0, "buckling")
        return self.room.first_on(path, precision)

    def _path(self, unit: float) -> LoadPath:
        """The curve of equilibria under multiples of the load, whose scale is a unit."""
        result, at = self.result, np.array(self.result.load.at)
        W = self.held.wrench
        given = np.concatenate([W[:3] - se3.cross(at, W[3:]), W[3:]])
        load = result.load.acting(given, result.pose)
        refuse_springs_far_apart(self.asked)
        elastic, q = with_rest_balancing(self.asked, self.straight), self.straight.q
        none = limits_of(elastic.mechanism, ignore=True)
        return LoadPath(elastic, q, (load,), (), None, none, unit, 1.0, 1.0, False)


def _first(x: Array, rate: Array, low: Array, high: Array) -> tuple[float, int]:
    """Where the first of ``x + s rate`` (m,) is at a bound, and which it is."""
    least = numerics.NEGLIGIBLE_DIFFERENCE * numerics.largest(rate)
    moves = np.abs(rate) > least
    with numerics.silent():
        room = np.where(rate > 0.0, high - x, low - x)
        factors = np.where(moves, room / rate, np.inf)
    i = int(np.argmin(factors)) if factors.size else 0
    return float(factors.min(initial=np.inf)), i
