"""Text as a small picture: letters are drawn once, then put together.

A value that changes with every posture needs a new picture each time; that takes a tenth of a
millisecond this way.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterable
from functools import lru_cache
from math import isfinite

import numpy as np
from numpy.typing import NDArray

from cartstiff.errors import imported, printable
from cartstiff.scene import theme as themes
from cartstiff.scene.objects import sprite
from cartstiff.scene.viewer import ViewerNode

#: Height of a letter's box in dots, and of a label on the screen at unit distance.
_DOTS = 30
HEIGHT = 0.023
_MARGIN = 6


def number(value: float, unit: str = "") -> str:
    """Three digits and a unit: "7.75e4 N/m"."""
    if not isfinite(value):
        text = "infinite" if value == value else "none"
    elif value == 0.0 or 1e-2 <= abs(value) < 1e4:
        text = f"{float(f'{value:.2e}'):.6g}"
    else:
        mantissa, exponent = f"{value:.2e}".split("e")
        text = f"{mantissa}e{int(exponent)}"
    return f"{text} {unit}".rstrip()


@lru_cache(maxsize=512)
def _letter(character: str) -> NDArray[np.uint8]:
    """How much of each dot a letter covers, 0 to 255."""
    font = _font()
    from PIL import Image, ImageDraw

    width = max(1, round(font.getlength(character)))
    image = Image.new("L", (width, _DOTS + 2 * _MARGIN - 4), 0)
    ImageDraw.Draw(image).text((0, _MARGIN - 4), character, fill=255, font=font)
    return np.asarray(image)


@lru_cache(maxsize=1)
def _font():  # type: ignore[no-untyped-def]
    ImageFont = imported("PIL.ImageFont", "pillow", "a label in a picture")
    return ImageFont.load_default(size=_DOTS - 4)


@lru_cache(maxsize=8)
def _palette(text: int, paper: int) -> bytes:
    """PNG chunks of 256 colours from paper, half transparent, to text."""
    share = np.linspace(0.0, 1.0, 256)[:, None]
    ends = [np.array(themes.fractions(colour)) * 255 for colour in (paper, text)]
    colours = np.round(ends[0] * (1 - share) + ends[1] * share).astype(np.uint8)
    opacity = np.round(255 * (0.72 + 0.28 * share)).astype(np.uint8)
    return _chunk(b"PLTE", colours.tobytes()) + _chunk(b"tRNS", opacity.tobytes())


def _chunk(kind: bytes, data: bytes) -> bytes:
    check = zlib.crc32(data, zlib.crc32(kind))
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", check)


@lru_cache(maxsize=1024)
def text_png(text: str, letters: int, paper: int) -> tuple[bytes, float]:
    """One line of text as a PNG, and its width over its height; colours are 0xRRGGBB.

    Raises
    ------
    MissingDependencyError
        Without Pillow.
    """
    shapes = [_letter(c) for c in text] or [_letter(" ")]
    rows = shapes[0].shape[0]
    edge = np.zeros((rows, _MARGIN), np.uint8)
    dots = np.concatenate([np.zeros((rows, 1), np.uint8), edge, *shapes, edge], axis=1)
    width = dots.shape[1] - 1  # the first byte of a row says how it is filtered
    head = struct.pack(">IIBBBBB", width, rows, 8, 3, 0, 0, 0)
    png = (
        b"\x89PNG\r\n\x1a\n"
        + _chunk(b"IHDR", head)
        + _palette(letters, paper)
        + _chunk(b"IDAT", zlib.compress(dots.tobytes(), 1))
        + _chunk(b"IEND", b"")
    )
    return png, width / rows


class Label:
    """A line of text at a point; a new picture only where the text changes.

    Parameters
    ----------
    node : ViewerNode
        Its place.
    theme : Theme
        Colours of letters and paper.
    colour : int, optional
        Colour of what it belongs to: its letters are tinted.
    """

    def __init__(self, node: ViewerNode, theme: themes.Theme, colour: int | None = None) -> None:
        self.node = node
        shades = list(themes.THEMES.values())
        self._letters = [t.text if colour is None else t.tinted(colour) for t in shades]
        self._paper = [t.paper for t in shades]
        self._shade = shades.index(theme)
        self._height = HEIGHT / node.enlarged
        self._text: str | None = None  # as it was given

    def show(self, text: str, point: Iterable[float]) -> None:
        """Write a text at a point (3,) of the node's parent."""
        if text != self._text:
            self._text = text
            text = printable(text)
            if getattr(self.node.window, "writes", False):
                said = {"text": text, "letters": self._letters, "paper": self._paper}
                self.node.set_object({"label": {**said, "height": self._height}})
                return self._place(point)
            png, aspect = text_png(text, self._letters[self._shade], self._paper[self._shade])
            label = sprite(png, aspect * self._height, self._height)
            label["object"]["userData"] = {"text": text}
            self.node.set_object(label)
        self._place(point)

    def _place(self, point: Iterable[float]) -> None:
        self.node.move_to(point)
        self.node.show(True)

    def hide(self) -> None:
        """Show nothing."""
        if self._text is not None:
            self.node.show(False)
