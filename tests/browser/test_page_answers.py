"""Words follow the answer: titles, verdicts and curves are of the numbers that are shown.

Nothing here depends on when an answer comes: answers are held back and let go by the test.
"""

import numpy as np
import pytest
from tools.screenshot import settled

import cartstiff
from tests.support.pages import page_text, source_of

# Answers wait in `window.held` until they are let go; nothing is computed between them.
HOLD = """() => {
    const { source } = window.cartstiff;
    window.held = [];
    source.between = null;
    source.through = source.onanswer;
    source.onanswer = (...answer) => {
        if (answer[0].do === "draw") window.held.push(answer);
        else source.through(...answer);
    };
}"""
NEXT = "() => window.cartstiff.source.through(...window.held.shift())"
GO_ON = """() => {
    const { source } = window.cartstiff;
    source.onanswer = source.through;
    for (const answer of window.held.splice(0)) source.through(...answer);
}"""
# Title, heading, units of the matrix and of the principal values, and what the numbers are.
SHOWN = """() => {
    const { numbers } = window.cartstiff;
    const all = (what) => [...document.querySelectorAll(what)].map((one) => one.textContent);
    return {
        title: document.getElementById("matrix-title").textContent,
        heading: all("h2"),
        blocks: all(".block-unit"),
        units: all(".principal .unit"),
        corner: document.querySelector(".matrix .cell").textContent,
        quantity: numbers.result.stiffness ? "stiffness" : "compliance",
        q: numbers.result.q,
    };
}"""


@pytest.fixture(params=["live", "file"])
def opened(request, serve, pages, tmp_path_factory):
    """A function that gives a mechanism's page from a server, or from a file."""

    def open_page(name):
        if request.param == "live":
            return pages.shared(serve(name).url)
        file = tmp_path_factory.getbasetemp() / f"{name}.html"
        if not file.exists():
            file.write_text(page_text(source_of(cartstiff.load(name))), encoding="utf-8")
        return pages.shared(file.as_uri())

    return open_page


# The page's own curves may be asked for meanwhile: of two sweeps the newer is answered.
SWEEP = """async ([coordinate, steps]) => {
    const store = window.cartstiff;
    const state = { ...store.state, ...store.given() };
    for (;;) {
        try {
            return await store.ask({ do: "sweep", coordinate, steps, state });
        } catch (error) {
            if (!String(error).includes("a newer question")) throw error;
        }
    }
}"""


def swept(page, coordinate, steps):
    return page.evaluate(SWEEP, [coordinate, steps])


def wait_held(page, count=1):
    page.wait_for_function("(count) => window.held.length >= count", arg=count)


def is_of_stiffness(shown):
    """Whether all words say so; none may say something else."""
    said = [
        shown["title"].startswith("K"),
        "Principal stiffness" in shown["heading"],
        shown["blocks"][0] == "kN m/rad",
        all(unit.startswith(("N/mm", "kN m/rad")) for unit in shown["units"]),
    ]
    assert len(set(said)) == 1, shown
    return said[0]


def test_titles_are_of_the_answer_that_is_shown(opened):
    page = opened("ur5")
    assert is_of_stiffness(page.evaluate(SHOWN))
    page.evaluate(HOLD)
    page.focus("#slider-2")
    page.keyboard.press("ArrowRight")
    page.keyboard.press("s")
    wait_held(page)
    page.evaluate(NEXT)
    shown = page.evaluate(SHOWN)
    assert shown["quantity"] == "stiffness"
    assert is_of_stiffness(shown)
    assert shown["q"][2] == pytest.approx(cartstiff.load("ur5").q[2] + np.pi / 180)
    wait_held(page)  # the key that was pressed meanwhile is asked for
    page.evaluate(NEXT)
    shown = page.evaluate(SHOWN)
    assert shown["quantity"] == "compliance"
    assert not is_of_stiffness(shown)
    assert shown["title"].startswith("C")


def test_what_is_wished_for_names_nothing_that_is_shown(opened):
    """Connection, point, axes and held freedoms, too; and a plot's words are of its rows."""
    page = opened("ur5")
    page.wait_for_selector("#strip svg.plot[aria-label^='Principal stiffness']", state="attached")
    before = page.evaluate(SHOWN)
    label = page.get_attribute("#strip svg.plot", "aria-label")
    read = "() => ['.place', '.badge'].map((one) => document.querySelector(one).textContent)"
    words = page.evaluate(read)
    page.evaluate(HOLD)
    wishes = {"quantity": "compliance", "connection": "A", "others": "held", "axes": "world"}
    page.evaluate(
        """(wishes) => {
            const store = window.cartstiff;
            store.change({ ...wishes, point: [0.1, 0, 0],
                load: [1, 2, 3, 40, 50, 60], load_axes: 'body' });
            store.tell("units", null); // draws everything anew
        }""",
        wishes,
    )
    assert page.evaluate(SHOWN) == before
    assert page.evaluate(read) == words
    assert page.get_attribute("#strip svg.plot", "aria-label") == label
    wait_held(page)
    page.evaluate(GO_ON)
    settled(page)
    after = page.evaluate(SHOWN)
    assert after["title"] == "Cᴬ"
    assert [unit.split(", ")[1] for unit in after["units"]] == ["rotation held", "translation held"]
    assert page.evaluate(read)[0].endswith("+ offset, room axes")
    # Curves are computed anew for other freedoms alone, too.
    page.evaluate("() => window.cartstiff.change({ others: 'free' })")
    page.wait_for_selector("#strip svg.plot[aria-label*='rotation free']", state="attached")


def test_a_listener_that_fails_loses_no_question(opened):
    page = opened("ur5")
    page.evaluate(
        """() => {
            let left = 2;
            const fail = () => {
                if (left-- > 0) throw new Error("a listener fails");
            };
            window.cartstiff.addEventListener("numbers", fail, { capture: true }); // the first
        }"""
    )
    page.evaluate(HOLD)
    page.focus("#slider-2")
    page.keyboard.press("ArrowRight")
    page.keyboard.press("s")
    wait_held(page)
    page.evaluate(NEXT)
    wait_held(page)
    page.evaluate(GO_ON)
    settled(page)
    assert page.evaluate(SHOWN)["quantity"] == "compliance"
    assert page.evaluate("() => window.cartstiff.state.quantity") == "compliance"
    assert page.watch.faults() == ["a listener fails"] * 2  # and they are reported


def test_a_refused_state_is_red_and_its_old_numbers_are_dimmed(opened):
    page = opened("ur5")
    opacity = "() => Number(getComputedStyle(document.getElementById('right')).opacity)"
    assert page.get_attribute("#verdict", "data-level") == "good"
    assert page.evaluate(opacity) == 1
    springs = cartstiff.load("ur5").springs.stiffness.tolist()
    # A file does not answer free joints, a server no numbers beyond its range.
    is_file = page.url.startswith("file:")
    wish = {"stiffness": [0, *springs[1:]]} if is_file else {"load": [0, 0, 0, 0, 0, 1e31]}
    page.evaluate("(wish) => window.cartstiff.change(wish)", wish)
    page.wait_for_selector("body.refused")
    assert page.get_attribute("#verdict", "data-level") == "bad"
    assert page.inner_text("#verdict-text").startswith("Last valid posture: ")
    assert page.evaluate(opacity) < 0.6
    page.evaluate("() => window.cartstiff.change({ stiffness: null, load: null })")
    page.wait_for_selector("body:not(.refused)")
    settled(page)
    assert page.get_attribute("#verdict", "data-level") == "good"
    assert page.evaluate(opacity) == 1


def cells(page, row="translation"):
    return page.evaluate(
        f"""() => [...document.querySelectorAll('[data-row-of="{row}"] td')].map(
            (one) => Number(one.title.split(" ")[0].replace("\\u2212", "-")))"""
    )


def test_the_softest_is_that_of_the_report_and_every_held_number_says_so(opened):
    page = opened("ur5")
    result = cartstiff.analyse(cartstiff.load("ur5"))
    K, C = result.tangent, np.linalg.inv(result.tangent)
    assert cells(page) == pytest.approx(1 / np.linalg.eigvalsh(C[3:, 3:])[::-1], rel=1e-8)
    assert cells(page, "rotation") == pytest.approx(1 / np.linalg.eigvalsh(C[:3, :3])[::-1])
    assert page.inner_text('[data-row-of="translation"] .unit') == "N/mm, rotation free"
    legend = "() => window.cartstiff.legend.lines.map(({ text }) => text)"
    assert page.evaluate(legend)[0].startswith("stiffness of translation (rotation free): ")
    assert "translation, rotation held" in page.get_attribute(".facts dd", "title")
    page.click("text=Full analysis")
    page.wait_for_selector("#report pre:has-text('softest')")
    page.keyboard.press("Escape")
    page.click("[aria-label='The other freedoms'] [data-value='held']")
    settled(page)
    assert cells(page) == pytest.approx(np.linalg.eigvalsh(K[3:, 3:]), rel=1e-8)
    assert page.inner_text('[data-row-of="translation"] .unit') == "N/mm, rotation held"
    assert page.evaluate(legend)[0].startswith("stiffness of translation (rotation held): ")


def test_pushes_are_resisted_unless_a_turn_is_not(opened):
    """Cables whose platform is turned half round push it away, and no load was given."""
    page = opened("cable-robot")
    assert "every small motion is resisted" in page.inner_text("#verdict")
    if not page.evaluate("window.cartstiff.source.moves"):
        return
    page.evaluate("window.cartstiff.goTo([0, 0, 0.6, 0, 0, Math.PI])")
    settled(page)
    assert "Not stable" in page.inner_text("#verdict")


@pytest.mark.parametrize("given", [False, True])
def test_sliders_move_the_drives_whether_a_load_was_given_or_not(opened, given):
    page = opened("stewart-gough")
    platform = cartstiff.load("stewart-gough")
    start = cartstiff.analyse(platform)
    R = start.pose[:3, :3]
    load = np.concatenate([R @ start.wrench[:3], R @ start.wrench[3:]])
    if given:
        page.evaluate(
            "(load) => window.cartstiff.change({ load, load_axes: 'world' })", load.tolist()
        )
        settled(page)
    assert "The sliders move the drives" in page.inner_text("#left")
    q = platform.q.copy()
    for i, step in ((2, 0.2), (4, 0.05)):
        q[i] += step
        page.evaluate("([i, x]) => window.cartstiff.move(i, x)", [i, q[i]])
        settled(page)
    result = cartstiff.analyse(platform, q, wrench=load, load_axes="world")
    numbers = page.evaluate("() => window.cartstiff.numbers.result")
    size = np.abs(load).max()
    assert np.abs(np.array(numbers["wrench"]) - result.wrench).max() < 1e-9 * size
    K = result.matrices["B"]
    assert np.abs(np.array(numbers["stiffness"]["B"]) - K).max() < 1e-9 * np.abs(K).max()
    assert page.is_checked("[aria-label=Load] [data-value=mine] input")
    # The sweep through this posture is of the same load.
    found = swept(page, 2, 5)
    at, rows = found["at"], found["rows"]
    q[2] = at[-1]
    last = cartstiff.analyse(platform, q, wrench=load, load_axes="world")
    assert rows[-1]["leg_force"][0] == pytest.approx(
        np.abs(last.elastic.springs.tensions(last.posture.lines.lengths)).max()
    )


def test_curves_of_a_spring_loaded_platform_are_of_its_load_before_anything_is_moved(opened):
    page = opened("stewart-gough")
    platform = cartstiff.load("stewart-gough")
    load = cartstiff.analyse(platform).wrench
    page.wait_for_selector("#strip svg.plot path", state="attached")
    page.select_option("[aria-label='Values of']", "leg_force")
    page.select_option("[aria-label='Along what']", "sweep:2")
    with page.expect_download() as download:
        page.select_option("[aria-label='Save the plot']", "csv")
    lines = [x for x in download.value.path().read_text().splitlines() if x[0] != "#"]
    z, force = map(float, lines[-1].split(",")[:2])
    q = platform.q.copy()
    q[2] = z
    last = cartstiff.analyse(platform, q, wrench=load)
    assert force == pytest.approx(
        np.abs(last.elastic.springs.tensions(last.posture.lines.lengths)).max()
    )


def test_a_sweep_that_moves_another_motor_has_gaps_with_the_reason(serve, pages):
    page = pages.shared(serve("five-bar", curves=True).url)
    page.wait_for_selector("#strip svg.plot path", state="attached")
    found = swept(page, 0, 61)
    other = cartstiff.load("five-bar").q[2]
    missing = [row for row in found["rows"] if "reason" in row]
    assert 5 < len(missing) < 25
    wanted = [dict(row["moved"][k][:2] for k in range(len(row["moved"]))) for row in missing]
    assert all(at[2] == pytest.approx(other, abs=1e-6) for at in wanted)
    assert all(row["q"][2] == pytest.approx(other, abs=1e-6) for row in found["rows"] if "q" in row)
    # The plot has a gap there, and the pointer says why.
    page.wait_for_function("() => document.querySelectorAll('#strip .gap').length >= 5")
    box = page.locator("#strip svg.plot:not(.heat)").bounding_box()
    page.mouse.move(box["x"] + 54, box["y"] + box["height"] / 2)
    page.wait_for_selector(".reading:has-text('right_motor moves from 54.43° to')")
    page.evaluate("window.cartstiff.tell('angles', 'rad')")
    page.mouse.move(box["x"] + 55, box["y"] + box["height"] / 2)
    page.wait_for_selector(".reading:has-text('right_motor moves from 0.95 rad to')")
    # Sent there, the drives move, which is said; the field that was typed into shows where to.
    page.fill("#number-0", "-2.6")
    page.keyboard.press("Enter")
    settled(page)
    assert "drives have moved" in page.inner_text("#verdict-text")
    reached = page.evaluate("() => window.cartstiff.state.q[0]")
    assert abs(reached + 2.6) > 0.1
    assert float(page.input_value("#number-0")) == pytest.approx(reached, abs=1e-4)


ARROWS = """() => ["force", "moment"].map((kind) => {
    const path = ["meshcat", "cartstiff", "wrench", kind, "arrow"];
    const { object } = window.cartstiff.pane.viewer.scene_tree.find(path);
    return object.position.clone().setFromMatrixColumn(object.matrix, 0).length();
})"""


def test_a_larger_load_has_a_longer_arrow(opened):
    page = opened("ur5")
    before = np.zeros(2)
    for size in (0.01, 0.9, 1.1, 4.9, 5.1, 99, 101, 1100):
        page.evaluate(
            "(f) => window.cartstiff.change({ load_axes: 'body', load: [0, f / 10, 0, 0, 0, -f] })",
            size,
        )
        settled(page)
        arrows = np.array(page.evaluate(ARROWS))
        assert (arrows > before).all(), size
        before = arrows
    assert before.max() < 0.4


def test_a_map_of_deflections_says_what_the_page_says_or_why_it_does_not(opened):
    page = opened("ur5")
    arm = cartstiff.load("ur5")
    singular = int(np.flatnonzero([name == "wrist_2_joint" for name in arm.names])[0])
    page.evaluate(
        """async ([load, and]) => {
            const store = window.cartstiff;
            store.change({ load, load_axes: "world" });
        }""",
        [[0, 0, 0, 0, 0, -100], singular],
    )
    settled(page)
    page.select_option("[aria-label='Values of']", "deflection")
    page.select_option("[aria-label='Along what']", "sweep:2")
    page.select_option("[aria-label='And along what']", str(singular))
    with page.expect_download() as download:
        page.select_option("[aria-label='Save the plot']", "csv")
    lines = [x for x in download.value.path().read_text().splitlines() if x[0] != "#"][1:]
    load, checked = [0, 0, 0, 0, 0, -100], 0
    for line in lines[::5]:
        x, y, value, *why = line.split(",", 3)
        q = arm.q.copy()
        q[2], q[singular] = float(x), float(y)
        result = cartstiff.analyse(arm, q, wrench=load, load_axes="world")
        if value:
            moved = np.linalg.norm((result.tangent_compliance @ result.wrench)[3:])
            assert float(value) == pytest.approx(1000 * moved, rel=1e-6)
            checked += 1
        else:
            assert "nothing exists" not in why[0]
            assert len(why[0]) > 10
            if page.url.startswith("http"):  # the server answers every posture that has an answer
                assert result.tangent_compliance is None or "unstable" in why[0]
    assert checked > 50


def test_a_limit_of_a_drive_that_is_passed_is_said_first_and_once(opened):
    """As the command says it; from a server, and from the page's own arithmetic."""
    page = opened("ur5")
    change = "(load) => window.cartstiff.change({ load, load_axes: 'world' })"
    for size, is_passed in ((-100.0, False), (-400.0, True)):
        load = [0.0, 0.0, 0.0, 0.0, 0.0, size]
        page.evaluate(change, load)
        settled(page)
        result = cartstiff.analyse(cartstiff.load("ur5"), wrench=load, load_axes="world")
        notes = [note.message for note in result.notes if note.code == "force-limits"]
        assert bool(notes) is is_passed
        for note in notes:
            words = note.partition(" is at")[0].partition(": ")[2]
            assert f"Beyond limits: {words} is at" in page.inner_text(".advice")
        assert page.locator(".notes-card", has_text="Beyond limits").count() == 0
    page.evaluate("() => window.cartstiff.change({ load: null })")
