"""What springs have in common, whether they act in joints or along lines.

Energy Phi = sum_i U_i(x_i - r_i) with positions x and rest positions r. A law has U_i,
its force U_i' and its stiffness U_i''.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Container, Mapping, Sequence
from types import MappingProxyType
from typing import Any, ClassVar, NamedTuple, Self

import numpy as np

from cartstiff.core.arrays import Array
from cartstiff.core.errors import InputError
from cartstiff.core.potentials.contract import Named, Number, Parts, Posture, Potential


class Corner(NamedTuple):
    """A point of a table at which the stiffness changes: below it, above it."""

    deflection: float
    below: float
    above: float


class SpringLaw(ABC):
    """Torque of a spring as a function of its deflection x."""

    #: Coefficients c_1, c_2, ... of a polynomial; of other laws none.
    powers: tuple[float, ...] = ()
    #: Points of a table at which the stiffness jumps.
    corners: tuple[Corner, ...] = ()
    corner_width: float = 0.0

    def corner_at(self, x: float) -> Corner | None:  # noqa: ARG002
        """The corner at a deflection, where the stiffness jumps; None elsewhere."""
        return None

    @abstractmethod
    def evaluate(self, x: Any) -> tuple[Any, Any, Any]:
        """Energy, torque and tangent stiffness at a deflection, or at each of (N,)."""

    @abstractmethod
    def deflection_for(self, torque: float) -> float:
        """Deflection that carries a torque.

        Raises
        ------
        InputError
            If the law does not reach that torque.
        """

    def in_units(self, size: float, effort: float) -> SpringLaw:  # noqa: ARG002
        """The same law with the numbers of deflections times `size` and of torques
        times `effort`.

        Raises
        ------
        InputError
            For a law that has no such conversion.
        """
        what = "a spring's law is not converted to other units"
        raise InputError(what, where="units", got=type(self).__name__)


class Chosen(NamedTuple):
    """Springs whose rest positions were chosen.

    Attributes
    ----------
    springs : Springs
        They.
    forces : ndarray (n,) or None
        The chosen forces on coordinates, NaN where none is chosen; None for lines.
    left : ndarray (n,) or None
        What no spring of a joint can have of the gradient, where that forbids a choice.
    """

    springs: Springs
    forces: Array | None = None
    left: Array | None = None


class Springs(Potential):
    """Springs whose rest positions can be chosen: one per coordinate, or along lines.

    The defaults are those of one spring per coordinate.

    Attributes
    ----------
    stiffness, rest : ndarray (m,)
        Of each spring; NaN for rest positions that are to be chosen.
    laws : mapping of int to SpringLaw
        Nonlinear springs by number.
    rigid : frozenset of int
        Rigid ones.
    unilateral : bool or tuple of bool (m,)
        Springs that cannot push.
    driven : bool or tuple of bool (m,)
        Springs that a drive moves: all, or some of them.
    preload, balanced_at
        Given tensions of driven lines, and those that were chosen, see `LineSprings`.
    """

    stiffness: Array
    rest: Array
    laws: Mapping[int, SpringLaw] = MappingProxyType({})
    rigid: frozenset[int] = frozenset()
    unilateral: bool | tuple[bool, ...] = False
    driven: bool | tuple[bool, ...] = False
    preload: Array | None = None
    balanced_at: tuple[Array, Array, Array] | None = None
    #: What rest positions are called, and whose they are.
    rest_words: ClassVar[tuple[str, str]] = ("rest positions", "their joints")
    #: Smallest rest position.
    least_rest: float = -np.inf
    #: Whether a load leaves a choice of the springs' forces.
    is_redundant: bool = False
    #: Whether they give in other directions than their own, as flexures do.
    gives_aside: bool = False

    @property
    def is_complete(self) -> bool:
        """Whether every spring has a rest position."""
        return not self.rest_is_free().any()

    @property
    def is_passive(self) -> Array:
        """Which of them are no springs (m,)."""
        return np.zeros(len(self.stiffness), bool)

    @property
    def undriven(self) -> frozenset[int]:
        """Numbers of those that are no springs, nor rigid."""
        return frozenset(np.flatnonzero(self.is_passive).tolist()) - self.rigid

    @property
    def cables(self) -> Array:
        """Which of them cannot push (m,)."""
        return np.full(self.stiffness.shape, self.unilateral)

    @abstractmethod
    def rest_is_free(self, every: bool = False) -> Array:
        """Rest positions to be chosen (m,): those not given, or all."""

    @abstractmethod
    def replaced(self, stiffness: Array, rest: Array) -> Self:
        """The same springs with other stiffnesses and rest positions."""

    def shared(self, posture: Posture, every: bool) -> tuple[Array, Array]:  # noqa: ARG002
        """Stiffness of the coordinates' own springs whose rest positions are chosen, and
        gradient of the others, (n,) each; 0 elsewhere.
        """
        return np.zeros(posture.q.shape), np.zeros(posture.q.shape)

    @abstractmethod
    def balancing(
        self, posture: Posture, gradient: Array, size: float, every: bool
    ) -> Chosen:
        """Choose rest positions, those not given or all, so that the springs exert a
        gradient (n,) at a posture, beside the closures.

        What is negligible beside `size` counts as nothing.
        """

    @abstractmethod
    def tangent(self, posture: Posture) -> Array:
        """Tangent stiffness of each (m,) at a posture."""

    def labels(self, first: int) -> Sequence[str]:  # noqa: ARG002
        """None: those of coordinates beside the mechanism's own have no names."""
        return ()

    def names_in(self, coordinates: Sequence[Named]) -> tuple[str, ...]:
        """Name of each spring of a mechanism with these coordinates."""
        return tuple(c.name for c in coordinates)

    def slides_in(self, coordinates: Sequence[Named]) -> list[bool]:
        """Whether each spring of a mechanism with these `coordinates` deflects by a
        distance.
        """
        return [c.is_length for c in coordinates]

    def positions(self, posture: Posture) -> Array:
        """Position (m,) of each spring, in its unit: the deflection is the difference to
        `rest`.
        """
        return posture.q

    def rows(self, posture: Posture) -> Array:
        """Change of `positions` per coordinate rate (m, n)."""
        return np.eye(len(posture.q))

    def torque(self, q: Array) -> Array:
        """Torque of each coordinate's own spring (n,); zero without one."""
        return np.zeros_like(q)

    def pull(self, posture: Posture) -> Array:
        """Force of each spring (m,) at a posture."""
        return self.torque(posture.q)

    def pull_at(self, q: Array, pose: Array) -> Array:  # noqa: ARG002
        """`pull` of a mechanism's own springs at coordinates (n,) and a pose of M."""
        return self.torque(q)

    def of_coordinates(self, count: int) -> Array:  # noqa: ARG002
        """Stiffness of the own spring of each of `count` coordinates (n,).

        Zero without one, or with a law.
        """
        return self.stiffness

    def has_coordinate(self, count: int) -> Array:
        """Which of `count` coordinates (n,) have a spring of their own."""
        own = self.of_coordinates(count) > 0.0
        own[list(self.laws)] = True
        return own

    def taut(self, posture: Posture) -> Array:  # noqa: ARG002
        """Springs (m,) that carry force at a posture."""
        return np.ones(len(self.stiffness), bool)

    def holding(self, lines: Array | None = None) -> Array:  # noqa: ARG002
        """Springs (m,) that are to keep a given force at a posture, whatever acts;
        `lines` (6, m) are those at the posture.
        """
        return np.zeros(len(self.stiffness), bool)

    def require_ideal_joints(self, what: str) -> None:
        """Refuse springs that bend at their ends, for `what` they cannot have."""

    def linear(self, which: Container[int]) -> Self:  # noqa: ARG002
        """The same without the laws of some springs, and with none rigid."""
        return self

    def with_laws(self, laws: Mapping[int, SpringLaw]) -> Self:  # noqa: ARG002
        """The same with other laws, where it can have some."""
        return self

    def at_rest(self, q: Array) -> Self:  # noqa: ARG002
        """The same with springs of coordinates at rest at q (n,)."""
        return self

    def unloaded(self, positions: Array) -> Self:
        """The same at rest at `positions` (m,), NaN where these are open;
        cables are bars.
        """
        return self.replaced(self.stiffness, positions)

    def at_points(self, anchors: Array, points: Array) -> Self:  # noqa: ARG002
        """The same between other points of F and of M.

        Springs of coordinates have none.
        """
        return self

    def as_preloaded(self, tensions: Array) -> Self:  # noqa: ARG002
        """The same with open rest lengths and a preload of these tensions (m,),
        where that is a number they have.
        """
        return self

    def shifted(self, posture: Posture, which: Sequence[int], less: Array) -> Self:  # noqa: ARG002
        """The same with the tensions of some springs reduced by `less` (m,), where that
        is a number they have.
        """
        return self

    @property
    def _linear(self) -> list[int]:
        own = np.flatnonzero(~self.is_passive).tolist()
        return [i for i in own if i not in self.laws]

    def parts(
        self, posture: Posture, coordinates: Sequence[Named], names: Sequence[str]
    ) -> Parts:
        """Each spring; slack cables have neither stiffness nor force."""
        names = names or self.names_in(coordinates)
        slides, rows = self.slides_in(coordinates), self.rows(posture)
        k, forces = self.tangent(posture), self.pull(posture)
        if self.is_passive.any():
            own = np.flatnonzero(~self.is_passive).tolist()
            names, slides = [names[i] for i in own], [slides[i] for i in own]
            rows, k, forces = rows[own], k[own], forces[own]
        return Parts(names, slides, rows, np.diag(k), forces)

    def numbers(
        self, names: Sequence[str], slides: Sequence[bool] | None = None
    ) -> dict[str, Number]:
        """Stiffnesses of linear springs, and rest positions that are known;
        lines slide.
        """
        linear = self._linear if names else []
        own = [(i, names[i], slides is None or slides[i]) for i in linear]
        k, rest = self.stiffness.tolist(), self.rest.tolist()
        found = {
            f"stiffness.{name}": Number(k[i], -1.0 if is_length else 1.0, 1.0, True)
            for i, name, is_length in own
        }
        known = [each for each in own if rest[each[0]] == rest[each[0]]]
        return found | {f"rest.{n}": Number(rest[i], float(x)) for i, n, x in known}

    def with_numbers(self, values: Mapping[str, float], names: Sequence[str]) -> Self:
        """The same with other stiffnesses, "stiffness.NAME", and rest positions,
        "rest.NAME".
        """
        if not names:
            return self
        k, rest = (
            [values.get(f"{word}.{n}", x) for n, x in zip(names, own, strict=True)]
            for word, own in (("stiffness", self.stiffness), ("rest", self.rest))
        )
        return self.replaced(np.array(k), np.array(rest))

    def compliances(
        self, names: Sequence[str], slides: Sequence[bool]
    ) -> dict[str, Number]:
        """Those of linear springs."""
        own = self.numbers(names, slides)
        each = {name: own.get(f"stiffness.{name}") for name in names}
        return {
            name: Number(1.0 / k.value, -k.length, -k.force, True)
            for name, k in each.items()
            if k is not None
        }

    def with_compliances(self, values: Mapping[str, float], names: Sequence[str]) -> Self:
        """The same with other linear springs."""
        k = self.stiffness.copy()
        for i in self._linear if names else ():
            k[i] = 1.0 / values[names[i]] if names[i] in values else k[i]
        return self.replaced(k, self.rest)

    def softened(self, key: str, names: Sequence[str]) -> tuple[Self, Self, float]:
        """A linear spring, twice as stiff."""
        k, i = self.stiffness.copy(), names.index(key)
        k[i] *= 2.0
        return self.replaced(k, self.rest), self, -float(self.stiffness[i])
