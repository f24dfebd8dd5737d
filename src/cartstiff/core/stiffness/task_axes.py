r"""The axes in which the stiffness of a mechanism of fewer than six freedoms is said.

With motions U (6, r) of the body and the stiffness K_U on them, coordinates y = S U a are
r of the components x, y, z, rx, ry, rz of the body's twist. In them the stiffness is

    A = S U,     K_y = A^-T K_U A^-1,     twist = U A^-1 y'

so that a delta has K_xx, K_yy, K_zz and a planar machine x, y and phi. Whether the other
components follow is seen in ``U A^-1``.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from typing import Any, Literal

import numpy as np

from cartstiff.core import numerics
from cartstiff.core.arrays import Array

#: Names of the components of a twist.
NAMES = ("rx", "ry", "rz", "x", "y", "z")
# Of a machine that moves in a plane.
_IN_A_PLANE: dict[tuple[str, ...], tuple[str, ...]] = {
    ("x", "y", "rz"): ("x", "y", "phi"),
    ("y", "z", "rx"): ("y", "z", "phi"),
    ("x", "z", "ry"): ("x", "z", "phi"),
}
# Share of the largest determinant from which coordinates count as independent.
_INDEPENDENT = 0.1


@dataclass(frozen=True, eq=False)
class TaskAxes:
    """Coordinates of the motions that exist, and the stiffness in them.

    Attributes
    ----------
    names : tuple of str
        Components of the twist: translations x, y, z first, then turns rx, ry, rz; the
        turn of a machine that moves in its plane is called phi.
    axes : {"M", "F"}
        Axes of the components, through the origin of M.
    is_pure : bool
        Whether the other components stay zero.
    motions : ndarray (6, r)
        Twists along these axes, rotation first, at unit rates of the coordinates.
    stiffness : ndarray (r, r)
        K^B in them.
    tangent : ndarray (r, r)
        The tangent under the load; the same without one.
    """

    names: tuple[str, ...]
    axes: Literal["M", "F"]
    is_pure: bool
    motions: Array
    stiffness: Array
    tangent: Array

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        return {
            "names": list(self.names),
            "axes": self.axes,
            "alone": self.is_pure,
            "motions": self.motions.tolist(),
            "stiffness": self.stiffness.tolist(),
            "tangent": self.tangent.tolist(),
        }


def task_axes(
    U: Array, K: Array, change: Array, rotation: Array, length: float
) -> TaskAxes | None:
    """The task axes of motions; None for none, or for all six.

    Parameters
    ----------
    U, K : ndarray (6, r), (r, r)
        Motions in M, and the stiffness on them.
    change : ndarray (6, 6)
        ``K^load - K^B`` in M.
    rotation : ndarray (3, 3)
        Of M in F.
    length : float
        Makes turns comparable with translations.
    """
    rank = U.shape[1]
    if not 0 < rank < 6:
        return None
    turned = np.kron(np.eye(2), rotation) @ U
    chosen = [_chosen(motions, length) for motions in (U, turned)]
    # Axes along which nothing else moves are taken before those of the body.
    is_turned = not chosen[0][1] and chosen[1][1]
    (rows, is_pure), motions = chosen[is_turned], (U, turned)[is_turned]
    inverse = np.linalg.inv(motions[rows])
    tangent = K + U.T @ change @ U
    names = tuple(NAMES[i] for i in rows)
    return TaskAxes(
        _IN_A_PLANE.get(names, names) if is_pure else names,
        "F" if is_turned else "M",
        is_pure,
        _rounded(motions @ inverse, np.repeat([1.0 / length, 1.0], 3), rows, length),
        inverse.T @ K @ inverse,
        inverse.T @ tangent @ inverse,
    )


def _chosen(motions: Array, length: float) -> tuple[list[int], bool]:
    """Components that determine motions (6, r), translations first,
    and whether only they move.
    """
    scaled = motions * np.repeat([length, 1.0], 3)[:, None]
    basis = np.linalg.qr(scaled)[0]
    moving = np.flatnonzero((basis * basis).sum(axis=1) > numerics.NEGLIGIBLE_DIFFERENCE)
    order = [3, 4, 5, 0, 1, 2]
    if len(moving) == motions.shape[1]:
        return [i for i in order if i in moving], True
    sets = [list(s) for s in combinations(order, motions.shape[1])]
    sizes = np.array([abs(np.linalg.det(basis[s])) for s in sets])
    return sets[int(np.argmax(sizes > _INDEPENDENT * sizes.max()))], False


def _rounded(motions: Array, per: Array, rows: list[int], length: float) -> Array:
    """Motions at unit rates, with zeros where components are rounding."""
    sizes = np.where(np.array(rows) < 3, length, 1.0)
    return np.where(
        np.abs(motions) / per[:, None] > numerics.NEGLIGIBLE_DIFFERENCE * sizes,
        motions,
        0.0,
    )
