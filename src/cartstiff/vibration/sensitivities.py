r"""How stiffness, pose and frequencies depend on each parameter of a mechanism.

Parameters are those of `cartstiff.analysis.tolerances`: stiffnesses, masses, placements or points,
rest positions, and what the mechanism's file calls its parameters. A posture that is held keeps its
place and its load, and rest positions follow. A mechanism that came to rest by itself comes to rest
anew: the derivatives are total, with the motion of the rest in them.

Every derivative is taken of the mechanism itself, changed and analysed again
(`cartstiff.vibration.changes`). What is no more than rounding is told as 0. Frequencies do not come
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

from cartstiff.arrays import Array, Result
from cartstiff.errors import CartstiffError, InputError, UndefinedError, checked_kind, one_line
from cartstiff.mechanisms.elastic import ElasticMechanism
from cartstiff.statics.rest import Equilibrium
from cartstiff.stiffness.compute import PostureStiffness
from cartstiff.vibration.changes import MATRICES, Home, Row
from cartstiff.vibration.mode_set import Modes
from cartstiff.vibration.modes import modes


@dataclass(frozen=True, eq=False)
class Sensitivities(Result):
    """Derivatives by all parameters.

    Attributes
    ----------
    names : tuple of str
        As in `cartstiff.analysis.tolerances.UncertainParameters.nominal`.
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

    def row(self, name: str) -> Row | None:
        """All derivatives by a parameter; None of one that is not among them."""
        if name not in self.names:
            return None
        i = self.names.index(name)
        matrices = np.array([self.stiffness[letter][i] for letter in MATRICES])
        return Row(matrices, self.pose[i], self.squares[i], float(self.errors[i]))

    @property
    def relative(self) -> Array:
        """Change (p, k) in Hz for one per cent of each parameter; NaN of those that are zero."""
        return 0.01 * np.where(self.values, self.values, np.nan)[:, None] * self.frequencies

    def as_dict(self) -> dict[str, Any]:
        """Plain data: derivatives per unit of each parameter, and Hz for one per cent."""
        return {
            "left_out": self.left_out,
            "parameters": [
                {
                    "name": name,
                    "value": float(self.values[i]),
                    "error": float(self.errors[i]),
                    "stiffness": {letter: _matrix(dK[i]) for letter, dK in self.stiffness.items()},
                    "pose": _plain(self.pose[i]),
                    "frequencies": _plain(self.frequencies[i]),
                    "for_one_per_cent": _plain(self.relative[i]),
                }
                for i, name in enumerate(self.names)
            ],
        }


def _plain(values: Array) -> list[float | None]:
    return [float(x) if np.isfinite(x) else None for x in values]


def _matrix(values: Array) -> list[list[float]] | None:
    return values.tolist() if np.isfinite(values).all() else None


def sensitivities(
    subject: Modes | PostureStiffness | Equilibrium,
    *,
    geometry: bool = True,
    reread: Callable[[Mapping[str, float]], ElasticMechanism] | None = None,
    progress: Callable[[int, int], None] | None = None,
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
    progress : callable, optional
        Called with how many parameters are done, and of how many.

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
    modes = subject if isinstance(subject, Modes) else modes_of(subject)
    if modes is not None and modes.spectrum.is_complex:
        raise UndefinedError("modes that flutter have no sensitivities", code="flutter")
    home = Home(subject, reread)
    rows: dict[str, Row] = {}
    missing: list[str] = [] if (left_out := home.parameters.left_out) is None else [left_out]
    names = [
        name
        for name in home.parameters.nominal
        if geometry or name.partition(".")[0] in ("stiffness", "mass")
    ]
    for done, name in enumerate(names, 1):
        try:
            rows[name] = home.row(name, modes)
        except CartstiffError as error:
            missing.append(f"{name} is not varied: {one_line(str(error), 200)}")
        if progress is not None:
            progress(done, len(names))
    k = 0 if modes is None else modes.frequencies.size
    squares = np.array([r.squares for r in rows.values()]).reshape(len(rows), k)
    return Sensitivities(
        tuple(rows),
        np.array([home.parameters.nominal[name] for name in rows]),
        {
            letter: np.array([r.matrices[i] for r in rows.values()]).reshape(-1, 6, 6)
            for i, letter in enumerate(MATRICES)
        },
        np.array([r.pose for r in rows.values()]).reshape(-1, 6),
        squares,
        squares if modes is None else in_hertz(modes, squares),
        np.array([r.error for r in rows.values()]),
        tuple(home.parameters.is_angle(name) for name in rows),
        "; ".join(missing) or None,
    )


def modes_of(subject: PostureStiffness | Equilibrium) -> Modes | None:
    """Modes of a result; None where nothing that moves has a mass."""
    kinds, expected = (PostureStiffness, Equilibrium), "what analyse or equilibrium answers"
    checked_kind(subject, kinds, "posture", expected)
    try:
        return modes(subject)
    except UndefinedError:
        return None


def in_hertz(modes: Modes, squares: Array) -> Array:
    """Changes (p, k) in Hz of those of omega^2; NaN where f is 0 or does not exist."""
    with np.errstate(divide="ignore", invalid="ignore"):
        f = modes.frequencies
        return np.where(f > 0.0, squares / (8 * np.pi**2 * f), np.nan)
