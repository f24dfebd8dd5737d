"""A better posture keeps the tip, stays near, is worth it, and says what gets worse."""

from dataclasses import replace

import numpy as np
import pytest
from tests.support.pages import asking, source_of, state_of, tab_of
from tests.support.printed import better_of, words_of_better
from tests.view.test_report import ARM, HEAVY, Q, moved_by

import cartstiff
from cartstiff import UndefinedError, analyse_posture
from cartstiff.extend import in_units

DOWN = [0, 0, 0, 0, 0, -1.0]


def measures(elastic, q, W):
    """Least stiffness against a force and condition number, as the command says them."""
    result = cartstiff.analyse(elastic, q, wrench=W, load_axes="world")
    found = analyse_posture(result)
    most = found["ellipsoids"]["compliance"]["translation"]["free"]["eigenvalues"][-1]
    return 1.0 / most, found["indices"]["condition_number"]


ARMS = [
    ("ur5", 100 * np.array(DOWN)),
    ("ur5", [0, 0, 0, 100, 0, 0]),
    ("ur10", 300 * np.array(DOWN)),
    ("panda", 50 * np.array(DOWN)),
    ("heavy", 1000 * np.array(DOWN)),
]


@pytest.mark.parametrize(("name", "W"), ARMS, ids=[f"{n}-{i}" for i, (n, _) in enumerate(ARMS)])
def test_it_keeps_the_tip_and_is_worth_it(name, W):
    """By forward kinematics, and by the equilibria at both postures."""
    if name == "heavy":
        arm = cartstiff.load(HEAVY + "</robot>", stiffness=1e6)
        arm = replace(arm, q=np.array([0.2, -0.4, 0.5, 0.3, 0.6, -0.1]))
    else:
        arm = cartstiff.load(name)
    found = better_of(arm, wrench=W, load_axes="world")
    if found is None:
        return
    before, after = (arm.mechanism.at(q).pose for q in (arm.q, found.q))
    assert after[:3, 3] == pytest.approx(before[:3, 3], abs=1e-7)
    turned = before[:3, :3].T @ after[:3, :3]
    c, s = np.cos(found.turn), np.sin(found.turn)
    assert turned == pytest.approx(np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]), abs=1e-7)
    here, there = moved_by(arm, arm.q, W), moved_by(arm, found.q, W)
    assert found.displacement == pytest.approx((here, there), rel=1e-6)
    assert found.gain >= 0.1  # what is said where none is found
    if found.is_near:
        assert np.abs(found.q - arm.q).max() <= np.pi / 2 + 1e-9
    # Nothing is worse by more than a factor of two, and what is worse is said.
    (soft, condition), (soft_there, condition_there) = (
        measures(arm, q, W) for q in (arm.q, found.q)
    )
    assert soft_there >= 0.5 * soft
    worse = {change.measure: (change.here, change.there) for change in found.worse}
    if soft_there < 0.95 * soft:
        assert worse["stiffness"] == pytest.approx((soft, soft_there), rel=1e-9)
    if condition_there > 1.06 * condition:
        assert worse["condition"] == pytest.approx((condition, condition_there), rel=1e-9)


def test_page_and_report_say_the_same():
    """One function, one text."""
    arm, W = cartstiff.load("ur5"), 100 * np.array(DOWN)
    found = better_of(arm, wrench=W, load_axes="world")
    session = tab_of(source_of(arm), lambda _: None)
    state = state_of(load=tuple(W.tolist()), load_axes="world")
    answer = session.answer(asking("better", state)).data
    assert answer["words"] == words_of_better(found, arm)
    assert answer["q"] == pytest.approx(found.q)


def test_what_gets_worse_is_said():
    """A sideways force on a panda: the body turns more there."""
    arm = cartstiff.load("panda")
    found = better_of(arm, wrench=[0, 0, 0, 30, 0, 0], load_axes="world")
    said = " ".join(words_of_better(found, arm))
    assert {change.measure for change in found.worse} == {"rotation"}
    turned = []
    for q in (arm.q, found.q):
        state = cartstiff.equilibrium(arm, q, wrench=[0, 0, 0, 30, 0, 0], load_axes="world")
        turned.append(np.linalg.norm(state.displacement[:3]))
    assert (found.worse[0].here, found.worse[0].there) == pytest.approx(turned, rel=0.02)
    assert "Worse there: the body turns by" in said


def test_a_platform_turns_only_about_its_tools_axis():
    """Within the limits of its legs, and its tip stays."""
    for name in ("cubic", "hexapod", "stewart-simscape"):
        elastic = in_units(cartstiff.load(name), "m")
        W = 20.0 * elastic.units.newtons * np.array(DOWN)
        found = better_of(elastic, wrench=W, load_axes="world")
        if found is not None:
            q = [elastic.mechanism.at(x).pose[:3, 3] for x in (elastic.q, found.q)]
            assert q[0] == pytest.approx(q[1], abs=1e-9)


def test_where_it_is_not_sought_the_reason_is_said():
    arm = cartstiff.load(f"<robot name='arm'>{ARM}</robot>", stiffness=2e4)
    held = arm.with_springs(None, np.array(Q) + 0.01)
    with pytest.raises(UndefinedError, match="would change as well"):
        better_of(held, Q, wrench=DOWN)
    with pytest.raises(UndefinedError, match="loops"):
        better_of(cartstiff.load("five-bar"), wrench=DOWN)
    soft, push = arm.with_springs(0.001 * arm.springs.stiffness), 300 * np.array(DOWN)
    with pytest.raises(UndefinedError, match="not resisted"):
        better_of(soft, Q, wrench=push)
