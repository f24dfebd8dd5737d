r"""All poses of a six-legged platform from its leg lengths, and what has become of each path."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cartstiff import numerics
from cartstiff.arrays import checked_vector
from cartstiff.errors import InputError
from cartstiff.geometry.se3 import Array
from cartstiff.kinematics import study
from cartstiff.mechanisms.platform import Platform

Complex = NDArray[np.complex128]

# Where a path is lost, or comes to lie on another, all are followed again another way: the start's
# equations are multiplied by another factor, and the predictor may miss by so much less.
_WAYS = np.exp(1j * np.array([0.0, 2.4, 4.8, 1.0, 3.4]))
_FINER = 0.1
# A path whose parameter is below this has come near its end: it is known to the root of it.
_NEAR_END = 1e-3
# Ends nearer than this (of unit vectors) are one multiple solution: four paths that meet are known
# to the fourth root of `numerics.REACHED`.
_ONE = 3e-3
# A multiple solution is left by this much to see whether others lie beside it: there an isolated
# one, be it fourfold, misses the quadrics by more than `numerics.BESIDE`.
_ASIDE = 0.05


@dataclass(frozen=True)
class PathCount:
    """What has become of the 40 solutions of a general platform.

    Attributes
    ----------
    single : int
        Paths that ended at solutions of their own, complex or real.
    real : int
        Real poses among these.
    multiple : int
        Paths that ended where others do: at singular poses.
    moving : int
        Paths that ended on curves of solutions: the platform moves although its legs do not.
    nowhere : int
        Paths that ended at points that are no pose: such solutions do not exist for this platform.
    lost : int
        Paths whose end is not known; where there are any, poses may be missing.
    """

    single: int
    real: int
    multiple: int
    moving: int
    nowhere: int
    lost: int

    @property
    def is_complete(self) -> bool:
        """Whether every path's end is known: then no isolated pose is missing."""
        return self.lost == 0

    def __str__(self) -> str:
        parts = [
            (self.real, "real"),
            (self.single - self.real, "complex"),
            (self.multiple, "at multiple solutions"),
            (self.moving, "on curves of solutions"),
            (self.nowhere, "at infinity"),
            (self.lost, "lost"),
        ]
        return f"{study.PATHS} paths: " + ", ".join(f"{n} {what}" for n, what in parts if n)

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {"total": study.PATHS, **asdict(self), "complete": self.is_complete}


class Poses(NamedTuple):
    """Real poses of a platform.

    Attributes
    ----------
    poses : ndarray (k, 4, 4)
        ``T_F_M``.
    multiplicities : ndarray of int (k,)
        1, or how many paths ended there.
    paths : PathCount
        Whether these are all.
    moving : ndarray (4, 4) or (0,)
        A real pose on a curve of solutions, where one was met; there may be others.
    """

    poses: Array
    multiplicities: NDArray[np.intp]
    paths: PathCount
    moving: Array


def poses_of_lengths(platform: Platform, lengths: Array) -> Poses:
    """All isolated real poses at which the six legs have given lengths.

    The 40 solutions of a general platform are followed to this one (`cartstiff.kinematics.study`).

    Parameters
    ----------
    platform : Platform
        With six legs, not singular in every pose (`cartstiff.kinematics.architecture`).
    lengths : array_like (6,)
        Above zero.

    Raises
    ------
    InputError
        If there are not six legs, or a length is not above zero.
    """
    if len(platform.points) != 6:
        raise InputError(
            "all assembly modes are found for six legs only", got=str(len(platform.points))
        )
    wanted = checked_vector(lengths, 6, "list of leg lengths")
    if np.any(wanted <= 0):
        raise InputError("leg lengths must be positive numbers", expected="6", got=wanted.tolist())
    at, of = platform.anchors.mean(axis=0), platform.points.mean(axis=0)
    anchors, points = platform.anchors - at, platform.points - of
    size = max(float(np.ptp(anchors, axis=0).max()), float(np.ptp(points, axis=0).max()))
    size = size or float(wanted.max())
    Q = study.quadrics(anchors / size, points / size, (wanted / size) ** 2)
    ends, single = _followed(Q)
    x, share = ends.x, study.rotation_share(ends.x)
    lost = ~single & (ends.at > _NEAR_END)
    no_pose = ~single & ~lost & (share < numerics.NO_ROTATION)
    rest = np.flatnonzero(~single & ~no_pose & ~lost)
    moving = np.array([_is_on_curve(Q, x[i]) for i in rest], bool)
    real = _real_points(Q, x[single])
    several, counts = _multiple(Q, x[rest[~moving]])
    paths = PathCount(
        single=int(single.sum()),
        real=len(real),
        multiple=int((~moving).sum()),
        moving=int(moving.sum()),
        nowhere=int(no_pose.sum()),
        lost=int(lost.sum()) + _coinciding(x[single]),
    )
    curve = _real_on_curve(Q, x[rest[moving]])
    poses = study.pose_of_study(np.vstack([real, several, curve]))
    poses[:, :3, 3] = poses[:, :3, 3] * size + at - poses[:, :3, :3] @ of
    k = len(real) + len(several)
    one_each = np.ones(len(real), np.intp)
    return Poses(poses[:k], np.concatenate([one_each, counts]), paths, poses[k:].reshape(-1, 4)[:4])


def _followed(Q: Array) -> tuple[study.Ends, NDArray[np.bool_]]:
    """Ends of all paths, and which are solutions of their own; with finer steps where need be."""
    start, solutions = study.general_platform()
    miss = numerics.FOLLOWED
    for way in _WAYS:
        ends = study.follow(way * start, Q, solutions.copy(), miss)
        values = np.linalg.svd(study.jacobians(Q, ends.x), compute_uv=False)
        single = (ends.at == 0.0) & (values[:, -1] > numerics.USUAL_RANK * values[:, 0])
        if not _coinciding(ends.x[single]) and not np.any(ends.at > _NEAR_END):
            break
        miss *= _FINER
    return ends, single


def _coinciding(x: Complex) -> int:
    """How many of the unit vectors are also in front of themselves in the list."""
    overlap = np.triu(np.abs(x.conj() @ x.T), 1)
    return int((overlap > 1.0 - 0.5 * numerics.NEARBY**2).any(axis=0).sum())


def _real(x: Complex) -> Array:
    """Real parts (n, 8) of points, each with its largest component made real."""
    largest = np.take_along_axis(x, np.abs(x).argmax(axis=1)[:, None], 1)
    real = (x * (np.abs(largest) / largest)).real
    return np.asarray(real / np.linalg.norm(real, axis=1)[:, None])


def _real_points(Q: Array, x: Complex) -> Array:
    """Those solutions (k, 8) that are their own conjugates, by Newton's method in real numbers."""
    if not len(x):
        return np.empty((0, 8))
    nearest = np.abs(x @ x.T).argmax(axis=1)
    roots = _real(x[nearest == np.arange(len(x))])
    for _ in range(3):
        right = np.concatenate([study.values(Q, roots), np.zeros((len(roots), 1))], axis=1)
        roots = roots - np.linalg.solve(study.jacobians(Q, roots), right[..., None])[..., 0]
        roots /= np.linalg.norm(roots, axis=1)[:, None]
    return roots


def _refined(Q: Array, x: NDArray) -> NDArray:  # type: ignore[type-arg]
    """Point (8,) near x on the quadrics, by steps of least size across what is singular."""
    for _ in range(8):
        J = study.jacobians(Q, x[None])[0]
        right = np.append(study.values(Q, x[None])[0], 0.0)
        x = x - np.linalg.lstsq(J, right, rcond=_ONE)[0]
        x = x / np.linalg.norm(x)
    return x


def _is_on_curve(Q: Array, x: Complex) -> bool:
    """Whether other solutions lie beside a multiple one, however near."""
    x = _refined(Q, x)
    _, values, right = np.linalg.svd(study.jacobians(Q, x[None])[0])
    aside = right[values <= _ONE * values[0]].conj().sum(axis=0)
    if not aside.any():
        return False
    aside /= np.linalg.norm(aside)
    y = x + _ASIDE * aside
    for _ in range(20):
        J = np.vstack([study.jacobians(Q, y[None])[0][:7], x.conj(), aside.conj()])
        missed = [*study.values(Q, y[None])[0], np.vdot(x, y) - 1.0, np.vdot(aside, y) - _ASIDE]
        y = y - np.linalg.lstsq(J, np.array(missed), rcond=None)[0]
    return bool(np.abs(missed).max() < numerics.BESIDE)


def _real_on_curve(Q: Array, x: Complex) -> Array:
    """The first real point (1, 8) on curves of solutions that points x lead to, or (0, 8)."""
    for row in x:
        point = _refined(Q, _real(row[None])[0])
        met = np.abs(study.values(Q, point[None])).max() < numerics.REACHED
        if (
            met
            and study.rotation_share(point[None])[0] > numerics.NO_ROTATION
            and _is_on_curve(Q, point)
        ):
            return point[None]
    return np.empty((0, 8))


def _multiple(Q: Array, x: Complex) -> tuple[Array, NDArray[np.intp]]:
    """Real multiple solutions (k, 8), and how many paths ended at each."""
    refined: list[Array] = []
    counts: list[int] = []
    left = np.array([_refined(Q, row) for row in x], complex).reshape(-1, 8)
    while len(left):
        same = np.abs(left @ left[0].conj()) > 1.0 - 0.5 * _ONE**2
        point = _real(left[:1])[0]
        if np.abs(left[0].conj() @ point) > 1.0 - 0.5 * _ONE**2:
            refined.append(_refined(Q, point))
            counts.append(int(same.sum()))
        left = left[~same]
    return np.array(refined).reshape(-1, 8), np.array(counts, np.intp)
