"""Results cannot be changed behind what they print, and show themselves in a few lines."""

import json

import numpy as np
import pytest

import cartstiff
from cartstiff import DeadForce
from cartstiff.core.errors import UnknownNameError


@pytest.fixture(scope="module")
def arm():
    return cartstiff.load("ur5")


@pytest.mark.parametrize("name", ["ur5", "stewart-gough", "delta"])
def test_what_is_read_cannot_be_written_to(name):
    result = cartstiff.analyse(cartstiff.load(name))
    before = json.dumps(result.to_dict())
    arrays = [result.q, result.pose, result.wrench, result.jacobian, result.change_by_load]
    arrays += [result.tangent, result.tangent_compliance, result.closure_forces]
    arrays += [*result.matrices.values(), *result.compliances.values()]
    for array in (a for a in arrays if a is not None):
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 0.0
    with pytest.raises(TypeError, match="does not support item assignment"):
        result.matrices["A"] = np.zeros((6, 6))
    assert json.dumps(result.to_dict()) == before


def test_rest_states_modes_and_curves_cannot_be_written_to(arm):
    state = cartstiff.equilibrium(arm, wrench=[0, 0, 0, 0, 0, -50])
    curve = cartstiff.load_curve(arm, wrench=[0, 0, 0, 0, 0, -50])
    found = cartstiff.modes(arm)
    arrays = [state.q, state.pose, state.eigenvalues, curve.q, curve.factors, curve.displacement]
    for array in [*arrays, found.mass, found.stiffness, found.basis]:
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 0.0


def test_rounding_shows_as_zero():
    """Symmetric legs move straight down: nothing but rounding is left in the other coordinates."""
    state = cartstiff.equilibrium(cartstiff.load("cubic"), DeadForce([0.0, 0.0, -100.0]))
    moved = repr(state).splitlines()[2].split()
    assert moved[:3] == ["moved", "0,", "0,"]
    assert float(moved[3]) == pytest.approx(state.pose[2, 3], rel=1e-3)


def test_names_of_matrices(arm):
    result = cartstiff.analyse(arm)
    for name in ("C", "f", ""):
        with pytest.raises(UnknownNameError, match=r"unknown connection; expected .*F"):
            result.tensor(name)
    assert "C" not in result.matrices
    assert result.matrices.get("C") is None
    with pytest.raises(UnknownNameError, match=r"closest: ur5[,)]") as caught:
        cartstiff.load("ur55")
    assert "ur5, ur5" not in str(caught.value)
    assert len(set(caught.value.valid)) == len(caught.value.valid)


def test_a_few_lines(arm):
    wrench = [0.0, 0.0, 0.0, 0.0, 0.0, -100.0]
    result = cartstiff.analyse(arm, wrench=wrench)
    rest = cartstiff.equilibrium(arm, DeadForce([0.0, 0.0, -100.0]))
    many = cartstiff.analyse_many(arm, [arm.q] * 3)
    for thing, words in (
        (arm, ["ur5 (serial)", "shoulder_pan_joint", "JointSprings"]),
        (result, ["ur5 (serial)", "-100 (moment, force; body axes)", "K^A, K^B, K^K, K^F in N"]),
        (result.B, ["K^B in", "N m/rad", "N/m"]),
        (result.B.compliance(), ["C^B in", "rad/N"]),
        (rest, ["Equilibrium of ur5", ": stable", " m since the start"]),
        (many, ["3 postures (", "): 3", "stiffness_B (3, 6, 6)"]),
    ):
        text = repr(thing)
        assert 2 <= len(text.splitlines()) <= 12  # a loaded result shows its 6x6 tangent
        assert max(map(len, text.splitlines())) <= 130
        for word in words:
            assert word in text, text


def test_a_posture_in_a_notebook_is_its_answer_with_a_picture():
    """The sentences of `analyse`, and the load and the pose under it as plain SVG."""
    arm = cartstiff.load("ur5")
    html = cartstiff.analyse(arm, wrench=[0, 0, 0, 0, 0, -100], load_axes="world")._repr_html_()
    said, _, picture = html.partition("</pre><figure>")
    assert "The body frame moves 2.77 mm under the load" in said
    assert picture.count("<svg ") == 1
    assert "in green under its load, the deflection drawn 20 times as large" in picture
    assert "(the tip moves 2.77 mm); the red arrow is the force of 100 N" in picture
    assert picture.count("marker-end") == 2  # an arrow in each of two views
    assert "marker-end" not in cartstiff.analyse(arm)._repr_html_()


def test_tables_in_notebooks(arm):
    result = cartstiff.analyse(arm)
    for thing in (result, result.B, result.B.compliance()):
        html = thing._repr_html_()
        assert html.count("<tr>") == 7
        assert html.count("<td style") == 42  # the numbers, and a unit for each row
    assert "N m/rad | N" in result._repr_html_()
    value = f"{result.matrices['B'][0, 0]:.6g}"
    assert f">{value}</td>" in result.B._repr_html_()
    assert "Equilibrium of" in cartstiff.equilibrium(arm)._repr_html_()
    shown = arm._repr_html_()
    assert shown.startswith(f"<pre>{repr(arm).splitlines()[0]}")
    assert "<th>elbow_joint [rad]</th><td style='text-align:right'>1.4</td>" in shown
    assert "<th>elbow_joint [N m/rad]</th>" in shown
    rigid = arm.with_springs({"elbow_joint": np.inf})._repr_html_()
    assert "<th>elbow_joint [N m/rad]</th><td style='text-align:right'>rigid</td>" in rigid
    legs = cartstiff.load("stewart-gough")._repr_html_()
    assert "<th>leg6 [N/cm]</th>" in legs
    assert "<th>x [cm]</th>" in legs
    linkage = cartstiff.analyse(cartstiff.load("five-bar"))
    assert "none exists here" in repr(linkage)
    assert "<table>" not in linkage._repr_html_()
