"""What a page must know of a mechanism before the first posture: sliders, springs, words."""

from __future__ import annotations

from typing import Any

import numpy as np

from cartstiff.arrays import plain
from cartstiff.geometry.se3 import Array
from cartstiff.matrix_names import MATRICES
from cartstiff.mechanisms.chain import Chain
from cartstiff.mechanisms.contract import Coordinate
from cartstiff.mechanisms.elastic import ElasticMechanism, gravity_loads
from cartstiff.mechanisms.platform import Platform
from cartstiff.potentials.line_springs import LineSprings
from cartstiff.statics.command import drives

# Half-ranges of coordinates without limits: angles of a platform, angles of a joint, and lengths
# as a share of the mechanism's size.
_TILT = np.pi / 6
_TURN = np.pi
_SHARE = 0.25


def describe_mechanism(elastic: ElasticMechanism, q: Array, frames: bool = True) -> dict[str, Any]:
    """Names, units, ranges and springs.

    Parameters
    ----------
    elastic : ElasticMechanism
        The mechanism.
    q : ndarray (n,)
        The posture around which coordinates without limits are ranged.
    frames : bool
        Whether other frames of interest may be chosen.
    """
    mechanism, units = elastic.mechanism, elastic.units
    ranges = slider_ranges(elastic, q)
    springs = elastic.springs
    lines = isinstance(springs, LineSprings)
    coordinates = [
        {
            "name": c.name,
            "is_length": c.is_length,
            "unit": units.coordinate(c.is_length),
            "lower": lower,
            "upper": upper,
            "limited": bool(np.isfinite(c.lower) and np.isfinite(c.upper)),
        }
        for c, (lower, upper) in zip(mechanism.coordinates, ranges, strict=True)
    ]
    stiffness = [] if springs is None else np.asarray(springs.stiffness, float).tolist()
    stiffness = [np.inf if i in mechanism.rigid else k for i, k in enumerate(stiffness)]
    spring_units = [
        units.spring(lines or bool(c["is_length"]))
        for c in (coordinates if not lines else [{}] * len(stiffness))
    ]
    driven = () if springs is None else drives(elastic)
    return {
        "name": elastic.name,
        "kind": mechanism.kind,
        "frame": mechanism.frame,
        "frames": _frames(elastic) if frames else [mechanism.frame],
        "units": units.as_dict(),
        "coordinates": coordinates,
        "joints": _joints(elastic),
        "axes": _axes(elastic),
        "sliders": slider_coordinates(elastic),
        "springs": [
            {"name": name, "stiffness": plain(k), "unit": unit, "driven": name in driven}
            for name, k, unit in zip(elastic.spring_names, stiffness, spring_units, strict=False)
        ],
        "takes_load": springs is not None,
        "may_be_loaded": elastic.may_be_loaded,
        "source": elastic.source,
        "weighed": gravity_loads(elastic).text,
        "gravity": None if elastic.gravity is None else elastic.gravity.tolist(),
        "size": float(mechanism.at(q).length),
        "platform": isinstance(mechanism, Platform),
        "connections": [
            {"name": name, "title": matrix.name, "meaning": matrix.sentence}
            for name, matrix in MATRICES.items()
        ],
    }


def _frames(elastic: ElasticMechanism) -> list[str]:
    mechanism = elastic.mechanism
    if not isinstance(mechanism, Chain) or mechanism.kind not in ("serial", "closed-chain"):
        return [mechanism.frame]
    # Those that move with the same joint: for them the chain, its joints and springs are the same.
    joint = mechanism.body.joint
    names = [name for name, place in mechanism.tree.frames.items() if place.joint == joint]
    return names if mechanism.frame in names else [mechanism.frame, *names]


def _joints(elastic: ElasticMechanism) -> list[int]:
    """The coordinate that moves each joint of the tree."""
    mechanism = elastic.mechanism
    if not isinstance(mechanism, Chain):
        return []
    mimic = mechanism.tree.mimic
    if mimic is None:
        return list(range(len(mechanism.coordinates)))
    return np.abs(mimic).argmax(axis=1).tolist()


def _axes(elastic: ElasticMechanism) -> list[list[float]]:
    """The line along or about which each joint of the tree moves, in the joint's own frame."""
    mechanism = elastic.mechanism
    if not isinstance(mechanism, Chain):
        return []
    screws = mechanism.tree.screws()
    return [(s[:3] if s[:3].any() else s[3:]).tolist() for s in screws]


def slider_coordinates(elastic: ElasticMechanism) -> list[int]:
    """Coordinates that a user moves: all of an open chain, the motors of a closed one.

    Where a closed chain names no motors, those with a spring; the closures move the others.
    """
    mechanism = elastic.mechanism
    every = list(range(len(mechanism.coordinates)))
    if not isinstance(mechanism, Chain):
        return every
    if mechanism.actuated is not None:
        return list(mechanism.actuated)
    if not mechanism.closures or elastic.springs is None:
        return [i for i in every if i not in mechanism.held]  # not the links that give
    stiff = np.asarray(elastic.springs.stiffness) > 0
    return [i for i in every if i < len(stiff) and stiff[i] and i not in mechanism.held] or every


def slider_ranges(elastic: ElasticMechanism, q: Array) -> list[tuple[float, float]]:
    """Ends of every slider: the limits, and a range about q where there are none."""
    mechanism = elastic.mechanism
    size = mechanism.at(q).length
    is_platform = False
    if isinstance(mechanism, Platform):
        is_platform, size = True, float(np.mean(mechanism.leg_lengths(q)))
    pairs = zip(mechanism.coordinates, q, strict=True)
    return [_range(c, float(x), size, is_platform) for c, x in pairs]


def _range(coordinate: Coordinate, x: float, size: float, is_platform: bool) -> tuple[float, float]:
    half = _SHARE * size if coordinate.is_length else _TILT if is_platform else _TURN
    centre = x if coordinate.is_length or is_platform else 0.0
    lower = coordinate.lower if np.isfinite(coordinate.lower) else min(centre - half, x)
    upper = coordinate.upper if np.isfinite(coordinate.upper) else max(centre + half, x)
    return float(lower), float(upper)
