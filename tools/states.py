"""States of the page as pictures: ``python -m tools.states [NAME ...]``.

Takes what docs/howto/states.md shows, each picture by the command above it; with ``-o FOLDER``
whole, for three sizes of a screen and both themes, with the words on the page. Needs a Chromium
(tools/provide_browser.sh) and playwright.
"""

from __future__ import annotations

import argparse
import io
import re
import shlex
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from tools.look import looked_at
from tools.screenshot import ROOT, launch, ready, settled

PAGE = ROOT / "docs" / "howto" / "states.md"
#: A screen, a tablet, a phone.
SIZES = ((1440, 900), (1024, 768), (390, 844))
#: Width of a picture in the docs (dots), and its quality as WebP, of 100.
WIDTH, QUALITY = 720, 80
_STATE = re.compile(r"^    cartstiff view (.+?)(?:  # then the key (\w))?$")
_PICTURE = re.compile(r"^!\[.*\]\((\.\./images/states/.+)\)$")


def states() -> Iterator[tuple[Path, list[str], str]]:
    """Each picture of the docs: its file, the arguments of the command, a key."""
    command: tuple[list[str], str] = [], ""
    for line in PAGE.read_text(encoding="utf-8").splitlines():
        if found := _STATE.match(line):
            command = shlex.split(found[1]), found[2] or ""
        elif found := _PICTURE.match(line):
            yield (PAGE.parent / found[1]).resolve(), *command


@contextmanager
def served(arguments: list[str]) -> Iterator[str]:
    """The address of a page, as its command prints it."""
    command = [sys.executable, "-m", "cartstiff", "view", *arguments, "--no-open"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        lines = (re.search(r"http://\S+", line) for line in process.stdout)
        yield next(found[0] for found in lines if found)
        process.terminate()


def opened(browser: Any, url: str, theme: str, key: str) -> Any:
    """The page at rest, with its curves."""
    page = browser.new_page(
        viewport={"width": SIZES[0][0], "height": SIZES[0][1]},
        color_scheme=theme,
        reduced_motion="reduce",
    )
    page.set_default_timeout(300_000)
    page.goto(url)
    ready(page)
    if key:
        page.keyboard.press(key)
    page.wait_for_selector("#strip .plot :is(.curve-0, .gap)", state="attached")
    settled(page)
    return page


def small(png: bytes) -> bytes:
    """A picture for the docs."""
    from PIL import Image

    image = Image.open(io.BytesIO(png)).convert("RGB")
    height = round(image.height * WIDTH / image.width)
    image = image.resize((WIDTH, height), Image.Resampling.LANCZOS)
    file = io.BytesIO()
    image.save(file, "WEBP", quality=QUALITY, method=6)
    return file.getvalue()


def looked_at_everywhere(page: Any, folder: Path, name: str) -> None:
    """Pictures at three sizes, what is wrong with them, and the words on the page."""
    for size in SIZES:
        for fault in looked_at(page, size, folder, name):
            print(f"{name} {size[0]}: {fault}", flush=True)
    (folder / f"{name}.txt").write_text(page.inner_text("body"), encoding="utf-8")


def main() -> None:
    """Take the pictures."""
    from playwright.sync_api import sync_playwright

    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME")
    parser.add_argument("-o", "--output", type=Path, default=None)
    options = parser.parse_args()
    with sync_playwright() as playwright:
        browser = launch(playwright)
        for target, arguments, key in states():
            name = target.stem.removesuffix("-dark")
            if options.names and name not in options.names:
                continue
            with served(arguments) as url:
                if options.output is not None:
                    for theme in ("light", "dark"):
                        page = opened(browser, url, theme, key)
                        looked_at_everywhere(page, options.output, f"{name}-{theme}")
                        page.close()
                    continue
                page = opened(browser, url, "light" if name == target.stem else "dark", key)
                target.write_bytes(small(page.screenshot()))
                print(f"Wrote {target} ({target.stat().st_size / 1000:.0f} kB)", flush=True)
                page.close()
        browser.close()


if __name__ == "__main__":
    main()
