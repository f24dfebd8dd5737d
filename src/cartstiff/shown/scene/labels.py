"""Text at a point of a picture.

A small picture of its own for a viewer that writes no words.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache, lru_cache
from io import BytesIO
from typing import Any

from cartstiff.core.errors import imported, printable
from cartstiff.core.units import engineering
from cartstiff.shown.scene import theme as themes
from cartstiff.shown.scene.objects import sprite
from cartstiff.shown.scene.viewer import ViewerNode

#: Height of a letter's box in dots, and of a label on the screen at unit distance.
_DOTS = 30
HEIGHT = 0.023
_MARGIN = 6
# Of 255: what is behind a label shows through.
_PAPER_OPACITY = 184


def number(value: float, unit: str = "", size: float | None = None) -> str:
    """Three digits and a unit: "77.5 N/mm"; in the unit of another `size`, if given."""
    return engineering(value, unit, 3, size=size)


@cache
def _font() -> Any:
    ImageFont = imported("PIL.ImageFont", "pillow", "a label in a picture")
    return ImageFont.load_default(size=_DOTS - 4)


@lru_cache(maxsize=1024)
def text_png(text: str, letters: int, paper: int) -> tuple[bytes, float]:
    """One line of text as a PNG, and its width over its height; colours are 0xRRGGBB.

    Raises
    ------
    MissingDependencyError
        Without Pillow.
    """
    font = _font()
    from PIL import Image, ImageDraw

    size = 2 * _MARGIN + max(1, round(font.getlength(text))), _DOTS + 2 * _MARGIN - 4
    ink, ground = f"#{letters:06x}", f"#{paper:06x}{_PAPER_OPACITY:02x}"
    label = Image.new("RGBA", size, ground)
    ImageDraw.Draw(label).text((_MARGIN, _MARGIN - 4), text, fill=ink, font=font)
    png = BytesIO()
    label.save(png, "PNG", compress_level=1)
    return png.getvalue(), size[0] / size[1]


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

    def __init__(
        self, node: ViewerNode, theme: themes.Theme, colour: int | None = None
    ) -> None:
        self.node = node
        shades = list(themes.THEMES.values())
        self._letters = [t.text if colour is None else t.tinted(colour) for t in shades]
        self._paper = [t.paper for t in shades]
        self._shade = shades.index(theme)
        self._height = HEIGHT / node.enlarged
        self._text: str | None = None  # as it was given

    def show(self, text: str, point: Sequence[float]) -> None:
        """Write a text at a point of the node's parent, plain numbers."""
        if text != self._text:
            self._text = text
            text = printable(text)
            if getattr(self.node.window, "writes", False):
                said = {"text": text, "letters": self._letters, "paper": self._paper}
                self.node.set_object({"label": {**said, "height": self._height}})
                return self._place(point)
            png, aspect = text_png(
                text, self._letters[self._shade], self._paper[self._shade]
            )
            label = sprite(png, aspect * self._height, self._height)
            label["object"]["userData"] = {"text": text}
            self.node.set_object(label)
        self._place(point)

    def _place(self, point: Sequence[float]) -> None:
        self.node.move_to(point)
        self.node.show(True)

    def hide(self) -> None:
        """Show nothing."""
        if self._text is not None:
            self.node.show(False)
