"""The live page in a real browser: what is moved moves, and the numbers are the library's."""

from __future__ import annotations

from pathlib import Path
from typing import Any
from urllib.parse import urlsplit
from xml.etree import ElementTree

import numpy as np
import pytest
from tools.look import SIZES, looked_at
from tools.screenshot import ready, settled

import cartstiff
from tests.browser.conftest import VIEWPORT, heard, setup, short, unfold
from tests.support.pages import served, source_of
from tests.support.read_units import si

#: Cells show three digits at least.
SHOWN = 5.1e-3


def matrix(page: Any) -> np.ndarray:
    """The cells of the heat map in the units of the mechanism, each block in its own unit."""
    texts = page.locator(".matrix .cell").all_text_contents()
    cells = np.array([float(t.replace("\u2212", "-")) for t in texts]).reshape(6, 6)
    units = page.locator(".matrix .block-unit").all_text_contents()
    own = page.evaluate("() => window.cartstiff.hello.mechanism.units.length")
    sizes = np.reshape([si(unit) for unit in units], (2, 2))
    quantity = page.evaluate("() => window.cartstiff.shown.quantity")
    files = [[f"N {own}/rad", "N"], ["N/rad", f"N/{own}"]]
    if quantity == "compliance":
        files = [[f"rad/(N {own})", "rad/N"], [f"{own}/(N {own})", f"{own}/N"]]
    return cells * np.kron(sizes / [[si(unit) for unit in row] for row in files], np.ones((3, 3)))


def close(shown: np.ndarray, expected: np.ndarray) -> bool:
    """Equal to the digits that are shown; what is far below the largest is shown as 0."""
    noise = 1e-9 * np.abs(expected).max()
    return bool(np.all(np.abs(shown - expected) <= SHOWN * np.abs(expected) + noise))


def transforms(page: Any, part: str) -> dict[str, list[float]]:
    """Matrices, in F, of all drawn objects whose path in the scene holds a word."""
    return page.evaluate(
        """(part) => {
            const found = {};
            const { scene_tree: tree } = window.cartstiff.pane.viewer;
            const F = tree.find(["meshcat", "cartstiff"]).object;
            F.updateWorldMatrix(true, false);
            const back = F.matrixWorld.clone().invert();
            const walk = (node, path) => {
                if (path.includes(part) && node.children["<object>"]) {
                    const object = node.children["<object>"].object;
                    object.updateWorldMatrix(true, false);
                    const matrix = back.clone().multiply(object.matrixWorld);
                    if (object.isMesh) found[path] = matrix.elements.slice();
                }
                for (const name of Object.keys(node.children)) {
                    walk(node.children[name], `${path}/${name}`);
                }
            };
            walk(tree, "");
            return found;
        }""",
        part,
    )


def moved(before: dict[str, list[float]], after: dict[str, list[float]]) -> list[str]:
    """Paths whose matrices differ."""
    return [p for p in before if p in after and not np.allclose(before[p], after[p], atol=1e-6)]


@pytest.fixture
def ur5(serve, pages):
    """A UR5 at its home posture."""
    return pages.shared(serve("ur5").url)


def test_the_page_loads_without_an_error(ur5):
    assert ur5.title() == "ur5 · cartstiff"
    assert "Positive definite" in ur5.inner_text("#verdict")
    assert close(matrix(ur5), cartstiff.analyse(cartstiff.load("ur5")).matrices["K"])
    assert ur5.locator("#left input[id^=slider-]").count() == 6


@pytest.mark.parametrize(("theme", "questions"), [("light", 0), ("dark", 1)])
def test_the_first_picture_takes_four_files_and_one_answer(serve, pages, theme, questions):
    page = pages.blank(theme=theme)
    page.add_init_script("""window.seen = {sent: 0, rendered: 0};
        for (const what in seen) document.addEventListener(`cartstiff:${what}`, () => seen[what]++);
        """)
    held: list[Any] = []
    page.route("**/viewer.js", lambda route: held.append(route))
    server = serve("ur5")
    page.goto(server.url, wait_until="load")  # the viewer is not there yet
    page.wait_for_function("() => performance.getEntriesByType('resource').length >= 2")
    assert page.evaluate("() => window.cartstiff") is None
    while not held:
        page.wait_for_timeout(10)
    held[0].continue_()
    page.wait_for_function("() => seen.rendered")
    page.wait_for_function("() => !cartstiff.busy")
    asked = [url.removeprefix(server.url) for url in page.watch.requests if url.startswith("http")]
    assert sorted(asked) == ["", "page/main.js", "page/style.css", "viewer.js"]
    # The picture that comes with the greeting is the one that is wanted, in the light theme.
    assert page.evaluate("() => seen") == {"sent": questions, "rendered": 1}
    assert page.evaluate("() => cartstiff.numbers.verdict") == page.evaluate(
        """async () => (await cartstiff.ask({do: "numbers"})).numbers.verdict"""
    )
    page.close()


def test_a_picture_that_is_replaced_at_once_is_not_drawn(ur5):
    frames = "() => cartstiff.pane.viewer.renderer.info.render.frame"
    ur5.evaluate("() => { cartstiff.pane.wait(); cartstiff.pane.waiting = Infinity; }")
    before = ur5.evaluate(frames)
    ur5.evaluate("""async () => {
        cartstiff.pane.viewer.set_dirty();
        for (let i = 0; i < 3; i++) await new Promise(requestAnimationFrame);
    }""")
    assert ur5.evaluate(frames) == before
    ur5.evaluate("() => cartstiff.move(0, 0.2)")
    settled(ur5)
    assert ur5.evaluate(frames) > before


@pytest.mark.parametrize(("width", "height"), [(1280, 720), (1920, 1080), (1100, 700)])
def test_nothing_sticks_out(serve, pages, width, height):
    page = pages.shared(serve("cubic").url)
    page.set_viewport_size({"width": width, "height": height})
    unfold(page)
    settled(page)
    whole = page.evaluate(
        "() => [document.documentElement.scrollWidth, document.documentElement.scrollHeight]"
    )
    assert whole == [width, height]
    for part in ("#left", "#right", "header", "#strip", ".matrix"):
        inner, outer = page.evaluate(
            """(part) => {
                const node = document.querySelector(part);
                return [node.scrollWidth, node.clientWidth];
            }""",
            part,
        )
        assert inner <= outer, part
    cells = page.evaluate(
        """() => [...document.querySelectorAll(".matrix .cell")]
            .filter((cell) => cell.scrollWidth > cell.clientWidth).length"""
    )
    assert cells == 0
    # The picture fills its pane, and nothing more.
    page.wait_for_function(
        """() => {
            const [canvas, pane] = ["#pane canvas", "#pane"].map((name) =>
                document.querySelector(name).getBoundingClientRect());
            return Math.abs(canvas.height - pane.height) < 2
                && Math.abs(canvas.width - pane.width) < 2;
        }"""
    )


@pytest.mark.parametrize("name", ["stewart-gough", "cable-robot", "ur5"])
def test_no_words_are_cut_or_cover_others_at_any_size(serve, pages, name):
    page = pages.open(serve(name).url, viewport={"width": 1280, "height": 720})
    assert {size: looked_at(page, size) for size in SIZES} == {size: [] for size in SIZES}


def test_a_view_that_was_turned_stays_in_another_pane(ur5):
    first = ur5.evaluate("() => window.cartstiff.pane.view")
    look = "(view) => { window.cartstiff.pane.view = view; }"
    ur5.evaluate(look, [1, 2, 3, 0, 0.5, 0])
    ur5.set_viewport_size({"width": 700, "height": 700})
    settled(ur5)
    assert ur5.evaluate("() => window.cartstiff.pane.view") == [1, 2, 3, 0, 0.5, 0]
    ur5.set_viewport_size(VIEWPORT)
    ur5.evaluate(look, first)


def test_a_narrow_cell_cuts_nothing_off(serve, pages):
    """Its verdict is the longest there is."""
    page = pages.shared(serve("stewart-gough").url)
    page.set_viewport_size({"width": 760, "height": 600})
    settled(page)
    assert page.evaluate("() => document.documentElement.scrollWidth") == 760
    header = page.locator("header")
    assert header.evaluate("(node) => node.scrollWidth <= node.clientWidth")


def test_a_slider_moves_robot_ellipsoid_and_matrix(ur5):
    robot, ellipsoid = transforms(ur5, "mechanism"), transforms(ur5, "ellipsoid")
    before = matrix(ur5)
    assert len(robot) >= 6
    assert ellipsoid
    ur5.focus("#slider-2")
    for _ in range(2):
        ur5.keyboard.press("PageUp")  # ten degrees each
    settled(ur5)
    arm = cartstiff.load("ur5")
    q = arm.q + np.array([0, 0, np.radians(20), 0, 0, 0])
    shown = ur5.evaluate("() => window.cartstiff.numbers.result.q")
    assert shown == pytest.approx(q)
    assert float(ur5.input_value("#number-2")) == pytest.approx(np.degrees(q[2]), abs=0.006)
    result = cartstiff.analyse(arm, shown)
    assert close(matrix(ur5), result.matrices["K"])
    assert not close(matrix(ur5), before)
    # The links beyond the elbow have moved, those before have not, and the ellipsoid went along.
    paths = moved(robot, transforms(ur5, "mechanism"))
    assert 0 < len(paths) < len(robot)
    after = transforms(ur5, "ellipsoid")
    assert moved(ellipsoid, after)
    # It stands around the origin of M; an axis of it is a rod, a dashed one begins at its end.
    columns = {path: np.reshape(elements, (4, 4))[:, :3] for path, elements in after.items()}
    for path, (x, _, _, start) in columns.items():
        if path.endswith("/cut"):
            continue  # the mark at the end of an axis that is longer than the picture
        middle = start + x / 2 if path.endswith("minus") else start
        assert np.allclose(middle, result.pose[:3, 3], atol=1e-6), path
    # Half an axis is as long as the square root of its stiffness says.
    body = columns["/meshcat/cartstiff/translation ellipsoid/stiffness/body"]
    squares = np.sum(body[:3] ** 2, axis=1)
    values = 1 / np.linalg.eigvalsh(result.compliances["K"][3:, 3:])[::-1]
    assert squares / squares[0] == pytest.approx(values / values[0], rel=1e-6)


def test_a_number_moves_the_robot(ur5):
    ur5.fill("#number-0", "-45")
    ur5.keyboard.press("Tab")
    settled(ur5)
    q = ur5.evaluate("() => window.cartstiff.numbers.result.q")
    assert q[0] == pytest.approx(np.radians(-45))
    ur5.fill("#number-2", "900")  # beyond the limit: taken to it, and said
    ur5.keyboard.press("Tab")
    settled(ur5)
    assert ur5.evaluate("() => window.cartstiff.numbers.result.q[2]") == pytest.approx(np.pi)
    heard(ur5, "is limited to")


def test_each_connection_shows_the_api_s_matrix(serve, pages):
    load = np.array([200.0, -100.0, 400.0, 50.0, -40.0, 300.0])
    page = pages.shared(serve("stewart-gough").url)
    page.evaluate("(load) => window.cartstiff.change({ load, load_axes: 'body' })", load.tolist())
    result = cartstiff.analyse(cartstiff.load("stewart-gough"), wrench=load)
    for key, name in enumerate("ABKF+", start=1):
        page.keyboard.press(str(key))
        settled(page)
        exact = page.evaluate("(name) => window.cartstiff.matrix(name)", name)
        expected = result.matrices["A"].T if name == "+" else result.matrices[name]
        # By machine code or by the engine, which differ by rounding.
        assert np.abs(np.array(exact) - expected).max() <= 1e-13 * np.abs(expected).max(), name
        assert page.is_checked(f'[data-value="{name}"] input')
        assert close(matrix(page), result.tensor(name).matrix), name
        badge = page.inner_text(".matrix-card .badge")
        assert ("asymmetric" in badge) == (name in "A+"), name
    page.keyboard.press("1")
    page.keyboard.press("s")
    settled(page)
    assert close(matrix(page), result.compliances["A"])
    page.keyboard.press("s")
    unfold(page)
    page.click('[data-value="antisymmetric"]')
    settled(page)
    K = result.matrices["A"]
    assert close_absolute(matrix(page), (K - K.T) / 2)
    page.click('[data-value="difference"]')
    page.select_option("select[aria-label='Compared with']", "K")
    settled(page)
    assert close_absolute(matrix(page), K - result.matrices["K"])


def close_absolute(shown: np.ndarray, expected: np.ndarray) -> bool:
    """As `close`, for parts whose diagonal vanishes."""
    return bool(np.all(np.abs(shown - expected) <= SHOWN * np.abs(expected).max()))


def test_a_cell_says_nine_digits(ur5):
    unfold(ur5)
    ur5.hover('.cell[data-row="3"][data-column="1"]')
    K = cartstiff.analyse(cartstiff.load("ur5")).matrices["K"]
    words = ur5.inner_text(".readout").replace("\u2212", "-")
    assert abs(float(words.split(" ")[0]) - K[3, 1]) < 1e-8 * np.abs(K).max()
    assert words.endswith("N/rad force along x per rotation about y, other motions held")
    ur5.focus('.cell[data-row="0"][data-column="0"]')
    ur5.keyboard.press("ArrowDown")
    assert "moment about y per rotation about x" in ur5.inner_text(".readout")


def test_a_singular_posture_is_said(ur5):
    ur5.keyboard.press("0")
    settled(ur5)
    verdict = ur5.locator("#verdict")
    assert verdict.get_attribute("data-level") == "bad"
    assert "Singular posture" in verdict.inner_text()
    assert "does not exist here" in ur5.text_content(".absent-words")
    assert "singular" in ur5.inner_text(".singular")
    assert "serial singularity" in ur5.inner_text(".notes")
    assert "choose Home" in ur5.inner_text(".advice")
    assert "not drawn" in ur5.inner_text("#legend")
    ur5.keyboard.press("h")
    settled(ur5)
    assert verdict.get_attribute("data-level") == "good"


def test_load_springs_and_reference_point(ur5):
    setup(ur5, "load")
    ur5.click("[aria-label=Load] [data-value=mine]")
    ur5.fill("input[aria-label='fz N']", "-250")
    ur5.keyboard.press("Tab")
    settled(ur5)
    arm = cartstiff.load("ur5")
    load = [0, 0, 0, 0, 0, -250]
    expected = cartstiff.analyse(arm, wrench=load, load_axes="world")
    assert close(matrix(ur5), expected.tangent)
    setup(ur5, "springs")
    ur5.fill("input[aria-label^='elbow_joint N']", "50000")
    ur5.keyboard.press("Tab")
    settled(ur5)
    arm = arm.with_springs({"elbow_joint": 5e4})
    result = cartstiff.analyse(arm, wrench=load, load_axes="world")
    assert close(matrix(ur5), result.tangent)
    setup(ur5, "load")
    ur5.click("[aria-label='The load acts at'] [data-value=origin]")  # wherever the point is
    setup(ur5, "point")
    ur5.fill("input[aria-label='z m']", "0.1")
    ur5.keyboard.press("Tab")
    settled(ur5)
    T = np.eye(4)
    T[2, 3] = 0.1
    assert close(matrix(ur5), result.at(T).matrices["load"])


def test_another_frame_of_interest(ur5):
    setup(ur5, "point")
    ur5.select_option("select[aria-label='Frame M']", "wrist_3_link")
    ur5.wait_for_selector("#kind:has-text('wrist_3_link')")
    settled(ur5)
    result = cartstiff.analyse(cartstiff.load("ur5", frame="wrist_3_link"))
    shown = ur5.evaluate("() => window.cartstiff.numbers.result")
    assert shown == {key: result.to_dict()[key] for key in shown}
    ur5.select_option("select[aria-label='Frame M']", "tool0")
    ur5.wait_for_selector("#kind:has-text('tool0')")


def test_a_kept_state_against_the_present_one(ur5):
    ur5.keyboard.press("a")
    settled(ur5)
    ur5.focus("#slider-1")
    ur5.keyboard.press("PageDown")
    settled(ur5)
    copies = """() => {
        let count = 0;
        const { scene_tree: tree } = window.cartstiff.pane.viewer;
        const { object } = tree.find(["meshcat", "cartstiff", "ghost"]);
        object.traverseVisible((node) => { count += node.isMesh ? 1 : 0; });
        return count;
    }"""
    # The links from the shoulder on have moved; those before are not drawn twice.
    assert 0 < ur5.evaluate(copies) < ur5.evaluate(copies.replace('"ghost"', '"mechanism"'))
    head = ur5.locator(".compared thead th").nth(1)
    assert head.inner_text().startswith("softest")
    assert head.inner_text().endswith(", rotation free")
    assert head.get_attribute("title") == "of K"  # nothing acts
    arm = cartstiff.load("ur5")
    now = cartstiff.analyse(arm, ur5.evaluate("() => window.cartstiff.numbers.result.q"))
    both = (now, cartstiff.analyse(arm))
    one, two = (1 / np.linalg.eigvalsh(r.compliances["K"][3:, 3:])[-1] for r in both)
    ratio = ur5.locator(".compared tbody tr:nth-child(2) .ratio").nth(1).inner_text()
    assert np.isclose(float(ratio.replace("×", "")), two / one, rtol=6e-3)
    ur5.keyboard.press("b")
    settled(ur5)
    assert ur5.evaluate("() => window.cartstiff.numbers.result.q") == arm.q.tolist()
    # Everything is undone and redone: the way back, the step, the keeping, units and plot.
    for _ in range(3):
        ur5.keyboard.press("u")
        settled(ur5)
    assert ur5.evaluate("() => window.cartstiff.kept") == []
    assert not ur5.locator(".compared").is_visible()
    ur5.keyboard.press("U")
    settled(ur5)
    assert ur5.locator(".compared tbody b").all_inner_texts() == ["now", "1"]
    ur5.keyboard.press("d")
    ur5.select_option("[aria-label='Values of']", "rotation")
    assert ur5.evaluate("() => window.cartstiff.angle") == "rad"
    ur5.keyboard.press("u")
    settled(ur5)
    assert ur5.input_value("[aria-label='Values of']") == "translation"
    ur5.keyboard.press("u")
    settled(ur5)
    assert ur5.evaluate("() => window.cartstiff.angle") == "deg"


def test_a_sweep_is_plotted_and_followed(serve, pages):
    ur5 = pages.shared(serve("ur5", curves=True).url)
    # Those of the test before may stand until these are drawn; where a sweep takes more than a
    # second, the page asks before it computes another.
    ur5.wait_for_function("""() => {
        const again = [...document.querySelectorAll("#strip button")]
            .find((one) => one.textContent.includes("compute") && one.checkVisibility());
        again?.click();
        return document.querySelectorAll("#strip .plot .curve:not(.key)").length === 3;
    }""")
    box = ur5.locator("#strip .plot:not(.heat)").bounding_box()
    ur5.mouse.click(box["x"] + 0.9 * box["width"], box["y"] + box["height"] / 2)
    settled(ur5)
    q = ur5.evaluate("() => window.cartstiff.numbers.result.q")
    assert 2.0 < q[2] < np.pi, "the elbow follows the cursor"
    # What stands under the pointer, and the plot as files that say what they show.
    C = cartstiff.analyse(cartstiff.load("ur5"), q).compliances["K"]
    values = 1e-3 / np.linalg.eigvalsh(C[3:, 3:])[::-1]
    words = ur5.inner_text(".reading").split(": ")[1].split(" ")[0].rstrip(",")
    assert float(words) == pytest.approx(values[0], rel=1e-4)
    kept = {}
    for kind in ("svg", "csv"):
        with ur5.expect_download() as waiting:
            ur5.select_option("select[aria-label='Save the plot']", kind)
        kept[kind] = Path(waiting.value.path()).read_text(encoding="utf-8")
        assert "ur5, frame tool0" in kept[kind]
        assert f"cartstiff {cartstiff.__version__}" in kept[kind]
    rows = [line.split(",") for line in kept["csv"].splitlines() if line[0] != "#"]
    names = ["elbow_joint [rad]", "softest [N/mm]", "middle [N/mm]", "stiffest [N/mm]"]
    assert rows[0] == [*names, "why there is no value"]
    row = min(rows[1:], key=lambda r: abs(float(r[0]) - q[2]))
    assert [float(x) for x in row[1:4]] == pytest.approx(values, rel=1e-8)
    assert ElementTree.fromstring(kept["svg"]).tag.endswith("svg")
    ur5.keyboard.press("p")
    ur5.wait_for_function("(before) => window.cartstiff.numbers.result.q[2] !== before", arg=q[2])
    ur5.keyboard.press("p")


#: Holds sweeps back as pairs of `answer` and `refuse`.
HOLD_SWEEPS = """() => {
    const store = window.cartstiff, { ask } = store;
    window.swept = [];
    store.ask = function (message) {
        if (message.do !== "sweep") return ask.call(store, message);
        return new Promise((answer, refuse) => window.swept.push(
            { refuse, answer: () => answer(ask.call(store, message)) }));
    };
    window.restore = () => { store.ask = ask; };
}"""


def test_curves_asked_for_again_after_others_are_those_of_the_last_question(serve, pages):
    """A, B, A at once: the first A is refused, and its end must not end the second one."""
    page = pages.shared(serve("cubic").url)
    settled(page)
    page.evaluate(HOLD_SWEEPS)
    page.select_option("select[aria-label='Along what']", "sweep:1")
    for number, force in enumerate((0, -50, -100, -50), start=1):
        if force:
            page.evaluate(
                "(z) => window.cartstiff.change({ load_axes: 'body', load: [0, 0, 0, 0, 0, z]})",
                force,
            )
        # Where a sweep takes more than a second the page asks first.
        page.wait_for_function(
            """(number) => {
            const again = [...document.querySelectorAll("#strip button")]
                .find((one) => one.textContent.includes("compute") && one.checkVisibility());
            again?.click();
            return window.swept.length === number;
        }""",
            arg=number,
            timeout=10_000,
        )
    page.evaluate("""() => window.swept[1].refuse(
        new Error("a newer question took the place of this one"))""")
    page.wait_for_timeout(600)
    assert page.evaluate("() => window.swept.length") == 4, "the question that is open was kept"
    page.evaluate("() => { window.restore(); window.swept[3].answer(); }")
    # Under a load the plot shows the deflection.
    page.wait_for_selector("#strip .plot .curve.deflection:not(.key)", timeout=10_000)


def test_the_address_holds_the_state(serve, pages):
    page = pages.shared(serve("cubic").url)
    page.focus("#slider-0")
    page.keyboard.press("PageUp")
    page.click("#cameras [data-preset=top]")
    settled(page)
    view = page.evaluate("() => window.cartstiff.pane.view")
    page.keyboard.press("1")
    settled(page)
    page.wait_for_function("() => window.location.hash.includes('connection=A')")
    page.reload()
    ready(page)
    assert page.evaluate("() => window.cartstiff.pane.view") == pytest.approx(view, abs=1e-3)
    q = page.evaluate("() => window.cartstiff.numbers.result.q")
    assert q[0] > 0
    assert page.is_checked('[data-value="A"] input')
    # Another address in the same tab has its camera and its angles, too.
    page.evaluate("() => { location.hash = 'camera=2,1.5,1,0,0.5,0&angles=rad'; }")
    page.wait_for_function("() => window.cartstiff.angle === 'rad'")
    settled(page)
    seen = page.evaluate("() => window.cartstiff.pane.view")
    assert seen == pytest.approx([2, 1.5, 1, 0, 0.5, 0])
    assert page.evaluate("() => window.cartstiff.numbers.result.q") == [0.0] * 6
    # What cannot be read is left out; what cannot be shown is said, and the start shown instead.
    # From elsewhere: the page that is open may write its own state into the address meanwhile.
    address = page.url.split("#")[0]
    page.goto("about:blank")
    page.goto(address + "#q=1,2&connection=Z&foo=bar&load=a")
    ready(page)
    assert page.evaluate("() => window.cartstiff.numbers.result.q") == [0.0] * 6
    assert page.locator("#banner").is_hidden()
    page.goto("about:blank")
    page.goto(address + "#q=0,0,0,0,0,1e300")
    ready(page)
    assert "refused" in page.inner_text("#banner")
    assert page.evaluate("() => window.cartstiff.numbers.result.q") == [0.0] * 6


def test_downloads(ur5):
    with ur5.expect_download() as waiting:
        ur5.click("text=JSON")
    assert waiting.value.suggested_filename == "ur5.json"
    with open(waiting.value.path(), encoding="utf-8") as file:  # noqa: PTH123
        import json

        got, expected = json.load(file), cartstiff.analyse(cartstiff.load("ur5")).to_dict()
    assert set(got) == set(expected)
    for key, value in expected.items():
        for part in value if isinstance(value, dict) else [None]:
            a, b = (got[key], value) if part is None else (got[key][part], value[part])
            if isinstance(b, list) and b and np.array(b).dtype.kind == "f":
                # By machine code or by the engine, which differ by rounding.
                assert np.abs(np.array(a) - b).max() <= 1e-13 * np.abs(b).max(), (key, part)
            else:
                assert a == b, (key, part)
    with ur5.expect_download() as waiting:
        ur5.select_option("select[aria-label='Save the picture']", "png1")
    with open(waiting.value.path(), "rb") as file:  # noqa: PTH123
        assert file.read(8) == b"\x89PNG\r\n\x1a\n"


def test_every_control_has_a_name_and_is_reached_by_keyboard(ur5):
    nameless = ur5.evaluate(
        """() => [...document.querySelectorAll("button, input, select, summary")].filter((node) => {
            if (node.closest("#pane") || node.closest(".dg")) return false;
            const label = node.getAttribute("aria-label") || node.title || node.textContent.trim()
                || node.labels?.[0]?.textContent.trim();
            return !label;
        }).map((node) => node.outerHTML)"""
    )
    assert nameless == []
    seen = set()
    for _ in range(80):  # once around, wherever the focus was
        ur5.keyboard.press("Tab")
        seen.add(
            ur5.evaluate("() => document.activeElement.id || document.activeElement.textContent")
        )
    assert {"slider-0", "slider-5", "number-3", "time", "Home", "Random", "?"} <= seen
    ur5.focus("#slider-0")
    ur5.keyboard.press("?")
    assert ur5.locator("#help").is_visible()
    ur5.keyboard.press("Escape")
    assert not ur5.locator("#help").is_visible()


def test_the_analysis_in_words(ur5):
    ur5.keyboard.press("i")
    ur5.wait_for_selector("#report pre:has-text('Principal stiffness')")
    assert "eigenscrew" in ur5.inner_text("#report").lower()


def test_curves_that_a_server_no_longer_computes_do_not_cover_the_banner(pages):
    """The server goes while curves are asked for; they were asked for again and again."""
    server = served(short(source_of(cartstiff.load("cubic"))))
    page = pages.open(server.url)
    page.wait_for_selector("#strip .plot:not(.computing) .curve-0")  # those of the start
    page.evaluate(
        """() => {
            const { source } = window.cartstiff;
            const ask = source.ask.bind(source);
            window.unanswered = 0;
            source.ask = (message) => {
              if (message.do !== "sweep") ask(message);
              else window.unanswered += 1;
            };
        }"""
    )
    page.focus("#slider-0")  # the curves run along another one, and depend on it
    page.keyboard.press("PageUp")
    page.wait_for_function("""() => {
        const { busy, numbers } = window.cartstiff;
        return busy === null && numbers.result.q[0] > 0;
    }""")  # until then it is not known of what the curves would be
    # After curves that took a second, on a slow machine, the page waits to be asked.
    page.wait_for_function(
        """() => {
            [...document.querySelectorAll("#strip button")]
                .find((one) => one.textContent.includes("compute") && one.checkVisibility())
                ?.click();
            return window.unanswered;
        }"""
    )
    page.watch.without_server()
    server.close()
    page.wait_for_selector("#banner:has-text('does not answer')")
    page.wait_for_timeout(800)  # longer than the page waits before it asks for curves
    assert "does not answer" in page.inner_text("#banner")
    # Once the server, and once the program in the page, which goes on without it.
    assert page.evaluate("() => window.unanswered") <= 2
    page.close()


def test_the_page_comes_back_when_the_server_does(pages):
    source = short(source_of(cartstiff.load("cubic")))
    server = served(source)
    port, token = server.server.port, urlsplit(server.url).path.strip("/")
    page = pages.open(server.url)
    page.focus("#slider-2")
    page.keyboard.press("PageUp")
    settled(page)
    q = page.evaluate("() => window.cartstiff.numbers.result.q")
    page.watch.without_server()
    server.close()
    page.wait_for_selector("#banner:has-text('does not answer')")
    server = served(source, port=port)
    page.wait_for_selector("#banner:has-text('started anew')")
    server.close()
    server = served(source, port=port, token=token)
    page.wait_for_selector("#banner", state="hidden")
    settled(page)
    assert page.evaluate("() => window.cartstiff.numbers.result.q") == q
    server.close()
    page.close()


def test_a_tab_too_many_says_so_and_does_not_try_again(pages):
    server = served(short(source_of(cartstiff.load("cubic"))))
    first, second = pages.open(server.url), pages.blank()
    # As many tabs as there may be: each is a socket that has been greeted.
    first.evaluate(
        """() => Promise.all(Array.from({ length: 23 }, () => new Promise((done) => {
            const tab = new WebSocket(window.location.href.replace("http:", "ws:") + "socket");
            tab.onmessage = done;
        })))"""
    )
    second.goto(server.url)
    second.wait_for_selector("#banner:has-text('too many tabs')")
    second.wait_for_timeout(800)  # longer than the first of the page's pauses
    assert second.evaluate("() => window.cartstiff.source.socket.readyState") == 3
    assert "too many tabs" in second.inner_text("#banner")
    first.close()
    second.reload()
    second.wait_for_function("() => window.cartstiff?.numbers")
    second.close()
    server.close()


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("stewart-gough", "Indefinite"),
        ("five-bar", "Fewer than six free motions"),
        ("grasp", "Singular stiffness"),
        ("cable-robot", "Positive definite"),
    ],
)
def test_every_kind_of_mechanism(serve, pages, name, words):
    page = pages.shared(serve(name).url)
    assert words in page.inner_text("#verdict")
    before = page.evaluate("() => window.cartstiff.numbers.result.q")
    slider = page.locator(".posture-card .slider input[type=range]").first
    slider.focus()
    page.keyboard.press("ArrowRight")
    settled(page)
    after = page.evaluate("() => window.cartstiff.numbers.result.q")
    assert after != before
    load = page.evaluate("() => window.cartstiff.state.load")
    given = {} if load is None else {"wrench": load, "load_axes": "world"}
    result = cartstiff.analyse(cartstiff.load(name), after, **given)
    shown = page.evaluate("() => window.cartstiff.numbers.result")
    K = result.matrices["K"] if result.matrices["K"] is not None else result.compliances["K"]
    quantity = "stiffness" if result.matrices["K"] is not None else "compliance"
    # A closed chain is assembled once more here: to rounding only.
    assert np.allclose(shown[quantity]["K"], K, rtol=1e-8, atol=1e-8 * np.abs(K).max())
    if name == "stewart-gough":
        assert page.locator(".leg").count() == 7


def test_no_label_covers_another(ur5):
    places = ur5.evaluate(
        """() => {
            const { pane } = window.cartstiff;
            const { viewer } = pane;
            pane.every = true;
            viewer.render();
            pane.every = false;
            const found = [];
            viewer.scene.traverseVisible((node) => {
                if (!node.isSprite || !node.material.visible) return;
                const at = node.position.clone()
                    .setFromMatrixPosition(node.matrixWorld).project(viewer.camera);
                const [sx, , , , , sy] = viewer.camera.projectionMatrix.elements;
                const [width, height] = [0, 4].map((k) =>
                    Math.hypot(...node.matrixWorld.elements.slice(k, k + 3)));
                const half = [width * sx / 2, height * sy / 2];
                const middle = [at.x + 2 * half[0] * (0.5 - node.center.x),
                                at.y + 2 * half[1] * (0.5 - node.center.y)];
                found.push([...middle, ...half]);
            });
            return found;
        }"""
    )
    assert len(places) >= 8  # six principal values and two frames
    for i, (x, y, width, height) in enumerate(places):
        for other_x, other_y, other_width, other_height in places[:i]:
            apart = abs(x - other_x) > 0.9 * (width + other_width)
            assert apart or abs(y - other_y) > 0.9 * (height + other_height)
