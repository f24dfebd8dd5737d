"""Arguments of `analyse_many`: checks, and the arrays to fill."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from math import prod

import numpy as np
from numpy.lib.array_utils import byte_bounds
from numpy.typing import ArrayLike

from cartstiff.core.arrays import Array, checked_input, overlap
from cartstiff.core.errors import InputError, UnknownNameError
from cartstiff.core.matrix_names import OF_MANY
from cartstiff.core.mechanisms.elastic import ElasticMechanism
from cartstiff.recorded.tape import Arrays

#: Doubles in a line of the cache, and in a mebibyte.
_LINE, _MEBIBYTE = 8, 1 << 17
#: Names of outputs of every mechanism.
OUTPUTS = (
    "pose",
    "jacobian",
    "wrench",
    "energy",
    *(f"stiffness_{c}" for c in OF_MANY),
    *(f"compliance_{c}" for c in OF_MANY),
)
#: Output for the legs of a platform.
TENSIONS = "tensions"
#: Output for joints: what their drives exert, zero without a spring.
TORQUES = "torques"
EVERY_OUTPUT = (*OUTPUTS, TENSIONS, TORQUES)
#: What programs alone have: bounds on what notes remark on (`algebra.noteworthy`), the
#: inverse of the symmetric part of the tangent under the load, the characteristic length
#: of a chain, and lengths and lines of a platform's legs.
DETAILS = NOTEWORTHY, SYMMETRIC, LENGTH, LEGS, LINES = (
    "noteworthy",
    "inverse_of_symmetric_tangent",
    "length",
    "leg_lengths",
    "actuation",
)
#: Of a mechanism with masses: mass matrix and Lagrangian Hessian on the motions, and
#: their twists; they determine small vibrations.
OF_VIBRATIONS = "kinetic", "lagrangian", "motion"
#: Output of closed chains, beside these: rates of the coordinates in the motions that
#: keep the closures, as many columns as there are.
MOTIONS = "motions"


def checked_q(elastic: ElasticMechanism, q: ArrayLike) -> Array:
    """Coordinates as a finite (N, n) array of doubles."""
    return checked_input(q, ("N", len(elastic.mechanism.coordinates)), "q")


def checked_wrench(
    elastic: ElasticMechanism, wrench: ArrayLike | None, count: int
) -> Array | None:
    """One wrench (6,), or one for each posture (N, 6)."""
    if wrench is None:
        return None
    array = checked_input(wrench, [(6,), (count, 6)], "wrench")
    if elastic.springs is None:
        raise InputError(
            "the load of this mechanism follows from its potentials and cannot be given",
            expected="no wrench here",
        )
    return array


def full_name(name: str) -> str:
    """The name of an output: "K" is short for "stiffness_K"."""
    return f"stiffness_{name}" if name in OF_MANY else name


def checked_names(outputs: Sequence[str]) -> tuple[str, ...]:
    """Names of outputs, each once."""
    if isinstance(outputs, str):
        raise InputError(
            "outputs is one word", expected="a sequence of names", got=outputs
        )
    names = tuple(dict.fromkeys(full_name(name) for name in outputs))
    for name in names:
        if name not in EVERY_OUTPUT:
            raise UnknownNameError("output", str(name), OUTPUTS)
    return names


def checked_count(what: str, value: object, least: int = 1) -> int | None:
    """A whole number from `least`, or None."""
    if value is None:
        return None
    is_flag = isinstance(value, bool)
    if is_flag or not isinstance(value, (int, np.integer)) or value < least:
        raise InputError(
            f"{what} cannot be used", expected=f"a whole number from {least}", got=value
        )
    return int(value)


def shapes_of(elastic: ElasticMechanism) -> dict[str, tuple[int, ...]]:
    """Shape of each output at one posture; without legs there is no tension."""
    n = len(elastic.mechanism.coordinates)
    legs = len(getattr(elastic.mechanism, "anchors", ()))
    return {
        **dict.fromkeys((*OUTPUTS, SYMMETRIC), (6, 6)),
        "pose": (4, 4),
        "jacobian": (6, n),
        "wrench": (6,),
        "energy": (),
        TENSIONS: (legs,),
        TORQUES: (n,),
        NOTEWORTHY: (5,),
        LENGTH: (1,),
        LEGS: (legs,),
        LINES: (legs, 6),
    }


def arrays_for(
    elastic: ElasticMechanism,
    names: tuple[str, ...],
    out: Arrays | None,
    count: int,
    inputs: Mapping[str, Array | None],
) -> dict[str, Array]:
    """The arrays to fill: those given in `out`, which must not share memory,
    and new ones.
    """
    own = {full_name(name): array for name, array in (out or {}).items()}
    shapes = {name: (count, *shape) for name, shape in shapes_of(elastic).items()}
    for name, array in own.items():
        if name not in names:
            raise UnknownNameError("output", str(name), names, where="out")
        _check_writable(name, array, shapes[name])
    _check_apart(own, inputs)
    return {n: own[n] if n in own else aligned_empty(*shapes[n]) for n in names}


def _check_writable(name: str, array: object, shape: tuple[int, ...]) -> None:
    got = type(array).__name__
    if isinstance(array, np.ndarray):
        is_open = array.flags.writeable
        if array.shape == shape and array.dtype == np.float64 and is_open:
            return
        got = f"shape {array.shape}, {array.dtype}" + ", read-only" * (not is_open)
    raise InputError(
        "array to write into cannot be used",
        where=f"out, {name}",
        expected=f"a writeable array of doubles of shape {shape}",
        got=got,
    )


def _check_apart(own: Arrays, inputs: Mapping[str, Array | None]) -> None:
    """Refuse arrays to write into that share memory with each other or with inputs."""
    others = [(name, values) for name, values in inputs.items() if values is not None]
    bounds = sorted(byte_bounds(array) for _, array in (*others, *own.items()))
    if all(end <= start for (_, end), (start, _) in pairwise(bounds)):
        return  # the usual case, decided quickly
    for name, array in own.items():
        for other, values in others:
            if overlap(array, values):
                raise InputError(
                    "array to write into shares memory",
                    where=f"out, {name}",
                    expected="its own",
                    got=f"that of {other}",
                )
        others.append((name, array))


def address_of(array: Array) -> int:
    """Address of an array; much faster than ``array.ctypes.data``."""
    address: int = array.__array_interface__["data"][0]
    return address


def aligned_empty(*shape: int) -> Array:
    """Uninitialised doubles, aligned to 64 bytes, so that whole cache lines are written.

    Arrays of a mebibyte and more are aligned to two, for large pages of memory: small
    ones cost a tenth of the time of writing. NumPy requests large pages for four
    mebibytes and more.
    """
    size, step = prod(shape), _LINE
    room = size
    if size >= _MEBIBYTE:
        step, room = 2 * _MEBIBYTE, max(size, 4 * _MEBIBYTE)
    raw = np.empty(room + step)
    start = -(address_of(raw) // 8) % step
    return raw[start : start + size].reshape(shape)
