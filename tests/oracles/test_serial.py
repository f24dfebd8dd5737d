"""Serial arms against derivatives of the wrench field taken in 60-digit arithmetic.

The wrench that holds the arm is W(q) = J^-T grad Phi. Its components in the moving frame, followed
along a motion of that frame, are K^A by definition: K^A = (dW/dq) J^-1.
"""

from __future__ import annotations

import mpmath as mp
import numpy as np
import pytest
from tests.doors import Chain, plain_tree
from tests.support import (
    absolute_error,
    adjoint_reference,
    body_jacobian,
    frame_pose,
    gradient_of,
    joint_springs,
    loaded_arm,
    matrices_from,
    random_pose,
    relative_error,
    twist_matrix,
)

from cartstiff import ElasticMechanism, analyse

# Condition numbers of the sampled arms are below a few hundred.
MATRIX = 1e-12
KINEMATIC = 1e-13
# Eighth-order differences of a Jacobian of unit size, step 0.01.
DIFFERENCES = 1e-11


def _motion(kind: str, axis, value):
    """Displacement of one joint, in exact arithmetic."""
    M = mp.eye(4)
    if kind in "RH":
        W = mp.matrix(twist_matrix([*axis, 0, 0, 0])[:3, :3].tolist())
        R = mp.eye(3) + mp.sin(value) * W + (1 - mp.cos(value)) * W * W
        M[:3, :3] = R
    share = {"R": 0, "P": 1, "H": mp.mpf(0.17)}[kind]
    for r in range(3):
        M[r, 3] = share * value * mp.mpf(float(axis[r]))
    return M


def _exact(kinds, model, q, k, rest):
    """J, W, K^A, Hess Phi carried by J: with steps far below what double precision can see."""
    with mp.workdps(60):
        inner, outer = mp.mpf(10) ** -18, mp.mpf(10) ** -10
        placements = [
            mp.matrix(model.jointPlacements[i + 1].homogeneous.tolist()) for i in range(6)
        ]
        axes = [np.array(model.joints[i + 1].extract().axis) for i in range(6)]
        tip = mp.matrix(model.frames[model.getFrameId("tip")].placement.homogeneous.tolist())
        k = [mp.mpf(float(x)) for x in k]
        rest = [mp.mpf(float(x)) for x in rest]

        def pose(x):
            T = mp.eye(4)
            for i in range(6):
                T = T * placements[i] * _motion(kinds[i], axes[i], x[i])
            return T * tip

        def rigid_inverse(T):
            M = mp.eye(4)
            R = T[:3, :3].T
            M[:3, :3] = R
            p = R * T[:3, 3]
            for r in range(3):
                M[r, 3] = -p[r]
            return M

        def jacobian(x):
            inverse = rigid_inverse(pose(x))
            J = mp.zeros(6, 6)
            for a in range(6):
                plus, minus = list(x), list(x)
                plus[a] += inner
                minus[a] -= inner
                m = inverse * (pose(plus) - pose(minus)) / (2 * inner)
                for r, v in enumerate((m[2, 1], m[0, 2], m[1, 0], m[0, 3], m[1, 3], m[2, 3])):
                    J[r, a] = v
            return J

        def wrench(x):
            g = mp.matrix([k[a] * (x[a] - rest[a]) for a in range(6)])
            return mp.lu_solve(jacobian(x).T, g)

        x0 = [mp.mpf(float(v)) for v in q]
        J = jacobian(x0)
        dW = mp.zeros(6, 6)
        for b in range(6):
            plus, minus = list(x0), list(x0)
            plus[b] += outer
            minus[b] -= outer
            column = (wrench(plus) - wrench(minus)) / (2 * outer)
            for r in range(6):
                dW[r, b] = column[r]
        A = J**-1
        numbers = [J, wrench(x0), dW * A, A.T * mp.diag(k) * A]
        J, W, K, F = (np.array(m.tolist(), float) for m in numbers)
        return J, W[:, 0], K, F


@pytest.mark.parametrize(("kinds", "seed"), [("RRRRRR", 1), ("RHRPRR", 3), ("PPPRRR", 4)])
def test_six_joints(kinds, seed):
    arm = loaded_arm(kinds, seed)
    springs = arm.elastic.springs
    J, W, K_A, K_F = _exact(kinds, arm.model, arm.q, springs.stiffness, springs.rest)
    result = analyse(arm.elastic)
    assert relative_error(result.jacobian, J) <= KINEMATIC
    assert relative_error(result.wrench, W) <= MATRIX
    assert relative_error(result.wrench, arm.wrench) <= MATRIX
    for name, K in matrices_from(K_A, W).items():
        assert relative_error(result.tensor(name).matrix, K) <= MATRIX, name
    assert relative_error(result.matrices["F"], K_F) <= MATRIX


@pytest.mark.parametrize("seed", [21, 22])
def test_frame_with_offset(seed):
    """The offset moves the body frame, in kinematics and in the wrench field."""
    rng = np.random.default_rng(seed)
    h = random_pose(rng, 0.5)
    plain, moved = loaded_arm("RRRPRR", seed), loaded_arm("RRRPRR", seed, offset=h)
    T = frame_pose(plain.model, plain.q, "tip") @ h
    J = np.linalg.inv(adjoint_reference(h)) @ body_jacobian(plain.model, plain.q, "tip")
    result = analyse(moved.elastic)
    assert relative_error(result.pose, T) <= KINEMATIC
    assert relative_error(result.jacobian, J) <= KINEMATIC

    springs = moved.elastic.springs

    def wrench(d):
        q = moved.q + d
        J = np.linalg.inv(adjoint_reference(h)) @ body_jacobian(plain.model, q, "tip")
        return np.linalg.solve(J.T, springs.stiffness * (q - springs.rest))

    K_A = gradient_of(wrench, np.ones(6)) @ np.linalg.inv(J)
    W = wrench(np.zeros(6))
    for name, K in matrices_from(K_A, W).items():
        # Differences of a wrench field whose size exceeds K's by the condition of J.
        assert relative_error(result.tensor(name).matrix, K) <= 1e-9, name


@pytest.mark.parametrize("kinds", ["RRRRRR", "RPHRRP", "RRRRRRRR", "PRR"])
def test_curvature_is_the_symmetrised_derivative_of_the_jacobian(kinds):
    """S_W = sym(W . dJ) for every wrench, against differences of Pinocchio's Jacobian."""
    rng = np.random.default_rng(8)
    arm = loaded_arm(kinds, 8)
    motion = arm.elastic.mechanism.at(arm.q).motion
    n = len(kinds)
    assert relative_error(motion.jacobian, body_jacobian(arm.model, arm.q, "tip")) <= KINEMATIC
    dJ = gradient_of(lambda d: body_jacobian(arm.model, arm.q + d, "tip"), np.ones(n))
    for _ in range(3):
        W = rng.normal(size=6)
        expected = np.einsum("k,kab->ab", W, dJ)
        expected = 0.5 * (expected + expected.T)
        got = motion.curvature(W)
        assert absolute_error(got, expected) <= DIFFERENCES * max(1.0, np.abs(expected).max())


def test_curvature_between_two_branches():
    """A path that climbs one branch and descends another."""
    arm = loaded_arm("RRPR", 31)
    model = arm.model
    rng = np.random.default_rng(32)
    import pinocchio as pin
    from tests.support import add_frame

    parent = model.getJointId("j2")
    for name in ("k1", "k2"):
        axis = rng.normal(size=3)
        joint = pin.JointModelRevoluteUnaligned(axis / np.linalg.norm(axis))
        parent = model.addJoint(parent, joint, pin.SE3(random_pose(rng, 0.4)), name)
    add_frame(model, "other", parent, random_pose(rng, 0.2))
    chain = Chain(plain_tree(model), "tip")
    q = rng.uniform(-1, 1, 6)
    for a, b in (("other", "body"), ("body", "other"), ("other", "world"), ("tip", "tip")):
        T_a_b, to_pose = chain.at(q).relative(a, b)

        def pose(x, a=a, b=b):
            T_a, T_b = (
                np.eye(4) if f == "world" else frame_pose(model, x, "tip" if f == "body" else f)
                for f in (a, b)
            )
            return np.linalg.inv(T_a) @ T_b

        def jacobian(d, a=a, b=b):
            T = pose(q + d, a, b)
            inverse = np.linalg.inv(T)
            dT = gradient_of(lambda e: pose(q + d + e, a, b), np.ones(6))
            columns = [inverse @ dT[..., i] for i in range(6)]
            return np.stack([[m[2, 1], m[0, 2], m[1, 0], *m[:3, 3]] for m in columns], axis=1)

        assert absolute_error(T_a_b, pose(q)) <= KINEMATIC
        assert absolute_error(to_pose.jacobian, jacobian(np.zeros(6))) <= DIFFERENCES
        W = rng.normal(size=6)
        dJ = np.einsum("k,kab->ab", W, gradient_of(jacobian, np.ones(6)))
        # Two nested differences.
        assert absolute_error(to_pose.curvature(W), 0.5 * (dJ + dJ.T)) <= 1e-9


def test_joint_springs_at_rest_give_the_classical_matrix():
    """Unloaded, every connection gives J^-T Kq J^-1."""
    arm = loaded_arm("RRRRRR", 9, load=0.0)
    rng = np.random.default_rng(9)
    springs = joint_springs(6, rng, arm.q, np.zeros(6))
    elastic = ElasticMechanism("arm", arm.elastic.mechanism, arm.q, springs)
    A = np.linalg.inv(body_jacobian(arm.model, arm.q, "tip"))
    expected = A.T @ np.diag(springs.stiffness) @ A
    result = analyse(elastic)
    for K in result.matrices.values():
        assert relative_error(K, expected) <= MATRIX
