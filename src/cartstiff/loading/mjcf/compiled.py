"""MuJoCo's compiled model of an MJCF file, by a process of its own, as data."""

from __future__ import annotations

import importlib.util
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from cartstiff import numerics
from cartstiff.child_process import answer_of
from cartstiff.errors import InputError, MissingDependencyError, one_line
from cartstiff.geometry import se3
from cartstiff.geometry.se3 import Array
from cartstiff.loading.mjcf import worker
from cartstiff.loading.robot_facts import Obstacle
from cartstiff.loading.yaml_file import LARGEST_NUMBER
from cartstiff.mechanisms.identity import fingerprint, was_read

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
        raise InputError("not a usable MJCF", where=where, got=one_line(message, 400))
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
    bodies, joints : list of str
        Names; made ones where the file has none.
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
        self.types = [data["enums"]["mjtJoint"][str(t)] for t in data["jnt_type"]]
        self.coordinates: list[list[str]] = []
        taken: set[str] = set()
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
        owners = {"body": self.bodies, "joint": self.joints, "site": None, "equality": None}
        for kind, fields in _NUMBERS.items():
            for name in fields.split():
                values = np.array(self.data[name] or [], float)
                rows = values.reshape(len(values), -1) if values.size else np.zeros((0, 1))
                bad = ~(np.abs(rows) <= LARGEST_NUMBER).all(axis=1)
                if bad.any():
                    i = int(np.argmax(bad))
                    whose = (owners[kind] or self.data[f"{kind}_names"])[i] or str(i + 1)
                    raise InputError(
                        f"{kind} {whose!r}: {name.partition('_')[2]} cannot be used",
                        where=self.where,
                        expected=f"finite numbers up to {LARGEST_NUMBER:g}",
                        got=" ".join(f"{v:g}" for v in rows[i]),
                    )
        loose = [self.data["qpos0"], self.data["qpos_spring"], self.data["opt.gravity"]]
        loose += [self.data["dof_armature"], self.data["dof_damping"]]
        loose += self.data["key_qpos"]
        if not (np.abs(np.concatenate(loose)) <= LARGEST_NUMBER).all():
            raise InputError(
                "a position, an armature, a damping or gravity cannot be used",
                where=self.where,
                expected=f"finite numbers up to {LARGEST_NUMBER:g}",
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
