"""Connections that are made from a bilinear map or a metric."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from cartstiff.core import numerics
from cartstiff.core.arrays import Array, checked_array, checked_matrix
from cartstiff.core.checked_call import checked
from cartstiff.core.errors import InputError
from cartstiff.core.geometry import se3
from cartstiff.core.geometry.connections import Connection, from_symbols

# Linearity is judged at twists of these sizes; maps that were found by differences of
# numbers keep half of their digits.
_TESTED_SIZES, _BILINEARITY = (1.0, 1e-3, 1e3, 7.0), numerics.NEGLIGIBLE_SHARE


@checked
def from_bilinear_map(
    nabla: Callable[[Array, Array], ArrayLike], name: str = "user", *, meaning: str = ""
) -> Connection:
    """Connection from a function ``nabla(x, y)`` on twists that is linear in both
    arguments.

    `meaning` is one line for people. The function is compared with the array of its
    values on the basis at other twists.

    Raises
    ------
    InputError
        If it is not linear in both arguments.
    """
    basis = np.eye(6)
    symbols = np.array(
        [[checked_array(nabla(x, y), (6,), "nabla(x, y)") for x in basis] for y in basis]
    )
    connection = from_symbols(symbols, name, meaning=meaning)
    rng = np.random.default_rng(0)
    for size in _TESTED_SIZES:
        x, y = size * rng.normal(size=(2, 6))
        got, expected = checked_array(nabla(x, y), (6,), "nabla(x, y)"), connection(x, y)
        terms = np.einsum("jik,i,j->", np.abs(symbols), np.abs(x), np.abs(y))
        if np.abs(got - expected).max() > _BILINEARITY * max(
            float(terms), float(np.abs(got).max())
        ):
            i = int(np.abs(got - expected).argmax())
            raise InputError(
                "nabla(x, y) is not linear in both x and y",
                where=f"connection {name!r}",
                expected=f"component {i + 1} at x = {_listed(x)}, y = {_listed(y)} as "
                "its values "
                f"on the basis make it, {expected[i]:.6g}",
                got=f"{got[i]:.6g}",
            )
    return connection


def _listed(x: Array) -> str:
    return "(" + ", ".join(f"{value:.4g}" for value in x) + ")"


@checked
def levi_civita(metric: ArrayLike, name: str = "Levi-Civita") -> Connection:
    r"""Levi-Civita connection of a left-invariant metric on SE(3).

    From the Koszul formula on left-invariant fields, with <.,.> the metric:
    2 <nabla_X Y, Z> = <[X, Y], Z> - <[Y, Z], X> + <[Z, X], Y>  [doCarmo]_.

    Parameters
    ----------
    metric : array_like, shape (6, 6)
        Symmetric positive definite matrix on twists (omega, v).
    name : str
        For people.

    Raises
    ------
    InputError
        If the matrix is not symmetric positive definite.
    """
    g = checked_matrix(metric, "metric")
    if np.abs(g - g.T).max() > numerics.ROUNDOFF * np.abs(g).max():
        raise InputError(
            "metric is not symmetric", got=f"asymmetry {np.abs(g - g.T).max():.3g}"
        )
    eigenvalues = np.linalg.eigvalsh(g)
    if eigenvalues[0] <= 0:
        raise InputError(
            "metric is not positive definite",
            got=f"smallest eigenvalue {eigenvalues[0]:.3g}",
        )
    c = se3.STRUCTURE_CONSTANTS @ g  # c[i, j, k] = <[L_i, L_j], L_k>
    koszul = c - np.einsum("jki->ijk", c) + np.einsum("kij->ijk", c)
    nabla = 0.5 * koszul @ np.linalg.inv(g)  # nabla[i, j] = nabla_{L_i} L_j
    return from_symbols(np.swapaxes(nabla, 0, 1), name, meaning="Levi-Civita of a metric")
