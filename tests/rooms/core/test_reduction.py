"""Each step of the reduction solves the equation that its module states."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from tests.doors import balanced, decomposed, numerics
from tests.inner import Problem, _inverse, reduction, threads
from tests.inner import motions_motions as motions
from tests.support import refused
from tests.support.oracles import relative_error

import cartstiff
from cartstiff import UndefinedError

W = np.array([3.0, -2.0, 1.0, 20.0, -10.0, 50.0])


def _problem(name: str) -> Problem:
    elastic = cartstiff.load(name)
    posture = elastic.mechanism.closed(elastic.q)
    _, energy = balanced(elastic, posture, W)
    seen: list[Problem] = []
    inner = reduction._reduced
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(reduction, "_reduced", lambda p, f: seen.append(p) or inner(p, f))
        reduction.reduced_at(elastic, posture, energy, posture.closure, W)
    return seen[0]


@pytest.mark.parametrize("name", ["ur5", "panda", "6-ups", "five-bar", "stewart-gough"])
def test_every_step_solves_its_equation(name):
    problem = _problem(name)
    closures = None if problem.closure is None else decomposed(problem.closure, problem.columns)
    free = motions(problem, closures)
    J, N, Y, Z, U = problem.J, free.N, free.Y, free.Z, free.U
    n, size = len(problem.g), np.abs(J).max()
    C = np.zeros((0, n)) if closures is None else problem.closure.jacobian * problem.columns

    # (1): C N = 0, J Z = 0, J Y spans the range of J N.
    assert np.abs(C @ N).max(initial=0.0) <= 1e-9 * np.abs(N).max()
    assert np.abs(J @ Z).max(initial=0.0) <= 1e-9 * size * np.abs(Z).max(initial=1.0)
    assert np.linalg.matrix_rank(J @ N, 1e-9 * size) == Y.shape[1] == U.shape[1]
    assert pytest.approx(J @ Y, abs=1e-9 * size) == U @ U.T @ J @ Y

    # (2): g + C^T lam = J^T w.
    held = reduction.balance(problem, free, W)
    balance = problem.g + C.T @ held.lam - J.T @ held.w
    assert np.abs(balance).max() <= 1e-8 * max(1.0, np.abs(problem.g).max())

    # (3): H_L is the Hessian of g . dq + lam . c - w . x along the motions.
    tangent = reduction.lagrangian(problem, held)
    expected = problem.H - problem.curvature(problem.output, held.w * problem.rows)
    if problem.closure is not None:
        expected = expected + problem.curvature(problem.closure, held.lam)
    assert relative_error(tangent.hessian, expected) <= 1e-12

    # (4), by the optimality conditions of the minimum instead of its formula.
    minimum = reduction.minimise_self_motion(problem, free, tangent)
    stiffness = np.array([_least_energy(tangent.hessian, N, J, u) for u in U.T])
    assert np.diag(minimum.stiffness) == pytest.approx(stiffness, rel=1e-6)

    # (5): the compliance is the inverse, where both exist.
    found = reduction.explain(problem, free, held, tangent, minimum)
    if found.stiffness is not None and found.compliance is not None:
        assert found.stiffness @ found.compliance == pytest.approx(np.eye(6), abs=1e-6)


def _least_energy(H, N, J, u):
    """Twice the least energy of motions that move the output by u: a system with multipliers."""
    N = np.linalg.qr(N)[0]
    J_N, H_N = J @ N, N.T @ H @ N
    m, scale = len(J_N), np.abs(H_N).max()
    system = np.block([[H_N / scale, J_N.T], [J_N, np.zeros((m, m))]])
    right = np.concatenate([np.zeros(len(H_N)), u])
    y = np.linalg.lstsq(system, right, rcond=1e-13)[0][: len(H_N)]
    return y @ H_N @ y


def test_equations_have_the_numbers_of_the_theory_page():
    page = (Path(__file__).parents[3] / "docs" / "theory.md").read_text(encoding="utf-8")
    labels = re.findall(r"^\$\$ \(([a-z-]+)\)$", page, re.MULTILINE)
    cited = re.findall(r"`([a-z-]+)` \((\d+)\)", reduction.__doc__)
    assert len(cited) == 4
    assert {name: labels.index(name) + 1 for name, _ in cited} == {n: int(i) for n, i in cited}


def test_motions_that_cannot_be_told_apart_are_named():
    caught = refused(
        "singular in more than one way",
        _inverse,
        np.array([[1.0, 0.0], [0.0, 0.0]]),
        np.ones(2),
        kind=UndefinedError,
    )
    assert caught.code == "ill-conditioned"


def _threads():
    return [library.get_num_threads() for library in threads._blas()]


def test_one_thread_of_blas_in_the_reduction_of_many_coordinates(monkeypatch):
    """Those of the process are as before once the last has come out, in whatever order."""
    import scipy.linalg  # noqa: F401 - with the BLAS that it brings

    before, seen = _threads(), list[int]()
    inner = reduction._reduced

    def watched(*given):
        seen.extend(_threads())
        return inner(*given)

    monkeypatch.setattr(reduction, "_reduced", watched)
    try:
        for library in threads._blas():
            library.set_num_threads(2)
        usual = _threads()
        cartstiff.analyse(cartstiff.load("6-ups"))
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
