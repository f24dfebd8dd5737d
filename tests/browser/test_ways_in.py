"""Every way into the page: no banner, nothing in the console, and what was asked for is drawn."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from tools.screenshot import settled

import cartstiff
from cartstiff.maps import Axis, Grid, compute_map
from tests.browser.conftest import short, unfold
from tests.support.pages import page_text, served, stated

# What the banner says, from the first moment on; what the page puts off comes ten times sooner.
BANNERS = """
const later = window.setTimeout.bind(window);
window.setTimeout = (task, ms = 0, ...more) => later(task, ms > 100 ? ms / 10 : ms, ...more);
window.banners = [];
new MutationObserver(() => {
  const banner = document.querySelector("#banner");
  if (banner && !banner.hidden) window.banners.push(banner.textContent);
}).observe(document, { childList: true, subtree: true, attributes: true });
"""
# Everything that a message is sent for, once, one after the other.
ALL_QUESTIONS = """async () => {
    const pause = (ms) => new Promise((done) => setTimeout(done, ms));
    const store = window.cartstiff;
    const rest = async () => {
        do await pause(60); while (store.busy !== null || store.wanted || store.waiting.size);
    };
    const choose = async (label, value) => {
        const select = document.querySelector(`select[aria-label='${label}']`);
        select.value = value;
        select.dispatchEvent(new Event("change"));
        await rest();
    };
    const offered = (label) => {
        const { options } = document.querySelector(`select[aria-label='${label}']`);
        return [...options].map(({ value }) => value);
    };
    for (const value of offered("Along what")) {
        await choose("Along what", value);
        await pause(700);
        await rest();
    }
    for (const value of offered("Values of")) await choose("Values of", value);
    document.querySelector("button[data-preset=top]").click();
    await rest();
    for (const name of ["Random", "Home"]) {
        const buttons = [...document.querySelectorAll(".posture-card button")];
        buttons.find(({ textContent }) => textContent === name).click();
        await rest();
    }
    store.keep();
    await rest();
    store.reach({ pose: store.numbers.result.pose, turning: true });
    await rest();
    document.querySelector(".moved-card .head button, .moved-card button")?.click();
    await rest();
    for (const button of document.querySelectorAll("#map-choice button")) {
        button.click();
        await rest();
    }
    for (const do_ of ["result", "analysis"]) await store.ask({ do: do_ });
    if (store.source.live) {
        document.querySelector(".modes-card").open = true;
        await pause(200);
        await rest();
    }
    await pause(10000); // a second: the page's own arithmetic
    await rest();
}"""


@pytest.fixture(scope="module")
def files(tmp_path_factory) -> Path:
    """A trajectory with times and a map of a UR5."""
    folder = tmp_path_factory.mktemp("ways")
    arm = cartstiff.load("ur5")
    rows = [[t, *(arm.q + 0.1 * t)] for t in np.linspace(0, 1, 4)]
    lines = [",".join(["time", *arm.names]), *(",".join(map(repr, map(float, r))) for r in rows)]
    (folder / "postures.csv").write_text("\n".join(lines) + "\n")
    axes = {"elbow_joint": Axis(0.7, 1.9, 5)}
    compute_map(arm, Grid(axes, arm.names, arm.q), ["translation_condition"], folder / "map.zarr")
    return folder


WAYS = {
    "ur5": ("ur5", {}),
    "ur5 --trajectory": ("ur5", {"trajectory": "postures.csv"}),
    "ur5 --map": ("ur5", {"map_path": "map.zarr"}),
    "hexapod --workspace": ("hexapod", {"workspace": True}),
    "stewart-gough": ("stewart-gough", {}),
    "five-bar": ("five-bar", {}),
}


@pytest.mark.parametrize("kind", ["live", "exported"])
@pytest.mark.parametrize("way", WAYS)
def test_a_way_in_shows_no_banner_and_no_error(way, kind, files, pages, tmp_path, monkeypatch):
    name, shown = WAYS[way]
    monkeypatch.chdir(files)
    if isinstance(path := shown.get("trajectory"), str):
        shown = {"trajectory": Path(path)}
    source = short(stated(name, shown))
    server = None
    if kind == "live":
        server = served(source)
        url = server.url
    else:
        file = tmp_path / "page.html"
        file.write_text(page_text(source), encoding="utf-8")
        url = file.as_uri()
    page = pages.blank(offline=kind == "exported")
    page.add_init_script(BANNERS)
    page.goto(url)
    page.wait_for_selector("#verdict:not([data-level=none])")
    settled(page)
    page.wait_for_selector("#strip .plot .curve", state="attached")
    if source.trajectory is not None:
        assert page.input_value("select[aria-label='Along what']") == "series:0"
    if source.cloud is not None:
        assert page.is_visible("#colour-bar")
    unfold(page)
    page.evaluate(ALL_QUESTIONS)
    settled(page)
    assert page.evaluate("() => window.banners") == []
    pages.check()
    if server is not None:
        server.close()
