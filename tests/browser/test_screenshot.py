"""The picture in the README is what the page looks like."""

from __future__ import annotations

import io

import numpy as np
import pytest
from PIL import Image
from tools.screenshot import MECHANISM, STATE, TARGET, pictures

#: Mean difference (of 255) of squares of 16 dots: fonts and software rendering differ from system
#: to system, by 3 where that was tried; another layout, theme or posture by more than 10.
MEAN = 7.0
#: The same of the worst column of the layout.
COLUMN = 14.0
SQUARE = 16
#: Columns of the layout, in dots: posture, picture, matrices.
COLUMNS = {"left": (0, 280), "picture": (281, 855), "right": (856, 1280)}


def squares(image: Image.Image) -> np.ndarray:
    """Mean colours of squares."""
    dots = np.asarray(image.convert("RGB"), float)
    h, w = (n // SQUARE * SQUARE for n in dots.shape[:2])
    dots = dots[:h, :w].reshape(h // SQUARE, SQUARE, w // SQUARE, SQUARE, 3)
    return dots.mean(axis=(1, 3))


@pytest.fixture(scope="module")
def shots(serve, chromium) -> dict[str, Image.Image]:
    url = serve(MECHANISM, curves=True).url + STATE
    themes = ("light", "dark")
    found = pictures(chromium, url, themes)
    return {name: Image.open(io.BytesIO(png)) for name, png in zip(themes, found, strict=True)}


def test_it_looks_like_the_committed_picture(shots):
    committed = Image.open(TARGET)
    assert TARGET.stat().st_size < 300_000
    assert shots["light"].size == committed.size == (1280, 720)
    difference = np.abs(squares(shots["light"]) - squares(committed))
    assert difference.mean() < MEAN
    for name, (start, end) in COLUMNS.items():
        part = difference[:, start // SQUARE : end // SQUARE]
        assert part.mean() < COLUMN, name


def test_the_comparison_sees_another_theme(shots):
    difference = np.abs(squares(shots["dark"]) - squares(Image.open(TARGET)))
    assert difference.mean() > 10 * MEAN


@pytest.mark.parametrize("theme", ["light", "dark"])
def test_robot_and_ellipsoids_are_drawn(shots, theme):
    """Blue caps and grey tubes of the robot, an orange and a blue ellipsoid, the arrow."""
    image = shots[theme]
    start, end = COLUMNS["picture"]
    dots = np.asarray(image.convert("RGB"), float)[80:460, start:end]
    r, g, b = dots[..., 0], dots[..., 1], dots[..., 2]
    orange = np.sum((r > b + 60) & (r > g + 15) & (g > b + 20))
    blue = np.sum((b > r + 40) & (b > g + 5))
    grey_of_tubes = np.sum((np.ptp(dots, axis=-1) < 14) & (r > 45) & (r < 125))
    assert orange > 300
    assert blue > 1000
    assert grey_of_tubes > 1500


def test_the_dark_theme_is_dark_and_readable(shots):
    dark = np.asarray(shots["dark"].convert("L"), float)
    assert dark.mean() < 70
    assert (dark > 200).sum() > 5000, "letters"
