r"""Response over frequency: receptance, mobility, accelerance at the body; transmissibility.

A wrench ``w exp(i omega t)`` on the body moves it by ``H(omega) w exp(i omega t)``,

    H = J (K - omega^2 M + i omega C)^-1 J^T

found from the full matrices at each frequency, or as a sum over modes, which is exact as well:
over the undamped modes where damping is proportional, else over the complex ones. At frequency zero
it is the compliance under the load. Motions without mass add their static part at every frequency.

A base that shakes by u (translation) is felt through the momentum A per rate:
``(K - omega^2 M + i omega C) x = omega^2 A^T u``, and the body moves by ``u + J x`` in the room.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from cartstiff import numerics
from cartstiff.arrays import checked_array, checked_unit, checked_vector, csv_text, fixed
from cartstiff.choices import RESPONSES
from cartstiff.errors import InputError, UndefinedError, UnknownNameError
from cartstiff.geometry import se3
from cartstiff.geometry.se3 import Array
from cartstiff.mechanisms.contract import Units, convert_length
from cartstiff.notes import Note
from cartstiff.vibration.damping import Damping, dampers, damping_matrix, state_space
from cartstiff.vibration.mode_set import Modes

Method = Literal["modes", "matrices"]


@dataclass(frozen=True, eq=False)
class FrequencyResponse:
    """A response over frequency.

    Attributes
    ----------
    kind : str
        "receptance", "mobility", "accelerance" or "transmissibility".
    frequencies : ndarray (N,)
        Hz.
    matrix : ndarray (N, 6, 6) or (N, 3, 3), complex
        Motion (angular, linear) of the point per (moment, force) at it, axes of M; of a
        transmissibility motion of the point per motion of the base, axes of F. NaN at a pole.
    units : Units
        Units of force and length; seconds and radians.
    damping : Damping
        What damped.
    notes : tuple of Note
        What was assumed.
    """

    kind: str
    frequencies: Array
    matrix: Array
    units: Units
    damping: Damping
    notes: tuple[Note, ...] = ()

    def along(self, direction: ArrayLike, of: ArrayLike | None = None) -> Array:
        """Motion (N,) along `of` per force (or motion of the base) along `direction`.

        Both (3,), in the axes of the matrix; `of` is `direction` by default.
        """
        u = checked_unit(direction)
        v = u if of is None else checked_unit(of)
        return np.asarray(np.einsum("i,nij,j->n", v, self.matrix[:, -3:, -3:], u))

    @property
    def unit(self) -> str:
        """Unit of translations per force."""
        per = {0: "", 1: "/s", 2: "/s^2"}
        if self.kind == "transmissibility":
            return "1"
        return f"{self.units.length}{per[RESPONSES[self.kind]]}/{self.units.force}"

    def as_csv(self, direction: ArrayLike | None = None) -> str:
        """Columns: frequency, then real and imaginary part along x, y, z or along a direction."""
        names, columns = ["frequency_Hz"], [self.frequencies]
        for name, values in self.curves(direction).items():
            names += [f"real_{name}", f"imaginary_{name}"]
            columns += [values.real, values.imag]
        return csv_text(np.stack(columns, axis=1), names)

    def curves(self, direction: ArrayLike | None = None) -> dict[str, Array]:
        """Named curves (N,): along x, y, z, or along a direction."""
        if direction is not None:
            return {"direction": self.along(direction)}
        return {name: self.along(e) for name, e in zip("xyz", np.eye(3), strict=True)}

    def as_dict(self, direction: ArrayLike | None = None) -> dict[str, Any]:
        """Plain data: frequencies and curves as [real, imaginary]."""
        return {
            "kind": self.kind,
            "unit": self.unit,
            "frequencies": self.frequencies.tolist(),
            "curves": {
                name: [[float(x.real), float(x.imag)] if np.isfinite(x) else None for x in values]
                for name, values in self.curves(direction).items()
            },
            "damping": {
                "ratios": np.asarray(self.damping.ratios, float).tolist(),
                "rayleigh": [self.damping.mass, self.damping.stiffness],
                "dampers": self.damping.dampers,
            },
            "notes": [note.as_dict() for note in self.notes],
        }


def frequency_response(
    modes: Modes,
    frequencies: ArrayLike,
    damping: Damping | float = 0.0,
    *,
    kind: Literal["receptance", "mobility", "accelerance"] = "receptance",
    at: ArrayLike = (0.0, 0.0, 0.0),
    method: Method = "modes",
) -> FrequencyResponse:
    """Motion of a point of the body per wrench at it, over frequency.

    Parameters
    ----------
    modes : Modes
        Modes under the load.
    frequencies : array_like (N,)
        Hz, not negative.
    damping : Damping or float
        What damps, or one ratio for all modes (beside the mechanism's dampers).
    kind : {"receptance", "mobility", "accelerance"}
        Displacement, velocity or acceleration per force.
    at : array_like (3,)
        The point, in M.
    method : {"modes", "matrices"}
        A sum over modes, or the full matrices at each frequency; they agree.

    Raises
    ------
    InputError, UnknownNameError
        For frequencies, a kind or a method that cannot be used.
    """
    if kind not in RESPONSES:
        raise UnknownNameError("kind of response", kind, RESPONSES)
    hertz, damping = _checked(frequencies, damping)
    point = checked_vector(at, 3, "point")
    J = se3.adjoint_of_inverse(se3.pose(translation=point)) @ modes.posture.motion.jacobian
    J = J @ modes.basis
    H = transfer(modes, hertz, damping, J, J.T, method)
    factor = (2j * np.pi * hertz) ** RESPONSES[kind]
    return FrequencyResponse(
        kind,
        hertz,
        fixed(H * factor[:, None, None]),
        modes.elastic.units,
        damping,
        _notes(modes, damping),
    )


def transmissibility(
    modes: Modes,
    frequencies: ArrayLike,
    damping: Damping | float = 0.0,
    *,
    at: ArrayLike = (0.0, 0.0, 0.0),
    method: Method = "modes",
) -> FrequencyResponse:
    """Motion of a point of the body in the room per motion of the base, axes of F.

    Parameters
    ----------
    modes, frequencies, damping, at, method
        As in `frequency_response`. The base moves as a whole, without turning.

    Raises
    ------
    UndefinedError
        If the mechanism's momentum is not known.
    """
    hertz, damping = _checked(frequencies, damping)
    point = checked_vector(at, 3, "point")
    momentum = modes._momentum
    if momentum is None:
        raise UndefinedError("the mechanism does not give its momentum", code="no-mass")
    length, force = convert_length(Units(), modes.elastic.units)
    A = momentum[0][3:] @ modes.basis * (force / length)
    J = se3.adjoint_of_inverse(se3.pose(translation=point)) @ modes.posture.motion.jacobian
    out = modes.posture.pose[:3, :3] @ J[3:] @ modes.basis
    moved = transfer(modes, hertz, damping, out, A.T, method)
    T = np.eye(3) + (2 * np.pi * hertz)[:, None, None] ** 2 * moved
    return FrequencyResponse(
        "transmissibility", hertz, fixed(T), modes.elastic.units, damping, _notes(modes, damping)
    )


def _checked(frequencies: ArrayLike, damping: Damping | float) -> tuple[Array, Damping]:
    hertz = checked_array(frequencies, ("n",), "frequencies")
    if (hertz < 0.0).any():
        raise InputError("frequencies cannot be used", expected="Hz from zero", got=hertz.min())
    return hertz, damping if isinstance(damping, Damping) else Damping(damping)


def _notes(modes: Modes, damping: Damping) -> tuple[Note, ...]:
    own, elastic = dampers(modes) if damping.dampers else None, modes.elastic
    if own is not None and elastic.damping is not None:
        names = elastic.spring_names
        acting = {n: float(c) for n, c in zip(names, elastic.damping, strict=False) if c > 0.0}
        words = "dampers of the mechanism's or the robot's file act beside the damping given: "
        shown = [f"{name} {value:.4g}" for name, value in list(acting.items())[:8]]
        return (Note("dampers-act", words + ", ".join(shown), acting),)
    if own is None and not damping.of_modes(modes).any():
        words = "nothing damps: the response is that of undamped motions, infinite at resonance"
        return (Note("undamped-response", words),)
    return ()


def transfer(
    modes: Modes,
    hertz: Array,
    damping: Damping,
    out: Array,
    into: Array,
    method: Method = "modes",
) -> Array:
    """``out (K - omega^2 M + i omega C)^-1 into`` (N, rows, columns) at N frequencies [Hz].

    Parameters
    ----------
    modes : Modes
        The modes.
    hertz : ndarray (N,)
        Frequencies.
    damping : Damping
        What damps.
    out, into : ndarray (rows, f), (f, columns)
        What is read of the motions of the basis, and how what acts goes into them.
    method : {"modes", "matrices"}
        As in `frequency_response`.
    """
    if method not in ("modes", "matrices"):
        raise UnknownNameError("method", method, ("modes", "matrices"))
    omega = 2 * np.pi * hertz
    own = dampers(modes) if damping.dampers else None
    shape = (hertz.size, out.shape[0], into.shape[1])
    with np.errstate(divide="ignore", invalid="ignore"):
        if method == "modes" and own is None and not modes.spectrum.is_complex:
            total = _by_real_modes(modes, omega, damping, out, into)
        elif method == "modes" and not (
            modes.spectrum.following.shape[1] or modes.spectrum.loose.shape[1]
        ):
            total = _by_complex_modes(modes, omega, damping, out, into)
        else:
            return _by_matrices(modes, omega, damping, out, into)
    total = total.reshape(shape)
    total[~np.isfinite(total).all(axis=(1, 2))] = np.nan
    return total


def _by_real_modes(modes: Modes, omega: Array, damping: Damping, out: Array, into: Array) -> Array:
    length, force = convert_length(Units(), modes.elastic.units)
    spectrum, ratios = modes.spectrum, damping.of_modes(modes)
    squares = modes.squares
    right, left = out @ spectrum.vectors, spectrum.left.T @ into
    # The modes have phi^T M phi = 1 in kg and the unit of length.
    residues = (right.T[:, :, None] * left[:, None, :]).reshape(squares.size, -1)
    own = np.sqrt(np.maximum(squares, 0.0))
    extra = damping.mass * (own == 0.0)  # Rayleigh's share of free motions
    rates = 2 * ratios * own + extra
    below = squares - omega[:, None] ** 2 + 1j * omega[:, None] * rates
    total = (1.0 / below) @ (residues * (length / force))
    if spectrum.following.shape[1]:
        static = (out @ spectrum.quick @ into).reshape(1, -1)
        total = total + static / (1 + 1j * omega * damping.stiffness)[:, None]
    return np.asarray(total)


def _by_complex_modes(
    modes: Modes, omega: Array, damping: Damping, out: Array, into: Array
) -> Array:
    values, X, Y = state_space(modes, damping_matrix(modes, damping))
    right, left = out @ X, Y @ into
    residues = (right.T[:, :, None] * left[:, None, :]).reshape(values.size, -1)
    return np.asarray((1.0 / (1j * omega[:, None] - values)) @ residues)


def _by_matrices(modes: Modes, omega: Array, damping: Damping, out: Array, into: Array) -> Array:
    length, force = convert_length(Units(), modes.elastic.units)
    M, C = modes.mass * (force / length), damping_matrix(modes, damping)
    w = omega[:, None, None]
    dynamic = modes.stiffness - w**2 * M + 1j * w * C
    # Angles and lengths alike: the sizes of the motions.
    size = np.sqrt(np.maximum(np.abs(np.diag(modes.stiffness)), numerics.TINY))
    total = np.full((omega.size, out.shape[0], into.shape[1]), np.nan, complex)
    for i, D in enumerate(dynamic / np.outer(size, size)):
        try:
            total[i] = (out / size) @ np.linalg.solve(D, into / size[:, None])
        except np.linalg.LinAlgError:  # exactly at a pole
            continue
    total[~np.isfinite(total).all(axis=(1, 2))] = np.nan
    return total
