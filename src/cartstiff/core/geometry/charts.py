r"""Coordinate charts of SE(3) and the change between coordinate fields and
left-invariant fields.

A chart maps coordinates xi (6,) to a pose. Its *basis matrix* gamma writes the coordinate
fields E_i = d/dxi_i on the left-invariant basis, E_i = sum_j gamma[j, i] L_j ([ZK]_ eq.
44): it is the body Jacobian of the map. Where it is singular, `UndefinedError` is raised.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from cartstiff.core import numerics
from cartstiff.core.arrays import Array, is_pose, real_array
from cartstiff.core.errors import ConvergenceError, InputError, UndefinedError
from cartstiff.core.geometry import se3
from cartstiff.core.geometry.connections import Connection, flat
from cartstiff.core.geometry.differences import jacobian

# A chart is singular where the basis matrix has lost ten digits: results have six digits
# at best.
_SINGULAR = numerics.RANK


@dataclass(frozen=True)
class Chart:
    """Six coordinates for poses, with first and second derivatives.

    Attributes
    ----------
    name : str
        For messages.
    pose : callable
        ``pose(xi)`` returns the 4x4 pose.
    basis : callable
        ``basis(xi)[j, i]``: E_i = sum_j basis[j, i] L_j.
    basis_derivative : callable
        ``basis_derivative(xi)[j, i, l]``: derivative of ``basis[j, i]`` along xi_l.
    singular_where : str
        The singular set, for messages.
    """

    name: str
    pose: Callable[[Array], Array]
    basis: Callable[[Array], Array]
    basis_derivative: Callable[[Array], Array]
    singular_where: str = "its basis matrix loses rank"

    def inverse_basis(self, xi: ArrayLike) -> Array:
        """Matrix alpha = gamma^-1: L_i = sum_j alpha[j, i] E_j, [ZK]_ eq. 45.

        Raises
        ------
        UndefinedError
            At a singularity of the chart, with the coordinates and the singular values.
        """
        xi = real_array(xi)
        gamma = self.basis(xi)
        values = np.linalg.svd(gamma, compute_uv=False)
        if values[-1] <= _SINGULAR * values[0]:
            raise UndefinedError(
                f"chart {self.name!r} is singular at these coordinates "
                f"({self.singular_where}): "
                f"smallest over largest singular value {values[-1] / values[0]:.3g}",
                code="singular-chart",
                values={"coordinates": xi.tolist(), "singular_values": values.tolist()},
            )
        return np.linalg.inv(gamma)

    def to_twist(self, xi: ArrayLike, rates: ArrayLike) -> Array:
        """Body twist of coordinate rates: gamma @ rates."""
        return self.basis(real_array(xi)) @ real_array(rates)

    def to_wrench(self, xi: ArrayLike, force: ArrayLike) -> Array:
        """Wrench components of the one-form ``F_i d xi_i``: alpha^T @ F, [ZK]_ eq.
        16 and 18.
        """
        return self.inverse_basis(xi).T @ real_array(force)

    def to_form(self, xi: ArrayLike, wrench: ArrayLike) -> Array:
        """Components on ``d xi`` of a wrench: gamma^T @ W; inverse of `to_wrench`."""
        return self.basis(real_array(xi)).T @ real_array(wrench)

    def connection(self, xi: ArrayLike) -> Connection:
        """The chart's flat connection at a posture, [ZK]_ eq. 47."""
        self.inverse_basis(xi)
        xi = real_array(xi)
        return flat(self.basis(xi), self.basis_derivative(xi), name=f"flat ({self.name})")

    def stiffness_terms(
        self, xi: ArrayLike, gradient: ArrayLike, hessian: ArrayLike
    ) -> tuple[Array, Array, Array]:
        """Wrench, K_I and K_II of a potential, from its derivatives in these coordinates.

        ``K[i, j] = alpha_j^l alpha_i^k Phi_kl + alpha_j^l (d alpha_i^k / d xi_l) Phi_k
        - Gamma[i, j, k] W_k``: the first term is K_I, the second K_II ([ZK]_ eq. 52, here
        at any pose); K^A = K_I + K_II.
        """
        xi = real_array(xi)
        alpha = self.inverse_basis(xi)
        wrench = alpha.T @ real_array(gradient)
        first = alpha.T @ real_array(hessian) @ alpha
        d_basis = self.basis_derivative(xi)
        second = -np.einsum(
            "k,kml,mi,lj->ij", wrench, d_basis, alpha, alpha, optimize=True
        )
        return wrench, first, second

    def coordinates(self, T: ArrayLike, start: ArrayLike | None = None) -> Array:
        """Coordinates of a pose by Newton's method from `start` (default zero).

        Raises
        ------
        ConvergenceError
            If 50 steps do not reach the pose.
        """
        T = real_array(T)
        xi = np.zeros(6) if start is None else np.array(start, float)
        for _ in range(50):
            error = se3.log(se3.inverse(self.pose(xi)) @ T)
            size = numerics.norm(error)
            if size < numerics.ROUNDOFF_OF_SUMS * (1 + np.linalg.norm(xi)):
                return xi
            step = self.inverse_basis(xi) @ error
            xi = xi + step / max(1.0, float(np.abs(step[:3]).max()))
        if size < numerics.STALLED_RESIDUAL * (1 + np.linalg.norm(xi)):
            return xi
        raise ConvergenceError(
            f"no coordinates found in chart {self.name!r}", iterations=50, residual=size
        )


def product_of_exponentials(
    screws: ArrayLike, name: str, singular_where: str = ""
) -> Chart:
    """Chart ``pose(xi) = exp(s_1 xi_1) ... exp(s_6 xi_6)`` with the columns s_i
    of `screws`.

    Its second derivatives are brackets: d gamma_a / d xi_b = [gamma_a, gamma_b] for b
    after a.
    """
    S = np.array(screws, float)
    if S.shape != (6, 6):
        raise InputError("screws have the wrong shape", expected="(6, 6)", got=S.shape)

    def pose(xi: Array) -> Array:
        T = np.eye(4)
        for s, x in zip(S.T, xi, strict=True):
            T = T @ se3.exp(s * x)
        return T

    def basis(xi: Array) -> Array:
        gamma = np.empty((6, 6))
        after = np.eye(4)
        for a in range(5, -1, -1):
            gamma[:, a] = se3.adjoint(se3.inverse(after)) @ S[:, a]
            after = se3.exp(S[:, a] * xi[a]) @ after
        return gamma

    def basis_derivative(xi: Array) -> Array:
        gamma = basis(xi)
        d = np.zeros((6, 6, 6))
        for a in range(6):
            for b in range(a + 1, 6):
                d[:, a, b] = se3.bracket(gamma[:, a], gamma[:, b])
        return d

    return Chart(
        name, pose, basis, basis_derivative, singular_where or Chart.singular_where
    )


#: The chart of [ZK]_ section 2.4: Rot(x) Rot(y) Rot(z) Trans(x) Trans(y) Trans(z).
paper = product_of_exponentials(np.eye(6), "Rx Ry Rz Tx Ty Tz", "cos(xi_2) = 0")


def _exponential_derivative(xi: Array) -> Array:
    return jacobian(lambda d: se3.right_jacobian(xi + d), np.ones(6))


#: Canonical coordinates of the first kind: pose(xi) = exp(xi).
exponential = Chart(
    "exponential",
    se3.exp,
    se3.right_jacobian,
    _exponential_derivative,
    "rotation angle 2 pi",
)


def from_pose_function(pose: Callable[[Array], ArrayLike], name: str = "user") -> Chart:
    """Chart from a function of coordinates xi (6,), in any unit, that returns a pose (4,
    4).

    Its derivatives are taken by eighth-order differences.

    Raises
    ------
    InputError
        When the chart is used, for a result that is no rigid motion.
    """

    def pose_of(xi: Array) -> Array:
        return np.asarray(pose(real_array(xi)), float)

    def basis(xi: Array) -> Array:
        xi = real_array(xi)
        T = pose_of(xi)
        if not is_pose(T):
            raise InputError(
                f"chart {name!r} does not return a rigid motion", got=T.tolist()
            )
        dT = jacobian(lambda d: pose_of(xi + d), np.ones(6))
        return np.stack([se3.vee(se3.inverse(T) @ dT[..., i]) for i in range(6)], axis=-1)

    def basis_derivative(xi: Array) -> Array:
        xi = real_array(xi)
        return jacobian(lambda d: basis(xi + d), np.ones(6))

    return Chart(name, pose_of, basis, basis_derivative)
