"""Response over frequency: receptance, mobility, accelerance at the body;
transmissibility.

A wrench ``w exp(i omega t)`` on the body moves it by ``H(omega) w exp(i omega t)``,

    H = J (K - omega^2 M + i omega C)^-1 J^T

a sum over the undamped modes where damping is proportional, else found from the full
matrices at each frequency. At frequency zero it is the compliance under the load. Motions
without mass add their static part at every frequency.

A base that moves by u (translation) excites the mechanism through the momentum A per
rate: ``(K - omega^2 M + i omega C) x = omega^2 A^T u``, and the body moves by ``u + J x``
in the room.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from cartstiff.answer.vibration.modes import Modes
from cartstiff.core import numerics
from cartstiff.core.arrays import (
    Array,
    Result,
    checked_array,
    checked_number,
    checked_unit,
    checked_vector,
    csv_text,
    plain_dict,
    real_array,
)
from cartstiff.core.choices import RESPONSES
from cartstiff.core.errors import InputError, UndefinedError, UnknownNameError
from cartstiff.core.figures import new_figure
from cartstiff.core.geometry import se3
from cartstiff.core.mechanisms.elastic import ElasticMechanism
from cartstiff.core.notes import Note
from cartstiff.core.results import LabelledResult
from cartstiff.core.units import Units


@dataclass(frozen=True)
class Damping:
    """Modal damping, Rayleigh damping, and the use of the mechanism's dampers.

    Attributes
    ----------
    ratios : float or sequence of float, shape (k,)
        Damping ratios, shares of critical damping: one for all modes, or one for each.
    mass, stiffness : float
        Rayleigh's alpha [1/s] and beta [s].
    dampers : bool
        Whether the mechanism's own dampers (``damping`` of springs and legs) act.

    Raises
    ------
    InputError
        For negative numbers.
    """

    ratios: float | Sequence[float] = 0.0
    mass: float = 0.0
    stiffness: float = 0.0
    dampers: bool = True

    def __post_init__(self) -> None:
        for name in ("mass", "stiffness"):
            value = checked_number(getattr(self, name), f"Rayleigh damping by {name}")
            if value < 0.0:
                raise InputError(
                    f"Rayleigh damping by {name} cannot be used",
                    expected="a number from zero",
                    got=value,
                )
        ratios = real_array(self.ratios, "damping ratios")
        if ratios.ndim > 1 or not np.isfinite(ratios).all() or (ratios < 0.0).any():
            raise InputError(
                "damping ratios cannot be used",
                expected="numbers from zero",
                got=ratios.tolist(),
            )

    def acts_on(self, elastic: ElasticMechanism) -> bool:
        """Whether anything damps the motions of a mechanism."""
        own = self.dampers and elastic.damping is not None
        return own or bool(np.any(self.ratios)) or self.mass > 0.0 or self.stiffness > 0.0

    def of_modes(self, modes: Modes) -> Array:
        """Return the ratio (k,) of each mode from `ratios` and Rayleigh damping,
        without dampers.

        Raises
        ------
        InputError
            If the number of ratios is neither one nor that of the modes.
        """
        count = modes.squares.size
        ratios = real_array(self.ratios, "damping ratios")
        if ratios.ndim and ratios.size not in (1, count):
            raise InputError(
                "wrong count of damping ratios",
                expected=f"1 or {count}, one a mode",
                got=ratios.size,
            )
        omega = np.sqrt(np.maximum(modes.squares.real, 0.0))
        with numerics.silent():
            more = np.where(
                omega > 0.0, 0.5 * (self.mass / omega + self.stiffness * omega), 0.0
            )
        return np.broadcast_to(ratios, (count,)) + more


def dampers(modes: Modes) -> Array | None:
    """The matrix (f, f) of the mechanism's dampers in the basis; None without dampers."""
    elastic, posture = modes.elastic, modes.posture
    if elastic.damping is None:
        return None
    if elastic.springs is None:
        return None
    rows = elastic.springs.rows(posture)
    full = (rows.T * elastic.damping) @ rows
    return np.asarray(modes.basis.T @ full @ modes.basis)


def damping_matrix(modes: Modes, damping: Damping) -> Array:
    """C (f, f) on the basis, in units of force, length and seconds."""
    kilogram = modes.elastic.units.kilogram
    M = modes.mass * kilogram
    C = damping.mass * M + damping.stiffness * modes.stiffness
    own = dampers(modes) if damping.dampers else None
    if own is not None:
        C = C + own
    only = Damping(damping.ratios).of_modes(modes)
    if only.any():
        omega = np.sqrt(np.maximum(modes.squares.real, 0.0))
        carried = M @ modes.spectrum.vectors.real
        left = M.T @ modes.spectrum.left.real
        C = C + (carried * (2 * only * omega / kilogram)) @ left.T
    return np.asarray(C)


def poles(modes: Modes, damping: Damping) -> tuple[Array, Array]:
    """Damped frequencies [Hz] and ratios of the modes, by increasing size of the pole.

    Raises
    ------
    UndefinedError
        If a motion has no mass: its damped motion is of another order.
    """
    spectrum, f = modes.spectrum, len(modes.mass)
    if spectrum.vectors.shape[1] != f:
        raise UndefinedError(
            "a motion without mass is damped in another order", code="massless-motion"
        )
    T = spectrum.vectors.real if not spectrum.is_complex else np.eye(f)
    inverse = np.linalg.inv(T.T @ modes.mass @ T * modes.elastic.units.kilogram)
    K, C = (
        inverse @ T.T @ A @ T for A in (modes.stiffness, damping_matrix(modes, damping))
    )
    # Time in units in which stiffness and inertia are of the same size.
    scale = float(np.sqrt(numerics.largest(K))) or 1.0
    A = np.block([[np.zeros((f, f)), np.eye(f)], [-K / scale**2, -C / scale]])
    values = np.linalg.eigvals(A) * scale
    upper = values[values.imag > 0.0]
    upper = upper[np.argsort(np.abs(upper))]
    return upper.imag / (2 * np.pi), -upper.real / np.abs(upper)


@dataclass(frozen=True, eq=False, repr=False)
class FrequencyResponse(Result, LabelledResult):
    """A response over frequency.

    Attributes
    ----------
    kind : str
        "receptance", "mobility", "accelerance" or "transmissibility".
    frequencies : ndarray (N,)
        Hz.
    matrix : ndarray (N, 6, 6) or (N, 3, 3), complex
        Motion (angular, linear) of the point per (moment, force) at it, axes of M; of a
        transmissibility motion of the point per motion of the base, axes of F. NaN at a
        pole.
    units : Units
        Units of force and length; seconds and radians.
    damping : Damping
        Damping of the response.
    notes : tuple of Note
        Notes on the damping.
    """

    kind: str
    frequencies: Array
    matrix: Array
    units: Units
    damping: Damping
    notes: tuple[Note, ...] = ()

    def along(self, direction: ArrayLike, of: ArrayLike | None = None) -> Array:
        """The motion (N,) along `of` per force (or motion of the base) along `direction`.

        Both (3,), in the axes of the matrix; `of` is `direction` by default.

        Raises
        ------
        InputError
            For a direction that is zero.
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

    def to_csv(self, direction: ArrayLike | None = None) -> str:
        """Columns: frequency, then real and imaginary part along x, y,
        z or along a direction.
        """
        names, columns = ["frequency [Hz]"], [self.frequencies]
        for name, values in self.curves(direction).items():
            names += [f"real_{name} [{self.unit}]", f"imaginary_{name} [{self.unit}]"]
            columns += [values.real, values.imag]
        return csv_text(np.stack(columns, axis=1), names)

    def curves(self, direction: ArrayLike | None = None) -> dict[str, Array]:
        """Named curves (N,), in the unit of the matrix: along x, y, z, or along a
        direction (3,).
        """
        if direction is not None:
            return {"direction": self.along(direction)}
        return {name: self.along(e) for name, e in zip("xyz", np.eye(3), strict=True)}

    def to_dict(self, direction: ArrayLike | None = None) -> dict[str, Any]:
        """Plain data: frequencies and curves as [real, imaginary]."""
        data = {
            "kind": self.kind,
            "unit": self.unit,
            "frequencies": self.frequencies,
            "curves": self.curves(direction),
            "damping": {
                "ratios": np.asarray(self.damping.ratios, float),
                "rayleigh": [self.damping.mass, self.damping.stiffness],
                "dampers": self.damping.dampers,
            },
            "notes": self.notes,
        }
        return plain_dict(data)

    def plot(
        self,
        direction: ArrayLike | None = None,
        modes: Modes | None = None,
        ax: Any = None,
    ) -> Any:
        """Draw a Bode diagram: size and phase of each curve,
        with thin lines at the modes.

        Parameters
        ----------
        direction : array_like (3,), optional
            Direction of a single curve; default x, y and z.
        modes : Modes, optional
            Modes whose frequencies are marked.
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
        figure = new_figure(7.0, 5.0, ax=ax)
        size, phase = figure.subplots(2, 1, sharex=True, height_ratios=[2, 1])
        # Size and phase of each curve; no size has no logarithm.
        for name, values in self.curves(direction).items():
            shown = np.where(np.abs(values) > 0.0, np.abs(values), np.nan)
            if np.isfinite(shown).any():
                size.semilogy(self.frequencies, shown, label=name)
                phase.plot(self.frequencies, np.degrees(np.angle(values)))
        # Natural frequencies as thin lines behind the curves.
        for f in [] if modes is None else modes.frequencies:
            if self.frequencies[0] <= f <= self.frequencies[-1]:
                for axis in (size, phase):
                    axis.axvline(f, color="0.8", linewidth=0.8, zorder=0)
        # A narrow range needs numbers between the powers of ten.
        if self.frequencies[0] > 0.0:
            size.set_xscale("log")
            phase.xaxis.set_major_formatter("{x:g}")
            phase.xaxis.set_minor_formatter(
                "{x:g}" if _is_narrow(self.frequencies) else ""
            )
        size.yaxis.set_major_formatter("{x:.0e}")
        size.set(ylabel=f"{self.kind} [{self.unit}]")
        phase.set(
            xlabel="frequency [Hz]",
            ylabel="phase [deg]",
            ylim=(-190, 190),
            yticks=[-180, -90, 0, 90, 180],
        )
        if size.get_legend_handles_labels()[0]:
            size.legend()
        return figure


def frequency_response(
    modes: Modes,
    frequencies: ArrayLike,
    damping: Damping | float = 0.0,
    *,
    kind: Literal["receptance", "mobility", "accelerance"] = "receptance",
    at: ArrayLike = (0.0, 0.0, 0.0),
) -> FrequencyResponse:
    """Motion of a point of the body per wrench at it, over frequency.

    Parameters
    ----------
    modes : Modes
        Modes under the load.
    frequencies : array_like (N,)
        Hz, not negative.
    damping : Damping or float
        Damping, or one ratio for all modes (besides the mechanism's dampers).
    kind : {"receptance", "mobility", "accelerance"}
        Displacement, velocity or acceleration per force.
    at : array_like (3,)
        Point of the body, in M; default its origin.

    Raises
    ------
    InputError, UnknownNameError
        For frequencies or a kind that cannot be used.
    """
    if kind not in RESPONSES:
        raise UnknownNameError("kind of response", kind, RESPONSES)
    hertz, damping = _checked(frequencies, damping)
    J = motion_at(modes, checked_vector(at, 3, "point"))
    H = transfer(modes, hertz, damping, J, J.T)
    factor = (2j * np.pi * hertz) ** RESPONSES[kind]
    return FrequencyResponse(
        kind,
        hertz,
        H * factor[:, None, None],
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
) -> FrequencyResponse:
    """Motion of a point of the body in the room per motion of the base, axes of F.

    Parameters
    ----------
    modes, frequencies, damping, at
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
    A = momentum[0] @ modes.basis * modes.elastic.units.kilogram
    out = modes.posture.pose[:3, :3] @ motion_at(modes, point)[3:]
    moved = transfer(modes, hertz, damping, out, A.T)
    T = np.eye(3) + (2 * np.pi * hertz)[:, None, None] ** 2 * moved
    return FrequencyResponse(
        "transmissibility", hertz, T, modes.elastic.units, damping, _notes(modes, damping)
    )


def motion_at(modes: Modes, point: ArrayLike) -> Array:
    """Return the twist (6, f) at a point (3,) of the body, axes of M,
    per motion of the basis.
    """
    J = (
        se3.adjoint_of_inverse(se3.pose(translation=point))
        @ modes.posture.motion.jacobian
    )
    return np.asarray(J @ modes.basis)


def _checked(frequencies: ArrayLike, damping: Damping | float) -> tuple[Array, Damping]:
    hertz = checked_array(frequencies, ("n",), "frequencies")
    if (hertz < 0.0).any():
        raise InputError(
            "frequencies cannot be used", expected="Hz from zero", got=hertz.min()
        )
    return hertz, damping if isinstance(damping, Damping) else Damping(damping)


def _notes(modes: Modes, damping: Damping) -> tuple[Note, ...]:
    own, elastic = dampers(modes) if damping.dampers else None, modes.elastic
    if own is not None and elastic.damping is not None:
        names = elastic.spring_names
        acting = {
            n: float(c) for n, c in zip(names, elastic.damping, strict=False) if c > 0.0
        }
        words = (
            "dampers of the mechanism's or the robot's file act beside the damping "
            "given: "
        )
        shown = [f"{name} {value:.4g}" for name, value in list(acting.items())[:8]]
        return (Note("dampers-act", words + ", ".join(shown), acting),)
    if own is None and not damping.of_modes(modes).any():
        words = (
            "nothing damps: the response is that of undamped motions, infinite at "
            "resonance"
        )
        return (Note("undamped-response", words),)
    return ()


def transfer(
    modes: Modes, hertz: Array, damping: Damping, out: Array, into: Array
) -> Array:
    """``out (K - omega^2 M + i omega C)^-1 into`` (N, rows, columns) at N
    frequencies [Hz].

    Parameters
    ----------
    modes : Modes
        The modes.
    hertz : ndarray (N,)
        Frequencies.
    damping : Damping
        Damping.
    out, into : ndarray (rows, f), (f, columns)
        Output per motion of the basis, and generalised forces of the basis per input.
    """
    omega = 2 * np.pi * hertz
    own = dampers(modes) if damping.dampers else None
    by_modes = own is None and not modes.spectrum.is_complex
    with numerics.silent():
        total = (_by_modes if by_modes else _by_matrices)(
            modes, omega, damping, out, into
        )
    total = total.reshape(hertz.size, out.shape[0], into.shape[1])
    total[~np.isfinite(total).all(axis=(1, 2))] = np.nan
    return total


def _by_modes(
    modes: Modes, omega: Array, damping: Damping, out: Array, into: Array
) -> Array:
    spectrum, ratios = modes.spectrum, damping.of_modes(modes)
    squares = modes.squares
    right, left = out @ spectrum.vectors, spectrum.left.T @ into
    # The modes have phi^T M phi = 1 in kg and the unit of length.
    residues = (right.T[:, :, None] * left[:, None, :]).reshape(squares.size, -1)
    own = np.sqrt(np.maximum(squares, 0.0))
    extra = damping.mass * (own == 0.0)  # Rayleigh's share of free motions
    rates = 2 * ratios * own + extra
    below = squares - omega[:, None] ** 2 + 1j * omega[:, None] * rates
    total = (1.0 / below) @ (residues / modes.elastic.units.kilogram)
    if spectrum.following.shape[1]:
        static = (out @ spectrum.quick @ into).reshape(1, -1)
        total = total + static / (1 + 1j * omega * damping.stiffness)[:, None]
    return np.asarray(total)


def _by_matrices(
    modes: Modes, omega: Array, damping: Damping, out: Array, into: Array
) -> Array:
    M, C = modes.mass * modes.elastic.units.kilogram, damping_matrix(modes, damping)
    w = omega[:, None, None]
    # Scaled by the stiffness of each motion, so that angles and lengths are comparable.
    size = np.sqrt(np.maximum(np.abs(np.diag(modes.stiffness)), numerics.TINY))
    dynamic = (modes.stiffness - w**2 * M + 1j * w * C) / np.outer(size, size)
    poles = np.linalg.det(dynamic) == 0.0
    dynamic[poles] = np.nan
    return np.asarray((out / size) @ np.linalg.solve(dynamic, into / size[:, None]))


def _is_narrow(frequencies: np.ndarray) -> bool:
    """Whether a logarithmic axis would have only one or two labels."""
    return bool(frequencies[-1] < 10.0 * frequencies[0])
