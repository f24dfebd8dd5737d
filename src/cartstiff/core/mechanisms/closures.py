r"""All closures of a chain at once: residual, Jacobian, curvature.

A closure ties frame b to frame a. A weld's residual is log(T_a_b), a common point's the
position of b's origin in b's directions. At closure its second derivative is the bracket
form along the path from a to b (up to terms that vanish on the motions that keep the
closure).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from cartstiff.core import numerics
from cartstiff.core.arrays import Array
from cartstiff.core.geometry import se3
from cartstiff.core.mechanisms.tree import FixedFrame, KinematicTree, TreeState
from cartstiff.core.potentials.contract import SecondOrderMap

#: Largest change of a coordinate in a step towards closure (rad, or characteristic
#: lengths).
LONGEST_STEP = 0.2

#: Largest number of steps from the reference posture to another.
MOST_STEPS = 100
#: Closes a chain near coordinates (N, n): those found, whether each is closed, and
#: whether none is.
Near = Callable[[Array], tuple[Array, NDArray[np.bool_], NDArray[np.bool_]]]

_ROWS = {"weld": slice(0, 6), "point": slice(3, 6)}
# With a smaller residual its Jacobian is that of the relative twist, to rounding.
_CLOSED = numerics.ROUNDOFF_OF_SUMS


@dataclass(frozen=True, eq=False)
class Closure:
    """Frame b tied to frame a: a common point, or the same pose.

    Attributes
    ----------
    frame_a, frame_b : str
        Names of frames of the tree.
    type : {"point", "weld"}
        Whether points or poses coincide.
    """

    frame_a: str
    frame_b: str
    type: Literal["point", "weld"]

    @property
    def rows(self) -> slice:
        """Rows of the relative twist that vanish."""
        return _ROWS[self.type]


@dataclass(frozen=True, eq=False)
class ReferencePosture:
    """A closed posture of a chain, from which other postures are reached.

    Newton's steps towards closure from a distant posture may end in another assembly
    mode, or diverge. The held coordinates therefore move straight to their wanted values,
    in steps of at most `LONGEST_STEP`, and the chain is closed after each step.

    Attributes
    ----------
    q : ndarray (n,)
        Its coordinates.
    held : sequence of int
        Coordinates with wanted values.
    lengths : ndarray (n,)
        Natural sizes of the coordinates there.
    """

    q: Array
    held: Sequence[int]
    lengths: Array

    def steps(self, q: Array) -> NDArray[np.intp]:
        """Return the number of steps (N,) to the held coordinates of q (N, n);
        0 for too many.
        """
        held = list(self.held)
        changes = np.abs(q[:, held] - self.q[held]) / self.lengths[held]
        largest = changes.max(axis=1, initial=0.0)
        steps: NDArray[np.intp] = np.ceil(largest / LONGEST_STEP).astype(int)
        return np.where(steps <= MOST_STEPS, steps, 0)

    def steps_where_asked(self, q: Array) -> NDArray[np.intp]:
        """Return `steps` where several are needed and all other coordinates are as here,
        else 0.
        """
        others = np.ones(len(self.q), bool)
        others[list(self.held)] = False
        alike = (q[:, others] == self.q[others]).all(axis=1)
        steps = np.zeros(len(q), int)
        if alike.any():
            steps[alike] = self.steps(q[alike])
        return np.where(steps > 1, steps, 0)

    def lead_to(self, q: Array, close: Callable[[Array], Any]) -> Any:
        """The posture of `close` at the held coordinates of q (n,), reached in steps.

        None where `close` fails, and where several steps are not needed.
        """
        last: Any = None

        def near(start: Array) -> tuple[Array, NDArray[np.bool_], NDArray[np.bool_]]:
            nonlocal last
            last = close(start[0])
            is_closed = np.array([last is not None])
            return start if last is None else last.q[None], is_closed, ~is_closed

        steps = self.steps_where_asked(q[None])
        return last if self.continue_from(near, q[None], steps)[1].any() else None

    def continue_from(
        self, near: Near, q: Array, steps: NDArray[np.intp]
    ) -> tuple[Array, NDArray[np.bool_], NDArray[np.bool_]]:
        """Reach the held coordinates of q (N, n) in so many steps;
        returned as by `near`.
        """
        held, at = list(self.held), np.tile(self.q, (len(q), 1))
        begin, change = at[:, held], q[:, held] - self.q[held]
        is_closed, has_failed = np.zeros(len(q), bool), np.zeros(len(q), bool)
        which = np.flatnonzero(steps > 0)
        for k in range(1, int(steps.max(initial=0)) + 1):
            start, last = at[which], steps[which] == k
            part = begin[which] + change[which] * (k / steps[which])[:, None]
            start[:, held] = np.where(last[:, None], q[which][:, held], part)
            at[which], closed, failed = near(start)
            is_closed[which[closed & last]], has_failed[which[failed]] = True, True
            which = which[closed & ~last]
            if not which.size:
                break
        return np.where(is_closed[:, None], at, q), is_closed, has_failed


class LoopClosures:
    """Constants of c closures, which do not depend on the posture.

    Parameters
    ----------
    closures : sequence of Closure
        At least one.
    places : sequence of (FixedFrame, FixedFrame)
        Places of their frames a and b in the tree.
    tree : KinematicTree
        The joints.
    """

    def __init__(
        self,
        closures: Sequence[Closure],
        places: Sequence[tuple[FixedFrame, FixedFrame]],
        tree: KinematicTree,
    ) -> None:
        ends = [*(a for a, _ in places), *(b for _, b in places)]
        self.joints = [end.joint for end in ends]
        self.local = np.array([end.T_j_f for end in ends])
        paths = [tree.path(a.joint, b.joint) for a, b in places]
        #: (c, 1, joints): -1 on the path up from a, +1 on the path down to b.
        self.signs = np.array([path.signs for path in paths])[:, None]
        #: (c, p): joints of each path in its order; shorter paths are padded.
        self.order = np.zeros(
            (len(paths), max(len(path.order) for path in paths)), np.intp
        )
        #: (c, p, p): 1/2 for a joint before another on the path.
        self.before = np.zeros((*self.order.shape, self.order.shape[1]))
        for order, half, path in zip(self.order, self.before, paths, strict=True):
            p = len(path.order)
            order[:p] = path.order
            half[:p, :p] = np.triu(np.full((p, p), 0.5), 1)
        #: (c p p,): flat index of each entry of `before` in a matrix over all joints.
        self.places = (
            self.order[:, :, None] * tree.model.nv + self.order[:, None]
        ).ravel()
        is_weld = np.array([c.type == "weld" for c in closures])
        self.welds, self.points = np.flatnonzero(is_weld), np.flatnonzero(~is_weld)
        #: bool (c, 6): which components of the relative twists vanish.
        self.rows = np.repeat(
            np.stack([is_weld, np.ones(len(is_weld), bool)], axis=1), 3, axis=1
        )


class ClosureState:
    """Closures at one posture of the tree.

    Attributes
    ----------
    residual : ndarray (m,)
        Lengths and angles mixed.
    rows : ndarray of bool (c, 6)
        Components of the relative twists in it.
    """

    def __init__(self, ties: LoopClosures, state: TreeState) -> None:
        self._ties, self._mimic, self.rows = ties, state.tree.mimic, ties.rows
        count = len(ties.rows)
        poses = state.joint_poses(ties.joints) @ ties.local
        T_F_b = poses[count:]
        self._twists = se3.adjoint_of_inverse(T_F_b) @ (state.world_jacobian * ties.signs)
        T = se3.inverse(poses[:count]) @ T_F_b
        self._missed = np.zeros((count, 6))
        if ties.points.size:
            at = T[ties.points]
            self._missed[ties.points, 3:] = (at[:, None, :3, 3] @ at[:, :3, :3])[:, 0]
        if ties.welds.size:
            self._missed[ties.welds] = se3.log(T[ties.welds])
        self.residual = self._missed[ties.rows]

    def jacobian(self) -> Array:
        """Return the Jacobian (m, n) of the residual."""
        ties, J = self._ties, self._twists
        if np.abs(self._missed).max() >= _CLOSED:
            J, points, welds = J.copy(), ties.points, ties.welds
            if points.size:
                J[points, 3:] += se3.skew(self._missed[points, 3:]) @ J[points, :3]
            if welds.size:
                J[welds] = se3.right_jacobian_inverse(self._missed[welds]) @ J[welds]
        rows = J[ties.rows]
        return rows if self._mimic is None else rows @ self._mimic

    def curvature(self, multipliers: Array) -> Array:
        """``sum_k multipliers_k Hess(residual_k)`` (n, n), symmetric."""
        ties = self._ties
        w = np.zeros((len(ties.rows), 6))
        w[ties.rows] = multipliers
        J = self._twists[
            np.arange(len(w))[:, None], :, ties.order
        ]  # (c, p, 6), on the paths
        halves = J @ se3.bracket_form(w) @ J.swapaxes(1, 2) * ties.before
        n = self._twists.shape[2]
        upper = np.bincount(ties.places, halves.ravel(), n * n).reshape(n, n)
        S: Array = upper + upper.T
        return S if self._mimic is None else self._mimic.T @ S @ self._mimic


def held_map(
    tied: ClosureState | None, rigid: list[int], sizes: Array, length: float
) -> SecondOrderMap:
    """Return the map to the residual of closures, followed by the rigid coordinates.

    Parameters
    ----------
    tied : ClosureState or None
        The closures.
    rigid : list of int
        Rigid coordinates.
    sizes : ndarray (n,)
        Natural sizes of all coordinates.
    length : float
        Natural size of distances.
    """
    held, own = np.eye(len(sizes))[rigid], sizes[rigid]
    # Without a reference to the posture: a reference cycle would delay its removal.
    curvature = partial(_curvature, tied, len(sizes))
    if tied is None:
        return SecondOrderMap(held, curvature, own)
    of_loops = np.broadcast_to(np.repeat([1.0, length], 3), tied.rows.shape)[tied.rows]
    if not rigid:
        return SecondOrderMap(tied.jacobian(), curvature, of_loops)
    return SecondOrderMap(
        np.concatenate([tied.jacobian(), held]),
        curvature,
        np.concatenate([of_loops, own]),
    )


def _curvature(tied: ClosureState | None, n: int, multipliers: Array) -> Array:
    """Curvature (n, n) of closures, and of rigid coordinates, which have none."""
    if tied is None or not any(multipliers.tolist()):
        return np.zeros((n, n))
    return tied.curvature(multipliers[: len(tied.residual)])
