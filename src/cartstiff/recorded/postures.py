r"""Stacks of postures: their arrays, and the states that a program leaves open.

`cartstiff.analyse` computes every posture that is not well inside the regular ones, and
names its state.

Postures of arms that have lost rank are computed in stacks as well, as ``C = J H^-1 J^T``
needs no inverse of J, where their state is certain: the singular values are far from the
limit of rank, the stiffness is positive along every motion, so that no self-motion costs
nothing or buckles, and the torque along the self-motion is either zero, because the
springs carry a known load, or far from zero.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from cartstiff.core import numerics
from cartstiff.core.arrays import Array
from cartstiff.core.errors import (
    ConvergenceError,
    InputError,
    UndefinedError,
    UnknownNameError,
)
from cartstiff.core.matrix_names import OF_MANY
from cartstiff.core.mechanisms.elastic import ElasticMechanism
from cartstiff.core.numerics import BALANCE_TOLERANCE, RANK, ROUNDOFF
from cartstiff.core.potentials.line_springs import LineSprings
from cartstiff.core.stiffness.applied_load import Axes, LoadKind
from cartstiff.core.stiffness.compute import PostureStiffness, analyse
from cartstiff.core.stiffness.settled_links import settled_coordinates
from cartstiff.core.stiffness.tensor import COMPONENTS, with_labels
from cartstiff.core.units import Units
from cartstiff.recorded.algebra import FALLBACK, PLAIN, UNBALANCED
from cartstiff.recorded.arguments import (
    OF_VIBRATIONS,
    TENSIONS,
    TORQUES,
    aligned_empty,
    full_name,
)
from cartstiff.recorded.chains import ChainCase
from cartstiff.recorded.kernels import WORTH_COMPILING, WORTH_RECORDING, kernel_of, run
from cartstiff.recorded.known_numbers import Question
from cartstiff.recorded.plans import Case, TracedModel, program_for
from cartstiff.recorded.platforms import PlatformCase
from cartstiff.recorded.tape import Arrays

REGULAR, NOT_ASSEMBLED = "regular", "not-assembled"
Indices = NDArray[np.intp]


def state_of(result: PostureStiffness, outputs: Collection[str] = ()) -> str:
    """Code of a posture's state.

    The last state of the reduction, as in `analyse` with ``strict``; else a type-2
    singularity; else, if matrices are among the outputs, a singular stiffness matrix
    (K^A, K^K and the tangent under the load, if their inverse is an output), or a note of
    `analyse` on lost digits of the compliance, or, if none is an output, of the
    stiffness.
    """
    if result.reduction.states:
        return result.reduction.states[-1].code
    kinds = {name.partition("_")[0] for name in outputs}
    notes = result.notes_on_posture
    if "compliance" in kinds:
        notes = result.notes
    elif "stiffness" in kinds:  # does not compute other inverses
        notes = *notes, *result.notes_on_digits
    codes = {note.code for note in notes}
    for code in ("type-2-singularity", "singular-stiffness"):
        if code in codes:
            return code
    changed = [name for name in ("A", "K", "load") if f"compliance_{name}" in outputs]
    if any(result.compliances[name] is None for name in changed):
        return "singular-stiffness"
    for note in notes:
        if (
            note.code == "ill-conditioned"
            and np.asarray(note.values["relative_error"]) > numerics.LOST_ERROR
            # Beside a compliance, a stiffness need not resolve its softer directions.
            and (note.values["matrix"] == "compliance" or "compliance" not in kinds)
        ):
            return note.code
    return REGULAR


def fill(
    elastic: ElasticMechanism,
    q: Array,
    wrench: Array | None,
    rows: Arrays,
    load: LoadKind,
    axes: Axes,
) -> tuple[str, Array]:
    """Write one posture's arrays into `rows`; return its state and its coordinates.

    The coordinates of a chain that can be closed are the closed ones, whatever its state.
    """
    for row in rows.values():
        row[...] = np.nan
    try:
        result = Question(elastic, q, wrench, load, axes).core
    except ConvergenceError:
        return NOT_ASSEMBLED, q
    except UndefinedError as error:
        return error.code, _closed(elastic, q)
    except InputError:
        # All input has been checked before: the springs cannot carry this load here.
        at = elastic.mechanism.closed(elastic.mechanism.checked(q))
        if "pose" in rows:
            rows["pose"][...] = at.pose
        return "unbalanced", np.asarray(at.q)
    for name, row in rows.items():
        if name not in OF_VIBRATIONS:  # those of recordings
            row[...] = result[name]
    return state_of(result, rows), result.q


def _closed(elastic: ElasticMechanism, q: Array) -> Array:
    return np.asarray(elastic.mechanism.closed(elastic.mechanism.checked(q)).q)


#: Factor from a limit beyond which a state is certain.
_MARGIN = 10.0
#: Chunk of postures whose tensions are chosen together, so that their rows stay in the
#: cache.
_TENSIONS_CHUNK = 4096


@dataclass(frozen=True)
class Stack:
    """Postures with their outputs, and what other programs need to fill some of them.

    Attributes
    ----------
    elastic, taken : the mechanism, and its recorded arithmetic, if there is some.
    q, loads : coordinates (N, n), and the wrench (6,), or (N, 6), if any.
    load, axes : behaviour of that load, and axes of its components.
    arrays : outputs of all postures by name.
    state : verdicts (N,), which become states.
    compiled, threads, size : as of `run`.
    codes : the states' codes.
    """

    elastic: ElasticMechanism
    taken: TracedModel | None
    q: Array
    loads: Array | None
    load: LoadKind
    axes: Axes
    arrays: Arrays
    state: NDArray[np.uint8]
    compiled: bool
    threads: int
    size: int | None
    codes: list[str] = field(default_factory=lambda: [REGULAR])

    def loads_of(self, which: Any) -> Array | None:
        """The wrench (6,), or those of some postures."""
        is_one = self.loads is None or self.loads.ndim == 1
        return self.loads if is_one else self.loads[which]  # type: ignore[index]

    def rows(self, names: Collection[str], which: Indices) -> dict[str, Array]:
        """Room for some outputs of the postures `which`."""
        return {
            name: aligned_empty(len(which), *self.arrays[name].shape[1:])
            for name in names
        }

    def fill(
        self,
        case: Case,
        which: Indices,
        rows: Arrays,
        more: Arrays | None = None,
    ) -> NDArray[np.bool_]:
        """Fill `rows` of the postures `which` by another case.

        Which are plainly regular.
        """
        assert self.taken is not None
        other = replace(self.taken, case=case)
        verdicts = np.zeros(len(which), np.uint8)
        if len(which):
            is_compiled = self.compiled and len(which) >= WORTH_COMPILING
            kernel = kernel_of(program_for(case, tuple(rows)), is_compiled)
            own = self.q[which], self.loads_of(which)
            run(other, kernel, *own, rows, verdicts, self.threads, self.size, more)
        return verdicts == PLAIN

    def index(self, code: str) -> int:
        """Number of a state."""
        if code not in self.codes:
            self.codes.append(code)
        return self.codes.index(code)

    def decide(self, one_by_one: int | None) -> int:
        """Turn verdicts into states, and fill what a program has not.

        Returns
        -------
        int
            Number of postures that `cartstiff.analyse` has computed, at most
            `one_by_one`.
        """
        if self.taken is None:
            self.analyse(np.arange(len(self.state)))
            return len(self.state)
        if self.taken.regular != REGULAR:
            clear_still_halves(self.elastic, self.arrays)
        # Postures in doubt: lost ranks and chosen tensions have programs of their own.
        doubtful = np.flatnonzero(self.state == FALLBACK)
        lost_state, lost_rank = "", doubtful[:0]
        if len(doubtful) >= WORTH_RECORDING:
            lost_state, lost_rank, torn = lost_ranks(self, self.taken, doubtful)
            self.state[torn] = UNBALANCED
            clear_still_halves(self.elastic, self.arrays, lost_rank)
            doubtful = np.setdiff1d(doubtful, np.concatenate([lost_rank, torn]))
        if len(doubtful):
            filled, torn = by_chosen_tensions(self, self.taken, doubtful)
            self.state[torn] = UNBALANCED
            doubtful = np.setdiff1d(doubtful, np.concatenate([filled, torn]))
        # States by their codes; without balance what depends on the load does not exist.
        unbalanced = np.flatnonzero(self.state == UNBALANCED)
        self.state[:] = self.index(self.taken.regular)
        if len(lost_rank):
            self.state[lost_rank] = self.index(lost_state)
        if len(unbalanced):
            self._clear_unbalanced(self.taken, unbalanced)
        # The core decides the rest, or a sample of it.
        if one_by_one is not None and len(doubtful) > one_by_one:
            left = np.ones(len(doubtful), bool)
            left[np.linspace(0, len(doubtful) - 1, one_by_one).astype(int)] = False
            self.state[doubtful[left]] = self.index(UNDECIDED)
            for array in self.arrays.values():
                array[doubtful[left]] = np.nan
            doubtful = doubtful[~left]
        if len(doubtful):
            self.analyse(doubtful)
        return len(doubtful)

    def _clear_unbalanced(self, taken: TracedModel, which: Indices) -> None:
        """Remove what does not exist where springs cannot balance the load."""
        self.state[which] = self.index("unbalanced")
        unknown: tuple[str, ...] = (
            "wrench",
            "stiffness",
            "compliance",
            TENSIONS,
            TORQUES,
        )
        if taken.untraced.struts is not None:  # no equilibrium, and so no energy either
            unknown += ("energy", "jacobian")
        for name, array in self.arrays.items():
            if name.startswith(unknown):
                array[which] = np.nan

    def analyse(self, which: Indices) -> None:
        """Fill some postures one by one.

        Also writes the coordinates of assembled chains.
        """
        moved = is_moved(self.elastic, self.loads is not None)
        with numerics.one_thread():
            for i in which.tolist():
                own = self.loads_of(i)
                rows = {name: array[i : i + 1] for name, array in self.arrays.items()}
                code, closed = fill(
                    self.elastic, self.q[i], own, rows, self.load, self.axes
                )
                if moved:
                    self.q[i] = closed
                self.state[i] = self.index(code)


def clear_still_halves(
    elastic: ElasticMechanism, arrays: Arrays, which: Indices | slice = slice(None)
) -> None:
    """Set round-off to zero in the compliances of postures with a rank below six."""
    length = elastic.mechanism.at(elastic.q).length
    for name, array in arrays.items():
        if name.startswith("compliance"):
            some = array[which]
            numerics.clear_still_halves(some, length)
            array[which] = some


def is_moved(elastic: ElasticMechanism, is_loaded: bool) -> bool:
    """Whether coordinates are changed: by closing the chain,
    or by deflection of links.
    """
    bends = is_loaded and bool(settled_coordinates(elastic).size)
    return bends or bool(elastic.mechanism.closures)


def lost_ranks(
    stack: Stack, taken: TracedModel, which: Indices
) -> tuple[str, Indices, Indices]:
    """Fill those of the postures `which` that have certainly lost rank.

    Returns
    -------
    state : str
        State of those that are filled.
    filled, unbalanced : ndarray of int
        Some of `which`; the latter have pose, Jacobian and energy only.
    """
    case, elastic, arrays = taken.case, stack.elastic, stack.arrays
    if not isinstance(case, ChainCase) or case.is_closed or case.settled:
        return "", which[:0], which[:0]
    n = case.freedoms
    state = "fewer-than-six-freedoms" if n < 6 else "serial-singularity"
    names = [name for name in arrays if not name.startswith("stiffness")]
    # J, the torques, and the largest stiffness.
    rows, looked_at = stack.rows(names, which), aligned_empty(len(which), 7 * n + 1)
    singular = replace(case, singular=True)
    is_known = stack.fill(singular, which, {**rows, "looked_at": looked_at})

    J = looked_at[:, : 6 * n].reshape(-1, 6, n)
    is_known &= np.isfinite(looked_at).all(axis=1)
    J = np.where(is_known[:, None, None], J, 0.0)
    values = np.linalg.svd(J, compute_uv=False)
    least = RANK * values[:, :1]
    is_known &= ~((values > least / _MARGIN) & (values < least * _MARGIN)).any(axis=1)
    ranks = (values > least).sum(axis=1)
    is_lost = is_known & (ranks < min(6, n))
    if (
        n >= 6 and is_lost.any()
    ):  # all postures of a body with fewer freedoms, such as a planar arm
        one = which[np.argmax(np.where(is_lost, ranks, -1))]
        usual = analyse(elastic, stack.q[one]).reduction.usual_rank
        if usual < 6:
            state = "fewer-than-six-freedoms"
            is_lost &= ranks == usual
    unbalanced = np.zeros(len(which), bool)
    if not case.is_balancing:
        # Given rest positions determine the torques: those along the self-motions must
        # vanish.
        g, stiffest = looked_at[:, 6 * n : 7 * n], looked_at[:, 7 * n]
        free, motions = np.arange(n) >= ranks[:, None], np.linalg.svd(J)[2]
        torque = np.linalg.norm((motions @ g[:, :, None])[:, :, 0] * free, axis=1)
        most = BALANCE_TOLERANCE * np.abs(g).max(axis=1) + ROUNDOFF * stiffest
        unbalanced = is_lost & (torque > most * (_MARGIN * n))
        is_lost[:] = False
    for these in (is_lost, unbalanced):
        for name, array in arrays.items():
            array[which[these]] = rows[name][these] if name in rows else np.nan
    return state, which[is_lost], which[unbalanced]


def by_chosen_tensions(
    stack: Stack, taken: TracedModel, which: Indices
) -> tuple[Indices, Indices]:
    """Fill those of the postures `which` at which bounds choose the tensions
    of many lines.

    One program has the tensions nearest to the given ones and their changes that need no
    wrench, and has the outputs once the tensions within the bounds are among its inputs.

    Returns
    -------
    filled, unbalanced : ndarray of int
        Some of `which`; of the latter only the pose is known.
    """
    case, springs = taken.case, cast(LineSprings, stack.elastic.springs)
    if not isinstance(case, PlatformCase) or not case.balances_among:
        return which[:0], which[:0]
    # Geometry of the lines first: what decides which tensions balance.
    chosen, m = replace(case, is_chosen=True), len(springs.stiffness)
    shapes = {"leg_lengths": (m,), "nearest": (m,), "null": (m, m - 6)}
    seen = {name: aligned_empty(len(which), *shape) for name, shape in shapes.items()}
    unknown = {"tensions": np.zeros((len(which), m))}
    some = np.flatnonzero(stack.fill(chosen, which, seen, unknown))
    parts = np.array_split(some, 1 + len(some) // _TENSIONS_CHUNK)
    # In chunks, since every posture has a search of its own.
    found = [
        springs.balancing_tensions(*(seen[name][part] for name in shapes))
        for part in parts
    ]
    t, exist = (np.concatenate(each) for each in zip(*found, strict=True))
    # Then everything else, at the tensions that were found.
    unbalanced, some, t = which[some[~exist]], which[some[exist]], t[exist]
    for name, array in stack.arrays.items():
        if name != "pose":
            array[unbalanced] = np.nan
    rows = stack.rows(stack.arrays, some)
    plain = stack.fill(chosen, some, rows, {"tensions": t})
    for name, array in stack.arrays.items():
        array[some[plain]] = rows[name][plain]
    return some[plain], unbalanced


def described(
    elastic: ElasticMechanism, load: LoadKind | None, axes: Axes
) -> dict[str, Any]:
    """Mechanism, frames, units and kind of load, as attributes of an xarray data set."""
    units, mechanism = elastic.units, elastic.mechanism
    of_joints = [units.coordinate(c.is_length) for c in mechanism.coordinates]
    about: dict[str, Any] = {
        "mechanism": elastic.name,
        "kind": mechanism.kind,
        "frame": mechanism.frame,
        # Flattened by rows: attributes of netCDF have one dimension.
        "frame_offset": mechanism.frame_offset.ravel().tolist(),
        "base_pose": mechanism.base_pose.ravel().tolist(),
        "length_unit": units.length,
        "force_unit": units.force,
        "angle_unit": "rad",
        "springs_in_doubt": elastic.springs_in_doubt,
        "joints": " ".join(elastic.names),
        "joint_units": " ".join(of_joints),
        "order": "angular-linear",
    }
    if load is not None:
        about["load_kind"], about["load_at"] = load.kind, list(load.at)
        about["load_axes"], about["load_meaning"] = axes, load.words
    return about


def units_of(units: Units) -> dict[str, dict[str, str]]:
    """Unit of each output with one, as attributes of xarray variables."""
    pairs = {"stiffness": units.stiffness, "compliance": units.compliance}
    found = {
        f"{kind}_{name}": f"rotation {of['rotation']}, translation {of['translation']}"
        for kind, of in pairs.items()
        for name in OF_MANY
    }
    found |= {"energy": units.moment, "wrench": f"{units.moment}, {units.force}"}
    found |= {"pose": f"1, {units.length}", TENSIONS: units.force}
    found |= {TORQUES: f"{units.moment}, {units.force}"}
    return {name: {"units": unit} for name, unit in found.items()}


#: State of postures that exceed the number `one_by_one`.
UNDECIDED = "undecided"


@dataclass(frozen=True, eq=False)
class Postures:
    """Arrays over postures; NaN where a quantity does not exist.

    Attributes
    ----------
    q : ndarray (N, n)
        Coordinates; those of a closed chain as assembled, of compliant links as
        deflected.
    arrays : dict of str to ndarray, shape (N, ...)
        Outputs by name, in the units of `units`.
    state : ndarray of uint8 (N,)
        Index into `codes` of each posture's state.
    codes : tuple of str
        ``codes[0]`` is "regular"; the others are codes of notes, see the reference, and
        "not-assembled" for closures that cannot be met.
    path : {"compiled", "portable", "engine"}
        Path that computed the regular postures.
    reason : str
        Reason why no faster path did; empty if there is none.
    names : tuple of str
        Names of the coordinates.
    fallback : int
        Number of postures that `cartstiff.analyse` has computed one by one: all of them
        on the path "engine", else those that are not well inside the regular ones.
    about : mapping
        Mechanism, frames, units and load, as attributes of `to_xarray`.
    units : mapping
        Attributes of each output there.
    loads : ndarray (6,) or (N, 6), or None
        Wrench (moment, force) that was given for all, or for each; None without one.
    """

    q: Array
    arrays: dict[str, Array]
    state: NDArray[np.uint8]
    codes: tuple[str, ...]
    path: str
    reason: str = ""
    names: tuple[str, ...] = ()
    fallback: int = 0
    about: Mapping[str, Any] = field(default_factory=dict)
    units: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    loads: Array | None = None

    def __getitem__(self, name: str) -> Array:
        try:
            return self.arrays[full_name(name)]
        except KeyError:
            raise UnknownNameError("output", name, self.arrays) from None

    def __getattr__(self, name: str) -> Array:
        """Outputs as attributes: ``postures.K``, ``postures.wrench``."""
        arrays = vars(self).get("arrays", {})
        if full_name(name) in arrays:
            return self[name]
        computed = ", ".join(arrays)
        raise AttributeError(
            f"no output {name!r}; there are {computed}: outputs=[...] asks for more"
        )

    def __len__(self) -> int:
        return len(self.state)

    def __repr__(self) -> str:
        states = ", ".join(f"{n} {code}" for code, n in self.counts().items()) or "none"
        shapes = ", ".join(f"{name} {a.shape}" for name, a in self.arrays.items())
        path = self.path
        if 0 < self.fallback < len(self):
            path += f", {self.fallback} by the engine"
        return f"{len(self)} postures ({path}): {states}\n  {shapes}"

    @property
    def is_regular(self) -> NDArray[np.bool_]:
        """Which postures are regular (N,)."""
        return self.state == 0

    def to_xarray(self) -> Any:
        """`xarray.Dataset` with labels: q, state, given_wrench, and every output;
        matrices by their letters. Attributes say mechanism, frames, units, and how the
        load acts.

        Raises
        ------
        MissingDependencyError
            Without xarray.
        """
        axes: dict[str, tuple[str, ...]] = {
            "pose": ("row", "column"),
            "jacobian": ("motion", "coordinate"),
            "wrench": ("wrench",),
            "energy": (),
            TENSIONS: ("leg",),
            TORQUES: ("coordinate",),
            "stiffness": ("wrench", "motion"),
            "compliance": ("motion", "wrench"),
        }
        shown = dict[str, str]()
        arrays: dict[str, tuple[tuple[str, ...], Array]] = {
            "q": (("posture", "coordinate"), self.q),
            "state": (("posture",), np.array(self.codes)[self.state]),
        }
        of_joints = dict.fromkeys(self.about.get("joint_units", "").split())
        units = dict[str, Mapping[str, str]](q={"units": ", ".join(of_joints)})
        if self.loads is not None:
            arrays["given_wrench"] = (
                ("posture", "wrench")[2 - self.loads.ndim :],
                self.loads,
            )
            units["given_wrench"] = self.units["wrench"]
        for name, array in self.arrays.items():
            kind, _, letter = name.partition("_")
            if array.ndim == 1:  # also of quantities whose names begin likewise
                kind = name
            # "wrench" is also the name of an axis, so that this array has another name.
            short = {
                "stiffness": f"K_{letter}",
                "compliance": f"C_{letter}",
                "wrench": "W",
            }
            own = tuple(f"{name}_{k + 1}" for k in range(array.ndim - 1))
            shown[name] = (
                name if short.get(kind) in self.arrays else short.get(kind, name)
            )
            arrays[shown[name]] = ("posture", *axes.get(kind, own)), array
        labels = {**COMPONENTS, "posture": range(len(self)), "coordinate": self.names}
        dataset = with_labels(arrays, labels, path=self.path, **self.about)
        units |= {own: self.units.get(name, {}) for name, own in shown.items()}
        for name, attributes in units.items():
            dataset[name].attrs.update(attributes)
        return dataset

    def to_pandas(self) -> Any:
        """`pandas.DataFrame` of the 6x6 matrices: a row an entry, a column a matrix.

        Its index is posture, wrench component, motion component; ``unstack`` turns
        components into columns. Everything else is in `to_xarray`.

        Raises
        ------
        InputError
            If no matrix was asked for.
        MissingDependencyError
            Without xarray.
        """
        data, axes = self.to_xarray(), ("posture", "wrench", "motion")
        names = [name for name, own in data.items() if {*own.dims} == {*axes}]
        if not names:
            raise InputError(
                "no matrices are among the outputs",
                expected='outputs=["K"]',
                got=", ".join(self.arrays),
            )
        return data[names].to_dataframe(axes)

    def counts(self) -> dict[str, int]:
        """Number of postures in each state that occurs."""
        counts = Counter(self.state.tolist())
        return {code: counts[i] for i, code in enumerate(self.codes) if counts[i]}
