"""The legend's bar and a saved picture: lengths on the screen, and what a file carries."""

import io

import numpy as np
import pytest
from PIL import Image
from tools.screenshot import settled

import cartstiff
from cartstiff import __version__
from tests.support.pages import page_text, source_of

# Dots between the images of two points, both `length` from M to either side of the line of sight.
ACROSS = """(length) => {
    const { viewer, size } = window.cartstiff.pane;
    const { camera } = viewer;
    const M = viewer.scene_tree.find(["meshcat", "cartstiff", "M"]).object;
    const at = camera.position.clone().setFromMatrixPosition(M.matrixWorld);
    const e = camera.matrixWorld.elements;
    const ends = [0.5, -0.5].map((side) => at.clone()
        .add({ x: e[0] * side * length, y: e[1] * side * length, z: e[2] * side * length }));
    const [a, b] = ends.map((point) => point.project(camera));
    return 0.5 * size[0] * Math.hypot(a.x - b.x, (a.y - b.y) * size[1] / size[0]);
}"""


def test_the_bar_is_as_long_as_it_says(serve, pages):
    """0.1 m by the projection of the camera itself, also after a turn and a zoom."""
    page = pages.shared(serve("ur5").url)
    for key in ("", "ArrowLeft", "+", "+", "+"):
        if key:
            page.focus("#pane")
            page.keyboard.press(key)
        settled(page)
        assert page.inner_text("#legend .num").strip() == "10 cm"
        width = page.evaluate("() => parseFloat(document.querySelector('.scale').style.width)")
        assert width == pytest.approx(page.evaluate(ACROSS, 0.1), rel=1e-3)
        assert width > 15


def test_an_address_s_posture_is_in_the_picture(serve, pages):
    """An arm stretched upwards, where the mechanism's own posture would have been framed."""
    page = pages.open(serve("ur5").url + "#q=0.3,-1.1,0.1,-0.7,0.9,0.2")
    settled(page)
    page.wait_for_function("() => !window.cartstiff.waiting.size")
    settled(page)
    up = page.evaluate(
        """() => {
        const { viewer } = window.cartstiff.pane;
        viewer.scene.updateMatrixWorld(true);
        const M = viewer.scene_tree.find(["meshcat", "cartstiff", "M"]).object;
        const at = viewer.camera.position.clone().setFromMatrixPosition(M.matrixWorld);
        return at.project(viewer.camera).y;
    }"""
    )
    assert abs(up) < 0.9


def test_legs_have_the_colours_of_their_forces(serve, pages, tmp_path):
    """Green in tension, pink in compression, live and in a file: the page colours them itself."""
    file = tmp_path / "legs.html"
    file.write_text(page_text(source_of(cartstiff.load("stewart-gough"))), encoding="utf-8")
    for url in (serve("stewart-gough").url, file.as_uri()):
        page = pages.open(url)
        settled(page)
        legs, high, colours = page.evaluate(
            """() => {
            const { numbers, legend, pane } = window.cartstiff;
            return [numbers.legs.map(({ tension }) => tension), legend.tension.limits[1],
                numbers.legs.map((_, i) => pane.part("mechanism", "legs",
                    `line ${i + 1}`, "rod", "<object>").material.color.toArray())];
        }"""
        )
        assert min(legs) < -0.1 * high < 0.1 * high < max(legs)
        for tension, (r, g, _) in zip(legs, colours, strict=True):
            assert (g > r) == (tension > 0.05 * high) or abs(tension) < 0.05 * high


@pytest.mark.parametrize("times", [1, 4])
def test_a_saved_picture_carries_what_it_shows(serve, pages, tmp_path, times):
    """Of its size; the words below are read where they are put together, before they are dots."""
    page = pages.shared(serve("ur5").url)
    page.evaluate(
        "() => window.cartstiff.change({ load_axes: 'body', load: [0, 0, 0, 0, 0, -100] })"
    )
    settled(page)
    # The drawing that becomes the PNG passes by as the source of an image.
    page.evaluate(
        """() => {
        const { set } = Object.getOwnPropertyDescriptor(HTMLImageElement.prototype, "src");
        Object.defineProperty(HTMLImageElement.prototype, "src", {
            set(url) { window.drawn = url; set.call(this, url); }, configurable: true });
    }"""
    )
    with page.expect_download() as download:
        page.select_option("select[aria-label='Save the picture']", f"png{times}")
    download.value.save_as(tmp_path / "picture.png")
    image = Image.open(io.BytesIO((tmp_path / "picture.png").read_bytes()))
    width, height = page.evaluate("() => window.cartstiff.pane.size")
    assert image.size[0] == times * width
    assert image.size[1] > times * height
    text = page.evaluate(
        """() => new DOMParser().parseFromString(decodeURIComponent(window.drawn.split(",").slice(1)
            .join(",")), "image/svg+xml").documentElement.textContent"""
    )
    for words in (
        "ur5",
        "tool0",
        "10 cm",
        "load (0, 0, 0, 0, 0, -100)",
        f"cartstiff {__version__}",
    ):
        assert words in text
    for line in page.evaluate("() => window.cartstiff.legend.lines.map(({ text }) => text)"):
        assert line.split(" (")[0] in text
    rows = np.asarray(image.convert("L"), float)[times * height :]
    assert (rows < 100).sum() > 500  # letters


def test_a_file_says_the_same_as_the_server(serve, pages, tmp_path):
    """Legend and scale, at a posture where the stiffest axis is cut."""
    elastic = cartstiff.load("ur5")
    path = tmp_path / "page.html"
    path.write_text(page_text(source_of(elastic)), "utf-8")
    change = """() => window.cartstiff.change({ q: [0.3, -1.1, 0.05, -0.7, 0.9, 0.2],
        others: "held", drawn: "stiffness", load_axes: "body", load: [0, 3, 0, 0, 0, -100] })"""
    legend = "() => window.cartstiff.legend"
    said = []
    for page in (pages.shared(serve("ur5").url), pages.open(path.as_uri(), offline=True)):
        page.evaluate(change)
        settled(page)
        said.append(page.evaluate(legend))
    live, file = said
    assert live["lines"] == file["lines"]
    assert live["bar"] == pytest.approx(file["bar"])
    assert "; cut at " in live["lines"][0]["text"]
    for freedom, facts in live["measures"].items():
        for name, value in facts.items():
            if value is not None:
                assert file["measures"][freedom][name] == pytest.approx(value), name
