"""Exported files of generated arms: what the browser computes is what matrices say."""

import numpy as np
import pytest
from tools.screenshot import settled

import cartstiff
from tests.support.generated import Arm, close
from tests.support.pages import page_text, source_of


# Those of six joints or more: the file of another holds one posture.
@pytest.mark.parametrize("seed", [0, 2, 3])
def test_a_posture_that_the_file_never_saw(seed, tmp_path, pages):
    """A slider is moved in the file, without a server: pose, wrench and compliance follow."""
    one = Arm.generated(seed)
    source = source_of(cartstiff.load(one.written(tmp_path)), load=one.W, load_axes="world")
    path = tmp_path / "arm.html"
    path.write_text(page_text(source), encoding="utf-8")
    page = pages.open(path.as_uri(), offline=True)
    page.focus("#slider-0")
    page.keyboard.press("ArrowRight")
    settled(page)
    found = page.evaluate("() => window.cartstiff.numbers.result")
    q = np.array(found["q"])
    assert q[0] != one.q[0]
    T = one.pose(q)
    close(found["pose"], T, 1e-12)
    force = T[:3, :3].T @ one.W[3:]
    close(found["wrench"], np.concatenate([np.zeros(3), force]), 1e-12)
    close(found["load"]["compliance"], one.at_origin.compliance(q))
