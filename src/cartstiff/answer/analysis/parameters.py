"""Numbers of a mechanism, and what it is at a posture, or at rest, with others of them.

The numbers are the stiffness of every spring and line, a factor on that of every flexible
link (nominally 1); the masses; for chains the placement of each joint on its predecessor
(not of the virtual joints within a link), of the body frame on the last joint, and of the
frames that close loops (translations, and rotations about the placement's own axes); for
platforms the points of base and platform; preloads; the tensions that drives hold; rest
positions;
the parameters of the mechanism's file; compliances of measured springs; the coordinates
that can be chosen; the load; and the mass of a payload at M's origin, beside what the
mechanism carries.

Two questions can be asked about another value of one of them:

- *At this posture*: place and load stay, and rest positions follow, as in a robot whose
  controller holds the posture. Coordinates of a closed chain that are not held move, so
  that the loops stay closed. Tensions among more lines than motions stay as near to what
  they were as the load allows. Beside open rest positions those that are given stay.
- *Comes to rest again*: rest positions and loads stay, and the mechanism moves.

If closures are redundant, most changes of the geometry prevent assembly: such numbers
have no derivative and are named.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from cartstiff.core import numerics
from cartstiff.core.arrays import Array
from cartstiff.core.errors import CartstiffError, InputError
from cartstiff.core.geometry.differences import derivative_with_error
from cartstiff.core.mechanisms.elastic import ElasticMechanism
from cartstiff.core.potentials.contract import Number
from cartstiff.core.stiffness.compute import PostureStiffness, analyse

#: Prefix of the names of the file's parameters.
FILE = "parameter."
#: Name of a mass [kg] hung at M's origin beside what the mechanism carries.
PAYLOAD = "payload"
#: Components of a load.
LOAD = ("mx", "my", "mz", "fx", "fy", "fz")
#: Order of the groups of numbers: all others, those of the geometry, are third.
_ORDER = {"stiffness": 0, "mass": 1, "preload": 1, "offset": 3, "rest": 4}


@dataclass(frozen=True, eq=False)
class Parameters:
    """The numbers of a mechanism at a posture.

    Attributes
    ----------
    result : PostureStiffness
        The nominal mechanism, posture and load; never modified.
    reread : callable, optional
        From values of the file's parameters, by name, to the mechanism; without it these
        are none.
    load : mapping of str, optional
        The load in words of `cartstiff.analyse`, if its components are numbers, too.
    rest_again : callable, optional
        From a mechanism and a changed load, if it is changed, to the state in which it
        comes to rest again; without it the question is *at this posture*.
    """

    result: PostureStiffness
    reread: Callable[[Mapping[str, float]], ElasticMechanism] | None = None
    load: Mapping[str, Any] | None = None
    rest_again: Callable[[ElasticMechanism, Array | None], Any] | None = None

    @property
    def asked(self) -> ElasticMechanism:
        """The mechanism with rest positions as they are given, at rest as they are."""
        result = self.result
        return result.elastic if self.rest_again else result.elastic_as_given

    # -- names, values, units

    @cached_property
    def numbers(self) -> dict[str, Number]:
        """The numbers of springs, masses and geometry that have derivatives, in order."""
        own, geometry = self.asked.numbers(), {*self._geometry}
        placed, misfits = self.asked.mechanism.numbers().keys(), {*self.misfits}

        def varies(name: str, number: Number) -> bool:
            group, _, rest = name.partition(".")
            if group == "rest":
                return bool(self.rest_again) and f"stiffness.{rest}" in own
            if group == "mass" or name not in placed:
                return not number.is_positive or number.value > 0.0
            return name in geometry and name not in misfits

        kept = [name for name, number in own.items() if varies(name, number)]
        kept.sort(key=lambda name: _ORDER.get(name.partition(".")[0], 2))
        return {name: own[name] for name in kept}

    @cached_property
    def nominal(self) -> dict[str, float]:
        """Values by name: those of `numbers`, and "parameter.<name>" of the file."""
        given = {name: number.value for name, number in self.numbers.items()}
        if self.reread is not None:
            of_file = self.result.elastic.parameters.items()
            given |= {f"{FILE}{name}": float(x) for name, x in of_file}
        return given

    @cached_property
    def of_question(self) -> dict[str, float]:
        """Values of what is chosen, by name: "q.<coordinate>", "load.mx" to "load.fz",
        and "payload" where gravity acts.
        """
        names, q = self.asked.names, self.result.q
        chosen = [] if self.rest_again else self.chosen
        given = {f"q.{names[j]}": float(q[j]) for j in chosen}
        if self.load is not None and self.load["wrench"] is not None:
            each = zip(LOAD, np.ravel(self.load["wrench"]), strict=True)
            given |= {f"load.{name}": float(x) for name, x in each}
        if self.asked.gravity is not None:
            given[PAYLOAD] = 0.0
        return given

    @cached_property
    def measured(self) -> dict[str, float]:
        """Compliances and coefficients of measured springs by name."""
        known = self.result.elastic.identified
        labels = [] if known is None else zip(known.labels, known.values, strict=True)
        return {label: float(x) for label, x in labels}

    @property
    def chosen(self) -> list[int]:
        """Coordinates that can be chosen: of a closed chain those that are held."""
        mechanism = self.asked.mechanism
        if mechanism.closures:
            return sorted(mechanism.held)
        return [j for j in range(self.result.q.size) if j not in mechanism.virtual]

    def value(self, name: str) -> float:
        """Nominal value of a number."""
        return {**self.measured, **self.of_question, **self.nominal}[name]

    def size(self, name: str) -> float:
        """Natural size of a number's changes, in its unit."""
        group, length = name.partition(".")[0], self.result.posture.length
        if group == "load":
            each = [abs(x) for n, x in self.of_question.items() if n.startswith("load.")]
            return max(each) or 1.0
        number = self.numbers.get(name)
        if group == "q" or (number is not None and not number.is_positive):
            return 1.0 if self.is_angle(name) else length
        return abs(self.value(name)) or 1.0

    def is_angle(self, name: str) -> bool:
        """Whether a coordinate, rest position or number of the geometry is an angle."""
        group, _, rest = name.partition(".")
        if group == "q":
            names = self.asked.names
            return not self.asked.mechanism.coordinates[names.index(rest)].is_length
        number = self.numbers.get(name)
        return number is not None and not any(number[1:])

    def unit(self, name: str) -> str:
        """Unit of a number."""
        units, (group, _, rest) = self.asked.units, name.partition(".")
        if group == "load":
            return units.force if rest[0] == "f" else f"{units.force} {units.length}"
        if group in ("mass", PAYLOAD):
            return "kg"
        if name in self.numbers and self.numbers[name].force:
            along = self.numbers[name].length < 0.0
            per_rad = f"{units.force} {units.length}/rad"
            if not self.numbers[name].length:
                return units.force
            return f"{units.force}/{units.length}" if along else per_rad
        if name in self.numbers and self.numbers[name].is_positive:
            return "1"
        if name in self.nominal and name not in self.numbers:
            return "unit of the file"
        return "rad" if self.is_angle(name) else units.length

    # -- geometry without derivatives

    @cached_property
    def _geometry(self) -> list[str]:
        """Numbers of the geometry but the place of the base where it does not matter."""
        elastic, mechanism = self.asked, self.asked.mechanism
        left_out: tuple[str, ...] = ("mass.",)
        if mechanism.root and elastic.gravity is None and not elastic.potentials:
            left_out = ("mass.", f"placement.{mechanism.root}.")
        return [n for n in mechanism.numbers() if not n.startswith(left_out)]

    @cached_property
    def misfits(self) -> tuple[str, ...]:
        """Numbers without derivatives: if one is changed, no nearby posture closes.

        To first order: coordinates cannot undo its change of the closures' residual.
        Empty unless the closures are redundant.
        """
        posture, mechanism = self.result.posture, self.asked.mechanism
        closure, length = posture.closure, posture.length
        if closure is None:
            return ()
        U, values, _ = np.linalg.svd(closure.jacobian * posture.coordinate_lengths)
        held = U[:, int((values > numerics.RANK * values[0]).sum()) :].T
        own, found = mechanism.numbers(), []
        for name in self._geometry if len(held) else ():
            step = numerics.DIFFERENCE_STEP * (length if own[name].length else 1.0)
            ends = [
                mechanism.with_numbers({name: own[name].value + s}).at(posture.q)
                for s in (step, -step)
            ]
            change = held @ np.subtract(*[np.asarray(end.residual) for end in ends])
            gap = np.abs(change).max() / (2.0 * numerics.DIFFERENCE_STEP)
            if gap > numerics.NEGLIGIBLE_STEP * max(1.0, length):
                found.append(name)
        return tuple(found)

    @property
    def left_out(self) -> str | None:
        """Message on `misfits`; None without any."""
        if not self.misfits:
            return None
        return (
            f"{len(self.misfits)} of {len(self._geometry)} numbers of the geometry have "
            "no derivative: the closures hold more than they need, and with such a "
            f"number changed no posture closes. They are {', '.join(self.misfits)}"
        )

    # -- the same with other numbers

    def at(self, values: Mapping[str, float]) -> Any:
        """The answer with other values of some numbers: a posture, or a state of rest.

        Raises
        ------
        CartstiffError
            If there is no mechanism with those numbers, or it cannot be closed, or it
            does not come to rest nearby.
        """
        elastic, wrench = self.mechanism(values), self._wrench(values)
        if self.rest_again is not None:
            return self.rest_again(elastic, wrench)
        q = np.array(self.posture_of(elastic), float)
        names = self.asked.names
        for j in self.chosen:
            q[j] = values.get(f"q.{names[j]}", q[j])
        q = elastic.mechanism.closed(q, hold=self._hold).q
        if self.load is not None and self.load["wrench"] is not None:
            return analyse(elastic, q, **{**self.load, "wrench": wrench})
        there = analyse(elastic, q, wrench=self.held_wrench)
        return replace(there, load=self.result.load)

    def mechanism(self, values: Mapping[str, float]) -> ElasticMechanism:
        """The mechanism with other values of some numbers."""
        elastic, known = self.asked, self.result.elastic.identified
        of_file = {n.removeprefix(FILE): x for n, x in values.items() if n[:10] == FILE}
        if of_file and self.reread is not None:
            elastic = self.reread(of_file)
        for pattern in () if known is None else known.patterns:
            if (x := values.get(pattern.label)) is not None:
                change = x - self.measured[pattern.label]
                softer = pattern.changed(elastic.compliances, change)
                elastic = elastic.with_compliances(softer)
        springs, tensions = elastic.springs, self.result.tensions
        if (
            self.rests_are_given
            and not self.rest_again
            and springs is not None
            and tensions is not None
        ):
            elastic = replace(elastic, springs=springs.as_preloaded(tensions))
        elastic = elastic.with_numbers(values)
        if (mass := values.get(PAYLOAD, 0.0)) != 0.0:
            # A derivative at no payload needs less than none.
            hung = elastic.mechanism.with_mass(mass, np.zeros(3))
            elastic = replace(elastic, mechanism=hung)
        return elastic

    @property
    def rests_are_given(self) -> bool:
        """Whether rest positions of springs are given, which hold the posture."""
        springs = self.result.elastic_as_given.springs
        if springs is None:
            return False
        return not np.array_equal(springs.rest_is_free(), ~springs.is_passive)

    @property
    def held_wrench(self) -> Array | None:
        """Wrench (6,) in M that a held posture keeps; None where springs balance it."""
        result = self.result
        springs = result.elastic.springs
        if result._load_is_given or self.rests_are_given:
            return result.wrench
        is_aside = springs is not None and springs.gives_aside
        return np.zeros(6) if is_aside and result.wrench is None else None

    def posture_of(self, elastic: ElasticMechanism, q: Array | None = None) -> Array:
        """Coordinates q, by default the nominal ones; the file's if these are its own."""
        q = self.result.q if q is None else q
        return elastic.q if np.array_equal(q, self.result.elastic.q) else q

    def _wrench(self, values: Mapping[str, float]) -> Array | None:
        """The load's components with other values; None where they are not numbers."""
        own = {**self.of_question, **values}
        each = [own[name] for x in LOAD if (name := f"load.{x}") in own]
        return np.array(each) if each else None

    @cached_property
    def _hold(self) -> tuple[int, ...] | None:
        """None, or no coordinates to hold where the others cannot close the chain."""
        closure = self.result.posture.closure
        if closure is None:
            return None
        mechanism = self.asked.mechanism
        moving = np.array([j not in mechanism.rigid for j in range(self.result.q.size)])
        free = moving & ~np.isin(np.arange(moving.size), list(mechanism.held))
        C = closure.jacobian * self.result.posture.coordinate_lengths
        ranks = [numerics.rank(numerics.singular_values(C[:, x])) for x in (free, moving)]
        return None if ranks[0] == ranks[1] else ()

    # -- the one difference quotient

    def quotient(
        self,
        name: str,
        seen: Callable[[Any], Sequence[Array]],
        here: Sequence[Array],
    ) -> Quotient:
        """Derivatives of arrays by a number, from answers with other values of it.

        The first step is taken at which two orders agree. A small effect is computed
        again with a wider step, if two orders agree there as well.

        Parameters
        ----------
        name : str
        seen : callable
            From an answer to the arrays.
        here : sequence of ndarray
            The arrays at the nominal values.
        """
        best: Quotient | None = None
        refused: CartstiffError | None = None
        for step in numerics.EIGHTH_ORDER_STEPS:
            try:
                found = self._quotient(name, step, seen, here)
            except CartstiffError as error:
                refused = error
                continue
            if best is not None and found.error >= best.error:
                break  # smaller steps only increase the round-off
            best = found
            if best.error <= numerics.STALLED_RESIDUAL:
                break
        if best is None:
            raise refused or InputError(f"{name} cannot be varied")
        is_small = numerics.PRINTED_AS_ZERO < best.effect < numerics.NEGLIGIBLE_CHANGE
        if is_small and best.error <= numerics.STALLED_RESIDUAL:
            with suppress(CartstiffError):
                step = numerics.WIDEST_EIGHTH_ORDER_STEP
                found = self._quotient(name, step, seen, here)
                best = found if found.error <= numerics.STALLED_RESIDUAL else best
        return best

    def _quotient(
        self,
        name: str,
        share: float,
        seen: Callable[[Any], Sequence[Array]],
        here: Sequence[Array],
    ) -> Quotient:
        nominal, natural = self.value(name), self.size(name)

        def flat(change: float) -> Array:
            return np.concatenate(
                [x.ravel() for x in seen(self.at({name: nominal + change}))]
            )

        ends = np.cumsum([x.size for x in here])[:-1]
        slopes, errors = (
            [part.reshape(x.shape) for part, x in zip(parts, here, strict=True)]
            for parts in (
                np.split(each, ends)
                for each in derivative_with_error(flat, share * natural)
            )
        )
        return Quotient.of(slopes, errors, here, natural)


class Quotient(NamedTuple):
    """Derivatives of arrays by a number.

    Attributes
    ----------
    slopes : list of ndarray
    error : float
        Largest relative error; that of an array which does not depend on the number is
        relative to the array.
    effect : float
        Largest relative change for the natural size of the number.
    """

    slopes: list[Array]
    error: float
    effect: float

    @classmethod
    def of(
        cls,
        slopes: Sequence[Array],
        errors: Sequence[Array],
        here: Sequence[Array],
        natural: float,
    ) -> Quotient:
        """From derivatives, their errors, the arrays and the number's natural size."""
        off = effect = 0.0
        for x, e, there in zip(slopes, errors, here, strict=True):
            if (size := max(largest(x), largest(there) / natural)) > 0.0:
                off, effect = max(off, largest(e) / size), max(effect, largest(x) / size)
        return cls(list(slopes), off, effect)


def largest(values: Array) -> float:
    """Size of the largest finite entry; 0 without any."""
    return float(np.max(np.abs(values), where=np.isfinite(values), initial=0.0))
