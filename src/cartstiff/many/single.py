"""One posture at a time by machine code, where a mechanism is asked for again and again.

The first questions to a mechanism go to the engine. From `_OFTEN` on machine code is made beside
them; once it is there it answers where it finds a posture plainly regular. What it does not compute
is asked of the engine when it is read: every answer is the engine's, to rounding.
"""

from __future__ import annotations

import weakref
from collections.abc import Callable, Mapping
from functools import wraps
from threading import Thread, main_thread
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

#: Questions to a mechanism from which on machine code is made: as long as some 2000 of them takes
#: the making, beside the work.
_OFTEN = 200
#: Where links are bent first the making takes longer, up to a quarter of a minute, and of more
#: operations nothing is made.
_OFTEN_BENT, _LARGEST_BENT = 1000, 150_000


class _Asked:
    """How often a mechanism was asked for, and its machine code once there is any."""

    def __init__(self, elastic: ElasticMechanism, key: tuple[int, bool]) -> None:
        self.elastic = weakref.ref(elastic, lambda _: _known.pop(key, None))
        self.count = 0
        self.code: PostureCode | None = None

    def again(self, loaded: bool) -> None:
        """One more question; the code is made beside it where it pays."""
        self.count += 1
        if self.count in (_OFTEN, _OFTEN_BENT):
            Thread(target=self._make, args=(loaded,), name="cartstiff-code").start()

    def _make(self, loaded: bool) -> None:
        from cartstiff.many.kernels import LARGEST_PROGRAM, has_package
        from cartstiff.many.plans import plan, program_for

        elastic = self.elastic()
        if elastic is None or not has_package("llvmlite"):
            return
        chosen = plan(elastic, "shared" if loaded else "none")
        if (
            isinstance(chosen, str)
            or chosen.settles is not (self.count >= _OFTEN_BENT)
            or chosen.regular != "regular"
            or chosen.beside.is_dense
            or elastic.mechanism.rigid
            or ((chosen.beside or chosen.settles) and not chosen.is_closed)
            or not _is_plain(elastic, loaded, chosen)
        ):
            return
        program = program_for(chosen.case, RECORDED)
        waited_for = main_thread().is_alive()
        is_small = program.size <= (_LARGEST_BENT if chosen.settles else LARGEST_PROGRAM)
        if "noteworthy" in program.outputs and is_small and waited_for:
            self.code = PostureCode(elastic, chosen)


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


_known: dict[tuple[int, bool], _Asked] = {}


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
        asked = _known.get(key)
        if asked is None:
            asked = _known[key] = _Asked(elastic, key)
        if (code := asked.code) is None:
            asked.again(wrench is not None)
            return engine(elastic, q, wrench=wrench)
        values = elastic.mechanism.checked(elastic.q if q is None else q)
        force = None if wrench is None else checked_input(wrench, (6,), "wrench")
        record = code.record(values, force)
        if record is None:
            return engine(elastic, values, wrench=force)
        return QuickPosture(code, elastic, record[0], force, record[1])

    return cast(Ask, analyse)


analyse = _quicker(compute.analyse)
