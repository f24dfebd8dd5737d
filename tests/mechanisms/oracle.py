"""What the tests of mechanisms with loops compare with: reduced energies found by minimisation.

The energy of a pose is the least energy among all coordinates that reach it and keep the closures.
It is found here by Newton steps on the conditions of stationarity; only its values and its forces
at displaced poses are used, so nothing depends on how second derivatives are formed elsewhere.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
from ruamel.yaml import YAML
from scipy.spatial.transform import Rotation
from tests.support import (
    absolute_error,
    adjoint_reference,
    bend,
    relative_error,
    slope,
    twist_matrix,
)

ROBOTS = Path(__file__).resolve().parents[2] / "robots"
GRAVITY = np.array([0.9, -1.4, -9.7])
# A pose away from the file's, rad and m, in which a body is held.
DISPLACED = np.array([0.02, -0.03, 0.025, 0.004, -0.003, 0.005])
_VIRTUAL = {"near_ry", "near_rz", "px", "rx", "far_rz", "far_ry"}


def _small_twist(T):
    """Zero, with unit derivative, at the identity: a twist to first order elsewhere."""
    skew = 0.5 * (T[:3, :3] - T[:3, :3].T)
    return np.array([skew[2, 1], skew[0, 2], skew[1, 0], *T[:3, 3]])


def small_motion(x):
    """Exponential of a twist of at most unit size, by its series."""
    X = twist_matrix(x)
    total = term = np.eye(4)
    for k in range(1, 19):
        term = term @ X / k
        total = total + term
    return total


class Held:
    """A mechanism whose body is held at a pose, or left free, all the rest relaxed."""

    def __init__(self, elastic, q=None):
        self.elastic = elastic
        self.mechanism = elastic.mechanism
        self.q0 = np.array(elastic.q if q is None else q, float)
        self.n = self.q0.size
        self.pose0 = self.mechanism.at(self.q0).pose.copy()
        self.frozen = {}
        self.solved = {}

    def _parts(self, q):
        """Energy, gradient, closure residual and Jacobian, and the posture."""
        posture = self.mechanism.at(q)
        parts = [term.evaluate(posture) for term in self.elastic.terms()]
        energy = sum(p.energy for p in parts)
        gradient = sum((p.gradient for p in parts), np.zeros(self.n))
        if posture.closure is None:
            return energy, gradient, np.zeros(0), np.zeros((0, self.n)), posture
        return energy, gradient, posture.residual, posture.closure.jacobian, posture

    def _conditions(self, q, target):
        energy, g, c, D, posture = self._parts(q)
        if target is not None:
            away = _small_twist(np.linalg.inv(target) @ posture.pose)
            c = np.concatenate([c, -away])
            D = np.concatenate([D, -posture.motion.jacobian])
        return energy, g, c, D

    def _curvature(self, with_pose):
        """Hessian of the Lagrangian at the start, by differences: only steers the iteration."""
        if with_pose not in self.frozen:
            target = self.pose0 if with_pose else None
            _, g, _, D = self._conditions(self.q0, target)
            mu = np.linalg.lstsq(D.T, -g, rcond=1e-10)[0] if len(D) else np.zeros(0)

            def forces(d):
                _, g, _, D = self._conditions(self.q0 + d, target)
                return g + D.T @ mu

            h = 1e-5
            steps = [(forces(h * e) - forces(-h * e)) / (2 * h) for e in np.eye(self.n)]
            H = np.stack(steps, axis=1)
            self.frozen[with_pose] = 0.5 * (H + H.T)
        return self.frozen[with_pose]

    def solve(self, target, q=None):
        """Coordinates of least energy and that energy; with the body at `target`, if given."""
        q = self.q0.copy() if q is None else np.array(q, float)
        H = self._curvature(target is not None)
        size = max(float(np.abs(H).max()), 1e-300)
        before = np.inf
        for _ in range(150):
            _, g, c, D = self._conditions(q, target)
            m = len(c)
            matrix = np.block([[H / size, D.T], [D, np.zeros((m, m))]])
            right = -np.concatenate([g / size, c])
            step = _solved(matrix, right)[: self.n]
            largest = float(np.abs(step).max())
            q = q + step * min(1.0, 0.2 / max(largest, 1e-300))
            # The steps shrink by a constant factor: what is left is this times the factor.
            left = largest * min(1.0, largest / before) if before < np.inf else np.inf
            if left < 1e-15 or (largest < 1e-12 and largest >= 0.5 * before):
                return q, self._conditions(q, target)[0]
            before = largest
        raise AssertionError(f"no minimum found: last step {largest:.2g}")

    def held_at(self, target):
        """Coordinates of least energy with the body held there, found once."""
        key = np.round(target, 13).tobytes()
        if key not in self.solved:
            self.solved[key] = self.solve(target)[0]
        return self.solved[key]

    def at(self, x):
        """Energy with the body displaced along a screw motion."""
        return self._parts(self.held_at(self.pose0 @ small_motion(x)))[0]

    @property
    def forces(self):
        """Size of the forces that meet in the body at the start, before they cancel."""
        _, g, _, D = self._conditions(self.q0, self.pose0)
        mu = np.linalg.lstsq(D.T, -g, rcond=1e-10)[0]
        inside = np.abs(self.mechanism.at(self.q0).motion.jacobian) @ np.abs(g)
        return np.abs(mu[-6:]) + inside

    def wrench(self, target):
        """Wrench that holds the body at a pose, in its own components."""
        _, g, c, D = self._conditions(self.held_at(target), target)
        return np.linalg.lstsq(D.T, -g, rcond=1e-10)[0][len(c) - 6 :]


def _solved(matrix, right):
    try:
        x = np.linalg.solve(matrix, right)
        size = np.abs(right).max()
        met = absolute_error(matrix @ x, right) <= 1e-9 * size
        if met and np.abs(x).max() < 1e8 * size:
            return x
    except np.linalg.LinAlgError:
        pass
    return np.linalg.lstsq(matrix, right, rcond=1e-12)[0]


def displaced(elastic, by, spread, springs=None, *, seed):
    """A mechanism under gravity with rest positions off by `spread`, and where it comes to rest.

    `by` displaces the pose in which the body is held; None lets it go. `springs` gives joints that
    have none a spring each, so that the closures carry forces that nothing outside balances.
    """
    rng = np.random.default_rng(seed)
    k = elastic.springs.stiffness.copy()
    virtual = np.array([name.rsplit(".", 1)[-1] in _VIRTUAL for name in elastic.names])
    if springs is not None:
        k[(k == 0) & ~virtual] = springs
    rest = elastic.q - spread * rng.uniform(-1, 1, k.size) * (k > 0)
    elastic = replace(elastic.with_springs(k, rest), gravity=GRAVITY)
    held = Held(elastic)
    target = None if by is None else held.pose0 @ small_motion(by)
    return elastic, held.solve(target)[0]


class Lines:
    """Line springs from the ground to a body, written out by hand: lengths, energies, wrench."""

    def __init__(self, pose0, base, points, k, rest, pull):
        self.pose0 = np.array(pose0, float)
        self.base, self.points = np.array(base, float), np.array(points, float)
        self.k, self.rest, self.pull = np.array(k, float), np.array(rest, float), pull

    def _geometry(self, T):
        ends = self.points @ T[:3, :3].T + T[:3, 3]
        along = ends - self.base
        lengths = np.linalg.norm(along, axis=1)
        tension = self.k * (lengths - self.rest)
        return ends, along / lengths[:, None], np.maximum(tension, 0) if self.pull else tension

    @property
    def forces(self):
        """Size of the forces that meet in the body, before they cancel."""
        ends, _, tension = self._geometry(self.pose0)
        arms = np.linalg.norm(ends - self.pose0[:3, 3], axis=1)
        force = np.abs(tension).sum()
        return np.array([np.abs(tension) @ arms] * 3 + [force] * 3)

    def energy(self, T):
        tension = self._geometry(T)[2]
        return 0.5 * float(np.sum(tension**2 / self.k))

    def at(self, x):
        return self.energy(self.pose0 @ small_motion(x))

    def wrench(self, T):
        ends, u, t = self._geometry(T)
        force = t[:, None] * u
        moment = np.cross(ends - T[:3, 3], force).sum(axis=0)
        return np.concatenate([T[:3, :3].T @ moment, T[:3, :3].T @ force.sum(axis=0)])


def bundled_lines(name, rest):
    """The lines of a bundled platform, from its file alone (its frames coincide at the pose)."""
    data = YAML(typ="safe").load((ROBOTS / f"{name}.yaml").read_text(encoding="utf-8"))
    pose = np.eye(4)
    at = data.get("pose", {})
    pose[:3, 3] = at.get("xyz", [0, 0, 0])
    pose[:3, :3] = Rotation.from_euler("xyz", at.get("rpy", [0, 0, 0])).as_matrix()
    k = np.broadcast_to(np.array(data["legs"]["stiffness"], float), (len(data["base"]),))
    return Lines(pose, data["base"], data["platform"], k, rest, bool(data.get("unilateral", False)))


# -- stiffness from its definitions ----------------------------------------------------------------


def transports(y, t):
    """Matrices that carry a twist in parallel along the geodesic of y for a time t, by connection.

    A: components in the body frame are kept. B: half the screw motion, seen from the body. K: half
    the rotation for angular components, linear components keep their directions in space.
    """
    w = y[:3] * t
    half, whole = (Rotation.from_rotvec(-f * w).as_matrix() for f in (0.5, 1.0))
    kinematic = np.block([[half, np.zeros((3, 3))], [np.zeros((3, 3)), whole]])
    return {
        "A": np.eye(6),
        "B": adjoint_reference(small_motion(-0.5 * t * y)),
        "K": kinematic,
    }


def geodesics(pose, y, t):
    """Poses reached along y: on screw motions (A, B), or turning about the moved origin (K)."""
    apart = pose.copy()
    apart[:3, :3] = pose[:3, :3] @ Rotation.from_rotvec(t * y[:3]).as_matrix()
    apart[:3, 3] += t * pose[:3, :3] @ y[3:]
    screw = pose @ small_motion(t * y)
    return {"A": screw, "B": screw, "K": apart}


def stiffness_by_definition(wrench, pose, sizes, h):
    """K^A, K^B, K^K: rate of the load against fields carried in parallel, column by column."""
    found = {name: np.empty((6, 6)) for name in "ABK"}
    for j, y in enumerate(np.eye(6)):
        # Along a basis direction the screw motion and the other geodesic are the same curve.
        curve = {}

        def load(t, y=y, curve=curve):
            if t not in curve:
                curve[t] = wrench(geodesics(pose, y, t)["A"])
            return curve[t]

        for name, K in found.items():

            def along(t, y=y, name=name):
                return transports(y, t)[name].T @ load(t)

            K[:, j] = slope(along, h * sizes[j])
    return found


def by_energy(held, sizes, h, rng, count=8):
    """Directions, and first and second differences of the energy along their screw motions."""
    directions = np.concatenate([np.eye(6), rng.normal(size=(count - 6, 6))])
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    directions = directions * sizes
    slopes, bends = [], []
    for x in directions:
        values = {}

        def energy(t, x=x, values=values):
            return values.setdefault(t, held.at(t * x)) if t not in values else values[t]

        slopes.append(slope(energy, h))
        bends.append(bend(energy, h))
    return directions, np.array(slopes), np.array(bends)


def natural_error(got, expected, length):
    """Largest difference of two 6x6 matrices in rad and `length`, over the largest entry."""
    s = np.array([1.0] * 3 + [length] * 3)
    s = np.outer(s, s) / s.mean() ** 2
    got, expected = np.asarray(got, float) * s, np.asarray(expected, float) * s
    return float(absolute_error(got, expected) / np.abs(expected).max())


def missed(result, held, step, seed=2):
    """Largest errors of K^A, K^B and K^K, of K^B and of the load at the pose of `held`.

    Against their definitions and against second and first differences of the energy, those of the
    load in sizes of the forces that meet in the body.
    """
    length = result.posture.length
    sizes = np.array([1.0] * 3 + [length] * 3)
    defined = stiffness_by_definition(held.wrench, held.pose0, sizes, step)
    wrong = max(natural_error(result.matrices[name], K, length) for name, K in defined.items())
    x, slopes, bends = by_energy(held, sizes, step, np.random.default_rng(seed))
    bent = np.einsum("ki,ij,kj->k", x, result.matrices["B"], x)
    forces = np.abs(x) @ np.abs(held.forces)
    pulled = absolute_error(slopes, x @ result.wrench) / max(forces.max(), 1e-300)
    return wrong, relative_error(bends, bent), float(pulled)
