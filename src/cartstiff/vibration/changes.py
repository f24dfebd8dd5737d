r"""How a mechanism's matrices change with one parameter: it is changed and analysed again.

Differences of eighth order; what a lower order would have given says how sure they are. Loops, and
the rest of a mechanism that finds it by itself, are sought from where the parameter's other values
have led, by the polynomial through these: a step or two then settle them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from cartstiff import numerics
from cartstiff.analysis.tolerances import Tolerances, UncertainParameters
from cartstiff.errors import CartstiffError, InputError, UndefinedError
from cartstiff.geometry.differences import derivative_with_error
from cartstiff.geometry.se3 import Array
from cartstiff.mechanisms.chain import Chain
from cartstiff.mechanisms.contract import Units, convert_length
from cartstiff.mechanisms.elastic import ElasticMechanism
from cartstiff.statics.equilibrium import again
from cartstiff.statics.rest import Equilibrium
from cartstiff.statics.small_motions import kinetic_matrix
from cartstiff.stiffness.compute import PostureStiffness
from cartstiff.vibration.mode_set import Modes
from cartstiff.vibration.modes import stiffness_under_load

_EVERY = Tolerances(1.0, 1.0, 1.0)
MATRICES = ("A", "B", "K", "F")


@dataclass(frozen=True, eq=False)
class Row:
    """Derivatives by one parameter, and what its natural size changes of a matrix, as a share."""

    matrices: Array
    pose: Array
    squares: Array
    error: float
    effect: float = 1.0


class Home:
    """The mechanism as it is: looks at it with other parameters."""

    def __init__(
        self,
        subject: Modes | PostureStiffness | Equilibrium,
        reread: Callable[[Mapping[str, float]], ElasticMechanism] | None = None,
        tolerances: Tolerances = _EVERY,
    ) -> None:
        if isinstance(subject, Modes):
            subject = subject.state if subject.state is not None else subject.held
        self.state = subject if isinstance(subject, Equilibrium) else None
        if self.state is not None and self.state.has_free_motion:
            raise UndefinedError(
                "where it rests is not decided, as a motion of the body costs nothing: what is "
                "there has no derivatives",
                code="neutral",
            )
        result = subject.elastic_stiffness if isinstance(subject, Equilibrium) else subject
        self.parameters = UncertainParameters(result, tolerances, reread, self.state is not None)
        self.nominal: PostureStiffness | Equilibrium = subject
        #: Its stiffness; at rest with the part of its loads.
        self.result = subject.stiffness if isinstance(subject, Equilibrium) else subject
        self._here: tuple[Array, ...] | None = None
        mechanism = subject.elastic.mechanism
        #: Coordinates of a closed chain that stay where they are, if the others can close it.
        self._held = list(mechanism.held) if isinstance(mechanism, Chain) else []
        self._seen: dict[float, Array] = {}

    def at(self, name: str, change: float) -> PostureStiffness | Equilibrium:
        """The same with another value of a parameter."""
        value = self.parameters.value(name) + change
        result = self._at({name: value}, *self._start(change))
        self._seen[change] = result.q
        return result

    def _start(self, change: float) -> tuple[Array, bool]:
        """Coordinates on the polynomial through those at other values of the parameter.

        And whether a chain is closed by all its coordinates. Then its drives must follow, by steps
        of least change, whose sum depends on where they start: from where it is.
        """
        home, seen = self.nominal.q, self._seen
        moved = np.array([q - home for q in seen.values()]).reshape(-1, home.size)
        if not seen or (self.state is None and moved[:, self._held].any()):
            return home, bool(seen)
        nodes = np.array([0.0, *seen])
        weights = [
            np.prod((change - (others := np.delete(nodes, i))) / (x - others))
            for i, x in enumerate(nodes)
        ]
        return np.asarray(home + weights[1:] @ moved), False

    def _at(
        self, values: Mapping[str, float], start: Array, by_all: bool
    ) -> PostureStiffness | Equilibrium:
        if self.state is None:
            return self.parameters.at(values, start, by_all)
        elastic = self.parameters.mechanism(values)
        if elastic.springs is not None and not elastic.springs.is_complete:
            chosen = self.parameters.posture_of(elastic, self.state.start.q)
            elastic = elastic.balanced(elastic.mechanism.closed(chosen))
        return again(self.state, elastic, start)

    def row(self, name: str, modes: Modes | None) -> Row:
        """Derivatives by one parameter; the first step is taken with which two orders agree.

        What hardly depends on it shows above the rounding with a wider one, if that agrees, too.
        """
        best: Row | None = None
        refused: CartstiffError | None = None
        for step in numerics.EIGHTH_ORDER:
            try:
                row = self._row(name, step, modes)
            except CartstiffError as error:
                refused = error
                continue
            if best is not None and row.error >= best.error:
                break  # a tenth of the step shows more rounding, and the next shows more yet
            best = row
            if best.error <= numerics.CONVERGED:
                break
        if best is None:
            raise refused or InputError(f"{name} cannot be varied")
        if numerics.BLANK < best.effect < numerics.SLIGHT and best.error <= numerics.CONVERGED:
            with suppress(CartstiffError):
                row = self._row(name, numerics.WIDEST, modes)
                best = row if row.error <= numerics.CONVERGED else best
        return best

    def _observed(self, modes: Modes | None) -> tuple[Array, ...]:
        if self._here is None:
            self._here = _observed(self.nominal, modes is not None)
        return self._here

    def _row(self, name: str, share: float, modes: Modes | None) -> Row:
        natural = self.parameters.size(name)
        shapes: list[tuple[int, ...]] = []
        self._seen = {}

        def seen(change: float) -> Array:
            parts = _observed(self.at(name, change), modes is not None)
            shapes[:] = [part.shape for part in parts]
            return np.concatenate([part.ravel() for part in parts])

        slope, error = derivative_with_error(seen, share * natural)
        ends = np.cumsum([int(np.prod(shape)) for shape in shapes])[:-1]
        slopes, errors = (
            [x.reshape(shape) for x, shape in zip(np.split(flat, ends), shapes, strict=True)]
            for flat in (slope, error)
        )
        (dK, dT, dH, dM, dC) = slopes
        R = self.nominal.pose[:3, :3]
        turn = dT[:3, :3] @ R.T
        pose = np.array([turn[2, 1], turn[0, 2], turn[1, 0], *dT[:3, 3]])
        squares = np.zeros(0) if modes is None else change_of_squares(modes, dH, dM, dC)
        # A matrix that does not depend on the parameter is compared with itself.
        here = self._observed(modes)
        off = effect = 0.0
        for x, e, there in zip(slopes, errors, here, strict=True):
            size = max(_largest(x), _largest(there) / natural)
            if size > 0.0:
                off, effect = max(off, _largest(e) / size), max(effect, _largest(x) / size)
        # What is no more than rounding, of all that an entry is beside, is told as 0.
        noise = max(numerics.LAST_DIGITS, min(off, numerics.CLOSE)) / natural
        columns = np.repeat([1.0, self.nominal.posture.length], 3)
        energies = np.outer(columns, columns)
        for x, K in zip(dK, here[0], strict=True):
            size = max(natural * _largest(x * energies), _largest(K * energies))
            x[np.abs(x) <= noise * size / energies] = 0.0
        pose[np.abs(pose) <= noise * columns] = 0.0
        if modes is not None:
            least = max(noise, numerics.BLANK / natural)
            squares[np.abs(squares) <= least * np.abs(modes.squares)] = 0.0
        return Row(dK, pose, squares, off, effect)


def _largest(values: Array) -> float:
    """Size of the largest entry that exists; 0 without any."""
    return float(np.max(np.abs(values), where=np.isfinite(values), initial=0.0))


def _observed(state: PostureStiffness | Equilibrium, with_masses: bool) -> tuple[Array, ...]:
    """K^A, K^B, K^K, K^F; pose; K, M on all coordinates; the constraints' Jacobian."""
    result = state.stiffness if isinstance(state, Equilibrium) else state
    none = np.full((6, 6), np.nan)
    each = [none if (K := result.matrices[name]) is None else K for name in MATRICES]
    nothing = np.zeros((0, 0))
    if not with_masses:
        return np.array(each), state.pose, nothing, nothing, nothing
    terms, units = result.elastic.terms(), result.elastic.units
    M = kinetic_matrix(state.posture, terms, units)
    K, C = _stiffness_and_constraints(state)
    C = np.zeros((0, len(K))) if C is None else C
    return np.array(each), state.pose, K, np.zeros_like(K) if M is None else M, C


def _stiffness_and_constraints(
    state: PostureStiffness | Equilibrium,
) -> tuple[Array, Array | None]:
    """K (n, n) on all coordinates with all that acts, and the constraints' Jacobian (m, n)."""
    if isinstance(state, Equilibrium):
        return state.full_stiffness
    closure = state.posture.closure
    return stiffness_under_load(state)[0], None if closure is None else closure.jacobian


def change_of_squares(
    modes: Modes, dK: Array, dM: Array | None = None, dC: Array | None = None
) -> Array:
    """d(omega^2) (k,) in 1/s^2 for changes of the matrices on all coordinates."""
    length, force = convert_length(Units(), modes.elastic.units)
    right, left = modes.basis @ modes.spectrum.vectors, modes.basis @ modes.spectrum.left
    squares, units = modes.spectrum.squares, length / force
    carried = None if dC is None or not len(dC) else _carried(modes, right, left, squares)
    rates = np.empty(squares.size)
    for group in modes.groups:
        phi, psi, x = right[:, group], left[:, group], squares[group]
        form = psi.T @ dK @ phi - (0.0 if dM is None else (psi.T @ dM @ phi) * x)
        if dC is not None and carried is not None:
            mu_phi, mu_psi = carried[0][:, group], carried[1][:, group]
            form += mu_psi.T @ dC @ phi + (dC @ psi).T @ mu_phi
        if len(group) == 1:
            rates[group] = form[0, 0]
        else:
            rates[group] = np.sort(np.linalg.eigvals(form).real)
    return rates * units


def _carried(modes: Modes, right: Array, left: Array, squares: Array) -> tuple[Array, Array]:
    """What the constraints carry while each mode swings, to the right and to the left modes."""
    K, C = _stiffness_and_constraints(modes.held if modes.state is None else modes.state)
    M = modes.full_mass
    columns = modes.posture.coordinate_lengths[:, None]
    C = ((np.zeros((0, len(K))) if C is None else C).T * columns).astype(float)
    mu_right, mu_left = (
        -np.linalg.lstsq(C, columns * (A @ x - M @ x * squares), rcond=numerics.RANK)[0]
        for A, x in ((K, right), (K.T, left))
    )
    return mu_right, mu_left
