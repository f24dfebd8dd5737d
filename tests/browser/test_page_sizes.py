"""The order of the page, its sizes, what fingers hit, and what is said of an old posture."""

import pytest
from tools.look import looked_at
from tools.screenshot import settled

import cartstiff
from tests.browser.conftest import unfold
from tests.support.pages import page_text, source_of

SIZES = ((390, 844), (844, 390), (1024, 768), (1440, 900), (2560, 1440))

#: Widths of the columns, of letters and headings, and where picture and answer are.
BOXES = """() => {
    const box = (what) => document.querySelector(what).getBoundingClientRect();
    const letters = (what) => parseFloat(getComputedStyle(document.querySelector(what)).fontSize);
    return { stage: box("#stage"), left: box(".posture-card"), answer: box(".moved-card"),
        strip: box("#strip"), page: document.documentElement.scrollWidth,
        body: letters("body"), heading: letters("h2") };
}"""
#: Controls that are lower than a finger needs, and fields that cut their digits.
SMALL = """() => [...document.querySelectorAll("button, select, summary, input")]
    .filter((one) => one.checkVisibility() && !one.closest("#pane, .dg"))
    .filter((one) => (/checkbox|radio/.test(one.type) ? one.closest("label") : one)
        .getBoundingClientRect().height < 31.5)
    .map((one) => one.outerHTML.slice(0, 80))"""
CUT = """() => [...document.querySelectorAll("input[type=number]")]
    .filter((one) => one.clientWidth && one.scrollWidth > one.clientWidth)
    .map((one) => `${one.ariaLabel} ${one.value}`)"""


@pytest.fixture
def ur5(serve, pages):
    return pages.shared(serve("ur5").url)


def test_the_picture_is_the_widest_and_under_the_answer_on_a_phone(ur5):
    ur5.evaluate(
        """() => window.cartstiff.change({ load_axes: 'body',
        load: [-123.456, 1e-5, 2e3, -98765.4, 0.5, 1], point: [-0.12345, 0, 0] })"""
    )
    for width, height in SIZES:
        ur5.set_viewport_size({"width": width, "height": height})
        unfold(ur5)
        settled(ur5)
        found = ur5.evaluate(BOXES)
        assert found["page"] <= width
        assert found["stage"]["width"] >= max(found["left"]["width"], found["answer"]["width"])
        assert found["heading"] > found["body"]
        assert ur5.evaluate(CUT) == []
        if width < 700:
            assert ur5.evaluate(SMALL) == []
            assert 0 <= found["stage"]["top"] - found["answer"]["bottom"] < 20
            assert found["strip"]["top"] >= found["stage"]["bottom"]


def test_labels_are_legible_and_keep_off_what_they_name(ur5):
    """On a phone across, too, where the picture has most of the height and swipes scroll."""
    ur5.evaluate(
        "() => window.cartstiff.change({ load_axes: 'body', load: [0, 0, 0, 0, 0, -100] })"
    )
    settled(ur5)
    for size in ((844, 390), (390, 844)):
        assert looked_at(ur5, size) == []
        assert ur5.evaluate("() => document.querySelector('#stage').clientHeight") > 0.5 * size[1]
    assert ur5.evaluate("() => getComputedStyle(document.querySelector('.plot')).touchAction") in (
        "pan-y",
        "auto",
    )


def test_escape_closes_what_is_open(ur5):
    ur5.click("#show summary")
    assert ur5.locator("#show-list").is_visible()
    ur5.keyboard.press("Escape")
    assert not ur5.locator("#show-list").is_visible()


def test_an_answer_that_is_late_leaves_the_last_valid_posture(ur5):
    ur5.evaluate("""() => {
        const { source } = window.cartstiff;
        source.between = null;
        const ask = source.ask.bind(source);
        source.ask = (message) => {
            if (message.do !== "draw") return ask(message);
            source.ask = ask;
            window.go = () => ask(message);
        };
        window.cartstiff.move(2, 0.5);
    }""")
    ur5.wait_for_selector("body.late")
    assert ur5.inner_text("#verdict-text").startswith("Last valid posture")
    assert ur5.evaluate("() => getComputedStyle(document.querySelector('.moved-card')).opacity < 1")
    ur5.evaluate("() => window.go()")
    ur5.wait_for_selector("body:not(.late)")
    settled(ur5)
    assert "Positive definite" in ur5.inner_text("#verdict-text")


def test_what_a_springless_joint_would_have_to_carry_is_said(ur5):
    arm = cartstiff.load("ur5")
    load = [0.0, 0.0, 0.0, 0.0, 0.0, -100.0]
    torque = abs((cartstiff.analyse(arm).jacobian.T @ load)[2])
    stiffness = [1e4, 1e4, 0.0, 1e4, 1e4, 1e4]
    ur5.evaluate(
        "([load, stiffness]) => cartstiff.change({ load, stiffness, load_axes: 'body' })",
        [load, stiffness],
    )
    ur5.wait_for_selector("body.refused")
    said = ur5.inner_text("#verdict-text")
    assert f"elbow_joint has no spring, but the wrench needs {torque:.4g} N m from it" in said


def test_a_file_of_one_posture_has_no_dead_cards(pages, tmp_path):
    file = tmp_path / "cables.html"
    file.write_text(page_text(source_of(cartstiff.load("cable-robot"))), encoding="utf-8")
    page = pages.open(file.as_uri(), offline=True)
    for part in (".setup-card", ".compare-card", "#strip", ".posture-card .buttons"):
        assert not page.locator(part).is_visible(), part
    assert page.locator(".moved-card").is_visible()
