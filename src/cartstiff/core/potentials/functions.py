"""A user's own energy, on the joint coordinates or on the pose."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from cartstiff.core import numerics
from cartstiff.core.arrays import (
    Array,
    checked_array,
    checked_matrix,
    checked_vector,
    real_array,
)
from cartstiff.core.checked_call import checked
from cartstiff.core.errors import InputError
from cartstiff.core.geometry import se3
from cartstiff.core.geometry.differences import STEP, gradient_and_hessian
from cartstiff.core.potentials.contract import (
    Evaluation,
    PosePotential,
    Posture,
    Potential,
)

# Largest difference of derivatives with the full and with half the step, as a share of
# the Hessian's scale; smooth functions of unit curvature reach 1e-10.
_AGREEMENT = numerics.DERIVATIVE_DISAGREEMENT
# Largest step of `taylor_check` for which the energy must be finite.
_FINITE_STEP = 1e-2


def _differentiate(
    f: Callable[[Array], float], scale: Array
) -> tuple[float, Array, Array]:
    value = float(f(np.zeros(scale.size)))
    g, h = gradient_and_hessian(f, scale)
    g_half, h_half = gradient_and_hessian(f, scale, STEP / 2)
    natural = np.outer(scale, scale)
    size = np.abs(h * natural).max() + np.abs(g * scale).max()
    error = max(np.abs((h - h_half) * natural).max(), np.abs((g - g_half) * scale).max())
    # Second differences of the half step carry the energy's own rounding, times 1 /
    # step^2.
    rounding = 100 * numerics.EPSILON * abs(value) / (STEP / 2) ** 2
    if not np.isfinite(error) or error > _AGREEMENT * size + rounding:
        raise InputError(
            "the energy cannot be differentiated numerically here (not smooth, or its "
            "length scale is far from the one given); pass its derivatives",
            expected=f"two step sizes to agree within {_AGREEMENT:g}",
            got=f"relative difference {error / size if size else np.nan:.3g}",
        )
    return value, g, h


@dataclass(frozen=True, eq=False)
class JointFunction(Potential):
    """Energy as a function of the joint coordinates.

    Attributes
    ----------
    energy : callable
        ``energy(q)`` in the mechanism's units.
    gradient, hessian : callable, optional
        ``gradient(q)`` (n,) and ``hessian(q)`` (n, n). Give both or none; without them
        they are taken by eighth-order differences and checked at two step sizes.
    scale : float
        Natural size of a change of q, in rad or length.
    """

    energy: Callable[[Array], float]
    gradient: Callable[[Array], ArrayLike] | None = None
    hessian: Callable[[Array], ArrayLike] | None = None
    scale: float = 1.0

    def evaluate(self, posture: Posture) -> Evaluation:
        """Energy, gradient and Hessian at the posture's coordinates.

        Raises
        ------
        InputError
            For a gradient or Hessian of another shape.
        """
        q = posture.q
        if self.gradient is None or self.hessian is None:
            f = lambda d: float(self.energy(q + d))  # noqa: E731
            return Evaluation(*_differentiate(f, np.full(q.size, self.scale)))
        n, energy = q.size, float(self.energy(q))
        g = checked_array(self.gradient(q), (n,), "gradient", finite=False)
        H = checked_array(self.hessian(q), (n, n), "Hessian", finite=False)
        return Evaluation(energy, g, H)


@dataclass(frozen=True, eq=False)
class PoseFunction(PosePotential):
    """Energy as a function of a pose ``T_a_b``.

    Attributes
    ----------
    energy : callable
        ``energy(T)`` of a 4x4 pose.
    wrench, stiffness : callable, optional
        ``wrench(T)`` = dPhi (6,), [ZK]_, and ``stiffness(T)`` = K^A or K^B (6, 6; the
        symmetric part counts), in components of frame b. Give both or none.
    length : float
        Natural length, in the mechanism's unit, for the numerical derivatives.
    """

    energy: Callable[[Array], float]
    wrench: Callable[[Array], ArrayLike] | None = None
    stiffness: Callable[[Array], ArrayLike] | None = None
    length: float = 1.0

    def on_pose(self, T_a_b: Array) -> tuple[float, Array, Array]:
        """Energy, wrench, K^B; in exponential coordinates at the pose, whose Hessian K^B
        is.

        Raises
        ------
        InputError
            For a wrench or stiffness of another shape.
        """
        if self.wrench is None or self.stiffness is None:
            scale = np.array([1.0] * 3 + [self.length] * 3)
            return _differentiate(lambda x: float(self.energy(T_a_b @ se3.exp(x))), scale)
        K = checked_array(self.stiffness(T_a_b), (6, 6), "stiffness", finite=False)
        W = checked_array(self.wrench(T_a_b), (6,), "wrench", finite=False)
        return float(self.energy(T_a_b)), W, 0.5 * (K + K.T)


class TaylorCheck(NamedTuple):
    """Verdict of `taylor_check`.

    Attributes
    ----------
    slope : float
        Fitted slope of log error against log step: 3 for right derivatives, 2 for a wrong
        Hessian, 1 for a wrong gradient.
    window : tuple of float
        Steps between which the slope was fitted.
    ok : bool
        Slope at least 2.7, or error at rounding level everywhere (energy quadratic).
    """

    slope: float
    window: tuple[float, float]
    ok: bool


@checked
def taylor_check(
    energy: Callable[[Array], float],
    gradient: ArrayLike,
    hessian: ArrayLike,
    direction: ArrayLike,
) -> TaylorCheck:
    """Check first and second derivatives at 0 against the energy along a direction.

    The error |energy(t d) - energy(0) - t g.d - t^2/2 d.H d| must fall like t^3. The
    slope is fitted where it is steadiest over a decade and a half of steps, above the
    rounding floor.

    Parameters
    ----------
    energy : callable
        Function of the offset from the point, (n,) to a number.
    gradient, hessian : array_like
        Derivatives at offset 0 to be checked.
    direction : array_like, shape (n,)
        Direction of unit natural size.

    Returns
    -------
    TaylorCheck
        Not ok where the energy is not a finite number on steps of a hundredth and less.

    Raises
    ------
    InputError
        For wrong shapes, numbers that are not finite, a direction of zero, or an energy
        that is not a finite number at 0.
    """
    d = checked_array(direction, ("n",), "direction")
    g, H = (
        checked_vector(gradient, d.size, "gradient"),
        checked_matrix(hessian, "hessian", d.size),
    )
    if not d.any():
        raise InputError("direction is zero", expected="a direction of unit natural size")
    steps = np.logspace(0, -7, 57)
    base = float(real_array(energy(np.zeros(d.size))))
    if not np.isfinite(base):
        raise InputError("the energy is not a finite number at offset 0", got=base)
    slope, curve = float(g @ d), float(d @ H @ d)
    values = np.array([float(energy(t * d)) for t in steps])
    errors = np.abs(values - base - steps * slope - 0.5 * steps**2 * curve)
    floor = (
        64
        * numerics.EPSILON
        * (abs(base) + np.abs(values) + steps * abs(slope) + steps**2 * abs(curve))
    )
    if not np.isfinite(errors[steps <= _FINITE_STEP]).all():
        return TaylorCheck(np.nan, (float(steps[-1]), float(steps[0])), False)
    usable = np.flatnonzero((errors > floor) & np.isfinite(errors))
    if usable.size < 4:
        return TaylorCheck(np.inf, (float(steps[-1]), float(steps[0])), True)
    # A right Hessian leaves few points above the floor; fit the order to the smallest of
    # them.
    last = usable[-min(usable.size, 12) :]
    fitted = float(np.polyfit(np.log(steps[last]), np.log(errors[last]), 1)[0])
    return TaylorCheck(
        fitted, (float(steps[last[-1]]), float(steps[last[0]])), fitted >= 2.7
    )
