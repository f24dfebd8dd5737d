r"""Damping of small motions: ratios per mode, Rayleigh's, dampers in the joints and legs.

    C = C_dampers + alpha M + beta K + sum_i 2 zeta_i omega_i (M phi_i)(M phi_i)^T

Ratios and Rayleigh's two numbers damp each mode by itself. Dampers couple them: their modes are
complex, with poles ``s`` and ``zeta = -Re s / |s|``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cartstiff.arrays import checked_number, real_array
from cartstiff.errors import InputError, UndefinedError
from cartstiff.geometry.se3 import Array
from cartstiff.mechanisms.contract import Units, convert_length
from cartstiff.mechanisms.elastic import ElasticMechanism
from cartstiff.mechanisms.platform import PlatformPosture
from cartstiff.potentials.springs import JointSprings
from cartstiff.vibration.mode_set import Modes


@dataclass(frozen=True)
class Damping:
    """What damps.

    Attributes
    ----------
    ratios : float or sequence of float
        Share of critical damping, of every mode or of each.
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
                "damping ratios cannot be used", expected="numbers from zero", got=ratios.tolist()
            )

    def acts_on(self, elastic: ElasticMechanism) -> bool:
        """Whether anything damps the motions of a mechanism."""
        own = self.dampers and elastic.damping is not None
        return own or bool(np.any(self.ratios)) or self.mass > 0.0 or self.stiffness > 0.0

    def of_modes(self, modes: Modes) -> Array:
        """Ratio (k,) of each mode by `ratios` and Rayleigh's numbers, without dampers.

        Raises
        ------
        InputError
            For as many ratios as there are no modes.
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
        with np.errstate(divide="ignore", invalid="ignore"):
            more = np.where(omega > 0.0, 0.5 * (self.mass / omega + self.stiffness * omega), 0.0)
        return np.broadcast_to(ratios, (count,)) + more


def dampers(modes: Modes) -> Array | None:
    """Dampers' matrix (f, f) on the basis of the modes; None without any."""
    elastic, posture = modes.elastic, modes.posture
    if elastic.damping is None:
        return None
    if isinstance(elastic.springs, JointSprings):
        full = np.diag(elastic.damping)
    elif isinstance(posture, PlatformPosture):
        lines = posture.lines.lines
        full = (lines.T * elastic.damping) @ lines
    else:
        return None
    return np.asarray(modes.basis.T @ full @ modes.basis)


def damping_matrix(modes: Modes, damping: Damping) -> Array:
    """C (f, f) on the basis, in units of force, length and seconds."""
    length, force = convert_length(Units(), modes.elastic.units)
    M = modes.mass * (force / length)
    C = damping.mass * M + damping.stiffness * modes.stiffness
    own = dampers(modes) if damping.dampers else None
    if own is not None:
        C = C + own
    only = Damping(damping.ratios).of_modes(modes)
    if only.any():
        omega = np.sqrt(np.maximum(modes.squares.real, 0.0))
        carried = M @ modes.spectrum.vectors.real
        left = M.T @ modes.spectrum.left.real
        C = C + (carried * (2 * only * omega * length / force)) @ left.T
    return np.asarray(C)


def state_space(modes: Modes, C: Array) -> tuple[Array, Array, Array]:
    """Poles (2 f,), right vectors of the motions (f, 2 f) and left ones of the forces (2 f, f).

    Raises
    ------
    UndefinedError
        Where a motion has no mass.
    """
    spectrum = modes.spectrum
    f = len(modes.mass)
    if spectrum.vectors.shape[1] != f:
        raise UndefinedError(
            "a motion without mass is damped in another order", code="massless-motion"
        )
    length, force = convert_length(Units(), modes.elastic.units)
    T = spectrum.vectors.real if not spectrum.is_complex else np.eye(f)
    M = T.T @ modes.mass @ T * (force / length)
    inverse = np.linalg.inv(M)
    K, D = inverse @ T.T @ modes.stiffness @ T, inverse @ T.T @ C @ T
    # Time in units in which stiffness and inertia are alike.
    scale = float(np.sqrt(np.abs(K).max(initial=0.0))) or 1.0
    A = np.block([[np.zeros((f, f)), np.eye(f)], [-K / scale**2, -D / scale]])
    values, X = np.linalg.eig(A)
    Y = np.linalg.inv(X)
    return values * scale, T @ X[:f], Y[:, f:] @ inverse @ T.T / scale


def poles(modes: Modes, damping: Damping) -> tuple[Array, Array]:
    """Damped frequencies [Hz] and ratios of the modes, by increasing size of the pole.

    Raises
    ------
    UndefinedError
        Where a motion has no mass: its damped motion is of another order.
    """
    values = state_space(modes, damping_matrix(modes, damping))[0]
    upper = values[values.imag > 0.0]
    upper = upper[np.argsort(np.abs(upper))]
    return upper.imag / (2 * np.pi), -upper.real / np.abs(upper)
