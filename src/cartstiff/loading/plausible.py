"""What a file says that a person can hardly mean: named, and taken as it is written."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from cartstiff.notes import Note

if TYPE_CHECKING:
    from cartstiff.loading.platform_schema import PlatformFile, SpringsFile

#: rad; a rotation that is written as more than a turn looks like degrees.
_TURN = 2.0 * math.pi
#: m; a length of a robot beyond this looks like millimetres.
_LARGE = 50.0
#: N/m^2; the softest rubber has a modulus above this.
_SOFT = 1e4
#: Share of its length by which hardly a spring is stretched.
_STRETCHED = 0.9
#: Share of a platform's size below which no body's radius of gyration is, nor above its inverse.
_GYRATION = 0.01


def turned(angles: Mapping[str, Sequence[float]]) -> list[Note]:
    """Names the angles among these that are more than a turn."""
    large = {name: list(a) for name, a in angles.items() if max(map(abs, a)) > _TURN}
    if not large:
        return []
    words = "; ".join(f"{name} is {_numbers(a)} rad" for name, a in large.items())
    return [Note("many-turns", f"several turns: {words}. Degrees? Angles are in radians", large)]


def large_lengths(lengths: Mapping[str, Sequence[float]]) -> list[Note]:
    """Names the lengths among these, in m, that look like millimetres."""
    large = {name: list(x) for name, x in lengths.items() if max(map(abs, x)) > _LARGE}
    return _doubtful(large, "m", "Millimetres? Lengths here are in metres")


def stretched(strains: Mapping[str, float]) -> list[Note]:
    """Names springs that are far from their rest lengths; `strains` are over the length."""
    large = {name: [x] for name, x in strains.items() if abs(x) > _STRETCHED}
    words = "Over the length: is the rest length in another unit?"
    return _doubtful(large, "", words)


def gyration(file: PlatformFile | SpringsFile) -> list[Note]:
    """Names a body's inertia that is not of its size: kg m^2 in a file of mm is 1e-6 of it."""
    body = file.body
    if body is None or body.inertia is None or not body.mass:
        return []
    radius = math.sqrt(max(abs(x) for row in body.inertia for x in row) / body.mass)
    size = max((math.hypot(*point) for point in file.platform), default=0.0)
    if radius == 0.0 or _GYRATION * size <= radius <= size / _GYRATION:
        return []
    words = f"Beside {size:g} {file.units.length} of the platform: is body.inertia in kg and "
    words += f"{file.units.length}^2?"
    return _doubtful({"radius of gyration of the body": [radius]}, file.units.length, words)


def _doubtful(doubted: Mapping[str, Sequence[float]], unit: str, question: str) -> list[Note]:
    if not doubted:
        return []
    some = list(doubted.items())[:6]
    words = "; ".join(f"{name} is {_numbers(x)} {unit}".rstrip() for name, x in some)
    words += "; ..." if len(doubted) > len(some) else ""
    return [Note("doubtful-units", f"{words}. {question}", dict(doubted))]


def file_notes(file: Any) -> list[Note]:
    """Notes on a whole mechanism file: of angles, lengths, and a payload without gravity."""
    poses = dict(_each(file, "", "PoseModel"))
    notes = turned({f"{place}.rpy": pose.rpy for place, pose in poses.items()})
    lengths: dict[str, Sequence[float]] = {}
    if file.kind in ("stewart-gough", "springs"):
        notes += gyration(file)
        if "units" not in file.model_fields_set:
            for key in ("base", "platform"):
                lengths |= {f"{key}.{i}": p for i, p in enumerate(getattr(file, key), start=1)}
            lengths |= {f"{place}.xyz": pose.xyz for place, pose in poses.items()}
    else:
        beams = dict(_each(file, "", "BeamModel"))
        lengths |= {f"{place}.length": [beam.length] for place, beam in beams.items()}
        soft = {f"{place}.E": [beam.E] for place, beam in beams.items() if beam.E < _SOFT}
        notes += _doubtful(soft, "N/m^2", "Gigapascals? Moduli are in N/m^2")
        lengths |= {f"{place}.xyz": pose.xyz for place, pose in poses.items()}
        if file.payload is not None:
            lengths["payload.com"] = file.payload.com
    notes += large_lengths(lengths)
    if file.gravity is None and file.payload is not None and file.payload.mass > 0:
        mass = f"a payload of {file.payload.mass:g} kg"
        words = f"the file names {mass} and no gravity: it weighs nothing"
        notes.append(Note("weightless", words, {"payload": file.payload.mass}))
    return notes


def _each(value: Any, place: str, form: str) -> Iterator[tuple[str, Any]]:
    """All entries of a model in a file, by the keys that lead to them."""
    inner: Iterable[tuple[str, Any]] = ()
    if type(value).__name__ == form:
        yield place, value
    elif hasattr(value, "model_fields_set"):
        inner = ((key, getattr(value, key)) for key in value.model_fields_set)
    elif isinstance(value, dict):
        inner = value.items()
    elif isinstance(value, list) and value and type(value[0]).__name__ == "LegModel":
        inner = ((str(i), entry) for i, entry in enumerate(value, start=1))
    for key, entry in inner:
        yield from _each(entry, f"{place}.{key}" if place else key, form)


def _numbers(values: Sequence[float]) -> str:
    return f"({', '.join(f'{x:g}' for x in values)})" if len(values) > 1 else f"{values[0]:g}"
