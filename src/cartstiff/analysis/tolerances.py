"""Parameters of an elastic mechanism with their tolerances.

Parameters: the stiffness of every spring and line, a factor on that of every flexible
link (nominally 1), or, for measured springs, their compliances with the covariance of the
measurement; the masses; for chains the placement of each joint on its predecessor (not of
the virtual joints within a link), of the body frame on the last joint, and of the frames
that close loops (translations, and rotations about the placement's own axes); for
platforms the points of base and platform; the parameters of the mechanism's file; and,
for a mechanism in its own equilibrium, rest lengths and angles.

If closures are redundant, most changes of the geometry prevent assembly: such numbers
have no derivative and are named. The others are parameters as usual.

A mechanism with other parameters is analysed in the same posture (that of its file, if
the nominal one is) and under the same load. The rest positions follow, as in a robot
whose controller holds the posture: `analyse` chooses those that the file leaves open, or
all under a given load. Springs of platforms and closed chains with rest positions in the
file keep their forces (with the least change that balances the load).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from cartstiff import numerics
from cartstiff.arrays import Array, checked_array, checked_number, read_only
from cartstiff.errors import InputError, UndefinedError, UnknownNameError
from cartstiff.kinematics.placements import Placements
from cartstiff.mechanisms.contract import MechanismPosture
from cartstiff.mechanisms.elastic import ElasticMechanism
from cartstiff.mechanisms.elements import Elements
from cartstiff.mechanisms.identified import quantile
from cartstiff.potentials.contract import Number
from cartstiff.stiffness.compute import PostureStiffness, analyse, analyse_at

Results = Mapping[str, ArrayLike] | ArrayLike

# Step of the differences, in standard deviations: far enough for rounding not to matter.
_STEP = 0.2


@dataclass(frozen=True)
class Tolerance:
    """A parameter known up to a standard deviation.

    Attributes
    ----------
    nominal : float
        Expected value.
    deviation : float
        Standard deviation, not negative, in the parameter's unit.
    lower : float
        Values from here down do not exist, as for a compliance: differences stay above.
    """

    nominal: float
    deviation: float
    lower: float = -np.inf

    def __post_init__(self) -> None:
        """Check the numbers."""
        if not np.isfinite(self.nominal):
            raise InputError("nominal value must be finite", got=self.nominal)
        if not (np.isfinite(self.deviation) and self.deviation >= 0):
            raise InputError(
                "standard deviation cannot be used",
                expected="zero or more",
                got=self.deviation,
            )

    @property
    def step(self) -> float:
        """Step of differences, in standard deviations: twice it stays above `lower`."""
        room = self.nominal - self.lower
        return min(_STEP, 0.25 * room / self.deviation) if self.deviation > 0.0 else _STEP


@dataclass(frozen=True)
class Tolerances:
    """Standard deviations for whole groups of parameters.

    Attributes
    ----------
    stiffness : float
        Standard deviation of every spring stiffness, relative to it (0.05: five per
        cent).
    length : float
        Standard deviation of every coordinate of a joint placement or an attachment
        point, in units of length; of every rest length, where a mechanism finds its rest
        by itself.
    angle : float
        Standard deviation of every small rotation of a joint placement, in radians; of
        every rest angle, where a mechanism finds its rest by itself.
    """

    stiffness: float = 0.0
    length: float = 0.0
    angle: float = 0.0

    def __post_init__(self) -> None:
        for name in ("stiffness", "length", "angle"):
            value = checked_number(getattr(self, name), f"tolerance of the {name}")
            if value < 0:
                raise InputError(
                    f"tolerance of the {name} cannot be used",
                    expected="zero or more",
                    got=value,
                )

    @property
    def any(self) -> bool:
        """Whether any is above zero."""
        return max(self.stiffness, self.length, self.angle) > 0.0


@dataclass(frozen=True, eq=False)
class Propagation:
    """Uncertainty to first order of every number that a function returns.

    Attributes
    ----------
    names : tuple of str
        One per number: "key", or "key[i, j]" for entries of arrays.
    nominal : ndarray, shape (m,)
        Values at the nominal parameters.
    deviation : ndarray, shape (m,)
        Standard deviation.
    lower, upper : ndarray, shape (m,)
        Interval of the given level: nominal value -+ z deviation.
    level : float
        Probability of the interval.
    contributions : dict of str to ndarray (m,)
        Each parameter's share of the variance; NaN where that is zero.
    """

    names: tuple[str, ...]
    nominal: Array
    deviation: Array
    lower: Array
    upper: Array
    level: float
    contributions: dict[str, Array]

    def of(self, name: str) -> tuple[float, float, float, float]:
        """Nominal value, standard deviation, lower and upper end of one number."""
        if name not in self.names:
            raise UnknownNameError("result", name, self.names)
        i = self.names.index(name)
        columns = (self.nominal, self.deviation, self.lower, self.upper)
        nominal, deviation, lower, upper = (float(c[i]) for c in columns)
        return nominal, deviation, lower, upper


def _flatten(results: Results) -> tuple[tuple[str, ...], Array]:
    """Names and values of all numbers, in the order of the mapping."""
    items = results.items() if isinstance(results, Mapping) else [("result", results)]
    names: list[str] = []
    values: list[float] = []
    for key, value in items:
        array = checked_array(value, None, f"result {key}", copy=False, finite=False)
        for index in np.ndindex(array.shape):
            names.append(f"{key}[{', '.join(map(str, index))}]" if index else str(key))
            values.append(float(array[index]))
    return tuple(names), np.array(values)


def check_level(level: float) -> None:
    """Refuse a level that is no probability of an interval."""
    if not 0.0 < level < 1.0:
        raise InputError("level cannot be used", expected="between 0 and 1", got=level)


def _check(tolerances: Mapping[str, Tolerance], level: float) -> None:
    if not tolerances:
        raise InputError("no tolerances given", expected="at least one parameter")
    check_level(level)


def propagate_first_order(
    function: Callable[[dict[str, float]], Results],
    tolerances: Mapping[str, Tolerance],
    *,
    level: float = 0.95,
    correlation: ArrayLike | None = None,
    degrees: float = np.inf,
) -> Propagation:
    r"""Propagate standard deviations through the function's derivatives.

    Derivatives are fourth-order differences: the function is evaluated four times per
    parameter, within 0.4 standard deviations of the nominal values, and must be smooth
    there. Sorted eigenvalues are not where two of them meet (symmetric mechanisms).

    Parameters
    ----------
    function : callable
        From a dict of parameter values to a dict of numbers or arrays, or to one array;
        NaN entries stay NaN.
    tolerances : mapping of str to Tolerance
        Parameters.
    level : float
        Probability of the interval, normal distribution assumed.
    correlation : array_like (n, n), optional
        Correlation of the parameters, in their order; default: independent. A parameter's
        share of the variance then holds half of what it has in common with each other
        one, and may be negative.
    degrees : float
        Degrees of freedom of Student's t, where the deviations are estimates themselves.

    Raises
    ------
    InputError
        If there are no tolerances or the level is not between 0 and 1.
    """
    _check(tolerances, level)
    nominal = {name: float(t.nominal) for name, t in tolerances.items()}
    names, values_there = _flatten(function(dict(nominal)))
    moving = [name for name, t in tolerances.items() if t.deviation > 0]
    sigma = np.array([tolerances[name].deviation for name in moving])

    def at(offsets: Array) -> Array:
        shifted = dict(nominal)
        for name, offset in zip(moving, offsets, strict=True):
            shifted[name] += float(offset)
        labels, values = _flatten(function(shifted))
        if labels != names:
            raise InputError(
                "the function returns other numbers from one call to the next"
            )
        return values

    effects = np.zeros((len(names), len(moving)))
    for i, deviation in enumerate(sigma):
        step, share = np.zeros(len(moving)), tolerances[moving[i]].step
        step[i] = share * deviation
        near, far = at(step) - at(-step), at(2.0 * step) - at(-2.0 * step)
        effects[:, i] = (8.0 * near - far) / (12.0 * share)
    R = np.eye(len(moving))
    if correlation is not None:
        among = [i for i, t in enumerate(tolerances.values()) if t.deviation > 0]
        R = checked_array(correlation, (len(tolerances),) * 2, "correlation")[
            np.ix_(among, among)
        ]
    parts = effects * (effects @ R)
    variance = np.maximum(np.sum(parts, axis=1), 0.0)
    total = np.sqrt(variance)
    z = quantile(level, degrees)
    with np.errstate(invalid="ignore", divide="ignore"):
        shares = parts.T / variance
    contributions = {
        name: read_only(np.where(variance > 0, 0.0, np.nan)) for name in tolerances
    }
    contributions |= {name: read_only(s) for name, s in zip(moving, shares, strict=True)}
    return Propagation(
        names,
        read_only(values_there),
        read_only(total),
        read_only(values_there - z * total),
        read_only(values_there + z * total),
        level,
        contributions,
    )


#: Prefix of the names of the file's parameters.
_FILE = "parameter."
# Order of the groups of numbers: all others, those of the geometry, are third.
_ORDER = {"stiffness": 0, "mass": 1, "offset": 3, "rest": 4}


@dataclass(frozen=True, eq=False)
class UncertainParameters:
    """The parameters of a mechanism at a posture.

    Attributes
    ----------
    result : PostureStiffness
        The nominal mechanism, posture and load; never modified.
    tolerances : Tolerances
        Only parameters with a deviation above zero are listed. Without one of the
        stiffness, the compliances of measured springs are.
    reread : callable, optional
        From values of the file's parameters, by name, to the mechanism; without it these
        are none.
    at_rest : bool
        Whether rest positions are parameters: for a mechanism in its own equilibrium.
    """

    result: PostureStiffness
    tolerances: Tolerances
    reread: Callable[[Mapping[str, float]], ElasticMechanism] | None = None
    at_rest: bool = False

    @cached_property
    def numbers(self) -> dict[str, Number]:
        """The numbers that may vary, of springs, masses, geometry, and rest positions,
        in order.

        Not those without derivatives (see `Placements`); rest positions with `at_rest`
        only.
        """
        elastic = self.result.elastic
        own, fixed = elastic.numbers(), elastic.mechanism.numbers().keys()
        rests = {f"rest.{n}" for n in elastic.spring_names} if self.at_rest else set()

        def varies(name: str, number: Number) -> bool:
            group, _, rest = name.partition(".")
            if group == "rest":
                return name in rests and f"stiffness.{rest}" in own
            if group == "mass" or name not in fixed:
                return not number.is_positive or number.value > 0.0
            return name in self._placements.numbers

        kept = [name for name, number in own.items() if varies(name, number)]
        kept.sort(key=lambda name: _ORDER.get(name.partition(".")[0], 2))
        return {name: own[name] for name in kept}

    @cached_property
    def nominal(self) -> dict[str, float]:
        """Values of all parameters by name, whatever their tolerance.

        "stiffness.<spring>", "mass.<link>" (the link's centre and its moments of inertia
        about it stay; of legs all alike), the geometry's names of `named`,
        "rest.<spring>" and "parameter.<name>".
        """
        given = {name: number.value for name, number in self.numbers.items()}
        if self.reread is None:
            return given
        return given | {
            f"{_FILE}{n}": float(x) for n, x in self.result.elastic.parameters.items()
        }

    def value(self, name: str) -> float:
        """Nominal value of a parameter of `nominal` or of `named`."""
        given = self.nominal.get(name)
        return float(self.named[name].nominal) if given is None else given

    def size(self, name: str) -> float:
        """Natural size of a parameter's changes, in its unit."""
        if name not in self.numbers:
            unit = 1.0 if name.startswith(_FILE) else self.named[name].deviation
            return abs(self.value(name)) or unit
        if self.numbers[name].is_positive:
            return abs(self.value(name))
        return 1.0 if self.is_angle(name) else self.result.posture.length

    def is_angle(self, name: str) -> bool:
        """Whether a parameter of the geometry, or a rest position, is an angle."""
        number = self.numbers.get(name)
        return number is not None and not (number.is_positive or number.length)

    @cached_property
    def named(self) -> dict[str, Tolerance]:
        """Nominal value and deviation by name.

        "stiffness.<spring>", or "compliance.<spring>" where they were measured, with
        "coefficient.<joint> x^<power>" of polynomial springs; "placement.<joint>.x" to
        ".rz", "frame.x" to ".rz" and "closure.<frame>.x" to ".rz" for chains;
        "base.<leg>.x" and "platform.<leg>.x" to ".z" for platforms; "rest.<spring>".
        Rotations are nominally zero.
        """
        elastic, t = self.result.elastic, self.tolerances
        given: dict[str, Tolerance] = {}
        if t.stiffness > 0:
            for name, k in self.nominal.items():
                if name.startswith("stiffness."):
                    given[name] = Tolerance(k, t.stiffness * k)
        if t.stiffness == 0 and (known := elastic.identified) is not None:
            spread = np.sqrt(known.covariance.diagonal())
            for label, pattern, c, s in zip(
                known.labels, known.patterns, known.values, spread, strict=True
            ):
                lower = 0.0 if pattern.is_diagonal else -np.inf
                given[label] = Tolerance(float(c), float(s), lower=lower)
        for name, number in self.numbers.items():
            deviation = t.angle if self.is_angle(name) else t.length
            if deviation > 0 and not number.is_positive:
                given[name] = Tolerance(number.value, deviation)
        if not given:
            raise UndefinedError(
                "no parameter of this mechanism has a tolerance", code="no-parameters"
            )
        return given

    @cached_property
    def correlation(self) -> Array | None:
        """Correlation of the named parameters; None if all are independent."""
        known, names = self.result.elastic.identified, list(self.named)
        measured = [names.index(n) for n in (known.labels if known else ()) if n in names]
        if known is None or not measured:
            return None
        R = np.eye(len(names))
        spread = np.sqrt(known.covariance.diagonal())
        spread[spread == 0.0] = 1.0
        own = known.covariance / np.multiply.outer(spread, spread)
        np.fill_diagonal(own, 1.0)
        R[np.ix_(measured, measured)] = own
        return R

    @property
    def degrees(self) -> float:
        """Degrees of freedom of measured springs.

        Infinite for tolerances that are given.
        """
        known = self.result.elastic.identified
        if known is None or known.degrees is None or self.correlation is None:
            return float(np.inf)
        return known.degrees

    @cached_property
    def _elements(self) -> Elements:
        return Elements(self.result.elastic)

    def _measured_springs(
        self, elastic: ElasticMechanism, values: Mapping[str, float]
    ) -> ElasticMechanism:
        """The mechanism with other compliances of measured springs.

        Itself if none is named.
        """
        known = self.result.elastic.identified
        if known is None or values.keys().isdisjoint(known.labels):
            return elastic
        at = [values.get(n, c) for n, c in zip(known.labels, known.values, strict=True)]
        return self._elements.with_parameters(
            known.patterns, np.array(at, float) - known.values
        )

    @cached_property
    def _placements(self) -> Placements:
        elastic = self.result.elastic
        is_on_base = elastic.gravity is not None or bool(elastic.potentials)
        return Placements(elastic.mechanism, self.result.posture, is_on_base)

    @property
    def left_out(self) -> str | None:
        """Message on numbers of the geometry that are not varied though they have
        a tolerance.
        """
        asked = self.tolerances.length > 0 or self.tolerances.angle > 0
        return self._placements.words if asked else None

    def at(
        self,
        values: Mapping[str, float],
        start: Array | None = None,
        by_all: bool = False,
    ) -> PostureStiffness:
        """Stiffness of the mechanism with other parameters (those not named: nominal).

        Loops are closed from coordinates `start`, by default the nominal ones, and by
        moving all coordinates if `by_all`, as if the driven ones cannot stay.

        Raises
        ------
        CartstiffError
            If there is no mechanism with those parameters, or the chain cannot be closed.
        """
        return replace(self._analysed(values, start, by_all), load=self.result.load)

    def mechanism(self, values: Mapping[str, float]) -> ElasticMechanism:
        """The mechanism with other parameters (those not named: nominal).

        Rest positions are those of the nominal one, unless named; open where the file was
        read with other parameters, and leaves them open.
        """
        elastic = self.result.elastic
        parameters = {
            n.removeprefix(_FILE): x for n, x in values.items() if n.startswith(_FILE)
        }
        if parameters and self.reread is not None:
            elastic = self.reread(parameters)
        return self._measured_springs(elastic, values).with_numbers(values)

    def posture_of(self, elastic: ElasticMechanism, q: Array | None = None) -> Array:
        """Coordinates q, by default the nominal ones.

        If these are the file's, its present ones.
        """
        q = self.result.q if q is None else q
        return elastic.q if np.array_equal(q, self.result.elastic.q) else q

    def _analysed(
        self, values: Mapping[str, float], start: Array | None, by_all: bool
    ) -> PostureStiffness:
        there, nominal = self.result.posture, self.result.elastic.springs
        elastic = self.mechanism(values)
        q = self.posture_of(elastic)
        q = (
            start
            if start is not None and np.array_equal(elastic.q, self.result.elastic.q)
            else q
        )
        mechanism, springs = elastic.mechanism, elastic.springs
        posture = mechanism.closed(q, hold=() if by_all else None)
        if springs is None or nominal is None:
            return analyse(elastic, posture.q)
        if springs.gives_aside:
            W = self.result.wrench
            return analyse(elastic, posture.q, wrench=np.zeros(6) if W is None else W)
        if posture.closure is None and not posture.coordinates_are_pose:
            return analyse(elastic, posture.q, wrench=self.result.wrench)
        active = (springs.stiffness > 0) & np.isfinite(springs.stiffness)
        active[list(springs.laws)] = False
        active &= nominal.taut(there)
        before, x = nominal.positions(there), springs.positions(posture)
        forces = nominal.pull(there)
        rows = springs.rows(posture) * posture.coordinate_lengths
        asked, loaded = self.result.elastic_as_given, self.result._load_is_given
        is_open = np.isnan(nominal.rest if asked.springs is None else asked.springs.rest)
        if not (loaded or is_open.any()):
            forces = forces + self._change(elastic, posture, rows, forces, active)
        rest = nominal.rest + x - before
        rest[active] = x[active] - forces[active] / springs.stiffness[active]
        for j, law in springs.laws.items():
            rest[j] = x[j] - law.deflection_for(float(forces[j]))
        if loaded or is_open.any():  # `analyse` distributes the load among the springs
            rest[is_open] = np.nan
            elastic = replace(elastic, springs=springs.replaced(springs.stiffness, rest))
            return analyse(
                elastic, posture.q, wrench=self.result.wrench if loaded else None
            )
        springs = springs.replaced(springs.stiffness, rest)
        return analyse_at(replace(elastic, springs=springs), posture)

    def _change(
        self,
        elastic: ElasticMechanism,
        posture: MechanismPosture,
        rows: Array,
        forces: Array,
        active: Array,
    ) -> Array:
        """Least change of the springs' forces (m,) by which they carry the nominal load.

        `rows` (m, n) is the deflection of each spring per natural coordinate.
        """
        columns, others = posture.coordinate_lengths, elastic.evaluate(posture, False)
        W = np.zeros(6) if self.result.wrench is None else self.result.wrench
        missing = posture.motion.jacobian.T @ W - others.gradient
        missing = columns * missing - rows.T @ forces
        if posture.closure is not None:
            _, sizes, N = np.linalg.svd(posture.closure.jacobian * columns)
            N = N[int((sizes > numerics.RANK * sizes[0]).sum()) :]
            missing, rows = N @ missing, rows @ N.T
        change = np.zeros_like(forces)
        change[active] = np.linalg.lstsq(
            rows[active].T, missing, rcond=numerics.ROUNDOFF
        )[0]
        return change
