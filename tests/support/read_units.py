"""How large units with prefixes are, written down apart from the library."""

from __future__ import annotations

import re

_PREFIXES = {"G": 1e9, "M": 1e6, "k": 1e3, "c": 1e-2, "m": 1e-3, "\u00b5": 1e-6}


def si(unit: str) -> float:
    """How large a unit such as "kN/mm" is in those without prefixes."""
    size, power = 1.0, 1
    for word in re.split(r"([ /()])", unit):
        power = -1 if word == "/" else power
        if len(word) > 1 and word[1:] in ("m", "N", "rad"):
            size *= _PREFIXES[word[0]] ** power
    return size


def read(text: str) -> float:
    """A number with its unit, as "75.7 N/mm", in units without prefixes."""
    number, _, unit = text.replace("\u2212", "-").partition(" ")
    return float(number) * si(unit)
