"""The exported page: the same numbers, nothing from outside, the same bytes every time."""

from __future__ import annotations

import base64
import gzip
import hashlib
import json
import re
import struct
from typing import Any

import numpy as np
import pytest
import umsgpack
from tests.view.conftest import unpacked

import cartstiff
from cartstiff.errors import InputError
from cartstiff.geometry import se3
from cartstiff.matrix_names import LETTERS
from cartstiff.page.compact import compacted
from cartstiff.page.export import export_page
from cartstiff.page.files import page_script
from cartstiff.page.recording import Pictures, common_part, complete, in_order
from cartstiff.page.session import Session
from cartstiff.page.source import Playback, Source
from cartstiff.page.state import ViewState

#: A picture's numbers keep seventeen bits.
PICTURE = 2e-5


def held(page: str) -> tuple[dict[str, Any], list[bytes]]:
    """The data in a page: its object and the binary parts."""
    (text,) = re.findall(r'<script type="text/plain" id="frames">([^<]*)</script>', page)
    return unpacked(gzip.decompress(base64.b64decode(text)))


@pytest.fixture(scope="module")
def platform_page() -> str:
    return export_page(Source(cartstiff.load("stewart-gough")), frames=3)


def test_every_frame_holds_the_api_s_numbers(platform_page):
    data, _ = held(platform_page)
    elastic = cartstiff.load("stewart-gough")
    assert len(data["frames"]) >= 13
    for frame in data["frames"]:
        q = frame["result"]["q"]
        assert frame["result"] == json.loads(json.dumps(cartstiff.analyse(elastic, q).as_dict()))
    assert data["frames"][0]["result"]["q"] == elastic.q.tolist()


def test_every_connection_of_a_loaded_frame(platform_page):
    """Principal values for each of the ten views of each frame."""
    data, _ = held(platform_page)
    elastic = cartstiff.load("stewart-gough")
    for frame in data["frames"][:4]:
        result = cartstiff.analyse(elastic, frame["result"]["q"])
        for name in LETTERS:
            K = result.tensor(name)
            variant = data["variants"][frame["variants"][f"stiffness/{name}"]]
            values = variant["numbers"]["principal"]["translation"]["values"]
            C = np.asarray(K.compliance())
            softest = np.sort(1 / np.linalg.eigvalsh((0.5 * (C + C.T))[3:, 3:]))
            assert np.allclose(values, softest, rtol=1e-9)
            variant = data["variants"][frame["variants"][f"compliance/{name}"]]
            values = variant["numbers"]["principal"]["rotation"]["values"]
            expected = np.linalg.eigvalsh((0.5 * (C + C.T))[:3, :3])
            assert np.allclose(values, expected, rtol=1e-6)


def test_sweeps_run_through_the_posture(platform_page):
    data, _ = held(platform_page)
    assert sorted(data["sweeps"]) == [str(i) for i in range(6)]
    for i, numbers in data["sweeps"].items():
        values = [data["frames"][n]["result"]["q"][int(i)] for n in numbers]
        assert values == sorted(values)
        assert 0 in numbers
        for n in numbers:
            others = np.delete(data["frames"][n]["result"]["q"], int(i))
            assert np.array_equal(others, np.delete(data["frames"][0]["result"]["q"], int(i)))


def test_nothing_comes_from_outside(platform_page):
    policy = re.search(r'http-equiv="Content-Security-Policy" content="([^"]*)"', platform_page)
    assert policy is not None
    rules = policy.group(1)
    assert rules.startswith("default-src 'none'; script-src 'sha256-")
    assert "unsafe-eval" not in rules
    assert "http" not in rules
    without_data = re.sub(r'<script type="text/plain"[^<]*</script>', "", platform_page)
    addresses = set(
        re.findall(r"(?:https?:)?//[a-z0-9.]+", re.sub(r"(?m)^\s*//.*$", "", without_data))
    )
    assert addresses <= {"http://www.w3.org"}, "the name of SVG is no request"
    assert not re.search(r"<(?:link|img|iframe|script)[^>]+(?:src|href)=\"(?!data:)", without_data)
    # The policy lets in just the two scripts that the page brings along.
    (script,) = re.findall(r'<script type="module">(.*?)</script>', platform_page, re.DOTALL)
    (zipped,) = re.findall(r'id="viewer">([^<]*)<', platform_page)
    for text in (script.encode(), gzip.decompress(base64.b64decode(zipped))):
        digest = base64.b64encode(hashlib.sha256(text).digest()).decode()
        assert f"'sha256-{digest}'" in rules


def test_the_same_page_twice_is_the_same_bytes(platform_page):
    assert export_page(Source(cartstiff.load("stewart-gough")), frames=3) == platform_page


def test_a_trajectory_is_the_frames():
    arm = cartstiff.load("five-bar")
    motor = np.linspace(0.0, 0.2, 4)
    q = np.array([arm.mechanism.assembled(arm.q + np.array([m, 0, 0, 0])) for m in motor])
    source = Source(arm, trajectory=Playback(q, np.array([0.0, 1.0, 2.0, 3.0]), True))
    data, _ = held(export_page(source))
    assert data["path"] == [1, 2, 3, 4]
    assert data["sweeps"] == {}
    assert data["hello"]["only_trajectory"]
    for n, posture in zip(data["path"], q, strict=True):
        assert np.allclose(data["frames"][n]["result"]["q"], posture, atol=1e-12)


def test_the_state_of_a_tab_is_exported():
    arm = cartstiff.load("cubic")
    state = ViewState(
        q=[0.01, 0, 0, 0, 0, 0.1],
        stiffness=[2e6] * 6,
        connection="A",
        theme="dark",
        load=(0, 0, 0, 0, 0, -500),
        point=(0.0, 0.0, 0.1),
    )
    data, _ = held(export_page(Source(arm), frames=2, state=state))
    springs = arm.with_springs(2e6)
    expected = cartstiff.analyse(springs, state.q, wrench=state.load, load_at=state.point).as_dict()
    assert data["frames"][0]["result"] == json.loads(json.dumps(expected))
    assert data["hello"]["state"]["connection"] == "A"
    assert data["hello"]["state"]["point"] == [0.0, 0.0, 0.1]
    at_point = cartstiff.analyse(springs, state.q, wrench=state.load, load_at=state.point)
    T = se3.pose(translation=[0.0, 0.0, 0.1])
    shown = data["frames"][0]["stiffness"]["A"]
    assert np.allclose(shown, at_point.at(T).matrices["A"], rtol=1e-14)
    assert data["made"]["state"]["theme"] == "dark"


def test_too_many_frames_are_refused():
    with pytest.raises(InputError, match="too many frames for one page"):
        export_page(Source(cartstiff.load("cubic")), frames=1000)


def test_the_pictures_are_those_that_are_drawn(platform_page):
    """Each transform of a frame, from its compact form, against a picture drawn afresh."""
    from cartstiff.page.picture import Picture

    data, (planes, *others) = held(platform_page)
    table = data["commands"]
    count = len(table["transforms"])
    single = np.frombuffer(planes, np.uint8).reshape(48, count).T.copy().view("<f4")
    elastic = cartstiff.load("stewart-gough")
    picture = Picture(elastic)
    frame = data["frames"][5]
    state = ViewState(q=frame["result"]["q"], connection="B")
    picture.draw(cartstiff.analyse(elastic, state.q), state)
    drawn = {
        path: packed
        for (kind, path, _), packed in picture.everything_by_path().items()
        if kind == "set_transform"
    }
    compared = 0
    for n in frame["pictures"]["stiffness/B"]:
        if n >= count:
            continue
        path = table["paths"][table["transforms"][n]]
        if "ellipsoid" in path or path not in drawn or "label" in path:
            continue  # their scale follows what was shown before
        full = np.array(struct.unpack(">" + "Bd" * 16, drawn[path][-144:])[1::2]).reshape(4, 4)
        assert np.allclose(single[n].reshape(4, 3), full[:, :3], rtol=PICTURE, atol=1e-6), path
        compared += 1
    assert compared >= 5
    assert all(isinstance(part, bytes) for part in others)


def test_meshes_are_kept_on_a_fine_grid():
    """The arrays of a link, from their steps, against those that a viewer gets."""
    from cartstiff.page.picture import Picture

    picture = Picture(cartstiff.load("ur5"))
    result = cartstiff.analyse(cartstiff.load("ur5"))
    picture.draw(result, ViewState(q=result.q.tolist()))
    key = ("set_object", "/meshcat/cartstiff/mechanism/joint 3/3 forearm_link", "")
    packed = picture.everything_by_path()[key]
    sent = umsgpack.unpackb(packed)["object"]["geometries"][0]["data"]
    table, parts = compacted({0: (key, packed)}, [[0]])
    (facts,), planes = table["meshes"], parts[1]
    points, corners = facts["counts"]
    assert len(planes) < 0.9 * len(packed) + 6 * points + 2 * corners

    def summed(at: int, count: int, width: int) -> np.ndarray:
        bytes_ = np.frombuffer(planes, np.uint8)[at : at + 4 * width * count]
        steps = bytes_.reshape(4 * width, count).T.copy().view("<i4")
        return np.cumsum(steps, axis=0)

    positions = np.frombuffer(sent["attributes"]["position"]["array"].data, "<f4").reshape(-1, 3)
    assert np.abs(summed(0, points, 3) * facts["grid"] - positions).max() <= 0.51 * facts["grid"]
    assert facts["grid"] <= np.ptp(positions, axis=0).max() / 4096
    index = np.frombuffer(sent["index"]["array"].data, "<u2")
    assert np.array_equal(summed(12 * points, corners, 1)[:, 0], index)
    assert facts["object"]["materials"] == umsgpack.unpackb(packed)["object"]["materials"]


def test_the_file_of_an_arm_computes():
    page = export_page(Source(cartstiff.load("ur5")))
    data, _ = held(page)
    assert "frames" not in data
    assert len(page.encode()) < 1.5e6
    rules = re.search(r'Content-Security-Policy" content="([^"]*)"', page)
    assert rules is not None
    assert "unsafe-eval" not in rules.group(1)
    assert page == export_page(Source(cartstiff.load("ur5")))
    again, _ = held(export_page(Source(cartstiff.load("five-bar"))))
    assert again["why"] == "a closed chain is assembled posture by posture"
    assert "frames" in again


def test_states_of_pictures_are_whole():
    """Merged changes: what a viewer holds after each, deletions included."""
    pictures = Pictures()
    pictures.merge({("set_object", "/a", ""): b"object a", ("set_transform", "/a", ""): b"at 1"})
    first = pictures.state()
    pictures.merge({("set_transform", "/a", ""): b"at 2", ("set_object", "/a/b", ""): b"object b"})
    second = pictures.state()
    pictures.merge({("delete", "/a/b", ""): b"no b"})
    third = pictures.state()
    assert ("set_object", "/a/b", "") not in third
    assert ("delete", "/a/b", "") in third
    pictures.merge({("set_object", "/a/b", ""): b"object b"})
    assert pictures.state() == second
    assert common_part([first, second, third]) == {("set_object", "/a", "")}
    names = {n: packed for n, (_, packed) in pictures.commands.items()}
    order = [names[n] for n in in_order(third, set(third))]
    assert order == [b"no b", b"object a", b"at 2"]


def test_states_do_not_depend_on_each_other():
    """What appears later is hidden before; what is hidden or moved later is in its place before."""
    pictures = Pictures()
    states = []
    for changes in (
        {("set_object", "/a", ""): b"object a"},
        {("set_object", "/late", ""): b"object", ("set_property", "/late", "visible"): b"shown"},
        {("set_transform", "/a", ""): b"moved", ("set_property", "/a", "visible"): b"hidden"},
        {("delete", "/late", ""): b"no more"},
    ):
        pictures.merge(changes)
        states.append(pictures.state())
    complete(states, pictures)
    said = [{key: pictures.commands[n][1] for key, n in state.items()} for state in states]
    visible = ("set_property", "/late", "visible")
    assert umsgpack.unpackb(said[0][visible])["value"] is False
    assert said[1][visible] == said[2][visible] == b"shown"
    assert umsgpack.unpackb(said[3][visible])["value"] is False
    assert umsgpack.unpackb(said[0]["set_property", "/a", "visible"])["value"] is True
    place = umsgpack.unpackb(said[0]["set_transform", "/a", ""])["matrix"]
    assert place == np.eye(4).ravel().tolist()
    assert said[2]["set_transform", "/a", ""] == b"moved"


def test_unused_commands_are_left_out_and_lists_renumbered():
    commands = {
        0: (("set_property", "/a", "visible"), b"first"),
        1: (("set_property", "/b", "visible"), b"unused"),
        2: (("set_property", "/c", "visible"), b"third"),
    }
    lists = [[2, 0], [2]]
    table, parts = compacted(commands, lists)
    assert table == {"paths": [], "transforms": [], "labels": [], "meshes": []}
    assert parts == [b"", b"first", b"third"]
    assert lists == [[1, 0], [1]]


def test_the_modules_fit_into_one_script():
    script = page_script()
    assert not re.search(r"^(import|export) ", script, re.MULTILINE)
    names = re.findall(r"^(?:async )?(?:function|const|let|class) (\w+)", script, re.MULTILINE)
    assert len(names) == len(set(names)), sorted({n for n in names if names.count(n) > 1})
    assert script.index("class Store") < script.index("function build(source)")


def test_the_file_of_a_commanded_machine_is_of_its_springs_as_told():
    machine = cartstiff.load("cubic")
    source = Source(machine, command=[1e-4, 0.0, 0.0, -1e-4, 0.0, 0.0])
    assert Session(source).start.q == machine.q.tolist()
    data, _ = held(export_page(source))
    rest = cartstiff.after_command(machine, {"leg1": 1e-4, "leg4": -1e-4})
    shown = data["hello"]["state"]
    assert np.abs(np.array(shown["q"]) - rest.q).max() < 1e-12
    assert shown["command"] is None
