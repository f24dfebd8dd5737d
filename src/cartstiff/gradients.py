r"""Exact gradients of stiffness by the numbers of a mechanism.

At a held posture, with the load kept and rest positions following, the derivative of an objective y
by a parameter p is the partial one of the recorded arithmetic (`cartstiff.batch.gradient`). In a
closed chain the coordinates D that are not held move with p, so that the closures c stay met:

    dy/dp = y_p - y_q S (C_D S)^+ c_p,      C_D = dc/dq_D,

S being the natural sizes of the coordinates. What is not recorded, and postures that are not
plainly regular, have one difference quotient of the mechanism analysed again; the result says
which.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from cartstiff import numerics
from cartstiff.analysis.tolerances import Tolerances, UncertainParameters
from cartstiff.arrays import Array, Result, checked_input
from cartstiff.batch.chains import ChainCase
from cartstiff.batch.gradient import Objective, Slopes, slopes
from cartstiff.batch.plans import TracedModel, plan
from cartstiff.batch.platforms import PlatformCase
from cartstiff.batch.quantities import Quantity, Settings
from cartstiff.batch.readings import READINGS, Readings, RecordedSource
from cartstiff.batch.tape import square_root
from cartstiff.batch.twists import Varied
from cartstiff.checked_call import checked
from cartstiff.errors import (
    CartstiffError,
    InputError,
    UndefinedError,
    UnknownNameError,
    one_line,
)
from cartstiff.figures import draw_bars, new_figure
from cartstiff.geometry.differences import derivative_with_error
from cartstiff.maps.quantities import choose_quantities, evaluate
from cartstiff.maps.run import default_length
from cartstiff.mechanisms.chain import Chain
from cartstiff.mechanisms.elastic import ElasticMechanism
from cartstiff.mechanisms.platform import Platform
from cartstiff.stiffness.compute import PostureStiffness, analyse

#: Least agreement of the recorded objective with the core's, as a share.
_SAME = numerics.NEGLIGIBLE_DIFFERENCE
#: Weights and step of a one-sided difference quotient of fourth order, steps from 0 to 4.
_ONE_SIDED = (-25 / 12, 4.0, -3.0, 4 / 3, -1 / 4)
_ONE_SIDED_STEP = 1e-3
#: Relative error of a difference quotient, and difference of both sides, from which on there is a
#: kink.
_KINKED = numerics.REPORTED_ERROR
#: A function of the stiffness (6, 6) of the connection, the wrench (6,) and the pose (4, 4).
OwnObjective = Callable[[Any, Any, Any], Any]
#: Component of each named parameter in an input array, by array.
_Names = dict[str, dict[str, int]]
_XYZ, _RXYZ = ("x", "y", "z"), ("rx", "ry", "rz")
_LOAD = ("mx", "my", "mz", "fx", "fy", "fz")


@dataclass(frozen=True)
class Slope:
    """Derivative by one parameter.

    Attributes
    ----------
    name : str
        "q.<coordinate>", "load.mx" to "load.fz", and the parameters of
        `cartstiff.analysis.tolerances`: "stiffness.<spring>", "mass.<link>",
        "placement.<joint>.x" to ".rz", "frame.", "closure.", "base.<leg>.x", "platform.<leg>.x".
    nominal : float
        The parameter's value.
    unit : str
        The parameter's unit.
    value : float
        Derivative, in the objective's unit per that unit.
    is_exact : bool
        Whether it is that of the recorded arithmetic; else a difference quotient.
    error : float
        Estimate of the relative error of a difference quotient; 0 for an exact derivative.
    sides : tuple of (float, float), optional
        At a kink: derivatives on the side of smaller and of larger values of the parameter. `value`
        is theirs if they agree, else NaN.
    size : float
        Natural size of the parameter's changes: that of a stiffness, mass or load; 1 rad, or the
        mechanism's characteristic length.
    """

    name: str
    nominal: float
    unit: str
    value: float
    is_exact: bool = True
    error: float = 0.0
    sides: tuple[float, float] | None = None
    size: float = 1.0

    @property
    def effect(self) -> float:
        """Change of the objective, to first order, for a change by the natural size."""
        return self.size * self.value


@dataclass(frozen=True, eq=False)
class Gradient(Result):
    """An objective at a held posture and its derivatives; load and place stay, rests follow.

    Attributes
    ----------
    of : str
        The objective.
    value, unit : float, str
        Its value and unit.
    slopes : tuple of Slope
        One for each parameter asked for.
    missing : tuple of str
        Parameters without a derivative, each with the reason.
    why : str
        Reason why nothing is exact; empty where the recorded arithmetic serves.
    operations : tuple of (int, int), optional
        Operations of the objective alone, and with all exact derivatives.
    """

    of: str
    value: float
    unit: str
    slopes: tuple[Slope, ...]
    missing: tuple[str, ...] = ()
    why: str = ""
    operations: tuple[int, int] | None = None

    #: The question that the derivatives answer.
    question = "at this posture: place and load stay, rest positions follow"

    def __getitem__(self, name: str) -> float:
        """Derivative by a parameter; UnknownNameError."""
        known = {slope.name: slope.value for slope in self.slopes}
        if name not in known:
            raise UnknownNameError("parameter", name, known)
        return known[name]

    def __iter__(self) -> Iterator[Slope]:
        return iter(self.slopes)

    def plot(self, most: int = 20) -> Any:
        """Draw the parameters that matter most: the change for 1 per cent of each.

        Of coordinates, rotations and what is nominally zero, for 0.01 rad or 1 per cent of the
        mechanism's length. Parameters at a kink are left out.

        Parameters
        ----------
        most : int
            Largest number of bars.

        Returns
        -------
        matplotlib.figure.Figure

        Raises
        ------
        MissingDependencyError
            Without matplotlib.
        """
        ordered = [slope for slope in self._by_effect if np.isfinite(slope.effect)][:most]
        figure = new_figure(7.0, 1.2 + 0.28 * len(ordered))
        axis = figure.subplots()
        values = [0.01 * slope.effect for slope in ordered]
        label = f"change of {self.of} [{self.unit}] for 1 per cent of each parameter"
        draw_bars(axis, [slope.name for slope in ordered], values, label)
        axis.axvline(0.0, color="black", linewidth=0.8)
        return figure

    @property
    def _by_effect(self) -> list[Slope]:
        return sorted(self.slopes, key=lambda slope: -abs(np.nan_to_num(slope.effect)))

    def __repr__(self) -> str:
        value = f"{self.value:.6g} {self.unit}".strip()
        head = f"Gradient of {self.of} = {value}, {self.question}"
        width = max((len(slope.name) for slope in self.slopes), default=0)
        lines = [
            f"  {slope.name:<{width}}  {slope.value: .6g} {self.unit}{' ' * bool(self.unit)}"
            f"per {slope.unit}"
            + ("" if slope.is_exact else "  (difference quotient)")
            + (
                ""
                if slope.sides is None
                else "  sides {:.6g}, {:.6g}".format(*slope.sides)
            )
            for slope in self._by_effect
        ]
        notes = [f"  {words}" for words in (self.why, *self.missing) if words]
        return "\n".join([head, *lines, *notes])


@checked
def gradient(
    mechanism: ElasticMechanism,
    q: ArrayLike | Mapping[str, float] | None = None,
    *,
    of: str | OwnObjective = "translation_free_min",
    by: str | Iterable[str] | None = None,
    connection: str | None = None,
    direction: ArrayLike | None = None,
    deflect: ArrayLike | None = None,
    length: float | None = None,
    wrench: ArrayLike | None = None,
    load_kind: Literal["dead", "follower", "conservative"] = "dead",
    load_at: ArrayLike = (0.0, 0.0, 0.0),
    load_axes: Literal["body", "world"] = "body",
) -> Gradient:
    r"""Derivatives of a number of the stiffness by the numbers of the mechanism.

    The question is *at this posture*: coordinates and load stay, and rest positions follow, as of
    a robot that is commanded to a posture. Those of a closed chain that are not held move so that
    the loops stay closed.

    Parameters
    ----------
    mechanism : ElasticMechanism
        From `cartstiff.load`.
    q : array_like (n,) or mapping, optional
        Coordinates; default the file's posture.
    of : str or callable
        A quantity (`cartstiff models --quantities`), or a function of the stiffness (6, 6) of the
        connection, the wrench (6,) and the pose (4, 4), in the body's frame and the mechanism's
        units, with + - * / and NumPy's sqrt, sin, cos.
    by : str or iterable of str, optional
        Names of parameters, or their beginnings: "stiffness", "q", "load", "placement.joint_2";
        default all.
    connection, direction, deflect, length
        Settings of the quantity, as in `cartstiff.maps.map_of`. The length stays.
    wrench, load_kind, load_at, load_axes
        Load, as in `cartstiff.analyse`.

    Returns
    -------
    Gradient
        Name, unit and derivative for each parameter; which of them are difference quotients.

    Raises
    ------
    UndefinedError
        Where the objective does not exist.
    UnknownNameError
        For a quantity or parameter that is not known.
    InputError
        For arguments that cannot be used.
    """
    load: dict[str, Any] = {
        "wrench": wrench,
        "load_kind": load_kind,
        "load_at": load_at,
        "load_axes": load_axes,
    }
    result = analyse(mechanism, q, **load)
    if connection is None:
        connection = "B" if wrench is None else "load"
    settings = Settings(
        connection,
        1.0 if length is None else float(length),
        None
        if direction is None
        else tuple(checked_input(direction, (3,), "direction").tolist()),
        None
        if deflect is None
        else tuple(checked_input(deflect, (6,), "deflect").tolist()),
        load=result.load,
        is_loaded=wrench is not None,
    )
    if isinstance(of, str):
        (quantity,) = choose_quantities([of], settings, mechanism)
        if quantity.asks == "length" and length is None:
            length = default_length(mechanism, connection, **load)
            settings = replace(settings, length=length)
        asked: _Asked = _OfQuantity(quantity, settings, mechanism)
    else:
        asked = _OfFunction(of, settings)
    return _Question(result, asked, load).gradient(by)


# -- objectives -------------------------------------------------------------------------------


class _Asked:
    """An objective on the numbers of an analysis, and on recorded ones."""

    name: str
    unit: str
    #: Outputs that it reads.
    needed: tuple[str, ...]

    def seen(self, result: PostureStiffness) -> float:
        """Its value at an analysed posture; NaN where it does not exist."""
        raise NotImplementedError

    def recorded(self, arrays: Mapping[str, Array], lengths: Array) -> tuple[Any, Any]:
        """Its value on recorded numbers and the verdict on it; KeyError without an output."""
        raise NotImplementedError


class _OfQuantity(_Asked):
    """A quantity of the table."""

    def __init__(
        self, quantity: Quantity, settings: Settings, elastic: ElasticMechanism
    ) -> None:
        self._quantity, self._settings = quantity, settings
        self.name, self.unit = quantity.name, quantity.unit_in(elastic.units)
        self._readings = Readings((quantity.name,), settings)
        self.needed = self._readings.needs

    def seen(self, result: PostureStiffness) -> float:
        quantity, settings = self._quantity, self._settings
        arrays = {
            name: _output(result, name)[None] for name in quantity.outputs(settings)
        }
        arrays |= {name: _output(result, name)[None] for name in ("pose", "wrench")}
        lengths = np.array([c.is_length for c in result.elastic.mechanism.coordinates])
        return float(evaluate([quantity], arrays, settings, lengths)[quantity.name][0])

    def recorded(self, arrays: Mapping[str, Array], lengths: Array) -> tuple[Any, Any]:
        reading = READINGS[self.name]
        source = RecordedSource({**arrays, "lengths": lengths}, self._readings)
        value = reading.function(source)
        if reading.root == 2:
            value = square_root(value)
        elif reading.root != 1:
            raise KeyError(self.name)
        return value, source.verdict


class _OfFunction(_Asked):
    """A function of stiffness, wrench and pose."""

    def __init__(self, function: OwnObjective, settings: Settings) -> None:
        self._function, self._connection = function, settings.connection
        self._load = settings.load
        self.name, self.unit = getattr(function, "__name__", "objective"), ""
        own = "B" if self._connection == "load" else self._connection
        self.needed = (f"stiffness_{own}", "wrench", "pose")

    def seen(self, result: PostureStiffness) -> float:
        K = _output(result, f"stiffness_{self._connection}")
        W, pose = _output(result, "wrench"), _output(result, "pose")
        value = np.asarray(self._function(K, W, pose), float)
        if value.shape != ():
            raise InputError(
                "the objective is not one number", expected="shape ()", got=value.shape
            )
        return float(value)

    def recorded(self, arrays: Mapping[str, Array], lengths: Array) -> tuple[Any, Any]:  # noqa: ARG002
        W = arrays["wrench"]
        if self._connection == "load":
            K = arrays["stiffness_B"] + self._load.change(W)
        else:
            K = arrays[f"stiffness_{self._connection}"]
        return self._function(K, W, arrays["pose"]), 0.0


def _output(result: PostureStiffness, name: str) -> Array:
    """An output of `analyse_many` at one analysed posture; NaN where it does not exist."""
    kind, _, letter = name.partition("_")
    here = result.at()
    found = {
        "stiffness": here.matrices,
        "compliance": here.compliances,
    }
    value = (
        found[kind][letter]
        if kind in found
        else {
            "pose": result.pose,
            "wrench": result.wrench,
            "energy": np.array([result.energy]),
            "jacobian": result.posture.motion.jacobian,
        }[name]
    )
    shape = (6,) if name == "wrench" else (6, 6)
    return np.full(shape, np.nan) if value is None else np.asarray(value)


def _varied_chain(
    chain: Chain, case: ChainCase, own: Mapping[str, float]
) -> tuple[ChainCase, _Names]:
    """A chain's arithmetic with placements and masses as inputs, and their names."""
    tree, names = chain.tree, _Names()
    path = list(range(tree.model.njoints - 1))
    if not chain.closures:
        path = [int(j) for j in tree.path(0, chain.body.joint).order]
    places = [f"placement.{tree.model.names[j + 1]}" for j in path] + ["frame"]
    links = tuple(i for i, name in enumerate(places) if f"{name}.x" in own)
    found = [places[i] for i in links]
    ends = list[tuple[int, int]]()
    for tie, closure in enumerate(chain.closures):
        for side, frame in enumerate((closure.frame_a, closure.frame_b)):
            if f"closure.{frame}.x" in own:
                ends.append((tie, side))
                found.append(f"closure.{frame}")
    names["placements"] = {
        f"{name}.{axis}": 6 * i + k
        for i, name in enumerate(found)
        for k, axis in enumerate((*_XYZ, *_RXYZ))
        if f"{name}.{axis}" in own
    }
    has_masses = bool(case.fields) and case.fields[0].has_mass
    if has_masses:
        at = {j: i for i, j in enumerate(path)}
        names["masses"] = {
            f"mass.{name}": at[j - 1]
            for j, name in tree.links().items()
            if j - 1 in at and f"mass.{name}" in own
        }
    varied = Varied(links, tuple(ends), has_masses)
    return replace(case, varied=varied), names


def _decomposed(C: Array, columns: list[int]) -> tuple[Array, Array, Array]:
    """Singular value decomposition of columns of a matrix, without what is zero."""
    U, values, Vt = np.linalg.svd(C[:, columns], full_matrices=False)
    rank = int((values > numerics.RANK * values[0]).sum())
    return U[:, :rank], values[:rank], Vt[:rank]


# -- one question -----------------------------------------------------------------------------


class _Question:
    """An objective at an analysed posture, with its parameters."""

    def __init__(
        self, result: PostureStiffness, asked: _Asked, load: Mapping[str, Any]
    ) -> None:
        self.result, self.asked, self.load = result, asked, load
        self.elastic = result.elastic_as_given
        self.mechanism = self.elastic.mechanism
        self.parameters = UncertainParameters(result, Tolerances(1.0, 1.0, 1.0))
        self.value = asked.seen(result)
        if not np.isfinite(self.value):
            raise UndefinedError(
                f"{asked.name} does not exist at this posture", code="no-objective"
            )

    @cached_property
    def nominal(self) -> dict[str, float]:
        """Values of all parameters by name."""
        names, q = self.elastic.names, self.result.q
        held = self._free_coordinates
        given = {f"q.{names[j]}": float(q[j]) for j in held}
        given |= self.parameters.nominal
        if self.load["wrench"] is not None:
            each = zip(_LOAD, np.ravel(self.load["wrench"]), strict=True)
            given |= {f"load.{name}": float(x) for name, x in each}
        return given

    @property
    def _free_coordinates(self) -> list[int]:
        """Coordinates that can be chosen: of a closed chain those that are held."""
        chain, n = self.mechanism, len(self.elastic.names)
        if isinstance(chain, Chain) and chain.closures:
            return sorted(chain.held)
        return [j for j in range(n) if j not in self.mechanism.virtual]

    def gradient(self, by: str | Iterable[str] | None) -> Gradient:
        """Derivatives by the parameters whose names begin so."""
        names = self._chosen(by)
        exact, why = self._exact()
        found, missing = list[Slope](), list[str]()
        for name in names:
            size, value = self._size(name), exact.get(name, np.nan)
            if abs(value * size) <= numerics.ROUNDOFF_OF_SUMS * abs(self.value):
                value = 0.0
            nominal, unit = self.nominal[name], self._unit(name)
            slope = Slope(name, nominal, unit, value, name in exact, size=size)
            if slope.is_exact:
                found.append(slope)
                continue
            try:
                found.append(self._quotient(slope))
            except CartstiffError as refused:
                missing.append(f"no derivative by {name}: {one_line(str(refused), 160)}")
        sizes = None if self._slopes is None else (self._slopes.size, self._slopes.whole)
        asked = self.asked
        return Gradient(
            asked.name, self.value, asked.unit, tuple(found), tuple(missing), why, sizes
        )

    def _chosen(self, by: str | Iterable[str] | None) -> list[str]:
        if by is None:
            return list(self.nominal)
        names = list[str]()
        for start in [by] if isinstance(by, str) else by:
            own = [n for n in self.nominal if n == start or n.startswith(f"{start}.")]
            if not own:
                raise UnknownNameError("parameter", start, self.nominal)
            names += own
        return list(dict.fromkeys(names))

    def _unit(self, name: str) -> str:
        group, _, rest = name.partition(".")
        units, mechanism = self.elastic.units, self.mechanism
        by_length = {c.name: c.is_length for c in mechanism.coordinates}
        if group == "q":
            return units.length if by_length[rest] else "rad"
        if group == "load":
            return units.force if rest[0] == "f" else f"{units.force} {units.length}"
        if group == "stiffness":
            along = by_length.get(rest, True)
            per_rad = f"{units.force} {units.length}/rad"
            return f"{units.force}/{units.length}" if along else per_rad
        if group == "mass":
            return "kg"
        if group == "parameter":
            return "unit of the file"
        return "rad" if self.parameters.is_angle(name) else units.length

    # -- by the recorded arithmetic

    def _exact(self) -> tuple[dict[str, float], str]:
        """Exact derivatives by name, and the reason why there is none."""
        self._slopes: Slopes | None = None
        self._is_kink = False
        wrench = self.load["wrench"]
        given = None if wrench is None else np.asarray(wrench, float)
        axes = self.load["load_axes"]
        if given is None and self.elastic.springs is not None and self._rests_are_given:
            # What holds a posture with given rest positions is kept like a load.
            given, axes = self.result.wrench, "body"
        taken = plan(self.elastic, "none" if given is None else "each")
        if isinstance(taken, str):
            return {}, f"nothing is recorded: {taken}"
        if taken.untraced or taken.settles:
            return {}, "nothing is recorded: energies beside the recorded ones act"
        taken, names = self._varied(taken.under(self.result.load, axes))
        lengths = np.array([c.is_length for c in self.mechanism.coordinates])
        objective: Objective = lambda arrays: self.asked.recorded(arrays, lengths)  # noqa: E731
        found = slopes(taken, self.asked.needed, objective, self.result.q, given)
        if found is None:
            return {}, "the posture is not plainly regular, or nothing is recorded of it"
        if abs(found.value - self.value) > _SAME * abs(self.value):
            return (
                {},
                "the recorded arithmetic answers for another choice of rest positions",
            )
        self._slopes = found
        if found.kinks:
            self._is_kink = True
            return {}, (
                "at a kink: two numbers that the objective chooses from are equal here, such as "
                "principal values; each side has its derivative"
            )
        return self._named(found, names), ""

    @property
    def _rests_are_given(self) -> bool:
        springs = self.elastic.springs
        return springs is not None and not np.isnan(springs.rest).all()

    def _varied(self, taken: TracedModel) -> tuple[TracedModel, _Names]:
        """The arithmetic with the geometry as inputs, and names of the inputs' components."""
        own = self.parameters.nominal
        names = _Names()
        names["q"] = {f"q.{self.elastic.names[j]}": j for j in self._free_coordinates}
        names["wrench"] = {f"load.{x}": i for i, x in enumerate(_LOAD)}
        springs = enumerate(self.elastic.spring_names)
        names["stiffness"] = {
            name: i for i, x in springs if (name := f"stiffness.{x}") in own
        }
        case, shared = taken.case, dict(taken.shared)
        if isinstance(case, PlatformCase) and isinstance(self.mechanism, Platform):
            platform = self.mechanism
            if not case.lines:
                m = len(platform.anchors)
                case = replace(case, anchors=(), points=(), length=1.0, lines=m)
                shared["anchors"] = platform.anchors.reshape(1, -1)
                shared["points"] = platform.points.reshape(1, -1)
                shared["length"] = np.array([[float(platform.length)]])
            if case.rest == "given" and (forces := self.result.tensions) is not None:
                case = replace(case, rest="preload")
                shared["preload"] = forces[None]
            for body, array in (("base", "anchors"), ("platform", "points")):
                names[array] = {
                    f"{body}.leg{i // 3 + 1}.{_XYZ[i % 3]}": i
                    for i in range(3 * case.lines)
                }
        elif isinstance(case, ChainCase) and isinstance(self.mechanism, Chain):
            case, more = _varied_chain(self.mechanism, case, own)
            places = len(case.varied.links) + len(case.varied.ends)
            shared["placements"] = np.zeros((1, 6 * places))
            if case.varied.masses:
                shared["masses"] = np.array([case.fields[0].weights])
            names |= more
        return replace(taken, case=case, shared=shared), names

    def _named(self, found: Slopes, names: _Names) -> dict[str, float]:
        """Derivatives by name, the closures kept."""
        by = {name: slope.copy() for name, slope in found.by.items()}
        if found.closing is not None:
            by = self._closed(found)
        if isinstance(self.mechanism, Platform) and "points" in by:
            # Points are given in P, the recorded ones in M.
            R_P_M = self.mechanism.T_P_M[:3, :3]
            by["points"] = (by["points"].reshape(-1, 3) @ R_P_M.T).ravel()
        return {
            name: float(by[array][i])
            for array, components in names.items()
            if array in by
            for name, i in components.items()
        }

    def _closed(self, found: Slopes) -> dict[str, Array]:
        """Derivatives with the coordinates that are not held moving to keep the closures."""
        chain, closing = self.mechanism, found.closing
        if not isinstance(chain, Chain) or closing is None:
            raise TypeError(chain)
        sizes = self.result.posture.coordinate_lengths
        moving = [j for j in range(len(sizes)) if j not in chain.rigid]
        D = [j for j in moving if j not in chain.held]
        # Closures may be redundant: their combinations that move nothing stay met.
        (U, values, Vt), needed = (
            _decomposed(closing["q"] * sizes, js) for js in (D, moving)
        )
        if len(values) < len(needed[1]):
            # The held coordinates do not leave enough: all of them move.
            (U, values, Vt), D = needed, moving
        weight = (found.by["q"][D] * sizes[D]) @ Vt.T / values
        return {
            name: slope - weight @ (U.T @ closing[name])
            for name, slope in found.by.items()
        }

    # -- by analysing again

    def _quotient(self, slope: Slope) -> Slope:
        """The derivative as a difference quotient, at a kink from both sides."""
        name, natural = slope.name, slope.size
        if self._is_kink:
            return self._both_sides(slope, natural)
        best: tuple[float, float] | None = None
        refused: CartstiffError | None = None
        for step in numerics.EIGHTH_ORDER_STEPS:
            try:
                rate, error = derivative_with_error(
                    lambda change: self._again(name, change), step * natural
                )
            except CartstiffError as stopped:
                refused = stopped
                continue
            if best is not None and float(error) >= best[1]:
                break
            best = float(rate), float(error)
        if best is None or not np.isfinite(best[0]):
            raise refused or UndefinedError(
                f"{self.asked.name} does not exist nearby", code="no-objective"
            )
        size = max(abs(best[0]), abs(self.value) / natural)
        share = best[1] / size if size else 0.0
        if share > _KINKED:
            return self._both_sides(slope, natural)
        return replace(slope, value=best[0], error=share)

    def _both_sides(self, slope: Slope, natural: float) -> Slope:
        """The derivative from each side."""
        left, right = (self._one_side(slope.name, side * natural) for side in (-1.0, 1.0))
        gap = abs(left - right) * natural / abs(self.value)
        value = 0.5 * (left + right) if gap <= _KINKED else np.nan
        return replace(slope, value=value, error=gap, sides=(left, right))

    def _one_side(self, name: str, natural: float) -> float:
        """Derivative from one side, of fourth order."""
        step = _ONE_SIDED_STEP * natural
        steps = [self._again(name, k * step) for k in range(1, len(_ONE_SIDED))]
        return float(np.dot(_ONE_SIDED, [self.value, *steps])) / step

    def _size(self, name: str) -> float:
        group, _, rest = name.partition(".")
        length = self.result.posture.length
        if group == "q":
            names = self.elastic.names
            by_length = self.mechanism.coordinates[names.index(rest)].is_length
            return length if by_length else 1.0
        if group == "load":
            each = [abs(x) for n, x in self.nominal.items() if n.startswith("load.")]
            return max(each) or 1.0
        return self.parameters.size(name)

    def _again(self, name: str, change: float) -> float:
        """The objective with another value of a parameter."""
        group, _, rest = name.partition(".")
        if group == "q":
            q = self.result.q.copy()
            q[self.elastic.names.index(rest)] += change
            load = self.load
            if load["wrench"] is None and self._rests_are_given:
                load = {**load, "wrench": self.result.wrench, "load_axes": "body"}
            return self.asked.seen(analyse(self.elastic, q, **load))
        if group == "load":
            wrench = np.array(self.load["wrench"], float)
            wrench[_LOAD.index(rest)] += change
            again = {**self.load, "wrench": wrench}
            return self.asked.seen(analyse(self.elastic, self.result.q, **again))
        value = self.parameters.value(name) + change
        return self.asked.seen(self.parameters.at({name: value}))
