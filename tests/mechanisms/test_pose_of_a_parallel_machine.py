"""`pose:` of a body that several legs carry: the machine is put together there, or refused."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tests.mechanisms.machines import joint, write_file, write_urdf
from tests.support import absolute_error

import cartstiff
from cartstiff import InputError

# Newton's method on the closures ends at rounding.
CLOSED = 1e-10
CRANK, ROD = 0.12, 0.34
RADIUS = 0.25, 0.15


def six_rus(folder, **keys):
    """Six cranks on a ring, a rod on each by a universal joint, a ball at the platform."""
    leg = [
        joint("crank", "base", "arm", axis=(0, 1, 0)),
        joint("u1", "arm", "cross", at=(CRANK, 0, 0), axis=(0, 1, 0)),
        joint("u2", "cross", "rod", axis=(1, 0, 0)),
        joint("s1", "rod", "s_a", at=(0, 0, ROD), axis=(1, 0, 0)),
        joint("s2", "s_a", "s_b", axis=(0, 1, 0)),
        joint("s3", "s_b", "tip", axis=(0, 0, 1)),
    ]
    write_urdf(folder, *leg, name="leg")
    legs = []
    for k in range(6):
        a = np.deg2rad(60 * k + (8 if k % 2 else -8))
        b = np.deg2rad(60 * k + (-20 if k % 2 else 20))
        legs.append(
            {
                "model": "leg.urdf",
                "frame": "tip",
                "base": {
                    "xyz": [RADIUS[0] * np.cos(a), RADIUS[0] * np.sin(a), 0],
                    "rpy": [0, 0, a + np.pi / 2 * (-1) ** k],
                },
                "grip": {"xyz": [RADIUS[1] * np.cos(b), RADIUS[1] * np.sin(b), 0]},
                "springs": {"crank": {"stiffness": 2e3}},
                "passive": ["u1", "u2", "s1", "s2", "s3"],
            }
        )
    actuated = [f"leg{k + 1}/crank" for k in range(6)]
    return write_file(folder, "rus", kind="parallel", legs=legs, actuated=actuated, **keys)


def cosine_and_sine(a, b, c):
    """The two angles t with ``a cos t + b sin t = c``."""
    middle, half = np.arctan2(b, a), np.arccos(c / np.hypot(a, b))
    return [middle - half, middle + half]


def cranks(T):
    """Angles of the six cranks: each knee is a rod's length away from its ball."""
    found = []
    for k in range(6):
        a = np.deg2rad(60 * k + (8 if k % 2 else -8))
        b = np.deg2rad(60 * k + (-20 if k % 2 else 20))
        t = a + np.pi / 2 * (-1) ** k
        ball = T[:3, :3] @ [RADIUS[1] * np.cos(b), RADIUS[1] * np.sin(b), 0] + T[:3, 3]
        d = ball - RADIUS[0] * np.array([np.cos(a), np.sin(a), 0])
        # |d - CRANK e(turn)|^2 = ROD^2 with e = (cos t cos turn, sin t cos turn, -sin turn)
        c = (d @ d + CRANK**2 - ROD**2) / (2 * CRANK)
        found.append(cosine_and_sine(d[0] * np.cos(t) + d[1] * np.sin(t), -d[2], c))
    return found


def wrapped(angles):
    return (np.asarray(angles) + np.pi) % (2 * np.pi) - np.pi


@pytest.mark.parametrize(
    ("xyz", "rpy"),
    [((0, 0, 0.35), (0, 0, 0)), ((0.02, -0.01, 0.33), (0.05, -0.1, 0.15)), ((0, 0, 0.3), (0,) * 3)],
)
def test_six_rus_is_put_together_at_its_pose(xyz, rpy, tmp_path):
    file = six_rus(tmp_path, pose={"xyz": list(xyz), "rpy": list(rpy)})
    machine = cartstiff.load(file)
    result = cartstiff.analyse(machine)
    assert absolute_error(result.pose[:3, 3], xyz) < CLOSED
    assert absolute_error(result.pose[:3, :3], Rotation.from_euler("xyz", rpy).as_matrix()) < CLOSED
    for k, both in enumerate(cranks(result.pose)):
        turn = machine.q[machine.names.index(f"leg{k + 1}/crank")]
        assert np.abs(wrapped(turn - np.array(both))).min() < CLOSED


def test_the_same_file_gives_the_same_machine(tmp_path):
    file = six_rus(tmp_path, pose={"xyz": [0, 0, 0.35]})
    assert np.array_equal(cartstiff.load(file).q, cartstiff.load(file).q)


def test_a_pose_out_of_reach_is_refused(tmp_path):
    file = six_rus(tmp_path, pose={"xyz": [0, 0, 0.6]})
    with pytest.raises(InputError, match=r"line \d+, key pose: the pose cannot be reached.*leg 1"):
        cartstiff.load(file)
