"""Stiffness matrices of finite-element programs, reduced to the spring of a link."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from cartstiff import numerics
from cartstiff.arrays import checked_array
from cartstiff.choices import ORDERS, Order
from cartstiff.errors import InputError
from cartstiff.geometry import se3
from cartstiff.geometry.se3 import Array

__all__ = ["superelement_spring"]


def superelement_spring(
    stiffness: ArrayLike,
    nodes: ArrayLike,
    *,
    base: int = 0,
    tip: int = -1,
    order: Order = "linear-angular",
) -> Array:
    r"""Stiffness at one node of a superelement that is clamped at another, the others left free.

    With the clamped node's rows and columns struck out, and r all but the tip t:
    :math:`K_{tt} - K_{tr} K_{rr}^{-1} K_{rt}`. In a mechanism file it is the ``stiffness`` of a
    link under ``flexible``, with the tip as ``offset`` if the link's frame stands at the base.

    Parameters
    ----------
    stiffness : array_like, shape (6 N, 6 N)
        Of the free body: six rows a node, forces per displacement, as finite-element programs write
        it after a reduction to N nodes with six freedoms each.
    nodes : array_like, shape (N, 3)
        Where the nodes are, in the same axes and unit of length.
    base, tip : int
        Index of the node that is fixed to the link's near side, and of the one that carries what
        is beyond; from 0, negative ones from the end.
    order : {"linear-angular", "angular-linear"}
        Of a node's six rows.

    Returns
    -------
    ndarray, shape (6, 6)
        Symmetric, order angular-linear, about the tip, in the axes of the nodes.

    Raises
    ------
    InputError
        If the matrix is not symmetric, if it resists the body's motion as a whole (a unit or the
        order of the rows is another one, or the body is held somewhere), or if what is free besides
        the tip can move by itself.
    """
    points = checked_array(nodes, ("nodes", 3), "nodes")
    n = len(points)
    K = checked_array(stiffness, (6 * n, 6 * n), "stiffness of the superelement")
    if order not in ORDERS:
        raise InputError("unknown order", expected="linear-angular or angular-linear", got=order)
    for name, index in (("base", base), ("tip", tip)):
        if not -n <= index < n:
            raise InputError(f"no such node: {name}", expected=f"{-n} to {n - 1}", got=index)
    base, tip = base % n, tip % n
    if base == tip:
        raise InputError("base and tip are the same node", got=base)
    if order == "linear-angular":
        swap = (6 * np.arange(n)[:, None] + se3.SWAP).ravel()
        K = K[np.ix_(swap, swap)]
    size = np.sqrt(np.abs(np.diagonal(K)))
    if np.any(np.abs(K - K.T) > numerics.LOST * np.outer(size, size)):
        raise InputError("stiffness of a superelement must be symmetric")
    K = 0.5 * (K + K.T)
    rigid = np.concatenate(
        [np.block([[np.eye(3), np.zeros((3, 3))], [-se3.skew(p), np.eye(3)]]) for p in points]
    )
    left, terms = np.abs(K @ rigid), np.abs(K) @ np.abs(rigid)
    worst = float(np.max(left / np.where(terms > 0.0, terms, 1.0)))
    if worst > numerics.LOST:
        raise InputError(
            "the superelement resists a motion as a whole: the nodes' unit or the order of the "
            "rows is another one, or it is held somewhere",
            expected=f"forces below {numerics.LOST:g} of their terms", got=f"{worst:.2g}",
        )  # fmt: skip
    t = np.arange(6 * tip, 6 * tip + 6)
    r = np.setdiff1d(np.arange(6 * n), [*t, *range(6 * base, 6 * base + 6)])
    spring = K[np.ix_(t, t)]
    if r.size:
        inverse = numerics.invert(K[np.ix_(r, r)])
        if inverse is None:
            raise InputError("nodes between base and tip can move without a force",
                             got="a singular matrix of their freedoms")  # fmt: skip
        spring = spring - K[np.ix_(t, r)] @ inverse.matrix @ K[np.ix_(r, t)]
    return 0.5 * (spring + spring.T)
