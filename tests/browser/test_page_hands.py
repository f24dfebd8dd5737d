"""A hand on other mechanisms than one arm, legs by their lengths, and what sways."""

from __future__ import annotations

import numpy as np
import pytest
from tests.browser.test_page_state import TOOL, changed
from tools.screenshot import settled

import cartstiff
from cartstiff.page.payload import payload
from cartstiff.page.state import State


@pytest.mark.parametrize("name", ["hexapod", "panda", "delta"])
def test_the_tool_follows_the_hand(serve, pages, name):
    page = pages.open(serve(name).url)
    settled(page)
    before = page.evaluate("() => window.cartstiff.numbers.result")
    box = page.locator("#pane canvas").bounding_box()
    x, y = page.evaluate(TOOL)
    x, y = box["x"] + box["width"] * (1 + x) / 2, box["y"] + box["height"] * (1 - y) / 2
    page.mouse.move(x, y)
    settled(page)
    page.mouse.down()
    for part in (0.5, 1.0):
        page.mouse.move(x + part * 14, y + part * 9)
    settled(page)
    page.mouse.up()
    page.mouse.move(0, 0)
    settled(page)
    after = page.evaluate("() => window.cartstiff.numbers.result")
    moved = np.subtract(after["pose"], before["pose"])
    assert np.linalg.norm(moved[:3, 3]) > 0
    # In the plane of the screen, as far as the hand went.
    u, v = page.evaluate(TOOL)
    at = box["x"] + box["width"] * (1 + u) / 2, box["y"] + box["height"] * (1 - v) / 2
    assert at == pytest.approx((x + 14, y + 9), abs=1.5)
    if name != "delta":  # which cannot turn
        assert np.abs(moved[:3, :3]).max() < 1e-6
    elastic = cartstiff.load(name)
    there = cartstiff.analyse(elastic, after["q"])
    assert np.allclose(there.pose, after["pose"], atol=1e-9 * max(1.0, np.abs(there.pose).max()))
    page.keyboard.press("u")
    settled(page)
    assert page.evaluate("() => window.cartstiff.state.q") == before["q"]
    page.context.close()


def test_a_leg_is_as_long_as_its_slider_says(serve, pages):
    page = pages.open(serve("hexapod").url)
    settled(page)
    before = [leg["length"] for leg in page.evaluate("() => window.cartstiff.numbers.legs")]
    wanted = 1.01 * before[2]
    page.evaluate(
        """(length) => {
            const range = document.querySelectorAll(".leg input")[2];
            range.value = length;
            range.dispatchEvent(new Event("input"));
        }""",
        wanted,
    )
    settled(page)
    after = [leg["length"] for leg in page.evaluate("() => window.cartstiff.numbers.legs")]
    before[2] = wanted
    assert after == pytest.approx(before, rel=1e-5)  # of the slider's digits
    page.context.close()


@pytest.mark.parametrize("name", ["ur5", "hexapod"])
def test_the_way_under_the_load_is_shown_enlarged_by_a_stated_factor(serve, chromium, name):
    # With reduced motion the enlarged posture stands still.
    context = chromium.new_context(viewport={"width": 1100, "height": 560}, reduced_motion="reduce")
    page = context.new_page()
    page.goto(serve(name).url)
    page.wait_for_function("() => window.cartstiff?.source.local")
    load = (0.0, 0.0, 0.0, 30.0, 0.0, -100.0)
    changed(page, load=load)
    page.click("text=Show it move")
    words = page.inner_text(".moved-card button[aria-pressed=true]")
    times = float(words.split("enlarged ")[1].split(" ")[0])
    place = """() => {
        const M = window.cartstiff.pane.viewer.scene_tree.find(["meshcat", "cartstiff", "M"]);
        return M.object.position.toArray();
    }"""
    elastic = cartstiff.load(name)
    result = cartstiff.analyse(elastic, wrench=load)
    way = np.array(payload(result, State(load=load))["moved"]["in_room"])
    shown = result.pose[:3, 3] - page.evaluate(place)
    assert np.linalg.norm(shown) > 20 * np.linalg.norm(way)
    assert np.linalg.norm(shown - times * way) < 0.1 * np.linalg.norm(times * way)
    page.click(".moved-card button[aria-pressed=true]")
    assert np.allclose(page.evaluate(place), result.pose[:3, 3], atol=1e-6)
    context.close()


def test_two_coordinates_are_a_map_of_colours(serve, pages):
    page = pages.open(serve("ur5").url + "#load=0,0,0,0,0,-100")
    page.wait_for_function("() => window.cartstiff.source.local")
    page.click("#strip [data-value=deflection]")
    page.select_option("select[aria-label='And along what']", "1")
    page.wait_for_function(
        "() => document.querySelectorAll('.plot.heat rect').length >= 31 * 21 + 24", timeout=60_000
    )
    settled(page)
    box = page.locator(".plot.heat").bounding_box()
    x, y = box["x"] + 0.45 * box["width"], box["y"] + 0.4 * box["height"]
    page.mouse.move(x, y)
    said = page.inner_text(".reading").replace("\u2212", "-")
    page.mouse.click(x, y)
    settled(page)
    q = page.evaluate("() => window.cartstiff.state.q")
    result = cartstiff.analyse(cartstiff.load("ur5"), q, wrench=[0, 0, 0, 0, 0, -100])
    moved = np.linalg.solve(result.tangent, result.wrench)[3:]
    assert float(said.split(": ")[1].split(" ")[0]) == pytest.approx(
        1e3 * np.linalg.norm(moved), rel=1e-4
    )
    page.context.close()
