"""Forces and stiffness on the motions that are left, and what of them may be rounding."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cartstiff.geometry.se3 import Array
from cartstiff.lazily import cached_property
from cartstiff.numerics import eigenvalues, invert


@dataclass(eq=False)
class Balance:
    """Forces and stiffness on the motions that the constraints leave, in natural units.

    Attributes
    ----------
    free : ndarray (n, f) or None
        N; None stands for the identity.
    multipliers : ndarray (m,)
        Constraint forces lam, per unit of each constraint.
    force : ndarray (f,)
        g_N.
    stiffness : ndarray (f, f)
        H_N, symmetric where the loads have a potential.
    acting : ndarray (f,)
        Forces that act on each motion: the sum of their absolute values.
    rounding : ndarray (f,)
        What the rounding of coordinates and forces along each motion does to g_N.
    doubt : ndarray (f,)
        What the rounding of every spring's own deflection does to g_N.
    hardness : ndarray (f,)
        The size that H_N is judged against, motion by motion: stiffnesses that act there, at least
        what the rounding of the stiffest leaves.
    is_skewed : bool
        Whether the columns of `free` are not at right angles to each other, of length 1.
    """

    free: Array | None
    multipliers: Array
    force: Array
    stiffness: Array
    acting: Array
    rounding: Array
    doubt: Array
    hardness: Array
    is_skewed: bool = False

    @cached_property
    def unbalanced(self) -> Array:
        """g_N (f,) where it is more than rounding, else 0."""
        return np.where(np.abs(self.force) > self.rounding, self.force, 0.0)

    @cached_property
    def residual(self) -> float:
        """Largest unbalanced force over the forces that act on the same motion."""
        missed = np.abs(self.unbalanced)
        shares = np.divide(missed, self.acting, out=np.zeros_like(missed), where=missed > 0.0)
        return float(shares.max(initial=0.0))

    @cached_property
    def is_rounding(self) -> bool:
        """Whether all that is unbalanced may be rounding."""
        return bool((np.abs(self.force) <= self.doubt).all())

    @cached_property
    def miss(self) -> float:
        """Size of all unbalanced forces, each measured by the stiffness of its motion."""
        return float(np.linalg.norm(self.unbalanced / np.sqrt(self.hardness)))

    @cached_property
    def unsure(self) -> float:
        """How far `scaled` may be off: forces that are left move the posture, and with it H_N.

        By as much as the stiffest stiffness turns over such a motion.
        """
        left = float(np.max(np.abs(self.unbalanced) / self.hardness, initial=0.0))
        hardness = self.hardness.tolist()
        return left * max(hardness) / min(hardness) if hardness else 0.0

    @cached_property
    def scaled(self) -> Array:
        """H_N over the geometric mean of its motions' hardness: springs of any ratio alike."""
        per = 1 / np.sqrt(self.hardness)
        return self.stiffness * per[:, None] * per

    @cached_property
    def modes(self) -> tuple[Array, Array]:
        """Eigenvalues (f,) of `scaled` and motions (f, f): H_N between them is diagonal."""
        values, vectors = np.linalg.eigh(0.5 * (self.scaled + self.scaled.T))
        return values, vectors / np.sqrt(self.hardness)[:, None]

    def solved(self, right: Array, softest: float) -> Array:
        """Least-squares solution (f,) of H_N y = right, judged on `scaled`."""
        per = 1 / np.sqrt(self.hardness)
        return np.asarray(per * np.linalg.lstsq(self.scaled, per * right, rcond=softest)[0])

    def motion(self, y: Array) -> Array:
        """Natural coordinates (n,) of a free motion (f,)."""
        return y if self.free is None else np.asarray(self.free @ y)


def spectrum(balance: Balance, conservative: bool) -> Array:
    """Eigenvalues of H_N by increasing real part; without a potential they may be complex."""
    stiffness = balance.stiffness
    if balance.is_skewed and balance.free is not None:
        back = np.linalg.inv(np.linalg.qr(balance.free, mode="r"))
        stiffness = back.T @ stiffness @ back
        if conservative:
            return eigenvalues(stiffness)
    if conservative:
        inverse = invert(0.5 * (stiffness + stiffness.T), np.sqrt(balance.hardness))
        if inverse is None:
            return eigenvalues(stiffness)
        return eigenvalues(stiffness, inverse.matrix, doubtful=True)
    roots = np.linalg.eigvals(stiffness)
    roots = roots[np.argsort(roots.real)]
    return roots.real if np.isrealobj(roots) or not roots.imag.any() else roots
