"""A page beside a crowd: how soon a new tab has its picture, and what a stranger gets.

    python tools/crowd.py [--clients N] [--tabs N] [MECHANISM]

`cartstiff view` runs as a process of its own. Clients without and with the token hold connections:
half say nothing, half send their request letter by letter. Meanwhile tabs with the token open one
after the other, and every kind of request without it is tried.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import re
import statistics
import subprocess
import sys
import time
from typing import Any
from urllib.parse import urlsplit

from tornado.httpclient import HTTPRequest
from tornado.websocket import websocket_connect

#: Seconds in which a new tab has its picture.
SOON = 3.0


async def _hold(host: str, port: int, request: bytes, slow: bool) -> None:
    """A connection that is held, and taken again where the server lets it go."""
    while True:
        try:
            reader, writer = await asyncio.open_connection(host, port)
            for k in range(len(request) if slow else 0):
                writer.write(request[k : k + 1])
                await writer.drain()
                await asyncio.sleep(0.5)
            await reader.read()
            writer.close()
        except OSError:
            pass
        await asyncio.sleep(0.05)


async def _tab(url: str) -> float:
    """Seconds from nothing to the first picture: page, scripts, socket, answer."""
    place = urlsplit(url)
    begin = time.perf_counter()
    for path in ("", "page/main.js", "viewer.js"):
        status, _ = await _asked(place.hostname or "", place.port or 0, f"{place.path}{path}")
        if status != 200:
            raise SystemExit(f"{path!r} with the token: {status}")
    origin = f"http://{place.netloc}"
    socket: Any = await websocket_connect(
        HTTPRequest(url.replace("http:", "ws:") + "socket", headers={"Origin": origin})
    )
    await _answer(socket)
    await socket.write_message(json.dumps({"id": 1, "do": "draw"}))
    answer = await _answer(socket)
    taken = time.perf_counter() - begin
    if not answer or len(answer) < 1000:
        raise SystemExit(f"no picture: {answer!r}")
    socket.close()
    return taken


async def _answer(socket: Any) -> bytes:
    """The next answer, put together where it comes in pieces behind its size."""
    message = await socket.read_message()
    if not isinstance(message, str):
        return message or b""
    pieces = b""
    while len(pieces) < int(message):
        pieces += await socket.read_message()
    return pieces


async def _asked(host: str, port: int, path: str, method: str = "GET") -> tuple[int, bytes]:
    """Status and what comes after it."""
    reader, writer = await asyncio.open_connection(host, port)
    writer.write(f"{method} {path} HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n".encode())
    data = await reader.read()
    writer.close()
    # Where there are too many, those without the token are let go without a word.
    return int(data.split(b" ", 2)[1]) if data else 403, data


async def crowd(url: str, clients: int, tabs: int) -> tuple[list[float], int]:
    """Times of the tabs, and how many requests without the token got a 403 and nothing else."""
    place = urlsplit(url)
    host, port = place.hostname or "", place.port or 0
    quiet = b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n"
    inside = f"GET {place.path} HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n".encode()
    await _tab(url)  # the first draws for the first time
    held = [
        asyncio.create_task(_hold(host, port, inside if k % 4 < 2 else quiet, k % 2 == 1))
        for k in range(clients)
    ]
    await asyncio.sleep(2.0)
    times, refused = [], 0
    token = place.path.strip("/")
    for _ in range(tabs):
        times.append(await _tab(url))
        for path in ("/", "/socket", "/page/main.js", f"/{token[:-1]}x/", f"/?token={token}"):
            for method in ("GET", "POST", "OPTIONS"):
                status, data = await _asked(host, port, path, method)
                body = data.partition(b"\r\n\r\n")[2]
                if status != 403 or token.encode() in data or len(body) > 80:
                    raise SystemExit(f"{method} {path} without the token: {data[:200]!r}")
                refused += 1
    for task in held:
        task.cancel()
    return times, refused


def main() -> None:
    """Parse, serve, measure, say."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("mechanism", nargs="?", default="ur5")
    parser.add_argument("--clients", type=int, default=200)
    parser.add_argument("--tabs", type=int, default=10)
    options = parser.parse_args()
    command = [sys.executable, "-u", "-m", "cartstiff", "view", options.mechanism, "--no-open"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as server:
        assert server.stdout is not None
        try:
            url = next(
                found[0] for line in server.stdout if (found := re.search(r"http://\S+/", line))
            )
            times, refused = asyncio.run(crowd(url, options.clients, options.tabs))
        finally:
            server.terminate()
    print(
        f"{options.clients} clients: {len(times)} tabs had their picture after "
        f"{statistics.median(times):.2f} s (median), {max(times):.2f} s (longest); "
        f"{refused} requests without the token got a 403 and nothing else"
    )
    sys.exit(0 if max(times) < SOON else 1)


if __name__ == "__main__":
    main()
