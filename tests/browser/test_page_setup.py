"""Load and springs of the page: what acts is one of three, and what is assumed is counted."""

import json

import numpy as np
import pytest
from tools.screenshot import settled

import cartstiff
from tests.browser.conftest import heard, setup, short
from tests.support.pages import page_text, served, source_of

LOAD = "() => window.cartstiff.state.load"


@pytest.fixture
def opened(serve, pages, tmp_path):
    def open_page(kind, name):
        if kind == "live":
            return pages.shared(serve(name).url)
        file = tmp_path / f"{name}.html"
        file.write_text(page_text(source_of(cartstiff.load(name))), encoding="utf-8")
        return pages.open(file.as_uri())

    return open_page


def chosen(page, which):
    page.click(f"[aria-label=Load] [data-value={which}]")
    settled(page)


def is_chosen(page, which):
    return page.is_checked(f"[aria-label=Load] [data-value={which}] input")


@pytest.mark.parametrize("kind", ["live", "file"])
def test_a_load_of_mine_begins_with_what_acts(kind, opened):
    """Of the paper's platform, whose springs exert 594 N."""
    page = opened(kind, "stewart-gough")
    exerted = cartstiff.analyse(cartstiff.load("stewart-gough"))
    size = np.linalg.norm(exerted.wrench[3:])
    assert size == pytest.approx(594, abs=1)
    setup(page, "load")
    assert is_chosen(page, "springs")
    chosen(page, "mine")
    assert is_chosen(page, "mine")
    state = page.evaluate("() => window.cartstiff.state")
    assert state["load"] == pytest.approx(exerted.wrench, abs=1e-9)  # M's axes are the room's
    assert state["load_axes"] == "world"
    tangent = page.evaluate("() => window.cartstiff.numbers.result.load.stiffness")
    assert np.allclose(tangent, exerted.tangent, rtol=1e-9, atol=1e-7)
    chosen(page, "none")
    assert is_chosen(page, "none")
    assert page.evaluate("() => window.cartstiff.numbers.result.wrench") == [0.0] * 6
    chosen(page, "springs")
    wrench = page.evaluate("() => window.cartstiff.numbers.result.wrench")
    assert wrench == pytest.approx(exerted.wrench, abs=1e-9)


@pytest.mark.parametrize("kind", ["live", "file"])
def test_a_typed_force_is_along_the_room_as_the_buttons_are(kind, opened):
    page = opened(kind, "ur5")
    setup(page, "load")
    page.fill("input[aria-label='fx N']", "100")
    page.keyboard.press("Tab")
    settled(page)
    assert is_chosen(page, "mine")
    assert "along the room's axes" in page.inner_text(".setup-card .panel:not([hidden])")
    arm = cartstiff.load("ur5")
    expected = cartstiff.analyse(arm, wrench=[0, 0, 0, 100, 0, 0], load_axes="world")
    wrench = page.evaluate("() => window.cartstiff.numbers.result.wrench")
    assert wrench == pytest.approx(expected.wrench, abs=1e-9)
    page.click("[aria-label='Axes of the load'] [data-value=body]")
    settled(page)
    assert "along the tool's axes" in page.inner_text(".setup-card .panel:not([hidden])")
    wrench = page.evaluate("() => window.cartstiff.numbers.result.wrench")
    assert wrench == pytest.approx([0, 0, 0, 100, 0, 0], abs=1e-9)
    chosen(page, "none")
    assert page.evaluate("() => window.cartstiff.numbers.moved") is None


@pytest.mark.parametrize("kind", ["live", "file"])
@pytest.mark.parametrize("doubt", ["illustrative, not measured", "assumed"])
def test_springs_that_nobody_measured_are_counted(kind, doubt, pages, tmp_path):
    """On the page, and in what is saved of it."""
    name = "ur5" if doubt != "assumed" else "ur3"
    source = short(source_of(cartstiff.load(name)))
    server = served(source) if kind == "live" else None
    file = tmp_path / "page.html"
    file.write_text(page_text(source), encoding="utf-8")
    page = pages.open(file.as_uri() if server is None else server.url)
    assert page.inner_text(".doubt").startswith(f"Springs {doubt}")
    setup(page, "springs")
    page.fill("input[aria-label^='elbow_joint N']", "50000")
    page.keyboard.press("Tab")
    settled(page)
    assert page.inner_text(".doubt").startswith(f"5 of 6 springs {doubt}")
    if doubt == "assumed":
        named = page.inner_text(".doubt").split("taken for ")[1].split(" and says")[0]
        assert named.split(", ") == [n for n in source.elastic.names if n != "elbow_joint"]
    page.wait_for_selector("#strip .plot .curve")
    page.wait_for_function("() => !document.querySelector('#strip .plot.stale')")
    for select, kind_of_file in (("Save the picture", "png1"), ("Save the plot", "csv")):
        with page.expect_download() as waiting:
            page.select_option(f"select[aria-label='{select}']", kind_of_file)
        if kind_of_file == "csv":
            assert f"# 5 of 6 springs {doubt}" in waiting.value.path().read_text()
    for i, spring in enumerate(source.elastic.names):
        page.fill(f"input[aria-label^='{spring} N']", f"{10000 + i + 17}")
        page.keyboard.press("Tab")
        settled(page)
    assert page.is_hidden(".doubt")
    page.close()  # before its server, which it would look for
    if server is not None:
        server.close()


def test_a_link_is_of_its_mechanism(serve, pages):
    """Of another one it is not applied before the user says so; of a changed one with a word."""
    page = pages.shared(serve("ur5").url)
    wanted = [0.0, 0.0, 0.0, 0.0, 0.0, -100.0]
    page.evaluate("(load) => window.cartstiff.change({ load })", wanted)
    page.wait_for_function("() => location.hash.startsWith('#load=0,0,0,0,0,-100&')")
    link = page.evaluate("() => location.hash")
    again = pages.open(serve("ur5").url + link)
    assert again.is_hidden("#banner")
    assert again.evaluate(LOAD) == wanted
    other = pages.open(serve("ur10").url + link)
    q = cartstiff.load("ur10").q.tolist()
    assert "of ur5, and this page shows ur10: it was not applied" in other.inner_text("#banner")
    assert other.evaluate(LOAD) is None
    assert other.evaluate("() => window.cartstiff.numbers.result.q") == q
    other.click("#banner button:has-text('Apply it here')")
    settled(other)
    assert other.is_hidden("#banner")
    assert other.evaluate(LOAD) == wanted
    other.evaluate("(link) => { location.hash = link; }", link.replace("-100", "-50"))
    other.wait_for_selector("#banner:has-text('not applied')")
    assert other.evaluate(LOAD) == wanted
    server = served(short(source_of(cartstiff.load("ur5").with_springs(1e5))))
    stiffer = pages.open(server.url + link)
    assert "made of another ur5" in stiffer.inner_text("#banner")
    assert stiffer.evaluate(LOAD) == wanted
    stiffer.close()
    server.close()


def test_a_link_says_that_the_load_of_the_command_is_gone(pages):
    server = served(short(source_of(cartstiff.load("stewart-gough"), load=np.ones(6))))
    page = pages.open(server.url)
    setup(page, "load")
    chosen(page, "springs")
    page.wait_for_function("() => location.hash.includes('load=none')")
    again = pages.open(server.url + page.evaluate("() => location.hash"))
    assert again.evaluate(LOAD) is None
    page.close()
    again.close()
    server.close()


@pytest.mark.parametrize("kind", ["live", "file"])
@pytest.mark.parametrize("name", ["panda", "ur5"])
def test_zero_is_the_nearest_posture_that_there_is(kind, name, opened):
    """A Panda's fourth joint does not reach 0; a UR5 is singular there."""
    page = opened(kind, name)
    page.click(".posture-card button:has-text('Zero')")
    settled(page)
    assert page.evaluate("() => window.cartstiff.refused") is None
    q = np.array(page.evaluate("() => window.cartstiff.numbers.result.q"))
    arm = cartstiff.load(name)
    if name == "panda":
        heard(page, "zero is beyond the limits of panda_joint4")
        assert q[3] == arm.limits["panda_joint4"][1]
        assert not q[[0, 1, 2, 4, 5, 6]].any()
    elif kind == "live":
        assert not q.any()
        assert json.dumps(page.evaluate("() => window.heard")) == "[]"
    else:
        heard(page, "does not compute the singular posture at zero")
        assert 0 < np.abs(q).max() < 0.1
        assert np.allclose(q / arm.q, q[0] / arm.q[0])
