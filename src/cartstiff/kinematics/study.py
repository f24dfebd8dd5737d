r"""All poses of a six-legged platform with given leg lengths: 40 complex ones, followed from known.

A pose is a point ``x = (c, g)`` of projective space P^7, c a quaternion and g the rest of a dual
quaternion, on the quadric ``c . g = 0`` ([StudyGeometrie]_; [HustyPlatform]_). With rotation
``R b = c b c* / |c|^2`` and translation ``p = 2 g c* / |c|^2``, leg i of length l from a to b is

    4 |g|^2 + (|a|^2 + |b|^2 - l^2) |c|^2 + 4 b . (c* g) - 4 a . (g c*) - 2 a . (c b c*) = 0,

a quadric too. Seven quadrics in P^7 have, besides points without a rotation (``c . c = 0``), 40
solutions ([Wampler]_, [Raghavan]_). Their number is the certificate: 40 solutions of one general
platform are known, and each is followed while that platform turns into the wanted one. On a
general path none is lost or met twice; what ends at ``c . c = 0``, or where others end, is counted
and named.
"""

from __future__ import annotations

from functools import cache
from importlib.resources import files
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cartstiff import numerics
from cartstiff.geometry.se3 import Array

Complex = NDArray[np.complex128]

#: Solutions of a general platform.
PATHS = 40
# A step is chosen so that the predictor misses by `miss`; one that misses by ten times that is
# repeated.
_FIRST_STEP = 0.02
_MOST_STEPS = 2000


def _products() -> tuple[Array, Array, Array]:
    """Tensors (3, 4, 4) and (3, 3, 4, 4) of vec(c* g), vec(g c*), and a . (c b c*) in (c, g)."""
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
    with (files(__package__) / "general_platform.npz").open("rb") as file, np.load(file) as data:
        Q = quadrics(data["anchors"], data["points"], data["squares"])
        return Q, np.asarray(data["solutions"])


def values(Q: NDArray, x: NDArray) -> NDArray:  # type: ignore[type-arg]
    """``x^T Q_i x`` (n, 7) at points x (n, 8)."""
    residuals: NDArray = np.einsum("nij,nj->ni", _matrices(Q, x), x)  # type: ignore[type-arg]
    return residuals


def jacobians(Q: NDArray, x: NDArray) -> NDArray:  # type: ignore[type-arg]
    """Derivatives (n, 8, 8) of the quadrics, and across x; regular at single solutions."""
    return np.concatenate([2.0 * _matrices(Q, x), x.conj()[:, None]], axis=1)


def rotation_share(x: NDArray) -> Array:  # type: ignore[type-arg]
    """``|c . c| / |x|^2`` (n,): 0 of points that are no pose."""
    square = (x[:, :4] ** 2).sum(axis=1)
    return np.asarray(np.abs(square) / (np.abs(x) ** 2).sum(axis=1))


class Ends(NamedTuple):
    """Where paths have led to.

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
    """Steps (n, 8) across x for which J (n, 7, 8) makes `right`; zeros where there is none."""
    matrix = np.concatenate([J, x.conj()[:, None]], axis=1)
    wanted = np.concatenate([right, np.zeros((len(x), 1))], axis=1)[..., None]
    try:
        return np.asarray(np.linalg.solve(matrix, wanted)[..., 0])
    except np.linalg.LinAlgError:
        return np.asarray((np.linalg.pinv(matrix) @ wanted)[..., 0])


def _norms(x: Complex) -> Array:
    return np.sqrt((x.real**2 + x.imag**2).sum(axis=-1))


def follow(start: Complex, end: NDArray, x: Complex, miss: float = numerics.FOLLOWED) -> Ends:  # type: ignore[type-arg]
    """Solutions of the quadrics `end`, from solutions x (n, 8) of the quadrics `start`.

    ``Q(t) = t start + (1 - t) end`` from t = 1 to 0: a Runge-Kutta step of fourth order and
    Newton's method, all paths at once, each with its own step.

    Parameters
    ----------
    start, end : ndarray (7, 8, 8)
        Complex; symmetric matrices.
    x : ndarray (n, 8)
        Complex; changed in place.
    miss : float
        What the predictor may miss by; smaller is slower, and jumps to another path less.
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
        Qx = t[:, None, None] * _matrices(start, x) + (1.0 - t)[:, None, None] * _matrices(end, x)
        moved = _solved(2.0 * Qx, x, -np.einsum("nij,nj->ni", Qx, x))
        return x + moved, _norms(moved)

    count = 0
    while running.size and count < _MOST_STEPS:
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
        good = (missed < 10.0 * miss) & (again < missed) & (last < numerics.ACCEPTED_RESIDUAL)
        good &= np.isfinite(_norms(third))
        x[running[good]] = (third / _norms(third)[:, None])[good]
        t[running[good]] = (at - h)[good]
        with np.errstate(divide="ignore", invalid="ignore"):
            factor = np.clip(0.9 * (miss / missed) ** 0.2, 0.2, 3.0)
        factor = np.where(good, factor, np.minimum(np.nan_to_num(factor, nan=0.2), 0.5))
        step[running] = h * factor
        # Near the end of a path that goes to nowhere, or to where others go.
        stuck = (t[running] < numerics.PATH_END) | (step[running] < 1e-3 * numerics.PATH_END)
        running = running[~stuck & (t[running] > 0.0)]
    return Ends(x, t, count)
