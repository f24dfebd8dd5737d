"""The page for those who use it by other means, as axe-core judges it.

axe-core comes with what checks the page's scripts (``tools/page``), where npm has installed that.
"""

from __future__ import annotations

from pathlib import Path

import pytest
from tools.screenshot import ready, settled

_AXE = Path(__file__).parents[2] / "tools/page/node_modules/axe-core/axe.min.js"


@pytest.mark.skipif(not _AXE.exists(), reason="npm has not installed axe-core")
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
    page.evaluate(_AXE.read_text(encoding="utf-8"))
    found = page.evaluate("() => axe.run(document, { resultTypes: ['violations'] })")
    context.close()
    assert [
        (fault["id"], [node["html"] for node in fault["nodes"]]) for fault in found["violations"]
    ] == []
