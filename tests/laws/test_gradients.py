"""Exact gradients are those of the core: differences of other postures, springs, loads, places."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from tests.doors import derivative_with_error
from tests.support import refused
from tests.support.builders import (
    general_legs,
    legs_as_platform,
    legs_as_tree,
    loaded_arm,
)

import cartstiff
from cartstiff import UndefinedError
from cartstiff.core.errors import UnknownNameError

WRENCH = np.array([1.0, -2.0, 0.5, 30.0, -20.0, 40.0])
#: A difference of eighth order has lost so much of the change per natural size.
LIMIT = 1e-7


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


def _cases(count: int, is_quick: Callable[[int], bool]) -> list[Any]:
    """Seeds; those that are not quick run with the thorough tests."""
    later = pytest.mark.thorough
    return [s if is_quick(s) else pytest.param(s, marks=later) for s in range(count)]


def placed(K: Any, W: Any, T: Any) -> Any:
    """One of load and place, for fewer than six freedoms, which have no stiffness."""
    return T[0, 3] + 0.5 * T[1, 3] * T[0, 1] + 0.01 * (W[0] + W[5]) * T[1, 3]


def arm(seed: int, rng: np.random.Generator) -> tuple[Any, Any]:
    """An arm of 1 to 9 joints, some of them slides or screws, under its weight or not."""
    count = 1 + seed // 5 % 9
    kinds = "".join(rng.choice([*"RRRPH"], count))
    built = loaded_arm(kinds, seed=seed)
    elastic = built.elastic
    stiff = rng.uniform(1.0, 3.0, count) * 2e4
    elastic = replace(elastic, springs=elastic.springs.replaced(stiff, np.full(count, np.nan)))
    elastic = elastic.with_gravity([0.3, -1.0, -9.0]) if rng.random() < 0.5 else elastic
    return elastic, built.q


def platform(_: int, rng: np.random.Generator) -> tuple[Any, Any]:
    """Six legs between random points."""
    legs = general_legs(int(rng.integers(1000)))
    return legs_as_platform(legs), legs.q


def loop(_: int, rng: np.random.Generator) -> tuple[Any, Any]:
    """The same as a tree with closures."""
    _, tree = legs_as_tree(general_legs(int(rng.integers(1000))))
    return tree, tree.q


def plane(_: int, rng: np.random.Generator) -> tuple[Any, Any]:
    """A planar loop of fewer than six freedoms, of random springs."""
    elastic = cartstiff.load("five-bar")
    k = rng.uniform(0.5, 2.0, 2) * 800.0
    names = ("left_motor", "right_motor")
    return elastic.with_springs(dict(zip(names, k.tolist(), strict=True))), elastic.q


def cables(_: int, rng: np.random.Generator) -> tuple[Any, Any]:
    """Eight cables, away from the middle."""
    elastic = cartstiff.load("cable-robot")
    away = rng.uniform(-0.05, 0.05, 6) * [1, 1, 1, 0.5, 0.5, 0.5]
    return elastic, np.asarray(elastic.q) + away


FAMILIES: tuple[Callable[[int, np.random.Generator], tuple[Any, Any]], ...] = (
    arm,
    platform,
    loop,
    plane,
    cables,
)


def with_mass(arm: Any, mass: float) -> Any:
    """More at the frame's origin, or less."""
    return replace(arm, mechanism=arm.mechanism.with_mass(mass, np.zeros(3)))


def drawn(seed: int) -> tuple[Any, Any, dict[str, Any], np.random.Generator]:
    """A random mechanism, a posture, a load if there is one, and what draws on."""
    rng = np.random.default_rng(seed)
    elastic, q = FAMILIES[seed % 5](seed, rng)
    kind = rng.choice(["none", "none", "dead", "dead", "dead", "follower", "conservative"])
    if kind == "conservative" and seed // 5 % 2:  # the search of a rest puts on several loads
        kind = "follower"
    load = {
        "wrench": rng.uniform(-1.0, 1.0, 6) * [2.0, 2.0, 2.0, 20.0, 20.0, 20.0],
        "load_kind": str(kind),
        "load_at": rng.uniform(-0.05, 0.05, 3),
        "load_axes": "world" if kind == "dead" else "body",
    }
    return elastic, q, load if kind != "none" else {}, rng


class Case:
    """A random mechanism, question, load and objective, with its exact gradient."""

    def __init__(self, seed: int) -> None:
        self.elastic, self.q, self.load, self.rng = drawn(seed)
        self.comes_to_rest, few = bool(seed // 5 % 2), len(self.q) < 6 or seed % 5 == 3
        if self.comes_to_rest:  # rest positions stay
            self.elastic = cartstiff.analyse(self.elastic, self.q).elastic
        objectives: Any = (placed,) if few else (mixed, "translation_free_min", "rotation_held_max")
        self.of = objectives[self.rng.integers(len(objectives))]
        how = {"connection": "B", "length": 0.3} if isinstance(self.of, str) else {}
        how |= {"of": self.of, "comes_to_rest": self.comes_to_rest}
        self.found = cartstiff.gradient(self.elastic, self.q, **how, **self.load)
        # Nothing that the answer names is left to difference quotients.
        assert all(slope.is_exact for slope in self.found), self.found.why
        self.given = self.load
        if not (self.load or self.comes_to_rest or np.isnan(self.elastic.springs.rest).all()):
            self.given = {"wrench": cartstiff.analyse(self.elastic, self.q).wrench}
        assert self.found.value == pytest.approx(self.seen({}), rel=1e-9)

    def seen(self, change: dict[str, float]) -> float:
        """The objective where some numbers are others: of another answer of the core."""
        numbers, given, q = dict[str, float](), dict(self.given), np.array(self.q, float)
        for name, step in change.items():
            group, _, rest = name.partition(".")
            if group == "q":
                q[self.elastic.names.index(rest)] += step
            elif group == "load":
                at = ("mx", "my", "mz", "fx", "fy", "fz").index(rest)
                given["wrench"] = given["wrench"] + step * np.eye(6)[at]
            elif name != "payload":
                numbers[name] = self.elastic.numbers()[name].value + step
        elastic = with_mass(self.elastic.with_numbers(numbers), change.get("payload", 0.0))
        if self.comes_to_rest:
            state = cartstiff.equilibrium(elastic, q, **given)
            result, tangent = state.elastic_stiffness, state.stiffness.matrices["A"]
        else:
            result = cartstiff.analyse(elastic, q, **given)
            tangent = result.tangent
        if self.of == "translation_free_min":
            return float(1.0 / np.linalg.eigvalsh(result.compliances["B"][3:, 3:])[-1])
        if self.of == "rotation_held_max":
            return float(np.linalg.eigvalsh(result.matrices["B"][:3, :3])[-1])
        K = tangent if self.load else result.matrices["B"]
        return float(self.of(K, result.wrench, result.pose))

    def along(self, change: dict[str, float], least: float) -> None:
        """Compare the derivative along a change of numbers with a difference."""

        def there(h: float) -> np.ndarray:
            return np.array([self.seen({name: h * x for name, x in change.items()})])

        wanted, error = (float(x[0]) for x in derivative_with_error(there, 5e-4))
        parts = [self.found[name] * x for name, x in change.items()]
        scale = max(abs(wanted), float(np.abs(parts).sum()), least * abs(self.found.value))
        assert abs(sum(parts) - wanted) <= max(LIMIT * scale, 3.0 * error), change


@pytest.mark.parametrize("seed", _cases(300, lambda seed: seed < 60))
def test_along_a_change_of_all_numbers(seed: int) -> None:
    case = Case(seed)
    case.along({x.name: case.rng.uniform(-1.0, 1.0) * x.size for x in case.found}, 0.0)


@pytest.mark.parametrize("seed", _cases(300, lambda seed: seed in (5, 31, 93)))
def test_along_each_number_alone(seed: int) -> None:
    case = Case(seed)
    for slope in case.found:
        case.along({slope.name: slope.size}, 0.02)


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


@pytest.mark.thorough
def test_columns_of_a_platform_s_jacobian_are_of_its_legs():
    """Each a distance, as in maps: not those of x, y, z and three angles."""
    robot, length = cartstiff.load("hexapod"), 0.3
    scale = np.repeat([length, 1.0], 3)[:, None] * length

    def ratio(q):
        values = np.linalg.svd(cartstiff.analyse(robot, q)["jacobian"] * scale, compute_uv=False)
        return values[-1] / values[0]

    found = cartstiff.gradient(robot, of="singular_value_ratio", by="q.z", length=length)
    step = 1e-4 * np.eye(6)[2]
    ahead, behind = (ratio(robot.q + sign * step) for sign in (1.0, -1.0))
    assert found.value == pytest.approx(ratio(robot.q), rel=1e-12)
    assert found["q.z"] == pytest.approx((ahead - behind) / 2e-4, rel=1e-6)


def test_settings_and_functions_act_or_are_refused():
    arm = cartstiff.load("ur5")
    asked = {"of": "along_free", "direction": [0.0, 0.0, 1.0], "by": "q.elbow_joint"}
    even = cartstiff.gradient(arm, connection="B", **asked)  # no load: A is B
    assert cartstiff.gradient(arm, connection="A", **asked).value == pytest.approx(even.value)
    refused("no quantity needs it", cartstiff.gradient, arm, **(asked | {"of": "force"}))
    refused("a positive length", cartstiff.gradient, arm, of="condition", length=-1.0)
    refused("not one number", cartstiff.gradient, arm, of=lambda K, W, T: K[3, 3] + 0j)
    free = cartstiff.gradient(arm, of=lambda K, W, T: abs(K[3, 3]), by="q.elbow_joint")
    same = cartstiff.gradient(arm, of=lambda K, W, T: K[3, 3], by="q.elbow_joint")
    assert "abs()" in free.why
    assert free["q.elbow_joint"] == pytest.approx(same["q.elbow_joint"], rel=1e-6)
    refused("cannot be recorded", cartstiff.record, arm, {"x": lambda a: abs(a["pose"][0, 3])})
    refused("no numbers", cartstiff.record, arm, {"x": lambda a: a["pose"][0, 3] > 0.0})
