"""The error family: every refusal says what, where, what was expected and what was got."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from difflib import get_close_matches
from importlib import import_module
from typing import Any
from unicodedata import category

_LONGEST_SHOWN = 120


def one_line(value: object, longest: int = _LONGEST_SHOWN) -> str:
    """Show any value on one short line of printable text."""
    text = value if isinstance(value, str) else repr(value)
    text = "".join(c if c.isprintable() else " " for c in text)
    text = " ".join(text.split())
    return text if len(text) <= longest else text[: longest - 3] + "..."


def printable(text: str) -> str:
    r"""Show what would command a terminal, or turn the direction of text, as its escape.

    Names come from files of strangers: "\x1b]0;..." would reach the terminal as a command, and
    "\u202e" reverse what stands after it. Ends of lines and tabs stay. Everything that leaves as
    text, in a table, a picture or a page passes here once.
    """
    if text.isprintable():
        return text
    return "".join(c if c in "\n\t" or category(c) not in _UNSEEN else _escaped(c) for c in text)


def joined(lines: Iterable[str]) -> str:
    r"""Lines as one text; what would end a line within one, as names may, is shown escaped."""
    return "\n".join(printable(line).replace("\n", r"\n").replace("\t", r"\t") for line in lines)


# Control, format (direction, joining), surrogates, ends of lines and paragraphs.
_UNSEEN = {"Cc", "Cf", "Cs", "Zl", "Zp"}


def _escaped(character: str) -> str:
    return character.encode("unicode_escape").decode("ascii")


class CartstiffError(Exception):
    """Base class of every error that cartstiff raises on purpose.

    It can be sent between processes with all its numbers.
    """

    def __reduce__(self) -> tuple[Any, ...]:
        # Python would call the class with the message alone, which is not what it takes.
        return _restored, (type(self), self.args, self.__dict__.copy())


def _restored(
    kind: type[CartstiffError], arguments: tuple[Any, ...], state: dict[str, Any]
) -> CartstiffError:
    error = kind.__new__(kind, *arguments)
    error.__dict__.update(state)
    return error


class InputError(CartstiffError, ValueError):
    """Something given by the user cannot be used.

    Attributes
    ----------
    what : str
        The thing that is wrong, in the user's words ("joint stiffness").
    where : str or None
        The place: an option, a file with its line, a key.
    expected, got : str or None
        What would have been accepted, and what was found.
    """

    def __init__(
        self,
        what: str,
        *,
        where: str | None = None,
        expected: str | None = None,
        got: object = None,
    ) -> None:
        self.what = what
        self.where = where
        self.expected = expected
        self.got = None if got is None else one_line(got)
        parts = [f"{where}: " if where else "", what]
        if expected is not None:
            parts.append(f"; expected {expected}")
        if self.got is not None:
            parts.append(f", got {self.got}")
        super().__init__(one_line("".join(parts), 600))

    def at(self, where: str) -> InputError:
        """Return the same error with a place in front of the one it has."""
        return self.moved_to(f"{where}: {self.where}" if self.where else where)

    def moved_to(self, where: str) -> InputError:
        """Return the same error, of the same class and with the same numbers, at another place."""
        moved = type(self).__new__(type(self))
        moved.__dict__.update(self.__dict__)
        InputError.__init__(moved, self.what, where=where, expected=self.expected, got=self.got)
        return moved


class UnknownNameError(InputError):
    """A name that does not exist; carries the valid ones.

    Attributes
    ----------
    name : str
        The name that was asked for.
    valid : tuple of str
        The names that exist.
    """

    def __init__(
        self, kind: str, name: str, valid: Iterable[str], *, where: str | None = None
    ) -> None:
        self.name = name
        self.valid = tuple(dict.fromkeys(valid))
        # Letters in another case are the nearest of all.
        same = [v for v in self.valid if str(v).lower() == str(name).lower()]
        close = same or get_close_matches(str(name), self.valid, n=3)
        shown = ", ".join(close or self.valid[:12])
        if not self.valid:
            expected = "none exist here"
        elif close:
            expected = f"one of {len(self.valid)} names (closest: {shown})"
        else:
            more = ", ..." if len(self.valid) > 12 else ""
            expected = f"one of {shown}{more}"
        super().__init__(f"unknown {kind}", where=where, expected=expected, got=repr(name))


class UnknownArgumentError(UnknownNameError, TypeError):
    """A keyword that a function does not take."""


def check_name(kind: str, name: object, valid: Collection[str], where: str | None = None) -> None:
    """Refuse a name that is not among the valid ones.

    Raises
    ------
    UnknownNameError
        With the nearest of them.
    """
    if name not in valid:
        raise UnknownNameError(kind, str(name), valid, where=where)


class UndefinedError(CartstiffError):
    """A quantity that does not exist in this state (singular, unbalanced, buckled, no chart).

    Attributes
    ----------
    code : str
        The state's short name, the same as in the notes of a result.
    values : dict
        The numbers that show it.
    """

    def __init__(
        self, message: str, *, code: str, values: Mapping[str, object] | None = None
    ) -> None:
        self.code = code
        self.values = dict(values or {})
        super().__init__(message)


class ConvergenceError(CartstiffError):
    """An iteration that ended without an answer.

    Attributes
    ----------
    iterations : int
        How many steps were taken.
    residual : float
        What was left, in the units named in the message.
    """

    def __init__(self, message: str, *, iterations: int, residual: float) -> None:
        self.iterations = iterations
        self.residual = residual
        super().__init__(f"{message} ({iterations} iterations, residual {residual:.3g})")


class MissingDependencyError(CartstiffError, ImportError):
    """A package is needed and not installed; one that an `extra` of cartstiff adds, or its own."""

    def __init__(self, package: str, purpose: str, extra: str = "") -> None:
        self.package = package
        super().__init__(
            f"{purpose} needs the package {package}, which is not installed: "
            + (f"pip install 'cartstiff[{extra}]'" if extra else f"pip install {package}")
        )


def imported(module: str, package: str, purpose: str, extra: str = "") -> Any:
    """A module that not every installation has.

    Raises
    ------
    MissingDependencyError
        Where it cannot be imported: what needs which package, and how it is installed.
    """
    try:
        return import_module(module)
    except ImportError:
        raise MissingDependencyError(package, purpose, extra) from None


def checked_kind(value: object, kinds: type | tuple[type, ...], what: str, expected: str) -> Any:
    """The value itself; InputError where it is an object of another kind.

    Parameters
    ----------
    value : object
        What was given.
    kinds : type or tuple of type
        What it may be.
    what, expected : str
        For the message: what it is for, and how it is made.
    """
    if isinstance(value, kinds):
        return value
    raise InputError(f"{what} cannot be used", expected=expected, got=type(value).__name__)
