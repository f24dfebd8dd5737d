r"""The wrenches that drives can hold at a posture, within their limits.

With N the motions that keep the loop closures, B the rates of the drives' positions and
J the Jacobian of M, the forces t of the drives hold a wrench W if

    A (t - t_0) = G (W - W_0),      A = (B N)^T,      G = (J N)^T                     (1)

where t_0 hold W_0 in the analysed posture: weight, links and all other potentials are in
these. Limits ``low <= t <= high`` make the right side of (1) a zonotope, with a pair of
hyperplanes for each normal c that is orthogonal to all but a few columns a_i of A:

    c G (W - W_0) <= sum_i max(c a_i (low_i - t_0i), c a_i (high_i - t_0i)).          (2)

For as many drives as freedoms each normal belongs to one drive. Cables are drives that
cannot push, rigid joints are drives, and so are, without limits, deflections of links.
"""

from __future__ import annotations

from itertools import combinations, compress
from math import comb
from typing import NamedTuple

import numpy as np

from cartstiff.core import numerics
from cartstiff.core.arrays import Array
from cartstiff.core.mechanisms.contract import MechanismPosture
from cartstiff.core.mechanisms.elastic import ElasticMechanism
from cartstiff.core.stiffness.compute import PostureStiffness
from cartstiff.core.stiffness.forces import drive_limits
from cartstiff.core.stiffness.motions import decompose

#: Largest number of normals: those of 14 cables that hold six freedoms.
MOST_NORMALS = 2002


class HeldForces(NamedTuple):
    """The linear relation (1) of forces of drives and wrenches on M.

    Attributes
    ----------
    names : tuple of str
        Drives.
    A : ndarray (r, m)
        Columns of drives.
    G : ndarray (r, 6)
        Of wrenches on M, in its components.
    low, high : ndarray (m,)
        Limits less the forces now.
    wrench : ndarray (6,)
        W_0.
    """

    names: tuple[str, ...]
    A: Array
    G: Array
    low: Array
    high: Array
    wrench: Array

    @property
    def is_limited(self) -> bool:
        """Whether a drive has a limit."""
        return bool(np.isfinite([self.low, self.high]).any())

    def hyperplanes(self) -> tuple[Array, Array]:
        """Normals (k, r) and offsets (k,) of (2), also of motions without a drive."""
        A = self.A
        r, m = A.shape
        U, values, _ = np.linalg.svd(A)
        rank = numerics.rank(values)
        # Along the others no drive holds anything.
        free, U = U[:, rank:].T, U[:, :rank]
        if not rank or comb(m, rank - 1) > MOST_NORMALS:
            return np.zeros((0, r)), np.zeros(0)
        own = U.T @ A / values[:rank, None]
        size = np.linalg.norm(own, axis=0)
        own = own / np.where(size > numerics.RANK, size, 1.0)
        some = list(combinations(range(m), rank - 1))
        _, each, Vt = np.linalg.svd(own[:, some].transpose(1, 2, 0))
        regular = each.min(axis=1, initial=1.0) > numerics.RANK
        c = (Vt[regular, -1] / values[:rank]) @ U.T
        normals = np.vstack([c, -c, free, -free])
        along = normals @ A
        along[np.abs(along) <= numerics.RANK * numerics.largest(along)] = 0.0
        with np.errstate(invalid="ignore"):
            ends = [np.where(along != 0.0, along * x, 0.0) for x in (self.low, self.high)]
        return normals, np.maximum(*ends).sum(axis=1)

    def factor(self, wrench: Array) -> tuple[float, list[int]]:
        """Largest s for which s times a wrench (6,) is held, and the drives at a limit.

        Infinite, and none, without a limit on the way; NaN if no s is.
        """
        normals, offsets = self.hyperplanes()
        rate = normals @ self.G @ wrench
        room = offsets + normals @ self.G @ self.wrench
        least = (
            numerics.RANK * np.abs(normals @ self.G).sum(axis=1) * np.abs(wrench).max()
        )
        on, off = rate > least, rate < -least
        with numerics.silent():
            most = np.where(on, room / rate, np.inf)
            lowest = np.where(off, room / rate, -np.inf).max(initial=-np.inf)
        if not len(most) or not (s := float(most.min())) < np.inf:
            return np.inf, []
        if s < lowest:
            return np.nan, []
        along = normals[int(np.argmin(most))] @ self.A
        largest = numerics.largest(along)
        at = np.flatnonzero(np.abs(along) > numerics.NEGLIGIBLE_SHARE * largest)
        return s, at.tolist()

    def polytope(self, axes: Array) -> Array | None:
        """Vertices (k, 3) of the forces on M's origin that can be held, along axes R.

        Forces that the structure holds are left out. None where some forces have no limit
        or none can be held.
        """
        normals, offsets = self.hyperplanes()
        rows = normals @ self.G
        room = offsets + rows @ self.wrench
        M = rows[:, 3:] @ axes.T
        _, values, Vt = np.linalg.svd(M, full_matrices=False)
        P = Vt[: numerics.rank(values)].T
        found = vertices(M @ P, room) if P.size else None
        return None if found is None else found @ P.T


def vertices(normals: Array, offsets: Array) -> Array | None:
    """Vertices (k, d) of ``normals y <= offsets``; None if unbounded or empty."""
    # SciPy takes long to import.
    from scipy.optimize import linprog
    from scipy.spatial import HalfspaceIntersection, QhullError

    bounded = np.isfinite(offsets)
    normals, offsets = normals[bounded], offsets[bounded]
    size = np.linalg.norm(normals, axis=1)
    kept = size > numerics.RANK * size.max(initial=0.0)
    normals, offsets = normals[kept] / size[kept, None], offsets[kept] / size[kept]
    d = normals.shape[1]
    if not len(normals) or np.linalg.matrix_rank(normals) < d:
        return None
    # The centre of the largest ball inside.
    unit = numerics.largest(offsets) or 1.0
    rows = np.column_stack([normals, np.ones(len(normals))])
    goal = np.append(np.zeros(d), -1.0)
    ball = linprog(goal, rows, offsets / unit, bounds=[(None, None)] * d + [(0, None)])
    if ball.x is None or not ball.x[-1] > numerics.RANK:
        return None
    centre = ball.x[:-1] * unit
    if d == 1:
        ends = offsets / normals[:, 0]
        return np.array(
            [[ends[normals[:, 0] < 0.0].max()], [ends[normals[:, 0] > 0.0].min()]]
        )
    halves = np.column_stack([normals, -offsets])
    try:
        found = HalfspaceIntersection(halves, centre).intersections
    except QhullError:
        return None
    if not np.isfinite(found).all() or np.abs(found).max() > unit / numerics.RANK:
        return None
    _, first = np.unique((found / unit).round(9), axis=0, return_index=True)
    return np.asarray(found[np.sort(first)])


def held_forces(result: PostureStiffness) -> HeldForces | None:
    """Relation (1) at a posture; None where nothing balances it."""
    elastic, posture = result.elastic, result.posture
    if result.wrench is None:
        return None
    N = motions_of_loops(elastic, posture)
    # The drives with their limits, then the deflections of links without any.
    names, rows = drive_rows(elastic, posture)
    low, high = drive_limits(elastic, names)
    now = {one.name: one.force for one in result.forces}
    t = np.array([now[name] for name in names])
    links = sorted(elastic.mechanism.virtual)
    if links:
        rows = np.vstack([rows, np.eye(len(N))[links]])
        names = (*names, *(elastic.names[j] for j in links))
        low, high, t = (
            np.append(x, np.full(len(links), fill))
            for x, fill in ((low, -np.inf), (high, np.inf), (t, 0.0))
        )
    J = posture.motion.jacobian
    return HeldForces(
        names, (rows @ N).T, (J @ N).T, low - t, high - t, np.asarray(result.wrench)
    )


def motions_of_loops(elastic: ElasticMechanism, posture: MechanismPosture) -> Array:
    """Motions N (n, r) that keep the loops; rigid joints are drives here, and move."""
    sizes, closure = posture.coordinate_lengths, posture.closure
    loops = 0 if closure is None else len(closure.jacobian) - len(elastic.mechanism.rigid)
    if closure is None or not loops:
        return np.diag(sizes)
    rows = closure.jacobian[:loops] * sizes
    units = np.ones(loops) if closure.sizes is None else closure.sizes[:loops]
    return np.asarray(sizes[:, None] * decompose(rows / units[:, None]).N)


def drive_rows(
    elastic: ElasticMechanism, posture: MechanismPosture
) -> tuple[tuple[str, ...], Array]:
    """Names of the drives, and the rows (m, n) by which their forces act.

    ``rows^T forces`` is what springs of joints and couplings, legs, and rigid joints add
    to the gradient.
    """
    springs, n = elastic.springs, len(elastic.names)
    names, rows = list[str](), [np.zeros((0, n))]
    if springs is not None:
        own = ~springs.is_passive
        names += compress(elastic.spring_names, own)
        sign = -1.0 if springs.has_coordinate(n).any() else 1.0
        rows.append(sign * springs.rows(posture)[own])
    rigid = sorted(elastic.mechanism.rigid)
    names += [elastic.names[j] for j in rigid]
    rows.append(-np.eye(n)[rigid])
    for sums in elastic.sums:
        names += sums.names
        rows.append(sums.factors)
    return tuple(names), np.concatenate(rows)
