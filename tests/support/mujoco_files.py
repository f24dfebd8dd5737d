"""A posture as MuJoCo's file, in SI units: a peer computes the same machine.

Every joint's reference is the posture's coordinate: the model starts assembled at the posture.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np

from cartstiff import (
    ElasticMechanism,
    InputError,
    JointSprings,
    LineSprings,
    PostureStiffness,
    UndefinedError,
)
from cartstiff.extend import Platform
from cartstiff.geometry import se3
from tests.doors import SI, Array, Chain, PlatformPosture, Units, convert_length, numerics


@dataclass
class Link:
    """A link of a tree with the joint that moves it against its parent; fixed without an axis."""

    name: str
    parent: str
    T: Array
    axis: Array | None = None
    slides: bool = False
    limits: tuple[float, float] = (-np.inf, np.inf)
    joint: str = ""
    body: tuple[float, Array, Array] = (0.0, np.zeros(3), np.zeros((3, 3)))


Parts = tuple[list[Link], list[dict[str, Any]], dict[str, Any]]


def _body(platform: Platform, length: float) -> tuple[float, Array, Array]:
    """Return the body's mass, its centre in M, and the inertia about it, with lengths in metres."""
    arm = se3.skew(platform.mass_centre)
    about = platform.body_inertia[:3, :3] + platform.mass * arm @ arm
    return platform.mass, length * platform.mass_centre, length**2 * about


def scaled_pose(T: Array, units: Units) -> Array:
    """Convert a pose to metres."""
    other = np.array(T)
    other[:3, 3] *= convert_length(units, SI)[0]
    return other


def parts_of_chain(result: PostureStiffness, springs: JointSprings) -> Parts:
    """Return the tree of a chain, joint by joint, with a link for each end of a closure."""
    elastic, chain = result.elastic, result.elastic.mechanism
    if not isinstance(chain, Chain):
        raise TypeError("a chain")
    tree, odd = chain.tree, [c.name for c in chain.coordinates if c.type == "helical"]
    if tree.mimic is not None or odd or len(chain.coordinates) != tree.model.nv:
        raise InputError(
            "screws, and joints that follow others, are not written",
            where=elastic.name,
            got=", ".join(odd) or "mimic joints",
        )
    length, force = convert_length(elastic.units, SI)

    def scaled(T: Array) -> Array:
        return scaled_pose(T, elastic.units)

    names = ["base", *(f"link {i}" for i in range(1, tree.model.njoints))]
    links, screws = [], tree.screws()
    bodies = list(tree.model.inertias)
    sizes = np.where(chain.is_length, length, 1.0)
    for i, (c, T) in enumerate(zip(chain.coordinates, tree.placements(), strict=True)):
        axis = screws[i, 3:] if c.is_length else screws[i, :3]
        own = bodies[i + 1]
        body = (float(own.mass), length * own.lever, length**2 * own.inertia)
        limits = (c.lower * sizes[i], c.upper * sizes[i])
        links.append(
            Link(
                names[i + 1],
                names[int(tree.model.parents[i + 1])],
                scaled(T),
                axis,
                c.is_length,
                limits,
                c.name,
                body,
            )
        )

    def fixed(name: str, frame: str) -> str:
        at = chain.placement(frame)
        links.append(Link(name, names[at.joint], scaled(at.T_j_f)))
        return name

    closures: list[dict[str, Any]] = []
    for i, tie in enumerate(chain.closures):
        ends = [fixed(f"tie {i + 1}{s}", f) for s, f in (("a", tie.frame_a), ("b", tie.frame_b))]
        closures.append({"frames": ends, "type": tie.type})
    links.append(Link("M", names[chain.body.joint], scaled(chain.body.T_j_f)))
    named: dict[str, dict[str, object]] = {}
    stiff: str | float
    for j, (c, k) in enumerate(zip(chain.coordinates, elastic.stiffnesses, strict=True)):
        if k > 0.0:
            stiff = "rigid" if np.isinf(k) else float(k * force * length / sizes[j] ** 2)
            named[c.name] = {"stiffness": stiff}
            if np.isfinite(springs.rest[j]) and np.isfinite(k):
                named[c.name]["rest"] = float(springs.rest[j] * sizes[j])
    q = {c.name: float(x) for c, x in zip(chain.coordinates, result.q * sizes, strict=True)}
    passive = [c.name for c in chain.coordinates if c.name not in named]
    drives = [chain.coordinates[j].name for j in chain.actuated or ()]
    return links, closures, {"q": q, "actuated": drives, "springs": named, "passive": passive}


# Mass and moment of inertia of links without mass.
_MIN_BODY = "1e-6", "1e-9"


def numbers(values: Array) -> str:
    """Format numbers of an attribute with all their digits."""
    return " ".join(repr(float(x)) for x in values)


def quaternion(R: Array) -> Array:
    """Return the quaternion of a rotation, real part first."""
    from scipy.spatial.transform import Rotation

    return np.roll(np.asarray(Rotation.from_matrix(R).as_quat()), 1)


def load_of_mujoco(result: PostureStiffness, parent: str) -> tuple[list[str], list[str], list[str]]:
    """Describe the wrench that holds the posture by sites on body and world, and an actuator.

    A `general` actuator without control exerts its bias on the site: along the site's axes, which
    turn with the body (follower), or along those of the reference site (dead).

    Raises
    ------
    InputError
        For a moment that turns by half, which MuJoCo does not have.
    """
    W, load = result.shown_wrench(np.asarray(result.wrench)), result.load
    if result.wrench is None or not W.any():
        return [], [], []
    length, force = convert_length(result.elastic.units, SI)
    at = np.array(load.at)
    m, f = (W[:3] - np.cross(at, W[3:])) * force * length, W[3:] * force
    if load.kind == "conservative" and np.abs(m).max() > numerics.ROUNDOFF * np.abs(W).max():
        raise InputError(
            "MuJoCo has no moment that turns by half",
            where="--load-kind",
            expected="dead or follower",
            got=load.kind,
        )
    reference, room = "", []
    if load.kind != "follower":
        R = result.pose[:3, :3]
        m, f = R @ m, R @ f
        reference, room = ' refsite="room"', ['<site name="room"/>']
    gear = numbers(np.concatenate([f, m]))
    pushes = [
        "<!-- the load that holds this posture: force, then moment -->",
        "<actuator>",
        f'<general name="load" site="load"{reference} gear="{gear}" gaintype="fixed" gainprm="0" '
        'biastype="affine" biasprm="1 0 0"/>',
        "</actuator>",
    ]
    return [f'<site name="load" {parent}/>'], room, pushes


def chain_of_mujoco(result: PostureStiffness) -> bytes:
    """Write an arm or a closed chain for MuJoCo: bodies, joints with springs, closures.

    Raises
    ------
    InputError
        For elements that the file cannot describe: beams, compliant links, nonlinear springs.
    """
    elastic, springs = result.elastic, result.elastic.springs
    refused = [type(p).__name__ for p in elastic.potentials]
    if refused or not isinstance(springs, JointSprings) or springs.laws:
        raise InputError(
            "MuJoCo's file holds linear springs in joints alone, or a platform on straight lines",
            where=elastic.name,
            got=", ".join(refused or [type(springs).__name__]),
        )
    parts = links, closures, keys = parts_of_chain(result, springs)
    T = se3.pose(translation=np.multiply(result.load.at, convert_length(elastic.units, SI)[0]))
    own = next(link for link in links if link.name == "M")
    load, room, pushes = load_of_mujoco(result, _placed(own.T @ T))
    ties = [
        f"<{'weld' if tie['type'] == 'weld' else 'connect'} site1={quoteattr(tie['frames'][0])} "
        f"site2={quoteattr(tie['frames'][1])}/>"
        for tie in closures
    ]
    named = keys["springs"]
    ties += [
        f'<joint joint1={quoteattr(joint)} polycoef="0 0 0 0 0"/>'  # where its ref puts it
        for joint, spring in named.items()
        if spring["stiffness"] == "rigid"
    ]
    world = [*room, *_bodies_on("base", links, parts, (own.parent, load))]
    least = f' boundmass="{_MIN_BODY[0]}" boundinertia="{_MIN_BODY[1]}"'
    about = f"<!-- links without mass are given {_MIN_BODY[0]} kg and {_MIN_BODY[1]} kg m^2 -->"
    ends = [*(["<equality>", *ties, "</equality>"] if ties else []), *pushes]
    return _document(elastic, world, ends, least, [about])


def _document(
    elastic: ElasticMechanism,
    world: list[str],
    ends: list[str],
    compiler: str = "",
    about: Sequence[str] = (),
) -> bytes:
    """Return a MuJoCo file from the elements of the world and those after it."""
    name = re.sub(r"[^A-Za-z0-9_.-]", "_", elastic.name)
    gravity = np.zeros(3) if elastic.gravity is None else np.asarray(elastic.gravity)
    lines = [
        f'<mujoco model="{name}">',
        *about,
        f'<compiler angle="radian"{compiler}/>',
        f'<option gravity="{numbers(gravity)}"/>',
        "<worldbody>",
        *world,
        "</worldbody>",
        *ends,
        "</mujoco>",
    ]
    return ("\n".join(lines) + "\n").encode()


def _placed(T: Array) -> str:
    """Return the attributes of a frame in its parent."""
    return f'pos="{numbers(T[:3, 3])}" quat="{numbers(quaternion(T[:3, :3]))}"'


def _bodies_on(
    parent: str, links: list[Link], parts: Parts, load: tuple[str, list[str]]
) -> list[str]:
    """Return bodies and sites on a link with all their descendants, and the load's site."""
    q, named = parts[2]["q"], parts[2]["springs"]
    lines = list(load[1]) if load[0] == parent else []
    for link in links:
        if link.parent != parent:
            continue
        if link.axis is None:
            lines.append(f"<site name={quoteattr(link.name)} {_placed(link.T)}/>")
            continue
        rates = np.concatenate(
            [np.zeros(3), link.axis] if link.slides else [link.axis, np.zeros(3)]
        )
        T = link.T @ se3.exp(rates * q[link.joint])
        lines.append(f"<body name={quoteattr(link.name)} {_placed(T)}>")
        mass, centre, inertia = link.body
        if mass > 0.0:
            moments, axes = np.linalg.eigh(inertia)
            axes[:, 0] *= np.linalg.det(axes)
            lines.append(
                f'<inertial pos="{numbers(centre)}" quat="{numbers(quaternion(axes))}" '
                f'mass="{mass!r}" diaginertia="{numbers(moments)}"/>'
            )
        lines.append(_joint(link, q[link.joint], named.get(link.joint, {})))
        lines += [*_bodies_on(link.name, links, parts, load), "</body>"]
    return lines


def _joint(link: Link, q: float, spring: dict[str, Any]) -> str:
    """Return a hinge or a slide; a spring without a rest position is unloaded at the posture."""
    kind = "slide" if link.slides else "hinge"
    axis = numbers(np.asarray(link.axis))
    text = f'<joint name={quoteattr(link.joint)} type="{kind}" axis="{axis}" ref="{q!r}"'
    if np.isfinite(link.limits).all():
        text += f' limited="true" range="{numbers(np.array(link.limits))}"'
    if spring and spring["stiffness"] != "rigid":
        text += f' stiffness="{spring["stiffness"]!r}" springref="{spring.get("rest", q)!r}"'
    return text + "/>"


def mujoco_file(result: PostureStiffness) -> bytes:
    """A platform on lines as a free body on spatial tendons; chains joint by joint; in SI units."""
    elastic, posture = result.elastic, result.posture
    platform, springs = elastic.mechanism, elastic.springs
    if isinstance(platform, Chain):
        return chain_of_mujoco(result)
    if not isinstance(platform, Platform) or not isinstance(posture, PlatformPosture):
        raise InputError(
            "MuJoCo's file is of platforms on lines and of joints",
            where=elastic.name,
            got=f"kind {platform.kind}",
        )
    if type(springs) is not LineSprings or elastic.potentials or not springs.is_complete:
        more = "other springs or loads besides" if elastic.potentials else "legs that bend"
        raise InputError(
            "MuJoCo's file holds line springs alone",
            where=elastic.name,
            expected="no energy but that of straight legs",
            got=more,
        )
    if platform.struts is not None and platform.struts.mass:
        raise InputError("tendons have no mass", expected="legs without mass", where="legs.mass")
    length, force = convert_length(elastic.units, SI)
    mass, centre, about = _body(platform, length)
    if mass <= 0.0 or np.linalg.eigvalsh(about)[0] <= 0.0:
        raise UndefinedError(
            "MuJoCo needs a mass and moments of inertia of the body",
            code="no-mass",
            values={"mass": mass},
        )

    t = springs.tensions(posture.lines.lengths)
    rest = (posture.lines.lengths - t / springs.stiffness) * length
    k = springs.stiffness * force / length
    anchors, points = springs.anchors * length, springs.points * length
    sites = [f'<site name="a{i + 1}" pos="{numbers(a)}"/>' for i, a in enumerate(anchors)]
    ends = [f'<site name="b{i + 1}" pos="{numbers(b)}"/>' for i, b in enumerate(points)]
    tendons = [
        f'<spatial name="leg{i + 1}" stiffness="{float(k[i])!r}" springlength='
        f'"{"0 " if springs.cables[i] else ""}{float(rest[i])!r}">'
        f'<site site="a{i + 1}"/><site site="b{i + 1}"/></spatial>'
        for i in range(len(k))
    ]
    load, room, pushes = load_of_mujoco(
        result, f'pos="{numbers(np.array(result.load.at) * length)}"'
    )
    full = numbers(about[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]])
    world = [
        *room,
        *sites,
        f'<body name="platform" {_placed(scaled_pose(result.pose, elastic.units))}>',
        "<freejoint/>",
        f'<inertial pos="{numbers(centre)}" mass="{mass!r}" fullinertia="{full}"/>',
        *ends,
        *load,
        "</body>",
    ]
    return _document(elastic, world, ["<tendon>", *tendons, "</tendon>", *pushes])
