"""The page's server: one port of this machine, behind a token, bounded in everything.

Files are a fixed table; nothing in a request is ever a path. A socket is opened only to a
page of the same origin. Each tab has its own `Session`.

Any user of this machine reaches a port on it, and any web page can make a browser call
one. What they do not know is the token in the page's address: without it every request
gets a 403 and nothing else.
"""

from __future__ import annotations

import asyncio
import gzip
import hmac
import ipaddress
import re
import secrets
import signal
import socket
import threading
import time
from collections import Counter, deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import cache, partial
from hashlib import sha256
from math import inf
from typing import Any

import numpy as np
from tornado.httpserver import HTTPServer
from tornado.httputil import HTTPServerRequest
from tornado.iostream import StreamClosedError
from tornado.web import Application, HTTPError, RequestHandler
from tornado.websocket import WebSocketClosedError, WebSocketHandler

from cartstiff.core.errors import CartstiffError, InputError, one_line
from cartstiff.shown.page.additions import Additions
from cartstiff.shown.page.export import client_program, export_page
from cartstiff.shown.page.files import page_files
from cartstiff.shown.page.messages import (
    Answer,
    Draw,
    Export,
    Message,
    Program,
    Series,
    Slide,
    Sweep,
    read_message,
)
from cartstiff.shown.page.session import Session, refusal
from cartstiff.shown.page.source import Source

#: Connections that are open at once; beyond it the one that has been quiet longest goes.
MOST_CONNECTIONS = 256
#: Seconds without a request after which a connection is closed.
LONGEST_SILENCE = 20.0

_HEADERS = {
    "Cache-Control": "no-store",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",  # the address holds the token
    "X-Content-Type-Options": "nosniff",
}

_DOOR_POLICY = (
    "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src "
    "data:; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)


def is_local_name(host_header: str, names: tuple[str, ...]) -> bool:
    """Whether a Host header is an address, "localhost", or one of `names`.

    A web page elsewhere can make a browser call this server under a name of its own; it
    cannot do so under an address.
    """
    host = host_header.rsplit(":", 1)[0] if not host_header.endswith("]") else host_header
    if host in ("localhost", *names):
        return True
    try:
        ipaddress.ip_address(host.removeprefix("[").removesuffix("]"))
    except ValueError:
        return False
    return True


class Guarded(RequestHandler):
    """Headers that every answer has; refusals are one line of text."""

    def set_default_headers(self) -> None:
        """Put them on."""
        self.clear_header("Server")
        for name, value in _HEADERS.items():
            self.set_header(name, value)

    def write_error(self, status_code: int, **_: Any) -> None:
        """Say the status and its reason."""
        self.set_header("Content-Type", "text/plain; charset=utf-8")
        self.finish(f"{status_code} {self._reason}\n")

    def log_exception(self, *_: Any) -> None:
        """Refusals are the visitor's business."""


class _Refused(Guarded):
    """The same 403 for whatever comes without the token, or under a strange name.

    People get it as a page that asks for the address; it keeps the state that a link
    holds.
    """

    def send_error(self, status_code: int = 403, **_: Any) -> None:  # noqa: ARG002
        super().send_error(
            403, reason="open the whole address that cartstiff has printed"
        )

    def write_error(self, status_code: int, **options: Any) -> None:
        """In words, or as a page for a browser that goes here."""
        request = self.request
        if request.method != "GET" or "text/html" not in request.headers.get(
            "Accept", ""
        ):
            super().write_error(status_code, **options)
            return
        kind, page = self.application.settings["files"]["/page/door.html"]
        self.set_header("Content-Type", kind)
        self.set_header("Content-Security-Policy", _DOOR_POLICY)
        self.finish(page)

    def prepare(self) -> None:
        self.send_error()


class Gate(Application):
    """An application behind a token: its handlers see the address without it,
    as `inside`.
    """

    def __init__(
        self, handlers: Any, *, token: str, names: tuple[str, ...], **settings: Any
    ):
        self._token, self._names = token.encode(), names
        super().__init__(handlers, **settings)

    def find_handler(self, request: HTTPServerRequest, **options: Any) -> Any:
        """The handler of a request that may come in, or the refusal."""
        first, _, rest = (request.path or "/")[1:].partition("/")
        known = hmac.compare_digest(first.encode("utf-8", "surrogatepass"), self._token)
        if not (known and is_local_name(request.headers.get("Host", ""), self._names)):
            return self.get_handler_delegate(request, _Refused)
        connection: Any = request
        server = self.settings["server"]()
        server.welcome(connection.server_connection)
        if (request.path or "").count("/") > 1:
            request.path = "/" + rest
        else:  # the page's links start from the folder
            request.path = ""
        return super().find_handler(request, **options)


class GatedServer(HTTPServer):
    """An HTTP server on which no crowd can lock out a visitor with the token.

    Connections stand in the order of their last request with the token, or of their
    beginning. If there are too many, the address with most connections loses its first
    one.
    """

    def initialize(self, *arguments: Any, **options: Any) -> None:
        """As tornado's, with bounds."""
        options["idle_connection_timeout"] = LONGEST_SILENCE
        super().initialize(*arguments, **options)
        self._open: dict[Any, str] = {}

    def handle_stream(self, stream: Any, address: tuple[Any, ...]) -> None:
        """Take a new connection in, and let another go where there are too many."""
        while len(self._open) >= MOST_CONNECTIONS:
            crowd = Counter(self._open.values()).most_common(1)[0][0]
            oldest = next(one for one, origin in self._open.items() if origin == crowd)
            del self._open[oldest]
            oldest.stream.close()
        known = set(self._connections)
        super().handle_stream(stream, address)
        for connection in self._connections - known:
            self._open[connection] = str(address[0])

    def welcome(self, connection: Any) -> None:
        """A request with the token has come over a connection: it goes last now."""
        origin = self._open.pop(connection, None)
        if origin is not None:
            self._open[connection] = origin

    def on_close(self, server_conn: object) -> None:
        """Forget a connection that has ended, or become a tab's socket."""
        self._open.pop(server_conn, None)
        super().on_close(server_conn)


#: Sockets that may be open at once; further tabs are refused with words.
MOST_TABS = 24
#: Messages per second and tab; what exceeds it is dropped.
MOST_MESSAGES = 2000
# Quick questions of a tab that may wait for their turn.
_MOST_WAITING = 16
# Longest time (s) without a look at other tabs while a long question is answered.
_SLICE = 0.004
# Time (s) between two checks whether dragging has ended.
_POLL = 0.05
# Pictures that follow each other faster than this (s) mean that the user is dragging.
# Curves wait meanwhile: one of their postures may take longer than the next picture
# should.
_DRAG_PAUSE = 0.25
# Time (s) without a picture after which programs are recorded of what a tab shows.
_LOOKED_AT = 1.0
# Close code of a socket that is one too many; the page knows it.
_FULL = 4029
# Bytes in a message: an answer that is larger comes in pieces behind its size, and the
# page shows how much of it has come.
_PIECE = 65_536

_ID = re.compile(r'"id": ?(\d{1,15})\b')


class TabSocket(Guarded, WebSocketHandler):
    """One tab."""

    def check_origin(self, origin: str) -> bool:
        """Only a page of this very server, by scheme, name and port."""
        return origin == f"http://{self.request.headers.get('Host', '')}"

    def prepare(self) -> None:
        """Know the page; refuse a request that is not from a page of this server.

        Every browser says where a page comes from. That is checked here, before tornado
        looks at the request in its own way.
        """
        self._page: PageServer = self.application.settings["page"]
        origins = self.request.headers.get_list("Origin")
        if len(origins) != 1 or not self.check_origin(origins[0]):
            raise HTTPError(403)

    def open(self, *_: str) -> None:
        """Begin to answer; a tab too many is refused with words."""
        self.set_nodelay(True)
        asked = self.get_query_argument("mechanism", "0")
        known = [str(k) for k in range(len(self._page.sources))]
        if asked not in known:
            self.close(1008, "no such mechanism")
            return
        self.number = known.index(asked)
        if len(self._page.tabs) >= MOST_TABS:
            full = InputError(
                "too many tabs show this page", expected=f"at most {MOST_TABS}"
            )
            self.write_message(refusal(full, 0).pack(), binary=True)
            self.close(_FULL, "too many tabs")
            return
        self._page.tabs.add(self)
        self._session: Session | None = None
        self._recording: asyncio.TimerHandle | None = None
        self._drawing: Draw | None = None
        self._quick: deque[Message] = deque()
        self._curves: tuple[Sweep | Series, Any] | None = None
        self._tokens, self._filled = float(MOST_MESSAGES), time.monotonic()
        self._warned = 0.0
        self._pushed: deque[Answer] = deque(maxlen=4 * _MOST_WAITING)
        # Whether what the user's code has added waits, and the commands that the tab has.
        self._additions_wait, self._known = False, dict[Any, bytes]()
        self._task = asyncio.ensure_future(self._serve())
        self._awake = asyncio.Event()
        self._awake.set()

    def on_close(self) -> None:
        """End what is being answered."""
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

    def show_additions(self) -> None:
        """Send what the user's code has added or changed."""
        self._additions_wait = True
        self._awake.set()

    def on_message(self, text: str | bytes) -> None:
        """Keep what the tab asks; of questions of a kind the newest wins."""
        if self not in self._page.tabs:
            return
        now = time.monotonic()
        self._tokens = (
            min(MOST_MESSAGES, self._tokens + (now - self._filled) * MOST_MESSAGES) - 1
        )
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
            self._drawing, self._page.drawn = message, now
        elif isinstance(message, (Sweep, Series)):
            if self._curves is not None:
                older = self._curves[0]
                newer = InputError("a newer question took the place of this one")
                self.push(refusal(newer, older.id, older.do))
            self._curves = message, None
        elif len(self._quick) < _MOST_WAITING:
            self._quick.append(message)
        else:
            late = InputError("too many questions wait", expected="a slower pace")
            self.push(refusal(late, message.id, message.do))
        self._awake.set()

    # -- answering
    # --------------------------------------------------------------------------

    async def _serve(self) -> None:
        """Answer until the socket closes: what is quick first, slices of what is long."""
        try:
            await asyncio.shield(self._page.prepared)
            sources = self._page.sources
            names = [one.elastic.name for one in sources]
            facts: dict[str, Any] = {"mechanisms": names, "number": self.number}
            if self._page.guides:
                facts["guides"] = self._page.guides
            self._session = Session(sources[self.number], self._page.picture, facts)
            await self._send(self._session.hello(with_numbers=True))
            self._record_later()
            if self._session.drawn is not None:
                self._page.additions.moved(self._session.drawn)
            while True:
                await self._awake.wait()
                answer = self._next(self._session)
                if answer is not None:
                    await self._send(answer)
                    self._record_later()
                elif self._waits():
                    self._awake.clear()
                    with suppress(TimeoutError):
                        await asyncio.wait_for(self._awake.wait(), _POLL)
                    self._awake.set()
                else:
                    await asyncio.sleep(0)
        except (StreamClosedError, WebSocketClosedError, asyncio.CancelledError):
            pass
        except CartstiffError as error:  # a mechanism that cannot be drawn at all
            await self._send(refusal(error, 0))

    def _record_later(self) -> None:
        """Have programs recorded once the user looks at what is shown."""
        session = self._session
        if self._recording is None and session is not None and session.postures.waiting:
            loop = asyncio.get_running_loop()
            self._recording = loop.call_later(_LOOKED_AT, self._record)

    def _record(self) -> None:
        self._recording = None
        if self._session is None or self not in self._page.tabs:
            return
        if time.monotonic() - self._page.drawn < _LOOKED_AT:
            self._record_later()
        elif self._session.postures.waiting:
            self._session.postures.record()

    async def _send(self, answer: Answer) -> None:
        try:
            packed = answer.pack()
        except InputError as error:
            packed = refusal(
                error, answer.data.get("id", 0), answer.data.get("do")
            ).pack()
        if len(packed) > _PIECE:
            await self.write_message(str(len(packed)))
        for start in range(0, len(packed), _PIECE):
            await self.write_message(packed[start : start + _PIECE], binary=True)
        if answer.data.get("do") == "hello" and not self._page.additions.is_empty:
            self._known = {}  # the picture is a new one
            self.show_additions()

    def _next(self, session: Session) -> Answer | None:
        """The next answer, or None after a slice of a long one,
        or if nothing is asked.
        """
        if self._pushed:
            return self._pushed.popleft()
        if self._additions_wait:
            self._additions_wait = False
            added = self._page.additions
            data = {"id": 0, "do": "additions", **added.to_dict()}
            return Answer(data, added.commands(self._known))
        message: Message
        if self._drawing is not None:
            message, self._drawing = self._drawing, None
        elif self._quick:
            message = self._quick.popleft()
        elif self._curves:
            return None if self._waits() else self._slice(session)
        else:
            self._awake.clear()
            return None
        if isinstance(message, Program):
            return _answered(message, lambda: self._program(session, message))
        if isinstance(message, Export):
            return _answered(message, lambda: self._export(session, message))
        if isinstance(message, Slide):
            return self._slide(message)
        answer = _answered(message, lambda: session.answer(message))
        if session.drawn is not None and isinstance(message, Draw):
            self._page.additions.moved(session.drawn)
        return answer

    def _slide(self, message: Slide) -> Answer:
        """Take a slider of the user's code along, in the other tabs too."""
        slider = self._page.additions.sliders.get(message.name)
        if slider is not None:
            slider.take(message.value)
        for tab in self._page.tabs - {self}:
            tab.show_additions()
        return Answer({"id": message.id, "do": "slide"})

    def _program(self, session: Session, message: Program) -> Answer:
        """The arithmetic; its script is one of the page's files from then on."""
        answer, script = client_program(session, message.id)
        if not script:
            return answer
        name = f"program-{sha256(script.encode()).hexdigest()[:20]}.js"
        self._page.files[f"/{name}"] = ("text/javascript; charset=utf-8", script.encode())
        return replace(answer, data=answer.data | {"script": name})

    def _export(self, session: Session, message: Export) -> Answer:
        """The page as a file."""
        text = export_page(
            session.source,
            elastic=session.elastic,
            state=message.state,
            picture=self._page.picture,
            address=message.address,
        )
        name = f"{session.elastic.name}.html"
        return Answer({"id": message.id, "do": "export", "name": name, "text": text})

    def _waits(self) -> bool:
        """Whether curves have to wait because the user is dragging."""
        if self._pushed or self._additions_wait or self._drawing or self._quick:
            return False
        if not self._curves:
            return False
        return time.monotonic() - self._page.drawn < _DRAG_PAUSE

    def _slice(self, session: Session) -> Answer | None:
        """A little of a question about many postures; its answer at the end."""
        if self._curves is None:
            return None
        message, steps = self._curves
        end = time.monotonic() + _SLICE

        def proceed() -> Answer | None:
            nonlocal steps
            if steps is None:
                steps = session.work(message)
                self._curves = message, steps
            while time.monotonic() < end:
                try:
                    next(steps)
                except StopIteration as done:
                    answer: Answer = done.value
                    return answer
            return None

        answer = _answered(message, proceed)
        if answer is not None:
            self._curves = None
        return answer


def _number(text: str | bytes) -> int:
    """The number of a message that could not be read,
    0 if even that is not to be found.
    """
    start = text[:200] if isinstance(text, str) else text[:200].decode("latin-1")
    match = _ID.search(start)
    if match is None:
        return 0
    return int(match.group(1))


def _answered(message: Message, answer: Callable[[], Answer | None]) -> Answer | None:
    """An answer, or the refusal that explains why there is none.

    A tab outlives any fault.
    """
    try:
        return answer()
    except CartstiffError as error:
        return refusal(error, message.id, message.do)
    except Exception as error:
        words = f"internal error: {type(error).__name__}: {one_line(str(error), 200)}"
        return refusal(CartstiffError(words), message.id, message.do)


# Beyond this a socket is closed; between `LARGEST_MESSAGE` and this the message is
# refused.
_LARGEST_FRAME = 1024 * 1024
# A notebook shows the page in a frame; nothing on it can do harm by a click.
_FRAMES = "'self' http://localhost:* http://127.0.0.1:* vscode-webview:"


class _File(Guarded):
    """A file of the fixed table."""

    def get(self) -> None:
        files: dict[str, tuple[str, bytes]] = self.application.settings["files"]
        if not self.request.path:
            path, mark, query = (self.request.uri or "").partition("?")
            self.redirect(f"{path}/{mark}{query}")
            return
        if self.request.path not in files:
            raise HTTPError(404)
        kind, content = files[self.request.path]
        host = self.request.headers.get("Host", "")
        self.set_header("Content-Type", kind)
        self.set_header(
            "Content-Security-Policy",
            "default-src 'none'; script-src 'self'; style-src 'self' 'unsafe-inline'; "
            f"img-src 'self' data: blob:; connect-src 'self' ws://{host}; base-uri "
            "'none'; "
            f"form-action 'none'; frame-ancestors {_FRAMES}",
        )
        self.set_header("Vary", "Accept-Encoding")
        if self.request.path != "/":
            # The same for everybody: kept by the browser, which asks whether it still
            # holds.
            self.set_header("Cache-Control", "private, no-cache")
        if "gzip" in self.request.headers.get("Accept-Encoding", ""):
            self.set_header("Content-Encoding", "gzip")
            content = _zipped(content)
        self.finish(content)

    head = get


@cache
def _zipped(content: bytes) -> bytes:
    return gzip.compress(content, 6, mtime=0)


#: Port that `serve` takes where it is free: links that hold it outlive a restart.
USUAL_PORT = 7266
#: The largest number of a TCP port.
_LAST_PORT = 65535


def _listening(host: str, port: int) -> socket.socket:
    """A socket that listens; InputError if the address cannot be used."""
    try:
        if (
            not 0 <= port <= _LAST_PORT
        ):  # the resolver would take it modulo the number of ports
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
        The input of the page.
    host : str
        Address to listen on.
    port : int
        0 takes a free one.
    token : str, optional
        First part of the address, without which nothing is answered; a new secret by
        default.
    picture : callable, optional
        Makes the picture of a mechanism; for tests.
    beside : sequence of Source
        Mechanisms that the page sets beside the first.
    guides : sequence of dict
        Guided starts, one at each mechanism, which are then not beside each other; see
        `cartstiff.shown.page.guides`.

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
        guides: Sequence[dict[str, Any]] = (),
    ) -> None:
        from cartstiff.shown.page.picture import PageScene

        self.source, self.beside = source, tuple(beside)
        self.guides = list(guides)
        self.picture = picture or PageScene
        self.tabs: set[TabSocket] = set()
        loop = asyncio.get_running_loop()
        #: What the user's code adds; used from any thread.
        self.additions = Additions(partial(self._soon, loop))
        self.drawn = -inf  # time of the last request for a picture
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
        everywhere = dict.fromkeys(("0.0.0.0", "::", ""), "127.0.0.1")
        shown = everywhere.get(host, host)
        if ":" in shown:
            shown = f"[{shown}]"
        self.port: int = listening.getsockname()[1]
        self.url = f"http://{shown}:{self.port}/{token}/"
        #: Done once the first picture is at hand; a browser starts meanwhile.
        self.prepared = asyncio.ensure_future(asyncio.to_thread(self._prepare))

    def _prepare(self) -> None:
        """Read the meshes of a picture, and import what that takes,
        before anybody asks.
        """
        for source in self.sources:
            with suppress(Exception):  # the tab that asks gets the reason
                Session(source, self.picture).hello()

    @property
    def sources(self) -> tuple[Source, ...]:
        """The mechanisms by their numbers."""
        return self.source, *self.beside

    def go_to(self, q: list[float]) -> None:
        """Take every tab to a posture, those that are opened later too."""
        self.source = replace(self.source, q=np.array(q))
        for tab in [tab for tab in self.tabs if not tab.number]:
            tab.push(Answer({"id": 0, "do": "go-to", "q": q}))

    def _soon(self, loop: asyncio.AbstractEventLoop) -> None:
        with suppress(RuntimeError):  # the page has ended
            loop.call_soon_threadsafe(self._show_additions)

    def _show_additions(self) -> None:
        for tab in self.tabs:
            tab.show_additions()

    async def stop(self) -> None:
        """Close every socket and the port."""
        self.additions.worker.end()
        self._server.stop()
        await self.prepared
        tabs = list(self.tabs)
        for tab in tabs:
            tab.close(1001, "the server ends")
        await asyncio.gather(*(tab.ended() for tab in tabs))
        await self._server.close_all_connections()


def serve(
    source: Source,
    *,
    host: str = "127.0.0.1",
    port: int = 0,
    ready: Callable[[str], object] = print,
    last: bool = False,
    beside: Sequence[Source] = (),
    guides: Sequence[dict[str, Any]] = (),
) -> None:
    """Serve until Ctrl-C (or a request to terminate).

    Parameters
    ----------
    source : Source
        The input of the page.
    host : str
        Address to listen on. Any other than the default lets in other machines that know
        the printed address; what they exchange is not encrypted.
    port : int
        Port of this machine; 0 takes 7266, where links lead, or a free one.
    ready : callable
        Told the page's address once it answers.
    last : bool
        Whether the process ends afterwards: an impatient second Ctrl-C then does nothing.
    beside, guides
        As in `PageServer`.

    Raises
    ------
    InputError
        If the address cannot be used.
    """
    end = threading.Event()
    numbers = (signal.SIGINT, signal.SIGTERM)
    before = [signal.signal(number, lambda *_: end.set()) for number in numbers]
    try:
        if port == 0:
            with suppress(InputError):
                _listening(host, USUAL_PORT).close()
                port = USUAL_PORT
        page = Background(source, host=host, port=port, beside=beside, guides=guides)
        ready(page.url)
        end.wait()
        page.close()
    finally:
        if not last:
            for number, handler in zip(numbers, before, strict=True):
                signal.signal(number, handler)


class Background:
    """A page served by a thread of this process.

    Options and errors are those of `PageServer`.
    """

    def __init__(self, source: Source, **options: Any) -> None:
        self._loop = asyncio.new_event_loop()
        self._end = asyncio.Event()
        self._started = threading.Event()
        self._error: BaseException | None = None
        self._server: PageServer | None = None
        self._thread = threading.Thread(
            target=self._run, args=(source, options), name="cartstiff page", daemon=True
        )
        self._thread.start()
        self._started.wait()
        if self._error is not None:
            raise self._error

    def _run(self, source: Source, options: dict[str, Any]) -> None:
        async def run() -> None:
            try:
                self._server = PageServer(source, **options)
            except BaseException as error:
                self._error = error
                return
            finally:
                self._started.set()
            await self._end.wait()
            await self._server.stop()

        asyncio.set_event_loop(self._loop)
        try:
            self._loop.run_until_complete(run())
        finally:
            self._loop.close()

    @property
    def server(self) -> PageServer:
        """The server; to be used on its own thread, by `call`."""
        if self._server is None:
            raise RuntimeError("the page's thread has not started")
        return self._server

    @property
    def url(self) -> str:
        """Address of the page."""
        return self.server.url

    def call(self, function: Callable[[], object]) -> None:
        """Have the page's thread call a function soon."""
        self._loop.call_soon_threadsafe(function)

    def close(self) -> None:
        """End the page; once is enough."""
        if self._thread.is_alive():
            self._loop.call_soon_threadsafe(self._end.set)
            self._thread.join(timeout=10)
