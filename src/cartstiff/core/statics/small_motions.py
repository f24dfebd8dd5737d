r"""Small undamped vibrations: ``K x = omega^2 M x`` on the motions that
constraints leave.

M is singular where a motion moves no mass. These motions are the ones with mu = 0 of

    M x = mu P x,    omega^2 = 1 / mu where P = K,

P a positive definite metric of stiffness: K itself, with the sizes of its eigenvalues
where a motion is unstable or free. So a small inertia is measured by stiffness, and never
divided by the root of a diagonal entry of M, which may be rounding. Motions without mass
but with stiffness follow the others at once: with Z a basis of them, ``x + Z z``, ``Z^T K
(x + Z z) = 0`` (static condensation). One without stiffness either has no equation of
motion: it is named and left out.

A load that turns with the body makes the tangent K unsymmetric, and its definiteness then
proves nothing. The equilibrium is left by oscillations that grow (flutter) where a pair
of omega^2 is complex, or in one sense (divergence) where one is real and negative. Both
depend on M, except where det K < 0: the product of all omega^2 is det K / det M, so that
one is negative with any masses. Where K = S + A has a symmetric part S with an eigenvalue
-l < 0, the equilibrium is left for all M whose eigenvalues differ by less than the factor
l / |A|_F: if all omega^2 were real and not negative, the Schur form of ``M^-1/2 K
M^-1/2`` would have N above its diagonal, and

    l / max M <= |N + N^T|_F / 2 = |N - N^T|_F / 2 <= |A|_F / min M

For any M it is left if S has no eigenvalue >= 0, as the sum of all omega^2 is tr(M^-1 S),
and if A = 0. Otherwise, without a mass on every motion no statement is made. Damping is
not modelled, and may lower the load of flutter.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from cartstiff.core import numerics
from cartstiff.core.arrays import Array
from cartstiff.core.mechanisms.contract import MechanismPosture
from cartstiff.core.notes import Note
from cartstiff.core.numerics import FREE_MOTION_STIFFNESS
from cartstiff.core.potentials.contract import Potential
from cartstiff.core.statics.problem import Balance, Point
from cartstiff.core.units import Units, convert_length

#: Reason for no statement.
MASSLESS = Note(
    "masses-missing",
    "motions without mass or inertia are left: whether a load without a potential leads "
    "to flutter or divergence depends on them, and no statement is made (give every "
    "moving link both)",
)
#: Assumptions of a statement.
UNDAMPED = Note(
    "undamped",
    "flutter and divergence, under a load without a potential, are those of undamped "
    "vibrations with the masses given; damping may lower the load of flutter",
)


@dataclass(frozen=True, eq=False)
class Vibrations:
    """Small undamped vibrations about an equilibrium.

    Attributes
    ----------
    squares : ndarray (f,)
        omega^2 in rad^2/s^2 by increasing real part, complex in pairs where the motion
        flutters.
    mode : ndarray (n,)
        The motion that grows first, or the slowest, in natural units, of length 1; the
        real part of a complex one.
    growing : {"flutter", "divergence"} or None
        How the equilibrium is left; None if all omega^2 are real and positive.
    frequency : float or None
        In Hz, of the motion that flutters.
    """

    squares: Array
    mode: Array
    growing: Literal["flutter", "divergence"] | None
    frequency: float | None


def divergence(balance: Balance) -> Array | None:
    """The motion (n,), of length 1, along which an equilibrium with det K < 0 is left;
    or None.

    No masses are needed: see the module. None as well if rounding decides the sign.
    """
    scaled = balance.scaled
    if not scaled.size or not np.linalg.slogdet(scaled)[0] < 0.0:
        return None
    zero = max(FREE_MOTION_STIFFNESS, balance.undecided)
    if not np.linalg.svd(scaled, compute_uv=False)[-1] > zero:
        return None
    values, vectors = np.linalg.eig(scaled)
    real = np.where(values.imag == 0.0, values.real, np.inf)
    mode = balance.motion(
        vectors[:, int(np.argmin(real))].real / np.sqrt(balance.stiffness_scale)
    )
    return np.asarray(mode / np.linalg.norm(mode))


def unstable_up_to(balance: Balance) -> float:
    """Ratio of the motions' inertias, in natural units, up to which an equilibrium
    is unstable.

    Infinite if it is unstable with any masses, 0 if no statement is made; see the module.
    """
    zero = max(FREE_MOTION_STIFFNESS, balance.undecided)
    values = balance.modes[0]
    if not values.size or values[0] >= -zero:
        return 0.0
    if values[-1] < -zero:
        return np.inf
    K = balance.stiffness
    if balance.free is not None:  # on axes at right angles, of length 1
        back = np.linalg.inv(np.linalg.qr(balance.free, mode="r"))
        K = back.T @ K @ back
    least = float(np.linalg.eigvalsh(0.5 * (K + K.T))[0])
    skew = 0.5 * numerics.norm(K - K.T)
    return max(-least, 0.0) / skew if skew > 0.0 else np.inf


def is_unstable(balance: Balance, vibration: Vibrations | None) -> bool:
    """Whether an equilibrium under loads without a potential is unstable.

    By its vibrations; without a mass on every motion by the tangent alone.
    """
    if vibration is not None and vibration.growing is not None:
        return True
    if divergence(balance) is not None:
        return True
    return vibration is None and unstable_up_to(balance) >= numerics.LARGEST_INERTIA_RATIO


def vibrations(
    point: Point, balance: Balance, units: Units, terms: Iterable[Potential] = ()
) -> Vibrations | None:
    """Vibrations about an equilibrium; None if a remaining motion has no mass.

    `terms` are all potentials: payloads among them have a mass.
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
        first = int(np.flatnonzero(_are_complex(squares))[0])
        frequency = float(np.sqrt(squares[first] * length / force).real / (2 * np.pi))
    elif squares[0] < -FREE_MOTION_STIFFNESS * float(np.abs(squares).max()):
        growing = "divergence"
    mode = balance.motion(modes[:, first].real)
    return Vibrations(
        squares * length / force, mode / np.linalg.norm(mode), growing, frequency
    )


@dataclass(frozen=True, eq=False)
class Spectrum:
    """Solutions of ``K x = omega^2 M x``.

    Attributes
    ----------
    squares : ndarray (k,)
        omega^2 by increasing real part, in the units of K over those of M; complex in
        pairs for a motion that flutters. Exactly zero for a motion that costs no energy.
    vectors : ndarray (f, k)
        Motions; ``X^T M X = 1`` if K is symmetric, else ``x^T M x = 1`` for each of them.
    left : ndarray (f, k)
        ``left^T M vectors = 1``; the same as `vectors` if K is symmetric.
    following : ndarray (f, z)
        Motions without mass that follow the others.
    quick : ndarray (f, f)
        ``Z K_ZZ^-1 Z^T``: their contribution to the response at every frequency.
    loose : ndarray (f, l)
        Motions with neither mass nor stiffness.
    coupled : bool
        Whether a loose motion is coupled to the forces of the others: then there are no
        modes.
    """

    squares: Array
    vectors: Array
    left: Array
    following: Array
    quick: Array
    loose: Array
    coupled: bool

    @property
    def is_complex(self) -> bool:
        """Whether a pair of motions flutters."""
        return bool(np.iscomplexobj(self.squares))


def kinetic_matrix(
    posture: MechanismPosture, terms: Iterable[Potential], units: Units
) -> Array | None:
    """Masses' matrix (n, n) of a posture with the payloads among its loads;
    None without one.

    Kinetic energy ``1/2 dq^T M dq``, masses in kg and lengths in the mechanism's unit.
    """
    mass = posture.mass_matrix()
    for term in terms:
        load = term.dead
        if load is None or load.mass <= 0.0:
            continue
        _, to_frame = posture.relative("world", load.frame)
        J, arm = to_frame.jacobian, load.point
        velocity = J[3:] + np.cross(J[:3], arm, axis=0)
        if mass is None:
            mass = np.zeros((J.shape[1], J.shape[1]))
        mass = mass + load.mass * units.newtons * velocity.T @ velocity
    return mass


def spectrum_of(
    stiffness: Array, mass: Array, terms: Array, mass_terms: Array | None = None
) -> Spectrum:
    """Squares of the angular frequencies and motions.

    Parameters
    ----------
    stiffness : ndarray, shape (f, f)
        K; symmetric if all forces have an energy.
    mass : ndarray, shape (f, f)
        M, symmetric and positive semidefinite.
    terms : ndarray, shape (f, f)
        Sum of the absolute terms of each entry of K: a motion costs no energy if its
        stiffness is below `numerics.FREE_MOTION_STIFFNESS` times these.
    mass_terms : ndarray, shape (f, f), optional
        The same for M; default M itself.
    """
    f = len(mass)
    T, Z = _massive(
        stiffness, terms, mass, np.abs(mass) if mass_terms is None else mass_terms
    )
    loose, coupled, back = np.zeros((f, 0)), False, T
    quick = np.zeros((f, f))
    if Z.shape[1]:
        Z, loose, unmoved, quick = _condensed(stiffness, terms, Z)
        if loose.shape[1] and T.shape[1]:
            # An entry of a semidefinite matrix is at most the root of its two diagonal
            # ones.
            size = np.sqrt(np.einsum("ij,ik,kj->j", np.abs(T), terms, np.abs(T)))
            least = (
                np.sqrt(numerics.FREE_MOTION_STIFFNESS * float(np.diag(terms).max()))
                * size
            )
            across = np.hstack([T.T @ stiffness @ loose, T.T @ stiffness.T @ unmoved])
            coupled = bool((np.abs(across) > least[:, None]).any())
        if Z.shape[1]:
            back, T = T - quick.T @ stiffness.T @ T, T - quick @ stiffness @ T
    reduced = back.T @ stiffness @ T
    if numerics.is_symmetric(stiffness):
        squares, y, lost = _symmetric_pairs(reduced, stiffness, mass, T)
        vectors = left = T @ y
    else:
        squares, vectors, left = _pairs(reduced, T, back)
        lost = f * numerics.EPSILON * numerics.largest(squares)
    size = np.abs(vectors)
    cost = np.einsum("ij,ij->j", size, terms @ size)
    squares = np.where(
        np.abs(squares) <= np.maximum(numerics.FREE_MOTION_STIFFNESS * cost, lost),
        0.0,
        squares,
    )
    return Spectrum(squares, vectors, left, Z, quick, loose, coupled)


def _massive(
    stiffness: Array, terms: Array, mass: Array, size: Array
) -> tuple[Array, Array]:
    """Motions (f, r) in which M is the identity, and a basis (f, z) of those
    without mass.

    The rank of M is found in decades: the motions with the most mass per stiffness are
    taken out first, so that those with less are not hidden by their rounding.
    """
    sizes = np.sqrt(np.diag(mass).clip(min=0.0))
    if len(mass) and (sizes > 0.0).all():  # a mass on every motion, known to its digits
        inertias, axes = np.linalg.eigh(mass / np.outer(sizes, sizes))
        if inertias[0] > numerics.NEGLIGIBLE_DIFFERENCE * inertias[-1]:
            return axes / np.sqrt(inertias) / sizes[:, None], np.zeros((len(mass), 0))
    left, found = _metric(stiffness, terms), []
    # Rounding of M: of each sum, and of the cancellation if an axis runs through a body's
    # centre.
    size = size + np.diag(np.full(len(mass), float(np.diag(mass).max(initial=0.0))))
    while left.shape[1]:
        inertias, axes = np.linalg.eigh(left.T @ mass @ left)
        own = left @ axes
        rounding = np.einsum("ij,ik,kj->j", np.abs(own), size, np.abs(own))
        heavy = inertias > numerics.NEGLIGIBLE_DISTANCE * inertias[-1]
        heavy &= inertias > len(mass) * numerics.EPSILON * rounding
        if not heavy.any():
            break
        found.append(own[:, heavy] / np.sqrt(inertias[heavy]))
        left = own[:, ~heavy]
    return np.hstack([left[:, :0], *found]), left


def _metric(stiffness: Array, terms: Array) -> Array:
    """Motions (f, f) in columns, orthonormal in the sizes of the eigenvalues of K."""
    size = np.sqrt(np.where((own := np.diag(terms)) > 0.0, own, 1.0))
    scaled = stiffness / size[:, None] / size
    values, axes = np.linalg.eigh(0.5 * (scaled + scaled.T))
    values = np.abs(values)
    costs = np.where(values > numerics.FREE_MOTION_STIFFNESS, values, 1.0)
    return axes / np.sqrt(costs) / size[:, None]


def _condensed(
    stiffness: Array, terms: Array, Z: Array
) -> tuple[Array, Array, Array, Array]:
    """Motions without mass: with stiffness, without; the latter's left ones;
    and a compliance.

    The left ones, along which none of Z exerts a force, are the same if K is symmetric.
    The compliance is that of the motions with stiffness.
    """
    size = np.sqrt(np.einsum("ij,ik,kj->j", np.abs(Z), terms, np.abs(Z)))
    Z = Z / np.where(size > 0.0, size, 1.0)
    U, values, Vt = np.linalg.svd(Z.T @ stiffness @ Z)
    left, right, free = Z @ U, Z @ Vt.T, values <= numerics.FREE_MOTION_STIFFNESS
    quick = (right[:, ~free] / values[~free]) @ left[:, ~free].T
    loose, unmoved = (
        own[:, free] / np.linalg.norm(own[:, free], axis=0) for own in (right, left)
    )
    return right[:, ~free], loose, unmoved, quick


def _symmetric_pairs(
    reduced: Array, stiffness: Array, mass: Array, T: Array
) -> tuple[Array, Array, float]:
    """Eigenvalues, orthonormal vectors, and the rounding error of the eigenvalues.

    Small ones come from the compliance if it exists, without that error. Motions that
    cost no energy, Z with Z^T M Z = 1, are stiffened for that by K + s M Z Z^T M, which
    keeps all others.
    """
    reduced = 0.5 * (reduced + reduced.T)
    values, y = np.linalg.eigh(reduced)
    size = np.abs(values)
    lost = len(values) * numerics.EPSILON * float(size.max(initial=0.0))
    if size.size and size.min() < numerics.SMALL_FREQUENCY_RATIO * size.max():
        inverse, free, held = numerics.invert(stiffness), size <= lost, 0.0
        if inverse is None and free.any():
            # Below all others, so that none is mixed with them.
            held = 0.5 * float(size[~free].min(initial=np.inf))
            holding = mass @ (T @ y[:, free])
            inverse = numerics.invert(stiffness + held * holding @ holding.T)
        if inverse is not None:
            reduced = reduced + held * y[:, free] @ y[:, free].T
            back = mass @ T
            values, y = numerics.eigenpairs(reduced, back.T @ inverse.matrix @ back)
            return np.where(np.abs(values) < 1.5 * held, 0.0, values), y, 0.0
    return values, y, lost


def _are_complex(squares: Array) -> Array:
    """Which omega^2 (n,) have an imaginary part beyond round-off."""
    return np.abs(squares.imag) > numerics.COMPLEX_SHARE * np.abs(squares)


def _pairs(reduced: Array, T: Array, back: Array) -> tuple[Array, Array, Array]:
    """The same without an energy; left and right vectors."""
    squares, y = np.linalg.eig(reduced)
    order = np.argsort(squares.real, kind="stable")
    squares, y = squares[order], y[:, order]
    if not _are_complex(squares).any():
        squares, y = squares.real, y.real
    y = y / np.linalg.norm(y, axis=0)
    try:
        z = np.linalg.inv(y).T
    except np.linalg.LinAlgError:  # two motions have met: no basis of modes
        z = np.full_like(y, np.nan)
    return squares, T @ y, back @ z
