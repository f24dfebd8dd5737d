"""Actuators that do not hold, end-effectors that do not move: named, with numbers."""

import numpy as np
import pinocchio as pin
import pytest
from tests.mechanisms.machines import codes, note, write_file
from tests.support import body_jacobian, refused, relative_error, robot_file

from cartstiff import UndefinedError, analyse, load

ROUNDING = 1e-12
# Rank decisions are taken at 1e-10 of the largest singular value.
LOST = 1e-10
# A singular value grows in proportion to the distance from the singularity, up to its square.
LINEAR = 1e-3
SAME = 1e-10


def _aligned(delta=0.0):
    """Motor and elbow angles with couplers `delta` short of being in line, symmetric."""
    a = np.arccos((0.3 - 0.7 * np.cos(delta)) / 0.5)
    return {
        "left_motor": a,
        "left_elbow": -a + delta,
        "right_motor": np.pi - a,
        "right_elbow": a - delta,
    }


def test_five_bar_with_couplers_in_line():
    """The tip gives way across the couplers although both motors stand still."""
    elastic = load("five-bar")
    result = analyse(elastic, _aligned())
    found = note(result, "type-2-singularity")
    values = np.array(found.values["singular_values"])
    assert values[-1] <= LOST * values[0]
    assert found.values["characteristic_length"] == pytest.approx(result.posture.length)
    # The free motion that no motor feels moves the tip along y and costs nothing.
    U, K = result.reduction.reachable, result.reduction.reachable_stiffness
    cost, modes = np.linalg.eigh(K)
    assert abs(cost[0]) <= 1e-9 * cost[1]
    soft = U @ modes[:, 0]
    direction = result.pose[:3, :3] @ soft[3:]
    assert np.abs(direction[[0, 2]]).max() <= 1e-6 * abs(direction[1])


@pytest.mark.parametrize("delta", [1e-4, -1e-4])
def test_five_bar_near_it(delta):
    result = analyse(load("five-bar"), _aligned(delta))
    found = note(result, "near-type-2-singularity")
    values = np.array(found.values["singular_values"])
    ratio = values[-1] / values[0]
    assert LOST < ratio < 1e-3
    half = analyse(load("five-bar"), _aligned(delta / 2))
    smaller = note(half, "near-type-2-singularity").values["singular_values"]
    assert smaller[-1] / smaller[0] == pytest.approx(ratio / 2, rel=LINEAR)


def _hexagons(folder, turn, preload=0.0, small=0.5):
    """Similar semi-regular hexagons, the upper one turned by 180 degrees and `turn`."""
    low = np.deg2rad([10, 110, 130, 230, 250, 350])
    high = np.deg2rad([50, 70, 170, 190, 290, 310])
    ring, upper = (np.stack([np.cos(a), np.sin(a), 0 * a], axis=1) for a in (low, high))
    return load(
        write_file(
            folder,
            kind="stewart-gough",
            base=ring,
            platform=small * upper,
            pose={"xyz": [0, 0, 0.8], "rpy": [0, 0, turn]},
            legs={"stiffness": 1e5, "preload": preload},
        )
    )


@pytest.mark.parametrize("turn", [np.pi / 2, -np.pi / 2])
def test_similar_hexagons_at_a_right_angle(tmp_path, turn):
    """All six lines meet one screw about the axis: the legs' lengths do not hold the platform."""
    result = analyse(_hexagons(tmp_path, turn))
    found = note(result, "type-2-singularity")
    values = np.array(found.values["singular_values"])
    assert values[-1] <= LOST * values[0] < LOST * 1e3 * values[-2]
    cost, motions = np.linalg.eigh(result.matrices["B"])
    assert abs(cost[0]) <= ROUNDING * cost[-1]
    screw = motions[:, 0]
    assert np.abs(screw[[0, 1, 3, 4]]).max() <= 1e-9
    assert abs(screw[2]) > 0.1
    assert abs(screw[5]) > 0.01
    assert codes(result)[0] == "type-2-singularity"
    assert result.matrices["F"] is None
    assert result.jacobian is None
    assert result.compliances["B"] is None
    words = "do not determine the pose"
    caught = refused(words, result.tensor, "F", kind=UndefinedError)
    assert caught.code == "type-2-singularity"
    refused(words, result.flat_connection, kind=UndefinedError)
    lengths, back = np.full(6, 0.9), result.elastic.mechanism.forward_kinematics
    refused("type-2 singularity", back, lengths, result.q, kind=UndefinedError)


def test_hexagons_joined_corner_to_corner(tmp_path):
    """Similar hexagons whose like corners are joined are singular in every pose: three are lost."""
    angles = np.deg2rad([10, 110, 130, 230, 250, 350])
    ring = np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1)
    path = write_file(
        tmp_path,
        kind="stewart-gough",
        base=ring,
        platform=0.5 * ring,
        pose={"xyz": [0, 0, 0.8], "rpy": [0, 0, 0.4]},
        legs={"stiffness": 1e5},
    )
    result = analyse(load(path))
    values = np.array(note(result, "type-2-singularity").values["singular_values"])
    assert np.sum(values > LOST * values[0]) == 3
    assert np.linalg.matrix_rank(result.matrices["B"], tol=1e-3) == 3


def test_preload_holds_what_the_legs_do_not(tmp_path):
    """Tension makes K^B regular at the singularity; K^F, in leg lengths, does not exist."""
    result = analyse(_hexagons(tmp_path, np.pi / 2, preload=500.0))
    assert "type-2-singularity" in codes(result)
    assert np.linalg.eigvalsh(result.matrices["B"]).min() > 1.0
    assert result.matrices["F"] is None
    assert result.compliances["B"] is not None


def test_hexagons_near_the_right_angle(tmp_path):
    def ratio(angle, code):
        values = note(analyse(_hexagons(tmp_path, angle)), code).values["singular_values"]
        return values[-1] / values[0]

    full = ratio(np.pi / 2 - 2e-4, "near-type-2-singularity")
    assert LOST < full < 1e-3
    half = ratio(np.pi / 2 - 1e-4, "near-type-2-singularity")
    assert half == pytest.approx(full / 2, rel=LINEAR)
    assert codes(analyse(_hexagons(tmp_path, np.pi / 2 - 0.3))) == []


def test_ur5_stretched_out():
    """At q = 0 elbow and wrist are both straight: two directions are lost."""
    elastic = load("ur5")
    result = analyse(elastic, np.zeros(6))
    found = note(result, "serial-singularity")
    model = pin.buildModelFromUrdf(robot_file("ur_description/urdf/ur5_robot.urdf"))
    J = body_jacobian(model, np.zeros(6), "tool0")
    length = found.values["characteristic_length"]
    scaled = J / np.array([1.0] * 3 + [length] * 3)[:, None]
    values = np.linalg.svd(scaled, compute_uv=False)
    assert relative_error(found.values["singular_values"], values) <= SAME
    rank = int(np.sum(values > 1e-8 * values[0]))
    assert found.values["rank"] == rank < 6
    blind = np.array(found.values["structural_wrenches"])
    assert blind.shape == (6 - rank, 6)
    assert np.abs(blind @ J).max() <= SAME
    motions = np.array(found.values["reachable_motions"])
    assert motions.shape == (rank, 6)
    assert np.linalg.matrix_rank(np.concatenate([J.T, motions]), tol=1e-8) == rank
    assert all(K is None for K in result.matrices.values())
    # The compliance exists all the same.
    C = J @ np.diag(1 / elastic.springs.stiffness) @ J.T
    for name in "ABK":
        assert relative_error(result.compliances[name], C) <= SAME
    assert result.compliances["F"] is None
