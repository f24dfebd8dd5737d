"""Faults that the page once had: what is said, what stays, what does what its name says."""

import numpy as np
import pytest
from tools.screenshot import settled

import cartstiff
from tests.browser.test_page_state import TOOL, changed
from tests.support.pages import cloud_of, clouds_in, page_text, source_of


def test_zero_is_zero_where_limits_allow_it(serve, pages):
    page = pages.shared(serve("panda").url)
    page.click("button:has-text('Zero')")
    settled(page)
    zeros = [min(max(0.0, c.lower), c.upper) for c in cartstiff.load("panda").mechanism.coordinates]
    assert page.evaluate("() => window.cartstiff.state.q") == pytest.approx(zeros, abs=1e-12)
    assert page.evaluate("() => window.cartstiff.numbers.result.q") == pytest.approx(zeros)


def test_a_logarithmic_colour_bar_says_so(serve, pages):
    places = np.array([[0.1 * k, 0.2, 0.3] for k in range(5)])
    values = {"wide": 10.0 ** np.arange(5), "narrow": np.arange(1.0, 6.0)}
    cloud = cloud_of(places, values, {"wide": "N/m", "narrow": "N/m"}, 1)
    page = pages.open(serve("ur5", cloud=cloud).url)
    bar = page.locator("#colour-bar")
    assert bar.inner_text().split("\n")[0] == "wide, N/mm, logarithmic"
    assert bar.locator(".ends").inner_text().split() == ["0.001", "10"]
    changed(page, quantity_of_map="narrow")
    assert bar.inner_text().split("\n")[0] == "narrow, N/m"


def test_a_boundary_is_drawn_in_colours_of_named_limits(serve, pages, tmp_path):
    sides = ("most", "least")
    rows = [f'{0.1 * k},0.2,0.9,"leg{1 + k}, {sides[k % 2]}"' for k in range(6)]
    table = "\n".join(["x [m],y [m],z [m],limit", *rows, "0,0,1,singularity"])
    (tmp_path / "boundary.csv").write_text(table, encoding="utf-8")
    cloud = clouds_in(tmp_path / "boundary.csv", cartstiff.load("hexapod"))
    page = pages.open(serve("hexapod", cloud=cloud).url)
    lines = page.locator("#colour-bar").inner_text().split("\n")
    assert [line.strip("● ") for line in lines] == [
        "limit that cuts",
        "legs at least 0.5 m",
        "legs at most 1.2 m",
        "singularity",
    ]
    drawn = page.evaluate(
        """() => {
            const found = [];
            window.cartstiff.pane.viewer.scene.traverse((one) => {
                if (one.isPoints) found.push([...one.geometry.attributes.color.array]);
            });
            return found;
        }"""
    )
    colours = [tuple(one[3 * i : 3 * i + 3]) for one in drawn for i in range(7)]
    assert len(colours) == 7
    assert colours[0] == colours[2] == colours[4] != colours[1] == colours[3] == colours[5]
    assert len(set(colours)) == 3


LINK = """<link name="l{k}"><visual><geometry><mesh filename="gone{k}.stl"/></geometry></visual>
<inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>
</link>
<joint name="j{k}" type="revolute"><parent link="{parent}"/><child link="l{k}"/>
<origin xyz="0.1 0 0.2" rpy="{roll} 0 0"/><axis xyz="0 0 1"/>
<limit lower="-3" upper="3" effort="1" velocity="1"/></joint>"""


@pytest.fixture
def long_arm(tmp_path):
    """A file of eleven joints whose meshes are missing."""
    links = [
        LINK.format(k=k, parent=f"l{k - 1}" if k else "base", roll=1.2 * (k % 2)) for k in range(11)
    ]
    text = f'<robot name="r"><link name="base"/>{"".join(links)}</robot>'
    (tmp_path / "r.urdf").write_text(text, encoding="utf-8")
    return str(tmp_path / "r.urdf")


def test_a_long_list_of_joints_is_searched(serve, pages, long_arm):
    page = pages.open(serve(long_arm).url)
    sliders = page.locator("#left input[id^=slider-]:visible")
    assert sliders.count() == 11
    page.get_by_label("Find a joint").fill(" J1")
    assert sliders.count() == 2  # j1 and j10
    before = page.evaluate("() => window.cartstiff.numbers.result.q")
    sliders.nth(1).focus()
    page.keyboard.press("ArrowRight")
    settled(page)
    after = page.evaluate("() => window.cartstiff.numbers.result.q")
    assert [i for i, (x, y) in enumerate(zip(before, after, strict=True)) if x != y] == [10]
    page.get_by_label("Find a joint").fill("")
    assert sliders.count() == 11
    few = pages.shared(serve("ur5").url)
    assert not few.get_by_label("Find a joint").is_visible()


def test_missing_meshes_are_one_line_and_leave_the_picture_free(serve, pages, long_arm):
    page = pages.open(serve(long_arm).url)
    lines = page.evaluate("() => window.cartstiff.legend.lines")
    notes = [line["text"] for line in lines if line["mark"] == "note"]
    assert len([text for text in notes if "gone" in text]) == 1
    assert "and 10 more like it" in notes[0]
    legend, pane = page.locator("#legend").bounding_box(), page.locator("#pane").bounding_box()
    assert legend["height"] < 0.5 * pane["height"]
    assert np.abs(page.evaluate(TOOL)).max() < 0.95


def test_assumed_springs_are_said_with_the_answer(serve, pages):
    assert (
        pages.shared(serve("ur5").url).inner_text(".doubt") == "Springs illustrative, not measured"
    )
    (words,) = (n.message for n in cartstiff.load("ur3").notes if n.code == "stiffness-assumed")
    page = pages.open(serve("ur3").url)
    assert page.inner_text(".doubt") == f"Springs assumed: {words.replace('`', '')}"
    assert page.locator(".notes-card", has_text="o joint stiffness was given").count() == 0


def test_joints_that_lines_hold_are_said_with_the_answer(serve, pages):
    page = pages.open(serve("ur5").url)
    words = "lines hold the joints: no stiffness is assumed for them"
    page.evaluate(
        """(note) => {
            const store = window.cartstiff;
            store.numbers.result.notes.push(note);
            store.tell("numbers", { numbers: store.numbers });
        }""",
        {"code": "held-by-lines", "message": words, "values": {}},
    )
    assert page.inner_text(".doubt") == f"{words}; Springs illustrative, not measured"


_FLAT = """() => {
    const own = HTMLCanvasElement.prototype.getContext;
    HTMLCanvasElement.prototype.getContext = function (kind, ...more) {
        return kind.includes("webgl") ? null : own.call(this, kind, ...more);
    };
}"""


def test_a_browser_that_does_not_draw_in_three_dimensions_is_told(serve, chromium, tmp_path):
    (tmp_path / "page.html").write_text(page_text(source_of(cartstiff.load("ur5"))))
    page = chromium.new_page()
    page.add_init_script(f"({_FLAT})()")
    for address in (serve("ur5").url, (tmp_path / "page.html").as_uri()):
        page.goto(address)
        page.wait_for_function("() => document.body.innerText.includes('in three dimensions (')")
    page.close()


# Controls that can be seen and not be pressed: something else lies over their middle.
COVERED = """() => {
    const controls = [...document.querySelectorAll("button, select, input, summary")];
    return controls.flatMap((node) => {
        if (!node.checkVisibility({ visibilityProperty: true, opacityProperty: true })) return [];
        node.scrollIntoView({ block: "nearest" });
        const { left, top, width, height } = node.getBoundingClientRect();
        const there = document.elementFromPoint(left + width / 2, top + height / 2);
        if (there && (node.contains(there) || there.closest("label")?.contains(node))) return [];
        return [`${node.outerHTML.slice(0, 90)} under ${there?.outerHTML.slice(0, 60)}`];
    });
}"""


@pytest.mark.parametrize("size", [(1024, 768), (390, 844)])
def test_no_control_lies_under_another(serve, pages, size):
    page = pages.open(serve("ur5").url, viewport={"width": size[0], "height": size[1]})
    page.evaluate(
        "() => document.querySelectorAll('details').forEach((one) => { one.open = true; })"
    )
    settled(page)
    page.click("summary:has-text('Show')")  # its list lies over the picture, as it should
    assert page.evaluate(COVERED) == []
