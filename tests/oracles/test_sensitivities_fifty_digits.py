"""Derivatives of stiffness, pose and frequencies against differences in fifty-digit arithmetic."""

import mpmath as mp
import numpy as np
import pinocchio as pin
import pytest
from tests.doors import Chain, plain_tree
from tests.mechanisms.machines import write_file
from tests.support import loaded_arm
from tests.support.digits import skew, turned

from cartstiff import (
    DeadForce,
    ElasticMechanism,
    JointSprings,
    accuracy,
    analyse,
    equilibrium,
    load,
    modes,
    sensitivities,
)
from cartstiff.analysis import Tolerances

#: Required; double precision gives 1e-11.
EXACT = 1e-8
DIGITS = 50
STEP = mp.mpf(10) ** -16


def derivative(f, x):
    """df/dx of a matrix-valued function, off by 1e-32."""
    h = STEP * max(1, abs(x))
    return np.array(((f(x + h) - f(x - h)) / (2 * h)).tolist(), float)


def check(found, wanted):
    assert np.abs(found - wanted).max() < EXACT * np.abs(wanted).max()


def vector(x):
    return mp.matrix([mp.mpf(float(v)) for v in np.ravel(x)])


def bodies_frequencies(K, M):
    """Hz, of symmetric K and positive definite M."""
    L = mp.cholesky(M)
    inner = mp.inverse(L) * K * mp.inverse(L).T
    squares = mp.eigsy((inner + inner.T) / 2, eigvals_only=True)
    return mp.matrix([mp.sqrt(x) / (2 * mp.pi) for x in squares])


# -- a platform at rest under a force of constant direction ---------------------------------------

BASE = np.array(
    [[np.cos(a), np.sin(a), 0.02 * i] for i, a in enumerate([0, 0.4, 2, 2.5, 4.1, 4.6])]
)
TOP = 0.6 * np.array([[np.cos(a), np.sin(a), 0.0] for a in [0.9, 1.3, 3.0, 3.4, 5.1, 5.5]])
K_LEGS = [9e3, 8e3, 11e3, 7e3, 10e3, 12e3]
CENTRE, MASS, TURNING = [0.02, -0.03, 0.05], 6.0, np.diag([0.4, 0.5, 0.7])
FORCE, AT = [150.0, -60.0, -400.0], [0.05, 0.1, -0.02]
REST = 1.0


class Platform:
    """Six legs and a force, by parameters."""

    def __init__(self, state):
        self.R, self.p = mp.matrix(state.pose[:3, :3].tolist()), vector(state.pose[:3, 3])
        self.values = {}
        for group, points in (("base", BASE), ("platform", TOP)):
            for i, point in enumerate(points):
                for axis, x in zip("xyz", point, strict=True):
                    self.values[f"{group}.leg{i + 1}.{axis}"] = mp.mpf(float(x))
        for i, k in enumerate(K_LEGS):
            self.values[f"stiffness.leg{i + 1}"] = mp.mpf(k)
            self.values[f"rest.leg{i + 1}"] = mp.mpf(REST)
        self.values["mass.platform"] = mp.mpf(MASS)

    def _at(self, values, R, p):
        """Gradient and Hessian on body twists, of legs and force."""
        g, H = mp.zeros(6, 1), mp.zeros(6, 6)
        f = R.T * vector(FORCE)
        terms = [(vector(AT), -f, mp.zeros(3, 3))]
        for i in range(6):
            a, b = (
                mp.matrix([values[f"{n}.leg{i + 1}.{x}"] for x in "xyz"])
                for n in ("base", "platform")
            )
            along = b + R.T * (p - a)
            length = mp.sqrt(mp.fdot(along, along))
            u = along / length
            k, t = values[f"stiffness.leg{i + 1}"], length - values[f"rest.leg{i + 1}"]
            across = mp.eye(3) - u * u.T
            terms.append((b, k * t * u, k * (u * u.T + t / length * across)))
        for b, force, stiff in terms:
            D = mp.zeros(3, 6)
            D[:, :3], D[:, 3:] = -skew(b), mp.eye(3)
            g += D.T * force
            # What turning the body does to a force that does not: at rest its antisymmetric parts
            # cancel.
            turning = mp.zeros(6, 6)
            turning[:3, :3] = skew(force) * skew(b)
            H += D.T * stiff * D + (turning + turning.T) / 2
        return g, H

    def rest(self, name, x):
        """Pose, Hessian and Hz with one parameter changed."""
        values = {**self.values, name: x}
        R, p = self.R, self.p
        for _ in range(3):
            g, H = self._at(values, R, p)
            step = -mp.lu_solve(H, g)
            R, p = R * turned(step[:3]), p + R * step[3:]
        H = self._at(values, R, p)[1]
        c, M = vector(CENTRE), mp.zeros(6, 6)
        D = mp.zeros(3, 6)
        D[:, :3], D[:, 3:] = -skew(c), mp.eye(3)
        M[:3, :3] = mp.matrix(TURNING.tolist())
        M += values["mass.platform"] * D.T * D
        return R, p, H, bodies_frequencies(H, M)


@pytest.fixture(scope="module")
def platform(tmp_path_factory):
    elastic = load(
        write_file(
            tmp_path_factory.mktemp("rest"),
            "platform",
            kind="stewart-gough",
            base=BASE.tolist(),
            platform=TOP.tolist(),
            pose={"xyz": [0.03, -0.02, 0.8], "rpy": [0.05, -0.1, 0.1]},
            body={"mass": MASS, "com": CENTRE, "inertia": TURNING.tolist()},
            legs={"stiffness": K_LEGS, "rest_length": REST},
        )
    )
    state = equilibrium(elastic, DeadForce(FORCE, AT))
    with mp.workdps(DIGITS):
        return state, sensitivities(state), Platform(state)


@pytest.mark.parametrize(
    "name",
    [
        "base.leg2.x",
        "base.leg5.z",
        "platform.leg3.y",
        "stiffness.leg4",
        "rest.leg6",
        "mass.platform",
    ],
)
def test_platform_at_rest(platform, name):
    """The rest moves with the parameter, and stiffness and frequencies with the rest."""
    state, known, exact = platform
    i = known.index(name)
    with mp.workdps(DIGITS):
        x, h = exact.values[name], STEP
        more, less, here = (exact.rest(name, y) for y in (x + h, x - h, x))
        slopes = [(a - b) / (2 * h) for a, b in zip(more, less, strict=True)]
        turn, place, dK, f = (
            np.array(d.tolist(), float) for d in (slopes[0] * here[0].T, *slopes[1:])
        )
        hertz = np.array(here[3].tolist(), float).ravel()
    assert modes(state).frequencies == pytest.approx(hertz, rel=1e-10)
    check(known.frequencies[i], f.ravel())
    if name == "mass.platform":
        assert np.abs(known.pose[i]).max() < 1e-12
        return
    for letter in "ABK":
        check(known.stiffness[letter][i], dK)
    check(known.pose[i], np.array([turn[2, 1], turn[0, 2], turn[1, 0], *place.ravel()]))


def test_what_moves_the_pose_by_how_much(platform):
    """The sum over all parameters, and who is the largest of them."""
    state, known, _ = platform
    found = accuracy(state, Tolerances(length=1e-4))
    lengths = [n for n in known.names if n.partition(".")[0] in ("base", "platform", "rest")]
    assert sorted(lengths) == sorted(found.names)
    parts = {n: (1e-4 * known.pose[known.index(n), 5]) ** 2 for n in lengths}
    assert found.deviations["pose"][5] == pytest.approx(np.sqrt(sum(parts.values())), rel=1e-10)
    name, share = found.main("pose", 5)[0]
    assert name == max(parts, key=parts.get)
    assert share == pytest.approx(parts[name] / sum(parts.values()), rel=1e-10)
    f = known.frequencies[[known.index(n) for n in found.names]]
    assert found.deviations["frequencies"] == pytest.approx(1e-4 * np.sqrt((f**2).sum(axis=0)))


# -- arms ------------------------------------------------------------------------------------------


def transform(R, p):
    T = mp.eye(4)
    T[:3, :3] = R
    for r in range(3):
        T[r, 3] = p[r]
    return T


def moved_placement(T, axis, x):
    """A placement moved along, or turned about, one of its axes."""
    R, p = T[:3, :3], T[:3, 3]
    if axis.startswith("r"):
        w = mp.zeros(3, 1)
        w["xyz".index(axis[1])] = x
        return transform(R * turned(w), p)
    p = p.copy()
    p["xyz".index(axis)] += x
    return transform(R, p)


def chain_twists(places, axes, q):
    """Pose of the body, body Jacobian (6 x n) of revolute joints; poses of the joints."""
    poses, T = [], mp.eye(4)
    for place, axis, x in zip(places, axes, q, strict=False):
        T = T * place * transform(turned(x * axis), mp.zeros(3, 1))
        poses.append(T)
    end = T * places[-1]
    J = mp.zeros(6, len(q))
    for i, (pose, axis) in enumerate(zip(poses, axes, strict=False)):
        w, arm = pose[:3, :3] * axis, end[:3, 3] - pose[:3, 3]
        J[:3, i], J[3:, i] = end[:3, :3].T * w, end[:3, :3].T * (skew(w) * arm)
    return end, J, poses


@pytest.mark.parametrize("name", ["placement.j2.x", "placement.j4.ry", "frame.z", "stiffness.j3"])
def test_arm_that_is_held(name):
    """K^A, K^K of an arm whose controller holds it under its load: brackets of joint twists."""
    arm = loaded_arm("RRRRRR", seed=4)
    result = analyse(arm.elastic, arm.q, wrench=arm.wrench)
    known = sensitivities(result)
    tree, W = arm.elastic.mechanism.tree, vector(result.wrench)
    where, _, axis = name.rpartition(".")
    with mp.workdps(DIGITS):
        axes = [vector(np.round(screw[:3], 12)) for screw in tree.screws()]
        axes = [a / mp.sqrt(mp.fdot(a, a)) for a in axes]
        k = [mp.mpf(float(x)) for x in arm.elastic.springs.stiffness]

        def stiffness(x):
            own = list(k)
            places = [
                mp.matrix(T.tolist())
                for T in (*tree.placements(), arm.elastic.mechanism.body.T_j_f)
            ]
            if where == "stiffness":
                own[tree.model.getJointId(axis) - 1] += x
            else:
                j = 6 if where == "frame" else tree.model.getJointId(where[10:]) - 1
                places[j] = moved_placement(places[j], axis, x)
            J = chain_twists(places, axes, [mp.mpf(float(x)) for x in arm.q])[1]
            H = mp.diag(own)
            for a in range(6):
                for b in range(a + 1, 6):
                    wa, va, wb, vb = J[:3, a], J[3:, a], J[:3, b], J[3:, b]
                    m, f = skew(wa) * wb, skew(wa) * vb - skew(wb) * va
                    s = (mp.fdot(W[:3], m) + mp.fdot(W[3:], f)) / 2
                    H[a, b] -= s
                    H[b, a] -= s
            inverse = mp.inverse(J)
            return inverse.T * H * inverse

        wanted = derivative(stiffness, mp.mpf(0))
    check(known.stiffness["B"][known.index(name)], wanted)
    # The load stays, and with it what stands between the connections.
    check(known.stiffness["A"][known.index(name)], wanted)
    check(known.stiffness["K"][known.index(name)], wanted)


LINKS = [(1.2, [0.05, 0.0, 0.1]), (0.9, [0.0, 0.1, 0.12]), (0.6, [0.1, 0.02, 0.05])]
ARM_K, ARM_Q, ARM_FORCE = [900.0, 700.0, 500.0], [0.3, -0.5, 0.4], [30.0, 20.0, -60.0]


def light_arm():
    """Three revolute joints about x, y, z with point masses."""
    rng = np.random.default_rng(7)
    model = pin.Model()
    parent, axes = 0, [pin.JointModelRX, pin.JointModelRY, pin.JointModelRZ]
    for i, (joint, (mass, centre)) in enumerate(zip(axes, LINKS, strict=True)):
        place = pin.SE3(pin.exp3(rng.normal(size=3)), rng.uniform(0.1, 0.4, 3))
        parent = model.addJoint(parent, joint(), place, f"j{i + 1}")
        model.appendBodyToJoint(
            parent, pin.Inertia(mass, np.array(centre), np.zeros((3, 3))), pin.SE3.Identity()
        )
        model.addFrame(pin.Frame(f"link{i + 1}", parent, pin.SE3.Identity(), pin.FrameType.BODY))
    tip = pin.SE3(pin.exp3(rng.normal(size=3)), np.array([0.1, 0.3, 0.2]))
    model.addFrame(pin.Frame("tip", parent, tip, pin.FrameType.OP_FRAME))
    chain = Chain(plain_tree(model), "tip")
    return ElasticMechanism("arm", chain, np.array(ARM_Q), JointSprings(ARM_K, ARM_Q))


@pytest.mark.parametrize(
    "name",
    ["placement.j2.y", "placement.j3.rx", "frame.z", "stiffness.j1", "rest.j2", "mass.link2"],
)
def test_arm_at_rest(name):
    """Frequencies and pose of an arm that gives way to a force, from its energy alone."""
    elastic = light_arm()
    state = equilibrium(elastic, DeadForce(ARM_FORCE))
    known = sensitivities(state)
    tree = elastic.mechanism.tree
    where, _, axis = name.rpartition(".")
    with mp.workdps(DIGITS):
        axes, f = [mp.eye(3)[:, i] for i in range(3)], vector(ARM_FORCE)

        def rest(x):
            places = [
                mp.matrix(T.tolist()) for T in (*tree.placements(), elastic.mechanism.body.T_j_f)
            ]
            k, q0, m = vector(ARM_K), vector(ARM_Q), [mp.mpf(mass) for mass, _ in LINKS]
            own = {"stiffness": k, "rest": q0, "mass": m}.get(where)
            if own is not None:
                own[int(axis[-1]) - 1] += x
            else:
                j = 3 if where == "frame" else int(where[-1]) - 1
                places[j] = moved_placement(places[j], axis, x)

            def energy(q):
                end = chain_twists(places, axes, q)[0]
                return sum(k[i] * (q[i] - q0[i]) ** 2 for i in range(3)) / 2 - mp.fdot(
                    f, end[:3, 3]
                )

            def slopes(q):
                h, e = mp.mpf(10) ** -8, mp.eye(3)
                g = mp.matrix(
                    [
                        (energy(q + h * e[:, i]) - energy(q - h * e[:, i])) / (2 * h)
                        for i in range(3)
                    ]
                )
                return g

            q = vector(state.q)
            for _ in range(3):
                J = chain_twists(places, axes, q)
                end, poses = J[0], J[2]
                # Gradient and Hessian of the force's work by twists: exact.
                g = mp.matrix([k[i] * (q[i] - q0[i]) for i in range(3)])
                H = mp.diag(list(k))
                w = [pose[:3, :3] * a for pose, a in zip(poses, axes, strict=True)]
                v = [skew(w[i]) * (end[:3, 3] - poses[i][:3, 3]) for i in range(3)]
                for i in range(3):
                    g[i] -= mp.fdot(f, v[i])
                    for j in range(3):
                        first, last = min(i, j), max(i, j)
                        H[i, j] -= mp.fdot(f, skew(w[first]) * v[last])
                q -= mp.lu_solve(H, g)
            assert mp.norm(slopes(q)) < mp.mpf(10) ** -9  # the energy itself is at rest there
            M = mp.zeros(3, 3)
            for i, (_, centre) in enumerate(LINKS):
                at = poses[i][:3, 3] + poses[i][:3, :3] * vector(centre)
                V = mp.zeros(3, 3)
                for j in range(i + 1):
                    V[:, j] = skew(w[j]) * (at - poses[j][:3, 3])
                M += m[i] * V.T * V
            both = mp.matrix(6, 1)
            both[:3, 0], both[3:, 0] = bodies_frequencies(H, M), end[:3, 3]
            return both

        wanted = derivative(rest, mp.mpf(0)).ravel()
        here = np.array(rest(mp.mpf(0)).tolist(), float).ravel()
    i = known.index(name)
    assert modes(state).frequencies == pytest.approx(here[:3], rel=1e-10)
    check(known.frequencies[i], wanted[:3])
    if where != "mass":
        check(known.pose[i][3:], wanted[3:])
