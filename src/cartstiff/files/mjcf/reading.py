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
from itertools import count, filterfalse
from operator import attrgetter
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Literal

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from cartstiff.core import numerics
from cartstiff.core.arrays import Array
from cartstiff.core.choices import LARGEST_INPUT
from cartstiff.core.errors import InputError, MissingDependencyError, listed, one_line
from cartstiff.core.geometry import se3
from cartstiff.core.mechanisms.shapes import (
    Box,
    Capsule,
    Cylinder,
    MeshFile,
    Piece,
    Shape,
    Sphere,
)
from cartstiff.core.mechanisms.tree import add_joint
from cartstiff.files.child_process import answer_of
from cartstiff.files.description import (
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
from cartstiff.files.identity import fingerprint, was_read
from cartstiff.files.mjcf import worker
from cartstiff.files.plain_joints import primitive
from cartstiff.files.schema import CoupledSpringModel, LineModel
from cartstiff.files.tree_building import free_name

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
#: Numbers that must be of moderate size: of elements, and of the whole.
_NUMBERS = {
    "body": "pos quat mass ipos iquat inertia gravcomp",
    "joint": "pos axis stiffness stiffnesspoly",
    "site": "pos quat",
    "equality": "data",
}
_WHOLE = "qpos0 qpos_spring opt.gravity dof_armature dof_damping key_qpos"

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


def read_mjcf(path: Path, where: str) -> RobotDescription:
    """Read an MJCF file, of which messages say `where` it is.

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
    return _Compiled(compile_mjcf(path, where), where).description(path)


class _Compiled:
    """A compiled model, checked, with names for everything.

    Its elements have MuJoCo's fields by their own names without the element's
    (``jnt_axis`` is the `axis` of one of `joints`), and an `index`.

    Attributes
    ----------
    data : dict
        MuJoCo's arrays by their own names, as lists; types as MuJoCo's names of them.
    bodies : list
        Each with its `joints`; generated names where the file has none.
    joints : list
        Each with the names of its `coordinates`, and their `armature` and `damping`.
    sites : list
        Their names are not those of bodies.
    tendons : list
        Each with what it `wraps`.
    equalities, actuators, flexes : list
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
        self.bodies = _elements(data, "body", "body")
        self.joints = _elements(data, "jnt", "joint")
        self.sites = _elements(data, "site", "site")
        self.equalities = _elements(data, "eq", "equality")
        self.tendons = _elements(data, "tendon", "tendon")
        self.actuators = _elements(data, "actuator", "actuator")
        self.flexes = _elements(data, "flex", "flex")
        if not self.joints:
            raise InputError("robot has no movable joints", where=where)
        for things, stem, first in (
            (self.bodies, "body", 0),
            (self.joints, "joint", 1),
            (self.sites, "site", 1),
        ):
            _name(things, stem, first)
        taken = {"world", *(body.name for body in self.bodies)}
        for site in self.sites:
            if site.name in taken:
                site.name = free_name(f"{site.name} (site)", taken)
            taken.add(site.name)
        self._join()
        self._check_numbers()
        self._check_directions()
        for joint in self.joints:
            self._check_joint(joint)

    def _join(self) -> None:
        """Give bodies their joints, joints their coordinates, tendons what they wrap."""
        data, taken = self.data, set[str]()
        for body in self.bodies:
            body.joints = []
        for joint in self.joints:
            suffixes = [f".{s}" for s in _SUFFIXES.get(joint.type, ())] or [""]
            joint.coordinates = [free_name(joint.name + s, taken) for s in suffixes]
            taken.update(joint.coordinates)
            dofs = slice(joint.dofadr, joint.dofadr + len(suffixes))
            joint.armature, joint.damping = (
                data[f"dof_{what}"][dofs] for what in ("armature", "damping")
            )
            self.bodies[joint.bodyid].joints.append(joint)
        wraps = _elements(data, "wrap")
        for tendon in self.tendons:
            tendon.wraps = wraps[tendon.adr : tendon.adr + tendon.num]

    def _check_numbers(self) -> None:
        """Refuse numbers that are not finite or too large, which MuJoCo accepts."""
        every = {"body": self.bodies, "joint": self.joints, "site": self.sites}
        every["equality"] = self.equalities
        for kind, fields in _NUMBERS.items():
            for name in fields.split():
                for one in every[kind]:
                    owner = one.name or str(one.index + 1)
                    self._check(f"{kind} {owner!r}: {name}", getattr(one, name))
        for name in _WHOLE.split():
            what = f"a position, an armature, a damping or gravity ({name})"
            self._check(what, self.data[name] or [])

    def _check_directions(self) -> None:
        """Refuse zeros: MuJoCo normalises other directions, to rounding."""
        turns = [q for body in self.bodies for q in (body.quat, body.iquat)]
        turns += [site.quat for site in self.sites]
        axes = [joint.axis for joint in self.joints]
        for what, rows in (("an orientation", turns), ("a joint axis", axes)):
            sizes = np.linalg.norm(rows, axis=1)
            if not (np.abs(sizes - 1.0) < numerics.NEGLIGIBLE_DIFFERENCE).all():
                raise InputError(f"{what} has no direction", where=self.where)

    def _check(self, what: str, values: Any) -> None:
        numbers = np.ravel(values)
        wrong = numbers[~(np.abs(numbers) <= LARGEST_INPUT)]
        if wrong.size:
            raise InputError(
                f"{what} cannot be used",
                where=self.where,
                expected=f"finite numbers up to {LARGEST_INPUT:g}",
                got=" ".join(f"{v:g}" for v in wrong),
            )

    def _check_joint(self, joint: Any) -> None:
        """Leave out a joint whose limits or dampers cannot be."""
        faults = []
        lower, upper = joint.range
        if not lower <= upper:  # to MuJoCo that means no limits
            got = f"{lower:g} {upper:g}"
            faults.append(("range is the wrong way round", "lower upper", got))
        for what in ("armature", "damping", "stiffness"):
            if (least := np.min(getattr(joint, what))) < 0.0:
                faults.append((f"{what} is negative", "zero or more", f"{least:g}"))
        for words, expected, got in faults:
            words = f"joint {joint.name!r}: {words}"
            error = InputError(words, where=self.where, expected=expected, got=got)
            self._leave_out(words, joint.coordinates, error)

    def _leave_out(
        self, what: str, names: Iterable[str], error: InputError | None = None
    ) -> None:
        """Record a part that cannot be used, and the coordinates that it acts on."""
        self.obstacles.append(Obstacle(what, frozenset(names), error=error))

    def is_off(self, *parts: str) -> bool:
        """Whether the file disables one of these parts of the physics."""
        return any(f"mjDSBL_{part}" in self.data["disabled"] for part in parts)

    def above(self, *bodies: int) -> frozenset[str]:
        """Coordinates between the world and some bodies."""
        names: set[str] = set()
        for body in bodies:
            while body > 0:
                names.update(*(joint.coordinates for joint in self.bodies[body].joints))
                body = self.bodies[body].parentid
        return frozenset(names)

    def model(self) -> pin.Model:
        """Return the Pinocchio model with one joint per coordinate.

        Bodies and sites are frames.
        """
        model = pin.Model()
        model.name = self.data["name"]
        at: list[tuple[int, Array]] = [(0, np.eye(4))]
        for body in self.bodies[1:]:
            joint, T = at[body.parentid]
            T = T @ _pose(body.pos, body.quat)
            for own in body.joints:
                for name, part, T_part, limits in self._parts(own, T):
                    joint = add_joint(model, joint, part, T_part, name, limits)
                turns = own.type in ("mjJNT_HINGE", "mjJNT_BALL")
                T = se3.pose(translation=-turns * np.array(own.pos))
            at.append((joint, T))
            inertia = pin.Inertia.Zero()
            if self._has_mass(body):
                T_b_c = pin.SE3(_pose(body.ipos, body.iquat))
                moments = np.diag(body.inertia)
                inertia = pin.Inertia(body.mass, np.zeros(3), moments).se3Action(T_b_c)
            placed = pin.SE3(T), pin.FrameType.BODY, inertia
            model.addFrame(pin.Frame(body.name, joint, *placed))
        damped = not self.is_off("DAMPER", "PASSIVE")
        for own in self.joints:
            for name, armature, damping in zip(
                own.coordinates, own.armature, own.damping, strict=True
            ):
                v = model.idx_vs[model.getJointId(name)]
                # In successive turns of a ball or free joint it would not stay diagonal.
                if len(own.coordinates) == 1:
                    model.armature[v] = armature
                if damped:
                    model.damping[v] = damping
        for site in self.sites:
            joint, T = at[site.bodyid]
            T = T @ _pose(site.pos, site.quat)
            model.addFrame(
                pin.Frame(site.name, joint, pin.SE3(T), pin.FrameType.OP_FRAME)
            )
        return model

    def _has_mass(self, body: Any) -> bool:
        return bool(body.mass > self.data["no_mass"])

    def _parts(
        self, joint: Any, T: Array
    ) -> list[tuple[str, Any, Array, tuple[float, float]]]:
        """One-coordinate joints of a joint of a body at T: name, model, placement,
        limits.
        """
        free, still, reference = (-np.inf, np.inf), np.eye(4), self._reference(joint)
        kinds: tuple[str, ...] = ()
        if joint.type == "mjJNT_FREE":
            kinds = ("PX", "PY", "PZ", "RX", "RY", "RZ")
            # The turns begin at the reference; the shifts are along F.
            home = _pose(np.zeros(3), reference[3:7])
            places = [still, still, still, home, still, still]
        T_axis = T @ se3.pose(translation=joint.pos)
        if joint.type == "mjJNT_BALL":
            kinds, places = ("RX", "RY", "RZ"), [T_axis, still, still]
        if kinds:
            parts = zip(joint.coordinates, map(primitive, kinds), places, strict=True)
            return [(name, part, place, free) for name, part, place in parts]
        # A hinge or slide is at its reference in the file.
        axis, step = np.array(joint.axis), np.zeros(6)
        make, limits = pin.JointModelRevoluteUnaligned, free
        if joint.type == "mjJNT_SLIDE":
            make, T_axis = pin.JointModelPrismaticUnaligned, T
            step[3:] = -axis * reference[0]
        else:
            step[:3] = -axis * reference[0]
        if joint.limited and not self.is_off("LIMIT", "CONSTRAINT"):
            limits = tuple(joint.range)
        return [(joint.coordinates[0], make(axis), T_axis @ se3.exp(step), limits)]

    def _reference(self, joint: Any) -> list[float]:
        """Position of a joint in the file, and what follows it."""
        own: list[float] = self.data["qpos0"][joint.qposadr :]
        return own

    def description(self, path: Path) -> RobotDescription:
        """Return the model and everything beside it."""
        # Each part is read to what can be used; the rest is ignored, or an obstacle.
        actuated, springs = self._actuators(), self._springs()
        closures, followers = self._equalities()
        springs, nonlinear = on_leaders(springs, followers)
        self.obstacles += nonlinear
        lines, coupled = self._tendons(followers)
        self._elastic_bodies()
        self._ignore_parts()
        posture, keyframe = self._posture()
        gravity = np.array(self.data["opt.gravity"], float)
        has_gravity = bool(gravity.any()) and not self.is_off("GRAVITY")
        looped = {c for tie in closures for c in tie.joints}
        floating = {
            c for j in self.joints if len(j.coordinates) == 6 for c in j.coordinates
        }
        free = (floating | looped) - springs.keys() - actuated.keys()
        lifted = [b for b in self.bodies if b.gravcomp and self._has_mass(b)]
        return RobotDescription(
            self.model(),
            path,
            tuple(self.pieces()),
            springs=springs,
            passive=tuple(c for j in self.joints for c in j.coordinates if c in free),
            loose=frozenset(floating - looped),
            actuated=tuple(actuated),
            lines=tuple(lines),
            coupled=tuple(coupled),
            actuators={name: k for name, k in actuated.items() if k > 0.0},
            efforts=self._efforts(),
            followers=followers,
            locked=self.locked,
            closures=tuple(closures),
            posture=posture,
            keyframe=keyframe,
            gravity=gravity if has_gravity else None,
            lifted=tuple(
                Lifted(b.name, b.gravcomp * b.mass, np.array(b.ipos)) for b in lifted
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
        closures: list[FileClosure] = []
        couplings: list[tuple[str, str, float, float]] = []
        mocap = {body.name for body in self.bodies if body.mocapid >= 0}
        is_off = self.is_off("EQUALITY", "CONSTRAINT")
        for one in [] if is_off else filter(attrgetter("active0"), self.equalities):
            what = f"equality {one.name or one.index + 1}"
            if one.type in ("mjEQ_CONNECT", "mjEQ_WELD"):
                closure = self._closure(one)
                a, b = closure.body_a, closure.body_b
                if mocap.isdisjoint((a, b)):
                    closures.append(closure)
                else:
                    self.ignored.append(f"tie of {a!r} and {b!r} (a mocap body)")
            elif one.type == "mjEQ_JOINT":
                couplings += self._coupling(one, what)
            elif one.type == "mjEQ_TENDON":
                names = self._tendon_joints(self.tendons[one.obj1id])
                self._leave_out(f"{what} of tendons", names)
            else:
                word = one.type.removeprefix("mjEQ_").lower()
                names = self._flex_joints(self.flexes[one.obj1id])
                self._leave_out(f"{what} of {word}s", names)
        return closures, self._followers(couplings)

    def _closure(self, one: Any) -> FileClosure:
        a, b, values = one.obj1id, one.obj2id, one.data
        point = one.type == "mjEQ_CONNECT"
        if one.objtype == "mjOBJ_SITE":
            ends = self.sites[a], self.sites[b]
            T_a, T_b = (_pose(site.pos, site.quat) for site in ends)
            a, b = (site.bodyid for site in ends)
        elif point:
            T_a, T_b = se3.pose(translation=values[:3]), se3.pose(translation=values[3:6])
        else:
            # The first three numbers are a point of body b, the next a pose in body a.
            T_a, T_b = _pose(values[3:6], values[6:10]), se3.pose(translation=values[:3])
        # A weld whose share of torque is zero ties the points only.
        point = point or values[10] == 0.0
        tied: Literal["point", "weld"] = "point" if point else "weld"
        names = self.bodies[a].name, self.bodies[b].name
        return FileClosure(tied, *names, T_a, T_b, self.above(a) ^ self.above(b))

    def _coupling(self, one: Any, what: str) -> list[tuple[str, str, float, float]]:
        """Couple joint a to joint b, or lock it: q_a - ref_a = c_0 + c_1
        (q_b - ref_b).
        """
        a, values = self.joints[one.obj1id], one.data
        b = self.joints[one.obj2id] if one.obj2id >= 0 else None
        follower, start = a.coordinates[0], self._reference(a)[0] + values[0]
        if b is not None and any(values[2:5]):
            error = InputError(
                f"{what} couples joints {a.name!r} and {b.name!r} by a curve",
                where=self.where,
                expected="a straight line: polycoef with two numbers",
                got=" ".join(f"{v:g}" for v in values[:5]),
            )
            self._leave_out(error.what, (*a.coordinates, *b.coordinates), error)
            return []
        if b is None or values[1] == 0.0:
            if follower in self.locked:
                words = f"joint {follower!r} is held twice"
                error = InputError(words, where=self.where)
                self._leave_out(words, a.coordinates, error)
            self.locked.setdefault(follower, start)
            return []
        offset = start - values[1] * self._reference(b)[0]
        return [(follower, b.coordinates[0], values[1], offset)]

    def _followers(self, couplings: list[tuple[str, str, float, float]]) -> Followers:
        """Each coupling as one joint that follows another,
        reversed where that is needed.
        """
        followers: Followers = {}

        def refuse(what: str, *joints: str) -> None:
            self._leave_out(what, joints, InputError(what, where=self.where))

        def root(name: str) -> str:
            return to_root(name, followers)[0] if name in followers else name

        for follower, leader, factor, offset in couplings:
            if root(follower) == root(leader):
                refuse(f"joint {follower!r} is coupled to itself", follower, leader)
            elif follower not in followers:
                followers[follower] = (leader, factor, offset)
            elif leader not in followers:
                followers[leader] = (follower, 1 / factor, -offset / factor)
            else:
                words = f"joints {follower!r} and {leader!r} are coupled twice"
                refuse(words, follower, leader)
        return followers

    def _tendon_joints(self, tendon: Any) -> frozenset[str]:
        """Coordinates that change a tendon's length."""
        names: set[str] = set()
        for wrap in tendon.wraps:
            if wrap.type == "mjWRAP_JOINT":
                names.update(self.joints[wrap.objid].coordinates)
            elif wrap.type == "mjWRAP_SITE":
                names |= self.above(self.sites[wrap.objid].bodyid)
            elif wrap.type in ("mjWRAP_SPHERE", "mjWRAP_CYLINDER"):
                names |= self.above(self.data["geom_bodyid"][wrap.objid])
        return frozenset(names)

    def _flex_joints(self, flex: Any) -> frozenset[str]:
        """Coordinates that move the vertices of a flexible object."""
        vertices = slice(flex.vertadr, flex.vertadr + flex.vertnum)
        return self.above(*{*self.data["flex_vertbodyid"][vertices]})

    def _springs(self) -> dict[str, FileSpring]:
        """Springs of hinges and slides; others become obstacles."""
        springs: dict[str, FileSpring] = {}
        if self.is_off("SPRING", "PASSIVE"):
            return springs
        for joint in self.joints:
            coefficients = [joint.stiffness, *joint.stiffnesspoly]
            while coefficients and coefficients[-1] == 0.0:
                coefficients.pop()
            if not coefficients:
                continue
            own = joint.coordinates
            if len(own) > 1:
                kind = "ball" if len(own) == 3 else "free"
                self._leave_out(f"spring of the {kind} joint {joint.name!r}", own)
            elif (
                len(coefficients) > 1 or coefficients[0] > 0
            ):  # a negative one is a fault
                rest = self.data["qpos_spring"][joint.qposadr]
                springs[own[0]] = FileSpring(tuple(coefficients), rest)
        return springs

    def _posture(self) -> tuple[dict[str, float], str | None]:
        """Positions of the keyframe "home", else of the first one,
        else the file's own.
        """
        keys, q = self.data["key_names"], self.data["qpos0"]
        chosen = None
        if keys:
            index = keys.index("home") if "home" in keys else 0
            chosen, q = keys[index] or f"{index + 1}", self.data["key_qpos"][index]
        posture: dict[str, float] = {}
        for joint in self.joints:
            own = q[joint.qposadr :]
            values = own[:1]
            if joint.type == "mjJNT_BALL":
                values = successive_turns(_pose(np.zeros(3), own[:4]))
            elif joint.type == "mjJNT_FREE":
                home, now = (
                    _pose(np.zeros(3), x[3:7]) for x in (self._reference(joint), own)
                )
                values = [*own[:3], *successive_turns(se3.inverse(home) @ now)]
            posture |= zip(joint.coordinates, map(float, values), strict=True)
        return posture, chosen

    def _actuators(self) -> dict[str, float]:
        """Coordinates that actuators drive, with the springs of position control.

        A force ``-kp gear q`` on the gear's far side is the spring ``kp gear^2`` at the
        joint.
        """
        driven: dict[str, float] = {}
        held, others = list[Any](), list[Any]()
        for one in self.actuators:
            k = 0.0
            is_of_joint = one.trntype in (0, 1)  # joint, joint in parent
            own = self.joints[one.trnid[0]].coordinates if is_of_joint else []
            if len(own) == 1:
                if one.biastype == "mjBIAS_AFFINE":
                    k = max(-one.biasprm[1] * one.gear[0] ** 2, 0.0)
                driven[own[0]] = driven.get(own[0], 0.0) + k
            (held if k > 0.0 else others).append(one)
        self._ignore(POSITION_ACTUATORS, held)
        self._ignore("actuators", others)
        return driven

    def _efforts(self) -> dict[str, tuple[float, float]]:
        """Least and largest torque of the drives, by coordinate.

        The forces of all actuators of a joint, each times its gear, within the joint's
        own limits.
        """
        found = dict[str, tuple[float, float]]()
        for one in self.actuators:
            own = self.joints[one.trnid[0]].coordinates if one.trntype in (0, 1) else []
            if len(own) == 1:
                ends = [
                    x * one.gear[0] if one.gear[0] else 0.0 for x in _force_range(one)
                ]
                low, high = sorted(ends)
                before = found.get(own[0], (0.0, 0.0))
                found[own[0]] = before[0] + low, before[1] + high
        for joint in self.joints:
            if joint.actfrclimited and len(joint.coordinates) == 1:
                (name,), (low, high) = joint.coordinates, joint.actfrcrange
                before = found.get(name, (-np.inf, np.inf))
                found[name] = max(before[0], low), min(before[1], high)
        return {name: pair for name, pair in found.items() if np.isfinite(pair).any()}

    def _tendons(
        self, followers: Followers
    ) -> tuple[list[tuple[LineModel, frozenset[str]]], list[CoupledSpringModel]]:
        """Straight tendons with stiffness between two sites as lines,
        fixed ones on joints' sums.

        Others become obstacles. A tendon with a range of spring lengths is slack within
        it; one whose range begins at 0 pulls and never pushes.
        """
        lines: list[tuple[LineModel, frozenset[str]]] = []
        coupled: list[CoupledSpringModel] = []
        for tendon in self.tendons:
            k, is_curved = tendon.stiffness, any(tendon.stiffnesspoly)
            if not (k or is_curved) or self.is_off("SPRING", "PASSIVE"):
                continue
            joints, kinds = self._tendon_joints(tendon), [w.type for w in tendon.wraps]
            shortest, rest = tendon.lengthspring
            is_plain = k > 0.0 and not is_curved and shortest in (0.0, rest)
            if is_plain and kinds == ["mjWRAP_SITE"] * 2:
                line = LineModel.model_construct(
                    frames=[self.sites[wrap.objid].name for wrap in tendon.wraps],
                    points=[[0.0] * 3] * 2,
                    stiffness=k,
                    rest_length=rest,
                    unilateral=shortest < rest,
                )
                lines.append((line, joints))
            elif is_plain and shortest == rest and {*kinds} == {"mjWRAP_JOINT"}:
                coupled.append(self._coupled(tendon, followers))
            else:
                name = tendon.name or tendon.index + 1
                self._leave_out(f"stiffness of tendon {name!r}", joints)
        return lines, coupled

    def _coupled(self, tendon: Any, followers: Followers) -> CoupledSpringModel:
        """Return a fixed tendon as a spring on a sum of coordinates, those of leaders."""
        joints, rest = dict[str, float](), tendon.lengthspring[1]
        for wrap in tendon.wraps:
            # MuJoCo takes hinges and slides only.
            (own,), factor = self.joints[wrap.objid].coordinates, wrap.prm
            if own in followers:
                own, ratio, offset = to_root(own, followers)
                factor, rest = factor * ratio, rest - factor * offset
            joints[own] = joints.get(own, 0.0) + factor
        return CoupledSpringModel.model_construct(
            name=tendon.name or f"tendon {tendon.index + 1}",
            joints={own: factor for own, factor in joints.items() if factor},
            stiffness=tendon.stiffness,
            rest=rest,
        )

    def _elastic_bodies(self) -> None:
        """Leave out plugins of bodies that exert forces, and flexible objects."""
        for body in self.bodies:
            if body.plugin >= 0:
                self._leave_out(f"plugin of body {body.name!r}", self.above(body.index))
        for flex in self.flexes:
            self._leave_out(f"flex {flex.name!r}", self._flex_joints(flex))

    def _ignore(self, words: str, things: Iterable[Any], key: str = "index") -> None:
        """Describe things without effect: those of which a field is not zero."""
        some = [one for one in things if key == "index" or np.any(getattr(one, key))]
        names = [one.name or f"{one.index + 1}" for one in some]
        if names:
            self.ignored.append(f"{words} ({_listed(names)})")

    def _ignore_parts(self) -> None:
        """Describe further parts without effect."""
        data, several = self.data, [j for j in self.joints if len(j.coordinates) > 1]
        loose = filterfalse(attrgetter("stiffness"), self.tendons)
        self._ignore("tendons without stiffness", loose)
        self._ignore("ranges of tendons", self.tendons, "limited")
        if data["pair_names"]:
            self.ignored.append(f"contact pairs ({len(data['pair_names'])})")
        self._ignore("ranges of ball joints", several, "limited")
        self._ignore("armature of ball and free joints", several, "armature")
        words = "how turns away from the file's orientation couple the dampers"
        self._ignore(f"{words} of ball and free joints", several, "damping")
        if any(data["opt.wind"]) and (data["opt.density"] or data["opt.viscosity"]):
            self.ignored.append("wind")
        if self.is_off("SPRING", "PASSIVE") and any(data["jnt_stiffness"]):
            self.ignored.append("springs, which the file switches off")

    def _weightless(self) -> tuple[str, ...]:
        """Descriptions of masses that are not known."""
        weightless = [
            f"mass of body {', '.join(map(repr, bodies))} (mesh {file} is missing)"
            for file, bodies in self.data["lost_meshes"].items()
        ]
        bare = [b.name for b in self.bodies if b.joints and not self._has_mass(b)]
        if self.data["no_mass"] and bare:
            words = "mass of moving bodies that the file gives none"
            weightless.append(f"{words} ({_listed(bare)})")
        return tuple(weightless)

    def pieces(self) -> Iterator[Piece]:
        """Yield shapes of bodies: geoms of the groups that MuJoCo shows,
        or all if none is.
        """
        geoms = _elements(self.data, "geom")
        for geom in [geom for geom in geoms if geom.group < 3] or geoms:
            kind, T = geom.type.removeprefix("mjGEOM_"), _pose(geom.pos, geom.quat)
            if kind in ("MESH", "SDF"):
                name = self.data["mesh_names"][geom.dataid] if geom.dataid >= 0 else None
                if name not in self.data["meshes"]:
                    continue  # the mesh is in the MJCF file itself
                shape, T_m = self._mesh(self.data["meshes"][name], geom.dataid)
                T = T @ T_m
            elif kind in SHAPES:
                shape = SHAPES[kind](*geom.size)
            else:
                continue
            colour = geom.rgba if geom.matid < 0 else self.data["mat_rgba"][geom.matid]
            yield Piece(self.bodies[geom.bodyid].name, T, shape, tuple(colour))

    def _mesh(self, mesh: dict[str, Any], index: int) -> tuple[Shape, Array]:
        """Mesh of a file, and its pose in a geom.

        MuJoCo places a mesh by its centre and principal axes, not by the file's origin.
        """
        x, y, z = mesh["scale"]
        centre = _pose(self.data["mesh_pos"][index], self.data["mesh_quat"][index])
        moved = -np.array(mesh["scale"]) * np.array(mesh["refpos"])
        back = _pose(np.zeros(3), mesh["refquat"]).T @ se3.pose(translation=moved)
        return MeshFile(Path(mesh["file"]), (x, y, z)), se3.inverse(centre) @ back


def _force_range(actuator: Any) -> tuple[float, float]:
    """Least and largest force of an actuator: its own limits, within those that the
    limits of its control leave a plain motor.
    """
    low, high = -np.inf, np.inf
    if actuator.forcelimited:
        low, high = actuator.forcerange
    kinds = actuator.gaintype, actuator.biastype, actuator.dyntype
    if actuator.ctrllimited and kinds == ("mjGAIN_FIXED", "mjBIAS_NONE", "mjDYN_NONE"):
        least, most = sorted(actuator.gainprm[0] * x for x in actuator.ctrlrange)
        low, high = max(low, least), min(high, most)
    return low, high


def _elements(data: dict[str, Any], prefix: str, kind: str = "") -> list[Any]:
    """Elements of a kind with MuJoCo's fields, less their prefix.

    Fields that this MuJoCo does not have are empty.
    """
    columns = {
        key.removeprefix(f"{prefix}_"): values
        for key, values in data.items()
        if key.startswith(f"{prefix}_") and not key.endswith("_names")
    }
    columns["name"] = data.get(f"{kind}_names")
    most = max(len(values) for values in columns.values() if values is not None)
    return [
        SimpleNamespace(index=i, **{key: x[i] if x else () for key, x in columns.items()})
        for i in range(most)
    ]


def _pose(position: ArrayLike, quaternion: Iterable[float]) -> Array:
    """4x4 pose of a position and a quaternion (w, x, y, z)."""
    turn = pin.Quaternion(*map(float, quaternion)).normalized()
    return se3.pose(turn.toRotationMatrix(), position)


def _name(things: list[Any], stem: str, first: int) -> None:
    """Give things without a name the stem and a number."""
    taken = {thing.name for thing in things}
    for start, thing in enumerate(things, start=first):
        if not thing.name:
            every = (f"{stem}{number}" for number in count(start))
            thing.name = next(name for name in every if name not in taken)
            taken.add(thing.name)


#: Shapes by half of their sizes.
SHAPES: dict[str, Callable[[float, float, float], Shape]] = {
    "BOX": lambda a, b, c: Box((2 * a, 2 * b, 2 * c)),
    "CYLINDER": lambda a, b, _: Cylinder(a, 2 * b),
    "CAPSULE": lambda a, b, _: Capsule(a, 2 * b),
    "SPHERE": lambda a, *_: Sphere((a, a, a)),
    "ELLIPSOID": lambda a, b, c: Sphere((a, b, c)),
}
