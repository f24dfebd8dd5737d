"""Notes on implausible numbers of a file, which are used as they are written."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from cartstiff.core import numerics
from cartstiff.core.arrays import Array
from cartstiff.core.notes import Note

#: rad; a larger angle of a rotation looks like degrees.
_MAX_ANGLE = 2.0 * math.pi
#: m; a larger length of a robot looks like millimetres.
_MAX_LENGTH = 50.0
#: N/m^2; the softest rubber has a larger modulus.
_MIN_MODULUS = 1e4
#: Largest plausible stretch of a spring, over its length.
_MAX_STRETCH = 0.9
#: Smallest plausible radius of gyration over a platform's size; its inverse is the
#: largest.
_MIN_GYRATION = 0.01


def is_inertia(moments: Array, share: float = numerics.NEGLIGIBLE_DIFFERENCE) -> bool:
    """Whether a symmetric matrix (3, 3) is the inertia of some body: its principal
    moments form a triangle.

    `share` of the largest is rounding. Rods, such as two point masses, have a moment of
    zero, thin plates meet the rule with equality.
    """
    small, middle, large = np.linalg.eigvalsh(moments)
    rounding = numerics.NEGLIGIBLE_DIFFERENCE * large
    return bool(small >= -rounding and small + middle >= (1.0 - share) * large)


def large_angles(angles: Mapping[str, Sequence[float]]) -> list[Note]:
    """Return a note on the angles that are more than a turn."""
    large = {name: list(a) for name, a in angles.items() if max(map(abs, a)) > _MAX_ANGLE}
    if not large:
        return []
    words = "; ".join(f"{name} is {_numbers(a)} rad" for name, a in large.items())
    return [
        Note(
            "many-turns", f"several turns: {words}. Degrees? Angles are in radians", large
        )
    ]


def large_lengths(lengths: Mapping[str, Sequence[float]]) -> list[Note]:
    """Return a note on the lengths [m] that look like millimetres."""
    large = {
        name: list(x) for name, x in lengths.items() if max(map(abs, x)) > _MAX_LENGTH
    }
    return _doubtful(large, "m", "Millimetres? Lengths here are in metres")


def large_strains(strains: Mapping[str, float]) -> list[Note]:
    """A note on springs far from their rest lengths; `strains` are over the length."""
    large = {name: [x] for name, x in strains.items() if abs(x) > _MAX_STRETCH}
    words = "Over the length: is the rest length in another unit?"
    return _doubtful(large, "", words)


def gyration(file: Any) -> list[Note]:
    """Return a note on an inertia that does not fit its body's size,
    as kg m^2 in a file of mm.
    """
    body = file.body
    if body is None or body.inertia is None or not body.mass:
        return []
    radius = math.sqrt(max(abs(x) for row in body.inertia for x in row) / body.mass)
    size = max((math.hypot(*point) for point in file.platform), default=0.0)
    if radius == 0.0 or _MIN_GYRATION * size <= radius <= size / _MIN_GYRATION:
        return []
    words = (
        f"Beside {size:g} {file.units.length} of the platform: is body.inertia in kg and "
    )
    words += f"{file.units.length}^2?"
    return _doubtful(
        {"radius of gyration of the body": [radius]}, file.units.length, words
    )


def _doubtful(
    doubted: Mapping[str, Sequence[float]], unit: str, question: str
) -> list[Note]:
    if not doubted:
        return []
    some = list(doubted.items())[:6]
    words = "; ".join(f"{name} is {_numbers(x)} {unit}".rstrip() for name, x in some)
    words += "; ..." if len(doubted) > len(some) else ""
    return [Note("doubtful-units", f"{words}. {question}", dict(doubted))]


def file_notes(file: Any) -> list[Note]:
    """Return notes on a mechanism file's angles, lengths, moduli,
    and payload without gravity.
    """
    poses = dict(_each(file, "", "PoseModel", "Placement"))
    notes = large_angles({f"{place}.rpy": pose.rpy for place, pose in poses.items()})
    lengths: dict[str, Sequence[float]] = {}
    if file.kind in ("stewart-gough", "springs"):
        notes += gyration(file)
        for key in ("base", "platform"):
            for i, point in enumerate(getattr(file, key), start=1):
                lengths[f"{key}.{i}"] = point
    else:
        beams = dict(_each(file, "", "BeamModel"))
        lengths |= {f"{place}.length": [beam.length] for place, beam in beams.items()}
        moduli = {f"{place}.E": [beam.E] for place, beam in beams.items()}
        soft = {place: E for place, E in moduli.items() if E[0] < _MIN_MODULUS}
        notes += _doubtful(soft, "N/m^2", "Gigapascals? Moduli are in N/m^2")
        if file.payload is not None:
            lengths["payload.com"] = file.payload.com
    # With a key for them lengths are meant in the file's own unit.
    if "units" not in file.model_fields_set:
        lengths |= {f"{place}.xyz": pose.xyz for place, pose in poses.items()}
        notes += large_lengths(lengths)
    mass = file.payload.mass if file.payload else 0.0
    if file.gravity is None and mass > 0:
        words = f"the file names a payload of {mass:g} kg and no gravity"
        words += ": it weighs nothing"
        notes.append(Note("weightless", words, {"payload": mass}))
    return notes


def _each(value: Any, place: str, *forms: str) -> Iterator[tuple[str, Any]]:
    """Yield all entries of some models in a file with their keys."""
    inner: Iterable[tuple[str, Any]] = ()
    if type(value).__name__ in forms:
        yield place, value
    elif hasattr(value, "model_fields_set"):
        inner = ((key, getattr(value, key)) for key in value.model_fields_set)
    elif isinstance(value, dict):
        inner = value.items()
    elif isinstance(value, list) and "LegModel" in {type(x).__name__ for x in value[:1]}:
        inner = ((str(i), entry) for i, entry in enumerate(value, start=1))
    for key, entry in inner:
        yield from _each(entry, ".".join(filter(None, (place, key))), *forms)


def _numbers(values: Sequence[float]) -> str:
    if len(values) > 1:
        return f"({', '.join(f'{x:g}' for x in values)})"
    return f"{values[0]:g}"
