"""A user's own mechanism and energies answer as ours do: units, numbers, shares, pictures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pytest
from meshcat import Visualizer
from tests.doors import Parameters
from tests.support import absolute_error
from tests.view.viewer import Viewer

import cartstiff
from cartstiff import ElasticMechanism, JointSprings, analyse_posture
from cartstiff.extend import (
    Coordinate,
    Evaluation,
    Mechanism,
    MechanismPosture,
    Number,
    Potential,
    SecondOrderMap,
    Skeleton,
    gradient_and_hessian,
    in_units,
    jacobian,
)
from cartstiff.geometry import se3
from cartstiff.scene import Appearance, RecordingWindow, Scene

Q = np.array([0.3, 0.2, 0.4, -0.5, 0.1, 0.7])
STIFFNESS = [900.0, 4e4, 700.0, 500.0, 300.0, 200.0]


class Crane(Mechanism):
    """Turn and lift of a mast, an arm, a wrist turned by a vector, a screw; one length."""

    kind, frame = "crane", "hook"
    coordinates = (
        Coordinate("turn", "revolute"),
        Coordinate("lift", "prismatic", 0.0, 2.0),
        *(Coordinate(f"wrist_{a}", "revolute") for a in "xyz"),
        Coordinate("end", "revolute"),
    )

    def __init__(self, arm: float = 0.8) -> None:
        self.arm = arm

    def pose(self, q: Any) -> Any:
        T = np.eye(4)
        T[:2, :2] = [[np.cos(q[0]), -np.sin(q[0])], [np.sin(q[0]), np.cos(q[0])]]
        T[:3, 3] = [self.arm * np.cos(q[0]), self.arm * np.sin(q[0]), q[1]]
        wrist = se3.exp(np.append(q[2:5], [0.0, 0.0, 0.0]))
        wrist[0, 3] = 0.25 * self.arm
        return T @ wrist @ se3.exp(q[5] * np.array([0.0, 1.0, 0.0, 0.0, 0.0, 0.1 * self.arm]))

    def at(self, q: Any) -> CranePosture:
        return CranePosture(self, self.checked(q))

    def numbers(self) -> dict[str, Number]:
        return {"arm": Number(self.arm, length=1.0, is_positive=True)}

    def with_numbers(self, values: Mapping[str, float]) -> Crane:
        return Crane(values.get("arm", self.arm))


class CranePosture(MechanismPosture):
    def __init__(self, crane: Crane, q: Any) -> None:
        self.q, self._crane, self.pose = q, crane, crane.pose(q)
        self.length = crane.arm
        self.coordinate_lengths = np.where([c.is_length for c in crane.coordinates], crane.arm, 1)
        back = se3.inverse(self.pose)

        def x(step: Any) -> Any:
            return se3.log(back @ crane.pose(q + step))

        def curvature(w: Any) -> Any:
            return gradient_and_hessian(lambda d: float(w @ x(d)), self.coordinate_lengths)[1]

        self.motion = SecondOrderMap(jacobian(x, self.coordinate_lengths), curvature)

    def relative(self, frame_a: str, frame_b: str) -> Any:
        assert (frame_a, frame_b) == ("world", "body")
        return self.pose, self.motion

    def gravity(self, acceleration: Any) -> Evaluation:
        return Evaluation(0.0, np.zeros(6), np.zeros((6, 6)))

    def chart(self) -> Any:
        return "none"

    def drawn(self) -> Skeleton:
        top = np.array([0.0, 0.0, self.q[1]])
        way = np.array([np.zeros(3), top, self.pose[:3, 3]])
        return Skeleton([way], way)


class Buffer(Potential):
    """1/4 c x^4 of the lift x, which knows its constant."""

    stem = "buffer "

    def __init__(self, c: float) -> None:
        self.c = c

    def evaluate(self, posture: Any) -> Evaluation:
        x, force, stiffness = posture.q[1], np.zeros(6), np.zeros((6, 6))
        force[1], stiffness[1, 1] = self.c * x**3, 3.0 * self.c * x**2
        return Evaluation(0.25 * self.c * x**4, force, stiffness)

    def numbers(self, names: Sequence[str]) -> dict[str, Number]:
        return {f"{names[0]}.c": Number(self.c, length=-3.0, force=1.0, is_positive=True)}

    def with_numbers(self, values: Mapping[str, float], names: Sequence[str]) -> Buffer:
        return Buffer(values.get(f"{names[0]}.c", self.c))


def crane(arm: float = 0.8, c: float = 3e4) -> ElasticMechanism:
    springs = JointSprings(np.array(STIFFNESS), np.full(6, np.nan))
    return ElasticMechanism("crane", Crane(arm), Q, springs, (Buffer(c),))


def softness(elastic: ElasticMechanism) -> Any:
    """J k^-1 J^T on the joints, the lift with its buffer; without a load K is its inverse."""
    k = np.array(STIFFNESS)
    k[1] += 3.0 * elastic.potentials[0].c * Q[1] ** 2
    J = elastic.mechanism.at(elastic.q).motion.jacobian
    return J @ np.diag(1.0 / k) @ J.T


def test_numbers_of_all_parts_are_listed_and_changed_by_name() -> None:
    numbers = crane().numbers()
    assert numbers["stiffness.lift"] == Number(4e4, -1.0, 1.0, True)
    assert numbers["stiffness.turn"] == Number(900.0, 1.0, 1.0, True)
    assert (numbers["arm"].value, numbers["buffer 1.c"].value) == (0.8, 3e4)
    changed = crane().with_numbers({"arm": 0.9, "buffer 1.c": 5e4, "stiffness.end": 250.0})
    assert changed.springs.stiffness.tolist() == [*STIFFNESS[:5], 250.0]
    np.testing.assert_allclose(
        changed.mechanism.pose(Q)[:3, 3], Crane(0.9).pose(Q)[:3, 3], rtol=1e-15
    )
    assert changed.potentials[0].c == 5e4


def test_another_unit_of_length_changes_every_number_by_its_power() -> None:
    metres, small = crane(), in_units(crane(), "mm")
    assert (small.units.length, small.limits["lift"]) == ("mm", (0.0, 2000.0))
    assert small.numbers()["buffer 1.c"].value == pytest.approx(3e4 * 1e-9, rel=1e-12)
    K, K_mm = (cartstiff.analyse(one).matrices["B"] for one in (metres, small))
    np.testing.assert_allclose(K, np.linalg.inv(softness(metres)), rtol=1e-6)
    powers = np.add.outer(*[np.repeat([1.0, 0.0], 3)] * 2) - 1.0  # N mm, N and N/mm
    np.testing.assert_allclose(K_mm, K * 1e3**powers, rtol=1e-6, atol=1e-6)


def test_other_numbers_change_the_stiffness_as_their_formula_says() -> None:
    """Against J k^-1 J^T; sensitivities name the same numbers."""
    changed = crane().with_numbers({"arm": 0.9, "buffer 1.c": 5e4})
    K = cartstiff.analyse(changed).matrices["B"]
    np.testing.assert_allclose(np.linalg.inv(K), softness(crane(0.9, 5e4)), atol=1e-11)
    parameters = Parameters(cartstiff.analyse(crane()))
    assert list(parameters.nominal)[-2:] == ["buffer 1.c", "arm"]


def test_an_own_energy_has_its_share_beside_legs() -> None:
    """Shares are energies over the whole: those of legs and pad add up to one."""

    class Pad(Potential):
        def evaluate(self, posture: Any) -> Evaluation:
            _, to_pose = posture.relative("world", "body")
            J = to_pose.jacobian[3:]
            return Evaluation(0.0, np.zeros(J.shape[1]), 3e6 * J.T @ J)

    hexapod = cartstiff.load("hexapod")
    load = np.array([0.0, 0.0, 0.0, 10.0, 0.0, -100.0])
    says = analyse_posture(cartstiff.analyse(hexapod.with_potential(Pad())), wrench=load)
    shares = {part["name"]: part["share"] for part in says["deflection"]["shares"]}
    K = cartstiff.analyse(hexapod).matrices["B"] + np.diag([0, 0, 0, 3e6, 3e6, 3e6])
    twist = np.linalg.solve(K, load)
    assert shares["energy 1"] == pytest.approx(
        3e6 * twist[3:] @ twist[3:] / (load @ twist), rel=1e-9
    )
    assert sum(shares.values()) == pytest.approx(1.0, rel=1e-9)


def test_scene_and_report_draw_what_it_says() -> None:
    window = RecordingWindow()
    scene = Scene(Visualizer(window=window), crane())
    scene.draw(cartstiff.analyse(crane()), Appearance())
    viewer = Viewer(window.take())
    rods = [path for path in viewer.places if "/paths/line" in path and path.endswith("/rod")]
    assert len(rods) == 2
    way = crane().mechanism.at(Q).drawn().paths[0]
    for i, path in enumerate(sorted(rods)):
        T = viewer.world(path)
        ends = sorted([T[:3, 3].tolist(), (T[:3, 3] + T[:3, 1]).tolist()])
        middle = absolute_error(T[:3, 3], way[i : i + 2].mean(axis=0))
        start = absolute_error(T[:3, 3], way[i])
        assert min(middle, start) < 1e-9, ends


def test_a_chain_is_drawn_from_joint_to_joint_to_its_body():
    """And each loop to the frames that it ties."""
    for name in ("3-rrr", "five-bar"):
        posture = cartstiff.analyse(cartstiff.load(name)).posture
        drawn = posture.drawn()
        assert drawn.paths[0][-1] == pytest.approx(posture.pose[:3, 3], abs=1e-12)
        ends = [path[-1] for path in drawn.paths[1:]]
        for a, b in zip(ends[::2], ends[1::2], strict=True):
            assert a == pytest.approx(b, abs=1e-9)
