"""A map that is killed or interrupted is valid, and goes on with nothing lost or done twice."""

from __future__ import annotations

import json
import signal
import time

import numpy as np
from tests.maps.machines import marks, start_map

from cartstiff.maps import open_map


def _wait_for(file, count, process):
    """Until some parts are done; the process must still be at work then."""
    for _ in range(6000):
        if len(marks(file)) >= count:
            break
        assert process.poll() is None, process.communicate()[1]
        time.sleep(0.01)
    assert process.poll() is None
    return marks(file)


def test_killed_map_goes_on(tmp_path, whole):
    expected, answer = whole
    total = answer["parts"]["total"]
    assert total >= 32
    file = tmp_path / "m.zarr"
    process = start_map(file)
    _wait_for(file, 3, process)
    process.send_signal(signal.SIGKILL)
    process.communicate(timeout=60)
    assert process.returncode == -signal.SIGKILL
    done = marks(file)
    assert 3 <= len(done) < total

    partial = open_map(file).load()  # valid as it stands
    computed = partial["state"].values != 255
    assert partial.attrs["chunks_done"] == len(done)
    assert computed.any()
    assert not computed.all()
    name = "compliance_translation_free_max"
    at = np.broadcast_to(computed, partial[name].shape)
    np.testing.assert_array_equal(partial[name].values[at], expected[name].values[at])

    second = start_map(file)
    out, error = second.communicate(timeout=120)
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
    process = start_map(file)
    _wait_for(file, 2, process)
    process.send_signal(signal.SIGINT)
    out, error = process.communicate(timeout=60)
    assert process.returncode == 130
    assert out == ""
    assert error.count("\n") == 1
    assert error.startswith("cartstiff: interrupted: ")
    assert "the same command goes on" in error
    done = len(marks(file))
    assert f"{done} of {answer['parts']['total']} parts" in error
    assert open_map(file).load().attrs["chunks_done"] == done
    second = start_map(file, "--progress")
    out, error = second.communicate(timeout=120)
    assert second.returncode == 0
    assert "postures" in error  # the bar, with its rate
    assert "/s" in error
    assert json.loads(out)["parts"]["found"] == done
    resumed = open_map(file).load()
    for variable in expected.data_vars:
        np.testing.assert_array_equal(resumed[variable], expected[variable])
