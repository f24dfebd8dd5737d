"""Arms, platforms and files that the tests are about."""

from __future__ import annotations

import json
import site
import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation

from cartstiff import (
    DeadForce,
    DeadWrench,
    ElasticMechanism,
    FollowerWrench,
    JointSprings,
    LineSprings,
)
from cartstiff.extend import Platform
from tests.doors import Chain, Closure, Units, plain_tree
from tests.support.oracles import (
    adjoint_reference,
    body_jacobian,
)
from tests.support.samplers import random_pose

DATA = Path(__file__).parents[1] / "data"
_ROBOTS = Path("cmeel.prefix") / "share" / "example-robot-data" / "robots"


def reference(name: str) -> dict[str, Any]:
    return json.loads((DATA / name).read_text(encoding="utf-8"))


def robot_file(relative: str) -> str:
    """Path of a file of example-robot-data; skips the test where the package is not installed."""
    for folder in [*site.getsitepackages(), *sys.path]:
        path = Path(folder) / _ROBOTS / relative
        if path.is_file():
            return str(path)
    pytest.skip(f"example-robot-data is not installed: {relative}")


def translation(*p: float) -> np.ndarray:
    T = np.eye(4)
    T[:3, 3] = p
    return T


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


def links(
    stiffness: Any,
    *,
    rest: float = 0.0,
    length: float = 1.0,
    masses: Any = (),
    inertia: float = 0.0,
    axes: str = "Z",
) -> ElasticMechanism:
    """Links along x on springs at their feet, about each of some axes; masses at their ends."""
    k = np.asarray(stiffness, float)
    model, joint = pin.Model(), 0
    for i in range(len(k)):
        first = i % len(axes) == 0
        at = pin.SE3(translation(length if i and first else 0.0, 0.0, 0.0))
        turn = getattr(pin, f"JointModelR{axes[i % len(axes)]}")()
        joint = model.addJoint(joint, turn, at, f"joint{i + 1}")
        if i < len(masses) and masses[i]:
            body = pin.Inertia(masses[i], np.array([length, 0.0, 0.0]), inertia * np.eye(3))
            model.appendBodyToJoint(joint, body, pin.SE3.Identity())
    add_frame(model, "tip", joint, translation(length, 0.0, 0.0))
    springs = JointSprings(k, np.full(len(k), rest))
    return ElasticMechanism("column", Chain(plain_tree(model), "tip"), np.zeros(len(k)), springs)


@dataclass
class LegGeometry:
    """Six legs, a platform pose, springs along the legs."""

    base: np.ndarray
    platform: np.ndarray
    q: np.ndarray
    stiffness: np.ndarray
    rest: np.ndarray
    lengths: np.ndarray = field(default_factory=lambda: np.zeros(6))

    def energy(self, T: np.ndarray) -> float:
        """Energy of the springs with the platform at a pose."""
        along = self.platform @ T[:3, :3].T + T[:3, 3] - self.base
        return 0.5 * float(self.stiffness @ (np.linalg.norm(along, axis=1) - self.rest) ** 2)


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


def spread_springs(rng: np.random.Generator, count: int, decades: float) -> np.ndarray:
    """Stiffnesses over so many decades from 1e-3 on, both ends among them."""
    k = 10.0 ** rng.uniform(-3, decades - 3, count)
    k[rng.permutation(count)[:2]] = 1e-3, 10.0 ** (decades - 3)
    return k


def hexagons(distance: float, stiffness: Any) -> ElasticMechanism:
    """Six legs between symmetric hexagons; turned by a right angle they are singular."""
    corners = np.repeat(2 * np.pi / 3 * np.arange(3), 2)
    base, top = (
        np.array([[r * np.cos(a), r * np.sin(a), 0.0] for a in corners + np.tile([-h, h], 3)])
        for r, h in ((0.5, 0.3), (0.3, 0.7))
    )
    q = np.array([0.0, 0.0, 0.4, 0.0, 0.0, 0.5 * np.pi - distance])
    return platform_mechanism(base, top, stiffness, np.full(6, np.nan), q=q)


def loads_of(kind: str, w: np.ndarray, at: np.ndarray, R: np.ndarray, size: float) -> list[Any]:
    """A load about the body's point `at` by forces that stay or turn; R is the body's attitude.

    A conservative moment is that of dead forces on two crossed bars, half as long as `size`: it
    turns by half.
    """
    if kind == "follower":
        return [FollowerWrench([*(w[:3] + np.cross(at, w[3:])), *w[3:]])]
    loads: list[Any] = [DeadForce(R @ w[3:], at)] if w[3:].any() else []
    if kind == "conservative" and w[:3].any():
        loads += [DeadForce(R @ force, end) for end, force in crossed_bars(w[:3], size)]
    elif w[:3].any():
        loads.append(DeadWrench([*(R @ w[:3]), 0.0, 0.0, 0.0]))
    return loads


def crossed_bars(moment: np.ndarray, size: float) -> list[tuple[np.ndarray, np.ndarray]]:
    """Ends of two crossed bars and the forces there whose moment is the given one."""
    z = moment / np.linalg.norm(moment)
    x = np.cross(np.eye(3)[int(np.argmin(np.abs(z)))], z)
    x /= np.linalg.norm(x)
    y, force = np.cross(z, x), np.linalg.norm(moment) / (4.0 * size)
    return [(size * a, force * b) for a, b in ((x, y), (-x, -y), (y, -x), (-y, x))]


def promised(result: Any, matrix: str = "compliance") -> float:
    """The relative error that the notes admit."""
    found = [n.values for n in result.notes if n.code == "ill-conditioned"]
    return max((v["relative_error"] for v in found if v["matrix"] == matrix), default=0.0)
