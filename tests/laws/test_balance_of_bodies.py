"""Every body of a random mechanism is in balance with the wrenches that are said of it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml

import cartstiff as cs
from cartstiff.geometry import se3

EARTH = np.array([0.0, 0.0, -9.81])


def link(name: str, rng: np.random.Generator) -> str:
    mass, c = rng.uniform(0.5, 3.0), rng.uniform(-0.2, 0.2, 3)
    inertia = '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>'
    at = " ".join(map(repr, c.tolist()))
    inner = f'<origin xyz="{at}"/><mass value="{mass}"/>{inertia}'
    return f'<link name="{name}"><inertial>{inner}</inertial></link>'


def joint(name: str, ends: tuple[str, str], place, axis, kind: str = "revolute") -> str:
    at, axis = (" ".join(map(repr, np.ravel(x).tolist())) for x in (place, axis))
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{ends[0]}"/><child link="{ends[1]}"/>'
        f'<origin xyz="{" ".join(at.split()[:3])}" rpy="{" ".join(at.split()[3:])}"/>'
        f'<axis xyz="{axis}"/><limit lower="-9" upper="9" effort="40" velocity="1"/></joint>'
    )


def tree(path: Path, rng: np.random.Generator, n: int, branches: int = 1) -> list[str]:
    """A URDF of branches with n random joints each; names of the joints."""
    parts, names = [link("ground", rng)], []
    for b in range(branches):
        before = "ground"
        for i in range(n):
            name, place = f"b{b}j{i}", rng.uniform(-0.4, 0.4, 6)
            place[:3] += np.array([0.3, 0.0, 0.0])
            kind = "prismatic" if rng.random() < 0.15 else "revolute"
            parts += [link(f"b{b}l{i}", rng)]
            parts += [joint(name, (before, f"b{b}l{i}"), place, rng.normal(size=3), kind)]
            before = f"b{b}l{i}"
            names.append(name)
    path.write_text(f"<robot name='r'>{''.join(parts)}</robot>")
    return names


def arm(folder: Path, rng: np.random.Generator) -> dict:
    names = tree(folder / "r.urdf", rng, int(rng.integers(2, 8)))
    file = {"kind": "serial", "model": "r.urdf", "frame": f"b0l{len(names) - 1}"}
    file["springs"] = {n: {"stiffness": float(rng.uniform(5e3, 5e4))} for n in names}
    if rng.random() < 0.4:
        a, b = (f"b0l{i}" for i in sorted(rng.choice(len(names), 2, replace=False)))
        points = rng.uniform(-0.3, 0.3, (2, 3)).tolist()
        file["lines"] = [{"frames": [a, b], "points": points, "stiffness": 900.0, "preload": 20.0}]
    return file


def beams(folder: Path, rng: np.random.Generator) -> dict:
    file = arm(folder, rng)
    section = {"E": 7e10, "G": 2.7e10, "length": 0.3, "area": 1e-3, "Iy": 1e-6, "Iz": 2e-6}
    more = {"J": 2e-6, "segments": int(rng.integers(1, 3)), "density": 2700.0}
    return file | {"flexible": {"b0l0": {"beam": section | more | {"outline": [0.02, 0.02]}}}}


def loop(folder: Path, rng: np.random.Generator) -> dict:
    """Two branches whose ends share a point, or are welded: six joints are needed then."""
    kind = ["point", "weld"][int(rng.integers(2))]
    n = int(rng.integers(3, 6)) if kind == "point" else int(rng.integers(4, 6))
    names, last = tree(folder / "r.urdf", rng, n, 2), n - 1
    file = {"kind": "closed-chain", "model": "r.urdf", "frame": f"b0l{last}"}
    whole = cs.load(str(folder / "r.urdf"), frame=f"b0l{last}")
    assert whole.q.size == n
    passive = [n for n in names if n.endswith(("j1", "j2")[: 1 + (kind == "weld")])]
    driven = [n for n in names if n not in passive]
    file["springs"] = {n: {"stiffness": float(rng.uniform(5e3, 5e4))} for n in driven}
    file |= {"passive": passive, "actuated": driven}
    # The ends meet where the first of them is with all joints at zero.
    ends = [pose_at_zero(folder / "r.urdf", f"b{b}l{last}") for b in range(2)]
    T = se3.inverse(ends[1]) @ ends[0]
    closure = {"frames": [f"b0l{last}", f"b1l{last}"], "type": kind}
    if kind == "point":
        closure["points"] = [[0.0, 0.0, 0.0], T[:3, 3].tolist()]
        return file | {"closures": [closure]}
    (folder / "r.urdf").write_text(
        (folder / "r.urdf").read_text().replace("</robot>", "")
        + f'<link name="end"/>{fixed("end", f"b1l{last}", T)}</robot>'
    )
    return file | {"closures": [closure | {"frames": [f"b0l{last}", "end"]}]}


def fixed(child: str, parent: str, T: np.ndarray) -> str:
    place = [*T[:3, 3], *se3.roll_pitch_yaw(T)]
    return joint(f"to_{child}", (parent, child), place, [1, 0, 0], "fixed")


def pose_at_zero(path: Path, name: str) -> np.ndarray:
    elastic = cs.load(str(path), frame=name)
    return elastic.mechanism.at(np.zeros(elastic.q.size)).pose


def lines_file(base: np.ndarray, top: np.ndarray, legs: dict, cables: bool) -> dict:
    """A heavy body on legs, or on cables."""
    return {
        "kind": "springs", "base": base.tolist(), "platform": top.tolist(), "legs": legs,
        "pose": {"xyz": [0.1, 0.0, 1.0]}, "body": {"mass": 4.0, "com": [0.02, 0.01, 0.1]},
        "unilateral": cables,
    }  # fmt: skip


def platform(folder: Path, rng: np.random.Generator) -> dict:
    m = int(rng.integers(6, 9))
    base = rng.uniform(-1.0, 1.0, (m, 3)) * [1.0, 1.0, 0.2]
    top = rng.uniform(-0.4, 0.4, (m, 3)) * [1.0, 1.0, 0.2]
    legs = {"stiffness": 1e6, "mass": {"fixed": 0.8, "moving": 0.6}}
    legs["mass"] |= {"fixed_com": 0.3, "moving_com": 0.2}
    if m > 6:
        legs["preload"] = 50.0
    if m == 8:  # cables from all around
        base = np.array([[x, y, z] for x in (-2, 2) for y in (-2, 2) for z in (0, 2)], float)
        top = base * [0.15, -0.15, 0.2] + rng.uniform(-0.05, 0.05, (m, 3)) - [0, 0, 0.2]
        legs |= {"preload": 500.0}
    return lines_file(base, top, legs, m == 8)


MAKERS = {"arm": arm, "beams": beams, "loop": loop, "platform": platform}
CASES = [(kind, seed) for kind in MAKERS for seed in range(50)]


def load(kind: str, seed: int, folder: Path) -> tuple[cs.ElasticMechanism, np.random.Generator]:
    rng = np.random.default_rng([seed, len(kind)])
    (folder / "m.yaml").write_text(yaml.safe_dump(MAKERS[kind](folder, rng)))
    return cs.load(str(folder / "m.yaml")).with_gravity(EARTH), rng


def about_origin(one) -> np.ndarray:
    """A wrench about F's origin, along F's axes."""
    W = one.in_room
    return np.concatenate([W[:3] + np.cross(one.pose[:3, 3], W[3:]), W[3:]])


@pytest.mark.parametrize("kind", MAKERS)
def test_bodies_are_in_balance(kind, tmp_path):
    checked = 0
    for seed in range(50):
        folder = tmp_path / str(seed)
        folder.mkdir()
        elastic, rng = load(kind, seed, folder)
        W = rng.uniform(-60.0, 60.0, 6)
        try:
            result = cs.analyse(elastic, wrench=W)
        except cs.CartstiffError:  # the random loop cannot be closed or held
            continue
        if result.wrench is None:
            continue
        check(result, W)
        checked += 1
    assert checked >= (45 if kind == "loop" else 50)


def check(result, W: np.ndarray) -> None:
    mechanism, wrenches = result.elastic.mechanism, result.wrenches
    largest = max(np.abs(one.wrench[3:]).max() for one in wrenches)
    load = se3.adjoint_of_inverse(result.pose).T @ W
    if result.posture.coordinates_are_pose:
        missed = load + sum(map(about_origin, wrenches)) + weight_of_platform(result)
        assert np.abs(missed).max() <= 1e-10 * largest
        return
    model = mechanism.tree.model
    names, parents = list(model.names), model.parents.tolist()
    poses = result.posture.joint_poses(range(len(names)))
    missed = np.zeros((len(names), 6))
    for i in range(1, len(names)):
        at = poses[i][:3, :3] @ model.inertias[i].lever + poses[i][:3, 3]
        force = model.inertias[i].mass * EARTH
        missed[i] += np.concatenate([np.cross(at, force), force])
    missed[mechanism.body.joint] += load
    virtual = {mechanism.names[j] for j in mechanism.virtual}
    by_name = {one.name: about_origin(one) for one in wrenches if one.kind == "joint"}
    for link in dict.fromkeys(one.name for one in wrenches if one.kind == "link"):
        near, far = (about_origin(one) for one in wrenches if one.name == link)
        own = [name for name in names if name in virtual and name.startswith(f"{link}.")]
        by_name |= {own[0]: -near, own[-1]: -far}
    between = virtual - by_name.keys()
    for i in range(1, len(names)):
        if names[i] not in between:
            missed[i] += by_name[names[i]]
            missed[parents[i]] -= by_name[names[i]]
    for closure in (one for one in wrenches if one.kind == "closure"):
        a, b = (mechanism.placement(name).joint for name in closure.name.split(" - "))
        missed[b] += about_origin(closure)
        missed[a] -= about_origin(closure)
    lines = [one for one in wrenches if one.kind == "line"]
    terms = [term for term in result.elastic.potentials if term.attachments()]
    for term, one in zip(terms, lines, strict=True):
        a, b = (mechanism.placement(name).joint for name in (term.frame_a, term.frame_b))
        missed[b] += about_origin(one)
        missed[a] -= about_origin(one)
    # What is inside a link is not said: its bodies are in balance together.
    if inside := [i for i in range(1, len(names)) if names[i] in virtual][:-1]:
        whole = missed[inside].sum(axis=0)
        missed[inside] = 0.0
        missed[inside[0]] = whole
    assert np.abs(missed[1:]).max() <= 1e-10 * max(largest, 1.0)
    torques = {one.name: one.force for one in result.forces}
    for i, name in enumerate(names[1:], start=1):
        if name in by_name and name not in virtual:
            S = mechanism.screws()[i - 1]
            own = S @ se3.adjoint(poses[i]).T @ by_name[name]
            assert own == pytest.approx(torques.get(name, 0.0), rel=0, abs=1e-10 * largest)


def weight_of_platform(result) -> np.ndarray:
    """Weight of the body alone: that of the legs is in their wrenches."""
    platform, T = result.elastic.mechanism, result.pose
    at = T[:3, :3] @ platform.mass_centre + T[:3, 3]
    force = platform.mass * EARTH
    return np.concatenate([np.cross(at, force), force])


def test_mujoco_measures_the_same_in_each_joint(tmp_path):
    mujoco = pytest.importorskip("mujoco")
    rng = np.random.default_rng(3)
    bodies, sensors, ends = "", "", ""
    for i in range(5):
        place, turn = rng.uniform(-0.3, 0.3, 3), rng.uniform(-1.0, 1.0, 3)
        place, turn, axis = (
            " ".join(map(repr, x.tolist())) for x in (place, turn, rng.normal(size=3))
        )
        bodies += (
            f'<body name="l{i}" pos="{place}" euler="{turn}"><joint name="j{i}" axis="{axis}"/>'
        )
        bodies += (
            f'<inertial pos=".1 .05 -.02" mass="{1 + i}" diaginertia="1 1 1"/><site name="s{i}"/>'
        )
        sensors += f'<torque site="s{i}"/><force site="s{i}"/>'
        ends += "</body>"
    xml = (
        '<mujoco><compiler angle="radian"/><option gravity="0.4 -0.3 -9.7"/>'
        f"<worldbody>{bodies}{ends}</worldbody><sensor>{sensors}</sensor></mujoco>"
    )
    (tmp_path / "arm.xml").write_text(xml)
    elastic = cs.load(str(tmp_path / "arm.xml"), frame="l4", stiffness=2e4)
    q, W = rng.uniform(-1.0, 1.0, 5), rng.uniform(-50.0, 50.0, 6)
    result = cs.analyse(elastic, q, wrench=W)
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    data.qpos[:] = q
    mujoco.mj_forward(model, data)
    R, at = data.xmat[5].reshape(3, 3), data.xpos[5]
    data.xfrc_applied[5] = np.concatenate(
        [R @ W[3:], R @ W[:3] - np.cross(data.xipos[5] - at, R @ W[3:])]
    )
    load = np.zeros(5)
    mujoco.mj_applyFT(model, data, R @ W[3:], R @ W[:3], at, 5, load)
    data.qfrc_applied[:] = data.qfrc_bias - load
    mujoco.mj_forward(model, data)
    assert np.abs(data.qacc).max() <= 1e-10
    found = np.array([one.wrench for one in result.wrenches])
    assert found == pytest.approx(data.sensordata.reshape(5, 6), rel=1e-8, abs=1e-8)
    torques = {one.name: one.force for one in result.forces}
    assert [torques[f"j{i}"] for i in range(5)] == pytest.approx(data.qfrc_applied, rel=1e-8)


def test_a_cantilever_has_the_bending_moment_and_stress_of_its_load(tmp_path):
    """6 F l / (b h^2) at the clamp, nothing at the tip."""
    b, h, length, force = 0.02, 0.03, 0.4, 50.0
    (tmp_path / "c.urdf").write_text(
        '<robot name="c"><link name="g"/><link name="bar"/><link name="tip"/>'
        + joint("clamp", ("g", "bar"), np.zeros(6), [0, 0, 1])
        + joint("end", ("bar", "tip"), [length, 0, 0, 0, 0, 0], [1, 0, 0], "fixed")
        + "</robot>"
    )
    beam = {"E": 2e13, "G": 8e12, "length": length, "area": b * h, "Iy": b * h**3 / 12}
    beam |= {"Iz": h * b**3 / 12, "J": 1e-8, "outline": [b / 2, h / 2]}
    file = {"kind": "closed-chain", "model": "c.urdf", "frame": "tip", "locked": {"clamp": 0.0}}
    (tmp_path / "c.yaml").write_text(yaml.safe_dump(file | {"flexible": {"bar": {"beam": beam}}}))
    elastic = cs.load(str(tmp_path / "c.yaml"))
    load = [0, 0, 0, 30.0, 0, -force]
    result = cs.equilibrium(elastic, None, cs.DeadWrench(np.array(load))).stiffness
    near, far = (one for one in result.wrenches if one.kind == "link")
    assert near.wrench == pytest.approx([0, force * length, 0, 30.0, 0, -force], rel=1e-4)
    assert far.wrench == pytest.approx([0, 0, 0, 30.0, 0, -force], rel=1e-4, abs=1e-4)
    stress = 30.0 / (b * h) + 6.0 * force * length / (b * h**2)
    assert near.stress == pytest.approx(stress, rel=1e-4)
    assert far.stress == pytest.approx(30.0 / (b * h), rel=1e-2)


def test_planar_loops_say_what_rigid_links_leave_open(tmp_path):
    """Hinges with parallel axes: the loop's forces in its plane are determined, others are not."""
    parts = [f'<link name="{n}"/>' for n in ("g", "a", "b", "c")]
    parts += [
        joint("ja", ("g", "a"), np.zeros(6), [0, 0, 1]),
        joint("jb", ("a", "b"), [0.3, 0, 0, 0, 0, 0], [0, 0, 1]),
        joint("jc", ("g", "c"), [0.5, 0, 0, 0, 0, 0], [0, 0, 1]),
    ]
    (tmp_path / "four.urdf").write_text(f"<robot name='four'>{''.join(parts)}</robot>")
    file = {
        "kind": "closed-chain", "model": "four.urdf", "frame": "b", "actuated": ["ja"],
        "springs": {"ja": {"stiffness": 1e4}}, "passive": ["jb", "jc"],
        "q": {"ja": 1.2, "jb": -1.0, "jc": 1.3},
        "closures": [{"frames": ["b", "c"], "type": "hinge", "points": [[0.5, 0, 0], [0.3, 0, 0]]}],
    }  # fmt: skip
    (tmp_path / "four.yaml").write_text(yaml.safe_dump(file))
    elastic = cs.load(str(tmp_path / "four.yaml"))
    result = cs.analyse(elastic, wrench=[0, 0, 0, 5.0, 0, 0])
    assert not all(one.is_determined for one in result.wrenches)


def test_legs_come_before_lines_that_were_added():
    platform = cs.load("stewart-gough")
    ends = {"anchors": np.array([[0.0, 0.0, 50.0]]), "points": np.zeros((1, 3))}
    line = cs.LineSprings(**ends, stiffness=np.array([3.0]), rest_length=np.array([40.0]))
    both = cs.analyse(platform.with_potential(line)).wrenches
    legs = [one.name for one in cs.analyse(platform).wrenches]
    assert len(legs) == 6
    assert len(both) == 7
    assert [one.name for one in both[:6]] == legs
