"""Kinds of mechanisms and potentials answer for themselves: few places ask which one they have."""

from __future__ import annotations

from collections import Counter
from itertools import takewhile

from tests.kinds import checks

#: Checks when they were counted last; a lower number replaces it as they go.
MOST_CHECKS = 53


def test_kinds_are_asked_for_in_few_places() -> None:
    found = list(checks())
    where = "\n".join(f"{c.file}:{c.line}: {c.text}" for c in sorted(found))
    assert len(found) <= MOST_CHECKS, f"let the kind answer (docs/architecture.md)\n{where}"


_ASKS = """
from functools import singledispatch
from cartstiff.extend import Platform
from cartstiff import LineSprings
TABLE = {Platform: 1, LineSprings: 2}
def asks(x, other):
    if isinstance(x, (Platform, LineSprings)) or type(x) is LineSprings:
        return hasattr(x, "rest_is_free")
    match x:
        case LineSprings(stiffness=k):
            return k
    return x.kind == "serial" or issubclass(x, Platform)
@singledispatch
def of(x): ...
class Own(Platform): ...
def asks_not(x, other):
    return isinstance(x, (Own, dict)), x.kind == "length", hasattr(x, "__array__"), type(x) is Own
"""


def test_each_form_of_a_check_counts_once() -> None:
    found = takewhile(lambda check: check.file == "asks.py", checks(more={"asks.py": _ASKS}))
    once = ["table", "isinstance", "type()", "hasattr", "match", ".kind", "issubclass"]
    assert Counter(check.form for check in found) == Counter([*once, "singledispatch"])
