"""What people come to the page for, in counted actions of a hand."""

import json
import re
import subprocess
import sys

import numpy as np
import pytest
from tools.screenshot import settled

import cartstiff
from cartstiff.geometry import from_bilinear_map, se3
from tests.support.pages import message_of, page_text, playback_of, served, source_of, tab_of
from tests.support.read_units import si

DOWN = [0.0, 0.0, 0.0, 0.0, 0.0, -100.0]
MINE = from_bilinear_map(lambda x, y: 0.25 * se3.bracket(x, y), "quarter", meaning="is mine")
TO_REST = "(state) => window.cartstiff.change({ load: null, ...state })"


class Hand:
    """Acts on a page, and is counted."""

    def __init__(self, page):
        self.page, self.actions = page, 0

    def click(self, what):
        self.page.click(what)
        self.actions += 1
        settled(self.page)

    def drag(self, what, value):
        """Move a slider."""
        self.page.locator(what).evaluate(
            "(node, x) => { node.value = x; node.dispatchEvent(new Event('input')); }", value
        )
        self.actions += 1
        settled(self.page)

    def reads(self, what):
        return self.page.inner_text(what).replace("\u2212", "-")


@pytest.fixture
def hand(serve, pages):
    return Hand(pages.shared(serve("ur5").url))


def shown(page, state):
    page.evaluate(TO_REST, state)
    settled(page)


# -- which connection?
# --------------------------------------------------------------------------------------

WHICH = ".which-card"
AXES = {"mx": 0, "my": 1, "mz": 2, "fx": 3, "fy": 4, "fz": 5}
AXES |= {"rx": 0, "ry": 1, "rz": 2, "x": 3, "y": 4, "z": 5}


def cells(page):
    """Values in SI units by connection, and the cell, of each row of the table."""
    names = [x.split("\n")[0][1:2] for x in page.locator(".which thead th").all_inner_texts()]
    for row in page.locator(".which tbody tr").all():
        name, unit = row.locator("th").inner_text().split("\n")
        i, j = (AXES[x] for x in name.strip().split(" per "))
        texts = [x.replace("\u2212", "-") for x in row.locator("td").all_inner_texts()]
        last = 0.5 * 10.0 ** -len(texts[0].partition(".")[2])
        numbers = dict(zip(names, map(float, texts), strict=True))
        yield (i, j), si(unit), last, numbers


def test_four_connections_together_in_one_action(hand):
    page = hand.page
    shown(page, {"load": DOWN, "load_axes": "world"})
    hand.click(f"{WHICH} > summary")
    assert hand.actions == 1
    arm = cartstiff.load("ur5")
    found = cartstiff.analyse(arm, wrench=DOWN, load_axes="world").matrices
    K = np.array([found[name] for name in "ABKF"])
    spread = (K.max(axis=0) - K.min(axis=0)) / np.sqrt(np.outer(np.diag(K[0]), np.diag(K[0])))
    rows = list(cells(page))
    assert [spread[at] for at, *_ in rows] == pytest.approx(np.sort(spread.ravel())[:-7:-1])
    for at, unit, last, numbers in rows:
        for name, x in numbers.items():
            assert x == pytest.approx(found[name][at] / unit, abs=1.01 * last)
    # The largest by name and number, and why.
    most = hand.reads(".which-card p.most").replace("\n", "")
    assert most.startswith("Largest difference: force along x per rotation about z, KK - KA = ")
    value, unit = most.split(" = ")[1].split(",")[0].split(" ")
    difference = found["K"][3, 2] - found["A"][3, 2]
    assert float(value) * si(unit) == pytest.approx(difference, rel=1e-3)
    assert "lets the load turn with the body" in hand.reads(".which-card .why")
    assert "take KK: its force and moment keep" in hand.reads(".which-card .take")
    assert page.locator(".which .cell.most").count() == 2


def test_the_difference_grows_with_the_load_from_zero(hand):
    page = hand.page
    hand.click(f"{WHICH} > summary")
    assert "no difference" in hand.reads(".which-card p.most")
    assert page.locator(".which tbody tr").count() == 0
    sizes = []
    for times in (0.5, 1, 2):
        hand.drag(".which-card input", times)
        assert page.evaluate("() => window.cartstiff.state.load[5]") == pytest.approx(-100 * times)
        said = hand.reads(".which-card summary span")
        sizes.append(float(said.split("up to ")[1].split(" ")[0]))
    assert np.divide(sizes, sizes[1]) == pytest.approx([0.5, 1, 2], rel=0.06)
    hand.drag(".which-card input", 0)
    assert "no difference" in hand.reads(".which-card p.most")


def test_an_own_connection_is_beside_the_others_in_a_file_too(pages, tmp_path):
    arm = cartstiff.load("ur5")
    source = source_of(arm, load=np.array(DOWN), load_axes="world", connections=(MINE,))
    file = tmp_path / "arm.html"
    file.write_text(page_text(source), encoding="utf-8")
    page = pages.open(file.as_uri(), offline=True)
    hand = Hand(page)
    q = [*arm.q[:2], arm.q[2] + 0.2, *arm.q[3:]]
    point, session = (0.1, -0.2, 0.3), tab_of(source)
    for quantity in ("stiffness", "compliance"):
        page.evaluate(
            "(state) => window.cartstiff.change(state)",
            {"q": q, "point": point, "quantity": quantity},
        )
        settled(page)
        result = cartstiff.analyse(arm, q, wrench=DOWN, load_axes="world", load_at=point)
        Ad = se3.adjoint(se3.pose(np.eye(3), point))
        expected = Ad.T @ result.tensor(MINE).matrix @ Ad
        if quantity == "compliance":
            expected = np.linalg.inv(expected)
        state = session.start.model_copy(
            update={"q": q, "point": point, "quantity": quantity, "load_at": None}
        )
        live = session.numbers(session.result(state), state)["own"]["quarter"]
        own = page.evaluate("() => window.cartstiff.matrix('quarter')")
        size = np.abs(expected).max()
        assert np.array(live) == pytest.approx(expected, abs=1e-9 * size)
        assert np.array(own) == pytest.approx(expected, abs=1e-9 * size)
    # What if is answered as the library answers it.
    to = [None, *(2.0 * arm.springs.stiffness[1:]).tolist()]
    own = page.evaluate("(to) => window.cartstiff.ask({ do: 'stiffer', to })", to)
    asked = {"id": 1, "do": "stiffer", "state": state.model_dump(), "to": to}
    live = session.answer(message_of(json.dumps(asked))).data
    assert own["here"] == pytest.approx(live["here"], rel=1e-9)
    assert own["sizes"][0] is None
    assert own["sizes"][1:] == pytest.approx(live["sizes"][1:], rel=1e-9)
    assert own["order"][0] == live["order"][0]
    hand.click(f"{WHICH} > summary")
    assert "quarter" in page.locator(".which thead").inner_text()


def test_connections_that_cannot_be_shown_are_refused():
    arm = cartstiff.load("ur5")
    with pytest.raises(cartstiff.InputError, match=r"two connections have this name.*quarter"):
        source_of(arm, connections=(MINE, MINE))
    flat = cartstiff.analyse(arm).flat_connection()
    with pytest.raises(cartstiff.InputError, match=r"two connections have this name.*F"):
        source_of(arm, connections=(flat,))
    own = cartstiff.geometry.from_symbols(flat.symbols, "chart", left_invariant=False)
    with pytest.raises(cartstiff.InputError, match="known at one posture only"):
        cartstiff.show(arm, connections=[own])


# -- what if a spring were stiffer?
# --------------------------------------------------------------------------------------

WHAT_IF = ".what-if-card"
MILLI = {"mm": 1.0, "µm": 1e-3}


def ways(arm, factors, load=DOWN):
    """Displacements (mm), by the Jacobian and the springs' own deflections."""
    result = cartstiff.analyse(arm, wrench=load, load_axes="world")
    J, k = result.jacobian, arm.springs.stiffness
    curved = result.tangent - np.linalg.inv(J @ np.diag(1 / k) @ J.T)
    for by in factors:
        K = np.linalg.inv(J @ np.diag(1 / (k * by)) @ J.T) + curved
        yield 1e3 * np.linalg.norm(np.linalg.solve(K, result.wrench)[3:])


def answers(page):
    """By spring: millimetres and per cent."""
    page.wait_for_selector(f"{WHAT_IF} output")
    for row in page.locator(".what-if > div").all():
        name, text = row.inner_text().replace("\u2212", "-").split("\n")
        value, unit = text.split(": ")[1].split(",")[0].split(" ")
        rest = text.split(", ")[1]
        yield name, float(value) * MILLI[unit], 0 if "no" in rest else float(rest.split(" ")[0])


def test_the_largest_gain_by_one_spring_in_one_action(hand):
    page, arm = hand.page, cartstiff.load("ur5")
    shown(page, {"load": DOWN, "load_axes": "world"})
    hand.click(f"{WHAT_IF} > summary")
    assert hand.actions == 1
    (here,) = ways(arm, [np.ones(6)])
    stiffer = dict(zip(arm.names, ways(arm, np.eye(6) + 1.0), strict=True))
    found = list(answers(page))
    assert [size for _, size, _ in found] == pytest.approx(sorted(stiffer.values()), rel=6e-3)
    for name, size, percent in found:
        assert size == pytest.approx(stiffer[name], rel=6e-3)
        assert percent == pytest.approx(100 * (stiffer[name] / here - 1), rel=0.06, abs=0.06)
    assert found[0][0] in hand.reads(f"{WHAT_IF} summary span")


def test_a_slider_changes_its_spring_alone(hand):
    page, arm = hand.page, cartstiff.load("ur5")
    shown(page, {"load": DOWN, "load_axes": "world"})
    hand.click(f"{WHAT_IF} > summary")
    page.wait_for_selector(f"{WHAT_IF} output")
    hand.drag("#what-if-2", -1)
    factors = np.where(np.arange(6) == 2, 0.5, 1.0)
    page.wait_for_selector(f"{WHAT_IF} output:has-text('0.5 × as stiff')")
    (here, softer) = ways(arm, [np.ones(6), factors])
    (found,) = [one for one in answers(page) if one[0] == arm.names[2]]
    assert found[1:] == pytest.approx((softer, 100 * (softer / here - 1)), rel=0.02)
    assert page.evaluate("() => window.cartstiff.state.stiffness") == pytest.approx(
        factors * arm.springs.stiffness
    )
    hand.click(f"{WHAT_IF} button")
    assert page.evaluate("() => window.cartstiff.state.stiffness") is None
    shown(page, {"load": None})
    page.wait_for_selector(f"{WHAT_IF} summary:has-text('needs a load')")


# -- from Python
# --------------------------------------------------------------------------------------


def test_sliders_arrows_and_functions_of_a_script(pages):
    with cartstiff.show(cartstiff.load("hexapod"), open_browser=False) as shown:
        height = shown.slider("height", 0.7, 0.8, value=0.75)

        @height.on_change
        def lift(z):
            shown.move([0, 0, z, 0, 0, 0])

        @shown.on_move
        def upwards(posture):
            shown.arrow("up", posture.pose[:3, 3], [0, 0, 0.2])

        page = pages.open(shown.url)
        page.wait_for_selector(".additions-card .slider")
        page.locator("#slider-own-0").evaluate(
            "(node) => { node.value = 0.77; node.dispatchEvent(new Event('input')); }"
        )
        page.wait_for_function("() => window.cartstiff.numbers.result.q[2] === 0.77")
        assert height.value == 0.77
        # The arrow stands where the tool is, and is as long as its vector.
        page.wait_for_function("""() => {
            const arrow = window.cartstiff.pane.part("own", "0");
            const tool = window.cartstiff.numbers.result.pose;
            const [x, y, z] = [12, 13, 14].map((i) => arrow?.matrix.elements[i]);
            return arrow && Math.hypot(x - tool[0][3], y - tool[1][3], z - tool[2][3]) < 1e-6
                && Math.abs(arrow.scale.x - 0.2) < 1e-6;
        }""")
        # It outlives a picture in another theme.
        page.keyboard.press("t")
        settled(page)
        assert page.evaluate("() => window.cartstiff.pane.part('own', '0').visible")
        page.context.close()  # what it still asks for, it asks a server that runs


# -- where is it worst, is it good enough, and what else has a number of actions
# --------------------------------------------------------------------------------------


def test_the_worst_over_a_trajectory_in_no_action_and_what_is_allowed(pages):

    arm, t = cartstiff.load("ur5"), np.linspace(0, 1, 13)
    way = np.outer(np.sin(2.2 * t), [0.5, 0.4, -0.6, 0, 0.3, 0])
    playback = playback_of(arm.q + way, 4 * t, timed=True)
    server = served(source_of(arm, load=np.array(DOWN), load_axes="world", trajectory=playback))
    try:
        page = pages.open(server.url)
        page.wait_for_selector("#strip .worst:not([hidden])")
        sizes = []
        for q in playback.q:
            result = cartstiff.analyse(arm, q, wrench=DOWN, load_axes="world")
            sizes.append(1e3 * np.linalg.norm(np.linalg.solve(result.tangent, result.wrench)[3:]))
        worst = int(np.argmax(sizes))
        assert 0 < worst < 12
        said = page.inner_text("#strip .worst")
        assert said == f"\u25bc worst {sizes[worst]:.3g} mm at {4 * t[worst]:.4g} s"
        assert page.locator("#strip .flag").count() == 1
        hand = Hand(page)
        hand.click("#strip .worst")
        assert page.evaluate("() => window.cartstiff.numbers.result.q") == pytest.approx(
            playback.q[worst]
        )
        # An allowed displacement between the least and the largest.
        allowed = round(float(np.mean([min(sizes), max(sizes)])), 3)
        hand.click(".enough-card > summary")
        page.fill("#allowed", str(allowed))
        page.keyboard.press("Enter")
        settled(page)
        assert page.locator("#strip .gap.outside").count() == np.sum(np.array(sizes) > allowed)
        assert page.locator("#strip .allowed").count() == 1
        said = hand.reads(".enough-card output")
        assert said.startswith("\u2715 Outside")
        newtons = float(said.split("along this one is ")[1].split(" ")[0])
        assert newtons == pytest.approx(100 * allowed / sizes[worst], rel=6e-3)
        # At rest the equilibrium says it, with what else would end it first.
        page.wait_for_selector(".enough-card output:has-text('by the equilibrium')")
        held = cartstiff.capacity(
            arm, playback.q[worst], wrench=DOWN, load_axes="world", displacement=allowed / 1e3
        )
        assert held.by_equilibrium.kind == "displacement"
        said = hand.reads(".enough-card output").split("to first order); ")[1]
        assert float(said.split(" ")[0]) == pytest.approx(100 * held.factor, rel=6e-3)
        assert said.endswith("until the allowed displacement is reached.")
        label = """() => window.cartstiff.pane.part("callout")
            .children[0].userData.label.text"""
        page.wait_for_function(f"() => ({label})().endsWith('\u2715')")
        page.evaluate("(q) => window.cartstiff.goTo(q)", playback.q[0].tolist())
        settled(page)
        page.wait_for_function(f"() => ({label})().endsWith('\u2713')")
        assert hand.reads(".enough-card summary span") == "\u2713 inside"
    finally:
        page.goto("about:blank")
        server.close()


#: Brightness of each place of the tube in the picture that follows the plot; the worst place.
TRACE = """() => {
    const { pane } = window.cartstiff;
    const [group] = pane.at("trace").children;
    const tube = group.children[0].geometry.attributes;
    const sides = 9;
    return { light: Array.from({ length: tube.color.count / sides }, (_, i) =>
            tube.color.getX(sides * i) + tube.color.getY(sides * i) + tube.color.getZ(sides * i)),
        words: pane.part("trace", "worst").children[0].userData.label.text,
        worst: (() => {
            const { geometry } = group.children.at(-1);
            geometry.computeBoundingSphere();
            return geometry.boundingSphere.center.toArray();
        })(),
        bar: [...document.querySelectorAll("#colour-bar span, #colour-bar .kind")]
            .map((node) => node.textContent) };
}"""


def test_a_trajectory_is_a_trace_in_colours_where_bright_is_good(pages):

    arm, t = cartstiff.load("ur5"), np.linspace(0, 1, 13)
    q = arm.q + np.outer(np.sin(2.2 * t), [0.5, 0.4, -0.6, 0, 0.3, 0])
    found = [cartstiff.analyse(arm, x, wrench=DOWN, load_axes="world") for x in q]
    sizes = np.array(
        [1e3 * np.linalg.norm(np.linalg.solve(r.tangent, r.wrench)[3:]) for r in found]
    )
    worst = int(np.argmax(sizes))
    playback = playback_of(q, 4 * t, timed=True)
    server = served(source_of(arm, load=np.array(DOWN), load_axes="world", trajectory=playback))
    try:
        page = pages.open(server.url)
        page.wait_for_function("() => window.cartstiff.trace")
        settled(page)
        trace = page.evaluate(TRACE)
        assert np.array_equal(np.argsort(trace["light"]), np.argsort(-sizes))
        assert trace["words"] == f"worst {sizes[worst]:.3g} mm"
        assert trace["worst"] == pytest.approx(found[worst].pose[:3, 3], abs=1e-4)
        assert trace["bar"][0] == "deflection along the way, mm, bright is good"
        assert [float(x) for x in trace["bar"][-2:]] == pytest.approx(
            [sizes.min(), sizes.max()], rel=1e-3
        )
        # Inside what is allowed all is brighter than outside.
        allowed = round(float(np.median(sizes)), 3)
        page.evaluate("(x) => window.cartstiff.change({ allowed: x })", allowed / 1e3)
        settled(page)
        trace = page.evaluate(TRACE)
        light = np.array(trace["light"])
        assert light[sizes <= allowed].min() > light[sizes > allowed].max() + 0.3
        assert [x.strip("\u25cf ") for x in trace["bar"] if "mm" in x] == [
            f"within {allowed:.3g} mm",
            f"beyond {allowed:.3g} mm",
        ]
        page.click("summary:has-text('Show')")
        page.get_by_text("Way along the plot").click()
        settled(page)
        assert page.evaluate("() => window.cartstiff.trace") is None
    finally:
        page.goto("about:blank")
        server.close()


def test_a_map_names_its_axes_and_value_and_marks_best_and_worst(hand):
    page = hand.page
    shown(page, {"load": DOWN, "load_axes": "world"})
    # The plot follows the question.
    assert page.evaluate("() => window.cartstiff.plot.of") == "deflection"
    page.select_option("select[aria-label='Along what']", "sweep:1")
    page.select_option("select[aria-label='And along what']", "2")
    page.wait_for_function("() => document.querySelectorAll('.heat g rect').length === 48 * 48")
    page.wait_for_selector("#strip .best:not([hidden])")
    page.wait_for_function("() => window.cartstiff.waiting.size === 0")
    settled(page)
    arm = cartstiff.load("ur5")
    words = page.locator(".plot.heat text").all_text_contents()
    assert words.count(arm.names[1]) == words.count(arm.names[2]) == 1
    assert "deflection [mm]: bright is good" in words
    assert page.locator(".plot.heat .flag").count() == 2

    def size():
        q = page.evaluate("() => window.cartstiff.numbers.result.q")
        result = cartstiff.analyse(arm, q, wrench=DOWN, load_axes="world")
        return 1e3 * np.linalg.norm(np.linalg.solve(result.tangent, result.wrench)[3:])

    # The colour where it stands: bright at the best, dark at the worst.
    light = {}
    for which in ("worst", "best"):
        said = float(hand.reads(f"#strip .{which}").split(" ")[2])
        hand.click(f"#strip .{which}")
        assert size() == pytest.approx(said, rel=6e-3)
        light[which] = page.evaluate(
            """() => {
                const ring = document.querySelector(".heat .here").getBoundingClientRect();
                const [x, y] = [ring.x + ring.width / 2, ring.y + ring.height / 2];
                const cell = [...document.querySelectorAll(".heat g rect")].find((rect) => {
                    const box = rect.getBoundingClientRect();
                    return x >= box.left && x <= box.right && y >= box.top && y <= box.bottom;
                });
                const [r, g, b] = getComputedStyle(cell).fill.match(/\\d+/g).map(Number);
                return r + g + b;
            }"""
        )
    assert light["best"] > 400 > 250 > light["worst"]
    # What is allowed divides it.
    page.evaluate("() => window.cartstiff.change({ allowed: 2e-3 })")
    settled(page)
    words = page.locator(".plot.heat text").all_text_contents()
    assert any("m]: bright: within 2 mm, " in one for one in words)
    # Without a load the question is another one.
    shown(page, {"load": None})
    assert page.evaluate("() => window.cartstiff.plot.of") == "translation"


def test_200_n_along_x_and_read_then_undo(hand):
    """Two actions, the number and its key; one takes it back."""
    page = hand.page
    before = page.evaluate("() => window.cartstiff.state.load")
    page.fill("input[aria-label='fx N']", "200")
    page.keyboard.press("Enter")
    settled(page)
    arm = cartstiff.load("ur5")
    result = cartstiff.analyse(arm, wrench=[0, 0, 0, 200, 0, 0], load_axes="world")
    way = 1e3 * np.linalg.norm(np.linalg.solve(result.tangent, result.wrench)[3:])
    value, unit = hand.reads(".moved-head b").split("\n")[0].split(" ")
    assert float(value) * MILLI[unit] == pytest.approx(way, rel=1e-3)
    page.evaluate("() => document.activeElement.blur()")
    page.keyboard.press("u")
    settled(page)
    assert page.evaluate("() => window.cartstiff.state.load") == before


def test_two_postures_at_one_scale_in_two_actions(hand):
    page = hand.page
    hand.click("button:has-text('Keep as 1')")
    hand.click(".compare-card label:has-text('side by side')")
    assert hand.actions == 2
    q = page.evaluate("() => window.cartstiff.state.q")
    page.evaluate("(q) => window.cartstiff.goTo(q)", [*q[:2], q[2] + 0.5, *q[3:]])
    page.wait_for_function("() => window.cartstiff.rows[0].store?.legend")
    settled(page)
    legends = page.evaluate(
        "() => [window.cartstiff, window.cartstiff.rows[0].store].map((one) => "
        "[one.legend.measures, one.legend.per_length])"
    )
    assert legends[0] == legends[1]
    page.click(".compare-card label:has-text('side by side')")


def test_the_state_as_a_file_after_the_server_has_ended_in_one_action(pages, tmp_path):

    server = served(source_of(cartstiff.load("ur5")))
    page = pages.open(server.url)
    page.watch.without_server()
    page.evaluate("() => { window.cartstiff.source.rest = 100; }")
    page.wait_for_function("() => window.cartstiff.local !== null")
    page.focus("#slider-1")
    page.keyboard.press("ArrowRight")
    page.wait_for_selector("#export[data-prepared]")
    server.close()
    page.wait_for_selector("#banner:has-text('does not answer')")
    # Another posture than that at which the file was asked for.
    page.focus("#slider-2")
    page.keyboard.press("ArrowRight")
    page.wait_for_function("() => window.cartstiff.busy === null")
    assert page.locator("button:has-text('Link')").is_disabled()
    q = page.evaluate("() => window.cartstiff.numbers.result.q")
    with page.expect_download() as waiting:
        page.click("#export")
    file = tmp_path / "state.html"
    waiting.value.save_as(file)
    again = pages.open(file.as_uri(), offline=True)
    assert again.evaluate("() => window.cartstiff.numbers.result.q") == pytest.approx(q, abs=1e-12)


def test_a_picture_for_a_column_of_85_mm_in_two_actions(hand, tmp_path):
    """The list, and its entry."""
    image = pytest.importorskip("PIL.Image")
    page = hand.page
    shown(page, {"load": DOWN, "load_axes": "world"})
    for is_clear in (False, True):
        with page.expect_download() as waiting:
            if is_clear:
                printed(page, "picture", 85, clear=True)
            else:
                page.select_option("select[aria-label='Save the picture']", "mm85")
        waiting.value.save_as(tmp_path / "picture.png")
        with image.open(tmp_path / "picture.png") as picture:
            assert picture.width == round(85 / 25.4 * 300)
            assert picture.info["dpi"] == pytest.approx((300, 300), abs=0.1)
            sky, ground = (
                picture.convert("RGBA").getpixel((2, y)) for y in (2, picture.height - 3)
            )
        assert (sky[3] == 0) == (ground[3] == 0) == is_clear


def printed(page, what, width, *, svg=False, clear=False, caption=True):
    """Ask for a file for print."""
    page.select_option(f"select[aria-label='Save the {what}']", "print")
    page.fill("#print-width", str(width))
    if svg:
        page.click("dialog[open] >> text=SVG")
    if clear:
        page.check("dialog[open] label:has-text('without a ground') input")
    if not caption:
        page.uncheck("dialog[open] label:has-text('caption') input")
    page.click("dialog[open] .primary")


def test_for_print_as_wide_as_wished_with_a_caption_or_none(hand, tmp_path):
    image = pytest.importorskip("PIL.Image")
    page = hand.page
    shown(page, {"load": DOWN, "load_axes": "world"})
    page.wait_for_selector("#strip .plot .deflection.curve-0")
    texts = {}
    for caption in (True, False):
        with page.expect_download() as waiting:
            printed(page, "plot", 120, svg=True, caption=caption, clear=not caption)
        waiting.value.save_as(tmp_path / "plot.svg")
        texts[caption] = (tmp_path / "plot.svg").read_text("utf-8")
        assert 'width="120mm"' in texts[caption]
    assert "How far the load moves the point [mm] along" in texts[True]
    assert "Springs illustrative, not measured" in texts[True]
    assert "Springs" not in texts[False]
    # In a column the letters of the plot are as large as those below it, and legible in print.
    before = page.inner_html("#strip .plot")
    with page.expect_download() as waiting:
        printed(page, "plot", 85, svg=True)
    waiting.value.save_as(tmp_path / "plot.svg")
    text = (tmp_path / "plot.svg").read_text("utf-8")
    assert page.inner_html("#strip .plot") == before
    width = float(re.search(r'viewBox="0 0 ([0-9.]+) ', text)[1])
    sizes = [float(size) for size in re.findall(r'<text [^>]*font-size[:="]+([0-9.]+)', text)]
    assert max(sizes) == min(sizes)
    assert sizes[0] * 85 / width > 2.1  # mm, 6 points
    last = max(float(x) for x in re.findall(r'<text x="([0-9.]+)"', text))
    assert last < width
    # Both pictures, side by side, are in one file.
    heights = {}
    for both in (False, True):
        if both:
            hand.click("button:has-text('Keep as 1')")
            hand.click(".compare-card label:has-text('side by side')")
            settled(page)
            page.wait_for_function("() => window.cartstiff.rows[0].store?.legend")
        with page.expect_download() as waiting:
            printed(page, "picture", 170, caption=False)
        waiting.value.save_as(tmp_path / "both.png")
        with image.open(tmp_path / "both.png") as picture:
            assert picture.width == round(170 / 25.4 * 300)
            heights[both] = picture.height
    sizes = page.evaluate(
        "() => [window.cartstiff.pane, ...window.cartstiff.rows.map((row) => row.pane)]"
        ".map((pane) => pane.size)"
    )
    wide = sum(size[0] for size in sizes)
    assert len(sizes) == 2
    assert heights[True] == pytest.approx(170 / 25.4 * 300 * sizes[0][1] / wide, abs=2)


# -- guided starts
# --------------------------------------------------------------------------------------


@pytest.fixture
def started():
    """The address of what `cartstiff view` serves without a mechanism."""
    command = [sys.executable, "-m", "cartstiff", "view", "--no-open", "--port", "0"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        said = process.stdout.readline()
        yield said.split(": ", 1)[1].split(" ")[0]
        process.terminate()


@pytest.mark.parametrize("name", ["ur5", "hexapod", "cable-robot"])
def test_guided_starts_are_reached_from_an_empty_view(name, started, pages):
    """Each step shows the part that it is about; the numbers are those of its load."""
    page = pages.open(started)
    guides = page.evaluate("() => window.cartstiff.hello.guides")
    number = [guide["mechanism"] for guide in guides].index(name)
    guide = guides[number]
    start = page.locator("dialog[open] .start").nth(number)
    assert guide["title"] in start.inner_text()
    start.click()
    page.wait_for_selector(".guide-card")
    hand = Hand(page)
    for step in guide["steps"]:
        settled(page)
        assert hand.reads(".guide-card p[role=status]") == step["words"]
        assert page.locator(f"{step['reveal']}.guided").is_visible()
        hand.click(".guide-card .primary")
    assert page.locator(".guide-card, .guided").count() == 0
    load = {key: guide["steps"][0]["state"][key] for key in ("load", "load_axes")}
    q = page.evaluate("() => window.cartstiff.numbers.result.q")
    found = cartstiff.analyse(
        cartstiff.load(name), q, wrench=load["load"], load_axes=load["load_axes"]
    )
    way = np.linalg.norm(np.linalg.solve(found.tangent, found.wrench)[3:])
    moved = page.evaluate("() => window.cartstiff.numbers.moved.displacement")
    assert np.linalg.norm(moved) == pytest.approx(way, rel=1e-6)
    # Mechanisms of the other starts are not compared with.
    assert page.evaluate("() => window.cartstiff.rows.length") == 0
    page.context.close()
