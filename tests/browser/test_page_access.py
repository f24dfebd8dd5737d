"""The page for those who use it by other means, as axe-core judges it.

axe-core is no part of the project: CARTSTIFF_AXE names its ``axe.min.js`` (``npm pack axe-core``).
"""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from tools.screenshot import ready, settled

_AXE = os.environ.get("CARTSTIFF_AXE")


@pytest.mark.skipif(_AXE is None, reason="CARTSTIFF_AXE does not name an axe.min.js")
@pytest.mark.parametrize("theme", ["light", "dark"])
@pytest.mark.parametrize("name", ["ur5", "hexapod", "five-bar"])
def test_axe_finds_nothing(serve, chromium, name, theme):
    context = chromium.new_context(
        viewport={"width": 1280, "height": 900},
        color_scheme=theme,
        bypass_csp=True,
        reduced_motion="reduce",
    )
    page = context.new_page()
    page.goto(serve(name).url + "#load=0,0,0,0,0,-100&load_axes=world")
    ready(page)
    page.evaluate("() => document.querySelectorAll('details').forEach((d) => { d.open = true; })")
    page.keyboard.press("a")
    settled(page)
    page.evaluate(Path(str(_AXE)).read_text(encoding="utf-8"))
    found = page.evaluate("() => axe.run(document, { resultTypes: ['violations'] })")
    context.close()
    assert [
        (fault["id"], [node["html"] for node in fault["nodes"]]) for fault in found["violations"]
    ] == []
