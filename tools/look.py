"""The page at every size: ``python -m tools.look -o FOLDER [NAME ...]`` takes its pictures.

For each bundled mechanism, size and theme it tells what is cut off and which words cover others;
``--exported`` looks at the files instead of the live page.
Needs a Chromium (tools/provide_browser.sh) and playwright.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from tools.screenshot import launch, ready, settled

#: A screen, a large one, a tablet, a phone upright and across.
SIZES = ((1440, 900), (2560, 1440), (1024, 768), (390, 844), (844, 390))

#: Tells what is wrong with the picture of a page.
FAULTS = Path(__file__).with_name("faults.js").read_text(encoding="utf-8")


def looked_at(
    page: Any, size: tuple[int, int], folder: Path | None = None, name: str = ""
) -> list[str]:
    """Faults of a page at a size; its picture goes into a folder."""
    page.set_viewport_size({"width": size[0], "height": size[1]})
    page.evaluate(
        "() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))"
    )
    page.evaluate("() => scrollTo(0, 0)")
    settled(page)
    faults: list[str] = page.evaluate(FAULTS)
    if folder is not None:
        page.screenshot(path=folder / f"{name}-{size[0]}.png", full_page=size[0] < 1000)
    return faults


@contextmanager
def address(name: str, exported: bool) -> Iterator[str]:
    """Where the page of a mechanism is, live or as a file."""
    import cartstiff
    from cartstiff.shown.page.export import export_page
    from cartstiff.shown.page.server import Background
    from cartstiff.shown.page.source import Source

    source = Source(cartstiff.load(name))
    if exported:
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "page.html"
            file.write_text(export_page(source), encoding="utf-8")
            yield file.as_uri()
        return
    server = Background(source)
    try:
        yield server.url
    finally:
        server.close()


def main() -> int:
    """Look at the pages; 1 if there are faults."""
    from playwright.sync_api import sync_playwright

    from cartstiff.files.catalogue import bundled_files

    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME")
    parser.add_argument("-o", "--output", type=Path, default=None)
    parser.add_argument("--exported", action="store_true")
    parser.add_argument("--load", action="store_true", help="with a load of 100 downwards")
    parser.add_argument("--theme", choices=("light", "dark"), action="append")
    parser.add_argument("--width", type=int, action="append", help="only sizes of this width")
    options = parser.parse_args()
    sizes = [size for size in SIZES if size[0] in (options.width or (size[0],))]
    count = 0
    with sync_playwright() as playwright:
        browser = launch(playwright)
        for name in options.names or bundled_files():
            with address(name, options.exported) as url:
                for theme in options.theme or ("light", "dark"):
                    page = browser.new_page(
                        viewport={"width": 1280, "height": 720},
                        color_scheme=theme,
                        reduced_motion="reduce",
                    )
                    page.set_default_timeout(60_000)
                    page.goto(
                        url + ("#load=0,0,0,0,0,-100&load_axes=world" if options.load else "")
                    )
                    ready(page)
                    for size in sizes:
                        for fault in looked_at(page, size, options.output, f"{name}-{theme}"):
                            count += 1
                            print(f"{name} {theme} {size[0]}x{size[1]}: {fault}", flush=True)
                    page.close()
        browser.close()
    print(f"{count} faults")
    return count > 0


if __name__ == "__main__":
    sys.exit(main())
