"""The arithmetic written once: folding, sharing, and every way to run it gives the same numbers."""

from __future__ import annotations

import ctypes
from dataclasses import replace

import mpmath
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tests.inner import (
    CompiledKernel,
    ForceField,
    Kinematics,
    Number,
    PortableKernel,
    PrintedPosture,
    Tape,
    adjoint,
    aligned_empty,
    cosine,
    deflection_for,
    inverse,
    kernels,
    plan,
    positive_factor,
    product,
    program_for,
    reflections,
    rotation_vector,
    sine,
    solution,
)
from tests.inner import algebra_congruence as congruence
from tests.laws.test_many_engine import FALLING, STRAIGHT, TABLE

import cartstiff
from cartstiff import analyse_many

OPTIMISED = True
OUTPUTS = ("jacobian", "wrench", "energy", "stiffness_A", "stiffness_F")
#: The same operations, fused or not: rounding errors times the condition of ordinary postures.
FUSED = 1e-11


def run(kernel, inputs, count, **options):
    outputs = {name: aligned_empty(count, len(s)) for name, s in kernel.program.outputs.items()}
    kernel.run(inputs, outputs, count, **options)
    return outputs


def ur5(count: int = 37):
    elastic = cartstiff.load("ur5").with_springs(rest=[0.1, -0.4, 0.3, 0.2, 0.5, -0.6])
    q = np.random.default_rng(2).uniform(-1.5, 1.5, (count, 6))
    taken = plan(elastic)
    return elastic, q, program_for(taken.case, OUTPUTS), {**taken.shared, "q": q}


class TestTape:
    def test_constants_are_folded_and_repetitions_shared(self):
        tape = Tape()
        x, y = tape.input("a", 0), tape.input("a", 1)
        assert x * 0 == 0.0
        assert x - x == 0.0
        assert (x * 1).step == (x + 0).step == (x.__neg__().__neg__()).step == x.step
        assert (x * y + 2).step == (y * x + 2).step
        assert (x - (-y)).step == (y + x).step
        program = tape.program({"out": np.array([x * y, 3.0, x * y], object)}, [])
        assert program.size == 1

    def test_what_no_output_needs_is_left_out(self):
        _, _, everything, _ = ur5()
        taken = plan(cartstiff.load("ur5").with_springs(rest=[0.1] * 6))
        sizes = [program_for(taken.case, o).size for o in ((), ("wrench",), ("stiffness_B",))]
        assert sizes == sorted(sizes)
        assert sizes[-1] < everything.size

    def test_operations_keep_their_order(self):
        """But for those that only complete an output: they follow what they read."""
        tape = Tape()
        x, y = tape.input("a", 0), tape.input("a", 1)
        first, second = x * y, x / y
        third = second * second
        program = tape.program({"out": np.array([third, first + y, third + x], object)}, [])
        names = [o.name for o in program.operations if o.name not in ("input", "constant")]
        assert names == ["mul", "add", "div", "mul", "add"]

    def test_equal_outputs_have_one_place_in_a_record(self):
        """Without a load K^A, K^B and K^K are the same numbers, which are written once."""
        tape = Tape()
        x = tape.input("a", 0)
        outputs = {"A": np.array([x * x, 2.0], object), "B": np.array([x * x, 2.0], object)}
        printed = PrintedPosture(tape.program({**outputs, "c": np.array([x], object)}, []), {})
        assert printed.at == {"A": slice(0, 2), "B": slice(0, 2), "c": slice(2, 3)}
        assert printed.record(a=np.array([3.0])).tolist() == [9.0, 2.0, 3.0]

    def test_a_float_may_stand_for_a_number(self):
        assert sine(0.5) == np.sin(0.5)
        assert isinstance(cosine(Tape().input("a", 0)), Number)


@pytest.mark.parametrize(
    ("name", "is_loaded", "operations"),
    [
        ("ur5", False, 1285),
        ("ur5", True, 1747),
        ("panda", False, 2410),
        ("panda", True, 2936),
        ("stewart-gough", False, 3032),
        ("stewart-gough", True, 3110),
        ("6-ups", False, 6557),
        ("6-ups", True, 15127),
    ],
)
def test_programs_do_not_grow(name, is_loaded, operations):
    """A tenth more operations than these are too many."""
    taken = plan(cartstiff.load(name), is_loaded)
    outputs = "jacobian", "wrench", *(f"stiffness_{c}" for c in "ABKF")
    assert program_for(taken.case, outputs).size <= 1.1 * operations


class TestAlgebra:
    """On plain floats; the numbers of a tape go the same way."""

    def test_inverse(self):
        rng = np.random.default_rng(0)
        for n in (1, 2, 5, 6):
            M = rng.normal(size=(n, n)) * 10.0 ** rng.integers(-3, 4, n)
            product = M @ inverse(M.astype(object)).astype(float)
            np.testing.assert_allclose(product, np.eye(n), atol=1e-11)

    def test_inverse_needs_no_pivots(self):
        exchange = np.eye(6)[[5, 0, 3, 1, 4, 2]]
        np.testing.assert_allclose(inverse(exchange.astype(object)).astype(float), exchange.T)

    def test_reflections(self):
        rng = np.random.default_rng(1)
        M, H = rng.normal(size=(8, 6)), rng.normal(size=(8, 8))
        H = H + H.T
        found = reflections(M.astype(object))
        Q = found.apply(np.eye(8).astype(object)).astype(float)
        np.testing.assert_allclose(Q.T @ Q, np.eye(8), atol=1e-14)
        np.testing.assert_allclose(Q[:, :6] @ found.R.astype(float), M, atol=1e-14)
        np.testing.assert_allclose(found.conjugate(H).astype(float), Q.T @ H @ Q, atol=1e-13)
        np.testing.assert_allclose(congruence(Q, H).astype(float), Q.T @ H @ Q, atol=1e-13)

    def test_product(self):
        rng = np.random.default_rng(3)
        M, N = rng.normal(size=(3, 5)), rng.normal(size=(5, 2))
        np.testing.assert_allclose(product(M, N).astype(float), M @ N, atol=1e-14)

    @pytest.mark.parametrize("varying", [(), (0,), (1, 4), (0, 1, 2, 3, 4, 5)])
    def test_solution(self, varying):
        """Columns of constants are eliminated, others reflected, and zeros cost nothing."""
        rng = np.random.default_rng(4)
        zeros = np.array(
            [
                [1, 1, 0, 1, 0, 0],
                [1, 0, 1, 1, 0, 1],
                [0, 1, 0, 1, 0, 1],
                [1, 0, 0, 1, 1, 1],
                [0, 1, 0, 0, 0, 1],
                [1, 1, 1, 1, 0, 0],
            ]
        )
        right = rng.normal(size=(6, 2))
        sizes = []
        for pattern in (zeros, np.ones((6, 6))):
            M = rng.normal(size=(6, 6)) * pattern
            tape = Tape()
            recorded = M.astype(object)
            for j in varying:
                for i in np.flatnonzero(pattern[:, j]):
                    recorded[i, j] = tape.input("M", 6 * int(i) + j)
            X = solution(recorded, right.astype(object))
            program = tape.program({"X": X}, [])
            found = run(PortableKernel(program), {"M": M.reshape(1, 36)}, 1)["X"].reshape(6, 2)
            bound = 1e-14 * np.linalg.cond(M) * np.abs(found).max()
            np.testing.assert_allclose(found, np.linalg.solve(M, right), atol=bound)
            sizes.append(program.size)
        assert sizes[0] < sizes[1] or not varying

    def test_solution_two_by_two(self):
        """Columns in pairs: no square root is taken, and no digit lost to what couples them."""
        rng = np.random.default_rng(5)
        pairs = np.array(
            [
                [1, 0, 0, 1, 0, 0],
                [1, 0, 0, 1, 0, 0],
                [1, 1, 1, 0, 0, 0],
                [0, 1, 1, 1, 0, 0],
                [0, 1, 0, 0, 1, 1],
                [1, 0, 0, 1, 1, 1],
            ]
        )
        M = rng.normal(size=(6, 6)) * pairs * 10.0 ** rng.integers(-3, 4, (6, 1))
        tape = Tape()
        recorded = M.astype(object)
        for i, j in np.argwhere(pairs):
            recorded[i, j] = tape.input("M", 6 * int(i) + int(j))
        program = tape.program({"X": inverse(recorded)}, [])
        assert "sqrt" not in {o.name for o in program.operations}
        found = run(PortableKernel(program), {"M": M.reshape(1, 36)}, 1)["X"].reshape(6, 6)
        np.testing.assert_allclose(found @ M, np.eye(6), atol=1e-13 * np.linalg.cond(M))

    @pytest.mark.parametrize("kind", ["a row of zeros", "two like columns", "constants"])
    def test_what_has_no_solution(self, kind):
        """In any posture: numbers that are none, and no error."""
        tape = Tape()
        x = tape.input("M", 0)
        rows = {
            "a row of zeros": [[x, 2.0], [0.0, 0.0]],
            "two like columns": [[x, x], [2.0, 2.0]],
            "constants": [[1.0, 2.0], [2.0, 4.0]],
        }
        M = np.array(rows[kind], object)
        program = tape.program({"X": solution(M, np.eye(2).astype(object))}, [])
        found = run(PortableKernel(program), {"M": np.ones((1, 1))}, 1)["X"]
        assert np.isnan(found).any()

    def test_positive_factor(self):
        rng = np.random.default_rng(2)
        M = rng.normal(size=(5, 5))
        M = M @ M.T
        L, inverses, pivots = positive_factor(M.astype(object))
        L = L.astype(float)
        np.testing.assert_allclose(L / inverses.astype(float) @ L.T, M, atol=1e-13)
        np.testing.assert_allclose((pivots * inverses).astype(float), 1.0, rtol=1e-15)


@pytest.mark.parametrize("name", ["ur5", "five-bar", "delta"])
def test_any_frame_of_the_twists(name):
    """F, that of any joint, and M: poses, twists, wrenches and what joints carry are the same."""
    elastic, rng = cartstiff.load(name), np.random.default_rng(9)
    constants = plan(elastic).case.constants
    joints = len(constants.parents)
    q = elastic.q + rng.uniform(-0.3, 0.3, joints)
    points = tuple(map(tuple, rng.normal(size=(joints, 3)).tolist()))
    field, W = ForceField(tuple(rng.uniform(0, 2, joints).tolist()), points), rng.normal(size=6)
    expected = elastic.mechanism.at(q)
    found = []
    for start in range(joints + 2):
        if start not in (0, joints + 1) and start - 1 not in constants.support(constants.carrier):
            continue
        tree = Kinematics(constants, q.astype(object), (field,), start)
        T_F_C = np.eye(4)
        T_F_C[:3, :3] = tree.R_C_F.T
        T_F_C[:3, 3] = -tree.R_C_F.T @ tree.p_C_F
        np.testing.assert_allclose(tree.pose().astype(float), expected.pose, atol=1e-13)
        np.testing.assert_allclose(tree.J_M.astype(float), expected.motion.jacobian, atol=1e-13)
        ((mass, first),) = tree.beyond
        to_F, weights = adjoint(T_F_C), mass.astype(float)
        carried = first.astype(float) @ T_F_C[:3, :3].T + np.outer(weights, T_F_C[:3, 3])
        frames = tree.frames().astype(float)
        own = np.einsum("jab,jb->ja", frames[:, :, :3], points) + frames[:, :, 3]
        for a, behind in enumerate(tree.outward):
            parts = np.array(field.weights)[behind]
            assert weights[a] == pytest.approx(parts.sum())
            np.testing.assert_allclose(carried[a], parts @ own[behind], atol=1e-12)
        found.append(
            np.concatenate(
                [
                    (to_F @ tree.J.astype(float)).ravel(),
                    np.linalg.solve(to_F.T, tree.wrench(W).astype(float)),
                    weights,
                    carried.ravel(),
                    frames.ravel(),
                ]
            )
        )
    assert len(found) > 2
    np.testing.assert_allclose(found, np.tile(found[0], (len(found), 1)), atol=1e-12)


def test_sine_and_cosine_to_the_last_digit():
    """Against 40 digits, small and large angles, multiples of a quarter turn and their nearness."""
    tape = Tape()
    x = tape.input("q", 0)
    program = tape.program({"both": np.array([sine(x), cosine(x)], object)}, [])
    rng = np.random.default_rng(4)
    quarters = np.pi / 2 * np.arange(-40, 41)
    angles = np.concatenate(
        [
            rng.uniform(-7, 7, 400),
            rng.uniform(-1e6, 1e6, 400),
            10.0 ** rng.uniform(-300, 0, 50),
            quarters,
            np.nextafter(quarters, 9e9),
            np.pi / 2 * rng.integers(0, 600000, 100),
            [0.0],
        ]
    )
    found = run(CompiledKernel(program), {"q": angles[:, None]}, len(angles))["both"]
    with mpmath.workdps(40):
        exact = [[mpmath.sin(mpmath.mpf(a)), mpmath.cos(mpmath.mpf(a))] for a in angles.tolist()]
        units = [
            [
                abs((mpmath.mpf(f) - e) / np.spacing(abs(float(e))))
                for f, e in zip(*row, strict=True)
            ]
            for row in zip(found.tolist(), exact, strict=True)
        ]
    assert max(max(row) for row in units) < 2.0


class TestWaysToRun:
    @pytest.mark.parametrize("width", [2, 4, 8])
    @pytest.mark.parametrize("stream", [False, True])
    def test_vectors_of_any_length(self, width, stream, monkeypatch):
        """Also longer than this processor's, and past the cache."""
        if stream:
            monkeypatch.setattr("cartstiff.recorded.execution.STREAMED", 0)
        _, q, program, inputs = ur5()
        expected = run(PortableKernel(program), inputs, len(q))
        found = run(CompiledKernel(program, width), inputs, len(q))
        for name, array in expected.items():
            size = np.abs(array).max(axis=1, keepdims=True)
            assert (np.abs(found[name] - array) <= FUSED * size).all(), name

    def test_a_long_program_in_pieces(self, monkeypatch):
        """Cut into functions, it does the same operations."""
        _, q, program, inputs = ur5()
        expected = run(CompiledKernel(program), inputs, len(q))
        monkeypatch.setattr("cartstiff.recorded.vector_code.LONGEST", 300)
        monkeypatch.setattr("cartstiff.recorded.execution.STREAMED", 0)
        found = run(CompiledKernel(program), inputs, len(q))
        for name, array in expected.items():
            size = np.abs(array).max(axis=1, keepdims=True)
            assert (np.abs(found[name] - array) <= FUSED * size).all(), name

    def test_threads_share_the_blocks(self):
        """Each block is done once, by whichever thread is free; all give the same numbers."""
        _, _, program, inputs = ur5()
        count = 5003
        inputs["q"] = np.random.default_rng(6).uniform(-2, 2, (count, 6))
        kernel = CompiledKernel(program)
        one = run(kernel, inputs, count)
        outputs = {name: np.full_like(array, np.nan) for name, array in one.items()}
        for _ in range(20):
            kernel.run(inputs, outputs, count, threads=4)
            for name, array in one.items():
                np.testing.assert_array_equal(outputs[name], array)
                outputs[name][:] = np.nan

    def test_a_thread_that_comes_late_touches_nothing(self):
        _, _, program, _ = ur5()
        kernel = CompiledKernel(program)
        scratch = np.full(kernel.scratch, 7.0)
        none = ctypes.c_void_p()
        kernel.entry(False)(9, none, none, scratch.ctypes.data, (ctypes.c_int64 * 2)(9, 9))
        assert (scratch == 7.0).all()

    @pytest.mark.parametrize("path", ["portable", "compiled"])
    def test_threads_and_chunks_change_nothing(self, path):
        elastic, _, _, _ = ur5()
        q = np.random.default_rng(8).uniform(-2, 2, (4501, 6))
        one = analyse_many(elastic, q, outputs=OUTPUTS, path=path, threads=1)
        for options in ({"threads": 2, "chunk": 100}, {"threads": 3, "chunk": 7}, {"chunk": 5000}):
            if path == "portable" and options["chunk"] == 7:
                options = {"threads": 3, "chunk": 64}
            other = analyse_many(elastic, q, outputs=OUTPUTS, path=path, **options)
            for name in OUTPUTS:
                np.testing.assert_array_equal(other[name], one[name])
            np.testing.assert_array_equal(other.state, one.state)

    def test_other_springs_need_no_other_code(self):
        elastic, q, _, _ = ur5()
        analyse_many(elastic, q, path="compiled")
        before = dict(kernels._made)
        softer = elastic.with_springs(stiffness=10.0, rest=[0.5] * 6)
        found = analyse_many(softer, q, path="compiled")
        assert list(kernels._made.values()) == list(before.values())
        K = cartstiff.analyse(softer, q[0]).matrices["B"]
        np.testing.assert_allclose(found["stiffness_B"][0], K, rtol=1e-10, atol=1e-9)

    def test_plans_are_kept_while_nothing_can_change(self):
        elastic = cartstiff.load("ur5")
        assert plan(elastic) is plan(elastic)
        assert plan(elastic) is not plan(elastic, True)
        heavy = replace(elastic, gravity=np.array([0.0, 0.0, -9.81]))
        before = plan(heavy).shared["forces"].copy()
        heavy.gravity[2] = -1.6
        assert not np.array_equal(plan(heavy).shared["forces"], before)

    def test_few_postures_are_not_worth_compiling(self):
        elastic = cartstiff.load("ur10")
        q = np.random.default_rng(0).uniform(-1, 1, (20, 6))
        found = analyse_many(elastic, q, outputs=("jacobian", "compliance_K"))
        assert found.path == "portable"
        assert "compiling pays" in found.reason
        compiled = analyse_many(elastic, q, outputs=("compliance_K", "jacobian"), path="compiled")
        assert (compiled.path, compiled.reason) == ("compiled", "")
        # Once it is there it is used, for any number and whatever the order of names.
        assert analyse_many(elastic, q, outputs=("jacobian", "compliance_K")).path == "compiled"

    def test_without_llvmlite(self, monkeypatch):
        from cartstiff.core.errors import MissingDependencyError

        for module in ("kernels", "recording"):
            monkeypatch.setattr(f"cartstiff.recorded.{module}.has_package", lambda _: False)
        elastic, q, _, _ = ur5()
        found = analyse_many(elastic, q)
        assert found.path == "portable"
        assert "pip install 'cartstiff[maps]'" in found.reason
        with pytest.raises(MissingDependencyError, match="the compiled path needs"):
            analyse_many(elastic, q, path="compiled")


@pytest.mark.parametrize("law", [FALLING, TABLE, STRAIGHT])
def test_deflections_are_the_laws_own(law):
    """Over all torques: where the tape knows one, it is what the spring says."""
    torques = np.linspace(-45.0, 45.0, 4001)
    tape = Tape()
    x, verdict = deflection_for(law, tape.input("torque", 0))
    program = tape.program({"x": np.array([x, verdict], object)}, [])
    out = {"x": np.empty((len(torques), 2))}
    kernel = PortableKernel(program)
    kernel.run({"torque": torques[:, None]}, out, len(torques))
    known = out["x"][:, 1] == 0.0
    assert known.mean() > 0.6
    expected = [law.deflection_for(t) for t in torques[known]]
    np.testing.assert_allclose(out["x"][known, 0], expected, rtol=1e-10, atol=1e-15)


def test_rotation_vector():
    """Against SciPy, from none to near half a turn."""
    rng = np.random.default_rng(0)
    for angle in (0.0, 1e-9, 0.3, 1.5, 3.0):
        axis = rng.normal(size=3)
        vector = angle * axis / np.linalg.norm(axis)
        found, verdict = rotation_vector(Rotation.from_rotvec(vector).as_matrix().astype(object))
        np.testing.assert_allclose(found.astype(float), vector, rtol=0, atol=3e-14)
        assert verdict == 0.0
    assert rotation_vector(Rotation.from_rotvec([3.13, 0, 0]).as_matrix().astype(object))[1] == 1.0
