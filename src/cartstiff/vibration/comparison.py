r"""Frequencies of simplified models: a 6x6 stiffness and a mass at the tip.

A common shortcut is ``J^-T K_q J^-1`` with the rigid body at the tip. For a mechanism with six free
motions the pair (K^X, Lambda), where ``Lambda = (J M^-1 J^T)^-1`` is the operational-space mass,
has the frequencies of (``J^T K^X J``, M): exact if K^X is the tangent under the load, else off by
the load's part. With only the rigid body at the tip all other masses are missing as well.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from cartstiff import numerics
from cartstiff.arrays import Array, Result
from cartstiff.errors import UnknownNameError
from cartstiff.figures import new_axes
from cartstiff.geometry import se3
from cartstiff.mechanisms.chain import Chain
from cartstiff.mechanisms.contract import Units
from cartstiff.mechanisms.platform import Platform
from cartstiff.results import LabelledResult
from cartstiff.vibration.modes import Modes

#: Models to compare: stiffness matrices, the tangent under the load, and the full problem.
COMPARED = ("A", "B", "K", "F", "load", "energy")


@dataclass(frozen=True, eq=False, repr=False)
class Shortcut(Result, LabelledResult):
    """Frequencies of a stiffness matrix at the tip.

    Attributes
    ----------
    name : str
        Name of the matrix; "energy" is the full problem.
    all_masses, body_alone : ndarray (6,) or None
        Hz, with the operational-space mass, and with only the rigid body at the tip; NaN for
        motions with negative or complex omega^2. None if the mass or the matrix does not exist.
    errors, body_errors : ndarray or None
        Relative errors against the nearest exact frequency (in order if there are six).
    missing : str or None
        Why there are no frequencies.
    """

    name: str
    all_masses: Array | None
    body_alone: Array | None
    errors: Array | None
    body_errors: Array | None
    missing: str | None = None

    def plot(self) -> Any:
        """Draw the frequencies with all masses and with those of the body alone.

        Returns
        -------
        matplotlib.figure.Figure

        Raises
        ------
        MissingDependencyError
            Without matplotlib.
        """
        figure, axes = new_axes()
        for label, hertz in (("all masses", self.all_masses), ("body alone", self.body_alone)):
            if hertz is not None:
                axes.plot(hertz, range(1, len(hertz) + 1), "o", label=label)
        axes.set(
            xlabel="natural frequency [Hz]", ylabel="mode", title=self.missing or f"K^{self.name}"
        )
        axes.invert_yaxis()
        axes.legend()
        return figure


def mass_at_tip(modes: Modes) -> Array | None:
    """Operational-space mass (6, 6) at M; None if M cannot move in every direction."""
    J, sizes = modes.posture.motion.jacobian @ modes.basis, np.diag(modes.mass)
    if not (sizes > 0.0).all():
        return None
    lengths = np.repeat([1.0, 1.0 / modes.posture.length], 3)[:, None]
    values = np.linalg.svd(lengths * J, compute_uv=False)
    inverse = numerics.invert(modes.mass)
    if J.shape[1] < 6 or not numerics.is_regular(values) or inverse is None:
        return None
    mobility = numerics.invert(J @ inverse.matrix @ J.T)
    return None if mobility is None else mobility.matrix


def _body(modes: Modes) -> Array | None:
    """Return the inertia (6, 6) of the rigid body that M is fixed to."""
    mechanism = modes.elastic.mechanism
    if isinstance(mechanism, Platform):
        return mechanism.body_inertia if mechanism.mass > 0.0 else None
    if not isinstance(mechanism, Chain) or mechanism.body.joint == 0:
        return None
    body = mechanism.tree.model.inertias[mechanism.body.joint]
    if not body.mass > 0.0:
        return None
    inertia = np.array(body.matrix())[se3.SWAP][:, se3.SWAP]
    to_joint = se3.adjoint(mechanism.body.T_j_f)
    return np.asarray(to_joint.T @ inertia @ to_joint)


def _frequencies(K: Array, mass: Array | None, units: Units) -> Array | None:
    """Return the frequencies (6,) in Hz, NaN where omega^2 is negative or complex."""
    if mass is None:
        return None
    inverse = numerics.invert(mass)
    if inverse is None:
        return None
    squares = np.linalg.eigvals(inverse.matrix @ K)
    real = np.abs(squares.imag) <= numerics.REPEATED_FREQUENCY * np.abs(squares)
    with np.errstate(invalid="ignore"):
        hertz = np.sqrt(squares.real / units.kilogram) / (2 * np.pi)
    return np.sort(np.where(real, hertz, np.nan))


def _errors(hertz: Array | None, true: Array) -> Array | None:
    if hertz is None:
        return None
    with np.errstate(invalid="ignore", divide="ignore"):
        if hertz.size == true.size:
            return hertz / np.sort(true) - 1.0
        away = np.abs(hertz[:, None] - true)
        away = np.where(np.isnan(away), np.inf, away)
        return hertz / true[np.argmin(away, axis=1)] - 1.0


def compare(modes: Modes, names: Sequence[str] = COMPARED) -> list[Shortcut]:
    """Compute the frequencies of 6x6 matrices at the tip, and their errors.

    Parameters
    ----------
    modes : Modes
        Modes of a held posture.
    names : sequence of str
        Names of `COMPARED`.

    Raises
    ------
    UnknownNameError
        For another name.
    """
    for name in names:
        if name not in COMPARED:
            raise UnknownNameError("comparison", name, COMPARED)
    true, result, units = modes.frequencies, modes.result, modes.elastic.units
    everything, body = mass_at_tip(modes), _body(modes)
    answers = []
    for name in names:
        if name == "energy":
            zero = np.zeros_like(true)
            answers.append(Shortcut(name, true, None, zero, None))
            continue
        K = None
        if result is not None:
            K = result.tangent if name == "load" else result.matrices[name]
        if K is None:
            why = "of an equilibrium only the energy" if result is None else f"no K^{name} here"
            answers.append(Shortcut(name, None, None, None, None, why))
            continue
        carried, alone = (_frequencies(K, m, units) for m in (everything, body))
        missing = None
        if carried is None:
            missing = "the masses as the tip feels them do not exist here"
        answers.append(
            Shortcut(name, carried, alone, _errors(carried, true), _errors(alone, true), missing)
        )
    return answers
