"""Units of lengths, forces, angles and stiffnesses, and numbers as people read them."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cache
from math import inf
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike

from cartstiff.core.arrays import Array, checked_vector, fixed
from cartstiff.core.errors import InputError

#: Units of length in m, of force in N.
LENGTHS = {
    "m": 1.0,
    "dm": 0.1,
    "cm": 0.01,
    "mm": 0.001,
    "um": 1e-6,
    "in": 0.0254,
    "ft": 0.3048,
}
FORCES = {
    "N": 1.0,
    "kN": 1e3,
    "mN": 1e-3,
    "daN": 10.0,
    "lbf": 4.4482216152605,
    "kgf": 9.80665,
}
#: Units of angle in rad.
ANGLES = {
    "rad": 1.0,
    "mrad": 1e-3,
    "urad": 1e-6,
    "deg": np.pi / 180.0,
    "arcmin": np.pi / 10800.0,
    "arcsec": np.pi / 648000.0,
}
#: Units of stiffness in SI, without blanks: force per length, and moment per angle.
LINEAR = {f"{f}/{u}": a / b for f, a in FORCES.items() for u, b in LENGTHS.items()}
TORSIONAL = {
    f"{f}{u}/{r}": a * b / c
    for f, a in FORCES.items()
    for u, b in LENGTHS.items()
    for r, c in ANGLES.items()
}
# Signs in units: of degrees, minutes, and two for micro; signs of products are removed.
_SIGNS: dict[str, str | None] = {
    "\u00b0": "deg",
    "\u00b5": "u",
    "\u03bc": "u",
    "'": "arcmin",
    "\u2032": "arcmin",
}
_SIGNS |= dict.fromkeys(" \t*.\u00b7\u22c5\u00a0")
_PLAIN = str.maketrans(_SIGNS)
_AMOUNT = re.compile(
    r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*\[?([^\d\[\]][^\[\]]*)\]?\s*"
)


def plain_unit(text: str) -> str:
    """Return a unit without blanks, dots and signs: "N·m/°" is "Nm/deg"."""
    return text.translate(_PLAIN)


class GivenStiffness(float):
    """A stiffness that was given with its unit: the number in N m/rad or N/m.

    Attributes
    ----------
    text : str
        The given text.
    is_length : bool
        Whether the unit is that of a spring that slides.
    """

    text: str
    is_length: bool

    @classmethod
    def read(cls, text: str, where: str | None = None) -> Self:
        """Read a text such as "392 N m/arcmin" or "20 N/um".

        Raises
        ------
        InputError
            If it is not a number and a unit of stiffness.
        """
        match = _AMOUNT.fullmatch(text)
        unit = plain_unit(match[2]) if match else ""
        if match is None or unit not in {**LINEAR, **TORSIONAL}:
            raise InputError(
                "not a stiffness",
                where=where,
                expected="a number, or one with its unit: N m/rad, N m/deg, N m/arcmin, "
                "N/m, "
                "kN/mm, N/um",
                got=repr(text),
            )
        given = cls(float(match[1]) * (LINEAR.get(unit) or TORSIONAL[unit]))
        given.text, given.is_length = text.strip(), unit in LINEAR
        return given

    def in_units(self, units: Units, is_length: bool, where: str | None = None) -> float:
        """Return the number in other units, for a spring that slides or turns.

        Raises
        ------
        InputError
            If the spring is of the other kind.
        """
        if is_length != self.is_length:
            raise InputError(
                f"unit is of a spring that {'slides' if self.is_length else 'turns'}",
                where=where,
                expected=f"a unit such as {'N/mm' if is_length else 'N m/arcmin'}",
                got=repr(self.text),
            )
        length, force = convert_length(SI, units)
        return float(self) * force * (1.0 / length if is_length else length)


def own_stiffness(
    value: Any, units: Units, is_length: bool, where: str | None = None
) -> Any:
    """Return a stiffness in these units; numbers without a unit are in them already."""
    if isinstance(value, str) and _AMOUNT.fullmatch(value):
        value = GivenStiffness.read(value, where)
    if isinstance(value, GivenStiffness):
        return value.in_units(units, is_length, where)
    return value


# Units for people: the first whose factor the value reaches is taken.
_PREFIXES = ((1e9, "G"), (1e6, "M"), (1e3, "k"), (1.0, ""), (1e-3, "m"), (1e-6, "µ"))
_STIFF = ((1e9, "MN/mm"), (1e6, "kN/mm"), (1e3, "N/mm"), (1.0, "N/m"))
_MILLI = re.compile(r"\bmm\b")
# Numbers outside this range are written with an exponent.
_MAX_PLAIN, _MIN_PLAIN = 1e5, 1e-3
# Factor by which half of a last digit is rounded away from zero, whatever it is in
# binary.
_ROUND_UP = 1.0 + 1e-12


def sized(size: float, unit: str) -> tuple[float, str]:
    """Return the unit in which people read a size, in the given unit: (1000.0, "N/mm").

    Millimetres, and centimetres of lengths, are converted to parts of the metre; unknown
    units are not changed.
    """
    metres, steps = _steps(unit)
    reached = abs(size) * metres * _ROUND_UP
    for step in steps:
        if reached >= step[0] or (not size and step[0] == 1.0):
            break
    return step[0] / metres, step[1]


@cache
def _steps(unit: str) -> tuple[float, tuple[tuple[float, str], ...]]:
    """Size of a unit in metres and the like, and the units that people read,
    the largest first.
    """
    head, _, tail = unit.partition("/")
    metres = 1e-3 ** (len(_MILLI.findall(head)) - len(_MILLI.findall(tail)))
    unit = _MILLI.sub("m", unit)
    if unit == "cm":
        metres, unit = 1e-2, "m"
    first = unit.split("/")[0].split(" ")
    steps: tuple[tuple[float, str], ...] = ((1.0, unit),)
    if unit == "N/m":
        steps = _STIFF
    elif first[0] in ("N", "J", "Hz", "m", "rad"):
        small = first in (["m"], ["rad"])
        steps = tuple((f, p + unit) for f, p in _PREFIXES if f <= 1.0 or not small)
    return metres, steps


def engineering(
    value: float | None,
    unit: str = "",
    digits: int = 4,
    least: float = 0.0,
    size: float | None = None,
) -> str:
    """Write a value for people: "75.7 N/mm", "7.54 kN m/rad", "3.9 mm";
    "-" where it is None.

    Values smaller than `least` are round-off and written as 0. The unit is of the value's
    own size, or of another `size`, so that several values have one.
    """
    if value is None or value != value:
        return "-"
    if abs(value) < least:
        value = 0.0
    of = value if size is None else size
    factor, name = (1.0, unit) if abs(of) == inf else sized(of, unit)
    x = value / factor * _ROUND_UP
    text = f"{x + 0.0:.{digits}g}"
    if 0.0 < abs(x) < _MIN_PLAIN or _MAX_PLAIN <= abs(x) < inf:
        mantissa, _, power = f"{x:.{digits - 1}e}".partition("e")
        text = f"{float(mantissa):g}e{int(power)}"
    elif "e" in text:
        text = f"{float(text):.15g}"
    return f"{text.replace('inf', '∞')} {name.removeprefix('1')}".rstrip()


@cache
def shown_unit(unit: str) -> tuple[str, float]:
    """The unit of texts for numbers of a unit, and their factor: ("N/mm", 0.001) for N/m.

    Lengths, also those per angle or force, angles, and forces per length have one; any
    other unit is that of texts.
    """
    shown, (over, _, under) = Units.shown_length, unit.partition("/")
    if unit == Units.angle:
        return Units.shown_angle, 1.0 / ANGLES[Units.shown_angle]
    if unit in LENGTHS:
        return shown, LENGTHS[unit] / LENGTHS[shown]
    if over in LENGTHS and under in (Units.angle, *FORCES):
        return f"{shown}/{under}", LENGTHS[over] / LENGTHS[shown]
    if over in FORCES and under in LENGTHS:
        return f"{over}/{shown}", LENGTHS[shown] / LENGTHS[under]
    return unit, 1.0


@dataclass(frozen=True)
class Units:
    """The units of all numbers of a mechanism; angles are radians."""

    angle: ClassVar[str] = "rad"

    length: str = "m"
    force: str = "N"

    #: Units of angles and lengths in texts and pictures; no number is stored in them.
    shown_angle: ClassVar[str] = "deg"
    shown_length: ClassVar[str] = "mm"

    @property
    def shown_per_radian(self) -> float:
        """One radian in the unit of shown angles."""
        return 1.0 / ANGLES[self.shown_angle]

    @property
    def shown_per_length(self) -> float:
        """One unit of length in that of shown lengths."""
        return LENGTHS[self.length] / LENGTHS[self.shown_length]

    @property
    def moment(self) -> str:
        """Unit of moments and energies."""
        return f"{self.force} {self.length}"

    @property
    def pitch(self) -> str:
        """Unit of the pitch of a screw."""
        return f"{self.length}/{self.angle}"

    @property
    def determinant(self) -> str:
        """Unit of the determinant of a 6x6 stiffness."""
        return f"{self.force}^6/{self.angle}^3"

    @property
    def wrench(self) -> tuple[str, ...]:
        """Units of the six components (moment, force)."""
        return (self.moment,) * 3 + (self.force,) * 3

    @property
    def blocks(self) -> dict[str, str]:
        """Units of the 3x3 blocks of a stiffness: r moment or rotation,
        t force or translation.
        """
        m, f, x = self.moment, self.force, self.length
        return {
            "rr": f"{m}/{self.angle}",
            "rt": f,
            "tr": f"{f}/{self.angle}",
            "tt": f"{f}/{x}",
        }

    @property
    def stiffness(self) -> dict[str, str]:
        """Units of a stiffness that resists translations or rotations."""
        return {"translation": self.blocks["tt"], "rotation": self.blocks["rr"]}

    @property
    def compliance(self) -> dict[str, str]:
        """Units of the inverse of such a stiffness."""
        of = self.blocks_of_compliance
        return {"translation": of["tt"], "rotation": of["rr"]}

    @property
    def blocks_of_compliance(self) -> dict[str, str]:
        """Units of the 3x3 blocks of a compliance, named as in `blocks`."""
        m, f, a, x = f"({self.moment})", self.force, self.angle, self.length
        return {"rr": f"{a}/{m}", "rt": f"{a}/{f}", "tr": f"{x}/{m}", "tt": f"{x}/{f}"}

    def coordinate(self, is_length: bool) -> str:
        """Unit of a coordinate that slides or turns."""
        return self.length if is_length else self.angle

    def effort(self, is_length: bool) -> str:
        """Unit of the force of a coordinate that slides,
        or the moment of one that turns.
        """
        return self.force if is_length else self.moment

    def spring(self, is_length: bool) -> str:
        """Unit of the stiffness of a coordinate that slides or turns."""
        return self.blocks["tt" if is_length else "rr"]

    @property
    def newtons(self) -> float:
        """Newtons in the unit of force.

        Masses are kg and accelerations m/s^2 in all units.
        """
        return FORCES[self.force]

    @property
    def kilogram(self) -> float:
        """One kilogram in the unit of mass that belongs to force, length and second."""
        length, force = convert_length(SI, self)
        return force / length

    def to_dict(self) -> dict[str, str]:
        """Return plain data for JSON."""
        return {"length": self.length, "force": self.force, "angle": self.angle}


SI = Units()
#: m/s^2 on the earth.
EARTH = 9.81
# m/s^2; no planet and no machine in motion has more, but 386 in/s^2 and 981 cm/s^2 are
# more.
_MAX_GRAVITY = 300.0


def checked_gravity(
    gravity: ArrayLike | None, units: Units = SI, where: str | None = None
) -> Array | None:
    """Check an acceleration in m/s^2 (3,); return None where it is absent or zero.

    Raises
    ------
    InputError
        For a field that is meant in other units, or too strong to be meant.
    """
    if gravity is None:
        return None
    field = checked_vector(gravity, 3, "gravity", where=where)
    size = float(np.linalg.norm(field))
    if size == 0.0:
        return None
    in_units = EARTH * convert_length(SI, units)[0]
    other = units.length != SI.length and abs(size - in_units) < 0.02 * in_units
    if size > _MAX_GRAVITY or other:
        raise InputError(
            "gravity is in m/s^2, whatever the units of the mechanism",
            where=where,
            expected=f"at most {_MAX_GRAVITY:g}; {EARTH:g} on the earth",
            got=f"{size:g}",
        )
    return fixed(field)


def convert_length(unit_from: Units, unit_to: Units) -> tuple[float, float]:
    """The factors (length, force) that convert numbers from one unit system to another.

    Raises
    ------
    InputError
        For a unit that is not known.
    """
    for units in (unit_from, unit_to):
        if units.length not in LENGTHS:
            raise InputError(
                "unknown length unit", expected=", ".join(LENGTHS), got=units.length
            )
        if units.force not in FORCES:
            raise InputError(
                "unknown force unit", expected=", ".join(FORCES), got=units.force
            )
    length = LENGTHS[unit_from.length] / LENGTHS[unit_to.length]
    force = FORCES[unit_from.force] / FORCES[unit_to.force]
    return length, force
