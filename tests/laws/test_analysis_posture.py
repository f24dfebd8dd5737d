"""What holds for the analysis of any mechanism at any posture."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tests.doors import LETTERS, Parameters, Posture, Uncertain, joint_shares
from tests.support import (
    adjoint_reference,
    body_jacobian,
    frame_pose,
    loaded_arm,
    refused,
)
from tests.support.printed import text_of

import cartstiff
from cartstiff import (
    ElasticMechanism,
    JointSprings,
    PostureStiffness,
    UndefinedError,
    analyse_posture,
)
from cartstiff.analysis import Tolerances
from cartstiff.core.errors import UnknownNameError
from cartstiff.extend import Evaluation, Potential
from cartstiff.geometry import se3

LOAD = np.array([3.0, -2.0, 1.0, 20.0, -30.0, 40.0])
KEYS = {
    "connection",
    "wrenches",
    "symmetrised",
    "definiteness",
    "frame",
    "length",
    "stiffness",
    "compliance",
    "ellipsoids",
    "directions",
    "centres",
    "normal_form",
    "decoupling_frame",
    "eigenscrews",
    "wrench_compliant_axes",
    "twist_compliant_axes",
    "indices",
    "modes",
    "synthesis",
    "asymmetry",
    "connections",
    "deflection",
    "load",
    "uncertainty",
    "notes",
}
#: Bundled mechanisms that need nothing but the package, with every kind of state.
BUNDLED = ("stewart-gough", "cubic", "cable-robot", "five-bar", "grasp", "6-ups", "3-rrr", "delta")


def resting_arm(n: int, seed: int = 3) -> ElasticMechanism:
    """An arm of stiff springs without rest positions."""
    elastic = loaded_arm(("RRPRRRRPR" if n > 2 else "RR")[:n], seed).elastic
    springs = JointSprings(100.0 * elastic.springs.stiffness, np.full(n, np.nan))
    return replace(elastic, springs=springs)


def arm(n: int, wrench: np.ndarray | None = LOAD) -> PostureStiffness:
    return cartstiff.analyse(resting_arm(n), wrench=wrench)


def checked(result: PostureStiffness, **options: Any) -> dict[str, Any]:
    found = analyse_posture(result, **options)
    assert set(found) == KEYS
    assert json.loads(json.dumps(found, allow_nan=False)) == found
    text = text_of(found, result.elastic.units)
    assert "nan" not in text.replace("determinant", "")
    assert "None" not in text
    return found


@pytest.mark.parametrize("name", BUNDLED)
@pytest.mark.parametrize("connection", [None, *LETTERS])
def test_every_state_has_an_answer(name: str, connection: str | None) -> None:
    result = cartstiff.analyse(cartstiff.load(name))
    found = checked(result, connection=connection, wrench=[0, 0, 0, 1, 2, 3])
    if found["stiffness"] is None:
        assert found["notes"]


@pytest.mark.parametrize("n", [1, 3, 5, 6, 7, 9])
def test_arms_with_any_number_of_joints(n: int) -> None:
    result = arm(n, wrench=None)
    found = checked(result, wrench=LOAD)
    assert sum(s["share"] for s in found["deflection"]["shares"]) == pytest.approx(1.0)
    assert (found["stiffness"] is None) == (n < 6)


def test_an_unbalanced_arm_has_reasons_only() -> None:
    elastic = resting_arm(7)
    result = cartstiff.analyse(elastic.with_springs(rest=0.1))
    assert result.wrench is None
    found = checked(result, wrench=LOAD, tolerances=Tolerances(0.1))
    assert found["stiffness"] is found["compliance"] is found["deflection"] is None
    assert {n["code"] for n in found["notes"]} >= {"no-stiffness", "no-compliance"}
    target = checked(result, target=np.eye(6))["synthesis"]["target"]
    assert target is None


def test_without_a_load_no_force_is_invented() -> None:
    assert analyse_posture(cartstiff.analyse(cartstiff.load("cubic")))["deflection"] is None
    gravity = replace(resting_arm(6), gravity=np.array([0, 0, -9.81]))
    assert analyse_posture(cartstiff.analyse(gravity))["deflection"] is None
    assert analyse_posture(arm(6))["deflection"]["wrench"] == pytest.approx(LOAD)


@pytest.mark.parametrize("n", [6, 7])
@pytest.mark.parametrize("connection", ["A", "B", "K", "+", "load"])
def test_joint_shares_add_up_under_every_connection(n: int, connection: str) -> None:
    result = arm(n)
    added, p = LOAD[::-1].copy(), np.array([0.3, 0.1, -0.2])
    d = analyse_posture(result, connection=connection, wrench=added, at=se3.pose(translation=p))[
        "deflection"
    ]
    # The force acts at the point, so it has a moment about M's origin.
    about_origin = added + np.array([*np.cross(p, added[3:]), 0.0, 0.0, 0.0])
    expected = np.linalg.solve(result.tensor(connection).matrix, about_origin)
    assert d["acts_at"] == p.tolist()
    assert d["wrench"] == added.tolist()
    assert d["wrench_about_origin"] == pytest.approx(about_origin)
    assert result.compliances["A"] @ d["wrench_about_origin"] == pytest.approx(
        np.linalg.solve(result.A.matrix, about_origin)
    )
    assert np.allclose(d["twist"], expected, rtol=1e-9)
    assert np.allclose(sum(np.array(s["twist"]) for s in d["shares"]), expected, rtol=1e-9)
    moved = expected[3:] + np.cross(expected[:3], p)
    assert np.allclose(d["displacement"], moved, rtol=1e-9)
    assert np.allclose(sum(np.array(s["displacement"]) for s in d["shares"]), moved, rtol=1e-9)
    assert sum(s["energy"] for s in d["shares"]) == pytest.approx(d["energy"])
    assert sum(s["share"] for s in d["shares"]) == pytest.approx(1.0)


def test_shares_under_the_flat_connection_are_those_of_the_springs() -> None:
    result = arm(6)
    d = analyse_posture(result, connection="F", wrench=LOAD)["deflection"]
    plain = joint_shares(result.jacobian, result.evaluation.hessian, LOAD)
    assert np.allclose([s["motion"] for s in d["shares"]], plain.motion)


@pytest.mark.parametrize("name", ["stewart-gough", "cubic", "6-ups"])
def test_shares_of_springs_and_load_add_up(name: str) -> None:
    d = analyse_posture(cartstiff.analyse(cartstiff.load(name)), wrench=LOAD)["deflection"]
    assert d["kind"] == "springs"
    assert sum(s["share"] for s in d["shares"]) + d["load_share"] == pytest.approx(1.0)
    if name == "cubic":
        assert d["load_share"] == pytest.approx(0.0, abs=1e-9)


def test_deflection_is_the_linear_limit_of_the_equilibrium() -> None:
    """Of a dead force on an unloaded arm, whose joint angles are found by repeated statics."""
    built = loaded_arm("RRPRRR", 8)
    k = 1e3 * np.arange(1.0, 7.0)
    result = cartstiff.analyse(replace(built.elastic, springs=JointSprings(k, built.q)))
    force = np.array([3.0, -2.0, 5.0])  # in the world
    f_body = result.pose[:3, :3].T @ force
    d = analyse_posture(result, wrench=np.concatenate([np.zeros(3), f_body]))["deflection"]

    def rest_under(scale: float) -> np.ndarray:
        q = built.q
        for _ in range(30):
            R = frame_pose(built.model, q, "tip")[:3, :3]
            torque = body_jacobian(built.model, q, "tip")[3:].T @ (R.T @ force)
            q = built.q + scale * torque / k
        return q

    motion = (rest_under(1e-3) - rest_under(-1e-3)) / 2e-3
    assert np.allclose([s["motion"] for s in d["shares"]], motion, rtol=1e-6)
    ends = [frame_pose(built.model, rest_under(s), "tip")[:3, 3] for s in (1e-3, -1e-3)]
    moved = result.pose[:3, :3].T @ (ends[0] - ends[1]) / 2e-3
    assert np.allclose(d["displacement"], moved, rtol=1e-6, atol=1e-6 * np.abs(moved).max())


def test_an_added_force_acts_where_it_is_said() -> None:
    """With the force at M's origin and the point elsewhere, and the two exchanged: Maxwell."""
    result, p = arm(6, wrench=None), [0.0, 0.0, 0.25]
    at = se3.pose(translation=p)
    force = [0.0, 0.0, 0.0, 300.0, 0.0, 0.0]
    origin = analyse_posture(result, wrench=force, load_at=[0, 0, 0], at=at)["deflection"]
    here = analyse_posture(result, wrench=force, load_at=p)["deflection"]
    both = analyse_posture(result, wrench=force, at=at, direction=[1, 0, 0])
    assert origin["displacement"][0] == pytest.approx(here["displacement"][0], rel=1e-12)
    # With the force at the point, its displacement is the force over the free stiffness there.
    free = both["directions"][3]["along"]["free"]
    assert both["deflection"]["displacement"][0] == pytest.approx(300.0 / free, rel=1e-9)
    assert abs(origin["displacement"][0] - both["deflection"]["displacement"][0]) > 1e-4
    refused("point of an added wrench needs the wrench", analyse_posture, result, load_at=p)


@pytest.mark.parametrize("connection", ["A", "B", "K", "load"])
def test_at_moves_the_analysis(connection: str) -> None:
    result = arm(6)
    T = se3.pose(Rotation.from_euler("xyz", [0.3, -0.2, 0.9]).as_matrix(), [0.1, 0.2, -0.3])
    there = analyse_posture(result, connection=connection, at=T)
    K, Ad = result.tensor(connection).matrix, adjoint_reference(T)
    moved = Ad.T @ K @ Ad  # K^K too: another origin's would belong to no load
    assert np.allclose(there["stiffness"], 0.5 * (moved + moved.T), rtol=1e-12)
    assert there["frame"] == T.tolist()
    here = analyse_posture(result, connection=connection)
    p = np.append(there["centres"]["stiffness"], 1.0)
    assert np.allclose((T @ p)[:3], here["centres"]["stiffness"], rtol=1e-8)


class Tangent(Potential):
    """A potential with given torque and stiffness at one posture."""

    def __init__(self, q: np.ndarray, torque: np.ndarray, matrix: np.ndarray) -> None:
        self.q, self.torque, self.matrix = q, torque, matrix

    def evaluate(self, posture: Posture) -> Evaluation:
        x = posture.q - self.q
        energy = float(self.torque @ x + 0.5 * x @ self.matrix @ x)
        return Evaluation(energy, self.torque + self.matrix @ x, self.matrix)


@pytest.mark.parametrize("n", [6, 8])
@pytest.mark.parametrize("heavy", [False, True])
def test_coupled_joint_springs_give_the_target(n: int, heavy: bool) -> None:
    elastic = resting_arm(n)
    if heavy:
        elastic = replace(elastic, gravity=np.array([0.0, 1.0, -9.81]))
    result = cartstiff.analyse(elastic, wrench=LOAD)
    F = np.random.default_rng(9).standard_normal((6, 9))
    target = 1e3 * F @ F.T
    found = analyse_posture(result, target=target)["synthesis"]["target"]
    made = Tangent(result.q, np.array(found["torque"]), np.array(found["matrix"]))
    bare: ElasticMechanism = replace(result.elastic, springs=None).with_potential(made)
    back = cartstiff.analyse(bare, result.q)
    assert np.allclose(back.wrench, LOAD, rtol=1e-7, atol=1e-7)
    symmetric = 0.5 * (back.tangent + back.tangent.T)  # a dead moment has no symmetric tangent
    assert found["connection"] == "load"
    assert not found["is_symmetric"]
    assert np.allclose(symmetric, target, rtol=0, atol=1e-9 * np.abs(target).max())


@pytest.mark.parametrize("connection", [None, "load", "B", "K", "A", "F"])
@pytest.mark.parametrize("kind", ["dead", "follower"])
def test_a_target_is_the_matrix_of_the_connection(connection: str | None, kind: Any) -> None:
    """K^load against finite differences of the joints' balance; the others against `analyse`."""
    given = loaded_arm("RRPRRR", 3)
    load = np.array([0.0, 0.0, 0.0, 20.0, -30.0, 40.0])
    result = cartstiff.analyse(resting_arm(6), wrench=load, load_kind=kind)
    F = np.random.default_rng(2).standard_normal((6, 9))
    target = 1e3 * F @ F.T
    answer = analyse_posture(result, connection=connection, target=target)
    found = answer["synthesis"]["target"]
    assert found["connection"] == answer["connection"] == (connection or "load")
    K, torque = np.array(found["matrix"]), np.array(found["torque"])
    springs = Tangent(result.q, torque, K)
    made = cartstiff.analyse(
        replace(result.elastic, springs=None).with_potential(springs), load_kind=kind
    )
    matrix = made.matrices[found["connection"]]
    assert matrix is not None
    assert 0.5 * (matrix + matrix.T) == pytest.approx(target, abs=1e-8 * np.abs(target).max())
    assert found["is_symmetric"] == bool(np.allclose(matrix, matrix.T, atol=1e-6))
    if found["connection"] != "load":
        return

    room = frame_pose(given.model, result.q, "tip")[:3, :3] @ load[3:]

    def unbalanced(q: np.ndarray) -> np.ndarray:
        R = frame_pose(given.model, q, "tip")[:3, :3]
        force = R.T @ room if kind == "dead" else load[3:]
        J = body_jacobian(given.model, q, "tip")
        return np.asarray(torque + K @ (q - result.q) - J[3:].T @ force)

    step, q = 1e-6, result.q
    slopes = [(unbalanced(q + step * e) - unbalanced(q - step * e)) / (2 * step) for e in np.eye(6)]
    inverse = np.linalg.inv(body_jacobian(given.model, q, "tip"))
    tangent = inverse.T @ np.array(slopes).T @ inverse
    assert 0.5 * (tangent + tangent.T) == pytest.approx(target, abs=1e-4)


def test_a_redundant_arm_has_no_target_of_its_joints_chart() -> None:
    found = analyse_posture(arm(8), connection="F", target=np.eye(6))
    assert found["synthesis"]["target"] is None
    assert "kf-undefined" in {n["code"] for n in found["notes"]}


def test_independent_springs_are_found_again() -> None:
    result = arm(6)
    found = analyse_posture(result, connection="B", target=result.B.matrix)["synthesis"]["target"]
    assert found["is_feasible"]
    again = result.elastic.with_springs(found["diagonal_fit"]["stiffness"])
    back = cartstiff.analyse(again, result.q, wrench=LOAD)
    assert np.allclose(back.B.matrix, result.B.matrix, rtol=1e-8)


def test_leg_stiffnesses_are_found_again() -> None:
    result = cartstiff.analyse(cartstiff.load("stewart-gough"))
    found = analyse_posture(result, connection="B", target=result.B.matrix)["synthesis"]["target"]
    assert found["is_feasible"]
    assert found["diagonal_fit"]["stiffness"] == pytest.approx([10, 20, 30, 40, 50, 60])
    tension = result.elastic.springs.tensions(result.posture.lines.lengths)
    assert found["torque"] == pytest.approx(tension)


def test_a_closed_chain_has_no_target() -> None:
    found = analyse_posture(cartstiff.analyse(cartstiff.load("6-ups")), target=np.eye(6))
    assert found["synthesis"]["target"] is None
    assert "kf-undefined" in {n["code"] for n in found["notes"]}


def test_inertia_gives_frequencies() -> None:
    result = cartstiff.analyse(cartstiff.load("cubic"))
    found = analyse_posture(result, mass=10.0, inertia=np.diag([0.5, 0.5, 2.0]))
    k, H = 1e6, 0.5 / np.sqrt(3.0)
    expected = [2 * k / 10] * 3 + [1.5 * k * H**2 / 0.5] * 2 + [6 * k * H**2 / 2.0]
    assert found["modes"]["metric"] == "inertia"
    assert found["modes"]["eigenvalues"] == pytest.approx(sorted(expected))
    assert found["length"]["origin"] == "inertia"
    assert "[Hz]" in text_of(found, result.units)


# -- parameters ------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["stewart-gough", "cubic", "cable-robot", "6-ups", "arm"])
def test_nominal_parameters_give_the_nominal_mechanism(name: str) -> None:
    result = arm(7) if name == "arm" else cartstiff.analyse(cartstiff.load(name))
    before = result.elastic.springs.stiffness.copy()
    parameters = Parameters(result)
    again = parameters.at(parameters.nominal)
    assert np.allclose(again.B.matrix, result.B.matrix, rtol=1e-9)
    for name, value in parameters.nominal.items():
        parameters.at({name: value + 1e-3 * parameters.size(name)})
    assert np.array_equal(result.elastic.springs.stiffness, before)
    assert np.allclose(cartstiff.analyse(result.elastic, result.q).B.matrix, result.B.matrix)


@pytest.mark.parametrize("name", ["stewart-gough", "cable-robot"])
def test_a_moved_platform_carries_the_same_load(name: str) -> None:
    result = cartstiff.analyse(cartstiff.load(name))
    parameters = Parameters(result)
    moved = {name: 1.001 * x + 1e-3 for name, x in parameters.nominal.items()}
    again = parameters.at(moved)
    assert np.allclose(again.wrench, result.wrench, rtol=1e-8, atol=1e-8)
    assert not np.allclose(again.B.matrix, result.B.matrix, rtol=1e-3)


def test_a_joint_placement_is_where_the_joint_stands() -> None:
    """Moving the frame on the last joint is a change of body frame."""
    result = arm(6, wrench=None)
    parameters = Parameters(result)
    shift = {f"frame.{a}": parameters.value(f"frame.{a}") + 0.1 * i for i, a in enumerate("xyz")}
    again = parameters.at(shift)
    R = result.elastic.mechanism.body.T_j_f[:3, :3]
    expected = result.B.to_frame(se3.pose(translation=R.T @ [0.0, 0.1, 0.2]))
    assert np.allclose(again.B.matrix, expected.matrix, rtol=1e-9)
    turned = parameters.at({"frame.rz": 0.3})
    turn = se3.pose(Rotation.from_euler("z", 0.3).as_matrix())
    assert np.allclose(turned.B.matrix, result.B.to_frame(turn).matrix, rtol=1e-9)


# -- refusals --------------------------------------------------------------------------------------


def test_refusals() -> None:
    result = cartstiff.analyse(cartstiff.load("cubic"))
    refused("unknown connection", analyse_posture, result, connection="Z", kind=UnknownNameError)
    refused("not a rigid motion", analyse_posture, result, at=2.0 * np.eye(4))
    refused("wrench has the wrong count", analyse_posture, result, wrench=[1.0, 2.0])
    refused(
        "target stiffness is not symmetric",
        analyse_posture,
        result,
        target=np.triu(np.ones((6, 6))),
    )
    refused("tolerance of the length cannot be used", Tolerances, length=-1.0)
    refused("no parameter", Uncertain.of, Parameters(result), Tolerances(), kind=UndefinedError)


@pytest.mark.parametrize("size", [1e-9, 1e-6, 1.0])
@pytest.mark.parametrize(
    ("kind", "connection", "moment", "expected"),
    [
        ("follower", "A", [1.0, 2.0, 3.0], True),
        ("follower", "K", [1.0, 2.0, 3.0], False),
        ("conservative", "K", [1.0, 2.0, 3.0], True),
        ("dead", "K", [0.0, 0.0, 0.0], True),
        ("dead", "K", [1e-3, 0.0, 0.0], False),
        ("dead", "B", [0.0, 0.0, 0.0], False),
    ],
)
def test_the_tangent_under_a_small_load_is_known_without_round_off(
    size, kind, connection, moment, expected
):
    elastic = cartstiff.load("hexapod")
    wrench = size * np.array([*moment, 0.0, 0.0, -100.0])
    result = cartstiff.analyse(elastic, wrench=wrench, load_kind=kind)
    about = analyse_posture(result, connection=connection)
    assert about["load"]["is_tangent"] is expected
