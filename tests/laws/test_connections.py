"""Affine connections: symmetry, curvature, invariance, metrics, covariant derivatives."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from tests.doors import NAMED, Field, exponential, flat
from tests.support import (
    absolute_error,
    adjoint_reference,
    bracket_reference,
    exp_reference,
    plain_twists,
    poses,
    random_pose,
    seeds,
    slope,
    wrenches,
)

from cartstiff import InputError, UndefinedError
from cartstiff.geometry import (
    BI_INVARIANT,
    CARTAN_MINUS,
    CARTAN_PLUS,
    KINEMATIC,
    Connection,
    from_bilinear_map,
    from_symbols,
    levi_civita,
    paper,
)

# Products of a few numbers of size up to ten.
ROUNDING = 1e-12
# Metrics here have condition numbers up to a thousand.
METRIC = 1e-10
# Eighth-order differences of fields of unit size.
DIFFERENCES = 1e-9


def _metric(seed: int) -> np.ndarray:
    G = np.random.default_rng(seed).normal(size=(6, 6))
    return G @ G.T + np.eye(6)


def _user(seed: int = 1) -> Connection:
    return from_symbols(np.random.default_rng(seed).normal(size=(6, 6, 6)), "mine")


ALL = {**NAMED, "metric": levi_civita(_metric(0)), "user": _user()}
EVERY = pytest.mark.parametrize("connection", ALL.values(), ids=ALL.keys())


def test_paper_kinematic_symbols():
    """Eq. 38: index order (j, i, k) of nabla_{L_i} L_j."""
    expected = np.zeros((6, 6, 6))
    entries = {
        0.5: ["213", "132", "321"],
        -0.5: ["123", "312", "231"],
        1.0: ["516", "624", "435"],
        -1.0: ["426", "534", "615"],
    }
    for value, names in entries.items():
        for j, i, k in names:
            expected[int(j) - 1, int(i) - 1, int(k) - 1] = value
    assert np.array_equal(KINEMATIC.symbols, expected)


@given(plain_twists, plain_twists)
def test_bilinear_maps_by_hand(x, y):
    w1, v2, w2 = x[:3], y[3:], y[:3]
    expected = {
        "A": np.zeros(6),
        "B": 0.5 * bracket_reference(x, y),
        "K": np.concatenate([0.5 * np.cross(w1, w2), np.cross(w1, v2)]),
        "+": bracket_reference(x, y),
    }
    for name, connection in NAMED.items():
        assert absolute_error(connection(x, y), expected[name]) <= ROUNDING


@EVERY
def test_torsion_is_its_definition(connection):
    rng = np.random.default_rng(2)
    x, y = rng.normal(size=(2, 6))
    expected = connection(x, y) - connection(y, x) - bracket_reference(x, y)
    got = np.einsum("ijk,i,j->k", connection.torsion, x, y)
    assert absolute_error(got, expected) <= ROUNDING


@EVERY
def test_curvature_is_its_definition(connection):
    rng = np.random.default_rng(3)
    x, y, z = rng.normal(size=(3, 6))
    nabla = connection
    expected = nabla(x, nabla(y, z)) - nabla(y, nabla(x, z)) - nabla(bracket_reference(x, y), z)
    got = np.einsum("ijlk,i,j,l->k", connection.curvature, x, y, z)
    assert absolute_error(got, expected) <= ROUNDING * 100
    assert np.abs(connection.curvature + np.swapaxes(connection.curvature, 0, 1)).max() <= ROUNDING


def test_symmetry_and_flatness():
    assert {n: c.is_symmetric for n, c in ALL.items()} == {
        "A": False,
        "B": True,
        "K": True,
        "+": False,
        "metric": True,
        "user": False,
    }
    # Both one-sided Cartan connections are flat: parallel fields exist, left- or right-invariant.
    assert {n: c.is_flat for n, c in ALL.items()} == {
        "A": True,
        "B": False,
        "K": False,
        "+": True,
        "metric": False,
        "user": False,
    }


def test_curvature_of_the_bi_invariant_connection():
    """R(X, Y) Z = -1/4 [[X, Y], Z]."""
    rng = np.random.default_rng(4)
    x, y, z = rng.normal(size=(3, 6))
    expected = -0.25 * bracket_reference(bracket_reference(x, y), z)
    got = np.einsum("ijlk,i,j,l->k", BI_INVARIANT.curvature, x, y, z)
    assert absolute_error(got, expected) <= ROUNDING


@pytest.mark.parametrize("name", ["B", "K", "metric"])
def test_first_bianchi_identity(name):
    """Symmetric connections: the cyclic sum of the curvature vanishes."""
    R = ALL[name].curvature
    cyclic = R + np.einsum("jlik->ijlk", R) + np.einsum("lijk->ijlk", R)
    assert np.abs(cyclic).max() <= METRIC * max(1.0, np.abs(R).max())


@pytest.mark.parametrize("name", ["A", "B", "+"])
@given(poses())
def test_bi_invariant_connections_keep_their_symbols(name, T):
    connection = NAMED[name]
    assert connection.is_bi_invariant
    carried = connection.carried_to(T)
    assert absolute_error(carried.symbols, connection.symbols) <= ROUNDING


@pytest.mark.parametrize("name", ["K", "metric", "user"])
def test_others_do_not(name):
    connection = ALL[name]
    assert not connection.is_bi_invariant
    T = random_pose(np.random.default_rng(5))
    assert absolute_error(connection.carried_to(T).symbols, connection.symbols) > 0.01


def test_kinematic_depends_on_the_origin_only():
    rng = np.random.default_rng(6)
    T = random_pose(rng)
    turned, moved = T.copy(), T.copy()
    turned[:3, 3] = 0
    moved[:3, :3] = np.eye(3)
    assert absolute_error(KINEMATIC.carried_to(turned).symbols, KINEMATIC.symbols) <= ROUNDING
    assert absolute_error(KINEMATIC.carried_to(moved).symbols, KINEMATIC.symbols) > 0.01
    assert [n for n, c in NAMED.items() if c.tied_to_origin] == ["K"]


@EVERY
@given(poses(), poses(), plain_twists, plain_twists)
def test_carried_symbols(connection, S, T, x, y):
    """nabla' = Ad^-1 nabla(Ad ., Ad .), and carrying twice is carrying by the product."""
    a = adjoint_reference(T)
    expected = np.linalg.solve(a, connection(a @ x, a @ y))
    scale = 1 + np.abs(a).max() ** 3 * 100
    assert absolute_error(connection.carried_to(T)(x, y), expected) <= ROUNDING * scale
    twice = connection.carried_to(S).carried_to(T).symbols
    once = connection.carried_to(S @ T).symbols
    assert (
        absolute_error(twice, once) <= ROUNDING * np.abs(adjoint_reference(S @ T)).max() ** 3 * 1e3
    )


@given(seeds)
def test_levi_civita(seed):
    """The one connection that is symmetric and keeps the metric."""
    g = _metric(seed)
    connection = levi_civita(g)
    assert connection.is_symmetric
    x, y, z = np.random.default_rng(seed + 1).normal(size=(3, 6))
    derivative = connection(z, x) @ g @ y + x @ g @ connection(z, y)
    assert abs(derivative) <= METRIC * np.abs(g).max() * np.abs(connection.symbols).max()


@given(poses())
def test_levi_civita_of_a_moved_metric(T):
    """Carrying the connection is the connection of the carried metric."""
    g, a = _metric(7), adjoint_reference(T)
    carried = levi_civita(g).carried_to(T).symbols
    direct = levi_civita(0.5 * (a.T @ g @ a + (a.T @ g @ a).T)).symbols
    assert absolute_error(carried, direct) <= 1e-8 * (1 + np.abs(a).max() ** 4)


@pytest.mark.parametrize(("inertia", "mass"), [(1.0, 1.0), (0.3, 7.0)])
def test_kinematic_is_levi_civita_of_kinetic_energy(inertia, mass):
    """Of a body with equal principal inertias, whatever their size."""
    got = levi_civita(np.diag([inertia] * 3 + [mass] * 3))
    assert absolute_error(got.symbols, KINEMATIC.symbols) <= ROUNDING


def test_levi_civita_of_an_unequal_body_is_another():
    got = levi_civita(np.diag([1.0, 2.0, 3.0, 1.0, 1.0, 1.0]))
    assert absolute_error(got.symbols, KINEMATIC.symbols) > 0.1


@pytest.mark.parametrize("chart", [paper, exponential], ids=["paper", "exponential"])
def test_flat_connection(chart):
    """Eq. 47 with alpha differentiated numerically; torsion-free, flat, known at one posture."""
    rng = np.random.default_rng(8)
    xi = rng.uniform(-1, 1, 6)
    connection = chart.connection(xi)
    gamma, alpha = chart.basis(xi), np.linalg.inv(chart.basis(xi))
    # d_alpha[m, i, l]: alpha_i^m along xi^l.
    d_alpha = np.stack(
        [slope(lambda t, e=e: np.linalg.inv(chart.basis(xi + t * e)), 0.01) for e in np.eye(6)],
        axis=-1,
    )
    expected = np.einsum("lj,mil,km->ijk", alpha, d_alpha, gamma)
    assert absolute_error(connection.symbols, expected) <= DIFFERENCES * 10
    assert np.abs(connection.torsion).max() <= DIFFERENCES
    assert connection.is_symmetric or chart is exponential  # its derivatives are differences
    assert connection.is_flat
    assert not connection.left_invariant
    assert not connection.is_bi_invariant


def test_flat_connection_kills_coordinate_fields():
    """nabla_{E_i} E_j = 0 with E_j = gamma_j^k L_k varying from pose to pose."""
    rng = np.random.default_rng(9)
    xi = rng.uniform(-1, 1, 6)
    connection = flat(paper.basis(xi), paper.basis_derivative(xi))
    T = paper.pose(xi)

    def coordinate_field(j):
        return Field(lambda M: paper.basis(paper.coordinates(M, xi))[:, j])

    for i, j in [(0, 1), (1, 0), (2, 2), (0, 5), (4, 3)]:
        nabla = covariant_derivative(connection, coordinate_field(i), coordinate_field(j), T)
        assert np.abs(nabla).max() <= DIFFERENCES


def test_flat_connection_carried_stays_flat():
    rng = np.random.default_rng(10)
    carried = paper.connection(rng.uniform(-1, 1, 6)).carried_to(random_pose(rng))
    assert carried.is_flat
    assert carried.is_symmetric
    assert not carried.left_invariant


def test_curvature_at_one_pose_is_unknown():
    connection = from_symbols(np.zeros((6, 6, 6)), left_invariant=False)
    with pytest.raises(UndefinedError, match="curvature needs the symbols in a neighbourhood"):
        _ = connection.curvature


@EVERY
@given(wrenches, plain_twists, plain_twists)
def test_wrench_term(connection, w, x, y):
    """T[i, j] = Gamma[i, j, k] W_k: motion in the second index."""
    assert abs(y @ connection.wrench_term(w) @ x - w @ connection(x, y)) <= ROUNDING * 1e3


def test_wrench_term_broadcasts():
    w = np.random.default_rng(11).normal(size=(4, 3, 6))
    got = ALL["user"].wrench_term(w)
    for index in np.ndindex(4, 3):
        assert absolute_error(got[index], ALL["user"].wrench_term(w[index])) <= ROUNDING


def test_connections_as_values():
    rebuilt = from_bilinear_map(ALL["user"].__call__, "again", meaning="a copy")
    assert absolute_error(rebuilt.symbols, ALL["user"].symbols) <= ROUNDING
    assert str(rebuilt) == "again: a copy"
    assert str(_user()) == "mine"
    for connection in ALL.values():
        assert not connection.symbols.flags.writeable
    assert list(NAMED) == ["A", "B", "K", "+"]
    assert all(NAMED[n].meaning for n in NAMED)


def test_user_array_is_copied():
    symbols = np.zeros((6, 6, 6))
    connection = from_symbols(symbols)
    symbols[0, 0, 0] = 1.0
    assert not connection.symbols.any()


# -- fields -------------------------------------------------------------------------------------


def covariant_derivative(connection: Connection, y: Field, x: Field, T: np.ndarray) -> np.ndarray:
    """``nabla_Y X`` at a pose: Y(X^k) L_k + X^j Y^i nabla_{L_i} L_j; components (6,)."""
    at_y = y.at(T)
    return x.along(T, at_y) + connection(at_y, x.at(T))


def covariant_derivative_of_form(
    connection: Connection, y: Field, form: Field, T: np.ndarray
) -> np.ndarray:
    """``nabla_Y F`` of a one-form, [ZK]_ eq. 29: components Y(F_i) - <F; nabla_Y L_i>."""
    at_y, at_f = y.at(T), form.at(T)
    return form.along(T, at_y) - connection.wrench_term(at_f) @ at_y


def _field(seed: int) -> Field:
    rng = np.random.default_rng(seed)
    a, b = 0.4 * rng.normal(size=(6, 16)), rng.normal(size=6)
    return Field(lambda T: np.sin(a @ T.ravel()) + b)


@EVERY
@pytest.mark.parametrize("seed", [1, 2])
def test_leibniz_rule_for_forms(connection, seed):
    """Eq. 28: U <F; V> = <nabla_U F; V> + <F; nabla_U V>, with F, U, V all varying."""
    rng = np.random.default_rng(seed)
    T = random_pose(rng)
    u, v, form = _field(seed), _field(seed + 10), _field(seed + 20)
    along = u.at(T)
    total = slope(
        lambda t: form.at(T @ exp_reference(t * along)) @ v.at(T @ exp_reference(t * along)), 0.005
    )
    first = covariant_derivative_of_form(connection, u, form, T) @ v.at(T)
    second = form.at(T) @ covariant_derivative(connection, u, v, T)
    assert abs(total - first - second) <= DIFFERENCES


@EVERY
def test_leibniz_rule_for_fields(connection):
    """nabla_U (f V) = U(f) V + f nabla_U V, and nabla_{f U} V = f nabla_U V."""
    T = random_pose(np.random.default_rng(3))
    u, v = _field(4), _field(5)

    def f(M):
        return float(np.cos(M[0, 3]) + M[1, 2])

    fv, fu = Field(lambda M: f(M) * v.at(M)), Field(lambda M: f(M) * u.at(M))
    along = u.at(T)
    u_f = slope(lambda t: f(T @ exp_reference(t * along)), 0.005)
    nabla = covariant_derivative(connection, u, v, T)
    got = covariant_derivative(connection, u, fv, T)
    assert absolute_error(got - u_f * v.at(T), f(T) * nabla) <= DIFFERENCES
    assert absolute_error(covariant_derivative(connection, fu, v, T), f(T) * nabla) <= DIFFERENCES


@EVERY
def test_torsion_on_varying_fields(connection):
    """nabla_U V - nabla_V U - [U, V] depends on the values at the pose only."""
    T = random_pose(np.random.default_rng(6))
    u, v = _field(7), _field(8)
    a, b = u.at(T), v.at(T)
    bracket = v.along(T, a) - u.along(T, b) + bracket_reference(a, b)
    got = covariant_derivative(connection, u, v, T) - covariant_derivative(connection, v, u, T)
    expected = np.einsum("ijk,i,j->k", connection.torsion, a, b)
    assert absolute_error(got - bracket, expected) <= DIFFERENCES


def test_left_invariant_fields():
    x, y = np.random.default_rng(12).normal(size=(2, 6))
    T = random_pose(np.random.default_rng(13))
    X, Y = Field.left_invariant(x), Field.left_invariant(y)
    for connection in ALL.values():
        assert np.array_equal(covariant_derivative(connection, X, Y, T), connection(x, y))
    assert np.array_equal(X.at(T), x)


def test_field_with_its_derivative():
    """A derivative that is given is used, and agrees with the one by differences."""
    rng = np.random.default_rng(14)
    T, twist = random_pose(rng), 3.0 * rng.normal(size=6)

    def derivative(M):
        # Components (p, 0): p moves with the body velocity turned to F.
        d = np.zeros((6, 6))
        d[:3, 3:] = M[:3, :3]
        return d

    plain = Field(lambda M: np.concatenate([M[:3, 3], np.zeros(3)]))
    given_too = Field(plain.components, derivative)
    assert absolute_error(plain.along(T, twist), given_too.along(T, twist)) <= DIFFERENCES
    assert absolute_error(given_too.along(T, twist)[:3], T[:3, :3] @ twist[3:]) <= ROUNDING


def test_cartan_plus_is_the_transpose():
    assert np.array_equal(CARTAN_PLUS.symbols, 2 * BI_INVARIANT.symbols)
    assert not CARTAN_MINUS.symbols.any()


@pytest.mark.parametrize(
    "nabla",
    [
        lambda x, y: 1.0 + x,
        lambda x, y: x * x * y,
        lambda x, y: x * np.abs(y),
        lambda x, y: np.full(6, 3.0),
        lambda x, y: x * y * (1.0 + 1e-3 * x @ x),
        lambda x, y: np.linalg.norm(x) * y,
    ],
)
def test_maps_that_are_not_bilinear_are_refused(nabla):
    with pytest.raises(InputError, match=r"connection 'mine'.*not linear in both x and y"):
        from_bilinear_map(nabla, "mine")


@given(seeds)
def test_bilinear_maps_are_accepted_with_round_off(seed):
    symbols = np.random.default_rng(seed).normal(size=(6, 6, 6))

    def nabla(x, y):
        return np.einsum("jik,i,j->k", symbols, x, y) * (1.0 + 1e-10 * np.sin(1e3 * x.sum()))

    got = from_bilinear_map(nabla, "mine").symbols
    np.testing.assert_allclose(got, symbols, rtol=1e-9)
    assert not from_bilinear_map(lambda x, y: 0.0 * x).symbols.any()
