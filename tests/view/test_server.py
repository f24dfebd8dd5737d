"""The server: who is let in, what is refused, and that it goes on serving."""

from __future__ import annotations

import contextlib
import gzip
import json
import random
import socket
import threading
import time
import urllib.error
import urllib.request
from urllib.parse import urlsplit

import pytest
from tests.support.pages import served, source_of
from tests.view.conftest import NoPicture, Tab
from tornado.httpclient import HTTPClientError
from tornado.websocket import WebSocketClosedError

import cartstiff
from cartstiff import InputError


def get(url: str, path: str = "", **headers: str) -> tuple[int, bytes, dict[str, str]]:
    """Status, body and headers; never through a proxy."""
    opener = urllib.request.build_opener(urllib.request.ProxyHandler({}))
    request = urllib.request.Request(url.rstrip("/") + "/" + path, headers=headers)
    try:
        with opener.open(request, timeout=120) as answer:
            return answer.status, answer.read(), dict(answer.headers)
    except urllib.error.HTTPError as error:
        return error.code, error.read(), dict(error.headers)


def raw(url: str, text: str) -> str:
    """What the server says to bytes as they are."""
    place = urlsplit(url)
    with socket.create_connection((place.hostname, place.port), timeout=120) as connection:
        connection.sendall(text.encode("latin-1"))
        return connection.recv(65536).decode("latin-1")


def test_the_page_and_its_files(page):
    status, body, headers = get(page.url)
    assert status == 200
    assert b"<title>cartstiff</title>" in body
    policy = headers["Content-Security-Policy"]
    assert "default-src 'none'" in policy
    assert "unsafe-eval" not in policy
    assert headers["X-Content-Type-Options"] == "nosniff"
    assert "Server" not in headers
    for path in ("page/main.js", "page/style.css", "viewer.js"):
        assert get(page.url, path)[0] == 200
    # Modules are put together: one by one a browser would ask for them one after another.
    assert get(page.url, "page/store.js")[0] == 404
    assert b"class Store " in get(page.url, "page/main.js")[1]
    assert page.url.startswith("http://127.0.0.1:")


def test_the_first_picture_is_prepared_before_anybody_asks(platform):
    asked = []

    class Kept(NoPicture):
        def __init__(self, elastic):
            asked.append(threading.current_thread())
            super().__init__(elastic)

    server = served(source_of(platform), picture=Kept)
    try:
        while not server.server.prepared.done():
            time.sleep(0.01)
        assert len(asked) == 1
        first = Tab(server.url)
        assert first.read()["do"] == "hello"
        assert len(asked) == 2  # a tab's picture is its own
        assert asked[0] is not asked[1]  # files were served meanwhile
        first.close()
    finally:
        server.close()


def test_a_tab_is_told_why_there_is_no_picture(platform):
    class Broken(NoPicture):
        def draw(self, result, state, moved=None):
            raise InputError("no such mesh")

    server = served(source_of(platform), picture=Broken)
    try:
        tab = Tab(server.url)
        assert "no such mesh" in tab.read()["error"]
        tab.close()
    finally:
        server.close()


def test_files_are_small_on_the_way_and_not_sent_twice(page):
    _, body, headers = get(page.url, "viewer.js")
    assert headers["Cache-Control"] == "private, no-cache"
    packed = get(page.url, "viewer.js", **{"Accept-Encoding": "gzip"})
    assert gzip.decompress(packed[1]) == body
    assert len(packed[1]) < 0.3 * len(body)
    again = {"Accept-Encoding": "gzip", "If-None-Match": packed[2]["Etag"]}
    assert get(page.url, "viewer.js", **again)[:2] == (304, b"")
    # The page itself, whose address is a secret, is not kept.
    assert get(page.url)[2]["Cache-Control"] == "no-store"


@pytest.mark.parametrize(
    "host", ["evil.com", "evil.com:80", "localhost.evil.com", "", "127.0.0.1.x"]
)
def test_other_names_of_this_machine_are_refused(page, host):
    """Against DNS rebinding: a name somewhere that points here."""
    assert get(page.url, Host=host)[0] in (400, 403)
    with pytest.raises(HTTPClientError, match=r"403|400"):
        Tab(page.url, host=host or "x")


@pytest.mark.parametrize("host", ["localhost", "localhost:9999", "127.0.0.1:1", "[::1]:80"])
def test_addresses_are_names_of_this_machine(page, host):
    assert get(page.url, Host=host)[0] == 200


@pytest.mark.parametrize(
    "how", ["same address by https", "another port", "no origin", "two origins"]
)
def test_the_origin_of_a_socket_is_checked_whatever_tornado_does(page, how, monkeypatch):
    """By the answer to the plain request, without a client that adds headers of its own."""
    monkeypatch.setattr("tornado.websocket.WebSocketHandler.get", _welcome)
    place = urlsplit(page.url)
    origins = {
        "same address by https": [f"https://{place.netloc}"],
        "another port": [f"http://{place.hostname}:1"],
        "no origin": [],
        "two origins": [f"http://{place.netloc}", "http://evil.com"],
    }
    assert _upgraded(page.url, origins[how]) == 403
    assert _upgraded(page.url, [f"http://{place.netloc}"]) == 200


async def _welcome(handler, *_, **__):
    """What tornado would do if it looked at nothing."""
    handler.set_status(200)
    handler.finish()


def _upgraded(url, origins):
    """Status of the answer to a request for a socket."""
    place = urlsplit(url)
    with socket.create_connection((place.hostname, place.port), timeout=120) as raw:
        lines = [
            f"GET {place.path}socket HTTP/1.1",
            f"Host: {place.netloc}",
            "Upgrade: websocket",
            "Connection: Upgrade",
            "Sec-WebSocket-Version: 13",
            "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==",
            *(f"Origin: {origin}" for origin in origins),
        ]
        raw.sendall(("\r\n".join(lines) + "\r\n\r\n").encode())
        return int(raw.recv(64).split()[1])


@pytest.mark.parametrize("origin", ["http://evil.com", "null", "https://127.0.0.1:1", "file://"])
def test_sockets_from_other_pages_are_refused(page, origin):
    with pytest.raises(HTTPClientError, match="403"):
        Tab(page.url, origin=origin)


@pytest.mark.parametrize(
    "path",
    [
        "",
        "../../../etc/passwd",
        "page/../server.py",
        "page/%2e%2e/server.py",
        "page/..%2fserver.py",
        "..%5c..%5cwindows",
        "page/",
        "page",
        "%00",
        "page/main.js/x",
        "//etc/passwd",
    ],
)
def test_no_path_is_a_file(page, path):
    token = urlsplit(page.url).path.strip("/")
    for start in (f"/{token}/", "/"):
        line = f"GET {start}{path} HTTP/1.1\r\nHost: 127.0.0.1\r\nConnection: close\r\n\r\n"
        answer = raw(page.url, line)
        if path or start == "/":
            assert answer.split(" ")[1] in (("400", "404") if len(start) > 1 else ("400", "403"))
            assert "root:" not in answer
            assert "import" not in answer


def test_other_methods_are_refused(page):
    for start, status in ((urlsplit(page.url).path, "405"), ("/", "403")):
        for method in ("POST", "PUT", "DELETE", "TRACE"):
            line = f"{method} {start} HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: 0\r\n\r\n"
            assert raw(page.url, line).split(" ")[1] == status


@pytest.mark.parametrize("method", ["GET", "HEAD", "POST", "PUT", "DELETE", "OPTIONS", "TRACE"])
def test_without_the_token_there_is_a_403_and_nothing_else(page, method):
    """On loopback too: other users of this machine reach every port on it."""
    token = urlsplit(page.url).path.strip("/")
    assert len(token) >= 32
    wrong = token[:-1] + ("A" if token[-1] != "A" else "B")
    for path in (
        "/",
        "/socket",
        "/page/main.js",
        "/viewer.js",
        f"/{wrong}/",
        f"/{wrong}/socket",
        f"/?token={token}",
        f"/x/{token}/",
        f"/{token[:-1]}",
        f"//{token}/",
        "/%00/",
        f"/{token.swapcase()}/",
        "/\xff/",
    ):
        answer = raw(page.url, f"{method} {path} HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n")
        assert answer.startswith("HTTP/1.1 403 "), (path, answer)
        head, _, body = answer.partition("\r\n\r\n")
        assert body in ("", "403 open the whole address that cartstiff has printed\n")
        assert token not in answer
        assert "Server:" not in head
        assert "Set-Cookie" not in head


def test_a_browser_without_the_token_is_asked_for_the_address_and_told_nothing(page):
    token = urlsplit(page.url).path.strip("/")
    start = page.url.removesuffix(f"{token}/")
    told = [
        get(f"{start}{path}", Accept="text/html,*/*;q=0.8", Host=host)
        for path in ("", token.swapcase(), "page/main.js", "x/socket")
        for host in ("127.0.0.1", "elsewhere.example")
    ]
    for status, body, headers in told:
        assert status == 403
        assert body == told[0][1]
        assert b"Address that cartstiff has printed" in body
        assert token.encode() not in body
        assert "default-src 'none'" in headers["Content-Security-Policy"]
        assert "Set-Cookie" not in headers


def test_a_socket_needs_the_token(page):
    place = urlsplit(page.url)
    origin = f"http://{place.netloc}"
    for url in (f"{origin}/", f"{origin}/{'x' * 32}/"):
        with pytest.raises(HTTPClientError, match="403"):
            Tab(url, origin=origin)


def test_two_pages_have_two_tokens(page, platform):
    other = served(source_of(platform), picture=NoPicture)
    assert urlsplit(other.url).path != urlsplit(page.url).path
    other.close()


def test_the_address_without_its_last_stroke_leads_to_the_page(page):
    status, body, _ = get(page.url.rstrip("/").rsplit("/", 1)[0], urlsplit(page.url).path[1:-1])
    assert status == 200
    assert b"<title>cartstiff</title>" in body
    path = urlsplit(page.url).path.rstrip("/")
    said = raw(page.url, f"GET {path}?mechanism=1 HTTP/1.1\r\nHost: localhost\r\n\r\n")
    assert f"Location: {path}/?mechanism=1\r\n" in said


def test_the_next_answer_is_of_the_newest_state(tab):
    """Whatever is sent meanwhile, the last wish is answered, and no more often than asked."""
    one = tab()
    for number in range(1, 201):
        one.send({"id": number, "do": "draw", "state": {"q": [0, 0, number / 100, 0, 0, 0]}})
    seen = []
    while not seen or seen[-1] != 200:
        answer = one.read()
        assert "error" not in answer, answer
        seen.append(answer["id"])
        assert answer["numbers"]["result"]["q"][2] == answer["id"] / 100
    assert seen == sorted(seen)


def test_two_tabs_do_not_share_a_posture(tab):
    one, two = tab(), tab()
    first = one.ask({"id": 1, "do": "draw", "state": {"q": [1, 0, 0, 0, 0, 0]}})
    second = two.ask({"id": 1, "do": "draw", "state": {"stiffness": [5] * 6}})
    assert first["numbers"]["result"]["q"][0] == 1
    assert second["numbers"]["result"]["q"][0] == 0
    again = one.ask({"id": 2, "do": "draw", "state": {"q": [1, 0, 0, 0, 0, 0]}})
    assert again["numbers"] == first["numbers"]


def test_long_questions_do_not_hold_up_short_ones(tab):
    one = tab()
    one.send({"id": 1, "do": "sweep", "coordinate": 0, "steps": 61})
    one.send({"id": 2, "do": "draw"})
    order = [one.read()["id"], one.read()["id"]]
    assert order == [2, 1]


def test_too_many_waiting_questions_are_refused(tab):
    one = tab()
    for number in range(1, 61):
        one.send({"id": number, "do": "analysis"})
    answers = [one.read() for _ in range(60)]
    assert {a["id"] for a in answers} == set(range(1, 61))
    assert any("too many questions" in a.get("error", "") for a in answers)
    assert any("text" in a for a in answers)


def test_refused_messages_leave_the_tab_open(tab):
    one = tab()
    for bad in (
        "{",
        "[]",
        "\0",
        b"\xff\x00",
        "x" * 70_000,
        '{"id": 1, "do": "draw", "state": {"q": [NaN]}}',
        json.dumps({"id": 1, "do": "draw", "state": {"frame": "x"}}),
    ):
        answer = one.ask(bad)
        assert "refused" in answer["error"] or "too long" in answer["error"]
    assert one.ask({"id": 5, "do": "draw", "state": {"q": [0]}})["error"]
    assert one.ask({"id": 6, "do": "draw"})["numbers"]


def test_a_fault_inside_is_said_and_survived(platform, monkeypatch):
    class Faulty(NoPicture):
        def draw(self, result, state, moved=None):
            if state.theme == "dark":
                raise ZeroDivisionError("a bug\nin two lines")
            return super().draw(result, state, moved)

    server = served(source_of(platform), picture=Faulty)
    one = Tab(server.url)
    one.read()
    answer = one.ask({"id": 1, "do": "draw", "state": {"theme": "dark"}})
    assert answer["error"] == "internal error: ZeroDivisionError: a bug in two lines"
    assert one.ask({"id": 2, "do": "draw"})["numbers"]
    one.close()
    server.close()


def test_fuzzed_messages_leave_the_server_serving(tab, page):
    """Broken JSON, wrong types, huge and odd numbers: an answer or a refusal, never a loss."""
    random_ = random.Random(7)
    good = {"id": 1, "do": "draw", "state": {"q": [0.0] * 6, "connection": "K", "load": [0] * 6}}
    odd = [None, True, -1, 1e308, 5e-324, 10**30, "x", "\ud800", [], {}, [[]], [1e9] * 6, "K", -0.0]
    one = tab()
    for number in range(150):
        message = json.loads(json.dumps(good))
        for _ in range(random_.randint(1, 3)):
            place = (
                random_.choice([message, message["state"]])
                if isinstance(message.get("state"), dict)
                else message
            )
            place[random_.choice([*place, "extra", "ghost", "point", "stiffness"])] = (
                random_.choice(odd)
            )
        text = json.dumps(message)
        if random_.random() < 0.3:
            at = random_.randrange(len(text))
            text = text[:at] + random_.choice(["", "}", '"', "\\", "9", "\x00"]) + text[at + 1 :]
        one.send(text)
        answer = one.read()
        assert answer is not None, text
        assert "internal error" not in answer.get("error", ""), (text, answer)
        assert number >= 0
    assert one.ask({"id": 9, "do": "draw"})["numbers"]
    assert get(page.url)[0] == 200


def test_a_frame_beyond_all_bounds_closes_that_socket_alone(tab, page):
    one, two = tab(), tab()
    with contextlib.suppress(WebSocketClosedError):
        one.send("x" * (2 * 1024 * 1024))
    assert one.read() is None
    assert two.ask({"id": 1, "do": "draw"})["numbers"]


def test_a_port_in_use_is_one_clear_line(page, platform):
    port = urlsplit(page.url).port
    with pytest.raises(InputError, match=f"127.0.0.1:{port}: cannot serve here: Address already"):
        served(source_of(platform), port=port, picture=NoPicture)


def test_an_export_from_a_tab(tab):
    # The stand-in has no commands by path: the refusal must be an answer too
    answer = tab().ask({"id": 4, "do": "export"})
    assert answer["do"] == "export"
    assert "error" in answer


def test_a_mechanism_without_a_picture_is_said(platform):
    class Broken(NoPicture):
        def __init__(self, elastic):
            raise cartstiff.core.errors.MissingDependencyError("meshcat", "a picture in a page")

    server = served(source_of(platform), picture=Broken)
    one = Tab(server.url)
    assert "meshcat" in one.read()["error"]
    one.close()
    server.close()
