"""Refusal of arguments of a wrong type in calls of public functions.

Functions check the numbers that they read, but not the type of every argument. If a call
ends in an error of Python, its arguments are compared with the annotations: one that does
not fit is refused in one line, as is an unknown keyword, with the closest known one.
Calls that succeed take no more time.
"""

from __future__ import annotations

import builtins
import functools
import inspect
import sys
import types
import typing
from collections.abc import Callable, Iterable, Mapping
from numbers import Integral, Real
from typing import Any, ParamSpec, TypeVar, Unpack

import numpy as np
from numpy.typing import ArrayLike

from cartstiff.core.arrays import real_array
from cartstiff.core.errors import CartstiffError, InputError, UnknownArgumentError
from cartstiff.core.lazily import HOMES

_P = ParamSpec("_P")
_R = TypeVar("_R")
_RAW = (
    TypeError,
    ValueError,
    AttributeError,
    LookupError,
    ArithmeticError,
    RecursionError,
)
_WORDS: dict[Any, str] = {
    bool: "true or false",
    int: "a whole number",
    float: "a number",
    str: "text",
    ArrayLike: "numbers",
}
_BY_PLACE = inspect.Parameter.POSITIONAL_OR_KEYWORD
#: New names of arguments by their former names.
_RENAMED = {"q0": "q", "axes": "load_axes", "wrench_at": "load_at"}


def checked(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """The function with refusals of arguments of a wrong type.

    Parameters
    ----------
    function : callable
        With annotated parameters.

    Returns
    -------
    callable
        Raises `InputError` if the function raised an error of Python and an argument does
        not fit its annotation, or a keyword is unknown; otherwise the original error.
    """

    @functools.wraps(function)
    def call(*args: _P.args, **kwargs: _P.kwargs) -> _R:
        try:
            return function(*args, **kwargs)
        except CartstiffError:
            raise
        except _RAW as error:
            if (refusal := _wrong_kind(function, args, kwargs)) is not None:
                raise refusal from error
            raise

    return call


def _wrong_kind(
    function: Callable[..., Any], args: tuple[Any, ...], kwargs: dict[str, Any]
) -> InputError | None:
    signature = inspect.signature(function)
    try:
        given = signature.bind(*args, **kwargs).arguments
    except TypeError:
        takes = signature.parameters
        if not any(
            parameter.kind is parameter.VAR_KEYWORD for parameter in takes.values()
        ):
            for name in kwargs:
                if name not in takes:
                    known, new, own = [*takes], _RENAMED.get(name), function.__name__
                    if new is not None and new in takes:
                        where, by_place = (
                            known.index(new) + 1,
                            takes[new].kind is _BY_PLACE,
                        )
                        if by_place:
                            place = f"{', '.join(known[:where])}, ..."
                        else:
                            place = f"..., {new}=..."
                        known = [f"{own}({place})"]
                    return UnknownArgumentError(f"argument of {own}", name, known)
        return None  # too many or too few arguments: Python's message names them
    hints = {
        name: _resolved(signature.parameters[name].annotation, function) for name in given
    }
    for name in [n for n, hint in hints.items() if typing.get_origin(hint) is Unpack]:
        (of_keys,) = typing.get_args(hints[name])
        known = of_keys.__annotations__
        for key in given[name].keys() - known:
            words = [*(n for n in signature.parameters if n != name), *known]
            return UnknownArgumentError(f"argument of {function.__name__}", key, words)
        given |= given.pop(name)
        for key, hint in known.items():
            hints[key] = _resolved(hint.__forward_arg__, function)
    for name, value in given.items():
        hint = hints[name]
        if not _fits(value, hint):
            return InputError(f"{name} cannot be used", expected=_words(hint), got=value)
    return None


class _Names(dict[str, Any]):
    """Names for annotations, including public names that are imported for type
    checkers only.
    """

    def __init__(self, function: Callable[..., Any]) -> None:
        self.known = {**vars(builtins), **function.__globals__}

    def __missing__(self, name: str) -> Any:
        if name in self.known:
            return self.known[name]
        face = sys.modules[__name__.partition(".")[0]]
        homes = [face, *(getattr(face, home) for home in HOMES)]
        return next((getattr(h, name) for h in homes if name in dir(h)), Any)


def _resolved(annotation: Any, function: Callable[..., Any]) -> Any:
    """The annotation as an object; unknown names are Any."""
    if not isinstance(annotation, str):
        return annotation
    try:
        return eval(annotation, {}, _Names(function))  # the package's own source
    except TypeError:  # Any, for an unknown name, takes no parameters
        return Any


def _fits(value: Any, hint: Any) -> bool:
    """Whether a value fits an annotation; True if that cannot be decided."""
    origin, arguments = typing.get_origin(hint), typing.get_args(hint)
    if hint is Any:
        return True
    if hint is None or hint is type(None):
        return value is None
    if hint == ArrayLike:
        try:
            real_array(value)
        except (CartstiffError, *_RAW):
            return False
        return True
    if origin in (typing.Union, types.UnionType):
        return any(_fits(value, part) for part in arguments)
    if origin is typing.Literal:
        return isinstance(value, str) and value in arguments
    if origin is not None:
        if not isinstance(value, origin):
            return False
        if issubclass(origin, Mapping) or origin in (list, tuple, set):
            return True
        named = arguments == (str,) and issubclass(origin, Iterable)
        return not named or all(isinstance(item, str) for item in value)
    if hint is bool:
        return isinstance(value, (bool, np.bool_))
    if hint in (int, float):
        return isinstance(value, Integral if hint is int else Real) and not isinstance(
            value, bool
        )
    return not isinstance(hint, type) or isinstance(value, hint)


def _words(hint: Any) -> str:
    """The type of an annotation, in words."""
    origin, arguments = typing.get_origin(hint), typing.get_args(hint)
    if hint == ArrayLike:
        return _WORDS[ArrayLike]
    if origin in (typing.Union, types.UnionType):
        parts = [_words(part) for part in arguments if part is not type(None)]
        return " or ".join(dict.fromkeys(parts))
    if origin is typing.Literal:
        return ", ".join(map(str, arguments))
    if origin is not None and issubclass(origin, Callable):  # type: ignore[arg-type]
        return "a function"
    if origin is not None and issubclass(origin, Mapping):
        return "names and values"
    if origin is not None:
        return "names" if arguments[:1] == (str,) else "a list"
    if hint in _WORDS:
        return _WORDS[hint]
    name = str(getattr(hint, "__name__", hint))
    return f"{'an' if name[0] in 'AEIOU' else 'a'} {name}"
