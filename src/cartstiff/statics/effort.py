"""How far a search goes: so many postures, not seconds, so that it ends alike on every machine."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from math import inf

from cartstiff.errors import ConvergenceError
from cartstiff.mechanisms.elastic import ElasticMechanism
from cartstiff.potentials.beams import Beam
from cartstiff.potentials.flexure_struts import FlexureStruts

# What a search may cost, and what a posture costs at least, in postures of one coordinate; and what
# each beam or strut adds, which comes to rest in every posture anew.
_MOST, _LEAST, _BEAM, _STRUT = 150_000, 20, 16, 64
# Postures that every search may take. Those that succeed take some hundred at most.
_FEWEST = 300


class ExhaustedError(Exception):
    """A search has looked at as many postures as it may; no one on the way may take it for less."""


@dataclass
class _Effort:
    most: int
    seen: int = 0


_effort: ContextVar[_Effort | None] = ContextVar("effort", default=None)


def cost(elastic: ElasticMechanism) -> int:
    """What a posture costs, in postures of one coordinate."""
    springs = elastic.springs
    beams = sum(isinstance(potential, Beam) for potential in elastic.potentials)
    struts = len(springs.stiffness) if isinstance(springs, FlexureStruts) else 0
    return _LEAST + len(elastic.names) + _BEAM * beams + _STRUT * struts


@contextmanager
def bounded(elastic: ElasticMechanism) -> Iterator[None]:
    """Bound what is searched within; all searches within share the bound of the outermost.

    Raises
    ------
    ConvergenceError
        If the bound is met where no search says how far it has come.
    """
    if _effort.get() is not None:
        yield
        return
    token = _effort.set(_Effort(max(_MOST // cost(elastic), _FEWEST)))
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
