"""Stiffness and mass matrices of finite-element programs, reduced to one compliant link."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from cartstiff import numerics
from cartstiff.arrays import checked_array
from cartstiff.choices import ORDERS, Order
from cartstiff.errors import InputError
from cartstiff.geometry import se3
from cartstiff.geometry.se3 import Array


@dataclass(frozen=True, eq=False)
class SuperelementMass:
    r"""Mass of a link as one rigid body that follows a share of the link's deflection.

    With V the twist of the link's near side, u the tip's twist against it, both about the tip, the
    kinetic energy is :math:`\tfrac12 (V + W u)^T I (V + W u) + \tfrac12 |R u|^2`.

    Attributes
    ----------
    mass : float
        Mass of all nodes, kg.
    centre : ndarray, shape (3,)
        Mass centre from the tip, in the axes of the nodes.
    inertia : ndarray, shape (3, 3)
        About the mass centre.
    share : ndarray, shape (6, 6)
        W, order angular-linear.
    rest : ndarray, shape (6, 6)
        R: the energy that no rigid body has, as of a bar that bends between fixed ends.
    """

    mass: float
    centre: Array
    inertia: Array
    share: Array
    rest: Array


def superelement_spring(
    stiffness: ArrayLike,
    nodes: ArrayLike,
    *,
    base: int = 0,
    tip: int = -1,
    order: Order = "linear-angular",
) -> Array:
    r"""Return the stiffness at one node of a superelement clamped at another, with free others.

    Without the clamped node's rows and columns, and with r all rows but those of the tip t, it is
    :math:`K_{tt} - K_{tr} K_{rr}^{-1} K_{rt}`. In a mechanism file it is the ``stiffness`` of a
    link under ``flexible``, with the tip as ``offset`` if the link's frame is at the base.

    Parameters
    ----------
    stiffness : array_like, shape (6 N, 6 N)
        Stiffness of the free body: six rows a node, forces per displacement, as finite-element
        programs write it after a reduction to N nodes with six freedoms each.
    nodes : array_like, shape (N, 3)
        Positions of the nodes, in the same axes and unit of length.
    base, tip : int
        Index of the node that is fixed to the link's near side, and of the one that carries what
        is beyond; from 0, negative ones from the end.
    order : {"linear-angular", "angular-linear"}
        Order of a node's six rows.

    Returns
    -------
    ndarray, shape (6, 6)
        Symmetric, order angular-linear, about the tip, in the axes of the nodes.

    Raises
    ------
    InputError
        If the matrix is not symmetric, if it resists the body's motion as a whole (a unit or the
        order of the rows is another one, or the body is held somewhere), or if the other free nodes
        can move without a force, or their inverse has fewer than four digits.
    """
    K, _, parts = _sorted(stiffness, nodes, base, tip, order)
    to_tip = _static_modes(K, parts)
    spring = K[parts.tip] @ to_tip
    return np.asarray(0.5 * (spring + spring.T))


def superelement_mass(
    mass: ArrayLike,
    stiffness: ArrayLike,
    nodes: ArrayLike,
    *,
    base: int = 0,
    tip: int = -1,
    order: Order = "linear-angular",
) -> SuperelementMass:
    r"""Return the mass of a superelement whose other nodes follow its base and tip statically.

    Guyan's reduction: with the motions :math:`\Phi` of the body as a whole and the static ones
    :math:`\Psi` of all nodes when the tip moves by 1 and the base rests,
    :math:`I = \Phi^T M \Phi`, :math:`W = I^{-1} \Phi^T M \Psi` and
    :math:`R^T R = \Psi^T M \Psi - W^T I W`. The weight of small deflections is exact at the tip.

    Parameters
    ----------
    mass : array_like, shape (6 N, 6 N)
        Consistent or lumped, kg, in the order of the stiffness.
    stiffness, nodes, base, tip, order
        As for `superelement_spring`.

    Raises
    ------
    InputError
        As there; and if the mass matrix is not symmetric, is that of no body (the mass differs by
        direction, or the moments of inertia contradict it), or has a motion with negative energy.

    References
    ----------
    R. J. Guyan, Reduction of stiffness and mass matrices, AIAA Journal 3 (1965), 380.
    """
    K, points, parts = _sorted(stiffness, nodes, base, tip, order)
    M = _ordered(mass, len(points), order, "mass of the superelement")
    rigid, modes = _rigid(points - points[parts.tip_node]), _static_modes(K, parts)
    whole, both = rigid.T @ M @ rigid, rigid.T @ M @ modes
    inertia = _body_of(whole)
    # Pseudo-inverse: masses on one line have no moment of inertia about it.
    sizes = numerics.equilibration(whole)
    values, vectors = np.linalg.eigh(whole / np.outer(sizes, sizes))
    held = values > numerics.FREE_MOTION_STIFFNESS * values[-1]
    vectors = vectors[:, held] / sizes[:, None]
    share = (vectors / values[held]) @ vectors.T @ both
    own = modes.T @ M @ modes
    rest = own - share.T @ whole @ share
    sizes = np.sqrt(np.maximum(np.diagonal(own), numerics.TINY))
    values, vectors = np.linalg.eigh(0.5 * (rest + rest.T) / np.outer(sizes, sizes))
    if values[0] < -numerics.REPORTED_ERROR:
        raise InputError(
            "the mass matrix gives a motion negative energy",
            expected="no negative eigenvalue",
            got=f"{values[0]:.2g} of the tip's",
        )
    root = np.sqrt(np.maximum(values, 0.0))[:, None] * (vectors.T * sizes)
    return SuperelementMass(*inertia, share, root)


@dataclass(frozen=True)
class _Parts:
    """Rows of the tip, and of the nodes other than tip and base."""

    tip_node: int
    tip: slice
    others: Array


def _ordered(matrix: ArrayLike, n: int, order: Order, what: str) -> Array:
    """Check a matrix of n nodes and make it symmetric, each node angular-linear."""
    K = checked_array(matrix, (6 * n, 6 * n), what)
    if order not in ORDERS:
        raise InputError("unknown order", expected="linear-angular or angular-linear", got=order)
    if order == "linear-angular":
        swap = (6 * np.arange(n)[:, None] + se3.SWAP).ravel()
        K = K[np.ix_(swap, swap)]
    size = np.sqrt(np.abs(np.diagonal(K)))
    if np.any(np.abs(K - K.T) > numerics.LOST_ERROR * np.outer(size, size)):
        raise InputError(f"{what} must be symmetric")
    return np.asarray(0.5 * (K + K.T))


def _sorted(
    stiffness: ArrayLike, nodes: ArrayLike, base: int, tip: int, order: Order
) -> tuple[Array, Array, _Parts]:
    """Stiffness (6 N, 6 N) angular-linear, nodes (N, 3), and the rows of tip and other nodes."""
    points = checked_array(nodes, ("nodes", 3), "nodes")
    n = len(points)
    K = _ordered(stiffness, n, order, "stiffness of the superelement")
    for name, index in (("base", base), ("tip", tip)):
        if type(index) is bool or not isinstance(index, int | np.integer) or not -n <= index < n:
            raise InputError(f"no such node: {name}", expected=f"{-n} to {n - 1}", got=index)
    base, tip = base % n, tip % n
    if base == tip:
        raise InputError("base and tip are the same node", got=base)
    rigid = _rigid(points)
    left, terms = np.abs(K @ rigid), np.abs(K) @ np.abs(rigid)
    worst = float(np.max(left / np.where(terms > 0.0, terms, 1.0)))
    if worst > numerics.LOST_ERROR:
        raise InputError(
            "the superelement resists a motion as a whole: the nodes' unit or the order of the "
            "rows is another one, or it is held somewhere",
            expected=f"forces below {numerics.LOST_ERROR:g} of their terms",
            got=f"{worst:.2g}",
        )
    rows = slice(6 * tip, 6 * tip + 6)
    others = np.delete(np.arange(6 * n), [*range(6 * n)[rows], *range(6 * base, 6 * base + 6)])
    return K, points, _Parts(tip, rows, others)


def _rigid(points: Array) -> Array:
    """Motions (6 N, 6) of nodes at points (N, 3) by the body's twist about the origin."""
    return np.concatenate(
        [np.block([[np.eye(3), np.zeros((3, 3))], [-se3.skew(p), np.eye(3)]]) for p in points]
    )


def _static_modes(K: Array, parts: _Parts) -> Array:
    """Motions (6 N, 6) of all nodes per motion of the tip, the base at rest."""
    modes = np.zeros((len(K), 6))
    modes[parts.tip] = np.eye(6)
    r = parts.others
    if r.size:
        inner = K[np.ix_(r, r)]
        sizes = numerics.equilibration(inner)
        least = float(np.linalg.eigvalsh(inner / np.outer(sizes, sizes))[0])
        if least < -numerics.LOST_ERROR:
            raise InputError(
                "nodes between base and tip are pushed away from rest",
                expected="a positive definite matrix of their freedoms",
                got=f"{least:.2g} of their stiffness along a motion",
            )
        inverse = numerics.invert(inner)
        if inverse is None or inverse.error > numerics.LOST_ERROR:
            raise InputError(
                "nodes between base and tip can move without a force, or so stiff a "
                "part is among them that the digits of the soft ones are lost",
                got="a singular matrix of their freedoms"
                if inverse is None
                else f"a relative error of {inverse.error:.1g}",
            )
        modes[r] = -inverse.matrix @ K[r, parts.tip]
    return modes


def _body_of(whole: Array) -> tuple[float, Array, Array]:
    """Mass, mass centre and inertia about it, from a body's matrix (6, 6) about the origin.

    ``[[J, m c x], [-m c x, m 1]]``.
    """
    mass = float(np.trace(whole[3:, 3:])) / 3.0
    if not mass > 0.0:
        raise InputError("the mass matrix has no mass", expected="a positive one", got=mass)
    centre = se3.unskew(whole[:3, 3:]) / mass
    turned = se3.skew(centre)
    ideal = np.block([[whole[:3, :3], mass * turned], [-mass * turned, mass * np.eye(3)]])
    sizes = np.sqrt(np.abs(np.diagonal(ideal)))
    worst = float(np.max(np.abs(whole - ideal) / np.where(sizes > 0, sizes, 1) / sizes[3]))
    if worst > numerics.LOST_ERROR:
        raise InputError(
            "the mass matrix is that of no body: the nodes' unit or the order of the rows is "
            "another one, or the mass differs by direction",
            expected=f"a misfit below {numerics.LOST_ERROR:g}",
            got=f"{worst:.2g}",
        )
    inertia = whole[:3, :3] + mass * turned @ turned
    return mass, centre, np.asarray(0.5 * (inertia + inertia.T))
