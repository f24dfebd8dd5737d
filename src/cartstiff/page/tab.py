"""One tab's socket: what it asks, in which order it is answered, and how much of it at once."""

from __future__ import annotations

import asyncio
import re
import time
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from hashlib import sha256
from typing import TYPE_CHECKING, Any

from tornado.iostream import StreamClosedError
from tornado.web import HTTPError
from tornado.websocket import WebSocketClosedError, WebSocketHandler

from cartstiff.errors import CartstiffError, InputError, one_line
from cartstiff.page.answer import Answer
from cartstiff.page.export import client_program, export_page
from cartstiff.page.gate import Guarded
from cartstiff.page.session import Session, refusal
from cartstiff.page.state import Draw, Export, Message, Program, Series, Sweep, read_message

if TYPE_CHECKING:
    from cartstiff.page.server import PageServer

#: Sockets that may be open at once; further tabs are told so.
MOST_TABS = 24
#: Messages per second and tab; what exceeds it is dropped.
MOST_MESSAGES = 2000
# Quick questions of a tab that may wait for their turn.
_MOST_WAITING = 16
# Longest time (s) without a look at other tabs while a long question is answered.
_SLICE = 0.004
# Between two looks (s) whether a hand rests.
_PATIENCE = 0.05
# Pictures that follow each other faster than this (s) are asked for by a hand. Long questions rest
# meanwhile: one posture of theirs may take longer than the next picture should.
_HAND = 0.25
# Close code of a socket that is one too many; the page knows it.
_FULL = 4029
# Bytes in a message: an answer that is larger comes in pieces behind its size, and the page shows
# how much of it has come.
_PIECE = 65_536

_ID = re.compile(r'"id": ?(\d{1,15})\b')


class TabSocket(Guarded, WebSocketHandler):
    """One tab."""

    def check_origin(self, origin: str) -> bool:
        """Only a page of this very server, by scheme, name and port."""
        return origin == f"http://{self.request.headers.get('Host', '')}"

    def prepare(self) -> None:
        """Know the page; refuse a request that is not from a page of this server.

        Every browser says where a page comes from. That is checked here, before tornado looks at
        the request in its own way.
        """
        self._page: PageServer = self.application.settings["page"]
        origins = self.request.headers.get_list("Origin")
        if len(origins) != 1 or not self.check_origin(origins[0]):
            raise HTTPError(403)

    def open(self, *_: str) -> None:
        """Begin to answer; a tab too many is told so."""
        self.set_nodelay(True)
        asked = self.get_query_argument("mechanism", "0")
        known = [str(k) for k in range(1 + len(self._page.beside))]
        if asked not in known:
            self.close(1008, "no such mechanism")
            return
        self.number = known.index(asked)
        if len(self._page.tabs) >= MOST_TABS:
            full = InputError("too many tabs show this page", expected=f"at most {MOST_TABS}")
            self.write_message(refusal(full, 0).pack(), binary=True)
            self.close(_FULL, "too many tabs")
            return
        self._page.tabs.add(self)
        self._session: Session | None = None
        self._drawing: Draw | None = None
        self._quick: deque[Message] = deque()
        self._curves: tuple[Sweep | Series, Any] | None = None
        self._tokens, self._filled = float(MOST_MESSAGES), time.monotonic()
        self._warned = 0.0
        self._pushed: deque[Answer] = deque(maxlen=4 * _MOST_WAITING)
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

    def on_message(self, text: str | bytes) -> None:
        """Keep what the tab asks; of questions of a kind the newest wins."""
        if self not in self._page.tabs:
            return
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

    # -- answering --------------------------------------------------------------------------

    async def _serve(self) -> None:
        """Answer until the socket closes: what is quick first, slices of what is long."""
        try:
            await asyncio.shield(self._page.prepared)
            source = self._page.source_of(self.number)
            names = [one.elastic.name for one in (self._page.source, *self._page.beside)]
            facts = {"mechanisms": names, "number": self.number}
            self._session = Session(source, self._page.picture, facts)
            await self._send(self._session.hello(with_numbers=True))
            while True:
                await self._awake.wait()
                answer = self._next(self._session)
                if answer is not None:
                    await self._send(answer)
                elif self._waits():
                    self._awake.clear()
                    with suppress(TimeoutError):
                        await asyncio.wait_for(self._awake.wait(), _PATIENCE)
                    self._awake.set()
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
        if len(packed) > _PIECE:
            await self.write_message(str(len(packed)))
        for start in range(0, len(packed), _PIECE):
            await self.write_message(packed[start : start + _PIECE], binary=True)

    def _next(self, session: Session) -> Answer | None:
        """The next answer, or None after a slice of a long one, or if nothing is asked."""
        if self._pushed:
            return self._pushed.popleft()
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
        return _answered(message, lambda: session.answer(message))

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
        """Whether curves are asked for while a hand moves something."""
        if self._pushed or self._drawing or self._quick or not self._curves:
            return False
        return time.monotonic() - self._page.drawn < _HAND

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
    """The number of a message that could not be read, 0 if even that is not to be found."""
    start = text[:200] if isinstance(text, str) else text[:200].decode("latin-1")
    match = _ID.search(start)
    return 0 if match is None else int(match.group(1))


def _answered(message: Message, answer: Callable[[], Answer | None]) -> Answer | None:
    """An answer, or the refusal that explains why there is none; a tab outlives any fault."""
    try:
        return answer()
    except CartstiffError as error:
        return refusal(error, message.id, message.do)
    except Exception as error:
        words = f"internal error: {type(error).__name__}: {one_line(str(error), 200)}"
        return refusal(CartstiffError(words), message.id, message.do)
