r"""Many postures at once: coordinates in, arrays out.

Recorded formulas compute chains, open and closed, with lines between their bodies
(`cartstiff.batch.chains`, `closed_chains`), and platforms on line springs (`platforms`),
as machine code for the mechanism (path "compiled") or over NumPy arrays (path
"portable"). `cartstiff.analyse` itself (path "engine") computes every other mechanism,
and every posture that is not well inside the regular ones, and names its state.

Postures of arms that have lost rank are computed in stacks as well, as ``C = J H^-1 J^T``
needs no inverse of J, where their state is certain: the singular values are far from the
limit of rank, the stiffness is positive along every motion, so that no self-motion costs
nothing or buckles, and the torque along the self-motion is either zero, because the
springs carry a known load, or far from zero.
"""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal, NamedTuple, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cartstiff import numerics
from cartstiff.batch.algebra import FALLBACK, PLAIN, UNBALANCED
from cartstiff.batch.arguments import (
    EVERY_OUTPUT,
    TENSIONS,
    aligned_empty,
    arrays_for,
    checked_count,
    checked_names,
    checked_q,
    checked_wrench,
    full_name,
)
from cartstiff.batch.arguments import (
    OUTPUTS as OUTPUTS,
)
from cartstiff.batch.chains import ChainCase
from cartstiff.batch.execution import PortableKernel
from cartstiff.batch.kernels import (
    BACKENDS,
    WORTH_RECORDING,
    Backend,
    chosen,
    kernel_for,
    reading_kernel,
    run,
)
from cartstiff.batch.plans import Case, TracedModel, given_as, plan
from cartstiff.batch.platforms import PlatformCase
from cartstiff.batch.quantities import FREQUENCIES
from cartstiff.batch.readings import Readings, recordable, with_masses
from cartstiff.checked_call import checked
from cartstiff.errors import (
    ConvergenceError,
    InputError,
    UndefinedError,
    UnknownNameError,
)
from cartstiff.geometry.se3 import Array
from cartstiff.matrix_names import OF_MANY
from cartstiff.mechanisms.elastic import ElasticMechanism, checked_elastic
from cartstiff.numerics import BALANCE_TOLERANCE, RANK, ROUNDOFF
from cartstiff.potentials.line_springs import LineSprings
from cartstiff.stiffness.applied_load import DEAD_AT_ORIGIN, Axes, LoadKind, checked_load
from cartstiff.stiffness.compute import PostureStiffness, analyse
from cartstiff.stiffness.settled_links import settled_coordinates
from cartstiff.stiffness.tensor import COMPONENTS, with_labels
from cartstiff.units import Units

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
    rows: Mapping[str, Array],
    load: LoadKind,
    axes: Axes,
) -> tuple[str, Array]:
    """Write one posture's arrays into `rows`; return its state and its coordinates.

    The coordinates of a chain that can be closed are the closed ones, whatever its state.
    """
    for row in rows.values():
        row[...] = np.nan
    try:
        result = analyse(
            elastic,
            q,
            wrench=wrench,
            load_kind=load.kind,
            load_at=load.at,
            load_axes=axes,
        )
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
        value = _output(result, name)
        if value is not None:
            row[...] = value
    return state_of(result, rows), result.q


def _closed(elastic: ElasticMechanism, q: Array) -> Array:
    return np.asarray(elastic.mechanism.closed(elastic.mechanism.checked(q)).q)


def _output(result: PostureStiffness, name: str) -> Array | float | None:
    kind, _, connection = name.partition("_")
    if connection == "load":
        return result.tangent if kind == "stiffness" else result.tangent_compliance
    if kind == "stiffness":
        return result.matrices[connection]
    if kind == "compliance":
        return result.compliances[connection]
    value: Array | float | None = getattr(result, name)
    return value


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
    elastic, taken : the mechanism, and its recorded arithmetic.
    q, loads : coordinates (N, n), and the wrench (6,), or (N, 6), if any.
    arrays : outputs of all postures by name.
    compiled, threads, size : as of `run`.
    """

    elastic: ElasticMechanism
    taken: TracedModel
    q: Array
    loads: Array | None
    arrays: Mapping[str, Array]
    compiled: bool
    threads: int
    size: int | None

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
        rows: Mapping[str, Array],
        more: Mapping[str, Array] | None = None,
    ) -> NDArray[np.bool_]:
        """Fill `rows` of the postures `which` by another case.

        Which are plainly regular.
        """
        other, loads = replace(self.taken, case=case), self.loads
        verdicts = np.zeros(len(which), np.uint8)
        if len(which):
            kernel = kernel_for(case, tuple(rows), len(which), self.compiled)
            own = loads[which] if loads is not None and loads.ndim == 2 else loads
            q = self.q[which]
            run(other, kernel, q, own, rows, verdicts, self.threads, self.size, more)
        return verdicts == PLAIN


def lost_ranks(stack: Stack, which: Indices) -> tuple[str, Indices, Indices]:
    """Fill those of the postures `which` that have certainly lost rank.

    Returns
    -------
    state : str
        State of those that are filled.
    filled, unbalanced : ndarray of int
        Some of `which`; the latter have pose, Jacobian and energy only.
    """
    case, elastic, arrays = stack.taken.case, stack.elastic, stack.arrays
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


def by_chosen_tensions(stack: Stack, which: Indices) -> tuple[Indices, Indices]:
    """Fill those of the postures `which` at which bounds choose the tensions
    of many lines.

    One program has the tensions nearest to the given ones and their changes that need no
    wrench, and has the outputs once the tensions within the bounds are among its inputs.

    Returns
    -------
    filled, unbalanced : ndarray of int
        Some of `which`; of the latter only the pose is known.
    """
    case, springs = stack.taken.case, cast(LineSprings, stack.elastic.springs)
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
        Outputs by name.
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
        """`xarray.Dataset` with labels: q, state, and every output;
        matrices by their letters. Attributes say mechanism, frames, units and load.

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
            "stiffness": ("wrench", "motion"),
            "compliance": ("motion", "wrench"),
        }
        shown = dict[str, str]()
        arrays: dict[str, tuple[tuple[str, ...], Array]] = {
            "q": (("posture", "coordinate"), self.q),
            "state": (("posture",), np.array(self.codes)[self.state]),
        }
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
            shown[name] = short.get(kind, name)
            arrays[shown[name]] = ("posture", *axes.get(kind, own)), array
        labels = {**COMPONENTS, "posture": range(len(self)), "coordinate": self.names}
        dataset = with_labels(arrays, labels, path=self.path, **self.about)
        for name, own_name in shown.items():
            dataset[own_name].attrs.update(self.units.get(name, {}))
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
        names = [
            name
            for name, array in self.arrays.items()
            if name.startswith(("stiffness", "compliance")) and array.ndim == 3
        ]
        if not names:
            raise InputError(
                "no matrices are among the outputs",
                expected='outputs=["K"]',
                got=", ".join(self.arrays),
            )
        short = [
            f"{name[0].upper().replace('S', 'K')}_{name.partition('_')[2]}"
            for name in names
        ]
        return self.to_xarray()[short].to_dataframe(("posture", "wrench", "motion"))

    def counts(self) -> dict[str, int]:
        """Number of postures in each state that occurs."""
        counts = Counter(self.state.tolist())
        return {code: counts[i] for i, code in enumerate(self.codes) if counts[i]}


@checked
def analyse_many(
    elastic: ElasticMechanism,
    q: ArrayLike,
    *,
    wrench: ArrayLike | None = None,
    load_kind: Literal["dead", "follower", "conservative"] = "dead",
    load_at: ArrayLike = DEAD_AT_ORIGIN.at,
    load_axes: Literal["body", "world"] = "body",
    outputs: Sequence[str] = ("stiffness_B",),
    out: Mapping[str, Array] | None = None,
    threads: int | None = None,
    path: Backend = "auto",
    chunk: int | None = None,
    one_by_one: int | None = None,
) -> Postures:
    r"""Stiffness of a mechanism at many postures: `cartstiff.analyse` for stacks.

    Parameters
    ----------
    elastic : ElasticMechanism
        Mechanism and potentials, from `cartstiff.load`.
    q : array_like (N, n)
        Coordinates in rad and length units, one posture a row.
    wrench : array_like (6,) or (N, 6), optional
        (moment, force) on the body at `load_at`, for all postures or for each; as in
        `analyse`, the rest positions are then chosen at every posture.
    load_kind, load_at, load_axes
        Behaviour of the load while the body moves, its point of application and its axes,
        as in `analyse`.
    outputs : sequence of str
        Any of "pose" (N, 4, 4), "jacobian" (N, 6, n), "wrench" (N, 6), "energy" (N,),
        "stiffness_X" and "compliance_X" (N, 6, 6) for X one of A, B, K, F and load, the
        tangent under the load; "X" alone is short for "stiffness_X"; "tensions" (N, m) of
        a platform's legs. Only what they need is computed.
    out : mapping of str to ndarray, optional
        Arrays of doubles to write outputs into. Reusing memory saves its allocation,
        which takes longer than the computation.
    threads : int, optional
        Threads of the compiled path; default: as many as there are processors. The others
        use one. The result does not depend on it.
    path : {"auto", "compiled", "portable", "engine"}
        Machine code made by llvmlite; NumPy; one `analyse` after the other. "auto" takes
        the first that is possible.
    chunk : int, optional
        Postures computed at a time. The result does not depend on it.
    one_by_one : int, optional
        Largest number of postures, spread evenly over those that the fast paths cannot
        decide, that `analyse` computes; the others have NaN and the state "undecided".
        Default: all.

    Returns
    -------
    Postures
        Arrays, the state of every posture, and the path that computed them.

    Raises
    ------
    InputError
        For wrong shapes, numbers that are not finite, unknown outputs, or a path that
        does not serve this mechanism. A posture in which something does not exist is no
        error: it has its state, and NaN.
    MissingDependencyError
        If `path` is "compiled" and llvmlite is not installed.
    """
    # Everything is checked, and room is made, before anything is computed.
    coordinates = checked_q(checked_elastic(elastic), q)
    coordinates = elastic.mechanism.closed_as_given(coordinates)
    loads = checked_wrench(elastic, wrench, len(coordinates))
    names = checked_names(outputs)
    count = checked_count("threads", threads) or os.cpu_count() or 1
    if path not in BACKENDS:
        raise UnknownNameError("path", str(path), BACKENDS)
    size = checked_count("chunk", chunk)
    if one_by_one is not None and one_by_one < 0:
        raise InputError(
            "count cannot be used",
            where="one_by_one",
            expected="0 or more",
            got=one_by_one,
        )
    given = q if isinstance(q, np.ndarray) else coordinates
    legs = len(getattr(elastic.mechanism, "anchors", ()))
    arrays = arrays_for(
        names, out, (*coordinates.shape, legs), {"q": given, "wrench": loads}
    )
    state = np.zeros(len(coordinates), np.uint8)

    kind = checked_load(
        load_kind, load_at, load_axes, loads is not None, elastic.may_be_loaded
    )
    codes = [REGULAR]
    taken, kernel, reason = chosen(
        elastic, loads, names, path, len(coordinates), kind, load_axes
    )
    if _is_moved(elastic, loads):
        coordinates = coordinates.copy()
    found = Postures(
        coordinates,
        arrays,
        state,
        tuple(codes),
        "engine",
        reason,
        elastic.names,
        len(state),
        described(elastic, None if loads is None else kind, load_axes),
        units_of(elastic.units),
    )
    # Nothing is recorded: the core decides every posture.
    if taken is None:
        everything = np.arange(len(state))
        _by_reference(
            elastic, coordinates, loads, arrays, everything, state, codes, kind, load_axes
        )
        return replace(found, codes=tuple(codes))
    # One pass over all postures; mostly that is all.
    run(taken, kernel, coordinates, loads, arrays, state, count, size)
    if taken.regular != REGULAR:
        _clear_still_halves(elastic, arrays, slice(None))
    ran: str = "portable" if isinstance(kernel, PortableKernel) else "compiled"
    if not state.any():
        state[:] = _index(codes, taken.regular)
        return replace(found, codes=tuple(codes), path=ran, fallback=0)
    # Postures in doubt: lost ranks and chosen tensions have programs of their own.
    doubtful = np.flatnonzero(state == FALLBACK)
    lost_state, lost_rank = "", doubtful[:0]
    compiled = ran == "compiled"
    stack = Stack(elastic, taken, coordinates, loads, arrays, compiled, count, size)
    if len(doubtful) >= WORTH_RECORDING:
        lost_state, lost_rank, torn = lost_ranks(stack, doubtful)
        state[torn] = UNBALANCED
        _clear_still_halves(elastic, arrays, lost_rank)
        doubtful = np.setdiff1d(doubtful, np.concatenate([lost_rank, torn]))
    if len(doubtful):
        filled, torn = by_chosen_tensions(stack, doubtful)
        state[torn] = UNBALANCED
        doubtful = np.setdiff1d(doubtful, np.concatenate([filled, torn]))
    # States by their codes; without balance what depends on the load does not exist.
    unbalanced = np.flatnonzero(state == UNBALANCED)
    state[:] = _index(codes, taken.regular)
    if len(lost_rank):
        state[lost_rank] = _index(codes, lost_state)
    if len(unbalanced):
        state[unbalanced] = _index(codes, "unbalanced")
        unknown: tuple[str, ...] = ("wrench", "stiffness", "compliance", TENSIONS)
        if (
            taken.untraced.struts is not None
        ):  # without equilibrium there is no energy either
            unknown += ("energy", "jacobian")
        for name in names:
            if name.startswith(unknown):
                arrays[name][unbalanced] = np.nan
    # The core decides the rest, or a sample of it.
    if one_by_one is not None and len(doubtful) > one_by_one:
        left = np.ones(len(doubtful), bool)
        left[np.linspace(0, len(doubtful) - 1, one_by_one).astype(int)] = False
        state[doubtful[left]] = _index(codes, UNDECIDED)
        for array in arrays.values():
            array[doubtful[left]] = np.nan
        doubtful = doubtful[~left]
    _by_reference(
        elastic, coordinates, loads, arrays, doubtful, state, codes, kind, load_axes
    )
    return replace(found, codes=tuple(codes), path=ran, fallback=len(doubtful))


def _clear_still_halves(
    elastic: ElasticMechanism,
    arrays: Mapping[str, Array],
    which: NDArray[np.intp] | slice,
) -> None:
    """Set round-off to zero in the compliances of postures with a rank below six."""
    length = elastic.mechanism.at(elastic.q).length
    for name, array in arrays.items():
        if name.startswith("compliance"):
            some = array[which]
            numerics.clear_still_halves(some, length)
            array[which] = some


def _is_moved(elastic: ElasticMechanism, loads: Array | None) -> bool:
    """Whether coordinates are changed: by closing the chain,
    or by deflection of links.
    """
    bends = loads is not None and bool(settled_coordinates(elastic).size)
    return bends or bool(elastic.mechanism.closures)


def _by_reference(
    elastic: ElasticMechanism,
    q: Array,
    loads: Array | None,
    arrays: Mapping[str, Array],
    which: NDArray[np.intp],
    state: NDArray[np.uint8],
    codes: list[str],
    kind: LoadKind,
    axes: Axes,
) -> None:
    """Fill some postures one by one.

    Also writes the coordinates of assembled chains into `q`.
    """
    is_moved = _is_moved(elastic, loads)
    with numerics.one_thread():
        for i in which.tolist():
            load = loads if loads is None or loads.ndim == 1 else loads[i]
            rows = {name: array[i : i + 1] for name, array in arrays.items()}
            code, closed = fill(elastic, q[i], load, rows, kind, axes)
            if is_moved:
                q[i] = closed
            state[i] = _index(codes, code)


def _index(codes: list[str], code: str) -> int:
    if code not in codes:
        codes.append(code)
    return codes.index(code)


def tensions_of_many(
    elastic: ElasticMechanism,
    q: Array,
    wrench: Array | None,
    kind: LoadKind,
    axes: Axes,
) -> Array:
    """Tensions (N, m) of a platform's legs at postures q (N, 6) under a wrench (6,),
    if any.

    NaN where no tensions balance the load, and for mechanisms without legs.
    """
    load: dict[str, Any] = {}
    if wrench is not None:
        load = {"load_kind": kind.kind, "load_at": kind.at, "load_axes": axes}
    springs = elastic.springs
    is_recorded = (
        springs is not None and springs.attachments() and not springs.gives_aside
    )
    path: Backend = "auto" if is_recorded else "engine"
    found = analyse_many(
        elastic, q, wrench=wrench, outputs=(TENSIONS,), path=path, threads=1, **load
    )
    return found.arrays[TENSIONS]


class Values(NamedTuple):
    """Quantities of many postures, from `Reader.read`.

    Attributes
    ----------
    values : dict of str to ndarray (N,)
        Numbers by name.
    poses : ndarray (N, 4, 4)
        ``T_F_M``.
    q : ndarray (N, n)
        Coordinates, those of compliant links as deflected by the load.
    is_known : ndarray of bool (N,)
        Postures with valid numbers; all others need `analyse_many`.
    """

    values: dict[str, Array]
    poses: Array
    q: Array
    is_known: NDArray[np.bool_]


def readable(
    elastic: ElasticMechanism, names: Sequence[str], wrench: Array | None
) -> tuple[str, ...]:
    """Names of the quantities that can be recorded for a mechanism under a load."""
    taken = plan(elastic, given_as(wrench))
    return () if isinstance(taken, str) else recordable(elastic, taken.case, names)


class Reader:
    """Computes quantities of many postures of a mechanism under one load,
    without their matrices.

    Parameters
    ----------
    elastic : ElasticMechanism
        The mechanism.
    readings : Readings
        The quantities, with the kind of the load and its point.
    outputs : tuple of str
        Outputs of `analyse_many` whose verdicts count.
    wrench : ndarray (6,), optional
        Load on the body.
    axes : {"body", "world"}
        Axes of its components.
    path : {"auto", "portable"}
        Machine code, if it can be made; or NumPy, which is slower than reading from
        arrays and serves for comparison.

    Attributes
    ----------
    state : str
        State of the postures with valid numbers.
    """

    def __init__(
        self,
        elastic: ElasticMechanism,
        readings: Readings,
        outputs: tuple[str, ...],
        wrench: Array | None = None,
        axes: Axes = "body",
        path: Backend = "auto",
    ) -> None:
        self.elastic, self.readings = elastic, readings
        self._wrench = wrench
        self._plan = plan(elastic, given_as(wrench))
        self._outputs = tuple(
            name for name in EVERY_OUTPUT if name in outputs or name == "pose"
        )
        self._kernel: Any = None
        self.state = ""
        if isinstance(self._plan, TracedModel):
            self._plan = self._plan.under(readings.settings.load, axes)
            self.state, case = self._plan.regular, self._plan.case
            if not FREQUENCIES.isdisjoint(readings.names):
                case = with_masses(elastic, case) or case
            self._kernel = reading_kernel(case, self._outputs, readings, path)

    @property
    def serves(self) -> bool:
        """Whether these quantities of this mechanism can be read."""
        return self._kernel is not None

    def read(self, q: Array) -> Values:
        """Quantities at postures q (N, n)."""
        if not isinstance(self._plan, TracedModel):
            raise TypeError(self._plan)
        count = len(q)
        q = q.copy() if self._plan.is_closed or self._plan.settles else q
        arrays = {
            "readings": aligned_empty(
                count, len(self._kernel.program.outputs["readings"])
            ),
            "pose": aligned_empty(count, 4, 4),
        }
        verdicts = np.zeros(count, np.uint8)
        run(self._plan, self._kernel, q, self._wrench, arrays, verdicts, 1, None)
        values = dict(zip(self.readings.names, arrays["readings"].T, strict=True))
        return Values(values, arrays["pose"], q, verdicts == 0)
