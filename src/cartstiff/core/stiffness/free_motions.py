r"""Free motions, and compliances from them: ``C = J H^-1 J^T``,
without a stiffness matrix.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from cartstiff.core import numerics
from cartstiff.core.arrays import Array
from cartstiff.core.lazily import cached_property

_NO_CHANGE, _NO_CHANGES = np.zeros((1, 6, 6)), np.zeros((0, 6, 6))


@dataclass(frozen=True, eq=False)
class FreeMotions:
    r"""Free motions, each in its own unit, and the Hessian of the energy along them.

    Attributes
    ----------
    jacobian : ndarray, shape (6, f)
        J: output per motion.
    hessian : ndarray, shape (f, f)
        H_L on them.
    terms : ndarray, shape (f, f)
        Sizes of the terms in the sum of each entry of `hessian`. A motion with all
        entries below `FREE_MOTION_STIFFNESS` times these costs no energy: those of its
        column (no force changes along it) or of its row (no force works on it), which
        differ if there is no energy.
    basis : ndarray, shape (n, f)
        The motions.
    is_symmetric : bool
        Whether `hessian` is that of an energy.
    by_lengths : callable or None
        The same motions in a basis that separates stiff from soft springs, or None; used
        where `hessian` has lost digits.
    has_springs_apart : bool
        Whether `hessian` is that of the energy alone, stiff and soft springs apart.
    error : float
        Relative error of `jacobian`.
    """

    jacobian: Array
    hessian: Array
    terms: Array
    basis: Array
    is_symmetric: bool = True
    by_lengths: Callable[[], FreeMotions | None] | None = None
    has_springs_apart: bool = False
    error: float = 0.0

    def inverse(self, change: Array | None = None) -> numerics.Inverse | None:
        """``(H + J^T D J)^-1`` for a change D (6, 6) of the stiffness;
        None if singular.
        """
        inverses, errors = self._inverses(_NO_CHANGES if change is None else change[None])
        return _one(inverses[-1], errors[-1], self.is_symmetric and change is None)

    def compliance(self, change: Array | None = None) -> numerics.Inverse | None:
        """``J (H + J^T D J)^-1 J^T``, the inverse of K + D without K;
        None if there is none.
        """
        return self.compliances(_NO_CHANGES if change is None else change[None])[-1]

    def compliances(
        self, changes: Array = _NO_CHANGES, other: tuple[Array, Array] | None = None
    ) -> list[numerics.Inverse | None]:
        """`compliance` of H itself, and for several changes (k, 6, 6).

        And, as the last one, for another Hessian in the coordinates: that of the energy
        (n, n), and what is added to it (n, n).
        """
        inverses, errors = self._inverses(changes, other)
        C = self.jacobian @ inverses @ self.jacobian.T
        same = [self.is_symmetric and numerics.is_symmetric(D) for D in changes]
        symmetric = [self.is_symmetric, *same, self.is_symmetric]
        return [_one(*each) for each in zip(C, errors, symmetric, strict=False)]

    def _inverses(
        self, changes: Array, other: tuple[Array, Array] | None = None
    ) -> tuple[Array, Array]:
        """Inverses of H, H + J^T D J (k, f, f) and their errors (k,),
        infinite where singular.
        """
        J = self.jacobian
        changes = np.concatenate([_NO_CHANGE, changes])
        H = self.hessian + J.T @ changes @ J
        terms = self.terms + np.abs(J.T) @ np.abs(changes) @ np.abs(J)
        if other is not None:
            own, sizes = self._on_motions(*other)
            H = np.concatenate([H, own[None]])
            terms = np.concatenate([terms, sizes[None]])
        inverses, errors = numerics.invert_each(H)
        is_idle = np.abs(H) <= numerics.FREE_MOTION_STIFFNESS * terms
        errors[(is_idle.all(axis=1) | is_idle.all(axis=2)).any(axis=1)] = np.inf
        basis = self._by_lengths if errors.max() > numerics.REPORTED_ERROR else None
        if basis is None:
            return inverses, errors
        # Take each inverse on the basis with the smaller error.
        inverse, own = basis._inverses(changes[1:], other)
        own = own + basis.error
        to_motions = np.linalg.inv(self.jacobian) @ basis.jacobian
        back = to_motions @ inverse @ to_motions.T
        return np.where((own <= errors)[:, None, None], back, inverses), np.minimum(
            own, errors
        )

    def _on_motions(self, energy: Array, added: Array) -> tuple[Array, Array]:
        """The sum of both, Hessians (n, n), on the motions (f, f), and the sizes of
        its terms there.
        """
        B = self.basis
        sizes = self.terms + np.abs(B.T) @ np.abs(added) @ np.abs(B)
        if self.has_springs_apart:
            return self.hessian + B.T @ added @ B, sizes
        return B.T @ (energy + added) @ B, sizes

    @cached_property
    def _by_lengths(self) -> FreeMotions | None:
        return None if self.by_lengths is None else self.by_lengths()

    def motion(self, inverse: Array, wrench: Array) -> Array:
        """Motion of all coordinates (n,) under an output force (6,)."""
        return np.asarray(self.basis @ (inverse @ (self.jacobian.T @ wrench)))


def _one(matrix: Array, error: float, symmetric: bool) -> numerics.Inverse | None:
    if not error < np.inf:
        return None
    return numerics.Inverse(
        0.5 * (matrix + matrix.T) if symmetric else matrix, float(error)
    )
