"""A hand on other mechanisms than one arm, legs by their lengths, and what sways."""

from __future__ import annotations

import numpy as np
import pytest
from tools.screenshot import ready, settled

import cartstiff
from tests.browser.test_page_state import TOOL, changed
from tests.support.pages import colour as page_colour
from tests.support.pages import motion_shown, state_of


@pytest.mark.parametrize(
    "name", ["hexapod", "ur5", pytest.param("panda", marks=pytest.mark.thorough), "delta"]
)
def test_the_tool_follows_the_hand(serve, pages, name):
    page = pages.shared(serve(name).url)
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


def test_a_leg_is_as_long_as_its_slider_says(serve, pages):
    page = pages.shared(serve("hexapod").url)
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


PLACES = """() => {
    const at = (...names) =>
        window.cartstiff.pane.viewer.scene_tree.find(["meshcat", "cartstiff", ...names]).object;
    return {
        M: at("M").position.toArray(), rest: at("rest", "M").position.toArray(),
        wrench: at("wrench").position.toArray(), shown: at("rest").visible,
        callout: at("callout").children[0].userData.label.text,
    };
}"""


@pytest.mark.parametrize("name", ["ur5", "hexapod", "five-bar", "cable-robot"])
def test_the_way_under_the_load_is_shown_enlarged_by_a_stated_factor(serve, chromium, name):
    """The rest in grey is so many times as far away as the load moves the body; the label at the
    way says the true one. With reduced motion both stand still.
    """
    context = chromium.new_context(viewport={"width": 1100, "height": 560}, reduced_motion="reduce")
    page = context.new_page()
    page.goto(serve(name).url)
    ready(page)
    load = (0.0, 0.0, 0.0, 3.0, 0.0, 0.0 if name == "five-bar" else -10.0)
    changed(page, load_axes="world", load=load)
    times = float(page.inner_text(".enlarged .num").split("drawn ")[1].split(" ")[0])
    found = page.evaluate(PLACES)
    result = cartstiff.analyse(cartstiff.load(name), wrench=load, load_axes="world")
    way = np.array(motion_shown(result, state_of())["in_room"])
    assert found["shown"]
    shown = np.subtract(found["M"], found["rest"])
    assert np.linalg.norm(shown - times * way) < 0.1 * np.linalg.norm(times * way)
    value, unit = found["callout"].split(" ")
    said = float(value) * {"mm": 1e-3, "µm": 1e-6}[unit]
    assert said == pytest.approx(np.linalg.norm(way), rel=1e-3)
    assert not page.locator("text=Show it move").is_visible()
    # Another factor changes the picture and nothing else.
    before = page.inner_text(".moved-head")
    changed(page, enlarged=times / 2)
    found = page.evaluate(PLACES)
    half = np.subtract(found["M"], found["rest"])
    assert np.linalg.norm(half - shown / 2) < 0.1 * np.linalg.norm(half)
    assert page.inner_text(".moved-head") == before
    context.close()


def test_what_hangs_on_the_body_moves_with_it_and_comes_back(serve, pages):
    page = pages.shared(serve("ur5").url)
    changed(page, load_axes="world", load=[0, 0, 0, 0, 0, -100])
    start = page.evaluate(PLACES)
    height = page.locator(".moved-card").bounding_box()["height"]
    page.click("text=Show it move")
    page.wait_for_function(f"() => {{ const at = ({PLACES})(); return at.wrench.some((x) => x); }}")
    found = page.evaluate(PLACES)
    assert found["M"] != start["M"]
    # Between rest and load, and the arrow as far from its place as the body.
    reach = np.linalg.norm(np.subtract(start["rest"], start["M"]))
    assert 0 < np.linalg.norm(np.subtract(found["M"], start["M"])) <= reach * 1.001
    assert page.locator(".moved-card").bounding_box()["height"] == height
    page.click("text=Stop")
    settled(page)
    found = page.evaluate(PLACES)
    assert np.allclose(found["M"], start["M"])
    assert np.allclose(found["wrench"], 0.0)


def test_bars_light_their_parts_and_parts_their_bars(serve, pages):
    page = pages.shared(serve("ur5").url)
    changed(page, load_axes="world", load=[0, 0, 0, 0, 0, -100])
    names = page.locator(".moved-bar .moved-name").all_inner_texts()
    result = cartstiff.analyse(
        cartstiff.load("ur5"), wrench=[0, 0, 0, 0, 0, -100], load_axes="world"
    )
    shares = motion_shown(result, state_of())["shares"]["parts"]
    assert names == [part["name"] for part in shares if part["share"] >= 0.005]
    widths = page.eval_on_selector_all(
        ".moved-bar i", "(all) => all.map((i) => parseFloat(i.style.width))"
    )
    assert widths == pytest.approx([100 * part["share"] for part in shares[: len(names)]], abs=0.01)
    page.focus(".moved-bar >> nth=1")
    assert page.locator(".slider.lit label").inner_text() == names[1]
    page.evaluate("(name) => window.cartstiff.tell('part', name)", names[0])
    assert page.locator(".moved-bar.lit .moved-name").inner_text() == names[0]


def test_two_coordinates_are_a_map_of_colours(serve, pages):
    page = pages.shared(serve("ur5").url)
    changed(page, load_axes="body", load=[0, 0, 0, 0, 0, -100])
    page.wait_for_function("() => window.cartstiff.source.local")
    page.select_option("select[aria-label='Values of']", "deflection")
    page.select_option("select[aria-label='And along what']", "1")
    page.wait_for_function(
        "() => document.querySelectorAll('.plot.heat rect').length >= 40 * 40 + 24", timeout=300_000
    )
    settled(page)
    box = page.locator(".plot.heat").bounding_box()
    # Whole dots: a click has no others, and a fraction may lie in the next cell.
    x, y = round(box["x"] + 0.45 * box["width"]), round(box["y"] + 0.4 * box["height"])
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


# Places on the screen, from -1 to 1, half around the ring of that radius; null if hidden.
# The first is the one furthest from the head of the force's arrow, which is held before the ring.
AROUND = """(radius) => {
    const { viewer } = window.cartstiff.pane;
    viewer.scene.updateMatrixWorld(true);
    let ring = null;
    viewer.scene.traverseVisible((node) => {
        if (node.geometry?.parameters?.radius === radius && node.renderOrder) ring ??= node;
    });
    if (!ring) return null;
    const seen = (node, ...place) => {
        const at = viewer.camera.position.clone().set(...place).applyMatrix4(node.matrixWorld);
        at.project(viewer.camera);
        return [at.x, at.y];
    };
    const arrow = ["meshcat", "cartstiff", "wrench", "force", "arrow"];
    const head = seen(viewer.scene_tree.find(arrow).object, 1, 0, 0);
    const places = [0, 1, 2, 3, 4, 5, 6, 7].map((eighth) =>
        seen(ring, ...[Math.cos, Math.sin].map((f) => radius * f((eighth * Math.PI) / 4)), 0));
    const away = places.map(([x, y]) => Math.hypot(x - head[0], y - head[1]));
    const first = away.indexOf(Math.max(...away));
    return [0, 1, 2, 3, 4].map((step) => places[(first + step) % 8]);
}"""


def test_the_moment_is_turned_by_its_ring(serve, pages):
    page = pages.shared(serve("ur5").url)
    page.set_viewport_size({"width": 420, "height": 600})  # no arm lies before the ring's start
    changed(page, load=[0, 0, 0, 0, 0, -100], load_axes="world")
    page.keyboard.press("g")
    settled(page)
    page.locator("#pane canvas").scroll_into_view_if_needed()
    box = page.locator("#pane canvas").bounding_box()

    def turned():
        places = [
            (box["x"] + box["width"] * (1 + x) / 2, box["y"] + box["height"] * (1 - y) / 2)
            for x, y in page.evaluate(AROUND, 0.46)
        ]
        page.mouse.move(*places[0])
        settled(page)
        page.mouse.down()
        for place in places[1:]:
            page.mouse.move(*place)
            settled(page)
        said = page.inner_text(".tip:not([hidden])")
        page.mouse.up()
        settled(page)
        return said, page.evaluate("() => window.cartstiff.state.load")

    # Half a turn about the force's line: a tenth of the size as its lever.
    arm = cartstiff.load("ur5")
    lever = 0.1 * arm.mechanism.at(arm.q).length
    said, load = turned()
    assert load[:2] == [0, 0]
    assert load[3:] == [0, 0, -100]
    assert load[2] == pytest.approx(-100 * lever, rel=0.06)  # two digits, and dots of the screen
    assert said.startswith(f"{-load[2]:g} N m (0, 0, \u2212{-load[2]:g}) room axes")
    # From there half a turn makes it twice as large, about the same line.
    twice = turned()[1]
    assert twice[:2] == [0, 0]
    assert twice[2] == pytest.approx(2 * load[2], rel=0.06)
    page.keyboard.press("u")
    settled(page)
    assert page.evaluate("() => window.cartstiff.state.load") == load
    page.keyboard.press("g")


# Rings at the ends of ranges that are shown: where the middle is in the mechanism, and the colour.
ENDS = """() => {
    const { viewer } = window.cartstiff.pane;
    const { object } = viewer.scene_tree.find(["meshcat", "cartstiff"]);
    const root = object.matrixWorld.clone().invert();
    const found = [];
    viewer.scene.traverseVisible((node) => {
        if (node.geometry?.parameters?.radius !== 0.62) return;
        const at = viewer.camera.position.clone().setFromMatrixPosition(node.matrixWorld);
        const axis = at.clone().setFromMatrixColumn(node.matrixWorld, 2);
        axis.transformDirection(root);
        found.push([at.applyMatrix4(root).toArray(), axis.toArray(), node.material.color.getHex()]);
    });
    return found;
}"""


def test_ends_of_ranges_are_rings_while_the_tool_is_held(serve, pages):
    page = pages.shared(serve("ur5").url)
    arm = cartstiff.load("ur5")
    near = [0.3, -1.1, np.pi - 0.1, -0.7, 0.9, 0.2]
    changed(page, q=near, moved=None)
    box = page.locator("#pane canvas").bounding_box()
    x, y = page.evaluate(TOOL)
    x, y = box["x"] + box["width"] * (1 + x) / 2, box["y"] + box["height"] * (1 - y) / 2
    assert page.evaluate(ENDS) == []
    page.mouse.move(x, y)
    settled(page)
    page.mouse.down()
    page.mouse.move(x + 2, y)
    settled(page)
    q = page.evaluate("() => window.cartstiff.numbers.result.q")
    ((place, axis, colour),) = page.evaluate(ENDS)
    # About the elbow, whose column of the Jacobian in F is (axis, place x axis).
    result = cartstiff.analyse(arm, q)
    R, p = result.pose[:3, :3], result.pose[:3, 3]
    turn = R @ result.jacobian[:3, 2]
    way = R @ result.jacobian[3:, 2]
    assert np.abs(turn @ axis) == pytest.approx(1, abs=1e-6)
    assert np.allclose(np.cross(turn, p - place), way, atol=1e-6)
    assert colour == page_colour("negative")
    page.mouse.up()
    settled(page)
    assert page.evaluate(ENDS) == []


def test_curves_are_zoomed_by_wheel_and_by_keys(serve, pages, tmp_path):
    page = pages.shared(serve("ur5", curves=True).url)
    page.wait_for_selector("#strip .plot:not(.computing) .curve-0")

    def ends() -> list[float]:
        """Those of the slider, which runs below the plot; round places lie within them."""
        found = [float(page.get_attribute("#time", name)) for name in ("min", "max")]
        words = page.locator("#strip .plot:not(.heat) text").all_text_contents()
        places = [float(one[:-1].replace("\u2212", "-")) for one in words if one.endswith("°")]
        low, high = np.degrees(found)
        assert low - 1e-6 <= min(places) < max(places) <= high + 1e-6
        return [low, high]

    assert ends() == pytest.approx([-180, 180], abs=0.1)
    box = page.locator("#strip .plot").first.bounding_box()
    page.mouse.move(box["x"] + 0.7 * box["width"], box["y"] + 0.5 * box["height"])
    said = page.inner_text(".reading").split(":")[0]
    for _ in range(8):
        page.mouse.wheel(0, -100)
    turned = "() => { const [a, b] = window.cartstiff.plot.seen ?? [0, 9]; return b - a < 1.1; }"
    page.wait_for_function(turned)  # all eight turns
    low, high = ends()
    assert high - low == pytest.approx(360 / 1.25**8, rel=0.02)
    at = float(said.strip("°").replace("\u2212", "-"))  # what was pointed at stays there
    assert low < at < high
    assert (at - low) / (high - low) == pytest.approx((at + 180) / 360, abs=0.05)
    with page.expect_download() as download:
        page.select_option("select[aria-label='Save the plot']", "png3")
    download.value.save_as(tmp_path / "plot.png")
    width = int.from_bytes((tmp_path / "plot.png").read_bytes()[16:20], "big")
    assert width == pytest.approx(3 * box["width"], abs=3)
    page.dblclick("#strip .plot", position={"x": 200, "y": 30})
    assert ends() == pytest.approx([-180, 180], abs=0.1)
    settled(page)
    page.focus("#time")
    page.keyboard.press("+")
    low, high = ends()
    assert high - low == pytest.approx(360 / 1.25, rel=0.01)
    page.keyboard.press("-")
    assert ends() == pytest.approx([-180, 180], abs=0.1)
