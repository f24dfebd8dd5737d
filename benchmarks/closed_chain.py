"""A closed chain at many postures, beside what others would write: ``closed_chain.py [--count N]``.

The 6-UPS platform as a tree of 21 joints tied at five points, along a path: every posture is closed
by Newton's method from the one before, with the motors moved on, reduced on the motions that stay
closed, and K^A, K^B, K^K, K^F follow under a load. The peers read the tree once from the same
Pinocchio model. Numbers are compared before anything is timed; contenders take turns.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from statistics import median
from typing import Any

import numpy as np
import pinocchio as pin

import cartstiff
from cartstiff import analyse_many

Array = np.ndarray
Answer = tuple[Array, ...]
LOAD = np.array([1.0, -2.0, 3.0, 20.0, 30.0, -40.0])
OUTPUTS = tuple(f"stiffness_{c}" for c in "ABKF")
CHUNK = 400  # NumPy's temporaries stay small
STEPS = 4  # Newton steps of peers that cannot stop posture by posture
AGREEMENT = 1e-10


@dataclass
class Tied:
    """A tree of joints with one axis each, a body, and points of it tied to points of other links.

    Joints count from 0, and parents from 0 as well (-1 is the ground).
    """

    parents: list[int]
    placements: Array
    axes: Array
    slides: list[int]
    stiffness: float
    body: tuple[int, Array]
    ties: list[tuple[Array, int, Array]]  # point on the body's joint; other joint, point there

    @property
    def passive(self) -> list[int]:
        """Joints without a motor."""
        return [j for j in range(len(self.parents)) if j not in self.slides]

    def way(self, joint: int) -> list[int]:
        """Joints from the ground to one."""
        return [] if joint < 0 else [*self.way(self.parents[joint]), joint]


def tied(elastic: cartstiff.ElasticMechanism) -> Tied:
    """What the peers start from."""
    chain: Any = elastic.mechanism
    model = chain.tree.model
    data, count = model.createData(), model.njoints - 1
    pin.computeJointJacobians(model, data, np.zeros(model.nq))
    slides = list(chain.actuated)
    axes = []
    for j in range(count):
        twist = pin.getJointJacobian(model, data, j + 1, pin.LOCAL)[:, j]
        axes.append(twist[:3] if j in slides else twist[3:])
    ties = []
    for closure in chain.closures:
        a, b = chain.placement(closure.frame_a), chain.placement(closure.frame_b)
        ties.append((a.T_j_f[:3, 3], b.joint - 1, b.T_j_f[:3, 3]))
    springs: Any = elastic.springs
    placements = np.array([model.jointPlacements[j + 1].homogeneous for j in range(count)])
    return Tied(
        [int(p) - 1 for p in model.parents[1:]],
        placements,
        np.array(axes),
        slides,
        float(springs.stiffness[slides[0]]),
        (chain.body.joint - 1, chain.body.T_j_f),
        ties,
    )


# -- NumPy on stacks, and the same functions by JAX -------------------------------------------


def _skew(v: Any, xp: Any) -> Any:
    x, y, z, o = v[..., 0], v[..., 1], v[..., 2], 0.0 * v[..., 0]
    rows = [xp.stack(row, -1) for row in ((o, -z, y), (z, o, -x), (-y, x, o))]
    return xp.stack(rows, -2)


def _frames(t: Tied, q: Any, xp: Any) -> list[Any]:
    """Rotation, origin and axis of every joint, over a stack (N, n)."""
    found: list[Any] = []
    for j, parent in enumerate(t.parents):
        T, u = t.placements[j], t.axes[j]
        if parent < 0:
            R, p = (
                xp.broadcast_to(T[:3, :3], (len(q), 3, 3)),
                xp.broadcast_to(T[:3, 3], (len(q), 3)),
            )
        else:
            R, p = found[parent][0] @ T[:3, :3], found[parent][0] @ T[:3, 3] + found[parent][1]
        z = R @ u
        if j in t.slides:
            p = p + z * q[:, j : j + 1]
        else:
            S = np.array([[0, -u[2], u[1]], [u[2], 0, -u[0]], [-u[1], u[0], 0]])
            s, c = xp.sin(q[:, j])[:, None, None], 1.0 - xp.cos(q[:, j])[:, None, None]
            R = R @ (np.eye(3) + s * S + c * (S @ S))
        found.append((R, p, z))
    return found


def _moved(t: Tied, frames: list[Any], joints: list[int], p: Any, xp: Any) -> dict[int, Any]:
    """Velocity (N, 3) of a point per rate of each of some joints."""
    return {
        j: frames[j][2] if j in t.slides else xp.cross(frames[j][2], p - frames[j][1])
        for j in joints
    }


def _ties(t: Tied, frames: list[Any], xp: Any) -> tuple[list[Any], list[Any]]:
    """Of each tie what is left (N, 3), and how both of its points move with the joints."""
    left, moves = [], []
    R, o, _ = frames[t.body[0]]
    for a, joint, b in t.ties:
        p_a, p_b = R @ a + o, frames[joint][0] @ b + frames[joint][1]
        left.append(p_b - p_a)
        moves.append(
            (_moved(t, frames, t.way(t.body[0]), p_a, xp), _moved(t, frames, t.way(joint), p_b, xp))
        )
    return left, moves


def _rates(t: Tied, moves: list[Any], like: Any, xp: Any) -> Any:
    """Rates (N, 3 m, n) of what is left."""
    rows = []
    for of_a, of_b in moves:
        columns = [of_b.get(j, like) - of_a.get(j, like) for j in range(len(t.parents))]
        rows.append(xp.stack(columns, -1))
    return xp.concatenate(rows, 1)


def closed_stack(t: Tied, q: Any, steps: int, xp: Any) -> Any:
    """Coordinates after Newton steps of the passive joints; motors stay."""
    for _ in range(steps):
        frames = _frames(t, q, xp)
        left, moves = _ties(t, frames, xp)
        C = _rates(t, moves, xp.zeros((len(q), 3)), xp)[..., t.passive]
        step = -xp.linalg.solve(C, xp.concatenate(left, 1)[..., None])[..., 0]
        at = np.zeros((len(t.passive), q.shape[1]))
        at[np.arange(len(t.passive)), t.passive] = 1.0
        q = q + step @ at
    return q


def stack_of(t: Tied, q: Any, xp: Any, steps: int = STEPS) -> Answer:
    """K^A, K^B, K^K, K^F (N, 6, 6)."""
    q = closed_stack(t, q, steps, xp)
    n, N = q.shape[1], len(q)
    nothing, zero = xp.zeros((N, 3)), xp.zeros(N)
    frames = _frames(t, q, xp)
    _, moves = _ties(t, frames, xp)
    C = _rates(t, moves, nothing, xp)
    joint, T = t.body
    R, p = frames[joint][0] @ T[:3, :3], frames[joint][0] @ T[:3, 3] + frames[joint][1]
    way, back = t.way(joint), xp.swapaxes(R, 1, 2)
    columns = {}
    for j, v in _moved(t, frames, way, p, xp).items():
        turn = nothing if j in t.slides else frames[j][2]
        columns[j] = xp.concatenate([(back @ x[..., None])[..., 0] for x in (turn, v)], 1)
    J = xp.stack([columns.get(j, xp.zeros((N, 6))) for j in range(n)], -1)

    # Motions that stay closed, led by the motors, and their rates per motion of the body.
    D, order = t.passive, np.argsort(t.passive + t.slides)
    motions = xp.concatenate(
        [-xp.linalg.solve(C[..., D], C[..., t.slides]), xp.broadcast_to(np.eye(6), (N, 6, 6))], 1
    )[:, order]
    inverse = xp.linalg.inv(J @ motions)
    X = motions @ inverse

    # Forces of the ties, and the curvature of ties and pose under forces and load.
    lam = xp.linalg.solve(xp.swapaxes(C[..., D], 1, 2), (LOAD @ J)[..., D][..., None])[..., 0]
    m, f = LOAD[:3], LOAD[3:]
    entries: dict[tuple[int, int], Any] = {}

    def add(way: list[int], last: Callable[[int], Any], sign: float) -> None:
        for k, b in enumerate(way):
            moment = last(b)
            for a in way[: k + 1]:
                if a not in t.slides:
                    entry = sign * (frames[a][2] * moment).sum(-1)
                    entries[a, b] = entries.get((a, b), zero) + entry

    forces = [lam[:, 3 * i : 3 * i + 3] for i in range(len(t.ties))]
    each = [(of_a, F) for (of_a, _), F in zip(moves, forces, strict=True)]
    add(way, lambda b: sum(xp.cross(of_a[b], F) for of_a, F in each), -1.0)
    for (_, of_b), F, (_, other, _) in zip(moves, forces, t.ties, strict=True):
        add(t.way(other), lambda b, of_b=of_b, F=F: xp.cross(of_b[b], F), 1.0)
    for k, b in enumerate(way):
        for a in way[:k]:
            u, v = columns[a], columns[b]
            turn = xp.cross(u[:, :3], v[:, :3]) @ m
            shift = (xp.cross(u[:, :3], v[:, 3:]) - xp.cross(v[:, :3], u[:, 3:])) @ f
            entries[a, b] = entries.get((a, b), zero) - 0.5 * (turn + shift)
    H = [[entries.get((min(a, b), max(a, b)), zero) for b in range(n)] for a in range(n)]
    for j in t.slides:
        H[j][j] = H[j][j] + t.stiffness
    H_L = xp.stack([xp.stack(row, -1) for row in H], -2)
    K_B = xp.swapaxes(X, 1, 2) @ H_L @ X
    K_F = t.stiffness * xp.swapaxes(inverse, 1, 2) @ inverse
    M, shift = _of_load()
    K_A = K_B + 0.5 * M
    return K_A, K_B, K_A - shift, K_F


def _of_load() -> tuple[Array, Array]:
    """What K^A - K^B is half of, and K^A - K^K."""
    m, f = (_skew(x, np) for x in (LOAD[:3], LOAD[3:]))
    M, shift = np.zeros((6, 6)), np.zeros((6, 6))
    M[:3, :3], M[:3, 3:], M[3:, :3] = m, f, f
    shift[:3, :3], shift[3:, :3] = 0.5 * m, f
    return M, shift


def numpy_stack(t: Tied) -> Callable[[Array], Answer]:
    """NumPy in chunks."""

    def run(q: Array) -> Answer:
        parts = [stack_of(t, q[i : i + CHUNK], np) for i in range(0, len(q), CHUNK)]
        return tuple(map(np.concatenate, zip(*parts, strict=True)))

    return run


def jax_stack(t: Tied) -> Callable[[Array], Answer]:
    """The same functions, jitted over the whole stack; all cores."""
    import jax

    jax.config.update("jax_enable_x64", True)
    many = jax.jit(lambda q: stack_of(t, q, jax.numpy))
    return lambda q: tuple(map(np.asarray, jax.block_until_ready(many(q))))


def numba_loop(t: Tied, threads: int) -> Callable[[Array], Answer]:
    """Scalar loops over postures, each closed until nothing is left."""
    import numba

    n, ties = len(t.parents), len(t.ties)
    parents, placements, axes = np.array(t.parents), t.placements, t.axes
    slides, passive = np.array(t.slides), np.array(t.passive)
    is_slide = np.isin(np.arange(n), slides)
    body, R_body, p_body = t.body[0], t.body[1][:3, :3].copy(), t.body[1][:3, 3].copy()
    points_a = np.array([a for a, _, _ in t.ties])
    others = np.array([j for _, j, _ in t.ties])
    points_b = np.array([b for _, _, b in t.ties])
    on_way = np.array([[a in t.way(b) for a in range(n)] for b in range(n)])
    k, load, (M, shift) = t.stiffness, LOAD, _of_load()
    jit = partial(numba.njit, fastmath=False, error_model="numpy")

    @jit
    def cross(a, b):  # type: ignore[no-untyped-def]
        return np.array(
            [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
        )

    @jit
    def place(q, R, p, z):  # type: ignore[no-untyped-def]
        for j in range(n):
            P = parents[j]
            for r in range(3):
                p[j, r] = placements[j, r, 3] if P < 0 else p[P, r]
                for c in range(3):
                    if P < 0:
                        R[j, r, c] = placements[j, r, c]
                    else:
                        p[j, r] += R[P, r, c] * placements[j, c, 3]
                        R[j, r, c] = 0.0
                        for i in range(3):
                            R[j, r, c] += R[P, r, i] * placements[j, i, c]
            for r in range(3):
                z[j, r] = (
                    R[j, r, 0] * axes[j, 0] + R[j, r, 1] * axes[j, 1] + R[j, r, 2] * axes[j, 2]
                )
            if is_slide[j]:
                for r in range(3):
                    p[j, r] += z[j, r] * q[j]
            else:  # the columns turn about z
                s, c1 = np.sin(q[j]), 1.0 - np.cos(q[j])
                for c in range(3):
                    x, y, w = R[j, 0, c], R[j, 1, c], R[j, 2, c]
                    a, b, d = z[j, 0], z[j, 1], z[j, 2]
                    dot = a * x + b * y + d * w
                    R[j, 0, c] = x + s * (b * w - d * y) + c1 * (a * dot - x)
                    R[j, 1, c] = y + s * (d * x - a * w) + c1 * (b * dot - y)
                    R[j, 2, c] = w + s * (a * y - b * x) + c1 * (d * dot - w)

    @jit
    def moved(j, at, p, z):  # type: ignore[no-untyped-def]
        return z[j] if is_slide[j] else cross(z[j], at - p[j])

    @jit
    def tie(R, p, z, left, C, of_a, of_b):  # type: ignore[no-untyped-def]
        C[:] = 0.0
        for i in range(ties):
            p_a = R[body] @ points_a[i] + p[body]
            p_b = R[others[i]] @ points_b[i] + p[others[i]]
            left[3 * i : 3 * i + 3] = p_b - p_a
            for j in range(n):
                if on_way[body, j]:
                    of_a[i, j] = moved(j, p_a, p, z)
                    C[3 * i : 3 * i + 3, j] -= of_a[i, j]
                if on_way[others[i], j]:
                    of_b[i, j] = moved(j, p_b, p, z)
                    C[3 * i : 3 * i + 3, j] += of_b[i, j]

    @jit(parallel=True)
    def many(starts, KA, KB, KK, KF):  # type: ignore[no-untyped-def]
        for at in numba.prange(len(starts)):
            q = starts[at].copy()
            R, p, z = np.empty((n, 3, 3)), np.empty((n, 3)), np.empty((n, 3))
            left, C = np.empty(3 * ties), np.empty((3 * ties, n))
            of_a, of_b = np.zeros((ties, n, 3)), np.zeros((ties, n, 3))
            for _ in range(20):
                place(q, R, p, z)
                tie(R, p, z, left, C, of_a, of_b)
                if np.abs(left).max() < 1e-14:
                    break
                q[passive] -= np.linalg.solve(np.ascontiguousarray(C[:, passive]), left)
            Q = R[body] @ R_body
            o = R[body] @ p_body + p[body]
            J = np.zeros((6, n))
            for j in range(n):
                if on_way[body, j]:
                    J[3:, j] = Q.T @ moved(j, o, p, z)
                    if not is_slide[j]:
                        J[:3, j] = Q.T @ z[j]
            C_D = np.ascontiguousarray(C[:, passive])
            dependent = np.linalg.solve(C_D, np.ascontiguousarray(C[:, slides]))
            motions = np.zeros((n, 6))
            for r in range(len(passive)):
                motions[passive[r]] = -dependent[r]
            for r in range(6):
                motions[slides[r], r] = 1.0
            inverse = np.linalg.inv(J @ motions)
            X = motions @ inverse
            lam = np.linalg.solve(np.ascontiguousarray(C_D.T), (load @ J)[passive])
            H = np.zeros((n, n))
            for b in range(n):
                G = np.zeros(3)
                for i in range(ties):
                    F = lam[3 * i : 3 * i + 3]
                    if on_way[body, b]:
                        G -= cross(of_a[i, b], F)
                    if on_way[others[i], b]:
                        G += cross(of_b[i, b], F)
                for a in range(b + 1):
                    if on_way[b, a] and not is_slide[a]:
                        H[a, b] += z[a] @ G
                    if a < b and on_way[body, b] and on_way[body, a]:
                        turn = cross(J[:3, a], J[:3, b]) @ load[:3]
                        move = cross(J[:3, a], J[3:, b]) - cross(J[:3, b], J[3:, a])
                        H[a, b] -= 0.5 * (turn + move @ load[3:])
                    H[b, a] = H[a, b]
            for r in range(6):
                H[slides[r], slides[r]] += k
            KB[at] = X.T @ H @ X
            KF[at] = k * inverse.T @ inverse
            KA[at] = KB[at] + 0.5 * M
            KK[at] = KA[at] - shift

    def run(q: Array) -> Answer:
        numba.set_num_threads(threads)
        K = tuple(np.empty((len(q), 6, 6)) for _ in range(4))
        many(q, *K)
        return K

    return run


# -- the table ----------------------------------------------------------------------------------


def path_of(t: Tied, q: Array, count: int) -> Array:
    """Starts (N, n) along a path: the posture before, with the motors moved on by half a mm."""
    phase = 0.02 * np.arange(count + 1)[:, None] + np.arange(6.0)
    moved = np.tile(q, (count + 1, 1))
    moved[:, t.slides] += 0.03 * np.sin(phase)
    closed = np.concatenate(
        [closed_stack(t, moved[i : i + CHUNK], 25, np) for i in range(0, count + 1, CHUNK)]
    )
    starts = closed[:-1].copy()
    starts[:, t.slides] = moved[1:, t.slides]
    return starts


def main() -> None:
    """Compare, then time."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=4000, help="postures")
    parser.add_argument("--rounds", type=int, default=5)
    given = parser.parse_args()
    elastic = cartstiff.load("6-ups")
    t = tied(elastic)
    starts = path_of(t, elastic.q, given.count)

    def ours(path: Any, threads: int, count: int | None = None) -> Callable[[Array], Answer]:
        def run(q: Array) -> Answer:
            result = analyse_many(
                elastic, q[:count], wrench=LOAD, outputs=OUTPUTS, path=path, threads=threads
            )
            return tuple(result[name] for name in OUTPUTS)

        return run

    some = min(100, given.count)
    contenders: list[tuple[str, int, Callable[[], Callable[[Array], Answer]]]] = [
        ("cartstiff.analyse, one by one", some, lambda: ours("engine", 1, some)),
        ("stacked NumPy", given.count, lambda: numpy_stack(t)),
        ("JAX, jitted, all cores", given.count, lambda: jax_stack(t)),
        ("numba, 1 thread", given.count, lambda: numba_loop(t, 1)),
        ("numba, 2 threads", given.count, lambda: numba_loop(t, 2)),
        ("cartstiff portable, 1 thread", given.count, lambda: ours("portable", 1)),
        ("cartstiff compiled, 1 thread", given.count, lambda: ours("compiled", 1)),
        ("cartstiff compiled, 2 threads", given.count, lambda: ours("compiled", 2)),
    ]
    runs, differs, right = [], {}, ours("engine", 1, some)(starts)
    for name, count, make in contenders:
        try:
            run = make()
            K = run(starts)
        except ImportError as error:
            print(f"{name}: {error}")
            continue
        differs[name] = max(
            float((np.abs(a[:some] - b).max(axis=(1, 2)) / np.abs(b).max(axis=(1, 2))).max())
            for a, b in zip(K, right, strict=True)
        )
        if not differs[name] < AGREEMENT:
            raise SystemExit(f"{name} differs by {differs[name]:.0e}")
        runs.append((name, count, run))
    spent: dict[str, list[tuple[float, float]]] = {name: [] for name, _, _ in runs}
    for _ in range(given.rounds):
        for name, count, run in runs:
            wall, processor = time.perf_counter(), time.process_time()
            run(starts)
            took = time.perf_counter() - wall, time.process_time() - processor
            spent[name].append((took[0] / count * 1e6, took[1] / count * 1e6))
    figures = {name: tuple(map(median, zip(*each, strict=True))) for name, each in spent.items()}
    least = figures["cartstiff compiled, 1 thread"][1]
    print("| 6-UPS, us per posture | by the clock | of processors | this / compiled | differs by |")
    print("|---|---:|---:|---:|---:|")
    for name, (wall, processor) in figures.items():
        ratio, off = processor / least, differs[name]
        print(f"| {name} | {wall:.3g} | {processor:.3g} | {ratio:.3g} | {off:.0e} |")


if __name__ == "__main__":
    main()
