"""Modes in the page: the table, the swing, the nodal axis and the response over frequency."""

import pytest
from tools.screenshot import ready, settled

import cartstiff
from tests.browser.test_page import moved, transforms
from tests.support.pages import page_text, source_of


@pytest.fixture
def page(serve, pages):
    """A UR5 with the modes open."""
    page = pages.shared(serve("ur5").url)
    page.evaluate("() => window.cartstiff.change({ mode: 1 })")
    page.wait_for_selector(".modes-card[open] .mode")
    settled(page)
    return page


def hertz(page):
    """Frequencies in the table."""
    texts = page.locator(".mode > .num + .num").all_inner_texts()
    return [float(text.removesuffix(" Hz")) for text in texts]


def test_table_axis_and_response_follow_the_sliders(page):
    elastic = cartstiff.load("ur5")
    assert hertz(page) == pytest.approx(cartstiff.modes(elastic).frequencies, rel=1e-3)
    q = elastic.q + 0.3
    page.evaluate("(q) => window.cartstiff.goTo(q)", q.tolist())
    settled(page)
    assert hertz(page) == pytest.approx(cartstiff.modes(elastic, q).frequencies, rel=1e-3)
    page.evaluate(
        "() => window.cartstiff.change({ load_axes: 'body', load: [0, 0, 0, 0, 0, -2000] })"
    )
    settled(page)
    loaded = cartstiff.modes(elastic, q, wrench=[0, 0, 0, 0, 0, -2000])
    assert hertz(page) == pytest.approx(loaded.frequencies, rel=1e-3)
    assert "under its dead load" in page.inner_text(".modes-card")


FAR = """([path, x]) => {
    const at = window.cartstiff.pane.part(...path.split("/"));
    return Math.abs(at.position.x - x) > 1e-3;
}"""


def test_a_mode_is_played_and_comes_to_rest(page):
    """As a load's way is: between the picture and its ghost, which is one end of the swing."""
    assert "one end of the swing of mode 1" in page.inner_text("#legend")
    still = transforms(page, "mechanism")
    x = page.evaluate("() => window.cartstiff.numbers.result.pose[0][3]")
    page.keyboard.press("v")
    page.wait_for_function(FAR, arg=["M", x])
    page.keyboard.press("v")
    assert page.evaluate("() => window.cartstiff.isPlaying") is False
    assert moved(still, transforms(page, "mechanism")) == []
    # Another posture starts from its own rest.
    page.keyboard.press("v")
    page.wait_for_function(FAR, arg=["M", x])
    page.evaluate("() => window.cartstiff.move(2, 0.4)")
    settled(page)
    assert page.evaluate("() => window.cartstiff.isPlaying") is False
    assert page.evaluate("() => window.cartstiff.numbers.result.q[2]") == 0.4


def test_keys_choose_a_mode_and_its_axis(page):
    axis = transforms(page, "nodal")
    page.locator(".mode :checked").focus()
    page.keyboard.press("ArrowDown")
    page.wait_for_selector(".mode:nth-child(2) :checked", state="attached")
    settled(page)
    assert moved(axis, transforms(page, "nodal"))
    assert page.evaluate("() => document.activeElement.closest('.mode') !== null")
    assert "nodal axis of mode 2" in page.inner_text("#legend")
    page.wait_for_function("() => location.hash.includes('mode=2')")
    page.wait_for_selector("#response .curve-2")
    another = "(old) => document.querySelector('#response svg').ariaLabel !== old"
    top = page.get_attribute("#response svg", "aria-label")
    page.fill("#response input", "20")
    page.locator("#response input").blur()
    page.wait_for_function(another, arg=top)
    top = page.get_attribute("#response svg", "aria-label")
    page.evaluate("() => window.cartstiff.change({ payload: [3, 0, 0, 0.1] })")
    page.wait_for_function(another, arg=top)
    assert "m/N" in page.get_attribute("#response svg", "aria-label")


def test_nothing_runs_where_motion_is_reduced(serve, chromium):
    context = chromium.new_context(viewport={"width": 390, "height": 844}, reduced_motion="reduce")
    page = context.new_page()
    page.goto(serve("stewart-simscape").url + "#mode=3")
    ready(page)
    page.wait_for_selector("#response .curve-2")
    page.keyboard.press("v")  # both ends are shown, still
    assert page.evaluate("() => window.cartstiff.isPlaying") is False
    assert page.evaluate("() => window.cartstiff.legend.rest.mode") == 3
    assert page.evaluate("() => document.documentElement.scrollWidth") == 390
    context.close()


def test_an_exported_page_holds_the_table(pages, tmp_path):
    elastic = cartstiff.load("grasp")  # which the browser does not compute
    file = tmp_path / "grasp.html"
    file.write_text(page_text(source_of(elastic)))
    page = pages.open(file.as_uri(), offline=True)
    page.locator(".modes-card summary").click()
    page.wait_for_selector(".modes-card[open] .mode")
    assert hertz(page) == pytest.approx(cartstiff.modes(elastic).frequencies, rel=1e-3)
    assert "`cartstiff view` shows modes" in page.inner_text(".modes-card")
    assert page.locator("#response").is_hidden()
