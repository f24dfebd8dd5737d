"""Buckling of rigid links on springs, and the loaded planar arm with two joints."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from scipy.optimize import brentq
from tests.doors import Chain, plain_tree
from tests.mechanisms.machines import write_file

from cartstiff import (
    DeadForce,
    ElasticMechanism,
    JointSprings,
    analyse,
    equilibrium,
    load,
    load_curve,
)

LENGTH, STIFFNESS = 0.7, 3.0
# Smallest P l / k of n equal links, each joint with a spring, the base one included.
SMALLEST = {2: 0.3819660112501051, 3: 0.19806226419516165}


def links(lengths, stiffness, q=None) -> ElasticMechanism:
    model = pin.Model()
    joint, reach = 0, 0.0
    for i, length in enumerate(lengths):
        at = pin.SE3(np.eye(3), np.array([reach, 0.0, 0.0]))
        joint = model.addJoint(joint, pin.JointModelRZ(), at, f"joint{i + 1}")
        reach = length
    tip = pin.SE3(np.eye(3), np.array([reach, 0.0, 0.0]))
    model.addFrame(pin.Frame("tip", joint, 0, tip, pin.FrameType.OP_FRAME))
    n = len(lengths)
    q = np.zeros(n) if q is None else np.asarray(q, float)
    springs = JointSprings(np.asarray(stiffness, float), q)
    return ElasticMechanism("links", Chain(plain_tree(model), "tip"), q, springs)


def column(n: int) -> ElasticMechanism:
    return links([LENGTH] * n, [STIFFNESS] * n)


@pytest.mark.parametrize("n", [1, 2, 3, 4])
@pytest.mark.parametrize(("size", "resolution"), [(1.0, 0.05), (1e-9, 1.0)])
def test_all_buckling_loads_of_a_column(n, size, resolution):
    """Also of soft springs, by one step along the curve past all of them."""
    elastic, force = links([LENGTH] * n, [size * STIFFNESS] * n), DeadForce([-size, 0.0, 0.0])
    curve = load_curve(elastic, force, to=4.2 * STIFFNESS / LENGTH, resolution=resolution)
    found = np.array([c.factor for c in curve.critical]) * LENGTH / STIFFNESS
    k = np.arange(1, n + 1)
    expected = 2 - 2 * np.cos((2 * k - 1) * np.pi / (2 * n + 1))
    assert np.allclose(found, expected, rtol=1e-8, atol=0)
    assert {c.kind for c in curve.critical} == {"bifurcation"}
    if n in SMALLEST:
        assert abs(found[0] - SMALLEST[n]) < 1e-8


@pytest.mark.parametrize("n", [2, 3])
def test_the_verdict_flips_at_the_buckling_load(n):
    critical = SMALLEST[n] * STIFFNESS / LENGTH
    below = equilibrium(column(n), DeadForce([-critical * (1 - 1e-6), 0.0, 0.0]), settle=False)
    above = equilibrium(column(n), DeadForce([-critical * (1 + 1e-6), 0.0, 0.0]), settle=False)
    assert below.stable is True
    assert above.stable is False
    assert [note.code for note in above.notes] == ["unstable"]
    exact = equilibrium(column(n), DeadForce([-critical, 0.0, 0.0]), settle=False)
    assert abs(exact.eigenvalues[0]) < 1e-12 * exact.eigenvalues[-1]


@pytest.mark.parametrize("push", [0.0, 1e-9, 1e-4])
def test_an_unstable_equilibrium_is_found_beside_the_start(push):
    """Beyond buckling, pushed sideways: k q = P l sin q + F l cos q, on the other side of zero."""
    pressed, sideways = 3.0 * STIFFNESS / LENGTH, push * STIFFNESS / LENGTH
    load = DeadForce([-pressed, sideways, 0.0])
    state = equilibrium(column(1), load, settle=False)
    expected = brentq(lambda q: q - 3.0 * np.sin(q) - push * np.cos(q), -0.1, 0.1, xtol=1e-16)
    assert state.q[0] == pytest.approx(expected, rel=1e-9)
    assert state.stable is False
    assert abs(equilibrium(column(1), load).q[0]) > 2.0


def test_a_loaded_planar_arm():
    q = np.deg2rad([30.0, 60.0])
    arm = links([0.5, 0.4], [100.0, 80.0], q)
    force = np.array([5.0, -8.0, 0.0])

    def stiffness_in_base_axes(state):
        C = state.stiffness.compliances["B"]
        R = state.pose[:3, :3]
        return np.linalg.inv((R @ C[3:, 3:] @ R.T)[:2, :2])

    free = equilibrium(arm)
    expected = np.array([[500.0, 750.555349946514], [750.555349946514, 1660.0]])
    assert np.allclose(free.q, q, rtol=0, atol=1e-14)
    assert np.allclose(stiffness_in_base_axes(free), expected, rtol=1e-12)
    # Rest positions at which the arm is in balance at q under the force.
    J = arm.mechanism.at(q)
    torque = J.motion.jacobian.T @ np.concatenate([np.zeros(3), J.pose[:3, :3].T @ force])
    loaded = equilibrium(arm.with_springs(rest=q - torque / [100.0, 80.0]), DeadForce(force))
    expected = np.array([[480.0, 739.008344562721], [739.008344562721, 1654.21367205046]])
    assert np.allclose(loaded.q, q, rtol=0, atol=1e-13)
    assert np.allclose(stiffness_in_base_axes(loaded), expected, rtol=1e-11)
    # The same of the posture alone, whose rest positions follow from the load.
    here = analyse(arm, wrench=[0, 0, 0, *force], load_axes="world")
    C = here.pose[:2, :2] @ here.tangent_compliance[3:5, 3:5] @ here.pose[:2, :2].T
    assert np.allclose(np.linalg.inv(C), expected, rtol=1e-12)


@pytest.mark.parametrize("axial", [1e4, 1e10])
@pytest.mark.parametrize("segments", [1, 4])
def test_eulers_load_however_stiff_the_bar_is_along_its_axis(tmp_path, axial, segments):
    """E A L^2 / (E I) up to 1e10: what is stiff must not hide what bends.

    A bar that shortens buckles where P (1 - P / E A) = pi^2 E I / 4 L^2.
    """
    (tmp_path / "bar.urdf").write_text(
        '<robot name="bar"><link name="wall"/><link name="bar"/><link name="tip"/>'
        '<joint name="clamp" type="fixed"><parent link="wall"/><child link="bar"/></joint>'
        '<joint name="end" type="fixed"><parent link="bar"/><child link="tip"/>'
        '<origin xyz="1 0 0"/></joint></robot>'
    )
    beam = {
        "E": 1e6,
        "G": 4e5,
        "length": 1.0,
        "area": axial / 1e6,
        "Iy": 1e-6,
        "Iz": 2e-6,
        "J": 2e-6,
        "segments": segments,
    }
    column = load(
        write_file(
            tmp_path,
            "column",
            kind="serial",
            model="bar.urdf",
            frame="tip",
            flexible={"bar": {"beam": beam}},
        )
    )
    (critical,) = load_curve(column, DeadForce([-1.0, 0.0, 0.0]), to=3.0).critical
    rigid = np.pi**2 / 4
    expected = 2 * rigid / (1 + np.sqrt(1 - 4 * rigid / axial))
    # One beam takes the work of shear from its stretched length: P / E A of a share of the load.
    assert critical.factor == pytest.approx(expected, rel=1e-8 + 0.5 / axial)
    assert repr(critical) == f"<bifurcation at factor {critical.factor:.6g}>"
