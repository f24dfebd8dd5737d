r"""Inverse kinematics of arms by machine code, from the recorded steps of
`JointPoses`.
"""

from __future__ import annotations

from typing import Any, cast

import numpy as np

from cartstiff.core import numerics
from cartstiff.core.arrays import Array
from cartstiff.core.lazily import cached_property
from cartstiff.core.mechanisms.chain import Chain
from cartstiff.core.mechanisms.elastic import ElasticMechanism
from cartstiff.kinematics.joint_poses import LONGEST_STEP, Free, JointPoses
from cartstiff.recorded.algebra import (
    PLAIN,
    below,
    norm_squared,
    positive_factor,
    rotation_vector,
    zeros,
)
from cartstiff.recorded.chains import chain_motion
from cartstiff.recorded.execution import CompiledKernel
from cartstiff.recorded.kernels import has_package
from cartstiff.recorded.plans import chain_constants
from cartstiff.recorded.tape import Program, Scalar, Tape, absolute, larger, pick
from cartstiff.recorded.twists import TreeConstants


class QuickPoses(JointPoses):
    """`JointPoses` with errors and steps by machine code, for serial chains.

    The steps are the same to round-off.
    """

    rows_at_once = 4096

    def __init__(self, elastic: ElasticMechanism, limits: bool = True) -> None:
        super().__init__(elastic, limits)
        self._constants: TreeConstants | None = None
        mechanism = elastic.mechanism
        if has_package("llvmlite") and len(mechanism.screws()):
            constants = chain_constants(cast(Chain, mechanism))
            self._constants = None if isinstance(constants, str) else constants

    def _errors(self, q: Array, T_wanted: Array, free: Free) -> tuple[Array, Array]:
        if self._constants is None or free != "none":
            return super()._errors(q, T_wanted, free)
        count, n = q.shape
        arrays = self._of_errors({"q": q, "wanted": T_wanted[:, :3].reshape(count, 12)})
        e, J = arrays["e"], arrays["jacobian"].reshape(count, 6, n)
        turned = np.flatnonzero(arrays["verdict"][:, 0] != PLAIN)
        if turned.size:
            e[turned], J[turned] = super()._errors(q[turned], T_wanted[turned], free)
        return e, J

    def _step(self, q: Array, e: Array, J: Array, mu: Array) -> Array:
        if self._constants is None or J.shape[1] != 6:
            return super()._step(q, e, J, mu)
        count, n = q.shape
        inputs = {
            "q": q,
            "e": e,
            "jacobian": J.reshape(count, 6 * n),
            "mu": mu[:, None],
            "lower": self.lower[None],
            "upper": self.upper[None],
        }
        return self._of_steps(inputs)["step"]

    @cached_property
    def _of_errors(self) -> CompiledKernel:
        assert self._constants is not None
        sizes = self.sizes * self.movable
        return CompiledKernel(_error_program(self._constants, self.length, sizes))

    @cached_property
    def _of_steps(self) -> CompiledKernel:
        is_limited = bool(np.isfinite([self.lower, self.upper]).any())
        return CompiledKernel(_step_program(self.sizes, is_limited))


def _error_program(constants: TreeConstants, length: float, sizes: Array) -> Program:
    """Error e (6,) and its rates (6, n) at q against "wanted",
    the first rows of a pose.
    """
    tape = Tape()
    T, J = chain_motion(tape, constants)
    wanted = tape.vector("wanted", 12).reshape(3, 4)
    R = T[:3, :3].T @ wanted[:, :3]
    e = zeros(6)
    e[3:] = (T[:3, :3].T @ (wanted[:, 3] - T[:3, 3])) * (1.0 / length)
    e[:3], verdict = rotation_vector(R)
    scale = np.repeat([1.0, 1.0 / length], 3)[:, None] * sizes
    return tape.program({"e": e, "jacobian": J * scale, "verdict": verdict})


def _step_program(sizes: Array, is_limited: bool) -> Program:
    """`JointPoses._step`; the step is always solved again for coordinates at
    their limits.
    """
    tape, n = Tape(), len(sizes)
    q, e = tape.vector("q", n), tape.vector("e", 6)
    J = tape.vector("jacobian", 6 * n).reshape(6, n)
    lower, upper = tape.vector("lower", n), tape.vector("upper", n)
    # Damped by the error itself: careful far away, plain Newton near the pose.
    damping = tape.input("mu", 0) * norm_squared(e)
    step = _damped(J, e, damping) * sizes
    # Joints that would leave their range are stopped, and the others solve it again.
    for _ in range(2 if is_limited else 0):
        J = J.copy()
        for j in range(n):
            below_it = pick(lower[j], q[j], 0.0, pick(step[j], 0.0, 1.0, 0.0))
            above_it = pick(q[j], upper[j], 0.0, pick(0.0, step[j], 1.0, 0.0))
            J[:, j] = J[:, j] * (1.0 - larger(below_it, above_it))
        step = _damped(J, e, damping) * sizes
    # A long step is shortened as a whole, so that its direction stays.
    largest: Scalar = 0.0
    for x, size in zip(step, sizes, strict=True):
        largest = larger(largest, absolute(x * (1.0 / size)))
    step = step * pick(largest, LONGEST_STEP, 1.0, LONGEST_STEP / largest)
    return tape.program({"step": step}, ["lower", "upper"])


def _damped(J: Array, e: Array, damping: Scalar) -> Array:
    """``J^T (J J^T + damping I)^-1 e``, as in `JointPoses`."""
    M = J @ J.T
    trace: Any = M.trace()
    for i in range(6):
        M[i, i] = M[i, i] + damping + trace * numerics.ROUNDOFF_OF_SUMS + numerics.TINY
    L, inverses, _ = positive_factor(M)
    x = below(L, e) * inverses
    for i in range(4, -1, -1):
        x[i] = x[i] - L[i + 1 :, i] @ x[i + 1 :]
    return J.T @ x
