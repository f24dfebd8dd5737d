r"""A chain for MuJoCo: its tree as nested bodies at the posture, loops as equalities between sites.

In SI units. Every joint's reference is the posture's coordinate: the model starts there, assembled.
"""

from __future__ import annotations

import re
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np
from scipy.spatial.transform import Rotation

from cartstiff.errors import InputError
from cartstiff.geometry import se3
from cartstiff.geometry.se3 import Array
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
        *_within("base", links, parts),
        "</worldbody>",
        *(["<equality>", *ties, "</equality>"] if ties else []),
        "</mujoco>",
    ]
    return ("\n".join(lines) + "\n").encode()


def _within(parent: str, links: list[Link], parts: Parts) -> list[str]:
    """Bodies and sites on a link, with all that hangs on them."""
    q, named = parts[2]["q"], parts[2]["springs"]
    lines: list[str] = []
    for link in links:
        if link.parent != parent:
            continue
        if link.axis is None:
            at = f'pos="{numbers(link.T[:3, 3])}" quat="{numbers(quaternion(link.T[:3, :3]))}"'
            lines.append(f"<site name={quoteattr(link.name)} {at}/>")
            continue
        rates = np.concatenate(
            [np.zeros(3), link.axis] if link.slides else [link.axis, np.zeros(3)]
        )
        T = link.T @ se3.exp(rates * q[link.joint])
        lines.append(
            f'<body name={quoteattr(link.name)} pos="{numbers(T[:3, 3])}" '
            f'quat="{numbers(quaternion(T[:3, :3]))}">'
        )
        mass, centre, inertia = link.body
        if mass > 0.0:
            moments, axes = np.linalg.eigh(inertia)
            axes[:, 0] *= np.linalg.det(axes)
            lines.append(
                f'<inertial pos="{numbers(centre)}" quat="{numbers(quaternion(axes))}" '
                f'mass="{mass!r}" diaginertia="{numbers(moments)}"/>'
            )
        lines.append(_joint(link, q[link.joint], named.get(link.joint, {})))
        lines += [*_within(link.name, links, parts), "</body>"]
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
