"""Screws of a stiffness matrix: a line, a pitch and a stiffness instead of six
mixed numbers.

An *eigenscrew* s is a twist answered by a wrench on the same screw, ``K s = lambda Delta
s`` with Delta = [[0, 1], [1, 0]] ([Ball]_'s principal screws of the potential;
[PattersonLipkin]_). No length scale enters, and a change of frame carries the lines and
leaves pitches and eigenvalues. Screws of equal eigenvalues are arbitrary within their
eigenspace.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from numpy.typing import ArrayLike

from cartstiff.answer.analysis.ellipsoids import stiffness_ellipsoid, upright
from cartstiff.answer.analysis.indices import spectrum
from cartstiff.answer.analysis.matrices import (
    ROTATION,
    TRANSLATION,
    Definiteness,
    balancing_length,
    lost_digits,
    symmetric_pair,
    with_angles_times,
)
from cartstiff.core import numerics
from cartstiff.core.arrays import Array, Result, checked_length, checked_vector
from cartstiff.core.errors import UndefinedError

#: The matrix Delta that takes a twist (omega, v) to the wrench (v, omega) on the same
#: screw.
SWAP_FORM: Final[Array] = np.kron(np.array([[0.0, 1.0], [1.0, 0.0]]), np.eye(3))
SWAP_FORM.flags.writeable = False


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
    size, lever = numerics.norm(along), numerics.norm(moment)
    if size * length <= numerics.INFINITE_PITCH * lever or size == 0.0:
        unit = moment / lever if lever > 0 else np.full(3, np.nan)
        point, pitch = np.full(3, np.nan), float("inf") if lever > 0 else float("nan")
    else:
        unit = along / size
        point, pitch = np.cross(along, moment) / size**2, float(along @ moment) / size**2
        if abs(pitch) * size <= numerics.ROUNDOFF * max(lever, size * length):
            pitch = 0.0
    return Screw(np.array(upright(unit.tolist())), point, pitch)


def screw_of_twist(twist: ArrayLike, length: float = 1.0) -> Screw:
    """Screw of a twist (omega, v): axis along omega through ``omega x v / |omega|^2``.

    `length` is the size of the problem: omega counts as zero when ``|omega| length`` is
    rounding beside ``|v|``, and the pitch when it is rounding beside either.
    """
    t = checked_vector(twist, 6, "twist")
    return _screw(t[:3], t[3:], checked_length(length))


def screw_of_wrench(wrench: ArrayLike, length: float = 1.0) -> Screw:
    """Screw of a wrench (moment, force): axis along the force through ``f x
    m / |f|^2``.
    """
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
        By eigenvalue, smallest first. A positive definite K has three of positive and
        three of negative eigenvalue, each with the sign of its pitch, and the sum of
        eigenvalues is twice the trace of K_rt.
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


def eigenscrews(stiffness: ArrayLike, compliance: ArrayLike | None = None) -> Eigenscrews:
    r"""Eigenscrews of a symmetric stiffness, [PattersonLipkin]_.

    For semidefinite K = L L^T the eigenvalues are those of the symmetric matrix ``L^T
    Delta L``, hence real; a singular K may have fewer than six screws, and its unloaded
    freedoms appear with eigenvalue zero. For an indefinite K complex pairs are reported,
    not forced to be real. With C = K^-1 the small eigenvalues come from there: ``C w = (1
    / lambda) Delta w`` for the wrench ``w = lambda Delta s``.

    Parameters
    ----------
    stiffness : array_like, shape (6, 6)
        Symmetric.
    compliance : array_like, shape (6, 6), optional
        Its inverse, if it is known better than by inversion.

    Raises
    ------
    UndefinedError
        Code ``"ill-conditioned"`` where neither stiffness nor compliance resolves an
        eigenvalue.
    """
    K, C = symmetric_pair(stiffness, compliance)
    length = balancing_length(K)
    values, vectors, signs = spectrum(K, length, C)
    sign = -1.0 if signs.startswith("negative") else 1.0
    others: tuple[complex, ...] = ()
    if signs == "indefinite":
        # Neither K nor -K has a root: the general problem, of which complex pairs are
        # kept aside.
        roots, solutions = _roots_of_indefinite(K, C, length)
        real = np.abs(roots.imag) <= numerics.NEGLIGIBLE_DIFFERENCE * np.abs(roots)
        mu, x = roots[real].real, solutions[:, real].real
        others = tuple(complex(r) * length for r in roots[~real])
    else:
        # K = L L^T, so that the problem becomes a symmetric one of the stiff directions
        # only.
        kept = values != 0.0
        sizes = np.sqrt(np.abs(values[kept]))
        L, back = vectors[:, kept] * sizes, vectors[:, kept] / sizes
        inverse = back.T @ SWAP_FORM @ back if kept.all() else None
        mu, y = numerics.eigenpairs(L.T @ SWAP_FORM @ L, inverse)
        if np.isnan(mu).any():
            raise lost_digits(mu, "the stiffness matrix")
        # Free motions have the eigenvalue zero and keep their own vectors.
        loaded = mu != 0.0
        x = SWAP_FORM @ L @ y if inverse is None else _solutions(L, back, mu, y)
        x = np.hstack([x[:, loaded], vectors[:, ~kept]])
        mu = np.concatenate([sign * mu[loaded], np.zeros(int(np.sum(~kept)))])
    screws = [_eigenscrew(m, column, length) for m, column in zip(mu, x.T, strict=True)]
    screws.sort(key=lambda e: e.eigenvalue)
    return Eigenscrews(tuple(screws), len(screws) == 6, others, signs)


def _solutions(L: Array, back: Array, mu: Array, y: Array) -> Array:
    """Twists (6, k) of eigenvectors y: ``Delta L y`` or ``mu L^-T y``,
    which cancels less.
    """
    ways, shares = [], []
    for factor, right in ((SWAP_FORM @ L, y), (back, y * mu)):
        x, size = factor @ right, np.abs(factor) @ np.abs(right)
        ways.append(x)
        shares.append(np.linalg.norm(x, axis=0) / np.linalg.norm(size, axis=0))
    return np.asarray(np.where(shares[0] >= shares[1], *ways))


def _roots_of_indefinite(K: Array, C: Array | None, length: float) -> tuple[Array, Array]:
    """Eigenvalues (6,) of ``Delta K`` with lengths scaled,
    and twists in columns (6, 6).
    """
    roots, solutions = np.linalg.eig(SWAP_FORM @ with_angles_times(K, 1.0 / length))
    if C is None:
        return roots, solutions
    inverses, others = np.linalg.eig(with_angles_times(C, length) @ SWAP_FORM)
    large, small = np.argsort(-np.abs(roots)), np.argsort(np.abs(inverses))
    taken, error = numerics.number_of_large(
        np.abs(roots[large]), 1.0 / np.abs(inverses[small])
    )
    if error > numerics.LOST_ERROR:
        raise lost_digits(np.full(6, np.nan), "the stiffness matrix")
    large, small = large[:taken], small[taken:]
    return (
        np.concatenate([roots[large], 1.0 / inverses[small]]),
        np.concatenate([solutions[:, large], others[:, small]], axis=1),
    )


def _eigenscrew(mu: float, x: Array, length: float) -> Eigenscrew:
    """Back to the user's units: twist = (x_rot / length, x_trans),
    lambda = length * mu.
    """
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


@dataclass(frozen=True, eq=False)
class CompliantAxis(Result):
    """A wrench-compliant or twist-compliant axis.

    Attributes
    ----------
    kind : {"wrench", "twist"}
        Which of the two.
    stiffness : float
        Force per translation along the axis (held rotations), or moment per rotation
        about it (free translations).
    screw : Screw
        Screw of the wrench that answers a unit translation, or of the twist that a moment
        causes.
    components : ndarray, shape (6,)
        That wrench per unit of force, or that twist per unit of rotation.
    """

    kind: Literal["wrench", "twist"]
    stiffness: float
    screw: Screw
    components: Array


def coupling_matrix(stiffness: Array | None, compliance: Array | None) -> Array | None:
    r"""``G = K_rt K_tt^-1 = -C_rr^-1 C_rt`` (3, 3), by the block that is better
    conditioned.

    A body that translates by v is answered by a force f and the moment ``G f``; a moment
    that turns it by w moves it by ``-G^T w``. None where neither K_tt nor C_rr has an
    inverse.

    Parameters
    ----------
    stiffness, compliance : ndarray, shape (6, 6), or None
        Symmetric, each the other's inverse; one of them is enough.

    Raises
    ------
    UndefinedError
        Code ``"ill-conditioned"`` where rounding leaves fewer than four digits.
    """
    found: list[tuple[float, Array]] = []
    for matrix, own, other in (
        (stiffness, TRANSLATION, ROTATION),
        (compliance, ROTATION, TRANSLATION),
    ):
        inverse = None if matrix is None else numerics.invert(matrix[own, own])
        if matrix is not None and inverse is not None:
            product = matrix[other, own] @ inverse.matrix
            found.append((inverse.error, product if own is TRANSLATION else -product.T))
    if not found:
        return None
    error, G = min(found, key=lambda each: each[0])
    if error > numerics.LOST_ERROR:
        raise UndefinedError(
            "how turning and moving are coupled is lost in the rounding of the stiffest "
            "directions",
            code="ill-conditioned",
            values={"relative_error": error},
        )
    return G


def wrench_compliant_axes(
    stiffness: ArrayLike, compliance: ArrayLike | None = None
) -> tuple[CompliantAxis, ...]:
    r"""Three wrenches that answer pure translations by a parallel force,
    [PattersonLipkin]_.

    ``K_tt e = k e`` and w = (K_rt e / k, e). Where k is zero no force answers: the axis
    has stiffness zero and, unless a moment answers, neither point nor pitch (NaN). The
    compliance, the inverse if it is known, resolves values that the stiffness does not.

    Raises
    ------
    UndefinedError
        Code ``"ill-conditioned"`` where neither resolves a stiffness or an axis.
    """
    K, C = symmetric_pair(stiffness, compliance)
    length = balancing_length(K)
    shape = stiffness_ellipsoid(K, "translation", "held", None, C)
    G = coupling_matrix(K, C)
    result = []
    for k, e in zip(shape.eigenvalues.tolist(), shape.axes.T, strict=True):
        e = np.array(upright(e.tolist()))
        w = np.concatenate([np.full(3, np.nan), e])
        screw = Screw(e, np.full(3, np.nan), float("nan"))
        if k != 0.0:
            w[:3] = K[ROTATION, TRANSLATION] @ e / k if G is None else G @ e
            screw = screw_of_wrench(w, length)
        result.append(CompliantAxis("wrench", k, screw, w))
    return tuple(result)


def twist_compliant_axes(
    stiffness: ArrayLike, compliance: ArrayLike | None = None
) -> tuple[CompliantAxis, ...]:
    r"""Three twists with a rotation parallel to the pure moment that causes them.

    ``S g = k g`` with S = K_rr - K_rt K_tt^-1 K_tr, and t = (g, -K_tt^-1 K_tr g), the
    twist that needs no force [PattersonLipkin]_. With the compliance C: ``C_rr g = g /
    k``, ``t = k C (g, 0)``.

    Raises
    ------
    UndefinedError
        Code ``"singular"`` where K_tt is singular: the translation is then not
        determined; code ``"ill-conditioned"`` where neither stiffness nor compliance
        resolves a value or an axis.
    """
    K, C = symmetric_pair(stiffness, compliance)
    G = coupling_matrix(K, C)
    if G is None:
        raise UndefinedError(
            "twist-compliant axes do not exist: the translational stiffness is singular",
            code="singular",
            values={
                "principal_values": np.linalg.eigvalsh(
                    K[TRANSLATION, TRANSLATION]
                ).tolist()
            },
        )
    length = balancing_length(K)
    shape = stiffness_ellipsoid(K, "rotation", "free", None, C)
    result = []
    for k, g in zip(shape.eigenvalues.tolist(), shape.axes.T, strict=True):
        g = np.array(upright(g.tolist()))
        t = np.concatenate([g, -G.T @ g])
        result.append(CompliantAxis("twist", k, screw_of_twist(t, length), t))
    return tuple(result)
