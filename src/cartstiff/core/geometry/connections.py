r"""Affine connections on SE(3) as values.

A connection says how vectors at neighbouring poses are compared. In the basis of
left-invariant vector fields it is a bilinear map on twists, held as one (6, 6, 6) array
of Christoffel symbols

    nabla_{L_i} L_j = sum_k Gamma[j, i, k] L_k                              ([ZK]_ eq. 27)

and enters the stiffness matrix through the wrench alone ([ZK]_ eq. 33):

    K[i, j] = L_j L_i Phi - sum_k Gamma[i, j, k] W_k
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from cartstiff.core import numerics
from cartstiff.core.arrays import Array, checked_array, checked_matrix, real_array
from cartstiff.core.checked_call import checked
from cartstiff.core.errors import InputError, UndefinedError, UnknownNameError
from cartstiff.core.geometry import se3
from cartstiff.core.geometry.differences import STEP, derivative
from cartstiff.core.matrix_names import MATRICES

# Laws are judged on the symbols' own scale; 1e-12 leaves four digits for rounding.
_LAW_TOLERANCE = numerics.ROUNDOFF


@dataclass(frozen=True, eq=False)
class Connection:
    """An affine connection, by its Christoffel symbols on the left-invariant basis.

    Attributes
    ----------
    name : str
        Short name ("A", "B", "K", "+", "F", or the user's).
    symbols : ndarray, shape (6, 6, 6)
        ``symbols[j, i, k]`` is the k-th component of ``nabla_{L_i} L_j``; [ZK]_ eq. 27.
        Read-only.
    meaning : str
        One line for people.
    left_invariant : bool
        Whether the symbols are the same at every pose. Those of a chart's flat connection
        are known at one posture only.
    tied_to_origin : bool
        Whether the same name means another connection for another body frame: the
        kinematic connection is that of the kinetic energy of a ball centred at the
        frame's origin.

    Raises
    ------
    InputError
        If the symbols have another shape or are not finite.
    """

    name: str
    symbols: Array
    meaning: str = ""
    left_invariant: bool = True
    tied_to_origin: bool = False
    _flat: bool = field(default=False, repr=False)

    def __post_init__(self) -> None:
        symbols = checked_array(self.symbols, (6, 6, 6), "array of Christoffel symbols")
        symbols.flags.writeable = False
        object.__setattr__(self, "symbols", symbols)

    def __str__(self) -> str:
        return f"{self.name}: {self.meaning}" if self.meaning else self.name

    def __call__(self, x: ArrayLike, y: ArrayLike) -> Array:
        """``nabla_X Y`` for left-invariant X, Y given by their twists."""
        x, y = checked_array(x, (6,), "X"), checked_array(y, (6,), "Y")
        return np.einsum("jik,i,j->k", self.symbols, x, y)

    def wrench_term(self, wrench: ArrayLike) -> Array:
        """Matrix (..., 6, 6) ``T[i, j] = sum_k Gamma[i, j, k] W_k``, of wrenches (...,
        6): K = K^A - T.

        Raises
        ------
        InputError
            For another shape.
        """
        w = real_array(wrench)
        if w.shape[-1:] != (6,):
            raise InputError("wrench has another shape", expected="(..., 6)", got=w.shape)
        return (w @ self._symbols_by_wrench).reshape(*w.shape[:-1], 6, 6)

    @cached_property
    def _symbols_by_wrench(self) -> Array:
        return np.ascontiguousarray(self.symbols.reshape(36, 6).T)

    @cached_property
    def torsion(self) -> Array:
        """Torsion (6, 6, 6): nabla_{L_i} L_j - nabla_{L_j} L_i - [L_i, L_j] = sum_k T[i,
        j, k] L_k.
        """
        g = self.symbols
        return np.swapaxes(g, 0, 1) - g - se3.STRUCTURE_CONSTANTS

    @cached_property
    def curvature(self) -> Array:
        """Curvature (6, 6, 6, 6) ``R[i, j, l, k]``: (nabla_i nabla_j - nabla_j nabla_i -
        nabla_[i,j]) L_l.

        For a left-invariant connection from the symbols; zero for the flat connection of
        a chart.

        Raises
        ------
        UndefinedError
            If the symbols are known at one pose only and the connection is not flat by
            construction.
        """
        if self._flat:
            return np.zeros((6, 6, 6, 6))
        if not self.left_invariant:
            raise UndefinedError(
                "curvature needs the symbols in a neighbourhood, not at one pose",
                code="curvature-unknown",
            )
        g = np.swapaxes(self.symbols, 0, 1)  # g[i, l, k]: nabla_i L_l
        twice = np.einsum("jlm,imk->ijlk", g, g)
        along = np.einsum("ijm,mlk->ijlk", se3.STRUCTURE_CONSTANTS, g)
        return twice - np.swapaxes(twice, 0, 1) - along

    @cached_property
    def is_symmetric(self) -> bool:
        """Whether the torsion vanishes.

        Then the stiffness is symmetric, [ZK]_ prop. 4.1.
        """
        return self._vanishes(self.torsion)

    @cached_property
    def is_flat(self) -> bool:
        """Whether the curvature vanishes."""
        return self._vanishes(self.curvature)

    @cached_property
    def is_bi_invariant(self) -> bool:
        """Whether the connection is independent of the body frame too:
        Ad-equivariant symbols.

        Judged on generators: ad_z (nabla_x y) = nabla_{ad_z x} y + nabla_x (ad_z y) for
        all z.
        """
        if not self.left_invariant:
            return False
        g = np.swapaxes(self.symbols, 0, 1)
        c = se3.STRUCTURE_CONSTANTS
        left = np.einsum("ijk,zkm->zijm", g, c)
        right = np.einsum("zik,kjm->zijm", c, g) + np.einsum("zjk,ikm->zijm", c, g)
        return self._vanishes(left - right)

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON; a named connection is its name, any other its symbols."""
        named = NAMED.get(self.name) is self
        return {
            "name": self.name,
            "symbols": None if named else self.symbols.tolist(),
            "meaning": self.meaning,
            "left_invariant": self.left_invariant,
            "flat": self._flat,
        }

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Connection:
        """Inverse of `to_dict`.

        Raises
        ------
        InputError
            For `data` that `to_dict` did not make, or an unknown name.
        """
        keys = {"name", "symbols", "meaning", "left_invariant", "flat"}
        if not isinstance(data, Mapping) or not data.keys() >= keys:
            raise InputError(
                "no data of a connection", expected="what to_dict makes", got=data
            )
        if data["symbols"] is None:
            if data["name"] not in NAMED:
                raise UnknownNameError("connection", data["name"], list(NAMED))
            return NAMED[data["name"]]
        return cls(
            data["name"],
            np.array(data["symbols"], float),
            data["meaning"],
            data["left_invariant"],
            _flat=data["flat"],
        )

    def _vanishes(self, tensor: Array) -> bool:
        scale = 1.0 + float(np.abs(self.symbols).max())
        return bool(np.abs(tensor).max() <= _LAW_TOLERANCE * scale * scale)

    def carried_to(self, T_m_n: ArrayLike) -> Connection:
        """The same connection, its symbols in the basis of body frame N, given ``T_m_n``.

        ``symbols'[j, i] = Ad^-1 nabla_{Ad L_i} (Ad L_j)``; a bi-invariant connection
        keeps its symbols.

        Raises
        ------
        InputError
            For a pose of another shape.
        """
        T_m_n = checked_array(T_m_n, (4, 4), "pose")
        a = se3.adjoint(T_m_n)
        b = se3.adjoint(se3.inverse(T_m_n))
        symbols = np.einsum("jik,jq,ip,mk->qpm", self.symbols, a, a, b, optimize=True)
        return Connection(
            self.name,
            symbols,
            meaning=self.meaning,
            left_invariant=self.left_invariant,
            _flat=self._flat,
        )


@checked
def from_symbols(
    symbols: ArrayLike,
    name: str = "user",
    *,
    meaning: str = "",
    left_invariant: bool = True,
) -> Connection:
    """Connection from any array (6, 6, 6) ``symbols[j, i, k]``, the k-th component of
    nabla_{L_i} L_j.

    Its `meaning` is one line for people; `left_invariant` says whether the symbols are
    the same at every pose.

    Raises
    ------
    InputError
        If the symbols have another shape or are not finite.
    """
    return Connection(name, real_array(symbols), meaning, left_invariant)


def flat(
    jacobian: ArrayLike, jacobian_derivative: ArrayLike, name: str = "F"
) -> Connection:
    r"""Flat connection of coordinates xi, seen on the left-invariant basis at
    one posture.

    ``Gamma[i, j, k] = sum alpha_j^l (d alpha_i^m / d xi^l) gamma_m^k`` with gamma the
    Jacobian, E_i = gamma_i^j L_j, and alpha its inverse; [ZK]_ eq. 47.

    Parameters
    ----------
    jacobian : array_like, shape (6, 6)
        Body Jacobian ``J[k, m]``: twist = J @ xi_dot.
    jacobian_derivative : array_like, shape (6, 6, 6)
        ``dJ[k, m, l]`` = d J[k, m] / d xi_l.
    name : str
        For people.

    Raises
    ------
    UndefinedError
        If the Jacobian is singular: the coordinates are no chart there.
    """
    J = checked_matrix(jacobian, "Jacobian", 6)
    dJ = checked_array(jacobian_derivative, (6, 6, 6), "derivative of the Jacobian")
    singular_values = np.linalg.svd(J, compute_uv=False)
    if singular_values[-1] <= numerics.ZERO_SHARE * singular_values[0]:
        raise UndefinedError(
            "the coordinates are no chart of SE(3) here: their Jacobian is singular",
            code="singular",
            values={"singular_values": singular_values.tolist()},
        )
    A = np.linalg.inv(J)
    # d alpha = -A dJ A, so alpha_i^m,l gamma_m^k = -(dJ A)[k, i, l].
    symbols = -np.einsum("kml,mi,lj->ijk", dJ, A, A, optimize=True)
    return Connection(
        name,
        symbols,
        "Hessian in the coordinates themselves",
        left_invariant=False,
        _flat=True,
    )


#: Symbols of ``nabla_X Y = [X, Y]``.
_BRACKET = np.swapaxes(se3.STRUCTURE_CONSTANTS, 0, 1)


def turning_symbols(share: float) -> Array:
    """Symbols of ``nabla_X Y = (share w1 x w2, w1 x v2)``."""
    shares = np.zeros((6, 6, 1))
    shares[:3, :3], shares[3:, :3] = share, 1.0
    return shares * _BRACKET


#: Cartan's (-) connection, nabla = 0: [ZK]_ eq. 35 and 36.
CARTAN_MINUS = Connection("A", np.zeros((6, 6, 6)), MATRICES["A"].meaning)
#: Cartan's (0) connection, nabla_X Y = [X, Y] / 2: [ZK]_ eq. 40.
BI_INVARIANT = Connection("B", 0.5 * _BRACKET, MATRICES["B"].meaning)
#: Levi-Civita connection of a ball's kinetic energy (equal moments of inertia): [ZK]_ eq.
#: 38.
KINEMATIC = Connection(
    "K",
    turning_symbols(0.5),
    MATRICES["K"].meaning,
    tied_to_origin=True,
)
#: Cartan's (+) connection, nabla_X Y = [X, Y]; its stiffness is the transpose of K^A.
CARTAN_PLUS = Connection("+", _BRACKET, MATRICES["+"].meaning)

#: The named left-invariant connections.
NAMED = {c.name: c for c in (CARTAN_MINUS, BI_INVARIANT, KINEMATIC, CARTAN_PLUS)}


@dataclass(frozen=True)
class Field:
    """A vector field (or one-form) on SE(3) by its components on the
    left-invariant basis.

    Parameters
    ----------
    components : callable
        ``components(T)`` returns the 6 components at pose ``T`` (4, 4).
    derivative : callable, optional
        ``derivative(T)[k, i]`` is the derivative of component k along L_i. Without it, an
        eighth-order central difference is taken, good to about 1e-12 of the components'
        scale.
    """

    components: Callable[[Array], ArrayLike]
    derivative: Callable[[Array], ArrayLike] | None = None

    @classmethod
    def left_invariant(cls, twist: ArrayLike) -> Field:
        """The field whose components are the same everywhere."""
        value = np.array(twist, float)
        return cls(lambda _: value, lambda _: np.zeros((6, 6)))

    def at(self, T: ArrayLike) -> Array:
        """Components at a pose."""
        return np.asarray(self.components(real_array(T)), float)

    def along(self, T: ArrayLike, twist: ArrayLike) -> Array:
        """Derivative of the components along a body twist at a pose."""
        T, twist = real_array(T), real_array(twist)
        if self.derivative is not None:
            return np.asarray(self.derivative(T), float) @ twist
        step = STEP / max(1.0, numerics.norm(twist))
        return derivative(lambda t: self.at(T @ se3.exp(t * twist)), step)
