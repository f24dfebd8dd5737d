"""What is no real number is refused wherever it is given, by one function."""

from decimal import Decimal
from fractions import Fraction

import numpy as np
import pytest
from mpmath import mpf
from tests.doors import checked_array, checked_pose, checked_unit, move_stiffness, real_array
from tests.support.commands import refuses

import cartstiff
from cartstiff import DeadForce, InputError, analyse_many
from cartstiff.analysis import stiffness_along
from cartstiff.geometry import se3

DATES = np.array(["NaT"] * 6, "datetime64[s]")
NO_NUMBERS = [
    (DATES, "dates"),
    (np.array(["NaT"] * 6, "timedelta64[s]"), "durations"),
    (np.ma.masked_array(np.ones(6), [0, 0, 1, 0, 0, 0]), "masked"),
    (np.ones(6) + 2j, "complex"),
    (np.ones(6) + 0j, "complex"),
    ([1, 2, 3, 4, 5, 6j], "complex"),
    (np.ones(6, bool), "true or false"),
    ([True, 1.0, 2.0, 3.0, 4.0, 5.0], "true or false"),
    ([1.0, 2.0, 3.0, 4.0, 5.0, np.True_], "true or false"),
    (["1", "2", "3", "4", "5", "6"], "text"),
    ([1, 2, 3, 4, 5, "6"], "text"),
    (np.array([b"1"] * 6), "text"),
    (np.array([1, 2, 3, 4, 5, "6"], object), "not numeric"),
    (np.array([1, 2, 3, 4, 5, None], object), "not numeric"),
    (np.array([1, 2, 3, 4, 5, True], object), "not numeric"),
    (np.array([np.timedelta64(1, "s")] * 6, object), "not numeric"),
    ({1, 2, 3, 4, 5, 6}, "not numeric"),
    ((x for x in range(6)), "not numeric"),
    (b"123456", "text"),
]


@pytest.mark.parametrize(("value", "word"), NO_NUMBERS, ids=[str(i) for i in range(19)])
def test_what_is_no_number(value, word):
    with pytest.raises(InputError, match=f"thing.*(is not numeric|holds masked).*{word}|{word}"):
        checked_array(value, (6,), "thing")
    with pytest.raises(InputError):
        real_array(value)


@pytest.mark.parametrize("value", [DATES, np.ones(6) + 0j, np.ones(6, bool), ["0"] * 6])
def test_every_door_refuses_it(value):
    arm = cartstiff.load("ur5")
    refuses("q is not numeric", cartstiff.analyse, arm, value)
    refuses("wrench is not numeric", cartstiff.analyse, arm, wrench=value)
    refuses("q is not numeric", analyse_many, arm, [value])
    refuses("not numeric", se3.exp, value)
    refuses("force is not numeric", DeadForce, value[:3])
    refuses("direction is not numeric", stiffness_along, np.eye(6), value[:3])
    refuses("stiffness is not numeric", arm.with_springs, stiffness=value)


def test_numbers_of_other_kinds_are_numbers():
    for value in (
        (1, 2, 3),
        np.array([1, 2, 3], np.int8),
        np.array([1, 2, 3], np.float32),
        [Fraction(1), Decimal(2), mpf(3)],
        [1, 2.0, np.int64(3)],
        np.ma.array([1.0, 2.0, 3.0]),
        np.array([1, 2, 3], ">f8"),
        np.array([1, 2, 3], np.longdouble),
        [np.array(1.0), np.array(2), 3],
    ):
        found = checked_array(value, (3,), "vector")
        assert found.dtype == np.dtype(float)
        assert type(found) is np.ndarray
        assert found.tolist() == [1.0, 2.0, 3.0]


def test_result_is_the_caller_s_own():
    given = np.arange(6.0)
    assert not np.shares_memory(checked_array(given, (6,), "q"), given)
    assert checked_array(given, (6,), "q", copy=False) is given
    given.flags.writeable = False
    assert checked_array(given, (6,), "q").flags.writeable


@pytest.mark.parametrize(
    ("value", "shape", "message"),
    [
        ([1, 2], (3,), "v has the wrong count; expected 3 numbers, got 2"),
        ([[1, 2]], (3,), r"v has the wrong count; expected 3 numbers, got shape \(1, 2\)"),
        (np.eye(3), (6, 6), r"v has the wrong shape; expected shape \(6, 6\), got shape \(3, 3\)"),
        (np.eye(3), [(6,), ("N", 6)], r"expected shape \(6,\) or \(N, 6\), got shape \(3, 3\)"),
        (np.empty((0, 6)), ("m", 6), r"wrong shape; expected shape \(m, 6\), got shape \(0, 6\)"),
        ([[0, 1], [np.nan, 1]], ("N", 2), r"v must be finite in row 1, got \[nan, 1.0\]"),
        ([1, np.inf], (2,), r"v must be finite, got \[1.0, inf\]"),
        ([10**400, 1], (2,), "v is not numeric; expected 2 numbers"),
        ([[1], [2, 3]], (2,), "v is not numeric"),
        (np.array([1, 1e4000], np.longdouble), (2,), "v must be finite"),
        ([], (), "v has the wrong shape; expected one number"),
    ],
)
def test_messages(value, shape, message):
    with pytest.raises(InputError, match=message):
        checked_array(value, shape, "v")


def test_no_rows_are_rows():
    assert checked_array(np.empty((0, 6)), ("N", 6), "q").shape == (0, 6)


def test_large_arrays_are_tested_to_their_end():
    rows = np.zeros((300_000, 6))
    rows[-1, -1] = np.nan
    with pytest.raises(InputError, match="row 299999"):
        checked_array(rows, ("N", 6), "q")
    with pytest.raises(InputError, match="row 299999"):
        checked_array(rows[:, ::-1], ("N", 6), "q")


def test_directions_of_any_size_are_unit():
    for size in (5e-324, 1e-200, 1.0, 1e200, 1e308):
        np.testing.assert_allclose(checked_unit([0, size, -size]), [0, 0.5**0.5, -(0.5**0.5)])
    with pytest.raises(InputError, match="direction must not be zero"):
        checked_unit([0, 0, 0])


def test_poses():
    good = se3.exp([0.1, 0.2, 0.3, 1, 2, 3])
    np.testing.assert_array_equal(checked_pose(good), good)
    np.testing.assert_array_equal(checked_pose(np.stack([good] * 2)), np.stack([good] * 2))
    mirrored = np.diag([1.0, 1.0, -1.0, 1.0])
    for bad in (2 * good, mirrored, good.T, 1e200 * np.eye(4)):
        with pytest.raises(InputError, match="pose is not a rigid motion"):
            checked_pose(bad)
        with pytest.raises(InputError, match="frame is not a rigid motion"):
            move_stiffness(np.eye(6), bad)


# -- arrays to write into ------------------------------------------------------------------------


def test_output_that_overlaps_what_is_read():
    arm = cartstiff.load("ur5")
    memory = np.zeros(2 * 36 + 100)
    q = memory[:12].reshape(2, 6)
    q[:] = arm.q
    shared = memory[6 : 6 + 72].reshape(2, 6, 6)
    with pytest.raises(InputError, match="shares memory; expected its own, got that of q"):
        analyse_many(arm, q, out={"stiffness_B": shared})
    own = memory[12 : 12 + 72].reshape(2, 6, 6)
    found = analyse_many(arm, q, out={"stiffness_B": own})
    np.testing.assert_array_equal(found["stiffness_B"], analyse_many(arm, q.copy())["stiffness_B"])
    wrench = np.zeros((2, 6))
    with pytest.raises(InputError, match="got that of wrench"):
        analyse_many(arm, q, wrench=wrench, outputs=["wrench"], out={"wrench": wrench})
    both = {"stiffness_B": own, "stiffness_A": own[::-1]}
    with pytest.raises(InputError, match="got that of stiffness_B"):
        analyse_many(arm, q, outputs=list(both), out=both)


ODD = {
    "a kind of load": lambda arm: cartstiff.analyse(arm, wrench=[1] * 6, load_kind=None),
    "a connection": lambda arm: cartstiff.analyse(arm).tensor(None),
    "what is held": lambda arm: cartstiff.equilibrium(arm, held={"z": "far"}),
    "steps in words": lambda arm: cartstiff.equilibrium(arm, iterations="3"),
    "half a step": lambda arm: cartstiff.equilibrium(arm, iterations=2.5),
    "a threshold": lambda arm: cartstiff.analyse_posture(cartstiff.analyse(arm), threshold="x"),
    "a tolerance": lambda arm: cartstiff.analysis.Tolerances(True),
    "a truth in words": lambda arm: cartstiff.analyse(arm, strict="no"),
    "limits in words": lambda arm: cartstiff.inverse_kinematics(arm, np.eye(4), limits="no"),
    "settling in words": lambda arm: cartstiff.equilibrium(arm, settle="no"),
    "no choice of postures": lambda arm: cartstiff.maps.compute_map(
        arm, [1, 2], ["condition"], "m.zarr"
    ),
    "a locked joint": lambda arm: cartstiff.load("panda", locked={"panda_finger_joint1": "open"}),
}


@pytest.mark.parametrize("what", ODD)
def test_odd_arguments_are_refused_in_one_line(what):
    with pytest.raises(InputError) as error:
        ODD[what](cartstiff.load("ur5"))
    assert "\n" not in str(error.value)


def test_the_default_posture_cannot_be_written_to():
    with pytest.raises(ValueError, match="read-only"):
        cartstiff.load("ur5").q[0] = 1.0


@pytest.mark.filterwarnings("error")
def test_signalling_numbers_are_refused_without_a_warning():
    """Their conversion to doubles warns in NumPy."""
    values = np.full(6, 0x7F800001, np.uint32).view(np.float32)
    with pytest.raises(InputError, match="finite"):
        checked_array(values, (6,), "values")
