"""Colours and proportions of every picture, plot and page, in one place.

One hue has one meaning. The hues of `COLOURS` are told apart with each kind of
colour-blindness, on a light and on a dark ground; whatever they say is also said by a
sign, a dash or a word. Values between two ends run through a neutral middle (diverging)
or from dark to light (sequential), so that lightness alone orders them. The page reads
the table as properties of its style sheet.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cartstiff.core.arrays import Array, real_array

#: Meaning of each hue. Positive and negative are signs of stiffnesses and of values of a
#: map; "screw" are axes and centres of motion.
COLOURS = {
    "translation": 0xE69F00,
    "rotation": 0x7C2BD6,
    "positive": 0x4F8EE6,
    "negative": 0xB82E34,
    "tension": 0x2AA35F,
    "compression": 0xDE74BC,
    "deflection": 0x007A82,
    "screw": 0x8A7A10,
}
GHOST, REST = 0x56B4E9, 0x8C8C8C
#: x, y, z of a frame. Red and green differ in lightness, for those who confuse the hues.
AXES = (0xCC3311, 0x44AA66, 0x2255CC)
#: Colours of points by kind: eight hues, then the same ones lighter.
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

#: Opacity of ellipsoids (one is seen through the other), and of a ghost.
ELLIPSOID_OPACITY, GHOST_OPACITY = {"translation": 0.38, "rotation": 0.2}, 0.22


@dataclass(frozen=True)
class Theme:
    """Colours that differ between a light and a dark picture.

    Attributes
    ----------
    top, bottom : int
        Background at the top and the bottom.
    text, paper : int
        Colours of labels: letters and background.
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

_PALE = [222, 224, 226]
# Dark blue over green to yellow with evenly rising lightness.
SEQUENTIAL = np.array(
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


def shade(colour: int, ghost: bool, opacity: float = 1.0) -> tuple[int, float]:
    """Colour and opacity of a part, or of a ghost's part."""
    return (GHOST, GHOST_OPACITY) if ghost else (colour, opacity)


def hex_of(colour: Sequence[float] | Array) -> int:
    """0xRRGGBB of red, green, blue in [0, 255]."""
    r, g, b = (round(float(c)) for c in colour[:3])
    return (r << 16) + (g << 8) + b


def fractions(colour: int) -> list[float]:
    """Red, green, blue in [0, 1] of 0xRRGGBB."""
    return [(colour >> shift & 0xFF) / 255 for shift in (16, 8, 0)]


def _ends(low: str, high: str) -> Array:
    """Colours at equal steps from one hue over pale to another, the ends darker."""
    two = [255 * np.array(fractions(COLOURS[name])) for name in (low, high)]
    return np.array([0.7 * two[0], two[0], _PALE, two[1], 0.7 * two[1]])


#: Colours at equal steps of values of both signs, and of forces of legs.
SIGNS, FORCES = _ends("negative", "positive"), _ends("compression", "tension")
#: Colours at equal steps of shares of a deflection, from -1 to 1, by theme: what has no
#: share is like the ground.
SHARES = {
    "light": [COLOURS["negative"], hex_of(_PALE), COLOURS["deflection"]],
    "dark": [0xFF6B66, 0x59626C, 0x35D0D8],
}
_FORCES: list[list[float]] = FORCES.tolist()


def force_colour(x: float) -> int:
    """0xRRGGBB of a leg's force over its limit: tension above zero."""
    place = min(max(0.5 + 0.5 * x, 0.0), 1.0) * (len(_FORCES) - 1)
    knot = min(int(place), len(_FORCES) - 2)
    colour = 0
    for start, end in zip(_FORCES[knot], _FORCES[knot + 1], strict=True):
        colour = (colour << 8) + round((end - start) * (place - knot) + start)
    return colour


def _between(table: Array, x: ArrayLike) -> NDArray[np.uint8]:
    place = np.minimum(np.maximum(real_array(x), 0.0), 1.0) * (len(table) - 1)
    knot = np.minimum(place.astype(int), len(table) - 2)
    start = table[knot]
    mixed = (table[knot + 1] - start) * (place - knot)[..., None] + start
    return np.round(mixed).astype(np.uint8)


def diverging(x: ArrayLike) -> NDArray[np.uint8]:
    """Colours (..., 3) for values in [-1, 1]: red below zero, blue above,
    pale at zero.
    """
    return _between(SIGNS, 0.5 + 0.5 * real_array(x))


def sequential(x: ArrayLike) -> NDArray[np.uint8]:
    """Colours (..., 3) for values in [0, 1]: dark to light."""
    return _between(SEQUENTIAL, x)


def style_properties() -> str:
    """The table for a style sheet: ``--translation: #e69f00`` and so on;
    lists by commas.
    """
    lists = {
        "axes": AXES,
        "sequential": [hex_of(colour) for colour in SEQUENTIAL],
        "shares": SHARES["light"],
        "forces": [hex_of(colour) for colour in FORCES],
        "ghost": [GHOST],
        "rest": [REST],
        "deflection-letters": [t.tinted(COLOURS["deflection"]) for t in THEMES.values()],
        "label-paper": [t.paper for t in THEMES.values()],
    }
    tables = {**{name: [colour] for name, colour in COLOURS.items()}, **lists}
    rows = (f"--{n}: {','.join(f'#{c:06x}' for c in row)};" for n, row in tables.items())
    dark = ",".join(f"#{c:06x}" for c in SHARES["dark"])
    return (
        ":root { " + " ".join(rows) + " }\n"
        f":root[data-theme=dark] {{ --shares: {dark}; }}\n"
    )
