"""What machine code reads equals what is read from matrices, and doubtful postures are left to it.

The oracle is `evaluate` on the arrays of `analyse_many`: NumPy's LAPACK for eigenvalues.
"""

from copy import copy
from dataclasses import replace

import mpmath
import numpy as np
import pinocchio
import pytest
from tests.doors import Chain, LoadKind, Struts, numerics, plain_tree
from tests.inner import (
    FREQUENCIES,
    READINGS,
    MapJob,
    PortableKernel,
    Settings,
    Tape,
    ascending,
    choose_quantities,
    eigenvalues,
    eliminated,
    evaluate,
    frequency_name,
    kernels,
    largest_eigenvalue,
    loss_of_elimination,
    principal_values,
)
from tests.maps.machines import arm
from tests.support import serial_model
from tests.support.read import read as recorded
from tests.support.read import readable

import cartstiff
from cartstiff import ElasticMechanism, JointSprings, analyse_many, payload
from cartstiff.extend import QUANTITIES
from cartstiff.maps import RandomPostures, compute_map

LENGTH = 0.18
#: Rounding that two ways to a number may differ by, over the condition number of what is read.
ROUNDING = 1e-12


def _asked(connection: str, load: LoadKind, is_loaded: bool) -> Settings:
    return Settings(
        connection,
        LENGTH,
        (0.0, 0.6, 0.8),
        (1.0, 0.0, 0.0, 0.0, 20.0, -50.0),
        True,
        load,
        (0.1, 0.0, 0.0),
        is_loaded,
    )


@pytest.mark.parametrize(
    ("robot", "connection", "wrench", "load"),
    [
        ("ur5", "B", None, LoadKind()),
        ("ur5", "A", (1.0, 2.0, -1.0, 30.0, -20.0, 50.0), LoadKind()),
        ("ur5", "F", (1.0, 2.0, -1.0, 30.0, -20.0, 50.0), LoadKind()),
        ("panda", "load", (1.0, 2.0, -1.0, 30.0, -20.0, 50.0), LoadKind("dead", (0.0, 0.0, 0.1))),
    ],
)
def test_every_reading_is_the_quantity(robot, connection, wrench, load):
    elastic = cartstiff.load(robot)
    left_out = {*FREQUENCIES, "effort_margin", "largest_load"}  # those: test_capacity.py
    names = tuple(name for name in READINGS if name not in left_out)
    settings = _asked(connection, load, wrench is not None)
    quantities = choose_quantities(names, settings, elastic)
    outputs = tuple(dict.fromkeys(o for one in quantities for o in one.outputs(settings)))
    given = None if wrench is None else np.array(wrench)
    q = np.random.default_rng(1).uniform(-2.5, 2.5, (300, len(elastic.q)))
    read = recorded(elastic, names, q, settings, given)
    assert read.is_known.mean() > 0.9
    found = analyse_many(
        elastic, q, outputs=outputs, wrench=given, load_kind=load.kind, load_at=load.at
    )
    expected = evaluate(quantities, found.arrays, settings)
    condition = expected["condition"][read.is_known]
    for name in names:
        a, b = read.values[name][read.is_known], expected[name][read.is_known]
        np.testing.assert_array_less(np.abs(a - b), ROUNDING * condition * np.abs(b) + 1e-12, name)
    assert found.is_regular[read.is_known].all()


def _near(elastic: ElasticMechanism, count: int) -> np.ndarray:
    """Postures near home, closed chains closed."""
    at = elastic.mechanism.at(elastic.q)
    q = np.tile(elastic.q, (count, 1))
    own = list(getattr(elastic.mechanism, "actuated", None) or range(q.shape[1]))
    rng = np.random.default_rng(0)
    q[:, own] += 0.05 * at.coordinate_lengths[own] * rng.uniform(-1.0, 1.0, (count, len(own)))
    return q


def _with_legs_that_differ(elastic: ElasticMechanism) -> ElasticMechanism:
    mechanism = copy(elastic.mechanism)
    fixed, moving, *centres = np.random.default_rng(1).uniform(0.02, 0.2, (4, 6))
    mechanism.struts = Struts(fixed, moving, *(0.2 * c for c in centres), 0.1 * fixed)
    return replace(elastic, mechanism=mechanism)


FORCE, WRENCH = (0.0, 0.0, 0.0, 10.0, -20.0, 30.0), (1.0, 2.0, -3.0, 10.0, -20.0, 30.0)


@pytest.mark.parametrize("gravity", [False, True])
@pytest.mark.parametrize(
    ("name", "wrench", "load"),
    [
        ("ur5", None, LoadKind()),
        ("ur5", FORCE, LoadKind("dead", (0.0, 0.1, 0.2))),
        ("ur5", WRENCH, LoadKind("conservative")),
        ("panda", FORCE, LoadKind()),
        ("stewart-simscape", FORCE, LoadKind()),
        ("legs that differ", FORCE, LoadKind()),
        ("legs that differ", None, LoadKind()),
        ("6-ups", FORCE, LoadKind()),
        ("armatures", FORCE, LoadKind()),
    ],
)
def test_frequencies_on_a_tape_are_those_of_the_modes(name, wrench, load, gravity):
    """Masses of links, legs and rotors; loads with an energy; open and closed chains, platforms."""
    file = {"armatures": "ur5", "legs that differ": "stewart-simscape"}.get(name, name)
    elastic = cartstiff.load(file)
    if name == "legs that differ":
        elastic = _with_legs_that_differ(elastic)
    if name == "armatures":
        elastic.mechanism.tree.model.armature = np.linspace(0.1, 3.0, 6)
    if gravity:
        elastic = elastic.with_gravity([1.0, -2.0, -9.0])
    names = tuple(frequency_name(i) for i in range(6))
    given = None if wrench is None else np.array(wrench)
    assert readable(elastic, names, given) == names
    settings = Settings(length=LENGTH, load=load)
    read = recorded(elastic, names, _near(elastic, 6), settings, given)
    assert read.is_known.all()
    acting = {} if wrench is None else {"load_kind": load.kind, "load_at": load.at}
    expected = [
        cartstiff.modes(elastic, q, wrench=wrench, **acting).frequencies[:6] for q in read.q
    ]
    found = np.array([read.values[name] for name in names]).T
    np.testing.assert_allclose(found, expected, rtol=ROUNDING)
    # The lowest alone comes another way.
    first = recorded(elastic, names[:1], read.q, settings, given)
    lowest = first.values["frequency_1"]
    np.testing.assert_allclose(lowest, found[:, 0], rtol=ROUNDING)


@pytest.mark.parametrize("seed", range(6))
def test_frequencies_of_any_arm_are_those_of_the_modes(seed):
    """Joints of every kind, inertias and rotors by chance, some links without mass."""
    rng = np.random.default_rng(seed)
    kinds = "".join(rng.choice(list("RRRPH"), rng.integers(6, 9)))
    model, n = serial_model(kinds, rng), len(kinds)
    for j in range(1, model.njoints - seed % 2):
        moments = np.diag(rng.uniform(0.01, 0.05, 3))
        lever = rng.uniform(-0.2, 0.2, 3)
        model.inertias[j] = pinocchio.Inertia(rng.uniform(0.1, 5.0), lever, moments)
    model.armature = rng.uniform(0.0, 2.0, n)
    springs = JointSprings(rng.uniform(1e3, 5e4, n), np.full(n, np.nan))
    elastic = ElasticMechanism(
        kinds,
        Chain(plain_tree(model), "tip"),
        np.zeros(n),
        springs,
        gravity=rng.uniform(-9.0, 9.0, 3),
    )
    wrench = np.array([0.0, 0.0, 0.0, *rng.uniform(-50.0, 50.0, 3)])
    names = tuple(frequency_name(i) for i in range(6))
    q = rng.uniform(-1.5, 1.5, (4, n))
    read = recorded(elastic, names, q, Settings(length=0.3), wrench)
    assert read.is_known.all()
    found = np.array([read.values[name] for name in names]).T
    expected = [cartstiff.modes(elastic, q, wrench=wrench).frequencies[:6] for q in read.q]
    np.testing.assert_allclose(found, expected, rtol=ROUNDING)


@pytest.mark.parametrize("load", [LoadKind("dead"), LoadKind("follower")])
def test_loads_without_an_energy_are_left_to_the_engine(load):
    """There motions may flutter: K is no longer symmetric."""
    elastic, settings = cartstiff.load("ur5"), Settings(length=LENGTH, load=load)
    read = recorded(elastic, ("frequency_1",), _near(elastic, 8), settings, WRENCH)
    assert not read.is_known.any()


def test_frequencies_that_are_not_on_a_tape_are_named():
    """Masses that loads bring; more than the lowest of many motions."""
    arm = cartstiff.load("ur5")
    names = ("frequency_1", "frequency_2", "condition")
    assert readable(arm, names, None) == names
    heavy = arm.with_potential(payload(3.0, (0.0, 0.0, -9.81)))
    assert readable(heavy, names, None) == ("condition",)
    assert readable(cartstiff.load("delta"), names, None) == ("frequency_1", "condition")
    assert readable(cartstiff.load("hexapod"), names, None) == ("condition",)


@pytest.mark.parametrize("wrench", [None, FORCE])
def test_a_map_of_frequencies_is_the_same_with_and_without_machine_code(wrench):
    elastic = cartstiff.load("ur5").with_gravity([0.0, 0.0, -9.81])
    count = 60
    sampling = RandomPostures.within_limits(elastic, count, 3)
    names = ("frequency_1", "frequency_4", "connection_change", "condition")
    job = MapJob(
        elastic,
        sampling,
        names,
        _asked("B", LoadKind(), wrench is not None),
        wrench,
        path="portable",
    )
    box = (slice(0, count),)
    expected = job.compute(box)
    found = replace(job, path="compiled").compute(box)
    for name in names:
        scale = ROUNDING * expected["condition"] * np.abs(expected[name])
        assert (np.abs(found[name] - expected[name]) <= scale).all(), name


def test_readings_are_quantities():
    assert set(READINGS) < set(QUANTITIES)


def test_a_map_read_by_machine_code_is_the_map_read_from_matrices():
    elastic = cartstiff.load("ur5")
    count = 400
    sampling = RandomPostures.within_limits(elastic, count, 3)
    names = ("translation_free_min", "condition", "deflection", "connection_change")
    job = MapJob(elastic, sampling, names, _asked("B", LoadKind(), False), None, path="portable")
    box = (slice(0, count),)
    expected = job.compute(box)
    found = replace(job, path="compiled").compute(box)
    assert set(found) == set(expected)
    for name, values in expected.items():
        scale = expected["condition"] if values.ndim == 1 else 1.0
        assert (np.abs(found[name] - values) <= ROUNDING * scale * np.abs(values) + 1e-15).all()


def test_singular_postures_are_read_from_matrices():
    elastic = cartstiff.load("ur5")
    q = np.array([np.zeros(6), elastic.q + 0.3])
    read = recorded(elastic, ("condition",), q, Settings(length=LENGTH))
    assert read.is_known.tolist() == [False, True]


def _on_tape(function, matrices):
    """The numbers that a function of a recorded symmetric matrix gives, for each of some."""
    tape, n = Tape(), matrices.shape[1]
    values = function(tape.vector("m", n * n).reshape(n, n))
    program = tape.program({"found": np.array(values, object)}, [])
    out = {"found": np.empty((len(matrices), len(values)))}
    rows = matrices.reshape(len(matrices), -1)
    PortableKernel(program).run({"m": rows}, out, len(matrices))
    return out["found"]


@pytest.mark.parametrize("n", range(1, 9))
def test_eigenvalues_on_a_tape_are_those_of_lapack(n):
    rng = np.random.default_rng(0)
    factors = rng.normal(size=(500, n, n)) * 10.0 ** rng.uniform(-2, 2, (500, 1, n))
    positive = factors @ factors.swapaxes(1, 2)
    indefinite = factors + factors.swapaxes(1, 2)
    for matrices in (positive, indefinite):
        expected = np.linalg.eigvalsh(matrices)
        size = np.abs(expected).max(axis=1, keepdims=True)

        def all_of_them(m):
            values, doubt = eigenvalues(m)
            return [*ascending(values), doubt]

        found = _on_tape(all_of_them, matrices)
        known = found[:, -1] == 0.0
        assert known.mean() > 0.98
        assert (np.abs(found[known, :-1] - expected[known]) < 1e-14 * size[known]).all()
    found = _on_tape(lambda m: list(largest_eigenvalue(m)), positive)
    known = found[:, 1] == 0.0
    assert known.mean() > 0.98
    assert np.abs(found[known, 0] / np.linalg.eigvalsh(positive)[known, -1] - 1.0).max() < 1e-14


def test_principal_values_with_the_others_held_are_those_of_fifty_digits():
    rng = np.random.default_rng(2)
    factors = rng.normal(size=(40, 6, 6)) * 10.0 ** rng.uniform(-2.5, 0.5, (40, 1, 6))
    compliances = factors @ factors.swapaxes(1, 2)
    held = slice(3, 6)

    def pair(m):
        inverse, growth = eliminated(m[:6, :6], held)
        values, doubt = principal_values(m[6:, 6:], inverse, growth)
        return [*values, growth, principal_values(m[6:, 6:], inverse, 1e9)[1], doubt]

    both, expected = np.zeros((len(compliances), 9, 9)), np.empty((len(compliances), 3))
    with mpmath.workdps(50):
        for i, C in enumerate(compliances):
            block = mpmath.inverse(mpmath.matrix(C.tolist()))[3:6, 3:6]
            both[i, :6, :6], both[i, 6:, 6:] = C, np.array(block.tolist(), float)
            expected[i] = sorted(float(x) for x in mpmath.eigsy(block, eigvals_only=True))
    found = _on_tape(pair, both)
    known = found[:, -1] == 0.0
    is_plain = expected[:, 2] < 1e4 * expected[:, 0]
    assert known[is_plain].all()
    assert (known & ~is_plain).sum() > 5
    lost = np.abs(found[:, :3] / expected - 1.0).max(axis=1)
    assert lost[known].max() < numerics.EPSILON * numerics.LARGEST_BLOCK_CONDITION
    # The loss of digits in the inverse is known, and counts.
    growth = found[:, 3] / [loss_of_elimination(C, held) for C in compliances]
    assert growth.min() > 1.0 - 1e-9
    assert growth.max() < 9.0
    assert found[~is_plain, 4].all()


def test_hardly_a_posture_is_left_to_be_read_one_by_one():
    elastic = cartstiff.load("ur5")
    names = ("translation_held_min", "compliance_rotation_held_max", "natural_length")
    q = np.random.default_rng(1).uniform(-2.5, 2.5, (4000, len(elastic.q)))
    known = recorded(elastic, names, q, Settings(length=LENGTH)).is_known
    assert known.mean() > 0.998


def test_two_equal_largest_eigenvalues_are_a_doubt_or_right():
    matrices = np.array([np.diag([1.0, 2.0, 3.0, 4.0, 5.0, 5.0]), np.eye(6)])
    turn = np.linalg.qr(np.random.default_rng(0).normal(size=(6, 6)))[0]
    found = _on_tape(lambda m: list(largest_eigenvalue(m)), turn @ matrices @ turn.T)
    right = np.abs(found[:, 0] - [5.0, 1.0]) < 1e-13
    assert (right | (found[:, 1] != 0.0)).all()


def test_a_map_has_one_numerical_path(tmp_path, monkeypatch):
    """The last part is shorter than what compiling is worth, and computed in another process."""
    elastic = arm()
    sampling = RandomPostures(60, 1, elastic.q - 0.5, elastic.q + 0.5)
    monkeypatch.setattr(kernels, "WORTH_COMPILING", 60)
    monkeypatch.setattr(kernels, "_made", {})
    quantities = ["translation_free_min", "condition"]
    whole = compute_map(elastic, sampling, quantities, tmp_path / "m.zarr", chunk=50).load()
    assert whole.attrs["numerical_path"] == "compiled"
    (tmp_path / "m.zarr" / "parts" / "marks" / "c" / "1" / "0").unlink()
    monkeypatch.setattr(kernels, "_made", {})
    resumed = compute_map(elastic, sampling, quantities, tmp_path / "m.zarr", chunk=50).load()
    for name in quantities:
        np.testing.assert_array_equal(resumed[name], whole[name])
    few = RandomPostures(59, 1, elastic.q - 0.5, elastic.q + 0.5)
    other = compute_map(elastic, few, quantities, tmp_path / "n.zarr")
    assert other.attrs["numerical_path"] == "portable"
