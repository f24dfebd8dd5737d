r"""Impedance controllers: damping that fits a wanted stiffness and the masses at a posture.

The stiffness K wanted at M and the masses as M feels them, ``Lambda = (J M^-1 J^T)^-1``, are made
diagonal together (double diagonalisation, [AlbuSchaffer]_):

    Lambda = Q Q^T,   K = Q diag(k) Q^T,   D = Q diag(2 zeta sqrt k) Q^T

so that the closed loop falls apart into six oscillators, each with its ratio. The other rule,
``D = zeta (Lambda^1/2 K^1/2 + K^1/2 Lambda^1/2)``, gives ratios that are about the one wanted.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from cartstiff import numerics
from cartstiff.arrays import checked_array, checked_matrix, fixed
from cartstiff.errors import InputError, UndefinedError, UnknownNameError
from cartstiff.geometry import se3
from cartstiff.geometry.se3 import Array
from cartstiff.stiffness.tensor import StiffnessTensor
from cartstiff.vibration.comparison import mass_at_tip
from cartstiff.vibration.mode_set import Modes

#: Parameter layouts of controllers, and what each takes. Orders as their interfaces document them:
#: franka_msgs' SetCartesianStiffness; the wrench of KUKA's FRI, [F, tau_A, tau_B, tau_C] along its
#: Euler angles A, B, C about z, y, x; axes and point of the LWR as in the package kuka_fri.
LAYOUTS = {
    "full": "symmetric 6x6, rows in turn, (x, y, z, rx, ry, rz), base axes: CRISP controllers",
    "franka": "x, y, z, roll, pitch, yaw along a stiffness frame fixed to the hand",
    "kuka": "x, y, z, a, b, c (about z, y, x): KUKA FRI, base axes at the flange as on the LWR; a "
    "Sunrise controller takes them along the axes of its motion centre",
}


def double_diagonalisation(
    mass: ArrayLike, stiffness: ArrayLike, ratios: float | Sequence[float] = 0.7
) -> tuple[Array, Array, Array]:
    """Damping (n, n) with given ratios in the basis in which mass and stiffness are diagonal.

    Parameters
    ----------
    mass : array_like (n, n)
        Symmetric, positive definite.
    stiffness : array_like (n, n)
        Symmetric, positive semidefinite.
    ratios : float or sequence of float
        Share of critical damping: one, or one for each oscillator, softest (by omega) first.

    Returns
    -------
    damping : ndarray (n, n)
    basis : ndarray (n, n)
        V with ``V^T M V = 1``, ``V^T K V = diag(omega^2)``, ``V^T D V = diag(2 zeta omega)``.
    squares : ndarray (n,)
        omega^2.

    Raises
    ------
    InputError
        If the mass is not positive definite, the stiffness has negative eigenvalues, a matrix is
        not symmetric, or for ratios that cannot be used.
    """
    M, K = (_symmetric(m, what) for m, what in ((mass, "mass"), (stiffness, "stiffness")))
    zeta = _ratios(ratios, len(M))
    try:
        L = np.linalg.cholesky(M)
    except np.linalg.LinAlgError:
        got = f"smallest eigenvalue {np.linalg.eigvalsh(M)[0]:.3g}"
        raise InputError("mass is not positive definite", got=got) from None
    half = np.linalg.solve(L, K)
    squares, y = np.linalg.eigh(_half(np.linalg.solve(L, half.T)))
    least = -numerics.IDLE * float(np.abs(squares).max(initial=0.0))
    if (squares < least).any():
        raise InputError(
            "stiffness is not positive semidefinite: no damping holds it",
            got=f"omega^2 of {squares[0]:.3g}",
        )
    squares = np.maximum(squares, 0.0)
    Q = L @ y
    D = (Q * (2 * zeta * np.sqrt(squares))) @ Q.T
    return _half(D), np.linalg.solve(L.T, y), squares


def square_root_damping(mass: ArrayLike, stiffness: ArrayLike, ratio: float = 0.7) -> Array:
    """``zeta (M^1/2 K^1/2 + K^1/2 M^1/2)``: critical damping by square roots, for comparison.

    Raises
    ------
    InputError
        As `double_diagonalisation`.
    """
    M, K = (_symmetric(m, what) for m, what in ((mass, "mass"), (stiffness, "stiffness")))
    zeta = float(_ratios(ratio, 1)[0])
    a, b = _root(M, "mass"), _root(K, "stiffness")
    return _half(zeta * (a @ b + b @ a))


def _root(matrix: Array, what: str) -> Array:
    values, vectors = np.linalg.eigh(matrix)
    if values[0] < -numerics.IDLE * float(np.abs(values).max(initial=0.0)):
        raise InputError(
            f"{what} is not positive semidefinite", got=f"smallest eigenvalue {values[0]:.3g}"
        )
    return np.asarray((vectors * np.sqrt(np.maximum(values, 0.0))) @ vectors.T)


def _half(matrix: Array) -> Array:
    return 0.5 * matrix + 0.5 * matrix.T


def _symmetric(matrix: ArrayLike, what: str) -> Array:
    array = np.asarray(matrix, float)
    array = checked_matrix(array, what, len(array) if array.ndim else 1)
    if np.abs(array - array.T).max() > numerics.SYMMETRY * np.abs(array).max():
        raise InputError(
            f"{what} is not symmetric",
            expected="its symmetric part",
            got=f"|A - A^T| up to {np.abs(array - array.T).max():.3g}",
        )
    return _half(array)


def _ratios(ratios: float | Sequence[float], n: int) -> Array:
    values = checked_array(np.atleast_1d(np.asarray(ratios, float)), ("m",), "damping ratios")
    if values.size not in (1, n) or (values < 0.0).any():
        raise InputError(
            "damping ratios cannot be used",
            expected=f"1 or {n} numbers from zero",
            got=values.tolist(),
        )
    return np.broadcast_to(values, (n,))


@dataclass(frozen=True, eq=False)
class Impedance:
    """A controller's stiffness and damping at a posture.

    Attributes
    ----------
    stiffness, damping : ndarray (6, 6)
        At M, axes of M, order angular-linear.
    by_square_roots : ndarray (6, 6)
        The damping of the other rule.
    ratios : ndarray (6,)
        What the other rule makes of the ratio: the diagonal of its damping in the basis of the
        first, over ``2 omega``; NaN of motions without stiffness.
    coupling : float
        What it leaves beside that diagonal, as a share.
    mass : ndarray (6, 6)
        Masses as M feels them.
    frequencies : ndarray (6,)
        Hz, of the closed loop without damping.
    joint_stiffness, joint_damping : ndarray (n, n)
        ``J^T K J`` and ``J^T D J``.
    pose : ndarray (4, 4)
        ``T_F_M``.
    dropped : float
        Largest entry of the antisymmetric part of what was wanted, which no impedance controller
        can give, over the largest of its block.
    """

    stiffness: Array
    damping: Array
    by_square_roots: Array
    ratios: Array
    coupling: float
    mass: Array
    frequencies: Array
    joint_stiffness: Array
    joint_damping: Array
    pose: Array
    dropped: float

    def as_dict(self) -> dict[str, Any]:
        """Plain data: the matrices, and every layout with what it loses."""
        return {
            "order": "angular-linear",
            "axes": "body",
            **{
                key: getattr(self, key).tolist()
                for key in (
                    "stiffness",
                    "damping",
                    "by_square_roots",
                    "mass",
                    "frequencies",
                    "joint_stiffness",
                    "joint_damping",
                )
            },
            "ratios_by_square_roots": [float(x) if np.isfinite(x) else None for x in self.ratios],
            "coupling_by_square_roots": self.coupling,
            "antisymmetric_part_dropped": self.dropped,
            "layouts": {
                name: layout(self.stiffness, self.pose, name).as_dict() for name in LAYOUTS
            },
        }


def impedance(
    modes: Modes, wanted: StiffnessTensor | ArrayLike, ratios: float | Sequence[float] = 0.7
) -> Impedance:
    """Damping and joint-space gains for a stiffness wanted at M.

    Parameters
    ----------
    modes : Modes
        Modes of the arm at the posture: its masses count, its springs do not.
    wanted : StiffnessTensor or array_like (6, 6)
        A tensor at M (see `StiffnessTensor.from_controller`), or a matrix in the axes of M, order
        angular-linear. Only the symmetric part is used.
    ratios : float or sequence of float
        Damping ratios of the six oscillators, softest first.

    Raises
    ------
    UndefinedError
        Where M cannot move in every direction, or not every motion has a mass.
    InputError
        For a stiffness that is not positive semidefinite.
    """
    mass = mass_at_tip(modes)
    if mass is None:
        raise UndefinedError(
            "the masses as the body feels them do not exist here: it cannot move in every "
            "direction, or a motion has no mass",
            code="no-mass",
        )
    if isinstance(wanted, StiffnessTensor):
        wanted = wanted.to_order("angular-linear").matrix
    whole = checked_matrix(wanted, "stiffness wanted")
    K = _half(whole)
    dropped = float(np.abs(whole - K).max() / max(float(np.abs(whole).max()), numerics.TINY))
    D, V, squares = double_diagonalisation(mass, K, ratios)
    zeta = float(np.mean(_ratios(ratios, 6)))
    other = square_root_damping(mass, K, zeta)
    projected = V.T @ other @ V
    beside = projected - np.diag(np.diag(projected))
    with np.errstate(divide="ignore", invalid="ignore"):
        felt = np.where(squares > 0.0, np.diag(projected) / (2 * np.sqrt(squares)), np.nan)
    size = float(np.abs(projected).max(initial=0.0))
    J = modes.posture.motion.jacobian
    return Impedance(
        fixed(K),
        fixed(D),
        fixed(other),
        fixed(felt),
        float(np.abs(beside).max()) / size if size else 0.0,
        fixed(mass),
        fixed(np.sqrt(squares) / (2 * np.pi)),
        fixed(J.T @ K @ J),
        fixed(J.T @ D @ J),
        fixed(modes.posture.pose),
        dropped,
    )


@dataclass(frozen=True, eq=False)
class Layout:
    """Parameters as a controller takes them, and what is lost.

    Attributes
    ----------
    name : str
        Of `LAYOUTS`.
    values : tuple of float
        In the order that `LAYOUTS` says.
    frame : ndarray (4, 4) or None
        Stiffness frame in M, where the layout has one.
    lost : mapping of str to float
        Largest entry that is dropped over the largest of its block: "translation" and "rotation"
        (off-diagonal), "coupling" (over the root of both blocks' largest), "antisymmetric".
    """

    name: str
    values: tuple[float, ...]
    frame: Array | None
    lost: dict[str, float]

    def as_dict(self) -> dict[str, Any]:
        """Plain data."""
        return {
            "meaning": LAYOUTS[self.name],
            "values": list(self.values),
            "frame": None if self.frame is None else self.frame.tolist(),
            "lost": dict(self.lost),
        }


def layout(stiffness: ArrayLike, pose: ArrayLike, name: str) -> Layout:
    """A stiffness at M in the parameters of a controller, with what is lost.

    Parameters
    ----------
    stiffness : array_like (6, 6)
        In the axes of M, order angular-linear.
    pose : array_like (4, 4)
        ``T_F_M``.
    name : str
        Of `LAYOUTS`.

    Raises
    ------
    UnknownNameError
        For another name.
    """
    if name not in LAYOUTS:
        raise UnknownNameError("layout", name, LAYOUTS)
    whole = checked_matrix(stiffness, "stiffness")
    antisymmetric = float(
        np.abs(whole - whole.T).max() / 2 / max(np.abs(whole).max(), numerics.TINY)
    )
    K, R = _half(whole), np.asarray(pose, float)[:3, :3]
    frame = None
    if name == "franka":
        # Along the principal directions of the translational stiffness nothing is lost there.
        _, axes = np.linalg.eigh(K[3:, 3:])
        if np.linalg.det(axes) < 0.0:
            axes[:, 0] *= -1.0
        turn = axes
        frame = se3.pose(axes)
    else:
        turn = R.T
    A = np.kron(np.eye(2), turn)
    K = A.T @ K @ A
    rr, tt, rt = K[:3, :3], K[3:, 3:], K[:3, 3:]
    if name == "full":
        linear_first = K[se3.SWAP][:, se3.SWAP]
        return Layout(
            name, tuple(linear_first.ravel().tolist()), None, {"antisymmetric": antisymmetric}
        )
    size = np.sqrt(np.abs(rr).max() * np.abs(tt).max())
    lost = {
        "translation": _beside(tt),
        "rotation": _beside(rr),
        "coupling": float(np.abs(rt).max() / max(size, numerics.TINY)),
        "antisymmetric": antisymmetric,
    }
    turning = np.diag(rr) if name == "franka" else np.diag(rr)[::-1]
    return Layout(name, (*np.diag(tt).tolist(), *turning.tolist()), frame, lost)


def _beside(block: Array) -> float:
    size = max(float(np.abs(block).max()), numerics.TINY)
    share = float(np.abs(block - np.diag(np.diag(block))).max()) / size
    return 0.0 if share < numerics.ZERO else share
