"""Where nothing is nearly lost the engine takes a short way, to the numbers of the long one."""

from __future__ import annotations

import numpy as np
import pytest

import cartstiff
from cartstiff import numerics
from cartstiff.numerics import inverses, small, threads
from cartstiff.stiffness import compute, posture, reduction

WRENCH = np.array([3.0, -2.0, 1.0, 40.0, -25.0, 60.0])
#: Relative to what the diagonal allows an entry to be: twelve digits are promised.
AGREED = 1e-12


def _without_short_ways(monkeypatch):
    monkeypatch.setattr("cartstiff.stiffness.reduction.plainly_redundant", lambda *_: None)
    monkeypatch.setattr(posture.PostureStiffness, "_plain_inverses", None)


def _everything(elastic, q, wrench):
    result = compute.analyse(elastic, q, wrench=wrench)
    found = {"wrench": result.wrench, "energy": np.array(result.energy)}
    for kind in ("matrices", "compliances"):
        found |= {f"{kind} {name}": M for name, M in getattr(result, kind).items()}
    return result, found, [note.code for note in result.notes]


@pytest.mark.parametrize("loaded", [True, False])
@pytest.mark.parametrize("name", ["ur5", "panda", "stewart-gough", "hexapod", "6-ups"])
def test_the_same_numbers(name, loaded, monkeypatch):
    elastic = cartstiff.load(name)
    wrench = WRENCH if loaded else None
    sizes = 0.4 if name in ("ur5", "panda") else 0.01
    draw = np.random.default_rng(3)
    q = [elastic.q + sizes * draw.uniform(-1, 1, elastic.q.size) for _ in range(12)]
    if elastic.mechanism.kind == "closed":
        q = [elastic.mechanism.assembled(x) for x in q[:3]]
    short = [_everything(elastic, x, wrench) for x in q]
    # The test is of something: the short way was taken.
    taken = [result._plain_inverses is not None for result, *_ in short]
    assert all(taken)
    _without_short_ways(monkeypatch)
    for x, (_, found, notes) in zip(q, short, strict=True):
        _, expected, other = _everything(elastic, x, wrench)
        assert notes == other
        for key, number in expected.items():
            assert (number is None) == (found[key] is None), key
            if number is None:
                continue
            size = np.abs(number).max()
            if number.ndim == 2:
                # K^F and C^F may be far from the others: each is measured by itself.
                own = expected[key[:-1] + ("F" if key[-1] == "F" else "B")].diagonal()
                s = np.sqrt(np.abs(own))
                size = np.outer(s, s)
                size = size * max(1.0, np.abs(number / size).max())
            assert np.all(np.abs(found[key] - number) <= AGREED * size), key


def test_a_redundant_arm_that_moves_by_itself_goes_the_long_way(monkeypatch):
    """Rest positions that nothing balances; a self-motion that the load makes unstable."""
    arm = cartstiff.load("panda")
    unbalanced = compute.analyse(arm.with_springs(rest=arm.q + 0.1))
    assert unbalanced.reduction.states[-1].code == "unbalanced"
    codes = [
        [state.code for state in compute.analyse(arm, wrench=load).reduction.states]
        for load in (1e6 * np.concatenate([np.eye(6), -np.eye(6)]))
    ]
    assert ["buckled"] in codes
    _without_short_ways(monkeypatch)
    for load, expected in zip(1e6 * np.concatenate([np.eye(6), -np.eye(6)]), codes, strict=True):
        states = compute.analyse(arm, wrench=load).reduction.states
        assert [state.code for state in states] == expected


def test_cancelling_is_seen_against_what_was_there_before():
    """A change that takes all stiffness away but its rounding leaves no inverse that is known."""
    K = np.diag([1.0, 2.0, 3.0, 4.0, 5.0, 6.0]) + 0.1
    whole, cancelled = K[None], np.array([K, 1e-13 * K])
    (inverse,), (error,) = numerics.plain_inverses(whole)
    assert np.allclose(inverse @ K, np.eye(6), atol=1e-14)
    assert error < 1e-14
    assert numerics.plain_inverses(cancelled)[1][1] == np.inf
    assert numerics.plain_inverses(-whole) is None


def test_numpy_without_its_inner_routines(monkeypatch):
    rng = np.random.default_rng(1)
    stack = rng.normal(size=(3, 6, 6))
    stack[1, 2] = 0.0
    values, found = small.singular_values(stack[0]), small.inverted(stack)
    assert np.isnan(found[1]).any()
    assert np.array_equal(found[0], np.linalg.inv(stack[0]))
    monkeypatch.setattr(small, "_INVERT", None)
    monkeypatch.setattr(small, "_SINGULAR_VALUES", None)
    assert np.array_equal(small.singular_values(stack[0]), values)
    again = small.inverted(stack)
    assert np.array_equal(again[[0, 2]], found[[0, 2]])
    assert np.isnan(again[1]).any()
    assert inverses.invert(stack[1]) is None


def _threads():
    return [library.get_num_threads() for library in threads._blas()]


def test_one_thread_of_blas_in_the_reduction_of_many_coordinates(monkeypatch):
    """Those of the process are as before once the last has come out, in whatever order."""
    import scipy.linalg  # noqa: F401 - with the BLAS that it brings

    before, seen = _threads(), list[int]()
    inner = reduction.reduce_any

    def watched(*given):
        seen.extend(_threads())
        return inner(*given)

    monkeypatch.setattr(reduction, "reduce_any", watched)
    try:
        for library in threads._blas():
            library.set_num_threads(2)
        usual = _threads()
        compute.analyse(cartstiff.load("6-ups"))
        assert set(seen) == {1}
        assert _threads() == usual
        first, second, few = (numerics.one_thread(rows) for rows in (45, 45, 6))
        with few:
            assert _threads() == usual
        first.__enter__()
        second.__enter__()
        first.__exit__(None, None, None)
        assert set(_threads()) == {1}
        second.__exit__(None, None, None)
        assert _threads() == usual
        # Many small matrices in a row, whatever their size.
        with numerics.one_thread(), numerics.one_thread(6), numerics.one_thread():
            assert set(_threads()) == {1}
        assert _threads() == usual
    finally:
        for library, count in zip(threads._blas(), before, strict=True):
            library.set_num_threads(count)
