"""What gravity acts on is said by every report, and the same in all modes of a command."""

import json
import xml.etree.ElementTree as ET
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from tests.doors import gravity_loads
from tests.support import robot_file
from tests.support.printed import text_of

import cartstiff
from cartstiff import DeadForce, compensate, equilibrium, load_curve, payload

GRAVITY = np.array([0.0, 0.0, -9.81])
Q = [0.3, -1.1, 1.4, -0.7, 0.9, 0.2]
LOAD = DeadForce([10.0, 0.0, -50.0])


def masses_of_urdf():
    """Masses of the UR5's file, those of its fixed base left out."""
    links = ET.parse(robot_file("ur_description/urdf/ur5_robot.urdf")).getroot().findall("link")
    found = {k.get("name"): k.find("inertial/mass") for k in links}
    return {
        name: float(mass.get("value"))
        for name, mass in found.items()
        if mass is not None and name != "base_link" and float(mass.get("value")) > 0.0
    }


def heavy(**file):
    text = {"kind": "serial", "model": "ur5", "frame": "tool0", "gravity": GRAVITY.tolist(), **file}
    robot_file("ur_description/urdf/ur5_robot.urdf")
    return text


@pytest.fixture
def arm(tmp_path):
    path = tmp_path / "arm.yaml"
    path.write_text(json.dumps(heavy(payload={"mass": 5.0, "com": [0.0, 0.0, 0.1]})))
    return cartstiff.load(path)


def test_links_and_payload_by_their_file(arm):
    found = gravity_loads(arm)
    assert found.bodies == masses_of_urdf() | {"payload": 5.0}
    assert found.massless == ()
    assert found.to_dict()["gravity"] == GRAVITY.tolist()
    assert gravity_loads(replace(arm, gravity=None)).text == "Gravity: none"


def test_the_weight_itself(arm):
    """What is said to be weighed is what pulls: the base joint's posture moved up by one metre."""
    mechanism = arm.mechanism
    energy = mechanism.at(Q).gravity(GRAVITY).energy
    model = mechanism.tree.model.copy()
    model.jointPlacements[1] = pin.SE3(np.eye(3), np.array([0.0, 0.0, 1.0])) * pin.SE3(
        model.jointPlacements[1]
    )
    data = model.createData()
    model.gravity = pin.Motion(np.concatenate([GRAVITY, np.zeros(3)]))
    raised = pin.computePotentialEnergy(model, data, np.array(Q))
    total = sum(gravity_loads(arm).bodies.values())
    assert raised - energy == pytest.approx(9.81 * total, rel=1e-12)


def test_gravity_is_the_same_for_one_posture_and_for_a_path(arm):
    """Open rest positions carry gravity in both: only the load moves the body."""
    state = equilibrium(arm, Q, LOAD, limits=False)
    path = compensate(arm, [Q], [LOAD])
    assert path.before[0] == pytest.approx(state.displacement, rel=1e-9, abs=1e-14)
    assert np.abs(path.after).max() < 1e-12
    # The change of the command balances the load alone.
    posture = arm.mechanism.at(Q)
    slope = LOAD.evaluate(posture).gradient
    assert path.offsets[0] == pytest.approx(slope / arm.springs.stiffness, rel=1e-9, abs=1e-13)
    without = compensate(replace(arm, gravity=None), [Q], [LOAD])
    assert np.linalg.norm(without.before - path.before) < 0.05 * np.linalg.norm(path.before)


def test_springs_with_rest_positions_sag_under_gravity_in_both(arm):
    """With the rest positions at the posture, gravity is part of the way in both modes."""
    given = arm.with_springs(rest=Q)
    state = equilibrium(given, Q, LOAD, limits=False)
    path = compensate(given, [Q], [LOAD])
    assert path.before[0] == pytest.approx(state.displacement, rel=1e-9)
    assert np.linalg.norm(path.before[0, 3:]) > 0.005


def test_every_report_says_what_was_weighed(arm):
    hung = payload(2.0, GRAVITY)
    posture = cartstiff.analyse(arm, Q)
    results = [
        posture,
        equilibrium(arm, Q, hung),
        load_curve(arm, Q, hung),
        compensate(arm, [Q], [hung]),
    ]
    for result in results:
        data = json.loads(json.dumps(result.to_dict()))
        names = {part["name"]: part["mass"] for part in data["weighed"]}
        assert names["upper_arm_link"] == masses_of_urdf()["upper_arm_link"]
        assert names["payload"] == 5.0
        assert data["gravity"] == GRAVITY.tolist()
        assert "Gravity: (0, 0, -9.81) on 21.9939 kg" in text_of(result)
        if result is not posture:
            assert names["payload among the loads"] == 2.0
            assert "payload of 2 kg" in text_of(result)
    light = cartstiff.analyse(replace(arm, gravity=None), Q)
    assert light.to_dict()["gravity"] is None
    assert light.to_dict()["weighed"] == []
    assert "Gravity: none" in text_of(light)


def test_links_without_mass_are_named():
    elastic = replace(cartstiff.load("3-rrr"), gravity=GRAVITY)
    found = gravity_loads(elastic)
    notes = {n.code: n for n in cartstiff.analyse(elastic).notes}
    assert found.massless
    assert notes["massless"].values["links"] == list(found.massless)
    assert "massless" not in {n.code for n in cartstiff.analyse(cartstiff.load("3-rrr")).notes}


def test_a_platform_weighs_its_payload():
    elastic = replace(cartstiff.load("hexapod"), gravity=GRAVITY)
    assert gravity_loads(elastic).massless == ("platform",)


def test_rotational_inertia_of_a_file_is_kept():
    """Mass matrix by Pinocchio's own reading of the same file."""
    path = robot_file("panda_description/urdf/panda.urdf")
    elastic = cartstiff.load("panda")
    own = pin.buildModelFromUrdf(path)
    n = len(elastic.q)
    q = pin.neutral(own)
    q[:n] = elastic.q
    full = pin.crba(own, own.createData(), q)
    full = np.triu(full) + np.triu(full, 1).T
    # The fingers lie still in both: what they carry moves with the hand.
    assert elastic.mechanism.at(elastic.q).mass_matrix() == pytest.approx(full[:n, :n], rel=1e-9)


def test_a_payload_among_the_loads_is_told_in_kilograms(tmp_path):
    file = tmp_path / "cell.yaml"
    legs = {"base": [[0, 0, 0], [1000, 0, 0], [0, 1000, 0]], "platform": [[0, 0, 600]] * 3}
    units = {"length": "mm", "force": "kN"}
    data = {"kind": "springs", "units": units, **legs, "legs": {"stiffness": 10, "preload": 0}}
    file.write_text(json.dumps(data), encoding="utf-8")
    cell = cartstiff.load(file)
    hung = payload(20.0 / cell.units.newtons, (0.0, 0.0, -9.81))
    assert gravity_loads(cell, [hung]).payload == pytest.approx(20.0)


def test_masses_on_a_platform_add_their_moments():
    """Two payloads are one at their centre."""
    bare = cartstiff.load("stewart-gough")
    both = bare.with_payload(2.0, [0.0, 0.0, 0.1]).with_payload(3.0, [0.2, -0.1, 0.4]).mechanism
    assert both.mass - bare.mechanism.mass == pytest.approx(5.0)
    assert bare.mechanism.mass == 0.0
    assert both.mass_centre == pytest.approx([0.12, -0.06, 0.28], rel=1e-12)
