"""Parameters of an elastic mechanism with their tolerances.

Parameters: the stiffness of every spring and line, a factor on that of every flexible link
(nominally 1), or, for measured springs, their compliances with the covariance of the measurement;
the masses; for chains the placement of each joint on its predecessor (not of the virtual joints
within a link), of the body frame on the last joint, and of the frames that close loops
(translations, and rotations about the placement's own axes); for platforms the points of base and
platform; the parameters of the mechanism's file; and, for a mechanism in its own equilibrium, rest
lengths and angles.

If closures are redundant, most changes of the geometry prevent assembly: such numbers have no
derivative and are named. The others are parameters as usual.

A mechanism with other parameters is analysed in the same posture (that of its file, if the nominal
one is) and under the same load. The rest positions follow, as in a robot whose controller holds the
posture: `analyse` chooses those that the file leaves open, or all under a given load. Springs of
platforms and closed chains with rest positions in the file keep their forces (with the least change
that balances the load).
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
from cartstiff.mechanisms.chain import Chain, ChainPosture
from cartstiff.mechanisms.contract import MechanismPosture
from cartstiff.mechanisms.elastic import ElasticMechanism
from cartstiff.mechanisms.elements import (
    Elements,
    stiffnesses_beside,
    with_stiffnesses_beside,
)
from cartstiff.mechanisms.identified import quantile
from cartstiff.mechanisms.platform import Platform, PlatformPosture
from cartstiff.potentials.flexure_struts import FlexureStruts
from cartstiff.potentials.line_springs import LineSprings
from cartstiff.potentials.springs import JointSprings
from cartstiff.potentials.strut_numbers import (
    strut_numbers,
    with_strut_numbers,
    with_strut_points,
)
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
        Standard deviation of every spring stiffness, relative to it (0.05: five per cent).
    length : float
        Standard deviation of every coordinate of a joint placement or an attachment point, in
        units of length; of every rest length, where a mechanism finds its rest by itself.
    angle : float
        Standard deviation of every small rotation of a joint placement, in radians; of every rest
        angle, where a mechanism finds its rest by itself.
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

    Derivatives are fourth-order differences: the function is evaluated four times per parameter,
    within 0.4 standard deviations of the nominal values, and must be smooth there. Sorted
    eigenvalues are not where two of them meet (symmetric mechanisms).

    Parameters
    ----------
    function : callable
        From a dict of parameter values to a dict of numbers or arrays, or to one array; NaN entries
        stay NaN.
    tolerances : mapping of str to Tolerance
        Parameters.
    level : float
        Probability of the interval, normal distribution assumed.
    correlation : array_like (n, n), optional
        Correlation of the parameters, in their order; default: independent. A parameter's share of
        the variance then holds half of what it has in common with each other one, and may be
        negative.
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


_XYZ = ("x", "y", "z")
#: Prefix of the names of the file's parameters.
_FILE = "parameter."


@dataclass(frozen=True, eq=False)
class UncertainParameters:
    """The parameters of a mechanism at a posture.

    Attributes
    ----------
    result : PostureStiffness
        The nominal mechanism, posture and load; never modified.
    tolerances : Tolerances
        Only parameters with a deviation above zero are listed. Without one of the stiffness, the
        compliances of measured springs are.
    reread : callable, optional
        From values of the file's parameters, by name, to the mechanism; without it these are none.
    at_rest : bool
        Whether rest positions are parameters: for a mechanism in its own equilibrium.
    """

    result: PostureStiffness
    tolerances: Tolerances
    reread: Callable[[Mapping[str, float]], ElasticMechanism] | None = None
    at_rest: bool = False

    @cached_property
    def nominal(self) -> dict[str, float]:
        """Values of all parameters by name, whatever their tolerance.

        "stiffness.<spring>", "mass.<link>" (the link's centre and its moments of inertia about it
        stay; of legs all alike), the geometry's names of `named`, "rest.<spring>" and
        "parameter.<name>".
        """
        elastic = self.result.elastic
        springs = self._stiffnesses | stiffnesses_beside(elastic)
        given = {f"stiffness.{name}": k for name, k in springs.items()}
        given |= {f"mass.{name}": m for name, m in self._masses.items()}
        given |= self._geometry | self._rests
        if self.reread is not None:
            given |= {
                f"{_FILE}{name}": float(x) for name, x in elastic.parameters.items()
            }
        return given

    def value(self, name: str) -> float:
        """Nominal value of a parameter of `nominal` or of `named`."""
        given = self.nominal.get(name)
        return float(self.named[name].nominal) if given is None else given

    def size(self, name: str) -> float:
        """Natural size of a parameter's changes, in its unit."""
        group = name.partition(".")[0]
        if group in ("stiffness", "mass"):
            return abs(self.nominal[name])
        if group == "parameter":
            return abs(self.nominal[name]) or 1.0
        if group in ("compliance", "coefficient"):
            return abs(self.value(name)) or self.named[name].deviation
        return 1.0 if self.is_angle(name) else self.result.posture.length

    def is_angle(self, name: str) -> bool:
        """Whether a parameter of the geometry, or a rest position, is an angle."""
        group, _, rest = name.partition(".")
        if group == "rest":
            elastic = self.result.elastic
            if not isinstance(elastic.springs, JointSprings):
                return False
            return not elastic.mechanism.coordinates[elastic.names.index(rest)].is_length
        return Placements.is_angle(name)

    @cached_property
    def _stiffnesses(self) -> dict[str, float]:
        """Stiffnesses of the linear springs that act."""
        elastic = self.result.elastic
        if elastic.springs is None:
            return {}
        if isinstance(elastic.springs, FlexureStruts):
            return {
                n.removeprefix("stiffness."): k
                for n, k in self._of_struts.items()
                if n.startswith("stiffness.") and k > 0.0
            }
        laws = elastic.springs.laws if isinstance(elastic.springs, JointSprings) else {}
        each = zip(elastic.spring_names, elastic.springs.stiffness.tolist(), strict=True)
        return {
            name: k
            for i, (name, k) in enumerate(each)
            if 0.0 < k < np.inf and i not in laws
        }

    @cached_property
    def _of_struts(self) -> dict[str, float]:
        elastic = self.result.elastic
        if not isinstance(elastic.springs, FlexureStruts):
            return {}
        return strut_numbers(elastic.springs, elastic.spring_names)

    @cached_property
    def _rests(self) -> dict[str, float]:
        elastic = self.result.elastic
        if not self.at_rest or elastic.springs is None:
            return {}
        each = zip(elastic.spring_names, elastic.springs.rest.tolist(), strict=True)
        return {
            f"rest.{name}": x for name, x in each if name in self._stiffnesses and x == x
        }

    @cached_property
    def _masses(self) -> dict[str, float]:
        mechanism = self.result.elastic.mechanism
        if isinstance(mechanism, Chain):
            own, _ = mechanism.tree.masses()
            links = mechanism.tree.links().items()
            return {
                name: float(own[j - 1]) for j, name in sorted(links) if own[j - 1] > 0.0
            }
        masses = mechanism.masses() if isinstance(mechanism, Platform) else {}
        return {name: mass for name, mass in masses.items() if mass > 0.0}

    @cached_property
    def named(self) -> dict[str, Tolerance]:
        """Nominal value and deviation by name.

        "stiffness.<spring>", or "compliance.<spring>" where they were measured, with
        "coefficient.<joint> x^<power>" of polynomial springs;
        "placement.<joint>.x" to ".rz", "frame.x" to ".rz" and "closure.<frame>.x" to ".rz" for
        chains; "base.<leg>.x" and "platform.<leg>.x" to ".z" for platforms; "rest.<spring>".
        Rotations are nominally zero.
        """
        elastic, t = self.result.elastic, self.tolerances
        given: dict[str, Tolerance] = {}
        if t.stiffness > 0:
            for name, k in (self._stiffnesses | stiffnesses_beside(elastic)).items():
                given[f"stiffness.{name}"] = Tolerance(k, t.stiffness * k)
        if t.stiffness == 0 and (known := elastic.identified) is not None:
            spread = np.sqrt(known.covariance.diagonal())
            for label, pattern, c, s in zip(
                known.labels, known.patterns, known.values, spread, strict=True
            ):
                lower = 0.0 if pattern.is_diagonal else -np.inf
                given[label] = Tolerance(float(c), float(s), lower=lower)
        for name, value in (self._geometry | self._rests).items():
            deviation = t.angle if self.is_angle(name) else t.length
            if deviation > 0:
                given[name] = Tolerance(value, deviation)
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
        """Degrees of freedom of measured springs; infinite for tolerances that are given."""
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
        """The mechanism with other compliances of measured springs; itself if none is named."""
        known = self.result.elastic.identified
        if known is None or values.keys().isdisjoint(known.labels):
            return elastic
        at = [values.get(n, c) for n, c in zip(known.labels, known.values, strict=True)]
        return self._elements.with_parameters(
            known.patterns, np.array(at, float) - known.values
        )

    @cached_property
    def _geometry(self) -> dict[str, float]:
        mechanism = self.result.elastic.mechanism
        if isinstance(mechanism, Platform):
            offsets = {
                n: x for n, x in self._of_struts.items() if n.startswith("offset.")
            }
            return {
                f"{body}.leg{i + 1}.{axis}": float(x)
                for body, points in (
                    ("base", mechanism.anchors),
                    ("platform", mechanism.points_P),
                )
                for i, point in enumerate(points)
                for axis, x in zip(_XYZ, point, strict=True)
            } | offsets
        return {} if self._placements is None else self._placements.numbers

    @cached_property
    def _placements(self) -> Placements | None:
        elastic, posture = self.result.elastic, self.result.posture
        chain = elastic.mechanism
        if not isinstance(chain, Chain) or not isinstance(posture, ChainPosture):
            return None
        is_on_base = elastic.gravity is not None or bool(elastic.potentials)
        return Placements(chain, posture, is_on_base)

    @property
    def left_out(self) -> str | None:
        """Message on numbers of the geometry that are not varied though they have a tolerance."""
        asked = self.tolerances.length > 0 or self.tolerances.angle > 0
        return self._placements.words if asked and self._placements is not None else None

    def at(
        self,
        values: Mapping[str, float],
        start: Array | None = None,
        by_all: bool = False,
    ) -> PostureStiffness:
        """Stiffness of the mechanism with other parameters (those not named: nominal).

        Loops are closed from coordinates `start`, by default the nominal ones, and by moving all
        coordinates if `by_all`, as if the driven ones cannot stay.

        Raises
        ------
        CartstiffError
            If there is no mechanism with those parameters, or the chain cannot be closed.
        """
        return replace(self._analysed(values, start, by_all), load=self.result.load)

    def mechanism(self, values: Mapping[str, float]) -> ElasticMechanism:
        """The mechanism with other parameters (those not named: nominal).

        Rest positions are those of the nominal one, unless named; open where the file was read
        with other parameters, and leaves them open.
        """
        elastic = self.result.elastic
        parameters = {
            n.removeprefix(_FILE): x for n, x in values.items() if n.startswith(_FILE)
        }
        if parameters and self.reread is not None:
            elastic = self.reread(parameters)
        if isinstance(elastic.springs, FlexureStruts):
            struts = with_strut_numbers(elastic.springs, elastic.spring_names, values)
            rest = np.array(
                [
                    values.get(f"rest.{name}", x)
                    for name, x in zip(
                        elastic.spring_names, struts.rest_length, strict=True
                    )
                ]
            )
            elastic = replace(elastic, springs=struts.replaced(struts.stiffness, rest))
        elif elastic.springs is not None:
            k, rest = np.array(elastic.springs.stiffness), np.array(elastic.springs.rest)
            for i, name in enumerate(elastic.spring_names):
                k[i] = values.get(f"stiffness.{name}", k[i])
                rest[i] = values.get(f"rest.{name}", rest[i])
            elastic = replace(elastic, springs=elastic.springs.replaced(k, rest))
        others = {
            n.removeprefix("stiffness."): x
            for n, x in values.items()
            if n.startswith("stiffness.")
        }
        elastic = with_stiffnesses_beside(elastic, others)
        elastic = self._placed_at(self._measured_springs(elastic, values), values)
        masses = {n: values[f"mass.{n}"] for n in self._masses if f"mass.{n}" in values}
        mechanism = elastic.mechanism
        return (
            replace(elastic, mechanism=mechanism.with_masses(masses))
            if masses
            else elastic
        )

    def posture_of(self, elastic: ElasticMechanism, q: Array | None = None) -> Array:
        """Coordinates q, by default the nominal ones; if these are the file's, its present ones."""
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
        if by_all and isinstance(mechanism, Chain):
            posture: MechanismPosture = mechanism.closed(q, hold=())
        else:
            posture = mechanism.closed(q)
        if isinstance(springs, FlexureStruts):
            W = self.result.wrench
            return analyse(elastic, posture.q, wrench=np.zeros(6) if W is None else W)
        if isinstance(springs, JointSprings) and isinstance(nominal, JointSprings):
            if posture.closure is None:
                return analyse(elastic, posture.q, wrench=self.result.wrench)
            active = (springs.stiffness > 0) & np.isfinite(springs.stiffness)
            active[list(springs.laws)] = False
            before, x, forces = there.q, posture.q, nominal.torque(there.q)
            rows = np.diag(posture.coordinate_lengths)
        elif (
            isinstance(springs, LineSprings)
            and isinstance(nominal, LineSprings)
            and isinstance(posture, PlatformPosture)
            and isinstance(there, PlatformPosture)
        ):
            before, x = there.lines.lengths, posture.lines.lengths
            active = springs.stiffness > 0
            if nominal.unilateral:
                active &= nominal.is_taut(before)
            forces, rows = (
                nominal.tensions(before),
                posture.lines.lines * posture.coordinate_lengths,
            )
        else:
            return analyse(elastic, posture.q)
        asked, loaded = self.result.elastic_as_given, self.result._load_is_given
        is_open = np.isnan(nominal.rest if asked.springs is None else asked.springs.rest)
        if not (loaded or is_open.any()):
            forces = forces + self._change(elastic, posture, rows, forces, active)
        rest = nominal.rest + x - before
        rest[active] = x[active] - forces[active] / springs.stiffness[active]
        if isinstance(springs, JointSprings):
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

    def _placed_at(
        self, elastic: ElasticMechanism, values: Mapping[str, float]
    ) -> ElasticMechanism:
        """The mechanism with other geometry; itself if none is named."""
        geometry = self._geometry
        if not any(name in geometry for name in values):
            return elastic
        mechanism = elastic.mechanism
        if isinstance(mechanism, Platform):
            moved = [
                values.get(n, x)
                for n, x in geometry.items()
                if not n.startswith("offset.")
            ]
            platform = mechanism.with_points(*np.array(moved).reshape(2, -1, 3))
            elastic = replace(elastic, mechanism=platform)
            springs, ends = elastic.springs, (platform.anchors, platform.points)
            if isinstance(springs, FlexureStruts):
                elastic = replace(elastic, springs=with_strut_points(springs, *ends))
            elif isinstance(springs, LineSprings):
                elastic = replace(
                    elastic, springs=replace(springs, anchors=ends[0], points=ends[1])
                )
            return elastic
        if self._placements is None:
            return elastic
        return replace(elastic, mechanism=self._placements.with_parameters(values))
