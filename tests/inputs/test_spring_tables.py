"""Joint springs by a table of points: straight pieces, their corners, energy at rest."""

import json

import numpy as np
import pytest
from scipy.optimize import brentq

import cartstiff
from cartstiff import InputError, analyse_many

URDF = """<robot name="two"><link name="g"/><link name="a"/><link name="b"/><link name="tip"/>
<joint name="s" type="revolute"><parent link="g"/><child link="a"/><axis xyz="0 1 0"/>
<limit lower="-2" upper="2" effort="30" velocity="2"/></joint>
<joint name="e" type="revolute"><parent link="a"/><child link="b"/><origin xyz="0.5 0 0"/>
<axis xyz="0 1 0"/><limit lower="-2.4" upper="2.4" effort="12" velocity="2"/></joint>
<joint name="t" type="fixed"><parent link="b"/><child link="tip"/><origin xyz="0.4 0 0"/></joint>
</robot>"""
POINTS = [[-0.1, -264.0], [-0.012, 0.0], [0.012, 0.0], [0.1, 264.0]]


@pytest.fixture
def arm(tmp_path):
    def written(table, rest=0.2):
        (tmp_path / "two.urdf").write_text(URDF, encoding="utf-8")
        path = tmp_path / "play.yaml"
        path.write_text(
            "kind: serial\nmodel: two.urdf\nframe: tip\nq: {s: 0.2, e: 0.5}\nsprings:\n"
            f"  s: {{table: {json.dumps(table)}, rest: {rest}}}\n"
            "  e: {stiffness: 3000, rest: 0.5}\n",
            encoding="utf-8",
        )
        return cartstiff.load(path)

    return written


def codes(notes):
    return {note.code: note for note in notes}


def equilibrium_by_hand(force):
    """Positions of both joints under a force down at the tip, torques by the points."""

    def angles(s_deflection):
        torque = np.interp(s_deflection, *np.transpose(POINTS))
        s = 0.2 + s_deflection
        # Moments about the joints: force times horizontal arm.
        bend = brentq(lambda x: 3000 * x - 0.4 * force * np.cos(s + 0.5 + x), -0.1, 0.1, xtol=1e-15)
        arm = 0.5 * np.cos(s) + 0.4 * np.cos(s + 0.5 + bend)
        return torque - force * arm, bend

    wound = brentq(lambda x: angles(x)[0], 0.0, 0.1, xtol=1e-15)
    return 0.2 + wound, 0.5 + angles(wound)[1]


def test_a_joint_with_play_winds_by_its_points(arm):
    elastic = arm(POINTS)
    state = cartstiff.equilibrium(elastic, wrench=[0, 0, 0, 0, 0, -50], load_axes="world")
    expected = equilibrium_by_hand(50.0)
    np.testing.assert_allclose(state.q, expected, rtol=0, atol=1e-9)
    assert expected[0] - 0.2 == pytest.approx(0.0251, abs=1e-5)


def test_at_rest_no_energy_is_stored(arm):
    for table in (POINTS, {"points": POINTS, "pieces": "smooth"}):
        assert cartstiff.analyse(arm(table)).stored_energy == 0.0


def test_how_a_table_is_read_is_said(arm):
    for table, pieces in ((POINTS, "linear"), ({"points": POINTS, "pieces": "smooth"}, "smooth")):
        elastic = arm(table)
        assert codes(elastic.notes)["spring-table"].values == {"joints": ["s"], "pieces": pieces}
        assert "spring-table" not in codes(elastic.with_springs({"s": 100.0}).notes)
        assert "spring-table" in codes(elastic.with_springs({"e": 100.0}).notes)
    with pytest.raises(InputError, match=r"pieces.*'linear' or 'smooth', got 'cubic'"):
        arm({"points": POINTS, "pieces": "cubic"})


@pytest.mark.parametrize(("deflection", "sides"), [(0.012, (0, 3000)), (-0.012, (3000, 0))])
def test_at_a_corner_both_stiffnesses_are_named(arm, deflection, sides):
    elastic = arm(POINTS)
    q = np.array([0.2 + deflection, 0.5])
    note = codes(cartstiff.analyse(elastic, q).notes)["spring-corner"]
    assert note.values["joint"] == "s"
    found = [note.values[key] for key in ("deflection", "below", "above")]
    np.testing.assert_allclose(found, [deflection, *sides], rtol=1e-12)
    for stiffness in ("0 N m/rad", "3 kN m/rad"):
        assert stiffness in note.message
    for beside in (-1e-5, 1e-5):
        assert "spring-corner" not in codes(
            cartstiff.analyse(elastic, q + np.array([beside, 0])).notes
        )


def test_many_postures_at_corners_are_those_of_one(arm):
    """Programs leave postures at a corner to `analyse`, and agree with it elsewhere."""
    elastic = arm(POINTS)
    s = 0.2 + np.array([-0.09, -0.05, 0.03, 0.06, 0.2, 0.012, -0.012])
    q = np.column_stack([s, np.full(len(s), 0.6)])
    many = analyse_many(elastic, q, outputs=("energy", "wrench", "compliance_B"))
    for i, at in enumerate(q):
        one = cartstiff.analyse(elastic, at)
        np.testing.assert_allclose(many["energy"][i], one.energy, rtol=1e-12)
        C = one.compliances["B"]
        C = np.full((6, 6), np.nan) if C is None else C
        np.testing.assert_allclose(many["compliance_B"][i], C, rtol=1e-9, atol=1e-18)
