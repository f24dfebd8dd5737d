"""The page's numbers are the library's."""

import json

import numpy as np
import pytest
from tests.support.pages import numbers_shown, row_shown, source_of, state_of, tab_of
from tests.support.printed import text_of

import cartstiff
from cartstiff import DeadForce, analyse_posture, equilibrium
from cartstiff.extend import in_units
from cartstiff.geometry import se3
from cartstiff.scene import Appearance

LOAD = np.array([3.0, -2.0, 1.0, 30.0, -20.0, -100.0])


@pytest.fixture(scope="module")
def arm():
    return cartstiff.load("ur5")


@pytest.fixture(scope="module")
def loaded(arm):
    return cartstiff.analyse(arm, wrench=LOAD)


def test_the_payload_holds_the_object_of_analyse(loaded):
    whole = loaded.to_dict()
    for quantity in ("stiffness", "compliance"):
        numbers = numbers_shown(loaded, state_of(quantity=quantity))
        again = json.loads(json.dumps(numbers, allow_nan=False))["result"]
        assert again == {key: whole[key] for key in again}
        assert quantity in again
        assert len(again) == 7


@pytest.mark.parametrize("name", ["A", "B", "K", "F", "+", "load"])
@pytest.mark.parametrize("others", ["free", "held"])
@pytest.mark.parametrize("quantity", ["stiffness", "compliance"])
def test_principal_values_are_those_of_the_blocks(loaded, name, others, quantity):
    numbers = numbers_shown(loaded, state_of(connection=name, others=others, quantity=quantity))
    whole = loaded.at().matrices[name]
    # Held freedoms are those of a block of the stiffness, free ones of one of the compliance.
    M = whole if others == "held" else np.linalg.inv(whole)
    for freedom, at in (("translation", slice(3, 6)), ("rotation", slice(0, 3))):
        block = 0.5 * (M + M.T)[at, at]
        if (others == "held") != (quantity == "stiffness"):
            block = np.linalg.inv(block)
        found = numbers["principal"][freedom]
        assert np.allclose(found["values"], np.linalg.eigvalsh(block), rtol=1e-9)
        for value, axis in zip(found["values"], found["axes"], strict=True):
            assert np.allclose(block @ axis, value * np.array(axis), atol=1e-9 * abs(block).max())


@pytest.mark.parametrize("unit", ["m", "mm", "um"])
@pytest.mark.parametrize("force", [1e-4, 1e-2])
def test_in_every_unit_page_text_and_analysis_agree_on_what_is_symmetric(arm, unit, force):
    """A block of large entries, such as moments in N mm, hides no asymmetry of the others."""
    result = cartstiff.analyse(in_units(arm, unit), wrench=[0.0, 0.0, 0.0, force, 0.0, 0.0])
    analysis = analyse_posture(result, connection="A")
    size = numbers_shown(result, state_of())["symmetric"]["A"]
    assert analysis["symmetrised"] == (force > 1e-3) == (size > 0.0)
    assert ("\nK^A  " in text_of(result)) == (force > 1e-3)
    assert ("asymmetric" in text_of(result)) == (force > 1e-3)


def test_symmetric_is_said_of_the_right_ones(loaded):
    found = numbers_shown(loaded, state_of())["symmetric"]
    assert found["B"] == found["K"] == found["F"] == 0.0
    # K^A - K^A^T is made of the load: its largest entry here is the force.
    assert found["A"] == pytest.approx(100.0, rel=1e-9)
    assert found["+"] == found["A"]


def test_another_point_and_axes_are_another_frame_of_the_same_body(arm, loaded):
    state = state_of(point=(0.05, -0.02, 0.1), axes="world")
    T = se3.pose(loaded.pose[:3, :3].T, state.point)
    assert np.allclose((loaded.pose @ T)[:3, :3], np.eye(3), atol=1e-12)
    here, shown, Ad = loaded.at(T), numbers_shown(loaded, state), se3.adjoint(T)
    for name in ("A", "B", "K", "F", "+", "load"):
        moved = Ad.T @ loaded.tensor(name).matrix @ Ad
        assert np.allclose(here.matrices[name], moved, rtol=1e-9, atol=1e-6), name
        assert np.allclose(here.matrices[name] @ here.compliances[name], np.eye(6), atol=1e-9)
    assert np.allclose(shown["wrench"], Ad.T @ loaded.wrench, atol=1e-9)
    assert np.array_equal(shown["stiffness"]["K"], here.matrices["K"])
    assert numbers_shown(loaded, state_of())["stiffness"] is None


def test_compliance_at_another_point_without_a_stiffness():
    chain = cartstiff.analyse(cartstiff.load("five-bar"))
    T = se3.pose(translation=(0.0, 0.0, 0.1))
    here = chain.at(T)
    assert here.matrices["K"] is None
    back = se3.adjoint(se3.inverse(T))
    assert np.allclose(here.compliances["K"], back @ chain.compliances["K"] @ back.T, atol=1e-15)


@pytest.mark.parametrize("point", [(0.0, 0.0, 0.0), (0.0, 0.0, 0.25)])
def test_the_load_acts_at_the_reference_point_and_the_picture_shows_its_motion(arm, point):
    """Against the equilibrium under that dead force, which is not linear, at a small force."""
    session = tab_of(source_of(arm))
    force = np.array([0.3, 0.0, 0.0])
    state = state_of(point=point, load=(0, 0, 0, *force), deflection=True)
    result = session.result(state)
    assert result.load.at == point
    legend = session.picture._scene.draw(result, Appearance(point=point, deflection=True))
    moved = legend["deflection"]
    assert moved["acts_at"] == list(point)
    free = cartstiff.analyse(arm)
    R = free.pose[:3, :3]
    settled = equilibrium(free.elastic, free.q, DeadForce(R @ force, point), limits=False)
    p = np.append(point, 1.0)
    expected = np.linalg.norm((settled.pose @ p - free.pose @ p)[:3])
    assert moved["displacement"] == pytest.approx(expected, rel=1e-4)
    assert numbers_shown(result, state)["result"]["load"]["at"] == list(point)
    # Numbers and picture read one object.
    T = se3.pose(np.eye(3), point)
    assert result.at(T) is result.at(T)


def test_the_load_acts_where_it_is_put(arm):
    session, at = tab_of(source_of(arm)), (0.1, 0.0, 0.0)
    state = state_of(point=(0, 0, 0.25), load=(0, 0, 0, 30.0, 20.0, 0), load_at=at)
    result = session.result(state)
    assert np.allclose(result.wrench, [*np.cross(at, [30.0, 20.0, 0]), 30.0, 20.0, 0], atol=1e-9)
    follower = session.result(state.model_copy(update={"load_kind": "follower"}))
    assert np.allclose(follower.tangent, follower.matrices["A"])
    assert session.result(state_of(point=(0, 0, 0.25))).load.at == (0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("name", "q", "load", "level", "words"),
    [
        ("ur5", None, None, "good", "Positive definite"),
        ("ur5", [0.0] * 6, None, "bad", "Singular posture"),
        ("five-bar", None, None, "warning", "Fewer than six"),
        ("five-bar", [-2.6, -1.64, 0.95, 1.63], None, "warning", "drives have moved"),
        ("stewart-gough", None, None, "bad", "Indefinite"),
        ("grasp", None, None, "warning", "costs nothing"),
        ("cubic", None, None, "good", "Positive definite"),
    ],
)
def test_the_verdict(name, q, load, level, words):
    result = cartstiff.analyse(cartstiff.load(name), q, wrench=load)
    found = numbers_shown(result, state_of())["verdict"]
    assert found["level"] == level
    assert words in found["title"]


def test_no_flat_matrix_of_a_redundant_arm():
    result = cartstiff.analyse(cartstiff.load("panda"))
    numbers = numbers_shown(result, state_of(connection="F"))
    assert numbers["verdict"]["title"].startswith("No K^F")
    assert numbers["verdict"]["code"] == "kf-undefined"
    assert numbers["principal"] is None
    assert numbers["indices"] is None


def test_buckled_is_bad():
    """Compression beyond the critical load of the paper's platform: not positive any more."""
    elastic = cartstiff.load("cubic")
    pushed = cartstiff.analyse(elastic, wrench=[0, 0, 0, 0, 0, -3e6])
    assert numbers_shown(pushed, state_of())["verdict"]["level"] == "bad"


def test_legs_of_a_platform():
    elastic = cartstiff.load("hexapod")
    legs = numbers_shown(cartstiff.analyse(elastic), state_of())["legs"]
    lengths = elastic.mechanism.leg_lengths(elastic.q)
    assert [leg["length"] for leg in legs] == lengths.tolist()
    assert {leg["lower"] for leg in legs} == {0.5}
    assert numbers_shown(cartstiff.analyse(cartstiff.load("ur5")), state_of())["legs"] is None


def test_distance_to_singularity_vanishes_where_it_must():
    arm = cartstiff.load("ur5")
    (serial,) = numbers_shown(cartstiff.analyse(arm, [0.0] * 6), state_of())["singularity"]
    assert serial["kind"] == "serial"
    assert serial["ratio"] < 1e-10
    (type_2,) = numbers_shown(cartstiff.analyse(cartstiff.load("cubic")), state_of())["singularity"]
    assert type_2["kind"] == "type-2"
    # Six orthogonal pairs of legs: far from any singularity.
    assert type_2["ratio"] > 0.3


def test_a_row_of_a_series(loaded):
    row = row_shown(loaded, state_of(quantity="compliance"))
    block = loaded.compliances["K"][3:, 3:]
    assert np.allclose(row["translation"], np.linalg.eigvalsh(block), rtol=1e-9)
    singular = row_shown(cartstiff.analyse(cartstiff.load("ur5"), [0.0] * 6), state_of())
    assert singular["translation"] is None
    moved = numbers_shown(loaded, state_of())["moved"]["displacement"]
    assert row["deflection"] == [pytest.approx(np.linalg.norm(moved), rel=1e-14)]
    assert singular["deflection"] is None
    assert singular["singularity"][0] < 1e-10
    turned = numbers_shown(loaded, state_of())["moved"]["rotation"]
    assert row["turn"] == [pytest.approx(np.linalg.norm(turned), rel=1e-14)]
    assert row["energy"] == [loaded.energy]
    assert row["leg_force"] is None
    numbers = numbers_shown(loaded, state_of())["indices"]
    names = "condition_number", "translational_condition", "rotational_condition"
    assert row["condition"] == [numbers[name] for name in names]


def test_a_row_of_a_platform_has_its_largest_leg_force():
    result = cartstiff.analyse(cartstiff.load("cubic"), wrench=[1.0, 2.0, -3.0, 40.0, 0.0, -90.0])
    forces = np.linalg.solve(result.posture.actuation.T, result.wrench)
    assert row_shown(result, state_of())["leg_force"] == [pytest.approx(np.abs(forces).max())]


@pytest.mark.parametrize("name", ["ur5", "stewart-gough"])
def test_how_far_the_load_moves_it_is_what_the_analysis_says(name):
    elastic = cartstiff.load(name)
    point, at = (0.01, -0.02, 0.1), (0.0, 0.05, 0.0)
    state = state_of(load=(1.0, 2.0, 0.0, 3.0, -40.0, 60.0), point=point, load_at=at)
    result = tab_of(source_of(elastic)).result(state)
    moved = numbers_shown(result, state)["moved"]
    told = analyse_posture(result, connection="load", at=se3.pose(np.eye(3), point))["deflection"]
    assert moved["displacement"] == told["displacement"]
    assert moved["rotation"] == told["twist"][:3]
    assert moved["energy"] == told["energy"]
    assert moved["acts_at"] == told["acts_at"] == list(at)
    parts = {part["name"]: part["share"] for part in moved["shares"]["parts"]}
    assert parts == {row["name"]: row["share"] for row in told["shares"]}
    sizes = [abs(share) for share in parts.values()]
    assert sizes == sorted(sizes, reverse=True)
    assert sum(parts.values()) + moved["shares"]["rest"] == pytest.approx(1.0, abs=1e-9)
    heavy = tab_of(source_of(elastic.with_gravity([0, 0, -9.81])))
    assert heavy.hello().data["mechanism"]["weighed"].startswith("Gravity: (0, 0, -9.81) on ")


def test_a_motion_that_is_rounding_of_a_load_on_the_structure_is_none():
    """Sideways the legs of a 3-RPS carry nothing: its motion was 1e-23 m, with shares of it."""
    state = state_of(load=(0.0, 0.0, 0.0, 100.0, 0.0, 0.0), load_axes="world")
    moved = numbers_shown(tab_of(source_of(cartstiff.load("3-rps"))).result(state), state)["moved"]
    assert moved["displacement"] == moved["rotation"] == [0.0] * 3
    assert moved["energy"] == 0.0
    assert moved["shares"] is None
