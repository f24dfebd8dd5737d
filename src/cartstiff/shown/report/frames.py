"""Frames of a mechanism as a tree, with joints, limits, springs and masses."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from cartstiff.core.arrays import plain
from cartstiff.core.described import described
from cartstiff.core.geometry import se3
from cartstiff.core.mechanisms.chain import Chain
from cartstiff.core.mechanisms.contract import Mechanism
from cartstiff.core.mechanisms.elastic import ElasticMechanism
from cartstiff.core.mechanisms.gravity_loads import gravity_loads
from cartstiff.core.potentials.springs import Springs
from cartstiff.core.units import Units
from cartstiff.shown.report.layout import (
    body_frame,
    lengths,
    number,
    placed,
    vector,
)


def frames_of(elastic: ElasticMechanism) -> dict[str, Any]:
    """Return the object printed by ``cartstiff frames --json``.

    Returns
    -------
    dict
        "frames" fixed to F; "joints" in the order of the tree, each with its parent (the
        name of a joint, or None for F), its coordinate, spring, mass and the frames fixed
        to it; "closures" that tie frames; "legs" of a platform; "pose" of M in F at the
        posture; "gravity"; see `cartstiff.extend.json_schema`.
    """
    mechanism = elastic.mechanism
    answer: dict[str, Any] = {
        "mechanism": {"name": elastic.name, "kind": mechanism.kind},
        "frames": ["world"],
        "joints": [],
        "closures": [],
        "legs": [],
        "payload": mechanism.masses().get("payload"),
        "pose": elastic.mechanism.at(elastic.q).pose,
    }
    if isinstance(mechanism, Chain):
        answer["joints"] = _joints(elastic, mechanism)
        answer["frames"] = _frames_on(mechanism, 0)
        answer["closures"] = [
            {"frames": [c.frame_a, c.frame_b], "type": c.type} for c in mechanism.closures
        ]
    if mechanism.coordinates_are_pose:
        answer["joints"] = [_body(mechanism)]
    if len(mechanism.points) and elastic.springs is not None:
        answer["legs"] = _legs(mechanism, elastic.springs)
    gravity = gravity_loads(elastic).to_dict()
    return described("frames", answer, elastic.about(), gravity, elastic)


def _frames_on(chain: Chain, joint: int) -> list[str]:
    """Frames of the file that are fixed to a joint."""
    frames = chain.tree.frames
    return [name for name in chain.frames[1:] if frames[name].joint == joint]


def _joints(elastic: ElasticMechanism, chain: Chain) -> list[dict[str, Any]]:
    tree, model = chain.tree, chain.tree.model
    masses, _ = tree.masses()
    names = [str(name) for name in model.names]
    actuated = chain.actuated
    joints: list[dict[str, Any]] = []
    for j in range(1, model.njoints):
        parent = int(model.parents[j])
        k = j - 1
        follows = None
        if tree.mimic is not None:
            k = int(np.argmax(np.abs(tree.mimic[j - 1])))
            if tree.coordinates[k].name != names[j]:
                follows = tree.coordinates[k].name
            if follows is not None and k in chain.virtual:
                # A mass in the middle of a compliant link is listed at the link's first
                # joint.
                link = follows.rpartition(".")[0] + "."
                next(x for x in joints if x["name"].startswith(link))["mass"] += float(
                    masses[j - 1]
                )
                continue
        coordinate, slides = tree.coordinates[k], model.joints[j].shortname()
        joint: dict[str, Any] = {
            "name": names[j],
            "parent": (parent and names[parent]) or None,
            "type": ("revolute", "prismatic")[slides.startswith("JointModelP")],
            **dict.fromkeys(("lower", "upper", "q", "spring")),
            "follows": follows,
            "actuated": None,
            "virtual": follows is None and k in chain.virtual,
            "mass": float(masses[j - 1]),
            "frames": _frames_on(chain, j),
            "carries_body": chain.body.joint == j,
        }
        if actuated is not None:
            joint["actuated"] = follows is None and k in actuated
        if follows is None:
            joint |= {
                "type": coordinate.type,
                "lower": plain(coordinate.lower),
                "upper": plain(coordinate.upper),
                "q": float(elastic.q[k]),
                "spring": _spring(elastic, k),
            }
        joints.append(joint)
    return joints


def _spring(elastic: ElasticMechanism, k: int) -> dict[str, Any] | None:
    """Spring of a coordinate; None for a passive joint."""
    springs = elastic.springs
    if springs is None:
        return None
    if k in springs.rigid:
        return {"stiffness": None, "rest": None, "law": False, "rigid": True}
    if springs.has_coordinate(len(elastic.names))[k]:
        rest, law = plain(springs.rest[k]), k in springs.laws
        stiffness = {False: float(springs.stiffness[k])}.get(law)
        return {"stiffness": stiffness, "rest": rest, "law": law, "rigid": False}
    return None


def _body(platform: Mechanism) -> dict[str, Any]:
    return {
        "name": "body",
        "parent": None,
        "type": "free",
        "lower": None,
        "upper": None,
        "q": None,
        "spring": None,
        "follows": None,
        "actuated": None,
        "virtual": False,
        "mass": float(sum(platform.masses().values())),
        "frames": ["body", platform.frame],
        "carries_body": True,
    }


def _legs(mechanism: Mechanism, springs: Springs) -> list[dict[str, Any]]:
    limits = list(mechanism.bounds.values()) or [(0.0, np.inf)] * len(springs.stiffness)
    preload = [None] * len(springs.stiffness)
    if springs.preload is not None:
        preload = plain(springs.preload)
    (frame_a, anchors), (frame_b, points) = springs.attachments()
    return [
        {
            "name": f"leg{i + 1}",
            "frames": [frame_a, frame_b],
            "from": anchors[i].tolist(),
            "to": points[i].tolist(),
            "stiffness": float(k),
            "rest": plain(springs.rest[i]),
            "preload": preload[i],
            "shortest": plain(limits[i][0]),
            "longest": plain(limits[i][1]),
        }
        for i, k in enumerate(springs.stiffness)
    ]


def describe_frames(answer: Mapping[str, Any], units: Units, length: float) -> str:
    """Describe the answer of ``cartstiff frames``.

    Round-off of a length is shown as 0.
    """
    mechanism, joints = answer["mechanism"], answer["joints"]
    lines = [
        f"{mechanism['name']}: {mechanism['kind']}, {body_frame(answer, units)}, "
        f"its file in {units.length} and {units.force}, masses in kg",
        "",
        f"F: {', '.join(answer['frames'])}",
    ]

    # Joints as a tree, the frames of each link below its joint.
    def below(parent: str | None, indent: str) -> None:
        children = [j for j in joints if j["parent"] == parent]
        for i, joint in enumerate(children):
            branch, stem = (("├─", "│  "), ("└─", "   "))[i == len(children) - 1]
            lines.append(f"{indent}{branch} {_joint_words(joint, units)}")
            deeper = indent + stem
            if joint["frames"]:
                own = "M on " * joint["carries_body"]
                has_children = any(j["parent"] == joint["name"] for j in joints)
                names = f"{own}{', '.join(joint['frames'])}"
                lines.append(f"{deeper}{' │'[has_children]}  {names}")
            below(joint["name"], deeper)

    below(None, "")
    # What is no tree: legs and closures.
    if answer["legs"]:
        lines += ["", "Legs, from feet in F to heads in M"]
        lines += [_leg_words(leg, units) for leg in answer["legs"]]
    if answer["closures"]:
        lines += ["", "Closures"]
        lines += [
            f"  {c['type']}: {c['frames'][0]} = {c['frames'][1]}"
            for c in answer["closures"]
        ]
    # Where the body and the base are, and what they weigh.
    pose = np.array(answer["pose"])
    turned = np.degrees(se3.roll_pitch_yaw(pose))
    base, gravity = placed(np.array(answer["base_pose"]), units), "none"
    if answer["gravity"] is not None:
        gravity = f"{vector(answer['gravity'], 6)} m/s^2"
    lines += [
        "",
        *[f"The robot's base B {base} in F"] * bool(base),
        f"M at {vector(lengths(pose[:3, 3], units), 6, length * units.shown_per_length)} "
        f"{units.shown_length} in F, roll, pitch, yaw "
        f"{vector(turned, 6, 1.0)} deg",
        f"Gravity: {gravity}",
    ]
    if answer["payload"]:
        lines.append(f"Payload: {answer['payload']:.6g} kg")
    return "\n".join(lines)


def _range(low: float | None, high: float | None, size: float = 1.0) -> str:
    ends = [
        size * float(end if x is None else x) for x, end in ((low, "-inf"), (high, "inf"))
    ]
    return f"[{ends[0]:.6g}, {ends[1]:.6g}]"


def _joint_words(joint: Mapping[str, Any], units: Units) -> str:
    words = [f"{joint['name']}: {joint['type']}"]
    turns = joint["type"] != "prismatic"
    shown, size = units.shown_length, units.shown_per_length
    if turns:
        shown, size = units.shown_angle, units.shown_per_radian
    if joint["follows"] is not None:
        words.append(f"follows {joint['follows']}")
    elif joint["q"] is not None:
        words.append(f"{_range(joint['lower'], joint['upper'], size)} {shown}")
        words.append(f"q {round(joint['q'] * size, 10) + 0.0:.6g}")
        if not joint["virtual"]:
            words.append(_spring_words(joint["spring"], units, turns, size))
    if joint["actuated"]:
        words.append("actuated")
    if joint["virtual"]:
        words.append("of a compliant link")
    if joint["mass"]:
        words.append(f"{joint['mass']:.6g} kg")
    return ", ".join(words)


def _spring_words(
    spring: Mapping[str, Any] | None, units: Units, turns: bool, size: float
) -> str:
    if spring is None:
        return "passive"
    if spring["rigid"]:
        return "rigid"
    if spring["law"]:
        return "nonlinear spring"
    unit, per = units.stiffness["rotation"], 1.0
    if not turns:
        unit, per = f"{units.force}/{units.shown_length}", 1.0 / units.shown_per_length
    words = f"{per * spring['stiffness']:.6g} {unit}"
    if spring["rest"] is not None:
        words += f" at rest at {spring['rest'] * size:.6g}"
    return words


def _leg_words(leg: Mapping[str, Any], units: Units) -> str:
    unit, per = units.shown_length, units.shown_per_length
    ends = [", ".join(f"{per * x:.4g}" for x in leg[key]) for key in ("from", "to")]
    words = [f"{leg['stiffness'] / per:.6g} {units.force}/{unit}"]
    if leg["rest"] is not None:
        words.append(f"rest length {number(per * leg['rest'], 6)} {unit}")
    if leg["preload"] is not None:
        words.append(f"preload {leg['preload']:.6g} {units.force}")
    if leg["longest"] is not None:
        words.append(f"{_range(leg['shortest'], leg['longest'], per)} {unit}")
    return f"  {leg['name']}: ({ends[0]}) to ({ends[1]}) {unit}, {', '.join(words)}"
