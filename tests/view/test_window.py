"""The recording window: meshcat's own bytes, the newest state only, snapshots that are complete."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import umsgpack
from hypothesis import given
from hypothesis import strategies as st
from tests.view.viewer import Viewer, meshcat

from cartstiff import InputError
from cartstiff.scene import RecordingWindow


class Sent:
    """A command as a caller would make it."""

    def __init__(self, **data: Any) -> None:
        self.data = data

    def lower(self) -> dict[str, Any]:
        return self.data


def test_meshcat_itself_draws_into_it():
    window = RecordingWindow()
    vis = meshcat.Visualizer(window=window)
    T = np.random.default_rng(1).normal(size=(4, 4))
    vis["a"]["b"].set_object(
        meshcat.geometry.Box([1.0, 2.0, 3.0]), meshcat.geometry.MeshPhongMaterial(0xFF0000)
    )
    vis["a/b"].set_transform(T)
    vis["a/b"].set_property("visible", False)
    viewer = Viewer(window.take())
    place = viewer.places["/meshcat/a/b"]
    np.testing.assert_array_equal(place.matrix, T)
    assert place.object["geometries"][0]["width"] == 1.0
    assert not viewer.visible("/meshcat/a/b")
    assert window.take() == []


def test_bytes_are_those_of_umsgpack():
    window = RecordingWindow()
    rng = np.random.default_rng(2)
    commands = [
        {"type": "set_transform", "path": f"/p/{i}", "matrix": rng.normal(size=16).tolist()}
        for i in range(5)
    ]
    commands.append({"type": "set_property", "path": "/p", "property": "visible", "value": True})
    for command in commands:
        window.send(Sent(**command))
    assert window.take() == [umsgpack.packb(command) for command in commands]


def test_a_later_transform_replaces_an_earlier_one():
    window = RecordingWindow()
    for k in range(20):
        for path in ("/a", "/b"):
            window.send(Sent(type="set_transform", path=path, matrix=[float(k)] * 16))
    taken = window.take()
    assert len(taken) == 2
    assert all(umsgpack.unpackb(t)["matrix"][0] == 19.0 for t in taken)
    assert len(window.snapshot()) == 2


def test_a_new_object_has_no_properties_of_the_old_one():
    window = RecordingWindow()
    window.send(Sent(type="set_object", path="/a/b", object={"object": 1}))
    window.send(Sent(type="set_property", path="/a/b/<object>", property="renderOrder", value=3))
    window.send(Sent(type="set_property", path="/a/b", property="visible", value=False))
    window.send(Sent(type="set_object", path="/a/b", object={"object": 2}))
    for commands in (window.snapshot(), window.take()):
        place = Viewer(commands).places["/a/b"]
        assert place.object == {"object": 2}
        assert place.own == {}
        assert place.properties == {"visible": False}


def test_what_is_no_part_of_a_picture_is_refused():
    with pytest.raises(InputError, match=r"records a picture.*got capture_image"):
        RecordingWindow().send(Sent(type="capture_image", path=""))


_paths = st.sampled_from(["/a", "/a/b", "/a/b/c", "/ab", "/Grid", "/d/e"])
_commands = st.one_of(
    st.builds(
        lambda p, k: {"type": "set_transform", "path": p, "matrix": [float(k)] * 16},
        _paths,
        st.integers(0, 9),
    ),
    st.builds(
        lambda p, k: {"type": "set_object", "path": p, "object": {"object": k}},
        _paths,
        st.integers(0, 9),
    ),
    st.builds(
        lambda p, n, v: {"type": "set_property", "path": p, "property": n, "value": v},
        st.sampled_from(["/a", "/a/b", "/a/b/<object>", "/Grid"]),
        st.sampled_from(["visible", "color"]),
        st.integers(0, 3),
    ),
    st.builds(lambda p: {"type": "delete", "path": p}, st.sampled_from(["/a", "/a/b", "/d"])),
    st.just(None),
)


@given(st.lists(_commands, max_size=40))
def test_takes_and_snapshot_leave_the_same_picture(commands):
    """Whenever changes are taken (None), a viewer is where one is that got everything at once."""
    window, one_by_one = RecordingWindow(), Viewer()
    often, before = Viewer(), Viewer()
    for command in commands:
        if command is None:
            often.feed(window.take())
            before = Viewer(window.snapshot())
            continue
        window.send(Sent(**command))
        one_by_one.feed([umsgpack.packb(command)])
    often.feed(window.take())
    expected = one_by_one.state()
    assert often.state() == expected
    assert Viewer(window.snapshot()).state() == expected
    # A viewer that holds an older picture, or foreign things below, ends up the same.
    drawn = {p.split("/")[1] for p, s in expected.items() if s[0] is not None}
    before.feed(window.snapshot())
    for path, state in before.state().items():
        if path.split("/")[1] in drawn - {"Grid"}:
            assert expected[path] == state
