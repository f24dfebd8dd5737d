"""Samplers, builders and reference computations shared by the tests.

Nothing here calls the formulas under test: exponentials come from scipy's matrix exponential,
kinematics from Pinocchio's forward kinematics on the model as it was built, derivatives from
eighth-order central differences.
"""

from __future__ import annotations

import json
import site
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import strategies as st
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from cartstiff.mechanisms.chain import Chain, Closure
from cartstiff.mechanisms.contract import Units
from cartstiff.mechanisms.elastic import ElasticMechanism
from cartstiff.mechanisms.platform import Platform
from cartstiff.mechanisms.tree_building import plain_tree
from cartstiff.potentials.line_springs import LineSprings
from cartstiff.potentials.springs import JointSprings

DATA = Path(__file__).parent / "data"
_ROBOTS = Path("cmeel.prefix") / "share" / "example-robot-data" / "robots"

# Pinocchio's order is (linear, angular).
_ANGULAR_FIRST = [3, 4, 5, 0, 1, 2]


def reference(name: str) -> dict[str, Any]:
    return json.loads((DATA / name).read_text(encoding="utf-8"))


def robot_file(relative: str) -> str:
    """Path of a file of example-robot-data; skips the test where the package is not installed."""
    for folder in [*site.getsitepackages(), *sys.path]:
        path = Path(folder) / _ROBOTS / relative
        if path.is_file():
            return str(path)
    pytest.skip(f"example-robot-data is not installed: {relative}")


def relative_error(got: Any, expected: Any) -> float:
    """Largest difference over the largest entry expected."""
    got, expected = np.asarray(got, float), np.asarray(expected, float)
    assert got.shape == expected.shape
    return float(np.abs(got - expected).max() / max(np.abs(expected).max(), 1e-300))


# -- rigid motions, without the library ---------------------------------------------------------


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


def rotation(rng: np.random.Generator) -> np.ndarray:
    return Rotation.random(random_state=rng).as_matrix()


def random_pose(rng: np.random.Generator, size: float = 1.0) -> np.ndarray:
    T = np.eye(4)
    T[:3, :3] = rotation(rng)
    T[:3, 3] = rng.uniform(-size, size, 3)
    return T


def translation(*p: float) -> np.ndarray:
    T = np.eye(4)
    T[:3, 3] = p
    return T


# -- samplers -----------------------------------------------------------------------------------

_unit_floats = st.floats(-1, 1, allow_nan=False, width=64)
_axes = (
    st.tuples(_unit_floats, _unit_floats, _unit_floats)
    .map(np.array)
    .filter(lambda a: np.linalg.norm(a) > 0.1)
    .map(lambda a: a / np.linalg.norm(a))
)
_vectors = st.tuples(*[st.floats(-2, 2, allow_nan=False)] * 3).map(np.array)
_tiny = st.floats(-9, -3).map(lambda e: 10.0**e)
_angles = {
    "generic": st.floats(0.05, 3.0),
    "small": st.floats(1e-3, 0.2),  # where series hand over to closed forms
    "near identity": _tiny,
    "near pi": _tiny.map(lambda e: np.pi - e),
    "at pi": st.just(np.pi),
    "zero": st.just(0.0),
}


@st.composite
def twists(draw: Any, kinds: Sequence[str] = tuple(_angles)) -> np.ndarray:
    """Twists (omega, v) with generic, tiny, near-pi, exactly-pi and zero rotation angles."""
    angle = draw(_angles[draw(st.sampled_from(list(kinds)))])
    v = draw(_vectors)
    if draw(st.booleans()) and angle < 1e-2:
        v = v * angle  # the whole motion near the identity, not only its rotation
    return np.concatenate([angle * draw(_axes), v])


def poses(kinds: Sequence[str] = tuple(_angles)) -> st.SearchStrategy[np.ndarray]:
    return twists(kinds).map(exp_reference)


wrenches = st.tuples(*[st.floats(-5, 5, allow_nan=False)] * 6).map(np.array)
plain_twists = st.tuples(*[st.floats(-2, 2, allow_nan=False)] * 6).map(np.array)
seeds = st.integers(0, 2**32 - 1)


# -- differences --------------------------------------------------------------------------------

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


# -- connection terms written out by hand -------------------------------------------------------


def matrices_from(K_A: np.ndarray, W: np.ndarray) -> dict[str, np.ndarray]:
    """K^A, K^B, K^K, K^+ from K^A and the load, block by block."""
    t, f, o = cross_matrix(W[:3]), cross_matrix(W[3:]), np.zeros((3, 3))
    return {
        "A": K_A,
        "B": K_A - 0.5 * np.block([[t, f], [f, o]]),
        "K": K_A - np.block([[0.5 * t, o], [f, o]]),
        "+": K_A.T,
    }


# -- serial arms --------------------------------------------------------------------------------

_JOINTS: dict[str, Callable[[np.ndarray], Any]] = {
    "R": lambda a: pin.JointModelRevoluteUnaligned(a),
    "P": lambda a: pin.JointModelPrismaticUnaligned(a),
    "H": lambda a: pin.JointModelHelicalUnaligned(a, 0.17),
}


def _inertia(rng: np.random.Generator) -> Any:
    return pin.Inertia(rng.uniform(0.5, 2.0), rng.uniform(-0.2, 0.2, 3), 0.01 * np.eye(3))


def add_chain(
    model: Any, kinds: str, rng: np.random.Generator, prefix: str = "j", root: Any = None
) -> int:
    """Append a chain of joints with arbitrary axes; returns the last joint's index."""
    parent = 0
    for i, kind in enumerate(kinds, start=1):
        axis = rng.normal(size=3)
        axis /= np.linalg.norm(axis)
        at = random_pose(rng, 0.4)
        if i == 1 and root is not None:
            at = root @ at
        parent = model.addJoint(parent, _JOINTS[kind](axis), pin.SE3(at), f"{prefix}{i}")
        model.appendBodyToJoint(parent, _inertia(rng), pin.SE3.Identity())
    return parent


def add_frame(model: Any, name: str, joint: int, T: np.ndarray) -> None:
    model.addFrame(pin.Frame(name, joint, 0, pin.SE3(T), pin.FrameType.OP_FRAME))


def serial_model(kinds: str, rng: np.random.Generator) -> Any:
    """An arm with joints of the given kinds (R, P, H), arbitrary axes, and a frame "tip"."""
    model = pin.Model()
    model.name = kinds
    last = add_chain(model, kinds, rng)
    add_frame(model, "tip", last, random_pose(rng, 0.3))
    return model


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


def joint_springs(
    n: int, rng: np.random.Generator, q: np.ndarray, torque: np.ndarray
) -> JointSprings:
    k = rng.uniform(40.0, 120.0, n)
    return JointSprings(k, q - torque / k)


def _far_from_singular(model: Any, rng: np.random.Generator) -> np.ndarray:
    """The best conditioned of some random postures: differences need room to move."""

    def condition(q: np.ndarray) -> float:
        values = np.linalg.svd(body_jacobian(model, q, "tip"), compute_uv=False)
        return float(values[0] / values[-1])

    return min((rng.uniform(-1.5, 1.5, model.nv) for _ in range(40)), key=condition)


@dataclass
class Arm:
    """An arm in Pinocchio and in the library, at a posture with loaded springs."""

    model: Any
    elastic: ElasticMechanism
    q: np.ndarray
    wrench: np.ndarray


def loaded_arm(kinds: str, seed: int, load: float = 6.0, offset: Any = None) -> Arm:
    """A preloaded arm whose torques are those of a wrench at the tip."""
    rng = np.random.default_rng(seed)
    model = serial_model(kinds, rng)
    W = load * rng.uniform(-1, 1, 6)
    q = _far_from_singular(model, rng)
    chain = Chain(plain_tree(model), "tip", offset=offset)
    J = body_jacobian(model, q, "tip")
    if offset is not None:
        J = np.linalg.inv(adjoint_reference(offset)) @ J
    springs = joint_springs(len(kinds), rng, q, J.T @ W)
    return Arm(model, ElasticMechanism(kinds, chain, q, springs), q, W)


# -- platforms ----------------------------------------------------------------------------------


def paper_geometry() -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Base points, platform points, stiffnesses, rest lengths of the paper's six legs."""
    d = reference("paper_tables.json")
    base = np.array([d["base"][leg[0]] for leg in d["legs"]], float)
    platform = np.array([d["platform"][leg[1]] for leg in d["legs"]], float)
    return base, platform, np.array(d["stiffness"], float), np.array(d["rest_length"], float)


def platform_mechanism(
    base: np.ndarray,
    platform: np.ndarray,
    stiffness: np.ndarray,
    rest: np.ndarray,
    *,
    q: Any = None,
    T_P_M: Any = None,
    units: Units | None = None,
    **options: Any,
) -> ElasticMechanism:
    mechanism = Platform(base, platform, T_P_M=T_P_M, units=units or Units(), **options)
    springs = LineSprings(
        anchors=mechanism.anchors,
        points=mechanism.points,
        stiffness=stiffness,
        rest_length=rest,
    )
    q = np.zeros(6) if q is None else np.asarray(q, float)
    return ElasticMechanism("platform", mechanism, q, springs)


def paper_platform(T_P_M: Any = None, scale: float = 1.0, **options: Any) -> ElasticMechanism:
    """The paper's platform; `scale` = 0.01 gives the same machine in metres."""
    base, platform, k, rest = paper_geometry()
    units = Units("cm", "N") if scale == 1.0 else Units("m", "N")
    return platform_mechanism(
        scale * base, scale * platform, k / scale, scale * rest, T_P_M=T_P_M, units=units, **options
    )


@dataclass
class LegGeometry:
    """Six legs, a platform pose, springs along the legs."""

    base: np.ndarray
    platform: np.ndarray
    q: np.ndarray
    stiffness: np.ndarray
    rest: np.ndarray
    lengths: np.ndarray = field(default_factory=lambda: np.zeros(6))


def general_legs(seed: int = 5, stretch: float = 0.05) -> LegGeometry:
    """A six-legged platform of general geometry (metres), preloaded in tension and compression."""
    rng = np.random.default_rng(seed)
    angles = np.deg2rad([10, 110, 130, 230, 250, 350])
    base = np.stack([np.cos(angles), np.sin(angles), 0 * angles], 1) + rng.uniform(
        -0.1, 0.1, (6, 3)
    )
    turned = np.deg2rad([50, 70, 170, 190, 290, 310])
    platform = 0.5 * np.stack([np.cos(turned), np.sin(turned), 0 * turned], 1)
    platform = platform + rng.uniform(-0.05, 0.05, (6, 3))
    q = np.array([0.05, -0.08, 0.9, 0.1, -0.15, 0.2])
    R = Rotation.from_euler("xyz", q[3:]).as_matrix()
    lengths = np.linalg.norm(platform @ R.T + q[:3] - base, axis=1)
    rest = lengths - stretch * rng.uniform(-1, 1, 6)
    return LegGeometry(base, platform, q, rng.uniform(500.0, 1500.0, 6), rest, lengths)


def legs_as_platform(legs: LegGeometry, **options: Any) -> ElasticMechanism:
    return platform_mechanism(
        legs.base, legs.platform, legs.stiffness, legs.rest, q=legs.q, **options
    )


def legs_as_tree(
    legs: LegGeometry,
    *,
    passive: float = 0.0,
    passive_torque: float = 0.0,
    spins: bool = False,
    gravity: Any = None,
    seed: int = 2,
) -> tuple[Any, ElasticMechanism]:
    """Six universal-prismatic legs; the first carries the body on a spherical joint, the other
    five end in points tied to it. `spins` adds a free rotation of those legs about themselves.
    """
    rng = np.random.default_rng(seed)
    model = pin.Model()
    T_body = np.eye(4)
    T_body[:3, :3] = Rotation.from_euler("xyz", legs.q[3:]).as_matrix()
    T_body[:3, 3] = legs.q[:3]
    names: list[str] = []
    q: list[float] = []
    tips = []
    body = 0
    for s in range(6):
        along = T_body[:3, :3] @ legs.platform[s] + T_body[:3, 3] - legs.base[s]
        length = float(np.linalg.norm(along))
        # The leg's direction is the z-axis after Rx(a) Ry(b), reached from a tilted base.
        tilt = Rotation.from_euler("xyz", rng.uniform(-0.3, 0.3, 3)).as_matrix()
        x, y, z = tilt.T @ along / length
        at = np.eye(4)
        at[:3, :3], at[:3, 3] = tilt, legs.base[s]
        parent = model.addJoint(0, pin.JointModelRX(), pin.SE3(at), f"leg{s}.u1")
        parent = model.addJoint(parent, pin.JointModelRY(), pin.SE3.Identity(), f"leg{s}.u2")
        parent = model.addJoint(parent, pin.JointModelPZ(), pin.SE3.Identity(), f"leg{s}.p")
        model.appendBodyToJoint(parent, _inertia(rng), pin.SE3.Identity())
        q += [float(np.arctan2(-y, z)), float(np.arcsin(x)), length]
        names += [f"leg{s}.u1", f"leg{s}.u2", f"leg{s}.p"]
        if s == 0:
            R_leg = tilt @ Rotation.from_euler("XY", q[-3:-1]).as_matrix()
            angles = Rotation.from_matrix(R_leg.T @ T_body[:3, :3]).as_euler("XYZ")
            for axis, angle in zip("XYZ", angles, strict=True):
                joint = getattr(pin, f"JointModelR{axis}")()
                parent = model.addJoint(parent, joint, pin.SE3.Identity(), f"ball.{axis}")
                q.append(float(angle))
                names.append(f"ball.{axis}")
            body = parent
            model.appendBodyToJoint(body, _inertia(rng), pin.SE3.Identity())
            add_frame(model, "platform", body, translation(*(-legs.platform[0])))
        elif spins:
            parent = model.addJoint(parent, pin.JointModelRZ(), pin.SE3.Identity(), f"leg{s}.spin")
            q.append(0.3)
            names.append(f"leg{s}.spin")
        tips.append(parent)
    closures = []
    for s in range(1, 6):
        add_frame(model, f"tip{s}", tips[s], np.eye(4))
        add_frame(model, f"point{s}", body, translation(*(legs.platform[s] - legs.platform[0])))
        closures.append(Closure(f"point{s}", f"tip{s}", "point"))
    prismatic = [names.index(f"leg{s}.p") for s in range(6)]
    chain = Chain(
        plain_tree(model), "platform", closures=closures, actuated=prismatic, kind="closed-chain"
    )
    position = np.array(q)
    k = np.zeros(len(q))
    rest = position.copy()
    k[prismatic], rest[prismatic] = legs.stiffness, legs.rest
    hinges = [i for i, n in enumerate(names) if not n.endswith((".p", ".spin"))]
    if passive:
        k[hinges] = passive * rng.uniform(0.5, 1.5, len(hinges))
        rest[hinges] = position[hinges] - passive_torque * rng.uniform(-1, 1, len(hinges)) / passive
    elastic = ElasticMechanism("tree", chain, position, JointSprings(k, rest), gravity=gravity)
    return model, elastic


# -- the energy left when everything but the pose is minimised -----------------------------------


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
