"""How the page feels in the hand: ``python benchmarks/page_hands.py [--drag SECONDS]``.

In headless Chromium with software rendering: script of a picture in an exported file (in processor
time, so that other work on the machine does not count), from a hand on the tool to the picture,
tables a second of a large closed chain, from opening to the first picture on this machine and over
a slow line, and, if asked, what grows while a slider is dragged.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Callable
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from statistics import median
from threading import Thread
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from tools.screenshot import launch, ready, settled

import cartstiff
from cartstiff.shown.page.export import export_page
from cartstiff.shown.page.server import Background
from cartstiff.shown.page.source import Source

SIZE = {"width": 1280, "height": 720}
LOAD = "#load=0,0,0,0,0,-100&load_axes=inertial"
#: Milliseconds that are required.
SCRIPT, DRAG, OPEN, OPEN_SLOWLY = 8.0, 40.0, 1500.0, 8000.0
#: Tables a second by hand of a chain of 45 coordinates.
TABLES = 20.0
#: Bytes a second of 1.6 Mbit/s.
SLOW = 200_000

_FIRST = """document.addEventListener("cartstiff:rendered",
    () => { window.opened ??= performance.now(); });"""
# The plot runs along the coordinate that is moved: nothing but numbers and picture is made.
_ALONG = """() => {
    const what = document.querySelector("#strip select");
    what.value = what.options[0].value;
    what.dispatchEvent(new Event("change"));
}"""
_SLIDE = """([count, until]) => new Promise((resolve) => {
    const slider = document.querySelector(".posture-card .slider input[type=range]");
    const [low, high] = [Number(slider.min), Number(slider.max)];
    const times = [];
    window.phase ??= 0;
    window.home ??= Number(slider.value);  // a closed chain does not reach everything
    const next = () => {
        const done = count === null ? performance.now() > window.ends : times.length >= count;
        if (done) return resolve(times);
        slider.value = window.home + (high - low) * 0.02 * Math.sin(0.1 * window.phase++);
        const start = performance.now();
        document.addEventListener(until, () => {
            times.push(performance.now() - start);
            requestAnimationFrame(next);
        }, { once: true });
        slider.dispatchEvent(new Event("input"));
    };
    next();
})"""
# The ball at M, on the screen; and what follows a pointer there.
_TOOL = """() => {
    const { viewer } = window.cartstiff.pane;
    const node = viewer.scene_tree.find(["meshcat", "cartstiff", "M"]).object;
    node.updateWorldMatrix(true, false);
    const at = viewer.camera.position.clone().setFromMatrixPosition(node.matrixWorld);
    at.project(viewer.camera);
    const box = viewer.renderer.domElement.getBoundingClientRect();
    return [box.left + box.width * (1 + at.x) / 2, box.top + box.height * (1 - at.y) / 2];
}"""
_PULL = """([x, y, count]) => new Promise((resolve) => {
    const canvas = window.cartstiff.pane.viewer.renderer.domElement;
    const times = [];
    const point = (type, dx, dy) => canvas.dispatchEvent(new PointerEvent(type, { bubbles: true,
        pointerId: 1, button: type === "pointermove" ? -1 : 0, buttons: 1,
        clientX: x + dx, clientY: y + dy }));
    canvas.setPointerCapture = canvas.releasePointerCapture = () => {};
    canvas.dispatchEvent(new PointerEvent("pointermove",
        { bubbles: true, clientX: x, clientY: y }));
    requestAnimationFrame(() => {
        point("pointerdown", 0, 0);
        const next = () => {
            if (times.length >= count) { point("pointerup", 0, 0); return resolve(times); }
            const start = performance.now();
            document.addEventListener("cartstiff:rendered", () => {
                times.push(performance.now() - start);
                setTimeout(next, 300);  // software is still drawing the last picture
            }, { once: true });
            const angle = 0.4 * times.length;
            point("pointermove", 12 * Math.sin(angle), 8 - 8 * Math.cos(angle));
        };
        next();
    });
})"""


class Quiet(SimpleHTTPRequestHandler):
    """Serves a folder without a word."""

    def log_message(self, *_: Any) -> None:
        """Nothing."""


def tables(browser: Any, name: str, load: str) -> float:
    """Tables a second under a dragged slider."""
    server = Background(Source(cartstiff.load(name)))
    page, _ = opened(browser, server.url, load)  # its curves are computed meanwhile
    times = page.evaluate(_SLIDE, [60, "cartstiff:table"])[20:]
    page.close()
    server.close()
    return 1e3 / median(times)


def opened(browser: Any, url: str, load: str = LOAD, slowly: bool = False) -> tuple[Any, float]:
    """A page with its first picture, and the milliseconds that it took."""
    page = browser.new_page(viewport=SIZE)
    page.set_default_timeout(600_000)
    page.add_init_script(_FIRST)
    if slowly:
        line = {
            "offline": False,
            "latency": 100,
            "downloadThroughput": SLOW,
            "uploadThroughput": SLOW,
        }
        session = page.context.new_cdp_session(page)
        session.send("Network.enable")
        session.send("Network.emulateNetworkConditions", line)
    page.goto(url + load)
    page.wait_for_function("() => window.opened")
    return page, page.evaluate("() => window.opened")


def at_rest(page: Any) -> None:
    """Wait until nothing but what a hand asks for is computed."""
    ready(page)
    page.evaluate(_ALONG)
    page.wait_for_timeout(1500)
    settled(page)


def processor(page: Any) -> Callable[[], dict[str, float]]:
    """What the page's thread has spent so far, in seconds of processor time, by kind of work."""
    session = page.context.new_cdp_session(page)
    session.send("Performance.enable", {"timeDomain": "threadTicks"})

    def read() -> dict[str, float]:
        metrics = session.send("Performance.getMetrics")["metrics"]
        return {entry["name"]: entry["value"] for entry in metrics}

    return read


def script(page: Any, count: int = 120) -> tuple[float, float]:
    """Milliseconds of processor time a picture: script, and all that its thread does."""
    at_rest(page)
    read = processor(page)
    page.evaluate(_SLIDE, [150, "cartstiff:rendered"])  # until it is warm
    before = read()
    page.evaluate(_SLIDE, [count, "cartstiff:rendered"])
    after = read()
    spent = {name: 1e3 * (after[name] - before[name]) / count for name in after}
    return spent["ScriptDuration"], spent["TaskDuration"]


def grown(page: Any, seconds: float) -> tuple[float, float]:
    """MB a minute by which the heap grows under a dragged slider, and nodes of the document."""
    at_rest(page)
    session, read = page.context.new_cdp_session(page), processor(page)
    marks = []
    for part in (0.2, 0.8):  # what grows at first only is no growth
        page.evaluate("(ms) => { window.ends = performance.now() + ms; }", 1e3 * part * seconds)
        page.evaluate(_SLIDE, [None, "cartstiff:rendered"])
        session.send("HeapProfiler.collectGarbage")
        marks.append((read()["JSHeapUsedSize"], read()["Nodes"]))
    (first, few), (last, many) = marks
    return (last - first) / 1e6 / (0.8 * seconds / 60), many - few


def verdict(value: float, limit: float) -> str:
    return f"{value:.1f} ({'met' if value < limit else 'MISSED'}: < {limit:.0f})"


def main() -> None:
    """Print the tables of benchmarks/README.md."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--drag", type=float, default=0.0, metavar="SECONDS")
    parser.add_argument("names", nargs="*", default=["ur5", "hexapod"], metavar="NAME")
    options = parser.parse_args()
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright, tempfile.TemporaryDirectory() as folder:
        files = ThreadingHTTPServer(("127.0.0.1", 0), partial(Quiet, directory=folder))
        Thread(target=files.serve_forever, daemon=True).start()
        browser = launch(playwright)
        for name in options.names:
            elastic = cartstiff.load(name)
            file = Path(folder) / f"{name}.html"
            file.write_text(export_page(Source(elastic)), encoding="utf-8")
            sent = f"http://127.0.0.1:{files.server_port}/{file.name}"
            server = Background(Source(elastic))
            for what, url, line in (
                ("live", server.url, server.url),
                ("file", file.as_uri(), sent),
            ):
                page, here = opened(browser, url)
                if what == "file":
                    mine, every = script(page)
                    print(
                        f"{name}, file: script a picture {verdict(mine, SCRIPT)} ms of processor"
                        f" time, all work of its thread {every:.1f} ms",
                        flush=True,
                    )
                at_rest(page)
                x, y = page.evaluate(_TOOL)
                pulls = page.evaluate(_PULL, [x, y, 25])[5:]
                print(
                    f"{name}, {what}: hand on the tool to picture {verdict(median(pulls), DRAG)} ms"
                )
                if options.drag:
                    grows, nodes = grown(page, options.drag)
                    print(
                        f"{name}, {what}: {options.drag:.0f} s of dragging: {grows:+.2f} MB/min,"
                        f" {nodes:+.0f} nodes",
                        flush=True,
                    )
                page.close()
                slow, there = opened(browser, line, slowly=True)
                slow.close()
                print(
                    f"{name}, {what}: first picture after {verdict(here, OPEN)} ms here, "
                    f"{verdict(there, OPEN_SLOWLY)} ms at 1.6 Mbit/s",
                    flush=True,
                )
            server.close()
        for load in ("", LOAD):
            rate = tables(browser, "3-rrr", load)
            met = "met" if rate > TABLES else "MISSED"
            words = "loaded" if load else "no load"
            print(f"3-rrr, {words}: {rate:.0f} tables a second ({met}: > {TABLES:.0f})")
        browser.close()


if __name__ == "__main__":
    main()
