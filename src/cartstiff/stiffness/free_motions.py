r"""Motions that are free, and compliances from them: ``C = J H^-1 J^T`` without any stiffness."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any

import numpy as np

from cartstiff import numerics
from cartstiff.geometry.se3 import Array

__all__ = ["FreeMotions"]

_NO_CHANGE = np.zeros((1, 6, 6))


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
    basis : ndarray, shape (n, f), or None
        The motions; None if they are the coordinates themselves.
    """

    jacobian: Array
    hessian: Array
    terms: Callable[[], Array]
    basis: Array | None = None

    def __getstate__(self) -> dict[str, Any]:
        """Everything, with the sizes of the terms as they are instead of a way to them."""
        return {**vars(self), "terms": partial(np.asarray, self._terms)}

    def inverse(self, change: Array | None = None) -> numerics.Inverse | None:
        """``(H + J^T D J)^-1`` for a change D (6, 6) of the stiffness; None if singular."""
        changes = _NO_CHANGE if change is None else change[None]
        inverses, errors = self._inverses(changes)
        return _one(inverses[0], errors[0])

    def compliance(self, change: Array | None = None) -> numerics.Inverse | None:
        """``J (H + J^T D J)^-1 J^T``, the inverse of K + D without K; None if there is none."""
        return self.compliances(_NO_CHANGE if change is None else change[None])[0]

    def compliances(
        self, changes: Array, other: Array | None = None
    ) -> list[numerics.Inverse | None]:
        """`compliance` for several changes (k, 6, 6) at once.

        And, as the last one, for the Hessian (n, n) of another energy without terms to cancel.
        """
        inverses, errors = self._inverses(changes, other)
        J = self.jacobian
        C = J @ inverses @ J.T
        symmetric = (inverses == inverses.swapaxes(1, 2)).all(axis=(1, 2))
        if symmetric.any():
            C[symmetric] = 0.5 * (C + C.swapaxes(1, 2))[symmetric]
        return [_one(*each) for each in zip(C, errors.tolist(), strict=True)]

    def _inverses(self, changes: Array, other: Array | None = None) -> tuple[Array, Array]:
        """Inverses of H + J^T D J (k, f, f) and their errors (k,), infinite where singular."""
        J, k = self.jacobian, len(changes)
        H = self.hessian + J.T @ changes @ J
        if other is not None:
            if self.basis is not None:
                other = self.basis.T @ other @ self.basis
            H = np.concatenate([H, other[None]])
        inverses, errors = numerics.invert_each(H)
        # The diagonal of |J|^T |D| |J| is at most this; it alone tells but for rare cases.
        norms = np.sqrt((changes * changes).sum(axis=(1, 2)))[:, None]
        least = self._least + numerics.IDLE * norms * (J * J).sum(axis=0)
        if not (np.abs(H[:k].diagonal(0, 1, 2)) > least).all():
            terms = self._terms + np.abs(J.T) @ np.abs(changes) @ np.abs(J)
            idle = (np.abs(H[:k]) <= numerics.IDLE * terms).all(axis=1).any(axis=1)
            errors[:k][idle] = np.inf
        return inverses, errors

    @cached_property
    def _terms(self) -> Array:
        return self.terms()

    @cached_property
    def _least(self) -> Array:
        """Entries (f,) on the diagonal of `hessian` below which a motion may cost nothing."""
        return np.asarray(numerics.IDLE * self._terms.diagonal())

    def motion(self, inverse: Array, wrench: Array) -> Array:
        """Motion of all coordinates (n,) under an output force (6,)."""
        y: Array = inverse @ (self.jacobian.T @ wrench)
        return y if self.basis is None else np.asarray(self.basis @ y)


def _one(matrix: Array, error: float) -> numerics.Inverse | None:
    return numerics.Inverse(matrix, error) if error < np.inf else None
