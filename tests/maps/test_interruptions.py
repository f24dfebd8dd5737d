"""A map that is killed or interrupted is valid, and goes on with nothing lost or done twice."""

import json
import signal

import numpy as np
from tests.maps.machines import marks, start_held_map, start_map

from cartstiff.maps import open_map


def test_killed_map_goes_on(tmp_path, whole):
    expected, answer = whole
    total = answer["parts"]["total"]
    file = tmp_path / "m.zarr"
    process = start_held_map(file, 3)
    process.send_signal(signal.SIGKILL)
    process.communicate(timeout=600)
    assert process.returncode == -signal.SIGKILL
    done = marks(file)
    assert len(done) == 2

    partial = open_map(file).load()  # valid as it stands
    computed = partial["state"].values != 255
    assert partial.attrs["chunks_done"] == len(done)
    assert computed.sum() == 4 * len(done)
    name = "compliance_translation_free_max"
    at = np.broadcast_to(computed, partial[name].shape)
    np.testing.assert_array_equal(partial[name].values[at], expected[name].values[at])

    second = start_map(file)
    out, error = second.communicate(timeout=600)
    assert second.returncode == 0, error
    parts = json.loads(out)["parts"]
    assert parts["found"] == len(done)
    assert parts["found"] + parts["computed"] == parts["total"] == total
    assert done.items() <= marks(file).items()  # not written a second time
    resumed = open_map(file).load()
    for variable in expected.data_vars:
        np.testing.assert_array_equal(resumed[variable], expected[variable])
    assert not list(file.rglob("*.partial"))


def test_interrupted_map_is_valid_and_says_how_to_go_on(tmp_path, whole):
    expected, answer = whole
    file = tmp_path / "m.zarr"
    process = start_held_map(file, 3)
    process.send_signal(signal.SIGINT)
    out, error = process.communicate(timeout=600)
    assert process.returncode == 130
    assert out == ""
    assert error.count("\n") == 1
    assert error.startswith("cartstiff: interrupted: ")
    assert "the same command goes on" in error
    done = len(marks(file))
    assert f"{done} of {answer['parts']['total']} parts" in error
    assert open_map(file).load().attrs["chunks_done"] == done
    second = start_map(file, "--progress")
    out, error = second.communicate(timeout=600)
    assert second.returncode == 0
    assert "postures" in error  # the bar, with its rate
    assert "/s" in error
    assert json.loads(out)["parts"]["found"] == done
    resumed = open_map(file).load()
    for variable in expected.data_vars:
        np.testing.assert_array_equal(resumed[variable], expected[variable])
