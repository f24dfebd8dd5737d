r"""Assembly modes: all poses in which the same actuator positions hold a mechanism.

For a six-legged platform all modes are found (`cartstiff.wings.reach.platform_assembly`);
for a closed chain those that random starts lead to, with the actuators held. Struts with
flexures come to rest near the pose of ideal joints.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any, ClassVar, Literal, cast

import numpy as np
from numpy.typing import ArrayLike

from cartstiff.answer.vibration.modes import modes
from cartstiff.core import numerics
from cartstiff.core.arrays import (
    Array,
    checked_flag,
    checked_seed,
    checked_vector,
    plain_dict,
)
from cartstiff.core.checked_call import checked
from cartstiff.core.described import described
from cartstiff.core.errors import ConvergenceError, InputError, UndefinedError
from cartstiff.core.figures import draw_bars, new_axes
from cartstiff.core.geometry import se3
from cartstiff.core.mechanisms.chain import Chain
from cartstiff.core.mechanisms.elastic import ElasticMechanism, checked_elastic
from cartstiff.core.mechanisms.gravity_loads import gravity_loads
from cartstiff.core.mechanisms.limits import limit_notes
from cartstiff.core.mechanisms.platform import Platform
from cartstiff.core.notebook import ShownInLines
from cartstiff.core.notes import Note
from cartstiff.core.results import LabelledResult
from cartstiff.core.statics.equilibrium import equilibrium
from cartstiff.core.stiffness.balance import with_rest_balancing
from cartstiff.core.stiffness.compute import PostureStiffness, analyse
from cartstiff.kinematics.joint_poses import JointPoses
from cartstiff.kinematics.legs import Search
from cartstiff.recorded.kernels import Closer
from cartstiff.wings.reach.architecture import architecture_of
from cartstiff.wings.reach.platform_assembly import PathCount, poses_of_lengths

# Number of starts that are closed one by one if recorded Newton steps do not close them.
_MAX_SINGLE_STARTS = 100


def closed_from(
    elastic: ElasticMechanism,
    chain: Chain,
    q: Array,
    starts: int,
    seed: int,
    progress: Callable[[int, int], None] | None,
) -> tuple[list[Array], list[Array]]:
    """Close a chain from random starts; return distinct coordinates (n,) and places
    of the joints.

    `q` is closed and comes first; its actuated and virtual joints are held. `progress` is
    called with (done, total) starts.
    """
    held = list(chain.actuated or ())
    solver = JointPoses(elastic, limits=False)
    begin = solver.random_starts(starts, np.random.default_rng(checked_seed(seed)))
    begin = np.vstack([q, begin])
    begin[:, chain.held] = q[chain.held]
    fixed = chain.with_rigid(chain.rigid | frozenset(chain.held))
    # Most starts do not close, and their steps take most of the time: all are iterated at
    # once.
    begin, is_closed, _ = Closer(elastic, compiled=False)(begin)
    first = _MAX_SINGLE_STARTS if is_closed.any() else len(begin)
    closed: list[Array] = []
    places: list[Array] = []
    for done, row in enumerate(begin, 1):
        if progress is not None:
            progress(done, len(begin))
        posture = None
        if done <= first or is_closed[done - 1]:
            with suppress(ConvergenceError):
                posture = fixed.closed(row, hold=())
        if posture is None:
            continue
        if np.abs(posture.q[held] - q[held]).max() > numerics.NEGLIGIBLE_DISTANCE:
            continue  # closed only by leaving the actuators' positions
        place = chain.tree.at(posture.q).joint_poses(
            [*range(1, chain.tree.model.njoints)]
        )
        where = np.append(place[:, :3, 3].ravel(), posture.pose[:3].ravel())
        unit = numerics.NEGLIGIBLE_DISTANCE * max(1.0, posture.length)
        if all(np.abs(where - other).max() > unit for other in places):
            places.append(where)
            closed.append(np.array(posture.q))
    return closed, places


# Largest number of steps of the search for an equilibrium of flexures; successful ones
# take fewer.
_EQUILIBRIUM_STEPS = 20


def at_rest_with(
    elastic: ElasticMechanism,
    home: Array,
    lengths: Array,
    q: Array,
    stiffness: Callable[[Array], PostureStiffness],
) -> tuple[PostureStiffness, tuple[Note, ...]]:
    """Return the stiffness of a platform with leg lengths (m,), at or near a pose q (6,).

    Legs between ideal joints hold the platform at q. Struts with flexures are undeflected
    at `home`; from there their actuators are commanded to the lengths, and the platform
    comes to rest near q. If no equilibrium is found, the result is that at q, with a
    note. `stiffness` is `analyse` at a pose, under the load.
    """
    springs, lines = elastic.springs, elastic.mechanism.at(home).lines
    if springs is None or lines is None or not springs.gives_aside:
        return stiffness(q), ()
    if not springs.is_complete:
        at_home = with_rest_balancing(elastic, home).springs
        moved = lengths - lines.lengths
        elastic = elastic.with_springs(rest=at_home.rest + moved)  # type: ignore[union-attr]
    try:
        return equilibrium(elastic, q=q, iterations=_EQUILIBRIUM_STEPS).stiffness, ()
    except (ConvergenceError, UndefinedError):
        message = (
            "flexures hold the platform in no balance near this pose: it is ideal joints'"
        )
        return analyse(elastic, q), (
            Note("struts-not-in-equilibrium", message, {"q": q.tolist()}),
        )


@dataclass(frozen=True, eq=False, repr=False)
class AssemblyMode(ShownInLines):
    """One pose in which the actuator positions hold the mechanism.

    Attributes
    ----------
    result : PostureStiffness
        Result of `cartstiff.analyse` there, with ``result.q`` and ``result.pose``.
    residual : float
        Largest difference from the required lengths, or gap of the closures.
    multiplicity : int
        1; more at a singular pose in which several solutions coincide, and which is found
        with fewer digits.
    more_notes : tuple of Note
        Notes besides those of the result: that struts with flexures are not in
        equilibrium here.
    """

    result: PostureStiffness
    residual: float
    multiplicity: int = 1
    more_notes: tuple[Note, ...] = ()

    def _lines(self) -> list[str]:
        return [
            f"AssemblyMode at q = {np.array2string(self.q, precision=5)}",
            f"  smallest eigenvalue {self.eigenvalue}, stable {self.stable}",
        ]

    @property
    def notes(self) -> tuple[Note, ...]:
        """Notes of this mode and of its result."""
        return (*self.more_notes, *self.result.notes)

    @property
    def q(self) -> Array:
        """Coordinates (n,); for a platform x, y, z, roll, pitch, yaw."""
        return self.result.q

    @property
    def pose(self) -> Array:
        """``T_F_M`` (4, 4)."""
        return self.result.pose

    @cached_property
    def eigenvalue(self) -> float | None:
        """Smallest eigenvalue of the tangent stiffness, force per length;
        None if none exists.

        Of the symmetric part, with angles times the characteristic length.
        """
        K = self.result.tangent
        if K is None:
            return None
        scale = np.repeat([1.0 / self.result.posture.length, 1.0], 3)
        scaled = 0.5 * (K + K.T) * np.outer(scale, scale)
        return float(numerics.eigenvalues(scaled)[0])

    @cached_property
    def stable(self) -> bool | None:
        """Whether every motion has a restoring force; None if that is not decided.

        It is not decided at singular poses, and without both stiffness and compliance.
        """
        undecided = {
            "type-2-singularity",
            "singular-stiffness",
            "struts-not-in-equilibrium",
        }
        if self.multiplicity > 1 or undecided & {note.code for note in self.notes}:
            return None
        if self.eigenvalue is not None:
            return self.eigenvalue > 0.0
        C = self.result.tangent_compliance  # exists with fewer than six free motions
        if C is None:
            return None
        scale = np.repeat([self.result.posture.length, 1.0], 3)
        values = numerics.eigenvalues(0.5 * (C + C.T) * np.outer(scale, scale))
        return bool(values[0] >= -numerics.ZERO_SHARE * max(values[-1], 0.0))

    @cached_property
    def determinant(self) -> float | None:
        """Determinant of six legs' lines, moments over the characteristic length;
        None for chains.

        Its sign is constant in a region between singularities.
        """
        lines = self.result.posture.actuation
        if (
            not self.result.posture.coordinates_are_pose
            or lines is None
            or len(lines) != 6
        ):
            return None
        return float(
            np.linalg.det(lines / np.repeat([self.result.posture.length, 1.0], 3))
        )

    @cached_property
    def frequencies(self) -> Array | None:
        """Natural frequencies [Hz] in this pose; None without masses or modes."""
        elastic = self.result.elastic
        if not sum(elastic.masses.values()) > 0.0:
            return None
        try:
            return modes(self.result).frequencies
        except UndefinedError:
            return None

    def to_dict(self) -> dict[str, Any]:
        """For JSON."""
        data = {
            "q": self.q,
            "pose": self.pose,
            "residual": self.residual,
            "multiplicity": self.multiplicity,
            "smallest_eigenvalue": self.eigenvalue,
            "stable": self.stable,
            "determinant": self.determinant,
            "frequencies": self.frequencies,
            "notes": self._own_notes,
        }
        return plain_dict(data)

    @cached_property
    def _own_notes(self) -> list[Note]:
        """Notes of this mode without those of the mechanism."""
        general = {note.code for note in self.result.elastic.notes}
        return [note for note in self.notes if note.code not in general]


_Stiffness = Callable[[Array], PostureStiffness]
# Default number of random starts of closed chains.
_DEFAULT_STARTS = 64


@dataclass(frozen=True, eq=False, repr=False)
class AssemblyModes(LabelledResult):
    """Assembly modes of a mechanism, and how completely they are known.

    Attributes
    ----------
    elastic : ElasticMechanism
        The mechanism.
    given : mapping
        Leg lengths, or positions of the actuated joints, by name.
    modes : tuple of AssemblyMode
        Modes by distance from the default posture.
    search : PathCount or Search or None
        Ends of the 40 paths, or number of starts; None if nothing was searched, with the
        reason in the notes.
    notes : tuple of Note
        Assumptions, and reasons why modes are missing.
    found : int
        Number of modes that were found; with ``every=False`` more than are listed.
    """

    command: ClassVar = "assemble"

    elastic: ElasticMechanism
    given: Mapping[str, float]
    modes: tuple[AssemblyMode, ...]
    search: PathCount | Search | None
    notes: tuple[Note, ...] = ()
    found: int = 0

    def __len__(self) -> int:
        return len(self.modes)

    def __getitem__(self, index: int) -> AssemblyMode:
        return self.modes[index]

    def __iter__(self) -> Iterator[AssemblyMode]:
        return iter(self.modes)

    @property
    def q(self) -> Array:
        """Coordinates (k, n) of all modes."""
        return np.array([mode.q for mode in self.modes]).reshape(
            -1, len(self.elastic.names)
        )

    @property
    def poses(self) -> Array:
        """Poses ``T_F_M`` (k, 4, 4) of all modes."""
        return np.array([mode.pose for mode in self.modes]).reshape(-1, 4, 4)

    @property
    def is_complete(self) -> bool:
        """Whether it is certain that no isolated mode is missing; never for chains."""
        return isinstance(self.search, PathCount) and self.search.is_complete

    def _lines(self) -> list[str]:
        return [
            f"Assembly modes of {self.elastic.name}: {self.found}, {len(self.modes)} "
            "listed",
            f"  searched  {self.search}",
            f"  stable    {sum(mode.stable is True for mode in self.modes)}",
        ]

    def to_dict(self) -> dict[str, Any]:
        """For JSON: numbers, lists, texts, None."""
        elastic, search = self.elastic, self.search
        method: dict[str, Any] | None = None
        if isinstance(search, PathCount):
            method = {"method": "homotopy", **search.to_dict()}
        elif search is not None:
            method = {
                "method": "starts",
                "starts": search.starts,
                "found": search.found,
                "complete": False,
            }
        own = {
            "found": self.found,
            "search": method,
            "modes": [mode.to_dict() for mode in self.modes],
        }
        return described(
            "assemble", own, elastic.about(), gravity_loads(elastic).to_dict(), self
        )

    def plot(self, ax: Any = None) -> Any:
        """Draw the smallest eigenvalue of each mode; those that are not stable in red.

        Parameters
        ----------
        ax : matplotlib.axes.Axes, optional
            Whose place the picture takes; default a figure of its own.

        Returns
        -------
        matplotlib.figure.Figure

        Raises
        ------
        MissingDependencyError
            Without matplotlib.
        """
        figure, axis = new_axes(self.elastic.springs_in_doubt, ax=ax)
        names = [f"mode {i + 1}" for i in range(len(self.modes))]
        values = [np.nan if m.eigenvalue is None else m.eigenvalue for m in self.modes]
        units = self.elastic.units
        label = f"smallest eigenvalue [{units.force}/{units.length}]"
        bars = draw_bars(axis, names, values, label)
        for bar, mode in zip(bars, self.modes, strict=True):
            bar.set_color("tab:blue" if mode.stable else "tab:red")
        return figure


@checked
def assemble(
    elastic: ElasticMechanism,
    lengths: ArrayLike | None = None,
    *,
    q: ArrayLike | Mapping[str, float] | None = None,
    wrench: ArrayLike | None = None,
    load_kind: Literal["dead", "follower", "conservative"] = "dead",
    load_at: ArrayLike = (0.0, 0.0, 0.0),
    load_axes: Literal["body", "world"] = "body",
    starts: int | None = None,
    seed: int | None = None,
    every: bool = True,
    progress: Callable[[int, int], None] | None = None,
) -> AssemblyModes:
    """Find all assembly modes of a mechanism, with the stiffness in each.

    For a six-legged platform the 40 complex solutions of a general platform are continued
    to this one. `PathCount` counts their ends; no isolated mode is missing if no path is
    lost. For a closed chain the named actuated joints are held, and the chain is closed
    from random starts.

    Parameters
    ----------
    elastic : ElasticMechanism
        A platform of six legs, or a closed chain.
    lengths : array_like (6,), optional
        Leg lengths of a platform; default those at `q`.
    q : array_like (n,) or mapping, optional
        Posture with the leg lengths or the positions of the actuated joints; modes near
        it come first. Default the file's posture.
    starts : int, optional
        Random starts, for closed chains; default 64. Beyond 100, starts that 40 Newton
        steps do not close are dropped. Platforms need none.
    seed : int, optional
        Seed of the starts; default 0.
    every : bool
        List all modes; without it only the one nearest to the posture.
    wrench, load_kind, load_at, load_axes : optional
        The load under which the stiffness of every mode is computed, as in
        `cartstiff.analyse`; the held actuators carry it.
    progress : callable, optional
        Called with (done, total) starts.

    Returns
    -------
    AssemblyModes
        The modes; none for a singular architecture, with a note.

    Raises
    ------
    InputError
        For cables, more or fewer than six legs, arms, chains that name no actuated
        joints, and numbers that cannot be used.

    Examples
    --------
    >>> import cartstiff
    >>> modes = cartstiff.assemble(cartstiff.load("hexapod"))
    >>> print(modes.search)
    40 paths: 8 real, 32 complex
    """
    checked_elastic(elastic)
    every = checked_flag(every, "every")
    elastic, posture = elastic.placed(q)
    values = posture.q
    mechanism = elastic.mechanism
    stiffness = partial(
        analyse,
        elastic,
        wrench=wrench,
        load_kind=load_kind,
        load_at=load_at,
        load_axes=load_axes,
    )
    # Platforms: all solutions of the equations of their lengths.
    if mechanism.coordinates_are_pose:
        springs = elastic.springs
        if wrench is not None and springs is not None and springs.gives_aside:
            raise InputError(
                "struts with flexures leave the mode under a load",
                where="wrench",
                expected="`equilibrium` from a mode found without it",
            )
        if starts is not None or seed is not None:
            raise InputError(
                "random starts are for closed chains",
                got=mechanism.kind,
                expected="neither starts nor seed: a platform needs none",
            )
        platform = cast(Platform, mechanism)
        return _of_platform(elastic, platform, lengths, values, every, stiffness)
    if lengths is not None:
        raise InputError("leg lengths are for platforms", got=mechanism.kind)
    # Closed chains: from many starting postures.
    starts = _DEFAULT_STARTS if starts is None else starts
    chain = cast(Chain, mechanism)
    return _of_chain(
        elastic, chain, values, starts, seed or 0, every, stiffness, progress
    )


def _of_platform(
    elastic: ElasticMechanism,
    platform: Platform,
    lengths: ArrayLike | None,
    q: Array,
    every: bool,
    stiffness: _Stiffness,
) -> AssemblyModes:
    unilateral = elastic.springs is not None and elastic.springs.unilateral
    if unilateral and not platform.has_legs:
        raise InputError(
            "cables do not hold a body by their lengths alone",
            expected="six legs that push and pull",
        )
    if len(platform.points) != 6:
        raise InputError(
            "all assembly modes are found for six legs only",
            got=str(len(platform.points)),
        )
    start = platform.at(q)
    if lengths is None:
        wanted = start.lines.lengths
    else:
        wanted = checked_vector(lengths, 6, "leg lengths")
    lengths_by_leg = dict(zip(elastic.spring_names, map(float, wanted), strict=True))
    notes = list(elastic.notes)
    singular = architecture_of(platform).note()
    if singular is not None:
        return AssemblyModes(elastic, lengths_by_leg, (), None, (*notes, singular))
    # All poses with these lengths, the nearest first, and what is at each of them.
    poses, counts, search, moving = poses_of_lengths(platform, wanted)
    away = np.linalg.norm(
        se3.log(se3.inverse(start.pose) @ poses)
        / [1.0, 1.0, 1.0, *[platform.length] * 3],
        axis=1,
    )
    order = np.argsort(away, kind="stable")[: None if every else 1]
    listed = []
    for i in order:
        at = platform.coordinates_of(poses[i])
        result, more = at_rest_with(elastic, q, wanted, at, stiffness)
        missed = float(np.abs(platform.leg_lengths(result.q) - wanted).max())
        listed.append(AssemblyMode(result, missed, int(counts[i]), more))
    notes += _notes_on_paths(search, moving)
    if listed:
        notes += limit_notes(platform, listed[0].result.posture)
    return AssemblyModes(
        elastic, lengths_by_leg, tuple(listed), search, tuple(notes), found=len(poses)
    )


def _notes_on_paths(search: PathCount, moving: Array) -> list[Note]:
    """Notes on solutions that are not isolated, meet, or were lost."""
    notes, found = [], search.single + search.multiple + search.moving
    if search.moving:
        pose = moving.tolist() if len(moving) else None
        where = "for example from the pose in `values`" if pose else "in complex poses"
        message = (
            f"{search.moving} of {found} solutions lie on curves: with these lengths the "
            f"platform can move while its legs are held, {where}"
        )
        values = {"paths": search.moving, "pose": pose}
        notes.append(Note("self-motion", message, values))
    if search.multiple:
        message = (
            f"{search.multiple} solutions meet in groups at singular poses (their "
            "`multiplicity`), which are known to a root of the digits only"
        )
        notes.append(Note("multiple-solutions", message, {"paths": search.multiple}))
    if not search.is_complete:
        message = f"{search.lost} of the paths are lost: assembly modes may be missing"
        notes.append(Note("paths-lost", message, {"lost": search.lost}))
    return notes


def _of_chain(
    elastic: ElasticMechanism,
    chain: Chain,
    q: Array,
    starts: int,
    seed: int,
    every: bool,
    stiffness: _Stiffness,
    progress: Callable[[int, int], None] | None,
) -> AssemblyModes:
    if not chain.closures:
        raise InputError(
            "assembly modes exist for closed chains and platforms",
            got=chain.kind,
            expected="for an arm, the branches of its inverse kinematics "
            "(inverse_kinematics)",
        )
    if not chain.actuated:
        raise InputError(
            "the mechanism names no actuated joints, so that nothing is held",
            expected="actuated: [...] in its file",
        )
    if (
        isinstance(starts, bool)
        or not isinstance(starts, (int, np.integer))
        or starts < 0
    ):
        raise InputError(
            "number of starts cannot be used", expected="0 or more", got=starts
        )
    # Modes in the order of their distance.
    held = list(chain.actuated)
    q = chain.assembled(q)
    closed, places = closed_from(elastic, chain, q, int(starts), seed, progress)
    order = sorted(range(len(closed)), key=lambda i: numerics.norm(places[i] - places[0]))
    listed = tuple(
        AssemblyMode(result, _gap(result))
        for result in (stiffness(closed[i]) for i in order[: None if every else 1])
    )
    fixed = {elastic.names[j]: float(q[j]) for j in held}
    search = Search(int(starts) + 1, (), len(closed), len(listed))
    return AssemblyModes(elastic, fixed, listed, search, elastic.notes, found=len(closed))


def _gap(result: PostureStiffness) -> float:
    residual = result.posture.residual
    return 0.0 if residual is None else numerics.largest(residual)
