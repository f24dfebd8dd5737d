r"""All poses of a six-legged platform from its leg lengths,
and the ends of the paths to them.

A pose is a point ``x = (c, g)`` of projective space P^7, c a quaternion and g the rest of
a dual quaternion, on the quadric ``c . g = 0`` ([StudyGeometrie]_; [HustyPlatform]_).
With rotation ``R b = c b c* / |c|^2`` and translation ``p = 2 g c* / |c|^2``, leg i of
length l from a to b is

    4 |g|^2 + (|a|^2 + |b|^2 - l^2) |c|^2 + 4 b . (c* g) - 4 a . (g c*) - 2 a . (c b c*) =
    0,

a quadric too. Seven quadrics in P^7 have, besides points without a rotation (``c . c =
0``), 40 solutions ([Wampler]_, [Raghavan]_). Their number is the certificate: 40
solutions of one general platform are known, and each is followed while that platform is
deformed into the wanted one. On a general path none is lost or reached twice; paths that
end at ``c . c = 0``, or where others end, are counted and named.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from functools import cache
from importlib.resources import files
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cartstiff.core import numerics
from cartstiff.core.arrays import Array, checked_vector
from cartstiff.core.errors import InputError
from cartstiff.core.mechanisms.platform import Platform

Complex = NDArray[np.complex128]

#: Solutions of a general platform.
PATHS = 40
# A step is chosen so that the predictor's error is `miss`; one with ten times that error
# is repeated. The first step, and the bound on their number.
_FIRST_STEP, _MAX_STEPS = 0.02, 2000


def _products() -> tuple[Array, Array, Array]:
    """Tensors (3, 4, 4) and (3, 3, 4, 4) of vec(c* g), vec(g c*), and a .
    (c b c*) in (c, g).
    """
    unit = np.eye(4)

    def times(p: Array, q: Array) -> Array:
        vector = p[0] * q[1:] + q[0] * p[1:] + np.cross(p[1:], q[1:])
        return np.append(p[0] * q[0] - p[1:] @ q[1:], vector)

    star = np.diag([1.0, -1.0, -1.0, -1.0])
    left = np.empty((3, 4, 4))
    right = np.empty((3, 4, 4))
    turned = np.empty((3, 3, 4, 4))
    for i, c in enumerate(unit):
        for j, g in enumerate(unit):
            left[:, i, j] = times(star @ c, g)[1:]
            right[:, i, j] = times(g, star @ c)[1:]
            for k in range(3):
                turned[:, k, i, j] = times(times(c, unit[k + 1]), star @ g)[1:]
    return left, right, 0.5 * (turned + turned.swapaxes(2, 3))


_LEFT, _RIGHT, _TURNED = _products()


def quadrics(anchors: NDArray, points: NDArray, squares: NDArray) -> NDArray:  # type: ignore[type-arg]
    """Symmetric matrices (7, 8, 8) of the six legs and of ``c . g``, for ``x^T Q x = 0``.

    Parameters
    ----------
    anchors, points : ndarray (6, 3)
        Real or complex; points in the frame whose pose is wanted.
    squares : ndarray (6,)
        Squares of the leg lengths.
    """
    Q = np.zeros((7, 8, 8), np.result_type(anchors, points, squares))
    norm = (anchors**2).sum(axis=1) + (points**2).sum(axis=1) - squares
    Q[:6, :4, :4] = norm[:, None, None] * np.eye(4) - 2.0 * np.einsum(
        "na,nb,abij->nij", anchors, points, _TURNED
    )
    mixed = 2.0 * (np.tensordot(points, _LEFT, 1) - np.tensordot(anchors, _RIGHT, 1))
    Q[:6, :4, 4:] = mixed
    Q[:6, 4:, :4] = mixed.swapaxes(1, 2)
    Q[:6, 4:, 4:] = 4.0 * np.eye(4)
    Q[6, :4, 4:] = Q[6, 4:, :4] = 0.5 * np.eye(4)
    return Q


def pose_of_study(x: Array) -> Array:
    """Poses (n, 4, 4) of real points x (n, 8)."""
    c = x[:, :4]
    square = (c * c).sum(axis=1)[:, None]
    T = np.zeros((len(x), 4, 4))
    T[:, :3, :3] = np.einsum("abij,ni,nj->nab", _TURNED, c, c) / square[:, :, None]
    T[:, :3, 3] = 2.0 * np.einsum("aij,ni,nj->na", _RIGHT, c, x[:, 4:]) / square
    T[:, 3, 3] = 1.0
    return T


@cache
def general_platform() -> tuple[Complex, Complex]:
    """Quadrics (7, 8, 8) of a general complex platform, and its 40 solutions (40, 8)."""
    with (
        (files(__package__) / "general_platform.npz").open("rb") as file,
        np.load(file) as data,
    ):
        Q = quadrics(data["anchors"], data["points"], data["squares"])
        return Q, np.asarray(data["solutions"])


def values(Q: NDArray, x: NDArray) -> NDArray:  # type: ignore[type-arg]
    """``x^T Q_i x`` (n, 7) at points x (n, 8)."""
    residuals: NDArray = np.einsum("nij,nj->ni", _matrices(Q, x), x)  # type: ignore[type-arg]
    return residuals


def jacobians(Q: NDArray, x: NDArray) -> NDArray:  # type: ignore[type-arg]
    """Derivatives (n, 8, 8) of the quadrics, and across x.

    Regular at single solutions.
    """
    return np.concatenate([2.0 * _matrices(Q, x), x.conj()[:, None]], axis=1)


def rotation_share(x: NDArray) -> Array:  # type: ignore[type-arg]
    """``|c . c| / |x|^2`` (n,): 0 of points that are no pose."""
    square = (x[:, :4] ** 2).sum(axis=1)
    return np.asarray(np.abs(square) / (np.abs(x) ** 2).sum(axis=1))


class Ends(NamedTuple):
    """Ends of paths.

    Attributes
    ----------
    x : ndarray (n, 8)
        Unit vectors.
    at : ndarray (n,)
        0 where the path has arrived; else the parameter at which it stopped.
    steps : int
        Steps in all.
    """

    x: Complex
    at: Array
    steps: int


def _matrices(Q: Complex, x: Complex) -> Complex:
    """``Q_i x`` (n, 7, 8)."""
    return (x @ Q.transpose(1, 0, 2).reshape(8, 56)).reshape(-1, 7, 8)


def _solved(J: Complex, x: Complex, right: Complex) -> Complex:
    """Steps (n, 8) across x with J (n, 7, 8) times the step equal to `right`."""
    matrix = np.concatenate([J, x.conj()[:, None]], axis=1)
    wanted = np.concatenate([right, np.zeros((len(x), 1))], axis=1)[..., None]
    try:
        return np.asarray(np.linalg.solve(matrix, wanted)[..., 0])
    except np.linalg.LinAlgError:
        return np.asarray((np.linalg.pinv(matrix) @ wanted)[..., 0])


def _norms(x: Complex) -> Array:
    return np.sqrt((x.real**2 + x.imag**2).sum(axis=-1))


def follow(
    start: Complex,
    end: NDArray,  # type: ignore[type-arg]
    x: Complex,
    miss: float = numerics.PREDICTOR_TOLERANCE,
) -> Ends:
    """Solutions of the quadrics `end`, from solutions x (n, 8) of the quadrics `start`.

    ``Q(t) = t start + (1 - t) end`` from t = 1 to 0: a Runge-Kutta step of fourth order
    and Newton's method, all paths at once, each with its own step.

    Parameters
    ----------
    start, end : ndarray (7, 8, 8)
        Complex; symmetric matrices.
    x : ndarray (n, 8)
        Complex; changed in place.
    miss : float
        Error of the predictor; a smaller one is slower, and jumps to another path more
        rarely.
    """
    n = len(x)
    x /= _norms(x)[:, None]
    t, step = np.ones(n), np.full(n, _FIRST_STEP)
    running = np.arange(n)
    change = end - start  # dQ / d(1 - t)

    def slope(x: Complex, t: Array) -> Complex:
        moved, at_start = _matrices(change, x), _matrices(start, x)
        J = at_start + (1.0 - t)[:, None, None] * moved
        return _solved(2.0 * J, x, -np.einsum("nij,nj->ni", moved, x))

    def corrected(x: Complex, t: Array) -> tuple[Complex, Array]:
        Qx = t[:, None, None] * _matrices(start, x) + (1.0 - t)[
            :, None, None
        ] * _matrices(end, x)
        moved = _solved(2.0 * Qx, x, -np.einsum("nij,nj->ni", Qx, x))
        return x + moved, _norms(moved)

    count = 0
    while running.size and count < _MAX_STEPS:
        count += 1
        old, at, h = x[running], t[running], step[running]
        h = np.minimum(h, at)
        half = 0.5 * h[:, None]
        k1 = slope(old, at)
        k2 = slope(old + half * k1, at - half[:, 0])
        k3 = slope(old + half * k2, at - half[:, 0])
        k4 = slope(old + h[:, None] * k3, at - h)
        guess = old + h[:, None] / 6.0 * (k1 + 2.0 * (k2 + k3) + k4)
        first, missed = corrected(guess, at - h)
        second, again = corrected(first, at - h)
        third, last = corrected(second, at - h)
        good = (
            (missed < 10.0 * miss)
            & (again < missed)
            & (last < numerics.ACCEPTED_RESIDUAL)
        )
        good &= np.isfinite(_norms(third))
        x[running[good]] = (third / _norms(third)[:, None])[good]
        t[running[good]] = (at - h)[good]
        with numerics.silent():
            factor = np.clip(0.9 * (miss / missed) ** 0.2, 0.2, 3.0)
        factor = np.where(good, factor, np.minimum(np.nan_to_num(factor, nan=0.2), 0.5))
        step[running] = h * factor
        # Near the end of a path that goes to no pose, or to the end of others.
        stuck = (t[running] < numerics.PATH_END) | (
            step[running] < 1e-3 * numerics.PATH_END
        )
        running = running[~stuck & (t[running] > 0.0)]
    return Ends(x, t, count)


# If a path is lost, or reaches another one, all are followed again on other paths: the
# start's equations are multiplied by another factor, and the predictor's error is reduced
# by a factor.
_WAYS = np.exp(1j * np.array([0.0, 2.4, 4.8, 1.0, 3.4]))
_FINER = 0.1
# A path whose parameter is below this is near its end, which is known to the root of it.
_NEAR_END = 1e-3
# Ends nearer than this (of unit vectors) are one multiple solution: four paths that meet
# are known to the fourth root of `numerics.CONSTRAINT_TOLERANCE`.
_ONE = 3e-3
# Distance from a multiple solution at which others beside it are sought: there the
# quadrics of an isolated one, even a fourfold one, are larger than
# `numerics.MULTIPLE_SOLUTION_RESIDUAL`.
_ASIDE = 0.05


@dataclass(frozen=True)
class PathCount:
    """Ends of the paths from the 40 solutions of a general platform.

    Attributes
    ----------
    single : int
        Paths that ended at solutions of their own, complex or real.
    real : int
        Real poses among these.
    multiple : int
        Paths that ended at a common solution: at singular poses.
    moving : int
        Paths that ended on curves of solutions: the platform moves although its legs do
        not.
    nowhere : int
        Paths that ended at points that are no pose: such solutions do not exist for this
        platform.
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
        return f"{PATHS} paths: " + ", ".join(f"{n} {what}" for n, what in parts if n)

    def to_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {"total": PATHS, **asdict(self), "complete": self.is_complete}


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

    The 40 solutions of a general platform are followed to this one (see the module).

    Parameters
    ----------
    platform : Platform
        With six legs, not singular in every pose (`cartstiff.wings.reach.architecture`).
    lengths : array_like (6,)
        Above zero.

    Raises
    ------
    InputError
        If there are not six legs, or a length is not above zero.
    """
    if len(platform.points) != 6:
        raise InputError(
            "all assembly modes are found for six legs only",
            got=str(len(platform.points)),
        )
    wanted = checked_vector(lengths, 6, "list of leg lengths")
    if np.any(wanted <= 0):
        raise InputError(
            "leg lengths must be positive numbers", expected="6", got=wanted.tolist()
        )
    # Equations in study coordinates, scaled to a platform of size 1.
    at, of = platform.anchors.mean(axis=0), platform.points.mean(axis=0)
    anchors, points = platform.anchors - at, platform.points - of
    size = max(float(np.ptp(anchors, axis=0).max()), float(np.ptp(points, axis=0).max()))
    size = size or float(wanted.max())
    Q = quadrics(anchors / size, points / size, (wanted / size) ** 2)
    ends, single = _followed(Q)
    x, share = ends.x, rotation_share(ends.x)
    # Ends of paths: single solutions, none, several that meet, or points of a curve.
    lost = ~single & (ends.at > _NEAR_END)
    no_pose = ~single & ~lost & (share < numerics.LEAST_ROTATION_SHARE)
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
    # Back to the platform's own size and origin.
    curve = _real_on_curve(Q, x[rest[moving]])
    poses = pose_of_study(np.vstack([real, several, curve]))
    poses[:, :3, 3] = poses[:, :3, 3] * size + at - poses[:, :3, :3] @ of
    k = len(real) + len(several)
    one_each = np.ones(len(real), np.intp)
    return Poses(
        poses[:k], np.concatenate([one_each, counts]), paths, poses[k:].reshape(-1, 4)[:4]
    )


def _followed(Q: Array) -> tuple[Ends, NDArray[np.bool_]]:
    """Ends of all paths, and which are solutions of their own.

    With finer steps where need be.
    """
    start, solutions = general_platform()
    miss = numerics.PREDICTOR_TOLERANCE
    for way in _WAYS:
        ends = follow(way * start, Q, solutions.copy(), miss)
        sizes = np.linalg.svd(jacobians(Q, ends.x), compute_uv=False)
        single = (ends.at == 0.0) & (
            sizes[:, -1] > numerics.USUAL_RANK_RATIO * sizes[:, 0]
        )
        if not _coinciding(ends.x[single]) and not np.any(ends.at > _NEAR_END):
            break
        miss *= _FINER
    return ends, single


def _coinciding(x: Complex) -> int:
    """How many of the unit vectors are also in front of themselves in the list."""
    overlap = np.triu(np.abs(x.conj() @ x.T), 1)
    return int((overlap > 1.0 - 0.5 * numerics.NEGLIGIBLE_DISTANCE**2).any(axis=0).sum())


def _real(x: Complex) -> Array:
    """Real parts (n, 8) of points, each with its largest component made real."""
    largest = np.take_along_axis(x, np.abs(x).argmax(axis=1)[:, None], 1)
    real = (x * (np.abs(largest) / largest)).real
    return np.asarray(real / np.linalg.norm(real, axis=1)[:, None])


def _real_points(Q: Array, x: Complex) -> Array:
    """Those solutions (k, 8) that are their own conjugates,
    by Newton's method in real numbers.
    """
    if not len(x):
        return np.empty((0, 8))
    nearest = np.abs(x @ x.T).argmax(axis=1)
    roots = _real(x[nearest == np.arange(len(x))])
    for _ in range(3):
        right = np.concatenate([values(Q, roots), np.zeros((len(roots), 1))], axis=1)
        roots = roots - np.linalg.solve(jacobians(Q, roots), right[..., None])[..., 0]
        roots /= np.linalg.norm(roots, axis=1)[:, None]
    return roots


def _refined(Q: Array, x: NDArray) -> NDArray:  # type: ignore[type-arg]
    """Point (8,) near x on the quadrics, by steps of least size across what
    is singular.
    """
    for _ in range(8):
        J = jacobians(Q, x[None])[0]
        right = np.append(values(Q, x[None])[0], 0.0)
        x = x - np.linalg.lstsq(J, right, rcond=_ONE)[0]
        x = x / np.linalg.norm(x)
    return x


def _is_on_curve(Q: Array, x: Complex) -> bool:
    """Whether other solutions lie beside a multiple one, however near."""
    x = _refined(Q, x)
    _, sizes, right = np.linalg.svd(jacobians(Q, x[None])[0])
    aside = right[sizes <= _ONE * sizes[0]].conj().sum(axis=0)
    if not aside.any():
        return False
    aside /= np.linalg.norm(aside)
    y = x + _ASIDE * aside
    for _ in range(20):
        J = np.vstack([jacobians(Q, y[None])[0][:7], x.conj(), aside.conj()])
        errors = [*values(Q, y[None])[0], np.vdot(x, y) - 1.0, np.vdot(aside, y) - _ASIDE]
        y = y - np.linalg.lstsq(J, np.array(errors), rcond=None)[0]
    return bool(np.abs(errors).max() < numerics.MULTIPLE_SOLUTION_RESIDUAL)


def _real_on_curve(Q: Array, x: Complex) -> Array:
    """The first real point (1, 8) on curves of solutions that points x lead to,
    or (0, 8).
    """
    for row in x:
        point = _refined(Q, _real(row[None])[0])
        met = np.abs(values(Q, point[None])).max() < numerics.CONSTRAINT_TOLERANCE
        if (
            met
            and rotation_share(point[None])[0] > numerics.LEAST_ROTATION_SHARE
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
