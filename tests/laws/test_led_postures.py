"""Motors that are told where to be lead the rest of a closed chain there, in one assembly."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from tests.doors import Chain
from tests.support import absolute_error

import cartstiff

CLOSE = 1e-9


def five_bar(left: float, right: float, signs: tuple[int, int] = (1, 1)) -> np.ndarray | None:
    """Tip of the bundled linkage by two circles, on one side of the line between the elbows."""
    linkage = cartstiff.load("five-bar").mechanism
    assert isinstance(linkage, Chain)
    home = linkage.at(cartstiff.load("five-bar").q)
    hips, links = _measures(linkage, home)
    elbows = [
        hip + upper * np.array([np.cos(angle), np.sin(angle)])
        for hip, (upper, _), angle in zip(hips, links, (left, right), strict=True)
    ]
    between = elbows[1] - elbows[0]
    distance = np.linalg.norm(between)
    (_, a), (_, b) = links
    along = (a**2 - b**2 + distance**2) / (2 * distance)
    if (square := a**2 - along**2) < 0:
        return None
    across = np.array([-between[1], between[0]]) / distance
    return elbows[0] + along * between / distance + signs[0] * np.sqrt(square) * across


def _measures(linkage, home):
    """Where the motors are, and lengths of upper and lower links, from the posture's own frames."""
    elastic = cartstiff.load("five-bar")
    names = list(elastic.names)
    places = {n: linkage.tree.at(home.q).joint_poses([names.index(n) + 1])[0] for n in names}
    hips = [places[n][:2, 3] for n in ("left_motor", "right_motor")]
    elbows = [places[n][:2, 3] for n in ("left_elbow", "right_elbow")]
    tip = home.pose[:2, 3]
    return hips, [
        (np.linalg.norm(e - h), np.linalg.norm(tip - e)) for h, e in zip(hips, elbows, strict=True)
    ]


def test_a_five_bar_keeps_its_side_as_two_circles_say():
    """`analyse` with the motors far away, from the file's posture and from nowhere else."""
    elastic = cartstiff.load("five-bar")
    left, right = (elastic.q[list(elastic.names).index(f"{s}_motor")] for s in ("left", "right"))
    tip = elastic.mechanism.at(elastic.q).pose[:2, 3]
    side = next(
        s for s in ((1, 1), (-1, -1)) if np.allclose(five_bar(left, right, s), tip, atol=CLOSE)
    )
    seen = 0
    for a, b in product(np.linspace(-1.2, 1.2, 9), repeat=2):
        expected = five_bar(left + a, right + b, side)
        motors = {"left_motor": left + a, "right_motor": right + b}
        if expected is None:
            continue
        result = cartstiff.analyse(elastic, motors)
        if absolute_error(result.q[list(elastic.mechanism.held)], list(motors.values())) > CLOSE:
            continue  # motors had to give way: the straight line leads out of the workspace
        np.testing.assert_allclose(result.pose[:2, 3], expected, atol=CLOSE)
        seen += 1
    assert seen > 50


def test_who_gives_all_coordinates_is_not_led():
    """Another assembly, known to the user, is analysed as it is."""
    elastic = cartstiff.load("five-bar")
    other = elastic.q.copy()
    names = list(elastic.names)
    other[[names.index("left_elbow"), names.index("right_elbow")]] *= -1
    closed = elastic.mechanism.closed(other, hold=elastic.mechanism.held)
    assert absolute_error(closed.pose, elastic.mechanism.at(elastic.q).pose) > 0.05
    np.testing.assert_array_equal(elastic.mechanism.closed(closed.q).q, closed.q)


def test_motors_that_had_to_give_way_are_named():
    """The answer is at another command than was given, and says by how much."""
    elastic = cartstiff.load("five-bar")
    motor = elastic.names.index("left_motor")
    result = cartstiff.analyse(elastic, {"left_motor": 3.5})
    note = next(note for note in result.notes if note.code == "actuators-adjusted")
    assert note.values["left_motor"] == pytest.approx(result.q[motor] - 3.5)
    assert set(note.values) <= {"left_motor", "right_motor"}
    assert "left_motor 3.5 -> " in note.message


@pytest.mark.parametrize("name", ["five-bar", "delta", "6-ups", "3-rrr", "ur5"])
def test_motors_that_stay_are_not(name):
    elastic = cartstiff.load(name)
    near = elastic.q.copy()
    near[list(getattr(elastic.mechanism, "actuated", None) or [0])] += 0.01
    for q in (elastic.q, near):
        assert not any(n.code == "actuators-adjusted" for n in cartstiff.analyse(elastic, q).notes)
