"""The page and a report as pictures: ``python tools/screenshot.py`` writes them to docs/images/.

Needs a Chromium (tools/provide_browser.sh) and playwright.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
TARGET = ROOT / "docs" / "images" / "page.png"
REPORT_TARGET = TARGET.with_name("report.png")

#: A UR5 that carries a weight of 100 N, a state kept before the elbow was bent.
MECHANISM = "ur5"
STATE = (
    "#q=0.3,-1.1,1.65,-0.7,0.9,0.2&ghost=0.3,-1.1,1.4,-0.7,0.9,0.2"
    "&connection=A&load=0,0,0,0,0,-100&load_axes=world"
)
SIZE = {"width": 1280, "height": 720}

#: The report of the README; its first screen is taken.
REPORT = ["report", "ur10", "--tcp", "0,0,0.15", "--payload", "4,0,0,-0.05"]
REPORT += ["--load", "0,0,0,0,0,-300", "--world"]
REPORT_SIZE = {"width": 900, "height": 960}

#: Software rendering, no calls home; as root a sandbox is not to be had.
FLAGS = [
    "--no-sandbox",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    # The picture alone takes WebGL: letters and boxes are drawn several times quicker without.
    "--disable-gpu-rasterization",
    "--disable-gpu-compositing",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--hide-scrollbars",
]
_NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")

_SETTLED = """() => new Promise((resolve, reject) => {
    const end = performance.now() + 60000;
    const look = () => {
        const store = window.cartstiff;
        const idle = store.busy === null && !store.wanted && store.waiting.size === 0
            && !store.rows.some((row) => row.late);
        if (idle && !store.pane.viewer.needs_render) resolve();
        else if (performance.now() > end) reject(new Error("the page does not come to rest"));
        else setTimeout(look, 15);
    };
    setTimeout(look, 30);
})"""


def launch(playwright: Any) -> Any:
    """A Chromium: that of CARTSTIFF_CHROMIUM, one on the path, or playwright's own."""
    named = os.environ.get("CARTSTIFF_CHROMIUM")
    found = named or next((path for name in _NAMES if (path := shutil.which(name))), None)
    return playwright.chromium.launch(executable_path=found, args=FLAGS)


def settled(page: Any) -> None:
    """Wait until everything asked for has been answered and drawn."""
    page.evaluate(_SETTLED)


def ready(page: Any) -> None:
    """Wait for the first numbers and the first picture."""
    page.wait_for_selector("#verdict:not([data-level=none])")
    settled(page)


def pictures(browser: Any, url: str, themes: tuple[str, ...] = ("light",)) -> list[bytes]:
    """PNGs of a page at rest, one for each theme."""
    context = browser.new_context(viewport=SIZE, color_scheme="light", reduced_motion="reduce")
    page = context.new_page()
    page.set_default_timeout(300_000)
    page.goto(url)
    ready(page)
    page.wait_for_selector("#strip .plot .curve-0")
    found = []
    for theme in themes:
        if page.get_attribute("html", "data-theme") != theme:
            page.keyboard.press("t")
        settled(page)
        found.append(page.screenshot())
    context.close()
    return found


def report_picture(browser: Any) -> bytes:
    """PNG of the first screen of the README's report, with its page drawn."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "report.html"
        command = [sys.executable, "-m", "cartstiff", *REPORT, "-o", str(file)]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
        page = browser.new_page(viewport=REPORT_SIZE, color_scheme="light", reduced_motion="reduce")
        page.set_default_timeout(300_000)
        page.goto(file.as_uri())
        page.wait_for_timeout(15_000)  # the page inside it, by software rendering
        png: bytes = page.screenshot()
        page.close()
    return png


def main() -> None:
    """Serve the page, make the report, take their pictures, write them."""
    from playwright.sync_api import sync_playwright

    import cartstiff
    from cartstiff.core.writing import write_whole
    from cartstiff.shown.page.server import Background
    from cartstiff.shown.page.source import Source

    server = Background(Source(cartstiff.load(MECHANISM)))
    try:
        with sync_playwright() as playwright:
            browser = launch(playwright)
            (png,) = pictures(browser, server.url + STATE)
            found = {TARGET: png, REPORT_TARGET: report_picture(browser)}
            browser.close()
    finally:
        server.close()
    for target, png in found.items():
        write_whole(target, png)
        print(f"Wrote {target} ({len(png) / 1000:.0f} kB)")


if __name__ == "__main__":
    argparse.ArgumentParser(description="Write the pictures of the README anew.").parse_args()
    main()
