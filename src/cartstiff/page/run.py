"""A page served by this process until it is told to end."""

from __future__ import annotations

import asyncio
import signal
import threading
from collections.abc import Callable, Sequence
from typing import Any

from cartstiff.page.server import PageServer
from cartstiff.page.source import Source


def serve(
    source: Source,
    *,
    host: str = "127.0.0.1",
    port: int = 0,
    ready: Callable[[str], object] = print,
    last: bool = False,
    beside: Sequence[Source] = (),
) -> None:
    """Serve until Ctrl-C (or a request to terminate).

    Parameters
    ----------
    source : Source
        What is shown.
    host, port
        Where; see `PageServer`.
    ready : callable
        Told the page's address once it answers.
    last : bool
        Whether the process ends afterwards: an impatient second Ctrl-C then does nothing.
    beside : sequence of Source
        Mechanisms that the page sets beside the first.

    Raises
    ------
    InputError
        If the address cannot be used.
    """
    end = threading.Event()
    wake: list[Callable[[], object]] = []

    def stop(*_: object) -> None:
        end.set()
        for function in wake:
            function()

    async def run() -> None:
        server = PageServer(source, host=host, port=port, beside=beside)
        woken, loop = asyncio.Event(), asyncio.get_running_loop()
        wake.append(lambda: loop.is_closed() or loop.call_soon_threadsafe(woken.set))
        ready(server.url)
        while not end.is_set():
            await woken.wait()
        await server.stop()

    numbers = (signal.SIGINT, signal.SIGTERM)
    before = [signal.signal(number, stop) for number in numbers]
    try:
        asyncio.run(run())
    finally:
        if not last:
            for number, handler in zip(numbers, before, strict=True):
                signal.signal(number, handler)


class Background:
    """A page served by a thread of this process; options and errors are those of `PageServer`."""

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
