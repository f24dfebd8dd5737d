"""Pages without a browser: a stand-in for the picture, a server in a thread, sockets."""

from __future__ import annotations

import asyncio
import json
import struct
from collections.abc import Callable, Iterator
from typing import Any
from urllib.parse import urlsplit

import pytest
from tests.support.pages import served, source_of

import cartstiff

#: Seconds: only what never comes takes longer, on the busiest machine too.
PATIENCE = 300


class NoPicture:
    """Draws nothing, quickly; remembers what it was asked."""

    def __init__(self, elastic: Any) -> None:
        self.elastic = elastic
        self.drawn: list[Any] = []

    def draw(self, result: Any, state: Any, moved: Any = None) -> dict[str, Any]:
        self.drawn.append((result.q.tolist(), state))
        return {"lines": []}

    def cloud(self, cloud: Any, quantity: str, allowed: Any = None) -> dict[str, Any]:
        return {"label": quantity, "unit": cloud.units[quantity]}

    def keep_in_view(self, positions: Any) -> None:
        pass

    def bounds(self, result: Any) -> list[list[float]]:
        return [[0.0] * 3, [1.0] * 3]

    def changes(self) -> list[bytes]:
        return [b"change"]

    def whole(self) -> list[bytes]:
        return [b"everything"]


def unpacked(message: bytes) -> tuple[dict[str, Any], list[bytes]]:
    """The JSON object and the commands of a message."""
    chunks, at = [], 0
    while at < len(message):
        (size,) = struct.unpack_from(">I", message, at)
        chunks.append(message[at + 4 : at + 4 + size])
        at += 4 + size
    return json.loads(chunks[0]), chunks[1:]


class Tab:
    """A socket to a page, used from a test without a loop of its own."""

    def __init__(self, url: str, origin: str | None = None, host: str | None = None) -> None:
        from tornado.httpclient import HTTPRequest
        from tornado.websocket import websocket_connect

        self.loop = asyncio.new_event_loop()
        place = urlsplit(url)
        headers = {"Origin": origin or f"{place.scheme}://{place.netloc}"}
        if host is not None:
            headers["Host"] = host
        address = url.replace("http:", "ws:") + "socket"

        async def connect() -> Any:
            return await websocket_connect(HTTPRequest(address, headers=headers))

        try:
            self.socket = self.loop.run_until_complete(asyncio.wait_for(connect(), 10))
        except BaseException:
            self._end()
            raise

    def send(self, message: Any) -> None:
        """Send an object as JSON, or text or bytes as they are."""
        raw = isinstance(message, (str, bytes))

        async def write() -> None:
            await self.socket.write_message(
                message if raw else json.dumps(message), binary=isinstance(message, bytes)
            )

        self.loop.run_until_complete(write())

    def read(self) -> dict[str, Any] | None:
        """The next answer's object; None if the socket has been closed."""

        async def next_message() -> Any:
            message = await asyncio.wait_for(self.socket.read_message(), PATIENCE)
            if not isinstance(message, str):
                return message
            pieces = b""  # a large answer comes in pieces, behind its size
            while len(pieces) < int(message):
                pieces += await asyncio.wait_for(self.socket.read_message(), PATIENCE)
            return pieces

        message = self.loop.run_until_complete(next_message())
        return None if message is None else unpacked(message)[0]

    def ask(self, message: Any) -> dict[str, Any]:
        """Send and read until the answer to it."""
        self.send(message)
        while True:
            answer = self.read()
            assert answer is not None, "the server closed the socket"
            if not isinstance(message, dict) or answer["id"] == message["id"]:
                return answer

    def close(self) -> None:
        """Leave."""

        async def leave() -> None:
            self.socket.close()

        self.loop.run_until_complete(leave())
        self._end()

    def _end(self) -> None:
        """Let what is closing close, and the loop with it."""
        self.loop.run_until_complete(asyncio.sleep(0.02))
        self.loop.run_until_complete(self.loop.shutdown_default_executor())
        self.loop.close()


@pytest.fixture
def no_picture() -> type[NoPicture]:
    return NoPicture


@pytest.fixture(scope="module")
def platform() -> Any:
    return cartstiff.load("stewart-gough")


@pytest.fixture
def page(platform: Any) -> Iterator[Any]:
    """A server for the paper's platform that draws nothing."""
    server = served(source_of(platform), picture=NoPicture)
    yield server
    server.close()


@pytest.fixture
def tab(page: Any) -> Iterator[Callable[..., Tab]]:
    """Open tabs of the page; they have read the server's greeting."""
    tabs = []

    def open_tab(**options: Any) -> Tab:
        new = Tab(page.url, **options)
        tabs.append(new)
        greeting = new.read()
        assert greeting is not None
        assert greeting["do"] == "hello"
        return new

    yield open_tab
    for one in tabs:
        one.close()
