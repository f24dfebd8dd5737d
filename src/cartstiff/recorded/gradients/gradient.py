"""The gradient of one number of the stiffness by the numbers of the mechanism.

It is that at a held posture, or of a mechanism that comes to rest again. What is not
recorded, and postures that are not plainly regular, have one difference quotient of the
mechanism analysed again; the result says which.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from cartstiff.core import numerics
from cartstiff.core.arrays import Result, checked_flag
from cartstiff.core.checked_call import checked
from cartstiff.core.errors import (
    CartstiffError,
    UndefinedError,
    UnknownNameError,
    one_line,
)
from cartstiff.core.figures import draw_bars, new_axes
from cartstiff.core.mechanisms.elastic import ElasticMechanism
from cartstiff.core.statics.equilibrium import equilibrium
from cartstiff.core.statics.rest import Equilibrium
from cartstiff.core.stiffness.applied_load import (
    DEAD_AT_ORIGIN,
    Axes,
    Behaviour,
    LoadKind,
)
from cartstiff.core.stiffness.compute import PostureStiffness, analyse
from cartstiff.recorded.gradient import Differentiated
from cartstiff.recorded.gradients.exact import Recorded, parameters_of
from cartstiff.recorded.gradients.objectives import (
    Asked,
    OfFunction,
    OfQuantity,
    OwnObjective,
)
from cartstiff.recorded.plans import Case
from cartstiff.recorded.quantities import (
    Settings,
    check_used,
    choose_quantities,
    quantity_named,
)

#: Least agreement of the recorded objective with the core's, as a share.
_SAME = numerics.NEGLIGIBLE_DIFFERENCE
#: Weights and step of a one-sided difference quotient of fourth order, steps from 0 to 4.
_ONE_SIDED = (-25 / 12, 4.0, -3.0, 4 / 3, -1 / 4)
_ONE_SIDED_STEP = 1e-3
#: Relative error of a difference quotient, and difference of both sides, from which on
#: there is a kink.
_KINKED = numerics.REPORTED_ERROR


#: Questions that derivatives answer.
QUESTIONS = (
    "at this posture: place and load stay, rest positions follow",
    "it comes to rest again: rest positions and load stay, the mechanism moves",
)


@dataclass(frozen=True)
class Slope:
    """Derivative by one parameter.

    Attributes
    ----------
    name : str
        "q.<coordinate>", "load.mx" to "load.fz", under gravity "payload" (a mass that is
        hung at M's origin), and the numbers of `cartstiff.answer.analysis.parameters`:
        "stiffness.<spring>", "preload.<leg>", "rest.<spring>", "mass.<link>",
        "placement.<joint>.x" to ".rz", "frame.", "closure.", "base.<leg>.x",
        "platform.<leg>.x".
    nominal : float
        The parameter's value.
    unit : str
        The parameter's unit.
    value : float
        Derivative, in the objective's unit per that unit.
    is_exact : bool
        Whether it is that of the recorded arithmetic; else a difference quotient.
    error : float
        Estimate of the relative error of a difference quotient; 0 for an exact
        derivative.
    sides : tuple of (float, float), optional
        At a kink: derivatives on the side of smaller and of larger values of the
        parameter. `value` is theirs if they agree, else NaN.
    size : float
        Natural size of the parameter's changes: that of a stiffness, mass or load; 1 rad,
        or the mechanism's characteristic length.
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
    """An objective and its derivatives, at a held posture or where it comes to
    rest again.

    Attributes
    ----------
    of : str
        The objective.
    value, unit : float, str
        Its value and unit.
    question : str
        The question that the derivatives answer, one of `QUESTIONS`.
    slopes : tuple of Slope
        One for each parameter asked for.
    missing : tuple of str
        Parameters without a derivative, each with the reason.
    why : str
        Reason why nothing is exact; empty where the recorded arithmetic serves.
    """

    of: str
    value: float
    unit: str
    question: str
    slopes: tuple[Slope, ...]
    missing: tuple[str, ...] = ()
    why: str = ""

    def __getitem__(self, name: str) -> float:
        """Derivative by a parameter; UnknownNameError."""
        known = {slope.name: slope.value for slope in self.slopes}
        if name not in known:
            raise UnknownNameError("parameter", name, known)
        return known[name]

    def __iter__(self) -> Iterator[Slope]:
        return iter(self.slopes)

    def plot(self, most: int = 20, ax: Any = None) -> Any:
        """Draw the parameters that matter most: the change for 1 per cent of each.

        Of coordinates, rotations and what is nominally zero, for 0.01 rad or 1 per cent
        of the mechanism's length. Parameters at a kink are left out.

        Parameters
        ----------
        most : int
            Largest number of bars.
        ax : matplotlib.axes.Axes, optional
            Whose place the picture takes; default a figure of its own.

        Returns
        -------
        matplotlib.figure.Figure

        Raises
        ------
        MissingDependencyError
            Without matplotlib.
        """
        ordered = [slope for slope in self._by_effect if np.isfinite(slope.effect)][:most]
        figure, axis = new_axes("", 7.0, 1.2 + 0.28 * len(ordered), ax=ax)
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
        lines = []
        for slope in self._by_effect:
            line = f"  {slope.name:<{width}}  {slope.value: .6g} {self.unit}"
            line += f"{' ' * bool(self.unit)}per {slope.unit}"
            if not slope.is_exact:
                line += "  (difference quotient)"
            if slope.sides is not None:
                line += "  sides {:.6g}, {:.6g}".format(*slope.sides)
            lines.append(line)
        notes = [f"  {words}" for words in (self.why, *self.missing) if words]
        return "\n".join([head, *lines, *notes])


@checked
def gradient(
    elastic: ElasticMechanism,
    q: ArrayLike | Mapping[str, float] | None = None,
    *,
    of: str | OwnObjective = "translation_free_min",
    by: str | Iterable[str] | None = None,
    comes_to_rest: bool = False,
    connection: str | None = None,
    direction: ArrayLike | None = None,
    deflect: ArrayLike | None = None,
    length: float | None = None,
    wrench: ArrayLike | None = None,
    load_kind: Behaviour = "dead",
    load_at: ArrayLike = (0.0, 0.0, 0.0),
    load_axes: Axes = "body",
) -> Gradient:
    r"""Derivatives of a number of the stiffness by the numbers of the mechanism.

    The question is *at this posture*: coordinates and load stay, and rest positions
    follow, as of a robot that is commanded to a posture. Those of a closed chain that are
    not held move so that the loops stay closed. With `comes_to_rest` it is what a
    mechanism does that nobody corrects: rest positions and load stay, the mechanism moves
    to where it is at rest under the load, and each derivative includes this motion.

    Parameters
    ----------
    elastic : ElasticMechanism
        From `cartstiff.load`.
    q : array_like (n,) or mapping, optional
        Coordinates; default the file's posture.
    of : str or callable
        A quantity (`cartstiff models --quantities`), or a function of the stiffness (6,
        6) of the connection, the wrench (6,) and the pose (4, 4), in the body's frame and
        the mechanism's units, with + - * / and NumPy's sqrt, sin, cos.
    by : str or iterable of str, optional
        Names of parameters, or their beginnings: "stiffness", "q", "load",
        "placement.joint_2"; default all.
    comes_to_rest : bool
        Which question is asked. The posture is then the start of a search of the
        equilibrium under the load, as in `cartstiff.equilibrium`, and rest positions are
        numbers, too.
    connection, direction, deflect, length
        Settings of the quantity, as in `cartstiff.maps.map_of`: `direction` is a vector
        (3,), `deflect` a wrench (6,). The length stays.
    wrench, load_kind, load_at, load_axes
        Load, as in `cartstiff.analyse`.

    Returns
    -------
    Gradient
        Name, unit and derivative for each parameter; which of them are difference
        quotients.

    Raises
    ------
    UndefinedError
        Where the objective does not exist.
    UnknownNameError
        For a quantity or parameter that is not known.
    InputError
        For arguments that cannot be used.
    """
    # The posture, held or at rest under the load.
    load: dict[str, Any] = {
        "wrench": wrench,
        "load_kind": load_kind,
        "load_at": load_at,
        "load_axes": load_axes,
    }
    subject: PostureStiffness | Equilibrium
    if checked_flag(comes_to_rest, "comes_to_rest"):
        subject = equilibrium(elastic, q, **load)
    else:
        subject = analyse(elastic, q, **load)
    # What is differentiated: a quantity as in tables, or the caller's function.
    if connection is None:
        connection = "B" if wrench is None else "load"
    kind = DEAD_AT_ORIGIN if wrench is None else LoadKind(load_kind, load_at)  # type: ignore[arg-type]
    is_scaled = isinstance(of, str) and quantity_named(of).asks == "length"
    settings = Settings.of(
        elastic,
        kind,
        None if wrench is None else np.asarray(wrench, float),
        load_axes,
        connection=connection,
        length=1.0 if length is None and not is_scaled else length,
        direction=direction,
        deflect=deflect,
    )
    if isinstance(of, str):
        (quantity,) = chosen = choose_quantities([of], settings, elastic)
        check_used(settings, chosen)
        asked: Asked = OfQuantity(quantity, settings, elastic)
    else:
        check_used(settings, ())
        asked = OfFunction(of, settings)
    return _Question(subject, asked, load, kind).gradient(by)


def exact_slopes(
    subject: PostureStiffness | Equilibrium,
    asked: Asked,
    load: Mapping[str, Any],
    kind: LoadKind,
) -> dict[str, float]:
    """Derivatives by name of an objective under a load in words of `analyse`; empty where
    they are not exact.
    """
    return _Question(subject, asked, load, kind)._exact()[0]


@lru_cache(maxsize=8)
def _program(case: Case, asked: Asked, comes_to_rest: bool) -> Differentiated:
    """An objective with its derivatives, recorded once; KeyError without an output."""
    return Differentiated(case, asked.needed, asked.recorded, comes_to_rest)


class _Question:
    """An objective of a posture or a state of rest, with its parameters."""

    def __init__(
        self,
        subject: PostureStiffness | Equilibrium,
        asked: Asked,
        load: Mapping[str, Any],
        kind: LoadKind,
    ) -> None:
        self.state = subject if isinstance(subject, Equilibrium) else None
        self.asked, self.kind = asked, kind
        self.parameters = parameters_of(subject, load=load)
        self.nominal = {**self.parameters.of_question, **self.parameters.nominal}
        self.value = self._seen(subject)
        if not np.isfinite(self.value):
            raise UndefinedError(
                f"{asked.name} does not exist at this posture", code="no-objective"
            )

    def _seen(self, subject: PostureStiffness | Equilibrium) -> float:
        """The objective of an answer."""
        if isinstance(subject, Equilibrium):
            subject = replace(subject.elastic_stiffness, load=self.kind)
        return self.asked.seen(subject)

    def gradient(self, by: str | Iterable[str] | None) -> Gradient:
        """Derivatives by the parameters whose names begin so."""
        names = self._chosen(by)
        exact, why = self._exact()
        found, missing = list[Slope](), list[str]()
        for name in names:
            size, value = self.parameters.size(name), exact.get(name, np.nan)
            if abs(value * size) <= numerics.ROUNDOFF_OF_SUMS * abs(self.value):
                value = 0.0
            nominal, unit = self.nominal[name], self.parameters.unit(name)
            slope = Slope(name, nominal, unit, value, name in exact, size=size)
            if slope.is_exact:
                found.append(slope)
                continue
            try:
                found.append(self._quotient(slope))
            except CartstiffError as refused:
                missing.append(f"no derivative by {name}: {one_line(str(refused), 160)}")
        asked, question = self.asked, QUESTIONS[self.state is not None]
        slopes, gaps = tuple(found), tuple(missing)
        return Gradient(asked.name, self.value, asked.unit, question, slopes, gaps, why)

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

    # -- by the recorded arithmetic

    @cached_property
    def _arithmetic(self) -> tuple[Recorded, Differentiated] | str:
        """What is recorded, or the reason why nothing is."""
        recorded = Recorded.of(self.parameters, self.state, with_payload=True)
        if isinstance(recorded, str):
            return f"nothing is recorded: {recorded}"
        try:
            program = _program(recorded.case, self.asked, self.state is not None)
        except KeyError as missing:
            return f"nothing is recorded: {missing.args[0]} is not among its outputs"
        except TypeError as other:  # recorded numbers have no such operation
            return f"nothing is recorded: {self.asked.name}: {other}"
        return recorded, program

    def _exact(self) -> tuple[dict[str, float], str]:
        """Exact derivatives by name, and the reason why there is none."""
        self._is_kink = False
        if isinstance(self._arithmetic, str):
            return {}, self._arithmetic
        recorded, program = self._arithmetic
        found = program.at(recorded.given)
        if found is None:
            return {}, "the posture is not plainly regular"
        if abs(found.values[0] - self.value) > _SAME * abs(self.value):
            return {}, "the recorded arithmetic chooses other rest positions"
        if found.kinks[0]:
            self._is_kink = True
            return {}, (
                "at a kink: two numbers that the objective chooses from are equal here, "
                "such as "
                "principal values; each side has its derivative"
            )
        if (named := recorded.named(found)) is None:
            return {}, "the state of rest is not regular"
        by = {name: float(x[0]) for name, x in named.items()}
        if self.parameters.asked.gravity is None:
            # Nothing that an objective reads depends on what weighs nothing.
            by |= {name: 0.0 for name in self.nominal if name.startswith("mass.")}
        return by, ""

    # -- by analysing again

    def _quotient(self, slope: Slope) -> Slope:
        """The derivative as a difference quotient, at a kink from both sides."""
        if self._is_kink:
            return self._both_sides(slope, slope.size)
        found = self.parameters.quotient(
            slope.name,
            lambda there: [np.array([self._seen(there)])],
            [np.array([self.value])],
        )
        (value,) = found.slopes
        if not np.isfinite(value[0]):
            raise UndefinedError(
                f"{self.asked.name} does not exist nearby", code="no-objective"
            )
        if found.error > _KINKED:
            return self._both_sides(slope, slope.size)
        return replace(slope, value=float(value[0]), error=found.error)

    def _both_sides(self, slope: Slope, natural: float) -> Slope:
        """The derivative from each side."""
        left, right = (self._one_side(slope.name, side * natural) for side in (-1.0, 1.0))
        gap = abs(left - right) * natural / abs(self.value)
        value = 0.5 * (left + right) if gap <= _KINKED else np.nan
        return replace(slope, value=value, error=gap, sides=(left, right))

    def _one_side(self, name: str, natural: float) -> float:
        """Derivative from one side, of fourth order."""
        step = _ONE_SIDED_STEP * natural
        nominal = self.parameters.value(name)
        steps = [
            self._seen(self.parameters.at({name: nominal + k * step}))
            for k in range(1, len(_ONE_SIDED))
        ]
        return float(np.dot(_ONE_SIDED, [self.value, *steps])) / step
