"""Texts of the options of ``cartstiff identify``, checked."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from typing import Any

from cartstiff.errors import InputError, UnknownNameError
from cartstiff.parsing import parse_numbers

_VALUE = re.compile(r"([-+]?[\d.]+(?:[eE][-+]?\d+)?)\s*\[?([A-Za-z][^\[\]]*)?\]?")


def units_of(text: str | None) -> dict[str, str]:
    """Default units by kind of quantity, from "mm,deg"."""
    from cartstiff.loading.tables import UNITS

    of_kind: dict[str, str] = {}
    for unit in (text or "").split(",") if text is not None else ():
        kinds = [kind for kind, units in UNITS.items() if unit.strip() in units]
        if not kinds:
            raise UnknownNameError(
                "unit", unit.strip(), [u for us in UNITS.values() for u in us], where="--units"
            )
        if kinds[0] in of_kind:
            raise InputError(f"two units of {kinds[0]}", where="--units", got=text)
        of_kind[kinds[0]] = unit.strip()
    return of_kind


def _pairs(texts: Iterable[str], option: str) -> dict[str, str]:
    """``NAME=TEXT`` of an option that may be given several times."""
    pairs: dict[str, str] = {}
    for text in texts:
        name, equals, value = text.partition("=")
        if not equals or not name.strip() or not value.strip():
            raise InputError("cannot be used", where=option, expected="NAME=VALUE", got=repr(text))
        if name.strip() in pairs:
            raise InputError("given twice", where=option, got=repr(name.strip()))
        pairs[name.strip()] = value.strip()
    return pairs


def deviations_of(texts: Iterable[str], units: Mapping[str, str]) -> dict[str, float]:
    """Standard deviations by column in SI, from "dx=0.02 mm"."""
    from cartstiff.identify.measurements import MEASURED
    from cartstiff.loading.tables import UNITS

    deviations = {}
    for name, text in _pairs(texts, "--sd").items():
        if name not in MEASURED:
            raise UnknownNameError("column", name, MEASURED, where="--sd")
        kind = MEASURED[name]
        match = _VALUE.fullmatch(text)
        number, unit = (match[1], match[2]) if match else (text, None)
        known = UNITS[kind]
        if unit is None and kind not in units:
            raise InputError(
                f"--sd of {name!r} declares no unit",
                where="--sd",
                got=text,
                expected=f"a number with one of {', '.join(known)}",
            )
        unit = (unit or units[kind]).strip()
        if unit not in known:
            raise UnknownNameError("unit", unit, known, where=f"--sd {name}")
        value = parse_numbers(number, f"--sd {name}", 1)[0] * known[unit]
        if not value > 0.0:
            raise InputError(
                "cannot be used", where=f"--sd {name}", expected="above zero", got=text
            )
        deviations[name] = value
    return deviations


def stiffnesses_of(texts: Iterable[str], option: str, count: int) -> dict[str, list[float]]:
    """Numbers by spring, from "NAME=K" or "NAME=K,DEVIATION"."""
    return {
        name: parse_numbers(text, f"{option} {name}", count)
        for name, text in _pairs(texts, option).items()
    }


def in_own_units(
    springs: Mapping[str, list[float]], a: float, elastic: Any
) -> dict[str, list[float]]:
    """Stiffnesses by spring where lengths of `elastic` are a times as large in number."""
    from cartstiff.mechanisms.elements import Elements

    elements = Elements(elastic)
    slides = dict(zip(elements.names, elements.is_length, strict=True))
    slides |= {c.name: c.is_length for c in elastic.mechanism.coordinates}
    return {
        name: [k / a if slides.get(name) else k * a for k in numbers]
        for name, numbers in springs.items()
    }


def ties_of(texts: Iterable[str]) -> list[list[str]]:
    """Springs that are equal, from "A=B=C"."""
    return [[name.strip() for name in text.split("=")] for text in texts]


def reject_of(text: str | None) -> float | str | None:
    """A rule: "suspects", or a number of standard deviations."""
    if text is None or text == "suspects":
        return text
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        raise InputError(
            "unknown rule",
            where="--reject",
            got=repr(text),
            expected="suspects, or a number of standard deviations",
        )
    return number
