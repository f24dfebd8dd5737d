r"""Screws of a stiffness matrix: a line, a pitch and a stiffness instead of six mixed numbers.

An *eigenscrew* s is a twist answered by a wrench on the same screw, ``K s = lambda Delta s`` with
Delta = [[0, 1], [1, 0]] ([Ball]_'s principal screws of the potential; [PattersonLipkin]_). No
length scale enters, and a change of frame carries the lines and leaves pitches and eigenvalues.
Where eigenvalues are equal the screws are arbitrary within their eigenspace.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from cartstiff import numerics
from cartstiff.analysis.matrices import (
    Definiteness,
    as_symmetric,
    balancing_length,
    definiteness,
    scale_lengths,
)
from cartstiff.arrays import Result, checked_length, checked_vector
from cartstiff.geometry.se3 import Array

#: The matrix Delta that takes a twist (omega, v) to the wrench (v, omega) on the same screw.
SWAP_FORM: Final[Array] = np.kron(np.array([[0.0, 1.0], [1.0, 0.0]]), np.eye(3))
SWAP_FORM.flags.writeable = False

# A direction vector shorter than this, next to its length-scaled partner, is rounding: the pitch
# is then called infinite.
_INFINITE_PITCH = numerics.INFINITE_PITCH


@dataclass(frozen=True, eq=False)
class Screw(Result):
    """A line with a pitch.

    Attributes
    ----------
    direction : ndarray, shape (3,)
        Unit vector; its largest component is positive.
    point : ndarray, shape (3,)
        Foot of the perpendicular from the origin; NaN for infinite pitch.
    pitch : float
        Length per radian; infinite for a pure translation or a pure moment.
    """

    direction: Array
    point: Array
    pitch: float


def _screw(along: Array, moment: Array, length: float) -> Screw:
    size, lever = float(np.linalg.norm(along)), float(np.linalg.norm(moment))
    if size * length <= _INFINITE_PITCH * lever or size == 0.0:
        unit = moment / lever if lever > 0 else np.full(3, np.nan)
        point, pitch = np.full(3, np.nan), float("inf") if lever > 0 else float("nan")
    else:
        unit = along / size
        point, pitch = np.cross(along, moment) / size**2, float(along @ moment) / size**2
    if np.all(np.isfinite(unit)) and unit[np.argmax(np.abs(unit))] < 0:
        unit = -unit
    return Screw(unit, point, pitch)


def screw_of_twist(twist: ArrayLike, length: float = 1.0) -> Screw:
    """Screw of a twist (omega, v): axis along omega through ``omega x v / |omega|^2``.

    `length` is the size of the problem: omega counts as zero when ``|omega| length`` is rounding
    beside ``|v|``.
    """
    t = checked_vector(twist, 6, "twist")
    return _screw(t[:3], t[3:], checked_length(length))


def screw_of_wrench(wrench: ArrayLike, length: float = 1.0) -> Screw:
    """Screw of a wrench (moment, force): axis along the force through ``f x m / |f|^2``."""
    w = checked_vector(wrench, 6, "wrench")
    return _screw(w[3:], w[:3], checked_length(length))


@dataclass(frozen=True, eq=False)
class Eigenscrew(Result):
    """One solution of ``K s = lambda Delta s``.

    Attributes
    ----------
    screw : Screw
        Axis and pitch h, of the twist and of the wrench alike.
    eigenvalue : float
        lambda (force per angle): the force that answers a rotation by one radian.
    rotational_stiffness : float
        lambda h (moment per angle): the moment that answers it.
    translational_stiffness : float
        lambda / h (force per length): the force over the travel along the axis.
    twist : ndarray, shape (6,)
        With unit rotation, or unit translation for infinite pitch.
    """

    screw: Screw
    eigenvalue: float
    rotational_stiffness: float
    translational_stiffness: float
    twist: Array


@dataclass(frozen=True, eq=False)
class Eigenscrews:
    """All real eigenscrews of a stiffness.

    Attributes
    ----------
    screws : tuple of Eigenscrew
        By eigenvalue, smallest first. A positive definite K has three of positive and three of
        negative eigenvalue, each with the sign of its pitch, and the sum of eigenvalues is twice
        the trace of K_rt.
    complete : bool
        Whether there are six independent ones.
    complex_eigenvalues : tuple of complex
        Pairs that belong to no screw; only an indefinite K has them.
    definiteness : str
        Definiteness of K.
    """

    screws: tuple[Eigenscrew, ...]
    complete: bool
    complex_eigenvalues: tuple[complex, ...]
    definiteness: Definiteness


def eigenscrews(stiffness: ArrayLike) -> Eigenscrews:
    r"""Eigenscrews of a symmetric stiffness, [PattersonLipkin]_.

    For semidefinite K = L L^T the eigenvalues are those of the symmetric matrix ``L^T Delta L``,
    hence real; a singular K may have fewer than six screws, and its unloaded freedoms appear with
    eigenvalue zero. For an indefinite K complex pairs are reported, not forced to be real.

    Parameters
    ----------
    stiffness : array_like, shape (6, 6)
        Symmetric.
    """
    K = as_symmetric(stiffness)
    length = balancing_length(K)
    scaled = scale_lengths(K, length)
    values, vectors = np.linalg.eigh(scaled)
    signs = definiteness(values)
    sign = -1.0 if signs.startswith("negative") else 1.0
    others: tuple[complex, ...] = ()
    if signs == "indefinite":
        roots, solutions = np.linalg.eig(SWAP_FORM @ scaled)
        real = np.abs(roots.imag) <= numerics.CLOSE * np.abs(roots).max()
        mu, x = roots[real].real, solutions[:, real].real
        others = tuple(complex(r) * length for r in roots[~real])
    else:
        kept = np.abs(values) > numerics.ZERO * np.abs(values).max(initial=0.0)
        L = vectors[:, kept] * np.sqrt(np.abs(values[kept]))
        mu, y = np.linalg.eigh(L.T @ SWAP_FORM @ L)
        loaded = np.abs(mu) > numerics.ZERO * np.abs(mu).max(initial=0.0)
        x = np.hstack([SWAP_FORM @ L @ y[:, loaded], vectors[:, ~kept]])
        mu = np.concatenate([sign * mu[loaded], np.zeros(int(np.sum(~kept)))])
    screws = [_eigenscrew(m, column, length) for m, column in zip(mu, x.T, strict=True)]
    screws.sort(key=lambda e: e.eigenvalue)
    return Eigenscrews(tuple(screws), len(screws) == 6, others, signs)


def _eigenscrew(mu: float, x: Array, length: float) -> Eigenscrew:
    """Back to the user's units: twist = (x_rot / length, x_trans), lambda = length * mu."""
    twist = np.concatenate([x[:3] / length, x[3:]])
    screw = screw_of_twist(twist, length)
    value = float(mu) * length
    if np.isfinite(screw.pitch):
        twist = twist / (screw.direction @ twist[:3])
    else:
        twist = np.concatenate([np.zeros(3), screw.direction])
    rotational = translational = 0.0
    if value != 0.0:
        rotational = value * screw.pitch
        translational = value / screw.pitch if screw.pitch != 0.0 else float("inf")
    return Eigenscrew(screw, value, rotational, translational, twist)
