"""The numbers of struts between flexures as parameters, and such struts with other numbers.

"stiffness.<leg>" is that of a strut's own spring, "stiffness.lower.bending" and so on are those of
the flexures at one end of all struts, which are equal, and "offset.lower", "offset.upper" their
places. Rigid parts have no number. A compliant base or platform has a factor on its spring, 1 by
default.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from cartstiff.arrays import Array
from cartstiff.geometry import se3
from cartstiff.potentials.flexure_struts import Flexure, FlexureStruts
from cartstiff.potentials.mounted_struts import Mount, MountedStruts

_ENDS = ("lower", "upper")


def strut_numbers(struts: FlexureStruts, legs: Sequence[str]) -> dict[str, float]:
    """All numbers of struts named `legs`."""
    numbers = {
        f"stiffness.{leg}": float(k) for leg, k in zip(legs, struts.slides, strict=True)
    }
    for end in _ENDS:
        flexure: Flexure = getattr(struts, end)
        numbers |= {_name(end, word): x for word, x in flexure._asdict().items()}
    numbers |= dict.fromkeys(_mounts(struts), 1.0)
    return {name: x for name, x in numbers.items() if np.isfinite(x)}


def _mounts(struts: FlexureStruts) -> dict[str, str]:
    """Names of the springs of base and platform, with their attributes."""
    if not isinstance(struts, MountedStruts):
        return {}
    both = {"stiffness.base (link)": "base", "stiffness.platform (link)": "tip"}
    return {name: end for name, end in both.items() if getattr(struts, end) is not None}


def _name(end: str, word: str) -> str:
    return f"offset.{end}" if word == "offset" else f"stiffness.{end}.{word}"


def with_strut_numbers(
    struts: FlexureStruts, legs: Sequence[str], values: Mapping[str, float]
) -> FlexureStruts:
    """Struts with some numbers of `strut_numbers` changed; each other number stays."""
    nominal = strut_numbers(struts, legs)
    if values.keys().isdisjoint(nominal):
        return struts
    slides = [
        values.get(name := f"stiffness.{leg}", nominal.get(name, np.inf)) for leg in legs
    ]
    lower, upper = (
        Flexure(
            **{
                word: values.get(_name(end, word), x)
                for word, x in getattr(struts, end)._asdict().items()
            }
        )
        for end in _ENDS
    )
    soft = 1.0 / lower.axial + 1.0 / upper.axial
    stiffness = 1.0 / (1.0 / np.array(slides) + soft)
    mounts: dict[str, Any] = {
        end: Mount(mount.place, values.get(name, 1.0) * mount.stiffness)
        for name, end in _mounts(struts).items()
        if (mount := getattr(struts, end))
    }
    return replace(struts, lower=lower, upper=upper, stiffness=stiffness, **mounts)


def with_strut_points(
    struts: FlexureStruts, anchors: Array, points: Array
) -> FlexureStruts:
    """Struts made at the same pose of the body between other points (m, 3) of F and of M.

    Their rest lengths stay.
    """
    ends = np.array(struts.feet)
    ends[:, :3, 3] += struts.made[:, None] * ends[:, :3, 2]
    T_F_M = (ends @ se3.inverse(struts.home))[0]
    made = FlexureStruts.between(
        anchors,
        points,
        T_F_M,
        struts.slides,
        struts.lower,
        struts.upper,
        struts.rest_length,
    )
    return replace(
        struts,
        anchors=made.anchors,
        points=made.points,
        feet=made.feet,
        home=made.home,
        made=made.made,
    )
