"""How far a search goes: so many postures, not seconds, so that it ends alike on every machine."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from math import inf

from cartstiff.errors import ConvergenceError

__all__ = ["ExhaustedError", "bounded", "count"]

# What a search may cost, and what a posture costs at least: in postures of one coordinate.
_MOST, _LEAST = 150_000, 20
# Postures that every search may take. Those that succeed take some hundred at most.
_FEWEST = 200


class ExhaustedError(Exception):
    """A search has looked at as many postures as it may; no one on the way may take it for less."""


@dataclass
class _Effort:
    most: int
    seen: int = 0


_effort: ContextVar[_Effort | None] = ContextVar("effort", default=None)


@contextmanager
def bounded(coordinates: int) -> Iterator[None]:
    """Bound what is searched within; all searches within share the bound of the outermost.

    Raises
    ------
    ConvergenceError
        If the bound is met where no search says how far it has come.
    """
    if _effort.get() is not None:
        yield
        return
    token = _effort.set(_Effort(max(_MOST // (_LEAST + coordinates), _FEWEST)))
    try:
        yield
    except ExhaustedError as error:
        raise ConvergenceError(
            f"no equilibrium found, {error}", iterations=0, residual=inf
        ) from None
    finally:
        _effort.reset(token)


def count() -> None:
    """One more posture; `ExhaustedError`, with how many there were, if that is one too many."""
    effort = _effort.get()
    if effort is None:
        return
    if effort.seen >= effort.most:
        raise ExhaustedError(f"the search was given up after {effort.seen} postures")
    effort.seen += 1
