r"""The motions of a mechanism at one posture, and the output that they move.

With C the Jacobian of the closures and J that of the output, free motions N keep the
closures, the self-motions Z among them do not move the output, and motions Y, one for
each of the other columns, move it along all directions U that it can move along (section
6 of the theory page, `motions`):

    C N = 0,     J Z = 0,     J Y has the range of J N, with the orthonormal basis U.  (1)

All ranks are decided here, on length-scaled matrices: a length is measured in the
characteristic length, so that every singular value is a pure number. Where the closures
lose rank, they are redundant, or motions bifurcate, or are blocked to second order.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from cartstiff.core import numerics
from cartstiff.core.arrays import Array
from cartstiff.core.errors import ConvergenceError, UndefinedError
from cartstiff.core.mechanisms.contract import Mechanism, MechanismPosture
from cartstiff.core.notes import Note
from cartstiff.core.potentials.contract import SecondOrderMap
from cartstiff.core.stiffness.free_motions import FreeMotions


class Problem(NamedTuple):
    """An energy, an output and closures in natural units: rad and characteristic lengths.

    Attributes
    ----------
    output, closure : SecondOrderMap, the latter or None
        In the mechanism's own units.
    rows, columns : ndarray (6,), (n,)
        Factors of the output's components, and of the coordinates, into natural units.
    J, g, H : ndarray (6, n), (n,), (n, n)
        Jacobian of the output, gradient and Hessian of the energy.
    stiff : ndarray (n,)
        Largest absolute entry of each column of H.
    has_energy : bool
        Whether the forces have a potential; H is symmetric then.
    by_lengths, rank_nearby : callable or None
        See `cartstiff.core.stiffness.reduction.reduce_to`.
    """

    output: SecondOrderMap
    closure: SecondOrderMap | None
    rows: Array
    columns: Array
    J: Array
    g: Array
    H: Array
    stiff: Array
    has_energy: bool
    by_lengths: Callable[[], FreeMotions | None] | None = None
    rank_nearby: Callable[[Array], int | None] | None = None

    def curvature(self, to: SecondOrderMap, force: Array) -> Array:
        """Curvature (n, n) of a map contracted with a force, in natural coordinates."""
        return to.curvature(force) * self.columns[:, None] * self.columns

    @property
    def closure_sizes(self) -> Array:
        """Natural sizes (m,) of the closures."""
        if self.closure is None:
            return np.zeros(0)
        sizes = self.closure.sizes
        return np.ones(len(self.closure.jacobian)) if sizes is None else sizes


class Closures(NamedTuple):
    """Singular value decomposition of the scaled closure Jacobian, split at its rank."""

    values: Array
    rank: int
    #: Covectors (m, r) of the range and (m, m - r) of its complement; motions (n, r) that
    #: violate the closures, and (n, f) that keep them.
    U: Array
    lost: Array
    V: Array
    N: Array

    def forces(self, right: Array, where: list[int]) -> Array:
        """Multipliers of least norm with ``C^T lam = right`` in the chosen
        coordinates.
        """
        if not any(right.tolist()):
            return np.zeros(len(self.U))
        share = (self.V * self.values[: self.rank])[where]
        lam: Array = self.U @ np.linalg.lstsq(share, right[where], rcond=numerics.RANK)[0]
        return lam


def decomposed(closure: SecondOrderMap, columns: Array) -> Closures:
    """Decompose the Jacobian of closures, in natural sizes of closures and
    coordinates.
    """
    matrix = closure.jacobian * columns
    return decompose(matrix if closure.sizes is None else matrix / closure.sizes[:, None])


def decompose(matrix: Array) -> Closures:
    """Decompose the scaled Jacobian (m, n) of closures."""
    U, values, Vt = np.linalg.svd(matrix)
    r = numerics.rank(values)
    return Closures(values, r, U[:, :r], U[:, r:], Vt[:r].T, Vt[r:].T)


def irregular(closure: SecondOrderMap, found: Closures, columns: Array) -> Note | None:
    """State of closures that have lost rank; None if none is lost,
    or they are merely redundant.

    Along each covector nu with nu C = 0 the residual grows like the form x nu c'' x of
    the free motions x. If all forms vanish, the closures are redundant. If they have a
    common real root, motions bifurcate along it; if they have none, motions that are free
    to first order are blocked to second order.

    Parameters
    ----------
    closure : SecondOrderMap
        Jacobian (m, n) with curvature.
    found : Closures
        The closures, decomposed in natural sizes.
    columns : ndarray, shape (n,)
        Scales of the coordinates.
    """
    values, N = found.values, found.N
    if not found.lost.shape[1]:
        return None
    # The quadratic forms by which residuals grow; none: the closures are redundant.
    lost = found.lost if closure.sizes is None else found.lost / closure.sizes[:, None]
    curvatures = (closure.curvature(nu) for nu in lost.T)
    forms = np.array(
        [N.T @ (curvature * columns[:, None] * columns) @ N for curvature in curvatures]
    )
    sizes = np.abs(forms).max(axis=(1, 2), initial=0.0)
    size = float(sizes.max())
    if size <= numerics.VANISHING_FORM * max(1.0, float(values.max(initial=0.0))):
        return None
    forms = forms[sizes > numerics.VANISHING_FORM * size]
    # A motion on which all forms vanish is a branch; without any, every motion is
    # blocked.
    root = _common_root(forms / size)
    numbers: dict[str, object] = {
        "rank": found.rank,
        "singular_values": values.tolist(),
        "second_order": np.linalg.eigvalsh(forms).tolist(),
        "motions": (columns[:, None] * N).T.tolist(),
    }
    if root is not None:
        return Note(
            "constraint-singularity",
            "the closures lose rank here and branches of motion meet: the energy has no "
            "second derivative along them",
            {**numbers, "branch": (columns * (N @ root)).tolist()},
        )
    return Note(
        "non-regular-redundancy",
        "the closures lose rank here and block to second order what is free to first "
        "order: the mechanism is shaky, and its closure forces are not determined",
        numbers,
    )


def _common_root(forms: Array) -> Array | None:
    """Unit vector on which all quadratic forms (k, f, f) vanish,
    or None if none is found.

    Gauss-Newton on the sphere from the forms' own roots and a fixed set of directions.
    """
    n = forms.shape[1]
    starts = [*np.eye(n), *np.random.default_rng(0).normal(size=(20 * n, n))]
    for form in forms:
        eigenvalues, vectors = np.linalg.eigh(form)
        low, high = vectors[:, 0], vectors[:, -1]
        if eigenvalues[0] < 0 < eigenvalues[-1]:
            for sign in (1.0, -1.0):
                starts.append(
                    np.sqrt(eigenvalues[-1]) * low
                    + sign * np.sqrt(-eigenvalues[0]) * high
                )
    for x in starts:
        x = x / np.linalg.norm(x)
        for _ in range(30):
            images = forms @ x
            residual = images @ x
            if np.abs(residual).max() < numerics.NEGLIGIBLE_DIFFERENCE:
                return x
            x = x - np.linalg.lstsq(2 * images, residual, rcond=numerics.ROUNDOFF)[0]
            x = x / max(numerics.norm(x), numerics.TINY)
    return None


class Motions(NamedTuple):
    """Result of equation (1), in natural units.

    Attributes
    ----------
    closures : Closures or None
        The decomposed closures, if there are any.
    N : ndarray (n, f)
        Free motions by coordinates that lead, see
        `cartstiff.core.numerics.stiffness_scaled_basis`.
    orthonormal : ndarray (n, f)
        The same motions in an orthonormal basis.
    follow : list of int
        The coordinates that do not lead.
    values : ndarray
        Singular values of J N, N orthonormal.
    rank, usual_rank : int
        Rank of J N here, and at the postures around this one.
    U, lost : ndarray (6, r), (6, 6 - r)
        Directions along which the output can move and cannot.
    still : list of slice
        Rows of the output, angular or linear, that do not move at all.
    Y, Z : ndarray (n, r), (n, f - r)
        Motions that move the output, and self-motions.
    along : ndarray (n, f - r)
        The self-motions in an orthonormal basis.
    to_output : ndarray (r, r)
        Inverse of U^T J Y: the motions of Y per reachable output.
    """

    closures: Closures | None
    N: Array
    orthonormal: Array
    follow: list[int]
    values: Array
    rank: int
    usual_rank: int
    U: Array
    lost: Array
    still: list[slice]
    Y: Array
    Z: Array
    along: Array
    to_output: Array

    @property
    def freedoms(self) -> int:
        """Number of free motions."""
        return self.N.shape[1]


def motions(
    problem: Problem,
    closures: Closures | None,
) -> Motions:
    """Solve equation (1): the first step of the reduction.

    Parameters
    ----------
    problem : Problem
        The output and the closures.
    closures : Closures or None
        The decomposed closures, which are regular or redundant.
    """
    J, stiff, n = problem.J, problem.stiff, len(problem.g)
    # Orthonormal motions have the singular values; leading coordinates keep soft springs
    # exact.
    N, orthonormal, leading, J_N = np.eye(n), np.eye(n), np.arange(n), J
    if closures is not None:
        orthonormal = closures.N
        N, leading = numerics.stiffness_scaled_basis(orthonormal, stiff, closures.V)
        J_N = J @ orthonormal
    values, freedoms = numerics.singular_values(J_N), N.shape[1]
    rank = numerics.rank(values, numerics.EPSILON * np.abs(J).sum())
    usual_rank, every = min(len(J), freedoms), rank == len(J)
    U, lost, still = np.eye(len(J)), np.zeros((len(J), 0)), list[slice]()
    Y, Z, along = N, N[:, rank:], orthonormal[:, rank:]
    if rank < max(J_N.shape):
        left, _, Vt = np.linalg.svd(J_N)
        along = orthonormal @ Vt[rank:].T
        if not every:  # otherwise round-off of the basis replaces zeros of K
            U, lost, still = left[:, :rank], left[:, rank:], numerics.still_halves(J_N)
            if (
                rank < usual_rank
                and problem.rank_nearby
                and not _rises(problem, closures, lost, orthonormal, along)
            ):
                usual_rank = problem.rank_nearby(orthonormal) or usual_rank
            for half in still:
                U[half] = 0.0
        # Self-motions are parametrised by the stiffest coordinates; the remaining leading
        # ones, as many as the rank, make the output.
        across = (U.T @ J @ N).T
        Z, chosen = numerics.stiffness_scaled_basis(
            along[leading], stiff[leading], across
        )
        Z, Y = N @ Z, N[:, _without(chosen, freedoms)]
    J_Y = J @ Y if every else U.T @ J @ Y
    sizes = None if closures is None else (np.abs(J) @ np.abs(Y)).max(axis=0, initial=0.0)
    return Motions(
        closures,
        N,
        orthonormal,
        _without(leading, n),
        values,
        rank,
        usual_rank,
        U,
        lost,
        still,
        Y,
        Z,
        along,
        _inverse(J_Y, sizes),
    )


def _rises(
    problem: Problem, closures: Closures | None, lost: Array, N: Array, along: Array
) -> bool:
    """Whether the rank of J N is larger at postures around this one, to first order.

    With u a direction that is lost, ``u^T J = nu^T C``, the motion x turns the
    self-motion z into one that moves the output along u at the rate ``x^T (u . J' - nu .
    c'') z``. The posture is singular if a rate exists. If none does, self-motions remain
    so to first order: spins of rods, joints beside those that move a body with fewer than
    six freedoms, and where two singularities meet.

    Parameters
    ----------
    problem, closures
        As in `motions`.
    lost : ndarray (6, k)
        Directions u that the output cannot move along.
    N, along : ndarray (n, f), (n, f - r)
        Orthonormal free motions, and self-motions.
    """
    J, columns = problem.output.jacobian, problem.columns
    least = numerics.VANISHING_FORM * max(1.0, float(np.abs(J * columns).max()))
    for u in (lost * problem.rows[:, None]).T:
        form = problem.output.curvature(u)
        if problem.closure is not None and closures is not None and closures.values.size:
            nu = closures.forces(columns * (J.T @ u), list(range(len(columns))))
            form = form - problem.closure.curvature(nu / problem.closure_sizes)
        rates = N.T @ (form * columns[:, None] * columns) @ along
        if numerics.largest(rates) > least:
            return True
    return False


def _without(some: Array, count: int) -> list[int]:
    """Whole numbers below `count` that are not in `some`."""
    known = set(some.tolist())
    return [i for i in range(count) if i not in known]


def _inverse(matrix: Array, sizes: Array | None) -> Array:
    """Inverse of a regular matrix, with zeros for entries that may be round-off.

    `sizes` (n,) are the sizes of the terms in the sums of each column of the matrix; None
    if it is no sum.
    """
    try:
        inverse: Array = np.linalg.inv(matrix)
    except np.linalg.LinAlgError:  # chains that are singular in two ways at once
        raise UndefinedError(
            "the motions of the body and those inside the mechanism cannot be told apart "
            "here: the posture is singular in more than one way",
            code="ill-conditioned",
            values={"motions": matrix.tolist()},
        ) from None
    if sizes is None:
        return inverse
    size = np.abs(inverse)
    rounding = len(matrix) * numerics.EPSILON * np.outer(size.sum(axis=1), sizes @ size)
    inverse[size <= rounding] = 0.0
    return inverse


def values_of_closed(posture: MechanismPosture) -> tuple[Array, int, Array]:
    """`Reduction.singular_values`, `freedoms` and `motions` for regular closures."""
    assert posture.closure is not None
    N = decomposed(posture.closure, posture.coordinate_lengths).N
    return values_on(N, posture, posture.motion.jacobian), N.shape[1], N


def values_on(motions: Array, posture: MechanismPosture, jacobian: Array) -> Array:
    """Singular values of the length-scaled Jacobian on orthonormal motions (n, f)."""
    return numerics.singular_values(_scaled(posture, jacobian, posture.length) @ motions)


def _scaled(posture: MechanismPosture, J: Array, length: float) -> Array:
    """A Jacobian (6, n) of a posture, length-scaled."""
    rows = np.repeat([1.0, 1.0 / length], 3)
    return np.asarray(J * rows[:, None] * posture.coordinate_lengths)


def scaled_values(
    posture: MechanismPosture, jacobian: Array | None = None, length: float | None = None
) -> Array:
    """Singular values of the length-scaled Jacobian of a posture.

    Both may be known already.
    """
    J = posture.motion.jacobian if jacobian is None else jacobian
    length = posture.length if length is None else length
    return numerics.singular_values(_scaled(posture, J, length))


#: Lengths, rad or characteristic lengths, of the ways to a posture nearby: far enough
#: that what is lost at a point is regained, and a shorter one for chains that do not
#: close so far away.
_AWAY = (0.1, 0.02)


def rank_nearby(
    mechanism: Mechanism, posture: MechanismPosture, motions: Array
) -> int | None:
    """Rank of the body's motions at a posture beside this one;
    None if the chain does not close.

    Parameters
    ----------
    mechanism : Mechanism
        The mechanism.
    posture : MechanismPosture
        Where the way starts.
    motions : ndarray (n, f)
        Free motions, in scaled coordinates: the way is a sum of all, none of them
        special.
    """
    way = motions @ np.cos(np.arange(motions.shape[1]) ** 2 + 1.0)
    way = posture.coordinate_lengths * way / max(numerics.norm(way), numerics.TINY)
    for size in _AWAY:
        try:
            there = mechanism.closed(posture.q + size * way, hold=())
        except ConvergenceError:
            continue
        closed = there.closure is not None
        return numerics.rank(
            values_of_closed(there)[0] if closed else scaled_values(there)
        )
    return None
