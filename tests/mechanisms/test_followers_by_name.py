"""Files that name joints which follow others by <mimic>: they mean the joints that lead."""

import re

import numpy as np
from tests.mechanisms.machines import codes, joint, note, write_file, write_urdf
from tests.support import refused

import cartstiff

FACTOR, OFFSET = -0.5, 0.2


def hand(folder):
    """A wrist, and two fingers of which one follows the other; the frame is on the follower."""
    lead = f'<mimic joint="motor" multiplier="{FACTOR}" offset="{OFFSET}"/></joint>'
    return write_urdf(
        folder,
        joint("wrist", "base", "palm"),
        joint("motor", "palm", "finger", at=(0.1, 0, 0), axis=(0, 1, 0)),
        joint("follower", "palm", "tip", at=(0.1, 0, 0.05), axis=(0, 1, 0)).replace(
            "</joint>", lead
        ),
        name="hand",
    )


def test_a_list_of_motors_as_public_sets_have_it_may_name_a_follower(tmp_path):
    hand(tmp_path)
    results = []
    for names in ("[wrist, motor]", "[wrist, motor, follower]", "[wrist, follower]"):
        (tmp_path / "robot.yaml").write_text(f"closed_loop: []\ntype: []\nname_mot: {names}\n")
        results.append(cartstiff.analyse(cartstiff.load(tmp_path / "robot.yaml")))
    for result in results:
        assert result.mechanism.actuated == results[0].mechanism.actuated
        assert ("followers-named" in codes(result)) == (result is not results[0])
        np.testing.assert_array_equal(result.q, results[0].q)
    assert note(results[1], "followers-named").values["leaders"] == {"follower": "motor"}


def test_the_place_of_a_follower_is_that_of_its_leader(tmp_path):
    keys = {"kind": "serial", "model": hand(tmp_path).name, "frame": "tip"}
    springs = {"wrist": {"stiffness": 5.0}, "motor": {"stiffness": 7.0}}
    by_leader = {"q": {"motor": 0.6}, "springs": springs}
    by_follower = {"q": {"follower": FACTOR * 0.6 + OFFSET}, "springs": springs}
    for more in (by_leader, by_follower):
        arm = cartstiff.load(write_file(tmp_path, **keys, **more))
        assert arm.names == ("wrist", "motor")
        np.testing.assert_allclose(arm.q, [0.0, 0.6])
    both = {"q": {"motor": 0.5, "follower": 0.1}, "springs": springs}
    refused("the places of both do not agree", cartstiff.load, write_file(tmp_path, **keys, **both))


def test_a_spring_of_a_follower_is_refused_with_the_way_out(tmp_path):
    keys = {"kind": "serial", "model": hand(tmp_path).name, "frame": "tip"}
    springs = {"wrist": {"stiffness": 5.0}, "follower": {"stiffness": 7.0}}
    words = re.escape("it follows 'motor' by <mimic>; expected motor, of which it is -0.5 times")
    refused(words, cartstiff.load, write_file(tmp_path, **keys, springs=springs))


def test_actuated_joints_of_several_legs_may_be_followers(tmp_path):
    """A body on two hands: the follower of the second leg drives that leg's motor."""
    hand(tmp_path)
    leg = {"model": "hand.urdf", "frame": "tip"}
    legs = [leg, {**leg, "grip": {"xyz": [0.0, 0.0, 0.0]}}]
    found = []
    for names in (["leg1/wrist", "leg2/motor"], ["leg1/wrist", "leg2/follower", "leg2/motor"]):
        file = write_file(tmp_path, kind="parallel", legs=legs, actuated=names)
        found.append(cartstiff.load(file))
    first, second = found
    assert second.mechanism.actuated == first.mechanism.actuated
    named = note(cartstiff.analyse(second), "followers-named")
    assert named.values["leaders"] == {"leg2/follower": "leg2/motor"}
    assert "followers-named" not in codes(cartstiff.analyse(first))
