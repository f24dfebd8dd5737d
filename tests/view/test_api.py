"""Pages from Python."""

from __future__ import annotations

import html
import queue
import re
from pathlib import Path
from urllib.parse import urlsplit

import numpy as np
import pytest
from tests.view.conftest import Tab

import cartstiff
from cartstiff import InputError


@pytest.fixture
def shown():
    page = cartstiff.show(cartstiff.load("cubic"), wrench=[0, 0, 0, 0, 0, -9], open_browser=False)
    assert page.url.startswith("http://127.0.0.1:")
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
    assert not hasattr(page, "url")
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


def test_code_follows_a_tab_and_draws_on_it(shown):
    """Sliders, arrows and functions: what one tab does reaches the code and the other tabs."""
    seen: queue.Queue = queue.Queue()
    slider = shown.slider("height", 0, 2, value=1)
    slider.on_change(seen.put)
    shown.on_move(seen.put)
    tab, other = Tab(shown.url), Tab(shown.url)
    assert tab.read()["do"] == "hello"
    assert other.read()["do"] == "hello"
    assert seen.get(timeout=60).q.tolist() == cartstiff.load("cubic").q.tolist()
    expected = [{"name": "height", "lower": 0.0, "upper": 2.0, "value": 1.0}]
    assert tab.read()["sliders"] == other.read()["sliders"] == expected

    tab.ask({"id": 1, "do": "draw", "state": {"q": [0.01, 0, 0, 0, 0, 0]}})
    posture = seen.get(timeout=60)
    there = cartstiff.analyse(cartstiff.load("cubic"), [0.01, 0, 0, 0, 0, 0])
    assert np.array_equal(posture.matrices["B"], there.matrices["B"])
    tab.ask({"id": 2, "do": "draw", "state": {"q": [0.01, 0, 0, 0, 0, 0], "theme": "dark"}})

    tab.ask({"id": 3, "do": "slide", "name": "height", "value": 1.5})
    assert seen.get(timeout=60) == slider.value == 1.5  # nothing had moved before
    assert other.read()["sliders"][0]["value"] == 1.5
    tab.ask({"id": 4, "do": "slide", "name": "height", "value": 7})
    assert seen.get(timeout=60) == slider.value == 2.0
    slider.value = 0.5
    while tab.read()["sliders"][0]["value"] != 0.5:
        pass
    tab.close()
    other.close()


def test_a_function_that_fails_stops_nothing(shown, capfd):
    seen: queue.Queue = queue.Queue()
    slider = shown.slider("force", 0, 1)
    slider.on_change(lambda _: 1 / 0)
    slider.on_change(seen.put)
    slider.value = 1
    assert seen.get(timeout=60) == 1
    assert "ZeroDivisionError" in capfd.readouterr().err


def test_additions_that_do_not_fit_are_refused(shown):
    for call, words in (
        (lambda: shown.slider("x", 1, 1), "ends of a slider do not fit"),
        (lambda: shown.slider("", 0, 1), "a slider needs a name"),
        (lambda: shown.slider("x", 0, float("nan")), "upper"),
        (lambda: shown.arrow("x", [0, 0], [0, 0, 1]), "start"),
        (lambda: shown.arrow("x", [0, 0, 0], [0, 0, 1], colour="red"), "not a colour"),
    ):
        with pytest.raises(InputError, match=words):
            call()
