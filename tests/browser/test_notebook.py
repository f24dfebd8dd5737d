"""A cell of a running notebook: a kernel makes the page, a document of another origin shows it."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import pytest

_READY = "() => window.cartstiff?.numbers !== undefined && window.cartstiff.numbers !== null"


@pytest.fixture(scope="module")
def kernel() -> Iterator[Any]:
    """What a cell's HTML output is, for code run in a kernel of its own."""
    manager = pytest.importorskip("jupyter_client.manager")
    pytest.importorskip("ipykernel")
    running, client = manager.start_new_kernel(kernel_name="python3")

    def run(code: str) -> str:
        found: list[str] = []

        def keep(message: dict[str, Any]) -> None:
            content = message["content"]
            if message["msg_type"] == "error":
                found.append("\n".join(content["traceback"]))
            found.append(content.get("data", {}).get("text/html", ""))

        client.execute_interactive(code, output_hook=keep, timeout=300)
        return "".join(found)

    yield run
    client.stop_channels()
    running.shutdown_kernel(now=True)


@pytest.fixture
def notebook(tmp_path: Path, pages: Any) -> Iterator[Any]:
    """Open a document with some cells' outputs, served from another port."""

    class Quiet(SimpleHTTPRequestHandler):
        def log_message(self, *_: Any) -> None:
            pass

    server = ThreadingHTTPServer(("127.0.0.1", 0), partial(Quiet, directory=tmp_path))
    threading.Thread(target=server.serve_forever, daemon=True).start()

    def show(cells: str) -> Any:
        head = "<!doctype html><meta charset=utf-8><link rel=icon href=data:,>"
        (tmp_path / "notebook.html").write_text(head + cells, "utf-8")
        page = pages.blank()
        page.goto(f"http://127.0.0.1:{server.server_port}/notebook.html")
        frame = page.query_selector("iframe").content_frame()
        frame.wait_for_function(_READY)
        return frame

    yield show
    server.shutdown()
    server.server_close()


def test_a_cell_shows_the_page_and_follows_the_code(kernel, notebook):
    cell = kernel(
        "import cartstiff\npage = cartstiff.show(cartstiff.load('cubic'), height=500)\npage"
    )
    kernel("page.move([0.01, 0, 0, 0, 0, 0])")  # before any tab is open
    frame = notebook(cell)
    assert frame.evaluate("() => window.cartstiff.numbers.result.q[0]") == pytest.approx(0.01)
    kernel("page.move([0.02, 0, 0, 0, 0, 0])")
    frame.wait_for_function("() => Math.abs(window.cartstiff.numbers.result.q[0] - 0.02) < 1e-12")
    expected = kernel(
        "from IPython.display import HTML\n"
        "K = cartstiff.analyse(cartstiff.load('cubic'), [0.02, 0, 0, 0, 0, 0]).matrices['A']\n"
        "HTML(repr(float(K[3, 3])))"
    )
    shown = frame.evaluate("() => window.cartstiff.numbers.result.stiffness.A[3][3]")
    assert shown == float(expected)


def test_a_kept_cell_needs_no_server(kernel, notebook):
    cell = kernel("cartstiff.show(cartstiff.load('cubic'), static=True, height=500)")
    frame = notebook(cell)
    assert frame.evaluate("() => window.cartstiff.numbers.result.q.length") == 6
