r"""A chain for MuJoCo: its tree as nested bodies at the posture, loops as equalities between sites.

In SI units. Every joint's reference is the posture's coordinate: the model starts there, assembled.
"""

from __future__ import annotations

import re
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np
from scipy.spatial.transform import Rotation

from cartstiff import numerics
from cartstiff.errors import InputError
from cartstiff.geometry import se3
from cartstiff.geometry.se3 import Array
from cartstiff.mechanisms.contract import SI, convert_length
from cartstiff.potentials.springs import JointSprings
from cartstiff.report.exchange.geometry import Link, Parts, parts_of_chain
from cartstiff.stiffness.posture import PostureStiffness

# What MuJoCo wants of a body that moves, and a link without mass has not: kg, kg m^2.
_LEAST = "1e-6", "1e-9"


def numbers(values: Array) -> str:
    """Numbers of an attribute, all their digits."""
    return " ".join(repr(float(x)) for x in values)


def quaternion(R: Array) -> Array:
    """Of a rotation, real part first."""
    return np.roll(np.asarray(Rotation.from_matrix(R).as_quat()), 1)


def load_of_mujoco(result: PostureStiffness, parent: str) -> tuple[list[str], list[str], list[str]]:
    """The wrench that holds the posture: a site at its point, one in the room, and what pushes.

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
    if load.kind == "conservative" and np.abs(m).max() > numerics.ROUNDING * np.abs(W).max():
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
    """An arm, or a closed chain such as legs by name: bodies, joints with springs, closures.

    Raises
    ------
    InputError
        For what the file cannot say: beams, links that give, springs by other laws.
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
    gravity = np.zeros(3) if elastic.gravity is None else np.asarray(elastic.gravity)
    name = re.sub(r"[^A-Za-z0-9_.-]", "_", elastic.name)
    ties = [
        f"<{'weld' if tie['type'] == 'weld' else 'connect'} site1={quoteattr(tie['frames'][0])} "
        f"site2={quoteattr(tie['frames'][1])}/>"
        for tie in closures
    ]
    q, named = keys["q"], keys["springs"]
    ties += [
        f'<joint joint1={quoteattr(joint)} polycoef="{q[joint]!r} 0 0 0 0"/>'
        for joint, spring in named.items()
        if spring["stiffness"] == "rigid"
    ]
    lines = [
        f'<mujoco model="{name}">',
        f"<!-- links without mass are given {_LEAST[0]} kg and {_LEAST[1]} kg m^2 -->",
        f'<compiler angle="radian" boundmass="{_LEAST[0]}" boundinertia="{_LEAST[1]}"/>',
        f'<option gravity="{numbers(gravity)}"/>',
        "<worldbody>",
        *room,
        *_within("base", links, parts, (own.parent, load)),
        "</worldbody>",
        *(["<equality>", *ties, "</equality>"] if ties else []),
        *pushes,
        "</mujoco>",
    ]
    return ("\n".join(lines) + "\n").encode()


def _placed(T: Array) -> str:
    """Attributes of a frame in its parent."""
    return f'pos="{numbers(T[:3, 3])}" quat="{numbers(quaternion(T[:3, :3]))}"'


def _within(parent: str, links: list[Link], parts: Parts, load: tuple[str, list[str]]) -> list[str]:
    """Bodies and sites on a link, with all that hangs on them; the load's site on its link."""
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
        lines += [*_within(link.name, links, parts, load), "</body>"]
    return lines


def _joint(link: Link, q: float, spring: dict[str, Any]) -> str:
    """A hinge or a slide; a spring without a rest position is unloaded at the posture."""
    kind = "slide" if link.slides else "hinge"
    axis = numbers(np.asarray(link.axis))
    text = f'<joint name={quoteattr(link.joint)} type="{kind}" axis="{axis}" ref="{q!r}"'
    if np.isfinite(link.limits).all():
        text += f' limited="true" range="{numbers(np.array(link.limits))}"'
    if spring and spring["stiffness"] != "rigid":
        text += f' stiffness="{spring["stiffness"]!r}" springref="{spring.get("rest", q)!r}"'
    return text + "/>"
