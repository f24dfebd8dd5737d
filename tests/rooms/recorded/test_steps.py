"""Steps recorded once are those of the core: poses, closures, struts, bent links."""

from __future__ import annotations

import pickle
from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.docs.blocks import ROOT
from tests.doors import JointPoses, Section, error_of_soft_directions, numerics
from tests.inner import (
    PLAIN,
    Assembler,
    Closer,
    QuickPoses,
    cartesian,
    holds_soft_directions,
    kernels,
    segments_of_many,
    strut_states,
)
from tests.laws.test_led_postures import CLOSE
from tests.laws.test_many_closed_chains import ASSEMBLED, starts
from tests.laws.test_many_struts import hexapod, postures
from tests.laws.test_program import LOAD, close, later
from tests.laws.test_program import postures as away
from tests.support import absolute_error

import cartstiff
from cartstiff import ConvergenceError, analyse_many
from cartstiff.extend import Beam
from cartstiff.geometry import se3
from cartstiff.maps import Axis, CartesianGrid, Grid

COUNT = 300


@pytest.mark.parametrize("robot", ["ur5", "panda"])
def test_errors_steps_and_solutions_are_those_of_numpy(robot):
    elastic = cartstiff.load(robot)
    plain, quick = JointPoses(elastic), QuickPoses(elastic)
    rng = np.random.default_rng(0)
    q = plain.random_starts(COUNT, rng)
    T = plain.kinematics.at(plain.random_starts(COUNT, rng)).pose
    here = plain.kinematics.at(q).pose
    # Near no turn, and near half a turn, where the rotation vector has no derivative.
    T[:20] = here[:20] @ se3.exp(rng.normal(scale=1e-8, size=(20, 6)))
    half = np.zeros((20, 6))
    short_of_half = np.pi - 10.0 ** rng.uniform(-9, -1, (20, 1))
    half[:, :3] = short_of_half * np.eye(3)[rng.integers(3, size=20)]
    T[20:40] = here[20:40] @ se3.exp(half)
    (e, J), (e_quick, J_quick) = (solver._errors(q, T, "none") for solver in (plain, quick))
    assert absolute_error(e, e_quick) < 1e-11
    assert absolute_error(J, J_quick) < 1e-14
    mu = rng.uniform(0.01, 1.0, COUNT)
    edge = np.clip(q + rng.normal(scale=2.0, size=q.shape), plain.lower, plain.upper)
    assert (edge == plain.lower).any()
    assert (edge == plain.upper).any()
    for solver in ((plain, quick), (plain.unwound(), quick.unwound())):
        first, second = (each._step(edge, e, J, mu) for each in solver)
        # At the end of a search little damping is left to hold joints apart that do the same.
        assert np.abs(first - second)[20:].max() < 1e-10
    (found, good), (found_quick, good_quick) = (s.solve(T, q) for s in (plain, quick))
    assert good.any()
    assert (good == good_quick).all()
    assert np.abs(found - found_quick)[good].max() < 1e-6


def test_other_searches_are_left_to_numpy():
    elastic = cartstiff.load("panda")
    plain, quick = JointPoses(elastic), QuickPoses(elastic)
    q = plain.random_starts(20, np.random.default_rng(0))
    T = plain.kinematics.at(q[::-1]).pose
    for options in ({"free": "z"}, {"held": np.arange(7) == 2}):
        for a, b in zip(plain.solve(T, q, **options), quick.solve(T, q, **options), strict=True):
            np.testing.assert_allclose(a, b, atol=1e-8)


def test_a_map_has_the_same_branches_either_way(monkeypatch):
    elastic = cartstiff.load("ur5")

    def grid():
        return CartesianGrid({"x": Axis(0.2, 0.6, 3), "z": Axis(0.1, 0.9, 3)}, elastic, elastic.q)

    box = tuple(slice(0, n) for n in grid().shape)
    expected, count = grid().solve(box, elastic)
    monkeypatch.setattr(cartesian, "WORTH_COMPILING", 1)
    quick = grid()
    found, count_quick = quick.solve(box, elastic)
    assert (count == count_quick).all()
    assert count.max() >= 4
    np.testing.assert_allclose(found, expected, atol=1e-8)
    # Machine code stays behind where the sampling goes to another process.
    assert pickle.loads(pickle.dumps(quick)).to_dict() == quick.to_dict()


SECTIONS = {
    "no shear": Section(1.4e8, 1e5, (1.4e5, 0.7e5)),
    "shear": Section(1.4e8, 1e5, (1.4e5, 0.7e5), (2.0e7, 3.0e7)),
}


@pytest.mark.parametrize("section", SECTIONS)
@pytest.mark.parametrize("compiled", [False, True])
@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 2**31), size=st.floats(-9.0, 0.0))
def test_segments(section, compiled, seed, size):
    """Recorded segments are those of the engine, where their series reach and beyond."""
    beams = [
        Beam(np.arange(6), 0.4, SECTIONS[section]),
        Beam(np.arange(6, 18), 0.4, SECTIONS[section]),
    ]
    q = np.random.default_rng(seed).uniform(-1.0, 1.0, (3, 18)) * 10.0**size
    q[:, 2::6] *= 0.01
    energies, gradients, hessians = segments_of_many(beams, q, compiled)
    parts = [beam.segments(q[:, beam.indices].reshape(-1, 6)) for beam in beams]
    expected = sum(part[0].reshape(3, -1).sum(axis=1) for part in parts)
    np.testing.assert_allclose(energies, expected, rtol=1e-11)
    for found, k in ((gradients, 1), (hessians, 2)):
        shape = (3, -1, *found.shape[2:])
        each = np.concatenate([part[k].reshape(shape) for part in parts], axis=1)
        size_of = np.abs(each).max(axis=tuple(range(2, each.ndim)), keepdims=True)
        assert np.all(np.abs(found - each) <= 1e-12 * size_of)


def test_recorded_steps_are_the_search():
    elastic = hexapod()
    q = postures(elastic, 0.02, 60)
    poses = se3.from_roll_pitch_yaw(q[:, :3], q[:, 3:]) @ elastic.mechanism.T_P_M
    gradients = np.random.default_rng(1).normal(size=(60, 6)) * [0.1, 0.1, 0.1, 10, 10, 10]
    found, is_known = strut_states(elastic.springs, poses, gradients, True)
    expected = elastic.springs.many(poses, gradients, True)
    assert is_known.mean() > 0.9
    for name, digits in (
        ("energy", 1e-10),
        ("wrench", 1e-8),
        ("stiffness", 1e-11),
        ("rest_length", 1e-12),
    ):
        a, b = getattr(found, name), getattr(expected, name)[is_known]
        np.testing.assert_allclose(a, b, rtol=0, atol=digits * np.abs(b).max(), err_msg=name)


def test_legs_on_a_base_that_gives_are_left_to_their_own_search(tmp_path):
    """Also those without flexures, of which machine code of struts makes nothing."""
    text = (ROOT / "robots" / "stewart-gough.yaml").read_text("utf-8")
    rows = np.diag([1e5] * 3 + [1e7] * 3).tolist()
    file = tmp_path / "mounted.yaml"
    file.write_text(f"{text}\nflexible: {{base: {{stiffness: {rows}}}}}\n", "utf-8")
    elastic = cartstiff.load(file)
    q = elastic.q + 0.01 * np.arange(2)[:, None]
    found, expected = (analyse_many(elastic, q, path=way) for way in ("compiled", "portable"))
    assert (found.path, expected.path) == ("compiled", "portable")
    np.testing.assert_allclose(found.B, expected.B, rtol=0, atol=1e-12 * np.abs(expected.B).max())


def of_mixed_signs(seed: int, count: int = 2000) -> tuple[np.ndarray, np.ndarray]:
    """Stiffnesses of arms near singularities whose Hessians are of either sign; and compliances."""
    rng = np.random.default_rng(seed)
    U, values, V = np.linalg.svd(rng.normal(size=(count, 6, 6)))
    values[:, 5] *= 10.0 ** rng.uniform(-7, -2, count)
    values[:, 4] *= 10.0 ** rng.uniform(-3, 0, count)
    sizes = 10.0 ** rng.uniform(-3, 3, (count, 6, 1))
    J = U @ (values[:, :, None] * V)
    A = V.swapaxes(1, 2) @ (U.swapaxes(1, 2) / values[:, :, None])
    H = rng.normal(size=(count, 6, 6)) * 10.0 ** rng.uniform(-3, 1, (count, 1, 1))
    H = H + H.swapaxes(1, 2) + np.eye(6)
    K, C = A.swapaxes(1, 2) @ H @ A, J @ np.linalg.inv(H) @ J.swapaxes(1, 2)
    outer = sizes * sizes.swapaxes(1, 2)
    return (K + K.swapaxes(1, 2)) / 2 * outer, (C + C.swapaxes(1, 2)) / 2 / outer


@pytest.mark.parametrize("seed", range(3))
def test_the_verdict_is_on_the_safe_side_and_rarely_needless(seed):
    matrices, inverses = of_mixed_signs(seed)
    errors = np.array([*map(error_of_soft_directions, matrices, inverses)])
    with np.errstate(all="ignore"):  # a pivot may vanish: that is one of the doubts
        verdicts = np.array([holds_soft_directions(K, ["stiffness_B"]) for K in matrices])
    assert not np.any((verdicts == PLAIN) & (errors > numerics.LOST_ERROR))
    clear = errors < numerics.LOST_ERROR / 3
    assert clear.sum() > len(clear) // 4
    assert np.count_nonzero(verdicts[clear] != PLAIN) <= clear.sum() // 100


def test_more_motors_than_motions_far_from_home():
    """They are let go where they cannot all stay: on the tape, too, but not for maps."""
    elastic = cartstiff.load("4-rrr")
    q = starts(elastic, 0.6, 24)
    found, engine = (analyse_many(elastic, q, path=path) for path in ("portable", "engine"))
    assert found.fallback <= 1
    assert absolute_error(found.q, engine.q) <= 100 * ASSEMBLED
    assert not Closer(elastic, compiled=False)(q)[1].any()


def test_closed_alone():
    """As maps close chains before they read them; what is held stays where it is."""
    elastic = cartstiff.load("3-rps")
    q = starts(elastic, count=4)
    q[2, elastic.mechanism.held[0]] += 5.0  # out of reach
    found, is_closed, is_vain = Closer(elastic, compiled=False)(q)
    np.testing.assert_array_equal(is_vain, ~is_closed)
    np.testing.assert_array_equal(is_closed, [True, True, False, True])
    np.testing.assert_array_equal(found[2], q[2])
    np.testing.assert_array_equal(found[:, elastic.mechanism.held], q[:, elastic.mechanism.held])
    for i in (0, 1, 3):
        closed = elastic.mechanism.closed(q[i]).q
        assert absolute_error(found[i], closed) <= ASSEMBLED


@pytest.mark.parametrize(
    ("name", "span", "count", "least"),
    [("five-bar", 1.0, 21, 344), ("delta", 1.0, 7, 343), ("3-rrr", 1.0, 5, 50)],
)
def test_cells_of_a_grid_move_little_from_one_to_the_next(name, span, count, least):
    """No step of a coordinate is out of proportion to the motors': nobody changed the assembly."""
    elastic = cartstiff.load(name)
    motors = list(elastic.mechanism.actuated)
    values = [np.linspace(elastic.q[j] - span, elastic.q[j] + span, count) for j in motors]
    assembler = Assembler(elastic, elastic.q, motors)
    shape = (count,) * len(motors)
    q, is_closed = assembler.grid(values, motors, [slice(0, count)] * len(motors))
    assert is_closed.sum() >= least
    places = np.array([elastic.mechanism.at(row).pose[:3, 3] for row in q]).reshape(*shape, 3)
    there = is_closed.reshape(shape)
    step, unit = 2 * span / (count - 1), elastic.mechanism.at(elastic.q).length
    for axis in range(len(motors)):
        both = np.take(there, range(1, count), axis) & np.take(there, range(count - 1), axis)
        moved = np.linalg.norm(np.diff(places, axis=axis), axis=-1)[both]
        assert moved.max() < 5 * step * unit
    # Any box gives the same numbers, and so does the engine, asked for the motors alone.
    half = count // 2
    for box in product((slice(0, half), slice(half, count)), repeat=len(motors)):
        part, shut = assembler.grid(values, motors, box)
        np.testing.assert_array_equal(shut, there[box].ravel())
        inside = q.reshape(*shape, -1)[box].reshape(len(part), -1)
        np.testing.assert_array_equal(part[shut], inside[shut])
    rng = np.random.default_rng(0)
    for i in rng.choice(np.flatnonzero(is_closed), 12, replace=False):
        given = {elastic.names[j]: q[i, j] for j in motors}
        np.testing.assert_allclose(cartstiff.analyse(elastic, given).q, q[i], atol=CLOSE)


def test_all_ways_lead_to_the_same_posture():
    """The engine, recorded steps, a program, and a map."""
    elastic = cartstiff.load("delta")
    motors = list(elastic.mechanism.actuated)
    rng = np.random.default_rng(1)
    q = np.tile(elastic.q, (110, 1))
    q[:, motors] += rng.uniform(-1.0, 1.0, (110, 3))
    engine = np.array([elastic.mechanism.closed(row).q for row in q[:25]])
    many = cartstiff.analyse_many(elastic, q)
    assert many.fallback < 5
    np.testing.assert_allclose(many.q[:25], engine, atol=CLOSE)
    single = Assembler(elastic, elastic.q, []).together(q)
    assert single[1].all()
    np.testing.assert_allclose(single[0], many.q, atol=CLOSE)
    program = cartstiff.record(elastic, "pose")
    one = np.array([program(row).q for row in q])
    np.testing.assert_allclose(one, many.q, atol=CLOSE)


def test_where_motors_cannot_go_the_others_give_way_as_before():
    elastic = cartstiff.load("five-bar")
    far = elastic.q.copy()
    far[0] += 3.0
    assert Assembler(elastic, elastic.q, [0]).led(far[None])[1].sum() == 0
    try:
        q = elastic.mechanism.closed(far).q
    except ConvergenceError:
        return
    assert np.abs(elastic.mechanism.at(q).residual).max() < CLOSE


def test_a_cell_without_a_straight_way_starts_from_the_one_beside_it():
    """Somewhere a grid reaches what the straight line from home does not."""
    elastic = cartstiff.load("five-bar")
    motors = list(elastic.mechanism.actuated)
    grid = Grid(
        {elastic.names[j]: (elastic.q[j] - 2.5, elastic.q[j] + 2.5, 61) for j in motors},
        elastic.names,
        elastic.q,
    )
    assembler = Assembler(elastic, elastic.q, motors)
    box = (slice(0, 61), slice(0, 61))
    _, straight = assembler.led(grid.postures(box))
    q, is_closed = assembler.grid(grid.values, motors, box)
    assert (is_closed | ~straight).all()
    assert is_closed.sum() > straight.sum()
    for row in q[is_closed & ~straight]:
        assert np.abs(elastic.mechanism.at(row).residual).max() < CLOSE


@pytest.mark.parametrize("name", ["6-pus", *later("flexible_arm")])
def test_many_take_the_steps_of_a_call(name):
    """Chains are closed and links bent by the code of the program: no other is made."""
    example = ROOT / "examples" / f"{name}.yaml"
    elastic = cartstiff.load(example if example.exists() else name)
    is_loaded = name == "flexible_arm"
    program = cartstiff.record(elastic, ["B", "pose"], loaded=is_loaded)
    Q, load = away(elastic, 6, 0.02), [LOAD] * is_loaded
    Q[:, sorted(elastic.mechanism.virtual)] = 0.0
    kernels._made.clear()
    many = program.many(Q, *load)
    assert not kernels._made
    assert many.path == "compiled"
    for i, q in enumerate(Q):
        answer = program(q, *load)
        close(many.q[i], answer.q, 1e-11)
        close(many.B[i], answer["B"])
    assert f"{many.fallback} by the engine" in repr(many) or not many.fallback
