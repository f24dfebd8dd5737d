"""A tab without a socket: questions and their answers."""

from __future__ import annotations

import json
from copy import copy
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tests.doors import PolynomialLaw
from tests.support.pages import asking, cloud_of, message_of, playback_of, source_of, stated, tab_of

import cartstiff
from cartstiff import CartstiffError, DeadWrench, InputError, JointSprings
from cartstiff.core.errors import UnknownNameError
from cartstiff.geometry import se3


@pytest.fixture
def session(no_picture):
    def make(name: str, **options: Any) -> Any:
        return tab_of(source_of(cartstiff.load(name), **options), no_picture)

    return make


def asked(session: Any, **message: Any) -> dict[str, Any]:
    """The answer's object, which must be JSON."""
    answer = session.answer(message_of(json.dumps({"id": 1, **message})))
    return json.loads(json.dumps(answer.data, allow_nan=False))


def described(elastic: Any, q: Any = None) -> dict[str, Any]:
    """What a new tab is told of a mechanism."""
    told = tab_of(source_of(elastic, q)).hello().data["mechanism"]
    return json.loads(json.dumps(told, allow_nan=False))


def ranges_of(elastic: Any, q: Any) -> list[tuple[float, float]]:
    """The ends of the sliders at a posture."""
    return [(one["lower"], one["upper"]) for one in described(elastic, q)["coordinates"]]


def worked(session: Any, **message: Any) -> dict[str, Any]:
    """The answer to a question that takes many postures."""
    steps = session.work(message_of(json.dumps({"id": 1, **message})))
    pauses = 0
    while True:
        try:
            next(steps)
            pauses += 1
        except StopIteration as done:
            assert pauses > 1, "others must be let in between postures"
            return json.loads(json.dumps(done.value.data, allow_nan=False))


def test_forces_that_drives_hold_are_sought_only_while_they_are_shown(monkeypatch):
    source, sought = source_of(cartstiff.load("ur5")), list[Any]()
    none = sought.append  # nothing balances the posture then
    monkeypatch.setattr("cartstiff.shown.scene.held_forces.held_forces", none)
    tab = tab_of(source)
    state = {"load": [0, 0, 0, 0, 0, -100.0]}
    assert asked(tab, do="draw", state=state)["legend"]["held_forces"] is None
    assert sought == []
    facts = asked(tab, do="draw", state=state | {"held_forces": True})["legend"]["held_forces"]
    assert facts == {"shown": False, "reason": "no wrench balances the posture"}
    assert len(sought) == 1
    assert asked(tab, do="draw", state=state)["legend"]["held_forces"] is None
    assert len(sought) == 1


def test_hello_says_what_there_is(session):
    answer = session("panda").hello()
    data = answer.data
    assert answer.commands == [b"everything"]
    assert data["mechanism"]["frame"] == "panda_hand"
    assert [c["name"] for c in data["mechanism"]["coordinates"]] == list(
        cartstiff.load("panda").names
    )
    assert data["mechanism"]["coordinates"][3]["upper"] == pytest.approx(-0.0698)
    assert data["state"]["quantity"] == "stiffness"
    assert data["trajectory"] is None
    json.dumps(data, allow_nan=False)


def test_a_drawn_posture_is_the_api_s(session):
    q = [0.1, -1.0, 1.2, -0.5, 0.8, 0.3]
    load = [1, 2, 3, 4, 5, -60]
    state = {"q": q, "load": load}
    expected = cartstiff.analyse(cartstiff.load("ur5"), q, wrench=load).to_dict()
    assert asked(session("ur5"), do="result", state=state)["result"] == expected
    found = asked(session("ur5"), do="draw", state=state)["numbers"]["result"]
    assert found == {key: expected[key] for key in found}


def test_the_load_may_be_given_along_the_axes_of_the_room(session):
    arm = cartstiff.load("ur5")
    found = asked(
        session("ur5"), do="draw", state={"load": [0, 0, 0, 0, 0, -100], "load_axes": "world"}
    )
    R = cartstiff.analyse(arm).pose[:3, :3]
    wrench = np.array(found["numbers"]["result"]["wrench"])
    assert np.allclose(R @ wrench[3:], [0, 0, -100], atol=1e-9)
    assert np.allclose(wrench[:3], 0, atol=1e-9)


def test_the_compliance_is_shown_first_where_there_is_no_stiffness(session):
    assert session("five-bar").start.quantity == "compliance"
    assert session("ur5").start.quantity == "stiffness"


@pytest.mark.parametrize(
    ("state", "words"),
    [
        ({"q": [0.0]}, "wrong count"),
        ({"q": [0.0] * 6, "moved": 6}, "no such coordinate"),
        ({"stiffness": [1.0, 2.0]}, "stiffness"),
        ({"quantity_of_map": "x", "q": None}, None),
    ],
)
def test_refused_states(session, state, words):
    one = session("ur5")
    if words is None:  # no map: the wish has nothing to act on
        assert asked(one, do="draw", state=state)["numbers"]
        return
    with pytest.raises(InputError, match=words):
        asked(one, do="draw", state=state)
    assert asked(one, do="draw", state={})["numbers"], "the tab goes on"


def test_a_sweep_runs_through_the_limits(session):
    found = worked(session("panda"), do="sweep", coordinate=3, steps=9)
    assert found["at"][0] == pytest.approx(-3.0718)
    assert found["at"][-1] == pytest.approx(-0.0698)
    arm = cartstiff.load("panda")
    for x, row in zip(found["at"], found["rows"], strict=True):
        q = arm.q.copy()
        q[3] = x
        assert row["q"] == pytest.approx(q)
        result = cartstiff.analyse(arm, q)
        if result.matrices["K"] is not None:
            values = 1 / np.linalg.eigvalsh(result.compliances["K"][3:, 3:])[::-1]
            assert np.allclose(row["translation"], values, rtol=1e-9)
    assert found["seconds"] > 0


def test_a_sweep_of_a_closed_chain_stays_assembled(session):
    one = session("five-bar")
    found = worked(one, do="sweep", coordinate=0, steps=21, state={"quantity": "compliance"})
    mechanism = cartstiff.load("five-bar").mechanism
    reached = [row for row in found["rows"] if "reason" not in row]
    assert len(reached) > 5
    for x, row in zip(found["at"], found["rows"], strict=True):
        if row in reached:
            residual = mechanism.at(row["q"]).residual
            assert np.abs(residual).max() < 1e-11
            assert row["q"][0] == pytest.approx(x, abs=1e-9)
            assert row["q"][2] == pytest.approx(one.start.q[2], abs=1e-9), "the other motor"
        else:
            assert 2 in [i for i, *_ in row["moved"]], "the other motor"
            motors = np.array(mechanism.closed([x, 0, one.start.q[2], 0]).q)[[0, 2]]
            assert np.abs(motors - [x, one.start.q[2]]).max() > 1e-3


def test_a_load_that_bends_links_leaves_the_sweep_and_the_sliders(session):
    one = session("3-rrr")
    load = {"load": [0, 0, 0, 0, 0, -100.0], "load_axes": "world"}
    free, loaded = (
        {x for x, row in zip(found["at"], found["rows"], strict=True) if "reason" not in row}
        for found in (
            worked(one, do="sweep", coordinate=15, steps=13, state=state) for state in ({}, load)
        )
    )
    assert len(free) > 3
    assert loaded == free
    numbers = asked(one, do="numbers", state=load)["numbers"]
    assert np.abs(np.subtract(numbers["result"]["q"], one.start.q)).max() > 1e-4, "links bend"
    assert numbers["q"] == pytest.approx(one.start.q, abs=1e-12), "sent back with the next state"


def test_a_sweep_deflects_links_only_where_the_chain_closes(session, monkeypatch):
    one, analysed = session("3-rrr"), []
    kind = type(one)
    real = kind._analysed
    monkeypatch.setattr(kind, "_analysed", lambda *a: analysed.append(1) or real(*a))
    state = {"load": [0, 0, 0, 0, 0, -100.0], "load_axes": "world"}
    found = worked(one, do="sweep", coordinate=15, steps=13, state=state)
    reached = sum("reason" not in row for row in found["rows"])
    assert 3 < reached < 13
    assert len(analysed) == reached


def test_the_motor_moves_and_the_closures_follow(session):
    one = session("five-bar")
    q = one.start.q
    q[0] += 0.1
    found = asked(one, do="draw", state={"q": q, "moved": 0})["numbers"]["result"]["q"]
    assert found[0] == pytest.approx(q[0], abs=1e-14)
    assert found[2] == pytest.approx(q[2], abs=1e-14), "the other motor stands still"
    assert found[1] != q[1]
    assert np.abs(cartstiff.load("five-bar").mechanism.at(found).residual).max() < 1e-11


def test_a_hand_pulls_the_tool(session):
    one, arm = session("ur5"), cartstiff.load("ur5")
    pose = cartstiff.analyse(arm).pose.copy()
    pose[:3, 3] += [0.05, -0.04, 0.03]
    answer = asked(one, do="draw", towards={"pose": pose.tolist()})
    assert answer["followed"]["reached"]
    assert np.allclose(answer["numbers"]["result"]["pose"], pose, atol=1e-9)
    assert asked(one, do="draw")["followed"] is None
    pose[0, 3] += 5.0
    found = asked(one, do="draw", towards={"pose": pose.tolist()})["followed"]
    assert not found["reached"]
    assert 3.0 < found["distance"] < 5.0
    with pytest.raises(InputError, match="not a rigid motion"):
        asked(one, do="draw", towards={"pose": (2 * pose).tolist()})


def test_a_moved_joint_of_a_grasp_stays_where_it_was_put(session):
    """No motors are named: the coordinate just moved is held, the others close the chain."""
    one = session("grasp")
    q = one.start.q
    q[1] += 0.05
    found = asked(one, do="draw", state={"q": q, "moved": 1})["numbers"]["result"]["q"]
    assert found[1] == pytest.approx(q[1], abs=1e-14)


def test_a_trajectory(session):
    arm = cartstiff.load("ur5")
    postures = np.array([arm.q, arm.q + 0.1, arm.q + 0.2])
    one = session("ur5", trajectory=playback_of(postures, np.array([0.0, 0.5, 2.0]), True))
    assert one.hello().data["trajectory"] == {"time": [0.0, 0.5, 2.0], "timed": True}
    found = worked(one, do="series")
    assert found["at"] == [0.0, 0.5, 2.0]
    assert [row["q"] for row in found["rows"]] == postures.tolist()
    with pytest.raises(InputError, match="without a trajectory"):
        worked(session("ur5"), do="series")


def test_a_map(session):
    cloud = cloud_of(np.zeros((4, 3)), {"softest": np.arange(4.0)}, {"softest": "N/m"})
    one = session("ur5", cloud=cloud)
    assert one.start.quantity_of_map == "softest"
    found = asked(one, do="draw", state={"quantity_of_map": "softest"})
    assert found["legend"]["cloud"] == {"label": "softest", "unit": "N/m"}
    one.hello()  # draws them, too
    found = asked(one, do="draw", state={"quantity_of_map": "softest"})
    assert found["legend"]["cloud"]["unit"] == "N/m", "the bar stays"
    with pytest.raises(UnknownNameError, match="quantity"):
        asked(one, do="draw", state={"quantity_of_map": "hardest"})


def test_another_frame_of_interest(session):
    one = session("ur5")
    names = one.hello().data["mechanism"]["frames"]
    assert "wrist_3_link" in names
    found = asked(one, do="frame", name="wrist_3_link")
    assert found["do"] == "hello"
    assert found["mechanism"]["frame"] == "wrist_3_link"
    numbers = asked(one, do="draw", state={})["numbers"]["result"]
    expected = cartstiff.analyse(cartstiff.load("ur5", frame="wrist_3_link"))
    assert np.array_equal(numbers["stiffness"]["K"], expected.matrices["K"])
    for name in ("/etc/passwd", "nonsense"):
        with pytest.raises(UnknownNameError):
            asked(one, do="frame", name=name)


FLEXIBLE = """
kind: serial
model: ur5
flexible:
  upper_arm_link:
    stiffness:
      - [2.0e+4, 0, 0, 0, 0, 0]
      - [0, 2.0e+4, 0, 0, 0, 0]
      - [0, 0, 2.0e+4, 0, 0, 0]
      - [0, 0, 0, 1.0e+6, 0, 0]
      - [0, 0, 0, 0, 1.0e+6, 0]
      - [0, 0, 0, 0, 0, 1.0e+6]
"""


@pytest.mark.parametrize("kind", ["rigid", "flexible"])
def test_another_frame_moves_no_load_and_no_payload(kind, no_picture, tmp_path):
    """Typed with the command or on the page, they stay where they are on the link."""
    path = tmp_path / "arm.yaml"
    path.write_text(FLEXIBLE)
    name = "ur5" if kind == "rigid" else str(path)
    typed = cartstiff.load(name, payload=[6.0, 0.1, 0.0, 0.2], tcp=[0.0, 0.0, 0.05])
    tab = tab_of(source_of(typed), no_picture)
    tree = typed.mechanism.tree
    T_N_M = np.linalg.inv(tree.placement("ee_link").T_j_f) @ typed.mechanism.body.T_j_f
    state = {
        "load": [0.0, 0.0, 0.0, 30.0, 0.0, -400.0],
        "load_axes": "world",
        "load_at": [0.03, 0.0, 0.1],
        "payload": [4.0, 0.0, 0.05, 0.1],
    }
    before = asked(tab, do="numbers", state=state)["numbers"]["result"]
    found = asked(tab, do="frame", name="ee_link", state=state, kept=[state])
    for now in (found["now"], *found["kept"]):
        for there, here in ((now["load_at"], "load_at"), (now["payload"][1:], "payload")):
            assert there == pytest.approx((T_N_M @ [*state[here][-3:], 1.0])[:3], abs=1e-15)
    assert tab.elastic.mechanism.tree is tree  # with the payload on its joint
    after = asked(tab, do="numbers", state=found["now"])["numbers"]["result"]
    assert after["pose"] == pytest.approx(before["pose"] @ np.linalg.inv(T_N_M), abs=1e-9)
    inverse = np.linalg.inv(T_N_M)
    Ad = se3.adjoint(inverse)
    expected = Ad.T @ np.array(before["load"]["stiffness"]) @ Ad
    assert np.allclose(after["load"]["stiffness"], expected, rtol=1e-6, atol=1e-6 * expected.max())
    # Back at the first frame: its tool is there again.
    back = asked(tab, do="frame", name="tool0", state=found["now"])
    assert back["now"]["load_at"] == pytest.approx(state["load_at"], abs=1e-15)
    assert np.array_equal(tab.elastic.mechanism.body.T_j_f, typed.mechanism.body.T_j_f)


def test_what_is_fixed_to_M_itself_stays_with_M(session):
    """A force of a file's own on M would move with it: no other frame is offered."""
    elastic = cartstiff.load("ur5")
    loaded = elastic.with_potential(DeadWrench([0.0] * 6))
    assert len(elastic.frames_of_body) > 1
    assert loaded.frames_of_body == ["tool0"]
    with pytest.raises(UnknownNameError, match="frame"):
        loaded.with_frame("wrist_3_link")


def test_the_analysis_as_text(session):
    text = asked(session("ur5"), do="analysis", state={"connection": "B"})["text"]
    assert "Principal stiffness" in text
    assert "eigenscrew" in text.lower()


def test_numbers_without_a_picture(session):
    one = session("ur5")
    before = len(one.picture.drawn)
    numbers = asked(one, do="numbers", state={"connection": "A"})["numbers"]
    assert len(one.picture.drawn) == before
    assert numbers == asked(one, do="draw", state={"connection": "A"})["numbers"]


def test_a_singular_posture_is_answered(session):
    found = asked(session("ur5"), do="draw", state={"q": [0.0] * 6})["numbers"]
    assert found["result"]["stiffness"]["K"] is None
    assert found["verdict"]["level"] == "bad"
    assert found["has_compliance"]
    state = {"q": [0.0] * 6, "quantity": "compliance"}
    found = asked(session("ur5"), do="draw", state=state)["numbers"]
    assert found["result"]["compliance"]["K"] is not None


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("ur5", list(range(6))),
        ("stewart-gough", list(range(6))),
        ("five-bar", [0, 2]),
        ("6-ups", [2, 8, 11, 14, 17, 20]),
        ("delta", None),
        ("grasp", None),
    ],
)
def test_sliders_are_what_a_user_moves(name, expected):
    elastic = cartstiff.load(name)
    found = elastic.commanded
    if expected is None:
        names = [elastic.names[i] for i in found]
        wanted = ("motor",) if name == "delta" else ("spread", "proximal", "distal")
        assert all(n.split("/")[1] in wanted for n in names)
        assert len(found) == (3 if name == "delta" else 6)
    else:
        assert found == expected
    for (low, high), x in zip(ranges_of(elastic, elastic.q), elastic.q, strict=True):
        assert low <= x <= high
        assert high > low


def test_a_motor_with_a_nonlinear_spring_has_a_slider():
    """It has no constant stiffness; the chain names no motors."""
    elastic = cartstiff.load("five-bar")
    chain, k = copy(elastic.mechanism), elastic.springs.stiffness.copy()
    chain.actuated, k[0] = None, 0.0
    springs = JointSprings(k, elastic.springs.rest, {0: PolynomialLaw((5.0, 0.0, 1e3))})
    assert replace(elastic, mechanism=chain, springs=springs).commanded == [0, 2]


def test_sliders_of_a_platform_end_where_a_leg_ends_its_stroke():
    """The hexapod's legs go from 0.5 to 1.2; one coordinate moves at a time."""
    elastic = cartstiff.load("hexapod")
    anchors, points = elastic.mechanism.anchors, elastic.mechanism.points_P
    for i, ends in enumerate(ranges_of(elastic, elastic.q)):
        for end in ends:
            q = elastic.q.copy()
            q[i] = end
            R = Rotation.from_euler("xyz", q[3:]).as_matrix()
            lengths = np.linalg.norm(points @ R.T + q[:3] - anchors, axis=1)
            left = min(lengths.min() - 0.5, 1.2 - lengths.max())
            assert left >= 0.0
            assert left < 1e-5 or (i > 2 and abs(end) == pytest.approx(np.pi / 6))
    # A leg that is beyond its stroke does not hold a slider, one at its end holds it on one side.
    low = elastic.q - 0.42 * np.eye(6)[2]
    assert ranges_of(elastic, low)[2][1] > elastic.q[2]
    rest = replace(elastic, mechanism=replaced_limits(elastic.mechanism, low))
    assert ranges_of(rest, low)[2][0] == pytest.approx(low[2], abs=1e-6)


def replaced_limits(platform, q):
    """The platform with strokes that end at a pose."""
    other = copy(platform)
    other.limits = np.stack([platform.leg_lengths(q), np.full(6, 1.2)], axis=1)
    return other


def test_an_impossible_assembly_is_refused_not_raised_through(session):
    one = session("five-bar")
    q = list(one.start.q)
    q[0] += 3.0
    try:
        asked(one, do="draw", state={"q": q, "moved": 0})
    except CartstiffError as error:
        assert "assembled" in str(error)  # noqa: PT017
    assert asked(one, do="draw", state={})["numbers"]


def test_what_drives_are_told_moves_the_body_from_where_the_sliders_stand(session):
    """The posture is the one of the equilibrium; the sliders stay, so that nothing adds up."""
    machine = cartstiff.load("flexure-hexapod")
    tab, load = session("flexure-hexapod"), [0, 0, 0, 0, 0, -10.0]
    state = {"command": [0, 1e-5, 0, 0, 0, 0], "load": load}
    for _ in range(2):
        numbers = asked(tab, do="numbers", state=state)["numbers"]
        rest = cartstiff.after_command(machine, {"leg2": 1e-5}, wrench=load)
        assert np.abs(np.array(numbers["result"]["q"]) - rest.q).max() < 1e-12
        assert np.abs(rest.q - machine.q).max() > 1e-6
        assert numbers["q"] == machine.q.tolist()
        state["q"] = numbers["q"]
    rows = worked(tab, do="sweep", state=state, coordinate=0, steps=3)["rows"]
    assert np.abs(np.array(rows[1]["q"]) - rest.q).max() < 1e-6
    with pytest.raises(InputError, match="6"):
        asked(tab, do="numbers", state={"command": [1e-5]})


def test_only_joints_with_springs_can_be_told(session):
    tab = session("6-pus")
    springs = tab.hello().data["mechanism"]["springs"]
    assert {s["name"] for s in springs if s["driven"]} == {f"leg{k}/slide" for k in range(1, 7)}
    passive = next(k for k, s in enumerate(springs) if not s["driven"])
    told = [0.0] * len(springs)
    told[passive] = 0.1
    with pytest.raises(InputError, match="nothing drives it"):
        asked(tab, do="numbers", state={"command": told})


def test_weight_and_lengths_are_what_the_tab_says(session):
    heavy, load = session("ur5"), [0.0, 0.0, 0.0, 0.0, 0.0, -100.0]
    state = {"payload": [4.0, 0.0, 0.02, 0.1], "gravity": [0.0, 0.0, -1.62], "load": load}
    numbers = asked(heavy, do="draw", state=state)["numbers"]
    arm = cartstiff.load("ur5", payload=[4.0, 0.0, 0.02, 0.1], gravity=[0.0, 0.0, -1.62])
    result = cartstiff.analyse(arm, wrench=load)
    assert np.allclose(numbers["result"]["stiffness"]["F"], result.matrices["F"], rtol=1e-12)
    assert "payload 4" in numbers["weighed"]
    # On the earth where nothing else is said, and nowhere where nothing weighs.
    state = {"payload": [4.0, 0.0, 0.0, 0.0]}
    assert "-9.81" in asked(heavy, do="draw", state=state)["numbers"]["weighed"]
    assert "weighed" not in asked(heavy, do="draw", state={})["numbers"]
    platform = session("hexapod")
    legs = asked(platform, do="draw")["numbers"]["legs"]
    lengths = [leg["length"] * (1.02 if i == 2 else 1.0) for i, leg in enumerate(legs)]
    numbers = asked(platform, do="draw", lengths=lengths)["numbers"]
    assert [leg["length"] for leg in numbers["legs"]] == pytest.approx(lengths, rel=1e-12)
    with pytest.raises(InputError, match="platforms"):
        asked(heavy, do="draw", lengths=lengths)


@pytest.mark.parametrize(
    ("kind", "ends", "expected"),
    [
        ("revolute", (-2 * np.pi, 2 * np.pi), (-np.pi, np.pi)),
        ("revolute", (-1.0, 2.0), (-1.0, 2.0)),
        ("revolute", (0.0, 4 * np.pi), (0.0, 2 * np.pi)),
        ("revolute", (-5 * np.pi, -np.pi), (-3 * np.pi, -np.pi)),
        ("prismatic", (-9.0, 9.0), (-9.0, 9.0)),
    ],
)
def test_a_sweep_of_an_angle_is_one_turn_at_most(kind, ends, expected):
    arm = cartstiff.load(
        f"<robot name='r'><link name='a'/><link name='b'/><joint name='j' type='{kind}'>"
        "<parent link='a'/><child link='b'/>"
        f"<limit lower='{ends[0]}' upper='{ends[1]}' effort='1' velocity='1'/></joint></robot>"
    )
    (told,) = described(arm)["coordinates"]
    assert told["swept"] == pytest.approx(expected)


def test_a_changed_spring_leaves_the_laws_of_the_others(no_picture):
    """The page sends the numbers of all springs, of which a nonlinear one has none."""
    arm = cartstiff.load("ur5")
    laws = {2: PolynomialLaw((1e4, 0.0, 1e6))}
    arm = replace(arm, springs=replace(arm.springs, laws=laws))
    one = tab_of(source_of(arm), no_picture)
    sent = [spring["stiffness"] for spring in described(arm)["springs"]]
    sent[5] *= 2.0
    load = (0.0, 0.0, 0.0, 0.0, 0.0, -100.0)
    result = one.result(one.start.model_copy(update={"stiffness": sent, "load": load}))
    stiffer = arm.with_springs({"wrist_3_joint": sent[5]})
    expected = cartstiff.analyse(stiffer, wrench=load, load_axes="world")
    assert result.elastic.springs.laws == laws
    assert np.allclose(result.matrices["B"], expected.matrices["B"], rtol=1e-12)


def test_another_frame_keeps_the_springs_of_the_command_line(no_picture):
    given = {"elbow_joint": np.inf, "wrist_1_joint": 5e3}
    one = tab_of(stated("ur5", stiffness=given), no_picture)
    one.answer(asking("frame", one.start, name="ee_link"))
    result = one.result(one.start)
    assert result.elastic.mechanism.rigid == {2}
    expected = cartstiff.load("ur5", frame="ee_link").with_springs(given)
    C = cartstiff.analyse(expected).compliances["B"]
    assert np.allclose(result.compliances["B"], C, rtol=1e-9, atol=1e-12 * np.abs(C).max())


def test_of_many_springs_those_are_tried_that_matter_most(session, monkeypatch):
    """By the derivative; what is tried is computed as with another stiffness in the file."""
    tab, load = session("ur5"), [0.0, 0.0, 0.0, 0.0, 0.0, -100.0]
    k = tab.elastic.springs.stiffness.tolist()
    state = {"load": load, "load_axes": "world"}
    to = [2.0 * x for x in k]
    every = asked(tab, do="stiffer", state=state, to=to)
    monkeypatch.setattr("cartstiff.shown.page.what_if.MOST_TRIED", 2)
    few = asked(tab, do="stiffer", state=state, to=to)
    assert few["order"] == every["order"][:2]
    for i, size in enumerate(few["sizes"]):
        if i not in few["order"]:
            assert size is None
            continue
        arm = tab.elastic.with_springs([*k[:i], to[i], *k[i + 1 :]])
        result = cartstiff.analyse(arm, wrench=load, load_axes="world")
        way = np.linalg.solve(result.tangent, result.wrench)[3:]
        assert size == pytest.approx(np.linalg.norm(way), rel=1e-9)
