"""What a stranger asks of a page: each answer is there after three clicks at most."""

import numpy as np
import pytest
from tools.screenshot import ready, settled

import cartstiff
from tests.support.pages import served, source_of
from tests.support.printed import better_of, words_of_better

SIDEWAYS = np.array([0.0, 0.0, 0.0, 100.0, 0.0, 0.0])
MILLI = {"m": 1e3, "mm": 1.0, "µm": 1e-3}


class Stranger:
    """Somebody who clicks, and is counted."""

    def __init__(self, page):
        self.page, self.clicks = page, 0

    def click(self, what):
        self.page.click(what)
        self.clicks += 1
        assert self.clicks <= 3
        settled(self.page)

    def reads(self, what):
        return self.page.inner_text(what).replace("\u2212", "-")

    @property
    def millimetres(self):
        """How far the tip moves."""
        value, unit = self.reads(".moved-head").split(" moves ")[1].split(" ")[:2]
        return float(value) * MILLI[unit]


@pytest.fixture
def stranger(serve, pages):
    return Stranger(pages.shared(serve("ur5").url))


def pushed(arm, q=None):
    return cartstiff.analyse(arm, q, wrench=SIDEWAYS, load_axes="world")


def way(result):
    """How far (mm) the tip moves, by the Jacobian where no load acts and by the tangent."""
    return 1e3 * np.linalg.norm(np.linalg.solve(result.tangent, result.wrench)[3:])


def test_how_far_does_the_tip_move_under_100_n_sideways(stranger):
    stranger.click(".first-load >> text=along x")
    assert stranger.millimetres == pytest.approx(way(pushed(cartstiff.load("ur5"))), rel=1e-3)


def test_which_joint_is_to_be_stiffened(stranger):
    """The one that, twice as stiff, leaves least of the motion."""
    stranger.click(".first-load >> text=along x")
    arm = cartstiff.load("ur5")
    result = pushed(arm)
    J, k = result.jacobian, arm.springs.stiffness

    def left(factor):
        return np.linalg.norm((J @ ((J.T @ result.wrench) / (factor * k)))[3:])

    best = min(range(6), key=lambda j: left(np.where(np.arange(6) == j, 2.0, 1.0)))
    assert stranger.page.inner_text(".moved-name >> nth=0") == arm.names[best]


def test_whether_a_or_k_matters(stranger):
    assert stranger.reads(".which-card summary .dim") == "the same without a load"
    stranger.click(".first-load >> text=along x")
    found = pushed(cartstiff.load("ur5")).matrices
    scale = np.sqrt(np.abs(np.diag(found["A"])))
    each = np.array([found[name] for name in "ABKF"])
    apart = 100 * np.max((each.max(axis=0) - each.min(axis=0)) / np.outer(scale, scale))
    shown = float(stranger.reads(".which-card summary .dim").split("up to ")[1].split(" ")[0])
    assert shown == pytest.approx(apart, rel=0.06)


def test_the_softest_direction(stranger):
    result = cartstiff.analyse(cartstiff.load("ur5"))
    values, axes = np.linalg.eigh(np.linalg.inv(result.tangent)[3:, 3:])
    said = stranger.reads(".softest")
    assert float(said.split(" ")[1]) == pytest.approx(1e-3 / values[-1], rel=1e-3)
    up = abs(result.pose[2, :3] @ axes[:, -1])
    assert f"almost vertical, {np.degrees(np.arccos(up)):.0f}° off z" in said


def test_a_better_posture(stranger):
    """The page previews the posture that Python finds, says what Python says of it, goes there."""
    stranger.click(".first-load >> text=downwards")
    before = stranger.millimetres
    arm = cartstiff.load("ur5")
    found = better_of(arm, wrench=[0, 0, 0, 0, 0, -100], load_axes="world")
    for way in ("Leave it", "Take it"):
        stranger.page.click("text=Better posture")
        stranger.page.wait_for_selector(".found:has-text('less displacement')")
        settled(stranger.page)
        for sentence in words_of_better(found, arm):
            assert sentence.replace(" deg", "°") in stranger.reads(".found")
        # It stands there as a second mechanism, and nothing has moved.
        ghost = stranger.page.evaluate("() => window.cartstiff.shown.ghost")
        assert ghost == pytest.approx(found.q, abs=1e-9)
        assert stranger.millimetres == before
        stranger.page.click(f"text={way}")
        settled(stranger.page)
        assert stranger.page.evaluate("() => window.cartstiff.shown.ghost") is None
        assert (stranger.millimetres == before) == (way == "Leave it")
    q = np.array(stranger.page.evaluate("() => window.cartstiff.numbers.result.q"))
    assert q == pytest.approx(found.q, abs=1e-9)
    poses = [arm.mechanism.at(x).pose for x in (arm.q, q)]
    assert poses[0] == pytest.approx(poses[1], abs=1e-7)
    assert stranger.millimetres < 0.9 * before
    stranger.page.keyboard.press("u")
    settled(stranger.page)
    assert stranger.millimetres == before


def test_a_link_outlives_a_restart_and_holds_no_secret(pages):

    arm = cartstiff.load("ur5")
    server = served(source_of(arm))
    port, secret = server.server.port, server.url.split("/")[3]
    page = pages.open(server.url)
    page.watch.without_server()
    page.focus("#slider-2")
    page.keyboard.press("ArrowRight")
    settled(page)
    q = page.evaluate("() => window.cartstiff.numbers.result.q")
    page.evaluate("() => { navigator.clipboard.writeText = async (x) => { window.copied = x; }; }")
    page.click("text=Link")
    link = page.evaluate("() => window.copied")
    assert secret not in link
    page.goto("about:blank")
    page.goto(link)  # this browser was let in before
    ready(page)
    assert page.evaluate("() => window.cartstiff.numbers.result.q") == q
    server.close()
    server = served(source_of(arm), port=port)
    try:
        # The page that was open says how one gets in again, and keeps its state.
        page.wait_for_selector("#banner a:has-text('Enter')")
        page.click("#banner a")
        page.fill("input", server.url)
        page.click("button")
        ready(page)
        assert page.evaluate("() => window.cartstiff.numbers.result.q") == q
        assert page.url.startswith(server.url)
    finally:
        page.goto("about:blank")
        server.close()
