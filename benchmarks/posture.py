"""One posture and whole processes, beside what an engineer would write by hand.

    python benchmarks/posture.py

The contenders take turns in every round and see the same postures; the median over the rounds is
printed. Before anything is timed, their matrices are compared.
"""

from __future__ import annotations

import json
import os
import platform
import resource
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
from ruamel.yaml import YAML

import cartstiff
from cartstiff.files.catalogue import bundled_files, example_robot

ROUNDS = 9
POSTURES = 100
PROCESS_ROUNDS = 5
START_ROUNDS = 15
#: Relative error admitted: closed forms, then central differences with a step of 1e-6.
CLOSED_FORM, DIFFERENCES = 1e-9, 1e-5
#: Difference of equilibria admitted, in rad: BFGS ends where rounding hides the fall of the energy.
AT_REST = 1e-7
STEP = 1e-6

# Required, in microseconds, where the lean loop of an arm takes 30: one posture of a six-joint arm,
# of a closed chain, of one whose links give; an equilibrium.
API_LIMIT, CLOSED_LIMIT, FLEXIBLE_LIMIT, REST_LIMIT = 40.0, 120.0, 400.0, 2000.0
PROCESS_LIMITS = {"cartstiff analyse ur5 --json": 0.35, "cartstiff --help": 0.3}  # seconds
# Of the processor time of what every script about a robot loads.
START_LIMIT = 2.0
REFERENCE = "import numpy, pinocchio, yaml"

Array = np.ndarray
Matrices = dict[str, Array]


@dataclass
class Case:
    """A mechanism, and functions from a posture's number to the matrices."""

    title: str
    contenders: dict[str, Callable[[int], Any]]
    limit: float | None = None  # microseconds


# -- by hand: serial arms --------------------------------------------------------------------

TO_ANGULAR_LINEAR = [3, 4, 5, 0, 1, 2]


def connections(K_A: Array, W: Array, K_F: Array | None) -> Matrices:
    """K^A, K^B, K^K and, where there is one, K^F."""
    moment, force = pin.skew(W[:3]), pin.skew(W[3:])
    K_K = K_A.copy()
    K_K[:3, :3] -= 0.5 * moment
    K_K[3:, :3] -= force
    found = {"A": K_A, "B": 0.5 * (K_A + K_A.T), "K": K_K}
    return found if K_F is None else found | {"F": K_F}


class Arm:
    """Plain Pinocchio and NumPy: joint stiffnesses k; a wrench W or the rest positions load it."""

    def __init__(
        self, urdf: Path, frame: str, joints: tuple[str, ...], k: Array, rest: Array | None
    ) -> None:
        model = pin.buildModelFromUrdf(str(urdf))
        other = [i for i in range(1, model.njoints) if model.names[i] not in joints]
        self.model = pin.buildReducedModel(model, other, pin.neutral(model)) if other else model
        self.data = self.model.createData()
        self.frame = self.model.getFrameId(frame)
        self.stiffness, self.rest = np.diag(k), rest
        self.later = np.triu(np.ones((len(k), len(k))), 1)

    def jacobian(self, q: Array) -> Array:
        """Body Jacobian in the order (omega, v)."""
        J = pin.computeFrameJacobian(self.model, self.data, q, self.frame, pin.LOCAL)
        return J[TO_ANGULAR_LINEAR]

    def wrench(self, J: Array, q: Array, W: Array | None) -> Array:
        """The load given, or what the springs of a 6-joint arm exert."""
        return np.linalg.solve(J.T, self.stiffness @ (q - self.rest)) if W is None else W

    def finish(self, J: Array, W: Array, load_term: Array) -> Matrices:
        """From load_term[a, b] = W . dJ_a/dq_b to the matrices."""
        if J.shape[1] == 6:
            A = np.linalg.inv(J)
            return connections(A.T @ (self.stiffness - load_term) @ A, W, A.T @ self.stiffness @ A)
        hessian = self.stiffness - 0.5 * (load_term + load_term.T)
        K_B = np.linalg.inv(J @ np.linalg.solve(hessian, J.T))
        moment, force = pin.skew(W[:3]), pin.skew(W[3:])
        K_A = K_B + 0.5 * np.block([[moment, force], [force, np.zeros((3, 3))]])
        return connections(K_A, W, None)

    def with_hessian(self, q: Array, load: Array | None) -> Matrices:
        """Kinematic Hessian dJ_a/dq_b = [J_a, J_b] (b after a) as a tensor, then contracted."""
        J = self.jacobian(q)
        W, n = self.wrench(J, q, load), J.shape[1]
        angular, linear = J[:3].T, J[3:].T
        hessian = np.empty((n, n, 6))
        hessian[..., :3] = np.cross(angular[:, None], angular)
        hessian[..., 3:] = np.cross(angular[:, None], linear) + np.cross(linear[:, None], angular)
        return self.finish(J, W, self.later * (hessian @ W))

    def contracted(self, q: Array, load: Array | None) -> Matrices:
        """The wrench goes into the bracket first: two matrix products and no tensor."""
        J = self.jacobian(q)
        W = self.wrench(J, q, load)
        form = np.zeros((6, 6))  # W . [a, b] = a^T form b
        form[:3, :3] = -pin.skew(W[:3])
        form[:3, 3:] = form[3:, :3] = -pin.skew(W[3:])
        return self.finish(J, W, self.later * (J.T @ form @ J))

    def differences(self, q: Array, load: Array | None) -> Matrices:
        """Central differences of J^T W."""
        J = self.jacobian(q)
        W = self.wrench(J, q, load)
        load_term = np.empty((len(q), len(q)))
        for b in range(len(q)):
            step = np.zeros(len(q))
            step[b] = STEP
            change = self.jacobian(q + step) - self.jacobian(q - step)
            load_term[:, b] = change.T @ W / (2 * STEP)
        return self.finish(J, W, load_term)


# -- by hand: closed chains ------------------------------------------------------------------


class Closed:
    """A tree of joints tied at frames, nothing stretched: plain Pinocchio and NumPy."""

    def __init__(self, elastic: cartstiff.ElasticMechanism) -> None:
        chain: Any = elastic.mechanism
        self.model = chain.tree.model
        self.data, n = self.model.createData(), self.model.nv
        own = np.array(
            [[a in self.model.supports[j] for a in range(1, n + 1)] for j in range(n + 1)], float
        )
        places = [[chain.placement(f) for f in (c.frame_a, c.frame_b)] for c in chain.closures]
        self.ties = [
            (b.joint, b.T_j_f[:3, 3], own[b.joint] - own[a.joint], closure.type == "weld")
            for closure, (a, b) in zip(chain.closures, places, strict=True)
        ]
        self.body, self.way = chain.body, own[chain.body.joint]
        self.hessian = elastic.evaluate(elastic.mechanism.at(elastic.q)).hessian
        self.actuated = list(chain.actuated)
        stiff = self.hessian.diagonal() > 0.0
        self.dependent, self.free = np.flatnonzero(~stiff), np.flatnonzero(stiff)

    def closed_form(self, q: Array) -> Matrices:
        """Motions that stay closed by one solve, then the compliance or its inverse."""
        pin.computeJointJacobians(self.model, self.data, q)
        world = self.data.J
        rows = []
        for joint, point, signs, is_weld in self.ties:
            twists = world * signs
            if is_weld:
                rows.append(twists)
            else:
                at = self.data.oMi[joint].act(point)
                rows.append(twists[:3] - pin.skew(at) @ twists[3:])
        C = np.concatenate(rows)
        N = np.zeros((len(q), len(self.free)))
        N[self.free] = np.eye(len(self.free))
        N[self.dependent] = -np.linalg.solve(C[:, self.dependent], C[:, self.free])
        M = self.data.oMi[self.body.joint] * pin.SE3(self.body.T_j_f)
        J = (M.toActionMatrixInverse() @ ((world * self.way) @ N))[TO_ANGULAR_LINEAR]
        H = N.T @ self.hessian @ N
        if len(H) > 6:
            K = np.linalg.inv(J @ np.linalg.solve(H, J.T))
            return connections(K, np.zeros(6), None)
        A = np.linalg.inv(J)
        return connections(A.T @ H @ A, np.zeros(6), A.T @ H @ A)


# -- by hand: the platform -------------------------------------------------------------------


class Platform:
    """Plain NumPy: six line springs between base points and points of the body."""

    def __init__(self, file: Path) -> None:
        data = YAML(typ="safe").load(file)
        self.base, self.points = np.array(data["base"], float), np.array(data["platform"], float)
        self.k = np.array(data["legs"]["stiffness"], float)
        self.rest = np.array(data["legs"]["rest_length"], float)

    def legs(self, R: Array, p: Array) -> tuple[Array, Array, Array]:
        """Unit vectors in the body, lengths, line coordinates."""
        leg = self.points + (p - self.base) @ R
        length = np.sqrt((leg * leg).sum(axis=1))
        unit = leg / length[:, None]
        return unit, length, np.hstack([np.cross(self.points, unit), unit])

    def wrench(self, R: Array, p: Array) -> Array:
        """Sum of the legs' tensions along their lines."""
        _, length, lines = self.legs(R, p)
        return (self.k * (length - self.rest)) @ lines

    def closed_form(self, q: Array) -> Matrices:
        """Sum over the legs of their stretching and their turning."""
        R, p = pin.rpy.rpyToMatrix(*q[3:]), q[:3]
        unit, length, lines = self.legs(R, p)
        tension = self.k * (length - self.rest)
        K_F = (lines.T * self.k) @ lines
        K_A = K_F.copy()
        for b, u, t, size in zip(self.points, unit, tension, length, strict=True):
            D = np.hstack([-pin.skew(b), np.eye(3)])
            K_A += (t / size) * (D.T @ (np.eye(3) - np.outer(u, u)) @ D)
            # u . (w_j x (w_i x b + v_i))
            K_A[:3, :3] += t * (np.outer(u, b) - (u @ b) * np.eye(3))
            K_A[3:, :3] += t * pin.skew(u)
        return connections(K_A, tension @ lines, K_F)

    def differences(self, q: Array) -> Matrices:
        """Central differences of the wrench along the six body twists."""
        pose = pin.SE3(pin.rpy.rpyToMatrix(*q[3:]), q[:3])
        _, _, lines = self.legs(pose.rotation, pose.translation)
        K_A = np.empty((6, 6))
        for j in range(6):
            twist = np.zeros(6)
            twist[TO_ANGULAR_LINEAR[j]] = STEP
            plus, minus = pose * pin.exp6(twist), pose * pin.exp6(-twist)
            change = self.wrench(plus.rotation, plus.translation)
            change -= self.wrench(minus.rotation, minus.translation)
            K_A[:, j] = change / (2 * STEP)
        W = self.wrench(pose.rotation, pose.translation)
        return connections(K_A, W, (lines.T * self.k) @ lines)


# -- cartstiff -------------------------------------------------------------------------------


PROGRAMS: dict[tuple[int, bool], cartstiff.Program] = {}


def program(elastic: cartstiff.ElasticMechanism, loaded: bool) -> cartstiff.Program:
    """Every array of a posture, recorded and compiled once."""
    key = id(elastic), loaded  # a program keeps its mechanism, so that no other has its identity
    if key not in PROGRAMS:
        each = [f"{kind}_{c}" for kind in ("stiffness", "compliance") for c in "ABKF"]
        outputs = ["pose", "jacobian", "wrench", "energy", *each]
        PROGRAMS[key] = cartstiff.record(elastic, outputs, loaded=loaded)
    return PROGRAMS[key]


def ours(elastic: cartstiff.ElasticMechanism, q: Array, wrench: Array | None = None) -> Matrices:
    """Everything of a program, as arrays; the matrices that exist, by letter."""
    answer = program(elastic, wrench is not None)(q, wrench)
    arrays = {name: answer[name] for name in answer}
    each = {letter: arrays[f"stiffness_{letter}"] for letter in "ABKF"}
    return {letter: K for letter, K in each.items() if K[0, 0] == K[0, 0]}


def analysed(
    elastic: cartstiff.ElasticMechanism, q: Array, wrench: Array | None = None
) -> cartstiff.PostureStiffness:
    """Everything of the JSON, as arrays."""
    result = cartstiff.analyse(elastic, q, wrench=wrench)
    result.pose, result.jacobian, result.wrench, result.energy  # noqa: B018
    result.matrices, result.compliances, result.notes  # noqa: B018
    return result


def ours_as_dict(
    elastic: cartstiff.ElasticMechanism, q: Array, wrench: Array | None = None
) -> dict[str, Any]:
    """The object that the command line prints, ready for `json.dumps`."""
    return cartstiff.analyse(elastic, q, wrench=wrench).to_dict()


# -- cases -----------------------------------------------------------------------------------

CARTSTIFF = "cartstiff: a program, all arrays"
ANALYSED = "cartstiff: `analyse`, all of the JSON, as arrays"
AS_DICT = "cartstiff: the same through `.to_dict()`"
PLAIN = "plain script: only A, B, K, F, kinematic Hessian"
LEAN = "plain script: only A, B, K, F, bracket contracted first"
SOLVED = "plain script: only A, B, K, F, unloaded, closures solved for"
SOLVED_B = "plain script: only A, B, K, unloaded, closures solved for"
FINITE = "finite differences: only A, B, K, F"


def arm(name: str, title: str, rest_given: bool = False, loaded: bool = True) -> Case:
    """An arm loaded by its springs, or its open rest positions balanced: by a wrench, or none."""
    elastic = cartstiff.load(name)
    rng = np.random.default_rng(1)
    # Further from given rest positions, joints wind up by more than 5 deg, which a note remarks on.
    spread = 0.01 if rest_given else 0.4
    postures = [elastic.q + rng.uniform(-spread, spread, len(elastic.q)) for _ in range(POSTURES)]
    loads: list[Array | None] = [None] * POSTURES
    rest = None
    if rest_given:
        rest = elastic.q + 0.002
        elastic = elastic.with_springs(rest=rest)
    elif loaded:
        loads = [rng.normal(size=6) * [10, 10, 10, 50, 50, 50] for _ in postures]
    springs = elastic.springs
    assert springs is not None
    names, frame = elastic.names, elastic.mechanism.frame
    hand = Arm(example_robot(name), frame, names, springs.stiffness, rest)

    # By hand, springs without rest positions and without a load are a load of zero.
    by_hand = loads if rest_given or loaded else [np.zeros(6)] * POSTURES

    def turn(
        function: Callable[[Array, Array | None], Any], loads: list[Array | None]
    ) -> Callable[[int], Any]:
        return lambda i: function(postures[i], loads[i])

    return Case(
        title,
        {
            CARTSTIFF: turn(partial(ours, elastic), loads),
            ANALYSED: turn(partial(analysed, elastic), loads),
            AS_DICT: turn(partial(ours_as_dict, elastic), loads),
            PLAIN: turn(hand.with_hessian, by_hand),
            LEAN: turn(hand.contracted, by_hand),
            FINITE: turn(hand.differences, by_hand),
        },
        API_LIMIT if len(names) == 6 else None,
    )


def closed_chain() -> Case:
    """The 6-UPS tree with five closures, assembled or still to be, beside the direct sum."""
    elastic, direct = cartstiff.load("6-ups"), cartstiff.load("hexapod")
    rng = np.random.default_rng(4)
    poses = [direct.q + rng.uniform(-0.02, 0.02, 6) for _ in range(POSTURES)]
    held = [i for i, name in enumerate(elastic.names) if name.endswith("_slide")]
    home = direct.mechanism.leg_lengths(direct.q)
    starts = []
    for pose in poses:
        q = elastic.q.copy()
        q[held] = direct.mechanism.leg_lengths(pose) - home
        starts.append(q)
    assembled, hand = [elastic.mechanism.assembled(q) for q in starts], Closed(elastic)
    return Case(
        "6-UPS closed chain (21 joints, 5 closures), assembled",
        {
            CARTSTIFF: lambda i: ours(elastic, assembled[i]),
            ANALYSED: lambda i: analysed(elastic, assembled[i]),
            AS_DICT: lambda i: ours_as_dict(elastic, assembled[i]),
            "cartstiff: a program, the chain still to be assembled": lambda i: ours(
                elastic, starts[i]
            ),
            "cartstiff: a program, the same platform as line springs": lambda i: ours(
                direct, poses[i]
            ),
            SOLVED: lambda i: hand.closed_form(assembled[i]),
        },
        CLOSED_LIMIT,
    )


def flexible_delta() -> Case:
    """The delta whose forearms give: 33 coordinates, 27 motions that stay closed."""
    elastic = cartstiff.load("delta")
    rng = np.random.default_rng(5)
    motors = list(elastic.mechanism.actuated)
    postures = []
    for _ in range(POSTURES):
        q = elastic.q.copy()
        q[motors] += rng.uniform(-0.2, 0.2, len(motors))
        postures.append(elastic.mechanism.assembled(q))
    hand = Closed(elastic)
    return Case(
        "Delta with flexible forearms (33 coordinates), assembled",
        {
            CARTSTIFF: lambda i: ours(elastic, postures[i]),
            ANALYSED: lambda i: analysed(elastic, postures[i]),
            AS_DICT: lambda i: ours_as_dict(elastic, postures[i]),
            SOLVED_B: lambda i: hand.closed_form(postures[i]),
        },
        FLEXIBLE_LIMIT,
    )


def rest_under_load() -> None:
    """Print the time to static equilibrium of a UR5 beside SciPy's minimisers, same energy."""
    from scipy.optimize import minimize

    from cartstiff import DeadForce, equilibrium
    from cartstiff.core.stiffness.balance import with_rest_balancing

    arm_at_rest = cartstiff.load("ur5")
    arm_at_rest = with_rest_balancing(arm_at_rest, arm_at_rest.q)
    rng = np.random.default_rng(5)
    forces = [DeadForce(rng.normal(size=3) * 100.0) for _ in range(20)]

    def energy(load: DeadForce) -> Callable[[Array], Any]:
        full = arm_at_rest.with_potential(load)
        return lambda q: full.evaluate(full.mechanism.at(q))

    def minimised(i: int, method: str) -> Array:
        f = energy(forces[i])
        more = {} if method == "BFGS" else {"hess": lambda q: f(q).hessian}
        return minimize(
            lambda q: f(q)[:2],
            arm_at_rest.q,
            jac=True,
            method=method,
            options={"gtol": 1e-8},
            **more,
        ).x

    contenders = {
        "cartstiff: equilibrium, stability, reactions": lambda i: (
            equilibrium(arm_at_rest, forces[i]).q
        ),
        "scipy BFGS": lambda i: minimised(i, "BFGS"),
        "scipy trust-exact, our exact Hessian": lambda i: minimised(i, "trust-exact"),
    }
    (first, *others) = contenders
    worst = {
        name: max(
            float(np.abs(contenders[name](i) - contenders[first](i)).max())
            for i in range(len(forces))
        )
        for name in others
    }
    if not max(worst.values()) <= AT_REST:
        sys.exit(f"equilibria differ by {max(worst.values()):.1e} rad, expected {AT_REST:g}")
    times = interleaved(contenders, ROUNDS, len(forces))
    print("| UR5 under a dead force of 100 N | us per equilibrium | ratio | differs by (rad) |")
    print("|---|---:|---:|---:|")
    for name, seconds in times.items():
        error = f"{worst[name]:.0e}" if name in worst else ""
        print(f"| {name} | {1e6 * seconds:.0f} | {seconds / times[first]:.2f} | {error} |")
    spent = 1e6 * times[first]
    print(f"\nRequired under {REST_LIMIT:g} us: {'met' if spent < REST_LIMIT else 'NOT MET'}.\n")


def paper_platform() -> Case:
    """The platform of the paper, near its pose."""
    elastic = cartstiff.load("stewart-gough")
    rng = np.random.default_rng(2)
    postures = [elastic.q + rng.uniform(-0.2, 0.2, 6) for _ in range(POSTURES)]
    hand = Platform(bundled_files()["stewart-gough"])

    def turn(function: Callable[[Array], Any]) -> Callable[[int], Any]:
        return lambda i: function(postures[i])

    return Case(
        "Stewart-Gough platform of the paper",
        {
            CARTSTIFF: turn(partial(ours, elastic)),
            ANALYSED: turn(partial(analysed, elastic)),
            AS_DICT: turn(partial(ours_as_dict, elastic)),
            "plain script: only A, B, K, F, sum over the legs": turn(hand.closed_form),
            FINITE: turn(hand.differences),
        },
    )


def check(case: Case) -> Iterator[tuple[str, float]]:
    """Largest relative error of each contender against cartstiff.

    Raises
    ------
    SystemExit
        If one computes something else: then its time means nothing.
    """
    for name, contender in case.contenders.items():
        if name == CARTSTIFF:
            continue
        bound = DIFFERENCES if name == FINITE else CLOSED_FORM
        worst = 0.0
        for i in range(POSTURES):
            expected, found = case.contenders[CARTSTIFF](i), contender(i)
            found = found["stiffness"] if name == AS_DICT else found
            found = found.matrices if name == ANALYSED else found
            for letter, K in expected.items():
                error = np.abs(np.array(found[letter]) - K).max() / np.abs(K).max()
                worst = max(worst, float(error))
        if not worst <= bound:
            sys.exit(f"{case.title}: {name} differs by {worst:.1e}, expected at most {bound:g}")
        yield name, worst


def interleaved(
    contenders: dict[str, Callable[[int], Any]], rounds: int, count: int
) -> dict[str, float]:
    """Median seconds a call: every contender runs `count` calls in every round."""
    times: dict[str, list[float]] = {name: [] for name in contenders}
    for _ in range(rounds):
        for name, contender in contenders.items():
            start = time.perf_counter()
            for i in range(count):
                contender(i)
            times[name].append((time.perf_counter() - start) / count)
    return {name: statistics.median(values) for name, values in times.items()}


def processes() -> dict[str, float]:
    """Median wall time of whole processes, interpreter included."""
    script = Path(sys.executable).with_name("cartstiff")
    command = [str(script)] if script.is_file() else [sys.executable, "-m", "cartstiff"]
    runs = {
        "cartstiff --help": [*command, "--help"],
        "cartstiff analyse ur5 --json": [*command, "analyse", "ur5", "--json"],
        "cartstiff analyse stewart-gough --json": [*command, "analyse", "stewart-gough", "--json"],
        'python -c "import pinocchio"': [sys.executable, "-c", "import pinocchio"],
        'python -c "import numpy"': [sys.executable, "-c", "import numpy"],
        'python -c "pass"': [sys.executable, "-c", "pass"],
    }

    # An installed package keeps its bytecode, whatever the shell of whoever measures says.
    keeping = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}

    def run(arguments: list[str], _: int) -> None:
        done = subprocess.run(arguments, capture_output=True, check=True, env=keeping)
        if "--json" in arguments:
            json.loads(done.stdout)

    contenders = {name: partial(run, arguments) for name, arguments in runs.items()}
    for contender in contenders.values():  # bytecode and disk cache are warm
        contender(0)
    return interleaved(contenders, PROCESS_ROUNDS, 1)


def start() -> tuple[dict[str, float], float]:
    """Median processor time (user and system, s) of the first answer and of `REFERENCE`, in turns.

    With it the median ratio of neighbours, which other work on the machine changes least.
    """
    keeping = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}
    answer = [sys.executable, "-m", "cartstiff", "analyse", "ur5", "--json"]
    runs = {"cartstiff analyse ur5 --json": answer, REFERENCE: [sys.executable, "-c", REFERENCE]}
    spent: dict[str, list[float]] = {name: [] for name in runs}
    for _ in range(1 + START_ROUNDS):
        for name, arguments in runs.items():
            before = resource.getrusage(resource.RUSAGE_CHILDREN)
            subprocess.run(arguments, capture_output=True, check=True, env=keeping)
            after = resource.getrusage(resource.RUSAGE_CHILDREN)
            used = after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime
            spent[name].append(used)
    medians = {name: statistics.median(times[1:]) for name, times in spent.items()}
    pairs = zip(*(times[1:] for times in spent.values()), strict=True)
    return medians, statistics.median(one / other for one, other in pairs)


def machine() -> str:
    """What the numbers were measured on."""
    name = platform.processor() or platform.machine()
    cpuinfo = Path("/proc/cpuinfo")
    if cpuinfo.is_file():
        lines = cpuinfo.read_text(encoding="utf-8").splitlines()
        name = next(
            (x.partition(":")[2].strip() for x in lines if x.startswith("model name")), name
        )
    packages = ", ".join(f"{p} {version(p)}" for p in ("numpy", "scipy", "pin", "cartstiff"))
    load = ", ".join(f"{x:.1f}" for x in os.getloadavg())
    threads = os.environ.get("OMP_NUM_THREADS", "not set")
    return (
        f"{name}, {os.cpu_count()} cores, {platform.system()}, Python "
        f"{platform.python_version()}, {packages}; OMP_NUM_THREADS {threads}; "
        f"load average before {load}"
    )


def main() -> None:
    """Print the tables as Markdown."""
    print(f"Machine: {machine()}\n")
    for case in (
        arm("ur5", "UR5, rest positions given", rest_given=True),
        arm("ur5", "UR5, neither rest positions nor load", loaded=False),
        arm("ur5", "UR5, load given"),
        arm("panda", "Panda (7 joints), load given"),
        paper_platform(),
        closed_chain(),
        flexible_delta(),
    ):
        errors = dict(check(case))
        times = interleaved(case.contenders, ROUNDS, POSTURES)
        print(f"| {case.title} | us per posture | ratio | differs by |\n|---|---:|---:|---:|")
        for name, seconds in times.items():
            error = f"{errors[name]:.0e}" if name in errors else ""
            print(f"| {name} | {1e6 * seconds:.1f} | {seconds / times[CARTSTIFF]:.2f} | {error} |")
        spent = 1e6 * times[CARTSTIFF]
        if case.limit is None:
            print()
        else:
            verdict = "met" if spent < case.limit else "NOT MET"
            print(f"\nRequired under {case.limit:g} us: {verdict}.\n")
    rest_under_load()
    print("| whole process | ms | required |\n|---|---:|---:|")
    for name, seconds in processes().items():
        limit = PROCESS_LIMITS.get(name)
        required = ""
        if limit is not None:
            required = f"< {1e3 * limit:.0f}: {'met' if seconds < limit else 'NOT MET'}"
        print(f"| `{name}` | {1e3 * seconds:.0f} | {required} |")
    medians, ratio = start()
    print("\n| start | ms of processor time |\n|---|---:|")
    for name, seconds in medians.items():
        print(f"| `{name}` | {1e3 * seconds:.0f} |")
    verdict = "met" if ratio <= START_LIMIT else "NOT MET"
    print(f"\nMedian ratio {ratio:.2f}; required at most {START_LIMIT:g}: {verdict}.")
    print(
        f"\nMedians of {ROUNDS} interleaved rounds of {POSTURES} postures, "
        f"and of {PROCESS_ROUNDS} rounds of processes."
    )


if __name__ == "__main__":
    main()
