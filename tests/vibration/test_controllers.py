"""Damping of impedance controllers, and the same stiffness in the dress of controllers."""

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.doors import double_diagonalisation, square_root_damping
from tests.support import random_pose
from tests.support.commands import answer, refuses, run

from cartstiff import InputError, StiffnessTensor, UndefinedError, analyse, load, modes
from cartstiff.extend import in_units
from cartstiff.vibration import impedance


def _random(rng, spread):
    """Symmetric positive definite, eigenvalues over some decades."""
    Q, _ = np.linalg.qr(rng.normal(size=(6, 6)))
    return (Q * 10.0 ** rng.uniform(0, spread, 6)) @ Q.T


@settings(max_examples=25)
@given(seed=st.integers(0, 10**6), ratio=st.floats(0.0, 2.0))
def test_double_diagonalisation_makes_all_three_diagonal(seed, ratio):
    rng = np.random.default_rng(seed)
    M, K = _random(rng, 2), _random(rng, 3)
    M, K = 0.5 * (M + M.T), 0.5 * (K + K.T)
    D, V, squares = double_diagonalisation(M, K, ratio)
    omega = np.sqrt(squares)
    # Each entry over those of the diagonal, which a basis of such condition leaves 1e-12.
    for matrix, diagonal in ((M, np.ones(6)), (K, squares), (D, 2 * ratio * omega)):
        size = np.abs(V.T) @ np.abs(matrix) @ np.abs(V)
        left = np.abs(V.T @ matrix @ V - np.diag(diagonal))
        assert (left <= 1e-12 * size + 1e-300).all()


def test_damping_that_was_asked_for():
    rng = np.random.default_rng(1)
    M, K = np.diag([2.0, 3.0, 4.0, 1.0, 1.0, 5.0]), np.diag([8.0, 3.0, 1.0, 9.0, 4.0, 5.0])
    wanted = 2 * 0.7 * np.sqrt(np.diag(M) * np.diag(K))
    assert double_diagonalisation(M, K, 0.7)[0] == pytest.approx(np.diag(wanted))
    assert square_root_damping(M, K, 0.7) == pytest.approx(np.diag(wanted))
    M, K = _random(rng, 1), _random(rng, 1)
    M, K = 0.5 * (M + M.T), 0.5 * (K + K.T)
    ratios = [0.1, 0.2, 0.4, 0.6, 0.8, 0.9]
    D, _, squares = double_diagonalisation(M, K, ratios)
    n = np.zeros((6, 6))
    poles = np.linalg.eigvals(
        np.block([[n, np.eye(6)], [-np.linalg.solve(M, K), -np.linalg.solve(M, D)]])
    )
    upper = poles[poles.imag > 0]
    upper = upper[np.argsort(np.abs(upper))]
    assert np.abs(upper) ** 2 == pytest.approx(squares)
    assert -upper.real / np.abs(upper) == pytest.approx(ratios)
    for bad, words in (
        ((-M, K), "mass is not positive definite"),
        ((M, -K), "not positive semidefinite"),
        ((M, K + np.triu(np.ones((6, 6)), 1)), "not symmetric"),
    ):
        with pytest.raises(InputError, match=words):
            double_diagonalisation(*bad)
    with pytest.raises(InputError, match="damping ratios"):
        double_diagonalisation(M, K, [0.1, 0.2])


def test_equal_frequencies_do_not_hang_on_rounding():
    """Two stiffnesses that are equal but for rounding: any basis of their plane serves."""
    K = np.diag([10.0, 30.0, 20.0, 2000.0, 2000.0, 500.0])
    noise = np.zeros((6, 6))
    noise[3, 4] = noise[4, 3] = 4e-13
    plain, noisy = (double_diagonalisation(np.eye(6), A, 0.7)[0] for A in (K, K + noise))
    assert noisy == pytest.approx(plain, abs=1e-9)
    assert plain == pytest.approx(np.diag(1.4 * np.sqrt(np.diag(K))))
    same = [0.1, 0.2, 0.3, 0.4, 0.5, 0.5]
    plain, noisy = (double_diagonalisation(np.eye(6), A, same)[0] for A in (K, K + noise))
    assert noisy == pytest.approx(plain, abs=1e-9)
    with pytest.raises(InputError, match="oscillators 5 and 6 have the same frequency"):
        double_diagonalisation(np.eye(6), K + noise, [0.1, 0.2, 0.3, 0.4, 0.5, 0.6])


def test_impedance_of_an_arm():
    found = modes(load("panda"))
    K = np.diag([30.0, 30, 20, 1000, 1500, 800])
    answer = impedance(found, K, 0.7)
    J = found.posture.motion.jacobian
    assert answer.joint_damping == pytest.approx(J.T @ answer.damping @ J)
    back = J @ np.linalg.inv(found.full_mass) @ J.T
    assert answer.mass @ back == pytest.approx(np.eye(6), abs=1e-8)
    assert 0 < answer.coupling < 1
    # The physical wrench of another frame of rows and columns is the same controller.
    pose = found.posture.pose
    tensor = StiffnessTensor(K, analyse(load("panda")).B.connection, np.zeros(6), pose)
    base = tensor.as_controller(order="linear-angular", axes="base")
    again = StiffnessTensor.from_controller(base, pose=pose)
    assert impedance(found, again, 0.7).damping == pytest.approx(answer.damping, rel=1e-9)
    with pytest.raises(UndefinedError, match="masses as the body feels"):
        impedance(modes(load("five-bar")), K)


@pytest.mark.parametrize("unit", ["cm", "mm", "in"])
def test_impedance_in_any_unit(unit):
    """One controller of one arm: frequencies and ratios are numbers without lengths."""
    K = np.diag([30.0, 30, 20, 1000, 1500, 800])
    inches = {"cm": 100.0, "mm": 1000.0, "in": 1 / 0.0254}[unit]
    to_unit = np.repeat([inches, 1.0], 3)  # N m/rad and N/m: one length more in each rotation
    scale = np.sqrt(np.outer(to_unit, to_unit) / np.outer(inches / to_unit, inches / to_unit))
    one = impedance(modes(load("panda")), K, 0.7)
    other = impedance(modes(in_units(load("panda"), unit)), K * scale, 0.7)
    assert other.damping == pytest.approx(one.damping * scale, rel=1e-9, abs=1e-9)
    assert other.by_square_roots == pytest.approx(one.by_square_roots * scale, rel=1e-6, abs=1e-9)
    assert other.frequencies == pytest.approx(one.frequencies, rel=1e-9)
    assert other.ratios == pytest.approx(one.ratios, rel=1e-6)
    assert other.coupling == pytest.approx(one.coupling, rel=1e-6)
    assert other.null_masses == pytest.approx(inches * one.null_masses, rel=1e-9)


def test_from_controller_and_back():
    rng = np.random.default_rng(3)
    K, pose = _random(rng, 2), random_pose(rng)
    K = 0.5 * (K + K.T)
    for order in ("linear-angular", "angular-linear"):
        for axes in ("body", "base", "world"):
            tensor = StiffnessTensor.from_controller(K, order=order, axes=axes, pose=pose)
            assert tensor.pose == pytest.approx(pose)
            assert tensor.as_controller(order=order, axes=axes) == pytest.approx(K, rel=1e-10)
    # Base axes, translation first: the translational block is turned.
    tensor = StiffnessTensor.from_controller(K, pose=pose).to_order("angular-linear")
    R = pose[:3, :3]
    assert R @ tensor.matrix[3:, 3:] @ R.T == pytest.approx(K[:3, :3])
    refuses("base axes need the pose", StiffnessTensor.from_controller, K)
    refuses(
        "not symmetric",
        StiffnessTensor.from_controller,
        K + np.triu(np.ones((6, 6)), 1),
        axes="body",
    )
    refuses("unknown axes", tensor.as_controller, axes="tool")
    refuses("unknown axes", StiffnessTensor.from_controller, K, axes="tool", pose=pose)


def test_base_axes_turn_with_the_base():
    rng = np.random.default_rng(4)
    K, pose, base = _random(rng, 2), random_pose(rng), random_pose(rng)
    K = 0.5 * (K + K.T)
    tensor = StiffnessTensor.from_controller(K, axes="base", pose=pose, base=base)
    assert tensor.as_controller(axes="base") == pytest.approx(K, rel=1e-10)
    # The base's axes in the room: a plain rotation of each block.
    R = np.kron(np.eye(2), base[:3, :3])
    assert tensor.as_controller(axes="world") == pytest.approx(R @ K @ R.T, rel=1e-10)
    again = StiffnessTensor.from_dict(json.loads(tensor.as_json()))
    assert again.as_controller(axes="base") == pytest.approx(K, rel=1e-10)


def test_command(tmp_path):
    wanted, out = tmp_path / "wanted.json", tmp_path / "controller.yaml"
    K = np.diag([1000.0, 1500, 800, 30, 30, 20]).tolist()
    wanted.write_text(json.dumps({"matrix": K, "order": "linear-angular"}))
    arguments = f"modes 6-ups --impedance {wanted} --axes base -o {out}"
    data = answer(arguments)["impedance"]
    shown = data["for_controller"]
    assert (shown["order"], shown["axes"]) == ("linear-angular", "base")
    assert shown["stiffness"] == pytest.approx(np.diag(np.diag(K)), abs=1e-9)
    # The damping belongs to the same order and axes: D = 2 zeta sqrt(K M) for one oscillator.
    assert np.linalg.eigvalsh(shown["damping"]).min() > 0.0
    from ruamel.yaml import YAML

    written = YAML(typ="safe").load(out.read_text())
    assert written["damping"] == data["damping"]
    assert "double diagonalisation" in run(arguments)
    assert "is for --impedance" in run("modes 6-ups --ratio 0.7", code=2)
    wanted.write_text(json.dumps((1.7e308 * np.eye(6)).tolist()))  # its double is no number
    refused = run(f"modes 6-ups --impedance {wanted}", code=2)
    assert "number is too large; expected at most 1e+30" in refused
