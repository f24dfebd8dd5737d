r"""Deflection compensation along a path: commands that put the loaded tool on it.

At a posture q where the end-effector has the pose wanted and compliant links, which
nothing commands, are at rest, the springs must balance everything else,

    dPhi_springs/dq = - (gravity + other potentials + loads) - C^T lam

and their rest positions, which a controller commands, follow from their laws. Without
compensation the posture itself is commanded, and the end-effector deflects by the
reported error; with it the equilibrium is solved again, as a check.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from cartstiff.core import numerics
from cartstiff.core.arrays import Array, checked_array, checked_pose, csv_text, plain_dict
from cartstiff.core.checked_call import checked
from cartstiff.core.errors import (
    CartstiffError,
    ConvergenceError,
    InputError,
    UndefinedError,
    UnknownNameError,
    listed,
)
from cartstiff.core.figures import new_figure
from cartstiff.core.geometry import se3
from cartstiff.core.mechanisms.contract import MechanismPosture
from cartstiff.core.mechanisms.elastic import ElasticMechanism, checked_elastic
from cartstiff.core.mechanisms.gravity_loads import GravityLoads, gravity_loads
from cartstiff.core.mechanisms.limits import finite, limit_notes, limits_of
from cartstiff.core.notes import Note
from cartstiff.core.potentials.contract import Potential
from cartstiff.core.potentials.line_springs import LineSprings
from cartstiff.core.potentials.springs import Springs
from cartstiff.core.results import LabelledResult
from cartstiff.core.statics.equilibrium import equilibrium
from cartstiff.core.statics.held import Held, displacement_between, displacement_heads
from cartstiff.core.statics.problem import System
from cartstiff.core.statics.rest import Equilibrium
from cartstiff.core.stiffness.applied_load import (
    DEAD_AT_ORIGIN,
    Axes,
    Behaviour,
    LoadKind,
    checked_load,
)
from cartstiff.core.stiffness.balance import with_rest_balancing
from cartstiff.core.stiffness.compute import SCHEMA
from cartstiff.core.stiffness.motions import decomposed
from cartstiff.core.stiffness.settled_links import settled


@dataclass(frozen=True, eq=False, repr=False)
class CompensatedPath(LabelledResult):
    """Commands along a path, and the errors without and with them.

    Attributes
    ----------
    poses : ndarray (m, 4, 4)
        ``T_F_M`` wanted.
    q : ndarray (m, n)
        Postures that have these poses under the loads; compliant links are deflected
        there.
    springs : tuple of str
        Names of what is commanded: joints, without those within compliant links, or legs.
    commands : ndarray (m, k)
        Rest positions to command, in the order of `springs`, in units of each.
    naive : ndarray (m, k)
        Rest positions without compensation, of the program before: those that balance the
        weight alone at the posture, or against "all" those at which the springs carry
        nothing.
    weight : ndarray (m, k)
        Change of the command by the weight alone; against "all" it is a part of the
        compensation, against "load" the program before has it already.
    against : {"load", "all"}
        Whether the loads are compensated, or all forces.
    before, after : ndarray (m, 6)
        Error of the loaded end-effector, rotation vector and translation in axes of F,
        with the naive and with the compensated commands; NaN if no equilibrium was found.
    deviation : ndarray (m, 6) or None
        Standard deviation of `after` in its units, by measured springs; None without
        such.
    stable : tuple of bool or None
        Whether the compensated equilibrium is stable.
    weighed : GravityLoads
        Bodies under gravity, and payloads among the loads of the first point.
    load_axes : {"body", "world"} or None
        Axes in which the wrenches were given; None for potentials.
    notes : tuple of Note
        Commands beyond limits, points without an equilibrium or with an unstable one,
        poses that too few joints cannot give to the body on deflected links.
    """

    elastic: ElasticMechanism
    poses: Array
    q: Array
    springs: tuple[str, ...]
    commands: Array
    naive: Array
    weight: Array
    against: str
    before: Array
    after: Array
    deviation: Array | None
    stable: tuple[bool | None, ...]
    weighed: GravityLoads
    load_axes: Axes | None
    notes: tuple[Note, ...]

    @property
    def offsets(self) -> Array:
        """Change of the command by the compensation (m, k), in units of `commands`."""
        return self.commands - self.naive

    def summary(self) -> dict[str, dict[str, float]]:
        """Largest and root-mean-square errors, in rad and length units,
        before and after.
        """
        report = {}
        for name, errors in (("before", self.before), ("after", self.after)):
            known = errors[~np.isnan(errors).any(axis=1)]
            report[name] = {"points": float(len(known))}
            for part, columns in (
                ("rotation", known[:, :3]),
                ("translation", known[:, 3:]),
            ):
                size = np.linalg.norm(columns, axis=1)
                report[name] |= {
                    f"{part}_max": float(size.max(initial=0.0)),
                    f"{part}_rms": numerics.norm(size) / max(len(size), 1) ** 0.5,
                }
        return report

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""

        def rows(errors: Array) -> list[Array | None]:
            return [None if np.isnan(e).any() else e for e in errors]

        data = {
            "schema": SCHEMA,
            "units": self.elastic.units.to_dict(),
            **self.weighed.to_dict(),
            "load_axes": self.load_axes,
            "springs": self.springs,
            "poses": self.poses,
            "q": self.q,
            "against": self.against,
            "commands": self.commands,
            "taught": self.naive,
            "weight": self.weight,
            "error_before": rows(self.before),
            "error_after": rows(self.after),
            "error_after_sd": None if self.deviation is None else rows(self.deviation),
            "stable": self.stable,
            "summary": self.summary(),
            "notes": self.notes,
        }
        return plain_dict(data)

    def to_csv(self) -> str:
        """Commands after and before (taught), errors, postures wanted,
        one line a point.
        """
        elastic, names, columns = self.elastic, list[str](), list[Array]()
        units = dict(zip(elastic.names, elastic.names_with_units, strict=True))
        heads = [
            units.get(name, f"{name} [{elastic.units.length}]") for name in self.springs
        ]
        for word, values in (("command", self.commands), ("taught", self.naive)):
            names, columns = [*names, *(f"{word}_{h}" for h in heads)], [*columns, values]
        for when, values in (("before_", self.before), ("after_", self.after)):
            names += displacement_heads(elastic.units, when)
            columns.append(values)
        names, columns = [*names, *elastic.names_with_units], [*columns, self.q]
        if self.deviation is not None:
            names += displacement_heads(elastic.units, "after_sd_")
            columns.append(self.deviation)
        return csv_text(np.column_stack(columns), names)

    def plot(self, ax: Any = None) -> Any:
        """Draw the loaded end-effector's errors before and after compensation,
        point by point.

        Parameters
        ----------
        ax : matplotlib.axes.Axes, optional
            Whose place the picture takes; default a figure of its own.

        Raises
        ------
        MissingDependencyError
            Without matplotlib.
        """
        figure = new_figure(6.4, 7.2, self.elastic.springs_in_doubt, ax=ax)
        axes = figure.subplots(2, 1, sharex=True)
        points = np.arange(1, len(self.q) + 1)
        units, size = self.elastic.units, self.elastic.mechanism.at(self.q[0]).length
        parts = (
            (slice(3, 6), units.shown_length, "translation", units.shown_per_length),
            (slice(0, 3), units.shown_angle, "rotation", units.shown_per_radian),
        )
        for axis, (part, unit, name, per) in zip(axes, parts, strict=True):
            for errors, label in ((self.before, "before"), (self.after, "after")):
                # A logarithmic axis has no zero: the round-off of poses takes its place.
                least = numerics.ROUNDOFF * (size if name == "translation" else 1.0)
                error = np.maximum(np.linalg.norm(errors[:, part], axis=1), least)
                axis.semilogy(points, per * error, "o-", markersize=3, label=label)
            axis.set_ylabel(f"{name} error [{unit}]")
            axis.legend()
        axes[-1].set_xlabel("point of the path")
        axes[0].set_title(self.elastic.name)
        return figure


AGAINST = ("load", "all")
# Start of the check of a command, beside the answer, as a share of the uncompensated
# deflection.
_START_OFFSET = 0.1


@checked
def compensate(
    elastic: ElasticMechanism,
    path: ArrayLike,
    wrenches: ArrayLike | Sequence[Potential | Sequence[Potential]] | None = None,
    *,
    q: ArrayLike | None = None,
    load_kind: Behaviour = "dead",
    load_at: ArrayLike = DEAD_AT_ORIGIN.at,
    load_axes: Axes = "body",
    against: Literal["load", "all"] | None = None,
) -> CompensatedPath:
    """Commands that put the loaded end-effector on a path.

    Parameters
    ----------
    elastic : ElasticMechanism
        With springs whose rest positions are commanded; their present ones do not matter.
    path : array_like, shape (m, n) or (m, 4, 4)
        Postures (of all coordinates, or of the joints alone without those within
        compliant links), or poses ``T_F_M`` for which postures are found, each near the
        one before.
    wrenches : array_like (m, 6) or (6,), or a sequence of potentials
        (moment, force) of the process on the body at `load_at`, at each point or the same
        at all; or the loads at each point as potentials; None against "all" for no load
        but the weight.
    q : array_like (n,), optional
        Start of the search for the first pose; default the file's posture.
    load_kind, load_at, load_axes
        Behaviour of the wrenches while the body moves, their point, and the axes of their
        components at each posture of the path: as in `cartstiff.analyse`.
    against : {"load", "all"}, optional
        Compensate the deflection by the load, for a program taught under weight and
        payload, which its positions include already; or by all, also by the weight and
        whatever else acts without the load. Default load; all if the file gives every
        spring's rest position, as the deflection from there is then due to the weight
        too.

    Raises
    ------
    InputError
        For wrong shapes, or a mechanism without springs to command.
    ConvergenceError
        If a pose cannot be reached.
    UndefinedError
        Code ``"not-compensable"`` if no command balances the load at a point: joints
        without springs would have to carry a part of it.
    """
    springs = _springs(checked_elastic(elastic))
    if elastic.coupled_springs:
        raise InputError(
            "a path's commands are for the springs of single joints, and springs that "
            "couple joints are not commanded",
            expected="springs of single joints; equilibrium or analyse for this "
            "mechanism",
        )
    against = against or ("all" if springs.is_complete else "load")
    if against not in AGAINST:
        raise UnknownNameError(
            "kind of compensation", against, AGAINST, where="--against"
        )
    postures = _postures(elastic, path, q)
    kind = checked_load(load_kind, load_at, load_axes, wrenches is not None)
    if wrenches is None and against != "all":
        raise InputError("a path needs a load", expected="wrenches, or against 'all'")
    poses = [elastic.mechanism.at(q).pose for q in postures]
    potentials = _given_loads(wrenches, len(poses), kind, load_axes)
    loads = potentials or _loads(wrenches, poses, kind, load_axes)  # type: ignore[arg-type]
    inner, _ = elastic.parted_terms()
    straight = replace(
        elastic, gravity=None, potentials=tuple(t for t in inner if t is not springs)
    )
    notes = list(elastic.notes)
    points = [
        _Point(elastic, straight, number, target, acting, notes).solved(given, against)
        for number, (given, target, acting) in enumerate(
            zip(postures, poses, loads, strict=True), start=1
        )
    ]
    # A program is taught: whatever rest positions the file gives are commanded anew.
    taught_under: Literal["balanced"] | None = "balanced" if against == "load" else None
    mass = replace(gravity_loads(elastic, loads[0]), before=taught_under)
    result = _collected(elastic, np.array(poses), points, mass, notes)
    axes = load_axes if potentials is None else None
    return replace(result, against=against, load_axes=axes)


def _collected(
    elastic: ElasticMechanism,
    poses: Array,
    points: Sequence[tuple[Any, ...]],
    mass: GravityLoads,
    notes: Sequence[Note],
) -> CompensatedPath:
    """The commands at all points, of the springs that are driven."""
    within = {elastic.names[j] for j in elastic.mechanism.virtual}
    names = tuple(name for name in elastic.spring_names if name not in within)
    *columns, verdicts = zip(*points, strict=True)
    reached, commands, unloaded, weight, before, after, deviation = map(np.array, columns)
    names, undriven = _drives(elastic, names, commands, unloaded)
    own = [elastic.spring_names.index(name) for name in names]
    return CompensatedPath(
        elastic,
        poses,
        reached,
        names,
        commands[:, own],
        unloaded[:, own],
        weight[:, own],
        "all",
        before,
        after,
        None if elastic.identified is None else deviation,
        verdicts,
        mass,
        None,
        (*notes, *mass.notes, *undriven),
    )


def _drives(
    elastic: ElasticMechanism, names: tuple[str, ...], commands: Array, taught: Array
) -> tuple[tuple[str, ...], tuple[Note, ...]]:
    """Those of the names that are commanded, and a note on springs that nothing drives.

    Springs beside drives keep their rest lengths (m, k), and are no commands.
    """
    springs = _springs(elastic)
    passive = np.zeros(len(elastic.spring_names), bool)
    if isinstance(springs, LineSprings):
        passive = ~np.broadcast_to(springs.driven, passive.shape)
    changes = np.ptp(np.vstack([commands, taught]), axis=0)
    is_kept = passive & (changes <= numerics.ROUNDOFF * np.abs(commands).max(axis=0))
    every = elastic.spring_names
    names = tuple(n for n in names if not is_kept[every.index(n)])
    if not (commanded := tuple(n for n in names if passive[every.index(n)])):
        return names, ()
    message = (
        f"nothing drives {listed(commanded, 12)} by the file: these commands are rest "
        "lengths, which a drive has to change (driven: true)"
    )
    return names, (Note("commands-of-springs", message, {"springs": list(commanded)}),)


def _postures(
    elastic: ElasticMechanism, path: ArrayLike, start: ArrayLike | None
) -> Array:
    mechanism = elastic.mechanism
    rows = checked_array(path, [*mechanism.shapes_of_rows, ("m", 4, 4)], "path")
    if rows.ndim == 2:
        return mechanism.undeflected(rows)
    q = elastic.q if start is None else mechanism.checked(start, "q")
    postures = []
    for index, T in enumerate(checked_pose(rows)):
        try:
            q = System(elastic, (), Held.from_pose(T)).retracted(q)
        except ConvergenceError as error:
            raise ConvergenceError(
                f"pose {index + 1} of the path cannot be reached",
                iterations=error.iterations,
                residual=error.residual,
            ) from None
        postures.append(q)
    return np.array(postures)


def _given_loads(
    wrenches: ArrayLike | Sequence[Potential | Sequence[Potential]] | None,
    m: int,
    kind: LoadKind,
    axes: str,
) -> list[tuple[Potential, ...]] | None:
    """Loads of m points that are none, or potentials; None for wrenches."""
    if wrenches is None:
        return [()] * m
    each: Any = [wrenches] * m if isinstance(wrenches, Potential) else wrenches
    points = list(map(_potentials, each)) if isinstance(each, Sequence) else []
    loads = [loads for loads in points if loads is not None]
    if not points or len(loads) < len(points):
        return None
    if len(loads) != m:
        raise InputError("loads and path differ in number", expected=m, got=len(loads))  # type: ignore[arg-type]
    if kind != DEAD_AT_ORIGIN or axes != "body":
        raise InputError(
            "potentials already say how and where they act",
            where="loads of the path",
            expected="no load_kind, load_at or load_axes",
        )
    return loads


def _potentials(given: Any) -> tuple[Potential, ...] | None:
    """One potential, or a sequence of them; None if it is neither."""
    each = (given,) if isinstance(given, Potential) else given
    if isinstance(each, Sequence) and all(isinstance(x, Potential) for x in each):
        return tuple(each)
    return None


def _loads(
    wrenches: ArrayLike,
    poses: Sequence[Array],
    kind: LoadKind,
    axes: Axes,
) -> list[tuple[Potential, ...]]:
    """Wrenches as loads at each pose."""
    m = len(poses)
    loads = checked_array(wrenches, [(m, 6), (6,)], "array of wrenches")
    rows = np.broadcast_to(loads, (m, 6))
    return [(kind.acting(w, T, axes),) for w, T in zip(rows, poses, strict=True)]


def _springs(elastic: ElasticMechanism) -> Springs:
    if elastic.springs is None:  # refused at the start
        raise InputError(
            f"{elastic.name} has no springs whose rest positions could be commanded"
        )
    return elastic.springs


def _commanded(elastic: ElasticMechanism, rest: Array) -> ElasticMechanism:
    springs = _springs(elastic)
    return replace(elastic, springs=springs.replaced(springs.stiffness, rest))


@dataclass(frozen=True)
class _Point:
    """A point of a path whose command is wanted.

    Attributes
    ----------
    elastic, straight : ElasticMechanism
        With all that acts, and with what is left without weight and other potentials.
    number : int
        Of the point, from 1.
    target : ndarray (4, 4)
        Pose that is wanted.
    loads : sequence of Potential
        What acts there.
    notes : list of Note
        Those on the point are added.
    """

    elastic: ElasticMechanism
    straight: ElasticMechanism
    number: int
    target: Array
    loads: Sequence[Potential]
    notes: list[Note]

    def solved(self, given: Array, against: str) -> tuple[Any, ...]:
        """Posture, commands with and without compensation, change by the weight, errors
        before and after, its deviation, and the verdict; from a `given` posture (n,).
        """
        elastic, mechanism = self.elastic, self.elastic.mechanism
        # Postures under the load, under the weight, and without forces.
        here = self.at_rest(elastic, given, self.loads)
        under_weight = self.at_rest(elastic, given, ())
        force_free = self.at_rest(self.straight, given, ())
        rest = self.balancing_rest(here, self.loads)
        taught = self.balancing_rest(under_weight, ())
        alone = replace(self.straight, potentials=())
        posture = mechanism.at(force_free)
        unbent = _springs(with_rest_balancing(alone, posture, np.zeros(6))).rest
        naive, program = unbent, force_free
        if against == "load":
            naive, program = taught, under_weight
        before, deflected = self.error(naive, program, "before")
        # The check starts beside the answer, on the side of the deflection.
        start = here if deflected is None else here + _START_OFFSET * (deflected.q - here)
        after, held = self.error(rest, start, "after")
        spread = None if held is None else held.displacement_deviation
        deviation = np.full(6, np.nan) if spread is None else spread
        stable = self.verdict(rest, here)
        self.note_limits(rest)
        posture = mechanism.at(here)
        self.notes.extend(limit_notes(mechanism, posture, f"point {self.number}: "))
        away = displacement_between(self.target, posture.pose) / np.repeat(
            [1.0, posture.length], 3
        )
        if np.abs(away).max() > numerics.NEGLIGIBLE_DIFFERENCE:
            words = (
                ": the joints cannot undo all of the links' deflection: the nearest pose "
                "is taken"
            )
            self.add(Note("pose-missed", words))
        return here, rest, naive, taught - unbent, before, after, deviation, stable

    def add(self, note: Note) -> None:
        """Add a note on the point, which its message and values name."""
        words = f"point {self.number}{note.message}"
        self.notes.append(Note(note.code, words, {"point": self.number, **note.values}))

    def at_rest(
        self, elastic: ElasticMechanism, q: Array, loads: Sequence[Potential]
    ) -> Array:
        """Posture (n,) that has the pose while compliant links carry their part of
        loads and weight.
        """

        def away(at: MechanismPosture) -> Array:
            return se3.log(se3.inverse(at.pose) @ self.target)

        try:
            return settled(elastic, elastic.mechanism.at(q), loads, away).q
        except ConvergenceError as error:
            raise ConvergenceError(
                f"point {self.number}: {error.what}",
                iterations=error.iterations,
                residual=error.residual,
            ) from None

    def balancing_rest(self, q: Array, loads: Sequence[Potential]) -> Array:
        """Rest positions at which the springs, and the closures,
        balance all other forces at q.
        """
        elastic, posture = self.elastic, self.elastic.mechanism.at(q)
        columns = posture.coordinate_lengths
        if posture.coordinates_are_pose:  # as under a load: near their preload
            balanced = with_rest_balancing(
                elastic.with_potential(*loads), posture, np.zeros(6)
            )
        else:
            free = _commanded(elastic, np.full(len(elastic.spring_names), np.nan))
            balanced = with_rest_balancing(free.with_potential(*loads), posture)
        springs = _springs(balanced)
        acting = balanced.evaluate(posture)
        left = acting.gradient * columns
        carried = np.abs(left - springs.evaluate(posture).gradient * columns)
        if posture.closure is not None:
            N = decomposed(posture.closure, columns).N
            left, carried = N.T @ left, np.abs(N).T @ carried
        unbalanced = numerics.largest(left)
        stiffest = float(np.abs(acting.hessian * np.outer(columns, columns)).max())
        shares = (
            numerics.REPORTED_ERROR * carried.max(initial=0.0),
            numerics.ROUNDOFF_OF_SUMS * stiffest,
        )
        if unbalanced > max(shares):
            raise UndefinedError(
                f"no command balances the load at point {self.number}: joints without "
                "springs would have to carry a part of it",
                code="not-compensable",
                values={"point": self.number, "unbalanced": unbalanced},
            )
        return springs.rest

    def error(
        self, rest: Array, q: Array, which: str
    ) -> tuple[Array, Equilibrium | None]:
        """Error (6,) of the pose under a command, and the state; found from q."""
        commanded = _commanded(self.elastic, rest)
        try:
            state = equilibrium(commanded, q, *self.loads, limits=False)
        except CartstiffError as error:
            self.add(Note("no-equilibrium", f", {which} compensation: {error}"))
            return np.full(6, np.nan), None
        return displacement_between(self.target, state.pose), state

    def verdict(self, rest: Array, q: Array) -> bool | None:
        """Whether the mechanism stays at q under the command."""
        commanded = _commanded(self.elastic, rest)
        state = equilibrium(commanded, q, *self.loads, limits=False, settle=False)
        if state.stable is False:
            words = (
                ": under the command and the load this posture is unstable, and the "
                "mechanism settles elsewhere"
            )
            values = {"eigenvalues": state.eigenvalues.tolist()}
            self.add(Note("unstable-command", words, values))
        return state.stable

    def note_limits(self, rest: Array) -> None:
        """Note commands that the joints, or the legs of a platform, cannot take."""
        limits = limits_of(self.elastic.mechanism, contacts=True)
        commands = rest[limits.columns]
        for i in np.flatnonzero(limits.side(commands)):
            name, low, high = limits.names[i], limits.lower[i], limits.upper[i]
            words = f": the command of {name} is beyond its limit"
            facts = {"command": commands[i], "lower": low, "upper": high}
            values = finite({key: float(x) for key, x in facts.items()})
            self.add(Note("command-beyond-limit", words, values))
