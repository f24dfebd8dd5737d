"""What `analyse_many` takes, and what it refuses in one line."""

import numpy as np
import pytest

import cartstiff
from cartstiff import InputError, analyse_many
from cartstiff.core.errors import UnknownNameError

with pytest.raises(UnknownNameError) as named:
    analyse_many(cartstiff.load("stewart-gough"), [[0.0] * 6], outputs=("everything",))
#: Everything that may be asked for, as the refusal of another name lists it.
OUTPUTS = named.value.valid
PATHS = ("engine", "portable", "compiled")


@pytest.fixture(scope="module")
def ur5():
    return cartstiff.load("ur5")


def some(count=5):
    return np.random.default_rng(0).uniform(-1, 1, (count, 6))


@pytest.mark.parametrize("path", PATHS)
@pytest.mark.parametrize("count", [0, 1])
def test_none_and_one(ur5, path, count):
    found = analyse_many(ur5, some(count), outputs=OUTPUTS, path=path)
    assert len(found) == count
    assert found["stiffness_B"].shape == (count, 6, 6)
    assert found["energy"].shape == (count,)
    assert found.counts() == ({"regular": 1} if count else {})


def test_the_name_at_the_door(ur5):
    found = cartstiff.analyse_many(ur5, some())
    assert isinstance(found, cartstiff.Postures)
    assert list(found.arrays) == ["stiffness_B"]
    assert found.codes[0] == "regular"
    assert found.is_regular.all()


@pytest.mark.parametrize("path", PATHS)
def test_arrays_of_any_layout(ur5, path):
    """Coordinates with gaps, in single precision, as lists; outputs with gaps."""
    wide = np.zeros((10, 12))
    wide[::2, ::2] = some().astype(np.float32)
    q = wide[::2, ::2]
    expected = analyse_many(ur5, np.ascontiguousarray(q), outputs=("pose", "energy"), path=path)
    for given in (q, q.astype(np.float32), q.tolist(), np.asfortranarray(q)):
        found = analyse_many(ur5, given, outputs=("pose", "energy"), path=path)
        np.testing.assert_array_equal(found["pose"], expected["pose"])
    out = {"pose": np.empty((5, 4, 8))[:, :, ::2], "energy": np.empty(10)[1::2]}
    found = analyse_many(ur5, q, outputs=("energy", "pose"), out=out, path=path)
    assert found["pose"] is out["pose"]
    np.testing.assert_array_equal(out["pose"], expected["pose"])
    np.testing.assert_array_equal(out["energy"], expected["energy"])


@pytest.mark.parametrize("path", PATHS)
def test_buffers_are_filled(ur5, path):
    buffer = np.full((5, 6, 6), 7.0)
    found = analyse_many(ur5, some(), out={"stiffness_B": buffer}, path=path)
    assert found["stiffness_B"] is buffer
    np.testing.assert_allclose(
        buffer, analyse_many(ur5, some())["stiffness_B"], rtol=1e-9, atol=1e-6
    )


Q = some(3)
BAD = [
    ({"q": np.zeros(6)}, "q has the wrong shape"),
    ({"q": np.zeros((3, 5))}, r"expected shape \(N, 6\)"),
    ({"q": [["a"] * 6]}, "q is not numeric"),
    ({"q": [[0.0] * 6, [0.0] * 5]}, "q is not numeric"),
    ({"q": np.where(np.arange(18).reshape(3, 6) == 8, np.nan, 0.0)}, "q must be finite in row 1"),
    ({"q": np.full((2, 6), np.inf)}, "q must be finite in row 0"),
    ({"wrench": np.zeros((2, 6))}, r"expected shape \(6,\) or \(3, 6\)"),
    ({"wrench": [1, 2, 3]}, "wrench has the wrong shape"),
    ({"wrench": [np.nan] * 6}, "wrench must be finite"),
    ({"wrench": "abc"}, "wrench is not numeric"),
    ({"outputs": "pose"}, "outputs is one word"),
    ({"outputs": ["stiffnes_B"]}, "unknown output.*closest: stiffness_B"),
    ({"outputs": ["stiffness_+"]}, "unknown output"),
    ({"path": "fast"}, "unknown path"),
    ({"threads": 0}, "threads cannot be used.*whole number from 1, got 0"),
    ({"threads": -2}, "threads cannot be used"),
    ({"threads": 1.5}, "threads cannot be used"),
    ({"chunk": 0}, "chunk cannot be used"),
    ({"chunk": True}, "chunk cannot be used"),
    ({"out": {"pose": np.empty((3, 4, 4))}}, "out: unknown output"),
    ({"out": {"stiffness_B": np.empty((3, 36))}}, r"out, stiffness_B: .*shape \(3, 6, 6\)"),
    ({"out": {"stiffness_B": np.empty((3, 6, 6), np.float32)}}, "float32"),
    ({"out": {"stiffness_B": np.broadcast_to(0.0, (3, 6, 6))}}, "read-only"),
    ({"out": {"stiffness_B": [[0.0]]}}, "got list"),
]


@pytest.mark.parametrize("path", [None, "engine"])
@pytest.mark.parametrize(("changed", "message"), BAD)
def test_refusals(ur5, changed, message, path):
    options = {"q": Q, **({"path": path} if path else {}), **changed}
    with pytest.raises(InputError, match=message) as caught:
        analyse_many(ur5, **options)
    assert "\n" not in str(caught.value)


def test_nothing_is_written_before_a_refusal(ur5):
    buffer = np.full((3, 6, 6), 7.0)
    with pytest.raises(InputError):
        analyse_many(ur5, Q, out={"stiffness_B": buffer}, threads=0)
    assert (buffer == 7.0).all()


def test_a_path_that_does_not_serve_is_refused():
    elastic = cartstiff.load("hexapod", rest={"leg1": 0.83})
    with pytest.raises(InputError, match="does not serve this mechanism: some rest lengths"):
        analyse_many(elastic, elastic.q[None], path="compiled")


def test_no_wrench_without_springs(ur5):
    from dataclasses import replace

    with pytest.raises(InputError, match="cannot be given"):
        analyse_many(replace(ur5, springs=None), Q, wrench=[0.0] * 6)


def test_loads_that_the_springs_cannot_carry_are_a_state(ur5):
    """Not an error: the other postures may be in order."""
    passive = ur5.with_springs(stiffness={"wrist_1_joint": 0.0})
    found = analyse_many(passive, Q, wrench=[1.0, 2, 3, 4, 5, 6])
    assert found.path == "engine"
    assert found.counts() == {"unbalanced": 3}


def test_unknown_outputs_of_a_result(ur5):
    found = analyse_many(ur5, Q)
    with pytest.raises(UnknownNameError, match="unknown output"):
        found["pose"]


def test_what_the_engine_computed_is_counted():
    arm = cartstiff.load("ur5")
    q = np.vstack([np.zeros(6), np.linspace(0.2, 1.2, 12).reshape(2, 6)])
    found = analyse_many(arm, q, outputs=["K"], path="portable")
    assert found.fallback == 1
    assert "portable, 1 by the engine" in repr(found)
    assert analyse_many(arm, q, path="engine").fallback == len(q)
    assert analyse_many(arm, q[1:], path="portable").fallback == 0
