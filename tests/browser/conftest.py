"""A real Chromium, pages served from this process, and a watch over everything they ask for."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any
from urllib.parse import urlsplit

import pytest
from tools.screenshot import launch, ready, settled

import cartstiff
from tests.support.pages import served, short_curves, source_of

#: Of most tests: software draws few pictures a second, and fewer of larger ones.
VIEWPORT = {"width": 1100, "height": 560}
#: Milliseconds: only what never ends takes longer, on the busiest machine too.
_PATIENCE = 120_000
#: Shared pages that stay open.
_OPEN = 6
# Short messages go away; a test that is late still finds what they said.
_HEARD = """
window.heard = [];
new MutationObserver((changes) => changes.forEach(({ addedNodes }) => addedNodes.forEach((node) => {
  if (node.classList?.contains("toast")) window.heard.push(node.textContent);
}))).observe(document, { childList: true, subtree: true });
"""
# A page that waits for its next test asks for no pictures: each would take a twentieth of a core.
_RESTS = """{
const frame = window.requestAnimationFrame.bind(window);
let asked = null;
window.requestAnimationFrame = (draw) => (asked ? asked.push(draw) : frame(draw));
window.rests = (yes) => {
  const waiting = asked ?? [];
  asked = yes ? waiting : null;
  if (!yes) waiting.forEach((draw) => frame(draw));
};
}"""
# Pictures are put together as ever, and no dot of them is computed: that is most of a test's time
# where software renders. What is seen is asked in test_screenshot.py, which draws.
_UNDRAWN = """
for (const { prototype } of [WebGLRenderingContext, WebGL2RenderingContext]) {
  for (const name of ["Elements", "Arrays", "ElementsInstanced", "ArraysInstanced"]) {
    if (`draw${name}` in prototype) prototype[`draw${name}`] = () => {};
  }
}
"""


def setup(page: Any, tab: str) -> None:
    """Show load, drives, springs or point."""
    page.click(f".setup-card > .choice [data-value={tab}]")
    page.evaluate("() => { document.querySelector('.acts').open = true; }")


def unfold(page: Any, part: str = ".matrix-card") -> None:
    """Open a card that is closed at first, and all in it."""
    page.evaluate(
        """(part) => {
            const card = document.querySelector(part);
            for (const one of [card, ...card.querySelectorAll("details")]) one.open = true;
        }""",
        part,
    )


def heard(page: Any, words: str) -> None:
    """Wait until a short message has held these words."""
    page.wait_for_function("(words) => window.heard.some((x) => x.includes(words))", arg=words)


def _missing(reason: str) -> None:
    words = f"no Chromium for the page's tests ({reason}): run tools/provide_browser.sh"
    if os.environ.get("CI") == "true" or os.environ.get("CARTSTIFF_REQUIRE_BROWSER") == "1":
        pytest.fail(words, pytrace=False)
    pytest.skip(words)


@pytest.fixture(scope="package")
def chromium() -> Iterator[Any]:
    """One browser for the tests of this folder.

    While it runs, playwright keeps an event loop running in this thread: it must be gone before
    tests that run one of their own.
    """
    try:
        from playwright.sync_api import Error, sync_playwright
    except ImportError:
        _missing("playwright is not installed")
    with sync_playwright() as playwright:
        try:
            browser = launch(playwright)
        except Error as error:
            _missing(str(error).splitlines()[0])
        yield browser
        browser.close()


@dataclass
class Watch:
    """What a page did besides what it was asked to."""

    console: list[str] = field(default_factory=list)
    requests: list[str] = field(default_factory=list)
    #: Parts of what may stand in the console.
    expected: tuple[str, ...] = ("GPU stall", "GroupMarker")  # software rendering is slow

    def without_server(self) -> None:
        """From now on the server may be gone: the browser reports each attempt to reach it."""
        self.expected += ("WebSocket connection to", "Failed to load resource")

    def faults(self) -> list[str]:
        """What has come into the console since this was last called, and nobody expects."""
        found = [t for t in self.console if not any(part in t for part in self.expected)]
        self.console.clear()
        return found

    def outside(self) -> list[str]:
        """Requests that leave this machine."""
        return [
            url
            for url in self.requests
            if urlsplit(url).scheme not in ("data", "blob", "file", "about")
            and urlsplit(url).hostname != "127.0.0.1"
        ]


class Pages:
    """Opens pages, and knows what each of them did."""

    def __init__(self, browser: Any) -> None:
        self._browser = browser
        self._shared: dict[str, Any] = {}
        #: Those of the test that runs.
        self._own: list[Any] = []

    def open(
        self,
        url: str,
        *,
        theme: str = "light",
        viewport: dict[str, int] = VIEWPORT,
        offline: bool = False,
    ) -> Any:
        """A page in a context of its own, when its first numbers are shown."""
        page = self.blank(theme=theme, viewport=viewport, offline=offline)
        page.goto(url)
        ready(page)
        return page

    def blank(
        self, *, theme: str = "light", viewport: dict[str, int] = VIEWPORT, offline: bool = False
    ) -> Any:
        """An empty page in a context of its own."""
        context = self._browser.new_context(
            viewport=viewport, color_scheme=theme, offline=offline, accept_downloads=True
        )
        watch = Watch()
        page = context.new_page()
        self._own.append(page)
        page.set_default_timeout(_PATIENCE)
        page.add_init_script(_HEARD + _RESTS + "\n" + _UNDRAWN)
        page.on(
            "console",
            lambda m: watch.console.append(m.text) if m.type in ("error", "warning") else None,
        )
        page.on("pageerror", lambda error: watch.console.append(str(error)))
        page.on("request", lambda request: watch.requests.append(request.url))
        page.on("websocket", lambda socket: watch.requests.append(socket.url))
        page.watch = watch
        return page

    def shared(self, url: str) -> Any:
        """The same page for every test that asks for it, as if it had just been opened."""
        page = self._shared.pop(url, None)
        if page is None:
            for oldest in list(self._shared)[: 1 - _OPEN]:
                self._own.append(self._shared.pop(oldest))  # closed and checked after this test
            page = self.open(url)
            self._own.remove(page)
        self._shared[url] = page
        page.evaluate("() => window.rests(false)")
        if page.viewport_size != VIEWPORT:
            page.set_viewport_size(VIEWPORT)
        page.evaluate(RESET)
        settled(page)
        page.evaluate(CURVES_ANEW)
        return page

    def check(self) -> None:
        """No error came into any console since the last check, and nothing left this machine.

        Pages that nobody shares are closed.
        """
        own, self._own = self._own, []
        for page in own:
            page.context.close()
        for page in (*self._shared.values(), *own):
            faults, outside = page.watch.faults(), page.watch.outside()
            page.watch.requests.clear()
            assert outside == []
            assert faults == []
        for page in self._shared.values():
            page.evaluate("() => window.rests(true)")

    def close(self) -> None:
        """Close what is shared."""
        for page in self._shared.values():
            page.context.close()


# Curves that took long on a busy machine are computed when they are asked for.
CURVES_ANEW = """() => {
    const again = document.querySelector('#strip button[title^="The posture or the load"]');
    if (!again.hidden) again.click();
}"""

#: As if the page had just been opened.
RESET = """() => {
    const store = window.cartstiff;
    for (const dialog of document.querySelectorAll("dialog[open]")) dialog.close();
    for (const details of document.querySelectorAll("details[open]")) details.open = false;
    document.querySelector(".acts").open = true; // how a load acts is asked by many
    for (const tab of ["whole", "joints", "load"]) {
        const inside = ":is(.parts, .posture-card .head, .setup-card > .choice)";
        document.querySelector(`${inside} [data-value=${tab}]`).click();
    }
    document.activeElement.blur();
    store.setKept([], false);
    const { source } = store;
    delete source.between;
    if (source.through) source.onanswer = source.through; // answers that a test has held back
    for (const answer of (window.held ?? []).splice(0)) source.onanswer(...answer);
    store.wishedPlot = null;
    store.tell("replot");
    store.change({ ...structuredClone(store.hello.state), theme: store.state.theme, moved: null });
}"""


@pytest.fixture(scope="module")
def _pages(chromium: Any) -> Iterator[Pages]:
    found = Pages(chromium)
    yield found
    found.close()


@pytest.fixture
def pages(_pages: Pages) -> Iterator[Pages]:
    """Pages in the browser; what they did is checked after each test."""
    yield _pages
    _pages.check()


_SHORT: list[Any] = []


def short(source: Any) -> Any:
    """A source whose curves are of a few postures: they are most of a server's time."""
    _SHORT.append(source)
    return source


@pytest.fixture(scope="package", autouse=True)
def _short_curves() -> Iterator[None]:
    """The page's own questions for curves are those for 61 postures."""
    with short_curves(lambda source: any(source is one for one in _SHORT)):
        yield


@pytest.fixture(scope="session")
def serve() -> Iterator[Callable[..., Any]]:
    """Serve a mechanism by name, once for the same arguments; returns the server.

    Its curves are `short`, unless a test looks at them.
    """
    running: dict[str, Any] = {}

    def start(name: str, *, curves: bool = False, **options: Any) -> Any:
        key = f"{name} {curves} {sorted((k, str(v)) for k, v in options.items())}"
        if key not in running:
            elastic = cartstiff.load(name)
            source = source_of(elastic, **options)
            running[key] = served(source if curves else short(source))
        return running[key]

    yield start
    for server in running.values():
        server.close()
