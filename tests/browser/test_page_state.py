"""What a page keeps, and what it frames: nothing a user has chosen is lost without a word."""

import json

import numpy as np
import pytest
from tools.screenshot import settled

import cartstiff
from cartstiff import analyse_posture
from cartstiff.geometry import se3
from tests.browser.conftest import setup
from tests.browser.test_page import close, matrix
from tests.support.pages import page_text, served, source_of, state_of
from tests.support.printed import text_of
from tests.support.robots import bundled_files

# Where the tool is on the screen, within [-1, 1] in both directions if it is in the picture;
# the shape at rest, drawn beside the displaced one, has a frame M of its own.
TOOL = """() => {
    const { viewer } = window.cartstiff.pane;
    const found = viewer.scene_tree.find(["meshcat", "cartstiff", "M"]).object;
    viewer.scene.updateMatrixWorld(true);
    viewer.camera.updateMatrixWorld(true);
    viewer.camera.updateProjectionMatrix();
    const p = viewer.camera.position.clone().setFromMatrixPosition(found.matrixWorld);
    p.project(viewer.camera);
    return [p.x, p.y];
}"""


@pytest.fixture
def ur5(serve, pages):
    return pages.shared(serve("ur5").url)


# Values of principal axes that are written in the picture.
VALUES = """() => {
    const found = [];
    window.cartstiff.pane.viewer.scene.traverseVisible((node) => {
        if (node.isSprite && node.material.visible && node.parent.name.startsWith("value")) {
            found.push(`${node.parent.parent.parent.name} ${node.parent.name}`);
        }
    });
    return found;
}"""


def pointed_at(page, x, y):
    """What the page says of the part of its picture at a place within [-1, 1]."""
    box = page.locator("#pane canvas").bounding_box()
    page.mouse.move(box["x"] + box["width"] * (1 + x) / 2, box["y"] + box["height"] * (1 - y) / 2)
    page.wait_for_selector(".tip:not([hidden])")
    settled(page)
    return page.inner_text(".tip:not([hidden])")


def changed(page, **wishes):
    page.evaluate("(wishes) => window.cartstiff.change(wishes)", wishes)
    settled(page)


def test_another_frame_keeps_posture_load_springs_and_kept_states(serve, pages):
    page = pages.open(serve("ur5").url, viewport={"width": 1280, "height": 720})
    assert_seen(page, 1280)
    q = [0.3, -1.0, 1.2, -0.4, 0.9, 0.1]
    springs = [2e4, 3e4, 2e4, 5e3, 5e3, 4e3]
    changed(
        page,
        q=q,
        moved=None,
        stiffness=springs,
        load=[1, 2, 3, 40, -50, 60],
        load_axes="body",
        point=[0.0, 0.02, 0.1],
    )
    page.keyboard.press("a")
    settled(page)
    setup(page, "point")
    page.select_option("select[aria-label='Frame M']", "wrist_3_link")
    page.wait_for_selector("#kind:has-text('wrist_3_link')")
    settled(page)
    state = page.evaluate("() => window.cartstiff.state")
    assert state["q"] == q
    assert state["stiffness"] == springs
    assert page.evaluate("() => window.cartstiff.kept[0].state.q") == q
    # The load is the same one: what it does to the joints has not changed.
    before = cartstiff.analyse(
        cartstiff.load("ur5").with_springs(springs),
        q,
        wrench=[1, 2, 3, 40, -50, 60],
        load_at=[0, 0.02, 0.1],
    )
    after = cartstiff.analyse(
        cartstiff.load("ur5", frame="wrist_3_link").with_springs(springs),
        q,
        wrench=state["load"],
        load_at=state["load_at"],
    )
    apart = se3.inverse(after.pose) @ before.pose
    point = apart[:3, :3] @ [0, 0.02, 0.1] + apart[:3, 3]
    assert np.allclose(state["load_at"], point, atol=1e-12)
    assert np.allclose(after.at(apart).matrices["B"], before.matrices["B"], rtol=1e-9, atol=1e-6)
    assert close(matrix(page), after.tangent)
    # The state that was kept is the same one, read at the new point; undo goes back to the frame.
    page.wait_for_function(
        "() => window.cartstiff.rows[0].numbers && !window.cartstiff.rows[0].late"
    )
    kept = page.evaluate("() => window.cartstiff.rows[0].numbers.result.load.stiffness")
    assert np.allclose(kept, after.tangent, rtol=1e-9, atol=1e-6)
    page.keyboard.press("u")
    page.wait_for_selector("#kind:has-text('tool0')")
    settled(page)
    assert page.evaluate("() => window.cartstiff.state.load") == [1, 2, 3, 40, -50, 60]
    assert page.evaluate("() => window.cartstiff.state.point") == [0, 0.02, 0.1]


def test_fit_frames_the_posture_that_is_shown(ur5):
    arm = cartstiff.load("ur5")
    draw = np.random.default_rng(4)
    # What is to be framed comes from the server: the camera has moved when `look` has returned.
    ur5.evaluate("""() => {
        const { pane } = window.cartstiff;
        const look = pane.look;
        window.looks = 0;
        pane.look = function (...how) { look.apply(this, how); window.looks += 1; };
    }""")
    for looks in range(1, 9):
        changed(ur5, q=draw.uniform(-3.1, 3.1, len(arm.names)).tolist(), moved=None)
        ur5.click("#cameras [data-preset=fit]")
        ur5.wait_for_function("(looks) => window.looks === looks", arg=looks)
        assert np.abs(ur5.evaluate(TOOL)).max() < 0.95


def assert_seen(page, width):
    """The first view holds the tool, and nothing is wider than the screen."""
    assert np.abs(page.evaluate(TOOL)).max() < 0.95
    assert page.evaluate("() => document.documentElement.scrollWidth") <= width


@pytest.mark.parametrize("viewport", [(1024, 768), (390, 844)])
def test_the_first_view_holds_the_tool_and_nothing_is_wider_than_the_screen(serve, pages, viewport):
    width, height = viewport
    page = pages.open(serve("ur5").url, viewport={"width": width, "height": height})
    settled(page)
    assert_seen(page, width)


#: Corners of what is framed: largest share of the pane's half width, and dots down from its top;
#: where the legend begins and the buttons end.
CORNERS = """() => {
    const { pane } = window.cartstiff;
    const { camera } = pane.viewer;
    camera.updateMatrixWorld();
    const found = [0, 1, 2, 3, 4, 5, 6, 7].map((k) => {
        const [x, y, z] = [0, 1, 2].map((i) => pane.framed.bounds[k >> i & 1][i]);
        return camera.position.clone().set(x, z, -y).project(camera);
    });
    return [Math.max(...found.map(({ x }) => Math.abs(x))),
        ...[Math.max, Math.min].map((most) =>
            most(...found.map(({ y }) => (1 - y) / 2 * pane.node.clientHeight))),
        document.getElementById("legend").offsetTop,
        document.getElementById("cameras").offsetTop
            + document.getElementById("cameras").offsetHeight];
}"""


@pytest.mark.parametrize("viewport", [(1280, 720), (1024, 768), (390, 844)])
def test_all_corners_of_what_is_framed_are_seen_beside_the_legend(serve, pages, viewport):
    """The sphere around a wide frame of cables is not what shows."""
    width, height = viewport
    page = pages.open(serve("cable-robot").url, viewport={"width": width, "height": height})
    settled(page)
    across, lowest, highest, legend, buttons = page.evaluate(CORNERS)
    assert across < 0.95
    assert buttons <= highest < lowest < legend


def test_the_same_matrix_is_drawn_alike_whatever_was_before(ur5):
    radii = "() => window.cartstiff.legend.lines.map(({ text }) => text)"
    first = ur5.evaluate(radii)
    changed(ur5, q=[0.0, -0.05, 0.1, 0.0, 0.3, 0.0], moved=None)
    changed(ur5, stiffness=[1e7] * 6)
    changed(ur5, stiffness=None, q=ur5.evaluate("() => window.cartstiff.hello.state.q"))
    assert ur5.evaluate(radii) == first
    for _ in range(2):
        ur5.keyboard.press("t")
        settled(ur5)
        assert ur5.evaluate(radii) == first


def test_a_dead_server_is_said_when_the_numbers_are_asked_for(pages):

    server = served(source_of(cartstiff.load("cable-robot")))
    page = pages.open(server.url)
    settled(page)
    page.watch.without_server()
    server.close()
    page.wait_for_selector("body.lost")
    page.click("text=JSON")
    page.wait_for_selector("#banner:has-text('connection was lost')")


def test_the_browser_computes_for_a_dead_server(pages):

    arm = cartstiff.load("ur5")
    server = served(source_of(arm))
    page = pages.open(server.url)
    page.wait_for_function("() => window.cartstiff.source.local !== null")
    settled(page)
    labels = page.evaluate(VALUES)
    # Without a server it goes on by itself, and says so.
    page.watch.without_server()
    server.close()
    page.wait_for_selector("#banner:has-text('computed in the browser')")
    changed(page, q=arm.q.tolist(), moved=None, load=[0, 0, 0, 0, 0, -100], load_axes="body")
    here = cartstiff.analyse(arm, wrench=[0, 0, 0, 0, 0, -100])
    assert close(matrix(page), here.tangent)
    # Under a load the compliance is drawn, whose softest axis comes last.
    assert page.evaluate(VALUES) == [name.replace("value 1", "value 3") for name in labels]
    page.keyboard.press("i")
    page.wait_for_selector("#report:has-text('the browser cannot do that')")


def test_springs_that_nobody_measured_are_said_with_the_answer(serve, pages):
    page = pages.shared(serve("ur5").url)
    chip = page.locator(".moved-card .doubt")
    assert chip.inner_text() == "Springs illustrative, not measured"
    changed(page, stiffness=[1e4] * 6)
    assert not chip.is_visible()


def test_an_exported_page_keeps_point_axes_and_the_kept_state(serve, pages, tmp_path):

    arm = cartstiff.load("ur5")
    other = [0.1, -1.2, 1.3, -0.2, 0.8, 0.0]
    state = state_of(
        q=arm.q.tolist(), point=(0.0, 0.0, 0.2), axes="world", labels=False, ghost=other
    )
    file = tmp_path / "ur5.html"
    file.write_text(page_text(source_of(arm), state=state), encoding="utf-8")
    page = pages.open(file.as_uri(), offline=True)
    settled(page)
    result = cartstiff.analyse(arm)
    T = se3.pose(result.pose[:3, :3].T, [0, 0, 0.2])
    assert close(matrix(page), result.at(T).matrices["load"])
    assert not page.evaluate("() => window.cartstiff.state.labels")
    assert page.evaluate("() => window.cartstiff.kept[0].state.q") == other
    page.wait_for_function("() => window.cartstiff.rows[0].numbers")
    assert page.evaluate("() => window.cartstiff.rows[0].numbers.result.q") == other
    page.keyboard.press("i")
    page.wait_for_selector("#report h2:has-text('in the posture of the file, q = ')")
    heading = page.inner_text("#report h2")
    assert [float(x) for x in heading.split("q = ")[1].split(",")] == pytest.approx(arm.q, rel=1e-5)
    connection = heading.split("K^")[1].split(" ")[0]
    at = se3.pose(translation=[0, 0, 0.2])
    analysis = analyse_posture(result, connection=connection, at=at)
    # The answer stands before it, as the page says it, and an empty line.
    answer, _, rest = page.locator("#report pre").text_content().partition("\n\n")
    assert rest == text_of(analysis, arm.units)
    assert answer.split("\n")[:2] == [
        "Positive definite: every small motion is resisted (K^B)",
        "Softest (free to turn): 18.65 N/mm along (0.07, -0.14, 0.99) of the room, "
        "almost vertical, 9 deg off z; 74.74 N/mm with turning blocked",
    ]


def test_the_first_card_says_how_far_the_load_moves_the_point(ur5):
    card = ur5.locator(".moved-card")
    assert card.inner_text().startswith("Stiffness here\nLoad\n")
    assert card.locator(".first-load").is_visible()
    assert card.locator(".moved-head").is_hidden()
    load, point = [0.0, 5.0, 0.0, 0.0, 0.0, -300.0], [0.0, 0.0, 0.1]
    changed(ur5, load_axes="body", load=load, point=point)
    result = cartstiff.analyse(cartstiff.load("ur5"), wrench=load, load_at=point)
    moved = np.linalg.solve(result.tangent, result.wrench)
    d = moved[3:] + np.cross(moved[:3], point)
    words = card.inner_text().replace("\u2212", "-")
    assert words.startswith("Under this load\n")
    assert card.locator(".first-load").is_hidden()
    assert f"{1000 * np.linalg.norm(d):.4g} mm" in words
    assert f"{1000 * np.linalg.norm(moved[:3]):.4g} mrad" in words
    room = result.pose[:3, :3] @ d * 1000
    decimals = 3 - int(np.floor(np.log10(np.abs(room).max())))  # alike for the three
    assert ", ".join(f"{round(x, decimals):g}" for x in room) in words
    bars = card.locator(".moved-bar .num").all_inner_texts()
    shares = [float(x.split(" ")[0].replace("\u2212", "-")) for x in bars]
    assert min(abs(share) for share in shares) >= 1  # no bars of 0 %
    assert abs(sum(shares) - 100) <= 3
    # The softest direction against a force, the body free to turn, and where it points.
    R, at = result.pose[:3, :3], np.linalg.inv(result.tangent)
    shift = [[0, point[2], 0], [-point[2], 0, 0], [0, 0, 0]]
    S = np.hstack([shift, np.eye(3)])  # displacement of the point from a twist of M
    at_point = S @ at @ S.T
    values, axes = np.linalg.eigh((at_point + at_point.T) / 2)
    soft = ur5.evaluate("() => window.cartstiff.numbers.softest")
    assert soft["stiffness"] == pytest.approx(1 / values[2], rel=1e-9)
    assert abs(np.dot(soft["direction"], R @ axes[:, 2])) == pytest.approx(1, abs=1e-9)
    assert "free to turn" in card.inner_text()
    verdict = ur5.locator("#verdict")  # what holds with any load is above all cards
    assert verdict.get_attribute("data-level") == "good"
    assert "Positive definite: every small motion is resisted" in verdict.inner_text()
    assert card.locator(".advice").is_hidden()


def test_what_is_pointed_at_says_its_number_and_lights_its_row(ur5):
    page = ur5
    page.mouse.move(0, 0)
    softest = [f"{name} ellipsoid value 1" for name in ("rotation", "translation")]
    assert sorted(page.evaluate(VALUES)) == softest
    words = pointed_at(page, *page.evaluate(TOOL)).replace("\u2212", "-")
    freedom = words.split(",")[0]
    values = page.evaluate("() => window.cartstiff.numbers.principal")[freedom]["values"]
    first = float(words.split(": ")[1].split(" ")[0].rstrip(","))
    assert any(first == pytest.approx(value, rel=1e-4) for value in values)
    assert len([v for v in page.evaluate(VALUES) if v.startswith(freedom)]) == 3
    page.mouse.down()
    page.mouse.up()
    assert page.locator(f'[data-row-of="{freedom}"].lit, [data-row-of="{freedom}"] .lit').count()
    page.mouse.move(0, 0)
    assert page.input_value(".first-load input") == "100"
    assert page.inner_text(".first-load .unit") == "N"
    page.click(".first-load button:text-is('downwards')")
    settled(page)
    assert page.evaluate("() => window.cartstiff.state.load_axes") == "world"
    assert page.evaluate("() => window.cartstiff.state.load") == [0, 0, 0, 0, 0, -100]
    line = page.inner_text(".moved-line")
    assert line.startswith("100 N at M: its force and moment keep their direction in the room")
    assert "Gravity: none" in line


def test_a_hand_moves_the_tool_and_pulls_the_load(ur5):
    page = ur5
    changed(page, load=[0, 0, 0, 0, 0, -100], load_axes="world")
    before = page.evaluate("() => window.cartstiff.numbers.result")

    def screen(point):
        box = page.locator("#pane canvas").bounding_box()
        x, y = point
        return box["x"] + box["width"] * (1 + x) / 2, box["y"] + box["height"] * (1 - y) / 2

    def dragged(start, way):
        (x, y), (dx, dy) = start, way
        page.mouse.move(x, y)
        settled(page)
        page.mouse.down()
        for part in (0.5, 1.0):
            page.mouse.move(x + part * dx, y + part * dy)
        settled(page)
        page.mouse.up()
        page.mouse.move(0, 0)
        settled(page)

    # The tool is where the hand is, and has not turned.
    x, y = screen(page.evaluate(TOOL))
    dragged((x, y), (-35.0, -28.0))
    assert screen(page.evaluate(TOOL)) == pytest.approx((x - 35, y - 28), abs=1.0)
    after = page.evaluate("() => window.cartstiff.numbers.result")
    assert np.allclose(np.array(after["pose"])[:3, :3], np.array(before["pose"])[:3, :3], atol=1e-8)
    arm = cartstiff.load("ur5")
    assert np.allclose(cartstiff.analyse(arm, after["q"]).pose, after["pose"], atol=1e-12)
    page.keyboard.press("u")
    settled(page)
    assert page.evaluate("() => window.cartstiff.state.q") == before["q"]
    page.keyboard.press("U")
    settled(page)
    assert page.evaluate("() => window.cartstiff.state.q") == after["q"]

    # The head of the force's arrow: straight up snaps to the axis, two digits.
    x, y = screen(page.evaluate(TOOL))
    page.mouse.move(x, y)
    settled(page)
    head = page.evaluate("""() => {
        const { viewer } = window.cartstiff.pane;
        const arrow = viewer.scene_tree.find(["meshcat", "cartstiff", "wrench", "force", "arrow"]);
        const at = viewer.camera.position.clone().set(1, 0, 0);
        at.applyMatrix4(arrow.object.matrixWorld).project(viewer.camera);
        return [at.x, at.y];
    }""")
    X, Y = screen(head)
    dragged((X, Y), (1.2 * (X - x), 1.2 * (Y - y)))
    load = page.evaluate("() => window.cartstiff.state.load")
    assert load[:5] == [0, 0, 0, 0, 0]
    assert load[5] == pytest.approx(-230, abs=31)
    assert load[5] == round(load[5] / 10) * 10

    # Numbers beside: beyond reach it goes as near as it can, and says so.
    page.click(".posture-card [data-value=tool]")
    page.fill("input[aria-label='tool x m']", "3")
    page.keyboard.press("Enter")
    settled(page)
    assert "not reached" in page.inner_text(".posture-card")
    assert 0.6 < page.evaluate("() => window.cartstiff.numbers.position[0]") < 1.0


def test_a_rigid_joint_stays_rigid_until_it_is_given_a_number(serve, pages, tmp_path):
    ur5 = cartstiff.load("ur5")
    stiffness = dict(zip(ur5.names, [3e4, 3e4, "rigid", 5e3, 5e3, 4e3], strict=True))
    q = dict(zip(ur5.names, ur5.q.tolist(), strict=True))
    arm = {"kind": "serial", "model": "ur5", "frame": "tool0", "q": q}
    arm["springs"] = {name: {"stiffness": k} for name, k in stiffness.items()}
    file = tmp_path / "arm.yaml"
    file.write_text(json.dumps(arm), encoding="utf-8")
    arm = cartstiff.load(file)
    page = pages.open(serve(str(file)).url)
    setup(page, "springs")
    elbow = page.locator("input[aria-label^='elbow_joint N m/rad']")
    assert elbow.input_value() == ""
    assert elbow.get_attribute("placeholder") == "rigid"
    page.fill("input[aria-label^='wrist_1_joint N m/rad']", "7000")
    page.keyboard.press("Enter")
    settled(page)
    state = page.evaluate("() => window.cartstiff.state")
    assert state["stiffness"] == [30000, 30000, None, 7000, 5000, 4000]
    other = arm.with_springs({"wrist_1_joint": 7000.0})
    assert close(matrix(page), cartstiff.analyse(other).compliances["B"])
    page.wait_for_function("() => window.location.hash.includes('7000')")
    again = pages.open(page.evaluate("() => window.location.href"))
    assert again.evaluate("() => window.cartstiff.state")["stiffness"] == state["stiffness"]
    elbow.fill("10000")
    page.keyboard.press("Enter")
    settled(page)
    softer = other.with_springs({"elbow_joint": 1e4})
    assert close(matrix(page), cartstiff.analyse(softer).compliances["B"])


def test_load_and_weight_are_typed_into_their_fields(ur5):
    """Wrench along the room's axes at a point of its own, gravity, a mass and its centre."""
    page = ur5
    setup(page, "load")

    def typed(**numbers):
        for label, number in numbers.items():
            field = page.locator(f"input[aria-label^='{label.replace('_', ' ')} ']")
            field.fill(str(number))
            field.press("Enter")
            settled(page)

    page.click("[aria-label=Load] [data-value=mine]")
    page.click("[aria-label='Axes of the load'] [data-value=world]")
    typed(mx=3, fx=40, fy=-50, fz=60, load_at_x=0.02, load_at_z=0.1)
    typed(gravity_gz=-9.81, payload_mass=3, payload_at_z=0.05)
    arm = cartstiff.load("ur5", gravity=[0, 0, -9.81], payload=[3, 0, 0, 0.05])
    wanted = cartstiff.analyse(
        arm, wrench=[3, 0, 0, 40, -50, 60], load_at=[0.02, 0, 0.1], load_axes="world"
    )
    assert close(matrix(page), wanted.tangent)
    state = page.evaluate("() => window.cartstiff.state")
    assert state["payload"] == [3, 0, 0, 0.05]
    assert state["gravity"] == [0, 0, -9.81]


@pytest.mark.parametrize(
    ("field", "value", "words"),
    [
        ("shoulder_pan_joint N m/rad", -5, "a stiffness must be 0 or more"),
        ("Damping ratio in per cent", -3, "damping must be between 0 and 1000 %"),
    ],
)
def test_a_number_that_cannot_be_is_refused_in_words(ur5, field, value, words):
    springs = ur5.evaluate("() => window.cartstiff.state.stiffness")
    ur5.evaluate(
        """([label, value]) => {
            const input = document.querySelector(`input[aria-label="${label}"]`);
            input.value = value;
            input.dispatchEvent(new Event("change"));
        }""",
        [field, value],
    )
    ur5.wait_for_function("(words) => window.heard.includes(words)", arg=words)
    assert ur5.evaluate("() => window.cartstiff.state.stiffness") == springs


def test_a_nonlinear_spring_has_no_number_and_stays(serve, pages, tmp_path):
    """Its field is empty; another spring changes without it, and a number replaces it."""
    text = bundled_files()["ur5"].read_text()
    own = "elbow_joint: {stiffness: 2.0e4}"
    assert own in text
    path = tmp_path / "polynomial.yaml"
    path.write_text(text.replace(own, "elbow_joint: {polynomial: [2.0e4, 0, 1.0e8]}"))
    elastic = cartstiff.load(path)
    page = pages.shared(serve(str(path)).url)
    field = "input[aria-label='elbow_joint N m/rad']"
    assert page.input_value(field) == ""
    assert page.get_attribute(field, "placeholder") == "nonlinear"
    for name, stiffness in (("shoulder_pan_joint", 2e4), ("elbow_joint", 1e4)):
        elastic = elastic.with_springs({name: stiffness})
        setup(page, "springs")
        page.fill(f"input[aria-label='{name} N m/rad']", str(stiffness))
        page.keyboard.press("Enter")
        settled(page)
        shown = page.evaluate("() => window.cartstiff.numbers.result.stiffness.B")
        np.testing.assert_allclose(shown, cartstiff.analyse(elastic).matrices["B"], rtol=1e-12)
