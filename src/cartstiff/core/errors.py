"""The errors of cartstiff: a refusal names the input, its place,
and what was expected and got.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
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
    r"""Escape characters that control a terminal or the direction of text.

    Names come from untrusted files: "\x1b]0;..." would be a command to the terminal, and
    "\u202e" would reverse the text after it. Line ends and tabs stay. All output, as
    text, in a table, a picture or a page, passes here once.
    """
    if text.isprintable():
        return text
    return "".join(
        c if c in "\n\t" or category(c) not in _UNSEEN else _escaped(c) for c in text
    )


def joined(lines: Iterable[str]) -> str:
    r"""Lines as one text; line ends and tabs within a line are escaped."""
    return "\n".join(
        printable(line).replace("\n", r"\n").replace("\t", r"\t") for line in lines
    )


def listed(words: Sequence[str], most: int, between: str = ", ") -> str:
    """The first words in a row, and how many more there are.

    Results for programs hold all.
    """
    before = between.replace(",", "")  # "a, b and 2 more", but "a; b; and 2 more"
    more = f"{before}and {len(words) - most} more" if len(words) > most else ""
    return between.join(words[:most]) + more


# Control, format (direction, joining), surrogates, ends of lines and paragraphs.
_UNSEEN = {"Cc", "Cf", "Cs", "Zl", "Zp"}


def _escaped(character: str) -> str:
    return character.encode("unicode_escape").decode("ascii")


class CartstiffError(Exception):
    """Base class of every error that cartstiff raises on purpose; can be pickled."""

    def __reduce__(self) -> tuple[Any, ...]:
        # Python would call the class with the message alone.
        return _restored, (type(self), self.args, self.__dict__.copy())


def _restored(
    kind: type[CartstiffError], arguments: tuple[Any, ...], state: dict[str, Any]
) -> CartstiffError:
    error = kind.__new__(kind, *arguments)
    error.__dict__.update(state)
    return error


class InputError(CartstiffError, ValueError):
    """Input of the user that cannot be used.

    Attributes
    ----------
    what : str
        The faulty input, in the user's words ("joint stiffness").
    where : str or None
        The place: an option, a file with its line, a key.
    expected, got : str or None
        Accepted input, and the input that was found.
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
        """Return the same error with a place, the text `where`, in front of the one it
        has.
        """
        return self.moved_to(f"{where}: {self.where}" if self.where else where)

    def moved_to(self, where: str) -> InputError:
        """Return the same error, of the same class and with the same numbers, at another
        place: the text `where`.
        """
        moved = type(self).__new__(type(self))
        moved.__dict__.update(self.__dict__)
        InputError.__init__(
            moved, self.what, where=where, expected=self.expected, got=self.got
        )
        return moved


class UnknownNameError(InputError):
    """A name that does not exist.

    Attributes
    ----------
    name : str
        The unknown name.
    valid : tuple of str
        The names that exist.

    The parameter `also` says what else is accepted.
    """

    def __init__(
        self,
        kind: str,
        name: str,
        valid: Iterable[str],
        *,
        where: str | None = None,
        also: str = "",
    ) -> None:
        self.name = name
        self.valid = tuple(dict.fromkeys(valid))
        given = str(name).lower()
        # A name that differs in upper and lower case only is the closest.
        same = [v for v in self.valid if str(v).lower() == given]
        longer = [
            v for v in self.valid if len(given) > 2 and str(v).lower().startswith(given)
        ]
        close = same or longer[:6] or get_close_matches(str(name), self.valid, n=3)
        shown = ", ".join(close or self.valid[:12])
        if not self.valid:
            expected = "a name, but none exist here"
        elif close:
            expected = f"one of {len(self.valid)} names (closest: {shown})"
        else:
            more = ", ..." if len(self.valid) > 12 else ""
            expected = f"one of {shown}{more}"
        super().__init__(
            f"unknown {kind}", where=where, expected=expected + also, got=repr(name)
        )


class UnknownArgumentError(UnknownNameError, TypeError):
    """A keyword that a function does not take."""


def check_name(
    kind: str, name: object, valid: Collection[str], where: str | None = None
) -> None:
    """Refuse a name that is not among the valid ones.

    The message says of which `kind` it is, and `where` it was found.

    Raises
    ------
    UnknownNameError
        With the closest valid names.
    """
    if name not in valid:
        raise UnknownNameError(kind, str(name), valid, where=where)


class UndefinedError(CartstiffError):
    """A quantity that does not exist in this state
    (singular, unbalanced, buckled, no chart).

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


class NoEnergyError(UndefinedError):
    """A part of a mechanism that has no stable equilibrium of its own,
    and so no energy.
    """


class ConvergenceError(CartstiffError):
    """An iteration that ended without an answer.

    Attributes
    ----------
    what : str
        The message, without the numbers.
    iterations : int
        How many steps were taken.
    residual : float
        Remaining residual, in the units named in the message.
    """

    def __init__(self, message: str, *, iterations: int, residual: float) -> None:
        self.what = message
        self.iterations = iterations
        self.residual = residual
        super().__init__(f"{message} ({iterations} iterations, residual {residual:.3g})")


class MissingDependencyError(CartstiffError, ImportError):
    """A required package is not installed.

    `extra` is the extra of cartstiff that installs it.
    """

    def __init__(self, package: str, purpose: str, extra: str = "") -> None:
        self.package = package
        super().__init__(
            f"{purpose} needs the package {package}, which is not installed: "
            + (f"pip install 'cartstiff[{extra}]'" if extra else f"pip install {package}")
        )


def imported(module: str, package: str, purpose: str, extra: str = "") -> Any:
    """Import an optional module.

    Raises
    ------
    MissingDependencyError
        If it cannot be imported; with the package and how to install it.
    """
    try:
        return import_module(module)
    except ImportError:
        raise MissingDependencyError(package, purpose, extra) from None


def checked_kind(
    value: object, kinds: type | tuple[type, ...], what: str, expected: str
) -> Any:
    """Return the value if it is an object of one of the kinds, else raise InputError.

    Parameters
    ----------
    value : object
        The value.
    kinds : type or tuple of type
        Accepted types.
    what, expected : str
        Name of the value, and how to make an accepted one, for the message.
    """
    if isinstance(value, kinds):
        return value
    raise InputError(
        f"{what} cannot be used", expected=expected, got=type(value).__name__
    )
