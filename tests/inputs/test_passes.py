"""From a robot to a mechanism: each pass alone, and a reader of a format of one's own."""

import ast
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from tests.doors import read_robot_description
from tests.inner import Assembly, ClosedChainFile, Lifted, Part, SerialFile, joints, passes
from tests.mechanisms.machines import joint, masses, write_file, write_urdf

import cartstiff
from cartstiff import InputError
from cartstiff.core.errors import UnknownNameError
from cartstiff.extend import FORMATS, FileSpring, RobotDescription, add_joint
from cartstiff.geometry import se3

#: Functions that users call, whose arguments are options of their own.
DOORS = {"load", "hexapod", "from_pinocchio"}


@pytest.fixture
def robot(tmp_path) -> RobotDescription:
    """Two joints to `tool`, one that follows the first on a branch, and one beyond the tool."""
    parts = [
        joint("a", "base", "upper", at=(0, 0, 0.3), axis=(0, 1, 0)),
        joint("b", "upper", "tool", at=(0.4, 0, 0), axis=(0, 1, 0)),
        joint("c", "base", "side", axis=(0, 0, 1)),
        joint("d", "tool", "gripper", at=(0.1, 0, 0), axis=(0, 1, 0)),
    ]
    path = write_urdf(tmp_path, *parts)
    text = masses(path.read_text(), upper=2.0).replace(
        '<axis xyz="0.0 0.0 1.0"/>', '<axis xyz="0.0 0.0 1.0"/><mimic joint="a" multiplier="2"/>'
    )
    path.write_text(text)
    return read_robot_description(path)


def part_of(robot, model=SerialFile, **keys):
    """A part of keys of a file, as they are checked there."""
    file = model.model_validate({"kind": "serial", "model": "machine.urdf", "frame": "tool"} | keys)
    return Part.of(file, robot)


def run(part, *steps):
    for step in steps:
        part = step(part)
    return part


def whole_of(robot, *steps, **keys):
    """An assembly of one arm after some passes over it."""
    part = run(part_of(robot, **keys), *passes.OF_ROBOT)
    return run(Assembly(part.entry, "arm", (part,)), *steps)


def codes(noted):
    return [note.code for note in noted.notes]


def test_frame(robot):
    part = joints.named_frame(part_of(robot, frame=None))
    assert (part.frame, codes(part)) == ("tool", ["default-frame"])
    assert joints.named_frame(part_of(robot)).notes == ()
    with pytest.raises(UnknownNameError, match=r"key legs\.3: unknown frame"):
        joints.named_frame(replace(part_of(robot, frame="nowhere"), number=3))


def test_lines_of_the_robots_own_file_act_where_their_joints_move_the_frame(robot):
    lines = (("one", frozenset({"a"})), ("other", frozenset({"d"})))
    part = joints.named_frame(part_of(replace(robot, lines=lines)))
    assert joints.acting_lines(part).lines == ("one",)


def test_a_free_base_is_held_unless_something_acts_on_it(robot):
    free = replace(robot, loose=frozenset({"a"}))
    part = joints.held_base(joints.named_frame(part_of(free)))
    assert (part.robot.held, codes(part)) == ({"a"}, ["root-held"])
    sprung = part_of(free, springs={"a": {"stiffness": 5.0}, "b": {"stiffness": 5.0}})
    assert joints.held_base(joints.named_frame(sprung)).robot.held == frozenset()


def test_springs_of_actuators_are_added_to_the_joints_own(robot):
    own = replace(robot, actuators={"a": 30.0}, springs={"a": FileSpring((4.0,), 0.1)})
    assert joints.actuator_springs(part_of(own)).robot.springs == own.springs
    part = joints.actuator_springs(part_of(own, actuator_springs=True))
    assert part.robot.springs["a"].coefficients == (34.0,)
    with pytest.raises(InputError, match="no actuator holds a position"):
        joints.actuator_springs(part_of(robot, actuator_springs=True))


def test_followers_that_are_named_are_their_leaders(robot):
    part = joints.leaders(part_of(robot, q={"c": 0.8}, passive=["c"]))
    assert part.entry.q == {"a": 0.4}
    assert part.entry.passive == ["a"]
    with pytest.raises(InputError, match=r"key legs.2.q: joint 'c' follows 'a'"):
        joints.leaders(replace(part_of(robot, q={"a": 0.1, "c": 0.8}), number=2))


def test_joints_that_do_not_act_are_cut(robot):
    part = run(part_of(robot), joints.named_frame, joints.cut)
    assert part.tree.names == ["a", "b"]  # the follower's mass would move with its leader
    assert part.tree.model.njoints == 4
    held = run(part_of(robot, locked={"c": 0.6}), joints.named_frame, joints.cut)
    assert held.tree.names == ["b"]  # a locked follower locks its leader
    T = held.tree.at(np.zeros(1)).pose(held.tree.placement("tool"))
    assert T[:3, 3] == pytest.approx([0.4 * np.cos(0.3), 0, 0.3 - 0.4 * np.sin(0.3)])


def test_what_is_beyond_the_frame_is_left_out(robot):
    entries = {n: {"stiffness": 9.0} for n in "abd"}
    part = run(part_of(robot, springs=entries), joints.named_frame, joints.cut)
    part = joints.without_beyond(part)
    assert (part.beyond, part.idle, [*part.entry.springs]) == (("d",), ("d",), ["a", "b"])
    assert codes(joints.beside(part)) == ["idle-springs"]


def test_checks_refuse_what_acts_on_a_joint_and_cannot_be_expressed(robot):
    from tests.inner import Obstacle

    bushing = Obstacle("<bushing>", frozenset({"b"}), keys=("springs",))
    part = run(part_of(replace(robot, obstacles=(bushing,))), joints.named_frame, joints.cut)
    with pytest.raises(InputError, match="<bushing> acts on joint 'b' and cannot be expressed"):
        joints.checks(part)
    assert codes(joints.checks(replace(part, keys=frozenset({"springs"})))) == ["ignored"]


def test_default_posture_is_the_entrys_then_the_files(robot):
    part = replace(part_of(robot, q={"b": 0.2}), robot=replace(robot, posture={"a": 0.1, "b": 9.0}))
    part = run(part, joints.named_frame, joints.cut, joints.posture)
    assert part.q.tolist() == [0.1, 0.2]


def test_robots_stand_where_their_bases_are(robot):
    whole = whole_of(robot, passes.joined, base={"xyz": [1.0, 2.0, 3.0]})
    T = whole.tree.at(whole.q).pose(whole.tree.placement("tool"))
    assert T[:3, 3] == pytest.approx([1.4, 2.0, 3.3])


def test_loops_get_their_joints(robot):
    tie = {"frames": ["world", "tool"], "type": "hinge", "axes": [[0, 1, 0]] * 2}
    keys = {"kind": "closed-chain", "closures": [tie]}
    part = run(part_of(robot, ClosedChainFile, **keys), *passes.OF_ROBOT)
    whole = run(Assembly(part.entry, "loop", (part,)), passes.joined, passes.closed)
    assert whole.free == ("closure1.x",)
    assert [c.type for c in whole.closures] == ["weld"]


def test_names_under_keys_are_checked(robot):
    for key, value in (("passive", ["nobody"]), ("q", {"nobody": 1.0})):
        with pytest.raises(UnknownNameError, match=f"key {key}: unknown joint"):
            whole_of(robot, passes.joined, passes.names_of_keys, **{key: value})


START = (passes.joined, passes.chain)


def test_payload_and_lifted_masses(robot):
    lifted = replace(robot, lifted=(Lifted("upper", 1.5, np.zeros(3)),))
    whole = whole_of(lifted, *START, passes.payload, payload={"mass": 7.0})
    assert whole.chain.masses()["payload"] == 7.0
    (force,) = passes.lifted(whole).potentials
    assert force.lifted == 1.5


def test_home_of_an_arm_without_a_posture_is_regular(robot):
    whole = whole_of(robot, *START, passes.home, frame="gripper")  # straight out, in a plane
    assert "zero-singular" in codes(whole)
    placed = whole_of(robot, *START, passes.home, frame="gripper", q={"a": 0.3})
    assert "zero-singular" not in codes(placed)


def test_links_and_coupled_springs(robot):
    K = np.diag([1.0, 2.0, 3.0, 4.0, 5.0, 6.0])
    whole = whole_of(robot, *START, passes.links, flexible={"upper": {"stiffness": K.tolist()}})
    (link,) = whole.potentials
    assert np.diag(link.matrix).tolist() == [4.0, 5.0, 6.0, 1.0, 2.0, 3.0]
    coupled = [{"joints": {"a": 1.0, "b": -2.0}, "stiffness": 8.0}]
    (term,) = whole_of(robot, *START, passes.coupled, coupled_springs=coupled).potentials
    assert term.factors.tolist() == [[1.0, -2.0]]


def test_joints_have_the_springs_of_entries_then_of_files_then_assumed_ones(robot):
    own = replace(robot, springs={"b": FileSpring((6.0,), 0.2)})
    made = whole_of(own, *START, passes.joint_springs)
    assert made.springs.stiffness.tolist() == [passes.ASSUMED_STIFFNESS, 6.0]
    assert codes(made)[0] == "stiffness-assumed"
    given = {"a": {"stiffness": 5.0, "damping": 0.7}, "b": {"stiffness": 9.0, "rest": 0.1}}
    whole = whole_of(own, *START, passes.joint_springs, passes.damping, springs=given)
    assert whole.springs.stiffness.tolist() == [5.0, 9.0]
    assert whole.damping.tolist() == [0.7, 0.0]


def test_lines_have_their_rest_length_or_preload(robot):
    line = {"frames": ["world", "tool"], "points": [[0, 0, 1], [0, 0, 0]], "stiffness": 100.0}
    whole = whole_of(robot, *START, passes.lines, lines=[line | {"preload": 5.0}])
    (spring,) = whole.potentials
    assert spring.rest_length == pytest.approx(np.hypot(0.4, 0.7) - 0.05)
    rigid = line | {"frames": ["upper", "upper"]}
    with pytest.raises(InputError, match=r"key lines.1: a line between two points of one link"):
        whole_of(robot, *START, passes.lines, lines=[rigid])


def test_joints_that_nothing_holds_are_named(robot):
    steps = (*START, passes.joint_springs, passes.free_joints)
    assert "springs-missing" in codes(whole_of(robot, *steps, passive=["a", "b"]))


def test_a_reader_of_ones_own(tmp_path, monkeypatch):
    """A column of two joints in a maker's table: its compliance by hand, alone and in a file."""

    def read(path, where):
        model, joint = pin.Model(), 0
        for name, height in json.loads(path.read_text())["heights"].items():
            T = se3.pose(translation=[0.0, 0.0, height])
            joint = add_joint(model, joint, pin.JointModelRY(), T, name, (-3.0, 3.0))
        model.addFrame(pin.Frame("tip", joint, pin.SE3(T), pin.FrameType.BODY))
        own = {name: FileSpring((k,), np.nan) for name, k in (("low", 50.0), ("high", 20.0))}
        return RobotDescription(model, path, pieces=(), springs=own)

    monkeypatch.setitem(FORMATS, ".column", read)
    path = tmp_path / "a.column"
    path.write_text('{"heights": {"low": 0.5, "high": 0.3}}')
    file = write_file(tmp_path, kind="serial", model="a.column", locked={"low": 0.0})
    # The tip is 0.3 above the upper joint: x moves by 0.6 of the lower's turn, 0.3 of the upper's.
    for source, compliance in ((path, 0.6**2 / 50.0 + 0.3**2 / 20.0), (file, 0.3**2 / 20.0)):
        result = cartstiff.analyse(cartstiff.load(source), [0.0] * (1 if source is file else 2))
        J = result.posture.motion.jacobian
        C = J / result.elastic.springs.stiffness @ J.T
        assert C[3, 3] == pytest.approx(compliance, rel=1e-12)
    free = write_file(tmp_path, kind="closed-chain", model="a.column", floating=True)
    with pytest.raises(InputError, match=r"a\.column: has no free root; expected no key floating"):
        cartstiff.load(free)


def test_functions_of_the_road_have_few_arguments():
    folder = Path(passes.__file__).parent
    for path in folder.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.FunctionDef) and node.name not in DOORS:
                count = len(node.args.args) + len(node.args.kwonlyargs)
                assert count <= 8, f"{path.name}: {node.name} has {count} arguments"
