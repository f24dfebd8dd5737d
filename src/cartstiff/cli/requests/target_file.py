"""The file of ``--target``: a desired stiffness, with the order, units and frame it is in."""

from __future__ import annotations

import io
import json
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cartstiff import numerics
from cartstiff.choices import LARGEST_INPUT, ORDERS
from cartstiff.cli.requests.units import given_length
from cartstiff.errors import InputError, one_line

if TYPE_CHECKING:
    from cartstiff.mechanisms.contract import Mechanism
    from cartstiff.stiffness.compute import PostureStiffness

# In the order that is meant, the translation block over the squared length of the mechanism is
# about as stiff as the rotation block; the other order is off by the fourth power of the length.
# Where the ratio is worse by this factor than with the blocks exchanged, the order must be named.
_EXCHANGED = 5.0
# Bytes of a file with 36 numbers in it, generously.
_LARGEST = 1 << 20
# What a .json may say beside its matrix, and what a saved `StiffnessTensor` says besides.
_SAID = ("order", "units", "frame")
_SAVED = ("connection", "wrench", "pose", "base")


@dataclass(frozen=True)
class Target:
    """A desired stiffness as its file has it.

    Attributes
    ----------
    matrix : ndarray (6, 6)
        Symmetric, in the file's order and units.
    order : str
        One of `ORDERS`.
    order_from : {"file", "option", "default"}
        Who said so.
    units : tuple of str, or None
        Length and force of the file; None: those in which numbers are given.
    frame : str or None
        Name of the frame that the file is for.
    where : str
        For messages.
    """

    matrix: Any
    order: str
    order_from: str
    units: tuple[str, str] | None
    frame: str | None
    where: str

    def in_units_of(self, mechanism: Mechanism) -> Any:
        """The matrix in its own order, in the units of the mechanism.

        Raises
        ------
        InputError
            For another frame than the body's, or unknown units.
        """
        import numpy as np

        from cartstiff.mechanisms.contract import Units, convert_length

        if self.frame not in (None, "body", mechanism.frame):
            raise InputError(
                "is for another frame",
                where=self.where,
                expected=f"{mechanism.frame} or body",
                got=self.frame,
            )
        a, f = given_length(), 1.0
        if self.units is not None:
            try:
                a, f = convert_length(Units(*self.units), mechanism.units)
            except InputError as error:
                raise error.at(self.where) from None
        by_length = np.repeat([a, 1.0] if self.order == ORDERS[0] else [1.0, a], 3)
        return self.matrix * f * np.outer(by_length, by_length / a)

    def in_body_frame(self, result: PostureStiffness) -> Any:
        """The matrix in the order and units of the mechanism.

        Raises
        ------
        InputError
            As `in_units_of`, and for numbers that fit only with rotation and translation exchanged.
        """
        import numpy as np

        from cartstiff.geometry.se3 import SWAP

        mechanism = result.elastic.mechanism
        K = self.in_units_of(mechanism)
        K = K if self.order == ORDERS[0] else K[SWAP][:, SWAP]
        turn, move = np.trace(K[:3, :3]), np.trace(K[3:, 3:]) * result.posture.length**2
        if self.order_from == "default" and turn > 0 and move > 0:
            exchanged = np.trace(K[3:, 3:]), np.trace(K[:3, :3]) * result.posture.length**2
            if _unlike(turn, move) > _EXCHANGED * _unlike(*exchanged):
                units = f"{mechanism.units.length} and {mechanism.units.force}"
                raise InputError(
                    "the matrix looks as if translation came before rotation",
                    where=self.where,
                    expected=f"--target-order {ORDERS[1]}, or {ORDERS[0]} if it is meant so; other "
                    f"units than {units} are named in a .json",
                )
        return K


def _unlike(a: float, b: float) -> float:
    return max(a / b, b / a)


def _of_numpy(data: bytes) -> Any:
    """The array of an .npy file; of a broken one its reader raises anything."""
    import numpy as np

    try:
        return np.load(io.BytesIO(data), allow_pickle=False)
    except Exception as error:
        raise ValueError(str(error)) from None


def read_target(path: Path, order: str | None) -> Target:
    """A 6x6 matrix from a file: .json (rows, or an object with "matrix"), .csv or .npy."""
    import numpy as np

    from cartstiff.arrays import checked_array
    from cartstiff.loading.tables import read_rows
    from cartstiff.loading.yaml_file import read_bytes

    where = f"--target {one_line(str(path))}"
    expected = "a 6x6 matrix of numbers"
    if path.suffix not in (".json", ".csv", ".npy"):
        raise InputError("unknown file ending", where=where, expected=".json, .csv or .npy")
    fields: dict[str, Any] = {}
    unusable = (ValueError, TypeError, RecursionError, MemoryError)

    def none_held(error: BaseException) -> InputError:
        return InputError("does not hold a matrix", where=where, expected=expected, got=str(error))

    try:
        data = read_bytes(path, _LARGEST)
    except InputError as error:
        raise error.moved_to(where) from None
    try:
        if path.suffix == ".npy":
            content = _of_numpy(data)
        elif path.suffix == ".csv":
            text = data.decode()
            # The comment that our own files begin with names the order.
            named = [o for o in ORDERS if f"order {o}" in text.partition("\n")[0]]
            fields = {"order": named[0]} if text.startswith("#") and named else {}
            content = read_rows(path, "rows", _LARGEST).values
        else:
            content = json.loads(data)
    except unusable as error:
        raise none_held(error) from None
    if isinstance(content, dict):
        _check_keys(content, where)
        fields, content = content, content["matrix"]
    try:
        matrix = checked_array(content, (6, 6), "matrix")
    except unusable as error:
        raise none_held(error) from None
    if np.abs(matrix).max() > LARGEST_INPUT:
        raise InputError(
            "number is too large",
            where=where,
            expected=f"at most {LARGEST_INPUT:g}",
            got=f"{np.abs(matrix).max():g}",
        )
    if np.abs(matrix - matrix.T).max() > numerics.NEARBY * np.abs(matrix).max():
        raise InputError(
            "matrix is not symmetric", where=where, expected="a symmetric stiffness (K^B)"
        )
    own = fields.get("order")
    if own is not None and own not in ORDERS:
        raise InputError("unknown order", where=where, expected=" or ".join(ORDERS), got=repr(own))
    if own is not None and order is not None and own != order:
        raise InputError(
            "the file names another order", where="--target-order", expected=own, got=order
        )
    source = "option" if order is not None else "file" if own is not None else "default"
    return Target(
        0.5 * (matrix + matrix.T),
        order or own or ORDERS[0],
        source,
        _units(fields.get("units"), where),
        _frame(fields.get("frame"), where),
        where,
    )


def _check_keys(fields: dict[str, Any], where: str) -> None:
    if "matrix" not in fields:
        raise InputError(
            "there is no key matrix",
            where=where,
            expected='{"matrix": [6 rows]}',
            got=_listed(fields) or "no key",
        )
    if strange := fields.keys() - {"matrix", *_SAID, *_SAVED}:
        raise InputError(
            f"unknown key {_listed(strange)}", where=where, expected=f"matrix, {', '.join(_SAID)}"
        )


def _listed(keys: Iterable[str]) -> str:
    return ", ".join(one_line(key, 30) for key in sorted(keys)[:6])


def _units(units: Any, where: str) -> tuple[str, str] | None:
    if units is None:
        return None
    if not isinstance(units, dict) or not set(units) <= {"length", "force", "angle"}:
        raise InputError(
            "units cannot be used",
            where=where,
            expected='{"length": "m", "force": "N"}',
            got=repr(units),
        )
    if units.get("angle", "rad") != "rad":
        raise InputError(
            "unknown unit of angles", where=where, expected="rad", got=repr(units["angle"])
        )
    return str(units.get("length", "m")), str(units.get("force", "N"))


def _frame(frame: Any, where: str) -> str | None:
    if frame is not None and not isinstance(frame, str):
        raise InputError("frame is not a name", where=where, got=repr(frame))
    return frame
