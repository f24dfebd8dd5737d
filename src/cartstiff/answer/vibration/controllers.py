r"""Impedance controllers: damping that fits a wanted stiffness and the masses
at a posture.

The required stiffness K at M and the operational-space mass ``Lambda = (J M^-1 J^T)^-1``
are diagonalised together (double diagonalisation, [AlbuSchaffer]_):

    Lambda = Q Q^T,   K = Q diag(k) Q^T,   D = Q diag(2 zeta sqrt k) Q^T

so that the closed loop decouples into six oscillators, each with its ratio. The
square-root rule, ``D = zeta (Lambda^1/2 K^1/2 + K^1/2 Lambda^1/2)``, yields ratios close
to the required one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from cartstiff.answer.vibration.modes import Modes
from cartstiff.core import numerics
from cartstiff.core.arrays import Array, Result, checked_array, checked_matrix, plain
from cartstiff.core.choices import Axes, Order
from cartstiff.core.errors import InputError, UndefinedError
from cartstiff.core.figures import draw_bars, new_figure
from cartstiff.core.geometry.connections import NAMED
from cartstiff.core.results import LabelledResult
from cartstiff.core.stiffness.tensor import StiffnessTensor
from cartstiff.core.units import SI, convert_length


def double_diagonalisation(
    mass: ArrayLike, stiffness: ArrayLike, ratios: float | Sequence[float] = 0.7
) -> tuple[Array, Array, Array]:
    """Damping (n, n) with given ratios in the basis in which mass and stiffness
    are diagonal.

    Parameters
    ----------
    mass : array_like (n, n)
        Symmetric, positive definite.
    stiffness : array_like (n, n)
        Symmetric, positive semidefinite.
    ratios : float or sequence of float
        Share of critical damping: one, or one for each oscillator, softest (by omega)
        first.

    Returns
    -------
    damping : ndarray (n, n)
    basis : ndarray (n, n)
        V with ``V^T M V = 1``, ``V^T K V = diag(omega^2)``, ``V^T D V = diag(2 zeta
        omega)``.
    squares : ndarray (n,)
        omega^2.

    Raises
    ------
    InputError
        If the mass is not positive definite, the stiffness has negative eigenvalues, a
        matrix is not symmetric, or for ratios that cannot be used.
    """
    M, K = (_symmetric(m, what) for m, what in ((mass, "mass"), (stiffness, "stiffness")))
    zeta = _ratios(ratios, len(M))
    from scipy.linalg import eigh

    try:
        squares, V = eigh(K, M)
    except np.linalg.LinAlgError:
        got = f"smallest eigenvalue {np.linalg.eigvalsh(M)[0]:.3g}"
        raise InputError("mass is not positive definite", got=got) from None
    least = -numerics.FREE_MOTION_STIFFNESS * numerics.largest(squares)
    if (squares < least).any():
        raise InputError(
            "stiffness is not positive semidefinite: no damping holds it",
            got=f"omega^2 of {squares[0]:.3g}",
        )
    squares = np.maximum(squares, 0.0)
    same = np.diff(squares) <= numerics.REPEATED_FREQUENCY * squares[1:]
    if (unlike := same & (np.diff(zeta) != 0.0)).any():
        first = int(np.flatnonzero(unlike)[0])
        raise InputError(
            f"oscillators {first + 1} and {first + 2} have the same frequency, so that "
            "their "
            "directions are not determined",
            expected="the same damping ratio for both",
            got=zeta[first : first + 2].tolist(),
        )
    Q = M @ V
    D = (Q * (2 * zeta * np.sqrt(squares))) @ Q.T
    return _symmetrised(D), V, squares


def square_root_damping(
    mass: ArrayLike, stiffness: ArrayLike, ratio: float = 0.7
) -> Array:
    """``zeta (M^1/2 K^1/2 + K^1/2 M^1/2)``: critical damping by square roots,
    for comparison.

    Raises
    ------
    InputError
        As `double_diagonalisation`.
    """
    M, K = (_symmetric(m, what) for m, what in ((mass, "mass"), (stiffness, "stiffness")))
    zeta = float(_ratios(ratio, 1)[0])
    a, b = _root(M, "mass"), _root(K, "stiffness")
    return _symmetrised(zeta * (a @ b + b @ a))


def _root(matrix: Array, what: str) -> Array:
    values, vectors = np.linalg.eigh(matrix)
    if values[0] < -numerics.FREE_MOTION_STIFFNESS * numerics.largest(values):
        raise InputError(
            f"{what} is not positive semidefinite",
            got=f"smallest eigenvalue {values[0]:.3g}",
        )
    return np.asarray((vectors * np.sqrt(np.maximum(values, 0.0))) @ vectors.T)


def _symmetrised(matrix: Array) -> Array:
    return 0.5 * matrix + 0.5 * matrix.T


def _symmetric(matrix: ArrayLike, what: str) -> Array:
    array = np.asarray(matrix, float)
    array = checked_matrix(array, what, len(array) if array.ndim else 1)
    if skew := numerics.asymmetry(array):
        raise InputError(
            f"{what} is not symmetric",
            expected="its symmetric part",
            got=f"|A - A^T| up to {skew:.3g}",
        )
    return _symmetrised(array)


def _ratios(ratios: float | Sequence[float], n: int) -> Array:
    values = checked_array(
        np.atleast_1d(np.asarray(ratios, float)), ("m",), "damping ratios"
    )
    if values.size not in (1, n) or (values < 0.0).any():
        raise InputError(
            "damping ratios cannot be used",
            expected=f"1 or {n} numbers from zero",
            got=values.tolist(),
        )
    return np.broadcast_to(values, (n,))


_PRINTED = [
    "stiffness",
    "damping",
    "by_square_roots",
    "mass",
    "frequencies",
    "joint_stiffness",
    "joint_damping",
    "null_motions",
    "null_masses",
]


@dataclass(frozen=True, eq=False, repr=False)
class Impedance(Result, LabelledResult):
    """A controller's stiffness and damping at a posture.

    Attributes
    ----------
    stiffness, damping : ndarray (6, 6)
        At M, axes of M, order angular-linear; the damping in N m s/rad, N s and N s/m.
    by_square_roots : ndarray (6, 6)
        Damping [N m s/rad, N s, N s/m] of the square-root rule, applied in metres.
    ratios : ndarray (6,)
        Damping ratios of the square-root rule: the diagonal of its damping in the basis
        of the double diagonalisation, over ``2 omega``; NaN for motions without
        stiffness.
    coupling : float
        Largest entry of that damping off the diagonal, as a share of the largest entry.
    mass : ndarray (6, 6)
        Operational-space mass at M [kg m^2, kg m, kg].
    frequencies : ndarray (6,)
        Frequencies in Hz of the closed loop without damping.
    joint_stiffness, joint_damping : ndarray (n, n)
        Stiffness ``J^T K J`` and damping ``J^T D J`` of the joints, that times s.
    null_motions : ndarray (n - 6, n)
        Motions of the joints, of unit size, that do not move M and get neither stiffness
        nor damping from the controller.
    null_masses : ndarray (n - 6,)
        ``z^T M z`` of each, in units of the joints' stiffness times s^2: with a stiffness
        k of its own, ``2 zeta sqrt(k m)`` damps it.
    modes : Modes
        Modes at the posture.
    dropped : float
        Largest entry of the antisymmetric part of the required stiffness, which no
        impedance controller can realise, over its largest entry.
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
    null_motions: Array
    null_masses: Array
    modes: Modes
    dropped: float

    def to_dict(self) -> dict[str, Any]:
        """Plain data, along the axes of M."""
        return {
            "order": "angular-linear",
            "axes": "body",
            **{key: plain(getattr(self, key)) for key in _PRINTED},
            "ratios_by_square_roots": plain(self.ratios),
            "coupling_by_square_roots": self.coupling,
            "antisymmetric_part_dropped": self.dropped,
        }

    def plot(self, ax: Any = None) -> Any:
        """Draw the stiffness and the damping that each joint gets on its own.

        Parameters
        ----------
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
        elastic = self.modes.elastic
        figure, names = (
            new_figure(8.0, doubt=elastic.springs_in_doubt, ax=ax),
            elastic.names,
        )
        what = {"stiffness": self.joint_stiffness, "damping": self.joint_damping}
        for axis, (word, matrix) in zip(figure.subplots(1, 2), what.items(), strict=True):
            draw_bars(axis, names, matrix.diagonal(), f"{word} of the joint")
        return figure

    def for_controller(
        self, order: Order = "linear-angular", axes: Axes = "base"
    ) -> dict[str, Any]:
        """Return stiffness and damping (6, 6) about M's origin,
        in an order and along axes.

        Parameters
        ----------
        order : {"linear-angular", "angular-linear"}
            Order of rows and columns.
        axes : {"base", "body", "world"}
            Axes of the robot's own base B, of M, or of the room F.

        Returns
        -------
        dict
            "order", "axes", "about" (M's origin, by the name of its frame), "stiffness",
            "damping".
        """
        mechanism = self.modes.elastic.mechanism
        pose, base = self.modes.posture.pose, mechanism.base_pose
        free, none = NAMED["B"], np.zeros(6)
        matrices = {
            name: StiffnessTensor(getattr(self, name), free, none, pose, base=base)
            .as_controller(order=order, axes=axes)
            .tolist()
            for name in ("stiffness", "damping")
        }
        return {"order": order, "axes": axes, "about": mechanism.frame, **matrices}


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


def impedance(
    modes: Modes,
    wanted: StiffnessTensor | ArrayLike,
    ratios: float | Sequence[float] = 0.7,
) -> Impedance:
    """Damping and joint-space gains for a required stiffness at M.

    Parameters
    ----------
    modes : Modes
        Modes of the arm at the posture; only its masses are used.
    wanted : StiffnessTensor or array_like (6, 6)
        A tensor at M (see `StiffnessTensor.from_controller`), or a stiffness in the axes
        of M, order angular-linear. Only the symmetric part is used.
    ratios : float or sequence of float, shape (6,)
        Damping ratios of the six oscillators, softest first; default 0.7.

    Raises
    ------
    UndefinedError
        If M cannot move in every direction, or a motion has no mass.
    InputError
        For a stiffness that is not positive semidefinite.
    """
    mass = mass_at_tip(modes)
    if mass is None:
        raise UndefinedError(
            "the masses as the body feels them do not exist here: it cannot move in "
            "every "
            "direction, or a motion has no mass",
            code="no-mass",
        )
    if isinstance(wanted, StiffnessTensor):
        wanted = wanted.to_order("angular-linear").matrix
    whole = checked_matrix(wanted, "stiffness wanted")
    K = _symmetrised(whole)
    dropped = float(
        np.abs(whole - K).max() / max(float(np.abs(whole).max()), numerics.TINY)
    )
    units = modes.elastic.units
    # Of the same units as the stiffness: force, length and second.
    inertia = units.kilogram * mass
    D, V, squares = double_diagonalisation(inertia, K, ratios)
    zeta = float(np.mean(_ratios(ratios, 6)))
    # The square roots depend on the unit of length: controllers have metres.
    metres = np.repeat([1.0, convert_length(SI, units)[0]], 3)
    scale = np.outer(metres, metres)
    other = square_root_damping(scale * inertia, scale * K, zeta) / scale
    projected = V.T @ other @ V
    beside = projected - np.diag(np.diag(projected))
    with numerics.silent():
        achieved = np.where(
            squares > 0.0, np.diag(projected) / (2 * np.sqrt(squares)), np.nan
        )
    size = numerics.largest(projected)
    J = modes.posture.motion.jacobian
    # J has rank 6 here; otherwise there is no operational-space mass.
    is_open = modes.posture.closure is None
    null = np.linalg.svd(J)[2][6:] if is_open else np.zeros((0, J.shape[1]))
    if len(null):
        null_masses = units.kilogram * np.einsum(
            "ki,ij,kj->k", null, modes.full_mass, null
        )
    else:
        null_masses = np.zeros(0)
    return Impedance(
        K,
        D,
        other,
        achieved,
        float(np.abs(beside).max()) / size if size else 0.0,
        mass,
        np.sqrt(squares) / (2 * np.pi),
        J.T @ K @ J,
        J.T @ D @ J,
        null,
        null_masses,
        modes,
        dropped,
    )
