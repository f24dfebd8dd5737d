"""Parameters of a mechanism file: names for numbers, and arithmetic wherever a number may stand."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from cartstiff.arrays import checked_number
from cartstiff.errors import InputError, UnknownNameError, one_line
from cartstiff.expressions import Expression, is_name
from cartstiff.notes import Note

#: Keys of a file whose texts are for readers.
_WORDS = ("name", "description", "source")
Place = tuple[str | int, ...]


@dataclass(frozen=True)
class Parameters:
    """Values of a file's parameters.

    Attributes
    ----------
    values : mapping of str to float
        All of them.
    given : mapping of str to float
        Those that were set from outside.
    """

    values: Mapping[str, float]
    given: Mapping[str, float]

    def notes(self) -> list[Note]:
        """What was set, for results."""
        if not self.given:
            return []
        words = ", ".join(f"{name} = {value:g}" for name, value in self.given.items())
        return [Note("parameters-set", f"set instead of what the file says: {words}", self.given)]


def with_parameters(
    data: dict[str, Any], place: Callable[[Place], str], chosen: Mapping[str, Any] | None = None
) -> tuple[dict[str, Any], Parameters]:
    """Data of a file without its parameters: numbers in place of the arithmetic.

    Parameters
    ----------
    data : dict
        As read; texts that begin with "=" are arithmetic over the names under ``parameters``.
    place : callable
        From keys to words for messages.
    chosen : mapping of str to float, optional
        Values that count instead of the file's.

    Raises
    ------
    InputError
        For names that cannot be used, are not known, depend on themselves, or are not used.
    """
    asked = {
        name: checked_number(x, f"parameter {name!r}") for name, x in dict(chosen or {}).items()
    }
    entries = data.get("parameters", {})
    if not isinstance(entries, dict):
        raise InputError(
            "cannot be used",
            where=place(("parameters",)),
            expected="names and their numbers",
            got=one_line(entries),
        )
    for name in asked:
        if name not in entries:
            if not entries:
                raise InputError(
                    "the mechanism has no parameters",
                    where=place(()),
                    expected="a key 'parameters' in its file",
                    got=one_line(str(name)),
                )
            raise UnknownNameError("parameter", str(name), entries, where=place(()))
    values, used = _evaluated(entries, asked, place)
    rest = {key: value for key, value in data.items() if key != "parameters"}
    filled = {
        key: value if key in _WORDS else _filled(value, (key,), values, used, place)
        for key, value in rest.items()
    }
    for name in entries:
        if name not in used:
            raise InputError(
                f"parameter {name!r} is not used",
                where=place(("parameters", name)),
                expected=f"a number such as '={name}' in the file",
            )
    return filled, Parameters(values, asked)


def _evaluated(
    entries: Mapping[str, Any], asked: Mapping[str, float], place: Callable[[Place], str]
) -> tuple[dict[str, float], set[str]]:
    """Value of every parameter, and the names that others need, by what the file says."""
    formulas: dict[str, Expression | float] = {}
    for name, entry in entries.items():
        where = place(("parameters", name))
        if not is_name(name):
            raise InputError(
                "name of a parameter cannot be used",
                where=where,
                got=repr(name),
                expected="letters, digits and _, no word of arithmetic",
            )
        if isinstance(entry, str) and entry.startswith("="):
            formulas[name] = Expression(entry[1:], where)
        elif isinstance(entry, (int, float)) and not isinstance(entry, bool):
            formulas[name] = checked_number(entry, where)
        else:
            raise InputError(
                "cannot be used",
                where=where,
                got=one_line(entry),
                expected="a number, or arithmetic such as '=2*r'",
            )
    used: set[str] = set()
    for formula in formulas.values():
        if isinstance(formula, Expression):
            used |= formula.names
    values: dict[str, float] = {}
    open_names: list[str] = []

    def settle(name: str) -> None:
        if name in values:
            return
        formula = formulas[name]
        if name in open_names:
            circle = " -> ".join([*open_names[open_names.index(name) :], name])
            raise InputError(
                "parameters depend on each other in a circle",
                got=circle,
                where=place(("parameters", name)),
            )
        if not isinstance(formula, Expression):
            values[name] = asked.get(name, formula)
            return
        open_names.append(name)
        for other in sorted(formula.names):
            if other not in formulas:
                raise UnknownNameError("parameter", other, formulas, where=formula.where)
            settle(other)
        open_names.pop()
        values[name] = asked[name] if name in asked else formula.value(values)

    try:
        for name in formulas:
            settle(name)
    except RecursionError:
        raise InputError(
            "parameters depend on each other too deeply", where=place(("parameters",))
        ) from None
    return values, used


def _filled(
    data: Any, at: Place, values: Mapping[str, float], used: set[str], place: Callable[[Place], str]
) -> Any:
    """The data with numbers in place of arithmetic; adds the names that it needs to `used`."""
    if isinstance(data, dict):
        return {k: _filled(v, (*at, k), values, used, place) for k, v in data.items()}
    if isinstance(data, list):
        return [_filled(v, (*at, i), values, used, place) for i, v in enumerate(data)]
    if not isinstance(data, str) or not data.startswith("="):
        return data
    formula = Expression(data[1:], place(at))
    used |= formula.names
    value = formula.value(values)
    # Counts, such as the segments of a beam, are whole numbers.
    return int(value) if value.is_integer() else value
