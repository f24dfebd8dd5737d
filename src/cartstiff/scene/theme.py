"""Colours and proportions of every picture, in one place.

Hues are those of Okabe and Ito, which people with colour-blindness tell apart. Values between two
ends run through a neutral middle (diverging) or from dark to light (sequential), so that lightness
alone orders them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cartstiff.arrays import real_array
from cartstiff.geometry.se3 import Array

ORANGE, SKY, GREEN, YELLOW = 0xE69F00, 0x56B4E9, 0x009E73, 0xF0E442
BLUE, VERMILION, PURPLE, BLACK = 0x0072B2, 0xD55E00, 0xCC79A7, 0x000000

TRANSLATION, ROTATION = ORANGE, BLUE
NEGATIVE = 0xC8102E
DEFLECTION, GHOST = GREEN, SKY
SCREW, WRENCH_AXIS, TWIST_AXIS = PURPLE, ORANGE, BLUE
#: Of a mode.
NODAL = 0xD55E00
#: Centres by the names of `cartstiff.analysis.centres.Centres`.
CENTRES = {
    "stiffness": VERMILION,
    "compliance": BLUE,
    "elasticity": GREEN,
    "least_coupling": PURPLE,
}
#: x, y, z of a frame. Red and green differ in lightness, for those who confuse the hues.
AXES = (0xCC3311, 0x44AA66, 0x2255CC)
#: Of points by kind: eight hues, then the same ones lighter.
KINDS = (
    0x0072B2,
    0xD55E00,
    0x009E73,
    0xCC79A7,
    0xE69F00,
    0x56B4E9,
    0xF0E442,
    0x6A4C93,
    0x7FB8D8,
    0xEAAE7F,
    0x7FCEB9,
    0xE5BCD3,
    0xF2CF7F,
    0xABD9F4,
    0xF7F1A0,
    0xB4A5C9,
)
SLACK, NO_VALUE = 0x9A9A9A, 0x8C8C8C

#: Opacity of an ellipsoid, and of a ghost.
ELLIPSOID_OPACITY, GHOST_OPACITY = 0.38, 0.22


@dataclass(frozen=True)
class Theme:
    """What differs between a light and a dark picture.

    Attributes
    ----------
    top, bottom : int
        Background at the top and the bottom.
    text, paper : int
        Colours of labels: their letters, and what is behind these.
    grid : int
        Lines on the ground.
    link, joint, plate : int
        Stick figures and plates.
    load : int
        Arrows of wrenches.
    """

    top: int
    bottom: int
    text: int
    paper: int
    grid: int
    link: int
    joint: int
    plate: int
    load: int

    def tinted(self, colour: int) -> int:
        """A colour mixed with that of the text, to write in."""
        mixed = 0.5 * (np.array(fractions(colour)) + np.array(fractions(self.text)))
        return hex_of(255 * mixed)


LIGHT = Theme(
    top=0xFFFFFF,
    bottom=0xE8ECF0,
    text=0x1A1A1A,
    paper=0xFFFFFF,
    grid=0xB4BCC4,
    link=0x7B8794,
    joint=0x3E4C59,
    plate=0x9AA5B1,
    load=0x2B2B2B,
)
DARK = Theme(
    top=0x2B313A,
    bottom=0x14171C,
    text=0xF2F2F2,
    paper=0x14171C,
    grid=0x4A525C,
    link=0x9AA5B1,
    joint=0xCBD2D9,
    plate=0x7B8794,
    load=0xF0F0F0,
)
THEMES = {"light": LIGHT, "dark": DARK}

#: Colours of `diverging` at equal steps.
DIVERGING = np.array([[0, 84, 147], [86, 160, 211], [214, 218, 220], [232, 140, 60], [190, 70, 0]])
_DIVERGING: list[list[int]] = DIVERGING.tolist()
# Dark blue over green to yellow with evenly rising lightness.
_SEQUENTIAL = np.array(
    [
        [40, 26, 88],
        [53, 66, 124],
        [42, 107, 137],
        [38, 143, 136],
        [74, 179, 116],
        [149, 207, 82],
        [246, 229, 64],
    ]
)


def hex_of(colour: Sequence[float] | Array) -> int:
    """0xRRGGBB of red, green, blue in [0, 255]."""
    r, g, b = (round(float(c)) for c in colour[:3])
    return (r << 16) + (g << 8) + b


def shade(x: float) -> int:
    """`hex_of` of `diverging` of one value; of a few this is several times as fast."""
    place = min(max(0.5 + 0.5 * x, 0.0), 1.0) * (len(_DIVERGING) - 1)
    knot = min(int(place), len(_DIVERGING) - 2)
    colour = 0
    for start, end in zip(_DIVERGING[knot], _DIVERGING[knot + 1], strict=True):
        colour = (colour << 8) + round((end - start) * (place - knot) + start)
    return colour


def fractions(colour: int) -> list[float]:
    """Red, green, blue in [0, 1] of 0xRRGGBB."""
    return [(colour >> shift & 0xFF) / 255 for shift in (16, 8, 0)]


def _between(table: Array, x: ArrayLike) -> NDArray[np.uint8]:
    place = np.minimum(np.maximum(real_array(x), 0.0), 1.0) * (len(table) - 1)
    knot = np.minimum(place.astype(int), len(table) - 2)
    start = table[knot]
    mixed = (table[knot + 1] - start) * (place - knot)[..., None] + start
    return np.round(mixed).astype(np.uint8)


def diverging(x: ArrayLike) -> NDArray[np.uint8]:
    """Colours (..., 3) for values in [-1, 1]: blue below zero, orange above, pale at zero."""
    return _between(DIVERGING, 0.5 + 0.5 * real_array(x))


def sequential(x: ArrayLike) -> NDArray[np.uint8]:
    """Colours (..., 3) for values in [0, 1]: dark to light."""
    return _between(_SEQUENTIAL, x)
