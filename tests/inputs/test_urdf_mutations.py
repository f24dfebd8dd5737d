"""URDF files with one thing changed: read as Pinocchio reads the file itself, or refused."""

import copy
import xml.etree.ElementTree as ET

import numpy as np
import pinocchio as pin
import pytest
from tests.doors import read_robot_description
from tests.inner import Part, SerialFile, cut
from tests.support.robots import bundled_files, example_robots

from cartstiff import InputError

# Products of a few dozen rotations, each right to 1e-16.
ROUNDING = 1e-12
# tools/fuzz_robots.py tries thousands.
MUTATIONS = 60
# Of files of this size and more: each is read twice.
LONG, FEWER = 40_000, 20

EVERYTHING = """<robot name="everything" version="1.1">
<link name="base"><inertial><mass value="3"/><origin xyz="0.1 0 0"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="a"/><link name="b"/><link name="c"/><link name="d"/><link name="e"/><link name="f"/>
<link name="g"/>
<joint name="j1" type="revolute"><parent link="base"/><child link="a"/>
<origin xyz="0.1 0.2 0.3" quat_xyzw="0.1 0.2 -0.3 0.8"/><axis xyz="0.3 -1 2"/>
<limit lower="-1.5" upper="2.5" effort="1" velocity="1"/></joint>
<joint name="j2" type="prismatic"><parent link="a"/><child link="b"/>
<origin rpy="0.4 1.5707963267948966 -0.2"/><axis xyz="0 1 0"/>
<limit lower="-0.1" upper="0.2" effort="1" velocity="1"/></joint>
<joint name="j3" type="continuous"><parent link="b"/><child link="c"/><axis xyz="-1 0 0"/></joint>
<joint name="e" type="fixed"><parent link="b"/><child link="d"/><origin xyz="0 0 1"/></joint>
<joint name="j4" type="floating"><parent link="d"/><child link="e"/><origin xyz="0 2 0"/></joint>
<joint name="j5" type="planar"><parent link="d"/><child link="f"/><axis xyz="1 -2 0.5"/>
<origin xyz="1 0 0" rpy="0.1 0.2 0.3"/></joint>
<joint name="j6" type="revolute"><parent link="a"/><child link="g"/>
<limit lower="-1" upper="1" effort="1" velocity="1"/><axis xyz="1 0 0"/>
<mimic joint="j1" multiplier="-2" offset="0.1"/></joint>
</robot>"""


PLANE = " plane"


def for_pinocchio(text):
    """The same robot with every planar joint across its z axis, which is what Pinocchio takes."""
    root = ET.fromstring(text.encode())
    for joint in root.findall("joint"):
        axis, child, origin = (joint.find(tag) for tag in ("axis", "child", "origin"))
        if joint.get("type") != "planar" or axis is None or child is None:
            continue
        a = np.array(axis.attrib.pop("xyz").split(), float)
        a /= np.linalg.norm(a)
        v, c = np.cross([0, 0, 1], a), a[2]
        V = np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])
        R = np.eye(3) + V + V @ V / (1 + c) if c > -1 else np.diag([1.0, -1, -1])
        joint.remove(axis)
        origin = ET.SubElement(joint, "origin") if origin is None else origin
        at = pin.rpy.rpyToMatrix(*map(float, origin.get("rpy", "0 0 0").split())) @ R
        if "quat_xyzw" in origin.attrib:
            x = np.array(origin.attrib.pop("quat_xyzw").split(), float)
            at = pin.Quaternion(x / np.linalg.norm(x)).toRotationMatrix() @ R
        origin.set("rpy", " ".join(map(repr, pin.rpy.matrixToRpy(at).tolist())))
        link, name = str(child.get("link")), f"{joint.get('name')}{PLANE}"
        child.set("link", name)
        ET.SubElement(root, "link", name=name)
        back = ET.SubElement(root, "joint", name=name, type="fixed")
        ET.SubElement(back, "parent", link=name)
        ET.SubElement(back, "child", link=link)
        angles = " ".join(map(repr, pin.rpy.matrixToRpy(R.T).tolist()))
        ET.SubElement(back, "origin", rpy=angles)
    return ET.tostring(root, encoding="unicode")


def check_against_pinocchio(path, rng, capfd):
    """Compare with Pinocchio's reading of the file itself; False where that refuses the file."""
    capfd.readouterr()
    description = read_robot_description(path)
    assert capfd.readouterr() == ("", "")
    for obstacle in description.obstacles:  # refused for each frame that the joint moves
        assert obstacle.error is not None
        raise obstacle.error
    try:
        model = pin.buildModelFromXML(for_pinocchio(path.read_text(encoding="utf-8")))
    except ValueError:
        return False
    file = SerialFile.model_construct(kind="serial", model="file")
    tree = cut(Part.of(file, description, kind="closed-chain")).tree
    names = [str(n) for n in list(model.names)[1:]]
    leaders = description.followers
    q = rng.uniform(-1, 1, tree.n)
    given = dict(zip((c.name for c in tree.coordinates), q.tolist(), strict=True))
    for follower, (leader, factor, offset) in leaders.items():
        if leader in given:
            given[follower] = factor * given[leader] + offset
    theirs = pin.neutral(model)
    for name, joint in zip(names, list(model.joints)[1:], strict=True):
        if joint.nv == 1:
            x = given[name]
            theirs[joint.idx_q : joint.idx_q + joint.nq] = (
                [np.cos(x), np.sin(x)] if joint.nq == 2 else x
            )
            led = [leader for leader, _, _ in leaders.values()]  # followers' limits narrow these
            if joint.nq == 1 and name not in {*leaders, *led}:
                c = next(c for c in tree.coordinates if c.name == name)
                limits = (
                    model.lowerPositionLimit[joint.idx_q],
                    model.upperPositionLimit[joint.idx_q],
                )
                assert (c.lower, c.upper) == limits
        else:  # planar: x, y, angle; floating: x, y, z and three turns
            x = [v for n, v in given.items() if n.startswith(f"{name}.")]
            if len(x) == 3:
                turned = [x[0], x[1], np.cos(x[2]), np.sin(x[2])]
            else:
                R = np.linalg.multi_dot(
                    [pin.utils.rotate(a, v) for a, v in zip("xyz", x[3:], strict=True)]
                )
                turned = [*x[:3], *pin.Quaternion(R).coeffs()]
            theirs[joint.idx_q : joint.idx_q + joint.nq] = turned
    data = model.createData()
    pin.framesForwardKinematics(model, data, theirs)
    state = tree.at(q)
    frames = {}
    planes = {}
    for kind in (pin.FrameType.BODY, None):
        for index, frame in enumerate(model.frames):
            if PLANE in frame.name:
                if frame.type == pin.FrameType.FIXED_JOINT:  # turned back
                    planes[frame.name.removesuffix(PLANE)] = data.oMf[index].homogeneous
                continue
            if kind is None or frame.type == kind:
                frames.setdefault(frame.name, data.oMf[index].homogeneous)
    assert set(tree.frames) == {*frames, "world"}
    for name, T in frames.items():
        if name != "world":
            T = planes.get(name, T)
            assert np.abs(state.pose(tree.frames[name]) - T).max() < ROUNDING, name
    masses, _ = tree.masses()
    moved = sum(inertia.mass for inertia in list(model.inertias)[1:])
    assert abs(masses.sum() - moved) <= ROUNDING * max(moved, 1.0)
    acceleration = rng.standard_normal(3)
    model.gravity = pin.Motion(np.concatenate([acceleration, np.zeros(3)]))
    root = model.inertias[0]
    energy = pin.computePotentialEnergy(model, data, theirs) + root.mass * acceleration @ root.lever
    own = state.gravity(acceleration).energy + root.mass * acceleration @ root.lever
    assert abs(own - energy) <= ROUNDING * max(abs(energy), 1.0)
    return True


SLIPS = {"origin": "orgin", "axis": "axes", "limit": "limits", "inertial": "inertail"} | {
    "mass": "masss",
    "xyz": "xzy",
    "rpy": "ryp",
    "lower": "lowr",
    "link": "lnik",
    "joint": "jiont",
    "parent": "parnet",
    "child": "chlid",
    "mimic": "mimc",
    "value": "valeu",
}
NUMBERS = {"xyz", "rpy", "quat_xyzw", "lower", "upper", "value", "multiplier", "offset"}


def mutated(root, rng):
    """A copy with one thing changed: of what bears on statics, in a random place."""
    root = copy.deepcopy(root)
    parts = {"joint", "link", "inertial", "origin", "axis", "limit", "mimic", "mass"} | {
        "parent",
        "child",
    }
    places = [
        (parent, child)
        for top in root
        if top.tag in ("link", "joint")
        for parent in (root, *top.iter())
        for child in (parent if parent is not root else [top])
        if child.tag in parts
    ]
    parent, child = places[rng.integers(len(places))]
    key = rng.choice(sorted(child.attrib)) if child.attrib else None
    action = rng.integers(12)
    if action == 0:
        parent.remove(child)
    elif action == 1:
        parent.append(copy.deepcopy(child))
    elif action == 2 and key:
        del child.attrib[key]
    elif action == 3 and key:
        child.attrib[SLIPS.get(key, key + "s")] = child.attrib.pop(key)
    elif action == 4:
        child.tag = SLIPS.get(child.tag, child.tag + "s")
    elif action in (5, 6, 7) and key in NUMBERS:
        count = len(child.attrib[key].split())
        child.set(key, " ".join(repr(float(x)) for x in rng.uniform(-2, 2, count)))
    elif action == 8 and child.tag == "joint":
        kinds = ("revolute", "continuous", "prismatic", "fixed", "floating", "planar", "hinge")
        child.set("type", str(rng.choice(kinds)))
    elif action == 9:
        child.text = "1 2 3"
    elif action == 10:
        root.set("version", str(rng.choice(["1.0", "1.1", "1.2", "2.0"])))
        for origin in root.iter("origin"):
            if "rpy" in origin.attrib and rng.random() < 0.5:
                del origin.attrib["rpy"]
                origin.set("quat_xyzw", " ".join(map(repr, rng.standard_normal(4).tolist())))
    elif action == 11 and child.get("name"):  # a joint named like a link, a link like a joint
        others = [e.get("name") for e in root if e.tag in ("link", "joint") and e is not child]
        new = str(rng.choice([str(o) for o in others]))
        if child.tag == "joint":
            child.set("name", new)
    return root


def sources():
    found = {"everything": EVERYTHING}
    folder = next(iter(bundled_files().values())).parent
    found |= {p.stem: p.read_text(encoding="utf-8") for p in sorted(folder.glob("*.urdf"))}
    for name in ("ur5", "panda", "tiago"):
        path = example_robots().get(name)
        if path is not None:
            found[name] = path.read_text(encoding="utf-8")
    return found


SOURCES = sources()


@pytest.mark.parametrize("name", SOURCES)
def test_read_as_pinocchio_reads_it_or_refused(name, tmp_path, capfd):
    rng = np.random.default_rng(sum(name.encode()))
    path = tmp_path / "robot.urdf"
    path.write_text(SOURCES[name], encoding="utf-8")
    assert check_against_pinocchio(path, rng, capfd)
    root = ET.fromstring(SOURCES[name].encode())
    same = refused = 0
    count = MUTATIONS if len(SOURCES[name]) < LONG else FEWER
    for _ in range(count):
        ET.ElementTree(mutated(root, rng)).write(path, encoding="utf-8")
        try:
            same += check_against_pinocchio(path, rng, capfd)
        except InputError:
            refused += 1
    assert same > count // 5
    assert refused > count // 10
