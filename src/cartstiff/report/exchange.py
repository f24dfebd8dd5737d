"""Export of a posture to other programs: Nastran, MuJoCo, URDF with closures, a table.

Finite-element programs take one symmetric matrix of a node to the ground, with rows and columns
(translation, rotation): K^B about the body frame's origin, here along the axes of F. The
antisymmetric part of the tangent under a load follows from the load, which a comment states. A
body's mass is in the unit that follows from those of length, force and second.

URDF describes only trees. A mechanism file of the same name beside it closes the loops: closures,
drives, springs and the posture, as `cartstiff.load` reads them. Both are in SI units. So is
MuJoCo's file, in which every joint's reference is the posture's coordinate: the model starts
assembled at the posture.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np

from cartstiff import numerics
from cartstiff.arrays import Array, csv_rows, plain
from cartstiff.errors import InputError, UndefinedError, joined
from cartstiff.geometry import se3
from cartstiff.mechanisms.chain import Chain
from cartstiff.mechanisms.contract import SI, Units, convert_length
from cartstiff.mechanisms.elastic import ElasticMechanism
from cartstiff.mechanisms.platform import Platform, PlatformPosture, Struts
from cartstiff.potentials.line_springs import LineSprings
from cartstiff.potentials.springs import JointSprings
from cartstiff.stiffness.posture import PostureStiffness

_X, _Y, _Z = np.eye(3)
# Limit of slides without limits [m], since URDF requires one.
_UNLIMITED_SLIDE = 1e6


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

    def xml(self) -> str:
        """Link and joint."""
        name, (mass, centre, I) = quoteattr(self.name), self.body  # noqa: E741
        link = f"  <link name={name}/>"
        if mass > 0.0:
            moments = " ".join(
                f'i{a}{b}="{float(I[i, j])!r}"'
                for (i, a), (j, b) in ((p, q) for p in enumerate("xyz") for q in enumerate("xyz"))
                if i <= j
            )
            link = (
                f'  <link name={name}><inertial><origin xyz="{numbers(centre)}"/>'
                f'<mass value="{mass!r}"/><inertia {moments}/></inertial></link>'
            )
        kind, more = "fixed", ""
        if self.axis is not None:
            low, high = np.clip(self.limits, -_UNLIMITED_SLIDE, _UNLIMITED_SLIDE).tolist()
            kind = "prismatic" if self.slides else "revolute"
            more = (
                f'<axis xyz="{numbers(self.axis)}"/><limit lower="{low!r}" upper="{high!r}" '
                'effort="0" velocity="0"/>'
            )
            if not self.slides and not np.isfinite(self.limits).all():
                kind, more = "continuous", more.partition("<limit")[0]
        rpy = numbers(se3.roll_pitch_yaw(self.T))
        at = f'xyz="{numbers(self.T[:3, 3])}" rpy="{rpy}"'
        return (
            f'{link}\n  <joint name={quoteattr(self.joint or "to " + self.name)} type="{kind}">'
            f"<parent link={quoteattr(self.parent)}/><child link={name}/><origin {at}/>{more}"
            "</joint>"
        )


def urdf_with_closures(result: PostureStiffness, name: str) -> tuple[bytes, bytes]:
    """Return a URDF file, and the mechanism file that refers to it as `name` and closes its loops.

    Raises
    ------
    InputError
        For elements that these files cannot describe: cables, legs that bend, compliant links,
        nonlinear springs.
    """
    elastic = result.elastic
    refused = [type(p).__name__ for p in elastic.potentials]
    springs = elastic.springs
    if type(springs) is LineSprings and not springs.unilateral and not refused:
        links, closures, keys = _of_platform(result, springs)
    elif isinstance(springs, JointSprings) and not springs.laws and not refused:
        links, closures, keys = parts_of_chain(result, springs)
    else:
        what = refused or [type(springs).__name__]
        raise InputError(
            "URDF with closures holds linear springs in joints alone, or straight legs that push "
            "and pull",
            where=elastic.name,
            got=", ".join(what),
        )
    if elastic.gravity is not None:
        keys["gravity"] = np.asarray(elastic.gravity).tolist()
    kind = "closed-chain" if closures else "serial"
    if not closures:
        keys.pop("actuated", None)
    B = scaled_pose(elastic.mechanism.base_pose, elastic.units)
    if kind == "serial" and not np.array_equal(B, np.eye(4)):
        back = se3.inverse(B)
        links = [replace(x, T=back @ x.T) if x.parent == "base" else x for x in links]
        keys["base"] = {"xyz": B[:3, 3].tolist(), "rpy": se3.roll_pitch_yaw(B).tolist()}
    head = {"kind": kind, "name": elastic.name, "model": name, "frame": "M"}
    rows = [f"{key}: {json.dumps(value)}" for key, value in (head | keys).items()]
    rows += ["closures:"] * bool(closures) + [f"  - {json.dumps(c)}" for c in closures]
    xml = [
        '<?xml version="1.0"?>',
        f"<robot name={quoteattr(elastic.name)}>",
        '  <link name="base"/>',
        *(link.xml() for link in links),
        "</robot>",
    ]
    return ("\n".join(xml) + "\n").encode(), ("\n".join(rows) + "\n").encode()


Parts = tuple[list[Link], list[dict[str, Any]], dict[str, Any]]


def _of_platform(result: PostureStiffness, springs: LineSprings) -> Parts:
    """Model legs as two hinges and a slide; the platform is a child of the first leg."""
    posture, platform = result.posture, result.elastic.mechanism
    if not isinstance(platform, Platform) or not isinstance(posture, PlatformPosture):
        raise TypeError("a platform")
    length, force = convert_length(result.elastic.units, SI)
    T, lines = scaled_pose(posture.pose, result.elastic.units), posture.lines
    links: list[Link] = []
    closures: list[dict[str, Any]] = []
    limits = np.tile([0.0, np.inf], (len(lines.lengths), 1))
    if platform.limits is not None:
        limits = platform.limits
    named: dict[str, dict[str, float]] = {}
    for i, L in enumerate((length * lines.lengths).tolist()):
        z = T[:3, :3] @ lines.directions[i]
        x = np.linalg.svd(z[None])[2][1]
        foot = se3.pose(np.column_stack([x, np.cross(z, x), z]), length * platform.anchors[i])
        leg = f"leg{i + 1}"
        low, high = (length * limits[i] - L).tolist()
        links += [
            Link(f"{leg} cross", "base", foot, _X, joint=f"{leg}_u1"),
            Link(
                f"{leg} tube",
                f"{leg} cross",
                np.eye(4),
                _Y,
                joint=f"{leg}_u2",
                body=_bar(platform.struts, i, length, fixed=True),
            ),
            Link(
                f"{leg} rod",
                f"{leg} tube",
                se3.pose(translation=[0, 0, L]),
                _Z,
                True,
                (low, high),
                leg,
                _bar(platform.struts, i, length, fixed=False),
            ),
        ]
        named[leg] = {"stiffness": float(springs.stiffness[i] * force / length)}
        if springs.is_complete:
            rest = lines.lengths[i] - springs.tensions(lines.lengths)[i] / springs.stiffness[i]
            named[leg]["rest"] = float(rest * length - L)
        head = se3.pose(translation=length * platform.points[i])
        if i == 0:
            end = se3.pose(foot[:3, :3], T[:3, :3] @ head[:3, 3] + T[:3, 3])
            links += [
                Link("ball x", f"{leg} rod", np.eye(4), _X, joint="ball_x"),
                Link("ball y", "ball x", np.eye(4), _Y, joint="ball_y"),
                Link("ball z", "ball y", np.eye(4), _Z, joint="ball_z"),
                Link("M", "ball z", se3.inverse(end) @ T, body=_body(platform, length)),
            ]
        else:
            points = [head[:3, 3].tolist(), [0.0, 0.0, 0.0]]
            closures.append({"frames": ["M", f"{leg} rod"], "type": "point", "points": points})
    return links, closures, {"actuated": list(named), "springs": named}


def _body(platform: Platform, length: float) -> tuple[float, Array, Array]:
    """Return the body's mass, its centre in M, and the inertia about it, with lengths in metres."""
    arm = se3.skew(platform.mass_centre)
    about = platform.body_inertia[:3, :3] + platform.mass * arm @ arm
    return platform.mass, length * platform.mass_centre, length**2 * about


def _bar(struts: Struts | None, i: int, length: float, fixed: bool) -> tuple[float, Array, Array]:
    """Return a bar of leg i: mass, centre on the leg's axis z, inertia, with none about z."""
    if struts is None:
        return 0.0, np.zeros(3), np.zeros((3, 3))
    mass, com = (struts.fixed, struts.fixed_com) if fixed else (struts.moving, -struts.moving_com)
    about = length**2 * float(mass[i] * (com[i] ** 2 / 3 + struts.radius[i] ** 2 / 4))
    return float(mass[i]), length * com[i] * _Z, about * np.diag([1.0, 1.0, 0.0])


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


def legs_of_nastran(result: PostureStiffness) -> bytes:
    """Write a platform's legs as springs (CBUSH) between grid points, the body rigid (RBE2).

    The bulk data have no load and are included like those of the matrices.

    Raises
    ------
    InputError
        For other mechanisms, cables, and legs that bend.
    """
    platform, springs, posture = result.elastic.mechanism, result.elastic.springs, result.posture
    if (
        not isinstance(platform, Platform)
        or not isinstance(posture, PlatformPosture)
        or type(springs) is not LineSprings
        or springs.unilateral
    ):
        is_platform = isinstance(platform, Platform)
        got = "cables or legs that bend" if is_platform else f"kind {platform.kind}"
        raise InputError(
            "springs of Nastran are written of straight legs that push and pull",
            where=result.elastic.name,
            got=got,
        )
    m, units = len(springs.stiffness), result.elastic.units
    ends = posture.pose[:3, 3] + platform.points @ posture.pose[:3, :3].T
    heads = ", ".join(str(i) for i in range(m + 1, 2 * m + 1))
    lines = [
        f"$ legs of a platform as springs, without what their tensions add: {units.force}, "
        f"{units.length}",
        f"$ grid points 1 to {m} on the ground, {m + 1} to {2 * m} on the body, {2 * m + 1} is M",
    ]
    places = np.vstack([platform.anchors, ends, posture.pose[:3, 3]])
    for i, place in enumerate(places.tolist()):
        x, y, z = (large_field(v) for v in place)
        held = "123456" if i < m else ""
        lines += [f"GRID*   {i + 1:>16}{'':16}{x}{y}", f"*       {z}{'':16}{held:>16}"]
    for i, k in enumerate(springs.stiffness):
        lines += [
            f"PBUSH*  {i + 1:>16}{'K':<16}{large_field(k)}",
            "*",
            f"CBUSH   {i + 1:>8}{i + 1:>8}{i + 1:>8}{m + i + 1:>8}",
        ]
    return ("\n".join([*lines, *_rigid(m, heads)]) + "\n").encode()


def _rigid(m: int, heads: str) -> Iterator[str]:
    """Yield the lines of an RBE2 from M to the legs' heads, with eight fields each."""
    fields = [str(m + 1), str(2 * m + 1), "123456", *heads.split(", ")]
    for first in range(0, len(fields), 8):
        name = "RBE2    " if first == 0 else "        "
        yield name + "".join(f"{f:>8}" for f in fields[first : first + 8])


def large_field(x: float) -> str:
    """Format a number in sixteen characters, with as many digits as they hold."""
    for digits in range(12, 5, -1):
        mantissa, exponent = f"{x:.{digits}E}".split("E")
        short = f"{mantissa}{int(exponent):+d}"
        if len(short) <= 16:
            break
    return f"{short:>16}"


def geometry_csv(result: PostureStiffness) -> bytes:
    """A row a leg, or a joint: where it is at the posture, in F, its stiffness and its limits."""
    elastic, posture = result.elastic, result.posture
    unit, of = elastic.units.length, elastic.units.stiffness
    if isinstance(posture, PlatformPosture):
        platform = elastic.mechanism
        if not isinstance(platform, Platform) or not isinstance(elastic.springs, LineSprings):
            raise TypeError("a platform on lines")
        heads = posture.pose[:3, 3] + platform.points @ posture.pose[:3, :3].T
        limits = np.tile([np.nan, np.nan], (len(heads), 1))
        if platform.limits is not None:
            limits = platform.limits
        names = [f"{end}_{a} [{unit}]" for end in ("foot", "head", "head_in_M") for a in "xyz"]
        names = ["leg", *names, f"length [{unit}]", f"stiffness [{of['translation']}]"]
        names += [f"shortest [{unit}]", f"longest [{unit}]"]
        rows = np.column_stack(
            [
                platform.anchors,
                heads,
                platform.points,
                posture.lines.lengths,
                elastic.springs.stiffness,
                limits,
            ]
        )
        cells = ([f"leg{i + 1}", *plain(row)] for i, row in enumerate(rows))
        return csv_rows(names, cells).encode()
    chain, springs = elastic.mechanism, elastic.springs
    if not isinstance(chain, Chain):
        raise InputError("a table of geometry is of platforms and of joints", got=chain.kind)
    places = chain.tree.at(posture.q).joint_poses(list(range(1, chain.tree.model.njoints)))
    screws = chain.tree.screws()
    stiffness: list[object] = [None] * len(posture.q)
    if isinstance(springs, JointSprings):
        stiffness = ["rigid" if k == np.inf else k for k in elastic.stiffnesses]
        for j in springs.laws:  # a nonlinear spring has no single one
            stiffness[j] = None
    names = ["joint", "type", *(f"{a} [{unit}]" for a in "xyz"), *(f"axis_{a}" for a in "xyz")]
    names += [
        f"position [rad or {unit}]",
        f"lower [rad or {unit}]",
        f"upper [rad or {unit}]",
        f"stiffness [{of['rotation']} or {of['translation']}]",
    ]
    table = []
    for i, c in enumerate(chain.coordinates[: len(places)]):
        axis = places[i][:3, :3] @ (screws[i, 3:] if c.is_length else screws[i, :3])
        row = [*places[i][:3, 3], *axis, posture.q[i], c.lower, c.upper]
        table.append([c.name, c.type, *plain(np.array(row)), stiffness[i]])
    return csv_rows(names, table).encode()


# Mass [kg] and inertia [kg m^2] of massless links, since MuJoCo requires them of moving bodies.
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


def exchanged(result: PostureStiffness, ending: str) -> bytes:
    """Return the contents of a file with an ending of `EXCHANGE` for a posture.

    Raises
    ------
    UndefinedError
        If there is no stiffness to write.
    InputError
        For a mechanism that the program cannot represent.
    """
    return EXCHANGE[ending](result)


def _stiffness(result: PostureStiffness) -> Array:
    """K^B (6, 6), linear first, along the axes of F."""
    K = result.matrices["B"]
    if K is None:
        raise result.reduction.undefined()
    return _in_room(result, 0.5 * (K + K.T))


def _in_room(result: PostureStiffness, K: Array) -> Array:
    K = se3.to_linear_angular(se3.to_linear_angular(K, 0), 1)
    turned = np.kron(np.eye(2), result.pose[:3, :3])
    in_room = turned @ K @ turned.T
    size = np.sqrt(np.abs(np.diag(in_room)))
    noise = np.abs(in_room) <= numerics.ROUNDOFF * np.outer(size, size)
    return np.where(noise, 0.0, 0.5 * (in_room + in_room.T))


def _mass(result: PostureStiffness) -> Array | None:
    """Mass matrix (6, 6) of a platform, as `_stiffness`, in the units of K times s^2."""
    posture = result.posture
    if not isinstance(posture, PlatformPosture):
        return None
    mass = posture.mass_matrix()
    if not mass.any():
        return None
    return _in_room(result, mass * result.elastic.units.kilogram)


def _header_lines(result: PostureStiffness) -> list[str]:
    """Return the comment at the head of a file: mechanism, units, axes and wrench."""
    units = result.elastic.units
    lines = [
        f"{result.elastic.name}: stiffness of {result.elastic.mechanism.frame} to the ground",
        f"units {units.force}, {units.length}, s; rad",
        "rows and columns: translation x y z, rotation x y z of the node, along the axes of F",
    ]
    if result.wrench is not None and np.any(result.wrench):
        load = ", ".join(f"{x:.6g}" for x in result.wrench)
        lines.append(f"under the wrench (moment, force; body axes) {load}: K^B, the symmetric part")
    # A line break in a name would end the comment.
    return [joined([line]).encode("ascii", "replace").decode() for line in lines]


def _nastran(result: PostureStiffness) -> bytes:
    """A grid point with its matrices as direct input (DMIG), in large fields."""

    def matrix(name: str, K: Array) -> list[str]:
        lines = [f"DMIG    {name:<8}{0:>8}{6:>8}{2:>8}{0:>8}"]
        for j in range(6):
            entries = [(i + 1, float(K[i, j])) for i in range(j, 6) if K[i, j] != 0.0]
            if entries:
                lines.append(f"{'DMIG*':<8}{name:<16}{1:>16}{j + 1:>16}{'':16}")
                lines += [f"{'*':<8}{1:>16}{i:>16}{large_field(x)}{'':16}" for i, x in entries]
        return lines

    mass = _mass(result)
    x, y, z = map(large_field, result.pose[:3, 3])
    lines = [
        *[f"$ {line}" for line in _header_lines(result)],
        "$ in case control: K2GG=KBODY" + ("" if mass is None else ", M2GG=MBODY"),
        f"{'GRID*':<8}{1:>16}{'':16}{x}{y}",
        f"{'*':<8}{z}",
        *matrix("KBODY", _stiffness(result)),
        *([] if mass is None else matrix("MBODY", mass)),
    ]
    return ("\n".join(line.rstrip() for line in lines) + "\n").encode()


def _mujoco(result: PostureStiffness) -> bytes:
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


#: Writers by the ending of the file.
EXCHANGE: dict[str, Callable[[PostureStiffness], bytes]] = {
    ".nas": _nastran,
    ".bdf": _nastran,
    ".xml": _mujoco,
    ".dat": legs_of_nastran,
    ".csv": geometry_csv,
}
