"""Exact gradients are those of the core: differences of other postures, springs, loads, places."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tests.support import refused
from tests.support.builders import (
    general_legs,
    legs_as_platform,
    legs_as_tree,
    loaded_arm,
    serial_model,
)

import cartstiff
from cartstiff import UndefinedError
from cartstiff.core.errors import UnknownNameError

WRENCH = np.array([1.0, -2.0, 0.5, 30.0, -20.0, 40.0])
STEP = 1e-3


def central(f: Any, step: float) -> float:
    """Derivative at 0 of sixth order."""
    weights = ((1, 45.0), (2, -9.0), (3, 1.0))
    return float(sum(w * (f(k * step) - f(-k * step)) for k, w in weights) / (60.0 * step))


def mixed(K: Any, W: Any, T: Any) -> Any:
    """A function of everything that may enter an objective."""
    return K[3, 3] + 0.3 * K[0, 4] - 0.2 * K[5, 1] + 0.1 * (W[2] * W[5]) + T[0, 3] * K[4, 4]


def crossed_joints(stiffness: list[float]) -> Any:
    """Joints about x, y, z of given stiffnesses on stiff slides, and a tip beside them."""
    import pinocchio as pin

    model, parent = pin.Model(), 0
    for i, axis in enumerate("XYZXYZ"):
        kind = getattr(pin, f"JointModel{'P' if i < 3 else 'R'}{axis}")()
        parent = model.addJoint(parent, kind, pin.SE3.Identity(), f"j{i + 1}")
    tip = pin.SE3(np.eye(3), np.array([0.0, 0.0, 0.3]))
    model.addFrame(pin.Frame("tip", parent, 0, tip, pin.FrameType.OP_FRAME))
    k = [5e4, 6e4, 7e4, *stiffness]
    return cartstiff.from_pinocchio(model, frame="tip").with_springs(stiffness=k)


def shown(value: float, of: Any, scale: float) -> None:
    """Equal to the limit of differences, from the change per natural size of the parameter."""
    assert value == pytest.approx(of, rel=2e-7, abs=2e-9 * scale)


def check(elastic: Any, q: Any, quantity: Any, **load: Any) -> int:
    """Compare derivatives by coordinates, springs and load with differences of `analyse`."""
    given = {"connection": "B", "length": 0.3} if isinstance(quantity, str) else {}
    found = cartstiff.gradient(elastic, q, of=quantity, **given, **load)
    exact = {slope.name: slope for slope in found if slope.is_exact}
    assert exact, found.why
    names = list(elastic.names)

    def seen(mechanism: Any, at: Any, **other: Any) -> float:
        result = cartstiff.analyse(mechanism, at, **{**load, **other})
        if quantity == "translation_free_min":
            return float(1.0 / np.linalg.eigvalsh(result.compliances["B"][3:, 3:])[-1])
        if quantity == "rotation_held_max":
            return float(np.linalg.eigvalsh(result.matrices["B"][:3, :3])[-1])
        return float(quantity(result.tangent, result.wrench, result.pose))

    assert found.value == pytest.approx(seen(elastic, q), rel=1e-10)

    compared = 0
    for name, slope in exact.items():
        group, _, rest = name.partition(".")
        if group == "q":
            j = names.index(rest)

            def moved(h: float, j: int = j) -> float:
                at = np.array(q, float)
                at[j] += h
                return seen(elastic, at)

            reference = central(moved, STEP)
        elif group == "stiffness":
            i = elastic.spring_names.index(rest)

            def stiffer(h: float, i: int = i) -> float:
                k = np.array(elastic.springs.stiffness)
                k[i] += h
                return seen(elastic.with_springs(stiffness=k.tolist()), q)

            size = float(elastic.springs.stiffness[i])
            shown(slope.value * size, central(stiffer, STEP * size) * size, abs(found.value))
            compared += 1
            continue
        elif group == "load":
            i = ("mx", "my", "mz", "fx", "fy", "fz").index(rest)

            def loaded(h: float, i: int = i) -> float:
                wrench = np.array(load["wrench"], float)
                wrench[i] += h
                return seen(elastic, q, wrench=wrench)

            reference = central(loaded, 0.1)
        else:
            continue
        shown(slope.value, reference, abs(found.value))
        compared += 1
    return compared


@pytest.mark.parametrize("quantity", ["translation_free_min", "rotation_held_max", mixed])
@pytest.mark.parametrize("kinds", ["RRRRRR", "RPRRHR", "RRRRRRR", "RRPRRRRRR"])
def test_an_arm_under_a_load(kinds, quantity):
    arm = loaded_arm(kinds, seed=len(kinds))
    # Self-motions on such soft springs buckle under more.
    force = WRENCH if len(kinds) < 9 else 0.1 * WRENCH
    load = {"wrench": force, "load_at": (0.02, -0.01, 0.05), "load_axes": "world"}
    assert check(arm.elastic, arm.q, quantity, **load) == 2 * len(kinds) + 6


@pytest.mark.parametrize("load_kind", ["dead", "follower", "conservative"])
def test_every_kind_of_load_has_its_tangent(load_kind):
    arm = loaded_arm("RRRRRR", seed=3)

    def tangent(K: Any, W: Any, T: Any) -> Any:
        return K[0, 1] + K[2, 2] + 0.1 * K[3, 5]

    found = cartstiff.gradient(
        arm.elastic, arm.q, of=tangent, wrench=WRENCH, load_kind=load_kind, by="load"
    )
    for i, slope in enumerate(found):

        def at(h: float, i: int = i) -> float:
            wrench = WRENCH + h * np.eye(6)[i]
            result = cartstiff.analyse(arm.elastic, arm.q, wrench=wrench, load_kind=load_kind)
            return float(tangent(result.tangent, None, None))

        assert slope.is_exact
        shown(slope.value, central(at, 0.1), abs(found.value))


@pytest.mark.parametrize("quantity", ["translation_free_min", mixed])
def test_a_platform_and_the_same_as_a_closed_chain(quantity):
    legs = general_legs()
    platform = legs_as_platform(legs)
    assert check(platform, legs.q, quantity, wrench=WRENCH) == 18
    _, tree = legs_as_tree(legs)
    assert check(tree, tree.q, quantity, wrench=WRENCH) == 18
    both = [
        cartstiff.gradient(
            e, of="translation_free_min", connection="B", by="stiffness", wrench=WRENCH
        )
        for e in (platform, tree)
    ]
    of_legs, of_slides = ([slope.value for slope in each] for each in both)
    np.testing.assert_allclose(of_legs, of_slides, rtol=1e-9)


def test_places_of_joints_and_points():
    """Against models whose joints and anchors stand elsewhere."""
    rng = np.random.default_rng(8)
    model = serial_model("RRRRRR", rng)
    q = rng.uniform(-1.0, 1.0, 6)
    k = rng.uniform(500.0, 900.0, 6).tolist()
    arm = cartstiff.from_pinocchio(model, frame="tip").with_springs(stiffness=k)
    found = cartstiff.gradient(arm, q, of=mixed, wrench=WRENCH, by=["placement", "frame"])
    import pinocchio as pin

    def other(joint: int, i: int, h: float) -> float:
        changed = pin.Model(model)
        T = model.jointPlacements[joint]
        turn = Rotation.from_rotvec(h * np.eye(6)[i, 3:]).as_matrix()
        changed.jointPlacements[joint] = pin.SE3(
            T.rotation @ turn, T.translation + h * np.eye(6)[i, :3]
        )
        there = cartstiff.from_pinocchio(changed, frame="tip").with_springs(stiffness=k)
        result = cartstiff.analyse(there, q, wrench=WRENCH)
        return float(mixed(result.tangent, result.wrench, result.pose))

    for joint in (2, 4, 6):
        for i, axis in enumerate(("x", "y", "z", "rx", "ry", "rz")):
            reference = central(lambda h, j=joint, i=i: other(j, i, h), STEP)
            shown(found[f"placement.j{joint}.{axis}"], reference, abs(found.value))
    assert all(slope.is_exact for slope in found)

    legs = general_legs()
    points = cartstiff.gradient(
        legs_as_platform(legs), of=mixed, wrench=WRENCH, by=["base", "platform"]
    )
    for leg, axis in ((1, 0), (4, 2)):
        for body, array in (("base", legs.base), ("platform", legs.platform)):

            def moved(h: float, array: Any = array, leg: int = leg, axis: int = axis) -> float:
                array[leg, axis] += h
                result = cartstiff.analyse(legs_as_platform(legs), wrench=WRENCH)
                array[leg, axis] -= h
                return float(mixed(result.tangent, result.wrench, result.pose))

            name = f"{body}.leg{leg + 1}.{'xyz'[axis]}"
            shown(points[name], central(moved, STEP), abs(points.value))


def resting(elastic: Any, load: Any, by: Any, of: Any) -> Any:
    """Gradient of what comes to rest again, all of it exact."""
    found = cartstiff.gradient(elastic, of=of, by=by, comes_to_rest=True, **load)
    assert found.question.startswith("it comes to rest again")
    assert all(slope.is_exact for slope in found), found.why
    return found


@pytest.mark.parametrize("kind", ["dead", "follower"])
def test_an_arm_comes_to_rest_again(kind):
    """Against searches of other equilibria: springs, rest angles, load, masses, places."""
    arm = cartstiff.load("ur5").with_gravity([0.0, 0.0, -9.81])
    soft = arm.with_springs(stiffness=[3000.0, 2500.0, 2000.0, 800.0, 700.0, 600.0])
    away = np.array([0.02, -0.05, 0.04, 0.03, 0.02, -0.04])
    rest = (np.array(arm.q) + away).tolist()
    axes = "world" if kind == "dead" else "body"
    given = {"load_kind": kind, "load_at": (0.02, -0.01, 0.05), "load_axes": axes}

    def seen(elastic: Any, wrench: Any = WRENCH) -> float:
        state = cartstiff.equilibrium(elastic, wrench=wrench, **given)
        held = state.elastic_stiffness
        tangent = state.stiffness.matrices["A"]
        return float(mixed(tangent, held.wrench, held.pose))

    at = soft.with_springs(rest=rest)
    by = ["stiffness", "rest", "load", "mass", "placement.elbow_joint", "frame"]
    found = resting(at, {"wrench": WRENCH, **given}, by, mixed)
    assert found.value == pytest.approx(seen(at), rel=1e-9)
    numbers = at.numbers()
    for slope in found:
        if slope.name.startswith("load"):
            unit = np.eye(6)[["mx", "my", "mz", "fx", "fy", "fz"].index(slope.name[5:])]
            value, step = (lambda h, unit=unit: seen(at, WRENCH + h * unit)), 0.5
        else:
            x, step = numbers[slope.name].value, STEP * slope.size

            def value(h: float, name: str = slope.name, x: float = x) -> float:
                return seen(at.with_numbers({name: x + h}))

        size = slope.size
        shown(slope.value * size, central(value, step) * size, abs(found.value))


def test_masses_under_weight():
    arm = loaded_arm("RRRRRR", seed=4)
    heavy = arm.elastic.with_gravity([0.0, 0.0, -9.81])
    found = cartstiff.gradient(heavy, arm.q, of=mixed, wrench=WRENCH, by=["mass"])
    quotients = [slope for slope in found if not slope.is_exact]
    assert not quotients, found.why
    assert len(found.slopes) >= 1


def with_mass(arm: Any, mass: float) -> Any:
    """More at the frame's origin, or less."""
    return replace(arm, mechanism=arm.mechanism.with_mass(mass, np.zeros(3)))


@pytest.mark.parametrize("comes_to_rest", [False, True])
def test_a_payload_hung_at_the_frame(comes_to_rest):
    """Of an arm whose rest positions follow, and of one that sinks under it."""
    ur5 = cartstiff.load("ur5").with_gravity([0.0, 0.0, -9.81])
    if comes_to_rest:
        ur5 = cartstiff.analyse(ur5).elastic
    asked = {"of": "translation_free_min", "by": "payload", "length": 0.3, "connection": "B"}

    def seen(mass: float) -> float:
        elastic, q = with_mass(ur5, mass), ur5.q
        if comes_to_rest:
            q = cartstiff.equilibrium(elastic, q).q
        C = cartstiff.analyse(elastic, q).compliances["B"]
        return float(1.0 / np.linalg.eigvalsh(C[3:, 3:])[-1])

    found = cartstiff.gradient(ur5, comes_to_rest=comes_to_rest, **asked)
    (slope,) = found.slopes
    assert (slope.is_exact, slope.unit, slope.nominal) == (True, "kg", 0.0)
    shown(slope.value, central(seen, 0.03), abs(found.value))


def test_preloads_of_cables():
    cables = cartstiff.load("cable-robot")
    own = cables.springs.preload

    def seen(change: float) -> float:
        tightened = cables.with_numbers({"preload.leg3": float(own[2]) + change})
        C = cartstiff.analyse(tightened).compliances["B"]
        return float(1.0 / np.linalg.eigvalsh(C[3:, 3:])[-1])

    found = cartstiff.gradient(
        cables, of="translation_free_min", by="preload.leg3", length=0.3, connection="B"
    )
    (slope,) = found.slopes
    assert (slope.is_exact, slope.unit, slope.nominal) == (True, "N", own[2])
    shown(slope.value * own[2], central(seen, 1e-3 * own[2]) * own[2], abs(found.value))


def test_equal_principal_values_have_two_sides():
    """Three crossed joints: of two equal stiffnesses the softest falls with either."""
    asked = {"of": "rotation_free_min", "by": "stiffness", "wrench": np.zeros(6)}
    found = cartstiff.gradient(crossed_joints([100.0, 100.0, 300.0]), **asked)
    assert "kink" in found.why
    *_, first, second, third = found
    for slope in (first, second):
        assert slope.sides == (pytest.approx(1.0), pytest.approx(0.0, abs=1e-9))
        assert np.isnan(slope.value)
    assert third.value == pytest.approx(0.0, abs=1e-9)
    assert "sides 1, " in repr(found)
    found = cartstiff.gradient(crossed_joints([100.0, 200.0, 300.0]), **asked)
    assert [slope.value for slope in found][3:] == pytest.approx([1.0, 0.0, 0.0], abs=1e-12)


def test_what_is_refused():
    ur5 = cartstiff.load("ur5")
    refused("stifness", cartstiff.gradient, ur5, by="stifness", kind=UnknownNameError)
    refused("translation_min", cartstiff.gradient, ur5, of="translation_min", kind=UnknownNameError)
    refused("one number", cartstiff.gradient, ur5, of=lambda K, W, T: K[:2])
    refused(
        "does not exist",
        cartstiff.gradient,
        cartstiff.load("five-bar"),
        of="translation_held_min",
        kind=UndefinedError,
    )


def test_a_program_has_gradients_at_many_postures():
    """Against `gradient` at single postures; past the last whole chunk as well."""
    arm, of = cartstiff.load("ur5"), "translation_free_min"
    program = cartstiff.record(arm, [of], loaded=True, load_axes="world")
    Q = arm.q + np.random.default_rng(1).uniform(-0.3, 0.3, (131_073, 6))
    found = program.gradient(of, Q, WRENCH)
    np.testing.assert_allclose(found[of], program.many(Q, WRENCH)[of], rtol=1e-14)
    for i in (0, -1):
        one = program.gradient(of, Q[i], WRENCH)
        there = cartstiff.gradient(
            arm, Q[i], of=of, by=["q", "stiffness", "load"], wrench=WRENCH, load_axes="world"
        )
        wanted = np.array([slope.value for slope in there]).reshape(3, 6)
        names = [slope.name.partition(".")[0] for slope in there][::6]
        for name, row in zip(names, wanted, strict=True):
            array = "wrench" if name == "load" else name
            least = 1e-10 * np.abs(row).max()
            np.testing.assert_allclose(found[array][i], row, rtol=1e-9, atol=least)
            np.testing.assert_allclose(one[array], row, rtol=1e-9, atol=least)
    closed = cartstiff.record(cartstiff.load("five-bar"), {"x": lambda a: a["pose"][0, 3]})
    refused(r"cartstiff\.gradient has", closed.gradient, "x", closed.elastic.q, kind=UndefinedError)
    refused("output", program.gradient, "softest", arm.q, WRENCH, kind=UnknownNameError)
