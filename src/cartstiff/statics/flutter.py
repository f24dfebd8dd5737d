r"""Small vibrations about an equilibrium whose loads have no potential, and where they grow.

A load that turns with the body makes the tangent K_t unsymmetric, and its definiteness then proves
nothing. With the masses' matrix M, both on the motions that the constraints leave, motions
``exp(i omega t) x`` obey

    K_t x = omega^2 M x

and the equilibrium is left by oscillations that grow (flutter) where a pair of omega^2 is complex,
or in one sense (divergence) where one is real and negative. Both depend on M, except where
det K_t < 0: the product of all omega^2 is det K_t / det M, so that one is negative whatever the
masses are. Otherwise, without a mass on every motion no statement is made. Damping is not modelled,
and may lower the load of flutter.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from cartstiff.geometry.se3 import Array
from cartstiff.mechanisms.contract import Units, convert_length
from cartstiff.notes import Note
from cartstiff.numerics import IDLE
from cartstiff.potentials.contract import Potential
from cartstiff.statics.balance import Balance
from cartstiff.statics.point import Point
from cartstiff.statics.small_motions import COMPLEX, kinetic_matrix, spectrum_of

#: Why there is no statement.
MASSLESS = Note(
    "masses-missing",
    "motions without mass or inertia are left: whether a load without a potential leads to flutter "
    "or divergence depends on them, and no statement is made (give every moving link both)",
)
#: What a statement rests on.
UNDAMPED = Note(
    "undamped",
    "flutter and divergence, under a load without a potential, are those of undamped vibrations "
    "with the masses given; damping may lower the load of flutter",
)


@dataclass(frozen=True, eq=False)
class Vibrations:
    """Small undamped vibrations about an equilibrium.

    Attributes
    ----------
    squares : ndarray (f,)
        omega^2 in rad^2/s^2 by increasing real part, complex in pairs where the motion flutters.
    mode : ndarray (n,)
        The motion that grows first, or the slowest, in natural units, of length 1; of a complex
        one the real part.
    growing : {"flutter", "divergence"} or None
        How the equilibrium is left; None where all omega^2 are real and positive.
    frequency : float or None
        In Hz, of the motion that flutters.
    """

    squares: Array
    mode: Array
    growing: Literal["flutter", "divergence"] | None
    frequency: float | None


def divergence(balance: Balance) -> Array | None:
    """The motion (n,), of length 1, by which a tangent of negative determinant is left; or None.

    No masses are needed: see the module. None as well where rounding decides the sign.
    """
    scaled = balance.scaled
    if not scaled.size or not np.linalg.slogdet(scaled)[0] < 0.0:
        return None
    if not np.linalg.svd(scaled, compute_uv=False)[-1] > max(IDLE, balance.unsure):
        return None
    values, vectors = np.linalg.eig(scaled)
    real = np.where(values.imag == 0.0, values.real, np.inf)
    mode = balance.motion(vectors[:, int(np.argmin(real))].real / np.sqrt(balance.hardness))
    return np.asarray(mode / np.linalg.norm(mode))


def vibrations(
    point: Point, balance: Balance, units: Units, terms: Iterable[Potential] = ()
) -> Vibrations | None:
    """Vibrations about an equilibrium; None where a motion that is left has no mass.

    `terms` is what acts besides the mechanism's own masses: payloads among it have a mass too.
    """
    mass = kinetic_matrix(point.posture, terms, units)
    if mass is None or balance.force.size == 0:
        return None
    columns = point.posture.coordinate_lengths
    mass = mass * columns[:, None] * columns
    if balance.free is not None:
        mass = balance.free.T @ mass @ balance.free
    spectrum = spectrum_of(balance.stiffness, mass, np.abs(balance.stiffness))
    if spectrum.following.shape[1] or spectrum.loose.shape[1]:
        return None
    squares, modes = spectrum.squares, spectrum.vectors
    growing: Literal["flutter", "divergence"] | None = None
    first, frequency = 0, None
    length, force = convert_length(Units(), units)  # energies F L over kg L^2
    if spectrum.is_complex:
        growing = "flutter"
        first = int(np.flatnonzero(np.abs(squares.imag) > COMPLEX * np.abs(squares))[0])
        frequency = float(np.sqrt(squares[first] * length / force).real / (2 * np.pi))
    elif squares[0] < -IDLE * float(np.abs(squares).max()):
        growing = "divergence"
    mode = balance.motion(modes[:, first].real)
    return Vibrations(squares * length / force, mode / np.linalg.norm(mode), growing, frequency)
