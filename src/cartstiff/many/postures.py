r"""Many postures at once: postures in, arrays out.

Chains, open and closed, with lines between their bodies, and platforms on line springs are computed
by arithmetic written once (`chains`, `platform_arithmetic`), as machine code made for the mechanism
(`compiled`) or over NumPy arrays (`portable`). Every other mechanism, and every posture that is not
well inside the regular ones, is computed by `cartstiff.analyse` itself, which also names its state.
"""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cartstiff import numerics
from cartstiff.checked_call import checked
from cartstiff.errors import InputError, UnknownNameError
from cartstiff.geometry.se3 import Array
from cartstiff.many.arguments import (
    OUTPUTS as OUTPUTS,
)
from cartstiff.many.arguments import (
    arrays_for,
    checked_count,
    checked_names,
    checked_q,
    checked_wrench,
    full_name,
    recorded,
    with_room,
)
from cartstiff.many.arithmetic import ENGINE, UNBALANCED
from cartstiff.many.kernels import ASKED, BACKENDS, WORTH_RECORDING, Backend, bent, chosen, run
from cartstiff.many.one_by_one import REGULAR, fill
from cartstiff.many.portable import PortableKernel
from cartstiff.many.singular import lost_ranks
from cartstiff.many.work import BY_ENGINE, timed
from cartstiff.mechanisms.chain import Chain
from cartstiff.mechanisms.elastic import ElasticMechanism, checked_elastic
from cartstiff.stiffness.applied_load import DEAD_AT_ORIGIN, LoadKind, checked_load, wrench_in_body
from cartstiff.stiffness.settled_links import settled_coordinates
from cartstiff.stiffness.tensor import COMPONENTS, with_labels

_HERE = np.eye(4)[None]
#: State of postures that nobody has looked at one by one.
UNDECIDED = "undecided"


@dataclass(frozen=True, eq=False)
class Postures:
    """Arrays over postures; NaN where a quantity does not exist.

    Attributes
    ----------
    q : ndarray (N, n)
        Coordinates; those of a closed chain as assembled, of links that give as a load bends them.
    arrays : dict of str to ndarray, shape (N, ...)
        What was asked for, by name.
    state : ndarray of uint8 (N,)
        Index into `codes` of each posture's state.
    codes : tuple of str
        ``codes[0]`` is "regular"; the others are codes of notes, see the reference, and
        "not-assembled" for closures that cannot be met.
    path : {"compiled", "portable", "engine"}
        What computed the regular postures.
    reason : str
        Why nothing faster did; empty if nothing is.
    names : tuple of str
        Names of the coordinates.
    by_engine : int
        How many postures `cartstiff.analyse` has computed one by one: all of them where nothing
        faster serves, else those that are not plainly regular.
    """

    q: Array
    arrays: dict[str, Array]
    state: NDArray[np.uint8]
    codes: tuple[str, ...]
    path: str
    reason: str = ""
    names: tuple[str, ...] = ()
    by_engine: int = 0

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
        if 0 < self.by_engine < len(self):
            path += f", {self.by_engine} by the engine"
        return f"{len(self)} postures ({path}): {states}\n  {shapes}"

    @property
    def is_regular(self) -> NDArray[np.bool_]:
        """Which postures are regular (N,)."""
        return self.state == 0

    def to_xarray(self) -> Any:
        """`xarray.Dataset` with labels: q, state, and every output; matrices by their letters.

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
            "stiffness": ("wrench", "motion"),
            "compliance": ("motion", "wrench"),
        }
        arrays: dict[str, tuple[tuple[str, ...], Array]] = {
            "q": (("posture", "coordinate"), self.q),
            "state": (("posture",), np.array(self.codes)[self.state]),
        }
        for name, array in self.arrays.items():
            kind, _, letter = name.partition("_")
            # "wrench" names an axis, so that the array of wrenches needs another name.
            short = {"stiffness": f"K_{letter}", "compliance": f"C_{letter}", "wrench": "W"}
            arrays[short.get(kind, name)] = ("posture", *axes[kind]), array
        labels = {**COMPONENTS, "posture": range(len(self)), "coordinate": self.names}
        return with_labels(arrays, labels, path=self.path)

    def to_pandas(self) -> Any:
        """`pandas.DataFrame` of the 6x6 matrices: a row an entry, a column a matrix.

        Its index is posture, wrench component, motion component; ``unstack`` turns components
        into columns. Everything else is in `to_xarray`.

        Raises
        ------
        InputError
            If no matrix was asked for.
        MissingDependencyError
            Without xarray.
        """
        names = [name for name in self.arrays if name.startswith(("stiffness", "compliance"))]
        if not names:
            raise InputError(
                "no matrices are among the outputs",
                expected='outputs=["K"]',
                got=", ".join(self.arrays),
            )
        short = [f"{name[0].upper().replace('S', 'K')}_{name.partition('_')[2]}" for name in names]
        return self.to_xarray()[short].to_dataframe(("posture", "wrench", "motion"))

    def counts(self) -> dict[str, int]:
        """How many postures are in each state that occurs."""
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
        (moment, force) on the body at `load_at`, for all postures or for each; as in `analyse`, the
        rest positions are then chosen at every posture.
    load_kind, load_at, load_axes
        What the load does while the body moves, where it acts, and along whose axes it is given: as
        in `analyse`.
    outputs : sequence of str
        Any of "pose" (N, 4, 4), "jacobian" (N, 6, n), "wrench" (N, 6), "energy" (N,),
        "stiffness_X" and "compliance_X" (N, 6, 6) for X one of A, B, K, F and load, the tangent
        under the load; "X" alone is short for "stiffness_X". Only what they need is computed.
    out : mapping of str to ndarray, optional
        Arrays of doubles to write outputs into. Memory that is used again saves the system's
        work of providing it, which costs more than the computation.
    threads : int, optional
        Threads of the compiled path; default: as many as there are processors. The others use one.
        The result does not depend on it.
    path : {"auto", "compiled", "portable", "engine"}
        Machine code made by llvmlite; NumPy; one `analyse` after the other. "auto" takes the first
        that serves.
    chunk : int, optional
        Postures computed at a time. The result does not depend on it.

    one_by_one : int, optional
        Of the postures that the fast paths cannot decide, spread evenly over them, so many at the
        most go to `analyse`; the others have NaN and the state "undecided". Default: all go.

    Returns
    -------
    Postures
        Arrays, the state of every posture, and what computed them.

    Raises
    ------
    InputError
        For wrong shapes, numbers that are not finite, unknown outputs, or a path that does not
        serve this mechanism. A posture in which something does not exist is no error: it has its
        state, and NaN.
    MissingDependencyError
        If `path` is "compiled" and llvmlite is not installed.
    """
    coordinates = checked_q(checked_elastic(elastic), q)
    if isinstance(elastic.mechanism, Chain):
        coordinates = elastic.mechanism.closed_as_given(coordinates)
    loads = checked_wrench(elastic, wrench, len(coordinates))
    names = checked_names(outputs)
    count = checked_count("threads", threads) or os.cpu_count() or 1
    if path not in BACKENDS:
        raise UnknownNameError("path", str(path), BACKENDS)
    size = checked_count("chunk", chunk)
    if one_by_one is not None and one_by_one < 0:
        raise InputError(
            "count cannot be used", where="one_by_one", expected="0 or more", got=one_by_one
        )
    given = q if isinstance(q, np.ndarray) else coordinates
    arrays = arrays_for(names, out, coordinates.shape, {"q": given, "wrench": loads})
    state = np.zeros(len(coordinates), np.uint8)

    kind = checked_load(load_kind, load_at, load_axes, loads is not None, elastic.may_be_loaded)
    each = loads
    if loads is not None and loads.ndim == 1 and load_axes == "world":
        each = np.broadcast_to(loads, (len(coordinates), 6))
    codes = [REGULAR]
    known = recorded(names)
    taken, kernel, reason = chosen(elastic, each, known, path, len(coordinates))
    if _is_moved(elastic, loads):
        coordinates = coordinates.copy()
    if taken is None:
        everything = np.arange(len(state))
        _by_engine(
            elastic, coordinates, loads, arrays, everything, state, codes, kind, load_axes, reason
        )
        return Postures(
            coordinates, arrays, state, tuple(codes), "engine", reason, elastic.names, len(state)
        )
    if each is not None:
        each = loads_in_body(elastic, coordinates, each, kind, load_axes, path, threads, chunk)
    by_kernel = with_room(known, arrays, coordinates.shape)
    run(taken, kernel, coordinates, each, by_kernel, state, count, size)
    if taken.regular != REGULAR:
        _clear_still_halves(elastic, by_kernel, slice(None))
    _under_load(kind, by_kernel, arrays, state)
    ran: str = "portable" if isinstance(kernel, PortableKernel) else "compiled"
    if not state.any():
        state[:] = _index(codes, taken.regular)
        return Postures(coordinates, arrays, state, tuple(codes), ran, reason, elastic.names)
    doubtful = np.flatnonzero(state == ENGINE)
    lost_state, lost_rank = "", doubtful[:0]
    if len(doubtful) >= WORTH_RECORDING:
        lost_state, lost_rank, torn = lost_ranks(
            taken, coordinates, each, by_kernel, doubtful, ran == "compiled", count, size
        )
        state[torn] = UNBALANCED
        _clear_still_halves(elastic, by_kernel, lost_rank)
        lost_rank = _under_load_again(kind, by_kernel, arrays, lost_rank)
        doubtful = np.setdiff1d(doubtful, np.concatenate([lost_rank, torn]))
    unbalanced = np.flatnonzero(state == UNBALANCED)
    state[:] = _index(codes, taken.regular)
    if len(lost_rank):
        state[lost_rank] = _index(codes, lost_state)
    if len(unbalanced):
        state[unbalanced] = _index(codes, "unbalanced")
        unknown: tuple[str, ...] = ("wrench", "stiffness", "compliance")
        if taken.beside.struts is not None:  # what is not found has no energy either
            unknown += ("energy", "jacobian")
        for name in names:
            if name.startswith(unknown):
                arrays[name][unbalanced] = np.nan
    if one_by_one is not None and len(doubtful) > one_by_one:
        left = np.ones(len(doubtful), bool)
        left[np.linspace(0, len(doubtful) - 1, one_by_one).astype(int)] = False
        state[doubtful[left]] = _index(codes, UNDECIDED)
        for array in arrays.values():
            array[doubtful[left]] = np.nan
        doubtful = doubtful[~left]
    _by_engine(elastic, coordinates, loads, arrays, doubtful, state, codes, kind, load_axes)
    return Postures(
        coordinates, arrays, state, tuple(codes), ran, reason, elastic.names, len(doubtful)
    )


def loads_in_body(
    elastic: ElasticMechanism,
    q: Array,
    loads: Array,
    kind: LoadKind,
    axes: Literal["body", "world"],
    path: Backend,
    threads: int | None = None,
    chunk: int | None = None,
) -> Array:
    """Wrenches about M's origin in the axes of M, from one (6,) or one a posture as given.

    Coordinates of links that give are replaced by those where they carry loads along the axes of F;
    where that is not found, the wrench is NaN.
    """
    if axes == "body" and not any(kind.at):
        return loads
    if axes == "world" and loads.ndim == 1:
        loads = np.broadcast_to(loads, (len(q), 6))
    if axes == "body":
        return wrench_in_body(loads, _HERE, kind.at, axes).reshape(loads.shape)
    if settled_coordinates(elastic).size:  # links that give turn M
        q[...], found = bent(elastic, q, loads, kind.at, path, threads or 1)
        return found
    posed = analyse_many(
        elastic, q, wrench=np.zeros(6), outputs=("pose",), threads=threads, path=path, chunk=chunk
    )["pose"]
    return wrench_in_body(loads, posed, kind.at, axes).reshape(loads.shape)


def _clear_still_halves(
    elastic: ElasticMechanism, arrays: Mapping[str, Array], which: NDArray[np.intp] | slice
) -> None:
    """Zeros in the compliances of postures that have no rank of six, where rounding stands."""
    length = elastic.mechanism.at(elastic.q).length
    for name, array in arrays.items():
        if name.startswith("compliance"):
            some = array[which]
            numerics.clear_still_halves(some, length)
            array[which] = some


def _under_load(
    kind: LoadKind,
    known: Mapping[str, Array],
    arrays: Mapping[str, Array],
    state: NDArray[np.uint8],
) -> None:
    """Tangents and their inverses from those of K^B; the engine decides where digits are lost."""
    if "stiffness_load" not in arrays and "compliance_load" not in arrays:
        return
    D = kind.change(known["wrench"])
    if "stiffness_load" in arrays:
        np.add(known["stiffness_B"], D, out=arrays["stiffness_load"])
    if "compliance_load" in arrays:
        C, is_plain = numerics.inverses_of_sums(known["compliance_B"], D)
        arrays["compliance_load"][...] = C
        state[~is_plain & np.isfinite(D).all(axis=(1, 2)) & (state != UNBALANCED)] = ENGINE


def _under_load_again(
    kind: LoadKind,
    known: Mapping[str, Array],
    arrays: Mapping[str, Array],
    which: NDArray[np.intp],
) -> NDArray[np.intp]:
    """`_under_load` for some postures whose `known` arrays are other ones now; those that stand."""
    state = np.zeros(len(which), np.uint8)
    some = {name: array[which] for name, array in arrays.items() if name.endswith("_load")}
    _under_load(kind, {name: array[which] for name, array in known.items()}, some, state)
    for name, array in some.items():
        arrays[name][which] = array
    return which[state != ENGINE]


def _is_moved(elastic: ElasticMechanism, loads: Array | None) -> bool:
    """Whether coordinates are changed: by closing the chain, or by links that bend."""
    bends = loads is not None and bool(settled_coordinates(elastic).size)
    return bends or bool(getattr(elastic.mechanism, "closures", ()))


def _by_engine(
    elastic: ElasticMechanism,
    q: Array,
    loads: Array | None,
    arrays: Mapping[str, Array],
    which: NDArray[np.intp],
    state: NDArray[np.uint8],
    codes: list[str],
    kind: LoadKind,
    axes: Literal["body", "world"],
    reason: str = "",
) -> None:
    """Fill some postures one by one; `q` takes the coordinates of assembled chains."""
    is_moved = _is_moved(elastic, loads)
    way = BY_ENGINE if reason in ("", ASKED) else f"{BY_ENGINE} ({reason})"
    with timed(way, len(which)), numerics.one_thread():
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
