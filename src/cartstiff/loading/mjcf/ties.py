"""Equality constraints of an MJCF file: closures, coupled joints, joints that are held."""

from __future__ import annotations

from typing import Literal

from cartstiff.errors import InputError
from cartstiff.geometry import se3
from cartstiff.loading.mjcf.compiled import Compiled, pose
from cartstiff.loading.robot_facts import FileClosure, Followers, Obstacle

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
