r"""Limits of joints and of the legs of platforms.

The mechanism can come to rest on limits of joints and of the lengths of legs. It cannot
on limits of the angles of the legs' joints, of distances between legs, and of their
forces: these limit its use.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from copy import copy
from typing import Protocol
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from cartstiff.core import numerics
from cartstiff.core.arrays import Array
from cartstiff.core.lazily import cached_property
from cartstiff.core.mechanisms.contract import Mechanism
from cartstiff.core.mechanisms.elastic import ElasticMechanism
from cartstiff.core.notes import Note
from cartstiff.core.potentials.springs import Springs
from cartstiff.core.units import Units, engineering

#: Round-off of a quantity at its limit, relative to the quantity or to its natural size.
_ROUNDOFF = numerics.LIMIT_SLACK
# Largest plausible deflections: of a joint in rad, of the tip over the reach, of a leg
# over its length.
MAX_WIND_UP, MAX_RELATIVE_DEFLECTION = float(np.radians(5.0)), 0.1
# Angles beyond their limits look like degrees if they are larger than this, angles
# without limits if they are larger than twice this, those of a pose if they are larger
# than this.
_TURN = 2.0 * np.pi
_DEGREES = ". Degrees? Angles are in radians"


#: A quantity beyond its limits: name, value, unit, lower and upper limit.
_Beyond = tuple[str, float, str, float, float]


class _Placed(Protocol):
    """Coordinates and the pose of M, on which limits depend."""

    @property
    def q(self) -> Array: ...
    @property
    def pose(self) -> Array: ...


class Limits:
    """Limits of a mechanism's coordinates, or of a platform's legs.

    Parameters
    ----------
    mechanism : Mechanism
        Its infinite limits are left out.
    ignore : bool
        Leave all limits out.
    contacts : bool
        Only limits on which the mechanism can come to rest: of joints and lengths of
        legs.

    Attributes
    ----------
    names : tuple of str
        Names of the limited quantities.
    lower, upper : ndarray (m,)
        Bounds, in rad or length units.
    columns : ndarray of int (m,)
        Coordinates, or legs, that are limited.
    are_angles : ndarray of bool (m,)
        Which are angles: of joints that turn, and of joints of a platform's legs.
    legs : Mechanism or None
        That with limited legs.
    left_out : ndarray of int (m,)
        -1 where the lower, 1 where the upper bound is left out, see `leaving_out`.
    """

    def __init__(
        self, mechanism: Mechanism, ignore: bool = False, *, contacts: bool = False
    ) -> None:
        self.legs = mechanism if len(mechanism.points) else None
        bounds = {} if ignore else mechanism.bounds
        self._more = [] if contacts or ignore else mechanism.quantities()
        turns = {c.name: c.type == "revolute" for c in mechanism.coordinates}
        every = [(name, *pair, turns.get(name, False)) for name, pair in bounds.items()]
        self.columns = np.flatnonzero([np.isfinite(row[1:3]).any() for row in every])
        rows = [every[j] for j in self.columns]
        for quantities in self._more:
            rows += quantities.rows
        names, lower, upper, are_angles = zip(*rows, strict=True) if rows else ((),) * 4
        self.names: tuple[str, ...] = tuple(names)
        self.lower, self.upper = np.array(lower, float), np.array(upper, float)
        self.are_angles = np.array(are_angles, bool)
        self.left_out = np.zeros(len(self.columns), int)

    def __len__(self) -> int:
        return len(self.names)

    def values(self, q: Array, pose: Array) -> Array:
        """Return the quantities (..., m) at coordinates q (..., n) and poses
        (..., 4, 4) of M.
        """
        every = q if self.legs is None else self.legs.bounded(q, pose)
        own = np.asarray(every[..., self.columns])
        parts = [own, *(quantities.values(q, pose) for quantities in self._more)]
        return np.concatenate(parts, axis=-1) if self._more else own

    def holds(self, q: Array, pose: Array) -> bool:
        """Whether all quantities are within their limits at one posture,
        to the last digit.
        """
        if self.legs is None and not self._more:  # comparing lists is faster than arrays
            own = q.tolist()
            return all(low <= own[j] <= high for j, low, high in self._bounds)
        return not len(self) or bool(self._within(self.values(q, pose)))

    @cached_property
    def _bounds(self) -> list[tuple[int, float, float]]:
        """Column and bounds of each quantity, in plain numbers."""
        lists = self.columns.tolist(), self.lower.tolist(), self.upper.tolist()
        return list(zip(*lists, strict=True))

    def leaving_out(self, sides: Array) -> Limits:
        """Remove the lower bounds where `sides` (m,) is -1, the upper ones where it is 1.

        A quantity that is beyond a bound already does not come to rest on it.
        """
        if not sides.any():
            return self
        other = copy(self)
        vars(other).pop("_bounds", None)
        other.left_out = sides
        other.lower = np.where(sides < 0, -np.inf, self.lower)
        other.upper = np.where(sides > 0, np.inf, self.upper)
        return other

    def side(self, values: Array, sizes: Array | float = 1.0) -> Array:
        """-1 where a quantity (..., m) is below its limit, 1 above,
        0 within (to rounding).
        """
        roundoff = _ROUNDOFF * np.maximum(sizes, np.abs(values))
        below, above = values < self.lower - roundoff, values > self.upper + roundoff
        return np.where(below, -1, np.where(above, 1, 0))

    def exceeded(self, values: Array) -> Array:
        """Whether one of the quantities (..., m) is beyond its limits,
        so that `side` is not 0.
        """
        beyond = ~self._within(values)
        if beyond.any():  # some may be round-off or NaN
            beyond[beyond] = self.side(values[beyond]).any(axis=-1)
        return beyond

    def _within(self, values: Array) -> Array:
        return np.asarray(((values >= self.lower) & (values <= self.upper)).all(axis=-1))

    def excess(self, values: Array) -> Array:
        """Distance by which quantities (..., m) are beyond their limits; 0 within."""
        beyond = np.maximum(self.lower - values, values - self.upper)
        return np.where(self.side(values) == 0, 0.0, beyond)


#: Limits depend on the mechanism alone and are needed at every posture.
_CACHE: WeakKeyDictionary[Mechanism, dict[tuple[bool, bool], Limits]] = (
    WeakKeyDictionary()
)


def limits_of(
    mechanism: Mechanism, *, ignore: bool = False, contacts: bool = False
) -> Limits:
    """Return the limits of a mechanism, see `Limits`; they are cached."""
    known = _CACHE.setdefault(mechanism, {})
    limits = known.get((ignore, contacts))
    if limits is None:
        limits = known[ignore, contacts] = Limits(mechanism, ignore, contacts=contacts)
    return limits


def finite(numbers: Mapping[str, float]) -> dict[str, float | None]:
    """Return numbers for JSON: None where a limit is infinite."""
    return {name: x if np.isfinite(x) else None for name, x in numbers.items()}


def limit_notes(mechanism: Mechanism, posture: _Placed, what: str = "") -> list[Note]:
    """Return notes on quantities beyond their limits, and on angles that look
    like degrees.

    Parameters
    ----------
    mechanism : Mechanism
        The mechanism.
    posture : MechanismPosture
        Its posture; anything with `q` and `pose`.
    what : str
        Name of the posture, which precedes the message.
    """
    limits = limits_of(mechanism)
    large = _large_angles(mechanism, posture.q.tolist(), limits.names)
    if not large and limits.holds(posture.q, posture.pose):
        return []
    notes = []
    values = limits.values(posture.q, posture.pose)
    which = np.flatnonzero(limits.side(values))
    if which.size:
        length, are_angles = mechanism.units.length, limits.are_angles
        beyond = [
            (
                limits.names[i],
                float(values[i]),
                "rad" if are_angles[i] else length,
                limits.lower[i],
                limits.upper[i],
            )
            for i in which
        ]
        degrees = bool((are_angles[which] & (np.abs(values[which]) > _TURN)).any())
        notes.append(note_beyond(what, beyond, _DEGREES * degrees, code="beyond-limits"))
    if large:
        words = "; ".join(f"{name} is at {x:.6g} rad" for name, x in large.items())
        notes.append(Note("many-turns", f"{what}several turns: {words}{_DEGREES}", large))
    return notes


def _large_angles(
    mechanism: Mechanism, q: list[float], limited: Collection[str]
) -> dict[str, float]:
    """Angles without limits that may be in degrees, by name."""
    # Joints may turn several times; the angles of a pose rarely do.
    plausible = _TURN if mechanism.coordinates_are_pose else 2.0 * _TURN
    if max(map(abs, q), default=0.0) <= plausible:
        return {}
    return {
        c.name: x
        for c, x in zip(mechanism.coordinates, q, strict=True)
        if c.type == "revolute" and abs(x) > plausible and c.name not in limited
    }


def beyond_limits(notes: Iterable[Note]) -> list[str]:
    """Return sentences for a headline on quantities beyond their limits."""
    words = [note.message for note in notes if note.code == "beyond-limits"]
    return [f"{message[0].upper()}{message[1:]}." for message in words]


def tensions_of(elastic: ElasticMechanism, posture: _Placed) -> Array | None:
    """The tensions (m,) of a platform's legs at a posture; None for other mechanisms.

    Legs without a rest length have NaN.
    """
    springs = elastic.springs
    if springs is None or not len(elastic.mechanism.points):
        return None
    return springs.pull_at(posture.q, posture.pose)


def deflection_notes(elastic: ElasticMechanism, q: Array) -> list[Note]:
    """Return a note on joint deflections over 5 deg, and tip deflections over a tenth
    of the reach.

    Also on legs and cables that a load stretches by a tenth of their length; where rest
    lengths were given, or are those of springs without a platform, the stretch is
    intended.

    Parameters
    ----------
    elastic : ElasticMechanism
        The mechanism with its final rest positions.
    q : ndarray (n,)
        Its coordinates.
    """
    springs, chain, units = elastic.springs, elastic.mechanism, elastic.units
    if springs is None:
        return []
    if len(chain.points):
        return _stretched(elastic, springs, q)
    # Rigid joints and free joints have no spring torque at any position.
    if not (torque := springs.torque(q)).any():
        return []
    is_length = chain.is_length
    x = np.where(np.isnan(springs.rest) | (torque == 0.0), 0.0, q - springs.rest)
    x[list(chain.undriven)] = 0.0
    if not is_length.any() and np.abs(x).sum() <= MAX_WIND_UP:
        return []  # the deflection of the tip is small as well
    parts, angles = _wound_up(chain.names, np.where(is_length, 0.0, x), torque, units)
    values: dict[str, object] = {"wind_up": angles}
    if (reach := chain.reach) is not None:
        moved = numerics.norm((chain.at(q).pose - chain.at(q - x).pose)[:3, 3])
        if moved > MAX_RELATIVE_DEFLECTION * reach > 0.0:
            tip, whole = (engineering(x, units.length, 3) for x in (moved, reach))
            parts.append(f"the tip moves by {tip}, its reach is {whole}")
            values |= {"moved": moved, "reach": reach}
    if not parts:
        return []
    words = (
        f"{'; '.join(parts)}. Is the load meant, and the unit of the springs (1 N "
        "m/arcmin is "
    )
    return [Note("implausible-deflection", f"{words}3438 N m/rad)?", values)]


def _wound_up(
    names: Sequence[str], x: Array, torque: Array, units: Units
) -> tuple[list[str], dict[str, float]]:
    """Words for the joints with large deflections x (n,) in rad, and these by name.

    The three that wind up most, then the names of the others.
    """
    wound = np.flatnonzero(np.abs(x) > MAX_WIND_UP)
    wound = wound[np.argsort(-np.abs(x[wound]))].tolist()
    angles = {names[j]: float(x[j]) for j in wound}
    parts = [
        f"joint {names[j]!r} winds up by {np.degrees(abs(x[j])):.3g} deg under "
        f"{engineering(abs(torque[j]), units.moment, 3)}, at "
        f"{engineering(abs(torque[j] / x[j]), units.spring(False), 3)}"
        for j in wound[:3]
    ]
    if len(angles) > 3:
        parts.append(f"{', '.join(list(angles)[3:])}: more than 5 deg")
    return parts, angles


def stretch_is_doubted(mechanism: Mechanism, springs: Springs) -> NDArray[np.bool_]:
    """Which lines (m,) are legs or cables of a robot: springs without a platform
    may be soft.
    """
    return np.asarray(springs.cables | mechanism.has_legs)


def _stretched(elastic: ElasticMechanism, springs: Springs, q: Array) -> list[Note]:
    """Note on stretched legs of a platform, and cables, as `deflection_notes`."""
    if springs.balanced_at is None:
        return []
    posture, units = elastic.mechanism.at(q), elastic.units
    lengths, tensions = springs.positions(posture), springs.pull(posture)
    x = tensions / springs.stiffness
    is_long = np.abs(x) > MAX_RELATIVE_DEFLECTION * lengths
    long = np.flatnonzero(stretch_is_doubted(elastic.mechanism, springs) & is_long)
    if not long.size:
        return []
    long = long[np.argsort(-np.abs(x[long]))]
    names = elastic.spring_names
    words = "; ".join(
        f"{names[i]} changes its length of {engineering(lengths[i], units.length, 3)} by "
        f"{engineering(abs(x[i]), units.length, 3)} under "
        f"{engineering(abs(tensions[i]), units.force, 3)}, at "
        f"{engineering(springs.stiffness[i], units.spring(True), 3)}"
        for i in long[:3]
    )
    values = {"stretch": {names[i]: float(x[i]) for i in long}}
    question = "Is the load meant, and the unit of the springs (1 N/um is 1e6 N/m)?"
    return [Note("implausible-deflection", f"{words}. {question}", values)]


def note_beyond(what: str, beyond: list[_Beyond], more: str = "", *, code: str) -> Note:
    """Return a note on quantities beyond their limits."""
    words = [
        f"{name} is at {x:.6g} {unit}, its limits are {low:.6g} and {high:.6g}"
        for name, x, unit, low, high in beyond
    ]
    values = {
        name: finite({"value": x, "lower": float(low), "upper": float(high)})
        for name, x, _, low, high in beyond
    }
    return Note(code, f"{what}beyond limits: {'; '.join(words)}{more}", values)
