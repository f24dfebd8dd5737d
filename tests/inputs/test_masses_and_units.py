"""Masses in kg and gravity in m/s^2, whatever the units: weights in the file's units of force."""

from pathlib import Path

import numpy as np
import pytest
from tests.support.commands import answer

import cartstiff
from cartstiff import DeadForce, InputError, equilibrium

# Newtons in a unit, metres in a unit, by their definitions.
FORCES = {"N": 1.0, "kN": 1000.0, "mN": 0.001, "daN": 10.0, "lbf": 0.45359237 * 9.80665}
LENGTHS = {"m": 1.0, "cm": 0.01, "mm": 0.001, "in": 0.0254, "ft": 0.3048}
G = 9.81
# Newton's method ends on a residual.
EQUILIBRIUM = 1e-7
BASE = np.array([[np.cos(a), np.sin(a), 0] for a in np.deg2rad([0, 10, 120, 130, 240, 250])])
TOP = 0.5 * np.array([[np.cos(a), np.sin(a), 0] for a in np.deg2rad([310, 60, 70, 180, 190, 300])])


def platform(length, force, **more):
    metre, newton = 1 / LENGTHS[length], 1 / FORCES[force]
    keys = {
        "kind": "stewart-gough",
        "units": f"{{length: {length}, force: {force}}}",
        "base": (metre * BASE).tolist(),
        "platform": (metre * TOP).tolist(),
        "pose": f"{{xyz: [0, 0, {0.8 * metre}]}}",
        "legs": f"{{stiffness: {1e5 * newton / metre}}}",
    } | more
    path = Path("platform.yaml")
    path.write_text("".join(f"{key}: {value}\n" for key, value in keys.items()))
    return path


@pytest.mark.parametrize("length", LENGTHS)
@pytest.mark.parametrize("force", FORCES)
def test_a_payload_sinks_as_far_in_all_units(length, force):
    """Twenty kg on a platform, by the file's payload, by the command's, and by a force in N."""
    metre = 1 / LENGTHS[length]
    si = cartstiff.load(platform("m", "N"))
    expected = equilibrium(si, DeadForce([0, 0, -20 * G])).displacement[5]
    start = cartstiff.load(platform(length, force))
    heavy = cartstiff.load(
        platform(length, force, gravity=[0, 0, -G], payload="{mass: 20, com: [0, 0, 0]}")
    )
    lengths = start.mechanism.leg_lengths(start.q)  # the weight comes upon resting springs
    sunk = equilibrium(heavy.with_springs(rest=lengths)).displacement[5]
    assert sunk / metre == pytest.approx(expected, rel=EQUILIBRIUM)
    many = cartstiff.analyse_many(
        heavy.with_springs(rest=lengths), heavy.q[None], outputs=["wrench"]
    )
    one = cartstiff.analyse(heavy.with_springs(rest=lengths))
    assert np.allclose(many["wrench"][0], one.wrench, rtol=1e-9, atol=1e-9 * abs(one.wrench).max())


@pytest.mark.parametrize(("length", "force"), [("mm", "kN"), ("in", "lbf")])
def test_payload_of_the_command(length, force):
    expected, found = (
        answer("equilibrium", platform(*units), "--payload 20")["displacement"][5]
        for units in (("m", "N"), (length, force))
    )
    assert found * LENGTHS[length] == pytest.approx(expected, rel=EQUILIBRIUM)


@pytest.mark.parametrize(
    ("length", "gravity"),
    [("mm", 9810), ("cm", 981), ("in", 386.1), ("ft", 32.2), ("m", 9810), ("mm", 400)],
)
def test_gravity_in_other_units_is_refused(length, gravity, refused):
    file = platform(length, "N", gravity=[0, 0, -gravity], payload="{mass: 1}")
    words = ("platform.yaml, line", "gravity", "m/s^2, whatever the units")
    refused("analyse", str(file), words=words)


@pytest.mark.parametrize("gravity", [9.81, 1.62, 24.8, 98.1])
def test_gravity_of_other_places_is_taken(gravity, accepted):
    accepted(str(platform("mm", "N", gravity=[0, 0, -gravity], payload="{mass: 1}")))


def test_gravity_without_mass_is_said(accepted):
    def codes(**more):
        return [n["code"] for n in accepted(str(platform("m", "N", **more)))["notes"]]

    assert "weightless" in codes(gravity=[0, 0, -G])
    assert "weightless" not in codes(gravity=[0, 0, -G], payload="{mass: 1}")
    assert "weightless" not in codes()
    arm = '<robot name="r"><link name="a"/><link name="b"/><joint name="j" type="continuous">'
    arm += '<parent link="a"/><child link="b"/></joint></robot>'
    Path("arm.urdf").write_text(arm)
    Path("arm.yaml").write_text("kind: serial\nmodel: arm.urdf\nframe: b\ngravity: [0, 0, -9.81]\n")
    assert "weightless" in [n["code"] for n in accepted("arm.yaml")["notes"]]


def test_bars_of_legs_end_where_the_legs_do():
    longer = "{stiffness: 1e5, mass: {fixed: 1, fixed_com: 1.5}}"
    with pytest.raises(InputError, match=r"leg 1 is beyond its other end.*leg's length"):
        cartstiff.load(platform("m", "N", legs=longer))


@pytest.mark.parametrize(("moment", "doubtful"), [(0.5, True), (0.5e6, False)])
def test_inertia_in_other_units_is_named(moment, doubtful):
    inertia = (moment * np.eye(3)).tolist()
    found = cartstiff.load(platform("mm", "N", body=f"{{mass: 5, inertia: {inertia}}}"))
    told = [n.message for n in found.notes if n.code == "doubtful-units"]
    assert any("kg and mm^2" in words for words in told) == doubtful


def test_inertia_of_no_body_is_named(tmp_path):
    text = (
        '<robot name="r"><link name="a"/><link name="b"><inertial><mass value="2"/>'
        '<inertia ixx="{}" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>'
        '<joint name="j" type="continuous"><parent link="a"/><child link="b"/>'
        '<axis xyz="0 0 1"/></joint></robot>'
    )
    for xx, named in (("1", False), ("5", True), ("-1", True)):
        path = tmp_path / "r.urdf"
        path.write_text(text.format(xx), encoding="utf-8")
        codes = {note.code for note in cartstiff.load(path).notes}
        assert ("impossible-inertia" in codes) == named


def test_two_point_masses_are_a_body():
    """A rod turns about its own axis without inertia: rounding makes that moment negative."""
    arm = cartstiff.load("five-bar", payload=[3, 0.01, 0.02, 0.05])
    assert "impossible-inertia" not in [note.code for note in arm.notes]
