"""A mechanism in millimetres is the same mechanism: every number is converted, in one place."""

from dataclasses import replace

import numpy as np
import pytest
from tests.doors import TabulatedLaw
from tests.support import refused

import cartstiff
from cartstiff import JointFunction
from cartstiff.extend import in_units

SLIDING = """<robot name='r'><link name='l0'/>
<link name='l1'><inertial><mass value='3'/><origin xyz='.1 .02 .3'/>
<inertia ixx='.1' iyy='.2' izz='.25' ixy='0' ixz='0' iyz='0'/></inertial></link>
<link name='l2'><inertial><mass value='2'/><origin xyz='.2 0 0'/>
<inertia ixx='.1' iyy='.2' izz='.15' ixy='0' ixz='0' iyz='0'/></inertial></link>
<link name='l3'/><link name='tool0'/>
<joint name='a' type='revolute'><parent link='l0'/><child link='l1'/><axis xyz='0 0 1'/>
<origin xyz='0 0 .4'/><limit lower='-2' upper='2' effort='1' velocity='1'/></joint>
<joint name='b' type='prismatic'><parent link='l1'/><child link='l2'/><axis xyz='0 1 0'/>
<origin xyz='.3 .1 0' rpy='.2 0 .4'/>
<limit lower='-.2' upper='.5' effort='1' velocity='1'/></joint>
<joint name='c' type='revolute'><parent link='l2'/><child link='l3'/><axis xyz='1 0 0'/>
<origin xyz='.2 0 .1'/><mimic joint='b' multiplier='2' offset='.1'/>
<limit lower='-2' upper='2' effort='1' velocity='1'/></joint>
<joint name='f' type='fixed'><parent link='l3'/><child link='tool0'/>
<origin xyz='.1 .2 .3'/></joint></robot>"""


@pytest.mark.parametrize("pieces", ["linear", "smooth"])
def test_a_table_in_other_units_is_the_same_law(pieces):
    """Force of a spring by its deflection, in m and N, and in mm and kN."""
    law = TabulatedLaw((-0.02, 0.0, 0.01, 0.03), (-5.0, 0.0, 1.0, 9.0), pieces)
    other = law.in_units(1e3, 1e-3)
    for x in (-0.015, 0.004, 0.02):
        energy, force, stiffness = law.evaluate(x)
        assert other.evaluate(1e3 * x) == pytest.approx((energy, 1e-3 * force, 1e-6 * stiffness))


NAMES = [
    "ur5",
    "panda",
    "delta",
    "stewart-gough",
    "hexapod",
    "cubic",
    "five-bar",
    "cable-robot",
    "grasp",
    "finger",
    "sliding",
]


def loaded(name):
    if name == "sliding":
        return cartstiff.load(SLIDING, gravity=[0, 0, -9.81], payload=[1.0, 0.1, 0.0, 0.2])
    if name == "finger":
        from pathlib import Path

        return cartstiff.load(Path(__file__).parents[2] / "robots" / "finger.urdf")
    gravity = [0, 0, -9.81] if name in ("panda", "ur5") else None
    return cartstiff.load(name, gravity=gravity)


@pytest.mark.parametrize("name", NAMES)
def test_matrices_are_those_in_metres(name):
    """The library's own conversion of a matrix is the oracle."""
    arm = loaded(name)
    factor = {"m": 1000.0, "cm": 10.0}[arm.units.length]
    other = in_units(arm, "mm")
    assert other.units.length == "mm"
    here, there = cartstiff.analyse(arm), cartstiff.analyse(other)
    scale = np.ones((4, 4))
    scale[:3, 3] = factor
    np.testing.assert_allclose(there.pose, here.pose * scale, rtol=1e-12, atol=1e-12 * factor)
    assert [n.code for n in there.notes] == [n.code for n in here.notes]
    s = np.repeat([factor, 1.0], 3)
    for connection, K in here.matrices.items():
        found = there.matrices[connection]
        assert (found is None) == (K is None)
        if K is not None:
            wanted = K * s[:, None] * s / factor
            d = np.sqrt(np.abs(wanted).max(axis=0))
            d[d == 0.0] = d.max()  # a motion that costs nothing at all
            assert np.abs((found - wanted) / d[:, None] / d).max() < 1e-7, connection
    C, D = here.compliances["B"], there.compliances["B"]
    if C is not None:
        wanted = C / s[:, None] / s * factor
        assert np.abs(D - wanted).max() <= 1e-9 * np.abs(wanted).max()


@pytest.mark.parametrize("name", ["sliding", "cubic"])
def test_masses_give_the_same_frequencies(name):
    arm = loaded(name)
    arm = arm if name == "sliding" else cartstiff.load("cubic", payload=[2.0, 0.0, 0.0, 0.01])
    here = cartstiff.modes(arm).frequencies
    there = cartstiff.modes(in_units(arm, "mm")).frequencies
    np.testing.assert_allclose(there, here, rtol=1e-9)


def test_an_equilibrium_is_the_same_place():
    arm = loaded("panda")
    here = cartstiff.equilibrium(arm, wrench=[1, 2, 3, 10, 20, -30])
    there = cartstiff.equilibrium(in_units(arm, "mm"), wrench=[1000, 2000, 3000, 10, 20, -30])
    np.testing.assert_allclose(there.q, here.q, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(there.displacement[3:], 1e3 * here.displacement[3:], rtol=1e-7)


def test_there_and_back():
    arm = loaded("sliding")
    back = in_units(in_units(arm, "in"), "m")
    assert back.limits["b"] == pytest.approx(arm.limits["b"], rel=1e-15)
    assert in_units(arm, "mm").limits["b"] == pytest.approx((-200.0, 500.0))
    np.testing.assert_allclose(back.springs.stiffness, arm.springs.stiffness, rtol=1e-14)


def test_pictures_have_the_size_of_the_mechanism():
    from tests.doors import Box
    from tests.support.robots import visuals_of

    box = "<visual><geometry><box size='.1 .2 .3'/></geometry><origin xyz='0 0 1'/></visual>"
    arm = cartstiff.load(SLIDING.replace("<link name='l3'/>", f"<link name='l3'>{box}</link>"))
    shown = visuals_of(in_units(arm, "mm").mechanism)[0][0]
    assert isinstance(shown.shape, Box)
    assert shown.shape.sides == pytest.approx((100.0, 200.0, 300.0))
    assert shown.at.T_j_f[2, 3] == pytest.approx(1000.0)


def test_what_cannot_be_converted_is_refused():
    arm = loaded("panda")
    refused("unknown length unit", in_units, arm, "furlong")
    own = replace(arm, potentials=(JointFunction(lambda q: 0.0),))
    assert in_units(own, "m").potentials == own.potentials
    refused("not converted", in_units, own, "mm")
