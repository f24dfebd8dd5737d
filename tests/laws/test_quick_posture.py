"""One posture by code is one posture by the engine: numbers, notes, errors, processes.

Code is made by llvmlite, or printed as Python where that is not installed.
"""

from __future__ import annotations

import pickle
from dataclasses import replace

import numpy as np
import pytest

import cartstiff
from cartstiff.batch import kernels, single
from cartstiff.batch.execution import PrintedPosture
from cartstiff.batch.single import QuickPosture
from cartstiff.batch.tape import Tape, square_root
from cartstiff.errors import ConvergenceError, InputError
from cartstiff.page.messages import ViewState
from cartstiff.page.picture import PageScene
from cartstiff.page.shown import shown_numbers
from cartstiff.stiffness import compute
from cartstiff.stiffness.balance import with_rest_balancing

pytest.importorskip("llvmlite")

WRENCH = np.array([4.0, -3.0, 2.0, 20.0, 30.0, -40.0])
# The same formulas in another order; the worst of these postures has a condition of some 1e3.
SAME = 1e-11


def asked_often(elastic, wrench=None):
    """Ask until there is machine code, as somebody would who sweeps over postures.

    It is made sooner here: `test_led_postures` waits for it as long as anybody.
    """
    with pytest.MonkeyPatch.context() as sooner:
        sooner.setattr(single, "COMPILED_AT", 3)
        for _ in range(single.COMPILED_AT):
            cartstiff.analyse(elastic, wrench=wrench)


def both_answers(elastic, q, wrench):
    """Of machine code and of the engine; None where both find no closure, or no rest."""
    try:
        engine = compute.analyse(elastic, q, wrench=wrench)
    except ConvergenceError:
        with pytest.raises(ConvergenceError):
            cartstiff.analyse(elastic, q, wrench=wrench)
        return None
    return cartstiff.analyse(elastic, q, wrench=wrench), engine


def assert_same(a, b):
    if b is None:
        assert a is None
    else:
        assert np.abs(a - b).max() <= SAME * np.abs(b).max()


@pytest.mark.parametrize(
    ("name", "wrench", "spread", "quick"),
    [
        ("ur5", None, 0.4, 20),
        ("ur5", WRENCH, 1.5, 15),
        ("panda", WRENCH, 0.4, 15),
        ("hexapod", None, 0.02, 20),
        ("stewart-gough", None, 0.2, 20),  # near a type-2 singularity everywhere
        ("cable-robot", None, 0.01, 0),  # slack cables are remarked on
        ("xarm7", None, 2.0, 5),
        ("6-ups", WRENCH, 0.1, 20),
        ("6-ups", None, 0.6, 5),  # far out it is nearly singular, or cannot be closed
        ("delta", None, 0.3, 15),  # with links that give
    ],
)
def test_every_answer_is_the_engines(name, wrench, spread, quick):
    compare(name, wrench, spread, quick)


@pytest.mark.parametrize(
    ("name", "wrench", "spread"),
    [
        ("ur5", WRENCH, 1.0),
        ("panda", None, 0.4),
        ("stewart-gough", None, 0.2),
        ("6-ups", WRENCH, 0.1),
        ("delta", None, 0.3),
    ],
)
def test_every_answer_of_printed_python_is_the_engines(monkeypatch, name, wrench, spread):
    installed = kernels.has_package
    monkeypatch.setattr(kernels, "has_package", lambda p: p != "llvmlite" and installed(p))
    compare(name, wrench, spread, quick=4, count=6)


def test_printed_python_says_nan_where_a_number_does_not_exist():
    tape = Tape()
    x = tape.input("x", 0)
    program = tape.program({"y": np.array([1.0 / x + square_root(x)], object)}, [])
    printed = PrintedPosture(program, {})
    assert printed.record(x=np.array([4.0])) == pytest.approx([2.25])
    for lost in (0.0, -1.0, np.nan, np.inf, 1e-320):
        assert np.isnan(printed.record(x=np.array([lost]))).all()


def compare(name, wrench, spread, quick, count=20):
    """Answers at `count` postures about the file's, of which at least `quick` are by code."""
    elastic = cartstiff.load(name)
    asked_often(elastic, wrench)
    rng = np.random.default_rng(3)
    chain = elastic.mechanism
    moved = list(getattr(chain, "actuated", None) or range(len(elastic.q)))
    sizes = chain.at(elastic.q).coordinate_lengths if len(moved) < len(elastic.q) else 1.0
    found = 0
    for _ in range(count):
        q = elastic.q.copy()
        q[moved] += (rng.uniform(-spread, spread, len(q)) * sizes)[moved]
        if (both := both_answers(elastic, q, wrench)) is None:
            continue
        ours, engine = both
        found += isinstance(ours, QuickPosture)
        assert_same(ours.q, engine.q)
        assert [n.code for n in ours.notes] == [n.code for n in engine.notes]
        assert [n.code for n in ours.notes_on_posture] == [n.code for n in engine.notes_on_posture]
        for c in "ABKF":
            if engine.matrices[c] is not None:
                assert_same(ours.matrices[c], engine.matrices[c])
            if engine.compliances[c] is not None:
                assert_same(ours.compliances[c], engine.compliances[c])
        assert_same(ours.pose, engine.pose)
        assert np.abs(ours.wrench - engine.wrench).max() <= SAME * (1 + np.abs(engine.wrench).max())
        assert ours.energy == pytest.approx(engine.energy, rel=SAME, abs=1e-15)
        assert ours.stored_energy == pytest.approx(engine.stored_energy, rel=SAME, abs=1e-15)
        if engine.jacobian is not None:
            assert_same(ours.jacobian, engine.jacobian)
        if engine.tangent is not None and engine.tangent_compliance is not None:
            assert_same(ours.tangent, engine.tangent)
            assert_same(ours.tangent_compliance, engine.tangent_compliance)
            assert_same(ours.inverse_of_symmetric_tangent, engine.inverse_of_symmetric_tangent)
            even = 0.5 * (engine.tangent + engine.tangent.T)
            condition = np.linalg.cond(even)
            residual = ours.inverse_of_symmetric_tangent @ even - np.eye(6)
            assert np.abs(residual).max() <= 1e-14 * condition
        assert ours.is_loaded == engine.is_loaded
        assert ours.to_dict().keys() == engine.to_dict().keys()
    assert found >= quick


@pytest.mark.parametrize(
    ("name", "wrench"),
    [
        *(("ur5", w) for w in (None, WRENCH)),
        *(("panda", w) for w in (None, WRENCH)),
        *(("hexapod", w) for w in (None, WRENCH)),
        *(("6-ups", w) for w in (None, WRENCH)),
        ("delta", None),
    ],
)
def test_code_alone_knows_what_people_read_first(monkeypatch, name, wrench):
    """Numbers and notes of a plain posture, without a question to the engine."""
    elastic = cartstiff.load(name)
    asked_often(elastic, wrench)
    expected, picture = compute.analyse(elastic, wrench=wrench), PageScene(elastic)
    picture.draw(expected, ViewState(q=expected.q.tolist()))

    def asked(*_args, **_keywords):
        raise AssertionError("the engine was asked")

    monkeypatch.setattr(compute, "analyse", asked)
    monkeypatch.setattr(single, "deflection_notes", asked)
    ours = cartstiff.analyse(elastic, wrench=wrench)
    assert isinstance(ours, QuickPosture)
    assert_same(ours.matrices["B"], expected.matrices["B"])
    assert_same(ours.compliances["A"], expected.compliances["A"])
    assert_same(ours.pose, expected.pose)
    assert ours.length == pytest.approx(expected.posture.length, rel=1e-13)
    if expected.leg_lengths is None:
        assert ours.leg_lengths is None
        assert ours.tensions is None
    else:
        assert_same(ours.leg_lengths, expected.leg_lengths)
        assert_same(ours.tensions, expected.tensions)
    if wrench is None:  # the shares of a load ask the springs
        state = ViewState(q=ours.q.tolist())
        picture.draw(ours, state)
        assert shown_numbers(ours, state)["stiffness"] is None
    assert [n.code for n in ours.notes] == [n.code for n in expected.notes]


@pytest.mark.parametrize(
    ("name", "given"),
    [(n, False) for n in ("ur5", "panda", "stewart-gough", "hexapod", "6-ups")]
    + [(n, True) for n in ("ur5", "stewart-gough", "hexapod")],
)
def test_deflections_are_doubted_alike(name, given):
    """Loads from far below to far above those that wind up joints or stretch legs a tenth."""
    elastic = cartstiff.load(name)
    if given:
        elastic = with_rest_balancing(elastic, elastic.q)
    wrench = None if given else WRENCH
    asked_often(elastic, wrench)
    found = {True: 0, False: 0}
    for size in 10.0 ** np.arange(-4.0, 9.0, 0.3):
        load = None if given else size * WRENCH
        q = elastic.q if not given else elastic.q + 0.002 * size**0.3
        if (both := both_answers(elastic, q, load)) is None:
            continue
        ours, engine = both
        assert [n.code for n in ours.notes] == [n.code for n in engine.notes]
        if isinstance(ours, QuickPosture):
            found["implausible-deflection" in {n.code for n in ours.notes}] += 1
    assert found[False] >= 10


def test_links_that_give_are_bent_by_machine_code_too(monkeypatch):
    """Numbers, coordinates and notes of a delta under loads, also of one far too large."""
    monkeypatch.setattr(single, "BENT_COMPILED_AT", 3)
    elastic = cartstiff.load("delta")
    asked_often(elastic, 0.3 * WRENCH)
    rng, quick = np.random.default_rng(3), 0
    motors = list(elastic.mechanism.actuated)
    for size in (0.0, 0.1, 0.3, 0.3, 1.0, 2.0, 30.0):
        q = elastic.q.copy()
        q[motors] += rng.uniform(-0.2, 0.2, len(motors))
        load = size * WRENCH
        if (both := both_answers(elastic, q, load)) is None:
            continue
        ours, engine = both
        quick += isinstance(ours, QuickPosture)
        np.testing.assert_allclose(ours.q, engine.q, rtol=0, atol=1e-12)
        assert [n.message for n in ours.notes] == [n.message for n in engine.notes]
        for name in ("pose", "jacobian", "wrench", "tangent", "tangent_compliance"):
            assert_same(getattr(ours, name), getattr(engine, name))
        for name in "ABK":
            assert_same(ours.matrices[name], engine.matrices[name])
        assert ours.energy == pytest.approx(engine.energy, rel=1e-11)
    assert quick >= 5


def test_postures_that_would_not_stay_are_answered_alike():
    """Springs far from their rest positions: a Hessian of both signs, factorised as it stands."""
    elastic = cartstiff.load("ur5")
    elastic = elastic.with_springs(rest=elastic.q)
    asked_often(elastic)
    rng = np.random.default_rng(4)
    quick = 0
    for q in elastic.q + rng.uniform(-0.8, 0.8, (60, 6)):
        ours, engine = cartstiff.analyse(elastic, q), compute.analyse(elastic, q)
        is_unstable = np.linalg.eigvalsh(engine.matrices["B"])[0] < 0
        quick += is_unstable and isinstance(ours, QuickPosture)
        for c in "ABKF":
            K, C = engine.matrices[c], engine.compliances[c]
            scaled = K * np.outer([2, 2, 2, 1, 1, 1], [2, 2, 2, 1, 1, 1])  # lengths in 0.5 m
            assert_same(ours.matrices[c], K)
            assert np.abs(ours.compliances[c] - C).max() <= (
                1e-13 * np.linalg.cond(scaled) * np.abs(C).max()
            )
    assert quick > 30


@pytest.fixture(scope="module")
def arm():
    elastic = cartstiff.load("ur5")
    asked_often(elastic)
    return elastic


@pytest.mark.parametrize("bend", [0.0, 1e-12, 1e-9, 1e-6, 1e-3, 0.05, 0.3])
def test_near_singularities_the_notes_are_the_engines(arm, bend):
    q = arm.q.copy()
    q[2] = bend  # the elbow straight
    ours, engine = cartstiff.analyse(arm, q), compute.analyse(arm, q)
    assert [n.to_dict().keys() for n in ours.notes] == [n.to_dict().keys() for n in engine.notes]
    assert [n.code for n in ours.notes] == [n.code for n in engine.notes]


def test_beyond_limits_it_says_so(arm):
    q = arm.q.copy()
    q[0] = 20.0
    ours = cartstiff.analyse(arm, q)
    assert isinstance(ours, QuickPosture)
    assert ours.notes == compute.analyse(arm, q).notes
    assert "beyond-limits" in {n.code for n in ours.notes}


def test_refusals_and_what_is_not_computed_are_the_engines(arm):
    with pytest.raises(InputError, match="wrong count"):
        cartstiff.analyse(arm, [0.0] * 5)
    with pytest.raises(InputError, match="finite"):
        cartstiff.analyse(arm, [np.nan] * 6)
    ours = cartstiff.analyse(arm)
    assert isinstance(ours, QuickPosture)
    engine = compute.analyse(arm)
    assert ours.reduction.rank == 6
    assert np.array_equal(ours.elastic.springs.rest, engine.elastic.springs.rest)
    assert repr(ours) == repr(engine)
    assert np.allclose(ours.B.matrix, engine.B.matrix, rtol=SAME)
    assert isinstance(cartstiff.analyse(arm, strict=True), compute.PostureStiffness)


def test_between_processes_goes_the_engines_answer(arm):
    ours = cartstiff.analyse(arm)
    again = pickle.loads(pickle.dumps(ours))
    assert type(again) is compute.PostureStiffness
    assert np.allclose(again.matrices["B"], ours.matrices["B"], rtol=SAME)


def test_what_may_change_is_left_to_the_engine():
    field = np.array([0.0, 0.0, -9.81])
    elastic = replace(cartstiff.load("ur5"), gravity=field)
    asked_often(elastic)
    before = cartstiff.analyse(elastic).energy
    field *= 2.0
    assert cartstiff.analyse(elastic).energy != before
