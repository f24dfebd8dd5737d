r"""How stiffness, pose and frequencies depend on each parameter of a mechanism.

Parameters are those of `cartstiff.analysis.tolerances`: stiffnesses, masses, placements or points,
rest positions, and what the mechanism's file calls its parameters. A posture that is held keeps its
place and its load, and rest positions follow. A mechanism that came to rest by itself comes to rest
anew: the derivatives are total, with the motion of the rest in them.

Every derivative is taken of the mechanism itself, changed and analysed again, by differences of
eighth order; what a lower order would have given says how sure they are. Frequencies do not come
from differences of frequencies, which cross: with left and right modes psi, phi and
``psi^T M phi = 1``

    d(omega^2)/dp = psi^T (dK/dp - omega^2 dM/dp) phi + mu_psi . dC phi + mu_phi . dC psi

where C is the constraints' Jacobian and ``C^T mu_phi = -(K - omega^2 M) phi`` what they carry. Of
repeated modes it is the eigenvalues of that form on the subspace, in their order.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from cartstiff import numerics
from cartstiff.analysis.tolerances import Parameters, Tolerances
from cartstiff.arrays import Result
from cartstiff.errors import CartstiffError, InputError, UndefinedError, one_line
from cartstiff.geometry.differences import derivative_with_error
from cartstiff.geometry.se3 import Array
from cartstiff.mechanisms.contract import Units, convert_length
from cartstiff.mechanisms.elastic import ElasticMechanism
from cartstiff.statics.equilibrium import again
from cartstiff.statics.rest import Equilibrium
from cartstiff.statics.small_motions import kinetic_matrix
from cartstiff.stiffness.compute import PostureStiffness
from cartstiff.vibration.mode_set import Modes
from cartstiff.vibration.modes import modes, stiffness_under_load

__all__ = [
    "MATRICES",
    "Home",
    "Sensitivities",
    "change_of_squares",
    "in_hertz",
    "modes_of",
    "sensitivities",
]

_EVERY = Tolerances(1.0, 1.0, 1.0)
MATRICES = ("A", "B", "K", "F")


@dataclass(frozen=True, eq=False)
class Sensitivities(Result):
    """Derivatives by all parameters.

    Attributes
    ----------
    names : tuple of str
        As in `cartstiff.analysis.tolerances.Parameters.nominal`.
    values : ndarray (p,)
        Nominal values.
    stiffness : mapping of str to ndarray (p, 6, 6)
        dK/dp of K^A, K^B, K^K, K^F at M's origin, per unit of the parameter; NaN where the matrix
        does not exist. Of a mechanism at rest K holds the part of its loads.
    pose : ndarray (p, 6)
        Rotation vector and displacement of M's origin along the axes of F, per unit.
    squares : ndarray (p, k)
        d(omega^2)/dp in 1/s^2 per unit; no columns where nothing has a mass.
    frequencies : ndarray (p, k)
        df/dp in Hz per unit; NaN where f is 0 or does not exist.
    errors : ndarray (p,)
        Share of its largest entry by which a row of the matrices K and M may be off, at most.
    angles : tuple of bool
        Which parameters are angles, in rad.
    left_out : str or None
        Which parameters are not among them, and why.
    """

    names: tuple[str, ...]
    values: Array
    stiffness: Mapping[str, Array]
    pose: Array
    squares: Array
    frequencies: Array
    errors: Array
    angles: tuple[bool, ...] = ()
    left_out: str | None = None

    def of(self, name: str) -> Array:
        """df/dp (k,) of a named parameter.

        Raises
        ------
        InputError
            For another name.
        """
        return self.frequencies[self.index(name)]

    def index(self, name: str) -> int:
        """Row of a named parameter; InputError for another name."""
        if name not in self.names:
            raise InputError("unknown parameter", expected=", ".join(self.names), got=repr(name))
        return self.names.index(name)

    @property
    def relative(self) -> Array:
        """Change (p, k) in Hz for one per cent of each parameter; NaN of those that are zero."""
        return 0.01 * np.where(self.values, self.values, np.nan)[:, None] * self.frequencies

    def as_dict(self) -> dict[str, Any]:
        """Plain data: derivatives per unit of each parameter, and Hz for one per cent."""
        return {
            "left_out": self.left_out,
            "parameters": [
                {"name": name, "value": float(self.values[i]), "error": float(self.errors[i]),
                 "stiffness": {letter: _matrix(dK[i]) for letter, dK in self.stiffness.items()},
                 "pose": _plain(self.pose[i]), "frequencies": _plain(self.frequencies[i]),
                 "for_one_per_cent": _plain(self.relative[i])}
                for i, name in enumerate(self.names)
            ],
        }  # fmt: skip


def _plain(values: Array) -> list[float | None]:
    return [float(x) if np.isfinite(x) else None for x in values]


def _matrix(values: Array) -> list[list[float]] | None:
    return values.tolist() if np.isfinite(values).all() else None


def sensitivities(
    subject: Modes | PostureStiffness | Equilibrium,
    *,
    geometry: bool = True,
    reread: Callable[[Mapping[str, float]], ElasticMechanism] | None = None,
) -> Sensitivities:
    """Derivatives of stiffness, pose and frequencies by every parameter.

    Parameters
    ----------
    subject : Modes, PostureStiffness or Equilibrium
        A held posture, or where a mechanism came to rest.
    geometry : bool
        Whether placements of joints, or points of platforms, are varied.
    reread : callable, optional
        From values of the file's own parameters to the mechanism, for derivatives by these:
        ``lambda values: cartstiff.load(file, parameters=values)``.

    Raises
    ------
    UndefinedError
        Where modes flutter: a complex frequency has no derivative here; or where a posture has no
        stiffness at all.

    Examples
    --------
    >>> import cartstiff
    >>> known = cartstiff.sensitivities(cartstiff.analyse(cartstiff.load("stewart-gough")))
    >>> float(known.stiffness["K"][known.index("stiffness.leg1"), 5, 5].round(3))
    0.496
    """
    found = subject if isinstance(subject, Modes) else modes_of(subject)
    if found is not None and found.spectrum.is_complex:
        raise UndefinedError("modes that flutter have no sensitivities", code="flutter")
    home = Home(subject, reread)
    rows: dict[str, Row] = {}
    missing: list[str] = [] if (told := home.parameters.left_out) is None else [told]
    for name, nominal in home.parameters.nominal.items():
        if geometry or name.partition(".")[0] in ("stiffness", "mass"):
            try:
                rows[name] = home.row(name, nominal, found)
            except CartstiffError as error:
                missing.append(f"{name} is not varied: {one_line(str(error), 200)}")
    k = 0 if found is None else found.frequencies.size
    squares = np.array([r.squares for r in rows.values()]).reshape(len(rows), k)
    return Sensitivities(
        tuple(rows), np.array([home.parameters.nominal[name] for name in rows]),
        {letter: np.array([r.matrices[i] for r in rows.values()]).reshape(-1, 6, 6)
         for i, letter in enumerate(MATRICES)},
        np.array([r.pose for r in rows.values()]).reshape(-1, 6), squares,
        squares if found is None else in_hertz(found, squares),
        np.array([r.error for r in rows.values()]),
        tuple(home.parameters.is_angle(name) for name in rows), "; ".join(missing) or None,
    )  # fmt: skip


def modes_of(subject: PostureStiffness | Equilibrium) -> Modes | None:
    """Modes of a result; None where nothing that moves has a mass."""
    try:
        return modes(subject)
    except UndefinedError:
        return None


@dataclass(frozen=True, eq=False)
class Row:
    """Derivatives by one parameter."""

    matrices: Array
    pose: Array
    squares: Array
    error: float


class Home:
    """The mechanism as it is: looks at it with other parameters."""

    def __init__(
        self, subject: Modes | PostureStiffness | Equilibrium,
        reread: Callable[[Mapping[str, float]], ElasticMechanism] | None = None,
        tolerances: Tolerances = _EVERY,
    ) -> None:  # fmt: skip
        if isinstance(subject, Modes):
            subject = subject.state if subject.state is not None else subject.held
        self.state = subject if isinstance(subject, Equilibrium) else None
        result = subject.elastic_stiffness if isinstance(subject, Equilibrium) else subject
        self.parameters = Parameters(result, tolerances, reread, self.state is not None)
        self.nominal: PostureStiffness | Equilibrium = subject
        #: Its stiffness; at rest with the part of its loads.
        self.result = subject.stiffness if isinstance(subject, Equilibrium) else subject
        self._here: tuple[Array, ...] | None = None
        self._last: tuple[str, float, Array] = "", 1.0, subject.q

    def at(self, values: Mapping[str, float]) -> PostureStiffness | Equilibrium:
        """The same with other parameters."""
        if self.state is None:
            return self.parameters.at(values)
        elastic = self.parameters.mechanism(values)
        if elastic.springs is not None and not elastic.springs.is_complete:
            start = self.parameters.posture_of(elastic, self.state.start.q)
            elastic = elastic.balanced(elastic.mechanism.closed(start))
        (name, value), home = next(iter(values.items())), self.state.q
        change, (before, last, q) = value - self.parameters.nominal[name], self._last
        near = before == name and change * last > 0.0  # as far again as the last one moved
        found = again(self.state, elastic, home + (q - home) * (change / last) if near else home)
        self._last = name, change, found.q
        return found

    def row(self, name: str, nominal: float, found: Modes | None) -> Row:
        """Derivatives by one parameter; the first step is taken with which two orders agree."""
        best: Row | None = None
        refused: CartstiffError | None = None
        for step in numerics.EIGHTH_ORDER:
            size = step * self.parameters.size(name)
            try:
                row = self._row(name, nominal, size, found)
            except CartstiffError as error:
                refused = error
                continue
            best = row if best is None or row.error < best.error else best
            if best.error <= numerics.CONVERGED:
                break
        if best is None:
            raise refused or InputError(f"{name} cannot be varied")
        return best

    def _observed(self, found: Modes | None) -> tuple[Array, ...]:
        if self._here is None:
            self._here = _observed(self.nominal, found is not None)
        return self._here

    def _row(self, name: str, nominal: float, step: float, found: Modes | None) -> Row:
        shapes: list[tuple[int, ...]] = []

        def seen(change: float) -> Array:
            parts = _observed(self.at({name: nominal + change}), found is not None)
            shapes[:] = [part.shape for part in parts]
            return np.concatenate([part.ravel() for part in parts])

        slope, error = derivative_with_error(seen, step)
        ends = np.cumsum([int(np.prod(shape)) for shape in shapes])[:-1]
        slopes, errors = (
            [x.reshape(shape) for x, shape in zip(np.split(flat, ends), shapes, strict=True)]
            for flat in (slope, error)
        )
        (dK, dT, dH, dM, dC) = slopes
        R = self.nominal.pose[:3, :3]
        turn = dT[:3, :3] @ R.T
        pose = np.array([turn[2, 1], turn[0, 2], turn[1, 0], *dT[:3, 3]])
        squares = np.zeros(0) if found is None else change_of_squares(found, dH, dM, dC)
        # A matrix that does not depend on the parameter is compared with itself.
        natural = self.parameters.size(name)
        off = [
            _largest(e) / size
            for x, e, there in zip(slopes, errors, self._observed(found), strict=True)
            if (size := max(_largest(x), _largest(there) / natural)) > 0.0
        ]
        return Row(dK, pose, squares, max(off, default=0.0))


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


def in_hertz(found: Modes, squares: Array) -> Array:
    """Changes (p, k) in Hz of those of omega^2; NaN where f is 0 or does not exist."""
    with np.errstate(divide="ignore", invalid="ignore"):
        f = found.frequencies
        return np.where(f > 0.0, squares / (8 * np.pi**2 * f), np.nan)


def change_of_squares(
    found: Modes, dK: Array, dM: Array | None = None, dC: Array | None = None
) -> Array:
    """d(omega^2) (k,) in 1/s^2 for changes of the matrices on all coordinates."""
    length, force = convert_length(Units(), found.elastic.units)
    right, left = found.basis @ found.spectrum.vectors, found.basis @ found.spectrum.left
    squares, units = found.spectrum.squares, length / force
    carried = None if dC is None or not len(dC) else _carried(found, right, left, squares)
    rates = np.empty(squares.size)
    for group in found.groups:
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


def _carried(found: Modes, right: Array, left: Array, squares: Array) -> tuple[Array, Array]:
    """What the constraints carry while each mode swings, to the right and to the left modes."""
    K, C = _stiffness_and_constraints(found.held if found.state is None else found.state)
    M = found.full_mass
    columns = found.posture.coordinate_lengths[:, None]
    C = ((np.zeros((0, len(K))) if C is None else C).T * columns).astype(float)
    mu_right, mu_left = (
        -np.linalg.lstsq(C, columns * (A @ x - M @ x * squares), rcond=numerics.RANK)[0]
        for A, x in ((K, right), (K.T, left))
    )
    return mu_right, mu_left
