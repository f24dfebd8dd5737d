"""One posture at a time by machine code, where a mechanism is analysed again and again.

A mechanism is compiled by its call number `COMPILED_AT`, in the calling thread, so that which calls
are answered by which arithmetic is the same in every run. The code answers where it finds a posture
plainly regular, the engine everything else: the answers agree to rounding.
"""

from __future__ import annotations

import weakref
from collections.abc import Callable, Mapping
from functools import wraps
from itertools import count
from typing import TYPE_CHECKING, Any, TypeVar, cast

from numpy.typing import ArrayLike

from cartstiff.arrays import checked_input
from cartstiff.many.quick_posture import RECORDED, PostureCode, QuickPosture
from cartstiff.mechanisms.elastic import ElasticMechanism
from cartstiff.potentials.beams import Beam
from cartstiff.potentials.contract import Potential
from cartstiff.potentials.line_springs import LineSprings
from cartstiff.potentials.springs import CoupledSprings
from cartstiff.stiffness import compute
from cartstiff.stiffness.posture import PostureStiffness

if TYPE_CHECKING:
    from cartstiff.many.plans import BoundCase

Ask = TypeVar("Ask", bound=Callable[..., PostureStiffness])

#: Call of `analyse` in which a mechanism is compiled: the compilation takes as long as some 2000
#: calls.
COMPILED_AT = 200
#: Mechanisms with links that a load bends are compiled in this call, which takes up to a quarter of
#: a minute, if their programs have no more operations than this.
BENT_COMPILED_AT, _LARGEST_BENT = 1000, 150_000


class _Calls:
    """Number of calls for a mechanism, and its machine code once it is compiled."""

    def __init__(self, elastic: ElasticMechanism, key: tuple[int, bool]) -> None:
        self.elastic = weakref.ref(elastic, lambda _: _known.pop(key, None))
        self.number = count(1)  # each number goes to one thread, without a lock
        self.code: PostureCode | None = None


def _compiled(elastic: ElasticMechanism, loaded: bool, bent: bool) -> PostureCode | None:
    """Machine code of a mechanism; None where it is not compiled."""
    from cartstiff.many.kernels import LARGEST_PROGRAM, has_package
    from cartstiff.many.plans import plan, program_for

    if not has_package("llvmlite"):
        return None
    chosen = plan(elastic, "shared" if loaded else "none")
    if (
        isinstance(chosen, str)
        or chosen.settles is not bent
        or chosen.regular != "regular"
        or chosen.beside.is_dense
        or elastic.mechanism.rigid
        or ((chosen.beside or chosen.settles) and not chosen.is_closed)
        or not _is_plain(elastic, loaded, chosen)
    ):
        return None
    program = program_for(chosen.case, RECORDED)
    is_small = program.size <= (_LARGEST_BENT if bent else LARGEST_PROGRAM)
    return PostureCode(elastic, chosen) if "noteworthy" in program.outputs and is_small else None


def _is_plain(elastic: ElasticMechanism, loaded: bool, taken: BoundCase) -> bool:
    """Whether nothing of it can change, and no energy has a remark on a posture."""
    # What a closed chain has of these is not bent where its code answers, or is asked for remarks.
    silent = (LineSprings,) if not taken.is_closed else (Beam, CoupledSprings)
    if elastic.gravity is not None and elastic.gravity.flags.writeable:
        return False
    return (elastic.springs is not None or not loaded) and all(
        type(term).remarks is Potential.remarks
        or (isinstance(term, silent) and not getattr(term, "unilateral", False))
        for term in elastic.terms()
    )


_known: dict[tuple[int, bool], _Calls] = {}


def _quicker(engine: Ask) -> Ask:
    """`analyse` with the same arguments and words about itself."""

    @wraps(engine)
    def analyse(
        elastic: ElasticMechanism,
        q: ArrayLike | Mapping[str, float] | None = None,
        *,
        wrench: ArrayLike | None = None,
        **load: Any,
    ) -> PostureStiffness:
        if load or isinstance(q, Mapping) or not isinstance(elastic, ElasticMechanism):
            return engine(elastic, q, wrench=wrench, **load)
        key = id(elastic), wrench is not None
        calls = _known.get(key)
        if calls is None:
            calls = _known.setdefault(key, _Calls(elastic, key))
        if (code := calls.code) is None:
            number = next(calls.number)
            if number in (COMPILED_AT, BENT_COMPILED_AT):
                calls.code = _compiled(elastic, wrench is not None, number == BENT_COMPILED_AT)
            return engine(elastic, q, wrench=wrench)
        values = elastic.mechanism.checked(elastic.q if q is None else q)
        force = None if wrench is None else checked_input(wrench, (6,), "wrench")
        record = code.record(values, force)
        if record is None:
            return engine(elastic, values, wrench=force)
        return QuickPosture(code, elastic, record[0], force, record[1])

    analyse.__module__ = __name__  # where it can be found again when it is pickled
    return cast(Ask, analyse)


analyse = _quicker(compute.analyse)
