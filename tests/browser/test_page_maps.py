"""Points of a map in the picture: their numbers, and the postures that they are of."""

import numpy as np
import pytest
from tools.screenshot import settled

import cartstiff
from cartstiff.maps import Axis, Grid, compute_map, open_map
from tests.browser.conftest import heard
from tests.support.pages import cloud_of, clouds_in, page_text, points_of_workspace, source_of

# Places on the screen, from -1 to 1, of the points of a map.
POINTS = """() => {
    const { viewer } = window.cartstiff.pane;
    const node = viewer.scene_tree.find(["meshcat", "cartstiff", "map", "<object>"]).object;
    viewer.scene.updateMatrixWorld(true);
    const { array } = node.geometry.attributes.position;
    return Array.from({ length: array.length / 3 }, (_, i) => {
        const at = viewer.camera.position.clone().fromArray(array, 3 * i);
        at.applyMatrix4(node.matrixWorld).project(viewer.camera);
        return [at.x, at.y];
    });
}"""


def test_a_whole_workspace_is_in_the_picture(serve, pages, tmp_path):
    """On a live page and in a file, at first and from every side."""
    elastic = cartstiff.load("hexapod")
    reached = cartstiff.workspace(elastic, directions=60, scan=12, fits=False)
    cloud = points_of_workspace(reached)
    assert len(cloud.positions) == len(reached.boundary) + len(reached.singular.surface)
    file = tmp_path / "hexapod.html"
    file.write_text(cartstiff.show(elastic, workspace=reached, static=True).html, encoding="utf-8")
    for url in (serve("hexapod", cloud=cloud).url, file.as_uri()):
        page = pages.open(url)
        for preset in ("3D", "Front", "Side", "Top"):
            page.get_by_role("button", name=preset, exact=True).click()
            settled(page)
            assert np.abs(page.evaluate(POINTS)).max() < 1.0, preset
        assert page.inner_text("#colour-bar").startswith("softest stiffness, ")
        assert "bright is good" in page.inner_text("#colour-bar")
    page = pages.open(serve("hexapod", cloud=cloud).url)
    page.click("summary:has-text('Show')")
    page.select_option("select[aria-label='Quantity of the map']", "limit that cuts")
    settled(page)
    kinds = page.locator(".kind").all_text_contents()
    assert "singular surface" in " ".join(kinds)
    assert len(kinds) <= 5


def test_a_point_of_a_map_becomes_the_posture(serve, pages, tmp_path):
    arm = cartstiff.load("ur5")
    axes = {"shoulder_pan_joint": Axis(-0.9, 1.2, 4), "elbow_joint": Axis(0.7, 1.9, 4)}
    compute_map(arm, Grid(axes, arm.names, arm.q), ["translation_condition"], tmp_path / "m.zarr")
    data = open_map(tmp_path / "m.zarr")
    cloud = clouds_in(tmp_path / "m.zarr", arm)
    file = tmp_path / "ur5.html"
    file.write_text(page_text(source_of(arm, cloud=cloud)), encoding="utf-8")
    (values,) = cloud.values.values()
    assert np.array_equal(cloud.q, data["q"].values.reshape(-1, 6))
    for url in (serve("ur5", cloud=cloud).url, file.as_uri()):
        page = pages.open(url)
        start = page.evaluate("() => window.cartstiff.state.q")
        box = page.locator("#pane canvas").bounding_box()
        places = np.array(page.evaluate(POINTS))
        # Those that no part of the mechanism lies before are pointed at; one is enough.
        for i in np.argsort(-np.hypot(*places.T)):
            x, y = places[i]
            x, y = box["x"] + box["width"] * (1 + x) / 2, box["y"] + box["height"] * (1 - y) / 2
            page.mouse.move(x, y)
            page.evaluate("() => new Promise((done) => requestAnimationFrame(() => done()))")
            tip = page.locator(".tip:not([hidden])")
            if tip.count() and "click: this posture" in tip.inner_text():
                break
        said = tip.inner_text().split(": ")[1].split(";")[0]
        assert any(float(said) == pytest.approx(value, rel=6e-4) for value in values)
        page.mouse.click(x, y)
        settled(page)
        q = page.evaluate("() => window.cartstiff.numbers.result.q")
        stood = int(np.argmin(np.abs(cloud.q - q).max(axis=1)))
        assert np.allclose(q, cloud.q[stood], rtol=0, atol=1e-13)
        assert float(said) == pytest.approx(values[stood], rel=6e-4)
        assert np.hypot(*(places[stood] - places[i])) < 0.02
        page.keyboard.press("u")
        settled(page)
        assert page.evaluate("() => window.cartstiff.state.q") == start
        page.click("summary:has-text('Show')")
        page.click("#map-choice button:has-text('highest')")
        settled(page)
        q = page.evaluate("() => window.cartstiff.numbers.result.q")
        assert np.allclose(q, cloud.q[np.argmax(values)], rtol=0, atol=1e-13)


def test_points_that_are_no_postures_say_so(serve, pages, tmp_path):
    chain = cartstiff.load("five-bar")
    there = chain.mechanism.closed(chain.q)
    away = there.pose[:3, 3] + np.outer([0.0, 0.3], [1.0, 0.0, 0.0])
    cloud = cloud_of(away, {"force": np.array([1.5, 2.5])}, {"force": "N"})
    cables = cartstiff.load("cable-robot")  # which the browser does not compute
    middle, corner = cartstiff.analyse(cables).pose[:3, 3], cables.mechanism.anchors.min(axis=0)
    near = middle + np.outer([0.0, 0.7], (corner - middle) * [1.0, 0.8, 0.0])
    own = cloud_of(near, cloud.values, cloud.units, q=np.array([cables.q] * 2))
    file = tmp_path / "cables.html"
    file.write_text(page_text(source_of(cables, cloud=own)), encoding="utf-8")
    boundary = cloud_of(away, {"limit": np.array(["singular", "motor, most"])}, {"limit": ""})
    for url, words, tip in (
        (file.as_uri(), "`cartstiff view` goes", "force: 2.5 N"),
        (serve("five-bar", cloud=cloud).url, "holds no postures", "force: 2.5 N"),
        (serve("five-bar", cloud=boundary).url, "holds no postures", "limit: motor, most"),
    ):
        page = pages.open(url)
        before = page.evaluate("() => window.cartstiff.state.q")
        box = page.locator("#pane canvas").bounding_box()
        x, y = page.evaluate(POINTS)[1]
        x, y = box["x"] + box["width"] * (1 + x) / 2, box["y"] + box["height"] * (1 - y) / 2
        page.mouse.move(x, y)
        page.mouse.click(x, y)
        assert page.inner_text(".tip:not([hidden])") == tip
        heard(page, words)
        settled(page)
        assert page.evaluate("() => window.cartstiff.state.q") == before
