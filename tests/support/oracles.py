"""Reference computations: nothing here calls the formulas under test.

Exponentials come from scipy's matrix exponential, kinematics from Pinocchio's forward kinematics on
the model as it was built, derivatives from eighth-order central differences.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pinocchio as pin
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

# Pinocchio's order is (linear, angular).
_ANGULAR_FIRST = [3, 4, 5, 0, 1, 2]


def absolute_error(got: Any, expected: Any) -> float:
    """Largest difference."""
    return float(np.abs(np.subtract(got, expected)).max())


def relative_error(got: Any, expected: Any) -> float:
    """Largest difference over the largest entry expected."""
    got, expected = np.asarray(got, float), np.asarray(expected, float)
    assert got.shape == expected.shape
    return float(np.abs(got - expected).max() / max(np.abs(expected).max(), 1e-300))


def cross_matrix(a: Any) -> np.ndarray:
    return np.array([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]], float)


def twist_matrix(x: Any) -> np.ndarray:
    m = np.zeros((4, 4))
    m[:3, :3] = cross_matrix(x[:3])
    m[:3, 3] = x[3:]
    return m


def twist_of(m: np.ndarray) -> np.ndarray:
    return np.array([m[2, 1], m[0, 2], m[1, 0], m[0, 3], m[1, 3], m[2, 3]])


def exp_reference(x: Any) -> np.ndarray:
    return expm(twist_matrix(np.asarray(x, float)))


def log_reference(T: np.ndarray) -> np.ndarray:
    """Logarithm: scipy's rotation vector, and the integral of its rotations for the translation."""
    w = Rotation.from_matrix(T[:3, :3]).as_rotvec()
    integral = expm(np.block([[cross_matrix(w), np.eye(3)], [np.zeros((3, 6))]]))[:3, 3:]
    return np.concatenate([w, np.linalg.solve(integral, T[:3, 3])])


def bracket_reference(x: Any, y: Any) -> np.ndarray:
    X, Y = twist_matrix(x), twist_matrix(y)
    return twist_of(X @ Y - Y @ X)


def adjoint_reference(T: np.ndarray) -> np.ndarray:
    inverse = np.linalg.inv(T)
    return np.stack([twist_of(T @ twist_matrix(e) @ inverse) for e in np.eye(6)], axis=1)


_FIRST = {1: 4 / 5, 2: -1 / 5, 3: 4 / 105, 4: -1 / 280}
_SECOND = {0: -205 / 72, 1: 8 / 5, 2: -1 / 5, 3: 8 / 315, 4: -1 / 560}


def slope(f: Callable[[float], Any], h: float) -> Any:
    """First derivative at 0, eighth order."""
    return sum(w * (np.asarray(f(m * h)) - np.asarray(f(-m * h))) for m, w in _FIRST.items()) / h


def bend(f: Callable[[float], float], h: float) -> float:
    """Second derivative at 0, eighth order."""
    total = _SECOND[0] * f(0.0)
    for m in range(1, 5):
        total += _SECOND[m] * (f(m * h) + f(-m * h))
    return total / h**2


def gradient_of(f: Callable[[np.ndarray], Any], sizes: Any, h: float = 0.01) -> np.ndarray:
    """Derivatives at 0 along each argument, last axis; `sizes` are the arguments' natural sizes."""
    columns = [slope(lambda t, e=e: f(t * e), h) / s for e, s in _directions(sizes)]
    return np.stack(columns, axis=-1)


def hessian_of(f: Callable[[np.ndarray], float], sizes: Any, h: float = 0.01) -> np.ndarray:
    """Second derivatives at 0 by polarisation."""
    d = list(_directions(sizes))
    n = len(d)
    H = np.empty((n, n))
    for i, (a, s) in enumerate(d):
        H[i, i] = bend(lambda t, a=a: f(t * a), h) / s**2
        for j, (b, r) in enumerate(d[:i]):
            plus = bend(lambda t, a=a, b=b: f(t * (a + b)), h)
            minus = bend(lambda t, a=a, b=b: f(t * (a - b)), h)
            H[i, j] = H[j, i] = 0.25 * (plus - minus) / (s * r)
    return H


def _directions(sizes: Any) -> Any:
    sizes = np.asarray(sizes, float)
    return [(e * s, s) for e, s in zip(np.eye(sizes.size), sizes, strict=True)]


def matrices_from(K_A: np.ndarray, W: np.ndarray) -> dict[str, np.ndarray]:
    """K^A, K^B, K^K, K^+ from K^A and the load, block by block."""
    t, f, o = cross_matrix(W[:3]), cross_matrix(W[3:]), np.zeros((3, 3))
    return {
        "A": K_A,
        "B": K_A - 0.5 * np.block([[t, f], [f, o]]),
        "K": K_A - np.block([[0.5 * t, o], [f, o]]),
        "+": K_A.T,
    }


def frame_pose(model: Any, q: np.ndarray, name: str) -> np.ndarray:
    """Pose of a frame by Pinocchio's forward kinematics."""
    data = model.createData()
    pin.framesForwardKinematics(model, data, q)
    return data.oMf[model.getFrameId(name)].homogeneous.copy()


def body_jacobian(model: Any, q: np.ndarray, name: str) -> np.ndarray:
    """Body Jacobian, angular rows first, from Pinocchio's local frame Jacobian."""
    data = model.createData()
    J = pin.computeFrameJacobian(model, data, q, model.getFrameId(name), pin.ReferenceFrame.LOCAL)
    return np.array(J).reshape(6, model.nv)[_ANGULAR_FIRST]


class ReducedEnergy:
    """min Phi(q) over all q that hold a frame at a pose and keep points or frames together.

    Kinematics and Jacobians are Pinocchio's own on the model given; the minimum is found by
    Newton-like steps on the conditions of stationarity.
    """

    def __init__(
        self,
        model: Any,
        frame: str,
        q: np.ndarray,
        energy: Callable[[np.ndarray], float],
        gradient: Callable[[np.ndarray], np.ndarray],
        stiffness: np.ndarray,
        *,
        points: Sequence[tuple[str, str]] = (),
        welds: Sequence[tuple[str, str]] = (),
        offset: np.ndarray | None = None,
    ) -> None:
        self.model, self.q0 = model, np.array(q, float)
        self.energy, self.gradient = energy, gradient
        self.stiffness = stiffness
        self.data = model.createData()
        self.frame = model.getFrameId(frame)
        self.points = [(model.getFrameId(a), model.getFrameId(b)) for a, b in points]
        self.welds = [(model.getFrameId(a), model.getFrameId(b)) for a, b in welds]
        self.offset = np.eye(4) if offset is None else offset
        self.pose0 = frame_pose(model, self.q0, frame) @ self.offset

    def conditions(self, q: np.ndarray, target: np.ndarray | None) -> tuple[np.ndarray, np.ndarray]:
        """Residual and its Jacobian (exact where the residual vanishes)."""
        model, data = self.model, self.data
        pin.computeJointJacobians(model, data, q)
        pin.updateFramePlacements(model, data)
        local, aligned = pin.ReferenceFrame.LOCAL, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        residuals, rows = [], []
        if target is not None:
            T = data.oMf[self.frame].homogeneous @ self.offset
            residuals.append(_small_twist(np.linalg.inv(target) @ T))
            J = np.array(pin.getFrameJacobian(model, data, self.frame, local))[_ANGULAR_FIRST]
            rows.append(np.linalg.inv(adjoint_reference(self.offset)) @ J)
        for a, b in self.points:
            residuals.append(data.oMf[b].translation - data.oMf[a].translation)
            J_a = np.array(pin.getFrameJacobian(model, data, a, aligned))[:3]
            rows.append(np.array(pin.getFrameJacobian(model, data, b, aligned))[:3] - J_a)
        for a, b in self.welds:
            T_b_a = (data.oMf[b].inverse() * data.oMf[a]).homogeneous
            residuals.append(_small_twist(np.linalg.inv(T_b_a)))
            J_a = np.array(pin.getFrameJacobian(model, data, a, local))[_ANGULAR_FIRST]
            J_b = np.array(pin.getFrameJacobian(model, data, b, local))[_ANGULAR_FIRST]
            rows.append(J_b - adjoint_reference(T_b_a) @ J_a)
        return np.concatenate(residuals), np.concatenate(rows)

    def solve(self, target: np.ndarray | None) -> tuple[np.ndarray, np.ndarray]:
        """Coordinates at the minimum and the forces of all conditions."""
        q, n = self.q0.copy(), self.q0.size
        H = np.diag(self.stiffness)
        previous = np.inf
        for _ in range(200):
            residual, D = self.conditions(q, target)
            m = len(residual)
            g = self.gradient(q)
            matrix = np.block([[H, D.T], [D, np.zeros((m, m))]])
            step = np.linalg.lstsq(matrix, -np.concatenate([g, residual]), rcond=1e-11)[0]
            size = float(np.abs(step[:n]).max())
            q = q + step[:n] * min(1.0, 0.3 / max(size, 1e-300))
            if size < 1e-14 or (size < 1e-12 and size >= previous):
                break
            previous = size
        _, D = self.conditions(q, target)
        return q, np.linalg.lstsq(D.T, self.gradient(q), rcond=1e-11)[0]

    def at(self, twist: np.ndarray) -> float:
        """Energy with the frame displaced along a screw motion from where it was."""
        return self.energy(self.solve(self.pose0 @ exp_reference(twist))[0])

    def wrench(self, twist: np.ndarray) -> np.ndarray:
        """Wrench that holds the frame there, in its own components."""
        return self.solve(self.pose0 @ exp_reference(twist))[1][:6]


def _small_twist(T: np.ndarray) -> np.ndarray:
    A = 0.5 * (T[:3, :3] - T[:3, :3].T)
    return np.array([A[2, 1], A[0, 2], A[1, 0], *T[:3, 3]])


def spring_energy(k: np.ndarray, rest: np.ndarray) -> tuple[Callable[..., Any], Callable[..., Any]]:
    """Energy and gradient of springs written out by hand."""
    return (lambda q: 0.5 * float(k @ (q - rest) ** 2)), (lambda q: k * (q - rest))


def mass_energy(model: Any, acceleration: np.ndarray) -> Callable[[np.ndarray], float]:
    """Energy of all masses from the position of their common centre."""
    data = model.createData()
    mass = pin.computeTotalMass(model)

    def energy(q: np.ndarray) -> float:
        return -mass * float(acceleration @ pin.centerOfMass(model, data, q))

    return energy


def mass_gradient(model: Any, acceleration: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
    """Gradient of `mass_energy` from the Jacobian of the common centre."""
    data = model.createData()
    mass = pin.computeTotalMass(model)

    def gradient(q: np.ndarray) -> np.ndarray:
        return -mass * np.array(pin.jacobianCenterOfMass(model, data, q)).T @ acceleration

    return gradient


def tip_compliance(beam: dict[str, float]) -> np.ndarray:
    """Clamped-free beam along x: (rotation, displacement) of the tip per (moment, force)."""
    L, C = beam["length"], np.zeros((6, 6))
    C[0, 0], C[3, 3] = L / (beam["G"] * beam["J"]), L / (beam["E"] * beam["area"])
    for turn, shift, sign, inertia in ((2, 4, 1, "Iz"), (1, 5, -1, "Iy")):
        bending = beam["E"] * beam[inertia]
        C[turn, turn], C[shift, shift] = L / bending, L**3 / (3 * bending)
        C[turn, shift] = C[shift, turn] = sign * L**2 / (2 * bending)
    return C
