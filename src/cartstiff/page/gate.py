"""Who is let in: a token in the address, a name of this machine, a number of connections.

Any user of this machine reaches a port on it, and any web page can make a browser call one. What
they do not know is the token that stands in the page's address: without it every request gets a
403 and nothing else.
"""

from __future__ import annotations

import hmac
import ipaddress
from collections import Counter
from typing import Any

from tornado.httpserver import HTTPServer
from tornado.httputil import HTTPServerRequest
from tornado.web import Application, RequestHandler

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
    """The same 403 for whatever comes without the token, or under a strange name."""

    def send_error(self, status_code: int = 403, **_: Any) -> None:  # noqa: ARG002
        super().send_error(403, reason="open the whole address that cartstiff has printed")

    def prepare(self) -> None:
        self.send_error()


class Gate(Application):
    """An application behind a token: its handlers see the address without it, as `inside`."""

    def __init__(self, handlers: Any, *, token: str, names: tuple[str, ...], **settings: Any):
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

    Connections stand in the order of their last request with the token, or of their beginning.
    Where there are too many, the first goes of those from the address that has most.
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
