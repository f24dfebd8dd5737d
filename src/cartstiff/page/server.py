"""The page's server: one port of this machine, same-origin requests only, bounded in everything.

A request is answered only if its Host header names this machine by address (a name that an attacker
has pointed here is refused), a socket only if the page came from the same origin. Files are a fixed
table; nothing in a request is ever a path. Each tab has its own `Session`.
"""

from __future__ import annotations

import asyncio
import ipaddress
import re
import socket
import time
from collections import deque
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from tornado.httpserver import HTTPServer
from tornado.iostream import StreamClosedError
from tornado.web import Application, HTTPError, RequestHandler
from tornado.websocket import WebSocketClosedError, WebSocketHandler

from cartstiff.errors import CartstiffError, InputError, one_line
from cartstiff.page.answer import Answer
from cartstiff.page.export import export_steps
from cartstiff.page.files import page_files
from cartstiff.page.session import Session, refusal
from cartstiff.page.source import Source
from cartstiff.page.state import Draw, Export, Message, Series, Sweep, read_message

__all__ = ["PageServer"]

#: Sockets that may be open at once; further tabs are told so.
MOST_TABS = 24
#: Connections of any kind.
MOST_CONNECTIONS = 200
#: Messages per second and tab; what exceeds it is dropped.
MOST_MESSAGES = 2000
# Beyond this a socket is closed; between `LARGEST_MESSAGE` and this the message is refused.
_LARGEST_FRAME = 1024 * 1024
# Quick questions of a tab that may wait for their turn.
_MOST_WAITING = 16
# Longest time (s) without a look at other tabs while a long question is answered.
_SLICE = 0.004

_ID = re.compile(r'"id": ?(\d{1,15})\b')
_HEADERS = {
    "Cache-Control": "no-store",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
}
# A notebook shows the page in a frame; nothing on it can do harm by a click.
_FRAMES = "'self' http://localhost:* http://127.0.0.1:* vscode-webview:"


def is_local_name(host_header: str, names: tuple[str, ...] = ()) -> bool:
    """Whether a Host header is an address, "localhost", or one of `names`.

    A web page elsewhere can make a browser call this server under a name of its own; it cannot do
    so under an address.
    """
    host = host_header.rsplit(":", 1)[0] if not host_header.endswith("]") else host_header
    if host in ("localhost", *names):
        return True
    try:
        ipaddress.ip_address(host.removeprefix("[").removesuffix("]"))
    except ValueError:
        return False
    return True


class _Guarded(RequestHandler):
    """Checks that every request passes, and headers that every answer has."""

    def set_default_headers(self) -> None:
        self.clear_header("Server")
        for name, value in _HEADERS.items():
            self.set_header(name, value)

    def prepare(self) -> None:
        page: PageServer = self.application.settings["page"]
        if not is_local_name(self.request.headers.get("Host", ""), page.names):
            raise HTTPError(403, reason="this server has no such name")

    def write_error(self, status_code: int, **_: Any) -> None:
        self.set_header("Content-Type", "text/plain; charset=utf-8")
        self.finish(f"{status_code} {self._reason}\n")

    def log_exception(self, *_: Any) -> None:
        """Refusals are the visitor's business."""


class _File(_Guarded):
    """A file of the fixed table."""

    def get(self) -> None:
        files: dict[str, tuple[str, bytes]] = self.application.settings["files"]
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
        self.finish(content)

    head = get


class _Socket(_Guarded, WebSocketHandler):
    """One tab."""

    def check_origin(self, origin: str) -> bool:
        """Only a page of this very server."""
        return origin == f"http://{self.request.headers.get('Host', '')}"

    def prepare(self) -> None:
        super().prepare()
        self._page: PageServer = self.application.settings["page"]
        if len(self._page.tabs) >= MOST_TABS:
            raise HTTPError(503, reason="too many tabs")

    def open(self, *_: str) -> None:
        self.set_nodelay(True)
        self._page.tabs.add(self)
        self._session: Session | None = None
        self._drawing: Draw | None = None
        self._quick: deque[Message] = deque()
        # Long questions by kind: an export goes on while curves are asked for anew.
        self._long: dict[str, tuple[Sweep | Series | Export, Any]] = {}
        self._tokens, self._filled = float(MOST_MESSAGES), time.monotonic()
        self._warned = 0.0
        self._pushed: deque[Answer] = deque(maxlen=4 * _MOST_WAITING)
        self._task = asyncio.ensure_future(self._serve())
        self._awake = asyncio.Event()
        self._awake.set()

    def on_close(self) -> None:
        self._page.tabs.discard(self)
        if hasattr(self, "_task"):
            self._task.cancel()

    async def ended(self) -> None:
        """Wait until nothing is answered any more."""
        self._task.cancel()
        await asyncio.wait([self._task])

    def push(self, answer: Answer) -> None:
        """Tell the tab something that it did not ask."""
        self._pushed.append(answer)
        self._awake.set()

    def on_message(self, text: str | bytes) -> None:
        """Keep what the tab asks; of questions of a kind the newest wins."""
        now = time.monotonic()
        self._tokens = min(MOST_MESSAGES, self._tokens + (now - self._filled) * MOST_MESSAGES) - 1
        self._filled = now
        if self._tokens < 0:
            self._tokens = 0.0
            if now - self._warned > 1.0:
                self._warned = now
                slower = InputError("too many messages", expected="a slower pace")
                self.push(refusal(slower, _number(text)))
            return
        try:
            message = read_message(text)
        except InputError as error:
            self.push(refusal(error, _number(text)))
            return
        if isinstance(message, Draw):
            self._drawing = message
        elif isinstance(message, (Sweep, Series, Export)):
            kind = "export" if isinstance(message, Export) else "curves"
            if kind in self._long:
                older = self._long[kind][0]
                newer = InputError("a newer question took the place of this one")
                self.push(refusal(newer, older.id, older.do))
            self._long[kind] = message, None
        elif len(self._quick) < _MOST_WAITING:
            self._quick.append(message)
        else:
            late = InputError("too many questions wait", expected="a slower pace")
            self.push(refusal(late, message.id, message.do))
        self._awake.set()

    # -- answering --------------------------------------------------------------------------

    async def _serve(self) -> None:
        """Answer until the socket closes: what is quick first, slices of what is long."""
        try:
            await asyncio.sleep(0)
            self._session = Session(self._page.source, self._page.picture)
            await self._send(self._session.hello())
            while True:
                await self._awake.wait()
                answer = self._next(self._session)
                if answer is not None:
                    await self._send(answer)
                else:
                    await asyncio.sleep(0)
        except (StreamClosedError, WebSocketClosedError, asyncio.CancelledError):
            pass
        except CartstiffError as error:  # a mechanism that cannot be drawn at all
            await self._send(refusal(error, 0))

    async def _send(self, answer: Answer) -> None:
        try:
            packed = answer.pack()
        except InputError as error:
            packed = refusal(error, answer.data.get("id", 0), answer.data.get("do")).pack()
        await self.write_message(packed, binary=True)

    def _next(self, session: Session) -> Answer | None:
        """The next answer, or None after a slice of a long one, or if nothing is asked."""
        if self._pushed:
            return self._pushed.popleft()
        message: Message
        if self._drawing is not None:
            message, self._drawing = self._drawing, None
        elif self._quick:
            message = self._quick.popleft()
        elif self._long:
            return self._slice(session)
        else:
            self._awake.clear()
            return None
        return _answered(message, lambda: session.answer(message))

    def _slice(self, session: Session) -> Answer | None:
        """A little of a long question, curves before a file; its answer at the end."""
        kind = "curves" if "curves" in self._long else "export"
        message, steps = self._long[kind]
        end = time.monotonic() + _SLICE

        def proceed() -> Answer | None:
            nonlocal steps
            if steps is None:
                steps = self._begin(session, message)
                self._long[kind] = message, steps
            while time.monotonic() < end:
                try:
                    next(steps)
                except StopIteration as done:
                    answer: Answer = done.value
                    return answer
            return None

        answer = _answered(message, proceed)
        if answer is not None:
            del self._long[kind]
        return answer

    def _begin(self, session: Session, message: Sweep | Series | Export) -> Any:
        if not isinstance(message, Export):
            return session.work(message)
        return export_steps(
            self._page.source, session.elastic, message.state, message.frames,
            picture=self._page.picture, number=message.id,
        )  # fmt: skip


def _number(text: str | bytes) -> int:
    """The number of a message that could not be read, 0 if even that is not to be found."""
    start = text[:200] if isinstance(text, str) else text[:200].decode("latin-1")
    found = _ID.search(start)
    return 0 if found is None else int(found.group(1))


def _answered(message: Message, answer: Callable[[], Answer | None]) -> Answer | None:
    """An answer, or the refusal that explains why there is none; a tab outlives any fault."""
    try:
        return answer()
    except CartstiffError as error:
        return refusal(error, message.id, message.do)
    except Exception as error:
        words = f"internal error: {type(error).__name__}: {one_line(str(error), 200)}"
        return refusal(CartstiffError(words), message.id, message.do)


class _Server(HTTPServer):
    """An HTTP server that does not accept more connections than `MOST_CONNECTIONS`."""

    def initialize(self, *arguments: Any, **options: Any) -> None:
        super().initialize(*arguments, **options)
        self._count = 0

    def handle_stream(self, stream: Any, address: tuple[Any, ...]) -> None:
        if self._count >= MOST_CONNECTIONS:
            stream.close()
            return
        self._count += 1
        super().handle_stream(stream, address)

    def on_close(self, server_conn: object) -> None:
        self._count -= 1
        super().on_close(server_conn)


def _listening(host: str, port: int) -> socket.socket:
    """A socket that listens; InputError if the address cannot be used."""
    try:
        family, *_, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        listening = socket.create_server(address[:2], family=family, backlog=128)
    except (OSError, OverflowError, UnicodeError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise InputError(
            f"cannot serve here: {reason}", where=f"{host}:{port}",
            expected="an address of this machine and a free port (0 finds one)",
        ) from None  # fmt: skip
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
    picture : callable, optional
        Makes the picture of a mechanism; for tests.

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
        picture: Any = None,
    ) -> None:
        from cartstiff.page.picture import Picture

        self.source = source
        self.picture = Picture if picture is None else picture
        self.names = (host,)
        self.tabs: set[_Socket] = set()
        application = Application(
            [(r"/socket", _Socket), (r".*", _File)],
            page=self,
            files=page_files(),
            websocket_max_message_size=_LARGEST_FRAME,
            websocket_ping_interval=20,
            websocket_ping_timeout=20,
            log_function=lambda _: None,
        )
        listening = _listening(host, port)
        self._server = _Server(
            application, idle_connection_timeout=60, body_timeout=10, max_body_size=65536,
            max_header_size=16384,
        )  # fmt: skip
        self._server.add_sockets([listening])
        shown = "127.0.0.1" if host in ("0.0.0.0", "::", "") else host
        shown = f"[{shown}]" if ":" in shown else shown
        self.port: int = listening.getsockname()[1]
        self.url = f"http://{shown}:{self.port}/"

    def go_to(self, q: list[float]) -> None:
        """Take every tab to a posture, those that are opened later too."""
        self.source = replace(self.source, q=np.array(q))
        for tab in list(self.tabs):
            tab.push(Answer({"id": 0, "do": "go-to", "q": q}))

    async def stop(self) -> None:
        """Close every socket and the port."""
        self._server.stop()
        tabs = list(self.tabs)
        for tab in tabs:
            tab.close(1001, "the server ends")
        await asyncio.gather(*(tab.ended() for tab in tabs))
        await self._server.close_all_connections()
