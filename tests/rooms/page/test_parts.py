"""What no message of the page shows: bounds of its server and of files, pictures' inner numbers."""

import re
import signal
import socket
import time
from urllib.parse import urlsplit

import numpy as np
import pytest
from tests.doors import DEAD_AT_ORIGIN
from tests.inner import exaggerated, numbered, source
from tests.inner import server as serving
from tests.support.pages import clouds_in, postures_in, source_of
from tests.support.printed import report_of
from tests.support.read_units import read
from tests.view.conftest import Tab
from tests.view.test_server import get

import cartstiff
from cartstiff import InputError, equilibrium
from cartstiff.maps import Grid, compute_map


def test_programs_are_recorded_while_a_user_looks_on(page, platform, monkeypatch):
    monkeypatch.setattr(serving, "_LOOKED_AT", 0.05)
    tab = Tab(page.url)
    assert tab.read()["do"] == "hello"
    (inside,) = page.server.tabs
    found = [inside._session.postures.posture(platform.q, None, DEAD_AT_ORIGIN, "body")]
    while not found[-1].is_plain:
        time.sleep(0.01)
        found.append(inside._session.postures.posture(platform.q, None, DEAD_AT_ORIGIN, "body"))
    assert abs(found[-1]["K"] - found[0]["K"]).max() < 1e-9 * abs(found[0]["K"]).max()
    tab.close()


def test_a_page_that_is_served_anew_has_the_same_port_if_it_is_free(platform, monkeypatch):
    found = []
    with socket.socket() as free:  # other tests may serve at the usual one at the same time
        free.bind(("127.0.0.1", 0))
        monkeypatch.setattr(serving, "USUAL_PORT", free.getsockname()[1])

    def ask(url):
        found.append(urlsplit(url).port)
        signal.raise_signal(signal.SIGTERM)

    for _ in range(2):
        serving.serve(source_of(platform), ready=ask)
    with socket.socket() as taken:
        taken.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        taken.bind(("127.0.0.1", serving.USUAL_PORT))
        taken.listen()
        serving.serve(source_of(platform), ready=ask)
    assert found[:2] == [serving.USUAL_PORT] * 2
    assert found[2] != serving.USUAL_PORT


def test_long_questions_rest_while_a_hand_moves_something(tab, monkeypatch):
    """However long one posture of theirs takes: no picture waits for it, on no tab of the page."""
    monkeypatch.setattr(serving, "_DRAG_PAUSE", 1e9)
    one, other = tab(), tab()
    other.ask({"id": 1, "do": "draw"})
    one.send({"id": 1, "do": "sweep", "coordinate": 0, "steps": 2})
    for number in range(2, 60):
        assert one.ask({"id": number, "do": "draw"})["id"] == number
    monkeypatch.setattr(serving, "_DRAG_PAUSE", 0.0)
    assert one.read()["id"] == 1


def test_of_long_questions_the_newest_is_answered_and_the_others_are_told(tab, monkeypatch):
    monkeypatch.setattr(serving, "_DRAG_PAUSE", 1e9)
    one = tab()
    one.ask({"id": 0, "do": "draw"})  # a hand that moves something: the questions wait
    for number in (1, 2, 3):
        one.send({"id": number, "do": "sweep", "coordinate": 0, "steps": 41})
    answers = {number: one.read() for number in (1, 2)}
    monkeypatch.setattr(serving, "_DRAG_PAUSE", 0.0)
    while 3 not in answers:
        answer = one.read()
        answers[answer["id"]] = answer
    assert set(answers) == {1, 2, 3}
    for number in (1, 2):
        assert "newer question" in answers[number]["error"]
    assert len(answers[3]["rows"]) == 41


def test_too_many_messages_are_dropped_and_said(tab, monkeypatch):
    monkeypatch.setattr(serving, "MOST_MESSAGES", 20)
    one = tab()
    for number in range(1, 400):
        one.send({"id": number, "do": "bounds"})
    errors, answers = 0, 0
    while not errors:
        answer = one.read()
        errors += "too many messages" in answer.get("error", "")
        answers += 1
    assert answers < 60


def test_tabs_are_counted(page, monkeypatch):
    monkeypatch.setattr(serving, "MOST_TABS", 3)
    tabs = [Tab(page.url) for _ in range(3)]
    late = Tab(page.url)
    assert late.read()["error"] == "too many tabs show this page; expected at most 3"
    assert late.read() is None
    assert late.socket.close_code == 4029  # the page does not try again
    late.close()
    tabs.pop().close()
    for _ in range(50):
        tabs.append(Tab(page.url))
        if tabs[-1].read()["do"] == "hello":
            break
        tabs.pop().close()
    assert len(tabs) == 3
    for one in tabs:
        one.close()


def test_a_crowd_without_a_word_locks_nobody_out(page, monkeypatch):
    """Idle and slow connections give way to new ones, and never to one that has the token."""
    monkeypatch.setattr(serving, "MOST_CONNECTIONS", 20)
    place = urlsplit(page.url)
    one = Tab(page.url)
    assert one.read()["do"] == "hello"
    held = []
    for number in range(200):
        held.append(socket.create_connection((place.hostname, place.port), timeout=120))
        if number % 2:
            held[-1].sendall(f"GET {place.path} HTTP/1.1\r\nHost: 127".encode())
        if number % 20 == 0:
            assert get(page.url)[0] == 200
    later = Tab(page.url)
    assert later.read()["do"] == "hello"
    for number in (1, 2):
        assert later.ask({"id": number, "do": "draw"})["numbers"]
        assert one.ask({"id": number, "do": "draw"})["numbers"]
    held[0].settimeout(120)
    assert held[0].recv(10) == b""  # the oldest has been let go
    for connection in (*held, later, one):
        connection.close()


def test_long_trajectories_and_large_maps_are_bounded(tmp_path, monkeypatch):
    """Too many postures are refused; of too many points of a map every third is shown."""
    path, file = tmp_path / "path.csv", tmp_path / "m.zarr"
    path.write_text("1,2\n" * 3)
    monkeypatch.setattr(source, "_MOST_POSTURES", 2)
    with pytest.raises(InputError, match="too many postures; expected at most 2, got 3"):
        postures_in(path, ("a", "b"))
    arm = cartstiff.load("ur5")
    grid = Grid({"shoulder_pan_joint": (-1, 1, 3), "elbow_joint": (0.5, 1.5, 3)}, arm.names, arm.q)
    compute_map(arm, grid, ["minimum"], file)
    known = clouds_in(file, arm)
    monkeypatch.setattr(source, "_AT_ONCE", 4)  # row by row
    assert np.array_equal(clouds_in(file, arm).q, known.q)
    monkeypatch.setattr(source, "_MOST_COORDINATES", 6 * 4)
    thin = clouds_in(file, arm)
    assert (known.thinned, thin.thinned) == (1, 3)
    for found, whole in (
        (thin.q, known.q),
        (thin.positions, known.positions),
        (thin.values["minimum"], known.values["minimum"]),
    ):
        assert np.array_equal(found, whole[::3])
    monkeypatch.setattr(source, "_MOST_POINTS", 2)
    assert clouds_in(file, arm).thinned == 5


def test_each_command_is_kept_once_in_an_order_that_a_viewer_takes():
    first, second = {("set_property", "/a", "visible"): b"first"}, {("set_object", "/c", ""): b"c"}
    assert numbered(first | second, first) == ([b"c", b"first"], [[0, 1], [1]])


def test_the_deflected_pose_is_drawn_exaggerated_by_the_stated_factor():
    """The green outline's tip is that many times as far from the robot's as the tip moves."""
    arm, W = cartstiff.load("ur5"), [0, 0, 0, 0, 0, -100]
    said = re.search(
        r"drawn ([\d.]+) times as large \(the tip moves (.*?)\)", report_of(arm, wrench=W)
    )
    factor, far = float(said.group(1)), read(said.group(2))
    state = equilibrium(arm, q=arm.q, wrench=W)
    _, there = exaggerated(arm, arm.q, state.posture.q, 1.0)
    assert far == pytest.approx(np.linalg.norm(state.displacement[3:]), rel=0.02)
    drawn = np.linalg.norm((there.pose - arm.mechanism.at(arm.q).pose)[:3, 3])
    other = exaggerated(arm, arm.q, state.posture.q, 1.0)[0]
    assert drawn == pytest.approx(other * far, rel=0.05)
    assert factor in (1, 2, 5, 10, 20, 50, 100, 200, 500)
