"""What others would write for K^A, K^B, K^K, K^F of a six-joint arm at many postures.

Each peer is made from the same Pinocchio model and returns a function from coordinates (N, 6) to a
dict of arrays, or raises ImportError where its package is not installed.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

Array = np.ndarray
Answer = dict[str, Array]
ANGULAR_LINEAR = [3, 4, 5, 0, 1, 2]
CHUNK = 400  # NumPy's temporaries stay below 128 KiB


@dataclass
class Arm:
    """Pinocchio model, frame, joint stiffnesses and rest positions."""

    model: Any
    frame: int
    stiffness: Array
    rest: Array

    @property
    def constants(self) -> tuple[Array, Array, Array]:
        """Placements (n, 4, 4), axes (n, 3) of revolute joints, pose of the frame on the last."""
        model = self.model
        placements = np.array(
            [model.jointPlacements[i].homogeneous for i in range(1, model.njoints)]
        )
        data = model.createData()
        pin.computeJointJacobians(model, data, np.zeros(model.nq))
        axes = np.array(
            [
                pin.getJointJacobian(model, data, i, pin.LOCAL)[3:, i - 1]
                for i in range(1, model.njoints)
            ]
        )
        return placements, axes, model.frames[self.frame].placement.homogeneous


def _finish(K_A: Array, W: Array, K_F: Array) -> tuple[Array, Array, Array, Array]:
    """K^A, K^B, K^K, K^F of one posture."""
    K_K = K_A.copy()
    K_K[:3, :3] -= 0.5 * pin.skew(W[:3])
    K_K[3:, :3] -= pin.skew(W[3:])
    return K_A, 0.5 * (K_A + K_A.T), K_K, K_F


def _loop(one: Callable[[Array], tuple[Array, Array, tuple[Array, ...]]]) -> Any:
    def run(q: Array) -> Answer:
        N = len(q)
        J, W, K = np.empty((N, 6, 6)), np.empty((N, 6)), np.empty((4, N, 6, 6))
        for i in range(N):
            J[i], W[i], found = one(q[i])
            for k in range(4):
                K[k, i] = found[k]
        return {"jacobian": J, "wrench": W, **dict(zip("ABKF", K, strict=True))}

    return run


def plain_loop(arm: Arm) -> Any:
    """Pinocchio's Jacobian, the kinematic Hessian from brackets, one einsum; posture by posture."""
    data, k = arm.model.createData(), np.diag(arm.stiffness)
    later = np.triu(np.ones((6, 6)), 1)

    def one(q: Array) -> Any:
        J = pin.computeFrameJacobian(arm.model, data, q, arm.frame, pin.LOCAL)[ANGULAR_LINEAR]
        A = np.linalg.inv(J)
        W = A.T @ (arm.stiffness * (q - arm.rest))
        turn, shift = _skew(J[:3].T), _skew(J[3:].T)
        H = np.empty((6, 6, 6))  # H[a, :, b] = dJ[:, a] / dq[b]
        H[:, :3] = turn @ J[:3]
        H[:, 3:] = turn @ J[3:] + shift @ J[:3]
        H *= later[:, None]
        K_F = A.T @ k @ A
        K_A = K_F - np.einsum("akb,k,ai,bj->ij", H, W, A, A)
        return J, W, _finish(K_A, W, K_F)

    return _loop(one)


def lean_loop(arm: Arm) -> Any:
    """The same with the wrench put into the bracket first: no tensor, matrix products only."""
    data = arm.model.createData()
    later = np.triu(np.ones((6, 6)), 1)

    def one(q: Array) -> Any:
        J = pin.computeFrameJacobian(arm.model, data, q, arm.frame, pin.LOCAL)[ANGULAR_LINEAR]
        A = np.linalg.inv(J)
        W = (arm.stiffness * (q - arm.rest)) @ A
        moment, force = pin.skew(W[:3]), pin.skew(W[3:])
        M = np.zeros((6, 6))
        M[:3, :3], M[:3, 3:], M[3:, :3] = moment, force, force
        K_F = (A.T * arm.stiffness) @ A
        K_A = K_F + A.T @ ((J.T @ M @ J) * later) @ A
        K_K = K_A.copy()
        K_K[:3, :3] -= 0.5 * moment
        K_K[3:, :3] -= force
        return J, W, (K_A, K_A - 0.5 * M, K_K, K_F)

    return _loop(one)


def differences(arm: Arm) -> Any:
    """Central differences of Pinocchio's Jacobian."""
    data, h = arm.model.createData(), 1e-6

    def jacobian(q: Array) -> Array:
        return pin.computeFrameJacobian(arm.model, data, q, arm.frame, pin.LOCAL)[ANGULAR_LINEAR]

    steps = h * np.eye(6)

    def one(q: Array) -> Any:
        J = jacobian(q)
        A = np.linalg.inv(J)
        W = (arm.stiffness * (q - arm.rest)) @ A
        load = np.empty((6, 6))
        for b in range(6):
            load[:, b] = W @ (jacobian(q + steps[b]) - jacobian(q - steps[b])) / (2 * h)
        K_F = (A.T * arm.stiffness) @ A
        return J, W, _finish(K_F - A.T @ load @ A, W, K_F)

    return _loop(one)


def _skew(v: Array) -> Array:
    m = np.zeros((*v.shape[:-1], 3, 3))
    m[..., 2, 1], m[..., 0, 2], m[..., 1, 0] = v[..., 0], v[..., 1], v[..., 2]
    m[..., 1, 2], m[..., 2, 0], m[..., 0, 1] = -v[..., 0], -v[..., 1], -v[..., 2]
    return m


def batched_numpy(arm: Arm) -> Any:
    """NumPy on stacks of postures, kinematics included, in chunks that stay in the cache."""
    placements, axes, T_last = arm.constants
    cross = _skew(axes)
    squares = cross @ cross
    later = np.triu(np.ones((6, 6)), 1)

    def chunk(q: Array, out: Answer, at: slice) -> None:
        N = len(q)
        s, c = np.sin(q)[..., None, None], 1 - np.cos(q)[..., None, None]
        R, p = np.broadcast_to(np.eye(3), (N, 3, 3)), np.zeros((N, 3))
        z, o = np.empty((N, 6, 3)), np.empty((N, 6, 3))
        for j in range(6):
            p = p + R @ placements[j, :3, 3]
            R = R @ (
                placements[j, :3, :3] @ (np.eye(3) + s[:, j] * cross[j] + c[:, j] * squares[j])
            )
            z[:, j], o[:, j] = R @ axes[j], p
        p = p + R @ T_last[:3, 3]
        R = R @ T_last[:3, :3]
        J = np.empty((N, 6, 6))
        J[:, :3] = (z @ R).transpose(0, 2, 1)
        J[:, 3:] = (np.cross(z, p[:, None] - o) @ R).transpose(0, 2, 1)
        A = np.linalg.inv(J)
        At = A.transpose(0, 2, 1)
        W = (At @ (arm.stiffness * (q - arm.rest))[..., None])[..., 0]
        moment, force = _skew(W[:, :3]), _skew(W[:, 3:])
        M = np.zeros((N, 6, 6))
        M[:, :3, :3], M[:, :3, 3:], M[:, 3:, :3] = moment, force, force
        K_F = (At * arm.stiffness) @ A
        K_A = K_F + At @ ((J.transpose(0, 2, 1) @ M @ J) * later) @ A
        out["jacobian"][at], out["wrench"][at] = J, W
        out["A"][at], out["F"][at], out["B"][at] = K_A, K_F, K_A - 0.5 * M
        K_A[:, :3, :3] -= 0.5 * moment
        K_A[:, 3:, :3] -= force
        out["K"][at] = K_A

    def run(q: Array) -> Answer:
        N = len(q)
        out = {name: np.empty((N, 6, 6)) for name in ("jacobian", *"ABKF")}
        out["wrench"] = np.empty((N, 6))
        for i in range(0, N, CHUNK):
            chunk(q[i : i + CHUNK], out, slice(i, min(i + CHUNK, N)))
        return out

    return run


def numba_kernel(arm: Arm, threads: int) -> Any:
    """Scalar loops compiled by numba, postures in parallel."""
    import numba

    placements, axes, T_last = arm.constants
    k, rest = arm.stiffness, arm.rest

    @numba.njit(fastmath=False, inline="always")
    def cross(a0, a1, a2, b0, b1, b2):
        return a1 * b2 - a2 * b1, a2 * b0 - a0 * b2, a0 * b1 - a1 * b0

    @numba.njit(parallel=True, error_model="numpy")
    def many(q, Js, Ws, KA, KB, KK, KF):
        N = q.shape[0]
        for i in numba.prange(N):
            R, P, T = np.eye(3), np.zeros(3), np.empty((3, 3))
            z, o = np.empty((6, 3)), np.empty((6, 3))
            for j in range(6):
                for r in range(3):
                    for c in range(3):
                        P[r] += R[r, c] * placements[j, c, 3]
                for r in range(3):
                    for c in range(3):
                        T[r, c] = (
                            R[r, 0] * placements[j, 0, c]
                            + R[r, 1] * placements[j, 1, c]
                            + R[r, 2] * placements[j, 2, c]
                        )
                s, co = np.sin(q[i, j]), np.cos(q[i, j])
                x, y, w = axes[j, 0], axes[j, 1], axes[j, 2]
                for r in range(3):
                    a, b, d = T[r, 0], T[r, 1], T[r, 2]
                    along = (a * x + b * y + d * w) * (1 - co)
                    c0, c1, c2 = cross(a, b, d, x, y, w)
                    R[r, 0] = a * co + x * along + s * c0
                    R[r, 1] = b * co + y * along + s * c1
                    R[r, 2] = d * co + w * along + s * c2
                    z[j, r] = R[r, 0] * x + R[r, 1] * y + R[r, 2] * w
                    o[j, r] = P[r]
            for r in range(3):
                for c in range(3):
                    P[r] += R[r, c] * T_last[c, 3]
            for r in range(3):
                for c in range(3):
                    T[r, c] = (
                        R[r, 0] * T_last[0, c] + R[r, 1] * T_last[1, c] + R[r, 2] * T_last[2, c]
                    )
            J = np.empty((6, 6))
            for j in range(6):
                v0, v1, v2 = cross(
                    z[j, 0], z[j, 1], z[j, 2], P[0] - o[j, 0], P[1] - o[j, 1], P[2] - o[j, 2]
                )
                for r in range(3):
                    J[r, j] = T[0, r] * z[j, 0] + T[1, r] * z[j, 1] + T[2, r] * z[j, 2]
                    J[3 + r, j] = T[0, r] * v0 + T[1, r] * v1 + T[2, r] * v2
            # Gauss-Jordan with partial pivoting.
            B, A = J.copy(), np.eye(6)
            for col in range(6):
                pivot = col
                for r in range(col + 1, 6):
                    if abs(B[r, col]) > abs(B[pivot, col]):
                        pivot = r
                for c in range(6):
                    B[col, c], B[pivot, c] = B[pivot, c], B[col, c]
                    A[col, c], A[pivot, c] = A[pivot, c], A[col, c]
                factor = 1.0 / B[col, col]
                for c in range(6):
                    B[col, c] *= factor
                    A[col, c] *= factor
                for r in range(6):
                    if r != col:
                        f = B[r, col]
                        for c in range(6):
                            B[r, c] -= f * B[col, c]
                            A[r, c] -= f * A[col, c]
            W = np.zeros(6)
            for j in range(6):
                t = k[j] * (q[i, j] - rest[j])
                for r in range(6):
                    W[r] += A[j, r] * t
            X = np.zeros((6, 6))
            for b in range(1, 6):
                m0, m1, m2 = cross(J[0, b], J[1, b], J[2, b], W[0], W[1], W[2])
                n0, n1, n2 = cross(J[3, b], J[4, b], J[5, b], W[3], W[4], W[5])
                f0, f1, f2 = cross(J[0, b], J[1, b], J[2, b], W[3], W[4], W[5])
                for a in range(b):
                    X[a, b] = (
                        J[0, a] * (m0 + n0)
                        + J[1, a] * (m1 + n1)
                        + J[2, a] * (m2 + n2)
                        + J[3, a] * f0
                        + J[4, a] * f1
                        + J[5, a] * f2
                    )
            XA = np.zeros((6, 6))
            for a in range(6):
                for b in range(a + 1, 6):
                    for c in range(6):
                        XA[a, c] += X[a, b] * A[b, c]
            for r in range(6):
                Ws[i, r] = W[r]
                for c in range(6):
                    Js[i, r, c] = J[r, c]
                    f, x = 0.0, 0.0
                    for a in range(6):
                        f += A[a, r] * k[a] * A[a, c]
                        x += A[a, r] * XA[a, c]
                    KF[i, r, c] = f
                    KA[i, r, c] = f - x
            for r in range(6):
                for c in range(6):
                    KB[i, r, c] = 0.5 * (KA[i, r, c] + KA[i, c, r])
                    KK[i, r, c] = KA[i, r, c]
            for r in range(3):
                u, v = (r + 1) % 3, (r + 2) % 3
                KK[i, u, v] += 0.5 * W[r]
                KK[i, v, u] -= 0.5 * W[r]
                KK[i, 3 + u, v] += W[3 + r]
                KK[i, 3 + v, u] -= W[3 + r]

    def run(q: Array) -> Answer:
        numba.set_num_threads(threads)
        N = len(q)
        K = {name: np.empty((N, 6, 6)) for name in ("jacobian", *"ABKF")}
        W = np.empty((N, 6))
        many(q, K["jacobian"], W, K["A"], K["B"], K["K"], K["F"])
        return {**K, "wrench": W}

    return run


def jax_closed_form(arm: Arm) -> Any:
    """The same arithmetic in JAX, jitted over a stack; all cores."""
    import jax
    import jax.numpy as jnp

    jax.config.update("jax_enable_x64", True)
    placements, axes, T_last = arm.constants
    cross = _skew(axes)
    squares = cross @ cross
    later = np.triu(np.ones((6, 6)), 1)
    basis = np.zeros((6, 6, 6))  # of [[moment]x, [force]x; [force]x, 0] in W
    for i, S in enumerate(_skew(np.eye(3))):
        basis[i, :3, :3] = S
        basis[3 + i, :3, 3:] = basis[3 + i, 3:, :3] = S
    shift = np.zeros((6, 6, 6))
    shift[:3, :3, :3] = 0.5 * basis[:3, :3, :3]
    shift[3:, 3:, :3] = basis[3:, 3:, :3]

    @jax.jit
    def many(q: Any) -> Any:
        s, c = jnp.sin(q)[..., None, None], 1 - jnp.cos(q)[..., None, None]
        R = jnp.broadcast_to(jnp.eye(3), (len(q), 3, 3))
        p, z, o = jnp.zeros((len(q), 3)), [], []
        for j in range(6):
            p = p + R @ placements[j, :3, 3]
            R = R @ (
                placements[j, :3, :3] @ (np.eye(3) + s[:, j] * cross[j] + c[:, j] * squares[j])
            )
            z.append(R @ axes[j])
            o.append(p)
        p, R = p + R @ T_last[:3, 3], R @ T_last[:3, :3]
        z, o = jnp.stack(z, 1), jnp.stack(o, 1)
        J = jnp.concatenate([z @ R, jnp.cross(z, p[:, None] - o) @ R], axis=2).transpose(0, 2, 1)
        A = jnp.linalg.inv(J)
        At = A.transpose(0, 2, 1)
        W = (At @ (arm.stiffness * (q - arm.rest))[..., None])[..., 0]
        M = jnp.einsum("nk,kij->nij", W, basis)
        K_F = (At * arm.stiffness) @ A
        K_A = K_F + At @ ((J.transpose(0, 2, 1) @ M @ J) * later) @ A
        K_K = K_A - jnp.einsum("nk,kij->nij", W, shift)
        return J, W, K_A, K_A - 0.5 * M, K_K, K_F

    def run(q: Array) -> Answer:
        names = ("jacobian", "wrench", *"ABKF")
        found = jax.block_until_ready(many(q))
        return dict(zip(names, map(np.asarray, found), strict=True))

    return run


def roboticstoolbox(arm: Arm) -> Any:
    """Its elementary transforms with C++ Jacobian and Hessian; K^A alone, and only the time counts.

    The Hessian that it gives is not the derivative of the body Jacobian.
    """
    import roboticstoolbox as rtb

    placements, axes, T_last = arm.constants
    ets = rtb.ETS()
    for T, axis in zip(placements, axes, strict=True):
        name = "xyz"[int(np.argmax(np.abs(axis)))]
        ets = ets * rtb.ET.SE3(T) * getattr(rtb.ET, f"R{name}")()
    ets = ets * rtb.ET.SE3(T_last)

    def run(q: Array) -> Answer:
        found = np.empty((len(q), 6, 6))
        for i in range(len(q)):
            J = ets.jacobe(q[i])
            H = ets.hessiane(q[i], Je=J)
            A = np.linalg.inv(J)
            W = (arm.stiffness * (q[i] - arm.rest)) @ A
            found[i] = A.T @ (np.diag(arm.stiffness) - np.tensordot(W, H, (0, 1))) @ A
        return {"timing only": found}

    return run
