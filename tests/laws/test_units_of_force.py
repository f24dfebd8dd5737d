"""One mechanism in several units of force, or as stiff as any other: the answers are the same."""

import numpy as np
import pytest

import cartstiff
from cartstiff import InputError, StiffnessTensor, equilibrium

POSE = [0.02, -0.01, 0.6, 0.1, -0.2, 0.3]
MASS = {"fixed": 3.0, "moving": 2.0, "fixed_com": 0.1, "moving_com": 0.2, "radius": 0.02}
POUND = 4.4482216152605


def hexapod(stiffness, unit="N", **keys):
    rings = {"base": {"radius": 0.5, "half_angle": 0.2}, "height": 0.6}
    legs = {"stiffness": stiffness, "mass": MASS}
    rings["platform"] = {"radius": 0.3, "half_angle": 0.2}
    return cartstiff.hexapod(**rings, legs=legs, units={"force": unit}, **keys)


@pytest.mark.parametrize(("unit", "newtons"), [("kN", 1e3), ("lbf", POUND)])
def test_weights_of_body_and_legs(unit, newtons):
    """In kg everywhere: tensions and stiffness are the same, in the other unit."""
    keys = {"gravity": [1.0, 0.0, -9.81], "payload": {"mass": 4.0, "com": [0.0, 0.0, 0.1]}}
    here = cartstiff.analyse(hexapod(2e5, **keys), POSE)
    there = cartstiff.analyse(hexapod(2e5 / newtons, unit, **keys), POSE)
    assert there.tensions * newtons == pytest.approx(here.tensions, rel=1e-9)
    assert there.B.matrix * newtons == pytest.approx(here.B.matrix, rel=1e-9, abs=1e-4)
    alone = cartstiff.analyse(hexapod(2e5, gravity=keys["gravity"]), POSE)
    weight = 6 * (MASS["fixed"] + MASS["moving"]) * 9.81
    assert 0.2 * weight < -alone.tensions.sum() < 2.0 * weight


@pytest.mark.parametrize("size", [1e-17, 1e-3, 1e6])
@pytest.mark.parametrize("spread", [1.0, 3e8])
def test_softer_springs_under_smaller_loads_move_as_far(size, spread):
    """Displacements by k and W are those by s k and s W, also of legs that differ by far."""
    legs, load = np.array([1.0, spread, 2.0, spread, 3.0, 1.5]), [0.0, 0.0, 0.0, 0.3, -0.2, -0.5]
    one = equilibrium(hexapod((1e3 * legs).tolist()), wrench=load)
    other = equilibrium(
        hexapod((size * 1e3 * legs).tolist()), wrench=(size * np.array(load)).tolist()
    )
    assert other.displacement == pytest.approx(one.displacement, rel=1e-8, abs=1e-11)
    assert (other.iterations, other.stable) == (one.iterations, True)
    moved = cartstiff.analyse(one.elastic, one.q, wrench=load)
    same = cartstiff.analyse(other.elastic, other.q, wrench=(size * np.array(load)).tolist())
    assert same.tangent / size == pytest.approx(moved.tangent, rel=1e-6, abs=1e-6)
    assert [n.code for n in same.notes] == [n.code for n in moved.notes]


def test_a_kind_of_load_is_for_springs_that_may_carry_one():
    """A given rest position loads the body; where all follow the posture nothing does."""
    arm = cartstiff.load("ur5")
    wound = arm.with_springs(rest=arm.q + 0.01)
    kinds = ("dead", "follower")
    dead, follower = (cartstiff.analyse(wound, load_kind=kind).tangent for kind in kinds)
    assert np.abs(dead - follower).max() > 1.0
    with pytest.raises(InputError, match="load"):
        cartstiff.analyse(arm, load_kind="follower")


def test_a_matrix_of_small_numbers_is_unsymmetric_too():
    """Beside its own largest entry, not beside one."""
    K = 1e-15 * (np.eye(6) + np.eye(6, k=1))
    with pytest.raises(InputError, match="symmetric"):
        StiffnessTensor.from_controller(K, axes="body")
    assert StiffnessTensor.from_controller(K + K.T, axes="body").shape == (6, 6)
