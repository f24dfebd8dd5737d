"""Generated mechanisms with their set-up, and what every command should say of them.

The numbers are computed here from matrices alone: poses by products of exponentials, forces by
virtual work, their derivatives by differences.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from tests.support.oracles import exp_reference

#: Differences of forces over steps of 1e-4: rounding over the step, the error of h^2 removed.
DIFFERENCES = 1e-7
#: Gravity of the room, m/s^2.
EARTH = np.array([0.0, 0.0, -9.81])


def frame(xyz: Any, rpy: Any) -> np.ndarray:
    """The transform that files write as xyz and rpy (fixed axes)."""
    T = np.eye(4)
    T[:3, :3] = Rotation.from_euler("xyz", rpy).as_matrix()
    T[:3, 3] = xyz
    return T


def numbers(values: Any) -> str:
    return ",".join(repr(float(v)) for v in np.ravel(values))


@dataclass(frozen=True)
class Arm:
    """A generated arm with its set-up, as matrices."""

    base: tuple[np.ndarray, np.ndarray]  # xyz, rpy of the robot's base in the room
    places: list[tuple[np.ndarray, np.ndarray]]  # of each joint in the link before
    axes: np.ndarray
    slides: np.ndarray  # which joints are prismatic
    flange: tuple[np.ndarray, np.ndarray]  # the frame `flange` in the last link
    tool: tuple[np.ndarray, np.ndarray]  # M in the flange
    masses: np.ndarray
    centres: np.ndarray
    payload: tuple[float, np.ndarray]  # on M
    k: np.ndarray
    q: np.ndarray
    W: np.ndarray  # moment and force along the room's axes, at `at` of M
    at: np.ndarray

    @classmethod
    def generated(cls, seed: int) -> Arm:
        rng = np.random.default_rng(seed)
        n = int(rng.integers(2, 8))

        def place(size: float) -> tuple[np.ndarray, np.ndarray]:
            return rng.uniform(-size, size, 3), rng.uniform(-1.5, 1.5, 3)

        axes = rng.normal(size=(n, 3))
        slides = rng.random(n) < 0.2
        return cls(
            base=place(1.0),
            places=[place(0.4) for _ in range(n)],
            axes=axes / np.linalg.norm(axes, axis=1, keepdims=True),
            slides=slides,
            flange=place(0.2),
            tool=place(0.2),
            masses=rng.uniform(0.5, 4.0, n),
            centres=rng.uniform(-0.2, 0.2, (n, 3)),
            payload=(float(rng.uniform(0.5, 3.0)), rng.uniform(-0.1, 0.1, 3)),
            k=np.where(slides, 1e6, 2e4) * rng.uniform(0.5, 2.0, n),
            q=np.where(slides, 0.1, 1.0) * rng.uniform(-1.0, 1.0, n),
            W=np.concatenate([np.zeros(3), rng.uniform(-60.0, 60.0, 3)]),
            at=rng.uniform(-0.2, 0.2, 3),
        )

    @property
    def n(self) -> int:
        return len(self.k)

    @property
    def at_origin(self) -> Arm:
        """The same, with its load at M's origin."""
        return replace(self, at=np.zeros(3))

    # -- kinematics ----------------------------------------------------------------------------

    def links(self, q: np.ndarray) -> list[np.ndarray]:
        """Poses of the links in the room."""
        T, found = frame(*self.base), []
        for place, axis, slides, x in zip(self.places, self.axes, self.slides, q, strict=True):
            twist = np.concatenate([np.zeros(3), axis] if slides else [axis, np.zeros(3)])
            T = T @ frame(*place) @ exp_reference(x * twist)
            found.append(T)
        return found

    def pose(self, q: np.ndarray) -> np.ndarray:
        return self.links(q)[-1] @ frame(*self.flange) @ frame(*self.tool)

    def jacobian_at(self, q: np.ndarray, link: int, p: np.ndarray) -> np.ndarray:
        """Rotation and translation, along the room's axes, of the point p (room) of a link."""
        J = np.zeros((6, self.n))
        for i, T in enumerate(self.links(q)[: link + 1]):
            a = T[:3, :3] @ self.axes[i]
            J[:, i] = (
                np.concatenate([np.zeros(3), a])
                if self.slides[i]
                else np.concatenate([a, np.cross(a, p - T[:3, 3])])
            )
        return J

    def body_jacobian(self, q: np.ndarray) -> np.ndarray:
        T = self.pose(q)
        J = self.jacobian_at(q, self.n - 1, T[:3, 3])
        return np.vstack([T[:3, :3].T @ J[:3], T[:3, :3].T @ J[3:]])

    # -- forces --------------------------------------------------------------------------------

    def outer(self, q: np.ndarray) -> np.ndarray:
        """Work of weight and load per unit of each coordinate."""
        links, T = self.links(q), self.pose(q)
        found = np.zeros(self.n)
        for i, (m, c) in enumerate(zip(self.masses, self.centres, strict=True)):
            p = links[i][:3, :3] @ c + links[i][:3, 3]
            found += m * EARTH @ self.jacobian_at(q, i, p)[3:]
        m, c = self.payload
        p = T[:3, :3] @ c + T[:3, 3]
        found += m * EARTH @ self.jacobian_at(q, self.n - 1, p)[3:]
        p = T[:3, :3] @ self.at + T[:3, 3]
        return found + self.W @ self.jacobian_at(q, self.n - 1, p)

    def rest(self) -> np.ndarray:
        """Where the springs must be unloaded to balance weight and load at q."""
        return self.q - self.outer(self.q) / self.k

    def compliance(self, q: np.ndarray) -> np.ndarray:
        """J H^-1 J^T with H the derivative of all joint forces."""
        H = np.diag(self.k)
        for i in range(self.n):
            e = np.eye(self.n)[i]

            def slope(h: float, e: np.ndarray = e) -> np.ndarray:
                return (self.outer(q + h * e) - self.outer(q - h * e)) / (2 * h)

            H[:, i] -= (4 * slope(1e-4) - slope(2e-4)) / 3
        J = self.body_jacobian(q)
        return J @ np.linalg.solve(H, J.T)

    # -- files ---------------------------------------------------------------------------------

    def written(self, folder: Path) -> Path:
        """The arm as a URDF with its mechanism file."""
        parts = ["<robot name='generated'><link name='l0'/>"]
        for i in range(self.n):
            (xyz, rpy), kind = self.places[i], "prismatic" if self.slides[i] else "revolute"
            parts.append(
                f"<link name='l{i + 1}'><inertial><origin xyz='{_words(self.centres[i])}'/>"
                f"<mass value='{float(self.masses[i])!r}'/><inertia ixx='.1' iyy='.1' izz='.1' "
                "ixy='0' ixz='0' iyz='0'/></inertial></link>"
                f"<joint name='j{i}' type='{kind}'><parent link='l{i}'/><child link='l{i + 1}'/>"
                f"<origin xyz='{_words(xyz)}' rpy='{_words(rpy)}'/>"
                f"<axis xyz='{_words(self.axes[i])}'/>"
                "<limit lower='-3' upper='3' effort='0' velocity='0'/></joint>"
            )
        xyz, rpy = self.flange
        parts.append(
            f"<link name='flange'/><joint name='f' type='fixed'><parent link='l{self.n}'/>"
            f"<child link='flange'/><origin xyz='{_words(xyz)}' rpy='{_words(rpy)}'/></joint>"
            "</robot>"
        )
        (folder / "arm.urdf").write_text("".join(parts))
        data = {
            "kind": "serial",
            "model": "arm.urdf",
            "frame": "flange",
            "base": dict(zip(("xyz", "rpy"), map(_list, self.base), strict=True)),
            "offset": dict(zip(("xyz", "rpy"), map(_list, self.tool), strict=True)),
            "gravity": _list(EARTH),
            "payload": {"mass": self.payload[0], "com": _list(self.payload[1])},
            "springs": {f"j{i}": {"stiffness": float(k)} for i, k in enumerate(self.k)},
            "q": {f"j{i}": float(x) for i, x in enumerate(self.q)},
        }
        file = folder / "arm.yaml"
        file.write_text(yaml.safe_dump(data))
        return file

    @property
    def load_words(self) -> list[str]:
        return ["--load", numbers(self.W), "--world", "--load-at", numbers(self.at)]

    @property
    def load(self) -> dict[str, Any]:
        return {"wrench": self.W, "load_axes": "world", "load_at": self.at}


def _list(values: Any) -> list[float]:
    return [float(v) for v in values]


def _words(values: Any) -> str:
    return " ".join(repr(float(v)) for v in values)


def close(got: Any, expected: Any, tolerance: float = DIFFERENCES) -> None:
    expected = np.asarray(expected, float)
    largest = np.max(np.abs(expected))
    np.testing.assert_allclose(got, expected, rtol=0, atol=tolerance * largest)


@dataclass(frozen=True)
class FourBar:
    """Crank, coupler and rocker in the plane y = 0 of the room; M is the coupler's frame.

    Or crank, coupler and a slider along x; the coupler has a mass, which weighs where the file has
    gravity.
    """

    crank: float
    coupler: float
    rocker: float
    ground: float
    k: float
    turn: float
    W: np.ndarray
    at: np.ndarray
    mass: float
    centre: np.ndarray
    is_heavy: bool = False
    slides: bool = False

    @classmethod
    def generated(cls, seed: int) -> FourBar:
        rng = np.random.default_rng(100 + seed)
        return cls(
            *rng.uniform([0.25, 0.45, 0.3, 0.45], [0.35, 0.6, 0.4, 0.55]).tolist(),
            k=float(rng.uniform(500, 5000)),
            turn=float(rng.uniform(-0.5, 0.5)),
            W=np.concatenate([np.zeros(3), rng.uniform(-50, 50, 3)]),
            at=rng.uniform(-0.1, 0.1, 3),
            mass=float(rng.uniform(1.0, 5.0)),
            centre=rng.uniform(-0.1, 0.1, 3),
        )

    def pose(self, turn: float) -> np.ndarray:
        """Of the coupler, whose end lies where two circles meet, above the ground."""
        P, Q = self._ends(turn)
        return frame([P[0], 0.0, P[1]], [0.0, np.arctan2(P[1] - Q[1], Q[0] - P[0]), 0.0])

    def _ends(self, turn: float) -> tuple[np.ndarray, np.ndarray]:
        """Of the coupler, in the plane."""
        P = self.crank * np.array([np.sin(turn), np.cos(turn)])
        if self.slides:
            return P, np.array([P[0] + np.sqrt(self.coupler**2 - P[1] ** 2), 0.0])
        way = np.array([self.ground, 0.0]) - P
        d = np.linalg.norm(way)
        along = (self.coupler**2 - self.rocker**2 + d**2) / (2 * d)
        across = np.sqrt(self.coupler**2 - along**2)
        return P, P + (along * way + across * np.array([-way[1], way[0]])) / d

    def twist(self, turn: float) -> np.ndarray:
        """Of the coupler, in its own axes, per unit of the motor."""
        h, T = 1e-4, self.pose(turn)

        def slope(h: float) -> np.ndarray:
            return (self.pose(turn + h) - self.pose(turn - h)) / (2 * h)

        X = np.linalg.solve(T, (4 * slope(h) - slope(2 * h)) / 3)
        return np.array([X[2, 1], X[0, 2], X[1, 0], *X[:3, 3]])

    def work(self, turn: float, loaded: bool = True) -> float:
        """Of the load, and of the weight where it acts."""
        T = self.pose(turn)
        weight = self.mass * EARTH @ (T[:3, :3] @ self.centre + T[:3, 3])
        load = self.W[3:] @ (T[:3, :3] @ self.at + T[:3, 3])
        return float(load * loaded + weight * self.is_heavy)

    def compliance(self, loaded: bool) -> np.ndarray:
        t, h = self.twist(self.turn), 1e-3
        around = [self.work(self.turn + i * h, loaded) for i in (-2, -1, 0, 1, 2)]
        bend = np.array([-1, 16, -30, 16, -1]) @ around / (12 * h**2)
        return np.outer(t, t) / (self.k - bend)

    def at_rest(self) -> float:
        """The motor's angle under the load, its spring at rest where it carries the weight."""
        h = 1e-4

        def torque(turn: float, loaded: bool) -> float:
            work = [self.work(turn + i * h, loaded) for i in (-2, -1, 1, 2)]
            return float(np.array([1, -8, 8, -1]) @ work / (12 * h))

        start = torque(self.turn, False)

        def left(turn: float) -> float:
            return self.k * (turn - self.turn) + start - torque(turn, True)

        return float(brentq(left, self.turn - 0.3, self.turn + 0.3, xtol=1e-13))

    def written(self, folder: Path, **keys: Any) -> Path:
        joint = "<joint name='{}' type='{}'><parent link='{}'/><child link='{}'/><origin xyz='{}'/>"
        joint += "<axis xyz='{}'/><limit lower='-9' upper='9' effort='0' velocity='0'/></joint>"
        about, along = "0 1 0", "1 0 0"
        links = "".join(f"<link name='{n}'/>" for n in ("ground", "crank", "rocker"))
        links += (
            f"<link name='coupler'><inertial><origin xyz='{_words(self.centre)}'/>"
            f"<mass value='{self.mass!r}'/><inertia ixx='.1' iyy='.1' izz='.1' ixy='0' ixz='0' "
            "iyz='0'/></inertial></link>"
        )
        last = ("pivot", "continuous", "ground", "rocker", f"{self.ground!r} 0 0", about)
        if self.slides:
            x = float(self._ends(self.turn)[1][0])
            last = ("pivot", "prismatic", "ground", "rocker", f"{x!r} 0 0", along)
        tips = "<link name='end'/><link name='top'/>"
        robot = (
            f"<robot name='four-bar'>{links}{tips}"
            + joint.format("motor", "continuous", "ground", "crank", "0 0 0", about)
            + joint.format("elbow", "continuous", "crank", "coupler", f"0 0 {self.crank!r}", about)
            + joint.format(*last)
            + joint.format("e", "fixed", "coupler", "end", f"{self.coupler!r} 0 0", about)
            + joint.format(
                "t", "fixed", "rocker", "top", f"0 0 {self.rocker * (not self.slides)!r}", about
            )
        ) + "</robot>"
        (folder / "bars.urdf").write_text(robot)
        file = folder / "bars.yaml"
        data: dict[str, Any] = {"kind": "closed-chain", "model": "bars.urdf", "frame": "coupler"}
        if self.is_heavy:
            data["gravity"] = _list(EARTH)
        closure = {"frames": ["end", "top"], "type": "point"}
        file.write_text(yaml.safe_dump({**data, "closures": [closure], **keys}))
        return file
