"""Read MJCF files as MuJoCo's own compiler understands them.

MuJoCo resolves includes, defaults, frames, masses of shapes and references. A process of
its own compiles the file (`worker`) and returns the model as data; a Pinocchio model with
one-coordinate joints is made from them, with springs, closures, gravity, the posture, and
the parts that this program cannot express.
"""

from __future__ import annotations

import importlib.util
import re
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from itertools import compress
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from cartstiff import numerics
from cartstiff.arrays import Array
from cartstiff.child_process import answer_of
from cartstiff.choices import LARGEST_INPUT
from cartstiff.errors import InputError, MissingDependencyError, listed, one_line
from cartstiff.geometry import se3
from cartstiff.loading.description import (
    POSITION_ACTUATORS,
    FileClosure,
    FileSpring,
    Followers,
    Lifted,
    Obstacle,
    RobotDescription,
    on_leaders,
    successive_turns,
    to_root,
)
from cartstiff.loading.mjcf import worker
from cartstiff.loading.schema import CoupledSpringModel, LineModel
from cartstiff.mechanisms.identity import fingerprint, was_read
from cartstiff.mechanisms.shapes import (
    Box,
    Capsule,
    Cylinder,
    MeshFile,
    Piece,
    Shape,
    Sphere,
)
from cartstiff.mechanisms.tree import add_joint, primitive
from cartstiff.mechanisms.tree_building import free_name

#: Pinocchio's workspace takes a second to set up for 200 joints in a row, an hour for
#: 2000.
LARGEST = {
    "nv": 200,
    "nbody": 5000,
    "nsite": 5000,
    "ngeom": 20000,
    "neq": 100,
    "nkey": 1000,
}
_COUNTED = {
    "nv": "coordinates",
    "nbody": "bodies",
    "nsite": "sites",
    "ngeom": "geoms",
    "neq": "equality constraints",
    "nkey": "keyframes",
}
_SUFFIXES = {
    "mjJNT_BALL": ("x", "y", "z"),
    "mjJNT_FREE": ("x", "y", "z", "rx", "ry", "rz"),
}
#: Numbers that must be of moderate size, by their owner.
_NUMBERS = {
    "body": "body_pos body_quat body_mass body_ipos body_iquat body_inertia "
    "body_gravcomp",
    "joint": "jnt_pos jnt_axis jnt_stiffness jnt_stiffnesspoly",
    "site": "site_pos site_quat",
    "equality": "eq_data",
    "": "qpos0 qpos_spring opt.gravity dof_armature dof_damping key_qpos",
}

# A note lists twelve names of a group and counts the rest.
_listed = partial(listed, most=12)


def compile_mjcf(path: Path, where: str) -> dict[str, Any]:
    """Compile a model in a process of its own; return it as data."""
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
            f"too many {_COUNTED[data['count']]}",
            where=where,
            expected=f"at most {data['most']}",
            got=str(data["got"]),
        )
    if "error" in data:
        message = str(data["error"]).replace(str(path.resolve()), path.name)
        expected = None
        if lost := re.search(r"Error opening file '([^']*)'", message):
            expected = (
                f"{lost[1]} beside it, as in the repository of the model: fetch "
                "its folder"
            )
        raise InputError(
            "not a usable MJCF",
            where=where,
            expected=expected,
            got=one_line(message, 400),
        )
    # The data include the contents of included files, and of meshes on which masses
    # depend.
    numbers = {key: value for key, value in data.items() if key != "meshes"}
    was_read(f"{path.name} with all that it includes", fingerprint(numbers).encode())
    return data


def read_mjcf(path: Path, where: str | None = None) -> RobotDescription:
    """Read an MJCF file.

    The coordinate of a hinge or slide is MuJoCo's own position. The coordinates of a free
    body are the position of its origin in F and three successive turns x, y, z from its
    orientation in the file; those of a ball joint are the turns alone.

    Raises
    ------
    InputError
        For what MuJoCo refuses, or what is too large.
    MissingDependencyError
        Without the package mujoco.
    """
    where = where or one_line(str(path))
    return _Compiled(compile_mjcf(path, where), where).description(path)


class _Compiled:
    """A compiled model as data, checked, with names for everything.

    Attributes
    ----------
    data : dict
        MuJoCo's arrays by their own names, as lists; types as MuJoCo's names of them.
    bodies, joints, sites : list of str
        Names; generated ones where the file has none. Those of sites are not those of
        bodies.
    coordinates : list of list of str
        Names of the coordinates of each joint.
    joints_of : list of list of int
        Joints of each body, in order.
    obstacles : list of Obstacle
        Faulty joints, and parts that cannot be expressed.
    ignored : list of str
        Descriptions of parts without effect.
    locked : dict of str to float
        Positions of coordinates that an equality holds.
    """

    def __init__(self, data: dict[str, Any], where: str) -> None:
        self.data, self.where = data, where
        self.obstacles: list[Obstacle] = []
        self.ignored: list[str] = []
        self.locked: dict[str, float] = {}
        self.bodies = _named(data["body_names"], "body")
        self.joints = _named(data["joint_names"], "joint")
        taken = {*self.bodies, "world"}
        self.sites: list[str] = []
        for name in _named(data["site_names"], "site"):
            self.sites.append(
                name if name not in taken else free_name(f"{name} (site)", taken)
            )
            taken.add(self.sites[-1])
        self.coordinates: list[list[str]] = []
        taken = set()
        for name, kind in zip(self.joints, data["jnt_type"], strict=True):
            suffixes = [f".{s}" for s in _SUFFIXES[kind]] if kind in _SUFFIXES else [""]
            own = [free_name(name + s, taken) for s in suffixes]
            taken.update(own)
            self.coordinates.append(own)
        self.joints_of: list[list[int]] = [[] for _ in self.bodies]
        for j, body in enumerate(data["jnt_bodyid"]):
            self.joints_of[body].append(j)
        if not self.joints:
            raise InputError("robot has no movable joints", where=where)
        self._check_numbers()

    def _check_numbers(self) -> None:
        """Refuse numbers that are not finite or too large, which MuJoCo accepts."""
        owners = {"body": self.bodies, "joint": self.joints}
        for kind, fields in _NUMBERS.items():
            for name in fields.split():
                values = np.array(self.data[name] or [], float)
                rows = (
                    values.reshape(len(values), -1) if values.size else np.zeros((0, 1))
                )
                for i in np.flatnonzero(~(np.abs(rows) <= LARGEST_INPUT).all(axis=1))[:1]:
                    what = f"a position, an armature, a damping or gravity ({name})"
                    if kind:
                        owner = (owners.get(kind) or self.data[f"{kind}_names"])[
                            i
                        ] or str(i + 1)
                        what = f"{kind} {owner!r}: {name.partition('_')[2]}"
                    raise InputError(
                        f"{what} cannot be used",
                        where=self.where,
                        expected=f"finite numbers up to {LARGEST_INPUT:g}",
                        got=" ".join(f"{v:g}" for v in rows[i]),
                    )
        # MuJoCo normalises directions, to rounding, where they are not zero.
        for name in ("body_quat", "body_iquat", "site_quat", "jnt_axis"):
            rows = np.reshape(self.data[name], (-1, 3 + name.endswith("quat")))
            sizes = np.linalg.norm(rows, axis=1)
            if not (np.abs(sizes - 1.0) < numerics.NEGLIGIBLE_DIFFERENCE).all():
                what = "an orientation" if name.endswith("quat") else "a joint axis"
                raise InputError(f"{what} has no direction", where=self.where)
        for j, (name, start) in enumerate(
            zip(self.joints, self.data["jnt_dofadr"], strict=True)
        ):
            lower, upper = self.data["jnt_range"][j]
            if not lower <= upper:  # to MuJoCo that means no limits
                words, got = "range is the wrong way round", f"{lower:g} {upper:g}"
                self._refuse_joint(j, f"joint {name!r}: {words}", "lower upper", got)
            dofs = slice(start, start + len(self.coordinates[j]))
            for what in ("armature", "damping", "stiffness"):
                own = self.data["jnt_stiffness" if what == "stiffness" else f"dof_{what}"]
                if (least := min([own[j]] if what == "stiffness" else own[dofs])) < 0.0:
                    words = f"joint {name!r}: {what} is negative"
                    self._refuse_joint(j, words, "zero or more", f"{least:g}")

    def _refuse_joint(self, j: int, what: str, expected: str, got: str) -> None:
        error = InputError(what, where=self.where, expected=expected, got=got)
        self._leave_out(what, self.coordinates[j], error)

    def _leave_out(
        self, what: str, names: Iterable[str], error: InputError | None = None
    ) -> None:
        """Record a part that cannot be used, and the coordinates that it acts on."""
        self.obstacles.append(Obstacle(what, frozenset(names), error=error))

    def is_off(self, *parts: str) -> bool:
        """Whether the file disables one of these parts of the physics."""
        return any(f"mjDSBL_{part}" in self.data["disabled"] for part in parts)

    def above(self, *bodies: int) -> set[int]:
        """Joints between the world and some bodies."""
        joints: set[int] = set()
        for body in bodies:
            while body > 0:
                joints.update(self.joints_of[body])
                body = self.data["body_parentid"][body]
        return joints

    def names_of(self, joints: Iterable[int]) -> frozenset[str]:
        """All coordinates of some joints."""
        return frozenset(c for j in joints for c in self.coordinates[j])

    def model(self) -> pin.Model:
        """Return the Pinocchio model with one joint per coordinate.

        Bodies and sites are frames.
        """
        data = self.data
        model = pin.Model()
        model.name = data["name"]
        at: list[tuple[int, Array]] = [(0, np.eye(4))]
        for b in range(1, len(self.bodies)):
            joint, T = at[data["body_parentid"][b]]
            T = T @ _pose(data["body_pos"][b], data["body_quat"][b])
            for j in self.joints_of[b]:
                for name, part, T_part, limits in self._parts(j, T):
                    joint = add_joint(model, joint, part, T_part, name, limits)
                turns = data["jnt_type"][j] in ("mjJNT_HINGE", "mjJNT_BALL")
                back = -np.array(data["jnt_pos"][j]) if turns else np.zeros(3)
                T = se3.pose(translation=back)
            at.append((joint, T))
            inertia = pin.Inertia.Zero()
            if self._has_mass(b):
                T_b_c = _pose(data["body_ipos"][b], data["body_iquat"][b])
                moments = np.diag(data["body_inertia"][b])
                central = pin.Inertia(data["body_mass"][b], np.zeros(3), moments)
                inertia = central.se3Action(pin.SE3(T_b_c))
            model.addFrame(
                pin.Frame(self.bodies[b], joint, pin.SE3(T), pin.FrameType.BODY, inertia)
            )
        damped = not self.is_off("DAMPER", "PASSIVE")
        for own, start in zip(self.coordinates, data["jnt_dofadr"], strict=True):
            for i, name in enumerate(own):
                at_v = model.idx_vs[model.getJointId(name)]
                # In successive turns of a ball or free joint it would not stay diagonal.
                if len(own) == 1:
                    model.armature[at_v] = data["dof_armature"][start]
                if damped:
                    model.damping[at_v] = data["dof_damping"][start + i]
        for i, name in enumerate(self.sites):
            joint, T = at[data["site_bodyid"][i]]
            T = T @ _pose(data["site_pos"][i], data["site_quat"][i])
            model.addFrame(pin.Frame(name, joint, pin.SE3(T), pin.FrameType.OP_FRAME))
        return model

    def _has_mass(self, body: int) -> bool:
        return bool(self.data["body_mass"][body] > self.data["no_mass"])

    def _parts(
        self, j: int, T: Array
    ) -> list[tuple[str, Any, Array, tuple[float, float]]]:
        """One-coordinate joints of joint j of a body at T: name, model, placement,
        limits.
        """
        data, kind, names = self.data, self.data["jnt_type"][j], self.coordinates[j]
        free, still = (-np.inf, np.inf), np.eye(4)
        kinds: tuple[str, ...] = ()
        if kind == "mjJNT_FREE":
            kinds = ("PX", "PY", "PZ", "RX", "RY", "RZ")
            # The turns begin at the reference; the shifts are along F.
            home = _pose(np.zeros(3), data["qpos0"][data["jnt_qposadr"][j] :][3:7])
            places = [still, still, still, home, still, still]
        T = T @ se3.pose(translation=data["jnt_pos"][j])
        if kind == "mjJNT_BALL":
            kinds = ("RX", "RY", "RZ")
            places = [T, still, still]
        if kinds:
            parts = zip(names, map(primitive, kinds), places, strict=True)
            return [(name, part, place, free) for name, part, place in parts]
        axis = np.array(data["jnt_axis"][j])
        step = np.zeros(6)
        slide = kind == "mjJNT_SLIDE"
        step[3 if slide else 0 :][:3] = -axis * data["qpos0"][data["jnt_qposadr"][j]]
        if slide:
            T = T @ se3.pose(translation=-np.array(data["jnt_pos"][j]))
        make = (
            pin.JointModelPrismaticUnaligned if slide else pin.JointModelRevoluteUnaligned
        )
        limits = free
        if data["jnt_limited"][j] and not self.is_off("LIMIT", "CONSTRAINT"):
            limits = tuple(data["jnt_range"][j])
        return [(names[0], make(axis), T @ se3.exp(step), limits)]

    def description(self, path: Path) -> RobotDescription:
        """Return the model and everything beside it."""
        data = self.data
        actuated = self._actuators()
        springs = self._springs()
        closures, followers = self._equalities()
        springs, nonlinear = on_leaders(springs, followers)
        self.obstacles += nonlinear
        lines, coupled = self._tendons(followers)
        self._elastic_bodies()
        gravity = np.array(data["opt.gravity"], float)
        has_gravity = bool(gravity.any()) and not self.is_off("GRAVITY")
        posture, keyframe = self._posture()
        held = {*springs, *actuated}
        looped = {c for tie in closures for c in tie.joints}
        floating = {c for own in self.coordinates if len(own) == 6 for c in own}
        self._ignore_parts()
        return RobotDescription(
            self.model(),
            path,
            tuple(self.pieces()),
            springs=springs,
            passive=tuple(
                c
                for own in self.coordinates
                for c in own
                if c in (floating | looped) - held
            ),
            loose=frozenset(floating - looped),
            actuated=tuple(actuated),
            lines=tuple(lines),
            coupled=tuple(coupled),
            actuators={name: k for name, k in actuated.items() if k > 0.0},
            followers=followers,
            locked=self.locked,
            closures=tuple(closures),
            posture=posture,
            keyframe=keyframe,
            gravity=gravity if has_gravity else None,
            lifted=tuple(
                Lifted(
                    self.bodies[b],
                    share * data["body_mass"][b],
                    np.array(data["body_ipos"][b]),
                )
                for b, share in enumerate(data["body_gravcomp"])
                if share and self._has_mass(b)
            ),
            obstacles=tuple(self.obstacles),
            ignored=tuple(self.ignored),
            weightless=self._weightless(),
        )

    def _equalities(self) -> tuple[list[FileClosure], Followers]:
        """Closures and coupled joints.

        Ties to a mocap body are handles by which a program moves things: they hold
        nothing.
        """
        data = self.data
        closures: list[FileClosure] = []
        couplings: list[tuple[str, str, float, float]] = []
        if self.is_off("EQUALITY", "CONSTRAINT"):
            return [], {}
        for e, kind in enumerate(data["eq_type"]):
            if not data["eq_active0"][e]:
                continue
            a, b, values = data["eq_obj1id"][e], data["eq_obj2id"][e], data["eq_data"][e]
            what = f"equality {data['equality_names'][e] or e + 1}"
            if kind in ("mjEQ_CONNECT", "mjEQ_WELD"):
                closure = self._closure(e, kind, a, b, values)
                ends = (self.bodies.index(n) for n in (closure.body_a, closure.body_b))
                if any(data["body_mocapid"][body] >= 0 for body in ends):
                    tie = (
                        f"tie of {closure.body_a!r} and {closure.body_b!r} (a mocap body)"
                    )
                    self.ignored.append(tie)
                else:
                    closures.append(closure)
            elif kind == "mjEQ_JOINT":
                try:
                    couplings += self._coupling(a, b, values, what)
                except InputError as error:
                    joints = self.names_of(j for j in (a, b) if j >= 0)
                    self._leave_out(error.what, joints, error)
            else:
                word = kind.removeprefix("mjEQ_").lower()
                joints = (
                    self._tendon_joints(a) if word == "tendon" else self._flex_joints(a)
                )
                self._leave_out(f"{what} of {word}s", joints)
        return closures, self._followers(couplings)

    def _closure(
        self, e: int, kind: str, a: int, b: int, values: list[float]
    ) -> FileClosure:
        data = self.data
        point = kind == "mjEQ_CONNECT"
        if data["eq_objtype"][e] == "mjOBJ_SITE":
            T_a, T_b = (_pose(data["site_pos"][s], data["site_quat"][s]) for s in (a, b))
            a, b = data["site_bodyid"][a], data["site_bodyid"][b]
        elif point:
            T_a, T_b = se3.pose(translation=values[:3]), se3.pose(translation=values[3:6])
        else:
            # The first three numbers are a point of body b, the next a pose in body a.
            T_a, T_b = _pose(values[3:6], values[6:10]), se3.pose(translation=values[:3])
        # A weld whose share of torque is zero ties the points only.
        point = point or values[10] == 0.0
        tied: Literal["point", "weld"] = "point" if point else "weld"
        joints = self.names_of(self.above(a) ^ self.above(b))
        return FileClosure(tied, self.bodies[a], self.bodies[b], T_a, T_b, joints)

    def _coupling(
        self, a: int, b: int, values: list[float], what: str
    ) -> list[tuple[str, str, float, float]]:
        """Couple joint a to joint b, or lock it: q_a - ref_a = c_0 + c_1
        (q_b - ref_b).
        """
        data = self.data
        follower = self.coordinates[a][0]
        start = data["qpos0"][data["jnt_qposadr"][a]] + values[0]
        if b >= 0 and any(values[2:5]):
            raise InputError(
                f"{what} couples joints {self.joints[a]!r} and {self.joints[b]!r} by a "
                "curve",
                where=self.where,
                expected="a straight line: polycoef with two numbers",
                got=" ".join(f"{v:g}" for v in values[:5]),
            )
        factor = 0.0 if b < 0 else values[1]
        if factor == 0.0:
            if follower in self.locked:
                raise InputError(f"joint {follower!r} is held twice", where=self.where)
            self.locked[follower] = start
            return []
        offset = start - factor * data["qpos0"][data["jnt_qposadr"][b]]
        return [(follower, self.coordinates[b][0], factor, offset)]

    def _followers(self, couplings: list[tuple[str, str, float, float]]) -> Followers:
        """Each coupling as one joint that follows another,
        reversed where that is needed.
        """
        followers: Followers = {}

        def refuse(what: str, *joints: str) -> None:
            self._leave_out(what, joints, InputError(what, where=self.where))

        def root(name: str) -> str:
            while name in followers:
                name = followers[name][0]
            return name

        for follower, leader, factor, offset in couplings:
            if root(follower) == root(leader):
                refuse(f"joint {follower!r} is coupled to itself", follower, leader)
                continue
            if follower in followers:
                if leader in followers:
                    words = f"joints {follower!r} and {leader!r} are coupled twice"
                    refuse(words, follower, leader)
                    continue
                follower, leader, factor, offset = (
                    leader,
                    follower,
                    1 / factor,
                    -offset / factor,
                )
            followers[follower] = (leader, factor, offset)
        return followers

    def _tendon_joints(self, tendon: int) -> frozenset[str]:
        """Joints that change a tendon's length."""
        data = self.data
        start = data["tendon_adr"][tendon]
        joints: set[int] = set()
        for i in range(start, start + data["tendon_num"][tendon]):
            kind, target = data["wrap_type"][i], data["wrap_objid"][i]
            if kind == "mjWRAP_JOINT":
                joints.add(target)
            elif kind == "mjWRAP_SITE":
                joints |= self.above(data["site_bodyid"][target])
            elif kind in ("mjWRAP_SPHERE", "mjWRAP_CYLINDER"):
                joints |= self.above(data["geom_bodyid"][target])
        return self.names_of(joints)

    def _flex_joints(self, flex: int) -> frozenset[str]:
        """Joints that move the vertices of a flexible object."""
        start, count = self.data["flex_vertadr"][flex], self.data["flex_vertnum"][flex]
        bodies = set(self.data["flex_vertbodyid"][start : start + count])
        return self.names_of(self.above(*bodies))

    def _springs(self) -> dict[str, FileSpring]:
        """Springs of hinges and slides; others become obstacles."""
        data = self.data
        springs: dict[str, FileSpring] = {}
        if self.is_off("SPRING", "PASSIVE"):
            return springs
        further = data["jnt_stiffnesspoly"] or [[]] * len(self.joints)
        for j, (name, own) in enumerate(zip(self.joints, self.coordinates, strict=True)):
            coefficients = [data["jnt_stiffness"][j], *further[j]]
            while coefficients and coefficients[-1] == 0.0:
                coefficients.pop()
            if not coefficients:
                continue
            if len(own) > 1:
                kind = "ball" if len(own) == 3 else "free"
                self._leave_out(f"spring of the {kind} joint {name!r}", own)
            elif (
                len(coefficients) > 1 or coefficients[0] > 0
            ):  # a negative one is a fault
                rest = data["qpos_spring"][data["jnt_qposadr"][j]]
                springs[own[0]] = FileSpring(tuple(coefficients), rest)
        return springs

    def _posture(self) -> tuple[dict[str, float], str | None]:
        """Positions of the keyframe "home", else of the first one,
        else the file's own.
        """
        data = self.data
        keys = data["key_names"]
        chosen, q = None, data["qpos0"]
        if keys:
            index = keys.index("home") if "home" in keys else 0
            chosen, q = keys[index] or f"{index + 1}", data["key_qpos"][index]
        posture: dict[str, float] = {}
        for own, kind, start in zip(
            self.coordinates, data["jnt_type"], data["jnt_qposadr"], strict=True
        ):
            if kind == "mjJNT_BALL":
                values = successive_turns(_pose(np.zeros(3), q[start : start + 4]))
            elif kind == "mjJNT_FREE":
                home, now = (
                    _pose(np.zeros(3), x[start + 3 : start + 7])
                    for x in (data["qpos0"], q)
                )
                turned = successive_turns(se3.inverse(home) @ now)
                values = np.concatenate([q[start : start + 3], turned])
            else:
                values = np.array([q[start]])
            posture |= zip(own, values.tolist(), strict=True)
        return posture, chosen

    def _actuators(self) -> dict[str, float]:
        """Coordinates that actuators drive, with the springs of position control.

        A force ``-kp gear q`` on the gear's far side is the spring ``kp gear^2`` at the
        joint.
        """
        data = self.data
        driven: dict[str, float] = {}
        held, others = list[str](), list[str]()
        for i, (kind, (target, _), gear, bias, law) in enumerate(
            zip(
                data["actuator_trntype"],
                data["actuator_trnid"],
                data["actuator_gear"],
                data["actuator_biastype"],
                data["actuator_biasprm"],
                strict=True,
            )
        ):
            k = 0.0
            if (
                kind in (0, 1) and len(self.coordinates[target]) == 1
            ):  # joint, joint in parent
                k = -law[1] * gear[0] ** 2 if bias == "mjBIAS_AFFINE" else 0.0
                name = self.coordinates[target][0]
                driven[name] = driven.get(name, 0.0) + max(k, 0.0)
            (held if k > 0.0 else others).append(data["actuator_names"][i] or f"{i + 1}")
        for words, names in ((POSITION_ACTUATORS, held), ("actuators", others)):
            if names:
                self.ignored.append(f"{words} ({_listed(names)})")
        return driven

    def _tendons(
        self, followers: Followers
    ) -> tuple[list[tuple[LineModel, frozenset[str]]], list[CoupledSpringModel]]:
        """Straight tendons with stiffness between two sites as lines,
        fixed ones on joints' sums.

        Others become obstacles. A tendon with a range of spring lengths is slack within
        it; one whose range begins at 0 pulls and never pushes.
        """
        data = self.data
        further = data["tendon_stiffnesspoly"] or [[]] * len(data["tendon_names"])
        lines: list[tuple[LineModel, frozenset[str]]] = []
        coupled: list[CoupledSpringModel] = []
        for t, name in enumerate(data["tendon_names"]):
            k, joints = data["tendon_stiffness"][t], self._tendon_joints(t)
            if not (k or any(further[t])) or self.is_off("SPRING", "PASSIVE"):
                continue
            part = slice(
                data["tendon_adr"][t], data["tendon_adr"][t] + data["tendon_num"][t]
            )
            shortest, rest = data["tendon_lengthspring"][t]
            plain = k > 0.0 and not any(further[t]) and (shortest in (0.0, rest))
            if plain and data["wrap_type"][part] == ["mjWRAP_SITE"] * 2:
                line = LineModel.model_construct(
                    frames=[self.sites[s] for s in data["wrap_objid"][part]],
                    points=[[0.0] * 3] * 2,
                    stiffness=k,
                    rest_length=rest,
                    unilateral=shortest < rest,
                )
                lines.append((line, joints))
            elif (
                plain
                and shortest == rest
                and set(data["wrap_type"][part]) == {"mjWRAP_JOINT"}
            ):
                factors = zip(
                    data["wrap_objid"][part], data["wrap_prm"][part], strict=True
                )
                coupled.append(
                    self._coupled(name or f"tendon {t + 1}", k, rest, factors, followers)
                )
            else:
                self._leave_out(f"stiffness of tendon {name or t + 1!r}", joints)
        return lines, coupled

    def _coupled(
        self,
        name: str,
        k: float,
        rest: float,
        factors: Iterable[tuple[int, float]],
        followers: Followers,
    ) -> CoupledSpringModel:
        """Return a fixed tendon as a spring on a sum of coordinates, those of leaders."""
        joints = dict[str, float]()
        for j, factor in factors:
            (own,) = self.coordinates[j]  # MuJoCo takes hinges and slides only
            if own in followers:
                own, ratio, offset = to_root(own, followers)
                factor, rest = factor * ratio, rest - factor * offset
            joints[own] = joints.get(own, 0.0) + factor
        acting = {own: factor for own, factor in joints.items() if factor}
        return CoupledSpringModel.model_construct(
            name=name, joints=acting, stiffness=k, rest=rest
        )

    def _elastic_bodies(self) -> None:
        """Leave out plugins of bodies that exert forces, and flexible objects."""
        for b, (name, plugin) in enumerate(
            zip(self.bodies, self.data["body_plugin"], strict=True)
        ):
            if plugin >= 0:
                self._leave_out(f"plugin of body {name!r}", self.names_of(self.above(b)))
        for i, name in enumerate(self.data["flex_names"]):
            self._leave_out(f"flex {name!r}", self._flex_joints(i))

    def _ignore_parts(self) -> None:
        """Describe further parts without effect."""
        data, ignored = self.data, self.ignored
        names = [name or f"{t + 1}" for t, name in enumerate(data["tendon_names"])]
        for words, which in (
            ("tendons without stiffness", [not k for k in data["tendon_stiffness"]]),
            ("ranges of tendons", data["tendon_limited"]),
        ):
            if some := list(compress(names, which)):
                ignored.append(f"{words} ({_listed(some)})")
        if data["pair_names"]:
            ignored.append(f"contact pairs ({len(data['pair_names'])})")
        several = [j for j, own in enumerate(self.coordinates) if len(own) > 1]
        if balls := [self.joints[j] for j in several if data["jnt_limited"][j]]:
            ignored.append(f"ranges of ball joints ({_listed(balls)})")
        for what, words in (
            ("armature", "armature"),
            ("damping", "how turns away from the file's orientation couple the dampers"),
        ):
            values, starts = data[f"dof_{what}"], data["jnt_dofadr"]
            if named := [self.joints[j] for j in several if values[starts[j]]]:
                ignored.append(f"{words} of ball and free joints ({_listed(named)})")
        if any(data["opt.wind"]) and (data["opt.density"] or data["opt.viscosity"]):
            ignored.append("wind")
        if self.is_off("SPRING", "PASSIVE") and any(data["jnt_stiffness"]):
            ignored.append("springs, which the file switches off")

    def _weightless(self) -> tuple[str, ...]:
        """Descriptions of masses that are not known."""
        weightless = [
            f"mass of body {', '.join(repr(b) for b in bodies)} (mesh {file} is missing)"
            for file, bodies in self.data["lost_meshes"].items()
        ]
        bare = [
            name
            for b, name in enumerate(self.bodies)
            if self.joints_of[b] and not self._has_mass(b)
        ]
        if self.data["no_mass"] and bare:
            weightless.append(
                f"mass of moving bodies that the file gives none ({_listed(bare)})"
            )
        return tuple(weightless)

    def pieces(self) -> Iterator[Piece]:
        """Yield shapes of bodies: geoms of the groups that MuJoCo shows,
        or all if none is.
        """
        data = self.data
        groups = data["geom_group"]
        for g in [g for g, group in enumerate(groups) if group < 3] or range(len(groups)):
            kind = data["geom_type"][g].removeprefix("mjGEOM_")
            T = _pose(data["geom_pos"][g], data["geom_quat"][g])
            shape: Shape
            if kind in ("MESH", "SDF"):
                index = data["geom_dataid"][g]
                mesh = (
                    data["meshes"].get(data["mesh_names"][index]) if index >= 0 else None
                )
                if mesh is None:
                    continue  # the mesh is in the MJCF file itself
                x, y, z = mesh["scale"]
                shape = MeshFile(Path(mesh["file"]), (x, y, z))
                # MuJoCo places a mesh by its centre and principal axes, not by the file's
                # origin.
                T = T @ se3.inverse(
                    _pose(data["mesh_pos"][index], data["mesh_quat"][index])
                )
                moved = -np.array(mesh["scale"]) * np.array(mesh["refpos"])
                T = (
                    T
                    @ _pose(np.zeros(3), mesh["refquat"]).T
                    @ se3.pose(translation=moved)
                )
            elif kind in _SHAPES:
                shape = _SHAPES[kind](*data["geom_size"][g])
            else:
                continue
            material = data["geom_matid"][g]
            r, gr, b, a = (
                data["geom_rgba"][g] if material < 0 else data["mat_rgba"][material]
            )
            yield Piece(self.bodies[data["geom_bodyid"][g]], T, shape, (r, gr, b, a))


def _pose(position: ArrayLike, quaternion: Iterable[float]) -> Array:
    """4x4 pose of a position and a quaternion (w, x, y, z)."""
    turn = pin.Quaternion(*map(float, quaternion)).normalized()
    return se3.pose(turn.toRotationMatrix(), position)


def _named(names: list[str], stem: str) -> list[str]:
    """Names; things without one get the stem and a number."""
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


_SHAPES: dict[str, Callable[[float, float, float], Shape]] = {
    "BOX": lambda a, b, c: Box((2 * a, 2 * b, 2 * c)),
    "CYLINDER": lambda a, b, _: Cylinder(a, 2 * b),
    "CAPSULE": lambda a, b, _: Capsule(a, 2 * b),
    "SPHERE": lambda a, *_: Sphere((a, a, a)),
    "ELLIPSOID": lambda a, b, c: Sphere((a, b, c)),
}
