r"""Struts between a compliant base and a compliant platform:
two 6x6 springs in series with them.

From the ground to the body: the spring of the base, the struts in parallel, the spring of
the platform. A spring is three slides and three hinges about x, y, z in a row, as in a
compliant link; the struts add six coordinates for the relative pose T' of their ends,
whose Hessian is their K^B. With coordinates x of the base and y of the platform, the body
Jacobian J of all three at M and the wrench W on the body,

    K_b x = J_x^T W,    W_s(T') = J_s^T W,    K_p y = J_y^T W,    D_b(x) T' D_p(y) = T,

and K^B is the Schur complement of equation (2) in
`cartstiff.files.struts.flexure_struts`, without terms of S_W within T'.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, ClassVar, NamedTuple, Self

import numpy as np

from cartstiff.core import numerics
from cartstiff.core.arrays import Array
from cartstiff.core.geometry import se3
from cartstiff.core.lazily import cached_property
from cartstiff.core.potentials.contract import POSE, Number, Posture
from cartstiff.core.potentials.line_springs import lines_of_many
from cartstiff.files.struts.flexure_struts import (
    ROUNDINGS,
    FlexureStruts,
    StrutStates,
    solved,
    turned,
)

#: Names of the springs of base and platform, with their attributes.
_MOUNTS = {"stiffness.base (link)": "base", "stiffness.platform (link)": "tip"}
_MAX_STEPS = 40
#: Newton steps for rest lengths, which start close to them.
_WINDING_STEPS = 6


class Mount(NamedTuple):
    """A 6x6 spring between the ground and the base, or between the platform and the body.

    Attributes
    ----------
    place : ndarray (4, 4)
        Pose of the spring, in F or in M.
    stiffness : ndarray (6, 6)
        Symmetric and positive definite, for slides along x, y, z and hinges about x, y,
        z.
    """

    place: Array
    stiffness: Array

    @property
    def length_powers(self) -> dict[str, Array]:
        """See `cartstiff.core.potentials.contract.rescaled`."""
        slides = np.repeat([1.0, 0.0], 3)
        return {"place": POSE, "stiffness": 1.0 - slides - slides[:, None]}

    def displaced(self, x: Array) -> tuple[Array, Array]:
        """Motion (N, 4, 4) of the far side for coordinates x (N, 6),
        and its body Jacobian.
        """
        R, axes = turned(x[:, 3:])
        J = np.zeros((len(x), 6, 6))
        J[:, :3, 3:], J[:, 3:, :3] = axes, R.swapaxes(-1, -2)
        motion = self.place @ se3.pose(R, x[:, :3]) @ se3.inverse(self.place)
        return motion, se3.adjoint(self.place) @ J


@dataclass(frozen=True, kw_only=True, eq=False)
class MountedStruts(FlexureStruts):
    """Struts on a compliant base, or with a compliant platform.

    Attributes
    ----------
    base, tip : Mount or None
        None if rigid.
    """

    base: Mount | None = None
    tip: Mount | None = None

    length_powers: ClassVar = {**FlexureStruts.length_powers, "base": 0, "tip": 0}

    def numbers(
        self, names: Sequence[str], slides: Sequence[bool] | None = None
    ) -> dict[str, Number]:
        """Those of the struts, and a factor on the spring of each compliant body."""
        return super().numbers(names, slides) | {
            name: Number(1.0, is_positive=True)
            for name, end in _MOUNTS.items()
            if getattr(self, end) is not None
        }

    def with_numbers(self, values: Mapping[str, float], names: Sequence[str]) -> Self:
        """The same with some of `numbers` changed."""
        mounts: dict[str, Any] = {
            end: Mount(mount.place, values.get(name, 1.0) * mount.stiffness)
            for name, end in _MOUNTS.items()
            if (mount := getattr(self, end))
        }
        return replace(super().with_numbers(values, names), **mounts)

    @staticmethod
    def of(struts: FlexureStruts, base: Mount | None, tip: Mount | None) -> MountedStruts:
        """The same struts between springs."""
        own = {field.name: getattr(struts, field.name) for field in fields(FlexureStruts)}
        return MountedStruts(**own, base=base, tip=tip)

    def lengths_at(self, T_a_b: Array) -> Array:
        """Distances (m,) of the struts' ends at a pose of M,
        with base and platform deflected.
        """
        if not self.is_complete:
            return super().lengths_at(T_a_b)
        return super().lengths_at(
            self._at_rest_in(T_a_b[None], self.rest_length[None]).T[0]
        )

    def positions(self, posture: Posture) -> Array:
        """The lengths, see `lengths_at`."""
        return self.lengths_at(posture.relative(self.frame_a, self.frame_b)[0])

    def wound(self, T_a_b: Array, tensions: Array) -> Array:
        """Rest lengths (N, m) of struts with tensions (m,),
        with base and platform deflected.
        """
        lines = lines_of_many(T_a_b, self.anchors, self.points)
        W, before = tensions @ lines.lines, lines.lengths
        for _ in range(_MAX_STEPS if tensions.any() else 0):
            at = self._bearing(T_a_b, W)
            lines = lines_of_many(at.T, self.anchors, self.points)
            # The wrench on the struts' ends is W, pulled back to there.
            to_end = at.J[..., self._struts].swapaxes(-1, -2)
            W = solved(to_end, (tensions @ lines.lines)[..., None])[..., 0]
            moved = numerics.largest(lines.lengths - before)
            if not moved > numerics.ROUNDOFF * self.made.max():
                break
            before = lines.lengths
        return self._exactly_wound(
            T_a_b, tensions, lines.lengths - tensions / self.stiffness
        )

    def _exactly_wound(self, T: Array, tensions: Array, rest: Array) -> Array:
        """Rest lengths (N, m) near given ones, by Newton's method:
        bent struts turn the mounts.
        """
        for _ in range(_WINDING_STEPS if tensions.any() else 0):
            missed = self._tensions_of(T, rest) - tensions
            if (
                not np.abs(missed).max()
                > numerics.NEGLIGIBLE_DIFFERENCE * np.abs(tensions).max()
            ):
                break
            step = numerics.NEGLIGIBLE_DISTANCE * float(self.made.max())
            changed = [
                self._tensions_of(T, rest + step * e) for e in np.eye(len(self.made))
            ]
            rates = (np.stack(changed, axis=-1) - (missed + tensions)[..., None]) / step
            better = rest - solved(rates, missed[..., None])[..., 0]
            rest = np.where(np.isfinite(better).all(axis=-1, keepdims=True), better, rest)
        return np.asarray(rest)

    def _tensions_of(self, T: Array, rest: Array) -> Array:
        """Tensions (N, m) of rest lengths (N, m) at M's poses."""
        ends = self._at_rest_in(T, rest).T
        lengths = lines_of_many(ends, self.anchors, self.points).lengths
        return np.asarray(self.stiffness * (lengths - rest))

    @np.errstate(over="ignore", invalid="ignore")
    def solve(
        self,
        T_a_b: Array,
        rest_length: Array,
        gradient: Array | None = None,
        free: Any = None,
    ) -> StrutStates:
        """As for struts alone; each strut has an equal share of the springs'
        energy and of K^B.
        """
        if gradient is None:
            at = self._at_rest_in(T_a_b, rest_length)
            own = super().solve(at.T, rest_length)
        else:
            at = self._bearing(T_a_b, np.broadcast_to(gradient, (len(T_a_b), 6)))
            own = super().solve(
                at.T, rest_length, _pulled(at.J[..., self._struts], at.W), free
            )
        # K^B from the inverse of the chain's matrix with multipliers; stable if the rest
        # is positive.
        M, sizes = self._matrix(at, own.stiffness.sum(axis=1))
        n, m = len(sizes) - 6, len(self.made)
        inverse = solved(M, np.broadcast_to(np.eye(n + 6), M.shape))
        K = inverse[:, n:, n:] * np.outer(sizes[n:], sizes[n:]) / m
        M[:, :n, n:] *= -1.0
        stable = (np.linalg.eigvalsh(np.nan_to_num(M)) > 0.0).sum(axis=-1) == n
        energy = 0.5 * (at.q * (at.q @ self._springs)).sum(axis=-1)
        to_end = np.linalg.inv(at.J[..., self._struts]).swapaxes(-1, -2)
        return StrutStates(
            own.energy + energy[:, None] / m,
            (to_end[:, None] @ own.wrench[..., None])[..., 0],
            np.repeat(0.5 * (K + K.swapaxes(-1, -2))[:, None], m, axis=1),
            own.rest_length,
            own.is_found & at.is_found[:, None],
            own.is_stable & stable[:, None],
        )

    @np.errstate(over="ignore", invalid="ignore")
    def _bearing(self, T: Array, W: Array) -> _Row:
        """The chain under W (N, 6) at M's poses T,
        by fixed-point steps for the springs.
        """
        q = np.zeros((len(T), len(self._springs)))
        sprung = np.delete(np.arange(q.shape[1]), self._struts)
        compliance = np.zeros_like(self._springs)
        own = np.ix_(sprung, sprung)
        compliance[own] = np.linalg.inv(self._springs[own])
        settled = np.zeros(len(T), bool)
        for _ in range(_MAX_STEPS):
            pulled = _pulled(self._row(T, q, W).J, W) @ compliance
            settled = abs(pulled - q).max(axis=1) <= numerics.ROUNDOFF * np.abs(
                pulled
            ).max(axis=1)
            q = pulled
            if settled.all() or not np.isfinite(q).all():
                break
        return self._row(T, q, W)._replace(is_found=settled)

    @np.errstate(
        over="ignore", invalid="ignore"
    )  # a diverging search has `is_found` False
    def _at_rest_in(self, T: Array, rest_length: Array) -> _Row:
        """The chain at rest at M's poses T, by Newton's method for
        coordinates, T' and W.
        """
        N, struts = len(T), self._struts
        at = self._row(T, np.zeros((N, len(self._springs))), np.zeros((N, 6)))
        settled, missed = np.zeros(N, bool), np.full(N, np.inf)
        whole = float((np.sqrt(self.slides) * self.made).max())
        for _ in range(_MAX_STEPS):
            own = super().solve(at.T, rest_length)
            M, sizes = self._matrix(at, own.stiffness.sum(axis=1))
            # Missing balance and missing pose; a row is settled once round-off is all
            # that is left.
            pull = _pulled(at.J, at.W) - at.q @ self._springs
            pull[:, struts] -= own.wrench.sum(axis=1)
            gap = se3.log(se3.inverse(at.base @ at.T @ at.tip) @ T)
            right = np.hstack([pull, gap]) * sizes
            now = np.abs(right).max(axis=-1)
            settled |= (now >= 0.5 * missed) & (now <= numerics.ROUNDOFF * whole)
            settled |= now <= ROUNDINGS * numerics.EPSILON * whole
            if np.all(settled | ~np.isfinite(now)):
                break
            missed = np.fmin(missed, now)
            step = solved(M, right[..., None])[..., 0] * sizes
            step = np.where(settled[:, None], 0.0, step)
            pose = at.T @ se3.exp(step[:, struts])
            step[:, struts] = 0.0
            at = self._row(T, at.q + step[:, :-6], at.W + step[:, -6:], pose)
        return at._replace(is_found=settled)

    @property
    def _struts(self) -> slice:
        """Indices of the struts' pose among the coordinates."""
        first = 0 if self.base is None else 6
        return slice(first, first + 6)

    @cached_property
    def _springs(self) -> Array:
        """Stiffnesses (n, n) of the springs at base and tip.

        Zero for the struts' pose.
        """
        n = self._struts.stop + 6 * (self.tip is not None)
        K = np.zeros((n, n))
        if self.base is not None:
            K[:6, :6] = self.base.stiffness
        if self.tip is not None:
            K[-6:, -6:] = self.tip.stiffness
        return K

    def _row(self, T: Array, q: Array, W: Array, struts: Array | None = None) -> _Row:
        """The chain at coordinates q, the struts at a pose or at that which
        closes the chain.
        """
        base = tip = np.broadcast_to(np.eye(4), (len(T), 4, 4))
        parts = []
        if self.base is not None:
            base, J = self.base.displaced(q[:, :6])
            parts.append(J)
        if self.tip is not None:
            tip, J_tip = self.tip.displaced(q[:, -6:])
        if struts is None:
            struts = se3.inverse(base) @ T @ se3.inverse(tip)
        parts = [se3.adjoint_of_inverse(struts @ tip) @ J for J in parts]
        parts.append(se3.adjoint_of_inverse(tip))
        if self.tip is not None:
            parts.append(J_tip)
        J = np.concatenate(parts, axis=-1)
        return _Row(struts, q, W, base, tip, J, np.ones(len(T), bool))

    def _matrix(self, at: _Row, K: Array) -> tuple[Array, Array]:
        """``[[H, -J^T], [J, 0]]`` (N, n + 6, n + 6), scaled by sizes, and these."""
        n, own = len(self._springs), self._struts
        H = -se3.chain_curvature(at.J, at.W)
        H[:, own, own] = K
        H += self._springs
        made, k = float(self.made.mean()), float(np.sqrt(self.stiffness).mean())
        sizes = np.zeros(n + 6)
        sizes[:n] = 1.0 / np.sqrt(np.maximum(np.diag(self._springs), numerics.TINY))
        sizes[own], sizes[n:] = (
            np.repeat([1 / made, 1.0], 3) / k,
            np.repeat([made, 1.0], 3) * k,
        )
        M = np.zeros((len(K), n + 6, n + 6))
        M[:, :n, :n], M[:, :n, n:], M[:, n:, :n] = H, -at.J.swapaxes(-1, -2), at.J
        return M * np.outer(sizes, sizes), sizes


class _Row(NamedTuple):
    """The chain at N poses: T', q (N, n), W, motions of the springs, J (N, 6, n) at M."""

    T: Array
    q: Array
    W: Array
    base: Array
    tip: Array
    J: Array
    is_found: Any


def _pulled(J: Array, W: Array) -> Array:
    """``J^T W`` (N, n)."""
    return np.asarray((J.swapaxes(-1, -2) @ W[..., None])[..., 0])
