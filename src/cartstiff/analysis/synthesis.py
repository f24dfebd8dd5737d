"""Springs that realise a given symmetric stiffness.

In ``K = sum k w w^T`` the trace of the coupling block, ``tr K_rt = sum k h`` over springs of pitch
h, is the same in every frame, and line and torsional springs have none. Hence

    K = sum of line and torsional springs   <=>   K >= 0 and tr K_rt = 0

([Loncaric]_, [HuangSchimmels]_, [Roberts]_), with as many springs as the rank of K. Other
positive semidefinite matrices need screw springs as well.

The construction here: any factor K = F F^T may be turned, F Q with Q orthogonal. The columns' own
f . m are half the diagonal of Q^T N Q, N = F^T Delta F, whose sum is 2 tr K_rt. By the theorem of
Schur and Horn the diagonal can be chosen freely as long as the eigenvalues of N majorise it: zeros
if the trace is zero; else zeros but for s equal entries, s the smallest number whose largest
eigenvalues add up to the trace. Fewer than s screw springs cannot do, whatever the number of line
springs: s of them, with sum k w w^T <= K, carry at most the s largest eigenvalues of N.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from cartstiff import numerics
from cartstiff.analysis.asymmetry import largest_in_blocks
from cartstiff.analysis.indices import spectrum
from cartstiff.analysis.matrices import (
    ROTATION,
    TRANSLATION,
    balancing_length,
    block_scales,
    symmetric_pair,
)
from cartstiff.analysis.screws import SWAP_FORM, screw_of_wrench
from cartstiff.arrays import Array, Result
from cartstiff.errors import UndefinedError


@dataclass(frozen=True, eq=False)
class Spring(Result):
    """One spring of a parallel connection.

    Attributes
    ----------
    kind : {"line", "screw", "torsional"}
        Line: a force along a line. Screw: with a moment about the same line. Torsional: a moment.
    stiffness : float
        Positive; force per length, or moment per angle for a torsional spring.
    direction : ndarray, shape (3,)
        Unit vector of the force (of the moment, if torsional).
    point : ndarray, shape (3,)
        Point of the line nearest to the origin; zero for a torsional spring.
    pitch : float
        Moment over force; 0 for a line spring, infinite for a torsional one.
    """

    kind: Literal["line", "screw", "torsional"]
    stiffness: float
    direction: Array
    point: Array
    pitch: float

    @property
    def wrench(self) -> Array:
        """Wrench (moment, force) per unit of load, shape (6,)."""
        if self.kind == "torsional":
            return np.concatenate([self.direction, np.zeros(3)])
        moment = np.cross(self.point, self.direction) + self.pitch * self.direction
        return np.concatenate([moment, self.direction])


def parallel_stiffness(springs: Iterable[Spring]) -> Array:
    """Stiffness (6, 6) of unloaded springs in parallel: sum of k w w^T."""
    K = np.zeros((6, 6))
    for spring in springs:
        K += spring.stiffness * np.outer(spring.wrench, spring.wrench)
    return K


# Number of turned factors of which the best is kept.
_ATTEMPTS = 8


@dataclass(frozen=True, eq=False)
class Realisability(Result):
    """Whether springs can realise a stiffness, and which.

    Attributes
    ----------
    passive : bool
        Whether K is positive semidefinite, as that of any unloaded springs is.
    by_line_springs : bool
        Whether line (and torsional) springs suffice.
    trace : float
        tr K_rt (force per angle).
    relative_trace : float
        Its size beside ``sqrt(|K_rr| |K_tt|)``; below 1e-10 it counts as zero.
    rank : int
        Number of springs needed.
    screw_springs : int
        How many of them must be screw springs; 0 if line springs suffice or K is not passive.
    eigenvalues : ndarray, shape (6,)
        Eigenvalues of K on balanced units, relative to the largest; `passive` and `rank` follow.
    """

    passive: bool
    by_line_springs: bool
    trace: float
    relative_trace: float
    rank: int
    screw_springs: int
    eigenvalues: Array


def realisability(stiffness: ArrayLike, compliance: ArrayLike | None = None) -> Realisability:
    """Judge a symmetric stiffness, without constructing anything.

    With the compliance, the inverse if it is known, no small eigenvalue is taken for rounding.

    Raises
    ------
    UndefinedError
        Code ``"ill-conditioned"`` where neither stiffness nor compliance resolves an eigenvalue.
    """
    K, C = symmetric_pair(stiffness, compliance)
    return _judged(K, *spectrum(K, balancing_length(K), C)[:2])


def _judged(K: Array, values: Array, vectors: Array) -> Realisability:
    largest = float(np.abs(values).max())
    relative = values / largest if largest > 0 else values
    trace = float(np.trace(K[ROTATION, TRANSLATION]))
    size = float(block_scales(K)[0, 1])
    share = abs(trace) / size if size > 0 else 0.0
    passive = bool(np.all(relative >= 0.0))
    screws = 0
    if passive and share > numerics.ZERO_SHARE:
        F = vectors * np.sqrt(relative)
        mu = np.linalg.eigvalsh(F.T @ SWAP_FORM @ F)
        screws = _screw_count(mu, float(mu.sum()))
    return Realisability(
        passive,
        passive and screws == 0,
        trace,
        share,
        int(np.count_nonzero(relative)),
        screws,
        relative,
    )


@dataclass(frozen=True, eq=False)
class Realisation(Result):
    """Springs and how well they reproduce the matrix.

    Attributes
    ----------
    springs : tuple of Spring
        As many as the rank of K.
    residual : float
        Largest entry of the difference, relative to the size of its block.
    judgement : Realisability
        Why these kinds of spring.
    """

    springs: tuple[Spring, ...]
    residual: float
    judgement: Realisability

    @property
    def stiffness(self) -> Array:
        """The matrix (6, 6) of the springs."""
        return parallel_stiffness(self.springs)


def _screw_count(mu: Array, trace: float) -> int:
    """Fewest screw springs: how many of the largest eigenvalues (of the trace's sign) reach it."""
    signed = np.sort(mu * np.sign(trace))[::-1]
    reached = np.cumsum(signed) >= abs(trace) * (1.0 - numerics.ROUNDOFF)
    return int(np.argmax(reached)) + 1


def _split(F: Array, straight: bool) -> tuple[Array, Array]:
    """Columns that carry the trace in equal shares, and the others, whose traces add to zero."""
    mu, Y = np.linalg.eigh(F.T @ SWAP_FORM @ F)
    F = F @ Y
    trace = float(mu.sum())
    if straight or not len(mu):
        return F[:, :0], F
    count = _screw_count(mu, trace)
    share = trace / count
    screws = []
    for _ in range(count):
        order = np.argsort(mu)
        F, mu = F[:, order], mu[order]
        # A pair of neighbours around the share: turning it keeps the rest majorised.
        j = int(np.clip(np.searchsorted(mu, share), 1, max(len(mu) - 1, 1)))
        if len(mu) == 1:
            screws.append(F[:, 0])
            F, mu = F[:, :0], mu[:0]
            break
        gap = mu[j] - mu[j - 1]
        part = float(np.clip((share - mu[j - 1]) / gap, 0.0, 1.0)) if gap > 0 else 1.0
        c, s = np.sqrt(part), np.sqrt(1.0 - part)
        high, low = F[:, j].copy(), F[:, j - 1].copy()
        screws.append(c * high + s * low)
        F[:, j - 1], mu[j - 1] = c * low - s * high, mu[j] + mu[j - 1] - share
        F, mu = np.delete(F, j, axis=1), np.delete(mu, j)
    return np.column_stack(screws), F


def _straighten(F: Array) -> Array:
    """Turn the columns of F, whose w^T Delta w add to zero, until every one is zero."""
    F = F.copy()
    todo = list(range(F.shape[1]))
    while len(todo) > 1:
        N = F.T @ SWAP_FORM @ F
        d = np.diag(N)
        i = min(todo, key=lambda c: abs(float(d[c])))
        todo.remove(i)
        j = max(todo, key=lambda c: -float(d[c] * d[i]))
        if d[i] * d[j] >= 0.0:
            continue  # both are zero up to rounding
        # tan of the angle from the root of d_i + 2 n_ij t + d_j t^2 = 0 without cancellation.
        # Columns are as a rule at right angles at first: no root is chosen by the sign of rounding.
        root = float(np.sqrt(N[i, j] ** 2 - d[i] * d[j]))
        s = N[i, j] + (root if N[i, j] >= -numerics.ROUNDOFF * root else -root)
        t = -d[i] / s
        c = 1.0 / np.sqrt(1.0 + t * t)
        F[:, [i, j]] = F[:, [i, j]] @ np.array([[c, -t * c], [t * c, c]])
    return F


def _with_signs(F: Array) -> Array:
    """The columns with their first large entry positive, independent of the LAPACK routine."""
    size = np.abs(F)
    if not size.size:
        return F
    first = np.argmax(size >= 0.9 * size.max(axis=0), axis=0)
    return np.asarray(F * np.sign(F[first, np.arange(F.shape[1])]))


def realise(
    stiffness: ArrayLike, length: float | None = None, compliance: ArrayLike | None = None
) -> Realisation:
    r"""Springs in parallel that realise a symmetric positive semidefinite stiffness.

    Line springs where the trace condition holds (with torsional ones only where K forces them),
    otherwise line springs and the fewest screw springs. Among a few turned factors the one whose
    lines pass nearest to the origin is kept; the same matrix always gives the same springs.

    Parameters
    ----------
    stiffness : array_like, shape (6, 6)
        Symmetric, positive semidefinite.
    length : float, optional
        Size by which moments are compared with forces; default balances the blocks of K.
    compliance : array_like, shape (6, 6), optional
        The inverse, if it is known better than by inversion.

    Raises
    ------
    UndefinedError
        Code ``"not-passive"`` if K has a negative eigenvalue; code ``"ill-conditioned"`` where the
        digits of springs do not resolve the softer directions of their sum.
    """
    K, C = symmetric_pair(stiffness, compliance)
    judgement = realisability(K, C)
    if not judgement.passive:
        raise UndefinedError(
            "no unloaded springs give this stiffness: it has a negative eigenvalue",
            code="not-passive",
            values={"relative_eigenvalues": judgement.eigenvalues.tolist()},
        )
    scale = balancing_length(K) if length is None else length
    values, vectors, _ = spectrum(K, scale, C)
    kept = values > 0.0
    screws, rest = _split(vectors[:, kept] * np.sqrt(values[kept]), judgement.by_line_springs)
    rest = _with_signs(rest)
    rng = np.random.default_rng(0)
    lines, best = rest, -1.0
    for attempt in range(_ATTEMPTS if rest.shape[1] else 0):
        turned = rest
        if attempt:
            turned = rest @ np.linalg.qr(rng.standard_normal((rest.shape[1], rest.shape[1])))[0]
        columns = _straighten(turned)
        sizes = np.linalg.norm(columns, axis=0)
        quality = float((np.linalg.norm(columns[3:], axis=0) / sizes).min())
        if quality > best + numerics.ROUNDOFF * abs(best):
            lines, best = columns, quality
    unscale = np.repeat([scale, 1.0], 3)
    springs = tuple(_spring(w * unscale, scale, True) for w in lines.T)
    springs += tuple(_spring(w * unscale, scale, False) for w in screws.T)
    back = vectors[:, kept] / np.sqrt(values[kept]) / unscale[:, None]
    _require_digits(springs, back)
    residual = largest_in_blocks(parallel_stiffness(springs) - K, K)
    return Realisation(springs, float(residual), judgement)


def _require_digits(springs: tuple[Spring, ...], back: Array) -> None:
    """Refuse springs that differ from K along a motion: ``back^T K back = 1`` for K, (6, r)."""
    sums = sum(s.stiffness * np.outer(back.T @ s.wrench, back.T @ s.wrench) for s in springs)
    error = float(np.abs(sums - np.eye(back.shape[1])).max(initial=0.0))
    if error > numerics.LOST_ERROR:
        raise UndefinedError(
            "springs in parallel add up to this stiffness only along its stiffer directions: "
            "their digits do not hold the softer ones",
            code="ill-conditioned",
            values={"missed_share": error},
        )


def _spring(w: Array, length: float, straight: bool) -> Spring:
    moment, force = w[:3], w[3:]
    size = float(np.linalg.norm(force))
    if size * length <= numerics.NEGLIGIBLE_DIFFERENCE * float(np.linalg.norm(moment)):
        k = float(moment @ moment)
        return Spring("torsional", k, moment / np.sqrt(k), np.zeros(3), float("inf"))
    screw = screw_of_wrench(w, length)
    return Spring(
        "line" if straight else "screw",
        size**2,
        screw.direction,
        screw.point,
        0.0 if straight else screw.pitch,
    )
