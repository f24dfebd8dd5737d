"""The page's server: one port of this machine, behind a token, bounded in everything.

Files are a fixed table; nothing in a request is ever a path. A socket is opened only to a page of
the same origin. Each tab has its own `Session`.
"""

from __future__ import annotations

import asyncio
import gzip
import secrets
import socket
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from functools import cache
from math import inf
from typing import Any

import numpy as np
from tornado.web import HTTPError

from cartstiff.errors import InputError
from cartstiff.page.answer import Answer
from cartstiff.page.files import page_files
from cartstiff.page.gate import Gate, GatedServer, Guarded
from cartstiff.page.session import Session
from cartstiff.page.source import Source
from cartstiff.page.tab import TabSocket

# Beyond this a socket is closed; between `LARGEST_MESSAGE` and this the message is refused.
_LARGEST_FRAME = 1024 * 1024
# A notebook shows the page in a frame; nothing on it can do harm by a click.
_FRAMES = "'self' http://localhost:* http://127.0.0.1:* vscode-webview:"


class _File(Guarded):
    """A file of the fixed table."""

    def get(self) -> None:
        files: dict[str, tuple[str, bytes]] = self.application.settings["files"]
        if not self.request.path:
            self.redirect(self.request.uri.partition("?")[0] + "/" if self.request.uri else "/")
            return
        if self.request.path not in files:
            raise HTTPError(404)
        kind, content = files[self.request.path]
        host = self.request.headers.get("Host", "")
        self.set_header("Content-Type", kind)
        self.set_header(
            "Content-Security-Policy",
            "default-src 'none'; script-src 'self'; style-src 'self' 'unsafe-inline'; "
            f"img-src 'self' data: blob:; connect-src 'self' ws://{host}; base-uri 'none'; "
            f"form-action 'none'; frame-ancestors {_FRAMES}",
        )
        self.set_header("Vary", "Accept-Encoding")
        if self.request.path != "/":
            # The same for everybody: kept by the browser, which asks whether it still holds.
            self.set_header("Cache-Control", "private, no-cache")
        if "gzip" in self.request.headers.get("Accept-Encoding", ""):
            self.set_header("Content-Encoding", "gzip")
            content = _zipped(content)
        self.finish(content)

    head = get


@cache
def _zipped(content: bytes) -> bytes:
    return gzip.compress(content, 6, mtime=0)


#: The largest number of a TCP port.
_LAST_PORT = 65535


def _listening(host: str, port: int) -> socket.socket:
    """A socket that listens; InputError if the address cannot be used."""
    try:
        if not 0 <= port <= _LAST_PORT:  # the resolver would take it modulo the number of ports
            raise OverflowError("there is no such port")
        family, *_, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        listening = socket.create_server(address[:2], family=family, backlog=128)
    except (OSError, OverflowError, UnicodeError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise InputError(
            f"cannot serve here: {reason}",
            where=f"{host}:{port}",
            expected="an address of this machine and a free port (0 finds one)",
        ) from None
    listening.setblocking(False)
    return listening


class PageServer:
    """A page for one source, served until `stop`.

    Must be made and used inside a running asyncio loop.

    Parameters
    ----------
    source : Source
        What is shown.
    host : str
        Address to listen on.
    port : int
        0 takes a free one.
    token : str, optional
        First part of the address, without which nothing is answered; a new secret by default.
    picture : callable, optional
        Makes the picture of a mechanism; for tests.
    beside : sequence of Source
        Mechanisms that the page sets beside the first.

    Raises
    ------
    InputError
        If the address cannot be used.
    """

    def __init__(
        self,
        source: Source,
        *,
        host: str = "127.0.0.1",
        port: int = 0,
        token: str | None = None,
        picture: Any = None,
        beside: Sequence[Source] = (),
    ) -> None:
        from cartstiff.page.picture import Picture

        self.source, self.beside = source, tuple(beside)
        self.picture = Picture if picture is None else picture
        self.tabs: set[TabSocket] = set()
        self.drawn = -inf  # when a picture was asked for last
        self.files = page_files()
        token = secrets.token_urlsafe(24) if token is None else token
        application = Gate(
            [(r"/socket", TabSocket), (r".*", _File)],
            token=token,
            names=(host,),
            page=self,
            server=lambda: self._server,
            files=self.files,
            websocket_max_message_size=_LARGEST_FRAME,
            websocket_ping_interval=20,
            websocket_ping_timeout=20,
            log_function=lambda _: None,
        )
        listening = _listening(host, port)
        self._server: GatedServer = GatedServer(
            application, body_timeout=10, max_body_size=65536, max_header_size=16384
        )
        self._server.add_sockets([listening])
        shown = "127.0.0.1" if host in ("0.0.0.0", "::", "") else host
        shown = f"[{shown}]" if ":" in shown else shown
        self.port: int = listening.getsockname()[1]
        self.url = f"http://{shown}:{self.port}/{token}/"
        #: Done once the first picture is at hand; a browser starts meanwhile.
        self.prepared = asyncio.ensure_future(asyncio.to_thread(self._prepare))

    def _prepare(self) -> None:
        """Read the meshes of a picture, and import what that takes, before anybody asks."""
        for source in (self.source, *self.beside):
            with suppress(Exception):  # the tab that asks is told
                Session(source, self.picture).hello()

    def source_of(self, number: int) -> Source:
        """The mechanism of that number: 0 is the first."""
        return (self.source, *self.beside)[number]

    def go_to(self, q: list[float]) -> None:
        """Take every tab to a posture, those that are opened later too."""
        self.source = replace(self.source, q=np.array(q))
        for tab in [tab for tab in self.tabs if not tab.number]:
            tab.push(Answer({"id": 0, "do": "go-to", "q": q}))

    async def stop(self) -> None:
        """Close every socket and the port."""
        self._server.stop()
        await self.prepared
        tabs = list(self.tabs)
        for tab in tabs:
            tab.close(1001, "the server ends")
        await asyncio.gather(*(tab.ended() for tab in tabs))
        await self._server.close_all_connections()
