"""The page in a hand as a GIF: ``python -m tools.animation`` writes docs/images/page.gif anew.

A UR5 that carries 100 N is moved by its tool, then its load is pulled, then it sways under it.
Needs a Chromium (tools/provide_browser.sh), playwright and Pillow.
"""

from __future__ import annotations

import io
import sys
from pathlib import Path
from typing import Any

from tools.screenshot import MECHANISM, ROOT, launch, ready, settled

TARGET = ROOT / "docs" / "images" / "page.gif"
#: Of the window, and of the GIF.
SIZE, WIDTH = {"width": 1280, "height": 720}, 800
#: Time of a picture (ms), and colours of all.
EACH, COLOURS = 90, 255
_STATE = "#q=0.3,-1.1,1.65,-0.7,0.9,0.2&load=0,0,0,0,0,-100&load_axes=world"
# Where a part of the picture is on the screen.
_AT = """([names, x]) => {
    const { viewer } = window.cartstiff.pane;
    const node = viewer.scene_tree.find(["meshcat", "cartstiff", ...names]).object;
    node.updateWorldMatrix(true, false);
    const at = viewer.camera.position.clone().set(x, 0, 0).applyMatrix4(node.matrixWorld);
    at.project(viewer.camera);
    const box = viewer.renderer.domElement.getBoundingClientRect();
    return [box.left + box.width * (1 + at.x) / 2, box.top + box.height * (1 - at.y) / 2];
}"""
# A cursor: a screenshot has none.
_CURSOR = """() => {
    const node = document.createElement("div");
    node.style.cssText = "position:fixed;width:14px;height:14px;margin:-8px;border-radius:50%;" +
        "border:2px solid #b3261e;z-index:99;pointer-events:none";
    document.body.append(node);
    addEventListener("pointermove", ({ clientX, clientY }) => {
        node.style.left = `${clientX}px`;
        node.style.top = `${clientY}px`;
    }, true);
}"""


def _drag(page: Any, names: list[str], x: float, way: list[tuple[float, float]]) -> list[bytes]:
    """Take hold of a part and move it; a picture after each step."""
    u, v = page.evaluate(_AT, [names, x])
    page.mouse.move(u, v)
    settled(page)
    page.mouse.down()
    shots = []
    for du, dv in way:
        page.mouse.move(u + du, v + dv)
        settled(page)
        shots.append(page.screenshot())
    page.mouse.up()
    return shots


def _shots(page: Any) -> list[bytes]:
    shots = [page.screenshot()] * 6
    line = [k / 12 for k in range(1, 13)]
    shots += _drag(page, ["M"], 0, [(-60 * s, -70 * s) for s in line])
    shots += _drag(page, ["wrench", "force", "arrow"], 1, [(10 * s, 50 * s) for s in line[1::2]])
    shots += _drag(page, ["M"], 0, [(60 * s, 70 * s) for s in line])
    page.click("text=Show it move")
    for _ in range(14):
        page.wait_for_timeout(60)
        shots.append(page.screenshot())
    return shots


def main(target: Path = TARGET) -> None:
    """Serve the page, move it, write the GIF."""
    from PIL import Image
    from playwright.sync_api import sync_playwright

    import cartstiff
    from cartstiff.core.writing import write_whole
    from cartstiff.shown.page.server import Background
    from cartstiff.shown.page.source import Source

    server = Background(Source(cartstiff.load(MECHANISM)))
    try:
        with sync_playwright() as playwright:
            browser = launch(playwright)
            page = browser.new_page(viewport=SIZE, color_scheme="light")
            page.set_default_timeout(60_000)
            page.goto(server.url + _STATE)
            ready(page)
            page.wait_for_function("() => window.cartstiff.source.local")
            page.evaluate(_CURSOR)
            settled(page)
            shots = _shots(page)
            browser.close()
    finally:
        server.close()
    size = (WIDTH, WIDTH * SIZE["height"] // SIZE["width"])
    pictures = [Image.open(io.BytesIO(png)).convert("RGB").resize(size) for png in shots]
    palette = pictures[0].quantize(COLOURS)
    few = [one.quantize(palette=palette, dither=Image.Dither.NONE) for one in pictures]
    out = io.BytesIO()
    few[0].save(out, "GIF", save_all=True, append_images=few[1:], duration=EACH, loop=0)
    write_whole(target, out.getvalue())
    print(f"Wrote {target} ({len(few)} pictures, {out.tell() / 1e6:.2f} MB)")


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:]))
