"""The stiffness tensor: symmetry, frames, connections, orders, units, splits, files."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from tests.doors import NAMED, Field, Units, convert_length, format_matrix
from tests.support import (
    absolute_error,
    adjoint_reference,
    cross_matrix,
    general_legs,
    hessian_of,
    legs_as_platform,
    loaded_arm,
    matrices_from,
    paper_geometry,
    paper_platform,
    plain_twists,
    poses,
    random_pose,
    relative_error,
    seeds,
)
from tests.support.commands import refuses

from cartstiff import StiffnessTensor, analyse
from cartstiff.geometry import (
    BI_INVARIANT,
    CARTAN_MINUS,
    CARTAN_PLUS,
    KINEMATIC,
    from_symbols,
    levi_civita,
    paper,
    se3,
)

ROUNDING = 1e-12
# Ad is squared and its entries reach three: rounding grows by a hundred.
FRAMES = 1e-11
# Second differences of the paper's energy.
DIFFERENCES = 1e-8

ORDERS = ("angular-linear", "linear-angular")


def _user_connections():
    rng = np.random.default_rng(1)
    G = rng.normal(size=(6, 6))
    return {
        **NAMED,
        "metric": levi_civita(G @ G.T + 6 * np.eye(6)),
        "user": from_symbols(rng.normal(size=(6, 6, 6)), "mine"),
    }


CONNECTIONS = _user_connections()
EVERY = pytest.mark.parametrize("name", CONNECTIONS)


def _tensor(seed: int, name: str = "A") -> StiffnessTensor:
    """A tensor with the asymmetry that its load dictates."""
    rng = np.random.default_rng(seed)
    K, W = rng.normal(size=(6, 6)) + 5 * np.eye(6), rng.normal(size=6)
    K_B = 0.5 * (K + K.T)
    base = StiffnessTensor(K_B, BI_INVARIANT, W, random_pose(rng), "tool", Units("cm", "N"))
    return base.to_connection(CONNECTIONS[name])


@EVERY
@given(seeds)
def test_predicted_asymmetry(name, seed):
    """Eq. 50: K - K^T follows from load and torsion."""
    tensor = _tensor(seed, name)
    for order in ORDERS:
        t = tensor.to_order(order)
        assert absolute_error(t.asymmetry, t.predicted_asymmetry) <= ROUNDING * 10
        assert np.array_equal(t.asymmetry, t.matrix - t.matrix.T)
        assert np.array_equal(t.symmetric_part, 0.5 * (t.matrix + t.matrix.T))
    if tensor.connection.is_symmetric:  # proposition 4.1
        assert np.abs(tensor.asymmetry).max() <= ROUNDING


def test_asymmetry_by_hand():
    """K^A - K^A^T = [[tau, f], [f, 0]] in cross-product matrices."""
    tensor = _tensor(3)
    t, f = cross_matrix(tensor.wrench[:3]), cross_matrix(tensor.wrench[3:])
    expected = np.block([[t, f], [f, np.zeros((3, 3))]])
    assert absolute_error(tensor.asymmetry, expected) <= ROUNDING
    # Without symmetry of the connection, another matrix.
    plus = tensor.to_connection("+")
    assert np.abs(plus.asymmetry + expected).max() <= ROUNDING
    assert absolute_error(plus.matrix, tensor.matrix.T) <= ROUNDING


@given(seeds)
def test_connections_by_hand(seed):
    tensor = _tensor(seed)
    for name, K in matrices_from(tensor.matrix, tensor.wrench).items():
        assert absolute_error(tensor.to_connection(name).matrix, K) <= ROUNDING


@EVERY
def test_connection_round_trip(name):
    tensor = _tensor(4)
    there = tensor.to_connection(CONNECTIONS[name])
    assert there.connection is CONNECTIONS[name]
    back = there.to_connection("A")
    assert absolute_error(back.matrix, tensor.matrix) <= ROUNDING
    assert np.array_equal(back.wrench, tensor.wrench)


def test_no_load_no_choice():
    """At W = 0 every connection gives the same matrix."""
    tensor = _tensor(5)
    free = StiffnessTensor(tensor.matrix, CARTAN_MINUS, np.zeros(6))
    for connection in CONNECTIONS.values():
        assert np.array_equal(free.to_connection(connection).matrix, tensor.matrix)


# -- frames -------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", [n for n in CONNECTIONS if n != "K"])
@given(seeds, poses(["generic", "near identity", "at pi"]))
def test_change_of_frame(name, seed, h):
    """K' = Ad^T K Ad, W' = Ad^T W, for a connection that is carried along."""
    tensor = _tensor(seed, name)
    a = adjoint_reference(h)
    moved = tensor.to_frame(h, "flange")
    size = max(1.0, np.abs(a).max()) ** 2 * np.abs(tensor.matrix).max()
    assert absolute_error(moved.matrix, a.T @ tensor.matrix @ a) <= FRAMES * size
    assert absolute_error(moved.wrench, a.T @ tensor.wrench) <= FRAMES * size
    assert absolute_error(moved.pose, tensor.pose @ h) <= ROUNDING
    assert moved.frame == "flange"
    assert moved.units == tensor.units
    # The asymmetry of the moved tensor is still that of its load and connection.
    assert absolute_error(moved.asymmetry, moved.predicted_asymmetry) <= FRAMES * size * 100


@given(seeds, poses(["generic", "near identity", "at pi"]))
def test_kinematic_is_recomputed(seed, h):
    """Under the same name it is another connection: from K^A' and W', not by Ad."""
    tensor = _tensor(seed, "K")
    a = adjoint_reference(h)
    moved = tensor.to_frame(h)
    W = a.T @ tensor.wrench
    K_A = a.T @ tensor.to_connection("A").matrix @ a
    size = max(1.0, np.abs(a).max()) ** 2 * np.abs(tensor.matrix).max()
    assert moved.connection is KINEMATIC
    assert absolute_error(moved.matrix, matrices_from(K_A, W)["K"]) <= FRAMES * size


@pytest.mark.parametrize("name", ["A", "B", "K", "+"])
@pytest.mark.parametrize("order", ORDERS)
def test_frame_there_and_back(name, order):
    h = random_pose(np.random.default_rng(6))
    tensor = _tensor(6, name).to_order(order)
    back = tensor.to_frame(h).to_frame(np.linalg.inv(h), "tool")
    assert back.order == order
    assert absolute_error(back.matrix, tensor.matrix) <= FRAMES * 100
    assert absolute_error(back.wrench, tensor.wrench) <= FRAMES
    assert absolute_error(back.pose, tensor.pose) <= ROUNDING


@pytest.mark.parametrize("kind", ["arm", "platform"])
def test_frame_change_equals_a_run_with_that_frame(kind):
    """The engine run with the offset frame, all connections, K^K and K^F included."""
    h = random_pose(np.random.default_rng(7), 0.4)
    if kind == "arm":
        arm = loaded_arm("RRRPRR", 7)
        a = adjoint_reference(h)
        at_tip = analyse(arm.elastic)
        moved = analyse(loaded_arm("RRRPRR", 7, offset=h).elastic, wrench=a.T @ arm.wrench)
    else:
        legs = general_legs()
        at_tip = analyse(legs_as_platform(legs))
        moved = analyse(legs_as_platform(legs, T_P_M=h))
    for name in "ABKF":
        expected = moved.tensor(name)
        got = at_tip.tensor(name).to_frame(h)
        assert relative_error(got.matrix, expected.matrix) <= FRAMES, name
        assert relative_error(got.wrench, expected.wrench) <= FRAMES
        assert relative_error(got.pose, expected.pose) <= ROUNDING
    # The flat connection is carried, symbols and all.
    got = at_tip.F.to_frame(h).connection.symbols
    assert relative_error(got, moved.F.connection.symbols) <= 1e-9


# -- orders -------------------------------------------------------------------------------------


@EVERY
def test_orders(name):
    tensor = _tensor(8, name)
    other = tensor.to_order("linear-angular")
    p = [3, 4, 5, 0, 1, 2]
    assert np.array_equal(other.matrix, tensor.matrix[p][:, p])
    assert np.array_equal(other.wrench, tensor.wrench[p])
    back = other.to_order("angular-linear")
    assert np.array_equal(back.matrix, tensor.matrix)
    assert tensor.to_order("angular-linear") is tensor
    # Everything else commutes with the order.
    h = random_pose(np.random.default_rng(8))
    for change in (
        lambda t: t.to_frame(h),
        lambda t: t.to_connection("K"),
        lambda t: t.to_units("m", "kN"),
    ):
        a, b = change(other), change(tensor).to_order("linear-angular")
        assert relative_error(a.matrix, b.matrix) <= ROUNDING
        assert relative_error(a.wrench, b.wrench) <= ROUNDING
        assert a.order == "linear-angular"


@given(seeds, plain_twists, plain_twists)
def test_on_twists_and_fields(seed, x, y):
    """K(X, Y) = X^T K Y: numbers in the tensor's order, fields in their own."""
    tensor = _tensor(seed)
    other = tensor.to_order("linear-angular")
    expected = x @ tensor.matrix @ y
    assert abs(tensor(x, y) - expected) <= ROUNDING * 1000
    X, Y = Field.left_invariant(x), Field.left_invariant(y)
    p = [3, 4, 5, 0, 1, 2]
    assert abs(tensor(X, Y) - expected) <= ROUNDING * 1000
    assert abs(other(X, Y) - expected) <= ROUNDING * 1000
    assert abs(other(x[p], y[p]) - expected) <= ROUNDING * 1000
    assert abs(other(X, y[p]) - expected) <= ROUNDING * 1000
    assert abs(other(x[p], Y) - expected) <= ROUNDING * 1000


# -- units --------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["A", "B", "K", "F"])
def test_units_equal_a_run_in_those_units(name):
    """Centimetres to metres: the numbers of the same machine drawn in metres."""
    in_cm = analyse(paper_platform()).tensor(name)
    in_m = analyse(paper_platform(scale=0.01)).tensor(name)
    got = in_cm.to_units("m", "N")
    assert relative_error(got.matrix, in_m.matrix) <= ROUNDING
    assert relative_error(got.wrench, in_m.wrench) <= ROUNDING
    assert relative_error(got.pose, in_m.pose) <= ROUNDING
    assert relative_error(got.connection.symbols, in_m.connection.symbols) <= ROUNDING * 10
    assert got.units == Units("m", "N")
    assert got.connection.name == name


def test_units_with_a_pose():
    """The pose's translation is a length as well."""
    legs = general_legs()
    in_m = analyse(legs_as_platform(legs)).tensor("K")
    in_mm = in_m.to_units("mm", "kN")
    assert absolute_error(in_mm.pose[:3, 3], 1000 * legs.q[:3]) <= ROUNDING * 1000
    assert np.array_equal(in_mm.pose[:3, :3], in_m.pose[:3, :3])
    s = np.array([1e3] * 3 + [1.0] * 3)
    expected = 1e-3 * in_m.matrix * np.outer(s, [1, 1, 1, 1e-3, 1e-3, 1e-3])
    assert relative_error(in_mm.matrix, expected) <= ROUNDING
    assert relative_error(in_mm.wrench, 1e-3 * in_m.wrench * s) <= ROUNDING


@EVERY
@pytest.mark.parametrize(
    "units", [("mm", "N"), ("in", "lbf"), ("m", "kN"), ("ft", "kgf"), ("um", "mN"), ("dm", "daN")]
)
def test_unit_round_trip(name, units):
    tensor = _tensor(9, name)
    there = tensor.to_units(*units)
    assert (there.units.length, there.units.force) == units
    assert (
        absolute_error(there.asymmetry, there.predicted_asymmetry)
        <= 1e-10 * np.abs(there.matrix).max()
    )
    back = there.to_units("cm", "N")
    assert relative_error(back.matrix, tensor.matrix) <= ROUNDING
    assert relative_error(back.wrench, tensor.wrench) <= ROUNDING
    assert relative_error(back.pose, tensor.pose) <= ROUNDING
    assert relative_error(back.connection.symbols + 1, tensor.connection.symbols + 1) <= ROUNDING


def test_unit_factors():
    assert convert_length(Units("in", "lbf"), Units("mm", "N")) == pytest.approx(
        (25.4, 4.4482216152605), rel=1e-15
    )
    assert convert_length(Units("ft", "kgf"), Units("m", "N")) == pytest.approx(
        (0.3048, 9.80665), rel=1e-15
    )
    assert Units("cm", "N").moment == "N cm"
    assert Units("cm", "N").to_dict() == {"length": "cm", "force": "N", "angle": "rad"}


def test_energy_of_a_motion_keeps_its_value():
    """x K x / 2 is an energy: half a degree of turn and 2 mm of travel, in any units."""
    tensor = _tensor(10, "B")
    x = np.array([0.01, 0.0, -0.005, 0.2, 0.1, 0.0])  # rad, cm
    x_mm = x * np.array([1, 1, 1, 10, 10, 10])
    assert tensor.to_units("mm", "N")(x_mm, x_mm) == pytest.approx(10 * tensor(x, x), rel=1e-12)


# -- compliance ---------------------------------------------------------------------------------


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("name", ["A", "B", "K", "F"])
def test_compliance_is_the_inverse(name, order):
    for result in (analyse(paper_platform()), analyse(loaded_arm("RRRRRR", 3).elastic)):
        tensor = result.tensor(name).to_order(order)
        C = tensor.compliance()
        assert absolute_error(C.matrix @ tensor.matrix, np.eye(6)) <= 1e-9
        assert relative_error(C.matrix, np.linalg.inv(tensor.matrix)) <= 1e-10
        assert (C.order, C.frame, C.units) == (order, tensor.frame, tensor.units)
        assert C.connection.name == name
        assert (
            relative_error(result.compliances[name], result.tensor(name).compliance().matrix)
            <= 1e-10
        )
        assert np.array_equal(np.asarray(C), C.matrix)
        there = C.to_order("linear-angular").to_order("angular-linear")
        assert np.array_equal(there.matrix, C.to_order("angular-linear").matrix)


@pytest.mark.parametrize("name", ["+", CARTAN_PLUS, "load"])
def test_tensors_without_a_letter_have_their_own_inverse(name):
    """K^+ is K^A transposed, under a load another matrix; its inverse is transposed with it."""
    result = analyse(loaded_arm("RRRRRR", 3).elastic)
    K, C = result.tensor(name), result.tensor(name).compliance()
    assert absolute_error(C.matrix @ K.matrix, np.eye(6)) <= 1e-9
    if name != "load":
        assert np.array_equal(K.matrix, result.tensor("A").T)
        assert relative_error(K.matrix, result.tensor("A").matrix) > 1e-3


def test_compliance_units():
    C = _tensor(11, "B").compliance()
    assert C.block_units == (("rad/(N cm)", "rad/N"), ("cm/(N cm)", "cm/N"))
    assert C.to_order("linear-angular").block_units == (
        ("cm/N", "cm/(N cm)"),
        ("rad/N", "rad/(N cm)"),
    )
    text = str(C)
    assert text.splitlines()[0] == "C^B in tool, order angular-linear"
    assert "rad/(N cm)" in text.splitlines()[1]
    assert "cm/N" in text.splitlines()[6]


# -- the three terms ----------------------------------------------------------------------------


@EVERY
@given(seeds)
def test_split_adds_up(name, seed):
    tensor = _tensor(seed, name)
    for order in ORDERS:
        t = tensor.to_order(order)
        first, second, third = t.split()
        assert absolute_error(first + second + third, t.matrix) <= ROUNDING
        assert absolute_error(first, first.T) <= ROUNDING * 10
    first, second, third = tensor.split()
    reference = tensor.to_connection("A").split()
    assert absolute_error(first, reference[0]) <= ROUNDING * 10  # independent of the connection
    assert np.array_equal(second, reference[1])
    assert not reference[2].any()


def test_first_term_is_the_hessian_in_the_paper_chart():
    """Eq. 52 at the identity, for the paper's platform, in the chart of section 2.4."""
    base, points, k, rest = paper_geometry()

    def energy(xi):
        T = paper.pose(xi)
        along = points @ T[:3, :3].T + T[:3, 3] - base
        return 0.5 * float(k @ (np.linalg.norm(along, axis=1) - rest) ** 2)

    hessian = hessian_of(energy, np.array([1, 1, 1, 10, 10, 10.0]))
    for name in "ABK":
        first, _, _ = analyse(paper_platform()).tensor(name).split()
        assert relative_error(first, hessian) <= DIFFERENCES


def test_second_and_third_terms_by_hand():
    """E_j(alpha_i^k) W_k in the chart of section 2.4, and eq. 55 and 56 with W = +dPhi."""
    tensor = _tensor(12)
    w1, w2, w3, w4, w5, w6 = tensor.wrench
    second = np.zeros((6, 6))
    # A column for the direction of motion: later coordinates change earlier fields.
    second[0, 1], second[0, 2], second[1, 2] = -w3, w2, -w1
    second[:3, 3:] = -np.array([[0, w6, -w5], [-w6, 0, w4], [w5, -w4, 0]])
    assert absolute_error(tensor.split()[1], second) <= ROUNDING
    t, f = cross_matrix(tensor.wrench[:3]), cross_matrix(tensor.wrench[3:])
    o = np.zeros((3, 3))
    third = {"A": np.zeros((6, 6)), "K": -np.block([[0.5 * t, o], [f, o]])}
    third["B"] = -0.5 * np.block([[t, f], [f, o]])
    for name, expected in third.items():
        assert absolute_error(tensor.to_connection(name).split()[2], expected) <= ROUNDING


# -- the object and its files -------------------------------------------------------------------


def test_arrays_are_read_only_copies():
    K = np.eye(6)
    tensor = StiffnessTensor(K, CARTAN_MINUS, np.zeros(6))
    K[0, 0] = 7
    assert tensor.matrix[0, 0] == 1
    for array in (tensor.matrix, tensor.wrench, tensor.pose):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1
    assert np.array_equal(np.asarray(tensor), np.eye(6))
    with pytest.raises(AttributeError, match="cannot assign"):
        tensor.frame = "other"


def test_sums_multiples_and_products_are_arrays():
    K, x = _tensor(12, "B"), np.arange(6.0)
    assert K.shape == (6, 6)
    assert np.array_equal(K + K, 2 * K)
    assert np.array_equal(K / 2, 0.5 * K)
    assert np.array_equal(K * 2 - K, K.matrix)
    assert np.array_equal(K + np.eye(6), K.matrix + np.eye(6))
    assert np.array_equal(K @ x, K.matrix @ x)
    refuses("units of the other matrix; expected", lambda: K + K.to_units("mm", "N"))
    refuses("order of the other matrix", lambda: K + K.to_order("linear-angular"))
    refuses("connection of the other matrix; expected B, got A", lambda: K - K.to_connection("A"))
    refuses("letter of the other matrix; expected K, got C", lambda: K + K.compliance())
    there = replace(K, pose=K.pose @ se3.exp([0, 0, 0, 0, 0, 1e-3]))
    refuses("pose of the other matrix", lambda: K + there)


def test_numpy_gets_its_own_copy():
    tensor = _tensor(13)
    free = np.asarray(tensor)
    free[0, 0] = 1e9
    assert tensor.matrix[0, 0] != 1e9
    assert np.array(tensor, dtype=np.float32).dtype == np.float32


@pytest.mark.parametrize("order", ORDERS)
@EVERY
def test_json_round_trip(name, order):
    tensor = _tensor(14, name).to_order(order)
    again = StiffnessTensor.from_dict(json.loads(tensor.as_json()))
    for part in ("matrix", "wrench", "pose"):
        assert np.array_equal(getattr(again, part), getattr(tensor, part))
    assert (again.frame, again.units, again.order) == (tensor.frame, tensor.units, tensor.order)
    assert again.connection.name == tensor.connection.name
    assert np.array_equal(again.connection.symbols, tensor.connection.symbols)


def test_json_of_a_flat_connection():
    """Symbols known at one posture only, and flat, after a round trip as well."""
    tensor = analyse(paper_platform()).F
    again = StiffnessTensor.from_dict(json.loads(tensor.as_json()))
    assert np.array_equal(again.connection.symbols, tensor.connection.symbols)
    assert again.connection.left_invariant == tensor.connection.left_invariant


@pytest.mark.parametrize(
    "connection",
    [
        from_symbols(np.ones((6, 6, 6)), "B"),
        KINEMATIC.carried_to(random_pose(np.random.default_rng(17))),
    ],
    ids=["named B", "carried K"],
)
def test_json_of_a_connection_that_borrows_a_name(connection):
    """The symbols decide, not the name."""
    tensor = _tensor(17).to_connection(connection)
    again = StiffnessTensor.from_dict(json.loads(tensor.as_json()))
    assert np.array_equal(again.connection.symbols, connection.symbols)


def test_flat_connection_of_a_result():
    """Known at one posture, symmetric, without curvature."""
    for result in (analyse(paper_platform()), analyse(loaded_arm("RRRRRR", 3).elastic)):
        connection = result.F.connection
        assert not connection.left_invariant
        assert not connection.is_bi_invariant
        assert np.abs(connection.torsion).max() <= 1e-9 * np.abs(connection.symbols).max()
        assert connection.is_flat


@pytest.mark.parametrize("order", ORDERS)
def test_files(tmp_path, order):
    tensor = _tensor(15).to_order(order)
    for ending in ("json", "csv", "npz"):
        tensor.save(tmp_path / f"K.{ending}")
        tensor.save(str(tmp_path / f"again.{ending}"))
    data = json.loads((tmp_path / "K.json").read_text(encoding="utf-8"))
    assert np.array_equal(StiffnessTensor.from_dict(data).matrix, tensor.matrix)
    assert np.array_equal(np.loadtxt(tmp_path / "K.csv", delimiter=","), tensor.matrix)
    first = (tmp_path / "K.csv").read_text(encoding="utf-8").splitlines()[0]
    assert first.startswith("# K^A, frame tool, order " + order)
    with np.load(tmp_path / "K.npz") as archive:
        assert np.array_equal(archive["matrix"], tensor.matrix)
        assert np.array_equal(archive["wrench"], tensor.wrench)
        assert np.array_equal(archive["pose"], tensor.pose)
        described = StiffnessTensor.from_dict(json.loads(str(archive["description"])))
    assert np.array_equal(described.matrix, tensor.matrix)
    assert described.order == order


def test_text():
    tensor = _tensor(16)
    assert tensor.block_units == (("N cm/rad", "N"), ("N/rad", "N/cm"))
    lines = str(tensor).splitlines()
    assert lines[0] == "K^A in tool, order angular-linear"
    assert len(lines) == 7
    assert lines[1].endswith("[N cm/rad | N]")
    assert lines[6].endswith("[N/rad | N/cm]")
    numbers = [float(x) for x in lines[3].split("[")[0].split()]
    assert np.allclose(numbers, tensor.matrix[2], rtol=1e-5)
    other = tensor.to_order("linear-angular")
    assert other.block_units == (("N/cm", "N/rad"), ("N", "N cm/rad"))
    assert str(other).splitlines()[1].endswith("[N/cm | N/rad]")


def test_rounding_dust_is_not_printed():
    text = format_matrix(np.array([[1.0, 1e-17], [0.25, -2e-15]]), ["N", ""], "title")
    assert [line.split() for line in text.splitlines()] == [
        ["title"],
        ["1", "0", "N"],
        ["0.25", "0"],
    ]
    assert "-2e-13" in format_matrix(np.array([[1.0, -2e-13]]), ["N"])
