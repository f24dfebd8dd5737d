"""Pages from Python."""

from __future__ import annotations

import html
import re
from pathlib import Path
from urllib.parse import urlsplit

import numpy as np
import pytest
from tests.inner import Page, StaticPage
from tests.view.conftest import Tab

import cartstiff
from cartstiff import InputError


@pytest.fixture
def shown():
    page = cartstiff.show(cartstiff.load("cubic"), wrench=[0, 0, 0, 0, 0, -9], open_browser=False)
    assert isinstance(page, Page)
    yield page
    page.close()


def test_a_live_page(shown):
    tab = Tab(shown.url)
    assert tab.read()["state"]["load"] == [0, 0, 0, 0, 0, -9]
    numbers = tab.ask({"id": 1, "do": "draw", "state": {"load": [0, 0, 0, 0, 0, -9]}})["numbers"]
    expected = cartstiff.analyse(cartstiff.load("cubic"), wrench=[0, 0, 0, 0, 0, -9])
    assert np.array_equal(numbers["result"]["stiffness"]["A"], expected.matrices["A"])
    shown.move([0.01, 0, 0, 0, 0, 0])
    told = tab.read()
    assert told["do"] == "go-to"
    assert told["q"] == [0.01, 0, 0, 0, 0, 0]
    later = Tab(shown.url)
    assert later.read()["state"]["q"] == [0.01, 0, 0, 0, 0, 0]
    later.close()
    with pytest.raises(InputError, match="wrong count"):
        shown.move([1, 2])
    tab.close()


def test_a_notebook_shows_the_live_page_in_a_frame(shown):
    cell = shown._repr_html_()
    assert f'src="{shown.url}"' in cell
    assert cell.startswith("<iframe ")
    assert shown.url in repr(shown)


def test_closing_twice_is_once(shown):
    shown.close()
    shown.close()


def test_a_page_as_context():
    with cartstiff.show(cartstiff.load("cubic"), open_browser=False) as page:
        assert page.url.startswith("http://127.0.0.1:")


def test_a_static_page_is_kept_in_the_cell():
    page = cartstiff.show(cartstiff.load("cubic"), {"z": 0.01}, static=True)
    assert isinstance(page, StaticPage)
    cell = page._repr_html_()
    (inside,) = re.findall(r'srcdoc="([^"]*)"', cell)
    assert html.unescape(inside) == page.html
    assert page.html.startswith("<!doctype html>")
    assert "MB" in repr(page)


def test_what_does_not_fit_is_refused():
    arm = cartstiff.load("cubic")
    for options, words in (
        ({"q": [1.0]}, "wrong count"),
        ({"q": {"height": 1.0}}, "unknown joint"),
        ({"wrench": [1.0]}, "wrench"),
        ({"trajectory": [1.0, 2.0]}, "trajectory has the wrong shape"),
        ({"trajectory": [[1.0, 2.0]]}, r"expected shape \(m, 6\)"),
    ):
        with pytest.raises(InputError, match=words):
            cartstiff.show(arm, open_browser=False, **options)


def test_a_browser_is_given_the_address_in_a_file_that_nobody_else_can_read(monkeypatch, tmp_path):
    """A command line, where the token would stand, can be read by other users of the machine."""
    opened = []
    monkeypatch.setattr("webbrowser.open", opened.append)
    monkeypatch.setenv("HOME", str(tmp_path))
    (tmp_path / "snap").mkdir()
    with cartstiff.show(cartstiff.load("cubic"), open_browser=True) as page:
        (address,) = opened
        path = Path.from_uri(address) if hasattr(Path, "from_uri") else Path(urlsplit(address).path)
        assert path.parent == tmp_path
        assert path.stat().st_mode & 0o777 == 0o600
        assert f"url={page.url}" in path.read_text()
        path.unlink()
