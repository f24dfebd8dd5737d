"""Checks of numbers given by users, plain copies of results, and tables as CSV.

Values that NumPy would silently convert to doubles are refused: truth values, text, dates
(a missing one would be -9e18), complex numbers, masked numbers.
"""

from __future__ import annotations

import io
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import fields, is_dataclass
from math import isfinite
from numbers import Real
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cartstiff.core import numerics
from cartstiff.core.choices import LARGEST_INPUT
from cartstiff.core.errors import InputError, UnknownNameError, one_line, printable

#: Any NumPy array; the stubs cannot follow dtypes through linear algebra.
Array = NDArray[Any]
Shape = tuple[int | str, ...]

_DOUBLE = np.dtype(float)
# Pinocchio's order is linear, angular.
_SWAP = (3, 4, 5, 0, 1, 2)
# Largest size of an array for which Python's test is several times as fast as NumPy's.
_FEW = 64
# Numbers tested at a time: a mask of the whole array would take an eighth of its memory.
_PIECE = 1 << 19
_NO_NUMBERS = (bool, np.bool_, np.datetime64, np.timedelta64)


def _is_number(value: Any) -> bool:
    from decimal import Decimal

    return isinstance(value, (Real, Decimal)) and not isinstance(value, _NO_NUMBERS)


_NAMES = {
    "b": "true or false",
    "c": "complex numbers",
    "m": "durations",
    "M": "dates",
    "S": "text",
    "U": "text",
    "T": "text",
    "V": "records",
}


def read_only(values: ArrayLike) -> Array:
    """Read-only copy of an array, for results."""
    array = np.array(values, float)
    array.flags.writeable = False
    return array


def fixed(array: Array) -> Array:
    """Read-only view of an array."""
    if not array.flags.writeable:
        return array
    view = array.view()
    view.flags.writeable = False
    return view


class Result:
    """Base of frozen dataclasses with read-only arrays of their own."""

    def __post_init__(self) -> None:
        """Copy the arrays."""
        for name, value in vars(self).items():
            if isinstance(value, np.ndarray):
                if value.flags.owndata and not value.flags.writeable:
                    continue  # read-only already
                own = fixed(value.copy()) if value.dtype.kind == "c" else read_only(value)
                object.__setattr__(self, name, own)


class NamedArrays(Mapping[str, Array | None]):
    """Read-only arrays by name, so that shown, saved and computed numbers agree.

    Arrays in `also` can be read but are not listed.
    """

    def __init__(
        self,
        arrays: Mapping[str, Array | None],
        also: Mapping[str, Array | None] = MappingProxyType({}),
    ) -> None:
        self._arrays = {n: None if a is None else fixed(a) for n, a in arrays.items()}
        self._also = {n: None if a is None else fixed(a) for n, a in also.items()}

    @classmethod
    def of_fixed(
        cls, arrays: dict[str, Array | None], also: dict[str, Any]
    ) -> NamedArrays:
        """From read-only arrays and mappings that do not change: neither is copied."""
        own = cls.__new__(cls)
        own._arrays, own._also = arrays, also
        return own

    def __getitem__(self, name: str) -> Array | None:
        if name not in self._arrays and name in self._also:
            return self._also[name]
        return self._arrays[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._arrays)

    def __len__(self) -> int:
        return len(self._arrays)

    def __repr__(self) -> str:
        lines = [f"  {name}: {_in_words(a)}" for name, a in self._arrays.items()]
        return "\n".join(["Arrays by name, in brackets:", *lines])


def _in_words(array: Array | None) -> str:
    """Shape and size of an array that may be missing."""
    if array is None:
        return "none"
    return f"array {array.shape}, largest entry {numerics.largest(array):.6g}"


def of_pinocchio(value: Any) -> Any:
    """Numbers of Pinocchio's objects in our order; any other value unchanged.

    `Force` and `Motion` become (angular, linear), `SE3` the matrix (4, 4), `Inertia` the
    matrix (6, 6) in the order (angular, linear); sequences of them become stacks.

    Raises
    ------
    InputError
        For another object of Pinocchio.
    """
    if isinstance(value, (list, tuple)):
        if not any(type(v).__module__.startswith("pinocchio") for v in value):
            return value
        return [of_pinocchio(v) for v in value]
    kind = next(
        (c for c in type(value).__mro__ if c.__module__.startswith("pinocchio")), None
    )
    if kind is None:
        return value
    if kind.__name__ in ("Force", "Motion"):
        return np.concatenate([value.angular, value.linear])
    if kind.__name__ == "SE3":
        return np.array(value.homogeneous)
    if kind.__name__ == "Inertia":
        return np.array(value.matrix())[np.ix_(_SWAP, _SWAP)]
    if kind.__name__.startswith("StdVec_"):
        return [of_pinocchio(v) for v in value]
    raise InputError(
        f"Pinocchio's {kind.__name__} holds no numbers that can be used here",
        expected="Force, Motion, SE3, Inertia, or numbers",
    )


def real_array(
    values: ArrayLike,
    what: str = "array",
    *,
    where: str | None = None,
    expected: Sequence[Shape] = (),
) -> Array:
    """Doubles of any shape; an array of doubles itself is returned.

    Parameters
    ----------
    values : array_like
        Real numbers, or Pinocchio's objects (see `of_pinocchio`).
    what, where : str
        Name of the value and its place, for the message.
    expected : sequence of tuple
        Shapes, for the message.

    Raises
    ------
    InputError
        For anything else than real numbers: truth values, text, dates, complex or masked
        numbers.
    """
    if type(values) is np.ndarray and values.dtype is _DOUBLE:
        return values
    values = of_pinocchio(values)

    def refused(reason: str, got: object) -> InputError:
        return InputError(
            f"{what} {reason}", where=where, expected=_words(expected), got=got
        )

    # Test for plain arrays first: the name np.ma imports a module.
    is_other = isinstance(values, np.ndarray) and type(values) is not np.ndarray
    if is_other and isinstance(values, np.ma.MaskedArray):
        if np.ma.is_masked(values):
            raise refused(
                "holds masked numbers", f"{int(np.ma.getmaskarray(values).sum())} masked"
            )
        values = values.data
    try:
        array = np.asarray(values)
        kind = array.dtype.kind
        if kind == "O" and all(map(_is_number, array.flat)):
            return np.array([float(v) for v in array.flat], float).reshape(array.shape)
    except (TypeError, ValueError, OverflowError):
        raise refused("is not numeric", values) from None
    if isinstance(values, (list, tuple)) and _holds_truth(values):
        kind = "b"
    if kind == "f" or kind in "iu":
        # Numbers beyond the range of doubles become infinity.
        with np.errstate(over="ignore", invalid="ignore"):
            return np.asarray(array, float)
    raise refused("is not numeric", values if kind == "O" else _NAMES.get(kind, kind))


def _holds_truth(values: Sequence[Any]) -> bool:
    """Whether a nested sequence contains True or False, which NumPy would
    convert to 1 and 0.
    """
    for value in values:
        kind = type(value)
        if kind is float or kind is int:
            continue
        if kind is list or kind is tuple:
            if _holds_truth(value):
                return True
        elif kind is bool or getattr(getattr(value, "dtype", None), "kind", "") == "b":
            return True
    return False


def _is_finite(array: Array) -> bool:
    if array.size <= _FEW:
        values = array.ravel().tolist()
        return isfinite(sum(values)) or all(map(isfinite, values))
    if array.size <= _PIECE or not array.flags.c_contiguous:
        return bool(np.isfinite(array).all())
    flat = array.reshape(-1)
    return all(
        bool(np.isfinite(flat[i : i + _PIECE]).all()) for i in range(0, len(flat), _PIECE)
    )


def _words(shapes: Sequence[Shape]) -> str:
    if not shapes:
        return "real numbers"
    if len(shapes) == 1 and len(shape := shapes[0]) < 2:
        n = shape[0] if shape else 1
        many = f"{n} numbers" if isinstance(n, int) else "one or more numbers"
        return "one number" if n == 1 else many
    each = [
        "(" + ", ".join(map(str, s)) + ("," if len(s) == 1 else "") + ")" for s in shapes
    ]
    return "shape " + " or ".join(each)


def checked_array(
    values: ArrayLike,
    shape: Shape | list[Shape] | None,
    what: str,
    *,
    where: str | None = None,
    copy: bool = True,
    finite: bool = True,
) -> Array:
    """Finite doubles of the expected shape; any other input is refused in one line.

    Parameters
    ----------
    values : array_like
        Real numbers.
    shape : tuple of int or str, list of tuples, or None
        Expected shape, or several of which one must fit; a name is any length from one on
        ("N" from zero on). None: any shape.
    what, where : str
        Name of the value and its place, for the message.
    copy : bool
        Whether the result is a copy; else it may be `values` itself.
    finite : bool
        Whether NaN and infinity are refused.

    Returns
    -------
    ndarray of float64

    Raises
    ------
    InputError
        For values that are no real numbers (see `real_array`), another shape, NaN or
        infinity.
    """
    if type(values) is np.ndarray and values.dtype is _DOUBLE and values.shape == shape:
        own: Array = values
        if not finite or _is_finite(own):  # the usual case
            return own.copy() if copy else own
    shapes = shape if isinstance(shape, list) else [] if shape is None else [shape]
    array = real_array(values, what, where=where, expected=shapes)
    if copy and (array is values or not array.flags.owndata or not array.flags.writeable):
        array = array.copy()
    if (
        shapes
        and array.shape != shapes[0]
        and not any(_fits(array.shape, s) for s in shapes)
    ):
        count = len(shapes) == 1 and len(shapes[0]) == 1
        raise InputError(
            f"{what} has the wrong {'count' if count else 'shape'}",
            where=where,
            expected=_words(shapes),
            got=array.size if count and array.ndim == 1 else f"shape {array.shape}",
        )
    if finite and not _is_finite(array):
        if array.ndim > 1 and array.shape not in shapes:
            row = int(
                np.flatnonzero(~np.isfinite(array).all(axis=tuple(range(1, array.ndim))))[
                    0
                ]
            )
            raise InputError(
                f"{what} must be finite in row {row}",
                where=where,
                got=array[row].tolist(),
            )
        raise InputError(f"{what} must be finite", where=where, got=array.tolist())
    return array


def _fits(got: tuple[int, ...], shape: Shape) -> bool:
    return len(shape) == len(got) and all(
        n == m if isinstance(m, int) else n > 0 or m == "N"
        for m, n in zip(shape, got, strict=True)
    )


def checked_vector(
    values: ArrayLike, n: int, what: str, *, where: str | None = None
) -> Array:
    """Copy of a finite vector of length n; see `checked_array`."""
    return checked_array(values, (n,), what, where=where)


def checked_input(
    values: ArrayLike, shape: Shape | list[Shape] | None, what: str
) -> Array:
    """`checked_array` of coordinates, loads or stiffnesses,
    at most `LARGEST_INPUT` in size.
    """
    array = checked_array(values, shape, what)
    if array.size <= _FEW:
        is_large = max(map(abs, array.ravel().tolist()), default=0.0) > LARGEST_INPUT
    else:
        is_large = bool(array.max() > LARGEST_INPUT or array.min() < -LARGEST_INPUT)
    if is_large:
        largest = float(array.flat[int(np.abs(array).argmax())])
        raise InputError(
            f"{what} is too large",
            expected=f"numbers of at most {LARGEST_INPUT:g}",
            got=f"{largest:g}",
        )
    return array


def checked_reach(point: Array, what: str) -> None:
    """Refuse points so far from a body that rotations about them lose the digits
    of its motion.
    """
    farthest = numerics.largest(point)
    if not farthest <= numerics.FARTHEST_POINT:
        raise InputError(
            "point is too far away",
            where=what,
            expected=f"coordinates up to {numerics.FARTHEST_POINT:g}",
            got=f"{farthest:g}",
        )


def checked_matrix(values: ArrayLike, what: str = "stiffness", size: int = 6) -> Array:
    """A finite square matrix; see `checked_array`."""
    return checked_array(values, (size, size), what, copy=False)


def checked_unit(values: ArrayLike) -> Array:
    """A 3-vector scaled to length one; InputError if it is zero."""
    vector = checked_array(values, (3,), "direction", copy=False)
    largest = float(np.abs(vector).max())
    if largest == 0.0:
        raise InputError("direction must not be zero", got=vector.tolist())
    scaled = vector / largest  # squares of tiny or huge components would leave the range
    return scaled / numerics.norm(scaled)


def checked_number(value: object, what: str) -> float:
    """One finite number."""
    if type(value) is float and isfinite(value):
        return value
    return float(checked_array(value, (), what, copy=False))  # type: ignore[arg-type]


def named_values(
    numbers: float | Sequence[float] | Mapping[str, float] | ArrayLike,
    names: Sequence[str],
    default: ArrayLike,
    what: str,
    *,
    infinite: bool = False,
) -> Array:
    """Return values of named coordinates from one number, a sequence,
    or a mapping of some of them.

    With `infinite`, infinity is allowed, too.

    Raises
    ------
    UnknownNameError
        For a name that is no coordinate.
    InputError
        For a wrong count or values that are not finite numbers.
    """
    if isinstance(numbers, Mapping):
        values = np.array(np.broadcast_to(np.asarray(default, float), (len(names),)))
        for name, value in numbers.items():
            if name not in names:
                raise UnknownNameError("joint", str(name), names, where=what)
            values[names.index(name)] = _number(value, f"{what} of {name}", infinite)
        return values
    if not isinstance(numbers, (list, tuple)) and np.ndim(numbers) == 0:
        return np.full(len(names), _number(numbers, what, infinite))
    if infinite and isinstance(numbers, (Sequence, np.ndarray)):
        rigid = np.array([_is_infinite(value) for value in numbers], bool)
        known = [0.0 if r else value for r, value in zip(rigid, numbers, strict=True)]
        return np.where(rigid, np.inf, checked_input(known, (len(names),), what))
    return checked_input(numbers, (len(names),), what)


def _number(value: Any, what: str, infinite: bool) -> Any:
    return np.inf if infinite and _is_infinite(value) else checked_input(value, (), what)


def _is_infinite(value: object) -> bool:
    return isinstance(value, float) and value == np.inf


def checked_seed(value: object) -> int:
    """Seed of random numbers; NumPy would crash on a list that contains itself."""
    if (
        isinstance(value, (bool, np.bool_))
        or not isinstance(value, (int, np.integer))
        or value < 0
    ):
        raise InputError("seed cannot be used", expected="0 or more", got=one_line(value))
    return int(value)


def checked_flag(value: object, what: str) -> bool:
    """True or False: text such as "no" would count as true."""
    if not isinstance(value, (bool, np.bool_)):
        raise InputError(what, expected="True or False", got=one_line(value))
    return bool(value)


def checked_length(value: object, what: str = "length") -> float:
    """A positive number whose powers are numbers, too: 1e-30 to 1e30."""
    number = checked_number(value, what)
    if not 1.0 / LARGEST_INPUT <= number <= LARGEST_INPUT:
        expected = "a positive length"
        raise InputError(f"{what} cannot be used", expected=expected, got=number)
    return number


def is_pose(T: ArrayLike, tolerance: float = numerics.NEGLIGIBLE_DIFFERENCE) -> bool:
    """Tell whether every matrix (..., 4, 4) is a proper rigid motion up to
    `tolerance`.
    """
    T = real_array(T, "pose")
    if T.shape[-2:] != (4, 4) or not np.isfinite(T).all():
        return False
    R = T[..., :3, :3]
    with np.errstate(over="ignore", invalid="ignore"):
        off = numerics.largest(R @ np.swapaxes(R, -1, -2) - np.eye(3))
        if not off < tolerance:
            return False
    proper = bool(np.all(np.linalg.det(R) > 0))
    last = numerics.largest(T[..., 3, :] - np.array([0.0, 0.0, 0.0, 1.0])) < tolerance
    return bool(proper and last)


def checked_pose(T: ArrayLike, what: str = "pose", *, where: str | None = None) -> Array:
    """A rigid motion (4, 4), or a stack (N, 4, 4) of them where the argument
    has three axes.
    """
    T = of_pinocchio(T)
    stack = getattr(T, "ndim", 2) == 3
    array = checked_array(T, ("N", 4, 4) if stack else (4, 4), what, where=where)
    if not is_pose(array):
        each = array.reshape(-1, 4, 4)
        wrong = next(i for i, t in enumerate(each) if not is_pose(t))
        raise InputError(
            f"{what}{f' {wrong + 1}' * stack} is not a rigid motion",
            where=where,
            expected="a rotation matrix, a position, and 0, 0, 0, 1 below",
            got=each[wrong].tolist(),
        )
    return array


def overlap(a: Array, b: Array) -> bool:
    """Whether two arrays share memory; True if that is too hard to decide."""
    try:
        return bool(np.shares_memory(a, b, max_work=10_000))  # type: ignore[arg-type]
    except np.exceptions.TooHardError:
        return True


def csv_text(table: Array, names: Sequence[str]) -> str:
    """CSV of a table (N, m) of numbers with all digits, under a line of names."""
    text = io.StringIO()
    text.write(csv_line(names))
    np.savetxt(text, np.asarray(table) + 0.0, delimiter=",", fmt="%.17g")
    return text.getvalue()


def csv_rows(names: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """CSV of rows of numbers and words under a line of names.

    None becomes an empty cell.
    """
    return csv_line(names) + "".join(map(csv_line, rows))


def csv_line(cells: Iterable[object]) -> str:
    """A line of CSV, with its line end."""
    import csv

    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerow([_cell(cell) for cell in cells])
    return text.getvalue()


def _cell(value: object) -> str:
    """Text of a cell, without the sign of a zero."""
    if value is None:
        return ""
    if isinstance(value, str):
        return safe_cell(value)
    return str(value + 0.0 if isinstance(value, float) else value)


# Beginning of a cell that a spreadsheet would run as a formula, and that is no plain
# number. A spreadsheet may separate cells by semicolons.
_NUMBER = r"[\d.]+(?:[eE][+-]?\d+)?\)?(?:[\s,;]|$)"
_FORMULA = re.compile(rf"(^|[,;])(\s*)(?=[=@+-].)(?=[=@]|[+-](?!{_NUMBER}))")
_MARKED = re.compile(r"(^|[,;])(\s*)'(?=[=@+-])")


def safe_cell(text: str) -> str:
    """Words for a cell that no spreadsheet runs: an apostrophe before = + - @,
    no ends of lines.
    """
    plain_text = printable(text).replace("\n", r"\n").replace("\t", r"\t")
    return _FORMULA.sub(r"\1\2'", plain_text)


def unsafe_cell(text: str) -> str:
    """The words that `safe_cell` has marked."""
    return _MARKED.sub(r"\1\2", text)


def plain_dict(data: Mapping[str, object]) -> dict[str, Any]:
    """JSON-able copy of named values, see `plain`."""
    return {name: plain(value) for name, value in data.items()}


def plain(value: object) -> Any:
    """JSON-able copy: arrays to lists, results to dicts, NaN and infinities to None.

    Complex numbers become [real, imaginary].
    """
    kind = type(value)  # first the usual kinds: a page converts every posture
    if kind is float:
        return value if isfinite(value) else None  # type: ignore[arg-type]
    if value is None or kind is str or kind is int:
        return value
    if isinstance(value, np.ndarray):
        value = value.tolist()
    if isinstance(value, (list, tuple)):
        return [v if type(v) is float and isfinite(v) else plain(v) for v in value]
    if is_dataclass(value) and not isinstance(value, type):
        return {f.name: plain(getattr(value, f.name)) for f in fields(value)}
    if isinstance(value, Mapping):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, (bool, np.bool_)):
        return bool(value)
    if isinstance(value, (int, np.integer)):
        return int(value)
    if isinstance(value, (float, np.floating)):
        return float(value) if np.isfinite(value) else None
    if isinstance(value, complex):
        return [value.real, value.imag] if np.isfinite(value) else None
    return value
