"""The exported page in a real browser, from a file, without a network."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tools.screenshot import settled

import cartstiff
from cartstiff.geometry import se3
from tests.browser.conftest import unfold
from tests.support.pages import page_text, playback_of, source_of

LOAD = np.array([0.0, 0.0, 0.0, 0.0, 0.0, -300.0])
#: Where the loops do not close, along the first coordinate.
GAPS = """async () => {
    const question = { do: "sweep", coordinate: 0, steps: 120 };
    const { rows } = await window.cartstiff.insist(question);
    return rows.map(({ moved }) => moved !== undefined);
}"""


def result(page: Any) -> dict[str, Any]:
    return page.evaluate("() => window.cartstiff.numbers.result")


def test_a_file_of_one_posture_says_what_it_cannot_and_what_works(tmp_path, pages):
    chain = cartstiff.load("cable-robot")
    path = tmp_path / "cable-robot.html"
    path.write_text(page_text(source_of(chain)), encoding="utf-8")
    page = pages.open(path.as_uri(), offline=True)
    assert page.title() == "cable-robot · cartstiff"
    said = page.inner_text("#left .exported")
    assert "This file shows one posture: its cables may be slack" in said
    assert "`cartstiff view` moves it" in said
    expected = cartstiff.analyse(chain).to_dict()
    found = result(page)
    assert {key: expected[key] for key in found if key in expected} == {
        key: found[key] for key in found if key in expected
    }
    # What would move it is switched off; the picture turns, and the numbers are read.
    assert page.is_disabled("#slider-0")
    assert page.is_disabled("[aria-label='Quantity'] [data-value='compliance'] input")
    assert not page.is_visible("#strip")
    assert page.is_hidden("#banner")
    drawn = "() => window.cartstiff.pane.viewer.renderer.info.render.triangles"
    assert page.evaluate(drawn) > 1000
    before = page.evaluate("() => window.cartstiff.pane.view")
    page.focus("#pane")
    page.keyboard.press("ArrowLeft")
    assert page.evaluate("() => window.cartstiff.pane.view") != before
    page.keyboard.press("t")
    settled(page)
    assert page.get_attribute("html", "data-theme") == "dark"
    unfold(page)
    page.click("[data-value=symmetric]")
    assert page.inner_text("#matrix-title").startswith("sym K")
    with page.expect_download() as waiting:
        page.click("text=JSON")
    assert json.loads(Path(waiting.value.path()).read_text()) == json.loads(json.dumps(expected))
    page.keyboard.press("i")
    page.wait_for_selector("#report pre:has-text('Principal stiffness')")
    assert page.watch.requests == [path.as_uri()]
    # What it cannot do is refused in words, and what was shown is not passed off as the answer.
    page.keyboard.press("Escape")
    page.keyboard.press("1")
    page.wait_for_selector("body.refused")
    assert "this file shows one posture" in page.inner_text("#verdict-text")


@pytest.mark.parametrize("name", ["five-bar", "3-rps", "6-ups", "delta"])
def test_a_file_of_a_closed_chain_moves_its_drives(name, tmp_path, pages):
    """A slider, a load and the picture of the assembled posture, without a server."""
    chain = cartstiff.load(name)
    path = tmp_path / "chain.html"
    path.write_text(page_text(source_of(chain)), encoding="utf-8")
    page = pages.open(path.as_uri(), offline=True)
    assert "answered here, without a server" in page.inner_text("#left")
    drive = chain.mechanism.actuated[0]
    page.focus(f"#slider-{drive}")
    page.keyboard.press("PageUp")
    page.evaluate(
        "() => window.cartstiff.change({ load_axes: 'body', load: [0, 0, 0, 0.3, -0.2, -0.4] })"
    )
    settled(page)
    found = result(page)
    assert found["q"][drive] != chain.q[drive]
    expected = cartstiff.analyse(chain, found["q"], wrench=[0, 0, 0, 0.3, -0.2, -0.4])
    assert np.abs(expected.q - found["q"]).max() < 1e-12
    kind = "compliance" if name in ("five-bar", "3-rps") else "stiffness"
    there = expected.to_dict()["load"][kind]
    assert np.abs(np.array(found["load"][kind]) - there).max() < 1e-11 * np.abs(there).max()
    places = page.evaluate(
        "() => window.cartstiff.pane.viewer.scene_tree.children.meshcat.children.cartstiff"
        ".children.M.object.matrix.elements"
    )
    assert np.abs(np.array(places[12:15]) - expected.pose[:3, 3]).max() < 1e-6


def test_a_load_that_bends_links_leaves_the_drives_of_a_file_where_they_are(tmp_path, pages):
    """The next state begins with straight links, as on the live page."""
    chain, wrench = cartstiff.load("3-rrr"), [0.0, 0.0, 0.0, 0.0, 0.0, -100.0]
    path = tmp_path / "chain.html"
    path.write_text(page_text(source_of(chain, load=wrench)), encoding="utf-8")
    page = pages.open(path.as_uri(), offline=True)
    drives = list(chain.mechanism.actuated)
    q = np.array(page.evaluate("() => window.cartstiff.numbers.q"))
    assert np.abs(q - chain.q).max() < 1e-12
    assert np.abs(np.subtract(result(page)["q"], q)).max() > 1e-4, "links bend"
    page.focus(f"#slider-{drives[0]}")
    page.keyboard.press("ArrowRight")
    settled(page)
    moved = np.array(page.evaluate("() => window.cartstiff.numbers.q"))
    assert moved[drives[0]] != q[drives[0]]
    assert np.abs(moved - q)[drives[1:]].max() < 1e-12
    expected = cartstiff.analyse(chain, moved, wrench=wrench)
    assert np.abs(expected.q - result(page)["q"]).max() < 1e-10


def test_a_file_that_computes_is_held_in_the_hand(tmp_path, pages):
    """Any slider, load, springs, point and drag of the tool, without a server."""
    arm = cartstiff.load("ur5")
    path = tmp_path / "ur5.html"
    path.write_text(page_text(source_of(arm)), encoding="utf-8")
    page = pages.open(path.as_uri(), offline=True)
    assert "answered here, without a server" in page.inner_text("#left")
    wishes = {
        "load": [1, 2, 3, 40, -50, 60],
        "load_axes": "world",
        "point": [0, 0, 0.1],
        "stiffness": [2e4, 3e4, 2e4, 5e3, 5e3, 4e3],
        "connection": "K",
    }
    page.evaluate("(wishes) => window.cartstiff.change(wishes)", wishes)
    for index, key in ((1, "PageUp"), (4, "PageDown")):
        page.focus(f"#slider-{index}")
        page.keyboard.press(key)
    page.keyboard.press("a")
    page.keyboard.press("r")
    settled(page)
    found = result(page)
    pinned = page.evaluate("() => window.cartstiff.kept[0].state.q")
    assert pinned[1] == pytest.approx(arm.q[1] + 0.1745, abs=1e-3)
    expected = cartstiff.analyse(
        arm.with_springs(wishes["stiffness"]),
        found["q"],
        wrench=wishes["load"],
        load_at=wishes["point"],
        load_axes="world",
    )
    shown = np.array(page.evaluate("() => window.cartstiff.matrix('K')"))
    there = expected.at(se3.pose(translation=wishes["point"])).matrices["K"]
    assert np.abs(shown - there).max() < 1e-11 * np.abs(there).max()
    # The tool's frame stands where the numbers say, and a sweep runs along any joint.
    place = page.evaluate(
        """() => {
            const { viewer } = window.cartstiff.pane;
            const root = viewer.scene_tree.find(["meshcat", "cartstiff"]).object.matrixWorld;
            const M = viewer.scene_tree.find(["meshcat", "cartstiff", "M"]).object.matrixWorld;
            return root.clone().invert().multiply(M).elements;
        }"""
    )
    assert np.allclose(np.array(place).reshape(4, 4).T, expected.pose, atol=1e-6)
    # The sweep, which follows a change by a third of a second: how far the load moves the point.
    page.wait_for_function(
        "() => document.querySelectorAll('#strip .plot .curve:not(.other):not(.key)').length === 1"
    )
    # By numbers, as by hand: the joints follow.
    page.keyboard.press("h")
    settled(page)
    page.click(".posture-card [data-value=tool]")
    page.fill("input[aria-label='tool x m']", "0.5")
    page.keyboard.press("Enter")
    settled(page)
    x = page.evaluate("() => window.cartstiff.numbers.position[0]")
    assert x == pytest.approx(0.5, abs=1e-6)
    # A straight arm is not answered, and nothing new is drawn.
    before = result(page)
    page.evaluate("() => window.cartstiff.move(2, 0)")
    settled(page)
    assert page.inner_text("#verdict-text").startswith("Last valid posture: this posture is too")
    assert result(page) == before
    page.evaluate("() => window.cartstiff.move(2, 1)")
    settled(page)
    assert page.inner_text("#verdict-text").startswith("Positive definite")
    assert not page.locator("#banner").is_visible()


def test_parts_can_be_hidden(tmp_path, pages):
    path = tmp_path / "cubic.html"
    path.write_text(page_text(source_of(cartstiff.load("cubic"), load=LOAD)), encoding="utf-8")
    page = pages.open(path.as_uri(), offline=True)
    visible = """() => {
        const tree = window.cartstiff.pane.viewer.scene_tree;
        const node = tree.find(["meshcat", "cartstiff", "translation ellipsoid"]);
        const shown = (n) => n.object.visible &&
            ((n.children["<object>"] && n.children["<object>"].object.isMesh)
                || Object.values(n.children).some(shown));
        return shown(node);
    }"""
    assert page.evaluate(visible)
    page.click("#show summary")
    page.uncheck("text=Translation ellipsoid")
    settled(page)
    assert not page.evaluate(visible)
    page.check("text=Translation ellipsoid")
    settled(page)
    assert page.evaluate(visible)


def test_a_trajectory_has_a_time_slider(tmp_path, pages):
    arm = cartstiff.load("ur5")
    q = np.array([arm.q + m for m in (0, 0.1, 0.2)])
    source = source_of(arm, trajectory=playback_of(q, np.array([0.0, 0.4, 1.0]), True))
    path = tmp_path / "path.html"
    path.write_text(page_text(source), encoding="utf-8")
    page = pages.open(path.as_uri(), offline=True)
    page.wait_for_selector("#strip .plot .curve-0")
    page.focus("#time")
    page.keyboard.press("End")
    settled(page)
    assert np.allclose(result(page)["q"], q[-1], atol=1e-12)
    assert "1 s" in page.inner_text(".time-label")


def test_a_live_page_gives_itself_as_a_file(serve, pages, tmp_path):
    page = pages.shared(serve("five-bar").url)
    page.focus("#slider-0")
    page.keyboard.press("PageUp")
    settled(page)
    expected = result(page)
    with page.expect_download() as waiting:
        page.click("#export")
    path = tmp_path / "given.html"
    waiting.value.save_as(path)
    other = pages.open(path.as_uri(), offline=True)
    found = result(other)
    assert found["q"] == pytest.approx(expected["q"], abs=1e-12)
    assert [note["code"] for note in found["notes"]] == [note["code"] for note in expected["notes"]]
    for key in ("pose", "wrench"):
        assert np.allclose(found[key], expected[key], atol=1e-12)
    C, there = (np.array(one["compliance"]["B"]) for one in (found, expected))
    assert np.abs(C - there).max() < 1e-12 * np.abs(there).max()
    # Where its loops do not close a curve has the same gap in both, called the same.
    gaps = [one.evaluate(GAPS) for one in (page, other)]
    assert gaps[0] == gaps[1]
    assert gaps[0].count(True) > 20
    for one in (page, other):
        one.wait_for_selector("#strip svg:has-text('loops do not close')")
