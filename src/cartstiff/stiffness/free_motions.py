r"""Motions that are free, and compliances from them: ``C = J H^-1 J^T`` without any stiffness."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cartstiff import numerics
from cartstiff.geometry.se3 import Array
from cartstiff.lazily import cached_property

_NO_CHANGE, _NO_CHANGES = np.zeros((1, 6, 6)), np.zeros((0, 6, 6))


def _given(motions: FreeMotions | None) -> FreeMotions | None:
    return motions


@dataclass(frozen=True, eq=False)
class FreeMotions:
    r"""Motions that are free, each in its own unit, and what the energy does along them.

    Attributes
    ----------
    jacobian : ndarray, shape (6, f)
        J: output per motion.
    hessian : ndarray, shape (f, f)
        H_L on them.
    terms : callable
        Sizes (f, f) of the terms whose sum each entry of `hessian` is. A motion all of whose
        entries are below `IDLE` times these costs nothing.
    largest : callable
        A bound on all entries of `terms`, found with less work.
    basis : ndarray, shape (n, f), or None
        The motions; None if they are the coordinates themselves.
    is_symmetric : bool
        Whether `hessian` is that of an energy.
    apart : callable or None
        The same motions in a basis that keeps stiff springs from soft ones, or None: taken where
        `hessian` has lost digits.
    springs : tuple of ndarray (m, n), (m,), or None
        Rates of springs per coordinate, and their stiffnesses, that `hessian` keeps apart.
    error : float
        Relative error of `jacobian`.
    """

    jacobian: Array
    hessian: Array
    terms: Callable[[], Array]
    largest: Callable[[], float]
    basis: Array | None = None
    is_symmetric: bool = True
    apart: Callable[[], FreeMotions | None] | None = None
    springs: tuple[Array, Array] | None = None
    error: float = 0.0

    def __getstate__(self) -> dict[str, Any]:
        """Everything, with the sizes of the terms as they are instead of a way to them."""
        terms, largest = partial(np.asarray, self._terms), partial(float, self._largest)
        return {
            **vars(self),
            "terms": terms,
            "largest": largest,
            "apart": partial(_given, self._apart),
        }

    def inverse(self, change: Array | None = None) -> numerics.Inverse | None:
        """``(H + J^T D J)^-1`` for a change D (6, 6) of the stiffness; None if singular."""
        inverses, errors = self._inverses(_NO_CHANGES if change is None else change[None])
        return _one(inverses[-1], errors[-1], self.is_symmetric and change is None)

    def compliance(self, change: Array | None = None) -> numerics.Inverse | None:
        """``J (H + J^T D J)^-1 J^T``, the inverse of K + D without K; None if there is none."""
        if change is None or not change.any():
            return self.compliances()[0]
        return self.compliances(change[None])[1]

    def compliances(
        self, changes: Array = _NO_CHANGES, other: Array | None = None
    ) -> list[numerics.Inverse | None]:
        """`compliance` of H itself, and for several changes (k, 6, 6).

        And, as the last one, for the Hessian (n, n) of another energy without terms to cancel.
        """
        inverses, errors = self._inverses(changes, other)
        J = self.jacobian
        C = J @ inverses @ J.T
        same = [self.is_symmetric and numerics.is_symmetric(D) for D in changes]
        symmetric = [self.is_symmetric, *same, self.is_symmetric]
        return [_one(*each) for each in zip(C, errors, symmetric, strict=False)]

    def _inverses(self, changes: Array, other: Array | None = None) -> tuple[Array, list[float]]:
        """Inverses of H, H + J^T D J (k, f, f) and their errors (k,), infinite where singular."""
        J, count = self.jacobian, 1 + len(changes)
        H = np.empty((count + (other is not None), *self.hessian.shape))
        H[0] = self.hessian
        added = loss = 0.0
        if count > 1:
            np.add(J.T @ changes @ J, self.hessian, out=H[1:count])
            # No entry of |J|^T |D| |J| is more than this.
            added = float(np.vdot(changes, changes)) ** 0.5 * float(np.vdot(J, J))
        if other is not None:
            H[count], loss = self._in_basis(other)
        inverses, errors = numerics.invert_each(H)
        if other is not None and loss > errors[count]:
            errors[count] = loss if loss < numerics.EPSILON * numerics.INVERTIBLE else np.inf
        # A bound on what is added up alone tells but for rare cases.
        least = numerics.IDLE * (self._largest + added)
        diagonal = H[:count].diagonal(0, 1, 2).ravel().tolist()
        if not min(diagonal, default=1.0) > least:
            each = np.concatenate([_NO_CHANGE, np.abs(changes)])
            terms = self._terms + np.abs(J.T) @ each @ np.abs(J)
            idle = (np.abs(H[:count]) <= numerics.IDLE * terms).all(axis=1).any(axis=1)
            errors[:count] = np.where(idle, np.inf, errors[:count]).tolist()
        if max(errors) > numerics.REPORTED_ERROR and self._apart is not None:
            return self._better(inverses, errors, changes, other, self._apart)
        return inverses, errors

    @staticmethod
    def _better(
        inverses: Array,
        errors: list[float],
        changes: Array,
        other: Array | None,
        apart: FreeMotions,
    ) -> tuple[Array, list[float]]:
        """Of each inverse that which has more digits: by these motions, or by springs apart."""
        inverse, own = apart._inverses(changes, other)
        own = [error + apart.error for error in own]
        back = apart.jacobian @ inverse @ apart.jacobian.T
        best = [min(each) for each in zip(errors, own, strict=True)]
        chosen = np.array([a <= b for a, b in zip(own, errors, strict=True)])
        return np.where(chosen[:, None, None], back, inverses), best

    def _in_basis(self, other: Array) -> tuple[Array, float]:
        """Another Hessian (n, n) on the motions, and the relative error that it has there."""
        if self.basis is None:
            return other, 0.0
        if self.springs is None:
            return self.basis.T @ other @ self.basis, 0.0
        rates, k = self.springs
        size = (np.abs(rates.T) * k) @ np.abs(rates)
        rest = other - (rates.T * k) @ rates
        own = self.basis.T @ rates.T
        along = (own * k) @ own.T
        # What only the springs make is known exactly.
        if np.all(np.abs(rest) <= 32.0 * numerics.EPSILON * size):
            return along, 0.0
        rounding = np.abs(self.basis.T) @ size @ np.abs(self.basis)
        loss = numerics.EPSILON * float((rounding.diagonal() / along.diagonal()).max())
        return along + self.basis.T @ rest @ self.basis, loss

    @cached_property
    def _apart(self) -> FreeMotions | None:
        return None if self.apart is None else self.apart()

    @cached_property
    def _terms(self) -> Array:
        return self.terms()

    @cached_property
    def _largest(self) -> float:
        return self.largest()

    @cached_property
    def is_far_from_idle(self) -> bool:
        """Whether stiffness along each motion is no small share of all that acts."""
        least = min(self.hessian.diagonal().tolist(), default=0.0)
        return least > numerics.FAR_FROM_IDLE * self._largest

    @cached_property
    def idle(self) -> NDArray[np.bool_]:
        """Which motions (f,) cost nothing: all that acts along them is rounding of its terms."""
        H = self.hessian
        if min(H.diagonal().tolist(), default=1.0) > numerics.IDLE * self._largest:
            return np.zeros(len(H), bool)
        return np.all(np.abs(H) <= numerics.IDLE * self._terms, axis=1)

    def motion(self, inverse: Array, wrench: Array) -> Array:
        """Motion of all coordinates (n,) under an output force (6,)."""
        y: Array = inverse @ (self.jacobian.T @ wrench)
        return y if self.basis is None else np.asarray(self.basis @ y)


def _one(matrix: Array, error: float, symmetric: bool) -> numerics.Inverse | None:
    if not error < np.inf:
        return None
    return numerics.Inverse(0.5 * (matrix + matrix.T) if symmetric else matrix, error)
