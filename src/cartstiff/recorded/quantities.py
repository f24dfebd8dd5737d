"""The table of quantities that are read from the stiffness of a posture.

An entry has its name, words, unit, required outputs, better end, and formula. A formula
takes *numbers* from a `Source`: floats in stacks of many postures (`batch.stacks`), or
recorded numbers for machine code (`batch.readings`). Sources compute
eigenvalues, and decide existence: a number that does not exist is NaN in a stack; a
recorded one gets the verdict `FALLBACK`, so that the posture is read from a stack.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import product
from operator import methodcaller
from types import MappingProxyType
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from cartstiff.answer.analysis.ellipsoids import Freedom, Others
from cartstiff.answer.analysis.matrices import ROTATION, TRANSLATION, UNITS
from cartstiff.answer.analysis.metrics import characteristic_length
from cartstiff.answer.vibration.modes import masses_that_move
from cartstiff.answer.vibration.response import Damping
from cartstiff.core.arrays import Array, checked_flag, checked_input, checked_unit
from cartstiff.core.errors import InputError, UnknownNameError
from cartstiff.core.matrix_names import OF_MANY
from cartstiff.core.mechanisms.elastic import ElasticMechanism
from cartstiff.core.statics.small_motions import kinetic_matrix
from cartstiff.core.stiffness.applied_load import Axes, LoadKind, wrench_in_body
from cartstiff.core.stiffness.compute import analyse
from cartstiff.core.units import Units
from cartstiff.recorded.known_numbers import keywords
from cartstiff.recorded.strength import (
    Drives,
    along_jacobian,
    effort_margin,
    has_as_many_drives_as_motions,
    largest_load,
)
from cartstiff.recorded.tape import absolute, larger, pick, square_root

#: Connections whose matrix may be asymmetric.
ASYMMETRIC = ("A", "load")


@dataclass(frozen=True)
class Settings:
    """Settings that the quantities of a map refer to.

    Attributes
    ----------
    connection : {"A", "B", "K", "F", "load"}
        The matrix that is read; "load" is the tangent under the load.
    length : float
        Characteristic length, one for all postures, in the mechanism's unit.
    direction : tuple of float, optional
        For stiffness along and about a direction.
    deflect : tuple of float, optional
        Wrench (moment, force) added to the load, whose linear deflection is computed;
        default the load itself.
    world : bool
        Whether `direction` and `deflect` are in the axes of F instead of the body's.
    load : LoadKind
        Behaviour of the load while the body moves.
    deflect_at : tuple of float
        Point of the body, in M, at which the wrench `deflect` acts.
    is_loaded : bool
        Whether a load is given.
    damping : Damping
        Damping of the vibrations, besides the mechanism's own dampers.
    drives : Drives
        Drives whose forces have limits.
    """

    connection: str = "B"
    length: float = 1.0
    direction: tuple[float, ...] | None = None
    deflect: tuple[float, ...] | None = None
    world: bool = False
    load: LoadKind = field(default_factory=LoadKind)
    deflect_at: tuple[float, ...] = (0.0, 0.0, 0.0)
    is_loaded: bool = False
    damping: Damping = field(default_factory=Damping)
    drives: Drives = field(default_factory=Drives)

    @classmethod
    def of(
        cls,
        elastic: ElasticMechanism,
        load: LoadKind,
        wrench: Array | None,
        load_axes: Axes,
        *,
        connection: str | None = None,
        length: float | None = None,
        direction: ArrayLike | None = None,
        deflect: ArrayLike | None = None,
        deflect_at: ArrayLike = (0.0, 0.0, 0.0),
        world: bool = False,
        damping: Damping | None = None,
    ) -> Settings:
        """Checked settings of a mechanism under a load; what is not given, as of maps.

        The connection is "load" where a load can act, else "B", and the length is the
        natural length at the default posture.
        """
        if connection is None:
            connection = default_connection(elastic, wrench)
        if connection not in OF_MANY:
            raise UnknownNameError("connection", connection, OF_MANY)
        if length is None:
            acting = keywords(elastic, wrench, load, load_axes)
            length = default_length(elastic, connection, **acting)
        added = None
        if deflect is not None:
            added = checked_input(deflect, (6,), "wrench of the deflection")
        return cls(
            connection,
            characteristic_length(given=length).value,
            None if direction is None else tuple(checked_unit(direction).tolist()),
            None if added is None else tuple(added.tolist()),
            checked_flag(world, "world"),
            load,
            tuple(checked_input(deflect_at, (3,), "point of the deflection").tolist()),
            wrench is not None,
            Damping() if damping is None else damping,
            Drives.of(elastic),
        )

    @property
    def matrix(self) -> str:
        """The matrix whose symmetric part is read: B for A,
        as it is the symmetric part.
        """
        return "B" if self.connection == "A" else self.connection

    @property
    def free(self) -> tuple[str, ...]:
        """Outputs needed for values with the other freedoms free."""
        if self.connection in ASYMMETRIC:
            name = self.connection
            return f"stiffness_{name}", f"compliance_{name}"
        return f"stiffness_{self.matrix}", *self.inverted

    @property
    def carried(self) -> tuple[str, ...]:
        """Output with the forces of drives."""
        return (self.drives.output,)

    @property
    def inverted(self) -> tuple[str, ...]:
        """Outputs needed for the inverse of the symmetric part."""
        if self.matrix == "load":
            return "compliance_B", "wrench"
        return (f"compliance_{self.matrix}",)


BLOCKS: dict[Freedom, slice] = {"rotation": ROTATION, "translation": TRANSLATION}
#: A number of one recorded posture, or those (N,) of a stack.
Numbers = Any
#: Several such numbers.
Rows = Sequence[Any] | Array


class Source:
    """Matrices of one recorded posture, or of a stack of many,
    and numbers derived from them.

    Each kind has eigenvalues of its own (`principal`, `spectrum`, `ends` and their
    `ratio`) and decides what exists (`where_positive`).

    Parameters
    ----------
    arrays : mapping of str to ndarray
        Outputs of `cartstiff.recorded.recording.analyse_many` by name, (N, ...) or
        recorded.
    settings : Settings
        Settings of the quantities.
    """

    #: Compliance (..., 6, 6) of the connection itself, and its symmetric part.
    own_C: Array

    def __init__(self, arrays: Mapping[str, Array], settings: Settings) -> None:
        self.arrays, self.settings = arrays, settings
        self._found: dict[str, Any] = {}

    def once(self, key: str, make: Callable[[], Any]) -> Any:
        """Cached result of `make` for a key."""
        if key not in self._found:
            self._found[key] = make()
        return self._found[key]

    def entries(self, name: str) -> Rows:
        """Entries of an output that is a row of numbers for every posture."""
        return self.arrays[name]

    def direction(self) -> Array:
        """Unit vectors (..., 3) of the direction, in body axes; rotated like a force."""
        u = np.array(self.settings.direction, float)
        return self._in_body([0.0, 0.0, 0.0, *(u / np.linalg.norm(u))], (0.0, 0.0, 0.0))[
            ..., 3:
        ]

    def deflection(self) -> Rows:
        """Twist (6, ...) under the given wrench, or under the load."""

        def make() -> Array:
            given, W = self.settings.deflect, self.arrays["wrench"]
            if given is not None:
                W = self._in_body(given, self.settings.deflect_at)
            return np.moveaxis((self.own_C @ W[..., None])[..., 0], -1, 0)

        twist: Array = self.once("deflection", make)
        return twist

    def _in_body(self, wrench: Sequence[float], at: Sequence[float]) -> Array:
        axes: Literal["world", "body"] = "world" if self.settings.world else "body"
        return wrench_in_body(wrench, self.arrays["pose"], at, axes)

    def rates_of_load(self) -> Callable[[int], Numbers]:
        """Rate of the force of each drive by the load."""
        if self.settings.drives.of_loops:
            raise InputError("the largest load of a closed chain has no derivatives")
        return along_jacobian(self)


def norm(values: Rows) -> Numbers:
    """Root of the sum of squares."""
    return square_root(sum(x * x for x in values))


def product_of(values: Rows) -> Numbers:
    """Product of numbers."""
    result: Numbers = 1.0
    for x in values:
        result = result * x
    return result


def _isotropy(s: Any) -> Numbers:
    values = s.spectrum()
    mean = sum(values[1:], values[0]) * (1.0 / 6.0)
    share = product_of([x / mean for x in values])
    return s.sixth_root(s.where_positive(share, values[0], 0.0))


def _natural_length(s: Any) -> Numbers:
    held = s.principal("stiffness", "translation", "held")
    free = s.principal("stiffness", "rotation", "free", of_held=True)
    value = product_of([x / y for x, y in zip(free, held, strict=True)])
    for least in (held[0], free[0]):
        value = s.where_positive(value, least)
    return s.sixth_root(value)


def _asymmetry(s: Source) -> Numbers:
    """`cartstiff.answer.analysis.asymmetry.largest_in_blocks` of K - K^T."""
    K, three = np.moveaxis(s.arrays["stiffness_A"], (-2, -1), (0, 1)), range(3)
    rr, tt, rt = (
        norm([K[i + r, j + c] for i in three for j in three])
        for r, c in ((0, 0), (3, 3), (0, 3))
    )
    coupling = square_root(rr * tt)
    worst: Numbers = 0.0
    for r, c, scale in (
        (0, 0, rr),
        (3, 3, tt),
        (0, 3, pick(0.0, coupling, coupling, rt)),
    ):
        size: Numbers = 0.0
        for i, j in product(three, three):
            size = larger(size, absolute(K[r + i, c + j] - K[c + j, r + i]))
        worst = larger(worst, size / pick(0.0, scale, scale, 1.0))
    return worst


@dataclass(frozen=True)
class Quantity:
    """A number that exists for every posture, or is NaN.

    Attributes
    ----------
    name, description : str
        For text and files.
    unit : str
        With {length}, {force} for the mechanism's units.
    function : callable
        From a `Source` to a number, or to those (N,) of a stack.
    needs : tuple of str
        Outputs of `cartstiff.recorded.recording.analyse_many`; {connection} is replaced
        by the connection, {matrix} by `Settings.matrix`, "inverse" by
        `Settings.inverted`, "free" by `Settings.free`, "forces" by `Settings.carried`.
    asks : {"direction", "deflect", "length", "damping", "effort"}, optional
        The setting that it depends on.
    better : {"larger", "smaller"}, optional
        Which end belongs to the better posture.
    is_recorded : bool
        Whether the formula can be recorded; else it is computed in stacks only.
    """

    name: str
    description: str
    unit: str
    function: Callable[[Any], Numbers] = field(repr=False)
    needs: tuple[str, ...]
    asks: Literal["direction", "deflect", "length", "damping", "effort"] | None = None
    better: Literal["larger", "smaller"] | None = "larger"
    is_recorded: bool = True

    def unit_in(self, units: Units) -> str:
        """The unit, with the mechanism's units of length and force."""
        return self.unit.format(length=units.length, force=units.force)

    def words(self, units: Units) -> dict[str, str]:
        """Unit, meaning and better end, as attributes of an xarray variable."""
        about = {"units": self.unit_in(units), "long_name": self.description}
        return about if self.better is None else {**about, "better": self.better}

    def outputs(self, settings: Settings) -> tuple[str, ...]:
        """Required outputs of `analyse_many` with these `settings`."""
        names = {"matrix": settings.matrix, "connection": settings.connection}
        several = {"inverse": settings.inverted, "free": settings.free}
        several["forces"] = settings.carried
        needed = [several.get(n) or (n.format(**names),) for n in self.needs]
        return tuple(dict.fromkeys(name for some in needed for name in some))


_PAIR, _FREE = ("stiffness_{matrix}", "inverse"), ("free",)
_DEFLECT = ("compliance_{connection}", "pose", "wrench")
_STIFF, _SOFT = UNITS.stiffness, UNITS.compliance
_OTHERS: tuple[Others, ...] = ("free", "held")


def _principal_quantities() -> Iterator[Quantity]:
    ends = ("min", "smallest", 0), ("max", "largest", 2)
    for kind, freedom, others, (end, which, column) in product(
        ("stiffness", "compliance"), ("translation", "rotation"), _OTHERS, ends
    ):
        is_stiff, locked = (
            kind == "stiffness",
            "rotation translation".replace(freedom, "").strip(),
        )
        yield Quantity(
            f"{'' if is_stiff else 'compliance_'}{freedom}_{others}_{end}",
            f"{which} principal {freedom}al {kind}, {locked} {others}",
            (_STIFF if is_stiff else _SOFT)[freedom],
            partial(_end, column=column, kind=kind, freedom=freedom, others=others),
            _PAIR if others == "held" else _FREE,
            better="larger" if is_stiff else "smaller",
        )


def _end(s: Any, column: int, **which: Any) -> Numbers:
    return s.principal(**which)[column]


def _directional_quantities() -> Iterator[Quantity]:
    axes: tuple[tuple[str, Freedom], ...] = (
        ("along", "translation"),
        ("about", "rotation"),
    )
    for (word, freedom), others in product(axes, _OTHERS):
        yield Quantity(
            f"{word}_{others}",
            f"stiffness {word} the direction, everything else {others}",
            _STIFF[freedom],
            methodcaller("on_axis", freedom, others),
            (*(_PAIR if others == "held" else _FREE), "pose"),
            "direction",
        )


def frequency_name(which: int) -> str:
    """Name of a frequency, counted from 0."""
    return f"frequency_{which + 1}"


def _vibration_quantities() -> Iterator[Quantity]:
    for i in range(6):
        words = f"natural frequency {i + 1} under the load, the lowest first"
        yield Quantity(
            frequency_name(i),
            words,
            "Hz",
            methodcaller("frequency", i),
            ("pose",),
        )
    for i in range(6):
        yield Quantity(
            f"damping_{i + 1}",
            f"damping ratio of mode {i + 1} under the load, the slowest first",
            "1",
            methodcaller("damping_ratio", i),
            ("pose",),
            "damping",
            is_recorded=False,
        )


def _condition_of(s: Any, freedom: Freedom) -> Numbers:
    return s.ratio(s.principal("stiffness", freedom, "held"))


#: Every quantity by name.
QUANTITIES: dict[str, Quantity] = {
    q.name: q
    for q in (
        *_principal_quantities(),
        *_directional_quantities(),
        Quantity(
            "deflection",
            "displacement of the frame's origin under the given wrench",
            "{length}",
            lambda s: norm(s.deflection()[3:]),
            _DEFLECT,
            "deflect",
            "smaller",
        ),
        Quantity(
            "deflection_angle",
            "rotation of the body under the given wrench",
            "rad",
            lambda s: norm(s.deflection()[:3]),
            _DEFLECT,
            "deflect",
            "smaller",
        ),
        Quantity(
            "condition",
            "condition number of K at the characteristic length",
            "1",
            lambda s: s.ratio(s.ends()),
            _PAIR,
            "length",
            "smaller",
        ),
        Quantity(
            "isotropy",
            "geometric over arithmetic mean of the eigenvalues of K",
            "1",
            _isotropy,
            _PAIR,
            "length",
        ),
        Quantity(
            "minimum",
            "smallest eigenvalue of K at the characteristic length",
            _STIFF["translation"],
            lambda s: s.ends()[0],
            _PAIR,
            "length",
        ),
        *(
            Quantity(
                f"{freedom}_condition",
                f"condition number of the {freedom}al block of K",
                "1",
                partial(_condition_of, freedom=freedom),
                _PAIR,
                better="smaller",
            )
            for freedom in reversed(BLOCKS)
        ),
        Quantity(
            "determinant",
            "determinant of K",
            UNITS.determinant,
            lambda s: product_of(s.spectrum()) * s.settings.length**6,
            _PAIR,
        ),
        Quantity(
            "unstable_directions",
            "number of negative eigenvalues of K",
            "1",
            methodcaller("unstable"),
            _PAIR,
            better="smaller",
        ),
        Quantity(
            "natural_length",
            "length at which rotation and translation are equally stiff",
            "{length}",
            _natural_length,
            _PAIR,
            better=None,
        ),
        Quantity(
            "asymmetry",
            "largest entry of K^A - (K^A)^T, relative to its block",
            "1",
            _asymmetry,
            ("stiffness_A",),
            better="smaller",
        ),
        Quantity(
            "connection_change",
            "largest relative change of stiffness by another choice of connection",
            "1",
            methodcaller("connection_change"),
            ("inverse", *(f"stiffness_{name}" for name in OF_MANY)),
            "length",
            "smaller",
            is_recorded=False,
        ),
        Quantity(
            "singular_value_ratio",
            "smallest over largest singular value of the Jacobian",
            "1",
            methodcaller("singular_value_ratio"),
            ("jacobian",),
            "length",
        ),
        Quantity(
            "manipulability",
            "product of the Jacobian's singular values, each joint in its own unit",
            "{length}^3",
            methodcaller("manipulability"),
            ("jacobian",),
        ),
        *_vibration_quantities(),
        Quantity(
            "moment",
            "size of the load's moment",
            UNITS.moment,
            lambda s: norm(s.entries("wrench")[:3]),
            ("wrench",),
            better=None,
        ),
        Quantity(
            "force",
            "size of the load's force",
            "{force}",
            lambda s: norm(s.entries("wrench")[3:]),
            ("wrench",),
            better=None,
        ),
        Quantity(
            "effort_margin",
            "least share of its limit that the force of a drive leaves",
            "1",
            effort_margin,
            ("forces",),
            "effort",
        ),
        Quantity(
            "largest_load",
            "how many times the load the drives hold, to first order",
            "1",
            largest_load,
            ("forces", "jacobian", "wrench"),
            "effort",
        ),
        Quantity(
            "energy",
            "potential energy of springs, gravity and loads",
            UNITS.moment,
            lambda s: s.entries("energy")[0],
            ("energy",),
            better=None,
        ),
    )
}
#: Those of this package, of which users add and replace some in `QUANTITIES`.
BUILT_IN = MappingProxyType(dict(QUANTITIES))


def is_own(name: str) -> bool:
    """Whether a user has defined the quantity."""
    return QUANTITIES.get(name) is not BUILT_IN.get(name)


#: Quantities that need the masses.
FREQUENCIES = frozenset(map(frequency_name, range(6)))


def quantity_named(name: str, own: Sequence[Quantity] = ()) -> Quantity:
    """Return the quantity with a name of `own` or of the table.

    Raises
    ------
    UnknownNameError
        For another name.
    """
    known = QUANTITIES | {quantity.name: quantity for quantity in own}
    if name not in known:
        raise UnknownNameError("quantity", name, known)
    return known[name]


def choose_quantities(
    names: Sequence[str],
    settings: Settings,
    elastic: ElasticMechanism,
    own: Sequence[Quantity] = (),
) -> tuple[Quantity, ...]:
    """Quantities by name (see `quantity_named`), checked against settings and mechanism.

    Raises
    ------
    UnknownNameError
        For a name that is not in `QUANTITIES`.
    InputError
        If a quantity needs a setting that is missing, is named twice, or does not exist
        for this kind of mechanism.
    """
    if settings.connection not in OF_MANY:
        raise UnknownNameError("connection", settings.connection, OF_MANY)
    if not names:
        raise InputError("no quantity was named", expected="one or more names")
    is_pushed = settings.is_loaded or settings.deflect is not None
    missing = {}
    if not settings.direction:
        missing["direction"] = "a direction (--direction, direction=)"
    if not is_pushed:
        missing["deflect"] = (
            "a wrench to deflect the body (--load, or --added-load, deflect=)"
        )
    chosen = []
    # Each by its name, with what it needs of the settings and of the mechanism.
    for name in names:
        if names.count(name) > 1:
            raise InputError("quantity given twice", got=repr(name))
        quantity = quantity_named(name, own)
        if (what := missing.get(quantity.asks or "")) is not None:
            raise InputError(f"the quantity {name} needs {what}")
        if quantity.asks == "effort" and not settings.drives.rows:
            raise InputError(
                f"the quantity {name} needs the limit of a drive's force",
                expected="effort in the file, or a robot that has some",
            )
        if name == "largest_load" and not settings.is_loaded:
            raise InputError(f"the quantity {name} needs a load (--load, wrench=)")
        if quantity.asks == "damping" and not settings.damping.acts_on(elastic):
            raise InputError(
                f"the quantity {name} needs damping", got="no ratio, no dampers"
            )
        mechanism = elastic.mechanism
        lines = len(mechanism.points) or 6
        is_held = name == "largest_load" and lines == 6
        if is_held and mechanism.closures:
            if not has_as_many_drives_as_motions(elastic):
                raise InputError(
                    f"the quantity {name} is not defined for a closed chain whose drives "
                    "share a load by their stiffness, or whose links give",
                    expected="as many drives as motions, and no rigid or compliant one "
                    "besides; or cartstiff.capacity at each posture",
                )
        elif "jacobian" in quantity.needs and (mechanism.closures or lines != 6):
            raise InputError(
                f"the quantity {name} is not defined for a mechanism with closures, or "
                "lines "
                "other than six",
                expected="a serial chain or a platform on six legs",
            )
        if name == "manipulability":
            quantity = replace(quantity, unit=_manipulability_unit(elastic))
        chosen.append(quantity)
    return tuple(chosen)


def _manipulability_unit(elastic: ElasticMechanism) -> str:
    """Unit of the product of singular values: each joint counts in its own unit."""
    mechanism = elastic.mechanism
    slides = int(mechanism.is_length.sum())
    if mechanism.coordinates_are_pose:
        slides = 6  # what moves are the legs
    elif len(mechanism.coordinates) < 6 or (slides and len(mechanism.coordinates) > 6):
        return "mixed, of rad and {length}"
    return f"{{length}}^{3 - slides}"


def default_connection(elastic: ElasticMechanism, wrench: Array | None = None) -> str:
    """The matrix to read: "load" (tangent under the load) if a load can act, else "B"."""
    if wrench is not None:
        return "load" if wrench.any() else "B"
    return "load" if elastic.potentials or elastic.may_be_loaded else "B"


def default_length(
    elastic: ElasticMechanism, connection: str = "B", **load: Any
) -> float:
    """Characteristic length of a map: the natural length at the default posture,
    or one unit.

    `load` as `wrench` and its kind in `cartstiff.analyse`.
    """
    here = analyse(elastic, **load).at()
    length = characteristic_length(*here.pair(connection, "held")).value
    return float(f"{length:.6g}")  # the same digits on every processor


def check_masses(chosen: Sequence[Quantity], elastic: ElasticMechanism) -> None:
    """Refuse vibrations of a mechanism in which nothing that moves has a mass."""
    names = [q.name for q in chosen if q.name in FREQUENCIES or q.asks == "damping"]
    if not names or masses_that_move(elastic):
        return
    at_rest = elastic.mechanism.at(elastic.q)
    full = kinetic_matrix(at_rest, elastic.terms(), elastic.units)
    if full is None or not np.diag(full).any():
        raise InputError(
            f"the quantity {names[0]} needs masses",
            expected="inertias in the robot's file, body and legs.mass, or a payload",
            got=f"nothing that moves in {elastic.name} has a mass",
        )


def check_used(settings: Settings, chosen: Sequence[Quantity]) -> None:
    """Refuse settings that none of the chosen quantities needs."""
    asked = {quantity.asks for quantity in chosen}
    for what, is_given, of in (
        ("direction", settings.direction is not None, ("direction",)),
        ("wrench of the deflection", settings.deflect is not None, ("deflect",)),
        ("damping", settings.damping != Damping(), ("damping",)),
    ):
        if is_given and asked.isdisjoint(of):
            names = [q.name for q in QUANTITIES.values() if q.asks in of]
            raise InputError(
                "is given, and no quantity needs it",
                where=what,
                expected="one of " + ", ".join(names[:4]) + ", ..." * (len(names) > 4),
                got=", ".join(q.name for q in chosen) or "no quantity",
            )
    for what, is_given, needed in (
        ("world", settings.world, ("direction", "deflect")),
        ("deflect_at", any(settings.deflect_at), ("deflect",)),
    ):
        if is_given and all(getattr(settings, name) is None for name in needed):
            raise InputError(
                f"is about {' and '.join(needed)}, and none is given",
                where=what,
                expected="load_axes, load_at for the load",
            )
