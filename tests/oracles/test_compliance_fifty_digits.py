"""Compliance near singularities and with springs over many decades, against fifty digits.

The reference multiplies exponentials of the joints, takes J from their adjoints and S_W from
brackets of its columns, and inverts the joint stiffness, all by mpmath: no K is ever inverted.
"""

from __future__ import annotations

import mpmath as mp
import numpy as np
import pinocchio as pin
import pytest
from tests.doors import Chain, plain_tree
from tests.support import absolute_error, add_frame, promised, random_pose, translation
from tests.support.digits import matrix, skew, turned
from tests.support.printed import text_of
from tests.support.read import asked, of_many

import cartstiff
from cartstiff import ElasticMechanism, JointSprings, analyse_many, analyse_posture

# What is asked of the compliance: ten digits of its largest entry, in the chain's natural units.
TEN_DIGITS = 1e-10
# A wrist turned by d from its singular posture: as a share of the others' turns.
DISTANCES = [1e-1, 1e-3, 1e-5, 1e-7, 1e-9, 1e-12]
_DIGITS = 50


def _turn(axis, angle):
    """Rotation (4, 4) about a unit axis."""
    T = mp.eye(4)
    T[:3, :3] = turned([x * angle for x in axis])
    return T


def _inverse(T):
    found = mp.eye(4)
    found[:3, :3] = T[:3, :3].T
    found[:3, 3] = -(T[:3, :3].T * T[:3, 3])
    return found


def _adjoint(T):
    R, p = T[:3, :3], T[:3, 3]
    found = mp.zeros(6, 6)
    found[:3, :3], found[3:, 3:], found[3:, :3] = R, R, skew(p) * R
    return found


def _bracket(x, y):
    def cross(a, b):
        return skew(a) * b

    found = mp.zeros(6, 1)
    found[:3, 0] = cross(x[:3, 0], y[:3, 0])
    found[3:, 0] = cross(x[:3, 0], y[3:, 0]) - cross(y[:3, 0], x[3:, 0])
    return found


def _hessian(J, k, W):
    """Of the springs' energy less the work of W, in joint coordinates, symmetric (connection B)."""
    H, W = mp.diag([mp.mpf(float(x)) for x in k]), matrix(W)
    for a in range(len(k)):
        for b in range(a + 1, len(k)):
            s = (W.T * _bracket(J[:, a], J[:, b]))[0] / 2
            H[a, b], H[b, a] = H[a, b] - s, H[b, a] - s
    return H


class _Arm:
    """A chain as it was built, and its body Jacobian in fifty digits."""

    def __init__(self, seed: int, joints: int) -> None:
        rng = np.random.default_rng(seed)
        self.model = pin.Model()
        self.axes, self.places, last = [], [], 0
        for i in range(joints):
            axis = rng.normal(size=3) if i < joints - 3 else np.eye(3)[[2, 1, 2][i - joints + 3]]
            axis = axis / np.linalg.norm(axis)
            # Three axes that meet: parallel ones where the middle joint stands at zero.
            place = np.eye(4) if i > joints - 3 else random_pose(rng, 0.4)
            joint = pin.JointModelRevoluteUnaligned(axis)
            last = self.model.addJoint(last, joint, pin.SE3(place), f"j{i}")
            self.axes.append(axis)
            self.places.append(place)
        self.tip = translation(0.1, 0.05, 0.2)
        add_frame(self.model, "tip", last, self.tip)
        self.chain = Chain(plain_tree(self.model), "tip")
        self.q = rng.uniform(-1.5, 1.5, joints)

    def jacobian(self, q):
        columns, behind = [], matrix(self.tip)
        for axis, place, angle in reversed(list(zip(self.axes, self.places, q, strict=True))):
            twist = mp.matrix([*axis.tolist(), 0, 0, 0])
            columns.insert(0, _adjoint(_inverse(behind)) * twist)
            behind = matrix(place) * _turn(axis.tolist(), mp.mpf(float(angle))) * behind
        J = mp.zeros(6, len(columns))
        for a, column in enumerate(columns):
            J[:, a] = column
        return J

    def compliances(self, q, k, W):
        """C^A, C^B, C^K, C^F."""
        J, n, W = self.jacobian(q), len(k), matrix(W)
        K_q = mp.diag([mp.mpf(float(x)) for x in k])
        S = mp.zeros(n, n)
        for a in range(n):
            for b in range(a + 1, n):
                S[a, b] = S[b, a] = (W.T * _bracket(J[:, a], J[:, b]))[0] / 2
        moment, force = skew(W[:3, 0]), skew(W[3:, 0])
        D_A, D_K = mp.zeros(6, 6), mp.zeros(6, 6)
        D_A[:3, :3], D_A[:3, 3:], D_A[3:, :3] = moment / 2, force / 2, force / 2
        D_K[:3, 3:], D_K[3:, :3] = force / 2, -force / 2
        found = {}
        for name, H in (
            ("A", K_q - S + J.T * D_A * J),
            ("B", K_q - S),
            ("K", K_q - S + J.T * D_K * J),
            ("F", K_q),
        ):
            C = J * mp.inverse(H) * J.T
            found[name] = np.array([[float(C[i, j]) for j in range(6)] for i in range(6)])
        return found

    def principal_values(self, q, k, W, length):
        """Of K^B, least first: all with lengths scaled, and of blocks with the others held, free.

        Also the smallest over the largest singular value of J.
        """
        J = self.jacobian(q)
        H = _hessian(J, k, W)
        C = J * mp.inverse(H) * J.T
        K = mp.inverse(C)
        scale = mp.diag([1 / mp.mpf(length)] * 3 + [mp.mpf(1)] * 3)
        found = {"all": sorted(mp.eigsy(scale * K * scale, eigvals_only=True))}
        for freedom, block in (("translation", slice(3, 6)), ("rotation", slice(0, 3))):
            found[freedom, "held"] = sorted(mp.eigsy(K[block, block], eigvals_only=True))
            give = mp.eigsy(C[block, block], eigvals_only=True)
            found[freedom, "free"] = sorted(1 / x for x in give)
        sizes = mp.svd_r(mp.inverse(scale) * J, compute_uv=False)
        return {name: np.array(v, float) for name, v in found.items()}, float(min(sizes) / sizes[0])


def _error(got, expected):
    return absolute_error(got, expected) / np.abs(expected).max()


@pytest.mark.parametrize("distance", DISTANCES)
@pytest.mark.parametrize("joints", [5, 6, 7])
@pytest.mark.parametrize("loaded", [False, True])
def test_springs_of_fifteen_decades(joints, distance, loaded):
    arm = _Arm(joints, joints)
    rng = np.random.default_rng(int(-np.log10(distance)) + 100 * joints)
    q = arm.q.copy()
    q[-2] = distance
    k = 10.0 ** rng.uniform(-3, 12, joints)
    k[rng.permutation(joints)[:2]] = 1e-3, 1e12
    W = np.zeros(6)
    if loaded:  # a load that the softest spring can bear
        W = 3e-4 * rng.normal(size=6)
    elastic = ElasticMechanism("arm", arm.chain, q, JointSprings(k, q))
    result = cartstiff.analyse(elastic, q, wrench=W if loaded else None)
    with mp.workdps(_DIGITS):
        expected = arm.compliances(q, k, W)
    for name, C in result.compliances.items():
        if name == "F" and C is None:
            assert result.matrices["F"] is None
            continue
        assert C is not None
        assert _error(C, expected[name]) <= max(TEN_DIGITS, promised(result))
    C = result.compliances["B"]
    assert np.array_equal(C, C.T)
    # Many postures at once say the same.
    names = [f"compliance_{name}" for name in "ABK"]
    many = analyse_many(elastic, np.array([q, q]), wrench=W if loaded else None, outputs=names)
    for name in "ABK":
        assert _error(many[f"compliance_{name}"][1], result.compliances[name]) <= TEN_DIGITS


@pytest.mark.parametrize("distance", [3e-10, 3e-11, 1e-12, 0.0])
def test_a_lost_rank_keeps_its_small_motion(distance):
    """Where rank counts as lost, the compliance is that of the Jacobian as it is."""
    arm = _Arm(6, 6)
    q = arm.q.copy()
    q[-2] = distance
    k, W = np.linspace(1e3, 5e3, 6), np.array([1.0, -2.0, 3.0, 20.0, 30.0, -40.0])
    elastic = ElasticMechanism("arm", arm.chain, q, JointSprings(k, q))
    result = cartstiff.analyse(elastic, q, wrench=W)
    assert result.matrices["B"] is None
    with mp.workdps(_DIGITS):
        expected = arm.compliances(q, k, W)
    for name in "ABK":
        assert _error(result.compliances[name], expected[name]) <= 1e-14


@pytest.mark.parametrize("distance", [1e-2, 1e-4, 1e-5, 1e-6, 1e-8])
def test_what_is_free_near_a_singularity(distance):
    """Principal values, direction, condition, least stiffness: of one posture, and of a map."""
    arm = _Arm(3, 6)
    q = arm.q.copy()
    q[-2] = distance
    k = np.array([3e4, 2e4, 2e4, 5e3, 5e3, 4e3])
    elastic = ElasticMechanism("arm", arm.chain, q, JointSprings(k, q))
    result = cartstiff.analyse(elastic, q)
    with mp.workdps(_DIGITS):
        C = arm.compliances(q, k, np.zeros(6))["B"]
        J = arm.jacobian(q)
        root = mp.diag([1 / mp.sqrt(mp.mpf(float(x))) for x in k])
        length = 0.3
        scale = mp.diag([length] * 3 + [1] * 3)
        softness = sorted(float(x) for x in mp.svd_r(scale * J * root, compute_uv=False))
    free = np.sort(1 / np.linalg.eigvalsh(C[3:, 3:]))
    settings = asked(length=length, direction=(0.0, 0.0, 1.0))
    answer = analyse_posture(result, length=length, direction=[0, 0, 1])
    found = answer["ellipsoids"]["stiffness"]["translation"]["free"]["eigenvalues"]
    assert found == pytest.approx(free, rel=1e-9)
    given = answer["directions"][-1]
    assert given["along"]["free"] == pytest.approx(1 / C[5, 5], rel=TEN_DIGITS)
    numbers = answer["indices"]
    assert numbers["minimum_stiffness"] == pytest.approx(softness[-1] ** -2, rel=1e-9)
    # The stiffest direction is known as well as J is near the singularity: eps / distance.
    known = max(1e-9, 1e-14 / distance)
    condition = (softness[-1] / softness[0]) ** 2
    assert numbers["condition_number"] == pytest.approx(condition, rel=known)
    assert numbers["definiteness"] == "positive"
    isotropy = float(np.exp(np.mean(-2 * np.log(softness))) / np.mean(np.power(softness, -2.0)))
    assert numbers["isotropy"] == pytest.approx(isotropy, rel=10 * known)
    # A map.
    names = (
        "translation_free_min",
        "translation_free_max",
        "along_free",
        "condition",
        "isotropy",
        "minimum",
    )
    values, _ = of_many(elastic, np.array([q, q]), names, settings)
    expected = (free[0], free[-1], given["along"]["free"], condition, isotropy, softness[-1] ** -2)
    for name, value in zip(names, expected, strict=True):
        assert values[name][0] == pytest.approx(value, rel=10 * known), name


@pytest.mark.parametrize("distance", [1e-1, 1e-3, 1e-5, 1e-7, 1e-9])
@pytest.mark.parametrize("decades", [0, pytest.param(4, marks=pytest.mark.thorough), 9])
@pytest.mark.parametrize(("joints", "loaded"), [(6, False), (6, True), (7, True)])
def test_principal_values_of_stiff_springs_near_a_singularity(joints, loaded, decades, distance):
    """Held, free and whole, of one posture and of a map, as far as J itself is known."""
    arm = _Arm(joints, joints)
    rng = np.random.default_rng([joints, decades, round(-np.log10(distance))])
    q = arm.q.copy()
    q[-2] = distance
    k = 10.0 ** rng.uniform(3, 3 + decades, joints)
    k[rng.permutation(joints)[:2]] = 1e3, 10.0 ** (3 + decades)
    W = rng.normal(size=6) * loaded
    elastic = ElasticMechanism("arm", arm.chain, q, JointSprings(k, q))
    result = cartstiff.analyse(elastic, q, wrench=W if loaded else None)
    length = 0.3
    with mp.workdps(2 * _DIGITS):  # K, inverted from C, loses as many digits as lie between
        expected, ratio = arm.principal_values(q, k, W, length)
    if result.matrices["B"] is None:
        assert result.reduction.states[-1].code == "serial-singularity"
        return
    # What rounding of J does to springs of several decades is a little more. The order of sums
    # depends on the processor: with OPENBLAS_CORETYPE=Haswell 5e-10 and 2e-14 suffice, with AVX-512
    # the largest errors are 1.5e-9 and 4e-14.
    known = max(2e-9, 6e-14 / ratio) if decades else max(1e-10, 1e-14 / ratio)
    answer = analyse_posture(result, length=length, connection="B")
    whole = answer["indices"]
    assert whole["eigenvalues"] == pytest.approx(expected["all"], rel=known)
    assert whole["minimum_stiffness"] == pytest.approx(expected["all"][0], rel=TEN_DIGITS)
    assert answer["definiteness"] == whole["definiteness"] == "positive"
    for freedom in ("translation", "rotation"):
        for others in ("held", "free"):
            found = answer["ellipsoids"]["stiffness"][freedom][others]["eigenvalues"]
            assert found == pytest.approx(expected[freedom, others], rel=known)
            back = answer["ellipsoids"]["compliance"][freedom][others]["eigenvalues"]
            assert back == pytest.approx(1 / np.array(found[::-1]), rel=1e-12)
    # What only K is read for says how much K knows.
    told = [n["values"] for n in answer["notes"] if n["code"] == "ill-conditioned"]
    condition = expected["all"][-1] / expected["all"][0]
    assert told or condition < 1e11
    moving, turning = expected["translation", "held"], expected["rotation", "held"]
    wanted = {
        "translation_held_min": (moving[0], known),
        "translation_held_max": (moving[2], known),
        "rotation_held_min": (turning[0], known),
        "translation_free_max": (expected["translation", "free"][2], known),
        "minimum": (expected["all"][0], TEN_DIGITS),
        "condition": (condition, 2 * known),
        "unstable_directions": (0.0, 0.0),
    }
    load = W if loaded else None
    values, many = of_many(elastic, q[None], tuple(wanted), asked("B", length), load)
    assert many.is_regular.all() or many.counts() == {"ill-conditioned": 1}
    for name, (value,) in values.items():
        assert value == pytest.approx(wanted[name][0], rel=wanted[name][1]), name


@pytest.mark.parametrize("loaded", [False, True])
def test_principal_compliances_at_a_singularity(loaded):
    """Where there is no stiffness: free and held, of springs over nine decades."""
    arm = _Arm(5, 6)
    q = arm.q.copy()
    q[-2] = 0.0
    k = np.array([1e6, 1e-3, 1e6, 1e2, 1e6, 1e2])
    W = 3e-5 * np.random.default_rng(1).normal(size=6) * loaded
    elastic = ElasticMechanism("arm", arm.chain, q, JointSprings(k, q))
    result = cartstiff.analyse(elastic, q, wrench=W if loaded else None)
    assert result.matrices["B"] is None
    table = analyse_posture(result, connection="B")["ellipsoids"]["compliance"]
    J = arm.jacobian(q)
    H = _hessian(J, k, W)
    with mp.workdps(2 * _DIGITS):
        C = J * mp.inverse(H) * J.T
        for freedom, own, other in (
            ("translation", slice(3, 6), slice(0, 3)),
            ("rotation", slice(0, 3), slice(3, 6)),
        ):
            free = [float(x) for x in sorted(mp.eigsy(C[own, own], eigvals_only=True))]
            left = C[own, own] - C[own, other] * mp.inverse(C[other, other]) * C[other, own]
            held = [float(x) for x in sorted(mp.eigsy(left, eigvals_only=True))]
            assert table[freedom]["free"]["eigenvalues"] == pytest.approx(free, rel=1e-9)
            found = table[freedom]["held"]["eigenvalues"]
            assert found[1:] == pytest.approx(held[1:], rel=1e-9)
            assert found[0] == 0.0 < 1e-30 + abs(held[0]) < 1e-29
            assert table[freedom]["held"]["definiteness"] == "positive semidefinite"


def test_what_neither_matrix_knows_is_no_number():
    """Far beyond buckling: what lies between is in neither matrix."""
    arm = _Arm(4, 6)
    q = arm.q.copy()
    q[-2] = 1e-8
    k = np.array([3e4, 1e-3, 2e2, 1e12, 7e8, 1e12])
    elastic = ElasticMechanism("arm", arm.chain, q, JointSprings(k, q))
    W = np.array([0.2, -0.1, 0.3, 5.0, -2.0, 4.0])
    result = cartstiff.analyse(elastic, q, wrench=W)
    with mp.workdps(2 * _DIGITS):
        expected, _ = arm.principal_values(q, k, W, 0.3)
    assert expected["all"][0] < 0.0
    answer = analyse_posture(result, length=0.3, connection="B")
    assert answer["indices"] is None
    assert answer["definiteness"] is None
    assert "ill-conditioned" in {n["code"] for n in answer["notes"]}
    assert "indices, angles" not in text_of(answer, elastic.units)
    values, _ = of_many(elastic, q[None], ("minimum", "condition"), asked("B", 0.3), W)
    assert np.isnan(values["minimum"]).all()
    assert np.isnan(values["condition"]).all()


def test_the_arm_that_people_type():
    """UR5 with pi as people type it, 1.8e-6 from singular: free values of the issue's reference."""
    q = [0.3, -1.1, 1.4, -0.7, 3.1416, 0.2]
    result = cartstiff.analyse(cartstiff.load("ur5"), q)
    answer = analyse_posture(result, direction=[0, 0, 1])
    free = answer["ellipsoids"]["stiffness"]["translation"]["free"]["eigenvalues"]
    C = result.compliances["B"]
    assert free == pytest.approx(np.sort(1 / np.linalg.eigvalsh(C[3:, 3:])), rel=1e-9)
    assert answer["indices"]["condition_number"] > 1e10
    assert answer["indices"]["minimum_stiffness"] > 1e3
    assert promised(result, "stiffness") > 1e-6


@pytest.mark.parametrize("stiffness", [1e5, 1e9, 1e12, 1e15, 1e20, 1e24])
def test_stiff_motor_of_a_closed_chain(stiffness):
    """3-RRR with links that give: K by the saddle-point matrix of all coordinates and closures."""
    elastic = cartstiff.load("3-rrr").with_springs({"leg2/motor": stiffness})
    result = cartstiff.analyse(elastic)
    posture = result.posture
    with mp.workdps(80):
        J, C = matrix(posture.motion.jacobian), matrix(posture.closure.jacobian)
        H = matrix(result.evaluation.hessian)
        n, m = H.rows, C.rows
        saddle = mp.zeros(n + m + 6, n + m + 6)
        saddle[:n, :n] = H
        saddle[n : n + m, :n], saddle[:n, n : n + m] = C, C.T
        saddle[n + m :, :n], saddle[:n, n + m :] = J, J.T
        right = mp.zeros(n + m + 6, 6)
        right[n + m :, :] = mp.eye(6)
        factors, rows = mp.mp.LU_decomp(saddle)
        columns = [
            mp.mp.U_solve(factors, mp.mp.L_solve(factors, right[:, i], rows)) for i in range(6)
        ]
        K = np.array([[-float(c[n + m + i]) for c in columns] for i in range(6)])
    found = result.matrices["B"]
    assert np.array_equal(found, found.T)
    size = np.sqrt(np.outer(np.diag(K), np.diag(K)))
    assert np.abs((found - K) / size).max() <= TEN_DIGITS
    assert not [n for n in result.notes if n.code == "idle-self-motion"]
    C_B = result.compliances["B"] * size
    assert absolute_error(C_B @ (K / size), np.eye(6)) <= 1e-8


def _centre(values, axes, moved):
    """Where B - [p]x D is symmetric, D = sum v e e^T and B = sum v (G e) e^T, in mpmath."""
    D, B = mp.zeros(3, 3), mp.zeros(3, 3)
    for v, e, m in zip(values, axes, moved, strict=True):
        D, B = D + v * e * e.T, B + v * m * e.T
    skew = mp.matrix([B[2, 1] - B[1, 2], B[0, 2] - B[2, 0], B[1, 0] - B[0, 1]])
    trace = D[0, 0] + D[1, 1] + D[2, 2]
    return mp.lu_solve(trace * mp.eye(3) - D, skew)


@pytest.mark.parametrize("distance", [1e-2, 1e-4, 1e-6, 1e-7])
@pytest.mark.parametrize("loaded", [False, True])
def test_screws_axes_centres_and_springs_near_a_singularity(distance, loaded):
    """Every section is that of sixty digits, or null: none reads K alone by a rank of its own."""
    arm = _Arm(3, 6)
    q = arm.q.copy()
    q[-2] = distance
    k = np.array([3e4, 2e4, 2e4, 5e3, 5e3, 4e3])
    W = np.array([1.0, -2.0, 3.0, 20.0, 30.0, -40.0]) * loaded
    elastic = ElasticMechanism("arm", arm.chain, q, JointSprings(k, q))
    answer = analyse_posture(
        cartstiff.analyse(elastic, q, wrench=W if loaded else None), connection="B", length=0.3
    )
    with mp.workdps(60):
        J = arm.jacobian(q)
        H = _hessian(J, k, W)
        C = J * mp.inverse(H) * J.T
        K = mp.inverse(C)
        swapped = mp.zeros(6, 6)
        swapped[:3, :], swapped[3:, :] = K[3:, :], K[:3, :]
        roots = sorted(float(mp.re(x)) for x in mp.eig(swapped, left=False, right=False))
        held, e = mp.eigsy(K[3:, 3:])
        free, g = mp.eigsy(C[:3, :3])
        G = -mp.inverse(C[:3, :3]) * C[:3, 3:]
        e, g = [e[:, i] for i in range(3)], [g[:, i] for i in range(3)]
        centres = {
            "stiffness": _centre(held, e, [G * x for x in e]),
            "compliance": _centre(free, g, [-G.T * x for x in g]),
            "elasticity": mp.matrix(
                [(G[2, 1] - G[1, 2]) / 2, (G[0, 2] - G[2, 0]) / 2, (G[1, 0] - G[0, 1]) / 2]
            ),
            "least_coupling": _centre([x * x for x in held], e, [G * x for x in e]),
        }
    # J itself is known to sixteen digits, and with it what is stiff to these over the distance.
    known = 1e-14 / distance + 1e-10
    found = answer["eigenscrews"]
    assert found["complete"]
    assert [s["eigenvalue"] for s in found["screws"]] == pytest.approx(roots, rel=10 * known)
    axes = answer["wrench_compliant_axes"]
    principal = answer["ellipsoids"]["stiffness"]
    assert [a["stiffness"] for a in axes] == pytest.approx([float(x) for x in held], rel=known)
    assert [a["stiffness"] for a in axes] == principal["translation"]["held"]["eigenvalues"]
    for axis, true in zip(axes, e, strict=True):
        pitch = float((true.T * (G * true))[0])
        assert axis["pitch"] == pytest.approx(pitch, rel=100 * known, abs=known)
    turns = [a["stiffness"] for a in answer["twist_compliant_axes"]]
    assert turns == pytest.approx(sorted(float(1 / x) for x in free), rel=1e-9)
    for name, true in centres.items():
        wanted = [float(x) for x in true]
        assert answer["centres"][name] == pytest.approx(wanted, rel=100 * known, abs=known), name


def test_eigenscrews_of_the_arm_that_is_nearly_singular():
    """UR5, wrist_2 = 1e-6: sixty digits give -13632.0 and 13797.3 beside -1.1e11 and 3.0e10."""
    elastic = cartstiff.load("ur5")
    answer = analyse_posture(cartstiff.analyse(elastic, {"wrist_2_joint": 1e-6}))
    values = [s["eigenvalue"] for s in answer["eigenscrews"]["screws"]]
    assert values[2:4] == pytest.approx([-13632.0, 13797.3], rel=1e-5)
    assert [values[0], values[5]] == pytest.approx([-1.1e11, 3.0e10], rel=0.04)
