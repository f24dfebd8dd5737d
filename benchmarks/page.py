"""How fast the page follows the hand: ``python benchmarks/page.py [--no-browser]``.

Without a browser: messages through a socket, one at a time, each answered with numbers and picture.
With one (headless, software rendering): from the slider's event to the table, and to the picture
handed to the graphics driver, the picture before being finished.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import sys
import time
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import cartstiff
from cartstiff.shown.page.messages import read_message
from cartstiff.shown.page.server import Background
from cartstiff.shown.page.session import Session
from cartstiff.shown.page.source import Source

#: Updates a second that are required, without a browser, where the lean loop takes 30 us.
MECHANISMS = {
    "ur5": 1500.0,
    "panda": None,
    "stewart-gough": 1000.0,
    "6-ups": 500.0,
    "3-rrr": 100.0,
    "five-bar": None,
}
#: Required of a UR5, in ms.
TABLE, RENDER = 15.0, 30.0

_TIMES = """(count) => new Promise((resolve) => {
    const slider = document.querySelector(".posture-card .slider input[type=range]");
    const [low, high] = [Number(slider.min), Number(slider.max)];
    const table = [], rendered = [];
    let start = 0, number = 0;
    document.addEventListener("cartstiff:table", () => table.push(performance.now() - start));
    document.addEventListener("cartstiff:rendered", () => {
        rendered.push(performance.now() - start);
        setTimeout(next, 300);  // software is still drawing the last picture
    });
    const next = () => {
        if (number++ >= count) return resolve([table.slice(5), rendered.slice(5)]);
        slider.value = low + (high - low) * (0.5 + 0.05 * Math.sin(0.1 * number));
        start = performance.now();
        slider.dispatchEvent(new Event("input"));
    };
    next();
})"""


def messages(elastic: Any, count: int) -> list[str]:
    """Postures around home, as a slider sends them: all numbers and labels change each time."""
    found, driven = [], getattr(elastic.mechanism, "actuated", None) or (1,)
    for k in range(count):
        q = elastic.q.copy()
        q[driven[0]] += 0.2 * np.sin(0.1 * k)
        found.append(json.dumps({"id": k + 1, "do": "draw", "state": {"q": q.tolist()}}))
    return found


def in_process(name: str, count: int = 400, rounds: int = 5) -> float:
    """Updates per second of processor time: check, analyse, draw, pack; median of rounds."""
    elastic = cartstiff.load(name)
    session = Session(Source(elastic))
    session.hello()
    texts = messages(elastic, count)
    for text in texts[:250]:
        session.answer(read_message(text)).pack()
    session.postures.record().join()  # as a server does while a user looks at the picture
    rates = []
    for _ in range(rounds):
        start = time.process_time()
        for text in texts:
            session.answer(read_message(text)).pack()
        rates.append(count / (time.process_time() - start))
    return median(rates)


def through_a_socket(name: str, count: int = 400) -> tuple[float, int]:
    """Updates per second through a websocket, and the size of one answer."""
    from tornado.httpclient import HTTPRequest
    from tornado.websocket import websocket_connect

    elastic = cartstiff.load(name)
    server = Background(Source(elastic))
    texts = messages(elastic, count)

    async def run() -> tuple[float, int]:
        address = server.url.replace("http:", "ws:") + "socket"
        request = HTTPRequest(address, headers={"Origin": server.url.rsplit("/", 2)[0]})
        socket = await websocket_connect(request)
        await socket.read_message()
        await asyncio.sleep(5.0)  # a user looks at the picture: its program is recorded
        start, size = time.perf_counter(), 0
        for text in texts:
            await socket.write_message(text)
            size = len(await socket.read_message() or b"")
        took = time.perf_counter() - start
        socket.close()
        return count / took, size

    found = asyncio.run(run())
    server.close()
    return found


def in_a_browser(name: str, browser: Any, count: int = 35) -> tuple[float, float]:
    """Medians in ms: slider to table, slider to picture."""
    from tools.screenshot import ready

    server = Background(Source(cartstiff.load(name)))
    page = browser.new_page(viewport={"width": 1280, "height": 720})
    page.goto(server.url)
    ready(page)
    page.wait_for_selector(".plot .curve-2")
    page.wait_for_timeout(1000)
    table, rendered = page.evaluate(_TIMES, count)
    page.close()
    server.close()
    return median(table), median(rendered)


def verdict(met: bool, required: str) -> str:
    return f"{required}: {'met' if met else 'MISSED'}"


def main(browser: bool = True) -> None:
    """Print the tables of benchmarks/README.md."""
    print("| updates per second, no browser | in process | through a socket | bytes | required |")
    print("|---|---:|---:|---:|---|")
    for name, required in MECHANISMS.items():
        alone = in_process(name)
        rate, size = through_a_socket(name)
        wanted = "" if required is None else verdict(alone >= required, f"> {required:.0f}")
        print(f"| {name} | {alone:.0f} | {rate:.0f} | {size} | {wanted} |")
    if not browser:
        return
    from playwright.sync_api import sync_playwright
    from tools.screenshot import launch

    print("\n| median, ms, headless Chromium | to the table | to the picture | required |")
    print("|---|---:|---:|---|")
    with sync_playwright() as playwright:
        chromium = launch(playwright)
        for name in MECHANISMS:
            table, rendered = in_a_browser(name, chromium)
            met = table < TABLE and rendered < RENDER
            wanted = verdict(met, "< 15, < 30") if name == "ur5" else ""
            print(f"| {name} | {table:.1f} | {rendered:.1f} | {wanted} |")
        chromium.close()


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--no-browser",
        dest="browser",
        action="store_false",
        help="leave the times in a browser out",
    )
    main(browser=parser.parse_args().browser)
