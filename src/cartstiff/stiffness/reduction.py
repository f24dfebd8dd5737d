r"""One reduction for every mechanism: from energy in coordinates to stiffness of an output.

Given the gradient g and Hessian H of the energy in n coordinates, closures with Jacobian C, and an
output (the end-effector's pose, or the actuated coordinates) with Jacobian J, stationarity reads

    g + C^T lam = J^T w                                                                       (1)

and the Lagrangian Hessian H_L = H + sum lam_k c_k'' - sum w_k J_k' (symmetric for conservative
forces). On motions that keep the closures, N = null C, with H_N = N^T H_L N, J_N = J N and
self-motions Z = null J_N, the energy is minimised over the self-motion:

    S = H_N - H_N Z (Z^T H_N Z)^-1 Z^T H_N,     K = Y^T S Y,     J_N Y = U = range J_N          (2)
    C = J_N H_N^-1 J_N^T                                                                      (3)

For six independent outputs and no self-motion (2) is K = J^-T H_L J^-1. For the pose, K is K^B, in
components of the body frame. All decisions about rank are taken on length-scaled matrices: a
length is measured in the characteristic length l, so that every singular value is a pure number.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from cartstiff.geometry.se3 import Array
from cartstiff.potentials.contract import Evaluation, Map

__all__ = ["Reduction", "State", "reduce_to"]

#: Rank is lost below this ratio of singular values: ten of sixteen digits are gone, and the
#: rounded constants of a URDF (twelve digits) must not turn a singular posture into a regular one.
RANK = 1e-10
#: A posture is balanced if the torque along the self-motion is below this share of the torques,
BALANCE = 1e-8
#: or is what the springs exert over a rounding error of this size (rad) in the coordinates.
ROUNDING = 1e-12
#: Eigenvalues below this share of the largest count as zero.
DEFINITE = 1e-11


class State(NamedTuple):
    """A named state of the mechanism, with the numbers that show it."""

    code: str
    message: str
    values: dict[str, object]


@dataclass(frozen=True, slots=True)
class Reduction:
    """What equation (2) and (3) gave, or why not.

    Attributes
    ----------
    force : ndarray (6,) or None
        Output force w; None if the posture is unbalanced.
    stiffness : ndarray (6, 6) or None
        K; None if it does not exist, for which `states` has the reason.
    compliance : ndarray (6, 6) or None
        C where `stiffness` does not exist, as at kinematic singularities; elsewhere it is the
        inverse of the stiffness and left to the caller.
    multipliers : ndarray (m,)
        Closure forces lam.
    singular_values : ndarray
        Of the length-scaled J_N.
    rank : int
        Of J_N.
    freedoms : int
        Number of free motions, the columns of N.
    reachable, reachable_stiffness : ndarray (6, r), (r, r)
        U and Y^T S Y: the stiffness on the motions that exist.
    rates : ndarray (n, 6) or None
        Coordinate rates per output rate, N J_N^-1, where that is one to one.
    motions : ndarray (n, f) or None
        Motions that keep the closures, in scaled coordinates; None if all do.
    states : list of State
        Named states found.
    """

    force: Array | None
    stiffness: Array | None
    compliance: Array | None
    multipliers: Array
    singular_values: Array
    rank: int
    freedoms: int
    reachable: Array | None = None
    reachable_stiffness: Array | None = None
    rates: Array | None = None
    motions: Array | None = None
    states: list[State] = field(default_factory=list)


def _invert(matrix: Array) -> Array | None:
    """Inverse, or None where it has lost all but two digits.

    The product of norms bounds the condition number within a factor of n: cheaper than an SVD.
    """
    try:
        inverse = np.linalg.inv(matrix)
    except np.linalg.LinAlgError:
        return None
    condition = np.linalg.norm(matrix) * np.linalg.norm(inverse)
    return inverse if np.isfinite(condition) and condition < 1e14 else None


def reduce_to(
    output: Map,
    energy: Evaluation,
    closure: Map | None,
    length: float,
    coordinate_lengths: Array,
    force: Array | None = None,
    what: str = "end-effector",
) -> Reduction:
    """Reduce an energy in coordinates to an output; equations (1) to (3) of this module.

    Parameters
    ----------
    output : Map
        Jacobian (6, n) of the output with its curvature. Rows 0..2 are angles and 3..5 lengths.
    energy : Evaluation
        Energy, gradient and Hessian in the n coordinates.
    closure : Map or None
        Closure residual's Jacobian (m, n) with curvature.
    length : float
        Characteristic length of the mechanism, in its unit.
    coordinate_lengths : ndarray, shape (n,)
        1 for an angle, `length` for a distance: the natural size of each coordinate.
    force : ndarray (6,), optional
        The physical wrench, where the structure carries a part that the coordinates do not feel.
    what : str
        Name of the output in messages.
    """
    per_length = 1 / length
    rows = np.array([1.0, 1.0, 1.0, per_length, per_length, per_length])
    J = output.jacobian
    m, n = J.shape
    if closure is None and n == m:
        result = _square(output, energy, rows, coordinate_lengths)
        if result is not None:
            return result
    return _general(output, energy, closure, rows, coordinate_lengths, force, what)


def _square(output: Map, energy: Evaluation, rows: Array, columns: Array) -> Reduction | None:
    """As many coordinates as outputs and no closure: K = J^-T H_L J^-1; None if J is singular."""
    J = output.jacobian
    values = np.linalg.svd(J * rows[:, None] * columns, compute_uv=False)
    if not values[-1] > RANK * values[0]:
        return None
    A = np.linalg.inv(J)
    force = A.T @ energy.gradient
    K = A.T @ (energy.hessian - output.curvature(force)) @ A
    return Reduction(force, K, None, np.zeros(0), values, len(values), len(values), rates=A)


class _Decomposition(NamedTuple):
    """Singular value decomposition of a matrix (m, n), its bases split at the rank r."""

    #: Singular values.
    values: Array
    rank: int
    #: Range (m, r) and what is left of the space (m, m - r).
    U: Array
    lost: Array
    #: Inputs that reach the range (n, r), and the null space (n, n - r).
    V: Array
    null: Array

    def solve_transposed(self, right: Array) -> Array:
        """Solution x of least norm of ``matrix^T x = right``, in the sense of least squares."""
        return self.U @ ((self.V.T @ right) / self.values[: self.rank])


def _decompose(matrix: Array) -> _Decomposition:
    U, values, Vt = np.linalg.svd(matrix)
    rank = int(np.count_nonzero(values > RANK * max(values.max(initial=0.0), 1e-300)))
    return _Decomposition(values, rank, U[:, :rank], U[:, rank:], Vt[:rank].T, Vt[rank:].T)


def _general(
    output: Map,
    energy: Evaluation,
    closure: Map | None,
    rows: Array,
    columns: Array,
    force: Array | None,
    what: str,
) -> Reduction:
    """Any number of coordinates, closures, lost ranks: in scaled units throughout."""
    states: list[State] = []
    J = output.jacobian * rows[:, None] * columns
    g = energy.gradient * columns
    H = energy.hessian * columns[:, None] * columns

    N = closures = None  # without closures N is the identity
    J_N, g_N, lam = J, g, np.zeros(0)
    if closure is not None:
        closures = _decompose(closure.jacobian * columns)
        N, lam = closures.null, np.zeros(len(closure.jacobian))
        if closures.rank < len(lam):
            irregular = _irregular(closure, closures, columns)
            if irregular is not None:
                return Reduction(
                    None, None, None, lam, closures.values, 0, N.shape[1],
                    motions=N, states=[irregular],
                )  # fmt: skip
        J_N, g_N = J @ N, N.T @ g
    values, rank, U, lost, V, Z = _decompose(J_N)
    freedoms = J_N.shape[1]

    # Balance: the self-motion must feel no torque, whatever wrench acts on the output.
    along = Z.T @ g_N
    scale = float(np.abs(g).max(initial=0.0))
    noise = ROUNDING * float(np.abs(H).max(initial=0.0))
    if np.abs(along).max(initial=0.0) > BALANCE * scale + noise:
        torque = _from_free(N, Z @ along) / columns
        states.append(
            State(
                "unbalanced",
                f"no wrench at the {what} balances this posture: a torque acts along the "
                "self-motion and the mechanism would move; choose rest positions that balance it, "
                "or let the self-motion settle",
                {"unbalanced_torque": torque.tolist(), "largest": float(np.abs(torque).max())},
            )
        )
        return Reduction(None, None, None, lam, values, rank, freedoms, motions=N, states=states)

    w = U @ ((V.T @ g_N) / values[:rank])
    if force is not None:
        given = force / rows
        missed = float(np.abs(J_N.T @ given - g_N).max(initial=0.0))
        if missed <= 1e-6 * max(scale, float(np.abs(given).max())) + noise:
            w = given
        else:
            states.append(
                State(
                    "wrench-ignored",
                    "the wrench given is not the one that the springs exert on the reachable "
                    "motions; the wrench of least norm is used",
                    {"difference": (J_N.T @ given - g_N).tolist()},
                )
            )
    H_N = H - output.curvature(w * rows) * columns[:, None] * columns
    if closure is not None and closures is not None:
        lam, N = closures.solve_transposed(J.T @ w - g), closures.null
        H_N = N.T @ (H_N + closure.curvature(lam) * columns[:, None] * columns) @ N

    if rank < len(rows):
        missing = lost * rows[:, None]
        kind = "deficient" if freedoms < len(rows) else "serial-singularity"
        states.append(
            State(
                kind,
                f"the {what} cannot move in {len(rows) - rank} of {len(rows)} directions here"
                + ("" if kind == "deficient" else " (serial singularity)")
                + ": the stiffness matrix does not exist, the compliance does; the wrench along "
                "them is carried by the structure and is taken as zero in the scaled norm",
                {
                    "rank": rank,
                    "singular_values": values.tolist(),
                    "characteristic_length": float(1 / rows[-1]),
                    "structural_wrenches": missing.T.tolist(),
                },
            )
        )
    S = _minimise_over_self_motion(H_N, Z, N, columns, states)
    K = reachable = reachable_K = None
    if S is not None:
        Y = V / values[:rank]
        reachable_K = Y.T @ S @ Y  # in the basis U of scaled outputs
        if rank == len(rows):
            K = (U @ reachable_K @ U.T) * rows[:, None] * rows
        reachable = U / rows[:, None]
    compliance = rates = None
    if K is None and S is not None and (inverse := _invert(H_N)) is not None:
        compliance = (J_N @ inverse @ J_N.T) / rows[:, None] / rows
    if K is not None and Z.shape[1] == 0:
        rates = columns[:, None] * (_from_free(N, V / values[:rank]) @ U.T) * rows
    if states and states[0].code in ("deficient", "serial-singularity") and reachable is not None:
        states[0].values["reachable_motions"] = reachable.T.tolist()
        states[0].values["reachable_stiffness"] = (
            None if reachable_K is None else reachable_K.tolist()
        )
    return Reduction(
        w * rows, K, compliance, lam, values, rank, freedoms, reachable, reachable_K, rates,
        N, states,
    )  # fmt: skip


def _from_free(N: Array | None, motions: Array) -> Array:
    """All coordinates of motions given in the free ones; N is None where all are free."""
    return motions if N is None else N @ motions


def _minimise_over_self_motion(
    H_N: Array, Z: Array, N: Array | None, columns: Array, states: list[State]
) -> Array | None:
    """S of equation (2); None where the self-motion is not held by positive stiffness."""
    if Z.shape[1] == 0:
        return H_N
    block = Z.T @ H_N @ Z
    eigenvalues, modes = np.linalg.eigh(0.5 * (block + block.T))
    largest = max(float(np.abs(H_N).max()), 1e-300)

    def directions(chosen: Array) -> Array:
        """Some of the self-motions, one a row."""
        return (_from_free(N, Z @ modes[:, chosen]) * columns[:, None]).T

    buckled = eigenvalues < -DEFINITE * largest
    idle = np.abs(eigenvalues) <= DEFINITE * largest
    if buckled.any():
        states.append(
            State(
                "buckled",
                "the self-motion is unstable: the energy has no minimum over it, the mechanism "
                "would snap away from this posture",
                {
                    "self_motion_stiffness": eigenvalues.tolist(),
                    "direction": directions(np.array([0]))[0].tolist(),  # the softest
                },
            )
        )
        return None
    if idle.any():
        Z0 = Z @ modes[:, idle]
        felt = float(np.abs(H_N @ Z0).max())
        states.append(
            State(
                "idle-self-motion",
                f"{int(idle.sum())} self-motion(s) cost no energy"
                + (
                    ": they do not move the end-effector and are left out"
                    if felt <= 1e-7 * largest
                    else " but couple to the others: no minimum exists"
                ),
                {"directions": directions(idle).tolist(), "coupling": felt},
            )
        )
        if felt > 1e-7 * largest:
            return None
    keep = Z @ modes[:, ~idle]
    if keep.shape[1] == 0:
        return H_N
    inner = np.linalg.inv(keep.T @ H_N @ keep)
    return H_N - (H_N @ keep) @ inner @ (keep.T @ H_N)


def _irregular(closure: Map, closures: _Decomposition, columns: Array) -> State | None:
    """Name closures whose lost rank matters; None for redundant ones that are harmless.

    Along each covector nu with nu C = 0 the residual grows like the form x nu c'' x of the free
    motions x. Where all forms vanish the closures are merely repeated. Where they share a real
    root, branches of motion leave along it; where they share none, what is free to first order is
    blocked to second.
    """
    values, N = closures.values, closures.null
    curvatures = (closure.curvature(nu) for nu in closures.lost.T)
    forms = [N.T @ (curvature * columns[:, None] * columns) @ N for curvature in curvatures]
    size = max(float(np.abs(form).max(initial=0.0)) for form in forms)
    if size <= 1e-7 * max(1.0, float(values.max(initial=0.0))):
        return None
    forms = [form for form in forms if np.abs(form).max() > 1e-7 * size]
    root = _common_root(np.array(forms) / size)
    seen: dict[str, object] = {
        "rank": closures.rank,
        "singular_values": values.tolist(),
        "second_order": [np.linalg.eigvalsh(form).tolist() for form in forms],
        "motions": (columns[:, None] * N).T.tolist(),
    }
    if root is not None:
        return State(
            "constraint-singularity",
            "the closures lose rank here and branches of motion meet: the energy has no second "
            "derivative along them",
            {**seen, "branch": (columns * (N @ root)).tolist()},
        )
    return State(
        "non-regular-redundancy",
        "the closures lose rank here and block to second order what is free to first order: the "
        "mechanism is shaky, and its closure forces are not determined",
        seen,
    )


def _common_root(forms: Array) -> Array | None:
    """Unit vector on which all quadratic forms (k, f, f) vanish, or None if none is found.

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
                    np.sqrt(eigenvalues[-1]) * low + sign * np.sqrt(-eigenvalues[0]) * high
                )
    for x in starts:
        x = x / np.linalg.norm(x)
        for _ in range(30):
            images = forms @ x
            residual = images @ x
            if np.abs(residual).max() < 1e-9:
                return x
            x = x - np.linalg.lstsq(2 * images, residual, rcond=1e-12)[0]
            x = x / max(float(np.linalg.norm(x)), 1e-300)
    return None
