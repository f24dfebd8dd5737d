"""MJCF files, as MuJoCo's own compiler reads them.

What MuJoCo says is what a file means: includes, defaults, frames, masses of shapes, references. A
process of its own compiles the file (`worker`) and hands the model over as data; a Pinocchio
model with one-coordinate joints is made of it, and beside it stand springs, closures, gravity, the
posture, and what the engine cannot express.
"""

from __future__ import annotations

import importlib.util
import re
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from cartstiff import numerics
from cartstiff.arrays import Array
from cartstiff.child_process import answer_of
from cartstiff.errors import InputError, MissingDependencyError, one_line
from cartstiff.geometry import se3
from cartstiff.loading.mjcf import worker
from cartstiff.loading.robot_facts import (
    FileClosure,
    FileSpring,
    Followers,
    Lifted,
    Obstacle,
    RobotFacts,
    on_leaders,
)
from cartstiff.loading.schema import LineModel
from cartstiff.loading.yaml_file import LARGEST_NUMBER
from cartstiff.mechanisms.identity import fingerprint, was_read
from cartstiff.mechanisms.shapes import Box, Capsule, Cylinder, MeshFile, Piece, Shape, Sphere

#: Pinocchio's workspace takes a second to set up for 200 joints in a row, an hour for 2000.
LARGEST = {"nv": 200, "nbody": 5000, "nsite": 5000, "ngeom": 20000, "neq": 100, "nkey": 1000}
_WORDS = {
    "nv": "coordinates",
    "nbody": "bodies",
    "nsite": "sites",
    "ngeom": "geoms",
    "neq": "equality constraints",
    "nkey": "keyframes",
}
_SUFFIXES = {"mjJNT_BALL": ("x", "y", "z"), "mjJNT_FREE": ("x", "y", "z", "rx", "ry", "rz")}
# MuJoCo makes directions of unit length, to rounding, where they have any.
_UNIT = numerics.CLOSE
#: What must be numbers of moderate size, and whose they are.
_NUMBERS = {
    "body": "body_pos body_quat body_mass body_ipos body_iquat body_inertia body_gravcomp",
    "joint": "jnt_pos jnt_axis jnt_stiffness jnt_stiffnesspoly",
    "site": "site_pos site_quat",
    "equality": "eq_data",
    "": "qpos0 qpos_spring opt.gravity dof_armature dof_damping key_qpos",
}


def compile_mjcf(path: Path, where: str) -> dict[str, Any]:
    """The compiled model as data, by a process of its own."""
    if importlib.util.find_spec("mujoco") is None:
        raise MissingDependencyError("mujoco", "reading MJCF", "mjcf")
    data = answer_of(
        worker.__file__,
        [str(path.resolve()), LARGEST],
        where,
        "MuJoCo",
        # Nothing is drawn; importing a window library takes long.
        {"MUJOCO_GL": "disable", "OPENBLAS_NUM_THREADS": "1"},
    )
    if data.get("missing"):
        raise MissingDependencyError("mujoco", "reading MJCF", "mjcf")
    if data.get("error") == "too large":
        raise InputError(
            f"too many {_WORDS[data['count']]}",
            where=where,
            expected=f"at most {data['most']}",
            got=str(data["got"]),
        )
    if "error" in data:
        message = str(data["error"]).replace(str(path.resolve()), path.name)
        expected = None
        if lost := re.search(r"Error opening file '([^']*)'", message):
            expected = f"{lost[1]} beside it, as in the repository of the model: fetch its folder"
        raise InputError(
            "not a usable MJCF", where=where, expected=expected, got=one_line(message, 400)
        )
    # Included files, and meshes where a mass depends on them, are in what was compiled.
    numbers = {key: value for key, value in data.items() if key != "meshes"}
    was_read(f"{path.name} with all that it includes", fingerprint(numbers).encode())
    return data


class Compiled:
    """A compiled model as data, with names for everything, checked.

    Attributes
    ----------
    data : dict
        MuJoCo's arrays by their own names, as lists.
    bodies, joints, sites : list of str
        Names; made ones where the file has none. Those of sites are not those of bodies.
    types : list of str
        MuJoCo's joint types.
    coordinates : list of list of str
        Names of the coordinates of each joint.
    of_body : list of list of int
        Joints of each body, in order.
    obstacles : list of Obstacle
        What is wrong with single joints.
    """

    def __init__(self, data: dict[str, Any], where: str) -> None:
        self.data, self.where = data, where
        self.obstacles: list[Obstacle] = []
        self.bodies = named(data["body_names"], "body")
        self.joints = named(data["joint_names"], "joint")
        taken = {*self.bodies, "world"}
        self.sites: list[str] = []
        for name in named(data["site_names"], "site"):
            self.sites.append(name if name not in taken else free_name(f"{name} (site)", taken))
            taken.add(self.sites[-1])
        self.types = [data["enums"]["mjtJoint"][str(t)] for t in data["jnt_type"]]
        self.coordinates: list[list[str]] = []
        taken = set()
        for name, kind in zip(self.joints, self.types, strict=True):
            suffixes = [f".{s}" for s in _SUFFIXES[kind]] if kind in _SUFFIXES else [""]
            own = [free_name(name + s, taken) for s in suffixes]
            taken.update(own)
            self.coordinates.append(own)
        self.of_body: list[list[int]] = [[] for _ in self.bodies]
        for j, body in enumerate(data["jnt_bodyid"]):
            self.of_body[body].append(j)
        self._off = {
            bit
            for value, bit in data["enums"]["mjtDisableBit"].items()
            if int(data["opt.disableflags"]) & int(value)
        }
        if not self.joints:
            raise InputError("robot has no movable joints", where=where)
        self._check_numbers()

    def _check_numbers(self) -> None:
        """MuJoCo lets pass what is not finite, and sizes whose products are not."""
        owners = {"body": self.bodies, "joint": self.joints}
        for kind, fields in _NUMBERS.items():
            for name in fields.split():
                values = np.array(self.data[name] or [], float)
                rows = values.reshape(len(values), -1) if values.size else np.zeros((0, 1))
                for i in np.flatnonzero(~(np.abs(rows) <= LARGEST_NUMBER).all(axis=1))[:1]:
                    what = f"a position, an armature, a damping or gravity ({name})"
                    if kind:
                        whose = (owners.get(kind) or self.data[f"{kind}_names"])[i] or str(i + 1)
                        what = f"{kind} {whose!r}: {name.partition('_')[2]}"
                    raise InputError(
                        f"{what} cannot be used",
                        where=self.where,
                        expected=f"finite numbers up to {LARGEST_NUMBER:g}",
                        got=" ".join(f"{v:g}" for v in rows[i]),
                    )
        for name in ("body_quat", "body_iquat", "site_quat", "jnt_axis"):
            rows = np.reshape(self.data[name], (-1, 3 + name.endswith("quat")))
            sizes = np.linalg.norm(rows, axis=1)
            if not (np.abs(sizes - 1.0) < _UNIT).all():
                what = "an orientation" if name.endswith("quat") else "a joint axis"
                raise InputError(f"{what} has no direction", where=self.where)
        for j, (name, start) in enumerate(zip(self.joints, self.data["jnt_dofadr"], strict=True)):
            lower, upper = self.data["jnt_range"][j]
            if not lower <= upper:  # to MuJoCo that means no limits
                words, got = "range is the wrong way round", f"{lower:g} {upper:g}"
                self._leave_out(j, f"joint {name!r}: {words}", "lower upper", got)
            dofs = slice(start, start + len(self.coordinates[j]))
            for what in ("armature", "damping", "stiffness"):
                own = self.data["jnt_stiffness" if what == "stiffness" else f"dof_{what}"]
                if (least := min([own[j]] if what == "stiffness" else own[dofs])) < 0.0:
                    words = f"joint {name!r}: {what} is negative"
                    self._leave_out(j, words, "zero or more", f"{least:g}")

    def _leave_out(self, j: int, what: str, expected: str, got: str) -> None:
        error = InputError(what, where=self.where, expected=expected, got=got)
        self.obstacles.append(Obstacle(what, frozenset(self.coordinates[j]), error=error))

    def is_off(self, *parts: str) -> bool:
        """Whether the file switches one of these parts of the physics off."""
        return any(f"mjDSBL_{part}" in self._off for part in parts)

    def above(self, body: int) -> list[int]:
        """Joints between the world and a body."""
        ancestors: list[int] = []
        while body > 0:
            ancestors += self.of_body[body]
            body = self.data["body_parentid"][body]
        return ancestors

    def names_of(self, joints: Iterable[int]) -> frozenset[str]:
        """All coordinates of some joints."""
        return frozenset(c for j in joints for c in self.coordinates[j])


def pose(position: ArrayLike, quaternion: ArrayLike) -> Array:
    """4x4 pose of a position and a quaternion (w, x, y, z)."""
    w, *v = np.asarray(quaternion, float) / np.linalg.norm(np.asarray(quaternion, float))
    V = se3.skew(v)
    return se3.pose(np.eye(3) + 2 * w * V + 2 * V @ V, position)


def named(names: list[str], stem: str) -> list[str]:
    """Names, with made ones for things that have none: the stem and a number."""
    taken = {name for name in names if name}
    listed = []
    for number, name in enumerate(names, start=0 if stem == "body" else 1):
        if not name:
            while f"{stem}{number}" in taken:
                number += 1
            name = f"{stem}{number}"
            taken.add(name)
        listed.append(name)
    return listed


def free_name(name: str, taken: set[str]) -> str:
    """The name, with a number behind it if something else has it."""
    number, free = 2, name
    while free in taken:
        free, number = f"{name}_{number}", number + 1
    return free


def mjcf_model(compiled: Compiled) -> pin.Model:
    """Pinocchio model with one joint per coordinate; bodies and sites are frames."""
    data = compiled.data
    model = pin.Model()
    model.name = data["name"]
    lower, upper = [], []
    at: list[tuple[int, Array]] = [(0, np.eye(4))]
    for b in range(1, len(compiled.bodies)):
        joint, T = at[data["body_parentid"][b]]
        T = T @ pose(data["body_pos"][b], data["body_quat"][b])
        for j in compiled.of_body[b]:
            for name, part, T_part, limits in _parts(compiled, j, T):
                joint = model.addJoint(joint, part, pin.SE3(T_part), name)
                lower.append(limits[0])
                upper.append(limits[1])
            scalar = compiled.types[j] in ("mjJNT_HINGE", "mjJNT_BALL")
            back = -np.array(data["jnt_pos"][j]) if scalar else np.zeros(3)
            T = se3.pose(translation=back)
        at.append((joint, T))
        inertia = pin.Inertia.Zero()
        if (mass := data["body_mass"][b]) > data["no_mass"]:
            T_b_c = pose(data["body_ipos"][b], data["body_iquat"][b])
            central = pin.Inertia(mass, np.zeros(3), np.diag(data["body_inertia"][b]))
            inertia = central.se3Action(pin.SE3(T_b_c))
        model.addFrame(
            pin.Frame(compiled.bodies[b], joint, pin.SE3(T), pin.FrameType.BODY, inertia)
        )
    damped = not compiled.is_off("DAMPER", "PASSIVE")
    for own, start in zip(compiled.coordinates, data["jnt_dofadr"], strict=True):
        for i, name in enumerate(own):
            at_v = model.idx_vs[model.getJointId(name)]
            # Of a ball or free body it would not stay diagonal in turns about successive axes.
            if len(own) == 1:
                model.armature[at_v] = data["dof_armature"][start]
            if damped:
                model.damping[at_v] = data["dof_damping"][start + i]
    model.lowerPositionLimit = np.array(lower)
    model.upperPositionLimit = np.array(upper)
    for i, unique in enumerate(compiled.sites):
        joint, T = at[data["site_bodyid"][i]]
        T = T @ pose(data["site_pos"][i], data["site_quat"][i])
        model.addFrame(pin.Frame(unique, joint, pin.SE3(T), pin.FrameType.OP_FRAME))
    return model


def _parts(
    compiled: Compiled, j: int, T: Array
) -> list[tuple[str, Any, Array, tuple[float, float]]]:
    """One-coordinate joints of joint j of a body at T: name, model, placement, limits."""
    data, kind, names = compiled.data, compiled.types[j], compiled.coordinates[j]
    free = (-np.inf, np.inf)
    turns = (pin.JointModelRX(), pin.JointModelRY(), pin.JointModelRZ())
    if kind == "mjJNT_FREE":
        shifts = (pin.JointModelPX(), pin.JointModelPY(), pin.JointModelPZ())
        # The body stands at its reference; shifts are along F, so that the first place is F.
        home = pose(np.zeros(3), data["qpos0"][data["jnt_qposadr"][j] :][3:7])
        places = [np.eye(4), np.eye(4), np.eye(4), home, np.eye(4), np.eye(4)]
        return [(n, m, P, free) for n, m, P in zip(names, (*shifts, *turns), places, strict=True)]
    T = T @ se3.pose(translation=data["jnt_pos"][j])
    if kind == "mjJNT_BALL":
        places = [T, np.eye(4), np.eye(4)]
        return [(n, m, P, free) for n, m, P in zip(names, turns, places, strict=True)]
    axis = np.array(data["jnt_axis"][j])
    step = np.zeros(6)
    slide = kind == "mjJNT_SLIDE"
    step[3 if slide else 0 :][:3] = -axis * data["qpos0"][data["jnt_qposadr"][j]]
    if slide:
        T = T @ se3.pose(translation=-np.array(data["jnt_pos"][j]))
    make = pin.JointModelPrismaticUnaligned if slide else pin.JointModelRevoluteUnaligned
    limits = free
    if data["jnt_limited"][j] and not compiled.is_off("LIMIT", "CONSTRAINT"):
        limits = tuple(data["jnt_range"][j])
    return [(names[0], make(axis), T @ se3.exp(step), limits)]


_Coupling = tuple[str, str, float, float]


def equalities(
    compiled: Compiled,
) -> tuple[tuple[FileClosure, ...], Followers, dict[str, float], list[Obstacle], list[str]]:
    """Closures, coupled joints, joints held at a position, what is none of these, what to ignore.

    Ties to a mocap body are handles by which a program moves things: they hold nothing.
    """
    data = compiled.data
    closures: list[FileClosure] = []
    couplings: list[_Coupling] = []
    locked: dict[str, float] = {}
    others: list[Obstacle] = []
    handles: list[str] = []
    if compiled.is_off("EQUALITY", "CONSTRAINT"):
        return (), {}, {}, [], []
    for e, number in enumerate(data["eq_type"]):
        if not data["eq_active0"][e]:
            continue
        kind = data["enums"]["mjtEq"][str(number)]
        a, b, values = data["eq_obj1id"][e], data["eq_obj2id"][e], data["eq_data"][e]
        named = data["equality_names"][e]
        what = f"equality {named or e + 1}"
        if kind in ("mjEQ_CONNECT", "mjEQ_WELD"):
            closure = _closure(compiled, e, kind, a, b, values)
            ends = (compiled.bodies.index(n) for n in (closure.body_a, closure.body_b))
            if any(data["body_mocapid"][body] >= 0 for body in ends):
                handles.append(f"tie of {closure.body_a!r} and {closure.body_b!r} (a mocap body)")
            else:
                closures.append(closure)
        elif kind == "mjEQ_JOINT":
            try:
                _couple(compiled, a, b, values, what, couplings, locked)
            except InputError as error:
                joints = compiled.names_of(j for j in (a, b) if j >= 0)
                others.append(Obstacle(error.what, joints, error=error))
        else:
            word = kind.removeprefix("mjEQ_").lower()
            joints = tendon_joints(compiled, a) if word == "tendon" else flex_joints(compiled, a)
            others.append(Obstacle(f"{what} of {word}s", joints))
    followers = _followers(compiled, couplings, locked, others)
    return tuple(closures), followers, locked, others, handles


def _closure(
    compiled: Compiled, e: int, kind: str, a: int, b: int, values: list[float]
) -> FileClosure:
    data = compiled.data
    if data["enums"]["mjtObj"][str(data["eq_objtype"][e])] == "mjOBJ_SITE":
        T_a, T_b = (pose(data["site_pos"][s], data["site_quat"][s]) for s in (a, b))
        a, b = data["site_bodyid"][a], data["site_bodyid"][b]
        point = kind == "mjEQ_CONNECT"
    elif kind == "mjEQ_CONNECT":
        T_a, T_b = se3.pose(translation=values[:3]), se3.pose(translation=values[3:6])
        point = True
    else:
        # The first three numbers are a point of body b, the next a pose in body a.
        T_a, T_b = pose(values[3:6], values[6:10]), se3.pose(translation=values[:3])
        point = False
    # Without its share of torque a weld ties the points only.
    point = point or (kind == "mjEQ_WELD" and values[10] == 0.0)
    between = set(compiled.above(a)) ^ set(compiled.above(b))
    bodies = compiled.bodies[a], compiled.bodies[b]
    type_: Literal["point", "weld"] = "point" if point else "weld"
    return FileClosure(type_, *bodies, T_a, T_b, compiled.names_of(between))


def _couple(
    compiled: Compiled,
    a: int,
    b: int,
    values: list[float],
    what: str,
    couplings: list[_Coupling],
    locked: dict[str, float],
) -> None:
    """Joint a follows joint b, or stands still: q_a - ref_a = c_0 + c_1 (q_b - ref_b)."""
    data = compiled.data
    follower = compiled.coordinates[a][0]
    start = data["qpos0"][data["jnt_qposadr"][a]] + values[0]
    if b < 0:
        _hold(compiled, follower, start, locked)
        return
    if any(values[2:5]):
        raise InputError(
            f"{what} couples joints {compiled.joints[a]!r} and {compiled.joints[b]!r} by a curve",
            where=compiled.where,
            expected="a straight line: polycoef with two numbers",
            got=" ".join(f"{v:g}" for v in values[:5]),
        )
    factor, leader = values[1], compiled.coordinates[b][0]
    if factor == 0.0:
        _hold(compiled, follower, start, locked)
    else:
        offset = start - factor * data["qpos0"][data["jnt_qposadr"][b]]
        couplings.append((follower, leader, factor, offset))


def _hold(compiled: Compiled, name: str, position: float, locked: dict[str, float]) -> None:
    if name in locked:
        raise InputError(f"joint {name!r} is held twice", where=compiled.where)
    locked[name] = position


def _followers(
    compiled: Compiled,
    couplings: list[_Coupling],
    locked: dict[str, float],
    others: list[Obstacle],
) -> Followers:
    """Each coupling as one joint that follows another; turned round where that is needed."""
    followers: Followers = {}

    def leave_out(what: str, *joints: str) -> None:
        error = InputError(what, where=compiled.where)
        others.append(Obstacle(what, frozenset(joints), error=error))

    def root(name: str) -> str:
        while name in followers:
            name = followers[name][0]
        return name

    for follower, leader, factor, offset in couplings:
        if root(follower) == root(leader):
            leave_out(f"joint {follower!r} is coupled to itself", follower, leader)
            continue
        if follower in followers:
            if leader in followers:
                words = f"joints {follower!r} and {leader!r} are coupled twice"
                leave_out(words, follower, leader)
                continue
            follower, leader, factor, offset = leader, follower, 1 / factor, -offset / factor
        followers[follower] = (leader, factor, offset)
    # What an equality holds passes on to the joints that follow.
    moved = True
    while moved:
        moved = False
        for follower, (leader, factor, offset) in list(followers.items()):
            if follower in locked and leader in locked:
                leave_out(f"joint {follower!r} is held twice", follower, leader)
            elif leader in locked:
                locked[follower] = factor * locked[leader] + offset
            elif follower in locked:
                locked[leader] = (locked[follower] - offset) / factor
            else:
                continue
            del followers[follower]
            moved = True
    return followers


def tendon_joints(compiled: Compiled, tendon: int) -> frozenset[str]:
    """Joints that change a tendon's length."""
    data = compiled.data
    start = data["tendon_adr"][tendon]
    joints: set[int] = set()
    for i in range(start, start + data["tendon_num"][tendon]):
        kind = data["enums"]["mjtWrap"][str(data["wrap_type"][i])]
        target = data["wrap_objid"][i]
        if kind == "mjWRAP_JOINT":
            joints.add(target)
        elif kind == "mjWRAP_SITE":
            joints |= set(compiled.above(data["site_bodyid"][target]))
        elif kind in ("mjWRAP_SPHERE", "mjWRAP_CYLINDER"):
            joints |= set(compiled.above(data["geom_bodyid"][target]))
    return compiled.names_of(joints)


def flex_joints(compiled: Compiled, flex: int) -> frozenset[str]:
    """Joints that move the vertices of a flexible object."""
    start, count = compiled.data["flex_vertadr"][flex], compiled.data["flex_vertnum"][flex]
    bodies = set(compiled.data["flex_vertbodyid"][start : start + count])
    return compiled.names_of(j for b in bodies if b >= 0 for j in compiled.above(b))


def read_mjcf(
    path: Path, where: str | None = None
) -> tuple[pin.Model, RobotFacts, tuple[Piece, ...]]:
    """Pinocchio model of an MJCF file, the facts beside it, and what its bodies look like.

    A hinge or slide has MuJoCo's own position as its coordinate. A free body has the position of
    its origin in F and three successive turns x, y, z from its orientation in the file; a ball
    joint the turns alone.

    Raises
    ------
    InputError
        For what MuJoCo refuses, or what is too large.
    MissingDependencyError
        Without the package mujoco.
    """
    where = where or one_line(str(path))
    compiled = Compiled(compile_mjcf(path, where), where)
    return mjcf_model(compiled), _facts(compiled), tuple(_pieces(compiled))


def _facts(compiled: Compiled) -> RobotFacts:
    """Everything beside the model."""
    data = compiled.data
    closures, followers, locked, tied, handles = equalities(compiled)
    springs, stiff = _springs(compiled, followers)
    lines, bent = _tendons(compiled)
    gravity = np.array(data["opt.gravity"], float)
    weighs = bool(gravity.any()) and not compiled.is_off("GRAVITY")
    posture, keyframe = _posture(compiled)
    actuated, actuators = _actuators(compiled)
    held = {*springs, *actuated}
    looped = {c for tie in closures for c in tie.joints}
    floating = {c for own in compiled.coordinates if len(own) == 6 for c in own}
    ignored = [*actuators, *handles, *_ignored(compiled)]
    return RobotFacts(
        springs=springs,
        passive=tuple(
            c for own in compiled.coordinates for c in own if c in (floating | looped) - held
        ),
        loose=frozenset(floating - looped),
        actuated=tuple(actuated),
        lines=tuple(lines),
        actuators={name: k for name, k in actuated.items() if k > 0.0},
        followers=followers,
        locked=locked,
        closures=closures,
        posture=posture,
        keyframe=keyframe,
        gravity=gravity if weighs else None,
        lifted=_lifted(compiled),
        obstacles=(
            *compiled.obstacles,
            *stiff,
            *tied,
            *bent,
            *_elastic_bodies(compiled),
        ),
        ignored=tuple(ignored),
        weightless=_weightless(compiled),
    )


def _springs(
    compiled: Compiled, followers: dict[str, tuple[str, float, float]]
) -> tuple[dict[str, FileSpring], list[Obstacle]]:
    """Springs of hinges and slides, those of followers moved to their leaders; the others."""
    data = compiled.data
    springs: dict[str, FileSpring] = {}
    others: list[Obstacle] = []
    if compiled.is_off("SPRING", "PASSIVE"):
        return springs, others
    further = data["jnt_stiffnesspoly"] or [[]] * len(compiled.joints)
    for j, (name, own) in enumerate(zip(compiled.joints, compiled.coordinates, strict=True)):
        coefficients = [data["jnt_stiffness"][j], *further[j]]
        while coefficients and coefficients[-1] == 0.0:
            coefficients.pop()
        if not coefficients:
            continue
        if len(own) > 1:
            kind = "ball" if len(own) == 3 else "free"
            others.append(Obstacle(f"spring of the {kind} joint {name!r}", frozenset(own)))
            continue
        if len(coefficients) == 1 and coefficients[0] < 0:
            continue  # `compiled` has named it
        rest = data["qpos_spring"][data["jnt_qposadr"][j]]
        springs[own[0]] = FileSpring(tuple(coefficients), rest)
    springs, curved = on_leaders(springs, followers)
    return springs, [*others, *curved]


def _posture(compiled: Compiled) -> tuple[dict[str, float], str | None]:
    """Positions of the keyframe "home", else of the first one, else the file's own."""
    data = compiled.data
    keys = data["key_names"]
    chosen, q = None, data["qpos0"]
    if keys:
        index = keys.index("home") if "home" in keys else 0
        chosen, q = keys[index] or f"{index + 1}", data["key_qpos"][index]
    posture: dict[str, float] = {}
    for own, kind, start in zip(
        compiled.coordinates, compiled.types, data["jnt_qposadr"], strict=True
    ):
        if kind == "mjJNT_BALL":
            values = _turns(pose(np.zeros(3), q[start : start + 4])[:3, :3])
        elif kind == "mjJNT_FREE":
            home = pose(np.zeros(3), data["qpos0"][start + 3 : start + 7])[:3, :3]
            R = pose(np.zeros(3), q[start + 3 : start + 7])[:3, :3]
            values = np.concatenate([q[start : start + 3], _turns(home.T @ R)])
        else:
            values = np.array([q[start]])
        posture |= zip(own, values.tolist(), strict=True)
    return posture, chosen


def _lifted(compiled: Compiled) -> tuple[Lifted, ...]:
    data = compiled.data
    return tuple(
        Lifted(compiled.bodies[b], share * data["body_mass"][b], np.array(data["body_ipos"][b]))
        for b, share in enumerate(data["body_gravcomp"])
        if share and data["body_mass"][b] > data["no_mass"]
    )


def _actuators(compiled: Compiled) -> tuple[dict[str, float], list[str]]:
    """Coordinates that actuators drive, with the springs of position control; all in words.

    A force ``-kp gear q`` on the gear's far side is the spring ``kp gear^2`` at the joint.
    """
    data = compiled.data
    names = [n or f"{i + 1}" for i, n in enumerate(data["actuator_names"])]
    driven: dict[str, float] = {}
    for kind, (target, _), gear, bias, law in zip(
        data["actuator_trntype"],
        data["actuator_trnid"],
        data["actuator_gear"],
        data["actuator_biastype"],
        data["actuator_biasprm"],
        strict=True,
    ):
        if kind in (0, 1) and len(compiled.coordinates[target]) == 1:  # joint, joint in parent
            affine = data["enums"]["mjtBias"][str(bias)] == "mjBIAS_AFFINE"
            name, k = compiled.coordinates[target][0], -law[1] * gear[0] ** 2 if affine else 0.0
            driven[name] = driven.get(name, 0.0) + max(k, 0.0)
    return driven, [f"actuators ({_listed(names)})"] if names else []


def _tendons(
    compiled: Compiled,
) -> tuple[list[tuple[LineModel, frozenset[str]]], list[Obstacle]]:
    """Tendons with stiffness: straight ones between two sites are lines, others obstacles.

    Within a range of spring lengths a tendon is slack; one that begins at 0 pulls and never pushes.
    """
    data = compiled.data
    further = data["tendon_stiffnesspoly"] or [[]] * len(data["tendon_names"])
    lines: list[tuple[LineModel, frozenset[str]]] = []
    others: list[Obstacle] = []
    for t, name in enumerate(data["tendon_names"]):
        k, joints = data["tendon_stiffness"][t], tendon_joints(compiled, t)
        if not (k or any(further[t])) or compiled.is_off("SPRING", "PASSIVE"):
            continue
        part = slice(data["tendon_adr"][t], data["tendon_adr"][t] + data["tendon_num"][t])
        kinds = [data["enums"]["mjtWrap"][str(kind)] for kind in data["wrap_type"][part]]
        shortest, rest = data["tendon_lengthspring"][t]
        plain = k > 0.0 and not any(further[t]) and (shortest in (0.0, rest))
        if plain and kinds == ["mjWRAP_SITE"] * 2:
            line = LineModel.model_construct(
                frames=[compiled.sites[s] for s in data["wrap_objid"][part]],
                points=[[0.0] * 3] * 2,
                stiffness=k,
                rest_length=rest,
                unilateral=shortest < rest,
            )
            lines.append((line, joints))
        else:
            others.append(Obstacle(f"stiffness of tendon {name or t + 1!r}", joints))
    return lines, others


def _elastic_bodies(compiled: Compiled) -> list[Obstacle]:
    """Bodies whose plugin exerts forces, and flexible objects."""
    bodies = [
        Obstacle(f"plugin of body {name!r}", compiled.names_of(compiled.above(b)))
        for b, (name, plugin) in enumerate(
            zip(compiled.bodies, compiled.data["body_plugin"], strict=True)
        )
        if plugin >= 0
    ]
    for i, name in enumerate(compiled.data["flex_names"]):
        bodies.append(Obstacle(f"flex {name!r}", flex_joints(compiled, i)))
    return bodies


def _ignored(compiled: Compiled) -> list[str]:
    data = compiled.data
    ignored = []
    loose = [
        name or f"{t + 1}"
        for t, name in enumerate(data["tendon_names"])
        if not data["tendon_stiffness"][t]
    ]
    if loose:
        ignored.append(f"tendons without stiffness ({_listed(loose)})")
    if data["pair_names"]:
        ignored.append(f"contact pairs ({len(data['pair_names'])})")
    parts = zip(compiled.joints, compiled.coordinates, data["jnt_limited"], strict=True)
    balls = [name for name, own, limited in parts if limited and len(own) > 1]
    if balls:
        ignored.append(f"ranges of ball joints ({_listed(balls)})")
    for what, words in (
        ("armature", "armature"),
        ("damping", "how turns away from the file's orientation couple the dampers"),
    ):
        named = [
            name
            for name, own, start in zip(
                compiled.joints, compiled.coordinates, data["jnt_dofadr"], strict=True
            )
            if len(own) > 1 and data[f"dof_{what}"][start]
        ]
        if named:
            ignored.append(f"{words} of ball and free joints ({_listed(named)})")
    if any(data["opt.wind"]) and (data["opt.density"] or data["opt.viscosity"]):
        ignored.append("wind")
    if compiled.is_off("SPRING", "PASSIVE") and any(data["jnt_stiffness"]):
        ignored.append("springs, which the file switches off")
    return ignored


def _weightless(compiled: Compiled) -> tuple[str, ...]:
    data = compiled.data
    weightless = [
        f"mass of body {', '.join(repr(b) for b in bodies)} (mesh {file} is missing)"
        for file, bodies in data["lost_meshes"].items()
    ]
    if data["no_mass"]:
        bare = [
            name
            for b, name in enumerate(compiled.bodies)
            if data["body_mass"][b] <= data["no_mass"] and compiled.of_body[b]
        ]
        if bare:
            weightless.append(f"mass of moving bodies that the file gives none ({_listed(bare)})")
    return tuple(weightless)


def _pieces(compiled: Compiled) -> Iterator[Piece]:
    """What bodies look like: geoms of the groups that MuJoCo shows, or all if there are none."""
    data = compiled.data
    groups = data["geom_group"]
    for g in [g for g, group in enumerate(groups) if group < 3] or range(len(groups)):
        kind = data["enums"]["mjtGeom"][str(data["geom_type"][g])].removeprefix("mjGEOM_")
        T = pose(data["geom_pos"][g], data["geom_quat"][g])
        shape: Shape
        if kind in ("MESH", "SDF"):
            index = data["geom_dataid"][g]
            mesh = data["meshes"].get(data["mesh_names"][index]) if index >= 0 else None
            if mesh is None:
                continue  # made in the file itself: there is nothing to read
            x, y, z = mesh["scale"]
            shape = MeshFile(Path(mesh["file"]), (x, y, z))
            # The mesh stands where its own centre and axes are; the file's origin is elsewhere.
            T = T @ se3.inverse(pose(data["mesh_pos"][index], data["mesh_quat"][index]))
            moved = -np.array(mesh["scale"]) * np.array(mesh["refpos"])
            T = T @ pose(np.zeros(3), mesh["refquat"]).T @ se3.pose(translation=moved)
        elif kind in _SHAPES:
            shape = _SHAPES[kind](*data["geom_size"][g])
        else:
            continue
        material = data["geom_matid"][g]
        r, gr, b, a = data["geom_rgba"][g] if material < 0 else data["mat_rgba"][material]
        yield Piece(compiled.bodies[data["geom_bodyid"][g]], T, shape, (r, gr, b, a))


_SHAPES: dict[str, Callable[[float, float, float], Shape]] = {
    "BOX": lambda a, b, c: Box((2 * a, 2 * b, 2 * c)),
    "CYLINDER": lambda a, b, _: Cylinder(a, 2 * b),
    "CAPSULE": lambda a, b, _: Capsule(a, 2 * b),
    "SPHERE": lambda a, *_: Sphere((a, a, a)),
    "ELLIPSOID": lambda a, b, c: Sphere((a, b, c)),
}


def _turns(R: Array) -> Array:
    """Angles of the turns about x, the new y, the new z that make R."""
    y = np.arcsin(np.clip(R[0, 2], -1.0, 1.0))
    if abs(R[0, 2]) >= 1.0:
        return np.array([np.arctan2(R[1, 0], R[1, 1]), y, 0.0])
    return np.array([np.arctan2(-R[1, 2], R[2, 2]), y, np.arctan2(-R[0, 1], R[0, 0])])


def _listed(names: list[str], most: int = 12) -> str:
    return ", ".join(names[:most]) + (
        f", and {len(names) - most} more" if len(names) > most else ""
    )
