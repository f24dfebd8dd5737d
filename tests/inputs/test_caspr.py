"""Cable robots in the form of CASPR: straight cables are read, all else is named."""

from __future__ import annotations

import numpy as np
import pytest

import cartstiff
from cartstiff.errors import InputError
from cartstiff.potentials.line_springs import LineSprings

BASE = [(x, y, z) for z in (0.0, 2.0) for y in (-2.0, 2.0) for x in (-3.0, 3.0)]
BODY = [(x / 10, y / 10, (1.0 - z) / 5) for x, y, z in BASE]
BODIES = """<?xml version="1.0" encoding="utf-8"?>
<links><link_rigid num="1" name="box">
<joint type="SPATIAL_EULER_XYZ" q_initial="0.1 0.2 1.0 0.1 -0.2 0.3"/>
<physical><mass>4</mass><com_location>0 0 0.05</com_location><end_location>0 0 0</end_location>
<inertia ref="com"><Ixx>0.1</Ixx><Iyy>0.2</Iyy><Izz>0.25</Izz><Ixy>0</Ixy><Ixz>0.01</Ixz>
<Iyz>0</Iyz></inertia></physical>
<parent><num>0</num><location>0 0 0.5</location></parent></link_rigid></links>"""


def words(point) -> str:
    return " ".join(map(str, point))


def cable(i, kind="cable_linear_spring", reference="joint", more="", k="<K_cable>5e4</K_cable>"):
    return (
        f'<{kind} name="cable {i + 1}" attachment_reference="{reference}"><properties>{k}'
        "<force_min>0</force_min></properties><attachments>"
        f"<attachment><link>0</link><location>{words(BASE[i])}</location></attachment>"
        f"<attachment><link>1</link><location>{words(BODY[i])}</location></attachment>{more}"
        f"</attachments></{kind}>"
    )


def cables(*own, head="<!DOCTYPE cables [\n<!ATTLIST cable_set id ID #REQUIRED>\n]>"):
    inner = "".join(own or map(cable, range(8)))
    return (
        f'<?xml version="1.0"?>\n{head}\n<cables default_cable_set="b">'
        f'<cable_set id="a">{cable(0)}</cable_set><cable_set id="b">{inner}</cable_set></cables>'
    )


@pytest.fixture
def robot(tmp_path):
    def write(text=None, bodies=BODIES):
        (tmp_path / "box_cables.xml").write_text(cables() if text is None else text)
        if bodies is not None:
            (tmp_path / "box_bodies.xml").write_text(bodies)
        return tmp_path / "box_cables.xml"

    return write


def test_it_is_the_body_on_cables_written_out(robot):
    arm = cartstiff.load(robot())
    c, s = np.cos([0.1, -0.2, 0.3]), np.sin([0.1, -0.2, 0.3])
    Rx = np.array([[1, 0, 0], [0, c[0], -s[0]], [0, s[0], c[0]]])
    Ry = np.array([[c[1], 0, s[1]], [0, 1, 0], [-s[1], 0, c[1]]])
    Rz = np.array([[c[2], -s[2], 0], [s[2], c[2], 0], [0, 0, 1]])
    R, p = Rx @ Ry @ Rz, np.array([0.1, 0.2, 1.5])
    result = cartstiff.analyse(arm)
    np.testing.assert_allclose(result.pose[:3, :3], R, atol=1e-12)
    np.testing.assert_allclose(result.pose[:3, 3], p, atol=1e-12)
    lines = np.array(BODY) @ R.T + p - np.array(BASE)
    lengths = np.linalg.norm(lines, axis=1)
    assert isinstance(arm.springs, LineSprings)
    np.testing.assert_allclose(arm.springs.stiffness, 5e4 / lengths, rtol=1e-12)
    u = lines / lengths[:, None] @ R
    g = np.hstack([np.cross(BODY, u), u])
    np.testing.assert_allclose(
        result.matrices["B"], (g.T * (5e4 / lengths)) @ g, rtol=1e-9, atol=1e-6
    )
    assert arm.masses == {"platform": 4.0}
    assert "cable-set" in [note.code for note in arm.notes]
    again = cartstiff.load(robot().with_name("box_bodies.xml"))
    np.testing.assert_array_equal(again.springs.stiffness, arm.springs.stiffness)


def test_ideal_cables_have_a_stiffness_that_is_said(robot):
    ideal = [cable(i, "cable_ideal", "com", k="") for i in range(8)]
    arm = cartstiff.load(robot(cables(*ideal)), stiffness=3e4)
    assert arm.springs.stiffness.tolist() == [3e4] * 8
    arm = cartstiff.load(robot(cables(*ideal)))
    assert "stiffness-assumed" in [note.code for note in arm.notes]
    moved = np.add(BODY, [0, 0, 0.05])
    np.testing.assert_allclose(arm.mechanism.points_P, moved)


def _bodies(old, new):
    return {"bodies": BODIES.replace(old, new)}


@pytest.mark.parametrize(
    ("text", "options", "match"),
    [
        (cables(cable(0, more="<pulley/>")), {}, "cable 1: pulleys are not modelled"),
        (cables(cable(0, "cable_vsd_torsion_spring")), {}, "kind of cable is not modelled"),
        (cables(cable(0, more="<attachment><link>1</link></attachment>")), {}, "got 3"),
        (cables(cable(0).replace("<link>1<", "<link>2<")), {}, "link 0, and the body"),
        (cables(cable(0).replace(">5e4<", ">stiff<")), {}, "K_cable cannot be used"),
        (cables(cable(0).replace(">5e4<", ">-1<")), {}, "above zero"),
        (cables(cable(0, reference="tip")), {}, "unknown attachment_reference"),
        (cables().replace('"b">', '"c">', 1), {}, "default set of cables does not exist"),
        ("<cables></cables>", {}, "no set of cables"),
        ("<cables><cable_set id='a'/></cables>", {}, "a set without cables"),
        (cables(head='<!DOCTYPE a [<!ENTITY b "c">]>'), {}, "box_cables.xml"),
        (None, {"bodies": None}, "file of bodies is missing"),
        (None, _bodies("SPATIAL_EULER_XYZ", "R_XYZ"), "move freely.*got R_XYZ"),
        (None, _bodies("</links>", "<link_rigid/></links>"), "2 rigid bodies"),
        (None, _bodies("0.1 0.2 1.0", "0.1 0.2"), "q_initial cannot be used"),
        (None, _bodies("<mass>4<", "<mass>heavy<"), "mass cannot be used"),
    ],
)
def test_what_is_not_served_is_named(robot, text, options, match):
    with pytest.raises(InputError, match=match) as refusal:
        cartstiff.load(robot(text, **options))
    assert "\n" not in str(refusal.value)
