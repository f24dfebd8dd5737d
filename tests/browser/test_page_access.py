"""The page for those who use it by other means, as axe-core judges it.

axe-core comes with what checks the page's scripts (``tools/page``), where npm has installed that.
"""

from pathlib import Path

import numpy as np
import pytest
from tools.screenshot import ready, settled

import cartstiff
from cartstiff.maps import Axis, Grid, compute_map
from tests.support.pages import clouds_in

_AXE = Path(__file__).parents[2] / "tools/page/node_modules/axe-core/axe.min.js"


@pytest.mark.skipif(not _AXE.exists(), reason="npm has not installed axe-core")
@pytest.mark.parametrize("theme", ["light", "dark"])
@pytest.mark.parametrize("name", ["ur5", "hexapod", "five-bar"])
def test_axe_finds_nothing(serve, chromium, name, theme):
    context = chromium.new_context(
        viewport={"width": 1280, "height": 900},
        color_scheme=theme,
        bypass_csp=True,
        reduced_motion="reduce",
    )
    page = context.new_page()
    page.goto(serve(name).url + "#load=0,0,0,0,0,-100&load_axes=world")
    ready(page)
    page.evaluate("() => document.querySelectorAll('details').forEach((d) => { d.open = true; })")
    page.keyboard.press("a")
    settled(page)
    page.evaluate(_AXE.read_text(encoding="utf-8"))
    found = page.evaluate("() => axe.run(document, { resultTypes: ['violations'] })")
    context.close()
    assert [
        (fault["id"], [node["html"] for node in fault["nodes"]]) for fault in found["violations"]
    ] == []


def test_keys_read_a_map_of_colours_and_go_to_a_cell(serve, pages):
    """The arrows step through its cells from where the mechanism stands."""
    page = pages.open(serve("cubic").url + "#and=3&plot=condition&along=sweep:2")
    page.wait_for_function("() => document.querySelectorAll('.plot.heat rect').length > 40 * 40")
    settled(page)
    page.focus(".plot.heat")
    for key in ("ArrowUp", "ArrowUp", "ArrowLeft"):
        page.keyboard.press(key)
    said = page.inner_text(".reading").replace("\u2212", "-")
    page.keyboard.press("Enter")
    settled(page)
    elastic = cartstiff.load("cubic")
    q = page.evaluate("() => window.cartstiff.state.q")
    assert q[2] < elastic.q[2]
    assert q[3] > elastic.q[3]
    assert said.startswith(f"{q[2]:.3g} ")
    assert f", {np.degrees(q[3]):.3g}" in said
    lengths = page.evaluate("() => window.cartstiff.numbers.indices.length")
    scale = np.diag([1 / lengths] * 3 + [1] * 3)
    values = np.linalg.eigvalsh(scale @ cartstiff.analyse(elastic, q).tangent @ scale)
    assert float(said.split(": ")[1].split()[0]) == pytest.approx(values[-1] / values[0], rel=1e-4)


def test_keys_do_what_a_mouse_does_in_the_picture(serve, pages):
    """The view is moved, values are written, formulas are read, the ball is turned."""
    page = pages.shared(serve("ur5").url)
    page.evaluate(
        "() => window.cartstiff.change({ load_axes: 'body', load: [0, 0, 0, 0, 0, -100] })"
    )
    settled(page)
    page.evaluate("() => { document.querySelector('#show').open = true; }")
    page.get_by_label("Coloured ball").check()
    page.focus("#pane")
    target = "() => window.cartstiff.pane.viewer.controls.target.toArray()"
    before, towards = page.evaluate(target), page.inner_text(".ball-words")
    page.keyboard.press("ArrowLeft")
    page.wait_for_function(
        "(before) => document.querySelector('.ball-words').textContent !== before", arg=towards
    )
    assert page.evaluate(target) == before
    page.keyboard.press("Shift+ArrowLeft")
    away = page.evaluate("() => window.cartstiff.pane.viewer.camera.position.toArray()")
    moved = np.subtract(page.evaluate(target), before)
    assert np.linalg.norm(moved) > 0
    assert abs(moved @ np.subtract(away, page.evaluate(target))) < 1e-9  # across the line of sight
    page.focus("[data-row-of=rotation] th")
    assert page.evaluate("() => window.cartstiff.pane.lit") == "rotation"
    page.focus("#legend div[tabindex]")
    page.keyboard.press("Shift+Tab")
    page.keyboard.press("Tab")
    formula = "() => getComputedStyle(document.activeElement, '::after').content"
    assert page.evaluate(formula).strip('"').startswith("; ")
    assert "log10(1 + force" in page.get_attribute("#legend div[tabindex]", "title")
    page.get_by_label("Coloured ball").uncheck()


def test_a_point_of_a_map_is_read_and_taken_by_its_number(serve, pages, tmp_path):
    arm = cartstiff.load("ur5")
    axes = {"shoulder_pan_joint": Axis(-0.9, 1.2, 3), "elbow_joint": Axis(0.7, 1.9, 3)}
    compute_map(arm, Grid(axes, arm.names, arm.q), ["translation_condition"], tmp_path / "m.zarr")
    cloud = clouds_in(tmp_path / "m.zarr", arm)
    page = pages.open(serve("ur5", cloud=cloud).url)
    page.evaluate("() => { document.querySelector('#show').open = true; }")
    page.fill("#map-choice input", "3")
    (values,) = cloud.values.values()
    said = page.inner_text("#map-choice [role=status]")
    assert float(said.split(": ")[1].split(";")[0].split()[0]) == pytest.approx(values[2], rel=1e-3)
    page.keyboard.press("Enter")
    settled(page)
    assert page.evaluate("() => window.cartstiff.state.q") == pytest.approx(cloud.q[2].tolist())
