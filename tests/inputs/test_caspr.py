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
        (cables(cable(0).replace("<link>1<", "<link>2<")), {}, "a cable ends on no body"),
        (cables(cable(0).replace(">5e4<", ">stiff<")), {}, "K_cable cannot be used"),
        (cables(cable(0).replace(">5e4<", ">-1<")), {}, "above zero"),
        (cables(cable(0, reference="tip")), {}, "unknown attachment_reference"),
        (cables().replace('"b">', '"c">', 1), {}, "default set of cables does not exist"),
        ("<cables></cables>", {}, "no set of cables"),
        ("<cables><cable_set id='a'/></cables>", {}, "a set without cables"),
        (cables(head='<!DOCTYPE a [<!ENTITY b "c">]>'), {}, "box_cables.xml"),
        (None, {"bodies": None}, "file of bodies is missing"),
        (None, _bodies("SPATIAL_EULER_XYZ", "R_XYZ"), "kind of joint is not supported.*got R_XYZ"),
        (None, _bodies("</links>", "<link_rigid/></links>"), "body 2: a body without a joint type"),
        (None, _bodies("0.1 0.2 1.0", "0.1 0.2"), "q_initial cannot be used"),
        (None, _bodies("<mass>4<", "<mass>heavy<"), "mass cannot be used"),
    ],
)
def test_what_is_not_served_is_named(robot, text, options, match):
    with pytest.raises(InputError, match=match) as refusal:
        cartstiff.load(robot(text, **options))
    assert "\n" not in str(refusal.value)


def turn(axis, angle):
    c, s = np.cos(angle), np.sin(angle)
    i, j = (k for k in range(3) if k != axis)
    R = np.eye(3)
    R[i, i] = R[j, j] = c
    R[i, j], R[j, i] = (-s, s) if axis != 1 else (s, -s)
    return R


JOINTS = "<joint type='{}' {} q_initial='{}' q_min='{}' q_max='{}'/>"


def link(i, joint, q, com, parent=0, location="0 0 0", more=""):
    wide = " ".join(["3"] * len(q.split()))
    low = " ".join(["-3"] * len(q.split()))
    return (
        f'<link_rigid num="{i}" name="link {i}">{JOINTS.format(joint, more, q, low, wide)}'
        f"<physical><mass>{i}</mass><com_location>{com}</com_location><end_location>0 0 0.4"
        "</end_location></physical><parent>"
        f"<num>{parent}</num><location>{location}</location></parent></link_rigid>"
    )


SHOULDER, ELBOW = (0.2, -0.3, 0.1), -0.4
COMS = {1: np.array([0, 0, 0.2]), 2: np.array([0, 0.05, 0.15])}
CABLES = [  # bodies, points, reference
    (0, 1, (0.5, 0.1, 0), (0.1, 0, 0.1), "joint"),
    (0, 1, (-0.5, 0.2, 0), (-0.1, 0, 0.1), "joint"),
    (0, 1, (0.1, 0.6, 0), (0, 0.1, 0.1), "joint"),
    (0, 1, (0, -0.5, 0.1), (0, -0.1, 0.1), "joint"),
    (0, 2, (0.4, -0.4, 0.2), (0.1, 0.1, 0.2), "com"),
    (1, 2, (0, 0.1, 0.1), (0, 0.1, 0), "com"),
    (2, 1, (0, -0.1, 0.2), (0, -0.1, 0.1), "joint"),
    (0, 2, (-0.5, 0, 0.9), (0, 0, 0.3), "joint"),
]


def arm(folder, cables=CABLES):
    """A spherical shoulder and an elbow about an axis of its own, held by cables."""
    folder.joinpath("arm_bodies.xml").write_text(
        "<links>"
        + link(1, "S_EULER_XYZ", " ".join(map(str, SHOULDER)), "0 0 0.2", 0, "0.1 0 0.2")
        + link(2, "R_AXIS", str(ELBOW), "0 0.05 0.15", 1, "0 0 0.5", "axis='2 0 0'")
        + "</links>"
    )
    rows = [
        f'<cable_linear_spring name="c{i}" attachment_reference="{reference}"><properties>'
        f"<K_cable>4e4</K_cable><force_min>5</force_min><force_max>900</force_max></properties>"
        f"<attachments><attachment><link>{a}</link><location>{words(p)}</location></attachment>"
        f"<attachment><link>{b}</link><location>{words(r)}</location></attachment></attachments>"
        "</cable_linear_spring>"
        for i, (a, b, p, r, reference) in enumerate(cables)
    ]
    path = folder / "arm_cables.xml"
    path.write_text(
        '﻿<?xml version="1.0"?>\n<!DOCTYPE cables\n PUBLIC "" "../cables.dtd">\n<cables '
        f'default_cable_set="a"><cable_set id="a">{"".join(rows)}</cable_set></cables>'
    )
    return path


def lengths(q):
    """Of the cables, from CASPR's own formulas: R = Rx Ry Rz, then about x."""
    R1 = turn(0, q[0]) @ turn(1, q[1]) @ turn(2, q[2])
    p1 = np.array([0.1, 0, 0.2])
    R2, p2 = R1 @ turn(0, q[3]), p1 + R1 @ np.array([0, 0, 0.5])
    at = {0: (np.eye(3), np.zeros(3)), 1: (R1, p1), 2: (R2, p2)}

    def place(body, point, reference):
        R, p = at[body]
        return p + R @ (np.array(point) + (COMS[body] if body and reference == "com" else 0))

    return np.array(
        [np.linalg.norm(place(a, p, w) - place(b, r, w)) for a, b, p, r, w in CABLES]
    ), p2 + R2 @ np.array([0, 0, 0.4])


def test_bodies_on_joints_are_held_by_cables_between_them(tmp_path):
    """Pose, balance and stiffness against differences of the energy of the cables."""
    elastic = cartstiff.load(arm(tmp_path))
    assert elastic.names == ("link_1.Rx", "link_1.Ry", "link_1.Rz", "link_2")
    q = np.array([*SHOULDER, ELBOW])
    assert np.array_equal(elastic.q, q)
    result = cartstiff.analyse(elastic)
    here, end = lengths(q)
    assert np.allclose(result.pose[:3, 3], end, atol=1e-14)
    lines = [p for p in elastic.potentials if isinstance(p, LineSprings)]
    k = np.array([p.stiffness[0] for p in lines])
    rest = np.array([p.rest_length[0] for p in lines])
    assert np.allclose(k * here, 4e4, rtol=1e-12)
    tensions = k * (here - rest)
    assert (tensions > 5 - 1e-6).all()
    assert (tensions < 900).all()

    def energy(x):
        stretched = lengths(x)[0] - rest  # all of them are taut
        return 0.5 * k @ stretched**2

    h, I = 1e-4, np.eye(4)  # noqa: E741
    gradient = [(energy(q + h * e) - energy(q - h * e)) / (2 * h) for e in I]
    assert np.abs(gradient).max() < 1e-4 * k.max() * h
    hessian = [
        [
            (
                energy(q + h * (a + b))
                - energy(q + h * (a - b))
                - energy(q - h * (a - b))
                + energy(q - h * (a + b))
            )
            / (4 * h * h)
            for a in I
        ]
        for b in I
    ]
    J = result.jacobian
    expected = J @ np.linalg.inv(hessian) @ J.T
    assert np.allclose(result.compliances["B"], expected, rtol=0, atol=2e-5 * expected.max())


def test_cables_that_cannot_balance_say_so(tmp_path):
    elastic = cartstiff.load(arm(tmp_path, CABLES[:2]))
    assert "cables-not-balanced" in {note.code for note in elastic.notes}
    assert cartstiff.load(arm(tmp_path), frame="link_1").mechanism.frame == "link_1"


@pytest.mark.parametrize(
    ("before", "after", "match"),
    [
        ("'S_EULER_XYZ'", "'MUSCLE'", "kind of joint is not supported"),
        ("<num>1</num>", "<num>2</num>", "parent is no earlier body"),
        ("axis='2 0 0'", "axis='0 0 0'", "axis is zero"),
        ("axis='2 0 0'", "", "axis cannot be used; expected 3 numbers"),
        ("link 2", "link 1", "two bodies have one name"),
        ("<mass>2<", "<mass>-2<", "mass is negative"),
    ],
)
def test_what_cannot_be_a_chain_is_named(tmp_path, before, after, match):
    path = arm(tmp_path)
    bodies = tmp_path / "arm_bodies.xml"
    bodies.write_text(bodies.read_text().replace(before, after, 1))
    with pytest.raises(InputError, match=match):
        cartstiff.load(path)
