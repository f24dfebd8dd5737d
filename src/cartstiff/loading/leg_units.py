"""Files of legs by name in another unit of length: their numbers in metres.

Such a file is built in metres and its mechanism converted, as joints and links are. Its numbers
are all in its own units: a stiffness of what slides in N/mm, of what turns in N mm/rad.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from cartstiff.errors import InputError
from cartstiff.loading.leg_schema import NamedLegs, ParallelFile
from cartstiff.units import GivenStiffness

#: Powers of the unit of length in the numbers of entries.
_ENDS = {"radius": 1, "height": 1, "points": 1}
_BEAM = {
    "E": -2,
    "G": -2,
    "length": 1,
    "area": 2,
    "Iy": 4,
    "Iz": 4,
    "J": 4,
    "shear_area_y": 2,
    "shear_area_z": 2,
    "density": -3,
}
_LINE = {"points": 1, "stiffness": -1, "rest_length": 1}
_POSE = {"xyz": 1}


def in_metres(file: ParallelFile, metres: float) -> ParallelFile:
    """Return a file with its lengths in metres; one unit of its own has so many.

    Raises
    ------
    InputError
        For legs with a robot description, which is in metres, and for units of force.
    """
    if file.units.force != "N":
        raise InputError(
            "cannot be used",
            where="key units.force",
            expected="N",
            got=repr(file.units.force),
        )
    entries = file.legs if isinstance(file.legs, list) else [file.legs]
    if not all(isinstance(entry, NamedLegs) for entry in entries):
        raise InputError(
            "units are for legs by name: the files of robots are in m",
            where="key units",
            expected="m and N, or no units",
            got=file.units.length,
        )
    legs = [_legs(entry, metres) for entry in entries if isinstance(entry, NamedLegs)]
    given = {
        "legs": legs if isinstance(file.legs, list) else legs[0],
        "lines": [_scaled(line, metres, _LINE) for line in file.lines],
        "offset": _scaled(file.offset, metres, _POSE),
        "pose": None if file.pose is None else _scaled(file.pose, metres, _POSE),
        "payload": None
        if file.payload is None
        else _scaled(file.payload, metres, {"com": 1}),
    }
    return file.model_copy(update=given)


def _times(value: Any, factor: float) -> Any:
    """Number or nested lists of numbers times a factor; what has a unit of its own is in SI."""
    if isinstance(value, list):
        return [_times(one, factor) for one in value]
    is_number = isinstance(value, (int, float)) and not isinstance(value, GivenStiffness)
    return value * factor if is_number else value


def _scaled(model: Any, metres: float, powers: Mapping[str, int]) -> Any:
    changed = {
        key: _times(getattr(model, key), metres**power)
        for key, power in powers.items()
        if getattr(model, key) is not None
    }
    return model.model_copy(update=changed)


def _legs(entry: NamedLegs, metres: float) -> NamedLegs:
    main = "slide" if entry.chain[0] == "P" or entry.chain[1] in "PC" else "crank"
    driven = [main] if entry.actuated is None else entry.actuated
    slides = {name == "slide" for name in driven} or {main == "slide"}
    if len(slides) > 1 and entry.stiffness is not None:
        raise InputError(
            "one stiffness for joints that slide and that turn",
            where="key legs.stiffness",
            expected="springs by joint",
        )
    legs = _scaled(
        entry,
        metres,
        {
            "crank": 1,
            "rod": 1,
            "diameter": 1,
            "stiffness": -1 if slides == {True} else 1,
            "limits": int(main == "slide"),
        },
    )
    return legs.model_copy(
        update={
            "base": _scaled(entry.base, metres, _ENDS),
            "platform": _scaled(entry.platform, metres, _ENDS),
            "springs": {
                n: _spring(s, metres, n == "slide") for n, s in entry.springs.items()
            },
            "flexible": {
                name: _link(link, metres, name) for name, link in entry.flexible.items()
            },
        }
    )


def _spring(spring: Any, metres: float, slides: bool) -> Any:
    """Return a joint's spring; its torque law has powers of the deflection."""
    size, effort = (metres, 1.0) if slides else (1.0, metres)
    changed: dict[str, Any] = {
        "stiffness": _times(spring.stiffness, effort / size),
        "damping": _times(spring.damping, effort / size),
        "rest": _times(spring.rest, size),
    }
    if spring.polynomial is not None:
        powers = enumerate(spring.polynomial, start=1)
        changed["polynomial"] = [_times(c, effort / size**k) for k, c in powers]
    if (table := spring.points) is not None:
        points = [[x * size, y * effort] for x, y in table.points]
        changed["table"] = table.model_copy(update={"points": points})
    return spring.model_copy(update=changed)


def _link(link: Any, metres: float, name: str) -> Any:
    if link.mass is not None:
        raise InputError(
            "a link with a mass matrix is in m",
            where=f"key legs.flexible.{name}",
            expected="no units, or no M",
        )
    changed: dict[str, Any] = {"offset": _scaled(link.offset, metres, _POSE)}
    if link.beam is not None:
        changed["beam"] = _scaled(link.beam, metres, _BEAM)
    if link.stiffness is not None:
        changed["stiffness"] = [
            [_times(k, metres ** (1 - (i > 2) - (j > 2))) for j, k in enumerate(row)]
            for i, row in enumerate(link.stiffness)
        ]
    return link.model_copy(update=changed)
