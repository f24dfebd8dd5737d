"""Compare what cartstiff reads from MJCF files with what MuJoCo says they mean.

    python tools/mjcf_against_mujoco.py files FOLDER ...      every MJCF file below some folders
    python tools/mjcf_against_mujoco.py mutants -n 4000       changed small files, from a seed

For each file: the pose of every body and site at random postures, limits, masses and their
centres, joint springs, gravity and the gaps of ties are MuJoCo's to rounding, or the file is
refused, or a note says what differs. "wrong" must be 0; the exit code says so.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import re
import sys
import tempfile
import traceback
import warnings
import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

import cartstiff
from cartstiff import CartstiffError, InputError
from cartstiff.files.assembly import Part
from cartstiff.files.joints import cut
from cartstiff.files.mjcf import reading as mjcf
from cartstiff.files.mjcf import worker as mjcf_worker
from cartstiff.files.readers import read_robot_description
from cartstiff.files.schema import SerialFile

#: Chains of some ten products of matrices of doubles, in metres.
ROUNDING = 1e-10


def rotation(turns: Any) -> Any:
    """Quaternion of turns about x, the new y, the new z."""
    total = np.array([1.0, 0, 0, 0])
    for axis, angle in enumerate(turns):
        step, product = np.zeros(4), np.zeros(4)
        mujoco.mju_axisAngle2Quat(step, np.eye(3)[axis], angle)
        mujoco.mju_mulQuat(product, total, step)
        total = product
    return total


def position(model: Any, names: list[str], q: dict[str, float]) -> Any:
    """MuJoCo's qpos of our coordinates, by joint in the file's order."""
    qpos, rest = model.qpos0.copy(), list(names)
    for j in range(model.njnt):
        at, kind = model.jnt_qposadr[j], model.jnt_type[j]
        if kind == mujoco.mjtJoint.mjJNT_FREE:
            own, rest = [q[n] for n in rest[:6]], rest[6:]
            qpos[at : at + 3] = own[:3]
            mujoco.mju_mulQuat(
                qpos[at + 3 : at + 7], model.qpos0[at + 3 : at + 7].copy(), rotation(own[3:])
            )
        elif kind == mujoco.mjtJoint.mjJNT_BALL:
            own, rest = [q[n] for n in rest[:3]], rest[3:]
            qpos[at : at + 4] = rotation(own)
        else:
            qpos[at], rest = q[rest[0]], rest[1:]
    return qpos


def differences(path: Path, seed: int = 0) -> list[str]:
    """What cartstiff reads otherwise than MuJoCo; raises what either of them raises."""
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    description = read_robot_description(path)
    found: list[str] = []

    def compare(what: str, got: Any, expected: Any) -> None:
        got, expected = np.asarray(got, float), np.asarray(expected, float)
        if got.shape != expected.shape:
            found.append(f"{what}: shape {got.shape}, MuJoCo {expected.shape}")
            return
        with np.errstate(invalid="ignore"):  # of infinities
            near = np.abs(got - expected) <= ROUNDING * (1 + np.abs(expected))
        same = (got == expected) | near
        if not same.all():
            found.append(f"{what}: {got.ravel()[:7]}, MuJoCo {expected.ravel()[:7]}")

    # All joints of the tree as Pinocchio would have them, without couplings.
    names = list(description.model.names)[1:]
    free = [n for n in names if n not in description.followers and n not in description.locked]
    file = SerialFile.model_construct(kind="serial", model=str(path))
    tree = cut(Part.of(file, description, kind="closed-chain")).tree
    compare("coordinates", len(tree.coordinates), len(free))
    held = set(description.locked)
    moving = [b for b in range(1, model.nbody) if moves(model, b, held)]
    rng = np.random.default_rng(seed)
    for _ in range(3):
        q = rng.uniform(-1.5, 1.5, len(free))
        values = dict(zip(free, q, strict=True)) | description.locked
        for _ in description.followers:
            for follower, (leader, factor, offset) in description.followers.items():
                if leader in values:
                    values[follower] = factor * values[leader] + offset
        data.qpos[:] = position(model, names, values)
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        reference = [tree.coordinates[i].name for i in range(tree.n)]
        state = tree.at(np.array([values[n] for n in reference]))
        for b in range(1, model.nbody):
            name = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_BODY, b)
            if name in tree.frames:
                T = state.pose(tree.frames[name])
                compare(f"position of body {name}", T[:3, 3], data.xpos[b])
                compare(f"orientation of body {name}", T[:3, :3].ravel(), data.xmat[b])
            elif name:
                found.append(f"body {name} is no frame")
        for s in range(model.nsite):
            name = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_SITE, s)
            if not name:
                continue
            taken = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, name) >= 0
            at = tree.frames.get(f"{name} (site)" if taken else name)
            if at is None:
                found.append(f"site {name} is no frame")
                continue
            R = np.zeros(9)
            mujoco.mju_quat2Mat(R, model.site_quat[s])
            # From the body: MuJoCo takes frames within 1e-6 of each other for the same.
            R_b = data.xmat[model.site_bodyid[s]].reshape(3, 3)
            p = data.xpos[model.site_bodyid[s]] + R_b @ model.site_pos[s]
            compare(f"position of site {name}", state.pose(at)[:3, 3], p)
            compare(f"orientation of site {name}", state.pose(at)[:3, :3], R_b @ R.reshape(3, 3))
        if not description.weightless:
            g = np.array([1.0, -2.0, 3.0])
            energy = -sum(model.body_mass[b] * g @ data.xipos[b] for b in moving)
            compare("potential energy", state.gravity(g).energy, energy)
    if not description.weightless:
        mass = sum(b.mass for b in list(tree.model.inertias)[1:])
        compare("mass", mass, sum(model.body_mass[b] for b in moving))
    off = model.opt.disableflags
    has_limits = not off & (
        mujoco.mjtDisableBit.mjDSBL_LIMIT | mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    )
    rest = list(names)
    limits = {
        n: (lower, upper)
        for n, lower, upper in zip(
            names,
            description.model.lowerPositionLimit,
            description.model.upperPositionLimit,
            strict=True,
        )
    }
    folded = {_leader(f, description.followers) for f in description.followers}
    for j in range(model.njnt):
        count = {0: 6, 1: 3}.get(int(model.jnt_type[j]), 1)
        own, rest = rest[:count], rest[count:]
        if count > 1:
            continue
        limited = model.jnt_limited[j] and has_limits
        expected = tuple(model.jnt_range[j]) if limited else (-np.inf, np.inf)
        compare(f"limits of {own[0]}", limits[own[0]], expected)
        spring = description.springs.get(own[0])
        k = model.jnt_stiffness[j] if not off & mujoco.mjtDisableBit.mjDSBL_SPRING else 0.0
        if own[0] in folded or own[0] in description.followers or k < 0.0:  # negative: refused
            continue
        compare(f"stiffness of {own[0]}", spring.coefficients[0] if spring else 0.0, k)
        if spring and k:
            compare(f"rest of {own[0]}", spring.rest, model.qpos_spring[model.jnt_qposadr[j]])
    g = model.opt.gravity
    weighs = bool(g.any()) and not off & mujoco.mjtDisableBit.mjDSBL_GRAVITY
    compare(
        "gravity",
        np.zeros(3) if description.gravity is None else description.gravity,
        g if weighs else np.zeros(3),
    )
    active = 0
    if not off & (mujoco.mjtDisableBit.mjDSBL_EQUALITY | mujoco.mjtDisableBit.mjDSBL_CONSTRAINT):
        active = sum(
            int(model.eq_active0[e])
            for e in range(model.neq)
            if int(model.eq_type[e]) in (0, 1) and not to_mocap(model, e)  # connect, weld
        )
    compare("closures", len(description.closures), active)
    found += closure_differences(model, data, tree, description, position)
    return found


def moves(model: Any, body: int, held: set[str]) -> bool:
    """Whether a joint that is not held stands between the world and a body."""
    while body > 0:
        start = model.body_jntadr[body]
        for j in range(start, start + model.body_jntnum[body]):
            if mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_JOINT, j) not in held:
                return True
        body = model.body_parentid[body]
    return False


def to_mocap(model: Any, e: int) -> bool:
    """Whether an equality ties something to a mocap body."""
    ends = [int(model.eq_obj1id[e]), int(model.eq_obj2id[e])]
    if model.eq_objtype[e] == int(mujoco.mjtObj.mjOBJ_SITE):
        ends = [int(model.site_bodyid[s]) for s in ends]
    return any(model.body_mocapid[b] >= 0 for b in ends)


def _leader(name: str, followers: Any) -> str:
    while name in followers:
        name = followers[name][0]
    return name


def closure_differences(
    model: Any, data: Any, tree: Any, description: Any, position: Any
) -> list[str]:
    """The gaps of ties, as MuJoCo measures them at a random posture."""
    del position
    if not description.closures or description.followers or description.locked:
        return []
    if any(to_mocap(model, e) for e in range(model.neq)):
        return []
    if any(model.jnt_type[j] < 2 for j in range(model.njnt)):
        return []
    q = np.random.default_rng(1).uniform(-1, 1, tree.n)
    data.qpos[:] = q
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    mujoco.mj_forward(model, data)
    state = tree.at(q)
    gaps = []
    for tie in description.closures:
        T_a = state.pose(tree.frames[tie.body_a]) @ tie.T_a
        T_b = state.pose(tree.frames[tie.body_b]) @ tie.T_b
        gaps.append(np.linalg.norm(T_a[:3, 3] - T_b[:3, 3]))
    kinds = mujoco.mjtConstraint.mjCNSTR_EQUALITY
    rows = data.efc_pos[: data.nefc][data.efc_type[: data.nefc] == kinds]
    expected, at = [], 0
    for tie in description.closures:
        expected.append(np.linalg.norm(rows[at : at + 3]))
        at += 3 if tie.type == "point" else 6
    if rows.size == 0:
        return []  # MuJoCo leaves out rows that no joint changes at this posture
    if at != rows.size:
        return [f"rows of closures: {at}, MuJoCo {rows.size}"]
    if not np.allclose(gaps, expected, atol=ROUNDING, rtol=ROUNDING):
        return [f"gaps of closures: {gaps}, MuJoCo {expected}"]
    return []


def verdict(path: Path, seed: int = 0) -> tuple[str, str]:
    """same, refused, refused by both, accepted alone, wrong, or broken; and the words."""
    try:
        found = differences(path, seed)
    except CartstiffError as error:
        return "refused", str(error)
    except (ValueError, mujoco.FatalError) as error:
        if isinstance(error, ValueError) and "Error" not in str(error):
            return "broken", "".join(traceback.format_exception(error)[-3:])
        try:
            mjcf.read_mjcf(path, path.name)
        except CartstiffError as refusal:
            return "refused by both", str(refusal)
        return "accepted alone", str(error).replace("\n", " ")
    except Exception as error:
        return "broken", "".join(traceback.format_exception(error)[-3:])
    return ("wrong", "; ".join(found[:3])) if found else ("same", "")


# -- changed files ---------------------------------------------------------------------------------

SEEDS = [
    """<mujoco model="arm"><compiler angle="radian" autolimits="true"/><option gravity="0 0 -9.8"/>
<default><joint stiffness="5" armature=".1"/><site pos="0 0 .1"/><geom density="500"/>
<default class="soft"><joint stiffness="7" axis="0 1 0" range="-1 2"/><site pos=".2 0 0"/></default>
</default>
<worldbody><geom type="plane" size="1 1 1"/><site name="base"/>
<body name="a" pos="0 0 1" euler=".1 .2 .3"><joint name="j1" axis="0 0 1" range="-1 1" ref=".2"/>
<inertial pos="0 0 .1" mass="1" diaginertia="1 1 1"/>
<body name="b" pos="1 0 0" childclass="soft"><joint name="j2" pos=".1 0 0" springref=".3"/>
<joint name="j3" type="slide" axis="1 0 0" range="-.5 .5" ref=".1"/>
<geom type="sphere" size=".1"/><geom type="capsule" fromto="0 0 0 .1 .2 .3" size=".05" mass="2"/>
<site name="tip" class="soft"/>
<body name="c" pos="0 .2 0" gravcomp="1"><joint name="j4" type="ball" range="0 2" stiffness="0"/>
<geom type="box" size=".1 .2 .3"/><site name="end" zaxis="1 2 3"/></body></body></body></worldbody>
<keyframe><key name="home" qpos=".1 .2 .3 1 0 0 0"/></keyframe>
<actuator><position name="m1" joint="j1" kp="100"/></actuator></mujoco>""",
    """<mujoco model="loop"><compiler angle="degree" eulerseq="zyx"/>
<default><joint type="hinge" axis="0 0 1"/><geom type="capsule" size=".02"/></default>
<worldbody>
<body name="crank" pos="-.15 0 0"><joint name="m1" stiffness="35" springref="20"/>
<geom fromto="0 0 0 .25 0 0"/>
<body name="coupler" pos=".25 0 0"><joint name="e1" limited="true" range="-170 170"/>
<geom fromto="0 0 0 .3 0 0"/><site name="pin" pos=".3 0 0"/></body></body>
<body name="rocker" pos=".15 0 0" euler="0 0 10"><joint name="m2" stiffness="50 2"/>
<geom fromto="0 0 0 .25 0 0"/>
<body name="link" pos=".25 0 0"><joint name="e2"/><geom fromto="0 0 0 .3 0 0"/>
<site name="hole" pos=".2 0 0"/></body></body>
</worldbody>
<equality><connect name="tie" body1="coupler" body2="link" anchor=".3 0 0"/>
<weld active="false" body1="crank" body2="link"/>
<joint joint1="m2" joint2="m1" polycoef=".1 .5 0 0 0" active="false"/></equality></mujoco>""",
    """<mujoco model="free"><compiler settotalmass="12" inertiafromgeom="true"/>
<option gravity="0 -1 -9"><flag gravity="enable"/></option>
<default><default class="leg"><joint type="slide" axis="0 0 1" stiffness="1e5" range="-1 1"
limited="false"/></default></default>
<worldbody><body name="plate" pos="0 0 .5" axisangle="0 0 1 30"><freejoint name="root"/>
<geom type="cylinder" size=".3 .02"/><site name="corner" pos=".3 0 0"/>
<body name="leg1" pos=".3 0 0" xyaxes="1 0 0 0 1 1"><joint name="s1" class="leg"/>
<joint name="t1" axis="1 0 0" damping="1"/><geom size=".05"/><site name="foot1"/></body>
<body name="leg2" pos="-.3 0 0"><joint class="leg"/><geom size=".05" mass="3"/>
<frame pos="0 0 .1" euler="0 90 0"><site name="foot2"/><body name="toe"><joint name="t2"
axis="0 1 0"/><geom size=".02"/></body></frame></body></body>
<replicate count="2" offset="1 0 0"><body name="peg" pos="0 2 0"><joint name="p"/>
<geom size=".1"/></body></replicate></worldbody>
<equality><weld site1="foot1" site2="foot2" active="false"/>
<joint joint1="t1" joint2="t2" polycoef="0 2 0 0 0"/></equality></mujoco>""",
]
NUMBERS = {
    1: ["0", "1", "-1", ".5", "1e-3", "100", "3"],
    2: ["-2 2", "0 1", "1 0"],
    3: ["0.1 0.2 0.3", "1 0 0", "0 0 0"],
    4: ["1 2 3 4", "1 0 0 0"],
    6: ["1 2 0 -1 1 3", "0 0 0 .1 .2 .3", "1 1 1 0 0 .1"],
    7: ["0 0 1 1 0 0 0", ".1 .2 .3 1 2 3 4"],
}
COUNTS = {
    "pos": 3,
    "axis": 3,
    "range": 2,
    "quat": 4,
    "euler": 3,
    "axisangle": 4,
    "xyaxes": 6,
    "zaxis": 3,
    "fromto": 6,
    "size": 3,
    "diaginertia": 3,
    "fullinertia": 6,
    "anchor": 3,
    "relpose": 7,
    "gravity": 3,
    "qpos": 7,
    "springdamper": 2,
    "inertiagrouprange": 2,
}
WORDS = {
    "type": ["hinge", "slide", "ball", "free", "sphere", "box", "capsule", "cylinder", "ellipsoid"],
    "limited": ["true", "false", "auto"],
    "active": ["true", "false"],
    "angle": ["degree", "radian"],
    "inertiafromgeom": ["true", "false", "auto"],
    "autolimits": ["true", "false"],
    "eulerseq": ["xyz", "XYZ", "zyx", "zXy"],
    "gravity": ["0 0 -9.81", "0 0 0", "1 2 3"],
    "class": ["soft", "leg", "main"],
    "childclass": ["soft", "leg", "main"],
    **{
        key: ["true", "false"]
        for key in ("mocap", "shellinertia", "fusestatic", "balanceinertia", "alignfree")
    },
}
NEW = {
    "joint": "type pos axis range limited ref stiffness springref class springdamper",
    "body": "pos quat euler axisangle xyaxes zaxis childclass gravcomp mocap",
    "geom": "type pos quat size mass density fromto class euler group shellinertia",
    "site": "pos quat euler class fromto",
    "inertial": "pos quat mass diaginertia fullinertia",
    "compiler": "angle eulerseq autolimits inertiafromgeom settotalmass boundmass balanceinertia "
    "inertiagrouprange fusestatic alignfree",
    "option": "gravity",
    "flag": "gravity spring constraint equality limit",
    "connect": "anchor active",
    "weld": "relpose anchor active torquescale",
    "key": "qpos name",
}


def value(tag: str, key: str, rng: random.Random) -> str:
    """A value that an attribute may have, mostly."""
    if tag == "flag":
        return rng.choice(["enable", "disable"])
    if key in WORDS:
        return rng.choice(WORDS[key])
    count = COUNTS.get(key, 1) if rng.random() < 0.95 else rng.choice(sorted(NUMBERS))
    return rng.choice(NUMBERS[count])


def mutant(rng: random.Random) -> str:
    """A changed small file: attributes dropped, added, changed; elements dropped, added."""
    root = ET.fromstring(rng.choice(SEEDS))
    for _ in range(rng.choice([1, 1, 2, 3])):
        elements = [e for e in root.iter() if e is not root]
        element = rng.choice(elements)
        parents = {child: parent for parent in root.iter() for child in parent}
        action = rng.random()
        if action < 0.3 and element.attrib:
            element.attrib.pop(rng.choice(sorted(element.attrib)))
        elif action < 0.55 and element.attrib:
            key = rng.choice(sorted(element.attrib))
            text = element.attrib[key]
            if re.search(r"\d", text) and rng.random() < 0.6:
                parts = text.split()
                i = rng.randrange(len(parts))
                parts[i] = rng.choice(["0", "1", "-.3", "2.5", "1e-4", "40", parts[i]])
                element.set(key, " ".join(parts))
            else:
                element.set(key, value(element.tag, key, rng))
        elif action < 0.85 and element.tag in NEW:
            key = rng.choice(NEW[element.tag].split())
            element.set(key, value(element.tag, key, rng))
        elif action < 0.92:
            parents[element].remove(element)
        elif action < 0.96:
            copy = ET.fromstring(ET.tostring(element))
            for part in copy.iter():
                if "name" in part.attrib and part.tag not in ("default",):
                    part.set("name", part.get("name", "") + "x")
            parents[element].append(copy)
        else:
            child = ET.SubElement(
                element, rng.choice(["joint", "geom", "site", "body", "freejoint", "flag"])
            )
            if child.tag == "geom":
                child.set("size", ".1")
            elif child.tag == "body":
                ET.SubElement(child, "geom", size=".1")
    return ET.tostring(root, encoding="unicode")


def mutants(count: int, seed: int) -> Iterator[tuple[str, str, str, str]]:
    """Name, verdict, words and text of changed files."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "mutant.xml"
        for i in range(count):
            text = mutant(random.Random(f"{seed}-{i}"))
            path.write_text(text, encoding="utf-8")
            yield f"{seed}-{i}", *verdict(path, i), text


def files(folders: list[Path]) -> Iterator[Path]:
    """All MJCF files below some folders."""
    for folder in folders:
        for path in sorted(folder.rglob("*.xml")) if folder.is_dir() else [folder]:
            if b"<mujoco" in path.read_bytes():
                yield path


def compile_here(path: Path, where: str) -> dict[str, Any]:
    """What the process of its own would answer, by this one: for thousands of small files."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # MuJoCo's, on inertias
            data = json.loads(json.dumps(mjcf_worker.compiled(str(path), mjcf.LARGEST)))
    except ValueError as error:
        raise InputError("not a usable MJCF", where=where, got=str(error)) from None
    if "error" in data:
        raise InputError("too large", where=where)
    return data


def main() -> int:
    """Print a count of verdicts and each fault."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("what", choices=["files", "mutants"])
    parser.add_argument("folders", nargs="*", type=Path)
    parser.add_argument("-n", type=int, default=400)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--load", action="store_true", help="load each file as a mechanism as well")
    parser.add_argument("--reasons", action="store_true", help="print why files are refused")
    options = parser.parse_args()
    folders = [folder.resolve() for folder in options.folders]
    os.chdir(tempfile.gettempdir())  # MuJoCo leaves its log where it runs
    counts: Counter[str] = Counter()
    if options.what == "mutants":
        mjcf.compile_mjcf = compile_here
        for name, kind, words, text in mutants(options.n, options.seed):
            counts[kind] += 1
            if options.reasons:
                print(f"{name} {kind}: {words}")
            if kind in ("wrong", "broken"):
                print(f"{name} {kind}: {words}\n{text}\n", flush=True)
    else:
        for path in files(folders):
            kind, words = verdict(path)
            if options.load and kind == "same":
                try:
                    cartstiff.load(path)
                except CartstiffError as error:
                    kind, words = "read, refused as a mechanism", str(error)
            counts[kind] += 1
            print(f"{kind:16s} {path} {words}", flush=True)
    print(dict(counts))
    return 1 if counts["wrong"] or counts["broken"] else 0


if __name__ == "__main__":
    sys.exit(main())
